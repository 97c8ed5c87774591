"""ASCOM's own client for Python, alpyca, with `sattrack serve alpaca` as a program: everything it knows."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import pytest
from alpaca import discovery, management
from alpaca.exceptions import (
    ActionNotImplementedException,
    InvalidOperationException,
    InvalidValueException,
    NotConnectedException,
    NotImplementedException,
    ParkedException,
    ValueNotSetException,
)
from alpaca.telescope import DriveRates, GuideDirections, PierSide, Telescope, TelescopeAxes
from alpaca_serving import say, serving
from alpaca_values import EVERYWHERE
from serving import Served, call, until

if TYPE_CHECKING:
    from collections.abc import Iterator


NOBODY = "Action=TrackSatellite&Parameters=nobody"


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with serving(discovery=True) as running:
        # The first to ask for a pass waits for what reckons it: on a busy machine longer than alpyca does.
        with call(running.port) as line:
            say(line, "PUT", "connect")
            until(lambda: say(line, "PUT", "action", NOBODY)["ErrorNumber"] == 0x401)
            say(line, "PUT", "disconnect")
        yield running


@pytest.fixture(scope="module")
def scope(served: Served) -> Iterator[Telescope]:
    telescope = Telescope(f"127.0.0.1:{served.port}", 0)
    telescope.Connect()
    while telescope.Connecting:
        pass
    assert telescope.Connected
    yield telescope
    telescope.Disconnect()
    telescope.rqs.close()


def rise(scope: Telescope) -> float:
    """Return the right ascension that is now at hour angle 3 h, where the mount stands in the beginning."""
    return float((scope.SiderealTime - 3.0) % 24.0)


def test_who_is_not_connected_is_told_so(served: Served) -> None:
    stranger = Telescope(f"127.0.0.1:{served.port}", 0)
    assert stranger.Connected is False
    assert stranger.InterfaceVersion == 4
    with pytest.raises(NotConnectedException):
        _ = stranger.RightAscension
    stranger.Connected = True
    assert stranger.Connected is True
    assert 0.0 <= stranger.RightAscension < 24.0
    stranger.Connected = False
    assert stranger.Connected is False
    stranger.rqs.close()


def test_it_is_found_and_told_of(served: Served) -> None:
    where = f"127.0.0.1:{served.port}"
    until(lambda: where in discovery.search_ipv4(numquery=1, timeout=1))
    assert management.apiversions(where) == [1]
    assert management.description(where)["Manufacturer"] == "sattrack"
    (device,) = management.configureddevices(where)
    assert (device["DeviceType"], device["DeviceNumber"]) == ("Telescope", 0)


READ: dict[str, Any] = {
    **EVERYWHERE,
    "DriverInfo": list,
    "Name": "sattrack: bench mount",
    "SideOfPier": PierSide.pierEast,
    "SiteElevation": float,
    "TrackingRate": DriveRates.driveSidereal,
}


@pytest.mark.parametrize("name", READ)
def test_every_property_is_read(scope: Telescope, name: str) -> None:
    value, wanted = getattr(scope, name), READ[name]
    if isinstance(wanted, type):
        assert isinstance(value, wanted)
    else:
        assert value == wanted


@pytest.mark.parametrize("name", ["ApertureArea", "ApertureDiameter", "FocalLength", "SlewSettleTime"])
def test_what_nobody_can_know_is_not_implemented(scope: Telescope, name: str) -> None:
    with pytest.raises(NotImplementedException):
        getattr(scope, name)


def test_the_date_and_the_state_of_the_device_are_told(scope: Telescope) -> None:
    assert abs(scope.UTCDate.timestamp() - time.time()) < 60.0
    assert {item["Name"] for item in scope.DeviceState} >= {"RightAscension", "Slewing", "TimeStamp"}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("DoesRefraction", True),
        ("GuideRateDeclination", 0.001),
        ("GuideRateRightAscension", 0.001),
        ("SideOfPier", PierSide.pierWest),
        ("SiteElevation", 5.0),
        ("SiteLatitude", 5.0),
        ("SiteLongitude", 5.0),
        ("SlewSettleTime", 1),
        ("UTCDate", "2026-10-02T13:00:00Z"),
    ],
)
def test_what_cannot_be_set_is_not_implemented(scope: Telescope, name: str, value: Any) -> None:
    with pytest.raises(NotImplementedException):
        setattr(scope, name, value)


def test_methods_that_the_mount_has_not_are_not_implemented(scope: Telescope) -> None:
    for refused in (
        scope.SetPark,
        scope.Unpark,
        lambda: scope.SlewToAltAzAsync(180.0, 45.0),
        lambda: scope.SyncToAltAz(180.0, 45.0),
        lambda: scope.CommandBlind("x", False),
        lambda: scope.CommandBool("x", False),
        lambda: scope.CommandString("x", False),
    ):
        with pytest.raises(NotImplementedException):
            refused()
    with pytest.raises(ActionNotImplementedException):
        scope.Action("Dance")


def test_axes_and_their_rates(scope: Telescope) -> None:
    assert [scope.CanMoveAxis(axis) for axis in TelescopeAxes] == [True, True, False]
    (rate,) = scope.AxisRates(TelescopeAxes.axisSecondary)
    assert (rate.Minimum, rate.Maximum) == (0.0, 6.0)
    with pytest.raises(InvalidValueException):
        scope.MoveAxis(TelescopeAxes.axisSecondary, 6.5)


def test_the_side_of_the_pier_at_a_destination(scope: Telescope) -> None:
    assert scope.DestinationSideOfPier(rise(scope), 20.0) == 0


def test_the_target_rates_and_tracking_rate_are_set_and_read(scope: Telescope) -> None:
    with pytest.raises(ValueNotSetException):
        _ = scope.TargetRightAscension
    scope.TargetRightAscension, scope.TargetDeclination = 3.5, -12.25
    assert (scope.TargetRightAscension, scope.TargetDeclination) == (3.5, -12.25)
    with pytest.raises(InvalidValueException):
        scope.TargetDeclination = 91.0
    scope.RightAscensionRate, scope.DeclinationRate = 0.25, -1.5
    assert scope.RightAscensionRate == pytest.approx(0.25)
    assert scope.DeclinationRate == pytest.approx(-1.5)
    scope.RightAscensionRate, scope.DeclinationRate = 0.0, 0.0
    scope.TrackingRate = DriveRates.driveSidereal
    with pytest.raises(InvalidValueException):
        scope.TrackingRate = DriveRates.driveLunar


def test_moveaxis_moves_slews_and_gives_tracking_back(scope: Telescope) -> None:
    before = scope.Declination
    scope.MoveAxis(TelescopeAxes.axisSecondary, 1.0)
    assert scope.Slewing is True
    until(lambda: scope.Declination > before + 0.5)
    scope.MoveAxis(TelescopeAxes.axisSecondary, 0.0)
    assert scope.Slewing is False
    assert scope.Tracking is True


def test_a_pulse_runs_beside_the_client(scope: Telescope) -> None:
    before = scope.Declination
    scope.PulseGuide(GuideDirections.guideNorth, 400)
    assert scope.IsPulseGuiding is True
    with pytest.raises(InvalidOperationException):
        scope.PulseGuide(GuideDirections.guideNorth, 400)
    until(lambda: not scope.IsPulseGuiding)
    assert scope.Declination > before


def test_slews_syncs_and_an_abort(scope: Telescope) -> None:
    ra_h = rise(scope)
    scope.SlewToCoordinatesAsync(ra_h, 14.0)
    assert scope.Slewing is True
    until(lambda: not scope.Slewing)
    assert scope.RightAscension == pytest.approx(ra_h, abs=1e-3)
    scope.TargetRightAscension, scope.TargetDeclination = ra_h, 13.0
    scope.SlewToTargetAsync()
    until(lambda: not scope.Slewing)
    assert scope.Declination == pytest.approx(13.0, abs=1e-2)
    scope.SyncToCoordinates(ra_h, 13.05)
    assert scope.Declination == pytest.approx(13.05, abs=1e-4)
    scope.TargetDeclination = 13.0
    scope.SyncToTarget()
    assert scope.Declination == pytest.approx(13.0, abs=1e-4)
    scope.SlewToCoordinatesAsync((ra_h + 2.0) % 24.0, 40.0)
    scope.AbortSlew()
    until(lambda: not scope.Slewing)
    assert scope.Declination < 39.0


def test_passes_and_a_bias_of_nothing(scope: Telescope) -> None:
    passes = json.loads(scope.Action("Passes", "ISS"))
    assert isinstance(passes, list)
    with pytest.raises(InvalidOperationException):
        scope.Action("Bias")
    with pytest.raises(InvalidValueException):
        scope.Action("TrackSatellite", "no such satellite")


def test_home_and_park_come_last(scope: Telescope) -> None:
    until(lambda: not scope.Slewing)
    scope.FindHome()
    until(lambda: bool(scope.AtHome))
    scope.Park()
    until(lambda: bool(scope.AtPark))
    assert scope.Slewing is False
    with pytest.raises(ParkedException):
        scope.MoveAxis(TelescopeAxes.axisPrimary, 1.0)
    with pytest.raises(ParkedException):
        scope.AbortSlew()

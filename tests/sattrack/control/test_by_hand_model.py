"""Slews, syncs and clients' positions with a pointing model.

Where the telescope looks is a stranger's rotations' to say, and where a star is seen is ERFA's.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import erfa
import msgspec
import numpy as np
import pytest
from console_builders import PROFILE, SITE, Bench
from strangers.tilted_mount import TiltedMount, apart_arcsec

from sattrack.control.aim import MountInstant
from sattrack.control.manual_operation import ConsoleSession, view_of
from sattrack.control.procedures import procedure_for
from sattrack.mount.geometry import AxisGeometry, Pole
from sattrack.mount.model import AxesPosition, PointingTerms, SitePlace, Slew
from sattrack.mount.requests import Park, Sync, TicketState
from sattrack.mount.simulator.mount import StartPosition
from sattrack.servers.alpaca.protocol import NumberedOrder
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.rotator import RotatorStation

TERMS = {"ME": -4000.0, "MA": 3500.0, "CH": -600.0, "NP": -90.0, "IH": -700.0, "ID": 900.0, "TF": 30.0}
MODEL = PointingTerms(
    "2026-10-01T00:00:00Z",
    SITE.latitude_deg,
    {name: (value, 1.0) for name, value in TERMS.items()},
    2.0,
    20,
    signs="tpoint",
)
MOUNT = TiltedMount(SITE.latitude_deg, 4000.0, -3500.0, 600.0, 90.0, 700.0, -900.0, 30.0)
BOUND_ARCSEC = 7.0
"""The model is the mount's own; Bennett's and ERFA's refraction differ by arcseconds at 33° of altitude."""


def bench(**changes: Any) -> Bench:
    profile = msgspec.structs.replace(PROFILE, **{"pointing": MODEL, **changes})
    made = Bench(profile=profile, start=StartPosition(10.0, 40.0))
    made.run(1.0)
    return made


def seen(ra_deg: float, dec_deg: float, sidereal_deg: float) -> np.ndarray:
    """Return where a direction of date is seen through the air, a unit vector east, north, up."""
    azimuth, altitude = erfa.hd2ae(
        math.radians(sidereal_deg - ra_deg), math.radians(dec_deg), math.radians(SITE.latitude_deg)
    )
    a, b = erfa.refco(1013.25, 15.0, 0.0, 0.55)
    zenith = true = 0.5 * math.pi - altitude
    for _ in range(5):
        zenith = true - a * math.tan(zenith) - b * math.tan(zenith) ** 3
    return np.array(
        [math.sin(zenith) * math.sin(azimuth), math.sin(zenith) * math.cos(azimuth), math.cos(zenith)]
    )


def missed_arcsec(made: Bench, ra_deg: float, dec_deg: float) -> float:
    """Return how far beside a direction the stranger's telescope looks."""
    truth = made.truth
    assert truth is not None
    looks = MOUNT.looks(truth.hour_angle_axis_deg, truth.dec_axis_deg)
    return apart_arcsec(looks, seen(ra_deg, dec_deg, sidereal_deg(made)))


def sidereal_deg(made: Bench) -> float:
    status = made.console.status
    assert status is not None
    return status.sidereal_h * 15.0


@pytest.mark.parametrize(("hour_angle", "dec"), [(-35.0, 20.0), (40.0, 65.0), (15.0, -5.0)])
def test_a_slew_ends_with_the_telescope_on_the_direction(hour_angle: float, dec: float) -> None:
    made = bench()
    ra = (sidereal_deg(made) - hour_angle) % 360.0
    session = ConsoleSession(made.console, made.now_s)
    for _ in range(30):
        made.turn(session)
    session.obey(Slew(ra, dec), made.now_s)
    while made.console.outcome is None:
        made.turn(session)
    assert made.console.outcome.state is TicketState.COMPLETE
    assert missed_arcsec(made, ra, dec) < BOUND_ARCSEC
    looks = view_of(made.console, made.now_s).looks_at_deg
    assert looks is not None
    assert looks == pytest.approx((ra, dec), abs=5.0 / 3600.0 / math.cos(math.radians(dec)))


@pytest.mark.parametrize("hour_angle", [-0.5, 0.5, -350.0, 350.0])
def test_a_slew_is_fed_by_the_model_of_the_side_on_which_it_ends(hour_angle: float) -> None:
    """By the hour angle: west of the meridian beyond the pole, on whatever turn the sidereal time is."""
    made = bench(pier_rule="hour_angle")
    one, sample = made.console, made.console.session.sample
    assert one.sky_aim is not None
    assert sample is not None
    heard = MountInstant.of(sample, made.now_s)._replace(sidereal_deg=175.0 + 0.5 * hour_angle)
    one._instant = lambda _: heard  # type: ignore[method-assign]
    ra = 175.0 - 0.5 * hour_angle
    west = math.sin(math.radians(hour_angle)) > 0.0
    sides = [
        one.sky_aim.reported_deg(ra, 50.0, heard._replace(beyond_pole=beyond)) for beyond in (False, True)
    ]
    assert apart_deg(*sides) > 0.05
    assert one.aim(Slew(ra, 50.0), None, made.now_s) == Slew(*sides[west])


def apart_deg(one: tuple[float, float], other: tuple[float, float]) -> float:
    return max(abs(math.remainder(one[0] - other[0], 360.0)), abs(one[1] - other[1]))


@pytest.mark.parametrize(("hour_angle", "dec"), [(-35.0, 20.0), (40.0, 65.0), (15.0, -5.0)])
def test_rates_lead_a_mount_with_a_pole_of_its_own_to_the_direction(hour_angle: float, dec: float) -> None:
    pole = Pole(55.0, 25.0)
    mount = dataclasses.replace(MOUNT, latitude_deg=pole.pole_altitude_deg, pole_azimuth_deg=55.0)
    made = bench(
        additive=False,
        geometry=AxisGeometry(pole.pole_azimuth_deg, pole.pole_altitude_deg),
        stands_at=SitePlace(SITE.latitude_deg, SITE.longitude_deg),
        pointing=msgspec.structs.replace(MODEL, axes=pole),
    )
    session = ConsoleSession(made.console, made.now_s)
    made.turn(session)
    ra = (sidereal_deg(made) - hour_angle) % 360.0
    session.obey(Slew(ra, dec), made.now_s)
    while made.console.outcome is None:
        made.turn(session)
    assert made.console.outcome.state is TicketState.COMPLETE
    truth = made.truth
    assert truth is not None
    looks = mount.looks(truth.hour_angle_axis_deg, truth.dec_axis_deg)
    assert apart_arcsec(looks, seen(ra, dec, sidereal_deg(made))) < BOUND_ARCSEC
    shown = view_of(made.console, made.now_s).looks_at_deg
    assert shown == pytest.approx((ra, dec), abs=5.0 / 3600.0 / math.cos(math.radians(dec)))


def test_without_a_model_slews_are_in_the_mounts_own_coordinates() -> None:
    made = bench(pointing=None)
    ra = (sidereal_deg(made) + 35.0) % 360.0
    made.carry_out(procedure_for(Slew(ra, 20.0), made.profile))
    status = made.console.status
    assert status is not None
    assert (status.ra_h * 15.0, status.dec_deg) == pytest.approx((ra, 20.0), abs=0.01)
    assert view_of(made.console, made.now_s).looks_at_deg is None


def test_a_park_position_is_one_of_the_axes() -> None:
    made = bench(park=AxesPosition(20.0, 45.0))
    made.carry_out(procedure_for(Park(), made.profile))
    assert made.truth is not None
    assert made.truth.hour_angle_axis_deg == pytest.approx(20.0, abs=0.1)
    assert made.truth.dec_axis_deg == pytest.approx(45.0, abs=0.01)


def test_a_sync_keeps_the_model_right() -> None:
    # The telescope looks at a star; a mount that agrees with its model hardly changes what it reports.
    made = bench()
    ra = (sidereal_deg(made) + 30.0) % 360.0
    made.carry_out(procedure_for(Slew(ra, 30.0), made.profile))
    before = made.console.status
    assert before is not None
    made.carry_out(procedure_for(Sync(ra, 30.0), made.profile))
    after = made.console.status
    assert after is not None
    assert (after.ra_h * 15.0, after.dec_deg) == pytest.approx(
        (before.ra_h * 15.0, before.dec_deg), abs=5.0 / 3600.0
    )


def test_a_client_of_alpaca_points_and_sees_by_the_model() -> None:
    made = bench()

    def no_engine(*_: Any) -> Any:
        raise ValueError

    station = TelescopeStation(made.profile, made.limits, SITE, "bench", no_engine)
    for _ in range(40):
        made.turn(station)  # type: ignore[arg-type]
    ra = (sidereal_deg(made) + 20.0) % 360.0
    station.obey(NumberedOrder(1, Slew(ra, 50.0)), made.now_s)
    for _ in range(2000):
        made.turn(station)  # type: ignore[arg-type]
        if not station.state(made.now_s).slewing:
            break
    state = station.state(made.now_s)
    truth, status = made.truth, station.session.status
    assert truth is not None
    assert status is not None
    looks = MOUNT.looks(truth.hour_angle_axis_deg, truth.dec_axis_deg)
    assert apart_arcsec(looks, seen(ra, 50.0, status.sidereal_h * 15.0)) < BOUND_ARCSEC
    assert (state.ra_h * 15.0, state.dec_deg) == pytest.approx((ra, 50.0), abs=8.0 / 3600.0)
    assert state.does_refraction


def test_a_client_of_rotctld_points_the_telescope_by_the_model() -> None:
    made = bench()
    station = RotatorStation(SiteSky(SITE), made.profile, made.limits)
    for _ in range(40):
        made.turn(station)  # type: ignore[arg-type]
    assert station.rotator.point(1, 120.0, 40.0, made.now_s).value == 0
    for _ in range(800):
        made.turn(station)  # type: ignore[arg-type]
    assert made.truth is not None
    looks = MOUNT.looks(made.truth.hour_angle_axis_deg, made.truth.dec_axis_deg)
    azimuth, altitude = math.radians(120.0), math.radians(40.0)
    wanted = np.array(
        [
            math.cos(altitude) * math.sin(azimuth),
            math.cos(altitude) * math.cos(azimuth),
            math.sin(altitude),
        ]
    )
    # The mount's clock is a mean one, the positions' the true one.
    assert apart_arcsec(looks, wanted) < 25.0
    shown = station.rotator.where(round(made.now_s * 1e9))
    assert shown is not None
    assert (shown.az_deg, shown.el_deg) == pytest.approx((120.0, 40.0), abs=0.003)

"""ConformU's checks of a telescope, restated from ITelescopeV4's definition, against a simulated mount.

What ConformU does in real time over HTTP is done here request by request in virtual time.
"""

from __future__ import annotations

from typing import Any

import pytest
from alpaca_stand import PROFILE, VirtualTelescope
from alpaca_values import EVERYWHERE
from msgspec.structs import replace

from sattrack.servers.alpaca.protocol import Fault, Number
from tle.instants import Utc

NOT_IMPLEMENTED, INVALID, NOT_SET = Number.NOT_IMPLEMENTED, Number.INVALID_VALUE, Number.VALUE_NOT_SET
NOT_CONNECTED, PARKED, INVALID_OPERATION = Number.NOT_CONNECTED, Number.PARKED, Number.INVALID_OPERATION
SIDEREAL_DEG_S = 15.041067 / 3600.0

READABLE: dict[str, Any] = {
    **EVERYWHERE,
    "Connected": True,
    "Connecting": False,
    "DriverInfo": str,
    "Name": str,
    "DeviceState": list,
    "SideOfPier": 0,
    "SiteElevation": 0.0,
    "TrackingRate": 0,
    "UTCDate": str,
}
WITHOUT_CONNECTION = {
    "Connected",
    "Connecting",
    "Description",
    "DriverInfo",
    "DriverVersion",
    "InterfaceVersion",
    "Name",
    "SupportedActions",
}
# Member and parameters of a PUT, and the error number that the definition wants.
REFUSED: list[tuple[str, dict[str, Any], Number]] = [
    ("Unpark", {}, NOT_IMPLEMENTED),
    ("SetPark", {}, NOT_IMPLEMENTED),
    ("SideOfPier", {"SideOfPier": 0}, NOT_IMPLEMENTED),
    ("DoesRefraction", {"DoesRefraction": "True"}, NOT_IMPLEMENTED),
    ("GuideRateDeclination", {"GuideRateDeclination": 0.002}, NOT_IMPLEMENTED),
    ("GuideRateRightAscension", {"GuideRateRightAscension": 0.002}, NOT_IMPLEMENTED),
    ("SiteElevation", {"SiteElevation": 10}, NOT_IMPLEMENTED),
    ("SiteLatitude", {"SiteLatitude": 52}, NOT_IMPLEMENTED),
    ("SiteLongitude", {"SiteLongitude": 4}, NOT_IMPLEMENTED),
    ("SlewSettleTime", {"SlewSettleTime": 1}, NOT_IMPLEMENTED),
    ("UTCDate", {"UTCDate": "2026-10-02T13:00:00Z"}, NOT_IMPLEMENTED),
    ("SlewToAltAz", {"Azimuth": 180, "Altitude": 45}, NOT_IMPLEMENTED),
    ("SlewToAltAzAsync", {"Azimuth": 180, "Altitude": 45}, NOT_IMPLEMENTED),
    ("SyncToAltAz", {"Azimuth": 180, "Altitude": 45}, NOT_IMPLEMENTED),
    ("CommandBlind", {"Command": "x", "Raw": "False"}, NOT_IMPLEMENTED),
    ("CommandBool", {"Command": "x", "Raw": "False"}, NOT_IMPLEMENTED),
    ("CommandString", {"Command": "x", "Raw": "False"}, NOT_IMPLEMENTED),
    ("Action", {"Action": "Nothing", "Parameters": ""}, Number.ACTION_NOT_IMPLEMENTED),
    ("TrackingRate", {"TrackingRate": 1}, INVALID),
    ("TrackingRate", {"TrackingRate": 5}, INVALID),
    ("TrackingRate", {"TrackingRate": -1}, INVALID),
    ("TargetRightAscension", {"TargetRightAscension": -1.0}, INVALID),
    ("TargetRightAscension", {"TargetRightAscension": 25.0}, INVALID),
    ("TargetDeclination", {"TargetDeclination": -100.0}, INVALID),
    ("TargetDeclination", {"TargetDeclination": 100.0}, INVALID),
    ("SlewToTarget", {}, NOT_SET),
    ("SlewToTargetAsync", {}, NOT_SET),
    ("SyncToTarget", {}, NOT_SET),
    *(
        (member, {"RightAscension": ra, "Declination": dec}, INVALID)
        for member in ("SlewToCoordinates", "SlewToCoordinatesAsync", "SyncToCoordinates")
        for ra, dec in ((-1.0, 0.0), (25.0, 0.0), (12.0, -100.0), (12.0, 100.0))
    ),
    ("MoveAxis", {"Axis": -1, "Rate": 0}, INVALID),
    ("MoveAxis", {"Axis": 3, "Rate": 0}, INVALID),
    ("MoveAxis", {"Axis": 2, "Rate": 1}, NOT_IMPLEMENTED),
    ("MoveAxis", {"Axis": 0, "Rate": 6.0}, INVALID),
    ("MoveAxis", {"Axis": 0, "Rate": -6.0}, INVALID),
    ("MoveAxis", {"Axis": 1, "Rate": 6.001}, INVALID),
    ("MoveAxis", {"Axis": 1, "Rate": -6.001}, INVALID),
    ("PulseGuide", {"Direction": 4, "Duration": 10}, INVALID),
    ("PulseGuide", {"Direction": -1, "Duration": 10}, INVALID),
    ("PulseGuide", {"Direction": 0, "Duration": -1}, INVALID),
    ("RightAscensionRate", {"RightAscensionRate": 24.0}, INVALID),
    ("DeclinationRate", {"DeclinationRate": -361.0}, INVALID),
]


@pytest.fixture(scope="module")
def idle() -> VirtualTelescope:
    """Give a telescope of which nothing is asked that moves it."""
    return VirtualTelescope()


@pytest.fixture
def scope() -> VirtualTelescope:
    return VirtualTelescope()


@pytest.mark.parametrize("member", READABLE)
def test_every_property_is_read_and_is_what_it_must_be(idle: VirtualTelescope, member: str) -> None:
    value, wanted = idle.get(member.lower()), READABLE[member]
    if isinstance(wanted, type):
        assert type(value) is wanted
        assert value != ""
    else:
        assert value == wanted


@pytest.mark.parametrize("member", ["ApertureArea", "ApertureDiameter", "FocalLength", "SlewSettleTime"])
def test_what_nobody_can_know_is_not_implemented(idle: VirtualTelescope, member: str) -> None:
    assert idle.get_fault(member.lower()) is NOT_IMPLEMENTED


@pytest.mark.parametrize("member", ["TargetRightAscension", "TargetDeclination"])
def test_a_target_is_not_read_before_it_is_written(idle: VirtualTelescope, member: str) -> None:
    assert idle.get_fault(member.lower()) is NOT_SET


@pytest.mark.parametrize(("member", "parameters", "number"), REFUSED)
def test_what_cannot_be_done_ends_in_its_own_error_and_moves_nothing(
    idle: VirtualTelescope, member: str, parameters: dict[str, Any], number: Number
) -> None:
    before = idle.get("rightascension"), idle.get("declination")
    assert idle.fault_of(member.lower(), **parameters) is number
    idle.run_for(0.5)
    after = idle.get("rightascension"), idle.get("declination")
    assert after == pytest.approx(before, abs=1e-6)
    assert idle.get("slewing") is False


@pytest.mark.parametrize("member", READABLE)
def test_who_is_not_connected_is_told_so(member: str) -> None:
    scope = VirtualTelescope(connected=False)
    wanted = Number.OK if member in WITHOUT_CONNECTION else NOT_CONNECTED
    assert scope.get_fault(member.lower()) is wanted
    assert scope.fault_of("moveaxis", Axis=0, Rate=1) is NOT_CONNECTED
    assert scope.fault_of("abortslew") is NOT_CONNECTED


def test_clients_connect_both_ways_and_each_for_itself(scope: VirtualTelescope) -> None:
    assert scope.put("disconnect") is None
    assert scope.get("connected") is False
    assert scope.get("connecting") is False
    scope.put("connect")
    assert scope.get("connected") is True
    assert scope.get("connected", ClientID=7) is False
    scope.put("connected", ClientID=7, Connected="true")
    scope.put("connected", Connected="FALSE")
    assert scope.get("connected", ClientID=7) is True
    assert scope.get("connected") is False
    assert scope.get("tracking") is True


def test_the_mounts_numbers_are_the_mounts_own(idle: VirtualTelescope) -> None:
    # The simulated mount begins at hour angle 50°, declination 15°, and tracks; guide rates are the paper's
    # 3500, of which 7789 is the sidereal rate.
    hour_angle_h = (idle.get("siderealtime") - idle.get("rightascension")) % 24.0
    assert hour_angle_h * 15.0 == pytest.approx(50.0, abs=0.5)
    assert idle.get("declination") == pytest.approx(15.0, abs=1e-4)
    for member in ("guideratedeclination", "guideraterightascension"):
        assert idle.get(member) == pytest.approx(SIDEREAL_DEG_S * 3500 / 7789, rel=1e-3)


def test_device_state_tells_what_the_definition_lists_at_one_instant(idle: VirtualTelescope) -> None:
    told = {item["Name"]: item["Value"] for item in idle.get("devicestate")}
    assert set(told) == {
        "Altitude",
        "AtHome",
        "AtPark",
        "Azimuth",
        "Declination",
        "IsPulseGuiding",
        "RightAscension",
        "SideOfPier",
        "SiderealTime",
        "Slewing",
        "Tracking",
        "UTCDate",
        "TimeStamp",
    }
    assert told["RightAscension"] == idle.get("rightascension")
    assert told["UTCDate"].endswith("Z")


@pytest.mark.parametrize(
    ("axis", "most", "moves"), [(0, 6.0 - SIDEREAL_DEG_S, True), (1, 6.0, True), (2, 0, False)]
)
def test_axis_rates_are_the_profiles_and_not_negative(
    idle: VirtualTelescope, axis: int, most: float, moves: bool
) -> None:
    assert idle.get("canmoveaxis", Axis=axis) is moves
    rates = idle.get("axisrates", Axis=axis)
    assert len(rates) == int(moves)
    for rate in rates:
        assert 0.0 <= rate["Minimum"] <= rate["Maximum"] == pytest.approx(most, abs=1e-6)


@pytest.mark.parametrize("axis", [-1, 3])
def test_an_axis_that_there_is_not_is_an_invalid_value(idle: VirtualTelescope, axis: int) -> None:
    assert idle.get_fault("canmoveaxis", Axis=axis) is INVALID
    assert idle.get_fault("axisrates", Axis=axis) is INVALID


@pytest.mark.parametrize(("axis", "rate"), [(0, 1.0), (0, -1.0), (1, 1.5), (1, -1.5), (0, 5.9), (1, 6.0)])
def test_moveaxis_turns_an_axis_at_its_rate_slews_meanwhile_and_gives_tracking_back(
    scope: VirtualTelescope, axis: int, rate: float
) -> None:
    assert scope.get("tracking") is True
    scope.put("moveaxis", Axis=axis, Rate=rate)
    assert scope.get("slewing") is True
    scope.run_for(2.0)
    before, then_s = scope.truths[-1], scope.truths[-1].utc_s
    scope.run_for(1.0)
    after = scope.truths[-1]
    seconds = after.utc_s - then_s
    # The axes' own truth: of hour angle, right ascension turns the other way, and the sky turns meanwhile.
    turned = SIDEREAL_DEG_S - (after.ra_deg - before.ra_deg) / seconds
    assert turned == pytest.approx(rate if axis == 0 else SIDEREAL_DEG_S, abs=1e-3)
    assert (after.dec_deg - before.dec_deg) / seconds == pytest.approx(rate if axis == 1 else 0.0, abs=1e-3)
    scope.put("moveaxis", Axis=axis, Rate=0)
    assert scope.get("slewing") is False
    assert scope.get("tracking") is True
    stands = scope.get("rightascension"), scope.get("declination")
    scope.run_for(5.0)
    assert (scope.get("rightascension"), scope.get("declination")) == pytest.approx(stands, abs=3e-6)


def test_both_axes_move_at_rates_of_their_own_and_each_ends_by_itself(scope: VirtualTelescope) -> None:
    scope.put("moveaxis", Axis=0, Rate=-1.0)
    scope.put("moveaxis", Axis=1, Rate=0.5)
    scope.run_for(2.0)
    first = scope.truths[-1]
    scope.put("moveaxis", Axis=0, Rate=0)
    assert scope.get("slewing") is True
    scope.run_for(1.0)
    second = scope.truths[-1]
    scope.run_for(1.0)
    third = scope.truths[-1]
    assert third.ra_deg == pytest.approx(second.ra_deg, abs=1e-4)
    assert third.dec_deg - second.dec_deg == pytest.approx(0.5, abs=0.01)
    assert first.ra_deg < second.ra_deg
    scope.put("moveaxis", Axis=1, Rate=0)
    assert scope.get("slewing") is False
    assert scope.get("tracking") is True


@pytest.mark.parametrize("additive", [True, False])
@pytest.mark.parametrize("first", [0, 1])
def test_a_mount_that_did_not_track_stands_after_moveaxis_and_its_other_axis_stands_meanwhile(
    first: int, additive: bool
) -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, additive=additive))
    scope.put("tracking", Tracking="False")
    stands = scope.truths[-1]
    scope.put("moveaxis", Axis=first, Rate=1.0)
    assert scope.get("tracking") is False
    scope.run_for(2.0)
    moved = scope.truths[-1]
    turned = moved.hour_angle_axis_deg - stands.hour_angle_axis_deg, moved.dec_deg - stands.dec_deg
    assert turned[first] > 1.0
    assert abs(turned[1 - first]) < 1e-3
    scope.put("moveaxis", Axis=1 - first, Rate=0.5)
    scope.put("moveaxis", Axis=first, Rate=0)
    scope.run_for(2.0)
    before = scope.truths[-1]
    scope.run_for(1.0)
    after = scope.truths[-1]
    still = (
        after.hour_angle_axis_deg - before.hour_angle_axis_deg
        if first == 0
        else after.dec_deg - before.dec_deg
    )
    assert abs(still) < 1e-4
    scope.put("moveaxis", Axis=1 - first, Rate=0)
    assert scope.get("slewing") is False
    scope.run_for(2.0)
    assert scope.get("tracking") is False
    before = scope.truths[-1].hour_angle_axis_deg
    scope.run_for(10.0)
    assert scope.truths[-1].hour_angle_axis_deg == pytest.approx(before, abs=1e-4)


def test_a_rate_is_changed_in_mid_move_without_a_stop(scope: VirtualTelescope) -> None:
    for rate in (0.5, 2.0, -1.0):
        scope.put("moveaxis", Axis=1, Rate=rate)
        scope.run_for(1.0)
        before = scope.truths[-1]
        scope.run_for(0.5)
        seconds = scope.truths[-1].utc_s - before.utc_s
        assert (scope.truths[-1].dec_deg - before.dec_deg) / seconds == pytest.approx(rate, abs=0.01)
        assert scope.get("slewing") is True


def test_the_sidereal_rate_of_moveaxis_is_tracking_itself(scope: VirtualTelescope) -> None:
    ra_h = scope.get("rightascension")
    scope.put("moveaxis", Axis=0, Rate=SIDEREAL_DEG_S)
    scope.run_for(10.0)
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1e-5)
    scope.put("moveaxis", Axis=0, Rate=0)


def test_moveaxis_0_of_a_mount_that_does_not_move_does_nothing(scope: VirtualTelescope) -> None:
    for axis in (0, 1):
        assert scope.put("moveaxis", Axis=axis, Rate=0.0) is None
    assert scope.get("slewing") is False


@pytest.mark.parametrize("how", ["SlewToCoordinates", "SlewToTarget"])
def test_a_slew_that_waits_is_there_when_it_is_answered(scope: VirtualTelescope, how: str) -> None:
    ra_h, dec_deg = (scope.get("siderealtime") - 1.0) % 24.0, 40.0
    if how == "SlewToTarget":
        scope.put("targetrightascension", TargetRightAscension=ra_h)
        scope.put("targetdeclination", TargetDeclination=dec_deg)
        scope.put("slewtotarget")
    else:
        scope.put("slewtocoordinates", RightAscension=ra_h, Declination=dec_deg)
    assert scope.get("slewing") is False
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1.0 / 3600.0)
    assert scope.get("declination") == pytest.approx(dec_deg, abs=10.0 / 3600.0)
    assert scope.get("targetrightascension") == pytest.approx(ra_h)
    assert scope.get("targetdeclination") == dec_deg


@pytest.mark.parametrize("how", ["SlewToCoordinatesAsync", "SlewToTargetAsync"])
def test_a_slew_that_does_not_wait_is_under_way_when_it_is_answered(
    scope: VirtualTelescope, how: str
) -> None:
    ra_h, dec_deg = (scope.get("siderealtime") + 1.0) % 24.0, 60.0
    began_s = scope.now_utc_s
    if how == "SlewToTargetAsync":
        scope.put("targetrightascension", TargetRightAscension=ra_h)
        scope.put("targetdeclination", TargetDeclination=dec_deg)
        scope.put("slewtotargetasync")
    else:
        scope.put("slewtocoordinatesasync", RightAscension=ra_h, Declination=dec_deg)
    assert scope.now_utc_s - began_s < 0.1
    assert scope.get("slewing") is True
    assert scope.get("tracking") is True
    scope.wait_while("slewing")
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1.0 / 3600.0)
    assert scope.get("tracking") is True


def test_right_ascension_24_is_right_ascension_0(scope: VirtualTelescope) -> None:
    scope.put("targetrightascension", TargetRightAscension=24.0)
    assert scope.get("targetrightascension") == 24.0


def test_an_abort_ends_a_slew_and_tells_whoever_waits_for_it(scope: VirtualTelescope) -> None:
    asked = scope.ask(
        "PUT", "slewtocoordinates", RightAscension=(scope.get("siderealtime") + 3.0) % 24.0, Declination=60.0
    )
    number = scope.give(asked.order, asked.waits)
    scope.run_for(2.0)
    assert scope.answered(number) is None
    scope.put("abortslew")
    answer = scope.answered(number)
    assert answer is not None
    assert answer.fault == Number.CANCELLED
    scope.wait_while("slewing")
    stands = scope.truths[-1]
    assert stands.dec_deg < 59.0
    scope.run_for(2.0)
    assert scope.truths[-1].dec_deg == pytest.approx(stands.dec_deg, abs=0.3)


def test_an_abort_with_nothing_under_way_is_no_error(scope: VirtualTelescope) -> None:
    assert scope.put("abortslew") is None
    scope.run_for(2.0)
    assert scope.get("slewing") is False


def test_an_abort_ends_moveaxis(scope: VirtualTelescope) -> None:
    scope.put("moveaxis", Axis=1, Rate=2.0)
    scope.run_for(1.0)
    scope.put("abortslew")
    scope.wait_while("slewing")
    before = scope.truths[-1].dec_deg
    scope.run_for(1.0)
    assert scope.truths[-1].dec_deg == pytest.approx(before, abs=0.5)
    scope.run_for(1.0)
    assert scope.fault_of("moveaxis", Axis=1, Rate=1.0) is Number.OK


@pytest.mark.parametrize("how", ["SyncToCoordinates", "SyncToTarget"])
def test_a_sync_shows_when_it_is_answered(scope: VirtualTelescope, how: str) -> None:
    ra_h, dec_deg = (scope.get("rightascension") + 0.02) % 24.0, scope.get("declination") - 0.25
    if how == "SyncToTarget":
        scope.put("targetrightascension", TargetRightAscension=ra_h)
        scope.put("targetdeclination", TargetDeclination=dec_deg)
        scope.put("synctotarget")
    else:
        scope.put("synctocoordinates", RightAscension=ra_h, Declination=dec_deg)
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1e-6)
    assert scope.get("declination") == pytest.approx(dec_deg, abs=1e-5)


# Direction, and which way right ascension (hours) and declination (degrees) go: north, south, east, west.
@pytest.mark.parametrize(("direction", "ra_way", "dec_way"), [(0, 0, 1), (1, 0, -1), (2, 1, 0), (3, -1, 0)])
def test_a_pulse_goes_its_way_for_its_time_beside_the_client(
    scope: VirtualTelescope, direction: int, ra_way: int, dec_way: int
) -> None:
    began_s, before = scope.now_utc_s, scope.truths[-1]
    scope.put("pulseguide", Direction=direction, Duration=2000)
    assert scope.now_utc_s - began_s < 0.1
    assert scope.get("ispulseguiding") is True
    assert scope.get("slewing") is False
    assert scope.fault_of("pulseguide", Direction=direction, Duration=100) is INVALID_OPERATION
    scope.wait_while("ispulseguiding")
    assert 2.0 <= scope.now_utc_s - began_s < 2.6
    scope.run_for(0.5)
    guided_deg = 2.0 * SIDEREAL_DEG_S * 3500 / 7789
    moved = scope.truths[-1].ra_deg - before.ra_deg, scope.truths[-1].dec_deg - before.dec_deg
    assert moved == pytest.approx((ra_way * guided_deg, dec_way * guided_deg), abs=1e-4)
    assert scope.get("tracking") is True


def test_a_pulse_of_the_other_axis_begins_when_the_first_has_ended(scope: VirtualTelescope) -> None:
    """As Ekos sends both at once."""
    began_s, before = scope.now_utc_s, scope.truths[-1]
    scope.put("pulseguide", Direction=2, Duration=1000)
    scope.put("pulseguide", Direction=0, Duration=600)
    for direction in range(4):
        assert scope.fault_of("pulseguide", Direction=direction, Duration=100) is INVALID_OPERATION
    scope.wait_while("ispulseguiding")
    assert 1.6 <= scope.now_utc_s - began_s < 2.8
    scope.run_for(0.5)
    rate_deg_s = SIDEREAL_DEG_S * 3500 / 7789
    moved = scope.truths[-1].ra_deg - before.ra_deg, scope.truths[-1].dec_deg - before.dec_deg
    assert moved == pytest.approx((1.0 * rate_deg_s, 0.6 * rate_deg_s), abs=1e-4)


def test_a_pulse_that_waits_is_forgotten_with_a_stop(scope: VirtualTelescope) -> None:
    before = scope.truths[-1]
    scope.put("pulseguide", Direction=2, Duration=1000)
    scope.put("pulseguide", Direction=0, Duration=1000)
    scope.put("abortslew")
    scope.wait_while("slewing")
    scope.run_for(3.0)
    assert scope.get("ispulseguiding") is False
    assert scope.truths[-1].dec_deg == pytest.approx(before.dec_deg, abs=1e-6)


def test_a_pulse_of_no_length_is_done_at_once(scope: VirtualTelescope) -> None:
    assert scope.put("pulseguide", Direction=0, Duration=0) is None
    assert scope.get("ispulseguiding") is False


@pytest.mark.parametrize(("rate", "way"), [(0.5, 1), (-2.0, -1)])
def test_a_right_ascension_rate_is_in_seconds_of_it_a_sidereal_second(
    scope: VirtualTelescope, rate: float, way: int
) -> None:
    scope.put("rightascensionrate", RightAscensionRate=rate)
    assert scope.get("rightascensionrate") == pytest.approx(rate, abs=1e-9)
    scope.run_for(1.0)
    before = scope.truths[-1]
    scope.run_for(20.0)
    sidereal_s = (scope.truths[-1].utc_s - before.utc_s) * 86400.0 / 86164.0905
    gone_s = (scope.truths[-1].ra_deg - before.ra_deg) * 240.0
    # The mount takes rates in tenths of a tic: 0.0019″ a second.
    assert gone_s / sidereal_s == pytest.approx(rate, abs=2e-4)
    assert gone_s * way > 0.0
    assert scope.get("tracking") is True
    scope.put("rightascensionrate", RightAscensionRate=0)
    assert scope.get("rightascensionrate") == 0.0


def test_a_declination_rate_is_in_arcseconds_a_second_and_leaves_the_other_one_alone(
    scope: VirtualTelescope,
) -> None:
    scope.put("rightascensionrate", RightAscensionRate=0.1)
    scope.put("declinationrate", DeclinationRate=-5.0)
    assert scope.get("rightascensionrate") == pytest.approx(0.1, abs=1e-9)
    scope.run_for(1.0)
    before = scope.truths[-1]
    scope.run_for(20.0)
    seconds = scope.truths[-1].utc_s - before.utc_s
    assert (scope.truths[-1].dec_deg - before.dec_deg) * 3600.0 / seconds == pytest.approx(-5.0, abs=0.003)


def test_offset_rates_are_answered_at_once_and_hold_nothing_up(scope: VirtualTelescope) -> None:
    began_s = scope.now_utc_s
    scope.put("declinationrate", DeclinationRate=0.01)
    assert scope.now_utc_s - began_s < 0.2
    scope.put("moveaxis", Axis=0, Rate=1.0)
    scope.put("moveaxis", Axis=0, Rate=0)
    began_s = scope.now_utc_s
    scope.put("declinationrate", DeclinationRate=0.02)
    scope.put("rightascensionrate", RightAscensionRate=0.001)
    scope.put("declinationrate", DeclinationRate=0.03)
    assert scope.now_utc_s - began_s < 0.5
    assert scope.get("declinationrate") == pytest.approx(0.03, abs=1e-9)
    assert scope.put("pulseguide", Direction=0, Duration=100) is None
    scope.wait_while("ispulseguiding")
    assert scope.get("declinationrate") == pytest.approx(0.03, abs=1e-9)


@pytest.mark.parametrize("move_axis", ["held", "edge"])
@pytest.mark.parametrize("additive", [True, False])
def test_tracking_is_ended_by_a_stop_and_set_again(move_axis: Any, additive: bool) -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, move_axis=move_axis, additive=additive))
    scope.put("moveaxis", Axis=1, Rate=1.0)
    scope.run_for(1.0)
    scope.put("abortslew")
    scope.run_for(3.0)
    assert scope.get("tracking") is False
    stands = scope.truths[-1].hour_angle_axis_deg
    scope.run_for(5.0)
    assert scope.truths[-1].hour_angle_axis_deg == pytest.approx(stands, abs=1e-4)
    assert scope.put("tracking", Tracking="True") is None
    assert scope.get("tracking") is True
    assert scope.get("slewing") is False
    ra_deg, dec_deg = scope.truths[-1].ra_deg, scope.truths[-1].dec_deg
    scope.run_for(20.0)
    assert scope.truths[-1].ra_deg == pytest.approx(ra_deg, abs=1e-4)
    assert scope.truths[-1].dec_deg == pytest.approx(dec_deg, abs=1e-4)
    assert scope.put("tracking", Tracking="True") is None
    assert scope.put("tracking", Tracking="False") is None
    assert scope.get("tracking") is False
    stands = scope.truths[-1].hour_angle_axis_deg
    scope.run_for(5.0)
    assert scope.truths[-1].hour_angle_axis_deg == pytest.approx(stands, abs=1e-4)


def test_tracking_is_not_granted_by_name_only_while_a_stop_ends_it(scope: VirtualTelescope) -> None:
    scope.put("moveaxis", Axis=1, Rate=1.0)
    scope.run_for(1.0)
    scope.put("abortslew")
    assert scope.fault_of("tracking", Tracking="True") is Number.INVALID_OPERATION
    scope.run_for(3.0)
    assert scope.get("tracking") is False
    assert scope.put("tracking", Tracking="True") is None
    assert scope.get("tracking") is True


def test_offset_rates_are_refused_where_there_is_no_tracking_to_offset(scope: VirtualTelescope) -> None:
    scope.put("tracking", Tracking="False")
    for rate in ("RightAscensionRate", "DeclinationRate"):
        assert scope.fault_of(rate.lower(), **{rate: 0.1}) is Number.INVALID_OPERATION
        assert scope.fault_of(rate.lower(), **{rate: 0.0}) is Number.OK
    scope.put("tracking", Tracking="True")
    assert scope.fault_of("declinationrate", DeclinationRate=0.1) is Number.OK
    assert scope.get("declinationrate") == pytest.approx(0.1)


def test_tracking_is_not_set_while_something_else_is_under_way(scope: VirtualTelescope) -> None:
    scope.put("moveaxis", Axis=1, Rate=1.0)
    assert scope.fault_of("tracking", Tracking="True") is Number.OK
    assert scope.fault_of("tracking", Tracking="False") is Number.INVALID_OPERATION


def test_the_time_stamp_is_the_instant_at_which_the_values_were_measured(scope: VirtualTelescope) -> None:
    scope.put("moveaxis", Axis=1, Rate=4.0)
    scope.run_for(3.0)
    for _ in range(20):
        scope.run_for(0.0137)
        told = {item["Name"]: item["Value"] for item in scope.get("devicestate")}
        at_s = Utc.parse(told["TimeStamp"]).unix_s
        truth = min(scope.truths, key=lambda one: abs(one.utc_s - at_s))
        # 1 ms is 0.004° here; the stamp has milliseconds.
        assert truth.utc_s == pytest.approx(at_s, abs=0.002)
        assert truth.dec_deg == pytest.approx(told["Declination"], abs=0.001)


def test_home_is_found_and_left(scope: VirtualTelescope) -> None:
    assert scope.get("athome") is False
    scope.put("findhome")
    assert scope.get("slewing") is True
    scope.wait_while("slewing")
    assert scope.get("athome") is True
    assert scope.truths[-1].dec_deg == pytest.approx(40.0, abs=0.01)
    scope.put("moveaxis", Axis=1, Rate=1.0)
    assert scope.get("athome") is False
    scope.run_for(1.0)
    scope.put("moveaxis", Axis=1, Rate=0)
    assert scope.get("athome") is False


def test_a_parked_mount_refuses_everything_that_moves_it(scope: VirtualTelescope) -> None:
    scope.put("park")
    assert scope.get("atpark") is False
    assert scope.get("slewing") is True
    scope.wait_while("slewing")
    assert scope.get("atpark") is True
    assert scope.get("tracking") is False
    assert scope.truths[-1].dec_deg == pytest.approx(60.0, abs=0.01)
    ra_h = scope.get("rightascension")
    refused: list[tuple[str, dict[str, Any]]] = [
        ("abortslew", {}),
        ("findhome", {}),
        ("moveaxis", {"Axis": 0, "Rate": 1.0}),
        ("moveaxis", {"Axis": 0, "Rate": 0.0}),
        ("pulseguide", {"Direction": 0, "Duration": 100}),
        ("slewtocoordinates", {"RightAscension": ra_h, "Declination": 60.0}),
        ("slewtocoordinatesasync", {"RightAscension": ra_h, "Declination": 60.0}),
        ("slewtotarget", {}),
        ("slewtotargetasync", {}),
        ("synctocoordinates", {"RightAscension": ra_h, "Declination": 60.0}),
        ("synctotarget", {}),
        ("rightascensionrate", {"RightAscensionRate": 0.1}),
        ("declinationrate", {"DeclinationRate": 0.1}),
    ]
    for member, parameters in refused:
        assert scope.fault_of(member, **parameters) is PARKED, member
    assert scope.put("park") is None
    assert scope.fault_of("unpark") is NOT_IMPLEMENTED
    stands = scope.truths[-1].dec_deg
    scope.run_for(30.0)
    assert scope.get("atpark") is True
    assert scope.truths[-1].dec_deg == stands


def test_a_mount_without_a_park_or_home_position_says_so() -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, park=None, home=None))
    assert scope.get("canpark") is False
    assert scope.get("canfindhome") is False
    assert scope.fault_of("park") is NOT_IMPLEMENTED
    assert scope.fault_of("findhome") is NOT_IMPLEMENTED
    assert scope.get("athome") is False
    assert scope.get("atpark") is False


@pytest.mark.parametrize(
    ("rule", "hour_angle_h", "side"),
    [
        ("never", 2.0, 0),
        ("never", -2.0, 0),
        ("hour_angle", 2.0, 1),
        ("hour_angle", -2.0, 0),
        # pierEast, 0, looks west, and pierWest, 1, east.
        ("ascom", 2.0, 0),
        ("ascom", -2.0, 1),
    ],
)
def test_the_side_of_the_pier_at_a_destination_is_by_the_profiles_rule(
    rule: str, hour_angle_h: float, side: int
) -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, pier_rule=rule))
    ra_h = (scope.get("siderealtime") - hour_angle_h) % 24.0
    assert scope.get("destinationsideofpier", RightAscension=ra_h, Declination=20.0) == side
    assert scope.get("alignmentmode") == (1 if rule == "never" else 2)
    for ra, dec in ((-1.0, 0.0), (25.0, 0.0), (1.0, 91.0), (1.0, -91.0)):
        assert scope.get_fault("destinationsideofpier", RightAscension=ra, Declination=dec) is INVALID


def test_what_is_under_way_is_not_mixed_with_something_else(scope: VirtualTelescope) -> None:
    ra_h = (scope.get("siderealtime") + 3.0) % 24.0
    scope.put("slewtocoordinatesasync", RightAscension=ra_h, Declination=60.0)
    refused: list[tuple[str, dict[str, Any]]] = [
        ("moveaxis", {"Axis": 0, "Rate": 1.0}),
        ("pulseguide", {"Direction": 0, "Duration": 100}),
        ("findhome", {}),
        ("synctocoordinates", {"RightAscension": ra_h, "Declination": 60.0}),
        ("rightascensionrate", {"RightAscensionRate": 0.1}),
    ]
    for member, parameters in refused:
        assert scope.fault_of(member, **parameters) is INVALID_OPERATION, member
    scope.wait_while("slewing")
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1.0 / 3600.0)


def test_another_slew_takes_the_place_of_the_one_under_way(scope: VirtualTelescope) -> None:
    lst_h = scope.get("siderealtime")
    first = scope.ask("PUT", "slewtocoordinates", RightAscension=(lst_h + 3.0) % 24.0, Declination=60.0)
    number = scope.give(first.order, first.waits)
    scope.run_for(1.0)
    scope.put("slewtocoordinates", RightAscension=(lst_h - 2.0) % 24.0, Declination=30.0)
    answer = scope.answered(number)
    assert answer is not None
    assert answer.fault == Number.CANCELLED
    assert scope.get("declination") == pytest.approx(30.0, abs=0.01)


def test_a_slew_that_cannot_be_does_not_stop_the_one_under_way(scope: VirtualTelescope) -> None:
    lst_h = scope.get("siderealtime")
    scope.put("slewtocoordinatesasync", RightAscension=(lst_h + 3.0) % 24.0, Declination=60.0)
    scope.run_for(1.0)
    low = {"RightAscension": (lst_h + 11.0) % 24.0, "Declination": -30.0}
    assert scope.fault_of("slewtocoordinatesasync", **low) is INVALID_OPERATION
    scope.wait_while("slewing")
    assert scope.get("declination") == pytest.approx(60.0, abs=0.01)


def test_a_slew_below_the_floor_is_refused_before_anything_moves(scope: VirtualTelescope) -> None:
    with pytest.raises(Fault, match="altitude") as raised:
        scope.put(
            "slewtocoordinatesasync",
            RightAscension=(scope.get("siderealtime") + 11.0) % 24.0,
            Declination=-30.0,
        )
    assert raised.value.number is INVALID_OPERATION
    assert scope.get("slewing") is False


def test_a_move_into_a_limit_is_stopped_told_and_made_ready_by_an_abort(scope: VirtualTelescope) -> None:
    scope.put("moveaxis", Axis=1, Rate=-3.0)
    until_s = scope.now_utc_s + 60.0
    while scope.telescope.state is not None and scope.telescope.state.tripped is None:
        assert scope.now_utc_s < until_s
        scope.run_for(0.1)
        assert scope.get_fault("declination") is Number.OK
    scope.run_for(3.0)
    altitude_deg = scope.get("altitude")
    assert altitude_deg > -1.0
    with pytest.raises(Fault, match="limit") as raised:
        scope.get("slewing")
    assert raised.value.number is Number.DRIVER
    assert "Slewing" not in {item["Name"] for item in scope.get("devicestate")}
    assert scope.fault_of("moveaxis", Axis=1, Rate=3.0) is INVALID_OPERATION
    scope.put("abortslew")
    scope.run_for(3.0)
    assert scope.get("slewing") is False
    assert scope.fault_of("moveaxis", Axis=1, Rate=-3.0) is INVALID_OPERATION
    assert scope.fault_of("moveaxis", Axis=1, Rate=3.0) is Number.OK
    scope.run_for(2.0)
    assert scope.get("altitude") > altitude_deg + 2.0


def test_a_mount_that_falls_silent_is_told_of_and_not_made_up(scope: VirtualTelescope) -> None:
    scope.silent_until_s = scope.now_utc_s + 20.0
    scope.run_for(3.0)
    for member in ("rightascension", "slewing", "devicestate", "tracking"):
        assert scope.get_fault(member) is Number.DRIVER, member
    assert scope.fault_of("moveaxis", Axis=0, Rate=1.0) is not Number.OK
    scope.run_for(20.0)
    assert scope.get("tracking") is True

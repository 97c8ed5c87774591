"""Requests that safety lets through, motions of a mount that nobody knows, and why a mount does not obey.

Statuses are written out here: what a mount makes of a command is the test's own arithmetic.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import erfa
import pytest
from driven_limits import SUN_DEC, SUN_WEST_HA, moon_place
from msgspec.structs import replace
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, PERIOD_S, T0

from sattrack.core.angles import separation_deg
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxesPosition,
    Hold,
    MountProfile,
    MoveAxes,
    PierZone,
    Seen,
    SitePlace,
    Slew,
    Stance,
    Stop,
)
from sattrack.mount.requests import (
    Abort,
    ClearedRequest,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Sync,
)
from sattrack.safety import Safety, SafetyLimits
from sattrack.safety.probe import ProbeSafety

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import Motion
    from sattrack.mount.requests import Request

PROFILE = MountProfile()
DARK = SafetyLimits(optical=False, floor_altitude_deg=20.0)
DAY = SafetyLimits(floor_altitude_deg=20.0)
SIDEREAL_DEG = 100.0
SOUTH_DEG = -(90.0 - LATITUDE_DEG)
"""Declination of the horizon on the meridian: so much less than an altitude there."""


def stance(hour_angle_deg: float, dec_deg: float, slewing: bool = False, at_rest: bool = True) -> Stance:
    return Stance(SIDEREAL_DEG, (SIDEREAL_DEG - hour_angle_deg) % 360.0, dec_deg, slewing, at_rest)


def answer(
    request: Request, at: Stance | None, limits: SafetyLimits = DARK, profile: MountProfile = PROFILE
) -> str | None:
    """Return why safety refuses a request, or None."""
    found = Safety(profile, limits, LATITUDE_DEG, LONGITUDE_DEG).clear_request(request, at, T0)
    return None if found == ClearedRequest(request) else str(found)


HIGH, LOW = stance(0.0, 30.0), stance(0.0, SOUTH_DEG + 20.5)
EAST, WEST = stance(-81.98, 20.0), stance(81.98, 20.0)
"""Half a degree above the floor too; the sky goes up in the east and down in the west."""
UP = SIDEREAL_RATE_DEG_S
HILL = ((0.0, 30.0), (90.0, 5.0), (180.0, 5.0), (270.0, 5.0))


@pytest.mark.parametrize(
    ("request_", "at", "words"),
    [
        (Sync(SIDEREAL_DEG, SOUTH_DEG + 19.0), HIGH, "at 19.0° altitude; the limit is 20°"),
        (Sync(SIDEREAL_DEG, SOUTH_DEG + 21.0), HIGH, None),
        (Slew(SIDEREAL_DEG, SOUTH_DEG + 19.0), HIGH, "at 19.0° altitude; the limit is 20°"),
        (Slew(SIDEREAL_DEG, SOUTH_DEG + 25.0), HIGH, None),
        (MoveAxis(None, -1.0), LOW, "stands at its altitude limit"),
        (MoveAxis(None, 1.0), LOW, None),
        (MoveAxis(None, -1.0), HIGH, None),
        (PulseGuide(0, -200_000), LOW, "past the altitude limit"),
        (PulseGuide(0, 200_000), LOW, None),
        (PulseGuide(0, -200_000), HIGH, None),
        (PulseGuide(400_000, 0), EAST, None),
        (PulseGuide(400_000, 0), WEST, "past the altitude limit"),
        (FineRate(0.0, -0.02), LOW, "past the altitude limit"),
        (FineRate(0.0, 0.02), LOW, None),
        (FineRate(0.0, -0.02), HIGH, None),
        (FineRate(0.0, 0.0), WEST, None),
        (FineRate(0.04, 0.0), WEST, "past the altitude limit"),
        (FineRate(0.04, 0.0), EAST, None),
        (FindHome(), stance(0.0, 30.0, slewing=True), "the mount is slewing"),
        (FindHome(), HIGH, None),
        (Slew(SIDEREAL_DEG, 40.0), None, "has not been heard yet"),
        (Park(), HIGH, "park"),
    ],
    ids=repr,
)
def test_a_request_past_the_floor_is_refused_and_one_away_from_it_is_not(
    request_: Request, at: Stance | None, words: str | None
) -> None:
    found = answer(request_, at)
    assert (found is None) == (words is None), found
    assert words is None or words in str(found)


def test_an_abort_is_never_refused() -> None:
    safety = Safety(PROFILE, DAY, LATITUDE_DEG, LONGITUDE_DEG)
    safety.clear(MoveAxes(math.nan, 0.0), SIDEREAL_DEG, 0.0, 30.0, 0.0, T0)
    assert safety.tripped is not None
    assert safety.clear_request(Abort(), None, None) == ClearedRequest(Abort())
    assert "safety has stopped the mount" in str(safety.clear_request(MoveAxis(None, 1.0), HIGH, T0))


def test_home_is_looked_for_by_day_only_where_its_way_is_known_to_be_clear() -> None:
    east = stance(-60.0, 40.0)
    assert "no home position" in str(answer(FindHome(), east, DAY))
    assert answer(FindHome(in_daylight=True), east, DAY) is None
    clear, low = (
        replace(PROFILE, home=AxesPosition(-30.0, 50.0)),
        replace(PROFILE, home=AxesPosition(0.0, SOUTH_DEG)),
    )
    assert answer(FindHome(), east, DAY, clear) is None
    assert "the way home is not clear of the altitude limit" in str(answer(FindHome(), east, DAY, low))
    # The way there leads through the Sun.
    beyond = replace(PROFILE, home=AxesPosition(SUN_WEST_HA, SUN_DEC + 20.0))
    assert "not clear of the sun" in str(answer(FindHome(), stance(SUN_WEST_HA - 25.0, SUN_DEC), DAY, beyond))


@pytest.mark.parametrize(("rule", "struck"), [("never", False), ("hour_angle", True)])
def test_the_way_home_is_that_of_the_side_of_the_pier_on_which_home_is(rule: str, struck: bool) -> None:
    tripod = PierZone("tripod", ((75.0, 75.0), (85.0, 75.0), (85.0, 85.0), (75.0, 85.0)), "beyond_pole")
    profile = MountProfile(home=AxesPosition(40.0, 20.0), pier_rule=rule, pier_zones=(tripod,))  # type: ignore[arg-type]
    limits = SafetyLimits(optical=False, floor_altitude_deg=-90.0)
    refused = answer(FindHome(), stance(-60.0, 40.0), limits, profile)
    assert refused == ("the way home is not clear of the pier limit" if struck else None)


def test_without_a_place_on_earth_nothing_that_moves_optics_is_let_through() -> None:
    for request, moves in (
        (Slew(SIDEREAL_DEG, 40.0), True),
        (MoveAxis(None, 1.0), True),
        (FindHome(), True),
        (FineRate(0.0, 0.0), True),
        (PulseGuide(100, 0), True),
        (Sync(SIDEREAL_DEG, 40.0), False),
    ):
        safety = Safety(PROFILE, DAY, LATITUDE_DEG)
        found = safety.clear_request(request, HIGH, T0)
        assert ("the Sun's direction is unknown without a site" in str(found)) == moves
    assert "the Sun's direction is unknown without a site" in str(safety.path_to(Slew(0.0, 40.0), HIGH, T0))
    assert safety.drift_objection(FineRate(0.0, 0.0), HIGH, T0) == "sun"


@pytest.mark.parametrize("off_s", [70.0, -70.0])
def test_while_the_clocks_are_apart_no_request_that_moves_is_let_through_and_it_is_told_how_far(
    off_s: float,
) -> None:
    """Of both clocks; what does not move is let through."""
    safety = Safety(PROFILE, replace(DARK, clock_tolerance_s=60.0), LATITUDE_DEG, LONGITUDE_DEG)
    right_deg = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    safety.watch(Seen(T0, right_deg + off_s * SIDEREAL_RATE_DEG_S, 0.0, 40.0), Hold())
    words = "sidereal clock is 70 s off this computer's, more than clock_tolerance_s, 60"
    for request in (Slew(SIDEREAL_DEG, 40.0), MoveAxis(None, 1.0), FindHome(), FineRate(0.0, 0.0)):
        assert words in str(safety.clear_request(request, HIGH, T0))
    assert words in str(safety.path_to(Slew(SIDEREAL_DEG, 40.0), HIGH, T0))
    sync = Sync(SIDEREAL_DEG, 40.0)
    assert safety.clear_request(sync, HIGH, T0) == ClearedRequest(sync)


def test_the_path_of_a_slew_is_told_leg_by_leg_or_why_there_is_none() -> None:
    safety = Safety(PROFILE, DARK, LATITUDE_DEG, LONGITUDE_DEG)
    target = Slew(SIDEREAL_DEG + 320.0, 40.0)
    assert safety.path_to(target, HIGH, T0) == (Slew(SIDEREAL_DEG - 40.0, 40.0),)
    low = Slew(SIDEREAL_DEG, SOUTH_DEG + 19.0)
    assert "at 19.0° altitude; the limit is 20°" in str(safety.path_to(low, HIGH, T0))
    close = Slew(SIDEREAL_DEG, SOUTH_DEG + 20.15)
    assert safety.path_to(close, HIGH, T0) == (
        "that direction is 0.15° from the altitude limit (floor_altitude_deg): too close for a slew that may "
        "be stopped before its end"
    )


def test_of_a_way_that_a_wall_closes_the_wall_is_named() -> None:
    wall = PierZone("wall", ((-210.0, 0.0), (210.0, 0.0), (210.0, 10.0), (-210.0, 10.0)))
    safety = Safety(replace(PROFILE, pier_zones=(wall,)), DARK, LATITUDE_DEG, LONGITUDE_DEG)
    found = str(safety.path_to(Slew(SIDEREAL_DEG, -10.0), HIGH, T0))
    assert found.startswith("no way to there keeps clear of the pier limit")


def test_a_mount_stands_for_its_park_position_before_its_power_is_cut() -> None:
    parks = replace(PROFILE, park=AxesPosition(10.0, 60.0))
    assert answer(Park(), stance(10.0, 60.0), profile=parks) is None
    assert "moves" in str(answer(Park(), stance(10.0, 60.0, at_rest=False), profile=parks))
    assert "3.00° away" in str(answer(Park(), stance(13.0, 60.0), profile=parks))


# A mount of which nothing is known moves within a circle of 3°, of which it may use 2°.


def probe(limits: SafetyLimits = DARK, profile: MountProfile = PROFILE) -> ProbeSafety:
    return ProbeSafety(profile, limits, (LATITUDE_DEG, LONGITUDE_DEG), 2.0, 1.0)


def probed(safety: ProbeSafety, hour_angle_deg: float, dec_deg: float, age_s: float = 0.0) -> str | None:
    """Move a little at a place; return why safety stops that, or None."""
    motion = MoveAxes(0.1, 0.1)
    found = safety.clear(motion, SIDEREAL_DEG, SIDEREAL_DEG - hour_angle_deg, dec_deg, age_s, T0).motion
    assert found == (motion if safety.tripped is None else Stop())
    return safety.tripped


@pytest.mark.parametrize(
    ("limits", "hour_angle_deg", "dec_deg", "wanted"),
    [
        (DARK, 0.0, SOUTH_DEG + 23.1, None),
        (DARK, 0.0, SOUTH_DEG + 22.9, "altitude"),
        (replace(DARK, horizon=HILL), 0.0, SOUTH_DEG + 32.9, "horizon"),
        (replace(DARK, horizon=HILL), 0.0, SOUTH_DEG + 33.1, None),
        (DAY, SUN_WEST_HA, SUN_DEC + 18.1, None),
        (DAY, SUN_WEST_HA, SUN_DEC + 17.9, "sun"),
        (DARK, SUN_WEST_HA, SUN_DEC + 17.9, None),
    ],
)
def test_the_circle_of_a_mount_that_nobody_knows_is_clear_beforehand(
    limits: SafetyLimits, hour_angle_deg: float, dec_deg: float, wanted: str | None
) -> None:
    assert probed(probe(limits), hour_angle_deg, dec_deg) == wanted


def test_a_mount_that_nobody_knows_stops_where_it_leaves_its_circle_and_stays_stopped() -> None:
    safety = probe()
    assert probed(safety, 0.0, 40.0) is None
    assert probed(safety, 0.0, 41.9) is None
    assert probed(safety, 2.5, 40.0) is None, "2.5° of hour angle are 1.9° on the sky at 40°"
    assert probed(safety, 0.0, 42.1) == "obedience"
    assert probed(safety, 0.0, 40.0) == "obedience"


@pytest.mark.parametrize(
    ("dec_deg", "age_s", "wanted"),
    [(math.nan, 0.0, "command"), (40.0, math.nan, "command"), (40.0, 2.1, "status_age"), (40.0, 1.9, None)],
)
def test_a_mount_that_nobody_knows_is_not_moved_blindly(
    dec_deg: float, age_s: float, wanted: str | None
) -> None:
    assert probed(probe(), 0.0, dec_deg, age_s) == wanted


def test_a_mount_that_nobody_knows_is_not_moved_while_its_clock_is_off() -> None:
    safety, right_deg = probe(), math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    safety.watch(Seen(T0, right_deg + 1.0, 0.0, 40.0), Hold())
    assert safety.tripped is None
    assert probed(safety, 0.0, 40.0) == "clock"


def test_a_mount_that_nobody_knows_rests_or_is_moved_and_never_slews() -> None:
    safety = probe()
    at = (SIDEREAL_DEG, SIDEREAL_DEG, 40.0, 0.0, T0)
    assert safety.clear(Hold(), *at).motion == Hold()
    assert safety.clear(Slew(10.0, 20.0), *at).motion == Stop()
    assert safety.clear(Stop(), *at).motion == Stop()
    assert safety.tripped is None


# With a camera, fields tell where it is, and what it reports may mean anything.


def seen_probe(limits: SafetyLimits = DARK) -> ProbeSafety:
    return ProbeSafety(PROFILE, limits, (LATITUDE_DEG, LONGITUDE_DEG), 12.0, 1.0, 6.0)


def test_a_mount_whose_field_nobody_has_seen_is_not_moved() -> None:
    assert probed(seen_probe(), 0.0, 40.0) == "command"


@pytest.mark.parametrize(
    ("looks_dec_deg", "reports_dec_deg", "wanted"),
    [(40.0, SOUTH_DEG - 40.0, None), (SOUTH_DEG + 25.0, 40.0, "altitude")],
)
def test_the_circle_is_about_the_field_and_not_about_what_is_reported(
    looks_dec_deg: float, reports_dec_deg: float, wanted: str | None
) -> None:
    safety = seen_probe()
    safety.see_field((0.0, looks_dec_deg), (0.0, reports_dec_deg))
    assert probed(safety, 0.0, reports_dec_deg) == wanted


def test_until_fields_tell_more_reported_angles_are_taken_for_those_of_axes() -> None:
    for shown, wanted in ((False, "obedience"), (True, None)):
        safety = seen_probe()
        safety.see_field((0.0, 79.0), (0.0, 79.0))
        if shown:
            safety.see_field((5.0, 79.0), (5.0, 79.0))
            safety.see_field((5.0, 80.0), (5.0, 80.0))
        begin = (5.0, 80.0) if shown else (0.0, 79.0)
        assert probed(safety, *begin) is None
        assert probed(safety, begin[0] + 7.0, begin[1]) == wanted, "7° of an axis, 1.2° of a direction"


def test_fields_beyond_the_circle_stop_a_mount_whatever_it_reports() -> None:
    safety = seen_probe()
    safety.see_field((0.0, 40.0), (0.0, 40.0))
    safety.see_field((0.0, 53.0), (0.0, 41.0))
    assert probed(safety, 0.0, 41.0) == "obedience"


def test_drives_that_are_overloaded_stop_a_mount_that_nobody_knows_while_it_is_moved() -> None:
    for commanded, wanted in ((MoveAxes(0.1, 0.0), "current"), (Hold(), None)):
        safety = probe(profile=replace(PROFILE, ra=replace(PROFILE.ra, max_current_a=2.0)))
        for k in range(40):
            sidereal_deg = SIDEREAL_DEG + k * PERIOD_S * SIDEREAL_RATE_DEG_S
            safety.watch(Seen(None, sidereal_deg, 0.0, 40.0, ra_current_a=3.0), commanded)
        assert safety.tripped == wanted


# What comes of a command, and what safety makes of it. Rates are those of the axes, hour angle first.


def watched(
    profile: MountProfile,
    comes_out: Callable[[float, float], tuple[float, float]],
    seconds: float = 15.0,
    asked: Callable[[float], tuple[float, float]] = lambda t: (
        0.6 * math.cos(0.3 * t),
        0.5 * math.sin(0.4 * t + 0.5),
    ),
) -> Safety:
    """Let a mount make something of commanded rates, until safety stops it."""
    safety = Safety(profile, SafetyLimits(optical=False, floor_altitude_deg=-10.0), LATITUDE_DEG)
    ha, dec = 5.0, 30.0
    for k in range(round(seconds / PERIOD_S)):
        sidereal_deg = SIDEREAL_DEG + k * PERIOD_S * SIDEREAL_RATE_DEG_S
        wish = asked(k * PERIOD_S)
        safety.watch(
            Seen(None, sidereal_deg, (sidereal_deg - ha) % 360.0, dec),
            MoveAxes(SIDEREAL_RATE_DEG_S - wish[0], wish[1]),
        )
        if safety.tripped is not None:
            break
        rates = comes_out(*wish)
        ha, dec = ha + rates[0] * PERIOD_S, dec + rates[1] * PERIOD_S
    return safety


AZIMUTH_MOUNT = replace(
    PROFILE, geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG)
)


def turned(angle_deg: float) -> Callable[[float, float], tuple[float, float]]:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return lambda first, second: (c * first - s * second, s * first + c * second)


@pytest.mark.parametrize("profile", [PROFILE, AZIMUTH_MOUNT], ids=["equatorial", "azimuth"])
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
def test_a_mount_that_does_as_it_is_told_is_let_go_on(profile: MountProfile, gain: float) -> None:
    assert watched(profile, lambda first, second: (gain * first, second / gain)).tripped is None


def to_and_fro(t: float) -> tuple[float, float]:
    return 0.3 * math.sin(0.6 * t), 0.3 * math.sin(1.1 * t)


@pytest.mark.parametrize("angle_deg", [-45.0, -35.0, -25.0, 25.0, 35.0, 45.0])
def test_a_mount_whose_axes_lie_elsewhere_is_stopped_and_told_so(angle_deg: float) -> None:
    # Each axis alone does about as it should: only both together show it.
    assert watched(PROFILE, turned(angle_deg), 20.0, to_and_fro).tripped is None
    safety = watched(AZIMUTH_MOUNT, turned(angle_deg), 20.0, to_and_fro)
    assert safety.tripped == "obedience"
    assert "the axes do not lie as the geometry in the profile says" in str(safety.cause)


@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ((-1.0, 1.0), "other sign in the first axis: turn ra_rate_sign"),
        ((1.0, -1.0), "other sign in the second axis: turn dec_rate_sign"),
    ],
)
def test_the_axis_of_an_azimuth_mount_that_turns_the_other_way_is_named(
    signs: tuple[float, float], words: str
) -> None:
    safety = watched(AZIMUTH_MOUNT, lambda first, second: (signs[0] * first, signs[1] * second))
    assert safety.tripped == "obedience"
    assert words in str(safety.cause)


@pytest.mark.parametrize(
    ("comes_out", "words"),
    [
        (lambda ha, dec: (-ha, dec), "other sign in right ascension: turn ra_rate_sign in the profile"),
        (lambda ha, dec: (ha, -dec), "other sign in declination: turn dec_rate_sign in the profile"),
        (lambda ha, _: (ha, 0.0), "declination does not move as commanded"),
        (lambda _, dec: (SIDEREAL_RATE_DEG_S, dec), "right ascension does not move as commanded"),
        (
            lambda *_: (SIDEREAL_RATE_DEG_S, 0.0),
            "move_axis is edge, and the profile says held, or the drives",
        ),
    ],
    ids=["ra turned", "dec turned", "dec stands", "ra stands", "both stand"],
)
def test_why_an_equatorial_mount_does_not_obey_is_told(
    comes_out: Callable[[float, float], tuple[float, float]], words: str
) -> None:
    safety = watched(
        PROFILE, comes_out, asked=lambda t: (0.8 + 0.2 * math.sin(t), 0.8 - 0.2 * math.cos(0.7 * t))
    )
    assert safety.tripped == "obedience"
    assert words in str(safety.cause)


def test_a_mount_that_keeps_the_first_rates_is_known_by_it() -> None:
    first: list[tuple[float, float]] = []

    def keeps(ha: float, dec: float) -> tuple[float, float]:
        first.append((ha, dec))
        return first[0]

    safety = watched(PROFILE, keeps)
    assert safety.tripped == "obedience"
    assert safety.keeps_first
    assert "go on at the rates that the mount took first" in str(safety.cause)


def test_of_a_mount_that_runs_away_nothing_is_told_that_is_not_known() -> None:
    safety = watched(PROFILE, lambda ha, dec: (ha + 3.0, dec), 5.0)
    assert safety.tripped == "obedience"
    assert safety.cause is None


def led(safety: Safety, target: tuple[float, float], start: tuple[float, float]) -> list[tuple[float, float]]:
    """Let rates lead axes that obey at once to a place; return where they were, once a period."""
    places = [start]
    slew = Slew((SIDEREAL_DEG - target[0]) % 360.0, target[1])
    for k in range(round(150.0 / PERIOD_S)):
        sidereal_deg = SIDEREAL_DEG + k * PERIOD_S * SIDEREAL_RATE_DEG_S
        ha, dec = places[-1]
        at = (sidereal_deg, (sidereal_deg - ha) % 360.0, dec)
        safety.watch(Seen(None, *at), Hold())
        motion = safety.clear(slew, *at, 0.0, T0).motion
        assert isinstance(motion, MoveAxes)
        places.append(
            (
                ha + (SIDEREAL_RATE_DEG_S - motion.ra_rate_deg_s) * PERIOD_S,
                dec + motion.dec_rate_deg_s * PERIOD_S,
            )
        )
        if safety.led_there:
            return places
    raise AssertionError(f"it has come to {places[-1]}")


@pytest.mark.parametrize("move_axis", ["held", "edge"])
def test_rates_lead_a_mount_with_a_geometry_to_its_goal_as_fast_as_its_drives_may(move_axis: str) -> None:
    profile = replace(AZIMUTH_MOUNT, move_axis=move_axis)
    safety = Safety(profile, DARK, LATITUDE_DEG, LONGITUDE_DEG)
    places = led(safety, (60.0, 50.0), (-20.0, 30.0))
    drift_deg = SIDEREAL_RATE_DEG_S * PERIOD_S * len(places)
    assert abs(places[-1][0] - 60.0) <= 0.2 + drift_deg
    assert abs(places[-1][1] - 50.0) <= 0.2
    for axis, limits in ((0, profile.ra), (1, profile.dec)):
        rates = [(b[axis] - a[axis]) / PERIOD_S for a, b in pairwise(places)]
        fastest = min(limits.slew_rate_deg_s, limits.max_rate_deg_s)
        assert max(map(abs, rates)) <= fastest + 1e-9
        steps = [abs(b - a) for a, b in pairwise([0.0, *rates])]
        assert max(steps) <= limits.max_acceleration_deg_s2 * PERIOD_S + 1e-9
        assert min(rates) >= -0.01, "it does not turn back"
        if axis == 0 and move_axis == "held":
            assert max(rates) > 0.95 * fastest


@pytest.mark.parametrize(
    ("comes_out", "words"),
    [
        (lambda one, other: (-one, other), "other sign in the first axis"),
        (lambda one, other: (one, -other), "other sign in the second axis"),
    ],
    ids=["first", "second"],
)
def test_why_a_mount_leaves_the_way_that_rates_lead_it_is_told(
    comes_out: Callable[[float, float], tuple[float, float]], words: str
) -> None:
    """When it is 6° astray, commands may still have been lost for all that its rates tell."""
    profile = replace(AZIMUTH_MOUNT, hour_angle_limit_deg=360.0)
    safety = Safety(profile, replace(DARK, longest_fault_s=9.0), LATITUDE_DEG, LONGITUDE_DEG)
    slew, (ha, dec) = Slew((SIDEREAL_DEG - 60.0) % 360.0, 70.0), (20.0, 50.0)
    motion: Motion = Hold()
    for k in range(60):
        sidereal_deg = SIDEREAL_DEG + k * PERIOD_S * SIDEREAL_RATE_DEG_S
        at = (sidereal_deg, (sidereal_deg - ha) % 360.0, dec)
        safety.watch(Seen(None, *at, slewing=True), motion)
        motion = safety.clear(slew, *at, 0.0, T0).motion
        if isinstance(motion, MoveAxes):
            rates = comes_out(SIDEREAL_RATE_DEG_S - motion.ra_rate_deg_s, motion.dec_rate_deg_s)
            ha, dec = ha + rates[0] * PERIOD_S, dec + rates[1] * PERIOD_S
    assert safety.tripped == "obedience"
    assert words in str(safety.cause)


@pytest.mark.parametrize("move_axis", ["held", "edge"])
@pytest.mark.parametrize("beside_deg", [0.15, 0.3, 1.0])
def test_rates_lead_slower_to_a_goal_beside_a_limit_so_that_a_fault_leads_past_none(
    beside_deg: float, move_axis: str
) -> None:
    profile = replace(AZIMUTH_MOUNT, move_axis=move_axis, dec_axis_limits_deg=(-10.0, 50.0))
    safety = Safety(profile, DARK, LATITUDE_DEG, LONGITUDE_DEG)
    places = led(safety, (10.0, 50.0 - beside_deg), (-20.0, 30.0))
    assert places[-1][1] == pytest.approx(50.0 - beside_deg, abs=0.1)
    for (_, one), (_, other) in pairwise(places):
        # From the rate that it has, a second and the latency until a stop acts; and it brakes.
        rate_deg_s = (other - one) / PERIOD_S
        assert one + rate_deg_s * 1.2 + rate_deg_s**2 / 16.0 <= 50.0


def test_a_mount_with_a_geometry_slews_by_rates_alone() -> None:
    assert "led by rates" in str(answer(Slew(SIDEREAL_DEG, 50.0), HIGH, DARK, AZIMUTH_MOUNT))


@pytest.mark.parametrize(
    ("onward_deg", "turns_to"),
    [(None, 150.0), ((0.0, 20.0), 150.0), ((0.0, 100.0), -210.0), ((-100.0, 0.0), 150.0)],
)
def test_the_turn_of_the_axis_is_chosen_on_which_the_pass_can_go_on(
    onward_deg: tuple[float, float] | None, turns_to: float
) -> None:
    profile = replace(AZIMUTH_MOUNT, hour_angle_limit_deg=240.0)
    safety = Safety(profile, DARK, LATITUDE_DEG, LONGITUDE_DEG)
    safety.choose_turn(onward_deg)
    assert led(safety, (150.0, 50.0), (-20.0, 50.0))[-1][0] == pytest.approx(turns_to, abs=1.0)


@pytest.mark.parametrize(
    ("cone_deg", "off_deg", "refused"),
    [(6.0, 0.0, True), (6.0, 4.0, True), (6.0, 9.0, False), (0.0, 0.0, False)],
)
def test_the_moon_is_kept_off_where_that_is_asked_for(cone_deg: float, off_deg: float, refused: bool) -> None:
    by_night_s = T0 + 6.0 * 3600.0
    hour_angle_deg, dec_deg = moon_place(by_night_s)
    safety = Safety(PROFILE, SafetyLimits(moon_cone_deg=cone_deg), LATITUDE_DEG, LONGITUDE_DEG)
    slew = Slew((SIDEREAL_DEG - hour_angle_deg) % 360.0, dec_deg + off_deg)
    found = safety.clear_request(slew, stance(hour_angle_deg + 1.0, dec_deg + 40.0), by_night_s)
    assert isinstance(found, str) == refused
    assert not refused or "keeps clear of the moon limit" in str(found)


@pytest.mark.parametrize(
    ("off_deg", "escapes", "leaves"), [(5.0, True, True), (5.0, False, False), (18.0, True, False)]
)
def test_an_idle_telescope_in_the_sun_is_led_out_where_it_is_ours_to_move(
    off_deg: float, escapes: bool, leaves: bool
) -> None:
    safety = Safety(PROFILE, DAY, LATITUDE_DEG, LONGITUDE_DEG, True, escapes)
    sidereal_deg = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    ra_deg, dec_deg = sidereal_deg - SUN_WEST_HA, SUN_DEC + off_deg
    safety.watch(Seen(T0, sidereal_deg, ra_deg, dec_deg), Hold())
    found = safety.clear(Hold(), sidereal_deg, ra_deg, dec_deg, 0.0, T0).motion
    assert isinstance(found, Slew) == leaves
    if isinstance(found, Slew):
        from_sun = separation_deg(sidereal_deg - found.ra_deg, found.dec_deg, SUN_WEST_HA, SUN_DEC)
        assert 15.0 < from_sun < 20.0, "out of the cone, by the nearest way"
        # It is asked for until the mount is there, and not any more then.
        assert safety.clear(Hold(), sidereal_deg, ra_deg, dec_deg, 0.0, T0).motion == found
        safety.watch(Seen(T0 + 1.0, sidereal_deg, found.ra_deg, found.dec_deg), Hold())
        assert safety.clear(Hold(), sidereal_deg, found.ra_deg, found.dec_deg, 0.0, T0).motion == Hold()


def least_distance_deg(axis: int, sense: float, again_after_s: float) -> float:
    """Return how near to the end of its travel an axis may be sent towards it, at last by a status so old."""
    profile = replace(PROFILE, hour_angle_limit_deg=100.0, dec_axis_limits_deg=(-20.0, 80.0))
    wish = MoveAxes(SIDEREAL_RATE_DEG_S - 4.0 * sense, 0.0) if axis == 0 else MoveAxes(UP, 4.0 * sense)
    end_deg = (100.0 * sense, 30.0 + 50.0 * sense)[axis]
    for steps in range(8, 120):
        at_deg = end_deg - sense * 0.25 * steps
        ha, dec = (at_deg, 60.0) if axis == 0 else (0.0, at_deg)
        safety = Safety(
            profile, SafetyLimits(optical=False, floor_altitude_deg=-80.0), LATITUDE_DEG, holds=False
        )
        at = (SIDEREAL_DEG, SIDEREAL_DEG - ha, dec)
        for k in range(3):
            safety.watch(Seen(T0 + 0.05 * k, *at), Hold())
        for k in range(2, 20):
            cleared = safety.clear(wish, *at, 0.0, T0 + 0.05 * k).motion
        if again_after_s:
            cleared = safety.clear(wish, *at, again_after_s, T0 + 0.95 + again_after_s).motion
        if cleared == wish:
            return 0.25 * steps
    raise AssertionError("it is never let through")


@pytest.mark.parametrize("sense", [-1.0, 1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_what_was_sent_since_the_last_status_counts_as_motion(axis: int, sense: float) -> None:
    fresh, old = (least_distance_deg(axis, sense, again_after_s) for again_after_s in (0.0, 0.5))
    assert old - fresh == pytest.approx(0.5 * 4.0, abs=0.6)

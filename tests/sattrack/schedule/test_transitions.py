"""Times between passes: slews as the safety gate reckons them, actions, and the places of stars."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import erfa
import numpy as np
import pytest
from msgspec.structs import replace

from sattrack.mount.model import AxesPosition, AxisLimits, MountProfile
from sattrack.safety.geometry import Place
from sattrack.safety.limits import SafetyLimits
from sattrack.safety.route import HANDSHAKE_S, RAMP, slew_s
from sattrack.schedule.candidates import PlanSituation
from sattrack.schedule.schema import (
    STARS,
    CommandAction,
    SearchAction,
    SlewAction,
    StarCoordinates,
    WebhookAction,
)
from sattrack.schedule.transitions import (
    ActionCost,
    Overhead,
    RoutedSlews,
    SlewTransitions,
    cost_after,
    cost_before,
    first_slew_s,
    hour_angle_and_dec_deg,
    place_of,
    slew_of,
)
from tle.instants import Utc
from tle.site import Site

LEIDEN = Site(52.1541, 4.4908, 0.0)
MOUNT = MountProfile(
    ra=AxisLimits(slew_rate_deg_s=4.0, max_acceleration_deg_s2=2.0), dec=AxisLimits(slew_rate_deg_s=7.0)
)
NOW_UTC_S = float(Utc.parse("2026-10-02T20:00:00Z").unix_s)


def test_slews_take_as_long_as_the_gate_says() -> None:
    rng = np.random.default_rng(7)
    overheads = []
    for _ in range(20):
        first, last = (Place(*rng.uniform(-180.0, 180.0, 2).tolist()) for _ in range(2))
        before = ActionCost(first, float(rng.uniform(0.0, 60.0)), first)
        overheads.append(Overhead(before, float(rng.uniform(0.0, 9.0)), ActionCost(last, 30.0, last)))
    transitions = SlewTransitions.of(overheads, MOUNT)
    for after, there in enumerate(overheads):
        seconds = transitions.seconds(np.arange(20), after)
        for k, here in enumerate(overheads):
            slew = slew_s(here.after.last, there.before.first, MOUNT)
            assert seconds[k] == pytest.approx(30.0 + slew + there.before.seconds + there.settle_s)


def test_actions_before_a_pass_take_their_slews_waits_and_commands() -> None:
    start = Place(10.0, 20.0)
    actions = (
        SlewAction(alt_deg=60.0, az_deg=90.0, wait_s=20.0),
        CommandAction(run=("./dome", "open"), timeout_s=45.0),
        CommandAction(run=("./log",), timeout_s=45.0, wait=False),
        WebhookAction(url="https://example.org/x"),
        SearchAction(how="spiral", spacing_deg=0.1, speed_deg_s=0.1),
    )
    found = cost_before(actions, start, NOW_UTC_S, LEIDEN, MOUNT)
    there = place_of(actions[0], NOW_UTC_S, LEIDEN, MOUNT)  # type: ignore[arg-type]
    assert found == ActionCost(there, pytest.approx(65.0 + slew_s(there, start, MOUNT)), start)


def test_actions_after_a_pass_leave_the_mount_where_they_end() -> None:
    end = Place(-40.0, 50.0)
    action = SlewAction(alt_deg=52.1541, az_deg=0.0)
    found = cost_after((action,), end, NOW_UTC_S, LEIDEN, MOUNT)
    assert found.first == end
    # At an altitude of the latitude, north, is the pole.
    assert found.last.dec_deg == pytest.approx(90.0, abs=1e-4)
    assert found.seconds == pytest.approx(slew_s(end, found.last, MOUNT))
    assert cost_after((), end, NOW_UTC_S, LEIDEN, MOUNT) == ActionCost(end, 0.0, end)


@pytest.mark.parametrize(
    ("alt_deg", "az_deg", "hour_angle_deg", "dec_deg"),
    [(37.8459, 180.0, 0.0, 0.0), (90.0, 0.0, 0.0, 52.1541), (0.0, 90.0, -90.0, 0.0), (0.0, 270.0, 90.0, 0.0)],
)
def test_altitude_and_azimuth_are_where_the_sphere_has_them(
    alt_deg: float, az_deg: float, hour_angle_deg: float, dec_deg: float
) -> None:
    place = place_of(SlewAction(alt_deg=alt_deg, az_deg=az_deg), NOW_UTC_S, LEIDEN, MOUNT)
    assert place.dec_deg == pytest.approx(dec_deg, abs=1e-3)
    assert math.remainder(place.ha_deg - hour_angle_deg, 360.0) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("pier_rule", ["never", "hour_angle"])
@pytest.mark.parametrize("az_deg", [30.0, 140.0, 220.0, 330.0])
def test_a_slew_to_an_altitude_and_azimuth_goes_to_the_right_ascension_that_is_there_then(
    pier_rule: Literal["never", "hour_angle"], az_deg: float
) -> None:
    mount = replace(MOUNT, pier_rule=pier_rule)
    slew = slew_of(SlewAction(alt_deg=35.0, az_deg=az_deg), NOW_UTC_S, LEIDEN, mount)
    jd, fraction = 2440587.5 + NOW_UTC_S // 86400.0, NOW_UTC_S % 86400.0 / 86400.0
    hour_angle = erfa.gmst82(jd, fraction) + math.radians(LEIDEN.longitude_deg - slew.ra_deg)
    azimuth, altitude = erfa.hd2ae(hour_angle, math.radians(slew.dec_deg), math.radians(LEIDEN.latitude_deg))
    assert 0.0 <= slew.ra_deg < 360.0
    assert math.degrees(azimuth) == pytest.approx(az_deg, abs=1e-3)
    assert math.degrees(altitude) == pytest.approx(35.0, abs=1e-3)


@pytest.mark.parametrize(
    ("pier_rule", "turns_deg"), [("never", (80.0, 20.0)), ("hour_angle", (100.0, 160.0))]
)
def test_the_first_slew_of_a_night_begins_on_the_side_on_which_the_mount_was_parked(
    pier_rule: Literal["never", "hour_angle"], turns_deg: tuple[float, float]
) -> None:
    """Parked in the west, beyond the pole at -130° and 180° of its axes if it flips, it goes to the east."""
    mount = replace(MOUNT, pier_rule=pier_rule, park=AxesPosition(50.0, 0.0))
    situation = PlanSituation((NOW_UTC_S, NOW_UTC_S + 3600.0), NOW_UTC_S, LEIDEN, mount, SafetyLimits())
    first = Place(-30.0, 20.0)
    overhead = Overhead(ActionCost(first, 0.0, first), 0.0, ActionCost(first, 0.0, first))
    # Each ramp up and down takes RAMP times as long as the axis needs at its best.
    by_axis = (turns_deg[0] / 4.0 + 2.0 * RAMP * 4.0 / 2.0, turns_deg[1] / 7.0 + 2.0 * RAMP * 7.0 / 10.0)
    assert first_slew_s(overhead, situation) == pytest.approx(HANDSHAKE_S + max(by_axis))
    unknown = dataclasses.replace(situation, profile=replace(mount, park=None))
    assert first_slew_s(overhead, unknown) == 0.0


def test_a_slew_whose_box_goes_below_the_horizon_is_led_round_and_takes_longer() -> None:
    mount = MountProfile()
    span = (NOW_UTC_S, NOW_UTC_S + 3600.0)
    led = RoutedSlews(PlanSituation(span, NOW_UTC_S, LEIDEN, mount, SafetyLimits()))
    # Seen from Leiden, hour angle 120° and declination -10° are 28° below the horizon: a corner of this box.
    north_west, south_east = Place(120.0, 60.0), Place(-30.0, -10.0)
    slower_s = led.extra_s(north_west, south_east, NOW_UTC_S)
    # At least another handshake and another ramp up and down, and no way twice over.
    assert slower_s + 1e-9 >= HANDSHAKE_S + 2.0 * RAMP * 10.0 / 10.0
    assert slower_s < slew_s(north_west, south_east, mount)
    assert led.extra_s(Place(10.0, 20.0), Place(-30.0, 40.0), NOW_UTC_S) == 0.0
    fenced = SafetyLimits(floor_altitude_deg=70.0)
    high_only = RoutedSlews(PlanSituation(span, NOW_UTC_S, LEIDEN, mount, fenced))
    assert high_only.extra_s(Place(0.0, 50.0), Place(0.0, 60.0), NOW_UTC_S) == 0.0


def test_a_star_is_where_meeus_has_it() -> None:
    # Theta Persei on 2028 November 13.19 TD: Meeus, Astronomical Algorithms, 2nd ed., example 23.a.
    dec_deg = 49.0 + 13.0 / 60.0 + 42.48 / 3600.0
    star = StarCoordinates(
        15.0 * (2.0 + 44.0 / 60.0 + 11.986 / 3600.0),
        dec_deg,
        0.03425 * 15.0e3 * math.cos(math.radians(dec_deg)),
        -89.5,
    )
    utc_s = float(Utc.parse("2028-11-13T04:33:36Z").unix_s) - 69.184
    hour_angle, dec = hour_angle_and_dec_deg(star, utc_s, 0.0)
    day = 2440587.5 + utc_s / 86400.0
    sidereal_deg = math.degrees(erfa.gst06a(day, 0.0, day + 69.184 / 86400.0, 0.0))
    right_ascension = sidereal_deg - hour_angle
    assert math.remainder(right_ascension - 41.5599646, 360.0) * 3600.0 == pytest.approx(0.0, abs=0.3)
    assert (dec - (49.0 + 21.0 / 60.0 + 7.45 / 3600.0)) * 3600.0 == pytest.approx(0.0, abs=0.3)


def test_stars_known_by_their_places_are_there() -> None:
    # Castor and Pollux are 4.5° apart, Polaris is 0.75° from the pole, Vega passes 13.4° from Leiden's
    # zenith: what observers' handbooks say.
    castor, pollux = STARS["Castor"], STARS["Pollux"]
    apart = math.degrees(
        erfa.seps(*(math.radians(x) for x in (castor.ra_deg, castor.dec_deg, pollux.ra_deg, pollux.dec_deg)))
    )
    assert apart == pytest.approx(4.5, abs=0.05)
    assert 89.25 < STARS["Polaris"].dec_deg < 89.3
    assert LEIDEN.latitude_deg - STARS["Vega"].dec_deg == pytest.approx(13.4, abs=0.05)

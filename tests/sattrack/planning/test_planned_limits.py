"""Margins, cut links, losses and the table against closed forms and the propagator itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from planning_builders import great_circle, path_of

from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import AxisLimits, MountProfile, PierZone, SitePlace
from sattrack.planning.kinematics import Ability, choose_sides, losses, why_not
from sattrack.planning.path import AxisPath, AxisSamples, axis_path, margins_deg
from sattrack.planning.rehearsal import MountPath, link_loss
from sattrack.planning.trace import TabledPropagator
from sattrack.runtime import demo_pass
from sattrack.safety.limits import SafetyLimits
from sattrack.safety.regions import fixed_regions
from sattrack.settings import SafetySettings
from tle.bias import NO_BIAS
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

PASS = (1790946119.0, 1790946528.0)
DARK = SafetyLimits(optical=False)
TOLERANCE_DEG = 2.0 / 3600.0


def pointing(ha: float, dec: float, sun: tuple[float, float] = (180.0, 0.0)) -> AxisSamples:
    one = [np.array([value]) for value in (0.0, ha, dec, *sun, 180.0, 0.0)]
    return AxisSamples(*one)


def ability(profile: MountProfile, limits: SafetyLimits = DARK, latitude_deg: float = 0.0) -> Ability:
    return Ability(profile, limits, latitude_deg, TOLERANCE_DEG)


def test_margins_of_simple_places_are_those_of_the_sphere() -> None:
    limits = SafetyLimits(
        floor_altitude_deg=10.0, horizon=((0.0, 5.0), (90.0, 20.0), (180.0, 5.0), (270.0, 5.0))
    )
    # On the equator an hour angle of -60° on the celestial equator stands 30° high in the east.
    found = margins_deg(pointing(-60.0, 0.0, (-60.0, 40.0)), MountProfile(), limits, 0.0)
    assert found["altitude"][0] == pytest.approx(20.0)
    assert found["horizon"][0] == pytest.approx(10.0)
    assert found["hour_angle"][0] == pytest.approx(140.0)
    assert found["declination"][0] == pytest.approx(190.0)
    assert found["sun"][0] == pytest.approx(25.0)


def test_the_same_direction_from_beyond_the_pole_has_the_same_altitude_and_sun() -> None:
    near = margins_deg(pointing(-60.0, 50.0, (10.0, 20.0)), MountProfile(), SafetyLimits(), 40.0)
    far = margins_deg(pointing(120.0, 130.0, (10.0, 20.0)), MountProfile(), SafetyLimits(), 40.0)
    assert far["altitude"][0] == pytest.approx(near["altitude"][0])
    assert far["sun"][0] == pytest.approx(near["sun"][0])
    assert far["hour_angle"][0] == pytest.approx(80.0)


def test_every_limit_that_holds_the_mount_has_a_margin_by_which_passes_are_judged() -> None:
    """A limit that the gate knows and a rehearsal does not would be found out in the middle of a pass."""
    profile = MountProfile(pier_zones=(PierZone("tripod", ((20.0, 10.0), (40.0, 10.0), (40.0, 30.0))),))
    limits = SafetyLimits(horizon=((0.0, 5.0), (90.0, 5.0), (180.0, 5.0), (270.0, 5.0)), moon_cone_deg=3.0)
    margins = margins_deg(pointing(-60.0, 0.0, (-60.0, 40.0)), profile, limits, 40.0)
    held = {region.name for region in fixed_regions(profile, limits, 40.0, 0.0)}
    assert held | {"sun", "moon"} == set(margins)


def test_a_setting_of_safety_is_a_limit_of_the_same_name() -> None:
    assert set(SafetySettings.__struct_fields__) == set(SafetyLimits.__struct_fields__)
    defaults, built_in = SafetySettings(), SafetyLimits()
    for name in set(SafetyLimits.__struct_fields__) - {"horizon"}:
        assert getattr(defaults, name) == getattr(built_in, name), name


def test_a_pier_zone_counts_on_its_side_and_after_whole_turns() -> None:
    square = ((20.0, 10.0), (40.0, 10.0), (40.0, 30.0), (20.0, 30.0))
    profile = MountProfile(pier_zones=(PierZone("pillar", square, "normal"),), hour_angle_limit_deg=500.0)
    inside = margins_deg(pointing(30.0, 18.0), profile, DARK, 0.0)["pier"][0]
    assert inside == pytest.approx(-8.0)
    assert margins_deg(pointing(390.0, 18.0), profile, DARK, 0.0)["pier"][0] == pytest.approx(-8.0)
    assert margins_deg(pointing(45.0, 20.0), profile, DARK, 0.0)["pier"][0] == pytest.approx(5.0)
    # From beyond the pole the same direction is another place of the axes.
    assert margins_deg(pointing(-150.0, 162.0), profile, DARK, 0.0)["pier"][0] > 0.0


def held(path: AxisPath) -> MountPath:
    return MountPath(path.pointing, path.hour_angle_rate_deg_s, path.dec_rate_deg_s)


def test_a_cut_link_leads_to_the_horizon_in_the_time_that_the_rate_says() -> None:
    # On the equator, through the zenith towards the west at 2 °/s: the altitude is 90° less the hour angle.
    time_s = np.linspace(0.0, 30.0, 601)
    path = path_of(time_s, 2.0 * time_s, np.zeros_like(time_s))
    found = link_loss(held(path), MountProfile(), DARK, 0.0)
    left = (90.0 - 2.0 * found.utc_s) / 2.0
    assert np.allclose(found.seconds, left, atol=1e-6)
    assert set(found.limits) == {"altitude"}
    assert found.worst == len(found.utc_s) - 1
    assert found.rests_s is None


def test_a_watchdog_is_told_apart_and_comes_too_late_where_the_limit_is_nearer() -> None:
    time_s = np.linspace(0.0, 44.0, 881)
    path = path_of(time_s, 2.0 * time_s, np.zeros_like(time_s))
    found = link_loss(held(path), MountProfile(watchdog_s=2.0), DARK, 0.0)
    assert found.rests_s is not None
    assert found.rests_inside is not None
    # Two seconds of silence, a turn of its loop, and braking from 2 °/s at 10 °/s².
    assert found.rests_s[0] == pytest.approx(2.0 + 0.05 + 0.2)
    assert bool(found.rests_inside[0])
    assert not bool(found.rests_inside[-1])


def test_an_axis_at_half_the_rate_needs_as_long_again_to_catch_up() -> None:
    # 2 °/s for 10 s, then at rest: an axis of 1 °/s is 10° behind, and there after 10 s more.
    time_s = np.linspace(0.0, 60.0, 6001)
    hour_angle = np.clip(2.0 * (time_s - 20.0), 0.0, 20.0)
    slow = AxisLimits(max_rate_deg_s=1.0)
    (found,) = losses(path_of(time_s, hour_angle, np.full_like(time_s, 20.0)), ability(MountProfile(ra=slow)))
    assert found.limit == "rate"
    assert found.begin_utc_s == pytest.approx(20.0, abs=0.05)
    assert found.seconds == pytest.approx(20.0, abs=0.1)


def test_what_is_beyond_a_limit_of_travel_is_lost_with_its_reason() -> None:
    time_s = np.linspace(0.0, 100.0, 1001)
    path = path_of(time_s, time_s - 50.0, np.full_like(time_s, 20.0))
    profile = MountProfile(hour_angle_limit_deg=30.0)
    # From -50° to 50° at 1 °/s: the first and the last 20 s are outside, and before the end a second of fault
    # and a tenth of a degree are kept.
    first, last = losses(path, ability(profile))
    assert first.limit == last.limit == "hour_angle"
    assert first.end_utc_s == pytest.approx(20.1, abs=0.11)
    assert last.begin_utc_s == pytest.approx(80.0 - 1.1, abs=0.11)
    reason = why_not([first, last], 100.0)
    assert reason is not None
    assert reason.startswith("hour_angle: ")
    assert why_not(losses(path, ability(MountProfile())), 100.0) is None


def test_where_the_rest_fits_on_no_turn_of_the_cables_it_is_lost() -> None:
    # From 80° to 205° at 1 °/s: the last 55 s are past 150°, and on the other turn they are so, too.
    time_s = np.linspace(0.0, 125.0, 1251)
    path = path_of(time_s, 80.0 + time_s, np.full_like(time_s, 70.0))
    (found,) = losses(path, ability(MountProfile(hour_angle_limit_deg=150.0), latitude_deg=60.0))
    assert (found.limit, found.end_utc_s) == ("hour_angle", 125.0)
    assert found.seconds == pytest.approx(55.0 + 1.1, abs=0.2)


@pytest.mark.parametrize(("begins_deg", "lost_s"), [(80.0, 60.0 + 1.1), (165.0, 45.0)])
def test_between_the_ends_of_the_cables_no_more_is_lost_than_what_lies_there(
    begins_deg: float, lost_s: float
) -> None:
    # At 1 °/s, from 150° to 210°, it is on no turn: long enough to be far behind, and for the slew of a turn.
    time_s = np.linspace(0.0, 200.0, 2001)
    path = path_of(time_s, begins_deg + time_s, np.full_like(time_s, 70.0))
    (found,) = losses(path, ability(MountProfile(hour_angle_limit_deg=150.0), latitude_deg=60.0))
    assert found.limit == "hour_angle"
    assert found.end_utc_s == pytest.approx(210.0 - begins_deg, abs=0.11)
    assert found.seconds == pytest.approx(lost_s, abs=0.2)


def test_what_a_keyhole_loses_is_told_by_the_names_of_the_axes() -> None:
    path = great_circle(0.7, 1.0)
    altaz = MountProfile(geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(52.0, 4.5))
    for profile, words in (
        (MountProfile(), "1.00° from the pole the hour angle turns 40.1 °/s of 6 °/s"),
        (altaz, "1.00° from the mount's pole the first axis turns 40.1 °/s of 6 °/s"),
    ):
        found = losses(path, ability(profile, latitude_deg=60.0))
        assert [one.words for one in found if one.limit == "keyhole"] == [words]


def test_a_target_that_begins_by_the_sun_is_joined_where_it_comes_out() -> None:
    # At 1 °/s from the Sun: the mount waits at its cone, 15° and a tenth away. Round to a target that was
    # followed before lead two slews of 30° at 10 °/s and 10 °/s²: 4.5 s each, and 3 s to begin and to end.
    time_s = np.linspace(0.0, 80.0, 801)
    path = path_of(time_s, time_s, np.zeros_like(time_s))
    path = replace(path, pointing=replace(path.pointing, sun_hour_angle_deg=np.zeros_like(time_s)))
    (joined,) = losses(path, ability(MountProfile(), SafetyLimits()))
    assert (joined.limit, joined.begin_utc_s) == ("sun", 0.0)
    assert joined.end_utc_s == pytest.approx(15.1, abs=0.11)
    (round_it,) = losses(path, ability(MountProfile(), SafetyLimits()), begun=True)
    assert round_it.end_utc_s == pytest.approx(joined.end_utc_s + 15.0)
    slow = AxisLimits(slew_rate_deg_s=0.5)
    (to_the_end,) = losses(path, ability(MountProfile(ra=slow), SafetyLimits()), begun=True)
    assert to_the_end.end_utc_s == 80.0


def test_behind_a_narrow_pillar_a_target_is_followed_again_once_the_mount_has_gone_round() -> None:
    # At 1 °/s past a pillar 2° wide: the mount stands before it until the target is 5° ahead, and 5 s more;
    # round it lead two slews of 30° at 10 °/s and 10 °/s²: 4.5 s each, and 3 s to begin and to end.
    time_s = np.linspace(0.0, 120.0, 1201)
    path = path_of(time_s, time_s - 60.0, np.zeros_like(time_s))
    post = ((-1.0, -20.0), (1.0, -20.0), (1.0, 20.0), (-1.0, 20.0))
    (found,) = losses(path, ability(MountProfile(pier_zones=(PierZone("pillar", post),))))
    assert found.limit == "pier"
    assert found.seconds == pytest.approx(5.0 + 5.0 + 15.0, abs=0.2)


def test_a_target_that_stands_still_is_lost_while_the_sun_goes_by_and_no_longer() -> None:
    # The Sun passes over a target on the meridian at a quarter of a degree a minute: 15° either way is 2 h.
    time_s = np.linspace(0.0, 28800.0, 5761)
    level = np.zeros_like(time_s)
    still = path_of(time_s, level, level)
    sun = time_s / 240.0 - 60.0
    path = replace(still, pointing=replace(still.pointing, sun_hour_angle_deg=sun))
    (found,) = losses(path, ability(MountProfile(), SafetyLimits()))
    assert found.limit == "sun"
    assert found.seconds == pytest.approx(7200.0, abs=60.0)
    assert found.begin_utc_s == pytest.approx(10800.0, abs=60.0)


def test_a_stop_and_a_new_beginning_are_recommended_where_the_cables_end() -> None:
    # Circumpolar, through the lower meridian: at 200° the cables end; a slew winds them back to -160°.
    time_s = np.linspace(0.0, 400.0, 4001)
    path = path_of(time_s, 140.0 + 0.3 * time_s, np.full_like(time_s, 70.0))
    found = choose_sides(path, ability(MountProfile(), latitude_deg=60.0), "never", [])
    # The cables end after 200 s; a second of fault and a tenth of a degree are kept before. By itself it
    # slews only when it has been 5° behind on the sky for 5 s.
    far_s = 5.0 / math.cos(math.radians(70.0)) / 0.3
    once_round_s = 3.0 + 360.0 / 10.0
    assert found.by_itself.lost_s == pytest.approx(1.0 + 0.1 / 0.3 + far_s + 5.0 + once_round_s, abs=3.0)
    assert found.by_itself.limit == "hour_angle"
    assert found.recommended.stop_utc is not None
    # Once round at 10 °/s takes 36 s and some for the ramps.
    assert 36.0 < found.recommended.lost_s < 50.0


def test_where_the_cables_end_soon_after_the_lower_meridian_a_late_beginning_loses_less_than_a_stop() -> None:
    # At 180° after 30 s: begun from there on, the cables are unwound, and all the rest can be followed.
    time_s = np.linspace(0.0, 400.0, 4001)
    path = path_of(time_s, 171.0 + 0.3 * time_s, np.full_like(time_s, 70.0))
    found = choose_sides(path, ability(MountProfile(), latitude_deg=60.0), "never", [])
    assert found.recommended.stop_utc is None
    assert found.recommended.again_utc is not None
    assert found.recommended.lost_s == pytest.approx(30.0, abs=0.5)


def test_a_mount_that_flips_by_its_rule_begins_late_from_the_side_that_holds_the_rest() -> None:
    # West of the meridian the rule has it beyond the pole. From the normal side its axis is let go to 40°
    # only: begun there the path is lost after 50 s; joined past the meridian, 10 s in, the axis is at -180°.
    time_s = np.linspace(0.0, 160.0, 1601)
    path = path_of(time_s, time_s - 10.0, np.full_like(time_s, 40.0))
    square = ((40.0, 0.0), (170.0, 0.0), (170.0, 80.0), (40.0, 80.0))
    mount = MountProfile(
        pier_rule="hour_angle", pier_zones=(PierZone("pillar", square, "normal"),), hour_angle_limit_deg=185.0
    )
    found = choose_sides(path, ability(mount, latitude_deg=50.0), "hour_angle", [])
    assert found.by_itself.side == "normal"
    assert found.by_itself.lost_s == pytest.approx(110.0, abs=2.0)
    assert (found.recommended.stop_utc, found.recommended.again_side) == (None, "beyond_pole")
    assert found.recommended.lost_s == pytest.approx(10.0, abs=0.5)


def test_the_table_gives_the_directions_of_the_propagator() -> None:
    site = demo_pass.SITE.place()
    real = Propagator(demo_pass.elements(), site, refraction=Refraction.standard(site.height_m))
    table = TabledPropagator(real, NO_BIAS, *PASS)
    for utc_s in np.random.default_rng(1).uniform(*PASS, 300):
        ours, theirs = table.at(Utc(float(utc_s))), real.at(Utc(float(utc_s)))
        cos_dec = math.cos(math.radians(float(theirs.dec_deg)))
        assert abs(float(ours.ra_deg - theirs.ra_deg)) * cos_dec * 3600.0 < 1e-3
        assert abs(float(ours.dec_deg - theirs.dec_deg)) * 3600.0 < 1e-3
        assert abs(float(ours.ra_rate_deg_s - theirs.ra_rate_deg_s)) * cos_dec * 3600.0 < 0.01
        assert abs(float(ours.dec_rate_deg_s - theirs.dec_rate_deg_s)) * 3600.0 < 0.01


def test_the_path_has_the_differences_of_the_directions_as_rates() -> None:
    real = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    time_s = np.linspace(*PASS, 4091)
    path = axis_path(real, NO_BIAS, time_s)
    seen = real.at(Utc(time_s))
    by_differences = np.gradient(np.unwrap(seen.ha_deg, period=360.0), time_s)
    assert np.allclose(path.hour_angle_rate_deg_s[1:-1], by_differences[1:-1], atol=2e-5)
    assert np.allclose(path.dec_rate_deg_s[1:-1], np.gradient(seen.dec_deg, time_s)[1:-1], atol=2e-5)
    other = path.seen_from(True, 52.0)
    assert np.allclose(other.pointing.dec_axis_deg, 180.0 - seen.dec_deg)

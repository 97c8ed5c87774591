"""A pass that is paused: the simulated axes stand, are jogged, and join the satellite again."""

from __future__ import annotations

import dataclasses
import itertools
import math
import random
from typing import TYPE_CHECKING, Any

import erfa
import msgspec
import pytest
from late_start import late
from test_trouble import CULMINATION_S, NEAR_S, Flown, TroubledRun, fly

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile
from sattrack.mount.profiles import ProfileFile
from sattrack.mount.simulator.drives import Mode
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.recording.fits import fit_axes
from sattrack.recording.format import Recording, fingerprint, here
from sattrack.recording.recorder import NoRecording
from sattrack.recording.replay import choose
from sattrack.recording.trace import trace
from sattrack.runtime.facts import RunRequest, build_engine, engine_of, open_recording, prepare
from sattrack.runtime.flight import fitted_mount, fly_virtual, summarise
from sattrack.views.messages import (
    ClearBias,
    Go,
    Jog,
    Message,
    Nudge,
    OffsetBy,
    Pause,
    Search,
    StopNow,
)

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.mount.simulator.mount import Truth
    from sattrack.runtime.facts import RunFacts

RESTS_WITHIN_S = 1.0
"""From the word to axes that stand: two datagrams, the handshake, and braking from 1.3 °/s."""
SEEN_AT_REST_S = 2.8
"""Braking, and two seconds of positions of an encoder that could hang."""
JOINS_WITHIN_S = 12.0
"""From the word to the satellite: at 1.3 °/s it is some tens of degrees away, which takes a slew."""


def between(flown: Flown, after_s: float, until_s: float) -> list[Truth]:
    """Where the axes really were, between two instants after culmination."""
    return [t for t in flown.run.truths if after_s <= t.utc_s - CULMINATION_S <= until_s]


def phases(flown: Flown) -> list[str]:
    told: list[str] = []
    for view in flown.run.views:
        if not told or told[-1] != view.phase:
            told.append(view.phase)
    return told


def spread(flown: Flown, after_s: float, until_s: float) -> tuple[float, float]:
    """By how much the axes' own angles changed between two instants, degrees."""
    seen = between(flown, after_s, until_s)
    has, decs = [t.hour_angle_axis_deg for t in seen], [t.dec_axis_deg for t in seen]
    return max(has) - min(has), max(decs) - min(decs)


@pytest.fixture(scope="module")
def whole() -> Flown:
    return fly(min_alt_deg=55.0)


@pytest.fixture(scope="module")
def paused() -> Flown:
    return fly(messages=((-20.0, Pause()), (-5.0, Go())), min_alt_deg=55.0)


def test_the_axes_stand_while_a_pass_is_paused(paused: Flown) -> None:
    assert spread(paused, -20.0 + RESTS_WITHIN_S, -5.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert spread(paused, -22.0, -20.0)[0] > 1.0


def test_they_come_to_rest_within_what_the_drives_can_do(paused: Flown) -> None:
    braking = between(paused, -20.0, -20.0 + RESTS_WITHIN_S)
    for before, after in itertools.pairwise(braking):
        seconds = after.utc_s - before.utc_s
        for now, was in (
            (after.ra_rate_deg_s, before.ra_rate_deg_s),
            (after.dec_rate_deg_s, before.dec_rate_deg_s),
        ):
            assert abs(now - was) <= 1.05 * MountProfile().ra.max_acceleration_deg_s2 * seconds


def test_the_satellite_is_joined_again_where_it_is_then(paused: Flown) -> None:
    assert paused.summary.ended_by == "set"
    assert paused.error_arcsec(-5.0 + JOINS_WITHIN_S, 35.0) < 1.0
    assert phases(paused) == [
        *("waiting", "slewing", "acquiring", "tracking", "paused"),
        *("slewing", "acquiring", "tracking", "stopping"),
    ]


def test_a_pause_is_named_and_spoils_no_figure(paused: Flown, whole: Flown) -> None:
    assert paused.summary.paused_s == pytest.approx(15.0, abs=0.2)
    assert 1.0 < paused.summary.rejoining_s < JOINS_WITHIN_S
    assert paused.summary.held_s == {}
    assert paused.summary.true_peak_arcsec is not None
    assert paused.summary.true_peak_arcsec < 30.0
    lost_s = whole.summary.on_target_s - paused.summary.on_target_s
    assert lost_s == pytest.approx(paused.summary.paused_s + paused.summary.rejoining_s, abs=1.0)


def test_views_tell_of_it(paused: Flown) -> None:
    told = [(view.pause, view.utc_s) for view in paused.run.views if view.phase == "paused"]
    first, _ = told[0]
    assert first is not None
    assert first.since_utc_s == pytest.approx(CULMINATION_S - 20.0, abs=0.1)
    assert not first.at_rest
    seen = [
        one.at_rest
        for one, utc_s in told
        if one is not None and utc_s > CULMINATION_S - 20.0 + SEEN_AT_REST_S
    ]
    assert len(seen) > 20
    assert all(seen)
    assert all(view.pause is None for view in paused.run.views if view.phase != "paused")


def test_a_short_pause_costs_a_few_seconds() -> None:
    lengths_s = {-30.0: 0.0, -15.0: 0.05, 0.0: 0.4, 15.0: 2.0}
    messages = [(begin_s + after_s, order) for begin_s, length_s in lengths_s.items()
                for after_s, order in ((0.0, Pause()), (length_s, Go()))]  # fmt: skip
    flown = fly(messages=(*messages, (30.0, StopNow())), min_alt_deg=55.0)
    for begin_s, length_s in lengths_s.items():
        assert flown.error_arcsec(begin_s + length_s + 3.5 + SEEN_AT_REST_S, begin_s + 14.0) < 1.0


def test_a_stop_ends_a_paused_run() -> None:
    flown = fly(
        messages=((0.0, Pause()), (5.0, StopNow()), (5.1, Go()), (5.1, Jog(dec_rate_deg_s=1.0))),
        min_alt_deg=75.0,
    )
    assert flown.summary.ended_by == "operator"
    assert flown.summary.mount_stopped is True
    assert flown.run.truths[-1].utc_s - CULMINATION_S < 6.5
    assert flown.at_rest()


def test_before_the_pass_a_pause_holds_the_slew_back(whole: Flown) -> None:
    begins_s = whole.run.views[0].start_utc_s - CULMINATION_S
    messages = ((begins_s - 12.0, Pause()), (begins_s + 5.0, Go()), (begins_s + 35.0, StopNow()))
    flown = fly(messages=messages, min_alt_deg=55.0)
    assert spread(flown, begins_s - 11.0, begins_s + 5.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert flown.summary.acquired_after_s is not None
    assert flown.summary.acquired_after_s < 3.0
    assert flown.error_arcsec(begins_s + 25.0, begins_s + 35.0) < 1.0


def test_a_slew_is_stopped_by_a_pause_and_made_afterwards(whole: Flown) -> None:
    begins_s = whole.run.views[0].start_utc_s - CULMINATION_S
    slewing = next(v.utc_s for v in whole.run.views if v.phase == "slewing") - CULMINATION_S
    at_once = (
        (slewing + 1.0, Pause()),
        (slewing + 1.0, Go()),
        (slewing + 1.1, Pause()),
        (slewing + 1.2, Go()),
    )
    messages = ((slewing + 1.5, Pause()), (slewing + 12.0, Go()), (begins_s + 20.0, StopNow()))
    flown = fly(messages=(*at_once, *messages), min_alt_deg=55.0)
    assert spread(flown, slewing + 0.5, slewing + 1.5)[0] > 1.0, "it was on its way"
    assert spread(flown, slewing + 4.0, slewing + 12.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert flown.error_arcsec(begins_s + 5.0, begins_s + 20.0) < 1.0


def test_words_on_one_another_s_heels_come_to_what_the_last_one_says() -> None:
    paused = ((-20.0, Pause()), (-19.95, Go()), (-19.9, Pause()))
    later = ((-10.0, Jog(dec_rate_deg_s=6.0)), (-9.8, Go()), (10.0, StopNow()))
    flown = fly(messages=(*paused, *later), min_alt_deg=60.0)
    assert spread(flown, -19.0, -10.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert flown.summary.ended_by == "operator", flown.summary.message
    assert any(view.pause is not None and view.pause.going_on for view in flown.run.views)
    assert flown.error_arcsec(-9.8 + JOINS_WITHIN_S, 10.0) < 1.0


def test_a_search_ends_where_it_is_and_a_nudge_moves_nothing_until_the_run_goes_on() -> None:
    searching: tuple[tuple[float, Message], ...] = (
        (-40.0, Search("spiral", spacing_deg=0.1, speed_deg_s=0.05)),
        (-20.0, Pause()),
        (-15.0, Search("spiral", spacing_deg=0.1, speed_deg_s=0.05)),
        (-8.0, Nudge(along_s=1.0)),
        (-5.0, Go()),
        (20.0, StopNow()),
    )
    flown = fly(messages=searching, min_alt_deg=50.0)
    at = {round(view.utc_s - CULMINATION_S): view for view in flown.run.views}
    before, after = at[-21], at[-10]
    assert before.search is not None
    assert after.search is None
    assert any("paused: go on before a search" in words for words in after.warnings)
    assert after.bias_along_s == pytest.approx(before.bias_along_s, abs=0.3)
    assert abs(after.bias_along_s) + abs(after.bias_cross_deg) > 0.03
    assert spread(flown, -19.0, -5.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert at[15].bias_along_s == pytest.approx(after.bias_along_s + 1.0, abs=1e-6)
    assert flown.error_arcsec(-5.0 + JOINS_WITHIN_S, 20.0) < 1.0


JOGS = {
    -85.0: (Jog(dec_rate_deg_s=0.5), (0.0, 0.25)),
    -80.0: (Jog(ra_rate_deg_s=0.5), (-0.25, 0.0)),
    -75.0: (Jog(ra_rate_deg_s=-2.0), (1.0, 0.0)),
}
"""When, what, and by how much the axes then go: east is where the hour angle falls."""


@pytest.fixture(scope="module")
def jogged() -> Flown:
    """A run with jogs one after another: some that are none, single ones, a held key, one into a silence."""
    return fly(
        messages=(
            (-95.0, Jog(dec_rate_deg_s=0.5)),
            (-90.0, Pause()),
            (-89.95, Jog(dec_rate_deg_s=0.5)),
            *((at_s, order) for at_s, (order, _) in JOGS.items()),
            (-70.0, Jog(dec_rate_deg_s=50.0)),
            (-69.0, Jog()),
            *((-65.0 + 0.04 * n, Jog(dec_rate_deg_s=0.5)) for n in range(50)),
            (-54.0, Jog(dec_rate_deg_s=0.5)),
        ),
        lost_statuses=(-55.0, 20.0),
        min_alt_deg=30.0,
    )


@pytest.mark.parametrize("at_s", JOGS)
def test_a_jog_moves_only_the_axis_asked_and_ends_by_itself(jogged: Flown, at_s: float) -> None:
    before, after = between(jogged, at_s - 1.0, at_s)[-1], between(jogged, at_s + 3.0, at_s + 4.0)[-1]
    went = (after.hour_angle_axis_deg - before.hour_angle_axis_deg, after.dec_axis_deg - before.dec_axis_deg)
    assert went == pytest.approx(JOGS[at_s][1], rel=0.15, abs=1e-5)
    assert spread(jogged, at_s + 1.5, at_s + 5.0) == pytest.approx((0.0, 0.0), abs=1e-5)


def test_a_held_key_jogs_on_and_the_motion_ends_soon_after_it(jogged: Flown) -> None:
    moving = [t.utc_s - CULMINATION_S for t in between(jogged, -67.0, -55.0) if abs(t.dec_rate_deg_s) > 0.01]
    assert moving[0] == pytest.approx(-65.0, abs=0.3)
    assert moving[-1] == pytest.approx(-63.04 + 0.3, abs=0.4)
    assert moving[-1] - moving[0] == pytest.approx(0.05 * (len(moving) - 1), abs=0.11), "without a gap"


def test_a_jog_is_refused_while_the_run_is_not_paused_or_at_rest_and_where_it_is_none(jogged: Flown) -> None:
    told = {words for view in jogged.run.views for words in view.warnings}
    for words in ("pause it first", "jog once it stands", "rate in declination is 50", "no axis to move"):
        assert any(words in one for one in told), words
    assert spread(jogged, -89.0, -85.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert spread(jogged, -71.0, -65.0) == pytest.approx((0.0, 0.0), abs=1e-5)


def test_nothing_is_jogged_blindly_and_a_silence_while_paused_ends_the_run_as_ever(jogged: Flown) -> None:
    assert any("nothing is moved blindly" in words for view in jogged.run.views for words in view.warnings)
    assert spread(jogged, -60.0, -50.0) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert jogged.exit_code == 4
    assert jogged.summary.ended_by == "link"


def test_a_jog_ends_at_a_limit_and_can_lead_away_from_it() -> None:
    """The declination axis may go to 75°; a key held north from 36° on would lead past it."""
    limited = msgspec.structs.replace(MountProfile(), dec_axis_limits_deg=(-60.0, 75.0))
    north = tuple((-40.0 + 0.05 * n, Jog(dec_rate_deg_s=6.0)) for n in range(400))
    south = tuple((-15.0 + 0.05 * n, Jog(dec_rate_deg_s=-2.0)) for n in range(40))
    messages = ((-60.0, Pause()), *north, *south, (0.0, StopNow()))
    flown = fly(messages=messages, profile=limited, min_alt_deg=30.0, from_s=-65.0)
    axes = [t.dec_axis_deg for t in flown.run.truths]
    assert 60.0 < max(axes) <= 75.0
    assert spread(flown, -58.0, 0.0)[0] < 1e-5
    assert any("ended at the declination limit" in w for v in flown.run.views for w in v.warnings)
    assert spread(flown, -30.0, -20.5)[1] < 0.05, "a key that is held on does not shake the axis"
    assert between(flown, -12.0, -11.0)[-1].dec_axis_deg < max(axes) - 3.0
    assert flown.summary.ended_by == "operator"


class SkyBound(SimulatedMount):
    """A mount that takes to the sky by itself whenever it was told to stop."""

    def _rest(self) -> None:
        SimulatedMount._rest(self)
        self._ra.mode = Mode.TRACKING


def fly_with(
    mount_of: type[SimulatedMount], start: StartPosition, facts: RunFacts, *orders: Any
) -> TroubledRun:
    """Fly a pass that is paused from its beginning, with another mount or from elsewhere."""
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg)
    timed = ((facts.started_utc_s + 1.0, Pause()), *orders)
    mount = mount_of(facts.profile, site, start)
    run = TroubledRun(build_engine(facts), mount, facts.started_utc_s, NoRecording(), timed)
    run.progress = run.views.append
    run.run()
    return run


def facts_of_the_pass(min_alt_deg: float = 45.0) -> RunFacts:
    return late(prepare(RunRequest("25544", "sim", None, None, None, min_alt_deg, virtual=True)).facts)


def test_a_mount_that_follows_the_sky_at_rest_is_held_at_a_limit_that_it_drifts_to() -> None:
    """From hour angle 29.25° it drifts by 15° an hour; the axis ends at 29.5°."""
    facts = facts_of_the_pass(60.0)
    profile = msgspec.structs.replace(facts.profile, hour_angle_limit_deg=29.5)
    run = fly_with(SkyBound, StartPosition(29.25, 20.0), msgspec.structs.replace(facts, profile=profile))
    axis = [truth.hour_angle_axis_deg for truth in run.truths]
    assert axis[0] + SIDEREAL_RATE_DEG_S * (run.truths[-1].utc_s - run.truths[0].utc_s) > 29.6, "it would"
    assert 29.3 < max(axis) <= 29.41
    assert any("held at the hour_angle limit" in words for view in run.views for words in view.warnings)
    assert all(view.pause is not None and view.pause.at_rest for view in run.views[20:-6])
    assert run.engine.tracker.ended_by == "set"


def sun_place(utc_s: float, longitude_deg: float) -> tuple[float, float]:
    """Hour angle and declination of the Sun, degrees, as from the Earth's centre: right to 0.003°."""
    day = utc_s / 86400.0
    x, y, z = -erfa.epv00(2440587.5, day)[0]["p"]
    bias = erfa.pnm06a(2440587.5, day) @ (x, y, z)
    ra = math.degrees(math.atan2(bias[1], bias[0]))
    sidereal = math.degrees(erfa.gst06a(2440587.5, day, 2440587.5, day)) + longitude_deg
    return math.remainder(sidereal - ra, 360.0), math.degrees(
        math.atan2(bias[2], math.hypot(bias[0], bias[1]))
    )


def apart_deg(one: tuple[float, float], other: tuple[float, float]) -> float:
    """The angle between two directions of hour angle and declination."""
    return math.degrees(erfa.seps(*(math.radians(x) for x in (*one, *other))))


def test_a_mount_that_stands_in_the_suns_way_is_led_out_of_it() -> None:
    """The Sun goes 15° an hour westward; the axes stand 15.1° west of it, 15° is its cone."""
    facts = facts_of_the_pass(60.0)
    began_s = facts.started_utc_s
    ha_deg, dec_deg = sun_place(began_s, facts.site.longitude_deg)
    run = fly_with(SimulatedMount, StartPosition(ha_deg + 15.1, dec_deg), facts)
    apart = []
    for truth in run.truths:
        sun = sun_place(truth.utc_s, facts.site.longitude_deg)
        apart.append(apart_deg((truth.hour_angle_axis_deg, truth.dec_axis_deg), sun))
    stayed_deg = SIDEREAL_RATE_DEG_S * (run.truths[-1].utc_s - began_s)
    assert stayed_deg > 0.35
    assert 14.9 < min(apart) < 15.05
    assert apart[-1] > 15.05
    stands = [t.hour_angle_axis_deg for t in run.truths if 30.0 < t.utc_s - began_s < 85.0]
    assert max(stands) - min(stands) < 1e-5, "it rests again out there, and does not follow the sky"
    led_out = [v for v in run.views if any("led out of the Sun" in words for words in v.warnings)]
    assert led_out
    assert not any(view.pause is None or view.pause.at_rest for view in led_out)
    summary = summarise(run.engine, run.statistics, run.truths[-1].utc_s)
    assert (summary.ended_by, summary.mount_stopped) == ("set", True), "a paused pass ends as ever"
    assert "before the mount was on the satellite (it was paused for" in (summary.message or "")


@pytest.mark.parametrize(
    "seed", [13, *(pytest.param(n, marks=pytest.mark.soak) for n in range(40) if n != 13)]
)
def test_keys_held_at_random_never_lead_past_a_limit_nor_end_the_run(seed: int) -> None:
    draws = random.Random(seed)
    facts = facts_of_the_pass()
    travel_deg, low_deg, high_deg = draws.uniform(40, 120), draws.uniform(-40, 0), draws.uniform(40, 100)
    profile = msgspec.structs.replace(
        facts.profile,
        hour_angle_limit_deg=travel_deg,
        dec_axis_limits_deg=(low_deg, high_deg),
        move_axis=draws.choice(("held", "edge")),
    )
    floor_deg = draws.uniform(0, 25)
    limits = msgspec.structs.replace(facts.limits, floor_altitude_deg=floor_deg)
    mount = draws.choice((SimulatedMount, SkyBound))
    facts = msgspec.structs.replace(facts, profile=profile, limits=limits)
    run = fly_with(mount, StartPosition(-30.0, 20.0), facts, *held_keys(draws, facts))
    assert run.engine.tracker.ended_by == "set", run.engine.message
    assert run.engine.mount_stopped
    for truth in run.truths:
        assert abs(truth.hour_angle_axis_deg) <= travel_deg
        assert low_deg <= truth.dec_axis_deg <= high_deg
        zenith = apart_deg((truth.hour_angle_axis_deg, truth.dec_axis_deg), (0.0, facts.site.latitude_deg))
        assert 90.0 - zenith >= floor_deg
    for truth in run.truths[::10]:
        sun = sun_place(truth.utc_s, facts.site.longitude_deg)
        assert apart_deg((truth.hour_angle_axis_deg, truth.dec_axis_deg), sun) > 14.9


def held_keys(draws: random.Random, facts: RunFacts) -> list[tuple[float, Message]]:
    """Keys held for up to three seconds each, one after another, and now and then the pass for a while."""
    orders: list[tuple[float, Message]] = []
    utc_s = facts.started_utc_s + 4.0
    while utc_s < facts.plan.end_utc_s - 5.0:
        rate, axis = draws.choice((-6.0, -2.0, -0.5, 0.5, 2.0, 6.0)), draws.choice(("ra", "dec"))
        for _ in range(draws.randrange(1, 60)):
            orders.append((utc_s, Jog(**{f"{axis}_rate_deg_s": rate})))
            utc_s += 0.05
        utc_s += draws.choice((0.0, 0.1, 0.5, 2.0))
        if draws.random() < 0.05:
            orders += [(utc_s, Go()), (utc_s + draws.uniform(0.0, 6.0), Pause())]
            utc_s = orders[-1][0] + 0.2
    return orders


ORDERS: tuple[Message, ...] = (
    *(Pause(), Pause(), Go(), Go(), Jog(ra_rate_deg_s=2.0), Jog(dec_rate_deg_s=-6.0), Nudge(along_s=0.5)),
    *(Nudge(cross_deg=-0.1), Search("spiral", spacing_deg=0.1, speed_deg_s=0.05), Search("stop")),
    *(Search("cancel"), Search("sweep", reach_s=1.0, period_s=20.0), ClearBias()),
    OffsetBy("dec_deg", "rate", 0.01),
)


@pytest.mark.parametrize("seed", [1, *(pytest.param(n, marks=pytest.mark.soak) for n in range(2, 40))])
def test_orders_mashed_in_any_order_never_break_a_run_and_it_can_still_be_followed(seed: int) -> None:
    draws = random.Random(seed)
    mashed: list[tuple[float, Any]] = []
    at_s = -50.0
    while at_s < 0.0:
        at_s += draws.choice((0.0, 0.02, 0.05, 0.3, 1.5, 4.0))
        mashed.append((at_s, draws.choice(ORDERS)))
    last = ((at_s + 0.1, Go()), (at_s + 0.1, ClearBias()))
    flown = fly(messages=(*mashed, *last))
    assert flown.summary.ended_by == "set", flown.summary.message
    assert flown.summary.mount_stopped is True
    assert flown.at_rest()
    assert flown.error_arcsec(at_s + 20.0, at_s + 40.0) < 5.0

    stopped_s = draws.uniform(-45.0, -15.0)
    flown = fly(messages=(*mashed, (stopped_s, StopNow())))
    assert flown.summary.ended_by == "operator", "whatever goes on"
    assert flown.summary.mount_stopped is True
    assert flown.at_rest()
    assert flown.run.truths[-1].utc_s - CULMINATION_S < stopped_s + 3.0


def test_another_law_is_tried_with_the_delay_of_the_recorded_mount(tmp_path: Path) -> None:
    late_s = 0.06
    slow = ProfileFile(simulator={"command_delay_s": late_s})
    request = RunRequest(
        "25544", "sim", None, None, None, 70.0, virtual=True, record=tmp_path / "slow.mcap", profile=slow
    )
    prepared = prepare(request)
    prepared = dataclasses.replace(prepared, facts=late(prepared.facts, NEAR_S))
    fly_virtual(prepared, messages=((CULMINATION_S + 10.0, StopNow()),))
    recording, facts = open_recording(tmp_path / "slow.mcap")
    _, hardware, words = fitted_mount(trace(recording, engine_of), facts)
    assert hardware.command_delay_s == pytest.approx(late_s, abs=0.01)
    assert "ms late" in words


def test_a_recording_of_a_paused_pass_runs_again_to_the_same_bytes(tmp_path: Path) -> None:
    request = RunRequest(
        "25544", "sim", None, None, None, 70.0, virtual=True, record=tmp_path / "paused.mcap"
    )
    orders: tuple[tuple[float, Message], ...] = (
        *((-10.0, Pause()), (-8.0, Jog(dec_rate_deg_s=0.5)), (-5.0, Go()), (10.0, Pause()), (11.0, Go())),
        (25.0, StopNow()),
    )
    prepared = prepare(request)
    prepared = dataclasses.replace(prepared, facts=late(prepared.facts, NEAR_S))
    summary = fly_virtual(prepared, messages=tuple((CULMINATION_S + at, word) for at, word in orders))
    # Going on waits until rest is seen.
    assert 6.5 < summary.paused_s < 6.0 + SEEN_AT_REST_S
    recording = Recording(tmp_path / "paused.mcap")
    assert choose(recording.header, fingerprint(), here()).mode == "bytes"
    run = trace(recording, engine_of)
    assert run.result.divergence is None
    assert run.result.differing == 0
    assert math.sqrt(float((run.total[run.following] ** 2).mean())) == pytest.approx(
        summary.reported_rms_arcsec or 0.0
    ), "a report counts what the summary does"
    for fit in fit_axes(run, run.engine.spec.profile):
        assert fit is not None
        assert fit.gain == pytest.approx(1.0, abs=0.001), "what was moved by hand says nothing of it"

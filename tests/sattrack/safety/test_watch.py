"""What statuses show of a mount, at the bounds that docs/safety.md names, in closed form."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import erfa
import numpy as np
import pytest
from msgspec.structs import replace

from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    Hold,
    MountProfile,
    MoveAxes,
    Seen,
    SitePlace,
)
from sattrack.safety.geometry import Place
from sattrack.safety.watch import (
    AxesWatch,
    Belief,
    Former,
    PositionFilter,
    Watch,
    _by_gain,
    _left_by_both,
    _spread,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

PROFILE, PERIOD_S = MountProfile(), 0.05
UTC_S, EAST_DEG = 1_790_000_000.0, 4.5
Rates = tuple[float, float]


def watch(fault_s: float = 0.0, profile: MountProfile = PROFILE) -> Watch:
    return Watch(profile, fault_s, EAST_DEG, 60.0)


def tripped_s(pairs: Iterable[tuple[Rates, Rates]], fault_s: float = 0.0) -> float | None:
    """Take what was told and what came of it, once a period; return when that is no obedience, seconds."""
    watching = watch(fault_s)
    for k, (told, moved) in enumerate(pairs, start=1):
        if watching.see_motion(MoveAxes(*moved), MoveAxes(*told), PERIOD_S) is not None:
            return k * PERIOD_S
    return None


AT_ONCE, BY_MEAN, NEVER = (0.95, 1.1), (2.95, 3.45), None
"""After a second; when the mean of 3 s is looked at, every eighth status; not at all."""


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(
    ("told", "moved", "within"),
    [
        # At rest, or reversed.
        (0.51, 0.02, AT_ONCE),
        (0.49, 0.02, BY_MEAN),
        (1.0, 0.04, AT_ONCE),
        (1.0, 0.06, BY_MEAN),
        (4.0, 0.19, AT_ONCE),
        (4.0, 0.21, BY_MEAN),
        (1.0, -1.0, AT_ONCE),
        # Faster than twice the command and 1 °/s.
        (1.0, 3.05, AT_ONCE),
        (1.0, 2.95, BY_MEAN),
        (0.1, 1.25, AT_ONCE),
        (0.1, 1.15, BY_MEAN),
        # The mean within half of the largest rate and 0.1 °/s of the command.
        (1.0, 0.41, NEVER),
        (1.0, 0.39, BY_MEAN),
        (1.0, 1.59, NEVER),
        (1.0, 1.61, BY_MEAN),
        (0.1, -0.04, NEVER),
        (0.1, -0.06, BY_MEAN),
    ],
)
def test_a_mount_disobeys_from_the_bound_on_and_as_soon_as_is_told(
    told: float, moved: float, within: tuple[float, float] | None, sense: float, axis: int
) -> None:
    rates = [tuple(sense * x if k == axis else 0.0 for k in (0, 1)) for x in (told, moved)]
    found = tripped_s([(rates[0], rates[1])] * 200)  # type: ignore[list-item]
    assert found is None if within is None else found is not None and within[0] <= found <= within[1]


@pytest.mark.parametrize("fault_s", [0.0, 1.0, 3.0])
def test_what_was_commanded_in_the_longest_fault_counts(fault_s: float) -> None:
    """A mount goes on at 1 °/s after it was told 0.3: of 3 s, the mean may be 0.3 + 0.1 + 0.15 °/s."""
    for late_s, obeys in ((fault_s + 0.9, True), (fault_s + 1.8, False)):
        pairs = [((1.0, 0.0), (1.0, 0.0))] * 100 + [((0.3, 0.0), (1.0, 0.0))] * round(late_s / PERIOD_S)
        assert (tripped_s([*pairs, *[((0.3, 0.0), (0.3, 0.0))] * 100], fault_s) is None) == obeys


@pytest.mark.parametrize("fault_s", [0.0, 1.0, 2.0])
def test_a_command_that_is_lost_is_not_disobeyed(fault_s: float) -> None:
    found = tripped_s([((1.0, 0.0), (0.0, 0.0))] * 200, fault_s)
    assert found == pytest.approx(1.0 + fault_s + PERIOD_S, abs=1.1 * PERIOD_S)


def test_what_is_disobeyed_now_and_then_is_no_disobedience() -> None:
    stays, obeys = ((1.0, 0.0), (0.0, 0.0)), ((1.0, 0.0), (1.2, 0.0))
    assert tripped_s(([stays] * 18 + [obeys] * 20) * 10) is None


@pytest.mark.parametrize(
    ("step", "tripped"), [((39.0, 0.0), True), ((41.0, 0.0), False), ((0.0, -41.0), False)]
)
def test_a_sync_says_nothing_of_the_drives_and_what_axes_can_do_does(step: Rates, tripped: bool) -> None:
    """A step of 2° in one period makes a mean of 0.65 °/s over 3 s, 0.25 °/s being let through."""
    told = (0.1, 0.0)
    pairs = [(told, told)] * 30 + [(told, step)] + [(told, told)] * 100
    assert (tripped_s(pairs) is not None) == tripped


@pytest.mark.parametrize("axis", [0, 1])
def test_after_a_sync_the_window_begins_anew(axis: int) -> None:
    told, rests = tuple(0.3 * (k == axis) for k in (0, 1)), (0.0, 0.0)
    pairs = [(told, told)] * 30 + [(told, (41.0, 0.0))] + [(told, rests)] * 100
    found = tripped_s(pairs)  # type: ignore[arg-type]
    assert found is not None
    assert BY_MEAN[0] <= found - 31 * PERIOD_S <= BY_MEAN[1]


def test_another_motion_begins_anew_and_so_does_a_stream_that_was_interrupted() -> None:
    watching = watch()
    for _ in range(4):
        for _ in range(18):
            assert watching.see_motion(MoveAxes(0.0, 0.0), MoveAxes(1.0, 0.0), PERIOD_S) is None
        assert watching.see_motion(MoveAxes(0.0, 0.0), Hold(), PERIOD_S) is None
    for rates in (MoveAxes(1.0, 0.0), MoveAxes(-1.0, 0.0)):
        for _ in range(100):
            assert watching.see_motion(rates, rates, PERIOD_S) is None
        assert watching.see_motion(rates, Hold(), PERIOD_S) is None
    for k in range(4):
        # Half a second is more than what may lie between two statuses.
        for j in range(25):
            seen = Seen(None, 10.0 * k + j * PERIOD_S * SIDEREAL_RATE_DEG_S, 40.0, 0.01 * j)
            assert watching.see(seen, MoveAxes(0.0, 0.6)) is None


def test_what_was_commanded_before_another_motion_allows_nothing_after_it() -> None:
    watching, told, moved = watch(), MoveAxes(0.1, 0.0), MoveAxes(0.6, 0.0)
    for _ in range(100):
        assert watching.see_motion(MoveAxes(1.0, 0.0), MoveAxes(1.0, 0.0), PERIOD_S) is None
    watching.see_motion(told, Hold(), PERIOD_S)
    seen = [watching.see_motion(moved, told, PERIOD_S) is not None for _ in range(80)]
    assert BY_MEAN[0] <= PERIOD_S * (seen.index(True) + 1) <= BY_MEAN[1]


def statuses(count: int, **known: float) -> list[Seen]:
    # The mount's sidereal time goes through 0h.
    times_deg = [(359.9995 + k * PERIOD_S * SIDEREAL_RATE_DEG_S) % 360.0 for k in range(count)]
    return [Seen(None, times_deg[k], 359.99 + 0.005 * k, 20.0 - 0.01 * k, **known) for k in range(count)]


def disobeyed_s(
    steps_s: Iterable[float], fault_s: float = 1.0, moved: float = -3.0, clock_steps_s: float = 0.0
) -> float | None:
    """Return when an axis that is to go at 0.2 °/s and goes at another rate is found out, seconds."""
    watching, at_s, ra_deg = watch(fault_s), 0.0, 100.0
    for step_s in steps_s:
        at_s, ra_deg = at_s + step_s, ra_deg + moved * step_s
        clock_s = clock_steps_s * math.floor(at_s / clock_steps_s + 1e-9) if clock_steps_s else at_s
        seen = Seen(None, clock_s * SIDEREAL_RATE_DEG_S, ra_deg % 360.0, 20.0)
        if watching.see(seen, MoveAxes(0.2, 0.0)) is not None:
            return at_s
    return None


@pytest.mark.parametrize("step_s", [0.1, 0.3, 0.49, 0.51, 0.53, 0.59, 1.0, 1.9])
def test_a_mount_that_runs_away_is_found_out_however_seldom_its_statuses_come(step_s: float) -> None:
    tripped_s = disobeyed_s([step_s] * 60)
    # Five steps tell how often they come. Then 2 s count, or three steps where those are longer.
    assert tripped_s is not None
    assert tripped_s <= 6.0 * step_s + max(2.0 + step_s, 3.0 * step_s)
    assert disobeyed_s([step_s] * 60, moved=0.2) is None


@pytest.mark.parametrize("clock_steps_s", [0.1, 0.3, 1.0])
def test_a_mount_whose_clock_goes_in_steps_is_found_out_as_well(clock_steps_s: float) -> None:
    steps_s = [PERIOD_S] * 400
    tripped_s = disobeyed_s(steps_s, clock_steps_s=clock_steps_s)
    assert tripped_s is not None
    assert tripped_s <= 7.0 * clock_steps_s + max(2.0 + clock_steps_s, 3.0 * clock_steps_s)
    assert disobeyed_s(steps_s, moved=0.2, clock_steps_s=clock_steps_s) is None


def test_a_slow_mount_that_leaves_out_a_status_or_sends_one_sooner_is_found_out_as_well() -> None:
    for seed in range(20):
        draw = np.random.default_rng(seed)
        tripped_s = disobeyed_s(draw.choice([0.2, 0.55, 0.6, 1.1], 40, p=[0.1, 0.4, 0.4, 0.1]))
        assert tripped_s is not None
        assert tripped_s < 8.0


def test_gaps_between_statuses_that_come_twenty_times_a_second_are_not_counted() -> None:
    gaps = ([PERIOD_S] * 3 + [0.6]) * 200
    # Of 0.75 s only 0.15 s count: two of them are over after 2.05 s of those.
    assert disobeyed_s(gaps) == pytest.approx(2.05 * 0.75 / 0.15, abs=0.8)


@pytest.mark.parametrize("fault_s", [0.3, 1.0])
@pytest.mark.parametrize("step_s", [0.51, 0.7, 1.0, 1.5, 1.9])
@pytest.mark.parametrize("before", [None, 0.0, 3.0, -0.1])
def test_slow_statuses_find_nothing_in_a_mount_that_obeys(
    step_s: float, fault_s: float, before: float | None
) -> None:
    """A mount begins, or turns round, at any time between two statuses; 0.3 s late, with 5 °/s²."""
    for part in np.linspace(0.0, 0.999, 12):
        watching, ra_deg, rate, asked = watch(fault_s), 100.0, before or 0.0, [before] * 30
        for k in range(1, 2001):
            at_s = 0.01 * k
            changed = at_s > step_s * (6.0 + part)
            asked = [*asked[1:], -3.0 if changed else before]
            wanted = asked[0] or 0.0
            rate += max(-0.05, min(0.05, wanted - rate))
            ra_deg += 0.01 * rate
            if at_s // step_s > (at_s - 0.01) // step_s:
                now = asked[-1]
                seen = Seen(None, at_s * SIDEREAL_RATE_DEG_S, ra_deg % 360.0, 20.0)
                assert watching.see(seen, Hold() if now is None else MoveAxes(now, 0.0)) is None


@pytest.mark.parametrize("step_s", [0.6, 0.9])
def test_one_slow_status_alone_is_no_proof(step_s: float) -> None:
    profile = replace(PROFILE, ra=AxisLimits(max_current_a=4.0))
    watching, found = watch(1.0, profile), []
    for k in range(40):
        # A bit turned over has the axis jump there and back, and its current be large.
        wrong = k == 20
        ra_deg = 100.0 + 0.2 * k * step_s + 3.0 * wrong
        seen = Seen(None, k * step_s * SIDEREAL_RATE_DEG_S, ra_deg, 20.0, ra_current_a=5.0 * wrong)
        found.append(watching.see(seen, MoveAxes(0.2, 0.0)))
    assert found == [None] * 40


def test_rates_between_statuses_are_differences_round_the_circle() -> None:
    watching = watch()
    for seen in statuses(5):
        begun = watching.seconds_to(seen) > 0.0
        watching.moved = MoveAxes(0.0, 0.0)
        watching.see(replace(seen, ra_deg=seen.ra_deg % 360.0), Hold())
        rates = (0.1, -0.2) if begun else (0.0, 0.0)
        assert (watching.moved.ra_rate_deg_s, watching.moved.dec_rate_deg_s) == pytest.approx(rates)


def test_seconds_between_statuses_are_by_our_clock_where_it_is_known() -> None:
    first = Seen(UTC_S, 359.9, 10.0, 20.0)
    later_deg = (359.9 + 20.0 * SIDEREAL_RATE_DEG_S) % 360.0
    watching = watch()
    assert watching.seconds_to(first) == 0.0
    watching.see(first, Hold())
    assert watching.seconds_to(Seen(UTC_S + 3.0, later_deg, 10.0, 20.0)) == 3.0
    assert watching.seconds_to(Seen(None, later_deg, 10.0, 20.0)) == pytest.approx(20.0)


@pytest.mark.parametrize("axis", ["ra", "dec"])
def test_a_current_trips_after_half_a_second_without_a_break(axis: str) -> None:
    profile = replace(PROFILE, **{axis: AxisLimits(max_current_a=4.0)})
    other = "dec" if axis == "ra" else "ra"
    for amperes, breaks, tripped in ((-4.1, 99, True), (4.1, 99, True), (3.9, 99, False), (4.1, 8, False)):
        watching, found = watch(profile=profile), []
        for k, seen in enumerate(statuses(40, **{f"{other}_current_a": 99.0})):
            now = 0.0 if k % breaks == breaks - 1 else amperes
            found.append(watching.see(replace(seen, **{f"{axis}_current_a": now}), Hold()))
        assert ("current" in found) == tripped
        # The tenth step makes half a second, the eleventh more.
        assert not tripped or found.index("current") in (10, 11)


@pytest.mark.parametrize(("off_s", "is_off"), [(59.0, False), (-59.0, False), (61.0, True), (-61.0, True)])
def test_a_clock_is_off_by_more_than_its_tolerance(off_s: float, is_off: bool) -> None:
    gmst_deg = math.degrees(erfa.gmst82(2440587.5, UTC_S / 86400.0))
    off_deg = off_s * SIDEREAL_RATE_DEG_S
    right, wrong = (Seen(UTC_S, (gmst_deg + EAST_DEG + more) % 360.0, 10.0, 20.0) for more in (0.0, off_deg))
    watching = watch()
    assert watching.see(wrong, Hold()) == ("clock" if is_off else None)
    assert watching.clock_is_off == is_off
    assert watching.clock_gap_deg == pytest.approx(abs(off_deg), abs=1e-3)
    watching = watch()
    assert watching.see(right, Hold()) is None
    found = [watching.see(wrong, Hold()) for _ in range(3)]
    # A clock that was well is believed to be off by three statuses, and to be well again by one.
    assert found == [None, None, "clock" if is_off else None]
    assert [watching.see(right, Hold()), watching.clock_gap_deg] == [None, pytest.approx(0.0, abs=1e-3)]
    assert Watch(PROFILE, 0.0, None, 60.0).see(wrong, Hold()) is None


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (-0.6, "other sign in declination: turn dec_rate_sign"),
        (-0.4, None),
        (0.08, "does not move"),
        (0.12, None),
    ],
)
@pytest.mark.parametrize("beyond_pole", [False, True])
def test_what_an_axis_makes_of_its_command_tells_the_cause(
    gain: float, words: str | None, beyond_pole: bool
) -> None:
    watching = watch()
    watching.see(Seen(None, 0.0, 10.0, 20.0, beyond_pole), Hold())
    while watching.see_motion(MoveAxes(0.8, gain), MoveAxes(0.8, 1.0), PERIOD_S) is None:
        pass
    assert watching.cause is None if words is None else words in str(watching.cause)
    assert ("sign_beyond_pole" in str(watching.cause)) == (beyond_pole and gain == -0.6)


@pytest.mark.parametrize(
    ("told", "words"), [(0.019, "declination does not move"), (-0.021, "neither axis changes its rate")]
)
def test_of_an_axis_that_is_told_next_to_nothing_no_standing_still_is_told(told: float, words: str) -> None:
    watching = watch()
    while watching.see_motion(MoveAxes(0.0, 0.0), MoveAxes(told, 1.0), PERIOD_S) is None:
        pass
    assert words in str(watching.cause)


# A mount of edges behind a profile that says held: it goes on at the first rates.


def keeps_first(
    seconds: float = 3.0,
    spread_deg_s: float = 0.1,
    kept: Rates = (0.3, 0.2),
    first: Rates = (0.3, 0.2),
    taken: int = 0,
    noise_deg_s: float = 0.0,
    others: int = 0,
    profile: MountProfile = PROFILE,
) -> bool:
    """Tell commands that drift by so much a second; return whether the mount is seen to keep one of them.

    So many `others` were told in a stream before, which a hold has ended.
    """
    watching = watch(profile=profile)
    for told in [MoveAxes(-1.0, 1.0)] * others:
        watching.see_motion(told, told, PERIOD_S)
    watching.see_motion(MoveAxes(0.0, 0.0), Hold(), PERIOD_S)
    count = round(seconds / PERIOD_S)
    for k in range(count):
        drift = spread_deg_s * k * PERIOD_S
        told = first if k == taken else (1.0, -1.0) if k < 8 else (0.3 + drift, 0.2 + drift)
        noise = noise_deg_s * (-1) ** k
        watching.see_motion(MoveAxes(kept[0] + noise, kept[1]), MoveAxes(*told), PERIOD_S)
    return watching.keeps_first


@pytest.mark.parametrize(
    ("known", "kept"),
    [
        ({}, True),
        ({"profile": replace(PROFILE, move_axis="edge")}, False),
        ({"seconds": 2.4}, False),
        ({"seconds": 2.6}, True),
        # Of 3 s the last 2 count, and of those the first 1.25: the middle four fifths of these vary by 0.05.
        ({"spread_deg_s": 0.047}, False),
        ({"spread_deg_s": 0.053}, True),
        # 0.002 °/s and a twentieth.
        ({"kept": (0.316, 0.2)}, True),
        ({"kept": (0.318, 0.2)}, False),
        ({"kept": (0.3, 0.189)}, True),
        ({"kept": (0.3, 0.187)}, False),
        # 0.002 °/s and a fiftieth, from side to side.
        ({"noise_deg_s": 0.0038}, True),
        ({"noise_deg_s": 0.0042}, False),
        # One of the first eight.
        ({"taken": 7}, True),
        ({"taken": 8}, False),
        ({"others": 10}, True),
        # Both axes at one rate, to a fiftieth, may be held by something else.
        *(
            ({"kept": (SIDEREAL_RATE_DEG_S - rate, 0.2), "first": (SIDEREAL_RATE_DEG_S - rate, 0.2)}, kept)
            for rate, kept in ((0.2, False), (-0.2, False), (0.203, False), (0.205, True), (-0.195, True))
        ),
    ],
)
def test_a_mount_keeps_the_first_rates_where_nothing_else_explains_it(
    known: dict[str, float], kept: bool
) -> None:
    assert keeps_first(**known) == kept  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("most", "kept"), [((0.36, 0.23), True), ((0.30, 0.23), True), ((0.30, 0.21), False)]
)
def test_axes_at_their_limits_keep_no_first_rates(most: Rates, kept: bool) -> None:
    """The axes go 0.296 and 0.2 °/s: nine tenths of 0.329 and 0.222."""
    ra, dec = (AxisLimits(max_rate_deg_s=rate) for rate in most)
    assert keeps_first(profile=replace(PROFILE, ra=ra, dec=dec)) == kept


def test_a_spread_leaves_a_tenth_out_at_either_end() -> None:
    assert _spread([float(k) for k in range(9)]) == 8.0
    assert _spread([float(k) for k in range(10)]) == 7.0
    assert _spread([100.0, *map(float, range(20)), -100.0]) == 17.0


# Axes that lie elsewhere, by blocks of 0.4 s. Commands go round a circle in eight blocks, 0.3 °/s large.

BLOCK_S = 0.4


def axes_watch(
    comes_out: Callable[[int, float, float], Rates],
    blocks: int = 20,
    size: float = 0.3,
    dec_deg: float = 40.0,
    turns_deg: Rates = (45.0, 45.0),
) -> AxesWatch:
    """Let a mount of azimuth and altitude make something of such commands."""
    watching, at = AxesWatch(), Seen(None, 0.0, 10.0, dec_deg)
    for k in range(blocks):
        one, other = (math.radians(k * turn) for turn in turns_deg)
        first, second = size * math.cos(one), size * math.sin(other)
        went = comes_out(k, first, second)
        told, moved = (MoveAxes(SIDEREAL_RATE_DEG_S - one, other) for one, other in ((first, second), went))
        watching.see(BLOCK_S, moved, told, at)
    return watching


UNLIKE_DEG = (45.0, 22.5)
"""No circle, of which half a turn would be the other sign of both axes."""


def turned_by(angle_deg: float, gain: float = 1.0) -> Callable[[int, float, float], Rates]:
    c, s = gain * math.cos(math.radians(angle_deg)), gain * math.sin(math.radians(angle_deg))
    return lambda _, first, second: (c * first - s * second, s * first + c * second)


@pytest.mark.parametrize(("angle_deg", "askew"), [(0.0, False), (21.0, False), (24.5, True), (40.0, True)])
def test_axes_lie_elsewhere_where_gains_leave_more_than_a_seventh_of_the_motion(
    angle_deg: float, askew: bool
) -> None:
    """Turned ahead by an angle, gains leave its sine squared, 0.15 at 22.8°; both rates together, nothing."""
    assert axes_watch(turned_by(angle_deg)).askew == askew
    assert axes_watch(turned_by(angle_deg), dec_deg=79.0).askew == askew
    # Near the pole, of few blocks, and of motions slower than 0.04 °/s nothing is told.
    assert not axes_watch(turned_by(angle_deg), dec_deg=-81.0).askew
    assert not axes_watch(turned_by(angle_deg), blocks=9).askew
    assert axes_watch(turned_by(angle_deg), blocks=10).askew == askew
    assert not axes_watch(turned_by(angle_deg), size=0.038).askew
    assert axes_watch(turned_by(angle_deg), size=0.042).askew == askew


@pytest.mark.parametrize("by", [None, "another motion", "the pole", "silence"])
def test_blocks_from_before_the_pole_or_another_motion_are_forgotten(by: str | None) -> None:
    watching, still = axes_watch(turned_by(40.0), blocks=9), MoveAxes(0.0, 0.0)
    if by == "another motion":
        watching.forget()
    elif by is not None:
        at = None if by == "silence" else Seen(None, 0.0, 10.0, -81.0)
        watching.see(PERIOD_S, still, still, at)
    at = Seen(None, 0.0, 10.0, 40.0)
    for k in range(9, 18):
        first, second = 0.3 * math.cos(math.radians(45.0 * k)), 0.3 * math.sin(math.radians(45.0 * k))
        went = turned_by(40.0)(k, first, second)
        told, moved = (MoveAxes(SIDEREAL_RATE_DEG_S - x, y) for x, y in ((first, second), went))
        watching.see(BLOCK_S, moved, told, at)
    assert watching.askew == (by is None)


@pytest.mark.parametrize("holds", [True, False])
def test_axes_that_lie_elsewhere_are_told_of_one_stream_only(holds: bool) -> None:
    """Ten blocks are enough, of which a hold in the middle leaves nine."""
    geometry, stands_at = AxisGeometry(0.0, 90.0), SitePlace(52.0, EAST_DEG)
    watching, found = watch(1.0, replace(PROFILE, geometry=geometry, stands_at=stands_at)), set()
    watching.see(Seen(None, 0.0, 10.0, 40.0), Hold())
    for k in range(18):
        if holds and k == 9:
            watching.see_motion(MoveAxes(0.0, 0.0), Hold(), BLOCK_S)
        first, second = 0.3 * math.cos(math.radians(45.0 * k)), 0.3 * math.sin(math.radians(45.0 * k))
        went = turned_by(40.0)(k, first, second)
        told, moved = (MoveAxes(SIDEREAL_RATE_DEG_S - x, y) for x, y in ((first, second), went))
        found.add(watching.see_motion(moved, told, BLOCK_S))
    assert ("obedience" in found) == (not holds)


def test_a_mount_that_strayed_while_nothing_was_heard_has_no_cause_that_is_known() -> None:
    """As by a computer that slept while rates led the mount."""
    geometry, stands_at = AxisGeometry(0.0, 90.0), SitePlace(52.0, EAST_DEG)
    watching = watch(1.0, replace(PROFILE, geometry=geometry, stands_at=stands_at))
    watching.stray()
    assert watching.cause is None


@pytest.mark.parametrize(("share", "askew"), [(0.3, True), (0.37, True), (0.43, False), (0.6, False)])
def test_motion_that_nothing_explains_is_no_sign_of_axes_that_lie_elsewhere(
    share: float, askew: bool
) -> None:
    """The other part has three times the circle's frequency: it goes with none of the commands."""
    left = math.sin(math.radians(35.0)) ** 2 * 0.3**2
    wave = math.sqrt(2.0 * left * share / (1.0 - share))

    def comes_out(k: int, first: float, second: float) -> Rates:
        one, other = turned_by(35.0)(k, first, second)
        return one + wave * math.cos(math.radians(135.0 * k)), other

    assert axes_watch(comes_out).askew == askew


@pytest.mark.parametrize(("turn_deg", "size"), [(60.0, 0.24), (120.0, 0.14)])
@pytest.mark.parametrize(("late", "share"), [(1, 1.0), (4, 1.0), (1, 0.5), (2, 0.5)])
def test_a_servo_that_comes_late_is_no_sign_of_axes_that_lie_elsewhere(
    late: int, share: float, turn_deg: float, size: float
) -> None:
    """By one block, by four, by half a block, by one and a half: each would be a turn of the axes."""

    def comes_out(k: int, *_: float) -> Rates:
        before, soon = (
            (size * math.cos(math.radians(turn_deg * n)), size * math.sin(math.radians(turn_deg * n)))
            for n in (k - late, k - late + 1)
        )
        return share * before[0] + (1.0 - share) * soon[0], share * before[1] + (1.0 - share) * soon[1]

    assert not axes_watch(comes_out, size=size, turns_deg=(turn_deg, turn_deg)).askew


def test_what_follows_a_jump_of_the_command_is_not_looked_at() -> None:
    watching, at = AxesWatch(), Seen(None, 0.0, 10.0, 40.0)
    for k in range(20):
        first, second = ((0.4, 0.0), (0.0, 0.4), (-0.4, 0.0), (0.0, -0.4))[k // 3 % 4]
        went = turned_by(40.0)(k, first, second)
        told, moved = (MoveAxes(SIDEREAL_RATE_DEG_S - one, other) for one, other in ((first, second), went))
        watching.see(BLOCK_S, moved, told, at)
        assert not watching.askew


@pytest.mark.parametrize("blocks", [4, 11, 12, 20])
@pytest.mark.parametrize("signs", [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
def test_signs_that_are_turned_are_told_of_each_axis(signs: Rates, blocks: int) -> None:
    found = axes_watch(lambda _, one, other: (signs[0] * one, signs[1] * other), blocks, turns_deg=UNLIKE_DEG)
    assert found.turned() == (signs[0] < 0.0, signs[1] < 0.0)


@pytest.mark.parametrize(("share", "known"), [(0.2, True), (0.28, True), (0.32, False), (0.5, False)])
def test_signs_explain_nothing_where_they_leave_three_tenths_of_the_motion(share: float, known: bool) -> None:
    wave = math.sqrt(2.0 * 0.3**2 * share / (1.0 - share))

    def comes_out(k: int, first: float, second: float) -> Rates:
        return first + wave * math.cos(math.radians(135.0 * k)), -second

    assert axes_watch(comes_out, turns_deg=UNLIKE_DEG).turned() == ((False, True) if known else None)


def test_of_axes_that_rest_no_sign_is_told() -> None:
    assert axes_watch(lambda *_: (0.0, 0.0)).turned() == (False, False)


def test_gains_and_mixtures_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        asked, went = rng.normal(size=(12, 2)), rng.normal(size=(12, 2)) + 0.5
        pairs = [list(map(tuple, one.tolist())) for one in (asked, went)]
        for axis in (0, 1):
            for sense in (1.0, -1.0):
                best = float(
                    np.linalg.lstsq(sense * asked[:, axis : axis + 1], went[:, axis], rcond=None)[0][0]
                )
                gain = min(1.6, max(0.4, best))
                left = float(((went[:, axis] - gain * sense * asked[:, axis]) ** 2).sum())
                assert _by_gain(pairs[0], pairs[1], axis, sense) == pytest.approx((gain, left))
            left = float(np.linalg.lstsq(asked, went[:, axis], rcond=None)[1][0])
            assert _left_by_both(pairs[0], pairs[1], axis) == pytest.approx(left)
    assert _by_gain([(0.0, 1.0)], [(0.5, 0.0)], 0) == (1.0, 0.25)
    # A servo's gain is taken to be between 0.4 and 1.6.
    assert _by_gain([(1.0, 0.0)], [(2.0, 0.0)], 0) == pytest.approx((1.6, 0.16))
    assert _by_gain([(1.0, 0.0)], [(0.2, 0.0)], 0) == pytest.approx((0.4, 0.04))
    assert _left_by_both([(0.0, 0.0)], [(0.5, 0.0)], 0) == pytest.approx(0.25)


# Places that are believed: axes go at most 1.5 times as fast as slews, 15 °/s, and half a degree besides.

HERE, STILL = Place(10.0, 20.0), MoveAxes(0.0, 0.0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("seconds", "most_deg"), [(0.05, 1.25), (1.0, 15.5)])
def test_a_place_is_doubted_where_axes_cannot_have_come(
    axis: int, sense: float, seconds: float, most_deg: float
) -> None:
    for off_deg, believed in ((most_deg - 0.01, True), (most_deg + 0.01, False)):
        follows = PositionFilter(PROFILE)
        there = Place(*(x + sense * off_deg * (k == axis) for k, x in enumerate(HERE)))
        assert [follows.see(HERE, 0.0, STILL), follows.see(HERE, 0.05, STILL)] == [
            Belief.ANEW,
            Belief.GOES_ON,
        ]
        assert follows.see(there, seconds, STILL) is (Belief.GOES_ON if believed else Belief.DOUBTED)
        assert follows.former == (None if believed else Former(HERE, seconds))


def test_axes_that_slew_slower_than_they_follow_are_believed_at_both_rates() -> None:
    slow = AxisLimits(max_rate_deg_s=6.0, slew_rate_deg_s=1.0)
    follows = PositionFilter(replace(PROFILE, ra=slow, dec=slow))
    for step in range(5):
        seen = follows.see(Place(HERE.ha_deg + 6.0 * step, HERE.dec_deg), 1.0 if step else 0.0, STILL)
        assert seen is (Belief.GOES_ON if step else Belief.ANEW)


def test_a_place_is_borne_out_by_the_third_status_that_goes_with_it() -> None:
    far, farther = Place(50.0, 20.0), Place(90.0, 20.0)
    follows, fast = PositionFilter(PROFILE), MoveAxes(1.0, 2.0)
    first, second = follows.see(HERE, 0.0, STILL), follows.see(HERE, 0.05, fast)
    assert (first, second, follows.moved) == (Belief.ANEW, Belief.GOES_ON, fast)
    for place in (far, far, farther, farther):
        assert follows.see(place, 0.05, STILL) is Belief.DOUBTED
        assert follows.moved == fast
    assert follows.former == Former(HERE, pytest.approx(0.2))
    assert follows.see(farther, 0.05, STILL) is Belief.BORNE_OUT
    assert (follows.moved, follows.former) == (STILL, None)
    # Back where it was, the rates between are none of the axes'.
    follows.see(HERE, 0.05, fast)
    assert follows.see(farther, 0.05, fast) is Belief.GOES_ON
    assert follows.moved == STILL
    assert follows.see(farther, 0.05, fast) is Belief.GOES_ON
    assert follows.moved == fast


def test_a_first_place_that_nothing_has_borne_out_gives_way_at_once() -> None:
    follows = PositionFilter(PROFILE)
    places = (HERE, Place(50.0, 20.0), Place(-50.0, 20.0), Place(-50.1, 20.0), HERE)
    assert [follows.see(place, 0.05, STILL) for place in places] == [
        Belief.ANEW, Belief.ANEW, Belief.ANEW, Belief.GOES_ON, Belief.DOUBTED,
    ]  # fmt: skip

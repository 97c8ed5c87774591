"""Mounts that take rates by their flags otherwise than the profile says, and those that only seem to."""

from __future__ import annotations

import math
from types import SimpleNamespace as Made
from typing import TYPE_CHECKING, Any

import family
import pytest
import wrong_profiles

from sattrack.control.edges import DOUBTED_AFTER, ONLY_WHILE_UP, EdgeWatch, FlagTrial
from sattrack.mount.model import Hold, MoveAxes

if TYPE_CHECKING:
    from collections.abc import Callable

PERIOD_S = 0.05
TARGET: Any = Made(ra_rate_deg_s=0.2, dec_rate_deg_s=-0.1)
SLOW: Any = Made(ra_rate_deg_s=0.01, dec_rate_deg_s=0.01)


def learning(ratios: tuple[float | None, ...] = (None, None), begun_anew: int = DOUBTED_AFTER) -> Any:
    fits = [Made(ratio=ratio) for ratio in ratios]
    made = Made(fits=fits, times_begun_anew=begun_anew, forgotten=0)

    def forget() -> None:
        made.forgotten += 1

    made.forget_rates = forget
    return made


def missed(
    watch: EdgeWatch, seconds: float, seen: Any, unanswered_s: float = 0.0, target: Any = TARGET
) -> None:
    watch.miss(seconds, seconds, seen, unanswered_s, target)


def tried(place: Callable[[float], float], seconds: float = 10.0) -> tuple[EdgeWatch, float | None]:
    """Return a watch after a trial, and when it ended.

    `place` is how many seconds of what is commanded have come by an instant of it.
    """
    watch, ended_s = EdgeWatch(True), None
    missed(watch, 5.1, learning())
    begun_s = 5.1
    for number in range(int(seconds / PERIOD_S)):
        now_s = begun_s + number * PERIOD_S
        on_trial = watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(0.2, -0.1)
        ended_s = now_s - begun_s if ended_s is None and not on_trial else ended_s
        way = place(now_s - begun_s)
        watch.see(now_s, (359.9 + 0.2 * way) % 360.0, 20.0 - 0.1 * way)
    return watch, ended_s


class TestTrial:
    def test_axes_that_go_on_without_flags_take_edges(self) -> None:
        watch, ended_s = tried(lambda t: t)
        assert watch.why is None
        assert ended_s == pytest.approx(1.6, abs=0.11)

    def test_axes_that_stand_without_flags_do_not(self) -> None:
        watch, ended_s = tried(lambda t: min(t, 0.3))
        assert watch.why == ONLY_WHILE_UP
        assert ended_s == pytest.approx(1.6, abs=0.11)

    def test_axes_that_make_up_for_what_they_owe_are_waited_for(self) -> None:
        """They go on for two seconds, ever more slowly."""
        watch, ended_s = tried(lambda t: 2.0 - 0.5 * max(0.0, 2.0 - t) ** 2)
        assert watch.why == ONLY_WHILE_UP
        assert ended_s is not None
        assert 2.0 < ended_s < 3.2

    def test_axes_that_swing_show_nothing(self) -> None:
        assert tried(lambda t: math.sin(4.0 * t))[0].why is None

    def test_axes_that_are_never_steady_show_nothing_and_it_ends(self) -> None:
        watch, ended_s = tried(lambda t: 0.5 * t * t)
        assert watch.why is None
        assert ended_s == pytest.approx(5.6, abs=0.11)

    def test_axes_that_do_half_show_nothing(self) -> None:
        assert tried(lambda t: 0.5 * t)[0].why is None

    def test_a_gap_in_what_is_seen_is_no_standstill(self) -> None:
        watch = EdgeWatch(True)
        missed(watch, 5.1, learning())
        for now_s in (5.7, 6.8, 7.9):
            watch.see(now_s, 0.0, 0.0)
        assert watch.why is None
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(0.2, -0.1)

    def test_a_clock_that_is_set_back_ends_it(self) -> None:
        watch = EdgeWatch(True)
        missed(watch, 5.1, learning())
        watch.see(5.0, 0.0, 0.0)
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(1.0, 1.0)
        assert watch.why is None

    def test_other_motion_ends_it(self) -> None:
        for wanted, acquiring in ((Hold(), True), (MoveAxes(1.0, 1.0), False)):
            watch = EdgeWatch(True)
            missed(watch, 5.1, learning())
            assert watch.motion(wanted, acquiring) == wanted
            assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(1.0, 1.0)

    def test_what_safety_changes_ends_it(self) -> None:
        watch = EdgeWatch(True)
        missed(watch, 5.1, learning())
        watch.sent(MoveAxes(0.2, -0.1))
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(0.2, -0.1)
        watch.sent(MoveAxes(0.2, 0.0))
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(1.0, 1.0)

    def test_it_begins_once_and_only_where_filters_begin_anew_and_the_target_moves(self) -> None:
        def begins(seen: Any, seconds: float = 5.1, target: Any = TARGET, by_edges: bool = True) -> bool:
            watch = EdgeWatch(by_edges)
            missed(watch, seconds, seen, target=target)
            return watch.motion(MoveAxes(1.0, 1.0), True) != MoveAxes(1.0, 1.0)

        assert begins(learning())
        assert not begins(learning(begun_anew=DOUBTED_AFTER - 1))
        assert not begins(learning(), seconds=4.9)
        assert not begins(learning(), target=SLOW)
        assert not begins(learning(), target=None)
        assert not begins(learning(), by_edges=False)
        watch, _ = tried(lambda t: t)
        missed(watch, 5.1, learning(begun_anew=20))
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(1.0, 1.0)

    def test_no_axis_is_faster_in_it_than_a_mount_that_stands_may_be_off(self) -> None:
        assert FlagTrial.rates_for(Made(ra_rate_deg_s=-1.2, dec_rate_deg_s=0.6)) == MoveAxes(-0.3, 0.15)


class TestDoubt:
    def test_axes_that_make_half_of_what_is_commanded_are_tried(self) -> None:
        """A soft servo that makes up for what it owes makes as much, too."""
        watch = EdgeWatch(True)
        missed(watch, 5.1, learning((0.5, None), 0))
        assert watch.why is None
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(0.2, -0.1)

    @pytest.mark.parametrize("ratios", [(0.5, 0.9), (0.1, 0.5), (None, None)])
    def test_axes_that_make_all_or_nothing_are_not(self, ratios: Any) -> None:
        watch = EdgeWatch(True)
        missed(watch, 5.1, learning(ratios, 0))
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(1.0, 1.0)

    def test_where_the_target_hardly_moves_what_came_of_the_rates_decides(self) -> None:
        watch = EdgeWatch(True)
        missed(watch, 5.1, learning((0.5, 0.5), 0), target=SLOW)
        assert watch.why == ONLY_WHILE_UP

    def test_what_came_of_rates_that_were_not_taken_does_not_count(self) -> None:
        """A mount that refuses rates while it slews was called one that moves only while the flag is up."""
        watch, seen = EdgeWatch(True), learning((0.5, 0.5), 0)
        missed(watch, 4.0, seen, unanswered_s=1.6, target=SLOW)
        missed(watch, 3.0, seen, target=SLOW)
        assert (watch.why, seen.forgotten) == (None, 1)
        missed(watch, 5.1, seen, target=SLOW)
        assert (watch.why, seen.forgotten) == (ONLY_WHILE_UP, 1)

    def test_filters_that_began_anew_before_do_not_count(self) -> None:
        watch = EdgeWatch(True)
        missed(watch, 1.0, learning(begun_anew=0), unanswered_s=1.6)
        missed(watch, 1.0, learning(begun_anew=3))
        missed(watch, 5.1, learning(begun_anew=3 + DOUBTED_AFTER - 1))
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(1.0, 1.0)
        missed(watch, 0.1, learning(begun_anew=3 + DOUBTED_AFTER))
        assert watch.motion(MoveAxes(1.0, 1.0), True) == MoveAxes(0.2, -0.1)

    def test_a_mount_that_answers_no_edge_is_watched_for_longer(self) -> None:
        watch = EdgeWatch(True)
        missed(watch, 14.9, learning((0.5, 0.5)), unanswered_s=1.6, target=SLOW)
        assert watch.why is None
        missed(watch, 0.2, learning((0.5, 0.5)), unanswered_s=1.6, target=SLOW)
        assert watch.why == ONLY_WHILE_UP


class TestStrangers:
    """Mounts of `bench/strangers`, by `bench/wrong_profiles.py`."""

    @pytest.mark.parametrize(
        ("number", "case"),
        [
            # A third to a half of what was commanded came.
            (1000, "edge told for held"),
            # Servos that make up for what they owe. They went on for the whole pass.
            (1009, "edge told for held"),
            (1093, "edge told for held"),
            pytest.param(1110, "edge told for held", marks=pytest.mark.soak),
            (1006, "held told for edge"),
            (1000, "ra_rate_sign"),
            pytest.param(1001, "dec_rate_sign", marks=pytest.mark.soak),
        ],
    )
    def test_a_wrong_profile_is_named_within_seconds(self, number: int, case: str) -> None:
        found = wrong_profiles.stopped(number, case, None)
        assert found is not None
        assert (found.stopped, found.named, found.on_target) == (True, True, False)
        assert found.after_s < 16.0

    def test_limits_that_stop_it_say_what_it_may_be(self) -> None:
        found = wrong_profiles.stopped(1003, "edge told for held", None)
        assert found is not None
        assert found.perhaps
        assert "perhaps move_axis is held, not edge (`sattrack mount calibrate` finds out)" in found.words

    @pytest.mark.parametrize(
        "number",
        [
            2050,
            2113,
            pytest.param(2101, marks=pytest.mark.soak),
            pytest.param(2133, marks=pytest.mark.soak),
        ],
    )
    def test_a_mount_that_refuses_edges_while_it_slews_is_acquired(self, number: int) -> None:
        """It was taken for one that moves only while the flag is up, or stopped because it did not obey."""
        drawn = family.draw(number, (family.FLEXIBLE,))
        assert drawn.hardware.move_axis == "edge"
        outcome = family.Run(drawn).run(lasts_s=30.0).outcome()
        assert outcome.late_s is not None, outcome.why
        assert outcome.late_s < 20.0

"""The mount's clock against ours, with clocks and delays made here."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from sattrack.control.latency import (
    CALIBRATED_S,
    ROUGH_S,
    SIDEREAL_SECONDS_PER_SECOND,
    AcknowledgedDelay,
    Arrivals,
    Envelope,
    KnownClock,
    MountClock,
    TurnLine,
    lower_envelope,
    lower_hull,
)
from sattrack.mount.model import mean_sidereal_deg


def sidereal_h(mount_s: float, start_h: float = 3.0) -> float:
    return (start_h + mount_s * SIDEREAL_SECONDS_PER_SECOND / 3600.0) % 24.0


def line_under_by_linear_programme(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Offset at 0 and slope of the line under all points with the least mean distance to them."""
    from scipy.optimize import linprog

    t, y = np.array(points).T
    solved = linprog(
        [-len(t), -t.sum()], A_ub=np.column_stack([np.ones_like(t), t]), b_ub=y, bounds=[(None, None)] * 2
    )
    return float(solved.x[0]), float(solved.x[1])


@pytest.mark.parametrize("seed", range(20))
def test_the_envelope_is_the_best_line_under_all_points(seed: int) -> None:
    rng = random.Random(seed)
    points = [(float(t), 0.5 + 3e-5 * t + rng.expovariate(400.0)) for t in range(60)]
    envelope = lower_envelope(points)
    at_zero, slope = line_under_by_linear_programme(points)
    assert envelope.drift == pytest.approx(slope, abs=1e-9)
    assert envelope.offset_at(0.0) == pytest.approx(at_zero, abs=1e-7)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("count", [1, 2, 5, 30])
def test_a_usual_slope_is_likelier_than_another(seed: int, count: int) -> None:
    """Held against all slopes of a fine grid: exponential lateness, a slope that is normal about zero."""
    rng = random.Random(seed)
    points = [(float(t), 0.5 + 5e-5 * t + rng.expovariate(4000.0)) for t in range(count)]
    lateness_s, usual = 1.0 / 4000.0, 3e-5
    slopes = np.arange(-200e-6, 200e-6, 1e-8)
    t, y = np.array(points).T
    offsets = (y - slopes[:, None] * t).min(axis=1)
    late_s = (y - offsets[:, None] - slopes[:, None] * t).sum(axis=1)
    best = int((late_s / lateness_s + 0.5 * (slopes / usual) ** 2).argmin())
    envelope = lower_envelope(points, stiffness_s=lateness_s / usual**2)
    assert envelope.drift == pytest.approx(slopes[best], abs=2e-8)
    assert envelope.offset_at(0.0) == pytest.approx(offsets[best], abs=1e-6)


def test_one_point_gives_no_drift() -> None:
    assert lower_envelope([(5.0, 0.1)]) == Envelope(5.0, 0.1, 0.0)
    # So from the first status on a clock that runs as ours dates as it should.
    clock = MountClock(status_delay_s=0.01)
    for number in range(40):
        assert clock.date(sidereal_h(0.05 * number), 50.0 + 0.05 * number) == pytest.approx(
            49.99 + 0.05 * number, abs=1e-6
        )


@pytest.mark.parametrize("drift", [100e-6, -150e-6])
def test_a_clock_that_drifts_dates_within_half_a_millisecond_from_the_first_seconds(drift: float) -> None:
    rng = random.Random(6)
    clock, worst = MountClock(status_delay_s=0.002), 0.0
    for i in range(1200):
        sampled = 1_000_000.0 + i * 0.05
        arrival = sampled + 0.002 + rng.uniform(0.0, 0.002)
        dated = clock.date(sidereal_h((sampled - 1_000_000.0) * (1.0 - drift)), arrival)
        worst = max(worst, abs(dated - sampled)) if i > 60 else 0.0
    assert worst < 5e-4


def test_clocks_usually_drift_by_35_in_a_million() -> None:
    """Arrivals are even to 20 µs: two buckets of a second tell 35²/20 of a drift of 150, and three all of it.

    Under two points 1.05 s apart, the likeliest slope is that at which a lateness of 20 µs of one of them
    weighs as much as a drift of one sigma of 35 ppm; under three it may be three times that.
    """
    for seconds, drift in ((0.95, 0.0), (1.9, 1.05 * 35.0**2 / 20.0), (2.9, 150.0)):
        clock = MountClock(status_delay_s=0.0)
        for number in range(round(seconds / 0.05) + 1):
            clock.date(sidereal_h(0.05 * number * (1.0 - 150e-6)), 50.0 + 0.05 * number)
        assert 1e6 * clock.drift == pytest.approx(drift, abs=1.0)


def test_a_slope_no_clock_has_is_bounded() -> None:
    assert lower_envelope([(float(t), 0.01 * t) for t in range(30)]).drift == pytest.approx(200e-6)


@pytest.mark.parametrize(("drift", "offset_s"), [(0.0, 0.0), (40e-6, 2.7), (-60e-6, -31.0)])
def test_samples_are_dated_through_delays_and_drift(drift: float, offset_s: float) -> None:
    rng = random.Random(4)
    clock = MountClock(status_delay_s=0.002)
    worst = 0.0
    for i in range(2400):
        sampled = 1_000_000.0 + i * 0.05
        arrival = sampled + 0.002 + rng.expovariate(1000.0)
        dated = clock.date(sidereal_h((sampled - 1_000_000.0) * (1.0 - drift) + offset_s), arrival)
        if i > 1000:
            worst = max(worst, abs(dated - sampled))
    assert worst < 2e-4
    assert clock.drift == pytest.approx(drift, abs=8e-6)


@pytest.mark.parametrize("drift", [150e-6, -150e-6])
def test_a_clock_that_has_drifted_far_was_not_set(drift: float) -> None:
    """After forty minutes it is off by three times what it takes for one that was set."""
    clock, off = MountClock(status_delay_s=0.002, period_s=1.0), []
    for number in range(2400):
        sampled = 1_000_000.0 + number
        dated = clock.date(sidereal_h(number * (1.0 - drift)), sampled + 0.002 + 0.0005 * (number % 3))
        off.append(abs(dated - sampled))
    assert max(off[200:]) < 1e-3
    assert clock.drift == pytest.approx(drift, rel=0.02)


@pytest.mark.parametrize(("late_s", "off_s"), [(0.0, 1e-8), (0.01, 1e-5)])
def test_dates_run_on_through_sidereal_midnight(late_s: float, off_s: float) -> None:
    """By the clock: where every other status is late, one that is dated by its arrival would be, too."""
    clock = MountClock(status_delay_s=0.0)
    dated = [
        clock.date(sidereal_h(i * 0.05, start_h=23.9999), 50.0 + i * 0.05 + late_s * (i % 2))
        for i in range(40)
    ]
    assert clock.trusted
    assert np.diff(dated) == pytest.approx([0.05] * 39, abs=off_s)


def test_a_clock_that_stands_still_is_not_believed() -> None:
    clock = MountClock(status_delay_s=0.01)
    dated = [clock.date(7.0, 100.0 + i * 0.05) for i in range(60)]
    assert not clock.trusted
    assert dated[-1] == pytest.approx(100.0 + 59 * 0.05 - 0.01)


@pytest.mark.parametrize("period_s", [0.05, 0.0625])
def test_bursts_are_dated_by_count_where_the_clock_is_not_believed(period_s: float) -> None:
    """Four at a time, the first of them three turns late; the clock stands still."""
    clock = MountClock(status_delay_s=0.01)
    worst = 0.0
    for i in range(200):
        sampled = 100.0 + i * period_s
        arrival = 100.0 + (i // 4 * 4 + 3) * period_s + 0.01
        dated = clock.date(7.0, arrival, counter=i)
        if i > 80:
            worst = max(worst, abs(dated - sampled))
    assert not clock.trusted
    assert worst < 0.3 * period_s


@pytest.mark.parametrize("runs", [True, False])
@pytest.mark.parametrize("held_s", [0.6, 1.9, 4.0])
@pytest.mark.parametrize("drains_s", [0.0, 0.015])
def test_statuses_that_a_network_held_back_are_dated_as_those_before_them(
    runs: bool, held_s: float, drains_s: float
) -> None:
    """They come all at once, or one after the other; the mount's clock runs, or stands still."""
    rng = random.Random(5)
    clock = MountClock(status_delay_s=0.01)
    free_s = 100.0 + 15.0 + held_s
    for i in range(600):
        sampled = 100.0 + 0.05 * i
        arrival = sampled + 0.01 + rng.uniform(0.0, 0.002)
        if sampled > 115.0 and arrival < free_s:
            arrival = free_s
            free_s += drains_s
        dated = clock.date(sidereal_h(0.05 * i) if runs else 7.0, arrival, counter=i)
        if i > 80:
            assert clock.trusted is runs
            assert dated == pytest.approx(sampled, abs=0.0015 if runs else 0.033), arrival - sampled


def test_unevenness_of_a_coarse_timer_is_no_burst() -> None:
    rng = random.Random(8)
    clock = MountClock(status_delay_s=0.01)
    for i in range(200):
        arrival = 100.0 + np.ceil(i * 0.05 * 64.0) / 64.0 + rng.uniform(0.0, 0.001) + 0.01
        dated = clock.date(7.0, arrival, counter=i)
    assert dated == pytest.approx(arrival - 0.01, abs=1e-9)


class TestByHand:
    def test_the_hull_is_that_of_the_lowest_points(self) -> None:
        points = [(0.0, 0.0), (1.0, 3.0), (2.0, 1.0), (3.0, 5.0), (4.0, 2.0), (5.0, 6.0)]
        assert lower_hull(points) == [(0.0, 0.0), (4.0, 2.0), (5.0, 6.0)]
        assert lower_hull(points[3:], lower_hull(points[:3])) == lower_hull(points)
        before = lower_hull(points[:-1])
        assert lower_envelope(points, 10.0, 0.0, before) == lower_envelope(points, 10.0)

    def test_an_envelope_is_a_line(self) -> None:
        assert Envelope(10.0, 0.5, 2e-4).offset_at(1010.0) == pytest.approx(0.7)
        assert lower_envelope([(0.0, 0.0), (10.0, 0.02), (20.0, 0.0)], 1.0) == Envelope(0.0, 0.0, 0.0)

    @pytest.mark.parametrize("slope", [5e-4, -5e-4])
    def test_no_clock_drifts_by_more_than_200_in_a_million(self, slope: float) -> None:
        points = [(float(t), slope * t) for t in range(5)]
        bounded = 2e-4 if slope > 0.0 else -2e-4
        envelope = lower_envelope(points)
        assert envelope.drift == pytest.approx(bounded)
        assert envelope.offset_at(0.0) == pytest.approx(min(y - bounded * t for t, y in points))

    @pytest.mark.parametrize("late_s", [0.02, 0.031, 0.1])
    def test_what_comes_later_than_three_fifths_of_a_period_was_held_up(self, late_s: float) -> None:
        arrivals = Arrivals(0.05)
        for counter in range(39):
            arrivals.note(counter, 100.0 + 0.05 * counter)
            assert arrivals.held_up_s == 0.0
        arrivals.note(39, 100.0 + 0.05 * 39 + late_s)
        assert arrivals.held_up_s == pytest.approx(late_s if late_s > 0.03 else 0.0)
        # Statuses that are lost count as turns, and a count that goes back begins anew.
        arrivals.note(45, 100.0 + 0.05 * 45)
        assert arrivals.held_up_s == 0.0
        arrivals.note(3, 300.0)
        assert len(arrivals._lately) == 1

    def test_a_known_clock_dates_to_the_nearest_instant_that_it_shows(self) -> None:
        """Mean sidereal time is that of erfa; the clock is 0.25 s ahead of it."""
        import erfa

        utc_s, longitude_deg = 1_790_000_000.0, 11.0
        day = 2440587.5 + utc_s / 86400.0
        tt = day + (37.0 + 32.184) / 86400.0
        shows_deg = np.degrees(erfa.gmst06(day, 0.0, tt, 0.0)) + longitude_deg
        ahead_deg = 0.25 * 360.0 * SIDEREAL_SECONDS_PER_SECOND / 86400.0
        known = KnownClock(longitude_deg, 0.25)
        for near_s in (-40.0, 0.0, 3.0):
            dated = known.date((shows_deg + ahead_deg) % 360.0 / 15.0, utc_s + near_s)
            assert dated == pytest.approx(utc_s, abs=5e-3)

    @pytest.mark.parametrize("off_s", [0.0, 0.014, 0.016, -0.016])
    def test_a_known_clock_holds_while_the_fastest_arrivals_are_as_late_as_the_profile_has_them(
        self, off_s: float
    ) -> None:
        clock = clock_known_to(0.02)
        for number in range(60):
            feed(clock, number, 0.02 + off_s)
            assert clock.known_holds is (abs(off_s) < 0.015)
        # Believing it again takes half of that.
        for delay_s, holds in ((0.02 + 0.0074, True), (0.02 + 0.0076, False)):
            again = clock_known_to(0.02)
            for number in range(60):
                feed(again, number, 0.06)
            assert again.known_holds is False
            for number in range(60, 110):
                feed(again, number, delay_s)
                assert holds or not again.known_holds
            assert again.known_holds is holds

    @pytest.mark.parametrize(
        ("delay_s", "holds"), [(0.001, True), (0.06, True), (0.9, True), (1.1, False), (-0.006, False)]
    )
    def test_our_own_clock_holds_however_late_arrivals_are_but_for_what_no_request_takes(
        self, delay_s: float, holds: bool
    ) -> None:
        clock = MountClock(0.015, KnownClock(11.0, 0.0), known_is_ours=True)
        for number in range(60):
            feed(clock, number, delay_s)
            assert clock.known_holds is holds

    def test_a_clock_that_was_set_is_taken_anew(self) -> None:
        """At once where arrivals come before the envelope, after ten in a row where they come later."""
        for step_s, after in ((-0.15, 10), (0.15, 1)):
            clock, dates = MountClock(status_delay_s=0.01), []
            for number in range(600):
                sampled = 1000.0 + 0.05 * number
                shown = sampled - 1000.0 + (step_s if number >= 300 else 0.0)
                dates.append(clock.date(sidereal_h(shown), sampled + 0.01) - sampled)
            assert max(map(abs, dates[:300])) < 1e-6
            assert max(map(abs, dates[300 + after :])) < 1e-6
            if after > 1:
                assert dates[300 + after - 2] == pytest.approx(step_s, abs=1e-6)

    def test_how_late_statuses_are_in_the_mean(self) -> None:
        clock = MountClock(status_delay_s=0.0)
        assert (clock.lateness_s, clock.drift, clock.coarse_step_s) == (0.0, 0.0, None)
        for number in range(1000):
            late_s = 0.004 if number % 2 else 0.0
            clock.date(sidereal_h(0.05 * number), 50.0 + 0.05 * number + late_s)
        assert clock.lateness_s == pytest.approx(0.002, rel=0.05)
        assert clock.drift == pytest.approx(0.0, abs=2e-6)

    def test_the_mean_lateness_is_that_of_the_last_two_hundred(self) -> None:
        """Of those that there are while there are fewer; none counts as later than a tenth of a second."""
        clock = MountClock(status_delay_s=0.0)
        for number in range(11):
            clock.date(sidereal_h(0.05 * number), 50.0 + 0.05 * number + (0.01 if number == 10 else 0.0))
        assert clock.lateness_s == pytest.approx(0.001, rel=1e-3)
        for late_s, counts_s in ((0.01, 0.01), (0.35, 0.1)):
            clock = MountClock(status_delay_s=0.0)
            for number in range(400):
                clock.date(sidereal_h(0.05 * number), 50.0 + 0.05 * number)
            clock.date(sidereal_h(20.0), 70.0 + late_s)
            assert clock.lateness_s == pytest.approx(counts_s / 200.0, rel=1e-3)

    @pytest.mark.parametrize(
        ("rate", "trusted"), [(1.105, True), (1.115, False), (0.895, True), (0.885, False)]
    )
    def test_a_clock_that_runs_as_ours_but_for_a_percent_and_two_tenths_of_a_second_is_believed(
        self, rate: float, trusted: bool
    ) -> None:
        """Over forty samples: in two seconds of ours, it is off by 0.22 s at most."""
        clock = MountClock(status_delay_s=0.0)
        for number in range(100):
            clock.date(sidereal_h(rate * 0.05 * number), 50.0 + 0.05 * number)
        assert clock.trusted is trusted

    def test_a_clock_that_runs_back_over_midnight_shows_less(self) -> None:
        clock = MountClock(status_delay_s=0.0)
        dated = [
            clock.date(sidereal_h(shown, start_h=0.00001), 50.0 + late)
            for shown, late in ((0.0, 0.0), (-0.04, 0.0), (0.05, 0.05))
        ]
        assert dated[2] - dated[1] == pytest.approx(0.09, abs=1e-6)


def clock_known_to(status_delay_s: float) -> MountClock:
    return MountClock(status_delay_s=status_delay_s, known=KnownClock(11.0, 0.0))


def feed(clock: MountClock, number: int, delay_s: float) -> float:
    """Have a clock that shows mean sidereal time date a sample; return by how much it is off."""
    sampled = 1_790_000_000.0 + 0.05 * number
    shown_h = mean_sidereal_deg(sampled, 11.0) % 360.0 / 15.0
    return clock.date(shown_h, sampled + delay_s) - sampled


class TestTurns:
    def test_the_line_is_the_weighted_least_squares_line(self) -> None:
        """numpy's, every turn counting 0.995 of the next."""
        rng = np.random.default_rng(3)
        line, period = TurnLine(0.05), 0.05
        counters = np.cumsum(rng.integers(1, 4, 80))
        instants = 1000.0 + 0.0502 * counters + rng.normal(0.0, 0.003, 80)
        line.begin(int(counters[0]), float(instants[0]))
        assert line.utc_s == instants[0]
        for number in range(1, 80):
            line.advance(int(counters[number]))
            line.note(float(instants[number]))
            weights = 0.995 ** np.arange(number, -1, -1)
            fit = np.polyfit(
                counters[: number + 1] - counters[number],
                instants[: number + 1] - 1000.0,
                1,
                w=np.sqrt(weights),
            )
            assert line.utc_s == pytest.approx(1000.0 + fit[1], abs=1e-7)
            assert line.noted == number + 1
        assert line.period_s == period


def answered(
    delay: AcknowledgedDelay, real_s: float, raises: int, loss: float = 0.0, mean_s: float = 0.05
) -> None:
    """Raise flags so often, 0.2 s apart and at any instant of the turns; what is lost comes a turn later."""
    rng = random.Random(7)
    turns_s = np.cumsum([rng.choice((0.94, 1.06)) * mean_s for _ in range(8 * raises)])
    for number in range(raises):
        raised_s = 0.3 + 0.2 * number + rng.uniform(0.0, 0.05)
        arrives_s = raised_s + real_s + (0.05 if rng.random() < loss else 0.0)
        by = int(np.searchsorted(turns_s, arrives_s))
        delay.note(raised_s, float(turns_s[by - 1]), float(turns_s[by]))


@pytest.mark.parametrize("off_ms", [-40, -17, -4, 0, 9, 30])
def test_acknowledgements_tell_the_delay_to_the_millisecond(off_ms: int) -> None:
    told_s = 0.02
    delay = AcknowledgedDelay(told_s, ROUGH_S)
    answered(delay, told_s + 1e-3 * off_ms, 60, loss=0.03)
    found_s, sigma_s = delay.delay_s
    assert 1e3 * (found_s - told_s) == pytest.approx(off_ms, abs=1.5)
    assert sigma_s < 0.002
    tried_s = told_s + 1e-3 * np.array((off_ms - 8, off_ms, off_ms + 8))
    assert delay.likely(tried_s).argmax() == 1


def test_one_acknowledgement_tells_of_a_whole_turn_and_little_else() -> None:
    """By a status that came before it was expected, the flags were there: they take that much less long."""
    told_s = 0.04
    delay = AcknowledgedDelay(told_s, ROUGH_S)
    assert delay.delay_s == pytest.approx((told_s, 0.016), abs=5e-4)
    delay.note(0.0, told_s - 0.025, told_s + 0.025)
    assert delay.delay_s[0] == pytest.approx(told_s, abs=5e-4)
    assert delay.delay_s[1] > 0.01
    sooner = AcknowledgedDelay(told_s, ROUGH_S)
    sooner.note(0.0, told_s - 0.075, told_s - 0.025)
    assert sooner.delay_s[0] < told_s - 0.02


def test_one_that_contradicts_by_far_says_no_more_than_one_that_contradicts() -> None:
    """One in 20 datagrams may have been lost, one in 55 answers may be another's: exp(-3) and exp(-4)."""
    delays_s = np.array([0.0, 0.02, 0.04, 0.06])
    for before_s, by_s in ((-0.1, -0.05), (0.08, 0.13), (-5.0, -4.0), (4.0, 5.0)):
        delay = AcknowledgedDelay(0.03, ROUGH_S)
        first = delay.likely(delays_s)
        delay.note(0.0, before_s, by_s)
        changed = delay.likely(delays_s) - first
        assert changed == pytest.approx(np.full(4, -4.0 if by_s < 0.0 else -3.0))


@pytest.mark.parametrize(("missed", "raises"), [(0.3, 80), (0.5, 20), (0.8, 80)])
def test_a_datagram_that_comes_just_with_a_turn_is_read_by_it_or_by_the_next(
    missed: float, raises: int
) -> None:
    """Raised 30 ms before a turn each time, and that turn reads a part: it takes 30 ms, not less or more."""
    rng, delay = random.Random(2), AcknowledgedDelay(0.015, ROUGH_S)
    for number in range(raises):
        turn_s = 0.2 * number + (0.05 if rng.random() < missed else 0.0)
        delay.note(0.2 * number - 0.03, turn_s - 0.05, turn_s)
    assert delay.delay_s[0] == pytest.approx(0.03, abs=0.002)
    assert delay.delay_s[1] < 0.003


def test_a_datagram_that_never_misses_its_turn_takes_any_time_up_to_it() -> None:
    delay = AcknowledgedDelay(0.015, ROUGH_S)
    for number in range(60):
        delay.note(0.2 * number - 0.03, 0.2 * number - 0.05, 0.2 * number)
    assert 0.0 < delay.delay_s[0] < 0.02
    assert delay.delay_s[1] > 0.009


def test_how_sharply_an_acknowledgement_bounds_a_delay() -> None:
    """Samples are dated to 3 ms: over so much it goes from certainty to what one in 55, or 20, is left of."""
    delays_s = 0.001 * np.arange(15, 26)
    since = np.clip((20.0 - np.arange(15, 26)) / 3.0 + 0.5, 0.0, 1.0)
    for before_s, by_s, likely in (
        (-9.0, 0.02, np.maximum(since, math.exp(-4.0))),
        (0.02, 9.0, 1.0 - (1.0 - math.exp(-3.0)) * since),
    ):
        delay = AcknowledgedDelay(0.02, ROUGH_S)
        first = delay.likely(delays_s)
        delay.note(0.0, before_s, by_s)
        assert delay.likely(delays_s) - first == pytest.approx(np.log(likely), abs=1e-9)


def test_a_delay_is_looked_for_to_45_ms_either_side_in_steps_of_one() -> None:
    delay = AcknowledgedDelay(0.02, ROUGH_S)
    assert np.diff(delay._delays_s) == pytest.approx(np.full(90, 0.001))
    assert (delay._delays_s[0], delay._delays_s[-1]) == pytest.approx((0.02 - 0.045, 0.02 + 0.045))
    # Calibrated it is known to 3 ms, and to a millisecond by how finely it is looked for.
    assert AcknowledgedDelay(0.02, CALIBRATED_S).delay_s == pytest.approx((0.02, math.hypot(0.003, 0.001)))


def test_no_delay_is_known_better_than_samples_are_dated() -> None:
    delay = AcknowledgedDelay(0.02, CALIBRATED_S)
    answered(delay, 0.02, 400)
    assert 0.001 <= delay.delay_s[1] < 0.0015


def test_a_calibrated_delay_gives_way_to_proof_only() -> None:
    delay = AcknowledgedDelay(0.02, CALIBRATED_S)
    delay.note(0.0, 0.02, 0.07)
    assert delay.delay_s[0] == pytest.approx(0.02, abs=0.004)
    answered(delay, 0.035, 60)
    assert delay.delay_s[0] == pytest.approx(0.035, abs=0.004)

"""Each estimate against closed forms and against draws of its own making."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sattrack.calibration.clocks import (
    Bracket,
    HeardStatus,
    RoundTripEstimate,
    StatusLog,
    TurnForecast,
    clock_line,
    contradiction,
    status_period,
)
from sattrack.calibration.motion import AxisResponse, Plateau, Stretch, axis_response, lag, steady_part
from sattrack.calibration.servo import Transient, braking
from sattrack.mount.model import Status

SIDEREAL_DEG_S = 360.0 / 86164.0905


def heard(counter: int, mount_s: float, arrival_utc_s: float) -> HeardStatus:
    return HeardStatus(counter, arrival_utc_s, mount_s, 0.0, 0.0, Status())


def arrivals(slope: float, jitter_s: float, rng: np.random.Generator, count: int = 1600) -> list[HeardStatus]:
    return [
        heard(n, 0.05 * n, 1e9 + 0.05 * n * (1.0 + slope) + 0.03 + float(rng.exponential(jitter_s)))
        for n in range(count)
    ]


class TestTheRoundTrip:
    def test_is_exact_where_delays_are_even(self) -> None:
        estimate = RoundTripEstimate()
        for n in range(100):
            # Brackets of a 50 ms loop that share nothing but 83.0 to 83.5 ms.
            above = 0.0830 - 0.0005 * n
            estimate.add(Bracket(above, above + 0.05))
        trip = estimate.result()
        assert trip.fastest_s == pytest.approx(0.08325, abs=0.0003)
        assert trip.strays == 0

    def test_has_a_sigma_that_covers_what_it_misses_by(self) -> None:
        rng, pulls = np.random.default_rng(5), []
        for _ in range(16):
            estimate, true_s = RoundTripEstimate(), float(rng.uniform(0.0, 0.16))
            for _ in range(60):
                aim_s = true_s + float(rng.uniform(-0.003, 0.003))
                trip_s = true_s + float(rng.normal(0.0, 0.001))
                seen = aim_s if trip_s <= aim_s else aim_s + 0.05
                estimate.add(Bracket(seen - 0.05, seen))
            trip = estimate.result()
            pulls.append((trip.fastest_s - true_s) / trip.sigma_s)
        assert math.sqrt(np.mean(np.square(pulls))) < 1.5
        assert max(map(abs, pulls)) < 4.0

    def test_shrugs_off_commands_that_were_lost_and_acted_when_repeated(self) -> None:
        estimate = RoundTripEstimate()
        for n in range(100):
            above = 0.06 - 0.0005 * n
            late = 0.05 if n % 25 == 7 else 0.0
            estimate.add(Bracket(above + late, above + 0.05 + late))
        trip = estimate.result()
        assert trip.fastest_s == pytest.approx(0.06, abs=0.001)
        assert contradiction(trip) is None

    def test_that_no_value_fits_is_a_contradiction(self) -> None:
        estimate = RoundTripEstimate()
        for n in range(40):
            above = 0.05 if n % 2 else 0.3
            estimate.add(Bracket(above, above + 0.05))
        assert "do not fit one round trip" in (contradiction(estimate.result()) or "")


class TestTheClock:
    @pytest.mark.parametrize("jitter_s", [0.0002, 0.002])
    def test_has_the_slope_of_its_fastest_arrivals_within_its_sigma(self, jitter_s: float) -> None:
        rng, pulls = np.random.default_rng(7), []
        for slope in np.linspace(-5e-5, 5e-5, 12):
            line = clock_line(arrivals(float(slope), jitter_s, rng))
            pulls.append((line.slope - slope) / line.slope_sigma)
            assert line.drift_ppm == pytest.approx(-slope * 1e6, abs=1.5)
            assert float(line.arrival_at(40.0)) == pytest.approx(1e9 + 40.0 * (1 + slope) + 0.03, abs=2e-4)
            assert line.jitter_s == pytest.approx(jitter_s, rel=0.15)
        assert 0.4 < math.sqrt(np.mean(np.square(pulls))) < 1.6

    def test_that_was_set_meanwhile_is_no_clock(self) -> None:
        some = arrivals(0.0, 0.001, np.random.default_rng(1))
        some = [heard(h.counter, h.mount_s + 0.3 * (h.counter > 700), h.arrival_utc_s) for h in some]
        assert "was set during the run" in (clock_line(some).objection() or "")

    def test_that_stands_still_is_no_clock(self) -> None:
        some = [heard(n, 1e-4 * n, 1e9 + 0.05 * n) for n in range(400)]
        assert clock_line(some).objection() is not None

    def test_periods_count_what_was_lost(self) -> None:
        some = [heard(n, 0.05 * n + 0.002 * (n % 2), 1e9) for n in range(400) if n % 7]
        period = status_period(some)
        assert period.mean_s == pytest.approx(0.05, abs=1e-5)
        assert period.jitter_s == pytest.approx(0.002, rel=0.02)


class TestTurns:
    def test_of_an_even_loop_are_foretold(self) -> None:
        forecast = TurnForecast([heard(n, 0.0625 * n, 0.0) for n in range(60)])
        assert forecast.next_after(59 * 0.0625 + 0.3) == pytest.approx(64 * 0.0625)

    def test_of_a_windows_timer_are_foretold_by_their_rhythm(self) -> None:
        # Due at multiples of 50 ms, fired at the next multiple of 1/64 s.
        fired = [math.ceil(n * 0.05 * 64 - 1e-9) / 64 for n in range(90)]
        some = [heard(n, at, 0.0) for n, at in enumerate(fired[:60]) if n not in {31, 57}]
        forecast = TurnForecast(some)
        for at, following in pairwise(fired[60:80]):
            assert forecast.next_after(at + 0.001) == pytest.approx(following, abs=0.0005)


def stretch(rate: float, answer: float, acceleration: float, dead_s: float, before: float = 0.0) -> Stretch:
    """A ramp from `before` to `answer`, begun `dead_s` after the command was read at 0."""
    seconds = np.arange(0.0, 3.0, 0.05)
    ramp = abs(answer - before) / acceleration
    since = np.maximum(0.0, seconds - dead_s)
    sped = np.minimum(since, ramp)
    angle = before * seconds + (answer - before) * (0.5 * sped**2 / ramp + np.maximum(0.0, since - ramp))
    return Stretch(rate, seconds, angle)


def responding(*rates: float, most: float = math.inf) -> AxisResponse | None:
    parts = [steady_part(stretch(r, math.copysign(min(abs(r), most), r), 5.0, 0.0)) for r in rates]
    return axis_response([p for p in parts if p is not None])


class TestMotion:
    @pytest.mark.parametrize(("sign", "added"), [(1, 0.0), (-1, SIDEREAL_DEG_S), (1, SIDEREAL_DEG_S)])
    def test_in_closed_form_gives_back_what_made_it(self, sign: int, added: float) -> None:
        parts = [
            steady_part(stretch(r, sign * 1.07 * r + added, 4.0, 0.012, SIDEREAL_DEG_S))
            for r in (-0.8, 0.8, -0.4, 0.4, -0.2, 0.2)
        ]
        response = axis_response([p for p in parts if p is not None])
        assert response is not None
        assert (response.sign, response.additive) == (sign, added > 0.0)
        assert response.gain == pytest.approx(1.07, abs=1e-9)
        assert not response.rate_limit_reached

    def test_that_is_no_faster_when_told_to_be_is_at_its_limit(self) -> None:
        response = responding(-0.8, 0.8, -0.4, 0.4, -0.2, 0.2, most=0.6)
        assert response is not None
        assert response.rate_limit_reached
        assert response.fastest_deg_s == pytest.approx(0.6, abs=1e-9)
        assert response.gain == pytest.approx(1.0, abs=1e-9)

    def test_that_adds_half_of_the_sidereal_rate_is_neither_reading(self) -> None:
        parts = [steady_part(stretch(r, r + 0.5 * SIDEREAL_DEG_S, 5.0, 0.0)) for r in (-0.8, 0.8, 0.4)]
        response = axis_response([p for p in parts if p is not None])
        assert response is not None
        assert response.additive is None

    def test_that_still_settles_tells_a_larger_sigma(self) -> None:
        plain = stretch(0.4, 0.4, 10.0, 0.0)
        slow = Stretch(0.4, plain.seconds, plain.angle_deg - 0.01 * (1.0 - np.exp(-plain.seconds)))
        one = steady_part(slow)
        assert one is not None
        assert abs(one.rate_deg_s - 0.4) < 3.0 * one.sigma_deg_s

    def test_one_way_only_is_not_enough(self) -> None:
        assert responding(0.8, 0.4, 0.2) is None


def servo_stop(rate: float, limit: float, bandwidth_hz: float) -> Transient:
    """A stop of a velocity loop of first order with a limited acceleration, integrated in steps of 50 us."""
    h, place, speed, places = 5e-5, 0.0, rate, [0.0]
    for n in range(1, 40001):
        force = max(-limit, min(limit, -2.0 * math.pi * bandwidth_hz * speed))
        place, speed = place + h * (speed + 0.5 * h * force), speed + h * force
        if n % 1000 == 0:
            places.append(place)
    return Transient(rate, 0.05 * np.arange(len(places)), np.array(places))


class TestBraking:
    @pytest.mark.parametrize(("limit", "bandwidth_hz"), [(3.0, 8.0), (6.0, 12.0), (12.0, 20.0)])
    def test_of_a_servo_at_its_limit_is_that_limit(self, limit: float, bandwidth_hz: float) -> None:
        found = braking([servo_stop(rate, limit, bandwidth_hz) for rate in (0.2, 0.4, 0.8, 1.6)])
        assert found is not None
        assert found.limited
        assert found.acceleration_deg_s2 is not None
        assert found.acceleration_sigma_deg_s2 is not None
        assert abs(found.acceleration_deg_s2 - limit) < 2.0 * found.acceleration_sigma_deg_s2
        assert found.acceleration_sigma_deg_s2 < 0.1 * limit

    def test_of_a_servo_too_soft_for_its_limit_is_what_its_stop_takes(self) -> None:
        found = braking([servo_stop(rate, 20.0, 1.0) for rate in (0.2, 0.4, 0.8, 1.6)])
        assert found is not None
        assert not found.limited
        # It goes on by rate / (2 pi bandwidth).
        assert found.stop.deg == pytest.approx(1.6 / (2.0 * math.pi), rel=0.01)
        assert found.acceleration_deg_s2 == pytest.approx(1.6 * math.pi, rel=0.02)


class TestLag:
    @pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.15])
    def test_is_where_the_lines_meet(self, lag_s: float) -> None:
        found = lag([[*plateaus(lag_s, sense)] for sense in (1.0, -1.0)])
        assert found is not None
        assert found.seconds == pytest.approx(lag_s, abs=1e-9)

    def test_is_not_told_where_steps_disagree(self) -> None:
        rng = np.random.default_rng(4)
        shaken = [replace(p, angle_deg=p.angle_deg + rng.normal(0.0, 0.002)) for p in plateaus(0.01, 1.0)]
        assert lag([shaken]) is None


def plateaus(lag_s: float, sense: float) -> list[Plateau]:
    rates = [sense * r for r in (0.10, 0.12, 0.10, 0.12, 0.10)]
    began = [1.25 * k for k in range(len(rates))]
    made, place = [], 0.0
    for k, (rate, begin) in enumerate(zip(rates, began, strict=True)):
        if k:
            place += rates[k - 1] * 1.25 - lag_s * (rate - rates[k - 1])
        seconds = np.arange(0.0, 1.25, 0.05)
        made.append(Plateau(rate, begin, seconds, place + rate * seconds))
    return made


def test_the_log_counts_hours_across_midnight_and_turns_across_the_circle() -> None:
    from sattrack.mount.xerxes.datagrams import encode_status

    log = StatusLog()
    for n in range(4):
        sidereal = (23.9999 + n * 0.0001) % 24.0
        log.take(encode_status(Status(counter=n + 1, sidereal_h=sidereal, ra_h=12.0 + 0.00005 * n)), 1e9 + n)
    steps = [b.mount_s - a.mount_s for a, b in pairwise(log.heard)]
    assert steps == pytest.approx([0.36 / 1.00273790935] * 3, abs=1e-6)
    assert [b.hour_angle_deg - a.hour_angle_deg for a, b in pairwise(log.heard)] == pytest.approx(
        [0.00075] * 3
    )

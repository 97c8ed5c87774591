"""Rest by positions: tables of positions made by hand, and mounts written from the paper by others."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rest

from sattrack.mount.model import StatusSample
from sattrack.mount.xerxes.standstill import (
    AHEAD_S,
    CONTRADICTED_S,
    HANGS_S,
    LEAST_NOISE_DEG,
    REST_RATE_DEG_S,
    WINDOWS_S,
    Parabola,
    Positions,
    Standstill,
)

if TYPE_CHECKING:
    from collections.abc import Callable

SIDEREAL_DEG_S = 360.0 * 1.00273790935 / 86400.0
T0 = 1_790_000_000.0
PERIOD_S = 0.05
SKY = SIDEREAL_DEG_S


def standing(seconds: float) -> float:
    del seconds
    return 0.0


def sky(seconds: float) -> float:
    return SKY * seconds


def at(rate_deg_s: float) -> Callable[[float], float]:
    return lambda seconds: rate_deg_s * seconds


class Watched:
    """A mount of which statuses tell where it is; its rate fields and Slewing are as told."""

    def __init__(
        self,
        hour_angle: Callable[[float], float] = sky,
        dec: Callable[[float], float] = standing,
        rates: tuple[float, float] = (SKY, 0.0),
        slewing: bool = False,
    ) -> None:
        self.standstill = Standstill()
        self.hour_angle, self.dec, self.rates, self.slewing = hour_angle, dec, rates, slewing
        self.clock_step_s = self.noise_deg = self.lateness_s = 0.0
        self.ra_jump_deg = 0.0
        self.aborted, self.arrived = True, False
        self.dice = random.Random(1)
        self.seconds = 0.0
        self.count = 0

    def hear(self, seconds: float, loss: float = 0.0) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.count += 1
            self.seconds += PERIOD_S
            if self.dice.random() >= loss:
                self.standstill.see(self.sample(), self.aborted, move_axis=False, arrived=self.arrived)

    def sample(self) -> StatusSample:
        clock_s = self.seconds
        if self.clock_step_s:
            clock_s = math.floor(clock_s / self.clock_step_s) * self.clock_step_s
        sidereal_deg = (350.0 + clock_s * SIDEREAL_DEG_S) % 360.0
        noise = self.dice.uniform(-1.0, 1.0) * self.noise_deg
        return StatusSample(
            counter=self.count,
            arrival_utc_s=T0 + self.seconds + self.dice.uniform(0.0, self.lateness_s),
            sidereal_h=sidereal_deg / 15.0,
            ra_deg=(sidereal_deg - self.hour_angle(self.seconds) + noise + self.ra_jump_deg + 9.99) % 360.0,
            dec_deg=20.0 + self.dec(self.seconds) + self.dice.uniform(-1.0, 1.0) * self.noise_deg,
            slewing=self.slewing,
            does_refraction=False,
            ra_drive_deg_s=self.rates[0],
            dec_drive_deg_s=self.rates[1],
        )

    @property
    def ignored(self) -> set[str]:
        return set(self.standstill.fields.ignored)


@pytest.mark.parametrize(("rate", "field"), [(0.0, 0.0), (SKY, SKY)], ids=["stands", "follows the sky"])
@pytest.mark.parametrize(
    ("loss", "step_s", "lateness_s"),
    [(0, 0, 0), (0.1, 0, 0.08), (0, 0.015625, 0)],
    ids=["good", "bad", "coarse"],
)
def test_an_axis_at_rest_is_seen_within_a_second(
    rate: float, field: float, loss: float, step_s: float, lateness_s: float
) -> None:
    mount = Watched(at(rate), rates=(field, 0.0))
    mount.clock_step_s, mount.lateness_s = step_s, lateness_s
    mount.hear(0.4)
    assert not mount.standstill.at_rest
    mount.hear(0.8, loss)
    assert mount.standstill.at_rest
    assert mount.standstill.stands is (rate == 0.0)


@pytest.mark.parametrize("off", [1.2, -1.2, 2.0, 50.0, -700.0])
@pytest.mark.parametrize("axis", ["hour angle", "declination"])
def test_an_axis_faster_than_the_bound_is_not_at_rest_whatever_the_fields_say(off: float, axis: str) -> None:
    rate = off * REST_RATE_DEG_S
    moved = at(rate + (SKY if rate > 0.0 else 0.0))
    mount = Watched(moved) if axis == "hour angle" else Watched(dec=at(rate))
    for _ in range(200):
        mount.hear(PERIOD_S)
        assert not mount.standstill.at_rest


@pytest.mark.parametrize("brakes_deg_s2", [0.02, 0.2, 2.0])
def test_an_axis_that_passes_through_zero_is_not_at_rest(brakes_deg_s2: float) -> None:
    begins_deg_s = 3.0 * brakes_deg_s2
    mount = Watched(dec=lambda s: begins_deg_s * s - 0.5 * brakes_deg_s2 * s * s)
    for _ in range(120):
        mount.hear(PERIOD_S)
        assert not mount.standstill.at_rest


def test_a_frozen_status_is_no_position() -> None:
    mount = Watched()
    frozen = mount.sample()
    for number in range(100):
        mount.standstill.see(
            StatusSample(
                number,
                T0 + number * PERIOD_S,
                frozen.sidereal_h,
                frozen.ra_deg,
                frozen.dec_deg,
                False,
                False,
                0.0,
                0.0,
            ),
            aborted=True,
            move_axis=False,
        )
    assert not mount.standstill.at_rest


def test_positions_that_come_in_a_burst_say_nothing_of_now() -> None:
    mount = Watched()
    for _ in range(100):
        mount.seconds += PERIOD_S
        mount.count += 1
        late = mount.sample()
        burst = StatusSample(
            mount.count,
            T0 + 30.0 + mount.count * 1e-4,
            late.sidereal_h,
            late.ra_deg,
            late.dec_deg,
            False,
            False,
            SKY,
            0.0,
        )
        mount.standstill.see(burst, aborted=True, move_axis=False)
    assert not mount.standstill.at_rest


def test_a_sync_in_a_stop_delays_rest_and_no_more() -> None:
    mount = Watched()
    mount.hear(2.0)
    mount.ra_jump_deg = 3.0
    mount.hear(2 * PERIOD_S)
    assert not mount.standstill.at_rest
    mount.hear(WINDOWS_S[0] + PERIOD_S)
    assert mount.standstill.at_rest


def test_a_mount_that_takes_to_the_sky_stays_at_rest() -> None:
    mount = Watched(lambda s: SKY * max(0.0, s - 2.0))
    mount.hear(1.5)
    assert mount.standstill.stands
    mount.hear(2.5)
    assert mount.standstill.at_rest
    assert not mount.standstill.stands


@pytest.mark.parametrize("noise_deg", [5e-5, 2e-4, 5e-4])
def test_noise_makes_rest_late_and_not_impossible(noise_deg: float) -> None:
    mount = Watched()
    mount.noise_deg = noise_deg
    mount.hear(5.0)
    seen = 0
    for _ in range(40):
        mount.hear(PERIOD_S)
        seen += mount.standstill.at_rest
    assert seen > 20


@pytest.mark.parametrize("noise_deg", [5e-5, 2e-4, 5e-4])
def test_noise_makes_no_rest_of_motion(noise_deg: float) -> None:
    moving = Watched(dec=at(2.0 * REST_RATE_DEG_S))
    moving.noise_deg = noise_deg
    for _ in range(200):
        moving.hear(PERIOD_S)
        assert not moving.standstill.at_rest


@pytest.mark.parametrize(
    ("rates", "slewing", "names"),
    [
        ((1.0, 0.0), False, {"RightAscensionRate"}),
        ((SKY, 0.5), False, {"DeclinationRate"}),
        ((SKY, 0.0), True, {"Slewing"}),
        ((math.nan, math.inf), True, {"RightAscensionRate", "DeclinationRate", "Slewing"}),
    ],
)
def test_a_field_that_says_motion_delays_rest_until_positions_have_contradicted_it(
    rates: tuple[float, float], slewing: bool, names: set[str]
) -> None:
    mount = Watched(rates=rates, slewing=slewing)
    mount.hear(CONTRADICTED_S - 0.5)
    assert not mount.standstill.at_rest
    mount.hear(1.5)
    assert mount.standstill.at_rest
    assert mount.ignored == names


def test_fields_that_say_rest_of_an_axis_that_moves_are_named() -> None:
    mount = Watched(at(1.0), at(0.5))
    mount.hear(CONTRADICTED_S + 1.0)
    assert mount.ignored == {"RightAscensionRate", "DeclinationRate", "Slewing"}
    assert not mount.standstill.at_rest


class TestHangingEncoder:
    """The clock runs, and right ascension and declination repeat to the last bit."""

    def test_it_contradicts_no_fields_that_were_right_before(self) -> None:
        mount = Watched(dec=lambda s: min(s, 4.0), rates=(SKY, 1.0), slewing=False)
        mount.hear(1.0)
        mount.slewing = True
        mount.hear(20.0)
        assert "DeclinationRate" not in mount.ignored
        assert not mount.standstill.at_rest

    def test_it_hangs_in_mid_motion_and_the_rate_fields_are_constant(self) -> None:
        hangs = Watched(dec=lambda s: min(s, 3.0) + max(0.0, s - 4.9))
        hangs.rates = (SKY, 0.0)
        for _ in range(100):
            hangs.hear(PERIOD_S)
            assert not hangs.standstill.at_rest
        stops = Watched(dec=lambda s: min(s, 3.0))
        stops.hear(3.0 + HANGS_S + 4 * PERIOD_S)
        assert stops.standstill.at_rest

    def test_it_hangs_as_an_hour_angle_after_a_move_too_short_to_doubt_a_field(self) -> None:
        hangs = Watched(lambda s: min(max(0.0, s - 1.0), 0.5) + max(0.0, s - 3.4), rates=(0.0, 0.0))
        for _ in range(90):
            hangs.hear(PERIOD_S)
            assert hangs.seconds < 1.0 + 2 * PERIOD_S or not hangs.standstill.at_rest, hangs.seconds

    def test_of_a_mount_that_is_taken_over_positions_that_repeat_show_rest_late(self) -> None:
        mount = Watched(standing)
        mount.standstill.positions.may_have_moved = True
        mount.hear(HANGS_S - 2 * PERIOD_S)
        assert not mount.standstill.at_rest
        mount.hear(4 * PERIOD_S)
        assert mount.standstill.at_rest

    @pytest.mark.parametrize("number", [85, 449, 559, 626, 3, 8])
    def test_mounts_that_others_have_written(self, number: int) -> None:
        drawn = rest.draw(5, number)._replace(encoders=rest.draw_encoders(5, number))
        outcome = rest.run(drawn)
        assert outcome.called_s is not None
        assert not outcome.early


def test_a_clock_that_stands_still_is_replaced_by_arrivals_once_positions_have_changed() -> None:
    mount = Watched(lambda s: min(s, 4.0), dec=lambda s: 0.3 * min(s, 4.0), rates=(1.0, 0.3))
    mount.clock_step_s = 1e6
    mount.hear(3.9)
    assert not mount.standstill.at_rest
    mount.rates = (0.0, 0.0)
    mount.hear(HANGS_S + 1.0)
    assert mount.standstill.at_rest
    frozen = Watched()
    frozen.clock_step_s = 1e6
    frozen.hear(20.0)
    assert not frozen.standstill.at_rest


def test_a_number_that_is_none_once_does_not_cost_a_field() -> None:
    mount = Watched()
    mount.hear(1.0)
    mount.rates = (math.nan, 0.0)
    mount.hear(PERIOD_S)
    mount.rates = (SKY, 0.0)
    mount.hear(2 * PERIOD_S)
    assert mount.standstill.at_rest
    assert mount.ignored == set()


@pytest.mark.parametrize(("step_s", "noise_deg"), [(1.0, 0.0), (1.0, 5e-5), (0.0, 5.0 / 3600.0)])
def test_a_clock_of_whole_seconds_or_5_arcsec_of_noise_make_rest_late_and_not_impossible(
    step_s: float, noise_deg: float
) -> None:
    mount = Watched()
    mount.clock_step_s, mount.noise_deg = step_s, noise_deg
    mount.hear(9.0)
    seen = 0
    for _ in range(40):
        mount.hear(PERIOD_S)
        seen += mount.standstill.at_rest
    assert seen > 30
    moving = Watched(at(SKY + 2.0 * REST_RATE_DEG_S))
    moving.clock_step_s, moving.noise_deg = step_s, noise_deg
    for _ in range(400):
        moving.hear(PERIOD_S)
        assert not moving.standstill.at_rest


def test_fields_that_mean_what_they_should_are_used() -> None:
    mount = Watched(at(1.0), at(-0.5), rates=(1.0, -0.5), slewing=True)
    mount.hear(10.0)
    assert mount.ignored == set()


@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.soak)])
def test_stops_of_mounts_that_others_have_written(every: int) -> None:
    outcomes = [rest.run(rest.draw(3, number)) for number in range(0, 120, every)]
    assert [one.draw.seed for one in outcomes if one.called_s is None or one.early] == []
    assert len({one.draw.parameters["rate_fields"] for one in outcomes}) == 5
    assert {one.draw.mount for one in outcomes} == {0, 1, 2}


class TestParabola:
    """Against numpy's fit of a polynomial by least squares, and its covariance."""

    def test_it_is_the_least_squares_fit(self) -> None:
        dice = np.random.default_rng(5)
        for count in (8, 11, 40):
            times = np.sort(dice.uniform(0.0, 0.05 * count, count)) + 3.0
            angles = 30.0 + 2.0 * times - 0.7 * times**2 + dice.normal(0.0, 0.01, count)
            parabola = Parabola.over(times.tolist())
            assert parabola is not None
            fit = parabola.fit(angles.tolist())
            coefficients = np.polyfit(times, angles, 2)
            left = angles - np.polyval(coefficients, times)
            noise = math.sqrt(float(left @ left) / (count - 3))
            slope = np.polyder(coefficients)
            design = np.vander(times - times[-1], 3)
            gradient = np.array([2.0 * AHEAD_S, 1.0, 0.0])
            variance = float(gradient @ np.linalg.inv(design.T @ design) @ gradient)
            assert fit.rate_deg_s == pytest.approx(float(np.polyval(slope, times[-1])), rel=1e-6)
            assert fit.ahead_deg_s == pytest.approx(float(np.polyval(slope, times[-1] + AHEAD_S)), rel=1e-6)
            assert fit.noise_deg == pytest.approx(noise, rel=1e-6)
            assert fit.error_deg_s == pytest.approx(noise * math.sqrt(variance), rel=1e-6)

    def test_a_perfect_fit_is_not_believed_to_the_last_bit(self) -> None:
        parabola = Parabola.over([0.05 * number for number in range(10)])
        assert parabola is not None
        assert parabola.fit([7.0] * 10).noise_deg == LEAST_NOISE_DEG

    def test_times_of_two_instants_carry_none(self) -> None:
        assert Parabola.over([0.0] * 5 + [1.0] * 5) is None


STEP_S = 0.051
"""A little more than a period, so that ten of them fill half a second in spite of rounding."""


class Placed:
    """Positions of one mount whose clock, hour angle and declination are told one by one."""

    def __init__(self) -> None:
        self.positions = Positions()

    def take(
        self,
        seconds: float,
        hour_angle: float,
        dec: float,
        clock_s: float | None = None,
        beyond: bool = False,
    ) -> None:
        sidereal_deg = 359.99 + (seconds if clock_s is None else clock_s) * SIDEREAL_DEG_S
        ra_deg = (sidereal_deg - hour_angle) % 360.0
        self.positions.take(T0 + seconds, sidereal_deg % 360.0 / 15.0, ra_deg, dec, beyond)


class TestPositions:
    @pytest.mark.parametrize("begins_deg", [0.0, 179.9, -90.0])
    def test_rates_of_even_acceleration(self, begins_deg: float) -> None:
        """Hour angle a t²/2, declination -b t²/2: the mean over half a second is that at its middle."""
        mount, a, b = Placed(), 3.0, 2.0
        for number in range(60):
            t = STEP_S * number
            mount.take(t, begins_deg + 0.5 * a * t * t, 10.0 - 0.5 * b * t * t)
            rates = mount.positions.rates_deg_s()
            if number < 10:
                assert rates is None
                assert mount.positions.last_rates_deg_s() == (0.0, 0.0)
            else:
                middle_s = t - 5.0 * STEP_S
                assert rates == pytest.approx((a * middle_s, -b * middle_s), abs=1e-4)
                assert mount.positions.last_rates_deg_s() == pytest.approx((a * t, -b * t), abs=1e-4)

    def test_positions_of_less_than_ten_a_second_are_too_few_for_the_shortest_window(self) -> None:
        few, enough = Placed(), Placed()
        for number in range(12):
            few.take(0.1 * number, 0.0, 10.0 + 0.01 * number)
            enough.take(0.07 * number, 0.0, 10.0 + 0.01 * number)
        assert few.positions.rates_deg_s() is None
        assert enough.positions.rates_deg_s() == pytest.approx((0.0, 0.01 / 0.07), abs=1e-6)

    @pytest.mark.parametrize(("jump_s", "kept"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)])
    def test_a_clock_that_jumps_makes_positions_begin_anew(self, jump_s: float, kept: bool) -> None:
        mount = Placed()
        for number in range(40):
            t = 0.05 * number
            mount.take(t, 0.0, 10.0 + t, clock_s=t + (jump_s if number >= 20 else 0.0))
            if number == 29:
                assert (mount.positions.rates_deg_s() is not None) is kept
        assert mount.positions.rates_deg_s() == pytest.approx((0.0, 1.0), abs=1e-6)

    def test_beyond_the_pole_positions_begin_anew(self) -> None:
        mount = Placed()
        for number in range(31):
            mount.take(STEP_S * number, 0.0, 10.0 + 0.05 * number, beyond=number >= 20)
            assert (mount.positions.rates_deg_s() is None) == (number < 10 or 20 <= number < 30)

    def test_how_long_an_axis_repeats(self) -> None:
        mount = Placed()
        for number in range(41):
            t = 0.05 * number
            mount.take(t, SIDEREAL_DEG_S * t, 10.0 + min(t, 1.0))
        # The hour angle turns with the sky: right ascension repeats from the first status on.
        assert mount.positions.repeats_s == pytest.approx((math.inf, 1.0))
        assert mount.positions.may_hang == (False, True)
        still = Placed()
        for number in range(41):
            still.take(0.05 * number, 0.02 * number, 10.0)
        assert still.positions.repeats_s == (0.0, math.inf)
        assert still.positions.may_hang == (False, False)

    @pytest.mark.parametrize("axis", [0, 1])
    @pytest.mark.parametrize(("slow_statuses", "hangs"), [(1, True), (2, False)])
    def test_an_axis_may_hang_that_was_fast_in_one_of_the_last_two_statuses(
        self, axis: int, slow_statuses: int, hangs: bool
    ) -> None:
        """An encoder that begins to hang between two statuses has gone a part of the way."""
        mount = Placed()
        fast_deg, slow_deg = -0.02 * 0.05, -0.002 * 0.05
        for number in range(41):
            moved = fast_deg * min(number, 10) + slow_deg * min(max(number - 10, 0), slow_statuses)
            mount.take(0.05 * number, moved if axis == 0 else 0.0, 10.0 + (moved if axis == 1 else 0.0))
        assert mount.positions.may_hang[axis] is hangs

    @pytest.mark.parametrize(
        ("axis", "speed_deg_s", "repeats_s", "hangs"),
        [
            (axis, *row)
            for axis in (0, 1)
            for row in (
                (1.0, 0.20, False),
                (1.0, 0.30, True),
                (1.0, 1.95, True),
                (1.0, 2.05, False),
                (0.004, 1.0, False),
                (0.012, 1.0, True),
                (-0.0045, 1.0, False),
                (-0.0055, 1.0, True),
                (25.0, 1.0, False),
            )
        ],
    )
    def test_an_axis_that_moved_and_repeats_may_hang(
        self, axis: int, speed_deg_s: float, repeats_s: float, hangs: bool
    ) -> None:
        """From half a window to two seconds, and not after less than 0.005°/s or a jump at over 20°/s."""
        mount = Placed()
        for number in range(round((1.0 + repeats_s) / 0.05) + 1):
            t = 0.05 * number
            moved = speed_deg_s * min(t, 1.0)
            mount.take(t, moved if axis == 0 else 0.0, 10.0 + (moved if axis == 1 else 0.0))
        assert mount.positions.may_hang == ((hangs, False) if axis == 0 else (False, hangs))

    def test_a_clock_that_stands_is_replaced_after_two_and_a_half_seconds_of_new_places(self) -> None:
        mount = Placed()
        for number in range(80):
            t = 0.05 * number
            mount.take(t, 1.0 * t, 10.0 + 0.3 * t, clock_s=0.0)
            rates = mount.positions.rates_deg_s()
            assert (rates is None) == (number < 60)
            if rates is not None:
                assert rates == pytest.approx((1.0 + SIDEREAL_DEG_S, 0.3), abs=0.03)
        assert mount.positions.rates_deg_s() == pytest.approx((1.0 + SIDEREAL_DEG_S, 0.3), abs=1e-6)

    def test_a_clock_that_stands_is_replaced_after_ten_new_places(self) -> None:
        mount = Placed()
        for number in range(80):
            moved = number - 60
            mount.take(STEP_S * number, 0.0, 10.0 + 0.05 * max(0, moved), clock_s=0.0)
            # Arrivals take the clock's place with the tenth of them, and ten fill half a second.
            assert (mount.positions.rates_deg_s() is None) == (moved < 19)

    @pytest.mark.parametrize("step_s", [0.6, 0.97, 1.08, 1.3, 1.9])
    @pytest.mark.parametrize("rate_deg_s", [0.0, SIDEREAL_DEG_S, 1.7 * SIDEREAL_DEG_S, -0.01])
    def test_rest_of_a_telescope_that_answers_slowly(self, step_s: float, rate_deg_s: float) -> None:
        """It moves at 1 °/s until a moment after one of its statuses; then its hour angle turns at a rate."""
        mount, stops_s, seen_s = Placed(), 10.0 * step_s + 0.3, []
        for number in range(60):
            t = step_s * number
            mount.take(t, 1.0 * min(t, stops_s) + rate_deg_s * max(0.0, t - stops_s), 10.0)
            if mount.positions.rest() is not None:
                seen_s.append(t)
        if rate_deg_s not in {0.0, SIDEREAL_DEG_S}:
            assert seen_s == []
            return
        # Eight positions, and eight seconds.
        assert stops_s + 7.0 * step_s < min(seen_s) < stops_s + max(8.0 * step_s, 8.0) + 1.5 * step_s
        assert len(seen_s) == round((60 * step_s - min(seen_s)) / step_s)

    def test_positions_from_before_a_silence_do_not_show_rest(self) -> None:
        mount = Placed()
        for number in range(20):
            mount.take(1.5 * number, 0.0, 10.0)
        assert mount.positions.rest() is not None
        for number in range(7):
            mount.take(60.0 + 1.5 * number, 0.0, 10.0)
            assert mount.positions.rest() is None
        mount.take(60.0 + 10.5, 0.0, 10.0)
        assert mount.positions.rest() is not None

    def test_rest_is_that_of_new_positions_and_none_older_than_a_second_and_a_half(self) -> None:
        mount = Placed()
        for number in range(40):
            mount.take(0.05 * number, 0.0, 10.0)
        last_s = T0 + 39 * 0.05
        assert mount.positions.rest() is not None
        assert mount.positions.rest(last_s - 0.65) is not None
        assert mount.positions.rest(last_s - 0.45) is None
        # The same status again, later: no position, but heard.
        for after_s, rests in ((1.45, True), (1.55, False)):
            mount.take(39 * 0.05 + after_s, 0.0, 10.0, clock_s=39 * 0.05)
            assert (mount.positions.rest() is not None) is rests


@pytest.mark.parametrize("share", [0.6, -0.6])
@pytest.mark.parametrize("axis", ["hour angle", "declination"])
def test_an_axis_clearly_slower_than_the_bound_is_at_rest(share: float, axis: str) -> None:
    rate = share * REST_RATE_DEG_S
    for sky_rate in (0.0, SKY):
        mount = Watched(at(sky_rate + rate)) if axis == "hour angle" else Watched(at(sky_rate), at(rate))
        mount.hear(1.0)
        assert mount.standstill.at_rest


@pytest.mark.parametrize("jump_deg", [(3.0, 0.0), (0.0, 3.0)])
def test_a_sync_of_an_axis_that_stands_delays_rest_and_no_more(jump_deg: tuple[float, float]) -> None:
    jumped = [0.0]
    mount = Watched(lambda s: jump_deg[0] * jumped[0], lambda s: jump_deg[1] * jumped[0], rates=(0.0, 0.0))
    mount.hear(2.0)
    jumped[0] = 1.0
    mount.hear(2 * PERIOD_S)
    assert not mount.standstill.at_rest
    mount.hear(WINDOWS_S[0] + PERIOD_S)
    assert mount.standstill.at_rest


class TestFieldsInTime:
    """To the status: a contradiction begins with the first status that has it."""

    @staticmethod
    def ignored_after_s(mount: Watched, name: str, longest_s: float = 8.0) -> float:
        while name not in mount.ignored:
            assert mount.seconds < longest_s
            mount.hear(PERIOD_S)
        return mount.seconds

    def test_a_number_that_is_none_goes_after_a_quarter_of_a_second(self) -> None:
        mount = Watched(rates=(math.nan, 0.0))
        # The first status comes at 0.05 s.
        assert 0.29 < self.ignored_after_s(mount, "RightAscensionRate") < 0.36

    @pytest.mark.parametrize(
        ("rates", "slewing", "name"),
        [
            ((1.0, 0.0), False, "RightAscensionRate"),
            ((SKY, 1.0), False, "DeclinationRate"),
            ((SKY, 0.0), True, "Slewing"),
        ],
    )
    def test_motion_that_positions_deny_goes_three_seconds_after_rest_is_seen(
        self, rates: tuple[float, float], slewing: bool, name: str
    ) -> None:
        mount = Watched(rates=rates, slewing=slewing)
        mount.hear(0.55)
        assert mount.standstill.positions.rest() is None
        mount.hear(PERIOD_S)
        assert mount.standstill.positions.rest() is not None
        after_s = self.ignored_after_s(mount, name) - 0.6
        assert CONTRADICTED_S - 0.01 < after_s < CONTRADICTED_S + PERIOD_S + 0.01

    def test_a_contradiction_that_ends_is_forgotten(self) -> None:
        mount = Watched(rates=(1.0, 0.0))
        mount.hear(3.0)
        mount.rates = (SKY, 0.0)
        mount.hear(PERIOD_S)
        mount.rates = (1.0, 0.0)
        mount.hear(2.9)
        assert mount.ignored == set()
        mount.hear(0.3)
        assert mount.ignored == {"RightAscensionRate"}

    @pytest.mark.parametrize(
        ("rate", "reported", "names"),
        [
            # A third of the rate and 0.1°/s is what a field may be off.
            (1.0, 0.62, set()),
            (1.0, 0.58, {"RightAscensionRate"}),
            (-1.0, 1.38, set()),
            (-1.0, 1.42, {"RightAscensionRate"}),
        ],
    )
    def test_a_rate_that_is_another_than_that_of_positions_goes(
        self, rate: float, reported: float, names: set[str]
    ) -> None:
        mount = Watched(at(rate), rates=(reported, 0.0), slewing=True)
        mount.hear(5.0)
        assert mount.ignored == names

    def test_what_goes_is_made_good_from_positions(self) -> None:
        mount = Watched(at(1.0), at(-0.5))
        mount.hear(5.0)
        assert mount.ignored == {"RightAscensionRate", "DeclinationRate", "Slewing"}
        mount.count, mount.seconds = mount.count + 1, mount.seconds + PERIOD_S
        believed = mount.standstill.see(mount.sample(), aborted=True, move_axis=False)
        assert believed.ra_drive_deg_s == pytest.approx(1.0, abs=1e-6)
        assert believed.dec_drive_deg_s == pytest.approx(-0.5, abs=1e-6)
        assert believed.slewing is True
        assert mount.standstill.slowing is False

    def test_a_single_number_that_is_none_is_made_good_at_once(self) -> None:
        mount = Watched(at(1.0), at(-0.5), rates=(1.0, -0.5), slewing=True)
        mount.hear(2.0)
        mount.rates = (math.nan, -0.5)
        mount.count, mount.seconds = mount.count + 1, mount.seconds + PERIOD_S
        believed = mount.standstill.see(mount.sample(), aborted=True, move_axis=False)
        assert believed.ra_drive_deg_s == pytest.approx(1.0, abs=1e-6)
        assert (believed.dec_drive_deg_s, believed.slewing) == (-0.5, True)
        mount.rates = (1.0, -0.5)
        told = mount.sample()
        assert mount.standstill.see(told, aborted=True, move_axis=False) is told

    @pytest.mark.parametrize(
        ("reported", "aborted", "names"),
        [
            # Wrong in motion: believed no more at rest.
            (3.0, False, {"DeclinationRate"}),
            # Right in motion: the encoder may hang.
            (1.0, False, set()),
            (1.0, True, set()),
        ],
    )
    def test_a_rate_that_goes_on_beside_a_declination_that_repeats(
        self, reported: float, aborted: bool, names: set[str]
    ) -> None:
        mount = Watched(dec=lambda s: min(s, 1.5), rates=(SKY, reported), slewing=True)
        mount.aborted = aborted
        mount.hear(1.5)
        mount.slewing = False
        mount.hear(6.0)
        assert mount.ignored == names

    @pytest.mark.parametrize("aborted", [False, True])
    def test_a_rate_beside_a_declination_that_never_moved_goes_once_an_abort_was_acknowledged(
        self, aborted: bool
    ) -> None:
        mount = Watched(rates=(SKY, 0.5))
        mount.aborted = aborted
        mount.hear(4.0)
        assert mount.ignored == ({"DeclinationRate"} if aborted else set())

    @pytest.mark.parametrize(
        ("reported", "arrived", "names"),
        [(1.0, False, set()), (1.0, True, {"Slewing"}), (0.0, False, {"Slewing"})],
    )
    def test_slewing_that_goes_on_beside_positions_that_repeat_goes_at_the_target_or_where_rates_say_rest(
        self, reported: float, arrived: bool, names: set[str]
    ) -> None:
        """Elsewhere the encoder of an axis in motion may hang."""
        mount = Watched(dec=lambda s: min(s, 2.0) + min(max(0.0, s - 6.0), 2.0))
        mount.aborted = False
        for rate, seconds in ((1.0, 2.0), (0.0, 4.0), (1.0, 2.0)):
            mount.rates, mount.slewing = (SKY, rate), rate > 0.0
            mount.hear(seconds)
        assert mount.standstill.fields.confirmed("Slewing")
        mount.rates, mount.arrived = (SKY, reported), arrived
        mount.hear(6.0)
        assert mount.ignored == names

    def test_the_rate_of_an_axis_that_speeds_up_may_be_that_of_now(self) -> None:
        """At 3°/s² the mean of half a second is 0.75°/s behind."""
        mount = Watched(lambda s: 1.5 * s * s, lambda s: -1.0 * s * s, slewing=True)
        for number in range(1, 31):
            mount.rates = (3.0 * number * PERIOD_S, -2.0 * number * PERIOD_S)
            mount.hear(PERIOD_S)
        for name in ("RightAscensionRate", "DeclinationRate"):
            assert mount.standstill.fields.trusted(name, T0 + mount.seconds)

    @pytest.mark.parametrize(("statuses", "confirmed"), [(9, False), (10, True)])
    def test_ten_statuses_confirm_a_field(self, statuses: int, confirmed: bool) -> None:
        mount = Watched(at(1.0), rates=(1.0, 0.0), slewing=True)
        mount.hear(11 * PERIOD_S)
        fields = mount.standstill.fields
        assert not fields.confirmed("RightAscensionRate")
        mount.hear(statuses * PERIOD_S)
        assert fields.confirmed("RightAscensionRate") is confirmed
        assert fields.confirmed("DeclinationRate") is False
        # Of Slewing both its values must have been right.
        assert fields.confirmed("Slewing") is False

    def test_slewing_is_confirmed_by_motion_and_by_rest(self) -> None:
        mount = Watched(lambda s: min(s, 2.0), rates=(1.0, 0.0), slewing=True)
        mount.hear(2.0)
        mount.slewing, mount.rates = False, (0.0, 0.0)
        mount.hear(1.0)
        assert mount.standstill.fields.confirmed("Slewing") is False
        mount.hear(1.0 + 12 * PERIOD_S)
        assert mount.standstill.fields.confirmed("Slewing") is True

    def test_slewing_that_is_true_at_rest_is_not_confirmed(self) -> None:
        mount = Watched(slewing=True)
        mount.hear(1.0)
        mount.slewing = False
        mount.hear(1.5)
        assert mount.standstill.fields.confirmed("Slewing") is False

    def test_a_rate_that_was_wrong_lately_is_not_trusted_for_ten_seconds(self) -> None:
        mount = Watched(at(1.0), rates=(1.0, 0.0), slewing=True)
        mount.hear(3.0)
        fields = mount.standstill.fields
        assert fields.trusted("RightAscensionRate", T0 + mount.seconds) is True
        mount.rates = (3.0, 0.0)
        mount.hear(PERIOD_S)
        wrong_s = T0 + mount.seconds
        mount.rates = (1.0, 0.0)
        assert fields.trusted("RightAscensionRate", wrong_s + 9.9) is False
        assert fields.trusted("RightAscensionRate", wrong_s + 10.1) is True
        assert fields.confirmed("RightAscensionRate") is True

    def test_a_rate_that_was_wrong_in_sixteen_statuses_and_more_often_than_right_is_doubtful(self) -> None:
        mount = Watched(at(1.0), rates=(3.0, 0.0), slewing=True)
        mount.hear(26 * PERIOD_S)
        fields = mount.standstill.fields
        assert fields.doubtful("RightAscensionRate") is False
        mount.hear(PERIOD_S)
        assert fields.doubtful("RightAscensionRate") is True
        mount.rates = (1.0, 0.0)
        mount.hear(15 * PERIOD_S)
        assert fields.doubtful("RightAscensionRate") is True
        mount.hear(PERIOD_S)
        assert fields.doubtful("RightAscensionRate") is False


class Stopping:
    """A mount whose abort was acknowledged, told by its drives; its positions stand."""

    def __init__(self, late_statuses: int = 0) -> None:
        self.standstill = Standstill(late_statuses=late_statuses)
        self.standstill.asked()
        self.seconds = 0.0

    def see(
        self, ra_drive: float, slewing: bool = False, dec_drive: float = 0.0, aborted: bool = True
    ) -> None:
        self.seconds += PERIOD_S
        sidereal_h = 9.0 + self.seconds * SIDEREAL_DEG_S / 15.0
        ra_deg = sidereal_h * 15.0 - 30.0
        drives = ra_drive, dec_drive
        sample = StatusSample(0, T0 + self.seconds, sidereal_h, ra_deg, 10.0, slewing, False, *drives)
        self.standstill.see(sample, aborted, move_axis=True)

    def statuses_until_again(self) -> int:
        count = 0
        while not self.standstill.goes_again:
            assert count < 1000
            self.see(1.0, slewing=True)
            count += 1
        self.standstill.again(T0 + self.seconds)
        return count


class TestStops:
    @pytest.mark.parametrize("late", [0, 4])
    def test_it_goes_again_after_three_statuses_then_six_then_twelve(self, late: int) -> None:
        assert Stopping(late).statuses_until_again() == 3 + late
        mount = Stopping(late)
        mount.see(2.0, slewing=True)
        # The first of them is slower than the one before.
        first = 3 + late
        assert [mount.statuses_until_again() for _ in range(3)] == [1 + first, 2 * first, 4 * first]

    def test_it_never_waits_for_more_than_320_statuses(self) -> None:
        mount = Watched(at(1.0), rates=(1.0, 0.0), slewing=True)
        for _ in range(7):
            mount.standstill.again(T0)
        mount.hear(319 * PERIOD_S)
        assert mount.standstill.goes_again is False
        mount.hear(PERIOD_S)
        assert mount.standstill.goes_again is True

    def test_it_goes_again_where_positions_alone_show_a_mount_that_moves_on(self) -> None:
        """Slewing is false, and the rate fields say rest."""
        mount = Watched(at(1.0))
        mount.standstill.asked()
        # The first eleven fill half a second.
        mount.hear(13 * PERIOD_S)
        assert mount.standstill.goes_again is False
        mount.hear(PERIOD_S)
        assert mount.standstill.goes_again is True
        for rate, again in ((0.09, False), (0.11, True)):
            slow = Watched(at(rate))
            slow.hear(2.0)
            assert slow.standstill.goes_again is again

    def test_it_waits_while_positions_show_the_mount_slowing_down(self) -> None:
        mount = Watched(lambda s: min(s, 1.25) - 0.4 * min(s, 1.25) ** 2, rates=(0.0, 0.0))
        for _ in range(40):
            mount.hear(PERIOD_S)
            assert mount.standstill.goes_again is False

    def test_it_waits_while_the_mount_slows_down(self) -> None:
        mount = Stopping()
        for number in range(50):
            mount.see(5.0 - 0.1 * number, slewing=True)
            assert mount.standstill.slowing is (number > 0)
            assert mount.standstill.goes_again is False

    def test_it_goes_again_to_a_servo_that_settles_on_its_rate_from_above(self) -> None:
        mount = Stopping()
        for number in range(5):
            mount.see(0.959 * (1.0 + 0.0009 * math.exp(-number / 30.0)), slewing=True)
        assert mount.standstill.goes_again is True

    def test_axes_that_stood_and_follow_the_sky_have_turned_after_two_statuses(self) -> None:
        mount = Stopping()
        mount.see(SKY)
        mount.see(SKY)
        assert mount.standstill.turned is False
        mount.see(0.0)
        mount.see(SKY)
        assert mount.standstill.turned is False
        mount.see(SKY)
        assert mount.standstill.turned is True
        assert mount.standstill.goes_again is True
        mount.standstill.again(T0)
        assert mount.standstill.turned is False

    def test_before_the_acknowledgement_and_in_motion_none_of_it_counts(self) -> None:
        mount = Stopping()
        mount.see(0.0, aborted=False)
        mount.see(SKY)
        mount.see(SKY)
        assert mount.standstill.turned is False
        mount.see(0.0)
        mount.see(SKY, dec_drive=0.1)
        mount.see(SKY)
        mount.see(SKY)
        assert mount.standstill.turned is False

    def test_a_mount_that_took_to_the_sky_three_times_does_so_by_itself(self) -> None:
        mount = Stopping()
        turned = []
        for _ in range(4):
            for rate in (0.0, SKY, SKY):
                mount.see(rate)
            turned.append(mount.standstill.turned)
            mount.standstill.again(T0)
        assert turned == [True, True, True, False]
        mount.standstill.asked()
        for rate in (0.0, SKY, SKY):
            mount.see(rate)
        assert mount.standstill.turned is True

    def test_a_stop_that_acts_late_counts_from_its_acknowledgement(self) -> None:
        for late, again in ((0, True), (1, False)):
            mount = Stopping(late)
            for _ in range(3 + late):
                mount.see(1.0, slewing=True)
            mount.standstill.acknowledged(T0)
            assert mount.standstill.goes_again is again

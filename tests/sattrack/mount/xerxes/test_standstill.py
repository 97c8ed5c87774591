"""Rest by positions: tables of positions made by hand, and mounts written from the paper by others."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

import pytest
import rest

from sattrack.mount.model import StatusSample
from sattrack.mount.xerxes.standstill import CONTRADICTED_S, HANGS_S, REST_RATE_DEG_S, WINDOWS_S, Standstill

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
        self.dice = random.Random(1)
        self.seconds = 0.0
        self.count = 0

    def hear(self, seconds: float, loss: float = 0.0) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.count += 1
            self.seconds += PERIOD_S
            if self.dice.random() >= loss:
                self.standstill.see(self.sample(), aborted=True, move_axis=False)

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
    assert seen > 10
    moving = Watched(at(SKY + 2.0 * REST_RATE_DEG_S))
    moving.clock_step_s, moving.noise_deg = step_s, noise_deg
    for _ in range(400):
        moving.hear(PERIOD_S)
        assert not moving.standstill.at_rest


def test_fields_that_mean_what_they_should_are_used() -> None:
    mount = Watched(at(1.0), at(-0.5), rates=(1.0, -0.5), slewing=True)
    mount.hear(10.0)
    assert mount.ignored == set()


def test_stops_of_mounts_that_others_have_written() -> None:
    outcomes = rest.stops(120, seed=3, processes=1)
    assert [one.draw.seed for one in outcomes if one.called_s is None or one.early] == []
    assert len({one.draw.parameters["rate_fields"] for one in outcomes}) == 5
    assert len(outcomes) == 120

"""What becomes of a wish that a limit stands in the way of: the nearest that is free, and no more."""

from __future__ import annotations

import copy
import dataclasses
import math
from itertools import pairwise
from typing import Any

import pytest
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, PERIOD_S, T0, Stand, axis_speed_deg_s, steadily
from strangers import velocity_servo

from sattrack.control.driver import Driver
from sattrack.core.angles import altitude_deg, separation_deg
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile, MoveAxes, Slew, mean_sidereal_deg
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import Safety, SafetyLimits
from sattrack.safety.bodies import BodyDirection, sun_over
from sattrack.safety.rate_limit import nearest_rates

DARK = SafetyLimits(floor_altitude_deg=-90.0, optical=False)


FREELY = ((-math.inf, math.inf), (-math.inf, math.inf))


def test_a_wall_across_one_axis_leaves_the_other_what_it_wishes() -> None:
    assert nearest_rates((0.6, 0.02), FREELY, 1.0, lambda rates: rates[0] <= 0.0) == pytest.approx(
        (0.0, 0.02)
    )
    assert nearest_rates((0.02, -0.6), FREELY, 0.3, lambda rates: rates[1] >= 0.0) == pytest.approx(
        (0.02, 0.0)
    )


def test_a_wall_that_lets_some_through_lets_it_through_and_the_other_axis_wholly() -> None:
    ha, dec = nearest_rates((0.64, 0.4), FREELY, 1.0, lambda rates: rates[0] <= 0.11)
    assert 0.08 <= ha <= 0.11
    assert dec == pytest.approx(0.4)


@pytest.mark.parametrize("wish_deg", [0, 53, 200])
@pytest.mark.parametrize("wall_deg", range(-80, 81, 10))
def test_along_a_slanting_wall_goes_what_of_the_wish_leads_there(wall_deg: int, wish_deg: int) -> None:
    """The nearest point of a half plane to a wish beyond it is its foot on the wall."""
    wall, turn = math.radians(wish_deg + wall_deg), math.radians(wish_deg)
    across, wish = (math.cos(wall), math.sin(wall)), (math.cos(turn), math.sin(turn))
    beyond = wish[0] * across[0] + wish[1] * across[1]
    foot = (wish[0] - beyond * across[0], wish[1] - beyond * across[1])
    found = nearest_rates(
        (2.0 * wish[0], wish[1]),
        FREELY,
        0.5,
        lambda rates: 0.5 * rates[0] * across[0] + rates[1] * across[1] <= 1e-9,
    )
    # At 60° of declination, an hour angle is half as much of the sky.
    found = 0.5 * found[0], found[1]
    nearest = math.dist(wish, foot)
    assert nearest <= math.dist(wish, found) + 1e-9
    # Directions are tried down to 7° apart; what gains next to nothing is not worth leaving the way.
    # Where one axis alone gains something, finer directions are not tried.
    assert math.dist(wish, found) ** 2 <= nearest**2 + (0.15 if wish_deg == 0 else 0.25)


def test_what_a_ramp_leaves_of_a_wish_keeps_to_the_way_along_the_wall() -> None:
    """The wish is 5 °/s into the wall and 2 °/s along it; a step of the ramp is 0.5 °/s from rest."""
    room = ((-0.5, 0.5), (-0.5, 0.5))
    assert nearest_rates((5.0, 2.0), room, 1.0, lambda rates: rates[0] <= 0.0) == pytest.approx((0.0, 0.5))
    free = nearest_rates((5.0, 2.0), room, 1.0, lambda _: True)
    assert free == pytest.approx((0.5, 0.5))


def test_rest_is_the_answer_where_nothing_is_free() -> None:
    assert nearest_rates((1.0, -1.0), FREELY, 0.5, lambda rates: rates == (0.0, 0.0)) == (0.0, 0.0)
    assert nearest_rates((0.0, 0.0), FREELY, 0.5, lambda _: True) == (0.0, 0.0)


def test_nothing_leads_away_from_the_wish() -> None:
    wish = (0.5, 0.1)
    for hole in range(0, 360, 15):
        h = math.radians(hole)

        def in_a_sector(rates: tuple[float, float], h: float = h) -> bool:
            off = math.remainder(math.atan2(rates[1], rates[0]) - h, 2.0 * math.pi)
            return rates == (0.0, 0.0) or abs(off) < 0.2

        found = nearest_rates(wish, FREELY, 1.0, in_a_sector)
        assert math.dist(wish, found) <= math.hypot(*wish)


def test_axes_held_at_the_end_of_one_ones_travel_go_on_quietly_with_the_other() -> None:
    """The declination axis has no reason to leave its way at 0.05 °/s for one at 1 °/s."""
    profile = MountProfile(hour_angle_limit_deg=60.0)
    stand = Stand(steadily(1.0, 0.05), DARK, StartPosition(55.0, 10.0), profile=profile)
    stand.run(20.0)
    assert stand.met_s is not None
    held = [truth for t, truth in stand.truths if t > stand.met_s + 0.2]
    assert max(abs(truth.dec_rate_deg_s - 0.05) for truth in held) < 0.1
    assert axis_speed_deg_s(held[-1]) < 0.06
    assert max(truth.hour_angle_axis_deg for truth in held) < 60.0
    at_the_end = [SIDEREAL_RATE_DEG_S - truth.ra_rate_deg_s for truth in held[-100:]]
    assert max(at_the_end) - min(at_the_end) < 0.02


def test_axes_held_at_the_suns_cone_go_round_it_after_what_passed_behind_it() -> None:
    """The wish leads straight into the cone at first, then past it: they do not stay where they met it."""
    limits = SafetyLimits(floor_altitude_deg=0.0, sun_cone_deg=15.0)
    sun = sun_over(LATITUDE_DEG, LONGITUDE_DEG).at(T0)
    start = StartPosition(sun.hour_angle_deg - 1.0, sun.dec_deg + 18.0)

    def wish(t: float) -> MoveAxes:
        # South at first; then, as the target draws away to the west, more and more that way.
        return MoveAxes(SIDEREAL_RATE_DEG_S - min(2.0, 0.1 * t), -0.5)

    stand = Stand(wish, limits, start).run(40.0)
    assert stand.met_s is not None
    assert stand.safety.tripped is None
    last = stand.truths[-1][1]
    assert last.hour_angle_axis_deg > sun.hour_angle_deg + 10.0
    bodies = [(truth, sun_over(LATITUDE_DEG, LONGITUDE_DEG).at(T0 + t)) for t, truth in stand.truths[::20]]
    apart = [
        separation_deg(truth.hour_angle_axis_deg, truth.dec_axis_deg, body.hour_angle_deg, body.dec_deg)
        for truth, body in bodies
    ]
    assert min(apart) > 15.0


@pytest.mark.parametrize("beside_deg", [20.0, pytest.param(40.0, marks=pytest.mark.soak)])
def test_axes_held_at_the_floor_go_along_it_out_of_the_way_of_a_sun_that_comes_down(
    beside_deg: float,
) -> None:
    """The Sun stands 15.13° above axes that are wished into the ground, and sinks by more than is left."""
    over = sun_over(LATITUDE_DEG, LONGITUDE_DEG)
    sun = over.at(T0)
    start = below(sun, 15.13, beside_deg)
    floor_deg = altitude_deg(start.hour_angle_deg, start.dec_deg, LATITUDE_DEG) - 0.15
    limits = SafetyLimits(floor_altitude_deg=floor_deg, sun_cone_deg=15.0)
    stand = Stand(steadily(0.05, -0.05), limits, start).run(120.0)
    assert stand.safety.tripped is None
    later = over.at(T0 + 120.0)
    here = start.hour_angle_deg, start.dec_deg
    assert separation_deg(*here, later.hour_angle_deg, later.dec_deg) < 14.8
    for t, truth in stand.truths[::20]:
        body = over.at(T0 + t)
        here = truth.hour_angle_axis_deg, truth.dec_axis_deg
        assert separation_deg(*here, body.hour_angle_deg, body.dec_deg) > 15.0, t
        assert altitude_deg(*here, LATITUDE_DEG) > floor_deg, t


def below(sun: BodyDirection, by_deg: float, beside_deg: float) -> StartPosition:
    """Return the axes that point so far from the Sun, so many degrees beside straight down from it."""
    far, turn = math.radians(by_deg), math.radians(beside_deg)
    p, h, d = (math.radians(x) for x in (LATITUDE_DEG, sun.hour_angle_deg, sun.dec_deg))
    meridian, west, pole = math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)
    zenith = (math.cos(p), 0.0, math.sin(p))
    up = sum(a * b for a, b in zip((meridian, west, pole), zenith, strict=True))
    # Unit vectors at the Sun: toward the nadir, and at right angles to it, to the right as one sees it.
    down = [
        (up * a - b) / math.sqrt(1.0 - up * up) for a, b in zip((meridian, west, pole), zenith, strict=True)
    ]
    right = (
        down[2] * west - down[1] * pole,
        down[0] * pole - down[2] * meridian,
        down[1] * meridian - down[0] * west,
    )
    x, y, z = (
        math.cos(far) * a + math.sin(far) * (math.cos(turn) * b + math.sin(turn) * c)
        for a, b, c in zip((meridian, west, pole), down, right, strict=True)
    )
    return StartPosition(math.degrees(math.atan2(y, x)), math.degrees(math.asin(z)))


SLANTING = SafetyLimits(
    floor_altitude_deg=0.0,
    horizon=((15.7, 4.0), (82.6, 4.3), (144.2, 6.5), (208.8, 16.7), (274.4, 32.7), (302.7, 37.4)),
    optical=False,
)
"""Rises from 16.7° in the south-south-west to 37.4° in the west-north-west."""


@pytest.mark.parametrize(
    ("from_deg", "ha_deg_s", "dec_deg_s"),
    [
        (20.0, 0.5, 0.15),
        (20.0, 0.6, 0.25),
        *(pytest.param(10.0, *rates, marks=pytest.mark.soak) for rates in ((0.5, 0.15), (0.6, 0.25))),
    ],
)
def test_axes_held_at_a_slanting_skyline_go_on_along_it(
    from_deg: float, ha_deg_s: float, dec_deg_s: float
) -> None:
    """The skyline leads northwest: what of the wish leads along it goes on, after a moment at the wall."""
    stand = Stand(steadily(ha_deg_s, dec_deg_s), SLANTING, StartPosition(55.0, from_deg)).run(40.0)
    assert stand.met_s is not None
    assert stand.safety.tripped is None
    at_the_wall = [truth for t, truth in stand.truths if t > stand.met_s + 3.0]
    seconds = 40.0 - stand.met_s - 3.0
    went_deg = at_the_wall[-1].dec_axis_deg - at_the_wall[0].dec_axis_deg
    assert went_deg > 0.8 * dec_deg_s * seconds
    assert at_the_wall[-1].hour_angle_axis_deg > at_the_wall[0].hour_angle_axis_deg + 0.08 * seconds


def test_a_slew_for_which_there_is_no_way_holds_a_stream_where_it_is_and_ends_no_pass() -> None:
    """The mount turns 60° either way, and from everywhere in there the goal is past the end of it."""
    profile = MountProfile(hour_angle_limit_deg=60.0, dec_axis_limits_deg=(-5.0, 25.0))
    far = Slew(mean_sidereal_deg(T0, LONGITUDE_DEG) + 170.0, 10.0)

    def wish(t: float) -> MoveAxes | Slew:
        return MoveAxes(SIDEREAL_RATE_DEG_S - 0.3, 0.1) if t < 5.0 or t > 12.0 else far

    stand = Stand(wish, DARK, StartPosition(10.0, 10.0), profile=profile).run(20.0)
    assert stand.safety.tripped is None
    rests = [truth for t, truth in stand.truths if 8.0 < t < 12.0]
    assert max(axis_speed_deg_s(truth) for truth in rests) < 1e-3
    assert stand.truths[-1][1].hour_angle_axis_deg > rests[-1].hour_angle_axis_deg + 1.0
    begun = Stand(lambda _: far, DARK, StartPosition(10.0, 10.0), profile=profile).run(5.0)
    assert begun.safety.tripped == "hour_angle"


def test_what_is_held_keeps_its_rates_for_one_period_and_only_while_they_lead_past_no_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[float] = []
    stand = Stand(steadily(0.5, 0.15), SLANTING, StartPosition(55.0, 10.0))

    def look(*given: Any) -> tuple[float, float]:
        looked.append(stand.turns)
        return nearest_rates(*given)

    monkeypatch.setattr("sattrack.safety.gate.nearest_rates", look)
    stand.run(28.0)
    assert stand.safety.tripped is None
    assert stand.met_s is not None
    held_turns = stand.turns - round(stand.met_s / PERIOD_S)
    # Every other period, and besides where what was found a period ago would lead past the skyline.
    assert 0.5 <= len(looked) / held_turns < 0.9
    kept = [(one, other) for one, other in pairwise(looked) if other - one == 2.0]
    assert len(kept) > 0.2 * held_turns
    assert max(other - one for one, other in pairwise(looked)) == 2.0
    for one, _ in kept:
        # The turn after a look sends what that look found.
        assert stand.sent[int(one)] == stand.sent[int(one) - 1]


class LedAtTheFloor:
    """A mount of edges that is led down to 20° altitude.

    It acknowledges MoveAxis for so long; after that each new rate waits for the end of a handshake.
    """

    def __init__(self, begin_deg: float, answers_until_s: float = 0.0, fault_s: float = 0.5) -> None:
        profile = MountProfile(move_axis="edge")
        limits = SafetyLimits(floor_altitude_deg=20.0, optical=False, longest_fault_s=fault_s)
        self.driver = Driver(profile, Safety(profile, limits, LATITUDE_DEG, LONGITUDE_DEG, holds=True))
        parameters = velocity_servo.Parameters(
            latitude_deg=LATITUDE_DEG,
            longitude_deg=LONGITUDE_DEG,
            start_utc_s=T0,
            dec_deg=begin_deg,
            move_axis="edge",
            move_ack=answers_until_s > 0.0,
            acceleration_deg_s2=10.0,
        )
        self.mount = velocity_servo.Mount(parameters)
        self._answers = round(answers_until_s / PERIOD_S)
        self._rate, self._turns = 0.0, 0
        self.lowest_deg = math.inf

    def lead(self, seconds: float, heard: bool = True) -> LedAtTheFloor:
        """Lead it on; where it is not `heard`, it gets nothing."""
        driver, mount = self.driver, self.mount
        for _ in range(round(seconds / PERIOD_S)):
            if self._turns == self._answers:
                mount._p = dataclasses.replace(mount._p, move_ack=False)
            now_s = mount.next_turn_s
            driver.receive(mount.turn(), now_s + 0.001)
            truth = mount.truth()
            altitude = altitude_deg(truth.hour_angle_deg, truth.dec_deg, LATITUDE_DEG)
            self.lowest_deg = min(self.lowest_deg, altitude)
            self._rate = max(-5.0, self._rate - 0.25)
            driver.session.apply(driver.clear(MoveAxes(SIDEREAL_RATE_DEG_S, self._rate), now_s + 0.02))
            datagram = driver.compose(now_s + 0.02)
            if heard:
                mount.receive(datagram)
            self._turns += 1
        return self

    def copied(self) -> LedAtTheFloor:
        """Return one that stands where this one does, to be led on by itself."""
        layout = self.mount._status
        return copy.deepcopy(self, {id(layout): layout})


BEGINS_DEG = (0.0, 5.0, 10.0, 20.0)


@pytest.mark.parametrize("begin_deg", BEGINS_DEG)
def test_rates_that_do_not_reach_a_mount_that_takes_edges_hold_nothing_and_it_is_stopped(
    begin_deg: float,
) -> None:
    led = LedAtTheFloor(begin_deg, answers_until_s=2.5).lead(12.0)
    assert led.lowest_deg >= 20.0
    assert led.driver.safety.tripped == "altitude"


@pytest.mark.parametrize(
    "begin_deg", [0.0, 20.0, *(pytest.param(begin_deg, marks=pytest.mark.soak) for begin_deg in (5.0, 10.0))]
)
def test_a_mount_that_never_answers_is_held_and_a_fault_of_the_link_leads_it_past_no_limit(
    begin_deg: float,
) -> None:
    led = LedAtTheFloor(begin_deg).lead(12.0)
    assert led.lowest_deg >= 20.0
    assert led.driver.safety.tripped is None
    # A fault of 1.7 s every quarter of a second, each for a copy of what was led so far without one.
    led = LedAtTheFloor(begin_deg, fault_s=1.7).lead(2.0)
    for _ in range(8, 40):
        assert led.copied().lead(1.7, heard=False).lowest_deg >= 20.0
        led.lead(0.25)


def test_such_a_mount_would_pass_the_floor_if_it_were_not_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Safety, "in_time", lambda _, cleared, *__: cleared)
    monkeypatch.setattr(Safety, "_unheeded", lambda *_: None)
    led = [LedAtTheFloor(begin_deg, answers_until_s=2.5).lead(12.0) for begin_deg in BEGINS_DEG]
    assert min(one.lowest_deg for one in led) < 19.0

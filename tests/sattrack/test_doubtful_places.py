"""A bit of a status may turn over on its way: one wrong place must let nothing go, and stop no pass."""

from __future__ import annotations

import math

import pytest
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, PERIOD_S, Stand, steadily

from sattrack.mount import SIDEREAL_RATE_DEG_S, MountProfile, MoveAxes, SlewTo, Stop
from sattrack.safety import Safety, SafetyLimits, Seen
from sattrack.xerxes.simulator.facts import StartPosition

PROFILE = MountProfile()
LIMITS = SafetyLimits(floor_altitude_deg=20.0, optical=False)
LOW_DEC = LATITUDE_DEG - 90.0 + 20.0
"""On the meridian this declination is 20° high."""
HIGH_DEC = 60.0


class Gate:
    """Statuses of axes that stand on the meridian at a declination, and wishes to go down."""

    def __init__(self, holds: bool = True) -> None:
        self.safety = Safety(PROFILE, LIMITS, LATITUDE_DEG, LONGITUDE_DEG, holds)
        self.turn = 0

    def clears(self, dec_deg: float, rate_deg_s: float = -3.0) -> float | None:
        """Give one status; return the declination rate that may be sent, None where the mount is stopped."""
        self.turn += 1
        now_s = 1_790_000_000.0 + self.turn * PERIOD_S
        sidereal = self.turn * PERIOD_S * SIDEREAL_RATE_DEG_S
        wish = MoveAxes(SIDEREAL_RATE_DEG_S, rate_deg_s)
        self.safety.watch(Seen(None, sidereal, sidereal, dec_deg), MoveAxes(SIDEREAL_RATE_DEG_S, 0.0))
        motion = self.safety.clear(wish, sidereal, sidereal, dec_deg, 0.01, now_s).motion
        return motion.dec_rate_deg_s if isinstance(motion, MoveAxes) else None


def test_one_place_far_from_the_limit_does_not_let_go_what_is_held_at_it() -> None:
    gate = Gate()
    for _ in range(10):
        held = gate.clears(LOW_DEC + 0.2)
        assert held is not None
        assert held > -0.5
    for dec in [HIGH_DEC, *[LOW_DEC + 0.2] * 5, HIGH_DEC, HIGH_DEC]:
        rate = gate.clears(dec)
        assert rate is not None
        assert 1.05 * held <= rate <= 0.0


def test_one_place_past_a_limit_holds_and_does_not_stop() -> None:
    gate = Gate()
    for _ in range(10):
        assert gate.clears(HIGH_DEC) == -3.0
    assert gate.clears(LOW_DEC - 30.0) == 0.0
    rates = [gate.clears(HIGH_DEC) for _ in range(10)]
    assert rates[0] != 0.0
    assert rates[-1] == -3.0
    assert gate.safety.tripped is None


def test_a_place_past_a_limit_that_three_statuses_bear_out_stops_the_mount() -> None:
    gate = Gate()
    for _ in range(10):
        gate.clears(HIGH_DEC)
    rates = [gate.clears(LOW_DEC - 30.0) for _ in range(8)]
    assert rates[:3] == [0.0, 0.0, 0.0]
    assert rates[-1] is None
    assert gate.safety.tripped == "altitude"


def test_a_place_that_three_statuses_bear_out_is_believed_after_a_sync() -> None:
    gate = Gate()
    for _ in range(10):
        gate.clears(LOW_DEC + 0.2)
    rates = [gate.clears(HIGH_DEC) for _ in range(20)]
    assert rates[1] is not None
    assert -0.5 < rates[1] <= 0.0
    assert rates[-1] == -3.0


def test_by_hand_one_place_far_from_a_limit_does_not_let_a_jog_pass_it() -> None:
    gate = Gate(holds=False)
    for _ in range(10):
        gate.clears(LOW_DEC + 2.0, 0.0)
    assert gate.clears(HIGH_DEC, -3.0) is None
    assert gate.safety.tripped == "altitude"


def leg_to_the_east(hour_angles_deg: list[float]) -> SlewTo:
    """Return where a slew over a pillar in the south goes first, asked for with the last of some statuses."""
    pillar = tuple((float(az), 60.0 if 170 <= az <= 190 else 0.0) for az in range(0, 361, 10))
    limits = SafetyLimits(floor_altitude_deg=0.0, horizon=pillar, optical=False)
    safety = Safety(PROFILE, limits, LATITUDE_DEG, LONGITUDE_DEG, holds=True)
    for hour_angle in hour_angles_deg:
        safety.watch(Seen(None, 10.0, 10.0 - hour_angle, 0.0), Stop())
    cleared = safety.clear(SlewTo(50.0, 0.0), 10.0, 10.0 - hour_angles_deg[-1], 0.0, 0.01, 1_790_000_000.0)
    assert isinstance(cleared.motion, SlewTo)
    return cleared.motion


def test_a_slew_is_judged_from_the_place_that_is_believed() -> None:
    round_the_pillar = leg_to_the_east([50.0] * 5)
    assert round_the_pillar != SlewTo(50.0, 0.0)
    assert leg_to_the_east([-35.0] * 5) == SlewTo(50.0, 0.0)
    assert leg_to_the_east([50.0] * 5 + [-35.0]) == round_the_pillar


@pytest.mark.parametrize("rate", [-6.0, 6.0])
def test_axes_that_move_as_fast_as_they_can_are_never_in_doubt(rate: float) -> None:
    stand = Stand(steadily(rate, 0.0), LIMITS, StartPosition(-math.copysign(60.0, rate), 60.0))
    stand.run(2.0)
    assert stand.safety.tripped is None
    assert abs(stand.truths[-1][1].ra_rate_deg_s) > 5.9

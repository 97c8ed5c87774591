"""A bit of a status may turn over on its way: one wrong place must let nothing go, and stop no pass."""

from __future__ import annotations

import math

import pytest
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, PERIOD_S, T0, Stand, steadily

from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    MountProfile,
    MoveAxes,
    PierZone,
    Seen,
    Slew,
    Stance,
    Stop,
    mean_sidereal_deg,
)
from sattrack.mount.requests import FineRate, MoveAxis, PulseGuide, Request
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import Safety, SafetyLimits
from sattrack.safety.bodies import sun_over

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

    def asks(self, request: Request, dec_deg: float) -> str | None:
        """Return why a request is refused as the last status has the mount stand, None where it is not."""
        sidereal = self.turn * PERIOD_S * SIDEREAL_RATE_DEG_S
        stance = Stance(sidereal, sidereal, dec_deg, slewing=False, drives_at_rest=True)
        answer = self.safety.clear_request(request, stance, 1_790_000_000.0 + self.turn * PERIOD_S)
        return answer if isinstance(answer, str) else None


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


ASKED_DOWN = (MoveAxis(dec_rate_deg_s=-3.0), PulseGuide(dec_ms=-30_000), FineRate(0.0, -0.02))


@pytest.mark.parametrize("request_down", ASKED_DOWN, ids=lambda request: type(request).__name__)
def test_by_hand_one_place_far_from_a_limit_does_not_let_a_request_go_that_leads_past_it(
    request_down: Request,
) -> None:
    gate = Gate(holds=False)
    for _ in range(10):
        gate.clears(LOW_DEC + 0.13, 0.0)
    assert gate.asks(request_down, LOW_DEC + 0.13) is not None
    for _ in range(2):
        gate.clears(HIGH_DEC, 0.0)
        assert gate.asks(request_down, HIGH_DEC) is not None
    gate.clears(HIGH_DEC, 0.0)
    assert gate.asks(request_down, HIGH_DEC) is None


def leg_to_the_east(hour_angles_deg: list[float]) -> Slew:
    """Return where a slew over a pillar in the south goes first, asked for with the last of some statuses."""
    pillar = tuple((float(az), 60.0 if 170 <= az <= 190 else 0.0) for az in range(0, 361, 10))
    limits = SafetyLimits(floor_altitude_deg=0.0, horizon=pillar, optical=False)
    safety = Safety(PROFILE, limits, LATITUDE_DEG, LONGITUDE_DEG, holds=True)
    for hour_angle in hour_angles_deg:
        safety.watch(Seen(None, 10.0, 10.0 - hour_angle, 0.0), Stop())
    cleared = safety.clear(Slew(50.0, 0.0), 10.0, 10.0 - hour_angles_deg[-1], 0.0, 0.01, 1_790_000_000.0)
    assert isinstance(cleared.motion, Slew)
    return cleared.motion


def test_a_slew_is_judged_from_the_place_that_is_believed() -> None:
    round_the_pillar = leg_to_the_east([50.0] * 5)
    assert round_the_pillar != Slew(50.0, 0.0)
    assert leg_to_the_east([-35.0] * 5) == Slew(50.0, 0.0)
    assert leg_to_the_east([50.0] * 5 + [-35.0]) == round_the_pillar


@pytest.mark.parametrize("rate", [-6.0, 6.0])
def test_axes_that_move_as_fast_as_they_can_are_never_in_doubt(rate: float) -> None:
    stand = Stand(steadily(rate, 0.0), LIMITS, StartPosition(-math.copysign(60.0, rate), 60.0))
    for _ in range(40):
        stand.run(PERIOD_S)
        assert stand.safety._doubt.former is None
    assert stand.safety.tripped is None
    assert abs(stand.truths[-1][1].ra_rate_deg_s) > 5.9


def counted_deg(statuses: list[tuple[float, float, bool]]) -> float:
    """Return the hour angle axis' angle after statuses of hour angle, declination and side of the pier."""
    safety = Safety(PROFILE, LIMITS, LATITUDE_DEG, LONGITUDE_DEG, holds=True)
    for turn, (hour_angle, dec, beyond_pole) in enumerate(statuses):
        seen = Seen(1_790_000_000.0 + turn * PERIOD_S, 0.0, -hour_angle, dec, beyond_pole)
        safety.watch(seen, MoveAxes(0.0, 0.0))
    counted = safety._standing.hour_angle_deg
    assert counted is not None
    return counted


@pytest.mark.parametrize("rate_deg_s", [-3.0, 3.0])
def test_a_side_of_the_pier_that_turns_over_once_does_not_shift_the_count_of_turns(rate_deg_s: float) -> None:
    way = [(150.0 + rate_deg_s * PERIOD_S * k, 40.0, k == 5) for k in range(12)]
    assert counted_deg(way) == pytest.approx(way[-1][0])


def test_a_first_status_that_is_wrong_does_not_set_the_turn() -> None:
    assert counted_deg([(170.0, 40.0, False), *[(-100.0, 40.0, False)] * 5]) == pytest.approx(-100.0)


def test_a_slew_judged_from_a_wrong_place_is_judged_anew_once_another_is_believed() -> None:
    """Another client's sync comes just before our slew: the straight way is clear from the old place only."""
    pillar = tuple((float(az), 60.0 if 170 <= az <= 190 else 0.0) for az in range(0, 361, 10))
    limits = SafetyLimits(floor_altitude_deg=0.0, horizon=pillar, optical=False)
    safety = Safety(PROFILE, limits, LATITUDE_DEG, LONGITUDE_DEG, holds=True)
    wish, found = Slew(50.0, 0.0), []
    for hour_angle in [-35.0] * 5 + [50.0] * 4:
        safety.watch(Seen(None, 10.0, 10.0 - hour_angle, 0.0), Stop())
        found.append(safety.clear(wish, 10.0, 10.0 - hour_angle, 0.0, 0.01, 1_790_000_000.0).motion)
    assert found[4] == found[5] == wish
    assert isinstance(found[-1], Slew)
    assert found[-1] != wish


def test_an_idle_telescope_is_not_moved_by_one_place_in_the_sun() -> None:
    sun = sun_over(LATITUDE_DEG, LONGITUDE_DEG).at(T0)
    limits = SafetyLimits(floor_altitude_deg=0.0)
    safety = Safety(PROFILE, limits, LATITUDE_DEG, LONGITUDE_DEG, holds=True, escapes=True)
    sidereal = mean_sidereal_deg(T0, LONGITUDE_DEG)
    aside = sun.hour_angle_deg - 40.0
    for hour_angle in (aside, aside, sun.hour_angle_deg, aside, aside):
        ra, dec = sidereal - hour_angle, sun.dec_deg
        safety.watch(Seen(T0, sidereal, ra, dec), Hold())
        assert safety.clear(Hold(), sidereal, ra, dec, 0.01, T0).motion == Hold()
    for k in range(4):
        ra, dec = sidereal - sun.hour_angle_deg, sun.dec_deg
        safety.watch(Seen(T0 + 0.05 * k, sidereal, ra, dec), Hold())
        last = safety.clear(Hold(), sidereal, ra, dec, 0.01, T0).motion
    assert isinstance(last, Slew)
    safety.clear(Stop(), sidereal, ra, dec, 0.01, T0)
    safety.clear(Hold(), sidereal, ra, dec, 0.01, T0)


def test_a_telescope_that_is_synced_on_its_way_out_of_the_sun_is_led_out_from_there() -> None:
    sun = sun_over(LATITUDE_DEG, LONGITUDE_DEG).at(T0)
    safety = Safety(
        PROFILE,
        SafetyLimits(floor_altitude_deg=0.0),
        LATITUDE_DEG,
        LONGITUDE_DEG,
        holds=True,
        escapes=True,
    )
    sidereal, wanted = mean_sidereal_deg(T0, LONGITUDE_DEG), []
    for k, beside_deg in enumerate([2.0] * 4 + [-4.0] * 6):
        ra, dec = sidereal - sun.hour_angle_deg, sun.dec_deg + beside_deg
        safety.watch(Seen(T0 + 0.05 * k, sidereal, ra, dec, slewing=k == 1), wanted[-1] if wanted else Hold())
        wanted.append(safety.clear(Hold(), sidereal, ra, dec, 0.01, T0).motion)
    assert isinstance(wanted[3], Slew)
    assert isinstance(wanted[-1], Slew)
    assert wanted[-1].dec_deg < sun.dec_deg < wanted[3].dec_deg
    assert safety.tripped is None


def test_a_clock_that_is_wrong_once_does_not_end_a_pass_and_one_that_stays_wrong_does() -> None:
    safety = Safety(PROFILE, LIMITS, LATITUDE_DEG, LONGITUDE_DEG, holds=True)

    def goes_on(off_deg: float) -> bool:
        sidereal = mean_sidereal_deg(T0, LONGITUDE_DEG) + off_deg
        safety.watch(Seen(T0, sidereal, sidereal, 40.0), MoveAxes(0.0, 0.0))
        cleared = safety.clear(MoveAxes(0.0, 0.0), sidereal, sidereal, 40.0, 0.01, T0)
        return isinstance(cleared.motion, MoveAxes)

    assert all(goes_on(off) for off in (0.0, 0.0, 60.0, 0.0, 0.0, -5.0, 7.0, 0.0))
    assert [goes_on(60.0) for _ in range(3)] == [True, True, False]
    assert safety.tripped == "clock"


def test_one_wrong_status_after_which_nothing_is_heard_ends_no_pass() -> None:
    gate = Gate()
    for _ in range(10):
        gate.clears(LOW_DEC + 0.2)
    gate.clears(LOW_DEC - 0.2)
    now_s, sidereal = 1_790_000_000.0 + 0.6, gate.turn * PERIOD_S * SIDEREAL_RATE_DEG_S
    wish = MoveAxes(SIDEREAL_RATE_DEG_S, -3.0)
    for k in range(6):
        now_s += PERIOD_S
        gate.safety.clear(wish, sidereal, sidereal, LOW_DEC - 0.2, 0.06 + PERIOD_S * k, now_s)
    assert gate.safety.tripped is None


def test_what_is_left_of_a_piers_margin_is_not_used_up() -> None:
    corners = ((-10.0, 60.0), (10.0, 60.0), (10.0, 80.0), (-10.0, 80.0))
    zone = PierZone(name="tripod", corners=corners, side="both")
    profile = MountProfile(pier_zones=(zone,))
    limits = SafetyLimits(floor_altitude_deg=-90.0, optical=False)
    stand = Stand(steadily(0.0, 1.0), limits, StartPosition(0.0, 59.6), profile=profile).run(20.0)
    assert max(truth.dec_axis_deg for _, truth in stand.truths) < 59.65

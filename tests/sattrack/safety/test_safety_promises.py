"""Each row of the table: its time to standstill on the simulated mount, and what happens without it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import pytest
from driven_limits import DARK, apart_of, flown, moon_place, nearest
from driven_limits import ROWS as DRIVEN_AT
from safety_stand import T0, Stand, axis_speed_deg_s, steadily

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile, MoveAxes, Stop
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import INTERLOCKS, ROWS, SafetyLimits, gate
from sattrack.safety.table import Reaction, closing_promise_s, promise_s
from sattrack.safety.watch import Watch

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import Motion

START = StartPosition(-60.0, 40.0)
ONSET_S = 2.0


@dataclass
class Cause:
    """A stand on which a row's cause comes after ONSET_S: `befalls`, or a wish that is no number."""

    stand: Stand
    befalls: Callable[[Stand], None] | None = None

    def run(self, seconds: float, rate_deg_s: float) -> Stand:
        """Run it: a mount that moves at a rate, and then the cause."""
        stand = replace(self.stand, truths=[], sent=[], met_s=None)
        if stand.wish is MOVING:
            stand.wish = steadily(rate_deg_s, 0.0)
        stand.run(ONSET_S)
        if self.befalls is not None:
            self.befalls(stand)
        elif self.stand.wish is NO_NUMBER:
            stand.wish = lambda _: MoveAxes(math.nan, 0.0)
        return stand.run(seconds)


def MOVING(_: float) -> Motion:  # noqa: N802
    raise AssertionError("a rate takes its place")


def NO_NUMBER(_: float) -> Motion:  # noqa: N802
    return MoveAxes(SIDEREAL_RATE_DEG_S - 3.0, 0.0)


def jam(stand: Stand) -> None:
    """Turn the mount's sense round: what is commanded from now on makes it go the other way."""
    stand.session = type(stand.session)(msgspec.structs.replace(stand.profile, ra_rate_sign=-1))


def rub(stand: Stand) -> None:
    """Let something hold the axis so that its drive draws 6 A to go on."""
    plant = stand.mount._ra.axis.plant
    plant.servo = msgspec.structs.replace(plant.servo, friction_a=6.0)


def restart(stand: Stand) -> None:
    """Start the mount's program anew; it is silent for a little less than `status_age` allows."""
    stand.mount.restart(stand.begin_s + ONSET_S)
    stand.silent = (ONSET_S, ONSET_S + 1.7)


CAUSES = {
    "command": Cause(Stand(NO_NUMBER, DARK, START)),
    "status_age": Cause(Stand(MOVING, DARK, START, silent=(ONSET_S, math.inf))),
    "obedience": Cause(Stand(MOVING, DARK, START), jam),
    "clock": Cause(Stand(MOVING, DARK, START), lambda stand: stand.mount.step_clock(100.0)),
    "current": Cause(
        Stand(MOVING, DARK, START, MountProfile(ra=AxisLimits(max_current_a=5.0))),
        rub,
    ),
    "restart": Cause(Stand(MOVING, DARK, START), restart),
}


def rest_after_s(stand: Stand, since_s: float) -> float:
    moving = [t for t, truth in stand.truths if axis_speed_deg_s(truth) > 1e-3]
    assert stand.truths[-1][0] - moving[-1] > 1.0, "moves on"
    return moving[-1] + 0.05 - since_s


@pytest.mark.parametrize("rate", [1.0, 3.0])
@pytest.mark.parametrize("name", CAUSES)
def test_a_row_that_stops_has_the_axes_at_rest_within_its_promise(name: str, rate: float) -> None:
    stand = CAUSES[name].run(9.0, rate)
    assert stand.safety.tripped == name
    assert isinstance(stand.sent[-1], Stop)
    promise = promise_s(ROWS[name], stand.profile, stand.limits.longest_fault_s, max(rate, 3.0))
    assert rest_after_s(stand, ONSET_S) <= promise


@pytest.mark.parametrize("name", DRIVEN_AT)
def test_by_hand_each_limit_has_the_axes_at_rest_within_its_promise(name: str) -> None:
    stand = replace(DRIVEN_AT[name][0], truths=[], sent=[], holds=False).run(14.0)
    assert stand.safety.tripped == name
    assert stand.met_s is not None
    assert rest_after_s(stand, stand.met_s) <= promise_s(ROWS[name], stand.profile, 1.0, 6.0)
    assert nearest(name, stand) >= 0.0


@pytest.mark.parametrize("name", DRIVEN_AT)
def test_a_stream_is_held_just_inside_each_limit_and_has_closed_up_to_it_within_its_promise(
    name: str,
) -> None:
    """At CREEP_DEG_S towards it and falling by an e-th in latency and fault, 0.12° are still to go."""
    stand, measure, bound = flown(name), *DRIVEN_AT[name][1:]
    assert (stand.safety.holding, stand.safety.tripped) == (name, None)
    assert stand.met_s is not None
    by_s = stand.met_s + closing_promise_s(stand.profile, 1.0, 6.0)
    left = [measure(truth, t) - bound for t, truth in stand.truths if t >= by_s]
    assert left[0] - min(left) <= 0.15
    assert 0.0 <= nearest(name, stand) < 1.0
    # The Sun moves on, and what is held gives way to it.
    assert axis_speed_deg_s(stand.truths[-1][1]) < (0.06 if name == "sun" else 0.02)


def test_every_row_is_stopped_held_or_cut_in_one_of_these_tests() -> None:
    cut = {row.name for row in INTERLOCKS if row.reaction is Reaction.CLAMP}
    assert cut | set(CAUSES) | set(DRIVEN_AT) | {"moon"} == set(ROWS)
    assert all(ROWS[name].noticed_s is None for name in cut)


# Without its row, what the row is there for happens.


@pytest.mark.parametrize(
    ("name", "method"), [("current", "_see_current"), ("clock", "_see_clock"), ("obedience", "see_motion")]
)
def test_without_its_row_the_mount_goes_on(name: str, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Watch, method, lambda *_: None)
    stand = CAUSES[name].run(6.0, 1.0)
    assert stand.safety.tripped is None
    assert axis_speed_deg_s(stand.truths[-1][1]) > 0.5


def test_without_the_status_age_a_mount_that_is_not_heard_is_told_to_go_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gate, "OLDEST_STATUS_S", math.inf)
    stand = CAUSES["status_age"].run(6.0, 0.2)
    assert stand.safety.tripped is None
    assert axis_speed_deg_s(stand.truths[-1][1]) > 0.1


def fast(monkeypatch: pytest.MonkeyPatch | None) -> Stand:
    """A wish beyond the axes' rate, on a mount that could turn faster than the profile lets it."""
    profile = MountProfile(ra=AxisLimits(max_rate_deg_s=3.0), dec=AxisLimits(max_rate_deg_s=3.0))
    if monkeypatch is not None:
        monkeypatch.setattr(gate.Safety, "_clipped", lambda _, wish: wish)
    return Stand(steadily(5.0, 0.0), DARK, StartPosition(-100.0, 40.0), profile, MountProfile()).run(2.0)


def test_the_rate_row_keeps_the_axes_to_the_profiles_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    assert max(axis_speed_deg_s(truth) for _, truth in fast(None).truths) <= 3.0 + 1e-6
    assert max(axis_speed_deg_s(truth) for _, truth in fast(monkeypatch).truths) > 4.5


def jump(monkeypatch: pytest.MonkeyPatch | None) -> float:
    """The largest step between two commands of a stream that jumps, deg/s."""
    if monkeypatch is not None:
        monkeypatch.setattr(gate, "_room_about", lambda *_: (-math.inf, math.inf))
    stand = Stand(lambda t: MoveAxes(0.0, 3.0 if t > 1.0 else 0.0), DARK, START).run(2.0)
    rates = [motion.dec_rate_deg_s for motion in stand.sent if isinstance(motion, MoveAxes)]
    return max(abs(b - a) for a, b in itertools.pairwise(rates))


def test_the_acceleration_row_keeps_a_stream_from_jumping(monkeypatch: pytest.MonkeyPatch) -> None:
    assert jump(None) <= 2.0 * 10.0 * 0.05 + 1e-9
    assert jump(monkeypatch) > 2.9


def beside_the_moon(cone_deg: float) -> float:
    """How near the true axes come to the Moon, driven across it."""
    begin_s = T0 + 21600.0
    ha, dec = moon_place(begin_s)
    ha = (ha + 180.0) % 360.0 - 180.0
    limits = SafetyLimits(floor_altitude_deg=-89.0, optical=False, moon_cone_deg=cone_deg)
    stand = Stand(steadily(3.0, 0.0), limits, StartPosition(ha - 30.0, dec + 1.0), begin_s=begin_s)
    stand.run(18.0)
    if cone_deg:
        assert stand.met_s is not None
    return min(apart_of(truth, (ha, dec)) for _, truth in stand.truths)


def test_the_moon_row_keeps_the_axes_out_of_its_cone() -> None:
    assert 8.0 - 1.3 <= beside_the_moon(8.0) < 8.0 + 2.0
    assert beside_the_moon(0.0) < 3.0

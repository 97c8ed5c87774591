"""One axis' drive as the mount's program commands it: mode, rates, pulses, and the encoder that reads it."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from sattrack.mount.simulator.sky import wrapped

if TYPE_CHECKING:
    from sattrack.mount.simulator.axis import Axis

DTICS_S_PER_DEG_S = 2**26 / 360.0 * 10.0
"""Tenths of encoder tics a second in a degree a second: 2^26 tics a turn, by the paper."""
GUIDE_RATE_DTICS_S = 3500
"""Hard-coded in the paper's mount."""
STANDING_DEG_S = 1e-5
GUIDE_RATE_DEG_S = GUIDE_RATE_DTICS_S / DTICS_S_PER_DEG_S


class Mode(Enum):
    """What an axis does."""

    TRACKING = "on the sky"
    RESTING = "at rest, drive on"
    MOVING = "in MoveAxis"
    GOING = "on its way to a place"
    OFF = "without power"


@dataclass(slots=True)
class Encoder:
    """An absolute encoder on an axis: whole tics, and a zero that is where the mount's assembly left it.

    It reads within half a turn of its zero at power-up and counts on from there, past a turn where the axis
    goes there: 190° at power-up is read as -170°.
    """

    tics: int
    zero_deg: float = 0.0
    noise_tics: float = 0.0
    seed: str = ""
    _random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        """Begin the noise."""
        self._random = random.Random(self.seed)

    def at_power_up(self, axis_deg: float) -> float:
        """Return the axis' angle as it is known at power-up."""
        return wrapped(axis_deg + self.zero_deg) - self.zero_deg if self._is_turned(axis_deg) else axis_deg

    def read(self, axis_deg: float) -> float:
        """Return an angle of the axis as it is known afterwards."""
        tics = (axis_deg + self.zero_deg) / 360.0 * self.tics
        if self.noise_tics:
            tics += self._random.uniform(-self.noise_tics, self.noise_tics)
        return math.floor(tics) / self.tics * 360.0 - self.zero_deg

    def _is_turned(self, axis_deg: float) -> bool:
        return not -180.0 < axis_deg + self.zero_deg <= 180.0


@dataclass(slots=True)
class DrivenAxis:
    """One axis and its commands; rates are the axis'. `sky_rate_deg_s` is that of tracking a star."""

    axis: Axis
    encoder: Encoder
    sky_rate_deg_s: float
    additive: bool
    most_deg_s: float
    mode: Mode = Mode.TRACKING
    fine_deg_s: float = 0.0
    pulse_deg_s: float = 0.0
    turns_deg: float = 0.0
    """Whole turns that the cables have and the encoder does not know of."""
    _asked_deg_s: float = 0.0
    _move_deg_s: float = 0.0
    _pulse_until_s: float = -math.inf

    @property
    def pulsing(self) -> bool:
        """Whether the pulse guide timer runs."""
        return self._pulse_until_s > -math.inf

    def known_deg(self) -> float:
        """Return the axis' angle as its encoder reads it."""
        return self.encoder.read(self.axis.position_deg)

    def power_off(self) -> None:
        """Cut the drive's power: the axis coasts."""
        self.mode = Mode.OFF
        self.end_pulse()
        self.axis.coast()

    @property
    def turns(self) -> bool:
        """Whether the axis moves."""
        return abs(self.axis.velocity_deg_s) > STANDING_DEG_S

    def restart(self) -> None:
        """Switch the drive and its encoder off and on, wherever the axis is and however it moves."""
        self.power_up(self.axis.position_deg + self.turns_deg, self.axis.velocity_deg_s)

    def power_up(self, cable_deg: float, rate_deg_s: float | None = None) -> None:
        """Wake at an angle, its cables' turns counted, and track the sky, as if always: at its rate."""
        known_deg = self.encoder.at_power_up(cable_deg)
        self.turns_deg = cable_deg - known_deg
        self.axis.place(known_deg, self.sky_rate_deg_s if rate_deg_s is None else rate_deg_s)
        self.end_pulse()
        self.mode, self.fine_deg_s = Mode.TRACKING, 0.0
        self.obey()

    def advance(self, since_s: float, until_s: float) -> None:
        """Let time pass from one instant to another, a pulse that ends meanwhile included."""
        if since_s < self._pulse_until_s <= until_s:
            self.axis.advance(self._pulse_until_s - since_s)
            since_s = self._pulse_until_s
            self.end_pulse()
            self.obey()
        if until_s > since_s:
            self.axis.advance(until_s - since_s)

    def move(self, asked_deg_s: float, axis_deg_s: float) -> None:
        """Be in MoveAxis by the rate asked for; `axis_deg_s` is what that is to this axis on this side."""
        if self.mode is not Mode.MOVING or asked_deg_s != self._asked_deg_s:
            self._asked_deg_s, self._move_deg_s = asked_deg_s, axis_deg_s
        self.mode = Mode.MOVING

    def go(self, goal_deg: float, goal_rate_deg_s: float) -> None:
        """Go to a place that moves; without power, stay."""
        if self.mode is Mode.OFF:
            return
        self.mode = Mode.GOING
        self.end_pulse()
        self.axis.go(goal_deg, goal_rate_deg_s)

    def pulse(self, duration_ms: int, sense: int, now_s: float) -> None:
        """Start the timer anew, or none for a duration of 0."""
        self.end_pulse()
        if duration_ms:
            self.pulse_deg_s = math.copysign(GUIDE_RATE_DEG_S, duration_ms) * sense
            self._pulse_until_s = now_s + abs(duration_ms) / 1000.0

    def end_pulse(self) -> None:
        """End the timer."""
        self.pulse_deg_s, self._pulse_until_s = 0.0, -math.inf

    def obey(self) -> None:
        """Tell the drive the rate that the mode comes to."""
        match self.mode:
            case Mode.TRACKING:
                self.axis.run(self.sky_rate_deg_s + self._within(self.fine_deg_s + self.pulse_deg_s))
            case Mode.MOVING:
                fine_deg_s = self.fine_deg_s if self.additive else 0.0
                sky_deg_s = self.sky_rate_deg_s if self.additive else 0.0
                self.axis.run(sky_deg_s + self._within(self._move_deg_s + fine_deg_s + self.pulse_deg_s))
            case Mode.RESTING:
                self.axis.run(self.pulse_deg_s)
            case Mode.GOING | Mode.OFF:
                pass

    def _within(self, rate_deg_s: float) -> float:
        return max(-self.most_deg_s, min(self.most_deg_s, rate_deg_s))

"""The mount as a rotator: who commands it, what it was told last, and where it is to be. No I/O, no clock.

Every client may command, and the last one that did is obeyed; steps of two clients are never taken for one
track. Where only one may command at a time, the others are refused until it hangs up, stops the mount, or has
said nothing for a while.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from sattrack.servers.antenna.sky import AzEl, HaDec
from sattrack.servers.antenna.trajectory import NS, AxisState, Path, Straight
from sattrack.servers.rotctld.smoothing import SmoothedTrack
from sattrack.servers.rotctld.wording import Code

if TYPE_CHECKING:
    from sattrack.mount.model import AxesPosition
    from sattrack.servers.antenna.equipment import Feedback
    from sattrack.servers.antenna.sky import Sky

MOVE_RATE_DEG_S = 2.0
"""What speed 100 of a move is."""
MOVE_MOST_S = 10.0
"""A move goes on so long after its command."""
MOST_SPEED = 100
SPEED_LEVELS = 4
COMMANDS_FOR_S = 10.0
"""A commander that has said nothing for so long commands no longer."""
MOVING_DEG_S = 0.01
"""Faster than this an axis moves; the sky turns by less than half of it."""
REMEMBERED_WORDS = 20


@dataclass(frozen=True, slots=True)
class Reach:
    """What positions a client may send, degrees; an elevation past 90 is beyond the zenith."""

    min_az_deg: float = -180.0
    max_az_deg: float = 450.0
    min_el_deg: float = 0.0
    max_el_deg: float = 180.0

    def holds(self, az_deg: float, el_deg: float) -> bool:
        """Tell whether a position is within; what is no number is not."""
        return self.min_az_deg <= az_deg <= self.max_az_deg and self.min_el_deg <= el_deg <= self.max_el_deg


FULL_REACH = Reach()
Direction = Literal["up", "down", "left", "right"]


@dataclass(frozen=True, slots=True)
class Moving:
    """The way of a move: at a rate from a place, until it has gone on long enough or the reach ends."""

    start: AzEl
    az_rate_deg_s: float
    el_rate_deg_s: float
    since_ns: int

    def at(self, utc_ns: int) -> AxisState:
        """Return where it is at an instant."""
        seconds = max(0.0, min(MOVE_MOST_S, (utc_ns - self.since_ns) / NS))
        lowest, highest = min(0.0, self.start.el_deg), max(90.0, self.start.el_deg)
        el_deg = max(lowest, min(highest, self.start.el_deg + self.el_rate_deg_s * seconds))
        moves = 0.0 < seconds < MOVE_MOST_S
        return AxisState(
            self.start.az_deg + self.az_rate_deg_s * seconds,
            el_deg,
            self.az_rate_deg_s if moves else 0.0,
            self.el_rate_deg_s if moves and lowest < el_deg < highest else 0.0,
        )


@dataclass(slots=True)
class Rotator:
    """One mount for all clients; these are numbers. See led_mount.Leader for what the mount asks of it."""

    sky: Sky
    feedback: Feedback
    park: AxesPosition | None = None
    one_at_a_time: bool = False
    reach: Reach = FULL_REACH
    speed_level: int = 0
    path: Path | None = None
    reset_asked: bool = False
    commander: int | None = None
    words: deque[str] = field(default_factory=lambda: deque(maxlen=REMEMBERED_WORDS))
    """What the log is to be told; whoever tells it takes it away."""
    _heard_s: float = -math.inf
    _told_az_deg: float | None = None
    _plunged: bool = False
    _shown: tuple[int, AzEl | None] | None = None

    def commanded(self, utc_ns: int) -> AxisState | None:
        """Return azimuth and elevation to be at, None where nothing is asked of the mount but rest."""
        return None if self.path is None else self.path.at(utc_ns)

    # What clients ask for.

    def point(self, client: int, az_deg: float, el_deg: float, now_s: float) -> Code:
        """Go to a position, or on along the track that it continues."""
        if not self.reach.holds(az_deg, el_deg):
            return Code.INVALID
        objection = self._objection(client, now_s)
        if objection is not None:
            return objection
        anew = not isinstance(self.path, SmoothedTrack) or self.commander != client
        self._take_over(client, now_s)
        if anew:
            self.path = SmoothedTrack()
        assert isinstance(self.path, SmoothedTrack)
        self.path.take(AzEl(az_deg, el_deg), now_s)
        self._told_az_deg, self._plunged = az_deg, el_deg > 90.0
        return Code.OK

    def move(self, client: int, direction: Direction, speed: int, now_s: float) -> Code:
        """Move one way for a while; a speed below 0 is that of the level."""
        objection = self._objection(client, now_s)
        if objection is not None:
            return objection
        now_ns = round(now_s * NS)
        here = self.feedback.actual(now_ns)
        if here is None:
            return Code.IO
        self._take_over(client, now_s)
        if speed < 0:
            speed = MOST_SPEED * max(1, min(SPEED_LEVELS, self.speed_level)) // SPEED_LEVELS
        rate = MOVE_RATE_DEG_S * min(speed, MOST_SPEED) / MOST_SPEED
        rates = {"up": (0.0, rate), "down": (0.0, -rate), "left": (-rate, 0.0), "right": (rate, 0.0)}
        self.path = Moving(AzEl(here.first_deg, here.second_deg), *rates[direction], now_ns)
        self._plunged = False
        return Code.OK

    def go_to_park(self, client: int, now_s: float) -> Code:
        """Go to the profile's park position, and stand there with the power on."""
        if self.park is None:
            return Code.NOT_AVAILABLE
        objection = self._objection(client, now_s)
        if objection is not None:
            return objection
        self._take_over(client, now_s)
        there = self.sky.horizontal(HaDec(self.park.hour_angle_deg, self.park.dec_deg), now_s)
        self.path = Straight.standing(there.az_deg, there.el_deg, round(now_s * NS))
        self._plunged = False
        return Code.OK

    def stop(self) -> Code:
        """Bring the mount to rest; anybody may."""
        self.path, self.commander = None, None
        return Code.OK

    def reset(self) -> Code:
        """Bring the mount to rest, and have what safety stopped made ready again."""
        self.reset_asked = True
        return self.stop()

    def narrow(self, name: str, value_deg: float) -> Code:
        """Set one bound of what positions are taken, never beyond what they are at most."""
        full = getattr(FULL_REACH, name)
        if math.isnan(value_deg):
            return Code.INVALID
        within = max(full, value_deg) if name.startswith("min") else min(full, value_deg)
        self.reach = replace(self.reach, **{name: within})
        return Code.OK

    # Who is there.

    def heard(self, client: int, now_s: float) -> None:
        """Note that a client has said something."""
        if client == self.commander:
            self._heard_s = now_s
            if isinstance(self.path, SmoothedTrack):
                self.path.heard(now_s)

    def hang_up(self, client: int) -> None:
        """Note that a client is gone: a slew goes on to its end, a track soon comes to rest."""
        if client == self.commander:
            self.commander = None
            if isinstance(self.path, SmoothedTrack):
                self.path.hang_up()

    def _objection(self, client: int, now_s: float) -> Code | None:
        """Return why nothing may be asked of the mount now by a client."""
        if not self.feedback.link_up:
            return Code.IO
        if self.feedback.tripped is not None:
            return Code.REJECTED
        in_charge = self.commander not in {None, client} and now_s - self._heard_s <= COMMANDS_FOR_S
        if self.one_at_a_time and in_charge:
            self.words.append(f"client {client} was refused: client {self.commander} commands")
            return Code.REJECTED
        return None

    def _take_over(self, client: int, now_s: float) -> None:
        if client != self.commander:
            self.words.append(f"client {client} commands")
        self.commander, self._heard_s = client, now_s

    # What clients are told.

    def where(self, utc_ns: int) -> AzEl | None:
        """Return where the mount points, counted as it was told; None where that is not known.

        The azimuth is on the turn nearest to the one last asked for, as far as that is within reach, and the
        elevation beyond the zenith where that was.
        """
        if self._shown is None or self._shown[0] != utc_ns:
            self._shown = utc_ns, self._counted(utc_ns)
        return self._shown[1]

    def _counted(self, utc_ns: int) -> AzEl | None:
        here = self.feedback.actual(utc_ns)
        if here is None:
            return None
        az_deg, el_deg = here.first_deg, here.second_deg
        if self._plunged:
            az_deg, el_deg = (az_deg + 180.0) % 360.0, 180.0 - el_deg
        if self._told_az_deg is None:
            return AzEl(az_deg, el_deg)
        near_deg = self._told_az_deg
        turns = [az_deg + turn for turn in (-360.0, 0.0, 360.0)]
        within = [az for az in turns if FULL_REACH.min_az_deg <= az <= FULL_REACH.max_az_deg]
        return AzEl(min(within, key=lambda az: abs(az - near_deg)), el_deg)

    def flags(self, utc_ns: int) -> tuple[str, ...] | None:
        """Return what the mount does, in Hamlib's words; None where that is not known."""
        here = self.feedback.actual(utc_ns)
        if here is None:
            return None
        flags: list[str] = []
        for axis, rate, words in (
            ("MOVING_AZ", here.first_rate_deg_s, ("MOVING_LEFT", "MOVING_RIGHT")),
            ("MOVING_EL", here.second_rate_deg_s, ("MOVING_DOWN", "MOVING_UP")),
        ):
            if abs(rate) > MOVING_DEG_S:
                flags += [axis, words[rate > 0.0]]
        return ("MOVING", *flags) if flags else ()

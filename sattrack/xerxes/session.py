"""The client's side of the Xerxes protocol as a state machine without I/O: bytes and instants in, bytes out.

Rules, from "Xerxes Mount Control Protocol", Details and Theory of Operation:

1. A datagram goes out every period, whether or not anything changed.
2. A one-shot flag (slew, abort) rises once, is held until its acknowledgement is seen, falls, and may not
   rise again before the acknowledgement has fallen.
3. MoveAxis flags stay up for as long as the motion is wanted; the latest rates act ("held").
4. A slew is ignored while Slewing is true, and MoveAxis makes it true: end MoveAxis, see it fall, then slew.
5. "Not slewing" counts only in a status that came after the slew's acknowledgement.
6. An abort outranks everything: no other flag is up beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from typing import TYPE_CHECKING

from sattrack.mount import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    SlewTo,
    StatusSample,
    Stop,
)
from sattrack.xerxes.datagrams import (
    TICS_PER_TURN,
    Command,
    DatagramError,
    Status,
    decode_status,
    encode_command,
)
from sattrack.xerxes.handshake import QUIET_STATUSES, Handshake, OneShot
from sattrack.xerxes.sequence import LinkHealth, StatusSequence

if TYPE_CHECKING:
    from sattrack.safety import Cleared

DEG_S_PER_DTIC_S = 360.0 / TICS_PER_TURN / 10.0
STALE_AFTER_S = 0.3
LOST_AFTER_S = 2.0
SLEW_NEVER_SEEN_AFTER = 5
"""Statuses after a slew's acknowledgement without Slewing that mean it was too short to be seen."""
ACK_WITHIN_STATUSES = 20
"""Statuses after which a slew that is not acknowledged is asked for anew."""
ABORT_AGAIN_TICKS = 8
REST_RATE_DEG_S = SIDEREAL_RATE_DEG_S * 0.5
"""A drive this near to standstill, or to sidereal tracking, is where it should be."""


class LinkState(StrEnum):
    """What the age of the last accepted status says."""

    SILENT = "silent"
    UP = "up"
    STALE = "stale"
    LOST = "lost"


class SlewState(Enum):
    """Where the slew last asked for stands."""

    NONE = "none"
    WAITING = "waiting for standstill"
    ASKED = "asked"
    UNDER_WAY = "under way"
    DONE = "done"


@dataclass(slots=True)
class _Slew:
    target: SlewTo
    state: SlewState = SlewState.WAITING
    seen_moving: bool = False
    statuses_since_ack: int = 0

    def follow(self, status: Status) -> None:
        """Take a status that came with or after the acknowledgement."""
        self.statuses_since_ack += 1
        self.seen_moving = self.seen_moving or status.slewing
        if not status.slewing and (self.seen_moving or self.statuses_since_ack > SLEW_NEVER_SEEN_AFTER):
            self.state = SlewState.DONE


@dataclass(slots=True)
class _MoveAxis:
    """Whether the mount may still be moving by MoveAxis, as far as statuses tell.

    The last status may be older than the last command: what counts is the acknowledgement seen up and then
    down since, or a silence so long that none is to come.
    """

    over: bool = True
    _up: bool = False
    _acked: bool = False
    _statuses: int = 0

    def sent(self, up: bool) -> None:
        """Note whether the datagram that goes out has the flags up."""
        if up:
            # An acknowledgement from before they rose says nothing of now.
            self._acked = self._acked and self._up
            self.over, self._statuses = False, 0
        self._up = up

    def see(self, status: Status) -> None:
        """Take one status."""
        if self.over:
            return
        self._statuses += 1
        up = status.ack_move_ra or status.ack_move_dec
        self._acked = self._acked or up
        fallen = self._acked and not up
        self.over = fallen or self._statuses >= QUIET_STATUSES


@dataclass(slots=True)
class Session:
    """One client's conversation with one mount; `profile` settles what the paper leaves open."""

    profile: MountProfile
    health: LinkHealth = field(default_factory=LinkHealth)
    status: Status | None = None
    """The last accepted status, whole."""
    sample: StatusSample | None = None
    _sequence: StatusSequence = field(init=False)
    _wanted: Motion = field(default_factory=Hold)
    _abort: OneShot = field(default_factory=OneShot)
    _slew_flag: OneShot = field(default_factory=OneShot)
    _move: _MoveAxis = field(default_factory=_MoveAxis)
    _slew: _Slew | None = None
    _aborted: bool = False
    _ack_stands: int = 0
    """Statuses in a row that acknowledge an abort which we have not sent."""

    def __post_init__(self) -> None:
        """Begin to count statuses."""
        self._sequence = StatusSequence(self.health)

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram; return its sample, or None where it was refused and counted."""
        try:
            status = decode_status(data)
        except DatagramError:
            self.health.rejected += 1
            return None
        if not _plausible(status):
            self.health.rejected += 1
            return None
        restarts = self.health.restarts
        if not self._sequence.is_news(status.counter, arrival_utc_s):
            return None
        if self.health.restarts > restarts:
            self._begin_anew()
        self.health.received += 1
        self.status = status
        self.sample = StatusSample(
            counter=status.counter,
            arrival_utc_s=arrival_utc_s,
            sidereal_h=status.sidereal_h,
            ra_deg=status.ra_h * 15.0,
            dec_deg=status.dec_deg,
            slewing=status.slewing,
            does_refraction=status.does_refraction,
            ra_drive_deg_s=status.ra_rate_dtics_s * DEG_S_PER_DTIC_S,
            dec_drive_deg_s=status.dec_rate_dtics_s * DEG_S_PER_DTIC_S,
        )
        self._follow_acknowledgements(status)
        return self.sample

    def apply(self, cleared: Cleared) -> None:
        """Make a motion that safety has cleared the one that is wanted from the next datagram on."""
        motion = cleared.motion
        if isinstance(motion, SlewTo) and (self._slew is None or self._slew.target != motion):
            self._slew = _Slew(motion)
        if isinstance(motion, Stop) and not isinstance(self._wanted, Stop):
            self._aborted = False
        if not isinstance(motion, SlewTo):
            self._slew = None
        self._wanted = motion

    def compose(self) -> bytes:
        """Return the next datagram to send."""
        self.health.sent += 1
        self._move.sent(isinstance(self._wanted, MoveAxes) and not self._abort.up)
        if self._abort.up:
            # An abort that is on its way is seen through, whatever is wanted by now.
            return encode_command(self._compose_stop())
        match self._wanted:
            case Stop():
                command = self._compose_stop()
            case MoveAxes():
                command = self._compose_move(self._wanted)
            case SlewTo():
                command = self._compose_slew(self._wanted)
            case Hold():
                self._slew_flag.happen("withdraw")
                command = Command(self.health.sent)
        return encode_command(command)

    def link_state(self, now_utc_s: float) -> LinkState:
        """Return the state of the link at an instant."""
        if self.sample is None:
            return LinkState.SILENT
        age = now_utc_s - self.sample.arrival_utc_s
        if age > LOST_AFTER_S:
            return LinkState.LOST
        return LinkState.STALE if age > STALE_AFTER_S else LinkState.UP

    @property
    def slew_state(self) -> SlewState:
        """Where the slew last asked for stands; NONE once anything else was asked for."""
        return SlewState.NONE if self._slew is None else self._slew.state

    @property
    def stopped(self) -> bool:
        """Whether the stop asked for was acknowledged and the drives are seen at rest (or sidereal)."""
        sample = self.sample
        acknowledged = self._aborted or self._ack_stands >= QUIET_STATUSES
        if sample is None or not isinstance(self._wanted, Stop) or not acknowledged:
            return False
        return not sample.slewing and is_at_rest(sample)

    def _begin_anew(self) -> None:
        """Forget what a mount that has restarted cannot know of."""
        self._abort, self._slew_flag, self._move = OneShot(), OneShot(), _MoveAxis()
        self._aborted = False
        if self._slew is not None:
            self._slew = _Slew(self._slew.target)

    def _compose_stop(self) -> Command:
        self._slew_flag.happen("withdraw")
        status = self.status
        if self._abort.state is Handshake.IDLE and status is not None and status.slewing:
            # A late datagram, or another client, has set the mount going again: the mount ignores counters.
            self._aborted = False
        if not self._aborted and (status is None or not status.ack_abort):
            self._abort.happen("request")
        stuck = self._ack_stands >= QUIET_STATUSES
        # An acknowledgement that never falls must not keep a stop from going out: raise the flag anew.
        again = stuck and self.health.sent % ABORT_AGAIN_TICKS < ABORT_AGAIN_TICKS // 2
        return Command(self.health.sent, abort=self._abort.up or again)

    def _compose_move(self, move: MoveAxes) -> Command:
        self._slew_flag.happen("withdraw")
        westward = (0.0 if self.profile.additive else SIDEREAL_RATE_DEG_S) - move.ra_rate_deg_s
        return Command(
            self.health.sent,
            move_ra=True,
            move_dec=True,
            move_ra_rate_deg_s=self.profile.ra_rate_sign * westward,
            move_dec_rate_deg_s=self.profile.dec_rate_sign * move.dec_rate_deg_s,
        )

    def _compose_slew(self, target: SlewTo) -> Command:
        slew, status = self._slew, self.status
        if slew is not None and status is not None and slew.state is SlewState.WAITING:
            standing = self._move.over and not status.slewing and not status.ack_slew
            if standing and self._slew_flag.happen("request"):
                slew.state = SlewState.ASKED
        return Command(
            self.health.sent,
            slew=self._slew_flag.up,
            target_ra_h=target.ra_deg % 360.0 / 15.0,
            target_dec_deg=target.dec_deg,
        )

    def _follow_acknowledgements(self, status: Status) -> None:
        self._move.see(status)
        if self._abort.see(status.ack_abort):
            self._aborted = True
        wanted = isinstance(self._wanted, Stop) and not self._aborted
        self._ack_stands = self._ack_stands + 1 if wanted and status.ack_abort else 0
        launched = self._slew_flag.see(status.ack_slew)
        slew = self._slew
        if slew is None:
            return
        if slew.state is SlewState.ASKED:
            if launched:
                slew.state = SlewState.UNDER_WAY
            elif self._slew_flag.statuses > ACK_WITHIN_STATUSES:
                # The mount missed the edge, or was slewing when it came: fall, and rise again.
                self._slew_flag.happen("withdraw")
                slew.state = SlewState.WAITING
        if slew.state is SlewState.UNDER_WAY:
            slew.follow(status)


def is_at_rest(sample: StatusSample) -> bool:
    """Tell whether both drives report rest, sidereal tracking counted as rest."""
    ra, dec = sample.ra_drive_deg_s, sample.dec_drive_deg_s
    resting = min(abs(ra), abs(ra - SIDEREAL_RATE_DEG_S)) < REST_RATE_DEG_S
    return resting and abs(dec) < REST_RATE_DEG_S


def _plausible(status: Status) -> bool:
    """Tell whether the numbers that decide anything are finite and within their ranges."""
    numbers = (status.ra_rate_dtics_s, status.dec_rate_dtics_s)
    return (
        0.0 <= status.ra_h <= 24.0
        and -90.0 <= status.dec_deg <= 90.0
        and 0.0 <= status.sidereal_h <= 24.0
        and all(math.isfinite(x) for x in numbers)
    )

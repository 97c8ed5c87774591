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

if TYPE_CHECKING:
    from sattrack.safety import Cleared

DEG_S_PER_DTIC_S = 360.0 / TICS_PER_TURN / 10.0
STALE_AFTER_S = 0.3
LOST_AFTER_S = 2.0
RESTART_PROOF = 3
"""Consecutive datagrams of another count that prove a restart of the mount."""
SUSPICIOUS_JUMP = 400
"""A forward jump of the counter, in datagrams, that is not taken on trust (20 s at 20 Hz)."""
SLEW_NEVER_SEEN_AFTER = 5
"""Statuses after a slew's acknowledgement without Slewing that mean it was too short to be seen."""
REST_RATE_DEG_S = SIDEREAL_RATE_DEG_S * 0.5
"""A drive this near to standstill, or to sidereal tracking, is where it should be."""


class Handshake(Enum):
    """Where a one-shot command stands."""

    IDLE = "idle"
    RAISED = "raised"
    RELEASING = "releasing"


TRANSITIONS = {
    (Handshake.IDLE, "request"): Handshake.RAISED,
    (Handshake.RAISED, "ack up"): Handshake.RELEASING,
    (Handshake.RAISED, "withdraw"): Handshake.RELEASING,
    (Handshake.RELEASING, "ack down"): Handshake.IDLE,
}


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
class LinkHealth:
    """Datagrams counted on our side."""

    sent: int = 0
    received: int = 0
    lost: int = 0
    late: int = 0
    duplicate: int = 0
    rejected: int = 0
    restarts: int = 0


@dataclass(slots=True)
class _Slew:
    target: SlewTo
    state: SlewState = SlewState.WAITING
    seen_moving: bool = False
    statuses_since_ack: int = 0


@dataclass(slots=True)
class Session:
    """One client's conversation with one mount; `profile` settles what the paper leaves open."""

    profile: MountProfile
    health: LinkHealth = field(default_factory=LinkHealth)
    status: Status | None = None
    """The last accepted status, whole."""
    sample: StatusSample | None = None
    _wanted: Motion = field(default_factory=Hold)
    _abort: Handshake = Handshake.IDLE
    _slew_flag: Handshake = Handshake.IDLE
    _slew: _Slew | None = None
    _aborted: bool = False
    _candidate: int | None = None
    _candidate_run: int = 0

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
        if not self._in_order(status.counter):
            return None
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
        if self._abort is Handshake.RAISED:
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
                self._withdraw_slew()
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
        if sample is None or not isinstance(self._wanted, Stop) or not self._aborted:
            return False
        return not sample.slewing and is_at_rest(sample)

    def _compose_stop(self) -> Command:
        self._withdraw_slew()
        if self._abort is Handshake.IDLE and self.status is not None and self.status.slewing:
            # A late datagram, or another client, has set the mount going again: the mount ignores counters.
            self._aborted = False
        if not self._aborted and self._abort is Handshake.IDLE and not self._acked("ack_abort"):
            self._abort = TRANSITIONS[self._abort, "request"]
        return Command(self.health.sent, abort=self._abort is Handshake.RAISED)

    def _compose_move(self, move: MoveAxes) -> Command:
        self._withdraw_slew()
        westward = (0.0 if self.profile.additive else SIDEREAL_RATE_DEG_S) - move.ra_rate_deg_s
        return Command(
            self.health.sent,
            move_ra=True,
            move_dec=True,
            move_ra_rate_deg_s=self.profile.ra_rate_sign * westward,
            move_dec_rate_deg_s=self.profile.dec_rate_sign * move.dec_rate_deg_s,
        )

    def _compose_slew(self, target: SlewTo) -> Command:
        slew = self._slew
        if slew is not None and slew.state is SlewState.WAITING:
            standing = self.status is not None and not self.status.slewing
            if standing and self._slew_flag is Handshake.IDLE and not self._acked("ack_slew"):
                self._slew_flag = TRANSITIONS[self._slew_flag, "request"]
                slew.state = SlewState.ASKED
        return Command(
            self.health.sent,
            slew=self._slew_flag is Handshake.RAISED,
            target_ra_h=target.ra_deg % 360.0 / 15.0,
            target_dec_deg=target.dec_deg,
        )

    def _withdraw_slew(self) -> None:
        if self._slew_flag is Handshake.RAISED:
            self._slew_flag = TRANSITIONS[self._slew_flag, "withdraw"]

    def _acked(self, flag: str) -> bool:
        return self.status is not None and bool(getattr(self.status, flag))

    def _follow_acknowledgements(self, status: Status) -> None:
        if self._abort is Handshake.RAISED and status.ack_abort:
            self._abort = TRANSITIONS[self._abort, "ack up"]
            self._aborted = True
        elif self._abort is Handshake.RELEASING and not status.ack_abort:
            self._abort = TRANSITIONS[self._abort, "ack down"]
        if self._slew_flag is Handshake.RAISED and status.ack_slew:
            self._slew_flag = TRANSITIONS[self._slew_flag, "ack up"]
            if self._slew is not None and self._slew.state is SlewState.ASKED:
                self._slew.state = SlewState.UNDER_WAY
        elif self._slew_flag is Handshake.RELEASING and not status.ack_slew:
            self._slew_flag = TRANSITIONS[self._slew_flag, "ack down"]
        if self._slew is not None and self._slew.state is SlewState.UNDER_WAY:
            self._follow_slew(self._slew, status)

    @staticmethod
    def _follow_slew(slew: _Slew, status: Status) -> None:
        slew.statuses_since_ack += 1
        slew.seen_moving = slew.seen_moving or status.slewing
        if not status.slewing and (slew.seen_moving or slew.statuses_since_ack > SLEW_NEVER_SEEN_AFTER):
            slew.state = SlewState.DONE

    def _in_order(self, counter: int) -> bool:
        """Tell whether a status of this count is the next news; count it where it is not."""
        if self.status is None:
            return True
        ahead = counter - self.status.counter
        if 0 < ahead < SUSPICIOUS_JUMP:
            self.health.lost += ahead - 1
            self._candidate = None
            return True
        if self._restarted(counter):
            self.health.restarts += 1
            return True
        if ahead == 0:
            self.health.duplicate += 1
        elif ahead < 0:
            self.health.late += 1
            self.health.lost = max(0, self.health.lost - 1)
        else:
            self.health.rejected += 1
        return False

    def _restarted(self, counter: int) -> bool:
        follows = self._candidate is not None and counter == self._candidate + 1
        self._candidate_run = self._candidate_run + 1 if follows else 1
        self._candidate = counter
        if self._candidate_run < RESTART_PROOF:
            return False
        self._candidate = None
        self._candidate_run = 0
        return True


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

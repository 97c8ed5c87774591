"""Acknowledgements that answer to nothing of ours: launches doubled on the way, and other senders.

The mount ignores the commands' counter, so a late or repeated datagram with a flag up makes a second rising
edge, and a second sender makes flags toggle in the mailbox. Both show in acknowledgements only.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.xerxes.datagrams import Command, Status
    from sattrack.mount.xerxes.link import LinkHealth

NAMES = ("abort", "slew", "sync", "pulse_guide", "move_ra", "move_dec")
DOUBLED_WITHIN = 40
"""Datagrams after ours within which an acknowledgement that rises again is taken for a doubled launch."""
ESTABLISHED = 10
"""Datagrams with a flag up after which its acknowledgement should stand: no late one explains a fall then."""
INTRUDER_PROOF = 3
INTRUDER_WITHIN = 200
"""So many acknowledgements that are not ours within so many datagrams are another sender, not an accident."""

_flags = attrgetter(*NAMES)
_acks = attrgetter(*(f"ack_{name}" for name in NAMES))


@dataclass(slots=True)
class _Watched:
    """One flag of ours, and its acknowledgement as last seen."""

    up: bool = False
    """Whether the flag was up in the last datagram."""
    rose: int = -(10**9)
    """Number of the datagram with which it last rose."""
    fell: int = -(10**9)
    """Number of the last datagram that had it up."""
    answered: bool = True
    """Whether its last rise has been acknowledged."""
    ack: bool = False


@dataclass(slots=True)
class AckWatch:
    """Compares acknowledgements with the flags that were sent; counts into `health`."""

    health: LinkHealth
    _watched: dict[str, _Watched] = field(default_factory=lambda: {name: _Watched() for name in NAMES})
    _number: int = 0
    _foreign: deque[int] = field(default_factory=lambda: deque(maxlen=INTRUDER_PROOF))
    _last_flags: tuple[bool, ...] = (False,) * len(NAMES)
    _last_acks: tuple[bool, ...] = (False,) * len(NAMES)

    def sent(self, command: Command) -> None:
        """Take what the next datagram says."""
        self._number += 1
        flags = _flags(command)
        if True not in flags and True not in self._last_flags:
            return
        self._last_flags = flags
        for flag, watched in zip(flags, self._watched.values(), strict=True):
            if flag and not watched.up:
                watched.rose = self._number
                watched.answered = False
            if flag:
                watched.fell = self._number
            watched.up = flag

    def see(self, status: Status) -> None:
        """Take what a status acknowledges."""
        acks = _acks(status)
        if acks == self._last_acks:
            return
        self._last_acks = acks
        for ack, watched in zip(acks, self._watched.values(), strict=True):
            if ack and not watched.ack:
                self._rises(watched)
            elif watched.ack and not ack and watched.up and self._number - watched.rose > ESTABLISHED:
                self._note_foreign()
            watched.ack = ack

    def forget(self) -> None:
        """Begin anew with a mount that has restarted."""
        for watched in self._watched.values():
            watched.ack = False
        self._last_acks = (False,) * len(NAMES)

    @property
    def intruder(self) -> str | None:
        """What to tell of another sender, in words; None while there is no sign of one."""
        if len(self._foreign) < INTRUDER_PROOF or self._number - self._foreign[0] > INTRUDER_WITHIN:
            return None
        return "another program is sending commands to this mount: end it, or motions will mix"

    def _rises(self, watched: _Watched) -> None:
        if not watched.answered or watched.up:
            watched.answered = True
        elif self._number - watched.fell <= DOUBLED_WITHIN:
            self.health.doubled_launches += 1
        else:
            self._note_foreign()

    def _note_foreign(self) -> None:
        self.health.foreign_acks += 1
        self._foreign.append(self._number)

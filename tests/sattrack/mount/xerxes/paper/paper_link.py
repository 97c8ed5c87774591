"""A client's session and a mount between wires of the tests' own, and the rules that its datagrams must keep.

The rules are the paper's: "Details" (the flag is set, held until the acknowledgement, removed, then the mount
removes the acknowledgement; only the rising edge counts) and the ranges under the command table. What goes
over the wires is read by `paper_packing`, never by the codec.
"""

from __future__ import annotations

import heapq
import itertools
import random
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from paper_mount import ACKS, LOOP_S, PaperMount, groups
from paper_packing import FLAG_BYTES, CommandRow, unpack_command

from sattrack.mount.model import MountProfile
from sattrack.mount.requests import ClearedRequest
from sattrack.mount.xerxes.session import Session

if TYPE_CHECKING:
    from sattrack.mount.requests import Request, Ticket, TicketState

T0 = 1_790_000_000.0
"""Some second of UTC, POSIX."""
ACK_BYTES = {
    "MoveAxisDec": 146,
    "MoveAxisRA": 147,
    "AbortSlewCmd": 155,
    "SyncToTargetCmd": 156,
    "PulseGuideCmd": 157,
    "SlewToTargetCmd": 158,
}
"""From the status table."""
ONE_SHOTS = frozenset(FLAG_BYTES) - {"MoveAxisRA", "MoveAxisDec", "spare"}
VALUES = {
    "SlewToTargetCmd": ("TargetRA", "TargetDec"),
    "SyncToTargetCmd": ("TargetRA", "TargetDec"),
    "PulseGuideCmd": ("PulseGuideRADuration", "PulseGuideDecDuration"),
}
"""What a command reads, and so must stand still while its flag is up."""


class Mount(Protocol):
    """What the wires lead to."""

    def receive(self, data: bytes) -> bool: ...


@dataclass
class Wires:
    """One direction: what is sent comes after a delay, or twice, or never."""

    rng: random.Random
    loss: float = 0.0
    duplication: float = 0.0
    reorder: float = 0.0
    most_late: int = 3
    """By how many periods a datagram may be late."""
    lost: int = 0
    doubled: int = 0
    delayed: int = 0
    _due: list[tuple[int, int, bytes]] = field(default_factory=list)
    _order: itertools.count[int] = field(default_factory=itertools.count)

    def put(self, period: int, data: bytes) -> None:
        copies = 1
        if self.rng.random() < self.loss:
            self.lost += 1
            return
        if self.rng.random() < self.duplication:
            self.doubled += 1
            copies = 2
        for copy in range(copies):
            late = 0
            if copy or self.rng.random() < self.reorder:
                late = self.rng.randint(0 if copy else 1, self.most_late)
                self.delayed += late > 0
            heapq.heappush(self._due, (period + late, next(self._order), data))

    def take(self, period: int) -> list[bytes]:
        out = []
        while self._due and self._due[0][0] <= period:
            out.append(heapq.heappop(self._due)[2])
        return out


@dataclass
class Rules:
    """Watches one client's datagrams; `broken` says what went against the paper, and when."""

    broken: list[str] = field(default_factory=list)
    rises: list[tuple[int, str]] = field(default_factory=list)
    """Period and name of every flag that rose."""
    falls: list[tuple[int, str]] = field(default_factory=list)
    early_falls: list[tuple[int, str]] = field(default_factory=list)
    """Flags that have an acknowledgement and fell without it."""
    changed: int = 0
    """How often another target was written under a slew's raised flag; only its rise is read by the mount."""
    last: CommandRow = field(default_factory=CommandRow)
    period: int = 0
    acked: dict[str, bool] = field(default_factory=dict)
    """Whether a flag that is up has been acknowledged since it rose."""
    standing: set[str] = field(default_factory=set)
    """Acknowledgements up in the newest status."""
    newest: int = -1

    def hear(self, status: bytes) -> None:
        """Take a status as the client gets it; one older than another before tells nothing."""
        raw = struct.unpack_from("<q", status, 104)[0]
        count = raw if raw < 2**52 else int(struct.unpack_from("<d", status, 104)[0])
        if count <= self.newest:
            return
        self.newest = count
        self.standing = {name for name, offset in ACK_BYTES.items() if status[offset]}
        for name in self.standing & self.acked.keys():
            self.acked[name] = True

    def restarted(self) -> None:
        """The mount counts from the beginning, and acknowledges nothing."""
        self.newest = -1
        self.standing.clear()

    def send(self, data: bytes) -> CommandRow:
        """Take one datagram of the client."""
        self.period += 1
        row, last = unpack_command(data), self.last
        if row.counter != last.counter + 1 and self.period > 1:
            self._fault(f"counter {last.counter} is followed by {row.counter}")
        if not (0.0 <= row.TargetRA < 24.0 and -90.0 <= row.TargetDec <= 90.0):
            self._fault(f"target {row.TargetRA} h {row.TargetDec}°")
        up, was = row.up(), last.up()
        if len(groups(up)) > 1 or row.spare:
            self._fault(f"together: {sorted(up)}")
        for name in up - was:
            self.rises.append((self.period, name))
            self.acked[name] = False
            # A stop is to be one call away from every state: no stuck acknowledgement keeps it back.
            if name in self.standing and name != "AbortSlewCmd":
                self._fault(f"{name} rises while its acknowledgement stands")
        for name in was - up:
            self.falls.append((self.period, name))
            if name in ACKS and not self.acked.pop(name):
                self.early_falls.append((self.period, name))
        for name in up & was & VALUES.keys():
            if any(getattr(row, value) != getattr(last, value) for value in VALUES[name]):
                if name == "SlewToTargetCmd":
                    self.changed += 1
                else:
                    self._fault(f"values change while {name} is up")
        self.last = row
        return row

    def _fault(self, what: str) -> None:
        self.broken.append(f"period {self.period}: {what}")

    def rose(self, name: str) -> int:
        """How often a flag rose."""
        return sum(1 for _, which in self.rises if which == name)


class Bench:
    """One session and one mount, 20 turns a second of virtual time."""

    def __init__(
        self,
        mount: PaperMount | None = None,
        profile: MountProfile | None = None,
        there: Wires | None = None,
        back: Wires | None = None,
    ) -> None:
        self.mount = mount or PaperMount()
        self.profile = profile or MountProfile(move_axis=self.mount.move_axis)
        self.session = Session(self.profile)
        self.rules = Rules()
        quiet = random.Random(0)
        self.there, self.back = there or Wires(quiet), back or Wires(quiet)
        self.now = T0
        self.period = 0
        self.sent: list[CommandRow] = []
        self.tickets: list[Ticket] = []

    def submit(self, request: Request) -> Ticket:
        ticket = self.session.submit(ClearedRequest(request))
        self.tickets.append(ticket)
        return ticket

    def turn(self) -> CommandRow:
        """One period: a datagram goes out, the mount runs its loop, its status comes back."""
        self.period += 1
        self.now += LOOP_S
        data = self.session.compose()
        row = self.rules.send(data)
        self.sent.append(row)
        self.there.put(self.period, data)
        for arrived in self.there.take(self.period):
            self.mount.receive(arrived)
        self.back.put(self.period, self.mount.turn())
        for status in self.back.take(self.period):
            self.rules.hear(status)
            self.session.receive(status, self.now)
        return row

    def run(self, seconds: float) -> list[CommandRow]:
        return [self.turn() for _ in range(round(seconds / LOOP_S))]

    def settle(self, ticket: Ticket, within_s: float = 60.0) -> TicketState:
        """Turn until a ticket settles."""
        for _ in range(round(within_s / LOOP_S)):
            if ticket.settled:
                return ticket.state
            self.turn()
        assert ticket.settled, f"{ticket.request} is still {ticket.state.value} after {within_s:g} s"
        return ticket.state

    def up_rows(self, name: str) -> list[CommandRow]:
        """Datagrams sent with a flag up."""
        return [row for row in self.sent if getattr(row, name)]

    def launched(self, command: str) -> list[Any]:
        return [launch for launch in self.mount.launches if launch.command == command]

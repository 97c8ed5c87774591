"""Hours of requests drawn at random, over wires that lose, double and reorder, and the accounts of both ends.

The mount's loop runs beside the client's at a period of its own ("there is by design no synchronization"), so
that none, one or two datagrams lie between two of its turns.
"""

from __future__ import annotations

import bisect
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest
from paper_link import T0, Rules, Wires
from paper_mount import LOOP_S, Launch, PaperMount, groups

from sattrack.mount.model import Cleared, Hold, MountProfile, Slew
from sattrack.mount.requests import (
    SETTLED,
    Abort,
    ClearedRequest,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    TicketState,
    TrackingRate,
)
from sattrack.mount.xerxes.session import Session

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S = 240.0
"""By when each request of these days must have settled: slews take under half a minute."""
ONE_SHOT_FLAGS: dict[type[Any], str] = {
    Slew: "SlewToTargetCmd",
    Sync: "SyncToTargetCmd",
    Abort: "AbortSlewCmd",
    FindHome: "FindHomeCmd",
    PulseGuide: "PulseGuideCmd",
}
TWO_MINUTES = 1.0 / 30.0
DAYS = pytest.mark.parametrize(
    ("hours", "how"),
    [
        pytest.param(TWO_MINUTES, "held", id="2 min-held"),
        pytest.param(TWO_MINUTES, "edge", id="2 min-edge"),
        pytest.param(24.0, "held", id="24 h-held", marks=pytest.mark.soak),
        pytest.param(24.0, "edge", id="24 h-edge", marks=pytest.mark.soak),
    ],
)
LOSSY = {"loss": 0.05, "duplication": 0.01, "reorder": 0.01}
MOTIONS = (Slew, MoveAxis, EndMove, Abort)


def drawn(rng: random.Random, ra_deg: float, dec_deg: float) -> Request:
    """A request of any kind but park, near the direction given."""
    kind = rng.randrange(12)
    ra = (ra_deg + rng.uniform(-40.0, 40.0)) % 360.0
    dec = max(-80.0, min(80.0, dec_deg * 0.5 + rng.uniform(-30.0, 30.0)))
    match kind:
        case 0 | 1:
            return Slew(ra, dec)
        case 2 | 3:
            return Sync((ra_deg + rng.uniform(-0.5, 0.5)) % 360.0, max(-89.0, min(89.0, dec_deg)))
        case 4:
            return Abort()
        case 5:
            return FindHome()
        case 6 | 7:
            return PulseGuide(rng.randint(-2000, 2000) or 1, rng.randint(-2000, 2000))
        case 8:
            return MoveAxis(rng.uniform(-0.5, 0.5), rng.choice([None, rng.uniform(-0.2, 0.2)]))
        case 9:
            return EndMove()
        case 10:
            return FineRate(rng.uniform(-1e-3, 1e-3), rng.uniform(-1e-3, 1e-3))
        case _:
            return TrackingRate(rng.randrange(4))


@dataclass
class Day:
    """One client, one mount, two wires and somebody who asks for things; `turn_mount` runs the mount once."""

    session: Session
    receive: Callable[[bytes], Any]
    turn_mount: Callable[[float], bytes]
    there: Wires
    back: Wires
    rng: random.Random
    mount_period_s: float = LOOP_S
    rules: Rules = field(default_factory=Rules)
    now: float = T0
    period: int = 0
    settled: list[Ticket] = field(default_factory=list)
    late: list[str] = field(default_factory=list)
    twice: list[str] = field(default_factory=list)
    counters: list[tuple[int, str]] = field(default_factory=list)
    """Counter of the datagram in which each flag rose, for the launches to be held against."""
    pause_s: float = 1.0
    _motion: Ticket | None = None
    _mount_due: float = T0
    _open: list[tuple[float, Ticket]] = field(default_factory=list)

    def run(self, hours: float, spell: Callable[[Day], None] | None = None) -> None:
        for _ in range(round(hours * 3600.0 / LOOP_S)):
            self.turn()
            self.ask()
            if spell is not None:
                spell(self)

    def ask(self) -> None:
        """Ask for something once in a while, mostly when nothing is under way, sometimes into it."""
        self.pause_s -= LOOP_S
        if self.pause_s > 0.0 or (self._open and self.rng.random() < 0.99):
            return
        sample = self.session.sample
        if sample is None:
            return
        self.submit(drawn(self.rng, sample.ra_deg, sample.dec_deg))
        self.pause_s = self.rng.uniform(0.0, 4.0)

    def submit(self, request: Request) -> Ticket:
        # A motion that is over must not keep back what comes after it.
        if not isinstance(request, MOTIONS):
            self._let_go()
        ticket = self.session.submit(ClearedRequest(request))
        if isinstance(request, MOTIONS):
            self._motion = ticket
        self._open.append((self.now, ticket))
        return ticket

    def _let_go(self) -> None:
        """Hold once a motion is settled, so that what waits behind it may go."""
        if self._motion is not None and self._motion.settled:
            self.session.apply(Cleared(Hold()))
            self._motion = None

    def turn(self) -> None:
        self.period += 1
        self.now += LOOP_S
        data = self.session.compose()
        risen = len(self.rules.rises)
        row = self.rules.send(data)
        for _, name in self.rules.rises[risen:]:
            self.counters.append((row.counter, name))
        self.there.put(self.period, data)
        for arrived in self.there.take(self.period):
            self.receive(arrived)
        while self._mount_due <= self.now:
            self._mount_due += self.mount_period_s
            self.back.put(self.period, self.turn_mount(self._mount_due))
        for status in self.back.take(self.period):
            self.rules.hear(status)
            self.session.receive(status, self.now)
        self._account()

    def _account(self) -> None:
        still = []
        for since, ticket in self._open:
            if ticket.settled:
                self.settled.append(ticket)
                if sum(state in SETTLED for state in ticket.history) != 1:
                    self.twice.append(f"{ticket.request}: {ticket.history}")
            elif self.now - since > PATIENCE_S:
                self.late.append(f"{self.now - T0:.2f} s: {ticket.request} is still {ticket.state.value}")
            else:
                still.append((since, ticket))
        self._open = still

    def finish(self) -> None:
        """Let everything come to its end: nothing more is asked for."""
        for _ in range(round(PATIENCE_S / LOOP_S) + 2):
            if not self._open:
                break
            self.turn()
            self._let_go()

    def states(self) -> dict[TicketState, int]:
        return {state: sum(ticket.state is state for ticket in self.settled) for state in TicketState}


def paper_day(
    seed: int, how: Any = "held", mount_period_s: float = LOOP_S, **wires: float
) -> tuple[Day, PaperMount]:
    """A day with the stand-in mount."""
    rng = random.Random(seed)
    mount = PaperMount(move_axis=how)
    day = Day(
        Session(MountProfile(move_axis=how)),
        mount.receive,
        lambda now: mount.turn(mount_period_s),
        Wires(random.Random(seed + 1), **wires),  # type: ignore[arg-type]
        Wires(random.Random(seed + 2), **wires),  # type: ignore[arg-type]
        rng,
        mount_period_s,
    )
    return day, mount


@dataclass
class Doubled:
    """A launch that no flag of the client's asked for: of a flag that had launched before."""

    launch: Launch
    axes: int
    """Acknowledgements that come of it: one, for MoveAxis one an axis."""
    repeats: bool
    """Whether nothing else was launched between it and what it doubles."""


def doubled_launches(day: Day, mount: PaperMount) -> list[Doubled]:
    """Every launch beyond the first of each rising edge that the client sent."""
    rises: dict[str, list[int]] = {}
    for counter, name in day.counters:
        rises.setdefault("MoveAxis" if groups([name]) == {"MoveAxis"} else name, []).append(counter)
    out = []
    used: set[tuple[str, int]] = set()
    last: tuple[str, int] | None = None
    for launch in mount.launches:
        before = bisect.bisect_right(rises[launch.command], launch.row.counter)
        edge = (launch.command, rises[launch.command][before - 1])
        if edge in used:
            axes = sum(name.startswith("MoveAxis") for name in launch.row.up())
            out.append(Doubled(launch, axes or 1, last == edge))
        used.add(edge)
        last = edge
    return out


def accounts(day: Day, hours: float) -> None:
    """What holds of every day, whatever the wires did."""
    assert day.late == []
    assert day.twice == []
    assert day.rules.broken == []
    assert len(day.settled) > 200 * hours
    states = day.states()
    assert states[TicketState.COMPLETE] > len(day.settled) / 4
    assert day.session.health.restarts == 0
    assert day.session.health.rejected == 0

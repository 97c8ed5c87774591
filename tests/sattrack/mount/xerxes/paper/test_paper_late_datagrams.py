"""One datagram of ours comes twice or late, around the change from one request to the next.

Source: Van Deventer, "Xerxes Mount Control Protocol": the mount acts on the rising edge and goes by the
latest datagram of its mailbox, whatever its counter ("currently only used for diagnostic purposes"). A late
copy with a flag up is another rising edge, a late copy with flags down makes one of the next. Either must
leave the mount doing what was asked for last.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest
from paper_link import Bench, Wires
from paper_mount import PaperMount

from sattrack.mount.model import MountProfile, Slew
from sattrack.mount.requests import Abort, EndMove, MoveAxis, PulseGuide, Request, Sync, Ticket, TicketState
from sattrack.mount.xerxes.standstill import HANGS_S

How = Literal["held", "edge"]
MOVE = MoveAxis(-0.5, 0.25)
BACK = MoveAxis(0.5, -0.25)
FIRST: list[Request] = [MOVE, EndMove(), Slew(160.0, 25.0), Abort(), Sync(150.5, 20.25), PulseGuide(300, 300)]
SECOND: list[Request] = [BACK, EndMove(), Slew(155.0, 23.0), Abort(), Sync(150.1, 20.5), PulseGuide(-300, 0)]
AROUND = [
    pytest.param([0, 1, 2], [3], id="around the change"),
    pytest.param(range(-2, 12), [1, 2, 3], id="each", marks=pytest.mark.soak),
]
"""Which datagrams, counted from the change, are late or come twice, and by how many periods."""


@dataclass
class OneLate(Wires):
    """Delivers everything in time but for one datagram, which is late or has a late copy."""

    which: int = -1
    by: int = 0
    doubled: bool = False
    held_back: list[tuple[int, bytes]] = field(default_factory=list)
    ready: list[bytes] = field(default_factory=list)

    def put(self, period: int, data: bytes) -> None:
        if period == self.which:
            self.held_back.append((period + self.by, data))
        if period != self.which or self.doubled:
            self.ready.append(data)

    def take(self, period: int) -> list[bytes]:
        # What comes late may come before what is sent in that period, or after it.
        out, self.ready = self.ready, []
        late = [data for due, data in self.held_back if due == period]
        return late + out if self.which % 2 else out + late


def outcome(bench: Bench, ticket: Ticket) -> Any:
    """What the mount does once everything has calmed down."""
    request = ticket.request
    match request:
        case MoveAxis():
            return {axis: round(rate, 9) for axis, rate in bench.mount.rates_deg_s.items()}
        case Slew():
            return ticket.state, bench.mount.moving, bench.mount.ra_deg, bench.mount.dec_deg
        case Sync() | PulseGuide():
            return ticket.state
        case _:
            return bench.mount.moving


def played(
    how: How, first: Request, second: Request, which: int, by: int, doubled: bool
) -> tuple[Bench, Ticket]:
    """Ask for one thing, then for the other, with one datagram counted from the change late or doubled."""
    wires = OneLate(random.Random(0), by=by, doubled=doubled)
    bench = Bench(PaperMount(move_axis=how), MountProfile(move_axis=how), there=wires)
    wires.which = 40 + which
    bench.run(1.0)
    bench.submit(first)
    while bench.period < 40:
        bench.turn()
    # A motion that is over is let go of, so that it does not keep back what comes after it.
    ticket = (
        bench.submit(second)
        if isinstance(second, (MoveAxis, EndMove, Slew, Abort))
        else _after(bench, second)
    )
    # The mount's rates say nothing of a slew, so the end of one is seen HANGS_S later.
    bench.run(2.0 + HANGS_S)
    return bench, ticket


def _after(bench: Bench, request: Request) -> Ticket:
    from sattrack.mount.model import Cleared, Hold

    bench.session.apply(Cleared(Hold()))
    return bench.submit(request)


def pairs() -> list[Any]:
    """Each request after each other: with MoveAxis in both readings, else in one by default."""
    return [
        pytest.param(
            first,
            second,
            how,
            id=f"{type(first).__name__}-then {type(second).__name__}-{how}",
            marks=() if reads or (row + column) % 2 == (how == "edge") else pytest.mark.soak,
        )
        for row, first in enumerate(FIRST)
        for column, second in enumerate(SECOND)
        for reads in (isinstance(first, MoveAxis) or isinstance(second, MoveAxis),)
        for how in ("held", "edge")
    ]


@pytest.mark.parametrize(("datagrams", "lateness"), AROUND)
@pytest.mark.parametrize(("first", "second", "how"), pairs())
@pytest.mark.parametrize(
    "doubled", [pytest.param(False, id="late", marks=pytest.mark.soak), pytest.param(True, id="doubled")]
)
def test_the_mount_ends_up_doing_what_was_asked_for_last(
    how: How,
    first: Request,
    second: Request,
    doubled: bool,
    datagrams: list[int],
    lateness: list[int],
) -> None:
    expected = outcome(*played(how, first, second, -100, 0, doubled))
    wrong = []
    for which in datagrams:
        for by in lateness:
            bench, ticket = played(how, first, second, which, by, doubled)
            got = outcome(bench, ticket)
            if got != expected or not ticket.settled:
                wrong.append((which, by, got, ticket.reason))
            assert bench.rules.broken == []
    assert wrong == [], f"expected {expected}"


class Script(Wires):
    """Delivers, in the periods named, the datagrams of the periods listed; otherwise what is just sent."""

    script: dict[int, list[int]]
    all_sent: dict[int, bytes]

    def put(self, period: int, data: bytes) -> None:
        self.all_sent[period] = data

    def take(self, period: int) -> list[bytes]:
        return [self.all_sent[sent] for sent in self.script.get(period, [period])]


def test_edge_a_late_copy_of_the_old_rates_does_not_keep_the_mount_moving() -> None:
    wires = Script(random.Random(0))
    # The edge of the move comes again three periods late, while that of its end is held up.
    wires.script, wires.all_sent = {43: [], 44: [41], 45: [43, 44]}, {}
    bench = Bench(PaperMount(move_axis="edge"), MountProfile(move_axis="edge"), there=wires)
    bench.run(2.0)
    bench.submit(MOVE)
    bench.turn()
    assert bench.sent[-1].MoveAxisRA
    end = bench.submit(EndMove())
    bench.run(90.0)
    assert not bench.mount.moving
    assert end.state is TicketState.COMPLETE

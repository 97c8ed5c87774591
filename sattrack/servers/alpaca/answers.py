"""Answers to orders: at once, after the next statuses, or when a move that was ended is seen at rest."""

from __future__ import annotations

from sattrack.servers.alpaca.faults import Fault, Number
from sattrack.servers.alpaca.messages import Answered

SETTLING_TICKS = 2
"""How many datagrams an answer waits for a status that comes after what it tells of."""
ANSWER_WITHIN_TICKS = 80
"""Four seconds; a client waits five."""


class Answers:
    """What clients are to be told; `ready` is for whoever tells it, and takes it away."""

    def __init__(self) -> None:
        self.ready: list[Answered] = []
        self._ticks = 0
        self._due: list[tuple[int, Answered]] = []
        self._ends: list[tuple[int, int]] = []
        """Orders that ended a move, and until when they wait for its end."""

    @property
    def await_rest(self) -> bool:
        """Whether an order waits for the end of a move."""
        return bool(self._ends)

    def done(self, number: int) -> None:
        """Answer that an order is obeyed."""
        self.ready.append(Answered(number))

    def refused(self, number: int, fault: Fault) -> None:
        """Answer that it is not."""
        self.ready.append(Answered(number, int(fault.number), fault.words))

    def soon(self, number: int, fault: Fault | None) -> None:
        """Answer when a status is there that shows it."""
        answer = Answered(number) if fault is None else Answered(number, int(fault.number), fault.words)
        self._due.append((self._ticks + SETTLING_TICKS, answer))

    def at_rest(self, number: int) -> None:
        """Answer when the mount has come to rest, or does not in time."""
        self._ends.append((number, self._ticks + ANSWER_WITHIN_TICKS))

    def supersede(self, kind: str, number: int | None) -> None:
        """Answer what waits: something else is done; `number` waited for the end of something of a `kind`."""
        if number is not None:
            self.refused(number, Fault(Number.CANCELLED, f"{kind} was ended by another command"))
        for waiting, _ in self._ends:
            self.done(waiting)
        self._ends.clear()

    def tick(self, rests: bool) -> None:
        """Make ready what is due; `rests` tells that no move is under way any more."""
        self._ticks += 1
        self.ready += [answer for at, answer in self._due if at <= self._ticks]
        self._due = [(at, answer) for at, answer in self._due if at > self._ticks]
        over = [number for number, until in self._ends if rests or until <= self._ticks]
        self._ends = [one for one in self._ends if one[0] not in over]
        for number in over:
            self.done(number)

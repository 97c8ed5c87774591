"""What `sattrack serve rotctld` adds to the loop of a door: its clients, and what the log says of them."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sattrack.runtime.loop import StationLoop
from sattrack.servers.antenna.log_lines import spoken
from sattrack.servers.antenna.trajectory import to_ns
from sattrack.servers.rotctld.answers import Client

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.rotctld.door import RotctldServer
    from sattrack.servers.rotctld.rotator import Rotator, RotatorStation

PROGRAM = "rotctld"
MOST_TOLD = 5
"""A tick's lines of the log: a flood of them is counted."""
TELL_FAILURES_EVERY_S = 10.0


@dataclass(slots=True)
class RotctldLoop(StationLoop):
    """Serves one mount to rotctld's clients until `stop` is asked for and the mount is seen at rest."""

    driver: RotatorStation
    door: RotctldServer
    _told_failures: int = field(default=0, init=False)
    _failures_told_s: float = field(default=0.0, init=False)

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        self.log(spoken(words, PROGRAM))

    def serve(self, ready: list[Any]) -> None:
        """Serve the clients that have said something, or wait for answers."""
        self._gone(self.door.serve(ready, self._now_ns))

    def obey(self, now_utc_s: float) -> None:
        """Hang up on clients that are too long silent."""
        del now_utc_s
        self._gone(self.door.tend(self._now_ns()))

    def report(self) -> None:
        """Say what has changed: clients, who commands, refusals, interlocks, the link."""
        words = self.door.words
        for _ in range(min(MOST_TOLD, len(words))):
            self.tell(words.popleft())
        if words:
            self.tell(f"and {len(words)} lines more, or still more")
            words.clear()
        self._report_failures()
        self.report_mount("position", "R")

    def _report_failures(self) -> None:
        count = self.door.failures + sum(caller.client.refused for caller in self.door.callers.values())
        now_s = time.monotonic()
        if count == self._told_failures or now_s - self._failures_told_s < TELL_FAILURES_EVERY_S:
            return
        self.tell(f"{count - self._told_failures} requests were answered with a failure")
        self._told_failures, self._failures_told_s = count, now_s

    def _gone(self, numbers: list[int]) -> None:
        for number in numbers:
            self.driver.rotator.hang_up(number)
            self.door.words.append(f"client {number} is gone")

    def _now_ns(self) -> int:
        return to_ns(self.connection.now_utc_s())


def client_maker(rotator: Rotator, info: str) -> Callable[[int], Client]:
    """Return what makes the end that speaks to one client."""
    return lambda number: Client(number, rotator, info)

"""Calibration against mounts drawn at random: what it finds against what they are.

python bench/calibration.py [DRAWS [SEED]]

Each draw is a whole run of `sattrack.calibration` against the simulated mount in virtual time, with delays,
a network that scatters and loses, the mount's irregular timer, and a clock that is off and drifts.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from sattrack.calibration.calibrator import Calibrator

SLICE_S = 0.015625
"""Windows looks for expired timers at multiples of this."""


class Loop(Protocol):
    """A mount: a mailbox and a loop, at instants of true time."""

    def receive(self, data: bytes) -> object: ...

    def tick(self, now_utc_s: float) -> bytes: ...


@dataclass
class Network:
    """Two ways with their own least delays; `jitter_s` is the mean of what is added, exponentially."""

    command_s: float = 0.0
    status_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0


@dataclass
class Timer:
    """When the mount's loop turns: "even", "windows" (multiples of 1/64 s) or "loose" (normal scatter)."""

    law: str = "even"
    period_s: float = 0.05
    scatter_s: float = 0.002
    phase_s: float = 0.0

    def after(self, last_s: float, rng: np.random.Generator) -> float:
        if self.law == "windows":
            late = float(rng.uniform(0.0, 0.0005))
            return (math.floor((last_s + self.period_s) / SLICE_S) + 1) * SLICE_S + late
        if self.law == "loose":
            return last_s + max(0.02, self.period_s + float(rng.normal(0.0, self.scatter_s)))
        return last_s + self.period_s


@dataclass
class VirtualRun:
    """One calibrator and one mount in virtual time: a heap of events, and nothing that waits."""

    calibrator: Calibrator
    mount: Loop
    network: Network
    timer: Timer
    rng: np.random.Generator
    begin_utc_s: float
    watch: Callable[[float, Calibrator], None] | None = None
    commands: list[tuple[float, bytes]] = field(default_factory=list)
    cut: tuple[float, float] = (math.inf, math.inf)
    """Seconds of the run between which no status arrives."""
    now_utc_s: float = 0.0

    def run(self) -> float:
        """Run to the end; return how long it took, seconds of virtual time."""
        events: list[tuple[float, int, str, bytes]] = []
        count = 0

        def put(at: float, kind: str, data: bytes = b"") -> None:
            nonlocal count
            count += 1
            heapq.heappush(events, (at, count, kind, data))

        put(self.begin_utc_s + self.timer.phase_s, "tick")
        while self.calibrator.ending is None:
            due = self.calibrator.due()
            if due <= events[0][0]:
                self.now_utc_s = due = max(due, self.now_utc_s)
                if self.watch is not None:
                    self.watch(due, self.calibrator)
                data = self.calibrator.send(due)
                self.commands.append((due, data))
                self._carry(put, due + self.network.command_s, "command", data)
                self.calibrator.sent(due)
                continue
            at, _, kind, data = heapq.heappop(events)
            self.now_utc_s = at
            if kind == "tick":
                status = self.mount.tick(at)
                if not self.cut[0] <= at - self.begin_utc_s < self.cut[1]:
                    self._carry(put, at + self.network.status_s, "status", status)
                put(self.timer.after(at, self.rng), "tick")
            elif kind == "command":
                self.mount.receive(data)
            else:
                self.calibrator.receive(data, at)
        return self.now_utc_s - self.begin_utc_s

    def _carry(self, put: Callable[[float, str, bytes], None], at: float, kind: str, data: bytes) -> None:
        if self.network.loss and self.rng.random() < self.network.loss:
            return
        late = float(self.rng.exponential(self.network.jitter_s)) if self.network.jitter_s else 0.0
        put(at + late, kind, data)

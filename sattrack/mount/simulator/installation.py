"""A simulated mount as it is met: its loop's timer, the wires to and from it, and what goes wrong.

Pure: the UDP server and a run in virtual time ask it for instants and hand it datagrams, and do the waiting.
All that is random comes from the hardware's seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount.simulator.faults import DRIVES, FaultEvent, Faults, parse_faults
from sattrack.mount.simulator.timer import Timer
from sattrack.mount.simulator.wire import Wire, WireLaw

if TYPE_CHECKING:
    from sattrack.mount.simulator.mount import SimulatedMount, Truth


class Turn(NamedTuple):
    """What came of one turn of the loop: the status to send, if any, and the truth, if the loop ran."""

    status: bytes | None
    truth: Truth | None


@dataclass(slots=True)
class Installation:
    """One mount with everything around it.

    Delays are those of the hardware's settings, or else `command_delay_s` and `status_delay_s`; the faults
    come on top of the hardware's own. Raises BadInputError where those cannot be read.
    """

    mount: SimulatedMount
    faults: Faults | None = None
    command_delay_s: float = 0.0
    status_delay_s: float = 0.0
    commands: Wire = field(init=False)
    statuses: Wire = field(init=False)
    _timer: Timer = field(init=False)
    _events: list[FaultEvent] = field(init=False)
    _begun_s: float | None = None
    _frozen_until_s: float = -math.inf
    _silent_until_s: float = -math.inf
    _deaf_until_s: float = -math.inf
    _elapsed_s: float = 0.0
    """When the loop ran last, since its begin."""
    _down_until_s: float | None = None

    def __post_init__(self) -> None:
        """Lay the wires and set the timer."""
        hardware = self.mount.hardware
        faults = self.faults
        if faults is None:
            faults = parse_faults(hardware.faults, "the mount profile, simulator.faults:")
        seed = hardware.seed
        self.commands = Wire(
            faults.command.over(
                _law(hardware.command_delay_s, hardware.command_jitter_s, self.command_delay_s)
            ),
            f"commands {seed}",
        )
        self.statuses = Wire(
            faults.status.over(_law(hardware.status_delay_s, hardware.status_jitter_s, self.status_delay_s)),
            f"statuses {seed}",
        )
        self._timer = Timer(hardware.timer, self.mount.profile.period_s, hardware.timer_drift_ppm, seed)
        self._events = list(faults.events)

    def next_turn_s(self, now_s: float) -> float:
        """Return the first instant after `now_s` at which the loop runs; the first call begins it."""
        return self._timer.next(now_s)

    def receive(self, data: bytes) -> bool:
        """Take a datagram that has arrived; False where it is refused, or nobody is there to take it."""
        if self._down_until_s is not None or self._elapsed_s < self._deaf_until_s:
            return False
        return self.mount.receive(data)

    def turn(self, now_utc_s: float) -> Turn:
        """Run the loop at an instant, as far as faults let it."""
        if self._begun_s is None:
            self._begun_s = now_utc_s
        elapsed_s = self._elapsed_s = now_utc_s - self._begun_s
        if self._events or self._down_until_s is not None:
            self._befall(elapsed_s, now_utc_s)
        if self._down_until_s is not None or elapsed_s < self._frozen_until_s:
            return Turn(None, None)
        status, truth = self.mount.tick(now_utc_s)
        return Turn(None if elapsed_s < self._silent_until_s else status, truth)

    def _befall(self, elapsed_s: float, now_utc_s: float) -> None:
        while self._events and self._events[0].at_s <= elapsed_s:
            event = self._events.pop(0)
            amount_s = math.inf if event.amount_s is None else event.amount_s
            match event.kind:
                case "freeze":
                    self._frozen_until_s = event.at_s + amount_s
                case "crash":
                    self._down_until_s = event.at_s + amount_s
                    self.mount.crash(now_utc_s)
                case "silent":
                    self._silent_until_s = event.at_s + amount_s
                case "deaf":
                    self._deaf_until_s = event.at_s + amount_s
                case "cut":
                    self._silent_until_s = self._deaf_until_s = event.at_s + amount_s
                case "clock-step":
                    self.mount.step_clock(amount_s)
                case _:
                    self.mount.fail_drives(DRIVES[event.kind], now_utc_s)
        if self._down_until_s is not None and elapsed_s >= self._down_until_s:
            self._down_until_s = None
            self.mount.restart(now_utc_s)


def _law(delay_s: float | None, jitter_s: float, otherwise_s: float) -> WireLaw:
    return WireLaw(otherwise_s if delay_s is None else delay_s, jitter_s)

"""A console, or an operation, and a simulated mount in virtual time: one turn of each every 50 ms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.control.console import Console
from sattrack.control.manual_operation import Look, ManualOperation, view_of
from sattrack.mount.model import AxesPosition, MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.datagrams import Command, decode_command
from sattrack.safety import SafetyLimits
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.manual_operation import ConsoleSession
    from sattrack.control.procedures import Procedure
    from sattrack.mount.simulator.mount import Truth

T0 = 1_790_000_000.0
PERIOD_S = 0.05
SITE = Site(52.0, 4.5, 0.0)
PROFILE = MountProfile(park=AxesPosition(20.0, 40.0), home=AxesPosition(0.0, 0.0))


@dataclass
class Bench:
    """Both ends and what passed between them; `cut` loses what the mount sends, `deaf` what we send."""

    profile: MountProfile = PROFILE
    hardware: SimulatorProfile = field(default_factory=SimulatorProfile)
    start: StartPosition = field(default_factory=StartPosition)
    site: Site | None = SITE
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    cut: bool = False
    deaf: bool = False
    now_s: float = T0
    commands: list[Command] = field(default_factory=list)
    truth: Truth | None = None

    def __post_init__(self) -> None:
        self.mount = SimulatedMount(self.profile, SimulatedSite(52.0, 4.5), self.start, self.hardware)
        self.console = Console(self.profile, self.limits, self.site, "bench")

    def turn(self, part: ManualOperation | Look | ConsoleSession | None = None) -> None:
        """Let 50 ms pass: the mount's turn, then that of the part, or of the bare console."""
        self.now_s += PERIOD_S
        status, self.truth = self.mount.tick(self.now_s)
        end = self.console if part is None else part
        if not self.cut:
            end.receive(status, self.now_s + 0.001)
        datagram = end.tick(self.now_s + 0.002)
        if datagram is not None:
            self.commands.append(decode_command(datagram))
            if not self.deaf:
                self.mount.receive(datagram)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.turn()

    def until(self, happens: Callable[[], bool], within_s: float = 60.0) -> None:
        for _ in range(round(within_s / PERIOD_S)):
            if happens():
                return
            self.turn()
        raise AssertionError(
            f"did not happen within {within_s} s; the console is {view_of(self.console, self.now_s)}"
        )

    def carry_out(
        self,
        procedure: Procedure,
        timeout_s: float | None = None,
        at: tuple[tuple[float, Callable[[ManualOperation], None]], ...] = (),
        within_s: float = 120.0,
    ) -> ManualOperation:
        """Run an operation to its end; `at` gives what befalls it so many seconds after its beginning."""
        operation, begin_s = ManualOperation(self.console, procedure, self.now_s, timeout_s), self.now_s
        coming = list(at)
        while not operation.finished:
            assert self.now_s - begin_s < within_s, f"not over: {operation.phase}"
            while coming and self.now_s - begin_s >= coming[0][0]:
                coming.pop(0)[1](operation)
            self.turn(operation)
        return operation

    @property
    def moves_itself(self) -> bool:
        """Whether an axis really moves otherwise than with the sky."""
        assert self.truth is not None
        resting = min(abs(self.truth.ra_rate_deg_s), abs(self.truth.ra_rate_deg_s - 360.0 / 86164.1)) < 1e-4
        return not (resting and abs(self.truth.dec_rate_deg_s) < 1e-4)

    def flags(self) -> list[str]:
        """The flags that were up, in the order of their rising."""
        risen: list[str] = []
        names = ("abort", "find_home", "move_ra", "move_dec", "park", "pulse_guide", "slew", "sync")
        before = Command()
        for command in self.commands:
            risen += [name for name in names if getattr(command, name) and not getattr(before, name)]
            before = command
        return risen

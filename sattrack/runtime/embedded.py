"""A simulated mount started in another process, for practice and for the demonstration."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import SattrackError
from sattrack.core.own_program import own_program
from sattrack.mount.simulator.mount import SimulatedSite, Truth
from sattrack.mount.simulator.process import ClockSetting, Ready, SimulatorConfig
from sattrack.mount.simulator.settings import simulator_profile
from sattrack.mount.xerxes.client import Address
from sattrack.runtime import practice
from sattrack.runtime.channel import LineReader, see_off

if TYPE_CHECKING:
    from sattrack.core.clock import Clock
    from sattrack.mount.model import MountProfile
    from sattrack.mount.simulator.mount import StartPosition
    from tle.site import Site

START_WITHIN_S = 20.0
END_WITHIN_S = 2.0
_TRUTHS = msgspec.json.Decoder(Truth)


@dataclass(slots=True)
class EmbeddedMount:
    """A running simulated mount: its port, and where its axes really are."""

    process: subprocess.Popen[bytes]
    reader: LineReader
    port: int

    @property
    def address(self) -> Address:
        """Where the mount listens."""
        return Address("127.0.0.1", self.port, 0)

    def truths(self) -> list[Truth]:
        """Return the true positions since the last call."""
        return self.reader.messages(_TRUTHS)

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        see_off(self.process, END_WITHIN_S)
        self.process.stdout.close()


def simulator_config(
    profile: MountProfile,
    table: dict[str, Any],
    site: Site,
    clock: Clock,
    start: StartPosition = practice.START,
    where: str = "the mount profile",
) -> SimulatorConfig:
    """Return how to simulate a mount by a clock; `table` is `[simulator]` of its profile, read from `where`.

    Raises BadInputError for a table that says what it cannot.
    """
    setting = None
    if isinstance(clock, SimulatedClock):
        setting = ClockSetting(clock.start_utc_s, clock.anchor_s, clock.speed)
    place = SimulatedSite(site.latitude_deg, site.longitude_deg, site.height_m)
    return SimulatorConfig(place, profile, start, clock=setting, hardware=simulator_profile(table, where))


def start_embedded(config: SimulatorConfig) -> EmbeddedMount:
    """Start a simulated mount; raises SattrackError where it does not come up."""
    process = subprocess.Popen(
        [*own_program("sattrack.mount.simulator.process"), msgspec.json.encode(config).decode()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # A Ctrl-C for the tracker is not one for the mount.
        start_new_session=True,
    )
    assert process.stdout is not None
    reader = LineReader(process.stdout.fileno())
    lines = reader.first(START_WITHIN_S)
    if not lines:
        process.kill()
        process.wait()
        raise SattrackError("the simulated mount did not start; run `sattrack sim --debug` to see why")
    return EmbeddedMount(process, reader, msgspec.json.decode(lines[0], type=Ready).port)

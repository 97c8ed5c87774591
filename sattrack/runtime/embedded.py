"""A simulated mount started in another process, for practice and for the demonstration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.channel import PipedProcess
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import SattrackError
from sattrack.mount.simulator.installation import simulator_profile
from sattrack.mount.simulator.mount import SimulatedSite, Truth
from sattrack.mount.simulator.process import ClockSetting, Ready, SimulatorConfig
from sattrack.mount.xerxes.client import Address
from sattrack.runtime import practice

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

    running: PipedProcess
    port: int

    @property
    def address(self) -> Address:
        """Where the mount listens."""
        return Address("127.0.0.1", self.port, 0)

    def truths(self) -> list[Truth]:
        """Return the true positions since the last call."""
        return self.running.channel.messages(_TRUTHS)

    def close(self) -> None:
        """End the process."""
        self.running.close(END_WITHIN_S)


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
    running = PipedProcess.start("sattrack.mount.simulator.process", msgspec.json.encode(config).decode())
    lines = running.channel.first(START_WITHIN_S)
    if not lines:
        running.close(0.0)
        raise SattrackError("the simulated mount did not start; run `sattrack sim --debug` to see why")
    return EmbeddedMount(running, msgspec.json.decode(lines[0], type=Ready).port)

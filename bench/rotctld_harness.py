"""A rotator with a simulated mount in virtual time, and clients that talk to it: no sockets, no waiting."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from antenna_harness import VirtualAntenna

from sattrack.servers.antenna.protocol import to_ns
from sattrack.servers.antenna.trajectory import HaDec
from sattrack.servers.rotctld.answers import Client
from sattrack.servers.rotctld.rotator import RotatorStation

if TYPE_CHECKING:
    from sattrack.servers.antenna.trajectory import AzEl


@dataclass
class VirtualRotator(VirtualAntenna):
    """Runs a station; `say` is what a client says now, `pointed` where the axes themselves point."""

    axes: str = "azel"
    one_at_a_time: bool = False
    clients: dict[int, Client] = field(default_factory=dict)

    def make_station(self) -> RotatorStation:
        return RotatorStation(self.sky, self.profile, self.limits, self.one_at_a_time)

    def say(self, line: str, client: int = 1) -> str:
        """Say a line now; return the answer."""
        end = self.clients.setdefault(client, Client(client, self.station.rotator))
        end.receive(line.encode("latin-1") + b"\n")
        return end.answer(to_ns(self.now_utc_s), 1000)[0].decode("latin-1")

    def hang_up(self, client: int = 1) -> None:
        del self.clients[client]
        self.station.rotator.hang_up(client)

    def pointed(self) -> AzEl:
        """Return where the axes point, by their own truth."""
        truth = self.truths[-1]
        ha_deg = self.sky.sidereal_deg(truth.utc_s) - truth.ra_deg
        return self.sky.horizontal(HaDec(ha_deg, truth.dec_deg), truth.utc_s)

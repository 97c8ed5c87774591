"""A storm over `serve rotctld`: a client follows the satellite by positions, others send what they like."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any

from sattrack.core.clock import SystemClock
from sattrack.core.errors import SattrackError
from sattrack.runtime.connection import Connection
from sattrack.runtime.loop import StationLoop
from sattrack.runtime.system import StopRequest
from sattrack.servers.antenna.protocol import to_ns
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.answers import Client
from sattrack.servers.rotctld.rotator import RotatorStation
from storm.world import Guard, Link, World
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from sattrack.runtime.control_arbiter import Observers

EVERY_S = 0.5
"""So often the client that follows sends a position."""
MOST_REQUESTS = 8
JUNK = (
    b"P 1e999 nan\n",
    b"\\dump_state\n",
    b"_\n",
    b"p\n",
    b"P\n",
    b"K\x00\xff\n",
    b"M 99 -1\n",
    b"+\\get_pos\n",
)
WILD = (b"P 10 5\n", b"P 300 80\n", b"M 8 100\n", b"M 4 100\n", b"S\n", b"P 180 0\n")


class NoServer:
    """A port without sockets: bytes come by the world's own events."""

    def readers(self) -> list[Any]:
        return []

    def writers(self) -> list[Any]:
        return []

    def flush(self) -> None:
        pass


class ServedLoop(StationLoop):
    """The loop of a server's mount."""

    world: ServedWorld

    def tell(self, words: str) -> None:
        self.world.trace("program", words)

    def obey(self, now_utc_s: float) -> None:
        self.world.answer(now_utc_s)
        if now_utc_s >= self.world.storm.facts.plan.end_utc_s:
            self.stop.ask()

    def report(self) -> None:
        self.report_mount("position", "R")
        self.world.look(self.driver)


class ServedWorld(World):
    """A world whose program is a server of rotctld's protocol."""

    def _feed(self, observers: Observers) -> None:
        del observers
        facts = self.storm.facts
        station = RotatorStation(SiteSky(facts.site.place()), facts.profile, facts.limits)
        self._dice_of_clients = random.Random(f"clients {self.storm.seed}")
        self._propagator = Propagator(facts.target, facts.site.place())
        self._clients = [Client(number, station.rotator) for number in (1, 2)]
        self._first: str | None = None
        self.at(self.now_s + 0.3, self._follow)
        link: Any = Link(self, "feeder")
        connection = Connection(link, SystemClock(), None, Guard(self))
        driver: Any = station
        loop = ServedLoop(
            connection, StopRequest(), driver, NoServer(), lambda words: self.trace("log", words)
        )
        loop.world = self
        try:
            loop.run()
        except SattrackError as error:
            self.ended.error = error
            self.trace("program", f"raised {error!r}")

    def _follow(self, _: Any) -> None:
        """Have a client send where the satellite is, and another something else now and then."""
        seen = self._propagator.at(Utc(self.now_s))
        self._clients[0].receive(f"P {float(seen.az_deg):.3f} {float(seen.alt_deg):.3f}\n".encode())
        dice = self._dice_of_clients
        if dice.random() < 0.2:
            self._clients[1].receive(dice.choice(JUNK))
        elif self.storm.seed % 2 and dice.random() < 0.05:
            line = dice.choice(WILD)
            self.trace("person", repr(line))
            self._clients[1].receive(line)
        self.at(self.now_s + EVERY_S, self._follow)

    def answer(self, now_utc_s: float) -> None:
        """Answer what has come."""
        for client in self._clients:
            client.answer(to_ns(now_utc_s), MOST_REQUESTS)

    def look(self, driver: Any) -> None:
        """Show the judge how the program stands, once a period."""
        ended_by = "operator" if driver.stop is not None else driver.tripped
        self._first = self._first or ended_by
        self.judge.period(self, driver, self._first)

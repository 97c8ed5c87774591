"""Storms over other programs than `track`.

`serve rotctld`: a client follows the satellite by positions, others send what they like. The manual console:
an operator slews, jogs and stops, and leaves at the end of the pass.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any

from sattrack.control.console import Console, ConsoleSession
from sattrack.core.angles import wrap180
from sattrack.core.clock import SystemClock
from sattrack.core.errors import SattrackError
from sattrack.mount.model import Slew, mean_sidereal_deg
from sattrack.mount.requests import SETTLED, Abort
from sattrack.runtime.connection import Connection
from sattrack.runtime.console import ConsoleLoop
from sattrack.runtime.guardian import Word
from sattrack.runtime.loop import StationLoop
from sattrack.runtime.system import StopRequest
from sattrack.servers.antenna.protocol import to_ns
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.answers import Client
from sattrack.servers.rotctld.rotator import RotatorStation
from sattrack.views.messages import Jog, Leave
from storm.world import Guard, Link, World
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from sattrack.mount.requests import Ticket, TicketState
    from sattrack.runtime.control_arbiter import Observers
    from sattrack.views.messages import ConsoleMessage

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


JOG_EVERY_S, JOGS = 0.1, (1, 25)
"""How often a key that is held says so, and how many times."""
PAUSES_S = 1.5
AWAY_DEG = 20.0


class ConsoleWorld(World):
    """A world whose program is the manual console."""

    def _feed(self, observers: Observers) -> None:
        del observers
        facts = self.storm.facts
        console = Console(facts.profile, facts.limits, facts.site.place(), "storm")
        session = ConsoleSession(console, self.now_s)
        self._console, self._session = console, session
        self._keys = random.Random(f"console {self.storm.seed}")
        self._orders: list[ConsoleMessage] = []
        self._tickets: dict[int, tuple[Ticket, TicketState]] = {}
        self._trouble: str | None = None
        self.at(self.now_s + 1.0, self._operate)
        link: Any = Link(self, "feeder")
        connection = Connection(link, SystemClock(), None, Guard(self))
        loop = ConsoleLoop(connection, StopRequest(), session, self._look, self._obey)
        try:
            loop.run()
        except SattrackError as error:
            self.ended.error = error
            self.trace("program", f"raised {error!r}")
        left = [ticket.request for ticket, _ in self._tickets.values() if not ticket.settled]
        if left and self.page[Word.DEPOSED] == 0:
            self.judge.violated("once", self, f"these requests never ended: {left}")

    def _operate(self, _: Any) -> None:
        """Have the operator press something, and something else a little later."""
        dice, chance = self._keys, self._keys.random()
        if chance < 0.35:
            self._slew()
        elif chance < 0.75:
            rate = dice.choice((-1.0, 1.0)) * dice.choice((0.1, 1.0, 4.0))
            axis = dice.choice(("ra_rate_deg_s", "dec_rate_deg_s"))
            for count in range(dice.randint(*JOGS)):
                self.at(self.now_s + count * JOG_EVERY_S, self._press, Jog(**{axis: rate}))
        else:
            self._press(Abort())
        self.at(self.now_s + dice.expovariate(1.0 / PAUSES_S), self._operate)

    def _slew(self) -> None:
        truth, site = self.mount.truth(), self.storm.facts.site
        ha = max(-80.0, min(80.0, truth.hour_angle_deg + self._keys.uniform(-AWAY_DEG, AWAY_DEG)))
        dec = max(-80.0, min(80.0, truth.dec_axis_deg + self._keys.uniform(-AWAY_DEG, AWAY_DEG)))
        ra = (mean_sidereal_deg(self.now_s, site.longitude_deg) - wrap180(ha)) % 360.0
        self._press(Slew(ra, dec))

    def _press(self, order: ConsoleMessage) -> None:
        self._orders.append(order)

    def _obey(self, now_utc_s: float) -> None:
        orders, self._orders = self._orders, []
        if now_utc_s >= self.storm.facts.plan.end_utc_s:
            orders = [Leave()]
        for order in orders:
            if not isinstance(order, Leave):
                self.trace("person", str(order))
            self.judge.told(self, isinstance(order, Slew | Jog))
            self._session.obey(order, now_utc_s)
            if isinstance(order, Abort):
                self.judge.stopping(self)

    def _look(self, now_utc_s: float) -> None:
        """Show the judge how the program stands; follow each request to its end."""
        del now_utc_s
        console = self._console
        if console.trouble != self._trouble:
            self._trouble = console.trouble
            self.trace("program", f"{console.trouble}: {console.refusal}")
            if self._trouble is not None:
                self.judge.stopping(self)
        for entry in console.asked:
            known = self._tickets.get(entry.number)
            if known is not None and known[1] in SETTLED and entry.ticket.state != known[1]:
                self.judge.violated("once", self, f"{entry.ticket.request} ended twice")
            self._tickets[entry.number] = (entry.ticket, entry.ticket.state)
        self.judge.period(self, console, "operator" if self._session.leaving else None)


WORLDS: dict[str, type[World]] = {"track": World, "rotctld": ServedWorld, "console": ConsoleWorld}
"""The world of each program."""

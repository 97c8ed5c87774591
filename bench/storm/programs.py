"""Storms over other programs than `track`.

`serve rotctld`: a client follows the satellite by positions, others send what they like. `serve antenna`: a
Field System sends elements, designates, offsets, stops and resets. `serve alpaca --rotctld`: several clients
of both protocols want one mount, and some send rubbish. The manual console: an operator slews, jogs and
stops, and leaves at the end of the pass.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.control.console import Console
from sattrack.control.manual_operation import ConsoleSession
from sattrack.core.angles import wrap180
from sattrack.core.clock import SystemClock
from sattrack.mount.model import AxesPosition, Slew, mean_sidereal_deg
from sattrack.mount.requests import SETTLED, Abort, FindHome, Park, PulseGuide, Sync
from sattrack.runtime.connection import Connection
from sattrack.runtime.console import ConsoleLoop
from sattrack.runtime.facts import encode_facts
from sattrack.runtime.guardian import Word
from sattrack.runtime.loop import StationLoop
from sattrack.runtime.system import StopRequest
from sattrack.servers.alpaca.protocol import (
    BiasOrder,
    FineOrder,
    FollowOrder,
    MoveOrder,
    NumberedOrder,
    TrackOrder,
)
from sattrack.servers.alpaca.serve import engine_maker
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.antenna.controller import AntennaStation
from sattrack.servers.antenna.equipment import Antenna
from sattrack.servers.antenna.led_mount import axis_range
from sattrack.servers.antenna.protocol import encode, to_ns
from sattrack.servers.antenna.trajectory import HaDec, SiteSky
from sattrack.servers.rotctld.answers import Client
from sattrack.servers.rotctld.rotator import RotatorStation
from sattrack.views.messages import Jog, Leave
from storm.night import NightWorld
from storm.world import RAISED, Guard, Link, World
from tle.elements import Elements
from tle.instants import DAY_S, Utc
from tle.propagator import Propagator
from tle.sources import write_elements

if TYPE_CHECKING:
    from sattrack.mount.requests import Ticket, TicketState
    from sattrack.runtime.control_arbiter import Observers
    from sattrack.servers.alpaca.protocol import Order
    from sattrack.views.messages import ConsoleMessage

SILENT_S = 10.0
"""After so long a silence a client that sends positions anew has a person at it."""
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
        self.at(self.now_s + 0.3, self._follow)
        self.serve(station)

    def serve(self, driver: Any) -> None:
        """Serve a station until the end of the pass."""
        self._first: str | None = None
        self._path: object = None
        self._sent_s = self._stopped_s = -math.inf
        self._led = True
        link: Any = Link(self, "feeder")
        connection = Connection(link, SystemClock(), None, Guard(self, link))
        loop = ServedLoop(
            connection, StopRequest(), driver, NoServer(), lambda words: self.trace("log", words)
        )
        loop.world = self
        try:
            loop.run()
        except RAISED as error:
            self.ended.error = error
            self.trace("program", f"raised {error!r}")

    def _follow(self, _: Any) -> None:
        """Have a client send where the satellite is, and another something else now and then."""
        self._send_position()
        dice = self._dice_of_clients
        if dice.random() < 0.2:
            self._clients[1].receive(dice.choice(JUNK))
        elif self.storm.seed % 2 and dice.random() < 0.05:
            line = dice.choice(WILD)
            self.trace("person", repr(line))
            self._clients[1].receive(line)
        self.at(self.now_s + EVERY_S, self._follow)

    def _send_position(self) -> None:
        """Have the client that follows send where the satellite is."""
        # The program reads it with the next period.
        if self.now_s - self._sent_s > SILENT_S - self.storm.facts.profile.period_s:
            self._stopped_s = -math.inf
        self._sent_s = self.now_s
        az_deg, alt_deg = self._place()
        self._clients[0].receive(f"P {az_deg:.3f} {alt_deg:.3f}\n".encode())

    def _place(self) -> tuple[float, float]:
        """Return azimuth and altitude of what that client follows."""
        seen = self._propagator.at(Utc(self.now_s))
        return float(seen.az_deg), float(seen.alt_deg)

    def answer(self, now_utc_s: float) -> None:
        """Answer what has come; another's stop holds for a client that only goes on sending positions."""
        for client in self._clients:
            client.answer(to_ns(now_utc_s), MOST_REQUESTS)
        rotator = self._clients[0].rotator
        if rotator.path is self._path:
            return
        self._path = rotator.path
        if self._path is None:
            # A position that something else had forestalled is dropped, and stops nothing.
            if self._led:
                self._stopped_s = now_utc_s
                self.judge.stopping(self)
        elif rotator.commander != 1 or self._stopped_s == -math.inf:
            self.judge.told(self, True)

    def look(self, driver: Any) -> None:
        """Show the judge how the program stands, once a period."""
        ended_by = "operator" if driver.stop is not None else driver.tripped
        self._first = self._first or ended_by
        self.judge.period(self, driver, self._first)


SENDS_FOR_S = 6.0
"""How long a client of rotctld sends positions, and is silent, in the mean."""
ORDERS_EVERY_S = 2.5
SWINGS = ((0.0, 60.0, 311.0), (25.0, 40.0, 173.0))
"""Of hour angle and declination, degrees, where a fight's positions swing about, how far, and in how long."""


MORE_ORDERS_FROM = 700_000
"""From this seed on, clients of Alpaca pulse, set rates and tracking, and send the mount to park and home."""


class TelescopeWorld(ServedWorld):
    """A world whose program serves one mount to clients of Alpaca and of rotctld at once."""

    def _feed(self, observers: Observers) -> None:
        del observers
        facts, stands = self.storm.facts, AxesPosition(*self.storm.stands)
        place = facts.site.place()
        profile = facts.profile
        if self.storm.seed >= MORE_ORDERS_FROM:
            profile = msgspec.structs.replace(profile, park=stands, home=stands)
        station = TelescopeStation(profile, facts.limits, place, "storm", engine_maker(facts.limits))
        rotator = station.share(SiteSky(place))
        self._station = station
        self._dice_of_clients = random.Random(f"clients {self.storm.seed}")
        self._propagator = Propagator(facts.target, place)
        self._clients = [Client(number, rotator) for number in (1, 2)]
        self._came: list[Any] = []
        self._open: dict[int, Any] = {}
        self._number = 0
        self._stopped_by: tuple[str | None, bool] = (None, False)
        self.at(self.now_s + 0.7, self._want)
        self.at(self.now_s + self._dice_of_clients.uniform(0.5, 20.0), self._send_for_a_while)
        self.serve(station)
        if self.page[Word.DEPOSED] == 0 and self.ended.error is None:
            self._take_answers()
            left = [str(order)[:40] for order in self._open.values()]
            if left:
                self.judge.violated("once", self, f"these orders were never answered: {left}")

    def _send_for_a_while(self, _: Any) -> None:
        """Have a client of rotctld follow the satellite for a while, and again after a silence."""
        dice = self._dice_of_clients
        count = 1 + int(dice.expovariate(1.0 / SENDS_FOR_S) / EVERY_S)
        for k in range(count):
            self.at(self.now_s + k * EVERY_S, self._send)
        self.at(self.now_s + count * EVERY_S + dice.expovariate(1.0 / SENDS_FOR_S), self._send_for_a_while)

    def _send(self, _: Any) -> None:
        self._send_position()
        if self._dice_of_clients.random() < 0.2:
            self._clients[1].receive(self._dice_of_clients.choice(JUNK))

    def _want(self, _: Any) -> None:
        """Have a client of Alpaca want something."""
        dice = self._dice_of_clients
        chance = dice.random()
        if self.is_synced and chance > 0.95:
            self._came.append(sync_near(self, dice))
        elif chance < 0.25:
            self._came.append(slew_near(self, dice))
        elif chance < 0.5:
            axis, rate = dice.randrange(2), dice.choice((-1.0, 1.0)) * dice.choice((0.1, 1.0, 3.0))
            self._came.append(MoveOrder(axis, rate))
            self.at(self.now_s + dice.uniform(0.2, 4.0), self._came.append, MoveOrder(axis, 0.0))
        elif chance < 0.7:
            self._came.append(FollowOrder(msgspec.Raw(encode_facts(self.storm.facts))))
        elif chance < 0.75:
            facts = self.storm.facts
            bad = msgspec.structs.replace(facts, elements=bad_elements(facts.target, dice))
            told = dice.choice((encode_facts(bad), encode_facts(bad), b'{"elements": null}', b"["))
            self._came.append(FollowOrder(msgspec.Raw(told)))
        elif chance < 0.8:
            self._came.append(BiasOrder(along_s=dice.uniform(-0.5, 0.5)))
        elif chance < 0.9 and self.storm.seed >= MORE_ORDERS_FROM:
            self._came.append(self._other_order(dice))
        else:
            self._came.append(Abort())
        self.at(self.now_s + dice.expovariate(1.0 / ORDERS_EVERY_S), self._want)

    def _other_order(self, dice: random.Random) -> Order:
        chance, fine = dice.random(), (None, 0.0, -0.004, 0.003)
        if chance < 0.35:
            return PulseGuide(dice.randrange(-3000, 3001), dice.choice((0, dice.randrange(-3000, 3001))))
        if chance < 0.6:
            return FineOrder(dice.choice(fine), dice.choice(fine))
        if chance < 0.85:
            return TrackOrder(dice.random() < 0.5)
        return Park() if chance < 0.93 else FindHome()

    def answer(self, now_utc_s: float) -> None:
        """Carry out orders, answer rotctld's clients, and see to it that each order is answered once."""
        ServedWorld.answer(self, now_utc_s)
        came, self._came = self._came, []
        for order in came:
            self._number += 1
            self.trace("person", f"{self._number}: {str(order)[:70]}")
            self._open[self._number] = order
            self.judge.told(self, not isinstance(order, Abort | BiasOrder) and order != MoveOrder(0, 0.0))
            self._station.obey(NumberedOrder(self._number, order), now_utc_s)
            if isinstance(order, Abort):
                self._stopped_s = now_utc_s
                self.judge.stopping(self)
        self._take_answers()

    def _take_answers(self) -> None:
        ready, self._station.answers.ready = self._station.answers.ready, []
        for one in ready:
            if self._open.pop(one.number, None) is None:
                self.judge.violated("once", self, f"order {one.number} was answered twice")

    def look(self, driver: Any) -> None:
        """Show the judge how the program stands, once a period."""
        del driver
        station = self._station
        for line in station.log_lines:
            self.trace("log", line)
        station.log_lines.clear()
        self._led = station._path is not None
        ending = station._ending is not None
        stopped_by = (station.tripped or station.console.trouble, ending)
        if stopped_by != self._stopped_by:
            self._stopped_by = stopped_by
            self.trace("program", f"stopped by {stopped_by[0]}" + ", ending" * ending)
            if any(stopped_by):
                self.judge.stopping(self)
        self.judge.period(self, station, "operator" if ending else None)


class FightWorld(TelescopeWorld):
    """The same for hours: one client of rotctld streams positions, one of Alpaca wants what it wants.

    The positions swing through the sky, now and then beyond what the mount may reach.
    """

    positions = 0

    @property
    def orders(self) -> int:
        return self._number

    def _place(self) -> tuple[float, float]:
        self.positions += 1
        since_s = self.now_s - self.storm.begin_s
        ha, dec = (middle + wide * math.sin(math.tau * since_s / every_s) for middle, wide, every_s in SWINGS)
        place = SiteSky(self.storm.facts.site.place()).horizontal(HaDec(ha, dec), self.now_s)
        return place.az_deg, place.el_deg


class AntennaWorld(ServedWorld):
    """A world whose program is an antenna's controller, with a Field System as its client."""

    def _feed(self, observers: Observers) -> None:
        del observers
        facts = self.storm.facts
        sky = SiteSky(facts.site.place())
        antenna = Antenna(sky, "hadec", axis_range(facts.profile, "hadec"))
        station = AntennaStation(antenna, facts.profile, facts.limits)
        self._station, self._clients = station, []
        self._dice_of_clients = random.Random(f"clients {self.storm.seed}")
        self._came: list[bytes] = []
        self._was_tripped: str | None = None
        self.at(self.now_s + 0.5, self._ask_for_satellite, False)
        self.at(self.now_s + 4.0, self._say)
        self.serve(station)

    def _ask_for_satellite(self, bad: bool) -> None:
        target = self.storm.facts.target
        assert isinstance(target, Elements)
        if bad:
            target = bad_elements(target, self._dice_of_clients)
        lines = write_elements([target], "tle").splitlines()[-2:]
        number = target.catalog_number
        said = [f"TLE {n} {number} {line}" for n, line in enumerate(lines, 1)]
        self._came += [encode(one) for one in (*said, f"SAT {number}")]

    def _say(self, _: Any) -> None:
        """Have the Field System, or who took its place, send something."""
        dice, (ha, dec) = self._dice_of_clients, self.looks()
        chance = dice.random()
        if chance < 0.25:
            self._ask_for_satellite(dice.random() < 0.3)
        elif chance < 0.45:
            first = wrap180(ha + dice.uniform(-AWAY_DEG, AWAY_DEG))
            second = max(-80.0, min(80.0, dec + dice.uniform(-AWAY_DEG, AWAY_DEG)))
            self._came.append(encode(f"TD {first:.4f} {second:.4f} {dice.uniform(-1.0, 1.0):.4f}"))
        elif chance < 0.7:
            self._came.append(encode(f"SATOFF {dice.uniform(-0.5, 0.5):.3f} {dice.uniform(-0.3, 0.3):.4f}"))
        elif chance < 0.8:
            self._came.append(encode(dice.choice(("STOP", "RESET"))))
        elif chance < 0.9:
            self._came.append(encode(dice.choice(("PS", "STATUS", "TD nan 1e99", "TIME 1 2.0"))))
        else:
            self._came.append(dice.choice((b"\xff\x00STOP", b"PS", b"\r\n\r\n", b"TD 1" * 200)))
        self.at(self.now_s + dice.expovariate(1.0 / ORDERS_EVERY_S), self._say)

    def answer(self, now_utc_s: float) -> None:
        """Give the controller what has come; a new trajectory sets the mount going, and its end stops it."""
        came, self._came = self._came, []
        for data in came:
            response, _ = self._station.receive_command(data, now_utc_s)
            self.trace("person", f"{data[:60]!r} -> {response[:60]!r}")
            path = self._station.controller.path
            if path is not self._path:
                self._path = path
                self.judge.told(self, path is not None)
                if path is None:
                    self.judge.stopping(self)

    def look(self, driver: Any) -> None:
        """Show the judge how the program stands, once a period."""
        if driver.tripped != self._was_tripped:
            self._was_tripped = driver.tripped
            self.trace("program", f"stopped by {driver.tripped}")
            if driver.tripped is not None:
                self.judge.stopping(self)
        self.judge.period(self, driver, "operator" if driver.stop is not None else None)


def bad_elements(target: Any, dice: random.Random) -> Elements:
    """Return elements of which nothing good comes: an orbit that is over, below the ground, or far away."""
    changes: tuple[dict[str, Any], ...] = (
        {"eccentricity": 0.95},
        {"bstar_per_earth_radius": 0.9},
        {"epoch": target.epoch.plus(-3000.0 * DAY_S)},
        {"mean_motion_rev_day": 0.01},
        {"mean_motion_rev_day": 17.9},
    )
    return replace(target, **dice.choice(changes))


def slew_near(world: World, dice: random.Random) -> Slew:
    """Return a slew to somewhere near the place of the axes."""
    (ha, dec), site = world.looks(), world.storm.facts.site
    ha = max(-80.0, min(80.0, ha + dice.uniform(-AWAY_DEG, AWAY_DEG)))
    dec = max(-80.0, min(80.0, dec + dice.uniform(-AWAY_DEG, AWAY_DEG)))
    ra = (mean_sidereal_deg(world.now_s, site.longitude_deg) - wrap180(ha)) % 360.0
    return Slew(ra, dec)


def sync_near(world: World, dice: random.Random) -> Sync:
    """Return a sync to about where the telescope looks."""
    (ha, dec), site = world.looks(), world.storm.facts.site
    off_deg = dice.uniform(-MOST_SYNCED_DEG, MOST_SYNCED_DEG)
    world.judge.synced(abs(off_deg))
    ra = (mean_sidereal_deg(world.now_s, site.longitude_deg) - ha + off_deg) % 360.0
    return Sync(ra, max(-85.0, min(85.0, dec)))


MOST_SYNCED_DEG = 0.5
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
        connection = Connection(link, SystemClock(), None, Guard(self, link))
        loop = ConsoleLoop(connection, StopRequest(), session, self._look, self._obey)
        try:
            loop.run()
        except RAISED as error:
            self.ended.error = error
            self.trace("program", f"raised {error!r}")
        left = [ticket.request for ticket, _ in self._tickets.values() if not ticket.settled]
        if left and self.page[Word.DEPOSED] == 0:
            self.judge.violated("once", self, f"these requests never ended: {left}")

    def _operate(self, _: Any) -> None:
        """Have the operator press something, and something else a little later."""
        dice, chance = self._keys, self._keys.random()
        if self.is_synced and chance > 0.95:
            self._press(sync_near(self, dice))
        elif chance < 0.35:
            self._press(slew_near(self, dice))
        elif chance < 0.75:
            rate = dice.choice((-1.0, 1.0)) * dice.choice((0.1, 1.0, 4.0))
            axis = dice.choice(("ra_rate_deg_s", "dec_rate_deg_s"))
            for count in range(dice.randint(*JOGS)):
                self.at(self.now_s + count * JOG_EVERY_S, self._press, Jog(**{axis: rate}))
        else:
            self._press(Abort())
        self.at(self.now_s + dice.expovariate(1.0 / PAUSES_S), self._operate)

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


WORLDS: dict[str, type[World]] = {
    "track": World,
    "rotctld": ServedWorld,
    "console": ConsoleWorld,
    "alpaca": TelescopeWorld,
    "antenna": AntennaWorld,
    "fight": FightWorld,
    "night": NightWorld,
}
"""The world of each program."""

"""The feeding process of `sattrack serve alpaca`: its loop, and its channel to the process that serves HTTP.

Clients of rotctld, where they are served beside others, come to this process: their positions count for the
instant at which they arrive.

At most one order begins in a period, as checking a slew's path may take milliseconds; a stop never waits, and
cancels the earlier orders that have not begun. States that the HTTP process is too slow for are left out;
answers are not. That process gets its task as one JSON line: the mount, the clients that may connect, and the
satellites for the custom actions.
"""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import msgspec

from sattrack.core.channel import Channel, see_off, start_process
from sattrack.core.clock import decode_utc, encode_utc
from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.requests import Abort
from sattrack.runtime.callers import CallerLimits
from sattrack.runtime.facts import build_engine, decode_facts
from sattrack.runtime.loop import StationLoop
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.protocol import (
    Answered,
    BiasOrder,
    Fault,
    LogMessage,
    Number,
    NumberedOrder,
    decode_order,
    encode,
)
from sattrack.servers.alpaca.telescope import Abilities
from sattrack.servers.antenna.protocol import to_ns
from sattrack.settings import SiteSettings
from tle.elements import Elements
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable, Sequence

    from sattrack.control.engine import Engine
    from sattrack.runtime.facts import RunFacts
    from sattrack.servers.alpaca.protocol import Passes, TelescopeState, TrackSatellite
    from sattrack.servers.alpaca.station import TelescopeStation
    from sattrack.servers.rotctld.serve import RotctldServer
    from tle.passes import Pass

PORT = 32227
"""UDP port of discovery."""
MOST_LOGGED = 5
"""Lines of the log in one tick; more are counted."""
LOOPBACK, LOOPBACK_BROADCAST, ANY = "127.0.0.1", "127.255.255.255", "0.0.0.0"
NO_ELEMENTS = "no elements: give --elements FILE to `sattrack serve alpaca`, or set elements in sattrack.toml"
READY = "ready"
"""The first message of the HTTP process."""
LONGEST_LINE = 1 << 22
START_WITHIN_S = 30.0
END_WITHIN_S = 3.0
REMEMBERED_LINES = 20
PAUSE_FACTOR = 9.0
"""Orders take at most a tenth of the feeding process' time, however many wait."""


@dataclass(slots=True)
class AlpacaLoop(StationLoop):
    """Serves one mount to Alpaca's clients until `stop` is set and the mount is seen at rest."""

    driver: TelescopeStation
    server: AlpacaHttpProcess
    rotctld: RotctldServer | None = None

    def readers(self) -> list[Any]:
        """See RealtimeLoop."""
        return self.server.readers() + ([] if self.rotctld is None else self.rotctld.readers())

    def writers(self) -> list[Any]:
        """See RealtimeLoop."""
        return self.server.writers() + ([] if self.rotctld is None else self.rotctld.writers())

    def flush(self) -> None:
        """See RealtimeLoop."""
        self.server.flush()
        if self.rotctld is not None:
            self.rotctld.flush()

    def tell(self, words: str) -> None:
        """See StationLoop."""
        self.log(words)

    def serve(self, ready: list[Any]) -> None:
        """Take orders, and begin those that may begin now."""
        if self.server.line in ready:
            self.server.take()
        self._begin_orders()
        if self.rotctld is not None:
            self.rotctld.serve(ready, lambda: to_ns(self.connection.now_utc_s()))

    def obey(self, now_utc_s: float) -> None:
        """Let another order begin; end where the HTTP process has ended."""
        if self.rotctld is not None:
            self.rotctld.tend(to_ns(now_utc_s))
        if self.server.ended and not self.driver.finished:
            raise SattrackError("the HTTP server's process is gone; the mount is being stopped")
        self.server.begin_period(time.monotonic())

    def heard(self) -> None:
        """Push a new status at once, so that clients read it while it is new."""
        self._push()

    def report(self) -> None:
        """Push the mount's state and the answers that are due, and log what has changed."""
        self._push()
        self._begin_orders()
        lines = [*self.driver.log_lines, *self.server.log_lines]
        self.driver.log_lines.clear()
        self.server.log_lines.clear()
        for line in lines[:MOST_LOGGED]:
            self.tell(line)
        if len(lines) > MOST_LOGGED:
            self.tell(f"and {len(lines) - MOST_LOGGED} lines more")
        for line in [] if self.rotctld is None else self.rotctld.report():
            self.tell(f"rotctld: {line}")
        self.report_mount("satellite", "AbortSlew")

    def _begin_orders(self) -> None:
        while True:
            order, cancelled = self.server.next_order()
            self.driver.answers.ready += cancelled
            if order is None:
                if cancelled:
                    self._push()
                return
            began_s = time.monotonic()
            self.driver.obey(order, self.connection.now_utc_s())
            self._push()
            self.server.took(time.monotonic() - began_s, time.monotonic())

    def _push(self) -> None:
        answers = self.driver.answers
        ready, answers.ready = answers.ready, []
        self.server.push(self.driver.state(self.connection.now_utc_s()), ready)


def engine_maker(limits: SafetyLimits) -> Callable[[msgspec.Raw, float], Engine]:
    """Return the function that makes an engine of the facts of a run, with this process' own limits."""
    # The HTTP process, which imports this module too, makes no engines.

    def make(raw: msgspec.Raw, now_utc_s: float) -> Engine:
        try:
            facts = decode_facts(raw)
        except msgspec.MsgspecError as error:
            raise ValueError(f"these are not the facts of a run: {error}") from error
        return build_engine(msgspec.structs.replace(facts, limits=limits, started_utc_s=now_utc_s))

    return make


def discovery_sockets(host: str) -> tuple[Sequence[socket.socket], str | None]:
    """Return the sockets of discovery, or why there are none.

    A server on loopback answers there alone, where requests come by its own broadcast address.
    """
    inside = host.startswith("127.") or host == "localhost"
    opened: list[socket.socket] = []
    for address in (LOOPBACK, LOOPBACK_BROADCAST) if inside else (ANY,):
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.append(one)
        try:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            one.bind((address, PORT))
        except OSError as error:
            for each in opened:
                each.close()
            reason = f"discovery is not answered: UDP port {PORT} on {address} is not available"
            return (), f"{reason} ({error.strerror})"
        one.setblocking(False)
    return opened, None


@dataclass(slots=True)
class AlpacaHttpProcess:
    """The HTTP process and the channel to it; whoever logs the lines in `log_lines` removes them."""

    line: Channel
    process: subprocess.Popen[bytes]
    log_lines: deque[str] = field(default_factory=lambda: deque(maxlen=REMEMBERED_LINES))
    _orders: deque[NumberedOrder] = field(default_factory=deque)
    _began_one: bool = False
    _next_s: float = 0.0
    """Before this instant of the monotonic clock no other order begins."""

    @property
    def ended(self) -> bool:
        """Whether the other process is gone."""
        return self.line.ended

    def readers(self) -> list[Any]:
        """See StationLoop."""
        return [] if self.ended else [self.line]

    def writers(self) -> list[Any]:
        """See StationLoop."""
        return [self.line] if self.line.waiting and not self.ended else []

    def flush(self) -> None:
        """See StationLoop."""
        self.line.flush()

    def push(self, state: TelescopeState, answers: list[Answered]) -> None:
        """Send a state, unless the last one still waits, and answers after it."""
        if answers or not self.line.waiting:
            self.line.send(encode(state) + b"".join(encode(answer) for answer in answers))

    def take(self) -> None:
        """Read the lines that have come."""
        self._take_lines(self.line.lines())

    def next_order(self) -> tuple[NumberedOrder | None, list[Answered]]:
        """Return the order to begin now, if any, and answers to those that a stop has cancelled."""
        for index, asked in enumerate(self._orders):
            if isinstance(asked.order, Abort):
                reason = "AbortSlew came before it had begun"
                cancelled = [
                    Answered(self._orders.popleft().number, int(Number.CANCELLED), reason)
                    for _ in range(index)
                ]
                return self._orders.popleft(), cancelled
        if self._began_one or not self._orders:
            return None, []
        asked = self._orders.popleft()
        self._began_one = not isinstance(asked.order, BiasOrder)
        return asked, []

    def begin_period(self, now_s: float) -> None:
        """Let one more order begin, unless the last one took so long that datagrams come first."""
        self._began_one = self._began_one and now_s < self._next_s

    def took(self, seconds: float, now_s: float) -> None:
        """Note how long an order took: searching for a path takes some tenths of a second."""
        self._next_s = now_s + PAUSE_FACTOR * seconds

    def close(self) -> None:
        """End the other process."""
        self.line.close()
        see_off(self.process, END_WITHIN_S)

    def _take_lines(self, lines: Sequence[bytes]) -> None:
        for line in lines:
            try:
                message = decode_order(line)
            except msgspec.MsgspecError as error:
                self.log_lines.append(f"a line from the HTTP process was not understood: {error}")
                continue
            if isinstance(message, LogMessage):
                self.log_lines.append(message.text)
            else:
                self._orders.append(message)


def start_http_process(task: AlpacaTask) -> AlpacaHttpProcess:
    """Start the process that serves HTTP; raises SattrackError where it does not come up."""
    ours, theirs = socket.socketpair()
    with theirs:
        # A Ctrl-C is for the feeding process, which ends this one when the mount stands.
        ports = (one for one in (task.listener, task.lx200, task.indi, task.stellarium) if one is not None)
        serial = () if task.serial is None else (task.serial.number,)
        inherits = (theirs.fileno(), *ports, *serial, *task.discovery)
        process = start_process("sattrack.servers.alpaca.process", str(theirs.fileno()), inherits=inherits)
    with contextlib.suppress(OSError):
        ours.sendall(encode_task(task))
    started = AlpacaHttpProcess(Channel(ours.detach(), longest=LONGEST_LINE), process)
    started._take_lines(started.line.first(START_WITHIN_S))
    if READY not in started.log_lines:
        started.close()
        raise SattrackError("the HTTP server did not start; its own messages are above")
    started.log_lines.remove(READY)
    return started


SERIAL_FRAMING = "8N1"


class SerialEnd(NamedTuple):
    """A serial line that is open: its descriptor, and how it is opened again."""

    number: int
    device: str
    baud: int

    def reopened(self) -> int | None:
        """Open it again; return the new descriptor, None where it is not there."""
        from sattrack.servers.antenna.serve import SerialChannel

        try:
            line = SerialChannel(self.device, self.baud, SERIAL_FRAMING)
        except SattrackError:
            return None
        with contextlib.closing(line):
            return os.dup(line.fileno())


class AlpacaTask(msgspec.Struct, frozen=True):
    """The task of the HTTP process, sent at its start; descriptors are inherited."""

    listener: int | None
    """The port of HTTP; with None Alpaca is not served."""
    lx200: int | None
    indi: int | None
    serial: SerialEnd | None
    """A serial line on which LX200 is served too."""
    stellarium: int | None
    discovery: tuple[int, ...]
    port: int
    version: str
    host: str
    callers: int
    idle_s: float
    requests_per_s: float
    allowed: tuple[str, ...] | None
    satellites: Satellites
    abilities: Abilities
    clock: ClockNumbers | None = None
    names: tuple[str, ...] = ()
    """Names by which clients call this computer, beside its own."""

    def limits(self) -> CallerLimits:
        """Return the limits of its clients."""
        allowed = None if self.allowed is None else tuple(ipaddress.ip_network(one) for one in self.allowed)
        return CallerLimits(self.callers, self.idle_s, self.requests_per_s, allowed)


def encode_task(task: AlpacaTask) -> bytes:
    """Return a task as one JSON line."""
    return msgspec.json.encode(task, enc_hook=encode_utc) + b"\n"


def decode_task(line: bytes) -> AlpacaTask:
    """Return the task of one JSON line; raises msgspec.MsgspecError."""
    return msgspec.json.decode(line, type=AlpacaTask, dec_hook=decode_utc)


class ClockNumbers(msgspec.Struct, frozen=True):
    """A simulated clock's three numbers."""

    start_utc_s: float
    anchor_s: float
    speed: float


class Satellites(msgspec.Struct, frozen=True):
    """The satellites of the custom actions, the site, and the mount."""

    elements: list[Elements]
    site: SiteSettings
    profile: MountProfile
    limits: SafetyLimits
    min_alt_deg: float
    refraction: Literal["auto", "on", "off"]
    mount: str

    def prepare(self) -> None:
        """Import what computes passes and facts, and read its tables, before a client waits for it."""
        if not self.elements:
            return
        from sattrack.runtime import facts
        from sattrack.runtime.facts import prepare
        from tle.propagator import Propagator

        del facts, prepare
        if self.profile.through_pole:
            from sattrack.planning import path

            del path
        with contextlib.suppress(TleError):
            Propagator(self.elements[0], self.site.place())

    def passes(self, asked: Passes, now_utc_s: float) -> list[dict[str, Any]]:
        """Return a satellite's coming passes, fields named as by `sattrack passes --json`. Raises Fault."""
        from tle.passes import find_passes
        from tle.propagator import Propagator

        elements = self._find(asked.satellite)
        floor_deg = self.min_alt_deg if asked.min_alt_deg is None else asked.min_alt_deg
        try:
            propagator = Propagator(elements, self.site.place())
            found = find_passes(propagator, Utc(now_utc_s), asked.hours, floor_deg)
        except TleError as error:
            raise Fault(Number.INVALID_OPERATION, str(error)) from error
        return [_row(elements, seen) for seen in found]

    def facts_of(self, text: str, now_utc_s: float) -> RunFacts:
        """Return the facts of a run of the one satellite that a text of elements is of. Raises Fault."""
        from sattrack.servers.alpaca.protocol import TrackSatellite
        from tle.sources import parse_elements

        found = parse_elements(text)
        good = [one for one in found if isinstance(one, Elements)]
        if len(good) != 1:
            why = next(
                (str(one) for one in found if not isinstance(one, Elements)), "one satellite's are needed"
            )
            raise Fault(Number.INVALID_VALUE, f"the elements: {why}")
        alone = msgspec.structs.replace(self, elements=good)
        return alone.facts(TrackSatellite(str(good[0].catalog_number)), now_utc_s)

    def facts(self, asked: TrackSatellite, now_utc_s: float) -> RunFacts:
        """Return the facts of a run: the pass in progress, else the next. Raises Fault."""
        from sattrack.runtime.facts import RunFacts, choose_pass, plan_for, with_detours
        from tle.refraction import Refraction

        elements, site, now = self._find(asked.satellite), self.site.place(), Utc(now_utc_s)
        floor_deg = self.min_alt_deg if asked.min_alt_deg is None else asked.min_alt_deg
        lowest_deg = self.limits.floor_altitude_deg
        if floor_deg < lowest_deg:
            message = f"min_alt_deg is {floor_deg:g}; the mount is kept above {lowest_deg:g}"
            raise Fault(Number.INVALID_VALUE, message)
        air = Refraction.standard(site.height_m)
        try:
            seen = choose_pass(elements, site, now, floor_deg)
            return with_detours(
                RunFacts(
                    elements=elements,
                    site=self.site,
                    refraction=self.refraction,
                    pressure_hpa=air.pressure_hpa,
                    temperature_c=air.temperature_c,
                    plan=plan_for(seen, now, elements),
                    culminate_utc_s=float(seen.culminate_utc.unix_s),
                    max_alt_deg=float(seen.max_alt_deg),
                    profile=self.profile,
                    limits=self.limits,
                    bias_along_s=0.0,
                    bias_cross_deg=0.0,
                    mount_name=self.mount,
                    started_utc_s=now_utc_s,
                )
            )
        except (SattrackError, TleError) as error:
            raise Fault(Number.INVALID_OPERATION, str(error)) from error

    def _find(self, name: str) -> Elements:
        from tle.sources import find

        if not self.elements:
            raise Fault(Number.INVALID_OPERATION, NO_ELEMENTS)
        try:
            return find(self.elements, name)
        except TleError as error:
            raise Fault(Number.INVALID_VALUE, str(error)) from error


def run_summary(facts: RunFacts) -> dict[str, Any]:
    """Return the answer to a client whose run begins."""
    return {
        "name": facts.target.name,
        "catalog_number": facts.target.catalog_number,
        "from_utc": Utc(facts.plan.start_utc_s).isoformat("milliseconds"),
        "to_utc": Utc(facts.plan.end_utc_s).isoformat("milliseconds"),
        "culminate_utc": Utc(facts.culminate_utc_s).isoformat("milliseconds"),
        "max_alt_deg": facts.max_alt_deg,
    }


def _row(elements: Elements, seen: Pass) -> dict[str, Any]:
    def text(instant: Utc | None) -> str | None:
        return None if instant is None else instant.isoformat("milliseconds")

    return {
        "name": elements.name,
        "catalog_number": elements.catalog_number,
        "rise_utc": text(seen.rise_utc),
        "culminate_utc": text(seen.culminate_utc),
        "set_utc": text(seen.set_utc),
        "max_alt_deg": float(seen.max_alt_deg),
    }

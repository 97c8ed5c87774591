"""The feeding process' end of the line to the process that Alpaca's clients talk to.

One order is obeyed a period at most, as judging a slew's path may take milliseconds; a stop never waits, and
cancels the orders that came before it and have not begun. States that the other end is too slow for are left
out; answers are not. The other process is given its task as one JSON line: the mount, whom to let in, and
the satellites for the custom actions, which need numpy only when the first is asked for.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from sattrack.core.channel import Channel, see_off, start_process
from sattrack.core.errors import SattrackError
from sattrack.core.utc_json import decode_utc, encode_utc
from sattrack.mount.model import MountProfile
from sattrack.runtime.callers import CallerLimits
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.device import Abilities
from sattrack.servers.alpaca.messages import (
    AbortOrder,
    Answered,
    BiasOrder,
    Fault,
    LogLine,
    Number,
    NumberedOrder,
    decode_order,
    encode,
)
from sattrack.settings import SiteSettings
from tle.elements import Elements
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Sequence

    from sattrack.runtime.facts import RunFacts
    from sattrack.servers.alpaca.messages import Passes, TelescopeState, TrackSatellite
    from tle.passes import Pass

NO_ELEMENTS = "no elements: give --elements FILE to `sattrack serve alpaca`, or set elements in sattrack.toml"
READY = "ready"
"""What that process says first."""
LONGEST_LINE = 1 << 22
START_WITHIN_S = 30.0
END_WITHIN_S = 3.0
REMEMBERED_WORDS = 20
PAUSE_FACTOR = 9.0
"""Orders take a tenth of the feeding process' time at most, however many wait."""


class Satellites(msgspec.Struct, frozen=True):
    """Whose passes there are, over which site, and for which mount."""

    elements: list[Elements]
    site: SiteSettings
    profile: MountProfile
    limits: SafetyLimits
    min_alt_deg: float
    refraction: Literal["auto", "on", "off"]
    mount: str

    def prepare(self) -> None:
        """Import what passes and facts are computed with, and read its tables: nobody waits for it then."""
        if not self.elements:
            return
        from sattrack.runtime import facts, prepare
        from tle.propagator import Propagator

        del facts, prepare
        if self.profile.through_pole:
            from sattrack.planning import keyhole

            del keyhole
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

    def facts(self, asked: TrackSatellite, now_utc_s: float) -> RunFacts:
        """Return the facts of a run: the pass in progress, else the next. Raises Fault."""
        from sattrack.runtime.facts import RunFacts, choose_pass, plan_for
        from sattrack.runtime.prepare import with_detours
        from tle.refraction import Refraction

        elements, site, now = self._find(asked.satellite), self.site.place(), Utc(now_utc_s)
        floor_deg = self.min_alt_deg if asked.min_alt_deg is None else asked.min_alt_deg
        lowest_deg = self.limits.floor_altitude_deg
        if floor_deg < lowest_deg:
            words = f"min_alt_deg is {floor_deg:g}; the mount is kept above {lowest_deg:g}"
            raise Fault(Number.INVALID_VALUE, words)
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


def run_told(facts: RunFacts) -> dict[str, Any]:
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
    def told(instant: Utc | None) -> str | None:
        return None if instant is None else instant.isoformat("milliseconds")

    return {
        "name": elements.name,
        "catalog_number": elements.catalog_number,
        "rise_utc": told(seen.rise_utc),
        "culminate_utc": told(seen.culminate_utc),
        "set_utc": told(seen.set_utc),
        "max_alt_deg": float(seen.max_alt_deg),
    }


class ClockNumbers(msgspec.Struct, frozen=True):
    """A simulated clock's three numbers."""

    start_utc_s: float
    anchor_s: float
    speed: float


class AlpacaTask(msgspec.Struct, frozen=True):
    """The task of this process, sent at its start; descriptors are inherited."""

    listener: int
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
        """Return what clients may take."""
        allowed = None if self.allowed is None else tuple(ipaddress.ip_network(one) for one in self.allowed)
        return CallerLimits(self.callers, self.idle_s, self.requests_per_s, allowed)


def encode_task(task: AlpacaTask) -> bytes:
    """Return a task as one JSON line."""
    return msgspec.json.encode(task, enc_hook=encode_utc) + b"\n"


def decode_task(line: bytes) -> AlpacaTask:
    """Return the task of one JSON line; raises msgspec.MsgspecError."""
    return msgspec.json.decode(line, type=AlpacaTask, dec_hook=decode_utc)


@dataclass(slots=True)
class AlpacaHttpProcess:
    """The line, and the process at its other end; whoever logs the lines in `words` removes them."""

    line: Channel
    process: subprocess.Popen[bytes]
    words: deque[str] = field(default_factory=lambda: deque(maxlen=REMEMBERED_WORDS))
    _orders: deque[NumberedOrder] = field(default_factory=deque)
    _obeyed: bool = False
    _next_s: float = 0.0
    """Before this instant of the monotonic clock no other order is obeyed."""

    @property
    def ended(self) -> bool:
        """Whether the other process is gone."""
        return self.line.ended

    def readers(self) -> list[Any]:
        """Return what to wait for."""
        return [] if self.ended else [self.line]

    def writers(self) -> list[Any]:
        """Return what to wait for to take more."""
        return [self.line] if self.line.waiting and not self.ended else []

    def flush(self) -> None:
        """Send what waits, as far as it can be sent now."""
        self.line.flush()

    def push(self, state: TelescopeState, answers: list[Answered]) -> None:
        """Send a state, unless the last one waits still, and answers after it."""
        if answers or not self.line.waiting:
            self.line.send(encode(state) + b"".join(encode(answer) for answer in answers))

    def take(self) -> None:
        """Read what has come."""
        self._take_lines(self.line.lines())

    def next_order(self) -> tuple[NumberedOrder | None, list[Answered]]:
        """Return the order to obey now, if any, and answers to those that a stop has made void."""
        for index, asked in enumerate(self._orders):
            if isinstance(asked.order, AbortOrder):
                void = [self._orders.popleft() for _ in range(index)]
                words = "AbortSlew came before it had begun"
                voided = [Answered(one.number, int(Number.CANCELLED), words) for one in void]
                return self._orders.popleft(), voided
        if self._obeyed or not self._orders:
            return None, []
        asked = self._orders.popleft()
        self._obeyed = not isinstance(asked.order, BiasOrder)
        return asked, []

    def begin_period(self, now_s: float) -> None:
        """Let one more order be obeyed, unless the last one took so long that datagrams come first."""
        self._obeyed = self._obeyed and now_s < self._next_s

    def took(self, seconds: float, now_s: float) -> None:
        """Note how long an order took: a path that must be searched for takes some tenths of a second."""
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
                self.words.append(f"a line from the HTTP process was not understood: {error}")
                continue
            if isinstance(message, LogLine):
                self.words.append(message.words)
            else:
                self._orders.append(message)


def open_door(task: AlpacaTask) -> AlpacaHttpProcess:
    """Start the process that clients talk to; raises SattrackError where it does not come up."""
    ours, theirs = socket.socketpair()
    with theirs:
        # A Ctrl-C is for the feeding process, which ends this one when the mount stands.
        inherits = (theirs.fileno(), task.listener, *task.discovery)
        process = start_process("sattrack.servers.alpaca.process", str(theirs.fileno()), inherits=inherits)
    with contextlib.suppress(OSError):
        ours.sendall(encode_task(task))
    door = AlpacaHttpProcess(Channel(ours.detach(), longest=LONGEST_LINE), process)
    door._take_lines(door.line.first(START_WITHIN_S))
    if READY not in door.words:
        door.close()
        raise SattrackError("the HTTP server did not start; its own words are above")
    door.words.remove(READY)
    return door

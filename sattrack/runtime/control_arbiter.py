"""What reaches a run from outside: who may command it, their messages, and observations.

One at a time has control, anybody may stop. The operator who started the run sends JSON lines on a channel;
its end stops the mount, as the operator with the stop key is gone, unless a message before has asked that the
run go on without. Observations come on the same channel, on standard input, or on a UDP port of loopback:
they are kept as they come, at most so many, and read a few a tick, so no burst disturbs the loop. A line that
is no observation is counted, and otherwise ignored.
"""

from __future__ import annotations

import math
import socket
import sys
from collections import deque
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.core.channel import LineReader
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.runtime.adsb import PREFIX, AdsbFeed
from sattrack.views.messages import (
    Arm,
    Disarm,
    Go,
    LeaveRunning,
    Message,
    ObservationMessage,
    Pause,
    Reported,
    SeenOffset,
    SessionMessage,
    SolvedField,
    StopNow,
    TakeControl,
    YieldControl,
    decode_observation,
    decode_said,
    is_observation,
)
from sattrack.views.run import SAME_PASS_S, STARTER, Armed, SessionView, Watcher

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sattrack.runtime.view_server import ViewServerLink

MOST_ARMED = 12
LONGEST_NAME = 24
NAMED = 8
"""So many of those who look on are named in a view, which has to stay small."""
MOST_COMPLAINTS = 10
ORDERS_A_TICK = 20
"""A change of an offset takes some tens of microseconds, of which a turn of the loop has few to spare."""


class ControlArbiter:
    """Takes everybody's messages to a run, and hands on those that the run must obey.

    `with_starter`: the operator who started the run sends messages, has control first, and gets it back once
    a client that took it has gone. `takes_others`: passes can be armed, to be followed after this one. A stop
    takes them back.
    """

    def __init__(self, with_starter: bool, takes_others: bool = False) -> None:
        self._with_starter, self._takes_others = with_starter, takes_others
        self._queue: list[Armed] = []
        self.changing = False
        """Whether the run is being ended for the next, by the client in control."""
        self.controller: int | None = STARTER if with_starter else None
        self.left_running = False
        self._names: dict[int, str] = {}
        self._message: str | None = None
        self.version = 0
        """Counts what changed of the view."""

    def came(self, number: int, name: str) -> None:
        """Add a client, or take its name."""
        self._names[number] = name
        self.version += 1

    def gone(self, number: int) -> None:
        """Remove a client; control that it had falls back, and the run goes on."""
        name = self._name(number)
        self._names.pop(number, None)
        if self.controller == number:
            self._fall_back()
            self._message = f"{name} had control, and has gone"
        self.version += 1

    def hear(self, number: int, message: Message | SessionMessage) -> Message | None:
        """Return the message if the run must obey it, None where it is about control or not permitted."""
        match message:
            case TakeControl():
                self._give(number)
            case YieldControl():
                if self.controller == number:
                    self._fall_back()
                    self._message = f"{self._name(number)} gave control up"
            case LeaveRunning():
                if number == STARTER:
                    self.left_running = True
                    self.controller = None if self.controller == STARTER else self.controller
                    self._message = "left running by whoever started it"
            case Arm() | Disarm():
                if number != self.controller:
                    return None
                self.version += 1
                if isinstance(message, Arm):
                    return self._arm(message)
                self._disarm(message)
                return None
            case StopNow():
                self._queue.clear()
                self.changing = False
                self._message = f"stopped from {self._name(number)}"
                self.version += 1
                return message
            case _:
                return self._obeyed(number, message)
        self.version += 1
        return None

    def view(self) -> SessionView:
        """Return what everybody may see."""
        named = [Watcher(number, name) for number, name in self._names.items()]
        # Whoever has control is always named.
        named.sort(key=lambda one: (one.number != self.controller, one.number))
        return SessionView(
            self.controller,
            tuple(named[:NAMED]),
            len(self._names),
            self.left_running,
            self._message,
            tuple(self._queue),
            self._takes_others,
        )

    def take_next(self) -> Armed | None:
        """Take the next pass from the queue."""
        self.changing = False
        if not self._queue:
            return None
        self.version += 1
        return self._queue.pop(0)

    def say(self, message: str) -> None:
        """Show everybody a message."""
        self._message = message
        self.version += 1

    def _obeyed(self, number: int, message: Message) -> Message | None:
        """Return a message of the client in control; who pauses the run is shown to everybody."""
        if number != self.controller:
            return None
        if isinstance(message, Pause | Go):
            did = "paused" if isinstance(message, Pause) else "set going"
            self._message = f"{did} from {self._name(number)}"
            self.version += 1
        return message

    def _arm(self, order: Arm) -> Message | None:
        armed = Armed(order.catalog_number, order.culminate_utc_s, order.name[:LONGEST_NAME])
        if not self._takes_others:
            self._message = "this run takes no other satellite"
            return None
        self._queue = [one for one in self._queue if not _same(one, armed)]
        if order.now:
            self._queue.insert(0, armed)
            self.changing = True
            self._message = f"going on to {armed.name or armed.catalog_number}"
            # It ends this run and nothing else: the queue stays.
            return StopNow()
        if len(self._queue) < MOST_ARMED:
            # Where this run is being ended for a pass, that one stays first.
            first = min(self.changing, len(self._queue))
            later = sorted([*self._queue[first:], armed], key=lambda one: one.culminate_utc_s)
            self._queue[first:] = later
            self._message = f"armed {armed.name or armed.catalog_number}"
        else:
            self._message = f"{MOST_ARMED} passes are armed already, which is all there is room for"
        return None

    def _disarm(self, order: Disarm) -> None:
        gone = Armed(order.catalog_number, order.culminate_utc_s, "")
        self._queue = [one for one in self._queue if not _same(one, gone)]

    def _fall_back(self) -> None:
        """Give control back to the starter, if it is there and has not lost it just now; else to nobody."""
        there = self._with_starter and not self.left_running and self.controller != STARTER
        self.controller = STARTER if there else None

    def _give(self, number: int) -> None:
        if self.controller == number:
            return
        before = None if self.controller is None else self._name(self.controller)
        self.controller = number
        taken = "took control" if before is None else f"took control from {before}"
        self._message = f"{self._name(number)} {taken}"

    def _name(self, number: int) -> str:
        return "where it was started" if number == STARTER else self._names.get(number, f"watcher {number}")


def _same(one: Armed, other: Armed) -> bool:
    """Return whether two name the same pass."""
    near = abs(one.culminate_utc_s - other.culminate_utc_s) < SAME_PASS_S
    return one.catalog_number == other.catalog_number and near


class StdinInbox:
    """Messages from standard input; other lines are kept in `ignored`.

    Observations go to `observers`, to be used when there is time.
    """

    def __init__(self, observers: Observers, descriptor: int | None = None) -> None:
        self._reader = LineReader(sys.stdin.fileno() if descriptor is None else descriptor)
        self._observers = observers
        self._ended = False
        self.stops_at_end = True
        """Whether the end of the channel is a stop."""
        self._waiting: deque[Message | SessionMessage] = deque()
        self.malformed = 0
        self.ignored: list[str] = []

    @property
    def ended(self) -> bool:
        """Whether the channel has come to its end."""
        return self._ended

    def messages(self) -> Sequence[Message | SessionMessage]:
        """Return what has come, without waiting; a stop once the channel has ended."""
        if self._ended:
            return ()
        for line in self._reader.lines():
            if is_observation(line):
                self._observers.put(line)
                continue
            try:
                self._waiting.append(decode_said(line))
            except msgspec.MsgspecError as error:
                self.malformed += 1
                if len(self.ignored) < MOST_COMPLAINTS:
                    self.ignored.append(f"a control line was ignored: {error}")
        self._ended = self._reader.ended
        messages = [self._waiting.popleft() for _ in range(min(ORDERS_A_TICK, len(self._waiting)))]
        if (self._ended and self.stops_at_end) or any(isinstance(one, StopNow) for one in self._waiting):
            # Nothing that still waits may hold up a stop.
            self._waiting.clear()
            messages.append(StopNow())
        return messages


class SessionInbox:
    """Messages that the run must obey, from all clients. `stdin` None: there is no starter's channel.

    Observations need no control, only the same user: they go to `observers`, to be used when there is time.
    """

    def __init__(
        self,
        arbiter: ControlArbiter,
        stdin: StdinInbox | None,
        views: ViewServerLink | None,
        observers: Observers | None = None,
    ) -> None:
        self._arbiter, self._stdin, self._views, self._observers = arbiter, stdin, views, observers
        self._strange = 0

    @property
    def malformed(self) -> int:
        """How many lines were none."""
        return self._strange + (0 if self._stdin is None else self._stdin.malformed)

    @property
    def ended(self) -> bool:
        """Whether the starter's channel has ended."""
        return self._stdin is None or self._stdin.ended

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting."""
        obeyed: list[Message] = []
        if self._stdin is not None:
            for message in self._stdin.messages():
                obeyed += self._obeyed_of(STARTER, message)
            self._stdin.stops_at_end = not self._arbiter.left_running
        for event in () if self._views is None else self._views.heard():
            if event.what == "came":
                self._arbiter.came(event.number, event.text)
            elif event.what == "gone":
                self._arbiter.gone(event.number)
            else:
                obeyed += self._read(event.number, event.text)
        return obeyed

    def _read(self, number: int, line: str) -> list[Message]:
        if self._observers is not None and is_observation(line.encode()):
            self._observers.put(line.encode())
            return []
        try:
            message = decode_said(line)
        except msgspec.MsgspecError:
            self._strange += 1
            return []
        # Observations take longer than a turn has; they come by a channel of their own.
        return (
            []
            if isinstance(message, ObservationMessage | SeenOffset | SolvedField)
            else self._obeyed_of(number, message)
        )

    def _obeyed_of(self, number: int, message: object) -> list[Message]:
        obeyed = self._arbiter.hear(number, message)  # type: ignore[arg-type]
        return [] if obeyed is None else [obeyed]


A_TICK = 2
"""Observations used a tick: an estimate takes under a millisecond."""
MOST_MALFORMED_A_TICK = 100
QUEUED_MOST = 2000
DATAGRAMS_A_TICK = 64
DATAGRAM_BYTES = 8192
RECEIVE_BUFFER_BYTES = 65536
LOOPBACK = "127.0.0.1"
WRITE = "write udp:PORT or stdin"


class Source(Protocol):
    """Where lines come from."""

    def lines(self) -> Iterable[bytes]:
        """Return what has come, without waiting."""

    def close(self) -> None:
        """Let go of what is held."""


class Observers:
    """Lines from some sources in one queue, and the observations in them."""

    def __init__(self, sources: Iterable[Source] = (), most: float = QUEUED_MOST) -> None:
        """Take lines from sources, and by `put`; of what waits, at most so many are kept."""
        self._sources, self._most = tuple(sources), most
        self._queue: deque[bytes] = deque()
        self.malformed = 0
        self.dropped = 0
        """Lines that came when the queue was full."""
        self.complaint: str | None = None
        """What was wrong with the last line that was no observation."""

    def put(self, line: bytes) -> None:
        """Take one line; empty ones are nothing."""
        if not line.strip():
            return
        if len(self._queue) >= self._most:
            self.dropped += 1
            return
        self._queue.append(line)

    def observations(self, most: int = A_TICK) -> Sequence[Reported]:
        """Return the oldest observations that have come and were not returned yet, without waiting."""
        for source in self._sources:
            for line in source.lines():
                self.put(line)
        found: list[Reported] = []
        malformed = 0
        while self._queue and len(found) < most and malformed < MOST_MALFORMED_A_TICK:
            try:
                found.append(decode_observation(self._queue.popleft()))
            except msgspec.MsgspecError as error:
                malformed += 1
                self.complaint = str(error)
        self.malformed += malformed
        return found

    def everything(self) -> list[Reported]:
        """Return all observations that wait."""
        found: list[Reported] = []
        while self._queue:
            found += self.observations(QUEUED_MOST)
        return found

    def close(self) -> None:
        """Let go of the sources."""
        for source in self._sources:
            source.close()


class UdpLines:
    """Lines in datagrams to a port of loopback, one or more in each."""

    def __init__(self, port: int) -> None:
        """Bind the port; raises SattrackError where it is not available."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # Room for a tick of one camera's lines: of a flood, the system drops the rest.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        try:
            self._socket.bind((LOOPBACK, port))
        except OSError as error:
            self._socket.close()
            raise SattrackError(
                f"--observations udp:{port}: UDP port {port} of {LOOPBACK} is not available: {error.strerror}"
            ) from error

    def lines(self) -> Sequence[bytes]:
        """Return the lines of the datagrams that have come."""
        lines: list[bytes] = []
        for _ in range(DATAGRAMS_A_TICK):
            try:
                lines.extend(self._socket.recv(DATAGRAM_BYTES).split(b"\n"))
            except OSError:
                break
        return lines

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def check_source(text: str | None) -> int | None:
    """Return the port of `udp:PORT`, None for `stdin` and for nothing; raises BadInputError."""
    if text is None or text == "stdin":
        return None
    kind, _, number = text.partition(":")
    if kind != "udp":
        raise BadInputError(f"--observations {text}: {WRITE}")
    if not (number.isascii() and number.isdecimal() and 1 <= int(number) <= 65535):
        raise BadInputError(f"--observations {text}: a port is 1 to 65535; {WRITE}")
    return int(number)


def open_observers(text: str | None) -> Observers:
    """Return the observers for `--observations`, "stdin", "udp:PORT" or None, or for an aircraft followed.

    Raises BadInputError for anything else, SattrackError where the port is not available.
    """
    if text is not None and text.startswith(PREFIX):
        return Observers([AdsbFeed(text)])
    port = check_source(text)
    if port is not None:
        return Observers([UdpLines(port)])
    return Observers([LineReader(sys.stdin.fileno())] if text == "stdin" else [])


def read_all(stream: Iterable[bytes]) -> Observers:
    """Return observers that hold every line of a stream that ends, and what is put to them besides."""
    observers = Observers(most=math.inf)
    for line in stream:
        observers.put(line)
    return observers

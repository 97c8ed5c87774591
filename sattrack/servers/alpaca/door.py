"""The feeding process' end of the line to the one that Alpaca's clients talk to.

One order is obeyed a period at most, as judging a slew's way may take milliseconds; a stop never waits, and
what was asked before it and not begun is not begun any more. States that the other end is too slow for are
left out; answers are not.
"""

from __future__ import annotations

import contextlib
import select
import socket
import subprocess
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.core.own_program import own_program
from sattrack.servers.alpaca.faults import Number
from sattrack.servers.alpaca.messages import (
    AbortOrder,
    Answered,
    Asked,
    BiasOrder,
    Told,
    decode_asked,
    encode,
)
from sattrack.servers.alpaca.task import READY, encode_task

if TYPE_CHECKING:
    from sattrack.servers.alpaca.messages import TelescopeState
    from sattrack.servers.alpaca.task import AlpacaTask

READ_BYTES = 65536
LONGEST_LINE = 1 << 22
MOST_UNREAD_BYTES = 1 << 20
START_WITHIN_S = 30.0
END_WITHIN_S = 3.0
REMEMBERED_WORDS = 20
PAUSE_FACTOR = 9.0
"""Orders take a tenth of the feeding process' time at most, however many wait."""


@dataclass(slots=True)
class AlpacaDoor:
    """The line, and the process at its other end; `words` are for the log, whoever tells them takes them."""

    line: socket.socket
    process: subprocess.Popen[bytes]
    words: deque[str] = field(default_factory=lambda: deque(maxlen=REMEMBERED_WORDS))
    ended: bool = False
    """Whether the other process is gone."""
    _rest: bytes = b""
    _unsent: bytes = b""
    _orders: deque[Asked] = field(default_factory=deque)
    _obeyed: bool = False
    _next_s: float = 0.0
    """Before this instant of the monotonic clock no other order is obeyed."""

    def readers(self) -> list[Any]:
        """Return what to wait for."""
        return [] if self.ended else [self.line]

    def writers(self) -> list[Any]:
        """Return what to wait for to take more."""
        return [self.line] if self._unsent and not self.ended else []

    def flush(self) -> None:
        """Send what waits, as far as it can be sent now."""
        if not self._unsent or self.ended:
            return
        try:
            sent = self.line.send(self._unsent)
        except BlockingIOError:
            return
        except OSError:
            self.ended = True
            return
        self._unsent = self._unsent[sent:]

    def push(self, state: TelescopeState, answers: list[Answered]) -> None:
        """Tell a state, unless the last one waits still, and answers after it."""
        if answers or not self._unsent:
            self._unsent += encode(state) + b"".join(encode(answer) for answer in answers)
            self.flush()
        if len(self._unsent) > MOST_UNREAD_BYTES:
            self.ended = True

    def take(self) -> None:
        """Read what has come."""
        try:
            data = self.line.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.ended = True
            return
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            self.ended = True
        for line in lines:
            self._take_line(line)

    def next_order(self) -> tuple[Asked | None, list[Answered]]:
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
        """Note how long an order took: a way that had to be sought takes some tenths of a second."""
        self._next_s = now_s + PAUSE_FACTOR * seconds

    def close(self) -> None:
        """Have the other process end."""
        self.line.close()
        try:
            self.process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _take_line(self, line: bytes) -> None:
        try:
            message = decode_asked(line)
        except msgspec.MsgspecError as error:
            self.words.append(f"a line from the HTTP process was not understood: {error}")
            return
        if isinstance(message, Told):
            self.words.append(message.words)
        else:
            self._orders.append(message)


def open_door(task: AlpacaTask) -> AlpacaDoor:
    """Start the process that clients talk to; raises SattrackError where it does not come up."""
    ours, theirs = socket.socketpair()
    with theirs:
        process = subprocess.Popen(
            [*own_program("sattrack.servers.alpaca.process"), str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(), task.listener, *task.discovery),
            # A Ctrl-C is for the feeding process, which ends this one when the mount stands.
            start_new_session=True,
        )
    door = AlpacaDoor(ours, process)
    with contextlib.suppress(OSError):
        ours.sendall(encode_task(task))
    ours.setblocking(False)
    while READY not in door.words and not door.ended:
        readable, _, _ = select.select([ours], [], [], START_WITHIN_S)
        if not readable:
            break
        door.take()
    if READY not in door.words:
        door.close()
        raise SattrackError("the HTTP server did not start; its own words are above")
    door.words.remove(READY)
    return door

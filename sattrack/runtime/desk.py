"""Who may command a run: one at a time has control, anybody may stop. And how their messages come in.

Whoever started the run speaks to it on a channel of JSON lines. The end of that channel stops the mount, as
whoever held the stop key is gone; unless a message before has asked that the run go on without.
"""

from __future__ import annotations

import sys
from collections import deque
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.channel import LineReader
from sattrack.views.messages import (
    Arm,
    Disarm,
    Go,
    LeaveRunning,
    Message,
    Observation,
    Pause,
    SeenOffset,
    SessionMessage,
    StopNow,
    TakeControl,
    YieldControl,
    decode_said,
    is_observation,
)
from sattrack.views.run import SAME_PASS_S, STARTER, Armed, SessionView, Watcher

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.runtime.gallery_link import ViewServerLink
    from sattrack.runtime.observers import Observers

MOST_ARMED = 12
LONGEST_NAME = 24
NAMED = 8
"""So many of those who look on are named in a view, which has to stay small."""
MOST_COMPLAINTS = 10
ORDERS_A_TICK = 20
"""A change of an offset takes some tens of microseconds, of which a turn of the loop has few to spare."""


class ControlArbiter:
    """Hears everybody before a run, and hands on what the run must obey.

    `with_starter`: whoever started the run speaks to it, and has control first, and again once whoever took
    it has gone. `takes_others`: passes can be armed, to be followed after this one. A stop takes them back.
    """

    def __init__(self, with_starter: bool, takes_others: bool = False) -> None:
        self._with_starter, self._takes_others = with_starter, takes_others
        self._queue: list[Armed] = []
        self.changing = False
        """Whether the run is being ended for the next, by whoever has control."""
        self.controller: int | None = STARTER if with_starter else None
        self.left_running = False
        self._names: dict[int, str] = {}
        self._said: str | None = None
        self.version = 0
        """Counts what changed of the view."""

    def came(self, number: int, name: str) -> None:
        """Let somebody in, or learn the name of somebody who is there."""
        self._names[number] = name
        self.version += 1

    def gone(self, number: int) -> None:
        """See somebody off; control that they had, nobody has then, and the run goes on."""
        name = self._name(number)
        self._names.pop(number, None)
        if self.controller == number:
            self._fall_back()
            self._said = f"{name} had control, and has gone"
        self.version += 1

    def hear(self, number: int, message: Message | SessionMessage) -> Message | None:
        """Return the message if the run is to obey it, None where it is about control, or by no right."""
        match message:
            case TakeControl():
                self._give(number)
            case YieldControl():
                if self.controller == number:
                    self._fall_back()
                    self._said = f"{self._name(number)} gave control up"
            case LeaveRunning():
                if number == STARTER:
                    self.left_running = True
                    self.controller = None if self.controller == STARTER else self.controller
                    self._said = "left running by whoever started it"
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
                self._said = f"stopped from {self._name(number)}"
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
            self._said,
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

    def say(self, words: str) -> None:
        """Show everybody a message."""
        self._said = words
        self.version += 1

    def _obeyed(self, number: int, message: Message) -> Message | None:
        """Hand on what whoever has control says to the run; everybody hears who pauses it."""
        if number != self.controller:
            return None
        if isinstance(message, Pause | Go):
            did = "paused" if isinstance(message, Pause) else "set going"
            self._said = f"{did} from {self._name(number)}"
            self.version += 1
        return message

    def _arm(self, order: Arm) -> Message | None:
        armed = Armed(order.catalog_number, order.culminate_utc_s, order.name[:LONGEST_NAME])
        if not self._takes_others:
            self._said = "this run takes no other satellite"
            return None
        self._queue = [one for one in self._queue if not _same(one, armed)]
        if order.now:
            self._queue.insert(0, armed)
            self.changing = True
            self._said = f"going on to {armed.name or armed.catalog_number}"
            # It ends this run and nothing else: the queue stays.
            return StopNow()
        if len(self._queue) < MOST_ARMED:
            self._queue.append(armed)
            self._queue.sort(key=lambda one: one.culminate_utc_s)
            self._said = f"armed {armed.name or armed.catalog_number}"
        else:
            self._said = f"{MOST_ARMED} passes are armed already, which is all there is room for"
        return None

    def _disarm(self, order: Disarm) -> None:
        gone = Armed(order.catalog_number, order.culminate_utc_s, "")
        self._queue = [one for one in self._queue if not _same(one, gone)]

    def _fall_back(self) -> None:
        """Leave control to whoever started the run, if that is somebody else and there; else to nobody."""
        there = self._with_starter and not self.left_running and self.controller != STARTER
        self.controller = STARTER if there else None

    def _give(self, number: int) -> None:
        if self.controller == number:
            return
        before = None if self.controller is None else self._name(self.controller)
        self.controller = number
        taken = "took control" if before is None else f"took control from {before}"
        self._said = f"{self._name(number)} {taken}"

    def _name(self, number: int) -> str:
        return "where it was started" if number == STARTER else self._names.get(number, f"watcher {number}")


def _same(one: Armed, other: Armed) -> bool:
    """Return whether two name the same pass."""
    near = abs(one.culminate_utc_s - other.culminate_utc_s) < SAME_PASS_S
    return one.catalog_number == other.catalog_number and near


class StdinInbox:
    """Messages from standard input; a line that is none does nothing but to be kept in `ignored`.

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

    def said(self) -> Sequence[Message | SessionMessage]:
        """Return what has come, without waiting; a stop once the channel has ended."""
        if self._ended:
            return ()
        for line in self._reader.lines():
            if is_observation(line):
                self._observers.put(line)
                continue
            try:
                self._waiting.append(decode_said(line))
            except (msgspec.MsgspecError, RecursionError) as error:
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
    """Messages that the run is to obey, of whoever may say them. `stdin` None: nobody speaks directly."""

    def __init__(
        self, arbiter: ControlArbiter, stdin: StdinInbox | None, views: ViewServerLink | None
    ) -> None:
        self._arbiter, self._stdin, self._views = arbiter, stdin, views
        self._strange = 0

    @property
    def malformed(self) -> int:
        """How many lines were none."""
        return self._strange + (0 if self._stdin is None else self._stdin.malformed)

    @property
    def ended(self) -> bool:
        """Whether whoever speaks directly has gone."""
        return self._stdin is None or self._stdin.ended

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting."""
        obeyed: list[Message] = []
        if self._stdin is not None:
            for message in self._stdin.said():
                obeyed += self._heard(STARTER, message)
            self._stdin.stops_at_end = not self._arbiter.left_running
        for heard in () if self._views is None else self._views.heard():
            if heard.what == "came":
                self._arbiter.came(heard.number, heard.text)
            elif heard.what == "gone":
                self._arbiter.gone(heard.number)
            else:
                obeyed += self._read(heard.number, heard.text)
        return obeyed

    def _read(self, number: int, line: str) -> list[Message]:
        try:
            message = decode_said(line)
        except (msgspec.MsgspecError, RecursionError):
            self._strange += 1
            return []
        # Observations take longer than a turn has; they have a door of their own.
        return [] if isinstance(message, Observation | SeenOffset) else self._heard(number, message)

    def _heard(self, number: int, message: object) -> list[Message]:
        obeyed = self._arbiter.hear(number, message)  # type: ignore[arg-type]
        return [] if obeyed is None else [obeyed]

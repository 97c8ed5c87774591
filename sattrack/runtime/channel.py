"""The operator's messages, as JSON lines on a channel.

The end of the channel stops the mount, as whoever held the stop key is gone; unless it was said before that
the run is to go on without.
"""

from __future__ import annotations

import sys
from collections import deque
from typing import TYPE_CHECKING

import msgspec

from sattrack.runtime.embedded import LineReader
from sattrack.views.messages import Message, StopNow
from sattrack.views.session_messages import decode_said

MOST_COMPLAINTS = 10
ORDERS_A_TICK = 20
"""A change of an offset takes some tens of microseconds, of which a turn of the loop has few to spare."""
_OBSERVATION = b'"observation"'

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.runtime.observers import Observers
    from sattrack.views.session_messages import SessionMessage


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
            if _OBSERVATION in line:
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

"""The operator's messages, as JSON lines on a channel.

The end of the channel stops the mount: whoever held the stop key is gone.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import msgspec

from sattrack.messages import Message, StopNow, decode_message
from sattrack.runtime.embedded import LineReader

MOST_COMPLAINTS = 10

if TYPE_CHECKING:
    from collections.abc import Sequence


class StdinInbox:
    """Messages from standard input; a line that is none does nothing but to be kept in `ignored`."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._reader = LineReader(sys.stdin.fileno() if descriptor is None else descriptor)
        self._ended = False
        self.ignored: list[str] = []

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting; a stop once the channel has ended."""
        if self._ended:
            return ()
        messages: list[Message] = []
        for line in self._reader.lines():
            try:
                messages.append(decode_message(line))
            except (msgspec.MsgspecError, RecursionError) as error:
                if len(self.ignored) < MOST_COMPLAINTS:
                    self.ignored.append(f"a control line was ignored: {error}")
        if self._reader.ended:
            self._ended = True
            messages.append(StopNow())
        return messages

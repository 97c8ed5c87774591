"""The operator's messages, as JSON lines on a channel.

The end of the channel stops the mount: whoever held the stop key is gone.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import msgspec

from sattrack.messages import Message, StopNow, decode_message, encode_message
from sattrack.runtime.embedded import LineReader

__all__ = ["StdinInbox", "encode_message"]

if TYPE_CHECKING:
    from collections.abc import Sequence


class StdinInbox:
    """Messages from standard input; a line that is none is told on standard error and does nothing."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._reader = LineReader(sys.stdin.fileno() if descriptor is None else descriptor)
        self._ended = False

    def fileno(self) -> int:
        """Give the descriptor to wait on."""
        return self._reader.fileno()

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting; a stop once the channel has ended."""
        if self._ended:
            return ()
        messages: list[Message] = []
        for line in self._reader.lines():
            try:
                messages.append(decode_message(line))
            except msgspec.MsgspecError as error:
                os.write(2, f"sattrack: a control line was ignored: {error}\n".encode())
        if self._reader.ended:
            self._ended = True
            messages.append(StopNow())
        return messages

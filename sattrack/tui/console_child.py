"""The console's process as seen from here: a thread reads its views, orders go to its standard input."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import msgspec

from sattrack.console_messages import AbortOrder, LeaveOrder, encode_order
from sattrack.console_view import ConsoleView
from sattrack.tui.child import FeederProcess
from sattrack.tui.console_feed import Latest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.console_messages import ConsoleMessage

_VIEW: msgspec.json.Decoder[ConsoleView] = msgspec.json.Decoder(ConsoleView)


class ConsoleProcess(FeederProcess):
    """A console started by us. The end of its standard input makes it stop the mount and leave."""

    def __init__(self, command: Sequence[str]) -> None:
        self._newest: ConsoleView | None = None
        super().__init__(command)

    def latest(self) -> Latest:
        """See ConsoleFeed."""
        with self._changed:
            view, self._newest = self._newest, None
            return Latest(view, self._ended)

    def tell(self, order: ConsoleMessage) -> bool:
        """See ConsoleFeed. A stop that cannot be written is said by closing the channel instead."""
        try:
            os.write(self._input.fileno(), encode_order(order))
        except (OSError, ValueError):
            if isinstance(order, AbortOrder | LeaveOrder):
                self.close_input()
            return False
        return True

    def _take(self, line: bytes) -> None:
        try:
            self._newest = _VIEW.decode(line)
        except msgspec.MsgspecError:
            # Something that this screen does not know: a later console may say more.
            return
        self.viewed = True

"""The console's process as seen from here: a thread reads its views, orders go to its standard input."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.tui.console_feed import Latest
from sattrack.tui.latest_child import LatestProcess
from sattrack.views.console import ConsoleView
from sattrack.views.console_messages import AbortOrder, LeaveOrder, encode_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.views.console_messages import ConsoleMessage


class ConsoleProcess(LatestProcess[ConsoleView]):
    """A console started by us. The end of its standard input makes it stop the mount and leave."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, ConsoleView)

    def latest(self) -> Latest:
        """See ConsoleFeed."""
        return Latest(*self._take_newest())

    def tell(self, order: ConsoleMessage) -> bool:
        """See ConsoleFeed. A stop that cannot be written is said by closing the channel instead."""
        told = self._write(encode_order(order))
        if not told and isinstance(order, AbortOrder | LeaveOrder):
            self.close_input()
        return told

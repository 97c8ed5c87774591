"""A process that tells how something stands, of which only the newest view is of interest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

import msgspec

from sattrack.tui.child import FeederProcess

if TYPE_CHECKING:
    from collections.abc import Sequence

ViewT = TypeVar("ViewT")


class LatestProcess(FeederProcess, Generic[ViewT]):
    """Started by us. The end of its standard input makes it stop the mount and leave."""

    def __init__(self, command: Sequence[str], view: type[ViewT]) -> None:
        self._newest: ViewT | None = None
        self._decoder = msgspec.json.Decoder(view)
        super().__init__(command)

    def _take_newest(self) -> tuple[ViewT | None, bool]:
        """Return the view that has come since the last call, if any, and whether nothing more will come."""
        with self._changed:
            view, self._newest = self._newest, None
            return view, self._ended

    def _take(self, line: bytes) -> None:
        try:
            self._newest = self._decoder.decode(line)
        except msgspec.MsgspecError:
            # Something that this screen does not know: a later program may say more.
            return
        self.viewed = True

"""The antenna's process as seen from here: a thread reads its views, words go to its standard input."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.antenna_view import AntennaView
from sattrack.tui.child import FeederProcess

if TYPE_CHECKING:
    from collections.abc import Sequence

_VIEW: msgspec.json.Decoder[AntennaView] = msgspec.json.Decoder(AntennaView)


@dataclass(frozen=True, slots=True)
class LatestAntenna:
    """What has come since the last look."""

    view: AntennaView | None = None
    """The newest; None where none has come."""
    ended: bool = False
    """Whether nothing more will come."""


class AntennaFeed(Protocol):
    """One antenna, seen from outside. Neither method ever waits."""

    def latest(self) -> LatestAntenna:
        """Return what has come since the last call."""

    def tell(self, word: str) -> None:
        """Hand a word over to the controller's console."""


class AntennaProcess(FeederProcess):
    """An antenna's service started by us. The end of its standard input makes it stop the mount and end."""

    def __init__(self, command: Sequence[str]) -> None:
        self._newest: AntennaView | None = None
        super().__init__(command)

    def latest(self) -> LatestAntenna:
        """See AntennaFeed."""
        with self._changed:
            view, self._newest = self._newest, None
            return LatestAntenna(view, self._ended)

    def tell(self, word: str) -> None:
        """See AntennaFeed. What cannot be written is said by closing the channel, which stops the mount."""
        try:
            os.write(self._input.fileno(), word.encode() + b"\n")
        except (OSError, ValueError):
            self.close_input()

    def _take(self, line: bytes) -> None:
        try:
            self._newest = _VIEW.decode(line)
        except msgspec.MsgspecError:
            # Something that this screen does not know: a later program may say more.
            return
        self.viewed = True

"""The antenna's process as seen from here: a thread reads its views, words go to its standard input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from sattrack.tui.latest_child import LatestProcess
from sattrack.views.antenna import AntennaView

if TYPE_CHECKING:
    from collections.abc import Sequence


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


class AntennaProcess(LatestProcess[AntennaView]):
    """An antenna's service started by us. The end of its standard input makes it stop the mount and end."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, AntennaView)

    def latest(self) -> LatestAntenna:
        """See AntennaFeed."""
        return LatestAntenna(*self._take_newest())

    def tell(self, word: str) -> None:
        """See AntennaFeed. What cannot be written is said by closing the channel, which stops the mount."""
        if not self._write(word.encode() + b"\n"):
            self.close_input()

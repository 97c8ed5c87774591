"""What the console's screen needs of whatever brings views and takes orders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from sattrack.views.messages import ConsoleMessage
    from sattrack.views.run import ConsoleView


@dataclass(frozen=True, slots=True)
class Latest:
    """What has come since the last look."""

    view: ConsoleView | None = None
    """The newest; None where none has come."""
    ended: bool = False
    """Whether nothing more will come."""


class ConsoleFeed(Protocol):
    """One mount under manual operation, seen from outside. Neither method ever waits."""

    def latest(self) -> Latest:
        """Return what has come since the last call."""

    def tell(self, order: ConsoleMessage) -> bool:
        """Hand an order over; False where the console can no longer be reached."""

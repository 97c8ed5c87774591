"""What the screen needs of whatever brings views and takes messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from sattrack.views.run import STARTER

if TYPE_CHECKING:
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import PassView, SessionView, Summary, TrackView


@dataclass(frozen=True, slots=True)
class News:
    """What has come since the last look, oldest first."""

    views: tuple[TrackView, ...] = ()
    ended: bool = False
    """Whether nothing more will come."""
    summary: Summary | None = None
    """What the run came to, once it has ended as it should."""
    sky: PassView | None = None
    """What was told of the pass, once it has come."""
    rewound: bool = False
    """Whether the views begin anew, at an earlier instant: what was drawn from those before is void."""
    session: SessionView | None = None
    """Who has control and who looks on, once that was told."""
    you: int = STARTER
    """The number by which that knows whoever looks here."""
    run: int | None = None
    """The process of the run, where it can become another one."""
    between: bool = False
    """Whether a run of a schedule is over, and the next one is waited for."""


class Feed(Protocol):
    """One run, seen from outside. Neither method ever waits."""

    def news(self) -> News:
        """Return what has come since the last call."""

    def send(self, message: Message | SessionMessage) -> bool:
        """Hand a message over; False where the run can no longer be reached."""

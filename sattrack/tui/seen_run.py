"""A run seen from outside: what a screen needs of it, and what is kept between a screen's looks."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.views.run import STARTER, SessionView, SummaryLine, TrackView

if TYPE_CHECKING:
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import PassView, Summary


@dataclass(frozen=True, slots=True)
class News:
    """What has come since the last look, oldest first."""

    views: tuple[TrackView, ...] = ()
    ended: bool = False
    """Whether nothing more will come."""
    summary: Summary | None = None
    """What the run came to, once it has ended as it should."""
    sky: PassView | None = None
    """What is known of the pass, once it has come."""
    rewound: bool = False
    """Whether the views begin anew, at an earlier instant: what was drawn from those before is void."""
    session: SessionView | None = None
    """Who has control and who looks on, once that is known."""
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


_SUMMARY: msgspec.json.Decoder[SummaryLine] = msgspec.json.Decoder(SummaryLine)


class SeenRun:
    """Views and what else is known of a run: taken in by a thread of a subclass, handed out by `news`.

    At most `most_unread` views wait, the newest; None: all.
    """

    def __init__(self, most_unread: int | None = None) -> None:
        self._views: deque[TrackView] = deque(maxlen=most_unread)
        self._sky: PassView | None = None
        self._session: SessionView | None = None
        self._rewound = False
        self._run: int | None = None
        self._between = False
        self._ended = False
        self._changed = threading.Condition()
        self.summary: Summary | None = None
        self.viewed = False
        """Whether a view has come at all."""

    @property
    def you(self) -> int:
        """The number by which the run knows whoever looks here."""
        return STARTER

    def wait_first_view(self) -> bool:
        """Wait until a view has come; False where the run ended without one."""
        with self._changed:
            self._changed.wait_for(lambda: self.viewed or self._ended)
        return self.viewed

    def news(self) -> News:
        """Return what has come since the last call."""
        with self._changed:
            views = tuple(self._views)
            self._views.clear()
            rewound, self._rewound = self._rewound, False
            return News(
                views,
                self._ended,
                self.summary,
                self._sky,
                rewound,
                self._session,
                self.you,
                self._run,
                self._between,
            )

    def _see(self, message: TrackView | SessionView) -> None:
        with self._changed:
            if isinstance(message, TrackView):
                self._views.append(message)
                self.viewed = True
            else:
                self._session = message
            self._changed.notify_all()

    def _see_summary(self, line: bytes) -> bool:
        """Take the run's summary; False where a line is something else."""
        try:
            summary = _SUMMARY.decode(line).summary
        except msgspec.MsgspecError:
            return False
        with self._changed:
            self.summary = summary
            self._changed.notify_all()
        return True

    def _see_end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _begin_anew(self) -> None:
        """Where a run was shown already, have what was seen of it be over: another begins."""
        with self._changed:
            if self.summary is not None:
                self.summary, self._rewound = None, True
                self._views.clear()

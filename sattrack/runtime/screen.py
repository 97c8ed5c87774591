"""Showing a run to somebody, from a thread of its own: whoever looks can never hold up the loop."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.view import TrackView

LAST_VIEW_WITHIN_S = 1.0


class Screen:
    """Hands the newest view to `draw` as often as that is ready for one; what it misses is gone.

    A terminal that does not drain blocks the thread that writes to it and nothing else. What `draw` raises is
    raised by the next call of `show`.
    """

    def __init__(self, draw: Callable[[TrackView], None]) -> None:
        self._draw = draw
        self._newest: TrackView | None = None
        self._ended = False
        self._error: Exception | None = None
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="screen", daemon=True)
        self._thread.start()

    def show(self, view: TrackView) -> None:
        """Take a view, without waiting."""
        if self._error is not None:
            raise self._error
        with self._news:
            self._newest = view
            self._news.notify()

    def close(self) -> None:
        """Have the last view drawn, if that does not take long."""
        with self._news:
            self._ended = True
            self._news.notify()
        self._thread.join(LAST_VIEW_WITHIN_S)

    def _work(self) -> None:
        while (view := self._next()) is not None:
            try:
                self._draw(view)
            except Exception as error:  # noqa: BLE001 - it is for the loop to decide what that means
                self._error = error
                return

    def _next(self) -> TrackView | None:
        with self._news:
            while self._newest is None and not self._ended:
                self._news.wait()
            view, self._newest = self._newest, None
            return view

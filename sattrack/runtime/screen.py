"""Showing a run to somebody, from a thread of its own: whoever looks can never hold up the loop."""

from __future__ import annotations

import queue
import threading
from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.views.run import TrackView

LAST_VIEW_WITHIN_S = 1.0


class Screen:
    """Hands the newest view to `draw` as often as that is ready for one; what it misses is gone.

    A terminal that does not drain blocks the thread that writes to it and nothing else. What `draw` raises is
    raised by the next call of `show`. `show` takes no lock that the thread may hold.
    """

    def __init__(self, draw: Callable[[TrackView], None]) -> None:
        self._draw = draw
        self._newest: deque[TrackView] = deque(maxlen=1)
        self._news: queue.SimpleQueue[bool] = queue.SimpleQueue()
        """True where there is a view, False where there will be no more."""
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="screen", daemon=True)
        self._thread.start()

    def show(self, view: TrackView) -> None:
        """Take a view, without waiting."""
        if self._error is not None:
            raise self._error
        self._newest.append(view)
        if self._news.empty():
            self._news.put(True)

    def close(self) -> None:
        """Have the last view drawn, if that does not take long."""
        self._news.put(False)
        self._thread.join(LAST_VIEW_WITHIN_S)

    def _work(self) -> None:
        more = True
        while more:
            more = self._news.get()
            try:
                while self._newest:
                    self._draw(self._newest.popleft())
            except Exception as error:  # noqa: BLE001 - it is for the loop to decide what that means
                self._error = error
                return

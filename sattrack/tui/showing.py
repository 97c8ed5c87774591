"""Run a screen until it is left, by its own key or by a signal."""

from __future__ import annotations

import signal
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

INTERRUPTED = 130
LEAVING_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


class Leavable(Protocol):
    """A Textual application that can be asked to leave, and tells whether it was interrupted."""

    interrupted: bool

    @property
    def return_code(self) -> int | None:
        """What Textual makes of its end: not nought where the screen broke."""

    def ask_to_leave(self) -> None:
        """Leave as its own key does; callable from a signal's handler."""

    def run(self) -> object:
        """Show it until it is left."""


def run_until_left(app: Leavable, broke: str) -> bool:
    """Run `app` until it is left; tell whether it was interrupted. Raises SattrackError(`broke`)."""
    with _leaving(app.ask_to_leave):
        app.run()
    if app.return_code and not app.interrupted:
        raise SattrackError(broke)
    return app.interrupted


@contextmanager
def _leaving(leave: Callable[[], None]) -> Iterator[None]:
    """Have the signals that end programs leave the screen as its own key does, the terminal restored."""
    before = {number: signal.signal(number, lambda *_: leave()) for number in LEAVING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

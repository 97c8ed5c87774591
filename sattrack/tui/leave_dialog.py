"""What is asked before a screen is left on which a run was started."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.containers import Vertical
from textual.widgets import Label

from sattrack.tui.touch import Dialog

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.events import Key

STOP, LEAVE, STAY = "stop", "leave", "stay"
ANSWERS = {"s": STOP, "q": STOP, "l": LEAVE}
LINES = (
    ("s", "s  or q once more: stop the mount and leave"),
    ("l", "l  leave it running: the pass goes on with nobody at this screen;"),
    ("l", "   `sattrack attach` looks at it again, `sattrack stop` stops it"),
    (None, "any other key stays; SPACE stops the mount"),
)
"""What is said, and the answer that a touch of it is."""


class LeaveDialog(Dialog[str]):
    """Asks whether the mount is to be stopped or the run left running; any other key stays."""

    def compose(self) -> ComposeResult:
        """Make the parts."""
        with Vertical(classes="dialog"):
            yield Label("leave?", classes="dialog-title", markup=False)
            for answer, text in LINES:
                yield Label(text, name=answer, markup=False)

    def on_key(self, event: Key) -> None:
        """Take the answer, and the key for nothing else."""
        event.stop()
        self.dismiss(ANSWERS.get(event.key, STAY))

    def touched(self, name: str) -> None:
        """Take the answer that was touched."""
        if name in ANSWERS:
            self.dismiss(ANSWERS[name])

"""What is asked before a screen is left on which a run was started."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Label

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.events import Key

STOP, LEAVE, STAY = "stop", "leave", "stay"
ANSWERS = {"s": STOP, "q": STOP, "l": LEAVE}


class LeaveDialog(ModalScreen[str]):
    """Asks whether the mount is to be stopped or the run left running; any other key stays."""

    def compose(self) -> ComposeResult:
        """Make the parts."""
        with Vertical(classes="dialog"):
            yield Label("leave?", classes="dialog-title", markup=False)
            yield Label("s  or q once more: stop the mount and leave", markup=False)
            yield Label("l  leave it running: the pass goes on with nobody at this screen;", markup=False)
            yield Label("   `sattrack attach` looks at it again, `sattrack stop` stops it", markup=False)
            yield Label("any other key stays; SPACE stops the mount", markup=False)

    def on_key(self, event: Key) -> None:
        """Take the answer, and the key for nothing else."""
        event.stop()
        self.dismiss(ANSWERS.get(event.key, STAY))

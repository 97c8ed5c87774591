"""What the screens of a run and of a mount share: the stop over everything, dialogs, how they are left."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.css.query import NoMatches

from sattrack.tui.themed import NIGHT_LOOK, ThemedApp

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.dom import DOMNode

    from sattrack.tui.appearance import Appearance


class ScreenApp(ThemedApp):
    """A screen before which an operator sits."""

    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "stop", "STOP", priority=True),
        Binding("ctrl+c", "interrupt", "interrupt", priority=True),
        Binding("ctrl+q", "leave", "quit", priority=True),
        Binding("q", "leave", "quit"),
        Binding("t", "next_theme", "theme"),
        Binding("question_mark", "help", "help"),
    ]

    def __init__(self, appearance: Appearance = NIGHT_LOOK) -> None:
        super().__init__(appearance)
        self.interrupted = False
        self._leave_asked = False

    def action_leave(self) -> None:
        """Leave, as the screen's own key does."""
        raise NotImplementedError

    async def action_quit(self) -> None:
        """Leave as `q` does, whoever asks."""
        self.action_leave()

    def ask_to_leave(self) -> None:
        """Leave soon, the mount stopped; may be called from a signal handler."""
        self._leave_asked = True

    def _was_asked_to_leave(self) -> bool:
        """Tell it once."""
        asked, self._leave_asked = self._leave_asked, False
        return asked

    def _close_dialogs(self) -> None:
        while len(self.screen_stack) > 1:
            self.pop_screen()

    def _draw_on_main(self, draw: Callable[[DOMNode], object]) -> None:
        """Draw on what lies under any dialog; nothing while it is being put up or taken down."""
        if self.screen_stack:
            with suppress(NoMatches):
                draw(self.screen_stack[0])

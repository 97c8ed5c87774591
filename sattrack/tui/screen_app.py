"""What all applications share: theme, plain characters, the stop over everything, how they are left."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, ClassVar

from textual.app import App
from textual.binding import Binding, BindingType
from textual.css.query import NoMatches
from textual.widget import Widget

from sattrack.tui import look
from sattrack.tui.appearance import NIGHT, Appearance
from sattrack.tui.look import DIM, PLATE, PlainFilter
from sattrack.tui.panels import STOP_PLATE, Row, rows_content
from sattrack.tui.scene import Tone

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.content import Content
    from textual.dom import DOMNode
    from textual.events import Click
    from textual.filter import LineFilter

FEW_COLOURS = {None, "standard", "windows"}
"""Rich's names of what has 16 colours or none, where different light colours become the same one."""
ENOUGH = "80 × 24"
STOP_ROW = 2


class TooSmall(Widget):
    """Lies over everything where the terminal is too small for it; the stop key works all the same."""

    def render(self) -> Content:
        """Draw."""
        columns, rows = self.app.size
        lines: list[Row] = [[f"too small: {columns} × {rows}"], [(f"{ENOUGH} is enough", DIM)]]
        return rows_content([*lines, [(STOP_PLATE, PLATE[Tone.BAD]), " q leave"]])

    def on_click(self, event: Click) -> None:
        """Do what the key does that was touched."""
        if event.y == STOP_ROW:
            self.app.simulate_key("space" if event.x < len(STOP_PLATE) else "q")


class ScreenApp(App[None]):
    """An application in front of which an operator sits, drawn as `appearance` says."""

    HORIZONTAL_BREAKPOINTS = look.WIDTHS
    VERTICAL_BREAKPOINTS = look.HEIGHTS
    DEFAULT_CSS = """
    Screen { layers: default above; }
    TooSmall { layer: above; display: none; width: 100%; height: 100%; background: $background; }
    .-slim TooSmall, .-low TooSmall { display: block; }
    """
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "stop", "STOP", priority=True),
        Binding("ctrl+c", "interrupt", "interrupt", priority=True),
        Binding("ctrl+q", "leave", "quit", priority=True),
        Binding("q", "leave", "quit"),
        Binding("t", "next_theme", "theme"),
        Binding("question_mark", "help", "help"),
    ]

    def __init__(self, appearance: Appearance = NIGHT) -> None:
        # What lies below asks for it while it is made.
        self._appearance = appearance
        super().__init__()
        self.interrupted = False
        self._leave_asked = False

    @property
    def shapes(self) -> bool:
        """Whether lines must differ in shape, since colours do not distinguish them."""
        return self.no_color or (not self.is_headless and self.console.color_system in FEW_COLOURS)

    def every(self, seconds: float, act: Callable[[], None]) -> None:
        """Call a function again and again while there are screens; the application's timers outlive them."""
        self.set_interval(seconds, lambda: act() if self.is_running else None)

    def set_look(self) -> None:
        """Set the theme."""
        for theme in look.THEMES:
            self.register_theme(theme)
        self.theme = self._appearance.theme

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Return the colours beyond Textual's own, which the layout names before a theme is set."""
        return look.NIGHT.variables

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return what everything that is drawn goes through at last."""
        filters = super().get_line_filters()
        return [*filters, PlainFilter()] if self._appearance.plain else filters

    def action_next_theme(self) -> None:
        """Go on to the next theme."""
        at = look.THEME_NAMES.index(self.theme)
        self.theme = look.THEME_NAMES[(at + 1) % len(look.THEME_NAMES)]

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

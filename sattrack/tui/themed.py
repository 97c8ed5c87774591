"""How a screen looks: its theme, the key that changes it, and whether it has ASCII characters alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.app import App
from textual.widget import Widget

from sattrack.tui import look
from sattrack.tui.appearance import Appearance
from sattrack.tui.look import DIM, PLATE
from sattrack.tui.panels import Row, rows_content
from sattrack.tui.plain import PlainFilter
from sattrack.tui.scene import Tone

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.content import Content
    from textual.events import Click
    from textual.filter import LineFilter

NIGHT_LOOK = Appearance()


FEW_COLOURS = {None, "standard", "windows"}
"""Rich's names of what has 16 colours or none, where different light colours become the same one."""
ENOUGH = "80 × 24"
STOP, STOP_ROW = " SPACE STOP ", 2


class TooSmall(Widget):
    """Lies over everything where the terminal is too small for it; the stop key works all the same."""

    def render(self) -> Content:
        """Draw."""
        columns, rows = self.app.size
        lines: list[Row] = [[f"too small: {columns} × {rows}"], [(f"{ENOUGH} is enough", DIM)]]
        return rows_content([*lines, [(STOP, PLATE[Tone.BAD]), " q leave"]])

    def on_click(self, event: Click) -> None:
        """Do what the key does that was touched."""
        if event.y == STOP_ROW:
            self.app.simulate_key("space" if event.x < len(STOP) else "q")


class ThemedApp(App[None]):
    """An application drawn as it was asked for."""

    HORIZONTAL_BREAKPOINTS = look.WIDTHS
    VERTICAL_BREAKPOINTS = look.HEIGHTS
    DEFAULT_CSS = """
    Screen { layers: default above; }
    TooSmall { layer: above; display: none; width: 100%; height: 100%; background: $background; }
    .-slim TooSmall, .-low TooSmall { display: block; }
    """

    def __init__(self, appearance: Appearance = NIGHT_LOOK) -> None:
        # What lies below asks for it while it is made.
        self._appearance = appearance
        super().__init__()

    @property
    def shapes(self) -> bool:
        """Whether lines must differ in shape, since colours do not tell them apart."""
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

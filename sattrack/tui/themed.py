"""How a screen looks: its theme, the key that changes it, and whether it has ASCII characters alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.app import App

from sattrack.tui import look
from sattrack.tui.appearance import Appearance
from sattrack.tui.plain import PlainFilter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from textual.filter import LineFilter

NIGHT_LOOK = Appearance()


class ThemedApp(App[None]):
    """An application drawn as it was asked for."""

    def __init__(self, appearance: Appearance = NIGHT_LOOK) -> None:
        # What lies below asks for it while it is made.
        self._appearance = appearance
        super().__init__()

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

"""The foot of a screen: keys that can be touched as well, also where a dialog lies over them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from rich.cells import cell_len
from textual.errors import NoWidget
from textual.screen import ModalScreen

from sattrack.tui.panels import ScenePanel, SceneT, rows_content

if TYPE_CHECKING:
    from textual.content import Content
    from textual.events import Click

AnswerT = TypeVar("AnswerT")
Touch = tuple[str, str, str | None]
"""A text, its style, and the key that it stands for, if any."""


class TouchBar(ScenePanel[SceneT]):
    """One row of keys. A style sheet knows a widget by its first base: this is the second."""

    def touches(self, scene: SceneT | None) -> list[Touch]:
        """Return what stands in the row, from left to right; None: there is no view yet."""
        raise NotImplementedError

    def _content(self) -> Content:
        return rows_content([[(text, style) for text, style, _ in self.touches(self._scene)]])

    def on_click(self, event: Click) -> None:
        """Do what the key does that was touched."""
        key = self.key_at(event.screen_x, event.screen_y)
        if key is not None:
            self.app.simulate_key(key)

    def key_at(self, screen_x: int, screen_y: int) -> str | None:
        """Return the key that stands in a cell of the terminal; None for none."""
        room = self.content_region
        if not room.contains(screen_x, screen_y):
            return None
        cells = screen_x - room.x
        for text, _, key in self.touches(self._scene):
            cells -= cell_len(text)
            if cells < 0:
                return key
        return None


class Dialog(ModalScreen[AnswerT]):
    """What lies over a screen. A touch beside it stops where the stop is, and else closes it, no yes."""

    def on_click(self, event: Click) -> None:
        """Take a touch of a part of it, or beside it."""
        try:
            part, _ = self.get_widget_at(event.screen_x, event.screen_y)
        except NoWidget:
            part = self
        if part is not self:
            self.touched(part.name or "")
            return
        feet = self.app.screen_stack[0].query("*").results(TouchBar)
        if any(foot.key_at(event.screen_x, event.screen_y) == "space" for foot in feet):
            # Said by the application: what a dialog sends does not get beyond it.
            self.app.call_later(self.app.simulate_key, "space")
        else:
            self.dismiss(None)

    def touched(self, name: str) -> None:
        """Take a touch of a part by its name; "" for one without."""

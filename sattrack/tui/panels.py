"""What every screen draws with: rows of text, panels, keys that can be touched, dialogs, and dots."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

from rich.cells import cell_len, set_cell_size
from textual.content import Content
from textual.errors import NoWidget
from textual.screen import ModalScreen
from textual.widget import Widget

from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from textual.events import Click, MouseScrollDown, MouseScrollUp

    from sattrack.tui.scene import Caution, Headline

Part = str | tuple[str, str]
"""Text, plain or with its style."""
Row = list[Part]
LABEL_CELLS = 9
WHEEL_ROWS = 3
SceneT = TypeVar("SceneT")


def rows_content(rows: Iterable[Row]) -> Content:
    """Return rows of parts as one content; text is text, never markup."""
    return Content("\n").join([Content.assemble(*row) for row in rows])


def cells_of(row: Row) -> int:
    """Return how many cells a row takes."""
    return sum(cell_len(part if isinstance(part, str) else part[0]) for part in row)


def labelled(label: str, *parts: Part, cells: int = LABEL_CELLS) -> Row:
    """Return a row that begins with a quiet label in a column of its own."""
    return [(label.ljust(cells), DIM), *parts]


class Redrawn(Widget):
    """Shows what `_content` returns."""

    grows: ClassVar[bool] = False
    """Whether its height follows what it says."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self._drawn = Content("")

    def renew(self) -> None:
        """Draw anew where that makes a difference."""
        if not self._content().is_same(self._drawn):
            self.refresh(layout=self.grows)

    def render(self) -> Content:
        """Draw."""
        self._drawn = self._content()
        return self._drawn

    def _content(self) -> Content:
        raise NotImplementedError


class ListPage(Redrawn):
    """A list to scroll through, by keys and by the wheel, between rows that stay."""

    rows_that_stay: ClassVar[int] = 1

    @property
    def _room(self) -> int:
        return max(1, self.content_size.height - self.rows_that_stay)

    def move(self, rows: int) -> None:
        """Go down by so many rows, up where negative."""
        raise NotImplementedError

    def page(self, pages: int) -> None:
        """Go down by so many screens, up where negative."""
        self.move(pages * max(1, self._room - 1))

    def turn_filter(self) -> None:
        """Go on to the next filter, where the list has any."""

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Scroll back."""
        event.stop()
        self.move(-WHEEL_ROWS)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """Scroll on."""
        event.stop()
        self.move(WHEEL_ROWS)


class ScenePanel(Redrawn, Generic[SceneT]):
    """Draws one aspect of a scene: in several rows where it has room for them, else in few."""

    small: ClassVar[int] = 2
    """The most rows in which it is drawn compactly."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id)
        self._scene: SceneT | None = None

    def show(self, scene: SceneT) -> None:
        """Take a new scene; nothing is redrawn where nothing has changed."""
        self._scene = scene
        self.renew()

    def _content(self) -> Content:
        if self._scene is None:
            return Content("")
        roomy = self.content_size.height > self.small
        return rows_content(self.full(self._scene) if roomy else self.compact(self._scene))

    def full(self, scene: SceneT) -> list[Row]:
        """Return the rows for a panel of its own."""
        raise NotImplementedError

    def compact(self, scene: SceneT) -> list[Row]:
        """Return the one or two rows for a small terminal."""
        return self.full(scene)


class Panel(ScenePanel[Scene]):
    """A panel of a run's screen."""


class HeadlinePanel(ScenePanel[SceneT]):
    """The one thing to read first. A style sheet knows a widget by its first base: this is the second."""

    @staticmethod
    def headline_of(scene: Any) -> Headline:
        """Return what to read first."""
        raise NotImplementedError

    def full(self, scene: SceneT) -> list[Row]:
        """Return the one row."""
        word, rest, tone = self.headline_of(scene)
        return [[(f" {word} ", PLATE[tone]), " ", (rest, SPOKEN[tone])]]


class CautionsPanel(ScenePanel[SceneT]):
    """What wants attention, each with what to do; takes no room where there is nothing."""

    grows = True

    @staticmethod
    def cautions_of(scene: Any) -> Sequence[Caution]:
        """Return what wants attention."""
        raise NotImplementedError

    def _content(self) -> Content:
        return Content("") if self._scene is None else rows_content(self.full(self._scene))

    def full(self, scene: SceneT) -> list[Row]:
        """Return one row for each."""
        found = self.cautions_of(scene)
        return [[(f"! {what}", SPOKEN[tone]), f": {do}" if do else ""] for what, do, tone in found]

    def show(self, scene: SceneT) -> None:
        """Take a new scene, and no room where there is nothing to say."""
        super().show(scene)
        self.display = bool(self.cautions_of(scene))


AnswerT = TypeVar("AnswerT")
STOP_PLATE = " SPACE STOP "
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


DOTS_ACROSS, DOTS_DOWN = 2, 4
BRAILLE = 0x2800
_BITS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))


class Layer(NamedTuple):
    """How dots of one kind look: their style, and the character of a cell with such a dot without Unicode."""

    style: str
    plain: str


class DotCanvas:
    """Cells of dots and of characters. Of several layers in a cell the later in `layers` gives its look.

    Dots are counted from the upper left, two across and four down a cell, so that they are as wide as high.
    """

    def __init__(self, columns: int, rows: int, layers: Sequence[Layer], plain: bool = False) -> None:
        self.columns, self.rows = columns, rows
        self._layers = layers
        self.plain = plain
        self._dots: dict[tuple[int, int], tuple[int, int]] = {}
        self._characters: dict[tuple[int, int], tuple[str, str]] = {}

    def copy(self) -> DotCanvas:
        """Return another with the same on it."""
        other = DotCanvas(self.columns, self.rows, self._layers, self.plain)
        other._dots = dict(self._dots)
        other._characters = dict(self._characters)
        return other

    def dot(self, x: float, y: float, layer: int) -> None:
        """Set the dot that holds a point; nothing outside."""
        across, down = math.floor(x), math.floor(y)
        cell = across // DOTS_ACROSS, down // DOTS_DOWN
        if not (0 <= cell[0] < self.columns and 0 <= cell[1] < self.rows):
            return
        bits, top = self._dots.get(cell, (0, -1))
        self._dots[cell] = bits | _BITS[across % DOTS_ACROSS][down % DOTS_DOWN], max(top, layer)

    def line(self, points: Iterable[tuple[float, float] | None], layer: int) -> None:
        """Join points by lines; None parts them."""
        before: tuple[float, float] | None = None
        for point in points:
            if point is not None and before is not None:
                steps = max(1, math.ceil(max(abs(point[0] - before[0]), abs(point[1] - before[1]))))
                for step in range(steps + 1):
                    share = step / steps
                    self.dot(
                        before[0] + share * (point[0] - before[0]),
                        before[1] + share * (point[1] - before[1]),
                        layer,
                    )
            before = point

    def write(self, column: int, row: int, text: str, style: str) -> bool:
        """Put characters over the dots; nothing, and False, where they do not fit or others stand."""
        if not self.room(column, row, len(text)):
            return False
        for at, character in enumerate(text):
            self._characters[column + at, row] = character, style
        return True

    def room(self, column: int, row: int, length: int) -> bool:
        """Tell whether so many characters fit there and none stand there."""
        inside = 0 <= row < self.rows and column >= 0 and column + length <= self.columns
        return inside and not any((column + i, row) in self._characters for i in range(length))

    def covers(self, column: int, row: int, length: int, *, layer: int) -> int:
        """Return how many cells from there on have dots of a layer or of one after it."""
        cells = ((column + i, row) for i in range(length))
        return sum(self._dots.get(cell, (0, -1))[1] >= layer for cell in cells)

    def drawn(self) -> list[Row]:
        """Return the rows of the picture, neighbours of one style together."""
        return [self._row(row) for row in range(self.rows)]

    def _row(self, row: int) -> Row:
        parts: list[tuple[str, str]] = []
        for column in range(self.columns):
            text, style = self._cell((column, row))
            if parts and parts[-1][1] == style:
                parts[-1] = parts[-1][0] + text, style
            else:
                parts.append((text, style))
        return list(parts)

    def _cell(self, cell: tuple[int, int]) -> tuple[str, str]:
        if cell in self._characters:
            return self._characters[cell]
        bits, top = self._dots.get(cell, (0, -1))
        if not bits:
            return " ", ""
        layer = self._layers[top]
        return layer.plain if self.plain else chr(BRAILLE + bits), layer.style


def fitted(text: str, cells: int) -> str:
    """Return a text that takes just so many cells: filled up with spaces, or cut, which is shown."""
    return set_cell_size(text, cells) if cell_len(text) <= cells else set_cell_size(text, cells - 1) + "…"

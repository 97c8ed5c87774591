"""Drawing by dots, eight to a cell, in layers: braille where the terminal has it, else plain characters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sattrack.tui.panels import Row

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

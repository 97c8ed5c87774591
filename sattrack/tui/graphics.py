"""A camera's picture on the dots of a screen, and in the terminal's own pixels where it has sixels.

Sixels are six pixels above one another in one character, in one colour: chapter 14 of the VT330/VT340
programmer reference manual. A terminal paints what is sent for each colour over what was there.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.segment import ControlType, Segment
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from sattrack.tui.look import concrete

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray
    from textual.events import Click
    from textual.geometry import Region
    from textual.theme import Theme

    from sattrack.views.picture import PictureView

    Levels = NDArray[np.uint8]
    CellOfPixels = Callable[[], tuple[int, int] | None]

DOT = 2
"""Pixels of the terminal in a dot, across and down: lines are so wide."""
GREYS = 32
EVERY_S = 1.0
"""A new frame is shown as often: terminals take long to draw one."""
_ROWS = 6 // DOT
_BITS = np.array([((1 << DOT) - 1) << DOT * row for row in range(_ROWS)], np.uint8)
_RUN = re.compile(rb"(.)\1*", re.DOTALL)


class Mark(NamedTuple):
    """A dot of what is drawn over the picture, and its style."""

    x: int
    y: int
    style: str


class ImageSpot(NamedTuple):
    """A place in a frame: pixels from its middle, right and up."""

    right_px: float
    up_px: float


class ImagePlacement(NamedTuple):
    """How a frame lies on the dots of a screen: left upper corner, size, and dots in a pixel of it."""

    left: float
    top: float
    across: int
    down: int
    scale: float

    @classmethod
    def into(cls, across: int, down: int, picture: PictureView) -> ImagePlacement:
        """Return the largest that fits into so many dots, which are as wide as high."""
        scale = min(across / picture.width, down / picture.height)
        wide = max(1, min(across, round(picture.width * scale)))
        high = max(1, min(down, round(picture.height * scale)))
        return cls((across - wide) // 2, (down - high) // 2, wide, high, scale)

    def place(self, right_px: float, up_px: float) -> tuple[int, int]:
        """Return the dot of a place in the frame."""
        return (
            math.floor(self.left + 0.5 * self.across + right_px * self.scale),
            math.floor(self.top + 0.5 * self.down - up_px * self.scale),
        )

    def spot(self, x: float, y: float) -> ImageSpot:
        """Return the place of a dot."""
        right = (x - self.left - 0.5 * self.across) / self.scale
        return ImageSpot(right, (self.top + 0.5 * self.down - y) / self.scale)


class Painted(NamedTuple):
    """Dots as numbers of colours, shape (down, across), and the colours: red, green and blue, 0 to 255."""

    dots: NDArray[np.uint8]
    colours: list[tuple[int, ...]]

    def sixels(self) -> str:
        """Return what makes a terminal draw them, from where its cursor is."""
        down, across = self.dots.shape
        parts = [f'\x1bP0;1q"1;1;{DOT * across};{DOT * down}'.encode()]
        for number, colour in enumerate(self.colours):
            shares = ";".join(str(round(one / 2.55)) for one in colour)
            parts.append(f"#{number};2;{shares}".encode())
        for top in range(0, down, _ROWS):
            band = self.dots[top : top + _ROWS]
            bits = _BITS[: len(band), None]
            for number in np.unique(band).tolist():
                row = ((band == number) * bits).sum(axis=0, dtype=np.uint8) + 63
                parts.append(b"#%d%b$" % (number, _RUN.sub(_counted, row.tobytes())))
            parts.append(b"-")
        return b"".join(parts[:-1]).decode() + "\x1b\\"


def _counted(run: re.Match[bytes]) -> bytes:
    return b"!%d%b" % (DOT * len(run[0]), run[1])


class RealPicture(Widget):
    """Shows a picture in the terminal's pixels; `Pointed` tells where it was clicked.

    `cell` returns the pixels of a cell, across and down: they change with the terminal's font.
    """

    class Pointed(Message):
        """The picture was clicked at a dot."""

        def __init__(self, x: float, y: float) -> None:
            super().__init__()
            self.x, self.y = x, y

    def __init__(self, cell: CellOfPixels) -> None:
        super().__init__(id="real-picture")
        self._cell = cell
        self._state: tuple[object, ...] = ()
        self._shown_s = -math.inf
        self._sixels, self._fits = "", (0, 0)

    @property
    def possible(self) -> bool:
        """Whether the terminal still tells the pixels of its cells."""
        return self._cell() is not None

    @property
    def dots(self) -> tuple[int, int]:
        """So many dots fit, across and down."""
        across, down = self._cell() or (0, 0)
        return self.size.width * across // DOT, self.size.height * down // DOT

    def wants(self, state: tuple[object, ...], now_s: float) -> bool:
        """Tell whether to show a picture of such a state, its frame first: a new frame alone can wait."""
        if state == self._state or (state[1:] == self._state[1:] and now_s - self._shown_s < EVERY_S):
            return False
        self._state, self._shown_s = state, now_s
        return True

    def show(self, picture: Painted) -> None:
        """Show dots, as many as fit."""
        self._sixels, self._fits = picture.sixels(), self.dots
        self.refresh()

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return lines that leave alone what is shown, and the last of which draws the picture, whole.

        Beneath a dialog, and before there is a picture of this size, they are blank.
        """
        if not self.screen.is_active or crop.size != self.size or self._fits != self.dots:
            return [Strip.blank(crop.width, self.rich_style)] * crop.height
        x, y = self.region.offset
        beyond = f"\x1b[{crop.width}C"
        last = f"\x1b7\x1b[{y + 1};{x + 1}H{self._sixels}\x1b8{beyond}"
        # Told to be control, they are left alone by what turns colours and characters into others.
        above, drawn = (
            Strip([Segment(text, None, [(ControlType.CURSOR_FORWARD, crop.width)])], crop.width)
            for text in (beyond, last)
        )
        return [above] * (crop.height - 1) + [drawn]

    def on_click(self, event: Click) -> None:
        """Tell which dot was clicked, in the middle of a cell."""
        if cell := self._cell():
            x, y = ((at + 0.5) * pixels / DOT for at, pixels in zip(event.offset, cell, strict=True))
            self.post_message(self.Pointed(x, y))


def painted(
    levels: Levels, fit: ImagePlacement, dots: tuple[int, int], over: Iterable[Mark], theme: Theme
) -> Painted:
    """Return levels of light (0 to 255, as `fit` places them) on a dark ground, with marks over them."""
    across, down = dots
    dark, light = (_rgb(name, theme) for name in ("$background", "$foreground"))
    shares = np.linspace(0.0, 1.0, GREYS)[:, None]
    colours = [tuple(row) for row in np.rint(dark + shares * (light - dark)).astype(int).tolist()]
    canvas = np.zeros((down, across), np.uint8)
    top, left = int(fit.top), int(fit.left)
    canvas[top : top + fit.down, left : left + fit.across] = levels.astype(np.uint16) * (GREYS - 1) // 255
    numbers: dict[str, int] = {}
    for x, y, style in over:
        if top <= y < top + fit.down and left <= x < left + fit.across:
            canvas[y, x] = GREYS + numbers.setdefault(style, len(numbers))
    colours += [tuple(_rgb(style, theme).astype(int).tolist()) for style in numbers]
    return Painted(canvas, colours)


def _rgb(style: str, theme: Theme) -> NDArray[np.float64]:
    text = concrete(style, theme)
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)

"""A camera's picture on the dots of a screen, and in the terminal's own pixels where it can draw them.

Sixels are six pixels above one another in one character, in one colour: chapter 14 of the VT330/VT340
programmer reference manual. A terminal paints what is sent for each colour over what was there.

By kitty's protocol (https://sw.kovidgoyal.net/kitty/graphics-protocol/) a terminal keeps an image, and shows
parts of it in cells of text: their colour is its number, their accents are row and column of the part.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from base64 import b64encode
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.color import Color, ColorSystem
from rich.console import COLOR_SYSTEMS
from rich.segment import ControlType, Segment
from rich.style import Style
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from sattrack.tui.look import concrete
from sattrack.views.picture import ON_PAGE

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray
    from textual.events import Click
    from textual.theme import Theme

    from sattrack.tui.scene import CellOfPixels, TerminalPixels
    from sattrack.views.picture import PictureView

    Levels = NDArray[np.uint8]

DOT = 2
"""Pixels of the terminal in a dot, across and down: lines are so wide."""
GREYS = 32
EVERY_S = 1.0
"""A new frame is shown as often: terminals take long to draw one."""
_ROWS = 6 // DOT
_BITS = np.array([((1 << DOT) - 1) << DOT * row for row in range(_ROWS)], np.uint8)
_RUN = re.compile(rb"(.)\1*", re.DOTALL)
_CHUNK = 4096
_PLACEHOLDER = "\U0010eeee"
_IMAGE_COLOUR = Color.from_rgb(0, 95, 175)
"""The image's number. One of the 256 colours too, so that it stays the same where there are no more."""
_RANGES = """
    305 30d-30e 310 312 33d-33f 346 34a-34c 350-352 357 35b 363-36f 483-487 592-595 597-599 59c-5a1 5a8-5a9
    5ab-5ac 5af 5c4 610-617 657-65b 65d-65e 6d6-6dc 6df-6e2 6e4 6e7-6e8 6eb-6ec 730 732-733 735-736 73a 73d
    73f-741 743 745 747 749-74a 7eb-7f1 7f3 816-819 81b-823 825-827 829-82d 951 953-954 f82-f83 f86-f87
    135d-135f 17dd 193a 1a17 1a75-1a7c 1b6b 1b6d-1b73 1cd0-1cd2 1cda-1cdb 1ce0 1dc0-1dc1 1dc3-1dc9 1dcb-1dcc
    1dd1-1de6 1dfe 20d0-20d1 20d4-20d7 20db-20dc 20e1 20e7 20e9 20f0 2cef-2cf1 2de0-2dff a66f a67c-a67d
    a6f0-a6f1 a8e0-a8f1 aab0 aab2-aab3 aab7-aab8 aabe-aabf aac1 fe20-fe26 10a0f 10a38 1d185-1d189
    1d1aa-1d1ad 1d242-1d244
"""
_ACCENTS = "".join(
    chr(code)
    for first, _, last in (one.partition("-") for one in _RANGES.split())
    for code in range(int(first, 16), int(last or first, 16) + 1)
)
"""The protocol's signs for the rows and columns of an image, from 0."""


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

    def png(self) -> bytes:
        """Return them as a file, a pixel for each dot."""
        down, across = self.dots.shape
        rows = np.zeros((down, across + 1), np.uint8)
        rows[:, 1:] = self.dots
        header = struct.pack(">2I5B", across, down, 8, 3, 0, 0, 0)
        palette = bytes(share for colour in self.colours for share in colour)
        # The fastest compression: the picture is sent once, most often to the same machine.
        packed = zlib.compress(rows.tobytes(), 1)
        chunks = ((b"IHDR", header), (b"PLTE", palette), (b"IDAT", packed), (b"IEND", b""))
        return b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
            for name, data in chunks
        )

    def kitty(self, image: int, columns: int, rows: int) -> str:
        """Return what makes a terminal keep them as an image, for placeholders in so many cells."""
        data = b64encode(self.png()).decode()
        control = f"a=T,U=1,q=2,f=100,i={image},p=1,c={columns},r={rows},"
        parts = []
        for start in range(0, len(data), _CHUNK):
            more = int(start + _CHUNK < len(data))
            parts.append(f"\x1b_G{control}m={more};{data[start : start + _CHUNK]}\x1b\\")
            control = ""
        return "".join(parts)


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
        self._drawing = ""
        self._fits: tuple[int, ...] = ()

    @property
    def possible(self) -> bool:
        """Whether the terminal still tells the pixels of its cells."""
        return self._cell() is not None

    @property
    def dots(self) -> tuple[int, int]:
        """So many dots fit, across and down."""
        across, down = self._cell() or (0, 0)
        return self.size.width * across // DOT, self.size.height * down // DOT

    @property
    def _room(self) -> tuple[int, ...]:
        return *self.dots, *self.size

    def wants(self, state: tuple[object, ...], now_s: float) -> bool:
        """Tell whether to show a picture of such a state, its frame first: a new frame alone can wait."""
        if state == self._state or (state[1:] == self._state[1:] and now_s - self._shown_s < EVERY_S):
            return False
        self._state, self._shown_s = state, now_s
        return True

    def show(self, picture: Painted) -> None:
        """Show dots, as many as fit."""
        self._drawing, self._fits = picture.sixels(), self._room
        self.refresh()

    def forget(self) -> None:
        """Show nothing more: the screen is left."""

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return what shows the picture; beneath a dialog, and before there is one of this size, blanks."""
        if self.screen.is_active and self._fits == self._room and (lines := self._lines(crop)):
            return lines
        return [Strip.blank(crop.width, self.rich_style)] * crop.height

    def _lines(self, crop: Region) -> list[Strip]:
        """Return lines that leave alone what is shown, and the last of which draws the picture, whole."""
        if crop.size != self.size:
            return []
        x, y = self.region.offset
        beyond = f"\x1b[{crop.width}C"
        last = f"\x1b7\x1b[{y + 1};{x + 1}H{self._drawing}\x1b8{beyond}"
        above, drawn = (Strip([_control(text)], crop.width) for text in (beyond, last))
        return [above] * (crop.height - 1) + [drawn]

    def on_click(self, event: Click) -> None:
        """Tell which dot was clicked, in the middle of a cell."""
        if cell := self._cell():
            x, y = ((at + 0.5) * pixels / DOT for at, pixels in zip(event.offset, cell, strict=True))
            self.post_message(self.Pointed(x, y))


class PlacedPicture(RealPicture):
    """Shows it by kitty's protocol, in cells that are composed and cut as any text is."""

    def __init__(self, cell: CellOfPixels) -> None:
        super().__init__(cell)
        self._cells: list[Strip] = []
        self._style = Style.null()

    @property
    def _image(self) -> int:
        """The image's number, which is what the terminal is sent for the colour."""
        system = COLOR_SYSTEMS.get(self.app.console.color_system or "", ColorSystem.TRUECOLOR)
        sent = _IMAGE_COLOUR.downgrade(system)
        return int(sent.triplet.hex[1:], 16) if sent.triplet else sent.number or 0

    @property
    def possible(self) -> bool:
        """Whether the terminal still tells the pixels of its cells, and there are accents for its lines."""
        return super().possible and self.app.size.height <= len(_ACCENTS)

    def show(self, picture: Painted) -> None:
        """Show dots, as many as fit."""
        columns, rows = self.size
        style = self.rich_style + Style(color=_IMAGE_COLOUR)
        self._drawing = picture.kitty(self._image, columns, rows)
        if (self._fits, self._style) == (self._room, style):
            # A terminal shows a new image in the lines of which it is sent a cell again.
            self.refresh(Region(0, 0, columns, 1), Region(0, 0, 1, rows))
            return
        self._fits, self._style = self._room, style
        self._cells = self._cut(Region(0, 0, columns, rows))
        self.refresh()

    def _lines(self, crop: Region) -> list[Strip]:
        """Return the cells, and in the first line the image for them."""
        if crop.size != self.size:
            return self._cut(crop)
        return [Strip([_control(self._drawing), *self._cells[0]], crop.width), *self._cells[1:]]

    def _cut(self, crop: Region) -> list[Strip]:
        return [
            Strip([Segment(_placeholders(row, crop.x, crop.right), self._style)], crop.width)
            for row in range(crop.y, crop.bottom)
        ]

    def forget(self) -> None:
        """Have the terminal forget the image."""
        if self._cells and self.app._driver is not None:
            self._fits = ()
            self.app._driver.write(f"\x1b_Ga=d,d=I,q=2,i={self._image}\x1b\\")


class PageImage(RealPicture):
    """Has the page of `serve web` lay the picture over its cells, as an image of its own."""

    def __init__(self, cell: CellOfPixels) -> None:
        super().__init__(cell)
        self._told: dict[str, object] = {}

    def show(self, picture: Painted) -> None:
        """Show dots, as many as fit."""
        self._drawing, self._fits = b64encode(picture.png()).decode(), self._room
        self.refresh()

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return blanks; have the picture laid there, or taken away beneath a dialog."""
        self._lay(self._drawing if self.screen.is_active and self._fits == self._room else "")
        return [Strip.blank(crop.width, self.rich_style)] * crop.height

    def forget(self) -> None:
        """Have it taken away: the screen is left."""
        self._lay("")

    def on_hide(self) -> None:
        """Have it taken away: another page is shown."""
        self._lay("")

    def _lay(self, png: str) -> None:
        """Tell the page what to show, and where: shares of the screen's width and height."""
        from textual.drivers.web_driver import WebDriver

        driver, (columns, rows) = self.app._driver, self.app.size
        x, y, width, height = self.region
        place = x / columns, y / rows, width / columns, height / rows
        told: dict[str, object] = {"type": ON_PAGE, "png": png, "place": place if png else ()}
        if told != self._told and isinstance(driver, WebDriver):
            self._told = told
            driver.write_meta(told)


def _control(text: str) -> Segment:
    """Return what is written as it is: told to be control, it is not given other colours and characters."""
    return Segment(text, None, [(ControlType.CURSOR_FORWARD, 0)])


def _placeholders(row: int, first: int, beyond: int) -> str:
    """Return cells of an image's row; one without accents continues what is to its left."""
    accented = (f"{_PLACEHOLDER}{_ACCENTS[row]}{column}" for column in _ACCENTS[first:beyond])
    return "".join(accented) + _PLACEHOLDER * (beyond - max(first, len(_ACCENTS)))


def picture_of(pixels: TerminalPixels) -> RealPicture:
    """Return what shows a picture in a terminal's pixels."""
    if pixels.browser:
        return PageImage(pixels.cell)
    return PlacedPicture(pixels.cell) if pixels.kitty else RealPicture(pixels.cell)


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

"""The cameras' picture by kitty's graphics protocol, as a terminal shows it that keeps to the protocol."""

from __future__ import annotations

import asyncio
import base64
import io
import re
import unicodedata
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
import pytest
from PIL import Image
from rich.color import ColorSystem
from rich.segment import Segment
from rich.style import Style
from test_camera_screen import CELL, COLUMNS, LOOP, ROWS, FakePictures, picture, settle
from test_other_screens import HERE, FakeHelpers
from textual._compositor import Compositor
from textual.geometry import Region
from tui_builders import SKY, VIEW, FakeFeed, HandClock, changed

from sattrack.tui import graphics
from sattrack.tui.app import TrackApp
from sattrack.tui.camera_page import PictureBox
from sattrack.tui.feeds import News
from sattrack.tui.graphics import ImagePlacement, Painted, RealPicture
from sattrack.tui.scene import TerminalPixels

if TYPE_CHECKING:
    from collections.abc import Iterator

UPDATE, STRIPS = Compositor.render_update, Compositor.render_strips
"""As a screen draws for a terminal that is there."""
PLACEHOLDER = "\U0010eeee"
TOKEN = re.compile(
    r"\x1b_G(.*?)\x1b\\|\x1b\[([\d;?]*)([A-Za-z])|(\n)|([^\x1b])|\x1b\][^\x07]*\x07", re.DOTALL
)
FUSED = "0300 0301 0302 0303 0304 0306 0307 0308 0309 030A 030B 030C 030F 0311 0313 0314 0342 0653 0654"
"""What the protocol's table leaves out, because normalisation makes it one with a letter."""


class Terminal:
    """What a terminal keeps of images, and in which cells it shows which part of which."""

    def __init__(self) -> None:
        self.images: dict[int, Any] = {}
        self.placed: dict[int, tuple[int, int]] = {}
        self.cells: dict[tuple[int, int], tuple[int, int, int]] = {}
        self.drawn_since: dict[int, set[int]] = {}
        """The lines that were drawn since an image came: kitty shows it in no others."""
        self.chunks = 0
        self._loading: tuple[dict[str, str], str] | None = None
        self._x = self._y = self._colour = 0

    def take(self, text: str) -> None:
        end = 0
        for token in TOKEN.finditer(text):
            assert token.start() == end, text[end : end + 40]
            end = token.end()
            command, numbers, final, line, sign = token.groups()
            if command is not None:
                self._command(command)
            elif final == "H":
                self._y, self._x = (int(one) - 1 for one in numbers.split(";"))
            elif final == "m":
                self._paint([int(one or 0) for one in numbers.split(";")])
            elif line:
                self._x, self._y = 0, self._y + 1
            elif sign:
                self._write(sign)
        assert end == len(text)

    def _command(self, text: str) -> None:
        control, _, payload = text.partition(";")
        pairs = [one.partition("=") for one in control.split(",")]
        keys = {name: value for name, _, value in pairs}
        assert len(keys) == len(pairs)
        assert len(payload) <= 4096
        if keys.get("a") == "d":
            assert (keys["d"], keys["q"]) == ("I", "2")
            del self.images[int(keys["i"])]
            return
        if self._loading is None:
            assert (keys["a"], keys["U"], keys["q"], keys["f"]) == ("T", "1", "2", "100")
            self._loading, self.chunks = (keys, ""), 0
        else:
            assert set(keys) == {"m"}, "the others are the first chunk's"
        first, before = self._loading
        self._loading, self.chunks = (first, before + payload), self.chunks + 1
        if keys["m"] == "1":
            assert len(payload) % 4 == 0
            return
        loaded = Image.open(io.BytesIO(base64.b64decode(before + payload, validate=True)))
        assert loaded.format == "PNG"
        number = int(first["i"])
        self.images[number] = np.asarray(loaded.convert("RGB"))
        self.placed[number] = int(first["c"]), int(first["r"])
        self.drawn_since[number] = set()
        self._loading = None

    def _paint(self, numbers: list[int]) -> None:
        while numbers:
            first = numbers.pop(0)
            if first in {38, 48}:
                parts = [numbers.pop(0) for _ in range(3 if numbers.pop(0) == 2 else 1)]
                if first == 38:
                    self._colour = int.from_bytes(parts, "big")
            elif first in {0, 39}:
                self._colour = 0
            elif 30 <= first <= 37:
                self._colour = first - 30

    def _write(self, sign: str) -> None:
        if unicodedata.combining(sign):
            number, row, _ = self.cells[self._y, self._x - 1]
            accent = graphics._ACCENTS.index(sign)
            self.cells[self._y, self._x - 1] = (number, accent, -1) if row < 0 else (number, row, accent)
            return
        self.cells.pop((self._y, self._x), None)
        if sign == PLACEHOLDER:
            self.cells[self._y, self._x] = self._colour, -1, -1
            self.drawn_since.setdefault(self._colour, set()).add(self._y)
        self._x += 1

    def seen(self, region: Region) -> Any:
        """Return the image that is shown in a region, whole and nowhere else."""
        (number,) = self.images
        assert self.placed[number] == region.size
        assert self.cells == {
            (y, x): (number, y - region.y, x - region.x)
            for y in range(region.y, region.bottom)
            for x in range(region.x, region.right)
        }
        assert self.drawn_since[number] == set(range(region.y, region.bottom))
        return self.images[number]


class Watched:
    """A screen, and the terminal to which it writes."""

    def __init__(self, pixels: TerminalPixels | None, colours: ColorSystem = ColorSystem.TRUECOLOR) -> None:
        news = News((changed(VIEW, loop=LOOP),), session=HERE, sky=SKY, you=0)
        self.clock, self.looks, self.terminal = HandClock(), FakePictures(), Terminal()
        self.app = TrackApp(FakeFeed([news]), monotonic=self.clock, helpers=FakeHelpers(), pixels=pixels)
        self.app._screens.pictures = self.looks  # type: ignore[assignment]
        self.app.console._color_system = colours
        # Styles keep what they were written as for the terminal of an earlier screen.
        Style._add.cache_clear()
        Segment._split_cells.cache_clear()
        self.painted: list[Painted] = []
        self.written: list[str] = []

    @contextmanager
    def watch(self) -> Iterator[None]:
        display, paint = TrackApp._display, graphics.painted

        def displayed(app: TrackApp, screen: Any, renderable: Any) -> None:
            if hasattr(renderable, "render_segments") and not app._batch_count:
                self._take(renderable.render_segments(app.console))
            display(app, screen, renderable)

        def painted(*arguments: Any) -> Painted:
            self.painted.append(paint(*arguments))
            return self.painted[-1]

        with (
            patch.object(Compositor, "render_update", UPDATE),
            patch.object(Compositor, "render_strips", STRIPS),
            patch.object(TrackApp, "_display", displayed),
            patch("textual.drivers.headless_driver.HeadlessDriver.write", lambda _, text: self._take(text)),
            patch("sattrack.tui.camera_page.painted", painted),
        ):
            yield

    def _take(self, text: str) -> None:
        self.written.append(text)
        self.terminal.take(text)

    def frame(self, row: int, column: int) -> None:
        """Let a frame come with light in one place, when it is time for one."""
        light = bytearray(COLUMNS * ROWS)
        light[row * COLUMNS + column] = 255
        self.looks.coming = {"guide": picture(pixels=bytes(light), right_px=None, up_px=None, kind="none")}
        self.clock.now_s += graphics.EVERY_S

    def shows_what_was_painted(self, real: RealPicture) -> tuple[float, float]:
        """Return the pixels of the frame that are brightest in the terminal."""
        seen, painted = self.terminal.seen(real.region), self.painted[-1]
        assert (seen == np.array(painted.colours, np.uint8)[painted.dots]).all()
        y, x = np.unravel_index(int(seen.sum(axis=2, dtype=int).argmax()), seen.shape[:2])
        return tuple(ImagePlacement.into(*real.dots, picture()).spot(int(x), int(y)))


@pytest.mark.parametrize("colours", [ColorSystem.TRUECOLOR, ColorSystem.EIGHT_BIT, ColorSystem.STANDARD])
def test_each_frame_is_shown_in_its_cells_and_forgotten_at_the_end(
    colours: ColorSystem,
) -> None:
    watched = Watched(TerminalPixels(lambda: CELL, kitty=True), colours)
    app, terminal = watched.app, watched.terminal

    async def run() -> None:
        async with app.run_test(size=(80, 24)) as pilot:
            assert not terminal.images
            await pilot.press("6")
            await settle(app, pilot)
            real = app.query_one(RealPicture)
            assert (real.display, app.query_one(PictureBox).display) == (True, False)
            assert watched.shows_what_was_painted(real) == pytest.approx((162.0, 118.0), abs=4.0)

            watched.frame(ROWS // 2, COLUMNS // 4)
            await settle(app, pilot)
            assert watched.shows_what_was_painted(real) == pytest.approx((-158.0, -2.0), abs=4.0)

            await pilot.press("question_mark")
            watched.frame(0, 0)
            await settle(app, pilot)
            assert not terminal.cells, "it would be drawn over the help"
            await pilot.press("escape")
            await settle(app, pilot)
            watched.shows_what_was_painted(real)
            await pilot.resize_terminal(100, 30)
            await settle(app, pilot)
            watched.frame(5, 5)
            await settle(app, pilot)
            watched.shows_what_was_painted(real)
            await pilot.press("1")
            assert not terminal.cells
            app.exit()
            await pilot.pause()
        assert not terminal.images

    with watched.watch():
        asyncio.run(run())


def test_a_bright_frame_comes_in_chunks_and_its_cells_are_cut_as_text_is() -> None:
    watched = Watched(TerminalPixels(lambda: CELL, kitty=True))
    light = np.random.default_rng(1).integers(0, 256, COLUMNS * ROWS, np.uint8).tobytes()
    watched.looks.coming = {"guide": picture(pixels=light)}

    async def run() -> None:
        async with watched.app.run_test(size=(80, 24)) as pilot:
            await pilot.press("6")
            await settle(watched.app, pilot)
            real = watched.app.query_one(RealPicture)
            watched.shows_what_was_painted(real)
            assert watched.terminal.chunks > 2
            part = Terminal()
            for strip in real.render_lines(Region(3, 2, 5, 4)):
                part.take(strip.render(watched.app.console) + "\n")
            (number,) = watched.terminal.images
            assert part.cells == {(y, x): (number, y + 2, x + 3) for y in range(4) for x in range(5)}
            assert not part.images

    with watched.watch():
        asyncio.run(run())


@pytest.mark.parametrize(
    "size", [(80, 24), *(pytest.param(size, marks=pytest.mark.soak) for size in ((120, 40), (200, 60)))]
)
def test_a_frame_takes_fewer_bytes_than_by_sixels_even_where_it_is_black(size: tuple[int, int]) -> None:
    async def run(watched: Watched) -> int:
        async with watched.app.run_test(size=size) as pilot:
            await pilot.press("6")
            await settle(watched.app, pilot)
            watched.written.clear()
            watched.frame(ROWS // 2, COLUMNS // 4)
            await settle(watched.app, pilot)
            return len("".join(watched.written).encode())

    taken = {}
    for kitty in (True, False):
        watched = Watched(TerminalPixels(lambda: CELL, kitty=kitty))
        with watched.watch(), patch.object(watched.terminal, "take"):
            taken[kitty] = asyncio.run(run(watched))
    assert taken[True] < taken[False]


@pytest.mark.parametrize("pixels", [None, TerminalPixels(lambda: CELL)])
def test_a_terminal_that_did_not_answer_gets_no_graphics(pixels: TerminalPixels | None) -> None:
    watched = Watched(pixels)

    async def run() -> None:
        async with watched.app.run_test(size=(80, 24)) as pilot:
            await pilot.press("6")
            await settle(watched.app, pilot)
            watched.app.exit()
            await pilot.pause()

    with watched.watch(), patch.object(watched.terminal, "take"):
        asyncio.run(run())
    written = "".join(watched.written)
    assert "guide" in written
    assert "\x1b_" not in written
    assert PLACEHOLDER not in written


def test_rows_and_columns_are_numbered_by_the_signs_of_the_protocol() -> None:
    # Its paper takes marks above a letter that have no decomposition; those of Unicode 3.2 can be had here.
    signs, older = graphics._ACCENTS, unicodedata.ucd_3_2_0
    assert (len(signs), signs[:3]) == (297, "\u0305\u030d\u030e")
    assert list(signs) == sorted(set(signs))
    assert all(unicodedata.combining(one) == 230 and not unicodedata.decomposition(one) for one in signs)
    old = {
        chr(n) for n in range(0x110000) if older.combining(chr(n)) == 230 and not older.decomposition(chr(n))
    }
    assert {one for one in signs if older.category(one) != "Cn"} == old - {
        chr(int(one, 16)) for one in FUSED.split()
    }
    # A line that is longer than there are signs goes on without.
    assert graphics._placeholders(2, 0, 400).endswith(PLACEHOLDER * 103)

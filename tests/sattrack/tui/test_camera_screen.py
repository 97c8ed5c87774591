"""The cameras' screen: what it draws by colours and by characters, and what its keys send."""

from __future__ import annotations

import asyncio
import fcntl
import math
import os
import pty
import re
import select
import struct
import termios
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import msgspec
import numpy as np
import pytest
from test_other_screens import HERE, FakeHelpers, text_of
from textual._xterm_parser import XTermParser
from textual.drivers.headless_driver import HeadlessDriver
from textual.events import Key
from textual.geometry import Region
from tui_builders import SKY, VIEW, FakeFeed, HandClock, changed

from sattrack.tui import launch
from sattrack.tui.app import TrackApp
from sattrack.tui.camera_page import CameraDesk, PictureBox
from sattrack.tui.feeds import News
from sattrack.tui.graphics import DOT, ImagePlacement, ImageSpot, RealPicture
from sattrack.tui.scene import Appearance, TerminalPixels
from sattrack.views.messages import Guide, OffsetBy, StopNow
from sattrack.views.picture import PictureView, StarView
from sattrack.views.run import CameraView, LoopView, TwoAxesView

if TYPE_CHECKING:
    from textual.pilot import Pilot
    from textual.strip import Strip

LOOP = LoopView("camera", 0.4, 1.2, guided=True, last="taken")
SHOWN_TURNED = CameraView("guide", "fine", 25.0, True, 2.0, 5.0, 1.0, 0.0, 0.1, 0.0, 1.0)
"""As the run has it: mirrored, its up 25° from the tube's, and 5° more by its offsets."""
LOST = LoopView("lost", 12.0, 40.0, guided=True, last="taken")
WIDTH, HEIGHT, COLUMNS, ROWS = 640, 480, 160, 120
SCALE = 2.0
CELL = (10, 20)
"""Pixels of a terminal's cell."""
ASKED, PLACES = b"\x1b[c", b"\x1b_Gi=1;OK\x1b\\"
"""What every terminal is asked, and what one answers that has kitty's graphics."""


def picture(**changes: Any) -> PictureView:
    """Return a dark frame, the satellite a quarter of it to the right of the middle and a quarter up."""
    levels = bytearray(COLUMNS * ROWS)
    levels[(ROWS // 4) * COLUMNS + 3 * COLUMNS // 4] = 255
    made = PictureView(
        camera="guide",
        utc="2026-10-02T13:04:31.250Z",
        exposure_s=0.1,
        width=WIDTH,
        height=HEIGHT,
        columns=COLUMNS,
        rows=ROWS,
        pixels=bytes(levels),
        kind="point",
        right_px=162.0,
        up_px=118.0,
        sigma_px=0.2,
        snr=21.0,
        scale_arcsec_px=SCALE,
        rotation_deg=0.0,
        flipped=False,
        stars=(StarView(-200.0, -100.0, 1.0), StarView(100.0, -150.0, 0.1)),
    )
    return msgspec.structs.replace(made, **changes)


@dataclass
class FakePictures:
    """Hands out pictures, and keeps whether anybody looks."""

    coming: dict[str, PictureView] = field(default_factory=lambda: {"guide": picture()})
    open_for: int | None = None

    def open(self, pid: int) -> None:
        self.open_for = pid

    def take(self) -> dict[str, PictureView]:
        found, self.coming = self.coming, {}
        return found

    def close(self) -> None:
        self.open_for = None


@dataclass
class Shown:
    """What came of a screen: its text at the end, the rows of the picture, what was sent and looked at."""

    sent: list[Any]
    text: str
    colours: list[list[tuple[str, str]]]
    looked: list[int | None]


def shown(
    *keys: str,
    pictures: dict[str, PictureView] | None = None,
    size: tuple[int, int] = (80, 24),
    plain: bool = False,
    view: Any = None,
    session: Any = HERE,
    you: int = 0,
) -> Shown:
    """Open the cameras' screen, press keys, and return what came of it."""
    news = News((view or changed(VIEW, loop=LOOP),), session=session, sky=SKY, you=you)
    feed = FakeFeed([news])
    found = Shown([], "", [], [])

    async def run() -> None:
        app = TrackApp(
            feed,
            monotonic=HandClock(),
            helpers=FakeHelpers(),
            appearance=Appearance(plain=plain),  # type: ignore[arg-type]
        )
        looks = FakePictures({"guide": picture()} if pictures is None else pictures)
        app._screens.pictures = looks  # type: ignore[assignment]
        async with app.run_test(size=size) as pilot:
            found.looked.append(looks.open_for)
            await pilot.press("6")
            found.looked.append(looks.open_for)
            await settle(app, pilot)
            await pilot.press(*keys)
            await settle(app, pilot)
            found.text = text_of(app)
            box = app.query_one(PictureBox)
            for y in range(box.size.height):
                cells: list[tuple[str, str]] = []
                for segment in box.render_line(y):
                    style = segment.style
                    pair = (
                        "" if style is None or style.color is None else style.color.name,
                        "" if style is None or style.bgcolor is None else style.bgcolor.name,
                    )
                    cells += [pair] * len(segment.text)
                found.colours.append(cells)
            await pilot.press("1")
            found.looked.append(looks.open_for)

    asyncio.run(run())
    found.sent = feed.sent
    return found


async def settle(app: TrackApp, pilot: Pilot[None]) -> None:
    for _ in range(2):
        app.look()
        await pilot.pause()


def lights(found: Shown) -> dict[tuple[int, int], str]:
    """Return the colours of the picture's pixels by column and row."""
    pixels = {}
    for y, row in enumerate(found.colours):
        for x, (upper, lower) in enumerate(row):
            pixels[x, 2 * y], pixels[x, 2 * y + 1] = upper, lower
    return pixels


class TestPicture:
    def test_a_point_lies_where_it_is_in_the_frame_and_keeps_its_light_when_it_shrinks(self) -> None:
        found = shown(size=(120, 40))
        pixels = lights(found)
        wide, high = len(found.colours[0]), 2 * len(found.colours)
        brightest = [at for at, colour in pixels.items() if colour == "#d0d6dc"]
        scale = min(wide / WIDTH, high / HEIGHT)
        x, y = wide / 2 + 162.0 * scale, high / 2 - 118.0 * scale
        assert brightest
        assert all(math.hypot(at[0] + 0.5 - x, at[1] + 0.5 - y) < 1.8 for at in brightest)

    def test_it_says_what_leads_the_mount_what_was_seen_and_what_became_of_it(self) -> None:
        text = shown(size=(120, 40)).text
        for words in (
            "camera ±1.2″",
            "taken",
            "point",
            "SNR 21",
            "+324″ right",
            "+236″ up",
            "guide",
            "2″/px",
        ):
            assert words in text
        lost = changed(VIEW, loop=LoopView("lost", 12.0, 80.0, guided=False, last="held"))
        text = shown(size=(120, 40), view=lost).text
        assert "lost, predicted 12 s ±80″" in text
        assert "not followed" in text
        assert "held" in text

    def test_without_levels_of_light_a_chart_has_what_was_detected(self) -> None:
        found = shown(size=(80, 24), plain=True)
        assert found.text.isascii()
        rows = found.text.splitlines()
        assert [row.count("@") for row in rows if "@" in row] == [1]
        assert any("*" in row for row in rows)
        right, left = (next(row.index(mark) for row in rows if mark in row) for mark in "@*")
        assert right > left
        above = next(n for n, row in enumerate(rows) if "@" in row)
        assert above < next(n for n, row in enumerate(rows) if "*" in row)

    def test_a_small_screen_says_how_many_lines_it_hides(self) -> None:
        assert "more lines: 80 × 24" in shown(size=(80, 14)).text
        assert "more lines" not in shown(size=(80, 24)).text

    def test_nothing_is_asked_for_while_the_screen_is_not_shown(self) -> None:
        assert shown().looked == [None, 4321, None]

    def test_without_a_picture_it_says_how_to_get_one(self) -> None:
        assert "--camera" in shown(pictures={}).text


class TestKeys:
    def test_keys_guide_accept_and_reject(self) -> None:
        assert shown("g", "a", "r").sent == [Guide("off"), Guide("accept"), Guide("reject")]
        unguided = changed(VIEW, loop=msgspec.structs.replace(LOOP, guided=False))
        assert shown("g", view=unguided).sent == [Guide("on")]

    def test_what_was_detected_is_centred_by_east_and_north(self) -> None:
        # Up is at the position angle; not mirrored, right is 90° less than that.
        cases = (
            (0.0, False, -324, 236), (90.0, False, 236, 324), (0.0, True, 324, 236), (90.0, True, 236, -324)
        )  # fmt: skip
        feed = FakeFeed([News((changed(VIEW, loop=LOST),), session=HERE, sky=SKY, you=0)])

        async def run() -> None:
            app = TrackApp(feed, monotonic=HandClock(), helpers=FakeHelpers())  # type: ignore[arg-type]
            looks = FakePictures({})
            app._screens.pictures = looks  # type: ignore[assignment]
            async with app.run_test(size=(80, 24)) as pilot:
                await pilot.press("6")
                for rotation, flipped, east, north in cases:
                    feed.sent.clear()
                    looks.coming = {"guide": picture(rotation_deg=rotation, flipped=flipped)}
                    await settle(app, pilot)
                    await pilot.press("enter", "u")
                    values = [(one.what, one.how, round(3600.0 * one.value)) for one in feed.sent]  # type: ignore[union-attr]
                    assert values == [
                        ("ra_cos_dec_deg", "add", east),
                        ("dec_deg", "add", north),
                        ("ra_cos_dec_deg", "add", -east),
                        ("dec_deg", "add", -north),
                    ], (rotation, flipped)

        asyncio.run(run())

    @pytest.mark.parametrize("cameras", [(), (SHOWN_TURNED,)])
    def test_what_a_camera_shows_that_turns_with_its_tube_is_centred_by_the_sky(
        self, cameras: tuple[CameraView, ...]
    ) -> None:
        """Its image lies as the run has it, turned with the tube; 0 from the tube where nothing says."""
        desk, spot = CameraDesk(), ImageSpot(50.0, 100.0)
        desk.take({"guide": picture(rotation_deg=None, flipped=None)}, 0.0)
        desk.point(spot)
        axes = TwoAxesView(10.0, 40.0, 0.0, 0.0, field_angle_deg=60.0, field_rate_deg_s=0.0)
        view = changed(axes=axes, loop=LoopView("camera", 0.4, 1.2, cameras))

        found = desk.shift_deg(view)

        # Up is at the position angle; not mirrored, right is 90° less than that.
        angles = map(math.radians, (90.0, 180.0) if cameras else (60.0, -30.0))
        (up_east, up_north), (right_east, right_north) = ((math.sin(a), math.cos(a)) for a in angles)
        east, north = 100.0 * up_east + 50.0 * right_east, 100.0 * up_north + 50.0 * right_north
        assert found == pytest.approx((SCALE / 3600.0 * east, SCALE / 3600.0 * north), abs=1e-9)

    def test_an_image_that_was_found_to_lie_otherwise_is_centred_as_it_lies(self) -> None:
        """Set with up at 30°; found turned by 60° more, mirrored, with pixels of twice the size."""
        desk = CameraDesk()
        desk.take({"guide": picture(rotation_deg=30.0, flipped=False)}, 0.0)
        desk.point(ImageSpot(50.0, 100.0))
        found = CameraView(
            "guide", "fine", 30.0, False, SCALE, 60.0, 1.0, 1.0, 0.1, 0.0, 1.0, found_mirrored=True
        )
        # Up is east then, and right south.
        shift = desk.shift_deg(changed(loop=LoopView("camera", 0.4, 1.2, (found,))))
        assert shift == pytest.approx((2.0 * SCALE / 3600.0 * 100.0, -2.0 * SCALE / 3600.0 * 50.0), abs=1e-9)

    def test_the_cursor_is_centred_instead_and_esc_takes_it_away(self) -> None:
        step = WIDTH / 24 * SCALE
        lost = changed(VIEW, loop=LOST)
        sent = shown("left", "down", "enter", view=lost).sent
        assert all(isinstance(one, OffsetBy) for one in sent)
        assert [3600.0 * one.value for one in sent] == pytest.approx([step, -step])
        assert [round(3600.0 * one.value) for one in shown("left", "escape", "enter", view=lost).sent] == [
            -324,
            236,
        ]

    def test_a_camera_that_leads_and_would_undo_what_is_centred_is_left_aside(self) -> None:
        found = shown("left", "down", "enter")
        assert found.sent[0] == Guide("off")
        assert [type(one) for one in found.sent[1:]] == [OffsetBy, OffsetBy]
        assert "g guides by it again" in found.text
        already = shown("enter")
        assert already.sent == []
        assert "centres that already" in already.text
        rejecting = changed(VIEW, loop=msgspec.structs.replace(LOOP, last="it contradicts the estimate"))
        assert shown("enter", view=rejecting).sent[0] == Guide("off")
        aside = changed(VIEW, loop=msgspec.structs.replace(LOOP, guided=False))
        assert all(isinstance(one, OffsetBy) for one in shown("left", "enter", view=aside).sent)

    def test_without_a_scale_nothing_is_sent_and_it_says_why(self) -> None:
        found = shown("enter", pictures={"guide": picture(scale_arcsec_px=None)})
        assert found.sent == []
        assert "--scale" in found.text

    def test_an_onlooker_is_offered_no_keys_and_can_stop_all_the_same(self) -> None:
        away = msgspec.structs.replace(HERE, controller=9)
        found = shown("g", "a", "r", "enter", "space", session=away, you=3, size=(120, 40))
        assert found.sent == [StopNow()]
        assert "accept" not in found.text
        assert "centre" not in found.text
        assert "accept" in shown(size=(120, 40)).text


class TestRealPixels:
    def test_frames_are_drawn_as_sixels_and_a_click_puts_the_cursor_there(self) -> None:
        async def run() -> None:
            news = News((changed(VIEW, loop=LOOP),), session=HERE, sky=SKY, you=0)
            clock, looks, cells = HandClock(), FakePictures(), [CELL]
            pixels = TerminalPixels(lambda: cells[0])
            app = TrackApp(FakeFeed([news]), monotonic=clock, helpers=FakeHelpers(), pixels=pixels)
            app._screens.pictures = looks  # type: ignore[assignment]
            async with app.run_test(size=(80, 24)) as pilot:
                await pilot.press("6")
                await settle(app, pilot)
                real, box = app.query_one(RealPicture), app.query_one(PictureBox)
                assert (real.display, box.display) == (True, False)
                right, up = brightest(real)
                assert (right, up) == pytest.approx((162.0, 118.0), abs=4.0)
                fit = ImagePlacement.into(*real.dots, picture())
                x, y = (DOT * dot for dot in fit.place(right, up))
                await pilot.click(RealPicture, offset=(int(x) // CELL[0], int(y) // CELL[1]))
                assert app._screens.desk.cursor == pytest.approx((162.0, 118.0), abs=20.0), "within a cell"
                await pilot.press("escape")
                dark = bytearray(COLUMNS * ROWS)
                dark[ROWS // 2 * COLUMNS + COLUMNS // 4] = 255
                looks.coming = {"guide": picture(pixels=bytes(dark), right_px=None, up_px=None, kind="none")}
                await settle(app, pilot)
                assert brightest(real) == (right, up), "a terminal takes long to draw"
                clock.now_s += 1.0
                with patch.object(real, "refresh", wraps=real.refresh) as drawn:
                    await settle(app, pilot)
                assert drawn.called
                assert brightest(real) == pytest.approx((-158.0, -2.0), abs=4.0)
                cells[0] = None
                await settle(app, pilot)
                assert (real.display, box.display) == (False, True)
                cells[0] = CELL
                await settle(app, pilot)
                await pilot.press("question_mark")
                assert not any("\x1b" in strip.text for strip in lines(real)), (
                    "it would be drawn over the help"
                )

        asyncio.run(run())

    def test_a_browsers_page_is_told_where_to_lay_it_and_to_take_it_away(self) -> None:
        async def run() -> None:
            news = News((changed(VIEW, loop=LOOP),), session=HERE, sky=SKY, you=0)
            pixels = TerminalPixels(lambda: CELL, browser=True)
            app = TrackApp(FakeFeed([news]), monotonic=HandClock(), helpers=FakeHelpers(), pixels=pixels)
            app._screens.pictures = FakePictures()  # type: ignore[assignment]
            with (
                patch("textual.drivers.web_driver.WebDriver", HeadlessDriver),
                patch.object(HeadlessDriver, "write_meta", create=True) as page,
            ):
                async with app.run_test(size=(80, 24)) as pilot:
                    for keys, laid in (("6", True), ("question_mark", False), ("escape", True), ("1", False)):
                        await pilot.press(keys)
                        await settle(app, pilot)
                        if keys != "1":
                            assert not any(strip.text.strip() for strip in lines(app.query_one(RealPicture)))
                        told = page.call_args.args[0]
                        assert told["type"] == "picture"
                        assert bool(told["png"]) is laid, keys
                        if laid:
                            left, top, width, height = told["place"]
                            assert 0.0 <= left < left + width < 1.0
                            assert 0.0 < top < top + height < 1.0
                            assert b64decode(told["png"]).startswith(b"\x89PNG")

        asyncio.run(run())

    @pytest.mark.parametrize(
        ("answer", "terminal", "shows"),
        [
            (b"\x1b[?63;1;2;4;6;9;15;16;22;28c", "xterm", "sixels"),
            (b"\x1b[?62;4c", "dumb", None),
            (b"\x1b[?1;2c", "xterm", None),
            (b"\x1b[?64;14;24c", "xterm", None),
            (b"", "xterm", None),
            (b"6\x1b[?62;4c", "xterm", "sixels"),
            (b"\x1b[?62;4cq", "xterm", KeyboardInterrupt),
            (b" ", "xterm", KeyboardInterrupt),
            (PLACES + b"\x1b[?62;c", "xterm-kitty", "kitty"),
            (b"6" + PLACES + b"6\x1b[?62;52;c", "xterm-kitty", "kitty"),
            (PLACES + b"\x1b[?62;4c", "xterm", "sixels"),
            (PLACES, "xterm-kitty", None),
            (PLACES[:8], "xterm-kitty", None),
            (b"\x1b[?62;c" + PLACES, "xterm", None),
            (b"\x1b_Gi=1;EINVAL: a query of this kind\x1b\\\x1b[?62;c", "xterm", None),
            (b"\x1b_Gi=2;OK\x1b\\\x1b[?62;c", "xterm", None),
            (PLACES + b"q\x1b[?62;c", "xterm-kitty", KeyboardInterrupt),
        ],
    )
    def test_a_terminal_is_asked_and_keys_that_stop_are_not_lost(
        self, answer: bytes, terminal: str, shows: Any, on_terminal: OnTerminal
    ) -> None:
        with on_terminal(terminal) as (controller, ours):
            mode = termios.tcgetattr(ours)
            os.write(controller, answer)
            if shows is KeyboardInterrupt:
                with pytest.raises(KeyboardInterrupt):
                    launch._terminal_pixels(Appearance())
            else:
                found = launch._terminal_pixels(Appearance())
                how = found and ("kitty" if found.kitty else "sixels")
                assert (how, found and found.cell()) == (shows, CELL if shows else None)
            assert termios.tcgetattr(ours) == mode

    def test_an_answer_is_read_that_comes_in_pieces(
        self, on_terminal: OnTerminal, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with on_terminal("xterm-kitty") as (controller, _):
            os.write(controller, PLACES + b"\x1b[?62;c")
            read = os.read
            monkeypatch.setattr("sattrack.tui.launch.os.read", lambda descriptor, _: read(descriptor, 1))
            found = launch._terminal_pixels(Appearance())
            monkeypatch.undo()
        assert found is not None
        assert found.kitty

    def test_nothing_is_asked_where_pixels_are_not_wanted_or_not_known(
        self, on_terminal: OnTerminal, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with on_terminal("xterm") as (controller, ours):
            os.write(controller, b"\x1b[?62;4c")
            assert launch._terminal_pixels(Appearance(plain=True)) is None
            monkeypatch.setenv("NO_COLOR", "1")
            assert launch._terminal_pixels(Appearance()) is None
            monkeypatch.delenv("NO_COLOR")
            fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
            assert launch._terminal_pixels(Appearance()) is None
            assert not select.select([controller], [], [], 0.0)[0], "nothing was written"

    @pytest.mark.parametrize(
        ("terminal", "within", "asked"),
        [
            ("xterm", None, True),
            ("tmux-256color", None, False),
            ("screen", None, False),
            ("xterm", "TMUX", False),
            ("xterm", "STY", False),
        ],
    )
    def test_a_terminal_within_another_is_not_asked_for_graphics(
        self,
        terminal: str,
        within: str | None,
        asked: bool,
        on_terminal: OnTerminal,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        with on_terminal(terminal) as (controller, _):
            if within is not None:
                monkeypatch.setenv(within, "1")
            os.write(controller, b"\x1b[?62;4c")
            assert launch._terminal_pixels(Appearance()) is not None, "it is asked for sixels all the same"
            question = os.read(controller, 1024)
        assert (b"\x1b_G" in question) == asked
        assert question.endswith(ASKED)

    @pytest.mark.parametrize("answer", [b"\x1b[?62;4c", PLACES + b"\x1b[?62;c"])
    def test_an_answer_that_comes_late_has_nothing_sent_to_the_run(self, answer: bytes) -> None:
        parser = XTermParser()
        events = [*parser.feed(answer.decode()), *parser.feed("")]
        assert shown(*(event.key for event in events if isinstance(event, Key))).sent == []


OnTerminal = Callable[[str], AbstractContextManager[tuple[int, int]]]


@pytest.fixture
def on_terminal(monkeypatch: pytest.MonkeyPatch) -> OnTerminal:
    """Return what gives both ends of a terminal of a kind, on which is asked."""

    @contextmanager
    def opened(kind: str) -> Iterator[tuple[int, int]]:
        controller, ours = pty.openpty()
        mode = termios.tcgetattr(ours)
        mode[3] &= ~termios.ECHO
        termios.tcsetattr(ours, termios.TCSANOW, mode)
        monkeypatch.setattr(launch, "STDIN", ours)
        monkeypatch.setattr(launch, "STDOUT", ours)
        monkeypatch.setenv("TERM", kind)
        for name in ("NO_COLOR", *launch.WITHIN_ANOTHER):
            monkeypatch.delenv(name, raising=False)
        fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 80 * CELL[0], 24 * CELL[1]))
        try:
            yield controller, ours
        finally:
            os.close(ours)
            os.close(controller)

    return opened


def lines(real: RealPicture) -> list[Strip]:
    return real.render_lines(Region(0, 0, *real.size))


def brightest(real: RealPicture) -> tuple[float, float]:
    """Return the pixels of the frame that are brightest where the terminal has drawn what it was sent."""
    *above, last = lines(real)
    beyond = f"\x1b[{real.size.width}C"
    assert {strip.text for strip in above} == {beyond}
    x, y = real.region.offset
    found = re.fullmatch(
        rf"\x1b7\x1b\[{y + 1};{x + 1}H\x1bP0;1q(.*)\x1b\\\x1b8{re.escape(beyond)}", last.text
    )
    assert found
    light = of_sixels(found[1])
    assert light.shape == (real.size.height * CELL[1], real.size.width * CELL[0])
    y, x = np.unravel_index(int(light.argmax()), light.shape)
    return tuple(ImagePlacement.into(*real.dots, picture()).spot(x / DOT, y / DOT))


def of_sixels(text: str) -> Any:
    """Return the light of each pixel, as the VT340's manual has a terminal draw sixels; -1: not drawn."""
    size = re.match(r'"1;1;(\d+);(\d+)', text)
    assert size
    across, down = int(size[1]), int(size[2])
    light, colours = np.full((down + 6, across), -1), dict[str, int]()
    x = y = 0
    now = ""
    for number, shares, times, sixel, end in re.findall(
        r"#(\d+)((?:;\d+){4})?|(?:!(\d+))?([?-~])|([$-])", text[size.end() :]
    ):
        if shares:
            colours[number] = sum(int(one) for one in shares.split(";")[2:])
        elif number:
            now = number
        elif end:
            x, y = 0, y + 6 * (end == "-")
        else:
            for row in range(6):
                if (ord(sixel) - 63) >> row & 1:
                    light[y + row, x : x + int(times or 1)] = colours[now]
            x += int(times or 1)
    assert (light[:down] >= 0).all()
    assert (light[down:] == -1).all()
    return light[:down]

"""Themes, plain ASCII and the panels that show a pass' sky, on the screen itself."""

from __future__ import annotations

import asyncio
import string
from typing import TYPE_CHECKING

import pytest
from console_tui_builders import FakeConsole
from tui_builders import SKY, UTC_S, FakeFeed, HandClock, changed

from sattrack.tui.app import TrackApp
from sattrack.tui.console_app import ConsoleApp
from sattrack.tui.feeds import News
from sattrack.tui.look import THEME_NAMES, ascii_of
from sattrack.tui.scene import Appearance, can_show

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.color import Color
    from rich.segment import Segment

    from sattrack.views.run import TrackView

SMALL, LARGE, HUGE = (80, 24), (120, 40), (200, 60)
FULL = changed(
    warnings=("something to heed",),
    ra_rate_reached_deg_s=1.5,
    dec_rate_reached_deg_s=-0.08,
    link={"delay_ms": 0.42, "clock_offset_s": -0.553},
)


def screens(
    size: tuple[int, int],
    *steps: tuple[str, ...],
    view: TrackView = FULL,
    appearance: Appearance = Appearance(),  # noqa: B008 - frozen
    sky: bool = True,
) -> list[list[list[Segment]]]:
    """Return the segments of the screen, row by row, after each step of keys."""

    async def run() -> list[list[list[Segment]]]:
        feed = FakeFeed()
        news = News(
            (changed(utc_s=UTC_S - 0.5, error={"utc_s": UTC_S - 0.5}), view), sky=SKY if sky else None
        )
        feed.coming.append(news)
        app = TrackApp(feed, monotonic=HandClock(), appearance=appearance)
        found = []
        async with app.run_test(size=size) as pilot:
            for keys in steps:
                await pilot.press(*keys)
                for _ in range(2):
                    app.plot()
                    await pilot.pause()
                app.look()
                await pilot.pause()
                found.append([list(strip) for strip in app.screen._compositor.render_strips()])
        assert feed.sent == [], "keys of the look say nothing to the mount"
        return found

    return asyncio.run(run())


def lines(screen: list[list[Segment]]) -> list[str]:
    return ["".join(segment.text for segment in row) for row in screen]


def each_colour(screen: list[list[Segment]], judge: Callable[[str, Color, Color], None]) -> int:
    """Hand text, foreground and background of each segment to `judge`; return how many had both."""
    seen = 0
    for row in screen:
        for text, style, _ in row:
            if style is not None and style.color is not None and style.bgcolor is not None:
                seen += 1
                colours = (style.bgcolor, style.color) if style.reverse else (style.color, style.bgcolor)
                judge(text, *colours)
    return seen


def light(colour: Color) -> float:
    """Return the relative luminance of a colour (WCAG 2.2)."""
    parts = [c / 255.0 for c in colour.get_truecolor()]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def is_red(text: str, front: Color, back: Color) -> None:
    for colour in (front, back):
        assert colour.get_truecolor()[1:] == (0, 0), (text, colour)


@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_themes_change_colours_and_nothing_else_and_by_red_there_is_only_red(size: tuple[int, int]) -> None:
    assert THEME_NAMES == ("night", "red", "contrast")
    # `t` goes on to the next theme, and round.
    night, red, contrast, again = screens(size, (), ("t",), ("t",), ("t",))
    assert again == night
    assert lines(red) == lines(night)
    assert lines(contrast) == lines(night)
    assert red != night

    def is_seen(text: str, front: Color, back: Color) -> None:
        between = {*text} <= {*" ", *map(chr, range(0x2500, 0x2580))}
        ratio = (max(light(front), light(back)) + 0.05) / (min(light(front), light(back)) + 0.05)
        assert between or ratio >= 7.0, (text, front, back)

    assert each_colour(red, is_red) > 50
    assert each_colour(contrast, is_seen) > 50


def test_a_screen_that_begins_in_a_theme_is_as_one_that_is_changed_to_it() -> None:
    _, *changed_to = screens(SMALL, (), ("t",), ("t",))
    assert changed_to == [screens(SMALL, (), appearance=Appearance(name))[0] for name in THEME_NAMES[1:]]


def test_the_console_looks_as_it_is_told_and_t_changes_that() -> None:
    async def run() -> tuple[list[list[Segment]], str]:
        feed = FakeConsole()
        app = ConsoleApp(feed, monotonic=HandClock(), appearance=Appearance("red", plain=True))
        async with app.run_test(size=SMALL) as pilot:
            await pilot.pause()
            shown = [list(strip) for strip in app.screen._compositor.render_strips()]
            await pilot.press("t")
            return shown, app.theme

    shown, after = asyncio.run(run())
    assert each_colour(shown, is_red) > 50
    assert "".join(lines(shown)).isascii()
    assert after == "contrast"


@pytest.mark.parametrize(
    ("size", "steps"),
    [(SMALL, ((), ("v",))), (LARGE, ((),))],
)
def test_without_unicode_every_cell_is_ascii_and_none_is_lost(
    size: tuple[int, int], steps: tuple[tuple[str, ...], ...]
) -> None:
    plain = [lines(one) for one in screens(size, *steps, appearance=Appearance(plain=True))]
    for screen in plain:
        assert [len(row) for row in screen] == [size[0]] * size[1]
        assert all(row.isascii() for row in screen)
    text = "\n".join(plain[0])
    for figure in ("alt    45.3d", "@", "Sun", "-0.02", "## RA on the sky   .. Dec"):
        assert figure in text, figure


def test_ascii_is_asked_for_by_terminals_that_have_nothing_else() -> None:
    assert can_show("utf-8")
    assert not any(can_show(name) for name in ("ascii", "latin-1", "cp437", "no such", None))
    assert ascii_of("−1.5° ±3″ ← █▏⠀⠒ ╭─╮ é") == '-1.5d ~3" < #| . +-+ ?'
    assert ascii_of(string.printable) == string.printable
    # A character of two cells, and one that lies on the one before it.
    assert ascii_of("天宫 Jose\u0301") == "???? Jose"


def test_the_small_screen_with_the_sky() -> None:
    rows = lines(screens(SMALL, (), view=changed(FULL, warnings=()))[0])
    assert [row[60:].rstrip() for row in rows[8:18]] == [
        "    ⢀⡠⣔⣒⠮⠽N⠷⣒⣢⢄⡀",
        "  ⢠⣼⠗⠋⠁ ⡀ ⡀⢀ ⠈⠙⠺⣧⡄",
        " ⣴⠟⠁⢀ ⠂ ⢠⠖P⡄ ⠐ ⡀⠈⠻⣦",
        "⢰⡟ ⢀Moon⠌⠓⠚⠡    ⡀ ⢻⡆",
        "set⢀   ⠁ 80°⠈   rise",
        "E⡉⠑⠲⠤⠄⢌⣀⠤⠤⠤⠤⢀⡁● ⠖ ⢈W",
        "⠸⣧  ⠄   ⠂ ⠄⠐   ⠠  ⣼⠇",
        " ⠻⣦  ⠐ ⡀  ⣠⡚⢉⠳⡆  ⣴⠟",
        "  ⠘⢻⣤⡀   ⠁⠻Sun⢃⣤⡟⠃",
        "    ⠈⠙⠻⠶⢦S⣤⡴⠶⠟⠋⠁",
    ]
    assert [row.rstrip() for row in rows[-6:]] == [
        " link     up  20.0/s  age 0.03 s  delay 0.4 ms   lost 0   late 0   rejected 0",
        " rates    RA +1.235 of 6 °/s ██┃·········  Dec −0.081 of 6 °/s ┃···········",
        " along    +0.050 s  asked +0.100 s   ← behind  → ahead on track by 0.1 s",
        " across   −0.0100°  asked −0.0200°   ↑ left  ↓ right of motion by 0.01°",
        " elements 12.8 h  expect 2σ ±400″ ±100″ in 15.0′  clock −0.553 s  rec pass.mcap",
        " ←→ along  ↑↓ across  [ ] step  p pause  1-6 more  SPACE STOP   q leave  ? help",
    ]


@pytest.mark.parametrize("size", [LARGE, HUGE])
def test_the_larger_screens_with_the_sky_say_all_of_it(size: tuple[int, int]) -> None:
    rows = lines(screens(size, ())[0])
    text = "\n".join(rows)
    for figure in (
        *("rise 13:01", "set 13:08", "80°", "pole", "Sun", "Moon", "● satellite", "+ mount", "east is left"),
        *("±400″", "±100″", "15.0′", "delay 0.4 ms", "clock −0.553 s", "reached  +1.500", "reached  −0.080"),
        *("12.8 h old", "pass.mcap", "RMS 10 s 0.44″"),
    ):
        assert figure in text, figure
    assert "…" not in text
    assert ("keyhole 10.0°" in text) is (size == HUGE)


@pytest.mark.parametrize(("size", "rows_high"), [(SMALL, 20), (LARGE, 34)])
def test_v_gives_the_sky_all_the_room_and_back(size: tuple[int, int], rows_high: int) -> None:
    first, alone, again = screens(size, (), ("v",), ("v",), view=changed(FULL, warnings=()))
    text = "\n".join(lines(alone))
    chart = [row for row in lines(alone) if sum("⠁" <= cell <= "⣿" for cell in row) >= 2]
    assert len(chart) >= rows_high - 2
    for figure in (
        "● satellite",
        "keyhole 10.0°",
        "skyline   2° to 10°",
        "TRACKING",
        "SPACE STOP",
        "in 4:17",
        "RMS 10 s 0.44″",
        "across −0.12″",
    ):
        assert figure in text, figure
    assert "error on the sky" not in text
    assert lines(again) == lines(first)


def test_without_a_pass_told_there_is_no_chart_and_v_does_nothing() -> None:
    first, pressed = screens(LARGE, (), ("v",), sky=False)
    assert lines(first) == lines(pressed)
    text = "\n".join(lines(first))
    assert "east is left" not in text
    assert "no error" in text

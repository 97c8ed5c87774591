"""Every screen of a run as text and colours, kept in files: `python tests/sattrack/tui/snapshots.py` writes
them.

Below the rows of a screen stand, for each theme, the same rows as runs of styles: `12a 3b` is twelve cells in
the style `a`, which the lines before name.
"""

from __future__ import annotations

import asyncio
import sys
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

FOLDER = Path(__file__).with_name("snapshots")
sys.path.insert(0, str(Path(__file__).parent))

from test_camera_screen import LOOP, FakePictures  # noqa: E402
from test_other_screens import FakeHelpers, schedule_view  # noqa: E402
from test_screen import following  # noqa: E402
from tui_builders import SKY, VIEW, FakeFeed, HandClock, changed  # noqa: E402

from sattrack.tui.app import TrackApp  # noqa: E402
from sattrack.tui.feeds import News  # noqa: E402
from sattrack.tui.scene import CAMERA, PAGES, Appearance  # noqa: E402
from sattrack.views.run import (  # noqa: E402
    STARTER,
    Armed,
    PauseView,
    SessionView,
    Watcher,
)

if TYPE_CHECKING:
    from textual.strip import Strip

SIZES = ((80, 24), (120, 40))
THEMES = ("night", "red")
DIALOGS = {"help": ("question_mark",), "leave": ("q",)}
PAUSED = {"paused": ("1",), "jog": ("3",)}
NAMES = (*PAGES.values(), *DIALOGS, *PAUSED)
SESSION = SessionView(
    STARTER,
    (Watcher(4, "pts/7"),),
    1,
    said="pts/7 gave control up",
    queue=(Armed(103, VIEW.utc_s + 3600.0, "SAT 103"),),
    takes_others=True,
)


async def screens(size: tuple[int, int], theme: str) -> dict[str, list[Strip]]:
    """Return every screen, and what can lie over the live one, as Textual has them."""
    views = tuple(changed(view, recording="/night.run/recordings/a.mcap") for view in following(170.0))
    resting = PauseView(views[-1].utc_s - 5.0, at_rest=True, jogging=False)
    paused = changed(views[-1], phase="paused", pause=resting, ra_rate_deg_s=0.0, dec_rate_deg_s=0.0)
    feed = FakeFeed([News(views, session=SESSION, sky=SKY)])
    app = TrackApp(feed, monotonic=HandClock(), appearance=Appearance(theme), helpers=FakeHelpers())  # type: ignore[arg-type]
    app._screens._read = lambda _: schedule_view()
    app._screens.pictures = FakePictures()  # type: ignore[assignment]
    found: dict[str, list[Strip]] = {}
    async with app.run_test(size=size) as pilot:
        for name, keys in {**{page: (key,) for key, page in PAGES.items()}, **DIALOGS, **PAUSED}.items():
            if name in PAUSED:
                feed.coming.append(News((paused,)))
            if name in {CAMERA, "help"}:
                feed.coming.append(News((changed(views[-1], loop=LOOP if name == CAMERA else None),)))
            await pilot.press("1", *keys)
            for _ in range(3 if name in {"live", "paused"} else 1):
                # The chart's width follows from the layout, and the layout from that.
                app.look()
                app.plot()
                await pilot.pause()
            found[name] = app.screen._compositor.render_strips()
            app._close_dialogs()
    return found


def snapshot(name: str, drawn: dict[str, dict[str, list[Strip]]]) -> str:
    """Return a screen's rows, and their styles by theme."""
    first = next(iter(drawn.values()))[name]
    lines = ["".join(segment.text for segment in strip).rstrip() for strip in first]
    for theme, found in drawn.items():
        lines += ["", f"== {theme}"]
        names: dict[str, str] = {}
        rows = []
        for strip in found[name]:
            cells = [str(segment.style) for segment in strip for _ in segment.text]
            runs = [
                (names.setdefault(style, _letter(len(names))), len(list(run)))
                for style, run in groupby(cells)
            ]
            rows.append(" ".join(f"{count}{letter}" for letter, count in runs))
        lines += [f"{letter}: {style}" for style, letter in names.items()] + rows
    return "\n".join(lines) + "\n"


def _letter(number: int) -> str:
    return (
        chr(ord("a") + number)
        if number < 26
        else f"{chr(ord('a') + number // 26 - 1)}{chr(ord('a') + number % 26)}"
    )


def snapshots(size: tuple[int, int]) -> dict[str, str]:
    """Return those of one size by their files' names."""
    drawn = {theme: asyncio.run(screens(size, theme)) for theme in THEMES}
    return {file_name(name, size): snapshot(name, drawn) for name in NAMES}


def file_name(name: str, size: tuple[int, int]) -> str:
    """Return the name of a screen's file."""
    return f"{name}-{size[0]}x{size[1]}.txt"


def main() -> None:
    """Write the files."""
    FOLDER.mkdir(exist_ok=True)
    for size in SIZES:
        for name, text in snapshots(size).items():
            (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

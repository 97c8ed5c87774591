"""Draw the screen of a real pass, followed in virtual time, as SVG: `python -m sattrack.tui.picture FILE`."""

from __future__ import annotations

import asyncio
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack import practice
from sattrack.runtime.fly import fly_virtual
from sattrack.runtime.pass_scene import pass_scene
from sattrack.runtime.prepare import RunRequest, prepare
from sattrack.tui.app import NIGHT_LOOK, TrackApp
from sattrack.tui.feed import News
from tle.elements import Elements

if TYPE_CHECKING:
    from sattrack.messages import Message
    from sattrack.tui.appearance import Appearance
    from sattrack.view import PassView, TrackView

COLUMNS, ROWS = 120, 40
SKYLINE = ((0.0, 8.0), (60.0, 5.0), (110.0, 12.0), (170.0, 6.0), (200.0, 6.0), (250.0, 9.0), (310.0, 14.0))
FIELD_DEG = 0.25
_MENDED = (
    (re.compile(r"@font-face\s*\{[^}]*\}\s*"), ""),
    (re.compile(r"<!--.*?-->\s*", re.DOTALL), ""),
    (
        re.compile(r"font-family:\s*Fira Code[^;]*;"),
        "font-family: 'DejaVu Sans Mono', Menlo, Consolas, monospace;",
    ),
    # The cells are 12.2 wide; so are these fonts at this size, for viewers that know no textLength.
    (re.compile(r"font-size: 20px;"), "font-size: 20.26px;"),
    (re.compile(r"<text "), '<text xml:space="preserve" '),
)


class RecordedFeed:
    """Views that are there already; messages go nowhere."""

    def __init__(self, views: list[TrackView], sky: PassView | None = None) -> None:
        self._views = tuple(views)
        self._sky = sky

    def news(self) -> News:
        """Return all of them, once."""
        views, self._views = self._views, ()
        return News(views, sky=self._sky)

    def send(self, message: Message) -> bool:
        """Take a message to nobody."""
        del message
        return False


def practice_views(until_culmination: bool = True) -> list[TrackView]:
    """Return the views of the practice pass up to its culmination, or all, half a second apart."""
    views: list[TrackView] = []
    fly_virtual(prepare(_request()), views.append)
    return [view for view in views if view.utc_s <= view.culminate_utc_s or not until_culmination]


def practice_sky() -> PassView:
    """Return what is told of that pass beforehand: a skyline and a field of view are made up for it."""
    return msgspec.structs.replace(pass_scene(prepare(_request()).facts), horizon=SKYLINE)


def _request() -> RunRequest:
    return RunRequest(
        satellite=practice.NAME,
        mount_url="sim",
        elements=[Elements.from_tle(practice.LINE_1, practice.LINE_2, practice.NAME)],
        site=practice.SITE.place(),
        clock_option=practice.BEFORE_PASS,
        min_alt_deg=10.0,
        virtual=True,
        fov_deg=FIELD_DEG,
    )


async def draw(
    views: list[TrackView],
    columns: int = COLUMNS,
    rows: int = ROWS,
    sky: PassView | None = None,
    keys: tuple[str, ...] = (),
    appearance: Appearance = NIGHT_LOOK,
) -> str:
    """Return the screen as it stands after some views and keys, as SVG without references elsewhere."""
    app = TrackApp(RecordedFeed(views, sky), monotonic=lambda: 0.0, appearance=appearance)
    async with app.run_test(size=(columns, rows)) as pilot:
        await pilot.press(*keys)
        await pilot.pause()
        for _ in range(3):
            # The chart's width follows from the layout, and the layout from that.
            app.plot()
            await pilot.pause()
        svg = app.export_screenshot(title=f"sattrack: {views[-1].name}")
    return self_contained(svg)


def self_contained(svg: str) -> str:
    """Return an exported picture without fonts and remarks that point elsewhere, spaces kept."""
    for pattern, plain in _MENDED:
        svg = pattern.sub(plain, svg)
    return svg


def main() -> None:
    """Write the picture to the file named on the command line."""
    if len(sys.argv) != 2:
        click.echo("usage: python -m sattrack.tui.picture FILE.svg", err=True)
        sys.exit(2)
    Path(sys.argv[1]).write_text(asyncio.run(draw(practice_views())), encoding="utf-8")


if __name__ == "__main__":
    main()

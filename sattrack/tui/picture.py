"""Draw the screen of a real pass, followed in virtual time, as SVG: `python -m sattrack.tui.picture FILE`."""

from __future__ import annotations

import asyncio
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sattrack import practice
from sattrack.runtime.fly import fly_virtual
from sattrack.runtime.prepare import RunRequest, prepare
from sattrack.tui.app import TrackApp
from sattrack.tui.feed import News
from tle.elements import Elements
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.messages import Message
    from sattrack.view import TrackView

COLUMNS, ROWS = 120, 40
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

    def __init__(self, views: list[TrackView]) -> None:
        self._views = tuple(views)

    def news(self) -> News:
        """Return all of them, once."""
        views, self._views = self._views, ()
        return News(views)

    def send(self, message: Message) -> bool:
        """Take a message to nobody."""
        del message
        return False


def practice_views() -> list[TrackView]:
    """Return the views of the practice pass up to its culmination, half a second apart."""
    where = practice.SITE
    request = RunRequest(
        satellite=practice.NAME,
        mount_url="sim",
        elements=[Elements.from_tle(practice.LINE_1, practice.LINE_2, practice.NAME)],
        site=Site(where.latitude_deg, where.longitude_deg, where.height_m),
        clock_option=practice.BEFORE_PASS,
        min_alt_deg=10.0,
        virtual=True,
    )
    views: list[TrackView] = []
    fly_virtual(prepare(request), views.append)
    return [view for view in views if view.utc_s <= view.culminate_utc_s]


async def draw(views: list[TrackView], columns: int = COLUMNS, rows: int = ROWS) -> str:
    """Return the screen as it stands after some views, as SVG without references to anything elsewhere."""
    app = TrackApp(RecordedFeed(views), monotonic=lambda: 0.0)
    async with app.run_test(size=(columns, rows)) as pilot:
        await pilot.pause()
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

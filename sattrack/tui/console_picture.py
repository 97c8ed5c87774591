"""Draw the manual console's screen as SVG: `python -m sattrack.tui.console_picture FILE [COLUMNS ROWS]`.

The mount is a simulated one in a process of its own, met over UDP and asked to slew; the clock is set to the
practice pass.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sattrack.core.own_program import own_program
from sattrack.mount.model import Slew
from sattrack.runtime import practice
from sattrack.tui.child import ConsoleProcess
from sattrack.tui.console_app import ConsoleApp
from sattrack.tui.console_feed import Latest
from sattrack.tui.picture import self_contained
from sattrack.views.messages import Leave

if TYPE_CHECKING:
    from sattrack.views.messages import ConsoleMessage
    from sattrack.views.run import ConsoleView

COLUMNS, ROWS = 120, 40
EAST_OF_MERIDIAN_DEG = 20.0
DEC_DEG = 40.0
WITHIN_S = 30.0


class StillFeed:
    """One view, for good; orders go nowhere."""

    def __init__(self, view: ConsoleView) -> None:
        self._view = view

    def latest(self) -> Latest:
        """Return it."""
        return Latest(self._view)

    def tell(self, order: ConsoleMessage) -> bool:
        """Take an order to nobody."""
        del order
        return False


def slewing_view() -> ConsoleView:
    """Return the view of a mount half-way through a slew."""
    options = ["--mount", "sim", "--clock", practice.BEFORE_PASS, "--stream", "--control"]
    console = ConsoleProcess([*own_program(), "mount", "watch", *options])
    asked = False
    try:
        console.wait_first_view()
        while True:
            latest = console.latest()
            view = latest.view
            if latest.ended:
                raise click.ClickException("the console ended before it slewed")
            if view is None or view.status is None:
                continue
            if not asked and view.link.received > 40:
                ra_deg = (view.status.sidereal_h * 15.0 + EAST_OF_MERIDIAN_DEG) % 360.0
                asked = console.tell(Slew(ra_deg, DEC_DEG))
            if asked and view.status.slewing and view.status.dec_deg > DEC_DEG / 2.0:
                return view
    finally:
        console.tell(Leave())
        console.close_input()
        console.wait(WITHIN_S)
        console.close()


async def draw(
    view: ConsoleView, columns: int = COLUMNS, rows: int = ROWS, keys: tuple[str, ...] = ()
) -> str:
    """Return the screen of a view, after some keys, as SVG without references to anything elsewhere."""
    app = ConsoleApp(StillFeed(view), monotonic=lambda: 0.0)
    async with app.run_test(size=(columns, rows)) as pilot:
        await pilot.press(*keys)
        await pilot.pause()
        svg = app.export_screenshot(title="sattrack mount watch")
    return self_contained(svg)


def main() -> None:
    """Write the picture to the file named on the command line."""
    if len(sys.argv) not in (2, 4):
        click.echo("usage: python -m sattrack.tui.console_picture FILE.svg [COLUMNS ROWS]", err=True)
        sys.exit(2)
    columns, rows = (COLUMNS, ROWS) if len(sys.argv) == 2 else (int(sys.argv[2]), int(sys.argv[3]))
    Path(sys.argv[1]).write_text(asyncio.run(draw(slewing_view(), columns, rows)), encoding="utf-8")


if __name__ == "__main__":
    main()

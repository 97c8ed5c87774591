"""Draw the screens as SVG: `python -m tools.screens FOLDER`.

A run's screens are those of a real pass in virtual time. The console's mount is a simulated one in a process
of its own, met over UDP and asked to slew; the clock is set to the practice pass.
"""

from __future__ import annotations

import asyncio
import os
import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.core.process import self_command
from sattrack.mount.model import Slew
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.runtime.pass_scene import pass_scene
from sattrack.tui.app import TrackApp
from sattrack.tui.console_app import ConsoleApp
from sattrack.tui.feeds import ConsoleProcess, HelperOptions, Helpers, Latest, News
from sattrack.tui.replay_app import ReplayApp, Tape, TapeFeed
from sattrack.tui.scene import Appearance
from sattrack.views.messages import Leave
from tle.elements import Elements

if TYPE_CHECKING:
    from sattrack.views.messages import ConsoleMessage, Message, SessionMessage
    from sattrack.views.run import ConsoleView, PassView, TrackView

COLUMNS, ROWS = 120, 40
LOOK_EVERY_S = 0.05
SKYLINE = ((0.0, 8.0), (60.0, 5.0), (110.0, 12.0), (170.0, 6.0), (200.0, 6.0), (250.0, 9.0), (310.0, 14.0))
FIELD_DEG = 0.25
EAST_OF_MERIDIAN_DEG = 20.0
DEC_DEG = 40.0
END_WITHIN_S = 30.0
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


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture: its size in cells, theme, keys pressed before it, and whether as a recording."""

    columns: int
    rows: int
    theme: str = "night"
    keys: tuple[str, ...] = ()
    replayed: bool = False


SHOTS = {
    "tui.svg": Shot(COLUMNS, ROWS),
    "tui-small-red.svg": Shot(80, 24, "red"),
    "tui-sky.svg": Shot(80, 24, "contrast", ("v",)),
    "tui-tonight.svg": Shot(80, 24, keys=("2", "down", "down")),
    "tui-replay.svg": Shot(80, 24, keys=("p",), replayed=True),
}


class RecordedFeed:
    """Views that are there already; messages go nowhere. `ended`: there will be no more."""

    def __init__(self, views: list[TrackView], sky: PassView | None = None, ended: bool = False) -> None:
        self._views = tuple(views)
        self._sky = sky
        self._ended = ended

    def news(self) -> News:
        """Return all of them, once."""
        views, self._views = self._views, ()
        return News(views, self._ended, sky=self._sky)

    def send(self, message: Message | SessionMessage) -> bool:
        """Take a message to nobody."""
        del message
        return False


def practice_views(clock: str = demo_pass.BEFORE_PASS, min_alt_deg: float = 10.0) -> list[TrackView]:
    """Return the views of the practice pass above an altitude from an instant on, half a second apart."""
    views: list[TrackView] = []
    fly_virtual(prepare(_request(clock, min_alt_deg)), views.append)
    return views


def practice_sky() -> PassView:
    """Return what is known of that pass beforehand, with a made-up skyline and field of view."""
    return msgspec.structs.replace(pass_scene(prepare(_request()).facts), horizon=SKYLINE)


def practice_helpers(utc_s: float) -> Helpers:
    """Return what lies beside a screen of the practice pass, the passes to come found already."""
    where = demo_pass.SITE
    site = f"{where.latitude_deg},{where.longitude_deg},{where.height_m}"
    lines = f"{demo_pass.NAME}\n{demo_pass.LINE_1}\n{demo_pass.LINE_2}\n"
    options = HelperOptions(("--elements", "-", "--site", site), (), lines.encode())
    helpers = Helpers.of(options, os.getpid())
    helpers.search.begin(utc_s)
    while helpers.search.busy:
        time.sleep(LOOK_EVERY_S)
    return helpers


def _request(clock: str = demo_pass.BEFORE_PASS, min_alt_deg: float = 10.0) -> RunRequest:
    return RunRequest(
        satellite=demo_pass.NAME,
        mount_url="sim",
        elements=[Elements.from_tle(demo_pass.LINE_1, demo_pass.LINE_2, demo_pass.NAME)],
        site=demo_pass.SITE.place(),
        clock_option=clock,
        min_alt_deg=min_alt_deg,
        virtual=True,
        fov_deg=FIELD_DEG,
    )


async def draw(
    views: list[TrackView],
    shot: Shot = SHOTS["tui.svg"],
    sky: PassView | None = None,
) -> str:
    """Return the screen as it stands at culmination, as SVG without references to anything elsewhere."""
    app = _app(views, shot, sky)
    async with app.run_test(size=(shot.columns, shot.rows)) as pilot:
        await pilot.press(*shot.keys)
        for _ in range(3):
            # The chart's width follows from the layout, and the layout from that.
            await pilot.pause()
            app.plot()
        await pilot.pause()
        svg = app.export_screenshot(title=f"sattrack: {views[-1].name}")
    return self_contained(svg)


def _app(views: list[TrackView], shot: Shot, sky: PassView | None) -> TrackApp:
    appearance = Appearance(shot.theme)
    until = [view for view in views if view.utc_s <= view.culminate_utc_s]
    if not shot.replayed:
        helpers = practice_helpers(until[-1].utc_s) if "2" in shot.keys else None
        return TrackApp(RecordedFeed(until, sky), monotonic=_still, appearance=appearance, helpers=helpers)
    tape = Tape("iss.mcap")
    feed = TapeFeed(RecordedFeed(views, sky, ended=True), tape, _still)
    tape.add(feed.news().views)
    tape.seek(until[-1].utc_s - views[0].utc_s)
    return ReplayApp(feed, _still, appearance)


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
    options = ["--mount", "sim", "--clock", demo_pass.BEFORE_PASS, "--stream", "--control"]
    console = ConsoleProcess([*self_command(), "mount", "watch", *options])
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
        console.wait(END_WITHIN_S)
        console.close()


async def draw_console(
    view: ConsoleView, columns: int = COLUMNS, rows: int = ROWS, keys: tuple[str, ...] = ()
) -> str:
    """Return the console's screen of a view, after some keys, as self-contained SVG."""
    app = ConsoleApp(StillFeed(view), monotonic=_still)
    async with app.run_test(size=(columns, rows)) as pilot:
        await pilot.press(*keys)
        await pilot.pause()
        svg = app.export_screenshot(title="sattrack mount watch")
    return self_contained(svg)


def _still() -> float:
    return 0.0


def self_contained(svg: str) -> str:
    """Return an exported picture without fonts and remarks that point elsewhere, spaces kept."""
    for pattern, plain in _MENDED:
        svg = pattern.sub(plain, svg)
    return svg


def main() -> None:
    """Write the pictures into the folder named on the command line."""
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        click.echo("usage: python -m tools.screens FOLDER", err=True)
        sys.exit(2)
    folder, views, sky = Path(sys.argv[1]), practice_views(), practice_sky()
    for name, shot in SHOTS.items():
        svg = asyncio.run(draw(views, shot, sky))
        (folder / name).write_text(svg, encoding="utf-8")
    (folder / "console.svg").write_text(asyncio.run(draw_console(slewing_view())), encoding="utf-8")


if __name__ == "__main__":
    main()

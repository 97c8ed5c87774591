"""The screen of a mount under manual operation. It sees views and sends orders; others feed the mount."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Container

from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, Park, Sync
from sattrack.tui import console_panels as panels
from sattrack.tui.appearance import NIGHT
from sattrack.tui.console_panels import FIRST_RATE, ConsoleScene, jog_rates_deg_s
from sattrack.tui.dialogs import CONSOLE_TEXT, DirectionDialog, EnteredDirection, HelpScreen, Question
from sattrack.tui.screen_app import ScreenApp, TooSmall
from sattrack.views import formatting
from sattrack.views.messages import Jog, Leave, Reset

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.app import ComposeResult
    from textual.dom import DOMNode

    from sattrack.tui.appearance import Appearance
    from sattrack.tui.console_feed import ConsoleFeed
    from sattrack.views.messages import ConsoleMessage
    from sattrack.views.run import ConsoleView

LOOK_EVERY_S = 0.1
LAGGING_S = 0.5
"""Where this process has not come to look for so long, keys are old: a jog by them would come unasked."""
LEAVE_WITHIN_S = 70.0
OBEYED_WORDS = ("stopping", "idle")


class ConsoleApp(ScreenApp):
    """Shows a mount and takes the operator's keys. `monotonic` is this process's own clock, seconds.

    `first` was asked for before there was a screen: it is sent as soon as the mount is heard.
    """

    TITLE = "sattrack mount watch"
    CSS_PATH = Path(__file__).with_name("console.tcss")
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "jog(0, 1)", "north"),
        Binding("down", "jog(0, -1)", "south"),
        Binding("left", "jog(1, 0)", "east"),
        Binding("right", "jog(-1, 0)", "west"),
        *(Binding(str(key), f"rate({key})", f"rate {key}") for key in range(1, 7)),
        Binding("g", "slew", "slew"),
        Binding("s", "sync", "sync"),
        Binding("p", "park", "park"),
        Binding("h", "home", "home"),
        Binding("r", "reset", "reset"),
    ]

    def __init__(
        self,
        feed: ConsoleFeed,
        monotonic: Callable[[], float] = time.monotonic,
        first: ConsoleMessage | None = None,
        appearance: Appearance = NIGHT,
    ) -> None:
        super().__init__(appearance)
        self._feed = feed
        self._monotonic = monotonic
        self._first = first
        self._view: ConsoleView | None = None
        self._ended = False
        self._rate = FIRST_RATE
        self._heard_s = self._looked_s = monotonic()
        self._stop_sent_s: float | None = None
        self._leaving_since_s: float | None = None

    def compose(self) -> ComposeResult:
        """Make the parts, from top to bottom."""
        yield panels.ConsoleTitle()
        yield panels.ConsoleHeadline()
        yield panels.ConsoleCautions()
        with Container(id="fields"):
            yield panels.GroupPanel(formatting.pointing, "pointing")
            yield panels.GroupPanel(formatting.drives, "drives")
            yield panels.GroupPanel(formatting.state, "state")
        yield panels.AcksPanel("acks")
        with Container(id="below"):
            yield panels.GroupPanel(formatting.place, "place")
            yield panels.ReadingsPanel("readings")
            yield panels.MountLinkPanel("link")
        with Container(id="bottom"):
            yield panels.AskedPanel("asked")
            yield panels.JogPanel("jog")
        yield panels.ConsoleKeys()
        yield TooSmall()

    def on_mount(self) -> None:
        """Set the look, and look at the feed from now on."""
        self.set_look()
        self.every(LOOK_EVERY_S, self.look)
        self.look()

    def look(self) -> None:
        """Take in what has come, and draw the newest."""
        latest, now_s = self._feed.latest(), self._monotonic()
        self._looked_s = now_s
        if latest.view is not None:
            self._view, self._heard_s = latest.view, now_s
            if self._stop_sent_s is not None and latest.view.doing in OBEYED_WORDS:
                self._stop_sent_s = None
        self._ended = self._ended or latest.ended
        if self._first is not None and self._view is not None and self._view.status is not None:
            first, self._first = self._first, None
            self._tell(first)
        self._draw()
        self._leave_when_due()

    @property
    def scene(self) -> ConsoleScene | None:
        """What to draw; None before the first view."""
        if self._view is None:
            return None
        now_s = self._monotonic()
        return ConsoleScene(
            view=self._view,
            rate=self._rate,
            news_age_s=now_s - self._heard_s,
            stop_sent_s=None if self._stop_sent_s is None else now_s - self._stop_sent_s,
            leaving=self._leaving_since_s is not None,
            ended=self._ended,
        )

    def action_stop(self) -> None:
        """Stop everything; every press says it again. Nothing may then hide what the mount does."""
        self._close_dialogs()
        self._first, self._stop_sent_s = None, self._monotonic()
        self._tell(Abort())

    def action_interrupt(self) -> None:
        """Leave as `q` does, for a program that was interrupted."""
        self.interrupted = True
        self.action_leave()

    def action_leave(self) -> None:
        """Have what was begun here stopped, then leave; asked again, leave at once."""
        self._close_dialogs()
        if self._ended or self._leaving_since_s is not None:
            self.exit()
            return
        self._first, self._leaving_since_s = None, self._monotonic()
        self._tell(Leave())

    def action_jog(self, east: int, north: int) -> None:
        """Move by one touch, unless the key is an old one."""
        if self._view is None or self._monotonic() - self._looked_s > LAGGING_S:
            return
        rate = jog_rates_deg_s(self._view)[self._rate - 1]
        if east:
            self._tell(Jog(ra_rate_deg_s=east * rate))
        if north:
            self._tell(Jog(dec_rate_deg_s=north * rate))

    def action_rate(self, key: int) -> None:
        """Choose how fast a jog is."""
        self._rate = key
        self._draw()

    def action_slew(self) -> None:
        """Ask where to, and slew there."""

        def go(direction: EnteredDirection | None) -> None:
            if direction is not None:
                self._tell(Slew(direction.ra_deg, direction.dec_deg))

        self.push_screen(DirectionDialog("slew", "The mount goes there and tracks."), go)

    def action_sync(self) -> None:
        """Ask for the direction that the mount points to, ask again, and sync."""

        def ask(direction: EnteredDirection | None) -> None:
            if direction is None:
                return
            text = f"The mount will report {_spoken(direction)} for where it points now{self._reported()}."
            self.push_screen(
                Question("sync?", text),
                lambda sure: self._tell(Sync(direction.ra_deg, direction.dec_deg)) if sure else None,
            )

        self.push_screen(DirectionDialog("sync", "Asked again before it is done."), ask)

    def action_park(self) -> None:
        """Ask, and park."""
        text = (
            "The mount slews to the profile's park position and stops; then the drives' power is cut. "
            "There is no unpark: the mount's own window gives the power back."
        )
        self.push_screen(Question("park?", text), lambda sure: self._tell(Park()) if sure else None)

    def action_home(self) -> None:
        """Find home."""
        self._tell(FindHome())

    def action_reset(self) -> None:
        """Let the mount move again after a limit has stopped it."""
        self._tell(Reset())

    def action_help(self) -> None:
        """Show what the keys do."""
        self.push_screen(HelpScreen(CONSOLE_TEXT))

    def _reported(self) -> str:
        status = None if self._view is None else self._view.status
        if status is None:
            return ""
        return f", which it reports as {_spoken(EnteredDirection(status.ra_h * 15.0, status.dec_deg))}"

    def _tell(self, order: ConsoleMessage) -> None:
        if not self._ended:
            self._feed.tell(order)
        self._draw()

    def _draw(self) -> None:
        scene = self.scene
        if scene is not None:
            self._draw_on_main(lambda main: _show(main, scene))

    def _leave_when_due(self) -> None:
        if self._was_asked_to_leave():
            self.action_leave()
        since_s = self._leaving_since_s
        overdue = since_s is not None and self._monotonic() - since_s > LEAVE_WITHIN_S
        if overdue or (self._ended and since_s is not None):
            self.exit()


def _show(main: DOMNode, scene: ConsoleScene) -> None:
    for panel in main.query(panels.ConsolePanel):
        panel.show(scene)


def _spoken(direction: EnteredDirection) -> str:
    return f"RA {formatting.right_ascension(direction.ra_deg)} Dec {formatting.degrees(direction.dec_deg)}"

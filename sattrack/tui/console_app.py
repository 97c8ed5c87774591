"""The consoles of a mount and of an antenna: they show views and send orders to a process of their own."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.containers import Container
from textual.widgets import Static

from sattrack.core.local_time import zone_name
from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, Park, Sync
from sattrack.tui import console_panels as panels
from sattrack.tui import look
from sattrack.tui.console_panels import FIRST_RATE, ConsoleScene, jog_rates_deg_s
from sattrack.tui.dialogs import (
    CONSOLE_TEXT,
    PARK_TEXT,
    DirectionDialog,
    EnteredDirection,
    Question,
    show_help,
)
from sattrack.tui.look import ScreenApp
from sattrack.tui.panels import TooSmall
from sattrack.tui.scene import DEFAULT_APPEARANCE, NO_NEWS_AFTER_S, Tone
from sattrack.views import formatting
from sattrack.views.messages import Jog, Leave, Reset

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.app import ComposeResult
    from textual.dom import DOMNode

    from sattrack.tui.feeds import AntennaFeed, ConsoleFeed
    from sattrack.tui.scene import Appearance
    from sattrack.views.messages import ConsoleMessage
    from sattrack.views.run import AntennaView, AxesView, ConsoleView


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
        appearance: Appearance = DEFAULT_APPEARANCE,
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

    def stop_at_once(self) -> None:
        """Say that the mount is to stop."""
        if not self._ended:
            self._feed.tell(Abort())

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
        self.push_screen(Question("park?", PARK_TEXT), lambda sure: self._tell(Park()) if sure else None)

    def action_home(self) -> None:
        """Find home."""
        self._tell(FindHome())

    def action_reset(self) -> None:
        """Let the mount move again after a limit has stopped it."""
        self._tell(Reset())

    def action_help(self) -> None:
        """Show what the keys do."""
        show_help(self, CONSOLE_TEXT)

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


SHORT_ANSWER = 24
"""Characters of an answer that stand behind its command."""
REFUSED_CHARACTERS = 26
LARGE_ARCSEC = 3600.0
NAMES = {"hadec": ("hour angle", "declination"), "azel": ("azimuth", "elevation")}
KEYS = "l local  r remote  x ready after a safety stop  SPACE STOP  q stop and leave"


class Inks(NamedTuple):
    """The styles of a theme."""

    spoken: dict[Tone, str]
    plate: dict[Tone, str]
    dim: str


@cache
def inks(theme: str) -> Inks:
    """Return the styles of a theme, by its name."""
    colours = look.THEMES[look.THEME_NAMES.index(theme)]
    spoken, plate = (
        {tone: look.concrete(style, colours) for tone, style in styles.items()}
        for styles in (look.SPOKEN, look.PLATE)
    )
    return Inks(spoken, plate, look.concrete(look.DIM, colours))


class AntennaApp(ScreenApp):
    """Shows one antenna and takes its operator's keys."""

    TITLE = "sattrack serve antenna"
    LOOK_EVERY_S = 0.2
    CSS = """
    Screen { background: $background; color: $foreground; }
    Static { padding: 0 1; }
    #title, #keys { background: $panel; height: 1; text-wrap: nowrap; text-overflow: ellipsis; }
    #state { height: auto; padding: 1 1 0 1; }
    #axes { height: auto; padding: 1 1; }
    #lines, #refusals { text-wrap: nowrap; text-overflow: ellipsis; border-top: solid $secondary; }
    #lines, #refusals { border-title-color: $foreground 60%; }
    #lines { height: 1fr; }
    #refusals { height: auto; max-height: 9; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("l", "say('local')", "local"),
        Binding("r", "say('remote')", "remote"),
        Binding("x", "say('reset')", "reset"),
    ]

    def __init__(
        self,
        feed: AntennaFeed,
        appearance: Appearance = DEFAULT_APPEARANCE,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(appearance)
        self._feed = feed
        self._monotonic = monotonic
        self._view: AntennaView | None = None
        self._heard_s = monotonic()

    def compose(self) -> ComposeResult:
        """Make the parts, from top to bottom."""
        yield Static(id="title")
        yield Static(id="state")
        yield Static(id="axes")
        for name, title in (("lines", "last lines from antcn"), ("refusals", "refused")):
            part = Static(id=name)
            part.border_title = title
            yield part
        yield Static(KEYS, id="keys")
        yield TooSmall()

    def look(self) -> None:
        """Take in what has come, and draw it."""
        latest, now_s = self._feed.latest(), self._monotonic()
        if latest.view is not None:
            self._view, self._heard_s = latest.view, now_s
        if self._view is not None:
            for name, text in drawn(self._view, self.theme, now_s - self._heard_s).items():
                self.query_one(f"#{name}", Static).update(text)
        if latest.ended or self._was_asked_to_leave():
            self.exit()

    def action_say(self, word: str) -> None:
        """Say a word to the controller."""
        self._feed.tell(word)

    def action_stop(self) -> None:
        """Stop the mount."""
        self._feed.tell("stop")

    def stop_at_once(self) -> None:
        """Say that the mount is to stop."""
        self._feed.tell("stop")

    def action_leave(self) -> None:
        """Leave the screen; the mount is brought to rest then."""
        self.exit()

    def action_interrupt(self) -> None:
        """Leave, as a program that was interrupted."""
        self.interrupted = True
        self.exit()


def drawn(view: AntennaView, theme: str = look.NIGHT.name, news_age_s: float = 0.0) -> dict[str, Text]:
    """Return what each part of the screen says of a state that old, in the colours of a theme."""
    ink = inks(theme)
    time = f"{formatting.clock(view.utc_s)} {zone_name(view.utc_s)}"
    return {
        "title": Text(f"{view.mount} as an antenna on {view.door}   {time}"),
        "state": _state(view, ink, news_age_s),
        "axes": _axes(view, ink),
        "lines": _lines(view, ink),
        "refusals": _refusals(view, ink),
    }


def _state(view: AntennaView, ink: Inks, news_age_s: float) -> Text:
    text = Text()
    if news_age_s > NO_NEWS_AFTER_S:
        old = f" from the service for {news_age_s:.0f} s: everything here is old\n"
        text.append(" NO NEWS ", ink.plate[Tone.BAD]).append(old, ink.spoken[Tone.BAD])
        text.append("press SPACE, then use the mount's own stop\n", ink.spoken[Tone.BAD])
    mode = ("REMOTE", Tone.GOOD) if view.remote else ("LOCAL", Tone.NOTICE)
    text.append(f" {mode[0]} ", ink.plate[mode[1]])
    servo = Tone.GOOD if view.servo == "TRACKING" else Tone.CALM
    if view.doing != view.servo:
        text.append(f"  {view.doing.lower()},")
    text.append(f" {view.servo.lower()}", ink.spoken[servo])
    heard, tone = ("heard", Tone.GOOD) if view.link_up else ("NOT HEARD", Tone.BAD)
    text.append("   mount ").append(heard, ink.spoken[tone])
    text.append("   antcn ").append("connected" if view.caller else "not connected")
    text.append(f"   {view.refused} refused")
    if view.tripped is not None:
        text.append(
            f"\nsafety stopped the mount: {view.tripped}; x makes it ready again", ink.spoken[Tone.BAD]
        )
    elif view.outside_limits:
        words_of_limit = "\nthe trajectory is beyond the limits: the axes are held as near as possible"
        text.append(words_of_limit, ink.spoken[Tone.NOTICE])
    return text


def _axes(view: AntennaView, ink: Inks) -> Text:
    first, second = NAMES[view.axes]
    text = Text().append(f"{'':12}{first:>16}{second:>16}\n", ink.dim)
    rows = (("commanded", view.commanded), ("actual", view.actual))
    text.append("\n".join(f"{name:12}{_pair(axes)}" for name, axes in rows))
    if view.commanded is not None and view.actual is not None:
        off = (
            (view.actual.first_deg - view.commanded.first_deg) * 3600.0,
            (view.actual.second_deg - view.commanded.second_deg) * 3600.0,
        )
        text.append(f"\n{'off by':12}{_apart(off[0])}{_apart(off[1])}")
    if view.focus is not None:
        places = "".join(f"{'-':>16}" if mm is None else f"{mm:15.4f} " for mm in view.focus.axes_mm)
        text.append(f"\n{'focus, mm':12}{places}  {'moves' if view.focus.moving else 'stands'}")
    return text


def _apart(arcsec: float) -> str:
    text = f"{arcsec:+15.2f}″" if abs(arcsec) < LARGE_ARCSEC else f"{arcsec / 3600.0:+15.6f}°"
    return text.replace("-", formatting.MINUS)


def _pair(axes: AxesView | None) -> str:
    if axes is None:
        return f"{'-':>16}{'-':>16}"
    return f"{axes.first_deg:15.6f}°{axes.second_deg:15.6f}°".replace("-", formatting.MINUS)


def _lines(view: AntennaView, ink: Inks) -> Text:
    text = Text()
    for one in view.exchanges:
        word, _, answer = one.answered.partition(" ")
        style = ink.spoken[Tone.NOTICE] if answer.startswith("NAK") else ""
        text.append(f"{formatting.clock(one.utc_s)}  ", ink.dim).append(one.received, style)
        if word == "PS" or len(answer) > SHORT_ANSWER:
            text.append(f"\n            {answer}\n", ink.dim)
        else:
            text.append(f"  {answer}\n", style or ink.dim)
    return text


def _refusals(view: AntennaView, ink: Inks) -> Text:
    if not view.refusals:
        return Text("none", ink.dim)
    text = Text()
    for one in view.refusals:
        received = one.received
        if len(received) > REFUSED_CHARACTERS:
            received = received[: REFUSED_CHARACTERS - 1] + "…"
        text.append(f"{formatting.clock(one.utc_s)}  ", ink.dim)
        text.append(f"{received:{REFUSED_CHARACTERS}}", ink.spoken[Tone.NOTICE]).append(f"  {one.why}\n")
    text.rstrip()
    return text

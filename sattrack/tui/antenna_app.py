"""The controller's console: the antenna behind its interface, the last lines, and the switch to local."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.widgets import Static

from sattrack.tui import look
from sattrack.tui.appearance import NIGHT
from sattrack.tui.scene import Tone
from sattrack.tui.screen_app import ScreenApp, TooSmall
from sattrack.views import formatting

if TYPE_CHECKING:
    from textual.app import ComposeResult

    from sattrack.tui.appearance import Appearance
    from sattrack.tui.child import AntennaFeed
    from sattrack.views.run import AntennaView, AxesView

LOOK_EVERY_S = 0.2
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

    def __init__(self, feed: AntennaFeed, appearance: Appearance = NIGHT) -> None:
        super().__init__(appearance)
        self._feed = feed
        self._view: AntennaView | None = None

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

    def on_mount(self) -> None:
        """Set the look, and look at the feed from now on."""
        self.set_look()
        self.every(LOOK_EVERY_S, self.look)
        self.look()

    def look(self) -> None:
        """Take in what has come, and draw it."""
        view, ended = self._feed.newest()
        self._view = view or self._view
        if self._view is not None:
            for name, text in drawn(self._view, self.theme).items():
                self.query_one(f"#{name}", Static).update(text)
        if ended or self._was_asked_to_leave():
            self.exit()

    def action_say(self, word: str) -> None:
        """Say a word to the controller."""
        self._feed.tell(word)

    def action_stop(self) -> None:
        """Stop the mount."""
        self._feed.tell("stop")

    def action_leave(self) -> None:
        """Leave the screen; the mount is brought to rest then."""
        self.exit()

    def action_interrupt(self) -> None:
        """Leave, as a program that was interrupted."""
        self.interrupted = True
        self.exit()


def drawn(view: AntennaView, theme: str = look.NIGHT.name) -> dict[str, Text]:
    """Return what each part of the screen says of a state, in the colours of a theme."""
    ink = inks(theme)
    return {
        "title": Text(f"{view.mount} as an antenna on {view.door}   {formatting.clock(view.utc_s)} UTC"),
        "state": _state(view, ink),
        "axes": _axes(view, ink),
        "lines": _lines(view, ink),
        "refusals": _refusals(view, ink),
    }


def _state(view: AntennaView, ink: Inks) -> Text:
    text = Text()
    mode = ("REMOTE", Tone.GOOD) if view.remote else ("LOCAL", Tone.NOTICE)
    text.append(f" {mode[0]} ", ink.plate[mode[1]])
    servo = Tone.GOOD if view.servo == "TRACKING" else Tone.CALM
    if view.doing != view.servo:
        text.append(f"  {view.doing.lower()},")
    text.append(f" {view.servo.lower()}", ink.spoken[servo])
    text.append("   mount ").append(*_good_or_bad(view.link_up, "heard", "NOT HEARD", ink))
    text.append("   antcn ").append("connected" if view.caller else "not connected")
    text.append(f"   {view.refused} refused")
    if view.tripped is not None:
        text.append(
            f"\nsafety stopped the mount: {view.tripped}; x makes it ready again", ink.spoken[Tone.BAD]
        )
    elif view.outside_limits:
        words_of_limit = "\nthe trajectory is beyond the limits: the axes are held as near as may be"
        text.append(words_of_limit, ink.spoken[Tone.NOTICE])
    return text


def _good_or_bad(good: bool, well: str, ill: str, ink: Inks) -> tuple[str, str]:
    return (well, ink.spoken[Tone.GOOD]) if good else (ill, ink.spoken[Tone.BAD])


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

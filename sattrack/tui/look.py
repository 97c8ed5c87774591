"""The look of all screens (colours, layout, plain characters), and the application they share.

Every state that has a colour has a word too.
"""

from __future__ import annotations

import re
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, ClassVar

from rich.cells import cell_len
from rich.segment import Segment
from textual.app import App
from textual.binding import Binding, BindingType
from textual.css.query import NoMatches
from textual.events import Key
from textual.filter import LineFilter
from textual.theme import Theme

from sattrack.tui.scene import DEFAULT_APPEARANCE, Appearance, Tone

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.color import Color
    from textual.dom import DOMNode
    from textual.events import Event
    from textual.message import Message
    from textual.screen import Screen

DIM = "$quiet"
"""Labels, and what need not be read first; styles name a theme's colours, so that it can be changed."""

NIGHT = Theme(
    name="night",
    primary="#7f9fb8",
    secondary="#3c4651",
    success="#7fb685",
    warning="#d9a94f",
    error="#e0625a",
    foreground="#d0d6dc",
    background="#0c0f12",
    surface="#12161b",
    panel="#1a2027",
    dark=True,
    variables={
        "ink": "#0c0f12",
        "quiet": "#87919b",
        "ra-line": "#5fb8c4",
        "dec-line": "#c9929f",
        "zero-line": "#454e58",
        "axis-line": "#4a545f",
        "tick": "#a3adb7",
    },
)
RED = Theme(
    name="red",
    primary="#c80000",
    secondary="#5a0000",
    accent="#c80000",
    success="#e60000",
    warning="#ff0000",
    error="#ff0000",
    foreground="#e60000",
    background="#000000",
    surface="#0f0000",
    panel="#1c0000",
    dark=True,
    variables={
        "ink": "#000000",
        "quiet": "#b40000",
        "ra-line": "#ff0000",
        "dec-line": "#a00000",
        "zero-line": "#500000",
        "axis-line": "#5a0000",
        "tick": "#a00000",
    },
)
"""Nothing but red: eyes used to the dark stay so."""
CONTRAST = Theme(
    name="contrast",
    primary="#7fd4ff",
    secondary="#ffffff",
    success="#5cff5c",
    warning="#ffe14d",
    error="#ff9c94",
    foreground="#ffffff",
    background="#000000",
    surface="#000000",
    panel="#000000",
    dark=True,
    variables={
        "ink": "#000000",
        "quiet": "#d8d8d8",
        "ra-line": "#5cf0ff",
        "dec-line": "#ffa8ff",
        "zero-line": "#a8a8a8",
        "axis-line": "#ffffff",
        "tick": "#ffffff",
    },
)
"""Every character at least seven times as light as what lies behind it."""
THEMES = (NIGHT, RED, CONTRAST)
THEME_NAMES = tuple(theme.name for theme in THEMES)

SPOKEN = {
    Tone.GOOD: "bold $success",
    Tone.CALM: "bold $primary",
    Tone.NOTICE: "bold $warning",
    Tone.BAD: "bold $error",
}
PLATE = {
    Tone.GOOD: "bold $ink on $success",
    Tone.CALM: "bold $ink on $primary",
    Tone.NOTICE: "bold $ink on $warning",
    Tone.BAD: "bold $ink on $error",
}


def concrete(style: str, theme: Theme = NIGHT) -> str:
    """Return a style with a theme's own colours in place of their names."""

    def colour(match: re.Match[str]) -> str:
        name = match[1]
        return theme.variables.get(name) or str(getattr(theme, name))

    return re.sub(r"\$([a-z-]+)", colour, style)


WIDTHS = [(0, "-slim"), (60, "-narrow"), (120, "-wide")]
HEIGHTS = [(0, "-low"), (12, "-short"), (32, "-tall")]
"""Style classes of the screen, each from so many columns or rows on."""
HUGE = (180, 55)
"""Columns and rows from which on the screen has the class `-huge` as well."""

TITLES = {
    "ErrorBox": "error",
    "#axes": "error by direction",
    "#where": "satellite",
    "#wide-times": "pass",
    "ErrorPanel": "error of the last minutes",
    "#link": "link",
    "#mount": "mount",
    "#bias": "bias",
    "#field": "expected, 2σ",
    "#sky": "sky",
    "#notes": "where",
}
"""Titles of the panels that have a border where there is room for one."""

CSS = """
Screen { background: $background; color: $foreground; }

Panel { height: 1; text-wrap: nowrap; text-overflow: ellipsis; padding: 0 1; }
SessionBar, Cautions, TapeBar { display: none; }
TitleBar, HeadlineBar, SessionBar, TapeBar, KeyBar { background: $panel; }
Cautions { height: auto; max-height: 4; text-wrap: wrap; background: $surface; }

#live { height: 1fr; }
#tonight, #mount-page, #schedule, #log, #camera { display: none; height: 1fr; padding: 0 1; }
#tonight, #schedule, #log { text-wrap: nowrap; text-overflow: ellipsis; }
.-page-tonight #live, .-page-mount #live, .-page-schedule #live, .-page-log #live { display: none; }
.-page-camera #live { display: none; }
.-page-camera #camera { display: block; }
#picture { width: 1fr; height: 100%; text-wrap: nowrap; }
#real-picture { width: 1fr; height: 100%; display: none; }
#camera-state { width: 35; height: 100%; margin-left: 1; text-wrap: nowrap; text-overflow: ellipsis; }
.-page-tonight #tonight, .-page-mount #mount-page { display: block; }
.-page-schedule #schedule, .-page-log #log { display: block; }
.-page-mount #mount-page { padding: 0; }
#state { height: 5; }
ErrorBox { width: 30; height: 5; }
ErrorBox #digits-row { height: 3; padding: 0 1; }
ErrorBox Digits { width: auto; height: 3; text-style: bold; color: $foreground; }
ErrorBox #unit { width: 2; height: 3; text-style: bold; color: $foreground; }
ErrorBox.good Digits, ErrorBox.good #unit { color: $success; }
ErrorBox.notice Digits, ErrorBox.notice #unit { color: $warning; }
ErrorBox.bad Digits, ErrorBox.bad #unit { color: $error; }
#axes { width: 23; height: 5; }
#where { width: 1fr; height: 5; }

#middle { height: 1fr; min-height: 5; }
ErrorPanel { height: 100%; width: 1fr; }
#sky { height: 100%; width: 40%; margin-left: 1; text-wrap: nowrap; text-overflow: clip; }
.-sky-alone #sky { margin-left: 0; }
.-sky-alone ErrorPanel, .-sky-alone #state, .-sky-alone #below { display: none; }
ErrorPlot { height: 1fr; }
ErrorPlot > .plot--axis { color: $axis-line; }
ErrorPlot > .plot--tick { color: $tick; text-style: none; }

#below { height: auto; }
#bias { height: 2; }
#wide-times, #field, #notes { display: none; }

.-wide.-tall {
    Panel, ErrorBox, ErrorPanel, SkyPanel { border-title-color: $primary; }
    #state { height: 8; }
    ErrorBox { width: 32; height: 8; border: round $secondary; padding: 1 0 0 0; }
    #axes { width: 26; height: 8; border: round $secondary; }
    #where { width: 1fr; height: 8; border: round $secondary; }
    #wide-times { display: block; width: 1.25fr; height: 8; border: round $secondary; }
    #narrow-times { display: none; }
    ErrorPanel, #sky { border: round $secondary; }
    #sky { margin-left: 0; }
    #below { height: 8; layout: horizontal; }
    #below > Panel { width: 1fr; height: 8; border: round $secondary; }
    #below > #bias { width: 39; }
    #below > #link { width: 30; }
    #below > #mount { width: 29; }
    #below > #run { display: none; }
    #below > #field { display: block; }
}
.-wide.-tall #tonight, .-wide.-tall #schedule, .-wide.-tall #log { border: round $secondary; }
.-wide.-tall #camera-state { width: 46; border: round $secondary; padding: 0 1; }
.-wide.-tall.-sky-alone #narrow-times { display: block; }
.-wide.-tall.-huge {
    #below, #below > Panel { height: 13; }
    #below > #notes { display: block; width: 44; }
    #below > #link { width: 32; }
    #below > #mount { width: 36; }
    #below > #bias { width: 46; }
}

ConsolePanel { height: 1; text-wrap: nowrap; text-overflow: ellipsis; padding: 0 1; }
#m-note { height: 1; padding: 0 1; color: $quiet; text-wrap: nowrap; text-overflow: ellipsis; }
#m-fields { height: 10; layout: horizontal; }
#m-fields > ConsolePanel { height: 10; width: 1fr; }
#m-fields > #m-pointing { width: 30; }
#m-fields > #m-drives { width: 24; }
#m-jog { display: none; }
#m-below { height: 6; }
#m-readings { height: 2; }
#m-link { height: 3; }
.-wide.-tall {
    ConsolePanel { border-title-color: $primary; }
    #m-fields { height: 12; }
    #m-fields > ConsolePanel { height: 12; border: round $secondary; }
    #m-fields > #m-pointing { width: 40; }
    #m-fields > #m-drives { width: 36; }
    #m-acks { height: 3; border: round $secondary; }
    #m-below { height: 9; layout: horizontal; }
    #m-below > ConsolePanel { height: 9; border: round $secondary; }
    #m-place { width: 32; }
    #m-readings { width: 40; }
    #m-link { width: 1fr; }
}

.dialog {
    width: 72; max-width: 100%; height: auto; max-height: 100%;
    background: $surface; border: round $primary; padding: 0 2;
}
.dialog > Label { width: 100%; height: auto; }
.dialog-title { text-style: bold; color: $primary; }
.dialog > Static { width: 100%; height: auto; }
Question { align: center middle; background: $background 70%; }
LeaveDialog { align: center middle; background: $background 70%; }
HelpScreen { align: center middle; background: $background 70%; }
HelpScreen > VerticalScroll {
    width: 76; max-width: 100%; height: auto; max-height: 100%;
    background: $surface; border: round $primary; padding: 0 2;
}
HelpScreen Static { height: auto; }
"""


_ALIKE = {
    "°": "d",
    "′": "'",
    "″": '"',
    "−": "-",
    "–": "-",
    "…": "~",
    "·": ".",
    "•": ".",
    "●": "@",
    "○": "o",
    "⊕": "&",
    "×": "x",
    "±": "~",
    "σ": "s",
    "←": "<",
    "→": ">",
    "↑": "^",
    "↓": "v",
    "▶": ">",
    "▏": "|",
    "▎": "|",
    "▍": "|",
    "▌": "|",
    "┃": "|",
    "│": "|",
    "╻": "|",
    "╹": "|",
    "╷": "|",
    "╵": "|",
    "━": "-",
    "─": "-",
    "╺": "-",
    "╸": "-",
    "╴": "-",
    "╶": "-",
}
BOX, BLOCKS, BRAILLE = range(0x2500, 0x2580), range(0x2580, 0x25A0), range(0x2800, 0x2900)


def ascii_of(text: str) -> str:
    """Return a text as wide, all of it ASCII: alike where there is something alike."""
    return text if text.isascii() else "".join(_one(character) for character in text)


def _one(character: str) -> str:
    if character.isascii():
        return character
    if character in _ALIKE:
        return _ALIKE[character]
    code = ord(character)
    if code in BOX:
        return "+"
    if code in BLOCKS:
        return "#"
    if code in BRAILLE:
        return " " if code == BRAILLE.start else "."
    return "?" * cell_len(character)


class PlainFilter(LineFilter):
    """Turns what is drawn into ASCII, last of all."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments with the same styles."""
        del background
        return [Segment(ascii_of(text), style, control) for text, style, control in segments]


FEW_COLOURS = {None, "standard", "windows"}
"""Rich's names of what has 16 colours or none, where different light colours become the same one."""


ANSWER = re.compile(r"\^(\[(\?[\d;]*c?)?|_(G[^ ^]*(\^\\?)?)?)?")
"""What a terminal says of itself, or its beginning, as Textual gives it where it knows no such keys."""
ONE_ANSWER_S = 0.1
"""So soon after one another come the keys of an answer, and no two of a person's."""


class LateAnswer:
    """Tells keys that are a terminal's late answer: what it was asked before there was a screen."""

    def __init__(self) -> None:
        self._heard, self._heard_s = "", 0.0

    def has(self, character: str, at_s: float) -> bool:
        """Tell whether a key's character goes on with an answer; the first, which does nothing, is let by."""
        heard = character if at_s - self._heard_s > ONE_ANSWER_S else self._heard + character
        goes_on = ANSWER.fullmatch(heard) is not None
        self._heard, self._heard_s = heard if goes_on else character if character == "^" else "", at_s
        return goes_on and len(heard) > 1


TYPED_MOST = 1000
"""How many of the newest keys a stop can make void: more than anybody types while a machine is busy."""


class ScreenApp(App[None]):
    """An application in front of which an operator sits, drawn as `appearance` says."""

    HORIZONTAL_BREAKPOINTS = WIDTHS
    VERTICAL_BREAKPOINTS = HEIGHTS
    DEFAULT_CSS = """
    Screen { layers: default above; }
    TooSmall { layer: above; display: none; width: 100%; height: 100%; background: $background; }
    .-slim TooSmall, .-low TooSmall { display: block; }
    """
    ENABLE_COMMAND_PALETTE = False
    LOOK_EVERY_S = 0.1
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "stop", "STOP", priority=True),
        Binding("ctrl+c", "interrupt", "interrupt", priority=True),
        Binding("ctrl+q", "leave", "quit", priority=True),
        Binding("q", "leave", "quit"),
        Binding("t", "next_theme", "theme"),
        Binding("question_mark", "help", "help"),
    ]

    def __init__(self, appearance: Appearance = DEFAULT_APPEARANCE) -> None:
        # What lies below asks for it while it is made.
        self._appearance = appearance
        super().__init__()
        for theme in THEMES:
            self.register_theme(theme)
        # Before there is anything that would have to be styled and laid out anew for it.
        self.set_reactive(App.theme, appearance.theme)
        self.stylesheet.set_variables(self.get_css_variables())
        self.interrupted = False
        self._leave_asked = False
        self._typed: deque[Key] = deque(maxlen=TYPED_MOST)
        """The newest keys. Any of them may still wait to be dealt with."""
        self._void: deque[Key] = deque(maxlen=TYPED_MOST)
        """Those that a stop has made void."""
        self._waiting: list[Key] = []
        """Those that this has not dealt with; what has the focus may not have, either."""
        self._late_answer = LateAnswer()

    def get_default_screen(self) -> Screen[Any]:
        """Return the first screen with the classes of its size: it is styled once, and not anew for them."""
        screen = super().get_default_screen()
        for cells, classes in zip(self.size, (WIDTHS, HEIGHTS), strict=True):
            screen.add_class(max(one for one in classes if one[0] <= cells)[1], update=False)
        return screen

    def post_message(self, message: Message) -> bool:
        """Put a message into the queue. A stop does not wait behind keys typed before it, which are void."""
        if isinstance(message, Key) and not any(message is key for key in self._typed):
            if self._late_answer.has(message.character or message.key, message.time):
                return True
            if message.key == "space":
                for key in self._typed:
                    key.prevent_default().stop()
                self._void.extend(self._typed)
                self._typed.clear()
                if self._waiting:
                    self.stop_at_once()
            self._typed.append(message)
            self._waiting.append(message)
        return super().post_message(message)

    async def on_event(self, event: Event) -> None:
        """Deal with an event; a key waits until then, and after that in the queue of what has the focus."""
        if not isinstance(event, Key):
            await super().on_event(event)
            return
        # A key that nothing took comes again from the widgets.
        self._waiting = [key for key in self._waiting if key is not event]
        if not any(event is key for key in self._void):
            await super().on_event(event)

    def stop_at_once(self) -> None:
        """Say that the mount is to stop, and no more; where there is none, nothing."""

    @property
    def shapes(self) -> bool:
        """Whether lines must differ in shape, since colours do not distinguish them."""
        return self.no_color or (not self.is_headless and self.console.color_system in FEW_COLOURS)

    def every(self, seconds: float, act: Callable[[], None]) -> None:
        """Call a function again and again while there are screens; the application's timers outlive them."""
        self.set_interval(seconds, lambda: act() if self.is_running else None)

    def on_mount(self) -> None:
        """Look at the feed from now on."""
        self.every(self.LOOK_EVERY_S, self.look)
        self.look()

    def look(self) -> None:
        """Take in what has come, and draw the newest."""
        raise NotImplementedError

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Return the colours beyond Textual's own, which the layout names before a theme is set."""
        return NIGHT.variables

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return what everything that is drawn goes through at last."""
        filters = super().get_line_filters()
        return [*filters, PlainFilter()] if self._appearance.plain else filters

    def action_next_theme(self) -> None:
        """Go on to the next theme."""
        at = THEME_NAMES.index(self.theme)
        self.theme = THEME_NAMES[(at + 1) % len(THEME_NAMES)]

    def action_leave(self) -> None:
        """Leave, as the screen's own key does."""
        raise NotImplementedError

    async def action_quit(self) -> None:
        """Leave as `q` does."""
        self.action_leave()

    def ask_to_leave(self) -> None:
        """Leave soon, the mount stopped; may be called from a signal handler."""
        self._leave_asked = True

    def _was_asked_to_leave(self) -> bool:
        """Tell it once."""
        asked, self._leave_asked = self._leave_asked, False
        return asked

    def _close_dialogs(self) -> None:
        while len(self.screen_stack) > 1:
            self.pop_screen()

    def _draw_on_main(self, draw: Callable[[DOMNode], object]) -> None:
        """Draw on what lies under any dialog; nothing while it is being put up or taken down."""
        if self.screen_stack:
            with suppress(NoMatches):
                draw(self.screen_stack[0])

"""What lies over a screen: help, questions, a direction to enter. SPACE stops over all."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple

from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.widgets import Input, Label, Static

from sattrack.core.errors import BadInputError
from sattrack.tui.panels import Dialog
from sattrack.tui.scene import CAMERA, LIVE, LOG, MOUNT, SCHEDULE, TONIGHT
from sattrack.views.formatting import DEC_FORMS, RA_FORMS, parse_dec, parse_ra

if TYPE_CHECKING:
    from textual.app import App, ComposeResult
    from textual.events import Key

LEAVING = "q         leave: asks whether the mount is to stop; Ctrl-C: it does"
RUN_TEXT = f"""\
SPACE     STOP, here and everywhere: the run ends, the mount rests
p         pause: the mount rests, the run goes on; again, Enter: go on
P         park: the run ends, the mount goes to its park position
{LEAVING}
1 to 6    live, tonight's passes, mount, schedule, log, camera
← →       point behind / ahead of it on its track (it is late / early)
↑ ↓       point left / right of its motion (as it goes, from below)
Shift     with an arrow: ten steps, spread over 20 s
u         undo the last nudge, offset, reset or clearing
f         arrows move by track, sky (→ east, ↑ north), axes or camera
[ ]       smaller / larger step, in seconds and degrees on the sky
s  w      search: spiral / sweep along the track; again: keep it there
Esc       end the search, back in its centre
r  0      take back the offsets of this frame / all, searches and all
m  + -    drop the remembered bias / T0 of a launch later, earlier
n  b      leave this satellite for the next pass / the one before
c         take control of the run, or give it up; a stop is anybody's
v  t      the sky alone, or all / next theme: night, red, contrast
Errors are mount minus satellite: + is ahead along, left across.

?  Esc  q close this help
"""

ATTACHED_TEXT = RUN_TEXT.replace(LEAVING, "q  Ctrl-C leave: the run continues; only SPACE stops the mount")
"""For a run that was started elsewhere."""

TONIGHT_TEXT = """\
SPACE     STOP everything, at once
↑ ↓       choose a pass; PgUp PgDn Home End go further
Enter     arm it, to be followed after what is followed now; again:
          take it back. Once a run is over: follow it at once.
a         follow it now, and leave what is followed, if you say so
n  b      the same with the next pass of the list / the one before
f         which passes: all, go, above 30°, sunlit by night
g         look for passes again
1 to 6    live, tonight's passes, mount, schedule, log, camera

Go and no-go are by the mount's limits, as `passes --judged` has
them; why not stands below the list. A stop takes back what is armed.

?  Esc  q close this help
"""

MOUNT_TEXT = """\
SPACE     STOP everything, at once
p         pause the pass: the mount comes to rest; again, Enter: go on
↑ ↓ ← →   while paused: jog north, south, east, west, half a second at
          a touch; a held key's ends 0.3 s after its last repeat
[ ]       jog slower / faster
P         park: the run ends, the mount goes to its park position and
          stops there, and the drives' power is cut
j         once the run is over: operate the mount by hand, on the
          console's screen: jog, slew, sync, park, home
1 to 6    live, tonight's passes, mount, schedule, log, camera

Every field of the mount's last status, as the run hears it. A mount
has one owner at a time: while a run has it, nothing else moves it.

?  Esc  q close this help
"""

SCHEDULE_TEXT = """\
SPACE     STOP everything, at once
↑ ↓       scroll; PgUp PgDn Home End go further
1 to 6    live, tonight's passes, mount, schedule, log, camera

What the runner of a schedule says of it, where the run is one of a
schedule's: `sattrack run FILE` runs one, `--status` shows the same.

?  Esc  q close this help
"""

LOG_TEXT = """\
SPACE     STOP everything, at once
↑ ↓       scroll; PgUp PgDn Home End go further. Scrolled back, the
          log keeps its place; at its end it follows new lines.
f         what is shown: all, warnings, people
1 to 6    live, tonight's passes, mount, schedule, log, camera

?  Esc  q close this help
"""

CAMERA_TEXT = """\
SPACE     STOP everything, at once
g         guide by the camera, or leave its observations unused
a         accept the last observation that was not taken
r         reject the last one that was taken: its effect is undone
← → ↑ ↓   move a cursor in the picture; a click puts it there
Enter     move the mount so that what is under the cursor comes to the
          middle; without a cursor, what was detected; u: undo
Esc       take the cursor away
f         next camera
1 to 6    live, tonight's passes, mount, schedule, log, camera

The cross is where the target should be, the corners where it was
seen, the circle the field of view. Pictures come only while this
screen is shown.

?  Esc  q close this help
"""

TEXTS = {
    LIVE: RUN_TEXT,
    TONIGHT: TONIGHT_TEXT,
    MOUNT: MOUNT_TEXT,
    SCHEDULE: SCHEDULE_TEXT,
    LOG: LOG_TEXT,
    CAMERA: CAMERA_TEXT,
}
"""By the screen that it lies over."""

REPLAY_TEXT = """\
p         pause, or go on; at the end, once more from the beginning
← →       10 s back / on
PgUp PgDn 60 s back / on
Home End  the beginning / the end
,  .      one view back / on, standing still
[ ]       slower / faster, from a tenth to a hundred times
1         as fast as it was
v  t      the sky alone, or all / next theme: night, red, contrast
q  Ctrl-C leave

The recorded inputs run through today's code; what it commands goes
nowhere, and no mount moves. SPACE is the stop of a mount, and there
is none here.

?  Esc  q close this help
"""


class HelpScreen(Dialog[None]):
    """What the keys do."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,question_mark", "dismiss", "close", show=False),
    ]

    def __init__(self, text: str = RUN_TEXT) -> None:
        super().__init__()
        self._text = text

    def compose(self) -> ComposeResult:
        """Make the parts."""
        with VerticalScroll():
            yield Static(self._text, markup=False)

    def touched(self, name: str) -> None:
        """Close it."""
        del name
        self.dismiss()

    def on_screen_resume(self) -> None:
        """Begin at the top again."""
        self.query_one(VerticalScroll).scroll_home(animate=False)


def show_help(app: App[None], text: str) -> None:
    """Show what the keys do. A text's screen is kept: Textual keeps the styles of each new one for good."""
    if not app.is_screen_installed(text):
        app.install_screen(HelpScreen(text), text)
    if app.get_screen(text) not in app.screen_stack:
        app.push_screen(text)


STOP, LEAVE, STAY = "stop", "leave", "stay"
ANSWERS = {"s": STOP, "q": STOP, "l": LEAVE}
LINES = (
    ("s", "s  or q once more: stop the mount and leave"),
    ("l", "l  leave it running: the pass goes on with nobody at this screen;"),
    ("l", "   `sattrack attach` looks at it again, `sattrack stop` stops it"),
    (None, "any other key stays; SPACE stops the mount"),
)
"""The lines, and the answer that a touch of each gives."""


class LeaveDialog(Dialog[str]):
    """Asks whether to stop the mount or to leave the run running; any other key stays."""

    def compose(self) -> ComposeResult:
        """Make the parts."""
        with Vertical(classes="dialog"):
            yield Label("leave?", classes="dialog-title", markup=False)
            for answer, text in LINES:
                yield Label(text, name=answer, markup=False)

    def on_key(self, event: Key) -> None:
        """Take the answer, and the key for nothing else."""
        event.stop()
        self.dismiss(ANSWERS.get(event.key, STAY))

    def touched(self, name: str) -> None:
        """Take the answer that was touched."""
        if name in ANSWERS:
            self.dismiss(ANSWERS[name])


CONSOLE_TEXT = """\
SPACE     STOP: both axes, at once, whatever goes on; in dialogs too
q  Ctrl-C stop what was begun here, wait for it, leave;
          once more: leave at once

↑ ↓ ← →   jog north, south, east, west against the stars, half a
          second at a touch; a held key goes on, and the motion
          ends 0.3 s after its last repeat
1 ... 6   jog rate, from the guide rate to the profile's limit
g         slew to coordinates and track there
s         sync: have the mount report coordinates where it points
p         park: slew there, stop, cut the drives' power
h         find home
r         after a safety limit has stopped it: let it move again
t         the next theme: night, red, contrast

Coordinates are of date, as the mount reports them. What the
protocol cannot confirm, park and home, ends as "sent,
unconfirmed". "read as" tells how fields are read for which the
protocol's paper has two readings.

?  Esc  q close this help
"""


class EnteredDirection(NamedTuple):
    """A direction of date, degrees."""

    ra_deg: float
    dec_deg: float


class AngleInput(Input):
    """A field that leaves SPACE to the stop."""

    def check_consume_key(self, key: str, character: str | None) -> bool:
        """Take printable keys as an Input does, but for the one that stops the mount."""
        return key != "space" and super().check_consume_key(key, character)


class DirectionDialog(Dialog[EnteredDirection | None]):
    """Asks for right ascension and declination; nothing is handed on until both can be read."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss(None)", "close", show=False)]

    def __init__(self, title: str, note: str) -> None:
        super().__init__()
        self._title, self._note = title, note

    def compose(self) -> ComposeResult:
        """Make the parts."""
        with Vertical(classes="dialog"):
            yield Label(self._title, classes="dialog-title", markup=False)
            yield Label(f"right ascension: {RA_FORMS}", markup=False)
            yield AngleInput(id="ra", compact=True)
            yield Label(f"declination: {DEC_FORMS}", markup=False)
            yield AngleInput(id="dec", compact=True)
            yield Label("", id="complaint", markup=False)
            yield Label(f"{self._note}  Enter goes on, Esc closes, SPACE stops the mount", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go on to the next field, or hand the direction on."""
        if event.input.id == "ra" and not self.query_one("#dec", Input).value:
            if self._read("ra") is not None:
                self.query_one("#dec", Input).focus()
            return
        ra_deg = self._read("ra")
        dec_deg = None if ra_deg is None else self._read("dec")
        if ra_deg is not None and dec_deg is not None:
            self.dismiss(EnteredDirection(ra_deg, dec_deg))

    def _read(self, name: str) -> float | None:
        field = self.query_one(f"#{name}", Input)
        try:
            value = (parse_ra if name == "ra" else parse_dec)(field.value)
        except BadInputError as error:
            self.query_one("#complaint", Label).update(f"! {error}")
            field.focus()
            return None
        self.query_one("#complaint", Label).update("")
        return value


PARK_TEXT = (
    "The mount slews to the profile's park position and stops; then the drives' power is cut. "
    "There is no unpark: the mount's own window gives the power back."
)


class Question(Dialog[bool]):
    """Asks for a yes; every other key is a no."""

    def __init__(self, title: str, text: str) -> None:
        super().__init__()
        self._title, self._text = title, text

    def compose(self) -> ComposeResult:
        """Make the parts."""
        with Vertical(classes="dialog"):
            yield Label(self._title, classes="dialog-title", markup=False)
            yield Static(self._text, markup=False)
            yield Label("y does it; any other key does not", name="y", markup=False)

    def on_key(self, event: Key) -> None:
        """Take y for a yes, any other key for a no, and none for what it does elsewhere."""
        event.stop()
        self.dismiss(event.key == "y")

    def touched(self, name: str) -> None:
        """Take a touch of the line that asks for the yes."""
        if name == "y":
            self.dismiss(True)

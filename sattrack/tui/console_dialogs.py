"""What lies over the console's screen: a direction to enter, a question, the help. SPACE stops over all."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, NamedTuple

from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input, Label, Static

from sattrack.core.errors import BadInputError
from sattrack.tui.touch import Dialog
from sattrack.views.console_words import DEC_FORMS, RA_FORMS, parse_dec, parse_ra

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.events import Key

HELP = """\
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


class Direction(NamedTuple):
    """A direction of date, degrees."""

    ra_deg: float
    dec_deg: float


class AngleInput(Input):
    """A field that leaves SPACE to the stop."""

    def check_consume_key(self, key: str, character: str | None) -> bool:
        """Take printable keys as an Input does, but for the one that stops the mount."""
        return key != "space" and super().check_consume_key(key, character)


class DirectionDialog(Dialog[Direction | None]):
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
            self.dismiss(Direction(ra_deg, dec_deg))

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

"""The help that lies over the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from sattrack.tui.pages import LIVE, LOG, MOUNT, SCHEDULE, TONIGHT
from sattrack.tui.touch import Dialog

if TYPE_CHECKING:
    from textual.app import ComposeResult

TEXT = """\
SPACE     STOP, here and everywhere: the run ends, the mount rests
p         pause: the mount rests, the run goes on; again, Enter: go on
P         park: the run ends, the mount goes to its park position
q         leave: asks whether the mount is to stop; Ctrl-C: it does
1 to 5    live, tonight's passes, mount, schedule, log
← →       point behind / ahead of it on its track (it is late / early)
↑ ↓       point left / right of its motion (as it goes, from below)
Shift     with an arrow: ten steps, spread over 20 s
u         undo the last nudge, offset, reset or clearing
f         arrows move by track, sky (→ east, ↑ north), axes or camera
[ ]       smaller / larger step, in seconds and degrees on the sky
s  w      search: spiral / sweep along the track; again: keep it there
Esc       end the search, back in its centre
r  0      take back the offsets of this frame / all, searches and all
m         drop the bias remembered from an earlier pass, for good
n  b      leave this satellite for the next pass / the one before
c         take control of the run, or give it up; a stop is anybody's
v  t      the sky alone, or all / next theme: night, red, contrast
Errors are mount minus satellite: + is ahead along, left across.

?  Esc  q close this help
"""

TONIGHT_TEXT = """\
SPACE     STOP everything, at once
↑ ↓       choose a pass; PgUp PgDn Home End go further
Enter     arm it, to be followed after what is followed now; again:
          take it back. Once a run is over: follow it at once.
a         follow it now, and leave what is followed, if you say so
n  b      the same with the next pass of the list / the one before
f         which passes: all, go, above 30°, sunlit by night
g         look for passes again
1 to 5    live, tonight's passes, mount, schedule, log

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
1 to 5    live, tonight's passes, mount, schedule, log

Every field of the mount's last status, as the run hears it. A mount
has one owner at a time: while a run has it, nothing else moves it.

?  Esc  q close this help
"""

SCHEDULE_TEXT = """\
SPACE     STOP everything, at once
↑ ↓       scroll; PgUp PgDn Home End go further
1 to 5    live, tonight's passes, mount, schedule, log

What the runner of a schedule says of it, where the run is one of a
schedule's: `sattrack run FILE` runs one, `--status` shows the same.

?  Esc  q close this help
"""

LOG_TEXT = """\
SPACE     STOP everything, at once
↑ ↓       scroll; PgUp PgDn Home End go further. Scrolled back, the
          log keeps its place; at its end it follows what is said.
f         what is shown: all, warnings, people
1 to 5    live, tonight's passes, mount, schedule, log

?  Esc  q close this help
"""

TEXTS = {LIVE: TEXT, TONIGHT: TONIGHT_TEXT, MOUNT: MOUNT_TEXT, SCHEDULE: SCHEDULE_TEXT, LOG: LOG_TEXT}
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

    def __init__(self, text: str = TEXT) -> None:
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

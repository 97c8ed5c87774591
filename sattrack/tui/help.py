"""The help that lies over the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

if TYPE_CHECKING:
    from textual.app import ComposeResult

TEXT = """\
SPACE     STOP everything, at once: ends the run, the mount comes to
          rest. Works everywhere, here too.
q         leave: the mount stopped, or the run left running, as you say
Ctrl-C    stop the mount, wait for it, leave; once more: leave at once

← →       point behind / ahead of it on its track (it is late / early)
↑ ↓       point left / right of its motion (as it goes, from below)
f         arrows move by track, sky (→ east, ↑ north), axes or camera
Shift     with an arrow: ten steps that way, spread over 20 s
u         undo: take the last nudge, offset or clearing back
[ ]       smaller / larger step, in seconds and degrees on the sky
s  w      search: spiral / sweep along the track; again: keep it there
Esc       end the search, back in its centre
r         take the offsets of this frame back
0         clear: take all back, the search and the estimate too
c         take control of the run, or give it up: one at a time moves
          the target, everybody stops it
m         drop the bias remembered from an earlier pass, for good
v  t      the sky alone, or all / next theme: night, red, contrast

Nudges add up to the bias, which is reached gently. Errors are mount
minus satellite: along is positive where the mount is ahead, across
where it is to the left; RA is measured on the sky.

?  Esc  q close this help
"""


REPLAY_TEXT = """\
SPACE     pause, or go on; at the end, once more from the beginning
← →       10 s back / on
PgUp PgDn 60 s back / on
Home End  the beginning / the end
,  .      one view back / on, standing still
[ ]       slower / faster, from a tenth to a hundred times
1         as fast as it was
v  t      the sky alone, or all / next theme: night, red, contrast
q  Ctrl-C leave

The recorded inputs run through today's code; what it commands goes
nowhere, and no mount moves.

?  Esc  q close this help
"""


class HelpScreen(ModalScreen[None]):
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

"""The screen of a run on a recording: the same panels, and the keys of a tape instead of those of a mount."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType

from sattrack.tui.app import TrackApp
from sattrack.tui.feed import News
from sattrack.tui.help import REPLAY_TEXT, HelpScreen
from sattrack.tui.themed import NIGHT_LOOK

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.tui.appearance import Appearance
    from sattrack.tui.feed import Feed
    from sattrack.tui.scene import Scene
    from sattrack.tui.tape import Tape
    from sattrack.views.messages import Message, SessionMessage

SHORT_S, LONG_S = 10.0, 60.0
NOTHING_MOVES = "this is a recording: there is no mount to stop; p pauses it"


class TapeFeed:
    """Hands on what `source` gives as a tape plays it; there is nobody to take messages.

    `source` may give all of a run at once, and tells its end and summary as a run does.
    """

    def __init__(self, source: Feed, tape: Tape, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._source = source
        self._monotonic = monotonic
        self._looked_s: float | None = None
        self._told = News()
        self.tape = tape

    def news(self) -> News:
        """Return what is due by the tape; the end, and what the run came to, only at its end."""
        self._told = self._source.news()
        self.tape.add(self._told.views)
        self.tape.whole = self._told.ended
        now_s = self._monotonic()
        if self._looked_s is not None:
            self.tape.run(now_s - self._looked_s)
        self._looked_s = now_s
        shown = self.tape.next()
        ended = self.tape.view.ended
        summary = self._told.summary if ended else None
        return News(shown.views, ended, summary, self._told.sky, shown.rewound)

    def send(self, message: Message | SessionMessage) -> bool:
        """Take a message to nobody."""
        del message
        return False


class ReplayApp(TrackApp, inherit_bindings=False):
    """Shows a recorded run and takes the keys of its tape."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "stop", "nothing to stop", priority=True),
        Binding("p", "pause", "pause, or go on"),
        Binding("ctrl+c", "interrupt", "interrupt", priority=True),
        Binding("ctrl+q", "leave", "quit", priority=True),
        Binding("q", "leave", "quit"),
        Binding("left", f"wind({-SHORT_S})", "back"),
        Binding("right", f"wind({SHORT_S})", "on"),
        Binding("pageup", f"wind({-LONG_S})", "back a minute"),
        Binding("pagedown", f"wind({LONG_S})", "on a minute"),
        Binding("home", "seek('begin')", "beginning"),
        Binding("end", "seek('end')", "end"),
        Binding("comma", "step(-1)", "a view back"),
        Binding("full_stop", "step(1)", "a view on"),
        Binding("left_square_bracket", "speed(-1)", "slower"),
        Binding("right_square_bracket", "speed(1)", "faster"),
        Binding("1", "speed(0)", "as it was"),
        Binding("v", "sky", "sky alone"),
        Binding("t", "next_theme", "theme"),
        Binding("question_mark", "help", "help"),
    ]

    def __init__(
        self,
        feed: TapeFeed,
        monotonic: Callable[[], float] = time.monotonic,
        appearance: Appearance = NIGHT_LOOK,
    ) -> None:
        super().__init__(feed, True, monotonic, appearance)
        self._tape = feed.tape

    @property
    def scene(self) -> Scene | None:
        """What is to be drawn; None before the first view."""
        scene = super().scene
        return None if scene is None else replace(scene, news_age_s=0.0, tape=self._tape.view)

    def _leave(self) -> None:
        """Leave: nothing is moving."""
        self.exit()

    def action_stop(self) -> None:
        """Say that no mount moves: who presses the stop key may take this for a run."""
        self._close_dialogs()
        self._hint(NOTHING_MOVES)

    def action_pause(self) -> None:
        """Stand still, or go on."""
        self._tape.pause()
        self.look()

    def action_wind(self, seconds: float) -> None:
        """Go on by so much of the run, or back."""
        self._tape.wind(seconds)
        self._look_and_plot()

    def action_seek(self, where: str) -> None:
        """Go to the beginning or to the end, as far as it was read."""
        self._tape.seek(0.0 if where == "begin" else self._tape.length_s)
        self._look_and_plot()

    def action_step(self, by: int) -> None:
        """Stand still, a view further on or back."""
        self._tape.step(by)
        self._look_and_plot()

    def action_speed(self, by: int) -> None:
        """Run faster or slower, or as fast as the run was."""
        if by:
            self._tape.change_speed(by)
        else:
            self._tape.speed = 1.0
        self.look()

    def action_help(self) -> None:
        """Show what the keys do."""
        self.push_screen(HelpScreen(REPLAY_TEXT))

    def _look_and_plot(self) -> None:
        self.look()
        self.plot()

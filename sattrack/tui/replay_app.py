"""The screen of a run on a recording: the same panels, and the keys of a tape instead of those of a mount."""

from __future__ import annotations

import time
from bisect import bisect_right
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from textual.binding import Binding, BindingType

from sattrack.tui.app import TrackApp
from sattrack.tui.dialogs import REPLAY_TEXT, show_help
from sattrack.tui.error_plot import WINDOW_S
from sattrack.tui.feeds import News
from sattrack.tui.scene import DEFAULT_APPEARANCE, SAME_S, TapeView

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sattrack.tui.feeds import Feed
    from sattrack.tui.scene import Appearance, Scene
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import TrackView

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
FASTEST, SLOWEST = SPEEDS[-1], SPEEDS[0]
LONGEST_PAUSE_S = 5.0
"""After so long the tape continues, where the clock was set or messages are missing."""


class Shown(NamedTuple):
    """What to show next: views, oldest first; `rewound` where they do not follow on those before."""

    views: tuple[TrackView, ...]
    rewound: bool


class Tape:
    """Views in the order of the run. Time goes as in the run, but for pauses longer than LONGEST_PAUSE_S."""

    def __init__(self, name: str, speed: float = 1.0) -> None:
        self._name = name
        self._views: list[TrackView] = []
        self._at: list[float] = []
        """When each is due, seconds from the first."""
        self._now_s = 0.0
        self._shown = 0
        """How many have been handed out."""
        self._jumped = False
        self.playing = True
        self.speed = min(FASTEST, max(SLOWEST, speed))
        self.whole = False

    def add(self, views: Iterable[TrackView]) -> None:
        """Put more of the run at the end."""
        for view in views:
            passed_s = view.utc_s - self._views[-1].utc_s if self._views else 0.0
            pause_s = min(LONGEST_PAUSE_S, max(0.0, passed_s))
            self._at.append(self._at[-1] + pause_s if self._at else 0.0)
            self._views.append(view)

    @property
    def length_s(self) -> float:
        """How long it is, as far as it was read."""
        return self._at[-1] if self._at else 0.0

    @property
    def view(self) -> TapeView:
        """What is shown of it."""
        return TapeView(self._name, self._now_s, self.length_s, self.playing, self.speed, self.whole)

    def run(self, seconds: float) -> None:
        """Let so much time pass on the viewer's clock."""
        if self.playing:
            self._now_s = min(self.length_s, self._now_s + self.speed * max(0.0, seconds))

    def pause(self) -> None:
        """Stand still, or go on; from the end, from the beginning."""
        if self.view.ended:
            self.seek(0.0)
            self.playing = True
            return
        self.playing = not self.playing

    def seek(self, at_s: float) -> None:
        """Go to an instant, seconds from the beginning."""
        self._now_s = min(self.length_s, max(0.0, at_s))
        self._jumped = True

    def wind(self, seconds: float) -> None:
        """Go on by so much of the run, or back."""
        self.seek(self._now_s + seconds)

    def step(self, by: int) -> None:
        """Stand still, a view further on or back."""
        self.playing = False
        at = max(0, min(len(self._at) - 1, self._index - 1 + by))
        if self._at:
            self.seek(self._at[at])

    def change_speed(self, by: int) -> None:
        """Run faster or slower."""
        at = bisect_right(SPEEDS, self.speed + SAME_S) - 1
        if by < 0 and self.speed > SPEEDS[at] + SAME_S:
            at += 1
        self.speed = SPEEDS[max(0, min(len(SPEEDS) - 1, at + by))]

    @property
    def _index(self) -> int:
        """How many views are due."""
        return bisect_right(self._at, self._now_s + SAME_S)

    def next(self) -> Shown:
        """Return what is due and was not shown; after a jump, what a plot of the last minutes needs."""
        due, jumped = self._index, self._jumped
        self._jumped = False
        first = bisect_right(self._at, self._now_s - WINDOW_S) if jumped else self._shown
        self._shown = due
        return Shown(tuple(self._views[first:due]), jumped)


SHORT_S, LONG_S = 10.0, 60.0
NOTHING_MOVES = "this is a recording: there is no mount to stop; p pauses it"


class TapeFeed:
    """Hands on what `source` gives as a tape plays it; there is nobody to take messages.

    `source` may give all of a run at once, and reports its end and summary as a run does.
    """

    def __init__(self, source: Feed, tape: Tape, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._source = source
        self._monotonic = monotonic
        self._looked_s: float | None = None
        self._latest = News()
        self.tape = tape

    def news(self) -> News:
        """Return what is due by the tape; the end, and what the run came to, only at its end."""
        self._latest = self._source.news()
        self.tape.add(self._latest.views)
        self.tape.whole = self._latest.ended
        now_s = self._monotonic()
        if self._looked_s is not None:
            self.tape.run(now_s - self._looked_s)
        self._looked_s = now_s
        shown = self.tape.next()
        ended = self.tape.view.ended
        summary = self._latest.summary if ended else None
        return News(shown.views, ended, summary, self._latest.sky, shown.rewound)

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
        appearance: Appearance = DEFAULT_APPEARANCE,
    ) -> None:
        super().__init__(feed, True, monotonic, appearance)
        self._tape = feed.tape

    @property
    def scene(self) -> Scene | None:
        """What to draw; None before the first view."""
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
        show_help(self, REPLAY_TEXT)

    def _look_and_plot(self) -> None:
        self.look()
        self.plot()

"""A recorded run as a tape: where it stands, how fast it runs, and what of it is to be shown next. Pure."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from sattrack.tui.history import WINDOW_S

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sattrack.views.run import TrackView

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
FASTEST, SLOWEST = SPEEDS[-1], SPEEDS[0]
LONGEST_PAUSE_S = 5.0
"""Where the clock was set, or messages are missing, the tape goes on after so long."""
SAME_S = 1e-6


@dataclass(frozen=True, slots=True)
class TapeView:
    """What is shown of a tape: seconds from its beginning, and how many there are as far as it was read."""

    name: str
    at_s: float
    length_s: float
    playing: bool
    speed: float
    whole: bool
    """Whether it was read to its end."""

    @property
    def ended(self) -> bool:
        """Whether it stands at its end."""
        return self.whole and self.at_s >= self.length_s - SAME_S


class Shown(NamedTuple):
    """What is to be shown next: views, oldest first; `rewound` where they do not follow on those before."""

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
        """Let so much time go by on the clock of whoever looks."""
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

"""What the keys that move the target mean as messages: nudges, offsets, searches, and taking them back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.messages import ClearBias, Nudge, OffsetBy, Search
from sattrack.tui.frames import FRAMES, TRACK
from sattrack.tui.steps import FIRST_STEP, STEPS

if TYPE_CHECKING:
    from sattrack.messages import Message
    from sattrack.tui.frames import Frame
    from sattrack.tui.steps import Step
    from sattrack.view import TrackView

SPIRAL_STEPS = 10.0
SPIRAL_ARMS_S = 0.5
"""A spiral's arms lie ten steps apart, and half of that is run in a second."""
SWEEP_STEPS = 10.0
SWEEP_PERIOD_S = 20.0
GRADUAL_STEPS = 10.0
GRADUAL_S = 20.0
"""A gradual nudge goes ten steps in so many seconds."""
UNDO_AT_MOST = 100


class Hand:
    """The step and the frame that are chosen, and what was done with them."""

    def __init__(self) -> None:
        self._step = FIRST_STEP
        self._frame = 0
        self._undo: list[tuple[Message, ...]] = []

    @property
    def step(self) -> Step:
        """By how much an arrow moves."""
        return STEPS[self._step]

    @property
    def frame(self) -> Frame:
        """In which frame the arrows move."""
        return FRAMES[self._frame]

    def resize(self, by: int) -> None:
        """Choose a smaller or a larger step."""
        self._step = min(len(STEPS) - 1, max(0, self._step + by))

    def turn_frame(self) -> None:
        """Go on to the next frame."""
        self._frame = (self._frame + 1) % len(FRAMES)

    def forget(self) -> None:
        """Have nothing to take back any more: another run has begun."""
        self._undo.clear()

    def nudge(self, along: int, across: int) -> list[Message]:
        """Move the target by one step: along its track or across it, or as the frame has it."""
        step, frame = self.step, self.frame
        if frame is not TRACK:
            move, sign = (frame.across, along) if along else (frame.upward, across)
            value = sign * step.cross_deg
            self._keep(OffsetBy(move.what, "add", -value))
            return [OffsetBy(move.what, "add", value)]
        there = Nudge(along * step.along_s if along else 0.0, across * step.cross_deg if across else 0.0)
        self._keep(Nudge(0.0 - there.along_s, 0.0 - there.cross_deg))
        return [there]

    def creep(self, along: int, across: int, view: TrackView) -> list[Message]:
        """Move the target gently, by ten steps in GRADUAL_S."""
        move, sign = (self.frame.across, along) if along else (self.frame.upward, across)
        size = self.step.along_s if move.what == "along_s" else self.step.cross_deg
        before = _total(view, move.what)
        self._keep(OffsetBy(move.what, "set", before))
        value = before + sign * GRADUAL_STEPS * size
        return [OffsetBy(move.what, "gradual", value, GRADUAL_S)]

    def search(self, how: str, view: TrackView | None) -> list[Message]:
        """Begin a search, its size by the step; or end the one that runs where it is."""
        if _searching(view):
            return [Search("stop")]
        if how == "spiral":
            spacing_deg = SPIRAL_STEPS * self.step.cross_deg
            return [Search(how, spacing_deg=spacing_deg, speed_deg_s=SPIRAL_ARMS_S * spacing_deg)]
        return [Search(how, reach_s=SWEEP_STEPS * self.step.along_s, period_s=SWEEP_PERIOD_S)]

    def cancel_search(self, view: TrackView | None) -> list[Message]:
        """End a search that runs, back in its centre."""
        return [Search("cancel")] if _searching(view) else []

    def reset(self, view: TrackView | None) -> list[Message]:
        """Take the offsets of the frame away."""
        moves = (self.frame.across.what, self.frame.upward.what)
        self._keep_totals(view, moves)
        return [OffsetBy(what, "reset") for what in moves]

    def clear(self, view: TrackView | None) -> list[Message]:
        """Take everything back: nudges, offsets, search and estimate."""
        self._keep_totals(view, None)
        return [ClearBias()]

    def undo(self) -> list[Message]:
        """Take back what was done last to the offsets."""
        return list(self._undo.pop()) if self._undo else []

    def _keep_totals(self, view: TrackView | None, moves: tuple[str, ...] | None) -> None:
        offsets = () if view is None else view.offsets
        back = [OffsetBy(one.what, "set", one.total) for one in offsets if moves is None or one.what in moves]
        if back:
            self._keep(*back)

    def _keep(self, *back: Message) -> None:
        self._undo.append(back)
        del self._undo[:-UNDO_AT_MOST]


def _total(view: TrackView, what: str) -> float:
    return next((one.total for one in view.offsets if one.what == what), 0.0)


def _searching(view: TrackView | None) -> bool:
    return view is not None and view.search is not None

"""What the keys that move the target mean as messages: nudges, offsets, searches, and taking them back."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sattrack.views.messages import ClearBias, Nudge, OffsetBy, Search

if TYPE_CHECKING:
    from sattrack.views.messages import Message
    from sattrack.views.run import TrackView


class Move(NamedTuple):
    """One pair of arrows: the offset that they change, its label, and what each arrow does in a word."""

    what: str
    label: str
    minus: str
    plus: str


class Frame(NamedTuple):
    """A frame: its name, and what left and right, down and up change."""

    name: str
    across: Move
    upward: Move


FRAMES = (
    Frame(
        "track",
        Move("along_s", "along", "behind", "ahead"),
        Move("cross_deg", "across", "right of motion", "left"),
    ),
    Frame("sky", Move("ra_cos_dec_deg", "RA sky", "west", "east"), Move("dec_deg", "Dec", "south", "north")),
    Frame(
        "axes",
        Move("ra_axis_deg", "RA axis", "less", "more"),
        Move("dec_axis_deg", "Dec axis", "less", "more"),
    ),
    Frame(
        "camera", Move("camera_x_deg", "cam x", "less", "more"), Move("camera_y_deg", "cam y", "less", "more")
    ),
)
TRACK = FRAMES[0]
LABELS = {move.what: move.label for frame in FRAMES for move in (frame.across, frame.upward)}


class NudgeStep(NamedTuple):
    """One press of an arrow: seconds along the track, degrees across it."""

    along_s: float
    cross_deg: float


STEPS = (
    NudgeStep(0.01, 0.001),
    NudgeStep(0.05, 0.005),
    NudgeStep(0.1, 0.01),
    NudgeStep(0.5, 0.05),
    NudgeStep(1.0, 0.1),
)
FIRST_STEP = 2


SPIRAL_STEPS = 10.0
SPIRAL_ARMS_S = 0.5
"""A spiral's arms lie ten steps apart, and half of that is run in a second."""
SWEEP_STEPS = 10.0
SWEEP_PERIOD_S = 20.0
GRADUAL_STEPS = 10.0
GRADUAL_S = 20.0
"""A gradual nudge goes ten steps in so many seconds."""
UNDO_AT_MOST = 100
SHOWN_AFTER_S = 0.5
"""After how long a view shows what was asked for at the latest."""


class OffsetKeys:
    """The step and the frame that are chosen, and what was done with them."""

    def __init__(self) -> None:
        self._step = FIRST_STEP
        self._frame = 0
        self._undo: list[tuple[Message, ...]] = []
        self._asked: dict[str, tuple[float, float]] = {}
        """The total that each offset was last moved to from here, and the instant of the view seen then."""

    @property
    def step(self) -> NudgeStep:
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
        self._asked.clear()

    def nudge(self, along: int, across: int, view: TrackView | None = None) -> list[Message]:
        """Move the target by one step: along its track or across it, or as the frame has it."""
        step, frame = self.step, self.frame
        if frame is not TRACK:
            move, sign = (frame.across, along) if along else (frame.upward, across)
            value = sign * step.cross_deg
            self._keep(OffsetBy(move.what, "add", -value))
            return self._expect([OffsetBy(move.what, "add", value)], view)
        there = Nudge(along * step.along_s if along else 0.0, across * step.cross_deg if across else 0.0)
        self._keep(Nudge(0.0 - there.along_s, 0.0 - there.cross_deg))
        return self._expect([there], view)

    def creep(self, along: int, across: int, view: TrackView) -> list[Message]:
        """Move the target gently, by ten steps in GRADUAL_S."""
        move, sign = (self.frame.across, along) if along else (self.frame.upward, across)
        size = self.step.along_s if move.what == "along_s" else self.step.cross_deg
        before = self._total(view, move.what)
        self._keep(OffsetBy(move.what, "set", before))
        value = before + sign * GRADUAL_STEPS * size
        return self._expect([OffsetBy(move.what, "gradual", value, GRADUAL_S)], view)

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
        self._asked.clear()
        return [OffsetBy(what, "reset") for what in moves]

    def clear(self, view: TrackView | None) -> list[Message]:
        """Take everything back: nudges, offsets, search and estimate."""
        self._keep_totals(view, None)
        self._asked.clear()
        return [ClearBias()]

    def undo(self, view: TrackView | None = None) -> list[Message]:
        """Take back what was done last to the offsets."""
        return self._expect(list(self._undo.pop()) if self._undo else [], view)

    def _expect(self, messages: list[Message], view: TrackView | None) -> list[Message]:
        """Keep what these come to, until a view shows it; return them."""
        if view is None:
            return messages
        for message in messages:
            match message:
                case Nudge(along_s=along_s, cross_deg=0.0):
                    self._asked["along_s"] = (self._total(view, "along_s") + along_s, view.utc_s)
                case Nudge(cross_deg=cross_deg):
                    self._asked["cross_deg"] = (self._total(view, "cross_deg") + cross_deg, view.utc_s)
                case OffsetBy(value=float(value)):
                    before = self._total(view, message.what) if message.how == "add" else 0.0
                    self._asked[message.what] = (before + value, view.utc_s)
        return messages

    def _total(self, view: TrackView, what: str) -> float:
        """Return an offset's total: what was asked for from here last, until a view can show it."""
        asked = self._asked.get(what)
        if asked is not None and 0.0 <= view.utc_s - asked[1] < SHOWN_AFTER_S:
            return asked[0]
        return next((one.total for one in view.offsets if one.what == what), 0.0)

    def _keep_totals(self, view: TrackView | None, moves: tuple[str, ...] | None) -> None:
        offsets = () if view is None else view.offsets
        back = [OffsetBy(one.what, "set", one.total) for one in offsets if moves is None or one.what in moves]
        if back:
            self._keep(*back)

    def _keep(self, *back: Message) -> None:
        self._undo.append(back)
        del self._undo[:-UNDO_AT_MOST]


def _searching(view: TrackView | None) -> bool:
    return view is not None and view.search is not None

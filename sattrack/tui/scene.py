"""What a screen must show: the newest view, what the keys have asked for, and how both read as text.

Nothing here draws, so that the look of a screen can be chosen before Textual is imported.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.core.errors import UNHEARD
from sattrack.views import formatting
from sattrack.views.messages import ClearBias, Nudge, OffsetBy, Search, Slip
from sattrack.views.run import STARTER

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.views.messages import Message
    from sattrack.views.run import PassView, SessionView, Summary, TrackView

    CellOfPixels = Callable[[], tuple[int, int] | None]


@dataclass(frozen=True, slots=True)
class Appearance:
    """By which theme a screen is drawn, and whether with the characters of ASCII alone."""

    theme: str = "night"
    plain: bool = False


DEFAULT_APPEARANCE = Appearance()


class TerminalPixels(NamedTuple):
    """What returns the pixels of a terminal's cells; it draws kitty's way, as a page, or else by sixels."""

    cell: CellOfPixels
    kitty: bool = False
    browser: bool = False


def can_show(encoding: str | None) -> bool:
    """Tell whether a terminal of an encoding has the characters that the screens are drawn with."""
    try:
        "⣿●━″".encode(encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


LIVE, TONIGHT, MOUNT, SCHEDULE, LOG = "live", "tonight", "mount", "schedule", "log"
CAMERA = "camera"
PAGES = {"1": LIVE, "2": TONIGHT, "3": MOUNT, "4": SCHEDULE, "5": LOG, "6": CAMERA}
PAGE_CLASSES = {page: f"-page-{page}" for page in PAGES.values()}


ON_TARGET_ARCSEC = 2.0
NO_NEWS_AFTER_S = 1.5
OLD_ELEMENTS_S = 3.0 * formatting.DAY_S
STOP_UNHEARD_AFTER_S = 1.5
REFUSAL_SHOWN_S = 4.0
PAUSED = "paused"
"""The phase of a run that is paused."""


class Move(NamedTuple):
    """One pair of arrows: the offset that they change, its label, and what each arrow does in a word."""

    what: str
    label: str
    minus: str
    plus: str


class OffsetFrame(NamedTuple):
    """A frame: its name, and what left and right, down and up change."""

    name: str
    across: Move
    upward: Move


FRAMES = (
    OffsetFrame(
        "track",
        Move("along_s", "along", "behind", "ahead"),
        Move("cross_deg", "across", "right of motion", "left"),
    ),
    OffsetFrame(
        "sky", Move("ra_cos_dec_deg", "RA sky", "west", "east"), Move("dec_deg", "Dec", "south", "north")
    ),
    OffsetFrame(
        "axes",
        Move("ra_axis_deg", "RA axis", "less", "more"),
        Move("dec_axis_deg", "Dec axis", "less", "more"),
    ),
    OffsetFrame(
        "camera", Move("camera_x_deg", "cam x", "less", "more"), Move("camera_y_deg", "cam y", "less", "more")
    ),
)
TRACK = FRAMES[0]
LABELS = {move.what: move.label for frame in FRAMES for move in (frame.across, frame.upward)}


class Tone(StrEnum):
    """How urgent something is; also the style class it is drawn in."""

    GOOD = "good"
    CALM = "calm"
    NOTICE = "notice"
    BAD = "bad"


class Headline(NamedTuple):
    """The one thing to read first: a word, the rest of the sentence, and its tone."""

    word: str
    rest: str
    tone: Tone


class Caution(NamedTuple):
    """Something that wants attention, and what to do about it."""

    what: str
    do: str
    tone: Tone


SAME_S = 1e-6
"""Instants of a tape that lie nearer are the same."""


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


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything the screen draws from."""

    view: TrackView
    step: NudgeStep
    news_age_s: float = 0.0
    """Seconds since the feeder was last heard, by this process's own clock."""
    stop_sent_s: float | None = None
    """Seconds since the stop key was pressed; None where it was not."""
    leaving: bool = False
    ended: bool = False
    """Whether the feeder's process has ended its stream."""
    summary: Summary | None = None
    frame: OffsetFrame = TRACK
    """What the arrow keys move the target by."""
    sky: PassView | None = None
    """What is known of the pass beforehand; None where nothing is."""
    tape: TapeView | None = None
    """The position of a recording that is shown; None for a live run."""
    plain: bool = False
    """Whether there are no characters but those of ASCII."""
    session: SessionView | None = None
    """Who has control, and who watches."""
    you: int = STARTER
    """The number of this viewer."""
    beginning: bool = False
    """Whether another run begins, of which there is no view yet."""
    between: str | None = None
    """What the schedule does to which the run belonged that is over; None where nothing comes after it."""
    page: str = LIVE
    """Which screen is shown."""
    refused_s: float | None = None
    """Seconds since a key was of no use for want of control; None where none was."""
    hint: str = ""
    """The answer to a key that did nothing."""
    jog_rate: int | None = None
    """Which jog rate is chosen, 1 to 6, while the run is paused; None while it is not."""

    @property
    def in_control(self) -> bool:
        """Whether keys that move the target are obeyed from here."""
        return self.session is None or self.session.controller == self.you

    @property
    def attached(self) -> bool:
        """Whether the run was started elsewhere."""
        return self.you != STARTER

    @property
    def following(self) -> bool:
        """Whether the error is that of following, not the way still to go."""
        return self.view.phase in {"acquiring", "tracking"}


_PHASES = {
    "acquiring": ("ACQUIRING", "closing in on the satellite", Tone.NOTICE),
    "holding": ("HOLDING", "at a limit, until the satellite comes back", Tone.NOTICE),
    "stopping": ("STOPPING", "bringing the mount to rest", Tone.NOTICE),
}

_ADVICE = (
    ("no fresh status", "check the mount's power and cable; SPACE stops"),
    ("held at the", "wait, or stop with SPACE"),
    ("the mount's rate limit", "the error grows until the satellite slows; SPACE stops"),
    ("the stop is not confirmed", "if the mount still moves, use its own stop"),
    ("another program", "SPACE stops the mount all the same"),
    ("the mount's clock", "errors may be larger; calibrate after the pass"),
    ("the mount was not where", "see that nothing holds it; SPACE stops"),
    ("this side of the pier", "if the error grows, SPACE stops; calibrate on this side"),
)


def headline(scene: Scene) -> Headline:
    """Return what to read first."""
    view = scene.view
    if scene.ended or scene.beginning:
        return _over(scene)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        rest = f"from the run for {scene.news_age_s:.0f} s: figures below are old"
        return Headline("NO NEWS", rest, Tone.BAD)
    if scene.stop_sent_s is not None and view.ended_by is None:
        return Headline("STOP SENT", "not confirmed yet", Tone.NOTICE)
    if view.ended_by is not None:
        return Headline("STOPPING", f"{why_ended(view.ended_by)}; bringing the mount to rest", Tone.NOTICE)
    return _under_way(scene)


def _under_way(scene: Scene) -> Headline:
    view = scene.view
    if view.phase == PAUSED:
        return _paused(scene)
    if view.phase == "tracking":
        return _tracking(view)
    if view.phase in {"waiting", "slewing"}:
        return _coming(view, _foretold(scene.sky))
    word, rest, tone = _PHASES.get(view.phase, (view.phase.upper(), "", Tone.NOTICE))
    return Headline(word, rest, tone)


def _foretold(sky: PassView | None) -> str:
    """Return what the mount will lose of a pass, as the end of a line."""
    if sky is None or sky.lost_from_utc_s is None:
        return ""
    axes = formatting.EQUATORIAL if sky.mount_pole_deg is None else ("first axis", "second axis")
    limit = formatting.limit_title(sky.lost_to or "", axes)
    return f"; about {sky.lost_s:.0f} s lost from {formatting.clock(sky.lost_from_utc_s)} on: {limit}"


def _coming(view: TrackView, foretold: str) -> Headline:
    left_s = view.start_utc_s - view.utc_s
    when = f" in {formatting.span(left_s)}" if left_s > 0.0 else ""
    if formatting.phase_text(view) == "slewing":
        return Headline("SLEWING", f"to where the satellite will come by{when}{foretold}", Tone.CALM)
    rest = f"for the pass to begin{when}" if when else "until it can be followed"
    return Headline("WAITING", f"{rest}{foretold}", Tone.CALM)


def _tracking(view: TrackView) -> Headline:
    off = view.error.total_arcsec if view.error is not None else 0.0
    if view.link.state != "up":
        return Headline("TRACKING", "blind: no fresh status from the mount", Tone.BAD)
    if off > ON_TARGET_ARCSEC:
        return Headline("TRACKING", f"off the satellite by {formatting.arcsec(off)}", Tone.NOTICE)
    return Headline("TRACKING", "on the satellite: all is well", Tone.GOOD)


def _paused(scene: Scene) -> Headline:
    view, pause = scene.view, scene.view.pause
    doing, goes = "bringing the mount to rest", "; p goes on"
    if pause is not None and pause.going_on:
        doing, goes = "going on as soon as the mount is at rest", ""
    elif pause is not None and pause.jogging:
        doing = "the mount is jogged"
    elif pause is not None and pause.at_rest:
        doing = "the mount is at rest"
    if view.utc_s < view.start_utc_s:
        until = f"the pass begins in {formatting.span(view.start_utc_s - view.utc_s)}"
    else:
        until = f"the pass lasts {formatting.span(view.end_utc_s - view.utc_s)} more"
    if not scene.in_control or scene.tape is not None:
        goes = ""
    return Headline("PAUSED", f"{doing}; {until}{goes}", Tone.NOTICE)


def _over(scene: Scene) -> Headline:
    if scene.beginning:
        return Headline("STARTING", "the next pass; figures below are of the last one", Tone.CALM)
    return _ended(scene) if scene.between is None else _between(scene, scene.between)


def _ended(scene: Scene) -> Headline:
    summary, ended_by = scene.summary, scene.view.ended_by
    if scene.tape is not None:
        why = "it is cut off here" if ended_by is None else why_ended(ended_by)
        return Headline("END", f"of the recording: {why}; q leaves", Tone.CALM)
    if summary is None and scene.attached:
        return Headline("RUN LOST", "its guardian stops the mount; make sure that it is at rest", Tone.BAD)
    if summary is None:
        return Headline("RUN LOST", "it ended unexpectedly: stop the mount by hand", Tone.BAD)
    why = why_ended(summary.ended_by)
    if summary.mount_stopped is False:
        return Headline("NOT STOPPED", "no stop was confirmed: stop the mount by hand", Tone.BAD)
    rest = "the mount is at rest" if summary.mount_stopped else "the mount was never heard"
    tone = Tone.CALM if summary.ended_by in {"set", "operator"} and summary.mount_stopped else Tone.BAD
    return Headline("STOPPED" if summary.ended_by != "set" else "ENDED", f"{why}; {rest}; q leaves", tone)


def _between(scene: Scene, doing: str) -> Headline:
    if scene.stop_sent_s is not None:
        return Headline("STOP SENT", "until the mount is at rest and the schedule has ended", Tone.NOTICE)
    if scene.summary is None:
        return Headline("RUN LOST", f"its guardian stops the mount; {doing}", Tone.NOTICE)
    if scene.summary.mount_stopped is False:
        return Headline("NOT STOPPED", f"no stop was confirmed; {doing}", Tone.BAD)
    return Headline("ENDED", f"{why_ended(scene.summary.ended_by)}; {doing}", Tone.CALM)


def why_ended(ended_by: str) -> str:
    """Return the reason of an end as text."""
    if ended_by.startswith("limit:"):
        return f"safety's {ended_by.removeprefix('limit:')} limit was reached"
    plain = {
        "set": "the pass is over",
        "operator": "by the operator",
        "link": "the mount's link was lost",
        "error": "it could not go on",
    }
    return plain.get(ended_by, ended_by)


def cautions(scene: Scene) -> tuple[Caution, ...]:
    """Return what wants attention, the gravest first; of a recording, what did, with nothing to be done."""
    found = _cautions(scene)
    return found if scene.tape is None else tuple(Caution(one.what, "", one.tone) for one in found)


def _cautions(scene: Scene) -> tuple[Caution, ...]:
    found: list[Caution] = []
    view = scene.view
    if scene.leaving and not scene.ended:
        found.append(Caution("leaving as soon as the mount is at rest", "q again leaves at once", Tone.CALM))
    if scene.refused_s is not None and scene.refused_s < REFUSAL_SHOWN_S and not scene.in_control:
        found.append(Caution("you are watching; this key does nothing", "c takes control", Tone.NOTICE))
    if scene.hint:
        found.append(Caution(scene.hint, "", Tone.NOTICE))
    if scene.ended:
        if scene.summary is not None and scene.summary.message:
            found.append(Caution(scene.summary.message, "", Tone.BAD))
        return tuple(found)
    if scene.beginning:
        return tuple(found)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        found.append(
            Caution("the run does not answer", "press SPACE, then use the mount's own stop", Tone.BAD)
        )
    elif scene.stop_sent_s is not None and scene.stop_sent_s > STOP_UNHEARD_AFTER_S and view.ended_by is None:
        found.append(Caution("the stop was not obeyed", "use the mount's own stop", Tone.BAD))
    for text in view.warnings:
        advice = next((do for begins, do in _ADVICE if text.startswith(begins)), "")
        found.append(Caution(text, advice, Tone.BAD if view.link.state == "lost" else Tone.NOTICE))
    if view.link.state == "silent" and view.ended_by is None:
        found.append(Caution("the mount has not answered yet", UNHEARD, Tone.NOTICE))
    age_s = view.elements_age_s
    if by_elements(view) and age_s is not None and abs(age_s) > OLD_ELEMENTS_S:
        # A clock that is behind makes elements lie ahead.
        clock = "see that this machine's clock is right; " if age_s < 0.0 else ""
        nudge = ": ← → nudge" if scene.in_control else ""
        old = f"elements are {formatting.old(age_s)}"
        found.append(Caution(old, f"{clock}expect the satellite early or late{nudge}", Tone.NOTICE))
    return tuple(found)


def axis_names(scene: Scene) -> tuple[str, str]:
    """Return what errors and rates of both axes are called: those of a geometry are no RA and Dec."""
    return ("RA", "Dec") if scene.view.axes is None else ("ax 1", "ax 2")


def by_elements(view: TrackView) -> bool:
    """Tell whether the target's places are those of elements, as far as is known."""
    return view.source is None or view.source.startswith("SGP4")


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
SLIP_S = 10.0
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
    def frame(self) -> OffsetFrame:
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

    def shift(self, east_deg: float, north_deg: float, view: TrackView | None) -> list[Message]:
        """Move the target on the sky, as a picture shows it."""
        moves = (("ra_cos_dec_deg", east_deg), ("dec_deg", north_deg))
        self._keep(*(OffsetBy(what, "add", -value) for what, value in moves))
        return self._expect([OffsetBy(what, "add", value) for what, value in moves], view)

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

    def slip(self, way: int) -> list[Message]:
        """Have the T0 of a launch later, or earlier, by a step."""
        self._keep(Slip(-way * SLIP_S))
        return [Slip(way * SLIP_S)]

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

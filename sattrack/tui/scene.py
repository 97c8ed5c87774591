"""What one look must show: the newest view, what the keys have asked for, and how both read as text."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.tui import words
from sattrack.tui.offsets import TRACK
from sattrack.views.run import STARTER

if TYPE_CHECKING:
    from sattrack.tui.offsets import Frame, NudgeStep
    from sattrack.tui.replay_app import TapeView
    from sattrack.views.run import PassView, SessionView, Summary, TrackView

LIVE, TONIGHT, MOUNT, SCHEDULE, LOG = "live", "tonight", "mount", "schedule", "log"
PAGES = {"1": LIVE, "2": TONIGHT, "3": MOUNT, "4": SCHEDULE, "5": LOG}
PAGE_CLASSES = {page: f"-page-{page}" for page in PAGES.values()}


ON_TARGET_ARCSEC = 2.0
NO_NEWS_AFTER_S = 1.5
OLD_ELEMENTS_S = 3.0 * words.DAY_S
STOP_UNHEARD_AFTER_S = 1.5
REFUSAL_SHOWN_S = 4.0
PAUSED = "paused"
"""The phase of a run that is paused."""


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
    frame: Frame = TRACK
    """What the arrow keys move the target by."""
    sky: PassView | None = None
    """What is known of the pass beforehand; None where nothing is."""
    tape: TapeView | None = None
    """Where a recording stands that is shown; None for a run that goes on now."""
    plain: bool = False
    """Whether there are no characters but those of ASCII."""
    session: SessionView | None = None
    """Who has control, and who looks on."""
    you: int = STARTER
    """The number of whoever looks here."""
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
        return _coming(view)
    word, rest, tone = _PHASES.get(view.phase, (view.phase.upper(), "", Tone.NOTICE))
    return Headline(word, rest, tone)


def _coming(view: TrackView) -> Headline:
    left_s = view.start_utc_s - view.utc_s
    when = f" in {words.span(left_s)}" if left_s > 0.0 else ""
    if view.phase == "slewing":
        return Headline("SLEWING", f"to where the satellite will come by{when}", Tone.CALM)
    return Headline(
        "WAITING", f"for the pass to begin{when}" if when else "until it can be followed", Tone.CALM
    )


def _tracking(view: TrackView) -> Headline:
    off = view.error.total_arcsec if view.error is not None else 0.0
    if view.link.state != "up":
        return Headline("TRACKING", "blind: no fresh status from the mount", Tone.BAD)
    if off > ON_TARGET_ARCSEC:
        return Headline("TRACKING", f"off the satellite by {words.arcsec(off)}", Tone.NOTICE)
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
        until = f"the pass begins in {words.span(view.start_utc_s - view.utc_s)}"
    else:
        until = f"the pass lasts {words.span(view.end_utc_s - view.utc_s)} more"
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
        return Headline("RUN LOST", "it ended without a word: stop the mount by hand", Tone.BAD)
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
        found.append(Caution("you look on, and this key does nothing", "c takes control", Tone.NOTICE))
    if scene.hint:
        found.append(Caution(scene.hint, "", Tone.NOTICE))
    if scene.ended:
        if scene.summary is not None and scene.summary.message:
            found.append(Caution(scene.summary.message, "", Tone.BAD))
        return tuple(found)
    if scene.beginning:
        return tuple(found)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        found.append(Caution("the run says nothing", "press SPACE, then use the mount's own stop", Tone.BAD))
    elif scene.stop_sent_s is not None and scene.stop_sent_s > STOP_UNHEARD_AFTER_S and view.ended_by is None:
        found.append(Caution("the stop was not obeyed", "use the mount's own stop", Tone.BAD))
    for text in view.warnings:
        advice = next((do for begins, do in _ADVICE if text.startswith(begins)), "")
        found.append(Caution(text, advice, Tone.BAD if view.link.state == "lost" else Tone.NOTICE))
    if view.link.state == "silent" and view.ended_by is None:
        found.append(
            Caution("the mount has not answered yet", "is it on, and set to send here?", Tone.NOTICE)
        )
    if view.elements_age_s is not None and view.elements_age_s > OLD_ELEMENTS_S:
        nudge = ": ← → nudge" if scene.in_control else ""
        old = f"elements are {words.age(view.elements_age_s)} old"
        found.append(Caution(old, f"expect the satellite early or late{nudge}", Tone.NOTICE))
    return tuple(found)

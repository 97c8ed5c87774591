"""What one look at a mount must tell: its state in a word, what wants attention, and how fast a jog is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.mount.model import DTICS_S_PER_DEG_S
from sattrack.tui.scene import NO_NEWS_AFTER_S, STOP_UNHEARD_AFTER_S, Caution, Headline, Tone
from sattrack.views.console_words import SIDEREAL_DTICS_S, number

if TYPE_CHECKING:
    from sattrack.mount.model import Status
    from sattrack.views.run import ConsoleView

JOG_RATES_DEG_S = (0.02, 0.1, 0.5, 2.0)
"""Between the guide rate and the profile's limit."""
FIRST_RATE = 2
RATES = len(JOG_RATES_DEG_S) + 2
HALF_SIDEREAL_DEG_S = SIDEREAL_DTICS_S / DTICS_S_PER_DEG_S / 2.0


@dataclass(frozen=True, slots=True)
class ConsoleScene:
    """Everything the screen draws from."""

    view: ConsoleView
    rate: int = FIRST_RATE
    """Which of the six jog rates is chosen, 1 to 6."""
    news_age_s: float = 0.0
    """Seconds since the console was last heard, by this process's own clock."""
    stop_sent_s: float | None = None
    """Seconds since the stop key was pressed; None where it was not, or was obeyed."""
    leaving: bool = False
    ended: bool = False
    """Whether the console's process has ended its stream."""
    by_brackets: bool = False
    """Whether the brackets choose the jog rate, and not its own key."""


def jog_rates_deg_s(view: ConsoleView) -> tuple[float, ...]:
    """Return the six rates of the keys 1 to 6, growing: the mount's guide rate first, the limit last."""
    limit = min(view.max_ra_rate_deg_s, view.max_dec_rate_deg_s)
    guide = view.guide_rate_deg_s
    if guide is None or not 0.0 < guide < JOG_RATES_DEG_S[0]:
        guide = HALF_SIDEREAL_DEG_S
    return tuple(min(rate, limit) for rate in (guide, *JOG_RATES_DEG_S, limit))


def headline(scene: ConsoleScene) -> Headline:
    """Return what is to be read first."""
    view = scene.view
    if scene.ended:
        return Headline("CONSOLE ENDED", "nothing here is live; q leaves", Tone.BAD)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        rest = f"from the console for {scene.news_age_s:.0f} s: everything below is old"
        return Headline("NO NEWS", rest, Tone.BAD)
    if view.link.state == "silent":
        return Headline("NOT HEARD", "no status from the mount yet", Tone.NOTICE)
    if view.link.state == "lost":
        return Headline("LINK LOST", "the mount is silent: everything below is old", Tone.BAD)
    if scene.stop_sent_s is not None:
        return Headline("STOP SENT", "not confirmed yet", Tone.NOTICE)
    return _doing(view) if view.status is None else _doing_of(view, view.status)


def _doing(view: ConsoleView) -> Headline:
    return Headline(view.doing.upper(), "", Tone.NOTICE)


def _doing_of(view: ConsoleView, status: Status) -> Headline:
    if view.doing == "stopping":
        return Headline("STOPPING", "bringing the mount to rest", Tone.NOTICE)
    if view.tripped is not None and view.at_rest:
        return Headline("LIMIT", f"stopped at the {view.tripped} limit; r lets it move again", Tone.BAD)
    if view.doing == "jogging":
        ra, dec = number(view.ra_rate_deg_s, 4, sign=True), number(view.dec_rate_deg_s, 4, sign=True)
        return Headline("JOGGING", f"RA {ra}  Dec {dec} °/s against the stars", Tone.NOTICE)
    if view.doing != "idle":
        word, _, rest = view.doing.partition(" ")
        return Headline(word.upper(), rest or "by order from here", Tone.NOTICE)
    return _idle(view, status)


def _idle(view: ConsoleView, status: Status) -> Headline:
    if status.slewing or not view.at_rest:
        return Headline("MOVING", "not by this console", Tone.NOTICE)
    if status.at_park:
        return Headline("PARKED", "the drives have no power", Tone.CALM)
    if abs(status.ra_rate_dtics_s) < SIDEREAL_DTICS_S / 2.0:
        return Headline("AT REST", "the axes stand still", Tone.CALM)
    return Headline("TRACKING", "following the stars", Tone.GOOD)


_ADVICE = (
    ("another program", "SPACE stops the mount all the same"),
    ("safety stopped", "once it is at rest, r lets it move again"),
)


def cautions(scene: ConsoleScene) -> tuple[Caution, ...]:
    """Return what wants attention, the gravest first."""
    view, found = scene.view, []
    if scene.leaving and not scene.ended:
        found.append(Caution("leaving as soon as nothing moves", "q again leaves at once", Tone.CALM))
    if scene.ended:
        return (Caution("the console has ended", "make sure that the mount is at rest", Tone.BAD),)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        found.append(
            Caution("the console says nothing", "press SPACE, then use the mount's own stop", Tone.BAD)
        )
    elif scene.stop_sent_s is not None and scene.stop_sent_s > STOP_UNHEARD_AFTER_S:
        found.append(Caution("the stop was not obeyed", "use the mount's own stop", Tone.BAD))
    if view.refusal is not None and not any(view.refusal == words for words in view.warnings):
        found.append(Caution("not done", view.refusal, Tone.NOTICE))
    for words in view.warnings:
        advice = next((do for begins, do in _ADVICE if words.startswith(begins)), "")
        found.append(Caution(words, advice, Tone.BAD if view.link.state == "lost" else Tone.NOTICE))
    if view.link.state == "silent":
        found.append(
            Caution("the mount has not answered yet", "is it on, and set to send here?", Tone.NOTICE)
        )
    return tuple(found)

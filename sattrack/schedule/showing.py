"""What is shown of a schedule's run: views, made of what the machine knows. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.schedule.night import Mount, State, Wait
from sattrack.views.schedule import PassView, ScheduleView
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.schedule.night import Doing, NightPass, Result, Run

BUSY = (State.READYING, State.FOLLOWING, State.FINISHING, State.PARKING)
WITH_A_PASS = (State.PREPARING, State.ASKING, State.HOLDING, State.READYING, State.FOLLOWING)
NOTES = 8


def view_of(run: Run, doing: Doing | None, utc_s: float, schedule: str, folder: str = "") -> ScheduleView:
    """Return the view of a run at an instant; `doing` is what was ordered last."""
    place = len(run.results)
    following = place if run.state in WITH_A_PASS and run.at is not None else None
    if run.state is State.FINISHING:
        following = place - 1
    upcoming = run.at if run.state not in (State.FOLLOWING, State.ENDED) else None
    return ScheduleView(
        utc_s=utc_s,
        schedule=schedule,
        state=run.state.value,
        doing=doing_words(run, doing),
        mount="moving" if run.state in BUSY else run.mount.value,
        night=run.night,
        from_utc=_iso(run.night_from_utc_s),
        to_utc=_iso(run.night_to_utc_s),
        passes=tuple(
            _pass_view(one, run.results[k] if k < place else None, following == k, run)
            for k, one in enumerate(run.passes)
        ),
        not_planned=sum(run.others.values()),
        current=None if following is None else run.passes[following].number,
        next_number=None if upcoming is None else upcoming.number,
        next_in_s=None if upcoming is None else round(upcoming.start_utc_s - utc_s, 1),
        weather=run.weather,
        notes=run.notes[-NOTES:],
        summary=run.summary,
        folder=folder,
    )


def _pass_view(one: NightPass, result: Result | None, current: bool, run: Run) -> PassView:
    in_progress = current and run.state is State.FOLLOWING
    return PassView(
        number=one.number,
        name=one.name,
        catalog_number=one.elements.catalog_number,
        start_utc=_iso(one.start_utc_s),
        culminate_utc=_iso(one.culminate_utc_s),
        end_utc=_iso(one.end_utc_s),
        max_alt_deg=one.max_alt_deg,
        priority=one.priority,
        state="in progress" if in_progress else "waiting" if result is None else result.state,
        cause=None if result is None else result.cause,
        words=None if result is None else result.words,
        on_target_s=None if result is None else result.on_target_s,
        rms_arcsec=None if result is None else result.rms_arcsec,
        parts=run.part if in_progress else 0 if result is None else result.parts,
        recordings=() if result is None else result.recordings,
        lost_to=one.lost_to,
        held_s={} if result is None else result.held_s,
        rejoining_s=0.0 if result is None else result.rejoining_s,
        lost_peak_arcsec=None if result is None else result.lost_peak_arcsec,
    )


def doing_words(run: Run, doing: Doing | None) -> str:
    """Return what the runner does, in a few words."""
    one = run.at
    name = "" if one is None else f" {one.number}, {one.name}"
    match run.state:
        case State.WAITING if one is not None:
            words = f"waiting for{name}"
        case State.PREPARING | State.ASKING | State.READYING if one is not None:
            words = f"getting ready for{name}"
        case State.HOLDING:
            words = f"holding{name} for the weather: {run.weather}"
        case State.FOLLOWING:
            words = f"following{name}" + (f", part {run.part}" if run.part > 1 else "")
        case State.RESTING if isinstance(doing, Wait):
            words = f"resting until {_iso(doing.until_utc_s)}, mount {_mount_words(run.mount)}"
        case _:
            words = run.state.value
    return words


def _mount_words(mount: Mount) -> str:
    return "not known" if mount is Mount.UNKNOWN else mount.value


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("seconds")

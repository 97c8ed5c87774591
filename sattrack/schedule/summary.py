"""A schedule's run as text: results of passes, the view of its state, the morning's summary. Pure."""

from __future__ import annotations

import math
from collections import Counter
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from sattrack.core import local_time
from sattrack.schedule.night import (
    Event,
    Followed,
    Mount,
    NightPass,
    PassAttempt,
    Result,
    RunState,
    Started,
    Wait,
)
from sattrack.views.schedule import SchedulePassView, ScheduleView
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.schedule.night import NightPass, Order, Run


DONE_SHARE = 0.9
"""Share of a pass that must have been on target for "done"."""
SHORTEST_SHOWN_S = 0.5


def attempt_of(event: Event) -> PassAttempt:
    """Return the attempt that has just ended: as reported, or the last that was known of it."""
    if isinstance(event, Followed):
        return event.attempt
    assert isinstance(event, Started)
    last = event.utc_s if event.last_utc_s is None else event.last_utc_s
    return PassAttempt(
        "restart", last, event.on_target_s, words="the runner ended", recording=event.recording
    )


def result_of(one: NightPass, attempts: tuple[PassAttempt, ...]) -> Result:
    """Return the result of a pass, of all attempts at it."""
    on_target_s = sum(attempt.on_target_s for attempt in attempts)
    whole_s = one.end_utc_s - one.start_utc_s
    last = attempts[-1]
    rms = [
        (attempt.rms_arcsec, attempt.on_target_s)
        for attempt in attempts
        if attempt.rms_arcsec is not None and attempt.on_target_s
    ]
    weight = sum(seconds for _, seconds in rms)
    together = math.sqrt(sum(r * r * s for r, s in rms) / weight) if weight else None
    peaks = [attempt.peak_arcsec for attempt in attempts if attempt.peak_arcsec is not None]
    state = "done" if on_target_s >= DONE_SHARE * whole_s else "partly" if on_target_s > 0.0 else "lost"
    cause = words = None
    if state != "done" or last.ended_by not in ("set", "restart"):
        broken = [attempt for attempt in attempts if attempt.ended_by != "set"] or [last]
        cause, words = broken[-1].ended_by, broken[-1].words
        if cause == "set":
            cause, words = "late", words or "the mount was not on the satellite for all of it"
    return Result(
        state=state,
        cause=cause,
        words=words,
        on_target_s=round(on_target_s, 3),
        lost_s=round(max(0.0, whole_s - on_target_s), 3),
        rms_arcsec=None if together is None else round(together, 4),
        peak_arcsec=max(peaks) if peaks else None,
        parts=len(attempts),
        recordings=tuple(attempt.recording for attempt in attempts if attempt.recording is not None),
        held_s=_summed(attempts),
        rejoining_s=round(sum(attempt.rejoining_s for attempt in attempts), 3),
        lost_peak_arcsec=max(
            (attempt.lost_peak_arcsec for attempt in attempts if attempt.lost_peak_arcsec), default=None
        ),
    )


def _summed(attempts: tuple[PassAttempt, ...]) -> dict[str, float]:
    names = dict.fromkeys(name for attempt in attempts for name in attempt.held_s)
    return {name: round(sum(attempt.held_s.get(name, 0.0) for attempt in attempts), 3) for name in names}


def limits_text(result: Result | SchedulePassView) -> str:
    """Return the time that limits took of a pass, as text; empty for nothing worth reporting."""
    parts = [
        f"{seconds:.0f} s to the {name} limit"
        for name, seconds in result.held_s.items()
        if seconds >= SHORTEST_SHOWN_S
    ]
    if not parts:
        return ""
    if result.rejoining_s >= SHORTEST_SHOWN_S:
        parts.append(f"{result.rejoining_s:.0f} s on the way back")
    if result.lost_peak_arcsec is not None:
        parts.append(f"{result.lost_peak_arcsec / 3600.0:.2g}° off at most")
    return ", ".join(parts)


BUSY = (RunState.READYING, RunState.FOLLOWING, RunState.FINISHING, RunState.PARKING)
WITH_A_PASS = (RunState.PREPARING, RunState.ASKING, RunState.HOLDING, RunState.READYING, RunState.FOLLOWING)
NOTES = 8
RESULT_SHOWN = (
    *("state", "cause", "words", "on_target_s", "rms_arcsec", "parts", "recordings"),
    *("held_s", "rejoining_s", "lost_peak_arcsec"),
)


def view_of(run: Run, doing: Order | None, utc_s: float, schedule: str, folder: str = "") -> ScheduleView:
    """Return the view of a run at an instant; `doing` is what was ordered last."""
    place = len(run.results)
    following = place if run.state in WITH_A_PASS and run.at is not None else None
    if run.state is RunState.FINISHING:
        following = place - 1
    upcoming = run.at if run.state not in (RunState.FOLLOWING, RunState.ENDED) else None
    return ScheduleView(
        utc_s=utc_s,
        schedule=schedule,
        state=run.state.value,
        doing=action_text(run, doing),
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


def _pass_view(one: NightPass, result: Result | None, current: bool, run: Run) -> SchedulePassView:
    shown: dict[str, Any] = {"state": "waiting"}
    if current and run.state is RunState.FOLLOWING:
        shown = {"state": "in progress", "parts": run.part}
    elif result is not None:
        shown = {name: getattr(result, name) for name in RESULT_SHOWN}
    return SchedulePassView(
        number=one.number,
        name=one.name,
        catalog_number=one.catalog_number,
        start_utc=_iso(one.start_utc_s),
        culminate_utc=_iso(one.culminate_utc_s),
        end_utc=_iso(one.end_utc_s),
        max_alt_deg=one.max_alt_deg,
        priority=one.priority,
        lost_to=one.lost_to,
        **shown,
    )


def action_text(run: Run, doing: Order | None) -> str:
    """Return what the runner does, as a short text."""
    one = run.at
    name = "" if one is None else f" {one.number}, {one.name}"
    match run.state:
        case RunState.WAITING if one is not None:
            words = f"waiting for{name}"
        case RunState.PREPARING | RunState.ASKING | RunState.READYING if one is not None:
            words = f"getting ready for{name}"
        case RunState.HOLDING:
            words = f"holding{name} for the weather: {run.weather}"
        case RunState.FOLLOWING:
            words = f"following{name}" + (f", part {run.part}" if run.part > 1 else "")
        case RunState.RESTING if isinstance(doing, Wait):
            words = f"resting until {_iso(doing.until_utc_s)}, mount {_mount_short(run.mount)}"
        case _:
            words = run.state.value
    return words


def _mount_short(mount: Mount) -> str:
    return "not known" if mount is Mount.UNKNOWN else mount.value


COLOURS = {"done": "#2e7d32", "partly": "#b26a00", "lost": "#b3261e"}


class NightFigures(NamedTuple):
    """What a night came to, in numbers; seconds."""

    planned: int
    done: int
    partly: int
    lost: int
    on_target_s: float
    planned_s: float
    causes: dict[str, int]
    others: dict[str, int]


def figures(run: Run) -> NightFigures:
    """Return the figures of a night; a pass without a result counts as lost, "not reached"."""
    pairs = list(zip(run.passes, run.results, strict=False))
    states = Counter(result.state for _, result in pairs)
    causes = Counter(str(result.cause) for _, result in pairs if result.state != "done")
    missing = len(run.passes) - len(pairs)
    if missing:
        causes["not reached"] = missing
    return NightFigures(
        planned=len(run.passes),
        done=states["done"],
        partly=states["partly"],
        lost=states["lost"] + missing,
        on_target_s=round(sum(result.on_target_s for _, result in pairs), 1),
        planned_s=round(sum(one.end_utc_s - one.start_utc_s for one in run.passes), 1),
        causes=dict(sorted(causes.items())),
        others=dict(sorted(run.others.items())),
    )


def summary_name(run: Run) -> str:
    """Return the name of a night's files, without an ending."""
    return f"night-{run.night:03d}-{_iso(run.night_from_utc_s)[:10]}"


def headline(run: Run) -> str:
    """Return a night in one sentence."""
    found = figures(run)
    words = f"{found.done} of {found.planned} passes done"
    if found.partly:
        words += f", {found.partly} in part"
    if found.lost:
        words += f", {found.lost} lost"
    return f"night {run.night}: {words}; {found.on_target_s:.0f} s on target; {_mount_text(run)}"


def text_lines(run: Run, schedule: str) -> list[str]:
    """Return the summary as lines of text."""
    lines = [
        headline(run),
        f"{printable(schedule)}: {local_time.span(run.night_from_utc_s, run.night_to_utc_s)}",
        "",
    ]
    if run.passes:
        lines.append("  #  Start      State   On target s   RMS ″  Satellite")
    for one, result in _rows(run):
        lines.append(_line(one, result))
        if result is not None and result.recordings:
            lines.append(f"     {', '.join(printable(name) for name in result.recordings)}")
    found = figures(run)
    if found.causes:
        lines += ["", "Not done, by cause: " + _counted(found.causes)]
    if found.others:
        lines += ["", "Seen and not planned: " + _counted(found.others)]
    if run.notes:
        lines += ["", "Notes"]
        lines += [f"  {printable(note)}" for note in run.notes]
    return lines


def page(run: Run, schedule: str, recordings: str = "") -> str:
    """Return the summary as a page of HTML; `recordings` is what leads from it to their folder."""
    found = figures(run)
    rows = "\n".join(_row(one, result, recordings) for one, result in _rows(run))
    lists = ""
    for title, counted in (("Not done, by cause", found.causes), ("Seen and not planned", found.others)):
        if counted:
            lists += f"<p>{title}: {escape(_counted(counted))}</p>\n"
    notes = "".join(f"<li>{escape(note)}</li>" for note in run.notes)
    if notes:
        notes = f"<h2>Notes</h2>\n<ul>{notes}</ul>\n"
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(headline(run))}</title>
<meta name="viewport" content="width=device-width">
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 60rem; padding: 0 1rem; }}
h1 {{ font-size: 1.4rem; }}
h2 {{ font-size: 1.1rem; }}
td:nth-child(2) {{ white-space: nowrap; }}
table {{ border-collapse: collapse; width: 100%; }}
th, td {{ text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #8884; vertical-align: top; }}
td.n, th.n {{ text-align: right; font-variant-numeric: tabular-nums; }}
@media (prefers-color-scheme: dark) {{ body {{ background: #15171a; color: #ddd; }} a {{ color: #8ab4f8; }} }}
</style></head><body>
<h1>{escape(headline(run))}</h1>
<p>{escape(schedule)}: {local_time.span(run.night_from_utc_s, run.night_to_utc_s)}</p>
<table>
<tr><th class="n">#</th><th>Start</th><th>Satellite</th><th>State</th><th class="n">On target s</th>
<th class="n">RMS ″</th><th class="n">Peak ″</th><th>Recordings</th></tr>
{rows}
</table>
{lists}{notes}</body></html>
"""


def _rows(run: Run) -> list[tuple[NightPass, Result | None]]:
    return [(one, run.results[k] if k < len(run.results) else None) for k, one in enumerate(run.passes)]


def _line(one: NightPass, result: Result | None) -> str:
    start = local_time.clock(one.start_utc_s)
    if result is None:
        return f"{one.number:3d}  {start}   not reached                   {printable(one.name)}"
    whole_s = one.end_utc_s - one.start_utc_s
    rms = "-" if result.rms_arcsec is None else f"{result.rms_arcsec:.2f}"
    on_target = f"{result.on_target_s:.0f} of {whole_s:.0f}"
    why = f": {result.cause}" if result.cause else ""
    why += f": {printable(result.words)}" if result.words else ""
    held = limits_text(result)
    why += f"; {held}" if held else ""
    return (
        f"{one.number:3d}  {start}   {result.state:<6}  {on_target:>11}  {rms:>6}  {printable(one.name)}{why}"
    )


def _row(one: NightPass, result: Result | None, recordings: str) -> str:
    state = "not reached" if result is None else result.state
    colour = COLOURS.get(state, "#777")
    why = "" if result is None or result.cause is None else escape(f": {result.cause}: {result.words or ''}")
    why += f"; {escape(limits_text(result))}" if result is not None and limits_text(result) else ""
    cells = ["-", "-", "-"]
    links = ""
    if result is not None:
        whole_s = one.end_utc_s - one.start_utc_s
        arcsec = ("-" if x is None else f"{x:.2f}" for x in (result.rms_arcsec, result.peak_arcsec))
        cells = [f"{result.on_target_s:.0f} of {whole_s:.0f}", *arcsec]
        links = "<br>".join(
            f'<a href="{escape(recordings + name)}">{escape(name)}</a>' for name in result.recordings
        )
    start = f"{local_time.day(one.start_utc_s)} {local_time.clock(one.start_utc_s)}"
    numbers = "".join(f'<td class="n">{cell}</td>' for cell in cells)
    return (
        f'<tr><td class="n">{one.number}</td><td>{start}</td>'
        f'<td>{escape(one.name)}</td><td><span style="color:{colour}">{state}</span>{why}</td>'
        f"{numbers}<td>{links}</td></tr>"
    )


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.items())


def _mount_text(run: Run) -> str:
    if run.mount is Mount.PARKED:
        return "the mount is parked"
    if run.mount is Mount.AT_PARK:
        return "the mount rests at its park position, drives on"
    return "THE MOUNT IS NOT PARKED" if run.settings.park else "the mount is left where it is"


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("seconds")

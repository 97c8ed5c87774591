"""What follows from what the runner of a schedule knows, for its conditions and actions alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from msgspec.structs import replace

from sattrack.schedule.night import NightPass, Recovered, Run, State, Ways

if TYPE_CHECKING:
    from sattrack.schedule.actions import Action

DAY_S = 86400.0
SHORT_S = 4.0 * 3600.0
"""Less than that at the end of a run is no night of its own."""
LATE_S = 5.0
"""A pass that is shorter by no more than this was followed to its end."""


def at_of(run: Run) -> NightPass:
    """Return the pass that is next, or in progress; there must be one."""
    found = run.at
    assert found is not None
    return found


def stepped(run: Run) -> NightPass:
    """Return the pass whose actions are carried out: after it, it is the last that has a result."""
    return run.passes[len(run.results) - 1] if run.state is State.FINISHING else at_of(run)


def actions_of(run: Run) -> tuple[Action, ...]:
    """Return the actions that are being carried out, those before a pass or those after it."""
    terms = stepped(run).terms
    return terms.after if run.state is State.FINISHING else terms.before


def prepared_from_s(run: Run) -> float:
    """Return from when on the next pass is prepared, POSIX seconds."""
    return at_of(run).leave_utc_s - run.ways.prepare_s


def enough_left(run: Run, utc_s: float, another: bool = False) -> bool:
    """Tell whether so much of the next pass is to come that it is worth following."""
    one = at_of(run)
    left_s = one.end_utc_s - max(utc_s, one.start_utc_s)
    # What was begun is followed on however short the rest is, if it can be reached at all.
    least_s = 2.0 * LATE_S if another else min(one.terms.least_s, one.end_utc_s - one.start_utc_s)
    return left_s >= least_s - 1.0


def first_night(run: Run, now_utc_s: float) -> Run:
    """Return a run with its first night found: the one in progress, where it could have begun before."""
    return _night_from(run, max(run.ways.from_utc_s, now_utc_s), 1)


def recovered_night(run: Run, known: Recovered, now_utc_s: float) -> Run:
    """Return a run that goes on by what the last status says: its night, or the next where that is over."""
    run = replace(run, mount=known.mount, summary=known.summary)
    if now_utc_s >= known.night_to_utc_s:
        return _night_from(run, max(run.ways.from_utc_s, now_utc_s), known.night + 1)
    run = _night_from(run, known.night_from_utc_s, known.night)
    return replace(run, over=known.over)


def with_ways(run: Run, ways: Ways) -> Run:
    """Return the run by what the schedule says now; a night that has begun keeps its beginning."""
    return _night_from(replace(run, ways=ways), run.night_from_utc_s, run.night)


def next_night(run: Run, now_utc_s: float) -> Run:
    """Return the run with the next night: the one in progress where some were slept through."""
    begin, number = run.night_to_utc_s, run.night + 1
    while _end_of(run, begin) <= now_utc_s and not _is_last(run, begin):
        begin = _end_of(run, begin)
    return _night_from(replace(run, passes=(), results=(), others={}, over=()), begin, number)


def _night_from(run: Run, begin: float, number: int) -> Run:
    return replace(run, night=number, night_from_utc_s=begin, night_to_utc_s=_end_of(run, begin))


def _end_of(run: Run, begin: float) -> float:
    """Return the end of the night that begins then: the next noon at the site, or the run's end."""
    noon = run.ways.noon_s
    end = (math.floor((begin - noon) / DAY_S + 1e-9) + 1.0) * DAY_S + noon
    last = run.ways.to_utc_s
    # A few hours at the end are no night of their own.
    return last if last is not None and end + SHORT_S >= last else end


def _is_last(run: Run, begin: float) -> bool:
    return run.ways.to_utc_s is not None and _end_of(run, begin) >= run.ways.to_utc_s

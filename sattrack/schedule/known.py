"""What follows from what the runner of a schedule knows, for its conditions and actions alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.schedule.night import (
    NightPass,
    Run,
    State,
)

if TYPE_CHECKING:
    from sattrack.schedule.actions import Action

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

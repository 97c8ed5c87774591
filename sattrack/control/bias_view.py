"""What a tracker's offsets and estimate look like to anyone who looks. No logic."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypedDict

from sattrack.control.biases import shown
from sattrack.views.run import EstimateView, OffsetView, SearchView

if TYPE_CHECKING:
    from sattrack.control.tracker import Tracker


class BiasFields(TypedDict):
    """The fields of a view that say what is in force along and across the track, and what was asked for."""

    bias_along_s: float
    bias_cross_deg: float
    bias_along_goal_s: float
    bias_cross_goal_deg: float


def bias_fields(tracker: Tracker, utc_s: float) -> BiasFields:
    """Return what is in force, the search included, and what is asked for, as of an instant."""
    along, cross = tracker.steering.biases.applied(utc_s)
    along_goal_s, cross_goal_deg = tracker.steering.biases.totals(utc_s)
    return BiasFields(
        bias_along_s=along.value,
        bias_cross_deg=cross.value,
        bias_along_goal_s=along_goal_s,
        bias_cross_goal_deg=cross_goal_deg,
    )


def offset_views(tracker: Tracker, utc_s: float) -> tuple[OffsetView, ...]:
    """Return the operator's offsets that are not nothing."""
    return tuple(OffsetView(*one) for one in shown(tracker.steering.biases, utc_s))


def search_view(tracker: Tracker, utc_s: float) -> SearchView | None:
    """Return the search that runs, or is about to."""
    biases = tracker.steering.biases
    pattern = biases.pattern_at(utc_s) or next(
        (one for one in biases.patterns if one.begins_utc_s > utc_s and one.ends_utc_s == math.inf), None
    )
    if pattern is None:
        return None
    base = biases.along_without_search(utc_s)
    along, cross = pattern.states(utc_s, base, biases.course)
    return SearchView(pattern.how, max(0.0, utc_s - pattern.begins_utc_s), along.value, cross.value)


def estimate_view(tracker: Tracker, utc_s: float, unused: int) -> EstimateView | None:
    """Return what observations say, and what became of them; None where none have come.

    `unused` counts what came and was not even tried.
    """
    estimator = tracker.steering.estimator
    refused = estimator.refused + unused
    if not (estimator.accepted or estimator.rejected or refused):
        return None
    known = estimator.filter
    if known is None:
        none = (None, None, None, None)
        return EstimateView(*none, estimator.accepted, estimator.rejected, refused, estimator.last_utc_s)
    range_km = tracker.steering.biases.course.going(utc_s + known.along_s).range_km
    return EstimateView(
        known.along_s,
        known.along_sigma_s,
        math.degrees(math.atan(known.cross_km / range_km)),
        math.degrees(known.cross_sigma_km / range_km),
        estimator.accepted,
        estimator.rejected,
        refused,
        estimator.last_utc_s,
    )


def observation_warnings(tracker: Tracker, malformed: int, dropped: int) -> list[str]:
    """Say which observations were not taken, and why the last of them."""
    estimator = tracker.steering.estimator
    words = []
    if estimator.words is not None:
        counts = f"{estimator.rejected} rejected, {estimator.refused} refused, {estimator.accepted} taken"
        words.append(f"the last observation was not taken: {estimator.words} ({counts})")
    if estimator.begun_anew:
        words.append(
            f"the estimate began anew {estimator.begun_anew} times: observations contradict each other"
        )
    if malformed:
        words.append(f"{malformed} lines were neither messages nor observations")
    if dropped:
        words.append(f"{dropped} observations came faster than they can be used, and were dropped")
    return words

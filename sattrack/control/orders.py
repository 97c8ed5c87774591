"""The operator's words about offsets and searches: checked against sizes and the mount, then obeyed.

Each function returns why it did nothing, in words, or None where it was obeyed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.control.biases import ALONG, CROSS, GENTLE_SHARE, Biases
from sattrack.control.offset import Bounds, State, added
from sattrack.control.pattern import START_S, Pattern, spiral_acceleration_deg_s2, spiral_lasts_s

if TYPE_CHECKING:
    from sattrack.control.estimate import Reading
    from sattrack.views.messages import OffsetBy, Search

MOST_ALONG_S = 60.0
MOST_CROSS_DEG = 5.0
"""Biases beyond these are slips of the finger: no elements that are worth following are so far off."""
MOST_ALONG_RATE = 1.0
MOST_RATE_DEG_S = 0.5
MOST_SECONDS = 3600.0
SPACING_DEG = (0.001, 2.0)
SPEED_DEG_S = (0.0001, 2.0)
PERIOD_S = (2.0, 600.0)
LEAST_REACH_S = 0.01


def nudge(biases: Biases, along_s: float, cross_deg: float, begins_utc_s: float) -> str | None:
    """Add to the biases along and across the track."""
    along = biases.offsets[ALONG].total_at(begins_utc_s) + along_s
    cross = biases.offsets[CROSS].total_at(begins_utc_s) + cross_deg
    if not (abs(along) <= MOST_ALONG_S and abs(cross) <= MOST_CROSS_DEG):
        return f"nudge refused: biases go to {MOST_ALONG_S:g} s along and {MOST_CROSS_DEG:g}° across"
    if along_s:
        _change(biases, ALONG, "add", along_s, 0.0, begins_utc_s)
    if cross_deg:
        _change(biases, CROSS, "add", cross_deg, 0.0, begins_utc_s)
    return None


def offset(biases: Biases, order: OffsetBy, begins_utc_s: float) -> str | None:
    """Change one offset."""
    what, value, seconds = order.what, order.value or 0.0, order.seconds or 0.0
    most, most_rate, unit = MOST_CROSS_DEG, MOST_RATE_DEG_S, "°"
    if what == ALONG:
        most, most_rate, unit = MOST_ALONG_S, MOST_ALONG_RATE, " s"
    before = biases.offsets[what].total_at(begins_utc_s)
    total = before + value if order.how == "add" else value
    if order.how == "rate":
        if not abs(value) <= most_rate:
            return f"{what} refused: a rate of {value:g}{unit}/s; it goes to {most_rate:g}{unit}/s"
    elif not (abs(total) <= most or abs(total) < abs(before)):
        return f"{what} refused: {total:g}{unit}; it goes to {most:g}{unit} either way"
    if not 0.0 <= seconds <= MOST_SECONDS:
        return f"{what} refused: {seconds:g} seconds; give 0 to {MOST_SECONDS:g}"
    _change(biases, what, order.how, value, seconds, begins_utc_s)
    return None


def _change(biases: Biases, what: str, how: str, value: float, seconds: float, begins_utc_s: float) -> None:
    """Change an offset within what the mount can do."""
    one = biases.offsets[what]
    here_s = to_s = biases.along_without_search(begins_utc_s).value
    if what == ALONG and how != "rate":
        to_s += (value if how == "add" else value - one.total_at(begins_utc_s)) if how != "stop" else 0.0
    bounds = biases.bounds(what, begins_utc_s, here_s, to_s)
    match how:
        case "add":
            one.add(value, begins_utc_s, bounds)
        case "set":
            one.set(value, begins_utc_s, bounds)
        case "rate":
            one.run(value, begins_utc_s, bounds)
        case "gradual":
            one.gradual(value, seconds, begins_utc_s, bounds)
        case "stop":
            one.stop(begins_utc_s, bounds)
        case _:
            one.reset(begins_utc_s, bounds)
    biases.touched(what)


def clear(biases: Biases, begins_utc_s: float) -> None:
    """Take everything away: the operator's offsets, the search's and the estimate's."""
    along, cross = biases.end_pattern(begins_utc_s)
    here_s = biases.along_without_search(begins_utc_s).value
    cross = added(cross, _estimate_given_up(biases, begins_utc_s))
    along = added(along, biases.estimated_along.give_up(begins_utc_s))
    for what, one in biases.offsets.items():
        bounds = biases.bounds(what, begins_utc_s, here_s, 0.0)
        if what in {ALONG, CROSS}:
            one.take_over(along if what == ALONG else cross, 0.0, begins_utc_s, bounds)
        elif not one.idle:
            one.reset(begins_utc_s, bounds)
    biases.touched()


def _estimate_given_up(biases: Biases, begins_utc_s: float) -> State:
    if biases.estimated_cross_km.idle:
        return State(0.0, 0.0, 0.0)
    _, all_cross = biases.applied(begins_utc_s)
    own = biases.offsets[CROSS].state(begins_utc_s)
    biases.estimated_cross_km.give_up(begins_utc_s)
    return State(*(a - b for a, b in zip(all_cross, own, strict=True)))


def search(biases: Biases, order: Search, begins_utc_s: float) -> str | None:
    """Begin a pattern, or end the one that runs: keeping where it is, or going back."""
    if order.how in {"stop", "cancel"}:
        return end_search(biases, order.how == "stop", begins_utc_s)
    along_s = biases.along_without_search(begins_utc_s).value
    limits = biases.bounds(CROSS if order.how == "spiral" else ALONG, begins_utc_s, along_s, along_s)
    if order.how == "spiral":
        first, second = order.spacing_deg or 0.0, order.speed_deg_s or 0.0
        why = _spiral_trouble(first, second, limits.rate, limits.acceleration)
    else:
        first, second = order.reach_s or 0.0, order.period_s or 0.0
        why = _sweep_trouble(first, second, limits.rate, limits.acceleration)
    if why is not None:
        return f"{order.how} refused: {why}"
    end_search(biases, False, begins_utc_s)
    biases.begin_pattern(Pattern(order.how, first, second, begins_utc_s, math.inf))
    return None


def end_search(biases: Biases, keep: bool, utc_s: float) -> str | None:
    """End the pattern that runs."""
    if biases.pattern_at(utc_s) is None:
        return "no search is running"
    along, cross = biases.end_pattern(utc_s)
    here_s = biases.along_without_search(utc_s).value
    for what, moving in ((ALONG, along), (CROSS, cross)):
        one = biases.offsets[what]
        bounds = biases.bounds(what, utc_s, here_s, here_s + along.value)
        if keep:
            one.keep(moving, utc_s, bounds)
        else:
            one.take_over(moving, one.total_at(utc_s), utc_s, bounds)
    return None


def watch(biases: Biases, utc_s: float) -> str | None:
    """End what has gone as far as it may: spirals and rates; return what was ended, in words."""
    pattern = biases.pattern_at(utc_s)
    if pattern is not None and pattern.how == "spiral":
        pace = biases.course.going(utc_s + biases.along_without_search(utc_s).value).pace_deg_s
        reach_deg = min(MOST_CROSS_DEG, MOST_ALONG_S * pace)
        if utc_s - pattern.begins_utc_s >= spiral_lasts_s(reach_deg, pattern.first, pattern.second):
            end_search(biases, False, utc_s)
            return f"the spiral found nothing within {reach_deg:.1f}° and went back"
    for what, one in biases.offsets.items():
        most = MOST_ALONG_S if what == ALONG else MOST_CROSS_DEG
        total = one.total_at(utc_s)
        if one.rate and abs(total) > most and total * one.rate > 0.0:
            _change(biases, what, "stop", 0.0, 0.0, utc_s)
            return f"{what} went as far as it may, {most:g}, and was stopped"
    return None


def follow_estimate(biases: Biases, read: Reading, first: bool, begins_utc_s: float) -> None:
    """Go to what observations say as of an instant, and on with its drift.

    The first takes the place of the operator's biases and of the search.
    """
    here_s = biases.along_without_search(begins_utc_s).value
    along, cross = biases.end_pattern(begins_utc_s)
    if first:
        along = added(along, biases.offsets[ALONG].give_up(begins_utc_s))
        cross = added(cross, biases.offsets[CROSS].give_up(begins_utc_s))
    to_s = read.along_s + biases.offsets[ALONG].total_at(begins_utc_s)
    bounds = biases.bounds(ALONG, begins_utc_s, here_s, to_s, GENTLE_SHARE)
    biases.estimated_along.take_over(along, read.along_s, begins_utc_s, bounds, read.along_rate)
    bounds = _bounds_km(biases, begins_utc_s, here_s, to_s)
    moving = biases.cross_km(begins_utc_s, cross)
    biases.estimated_cross_km.take_over(moving, read.cross_km, begins_utc_s, bounds, read.cross_rate_km_s)
    biases.touched()


def forget_estimate(biases: Biases, begins_utc_s: float) -> None:
    """Go to where the satellite is without an estimate; the operator's offsets stay."""
    here_s = biases.along_without_search(begins_utc_s).value
    to_s = biases.offsets[ALONG].total_at(begins_utc_s)
    biases.estimated_along.reset(begins_utc_s, biases.bounds(ALONG, begins_utc_s, here_s, to_s, GENTLE_SHARE))
    biases.estimated_cross_km.reset(begins_utc_s, _bounds_km(biases, begins_utc_s, here_s, to_s))
    biases.touched()


def _bounds_km(biases: Biases, begins_utc_s: float, from_s: float, to_s: float) -> Bounds:
    """Return what a change across the track may ask, as a distance."""
    range_km = biases.course.going(begins_utc_s + to_s).range_km
    on_sky = biases.bounds(CROSS, begins_utc_s, from_s, to_s, GENTLE_SHARE)
    return Bounds(math.radians(on_sky.rate) * range_km, math.radians(on_sky.acceleration) * range_km)


def _spiral_trouble(spacing_deg: float, speed_deg_s: float, rate: float, acceleration: float) -> str | None:
    if not SPACING_DEG[0] <= spacing_deg <= SPACING_DEG[1]:
        return f"spacing_deg {spacing_deg:g}; give {SPACING_DEG[0]:g} to {SPACING_DEG[1]:g}"
    if not SPEED_DEG_S[0] <= speed_deg_s <= SPEED_DEG_S[1]:
        return f"speed_deg_s {speed_deg_s:g}; give {SPEED_DEG_S[0]:g} to {SPEED_DEG_S[1]:g}"
    if speed_deg_s > rate or spiral_acceleration_deg_s2(spacing_deg, speed_deg_s) > acceleration:
        return f"the mount cannot do {speed_deg_s:g}°/s with arms {spacing_deg:g}° apart: slower, or wider"
    return None


def _sweep_trouble(reach_s: float, period_s: float, rate: float, acceleration: float) -> str | None:
    if not LEAST_REACH_S <= reach_s <= MOST_ALONG_S:
        return f"reach_s {reach_s:g}; give {LEAST_REACH_S:g} to {MOST_ALONG_S:g}"
    if not PERIOD_S[0] <= period_s <= PERIOD_S[1]:
        return f"period_s {period_s:g}; give {PERIOD_S[0]:g} to {PERIOD_S[1]:g}"
    turning = 2.0 * math.pi / period_s
    if reach_s * turning > rate or reach_s * turning * max(turning, 1.5 / START_S) > acceleration:
        return f"the mount cannot sweep {reach_s:g} s in {period_s:g} s: less far, or slower"
    return None

"""When a satellite is above an altitude: rise, culmination and set, geometric and airless."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tle.errors import SiteError, TimeRangeError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tle.propagator import Propagator

_HOUR_S = 3600.0
_STEPS_PER_TURN = 60
_SHORTEST_STEP_S, _LONGEST_STEP_S = 10.0, 300.0
_CLOSE_S = 1e-4
_MOST_HOURS = 24.0 * 366.0


@dataclass(frozen=True, slots=True)
class Pass:
    """One time above the altitude asked for; degrees, azimuth from north through east.

    `rise_utc` and `set_utc`, and their azimuths, are None where the satellite was up already, or stays up,
    past the ends of the span; `culminate_utc` is the highest instant within it.
    """

    rise_utc: Utc | None
    culminate_utc: Utc
    set_utc: Utc | None
    rise_az_deg: float | None
    culminate_az_deg: float
    set_az_deg: float | None
    max_alt_deg: float


def find_passes(propagator: Propagator, start: Utc, hours: float, min_alt_deg: float = 10.0) -> list[Pass]:
    """Return the times above an altitude, in order, within so many hours from start; [] where there are none.

    The propagator's satellite, site, bias and Earth orientation count; its place and refraction do not. Where
    SGP4 fails within the span, the span ends there. No pass is missed for being short: the highest point of
    every rise and fall of the altitude is looked at.
    Raises TimeRangeError, SiteError for an altitude that is none, PropagationError where SGP4 fails at once.
    """
    if not 0.0 < hours <= _MOST_HOURS:
        raise TimeRangeError(
            f"{hours} hours is no span to search: give from above 0 to {_MOST_HOURS:.0f} hours"
        )
    if not -90.0 <= min_alt_deg <= 90.0:
        raise SiteError(f"a least altitude of {min_alt_deg}° is outside -90° to 90°")
    seen = propagator.with_place("geometric")
    seen.at(start)
    turns = _turning_points(seen, _grid(seen, start.unix_s, hours * _HOUR_S))
    altitudes = seen.at(Utc(turns)).alt_deg
    above = altitudes > min_alt_deg
    changes = np.flatnonzero(above[1:] != above[:-1])
    crossings = _roots(
        lambda t: seen.at(Utc(t)).alt_deg - min_alt_deg,
        turns[changes],
        turns[changes + 1],
    )
    passes = []
    rise: float | None = None
    first = 0 if above[0] else -1
    for change, crossing in zip(changes, crossings, strict=True):
        if first < 0:
            rise, first = float(crossing), int(change) + 1
        else:
            highest = first + int(np.argmax(altitudes[first : change + 1]))
            passes.append(_pass(seen, rise, float(turns[highest]), float(crossing)))
            rise, first = None, -1
    if first >= 0:
        highest = first + int(np.argmax(altitudes[first:]))
        passes.append(_pass(seen, rise, float(turns[highest]), None))
    return passes


def _grid(seen: Propagator, start_s: float, span_s: float) -> NDArray[np.float64]:
    """Return instants so close that the altitude turns at most once between them, as far as SGP4 goes."""
    e = seen.elements.eccentricity
    turn_s = seen.elements.period_s * (1.0 - e) ** 1.5 / math.sqrt(1.0 + e)
    step_s = min(max(turn_s / _STEPS_PER_TURN, _SHORTEST_STEP_S), _LONGEST_STEP_S)
    grid = start_s + np.linspace(0.0, span_s, max(2, math.ceil(span_s / step_s)) + 1)
    failed = np.flatnonzero(seen.at(Utc(grid)).error)
    return grid[: failed[0]] if len(failed) else grid


def _turning_points(seen: Propagator, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return both ends of the grid and, between them, every instant at which the altitude turns."""
    rising = seen.at(Utc(grid)).alt_rate_deg_s > 0.0
    at = np.flatnonzero(rising[1:] != rising[:-1])
    turns = _roots(lambda t: seen.at(Utc(t)).alt_rate_deg_s, grid[at], grid[at + 1])
    return np.concatenate([grid[:1], turns, grid[-1:]])


def _roots(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return a root of the function in each bracket, by Ridders' method on all of them at once."""
    if len(low) == 0:
        return low
    low, high = low.copy(), high.copy()
    at_low, at_high = function(low), function(high)
    found = low
    for _ in range(60):
        middle = 0.5 * (low + high)
        at_middle = function(middle)
        spread = np.sqrt(np.maximum(at_middle * at_middle - at_low * at_high, 1e-300))
        new = np.clip(middle + (middle - low) * np.sign(at_low - at_high) * at_middle / spread, low, high)
        moved = np.abs(new - found).max()
        found = new
        if moved < _CLOSE_S:
            break
        at_new = function(new)
        # The bracket shrinks to the closest pair of signs among its ends, the middle and the new point.
        for point, value in ((middle, at_middle), (new, at_new)):
            inside = (point >= low) & (point <= high)
            same = inside & (np.sign(value) == np.sign(at_low))
            other = inside & ~same
            low, at_low = np.where(same, point, low), np.where(same, value, at_low)
            high, at_high = np.where(other, point, high), np.where(other, value, at_high)
    return found


def _pass(seen: Propagator, rise: float | None, culminate: float, set_: float | None) -> Pass:
    def azimuth(instant: float | None) -> float | None:
        return None if instant is None else float(seen.at(Utc(instant)).az_deg)

    highest = seen.at(Utc(culminate))
    return Pass(
        rise_utc=None if rise is None else Utc(rise),
        culminate_utc=Utc(culminate),
        set_utc=None if set_ is None else Utc(set_),
        rise_az_deg=azimuth(rise),
        culminate_az_deg=float(highest.az_deg),
        set_az_deg=azimuth(set_),
        max_alt_deg=float(highest.alt_deg),
    )

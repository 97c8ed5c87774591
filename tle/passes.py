"""When a satellite is above an altitude or a skyline: rise, culmination and set, geometric and airless."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.arcs import Windows, anomaly_pieces, fit_arcs, terms_for
from tle.bias import NO_BIAS
from tle.crossings import Crossings, find_crossings
from tle.earth import Ground
from tle.elements import Elements
from tle.ephemeris_passes import ephemeris_arcs, spans_within
from tle.errors import TimeRangeError
from tle.gate import near_crossings
from tle.horizon import Horizon
from tle.instants import Utc
from tle.near_earth import DEEP_SPACE_MIN, start_near_earth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.ephemeris import Ephemeris
    from tle.horizon import HorizonMask
    from tle.propagator import Propagator

HOUR_S = 3600.0
MOST_HOURS = 24.0 * 366.0
_FAILURE_STEP_S = 60.0
_FAILURE_CLOSE_S = 0.01


class Pass(NamedTuple):
    """One time above the altitude asked for; degrees, azimuth from north through east.

    `rise_utc` and `set_utc`, and their azimuths, are None where the satellite was up already, or stays up,
    past the ends of the span; `culminate_utc` is the highest instant within it. `culminations_utc` are all
    instants at which the altitude turns from rising to falling: several in one pass of an eccentric orbit,
    none where a pass cut off only rises or falls.
    """

    rise_utc: Utc | None
    culminate_utc: Utc
    set_utc: Utc | None
    rise_az_deg: float | None
    culminate_az_deg: float
    set_az_deg: float | None
    max_alt_deg: float
    culminations_utc: tuple[Utc, ...] = ()


def find_passes(
    propagator: Propagator,
    start: Utc,
    hours: float,
    min_alt_deg: float = 10.0,
    mask: HorizonMask | None = None,
) -> list[Pass]:
    """Return the times above an altitude, in order, within so many hours from start; [] where there are none.

    With a mask the satellite must be above that too. The propagator's satellite, site, bias and Earth
    orientation count; its place and refraction do not. Where SGP4 fails within the span, the span ends there.
    No pass longer than half a second is missed; see `crossings` for the proof.
    Raises TimeRangeError, SiteError for an altitude that is none, PropagationError where SGP4 fails at once.
    """
    check_hours(hours)
    horizon = Horizon(min_alt_deg, mask)
    start_s, span_s = float(start.unix_s), hours * HOUR_S
    elements = propagator.elements
    if not isinstance(elements, Elements):
        return _of_ephemeris(propagator, elements, (start_s, span_s), horizon)
    propagator.at(start)
    if propagator.bias == NO_BIAS:
        near = _near(propagator, elements, (start_s, span_s), horizon)
        if near is not None:
            return passes_of(near, start_s)
    seen = propagator.with_place("geometric")

    def sample(_: NDArray[np.intp], since_s: NDArray[np.float64]) -> NDArray[np.float64]:
        there = seen.at(Utc(start_s + since_s.ravel()))
        alt, az = np.radians(there.alt_deg), np.radians(there.az_deg)
        level = there.range_km * np.cos(alt)
        places = np.stack([level * np.sin(az), level * np.cos(az), there.range_km * np.sin(alt)])
        return places.reshape(3, *since_s.shape)

    terms = terms_for(elements.eccentricity)
    for _ in range(2):
        windows = Windows(np.zeros(1, dtype=np.intp), np.zeros(1), np.full(1, span_s))
        arcs, without = fit_arcs(windows, anomaly_pieces(elements, start_s, span_s), sample, terms)
        if not len(without):
            break
        span_s = _good_span(seen, start_s, span_s)
    return passes_of(find_crossings(arcs, horizon), start_s)


def _of_ephemeris(
    propagator: Propagator, ephemeris: Ephemeris, span: tuple[float, float], horizon: Horizon
) -> list[Pass]:
    """Return the passes of what is not propagated by SGP4, wherever its ephemeris has places in the span."""
    first_s, last_s = spans_within(ephemeris, *span)
    if len(first_s) == 0:
        propagator.at(Utc(span[0]))
        return []
    windows = Windows(np.zeros(len(first_s), dtype=np.intp), first_s, last_s)
    arcs = ephemeris_arcs(propagator, windows, span[0])
    return passes_of(find_crossings(arcs, horizon), span[0])


def _near(
    propagator: Propagator, elements: Elements, span: tuple[float, float], horizon: Horizon
) -> Crossings | None:
    """Return the crossings of a near-Earth object that keeps its orbit, None for any other."""
    # What Brouwer's mean motion differs by from the elements' own is far below a tenth.
    if elements.period_s > 1.1 * 60.0 * DEEP_SPACE_MIN:
        return None
    c = start_near_earth([elements])
    if float(c.period_s[0]) >= 60.0 * DEEP_SPACE_MIN:
        return None
    ground = Ground(propagator.site, propagator.earth, *span)
    found, left = near_crossings(c, ground, span, horizon)
    return None if len(left) else found


def check_hours(hours: float) -> None:
    """Raise TimeRangeError for a span that cannot be searched."""
    if not 0.0 < hours <= MOST_HOURS:
        raise TimeRangeError(
            f"{hours} hours is no span to search: give from above 0 to {MOST_HOURS:.0f} hours"
        )


def passes_of(found: Crossings, start_s: float) -> list[Pass]:
    """Return crossings, in seconds since start_s, as passes."""
    tops: list[list[Utc]] = [[] for _ in range(len(found.obj))]
    for run, peak_s in zip(found.peak_run.tolist(), found.peak_s.tolist(), strict=True):
        tops[run].append(Utc(start_s + peak_s))
    rows = zip(
        found.rise_s.tolist(),
        found.culminate_s.tolist(),
        found.set_s.tolist(),
        found.rise_az_deg.tolist(),
        found.culminate_az_deg.tolist(),
        found.set_az_deg.tolist(),
        found.max_alt_deg.tolist(),
        tops,
        strict=True,
    )
    isnan = math.isnan
    return [
        Pass(
            None if isnan(rise) else Utc(start_s + rise),
            Utc(start_s + top),
            None if isnan(end) else Utc(start_s + end),
            None if isnan(rise) else rise_az,
            top_az,
            None if isnan(end) else set_az,
            alt,
            tuple(all_tops),
        )
        for rise, top, end, rise_az, top_az, set_az, alt, all_tops in rows
    ]


def _good_span(seen: Propagator, start_s: float, span_s: float) -> float:
    """Return how many seconds of the span SGP4 can tell of."""
    grid = np.append(np.arange(0.0, span_s, _FAILURE_STEP_S), span_s)
    failed = np.flatnonzero(seen.at(Utc(start_s + grid)).error)
    if len(failed) == 0:
        return span_s
    good, bad = float(grid[failed[0] - 1]), float(grid[failed[0]])
    while bad - good > _FAILURE_CLOSE_S:
        middle = 0.5 * (good + bad)
        if int(seen.at(Utc(np.array([start_s + middle]))).error[0]):
            bad = middle
        else:
            good = middle
    return max(good - 1.0, 0.5 * good)

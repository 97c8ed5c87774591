"""When a satellite is above an altitude or a skyline: rise, culmination and set, geometric and airless."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.arcs import ECCENTRIC_TERMS, Windows, anomaly_pieces, even_pieces, fit_arcs, terms_for
from tle.bias import NO_BIAS
from tle.crossings import Crossings, find_crossings
from tle.earth import Ground
from tle.elements import Elements
from tle.errors import EphemerisError, TimeRangeError
from tle.gate import near_crossings
from tle.horizon import Horizon
from tle.instants import Utc
from tle.near_earth import DEEP_SPACE_MIN, start_near_earth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.arcs import Arcs, Index
    from tle.horizon import HorizonMask
    from tle.propagator import Propagator

    Array = NDArray[np.float64]

HOUR_S = 3600.0
MOST_HOURS = 24.0 * 366.0
LONGEST_PIECE_S = 900.0
_SHORTEST_WINDOW_S, _FAR_KM = 1.0, 1e6
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
        first_s, last_s = spans_within(propagator, start_s, span_s)
        windows = Windows(np.zeros(len(first_s), dtype=np.intp), first_s, last_s)
        seen = propagator.with_place("geometric")
        return passes_of(find_crossings(ephemeris_arcs([seen], windows, start_s), horizon), start_s)
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


def spans_within(propagator: Propagator, start_s: float, span_s: float) -> tuple[Array, Array]:
    """Return first and last seconds, after start_s (POSIX), for which there are places in a span; (k,).

    Raises EphemerisSpanError where there is none.
    """
    spans = propagator.elements.spans
    if not spans:
        return np.zeros(1), np.full(1, span_s)
    ends = np.array([[float(first.unix_s), float(last.unix_s)] for first, last in spans]) - start_s
    ends = np.clip(ends, 0.0, span_s)
    ends = ends[ends[:, 1] - ends[:, 0] > _SHORTEST_WINDOW_S]
    if len(ends) == 0:
        propagator.at(Utc(start_s))
    return ends[:, 0], ends[:, 1]


def ephemeris_arcs(propagators: Sequence[Propagator], windows: Windows, start_s: float) -> Arcs:
    """Return the ways of objects, each of the geometric place, in windows. Raises EphemerisError.

    What has no range is taken for far away: only its direction counts.
    """

    def sample(obj: Index, since_s: Array) -> Array:
        places = np.empty((3, *since_s.shape))
        for one in np.unique(obj).tolist():
            rows = obj == one
            there = propagators[one].at(Utc(start_s + since_s[rows].ravel()))
            alt, az = np.radians(there.alt_deg), np.radians(there.az_deg)
            range_km = there.range_km if propagators[one].elements.ranged else _FAR_KM
            level = range_km * np.cos(alt)
            place = np.stack([level * np.sin(az), level * np.cos(az), range_km * np.sin(alt)])
            places[:, rows] = place.reshape(3, -1, since_s.shape[1])
        return places

    pieces = even_pieces(windows, np.full(len(windows.obj), LONGEST_PIECE_S))
    arcs, without = fit_arcs(windows, pieces, sample, ECCENTRIC_TERMS)
    if len(without):
        source = propagators[int(without[0])].elements
        raise EphemerisError(
            f"{source.label}: its places are not smooth enough to search for passes", source=source.provenance
        )
    return arcs


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

"""The search for passes with compiled kernels, where the extra `fast` is installed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tle import arcs as arcs_
from tle.arcs import Arcs
from tle.crossings import CLOSE_S, SURE_S, Crossings, find_crossings
from tle.gate import HALVINGS, ROUND_BELOW, STRETCHES_A_TURN, gate_of, orbit_bounds
from tle.ground import EVEN_TURN_RAD_S
from tle.near_earth import mean_longitude

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.compiled import Fit, Place, Rules
    from tle.ground import Ground
    from tle.horizon import Horizon
    from tle.near_earth import NearEarth

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


def near_crossings(
    c: NearEarth, ground: Ground, span: tuple[float, float], horizon: Horizon
) -> tuple[Crossings, Index]:
    """Return what `near_search.near_crossings` does, by compiled code that holds no lock."""
    from tle import compiled

    start_s, span_s = span
    bounds = orbit_bounds(c, start_s, span_s)
    regular = np.flatnonzero(bounds.regular)
    left = np.flatnonzero(~bounds.regular)
    if len(left):
        c, bounds = c.take(regular), bounds.take(regular)
    is_round = bounds.eccentricity < ROUND_BELOW
    a_turn = np.where(is_round, 1.0, STRETCHES_A_TURN)
    gate = np.column_stack([*gate_of(c, bounds, ground, span, horizon.lowest_deg, a_turn), is_round])
    sine = math.sin(math.radians(horizon.lowest_deg))
    fit = _fit(arcs_.terms_for(float(c.ecco.max(initial=0.0))))
    orbits, longitude = np.column_stack(c), np.ascontiguousarray(mean_longitude(c).T)
    place = _place(ground, start_s)
    found = compiled.windows(orbits, gate, longitude, place, (start_s, span_s, sine), HALVINGS)
    longest_s = arcs_.longest_piece_s(c.period_s, c.ecco)
    rows, without = compiled.near_arcs(orbits, place, found, longest_s, start_s, fit, _rules(sine))
    return crossings(rows, horizon).renamed(regular), np.concatenate([left, regular[without > 0.0]])


def crossings(rows: Array, horizon: Horizon) -> Crossings:
    """Return what `crossings.find_crossings` does of rows of arcs; a skyline is left to that."""
    from tle import compiled_crossings as compiled

    if horizon.mask is not None:
        return find_crossings(_arcs_of(rows), horizon)
    found, tops = compiled.crossings(rows, _rules(math.sin(math.radians(horizon.min_alt_deg))))
    name, rise_s, set_s, top_s, rise_az, set_az, top_az, top_alt = np.ascontiguousarray(found.T)
    return Crossings(
        obj=name.astype(np.intp),
        rise_s=rise_s,
        set_s=set_s,
        culminate_s=top_s,
        rise_az_deg=rise_az,
        set_az_deg=set_az,
        culminate_az_deg=top_az,
        max_alt_deg=top_alt,
        peak_run=tops[:, 0].astype(np.intp),
        peak_s=tops[:, 1].copy(),
    )


def rows_of(arcs: Arcs) -> Array:
    """Return arcs as the rows that compiled code takes."""
    terms = len(arcs.powers)
    powers = arcs.powers.transpose(2, 1, 0).reshape(-1, 3 * terms)
    head = (arcs.obj, arcs.window, arcs.mid_s, arcs.half_s, arcs.speed, arcs.bend)
    return np.column_stack([*head, powers])


def _arcs_of(rows: Array) -> Arcs:
    head = np.ascontiguousarray(rows[:, :6].T)
    powers = np.ascontiguousarray(rows[:, 6:].reshape(len(rows), 3, -1).transpose(2, 1, 0))
    return Arcs(
        obj=head[0].astype(np.intp),
        window=head[1].astype(np.intp),
        mid_s=head[2],
        half_s=head[3],
        powers=powers,
        speed=head[4],
        bend=head[5],
    )


def _place(ground: Ground, start_s: float) -> Place:
    from tle.compiled import Place

    knots = np.column_stack(ground.knots)
    frame = np.array([ground.place, *ground.axes, ground.direction])
    turn = ground.turn_rad(start_s, np.zeros(1))[0] - (start_s - knots[0, 0]) * EVEN_TURN_RAD_S
    return Place(knots, frame, float(turn))


def _fit(terms: int) -> Fit:
    from tle.compiled import Fit

    nodes, to_chebyshev, to_powers, slope, bend = arcs_.basis_of(terms)
    return Fit(nodes, np.ascontiguousarray(to_chebyshev.T), np.ascontiguousarray(to_powers.T), slope, bend)


def _rules(sine: float) -> Rules:
    from tle.compiled import Rules

    return Rules(
        sine,
        arcs_.FIT_KM,
        arcs_.FIT_RAD,
        arcs_.SHORTEST_S,
        float(arcs_.MOST_HALVINGS),
        SURE_S,
        CLOSE_S,
    )

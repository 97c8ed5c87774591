"""Which directions a star run looks at, and in which order: spread over the sky, little slewing. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Rows = NDArray[np.intp]

BLOCK = 8
"""So many stars are toured at a time, spread over the whole sky: a run that ends early has seen all of it."""
GRID_DEG = 6.0
_MOST_SWEEPS = 20


def grid_deg(latitude_deg: float, step_deg: float = GRID_DEG) -> Array:
    """Return directions above the horizon, hour angle and declination, shape (n, 2), evenly spread."""
    count = round(41253.0 / step_deg**2)
    golden = np.pi * (3.0 - np.sqrt(5.0))
    number = np.arange(count)
    dec = np.degrees(np.arcsin(1.0 - (2.0 * number + 1.0) / count))
    hour_angle = np.degrees(number * golden) % 360.0 - 180.0
    every: Array = np.stack([hour_angle, dec], axis=1)
    up = np.sin(np.radians(latitude_deg)) * np.sin(np.radians(dec))
    up = up + np.cos(np.radians(latitude_deg)) * np.cos(np.radians(dec)) * np.cos(np.radians(hour_angle))
    above: Array = every[up > 0.0]
    return above


def units(places_deg: Array) -> Array:
    """Return unit vectors of hour angle and declination, shape (n, 3)."""
    h, d = np.radians(places_deg).T
    return np.stack([np.cos(d) * np.cos(h), np.cos(d) * np.sin(h), np.sin(d)], axis=1)


def chosen(places_deg: Array, count: int, done_deg: Array | None = None) -> Rows:
    """Return the rows of `count` places, each the farthest from those before it and from those `done_deg`.

    Places are hour angle and declination, shape (n, 2), all of which can be looked at; ties go to the first.
    """
    at = units(places_deg)
    if done_deg is not None and len(done_deg):
        nearest = np.max(at @ units(done_deg).T, axis=1)
    else:
        nearest = at @ np.mean(at, axis=0) * -1.0
    rows: list[int] = []
    for _ in range(min(count, len(at))):
        row = int(np.argmin(nearest))
        rows.append(row)
        first = len(rows) == 1 and done_deg is None
        near = at @ at[row]
        nearest = near if first else np.maximum(nearest, near)
        nearest[row] = 2.0
    return np.array(rows, dtype=np.intp)


def toured(axes_deg: Array, start_deg: tuple[float, float]) -> Rows:
    """Return the order in which to look at the axes' places, shape (n, 2), from a start; blocks stay apart.

    Both axes turn at once, so a slew takes as long as the farther one. In each block of BLOCK places the
    nearest comes next, then stretches are turned about where that is shorter (2-opt).
    """
    order: list[int] = []
    at = np.asarray(start_deg)
    for begin in range(0, len(axes_deg), BLOCK):
        rows = _tour(axes_deg[begin : begin + BLOCK], at)
        order += [begin + row for row in rows]
        at = axes_deg[order[-1]]
    return np.array(order, dtype=np.intp)


def slewed_deg(a: Any, b: Any) -> float:
    """Return how far the axis turns that turns farther."""
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b))))


def _tour(axes_deg: Array, start: Array) -> list[int]:
    left, order, at = list(range(len(axes_deg))), [], start
    while left:
        row = min(left, key=lambda one: slewed_deg(axes_deg[one], at))
        left.remove(row)
        order.append(row)
        at = axes_deg[row]
    for _ in range(_MOST_SWEEPS):
        before = _length(axes_deg, start, order)
        for i in range(len(order) - 1):
            for j in range(i + 1, len(order)):
                turned = order[:i] + order[i : j + 1][::-1] + order[j + 1 :]
                if _length(axes_deg, start, turned) < _length(axes_deg, start, order) - 1e-9:
                    order = turned
        if _length(axes_deg, start, order) >= before - 1e-9:
            break
    return order


def _length(axes_deg: Array, start: Array, order: list[int]) -> float:
    way = np.concatenate([start[None, :], axes_deg[order]])
    return float(np.max(np.abs(np.diff(way, axis=0)), axis=1).sum())

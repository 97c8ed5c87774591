"""Roots and least values of many functions at once, each within its own bracket."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_MOST_ROUNDS = 60
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def roots(
    value: Callable[[Array], Array],
    low: Array,
    high: Array,
    close: Array | float,
    at_ends: tuple[Array, Array] | None = None,
) -> Array:
    """Return a root in each bracket (m,), by Ridders' method, until none moves by `close` any more.

    The values at the ends of a bracket, `at_ends` where they are known, have different signs, zero counting
    as negative. Near the end the method squares the error from step to step.
    """
    if len(low) == 0:
        return low
    at_low, at_high = (value(low), value(high)) if at_ends is None else at_ends
    found = low
    for _ in range(_MOST_ROUNDS):
        middle = 0.5 * (low + high)
        at_middle = value(middle)
        spread = np.sqrt(np.maximum(at_middle * at_middle - at_low * at_high, 1e-300))
        new = middle + (middle - low) * np.sign(at_low - at_high) * at_middle / spread
        moved = np.abs(new - found)
        found = new
        if (moved < close).all():
            break
        at_new = value(new)
        # The bracket goes on from the new point to the closest one on the other side of the root.
        over = at_new > 0.0
        by_middle, by_low = (at_middle > 0.0) != over, (at_low > 0.0) != over
        high = np.where(by_middle, middle, np.where(by_low, low, high))
        at_high = np.where(by_middle, at_middle, np.where(by_low, at_low, at_high))
        low, at_low = new, at_new
    return found


def least(value: Callable[[Array], Array], low: Array, high: Array, rounds: int = 15) -> tuple[Array, Array]:
    """Return where values are least within brackets (m,) of one valley each, and the values there.

    By the golden section: each round leaves 0.62 of a bracket.
    """
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = value(left), value(right)
    for _ in range(rounds):
        first = at_left < at_right
        low, high = np.where(first, low, left), np.where(first, right, high)
        new = np.where(first, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        at_new = value(new)
        left, right = np.where(first, new, right), np.where(first, left, new)
        at_left, at_right = np.where(first, at_new, at_right), np.where(first, at_left, at_new)
    return np.where(at_left < at_right, left, right), np.minimum(at_left, at_right)

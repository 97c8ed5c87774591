"""The rates nearest to what is wanted that keep inside: straight on and slower, or along the limit. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Vector = tuple[float, float]

TURNS_DEG = (30.0, -30.0, 60.0, -60.0, 75.0, -75.0)
"""Directions on the sky, from that of the wish, that are tried; farther away nothing is gained."""
FINER_DEG = (15.0, 7.0)
"""Beside the best of them others are tried."""
WORTH = 0.04
"""What leads aside comes nearer to the wish by this share of its square: axes at a wall must not waver."""
HALVINGS = 5
SMALLEST_SHARE = 0.5**HALVINGS
"""Slower than this share of the wish it rests."""
GOOD_ENOUGH = 0.98


def nearest_rates(wanted: Vector, cos_dec: float, allowed: Callable[[Vector], bool]) -> Vector:
    """Return rates of hour angle and declination that are allowed, the nearest to the wanted ones on the sky.

    Rest, (0, 0), where none is. `cos_dec` is the cosine of the declination. Tried are the wish and what of it
    leads along directions beside it, slower where need be, and each axis as far as it may go: a limit of one
    axis is no reason for the other to leave its way.
    """
    cos_dec = max(0.02, abs(cos_dec))
    wish = (wanted[0] * cos_dec, wanted[1])
    size = math.hypot(*wish)
    if size == 0.0:
        return 0.0, 0.0

    def is_free(way: Vector) -> bool:
        return allowed((way[0] / cos_dec, way[1]))

    best = _farthest(wish, wish, (0.0, 0.0), is_free)
    if _gain(wish, best) < GOOD_ENOUGH * size * size:
        best = _by_axes(wish, best, is_free)
    aside = _aside(wish, best, is_free)
    if _gain(wish, aside) >= _gain(wish, best) + WORTH * size * size:
        best = aside
    return best[0] / cos_dec, best[1]


def _aside(wish: Vector, best: Vector, is_free: Callable[[Vector], bool]) -> Vector:
    """Return what of the wish leads in a direction beside it, or `best` where that is nearer."""
    turned_deg = 0.0
    for turn in TURNS_DEG:
        found = _farthest(wish, _part(wish, turn), best, is_free)
        best, turned_deg = (best, turned_deg) if found is best else (found, turn)
    for finer in FINER_DEG if turned_deg else ():
        for turn in (turned_deg - finer, turned_deg + finer):
            found = _farthest(wish, _part(wish, turn), best, is_free)
            best, turned_deg = (best, turned_deg) if found is best else (found, turn)
    return best


def _part(wish: Vector, turn_deg: float) -> Vector:
    """Return what of a wish leads in a direction turned from its own."""
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    return cosine * (wish[0] * cosine - wish[1] * sine), cosine * (wish[0] * sine + wish[1] * cosine)


def _gain(wish: Vector, way: Vector) -> float:
    """Return by how much a way comes nearer to the wish than rest does, in squares."""
    return 2.0 * (wish[0] * way[0] + wish[1] * way[1]) - way[0] ** 2 - way[1] ** 2


def _farthest(wish: Vector, way: Vector, best: Vector, is_free: Callable[[Vector], bool]) -> Vector:
    """Return as much of a way as is free, or `best` where that is nearer to the wish.

    The way is what of the wish leads in its direction, so that the nearer, the more of it.
    """
    most, gained = _gain(wish, way), _gain(wish, best)
    if most <= gained / GOOD_ENOUGH:
        return best
    # A share s of such a way gains 2s - s² of what all of it does.
    least = max(SMALLEST_SHARE, 1.0 - math.sqrt(1.0 - gained / most))
    share = _largest_share(way, is_free, least)
    found = (share * way[0], share * way[1])
    return found if _gain(wish, found) > gained else best


def _by_axes(wish: Vector, best: Vector, is_free: Callable[[Vector], bool]) -> Vector:
    """Return as much of the wish as each axis may have by itself and both together, or `best` if nearer."""
    one = _farthest(wish, (wish[0], 0.0), (0.0, 0.0), is_free)
    other = _farthest(wish, (0.0, wish[1]), (0.0, 0.0), is_free)
    both = (one[0], other[1])
    ways = [both, one, other] if is_free(both) else [one, other]
    return max(best, *ways, key=lambda way: _gain(wish, way))


def _largest_share(way: Vector, is_free: Callable[[Vector], bool], least: float) -> float:
    """Return the largest share of a way that is free, to a part in 2^HALVINGS; 0 for less than `least`."""
    if not is_free((way[0] * least, way[1] * least)):
        return 0.0
    if is_free(way):
        return 1.0
    low, high = least, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if is_free((way[0] * middle, way[1] * middle)):
            low = middle
        else:
            high = middle
    return low

"""The rates nearest to what is wanted that keep inside: straight on and slower, or along the limit. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Rates = tuple[float, float]

TURNS_DEG = (0.0, 30.0, -30.0, 60.0, -60.0, 80.0, -80.0)
"""Directions on the sky, from that of the wish, that are tried; farther away nothing is gained."""
HALVINGS = 5
SMALLEST_SHARE = 0.5**HALVINGS
"""Slower than this share of the wish it rests."""
GOOD_ENOUGH = 0.9


def nearest_rates(wanted: Rates, cos_dec: float, allowed: Callable[[Rates], bool]) -> Rates:
    """Return rates of hour angle and declination that are allowed and lead farthest towards the wanted ones.

    Rest, (0, 0), where none is. `cos_dec` is the cosine of the declination: the way on the sky counts.
    """
    cos_dec = max(0.02, abs(cos_dec))
    across, up = wanted[0] * cos_dec, wanted[1]
    if across == up == 0.0:
        return 0.0, 0.0
    best, gained = (0.0, 0.0), 0.0
    tries = [(_turned(across, up, turn), math.cos(math.radians(turn))) for turn in TURNS_DEG]
    size = math.hypot(across, up)
    tries += [((across, 0.0), abs(across) / size), ((0.0, up), abs(up) / size)]
    for (a, u), progress in tries:
        rates = (a / cos_dec, u)
        most = progress * math.hypot(a, u)
        if gained >= most:
            continue
        share = _largest_share(rates, allowed, max(gained / most, SMALLEST_SHARE))
        if share * most > gained:
            best, gained = (share * rates[0], share * rates[1]), share * most
        if gained > GOOD_ENOUGH * size:
            break
    return best


def _turned(across: float, up: float, turn_deg: float) -> tuple[float, float]:
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    return across * cosine - up * sine, across * sine + up * cosine


def _largest_share(rates: Rates, allowed: Callable[[Rates], bool], least: float) -> float:
    """Return the largest share of rates that is allowed, to a part in 2^HALVINGS; 0 for less than `least`."""
    if not allowed((rates[0] * least, rates[1] * least)):
        return 0.0
    if allowed(rates):
        return 1.0
    low, high = least, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if allowed((rates[0] * middle, rates[1] * middle)):
            low = middle
        else:
            high = middle
    return low

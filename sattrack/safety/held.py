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
"""What leads aside comes nearer to the wish by this share of what could be: axes at a wall must not waver."""
GOOD_ENOUGH = 0.98
HALVINGS = 5
SMALLEST_SHARE = 0.5**HALVINGS
"""Slower than this share of what could be it rests."""
NO_WAY = (0.0, 0.0)


def nearest_rates(
    wanted: Vector, room: tuple[Vector, Vector], cos_dec: float, allowed: Callable[[Vector], bool]
) -> Vector:
    """Return rates of hour angle and declination that are allowed, the nearest to the wanted ones on the sky.

    Rest, (0, 0), where none is. `room` are the least and the greatest rates, of each axis, that the next
    command may have; `cos_dec` is the cosine of the declination. Tried are the wish and what of it leads
    along directions beside it, slower where need be, and each axis as far as it may go: a limit of one axis
    is no reason for the other to leave its way.
    """
    search = _Search(wanted, room, max(0.02, abs(cos_dec)), allowed)
    best = search.farthest(search.wish, NO_WAY)
    if search.gain(best) < GOOD_ENOUGH * search.most:
        best = search.by_axes(best)
    aside = search.aside(best)
    if search.gain(aside) > search.gain(best) + WORTH * search.most:
        best = aside
    return search.rates(best)


class _Search:
    """Ways on the sky, across and up, degrees a second: how near they come to one wish, and what is free."""

    def __init__(
        self,
        wanted: Vector,
        room: tuple[Vector, Vector],
        cos_dec: float,
        allowed: Callable[[Vector], bool],
    ) -> None:
        self._cos_dec, self._allowed = cos_dec, allowed
        self.wish = (wanted[0] * cos_dec, wanted[1])
        self._room = ((room[0][0] * cos_dec, room[0][1] * cos_dec), room[1])
        self.most = self.gain((within(self.wish[0], self._room[0]), within(self.wish[1], self._room[1])))
        """What could be gained if nothing stood in the way."""

    def rates(self, way: Vector) -> Vector:
        """Return a way as rates of the axes."""
        return way[0] / self._cos_dec, way[1]

    def gain(self, way: Vector) -> float:
        """Return how much nearer to the wish a rate is than rest, as a difference of squares."""
        wish = self.wish
        return 2.0 * (wish[0] * way[0] + wish[1] * way[1]) - way[0] ** 2 - way[1] ** 2

    def farthest(self, part: Vector, best: Vector) -> Vector:
        """Return as much as is free of a part of the wish that leads some way, or `best` if it gains more."""
        whole, gained = self.gain(part), self.gain(best)
        if whole <= 0.0:
            return best
        fits = min(_fits(part[0], self._room[0]), _fits(part[1], self._room[1]))
        way = (fits * part[0], fits * part[1])
        if self.gain(way) * GOOD_ENOUGH <= gained:
            return best
        # A share s of such a part gains 2s - s² of what all of it does.
        least = (1.0 - math.sqrt(max(0.0, 1.0 - gained / whole))) / fits
        share = self._largest_share(way, max(SMALLEST_SHARE, min(1.0, least)))
        found = (share * way[0], share * way[1])
        return found if self.gain(found) > gained else best

    def by_axes(self, best: Vector) -> Vector:
        """Return as much of the wish as each axis may have and both together, or `best` if it gains more."""
        one = self.farthest((self.wish[0], 0.0), NO_WAY)
        other = self.farthest((0.0, self.wish[1]), NO_WAY)
        both = (one[0], other[1])
        ways = [both, one, other] if self._is_free(both) else [one, other]
        return max(best, *ways, key=self.gain)

    def aside(self, best: Vector) -> Vector:
        """Return what of the wish leads in a direction beside it, or `best` if it gains more."""
        turned_deg = 0.0
        for turn in TURNS_DEG:
            found = self.farthest(self._part(turn), best)
            best, turned_deg = (best, turned_deg) if found is best else (found, turn)
        for finer in FINER_DEG if turned_deg else ():
            for turn in (turned_deg - finer, turned_deg + finer):
                found = self.farthest(self._part(turn), best)
                best, turned_deg = (best, turned_deg) if found is best else (found, turn)
        return best

    def _part(self, turn_deg: float) -> Vector:
        """Return what of the wish leads in a direction turned from its own."""
        cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
        across, up = self.wish
        return cosine * (across * cosine - up * sine), cosine * (across * sine + up * cosine)

    def _is_free(self, way: Vector) -> bool:
        return self._allowed(self.rates(way))

    def _largest_share(self, way: Vector, least: float) -> float:
        """Return the largest share of a way that is free, to a part in 2^HALVINGS; 0 if less than `least`."""
        if not self._is_free((way[0] * least, way[1] * least)):
            return 0.0
        if self._is_free(way):
            return 1.0
        low, high = least, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            if self._is_free((way[0] * middle, way[1] * middle)):
                low = middle
            else:
                high = middle
        return low


def within(rate: float, room: Vector) -> float:
    """Return the rate nearest to one between the least and the greatest of a room."""
    return max(room[0], min(room[1], rate))


def _fits(rate: float, room: Vector) -> float:
    """Return the share of a rate, at most all of it, that a room about rest holds."""
    edge = room[1] if rate > 0.0 else room[0]
    return 1.0 if abs(rate) <= abs(edge) else edge / rate

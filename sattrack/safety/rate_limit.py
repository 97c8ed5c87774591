"""How far axes may come before a stop can hold them, and the rates that keep inside. Closed forms; pure.

The mount keeps the last rate that it got. So from a rate that goes out now, an axis may go on as it does
until that rate arrives, then at that rate for as long as nothing else arrives, and then it brakes. Where
the wanted rates would pass a limit, the nearest are taken: straight on and slower, or along the limit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from sattrack.safety.geometry import Box

if TYPE_CHECKING:
    from collections.abc import Callable

    Vector = tuple[float, float]
    from collections.abc import Mapping, Sequence

    from sattrack.mount.model import MountProfile
    from sattrack.safety.bounds import Bounds
    from sattrack.safety.geometry import Place
    from sattrack.safety.limits import SafetyLimits

PERIODS_UNTIL_OBEYED = 2.0
"""Ours until the next datagram goes out, and the mount's until its loop reads it."""
EDGE_PERIODS = 6.0
"""How long the handshake of a mount that takes rates by edges may hold back a new rate."""
OVERDUE_PERIODS = 4.0
"""By so much a handshake may take longer: links lose some datagrams, and each side has its period."""
JITTER_S = 0.1
CREEP_DEG_S = 0.1
"""Slower than this towards its limit, a stream that is held counts as closed up to it."""
BRAKING_SHARE = 0.8
"""Of the acceleration that the profile has, so much is counted on to brake."""


class Delays(NamedTuple):
    """How old what was seen is, how long until a command acts, and how long no other may act; seconds."""

    age_s: float
    latency_s: float
    fault_s: float


class AxisReach:
    """How far one axis may come from where it was seen, for one rate asked for after another.

    `now_deg_s` are the least and the greatest rate at which it may be going since.
    """

    def __init__(
        self,
        position_deg: float,
        now_deg_s: tuple[float, float],
        delays: Delays,
        acceleration_deg_s2: float,
    ) -> None:
        self._position_deg = position_deg
        self._age_s, self._latency_s, self._fault_s = delays
        self._twice_braking = 2.0 * BRAKING_SHARE * acceleration_deg_s2
        low, high = now_deg_s
        self._upward = high if high > 0.0 else 0.0
        self._downward = -low if low < 0.0 else 0.0
        self._least_up = self._ahead_deg(self._upward, 0.0)
        self._least_down = self._ahead_deg(self._downward, 0.0)

    def deg(self, rate_deg_s: float) -> tuple[float, float]:
        """Return the least and the greatest angle at which the axis may be until it has stopped."""
        if rate_deg_s >= 0.0:
            up, down = self._ahead_deg(self._upward, rate_deg_s), self._least_down
        else:
            up, down = self._least_up, self._ahead_deg(self._downward, -rate_deg_s)
        return self._position_deg - down, self._position_deg + up

    def _ahead_deg(self, going: float, asked: float) -> float:
        """Return how far an axis comes in a direction, at rates that are not below nought."""
        until_obeyed = going * self._age_s + (asked if asked > going else going) * self._latency_s
        ahead = until_obeyed + asked * self._fault_s + asked * asked / self._twice_braking
        if going > asked:
            ahead += (going - asked) ** 2 / self._twice_braking
        return ahead


def latency_s(profile: MountProfile, unanswered_s: float = 0.0) -> float:
    """Return how long it takes until a mount acts on what is decided now, no datagram lost, seconds.

    Where rates are taken by edges, what is decided waits for the handshake before, see `handshake_s`.
    """
    delay_s = profile.command_delay_s + profile.status_delay_s + max(profile.ra.lag_s, profile.dec.lag_s)
    waits_s = handshake_s(profile, unanswered_s)
    return PERIODS_UNTIL_OBEYED * profile.period_s + JITTER_S + delay_s + waits_s


def handshake_s(profile: MountProfile, unanswered_s: float) -> float:
    """Return for how long rates by edges wait for the handshake before; 0 where the latest rates are taken.

    It lasts `unanswered_s` on a mount that does not answer.
    """
    return max(unanswered_s, EDGE_PERIODS * profile.period_s) if profile.move_axis == "edge" else 0.0


def unheeded_s(profile: MountProfile, longest_fault_s: float) -> float:
    """Return for how long a rate that is in force may go on although it must end, seconds.

    What would end it is lost for the longest fault; and what ends it at last may be an abort, which some
    mounts obey later than any other command.
    """
    return longest_fault_s + profile.abort_delay_s


def standstill_s(rate_deg_s: float, latency_s: float, acceleration_deg_s2: float) -> float:
    """Return within what time an axis stands after a stop is asked for, a lost datagram not counted."""
    return latency_s + abs(rate_deg_s) / (BRAKING_SHARE * acceleration_deg_s2)


def closing_s(rate_deg_s: float, delays: Delays, acceleration_deg_s2: float) -> float:
    """Return within what time a stream that is held at a limit has closed up to it from a rate.

    What may still be gone grows with the rate, by latency and longest fault: so the rate falls by an e-th
    in that time, to CREEP_DEG_S.
    """
    decay_s = delays.latency_s + delays.fault_s
    falls_s = decay_s * math.log(max(1.0, abs(rate_deg_s) / CREEP_DEG_S))
    return falls_s + standstill_s(rate_deg_s, delays.latency_s, acceleration_deg_s2)


NOTHING_NEAR: Mapping[str, float] = {}
RateRanges: TypeAlias = "tuple[tuple[float, float], tuple[float, float]]"
"""The least rates of both axes, hour angle first, and the greatest."""


class Spot(NamedTuple):
    """A place where the axes may have been so many seconds ago."""

    place: Place
    age_s: float


class Ahead:
    """Looks ahead for one mount among its bounds."""

    def __init__(self, profile: MountProfile, limits: SafetyLimits, bounds: Bounds) -> None:
        self._bounds = bounds
        self._profile = profile
        self._unheeded_s = unheeded_s(profile, limits.longest_fault_s)
        self._braking_deg_s2 = profile.braking_deg_s2
        self._unanswered_s = -1.0
        self.latency_s = self.horizon_s = self.handshake_s = 0.0
        """How long it takes until the mount acts on what is decided now; how long it may take until it acts
        on what is decided next; and how long rates by edges wait for the handshake before."""
        self.handshakes_last(0.0)

    @property
    def overdue_s(self) -> float:
        """From when on rates by edges have waited for longer than a handshake may take on a good link."""
        delays_s = self._profile.command_delay_s + self._profile.status_delay_s
        return self.handshake_s + delays_s + OVERDUE_PERIODS * self._profile.period_s

    def handshakes_last(self, unanswered_s: float) -> None:
        """Look ahead for a mount whose handshakes last so long, where it does not answer them."""
        if unanswered_s == self._unanswered_s:
            return
        self._unanswered_s = unanswered_s
        self.latency_s = latency_s(self._profile, unanswered_s)
        self.horizon_s = self.latency_s + self._unheeded_s
        self.handshake_s = handshake_s(self._profile, unanswered_s)

    def outlook(
        self, spots: Sequence[Spot], now: RateRanges, nears: Sequence[Mapping[str, float]] | None = None
    ) -> Outlook:
        """Return what judges rates from any of the spots.

        `now` are the least and the greatest rates of both axes in force. `nears` are, for each spot, the
        limits whose margin the axes have used up, and what is left: rates must not lead nearer to them, nor
        past them by what is under way.
        """
        views = []
        for k, spot in enumerate(spots):
            ha, dec = self._reaches(spot, now, self.latency_s)
            views.append(_View(spot.place, ha, dec, nears[k] if nears else NOTHING_NEAR))
        return Outlook(self._bounds, self.horizon_s, views)

    def going_on(self, spots: Sequence[Spot], rates: Vector) -> str | None:
        """Return the limit that axes may pass that go on at rates until a stop holds them, or None.

        A stop waits for no handshake. Of limits whose margin is used up, see `outlook`, what is left counts.
        """
        begun_s = self.latency_s - self.handshake_s
        for spot in spots:
            near = self._bounds.near(spot.place, self.horizon_s)
            box = self._box(spot, (rates, rates), rates, begun_s)
            name = self._bounds.violated(box, _margins(near), begun_s + self._unheeded_s)
            if name is not None:
                return name
        return None

    def disobeying(self, spots: Sequence[Spot], rates: Vector, before: Vector, for_s: float) -> str | None:
        """Return what limit `going_on` has for axes that were seen at rates they should have left by then.

        Other ones had been sent for so long; `before`, the axes were as fast as that, either way. None as
        long as they may be braking towards what was sent.
        """
        slower_s = [
            (abs(fastest) - abs(rate)) / (BRAKING_SHARE * braking)
            for rate, fastest, braking in zip(rates, before, self._braking_deg_s2, strict=True)
        ]
        if for_s - (self.latency_s - self.handshake_s) <= max(0.0, *slower_s):
            return None
        return self.going_on(spots, rates)

    def reach(self, spot: Spot, now: RateRanges, rates: tuple[float, float]) -> Box:
        """Return where the axes may come under these rates before a stop can hold them."""
        return self._box(spot, now, rates, self.latency_s)

    def _box(self, spot: Spot, now: RateRanges, rates: tuple[float, float], latency_s: float) -> Box:
        ha, dec = self._reaches(spot, now, latency_s)
        return Box(*ha.deg(rates[0]), *dec.deg(rates[1]))

    def _reaches(self, spot: Spot, now: RateRanges, latency_s: float) -> tuple[AxisReach, AxisReach]:
        delays = Delays(spot.age_s, latency_s, self._unheeded_s)
        (ha_low, dec_low), (ha_high, dec_high) = now
        ha_deg, dec_deg = spot.place
        ha_braking, dec_braking = self._braking_deg_s2
        return (
            AxisReach(ha_deg, (ha_low, ha_high), delays, ha_braking),
            AxisReach(dec_deg, (dec_low, dec_high), delays, dec_braking),
        )


class _View:
    """A place, how far each axis may come from it, and what is near there."""

    __slots__ = ("dec", "ha", "margins", "near", "place")

    def __init__(self, place: Place, ha: AxisReach, dec: AxisReach, near: Mapping[str, float]) -> None:
        self.place, self.ha, self.dec, self.near = place, ha, dec, near
        self.margins = _margins(near)


def _margins(near: Mapping[str, float]) -> Mapping[str, float]:
    """Return the margins that count of limits whose own are used up; no matter where axes are past them."""
    return {name: 0.0 if clear >= 0.0 else -math.inf for name, clear in near.items()} or NOTHING_NEAR


class Outlook:
    """What lies ahead of axes that go on as they do until a command acts: judges one wish after another."""

    def __init__(self, bounds: Bounds, horizon_s: float, views: Sequence[_View]) -> None:
        self._bounds, self._horizon_s, self._views = bounds, horizon_s, views

    def limit(self, rates: tuple[float, float]) -> str | None:
        """Return the limit that these rates may pass before a stop can hold the axes, or None."""
        for view in self._views:
            box = Box(*view.ha.deg(rates[0]), *view.dec.deg(rates[1]))
            name = self._bounds.violated(box, view.margins, self._horizon_s)
            if name is None and view.near:
                name = self._bounds.comes_nearer(view.near, view.place, rates, self._horizon_s)
            if name is not None:
                return name
        return None


TURNS_DEG = (30.0, -30.0, 60.0, -60.0, 75.0, -75.0)
"""Directions on the sky, from that of the wish, that are tried; farther away nothing is gained."""
FINER_DEG = (15.0, 7.0)
"""Beside the best of them others are tried."""
WORTH = 0.04
"""What leads aside comes nearer to the wish by this share of what could be: axes at a wall must not waver."""
GOOD_ENOUGH = 0.98
HALVINGS = 5
SMALLEST_SHARE = 0.5**HALVINGS
"""An axis slower than this share of its possible rate counts as resting."""
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

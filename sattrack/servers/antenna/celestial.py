"""Ways of the antenna's axes that the controller reduces itself: sources, and satellites by their elements.

"Ideal Field System Antenna Interface", sections 7.0 and 8.0. The reduction: the place of date (for J2000 by
precession, nutation and aberration; for satellites by SGP4), plus the offsets in right ascension and
declination; the hour angle by local apparent sidereal time, plus the offsets in hour angle and declination;
azimuth and elevation, plus theirs; for equatorial axes the pointing model at last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from sattrack.servers.antenna.sky import AxisKind, AzEl, HaDec, RaDec, Sky
from sattrack.servers.antenna.trajectory import NS, AxisState
from tle.instants import Utc

if TYPE_CHECKING:
    from tle.bias import Bias
    from tle.propagator import Propagator

DIFFERENCE_NS = 50_000_000
"""Half of the interval over which rates are taken as differences of positions."""
INVERSE_ROUNDS = 8


class Target(Protocol):
    """Something in the sky."""

    def place(self, utc_s: float) -> RaDec:
        """Return its topocentric right ascension and declination of date, degrees."""


@dataclass(frozen=True, slots=True)
class OfDate:
    """A source by topocentric coordinates of date."""

    coordinates: RaDec

    def place(self, utc_s: float) -> RaDec:
        """Return them."""
        del utc_s
        return self.coordinates


@dataclass(frozen=True, slots=True)
class Mean:
    """A source by mean coordinates of J2000 (ICRS)."""

    coordinates: RaDec
    sky: Sky

    def place(self, utc_s: float) -> RaDec:
        """Return its apparent place."""
        return self.sky.of_date(self.coordinates, utc_s)


@dataclass(frozen=True, slots=True)
class Satellite:
    """A satellite by its elements, with biases along and across its track."""

    propagator: Propagator
    bias: Bias

    def place(self, utc_s: float) -> RaDec:
        """Return where it is seen. Raises PropagationError where its elements end."""
        seen = self.propagator.at(Utc(utc_s), self.bias)
        return RaDec(float(seen.ra_deg), float(seen.dec_deg))


@dataclass(frozen=True, slots=True)
class PointingModel:
    """Corrections of equatorial axes, degrees, added to hour angle and declination to give axis positions.

    ΔHA = ih + ch/cos δ + np·tan δ - ma·cos h·tan δ + me·sin h·tan δ; ΔDec = id + ma·sin h + me·cos h.
    """

    ih: float = 0.0
    id: float = 0.0
    ch: float = 0.0
    np: float = 0.0
    ma: float = 0.0
    me: float = 0.0

    def correction(self, place: HaDec) -> HaDec:
        """Return what is added at a direction; within 0.1° of the pole as it is there."""
        h = math.radians(place.ha_deg)
        d = math.radians(max(-89.9, min(89.9, place.dec_deg)))
        tan, sec = math.tan(d), 1.0 / math.cos(d)
        turn = self.ih + self.ch * sec + self.np * tan
        turn += (self.me * math.sin(h) - self.ma * math.cos(h)) * tan
        return HaDec(turn, self.id + self.ma * math.sin(h) + self.me * math.cos(h))

    def axes(self, place: HaDec) -> HaDec:
        """Return the axes' positions for a direction."""
        added = self.correction(place)
        return HaDec(place.ha_deg + added.ha_deg, place.dec_deg + added.dec_deg)

    def inverse(self, axes: HaDec) -> HaDec:
        """Return the direction that axes' positions point at: `axes` turned round, by iteration."""
        place = axes
        for _ in range(INVERSE_ROUNDS):
            added = self.correction(place)
            place = HaDec(axes.ha_deg - added.ha_deg, axes.dec_deg - added.dec_deg)
        return place


NO_OFFSET = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Reduction:
    """From a place of date to the antenna's axes."""

    sky: Sky
    axes: AxisKind
    radec: tuple[float, float] = NO_OFFSET
    hadec: tuple[float, float] = NO_OFFSET
    azel: tuple[float, float] = NO_OFFSET
    model: PointingModel = field(default_factory=PointingModel)

    def positions(self, place: RaDec, utc_s: float) -> tuple[float, float]:
        """Return both axes' positions, degrees, on any turn."""
        ha_deg = self.sky.sidereal_deg(utc_s) - place.ra_deg - self.radec[0]
        there = HaDec(ha_deg + self.hadec[0], place.dec_deg + self.radec[1] + self.hadec[1])
        if self.axes == "azel" or self.azel != NO_OFFSET:
            seen = self.sky.horizontal(there, utc_s)
            seen = AzEl(seen.az_deg + self.azel[0], seen.el_deg + self.azel[1])
            if self.axes == "azel":
                return seen
            there = self.sky.equatorial(seen, utc_s)
        return self.model.axes(there)


class SkyPath:
    """The way of a target as the axes follow it, turns of the first axis counted from `near_deg` on."""

    def __init__(self, target: Target, reduction: Reduction, near_deg: float) -> None:
        self.target = target
        self._reduction = reduction
        self._last_deg = near_deg

    def at(self, utc_ns: int) -> AxisState:
        """Return where the axes are to be at an instant."""
        first, second = self._place(utc_ns)
        early, late = self._place(utc_ns - DIFFERENCE_NS), self._place(utc_ns + DIFFERENCE_NS)
        apart_s = 2.0 * DIFFERENCE_NS / NS
        first += 360.0 * round((self._last_deg - first) / 360.0)
        self._last_deg = first
        return AxisState(
            first,
            second,
            math.remainder(late[0] - early[0], 360.0) / apart_s,
            (late[1] - early[1]) / apart_s,
        )

    def turn_by(self, turns: int) -> None:
        """Count so many turns of the first axis more."""
        self._last_deg += 360.0 * turns

    def reduced_by(self, reduction: Reduction) -> SkyPath:
        """Return the same target's way by another reduction."""
        return SkyPath(self.target, reduction, self._last_deg)

    def _place(self, utc_ns: int) -> tuple[float, float]:
        utc_s = utc_ns / NS
        return self._reduction.positions(self.target.place(utc_s), utc_s)

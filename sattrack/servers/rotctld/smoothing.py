"""A client's coarse steps as one smooth way: position and rate from successive positions, filtered.

A satellite program tells a rotator about once a second where the satellite is just then, to a hundredth of a
degree. Three or more positions of which each continues those before make a *track*: a parabola through the
last ones by least squares, in Cartesian coordinates so that neither the zenith nor north is anything special,
is gone along until the next comes. Where a new one bends the way, the difference is let go of over a second
or more, without a step in position or rate. Everything else is a position to stand at.

A track whose client falls silent ends soon. Pure: instants are given, UTC as POSIX seconds.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.servers.antenna.sky import AzEl
from sattrack.servers.antenna.trajectory import NS, AxisState

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]

MOST_POINTS = 7
"""So many are fitted: at one a second, more miss bends of the way, fewer let more of their rounding in."""
FEWEST_POINTS = 3
"""A track has so many; with these few its way is straight."""
MOST_GAP_S = 40.0
LEAST_GAP_S = 0.02
"""Positions that come sooner after each other than this are one: the last."""
MOST_RATE_DEG_S = 6.0
NOISY_DEG, NOISY_S = 0.03, 12.0
"""Positions of so short a time that scatter more than this about a parabola are fitted by a straight way,
which follows them less; those of a longer time may be off it because the way bends more."""
STRAY_DEG = 0.1
STRAY_SHARE = 0.15
STRAY_S = 1.0
"""How far a position may be from where those before lead: so much, and so much of a step; and along the way
so much sooner or later, as some programs send where a satellite will be, now more ahead and now less."""
COAST_S = 3.0
"""How long a track goes on after the last word of its client."""
LEAST_CONTENT_S, MOST_CONTENT_S, CONTENT_GAPS = 10.0, 30.0, 2.5
"""How long it goes on after the last position, while its client goes on to ask where the mount is: so many of
the last interval between positions. Some clients send a position only where the mount is off."""
EASE_S = 1.0
"""How long a track takes to come to rest."""
RETURN_S = 4.0
"""How long it rests there; a client that asks on, and sends nothing, then means the position that it sent."""
LEAST_BLEND_S, MOST_BLEND_S = 1.0, 3.0
BLEND_DEG_S2 = 0.5
"""A bend is let go of so slowly that this acceleration is enough, as far as that is within those times."""
RATE_STEP_S = 0.05


def _unit(place: AzEl) -> Vector:
    az, el = math.radians(place.az_deg), math.radians(place.el_deg)
    return np.array([math.cos(el) * math.sin(az), math.cos(el) * math.cos(az), math.sin(el)])


def _place(v: Vector) -> AzEl:
    e, n, u = (float(x) for x in v)
    return AzEl(math.degrees(math.atan2(e, n)) % 360.0, math.degrees(math.atan2(u, math.hypot(e, n))))


def _apart_deg(a: Vector, b: Vector) -> float:
    return math.degrees(2.0 * math.asin(min(1.0, 0.5 * float(np.linalg.norm(a - b)))))


class _Curve(NamedTuple):
    """A parabola, and past `straight_s` its tangent; seconds since `since_s`."""

    since_s: float
    straight_s: float
    terms: Vector
    """Three rows: place, rate, half of the acceleration."""

    def at(self, utc_s: float) -> tuple[Vector, Vector]:
        """Return place and rate."""
        t = utc_s - self.since_s
        bent = min(t, self.straight_s)
        rate = self.terms[1] + 2.0 * bent * self.terms[2]
        place = self.terms[0] + bent * (self.terms[1] + bent * self.terms[2]) + (t - bent) * rate
        return place, rate


class _Point(NamedTuple):
    utc_s: float
    v: Vector


class SmoothedTrack:
    """The way that one client's positions make."""

    def __init__(self) -> None:
        self._points: deque[_Point] = deque(maxlen=MOST_POINTS)
        self._last = AzEl(0.0, 0.0)
        self._curve: _Curve | None = None
        self._bend: tuple[Vector, Vector] | None = None
        self._blend_s = LEAST_BLEND_S
        self._bent_s = 0.0
        self._heard_s = -math.inf
        self._gone = False

    @property
    def following(self) -> bool:
        """Whether the positions make a track."""
        return self._curve is not None

    def take(self, place: AzEl, utc_s: float) -> None:
        """Take a position that has come."""
        v, points = _unit(place), self._points
        former = None if self._curve is None else self._in_force(utc_s)
        if points and utc_s - points[-1].utc_s < LEAST_GAP_S:
            points.pop()
        if points and not self._continues(v, utc_s):
            points.clear()
        points.append(_Point(utc_s, v))
        self._last, self._heard_s, self._gone = place, utc_s, False
        self._curve = self._fit() if len(points) >= FEWEST_POINTS else None
        self._bend, self._bent_s = None, utc_s
        if former is not None and self._curve is not None:
            there, rate = self._curve.at(utc_s)
            self._bend = off, _ = former[0] - there, former[1] - rate
            blend_s = math.sqrt(6.0 * math.degrees(float(np.linalg.norm(off))) / BLEND_DEG_S2)
            self._blend_s = max(LEAST_BLEND_S, min(MOST_BLEND_S, blend_s))

    def heard(self, utc_s: float) -> None:
        """Note that the client is there, whatever it said; after too long a silence that changes nothing."""
        if utc_s <= self._ends_s():
            self._heard_s = utc_s

    def hang_up(self) -> None:
        """Note that the client is gone."""
        self._gone = True

    def at(self, utc_ns: int) -> AxisState:
        """Return where the way is at an instant: azimuth, elevation and their rates; see trajectory.Path."""
        utc_s = utc_ns / NS
        here, later = self._at(utc_s), self._at(utc_s + RATE_STEP_S)
        return AxisState(
            here.az_deg,
            here.el_deg,
            math.remainder(later.az_deg - here.az_deg, 360.0) / RATE_STEP_S,
            (later.el_deg - here.el_deg) / RATE_STEP_S,
        )

    def _at(self, utc_s: float) -> AzEl:
        if self._curve is None:
            return self._last
        ends_s = self._ends_s()
        content = not self._gone and ends_s >= self._points[-1].utc_s + self._content_s()
        if content and utc_s >= ends_s + EASE_S + RETURN_S:
            return self._last
        return _place(self._in_force(utc_s)[0])

    def _ends_s(self) -> float:
        """Return when a track begins to come to rest, if nothing else is heard."""
        if not self._points:
            return -math.inf
        return min(self._heard_s + COAST_S, self._points[-1].utc_s + self._content_s())

    def _content_s(self) -> float:
        if len(self._points) < FEWEST_POINTS:
            return LEAST_CONTENT_S
        gap_s = self._points[-1].utc_s - self._points[-2].utc_s
        return max(LEAST_CONTENT_S, min(MOST_CONTENT_S, CONTENT_GAPS * gap_s))

    def _in_force(self, utc_s: float) -> tuple[Vector, Vector]:
        """Return place and rate of a track, which slows down where it ends, and stands."""
        past_s = max(0.0, min(utc_s - self._ends_s(), EASE_S))
        place, rate = self._on_curve(min(utc_s, self._ends_s()) + past_s - past_s * past_s / (2.0 * EASE_S))
        return place, rate * (1.0 - past_s / EASE_S)

    def _on_curve(self, utc_s: float) -> tuple[Vector, Vector]:
        """Return place and rate of the way, with what is left of the last bend."""
        assert self._curve is not None
        place, rate = self._curve.at(utc_s)
        lasts_s = self._blend_s
        s = (utc_s - self._bent_s) / lasts_s
        if self._bend is None or not 0.0 <= s < 1.0:
            return place, rate
        off, off_rate = self._bend
        left, left_rate = 1.0 - s * s * (3.0 - 2.0 * s), 6.0 * s * (s - 1.0) / lasts_s
        gone, gone_rate = s * (1.0 - s) ** 2 * lasts_s, (1.0 - s) * (1.0 - 3.0 * s)
        return place + left * off + gone * off_rate, rate + left_rate * off + gone_rate * off_rate

    def _continues(self, v: Vector, utc_s: float) -> bool:
        """Tell whether a position continues those before it."""
        last = self._points[-1]
        gap_s, step_deg = utc_s - last.utc_s, _apart_deg(last.v, v)
        if not 0.0 < gap_s <= MOST_GAP_S or step_deg > MOST_RATE_DEG_S * gap_s:
            return False
        if self._curve is not None:
            led, rate = self._curve.at(utc_s)
        elif len(self._points) > 1:
            before = self._points[-2]
            rate = (last.v - before.v) / (last.utc_s - before.utc_s)
            led = last.v + rate * gap_s
        else:
            return True
        off = v - led / np.linalg.norm(led)
        pace = float(np.linalg.norm(rate))
        along = float(off @ rate) / pace if pace > 0.0 else 0.0
        across = math.sqrt(max(0.0, float(off @ off) - along * along))
        stray = math.radians(STRAY_DEG + STRAY_SHARE * step_deg)
        return across <= stray and abs(along) <= stray + STRAY_S * pace

    def _fit(self) -> _Curve:
        last_s = self._points[-1].utc_s
        t = np.array([point.utc_s - last_s for point in self._points])
        places = np.stack([point.v for point in self._points])
        degree = 1 if len(t) <= FEWEST_POINTS else 2
        while True:
            powers = np.stack([t**power for power in range(degree + 1)], axis=1)
            solved = np.linalg.lstsq(powers, places, rcond=None)[0]
            scatter = math.sqrt(float(np.sum((powers @ solved - places) ** 2)) / max(1, len(t) - degree - 1))
            if degree == 1 or scatter <= math.radians(NOISY_DEG) or -t[0] > NOISY_S:
                break
            degree = 1
        terms = np.zeros((3, 3))
        terms[: degree + 1] = solved
        return _Curve(last_s, 2.0 * float(-t[0]) / (len(t) - 1), terms)

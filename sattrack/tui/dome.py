"""The sky over a site as a disc: zenith in the middle, horizon as rim, north up and east to the left."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount.model import mean_sidereal_deg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sattrack.views.run import SkyPoint

RIGHT_DEG = 90.0


class Spot(NamedTuple):
    """A direction over the site, degrees; azimuth from north through east."""

    alt_deg: float
    az_deg: float


Vector = tuple[float, float, float]
"""A unit vector: north, east, up."""


class Disc(NamedTuple):
    """Where the disc lies among the dots of a canvas: its middle and its radius."""

    x: float
    y: float
    radius: float

    @classmethod
    def within(cls, columns: int, rows: int) -> Disc:
        """Return the largest that fits into so many cells."""
        return cls(float(columns), 2.0 * rows, max(1.0, min(columns, 2 * rows) - 0.6))

    def place(self, spot: Spot) -> tuple[float, float] | None:
        """Return where a direction lies; None below the horizon. Distance from the zenith to scale."""
        if spot.alt_deg < 0.0:
            return None
        out = self.radius * (RIGHT_DEG - spot.alt_deg) / RIGHT_DEG
        az = math.radians(spot.az_deg)
        return self.x - out * math.sin(az), self.y - out * math.cos(az)

    def spot(self, x: float, y: float) -> Spot | None:
        """Return the direction at a place; None outside the disc."""
        west, south = x - self.x, y - self.y
        out = math.hypot(west, south) / self.radius
        if out > 1.0:
            return None
        return Spot(RIGHT_DEG * (1.0 - out), math.degrees(math.atan2(-west, -south)) % 360.0)


def vector(spot: Spot) -> Vector:
    """Return the unit vector of a direction."""
    alt, az = math.radians(spot.alt_deg), math.radians(spot.az_deg)
    return math.cos(alt) * math.cos(az), math.cos(alt) * math.sin(az), math.sin(alt)


def spot_of(v: Vector) -> Spot:
    """Return the direction of a vector of any length but 0."""
    alt = math.degrees(math.atan2(v[2], math.hypot(v[0], v[1])))
    return Spot(alt, math.degrees(math.atan2(v[1], v[0])) % 360.0)


def apart_deg(one: Spot, other: Spot) -> float:
    """Return the angle between two directions."""
    a, b = vector(one), vector(other)
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return math.degrees(math.atan2(math.hypot(*cross), sum(p * q for p, q in zip(a, b, strict=True))))


def circle(middle: Spot, radius_deg: float, count: int) -> Iterator[Spot]:
    """Give points around a circle on the sky, the first once more at the end."""
    up, az = math.radians(middle.alt_deg), math.radians(middle.az_deg)
    c = vector(middle)
    u = (-math.sin(up) * math.cos(az), -math.sin(up) * math.sin(az), math.cos(up))
    w = (-math.sin(az), math.cos(az), 0.0)
    near, far = math.cos(math.radians(radius_deg)), math.sin(math.radians(radius_deg))
    for step in range(count + 1):
        turn = math.tau * step / count
        p, q = far * math.cos(turn), far * math.sin(turn)
        x, y, z = (near * c[i] + p * u[i] + q * w[i] for i in range(3))
        yield spot_of((x, y, z))


def at_instant(points: Sequence[SkyPoint], utc_s: float) -> Spot | None:
    """Return where a row of points leads at an instant, held at its ends; None of none."""
    if not points:
        return None
    after = bisect_right(points, utc_s, key=lambda point: point.utc_s)
    one, other = points[max(0, after - 1)], points[min(len(points) - 1, after)]
    span_s = other.utc_s - one.utc_s
    share = min(1.0, max(0.0, (utc_s - one.utc_s) / span_s)) if span_s > 0.0 else 0.0
    a, b = vector(Spot(one.alt_deg, one.az_deg)), vector(Spot(other.alt_deg, other.az_deg))
    x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
    return spot_of((x, y, z))


def skyline_deg(horizon: Sequence[tuple[float, float]], floor_deg: float, az_deg: float) -> float:
    """Return the least altitude at an azimuth: straight between the skyline's points, or the floor."""
    if not horizon:
        return floor_deg
    turned = az_deg % 360.0
    after = bisect_right(horizon, turned, key=lambda point: point[0])
    (az_1, alt_1), (az_2, alt_2) = horizon[after - 1], horizon[after % len(horizon)]
    span = (az_2 - az_1) % 360.0
    share = (turned - az_1) % 360.0 / span if span > 0.0 else 0.0
    return max(floor_deg, alt_1 + share * (alt_2 - alt_1))


def over_site(ra_deg: float, dec_deg: float, utc_s: float, latitude_deg: float, longitude_deg: float) -> Spot:
    """Return where a right ascension and declination of date stand, without air; mean sidereal time."""
    hour = math.radians(mean_sidereal_deg(utc_s, longitude_deg) - ra_deg)
    dec, lat = math.radians(dec_deg), math.radians(latitude_deg)
    north = math.cos(lat) * math.sin(dec) - math.sin(lat) * math.cos(dec) * math.cos(hour)
    east = -math.cos(dec) * math.sin(hour)
    up = math.sin(lat) * math.sin(dec) + math.cos(lat) * math.cos(dec) * math.cos(hour)
    return spot_of((north, east, up))

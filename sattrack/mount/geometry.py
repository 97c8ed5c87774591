"""Two axes in space: directions and the angles of the axes that point there, both ways, with rates. Pure.

A mount's first axis points somewhere in the site's horizon frame, its *pole*. The second axis stands on the
first, square to it or nearly so; the tube stands on the second. The angle of the first axis is an hour angle
about the pole: clockwise seen from outside, and 0 where the tube hangs over the pole's own meridian. The
angle of the second is a declination from it, 90° at the pole. An equatorial mount's pole is the celestial
one, and its angles are hour angle and declination; an alt-azimuth mount's is the zenith, and its angles are
azimuth from the south and altitude.

Vectors here are (meridian on the equator, west, pole), those of `safety.geometry.Box`, of the sky or of the
mount. Angles are degrees. Functions take floats, or arrays where `fn` is numpy.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import msgspec

from sattrack.core.angles import wrap180

MOST_OFF_DEG = 20.0
"""How far the axes may be from square, and the tube from square to the second axis."""
STILL_FIELD_DEG = 0.5
"""How far from the celestial pole a mount's own may be, for a field that is taken to stand still."""
DIFFERENCE_S = 0.001
RATE_OVER_S = 0.5
"""Half of the time over which the field's rotation is differenced."""
SAME_POLE_DEG = 0.1
"""A first axis that is nearer to the zenith is an azimuth axis to pointing models; one that was moved so far
is another one."""


class Pole(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a mount's first axis points, degrees, as in `AxisGeometry`."""

    pole_azimuth_deg: float
    pole_altitude_deg: float

    @property
    def vectors(self) -> tuple[tuple[float, float, float], ...]:
        """The mount's own vectors (meridian on its equator, west, pole), each as east, north, up."""
        azimuth, altitude = self.pole_azimuth_deg, self.pole_altitude_deg
        return _unit(azimuth, altitude + 90.0), _unit(azimuth - 90.0, 0.0), _unit(azimuth, altitude)

    def moved_deg(self, other: Pole) -> float:
        """Return by how much the other's vectors lie elsewhere, the one that is farthest off."""
        pairs = zip(self.vectors, other.vectors, strict=True)
        apart = max(math.dist(one, another) for one, another in pairs)
        return math.degrees(2.0 * math.asin(min(1.0, 0.5 * apart)))


class AxisGeometry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a mount's two axes lie, and what the coordinates mean that it reports.

    `pole_azimuth_deg` and `pole_altitude_deg` say where the first axis points: of its two ends the one from
    which it turns clockwise by growing angles. With the pole at the zenith the azimuth still says where the
    first angle is 0: opposite to it. `axes_deg` is the angle between the axes, `cone_deg` by how much the
    tube leans towards the second axis. `reports` is "sky" where the mount reports right ascension and
    declination by a model of its own, "horizon" where only its azimuth and altitude say where it points, and
    "axes" where right ascension and declination are the angles of its axes. Then an angle is `sense` times
    what is reported less `zero`. A mount that reports directions and was never aligned has zero points too:
    an angle is that of the reported direction, less `zero`.

    Raises ValueError, naming the field, for what no mount can be.
    """

    pole_azimuth_deg: float
    pole_altitude_deg: float
    axes_deg: float = 90.0
    cone_deg: float = 0.0
    reports: Literal["sky", "horizon", "axes"] = "sky"
    first_zero_deg: float = 0.0
    second_zero_deg: float = 0.0
    first_sense: Literal[-1, 1] = 1
    second_sense: Literal[-1, 1] = 1

    def __post_init__(self) -> None:
        """Check the angles."""
        ranges = {
            "pole_azimuth_deg": (-360.0, 360.0),
            "pole_altitude_deg": (-90.0, 90.0),
            "axes_deg": (90.0 - MOST_OFF_DEG, 90.0 + MOST_OFF_DEG),
            "cone_deg": (-MOST_OFF_DEG, MOST_OFF_DEG),
            "first_zero_deg": (-360.0, 360.0),
            "second_zero_deg": (-360.0, 360.0),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"geometry.{name} is {value:g}; it goes from {low:g} to {high:g}")
        if self.reports != "axes" and min(self.first_sense, self.second_sense) < 0:
            raise ValueError(
                f'geometry.reports is "{self.reports}": senses are of mounts that report the angles of their '
                "axes; ra_rate_sign and dec_rate_sign turn commanded rates"
            )

    @property
    def off_square_deg(self) -> float:
        """How far at most the tube points from where it would with square axes and no cone."""
        return abs(90.0 - self.axes_deg) + abs(self.cone_deg)

    @property
    def has_zeros(self) -> bool:
        """Whether the mount reports something else than where its axes point."""
        return self.first_zero_deg != 0.0 or self.second_zero_deg != 0.0

    @property
    def told_range_deg(self) -> tuple[float, float]:
        """From where to where the second angle is known: what is reported of it goes from -90 to 90°."""
        ends = (self.second_sense * (end - self.second_zero_deg) for end in (-90.0, 90.0))
        low, high = sorted(ends)
        return low, high

    @property
    def pole(self) -> Pole:
        """Where the first axis points."""
        return Pole(self.pole_azimuth_deg, self.pole_altitude_deg)

    @property
    def kind(self) -> str:
        """What such a mount is called."""
        return "alt-azimuth" if self.pole_altitude_deg > 90.0 - MOST_OFF_DEG else "two-axis"


class AxisAngles(NamedTuple):
    """Angles of both axes, degrees, and their rates, degrees a second."""

    first_deg: Any
    second_deg: Any
    first_rate_deg_s: Any
    second_rate_deg_s: Any


def _unit(azimuth_deg: float, altitude_deg: float) -> tuple[float, float, float]:
    """Return a unit vector east, north, up."""
    azimuth, altitude = math.radians(azimuth_deg), math.radians(altitude_deg)
    level = math.cos(altitude)
    return level * math.sin(azimuth), level * math.cos(azimuth), math.sin(altitude)


class AxisFrame:
    """One mount's axes at a latitude: hour angles and declinations to axis angles and back."""

    def __init__(self, geometry: AxisGeometry, latitude_deg: float) -> None:
        self.geometry, self._latitude_deg = geometry, latitude_deg
        # Each row is one of the mount's vectors, in hour angle and declination.
        self._rows = tuple(_in_hour_angle(vector, latitude_deg) for vector in geometry.pole.vectors)
        skew, cone = math.radians(90.0 - geometry.axes_deg), math.radians(geometry.cone_deg)
        self._cone, self._skew = (math.cos(cone), math.sin(cone)), (math.cos(skew), math.sin(skew))
        self._lifted = self._cone[1] * self._skew[1]
        self._lost2 = 1.0 - (self._cone[0] * self._skew[0]) ** 2 + self._lifted**2

    @property
    def horizon_latitude_deg(self) -> float:
        """The latitude at which an equatorial mount sees the horizon as this one does."""
        return self.geometry.pole_altitude_deg

    def angles(
        self,
        hour_angle_deg: Any,
        dec_deg: Any,
        hour_angle_rate_deg_s: Any = 0.0,
        dec_rate_deg_s: Any = 0.0,
        beyond: bool = False,
        fn: Any = math,
    ) -> AxisAngles:
        """Return the axis angles that point to a direction, and their rates; the first within half a turn.

        `beyond` gives the second solution, with the second axis past 90°. Where axes that are not square
        leave a hole about the pole, the second axis stands as near to the direction as it gets.
        """
        h, d = hour_angle_deg * (math.pi / 180.0), dec_deg * (math.pi / 180.0)
        cos_d, sin_d, cos_h, sin_h = fn.cos(d), fn.sin(d), fn.cos(h), fn.sin(h)
        u = (cos_d * cos_h, cos_d * sin_h, sin_d)
        west, up = cos_d * hour_angle_rate_deg_s, dec_rate_deg_s
        u_rate = (-sin_d * cos_h * up - sin_h * west, -sin_d * sin_h * up + cos_h * west, cos_d * up)
        x, y, z = (a * u[0] + b * u[1] + c * u[2] for a, b, c in self._rows)
        dx, dy, dz = (a * u_rate[0] + b * u_rate[1] + c * u_rate[2] for a, b, c in self._rows)
        side = -1.0 if beyond else 1.0
        across2 = x * x + y * y
        reach2 = across2 - self._lost2 + 2.0 * self._lifted * z
        reach = fn.sqrt(0.5 * (reach2 + abs(reach2)))
        second = fn.atan2(z - self._lifted, side * reach)
        second_rate = dz / (side * reach + side * 1e-12)
        first, first_rate = fn.atan2(y, x), (x * dy - y * dx) / (across2 + 1e-24)
        if self._cone[1] or self._skew[1] or beyond:
            (cos_c, sin_c), (cos_s, sin_s) = self._cone, self._skew
            sin_2, cos_2 = fn.sin(second), fn.cos(second)
            x0, y0 = cos_c * cos_2, sin_c * cos_s - cos_c * sin_2 * sin_s
            x0_by, y0_by = -cos_c * sin_2, -cos_c * cos_2 * sin_s
            first = first - fn.atan2(y0, x0)
            first_rate = first_rate - (x0 * y0_by - y0 * x0_by) / (x0 * x0 + y0 * y0 + 1e-24) * second_rate
        degrees = 180.0 / math.pi
        first = wrap180(first * degrees)
        second_deg = second * degrees
        if beyond:
            # Past the pole that is above the horizon, as `safety` counts it.
            pole = math.copysign(180.0, self.horizon_latitude_deg)
            second_deg = pole - (180.0 - second_deg + 180.0) % 360.0 + 180.0
        return AxisAngles(first, second_deg, first_rate, second_rate)

    def of_report(
        self,
        hour_angle_deg: Any,
        dec_deg: Any,
        hour_angle_rate_deg_s: Any = 0.0,
        dec_rate_deg_s: Any = 0.0,
        fn: Any = math,
    ) -> AxisAngles:
        """Return the axis angles that a mount means by what it reports, and their rates."""
        own = self.geometry
        if own.reports != "axes":
            told = self.angles(hour_angle_deg, dec_deg, hour_angle_rate_deg_s, dec_rate_deg_s, fn=fn)
            if not own.has_zeros:
                return told
            first = wrap180(told.first_deg - own.first_zero_deg)
            return told._replace(first_deg=first, second_deg=told.second_deg - own.second_zero_deg)
        return AxisAngles(
            own.first_sense * (hour_angle_deg - own.first_zero_deg),
            own.second_sense * (dec_deg - own.second_zero_deg),
            own.first_sense * hour_angle_rate_deg_s,
            own.second_sense * dec_rate_deg_s,
        )

    def reported(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return the hour angle and declination that the mount reports with its axes at these angles."""
        own = self.geometry
        if own.reports != "axes":
            return self.direction(first_deg + own.first_zero_deg, second_deg + own.second_zero_deg)
        return (
            own.first_sense * first_deg + own.first_zero_deg,
            own.second_sense * second_deg + own.second_zero_deg,
        )

    def aligned(self, direction_deg: tuple[float, float], reported_deg: tuple[float, float]) -> AxisGeometry:
        """Return the geometry with the zero points of a mount that looks there while it reports that.

        Both are hour angle and declination.
        """
        own, looks = self.geometry, self.angles(*direction_deg)
        told = self.of_report(*reported_deg)
        first_deg = math.remainder(
            own.first_zero_deg + own.first_sense * (told.first_deg - looks.first_deg), 360.0
        )
        second_deg = own.second_zero_deg + own.second_sense * (told.second_deg - looks.second_deg)
        return msgspec.structs.replace(own, first_zero_deg=first_deg, second_zero_deg=second_deg)

    def of_horizon(self, azimuth_deg: float, altitude_deg: float) -> tuple[float, float]:
        """Return hour angle (-180 to 180) and declination of an azimuth and an altitude."""
        return _hour_angle_and_dec(_in_hour_angle(_unit(azimuth_deg, altitude_deg), self._latitude_deg))

    @property
    def turns_field(self) -> bool:
        """Whether a camera on the tube turns on the sky: the first axis is not the celestial one."""
        return self.from_celestial_deg > STILL_FIELD_DEG

    @property
    def from_celestial_deg(self) -> float:
        """How far the first axis is from the Earth's, either end."""
        x, y, z = self._rows[2]
        return math.degrees(math.atan2(math.hypot(x, y), abs(z)))

    @property
    def square(self) -> AxisFrame:
        """The same with square axes and no cone: directions seen from the mount's own pole."""
        return AxisFrame(
            msgspec.structs.replace(self.geometry, axes_deg=90.0, cone_deg=0.0), self._latitude_deg
        )

    def direction(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return hour angle (-180 to 180) and declination to which axes of these angles point."""
        x, y, z = self._tube(first_deg, second_deg)
        return _hour_angle_and_dec(self._outward((x, y, z)))

    def sky(
        self, first_deg: float, second_deg: float, first_rate_deg_s: float, second_rate_deg_s: float
    ) -> tuple[float, float, float, float]:
        """Return hour angle and declination to which the axes point, and the rates of both."""
        before, here, after = (
            self.direction(first_deg + first_rate_deg_s * s, second_deg + second_rate_deg_s * s)
            for s in (-DIFFERENCE_S, 0.0, DIFFERENCE_S)
        )
        rates = (
            math.remainder(b - a, 360.0) / (2.0 * DIFFERENCE_S) for a, b in zip(before, after, strict=True)
        )
        hour_angle_rate, dec_rate = rates
        return *here, hour_angle_rate, dec_rate

    def field_angle_deg(self, first_deg: float, second_deg: float) -> float:
        """Return the position angle on the sky, north through east, in which growing second angles lead.

        A camera fixed to the tube turns by it: 0 for an equatorial mount on the normal side of its pier, 180
        beyond the pole. -180 to 180.
        """
        hour_angle, dec = (math.radians(angle) for angle in self.direction(first_deg, second_deg))
        step = 0.5
        above, below = (self._tube(first_deg, second_deg + sign * step) for sign in (1.0, -1.0))
        onward = self._outward(tuple(a - b for a, b in zip(above, below, strict=True)))
        north = (-math.sin(dec) * math.cos(hour_angle), -math.sin(dec) * math.sin(hour_angle), math.cos(dec))
        east = (math.sin(hour_angle), -math.cos(hour_angle), 0.0)
        return math.degrees(math.atan2(_dot(onward, east), _dot(onward, north)))

    def field_rate_deg_s(
        self, first_deg: float, second_deg: float, first_rate_deg_s: float, second_rate_deg_s: float
    ) -> float:
        """Return how fast `field_angle_deg` grows, degrees a second, while the axes turn at these rates."""
        before, after = (
            self.field_angle_deg(first_deg + first_rate_deg_s * s, second_deg + second_rate_deg_s * s)
            for s in (-RATE_OVER_S, RATE_OVER_S)
        )
        return math.remainder(after - before, 360.0) / (2.0 * RATE_OVER_S)

    def _tube(self, first_deg: float, second_deg: float) -> tuple[float, float, float]:
        """Return where the tube points, in the mount's own vectors."""
        (cos_c, sin_c), (cos_s, sin_s) = self._cone, self._skew
        first, second = math.radians(first_deg), math.radians(second_deg)
        x0 = cos_c * math.cos(second)
        y0 = sin_c * cos_s - cos_c * math.sin(second) * sin_s
        z0 = sin_c * sin_s + cos_c * math.sin(second) * cos_s
        c, s = math.cos(first), math.sin(first)
        return x0 * c - y0 * s, x0 * s + y0 * c, z0

    def _outward(self, own: tuple[float, ...]) -> tuple[float, float, float]:
        """Return one of the mount's vectors in hour angle and declination."""
        a, b, c = own
        x, y, z = (sum((p * a, q * b, r * c)) for p, q, r in zip(*self._rows, strict=True))
        return x, y, z


def _in_hour_angle(enu: tuple[float, float, float], latitude_deg: float) -> tuple[float, float, float]:
    """Return a vector east, north, up as (meridian on the equator, west, pole)."""
    east, north, up = enu
    c, s = math.cos(math.radians(latitude_deg)), math.sin(math.radians(latitude_deg))
    return up * c - north * s, -east, up * s + north * c


def _hour_angle_and_dec(vector: tuple[float, float, float]) -> tuple[float, float]:
    x, y, z = vector
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


def _dot(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))

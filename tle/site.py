"""A place on Earth, and where it is in the terrestrial frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from tle.errors import PackageError, SiteError

EARTH_RADIUS_KM = 6378.137
FLATTENING = 1.0 / 298.257223563
_LOWEST_M, _HIGHEST_M = -12000.0, 100000.0
LOWEST_GROUND_M, HIGHEST_GROUND_M = -500.0, 8900.0
"""No ground is lower than the Dead Sea's shore or higher than the highest summit, above the ellipsoid."""

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Site:
    """A place by WGS 84 latitude (north) and longitude (east) in degrees, and ellipsoidal height in metres.

    Longitudes of -180 to 360 are taken; both poles are sites, with east where the longitude says.
    Raises SiteError for anything else. `itrs_km` is its position, and `east`, `north`, `up` the unit
    vectors of its horizon, in the ITRS (WGS 84's own ellipsoid, NIMA TR8350.2).
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0
    itrs_km: Vector = field(init=False, repr=False, compare=False)
    east: Vector = field(init=False, repr=False, compare=False)
    north: Vector = field(init=False, repr=False, compare=False)
    up: Vector = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the three numbers and place the site."""
        _check("latitude_deg", self.latitude_deg, -90.0, 90.0, "degrees north")
        _check("longitude_deg", self.longitude_deg, -180.0, 360.0, "degrees east")
        _check("height_m", self.height_m, _LOWEST_M, _HIGHEST_M, "metres above the ellipsoid")
        phi, lam = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        sin_phi, cos_phi, sin_lam, cos_lam = math.sin(phi), math.cos(phi), math.sin(lam), math.cos(lam)
        e2 = FLATTENING * (2.0 - FLATTENING)
        normal_km = EARTH_RADIUS_KM / math.sqrt(1.0 - e2 * sin_phi * sin_phi)
        height_km = self.height_m / 1000.0
        axis_km = (normal_km + height_km) * cos_phi
        place = (axis_km * cos_lam, axis_km * sin_lam, (normal_km * (1.0 - e2) + height_km) * sin_phi)
        for name, vector in (
            ("itrs_km", place),
            ("east", (-sin_lam, cos_lam, 0.0)),
            ("north", (-sin_phi * cos_lam, -sin_phi * sin_lam, cos_phi)),
            ("up", (cos_phi * cos_lam, cos_phi * sin_lam, sin_phi)),
        ):
            object.__setattr__(self, name, vector)

    def to_astropy(self) -> Any:
        """Return the site as an astropy EarthLocation (WGS 84). Raises PackageError without astropy."""
        try:
            from astropy.coordinates import EarthLocation
        except ImportError:
            raise PackageError("astropy is not installed: pip install astropy") from None
        return EarthLocation.from_geodetic(self.longitude_deg, self.latitude_deg, self.height_m)

    @classmethod
    def parse(cls, text: str) -> Site:
        """Return the site on the ground of "LAT,LON" or "LAT,LON,HEIGHT". Raises SiteError."""
        parts = [part.strip() for part in text.split(",")]
        if len(parts) not in (2, 3):
            raise SiteError(f"{text!r} is no site: write LAT,LON,HEIGHT as 52.15,4.49,0")
        try:
            numbers = [float(part) for part in parts]
        except ValueError:
            raise SiteError(
                f"{text!r} is no site: LAT,LON,HEIGHT must be numbers, as 52.15,4.49,0; "
                "south and west are negative, without letters"
            ) from None
        return cls(*numbers).on_ground()

    def on_ground(self) -> Site:
        """Return the site itself; raises SiteError where no ground is so low or so high."""
        unit = "metres: no ground on Earth lies outside"
        _check("height_m", self.height_m, LOWEST_GROUND_M, HIGHEST_GROUND_M, unit)
        return self


def _check(field: str, value: float, least: float, most: float, unit: str) -> None:
    name = field.partition("_")[0]
    try:
        inside = least <= value <= most
    except TypeError:
        raise SiteError(f"the site's {name} is {value!r}: give a number, {unit}", field) from None
    if not inside:
        raise SiteError(f"the site's {name} of {value} is outside {least:.0f} to {most:.0f} {unit}", field)

"""skyfield's satellites, places, times and time scales as ours, and ours as skyfield's.

>>> from skyfield.api import EarthSatellite, wgs84                               # doctest: +SKIP
>>> seen = Propagator(from_skyfield(satellite), from_skyfield(wgs84.latlon(52.15, 4.49)))  # doctest: +SKIP

Elements, sites and instants pass over exactly, in both directions. How far directions agree depends on:

* UT1 and polar motion. skyfield's own `load.timescale()` has a coarse table of UT1 and no polar motion, which
  moves a low satellite by 10″ and more in 2026. With `to_skyfield(EarthOrientation.installed())` as the time
  scale, or with `from_skyfield(timescale)` as the Earth orientation here, both sides have the same.
* The kind of place. `(satellite - site).at(t)` of skyfield is geometric, without light time and aberration.
  That is `place="geometric"` here. The default, "apparent", has both, because a telescope must point there:
  2 to 5″ from the geometric place in low orbit.
* Refraction. `altaz("standard")` of skyfield and `tle.Refraction` are both Bennett's formula, 0.03′ apart for
  the same pressure and temperature, because skyfield rounds its constants.

With the same Earth orientation, geometric directions agree within 0.001″ and ranges within a centimetre. Both
use the package sgp4; nutation is from ERFA here, and skyfield's own there. Rates agree within 0.2″/s only:
skyfield's are made of SGP4's own velocities, which are not quite the derivatives of its positions.
"""

from __future__ import annotations

import re
from functools import lru_cache

import numpy as np
from skyfield.api import EarthSatellite, load, wgs84
from skyfield.timelib import Time, Timescale
from skyfield.toposlib import GeographicPosition

from tle.earth import FIRST_MJD, EarthOrientation, Orientation
from tle.elements import DEG, RADIUS_KM, REV_DAY_PER_RAD_MIN, Elements, format_alpha5
from tle.errors import ElementsError, SiteError, UnwritableError
from tle.instants import (
    DAY_S,
    MJD_JD,
    TT_MINUS_TAI_S,
    UNIX_EPOCH_JD,
    UNIX_EPOCH_MJD,
    Utc,
    as_utc,
    tai_minus_utc_s,
)
from tle.site import Site

__all__ = ["from_skyfield", "to_skyfield"]


def __dir__() -> list[str]:
    """Show what the module offers, not what it imports."""
    return __all__


_DESIGNATOR = re.compile(r"(\d\d)?(\d\d)-?(\d{3}[A-Z]{1,3})", re.ASCII)
# Where directions end, and with them what is asked of a table.
_END = Utc.parse("2057-01-01")


def from_skyfield(
    thing: EarthSatellite | GeographicPosition | Time | Timescale,
) -> Elements | Site | Utc | EarthOrientation:
    """Return an object of skyfield as ours.

    An EarthSatellite becomes Elements, a place of `wgs84` a Site, a Time a Utc, and a Timescale the Earth
    orientation with its UT1 (day by day, linear between) and its polar motion.
    Raises ElementsError for a satellite that is not in SGP4's improved mode with WGS 72, SiteError for a
    place on another ellipsoid than WGS 84, TypeError for anything else.
    """
    if isinstance(thing, EarthSatellite):
        return _elements(thing)
    if isinstance(thing, GeographicPosition):
        if thing.model is not wgs84 and thing.model.name != wgs84.name:
            raise SiteError(f"{thing.model.name} is another ellipsoid: give the place by wgs84.latlon")
        return Site(float(thing.latitude.degrees), float(thing.longitude.degrees), float(thing.elevation.m))
    if isinstance(thing, Time):
        return as_utc(thing)
    if isinstance(thing, Timescale):
        return EarthOrientation(_TimescaleTable(thing))
    raise TypeError(f"{thing!r} is no EarthSatellite, place, Time or Timescale of skyfield")


def to_skyfield(
    thing: Elements | Site | Utc | EarthOrientation, timescale: Timescale | None = None
) -> EarthSatellite | GeographicPosition | Time | Timescale:
    """Return an object of ours as skyfield's: the inverse of `from_skyfield`.

    Satellites and times have the given Timescale; without one, that of the installed Earth orientation.
    Raises UnwritableError for a catalogue number above 339999, which SGP4's record cannot hold,
    PropagationError where SGP4 refuses the elements, TypeError for anything else.
    """
    if isinstance(thing, Elements):
        return _satellite(thing, timescale or _timescale(EarthOrientation.installed()))
    if isinstance(thing, Site):
        return wgs84.latlon(thing.latitude_deg, thing.longitude_deg, elevation_m=thing.height_m)
    if isinstance(thing, Utc):
        days, fraction = thing.split()
        offset_s = tai_minus_utc_s(days - MJD_JD) + TT_MINUS_TAI_S
        scale = timescale or _timescale(EarthOrientation.installed())
        return scale.tt_jd(days, fraction + offset_s / DAY_S)
    if isinstance(thing, EarthOrientation):
        return _timescale(thing)
    raise TypeError(f"{thing!r} is no Elements, Site, Utc or EarthOrientation")


def _elements(satellite: EarthSatellite) -> Elements:
    """Return the elements in SGP4's record of a satellite; angles as the short decimals they were made of."""
    model = satellite.model
    label = f"{satellite.name or model.satnum}"
    if model.radiusearthkm != RADIUS_KM or model.operationmode != "i":
        raise ElementsError(
            f"{label} is not set up as element sets are meant, for SGP4's improved mode with WGS 72: "
            "make it by EarthSatellite(line1, line2) or EarthSatellite.from_omm"
        )
    epoch_s = (model.jdsatepoch - UNIX_EPOCH_JD) * DAY_S + model.jdsatepochF * DAY_S
    return Elements(
        name=satellite.name or "",
        catalog_number=model.satnum,
        classification=model.classification or "U",
        designator=_designator(model.intldesg or ""),
        epoch=Utc(epoch_s),
        inclination_deg=_short(model.inclo, DEG),
        raan_deg=_short(model.nodeo, DEG),
        eccentricity=model.ecco,
        arg_perigee_deg=_short(model.argpo, DEG),
        mean_anomaly_deg=_short(model.mo, DEG),
        mean_motion_rev_day=_short(model.no_kozai, 1.0 / REV_DAY_PER_RAD_MIN),
        mean_motion_dot_rev_day2=_short(model.ndot, 1.0 / (REV_DAY_PER_RAD_MIN * 1440.0)),
        mean_motion_ddot_rev_day3=_short(model.nddot, 1.0 / (REV_DAY_PER_RAD_MIN * 1440.0 * 1440.0)),
        bstar_per_earth_radius=model.bstar,
        ephemeris_type=int(model.ephtype or 0),
        element_set_number=model.elnum,
        revolution_number=model.revnum,
    )


def _satellite(elements: Elements, timescale: Timescale) -> EarthSatellite:
    number = format_alpha5(elements.catalog_number)
    if number is None:
        raise UnwritableError(
            f"{elements.label}: the number {elements.catalog_number} is above 339999, where the Alpha-5 "
            "numbers of SGP4's record end: give the elements another number"
        )
    record = elements.satrec()
    record.satnum_str = number
    record.classification = elements.classification
    record.intldesg = elements.designator[2:].replace("-", "")
    record.ephtype = elements.ephemeris_type
    record.elnum = elements.element_set_number
    record.revnum = elements.revolution_number
    satellite = EarthSatellite.from_satrec(record, timescale)
    satellite.name = elements.name or None
    return satellite


def _designator(text: str) -> str:
    """Return "1998-067A" for that, or for a TLE's "98067A"; other text as it is."""
    match = _DESIGNATOR.fullmatch(text.strip())
    if match is None:
        return text.strip()
    century = match.group(1) or ("19" if match.group(2) >= "57" else "20")
    return f"{century}{match.group(2)}-{match.group(3)}"


def _short(value: float, unit: float) -> float:
    """Return a value in a unit, as the shortest decimal that leads back to the value to the last bit."""
    exact = value / unit
    for digits in range(17):
        rounded = float(f"{exact:.{digits}e}")
        if rounded * unit == value or rounded / (1.0 / unit) == value:
            return rounded
    return exact


@lru_cache(maxsize=4)
def _timescale(earth: EarthOrientation) -> Timescale:
    """Return a time scale with this UT1 and polar motion day by day, and skyfield's own leap seconds."""
    builtin = load.timescale(builtin=True)
    until = earth.age(_END).predicted_until or _END
    days = np.arange(float(FIRST_MJD), UNIX_EPOCH_MJD + until.unix_s // DAY_S)
    each = [earth.orientation(Utc((day - UNIX_EPOCH_MJD) * DAY_S)) for day in days.tolist()]
    tt_minus_utc_s = tai_minus_utc_s(days) + TT_MINUS_TAI_S
    tt = days + MJD_JD + tt_minus_utc_s / DAY_S
    delta_t_s = tt_minus_utc_s - np.array([one.dut1_s for one in each])
    timescale = Timescale((tt, delta_t_s), builtin.leap_dates, builtin.leap_offsets)
    pole = np.array([(one.xp_arcsec, one.yp_arcsec) for one in each])
    timescale.polar_motion_table = (tt, pole[:, 0], pole[:, 1])
    return timescale


class _TimescaleTable:
    """UT1 and polar motion of a Timescale by day; how good they are it does not know."""

    last_observed_mjd = None
    last_mjd = UNIX_EPOCH_MJD + int(_END.unix_s // DAY_S)

    def __init__(self, timescale: Timescale) -> None:
        self._timescale = timescale

    def day(self, mjd: int) -> Orientation:
        """Return the orientation at 0h UTC of a day."""
        tt_minus_utc_s = tai_minus_utc_s(mjd) + TT_MINUS_TAI_S
        tt = mjd + MJD_JD + tt_minus_utc_s / DAY_S
        xp_arcsec = yp_arcsec = 0.0
        if self._timescale.polar_motion_table is not None:
            at, x, y = self._timescale.polar_motion_table
            xp_arcsec, yp_arcsec = float(np.interp(tt, at, x)), float(np.interp(tt, at, y))
        return Orientation(
            mjd, tt_minus_utc_s - float(self._timescale.delta_t_function(tt)), xp_arcsec, yp_arcsec
        )

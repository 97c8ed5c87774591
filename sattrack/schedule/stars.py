"""Bright stars by name, to point at before and after passes: ICRS at J2000.0, by Hipparcos (SIMBAD)."""

from __future__ import annotations

import math
from typing import NamedTuple

import erfa

_UNIX_EPOCH_JD = 2440587.5
_DAY_S = 86400.0
_TT_MINUS_UTC_S = 69.184
_MAS_RAD = math.radians(1.0 / 3.6e6)


class Star(NamedTuple):
    """Right ascension and declination, degrees; proper motions, mas a year, that in RA times cos Dec."""

    ra_deg: float
    dec_deg: float
    pm_ra_mas: float
    pm_dec_mas: float


def _star(ra: str, dec: str, pm_ra_mas: float, pm_dec_mas: float) -> Star:
    hours, minutes, seconds = (float(part) for part in ra.split())
    degrees, arcmin, arcsec = (float(part) for part in dec[1:].split())
    size = degrees + arcmin / 60.0 + arcsec / 3600.0
    return Star(
        15.0 * (hours + minutes / 60.0 + seconds / 3600.0),
        -size if dec[0] == "-" else size,
        pm_ra_mas,
        pm_dec_mas,
    )


STARS = {
    "Aldebaran": _star("04 35 55.239", "+16 30 33.49", 63.45, -188.94),
    "Alkaid": _star("13 47 32.438", "+49 18 47.76", -121.17, -14.91),
    "Alphard": _star("09 27 35.243", "-08 39 30.96", -15.23, 34.37),
    "Alpheratz": _star("00 08 23.260", "+29 05 25.55", 137.46, -163.44),
    "Altair": _star("19 50 46.999", "+08 52 05.96", 536.23, 385.29),
    "Antares": _star("16 29 24.460", "-26 25 55.21", -12.11, -23.30),
    "Arcturus": _star("14 15 39.672", "+19 10 56.67", -1093.39, -2000.06),
    "Betelgeuse": _star("05 55 10.305", "+07 24 25.43", 27.54, 11.30),
    "Capella": _star("05 16 41.359", "+45 59 52.77", 75.25, -426.89),
    "Caph": _star("00 09 10.685", "+59 08 59.21", 523.50, -179.77),
    "Castor": _star("07 34 35.873", "+31 53 17.82", -191.45, -145.19),
    "Deneb": _star("20 41 25.915", "+45 16 49.22", 2.01, 1.85),
    "Denebola": _star("11 49 03.578", "+14 34 19.41", -497.68, -114.67),
    "Diphda": _star("00 43 35.371", "-17 59 11.78", 232.55, 31.99),
    "Dubhe": _star("11 03 43.672", "+61 45 03.72", -134.11, -34.70),
    "Eltanin": _star("17 56 36.370", "+51 29 20.02", -8.48, -22.79),
    "Enif": _star("21 44 11.156", "+09 52 30.03", 26.92, 0.44),
    "Hamal": _star("02 07 10.406", "+23 27 44.70", 188.55, -148.08),
    "Kochab": _star("14 50 42.326", "+74 09 19.81", -32.61, 11.42),
    "Menkar": _star("03 02 16.773", "+04 05 23.06", -10.41, -76.85),
    "Menkent": _star("14 06 40.948", "-36 22 11.84", -520.53, -518.06),
    "Mirach": _star("01 09 43.924", "+35 37 14.01", 175.90, -112.20),
    "Mirfak": _star("03 24 19.370", "+49 51 40.25", 23.75, -26.23),
    "Polaris": _star("02 31 49.095", "+89 15 50.79", 44.48, -11.85),
    "Pollux": _star("07 45 18.950", "+28 01 34.32", -626.55, -45.80),
    "Procyon": _star("07 39 18.120", "+05 13 29.96", -714.59, -1036.80),
    "Regulus": _star("10 08 22.311", "+11 58 01.95", -248.73, 5.59),
    "Rigel": _star("05 14 32.272", "-08 12 05.90", 1.31, 0.50),
    "Scheat": _star("23 03 46.457", "+28 04 58.03", 187.65, 136.93),
    "Sirius": _star("06 45 08.917", "-16 42 58.02", -546.01, -1223.07),
    "Spica": _star("13 25 11.579", "-11 09 40.75", -42.35, -30.67),
    "Vega": _star("18 36 56.336", "+38 47 01.28", 200.94, 286.23),
}


def find_star(name: str) -> Star | None:
    """Return a star by its name, whatever the case; None where it is not known."""
    return next((star for known, star in STARS.items() if known.casefold() == name.strip().casefold()), None)


def hour_angle_and_dec_deg(star: Star, utc_s: float, longitude_deg: float) -> tuple[float, float]:
    """Return where a star stands, apparent place of date, geocentric: hour angle (-180 to 180), declination.

    To some arcseconds: UT1 is taken as UTC, and parallax left out.
    """
    day = _UNIX_EPOCH_JD + utc_s / _DAY_S
    ra, dec = math.radians(star.ra_deg), math.radians(star.dec_deg)
    pm_ra = star.pm_ra_mas * _MAS_RAD / math.cos(dec)
    ri, di, _ = erfa.atci13(
        ra, dec, pm_ra, star.pm_dec_mas * _MAS_RAD, 0.0, 0.0, day, _TT_MINUS_UTC_S / _DAY_S
    )
    turned = math.degrees(erfa.era00(day, 0.0) - float(ri)) + longitude_deg
    return (turned + 180.0) % 360.0 - 180.0, math.degrees(float(di))

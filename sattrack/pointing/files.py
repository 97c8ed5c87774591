"""Pointing models and pointing stars as text in TPOINT's layouts. No I/O.

A file of stars: a caption; option lines that begin with a colon (`:EQUAT`, `:NODA`); the run's parameters
(latitude as degrees, minutes and seconds; year, month, day; °C, hPa, metres); then a line for each star:
right ascension and declination (J2000, sexagesimal), proper motions, 2000.0, the mount's right ascension and
declination, and the sidereal time in hours and minutes. A declination beyond 90° is past the pole. Of an
azimuth mount (`:ALTAZ`) the mount's azimuth and altitude stand there instead, both in degrees; of one with
another pole what it reports as right ascension and declination. `END` ends it; `!` begins a comment. As
rts2-tpm of RTS2 writes it (its source, src/db/tpm.cpp).

A model: a caption; method, number of stars, RMS, two refraction constants; a term, its value and its sigma a
line, arcseconds; `END`. As RTS2 reads it (lib/rts2tel/tpointmodel.cpp).
"""

from __future__ import annotations

import math
from datetime import date
from typing import TYPE_CHECKING, NamedTuple

import erfa

from sattrack.core.angles import altitude_deg, azimuth_deg
from sattrack.core.errors import BadInputError
from sattrack.mount.geometry import Pole
from sattrack.pointing.fit import Star
from tle.errors import RefractionError
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sattrack.mount.model import PointingTerms
    from sattrack.pointing.terms import Axes

END = "END"
_NOON = 0.5
_ROUNDS = 5
_LARGEST = 1e6
_FIRST_YEAR = 1960


class RunParameters(NamedTuple):
    """Where and in what air stars were measured; a pressure of 0 bends nothing. `date` is year-month-day."""

    latitude_deg: float
    date: str
    temperature_c: float
    pressure_hpa: float
    height_m: float


def stars_head(caption: str, run: RunParameters, axes: Axes = "equatorial") -> str:
    """Return what a file of stars begins with."""
    kind = ":ALTAZ" if axes == "altaz" else ":EQUAT"
    latitude, date = _sexagesimal(run.latitude_deg, 1), " ".join(run.date.split("-"))
    return (
        f"{_one_line(caption)}\n{kind}\n:NODA\n {latitude} {date} "
        f"{run.temperature_c:.1f} {run.pressure_hpa:.1f} {run.height_m:.1f}\n"
    )


def star_line(star: Star, axes: Axes = "equatorial") -> str:
    """Return the line of a star."""
    ra, dec = star.icrs_deg
    first = (star.sidereal_deg - star.axis_hour_angle_deg) % 360.0 / 15.0
    if axes == "altaz":
        first = star.axis_hour_angle_deg % 360.0
    minutes = star.sidereal_deg % 360.0 * 4.0
    return (
        f" {_sexagesimal(ra / 15.0, 5)} {_sexagesimal(dec, 4, sign=True)} 0 0 2000.0 "
        f"{_sexagesimal(first, 5)} {_sexagesimal(star.axis_dec_deg, 4, sign=True)} "
        f"{int(minutes // 60.0):02d} {minutes % 60.0:010.7f}\n"
    )


def read_stars(text: str, where: str, axes: Axes = "equatorial") -> tuple[RunParameters, list[Star]]:
    """Return what a file of stars holds, in its order; one without END was cut off, and is as good.

    Raises BadInputError, naming the line and what was expected there, or where the mount has other axes.
    """
    kind = "ALTAZ" if axes == "altaz" else "EQUAT"
    lines = _lines(text, where)
    options = []
    run = None
    stars: list[Star] = []
    for number, line in lines:
        if line.startswith(":"):
            options += [word.upper() for word in line[1:].split()[:1]]
            continue
        if line.upper() == END:
            break
        at = f"{where}:{number}"
        if run is None:
            if not {"EQUAT", "ALTAZ"} & set(options):
                raise BadInputError(f"{where}: it is no file of stars: `sattrack star-run --data` writes one")
            if kind not in options:
                other = "two-axis" if isinstance(axes, Pole) else axes.replace("altaz", "alt-azimuth")
                raise BadInputError(
                    f"{where}: it has no :{kind}, and the profile's mount is {other}: it is another mount's"
                )
            if "J2000" in options:
                raise BadInputError(
                    f"{where}: by its :J2000 the mount's places are of J2000: write those of date, without it"
                )
            run = _run(line, at)
        else:
            stars.append(_star(line, at, run, axes))
    if run is None:
        raise BadInputError(f"{where}: it ends before the latitude, the date and the air of its stars")
    return run, stars


def model_text(terms: PointingTerms, caption: str) -> str:
    """Return a model as a file; the caption says about which pole of the mount's own its terms are."""
    if isinstance(pole := terms.axes, Pole):
        caption = (
            f"{caption}, pole at azimuth {pole.pole_azimuth_deg:g}, altitude {pole.pole_altitude_deg:g},"
        )
    head = f"{_one_line(caption)} {terms.utc}\nT {terms.stars:5d} {terms.rms_arcsec:9.4f} 0.0 0.0\n"
    rows = [f"  {name:<9}{value:12.4f}{sigma:11.5f}\n" for name, (value, sigma) in terms.terms.items()]
    return head + "".join(rows) + END + "\n"


def _lines(text: str, where: str) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines after the caption that say something."""
    captioned = False
    for number, line in enumerate(text.splitlines(), 1):
        plain = line.split("!")[0].strip()
        if not plain:
            continue
        if captioned:
            yield number, plain
        captioned = True
    if not captioned:
        raise BadInputError(f"{where}: it is empty")


def _run(line: str, at: str) -> RunParameters:
    words = line.split()
    try:
        degrees, minutes, seconds = words[0], _number(words[1]), _number(words[2])
        latitude = abs(_number(degrees)) + minutes / 60.0 + seconds / 3600.0
        latitude = -latitude if degrees.startswith("-") else latitude
        year, month, day = (int(_number(word)) for word in words[3:6])
        utc = date(year, month, day)
        if utc.year < _FIRST_YEAR:
            raise ValueError(f"UTC begins with {_FIRST_YEAR}")
        temperature, pressure, height = (_number(word) for word in words[6:9])
        Refraction(pressure, temperature)
    except (ValueError, IndexError, RefractionError) as error:
        raise BadInputError(
            f"{at}: {line!r}: here stand latitude (d m s), year, month, day, °C, hPa and metres ({error})"
        ) from None
    if not abs(latitude) <= 90.0:
        raise BadInputError(f"{at}: a latitude of {latitude:g}° is none")
    return RunParameters(latitude, utc.isoformat(), temperature, pressure, height)


def _star(line: str, at: str, run: RunParameters, axes: Axes) -> Star:
    words = line.split()
    try:
        ra, dec = 15.0 * _angle(words[0:3]), _angle(words[3:6])
        pm_ra, pm_dec, epoch = (_number(word) for word in words[6:9])
        mount_first, mount_dec = _angle(words[9:12]), _angle(words[12:15])
        sidereal = 15.0 * (_number(words[15]) + _number(words[16]) / 60.0)
    except (ValueError, IndexError):
        raise BadInputError(
            f"{at}: {line!r}: here stand a star's RA and Dec, proper motions, 2000.0, the mount's RA and "
            "Dec, and the sidereal time (h m)"
        ) from None
    if epoch != 2000.0 or pm_ra or pm_dec:
        raise BadInputError(f"{at}: give places of J2000 with proper motions of 0, at the date of the run")
    if not abs(dec) <= 90.0 or not abs(mount_dec) <= 270.0:
        raise BadInputError(f"{at}: a declination of {dec if abs(dec) > 90.0 else mount_dec:g}° is none")
    hour_angle, seen_dec = observed(ra, dec, sidereal, run)
    if axes == "altaz":
        at_deg = hour_angle, seen_dec, run.latitude_deg
        return Star(azimuth_deg(*at_deg), altitude_deg(*at_deg), mount_first, mount_dec, (ra, dec), sidereal)
    axis = math.remainder(sidereal - 15.0 * mount_first, 360.0)
    return Star(hour_angle, seen_dec, axis, mount_dec, (ra, dec), sidereal)


def observed(ra_deg: float, dec_deg: float, sidereal_deg: float, run: RunParameters) -> tuple[float, float]:
    """Return hour angle and declination at which a direction of the ICRS is seen, refracted, by ERFA."""
    radians, latitude = (math.radians(ra_deg), math.radians(dec_deg)), math.radians(run.latitude_deg)
    azimuth, zenith, hour_angle, dec, *_ = (
        float(one) for one in erfa.ufunc.atco13(*radians, 0.0, 0.0, 0.0, 0.0, *_moment(sidereal_deg, run))
    )
    if run.pressure_hpa <= 0.0:
        return math.degrees(hour_angle), math.degrees(dec)
    true = 90.0 - math.degrees(zenith)
    bend = float(Refraction(run.pressure_hpa, run.temperature_c).bend_deg(true)[0])
    hour_angle, dec = (float(one) for one in erfa.ae2hd(azimuth, math.radians(true + bend), latitude))
    return math.degrees(hour_angle), math.degrees(dec)


def at_date(star: Star, run: RunParameters, axes: Axes = "equatorial") -> Star:
    """Return a star with the direction of the ICRS that is seen where it was, but at the date of a run.

    A file has one date: by its own direction a star that was measured a week later is 2 arcseconds off there.
    """
    first, second, latitude = *(math.radians(one) for one in star[:2]), math.radians(run.latitude_deg)
    azimuth, altitude = (first, second) if axes == "altaz" else erfa.hd2ae(first, second, latitude)
    seen = true = math.degrees(float(altitude))
    if run.pressure_hpa > 0.0:
        air = Refraction(run.pressure_hpa, run.temperature_c)
        for _ in range(_ROUNDS):
            true = seen - float(air.bend_deg(true)[0])
    moment = _moment(star.sidereal_deg, run)
    ra, dec, _ = erfa.ufunc.atoc13("A", float(azimuth), math.radians(90.0 - true), *moment)
    return star._replace(icrs_deg=(math.degrees(float(ra)) % 360.0, math.degrees(float(dec))))


def _moment(sidereal_deg: float, run: RunParameters) -> tuple[float, ...]:
    """Return what ERFA asks of noon at the date of a run, and of where the sidereal time is such; no air."""
    year, month, day = (int(word) for word in run.date.split("-"))
    first, second = erfa.cal2jd(year, month, day)
    second += _NOON
    longitude = math.radians(sidereal_deg) - float(erfa.gst06a(first, second, first, second))
    place = (longitude, math.radians(run.latitude_deg), run.height_m, 0.0, 0.0)
    return (first, second, 0.0, *place, 0.0, 0.0, 0.0, 0.55)


def _number(word: str) -> float:
    """Return a number that can stand in such a file. Raises ValueError."""
    value = float(word)
    if not abs(value) <= _LARGEST:
        raise ValueError(f"{word!r} is out of range")
    return value


def _angle(words: Sequence[str]) -> float:
    """Return the value of three words: degrees or hours, minutes, seconds."""
    whole, minutes, seconds = words
    if not (0.0 <= float(minutes) < 60.0 and 0.0 <= float(seconds) < 60.0001):
        raise ValueError
    value = abs(_number(whole)) + float(minutes) / 60.0 + float(seconds) / 3600.0
    return -value if whole.startswith("-") else value


def _sexagesimal(value: float, places: int, sign: bool = False) -> str:
    unit = 10**places
    count = round(abs(value) * 3600.0 * unit)
    whole, rest = divmod(count, 3600 * unit)
    minutes, seconds = divmod(rest, 60 * unit)
    before = "-" if value < 0.0 else "+" if sign else ""
    return f"{before}{whole:02d} {minutes:02d} {seconds / unit:0{places + 3}.{places}f}"


def _one_line(caption: str) -> str:
    return " ".join(caption.replace("!", " ").split())[:70] or "pointing"

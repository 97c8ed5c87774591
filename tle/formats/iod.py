"""Observations in the IOD format of satellite observers (G. Lewis, 1998, clarified 2002); RA and Dec only."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tle.errors import ObservationError, TimeFormatError
from tle.instants import Utc
from tle.observations import Observation, Stations, placed, site_of

if TYPE_CHECKING:
    from tle.residuals import Frame

_LINE = re.compile(r"[ 0-9]{5} [ 0-9]{2} [ 0-9]{3}[ A-Z]{3} \d{4} [A-Z ] \d{8}", re.ASCII)
_HAS_POSITION = 47
# Angle formats: sexagesimal places of RA and Dec, and the unit of the uncertainty in arcsec.
_FORMATS = {
    "1": ("HHMMSSs", "DDMMSS", 1.0),
    "2": ("HHMMmmm", "DDMMmm", 60.0),
    "3": ("HHMMmmm", "DDdddd", 3600.0),
    "7": ("HHMMSSs", "DDdddd", 3600.0),
}
_UNITS = {"H": 15.0, "D": 1.0}
_EPOCHS: dict[str, Frame] = {" ": "of_date", "0": "of_date", "5": "j2000"}


def looks_like_iod(text: str) -> bool:
    """Tell whether any line of a text is an observation of this format."""
    return any(_LINE.match(line) for line in text.splitlines())


def parse_text(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the observations with a position; lines of station status and brightness alone are skipped.

    Lines that are not of the format, as the mail around them, are skipped too. Raises ObservationError.
    """
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if _LINE.match(line) and line[_HAS_POSITION:54].strip():
            found.append(_observation(line, stations, source, number))
    return found


def _observation(line: str, stations: Stations, source: str, number: int) -> Observation:
    def wrong(reason: str) -> ObservationError:
        return ObservationError(placed(source, number, reason))

    code, epoch = line[44:45], line[45:46]
    if code not in _FORMATS:
        raise wrong(f"angle format {code!r} is none of 1, 2, 3, 7: only RA and Dec can be read")
    if epoch not in _EPOCHS:
        raise wrong(f"epoch code {epoch!r} is none of 0 (of date), 5 (J2000): convert the directions first")
    ra_places, dec_places, unit_arcsec = _FORMATS[code]
    ra_deg = _angle(line[47:54], ra_places)
    dec_deg = _angle(line[55:61], dec_places)
    sign = line[54:55]
    if ra_deg is None or dec_deg is None or sign not in ("+", "-"):
        raise wrong(f"{line[47:61]!r} is no {ra_places}±{dec_places}")
    try:
        utc = _time(line[23:40])
    except TimeFormatError as error:
        raise wrong(str(error)) from None
    year = line[6:8].strip()
    designator = f"{year}{line[9:15].strip()}" if year else ""
    sigma_arcsec, sigma_time_s = _uncertainty(line[62:64]), _uncertainty(line[41:43])
    return Observation(
        utc,
        ra_deg,
        -dec_deg if sign == "-" else dec_deg,
        _EPOCHS[epoch],
        site_of(stations, line[16:20], source, number),
        line[0:5].strip().lstrip("0") or designator,
        None if sigma_arcsec is None else sigma_arcsec * unit_arcsec,
        sigma_time_s,
        source,
        number,
    )


def _time(field: str) -> Utc:
    text = field.ljust(17).replace(" ", "0")
    if not re.fullmatch(r"\d{17}", text, re.ASCII):
        raise TimeFormatError(f"{field!r} is no YYYYMMDDHHMMSSsss")
    date = f"{text[:4]}-{text[4:6]}-{text[6:8]}"
    return Utc.parse(f"{date}T{text[8:10]}:{text[10:12]}:{text[12:14]}.{text[14:]}Z")


def _angle(field: str, places: str) -> float | None:
    """Return degrees of digits whose meaning `places` gives letter by letter; blanks at the end are zeros."""
    text = field.ljust(len(places)).rstrip().ljust(len(places), "0")
    if not re.fullmatch(r"\d+", text, re.ASCII):
        return None
    value = float(text[:2])
    rest = places[2:]
    if rest.startswith("d"):
        value += float(f"0.{text[2:]}")
    elif rest.startswith("MMm"):
        value += float(f"{text[2:4]}.{text[4:]}") / 60.0
    else:
        value += float(text[2:4]) / 60.0 + float(f"{text[4:6]}.{text[6:] or 0}") / 3600.0
    return value * _UNITS[places[0]]


def _uncertainty(field: str) -> float | None:
    """Return the number that MX stands for: M times ten to the power of X - 8."""
    if not re.fullmatch(r"\d\d", field, re.ASCII):
        return None
    return float(int(field[0]) * 10.0 ** (int(field[1]) - 8))

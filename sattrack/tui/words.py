"""Numbers and instants as people read them: pure functions from quantities to short text."""

from __future__ import annotations

import math

from rich.cells import cell_len, set_cell_size

from tle.instants import Utc

MINUS = "\N{MINUS SIGN}"
NOTHING = "–"
ARCSEC_PER_DEG = 3600.0
HOUR_S = 3600.0
DAY_S = 86400.0
CARDINALS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


def signed(value: float, decimals: int) -> str:
    """Return a number with its sign always shown and a true minus, so that columns do not jump."""
    text = f"{value:+.{decimals}f}"
    if float(text) == 0.0:
        text = f"+{abs(float(text)):.{decimals}f}"
    return text.replace("-", MINUS)


def arcsec_parts(arcsec: float) -> tuple[str, str]:
    """Return an unsigned angle as digits and the unit that fits: arcseconds, minutes or degrees."""
    size = abs(arcsec)
    if size < 9.995:
        return f"{size:.2f}", "″"
    if size < 99.95:
        return f"{size:.1f}", "″"
    if size < 599.5:
        return f"{size:.0f}", "″"
    if size < ARCSEC_PER_DEG:
        return f"{size / 60.0:.1f}", "′"
    return f"{size / ARCSEC_PER_DEG:.1f}", "°"


def arcsec(value: float | None, sign: bool = False) -> str:
    """Return an angle of arcseconds with its unit; a dash for none."""
    if value is None:
        return NOTHING
    digits, unit = arcsec_parts(value)
    if not sign:
        return digits + unit
    below = value < 0.0 and float(digits) != 0.0
    return (MINUS if below else "+") + digits + unit


def clock(utc_s: float) -> str:
    """Return the time of day of an instant, UTC, to the second."""
    return Utc(math.floor(utc_s)).isoformat("seconds")[11:19]


def date(utc_s: float) -> str:
    """Return the date of an instant, UTC."""
    return Utc(math.floor(utc_s)).isoformat("seconds")[:10]


def span(seconds: float) -> str:
    """Return a length of time: `0:07`, `12:34`, `3:05:12`, `2 d 4 h`."""
    whole = math.floor(abs(seconds))
    if whole < HOUR_S:
        return f"{whole // 60}:{whole % 60:02d}"
    minutes = whole // 60
    if whole < DAY_S:
        return f"{minutes // 60}:{minutes % 60:02d}:{whole % 60:02d}"
    return f"{minutes // 1440} d {minutes // 60 % 24} h"


def age(seconds: float) -> str:
    """Return an age as text; a negative one, of something that lies ahead, says so."""
    size = abs(seconds)
    if size < HOUR_S:
        text = f"{size / 60.0:.0f} min"
    elif size < 2.0 * DAY_S:
        text = f"{size / HOUR_S:.1f} h"
    else:
        text = f"{size / DAY_S:.1f} days"
    return text if seconds >= 0.0 else f"{text} ahead"


def right_ascension(degrees: float) -> str:
    """Return a right ascension as `12h 34m 56.7s`."""
    tenths = round(degrees % 360.0 / 15.0 * 36000.0) % 864000
    return f"{tenths // 36000:02d}h {tenths // 600 % 60:02d}m {tenths % 600 / 10.0:04.1f}s"


def declination(degrees: float) -> str:
    """Return a declination as `+12° 34′ 56″`."""
    whole = round(abs(degrees) * ARCSEC_PER_DEG)
    sign = MINUS if degrees < 0.0 and whole else "+"
    return f"{sign}{whole // 3600:02d}° {whole // 60 % 60:02d}′ {whole % 60:02d}″"


def azimuth(degrees: float) -> str:
    """Return an azimuth with its direction's name."""
    turned = degrees % 360.0
    return f"{turned:.1f}° {CARDINALS[round(turned / 45.0) % 8]}"


def gauge(share: float, cells: int, mark: float | None = None) -> str:
    """Return a bar of a share between 0 and 1; `mark` is a share at which a stroke stands across it."""
    full = min(cells, max(0, round(abs(share) * cells)))
    bar = "█" * full + "·" * (cells - full)
    if full == 0 and share != 0.0:
        bar = "▏" + bar[1:]
    if mark is None:
        return bar
    at = min(cells - 1, max(0, round(abs(mark) * cells)))
    return f"{bar[:at]}┃{bar[at + 1 :]}"


def iso_clock(utc: str | None) -> str:
    """Return the time of day of an instant in ISO 8601; a dash for none."""
    return NOTHING if utc is None else clock(float(Utc.parse(utc).unix_s))


def within(text: str, plain: bool = False) -> str:
    """Return a size as one either way; ASCII needs two characters for that."""
    return f"+-{text}" if plain else f"±{text}"


def fitted(text: str, cells: int) -> str:
    """Return a text that takes just so many cells: filled up with spaces, or cut, which is shown."""
    return set_cell_size(text, cells) if cell_len(text) <= cells else set_cell_size(text, cells - 1) + "…"

"""A frame, and what the files of capture programs say of when it was exposed. No I/O.

Whatever a source calls them, the pixels of a frame lie as the image is displayed: x to the right, y up, the
middle of the first pixel at (0, 0).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.core.errors import BadInputError
from tle.errors import TimeFormatError
from tle.instants import DAY_S, UNIX_EPOCH_MJD, Utc

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Pixels = NDArray[np.float32]

AGREE_S = 0.05
"""By how much dates of one exposure may contradict one another, beside a tenth of the exposure."""
COARSE_S = 0.5
"""A date that is not written to this counts only where no other is."""
COLOURS = 3


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """One exposure: `pixels[y, x]`, y up; the UTC of its middle; its exposure, seconds."""

    pixels: Pixels
    utc: Utc
    exposure_s: float
    name: str
    saturation: float | None = None
    """The value from which on a pixel tells nothing; None where nobody knows."""
    header: Mapping[str, Any] = field(default_factory=dict)
    """What the camera says besides, by the names of FITS."""
    decimal_s: float = 0.0
    """What the last decimal of its date is, seconds: the date may be off by as much."""

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the image, pixels."""
        height, width = self.pixels.shape
        return (width - 1) / 2.0, (height - 1) / 2.0


class Exposure(NamedTuple):
    """When a frame was exposed: the middle, how long, and what the last decimal of its date is, seconds."""

    utc: Utc
    exposure_s: float
    decimal_s: float = 0.0


def fits_exposure(header: Mapping[str, Any], name: str, exposure_s: float | None = None) -> Exposure:
    """Return when a FITS file was exposed, by its header; `exposure_s` is used where that has no exposure.

    DATE-AVG is the middle, DATE-BEG and DATE-OBS the beginning, DATE-END the end, and so MJD-AVG, -BEG, -OBS
    and -END (FITS Standard 4.0, table 35). The first of these counts that is not cut off at a second or so.
    Raises BadInputError, naming the file, where there is no date, where it has no time of day or is not UTC,
    or where dates contradict one another by more than their decimals leave open.
    """
    scale = str(header.get("TIMESYS", "UTC")).strip().upper()
    if scale not in {"UTC", ""}:
        raise BadInputError(f"{name}: TIMESYS is {scale}; only dates in UTC are read")
    length_s = _exposure_in(header, name, exposure_s)
    middles: dict[str, Utc] = {}
    coarse_s: dict[str, float] = {}
    for suffix, share in (("AVG", 0.0), ("BEG", 0.5), ("OBS", 0.5), ("END", -0.5)):
        for kind in ("DATE", "MJD"):
            found = _date_in(header, f"{kind}-{suffix}", name)
            if found is not None:
                utc, coarse_s[f"{kind}-{suffix}"] = found
                middles[f"{kind}-{suffix}"] = utc.plus(share * length_s)
    if not middles:
        raise BadInputError(f"{name}: its header has no DATE-OBS, DATE-AVG or DATE-BEG")
    first = min(middles, key=lambda key: coarse_s[key] > COARSE_S)
    for key, middle in middles.items():
        apart_s = float(middle - middles[first])
        agree_s = AGREE_S + 0.1 * length_s + max(coarse_s[key], coarse_s[first])
        if abs(apart_s) > agree_s and not _is_middle(key, middles, length_s):
            raise BadInputError(
                f"{name}: {key} and {first} contradict each other by {abs(apart_s):.3f} s "
                f"for an exposure of {length_s:g} s"
            )
    return Exposure(middles[first], length_s, coarse_s[first])


def _is_middle(key: str, middles: Mapping[str, Utc], length_s: float) -> bool:
    """Tell whether DATE-OBS repeats DATE-AVG, as some programs have it."""
    if not key.endswith("OBS") or "DATE-AVG" not in middles:
        return False
    return abs(float(middles[key].plus(-0.5 * length_s) - middles["DATE-AVG"])) <= AGREE_S


def _exposure_in(header: Mapping[str, Any], name: str, default_s: float | None) -> float:
    for key in ("EXPTIME", "EXPOSURE", "XPOSURE"):
        if header.get(key) is not None:
            return _positive(header[key], f"{name}: {key}")
    if default_s is None:
        raise BadInputError(f"{name}: its header has no EXPTIME; give --exposure S")
    return default_s


def _positive(value: object, what: str) -> float:
    try:
        number = float(str(value).strip())
    except ValueError:
        number = math.nan
    if not 0.0 <= number < DAY_S:
        raise BadInputError(f"{what} is {value!r}, which is no time of exposure")
    return number


def _date_in(header: Mapping[str, Any], key: str, name: str) -> tuple[Utc, float] | None:
    """Return a date, and how many seconds its last decimal is; one second at most."""
    value = header.get(key)
    if value is None or str(value).strip() == "":
        return None
    if key.startswith("MJD"):
        try:
            days = float(value)
        except (TypeError, ValueError):
            raise BadInputError(f"{name}: {key} is {value!r}, which is no date") from None
        return Utc((days - UNIX_EPOCH_MJD) * DAY_S), min(1.0, DAY_S * last_decimal_s(str(value)))
    text = str(value).strip()
    if "T" not in text and ":" not in text:
        time_of_day = header.get(key.replace("DATE", "TIME")) or header.get("UT") or header.get("UTC")
        if time_of_day is None:
            raise BadInputError(
                f"{name}: {key} is {text!r}, without a time of day: write UTC as 2026-10-02T13:05:24.5"
            )
        text = f"{text}T{str(time_of_day).strip()}"
    return parse_utc(text, f"{name}: {key}"), last_decimal_s(text)


def last_decimal_s(text: str) -> float:
    """Return what the last decimal of a number, or of a time's seconds, is worth; 1 without decimals."""
    found = re.search(r"[.,](\d+)", text)
    return 1.0 if found is None else 10.0 ** -len(found[1])


def parse_utc(text: str, what: str) -> Utc:
    """Return the instant of a text; raises BadInputError, naming `what`."""
    # Some programs write more decimals than a double holds.
    shorter = re.sub(r"(\.\d{9})\d+", r"\1", text)
    try:
        return Utc.parse(shorter)
    except TimeFormatError as error:
        raise BadInputError(f"{what}: {error}") from None


_SHARPCAP = re.compile(r"^(StartCapture|MidCapture|EndCapture)\s*=\s*(\S+)", re.M)
_SHARPCAP_EXPOSURE = re.compile(r"^Exposure\s*=\s*([0-9.,]+)[ \t]*([^\W\d]*)", re.M)
_FIRECAPTURE = re.compile(r"^(Date|Mid\(UT\)|Start\(UT\)|Date_format|Shutter)\s*=\s*(\S+)", re.M)
_IN_NAME = re.compile(
    r"(?<!\d)(\d{4})-?(\d\d)-?(\d\d)[T_\- ](\d\d)[:_\-]?(\d\d)[:_\-]?(\d\d)"
    r"(?:[.,](\d{1,9})|[_\-](\d{3}|\d{6,9})(?!\d))?(?:Z|UT|UTC)?(?!\d)"
)
"""After _ or - four or five digits are the number of a frame, as oaCapture has it, and no fraction."""
_DATE_FORMATS = {"ddMMyy": (4, 2, 0), "yyMMdd": (0, 2, 4), "MMddyy": (4, 0, 2)}
"""FireCapture's orders of the day, the month and the year: where year, month and day begin."""


def text_exposure(text: str, name: str, exposure_s: float | None = None) -> Exposure | None:
    """Return when an image was exposed, by the settings that its capture program wrote beside it.

    SharpCap writes NAME.CameraSettings.txt with MidCapture or StartCapture, FireCapture NAME.txt with Mid(UT)
    or Start(UT). None where neither is there. Raises BadInputError where it is there and is none.
    """
    sharpcap = dict(_SHARPCAP.findall(text))
    if sharpcap:
        said = _SHARPCAP_EXPOSURE.search(text)
        length_s = exposure_s
        if said is not None:
            length_s = _length_s(said[1], said[2], f"{name}: Exposure")
        for key, share in (("MidCapture", 0.0), ("StartCapture", 0.5), ("EndCapture", -0.5)):
            if key in sharpcap:
                return _shifted(sharpcap[key], f"{name}: {key}", share, length_s, name)
    fields = dict(_FIRECAPTURE.findall(text))
    order = _DATE_FORMATS.get(fields.get("Date_format", "ddMMyy"))
    for key, share in (("Mid(UT)", 0.0), ("Start(UT)", 0.5)):
        if key in fields and "Date" in fields and order is not None:
            day, clock = fields["Date"], fields[key]
            year, month, date = (day[i : i + 2] for i in order)
            iso = f"20{year}-{month}-{date}T{clock[:2]}:{clock[2:4]}:{clock[4:]}Z"
            shutter = re.fullmatch(r"([0-9.,]+)([^\W\d]+)", fields.get("Shutter", ""))
            length_s = exposure_s
            if shutter is not None:
                length_s = _length_s(shutter[1], shutter[2], f"{name}: Shutter")
            return _shifted(iso, f"{name}: {key}", share, length_s, name)
    return None


def name_exposure(stem: str, name: str, exposure_s: float | None) -> Exposure | None:
    """Return when an image was exposed, by a date in its file's name, which is that of its beginning.

    2026-10-02T13_05_24.500Z, 20261002_130524_500 and such, to the second at least; None where there is none.
    """
    found = _IN_NAME.search(stem)
    if found is None:
        return None
    year, month, day, hour, minute, second, *fractions = found.groups()
    fraction = fractions[0] or fractions[1]
    iso = f"{year}-{month}-{day}T{hour}:{minute}:{second}{f'.{fraction}' if fraction else ''}Z"
    return _shifted(iso, name, 0.5, exposure_s, name)


def _shifted(date: str, what: str, share: float, length_s: float | None, name: str) -> Exposure:
    utc = parse_utc(date, what)
    if length_s is None:
        raise BadInputError(f"{name}: nothing says how long it was exposed; give --exposure S")
    return Exposure(utc.plus(share * length_s), length_s, last_decimal_s(date))


_MICRO = "\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}u"
_UNITS_S = {"": 1.0, "s": 1.0, "ms": 1e-3} | {f"{micro}s": 1e-6 for micro in _MICRO}


def _length_s(number: str, unit: str, what: str) -> float:
    """Return a time of exposure; some languages have a comma in it. Raises BadInputError, naming `what`."""
    try:
        return float(number.replace(",", ".")) * _UNITS_S[unit]
    except (ValueError, KeyError):
        raise BadInputError(f"{what} is {number + unit!r}, which is no time of exposure") from None


MOSAIC = re.compile("[RGBW]{4}")
"""What BAYERPAT says of a sensor whose pixels lie behind filters of colours, two by two."""
MOSAIC_SIGMAS = 0.1
"""By so much of the noise the sky behind the filters differs at least, where no header tells of them."""


def levelled(pixels: Pixels, header: Mapping[str, Any]) -> Pixels | None:
    """Return an image that was taken through a mosaic of filters with the sky as bright behind each.

    None where there is no mosaic: by BAYERPAT, else by the sky.
    """
    told = header.get("NAXIS", 2) == 2 and MOSAIC.fullmatch(str(header.get("BAYERPAT", "")).strip())
    if not told and not _is_chequered(pixels):
        return None
    parts = [(slice(row, None, 2), slice(column, None, 2)) for row in (0, 1) for column in (0, 1)]
    skies = [float(np.median(pixels[part][::4, ::4])) for part in parts]
    level = pixels.copy()
    for part, sky in zip(parts, skies, strict=True):
        level[part] += sum(skies) / 4.0 - sky
    return level


def _is_chequered(pixels: Pixels) -> bool:
    """Tell whether both diagonals of squares of four pixels differ in the sky."""
    rows, columns = (2 * (size // 2) for size in pixels.shape)
    step = 2 * max(1, min(rows, columns) // 240)
    one, two, three, four = (pixels[y:rows:step, x:columns:step] for y, x in ((0, 0), (1, 1), (0, 1), (1, 0)))
    # A gradient, and rows or columns that differ, have no part in it.
    odd = one + two - three - four
    middle = float(np.median(odd))
    return abs(middle) > MOSAIC_SIGMAS * 1.4826 * float(np.median(np.abs(odd - middle)))


MOST_VALUE = 1e12
"""Of a pixel: above it is no light, and sums of squares would leave single precision."""


def grey(pixels: NDArray[Any]) -> Pixels:
    """Return an image of one plane: of colours, their mean; NaN where a pixel is no number up to MOST_VALUE.

    Raises ValueError for what is no image.
    """
    # The file's order: columns, then rows.
    size = " × ".join(str(one) for one in reversed(pixels.shape))
    # What is no number, or leaves single precision, is found below.
    with np.errstate(all="ignore"):
        if pixels.ndim == COLOURS and pixels.shape[2] in {3, 4}:
            pixels = pixels[..., :COLOURS].mean(axis=2, dtype=np.float32)
        elif pixels.ndim == COLOURS and pixels.shape[0] == COLOURS:
            pixels = pixels.mean(axis=0, dtype=np.float32)
        pixels = np.squeeze(pixels).astype(np.float32)
        good = np.abs(pixels) <= MOST_VALUE
    if pixels.ndim != 2:
        raise ValueError(
            f"it has {size} pixels; an image has several columns and rows, of one plane or three colours"
        )
    if not good.any():
        raise ValueError(f"none of its pixels is a number up to {MOST_VALUE:g}")
    if not good.all():
        pixels[~good] = np.nan
    return pixels


CLIPPED = frozenset({1023.0, 4095.0, 16383.0})
"""The highest values of converters of 10, 12 and 14 bits, whose pixels are kept in 16."""


def full_scale(pixels: Pixels, known: float | None) -> float | None:
    """Return the value of a full pixel: as is known, or where an image is cut off at that of fewer bits."""
    top = float(np.nanmax(pixels))
    if top not in CLIPPED or (known is not None and known <= top):
        return known
    rows = pixels == top
    pairs = rows[:-1] & rows[1:]
    # Four in a square, alike and the highest of all, are no chance.
    return top if bool((pairs[:, :-1] & pairs[:, 1:]).any()) else known


START_EXPOSURE_S = 0.1
AUTO_S = (0.005, 0.5)
"""Between these an exposure is chosen by itself: longer ones smear the satellite by what is not known yet."""
GAIN_STEP = 0.1
"""Of the camera's range of gains, where the longest or shortest exposure is not enough."""


def more_light(
    exposure_s: float,
    factor: float,
    exposures_s: tuple[float, float],
    gain: float | None,
    gains: tuple[float, float] | None,
) -> tuple[float, float | None]:
    """Return exposure and gain for `factor` times the light: the exposure first, at its limit the gain.

    Exposures stay within AUTO_S and what the camera can; gains are whole numbers, None where there are none.
    """
    low_s, high_s = max(AUTO_S[0], exposures_s[0]), max(exposures_s[0], min(AUTO_S[1], exposures_s[1]))
    after_s = min(max(exposure_s * factor, low_s), high_s)
    if factor == 1.0 or after_s != exposure_s or gain is None or gains is None or gains[1] <= gains[0]:
        return (exposure_s if factor == 1.0 else after_s), gain
    step = max(1.0, GAIN_STEP * (gains[1] - gains[0])) * (1.0 if factor > 1.0 else -1.0)
    return after_s, float(round(min(max(gain + step, gains[0]), gains[1])))


STRETCH_SIGMAS = 40.0
"""So many times the noise of a reduced pixel is white at least, so that noise alone stays dark."""
WHITE_SHARE = 99.9
POINT_SIGMAS = 4.5
"""Of a block's noise: what stands out further shows by itself, or a point would drown in its block."""


def reduced(frame: CameraFrame, side: int) -> tuple[int, int, bytes]:
    """Return a frame as a small picture: columns, rows, and levels from 0 to 255 in rows from the top.

    The longer side has `side` pixels at most. Each is the mean of a block, or its brightest pixel where that
    stands out of the noise. A pixel counts as no brighter than its neighbour, so that hot ones do not show.
    Levels grow as asinh from the sky's brightness on.
    """
    height, width = frame.pixels.shape
    step = max(1, math.ceil(max(height, width) / side))
    rows, columns = height // step, width // step
    # What is left over lies on both sides alike, so that the middle stays the middle.
    top, left = (height - rows * step) // 2, (width - columns * step) // 2
    cut = frame.pixels[top : top + rows * step, left : left + columns * step]
    good = np.isfinite(cut)
    if not good.all():
        cut = np.where(good, cut, np.median(cut[good]) if good.any() else np.float32(0.0))
    paired = cut.copy()
    np.minimum(cut[:, :-1], cut[:, 1:], out=paired[:, :-1])
    blocks = paired.reshape(rows, step, columns, step)
    mean, most = blocks.mean(axis=(1, 3)), blocks.max(axis=(1, 3))
    sky = float(np.median(mean))
    sample = cut[:: max(1, height // 256), :: max(1, width // 256)]
    noise = max(1e-6, 1.4826 * float(np.median(np.abs(sample - np.median(sample)))))
    value = np.maximum(mean - sky, most - sky - POINT_SIGMAS * noise)
    fine = noise / step
    white = max(STRETCH_SIGMAS * fine, float(np.percentile(value, WHITE_SHARE)))
    shares = np.arcsinh(np.clip(value + fine, 0.0, None) / (3.0 * fine)) / math.asinh(white / (3.0 * fine))
    levels = np.clip(255.0 * shares, 0.0, 255.0).astype(np.uint8)
    return columns, rows, levels[::-1].tobytes()

"""Instants in UTC: the one kind of time that everything in this package takes and gives.

A `Quantity` is a float for one instant and an array for many; `functions_for` gives the functions of either.
Wherever an instant is taken, an aware datetime and the Time of astropy or skyfield will do (`as_utc`).
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta, timezone
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from tle.errors import NaiveTimeError, PackageError, TimeFormatError, TimeRangeError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# float for one instant, NDArray[float64] for an array of instants. An explicit Any, because a union would
# make every caller narrow it although the shape is always that of the instants given.
Quantity: TypeAlias = Any
# What is taken as an instant, or as an array of instants.
Instant: TypeAlias = "Utc | datetime | list[datetime] | AstropyTime | SkyfieldTime"
DAY_S = 86400.0
UNIX_EPOCH_JD = 2440587.5
UNIX_EPOCH_MJD = 40587
MJD_JD = 2400000.5
TT_MINUS_TAI_S = 32.184
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_ISO = re.compile(
    r"(\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))"
    r"(?:[T ](\d\d):(\d\d)(?::(\d\d)(?:[.,](\d{1,18}))?)?)?"
    r" ?(Z|z|UTC|[+-]\d\d:?\d\d)?",
    re.ASCII,
)


def has_zone(text: str) -> bool:
    """Tell whether text that `Utc.parse` takes says of which zone it is."""
    match = _ISO.fullmatch(text.strip())
    return match is not None and match.group(9) is not None


class Utc:
    """One instant, or an array of instants, as POSIX seconds of UTC.

    POSIX seconds count 86400 to the day and so leave leap seconds out: 23:59:60 has the number of the
    midnight after it. A float holds them to 0.12 µs at present, which a satellite in low orbit passes in
    under a millimetre. Immutable; instants of one kind compare, subtract (seconds) and add seconds.
    """

    __slots__ = ("unix_s",)

    unix_s: Quantity

    def __init__(self, unix_s: Quantity) -> None:
        """Take POSIX seconds, a float or a one-dimensional array of float64."""
        object.__setattr__(self, "unix_s", unix_s)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse: instants do not change."""
        raise AttributeError(f"an instant cannot be changed ({name})")

    def __reduce__(self) -> tuple[type[Utc], tuple[Quantity]]:
        """Allow copies and pickles, which could not set the attribute of an immutable object."""
        return (Utc, (self.unix_s,))

    @classmethod
    def of(cls, unix_s: Quantity) -> Utc:
        """Return the instant or instants of POSIX seconds: a number, or any sequence of numbers.

        Raises TimeRangeError where one is not finite, or for more than one dimension.
        """
        value = unix_s if isinstance(unix_s, float) else np.asarray(unix_s, dtype=np.float64)
        if isinstance(value, np.ndarray) and value.ndim == 0:
            value = float(value)
        if isinstance(value, np.ndarray) and value.ndim > 1:
            raise TimeRangeError(f"instants come in one dimension, not in {value.ndim}")
        if not np.all(np.isfinite(value)):
            raise TimeRangeError("an instant is not a finite number of seconds: give real times only")
        return cls(value)

    @classmethod
    def parse(cls, text: str) -> Utc:
        """Return the instant that ISO 8601 text names; without a zone it is UTC, other zones are converted.

        A date alone is its 0h; seconds may be left out; a date may be that of a day of the year, 2026-275.
        23:59:60 is taken as the following midnight.
        Raises TimeFormatError.
        """
        match = _ISO.fullmatch(text.strip())
        if match is None:
            raise TimeFormatError(f"{text!r} is no time: write UTC as 2026-10-02T13:05:24.5Z")
        year, month, day, of_year, hour, minute, second = (int(g or 0) for g in match.groups()[:7])
        leap = second == 60 and (hour, minute) == (23, 59)
        if match.group(4):
            month = day = 1
        try:
            whole = datetime(
                year, month, day, hour, minute, 59 if leap else second, tzinfo=_zone(match.group(9))
            )
            if match.group(4):
                whole += timedelta(days=of_year - 1)
                if whole.year != year:
                    raise ValueError("day of the year is out of range")
        except (ValueError, OverflowError) as error:
            raise TimeFormatError(f"{text!r} is no time: {error}") from None
        fraction = float(f"0.{match.group(8)}") if match.group(8) else 0.0
        return cls(_unix_of(whole) + (1.0 if leap else 0.0) + fraction)

    @classmethod
    def from_datetime(cls, moment: datetime) -> Utc:
        """Return the instant of a datetime with a time zone. Raises NaiveTimeError without one."""
        if moment.utcoffset() is None:
            raise NaiveTimeError(
                f"{moment.isoformat()} has no time zone and names no instant: use datetime(..., tzinfo=UTC)"
            )
        return cls(_unix_of(moment))

    @classmethod
    def now(cls) -> Utc:
        """Return the present instant by the computer's clock, to the microsecond.

        For scripts. Nothing in this package calls it: every calculation takes its instants as arguments.
        """
        return cls.from_datetime(datetime.now(UTC))

    @classmethod
    def range(cls, start: Instant, stop: Instant, step_s: float) -> Utc:
        """Return instants from start to stop, both included where the step meets it, every step_s seconds.

        Raises TimeRangeError for a step that is not positive, a stop before the start, or a span of more
        than ten million instants.
        """
        start, stop = as_utc(start), as_utc(stop)
        span_s = stop.unix_s - start.unix_s
        if not step_s > 0.0 or not math.isfinite(step_s):
            raise TimeRangeError(f"a step of {step_s} s leads nowhere: give a positive number of seconds")
        if not span_s >= 0.0:
            raise TimeRangeError(f"{stop.isoformat()} is before {start.isoformat()}: give the earlier first")
        if span_s / step_s > 1e7:
            raise TimeRangeError(f"{span_s / step_s:.3g} instants are too many: give a longer step")
        count = math.floor(span_s / step_s + 1e-9) + 1
        return cls(start.unix_s + step_s * np.arange(count))

    @property
    def is_array(self) -> bool:
        """Tell whether this is an array of instants."""
        return isinstance(self.unix_s, np.ndarray)

    def split(self) -> tuple[Quantity, Quantity]:
        """Return the Julian date (UTC) of the 0h before, and the fraction of day since, at full precision."""
        days = self.unix_s // DAY_S
        return days + UNIX_EPOCH_JD, (self.unix_s - days * DAY_S) / DAY_S

    def datetime(self) -> datetime:
        """Return the one instant as a datetime in UTC, to the microsecond. Raises TimeRangeError."""
        if self.is_array:
            raise TimeRangeError("an array of instants is not one datetime: take its items")
        try:
            return _EPOCH + timedelta(seconds=self.unix_s)
        except (OverflowError, ValueError):
            raise TimeRangeError(f"{self.unix_s} s since 1970 is outside the calendar") from None

    def to_astropy(self) -> Any:
        """Return the same instants as an astropy Time, scale UTC. Raises PackageError without astropy."""
        try:
            from astropy.time import Time
        except ImportError:
            raise PackageError("astropy is not installed: pip install astropy") from None
        days, fraction = self.split()
        offset_s = tai_minus_utc_s(days - MJD_JD)
        return Time(days, fraction + offset_s / DAY_S, format="jd", scale="tai").utc

    def isoformat(self, timespec: str = "microseconds") -> str:
        """Return one instant as ISO 8601 ending in Z; timespec as in datetime.isoformat, rounded.

        Only "microseconds", "milliseconds" and "seconds" are known.
        """
        digits = {"microseconds": 6, "milliseconds": 3, "seconds": 0}[timespec]
        moment = Utc(round(self.unix_s, digits)).datetime() if not self.is_array else self.datetime()
        return moment.replace(tzinfo=None).isoformat(timespec=timespec) + "Z"

    def isoformats(self, timespec: str = "microseconds", quote: str = "") -> list[str]:
        """Return each of an array of instants as `isoformat` does, within quotes where one is given.

        `timespec` is "microseconds" or "seconds".
        """
        fine = timespec == "microseconds"
        whole = np.floor(self.unix_s) if fine else np.rint(self.unix_s)
        micro = np.rint((self.unix_s - whole) * 1e6).astype(np.int32) if fine else np.zeros(1, dtype=np.int32)
        seconds = whole.astype(np.int64) + (micro == 1_000_000)
        days, which = np.unique(seconds // int(DAY_S), return_inverse=True)
        dates = np.datetime_as_string(days.astype("datetime64[D]")).astype("S10").view(np.uint8)
        second = (seconds % int(DAY_S)).astype(np.int32)
        text = np.empty((len(seconds), 27 if fine else 20), dtype=np.uint8)
        text[:] = np.frombuffer(b"yyyy-mm-ddThh:mm:ss." + b"uuuuuuZ" * fine, dtype=np.uint8)
        text[:, :10] = dates.reshape(-1, 10)[which]
        for column, value in ((11, second // 3600), (14, second // 60 % 60), (17, second % 60)):
            text[:, column], text[:, column + 1] = 48 + value // 10, 48 + value % 10
        for column in range(25, 19, -1) if fine else ():
            text[:, column] = 48 + micro % 10
            micro = micro // 10
        text[:, -1] = ord("Z")
        if quote:
            text = np.pad(text, ((0, 0), (1, 1)), constant_values=ord(quote))
        joined, width = text.tobytes().decode("ascii"), text.shape[1]
        return [joined[k : k + width] for k in range(0, len(joined), width)]

    def plus(self, seconds: Quantity) -> Utc:
        """Return the instants so many seconds later. Raises TimeRangeError where that is not finite."""
        later = self.unix_s + seconds
        if isinstance(later, float) and not math.isfinite(later):
            raise TimeRangeError(f"{seconds} s after {self} is no instant")
        return Utc(later)

    def __sub__(self, other: Instant) -> Quantity:
        """Return the seconds from other to this. Raises TimeFormatError for what is no instant."""
        return self.unix_s - as_utc(other).unix_s

    def __getitem__(self, index: int) -> Utc:
        """Return one instant of an array."""
        return Utc(float(self.unix_s[index]))

    def __len__(self) -> int:
        """Return how many instants an array has. Raises TypeError for a single one."""
        return len(self.unix_s)

    def __bool__(self) -> bool:
        """Hold for every instant, so that a length of none does not make one false."""
        return True

    def __lt__(self, other: Instant) -> bool:
        """Tell whether one instant comes before another. Raises TimeFormatError for what is no instant."""
        return bool(self.unix_s < as_utc(other).unix_s)

    def __le__(self, other: Instant) -> bool:
        """Tell whether one instant comes no later than another. Raises TimeFormatError."""
        return bool(self.unix_s <= as_utc(other).unix_s)

    def __eq__(self, other: object) -> bool:
        """Tell whether these are the same instants."""
        return isinstance(other, Utc) and bool(np.array_equal(self.unix_s, other.unix_s))

    def __hash__(self) -> int:
        """Hash a single instant."""
        return hash(self.unix_s)

    def __str__(self) -> str:
        """Return one instant as ISO 8601, an array as its repr."""
        return repr(self) if self.is_array else self._text()

    def __repr__(self) -> str:
        """Show the instant as a reader would write it, an array by its first and last."""
        if not self.is_array:
            return f"<Utc {self._text()}>"
        if len(self) == 0:
            return "<Utc, no instants>"
        return f"<Utc, {len(self)} instants from {self[0]} to {self[len(self) - 1]}>"

    def _text(self) -> str:
        """Return one instant as ISO 8601 without trailing zeros, as seconds where the calendar ends."""
        try:
            text = self.isoformat()[:-1]
        except (TimeRangeError, ValueError):
            return f"{self.unix_s} s since 1970"
        return text.rstrip("0").rstrip(".") + "Z"


class AstropyTime(Protocol):
    """What is read of an astropy Time: the same instants in TAI, whose Julian date is `jd1` + `jd2`."""

    @property
    def tai(self) -> Any: ...  # noqa: D102
    @property
    def jd1(self) -> Any: ...  # noqa: D102
    @property
    def jd2(self) -> Any: ...  # noqa: D102


class SkyfieldTime(Protocol):
    """What is read of a skyfield Time: its Julian date in TT is `whole` + `tt_fraction`."""

    whole: Any
    tt_fraction: Any


def as_utc(instant: Instant) -> Utc:
    """Return the Utc of an aware datetime, a list of them, or a Time of astropy or skyfield; a Utc as it is.

    Arrays of one dimension stay arrays. Times of other scales (TT, TDB, UT1) are converted by their own
    package to TAI or TT, and from there by ERFA's leap seconds. Raises NaiveTimeError for a datetime without
    a zone, and TimeFormatError for anything else.
    """
    if isinstance(instant, Utc):
        return instant
    if isinstance(instant, datetime):
        return Utc.from_datetime(instant)
    if isinstance(instant, list | tuple):
        return Utc(np.array([as_utc(one).unix_s for one in instant], dtype=np.float64))
    if hasattr(instant, "jd1") and hasattr(instant, "tai"):
        atomic = instant.tai
        return _utc_of_tai(atomic.jd1, atomic.jd2)
    if hasattr(instant, "tt_fraction"):
        return _utc_of_tai(instant.whole, instant.tt_fraction - TT_MINUS_TAI_S / DAY_S)
    raise TimeFormatError(
        f"{instant!r} is no instant: give a Utc, an aware datetime, or a Time of astropy or skyfield"
    )


def _utc_of_tai(days: Quantity, fraction: Quantity) -> Utc:
    """Return the instants of a two-part Julian date in TAI; a leap second counts on past midnight."""
    import erfa

    # The bare functions give a status for years without announced leap seconds, where the others warn.
    utc_days, utc_fraction, _ = erfa.ufunc.taiutc(days, fraction)
    year, month, day, clock, _ = erfa.ufunc.d2dtf(b"UTC", 9, utc_days, utc_fraction)
    _, mjd, _ = erfa.ufunc.cal2jd(year, month, day)
    second = clock["h"] * 3600.0 + clock["m"] * 60.0 + clock["s"] + clock["f"] * 1e-9
    return Utc.of((mjd - UNIX_EPOCH_MJD) * DAY_S + second)


def tai_minus_utc_s(mjd: Quantity) -> Quantity:
    """Return TAI-UTC on days since 1972, in seconds; on an earlier day that of 1972."""
    starts, values = _leap_seconds()
    found = values[np.maximum(0, np.searchsorted(starts, mjd, side="right") - 1)]
    return found if isinstance(mjd, np.ndarray) else float(found)


@lru_cache(maxsize=1)
def _leap_seconds() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the days (MJD) from which TAI-UTC has its values since 1972, and the values in seconds."""
    import erfa

    table = erfa.leap_seconds.get()
    table = table[table["year"] >= 1972]
    starts = [
        int(erfa.cal2jd(int(y), int(m), 1)[1]) for y, m in zip(table["year"], table["month"], strict=True)
    ]
    return np.array(starts, dtype=np.int64), np.asarray(table["tai_utc"], dtype=np.float64)


def utc_of_tai(zero_s: float, since_s: float) -> Utc:
    """Return the instant of TAI, in seconds counted like POSIX seconds from 1970, plus seconds."""
    tai = zero_s + since_s
    for _ in range(2):
        mjd = math.floor((tai - float(leaps_s(tai))) / DAY_S) + UNIX_EPOCH_MJD
        leap_s = tai_minus_utc_s(mjd)
    return Utc(zero_s - leap_s + since_s)


def leaps_s(unix_s: Quantity) -> Quantity:
    """Return TAI-UTC at POSIX seconds of UTC."""
    if not isinstance(unix_s, np.ndarray):
        return tai_minus_utc_s(math.floor(unix_s / DAY_S) + UNIX_EPOCH_MJD)
    found, inverse = np.unique(np.floor(unix_s / DAY_S).astype(np.intp), return_inverse=True)
    return np.array([tai_minus_utc_s(int(day) + UNIX_EPOCH_MJD) for day in found])[inverse]


class Functions(NamedTuple):
    """The functions that a formula needs, for floats or for arrays."""

    sin: Any
    cos: Any
    tan: Any
    sqrt: Any
    exp: Any
    atan2: Any
    where: Any


def _scalar_where(condition: bool, yes: float, no: float) -> float:
    return yes if condition else no


FLOATS = Functions(math.sin, math.cos, math.tan, math.sqrt, math.exp, math.atan2, _scalar_where)
ARRAYS = Functions(np.sin, np.cos, np.tan, np.sqrt, np.exp, np.arctan2, np.where)


def functions_for(value: Quantity) -> Functions:
    """Return the functions that fit a value: those of arrays for an array, else those of floats."""
    return ARRAYS if isinstance(value, np.ndarray) else FLOATS


def _unix_of(moment: datetime) -> float:
    """Return POSIX seconds; days and seconds apart, as timedelta.total_seconds() rounds no more than that."""
    since = moment - _EPOCH
    return since.days * DAY_S + since.seconds + since.microseconds / 1e6


def _zone(text: str | None) -> timezone:
    """Return the zone that ISO 8601 text names; none is UTC. Raises ValueError for more than 24 hours."""
    if text is None or text in ("Z", "z", "UTC"):
        return UTC
    sign = -1 if text[0] == "-" else 1
    digits = text[1:].replace(":", "")
    return timezone(sign * timedelta(hours=int(digits[:2]), minutes=int(digits[2:])))

"""Instants in UTC: the one kind of time that everything in this package takes and gives.

A `Quantity` is a float for one instant and an array for many; `functions_for` gives the functions of either.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta, timezone
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tle.errors import NaiveTimeError, TimeFormatError, TimeRangeError

# float for one instant, NDArray[float64] for an array of instants. An explicit Any, because a union would
# make every caller narrow it although the shape is always that of the instants given.
Quantity: TypeAlias = Any
DAY_S = 86400.0
UNIX_EPOCH_JD = 2440587.5
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_ISO = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)"
    r"(?:[T ](\d\d):(\d\d)(?::(\d\d)(?:[.,](\d{1,9}))?)?)?"
    r" ?(Z|z|UTC|[+-]\d\d:?\d\d)?",
    re.ASCII,
)


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

        A date alone is its 0h; seconds may be left out. 23:59:60 is taken as the following midnight.
        Raises TimeFormatError.
        """
        match = _ISO.fullmatch(text.strip())
        if match is None:
            raise TimeFormatError(f"{text!r} is no time: write UTC as 2026-10-02T13:05:24.5Z")
        year, month, day, hour, minute, second = (int(g or 0) for g in match.groups()[:6])
        leap = second == 60 and (hour, minute) == (23, 59)
        try:
            whole = datetime(
                year, month, day, hour, minute, 59 if leap else second, tzinfo=_zone(match.group(8))
            )
        except ValueError as error:
            raise TimeFormatError(f"{text!r} is no time: {error}") from None
        fraction = float(f"0.{match.group(7)}") if match.group(7) else 0.0
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
    def range(cls, start: Utc, stop: Utc, step_s: float) -> Utc:
        """Return instants from start to stop, both included where the step meets it, every step_s seconds.

        Raises TimeRangeError for a step that is not positive, a stop before the start, or a span of more
        than ten million instants.
        """
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

    def isoformat(self, timespec: str = "microseconds") -> str:
        """Return one instant as ISO 8601 ending in Z; timespec as in datetime.isoformat, rounded.

        Only "microseconds", "milliseconds" and "seconds" are known.
        """
        digits = {"microseconds": 6, "milliseconds": 3, "seconds": 0}[timespec]
        moment = Utc(round(self.unix_s, digits)).datetime() if not self.is_array else self.datetime()
        return moment.replace(tzinfo=None).isoformat(timespec=timespec) + "Z"

    def isoformats(self, timespec: str = "microseconds") -> list[str]:
        """Return each of an array of instants as `isoformat` does; "microseconds" or "seconds"."""
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
        joined, width = text.tobytes().decode("ascii"), text.shape[1]
        return [joined[k : k + width] for k in range(0, len(joined), width)]

    def plus(self, seconds: Quantity) -> Utc:
        """Return the instants so many seconds later."""
        return Utc(self.unix_s + seconds)

    def __sub__(self, other: Utc) -> Quantity:
        """Return the seconds from other to this."""
        return self.unix_s - other.unix_s

    def __getitem__(self, index: int) -> Utc:
        """Return one instant of an array."""
        return Utc(float(self.unix_s[index]))

    def __len__(self) -> int:
        """Return how many instants an array has. Raises TypeError for a single one."""
        return len(self.unix_s)

    def __bool__(self) -> bool:
        """Hold for every instant, so that a length of none does not make one false."""
        return True

    def __lt__(self, other: Utc) -> bool:
        """Tell whether one instant comes before another."""
        return bool(self.unix_s < other.unix_s)

    def __le__(self, other: Utc) -> bool:
        """Tell whether one instant comes no later than another."""
        return bool(self.unix_s <= other.unix_s)

    def __eq__(self, other: object) -> bool:
        """Tell whether these are the same instants."""
        return isinstance(other, Utc) and bool(np.array_equal(self.unix_s, other.unix_s))

    def __hash__(self) -> int:
        """Hash a single instant."""
        return hash(self.unix_s)

    def __repr__(self) -> str:
        """Show the instant as a reader would write it."""
        if self.is_array:
            return f"<Utc {len(self)} instants>"
        return f"Utc({self.unix_s!r})"


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

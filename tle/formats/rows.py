"""Text of many rows as columns of numbers, and the time systems of ephemerides; a refusal names its line."""

from __future__ import annotations

import math
import re
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import erfa
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tle.errors import EphemerisError, SourceError, printable
from tle.instants import DAY_S, MJD_JD, TT_MINUS_TAI_S, UNIX_EPOCH_MJD, tai_minus_utc_s

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_BLANK, _NEWLINE = 32, 10
_BLANKS = bytes.maketrans(b"\t\r", b"  ")
# Room for the widest time, so that every line can be looked at so far.
_STAMP = 40
_LARGEST = 1e15
# So many rows tell how numbers are written.
_LIKE_IT = 20
# So many lines, or bytes, stay in the processor's cache.
_AT_ONCE, _SOME = 10_000, 1 << 20
_FIRST_YEAR, _LAST_YEAR = 1972, 2100
_STAMPS = (
    re.compile(rb"(\d{4})-(\d\d)-(\d\d)T(\d\d):(\d\d):(\d\d)(\.\d*)?(?:Z|\+00:?00)?"),
    re.compile(rb"(\d{4})-(\d{3})T(\d\d):(\d\d):(\d\d)(\.\d*)?(?:Z|\+00:?00)?"),
)
# TAI minus each system; of UTC and TDB it changes.
_TAI_MINUS_S = {
    "TAI": 0.0,
    "TT": -TT_MINUS_TAI_S,
    "TDT": -TT_MINUS_TAI_S,
    "GPS": 19.0,
    "GAL": 19.0,
    "QZS": 19.0,
    "IRN": 19.0,
    "SBS": 19.0,
    "BDT": 33.0,
    "UTC": None,
    "GLO": None,
    "TDB": None,
}


class Lines:
    """A text as lines: where each begins and ends, and numbers and times out of many of them at once.

    Lines count from 0 here; errors name them from 1.
    """

    def __init__(
        self, data: bytes | bytearray, source: str, numbers: Sequence[int] | Index | None = None
    ) -> None:
        """Take a text; `numbers` are those of its lines, from 1, where they are others than their order's.

        A bytearray is not copied, and is written on.
        """
        self.source = source
        self.data = data
        self._numbers = None if numbers is None else np.asarray(numbers, dtype=np.intp)
        # Tabs and carriage returns are blanks.
        blank = b"\t" in data or b"\r" in data
        text = data.translate(_BLANKS) if blank else data
        if isinstance(text, bytes):
            text = bytearray(text)
        self._ended = text.endswith(b"\n")
        text += b" " * _STAMP if self._ended else b"\n" + b" " * _STAMP
        raw = np.frombuffer(text, dtype=np.uint8)
        pieces = range(0, len(raw), _SOME)
        newlines = np.concatenate([np.flatnonzero(raw[k : k + _SOME] == _NEWLINE) + k for k in pieces])
        self.ends: Index = newlines
        self.starts: Index = np.concatenate([[0], newlines[:-1] + 1])
        self.raw = raw

    def __len__(self) -> int:
        """Return how many lines there are."""
        return len(self.starts)

    def text(self, line: int) -> str:
        """Return one line without the blanks around it."""
        return self.raw[self.starts[line] : self.ends[line]].tobytes().decode("utf-8", "replace").strip()

    @cached_property
    def last(self) -> int:
        """Give the last line that is not blank, 0 where all are."""
        filled = np.flatnonzero(self.first_bytes)
        return int(filled[-1]) if len(filled) else 0

    def heads(self, width: int) -> NDArray[np.bytes_]:
        """Return the first bytes of all lines, blanks beyond their ends, shape (n,)."""
        head = self.fixed(np.arange(len(self)), 0, width)
        return np.ascontiguousarray(head).view(f"S{width}").ravel()

    def fixed(self, which: Index, first: int, last: int) -> NDArray[np.uint8]:
        """Return columns first to last of lines, shape (n, last - first); blanks beyond a line's end."""
        starts, ends = self.starts[which], self.ends[which]
        if last <= len(self.raw) and (ends - starts >= last).all():
            found: NDArray[np.uint8] = sliding_window_view(self.raw, last - first)[starts + first]
            return found
        columns = starts[:, None] + np.arange(first, last)
        inside = columns < ends[:, None]
        return np.where(inside, self.raw[np.minimum(columns, len(self.raw) - 1)], np.uint8(_BLANK))

    def error(self, line: int, reason: str) -> EphemerisError:
        """Return a refusal that names the source and the line."""
        return EphemerisError(reason, source=self.source, line=self.number(line))

    def number(self, line: int) -> int:
        """Return the number by which a user knows a line."""
        return line + 1 if self._numbers is None else int(self._numbers[min(line, len(self._numbers) - 1)])

    def number_of(self, which: Index) -> Index:
        """Return the numbers by which a user knows lines, shape (n,)."""
        return which + 1 if self._numbers is None else self._numbers[which]

    @cached_property
    def first_bytes(self) -> NDArray[np.uint8]:
        """Give the first byte of each line that is no blank, 0 where there is none."""
        first = self._firsts
        return np.where(first < self.ends, self.raw[first], np.uint8(0))

    @cached_property
    def _firsts(self) -> Index:
        """Give where the first byte of each line is that is no blank; its end where there is none."""
        first = self.starts.copy()
        blank = np.flatnonzero((first < self.ends) & (self.raw[first] == _BLANK))
        while len(blank):
            first[blank] += 1
            blank = blank[(first[blank] < self.ends[blank]) & (self.raw[first[blank]] == _BLANK)]
        return first

    def numbers(self, which: Index, count: int | tuple[int, ...], what: str) -> Array:
        """Return the numbers of lines, shape (n, count); `count` of several keeps the least of them.

        Raises EphemerisError for a line with other than so many numbers, or with what is none.
        """
        counts = (count,) if isinstance(count, int) else count
        values = np.empty((len(which), counts[0]))
        for k in range(0, len(which), _AT_ONCE):
            values[k : k + _AT_ONCE] = self._numbers_at_once(which[k : k + _AT_ONCE], counts, what)
        return values

    def _numbers_at_once(self, which: Index, counts: tuple[int, ...], what: str) -> Array:
        """Return the numbers of so few lines that their bytes stay in the processor's cache."""
        raw = self._only(which)
        words = _begins(raw)
        base = self.starts[which[0]]
        found = np.searchsorted(words, self.ends[which] - base)
        found -= np.searchsorted(words, self.starts[which] - base)
        right = found == counts[0]
        for other in counts[1:]:
            right |= found == other
        wrong = np.flatnonzero(~right)
        if len(wrong):
            line = int(which[wrong[0]])
            places = " or ".join(map(str, counts))
            raise self.error(
                line, f"{what} has {found[wrong[0]]} numbers where {places} belong: {self._quoted(line)}"
            )
        values = _floats(raw, words)
        if values is None:
            raise self._bad_number(which, what)
        least = counts[0]
        if len(words) != least * len(which):
            ends = np.cumsum(found)
            place = np.arange(len(words)) - np.repeat(ends - found, found)
            values = values[place < least]
        return self._finite(values.reshape(len(which), least), which, what)

    def fixed_numbers(self, which: Index, columns: Sequence[tuple[int, int]], what: str) -> Array:
        """Return the numbers that stand in columns (first, end) of lines, shape (n, number of columns).

        Raises EphemerisError.
        """
        wide = sum(end - first + 1 for first, end in columns)
        values = np.empty((len(which), len(columns)))
        for k in range(0, len(which), _AT_ONCE):
            some = which[k : k + _AT_ONCE]
            cut = np.full((len(some), wide), _BLANK, dtype=np.uint8)
            at = 0
            for first, end in columns:
                cut[:, at : at + end - first] = self.fixed(some, first, end)
                at += end - first + 1
            raw = cut.flatten()
            words = _begins(raw)
            found = _floats(raw, words) if len(words) == len(columns) * len(some) else None
            if found is None:
                raise self._bad_columns(cut, some, len(columns), what)
            values[k : k + _AT_ONCE] = self._finite(found.reshape(len(some), -1), some, what)
        return values

    def _bad_columns(self, cut: NDArray[np.uint8], which: Index, count: int, what: str) -> EphemerisError:
        for line, row in zip(which.tolist(), cut, strict=True):
            words = row.tobytes().decode("ascii", "replace").split()
            if len(words) != count or not all(_is_number(word) for word in words):
                return self.error(line, f"{what} has not {count} numbers: {self._quoted(line)}")
        return self.error(int(which[0]), f"{what} cannot be read")

    def _finite(self, rows: Array, which: Index, what: str) -> Array:
        good = np.abs(rows) < _LARGEST
        if not good.all():
            line = int(which[np.flatnonzero(~good.all(axis=1))[0]])
            raise self.error(line, f"{what} holds a number that is not finite: {self._quoted(line)}")
        return rows

    def _only(self, which: Index) -> NDArray[np.uint8]:
        """Return the bytes from the first to the last of lines, with blanks in place of all others."""
        first, last = int(which[0]), int(which[-1])
        raw = self.raw[self.starts[first] : self.ends[last] + 1].copy()
        if last - first + 1 != len(which):
            kept = np.zeros(last - first + 1, dtype=bool)
            kept[which - first] = True
            lengths = self.ends[first : last + 1] - self.starts[first : last + 1] + 1
            raw[~np.repeat(kept, lengths)] = _BLANK
        raw[raw == _NEWLINE] = _BLANK
        return raw

    def _bad_number(self, which: Index, what: str) -> EphemerisError:
        for line in which.tolist():
            for word in self._words(line):
                if not _is_number(word):
                    return self.error(line, f"{what}: {printable(word)!r} is no number")
        return self.error(int(which[0]), f"{what} cannot be read")

    def _words(self, line: int) -> list[str]:
        return self.text(line).split()

    def _quoted(self, line: int) -> str:
        return repr(printable(self.text(line)[:60]))

    def check_end(self, which: Index) -> None:
        """Refuse a last row without a line end whose last number has lost digits, by the rows before it.

        It has fewer decimals than that of the row before; or fewer than some before, or fewer digits, and is
        not where the two before lead. Raises EphemerisError.
        """
        if self._ended or len(which) < 2 or int(which[-1]) != self.last:
            return
        *others, before, last = (self._words(int(k))[-1] for k in which[-_LIKE_IT:])
        decimals = [len(word.partition(".")[2]) for word in (*others, before, last)]
        step = float(before) - float(others[-1] if others else before)
        off = abs(float(last) - float(before) - step)
        shorter = decimals[-1] < max(decimals) or len(last.lstrip("+-")) < len(before.lstrip("+-"))
        if decimals[-1] < decimals[-2] or (shorter and off > 0.1 * abs(step) + 10.0 ** -max(decimals)):
            raise self.error(
                int(which[-1]),
                f"the text ends with {printable(last)!r}, shorter than the numbers above it: it is cut off; "
                "get the whole file, or end it with a line end",
            )

    def take_stamps(self, which: Index) -> tuple[Index, Array]:
        """Return the times that begin lines as days (MJD) and seconds of day, and leave blanks there.

        CCSDS times, 2026-11-22T18:30:00.5 or 2026-326T18:30:00.5. Raises EphemerisError.
        """
        days, seconds = np.zeros(len(which), dtype=np.intp), np.zeros(len(which))
        for k in range(0, len(which), _AT_ONCE):
            some = which[k : k + _AT_ONCE]
            first = self._firsts[some]
            width = self._widths(first)
            for size in np.unique(width).tolist():
                rows = np.flatnonzero(width == size)
                columns = first[rows][:, None] + np.arange(size)
                stamps = self.raw[columns]
                days[k + rows], seconds[k + rows] = self._stamps(some[rows], stamps)
                self.raw[columns] = _BLANK
        return days, seconds

    def _widths(self, first: Index) -> Index:
        """Return how wide the words are that begin at these places: mostly as wide as the first one."""

        def width_of(head: NDArray[np.uint8]) -> Index:
            gap = (head == _BLANK) | (head == _NEWLINE)
            return np.where(gap.any(axis=-1), np.argmax(gap, axis=-1), 0)

        usual = int(width_of(self.raw[first[0] : first[0] + _STAMP]))
        widths = np.full(len(first), usual)
        seen = self.raw[first[:, None] + np.arange(usual + 1)]
        gaps = (seen == _BLANK) | (seen == _NEWLINE)
        other = np.flatnonzero(gaps[:, :-1].any(axis=1) | ~gaps[:, -1])
        widths[other] = width_of(self.raw[first[other][:, None] + np.arange(_STAMP)])
        return widths

    def _stamps(self, which: Index, stamps: NDArray[np.uint8]) -> tuple[Index, Array]:
        """Return days and seconds of times of one width, all written like the first."""
        match = None
        for pattern in _STAMPS:
            match = match or pattern.fullmatch(stamps[0].tobytes())
        if match is None:
            raise self._no_stamp(int(which[0]), stamps[0])
        digit = (stamps[0] >= 48) & (stamps[0] <= 57)
        # Those of a zone are the same in every row.
        digit[max(match.end(k + 1) for k in range(len(match.groups()))) :] = False
        same = np.where(digit, (stamps >= 48) & (stamps <= 57), stamps == stamps[0]).all(axis=1)
        if not same.all():
            other = int(np.flatnonzero(~same)[0])
            raise self._no_stamp(int(which[other]), stamps[other])

        def field(group: int) -> Index:
            first, last = match.span(group)
            return digits(first, last)

        def digits(first: int, last: int) -> Index:
            value = np.zeros(len(stamps), dtype=np.int64)
            for column in range(first, last):
                value = 10 * value + stamps[:, column] - 48
            return value

        dated = len(match.groups()) == 7
        year = field(1)
        month, day = (field(2), field(3)) if dated else (np.ones_like(year), field(2))
        hour, minute, second = (field(k) for k in ((4, 5, 6) if dated else (3, 4, 5)))
        first, last = match.span(7 if dated else 6)
        # More decimals than these no float holds.
        decimals = min(max(last - first - 1, 0), 15)
        fraction = digits(first + 1, first + 1 + decimals) / 10.0**decimals
        days = days_of(year, month, day)
        bad = is_no_date(year, month, day) if dated else (day < 1) | (day > 366)
        bad |= (hour > 23) | (minute > 59) | (second > 59 + ((hour == 23) & (minute == 59)))
        bad |= (year < _FIRST_YEAR) | (year > _LAST_YEAR)
        if bad.any():
            other = int(np.flatnonzero(bad)[0])
            raise self._no_stamp(int(which[other]), stamps[other])
        return days, 3600.0 * hour + 60.0 * minute + second + fraction

    def _no_stamp(self, line: int, stamp: NDArray[np.uint8]) -> EphemerisError:
        shown = printable(stamp.tobytes().decode("utf-8", "replace").strip())
        return self.error(
            line, f"{shown!r} is no time: it must be like 2026-11-22T18:30:00.5, from {_FIRST_YEAR} on"
        )


def _begins(raw: NDArray[np.uint8]) -> Index:
    """Return where words begin in bytes that have no blanks but spaces."""
    inked = raw != _BLANK
    inked[1:] &= ~inked[:-1]
    return np.flatnonzero(inked)


def _floats(raw: NDArray[np.uint8], words: Index) -> Array | None:
    """Return the numbers in bytes whose words begin there; None where one is none. `raw` is written on."""
    import msgspec

    # As JSON, which is read several times faster than by numpy; but it has no leading zeros and no plus.
    plain = raw.tobytes()
    raw[words[1:] - 1] = ord(",")
    try:
        found = msgspec.json.decode(b"[" + raw.tobytes() + b"]", type=list[float])
    except msgspec.MsgspecError:
        found = []
    if len(found) == len(words):
        return np.fromiter(found, np.float64, len(found))
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            values = np.fromstring(plain, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    return values if len(values) == len(words) else None


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    # What Python reads as well, and files of numbers do not have.
    return word.isascii() and "_" not in word


def days_of(year: Index, month: Index, day: Index) -> Index:
    """Return the Modified Julian Days of Gregorian dates."""
    months = (year - 1970) * 12 + (month - 1)
    first = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    days: Index = first + (day - 1) + UNIX_EPOCH_MJD
    return days


def is_no_date(year: Index, month: Index, day: Index) -> NDArray[np.bool_]:
    """Tell which dates the calendar has not."""
    bad: NDArray[np.bool_] = (month < 1) | (month > 12) | (day < 1)
    return bad | (days_of(year, month, day) >= days_of(year, month + 1, np.ones_like(day)))


def is_time_system(name: str) -> bool:
    """Tell whether `tai_s` knows a time system."""
    return name in _TAI_MINUS_S


def tai_s(system: str, days: Index, seconds: Array) -> tuple[float, Array]:
    """Return times as TAI, in seconds: a whole zero, counted like POSIX seconds from 1970, and since it.

    `days` are Modified Julian Days and `seconds` those of the day, of a time system that `is_time_system`
    knows. In UTC the second 86400 of a day is its leap second.
    """
    zero_s = (float(days[0]) - UNIX_EPOCH_MJD) * DAY_S + math.floor(seconds[0])
    since = (days - days[0]) * DAY_S + (seconds - math.floor(seconds[0]))
    return zero_s, _to_tai(system, days, seconds, since)


def tai_after_s(system: str, days: Index, seconds: Array, zero_s: float) -> Array:
    """Return times as `tai_s` takes them in seconds after such a zero."""
    whole = np.floor(seconds)
    return ((days - UNIX_EPOCH_MJD) * DAY_S + whole - zero_s) + _to_tai(
        system, days, seconds, seconds - whole
    )


def _to_tai(system: str, days: Index, seconds: Array, since: Array) -> Array:
    """Return seconds since a zero that is counted in TAI, of times that are counted in a time system."""
    offset = _TAI_MINUS_S[system]
    if offset is not None:
        return since + offset
    if system == "TDB":
        julian = MJD_JD + days
        tdb_minus_tt_s: Array = erfa.dtdb(julian, seconds / DAY_S, 0.0, 0.0, 0.0, 0.0)
        return since - tdb_minus_tt_s - TT_MINUS_TAI_S
    found, inverse = np.unique(days, return_inverse=True)
    leaps: Array = np.array([tai_minus_utc_s(int(day)) for day in found])[inverse]
    return since + leaps


def read_table(path: str | Path, subject: str) -> list[tuple[int, str, list[str]]]:
    """Return number, text and words of each line that has words; `#` begins a comment, a comma is a blank.

    The text is fit for a terminal. Raises SourceError, which names the subject, where the file is no text.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = (error.strerror or str(error)) if isinstance(error, OSError) else "is not text"
        raise SourceError(f"{path}: cannot read {subject}: {why}") from None
    rows = (
        (number, printable(line.strip()), line.split("#")[0].replace(",", " ").split())
        for number, line in enumerate(text.splitlines(), start=1)
    )
    return [row for row in rows if row[2]]

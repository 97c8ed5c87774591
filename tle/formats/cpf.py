"""CPF, the laser stations' predictions (ILRS Consolidated Prediction Format, versions 1 and 2).

Rows are interpolated by Lagrange's polynomial, of a degree above the 9 that the ILRS recommends, in the frame
of the file; with records 20, by Hermite's.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.earth import FIRST_MJD
from tle.elements import parse_alpha5
from tle.ephemeris import Frame, Interpolation, Segment, TableEphemeris
from tle.errors import EphemerisError, TleError, printable
from tle.formats.rows import Lines, tai_s
from tle.instants import DAY_S, UNIX_EPOCH_MJD, Utc, leaps_s, tai_minus_utc_s
from tle.orbit_rows import falling
from tle.sources import full_designator

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_FRAMES = {
    0: Frame("ITRF", "ITRF (body-fixed)"),
    1: Frame("TOD", "true of date"),
    2: Frame("EME2000", "mean of J2000"),
}
_LAGRANGE, _HERMITE = Interpolation(14, False), Interpolation(6, True)
# A step so many times the header's is a gap.
_GAP = 1.5
_LAST_MJD = 88_000
_DIRECTIONS = {0: "common epoch", 1: "transmit", 2: "receive"}


class _CpfHeader(NamedTuple):
    name: str
    producer: str
    version: int
    made: Utc
    designator: str
    sic: str
    """The laser stations' number of the object, empty where there is none."""
    catalog_number: int
    first: Utc
    last: Utc
    step_s: float
    frame: Frame


def recognised(lines: Lines) -> bool:
    """Tell whether a text begins like a CPF file."""
    first = next((lines.text(k) for k in range(min(len(lines), 20)) if lines.text(k)), "")
    return first[:2].upper() == "H1"


def parse_cpf(lines: Lines) -> list[TableEphemeris]:
    """Return the one object of a CPF file. Raises EphemerisError, naming the line."""
    kinds = np.char.upper(lines.heads(2))
    h1, h2 = (_line_of(lines, kinds, kind) for kind in (b"H1", b"H2"))
    header = _header(lines, h1, h2)
    if kinds[lines.last] != b"99":
        raise lines.error(
            lines.last, "the text ends without its record 99: it is cut off; get the whole file"
        )
    known = np.isin(kinds, [b"10", b"20", b"30", b"40", b"50", b"60", b"70", b"99", b"00", b"  ", b""])
    known |= np.char.startswith(kinds, b"H")
    strange = [k for k in np.flatnonzero(~known).tolist() if lines.text(k)]
    if strange:
        raise lines.error(strange[0], f"{printable(lines.text(strange[0])[:20])!r} begins no CPF record")
    segments = _segments(lines, kinds, header)
    if not segments:
        raise lines.error(
            h2,
            f"{header.name}: no rows between {header.first.isoformat('seconds')} and "
            f"{header.last.isoformat('seconds')}, for which the header says that they are",
        )
    segments = falling(segments, header.name, lines.source, _LAGRANGE)
    return [
        TableEphemeris(
            header.name,
            segments,
            f"CPF {header.version} by {header.producer} of {header.made.isoformat('seconds')[:13]}h, "
            f"{segments[0].interpolation.words}",
            epoch=header.made,
            catalog_number=header.catalog_number,
            names=(header.designator, header.sic),
            source=lines.source,
        )
    ]


def _segments(lines: Lines, kinds: NDArray[np.bytes_], header: _CpfHeader) -> list[Segment]:
    """Return the rows between gaps, for use within the header's span."""
    which = np.flatnonzero(kinds == b"10")
    if len(which) == 0:
        raise lines.error(lines.last, f"{header.name} has no record 10: there are no places")
    rows = lines.numbers(which, 8, "record 10")
    _check_directions(lines, which, rows)
    days = np.clip(rows[:, 2], FIRST_MJD, _LAST_MJD).astype(np.intp)
    seconds = rows[:, 3]
    bad = np.flatnonzero((rows[:, 2] != days) | (seconds < 0.0) | (seconds > DAY_S))
    if len(bad):
        day, second = rows[bad[0], 2], seconds[bad[0]]
        raise lines.error(int(which[bad[0]]), f"record 10: {day:g} {second:g} is no day and second of it")
    zero_s, since = tai_s("UTC", days, seconds)
    _check_leaps(lines, which, rows[:, 4], days)
    _check_order(lines, which, since)
    velocities = _velocities(lines, which, kinds)
    use = [float(one.unix_s) + leaps_s(one.unix_s) - zero_s for one in (header.first, header.last)]
    whole = Segment(
        zero_s,
        since,
        rows[:, 5:8] / 1000.0,
        None if velocities is None else velocities / 1000.0,
        header.frame,
        _LAGRANGE if velocities is None else _HERMITE,
        (use[0], use[1]),
        lines=lines.number_of(which),
    )
    segments = [whole.part(first, stop, "a gap") for first, stop in _pieces(since, header.step_s)]
    return [one for one in segments if one.use_s[0] < one.use_s[1]]


def _line_of(lines: Lines, kinds: NDArray[np.bytes_], kind: bytes) -> int:
    found = np.flatnonzero(kinds == kind)
    if len(found) == 0:
        raise lines.error(0, f"there is no record {kind.decode()}: this is no CPF file")
    return int(found[0])


def _header(lines: Lines, h1: int, h2: int) -> _CpfHeader:
    """Return what the two first records say; the fields stand apart by blanks."""
    one, two = lines.text(h1).split(), lines.text(h2).split()
    try:
        if one[1].upper() != "CPF":
            raise lines.error(h1, f"record H1 is of the format {printable(one[1])!r}, not CPF")
        version = int(one[2])
        if version not in (1, 2):
            raise lines.error(h1, f"CPF version {version} is not known: versions 1 and 2 are read")
        year, month, day, hour = (int(word) for word in one[4:8])
        made = Utc.parse(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:00:00Z")
        name = one[9] if version == 1 else one[10]
        alpha5 = parse_alpha5(two[3].upper())
        cospar, number = two[1], int(two[3]) if alpha5 is None else alpha5
        first, last = (_moment([int(word) for word in two[k : k + 6]]) for k in (4, 10))
        step_s = float(two[16])
        kind = int(two[19])
    except (IndexError, ValueError, TleError) as error:
        if isinstance(error, EphemerisError):
            raise
        why = "a field is missing" if isinstance(error, IndexError) else str(error)
        raise lines.error(h2, f"the records H1 and H2 are not as CPF has them: {why}") from None
    if kind not in _FRAMES:
        raise lines.error(h2, f"reference frame {kind} is not known: 0 (body-fixed), 1 and 2 are read")
    if last <= first:
        raise lines.error(h2, f"the end {last.isoformat('seconds')} is not after the start")
    return _CpfHeader(
        printable(name),
        printable(one[3]),
        version,
        made,
        full_designator(cospar.zfill(7)) or printable(cospar),
        two[2].lstrip("0") if two[2].isdigit() else "",
        number,
        first,
        last,
        step_s,
        _FRAMES[kind],
    )


def _moment(parts: list[int]) -> Utc:
    year, month, day, hour, minute, second = parts
    day_start = Utc.parse(f"{year:04d}-{month:02d}-{day:02d}")
    return day_start.plus(3600.0 * hour + 60.0 * minute + second)


def _check_directions(lines: Lines, which: Index, rows: Array) -> None:
    """Refuse places that are no common epoch's: of light that goes out, or comes back."""
    other = np.flatnonzero(rows[:, 1] != 0.0)
    if len(other):
        line = int(which[other[0]])
        kind = _DIRECTIONS.get(int(rows[other[0], 1]), "unknown")
        raise lines.error(
            line,
            f"direction flag {rows[other[0], 1]:g} ({kind}): only places of a common epoch, 0, are read; "
            "targets on the Moon and transponders are not",
        )


def _check_leaps(lines: Lines, which: Index, flags: Array, days: Index) -> None:
    """Refuse a leap second that the file tells and the IERS does not, or the other way about.

    The flag counts the leap seconds since the first row.
    """
    found, inverse = np.unique(days, return_inverse=True)
    leaps = np.array([tai_minus_utc_s(int(day)) for day in found])[inverse]
    since_first = leaps - leaps[0]
    odd = np.flatnonzero((flags != 0.0) & (flags != since_first))
    if len(odd) == 0:
        return
    k = int(odd[0])
    day = Utc((int(days[k]) - UNIX_EPOCH_MJD) * DAY_S).isoformat("seconds")[:10]
    raise lines.error(
        int(which[k]),
        f"leap second flag {flags[k]:g}, but {since_first[k]:g} leap seconds came between the first row and "
        f"{day}: the file's times are wrong, or astropy-iers-data is too old",
    )


def _check_order(lines: Lines, which: Index, since: Array) -> None:
    back = np.flatnonzero(np.diff(since) <= 0.0)
    if len(back):
        line = int(which[back[0] + 1])
        raise lines.error(line, "this row is not later than the row before: rows must be in order of time")


def _velocities(lines: Lines, which: Index, kinds: NDArray[np.bytes_]) -> Array | None:
    """Return the velocities of records 20 where each place has one, None where there is none at all."""
    found = np.flatnonzero(kinds == b"20")
    if len(found) == 0:
        return None
    if len(found) != len(which):
        raise lines.error(
            int(found[0]),
            f"{len(found)} velocities (record 20) for {len(which)} places: there must be one each",
        )
    return lines.numbers(found, 5, "record 20")[:, 2:5]


def _pieces(since: Array, step_s: float) -> list[tuple[int, int]]:
    """Return first and one past the last row between gaps; most steps are none, whatever the header says."""
    usual = max(step_s, float(np.median(np.diff(since))) if len(since) > 1 else 0.0)
    gaps = np.flatnonzero(np.diff(since) > _GAP * usual + 1.0) + 1
    edges = [0, *gaps.tolist(), len(since)]
    return list(itertools.pairwise(edges))

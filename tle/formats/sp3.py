"""SP3, the orbits of navigation and geodetic satellites (versions a to d; Hilla 2016 for d).

The format prescribes no interpolation; the IGS's practice is a polynomial of degree 10 or so. Rows with
velocities are interpolated by Hermite's polynomial, others by Lagrange's, and so those with poor velocities.
"""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.ephemeris import Frame, Interpolation, Segment, TableEphemeris
from tle.errors import EphemerisError, printable
from tle.formats.rows import Lines, days_of, is_no_date, is_time_system, tai_s
from tle.instants import utc_of_tai
from tle.orbit_rows import falling

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_LAGRANGE, _HERMITE = Interpolation(12, False), Interpolation(6, True)
# The terrestrial frames by their names in SP3: of the IERS, of the IGS, of the laser stations, of GPS.
_TERRESTRIAL = re.compile(
    r"(ITR?F?|IG[SbBRr]?|SLRF?|CTRF?|GTRF?|BTRF?)[-_]?\d*\w?|WGS[-_]?84|ECF|ECEF|UNDEF|", re.ASCII
)
_GAP = 1.5
_BAD_KM = 1e-6
_DM_PER_KM = 1e4
_NONE = np.empty(0, dtype=np.intp)


class _Sp3Header(NamedTuple):
    version: str
    velocities: bool
    epochs: int
    step_s: float
    frame: Frame
    agency: str
    system: str
    satellites: dict[str, int]
    """Of each satellite its accuracy exponent, 0 where it is not known."""


def recognised(lines: Lines) -> bool:
    """Tell whether a text begins like an SP3 file."""
    return re.match(r"#[a-z][PV]", lines.text(0)) is not None


def parse_sp3(lines: Lines) -> list[TableEphemeris]:
    """Return every satellite of an SP3 file whose rows can be interpolated; the others are in `refused`.

    Raises EphemerisError, naming the line, where there is none.
    """
    header = _header(lines)
    firsts = lines.raw[lines.starts]
    seconds = lines.raw[np.minimum(lines.starts + 1, len(lines.raw) - 1)]
    filled = (lines.ends - lines.starts) > 1
    epochs = np.flatnonzero((firsts == ord("*")) & filled)
    last = lines.last
    _check_kinds(lines, firsts, seconds)
    if lines.text(last) != "EOF":
        raise lines.error(
            last, f"the text ends with {printable(lines.text(last)[:24])!r}, not with EOF: it is cut off"
        )
    if len(epochs) != header.epochs:
        raise lines.error(
            0, f"the header says {header.epochs} epochs, but there are {len(epochs)}: the file is not whole"
        )
    days, second = _moments(lines, epochs)
    zero_s, since = tai_s(header.system, days, second)
    back = np.flatnonzero(np.diff(since) <= 0.0)
    if len(back):
        raise lines.error(int(epochs[back[0] + 1]), "this epoch is not later than the one before")
    made = utc_of_tai(zero_s, float(since[0]))
    rows = {kind: _rows(lines, np.flatnonzero(firsts == ord(kind)), kind) for kind in "PV"}
    note = ", frame not stated" if header.frame.written == "Earth-fixed" else ""
    found: list[TableEphemeris] = []
    refused: dict[str, EphemerisError] = {}
    for name, exponent in header.satellites.items():
        segments = _segments(lines, name, header, (zero_s, since, epochs), rows)
        if not any(len(one.since_s) > 1 for one in segments):
            continue
        sigma_km = None if exponent == 0 else 2.0**exponent * 1e-6
        try:
            segments = falling(segments, name, lines.source, _LAGRANGE)
            one = TableEphemeris(
                name,
                segments,
                f"SP3-{header.version} by {header.agency}, {segments[0].interpolation.words}{note}",
                epoch=made,
                source=lines.source,
                sigma_km=sigma_km,
            )
            one.refused = refused
            found.append(one)
        except EphemerisError as error:
            refused[name] = error
    if refused and not found:
        raise next(iter(refused.values()))
    if not found:
        raise lines.error(
            int(epochs[0]) if len(epochs) else 0,
            f"{len(epochs)} epochs: no satellite has two rows without a gap between them to interpolate",
        )
    return found


def _header(lines: Lines) -> _Sp3Header:
    """Return what the lines before the first epoch say."""
    head = lines.text(0)
    text = lines.raw[lines.starts[0] : lines.ends[0]].tobytes().decode("ascii", "replace")
    if text[1] not in "abcd":
        raise lines.error(0, f"SP3 version {text[1]!r} is not known: a to d are read")
    try:
        epochs = int(text[32:39])
        name = text[46:51].strip()
        step = lines.raw[lines.starts[1] : lines.ends[1]].tobytes().decode("ascii", "replace")
        step_s = float(step[24:38])
    except (ValueError, IndexError):
        raise lines.error(0, f"the header is not as SP3 has it: {printable(head[:40])!r}") from None
    if _TERRESTRIAL.fullmatch(name) is None:
        raise lines.error(
            0, f"frame {printable(name)!r} is not known: SP3 is Earth-fixed (ITRF, IGS, WGS 84 and the like)"
        )
    satellites: list[str] = []
    exponents: list[int] = []
    count, system, systems = 0, "GPS", 0
    for k in range(2, len(lines)):
        line = lines.raw[lines.starts[k] : lines.ends[k]].tobytes().decode("ascii", "replace")
        if line.startswith("*"):
            break
        try:
            if line.startswith("++"):
                exponents += [int(word) for word in _threes(line)]
            elif line.startswith("+"):
                count = count or int(line[1:6])
                satellites += [
                    _satellite(line[c : c + 3]) for c in range(9, 60, 3) if line[c : c + 3].strip()
                ]
            elif line.startswith("%c"):
                systems += 1
                word = line[9:12].strip()
                if systems == 1 and word not in ("ccc", ""):
                    system = word
                    if not is_time_system(word):
                        raise lines.error(k, f"time system {printable(word)!r} is not known")
        except ValueError:
            raise lines.error(k, f"the header is not as SP3 has it: {printable(line[:24])!r}") from None
    if not 0 < count <= len(satellites):
        raise lines.error(2, f"the header says {count} satellites and names {len(satellites)}")
    exponents += [0] * count
    frame = Frame("ITRF", "Earth-fixed" if name in ("", "UNDEF") else name)
    return _Sp3Header(
        text[1],
        text[2] == "V",
        epochs,
        step_s,
        frame,
        text[56:60].strip() or "an unnamed agency",
        system,
        dict(zip(satellites[:count], exponents, strict=False)),
    )


def _threes(line: str) -> list[str]:
    """Return the fields of three columns of a header line that are not blank."""
    return [line[c : c + 3] for c in range(9, 60, 3) if line[c : c + 3].strip()]


def _satellite(field: str) -> str:
    """Return the name of a satellite; version a numbers those of GPS alone."""
    word = field.strip()
    if len(word) <= 2 and word.isdigit():
        return f"G{int(word):02d}"
    return word[:1] + word[1:].strip().zfill(2)


def _check_kinds(lines: Lines, firsts: NDArray[np.uint8], seconds: NDArray[np.uint8]) -> None:
    """Refuse lines that are none of SP3's."""
    known = np.isin(firsts, np.frombuffer(b"#+%/*PVE\n ", dtype=np.uint8))
    for k in np.flatnonzero(~known).tolist():
        raise lines.error(k, f"{printable(lines.text(k)[:20])!r} begins no line of SP3")
    rest = (firsts == ord("E")) & ~np.isin(seconds, np.frombuffer(b"PVO", dtype=np.uint8))
    for k in np.flatnonzero(rest).tolist():
        raise lines.error(k, f"{printable(lines.text(k)[:20])!r} begins no line of SP3")


def _moments(lines: Lines, which: Index) -> tuple[Index, Array]:
    """Return days (MJD) and seconds of day of epoch lines."""
    if len(which) == 0:
        raise lines.error(0, "there is no epoch: nothing to interpolate")
    stars = lines.starts[which]
    lines.raw[stars] = 32
    year, month, day, hour, minute, second = lines.numbers(which, 6, "an epoch").T
    lines.raw[stars] = ord("*")
    whole = [part.astype(np.intp) for part in (year, month, day, hour, minute)]
    bad = is_no_date(whole[0], whole[1], whole[2]) | (hour > 23) | (minute > 59)
    bad |= (second < 0.0) | (second >= 61.0) | (year < 1972) | (year > 2100)
    if bad.any():
        line = int(which[np.flatnonzero(bad)[0]])
        raise lines.error(line, f"{printable(lines.text(line)[:32])!r} is no date and time")
    return days_of(whole[0], whole[1], whole[2]), 3600.0 * whole[3] + 60.0 * whole[4] + second


class _Rows(NamedTuple):
    lines: Index
    values: Array
    of: dict[str, Index]
    """Of each satellite its rows, by index, in order."""


def _rows(lines: Lines, which: Index, kind: str) -> _Rows:
    """Return the satellites' names and three numbers of position or velocity lines, of fixed columns."""
    if len(which) == 0:
        return _Rows(which, np.empty((0, 3)), {})
    short = np.flatnonzero(lines.ends[which] - lines.starts[which] < 46)
    if len(short):
        line = int(which[short[0]])
        raise lines.error(
            line,
            f"{printable(lines.text(line)[:46])!r} has no three {'places' if kind == 'P' else 'velocities'} "
            "of 14 columns: it is cut off",
        )
    names = lines.fixed(which, 1, 4) @ np.array([65536, 256, 1], dtype=np.uint32)
    values = lines.fixed_numbers(which, ((4, 18), (18, 32), (32, 46)), f"a line {kind}")
    found, owner, count = np.unique(names, return_inverse=True, return_counts=True)
    # Sorted stably, small integers take one pass.
    owner = owner.astype(np.min_scalar_type(len(found)))
    parts = np.split(np.argsort(owner, kind="stable"), np.cumsum(count)[:-1])
    satellites = [_satellite(name.to_bytes(3, "big").decode("latin-1")) for name in found.tolist()]
    return _Rows(which, values, dict(zip(satellites, parts, strict=True)))


def _segments(
    lines: Lines,
    name: str,
    header: _Sp3Header,
    times: tuple[float, Array, Index],
    rows: dict[str, _Rows],
) -> list[Segment]:
    """Return the rows of one satellite between gaps and manoeuvres."""
    zero_s, since, epochs = times
    places = rows["P"].of.get(name, _NONE)
    if len(places) == 0:
        return []
    which = rows["P"].lines[places]
    epoch = np.searchsorted(epochs, which, "right") - 1
    values = rows["P"].values[places]
    velocities = None
    if header.velocities:
        # A velocity follows its position, before the next position.
        found = rows["V"].of.get(name, _NONE)
        owner = np.searchsorted(epochs, rows["V"].lines[found], "right") - 1
        both = np.isin(epoch, owner)
        places, epoch, which, values = places[both], epoch[both], which[both], values[both]
        velocities = rows["V"].values[found][np.searchsorted(owner, epoch)] / _DM_PER_KM
    if len(epoch) and (epoch < 0).any():
        raise lines.error(int(which[0]), "this line stands before the first epoch")
    twice = np.flatnonzero(np.diff(epoch) == 0)
    if len(twice):
        raise lines.error(int(which[twice[0] + 1]), f"{name} is there twice at one epoch")
    good = np.abs(values).max(axis=1) > _BAD_KM if len(values) else np.zeros(0, dtype=bool)
    epoch, which, values = epoch[good], which[good], values[good]
    if len(which) == 0:
        return []
    velocities = None if velocities is None else velocities[good]
    at = since[epoch]
    manoeuvre = lines.fixed(which, 78, 79)[:, 0] == ord("M")
    gap = np.zeros(len(at), dtype=bool)
    gap[1:] = np.diff(at) > _GAP * header.step_s + 1.0
    edges = [0, *(np.flatnonzero((gap | manoeuvre)[1:]) + 1).tolist(), len(at)]
    whole = Segment(
        zero_s,
        at,
        values,
        velocities,
        header.frame,
        _LAGRANGE if velocities is None else _HERMITE,
        (float(at[0]), float(at[-1])),
        lines=lines.number_of(which),
    )
    return [
        whole.part(first, stop, "a manoeuvre" if manoeuvre[first] else "a gap")
        for first, stop in itertools.pairwise(edges)
    ]

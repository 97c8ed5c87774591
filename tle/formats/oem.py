"""OEM, the ephemerides of operators (CCSDS 502.0, versions 1 to 3, KVN and XML), and those of Starlink's.

Rows are interpolated as the file recommends; where it says nothing by Hermite's polynomial over six rows, or
by Lagrange's over twelve where velocities are not those of the places.
Segments are never interpolated across, and hold from USEABLE_START_TIME to USEABLE_STOP_TIME.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING
from xml.parsers import expat

import numpy as np

from tle.ephemeris import Frame, Interpolation, Segment, TableEphemeris
from tle.errors import EphemerisError, TleError, printable
from tle.formats.rows import Lines, is_time_system, tai_after_s, tai_s
from tle.instants import Utc, utc_of_tai
from tle.orbit_rows import falling
from tle.sources import catalog_number_of, full_designator

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.ephemeris import FrameKind
    from tle.instants import Quantity

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_VERSIONS = ("1.0", "2.0", "3.0")
_NEEDED = ("OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "START_TIME", "STOP_TIME")
_ITRF = re.compile(r"ITRF([-_]?(8[89]|9\d|[012]\d|19[89]\d|20[0-4]\d))?", re.ASCII)
_FRAMES: dict[str, FrameKind] = {
    "GCRF": "GCRF",
    "GCRS": "GCRF",
    "ICRF": "GCRF",
    "ICRF1": "GCRF",
    "ICRF2": "GCRF",
    "ICRF3": "GCRF",
    "EME2000": "EME2000",
    "J2000": "EME2000",
    "TOD": "TOD",
    "TEME": "TEME",
    # As the registry of CCSDS (SANA) has them.
    "TOD_EARTH": "TOD",
    "TEMEOFDATE": "TEME",
}
# Axes of covariances beside those: of the orbit, and others that CCSDS 502.0-B and its registry (SANA) name.
_AXES = re.compile(
    r"(RTN|RSW|QSW|RIC|UVW|LVLH|TNW|NTW|VNC|VVLH|NSW|SEZ|EQW|PQW)(_(INERTIAL|ROTATING))?|UVW_GO_INERTIAL|"
    r"(ALIGN|FIXED|MOD|MOE|TOD|TOE)(_(CB|EARTH|MOON))?|TEMEOF(DATE|EPOCH)|TRUE_ECLIPTIC|MCI|MOON_\w+|"
    r"GTOD|GRC|TDR|CIRS|EFG|WGS[-_]?84|B1950|GCRF\d|DTRF[-_]?\d{4}|ECI|ECEF|ECF",
    re.ASCII,
)
_USUAL, _BY_PLACES = Interpolation(6, True), Interpolation(12, False)
_MOST_ROWS = 16
# A step so many times the usual one, in which the object turns by so much about the Earth, is a gap.
_GAP, _GAP_RAD = 4.0, 0.3
# No polynomial goes from steps to others so many times longer or shorter.
_UNEVEN = 3.0
_COVARIANCE_ROWS = 6
# How the ephemerides that Starlink's operator publishes begin, and the name and times of one.
_MEME = "created:"
_MEME_NAME = re.compile(r"MEME_(\d+)_([^_]+)_", re.ASCII)
_MEME_STAMP = re.compile(r"(\d{4})(\d{3})(\d\d)(\d\d)(\d\d(?:\.\d*)?)", re.ASCII)
_MEME_STOP = re.compile(r"ephemeris_stop:(\d{4}-\d\d-\d\d) (\d\d:\d\d:\d\d(?:\.\d*)?) UTC", re.ASCII)
# Rows of numbers begin with what comes before this in ASCII.
_LETTERS = ord("A")
_KVN = re.compile(r"([A-Z][A-Z0-9_]*)\s*(?:=\s*(.*))?", re.ASCII)


def recognised(lines: Lines) -> bool:
    """Tell whether a text begins like an OEM in KVN, which XML is read as, too."""
    for k in range(min(len(lines), 40)):
        text = lines.text(k).lstrip("\ufeff")
        if text:
            return text.startswith(("CCSDS_OEM_VERS", _MEME))
    return False


def lines_of(data: bytes, source: str) -> Lines:
    """Return the lines of a text; of an OEM in XML as KVN that knows its own lines. Raises EphemerisError."""
    head = data[:_XML_HEAD].lstrip(codecs.BOM_UTF8).lstrip()
    if not (head.startswith(b"<") and re.search(rb"<(\w+:)?oem[\s>]", head)):
        return Lines(data, source)
    # Every line is whole: text of XML that ends in the middle has no end tags.
    text, numbers = _OemXml(source).run(data)
    return Lines(text, source, numbers)


@dataclass(slots=True)
class _Block:
    """A segment as it is written: keywords with their lines, and which lines are rows and covariances."""

    start: int
    meta: dict[str, tuple[str, int]] = field(default_factory=dict)
    stop: int = 0
    rows: tuple[int, int] = (0, 0)
    covariances: list[tuple[int, int]] = field(default_factory=list)

    def __getitem__(self, keyword: str) -> str:
        return self.meta[keyword][0]

    def line(self, keyword: str) -> int:
        """Return the line of a keyword, or that of the block's end."""
        return self.meta[keyword][1] if keyword in self.meta else self.stop


def parse_oem(lines: Lines) -> list[TableEphemeris]:
    """Return the objects of an OEM, nearly always one. Raises EphemerisError, naming the line."""
    if not lines.text(0).lstrip("\ufeff").startswith("CCSDS_OEM_VERS"):
        filled = next(k for k in range(len(lines)) if lines.text(k))
        if lines.text(filled).startswith(_MEME):
            lines = _from_meme(lines, filled)
    kvn = _Kvn(lines)
    kvn.run()
    if not kvn.blocks:
        raise lines.error(len(lines) - 1, "there is no META_START: no segment, or the text is cut off")
    objects: dict[tuple[str, str], list[Segment]] = {}
    for block in kvn.blocks:
        key = (block["OBJECT_NAME"], block["OBJECT_ID"])
        segments = objects.setdefault(key, [])
        by_places = None if "INTERPOLATION" in block.meta else _BY_PLACES
        segments += falling(_segments(lines, block), printable(key[0]), lines.source, by_places)
        if not segments:
            raise lines.error(block.line("STOP_TIME"), "no row lies between START_TIME and STOP_TIME")
    originator = kvn.header.get("ORIGINATOR", "an unnamed originator")
    found = []
    for (name, designator), segments in objects.items():
        first = segments[0]
        start = utc_of_tai(first.zero_s, float(first.since_s[0]))
        number = catalog_number_of(designator.strip()) or (int(name) if name.isdecimal() else 0)
        found.append(
            TableEphemeris(
                printable(name),
                segments,
                f"OEM by {printable(originator)}, {first.interpolation.words}",
                epoch=_made(kvn.header.get("CREATION_DATE", ""), start),
                catalog_number=number,
                names=(full_designator(designator.strip()) or printable(designator),),
                source=lines.source,
            )
        )
    return found


def _made(text: str, otherwise: Utc) -> Utc:
    try:
        return Utc.parse(text)
    except TleError:
        return otherwise


class _Kvn:
    """The keywords of an OEM, line by line: the header's, and the segments as they are written."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._state = "header"
        self._opened = 0
        self.header: dict[str, str] = {}
        self.blocks: list[_Block] = []

    def run(self) -> None:
        """Read all lines that begin with a letter. Raises EphemerisError."""
        lines = self._lines
        for k in np.flatnonzero(lines.first_bytes >= _LETTERS).tolist():
            text = lines.text(k).lstrip("\ufeff")
            if text.startswith("COMMENT"):
                continue
            match = _KVN.fullmatch(text)
            word, value = (match[1], match[2]) if match else ("", None)
            if self._state == "meta":
                taken = self._in_meta(k, word, value)
            elif self._state == "covariance":
                taken = self._in_covariance(k, word)
            else:
                taken = self._between(k, word, value)
            if not taken:
                raise lines.error(k, f"{printable(text[:40])!r} does not belong here")
        if self._state in ("meta", "covariance"):
            end = "META_STOP" if self._state == "meta" else "COVARIANCE_STOP"
            raise lines.error(
                len(lines) - 1, f"the text ends before {end}: it is cut off; get the whole file"
            )
        self._end_rows(len(lines))

    def _in_meta(self, k: int, word: str, value: str | None) -> bool:
        if word == "META_STOP":
            _check_meta(self._lines, self.blocks[-1], k)
            self._state = "rows"
        elif value is None:
            return False
        else:
            self.blocks[-1].meta[word] = (value.strip(), k)
        return True

    def _in_covariance(self, k: int, word: str) -> bool:
        if word == "COVARIANCE_STOP":
            self.blocks[-1].covariances.append((self._opened, k))
            self._state = "over"
            return True
        return word in ("EPOCH", "COV_REF_FRAME")

    def _between(self, k: int, word: str, value: str | None) -> bool:
        if word == "META_START":
            self._end_rows(k)
            self.blocks.append(_Block(k))
            self._state = "meta"
        elif word == "COVARIANCE_START" and self.blocks:
            self._end_rows(k)
            self._opened, self._state = k, "covariance"
        elif self._state == "header" and value is not None:
            self.header[word] = value.strip()
            if word == "CCSDS_OEM_VERS" and value.strip() not in _VERSIONS:
                known = ", ".join(_VERSIONS)
                raise self._lines.error(k, f"OEM version {printable(value)!r} is not known: {known} are")
        else:
            return False
        return True

    def _end_rows(self, line: int) -> None:
        if self._state == "rows":
            self.blocks[-1].rows = (self.blocks[-1].stop + 1, line)


def _check_meta(lines: Lines, block: _Block, stop: int) -> None:
    """Refuse what is missing, or what we do not know."""
    block.stop = stop
    for keyword in _NEEDED:
        if keyword not in block.meta:
            raise lines.error(stop, f"{keyword} is missing before META_STOP")
    center = block["CENTER_NAME"]
    if center.upper() != "EARTH":
        raise lines.error(
            block.line("CENTER_NAME"),
            f"CENTER_NAME {printable(center)}: only ephemerides about EARTH are read",
        )
    system = block["TIME_SYSTEM"].upper()
    if not is_time_system(system):
        raise lines.error(
            block.line("TIME_SYSTEM"),
            f"TIME_SYSTEM {printable(system)} is not known: UTC, TAI, TT, GPS and TDB are",
        )


def _frame(lines: Lines, block: _Block) -> Frame:
    written = block["REF_FRAME"]
    name = written.upper()
    kind: FrameKind | None = "ITRF" if _ITRF.fullmatch(name) else _FRAMES.get(name)
    if kind is None:
        raise lines.error(
            block.line("REF_FRAME"),
            f"REF_FRAME {printable(written)} is not known: GCRF, ICRF, EME2000, ITRF…, TEME and TOD are",
        )
    if "REF_FRAME_EPOCH" not in block.meta or kind not in ("TOD", "TEME"):
        return Frame(kind, printable(written))
    if kind == "TEME":
        raise lines.error(block.line("REF_FRAME_EPOCH"), "TEME of a fixed epoch is not read: TEME of date is")
    at = utc_of_tai(0.0, _since(lines, block, "REF_FRAME_EPOCH", 0.0))
    return Frame(kind, f"{printable(written)} of {at.isoformat('seconds')}", at)


def _since(lines: Lines, block: _Block, keyword: str, zero_s: float) -> float:
    """Return the time that a keyword gives, TAI, as seconds after zero_s."""
    value, line = block.meta[keyword]
    try:
        days, seconds = Lines(value.encode(), lines.source).take_stamps(np.array([0]))
    except EphemerisError:
        raise lines.error(line, f"{keyword}: {printable(value)!r} is no time") from None
    return float(tai_after_s(block["TIME_SYSTEM"].upper(), days, seconds, zero_s)[0])


def _interpolation(lines: Lines, block: _Block) -> Interpolation:
    method = block.meta.get("INTERPOLATION", ("", 0))[0].upper()
    if not method:
        return _USUAL
    if method == "LINEAR":
        return Interpolation(2, False)
    degree_text = block.meta.get("INTERPOLATION_DEGREE", ("", 0))[0]
    if method not in ("HERMITE", "LAGRANGE"):
        raise lines.error(
            block.line("INTERPOLATION"),
            f"INTERPOLATION {printable(method)} is not known: HERMITE, LAGRANGE and LINEAR are",
        )
    if not (degree_text.isdigit() and 1 <= int(degree_text) < 2 * _MOST_ROWS):
        raise lines.error(
            block.line("INTERPOLATION_DEGREE"),
            f"INTERPOLATION_DEGREE {printable(degree_text)!r}: it must be from 1 to {2 * _MOST_ROWS - 1}",
        )
    degree = int(degree_text)
    if method == "HERMITE":
        return Interpolation(max(2, (degree + 2) // 2), True)
    return Interpolation(min(degree + 1, _MOST_ROWS), False)


def _segments(lines: Lines, block: _Block) -> list[Segment]:
    """Return the rows of one segment, divided at gaps."""
    frame, interpolation = _frame(lines, block), _interpolation(lines, block)
    first, stop = block.rows
    begins = lines.first_bytes[first:stop]
    which = np.flatnonzero((begins != 0) & (begins < _LETTERS)) + first
    if len(which) == 0:
        raise lines.error(block.stop, "no rows follow this META_STOP: the text is cut off")
    days, seconds = lines.take_stamps(which)
    rows = lines.numbers(which, (6, 9), "a row")
    zero_s, since = tai_s(block["TIME_SYSTEM"].upper(), days, seconds)
    back = np.flatnonzero(np.diff(since) <= 0.0)
    if len(back):
        raise lines.error(
            int(which[back[0] + 1]),
            "this row is not later than the row before: rows must be in order of time",
        )
    lines.check_end(which)
    use = _use(lines, block, (zero_s, since), int(which[-1]))
    covariances = tuple(_covariances(lines, block, frame, zero_s))
    step = np.diff(since)
    away = np.maximum(np.linalg.norm(rows[:-1, :3], axis=1), 1.0)
    turn = step * np.linalg.norm(rows[:-1, 3:6], axis=1) / away
    usual = float(np.median(step)) if len(step) else 0.0
    missing = (step > _GAP * usual) & (turn > _GAP_RAD)
    whole = Segment(
        zero_s,
        since,
        rows[:, :3],
        rows[:, 3:6],
        frame,
        interpolation,
        use,
        why="the end of a segment",
        lines=lines.number_of(which),
    )
    parts = [whole.part(low, high, "a gap" if low else whole.why) for low, high in _stretches(step, missing)]
    parts = [one for one in parts if one.use_s[0] <= one.use_s[1]]
    return [replace(one, covariances=covariances if k == 0 else ()) for k, one in enumerate(parts)]


def _stretches(step: Array, missing: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the rows, first and one past the last, by which a polynomial may go.

    None goes across steps where rows are missing, nor from short steps to long ones: rows are close where
    engines burn, and what a burn does to a few of them does not go on for minutes. Such stretches share a
    row. A few steps that are shorter than those before and after them divide nothing.
    """
    changes = (np.flatnonzero(_uneven(step[1:], step[:-1]) & ~missing[1:] & ~missing[:-1]) + 1).tolist()
    shared: list[int] = []
    while changes:
        some = [changes.pop(0)]
        while changes and changes[0] - some[-1] < _USUAL.rows:
            some.append(changes.pop(0))
        before, after = float(step[some[0] - 1]), float(step[some[-1]])
        if _uneven(before, after):
            shared.append(some[-1] if after < before else some[0])
    firsts = np.sort(np.concatenate([[0], np.flatnonzero(missing) + 1, shared])).astype(np.intp)
    stops = firsts[1:] + np.isin(firsts[1:], shared)
    return list(zip(firsts.tolist(), [*stops.tolist(), len(step) + 1], strict=True))


def _uneven(one: Quantity, other: Quantity) -> NDArray[np.bool_]:
    """Tell where steps are not of one kind."""
    uneven: NDArray[np.bool_] = np.maximum(one, other) > _UNEVEN * np.minimum(one, other)
    return uneven


def _use(lines: Lines, block: _Block, times: tuple[float, Array], last: int) -> tuple[float, float]:
    """Return the seconds of use; refuse rows that end before the metadata say so."""
    zero_s, since = times
    seconds: dict[str, float] = {
        keyword: _since(lines, block, keyword, zero_s)
        for keyword in ("START_TIME", "STOP_TIME", "USEABLE_START_TIME", "USEABLE_STOP_TIME")
        if keyword in block.meta
    }
    start, stop = seconds["START_TIME"], seconds["STOP_TIME"]
    if stop < start:
        raise lines.error(block.line("STOP_TIME"), "STOP_TIME is before START_TIME")
    step = float(np.median(np.diff(since))) if len(since) > 1 else 0.0
    if float(since[-1]) < stop - max(1.5 * step, 1e-3):
        end = utc_of_tai(zero_s, float(since[-1])).isoformat("milliseconds")
        raise lines.error(
            last,
            f"the rows end at {end} (UTC), but STOP_TIME is "
            f"{block['STOP_TIME']}: the text is cut off; get the whole file",
        )
    first = seconds.get("USEABLE_START_TIME", start)
    final = seconds.get("USEABLE_STOP_TIME", stop)
    return max(first, float(since[0])), min(final, float(since[-1]))


def _covariances(lines: Lines, block: _Block, frame: Frame, zero_s: float) -> list[tuple[float, str, Array]]:
    """Return the covariance matrices: seconds after zero_s, axes and the whole matrix."""
    found = _whole_covariances(lines, block, frame, zero_s) if block.covariances else []
    return _each_covariance(lines, block, frame, zero_s) if found is None else found


def _whole_covariances(
    lines: Lines, block: _Block, frame: Frame, zero_s: float
) -> list[tuple[float, str, Array]] | None:
    """Return the covariance matrices of thousands of rows at once; None where anything is not as usual."""
    which = np.concatenate([np.arange(first + 1, stop) for first, stop in block.covariances])
    begins = lines.first_bytes[which]
    rows = which[(begins != 0) & (begins < _LETTERS)]
    epochs, values, axes = list[int](), list[str](), list[str]()
    for k in which[begins >= _LETTERS].tolist():
        text = lines.text(k)
        if text.startswith("EPOCH"):
            epochs.append(k)
            values.append(text.partition("=")[2].strip())
            axes.append(frame.written)
        elif text.startswith("COV_REF_FRAME"):
            if not epochs or np.searchsorted(rows, k) != _COVARIANCE_ROWS * (len(epochs) - 1):
                return None
            axes[-1] = printable(text.partition("=")[2].strip())
            if not _is_axes(axes[-1]):
                return None
    count = len(epochs)
    opened = np.array([first for first, _ in block.covariances])
    regular = len(rows) == _COVARIANCE_ROWS * count > 0 and np.array_equal(
        np.searchsorted(rows, epochs), _COVARIANCE_ROWS * np.arange(count)
    )
    if not regular or (np.searchsorted(opened, epochs) != np.searchsorted(opened, rows[5::6])).any():
        return None
    matrices = np.zeros((count, _COVARIANCE_ROWS, _COVARIANCE_ROWS))
    try:
        days, seconds = Lines("\n".join(values).encode(), lines.source).take_stamps(np.arange(count))
        for k in range(_COVARIANCE_ROWS):
            numbers = lines.numbers(rows[k::_COVARIANCE_ROWS], k + 1, "a covariance's row")
            matrices[:, k, : k + 1] = numbers
            matrices[:, : k + 1, k] = numbers
    except EphemerisError:
        return None
    if (np.einsum("nkk->nk", matrices) < 0.0).any():
        return None
    since = tai_after_s(block["TIME_SYSTEM"].upper(), days, seconds, zero_s)
    return list(zip(since.tolist(), axes, matrices, strict=True))


def _is_axes(name: str) -> bool:
    """Tell whether covariances may be in such axes: all are at right angles, so the trace is the same."""
    name = name.upper()
    return name in _FRAMES or bool(_ITRF.fullmatch(name) or _AXES.fullmatch(name))


def _each_covariance(
    lines: Lines, block: _Block, frame: Frame, zero_s: float
) -> list[tuple[float, str, Array]]:
    """Return the covariance matrices line by line. Raises EphemerisError, naming the line."""
    found = []
    for first, stop in block.covariances:
        at, axes, rows = None, frame.written, 0
        matrix = np.zeros((_COVARIANCE_ROWS, _COVARIANCE_ROWS))
        for k in range(first + 1, stop):
            text = lines.text(k)
            if not text or text.startswith("COMMENT"):
                continue
            if text.startswith(("EPOCH", "COV_REF_FRAME")):
                if rows:
                    raise lines.error(k, f"the covariance before has {rows} rows where 6 belong")
                value = text.partition("=")[2].strip()
                if text.startswith("COV_REF_FRAME"):
                    axes = printable(value)
                    if not _is_axes(axes):
                        raise lines.error(
                            k,
                            f"COV_REF_FRAME {axes!r} is not known: RTN, RSW, RIC, UVW, TNW, LVLH and the "
                            "frames of REF_FRAME are",
                        )
                else:
                    block.meta["EPOCH"] = (value, k)
                    at = _since(lines, block, "EPOCH", zero_s)
                    axes = frame.written
                continue
            if at is None:
                raise lines.error(k, "a covariance without an EPOCH before it")
            row = lines.numbers(np.array([k]), rows + 1, "a covariance's row")[0]
            matrix[rows, : rows + 1] = row
            matrix[: rows + 1, rows] = row
            rows += 1
            if row[-1] < 0.0:
                raise lines.error(k, f"a covariance's variance is negative: {row[-1]:g}")
            if rows == _COVARIANCE_ROWS:
                found.append((at, axes, matrix))
                at, rows, matrix = None, 0, np.zeros_like(matrix)
        if rows:
            raise lines.error(stop, f"the covariance before has {rows} rows where 6 belong")
    return found


_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
_COVARIANCE = tuple(f"C{row}_{column}" for k, row in enumerate(_STATE) for column in _STATE[: k + 1])
# A row of XML, its numbers being groups 2 to 8, and what may be from its end to the numbers of the next.
_XML_ROW = re.compile(
    rb"<(\w+:|)stateVector>\s*<\1EPOCH>(\s*[^<>&\s]+\s*)</\1EPOCH>"
    + b"".join(
        rb"\s*<\1%s(?:\s+units=\"[^<>&\"]*\")?>(\s*[^<>&\s]+\s*)</\1%s>" % (name, name)
        for name in (word.encode() for word in _STATE)
    )
    + rb"\s*</\1stateVector>"
)
_XML_NEXT = re.compile(rb"(\s*)<(?:\w+:|)stateVector>\s*<(?:\w+:|)EPOCH>")
_NUMBERS = 1 + len(_STATE)
# A byte that no XML has.
_LEFT_OUT = 1
_XML_HEAD, _XML_AT_ONCE = 1 << 16, 1 << 19


class _OemXml:
    """An OEM in XML as the lines of its KVN, with the line of the XML from which each comes."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.buffer_text = True
        self._text: list[str] = []
        self._values: dict[str, str] = {}
        self._begun = 0
        self._inside = ""
        self._lines: list[str] = []
        self._numbers: list[int] = []
        self._texts: list[bytes] = []
        self._part_lines: list[Index] = []
        # How many lines and bytes the parser did not see, and where the last row ended that it saw.
        self._skipped_lines, self._skipped, self._row_end = 0, 0, -1

    def run(self, data: bytes) -> tuple[bytearray, Index]:
        """Return a whole text as lines of KVN, and the line of the XML of each. Raises EphemerisError."""
        at = 0
        while (row := _XML_ROW.search(data, at)) is not None:
            self._parse(data[at : row.end()], False)
            at = row.end()
            # What looks like a row may be in a comment.
            if self._row_end + self._skipped == data.rindex(b"<", at - len(row[0]), at):
                at += self._take_rows(data, row)
            end = data.find(b"</%sdata" % row[1], at)
            self._parse(data[at : max(at, end)], False)
            at = max(at, end)
            if end < 0:
                break
        self._parse(data[at:], True)
        self._end_part()
        return bytearray().join(self._texts), np.concatenate(self._part_lines)

    def _parse(self, data: bytes, last: bool) -> None:
        try:
            self._parser.Parse(data, last)
        except expat.ExpatError as error:
            words = expat.ErrorString(error.code)
            line = error.lineno + self._skipped_lines
            raise EphemerisError(f"no XML: {words}", source=self._source, line=line) from None

    def _end_part(self) -> None:
        self._texts.append("".join(f"{line}\n" for line in self._lines).encode())
        self._part_lines.append(np.array(self._numbers, dtype=np.intp))
        self._lines.clear()
        self._numbers.clear()

    def _take_rows(self, data: bytes, row: re.Match[bytes]) -> int:
        """Take the rows after one that the parser has seen, while all is like it but for the numbers.

        Returns how many bytes they have, which the parser need not see.
        """
        after = _XML_NEXT.match(data, row.end())
        if after is None:
            return 0
        parts, lines, size = _rows_alike(data, row, after)
        if lines:
            first = self._begun + data.count(b"\n", row.start(), after.end(1))
            each = data.count(b"\n", row.end(2), after.end())
            self._end_part()
            self._texts += parts
            self._part_lines.append(first + each * np.arange(lines))
            self._skipped_lines += each * lines
            self._skipped += size
        return size

    def _refuse(self, *_: object) -> None:
        raise EphemerisError("a DOCTYPE has no place in an OEM", source=self._source, line=self._line)

    @property
    def _line(self) -> int:
        return self._parser.CurrentLineNumber + self._skipped_lines

    def _put(self, text: str, line: int) -> None:
        self._lines.append(text)
        self._numbers.append(line)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        self._text.clear()
        if name == "oem":
            self._put(f"CCSDS_OEM_VERS = {attributes.get('version', '')}", self._line)
        elif name == "metadata":
            self._put("META_START", self._line)
        elif name in ("stateVector", "covarianceMatrix"):
            self._inside, self._begun = name, self._line
            self._values.clear()
        elif "units" in attributes and name in _STATE:
            right = "km/s" if name.endswith("_DOT") else "km"
            if attributes["units"].casefold() != right:
                units = printable(attributes["units"])
                raise EphemerisError(
                    f"{name} is in {units!r}: an OEM has {right}", source=self._source, line=self._line
                )

    def _characters(self, text: str) -> None:
        self._text.append(text)

    def _end(self, tag: str) -> None:
        name = tag.rpartition(":")[2]
        text = " ".join("".join(self._text).split())
        self._text.clear()
        if name == "metadata":
            self._put("META_STOP", self._line)
        elif name == "stateVector":
            self._put(" ".join((self._of("EPOCH"), *map(self._of, _STATE))), self._begun)
            self._row_end = self._parser.CurrentByteIndex
            self._inside = ""
        elif name == "covarianceMatrix":
            self._put_covariance()
            self._inside = ""
        elif self._inside:
            self._values[name] = text
        elif name not in ("oem", "header", "body", "segment", "data", "COMMENT", "ndm"):
            self._put(f"{name} = {text}", self._line)

    def _put_covariance(self) -> None:
        self._put("COVARIANCE_START", self._begun)
        self._put(f"EPOCH = {self._of('EPOCH')}", self._begun)
        if "COV_REF_FRAME" in self._values:
            self._put(f"COV_REF_FRAME = {self._values['COV_REF_FRAME']}", self._begun)
        values = iter(_COVARIANCE)
        for row in range(1, _COVARIANCE_ROWS + 1):
            self._put(" ".join(self._of(next(values)) for _ in range(row)), self._begun)
        self._put("COVARIANCE_STOP", self._line)

    def _of(self, name: str) -> str:
        value = self._values.get(name, "")
        if not value:
            raise EphemerisError(f"{self._inside} has no {name}", source=self._source, line=self._begun)
        return value


def _rows_alike(data: bytes, row: re.Match[bytes], after: re.Match[bytes]) -> tuple[list[bytes], int, int]:
    """Return the rows after one that are like it but for the numbers: as KVN, how many, and their bytes.

    `after` is what is between that row and the numbers of the next.
    """
    between = [data[row.end(k) : row.start(k + 1)] for k in range(2, 1 + _NUMBERS)]
    between.append(data[row.end(1 + _NUMBERS) : after.end()])
    if any(text.count(b"\r") != text.count(b"\r\n") for text in between):
        return [], 0, 0
    parts, count, at, size = [], 0, after.end(), 4 * len(row[0])
    while size > len(row[0]):
        cut = data.rfind(between[-1], at, at + size) + len(between[-1])
        text, rows = _kvn_of_rows(data, at, cut, between)
        if rows:
            parts.append(text)
            count += rows
            at, size = cut, min(2 * size, _XML_AT_ONCE)
        else:
            size //= 2
    return parts, count, at - after.end()


def _kvn_of_rows(data: bytes, first: int, end: int, between: list[bytes]) -> tuple[bytes, int]:
    """Return rows of numbers as KVN and how many they are, 0 where other than `between` follows a number."""
    raw = np.frombuffer(data, dtype=np.uint8)[first:end].copy()
    tags = np.flatnonzero(raw == ord("<"))
    each = [words.count(b"<") for words in between]
    rows, more = divmod(len(tags), sum(each))
    if more or not rows:
        return b"", 0
    begins = tags.reshape(rows, -1)[:, np.cumsum([0, *each[:-1]])]
    ends = begins + [len(words) for words in between]
    if (begins.ravel()[1:] <= ends.ravel()[:-1]).any() or begins[0, 0] == 0 or ends[-1, -1] != len(raw):
        return b"", 0
    for words, begin, mark in zip(between, begins.T, b" " * (_NUMBERS - 1) + b"\n", strict=True):
        # A window that can be written on, at every byte.
        seen = np.ndarray((len(raw) - len(words) + 1, len(words)), np.uint8, raw, strides=(1, 1))
        if seen[begin].tobytes() != words * rows:
            return b"", 0
        seen[begin] = _LEFT_OUT
        raw[begin] = mark
    found = raw.tobytes().translate(None, bytes([_LEFT_OUT]))
    # No number is two, nor has a meaning in XML; blanks about one are none of its own.
    inked = raw > ord(" ")
    count = int(np.count_nonzero(inked[1:] & ~inked[:-1])) + int(inked[0])
    right = count == rows * _NUMBERS and found.count(b"\n") == rows and found.isascii()
    right = right and not any(byte in found for byte in b"&>")
    return found, rows if right else 0


def _from_meme(lines: Lines, first: int) -> Lines:
    """Return an ephemeris of Starlink's operator as lines of KVN that know where they come from.

    Three lines of header, the axes of the covariances, then four lines a row: time, place (km) and velocity
    (km/s) by the mean equator and equinox of J2000, and the 21 numbers of the covariance. The object's name
    and number are in the file's name. Raises EphemerisError.
    """
    named = _MEME_NAME.search(lines.source)
    number, name = (named[1], named[2]) if named else ("unknown", "an object without a name")
    stop = _MEME_STOP.search(lines.text(first + 1)) if first + 1 < len(lines) else None
    if stop is None or lines.text(first + 3) != "UVW":
        raise lines.error(
            first + 1, "ephemeris_stop or UVW is missing: it is no ephemeris of Starlink's operator"
        )
    put: list[tuple[str, int]] = []
    covariances: list[tuple[str, int]] = []
    for k in range(first + 4, lines.last + 1, 4):
        stamp, _, state = lines.text(k).partition(" ")
        match = _MEME_STAMP.fullmatch(stamp)
        if match is None or k + 3 > lines.last:
            raise lines.error(
                k, f"{printable(stamp[:24])!r} begins no whole row of four lines: it is cut off"
            )
        year, day, hour, minute, second = match.groups()
        at = f"{year}-{day}T{hour}:{minute}:{second}"
        put.append((f"{at} {state}", k))
        numbers = iter(" ".join(lines.text(k + j) for j in (1, 2, 3)).split())
        covariances += [("COVARIANCE_START", k), (f"EPOCH = {at}", k), ("COV_REF_FRAME = UVW", k)]
        rows = [[next(numbers, "") for _ in range(row)] for row in range(1, _COVARIANCE_ROWS + 1)]
        covariances += [(" ".join(row), k + 1) for row in rows] + [("COVARIANCE_STOP", k + 3)]
    if not put:
        raise lines.error(lines.last, "no rows follow UVW: the text is cut off")
    made = lines.text(first).removeprefix(_MEME).removesuffix("UTC").strip()
    head = (
        "CCSDS_OEM_VERS = 2.0",
        f"CREATION_DATE = {made.replace(' ', 'T')}",
        "ORIGINATOR = its operator",
        "META_START",
        f"OBJECT_NAME = {name}",
        f"OBJECT_ID = {number}",
        "CENTER_NAME = EARTH",
        "REF_FRAME = EME2000",
        "TIME_SYSTEM = UTC",
        f"START_TIME = {put[0][0].split()[0]}",
        f"STOP_TIME = {stop[1]}T{stop[2]}",
        "META_STOP",
    )
    whole = [*((line, first + 1) for line in head), *put, *covariances]
    text = "".join(f"{line}\n" for line, _ in whole)
    return Lines(text.encode(), lines.source, [lines.number(k) for _, k in whole])

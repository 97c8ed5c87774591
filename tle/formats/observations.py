"""Observed directions from files: CSV, IOD, CCSDS TDM and JSON lines, recognised by content; and stations.

CSV: utc, ra_deg, dec_deg and, if known, frame, station, object and uncertainties. IOD: the format of
satellite observers (G. Lewis, 1998, clarified 2002), RA and Dec only. TDM: RA and Dec of a Tracking Data
Message (CCSDS 503.0-B-2), KVN or XML. TDM has no keyword for the uncertainty of angles: a comment in a
segment's metadata gives it for the whole segment, one sigma on the sky: `COMMENT SIGMA_ARCSEC = 20`.
JSON lines: the observations that a run takes, or what `sattrack camera --json` prints, an object a line;
lines of another type are skipped, and frames without a place among the stars.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from tle.errors import ObservationError, SiteError, SourceError, TimeFormatError
from tle.instants import Utc, as_utc
from tle.observed import BiasEstimate, Frame, bias_from_observation
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tle.earth import EarthOrientation
    from tle.elements import Elements

DEFAULT_SIGMA_ARCSEC = 1.0
# The number has five columns; programs that print one of six digits move all others by one.
_IOD_LINE = re.compile(
    r"([ 0-9A-HJ-NP-Z][ 0-9]{4}|[1-9]\d{5}) [ 0-9]{2} [ 0-9]{3}[ A-Z]{3} \d{4} [A-Z ] \d{8}", re.ASCII
)
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
_NEEDED = ("utc", "ra_deg", "dec_deg")
_KNOWN = (
    *_NEEDED,
    "frame",
    "station",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "object",
    "sigma_arcsec",
    "sigma_time_s",
)
_FRAMES: dict[str, Frame] = {
    "EME2000": "j2000",
    "J2000": "j2000",
    "ICRF": "icrf",
    "GCRF": "icrf",
    "TOD": "of_date",
}
_SIGMA = re.compile(r"SIGMA_ARCSEC\s*=\s*(\S+)")


@dataclass(frozen=True, slots=True)
class Observation:
    """A satellite's direction at an instant, as seen from a station.

    `object_key` is a catalogue number, designator or name, or "" where the source names none. The standard
    deviations are None where the source gives none. `source` and `line` say where it was read.
    """

    utc: Utc
    ra_deg: float
    dec_deg: float
    frame: Frame
    site: Site
    object_key: str = ""
    sigma_arcsec: float | None = None
    sigma_time_s: float | None = None
    source: str = ""
    line: int | None = None

    def __post_init__(self) -> None:
        """Check that the direction is one. Raises ObservationError."""
        object.__setattr__(self, "utc", as_utc(self.utc))
        if not -90.0 <= self.dec_deg <= 90.0:
            raise self.error(f"a declination of {self.dec_deg}° is outside -90° to 90°")
        if not 0.0 <= self.ra_deg <= 360.0:
            raise self.error(f"a right ascension of {self.ra_deg}° is outside 0° to 360°")
        for sigma in (self.sigma_arcsec, self.sigma_time_s):
            if sigma is not None and not (sigma >= 0.0 and math.isfinite(sigma)):
                raise self.error(f"an uncertainty of {sigma} is negative or no number")

    def error(self, reason: str) -> ObservationError:
        """Return an exception that says where the observation was read."""
        return ObservationError(placed(self.source, self.line, reason))

    def residual(self, elements: Elements, earth: EarthOrientation | None = None) -> BiasEstimate:
        """Return what the observation says of the elements: seconds along the track, degrees across it.

        Raises ObservationError naming the source where no bias along the track leads there.
        """
        from tle.propagator import Propagator

        try:
            return bias_from_observation(
                Propagator(elements, self.site, earth=earth),
                self.ra_deg,
                self.dec_deg,
                self.utc,
                self.frame,
                DEFAULT_SIGMA_ARCSEC if self.sigma_arcsec is None else self.sigma_arcsec,
                self.sigma_time_s or 0.0,
            )
        except ObservationError as error:
            raise self.error(f"{error}") from None


@dataclass(frozen=True, slots=True)
class Stations:
    """Sites by the name that observations give them, and the one for observations that name none.

    It is also that of a name which is not among them, unless they are a list of `all` stations.
    """

    by_name: Mapping[str, Site]
    default: Site | None = None
    all: bool = False

    def find(self, name: str) -> Site | None:
        """Return the site of a station, or the default site; None where there is none."""
        return self.by_name.get(name.strip(), None if self.all and name.strip() else self.default)


def read_observations(path: str | Path, stations: Stations) -> list[Observation]:
    """Return the observations in a file of CSV, IOD, CCSDS TDM (KVN or XML) or JSON lines.

    Raises SourceError where the file cannot be read, ObservationError where it, or one of them, is wrong.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig", errors="replace")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SourceError(f"{path}: cannot read observations: {reason}") from None
    return parse_observations(text, stations, str(path))


def placed(source: str, line: int | None, reason: str) -> str:
    """Return a reason with the file and line it is about."""
    if source and line:
        return f"{source}:{line}: {reason}"
    return f"{source}: {reason}" if source else reason


def parse_observations(text: str, stations: Stations, source: str = "") -> list[Observation]:
    """Return the observations in a text of CSV, IOD, CCSDS TDM or JSON lines. Raises ObservationError."""
    if text.lstrip().startswith("{"):
        found = _read_json_lines(text, stations, source)
    elif "CCSDS_TDM_VERS" in text or "<tdm" in text:
        found = _read_tdm(text, stations, source)
    elif _looks_like_iod(text):
        found = _read_iod(text, stations, source)
    elif _looks_like_csv(text):
        found = _read_csv(text, stations, source)
    else:
        raise ObservationError(
            placed(
                source,
                None,
                "holds no observations: give CSV with utc, ra_deg and dec_deg, IOD, TDM, or JSON lines",
            )
        )
    if not found:
        raise ObservationError(
            placed(source, None, "holds no observations of RA and Dec, and no other kinds are read")
        )
    return found


def read_stations(path: str | Path, default: Site | None = None) -> Stations:
    """Return the stations of an observers' list: number, initials, latitude and longitude in degrees, metres.

    `default` is the site for observations that name no station. Blank lines and `#` comments are skipped.
    Raises SourceError, ObservationError for a bad line.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise SourceError(f"{path}: cannot read stations: {error.strerror}") from None
    number = r"[+-]?\d+\.?\d*"
    line_format = re.compile(rf"(\S+) +\S+ +({number}) +({number}) +({number})(?: .*)?", re.ASCII)
    sites = {}
    for at, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        match = line_format.fullmatch(line.expandtabs().strip())
        if match is None:
            raise ObservationError(
                placed(str(path), at, "is no station: write number, initials, latitude, longitude, height")
            )
        try:
            sites[match.group(1)] = Site(*(float(g) for g in match.groups()[1:]))
        except SiteError as error:
            raise ObservationError(placed(str(path), at, str(error))) from None
    return Stations(sites, default, all=True)


def site_of(stations: Stations, name: str, source: str, line: int | None) -> Site:
    """Return a station's site. Raises ObservationError where it is unknown and there is no default."""
    site = stations.find(name)
    if site is None:
        trouble = f"station {name.strip()!r} is not known" if name.strip() else "no station is named"
        do = "give a list of stations, or a site"
        if stations.all:
            do = "add it to the list of stations" if name.strip() else "give a site"
        raise ObservationError(placed(source, line, f"{trouble}: {do}"))
    return site


def _looks_like_iod(text: str) -> bool:
    """Tell whether any line of a text is an observation of this format."""
    return any(_IOD_LINE.match(line) for line in text.splitlines())


def _read_iod(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the observations with a position; lines of station status and brightness alone are skipped.

    Lines that are not of the format, as the mail around them, are skipped too. Raises ObservationError.
    """
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        match = _IOD_LINE.match(line)
        if match is None:
            continue
        usual = line[len(match[1]) - 5 :]
        if usual[_HAS_POSITION:54].strip():
            found.append(_iod_observation(match[1], usual, stations, source, number))
    return found


def _iod_observation(
    object_number: str, line: str, stations: Stations, source: str, number: int
) -> Observation:
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
        utc = _iod_time(line[23:40])
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
        object_number.strip().lstrip("0") or designator,
        None if sigma_arcsec is None else sigma_arcsec * unit_arcsec,
        sigma_time_s,
        source,
        number,
    )


def _iod_time(field: str) -> Utc:
    text = field.ljust(17).replace(" ", "0")
    if not re.fullmatch(r"\d{17}", text, re.ASCII):
        raise TimeFormatError(f"{field!r} is no YYYYMMDDHHMMSSsss")
    date = f"{text[:4]}-{text[4:6]}-{text[6:8]}"
    return Utc.parse(f"{date}T{text[8:10]}:{text[10:12]}:{text[12:14]}.{text[14:]}Z")


def _angle(field: str, places: str) -> float | None:
    """Return degrees of digits whose meaning `places` gives letter by letter; blanks at the end are zeros.

    None for what are no digits, and for 60 minutes or seconds and more: those are digits of another meaning.
    """
    text = field.ljust(len(places)).rstrip().ljust(len(places), "0")
    if not re.fullmatch(r"\d+", text, re.ASCII):
        return None
    value, rest, minutes, seconds = float(text[:2]), places[2:], 0.0, 0.0
    if rest.startswith("d"):
        value += float(f"0.{text[2:]}")
    elif rest.startswith("MMm"):
        minutes = float(f"{text[2:4]}.{text[4:]}")
    else:
        minutes, seconds = float(text[2:4]), float(f"{text[4:6]}.{text[6:] or 0}")
    if max(minutes, seconds) >= 60.0:
        return None
    return (value + minutes / 60.0 + seconds / 3600.0) * _UNITS[places[0]]


def _uncertainty(field: str) -> float | None:
    """Return the number that MX stands for: M times ten to the power of X - 8."""
    if not re.fullmatch(r"\d\d", field, re.ASCII):
        return None
    return float(int(field[0]) * 10.0 ** (int(field[1]) - 8))


def _looks_like_csv(text: str) -> bool:
    """Tell whether the first line that is no comment names the columns that are needed."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            return set(_NEEDED) <= set(_names(line))
    return False


def _names(line: str) -> list[str]:
    """Return the names of the columns, with quotes about them or without."""
    return [name.strip(' "') for name in line.split(",")]


def _read_csv(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the observations. Raises ObservationError.

    `frame` is icrf (the default; or icrs), j2000, gcrs or of_date.
    """
    lines = text.splitlines()
    kept = [(n, line) for n, line in enumerate(lines, start=1) if line.strip() and not line.startswith("#")]
    header = _names(kept[0][1])
    unknown = [name for name in header if name not in _KNOWN]
    if unknown:
        raise ObservationError(
            placed(source, kept[0][0], f"column {unknown[0]!r} is not known: use {', '.join(_KNOWN)}")
        )
    found = []
    for number, line in kept[1:]:
        try:
            cells = next(csv.reader(io.StringIO(line)))
        except csv.Error as error:
            raise ObservationError(placed(source, number, str(error))) from None
        if len(cells) != len(header):
            raise ObservationError(
                placed(source, number, f"has {len(cells)} columns, the header {len(header)}")
            )
        row = {name: cell.strip() for name, cell in zip(header, cells, strict=True)}
        found.append(_csv_observation(row, stations, source, number))
    return found


def _csv_observation(row: Mapping[str, str], stations: Stations, source: str, line: int) -> Observation:
    frame = row.get("frame") or "icrf"
    frame = "icrf" if frame == "icrs" else frame
    if frame not in get_args(Frame):
        raise ObservationError(
            placed(source, line, f"{frame!r} is no frame: use one of {', '.join(get_args(Frame))}")
        )
    try:
        utc = Utc.parse(row["utc"])
    except TimeFormatError as error:
        raise ObservationError(placed(source, line, str(error))) from None
    numbers = {name: _number(row, name, source, line) for name in _KNOWN if name.endswith(("_deg", "_m"))}
    ra_deg, dec_deg = numbers["ra_deg"], numbers["dec_deg"]
    if ra_deg is None or dec_deg is None:
        raise ObservationError(placed(source, line, "ra_deg or dec_deg is empty: give both, in degrees"))
    latitude, longitude = numbers["latitude_deg"], numbers["longitude_deg"]
    if (latitude is None) != (longitude is None):
        raise ObservationError(placed(source, line, "latitude_deg or longitude_deg is empty: give both"))
    if latitude is not None and longitude is not None:
        try:
            site = Site(latitude, longitude, numbers["height_m"] or 0.0)
        except SiteError as error:
            raise ObservationError(placed(source, line, str(error))) from None
    else:
        site = site_of(stations, row.get("station", ""), source, line)
    return Observation(
        utc,
        ra_deg,
        dec_deg,
        frame,  # type: ignore[arg-type] # one of the frames, as checked above
        site,
        row.get("object", ""),
        _number(row, "sigma_arcsec", source, line),
        _number(row, "sigma_time_s", source, line),
        source,
        line,
    )


def _read_json_lines(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the observations; `frame` is icrs (default), j2000, gcrs or of_date. Raises ObservationError."""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ObservationError(placed(source, number, f"is no JSON: {error}")) from None
        if not isinstance(row, dict):
            raise ObservationError(placed(source, number, "is no JSON object"))
        # A camera's frame of which no place among the stars is known has none.
        unsolved = "kind" in row and row.get("ra_deg") is None
        if row.get("type", "observation") != "observation" or unsolved:
            continue
        missing = [name for name in _NEEDED if row.get(name) is None]
        if missing:
            raise ObservationError(placed(source, number, f"{missing[0]} is missing"))
        texts = {name: "" if value is None else str(value) for name, value in row.items()}
        texts["object"] = texts.get("catalog_number", "")
        found.append(_csv_observation(texts, stations, source, number))
    return found


def _number(row: Mapping[str, str], name: str, source: str, line: int) -> float | None:
    text = row.get(name, "")
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise ObservationError(placed(source, line, f"{name} {text!r} is no number")) from None


@dataclass(slots=True)
class _Segment:
    """The metadata of one segment, and its data as (line, keyword, epoch, value)."""

    meta: dict[str, str] = field(default_factory=dict)
    data: list[tuple[int | None, str, str, str]] = field(default_factory=list)
    sigma_arcsec: float | None = None

    def take_comment(self, text: str, source: str, line: int | None) -> None:
        """Take the uncertainty where a comment says one. Raises ObservationError where that is no number."""
        match = _SIGMA.fullmatch(text.strip())
        if match is None:
            return
        try:
            self.sigma_arcsec = float(match[1])
        except ValueError:
            raise ObservationError(placed(source, line, f"SIGMA_ARCSEC is {match[1]!r}: no number")) from None


def _read_tdm(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the pairs of RA and Dec of every segment whose angles are RADEC. Raises ObservationError."""
    read = _from_xml if text.lstrip().startswith("<") else _from_kvn
    segments = read(text, source)
    return [one for segment in segments for one in _tdm_observations(segment, stations, source)]


def _from_kvn(text: str, source: str) -> list[_Segment]:
    segments: list[_Segment] = []
    part = "header"
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line:
            continue
        if line.split()[0] == "COMMENT":
            if part == "META_START":
                segments[-1].take_comment(line.removeprefix("COMMENT"), source, number)
            continue
        if line in ("META_START", "META_STOP", "DATA_START", "DATA_STOP"):
            part = line
            if part == "META_START":
                segments.append(_Segment())
            continue
        key, equals, value = (piece.strip() for piece in line.partition("="))
        if not equals:
            raise ObservationError(placed(source, number, f"{line!r} is no KEYWORD = value"))
        if part == "META_START":
            segments[-1].meta[key] = value
        elif part == "DATA_START":
            epoch, _, measured = value.partition(" ")
            if not segments:
                raise ObservationError(placed(source, number, "data without metadata before them"))
            segments[-1].data.append((number, key, epoch, measured.strip()))
    return segments


def _from_xml(text: str, source: str) -> list[_Segment]:
    from xml.etree import ElementTree

    from tle.formats.omm_notations import DOCTYPE_REFUSED

    class Builder(ElementTree.TreeBuilder):
        """Makes the elements of a text that declares no document type."""

        def doctype(self, *_: object) -> None:
            raise ObservationError(placed(source, None, DOCTYPE_REFUSED))

    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=Builder()))
    except (ElementTree.ParseError, ValueError) as error:
        raise ObservationError(placed(source, None, f"is no XML: {error}")) from None
    segments = []
    for element in root.iter("segment"):
        meta = {child.tag: (child.text or "").strip() for child in element.iterfind("metadata/*")}
        segment = _Segment(meta)
        for comment in element.iterfind("metadata/COMMENT"):
            segment.take_comment(comment.text or "", source, None)
        for observed in element.iterfind("data/observation"):
            epoch = (observed.findtext("EPOCH") or "").strip()
            segment.data += [
                (None, child.tag, epoch, (child.text or "").strip())
                for child in observed
                if child.tag != "EPOCH"
            ]
        segments.append(segment)
    return segments


def _tdm_observations(segment: _Segment, stations: Stations, source: str) -> list[Observation]:
    meta = segment.meta
    if meta.get("ANGLE_TYPE") != "RADEC":
        return []
    first = segment.data[0][0] if segment.data else None
    if meta.get("TIME_SYSTEM", "UTC") != "UTC":
        raise ObservationError(placed(source, first, f"time system {meta['TIME_SYSTEM']} is not UTC"))
    frame = _FRAMES.get(meta.get("REFERENCE_FRAME", ""))
    if frame is None:
        given = meta.get("REFERENCE_FRAME", "none")
        raise ObservationError(
            placed(source, first, f"reference frame {given} is none of {', '.join(_FRAMES)}")
        )
    station, seen = _participants(meta, stations)
    # Corrections that are told only; others are in the data.
    left = meta if meta.get("CORRECTIONS_APPLIED") == "NO" else {}
    found = []
    right_ascensions = {epoch: value for _, key, epoch, value in segment.data if key == "ANGLE_1"}
    for line, key, epoch, value in segment.data:
        if key != "ANGLE_2":
            continue
        if epoch not in right_ascensions:
            raise ObservationError(placed(source, line, f"ANGLE_2 at {epoch} has no ANGLE_1"))
        try:
            ra_deg = float(right_ascensions[epoch]) + float(left.get("CORRECTION_ANGLE_1", 0.0))
            dec_deg = float(value) + float(left.get("CORRECTION_ANGLE_2", 0.0))
            utc = Utc.parse(epoch)
        except (ValueError, TimeFormatError) as error:
            raise ObservationError(placed(source, line, str(error))) from None
        site = site_of(stations, station, source, line)
        found.append(
            Observation(
                utc,
                ra_deg % 360.0,
                dec_deg,
                frame,
                site,
                seen,
                sigma_arcsec=segment.sigma_arcsec,
                source=source,
                line=line,
            )
        )
    return found


def _participants(meta: dict[str, str], stations: Stations) -> tuple[str, str]:
    """Return the names of the station and of the satellite: the station is the one that the stations know.

    Where they know none, it is the last of the signal's path, where the light arrives.
    """
    names = [meta[key] for key in sorted(meta) if key.startswith("PARTICIPANT_")]
    known = [name for name in names if name in stations.by_name]
    if known:
        station = known[0]
    else:
        path = [int(p) for p in re.findall(r"\d+", meta.get("PATH", ""))]
        station = names[path[-1] - 1] if path and 0 < path[-1] <= len(names) else (names or [""])[0]
    others = [name for name in names if name != station]
    return station, others[0] if others else ""

"""RA and Dec from a CCSDS Tracking Data Message (CCSDS 503.0-B-2), KVN or XML.

The standard has no keyword for the uncertainty of angles. A comment in a segment's metadata says it for the
whole segment, as sattrack writes it: `COMMENT SIGMA_ARCSEC = 20`, one sigma on the sky.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import date
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from tle.errors import ObservationError, TimeFormatError
from tle.instants import DAY_S, Utc
from tle.observations import Observation, Stations, placed, site_of

if TYPE_CHECKING:
    from tle.residuals import Frame

_FRAMES: dict[str, Frame] = {
    "EME2000": "j2000",
    "J2000": "j2000",
    "ICRF": "icrf",
    "GCRF": "icrf",
    "TOD": "of_date",
}
_SIGMA = re.compile(r"SIGMA_ARCSEC\s*=\s*(\S+)")
_DAY_OF_YEAR = re.compile(r"(\d{4})-(\d{3})(T.*)?", re.ASCII)


@dataclass(slots=True)
class Segment:
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


def parse_text(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the pairs of RA and Dec of every segment whose angles are RADEC. Raises ObservationError."""
    read = _from_xml if text.lstrip().startswith("<") else _from_kvn
    segments = read(text, source)
    return [one for segment in segments for one in _observations(segment, stations, source)]


def _from_kvn(text: str, source: str) -> list[Segment]:
    segments: list[Segment] = []
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
                segments.append(Segment())
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


def _from_xml(text: str, source: str) -> list[Segment]:
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ObservationError(placed(source, None, f"is no XML: {error}")) from None
    segments = []
    for element in root.iter("segment"):
        meta = {child.tag: (child.text or "").strip() for child in element.iterfind("metadata/*")}
        segment = Segment(meta)
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


def _observations(segment: Segment, stations: Stations, source: str) -> list[Observation]:
    meta = segment.meta
    if meta.get("ANGLE_TYPE") != "RADEC":
        return []
    first = segment.data[0][0] if segment.data else None
    if meta.get("TIME_SYSTEM", "UTC") != "UTC":
        raise ObservationError(placed(source, first, f"time system {meta['TIME_SYSTEM']} is not UTC"))
    frame = _FRAMES.get(meta.get("REFERENCE_FRAME", ""))
    if frame is None:
        told = meta.get("REFERENCE_FRAME", "none")
        raise ObservationError(
            placed(source, first, f"reference frame {told} is none of {', '.join(_FRAMES)}")
        )
    station, seen = _participants(meta, stations)
    found = []
    right_ascensions = {epoch: value for _, key, epoch, value in segment.data if key == "ANGLE_1"}
    for line, key, epoch, value in segment.data:
        if key != "ANGLE_2":
            continue
        if epoch not in right_ascensions:
            raise ObservationError(placed(source, line, f"ANGLE_2 at {epoch} has no ANGLE_1"))
        try:
            ra_deg, dec_deg, utc = float(right_ascensions[epoch]), float(value), _time(epoch)
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


def _time(text: str) -> Utc:
    """Return the instant of a calendar date or of a day of the year."""
    match = _DAY_OF_YEAR.fullmatch(text)
    if match is None:
        return Utc.parse(text)
    year, day, clock = match.groups()
    start = Utc.parse(f"{date(int(year), 1, 1).isoformat()}{clock or ''}")
    return start.plus((int(day) - 1) * DAY_S)

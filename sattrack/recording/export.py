"""A recording in other forms: tables (CSV, JSON, Parquet), pcapng for Wireshark, a CCSDS message, anonymous.

An anonymous recording is moved to another longitude and hour, so that it can be shown and still be run again.
Labels alone hide nothing: sidereal time with UTC gives the longitude, and so do directions to a satellite
with its elements. So the site moves round the Earth's axis, and all instants with the sidereal time that it
has there: right ascensions, hour angles and every datagram stay what they were. What cannot be moved is
in docs/recordings.md: the latitude, and the orbit's own numbers.
"""

from __future__ import annotations

import csv
import math
import re
import secrets
import struct
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import erfa
import msgspec
import numpy as np

from sattrack import __version__
from sattrack.control.stages import RunStage
from sattrack.core.angles import wrap180
from sattrack.core.errors import NO_JSON, BadInputError, needed
from sattrack.mount.xerxes.datagrams import (
    COMMAND_FIELDS,
    STATUS_FIELDS,
    STATUS_LENGTH,
    DatagramError,
    decode_command,
    decode_status,
)
from sattrack.recording.format import (
    COMMAND,
    FAILURE,
    GAP,
    OPERATOR,
    REPEAT,
    STATUS,
    SUMMARY,
    VIEW,
    messages,
    observations,
    to_ns,
)
from sattrack.recording.recorder import Recorder
from sattrack.recording.trace import trace
from sattrack.views.messages import FRAMES, ObservationMessage, SolvedField
from tle.earth import EarthOrientation, to_tirs
from tle.errors import ObservationError
from tle.instants import Utc
from tle.observed import apparent_unit, bias_from_observation
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path
    from typing import BinaryIO

    from numpy.typing import NDArray

    from sattrack.control.engine import Engine
    from sattrack.recording.format import Recording
    from sattrack.recording.trace import Trace
    from tle.elements import Elements
    from tle.propagator import Propagator

    Columns = dict[str, list[Any]]

ERROR = "error"
TABLES = ("status", "command", "operator", "view", ERROR)
_STATUS = tuple(f.name for f in STATUS_FIELDS[1:])
_COMMAND = tuple(f.name for f in COMMAND_FIELDS[1:])
Row = dict[str, Any]


def rows(recording: Recording, table: str) -> Iterator[Row]:
    """Give a table's rows: instants as ISO 8601 UTC and as POSIX seconds, fields by the names of the paper.

    `status` (by arrival), `command` (with what was sent once more), `operator` (by arrival; `message_utc` is
    the instant that a message is about), `view`. Datagrams and messages that are none are left out.
    """
    for entry in recording.entries():
        row: Row = {"utc": Utc(entry.utc_s).isoformat("microseconds"), "utc_s": entry.utc_s}
        try:
            if table == "status" and entry.topic == STATUS:
                status = decode_status(entry.data)
                yield row | {name: getattr(status, name) for name in _STATUS}
            elif table == "command" and entry.topic in {COMMAND, REPEAT}:
                command = decode_command(entry.data)
                again = {"repeated": entry.topic == REPEAT}
                yield row | again | {name: getattr(command, name) for name in _COMMAND}
            elif entry.topic == table and table in {OPERATOR, VIEW}:
                value = msgspec.json.decode(entry.data)
                if isinstance(value, dict):
                    if "utc" in value:
                        value["message_utc"] = value.pop("utc")
                    yield row | flat(value)
        except (DatagramError, msgspec.MsgspecError, *NO_JSON):
            continue


def flat(value: Row, prefix: str = "") -> Row:
    """Return a JSON object as one level: the names of nested fields joined by dots, lists as JSON."""
    found: Row = {}
    for name, item in value.items():
        if isinstance(item, dict):
            found |= flat(item, f"{prefix}{name}.")
        elif isinstance(item, list):
            found[prefix + name] = msgspec.json.encode(item).decode()
        else:
            found[prefix + name] = item
    return found


def error_columns(run: Trace) -> dict[str, list[Any]]:
    """Return the error at every status, and what the run did then.

    A report's figures count the rows in which `doing` is "following". Arcseconds on the sky; along is
    positive where the mount leads, across to the left of the motion.
    """
    return {
        "utc": [Utc(utc_s).isoformat("microseconds") for utc_s in run.utc_s.tolist()],
        "utc_s": run.utc_s.tolist(),
        "arrival_utc_s": run.arrival_utc_s.tolist(),
        "total_arcsec": run.total.tolist(),
        "along_arcsec": run.along.tolist(),
        "across_arcsec": run.across.tolist(),
        "ra_arcsec": run.ra_error.tolist(),
        "dec_arcsec": run.dec_error.tolist(),
        "doing": [RunStage(what).name.lower() for what in run.doing.tolist()],
        "held_by": run.held.tolist(),
    }


def table_of(recording: Recording, table: str) -> dict[str, list[Any]]:
    """Return a table by columns; rows that lack a column have None there. Without rows it has two columns."""
    found = list(rows(recording, table))
    names = dict.fromkeys(("utc", "utc_s", *(name for row in found for name in row)))
    return {name: [row.get(name) for row in found] for name in names}


CLIENT, MOUNT = (bytes((192, 0, 2, 1)), 15001), (bytes((192, 0, 2, 2)), 15002)
"""Addresses for documentation (RFC 5737): a recording does not hold the real ones."""
_RAW_IP = 101
_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 1, 6
_COMMENT = 1


def write_pcapng(recording: Recording, path: Path) -> None:
    """Write every datagram as a UDP packet with its instant; raises BadInputError where that cannot be.

    Statuses have the instant of their arrival, commands that of their tick. The operator's messages
    are comments of the next command. Layout: PCAP Next Generation (draft-ietf-opsawg-pcapng), LINKTYPE_RAW.
    """
    section = _block(_SECTION, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    nanoseconds = struct.pack("<HHB3x", 9, 1, 9) + bytes(4)
    parts = [section, _block(_INTERFACE, struct.pack("<HHI", _RAW_IP, 0, 65535) + nanoseconds)]
    comments: list[bytes] = []
    for entry in recording.entries():
        if entry.topic == OPERATOR:
            comments.append(entry.data)
        elif entry.topic == STATUS:
            parts.append(_packet(entry.utc_s, _udp(MOUNT, CLIENT, entry.data), ()))
        elif entry.topic in {COMMAND, REPEAT}:
            parts.append(_packet(entry.utc_s, _udp(CLIENT, MOUNT, entry.data), comments))
            comments = []
    _write(path, b"".join(parts))


def _block(kind: int, body: bytes) -> bytes:
    length = len(body) + 12
    return struct.pack("<II", kind, length) + body + struct.pack("<I", length)


def _packet(utc_s: float, data: bytes, comments: tuple[()] | list[bytes]) -> bytes:
    at = max(0, to_ns(utc_s))
    head = struct.pack("<IIIII", 0, at >> 32, at & 0xFFFFFFFF, len(data), len(data))
    options = b"".join(_option(_COMMENT, text) for text in comments)
    return _block(_PACKET, head + _padded(data) + (options + bytes(4) if options else b""))


def _option(code: int, value: bytes) -> bytes:
    return struct.pack("<HH", code, len(value)) + _padded(value)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _udp(source: tuple[bytes, int], target: tuple[bytes, int], data: bytes) -> bytes:
    """Return an IPv4 packet; UDP's checksum is left out, as IPv4 allows (RFC 768)."""
    udp = struct.pack(">HHHH", source[1], target[1], 8 + len(data), 0) + data
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + source[0] + target[0]
    total = sum(struct.unpack(">10H", head))
    total = (total & 0xFFFF) + (total >> 16)
    return head[:10] + struct.pack(">H", ~(total + (total >> 16)) & 0xFFFF) + head[12:] + udp


def write_csv(columns: Columns, path: Path) -> None:
    """Write a table as CSV, numbers so that they come back as the same floats; raises BadInputError."""
    try:
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror}") from error


def write_json(columns: Columns, path: Path) -> None:
    """Write a table as a JSON list of one object a row; raises BadInputError."""
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    _write(path, b"[\n" + b",\n".join(msgspec.json.encode(row) for row in rows) + b"\n]\n")


def write_parquet(columns: Columns, path: Path) -> None:
    """Write a table as Parquet; raises SattrackError where pyarrow is not there, BadInputError."""
    pyarrow = needed("pyarrow", "Parquet", "parquet")
    parquet = needed("pyarrow.parquet", "Parquet", "parquet")
    try:
        parquet.write_table(pyarrow.table(columns), path)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror}") from error


LEAST_S, MOST_S = 3600, 11 * 3600
NUMBER = 99999
"""The catalogue number that stands for every object."""
WITHHELD = "withheld"
_CHANGED: dict[str, Any] = {
    "name": "anonymous",
    "designator": "",
    "catalog_number": NUMBER,
    "element_set_number": 0,
    "revolution_number": 0,
    "recording": "anonymous.mcap",
    "source_file": WITHHELD,
    "message": WITHHELD,
    "why_not_acquired": WITHHELD,
    "words": WITHHELD,
    "recording_trouble": WITHHELD,
    "bias_memory": WITHHELD,
    "warnings": [],
    "horizon": [],
}
"""The values of fields that may reveal who, where or what; null stays null."""
_JSON = {OPERATOR, VIEW, SUMMARY, FAILURE}
_INSTANT = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z")
"""An instant in a text; the group is there where it has decimals."""
_AT = {field.name: field.offset for field in STATUS_FIELDS}
_DOUBLE = struct.Struct("<d")
_ROUNDS = 8
WGS84 = 1
"""ERFA's number of the ellipsoid."""


def random_shift_s() -> int:
    """Return by how many seconds to move, from 1 to 11 hours either way, at random."""
    seconds = LEAST_S + secrets.randbelow(MOST_S - LEAST_S)
    return seconds if secrets.randbits(1) else -seconds


def write_anonymous(recording: Recording, stream: BinaryIO, shift_s: int) -> None:
    """Write a recording moved by a time and the longitude that goes with it.

    Raises BadInputError where its facts cannot be read. A gap stays a gap.
    """
    header = recording.header
    try:
        facts = msgspec.json.decode(header.spec)
        if facts["elements"] is None:
            raise BadInputError(
                f"{recording.path}: only a run by element sets can be moved to another place and time, and "
                "this one followed the rows of a file, or a body"
            )
        moving = _Moving(facts, shift_s)
        spec = msgspec.Raw(msgspec.json.encode(moving.facts(facts)))
    except (msgspec.MsgspecError, KeyError, TypeError, AttributeError) as error:
        raise BadInputError(f"{recording.path}: the run's facts cannot be read: {error}") from error
    moved = msgspec.structs.replace(header, spec=spec, anonymous=True)
    recorder = Recorder(stream, spec, moved)
    for entry in recording.entries():
        if entry.topic == GAP:
            recorder.skip()
        elif entry.topic == STATUS:
            recorder.write(STATUS, entry.utc_s + shift_s, moving.status(entry.data))
        elif entry.topic in {COMMAND, REPEAT}:
            recorder.write(entry.topic, entry.utc_s + shift_s, entry.data)
        elif entry.topic in _JSON:
            try:
                value = msgspec.json.decode(entry.data)
            except msgspec.MsgspecError:
                recorder.skip()
                continue
            recorder.write(entry.topic, entry.utc_s + shift_s, msgspec.json.encode(moving.value("", value)))
    _close(recorder, stream)


def write_as_it_is(recording: Recording, stream: BinaryIO) -> None:
    """Write what could be read of a recording as a file that is whole; raises BadInputError."""
    recorder = Recorder(stream, recording.header.spec, recording.header)
    for entry in recording.entries():
        if entry.topic == GAP:
            recorder.skip()
        else:
            recorder.write(*entry)
    _close(recorder, stream)


def _close(recorder: Recorder, stream: BinaryIO) -> None:
    recorder.close()
    if recorder.trouble is not None:
        raise BadInputError(f"{stream.name}: {recorder.trouble}")


class _Moving:
    """One way of moving: by a time, and to where sidereal time is then what it was."""

    def __init__(self, facts: dict[str, Any], shift_s: int) -> None:
        self._shift_s = shift_s
        site = facts["site"]
        here = Site(site["latitude_deg"], site["longitude_deg"], site.get("height_m", 0.0))
        plan = facts["plan"]
        middle_utc_s = 0.5 * (plan["start_utc_s"] + plan["end_utc_s"])
        self._here = here
        self.site, self._equinoxes_deg = _moved_site(here, middle_utc_s, shift_s)
        self._north_deg = self.site.latitude_deg - here.latitude_deg
        self._east_deg = self.site.longitude_deg - here.longitude_deg

    def facts(self, facts: dict[str, Any]) -> dict[str, Any]:
        """Return a run's facts, moved."""
        moved: dict[str, Any] = self.value("", facts)
        site, elements = self.site, moved["elements"]
        place = {"latitude_deg": site.latitude_deg, "longitude_deg": site.longitude_deg}
        moved["site"] = place | {"height_m": site.height_m}
        elements["source"] = ""
        elements["epoch"] = facts["elements"]["epoch"] + self._shift_s
        elements["raan_deg"] = (elements["raan_deg"] + self._equinoxes_deg) % 360.0
        profile = moved.get("profile", {})
        if profile.get("stands_at") is not None:
            profile["stands_at"] = place
        return moved

    def value(self, key: str, value: Any) -> Any:
        """Return a field's value: instants moved, what reveals who, where or what replaced."""
        if key in _CHANGED and value is not None:
            return _CHANGED[key]
        if isinstance(value, dict):
            moved = {name: self.value(name, one) for name, one in value.items()}
            return moved | self._seen_there(value) if value.get("type") == "observation" else moved
        if isinstance(value, list):
            return [self.value(key, one) for one in value]
        if isinstance(value, str):
            return self._text(key, value)
        return value + self._shift_s if key.endswith("utc_s") and value is not None else value

    def _seen_there(self, seen: dict[str, Any]) -> dict[str, float]:
        """Return where among the stars the same direction of date is, hours later: stars move by 0.1″."""
        frame = FRAMES.get(seen["frame"], "of_date")
        then, ra_deg, dec_deg = Utc.parse(seen["utc"]), seen["ra_deg"], seen["dec_deg"]
        if frame == "of_date":
            return {}
        earth, later = EarthOrientation.installed(), then.plus(float(self._shift_s))
        wanted = _angles_deg(apparent_unit(ra_deg, dec_deg, then, frame, self._here, earth))
        for _ in range(_ROUNDS):
            found = _angles_deg(apparent_unit(ra_deg, dec_deg, later, frame, self.site, earth))
            ra_deg += wrap180(wanted[0] - found[0])
            dec_deg = max(-90.0, min(90.0, dec_deg + wanted[1] - found[1]))
        return {"ra_deg": ra_deg % 360.0, "dec_deg": dec_deg}

    def _text(self, key: str, value: str) -> str:
        if key in {"mount", "mount_name"}:
            return value if value == "sim" else "mount"
        if key == "utc" or key.endswith("_utc"):
            return self._later(value)
        return _INSTANT.sub(lambda found: self._later(found[0], found[1] is not None), value)

    def _later(self, instant: str, fine: bool = True) -> str:
        moved = Utc.parse(instant).plus(float(self._shift_s))
        return moved.isoformat("microseconds" if fine else "seconds")

    def status(self, data: bytes) -> bytes:
        """Return a status with its site moved as ours is; what is no status is blanked."""
        if len(data) != STATUS_LENGTH:
            return bytes(len(data))
        moved = bytearray(data)
        north, east = _AT["site_latitude_deg"], _AT["site_longitude_deg"]
        latitude_deg, longitude_deg = (_DOUBLE.unpack_from(data, at)[0] for at in (north, east))
        if latitude_deg or longitude_deg:
            _DOUBLE.pack_into(moved, north, latitude_deg + self._north_deg)
            _DOUBLE.pack_into(moved, east, wrap180(longitude_deg + self._east_deg))
        for name in ("utc_1", "utc_2", "utc_3"):
            moved[_AT[name]] = 0
        return bytes(moved)


def _angles_deg(unit: NDArray[np.float64]) -> tuple[float, float]:
    x, y, z = (float(one) for one in unit)
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


def _moved_site(site: Site, utc_s: float, shift_s: int) -> tuple[Site, float]:
    """Return where sidereal time and pole are after a time what they are here, and how far nodes go with it.

    The equation of the equinoxes changes by some tenths of an arcsecond meanwhile: orbit and site take it up.
    Polar motion shifts a site by metres, elsewhere in another direction.
    """
    earth = EarthOrientation.installed()
    theta, _, equinoxes, _, xp, yp = earth.rotation(utc_s)
    later_theta, _, later_equinoxes, _, later_xp, later_yp = earth.rotation(utc_s + shift_s)
    nodes = equinoxes - later_equinoxes
    turn = theta - later_theta + nodes
    x, y, z = to_tirs(site.itrs_km, xp, yp)
    cosine, sine = math.cos(turn), math.sin(turn)
    place = (x * cosine - y * sine, x * sine + y * cosine, z)
    return _site_at(to_tirs(place, -later_xp, -later_yp)), math.degrees(nodes)


def _site_at(itrs_km: tuple[float, float, float]) -> Site:
    """Return the site of a position, its height to a millimetre."""
    longitude, latitude, height_m = erfa.gc2gd(WGS84, np.multiply(itrs_km, 1000.0))
    return Site(math.degrees(latitude), math.degrees(longitude), round(float(height_m), 3))


CCSDS_FRAMES = {"icrs": "ICRF", "j2000": "EME2000", "of_date": "TOD"}
STATION = "SATTRACK"


class SeenDirection(NamedTuple):
    """One observed direction, degrees in `frame` (icrs, j2000, of_date), with one sigma on the sky."""

    utc_s: float
    ra_deg: float
    dec_deg: float
    frame: str
    sigma_arcsec: float | None = None


def tdm_text(
    seen: Sequence[SeenDirection], elements: Elements, site: Site, created_utc_s: float, what: str
) -> str:
    """Return a message; `what` is a comment on the directions.

    Directions of one frame that follow one another with one sigma are a segment. The standard has no keyword
    for the uncertainty of angles: a comment in the segment's metadata says it, SIGMA_ARCSEC, and
    `tle.observations` reads it.

    Times are UTC of reception, angles degrees. The site is in a comment, as the standard has no place
    for it.
    """
    created = Utc(created_utc_s).isoformat("seconds").removesuffix("Z")
    lines = ["CCSDS_TDM_VERS = 2.0", f"CREATION_DATE = {created}", f"ORIGINATOR = SATTRACK {__version__}"]
    for frame in CCSDS_FRAMES:
        of_frame = sorted((one for one in seen if one.frame == frame), key=lambda one: one.utc_s)
        for _, part in groupby(of_frame, key=lambda one: one.sigma_arcsec):
            lines += _segment(list(part), elements, site, frame, what)
    return "\n".join(lines) + "\n"


def _segment(
    part: Sequence[SeenDirection], elements: Elements, site: Site, frame: str, what: str
) -> list[str]:
    sigma = part[0].sigma_arcsec
    comments = [] if sigma is None else ["COMMENT one sigma on the sky", f"COMMENT SIGMA_ARCSEC = {sigma!r}"]
    where = f"{site.latitude_deg:.6f} {site.longitude_deg:.6f} deg, {site.height_m:.1f} m, WGS 84"
    lines = [
        "",
        "META_START",
        f"COMMENT {what}",
        f"COMMENT station at {where}",
        *comments,
        "TIME_SYSTEM = UTC",
        f"START_TIME = {_time(part[0].utc_s)}",
        f"STOP_TIME = {_time(part[-1].utc_s)}",
        f"PARTICIPANT_1 = {STATION}",
        f"PARTICIPANT_2 = {elements.designator or elements.catalog_number}",
        "MODE = SEQUENTIAL",
        "PATH = 2,1",
        "TIMETAG_REF = RECEIVE",
        "ANGLE_TYPE = RADEC",
        f"REFERENCE_FRAME = {CCSDS_FRAMES[frame]}",
        "META_STOP",
        "",
        "DATA_START",
    ]
    for one in part:
        at = _time(one.utc_s)
        lines += [f"ANGLE_1 = {at} {one.ra_deg % 360.0:.12f}", f"ANGLE_2 = {at} {one.dec_deg:.12f}"]
    return [*lines, "DATA_STOP"]


def _time(utc_s: float) -> str:
    return Utc(utc_s).isoformat("microseconds").removesuffix("Z")


def knowing(recording: Recording, build: Callable[[msgspec.Raw], Engine]) -> Engine:
    """Return a run's engine that knows what `seen_in` needs: the run is made again where that takes it."""
    for _, message in messages(recording):
        of_date = isinstance(message, ObservationMessage) and message.frame == "of_date"
        if of_date or isinstance(message, SolvedField):
            return trace(recording, build).engine
    return build(recording.header.spec)


def seen_in(recording: Recording, engine: Engine) -> list[SeenDirection]:
    """Return the observations of a run as directions, dated without what its cameras' clocks were wrong by.

    Those of date are without the air and the mount's errors that the run may feed; one that is nowhere near
    the orbit is left out. `engine` is that of `knowing`, or of the run made again.
    """
    steering = engine.tracker.steering
    propagator = steering.biases.course.propagator
    found = []
    for one in observations(recording, propagator.elements.catalog_number):
        t = Utc.parse(one.utc).plus(-steering.clocks.correction_s(one.camera))
        place = one.ra_deg, one.dec_deg
        if one.frame == "of_date":
            try:
                place = _unbent(propagator, place, t)
            except ObservationError:
                continue
        found.append(SeenDirection(float(t.unix_s), *place, one.frame, one.sigma_arcsec))
    return found


def _unbent(propagator: Propagator, place_deg: tuple[float, float], t: Utc) -> tuple[float, float]:
    """Return the apparent place without air of what a mount is fed for it. Raises ObservationError."""
    bias = bias_from_observation(propagator, *place_deg, t).bias
    seen = propagator.with_place("apparent").at(t, bias)
    return float(seen.ra_deg), float(seen.dec_deg)

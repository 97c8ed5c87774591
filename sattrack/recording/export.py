"""A recording as tables, and in other programs' formats: pcapng for Wireshark, CSV, JSON, Parquet."""

from __future__ import annotations

import csv
import struct
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.control.stages import RunStage
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.xerxes.datagrams import (
    COMMAND_FIELDS,
    STATUS_FIELDS,
    DatagramError,
    decode_command,
    decode_status,
)
from sattrack.recording.format import COMMAND, OPERATOR, REPEAT, STATUS, VIEW, to_ns
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sattrack.recording.reading import Recording
    from sattrack.recording.trace import Trace

    Columns = dict[str, list[Any]]

ERROR = "error"
TABLES = ("status", "command", "operator", "view", ERROR)
_STATUS = tuple(f.name for f in STATUS_FIELDS[1:])
_COMMAND = tuple(f.name for f in COMMAND_FIELDS[1:])
Row = dict[str, Any]


def rows(recording: Recording, table: str) -> Iterator[Row]:
    """Give a table's rows: instants as ISO 8601 UTC and as POSIX seconds, fields by the names of the paper.

    `status` (by arrival), `command` (with what was sent once more), `operator`, `view`. Datagrams that are
    none are left out.
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
                yield row | flat(msgspec.json.decode(entry.data))
        except (DatagramError, msgspec.MsgspecError):
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
    """Return a table by columns; rows that lack a column have None there."""
    found = list(rows(recording, table))
    names = dict.fromkeys(name for row in found for name in row)
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
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise SattrackError("Parquet needs pyarrow: pip install 'sattrack[parquet]'") from None
    try:
        parquet.write_table(pyarrow.table(columns), path)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror}") from error

"""A recording as tables: one row a message, one column a field, units in the names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.control.stages import Doing
from sattrack.mount.xerxes.datagrams import (
    COMMAND_FIELDS,
    STATUS_FIELDS,
    DatagramError,
    decode_command,
    decode_status,
)
from sattrack.recording.format import COMMAND, OPERATOR, REPEAT, STATUS, VIEW
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.recording.reading import Recording
    from sattrack.recording.trace import Trace

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
        "doing": [Doing(what).name.lower() for what in run.doing.tolist()],
        "held_by": run.held.tolist(),
    }


def table_of(recording: Recording, table: str) -> dict[str, list[Any]]:
    """Return a table by columns; rows that lack a column have None there."""
    found = list(rows(recording, table))
    names = dict.fromkeys(name for row in found for name in row)
    return {name: [row.get(name) for row in found] for name in names}

"""A recording as tables: one row a message, one column a field, units in the names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.recording.format import COMMAND, OPERATOR, REPEAT, STATUS, VIEW
from sattrack.xerxes.datagrams import (
    COMMAND_FIELDS,
    STATUS_FIELDS,
    DatagramError,
    decode_command,
    decode_status,
)
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.recording.reading import Recording

TABLES = ("status", "command", "operator", "view")
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


def table_of(recording: Recording, table: str) -> dict[str, list[Any]]:
    """Return a table by columns; rows that lack a column have None there."""
    found = list(rows(recording, table))
    names = dict.fromkeys(name for row in found for name in row)
    return {name: [row.get(name) for row in found] for name in names}

"""The two datagrams' field tables, as Markdown for the document and as Lua for the dissector."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.mount.model import DTICS_S_PER_DEG_S
from sattrack.mount.xerxes.datagrams import (
    COMMAND_FIELDS,
    COMMAND_HEADER,
    COMMAND_LENGTH,
    STATUS_FIELDS,
    STATUS_HEADER,
    STATUS_LENGTH,
    Kind,
)

if TYPE_CHECKING:
    from sattrack.mount.xerxes.datagrams import Field

SIZES = {
    Kind.UINT64: 8,
    Kind.INT64: 8,
    Kind.INT32: 4,
    Kind.DOUBLE: 8,
    Kind.BYTE: 1,
    Kind.FLAG: 1,
    Kind.EITHER: 8,
    Kind.HEADER: 8,
}
TYPES = {
    Kind.UINT64: "uint64",
    Kind.INT64: "int64",
    Kind.INT32: "int32",
    Kind.DOUBLE: "double",
    Kind.BYTE: "byte",
    Kind.FLAG: "boolean",
    Kind.EITHER: "int64 **or** double",
    Kind.HEADER: "8 ASCII",
}
UNITS = {
    "_dtics_s": ("dtics_s", "tics/s × 10"),
    "_deg_s": ("deg_s", "°/s"),
    "_deg": ("deg", "°"),
    "_10ma": ("10ma", "10 mA"),
    "_ms": ("ms", "ms"),
    "_m": ("m", "m"),
    "_h": ("h", "h"),
}
"""Endings of names, longest first: the unit in Lua and in print."""
PAPER_NAMES = {
    "command": (
        "CmdHeader, rolling counter, TargetDec, TargetRA, MoveAxisRateDec, MoveAxisRateRA, "
        "DecFineRate, RAFineRate, PulseGuideRADuration, PulseGuideDecDuration, tracking rate, "
        "AbortSlewCmd, FindHomeCmd, MoveAxisRA, MoveAxisDec, ParkCmd, PulseGuideCmd, SlewToTargetCmd, "
        "SyncToTargetCmd, spare"
    ),
    "status": (
        "Description, Altitude, Azimuth, Declination, DeclinationRate, RightAscension, "
        "RightAscensionRate, SiderealTime, SiteElevation, SiteLatitude, SiteLongitude, "
        "TargetDeclination, TargetRightAscension, Rolling Counter, GuideRateDeclination, GuideRateRA, "
        "DecRawCurrent, RARawCurrent, AtHome, AtPark, Connected, DoesRefraction, EquatorialSystem, "
        "IsPulseGuiding, SideOfPier, Slewing, Tracking, TrackingRate, AckMoveAxisDec, AckMoveAxisRA, "
        "UTCDateTime, UTCDateTime, UTCDateTime, RADriveStatus1, RADriveStatus2, DecDriveStatus1, "
        "DecDriveStatus2, AckAbortCmd, AckSyncCmd, AckPulseGuideCmd, AckSlewCmd, spare"
    ),
}
"""What the paper calls the fields, in the order of their bytes."""


def unit_of(field: Field) -> tuple[str, str]:
    """Return a field's unit in Lua and in print, both empty where it has none."""
    return next((unit for ending, unit in UNITS.items() if field.name.endswith(ending)), ("", ""))


def field_table(which: str) -> str:
    """Return one datagram's table, "command" or "status", as Markdown."""
    fields = COMMAND_FIELDS if which == "command" else STATUS_FIELDS
    lines = [
        "| bytes | type | our name | the paper's | unit | meaning |",
        "|---:|---|---|---|---|---|",
    ]
    for field, paper_name in zip(fields, PAPER_NAMES[which].split(", "), strict=True):
        last = field.offset + SIZES[field.kind] - 1
        span = f"{field.offset}" if last == field.offset else f"{field.offset}–{last}"
        unit = unit_of(field)[1]
        lines.append(
            f"| {span} | {TYPES[field.kind]} | `{field.name}` | {paper_name} | {unit} | {field.meaning} |"
        )
    return "\n".join(lines)


def lua_tables() -> str:
    """Return both tables, and the constants of the protocol, as Lua."""
    command_header = COMMAND_HEADER.to_bytes(8, "little")
    parts = [
        f"local COMMAND_HEADER = {_lua_bytes(command_header)}",
        f"local STATUS_HEADER = {_lua_bytes(STATUS_HEADER)}",
        f"local COMMAND_LENGTH = {COMMAND_LENGTH}",
        f"local STATUS_LENGTH = {STATUS_LENGTH}",
        f"local DTICS_S_PER_DEG_S = {DTICS_S_PER_DEG_S!r}",
    ]
    for name, fields in (("COMMAND_FIELDS", COMMAND_FIELDS), ("STATUS_FIELDS", STATUS_FIELDS)):
        parts.append(f"local {name} = {{\n" + "".join(_lua_row(field) for field in fields) + "}")
    return "\n".join(parts)


def _lua_bytes(data: bytes) -> str:
    return '"' + "".join(f"\\{byte:03d}" for byte in data) + '"'


def _lua_row(field: Field) -> str:
    return (
        f'  {{ offset = {field.offset}, length = {SIZES[field.kind]}, name = "{field.name}", '
        f'kind = "{field.kind.name.lower()}", unit = "{unit_of(field)[0]}", meaning = "{field.meaning}" }},\n'
    )

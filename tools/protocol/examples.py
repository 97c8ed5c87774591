"""Worked examples: whole datagrams as bytes, field by field."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.mount.model import Readings, Status
from sattrack.mount.xerxes.datagrams import (
    COMMAND_FIELDS,
    STATUS_FIELDS,
    Command,
    decode_command,
    decode_status,
    encode_command,
    encode_status,
    status_readings,
)
from tools.protocol.fields import SIZES
from tools.protocol.figures import hex_bytes

if TYPE_CHECKING:
    from sattrack.mount.xerxes.datagrams import Field

SLEW = Command(counter=258, target_dec_deg=12.25, target_ra_h=5.25, slew=True)
MOVE = Command(
    counter=259,
    move_dec_rate_deg_s=-0.75,
    move_ra_rate_deg_s=1.25,
    move_ra=True,
    move_dec=True,
    pulse_ra_ms=-1500,
)
GUIDING = Status(
    altitude_deg=52.5,
    azimuth_deg=198.25,
    dec_deg=12.25,
    dec_rate_dtics_s=-120,
    ra_h=5.25,
    ra_rate_dtics_s=7789,
    sidereal_h=6.25,
    site_height_m=1520.5,
    site_latitude_deg=48.125,
    site_longitude_deg=-111.75,
    target_dec_deg=12.25,
    target_ra_h=5.25,
    counter=123456,
    dec_current_10ma=-150,
    ra_current_10ma=200,
    slewing=True,
    tracking=False,
    ack_slew=True,
)
DOUBLES = Readings(counter="double", ra_rate_dtics_s="double")


def command_example() -> str:
    """Return a slew and a MoveAxis as bytes; of the second, only what differs."""
    slew, move = encode_command(SLEW), encode_command(MOVE)
    lines = ["```"]
    lines += _dump(slew, COMMAND_FIELDS, decode_command(slew))
    lines += ["```", "", "MoveAxis on both axes; what differs:", "", "```"]
    lines += _dump(move, COMMAND_FIELDS, decode_command(move), beside=slew)
    return "\n".join([*lines, "```"])


def status_example() -> str:
    """Return a status as bytes, and what differs by the other readings."""
    first, other = encode_status(GUIDING), encode_status(GUIDING, DOUBLES)
    lines = ["```"]
    lines += _dump(first, STATUS_FIELDS, decode_status(first), status_readings(first))
    lines += ["```", "", "The same values by the other readings of two fields; what differs:", "", "```"]
    lines += _dump(other, STATUS_FIELDS, decode_status(other), status_readings(other), beside=first)
    return "\n".join([*lines, "```"])


def _dump(
    data: bytes,
    fields: tuple[Field, ...],
    values: Command | Status,
    readings: Readings | None = None,
    beside: bytes | None = None,
) -> list[str]:
    lines = []
    zero: list[Field] = []
    for field in fields:
        end = field.offset + SIZES[field.kind]
        raw = data[field.offset : end]
        if beside is not None and raw == beside[field.offset : end]:
            continue
        if beside is None and not any(raw):
            zero.append(field)
            continue
        lines += _zero_line(zero)
        zero = []
        value = getattr(values, field.name, field.meaning)
        reading = getattr(readings, field.name, None)
        words = f"{field.name} = {value}" if field.name != "header" else field.meaning
        lines.append(
            _line(field.offset, end - 1, hex_bytes(raw), words + (f"  ({reading})" if reading else ""))
        )
    return lines + _zero_line(zero)


def _zero_line(fields: list[Field]) -> list[str]:
    if not fields:
        return []
    end = fields[-1].offset + SIZES[fields[-1].kind] - 1
    return [_line(fields[0].offset, end, "00 …" if end > fields[0].offset else "00", "zero")]


def _line(first: int, last: int, raw: str, words: str) -> str:
    span = f"{first}" if first == last else f"{first}–{last}"
    return f"{span:>7}  {raw:<23}  {words}"

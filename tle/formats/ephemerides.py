"""Files of ephemerides: CPF, OEM, SP3 and tables, recognised by content, packed or not."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from tle.errors import AmbiguousSatelliteError, EphemerisError, SatelliteNotFoundError, SourceError
from tle.formats import cpf, oem, sp3, track_table
from tle.formats.rows import Lines
from tle.sources import (
    COMMON_NAMES,
    catalog_number_of,
    full_designator,
    gunzipped,
    listed,
    plain_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from tle.ephemeris import TableEphemeris
    from tle.instants import Utc
    from tle.site import Site

_MOST_BYTES = 512 * 1024 * 1024
_COMPRESSED = b"\x1f\x9d"
_CLEAR, _FIRST_WIDTH, _WIDEST = 256, 9, 16
_READERS = (
    (cpf.recognised, cpf.parse_cpf),
    (oem.recognised, oem.parse_oem),
    (sp3.recognised, sp3.parse_sp3),
)


def read_ephemerides(
    path: str | Path, site: Site | None = None, t0: Utc | None = None
) -> list[TableEphemeris]:
    """Return the ephemerides in a file, which may be packed by gzip or compress.

    A table of directions needs the site that they are seen from, one of seconds from T0 the instant of T0.
    Raises SourceError where it cannot be read, and EphemerisError with the line where it cannot be used.
    """
    return parse_ephemerides(_bytes(path), str(path), site, t0)


def counts_from_t0(path: str | Path) -> bool:
    """Tell whether a file is a table whose times count from T0. Raises SourceError, EphemerisError."""
    return track_table.is_relative(Lines(_unpacked(_bytes(path), str(path)), str(path)))


def _bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        why = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        raise SourceError(f"{path}: cannot read the ephemeris: {why}") from None


def parse_ephemerides(
    data: bytes, source: str = "", site: Site | None = None, t0: Utc | None = None
) -> list[TableEphemeris]:
    """Return the ephemerides in what a file holds, see `read_ephemerides`. Raises EphemerisError."""
    text = _unpacked(data, source)
    if not text[:1000].strip() and not text.strip():
        raise EphemerisError("it is empty: give a CPF, OEM or SP3 file, or a table", source=source)
    lines = oem.lines_of(text, source)
    if track_table.recognised(lines):
        return track_table.parse_track(lines, site, t0)
    if t0 is not None:
        raise lines.error(0, "its times are absolute: --t0 goes with a table whose first column is t_s")
    for recognised, parse in _READERS:
        if recognised(lines):
            return parse(lines)
    raise lines.error(
        0,
        "this is neither CPF nor OEM nor SP3, nor a table that begins with utc or t_s: give a file of these",
    )


def _unpacked(data: bytes, source: str) -> bytes:
    if data[:2] == _COMPRESSED:
        try:
            return _uncompressed(data, _MOST_BYTES)
        except ValueError as error:
            raise EphemerisError(f"its compression (.Z) is damaged: {error}", source=source) from None
    if data[:2] != b"\x1f\x8b":
        return data
    import zlib

    try:
        return gunzipped(data, _MOST_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise EphemerisError(f"its compression (gzip) is damaged: {error}", source=source) from None
    except ValueError as error:
        raise EphemerisError(str(error), source=source) from None


def _uncompressed(data: bytes, most: int) -> bytes:
    """Return what `compress` packed (.Z), as older SP3 files are kept; Python's library has no reader for it.

    Welch's codes of 9 to 16 bits, the least significant bit first, in groups of eight codes of one width.
    Raises ValueError for damaged data, or more than so many bytes.
    """
    if len(data) < 3 or not _FIRST_WIDTH <= data[2] & 0x1F <= _WIDEST:
        raise ValueError("its head is not whole")
    widest, clears = data[2] & 0x1F, bool(data[2] & 0x80)
    table = [bytes([k]) for k in range(256)] + ([b""] if clears else [])
    out: list[bytes] = []
    size, width, at, before = 0, _FIRST_WIDTH, 24, b""
    group = at
    while at + width <= 8 * len(data):
        if len(table) >= 1 << width and width < widest:
            at = group + -(-(at - group) // (8 * width)) * 8 * width
            group, width = at, width + 1
            continue
        code = (int.from_bytes(data[at >> 3 : (at >> 3) + 4], "little") >> (at & 7)) & ((1 << width) - 1)
        at += width
        if clears and code == _CLEAR:
            at = group + -(-(at - group) // (8 * width)) * 8 * width
            del table[_CLEAR + 1 :]
            group, width, before = at, _FIRST_WIDTH, b""
            continue
        if code < len(table):
            entry = table[code]
        elif code == len(table) and before:
            entry = before + before[:1]
        else:
            raise ValueError(f"code {code} at byte {at >> 3} stands for nothing")
        out.append(entry)
        size += len(entry)
        if size > most:
            raise ValueError(f"it unpacks to more than {most // 2**20} MiB")
        if before and len(table) < 1 << widest:
            table.append(before + entry[:1])
        before = entry
    return b"".join(out)


def find_ephemeris(ephemerides: list[TableEphemeris], key: str) -> TableEphemeris:
    """Return the ephemeris of the object that a user means, by catalogue number, designator, or a name of it.

    Names are those that the file gives, a CPF's SIC number among them, then common ones (`COMMON_NAMES`).
    Designators are compared as `full_designator` reads them. Case and punctuation do not count. Last come
    parts of a name: `ISS (ZARYA)` is found by what is in brackets, and by what is before them.
    Raises SatelliteNotFoundError, saying what the file holds, AmbiguousSatelliteError where several objects
    answer, and EphemerisError with the line for an object that the file has, but that cannot be placed.
    """
    wanted, number, designator = plain_name(key), catalog_number_of(key.strip()), full_designator(key.strip())
    common = number or COMMON_NAMES.get(wanted)
    rules: tuple[Callable[[TableEphemeris], bool], ...] = (
        lambda one: bool(number) and one.catalog_number == number,
        lambda one: bool(designator) and designator in map(full_designator, one.names),
        lambda one: bool(wanted) and wanted in map(plain_name, one.names),
        lambda one: (
            bool(common)
            and common in (one.catalog_number, *map(COMMON_NAMES.get, map(plain_name, one.names)))
        ),
        lambda one: bool(wanted) and wanted in map(plain_name, re.split(r"[()\[\]]", one.name)),
    )
    for rule in rules:
        found = [one for one in ephemerides if rule(one)]
        if len(found) > 1:
            where = found[0].source or "the ephemeris"
            told = tuple(f"{one.name} ({one.catalog_number or one.names[-1]})" for one in found)
            raise AmbiguousSatelliteError(
                f"{key!r} could be any of {len(found)} in {where}: {listed(told)}: "
                "give a number, designator or name that only one has",
                told,
            )
        if found:
            return found[0]
    for name, error in ephemerides[0].refused.items():
        if plain_name(name) == wanted:
            raise error
    names = [
        one.name if not one.catalog_number else f"{one.name} ({one.catalog_number})" for one in ephemerides
    ]
    raise SatelliteNotFoundError(
        f"no object {key!r} in {ephemerides[0].source or 'the ephemeris'}, which holds {listed(names)}"
    )

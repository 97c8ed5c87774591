"""Element sets from files, folders and text; an object's newest epoch wins; look-up by any of its names."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tle.elements import Elements, parse_alpha5
from tle.errors import (
    AmbiguousSatelliteError,
    ElementsError,
    FormatError,
    SatelliteNotFoundError,
    SourceError,
)
from tle.formats import tle as tle_format

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

_SHOWN = 8


@dataclass(frozen=True, slots=True)
class ElementSets:
    """What sources held: every accepted set in their order, and every refusal."""

    accepted: list[Elements] = field(default_factory=list)
    rejected: list[ElementsError] = field(default_factory=list)


def read_elements(*sources: str | Path, fetch: Callable[[str], str] | None = None) -> list[Elements]:
    """Return the elements in files, folders or text, one set an object: the one with the newest epoch.

    A source is a path, "-" for standard input, text with line ends in it, or a URL if `fetch` can turn
    one into text. Every file of a folder is read. The format is told by the content.
    Raises the first refusal (a subclass of ElementsError) and SourceError; see `load_elements` for sources
    that may hold bad sets.
    """
    sets = load_elements(*sources, fetch=fetch)
    if sets.rejected:
        raise sets.rejected[0]
    return newest(sets.accepted)


def load_elements(*sources: str | Path, fetch: Callable[[str], str] | None = None) -> ElementSets:
    """Return all sets in the sources, accepted and refused. Raises SourceError where one cannot be read."""
    sets = ElementSets()
    for source in sources:
        for name, text in _texts(source, fetch):
            for item in parse_elements(text, name):
                if isinstance(item, Elements):
                    sets.accepted.append(item)
                else:
                    sets.rejected.append(item)
    return sets


def parse_elements(text: str, source: str = "") -> list[Elements | ElementsError]:
    """Return every set in a text, or the reason it is refused, in order; the format is told by the content.

    A text without any set gives one FormatError.
    """
    text = text.removeprefix("\ufeff")
    if tle_format.looks_like_tle(text):
        return list(tle_format.parse_text(text, source))
    if not text.strip():
        return [FormatError("is empty: no element sets in it", source=source or "the text")]
    if re.search(r"CCSDS_OMM_VERS|\bMEAN_MOTION\b", text):
        return [
            FormatError(
                "is an orbit mean-elements message (OMM), which cannot be read yet: give a TLE file instead",
                source=source or "the text",
            )
        ]
    return [FormatError("holds no element sets: give a TLE file", source=source or "the text")]


def newest(elements: Iterable[Elements]) -> list[Elements]:
    """Return one set for each object, that of the newest epoch, in the order of first appearance."""
    best: dict[tuple[int, str], Elements] = {}
    for one in elements:
        key = (one.catalog_number, one.designator)
        if key not in best or best[key].epoch < one.epoch:
            best[key] = one
    return list(best.values())


def find(elements: Sequence[Elements], key: str) -> Elements:
    """Return the elements of the object that a user means.

    The key is a catalogue number (Alpha-5 too), an international designator (1998-067A, 98067A) or a name;
    case and punctuation do not count. An exact name wins over names that begin with the key, those over
    names that contain it. Raises SatelliteNotFoundError, AmbiguousSatelliteError.
    """
    wanted = key.strip()
    for rule in (_by_number, _by_designator, _by_name, _by_start, _by_part):
        found = newest(rule(elements, wanted))
        if len(found) == 1:
            return found[0]
        if found:
            names = tuple(f"{e.label} ({e.catalog_number})" for e in found)
            raise AmbiguousSatelliteError(
                f"{key!r} could be any of {len(found)}: {_listed(names)}: give the catalogue number", names
            )
    there = [f"{e.label} ({e.catalog_number})" for e in elements]
    raise SatelliteNotFoundError(
        f"no satellite {key!r} in the elements, which hold {_listed(there) if there else 'none'}"
    )


def _by_number(elements: Sequence[Elements], key: str) -> list[Elements]:
    if re.fullmatch(r"\d+", key, re.ASCII):
        number: int | None = int(key)
    else:
        number = parse_alpha5(key.upper())
    return [e for e in elements if e.catalog_number == number]


def _by_designator(elements: Sequence[Elements], key: str) -> list[Elements]:
    match = re.fullmatch(r"(?:(\d\d)?(\d\d))-?(\d{3}[A-Z]{1,3})", key.upper(), re.ASCII)
    if match is None:
        return []
    century, year, rest = match.groups()
    century = century or ("19" if int(year) >= 57 else "20")
    return [e for e in elements if e.designator == f"{century}{year}-{rest}"]


def _by_name(elements: Sequence[Elements], key: str) -> list[Elements]:
    plain = _plain(key)
    return [e for e in elements if plain and _plain(e.name) == plain]


def _by_start(elements: Sequence[Elements], key: str) -> list[Elements]:
    plain = _plain(key)
    return [e for e in elements if plain and not key.isdigit() and _plain(e.name).startswith(plain)]


def _by_part(elements: Sequence[Elements], key: str) -> list[Elements]:
    plain = _plain(key)
    return [e for e in elements if plain and not key.isdigit() and plain in _plain(e.name)]


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def _texts(source: str | Path, fetch: Callable[[str], str] | None) -> list[tuple[str, str]]:
    """Return (name, text) of a source: of each file where it is a folder."""
    if isinstance(source, str):
        if "\n" in source:
            return [("", source)]
        if source == "-":
            return [("standard input", sys.stdin.read())]
        if "://" in source:
            if fetch is None:
                raise SourceError(
                    f"{source}: elements are not fetched from a network here: save them to a file"
                )
            return [(source, fetch(source))]
    path = Path(source)
    try:
        if not path.is_dir():
            return [(str(path), _read_file(path))]
        files = sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
    except (OSError, ValueError) as error:
        raise SourceError(f"{source}: cannot read elements: {_why(error)}") from None
    if not files:
        raise SourceError(f"{source}: the folder holds no files: put element files into it")
    return [text for file in files for text in _texts(file, None)]


def _read_file(path: Path) -> str:
    return path.read_bytes().decode("utf-8-sig", errors="replace")


def _why(error: Exception) -> str:
    return (error.strerror or str(error)) if isinstance(error, OSError) else str(error)

"""Element sets from files, folders and text, and into text; look-up by any of an object's names.

The format of a text is recognised by its content, never by a file's name. An object's newest epoch wins.
"""

from __future__ import annotations

import importlib
import io
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
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

    _Reader = Callable[[str, str], Iterator[Elements | ElementsError]]

# Name, what a text of it cannot be without, and the module, imported only for a text that may be of it.
_READERS: tuple[tuple[str, Callable[[str], bool], str], ...] = (
    ("xml", lambda text: text.lstrip()[:1] == "<", "omm_notations"),
    ("json", lambda text: text.lstrip()[:1] in ("[", "{"), "omm_notations"),
    ("gpredict", lambda text: "TLE1=" in text, "tle"),
    ("csv", lambda text: "MEAN_MOTION" in text or "NORAD_CAT_ID" in text, "omm_notations"),
    ("kvn", lambda text: "=" in text, "omm_notations"),
    ("tle", lambda _: True, "tle"),
)
WRITTEN = ("csv", "json", "xml", "kvn", "tle", "2le")
# Compiled where they are used: a text that can be read needs none of these.
_TDM = r"^\s*CCSDS_TDM_VERS\b|<(?:\w+:)?tdm\b"
# gpredict's categories: a title, then numbers.
_NUMBERS = r"[^\n]{0,200}\n(?:\d{1,9}\r?\n)+\s*"
_HTML = r"\s*<(?:!doctype\s+html|html|head|body)\b"
_SHOWN = 8
# A launch's pieces.
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"
_MOST_BYTES = 256 * 1024 * 1024
# From this day on CelesTrak has published objects whose numbers no TLE of its can hold (100000 and above).
_SIX_DIGITS_SINCE = Utc.parse("2026-07-11T00:00:00Z")
# Compiled where it is used: most runs need none of these.
_QUERY = r"https?://[^\s\"'<>]*/(?:sup-)?gp\.php\?([^\s\"'<>]*)"
_HEAD = 2000
NO_NUMBERS = (0, 99_999)
"""What stands in a set for a number that nobody has given yet: no object of the catalogue has these."""
BODIES = ("Sun", "Moon", "Mercury", "Venus", "Mars", "Jupiter", "Saturn", "Uranus", "Neptune", "Pluto")
"""The bodies that can be targets beside satellites; `tle.bodies` knows where they are."""
COMMON_NAMES = {
    "iss": 25544,
    "internationalspacestation": 25544,
    "hubble": 20580,
    "hubblespacetelescope": 20580,
    "tiangong": 48274,
    "css": 48274,
}
"""Catalogue numbers of satellites that people call by a name that no catalogue has, or that several share."""


@dataclass(frozen=True, slots=True)
class ElementSets:
    """What sources held: every accepted set in their order, every refusal, and what else a user should know.

    `notes` are sentences such as that a list is known to lack objects.
    """

    accepted: list[Elements] = field(default_factory=list)
    rejected: list[ElementsError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_elements(*sources: str | Path, fetch: Callable[[str], str] | None = None) -> list[Elements]:
    """Return the elements in files, folders or text, one set an object: the one with the newest epoch.

    A source is a path, "-" for standard input, text with line ends in it, or what `fetch` can turn into
    text: a URL, or a short name such as "celestrak:active". Every file of a folder is read. The format is
    recognised by the content; a file may be compressed with gzip.
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
            found = parse_elements(text, name)
            accepted = [item for item in found if isinstance(item, Elements)]
            sets.accepted.extend(accepted)
            sets.rejected.extend(item for item in found if isinstance(item, ElementsError))
            if lacks_new_objects(name, text, accepted):
                sets.notes.append(
                    f"{name or 'the text'}: is truncated: a list in TLE format lacks every object numbered "
                    "100000 and above, catalogued since 2026-07-11: ask for FORMAT=csv"
                )
    return sets


def parse_elements(text: str, source: str = "") -> list[Elements | ElementsError]:
    """Return every set in a text, or the reason it is refused, in order, in a format recognised by content.

    Reads TLE, 3LE, OMM (CSV, JSON, XML, KVN) and gpredict's files. A text without sets gives one FormatError.
    """
    text = text.removeprefix("\ufeff")
    if "\n" not in text:
        text = text.replace("\r", "\n")
    reader = _reader(text)
    if reader is not None:
        found = list(reader(text, source))
        if found:
            return found
    return [FormatError(_nothing(text), source=source or "the text")]


def write_elements(elements: Iterable[Elements], form: str, created: str = "", originator: str = "") -> str:
    """Return element sets as text in one of the formats WRITTEN: OMM as csv, json, xml or kvn; tle or 2le.

    OMM keeps every value exactly; TLE to the precision of its columns, "2le" without names. `created`
    (ISO 8601 UTC) and `originator` go into the headers of XML and KVN. Raises UnwritableError where a TLE
    cannot hold a value, SourceError for an unknown format.
    """
    if form in ("tle", "2le"):
        from tle.formats import tle

        return tle.write_tle(elements, names=form == "tle")
    from tle.formats import omm_notations as omm

    if form in ("csv", "json"):
        return omm.write_csv(elements) if form == "csv" else omm.write_json(elements)
    if form in ("xml", "kvn"):
        return (omm.write_xml if form == "xml" else omm.write_kvn)(elements, created, originator)
    raise SourceError(f"{form!r} is no format of elements: give one of {', '.join(WRITTEN)}")


def find(elements: Sequence[Elements], key: str | int) -> Elements:
    """Return the elements of the object that a user means.

    The key is a catalogue number (Alpha-5 too), an international designator as `full_designator` reads it
    (1998-067 for all that one launch brought) or a name;
    case, accents and punctuation do not count. An exact name wins over a common one (`COMMON_NAMES`), that
    over names that begin with the key, those over names that contain it.
    Raises SatelliteNotFoundError, AmbiguousSatelliteError.
    """
    wanted = str(key).strip()
    for rule in (_by_number, _by_designator, _by_name, _by_common_name, _by_start, _by_part):
        found = newest(rule(elements, wanted))
        if len(found) == 1:
            return found[0]
        if found:
            names = tuple(map(_numbered, found))
            other = "catalogue number" if len({e.catalog_number for e in found}) > 1 else "name or designator"
            raise AmbiguousSatelliteError(
                f"{key!r} could be any of {len(found)}: {listed(names)}: give the {other}", names
            )
    there = [*map(_numbered, elements)]
    raise SatelliteNotFoundError(
        f"no satellite {key!r} in the elements, which hold {listed(there) if there else 'none'}"
        f"{did_you_mean(elements, wanted)}",
        wanted,
    )


def key_of(one: Elements) -> str:
    """Return by what `find` finds an object: its number, or its designator or name where it has none."""
    if one.catalog_number in NO_NUMBERS:
        return one.designator or one.label
    return str(one.catalog_number)


def _numbered(one: Elements) -> str:
    return f"{one.label} ({one.catalog_number})"


def same_object(one: Elements, other: Elements) -> bool:
    """Tell whether two sets are of one object: their number is the same, and no designator contradicts it.

    What is not catalogued has the number 0 or 99999, which are no object's: there, without designators, the
    name tells.
    """
    if one.catalog_number != other.catalog_number:
        return False
    if one.designator and other.designator:
        return one.designator == other.designator
    return one.catalog_number not in NO_NUMBERS or one.name == other.name


def newest(elements: Iterable[Elements], at: Utc | None = None) -> list[Elements]:
    """Return one set for each object, in the order of first appearance: the newest, or the nearest to `at`.

    Which sets are of one object `same_object` tells.
    """

    def worth(one: Elements) -> float:
        return float(one.epoch.unix_s) if at is None else -abs(one.epoch - at)

    best: dict[int, list[Elements]] = {}
    for one in elements:
        known = best.setdefault(one.catalog_number, [])
        for k, other in enumerate(known):
            if same_object(one, other):
                if worth(other) < worth(one):
                    known[k] = one
                break
        else:
            known.append(one)
    return [one for known in best.values() for one in known]


def _reader(text: str) -> _Reader | None:
    """Return the reader of the format that a text is in."""
    for name, may_be, module_name in _READERS:
        if not may_be(text):
            continue
        module = importlib.import_module(f"tle.formats.{module_name}")
        if getattr(module, f"looks_like_{name}")(text):
            reader: _Reader = getattr(module, f"read_{name}")
            return reader
    return None


def is_html(text: str) -> bool:
    """Tell whether a text is a web page."""
    return re.match(_HTML, text, re.IGNORECASE) is not None


def _nothing(text: str) -> str:
    """Return what to say of a text without element sets."""
    if not text.strip():
        return "is empty: no element sets in it"
    if is_html(text):
        return "is a web page and holds no element sets: save the data itself, as CSV or JSON"
    if re.search(_TDM, text, re.ASCII):
        return "is a tracking data message (TDM), which holds observations and no element sets"
    if re.fullmatch(_NUMBERS, text, re.ASCII):
        return "is a list of catalogue numbers without element sets: give the sets themselves"
    return "holds no element sets: give a TLE, 3LE or OMM file"


def lacks_new_objects(source: str, text: str, accepted: Sequence[Elements]) -> bool:
    """Tell whether a list is known to leave out objects numbered 100000 and above.

    It is known where the source, or an address in a comment at the head of the text, is a CelesTrak query
    for a list in TLE format (which is what it gives where no FORMAT is asked for), the list is of the time
    since such objects exist, and none of them is in it.
    """
    head = "\n".join(line for line in text[:_HEAD].split("\n") if line.startswith("#"))
    if not accepted or "gp.php" not in (source + head).lower():
        return False
    match = re.match(_QUERY, source, re.IGNORECASE) or re.search(_QUERY, head, re.IGNORECASE)
    if match is None:
        return False
    asked = dict(part.upper().partition("=")[::2] for part in match.group(1).split("&"))
    return (
        asked.get("FORMAT", "TLE") in ("TLE", "2LE", "3LE")
        and "CATNR" not in asked
        and max(one.epoch.unix_s for one in accepted) >= _SIX_DIGITS_SINCE.unix_s
        and all(one.catalog_number < 100_000 for one in accepted)
    )


def did_you_mean(elements: Sequence[Elements], key: str, others: Collection[str] = ()) -> str:
    """Return "; did you mean ...?" where a name, a word of one or a body looks like the key, else nothing.

    `others` are names of COMMON_NAMES that count although their satellites are not among the elements.
    """
    from difflib import get_close_matches

    names = {plain_name(body): body for body in BODIES}
    labels = {one.catalog_number: _numbered(one) for one in elements}
    for name, number in COMMON_NAMES.items():
        if number in labels or name in others:
            names[name] = labels.get(number, name.capitalize())
    for one in elements:
        for text in (one.name, *one.name.split()):
            names.setdefault(plain_name(text), _numbered(one))
    near = [] if key.isdigit() else get_close_matches(plain_name(key), names, n=1, cutoff=0.75)
    return f"; did you mean {names[near[0]]}?" if near else ""


def _by_number(elements: Sequence[Elements], key: str) -> list[Elements]:
    number = catalog_number_of(key)
    return [e for e in elements if e.catalog_number == number]


def catalog_number_of(key: str) -> int | None:
    """Return the catalogue number that a key is, in digits or as Alpha-5; None where it is none."""
    return int(key) if re.fullmatch(r"\d+", key, re.ASCII) else parse_alpha5(key.upper())


def _by_designator(elements: Sequence[Elements], key: str) -> list[Elements]:
    designator = full_designator(key)
    if designator is None:
        return []
    if designator[-1].isdigit():
        return [e for e in elements if e.designator.startswith(designator)]
    return [e for e in elements if e.designator == designator]


def full_designator(key: str) -> str | None:
    """Return 1998-067A for 1998-067A, 98067A, 1998-067-A and the like, and for 9806701 of laser stations.

    Return 1998-067 for a launch, None for what is no designator. Seven digits may be a catalogue number too.
    """
    match = re.fullmatch(r"(\d\d)?(\d\d)(?:-?(\d{3})-?([A-Z]{1,3})|-(\d{3}))", key.upper(), re.ASCII)
    if match is None:
        numbered = re.fullmatch(r"(\d\d)(\d{3})(\d\d)", key, re.ASCII)
        if numbered is None or numbered[3] == "00":
            return None
        return full_designator(f"{numbered[1]}{numbered[2]}{_piece(int(numbered[3]))}")
    century, year, number, piece, launch = match.groups()
    century = century or ("19" if int(year) >= 57 else "20")
    return f"{century}{year}-{launch or number + piece}"


def _piece(number: int) -> str:
    """Return the letters of a launch's so-manyth piece: A to Z without I and O, then AA."""
    high, low = divmod(number - 1, len(_LETTERS))
    return (_LETTERS[high - 1] if high else "") + _LETTERS[low]


def _by_name(elements: Sequence[Elements], key: str) -> list[Elements]:
    plain = plain_name(key)
    return [e for e in elements if plain and plain_name(e.name) == plain]


def _by_common_name(elements: Sequence[Elements], key: str) -> list[Elements]:
    number = COMMON_NAMES.get(plain_name(key))
    return [e for e in elements if e.catalog_number == number]


def _by_start(elements: Sequence[Elements], key: str) -> list[Elements]:
    plain = plain_name(key)
    return [e for e in elements if plain and not key.isdigit() and plain_name(e.name).startswith(plain)]


def _by_part(elements: Sequence[Elements], key: str) -> list[Elements]:
    plain = plain_name(key)
    return [e for e in elements if plain and not key.isdigit() and plain in plain_name(e.name)]


def plain_name(name: str) -> str:
    """Return a name as names are compared: without case, accents and punctuation."""
    apart = name
    if not name.isascii():
        import unicodedata

        apart = unicodedata.normalize("NFKD", name)
    return "".join(c for c in apart.casefold() if c.isalnum())


def listed(names: Sequence[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def is_fetched(source: str) -> bool:
    """Tell whether a source is a URL or a provider's short name, which only a fetcher can read."""
    return "://" in source or source.startswith(("celestrak:", "celestrak-sup:", "spacetrack:"))


def _texts(source: str | Path, fetch: Callable[[str], str] | None) -> list[tuple[str, str]]:
    """Return (name, text) of a source: of each file where it is a folder."""
    if isinstance(source, str):
        if "\n" in source:
            return [("", source)]
        if source == "-":
            return [("standard input", _standard_input())]
        if is_fetched(source):
            if fetch is None:
                raise SourceError(
                    f"{source}: elements are not fetched from a network here: save them to a file"
                )
            return [(source, fetch(source))]
    path = Path(source)
    try:
        if not path.exists() and (scheme := re.match(r"([A-Za-z]{2,}):[\w-]", str(source))):
            raise SourceError(
                f"{source}: no provider {scheme[1]!r}: write celestrak:GROUP, spacetrack:NUMBER, "
                "a URL or a file"
            )
        if not path.is_dir():
            return [(str(path), _read_file(path))]
        files = sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
    except (OSError, ValueError) as error:
        raise SourceError(f"{source}: cannot read elements: {_why(error)}") from None
    if not files:
        raise SourceError(f"{source}: the folder holds no files: put element files into it")
    return [text for file in files for text in _texts(file, None)]


def _standard_input() -> str:
    # As bytes, where there are any: text in another encoding is then read as far as it goes.
    raw = getattr(sys.stdin, "buffer", None)
    if raw is None:
        return sys.stdin.read()
    try:
        return _decoded(raw.read())
    except (OSError, ValueError) as error:
        raise SourceError(f"standard input: cannot read elements: {_why(error)}") from None


def _read_file(path: Path) -> str:
    return _decoded(path.read_bytes())


def _decoded(data: bytes) -> str:
    if data[:2] == b"\x1f\x8b":
        data = _unpacked(data)
    utf16 = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    return data.decode("utf-16" if utf16 else "utf-8-sig", errors="replace")


def _unpacked(data: bytes) -> bytes:
    """Return what gzip packed; raises OSError or ValueError where it is damaged or too much."""
    import zlib

    try:
        return gunzipped(data, _MOST_BYTES)
    except (EOFError, zlib.error) as error:
        raise ValueError(f"its gzip compression is damaged: {error}") from None


def gunzipped(data: bytes, most_bytes: int) -> bytes:
    """Return what gzip packed.

    Raises OSError, EOFError or zlib.error where it is damaged, ValueError where it unpacks to more bytes.
    """
    import gzip

    with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        unpacked = file.read(most_bytes + 1)
    if len(unpacked) > most_bytes:
        raise ValueError(f"it unpacks to more than {most_bytes // 2**20} MiB")
    return unpacked


def _why(error: Exception) -> str:
    return (error.strerror or str(error)) if isinstance(error, OSError) else str(error)

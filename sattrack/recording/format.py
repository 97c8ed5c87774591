"""The layout of a recording, an MCAP file with one channel for each kind of input and output; and its reader.

Instants are UTC. MCAP counts them in integer nanoseconds of POSIX time, which is finer than the floats that
the run computes with, so every instant comes back as the same float. The same code with the same libraries on
the same kind of processor gives the same bytes; linear algebra rounds differently from one kind of processor
to the next, and so do versions of libraries.

A file may be cut off, damaged, two in one, or another program's. It is a row of chunks, each compressed and
with a checksum of its own. They are found by what they begin with and not by the lengths before them, so that
one damaged byte costs one chunk, 0.8 s of the run. Layout: MCAP format specification, records Chunk (0x06),
Message (0x05), Channel (0x04), Footer (0x02).
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import math
import platform
import struct
import zlib
from array import array
from collections import Counter
from contextlib import suppress
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.core.angles import wrap180
from sattrack.core.errors import NO_JSON, BadInputError
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.xerxes.datagrams import DatagramError, decode_status
from sattrack.views.formatting import counted
from sattrack.views.messages import ObservationMessage, decode_message
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from sattrack.views.messages import Message


LIBRARIES = ("astropy-iers-data", "filterpy", "msgspec", "numpy", "pyerfa", "scipy", "sgp4")
"""Packages that take part in what is computed of a datagram."""
DATA = ("astropy-iers-data",)
"""Of those, the ones whose content and not only whose rounding changes from version to version."""
NOT_COMPUTING = (
    "calibration",
    "cli",
    "elements",
    "mount/simulator",
    "planning",
    "recording",
    "runtime",
    "schedule",
    "servers",
    "tui",
)
"""Folders of the package that no command datagram comes from."""


class Environment(msgspec.Struct, frozen=True):
    """Processor, interpreter and libraries, each by its own name for itself."""

    machine: str
    processor: str
    python: str
    libraries: dict[str, str]


@cache
def here() -> Environment:
    """Return the environment of this process."""
    versions = {name: _version(name) for name in LIBRARIES}
    return Environment(platform.machine(), _processor(), platform.python_version(), versions)


@cache
def fingerprint() -> str:
    """Return a digest of the code that computes, 16 hexadecimal digits: comments and layout count too."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for root in (package.parent / "tle", package):
        for path in sorted(root.rglob("*.py")):
            name = path.relative_to(package.parent).as_posix()
            if not name.startswith(tuple(f"sattrack/{folder}/" for folder in NOT_COMPUTING)):
                digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    facts = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    model = facts.get("model name") or platform.processor() or platform.machine()
    # Clouds call many processors by one name; what they can do decides which code linear algebra takes.
    abilities = " ".join(sorted(facts.get("flags", facts.get("Features", "")).split()))
    return f"{model} ({hashlib.sha256(abilities.encode()).hexdigest()[:8]})"


FORMAT_VERSION = 3
"""1: datagrams, messages, views. 2: datagrams sent once more. 3: what made it, failures, the summary."""
PROFILE = "sattrack"

RUN = "run"
STATUS = "status"
COMMAND = "command"
REPEAT = "repeat"
OPERATOR = "operator"
FAILURE = "failure"
VIEW = "view"
SUMMARY = "summary"
CHANNELS = {
    RUN: "json",
    STATUS: "ros1",
    COMMAND: "ros1",
    REPEAT: "ros1",
    OPERATOR: "json",
    VIEW: "json",
    FAILURE: "json",
    SUMMARY: "json",
}


class RunHeader(msgspec.Struct, frozen=True):
    """The first message: everything that makes the run besides its inputs."""

    format_version: int
    program_version: str
    spec: msgspec.Raw
    """The run's own facts, see `sattrack.runtime.facts.RunFacts`."""
    fingerprint: str | None = None
    """Of the code that made the run; None before format 3."""
    environment: Environment | None = None
    anonymous: bool = False
    """Whether site and time are not where and when it was."""


class Failure(msgspec.Struct, frozen=True):
    """What broke outside what the engine computes, and turned the run into a stop."""

    words: str


def to_ns(utc_s: float) -> int:
    """Return an instant as integer nanoseconds, exact to one."""
    whole = int(utc_s // 1.0)
    return whole * 1_000_000_000 + round((utc_s - whole) * 1e9)


def from_ns(ns: int) -> float:
    """Return the float that `to_ns` was given."""
    return ns / 1_000_000_000


GAP = "gap"
"""Topic of the entry that stands where messages are missing."""
MAGIC = b"\x89MCAP0\r\n"
_ZSTD = b"\x04\x00\x00\x00zstd"
_ZSTD_FRAME = b"\x28\xb5\x2f\xfd"
_BEFORE_ZSTD = 37
_CHUNK_HEAD = struct.Struct("<BQQQQI")
_U64 = struct.Struct("<Q")
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_FOOTER = struct.Struct("<BQQQI")
_CHANNEL = struct.Struct("<HHI")
_CHANNEL_CODE, _MESSAGE_CODE, _CHUNK_CODE = 4, 5, 6
_FOOTER_CODE, _STATISTICS_CODE = 2, 11
_END_BYTES = 37
"""Footer, with its code and length, and the closing magic."""
_BETWEEN_BYTES = 400
"""From one recording's closing magic to the next one's first chunk, and more."""
LARGEST_CHUNK = 64 * 2**20
MOST_UNPACKED = 20
"""All chunks together may have so many times the bytes of the file: a run's have two to six times as many."""
ALWAYS_UNPACKED_BYTES = 2**20
"""So much they may have in any case, as little text may pack better than a run does."""


class Entry(NamedTuple):
    """One message of a recording, in the order in which it was written."""

    topic: str
    utc_s: float
    data: bytes


class Recording:
    """A recording: its header, its entries, and what is wrong with the file in `problems`.

    `part` says which, where a file holds several one after the other. `cut_off` says that the file ends
    without its proper end, `whole` that no message is missing before that. `messages` counts the entries by
    topic. The file is kept as it is, and unpacked anew for each look at the entries: of a night these would
    take a gigabyte.
    """

    def __init__(self, path: Path, part: int = 1) -> None:
        """Read the file. Raises BadInputError where it is none of ours, or a newer version's."""
        self.path = path
        self.problems: list[str] = []
        try:
            self._data = data = path.read_bytes()
        except OSError as error:
            raise BadInputError(f"{path}: cannot be read: {error.strerror}") from error
        if not data:
            raise BadInputError(f"{path}: is empty: the run ended before anything was recorded")
        parts: list[tuple[int, bytes, Counter[str]]] = []
        try:
            for at, entry in _entries(data, self.problems.append):
                if entry.topic == RUN:
                    parts.append((at, entry.data, Counter()))
                elif parts:
                    parts[-1][2][entry.topic] += 1
        except _TooMuchError:
            raise BadInputError(
                f"{path}: unpacks to more than {MOST_UNPACKED} times its {len(data)} bytes, as no run does; "
                "give one that --record wrote"
            ) from None
        self.parts, self._part = len(parts), part
        if not 1 <= part <= max(1, len(parts)):
            there = (
                "one recording; omit --part" if len(parts) == 1 else f"{len(parts)}; give --part 1 to that"
            )
            raise BadInputError(f"{path}: there is no recording number {part}: it holds {there}")
        if not parts:
            raise BadInputError(f"{path}: {_why_none(data, bool(self.problems))}")
        _, header, self.messages = parts[part - 1]
        self.cut_off = _lacks_end(data, *(at for at, _, _ in parts[part : part + 1]))
        if len(parts) > 1:
            self.problems.append(
                f"{len(parts)} recordings in one file: this is number {part}; --part N takes another"
            )
        self.header = self._read_header(header)
        gaps = self.messages[GAP]
        self.whole = not gaps
        if gaps:
            self.problems.append(f"messages are missing in {gaps} place{'s' * (gaps > 1)}")
        self._check_count()
        if self.cut_off:
            self.problems.append("cut off: the file lacks its end, as after a kill or a full disk")

    def entries(self) -> Iterator[Entry]:
        """Give the entries after the header, a `GAP` where some are missing."""
        part = 0
        for _, entry in _entries(self._data, lambda _: None):
            part += entry.topic == RUN
            if part > self._part:
                return
            if part == self._part and entry.topic != RUN:
                yield entry

    def __len__(self) -> int:
        """Return how many entries there are."""
        return self.messages.total()

    def _check_count(self) -> None:
        """Hold what was read against the count at the file's end: the last chunk has nothing after it."""
        if self.cut_off or self.parts > 1:
            return
        count = _count(self._data)
        if count is None:
            self.problems.append("damaged in the index at its end, which holds nothing of the run")
        elif self.whole and count > len(self) + 1:
            self.whole = False
            self.problems.append(f"damaged: {counted(count - len(self) - 1, 'message')} lost at the end")

    def _read_header(self, data: bytes) -> RunHeader:
        version = _VersionOnly(0, "")
        try:
            version = msgspec.json.decode(data, type=_VersionOnly)
            if version.format_version <= FORMAT_VERSION:
                # The run's facts are in it, raw: whoever decodes them need not look for what is no UTF-8.
                return msgspec.json.decode(data.decode(), type=RunHeader)
        except (msgspec.MsgspecError, *NO_JSON) as error:
            raise BadInputError(f"{self.path}: the recording's header cannot be read: {error}") from error
        raise BadInputError(
            f"{self.path}: format {version.format_version}, written by a newer sattrack, "
            f"{version.program_version}; this one reads formats up to {FORMAT_VERSION}"
        )


class _TooMuchError(Exception):
    """A file's chunks have more in them than those of a run."""


class _VersionOnly(msgspec.Struct):
    format_version: int
    program_version: str


def _why_none(data: bytes, damaged: bool) -> str:
    if not data.startswith(MAGIC):
        return "not an MCAP file; give one that --record wrote" + (
            ", or its beginning is lost" if damaged else ""
        )
    if damaged:
        return "no recording that can be read: its beginning is damaged, and with it the run's facts"
    if len(data) < 2000:  # a header and nothing else
        return "no recording that can be read: it ends before the run's facts were written"
    return "an MCAP file without the facts of a run: of another program, or cut off; copy it again"


def _entries(data: bytes, note: Callable[[str], None]) -> Iterator[tuple[int, Entry]]:
    """Give every message that can be read, with its chunk's place; a `GAP` where some are missing."""
    expected = 0
    for at, topic, sequence, utc_s, message in _messages(data, note):
        if sequence != expected and topic != RUN:
            yield at, Entry(GAP, utc_s, b"")
        yield at, Entry(topic, utc_s, message)
        expected = sequence + 1


def _lacks_end(data: bytes, next_at: int | None = None) -> bool:
    """Tell whether a recording's end is missing: that before the place of the next one, or the file's."""
    if next_at is not None:
        return data[max(0, next_at - _BETWEEN_BYTES) : next_at].count(MAGIC) < 2
    return not (data.endswith(MAGIC) and data[-_END_BYTES] == _FOOTER_CODE)


def _count(data: bytes) -> int | None:
    """Return how many messages the file's end says there are; None where that is damaged."""
    footer = len(data) - _END_BYTES
    _, _, begin, _, checksum = _FOOTER.unpack_from(data, footer)
    if not 0 < begin <= footer or zlib.crc32(data[begin : footer + _FOOTER.size - 4]) != checksum:
        return None
    while begin + _RECORD.size < footer:
        code, length = _RECORD.unpack_from(data, begin)
        begin += _RECORD.size
        if code == _STATISTICS_CODE:
            count: int = _U64.unpack_from(data, begin)[0]
            return count
        begin += length
    return None


def _messages(data: bytes, note: Callable[[str], None]) -> Iterator[tuple[int, str, int, float, bytes]]:
    """Give every message that can be read: its chunk's place, topic, sequence, instant and content."""
    channels: dict[int, str] = {}
    for at, chunk in _chunks(data, note):
        try:
            for sequence, channel, log_ns, content in _in_chunk(chunk, channels):
                topic = channels.get(channel)
                if topic is not None:
                    yield at, topic, sequence, from_ns(log_ns), content
        except struct.error:
            note(f"what stands at byte {at} is no chunk of messages")


def _in_chunk(chunk: bytes, channels: dict[int, str]) -> Iterator[tuple[int, int, int, bytes]]:
    """Give sequence, channel, instant and content of a chunk's messages; its channels are added to those."""
    place = 0
    while place + _RECORD.size <= len(chunk):
        code, length = _RECORD.unpack_from(chunk, place)
        place += _RECORD.size
        if code == _MESSAGE_CODE:
            if length < _MESSAGE.size:
                raise struct.error("a message without its head")
            channel, sequence, log_ns, _ = _MESSAGE.unpack_from(chunk, place)
            yield sequence, channel, log_ns, chunk[place + _MESSAGE.size : place + length]
        elif code == _CHANNEL_CODE:
            number, _, size = _CHANNEL.unpack_from(chunk, place)
            begin = place + _CHANNEL.size
            channels[number] = chunk[begin : begin + size].decode("utf-8", "replace")
        place += length


def _chunks(data: bytes, note: Callable[[str], None]) -> Iterator[tuple[int, bytes]]:
    """Give place and content of every chunk whose checksum is right; the others are noted.

    Raises _TooMuchError.
    """
    left = max(ALWAYS_UNPACKED_BYTES, MOST_UNPACKED * len(data))
    mark = data.find(_ZSTD, _BEFORE_ZSTD)
    while mark >= 0:
        at, begin = mark - _BEFORE_ZSTD, mark + len(_ZSTD) + _U64.size
        code, stated, _, _, size, checksum = _CHUNK_HEAD.unpack_from(data, at)
        length = _U64.unpack_from(data, begin - _U64.size)[0] if begin <= len(data) else len(data)
        # The index at a file's end has the same mark. One damaged byte leaves one of the two right.
        packed = code == _CHUNK_CODE and data[begin : begin + 4] == _ZSTD_FRAME
        is_chunk = packed or stated == length + begin - at - _RECORD.size
        later = data.find(_ZSTD, mark + 1)
        whole = begin + length <= len(data)
        content = _decompressed(data[begin : begin + length], size, left) if whole else None
        left -= 0 if content is None else size
        if is_chunk and content is not None and zlib.crc32(content) == checksum:
            yield at, content
            mark = data.find(_ZSTD, begin + length)
            continue
        if is_chunk and (later >= 0 or whole):
            note(f"damaged at byte {at}: what was recorded there, 0.8 s or so, is lost")
        mark = later


def _decompressed(packed: bytes, size: int, left: int) -> bytes | None:
    """Return a chunk's content; None where it has not `size` bytes. Raises _TooMuchError beyond `left`."""
    import zstandard  # plots need this module, and no chunks

    try:
        if size > LARGEST_CHUNK or zstandard.frame_content_size(packed) != size:
            return None
        if size > left:
            raise _TooMuchError
        return zstandard.ZstdDecompressor().decompress(packed)
    except zstandard.ZstdError:
        return None


STEP_S = 0.5
"""A clock that gains or loses this much from one status to the next, for good, was set."""
LASTS_S = 1.0
"""The statuses of so long before and after tell whether it was for good."""


LONGEST_PAUSE_S = 60.0
"""A longer time from one instant of a run to the next is a clock that was set, or a computer that slept."""


class ClockStep(msgspec.Struct, frozen=True):
    """Where one of the clocks was set: ours against the mount's own, positive where ours jumped ahead."""

    utc: str
    ahead_s: float

    @property
    def text(self) -> str:
        """Return what happened, for people."""
        return f"a clock was set at {self.utc}, by {self.ahead_s:+.3f} s"


class RecordingView(msgspec.Struct, frozen=True):
    """What a recording holds; times ISO 8601 UTC, null where it is not known."""

    recording: str
    format_version: int
    program_version: str
    fingerprint: str | None
    environment: Environment | None
    began_utc: str | None
    ended_utc: str | None
    seconds: float
    bytes: int
    messages: dict[str, int]
    whole: bool
    ended_properly: bool
    clock_steps: tuple[ClockStep, ...]
    problems: tuple[str, ...]
    summary: msgspec.Raw | None


def look(recording: Recording) -> RecordingView:
    """Return what a recording holds."""
    steps = clock_steps(recording)
    instants = [e.utc_s for e in recording.entries() if e.topic in {STATUS, COMMAND, REPEAT}]
    first, last = (min(instants), max(instants)) if instants else (None, None)
    summary = next((e.data for e in recording.entries() if e.topic == SUMMARY), None)
    header = recording.header
    return RecordingView(
        recording=str(recording.path),
        format_version=header.format_version,
        program_version=header.program_version,
        fingerprint=header.fingerprint,
        environment=header.environment,
        began_utc=_iso(first),
        ended_utc=_iso(last),
        seconds=round(lasted_s(instants), 3),
        bytes=recording.path.stat().st_size,
        messages=dict(recording.messages),
        whole=recording.whole,
        ended_properly=not recording.cut_off,
        clock_steps=tuple(steps),
        problems=(*recording.problems, *(step.text for step in steps)),
        summary=None if summary is None else msgspec.Raw(summary),
    )


def lasted_s(instants: Iterable[float]) -> float:
    """Return for how long something lasted, seconds, by UTC instants in order; their clock may be set."""
    seconds, last_s = 0.0, math.inf
    for utc_s in instants:
        step_s = utc_s - last_s
        if 0.0 < step_s < LONGEST_PAUSE_S:
            seconds += step_s
        if step_s > 0.0 or step_s < -STEP_S:
            last_s = utc_s
    return seconds


def clock_steps(recording: Recording) -> list[ClockStep]:
    """Return where our clock jumped against the mount's sidereal one, from status to status.

    Statuses that waited on their way and came at once are none: after them the clocks are as before. Of those
    at the beginning even the last may have waited: it was dated when it was read.
    """
    dated = array("d", chain.from_iterable(_sidereal(recording)))
    came_s = dated[::2]
    ahead_s = array("d", [0.0])
    for (before_s, before_h), (utc_s, sidereal_h) in pairwise(zip(came_s, dated[1::2], strict=True)):
        passed_s, turned_deg = utc_s - before_s, (sidereal_h - before_h) * 15.0
        # The mount's clock gives the time within a day; the difference is taken the short way round.
        off_deg = wrap180(passed_s * SIDEREAL_RATE_DEG_S - turned_deg)
        ahead_s.append(ahead_s[-1] + off_deg / SIDEREAL_RATE_DEG_S)
    found = []
    for k, (before, now) in enumerate(pairwise(ahead_s), 1):
        if abs(now - before) > STEP_S:
            former = _least_ahead_s(ahead_s, came_s, range(k - 1, -1, -1))
            since = _least_ahead_s(ahead_s, came_s, range(k, len(came_s)))
            waited = since < former and came_s[k - 1] - came_s[0] < STEP_S
            if abs(since - former) > STEP_S and not waited:
                found.append(ClockStep(Utc(came_s[k]).isoformat("milliseconds"), since - former))
    return found


def _least_ahead_s(ahead_s: Sequence[float], came_s: Sequence[float], statuses: range) -> float:
    """Return the least by which our clock was ahead within LASTS_S of the first of some statuses.

    A status that waits is late, never early. Where our clock goes back it was set: that is another clock.
    """
    first_s = previous_s = came_s[statuses[0]]
    least_s = ahead_s[statuses[0]]
    for k in statuses:
        if (came_s[k] - previous_s) * statuses.step < 0.0 or abs(came_s[k] - first_s) > LASTS_S:
            break
        least_s, previous_s = min(least_s, ahead_s[k]), came_s[k]
    return least_s


def _sidereal(recording: Recording) -> Iterator[tuple[float, float]]:
    """Yield when each status came, UTC as POSIX seconds, and the sidereal time in it, hours."""
    for entry in recording.entries():
        if entry.topic == STATUS:
            with suppress(DatagramError):
                yield entry.utc_s, decode_status(entry.data).sidereal_h


def _iso(utc_s: float | None) -> str | None:
    return None if utc_s is None else Utc(utc_s).isoformat("milliseconds")


def messages(recording: Recording) -> Iterator[tuple[float, Message]]:
    """Yield the messages that came in a run, and when, UTC as POSIX seconds; what is none is left out."""
    for entry in recording.entries():
        if entry.topic == OPERATOR:
            with suppress(msgspec.MsgspecError):
                yield entry.utc_s, decode_message(entry.data)


def observations(recording: Recording, catalog_number: int | None = None) -> list[ObservationMessage]:
    """Return the observations that came in during a run, in the order in which they came.

    With a catalogue number, those that are of another object are left out.
    """
    return [
        message
        for _, message in messages(recording)
        if isinstance(message, ObservationMessage) and message.catalog_number in {None, catalog_number}
    ]

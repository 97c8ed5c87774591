"""A recording's inputs run through today's code, and every output compared with the recorded one."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader

from sattrack.errors import BadInputError
from sattrack.messages import decode_message
from sattrack.recording.format import (
    COMMAND,
    FORMAT_VERSION,
    OPERATOR,
    REPEAT,
    RUN,
    STATUS,
    VIEW,
    RunHeader,
    from_ns,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sattrack.engine import Engine


class Entry(NamedTuple):
    """One message of a recording, in the order in which it was written."""

    topic: str
    utc_s: float
    data: bytes


class Divergence(NamedTuple):
    """The first output that came out otherwise: which tick, when, and both datagrams."""

    tick: int
    utc_s: float
    recorded: bytes
    replayed: bytes


@dataclass(frozen=True, slots=True)
class Replay:
    """How a replay went; `cut_off` tells that the file ends without its proper end."""

    ticks: int
    statuses: int
    divergence: Divergence | None
    cut_off: bool


class Recording:
    """An open recording: its header at once, its entries as they are asked for."""

    def __init__(self, path: Path) -> None:
        """Read the header. Raises BadInputError where the file is none of ours."""
        self.path = path
        self.cut_off = True
        """Whether the file lacks its proper end; known once the entries have been read."""
        self._entries = self._read()
        first = next(self._entries, None)
        if first is None or first.topic != RUN:
            raise BadInputError(f"{path}: no recording of sattrack")
        try:
            self.header = msgspec.json.decode(first.data, type=RunHeader)
        except msgspec.MsgspecError as error:
            raise BadInputError(f"{path}: the recording's header cannot be read: {error}") from error
        if self.header.format_version > FORMAT_VERSION:
            raise BadInputError(
                f"{path}: written by a newer sattrack, {self.header.program_version}; read it with that one"
            )

    def entries(self) -> Iterator[Entry]:
        """Give the entries after the header, once; a file that is cut off ends with its last whole part."""
        return self._entries

    def _read(self) -> Iterator[Entry]:
        channels: dict[int, str] = {}
        try:
            with self.path.open("rb") as stream:
                for record in StreamReader(stream).records:
                    if isinstance(record, Channel):
                        channels[record.id] = record.topic
                    elif isinstance(record, Message):
                        yield Entry(channels[record.channel_id], from_ns(record.log_time), record.data)
                    elif isinstance(record, Footer):
                        self.cut_off = False
        except OSError as error:
            raise BadInputError(f"{self.path}: cannot be read: {error.strerror}") from error
        except (McapError, KeyError, struct.error, zstandard.ZstdError):
            return


def replay(recording: Recording, build: Callable[[msgspec.Raw], Engine]) -> Replay:
    """Run a recording's inputs through the engine that `build` makes of its facts; compare byte for byte."""
    engine = build(recording.header.spec)
    ticks = statuses = 0
    divergence: Divergence | None = None
    for entry in recording.entries():
        if entry.topic == STATUS:
            statuses += 1
            engine.receive(entry.data, entry.utc_s)
        elif entry.topic == OPERATOR:
            engine.operate(decode_message(entry.data), entry.utc_s)
        elif entry.topic == COMMAND:
            replayed = engine.tick(entry.utc_s)
            if divergence is None and replayed != entry.data:
                divergence = Divergence(ticks, entry.utc_s, entry.data, replayed)
            ticks += 1
        elif entry.topic == REPEAT:
            replayed = engine.repeat() or b""
            if divergence is None and replayed != entry.data:
                divergence = Divergence(ticks - 1, entry.utc_s, entry.data, replayed)
        else:
            assert entry.topic in {VIEW, RUN}
    return Replay(ticks, statuses, divergence, recording.cut_off)

"""Writing a recording: directly in virtual time, from a thread of its own where a loop must not wait."""

from __future__ import annotations

import queue
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import msgspec
from mcap.writer import CompressionType, Writer

from sattrack import __version__
from sattrack.core.errors import BadInputError
from sattrack.mount.xerxes.datagrams import COMMAND_FIELDS, STATUS_FIELDS
from sattrack.recording.format import (
    CHANNELS,
    COMMAND,
    FAILURE,
    FORMAT_VERSION,
    OPERATOR,
    PROFILE,
    REPEAT,
    RUN,
    STATUS,
    SUMMARY,
    VIEW,
    Failure,
    RunHeader,
    fingerprint,
    here,
    to_ns,
)
from sattrack.views.messages import Message, SeenOffset, TaggedMessage
from sattrack.views.run import Summary, TrackView

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from sattrack.mount.xerxes.datagrams import Field

    _Content = bytes | Message | TrackView | Summary | Failure | RunHeader

JSON_SCHEMA, ROS_SCHEMA = "jsonschema", "ros1msg"
"""Encodings of schemas. ROS 1 has a message's fields one after the other, little-endian, as datagrams do."""
_ROS_TYPES = {
    "8s": "uint8[8]",
    "d": "float64",
    "i": "int32",
    "q": "int64",
    "Q": "uint64",
    "B": "uint8",
    "?": "bool",
}


class ChannelSchema(NamedTuple):
    """A schema's name, its encoding and its text."""

    name: str
    encoding: str
    text: bytes


def channel_schemas() -> dict[str, ChannelSchema]:
    """Return the schema of each topic.

    References are written out and null is left out of JSON types, as not all readers know them: a field that
    has a default may be null.
    """
    status = ChannelSchema("xerxes/Status", ROS_SCHEMA, _ros_message(STATUS_FIELDS))
    command = ChannelSchema("xerxes/Command", ROS_SCHEMA, _ros_message(COMMAND_FIELDS))
    kinds = {RUN: RunHeader, VIEW: TrackView, SUMMARY: Summary, FAILURE: Failure}
    found = {topic: _json(f"sattrack.{kind.__name__}", kind) for topic, kind in kinds.items()}
    found[OPERATOR] = _json("sattrack.Message", TaggedMessage, SeenOffset)
    return found | {STATUS: status, COMMAND: command, REPEAT: command}


def _ros_message(fields: Sequence[Field]) -> bytes:
    """Return a datagram's fields as a definition of a ROS 1 message: type, and name with its unit.

    What a mount may write as an integer or as a number with a fraction is eight bytes.
    """
    lines = [f"{_ROS_TYPES[one.kind.value.replace('S', 's')]} {one.name}\n" for one in fields]
    return "".join(lines).encode()


def _json(name: str, *kinds: Any) -> ChannelSchema:
    schemas, parts = msgspec.json.schema_components(kinds)
    # Of several kinds, and of a union of messages, the fields of any of them.
    every = [_plain(one, parts) for schema in schemas for one in schema.get("anyOf", [schema])]
    fields = {key: value for one in every for key, value in one["properties"].items()}
    joined = {"title": name, "type": "object", "properties": fields}
    return ChannelSchema(name, JSON_SCHEMA, msgspec.json.encode(joined))


def _plain(schema: dict[str, Any], parts: dict[str, Any]) -> dict[str, Any]:
    """Return a schema without references, alternatives of null, defaults and what must be there."""
    if "$ref" in schema:
        return _plain(parts[schema["$ref"].rsplit("/", 1)[1]], parts)
    if "anyOf" in schema:
        others = [one for one in schema["anyOf"] if one.get("type") != "null"]
        return _plain(others[0], parts) if others else {"type": "null"}
    if "enum" in schema:
        return {"type": "string"}
    if schema.get("type") == "object" and "properties" in schema:
        fields = {key: _plain(value, parts) for key, value in schema["properties"].items()}
        return {"type": "object", "properties": fields}
    if schema.get("type") == "array":
        items = schema.get("items") or next(iter(schema.get("prefixItems", ())), None)
        return {"type": "array", "items": _plain(items or {}, parts)}
    kind = schema.get("type", "object")
    # Foxglove takes no object without properties.
    return {"type": "object", "properties": {}} if kind == "object" else {"type": kind}


FLUSH_EVERY_S = 0.8
"""Seconds of the run after which messages are on their way to the disk: a killed process loses no more."""
QUEUED_MOST = 20_000
"""Messages kept for a disk that is slow: eight minutes of a run, some ten megabytes."""
CLOSE_PATIENCE_S = 10.0
"""How long a disk may take at the end before it is left to itself."""


def _encoded(content: _Content) -> bytes:
    return content if isinstance(content, bytes) else msgspec.json.encode(content)


class Sink:
    """What a loop hands its inputs and outputs to; a subclass keeps them."""

    wanted = True
    """Whether anything is kept of what is handed over."""

    _trouble: str | None = None

    @property
    def trouble(self) -> str | None:
        """What is wrong with the recording; None where nothing is."""
        return self._trouble

    def status(self, utc_s: float, data: bytes) -> None:
        """Take a datagram from the mount, with its arrival."""
        self._put(STATUS, utc_s, data)

    def command(self, utc_s: float, data: bytes) -> None:
        """Take the datagram of a tick, with the tick's instant."""
        self._put(COMMAND, utc_s, data)

    def repeat(self, utc_s: float, data: bytes) -> None:
        """Take a datagram that was sent once more, with the instant of that."""
        self._put(REPEAT, utc_s, data)

    def operator(self, utc_s: float, message: Message) -> None:
        """Take the operator's message."""
        self._put(OPERATOR, utc_s, message)

    def view(self, utc_s: float, view: TrackView) -> None:
        """Take a state as it was shown."""
        self._put(VIEW, utc_s, view)

    def failure(self, utc_s: float, text: str) -> None:
        """Take what turned the run into a stop from outside the engine."""
        self._put(FAILURE, utc_s, Failure(text))

    def summary(self, utc_s: float, summary: Summary) -> None:
        """Take the figures of the whole run."""
        self._put(SUMMARY, utc_s, summary)

    def _put(self, topic: str, utc_s: float, content: _Content) -> None:
        raise NotImplementedError


class NoRecording(Sink):
    """A sink that keeps nothing."""

    wanted = False

    def _put(self, topic: str, utc_s: float, content: _Content) -> None:
        pass


def create(path: Path) -> BinaryIO:
    """Open a new file for a recording; raises BadInputError where there is one already or it cannot be."""
    try:
        return path.open("xb")
    except FileExistsError as error:
        raise BadInputError(f"--record {path}: exists already; give another name") from error
    except OSError as error:
        raise BadInputError(f"--record {path}: cannot be written: {error.strerror}") from error


class Recorder(Sink):
    """A sink that writes an MCAP file.

    Where the disk refuses, `trouble` says so and nothing more is written: no recording is worth a run.
    """

    def __init__(self, stream: BinaryIO, spec: msgspec.Raw, header: RunHeader | None = None) -> None:
        """Write what the channels are; the header, a copy's its original's, gets the first message's time."""
        self._stream = stream
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._sequence = 1
        self._flushed_utc_s = 0.0
        self._channels: dict[str, int] = {}
        self._header: RunHeader | None
        self._header = header or RunHeader(FORMAT_VERSION, __version__, spec, fingerprint(), here())
        with self._troubled():
            self._begin()

    def _begin(self) -> None:
        self._writer.start(profile=PROFILE, library=f"sattrack {__version__}")
        schemas, known = channel_schemas(), dict[ChannelSchema, int]()
        for topic, encoding in CHANNELS.items():
            schema = schemas[topic]
            if schema not in known:
                known[schema] = self._writer.register_schema(*schema)
            self._channels[topic] = self._writer.register_channel(topic, encoding, known[schema])
        self._writer.flush()  # type: ignore[no-untyped-call]

    def _put(self, topic: str, utc_s: float, content: _Content) -> None:
        self.write(topic, utc_s, _encoded(content))

    def write(self, topic: str, utc_s: float, data: bytes) -> None:
        """Append one message."""
        if self.trouble is not None:
            return
        with self._troubled():
            self._add(topic, utc_s, data)
            # A clock that was set back must not keep what follows from the disk.
            if abs(utc_s - self._flushed_utc_s) >= FLUSH_EVERY_S:
                self._writer.flush()  # type: ignore[no-untyped-call]
                self._flushed_utc_s = utc_s

    def skip(self) -> None:
        """Leave a gap, as where messages of an original are missing."""
        self._sequence += 1

    def close(self) -> None:
        """Finish the file, as far as the disk lets it."""
        with self._troubled():
            if self.trouble is None:
                self._write_header(0.0)
                self._writer.finish()  # type: ignore[no-untyped-call]
        with self._troubled():
            self._stream.close()

    def _write_header(self, utc_s: float) -> None:
        if self._header is not None:
            header, self._header = _encoded(self._header), None
            self._writer.add_message(self._channels[RUN], to_ns(utc_s), header, to_ns(utc_s), 1)

    def _add(self, topic: str, utc_s: float, data: bytes) -> None:
        self._write_header(utc_s)
        self._sequence += 1
        at = to_ns(utc_s)
        self._writer.add_message(self._channels[topic], at, data, at, self._sequence)

    @contextmanager
    def _troubled(self) -> Iterator[None]:
        """Turn what goes wrong into a message; the first one stays."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            self._trouble = self.trouble or f"the recording cannot be written: {reason}; it ends here"


class BackgroundRecorder(Sink):
    """A recorder behind a queue and a thread, so that a slow disk never holds the loop.

    The loop takes no lock that the thread may hold: a thread that is kept from running would hold it up.
    `trouble` says what went wrong, if anything did; the run continues without its recording then.
    """

    def __init__(self, recorder: Recorder, patience_s: float = CLOSE_PATIENCE_S) -> None:
        self._recorder = recorder
        self._patience_s = patience_s
        self._queue: queue.SimpleQueue[tuple[str, float, _Content] | None]
        self._queue = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> str | None:
        """See Sink."""
        return self._trouble or self._recorder.trouble

    def close(self) -> None:
        """Write what is queued and finish the file; a disk that does not answer is given up after a while."""
        self._queue.put(None)
        self._thread.join(self._patience_s)
        if self._thread.is_alive():
            self._trouble = "the disk does not answer; the recording ends where it stands"
        else:
            self._recorder.close()

    def _put(self, topic: str, utc_s: float, content: _Content) -> None:
        if self.trouble is not None:
            return
        if self._queue.qsize() >= QUEUED_MOST:
            self._trouble = "the disk is too slow; the recording ends here"
            return
        self._queue.put((topic, utc_s, content))

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            if self.trouble is not None:
                continue
            topic, utc_s, content = item
            try:
                self._recorder.write(topic, utc_s, _encoded(content))
            except Exception as error:  # noqa: BLE001 - a thread that died would leave the queue to fill
                self._trouble = f"the recording cannot be written: {error}; it ends here"

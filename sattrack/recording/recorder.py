"""Writing a recording: directly in virtual time, from a thread of its own where a loop must not wait."""

from __future__ import annotations

import queue
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO, Protocol

import msgspec
from mcap.writer import CompressionType, Writer

from sattrack import __version__
from sattrack.core.errors import BadInputError
from sattrack.recording.environment import fingerprint, here
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
    to_ns,
)
from sattrack.recording.schemas import ChannelSchema, channel_schemas

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sattrack.views.messages import Message
    from sattrack.views.run import Summary, TrackView

    _Told = bytes | Message | TrackView | Summary | Failure

FLUSH_EVERY_S = 0.8
"""Seconds of the run after which what was told is on its way to the disk: a killed process loses no more."""
QUEUED_MOST = 20_000
"""Messages kept for a disk that is slow: eight minutes of a run, some ten megabytes."""
CLOSE_PATIENCE_S = 10.0
"""How long a disk may take at the end before it is left to itself."""


class Sink(Protocol):
    """What a loop tells of its inputs and outputs."""

    @property
    def wanted(self) -> bool:
        """Whether anything is kept of what is told."""

    def status(self, utc_s: float, data: bytes) -> None:
        """Take a datagram from the mount, with its arrival."""

    def command(self, utc_s: float, data: bytes) -> None:
        """Take the datagram of a tick, with the tick's instant."""

    def repeat(self, utc_s: float, data: bytes) -> None:
        """Take a datagram that was sent once more, with the instant of that."""

    def operator(self, utc_s: float, message: Message) -> None:
        """Take the operator's word."""

    def view(self, utc_s: float, view: TrackView) -> None:
        """Take a state as it was shown."""

    def failure(self, utc_s: float, words: str) -> None:
        """Take what turned the run into a stop from outside the engine."""

    def summary(self, utc_s: float, summary: Summary) -> None:
        """Take what the run came to."""

    @property
    def trouble(self) -> str | None:
        """What is wrong with the recording, in words; None where nothing is."""


class NoRecording:
    """A sink that keeps nothing."""

    wanted = False
    trouble = None

    def status(self, utc_s: float, data: bytes) -> None:
        """See Sink."""

    def command(self, utc_s: float, data: bytes) -> None:
        """See Sink."""

    def repeat(self, utc_s: float, data: bytes) -> None:
        """See Sink."""

    def operator(self, utc_s: float, message: Message) -> None:
        """See Sink."""

    def view(self, utc_s: float, view: TrackView) -> None:
        """See Sink."""

    def failure(self, utc_s: float, words: str) -> None:
        """See Sink."""

    def summary(self, utc_s: float, summary: Summary) -> None:
        """See Sink."""


def create(path: Path) -> BinaryIO:
    """Open a new file for a recording; raises BadInputError where there is one already or it cannot be."""
    try:
        return path.open("xb")
    except FileExistsError as error:
        raise BadInputError(f"--record {path}: exists already; give another name") from error
    except OSError as error:
        raise BadInputError(f"--record {path}: cannot be written: {error.strerror}") from error


class Recorder:
    """A sink that writes an MCAP file as it is told.

    Where the disk refuses, `trouble` says so and nothing more is written: no recording is worth a run.
    """

    wanted = True

    def __init__(self, stream: BinaryIO, spec: msgspec.Raw, header: RunHeader | None = None) -> None:
        """Write the header, so that the file opens from the first moment; a copy has its original's."""
        self.trouble: str | None = None
        self._stream = stream
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._sequence = 0
        self._flushed_utc_s = 0.0
        self._encoder = msgspec.json.Encoder()
        self._channels: dict[str, int] = {}
        header = header or RunHeader(FORMAT_VERSION, __version__, spec, fingerprint(), here())
        with self._troubled():
            self._begin(self._encoder.encode(header))

    def _begin(self, header: bytes) -> None:
        self._writer.start(profile=PROFILE, library=f"sattrack {__version__}")
        schemas, known = channel_schemas(), dict[ChannelSchema, int]()
        for topic, encoding in CHANNELS.items():
            schema = schemas[topic]
            if schema not in known:
                known[schema] = self._writer.register_schema(*schema)
            self._channels[topic] = self._writer.register_channel(topic, encoding, known[schema])
        self._add(RUN, 0.0, header)
        self._writer.flush()  # type: ignore[no-untyped-call]

    def status(self, utc_s: float, data: bytes) -> None:
        """See Sink."""
        self.write(STATUS, utc_s, data)

    def command(self, utc_s: float, data: bytes) -> None:
        """See Sink."""
        self.write(COMMAND, utc_s, data)

    def repeat(self, utc_s: float, data: bytes) -> None:
        """See Sink."""
        self.write(REPEAT, utc_s, data)

    def operator(self, utc_s: float, message: Message) -> None:
        """See Sink."""
        self.write(OPERATOR, utc_s, self._encoder.encode(message))

    def view(self, utc_s: float, view: TrackView) -> None:
        """See Sink."""
        self.write(VIEW, utc_s, self._encoder.encode(view))

    def failure(self, utc_s: float, words: str) -> None:
        """See Sink."""
        self.write(FAILURE, utc_s, self._encoder.encode(Failure(words)))

    def summary(self, utc_s: float, summary: Summary) -> None:
        """See Sink."""
        self.write(SUMMARY, utc_s, self._encoder.encode(summary))

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
                self._writer.finish()  # type: ignore[no-untyped-call]
        with self._troubled():
            self._stream.close()

    def _add(self, topic: str, utc_s: float, data: bytes) -> None:
        self._sequence += 1
        at = to_ns(utc_s)
        self._writer.add_message(self._channels[topic], at, data, at, self._sequence)

    @contextmanager
    def _troubled(self) -> Iterator[None]:
        """Turn what goes wrong into words; the first says it."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            self.trouble = self.trouble or f"the recording cannot be written: {reason}; it ends here"


class BackgroundRecorder:
    """A recorder behind a queue and a thread, so that a slow disk never holds the loop.

    The loop takes no lock that the thread may hold: a thread that is kept from running would hold it up.
    `trouble` says what went wrong, if anything did; the run goes on without its recording then.
    """

    wanted = True

    def __init__(self, recorder: Recorder, patience_s: float = CLOSE_PATIENCE_S) -> None:
        self._recorder = recorder
        self._patience_s = patience_s
        self._queue: queue.SimpleQueue[tuple[str, float, _Told] | None]
        self._queue = queue.SimpleQueue()
        self._trouble: str | None = None
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> str | None:
        """See Sink."""
        return self._trouble or self._recorder.trouble

    def status(self, utc_s: float, data: bytes) -> None:
        """See Sink."""
        self._put((STATUS, utc_s, data))

    def command(self, utc_s: float, data: bytes) -> None:
        """See Sink."""
        self._put((COMMAND, utc_s, data))

    def repeat(self, utc_s: float, data: bytes) -> None:
        """See Sink."""
        self._put((REPEAT, utc_s, data))

    def operator(self, utc_s: float, message: Message) -> None:
        """See Sink."""
        self._put((OPERATOR, utc_s, message))

    def view(self, utc_s: float, view: TrackView) -> None:
        """See Sink."""
        self._put((VIEW, utc_s, view))

    def failure(self, utc_s: float, words: str) -> None:
        """See Sink."""
        self._put((FAILURE, utc_s, Failure(words)))

    def summary(self, utc_s: float, summary: Summary) -> None:
        """See Sink."""
        self._put((SUMMARY, utc_s, summary))

    def close(self) -> None:
        """Write what is queued and finish the file; a disk that stands still is left after a while."""
        self._queue.put(None)
        self._thread.join(self._patience_s)
        if self._thread.is_alive():
            self._trouble = "the disk does not answer; the recording ends where it stands"
        else:
            self._recorder.close()

    def _put(self, item: tuple[str, float, _Told]) -> None:
        if self.trouble is not None:
            return
        if self._queue.qsize() >= QUEUED_MOST:
            self._trouble = "the disk is too slow; the recording ends here"
            return
        self._queue.put(item)

    def _work(self) -> None:
        encoder = msgspec.json.Encoder()
        while (item := self._queue.get()) is not None:
            if self.trouble is not None:
                continue
            topic, utc_s, what = item
            try:
                self._recorder.write(topic, utc_s, what if isinstance(what, bytes) else encoder.encode(what))
            except Exception as error:  # noqa: BLE001 - a thread that died would leave the queue to fill
                self._trouble = f"the recording cannot be written: {error}; it ends here"

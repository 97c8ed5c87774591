"""The journal of a schedule's run, in SQLite: every event, kept before anything is done that follows from it.

What is known is the fold of the events; a run is taken up again by folding them anew. Besides, a heartbeat
tells when the runner was last alive, and how far the go at a pass had come.
"""

from __future__ import annotations

import fcntl
import os
import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.errors import SattrackError
from sattrack.runtime.utc_json import decode_utc, encode_utc
from sattrack.schedule import machine
from sattrack.schedule.night import Doing, Happening, Run

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sattrack.schedule.night import NightPass

LAYOUT = 1
FILE_NAME, LOCK_NAME = "journal.sqlite3", "lock"
_TABLES = """
CREATE TABLE IF NOT EXISTS events (
    number INTEGER PRIMARY KEY,
    utc_s REAL NOT NULL,
    event TEXT NOT NULL,
    state TEXT NOT NULL,
    doing TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS beat (one INTEGER PRIMARY KEY CHECK (one = 1), beat TEXT NOT NULL);
"""


class Beat(msgspec.Struct, frozen=True):
    """The last sign of life, POSIX seconds of UTC, and what was known by then of the go at a pass named `go`.

    The rest is of a simulated mount: its axes' angles, whether its drives have power, and how many jumps of
    its clock were had.
    """

    utc_s: float
    go: str | None = None
    on_target_s: float = 0.0
    recording: str | None = None
    hour_angle_deg: float | None = None
    dec_deg: float | None = None
    power: bool = True
    jumps: int = 0
    clock_s: float = 0.0


def go_name(one: NightPass, part: int) -> str:
    """Return the name of a go at a pass."""
    return f"{one.key}#{part}"


class Entry(msgspec.Struct, frozen=True):
    """One event of the journal, and what followed from it; `event` and `doing` as JSON."""

    number: int
    utc_s: float
    event: str
    state: str
    doing: str


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only runner of a folder. Raises SattrackError, naming the other's process, where one is."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK_NAME).open("a+", encoding="ascii")
    except OSError as error:
        raise SattrackError(f"cannot keep the journal in {folder}: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.seek(0)
            who = file.read(20).strip() or "another process"
            raise SattrackError(
                f"{folder}: process {who} runs this schedule; look at it with run FILE --status, or end it"
            ) from None
        file.seek(0)
        file.truncate()
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


def holder(folder: Path) -> int | None:
    """Return the process number of the runner of a folder; None where none runs."""
    try:
        with (folder / LOCK_NAME).open("r", encoding="ascii") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return int(file.read(20))
    except (OSError, ValueError):
        pass
    return None


class Journal:
    """One run's journal; with `durable` every event is on the disk, else in the system's hands, at once.

    Raises SattrackError where the file cannot be used, or was made by another version.
    """

    def __init__(self, file: Path, durable: bool = True) -> None:
        """Open it, or begin a new one."""
        self._file = file
        try:
            self._base = sqlite3.connect(file, isolation_level=None)
            self._base.execute("PRAGMA journal_mode = WAL")
            self._base.execute(f"PRAGMA synchronous = {'FULL' if durable else 'OFF'}")
            version = self._base.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, LAYOUT):
                raise SattrackError(f"{file}: the journal of another version of sattrack; move it away")
            self._base.executescript(_TABLES)
            self._base.execute(f"PRAGMA user_version = {LAYOUT}")
        except sqlite3.Error as error:
            raise SattrackError(f"{file}: no journal to be used: {error}; move it away") from None
        self._count = 0

    def close(self) -> None:
        """Let the file go."""
        self._base.close()

    def fold(self, run: Run) -> Run:
        """Return what is known after all events, from a run that knows nothing."""
        for entry in self.entries():
            event = msgspec.json.decode(entry.event, type=Happening, dec_hook=decode_utc)
            run, _ = machine.step(run, event)
            if run.state != entry.state:
                raise SattrackError(
                    f"{self._file}: event {entry.number} led to {entry.state!r} then, to {run.state!r} now: "
                    "the journal of another version of sattrack; move it away"
                )
            self._count = entry.number
        return run

    def entries(self) -> Iterator[Entry]:
        """Yield all events in their order."""
        try:
            rows = self._base.execute("SELECT number, utc_s, event, state, doing FROM events ORDER BY number")
            for row in rows:
                yield Entry(*row)
        except sqlite3.Error as error:
            raise SattrackError(f"{self._file}: the journal cannot be read: {error}") from None

    def append(self, event: Happening, run: Run, doing: Doing) -> None:
        """Keep an event; it is kept when this returns. Raises SattrackError, on a full disk for instance."""
        self._count += 1
        row = (self._count, event.utc_s, encoded(event).decode(), run.state.value, encoded(doing).decode())
        try:
            self._base.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?)", row)
        except sqlite3.Error as error:
            raise SattrackError(f"{self._file}: the journal cannot be written: {error}") from None

    def beat(self, beat: Beat) -> None:
        """Keep a sign of life in the place of the last one."""
        try:
            self._base.execute("INSERT OR REPLACE INTO beat VALUES (1, ?)", (encoded(beat).decode(),))
        except sqlite3.Error as error:
            raise SattrackError(f"{self._file}: the journal cannot be written: {error}") from None

    def last_beat(self) -> Beat | None:
        """Return the last sign of life; None where there was none."""
        row = self._base.execute("SELECT beat FROM beat").fetchone()
        return None if row is None else msgspec.json.decode(row[0], type=Beat)


def encoded(what: Any) -> bytes:
    """Return plain data as JSON, instants as POSIX seconds."""
    return msgspec.json.encode(what, enc_hook=encode_utc)

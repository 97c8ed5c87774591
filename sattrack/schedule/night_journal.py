"""The journal of a schedule's run, in SQLite: every event, kept before anything is done that follows from it.

What is known is the fold of the events; a run is taken up again by folding them anew. Besides, a heartbeat
tells when the runner was last alive, and how far the go at a pass had come.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import sqlite3
import tempfile
import zlib
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.core.utc_json import decode_utc, encode_utc
from sattrack.schedule import machine
from sattrack.schedule.night import Doing, Go, Happening, Run
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.schedule.night import NightPass

LAYOUTS = (1, 2)
"""Of the tables; those that can be read, ours last."""
VERSION = 1
"""Of the events themselves, kept with each."""
MEMORY = "/dev/shm"
FILE_NAME, LOCK_NAME = "journal.sqlite3", "lock"
_TABLES = """
CREATE TABLE IF NOT EXISTS events (
    number INTEGER PRIMARY KEY,
    utc_s REAL NOT NULL,
    event TEXT NOT NULL,
    state TEXT NOT NULL,
    doing TEXT NOT NULL,
    version INTEGER NOT NULL,
    checksum INTEGER
);
CREATE TABLE IF NOT EXISTS beat (one INTEGER PRIMARY KEY CHECK (one = 1), beat TEXT NOT NULL);
"""
_FROM_LAYOUT_1 = """
ALTER TABLE events ADD COLUMN version INTEGER NOT NULL DEFAULT 1;
ALTER TABLE events ADD COLUMN checksum INTEGER;
"""
_SELECT = "SELECT number, utc_s, event, state, doing, version, checksum FROM events ORDER BY number"
_PID_CELLS = 12


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


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only runner of a folder. Raises SattrackError, naming the other's process, where one is."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = os.fdopen(os.open(folder / LOCK_NAME, os.O_RDWR | os.O_CREAT, 0o644), "rb+", buffering=0)
    except OSError as error:
        raise SattrackError(f"cannot keep the journal in {folder}: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            who = file.read(_PID_CELLS).decode("ascii", "replace").strip() or "another process"
            raise SattrackError(
                f"{folder}: process {who} runs this schedule; look at it with run FILE --status, or end it"
            ) from None
        # As long as the one before, so that it finds room on a full disk.
        with contextlib.suppress(OSError):
            file.write(f"{os.getpid()}\n".ljust(_PID_CELLS).encode("ascii"))
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


class DamagedJournalError(SattrackError):
    """The journal cannot be folded: bytes of it were changed, or another version of sattrack wrote it."""


_NOT_THE_FILE = frozenset(
    {
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_IOERR,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_READONLY,
        sqlite3.SQLITE_PERM,
        sqlite3.SQLITE_NOMEM,
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_LOCKED,
    }
)
"""What SQLite reports of the disk or the system, and not of a file's contents."""
_Row = tuple[int, float, str, str, str, int, int | None]


class Journal:
    """One run's journal; with `durable` every event is on the disk, else in the system's hands, at once.

    Where the disk refuses, events are kept in memory, `trouble` says so, and each later event tries again.
    Raises DamagedJournalError where the file is no journal, or that of a later version.
    """

    def __init__(self, file: Path, durable: bool = True) -> None:
        """Open it, or begin a new one."""
        self.trouble: str | None = None
        self.count = 0
        self._file, self._durable = file, durable
        self._base: sqlite3.Connection | None = None
        self._waiting: list[_Row] = []
        self._known: list[_Row] = []
        """What a disk that lets nothing be written held."""
        try:
            self._base = self._opened(file)
        except sqlite3.Error as error:
            if not _is_the_disk(error):
                raise DamagedJournalError(f"{file}: no journal to be used: {error}") from None
            self._refused(error)
            self._known = self._rows_of_a_copy()

    def _opened(self, file: Path) -> sqlite3.Connection:
        base = sqlite3.connect(file, isolation_level=None)
        try:
            base.execute("PRAGMA journal_mode = WAL")
            base.execute(f"PRAGMA synchronous = {'FULL' if self._durable else 'OFF'}")
            layout = base.execute("PRAGMA user_version").fetchone()[0]
            if layout not in (0, *LAYOUTS):
                raise DamagedJournalError(f"{file}: the journal of another version of sattrack")
            if layout == 1:
                base.executescript(_FROM_LAYOUT_1)
            base.executescript(_TABLES)
            if layout != LAYOUTS[-1]:
                base.execute(f"PRAGMA user_version = {LAYOUTS[-1]}")
            found = base.execute("PRAGMA quick_check(1)").fetchone()[0]
            if found != "ok":
                raise DamagedJournalError(f"{file}: {found}")
        except BaseException:
            base.close()
            raise
        return base

    def _rows_of_a_copy(self) -> list[_Row]:
        """Return the events of a copy in memory: SQLite opens no journal in a folder that is full."""
        try:
            with tempfile.TemporaryDirectory(dir=MEMORY if Path(MEMORY).is_dir() else None) as folder:
                for part in parts_of(self._file):
                    shutil.copyfile(part, Path(folder) / part.name)
                with contextlib.closing(self._opened(Path(folder) / self._file.name)) as base:
                    return base.execute(_SELECT).fetchall()
        except (OSError, sqlite3.Error) as error:
            raise DamagedJournalError(f"{self._file}: the journal cannot be read: {error}") from None

    def close(self) -> None:
        """Let the file go."""
        if self._base is not None:
            self._base.close()

    def fold(self, run: Run) -> Run:
        """Return what is known after all events, from a run that knows nothing.

        A last event that is cut off is left out. Raises DamagedJournalError.
        """
        entries = self._entries()
        for place, row in enumerate(entries):
            if 0 < place == len(entries) - 1 and not _is_whole(row):
                self._forget(row)
                break
            run = self._folded(run, row, place + 1)
            self.count = place + 1
        return run

    def _folded(self, run: Run, row: _Row, number: int) -> Run:
        if row[0] != number:
            raise DamagedJournalError(f"{self._file}: event {number} is missing")
        if not _is_whole(row):
            raise DamagedJournalError(f"{self._file}: event {number} was changed")
        if row[5] != VERSION:
            raise DamagedJournalError(f"{self._file}: event {number} is of version {row[5]}, not {VERSION}")
        try:
            event = msgspec.json.decode(row[2], type=Happening, dec_hook=decode_utc)
            run, _ = machine.step(run, event)
        except Exception as error:  # noqa: BLE001 - whatever an event of another version does to the machine
            raise DamagedJournalError(f"{self._file}: event {number} cannot be read: {error!r}") from None
        if run.state != row[3]:
            raise DamagedJournalError(
                f"{self._file}: event {number} led to {row[3]!r} then, to {run.state.value!r} now"
            )
        return run

    def _entries(self) -> list[_Row]:
        if self._base is None:
            return self._known
        try:
            return self._base.execute(_SELECT).fetchall()
        except (sqlite3.Error, OverflowError) as error:
            raise DamagedJournalError(f"{self._file}: the journal cannot be read: {error}") from None

    def _forget(self, row: _Row) -> None:
        """Take a last event away that was not written to its end."""
        if self._base is None:
            self._known.pop()
            return
        try:
            self._base.execute("DELETE FROM events WHERE number = ?", (row[0],))
        except sqlite3.Error as error:
            raise DamagedJournalError(f"{self._file}: the journal cannot be mended: {error}") from None

    def recordings(self) -> list[tuple[float, str]]:
        """Return the recordings that this run made, each with the instant at which it was over."""
        found: list[tuple[float, str]] = []
        for row in (*self._entries(), *self._waiting):
            if '"recording":"' in row[2]:
                told = msgspec.json.decode(row[2], type=_Recorded)
                name = told.recording if told.go is None else told.go.recording
                found += [] if name is None else [(row[1], name)]
        return found

    def followed(self) -> frozenset[int]:
        """Return the catalogue numbers of the satellites that were followed so far."""
        run, found = Run(), set[int]()
        for row in (*self._entries(), *self._waiting):
            run, _ = machine.step(run, msgspec.json.decode(row[2], type=Happening, dec_hook=decode_utc))
            pairs = zip(run.passes, run.results, strict=False)
            found |= {one.elements.catalog_number for one, result in pairs if result.on_target_s > 0.0}
        return frozenset(found)

    def append(self, event: Happening, run: Run, doing: Doing) -> None:
        """Keep an event: on the disk when this returns, or in memory, and `trouble` says so."""
        self.count += 1
        row: _Row = (
            *(self.count, event.utc_s, encoded(event).decode(), run.state.value, encoded(doing).decode()),
            *(VERSION, None),
        )
        self._waiting.append((*row[:6], _checksum(row)))
        self._write_waiting()

    def _write_waiting(self) -> None:
        try:
            if self._base is None:
                self._base = self._opened(self._file)
            while self._waiting:
                self._base.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?)", self._waiting[0])
                self._waiting.pop(0)
            self.trouble = None
        except (sqlite3.Error, DamagedJournalError) as error:
            self._refused(error)

    def _refused(self, error: Exception) -> None:
        self.trouble = f"{self._file}: the journal cannot be written: {error}; the run goes on without it"

    def beat(self, beat: Beat) -> None:
        """Keep a sign of life in the place of the last one."""
        if self.trouble is not None:
            self._write_waiting()
        if self._base is None or self.trouble is not None:
            return
        try:
            self._base.execute("INSERT OR REPLACE INTO beat VALUES (1, ?)", (encoded(beat).decode(),))
        except sqlite3.Error as error:
            self._refused(error)

    def last_beat(self) -> Beat | None:
        """Return the last sign of life; None where there was none, or it cannot be read."""
        if self._base is None:
            return None
        try:
            row = self._base.execute("SELECT beat FROM beat").fetchone()
            return None if row is None else msgspec.json.decode(row[0], type=Beat)
        except (sqlite3.Error, msgspec.MsgspecError, TypeError, ValueError):
            return None


class _Recorded(msgspec.Struct):
    """What an event tells of a recording."""

    go: Go | None = None
    recording: str | None = None


def parts_of(file: Path) -> list[Path]:
    """Return the files of a journal that are there."""
    found = [file.with_name(file.name + ending) for ending in ("", "-wal", "-shm")]
    return [part for part in found if os.path.lexists(part)]


def set_aside(file: Path, utc_s: float) -> str | None:
    """Give a damaged journal another name, and return that; None where nothing is there.

    Raises SattrackError where it cannot be.
    """
    stamp = Utc(utc_s).isoformat("seconds").translate({ord(c): None for c in "-:"})
    name, count = f"{file.name}.damaged-{stamp}", 1
    while os.path.lexists(file.with_name(name)):
        count += 1
        name = f"{file.name}.damaged-{stamp}-{count}"
    moved = None
    for part in parts_of(file):
        try:
            moved = name
            part.rename(part.with_name(name + part.name.removeprefix(file.name)))
        except OSError as error:
            raise SattrackError(f"{part}: the journal cannot be set aside: {error.strerror}") from None
    return moved


def _is_whole(row: _Row) -> bool:
    """Tell whether an event is as it was written; the first layout had no checksums."""
    return row[6] is None or row[6] == _checksum(row)


def _checksum(row: _Row) -> int:
    return zlib.crc32("\0".join(str(value) for value in row[:6]).encode("utf-8", "surrogatepass"))


def _is_the_disk(error: sqlite3.Error) -> bool:
    # The lowest byte is the code, the others say more of it.
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in _NOT_THE_FILE


def encoded(what: Any) -> bytes:
    """Return plain data as JSON, instants as POSIX seconds."""
    return msgspec.json.encode(what, enc_hook=encode_utc)

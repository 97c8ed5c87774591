"""The folder of a schedule's run: its journal, status, summaries, recordings and elements.

The journal, in SQLite, keeps every event before anything is done that follows from it. What is known is the
fold of the events; a run continues by folding them anew. Besides, a heartbeat tells when the runner was last
alive, and how far the attempt at a pass had come.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sqlite3
import tempfile
import time
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from sattrack.core.clock import decode_utc, encode_utc
from sattrack.core.errors import NO_JSON, SattrackError
from sattrack.core.files import replace_file
from sattrack.mount.profiles import profile_text
from sattrack.schedule import machine
from sattrack.schedule.night import (
    Event,
    FinishedPass,
    FollowedPass,
    Mount,
    Order,
    PassAttempt,
    Recovered,
    Run,
    object_number,
)
from sattrack.schedule.night_stop import holder, resume_command, stop_of
from sattrack.schedule.summary import page, summary_name, text_lines
from sattrack.views.schedule import ScheduleView
from tle.errors import TleError
from tle.instants import DAY_S, Utc
from tle.sources import write_elements

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.profiles import ProfileFile
    from sattrack.schedule.night import NightPass
    from sattrack.schedule.schema import Recordings


LAYOUTS = (1, 2)
"""Of the tables; those that can be read, ours last."""
VERSION = 1
"""Of the events themselves, kept with each."""
MEMORY = "/dev/shm"
FILE_NAME = "journal.sqlite3"
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


class Heartbeat(msgspec.Struct, frozen=True):
    """When the runner was last alive, POSIX seconds of UTC, and what was known then of `attempt` at a pass.

    The rest is of a simulated mount: its axes' angles, whether its drives have power, and how many jumps of
    its clock were had.
    """

    utc_s: float
    attempt: str | None = msgspec.field(default=None, name="go")
    on_target_s: float = 0.0
    recording: str | None = None
    hour_angle_deg: float | None = None
    dec_deg: float | None = None
    power: bool = True
    jumps: int = 0


def attempt_name(one: NightPass, part: int) -> str:
    """Return the name of an attempt at a pass."""
    return f"{one.key}#{part}"


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
        except UnicodeDecodeError as error:
            # SQLite's words quote what is damaged.
            base.close()
            raise DamagedJournalError(f"{file}: no journal to be used: {error}") from None
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
        """Close the file."""
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
            event = msgspec.json.decode(row[2], type=Event, dec_hook=decode_utc)
            run, _ = machine.step(run, event)
        except Exception as error:  # noqa: BLE001 - an event of another version may raise anything in the machine
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
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
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
                event = msgspec.json.decode(row[2], type=_Recorded)
                name = event.recording if event.attempt is None else event.attempt.recording
                found += [] if name is None else [(row[1], name)]
        return found

    def followed(self) -> tuple[FollowedPass, ...]:
        """Return the passes that were followed so far, in order of their culmination."""
        run, found = Run(), set[FollowedPass]()
        for row in (*self._entries(), *self._waiting):
            run, _ = machine.step(run, msgspec.json.decode(row[2], type=Event, dec_hook=decode_utc))
            pairs = zip(run.passes, run.results, strict=False)
            found |= {
                FollowedPass(one.object_number, one.culminate_utc_s, one.asked_by)
                for one, result in pairs
                if result.on_target_s > 0.0
            }
        return tuple(sorted(found, key=lambda one: one.culminate_utc_s))

    def append(self, event: Event, run: Run, order: Order) -> None:
        """Keep an event: on the disk when this returns, or in memory, with `trouble` set."""
        self.count += 1
        row: _Row = (
            *(self.count, event.utc_s, encoded(event).decode(), run.state.value, encoded(order).decode()),
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
        self.trouble = f"{self._file}: the journal cannot be written: {error}; the run continues without it"

    def beat(self, beat: Heartbeat) -> None:
        """Keep a sign of life in the place of the last one."""
        if self.trouble is not None:
            self._write_waiting()
        if self._base is None or self.trouble is not None:
            return
        try:
            self._base.execute("INSERT OR REPLACE INTO beat VALUES (1, ?)", (encoded(beat).decode(),))
        except sqlite3.Error as error:
            self._refused(error)

    def last_heartbeat(self) -> Heartbeat | None:
        """Return the last sign of life; None where there was none, or it cannot be read."""
        if self._base is None:
            return None
        try:
            row = self._base.execute("SELECT beat FROM beat").fetchone()
            return None if row is None else msgspec.json.decode(row[0], type=Heartbeat)
        except (sqlite3.Error, msgspec.MsgspecError, TypeError, ValueError):
            return None


class _Recorded(msgspec.Struct):
    """The part of an event that names a recording."""

    attempt: PassAttempt | None = msgspec.field(default=None, name="go")
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
    """Return whether an event is as it was written; the first layout had no checksums."""
    return row[6] is None or row[6] == _checksum(row)


def _checksum(row: _Row) -> int:
    return zlib.crc32("\0".join(str(value) for value in row[:6]).encode("utf-8", "surrogatepass"))


def _is_the_disk(error: sqlite3.Error) -> bool:
    # The lowest byte is the code, the others say more of it.
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in _NOT_THE_FILE


def encoded(what: Any) -> bytes:
    """Return plain data as JSON, instants as POSIX seconds."""
    return msgspec.json.encode(what, enc_hook=encode_utc)


STATUS, PROFILE = "status.json", "mount.toml"
MOST_OF_A_NAME = 60
"""Characters, of one byte each: file systems take 255 bytes for the whole name of a file."""


def name_part(name: str) -> str:
    """Return a target's name as part of a file's name, its beginning where it is long."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:MOST_OF_A_NAME].rstrip("_") or "target"


SUMMARIES, RECORDINGS, ELEMENTS = "summaries", "recordings", "elements"
OLD_AFTER_S = 3.0
BYTES_PER_GB = 1e9
LEAST_FREE_BYTES = 50e6
"""With less than that, a pass is followed without a recording."""


def free_bytes(folder: Path) -> float:
    """Return how much may be written to a folder's disk. Raises OSError."""
    return float(shutil.disk_usage(folder).free)


class NightFiles:
    """The files of one folder; every method raises SattrackError where they cannot be written."""

    def __init__(self, folder: Path, schedule: str, free: Callable[[Path], float] = free_bytes) -> None:
        """Take the folder, the schedule's name for people, and what returns the free space."""
        self.folder, self.schedule, self._free = folder, schedule, free

    def tell(self, view: ScheduleView) -> None:
        """Put the status in the place of the last one: a reader never gets half of it."""
        data = msgspec.json.encode(view) + b"\n"
        try:
            self._write(STATUS, data)
        except SattrackError as error:
            # A full disk has room where a status was; spaces at the end are JSON too.
            with contextlib.suppress(OSError), (self.folder / STATUS).open("rb+") as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(0)
                file.write(data.ljust(size))
            raise error from None

    def sum_up(self, run: Run) -> str:
        """Write a night's summary as text and as HTML; return the text's name in the folder."""
        name = f"{SUMMARIES}/{summary_name(run)}"
        text = "\n".join(text_lines(run, self.schedule)) + "\n"
        self._write(f"{name}.html", page(run, self.schedule, "../").encode())
        self._write(f"{name}.txt", text.encode())
        return f"{name}.txt"

    def recording(self, one: NightPass, part: int) -> str:
        """Return the name in the folder of a new recording of an attempt at a pass."""
        start = Utc(one.start_utc_s).isoformat("seconds").translate({ord(c): None for c in "-:"})
        stem = f"{RECORDINGS}/{start}-{one.catalog_number or name_part(one.name)}"
        try:
            (self.folder / RECORDINGS).mkdir(parents=True, exist_ok=True)
            name, count = f"{stem}-{part}.mcap", 1
            while (self.folder / name).exists():
                count += 1
                name = f"{stem}-{part}-{count}.mcap"
        except OSError as error:
            raise SattrackError(f"cannot write {self.folder / RECORDINGS}: {error.strerror}") from None
        return name

    def elements(self, one: NightPass) -> Path:
        """Write the elements that a pass is followed by; return where."""
        assert one.elements is not None
        name = f"{ELEMENTS}/{one.elements.catalog_number}.json"
        return self._write_somewhere(name, write_elements([one.elements], "json").encode())

    def profile(self, profile: ProfileFile) -> Path:
        """Write the mount's profile for sessions; return where."""
        return self._write_somewhere(PROFILE, profile_text(profile).encode())

    def _write_somewhere(self, name: str, data: bytes) -> Path:
        """Write what sessions need, into memory where the disk is full; return where."""
        try:
            self._write(name, data)
        except SattrackError:
            if self.folder == self._spare or not Path(MEMORY).is_dir():
                raise
            return NightFiles(self._spare, self.schedule)._write_somewhere(name, data)
        return self.folder / name

    @property
    def _spare(self) -> Path:
        return Path(MEMORY) / f"sattrack-{os.getpid()}"

    def clear_memory(self) -> None:
        """Take away what a full disk has made us keep in memory."""
        shutil.rmtree(self._spare, ignore_errors=True)

    def make_room(
        self, made: list[tuple[float, str]], rule: Recordings, now_utc_s: float, night_from_utc_s: float
    ) -> list[str]:
        """Delete old recordings by a schedule's rule, the oldest first; return their names.

        `made` are those that this run made, each with the instant at which it was over. None is deleted that
        was over since this night began, and nothing else in the folder.

        Age is counted to now, but at most to a day after the last recording before this night: a clock that
        is far ahead for a night deletes no more than a day would.
        """
        gone = []
        before = sorted(each for each in made if each[0] < night_from_utc_s)
        counted_to_utc_s = min(now_utc_s, before[-1][0] + DAY_S) if before else now_utc_s
        for over_utc_s, name in before:
            file = self.folder / name
            if not _is_recording(file, self.folder):
                continue
            old = rule.keep_days is not None and counted_to_utc_s - over_utc_s > rule.keep_days * DAY_S
            if not (old or self._too_full(rule)):
                continue
            with contextlib.suppress(OSError):
                file.unlink()
                gone.append(name)
        return gone

    def _too_full(self, rule: Recordings) -> bool:
        if rule.keep_free_gb is None:
            return False
        try:
            return self._free(self.folder) < rule.keep_free_gb * BYTES_PER_GB
        except OSError:
            return False

    def no_room(self) -> str | None:
        """Return why a pass is followed without a recording; None where there is room for one."""
        try:
            left = self._free(self.folder)
        except OSError as error:
            return f"{self.folder}: the disk's free space is unknown: {error.strerror}; passes go unrecorded"
        if left >= LEAST_FREE_BYTES:
            return None
        return (
            f"{self.folder}: the disk has {left / 1e6:.0f} MB left, {LEAST_FREE_BYTES / 1e6:.0f} are needed: "
            "passes go unrecorded"
        )

    def _write(self, name: str, data: bytes) -> None:
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, data, synced=False)
        except OSError as error:
            raise SattrackError(f"cannot write {path}: {error.strerror}") from None


def _is_recording(file: Path, folder: Path) -> bool:
    """Return whether a name that was kept is that of a file in the folder of recordings, and no link.

    A file that the system does not show is none.
    """
    try:
        return file.parent == folder / RECORDINGS and file.is_file() and not file.is_symlink()
    except OSError:
        return False


class OpenedRun(NamedTuple):
    """A run's journal, the run it gives, and what replaces it where it could not be read."""

    journal: Journal
    run: Run
    recovered: Recovered | None = None
    words: str | None = None


def open_run(folder: Path, utc_s: float, durable: bool = True) -> OpenedRun:
    """Open a run's journal; a damaged one is set aside, and the last status replaces it as far as it can.

    Raises SattrackError where the folder lets nothing be done.
    """
    file, view = folder / FILE_NAME, _last_view(folder)
    journal = None
    try:
        journal = Journal(file, durable)
        run = journal.fold(Run())
        if view is None or view.events <= journal.count:
            return OpenedRun(journal, run)
        why = f"{file} holds {journal.count} events, and {STATUS} was written after {view.events}"
    except DamagedJournalError as error:
        why = str(error)
    if journal is not None:
        journal.close()
    name = set_aside(file, utc_s)
    words = why if name is None else f"{why}; it was set aside as {name}"
    if view is None:
        return OpenedRun(Journal(file, durable), Run(), words=f"{words}, and the night starts again")
    recovered = _recovered(view)
    return OpenedRun(
        Journal(file, durable), Run(), recovered, f"{words}, and the night continues from {STATUS}"
    )


def _last_view(folder: Path) -> ScheduleView | None:
    try:
        return msgspec.json.decode((folder / STATUS).read_bytes(), type=ScheduleView)
    except (OSError, msgspec.MsgspecError, ValueError):
        return None


def _recovered(view: ScheduleView) -> Recovered | None:
    """Return what a status shows of the night; None where nothing of it can be used."""
    try:
        begin, end = (float(Utc.parse(text).unix_s) for text in (view.from_utc, view.to_utc))
        over = tuple(
            FinishedPass(
                object_number(one.catalog_number, one.name),
                *(float(Utc.parse(text).unix_s) for text in (one.culminate_utc, one.end_utc)),
            )
            for one in view.passes
            if one.state in ("done", "partly", "lost")
        )
    except TleError:
        return None
    known = view.mount in {mount.value for mount in Mount}
    mount = Mount(view.mount) if known else Mount.UNKNOWN
    return Recovered(view.night, begin, end, mount, over, view.summary)


def read_status(folder: Path) -> ScheduleView | None:
    """Return the last status of a folder; None where there is none.

    `running`, `pid`, the status' age and whether an operator's stop stands are as they are now.

    Raises SattrackError where it is none.
    """
    try:
        data = (folder / STATUS).read_bytes()
        age_s = max(0.0, time.time() - (folder / STATUS).stat().st_mtime)
        view = msgspec.json.decode(data, type=ScheduleView)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError, *NO_JSON) as error:
        raise SattrackError(f"{folder / STATUS}: no status to be read: {error}") from None
    pid, stop = holder(folder), stop_of(folder)
    age_s = round(age_s + view.silent_s, 1)
    view = msgspec.structs.replace(
        view, running=pid is not None, pid=pid, age_s=age_s, old=pid is not None and age_s > OLD_AFTER_S
    )
    if stop is None:
        return view
    resume = resume_command(view.schedule, folder)
    return msgspec.structs.replace(view, stopped_utc=stop.since_utc, stopped_by=stop.by, resume=resume)

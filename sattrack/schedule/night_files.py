"""The folder of a schedule's run: the status for whoever looks, summaries, recordings, elements."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import tomli_w

from sattrack.core.errors import SattrackError
from sattrack.schedule.night import Mount, Over, Recovered, Run
from sattrack.schedule.night_journal import (
    FILE_NAME,
    MEMORY,
    DamagedJournalError,
    Journal,
    holder,
    set_aside,
)
from sattrack.schedule.night_stop import resume_command, stop_of
from sattrack.schedule.summary import page, summary_name, text_lines
from sattrack.views.schedule import ScheduleView
from tle.errors import TleError
from tle.formats.registry import write_elements
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.profiles import ProfileFile
    from sattrack.schedule.night import NightPass
    from sattrack.schedule.schema import Recordings

STATUS, PROFILE, PART = "status.json", "mount.toml", ".part-"
SUMMARIES, RECORDINGS, ELEMENTS = "summaries", "recordings", "elements"
OLD_AFTER_S = 3.0
DAY_S, BYTES_PER_GB = 86400.0, 1e9
LEAST_FREE_BYTES = 50e6
"""With less than that, a pass is followed without a recording."""


def free_bytes(folder: Path) -> float:
    """Return how much may be written to a folder's disk. Raises OSError."""
    return float(shutil.disk_usage(folder).free)


class NightFiles:
    """The files of one folder; every method raises SattrackError where they cannot be written."""

    def __init__(self, folder: Path, schedule: str, free: Callable[[Path], float] = free_bytes) -> None:
        """Take the folder, the schedule's name for people, and what tells how much room is left."""
        self.folder, self.schedule, self._free = folder, schedule, free

    def tell(self, view: ScheduleView) -> None:
        """Put the status in the place of the last one: nobody ever reads half."""
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
        """Return the name in the folder of a new recording of a go at a pass."""
        start = Utc(one.start_utc_s).isoformat("seconds").translate({ord(c): None for c in "-:"})
        stem = f"{RECORDINGS}/{start}-{one.elements.catalog_number}"
        try:
            (self.folder / RECORDINGS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SattrackError(f"cannot write {self.folder / RECORDINGS}: {error.strerror}") from None
        name, count = f"{stem}-{part}.mcap", 1
        while (self.folder / name).exists():
            count += 1
            name = f"{stem}-{part}-{count}.mcap"
        return name

    def elements(self, one: NightPass) -> Path:
        """Write the elements that a pass is followed by; return where."""
        name = f"{ELEMENTS}/{one.elements.catalog_number}.json"
        return self._write_somewhere(name, write_elements([one.elements], "json").encode())

    def profile(self, profile: ProfileFile) -> Path:
        """Write the mount's profile as sessions are to have it; return where."""
        said = {name: value for name, value in msgspec.to_builtins(profile).items() if value is not None}
        return self._write_somewhere(PROFILE, tomli_w.dumps(_without_none(said)).encode())

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
        """
        gone = []
        for over_utc_s, name in sorted(made):
            file = self.folder / name
            if over_utc_s >= night_from_utc_s or not _is_recording(file, self.folder):
                continue
            old = rule.keep_days is not None and now_utc_s - over_utc_s > rule.keep_days * DAY_S
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
        """Return why a pass is followed without a recording, in words; None where there is room for one."""
        try:
            left = self._free(self.folder)
        except OSError as error:
            return f"{self.folder}: nobody knows how full the disk is: {error.strerror}; passes go unrecorded"
        if left >= LEAST_FREE_BYTES:
            return None
        return (
            f"{self.folder}: the disk has {left / 1e6:.0f} MB left, {LEAST_FREE_BYTES / 1e6:.0f} are needed: "
            "passes go unrecorded"
        )

    def _write(self, name: str, data: bytes) -> None:
        path = self.folder / name
        temporary = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=PART)
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            Path(temporary).chmod(0o644)
            Path(temporary).replace(path)
        except OSError as error:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)
            raise SattrackError(f"cannot write {path}: {error.strerror}") from None


def _is_recording(file: Path, folder: Path) -> bool:
    """Tell whether a name that was kept is that of a file in the folder of recordings, and no link."""
    return file.parent == folder / RECORDINGS and file.is_file() and not file.is_symlink()


class TakenUp(NamedTuple):
    """A run's journal, what it says, and what stands in for it where it could not be read."""

    journal: Journal
    run: Run
    recovered: Recovered | None = None
    words: str | None = None


def take_up(folder: Path, utc_s: float, durable: bool = True) -> TakenUp:
    """Open a run's journal; a damaged one is set aside, and the last status tells what it can.

    Raises SattrackError where the folder lets nothing be done.
    """
    file, view = folder / FILE_NAME, _last_view(folder)
    journal = None
    try:
        journal = Journal(file, durable)
        run = journal.fold(Run())
        if view is None or view.events <= journal.count:
            return TakenUp(journal, run)
        why = f"{file} holds {journal.count} events, and {STATUS} was written after {view.events}"
    except DamagedJournalError as error:
        why = str(error)
    if journal is not None:
        journal.close()
    name = set_aside(file, utc_s)
    words = why if name is None else f"{why}; it was set aside as {name}"
    if view is None:
        return TakenUp(Journal(file, durable), Run(), words=f"{words}, and the night begins anew")
    recovered = _recovered(view)
    return TakenUp(Journal(file, durable), Run(), recovered, f"{words}, and the night goes on by {STATUS}")


def _last_view(folder: Path) -> ScheduleView | None:
    try:
        return msgspec.json.decode((folder / STATUS).read_bytes(), type=ScheduleView)
    except (OSError, msgspec.MsgspecError, ValueError):
        return None


def _recovered(view: ScheduleView) -> Recovered | None:
    """Return what a status says of the night; None where it says nothing that can be used."""
    try:
        begin, end = (float(Utc.parse(text).unix_s) for text in (view.from_utc, view.to_utc))
        over = tuple(
            Over(one.catalog_number, float(Utc.parse(one.culminate_utc).unix_s))
            for one in view.passes
            if one.state in ("done", "partly", "lost")
        )
    except TleError:
        return None
    known = view.mount in {mount.value for mount in Mount}
    mount = Mount(view.mount) if known else Mount.UNKNOWN
    return Recovered(view.night, begin, end, mount, over, view.summary)


def _without_none(value: Any) -> Any:
    """Return plain data without what is None, which TOML cannot say."""
    if isinstance(value, dict):
        return {key: _without_none(each) for key, each in value.items() if each is not None}
    return [_without_none(each) for each in value] if isinstance(value, list | tuple) else value


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
    except (OSError, msgspec.MsgspecError) as error:
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

"""Who runs a schedule, an operator's stop of its run, and the list of this user's runs.

A stop is a file in the run's folder. It is there before the mount is asked to stop, a runner that starts
looks for it first, and only `sattrack run FILE --resume` takes it away. That the file exists is the stop: an
empty or damaged one counts as well.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shlex
import signal
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from sattrack.core import local_time
from sattrack.core.errors import SattrackError
from sattrack.core.files import lock_file, open_regular, user_folder
from sattrack.core.process import signals_here
from sattrack.runtime.system import handling, this_command, this_user, user_of, utc_now
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

STOP_NAME, LOCK_NAME, PID_CELLS = "stop.json", "lock", 12
LONGEST_BY, LONGEST_RECORD = 200, 16384
MOMENT_S, WRITTEN_WITHIN_S, ENDS_WITHIN_S = 0.5, 5.0, 15.0
LOOK_AGAIN_S = 0.1


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only runner of a folder. Raises SattrackError, naming the other's process, where one is."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = os.fdopen(os.open(folder / LOCK_NAME, os.O_RDWR | os.O_CREAT, 0o600), "rb+", buffering=0)
    except OSError as error:
        raise SattrackError(f"cannot keep the journal in {folder}: {error.strerror}") from None
    with file:
        try:
            lock_file(file, wait=False)
        except OSError:
            who = file.read(PID_CELLS).decode("ascii", "replace").strip() or "another process"
            raise SattrackError(
                f"{folder}: process {who} runs this schedule; look at it with run FILE --status, or end it"
            ) from None
        # As long as the one before, so that it finds room on a full disk.
        with contextlib.suppress(OSError):
            file.write(f"{os.getpid()}\n".ljust(PID_CELLS).encode("ascii"))
        yield


def holder(folder: Path) -> int | None:
    """Return the process number of the runner of a folder; None where none runs.

    A number counts only where the process is one of the user's who has written it: it may be signalled.
    """
    if sys.platform == "win32":
        return None
    import fcntl

    try:
        with open_regular(folder / LOCK_NAME) as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                pid = int(file.read(PID_CELLS))
                user = user_of(pid)
                return pid if pid > 1 and user in (None, os.fstat(file.fileno()).st_uid) else None
    except (OSError, ValueError):
        pass
    return None


class OperatorStop(msgspec.Struct, frozen=True):
    """Since when a run is stopped by an operator, and by which command."""

    since_utc: str = "an unknown instant"
    by: str = "an operator"

    def __str__(self) -> str:
        """Say it in words."""
        return f"stopped by an operator ({self.by}) at {local_time.localised(self.since_utc)}"


class ListedRun(msgspec.Struct, frozen=True):
    """A schedule's run that goes on, or that a restart would continue; `mount` as its owner's name."""

    folder: str
    schedule: str
    mount: str | None

    @property
    def runner(self) -> int | None:
        """The process that runs it; None where none does."""
        return holder(Path(self.folder))

    @property
    def resume(self) -> str:
        """The command that takes a stop back and goes on."""
        return resume_command(self.schedule, Path(self.folder))


def resume_command(schedule: str, folder: Path) -> str:
    """Return the command that takes a stop of a run back and goes on with it."""
    words = ["sattrack", "run", schedule, "--resume"]
    if folder.absolute() != Path(schedule).with_suffix(".run").absolute():
        words += ["--folder", str(folder)]
    return shlex.join(words)


def stop_of(folder: Path) -> OperatorStop | None:
    """Return the operator's stop in a run's folder; None for none."""
    try:
        made_s = (folder / STOP_NAME).lstat().st_mtime
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError:
        # Nobody can tell: no reason to move anything.
        return OperatorStop()
    try:
        with open_regular(folder / STOP_NAME) as file:
            return msgspec.json.decode(file.read(LONGEST_RECORD), type=OperatorStop)
    except (OSError, msgspec.MsgspecError, ValueError):
        return OperatorStop(Utc(made_s).isoformat("seconds"))


def keep_stop(folder: Path, by: str) -> OperatorStop:
    """Write an operator's stop to the disk; one that exists is left as it is. Raises OSError.

    On a full disk the file stays empty, which is a stop too.
    """
    stop = OperatorStop(utc_now(), by[:LONGEST_BY])
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    try:
        file = os.open(folder / STOP_NAME, flags, 0o644)
    except FileExistsError:
        return stop_of(folder) or stop
    try:
        with contextlib.suppress(OSError):
            os.write(file, msgspec.json.encode(stop) + b"\n")
            os.fsync(file)
    finally:
        os.close(file)
    _sync_folder(folder)
    return stop


def take_back_stop(folder: Path) -> OperatorStop | None:
    """Take an operator's stop back; return it, None where none stood. Raises SattrackError."""
    stop = stop_of(folder)
    if stop is not None:
        try:
            (folder / STOP_NAME).unlink()
            _sync_folder(folder)
        except OSError as error:
            raise SattrackError(
                f"{folder / STOP_NAME}: the stop cannot be taken back: {error.strerror}"
            ) from None
    return stop


def _sync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@dataclass(slots=True)
class NightRequests:
    """Requests to a runner from outside. An operator's stop is looked for in the folder each time."""

    folder: Path
    interrupted: bool = False
    """The person at its terminal ends it: what is in progress is given up."""
    terminated: bool = False
    """The system ends it: it may be restarted, and goes on with what is in progress."""
    reload: bool = False
    """It must read its schedule again."""

    @property
    def asked(self) -> bool:
        """Whether the run must stop the mount and end."""
        return self.interrupted or self.terminated or self.operator is not None

    @property
    def operator(self) -> OperatorStop | None:
        """The operator's stop in force."""
        return stop_of(self.folder)

    @property
    def restarts(self) -> bool:
        """Whether the end is one that a restart takes up again."""
        return self.terminated and not self.interrupted and self.operator is None

    @property
    def words(self) -> str:
        """Why it ends."""
        stop = self.operator
        return "interrupted" if stop is None else str(stop)


@contextmanager
def handling_signals(requests: NightRequests) -> Iterator[None]:
    """Turn signals into requests. SIGHUP reloads, unless a terminal has gone; suspending is ignored."""

    # A terminal that has gone is none any more when it is asked.
    terminals = [number for number in (0, 1, 2) if os.isatty(number)]

    def hang_up() -> None:
        if not terminals:
            requests.reload = True
            return
        requests.terminated = True
        nowhere = os.open(os.devnull, os.O_RDWR)
        for number in terminals:
            os.dup2(nowhere, number)

    def interrupt() -> None:
        requests.interrupted = True

    def terminate() -> None:
        requests.terminated = True

    handlers = dict.fromkeys(signals_here("SIGINT", "SIGQUIT"), interrupt) | {signal.SIGTERM: terminate}
    # Whoever starts a program by nohup wants it to outlive its terminal.
    handlers |= {one: hang_up for one in signals_here("SIGHUP") if signal.getsignal(one) != signal.SIG_IGN}
    with handling(handlers):
        yield


def _list_folder(home: str | None = None) -> Path:
    if home is None:
        return user_folder("XDG_STATE_HOME", ".local/state") / "nights"
    return Path(home).expanduser() / ".local/state/sattrack/nights"


def _record(folder: Path) -> Path:
    return _list_folder() / f"{hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:16]}.json"


def list_night(folder: Path, schedule: Path, mount: str | None) -> str | None:
    """Put a run on this user's list, where `sattrack stop` finds it; return what went wrong, or None."""
    record = _record(folder)
    night = ListedRun(str(folder.resolve()), str(schedule.resolve()), mount)
    if _listed(record) == night:
        return None
    try:
        record.parent.mkdir(parents=True, exist_ok=True)
        part = record.with_suffix(".part")
        part.write_bytes(msgspec.json.encode(night) + b"\n")
        part.replace(record)
    except OSError as error:
        return f"{record}: `sattrack stop` will not find this run: {error.strerror}"
    return None


def unlist_night(folder: Path) -> None:
    """Take a run off the list: it is over, or the person at its terminal has ended it."""
    with contextlib.suppress(OSError):
        _record(folder).unlink(missing_ok=True)


def listed_nights() -> list[ListedRun]:
    """Return the runs on this user's list; root has everybody's."""
    lists = [_list_folder()]
    if this_user() == 0:
        import pwd

        lists += [_list_folder(user.pw_dir) for user in pwd.getpwall() if user.pw_uid != 0]
    found: dict[str, ListedRun] = {}
    for listed in lists:
        with contextlib.suppress(OSError):
            for record in sorted(listed.glob("*.json")):
                night = _listed(record)
                if night is not None:
                    found[night.folder] = night
    return list(found.values())


def _listed(record: Path) -> ListedRun | None:
    """Return the run of a record; None where it is none, or its folder is gone or somebody else's."""
    try:
        with open_regular(record) as file:
            night = msgspec.json.decode(file.read(LONGEST_RECORD), type=ListedRun)
            writer = os.fstat(file.fileno()).st_uid
        return night if Path(night.folder).stat().st_uid in (writer, this_user()) else None
    except (OSError, ValueError, msgspec.MsgspecError):
        return None


class NightStop(msgspec.Struct, frozen=True):
    """What came of the stop of one schedule's run."""

    schedule: str
    folder: str
    kept: bool
    """Whether the stop is on the disk, for anything that may restart the run."""
    pid: int | None
    """The runner, where one goes on in spite of it."""
    words: str
    resume: str


class BegunStop:
    """The stop of one run, on its way to the disk: a disk that hangs holds up no mount's stop."""

    def __init__(self, night: ListedRun, by: str) -> None:
        self._night, self._by = night, by
        self._runner = night.runner
        self._wrong: str | None = f"{night.folder}: the disk does not answer"
        self._thread = threading.Thread(target=self._keep, name="stop", daemon=True)
        self._thread.start()

    def _keep(self) -> None:
        try:
            keep_stop(Path(self._night.folder), self._by)
            self._wrong = None
        except OSError as error:
            self._wrong = f"{self._night.folder}: {error.strerror}"

    def wait(self, within_s: float) -> None:
        """Wait until the stop is on the disk, or its time has passed."""
        self._thread.join(within_s)

    def finish(self, waiting: Callable[[], None]) -> NightStop:
        """Wait for the runner's end; return the outcome. Without a written stop it is interrupted."""
        night, runner = self._night, self._runner
        self.wait(WRITTEN_WITHIN_S)
        kept = self._wrong is None
        if not kept and runner is not None:
            with contextlib.suppress(OSError):
                os.kill(runner, signal.SIGINT)
        until_s = time.monotonic() + ENDS_WITHIN_S
        while night.runner is not None and night.runner == runner and time.monotonic() < until_s:
            waiting()
            time.sleep(LOOK_AGAIN_S)
        words = f"{night.schedule}: stopped; it follows nothing until `{night.resume}`"
        if not kept:
            words = f"{night.schedule}: A RESTART MAY GO ON: the stop cannot be kept: {self._wrong}"
        left = night.runner
        if left is not None:
            words += (
                f"; process {left} has not ended: it hangs, or does what it was at first; `kill -9 {left}`"
            )
        return NightStop(night.schedule, night.folder, kept, left, words, night.resume)


def begin_stops(nights: Sequence[ListedRun]) -> list[BegunStop]:
    """Write an operator's stop of each run to its disk; none is waited for longer than a moment."""
    by = f"`{this_command()}`, process {os.getpid()}, user {this_user()}"
    begun = [BegunStop(night, by) for night in nights]
    until_s = time.monotonic() + MOMENT_S
    for stop in begun:
        stop.wait(max(0.0, until_s - time.monotonic()))
    return begun

"""Programs that a screen starts beside itself: the passes to come, and a look at the mount."""

from __future__ import annotations

import contextlib
import os
import subprocess
import tempfile
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.own_program import ending_with_us, own_program
from sattrack.runtime.owner import owners
from sattrack.tui.child import ConsoleProcess
from sattrack.tui.console_feed import Latest
from sattrack.views.messages import Leave
from sattrack.views.run import SAME_PASS_S
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

HOURS = 12.0
LOWEST_PRIORITY = 19
GRACE_S = 2.0


class PassRow(msgspec.Struct, frozen=True):
    """One pass, as `passes --json` gives it."""

    name: str
    catalog_number: int
    rise_utc: str | None
    culminate_utc: str
    set_utc: str | None
    max_alt_deg: float
    rise_az_deg: float | None
    set_az_deg: float | None
    sunlit_from_utc: str | None
    sunlit_to_utc: str | None
    sun_alt_deg: float | None
    feasible: bool | None
    why_not: str | None

    @property
    def culminate_utc_s(self) -> float:
        """When it culminates, POSIX seconds."""
        return float(Utc.parse(self.culminate_utc).unix_s)

    def is_of(self, catalog_number: int | None, culminate_utc_s: float) -> bool:
        """Tell whether it is the pass that somebody names so."""
        near = abs(self.culminate_utc_s - culminate_utc_s) < SAME_PASS_S
        return self.catalog_number == catalog_number and near


def read_passes(data: bytes) -> tuple[PassRow, ...]:
    """Return the passes of `passes --json`; raises msgspec.MsgspecError."""
    return tuple(msgspec.json.decode(data, type=list[PassRow]))


@dataclass(frozen=True, slots=True)
class Beside:
    """How the programs are called: options of `passes` and of `mount watch`, and elements for the former.

    `passes` None: there are no elements or no site to find passes with, and `why` says so.
    """

    passes: tuple[str, ...] | None
    watch: tuple[str, ...]
    elements: bytes | None = None
    why: str = ""
    mount_url: str | None = None
    """The mount, where it is there without a run."""


class PassSearch:
    """Looks for the passes to come in a process that gives way to everything else; never waited for."""

    def __init__(self, beside: Beside) -> None:
        self._beside = beside
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._found: tuple[PassRow, ...] | None = None
        self.trouble = "" if beside.passes is not None else beside.why
        """Why there is no list; empty where there is one."""
        self.begun_utc_s: float | None = None
        """From which instant on the last search looks."""

    @property
    def busy(self) -> bool:
        """Whether a search goes on."""
        return self._thread is not None and self._thread.is_alive()

    def begin(self, utc_s: float) -> None:
        """Look for the passes from an instant on, unless a search goes on."""
        if self._beside.passes is None or self.busy:
            return
        self.begun_utc_s = utc_s
        start = ("--from", Utc(utc_s).isoformat("seconds"), "--hours", f"{HOURS:g}")
        command = [
            *own_program(),
            "passes",
            "--json",
            "--judged",
            *self._beside.passes,
            *start,
        ]
        self._thread = threading.Thread(target=self._run, args=(command,), name="passes", daemon=True)
        self._thread.start()

    def take(self) -> tuple[PassRow, ...] | None:
        """Return the passes that were found, once."""
        found, self._found = self._found, None
        return found

    def close(self) -> None:
        """End a search that goes on."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()

    def _run(self, command: list[str]) -> None:
        with tempfile.TemporaryFile() as errors:
            try:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    start_new_session=True,
                    env=ending_with_us(),
                )
            except OSError as error:
                self.trouble = f"the search for passes cannot be started: {error.strerror}"
                return
            with contextlib.suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, self._process.pid, LOWEST_PRIORITY)
            out, _ = self._process.communicate(self._beside.elements or b"")
            errors.seek(0)
            lines = errors.read().decode(errors="replace").strip().splitlines()
        try:
            self._found = read_passes(out)
            self.trouble = ""
        except msgspec.MsgspecError:
            self.trouble = lines[-1] if lines else "the search for passes said nothing"


class MountLook:
    """Looks at a run's mount in a process of its own, through whoever owns it; never waited for."""

    def __init__(self, beside: Beside, start: Callable[[list[str]], ConsoleProcess] = ConsoleProcess) -> None:
        self._beside, self._start = beside, start
        self._thread: threading.Thread | None = None
        self._console: ConsoleProcess | None = None
        self.trouble = ""

    def open(self, pid: int) -> None:
        """Begin to look at the mount that a feeder owns, unless that was begun."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._open, args=(pid,), name="mount", daemon=True)
            self._thread.start()

    def latest(self) -> Latest:
        """Return what has come since the last call."""
        return Latest() if self._console is None else self._console.latest()

    def close(self) -> None:
        """Look away; the next `open` begins anew."""
        console, self._console, self._thread = self._console, None, None
        if console is None:
            return
        console.tell(Leave())
        console.close_input()
        threading.Thread(target=_finish, args=(console,), daemon=True).start()

    def _open(self, pid: int) -> None:
        owned = [owner for owner in owners() if owner.pid == pid]
        if not owned:
            self.trouble = "no run has the mount now"
            self._thread = None
            return
        self.trouble = ""
        url = f"xerxes://{owned[0].mount}?listen={owned[0].listen_port}"
        called = ["mount", "watch", *self._beside.watch, "--mount", url, "--stream", "--control"]
        self._console = self._start([*own_program(), *called])


def _finish(console: ConsoleProcess) -> None:
    if console.wait(GRACE_S) is None:
        console.end_by_force(GRACE_S)
    console.close()


@dataclass(slots=True)
class Aside:
    """What a screen has beside it: the search for passes, the look at the mount, and whose mount that is."""

    search: PassSearch
    look: MountLook
    pid: int
    console: list[str] | None = None
    """What operates the mount by hand, where it is there without a run."""

    @classmethod
    def of(cls, beside: Beside, pid: int) -> Aside:
        """Make both for the run of a process."""
        console = None
        if beside.mount_url is not None:
            called = ["mount", "watch", *beside.watch, "--mount", beside.mount_url]
            console = [*own_program(), *called]
        return cls(PassSearch(beside), MountLook(beside), pid, console)

    def close(self) -> None:
        """End what goes on."""
        self.search.close()
        self.look.close()

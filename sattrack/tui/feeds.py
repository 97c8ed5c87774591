"""Processes that a screen starts: for a run, a mount, an antenna, and the list of passes.

A thread reads the views of such a process; messages go to its standard input. The end of that input makes it
stop the mount and leave. Nothing here needs Textual, so that a feeder starts before the screen is imported.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import msgspec

from sattrack.core.process import ending_with_us, self_command
from sattrack.mount.requests import Abort
from sattrack.runtime.mounts import owners
from sattrack.views.messages import Leave, StopNow, encode_message
from sattrack.views.run import (
    SAME_PASS_S,
    STARTER,
    AntennaView,
    ConsoleView,
    PassView,
    SessionView,
    SummaryLine,
    TrackView,
)
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.views.messages import ConsoleMessage, Message, SessionMessage
    from sattrack.views.run import Summary


ViewT = TypeVar("ViewT")


@dataclass(frozen=True, slots=True)
class News:
    """What has come since the last look, oldest first."""

    views: tuple[TrackView, ...] = ()
    ended: bool = False
    """Whether nothing more will come."""
    summary: Summary | None = None
    """What the run came to, once it has ended as it should."""
    sky: PassView | None = None
    """What is known of the pass, once it has come."""
    rewound: bool = False
    """Whether the views restart at an earlier instant: what was drawn before is void."""
    session: SessionView | None = None
    """Who has control and who watches, once that is known."""
    you: int = STARTER
    """The number of this viewer there."""
    run: int | None = None
    """The process of the run, where it can become another one."""
    between: bool = False
    """Whether a run of a schedule is over, and the next one is waited for."""


class Feed(Protocol):
    """One run, seen from outside. Neither method ever waits."""

    def news(self) -> News:
        """Return what has come since the last call."""

    def send(self, message: Message | SessionMessage) -> bool:
        """Hand a message over; False where the run can no longer be reached."""


_SUMMARY: msgspec.json.Decoder[SummaryLine] = msgspec.json.Decoder(SummaryLine)


class BufferedFeed:
    """Views and what else is known of a run: taken in by a thread of a subclass, handed out by `news`.

    At most `most_unread` views wait, the newest; None: all.
    """

    def __init__(self, most_unread: int | None = None) -> None:
        self._views: deque[TrackView] = deque(maxlen=most_unread)
        self._sky: PassView | None = None
        self._session: SessionView | None = None
        self._rewound = False
        self._run: int | None = None
        self._between = False
        self._ended = False
        self._changed = threading.Condition()
        self.summary: Summary | None = None
        self.viewed = False
        """Whether a view has come at all."""

    @property
    def you(self) -> int:
        """The run's number for this viewer."""
        return STARTER

    def wait_first_view(self) -> bool:
        """Wait until a view has come; False where the run ended without one."""
        with self._changed:
            self._changed.wait_for(lambda: self.viewed or self._ended)
        return self.viewed

    def news(self) -> News:
        """Return what has come since the last call."""
        with self._changed:
            views = tuple(self._views)
            self._views.clear()
            rewound, self._rewound = self._rewound, False
            return News(
                views,
                self._ended,
                self.summary,
                self._sky,
                rewound,
                self._session,
                self.you,
                self._run,
                self._between,
            )

    def _see(self, message: TrackView | SessionView) -> None:
        with self._changed:
            if isinstance(message, TrackView):
                self._views.append(message)
                self.viewed = True
            else:
                self._session = message
            self._changed.notify_all()

    def _see_summary(self, line: bytes) -> bool:
        """Take the run's summary; False where a line is something else."""
        try:
            summary = _SUMMARY.decode(line).summary
        except msgspec.MsgspecError:
            return False
        with self._changed:
            self.summary = summary
            self._changed.notify_all()
        return True

    def _see_end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _begin_anew(self) -> None:
        """Where a run was shown already, have what was seen of it be over: another begins."""
        with self._changed:
            if self.summary is not None:
                self.summary, self._rewound = None, True
                self._views.clear()


@dataclass(frozen=True, slots=True)
class Latest(Generic[ViewT]):
    """What has come since the last look."""

    view: ViewT | None = None
    """The newest; None where none has come."""
    ended: bool = False
    """Whether nothing more will come."""


class ConsoleFeed(Protocol):
    """One mount under manual operation, seen from outside. Neither method ever waits."""

    def latest(self) -> Latest[ConsoleView]:
        """Return what has come since the last call."""

    def tell(self, order: ConsoleMessage) -> bool:
        """Hand an order over; False where the console can no longer be reached."""


class AntennaFeed(Protocol):
    """One antenna, seen from outside. Neither method ever waits."""

    def latest(self) -> Latest[AntennaView]:
        """Return what has come since the last call."""

    def tell(self, word: str) -> None:
        """Hand a word over to the controller's console."""


ERROR_CHARACTERS = 8000
_FeederMessage = TrackView | PassView | SessionView
_FEEDER_MESSAGES: msgspec.json.Decoder[_FeederMessage] = msgspec.json.Decoder(_FeederMessage)


class FeederProcess(BufferedFeed):
    """A feeder started by us, in a session of its own, so that Ctrl-C on the terminal reaches us only.

    The end of its standard input stops the mount, so the end of this process ends the motion too.
    """

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__()
        # A file, not a pipe: nobody reads it until the end, and the feeder must never wait for a reader.
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        self._input = self._process.stdin
        os.set_blocking(self._input.fileno(), False)
        self._reader = threading.Thread(target=self._read, name="feeder's views", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The process' number."""
        return self._process.pid

    @property
    def left_running(self) -> bool:
        """Whether the feeder has reported that it continues without us."""
        return self._session is not None and self._session.left_running

    def may_still_view(self, within_s: float) -> bool:
        """Wait so long for a view; False where the stream ended without one."""
        with self._changed:
            self._changed.wait_for(lambda: self.viewed or self._ended, within_s)
            return self.viewed or not self._ended

    def send(self, message: Message | SessionMessage) -> bool:
        """Write a message; where a stop cannot be written, close the channel, which stops the mount."""
        written = self._write(encode_message(message))
        if not written and isinstance(message, StopNow):
            self.close_input()
        return written

    def _write(self, text: bytes) -> bool:
        """Write to its standard input without waiting; False where that cannot be."""
        try:
            os.write(self._input.fileno(), text)
        except (OSError, ValueError):
            return False
        return True

    def close_input(self) -> None:
        """End the channel, which stops the mount."""
        try:
            self._input.close()
        except OSError:
            # Already broken: the feeder is gone.
            return

    def wait(self, seconds: float) -> int | None:
        """Wait for the end and return the exit code; None where it is not over within `seconds`."""
        try:
            return self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def end_by_force(self, grace_s: float) -> int:
        """End it and all that it started: by request, then by force. Returns the exit code."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(self._process.pid, number)
            except ProcessLookupError:
                break
            code = self.wait(grace_s)
            if code is not None:
                return code
        return self._process.wait()

    def last_words(self) -> str:
        """Return the last line that it wrote on standard error, empty for none."""
        begin = max(0, os.fstat(self._errors.fileno()).st_size - ERROR_CHARACTERS)
        text = os.pread(self._errors.fileno(), ERROR_CHARACTERS, begin).decode(errors="replace")
        return text.strip().rpartition("\n")[2]

    def close(self) -> str:
        """Let go of everything once the process has ended; return what it wrote on standard error."""
        self.close_input()
        self._reader.join(1.0)
        if self._process.stdout is not None and not self._reader.is_alive():
            self._process.stdout.close()
        self._errors.seek(0)
        text = self._errors.read().decode(errors="replace")
        self._errors.close()
        return text[-ERROR_CHARACTERS:]

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._changed:
                self._take(line)
                self._changed.notify_all()
        self._see_end()

    def _take(self, line: bytes) -> None:
        """Take a line; skip what this screen does not know, as a later feeder may send it."""
        try:
            message = _FEEDER_MESSAGES.decode(line)
        except msgspec.MsgspecError:
            self._see_summary(line)
            return
        if isinstance(message, PassView):
            self._sky = message
            self._begin_anew()
        else:
            self._see(message)


class LatestProcess(FeederProcess, Generic[ViewT]):
    """Started by us. The end of its standard input makes it stop the mount and leave."""

    def __init__(self, command: Sequence[str], view: type[ViewT]) -> None:
        self._newest: ViewT | None = None
        self._decoder = msgspec.json.Decoder(view)
        super().__init__(command)

    def latest(self) -> Latest[ViewT]:
        """Return what has come since the last call."""
        with self._changed:
            view, self._newest = self._newest, None
            return Latest(view, self._ended)

    def _take(self, line: bytes) -> None:
        try:
            self._newest = self._decoder.decode(line)
        except msgspec.MsgspecError:
            # Something that this screen does not know: a later program may say more.
            return
        self.viewed = True


class ConsoleProcess(LatestProcess[ConsoleView]):
    """A console started by us. The end of its standard input makes it stop the mount and leave."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, ConsoleView)

    def tell(self, order: ConsoleMessage) -> bool:
        """See ConsoleFeed. Where a stop cannot be written, close the channel, which stops the mount."""
        written = self._write(encode_message(order))
        if not written and isinstance(order, Abort | Leave):
            self.close_input()
        return written


class AntennaProcess(LatestProcess[AntennaView]):
    """An antenna's service started by us. The end of its standard input makes it stop the mount and end."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, AntennaView)

    def tell(self, word: str) -> None:
        """See AntennaFeed. Where it cannot be written, close the channel, which stops the mount."""
        if not self._write(word.encode() + b"\n"):
            self.close_input()


HOURS = 12.0
LOWEST_PRIORITY = 19
GRACE_S = 2.0
LOOK_AGAIN_S = 10.0
NO_LOOK = "the look at the mount ended at once"


class PassRow(msgspec.Struct, frozen=True):
    """One pass, as `passes --json` gives it."""

    name: str
    catalog_number: int | None
    """None of elements that have none yet: such a pass is not followed from a list."""
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
class HelperOptions:
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

    def __init__(self, options: HelperOptions) -> None:
        self._options = options
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._found: tuple[PassRow, ...] | None = None
        self.trouble = "" if options.passes is not None else options.why
        """Why there is no list; empty if there is one."""
        self.begun_utc_s: float | None = None
        """From which instant on the last search looks."""

    @property
    def busy(self) -> bool:
        """Whether a search is active."""
        return self._thread is not None and self._thread.is_alive()

    def begin(self, utc_s: float) -> None:
        """Search for the passes from an instant on, unless a search is active."""
        if self._options.passes is None or self.busy:
            return
        self.begun_utc_s = utc_s
        start = ("--from", Utc(utc_s).isoformat("seconds"), "--hours", f"{HOURS:g}")
        command = [
            *self_command(),
            "passes",
            "--json",
            "--judged",
            *self._options.passes,
            *start,
        ]
        self._thread = threading.Thread(target=self._run, args=(command,), name="passes", daemon=True)
        self._thread.start()

    def take(self) -> tuple[PassRow, ...] | None:
        """Return the passes that were found, once."""
        found, self._found = self._found, None
        return found

    def close(self) -> None:
        """End an active search."""
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
            out, _ = self._process.communicate(self._options.elements or b"")
            errors.seek(0)
            lines = errors.read().decode(errors="replace").strip().splitlines()
        try:
            self._found = read_passes(out)
            self.trouble = ""
        except msgspec.MsgspecError:
            self.trouble = lines[-1] if lines else "the search for passes gave no answer"


class MountLook:
    """Looks at a run's mount in a process of its own, through its owner; never waited for."""

    def __init__(
        self, options: HelperOptions, start: Callable[[list[str]], ConsoleProcess] = ConsoleProcess
    ) -> None:
        self._options, self._start = options, start
        self._thread: threading.Thread | None = None
        self._console: ConsoleProcess | None = None
        self._failed_s = 0.0
        self.trouble = ""

    def open(self, pid: int) -> None:
        """Begin to look at the mount that a feeder owns, unless that was begun."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._open, args=(pid,), name="mount", daemon=True)
            self._thread.start()

    def latest(self) -> Latest[ConsoleView]:
        """Return what has come since the last call.

        What ends before it has seen the mount says why, and is not begun anew at once.
        """
        console = self._console
        latest: Latest[ConsoleView] = Latest() if console is None else console.latest()
        if console is None or not latest.ended or console.viewed:
            return latest
        if not self.trouble:
            self.trouble, self._failed_s = console.last_words() or NO_LOOK, time.monotonic()
        return Latest(ended=time.monotonic() - self._failed_s > LOOK_AGAIN_S)

    def close(self) -> None:
        """Stop looking; the next `open` starts again."""
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
        called = ["mount", "watch", *self._options.watch, "--mount", url, "--stream", "--control"]
        self._console = self._start([*self_command(), *called])


def _finish(console: ConsoleProcess) -> None:
    if console.wait(GRACE_S) is None:
        console.end_by_force(GRACE_S)
    console.close()


@dataclass(slots=True)
class Helpers:
    """The helper processes of a screen: the search for passes and the look at the mount of the run `pid`."""

    search: PassSearch
    look: MountLook
    pid: int
    console: list[str] | None = None
    """What operates the mount by hand, where it is there without a run."""

    @classmethod
    def of(cls, options: HelperOptions, pid: int) -> Helpers:
        """Make both for the run of a process."""
        console = None
        if options.mount_url is not None:
            called = ["mount", "watch", *options.watch, "--mount", options.mount_url]
            console = [*self_command(), *called]
        return cls(PassSearch(options), MountLook(options), pid, console)

    def close(self) -> None:
        """End both."""
        self.search.close()
        self.look.close()

"""What runs outside the runner of a schedule, each with a time limit: sessions, programs, systemd.

A pass is followed by `sattrack track` in a process of its own, whose views are read and whose end is waited
for. Programs and addresses are those that the schedule names. A service manager gets the state by systemd's
protocol: datagrams to the socket in NOTIFY_SOCKET.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from dataclasses import dataclass, field
from functools import partial
from http.client import HTTPException
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from sattrack.core.channel import LineReader
from sattrack.schedule.night import PassAttempt
from sattrack.schedule.schema import SearchAction
from sattrack.views.messages import Search, StopNow, encode_message
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sattrack.schedule.night import NightPass, Result
    from sattrack.schedule.schema import Notify
    from sattrack.views.messages import Message


LOOK_EVERY_S = 0.25
OVERDUE_S = 120.0
"""A session that runs for longer after its pass is ended from outside; its guardian stops the mount."""
END_WITHIN_S = 90.0
MOST_STEP_S = 2.0
OLD_AFTER_S = 3.0
"""A session that has been silent for longer is reported."""
HANGS_AFTER_S = 5.0
"""One that has been silent for longer is replaced; its guardian has taken the mount from it by then."""
BEGINS_WITHIN_S = 60.0
"""How long a session may take to send its first line."""
KILLED_WITHIN_S = 10.0
RECORDING_TROUBLE = ("the recording ", "the disk ")
TRACKING = "tracking"


class SessionListener(Protocol):
    """The caller of a session: gives reasons to end, takes its reports."""

    def now_utc_s(self) -> float:
        """Return the instant that is now."""

    def end_reason(self) -> str | None:
        """Return why the session must end: "stopped", "operator" or "weather"; None while it need not."""

    def weather_words(self) -> str | None:
        """Return what the weather is, where it is the reason to end."""

    def report_progress(self, utc_s: float, on_target_s: float, line: str, silent_s: float = 0.0) -> None:
        """Report how it goes; `silent_s` is how long the session has been silent, where that is too long."""

    def report_trouble(self, words: str | None) -> None:
        """Report what is wrong with the recording; None where nothing is."""


@dataclass(slots=True)
class PassSession:
    """One session: the command that runs it, and the pass it is for."""

    command: Sequence[str]
    one: NightPass
    recording: str | None
    log: Path
    listener: SessionListener
    _on_target_s: float = 0.0
    _tracking_utc_s: float | None = None
    _last_utc_s: float | None = None
    _summary: dict[str, Any] | None = None
    _end_reason: str | None = None
    _end_words: str | None = None
    _silent_s: float = 0.0
    """Counted only while we were awake ourselves."""
    _line: str = "beginning"
    _sent: list[tuple[float, Message]] = field(default_factory=list)

    def run(self) -> PassAttempt:
        """Run it to its end; return how that was. Raises OSError where it cannot be started."""
        with self._opened_log() as log:
            with contextlib.suppress(OSError):
                os.write(log, f"{Utc(time.time()).isoformat('seconds')} {' '.join(self.command)}\n".encode())
            begin = os.fstat(log).st_size
            process = subprocess.Popen(
                list(self.command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                # What is sent to our terminal's group is for us to hand on.
                start_new_session=True,
            )
        try:
            self._listen(process)
        finally:
            self._end(process)
        return self._attempt(process.returncode, self._last_log_line(begin))

    @contextlib.contextmanager
    def _opened_log(self) -> Iterator[int]:
        """Open the log, or nothing where the disk lets none be made: no log is worth a pass."""
        try:
            log = os.open(self.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        except OSError:
            log = os.open(os.devnull, os.O_WRONLY)
        try:
            yield log
        finally:
            os.close(log)

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        reader = LineReader(process.stdout.fileno())
        overdue_utc_s = self.one.end_utc_s + OVERDUE_S
        ends_by_s = float("inf")
        looked_s = time.monotonic()
        while not reader.ended:
            select.select([reader], [], [], LOOK_EVERY_S)
            # Time in which the whole machine stood still does not count.
            self._silent_s += min(time.monotonic() - looked_s, 2.0 * LOOK_EVERY_S)
            looked_s = time.monotonic()
            for line in reader.lines():
                self._take_line(line, process)
            self._report_silence()
            why = self.listener.end_reason()
            if why is not None and self._end_reason is None:
                self._must_end(why)
                ends_by_s = time.monotonic() + END_WITHIN_S
                self._send(process, StopNow())
            if self._hangs:
                self._end_reason = self._end_reason or "hang"
                process.kill()
                return
            if self.listener.now_utc_s() > overdue_utc_s or time.monotonic() > ends_by_s:
                return
            self._search(process)

    def _must_end(self, why: str) -> None:
        self._end_reason = why
        self._end_words = self.listener.weather_words() if why == "weather" else None

    @property
    def _hangs(self) -> bool:
        # One that must end has nothing left to begin.
        begins = self._last_utc_s is None and self._end_reason is None
        within_s = BEGINS_WITHIN_S if begins else HANGS_AFTER_S
        return self._summary is None and self._silent_s > within_s

    def _report_silence(self) -> None:
        if self._last_utc_s is not None and self._silent_s > OLD_AFTER_S and self._summary is None:
            words = f"NO NEWS for {self._silent_s:.0f} s, before that {self._line}"
            self.listener.report_progress(self.listener.now_utc_s(), self._on_target_s, words, self._silent_s)

    def _take_line(self, line: bytes, process: subprocess.Popen[bytes]) -> None:
        try:
            message = msgspec.json.decode(line)
        except msgspec.DecodeError:
            return
        if not isinstance(message, dict):
            return
        if "summary" in message:
            self._summary = message["summary"]
        elif message.get("type") == "view":
            self._take_view(message)

    def _take_view(self, view: dict[str, Any]) -> None:
        utc_s = float(view["utc_s"])
        self._silent_s = 0.0
        tracking = view.get("phase") == TRACKING
        if tracking and self._tracking_utc_s is None:
            self._tracking_utc_s = utc_s
            for order, begin, end in search_times(self.one, utc_s):
                self._sent += [(begin, order), (end, Search("cancel"))]
        if tracking and self._last_utc_s is not None:
            self._on_target_s += min(MOST_STEP_S, max(0.0, utc_s - self._last_utc_s))
        self._last_utc_s = utc_s
        error = view.get("error") or {}
        arcsec = error.get("total_arcsec")
        words = f"{view.get('phase')}  alt {float(view['target_alt_deg']):.1f}°"
        if tracking and arcsec is not None:
            words += f"  error {arcsec:.2f}″"
        self._line = words
        self.listener.report_progress(utc_s, self._on_target_s, words)
        troubles = [one for one in view.get("warnings") or () if one.startswith(RECORDING_TROUBLE)]
        self.listener.report_trouble(troubles[0] if troubles else None)

    def _search(self, process: subprocess.Popen[bytes]) -> None:
        while self._sent and self._last_utc_s is not None and self._sent[0][0] <= self._last_utc_s:
            self._send(process, self._sent.pop(0)[1])

    def _send(self, process: subprocess.Popen[bytes], message: Message) -> None:
        assert process.stdin is not None
        with contextlib.suppress(OSError):
            process.stdin.write(encode_message(message))
            process.stdin.flush()

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        """See the process off: the end of its standard input stops the mount, and else its guardian does."""
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(OSError):
            process.stdin.close()
        try:
            process.wait(1.0 if self._summary is not None else END_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            # The system may hold a process that waits for a dead disk; the night does not wait with it.
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(KILLED_WITHIN_S)
        process.stdout.close()

    def _hang_text(self) -> str | None:
        if self._end_reason != "hang":
            return None
        return f"the session said nothing for {self._silent_s:.0f} s, and was ended"

    def _last_log_line(self, begin: int) -> str | None:
        try:
            with self.log.open("rb") as log:
                log.seek(begin)
                lines = log.read().decode("utf-8", errors="replace").splitlines()
        except OSError:
            return None
        lines = [line.removeprefix("sattrack: ") for line in lines if line.strip()]
        return printable(lines[-1])[:300] if lines else None

    def _attempt(self, code: int | None, last_line: str | None) -> PassAttempt:
        found = self._summary
        if found is None and self._end_reason in (None, "hang"):
            # A session that was ended from outside may be gone before we have looked for a stop.
            why = self.listener.end_reason()
            if why is not None:
                self._must_end(why)
        ended_utc_s = self.listener.now_utc_s()
        if found is None:
            last = self._hang_text() or last_line or f"the session ended with {code}, without a word"
            return PassAttempt(
                self._end_reason or "crash",
                ended_utc_s,
                on_target_s=round(self._on_target_s, 3),
                words=last if self._end_words is None else f"{self._end_words}; {last}",
                recording=self.recording,
            )
        ended_by = str(found.get("ended_by"))
        words = found.get("message")
        if self._end_reason not in (None, "hang"):
            ended_by, words = str(self._end_reason), self._end_words
        if found.get("mount_stopped") is False:
            words = f"{words or ended_by}; THE MOUNT DID NOT CONFIRM THE STOP"
        return PassAttempt(
            ended_by=ended_by,
            ended_utc_s=ended_utc_s,
            on_target_s=float(found.get("on_target_s") or 0.0),
            rms_arcsec=found.get("reported_rms_arcsec"),
            peak_arcsec=found.get("reported_peak_arcsec"),
            words=words,
            recording=self.recording,
            held_s=found.get("held_s") or {},
            rejoining_s=float(found.get("rejoining_s") or 0.0),
            lost_peak_arcsec=found.get("lost_peak_arcsec"),
        )


def run_verb(
    command: Sequence[str], timeout_s: float, stop_requested: Callable[[], bool]
) -> tuple[int, str | None]:
    """Run a verb of `sattrack mount` to its end; return its exit code and its last line.

    Where a stop is asked for, or it takes too long, it is interrupted, which stops the mount.
    """
    process = subprocess.Popen(
        list(command),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    until_s, interrupted = time.monotonic() + timeout_s, False
    while True:
        try:
            _, output = process.communicate(timeout=LOOK_EVERY_S)
            break
        except subprocess.TimeoutExpired:
            late = time.monotonic() > until_s
            if late and interrupted:
                process.kill()
            elif (late or stop_requested()) and not interrupted:
                process.send_signal(2)
                interrupted, until_s = True, time.monotonic() + END_WITHIN_S
    lines = [line for line in output.decode("utf-8", errors="replace").splitlines() if line.strip()]
    words = printable(lines[-1].removeprefix("sattrack: "))[:300] if lines else None
    return process.returncode, words


SEARCH_AFTER_S = 5.0


def search_times(one: NightPass, start_utc_s: float) -> list[tuple[Search, float, float]]:
    """Return the searches about a pass' satellite, from when to when, one after the other."""
    found, at = [], start_utc_s + SEARCH_AFTER_S
    for action in one.terms.before:
        if isinstance(action, SearchAction):
            order = Search(
                action.how, action.spacing_deg, action.speed_deg_s, action.reach_s, action.period_s
            )
            found.append((order, at, at + action.seconds))
            at += action.seconds
    return found


KILL_AFTER_S = 2.0
MOST_WORDS = 160
PREFIX = "SATTRACK_"
MOST_BYTES = 4096
"""Of an answer about the weather."""


def facts_of(one: NightPass, schedule: str, when: str, result: Result | None = None) -> dict[str, Any]:
    """Return the facts of a pass for a program or an address; names carry units."""
    facts: dict[str, Any] = {
        "schedule": schedule,
        "when": when,
        "number": one.number,
        "name": one.name,
        "catalog_number": one.catalog_number,
        "start_utc": Utc(one.start_utc_s).isoformat("milliseconds"),
        "culminate_utc": Utc(one.culminate_utc_s).isoformat("milliseconds"),
        "end_utc": Utc(one.end_utc_s).isoformat("milliseconds"),
        "max_alt_deg": one.max_alt_deg,
        "priority": one.priority,
    }
    if result is not None:
        facts |= {
            "result": result.state,
            "cause": result.cause,
            "words": result.words,
            "on_target_s": result.on_target_s,
            "rms_arcsec": result.rms_arcsec,
            "recordings": list(result.recordings),
        }
    return facts


def as_environment(facts: dict[str, Any]) -> dict[str, str]:
    """Return facts as variables: `SATTRACK_START_UTC` for `start_utc`; several recordings by colons."""
    found = {}
    for name, value in facts.items():
        words = ":".join(value) if isinstance(value, list) else "" if value is None else str(value)
        # No program can be given a NUL.
        found[PREFIX + name.upper()] = words.replace("\0", "")
    return found


def run_program(
    run: Sequence[str], timeout_s: float, folder: Path, facts: dict[str, Any], given: str | None = None
) -> str | None:
    """Run a program to its end, `timeout_s` at most, in a folder; return what went wrong, None where nothing.

    It and all that it started are ended where they take longer. `given` is written to its standard input.
    """
    try:
        process = subprocess.Popen(
            list(run),
            cwd=folder,
            env={**os.environ, **as_environment(facts)},
            stdin=subprocess.DEVNULL if given is None else subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        return f"cannot be run: {getattr(error, 'strerror', None) or error}"
    try:
        process.communicate(None if given is None else given.encode(), timeout=timeout_s)
    except subprocess.TimeoutExpired:
        _end(process)
        return f"not done within {timeout_s:g} s, ended"
    if process.returncode < 0:
        return f"ended by signal {-process.returncode}"
    return None if process.returncode == 0 else f"ended with {process.returncode}"


def _end(process: subprocess.Popen[bytes]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(KILL_AFTER_S)
            if number == signal.SIGTERM:
                continue
            return


def post(url: str, facts: dict[str, Any], timeout_s: float) -> str | None:
    """Post facts as JSON to an address; return what went wrong, None where nothing."""
    request = urllib.request.Request(
        url, json.dumps(facts).encode(), {"Content-Type": "application/json"}, method="POST"
    )
    try:
        with urllib.request.urlopen(request, timeout=timeout_s) as answer:
            answer.read(1)
    except urllib.error.HTTPError as error:
        error.close()
        return f"answered {error.code}"
    except (OSError, ValueError, HTTPException) as error:
        reason = getattr(error, "reason", None) or error
        return f"cannot be posted to: {printable(str(reason))[:MOST_WORDS]}"
    return None


class BackgroundTasks:
    """Tasks beside the run, for which it does not wait; `complaints` gets what went wrong."""

    def __init__(self, complaints: Callable[[str], None]) -> None:
        """Take what is called with what went wrong."""
        self._complaints = complaints
        self._threads: list[threading.Thread] = []

    def begin(self, words: str, task: Callable[[], str | None]) -> None:
        """Begin a task in a thread of its own."""

        def run() -> None:
            wrong = task()
            if wrong is not None:
                self._complaints(f"{words}: {wrong}")

        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=run, name="task", daemon=True)
        self._threads.append(thread)
        thread.start()

    def finish(self, within_s: float) -> None:
        """Wait for tasks that are under way, `within_s` at most: the process is about to end."""
        until_s = time.monotonic() + within_s
        for thread in self._threads:
            thread.join(max(0.0, until_s - time.monotonic()))


class Notifier:
    """Sends notices of what happens to the programs and addresses that the schedule names."""

    def __init__(self, notify: Sequence[Notify], folder: Path, tasks: BackgroundTasks) -> None:
        """Take whom to tell, and where programs run."""
        self._notify, self._folder, self._tasks = notify, folder, tasks

    def tell(self, notice: str, words: str, facts: dict[str, Any]) -> None:
        """Send a notice, without waiting; programs get it in their environment and on standard input."""
        facts = {"notice": notice, "message": words, **facts}
        for one in self._notify:
            if notice not in one.on:
                continue
            if one.run is not None:
                program = partial(run_program, one.run, one.timeout_s, self._folder, facts, words + "\n")
                self._tasks.begin(f"notify by {one.run[0]}", program)
            elif one.url is not None:
                self._tasks.begin("notify by its address", partial(post, one.url, facts, one.timeout_s))


PINGS_PER_PERIOD = 3.0


class Service:
    """Reports this process' state to the service manager; does nothing without one.

    The watchdog is fed by a thread, only as long as the main thread has promised to come back.
    """

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        given = os.environ if environment is None else environment
        name = given.get("NOTIFY_SOCKET", "")
        # A leading @ stands for Linux's abstract namespace.
        self._address = "\0" + name[1:] if name.startswith("@") else name
        self._until_s = time.monotonic()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._period_s = _watchdog_s(given)
        self._status = ""

    def tell(self, *assignments: str) -> None:
        """Send assignments such as READY=1. A manager that does not listen is no reason to end."""
        if not self._address:
            return
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto("\n".join(assignments).encode(), self._address)

    def status(self, words: str) -> None:
        """Send one line of status, where it has changed."""
        if words != self._status:
            self._status = words
            self.tell(f"STATUS={words.splitlines()[0] if words else ''}")

    def promise(self, seconds: float) -> None:
        """Promise that the main thread calls again within `seconds`."""
        self._until_s = time.monotonic() + seconds
        if self._thread is None and self._address and self._period_s is not None:
            self._thread = threading.Thread(target=self._feed, name="watchdog", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _feed(self) -> None:
        assert self._period_s is not None
        while not self._ended.is_set():
            if time.monotonic() < self._until_s:
                self.tell("WATCHDOG=1")
            self._ended.wait(self._period_s / PINGS_PER_PERIOD)


def _watchdog_s(given: Mapping[str, str]) -> float | None:
    """Return the manager's watchdog period, seconds; None without a watchdog."""
    if given.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    try:
        return float(int(given["WATCHDOG_USEC"])) / 1e6
    except (KeyError, ValueError):
        return None

"""A pass of a schedule followed by `sattrack track` in a process of its own, listened to and seen off."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from sattrack.core.channel import LineReader
from sattrack.schedule.night import PassAttempt
from sattrack.schedule.schema import SearchAction
from sattrack.views.messages import Search, StopNow, encode_message
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from sattrack.schedule.night import NightPass
    from sattrack.views.messages import Message

LOOK_EVERY_S = 0.25
OVERDUE_S = 120.0
"""A session that has not ended so long after its pass is ended from outside; its guardian stops the mount."""
END_WITHIN_S = 90.0
MOST_STEP_S = 2.0
OLD_AFTER_S = 3.0
"""A session that has been silent for so long is reported."""
HANGS_AFTER_S = 5.0
"""One that has been silent for so long is replaced; its guardian has taken the mount from it by then."""
BEGINS_WITHIN_S = 120.0
"""How long a session may take before it says its first word."""
KILLED_WITHIN_S = 10.0
RECORDING_TROUBLE = ("the recording ", "the disk ")
TRACKING = "tracking"


class SessionListener(Protocol):
    """What a session asks and reports while it goes on."""

    def now_utc_s(self) -> float:
        """Return the instant that is now."""

    def end_reason(self) -> str | None:
        """Return why the session must end: "stopped", "operator" or "weather"; None while it need not."""

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
    _asked: str | None = None
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
        return self._attempt(process.returncode, self._last_words(begin))

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
            # Where the whole machine stood still, nobody is to blame.
            self._silent_s += min(time.monotonic() - looked_s, 2.0 * LOOK_EVERY_S)
            looked_s = time.monotonic()
            for line in reader.lines():
                self._take_line(line, process)
            self._report_silence()
            why = self.listener.end_reason()
            if why is not None and self._asked is None:
                self._asked, ends_by_s = why, time.monotonic() + END_WITHIN_S
                self._send(process, StopNow())
            if self._hangs:
                self._asked = self._asked or "hang"
                process.kill()
                return
            if self.listener.now_utc_s() > overdue_utc_s or time.monotonic() > ends_by_s:
                return
            self._search(process)

    @property
    def _hangs(self) -> bool:
        within_s = BEGINS_WITHIN_S if self._last_utc_s is None else HANGS_AFTER_S
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

    def _hung_words(self) -> str | None:
        if self._asked != "hang":
            return None
        return f"the session said nothing for {self._silent_s:.0f} s, and was ended"

    def _last_words(self, begin: int) -> str | None:
        try:
            with self.log.open("rb") as log:
                log.seek(begin)
                lines = log.read().decode("utf-8", errors="replace").splitlines()
        except OSError:
            return None
        said = [line.removeprefix("sattrack: ") for line in lines if line.strip()]
        return printable(said[-1])[:300] if said else None

    def _attempt(self, code: int | None, last_words: str | None) -> PassAttempt:
        found = self._summary
        if found is None and self._asked in (None, "hang"):
            # A session that was ended from outside may be gone before we have looked for a stop.
            why = self.listener.end_reason()
            self._asked = why or self._asked
        ended_utc_s = self.listener.now_utc_s()
        if found is None:
            return PassAttempt(
                self._asked or "crash",
                ended_utc_s,
                on_target_s=round(self._on_target_s, 3),
                words=self._hung_words() or last_words or f"the session ended with {code}, without a word",
                recording=self.recording,
            )
        ended_by = str(found.get("ended_by"))
        words = found.get("message")
        if self._asked not in (None, "hang"):
            ended_by, words = str(self._asked), None
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
    command: Sequence[str], timeout_s: float, asked_to_stop: Callable[[], bool]
) -> tuple[int, str | None]:
    """Run a verb of `sattrack mount` to its end; return its exit code and what it said last.

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
            _, said = process.communicate(timeout=LOOK_EVERY_S)
            break
        except subprocess.TimeoutExpired:
            late = time.monotonic() > until_s
            if late and interrupted:
                process.kill()
            elif (late or asked_to_stop()) and not interrupted:
                process.send_signal(2)
                interrupted, until_s = True, time.monotonic() + END_WITHIN_S
    lines = [line for line in said.decode("utf-8", errors="replace").splitlines() if line.strip()]
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

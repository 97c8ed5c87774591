"""A run of another process, and the later runs of its schedule."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.runtime.mounts import ask_stop, owners
from sattrack.runtime.view_server import check_run_of, feeders, name_for, started_by
from sattrack.tui.feeds import BufferedFeed
from sattrack.views.messages import StopNow, encode_message
from sattrack.views.picture import PictureView
from sattrack.views.run import Farewell, PassView, SessionView, TrackView, Welcome
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.runtime.facts import RunFacts
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.schedule import ScheduleView

LOOK_EVERY_S = 0.5
RUNNER_BACK_WITHIN_S = 15.0
"""How long a schedule is waited for whose runner is gone: it may be about to be started again."""
OVER = frozenset({"ended", "stopped"})


def schedule_in(folder: Path) -> ScheduleView | None:
    """Return what the runner of a schedule says in its folder; raises SattrackError, as `read_status`."""
    from sattrack.schedule.night_folder import read_status

    return read_status(folder)


def folder_of(recording: str) -> Path:
    """Return the folder of the schedule that a run of this recording would belong to."""
    return Path(recording).parent.parent


def goes_on(recording: str | None) -> bool:
    """Tell whether a run of this recording is one of a schedule's that is not over."""
    return _is_on(_schedule_of(recording))


def next_run(recording: str | None, waits: Callable[[float], bool]) -> int | None:
    """Wait for the next run of the schedule that a run of this recording was of; return its process.

    None where none will come: the schedule is over, or nobody runs it any more. `waits` is called to wait so
    many seconds, and returns whether to go on.
    """
    gone_s: float | None = None
    while _is_on(view := _schedule_of(recording)):
        runner = None if view is None else view.pid
        now_s = time.monotonic()
        gone_s = None if runner is not None else now_s if gone_s is None else gone_s
        if gone_s is not None and now_s - gone_s > RUNNER_BACK_WITHIN_S:
            break
        found = [pid for pid in feeders() if runner is not None and started_by(pid) == runner]
        if found:
            return found[-1]
        if not waits(LOOK_EVERY_S):
            break
    return None


def stop_schedule(recording: str | None) -> bool:
    """Have the runner of a run's schedule stop the mount, and end; False where none runs.

    It is an operator's stop: a restart follows nothing either.
    """
    from sattrack.schedule.night_stop import keep_stop

    view = _schedule_of(recording)
    if recording is None or view is None or view.pid is None:
        return False
    try:
        keep_stop(folder_of(recording), "at the session's screen")
    except OSError:
        return _interrupt(view.pid)
    return True


def _interrupt(process_id: int) -> bool:
    try:
        os.kill(process_id, signal.SIGINT)
    except OSError:
        return False
    return True


def _is_on(view: ScheduleView | None) -> bool:
    return view is not None and (view.running or view.state not in OVER)


def _schedule_of(recording: str | None) -> ScheduleView | None:
    if recording is None:
        return None
    try:
        return schedule_in(folder_of(recording))
    except SattrackError:
        return None


WELCOME_WITHIN_S = 5.0
TRY_AGAIN_S = 0.02
STOP_WITHIN_S = 1.0
"""How long a stop may take to show, before it is sent another way."""
LONGEST_UNREAD = 20_000

PICTURE_SIDE = 160
"""Pixels of the longer side of a picture: two in a cell, a screen of 160 columns."""
_PICTURES: msgspec.json.Decoder[PictureView] = msgspec.json.Decoder(PictureView)
_Message = TrackView | SessionView | Welcome | Farewell
_MESSAGES: msgspec.json.Decoder[_Message] = msgspec.json.Decoder(_Message)


class AttachedRun(BufferedFeed):
    """A run seen through its gallery; its end, or that of the connection, does nothing to the mount.

    After a run of a schedule, the schedule's next one is waited for, and seen.
    """

    def __init__(self, pid: int, name: str, scene: Callable[[RunFacts], PassView] | None = None) -> None:
        """Connect. Raises SattrackError where the run is not to be looked at; `scene` draws its sky."""
        super().__init__(LONGEST_UNREAD)
        self._run, self._name, self._scene = pid, name, scene
        self._recording: str | None = None
        self._left = threading.Event()
        self._connection, self._lines, self.welcome = welcomed(pid, name)
        self._stopping = self._stop_said = False
        self._reader = threading.Thread(target=self._read, name="run's views", daemon=True)
        self._reader.start()

    @property
    def you(self) -> int:
        """See BufferedFeed."""
        return self.welcome.you

    def send(self, message: Message | SessionMessage) -> bool:
        """Hand a message over. A stop that is not obeyed soon goes by the mount's guardian as well.

        Between the runs of a schedule, a stop is for its runner.
        """
        if isinstance(message, StopNow):
            with self._changed:
                self._stop_said = True
                if self._between:
                    return stop_schedule(self._recording)
            threading.Thread(target=self._see_stop_through, name="stop", daemon=True).start()
        try:
            self._connection.send(encode_message(message), socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def close_input(self) -> None:
        """Look away."""
        self._left.set()
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def wait(self, seconds: float) -> int | None:
        """Tell that there is nothing to wait for: the run is not ours."""
        del seconds
        return 0

    def end_by_force(self, grace_s: float) -> int:
        """End nothing: the run is not ours."""
        del grace_s
        return 0

    def close(self) -> None:
        """Look away, and let go of everything."""
        self.close_input()
        self._reader.join(1.0)
        self._connection.close()

    def _see_stop_through(self) -> None:
        with self._changed:
            if self._changed.wait_for(lambda: self._ended or self._stopping, STOP_WITHIN_S):
                return
        with contextlib.suppress(SattrackError, OSError):
            for owner in owners():
                if owner.pid == self._run:
                    ask_stop(owner, lambda: None)

    def _read(self) -> None:
        on = True
        while on:
            with contextlib.suppress(OSError, ValueError):
                for line in self._lines:
                    self._take(line)
            on = self._go_on()
        self._between = False
        self._see_end()

    def _go_on(self) -> bool:
        """Go on to the next run of the schedule that this one is of; False where none comes."""
        if self._left.is_set() or not goes_on(self._recording):
            return False
        with self._changed:
            self._between = True
            if self._stop_said and (self.summary is None or self.summary.ended_by != "operator"):
                # It came too late for the run that is over, and was not meant for that alone.
                stop_schedule(self._recording)
            self._changed.notify_all()
        while (pid := next_run(self._recording, self._waits)) is not None:
            try:
                connection, lines, welcome = welcomed(pid, self._name)
            except SattrackError:
                if not self._waits(LOOK_EVERY_S):
                    return False
                continue
            self._join(pid, connection, lines, welcome)
            return not self._left.is_set()
        return False

    def _waits(self, seconds: float) -> bool:
        return not self._left.wait(seconds)

    def _join(self, pid: int, connection: socket.socket, lines: BinaryIO, welcome: Welcome) -> None:
        with self._changed:
            self._lines.close()
            self._connection.close()
            self._run, self._connection, self._lines, self.welcome = pid, connection, lines, welcome
            self.summary, self._session, self._rewound = None, None, True
            self._views.clear()
            self._between = self._stopping = self._stop_said = False
            self._changed.notify_all()

    def _take(self, line: bytes) -> None:
        try:
            message = _MESSAGES.decode(line)
        except msgspec.MsgspecError:
            if not self._see_summary(line):
                self._take_facts(line)
            return
        if isinstance(message, TrackView):
            self._stopping = message.ended_by is not None
            self._recording = message.recording
        if isinstance(message, TrackView | SessionView):
            self._see(message)

    def _take_facts(self, line: bytes) -> None:
        """Take the facts from which a run's sky is drawn; anything else is later's."""
        from sattrack.runtime.facts import decode_facts

        with contextlib.suppress(msgspec.MsgspecError, SattrackError, TleError):
            facts = decode_facts(line)
            self._begin_anew()
            sky = None if self._scene is None else self._scene(facts)
            with self._changed:
                self._sky = sky


def welcomed(
    pid: int, name: str, pictures: int = 0, shows: bool = False
) -> tuple[socket.socket, BinaryIO, Welcome]:
    """Connect to a run's view server; return the connection, its lines and the welcome. Raises SattrackError.

    With `pictures`, the pixels of a longer side, nothing but cameras' pictures follows; `shows` says that
    there are some to be sent.
    """
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(WELCOME_WITHIN_S)
    try:
        _connect(connection, name_for(pid))
        check_run_of(connection, pid)
        hello = {"type": "hello", "name": name, "pictures": pictures, "shows": shows}
        connection.sendall(msgspec.json.encode(hello) + b"\n")
        lines = connection.makefile("rb")
        first = _MESSAGES.decode(lines.readline())
    except (OSError, msgspec.MsgspecError):
        connection.close()
        raise SattrackError(
            f"process {pid} has no run to watch, or does not answer; without --run, `sattrack attach` lists"
        ) from None
    if not isinstance(first, Welcome):
        connection.close()
        raise SattrackError(
            first.why if isinstance(first, Farewell) else f"process {pid} did not answer as a run"
        )
    connection.settimeout(None)
    return connection, lines, first


class PictureLook:
    """Gets the pictures of a run's cameras by a connection of its own, read by a thread; never waited for."""

    def __init__(self, side: int = PICTURE_SIDE) -> None:
        self._side = side
        self._connection: socket.socket | None = None
        self._run: int | None = None
        self._newest: dict[str, PictureView] = {}
        self._changed = threading.Lock()

    def open(self, pid: int) -> None:
        """Begin to look at the cameras of the run of a process, unless that was begun."""
        if self._run == pid:
            return
        self.close()
        self._run = pid
        threading.Thread(target=self._read, args=(pid,), name="pictures", daemon=True).start()

    def take(self) -> dict[str, PictureView]:
        """Return what has come since the last call: of each camera the newest picture, by its name."""
        with self._changed:
            found, self._newest = self._newest, {}
        return found

    def close(self) -> None:
        """Stop looking: the cameras send nothing any more."""
        with self._changed:
            connection, self._connection, self._run = self._connection, None, None
            self._newest = {}
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def _read(self, pid: int) -> None:
        try:
            connection, lines, _ = welcomed(pid, "", pictures=self._side)
        except SattrackError:
            time.sleep(LOOK_EVERY_S)
            self._leave(pid)
            return
        with self._changed:
            left = self._run != pid
            if not left:
                self._connection = connection
        with connection, lines, contextlib.suppress(OSError, ValueError):
            for line in () if left else lines:
                if b'"picture"' in line[:20]:
                    self._see(pid, line)
        self._leave(pid)

    def _leave(self, pid: int) -> None:
        """Have the next look connect anew."""
        with self._changed:
            if self._run == pid:
                self._connection = self._run = None

    def _see(self, pid: int, line: bytes) -> None:
        with contextlib.suppress(msgspec.MsgspecError):
            seen = _PICTURES.decode(line)
            if seen.columns * seen.rows == len(seen.pixels) > 0:
                with self._changed:
                    if self._run == pid:
                        self._newest[seen.camera] = seen


def _connect(connection: socket.socket, name: str) -> None:
    """Connect, however many stand there; raises OSError."""
    until_s = time.monotonic() + WELCOME_WITHIN_S
    while True:
        try:
            connection.connect(name)
        except BlockingIOError:
            if time.monotonic() > until_s:
                raise
            time.sleep(TRY_AGAIN_S)
        else:
            return

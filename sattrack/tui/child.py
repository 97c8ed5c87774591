"""A process started by a screen: a thread reads its views, messages go to its standard input.

The end of its standard input makes it stop the mount and leave.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import threading
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import msgspec

from sattrack.mount.requests import Abort
from sattrack.tui.console_feed import Latest
from sattrack.tui.seen_run import SeenRun
from sattrack.views.messages import Leave, StopNow, encode_message
from sattrack.views.run import AntennaView, ConsoleView, PassView, SessionView, TrackView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.views.messages import ConsoleMessage, Message, SessionMessage

TOLD_CHARACTERS = 8000
_Told = TrackView | PassView | SessionView
_TOLD: msgspec.json.Decoder[_Told] = msgspec.json.Decoder(_Told)
ViewT = TypeVar("ViewT")


class FeederProcess(SeenRun):
    """A feeder started by us, in a session of its own: a Ctrl-C on the terminal is ours to handle.

    The end of its standard input stops the mount, so the end of this process ends the motion too.
    """

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__()
        # A file, not a pipe: nobody reads it until the end, and the feeder must never wait for a reader.
        self._told = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._told,
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
        """Whether the feeder has said that it goes on without us."""
        return self._session is not None and self._session.left_running

    def may_still_view(self, within_s: float) -> bool:
        """Wait so long for a view; False where the stream ended without one."""
        with self._changed:
            self._changed.wait_for(lambda: self.viewed or self._ended, within_s)
            return self.viewed or not self._ended

    def send(self, message: Message | SessionMessage) -> bool:
        """Write a message; a stop that cannot be written is said by closing the channel instead."""
        said = self._write(encode_message(message))
        if not said and isinstance(message, StopNow):
            self.close_input()
        return said

    def _write(self, words: bytes) -> bool:
        """Write to its standard input without waiting; False where that cannot be."""
        try:
            os.write(self._input.fileno(), words)
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

    def close(self) -> str:
        """Let go of everything once the process has ended; return what it said on standard error."""
        self.close_input()
        self._reader.join(1.0)
        if self._process.stdout is not None and not self._reader.is_alive():
            self._process.stdout.close()
        self._told.seek(0)
        text = self._told.read().decode(errors="replace")
        self._told.close()
        return text[-TOLD_CHARACTERS:]

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._changed:
                self._take(line)
                self._changed.notify_all()
        self._see_end()

    def _take(self, line: bytes) -> None:
        """Take a line; what this screen does not know, a later feeder may say, and it is passed over."""
        try:
            told = _TOLD.decode(line)
        except msgspec.MsgspecError:
            self._see_summary(line)
            return
        if isinstance(told, PassView):
            self._sky = told
            self._begin_anew()
        else:
            self._see(told)


class LatestProcess(FeederProcess, Generic[ViewT]):
    """Started by us. The end of its standard input makes it stop the mount and leave."""

    def __init__(self, command: Sequence[str], view: type[ViewT]) -> None:
        self._newest: ViewT | None = None
        self._decoder = msgspec.json.Decoder(view)
        super().__init__(command)

    def newest(self) -> tuple[ViewT | None, bool]:
        """Return the view that has come since the last call, if any, and whether nothing more will come."""
        with self._changed:
            view, self._newest = self._newest, None
            return view, self._ended

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

    def latest(self) -> Latest:
        """See ConsoleFeed."""
        return Latest(*self.newest())

    def tell(self, order: ConsoleMessage) -> bool:
        """See ConsoleFeed. A stop that cannot be written is said by closing the channel instead."""
        told = self._write(encode_message(order))
        if not told and isinstance(order, Abort | Leave):
            self.close_input()
        return told


class AntennaFeed(Protocol):
    """One antenna, seen from outside. Neither method ever waits."""

    def newest(self) -> tuple[AntennaView | None, bool]:
        """Return the view that has come since the last call, if any, and whether nothing more will come."""

    def tell(self, word: str) -> None:
        """Hand a word over to the controller's console."""


class AntennaProcess(LatestProcess[AntennaView]):
    """An antenna's service started by us. The end of its standard input makes it stop the mount and end."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, AntennaView)

    def tell(self, word: str) -> None:
        """See AntennaFeed. What cannot be written is said by closing the channel, which stops the mount."""
        if not self._write(word.encode() + b"\n"):
            self.close_input()

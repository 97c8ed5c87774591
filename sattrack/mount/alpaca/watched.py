"""The gateway's end of its warden, which stops the telescope where the gateway is gone or stands still."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.core.own_program import own_program

if TYPE_CHECKING:
    from sattrack.mount.alpaca.address import AlpacaAddress

MOST_WARDENS = 3
END_WITHIN_S = 2.0
MOVING, RESTING, FAREWELL = b"m", b"r", b"b"


@dataclass(slots=True)
class Watched:
    """A warden at work; where it dies, another takes its place, MOST_WARDENS in all."""

    address: AlpacaAddress
    _process: subprocess.Popen[bytes] | None = None
    _channel: socket.socket | None = None
    _started: int = 0
    _said: bytes = field(default=RESTING)

    def __post_init__(self) -> None:
        """Start it."""
        self._start()

    @property
    def alive(self) -> bool:
        """Whether somebody watches."""
        return self._channel is not None

    def beat(self, in_force: bool) -> None:
        """Say that the gateway's loop turns, and whether anything of it may have the telescope moving."""
        word = MOVING if in_force else RESTING
        if word == RESTING and self._said == RESTING and self._channel is not None:
            return
        self._said = word
        self._say(word)

    def let_go(self) -> None:
        """End the watch: the telescope is at rest, or never moved."""
        self._say(FAREWELL)
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(END_WITHIN_S)

    def _say(self, word: bytes) -> None:
        if self._channel is None:
            return
        try:
            self._channel.send(word)
        except BlockingIOError:
            return
        except OSError:
            self._channel.close()
            self._channel = None
            self._start()

    def _start(self) -> None:
        if self._process is not None:
            self._process.poll()
        if self._started >= MOST_WARDENS:
            return
        self._started += 1
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [
                    *(*own_program("sattrack.mount.alpaca.warden"), str(theirs.fileno())),
                    *(str(os.getpid()), self.address.host, str(self.address.port), str(self.address.device)),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        ours.setblocking(False)
        self._channel = ours

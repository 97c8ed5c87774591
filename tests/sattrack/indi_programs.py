"""INDI's own programs: its server with drivers, and a device of it by its command line clients."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import tempfile
import time
from contextlib import closing, contextmanager, suppress
from typing import TYPE_CHECKING

from programs import free_port
from serving import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator


class Indi:
    """A device of an INDI server, by INDI's own command line programs."""

    def __init__(self, port: int, device: str, program: Callable[[str], str]) -> None:
        self._port, self._device, self._program = port, device, program

    def set(self, text: str) -> None:
        command = [self._program("indi_setprop"), "-p", str(self._port), f"{self._device}.{text}"]
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)

    def get(self, name: str) -> str:
        getprop, port = self._program("indi_getprop"), str(self._port)
        command = [getprop, "-p", port, "-t", "2", "-1", f"{self._device}.{name}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
        return done.stdout.strip()

    def until(self, name: str, holds: Callable[[str], bool]) -> str:
        """Wait until a value is as asked, by one program that tells each change; return the value."""
        until_s = time.monotonic() + PATIENCE_S
        while True:
            value = None
            with closing(self._values(name, until_s)) as values:
                for value in values:
                    if holds(value):
                        return value
            assert time.monotonic() < until_s, (name, value)
            # No server listens there yet.
            select.select([], [], [], 0.05)

    def _values(self, name: str, until_s: float) -> Generator[str]:
        """Give what a property is, and what it becomes, until its server has gone or is not there."""
        command = [self._program("indi_getprop"), "-m", "-t", str(PATIENCE_S), "-p", str(self._port)]
        # To a terminal, it writes each line at once.
        ours, its = os.openpty()
        with subprocess.Popen(
            [*command, f"{self._device}.{name}"], stdin=its, stdout=its, stderr=subprocess.DEVNULL
        ) as process:
            os.close(its)
            told = b""
            try:
                while select.select([ours], [], [], max(0.0, until_s - time.monotonic()))[0]:
                    told += os.read(ours, 65536)
                    *lines, told = told.split(b"\r\n")
                    yield from (line.decode().partition("=")[2] for line in lines)
            except OSError:
                """Its end of the terminal is closed."""
            finally:
                process.kill()
                os.close(ours)

    def settle(self) -> None:
        """Wait until it says of its place that it moves no more; no answer is no place."""
        self.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value not in {"", "Busy"})

    def number(self, name: str) -> float:
        return float(self.until(name, bool))


@contextmanager
def indi_server(program: Callable[[str], str], *drivers: str) -> Iterator[int]:
    """Run INDI's own server with drivers, each a path or DEVICE@HOST:PORT; give its port."""
    port = free_port()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        process = subprocess.Popen(
            # Its local socket has one name for all on this machine, unless another is given.
            [program("indiserver"), "-p", str(port), "-u", f"/tmp/indiserver-{port}", *drivers],
            # The drivers keep their state in the home folder: a telescope once parked begins parked.
            env={**os.environ, "HOME": folder},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            yield port
        finally:
            process.terminate()
            process.wait(timeout=PATIENCE_S)
            with suppress(ProcessLookupError):
                # Drivers outlive their server for a moment, and would write into the folder that is removed.
                os.killpg(process.pid, signal.SIGKILL)

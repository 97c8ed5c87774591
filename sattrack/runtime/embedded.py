"""A simulated mount started in another process, for practice and for the demonstration."""

from __future__ import annotations

import os
import select
import subprocess
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.core.own_program import own_program
from sattrack.mount.simulator.process import Ready, SimulatorConfig, TruthLine

if TYPE_CHECKING:
    from collections.abc import Sequence

START_WITHIN_S = 20.0
READ_BYTES = 65536


class LineReader:
    """Whole lines from a descriptor, without ever waiting for one."""

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._rest = b""
        self.ended = False

    def fileno(self) -> int:
        """Give the descriptor to wait on."""
        return self._descriptor

    def lines(self) -> Sequence[bytes]:
        """Return the lines that are complete now."""
        try:
            data = os.read(self._descriptor, READ_BYTES)
        except BlockingIOError:
            return ()
        if not data:
            self.ended = True
        *lines, rest = (self._rest + data).split(b"\n")
        # A line that never ends is cut into pieces, none of which means anything.
        self._rest = rest if len(rest) <= READ_BYTES else b""
        return lines


@dataclass(slots=True)
class EmbeddedMount:
    """A running simulated mount: its port, and where its axes really are."""

    process: subprocess.Popen[bytes]
    reader: LineReader
    port: int
    _decoder: msgspec.json.Decoder[TruthLine] = field(default_factory=lambda: msgspec.json.Decoder(TruthLine))

    def truths(self) -> list[TruthLine]:
        """Return what the mount told since the last call."""
        return [self._decoder.decode(line) for line in self.reader.lines()]

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


def start_embedded(config: SimulatorConfig) -> EmbeddedMount:
    """Start a simulated mount; raises SattrackError where it does not come up."""
    process = subprocess.Popen(
        [*own_program("sattrack.mount.simulator.process"), msgspec.json.encode(config).decode()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # A Ctrl-C for the tracker is not one for the mount.
        start_new_session=True,
    )
    assert process.stdout is not None
    reader = LineReader(process.stdout.fileno())
    lines: list[bytes] = []
    while not lines and not reader.ended:
        readable, _, _ = select.select([reader], [], [], START_WITHIN_S)
        if not readable:
            break
        lines.extend(reader.lines())
    if not lines:
        process.kill()
        process.wait()
        raise SattrackError("the simulated mount did not start; run `sattrack sim --debug` to see why")
    return EmbeddedMount(process, reader, msgspec.json.decode(lines[0], type=Ready).port)

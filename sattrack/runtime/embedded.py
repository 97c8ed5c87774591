"""A simulated mount started in another process, for practice and for the demonstration."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.core.own_program import own_program
from sattrack.mount.simulator.mount import Truth
from sattrack.mount.simulator.process import Ready, SimulatorConfig
from sattrack.runtime.channel import LineReader, see_off

START_WITHIN_S = 20.0
END_WITHIN_S = 2.0
_TRUTHS = msgspec.json.Decoder(Truth)


@dataclass(slots=True)
class EmbeddedMount:
    """A running simulated mount: its port, and where its axes really are."""

    process: subprocess.Popen[bytes]
    reader: LineReader
    port: int

    def truths(self) -> list[Truth]:
        """Return the true positions since the last call."""
        return self.reader.messages(_TRUTHS)

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        see_off(self.process, END_WITHIN_S)
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
    lines = reader.first(START_WITHIN_S)
    if not lines:
        process.kill()
        process.wait()
        raise SattrackError("the simulated mount did not start; run `sattrack sim --debug` to see why")
    return EmbeddedMount(process, reader, msgspec.json.decode(lines[0], type=Ready).port)

"""The simulated mount in a process of its own, told everything in one JSON argument.

Standard output carries JSON lines: first the port it listens on, then where the axes really were at each turn
of the loop. The process ends when its standard input does, so it never outlives whoever started it.
"""

from __future__ import annotations

import os
import signal
import sys
from operator import attrgetter

import msgspec

from sattrack.core.clock import Clock, SimulatedClock, SystemClock
from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.faults import Faults
from sattrack.mount.simulator.installation import Installation
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition, Truth
from sattrack.mount.simulator.server import SimulatorServer
from sattrack.mount.simulator.settings import SimulatorProfile


class ClockSetting(msgspec.Struct, frozen=True):
    """A simulated clock's three numbers."""

    start_utc_s: float
    anchor_s: float
    speed: float


class SimulatorConfig(msgspec.Struct, frozen=True):
    """Everything that makes one simulated mount; port 0 takes any free one.

    `faults` replace those of the hardware's settings.
    """

    site: SimulatedSite
    profile: MountProfile = MountProfile()
    start: StartPosition = StartPosition()
    port: int = 0
    peer_port: int | None = None
    clock: ClockSetting | None = None
    hardware: SimulatorProfile = SimulatorProfile()
    faults: Faults | None = None


class Ready(msgspec.Struct, frozen=True):
    """The first line of output."""

    port: int


class TruthLine(msgspec.Struct, frozen=True, array_like=True):
    """A later line of output, as a JSON array; the meanings are those of `Truth`."""

    counter: int
    utc_s: float
    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    hour_angle_axis_deg: float
    dec_axis_deg: float
    beyond_pole: bool
    at_limit: bool


truth_values = attrgetter(*TruthLine.__struct_fields__)


def make_clock(setting: ClockSetting | None) -> Clock:
    """Return the clock that the numbers describe, the machine's own where there are none."""
    if setting is None:
        return SystemClock()
    return SimulatedClock(setting.start_utc_s, setting.anchor_s, setting.speed)


def make_server(config: SimulatorConfig) -> SimulatorServer:
    """Return the mount on its port.

    Raises SattrackError where the port is in use, BadInputError where the settings say what cannot be.
    """
    mount = SimulatedMount(config.profile, config.site, config.start, config.hardware)
    peer = None if config.peer_port is None else ("127.0.0.1", config.peer_port)
    installation = Installation(mount, config.faults)
    return SimulatorServer(installation, make_clock(config.clock), "127.0.0.1", config.port, peer)


def serve(server: SimulatorServer) -> None:
    """Run until standard input ends, telling the truth on standard output."""
    encoder = msgspec.json.Encoder()
    out = sys.stdout.fileno()
    os.set_blocking(out, False)
    os.set_blocking(sys.stdin.fileno(), False)

    def write(item: object) -> None:
        # A reader that does not keep up loses lines; the mount's loop never waits for it.
        try:
            os.write(out, encoder.encode(item) + b"\n")
        except BlockingIOError:
            return

    def tell(truth: Truth) -> None:
        write(TruthLine(*truth_values(truth)))

    def going() -> bool:
        try:
            return os.read(sys.stdin.fileno(), 64) != b""
        except BlockingIOError:
            return True

    write(Ready(server.port))
    server.run(going, tell, [sys.stdin.fileno()])


def main() -> int:
    """Run the process; returns its exit code."""
    # Interrupting the tracker must not take the mount away before the tracker has stopped it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        server = make_server(msgspec.json.decode(sys.argv[1], type=SimulatorConfig))
    except SattrackError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    try:
        serve(server)
    except BrokenPipeError:
        return 0
    finally:
        server.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())

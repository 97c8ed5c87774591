"""How long each member of `sattrack serve alpaca` takes to answer alpyca, ASCOM's own client.

python bench/alpaca_times.py [TIMES]

ConformU reports what takes longer than a tenth of a second to be read or set, and longer than a second to be
begun; a method that begins something must not wait for its end.
"""

from __future__ import annotations

import json
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from alpaca.exceptions import DriverException
from alpaca.telescope import GuideDirections, Telescope, TelescopeAxes
from programs import SITE, ended, sattrack

from sattrack.servers.alpaca.protocol import MEMBERS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

READ_WITHIN_S, BEGUN_WITHIN_S = 0.1, 1.0
EAST_H = 3.0


def timed(call: Callable[[], Any]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def connects(scope: Telescope) -> bool:
    """Connect; false while the mount has not been heard."""
    try:
        scope.Connect()
    except DriverException:
        return False
    return not scope.Connecting


def wait(until: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not until():
        if time.monotonic() > deadline:
            raise SystemExit("the mount did not obey within a minute")


def read_times(scope: Telescope, times: int) -> dict[str, list[float]]:
    # A target that was not set is an error.
    scope.TargetRightAscension, scope.TargetDeclination = 0.0, 0.0
    told = [member.name for member in MEMBERS if member.read == "yes"]
    names = [name for name in told if isinstance(getattr(Telescope, name, None), property)]
    found: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(times):
        for name in names:
            found[name].append(timed(lambda name=name: getattr(scope, name)))
    return found


def begin_times(scope: Telescope, times: int) -> dict[str, list[float]]:
    """Begin everything that this mount has, each brought to its end before the next."""
    found: dict[str, list[float]] = {}

    def note(name: str, call: Callable[[], Any], over: Callable[[], bool]) -> None:
        found.setdefault(name, []).append(timed(call))
        wait(over)

    def still() -> bool:
        return not scope.Slewing

    for turn in range(times):
        ra_h = (scope.SiderealTime - EAST_H - 0.1 * (turn % 2)) % 24.0
        note("SlewToCoordinatesAsync", lambda ra_h=ra_h: scope.SlewToCoordinatesAsync(ra_h, 40.0), still)
        note("SyncToCoordinates", lambda ra_h=ra_h: scope.SyncToCoordinates(ra_h, 40.0), still)
        note("PulseGuide", lambda: scope.PulseGuide(GuideDirections.guideNorth, 50), still)
        wait(lambda: not scope.IsPulseGuiding)
        note("MoveAxis", lambda: scope.MoveAxis(TelescopeAxes.axisPrimary, 0.5), lambda: bool(scope.Slewing))
        note("MoveAxis, rate 0", lambda: scope.MoveAxis(TelescopeAxes.axisPrimary, 0.0), still)
        scope.SlewToCoordinatesAsync(ra_h, 30.0)
        note("AbortSlew", scope.AbortSlew, still)
        note("DeclinationRate, set", lambda: setattr(scope, "DeclinationRate", 0.0), still)
        note("Connected, set", lambda: setattr(scope, "Connected", True), lambda: bool(scope.Connected))
    return found


def tell(what: str, found: dict[str, list[float]], within_s: float) -> None:
    late = [name for name, seconds in found.items() if max(seconds) > within_s]
    slowest = max(found, key=lambda name: statistics.median(found[name]))
    every = sorted(second for seconds in found.values() for second in seconds)
    print(f"{what}: {len(found)}, {len(every)} calls; later than {within_s:g} s: {', '.join(late) or 'none'}")
    print(
        f"  of all calls: median {1000 * statistics.median(every):.1f} ms, "
        f"99 % {1000 * every[int(0.99 * len(every))]:.1f} ms, longest {1000 * every[-1]:.1f} ms"
    )
    print(f"  the slowest in the mean: {slowest}, {1000 * statistics.median(found[slowest]):.1f} ms")


@contextmanager
def served() -> Iterator[Telescope]:
    """Serve the simulated mount until the end; give a client that is connected."""
    quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "settings.toml"
        settings.write_text("[safety]\noptical = false\n")
        options = ("--port", "0", "--no-discovery", "--json", *SITE, "--config", str(settings))
        with ended(sattrack("serve", "alpaca", "--mount", "sim", *options, **quiet)) as server:
            assert server.stdout is not None
            scope = Telescope(f"127.0.0.1:{json.loads(server.stdout.readline())['listening']}", 0)
            wait(lambda: connects(scope))
            yield scope
            scope.rqs.close()
            server.send_signal(signal.SIGINT)
            server.wait()


def main() -> None:
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    with served() as scope:
        tell("members read", read_times(scope, times), READ_WITHIN_S)
        tell("begun, or set", begin_times(scope, max(3, times // 4)), BEGUN_WITHIN_S)


if __name__ == "__main__":
    main()

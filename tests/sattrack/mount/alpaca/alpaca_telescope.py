"""A simulated Alpaca telescope in a process of its own, and programs run with it as a user runs them."""

from __future__ import annotations

import json
import time
import urllib.parse
import urllib.request
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from programs import simulated_telescope

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable, Iterator

LOOK_AGAIN_S = 0.05
PATIENCE_S = 60.0
LATELY_S = 5.0


class AlpacaTelescope:
    """The process, and what it tells beside its doors."""

    def __init__(self, process: subprocess.Popen[str], port: int) -> None:
        self.process, self.port = process, port
        self.url = f"alpaca://127.0.0.1:{self.port}/0"

    def ask(self, path: str) -> Any:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=PATIENCE_S) as answer:
            return json.loads(answer.read())

    def state(self) -> dict[str, Any]:
        told: dict[str, Any] = self.ask("/simulator/state")
        return told

    def truth(self, since_utc_s: float = 0.0) -> list[tuple[float, float, float]]:
        """Rows of UTC, right ascension and declination: where it truly pointed."""
        return [tuple(row) for row in self.ask(f"/simulator/truth?since={since_utc_s!r}")]

    def set(self, **values: str) -> None:
        data = urllib.parse.urlencode(values).encode()
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/simulator/settings", data, method="PUT"
        )
        with urllib.request.urlopen(request, timeout=PATIENCE_S):
            pass

    def speed_deg_s(self) -> float:
        """How fast it moves over the sky by the last fifth of a second of which it tells."""
        rows = self.truth(time.time() - LATELY_S)[-10:]
        if len(rows) < 2:
            return 0.0
        (t1, ra1, dec1), (t2, ra2, dec2) = rows[0], rows[-1]
        ra = (ra2 - ra1 + 180.0) % 360.0 - 180.0
        return max(abs(ra), abs(dec2 - dec1)) / (t2 - t1)

    def wait(self, holds: Callable[[], bool], within_s: float = PATIENCE_S) -> None:
        until_s = time.monotonic() + within_s
        while not holds():
            assert time.monotonic() < until_s, self.state()
            time.sleep(LOOK_AGAIN_S)

    def wait_moving(self, moving: bool) -> None:
        self.wait(lambda: (self.speed_deg_s() > 0.05) is moving)


@contextmanager
def alpaca_telescope(**settings: Any) -> Iterator[AlpacaTelescope]:
    told = {"latitude_deg": 52.0, "longitude_deg": 4.5, **settings}
    with simulated_telescope(json.dumps(told).encode()) as (process, port):
        yield AlpacaTelescope(process, port)

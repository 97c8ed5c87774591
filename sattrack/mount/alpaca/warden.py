"""The warden: a small process that stops the telescope when the gateway cannot do it any more.

Arguments: the channel's descriptor, the gateway's process, host, port and device. The gateway says with each
turn whether the telescope may be moving. Where it is gone, or stands still for HANG_AFTER_S while that is so,
it is ended for good, and the telescope told to stop until it is seen at rest. Little but the standard
library, so that it starts soon and takes little room.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from sattrack.mount.link_loss import STOPS_MOVING_S, STOPS_SENT_S

HANG_AFTER_S = 1.5
ANSWER_WITHIN_S = 1.0
AGAIN_S = 0.3
SIDEREAL_DEG_S = 360.0 / 86164.0905
RESTS_DEG_S = 0.5 * SIDEREAL_DEG_S
PARKED = 0x408
IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGPIPE)


@dataclass(slots=True)
class Telescope:
    """The telescope, one request at a time. Raises OSError, ValueError, http.client.HTTPException."""

    host: str
    port: int
    device: int

    def get(self, member: str) -> Any:
        """Return a member's value, None where the driver refuses it."""
        body = self._ask("GET", f"{member}?ClientID=4022", None)
        return None if body.get("ErrorNumber") else body.get("Value")

    def put(self, member: str, **fields: str) -> int:
        """Tell a member something; return the driver's error number."""
        return int(self._ask("PUT", member, urlencode({**fields, "ClientID": "4022"})).get("ErrorNumber", 0))

    def _ask(self, method: str, what: str, data: str | None) -> dict[str, Any]:
        connection = http.client.HTTPConnection(self.host, self.port, timeout=ANSWER_WITHIN_S)
        with contextlib.closing(connection):
            headers = {} if data is None else {"Content-Type": "application/x-www-form-urlencoded"}
            connection.request(method, f"/api/v1/telescope/{self.device}/{what}", data, headers)
            body = json.loads(connection.getresponse().read())
        if not isinstance(body, dict):
            raise ValueError("no Alpaca answer")
        return body


def stop(telescope: Telescope) -> bool | None:
    """Stop the telescope; return whether it was seen at rest, None where it was not heard."""
    begun_s = time.monotonic()
    heard = False
    while time.monotonic() - begun_s < (STOPS_MOVING_S if heard else STOPS_SENT_S):
        try:
            telescope.put("abortslew")
            numbers = [telescope.put("moveaxis", Axis=axis, Rate="0") for axis in ("0", "1")]
            heard = True
            obeys = all(number in (0, PARKED) for number in numbers)
            if obeys and rests(telescope):
                return True
        except (OSError, ValueError, http.client.HTTPException):
            time.sleep(AGAIN_S)
    return False if heard else None


def rests(telescope: Telescope) -> bool:
    """Tell whether it stands, or tracks the sky, by two looks at its place."""
    looks = []
    for _ in range(2):
        # The middle of each pair of requests is the same for both coordinates.
        looks.append((time.monotonic(), telescope.get("rightascension"), telescope.get("declination")))
        time.sleep(AGAIN_S)
    (t1, ra1, dec1), (t2, ra2, dec2) = looks
    seconds = t2 - t1
    ra_rate = ((ra2 - ra1) * 15.0 + 180.0) % 360.0 - 180.0
    off = min(abs(ra_rate / seconds), abs(ra_rate / seconds - SIDEREAL_DEG_S))
    return telescope.get("slewing") is not True and max(off, abs(dec2 - dec1) / seconds) < RESTS_DEG_S


def watch(channel: socket.socket) -> str | None:
    """Wait until the gateway needs the telescope stopped; return why, None where it lets go in good order."""
    word = b"r"
    while True:
        readable, _, _ = select.select([channel], [], [], HANG_AFTER_S)
        if not readable:
            if word == b"m":
                return f"stood still for {HANG_AFTER_S:g} s"
            continue
        try:
            data = channel.recv(4096)
        except OSError:
            data = b""
        if b"b" in data:
            return None
        if not data:
            return "ended without a word" if word == b"m" else None
        word = data[-1:]


def main() -> int:
    """Run the process; returns its exit code."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    descriptor, gateway, host, port, device = sys.argv[1:]
    why = watch(socket.socket(fileno=int(descriptor)))
    if why is None:
        return 0
    if os.getppid() == int(gateway):
        # It must not wake up and move on.
        os.kill(int(gateway), signal.SIGKILL)
    at_rest = stop(Telescope(host, int(port), int(device)))
    rest = {
        True: "stopped it: seen at rest",
        False: "told it to stop, and DID NOT SEE IT AT REST: stop it by its own console",
        None: "does NOT HEAR the telescope: stop it by its own console",
    }[at_rest]
    words = f"the gateway to alpaca://{host}:{port}/{device} {why}; its warden {rest}"
    with contextlib.suppress(OSError):
        os.write(2, f"sattrack: {words}\n".encode())
    return 0 if at_rest else 1


if __name__ == "__main__":
    sys.exit(main())

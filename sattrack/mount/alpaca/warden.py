"""The warden: a small process that stops the telescope when the gateway cannot do it any more.

Arguments: the channel's descriptor, the gateway's process, and the telescope's protocol, host, port and
device. The gateway says with each turn whether the telescope may be moving. Where it is gone, or stands still
for HANG_AFTER_S while that is so, it is ended for good, and the telescope is stopped until it is seen at
rest. Little but the standard library, so that it starts soon and takes little room.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import sys
import time
from typing import TYPE_CHECKING

from sattrack.core.angles import wrap180
from sattrack.core.process import signals_here
from sattrack.mount.alpaca.client import PARKED, AlpacaDevice, AlpacaRefusalError, NoAnswerError
from sattrack.mount.link_loss import STOPS_MOVING_S, STOPS_SENT_S
from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from sattrack.mount.indi.client import IndiDevice

HANG_AFTER_S = 1.5
ANSWER_WITHIN_S = 1.0
AGAIN_S = 0.3
RESTS_DEG_S = 0.5 * SIDEREAL_RATE_DEG_S
IGNORED = signals_here("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGPIPE")


def stop(telescope: AlpacaDevice | IndiDevice) -> bool | None:
    """Stop the telescope; return whether it was seen at rest, None where it was not heard."""
    begun_s = time.monotonic()
    heard = False
    while time.monotonic() - begun_s < (STOPS_MOVING_S if heard else STOPS_SENT_S):
        try:
            _refusal(telescope, "abortslew")
            refusals = [_refusal(telescope, "moveaxis", Axis=axis, Rate="0") for axis in ("0", "1")]
            heard = True
            if all(number in (None, PARKED) for number in refusals) and rests(telescope):
                return True
        except (AlpacaRefusalError, NoAnswerError):
            time.sleep(AGAIN_S)
    return False if heard else None


def _refusal(telescope: AlpacaDevice | IndiDevice, member: str, **fields: str) -> int | None:
    """Call a member; return the number of the refusal, None where it is obeyed. Raises Unheard."""
    try:
        telescope.put(member, **fields)
    except AlpacaRefusalError as refusal:
        return refusal.number
    except NoAnswerError as error:
        # A server that cannot carry out one call may carry out the next.
        if error.status is None:
            raise
        return error.status
    return None


def rests(telescope: AlpacaDevice | IndiDevice) -> bool:
    """Return whether it stands, or tracks the sky, by two looks at its place. Raises Refusal, Unheard."""
    looks = []
    for _ in range(2):
        # The middle of each pair of requests is the same for both coordinates.
        began_s = time.monotonic()
        place = telescope.get("rightascension"), telescope.get("declination")
        if not all(isinstance(one, float | int) for one in place):
            raise NoAnswerError(f"{place} is no direction")
        looks.append((began_s, *place))
        time.sleep(AGAIN_S)
    (t1, ra1, dec1), (t2, ra2, dec2) = looks
    seconds = t2 - t1
    ra_rate = wrap180((ra2 - ra1) * 15.0)
    off = min(abs(ra_rate / seconds), abs(ra_rate / seconds - SIDEREAL_RATE_DEG_S))
    return not _slews(telescope) and max(off, abs(dec2 - dec1) / seconds) < RESTS_DEG_S


def _slews(telescope: AlpacaDevice | IndiDevice) -> bool:
    try:
        return telescope.get("slewing") is True
    except AlpacaRefusalError:
        return False


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


def telescope_of(scheme: str, host: str, port: int, device: str) -> AlpacaDevice | IndiDevice:
    """Return who asks the telescope at an address."""
    if scheme == "indi":
        from sattrack.mount.indi.client import IndiDevice

        return IndiDevice(host, port, device, ANSWER_WITHIN_S)
    return AlpacaDevice(f"{host}:{port}", "telescope", int(device), ANSWER_WITHIN_S)


def main() -> int:
    """Run the process; returns its exit code."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    descriptor, gateway, scheme, host, port, device = sys.argv[1:]
    why = watch(socket.socket(fileno=int(descriptor)))
    if why is None:
        return 0
    if os.getppid() == int(gateway):
        # It must not wake up and move on.
        os.kill(int(gateway), signal.SIGKILL)
    at_rest = stop(telescope_of(scheme, host, int(port), device))
    rest = {
        True: "stopped it: seen at rest",
        False: "sent it stops, and DID NOT SEE IT AT REST: stop it by its own console",
        None: "does NOT HEAR the telescope: stop it by its own console",
    }[at_rest]
    words = f"the gateway to {scheme}://{host}:{port}/{device} {why}; its warden {rest}"
    with contextlib.suppress(OSError):
        os.write(2, f"sattrack: {words}\n".encode())
    return 0 if at_rest else 1


if __name__ == "__main__":
    sys.exit(main())

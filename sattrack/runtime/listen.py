"""Listen to a mount without a word to it: what comes, how evenly, and what is missing."""

from __future__ import annotations

import select
import time
from typing import TYPE_CHECKING

from sattrack.core.clock import SystemClock
from sattrack.mount.xerxes.session import Session
from sattrack.runtime.links import heard

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.link import LinkHealth
    from sattrack.runtime.mounts import MountAddress

LISTEN_S = 2.0


def listen(address: MountAddress, profile: MountProfile, seconds: float = LISTEN_S) -> LinkHealth:
    """Return what was heard from a mount within some seconds, by its owner if it has one; nothing is sent.

    Raises SattrackError where the port is not to be had.
    """
    session, clock = Session(profile), SystemClock()
    with heard(address) as link:
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            select.select([link], [], [], left_s)
            for arrival in link.receive():
                session.receive(arrival.data, clock.utc_s(arrival.monotonic_s))
    session.health.strangers = link.strangers
    return session.health

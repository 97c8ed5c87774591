"""The way to a mount, whatever kind it is of: a socket on which it takes commands and gives statuses.

A Xerxes mount is at the other end of that itself; before an Alpaca telescope, a gateway stands.
"""

from __future__ import annotations

import select
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sattrack.core.clock import SystemClock
from sattrack.mount.xerxes.client import Address, UdpLink
from sattrack.mount.xerxes.session import Session
from sattrack.runtime.owner import OverheardLink, look_on

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.link import LinkHealth
    from sattrack.runtime.mounts import MountAddress


@contextmanager
def open_link(address: MountAddress) -> Iterator[UdpLink]:
    """Give a socket towards a mount.

    Raises SattrackError where the port is not available, LinkLostError where a gateway finds no telescope.
    """
    if isinstance(address, Address):
        link = UdpLink(address)
    else:
        # HTTP's modules are many; without an Alpaca telescope they are not needed.
        from sattrack.mount.alpaca.link import open_gateway

        link = open_gateway(address)
    try:
        yield link
    finally:
        link.close()


@contextmanager
def heard(address: MountAddress) -> Iterator[UdpLink | OverheardLink]:
    """Give what to listen to a mount by: its owner's own ears where it has one on this machine, else ours.

    Raises as `open_link`.
    """
    overheard = look_on(address)
    if overheard is None:
        with open_link(address) as link:
            yield link
        return
    try:
        yield overheard
    finally:
        overheard.close()


LISTEN_S = 2.0


def listen(address: MountAddress, profile: MountProfile, seconds: float = LISTEN_S) -> LinkHealth:
    """Return what was heard from a mount within some seconds, by its owner if it has one; nothing is sent.

    Raises SattrackError where the port is not available.
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

"""The client's UDP socket: datagrams out to one mount, datagrams in from it alone, dated on arrival.

No asyncio here: the loop that feeds the mount waits in one `select`, which on a loaded machine keeps the
period an order of magnitude better than an event loop does.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import parse_qs, urlsplit

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.model import MountProfile

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.requests import Request
    from tle.site import Site

DEFAULT_PORT = 15001
ON_TARGET_ARCSEC = 2.0
RECEIVE_BYTES = 2048
BURST = 64
"""Datagrams taken at one go, so that a flood cannot hold the loop."""
MOST_STRANGERS = 4
"""Other hosts whose addresses are kept, so that a flood of made-up ones takes no room."""
REFUSED_WITHIN_S = 0.3
_SO_TIMESTAMPNS = 35
_TIMESPEC = struct.Struct("@ll")
_LONGEST_KERNEL_WAIT_S = 1.0


class Address(NamedTuple):
    """Where the mount listens, and the port on which we do."""

    host: str
    port: int
    listen_port: int

    def __str__(self) -> str:
        """Give the mount's end, as a user would write it."""
        return f"xerxes://{self.host}:{self.port}"

    @property
    def name(self) -> str:
        """The name under which a mount is owned."""
        return f"{self.host}:{self.port}"

    @property
    def silence_advice(self) -> str:
        """What to check where it is not heard."""
        return (
            f"check that the mount is on, that {self.host}:{self.port} is its address and UDP port, and that "
            f"its own window sends to this machine's address, port {self.listen_port}"
        )

    @property
    def presumption(self) -> str | None:
        """What to say of a run without a calibration; None for nothing."""
        return None

    @property
    def dates_itself(self) -> bool:
        """Whether statuses carry a clock of the mount's own; else the middle of each request dates them."""
        return True

    @property
    def on_target_arcsec(self) -> float:
        """How near to the satellite counts as on it."""
        return ON_TARGET_ARCSEC

    def not_carried(self, request: Request) -> str | None:
        """Return why a request cannot be made to this kind of mount, in words; None where it can."""
        del request
        return None

    def seen_from(self, site: Site) -> Address:
        """Return the address for a site: this mount tells its sidereal time itself."""
        del site
        return self

    def to_stop(self) -> Address:
        """Return the address for somebody who asks for stops alone: it is the same."""
        return self

    def usual_profile(self) -> MountProfile:
        """Return what is presumed of a mount that was not calibrated."""
        return MountProfile()


def parse_address(url: str, resolve: bool = True) -> Address:
    """Read `xerxes://HOST:PORT?listen=PORT`; raises BadInputError.

    Without `resolve`, nobody is asked where the host is, and it stays as it was written.
    """
    try:
        parts = urlsplit(url)
        port = parts.port if parts.port is not None else DEFAULT_PORT
        query = parse_qs(parts.query, keep_blank_values=True)
        if unknown := set(query) - {"listen"}:
            raise ValueError(f"{min(unknown)}= is no option")
        listen_text = query.get("listen", [str(DEFAULT_PORT)])[0]
        if not listen_text.isdecimal():
            raise ValueError(f"listen={listen_text} is no port")
        listen = int(listen_text)
    except ValueError as error:
        raise BadInputError(f"--mount {url}: {error}; write xerxes://HOST:PORT?listen=PORT") from error
    if parts.hostname is None:
        raise BadInputError(f"--mount {url}: no host; write xerxes://HOST:PORT?listen=PORT")
    for number, what in ((port, "the mount's port"), (listen, "listen")):
        if not 1 <= number <= 65535:
            raise BadInputError(f"--mount {url}: {what} is {number}; ports run from 1 to 65535")
    if not resolve:
        return Address(parts.hostname, port, listen)
    try:
        host = socket.gethostbyname(parts.hostname)
    except (OSError, UnicodeError) as error:
        raise BadInputError(
            f"--mount {url}: no such host {parts.hostname!r}; check the name, or give its IPv4 address"
        ) from error
    place = IPv4Address(host)
    if place.is_unspecified or place.is_multicast or host == "255.255.255.255":
        raise BadInputError(f"--mount {url}: {host} is the address of no mount; write that of its computer")
    if port == listen and (place.is_loopback or is_own_host(host)):
        raise BadInputError(
            f"--mount {url}: both ends would be {host}:{port}; give another port with ?listen=PORT"
        )
    return Address(host, port, listen)


def is_own_host(host: str) -> bool:
    """Tell whether an address is one of this machine's own: only those can be bound to."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True


def nobody_listens(address: Address, datagram: bytes, within_s: float = REFUSED_WITHIN_S) -> bool:
    """Send one datagram to the mount's end and tell whether its host answers that nothing listens there.

    False says nothing: the host may be off, or keep it to itself.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.settimeout(within_s)
        try:
            probe.connect((address.host, address.port))
            probe.send(datagram)
            probe.recv(RECEIVE_BYTES)
        except ConnectionRefusedError:
            return True
        except OSError:
            return False
    return False


@dataclass(frozen=True, slots=True)
class Arrival:
    """One datagram and the reading of the monotonic clock when it arrived."""

    data: bytes
    monotonic_s: float


class UdpLink:
    """A bound socket towards one mount: one of its own, else `bound`, which another process has bound.

    Raises SattrackError where the port is not available.
    """

    def __init__(self, address: Address, bound: socket.socket | None = None) -> None:
        self.address = address
        self.strangers = 0
        """Datagrams from other hosts, dropped."""
        self.stranger_hosts: list[str] = []
        """The first MOST_STRANGERS of those hosts."""
        self.unsent = 0
        """Datagrams that the network refused to take."""
        self.largest_rates_deg_s: tuple[float, float] | None = None
        """The largest rates of MoveAxis, right ascension first; None where the mount does not tell."""
        self.onlooker: Callable[[float, bytes], None] | None = None
        """Hears of each datagram from the mount: its arrival by the monotonic clock, and its bytes."""
        self._socket = bind(address.host, address.listen_port) if bound is None else bound
        _ask_for_stamps(self._socket)

    def fileno(self) -> int:
        """Give the descriptor to wait on."""
        return self._socket.fileno()

    @property
    def listen_port(self) -> int:
        """The port that statuses come to."""
        port: int = self._socket.getsockname()[1]
        return port

    @property
    def trouble(self) -> str | None:
        """What is wrong with the mount, if something in between reports it; None for nothing."""
        return None

    def send(self, data: bytes) -> None:
        """Send one datagram; a network that is down for the moment is counted, not raised."""
        try:
            self._socket.sendto(data, (self.address.host, self.address.port))
        except OSError:
            self.unsent += 1

    def receive(self) -> list[Arrival]:
        """Return what has arrived, in order."""
        arrivals: list[Arrival] = []
        for _ in range(BURST):
            try:
                data, ancillary, _, sender = self._socket.recvmsg(RECEIVE_BYTES, 64)
            except BlockingIOError:
                break
            except OSError:
                continue
            # The host decides and not the port: a mount may send from another port than it listens on.
            if sender[0] != self.address.host:
                self._note_stranger(sender[0])
                continue
            arrivals.append(Arrival(data, self._arrived(ancillary)))
            if self.onlooker is not None:
                self.onlooker(arrivals[-1].monotonic_s, data)
        return arrivals

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def _note_stranger(self, host: str) -> None:
        self.strangers += 1
        if len(self.stranger_hosts) < MOST_STRANGERS and host not in self.stranger_hosts:
            self.stranger_hosts.append(host)

    def _arrived(self, ancillary: list[tuple[int, int, bytes]]) -> float:
        # The order matters: any delay between the two readings makes the arrival late and never
        # early, and it is by the earliest arrivals that the mount's clock is known.
        kernel_now_s = time.time()
        now_s = time.monotonic()
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(data) >= _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack_from(data)
                waited_s: float = kernel_now_s - (seconds + nanoseconds * 1e-9)
                if 0.0 <= waited_s < _LONGEST_KERNEL_WAIT_S:
                    return now_s - waited_s
        return now_s


def bind(peer_host: str, port: int) -> socket.socket:
    """Return a non-blocking UDP socket on a port, on loopback where the peer is there.

    Raises SattrackError, naming the port, where it is in use.
    """
    where = "127.0.0.1" if peer_host.startswith("127.") else ""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.setblocking(False)
    try:
        bound.bind((where, port))
    except OSError as error:
        bound.close()
        raise SattrackError(
            f"UDP port {port} is not available: {error.strerror}; "
            "is another sattrack running, or a guardian that still stops the mount? "
            "`sattrack stop` lists both; "
            "choose another port, or end that one (a guardian by `sattrack stop --give-up`)"
        ) from error
    return bound


def _ask_for_stamps(bound: socket.socket) -> None:
    # The kernel's stamp is free of the time that our own process waits to be scheduled.
    if sys.platform.startswith("linux"):
        with contextlib.suppress(OSError):
            bound.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)

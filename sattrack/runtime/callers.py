"""What servers on TCP without authentication share: whom they let in, how much each client may ask, its line.

All of this program's servers follow these rules; any client that reaches their port can move the mount.
"""

from __future__ import annotations

import errno
import ipaddress
import math
import re
import socket
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Networks: TypeAlias = tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...]


READ_BYTES = 256
"""Bytes of one read: a flood of commands delays the mount's next datagram by a few milliseconds at most."""
MOST_WAITING_BYTES = 65536
"""A caller that asks and does not read is disconnected when so much waits for it."""
_PORT = re.compile(r":\d*\Z")
Key = TypeVar("Key")
ONE_ADDRESS = 0.875
"""The share of all callers that may come from one address."""
BUSY_S = 2.0
"""A caller that asked for something so lately is not disconnected to make room for one like it."""


class Seat(NamedTuple):
    """One caller that is there: its address, when it last asked for something whole, and when it came."""

    address: str
    asked_s: float
    """-inf where it has not asked for anything yet."""
    came_s: float


@dataclass(slots=True)
class Bucket:
    """A rate a second, and at most so many at once after a silence; instants are of any one clock."""

    rate: float
    most: float
    filled_s: float
    left: float = field(init=False)
    """Below 0 where more was taken than there was."""

    def __post_init__(self) -> None:
        """Begin full."""
        self.left = self.most

    def fill(self, now_s: float) -> float:
        """Return how many may be taken at an instant."""
        self.left = min(self.most, self.left + max(0.0, now_s - self.filled_s) * self.rate)
        self.filled_s = now_s
        return self.left

    def take(self, now_s: float) -> bool:
        """Take one, if there is one; return whether there was."""
        there = self.fill(now_s) >= 1.0
        self.left -= there
        return there


@dataclass(frozen=True, slots=True)
class CallerLimits:
    """What callers may take; with `allowed` None, every address may call."""

    callers: int = 256
    """So many at once."""
    idle_s: float = 300.0
    """One that was silent for so long is disconnected."""
    requests_per_s: float = 1000.0
    allowed: Networks | None = None
    elsewhere_s: float = BUSY_S
    """One that was silent for so long makes room for a caller from another address."""

    def allow(self, address: str) -> bool:
        """Return whether an address may call, or ask where we are."""
        if self.allowed is None:
            return True
        return any(ipaddress.ip_address(address) in network for network in self.allowed)

    def admit(self, address: str, seats: Mapping[Key, Seat], now_s: float) -> tuple[str | None, list[Key]]:
        """Return why an address may not call now, if so; and who must be disconnected to make room for it.

        A client without a request gives way first, then the one that has been silent longest: of the caller's
        own address where that has its share, else of the address that has most callers.
        """
        if not self.allow(address):
            return "it is not among those that --allow names", []
        counts = Counter(seat.address for seat in seats.values())
        crowd = address
        if len(seats) >= self.callers:
            crowd = max(counts, key=counts.__getitem__)
        elif counts[address] < math.ceil(ONE_ADDRESS * self.callers):
            return None, []
        idlest = min(
            (key for key, seat in seats.items() if seat.address == crowd), key=lambda key: seats[key][1:]
        )
        fair = counts[crowd] > counts[address] + 1
        patience_s = BUSY_S if seats[idlest].address == address else self.elsewhere_s
        if not fair and now_s - seats[idlest].asked_s < patience_s:
            return f"there are {counts[crowd]} busy clients already, as many as --clients allows", []
        return None, [idlest]


_TOKEN = rb"[!#$%&'*+.^_`|~0-9A-Za-z-]+"
_HTTP = re.compile(
    rb"(?:GET|HEAD|POST|PUT|DELETE|CONNECT|OPTIONS|TRACE|PATCH|PRI) |" + _TOKEN + rb" +[^ \r\n]+ +HTTP/\d"
)
_MAY_BE_HTTP = re.compile(_TOKEN + rb"(?: +(?:[^ \r\n]+(?: +(?:H(?:T(?:T(?:P/?)?)?)?)?)?)?)?\Z")
_TLS = b"\x16\x03"
"""How a handshake record begins, which holds the ClientHello."""
LONGEST_OPENING = 8192
"""Bytes of a first line that looks like HTTP from its beginning; no command is so long."""


@dataclass(slots=True)
class Opening:
    """Looks at a caller's first line, and keeps it back until it cannot be that of HTTP or TLS.

    A web page can have a browser send text of its own to any port of this machine, behind a request line and
    headers that it cannot leave out. Where nothing is obeyed before the end of its line, `by_lines`, nothing
    need be kept back.
    """

    by_lines: bool = False
    _kept: bytes = b""
    _over: bool = False

    def take(self, data: bytes) -> bytes | None:
        """Take bytes as they come; return those that may be obeyed, None where it must be disconnected."""
        if self._over:
            return data
        self._kept += data
        begins = self._kept.lstrip(b"\r\n")
        maybe = not begins or begins == _TLS[:1] or _MAY_BE_HTTP.match(begins)
        if _HTTP.match(begins) or begins[:2] == _TLS or (maybe and len(self._kept) > LONGEST_OPENING):
            self._kept = b""
            return None
        self._over = not maybe
        if self.by_lines:
            return data
        return b"" if maybe else self.rest()

    def rest(self) -> bytes:
        """Return what was kept back, where nothing else will come."""
        kept, self._kept = self._kept, b""
        return kept


@dataclass(frozen=True, slots=True)
class HostNames:
    """By which names a server may be called: a web page whose own name leads here has another one.

    That is how DNS rebinding has a browser take this server for the page's own.
    """

    names: frozenset[str] = frozenset({"localhost"})

    @classmethod
    def of(cls, host: str, more: Iterable[str]) -> HostNames:
        """Return the names of a computer, with those that somebody gave."""
        own = host.lower().rstrip(".")
        short = own.partition(".")[0]
        named = (name.lower().rstrip(".") for name in more)
        return cls(frozenset({"localhost", own, short, f"{short}.local", *named}) - {"", ".local"})

    def hold(self, host: str, at: tuple[str, int] | None) -> bool:
        """Return whether a Host header may be for us; `at` is the address of ours that was called."""
        name = _PORT.sub("", host.strip()).lower().rstrip(".")
        try:
            address = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return name in self.names or name.endswith(".localhost")
        return address.is_loopback or (at is not None and str(address) == at[0]) or name in self.names


class TcpChannel:
    """A caller on TCP."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        # A response is one small packet, and is wanted now.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3)):
            if hasattr(socket, option):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        self._connection = connection

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._connection.fileno()

    def read(self) -> bytes | None:
        """Return what has come, without waiting; None where the caller is gone."""
        try:
            return self._connection.recv(READ_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> int:
        """Send what can be sent without waiting; return how many bytes were."""
        try:
            return self._connection.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def drop_output(self) -> None:
        """Do nothing: what TCP has taken, it delivers."""

    def close(self) -> None:
        """Hang up."""
        self._connection.close()


def listen(host: str, port: int, backlog: int = 4, how: str = "--port") -> socket.socket:
    """Return a listening TCP socket; `how` names what another port is chosen with.

    Raises SattrackError, naming address and port, where there is none.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.setblocking(False)
    try:
        listener.bind((host, port))
        listener.listen(backlog)
    except OSError as error:
        listener.close()
        if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
            raise SattrackError(
                f"--host {host}: no IPv4 address of this machine: give 127.0.0.1, 0.0.0.0 for all, or its own"
            ) from error
        raise SattrackError(
            f"TCP port {port} on {host} is not available: {error.strerror}; choose another with {how}"
        ) from error
    return listener

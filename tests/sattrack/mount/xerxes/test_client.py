"""The client's UDP socket and its address: what is read, refused, dated, dropped and counted."""

from __future__ import annotations

import select
import socket
import struct
import sys
import time
from typing import TYPE_CHECKING, Any, cast

import pytest
from programs import free_port

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.requests import Abort
from sattrack.mount.xerxes import client
from sattrack.mount.xerxes.client import (
    Address,
    Arrival,
    UdpLink,
    bind,
    is_own_host,
    nobody_listens,
    parse_address,
)
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Iterator

SO_TIMESTAMPNS = 35
"""Of asm-generic/socket.h: a struct timespec of the realtime clock beside each datagram."""
WRITE = "; write xerxes://HOST:PORT?listen=PORT"
PORTS = "; ports run from 1 to 65535"
NO_MOUNT = " is the address of no mount; write that of its computer"


class TestAddress:
    @pytest.mark.parametrize(
        ("url", "address"),
        [
            ("xerxes://192.0.2.7", Address("192.0.2.7", 15001, 15001)),
            ("xerxes://192.0.2.7:1", Address("192.0.2.7", 1, 15001)),
            ("xerxes://192.0.2.7:65535?listen=1", Address("192.0.2.7", 65535, 1)),
            ("xerxes://127.0.0.1:15001?listen=65535", Address("127.0.0.1", 15001, 65535)),
        ],
    )
    def test_host_and_ports_are_read(self, url: str, address: Address) -> None:
        assert parse_address(url) == address

    def test_a_host_that_is_not_looked_up_stays_as_it_was_written(self) -> None:
        assert parse_address("xerxes://mount.invalid", resolve=False) == Address(
            "mount.invalid", 15001, 15001
        )

    @pytest.mark.parametrize(
        ("url", "reason"),
        [
            ("xerxes://127.0.0.1:0?listen=15001", "the mount's port is 0" + PORTS),
            ("xerxes://127.0.0.1:65536?listen=15001", "Port out of range 0-65535" + WRITE),
            ("xerxes://127.0.0.1:-1?listen=15001", "'-1'" + WRITE),
            ("xerxes://127.0.0.1:x?listen=15001", "'x'" + WRITE),
            ("xerxes://127.0.0.1:15002?listen=0", "listen is 0" + PORTS),
            ("xerxes://127.0.0.1:15002?listen=65536", "listen is 65536" + PORTS),
            ("xerxes://127.0.0.1:15002?listen=x", "listen=x is no port" + WRITE),
            ("xerxes://127.0.0.1:15002?listen=", "listen= is no port" + WRITE),
            ("xerxes://127.0.0.1:15002?port=7", "port= is no option" + WRITE),
            ("xerxes://127.0.0.1:15001?listen=15001", "both ends would be 127.0.0.1:15001"),
            ("xerxes://0.0.0.0", "0.0.0.0" + NO_MOUNT),
            ("xerxes://224.0.0.1", "224.0.0.1" + NO_MOUNT),
            ("xerxes://255.255.255.255", "255.255.255.255" + NO_MOUNT),
            ("xerxes://:15001", "no host" + WRITE),
            ("", "no host" + WRITE),
        ],
    )
    def test_an_impossible_address_is_refused_in_one_line_that_names_it(self, url: str, reason: str) -> None:
        with pytest.raises(BadInputError) as refusal:
            parse_address(url)
        assert str(refusal.value).startswith(f"--mount {url}: ")
        assert reason in str(refusal.value)
        assert "\n" not in str(refusal.value)

    def test_our_own_address_is_known_on_every_interface(self, monkeypatch: pytest.MonkeyPatch) -> None:
        assert is_own_host("127.0.0.1") is True
        assert is_own_host("192.0.2.7") is False
        monkeypatch.setattr(client, "is_own_host", lambda host: host == "192.0.2.7")
        with pytest.raises(BadInputError, match=r"both ends would be 192\.0\.2\.7:15001"):
            parse_address("xerxes://192.0.2.7")
        assert parse_address("xerxes://192.0.2.7?listen=15002").listen_port == 15002

    def test_what_it_tells_of_the_mount(self) -> None:
        address = Address("192.0.2.7", 15001, 15002)
        assert (str(address), address.name) == ("xerxes://192.0.2.7:15001", "192.0.2.7:15001")
        assert "192.0.2.7:15001 is its address" in address.silence_advice
        assert address.silence_advice.endswith("sends to this machine's address, port 15002")
        assert (address.presumption, address.not_carried(Abort())) == (None, None)
        # The status has the mount's own sidereal time: no site is needed to date it.
        assert address.dates_itself is True
        assert address.on_target_arcsec == 2.0
        assert address.seen_from(Site(52.0, 4.5, 0.0)) == address.to_stop() == address
        assert address.usual_profile() == MountProfile()


class TestNobodyListens:
    def test_only_an_answer_says_so(self) -> None:
        address = Address("127.0.0.1", free_port(), free_port())
        assert nobody_listens(address, b"x") is True
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            listener.bind(("127.0.0.1", address.port))
            assert nobody_listens(address, b"x", within_s=0.05) is False
            assert listener.recv(9) == b"x"

    def test_neither_a_mount_that_answers_nor_a_network_that_is_down_says_so(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        address = Address("127.0.0.1", free_port(), free_port())
        monkeypatch.setattr(socket.socket, "recv", lambda *_: b"status")
        assert nobody_listens(address, b"x") is False
        monkeypatch.undo()
        assert nobody_listens(Address("255.255.255.255", 9, 9), b"x") is False


@pytest.fixture
def loopback() -> Iterator[tuple[UdpLink, socket.socket]]:
    """Our link, and the socket of the mount that it was told of."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mount:
        mount.bind(("127.0.0.1", 0))
        mount.settimeout(60.0)
        link = UdpLink(Address("127.0.0.1", mount.getsockname()[1], 0))
        yield link, mount
        link.close()


class TestLink:
    def test_datagrams_go_out_and_come_in_whole_and_in_order(
        self, loopback: tuple[UdpLink, socket.socket]
    ) -> None:
        link, mount = loopback
        link.send(b"command")
        assert mount.recvfrom(99) == (b"command", ("127.0.0.1", link.listen_port))
        seen: list[tuple[float, bytes]] = []
        link.onlooker = lambda arrival_s, data: seen.append((arrival_s, data))
        sent = [bytes([number]) * 1500 for number in range(5)]
        for data in sent:
            mount.sendto(data, ("127.0.0.1", link.listen_port))
        arrivals = link.receive()
        assert [arrival.data for arrival in arrivals] == sent
        assert seen == [(arrival.monotonic_s, arrival.data) for arrival in arrivals]
        assert (link.unsent, link.strangers, link.trouble) == (0, 0, None)
        assert link.receive() == []
        assert select.select([link], [], [], 0.0)[0] == []
        mount.sendto(b"status", ("127.0.0.1", link.listen_port))
        assert select.select([link], [], [], 60.0)[0] == [link]

    @pytest.mark.skipif(sys.platform != "linux", reason="the kernel's stamps are Linux's")
    def test_it_dates_what_waited_by_when_it_came(self, loopback: tuple[UdpLink, socket.socket]) -> None:
        link, mount = loopback
        before_s = time.monotonic()
        for _ in range(50):
            mount.sendto(b"status", ("127.0.0.1", link.listen_port))
        sent_s = time.monotonic()
        came_s = [arrival.monotonic_s for arrival in link.receive()]
        assert len(came_s) == 50
        assert before_s <= min(came_s) < sent_s

    def test_strangers_are_dropped_and_counted_and_four_of_them_named(
        self, loopback: tuple[UdpLink, socket.socket]
    ) -> None:
        link, mount = loopback
        for number in (6, 7, 8, 9, 10, 11):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.bind((f"127.0.0.{number}", 0))
                stranger.sendto(b"x" * 160, ("127.0.0.1", link.listen_port))
                stranger.sendto(b"x" * 160, ("127.0.0.1", link.listen_port))
        mount.sendto(b"status", ("127.0.0.1", link.listen_port))
        assert [arrival.data for arrival in link.receive()] == [b"status"]
        assert link.strangers == 12
        assert link.stranger_hosts == ["127.0.0.6", "127.0.0.7", "127.0.0.8", "127.0.0.9"]

    def test_a_mount_elsewhere_is_listened_to_on_every_interface(self) -> None:
        for host, where in (("127.0.0.5", "127.0.0.1"), ("192.0.2.7", "0.0.0.0")):
            with bind(host, 0) as bound:
                assert bound.getsockname()[0] == where
                assert not bound.getblocking()

    def test_a_port_that_is_taken_is_told(self) -> None:
        with bind("127.0.0.1", 0) as taken:
            port = taken.getsockname()[1]
            with pytest.raises(SattrackError, match=f"UDP port {port} is not available: Address already"):
                UdpLink(Address("127.0.0.1", 9, port))


class Wire:
    """A socket that gives what it was told to, and takes nothing."""

    def __init__(self, *found: Any) -> None:
        self.found = list(found)

    def recvmsg(self, *_: int) -> Any:
        one = self.found.pop(0) if self.found else BlockingIOError()
        if isinstance(one, OSError):
            raise one
        return one

    def sendto(self, *_: object) -> None:
        raise OSError(101, "Network is unreachable")

    def setsockopt(self, *_: object) -> None:
        raise OSError(92, "Protocol not available")


def wired(*found: Any) -> UdpLink:
    return UdpLink(Address("192.0.2.7", 15001, 15001), cast("socket.socket", Wire(*found)))


def datagram(data: bytes, *ancillary: tuple[int, int, bytes]) -> Any:
    return data, list(ancillary), 0, ("192.0.2.7", 15001)


class TestLinkByHand:
    def test_a_network_that_is_down_is_counted(self) -> None:
        link = wired()
        link.send(b"x")
        link.send(b"x")
        assert link.unsent == 2

    def test_a_refusal_of_the_mounts_host_hides_no_datagram(self) -> None:
        link = wired(ConnectionRefusedError(), datagram(b"a"), ConnectionRefusedError(), datagram(b"b"))
        assert [arrival.data for arrival in link.receive()] == [b"a", b"b"]

    def test_a_flood_is_taken_in_64s(self) -> None:
        link = wired(*(datagram(bytes([number])) for number in range(70)))
        assert [len(link.receive()) for _ in range(3)] == [64, 6, 0]

    @pytest.mark.parametrize(
        ("ancillary", "monotonic_s"),
        [
            ([], 50.0),
            ([(socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 1000, 500_000_000))], 49.75),
            ([(socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 1000, 750_000_000))], 50.0),
            # Of a realtime clock that was set meanwhile: it says nothing.
            ([(socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 1001, 0))], 50.0),
            ([(socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 999, 250_000_000))], 50.0),
            # Of another kind, of another level, too short.
            ([(socket.SOL_SOCKET, 29, struct.pack("@ll", 1000, 500_000_000))], 50.0),
            ([(socket.IPPROTO_IP, SO_TIMESTAMPNS, struct.pack("@ll", 1000, 500_000_000))], 50.0),
            ([(socket.SOL_SOCKET, SO_TIMESTAMPNS, b"\0" * 8)], 50.0),
        ],
    )
    def test_the_kernels_stamp_dates_a_datagram(
        self,
        monkeypatch: pytest.MonkeyPatch,
        ancillary: list[tuple[int, int, bytes]],
        monotonic_s: float,
    ) -> None:
        link = wired(datagram(b"a", *ancillary))
        monkeypatch.setattr(time, "time", lambda: 1000.75)
        monkeypatch.setattr(time, "monotonic", lambda: 50.0)
        assert link.receive() == [Arrival(b"a", monotonic_s)]

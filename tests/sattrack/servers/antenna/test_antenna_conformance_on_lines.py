"""The same rows over TCP and over a pair of pseudo-terminals, by the server that the program uses."""

from __future__ import annotations

import os
import pty
import select
import socket
import termios
import tty
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import pytest
from antenna_setup import NOON_NS, make_controller
from conformance_rows import ROWS, Row

from sattrack.runtime.callers import Seat, listen
from sattrack.servers.antenna.protocol import NS
from sattrack.servers.antenna.serve import BAUDS, ONE_CALLER, AntennaServer, SerialChannel

if TYPE_CHECKING:
    from collections.abc import Iterator

PATIENCE_S = 60.0
ON_LINES = [row for row in ROWS if row.on_a_line]


class Caller(Protocol):
    def send(self, data: bytes) -> None: ...

    def fileno(self) -> int: ...

    def receive(self) -> bytes: ...


@dataclass
class TcpCaller:
    connection: socket.socket

    def send(self, data: bytes) -> None:
        self.connection.sendall(data)

    def fileno(self) -> int:
        return self.connection.fileno()

    def receive(self) -> bytes:
        return self.connection.recv(4096)


@dataclass
class PtyCaller:
    master: int

    def send(self, data: bytes) -> None:
        os.write(self.master, data)

    def fileno(self) -> int:
        return self.master

    def receive(self) -> bytes:
        return os.read(self.master, 4096)


@pytest.fixture
def by_tcp() -> Iterator[tuple[AntennaServer, Caller]]:
    server = AntennaServer(listen("127.0.0.1", 0))
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        select.select([server.listener], [], [], PATIENCE_S)
        server.serve(server.readers(), float, lambda data, at: (b"", False))
        yield server, TcpCaller(connection)
        server.close()


@pytest.fixture
def by_pty() -> Iterator[tuple[AntennaServer, Caller]]:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    tty.setraw(master, termios.TCSANOW)
    server = AntennaServer(channel=SerialChannel(os.ttyname(slave), 9600))
    yield server, PtyCaller(master)
    server.close()
    os.close(slave)
    os.close(master)


def converse(row: Row, server: AntennaServer, caller: Caller) -> None:
    controller = make_controller()
    controller.switch(not row.local, NOON_NS)
    for step in row.steps:
        if step.sent:
            caller.send(step.sent)
        taken = got = b""
        at_ns = NOON_NS + round(step.at_s * NS)

        def answer(data: bytes, _: float, at_ns: int = at_ns) -> tuple[bytes, bool]:
            nonlocal taken
            taken += data
            return controller.receive(data, at_ns)

        while len(taken) < len(step.sent):
            ready, _, _ = select.select(server.readers(), [], [], PATIENCE_S)
            assert ready, "what was sent did not come"
            server.serve(ready, float, answer)
        while len(got) < len(step.received):
            readable, _, _ = select.select([caller], [], [], PATIENCE_S)
            assert readable, f"answered {got!r}, and no more"
            got += caller.receive()
        assert got == step.received
        assert not select.select([caller], [], [], 0.0)[0], "something came unasked"


@pytest.mark.parametrize("row", ON_LINES, ids=lambda row: f"{row.section} {row.claim}")
def test_the_row_holds_over_tcp(row: Row, by_tcp: tuple[AntennaServer, Caller]) -> None:
    converse(row, *by_tcp)


@pytest.mark.parametrize("row", ON_LINES, ids=lambda row: f"{row.section} {row.claim}")
def test_the_row_holds_over_a_pair_of_terminals(row: Row, by_pty: tuple[AntennaServer, Caller]) -> None:
    converse(row, *by_pty)


def test_a_second_caller_is_hung_up_on_and_the_first_goes_on(by_tcp: tuple[AntennaServer, Caller]) -> None:
    server, caller = by_tcp
    converse(ROWS[0], server, caller)
    with socket.create_connection(("127.0.0.1", server.port)) as second:
        select.select([server.listener], [], [], PATIENCE_S)
        server.serve([server.listener], float, lambda data, at: (b"", False))
        second.settimeout(PATIENCE_S)
        assert second.recv(100) == b""
    assert server.disconnected == 1
    converse(ROWS[0], server, caller)


def test_a_caller_that_never_spoke_makes_room_for_the_next() -> None:
    server, controller = AntennaServer(listen("127.0.0.1", 0)), make_controller()

    def turn() -> bool:
        ready, _, _ = select.select(server.readers(), [], [], PATIENCE_S)
        return server.serve(ready, float, lambda data, _: controller.receive(data, NOON_NS))

    with socket.create_connection(("127.0.0.1", server.port)) as silent:
        turn()
        with socket.create_connection(("127.0.0.1", server.port)) as second:
            assert turn()
            second.sendall(b"PS C3\n")
            turn()
            second.settimeout(PATIENCE_S)
            assert second.recv(4096) == ROWS[0].steps[0].received
            silent.settimeout(PATIENCE_S)
            assert silent.recv(100) == b""
    server.close()


@pytest.mark.parametrize(
    ("address", "silent_s", "gives_way"),
    [
        ("192.0.2.1", 1.0, False),
        ("192.0.2.1", 3.0, True),
        ("192.0.2.2", 59.0, False),
        ("192.0.2.2", 61.0, True),
    ],
)
def test_a_seat_is_kept_by_whoever_speaks(address: str, silent_s: float, gives_way: bool) -> None:
    seats = {0: Seat("192.0.2.1", 100.0, 0.0)}
    refusal, makes_room = ONE_CALLER.admit(address, seats, 100.0 + silent_s)
    assert (refusal is None, makes_room == [0]) == (gives_way, gives_way)


def test_a_caller_gone_in_the_middle_of_a_line_leaves_room_for_the_next() -> None:
    server, controller = AntennaServer(listen("127.0.0.1", 0)), make_controller()

    def turn() -> bool:
        ready, _, _ = select.select(server.readers(), [], [], PATIENCE_S)
        return server.serve(ready, float, lambda data, _: controller.receive(data, NOON_NS))

    with socket.create_connection(("127.0.0.1", server.port)) as first:
        turn()
        first.sendall(b"TD 10 2")
        turn()
    assert turn()
    controller.hang_up()
    with socket.create_connection(("127.0.0.1", server.port)) as second:
        turn()
        second.sendall(b"PS C3\n")
        turn()
        second.settimeout(PATIENCE_S)
        assert second.recv(4096) == ROWS[0].steps[0].received
    server.close()


def test_characters_with_wrong_parity_reach_the_controller_as_zero_bytes() -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    channel = SerialChannel(os.ttyname(slave), 9600, "7E1")
    flags = termios.tcgetattr(channel.fileno())[0]
    assert flags & termios.INPCK
    assert not flags & (termios.IGNPAR | termios.PARMRK)
    channel.close()
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize("baud", BAUDS)
def test_a_serial_line_has_the_speed_and_framing_that_was_asked_for(baud: int) -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    for framing, parity, stops in (("7E1", termios.PARENB, 0), ("8N2", 0, termios.CSTOPB)):
        channel = SerialChannel(os.ttyname(slave), baud, framing)
        iflag, oflag, cflag, lflag, speed_in, speed_out, _ = termios.tcgetattr(channel.fileno())
        assert speed_in == speed_out == getattr(termios, f"B{baud}")
        # A pseudo-terminal has 8 bits whatever is asked of it.
        assert cflag & (termios.PARENB | termios.PARODD | termios.CSTOPB) in {parity | stops, stops}
        assert not iflag & (termios.IXON | termios.IXOFF | termios.ICRNL | termios.ISTRIP)
        assert not cflag & termios.CRTSCTS
        assert not lflag & (termios.ECHO | termios.ICANON | termios.ISIG)
        assert not oflag & termios.OPOST
        channel.close()
    os.close(slave)
    os.close(master)


class SlowChannel:
    """A line that takes a few characters at a time, when it is let."""

    def __init__(self) -> None:
        self.incoming = b""
        self.taken: list[bytes] = []
        self.room = 0
        self.dropped = 0

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        data, self.incoming = self.incoming, b""
        return data

    def write(self, data: bytes) -> int:
        self.taken.append(data[: self.room])
        return min(self.room, len(data))

    def drop_output(self) -> None:
        self.dropped += 1

    def close(self) -> None:
        pass


def served(channel: SlowChannel, server: AntennaServer, data: bytes) -> None:
    controller = make_controller()
    channel.incoming = data
    server.serve([channel], float, lambda data, _: controller.receive(data, NOON_NS))


def test_a_response_is_handed_to_the_line_in_one_piece() -> None:
    channel = SlowChannel()
    channel.room = 1000
    served(channel, AntennaServer(channel=channel), b"PS C3\n")
    assert channel.taken == [ROWS[0].steps[0].received]


def test_synchronisation_drops_what_the_line_has_not_taken_yet() -> None:
    channel = SlowChannel()
    server = AntennaServer(channel=channel)
    channel.room = 5
    served(channel, server, b"PS C3\nPS C3\n")
    served(channel, server, b"#TIME 4F\n")
    channel.room = 1000
    server.flush()
    assert channel.dropped == 1
    assert b"".join(channel.taken[1:]) == b"TIME 20728 43200.000000 D9\n"
    assert channel.taken[0] == b"PS ,,"

"""`sattrack serve rotctld` as a program, one for most of these."""

from __future__ import annotations

import random
import socket
import subprocess
import time
from typing import TYPE_CHECKING

import pytest
from rotctld_setup import say
from serving import PATIENCE_S, Served, call, resident_kb, serve_owned_mount, serving_program, until
from test_rotctld_fuzz import malformed

from sattrack.cli.main import run

if TYPE_CHECKING:
    from collections.abc import Iterator

needs_rotctl = pytest.mark.needs("rotctl")


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with serving_program(
        "rotctld", "--host", "0.0.0.0", "--allow", "127.0.0.0/8", "--requests", "100000"
    ) as running:
        yield running


def place(line: socket.socket) -> tuple[float, float]:
    az, el = say(line, b"p").split()
    return float(az), float(el)


def test_a_host_that_is_not_loopback_is_warned_of(served: Served) -> None:
    warned = [line for line in served.log if b" rotctld: WARNING: rotctld has no authentication" in line]
    assert len(warned) == 1
    assert b"if its address is 127.0.0.0/8" in warned[0]


def test_a_client_that_is_gone_in_mid_slew_leaves_the_mount_to_its_end(served: Served) -> None:
    with call(served.port) as line:
        az_deg, el_deg = place(line)
        assert say(line, f"P {az_deg - 5.0:.2f} {el_deg:.2f}".encode()) == b"RPRT 0\n"
    served.wait_for(b"is gone")
    with call(served.port) as other:
        until(lambda: abs(place(other)[0] - az_deg + 5.0) <= 0.011)
        assert say(other, b"S") == b"RPRT 0\n"


def test_two_hundred_clients_are_answered_at_once(served: Served) -> None:
    lines = [call(served.port) for _ in range(200)]
    try:
        for line in lines:
            line.sendall(b"p\n+p\n\\get_info\n")
        for line in lines:
            came = b""
            while came.count(b"\n") < 7:
                data = line.recv(4096)
                assert data
                came += data
            assert came.endswith(b"RPRT 0\nsattrack 0.1.0: xerxes-default\n")
    finally:
        for line in lines:
            line.close()
    with call(served.port) as last:
        place(last)


def hammer_the_program(served: Served, lines: int, seed: int) -> int:
    """Send malformed lines to the program; return by how many kB it has grown since a tenth of them."""
    chance = random.Random(seed)
    with call(served.port) as line:
        before = place(line)
        resident = 0
        for part in range(100):
            if part == 10:
                resident = resident_kb(served.process.pid)
            pairs = [malformed(chance) for _ in range(lines // 100)]
            expected = "".join(answer for _, answer in pairs).encode("latin-1")
            line.sendall("".join(sent for sent, _ in pairs).encode("latin-1"))
            came = b""
            while len(came) < len(expected):
                came += line.recv(65536)
            assert came == expected
        after = place(line)
        # A mount that was not asked for anything tracks the sky.
        assert all(abs(a - b) < 2.0 for a, b in zip(before, after, strict=True))
        return resident_kb(served.process.pid) - resident


@pytest.mark.soak
def test_a_hundred_thousand_malformed_lines_on_the_wire_move_nothing_and_leave_nothing_behind(
    served: Served,
) -> None:
    assert hammer_the_program(served, 100_000, 10) < 2000


def test_malformed_lines_on_the_wire_move_nothing(served: Served) -> None:
    hammer_the_program(served, 3000, 11)


def rotctl(port: int, *words: str) -> str:
    command = ["rotctl", "-m", "2", "-r", f"127.0.0.1:{port}", *words]
    ended = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
    return ended.stdout.decode()


@needs_rotctl
def test_hamlibs_own_client_drives_the_mount(served: Served) -> None:
    port = served.port
    before = [float(word) for word in rotctl(port, "p").split()]
    assert len(before) == 2
    told = rotctl(port, "P", str(before[0] + 1.0), str(before[1]), "_", "R", "1", "M", "16", "10", "S")
    assert "sattrack" in told
    assert "error" not in told
    rotctl(port, "P", f"{before[0] + 2.0}", f"{before[1]}")
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        az_deg, el_deg = (float(word) for word in rotctl(port, "p").split())
        if abs(az_deg - before[0] - 2.0) < 0.011 and abs(el_deg - before[1]) < 0.011:
            break
        assert time.monotonic() < deadline_s, f"it is at {az_deg}, {el_deg}, and began at {before}"
    assert "error" in rotctl(port, "P", "500", "10")
    assert "Feature not available" in rotctl(port, "K")


def test_ctrl_c_in_mid_slew_stops_the_mount_and_the_log_tells_the_story() -> None:
    with serving_program("rotctld") as alone, call(alone.port) as line:
        az_deg, el_deg = place(line)
        assert say(line, b"P x y") == b"RPRT -1\n"
        assert say(line, f"P {az_deg - 90.0:.2f} {el_deg:.2f}".encode()) == b"RPRT 0\n"
        until(lambda: abs(place(line)[0] - az_deg) >= 2.0)
        alone.end()
    assert alone.process.returncode == 130
    story = b"".join(alone.log)
    for words in (b"client 1 is there, from 127.0.0.1:", b"client 1 commands", b"1 requests were answered"):
        assert b" rotctld: " + words in story
    assert alone.log[-1] == b"sattrack: interrupted; the mount is stopped\n"


def test_the_mount_of_another_program_is_not_served_and_its_owner_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = serve_owned_mount("rotctld")
    told = capsys.readouterr().err
    assert f"127.0.0.1:{port} has an owner: `" in told
    assert told.endswith("`sattrack stop` ends it\n")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--port", "70000"), "ports run to 65535"),
        (("--clients", "0"), "--clients 0: give 1 to 500"),
        (("--idle", "0"), "--idle 0: 1 or more"),
        (("--idle", "nan"), "--idle nan: 1 or more"),
        (("--idle", "1e300"), "--idle 1e+300: 1 or more, 86400 at most"),
        (("--requests", "0.5"), "--requests 0.5: 1 or more"),
        (("--allow", "nowhere"), "--allow nowhere"),
        (("--clock", "2026-10-02T13:00:00Zx10"), "give no speed"),
        (("--mount", "antenna://there:1"), "sattrack track"),
    ],
)
def test_what_cannot_be_served_is_told(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = arguments if "--mount" in arguments else ("--mount", "sim", *arguments)
    assert run(["serve", "rotctld", *options]) == 2
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1


def test_a_port_that_is_taken_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert run(["serve", "rotctld", "--mount", "sim", "--port", str(taken.getsockname()[1])]) == 1
    assert "choose another with --port" in capsys.readouterr().err

"""`sattrack serve alpaca` as a program, one for most of these, and clients that behave badly."""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from alpaca_serving import http_process, read_answer, request, say, serving
from serving import PATIENCE_S, Served, call, resident_kb, serve_owned_mount, until
from test_alpaca_fuzz import malformed

from sattrack.cli.main import run

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[4]
IN_A_PASS = "2026-10-02T13:03:00Z"
MOST_CONNECTIONS = 230


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    options = ("--host", "0.0.0.0", "--allow", "127.0.0.0/8", "--requests", "100000", "--clock", IN_A_PASS)
    with serving(*options, "--clients", str(MOST_CONNECTIONS), discovery=True) as running:
        with call(running.port) as line:
            say(line, "PUT", "connect")
            follow_once(line)
        yield running


def follow_once(line: socket.socket) -> None:
    """Follow a satellite for the first time, which on a busy machine takes longer than clients wait."""
    until(lambda: follows(say(line, "PUT", "action", "Action=TrackSatellite&Parameters=25544")))
    say(line, "PUT", "abortslew")
    until(lambda: say(line, "GET", "slewing")["Value"] is False)


def follows(told: dict[str, object]) -> bool:
    return "Value" in told or "is following" in str(told["ErrorMessage"])


def number_of(line: socket.socket, member: str) -> float:
    value = say(line, "GET", member)["Value"]
    assert isinstance(value, float)
    return value


def test_a_host_that_is_not_loopback_is_warned_of(served: Served) -> None:
    warned = [line for line in served.log if b"WARNING: alpaca has no authentication" in line]
    assert len(warned) == 1
    assert b"if its address is 127.0.0.0/8" in warned[0]


def test_a_request_on_the_wire_is_answered_to_the_byte(served: Served) -> None:
    with call(served.port) as line:
        line.sendall(
            b"GET /api/v1/telescope/0/interfaceversion?clientid=1&ClientTransactionID=77 HTTP/1.1\r\n"
            b"Host: localhost\r\n\r\n"
        )
        status, body = read_answer(line)
        assert status == 200
        head, _, tail = body.partition(b'"ServerTransactionID":')
        assert head == b'{"Value":4,"ClientTransactionID":77,'
        assert tail.endswith(b',"ErrorNumber":0,"ErrorMessage":""}')
        form = b"axis=0&Rate=0&ClientTransactionID=78"
        line.sendall(
            b"PUT /api/v1/telescope/0/moveaxis HTTP/1.1\r\nHost: localhost\r\n"
            b"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: %d\r\n\r\n%s"
            % (len(form), form)
        )
        status, body = read_answer(line)
        assert (status, body) == (400, b"Axis is missing: axis is not the same, case counts in a PUT\n")


@pytest.mark.parametrize(
    ("method", "target", "allow"),
    [
        ("POST", "/api/v1/telescope/0/connected", b"GET, PUT"),
        ("DELETE", "/setup", b"GET"),
        ("PUT", "/management/apiversions", b"GET"),
    ],
)
def test_a_method_that_is_not_used_is_answered_with_those_that_are(
    served: Served, method: str, target: str, allow: bytes
) -> None:
    with call(served.port) as line:
        line.sendall(request(method, target))
        head = line.recv(65536).lower()
    assert head.startswith(b"http/1.1 405 ")
    assert b"\r\nallow: %s\r\n" % allow.lower() in head


@pytest.mark.parametrize(
    ("target", "status"),
    [
        ("http://127.0.0.1:{port}/api/v1/telescope/0/interfaceversion?ClientTransactionID=7", 200),
        ("http://localhost/setup", 200),
        ("http://rebound.example:{port}/api/v1/telescope/0/interfaceversion", 403),
        ("//api/v1/telescope/0/interfaceversion", 404),
    ],
)
def test_a_target_may_be_a_whole_url_whose_host_counts(served: Served, target: str, status: int) -> None:
    with call(served.port) as line:
        line.sendall(request("GET", target.format(port=served.port)))
        assert read_answer(line)[0] == status


def test_requests_may_come_in_pieces_and_several_at_once(served: Served) -> None:
    one = request("GET", "/api/v1/telescope/0/interfaceversion")
    put = request("PUT", "/api/v1/telescope/0/targetdeclination", b"TargetDeclination=5")
    with call(served.port) as line:
        for byte in (one + put)[:-1]:
            line.sendall(bytes([byte]))
        line.sendall((one + put)[-1:])
        assert read_answer(line)[0] == 200
        assert read_answer(line)[0] == 200
        line.sendall(one * 20)
        came = b""
        while came.count(b'"Value":4') < 20:
            piece = line.recv(65536)
            assert piece
            came += piece


@pytest.mark.parametrize(
    ("bytes_sent", "statuses"),
    [
        (b"\x00\xff\x16\x03\x01 garbage\r\n\r\n", {400}),
        (b"GET\r\n\r\n", {400}),
        (b"GET /setup HTTP/9.9\r\nHost: localhost\r\n\r\n", {400, 505}),
        (b"GET /" + b"a" * 20000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n", {400, 414}),
        (b"GET /setup HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 20000 + b"\r\n\r\n", {400, 431}),
        (
            b"PUT /api/v1/telescope/0/moveaxis HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
            {400},
        ),
        (
            b"PUT /api/v1/telescope/0/moveaxis HTTP/1.1\r\nHost: localhost\r\n"
            b"Transfer-Encoding: chunked\r\n\r\nZZ\r\n",
            {400},
        ),
        (request("PUT", "/api/v1/telescope/0/moveaxis", b"a" * 20000), {413}),
    ],
)
def test_what_is_no_request_or_too_large_is_refused(
    served: Served, bytes_sent: bytes, statuses: set[int]
) -> None:
    with call(served.port) as line:
        line.sendall(bytes_sent)
        data = b""
        while piece := line.recv(65536):
            data += piece
            if b"\r\n\r\n" in data:
                break
        assert int(data.split()[1]) in statuses, data


def test_a_web_page_in_somebodys_browser_moves_nothing(served: Served) -> None:
    body = b"Axis=0&Rate=1"
    with call(served.port) as line:
        line.sendall(request("PUT", "/api/v1/telescope/0/moveaxis", body, "Origin: http://a.example\r\n"))
        assert read_answer(line)[0] == 403
    with call(served.port) as line:
        line.sendall(request("OPTIONS", "/api/v1/telescope/0/moveaxis", b"", "Origin: http://a.example\r\n"))
        assert read_answer(line)[0] in {403, 405}
    with call(served.port) as line:
        assert say(line, "GET", "slewing")["Value"] is False


def test_two_hundred_connections_are_answered_at_once_and_more_are_hung_up_on(served: Served) -> None:
    lines = [call(served.port) for _ in range(200)]
    asked = request("GET", "/api/v1/telescope/0/rightascension")
    try:
        for line in lines:
            line.sendall(asked)
        for line in lines:
            assert read_answer(line)[0] == 200
        for _ in range(MOST_CONNECTIONS):
            lines.append(call(served.port))
            with contextlib.suppress(OSError):
                lines[-1].sendall(asked)
        until(lambda: sum(is_open(line) for line in lines) <= MOST_CONNECTIONS)
    finally:
        for line in lines:
            line.close()
    until(lambda: is_answered(served.port))


def is_open(line: socket.socket) -> bool:
    """Tell whether a line was not hung up on."""
    line.setblocking(False)
    try:
        return line.recv(1, socket.MSG_PEEK) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def is_answered(port: int) -> bool:
    """Tell whether there is room for one more, who is answered."""
    try:
        with call(port) as line:
            line.sendall(request("GET", "/api/v1/telescope/0/connected?ClientID=1"))
            return bool(line.recv(1, socket.MSG_PEEK)) and b'"Value":true' in read_answer(line)[1]
    except OSError:
        return False


def discovered(asking: socket.socket) -> list[object]:
    """Ask all servers of this machine, and return what has come back so far."""
    asking.sendto(b"alpacadiscovery1", ("127.255.255.255", 32227))
    select.select([asking], [], [], 1.0)
    came: list[object] = []
    with contextlib.suppress(BlockingIOError):
        while True:
            came.append(json.loads(asking.recv(1024)))
    return came


def test_a_storm_of_discovery_is_answered_a_little_and_holds_nothing_up(served: Served) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking, call(served.port) as line:
        asking.bind(("127.0.0.1", 0))
        asking.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        asking.setblocking(False)
        until(lambda: {"AlpacaPort": served.port} in discovered(asking))
        # Another test's server on this machine, which is on loopback alone, hears nothing of it.
        for _ in range(5000):
            with contextlib.suppress(BlockingIOError):
                asking.sendto(b"alpacadiscovery1", ("127.0.0.2", 32227))
        assert say(line, "GET", "connected", "ClientID=1")["Value"] is True
        asking.settimeout(0.2)
        answers = 0
        try:
            while asking.recv(1024):
                answers += 1
        except TimeoutError:
            pass
        assert answers < 100


def test_a_client_that_is_gone_in_mid_slew_leaves_the_slew_to_its_end(served: Served) -> None:
    with call(served.port) as line:
        ra_h = (number_of(line, "siderealtime") - 2.5) % 24.0
        line.sendall(
            request(
                "PUT",
                "/api/v1/telescope/0/slewtocoordinates",
                f"RightAscension={ra_h}&Declination=25".encode(),
            )
        )
        with call(served.port) as other:
            until(lambda: say(other, "GET", "slewing")["Value"] is True)
    with call(served.port) as other:
        assert number_of(other, "declination") < 24.9
        until(lambda: say(other, "GET", "slewing")["Value"] is False)
        assert abs(number_of(other, "rightascension") - ra_h) < 0.001
        assert abs(number_of(other, "declination") - 25.0) < 0.01


def test_while_one_waits_for_its_slew_others_are_answered(served: Served) -> None:
    with call(served.port) as waits, call(served.port) as other:
        ra_h = (number_of(other, "siderealtime") - 3.0) % 24.0
        body = f"RightAscension={ra_h}&Declination=15".encode()
        waits.sendall(request("PUT", "/api/v1/telescope/0/slewtocoordinates", body))
        until(lambda: say(other, "GET", "slewing")["Value"] is True)
        answered = 0
        while not select.select([waits], [], [], 0.02)[0]:
            assert 0.0 <= number_of(other, "rightascension") < 24.0
            answered += 1
        assert read_answer(waits)[0] == 200
        assert answered > 5
        assert say(other, "GET", "slewing")["Value"] is False


def hammer_the_program(served: Served, requests: int, seed: int) -> int:
    """Send malformed requests to the program; return by how many kB it has grown since half of them."""
    chance, resident, sent = random.Random(seed), 0, 0
    processes = (served.process.pid, http_process(served))
    with call(served.port) as line:
        before = number_of(line, "declination")
        while sent < requests:
            method, path, query, body, statuses, _ = malformed(chance)
            if not path.isascii() or not path.isprintable() or " " in path or not method.isalpha():
                continue
            words = query.decode("latin-1")
            if not words.isascii() or not words.isprintable() or " " in words or "#" in path + words:
                continue
            target = f"{path}?{words}" if words else path
            with call(served.port) as another:
                # Who sends what is no HTTP at all is answered, and hung up on.
                another.sendall(request(method, target, body))
                status, came = read_answer(another)
            assert status in statuses | {400, 404, 405}, (method, target, body, came)
            sent += 1
            if sent == requests // 2:
                resident = sum(resident_kb(one) for one in processes)
        assert abs(number_of(line, "declination") - before) < 1e-4
        assert say(line, "GET", "slewing")["Value"] is False
    return sum(resident_kb(one) for one in processes) - resident


@pytest.mark.soak
def test_thirty_thousand_malformed_requests_on_the_wire_move_nothing_and_leave_nothing_behind(
    served: Served,
) -> None:
    assert hammer_the_program(served, 30_000, 10) < 3000


def test_malformed_requests_on_the_wire_move_nothing(served: Served) -> None:
    hammer_the_program(served, 300, 11)


def test_the_example_follows_a_satellite_by_alpaca(served: Served) -> None:
    ended = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "alpaca_client.py"), f"127.0.0.1:{served.port}"],
        capture_output=True,
        text=True,
        timeout=3 * PATIENCE_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert lines[1].startswith("following ISS (ZARYA) until 2026-10-02T13:08:48")
    assert "acquired" in lines
    told = next(line for line in lines if "arcseconds off" in line)
    assert told.startswith("tracking, ")
    assert float(told.split()[1]) < 5.0
    assert told.endswith("+0.5 s along")
    assert lines[-1] == "stopped"


def test_ctrl_c_while_a_satellite_is_followed_stops_the_mount(served: Served) -> None:
    with call(served.port) as line:
        words = json.loads(str(say(line, "PUT", "action", "Action=TrackSatellite&Parameters=25544")["Value"]))
        assert words["catalog_number"] == 25544
        refused = say(line, "PUT", "moveaxis", "Axis=0&Rate=1")
        assert refused["ErrorNumber"] == 0x40B
        assert "ISS (ZARYA)" in str(refused["ErrorMessage"])
        until(lambda: say(line, "GET", "slewing")["Value"] is False)
        served.end()
    assert served.process.returncode == 130
    assert served.log[-1] == b"sattrack: interrupted; the mount is stopped\n"


def test_passes_are_ready_before_anybody_asks_and_a_mount_stops_when_its_clients_process_is_gone() -> None:
    with serving() as alone, call(alone.port) as line:
        maps = Path(f"/proc/{http_process(alone)}/maps")
        until(lambda: "/erfa/" in maps.read_text())
        # Who asks meanwhile is answered: a pass as well, after the rest is loaded.
        say(line, "PUT", "connect")
        assert say(line, "GET", "slewing")["Value"] is False
        assert follows(say(line, "PUT", "action", "Action=TrackSatellite&Parameters=25544"))
        say(line, "PUT", "abortslew")
        until(lambda: say(line, "PUT", "moveaxis", "Axis=1&Rate=0.5")["ErrorNumber"] == 0)
        os.kill(http_process(alone), signal.SIGKILL)
        alone.process.wait(timeout=PATIENCE_S)
        alone.end()
    assert alone.process.returncode == 1
    assert b"the HTTP server's process is gone; the mount is being stopped" in alone.log[-1]


def test_the_mount_of_another_program_is_not_served_and_its_owner_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    serve_owned_mount("alpaca")
    assert f"process {os.getpid()}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--port", "70000"], "--port 70000"),
        (["--clients", "0"], "--clients 0"),
        (["--idle", "0.5"], "--idle 0.5"),
        (["--idle", "inf"], "--idle inf: 1 or more, 86400 at most"),
        (["--requests", "nan"], "--requests nan"),
        (["--requests", "inf"], "--requests inf: 1 or more, 1e+06 at most"),
        (["--allow", "nobody"], "--allow nobody"),
        (["--clock", "2026-10-02T13:00:00Zx2"], "the clients of a telescope live in real time"),
    ],
)
def test_options_that_cannot_be_are_named(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["serve", "alpaca", "--mount", "sim", *options]) == 2
    assert words in capsys.readouterr().err

"""Doors, and schedules, with a simulated Alpaca telescope as their mount: each says so, and leads it."""

from __future__ import annotations

import contextlib
import io
import re
import time
from typing import TYPE_CHECKING

import pytest
from alpaca_telescope import AlpacaTelescope, alpaca_telescope
from door_serving import call, serving_door
from programs import SITE

from sattrack import practice
from sattrack.cli import run
from sattrack.runtime.owner import owners
from tle.instants import Utc

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator
    from pathlib import Path

LEADS = (("serve", "rotctld"), ("serve", "alpaca"), ("serve", "antenna"), ("run",), ("mount", "move"))


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def telescope() -> Iterator[AlpacaTelescope]:
    with alpaca_telescope() as made:
        yield made


@pytest.mark.parametrize("command", LEADS, ids=" ".join)
def test_help_names_every_kind_of_mount_that_is_led(command: tuple[str, ...]) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as shown:
        assert run([*command, "--help"]) == 0
    words = re.sub(r"\s+", " ", shown.getvalue())
    kinds = "sim, xerxes://HOST:PORT?listen=PORT or alpaca://HOST:PORT/DEVICE; else as set."
    assert f"--mount URL {kinds}" in words


@pytest.mark.parametrize("door", ["rotctld", "alpaca", "antenna"])
@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("antenna://127.0.0.1:1", "an antenna's controller is driven by `sattrack track` alone"),
        ("serial://x", "write sim, xerxes://HOST:PORT?listen=PORT or alpaca://HOST:PORT/DEVICE"),
        ("alpaca://127.0.0.1:1/x", "'x' is no device number"),
    ],
)
def test_what_no_door_leads_to_is_refused_in_a_line(
    door: str, url: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["serve", door, "--mount", url, "--port", "0", *SITE]) == 2
    err = capsys.readouterr().err
    assert says in err
    assert err.count("\n") == 1


def by_rotctld(line: socket.socket) -> None:
    line.sendall(b"p\n")
    azimuth, altitude = (float(word) for word in line.recv(100).split())
    line.sendall(f"P {azimuth + 10.0:.3f} {altitude:.3f}\n".encode())
    assert line.recv(100) == b"RPRT 0\n"


def by_alpaca(line: socket.socket) -> None:
    put(line, "connect", b"ClientID=1")
    put(line, "moveaxis", b"Axis=1&Rate=0.5&ClientID=1")


def put(line: socket.socket, member: str, body: bytes) -> None:
    head = f"PUT /api/v1/telescope/0/{member} HTTP/1.1\r\nHost: x\r\nContent-Length: {len(body)}\r\n"
    line.sendall(f"{head}Content-Type: application/x-www-form-urlencoded\r\n\r\n".encode() + body)
    assert b'"ErrorNumber":0' in line.recv(4096)


def by_antenna(line: socket.socket) -> None:
    line.sendall(b"TD 10 20 BB\n")
    assert line.recv(100) == b"TD ACK A7\n"


@pytest.mark.parametrize(
    ("door", "more", "moved_by"),
    [
        ("rotctld", (), by_rotctld),
        ("alpaca", ("--no-discovery",), by_alpaca),
        ("antenna", (), by_antenna),
    ],
    ids=["rotctld", "alpaca", "antenna"],
)
def test_a_door_leads_an_alpaca_telescope_and_leaves_it_at_rest(
    telescope: AlpacaTelescope, door: str, more: tuple[str, ...], moved_by: object
) -> None:
    assert callable(moved_by)
    with serving_door(door, "--mount", telescope.url, *SITE, *more) as served, call(served.port) as line:
        assert telescope.url in {owner.mount for owner in owners()}
        moved_by(line)
        telescope.wait_moving(True)
        served.end()
    assert served.process.returncode == 130
    assert b"the mount is stopped" in served.log[-1]
    telescope.wait_moving(False)


def test_clients_are_told_that_an_alpaca_telescope_is_not_parked_or_sent_home_here(
    telescope: AlpacaTelescope, tmp_path: Path
) -> None:
    place = "{ hour_angle_deg = 50.0, dec_deg = 17.0 }"
    (tmp_path / "mount.toml").write_text(f"period_s = 0.1\npark = {place}\nhome = {place}\n")
    options = ("--mount", telescope.url, "--profile", "mount.toml", "--no-discovery", *SITE)
    with serving_door("alpaca", *options) as served, call(served.port) as line:
        put(line, "connect", b"ClientID=1")
        for member in (b"canpark", b"canfindhome"):
            line.sendall(b"GET /api/v1/telescope/0/%s?ClientID=1 HTTP/1.1\r\nHost: x\r\n\r\n" % member)
            assert b'"Value":false' in line.recv(4096)
    said = [one for one in served.log if b"by their own programs: clients are refused that" in one]
    assert len(said) == 1


def test_a_schedule_leaves_an_alpaca_telescope_where_it_is_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin, end = (Utc(time.time() + seconds).isoformat("milliseconds") for seconds in (-5.0, 2.0))
    (tmp_path / "night.toml").write_text(f'from = {begin}\nto = {end}\n[[passes]]\nrule = "all"\n')
    (tmp_path / "iss.tle").write_text(f"{practice.LINE_1}\n{practice.LINE_2}\n")
    (tmp_path / "mount.toml").write_text('name = "m"\npark = { hour_angle_deg = 0.0, dec_deg = 30.0 }\n')
    options = ("--mount", "alpaca://127.0.0.1:1/0", "--profile", "mount.toml", *SITE)
    assert run(["run", "night.toml", "--elements", "iss.tle", *options]) == 0
    told = capsys.readouterr()
    assert "given other rates by their own programs: the mount will be left where the last pass" in told.err
    assert "the mount is left where it is" in told.out + told.err
    assert "not parked" not in told.out + told.err

"""Doors, and schedules, with a simulated Alpaca telescope as their mount: each says so, and leads it."""

from __future__ import annotations

import contextlib
import http.client
import io
import json
import re
import time
from typing import TYPE_CHECKING

import pytest
from alpaca_telescope import AlpacaTelescope, alpaca_telescope
from programs import SITE
from serving import call, serving_program

from sattrack.cli.main import run
from sattrack.runtime import demo_pass
from sattrack.runtime.mounts import owners
from tle.instants import Utc

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any

SLOW_DEG_S = 1e-5
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
    kinds = "sim, xerxes://HOST:PORT?listen=PORT, alpaca://HOST:PORT/DEVICE or indi://HOST:PORT/DEVICE; "
    kinds += "else as set."
    assert f"--mount URL {kinds}" in words


@pytest.mark.parametrize("door", ["rotctld", "alpaca", "antenna"])
@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("antenna://127.0.0.1:1", "an antenna's controller is driven by `sattrack track` alone"),
        (
            "serial://x",
            "write sim, xerxes://HOST:PORT?listen=PORT, alpaca://HOST:PORT/DEVICE or indi://HOST:PORT/DEVICE",
        ),
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


def by_antenna(line: socket.socket) -> None:
    line.sendall(b"TD 10 20 BB\n")
    assert line.recv(100) == b"TD ACK A7\n"


@pytest.mark.parametrize(
    ("door", "moved_by"), [("rotctld", by_rotctld), ("antenna", by_antenna)], ids=["rotctld", "antenna"]
)
def test_a_door_leads_an_alpaca_telescope_and_leaves_it_at_rest(
    telescope: AlpacaTelescope, door: str, moved_by: object
) -> None:
    assert callable(moved_by)
    with serving_program(door, "--mount", telescope.url, *SITE) as served, call(served.port) as line:
        assert telescope.url in {owner.mount for owner in owners()}
        moved_by(line)
        telescope.wait_moving(True)
        served.end()
    assert served.process.returncode == 130
    assert b"the mount is stopped" in served.log[-1]
    telescope.wait_moving(False)


ABSENT, INVALID_VALUE, NOT_NOW = 0x400, 0x401, 0x40B
DIRECTED = ("SyncToCoordinates", "SlewToCoordinates", "SlewToCoordinatesAsync")
REFUSED = (
    *(("PUT", member, f"{member}=1") for member in ("DeclinationRate", "RightAscensionRate")),
    *(
        ("GET", member, "")
        for member in ("IsPulseGuiding", "GuideRateDeclination", "GuideRateRightAscension")
    ),
    ("PUT", "PulseGuide", "Direction=0&Duration=100"),
    *(("PUT", member, "RightAscension=1&Declination=20") for member in DIRECTED),
    *(("PUT", member, "") for member in ("SyncToTarget", "SlewToTarget", "SlewToTargetAsync")),
    *(("PUT", member, "") for member in ("Park", "FindHome", "SetPark", "Unpark")),
    ("PUT", "Tracking", "Tracking=true"),
)
FALSE = (
    *("CanPark", "CanFindHome", "CanPulseGuide", "CanSync", "CanSlew", "CanSlewAsync", "CanSetGuideRates"),
    *("CanSetDeclinationRate", "CanSetRightAscensionRate", "CanSetTracking", "CanSetPark", "CanUnpark"),
)


def said_by(port: int, method: str, member: str, fields: str = "") -> tuple[int, Any]:
    """Return the error number and the value that a member of the door answers with."""
    path, told = f"/api/v1/telescope/0/{member.lower()}", f"{fields}&ClientID=1".lstrip("&")
    line = http.client.HTTPConnection("127.0.0.1", port)
    with contextlib.closing(line):
        if method == "GET":
            line.request("GET", f"{path}?{told}")
        else:
            line.request("PUT", path, told, {"Content-Type": "application/x-www-form-urlencoded"})
        answer = json.loads(line.getresponse().read())
    return answer["ErrorNumber"], answer.get("Value")


def test_what_an_alpaca_telescope_does_not_do_is_not_offered_to_clients_and_named_at_the_start(
    tmp_path: Path,
) -> None:
    place = "{ hour_angle_deg = 50.0, dec_deg = 17.0 }"
    (tmp_path / "mount.toml").write_text(
        f"period_s = 0.1\nadditive = false\npark = {place}\nhome = {place}\n"
    )
    lacks = {"can_slew": False, "can_sync": False, "rates_deg_s": [[0.0, 0.3], [0.5, 2.0]]}
    with alpaca_telescope(**lacks) as telescope:
        options = ("--mount", telescope.url, "--profile", "mount.toml", "--no-discovery", *SITE)
        with serving_program("alpaca", *options) as served:
            port = served.port
            before = dict(telescope.state()["requests"])
            assert said_by(port, "PUT", "Connect") == (0, None)
            assert {member: said_by(port, "GET", member) for member in FALSE} == dict.fromkeys(
                FALSE, (0, False)
            )
            answers = {(method, name): said_by(port, method, name, more)[0] for method, name, more in REFUSED}
            assert answers == {(method, name): ABSENT for method, name, _ in REFUSED}
            for member in ("DeclinationRate", "RightAscensionRate"):
                assert said_by(port, "GET", member) == (0, 0.0)
            _, state = said_by(port, "GET", "DeviceState")
            assert "IsPulseGuiding" not in {one["Name"] for one in state}
            assert said_by(port, "GET", "AxisRates", "Axis=1") == (
                0,
                [{"Minimum": 0.0, "Maximum": 0.3}, {"Minimum": 0.5, "Maximum": 2.0}],
            )
            for rate in ("0.4", "-0.4", "2.001", "3"):
                assert said_by(port, "PUT", "MoveAxis", f"Axis=1&Rate={rate}")[0] == INVALID_VALUE
            told = {name for name in set(telescope.state()["requests"]) - set(before) if name[:3] == "PUT"}
            assert told == set()
    (said,) = [one for one in served.log if b"clients are refused that" in one]
    assert b"parked, sent home and given other rates by their own programs" in said
    assert b"and this one has no slews or sync or guide pulses" in said


def test_what_clients_are_offered_on_an_alpaca_telescope_it_does_and_is_left_at_rest() -> None:
    guide_rate_deg_s = 0.0042
    with (
        alpaca_telescope(guide_rate_deg_s=guide_rate_deg_s, rates_deg_s=[[0.0, 2.0]]) as telescope,
        serving_program("alpaca", "--mount", telescope.url, "--no-discovery", *SITE) as served,
    ):
        port = served.port
        assert said_by(port, "PUT", "Connect") == (0, None)
        for member in ("CanPulseGuide", "CanSync", "CanSlew", "CanSlewAsync", "Tracking"):
            assert said_by(port, "GET", member) == (0, True)
        for axis in ("RightAscension", "Declination"):
            number, rate = said_by(port, "GET", f"GuideRate{axis}")
            assert (number, rate) == (0, pytest.approx(guide_rate_deg_s))
        for direction, east, north in ((0, 0.0, 1.0), (1, 0.0, -1.0), (2, 1.0, 0.0), (3, -1.0, 0.0)):
            _, ra_deg, dec_deg = telescope.truth()[-1]
            assert said_by(port, "PUT", "PulseGuide", f"Direction={direction}&Duration=700") == (0, None)
            assert said_by(port, "GET", "IsPulseGuiding") == (0, True)
            assert said_by(port, "PUT", "PulseGuide", f"Direction={direction}&Duration=700")[0] == NOT_NOW
            while said_by(port, "GET", "IsPulseGuiding") == (0, True):
                assert said_by(port, "GET", "Slewing") == (0, False)
                time.sleep(0.05)
            telescope.wait(lambda: telescope.speed_deg_s() < SLOW_DEG_S)
            _, ra_after_deg, dec_after_deg = telescope.truth()[-1]
            way_deg = 0.7 * guide_rate_deg_s
            assert ra_after_deg - ra_deg == pytest.approx(east * way_deg, abs=0.01 * way_deg)
            assert dec_after_deg - dec_deg == pytest.approx(north * way_deg, abs=0.01 * way_deg)
        _, ra_deg, dec_deg = telescope.truth()[-1]
        ra_h = (ra_deg / 15.0 + 0.05) % 24.0
        where = f"RightAscension={ra_h!r}&Declination={dec_deg + 0.5!r}"
        assert said_by(port, "PUT", "SyncToCoordinates", where) == (0, None)
        assert telescope.truth()[-1][1:] == pytest.approx((ra_h * 15.0, dec_deg + 0.5), abs=1e-4)
        ra_h = (ra_h + 0.1) % 24.0
        where = f"RightAscension={ra_h!r}&Declination={dec_deg + 1.5!r}"
        assert said_by(port, "PUT", "SlewToCoordinates", where) == (0, None)
        assert telescope.truth()[-1][1:] == pytest.approx((ra_h * 15.0, dec_deg + 1.5), abs=1e-3)
        # The profile would have axes turn at 4 °/s, and the driver bears 2 °/s.
        assert said_by(port, "GET", "AxisRates", "Axis=1") == (0, [{"Minimum": 0.0, "Maximum": 2.0}])
        assert said_by(port, "PUT", "MoveAxis", "Axis=1&Rate=2") == (0, None)
        telescope.wait(lambda: telescope.speed_deg_s() == pytest.approx(2.0, rel=1e-3))
        assert said_by(port, "PUT", "AbortSlew") == (0, None)
        telescope.wait_moving(False)
        assert said_by(port, "GET", "DriverInfo")[1].endswith(", ASCOM Alpaca")
        assert telescope.url in {owner.mount for owner in owners()}
        # The stop may be seen through by then, or not yet.
        telescope.wait(lambda: said_by(port, "PUT", "MoveAxis", "Axis=1&Rate=0.5") == (0, None))
        telescope.wait_moving(True)
        served.end()
        assert served.process.returncode == 130
        assert b"the mount is stopped" in served.log[-1]
        telescope.wait_moving(False)
    (said,) = [one for one in served.log if b"clients are refused that" in one]
    assert b"by their own programs: clients" in said


def test_a_schedule_leaves_an_alpaca_telescope_where_it_is_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin, end = (Utc(time.time() + seconds).isoformat("milliseconds") for seconds in (-5.0, 2.0))
    (tmp_path / "night.toml").write_text(f'from = {begin}\nto = {end}\n[[passes]]\nrule = "all"\n')
    (tmp_path / "iss.tle").write_text(f"{demo_pass.LINE_1}\n{demo_pass.LINE_2}\n")
    (tmp_path / "mount.toml").write_text('name = "m"\npark = { hour_angle_deg = 0.0, dec_deg = 30.0 }\n')
    options = ("--mount", "alpaca://127.0.0.1:1/0", "--profile", "mount.toml", *SITE)
    assert run(["run", "night.toml", "--elements", "iss.tle", *options]) == 0
    told = capsys.readouterr()
    assert "given other rates by their own programs: the mount will be left where the last pass" in told.err
    assert "the mount is left where it is" in told.out + told.err
    assert "not parked" not in told.out + told.err

"""`sattrack serve antenna` as a program, with `track --mount antenna:...`'s own loop at the other end."""

from __future__ import annotations

import json
import math
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from antenna_setup import SITE
from programs import free_port

from sattrack.cli.main import run
from sattrack.control.tracker import TrackPlan
from sattrack.core.errors import BadInputError, LinkLostError, SafetyLimitError
from sattrack.runtime.system import StopRequest
from sattrack.safety import SafetyLimits
from sattrack.safety.bodies import sun_over
from sattrack.servers.antenna.serve import parse_antenna_url
from sattrack.servers.antenna.track import AntennaFlight, AntennaPass, check_bodies
from tle.bias import NO_BIAS
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.servers.antenna.antcn import AntcnRun

pytestmark = pytest.mark.filterwarnings("ignore::tle.errors.EarthOrientationWarning")
PATIENCE_S = 60.0
QUIET_S = 0.3
STAMP = rb"20[0-9]{2}\.[0-3][0-9]{2}\.[0-2][0-9]:[0-5][0-9]:[0-6][0-9]\.[0-9]{2}"
ISS = str(Path(__file__).resolve().parents[4] / "examples" / "iss_leiden.tle")
WHERE = f"{SITE.latitude_deg},{SITE.longitude_deg},0"


def stays_in_place(now: Utc, hour_angle_deg: float) -> Elements:
    """Return elements of a satellite that seems to stand still over the equator."""
    sidereal = EarthOrientation.installed().local_apparent_sidereal_deg(now, Site(0.0, SITE.longitude_deg))
    return Elements(
        name="STAYS",
        catalog_number=99001,
        classification="U",
        designator="2026-001A",
        epoch=now,
        inclination_deg=0.05,
        raan_deg=0.0,
        eccentricity=0.0001,
        arg_perigee_deg=0.0,
        mean_anomaly_deg=(float(sidereal) - hour_angle_deg) % 360.0,
        mean_motion_rev_day=1.00273791,
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=0.0,
    )


def make_pass(url: str) -> AntennaPass:
    now_s = float(int(time.time()))
    propagator = Propagator(stays_in_place(Utc(now_s), 44.0), SITE)
    return AntennaPass(
        parse_antenna_url(url), propagator, NO_BIAS, TrackPlan(now_s - 1.0, now_s + 600.0), 30.0
    )


def of_a_radio_dish(folder: Path) -> tuple[str, str]:
    """Settings of an antenna that may look at the Sun, wherever that stands when the test runs."""
    settings = folder / "radio.toml"
    settings.write_text("[safety]\noptical = false\n")
    return "--config", str(settings)


@contextmanager
def serving(*options: str) -> Iterator[tuple[subprocess.Popen[bytes], dict[str, object]]]:
    command = [sys.executable, "-m", "sattrack", "serve", "antenna", "--mount", "sim", "--site", WHERE]
    process = subprocess.Popen(
        [*command, "--json", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    try:
        readable, _, _ = select.select([process.stdout], [], [], PATIENCE_S)
        assert readable, "it did not start"
        yield process, json.loads(process.stdout.readline())
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=PATIENCE_S)


def follow_for_a_while(ready: AntennaPass) -> AntennaFlight:
    stop = StopRequest()
    deadline_s = time.monotonic() + PATIENCE_S

    def watch(run: AntcnRun, _: float) -> None:
        if run.on_target_s > 0.5 or time.monotonic() > deadline_s:
            stop.ask()

    flight = AntennaFlight(ready, stop, watch)
    summary = flight.fly()
    assert summary.ended_by == "operator"
    assert summary.on_target_s > 0.5
    assert summary.mount_stopped
    assert summary.datagrams.lost == 0
    assert summary.reported_rms_arcsec is not None
    assert summary.reported_rms_arcsec < 15.0
    return flight


def test_a_satellite_is_followed_over_tcp_and_what_breaks_while_showing_stops_the_antenna(
    tmp_path: Path,
) -> None:
    def show(run: AntcnRun, _: float) -> None:
        if run.designated > 2:
            raise BrokenPipeError("nobody reads")

    with serving("--port", "0", *of_a_radio_dish(tmp_path)) as (process, told):
        url = f"antenna://127.0.0.1:{told['listening']}"
        # What breaks while showing stops the antenna, and the next run finds it free.
        summary = AntennaFlight(make_pass(url), StopRequest(), show).fly()
        assert (summary.ended_by, summary.message) == ("error", "nobody reads")
        assert summary.mount_stopped
        flight = follow_for_a_while(make_pass(url))
        assert flight.warnings() == []
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert b"the mount is stopped" in err
    assert b"antcn is gone" in err


def test_a_satellite_is_followed_over_a_serial_line(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    ends = [pty.openpty(), pty.openpty()]
    for master, _ in ends:
        tty.setraw(master)
    names = [os.ttyname(slave) for _, slave in ends]
    over = threading.Event()

    def join() -> None:
        masters = [master for master, _ in ends]
        while not over.is_set():
            for source in select.select(masters, [], [], 0.1)[0]:
                os.write(masters[1 - masters.index(source)], os.read(source, 4096))

    wire = threading.Thread(target=join)
    wire.start()
    try:
        with serving("--serial", names[0], "--baud", "115200", "--crc", *of_a_radio_dish(tmp_path)):
            follow_for_a_while(make_pass(f"antenna://{names[1]}?baud=115200&check=crc&rate=5"))
    finally:
        over.set()
        wire.join()
        for end in ends:
            for descriptor in end:
                os.close(descriptor)


def test_the_operator_at_the_controller_switches_to_local_and_reads_the_last_lines() -> None:
    with serving("--port", "0") as (process, told):
        assert process.stdin is not None
        assert process.stderr is not None
        with socket.create_connection(("127.0.0.1", int(str(told["listening"])))) as antcn:
            antcn.settimeout(PATIENCE_S)
            antcn.sendall(b"TD 10 20 BB\n")
            assert antcn.recv(100) == b"TD ACK A7\n"
            assert not select.select([antcn], [], [], QUIET_S)[0], "something came unasked"
            process.stdin.write(b"local\n")
            process.stdin.flush()
            for words in (b";local\n", b"#antenna#the controller is in local\n"):
                while not re.fullmatch(STAMP + words, process.stderr.readline()):
                    pass
            antcn.sendall(b"STOP 66\n")
            assert antcn.recv(100) == b"STOP NAK 8 B8\n"
            error = process.stderr.readline()
            assert re.fullmatch(STAMP + rb"\?ERROR AN   -8 the controller is in local[^:]*: STOP\n", error)
            process.stdin.write(b"last\n")
            process.stdin.flush()
            while b"STOP -> STOP NAK 8" not in process.stderr.readline():
                pass
            assert not select.select([antcn], [], [], 0.0)[0], "something came unasked"
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130


def test_the_log_says_which_limit_keeps_the_antenna_off_its_trajectory() -> None:
    noon = "2026-10-02T11:30:00Z"
    sun = sun_over(SITE.latitude_deg, SITE.longitude_deg).at(float(Utc.parse(noon).unix_s))
    with serving("--port", "0", "--clock", noon) as (process, told):
        assert process.stderr is not None
        with socket.create_connection(("127.0.0.1", int(str(told["listening"])))) as antcn:
            antcn.settimeout(PATIENCE_S)
            message = f"FIXED {math.remainder(sun.hour_angle_deg, 360.0):.4f} {sun.dec_deg:.4f} "
            antcn.sendall(f"{message}{sum(message.encode()) % 256:02X}\n".encode())
            assert antcn.recv(100).startswith(b"FIXED ACK")
            while b"keeps the antenna off its trajectory: sun" not in (line := process.stderr.readline()):
                assert line, "it ended without a word"
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("--port", "70000"), 2, "ports run to 65535"),
        (("--stow", "10"), 2, "write two positions"),
        (("--clock", "2026-10-02T13:00:00Zx10"), 2, "give no speed"),
        (("--stream", "--console"), 2, "give either"),
        (("--service", "10,95"), 2, "the second to 89.9"),
        (("--serial", "/dev/nowhere"), 1, "cannot be opened"),
        (("--serial", "/dev/null", "--framing", "9X3"), 2, "7E1 or 8N1"),
        (("--mount", "antenna://there:1"), 2, "sattrack track"),
        (("--focus", "4"), 2, "up to 3 axes"),
        (("--focus", "alpaca://there/0"), 2, "write a number, or alpaca://HOST:PORT/DEVICE"),
        (
            ("--focus", "1", "--focus", "alpaca://there:1/0"),
            2,
            "write a number, or alpaca://HOST:PORT/DEVICE",
        ),
        (("--focus", "alpaca://a:1/0") * 4, 2, "up to 3 axes, and 4 were given"),
    ],
)
def test_what_cannot_be_served_is_told(
    arguments: tuple[str, ...], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if "--serial" in arguments:
        pytest.importorskip("serial")
    options = arguments if "--mount" in arguments else ("--mount", "sim", *arguments)
    assert run(["serve", "antenna", *options]) == code
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("antenna:", "write antenna://HOST:PORT"),
        ("antenna://host", "write antenna://HOST:PORT"),
        ("antenna://host:99999", "out of range"),
        ("antenna://host:5000?colour=red", "colour is not understood"),
        ("antenna://host:5000?axes=xy", "axes is 'xy'"),
        ("antenna://host:5000?rate=0", "rate is '0'"),
        ("antenna://host:5000?rate=fast", "rate is 'fast'"),
        ("antenna://host:5000?baud=9600", "serial lines"),
        ("antenna:///dev/ttyUSB0?baud=1200", "baud is '1200'"),
    ],
)
def test_an_antenna_that_cannot_be_meant(url: str, says: str) -> None:

    with pytest.raises(BadInputError, match=f"(?s).*{says}"):
        parse_antenna_url(url)


def test_addresses_say_how_the_line_is_spoken_to() -> None:
    there = parse_antenna_url("antenna://mount.example:5000?axes=azel&rate=2&check=crc")
    assert (there.host, there.port, there.axes, there.interval_s) == ("mount.example", 5000, "azel", 0.5)
    line = parse_antenna_url("antenna:///dev/ttyUSB0?baud=19200&framing=8N1")
    assert (line.device, line.baud, line.framing) == ("/dev/ttyUSB0", 19200, "8N1")
    assert line.character_s == pytest.approx(3 * 10 / 19200)


def test_no_controller_is_a_lost_link() -> None:
    flight = AntennaFlight(make_pass(f"antenna://127.0.0.1:{free_port()}"), StopRequest(), lambda *_: None)

    with pytest.raises(LinkLostError, match="no antenna controller"):
        flight.fly()


def test_a_pass_too_near_to_the_sun_is_not_begun() -> None:
    noon = Utc.parse("2026-10-02T11:30:00Z")
    there = sun_over(SITE.latitude_deg, SITE.longitude_deg).at(float(noon.unix_s))
    plan = TrackPlan(float(noon.unix_s), float(noon.unix_s) + 60.0)
    url = parse_antenna_url("antenna://127.0.0.1:1")
    near = AntennaPass(url, Propagator(stays_in_place(noon, there.hour_angle_deg), SITE), NO_BIAS, plan, 30.0)
    far = AntennaPass(
        url, Propagator(stays_in_place(noon, there.hour_angle_deg - 30.0), SITE), NO_BIAS, plan, 30.0
    )
    with pytest.raises(SafetyLimitError, match="of the Sun"):
        check_bodies(near, SafetyLimits(), SITE)
    check_bodies(near, SafetyLimits(optical=False), SITE)
    check_bodies(far, SafetyLimits(), SITE)


@pytest.mark.parametrize(
    ("option", "says"),
    [
        (("--virtual",), "--virtual does not go"),
        (("--record", "x.mcap"), "--record does not go"),
        (("--stream",), "--stream does not work"),
        (("--clock", "2026-10-02T13:00:00Z"), "--clock is for simulated mounts"),
    ],
)
def test_what_does_not_go_with_an_antenna_is_told(
    option: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["track", "ISS", "--mount", "antenna://127.0.0.1:1", "--elements", ISS, "--site", WHERE]
    assert run([*arguments, *option]) == 2
    assert says in capsys.readouterr().err

"""INDI telescopes as mounts, judged by INDI's own drivers; and messages as they stand in its paper."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import select
import signal
import socket
import socketserver
import struct
import subprocess
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import erfa
import pytest
from indi_programs import Indi, indi_server
from programs import ended, sattrack
from serving import PATIENCE_S, WHERE, until

from sattrack.cli.main import run
from sattrack.core.errors import BadInputError
from sattrack.mount.alpaca.client import AlpacaRefusalError, NoAnswerError
from sattrack.mount.alpaca.link import AlpacaAddress, open_gateway, parse_alpaca
from sattrack.mount.indi import client as indi_client
from sattrack.mount.indi.client import IndiClient, IndiDevice
from sattrack.mount.indi.numbers import read_number
from sattrack.mount.indi.telescope import IndiTelescope

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NAME = "Telescope Simulator"
GATEWAY = b"sattrack.mount.alpaca.gateway_process"
SAME_DEG = 0.001
POLL_S = 0.3
"""Longer than the driver takes to look at its axes once more: before that, it tells what it told."""
RESTS_DEG = 0.02
"""What sidereal tracking that is off, and the program's own time, may move a place that is read twice."""
DEFINITIONS = b"""
<defSwitchVector device="T" name="CONNECTION" state="Ok" perm="rw" rule="OneOfMany">
<defSwitch name="CONNECT">On</defSwitch><defSwitch name="DISCONNECT">Off</defSwitch></defSwitchVector>
<defNumberVector device="T" name="EQUATORIAL_EOD_COORD" state="Idle" perm="rw">
<defNumber name="RA" format="%010.6m" min="0" max="24" step="0">
6.5
</defNumber>
<defNumber name="DEC" format="%010.6m" min="-90" max="90" step="0">
-12.25
</defNumber></defNumberVector>
<defSwitchVector device="T" name="TELESCOPE_ABORT_MOTION" state="Idle" perm="rw" rule="AtMostOne">
<defSwitch name="ABORT">Off</defSwitch></defSwitchVector>
<defSwitchVector device="T" name="TELESCOPE_TRACK_MODE" state="Idle" perm="rw" rule="OneOfMany">
<defSwitch name="TRACK_SIDEREAL">On</defSwitch>
<defSwitch name="TRACK_CUSTOM">Off</defSwitch></defSwitchVector>
<defNumberVector device="T" name="TELESCOPE_TRACK_RATE" state="Idle" perm="rw">
<defNumber name="TRACK_RATE_RA" format="%.6f" min="-7200" max="7200" step="1">15.04</defNumber>
<defNumber name="TRACK_RATE_DE" format="%.6f" min="-3600" max="3600" step="1">0</defNumber></defNumberVector>
<defSwitchVector device="T" name="TELESCOPE_TRACK_STATE" state="Idle" perm="rw" rule="OneOfMany">
<defSwitch name="TRACK_ON">Off</defSwitch><defSwitch name="TRACK_OFF">On</defSwitch></defSwitchVector>
<setNumberVector device="Dome" name="EQUATORIAL_EOD_COORD">
<oneNumber name="RA">1</oneNumber></setNumberVector>
"""
CONNECTED = b"""<setSwitchVector device="T" name="CONNECTION" state="Ok">
<oneSwitch name="CONNECT">%s</oneSwitch></setSwitchVector>"""

POLLING = b"""<defNumberVector device="T" name="POLLING_PERIOD" state="Idle" perm="rw">
<defNumber name="PERIOD_MS" format="%.f" min="500" max="60000" step="1">1000</defNumber></defNumberVector>"""
POLLING_REFUSED = b"""<setNumberVector device="T" name="POLLING_PERIOD" state="Alert" message="out of range">
<oneNumber name="PERIOD_MS">1000</oneNumber></setNumberVector>"""


class Driver(socketserver.ThreadingTCPServer):
    """A server with one driver, as INDI's paper has them: it defines what it has, and notes what is set."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _DriversLine)
        self.place_state = b"Ok"
        self.more = b""
        """Definitions that it has besides."""
        self.noted: list[tuple[str, dict[str, str]]] = []
        self.lines: list[socket.socket] = []
        self.plugged = threading.Event()
        """Cleared, nothing passes either way on any of its lines."""
        self.plugged.set()

    def say(self, message: bytes) -> None:
        """Send a message of the driver's own."""
        self.lines[-1].sendall(message)

    @property
    def address(self) -> AlpacaAddress:
        return AlpacaAddress("127.0.0.1", self.server_address[1], "T")


class _DriversLine(socketserver.StreamRequestHandler):
    server: Driver
    rbufsize = 0

    def handle(self) -> None:
        self.server.lines.append(self.connection)
        for line in self._lines():
            with contextlib.suppress(ConnectionError):
                self._take(ElementTree.fromstring(line))

    def _take(self, message: ElementTree.Element) -> None:
        name = message.get("name", "")
        if message.tag == "getProperties":
            place = b'EQUATORIAL_EOD_COORD" state="'
            found = DEFINITIONS.replace(place + b"Idle", place + self.server.place_state)
            self.wfile.write(found + self.server.more)
        else:
            values = {one.get("name", ""): one.text or "" for one in message}
            self.server.noted.append((name, values))
            if name == "CONNECTION":
                self.wfile.write(CONNECTED % b"On")
            if name == "POLLING_PERIOD":
                self.wfile.write(POLLING_REFUSED)

    def _lines(self) -> Iterator[bytes]:
        """Lines as they come; those of a time without a cable once it is back, but none of a reset line."""
        with contextlib.suppress(ConnectionResetError):
            while select.select([self.connection], [], []):
                self.server.plugged.wait()
                come = [self.rfile.readline()]
                while come[-1] and select.select([self.connection], [], [], 0.0)[0]:
                    come.append(self.rfile.readline())
                yield from filter(None, come)
                if not come[-1]:
                    return


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Iterator[Driver]:
    monkeypatch.setattr(indi_client, "SETTLED_WITHIN_S", 0.05)
    with Driver() as made:
        threading.Thread(target=made.serve_forever, daemon=True).start()
        yield made
        made.shutdown()


def telescope(pieces: int = 10_000) -> IndiTelescope:
    made = IndiTelescope("T")
    for i in range(0, len(DEFINITIONS), pieces):
        made.feed(DEFINITIONS[i : i + pieces])
    return made


def settings(made: IndiTelescope, member: str, **fields: str) -> list[tuple[str, dict[str, str]]]:
    """What is sent for an order, as INDI's messages say it."""
    found = []
    for one in made.settings(member, fields):
        element = ElementTree.fromstring(made.message_of(one))
        assert element.get("device") == "T"
        found.append((element.get("name", ""), {each.get("name", ""): each.text or "" for each in element}))
    return found


@pytest.mark.parametrize("pieces", [1, 7, 10_000])
def test_properties_are_read_from_any_pieces_and_other_devices_left_alone(pieces: int) -> None:
    made = telescope(pieces)
    assert made.ready
    assert (made.value("rightascension"), made.value("declination")) == (6.5, -12.25)
    assert made.value("slewing") is False
    assert made.value("tracking") is False
    facts = made.facts()
    # 7200 and 3600 arcseconds a second.
    assert (facts.fastest_deg_s(0), facts.fastest_deg_s(1)) == (2.0, 1.0)
    assert (facts.can_slew, facts.can_pulse_guide, facts.objection()) == (False, False, None)
    made.feed(
        b'<setNumberVector device="T" name="EQUATORIAL_EOD_COORD" state="Busy">'
        b'<oneNumber name="RA">7</oneNumber></setNumberVector>'
    )
    assert (made.value("rightascension"), made.value("declination")) == (7.0, -12.25)
    assert made.value("slewing") is True
    made.feed(b'<delProperty device="T"/>')
    with pytest.raises(AlpacaRefusalError, match="not connected"):
        made.value("rightascension")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-10:30:18", -10.505),
        ("-10;30;18", -10.505),
        ("-10 30.3", -10.505),
        ("-0:30", -0.5),
        ("10:", 10.0),
        (".5", 0.5),
        ("+7.", 7.0),
        # As C's %.20g writes what is small.
        ("1.0000000000000000818e-05", 1e-5),
        ("-2.5E+01", -25.0),
        ("1e999", None),
        ("nan", None),
        ("1e-05:30", None),
        ("1:2:3:4", None),
        ("12,5", None),
        ("\u0661", None),
        ("", None),
        (None, None),
    ],
)
def test_numbers_are_read_in_each_form_that_indi_has(text: str | None, value: float | None) -> None:
    number = read_number(text)
    assert number == (value if value is None else pytest.approx(value, rel=1e-15))


def test_a_place_that_a_driver_sends_in_sexagesimal_is_a_place() -> None:
    made = telescope()
    made.feed(
        b'<setNumberVector device="T" name="EQUATORIAL_EOD_COORD" state="Ok">'
        b'<oneNumber name="RA">6:30:00</oneNumber><oneNumber name="DEC">-12;15</oneNumber></setNumberVector>'
    )
    assert (made.value("rightascension"), made.value("declination")) == (6.5, -12.25)


def test_a_place_in_alert_is_no_new_one(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a driver of libindi repeats the last one that cannot read its telescope."""
    monkeypatch.setattr(indi_client, "ANSWER_WITHIN_S", 0.3)

    async def read() -> None:
        async with IndiClient(driver.address) as client:
            await client.connect()
            assert (await client.read()).ra[1] == 6.5
            driver.place_state = b"Alert"
            for _ in range(3):
                with pytest.raises(NoAnswerError, match="no place came"):
                    await client.read()
            driver.place_state = b"Ok"
            assert (await client.read()).ra[1] == 6.5

    asyncio.run(read())
    device = IndiDevice(driver.address.host, driver.address.port, "T", 0.3)
    assert device.get("rightascension") == 6.5
    driver.place_state = b"Alert"
    with pytest.raises(NoAnswerError, match="nothing came"):
        device.get("rightascension")
    device._close()


def test_a_server_that_drops_its_client_is_connected_again_and_stopped(driver: Driver) -> None:
    async def lose_and_stop() -> None:
        async with IndiClient(driver.address) as client:
            await client.connect()
            await client.put("moveaxis", ("Axis", "0"), ("Rate", "0.1"))
            await client.put("moveaxis", ("Axis", "1"), ("Rate", "0.2"))
            assert (await client.read()).ra[1] == 6.5
            driver.lines[0].shutdown(socket.SHUT_RDWR)
            with pytest.raises(NoAnswerError, match="closed the connection"):
                await client.read()
            with pytest.raises(NoAnswerError, match="closed the connection"):
                await client.put("abortslew")
            assert (await client.read()).ra[1] == 6.5
            # The driver turns its axes as it did: declination's rate goes with another one of the first axis.
            await client.put("moveaxis", ("Axis", "0"), ("Rate", "0.15"))
            assert driver.noted[-2][1] == {"TRACK_RATE_RA": "540.000000", "TRACK_RATE_DE": "720.000000"}
            await client.put("abortslew")
            assert driver.noted[-1] == ("TELESCOPE_ABORT_MOTION", {"ABORT": "On"})
            await client.read()

    asyncio.run(lose_and_stop())
    assert len(driver.lines) == 2


def test_a_cable_that_is_plugged_in_again_carries_a_new_connection_and_nothing_old(
    driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """TCP waits for minutes, and then sends what it has kept: rates, after a stop."""
    monkeypatch.setattr(indi_client, "ANSWER_WITHIN_S", 0.5)
    monkeypatch.setattr(indi_client, "FOUND_WITHIN_S", 0.5)

    async def pull_and_plug_in() -> None:
        async with IndiClient(driver.address) as client:
            await client.connect()
            await client.read()
            driver.plugged.clear()
            await client.put("moveaxis", ("Axis", "1"), ("Rate", "0.2"))
            with pytest.raises(NoAnswerError, match="nothing came within"):
                await client.read()
            with pytest.raises(NoAnswerError, match="nothing came within"):
                await client.put("abortslew")
            for _ in range(2):
                with pytest.raises(NoAnswerError, match="no device 'T' there"):
                    await client.read()
            driver.plugged.set()
            assert (await client.read()).ra[1] == 6.5
            await client.put("abortslew")
            await client.read()

    asyncio.run(pull_and_plug_in())
    assert driver.noted == [("TELESCOPE_ABORT_MOTION", {"ABORT": "On"})]
    device = IndiDevice(driver.address.host, driver.address.port, "T", 0.5)
    assert device.get("rightascension") == 6.5
    driver.plugged.clear()
    device.put("moveaxis", Axis="1", Rate="0.2")
    with pytest.raises(NoAnswerError, match="nothing came within"):
        device.get("rightascension")
    driver.plugged.set()
    assert device.get("rightascension") == 6.5
    device.put("abortslew")
    assert device.get("rightascension") == 6.5
    assert driver.noted[1:] == [("TELESCOPE_ABORT_MOTION", {"ABORT": "On"})]
    device._close()


def test_a_driver_that_does_not_look_as_often_as_asked_is_refused_with_its_reason_but_stopped(
    driver: Driver,
) -> None:
    driver.more = POLLING

    async def stop(address: AlpacaAddress) -> None:
        async with IndiClient(address) as client:
            await client.connect()
            await client.put("abortslew")

    with pytest.raises(AlpacaRefusalError, match=r"out of range: it does not look 10 times .* lower \?hz="):
        asyncio.run(stop(driver.address))
    asyncio.run(stop(driver.address.to_stop()))
    assert driver.noted[-1] == ("TELESCOPE_ABORT_MOTION", {"ABORT": "On"})


def test_a_telescope_that_somebody_disconnects_from_its_driver_is_connected_again(driver: Driver) -> None:
    async def disconnect() -> None:
        async with IndiClient(driver.address) as client:
            await client.connect()
            driver.say(CONNECTED % b"Off")
            assert await client._until(lambda: client.telescope.connected is False, PATIENCE_S)
            assert (await client.read()).ra[1] == 6.5

    asyncio.run(disconnect())
    assert driver.noted == [("CONNECTION", {"CONNECT": "On"})]


def stop() -> bytes:
    """A stop's 82 bytes by the paper's table: the header, and the abort's flag."""
    data = bytearray(82)
    struct.pack_into("<Q", data, 0, 0x5555AAAA)
    data[73] = 0xFF
    return bytes(data)


def test_a_driver_that_cannot_read_its_telescope_is_stopped_and_not_heard(driver: Driver) -> None:
    driver.place_state = b"Alert"
    link = open_gateway(driver.address.to_stop())
    try:
        link.send(stop())
        until(lambda: ("TELESCOPE_ABORT_MOTION", {"ABORT": "On"}) in driver.noted)
        assert link.receive() == []
        driver.place_state = b"Ok"
        until(lambda: bool(link.receive()))
    finally:
        link.close()


def test_what_is_no_indi_is_told() -> None:
    with pytest.raises(NoAnswerError, match="no INDI"):
        telescope().feed(b"HTTP/1.1 400 Bad Request\r\n\r\n<>")


def test_rates_of_axes_are_rates_of_tracking_and_none_gives_sidereal_tracking_back() -> None:
    made = telescope()
    # A degree a second westward; declination stands.
    assert settings(made, "moveaxis", Axis="0", Rate="1.0") == [
        ("TELESCOPE_TRACK_RATE", {"TRACK_RATE_RA": "3600.000000", "TRACK_RATE_DE": "0.000000"}),
        ("TELESCOPE_TRACK_MODE", {"TRACK_CUSTOM": "On"}),
    ]
    assert settings(made, "moveaxis", Axis="1", Rate="-0.5")[0] == (
        "TELESCOPE_TRACK_RATE",
        {"TRACK_RATE_RA": "3600.000000", "TRACK_RATE_DE": "-1800.000000"},
    )
    settings(made, "moveaxis", Axis="0", Rate="0")
    assert settings(made, "moveaxis", Axis="1", Rate="0") == [
        ("TELESCOPE_TRACK_RATE", {"TRACK_RATE_RA": "15.041067", "TRACK_RATE_DE": "0.000000"}),
        ("TELESCOPE_TRACK_MODE", {"TRACK_SIDEREAL": "On"}),
    ]
    assert settings(made, "abortslew") == [("TELESCOPE_ABORT_MOTION", {"ABORT": "On"})]


def test_a_rate_that_is_nearly_none_has_the_first_axis_stand() -> None:
    made = telescope()
    settings(made, "moveaxis", Axis="0", Rate="1.0")
    for axis, rate, dec in (("0", "0.000001000", "0.000000"), ("1", "0.5", "1800.000000")):
        assert settings(made, "moveaxis", Axis=axis, Rate=rate) == [
            ("TELESCOPE_TRACK_RATE", {"TRACK_RATE_RA": "0.000000", "TRACK_RATE_DE": dec}),
            ("TELESCOPE_TRACK_MODE", {"TRACK_CUSTOM": "On"}),
        ]


def test_a_rate_in_force_is_reversed_through_nothing_as_drivers_want_it() -> None:
    made = telescope()
    settings(made, "moveaxis", Axis="1", Rate="0.1")
    made.feed(
        b'<setSwitchVector device="T" name="TELESCOPE_TRACK_MODE" state="Ok">'
        b'<oneSwitch name="TRACK_CUSTOM">On</oneSwitch></setSwitchVector>'
    )
    assert settings(made, "moveaxis", Axis="1", Rate="-0.1") == [
        ("TELESCOPE_TRACK_RATE", {"TRACK_RATE_RA": "15.041067", "TRACK_RATE_DE": "0.000000"}),
        ("TELESCOPE_TRACK_RATE", {"TRACK_RATE_RA": "15.041067", "TRACK_RATE_DE": "-360.000000"}),
    ]


def test_an_address_is_a_device_by_its_name() -> None:
    address = parse_alpaca("indi://127.0.0.1/EQMod%20Mount?hz=4")
    assert (address.host, address.port, address.device, address.hz) == ("127.0.0.1", 7624, "EQMod Mount", 4.0)
    assert str(address) == "indi://127.0.0.1:7624/EQMod%20Mount"
    with pytest.raises(BadInputError, match="no device; write indi://HOST:PORT/DEVICE"):
        parse_alpaca("indi://127.0.0.1:7624")


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "sattrack.toml").write_text("[safety]\noptical = false\n")
    monkeypatch.chdir(tmp_path)


needs_indi = pytest.mark.needs("indiserver", "indi_simulator_telescope", "indi_getprop", "indi_setprop")


@pytest.fixture
def simulator(program: Callable[[str], str]) -> Iterator[tuple[Indi, str]]:
    """INDI's simulated telescope, tracking where its site has it high up, and its URL."""
    with indi_server(program, program("indi_simulator_telescope")) as port:
        client = Indi(port, NAME, program)
        client.until("CONNECTION.CONNECT", bool)
        client.set("CONNECTION.CONNECT=On")
        client.until("GEOGRAPHIC_COORD.LAT", bool)
        latitude, longitude, height = WHERE.split(",")
        client.set(f"GEOGRAPHIC_COORD.LAT={latitude};LONG={longitude};ELEV={height}")
        client.set("TELESCOPE_TRACK_STATE.TRACK_ON=On")
        # By the sidereal time, as its first right ascensions are those of no site yet.
        sidereal = erfa.gmst82(2440587.5, time.time() / 86400.0) + math.radians(float(longitude))
        ra_h = math.degrees(sidereal) / 15.0 % 24.0
        # It takes being there as said, which a slew would take seconds for.
        client.set("ON_COORD_SET.SYNC=On")
        client.set(f"EQUATORIAL_EOD_COORD.RA={ra_h};DEC=40")
        client.until("EQUATORIAL_EOD_COORD.DEC", lambda value: abs(float(value) - 40.0) < 0.001)
        client.set("ON_COORD_SET.TRACK=On")
        client.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Ok")
        yield client, f"indi://127.0.0.1:{port}/{NAME.replace(' ', '%20')}"


def place(client: Indi) -> tuple[float, float]:
    return 15.0 * client.number("EQUATORIAL_EOD_COORD.RA"), client.number("EQUATORIAL_EOD_COORD.DEC")


def assert_rests(client: Indi) -> None:
    """Nothing moves after a stop: once two looks have shown the same place, later ones do."""
    client.until("TELESCOPE_TRACK_MODE.TRACK_CUSTOM", lambda value: value == "Off")
    client.until("TELESCOPE_TRACK_RATE.TRACK_RATE_DE", lambda value: float(value) == 0.0)
    until_s = time.monotonic() + PATIENCE_S
    while apart(before := place(client), after := place(client)) > SAME_DEG:
        assert time.monotonic() < until_s, (before, after)
    assert client.get("TELESCOPE_TRACK_MODE.TRACK_CUSTOM") == "Off"
    until_s = time.monotonic() + POLL_S
    until(lambda: apart(after, place(client)) > RESTS_DEG or time.monotonic() > until_s)
    assert apart(after, place(client)) < RESTS_DEG


def apart(one: tuple[float, float], other: tuple[float, float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


@needs_indi
def test_indis_simulator_is_slewed_moved_and_seen_at_rest_by_hand(simulator: tuple[Indi, str]) -> None:
    client, url = simulator
    ra_deg, _ = place(client)
    assert run(["mount", "slew", str((ra_deg - 5.0) % 360.0), "50", "--mount", url, "--site", WHERE]) == 0
    assert place(client) == pytest.approx(((ra_deg - 5.0) % 360.0, 50.0), abs=0.01)
    rates = ("--ra-rate", "0.2", "--dec-rate", "-0.5", "--seconds", "3")
    assert run(["mount", "move", *rates, "--mount", url, "--site", WHERE]) == 0
    moved_ra_deg, moved_dec_deg = place(client)
    # 0.6° and -1.5°, but for what starting and stopping takes.
    assert 0.3 < (moved_ra_deg - ra_deg + 5.0) % 360.0 < 0.9
    assert -2.0 < moved_dec_deg - 50.0 < -1.0
    assert_rests(client)


@contextlib.contextmanager
def moving(client: Indi, url: str) -> Iterator[subprocess.Popen[str]]:
    """Have `mount move` turn the telescope for a minute."""
    command = ("mount", "move", "--dec-rate", "0.2", "--seconds", "60", "--mount", url, "--site", WHERE)
    with ended(sattrack(*command, stderr=subprocess.DEVNULL)) as process:
        client.until("TELESCOPE_TRACK_RATE.TRACK_RATE_DE", lambda value: float(value) > 700.0)
        yield process


@needs_indi
def test_ctrl_c_leaves_nothing_moving(simulator: tuple[Indi, str]) -> None:
    client, url = simulator
    with moving(client, url) as process:
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
        assert_rests(client)


@needs_indi
def test_a_session_that_is_killed_leaves_nothing_moving(simulator: tuple[Indi, str]) -> None:
    client, url = simulator
    with moving(client, url) as process:
        process.kill()
        process.wait(PATIENCE_S)
        assert_rests(client)


@needs_indi
def test_a_gateway_that_is_killed_leaves_nothing_moving(simulator: tuple[Indi, str]) -> None:
    client, url = simulator
    with moving(client, url) as process:
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                line = (folder / "cmdline").read_bytes()
                if GATEWAY in line and f'"127.0.0.1",{url.split(":")[2].split("/")[0]}'.encode() in line:
                    os.kill(int(folder.name), signal.SIGKILL)
        assert process.wait(PATIENCE_S) == 4
        assert_rests(client)


@needs_indi
@pytest.mark.needs("indi_lx200classic")
def test_a_driver_without_fine_rates_is_refused_with_its_reason_but_stopped(
    program: Callable[[str], str], capsys: pytest.CaptureFixture[str]
) -> None:
    with indi_server(program, program("indi_lx200classic")) as port:
        client = Indi(port, "LX200 Classic", program)
        client.until("SIMULATION.ENABLE", bool)
        client.set("SIMULATION.ENABLE=On")
        client.set("CONNECTION.CONNECT=On")
        client.until("EQUATORIAL_EOD_COORD.RA", bool)
        url = f"indi://127.0.0.1:{port}/LX200%20Classic"
        assert (
            run(["mount", "move", "--dec-rate", "0.2", "--seconds", "1", "--mount", url, "--site", WHERE])
            == 1
        )
        assert "has no TELESCOPE_TRACK_RATE (rates of tracking) on both axes" in capsys.readouterr().err
        assert run(["stop", "--mount", url]) == 0
        assert "stopped and seen at rest" in capsys.readouterr().out


@needs_indi
def test_what_is_not_there_is_told_in_a_line(
    program: Callable[[str], str], capsys: pytest.CaptureFixture[str]
) -> None:
    with indi_server(program, program("indi_simulator_telescope")) as port:
        Indi(port, NAME, program).until("CONNECTION.CONNECT", bool)
        nobody = f"indi://127.0.0.1:{port}/Telescope%20Nobody"
        assert run(["mount", "status", "--mount", nobody, "--site", WHERE]) == 4
    told = capsys.readouterr().err
    assert "no device 'Telescope Nobody' there" in told
    assert "the server has no device" not in told
    assert told.count("\n") == 1

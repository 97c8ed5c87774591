"""LX200 and Stellarium's own protocol: what stands in the documents, and what INDI's drivers make of it."""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import struct
import subprocess
import threading
import time
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Self

import pytest
from alpaca_serving import serving
from programs import free_port
from serving import PATIENCE_S, serving_program

from sattrack.mount.model import MountProfile, Slew
from sattrack.mount.requests import Abort
from sattrack.servers.alpaca.lx200 import Asked, CommandReader, Lx200Client
from sattrack.servers.alpaca.protocol import MOVING_BY_RATES, Fault, MoveOrder, TelescopeState
from sattrack.servers.alpaca.stellarium import GotoReader, of_date, of_j2000, position
from sattrack.servers.alpaca.telescope import Device, ServedTelescope
from tle.earth import EarthOrientation
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NOW_S = datetime(2026, 10, 2, 21, 5, 7, tzinfo=UTC).timestamp()
LEIDEN = Site(52.1541, 4.4908, 0.0)
STATE = TelescopeState(
    utc_s=NOW_S,
    heard=True,
    ra_h=5.5041666,
    dec_deg=-5.3911111,
    altitude_deg=35.805,
    azimuth_deg=245.9031,
    sidereal_h=6.5316666,
    tracking=True,
)


def client_of(state: TelescopeState = STATE, *, gives_reasons: bool = False) -> Lx200Client:
    telescope = ServedTelescope(Device(MountProfile(), LEIDEN, "a test", "1.2", "here"))
    telescope.state = state
    return Lx200Client(telescope, -1, gives_reasons)


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("\x06", b"P"),
        ("GR", b"05:30:15#"),
        ("GD", b"-05*23'28#"),
        ("GA", b"+35*48'18#"),
        ("GZ", b"245*54'11#"),
        ("GS", b"06:31:54#"),
        ("GL", b"21:05:07#"),
        ("Ga", b"09:05:07#"),
        ("GC", b"10/02/26#"),
        ("Gc", b"24#"),
        ("GG", b"+00.0#"),
        ("Gt", b"+52*09#"),
        ("Gg", b"-004*29#"),
        ("GT", b"60.1#"),
        ("GW", b"PT1#"),
        ("GVP", b"sattrack#"),
        ("D", b"#"),
        ("P", b"HIGH PRECISION"),
        ("Sr05:30:00", b"1"),
        ("Sr 05:30.5", b"1"),
        ("Sr25:30:00", b"0"),
        ("Sd+45*30:00", b"1"),
        ("Sd-05*30", b"1"),
        ("Sd-05\xdf30'30", b"1"),
        ("Sd+91*00", b"0"),
        ("St+52*10", b"1"),
        ("St+12*10", b"0"),
        ("Sg355*31", b"1"),
        ("Sg004*29", b"0"),
        ("SG-02.0", b"1"),
        ("SL21:05:30", b"1"),
        ("SL22:05:30", b"0"),
        ("SC10/02/26", b"1Updating Planetary Data#                                #"),
        ("SC10/03/26", b"0"),
        ("h?", b"0"),
        ("XYZ", b""),
        ("MS", b"1"),
    ],
)
def test_commands_are_answered_as_the_protocol_has_them(command: str, answer: bytes) -> None:
    assert client_of().answer(command, NOW_S) == answer


@pytest.mark.parametrize(
    ("ra_h", "dec_deg", "long", "short"),
    [
        (23.99999, 0.0, (b"00:00:00#", b"+00*00'00#"), (b"00:00.0#", b"+00*00#")),
        (12.0, -0.0001, (b"12:00:00#", b"+00*00'00#"), (b"12:00.0#", b"+00*00#")),
        (0.99999, 89.99999, (b"01:00:00#", b"+90*00'00#"), (b"01:00.0#", b"+90*00#")),
        (1.5, -0.25, (b"01:30:00#", b"-00*15'00#"), (b"01:30.0#", b"-00*15#")),
    ],
)
def test_places_are_rounded_over_the_full_hour_and_told_in_either_precision(
    ra_h: float, dec_deg: float, long: tuple[bytes, bytes], short: tuple[bytes, bytes]
) -> None:
    client = client_of(TelescopeState(utc_s=NOW_S, heard=True, ra_h=ra_h, dec_deg=dec_deg))
    assert (client.answer("GR", NOW_S), client.answer("GD", NOW_S)) == long
    assert client.answer("U", NOW_S) == b""
    assert (client.answer("GR", NOW_S), client.answer("GD", NOW_S)) == short


def test_local_time_is_what_makes_utc_of_it() -> None:
    client = client_of()
    assert client.answer("SG-02.0", NOW_S) == b"1"
    assert client.answer("GL", NOW_S) == b"23:05:07#"
    assert client.answer("SL23:05:00", NOW_S) == b"1"


def test_a_target_is_slewed_to_as_it_was_set() -> None:
    client = client_of(gives_reasons=True)
    assert client.answer("MS", NOW_S) == b"1no target is set#"
    client.answer("Sr05:30:30", NOW_S)
    client.answer("Sd-10*30:36", NOW_S)
    asked = client.answer("MS", NOW_S)
    assert isinstance(asked, Asked)
    (order,) = asked.orders
    assert isinstance(order, Slew)
    assert (order.ra_deg, order.dec_deg) == pytest.approx((82.625, -10.51))
    assert asked.done == b"0"
    assert asked.refused("it is # below 0°") == b"1it is   below 0*#"


def moved(client: Lx200Client, command: str) -> list[tuple[int, float]]:
    asked = client.answer(command, NOW_S)
    assert isinstance(asked, Asked)
    return [(order.axis, order.rate_deg_s) for order in asked.orders if isinstance(order, MoveOrder)]


def test_direction_keys_turn_west_and_north_at_the_rate_chosen_and_end_one_by_one() -> None:
    client = client_of()
    assert moved(client, "Mn") == [(1, 0.1)]
    client.answer("RM", NOW_S)
    assert moved(client, "Me") == [(0, -0.5)]
    assert moved(client, "Qn") == [(1, 0.0)]
    assert moved(client, "Qn") == []
    assert [(one.axis, one.rate_deg_s) for one in client.left().orders] == [(0, 0.0)]
    assert client.left().orders == ()


def test_a_stop_ends_the_keys_motion_and_anything_else_stops_the_mount_heard_or_not() -> None:
    client = client_of(TelescopeState(utc_s=NOW_S, heard=True, doing=MOVING_BY_RATES, slewing=True))
    moved(client, "Mn"), moved(client, "Mw")
    assert moved(client, "Q") == [(0, 0.0), (1, 0.0)]
    for unmoved in (client, client_of(), client_of(TelescopeState(utc_s=NOW_S, heard=False))):
        asked = unmoved.answer("Q", NOW_S)
        assert isinstance(asked, Asked)
        assert asked.orders == (Abort(),)
    # Another client's slew is stopped, although this one's keys were last heard of as pressed.
    slewing = client_of(TelescopeState(utc_s=NOW_S, heard=True, doing="slewing", slewing=True))
    slewing.turning.add(1)
    asked = slewing.answer("Q", NOW_S)
    assert isinstance(asked, Asked)
    assert asked.orders == (Abort(),)


def test_a_mount_that_is_not_heard_gives_no_place() -> None:
    with pytest.raises(Fault, match="not heard"):
        client_of(TelescopeState(utc_s=NOW_S, heard=False)).answer("GR", NOW_S)


def test_commands_come_whole_from_any_pieces_and_other_protocols_are_hung_up_on() -> None:
    sent = b"#:GR#:Sr05:30:00#\x06\r\n:Q#"
    for size in (1, 3, 100):
        reader = CommandReader()
        found: list[str] = []
        for i in range(0, len(sent), size):
            found += reader.read(sent[i : i + size]) or []
        assert found == ["GR", "Sr05:30:00", "\x06", "Q"]
    for other in (b"GET / HTTP/1.1\r\n\r\n:MS#", b"\x16\x03\x01", b"x:MS#", b":" + 100 * b"a"):
        assert CommandReader().read(other) is None
    assert CommandReader(noisy=True).read(b"\xff\x10:GR#" + b":" + 100 * b"a" + b":GD#") in (
        ["GR", ""],
        ["GR", "GD"],
        ["GR", "", "GD"],
    )


def test_stellariums_goto_is_read_by_its_layout_and_others_hung_up_on() -> None:
    # 20 bytes: length, type, time in microseconds, 6 h of right ascension, -45° of declination.
    message = bytes.fromhex("1400 0000 0000000000000000 00000040 000000e0")
    reader = GotoReader()
    assert reader.read(message[:7]) == []
    assert reader.read(message[7:] + message) == [(90.0, -45.0), (90.0, -45.0)]
    for other in (b"GET / HTTP/1.1", b"\x16\x03\x01\x00", bytes.fromhex("1400 0100"), 40 * b"\xff"):
        assert GotoReader().read(other) is None
    beyond = bytes.fromhex("1400 0000 0000000000000000 00000040 00000060")
    assert GotoReader().read(beyond) is None


def test_the_position_that_stellarium_hears_is_laid_out_as_its_protocol_says() -> None:
    assert position(1.5, 90.0, -45.0, is_well=True) == bytes.fromhex(
        "1800 0000 60e3160000000000 00000040 000000e0 00000000"
    )
    assert position(0.0, 359.99999999999, 90.0, is_well=False)[12:] == struct.pack("<Iii", 0, 2**30, -1)


def test_directions_of_j2000_are_turned_to_date_as_astropy_turns_them() -> None:
    from astropy import units
    from astropy.coordinates import CIRS, TETE, EarthLocation, SkyCoord
    from astropy.time import Time

    earth = EarthOrientation.installed()
    place = EarthLocation.from_geodetic(4.4908, 52.1541, 0.0)
    time_ = Time(NOW_S, format="unix")
    for ra_deg, dec_deg in ((83.6, 22.0), (300.0, -12.0), (10.0, 89.0)):
        there = SkyCoord(ra_deg * units.deg, dec_deg * units.deg, frame="icrs")
        theirs = there.transform_to(TETE(obstime=time_, location=place))
        ours = of_date(ra_deg, dec_deg, NOW_S, LEIDEN, earth)
        apart = SkyCoord(*ours, unit="deg", frame=theirs.frame).separation(theirs)
        # ICRS and the mean equator of J2000 differ by 0.02″.
        assert float(apart.arcsec) < 0.1
        back = of_j2000(*ours, NOW_S, LEIDEN, earth)
        assert back == pytest.approx((ra_deg, dec_deg), abs=1e-8)
    assert CIRS is not None


class Line:
    """A TCP client."""

    def __init__(self, port: int) -> None:
        self._line = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)

    def ask(self, text: str, ends: bytes = b"#") -> bytes:
        self._line.sendall(text.encode("latin-1"))
        answer = b""
        while not answer.endswith(ends):
            data = self._line.recv(1)
            if not data:
                return answer
            answer += data
        return answer

    def until(self, text: str, answer: bytes) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while (heard := self.ask(text)) != answer:
            assert time.monotonic() < until_s, heard

    def is_hung_up_on(self) -> bool:
        try:
            return self._line.recv(1) == b""
        except ConnectionError:
            return True

    def close(self) -> None:
        self._line.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def test_several_protocols_serve_one_telescope_and_each_may_stop_it() -> None:
    lx200_port, stellarium_port = free_port(), free_port()
    with ExitStack() as closing, serving(f"lx200:{lx200_port}", f"stellarium:{stellarium_port}") as served:
        lx200, stellarium = (
            closing.enter_context(Line(lx200_port)),
            closing.enter_context(Line(stellarium_port)),
        )
        where = [int(part) for part in re.findall(r"\d+", lx200.ask(":GR#").decode())]
        ra_h = where[0] + where[1] / 60.0 + 0.5
        assert lx200.ask(f":Sr{int(ra_h) % 24:02d}:{int(ra_h * 60) % 60:02d}:00#", b"1") == b"1"
        assert lx200.ask(":Sd+40*00:00#", b"1") == b"1"
        assert lx200.ask(":MS#", b"0") == b"0"
        lx200.until(":GD#", b"+40*00'00#")
        lx200.until(":D#", b"#")
        assert lx200.ask(":CM#") == b"Coordinates     matched.        #"
        # A goto of Stellarium's is seen by LX200, and stopped by it.
        ra_raw = int(ra_h / 24.0 * 2**32) % 2**32
        stellarium._line.sendall(struct.pack("<HHqIi", 20, 0, 0, ra_raw, int(5.0 / 360.0 * 2**32)))
        lx200.until(":D#", b"\x7f#")
        lx200._line.sendall(b":Q#")
        lx200.until(":D#", b"#")
        assert lx200.ask(":GW#") == b"PN1#"
        for junk in (
            b"POST / HTTP/1.1\r\n\r\n:MS#",
            b"\x16\x03\x01\x02\x00",
            os.urandom(64).replace(b":", b"x"),
        ):
            for port in (lx200_port, stellarium_port):
                with Line(port) as other:
                    other._line.sendall(junk)
                    other._line.shutdown(socket.SHUT_WR)
                    while not other.is_hung_up_on():
                        pass
        assert lx200.ask(":D#") == b"#"
        assert lx200.ask(":GW#") == b"PN1#"
        served.end()


def test_motion_begun_with_a_key_ends_with_the_connection() -> None:
    with serving_program("lx200") as served, Line(served.port) as line, Line(served.port) as other:
        line._line.sendall(b":RM#:Mn#")
        line.until(":D#", b"\x7f#")
        line.close()
        other.until(":D#", b"#")
        assert other.ask(":GD#") == other.ask(":GD#")


DRIVER = "LX200 Classic"


class Indi:
    """INDI's LX200 driver in its own server, by INDI's own command line programs."""

    def __init__(self, port: int, program: Callable[[str], str]) -> None:
        self._port, self._program = port, program

    def set(self, text: str) -> None:
        command = [self._program("indi_setprop"), "-p", str(self._port), f"{DRIVER}.{text}"]
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)

    def get(self, name: str) -> str:
        command = [
            self._program("indi_getprop"), "-p", str(self._port), "-t", "2", "-1", f"{DRIVER}.{name}",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
        return done.stdout.strip()

    def until(self, name: str, holds: Callable[[str], bool]) -> str:
        until_s = time.monotonic() + PATIENCE_S
        while not holds(value := self.get(name)):
            assert time.monotonic() < until_s, (name, value)
        return value

    def number(self, name: str) -> float:
        return float(self.until(name, bool))


@contextmanager
def indi(program: Callable[[str], str]) -> Iterator[Indi]:
    port = free_port()
    command = [program("indiserver"), "-p", str(port), program("indi_lx200classic")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        client = Indi(port, program)
        client.until("CONNECTION.CONNECT", bool)
        yield client
    finally:
        process.terminate()
        process.wait(timeout=PATIENCE_S)


def drive(client: Indi) -> None:
    """Slew, sync, guide, move, stop, and be refused, by INDI's driver."""
    client.set("CONNECTION.CONNECT=On")
    client.until("EQUATORIAL_EOD_COORD.DEC", lambda value: value == "15")
    assert float(client.get("GEOGRAPHIC_COORD.LAT")) == pytest.approx(52.15, abs=0.02)
    assert float(client.get("GEOGRAPHIC_COORD.LONG")) == pytest.approx(4.49, abs=0.02)
    ra_h = client.number("EQUATORIAL_EOD_COORD.RA")
    client.set(f"EQUATORIAL_EOD_COORD.RA={(ra_h + 0.5) % 24.0};DEC=40")
    client.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Busy")
    client.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Ok")
    assert client.number("EQUATORIAL_EOD_COORD.RA") == pytest.approx((ra_h + 0.5) % 24.0, abs=0.001)
    assert client.number("EQUATORIAL_EOD_COORD.DEC") == pytest.approx(40.0, abs=0.01)
    client.set("TELESCOPE_MOTION_NS.MOTION_NORTH=On")
    client.until("EQUATORIAL_EOD_COORD.DEC", lambda value: float(value or 0.0) > 40.1)
    client.set("TELESCOPE_MOTION_NS.MOTION_NORTH=Off")
    client.set("TELESCOPE_ABORT_MOTION.ABORT=On")
    client.until("TELESCOPE_ABORT_MOTION._STATE", lambda value: value == "Ok")
    client.set("EQUATORIAL_EOD_COORD.RA=1;DEC=-85")
    client.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value != "Busy")
    # What a refusal leaves unread would be taken for the next place.
    for _ in range(3):
        assert client.number("EQUATORIAL_EOD_COORD.DEC") > 40.0
        assert client.number("EQUATORIAL_EOD_COORD.RA") < 24.0


@pytest.mark.needs("indiserver", "indi_lx200classic")
def test_indis_driver_slews_moves_and_stops_the_mount_over_tcp(program: Callable[[str], str]) -> None:
    with serving_program("lx200") as served, indi(program) as client:
        client.set("CONNECTION_MODE.CONNECTION_TCP=On")
        client.set(f"DEVICE_ADDRESS.ADDRESS=127.0.0.1;PORT={served.port}")
        drive(client)


@contextmanager
def serial_line() -> Iterator[tuple[str, str]]:
    """Give the two ends of a serial line: two pseudo-terminals, back to back."""
    (one, its_end), (other, other_end) = os.openpty(), os.openpty()
    ended = threading.Event()

    def carry() -> None:
        while not ended.is_set():
            for number in select.select([one, other], [], [], 0.05)[0]:
                with contextlib.suppress(OSError):
                    os.write(other if number == one else one, os.read(number, 1024))

    carrying = threading.Thread(target=carry)
    carrying.start()
    try:
        yield os.ttyname(its_end), os.ttyname(other_end)
    finally:
        ended.set()
        carrying.join()
        for number in (one, its_end, other, other_end):
            os.close(number)


@pytest.mark.needs("indiserver", "indi_lx200classic")
def test_indis_driver_slews_moves_and_stops_the_mount_over_a_serial_line(
    program: Callable[[str], str],
) -> None:
    with (
        serial_line() as (ours, theirs),
        indi(program) as client,
        serving_program("lx200", "--serial", ours),
    ):
        client.set("CONNECTION_MODE.CONNECTION_SERIAL=On")
        client.set(f"DEVICE_PORT.PORT={theirs}")
        drive(client)

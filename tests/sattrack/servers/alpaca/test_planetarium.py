"""LX200, INDI and Stellarium's own protocol: what stands in the documents, and what INDI's programs do."""

from __future__ import annotations

import asyncio
import os
import re
import select
import socket
import struct
import time
import tracemalloc
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast
from xml.etree import ElementTree

import msgspec
import pytest
from alpaca_serving import serving
from indi_programs import Indi, indi_server
from programs import free_port
from serving import PATIENCE_S, serial_line, serving_program

from sattrack.core.clock import SimulatedClock
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import AxesPosition, MountProfile, SitePlace, Slew
from sattrack.mount.requests import Abort
from sattrack.runtime.callers import CallerLimits
from sattrack.servers.alpaca import indi, planetarium
from sattrack.servers.alpaca.connections import ClientConnection, OpenConnections
from sattrack.servers.alpaca.lx200 import Asked, CommandReader, Lx200Client
from sattrack.servers.alpaca.planetarium import Planetariums
from sattrack.servers.alpaca.protocol import (
    MOVING_BY_RATES,
    Fault,
    FollowedState,
    Form,
    MoveOrder,
    Number,
    TelescopeState,
    TrackOrder,
)
from sattrack.servers.alpaca.stellarium import GotoReader, of_date, of_j2000, position
from sattrack.servers.alpaca.telescope import MOST_CONNECTED, Device, ServedTelescope
from tle.earth import EarthOrientation
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.alpaca.connections import FeederLine

NOW_S = datetime(2026, 10, 2, 21, 5, 7, tzinfo=UTC).timestamp()
LEIDEN = Site(52.1541, 4.4908, 0.0)
EXAMPLES = Path(__file__).parents[4] / "examples"
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
    ],
)
def test_commands_are_answered_as_the_protocol_has_them(command: str, answer: bytes) -> None:
    assert client_of().answer(command, NOW_S) == answer


@pytest.mark.parametrize(
    ("east_deg", "alpaca", "lx200"),
    [(248.25, -111.75, b"+111*45#"), (-111.75, -111.75, b"+111*45#"), (4.5, 4.5, b"-004*30#")],
)
def test_a_longitude_is_given_in_half_turns_however_it_was_set(
    east_deg: float, alpaca: float, lx200: bytes
) -> None:
    client = client_of()
    client.telescope.device = Device(MountProfile(), Site(40.0, east_deg, 0.0), "a test", "1.2", "here")
    assert client.answer("Gg", NOW_S) == lx200
    for own in (None, east_deg):
        client.telescope.state = msgspec.structs.replace(
            STATE, site_latitude_deg=40.0, site_longitude_deg=own
        )
        assert client.telescope.get("sitelongitude", Form((), any_case=True), -1, NOW_S) == alpaca


@pytest.mark.parametrize(
    ("profile", "alignment", "status"),
    [
        (MountProfile(), b"P", b"PT1#"),
        (MountProfile(pier_rule="hour_angle"), b"P", b"GT1#"),
        (
            MountProfile(geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(52.15, 4.49)),
            b"A",
            b"AT1#",
        ),
    ],
)
def test_the_alignment_is_the_one_that_alpacas_clients_see(
    profile: MountProfile, alignment: bytes, status: bytes
) -> None:
    client = client_of()
    client.telescope.device = Device(profile, LEIDEN, "a test", "1.2", "here")
    assert (client.answer("\x06", NOW_S), client.answer("GW", NOW_S)) == (alignment, status)


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


@pytest.mark.parametrize("offset", ["-05.8", "-5.75", "-05:45"])
def test_a_zone_may_be_quarters_of_an_hour_off_and_rounded(offset: str) -> None:
    client = client_of()
    for one in (f"G{offset}", "L02:50:07", "C10/03/26"):
        answer = client.answer(f"S{one}", NOW_S)
        assert isinstance(answer, bytes)
        assert answer.startswith(b"1")
    assert (client.answer("GL", NOW_S), client.answer("GG", NOW_S)) == (b"02:50:07#", b"-05.8#")


def refusal(asked: object) -> bytes:
    """Return the answer to what is refused already."""
    assert isinstance(asked, Asked)
    assert asked.objection is not None
    return asked.refused(asked.objection)


def test_a_target_is_slewed_to_as_it_was_set() -> None:
    client = client_of(gives_reasons=True)
    assert refusal(client.answer("MS", NOW_S)) == b"1no target is set#"
    assert refusal(client_of().answer("MS", NOW_S)) == b"1"
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


def test_a_key_takes_up_tracking_after_a_stop_and_a_lost_connection_does_not() -> None:
    standing = client_of(TelescopeState(utc_s=NOW_S, heard=True, doing=MOVING_BY_RATES, slewing=True))
    moved(standing, "Mn"), moved(standing, "Mw")
    for command, orders in (("Qn", (MoveOrder(1, 0.0),)), ("Qw", (MoveOrder(0, 0.0), TrackOrder(on=True)))):
        asked = standing.answer(command, NOW_S)
        assert isinstance(asked, Asked)
        assert asked.orders == orders
    moved(standing, "Mn")
    assert standing.left().orders == (MoveOrder(1, 0.0),)


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
            select.select([], [], [], 0.02)

    def send(self, data: bytes) -> None:
        self._line.sendall(data)

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


def test_several_protocols_serve_one_telescope_each_may_stop_it_and_a_key_ends_with_its_client() -> None:
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
        stellarium.send(struct.pack("<HHqIi", 20, 0, 0, ra_raw, int(5.0 / 360.0 * 2**32)))
        lx200.until(":D#", b"\x7f#")
        lx200.send(b":Q#")
        lx200.until(":D#", b"#")
        assert lx200.ask(":GW#") == b"PN1#"
        for junk in (
            b"POST / HTTP/1.1\r\n\r\n:MS#",
            b"\x16\x03\x01\x02\x00",
            os.urandom(64).replace(b":", b"x"),
        ):
            for port in (lx200_port, stellarium_port):
                with Line(port) as other:
                    other.send(junk)
                    other._line.shutdown(socket.SHUT_WR)
                    while not other.is_hung_up_on():
                        pass
        assert lx200.ask(":D#") == b"#"
        assert lx200.ask(":GW#") == b"PN1#"
        # Motion begun with a key ends with the connection.
        with Line(lx200_port) as line:
            line.send(b":RM#:Mn#")
            line.until(":D#", b"\x7f#")
        lx200.until(":D#", b"#")
        assert lx200.ask(":GD#") == lx200.ask(":GD#")
        served.end()


def drive(client: Indi, *, stays: bool = True) -> None:
    """Slew, move, sync, stop and be refused, by what INDI's clients send.

    `stays` tells that whoever talks to the mount stays connected: motion begun with a key ends with it.
    """
    client.until("CONNECTION.CONNECT", bool)
    client.set("CONNECTION.CONNECT=On")
    client.until("EQUATORIAL_EOD_COORD.DEC", lambda value: abs(float(value) - 15.0) < 0.01)
    assert client.number("GEOGRAPHIC_COORD.LAT") == pytest.approx(52.15, abs=0.02)
    assert client.number("GEOGRAPHIC_COORD.LONG") == pytest.approx(4.49, abs=0.02)
    ra_h = client.number("EQUATORIAL_EOD_COORD.RA")
    client.set(f"EQUATORIAL_EOD_COORD.RA={(ra_h + 0.5) % 24.0};DEC=40")
    client.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Busy")
    client.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Ok")
    assert client.number("EQUATORIAL_EOD_COORD.RA") == pytest.approx((ra_h + 0.5) % 24.0, abs=0.001)
    assert client.number("EQUATORIAL_EOD_COORD.DEC") == pytest.approx(40.0, abs=0.01)
    client.set("TELESCOPE_MOTION_NS.MOTION_NORTH=On")
    # On a busy machine a client is gone again before the mount has moved at all.
    while not stays and client.number("EQUATORIAL_EOD_COORD.DEC") <= 40.001:
        client.set("TELESCOPE_MOTION_NS.MOTION_NORTH=On")
    if stays:
        client.until("EQUATORIAL_EOD_COORD.DEC", lambda value: float(value) > 40.1)
    client.set("TELESCOPE_MOTION_NS.MOTION_NORTH=Off")
    # A mount that moves is not synced.
    client.settle()
    client.set("ON_COORD_SET.SYNC=On")
    client.set(f"EQUATORIAL_EOD_COORD.RA={(ra_h + 0.52) % 24.0};DEC=40.8")
    client.until("EQUATORIAL_EOD_COORD.DEC", lambda value: float(value) > 40.79)
    assert client.number("EQUATORIAL_EOD_COORD.RA") == pytest.approx((ra_h + 0.52) % 24.0, abs=0.001)
    client.set("ON_COORD_SET.TRACK=On")
    client.set("TELESCOPE_ABORT_MOTION.ABORT=On")
    client.until("TELESCOPE_ABORT_MOTION._STATE", lambda value: value == "Ok")
    client.set("EQUATORIAL_EOD_COORD.RA=1;DEC=-85")
    client.settle()
    # What a refusal leaves unread would be taken for the next place.
    for _ in range(3):
        assert client.number("EQUATORIAL_EOD_COORD.DEC") > 40.0
        assert client.number("EQUATORIAL_EOD_COORD.RA") < 24.0


CLASSIC = "LX200 Classic"


@pytest.mark.soak
@pytest.mark.needs("indiserver", "indi_lx200classic")
def test_indis_lx200_driver_slews_moves_and_stops_the_mount_over_tcp(program: Callable[[str], str]) -> None:
    with serving_program("lx200") as served, indi_server(program, program("indi_lx200classic")) as port:
        client = Indi(port, CLASSIC, program)
        client.until("CONNECTION.CONNECT", bool)
        client.set("CONNECTION_MODE.CONNECTION_TCP=On")
        client.set(f"DEVICE_ADDRESS.ADDRESS=127.0.0.1;PORT={served.port}")
        drive(client)


@pytest.mark.needs("indiserver", "indi_lx200classic")
def test_indis_lx200_driver_slews_moves_and_stops_the_mount_over_a_serial_line(
    program: Callable[[str], str],
) -> None:
    with (
        serial_line() as (ours, theirs),
        serving_program("lx200", "--serial", ours),
        indi_server(program, program("indi_lx200classic")) as port,
    ):
        client = Indi(port, CLASSIC, program)
        client.until("CONNECTION.CONNECT", bool)
        client.set("CONNECTION_MODE.CONNECTION_SERIAL=On")
        client.set(f"DEVICE_PORT.PORT={theirs}")
        drive(client)


def test_a_serial_adapter_that_is_plugged_in_again_is_served_again(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"

    def plug_in() -> int:
        ours, theirs = os.openpty()
        device.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        return ours

    def unplug(ours: int) -> None:
        device.unlink()
        os.close(ours)

    def altitude_is_told(ours: int) -> bool:
        os.write(ours, b":GA#")
        told = b""
        while not told.endswith(b"#") and select.select([ours], [], [], PATIENCE_S)[0]:
            told += os.read(ours, 64)
        return b"*" in told

    line = plug_in()
    with serving_program("lx200", "--serial", str(device)) as served:
        assert altitude_is_told(line)
        for _ in range(2):
            unplug(line)
            served.wait_for(b"the serial line is gone")
            line = plug_in()
            served.wait_for(b"the serial line is there again")
            assert altitude_is_told(line)
    unplug(line)


@pytest.mark.needs("indiserver", "indi_getprop")
def test_indis_clients_slew_move_and_stop_the_mount_itself_and_behind_their_own_server(
    program: Callable[[str], str],
) -> None:
    with (
        serving_program("indi") as served,
        indi_server(program, f"{indi.DEVICE}@127.0.0.1:{served.port}") as port,
    ):
        direct, behind = Indi(served.port, indi.DEVICE, program), Indi(port, indi.DEVICE, program)
        drive(direct, stays=False)
        direct.set("EQUATORIAL_EOD_COORD.RA=1;DEC=-85")
        behind.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Alert")
        behind.set("TELESCOPE_MOTION_NS.MOTION_NORTH=On")
        behind.until("EQUATORIAL_EOD_COORD.DEC", lambda value: float(value) > 41.0)
        direct.set("TELESCOPE_ABORT_MOTION.ABORT=On")
        direct.until("TELESCOPE_TRACK_STATE.TRACK_OFF", lambda value: value == "On")
        behind.settle()
        behind.set("TELESCOPE_TRACK_STATE.TRACK_ON=On")
        direct.until("TELESCOPE_TRACK_STATE.TRACK_ON", lambda value: value == "On")


@pytest.mark.needs("indi_getprop")
def test_a_satellite_that_kstars_would_send_is_followed_and_let_go(program: Callable[[str], str]) -> None:
    lines = (EXAMPLES / "iss_leiden.tle").read_text().splitlines()[-2:]
    with serving_program("indi", "--clock", "2026-10-02T13:03:00Z") as served, Line(served.port) as line:
        client = Indi(served.port, indi.DEVICE, program)
        client.set("CONNECTION.CONNECT=On")
        client.set("SAT_TRACKING_STAT.SAT_TRACK=On;SAT_HALT=Off")
        client.until("SAT_TRACKING_STAT._STATE", lambda value: value == "Alert")
        # INDI's own program sends the first line of a text alone.
        for one in (
            message("Text", "SAT_TLE_TEXT", TLE="\n".join(lines)),
            message("Switch", "SAT_TRACKING_STAT", SAT_TRACK="On", SAT_HALT="Off"),
        ):
            line.send(ElementTree.tostring(one))
        client.until("SAT_TRACKING_STAT.SAT_TRACK", lambda value: value == "On")
        client.set("SAT_TRACKING_STAT.SAT_TRACK=Off;SAT_HALT=On")
        client.until("SAT_TRACKING_STAT.SAT_TRACK", lambda value: value == "Off")


@pytest.mark.needs("indiserver", "indi_simulator_telescope")
def test_properties_are_those_of_indis_own_telescope(program: Callable[[str], str]) -> None:
    """Kind, permission, rule and elements of each are as INDI's simulator has them."""
    with indi_server(program, program("indi_simulator_telescope")) as port:
        client = Indi(port, "Telescope Simulator", program)
        client.until("CONNECTION.CONNECT", bool)
        client.set("CONNECTION.CONNECT=On")
        client.until("GEOGRAPHIC_COORD.LAT", bool)
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as line:
            line.sendall(b'<getProperties version="1.7"/>')
            text = b""
            while b'name="GUIDE_RATE"' not in text:
                text += line.recv(65536)
    whole = text[: text.rindex(b"<def", 0, text.index(b'name="GUIDE_RATE"'))].decode()
    theirs = {one.get("name"): one for one in ElementTree.fromstring(f"<all>{whole}</all>")}
    missing = {name for name in indi.BY_NAME if name not in theirs}
    assert missing == {"SAT_TLE_TEXT", "SAT_PASS_WINDOW", "SAT_TRACKING_STAT"}
    for name, vector in indi.BY_NAME.items():
        if name in missing:
            continue
        there = theirs[name]
        assert there.tag == f"def{vector.kind}Vector"
        assert there.get("perm") == ("rw" if vector.is_set else "ro")
        assert there.get("rule", "") == vector.rule
        elements = [one.get("name") for one in there]
        ours = [one[0] for one in vector.elements]
        assert ours == elements[: len(ours)]
        assert name == "TELESCOPE_TRACK_MODE" or ours == elements


def test_xml_comes_whole_from_any_pieces_and_other_protocols_are_hung_up_on() -> None:
    sent = b'<?xml version="1.0" encoding="UTF-8"?>\n<getProperties version="1.7"/>\n'
    sent += b"<?xml version='1.0'?><enableBLOB>Never</enableBLOB>"
    sent += b'<newSwitchVector device="sattrack" name="X"><oneSwitch name="A">'
    sent += b"\nOn\n</oneSwitch></newSwitchVector>\n"
    for size in (1, 7, 1000):
        reader = indi.MessageReader()
        found = [one.tag for i in range(0, len(sent), size) for one in reader.read(sent[i : i + size]) or []]
        assert found == ["getProperties", "enableBLOB", "newSwitchVector"]
    for other in (
        b"GET / HTTP/1.1\r\n\r\n<newSwitchVector/>",
        b"\x16\x03\x01\x02",
        b"<!DOCTYPE x [<!ENTITY a 'b'>]><x/>",
        b"<a><b><c><d/></c></b></a>",
        b"<a/>words<a/>",
        b"<a/><?xml version='1.0'?>words<a/>",
        b"<?xml " + 70000 * b"y",
        b"</indi>",
        b"<a x='" + 70000 * b"y",
    ):
        assert indi.MessageReader().read(other) is None
    for pieces in (
        (b"<a/>", b"words", b"<a/>"),
        (b"<a/>\n<b/", b">w", b"ords<a/>"),
        (b"<a/>", b"<b/>words<a/>"),
    ):
        reader = indi.MessageReader()
        assert [reader.read(piece) is None for piece in pieces][-1], pieces


def indi_device(state: TelescopeState = STATE) -> indi.ServedIndiDevice:
    telescope = client_of(state).telescope
    device = indi.ServedIndiDevice(telescope, -1)
    assert device.take(message("Switch", "CONNECTION", CONNECT="On"), 1, NOW_S) is None
    return device


def message(kind: str, name: str, **values: str) -> ElementTree.Element:
    vector = ElementTree.Element(f"new{kind}Vector", device=indi.DEVICE, name=name)
    for element, text in values.items():
        ElementTree.SubElement(vector, f"one{kind}", name=element).text = text
    return vector


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (message("Number", "EQUATORIAL_EOD_COORD", RA="x", DEC="1"), "'x' is no number"),
        (message("Number", "EQUATORIAL_EOD_COORD", RA="1", DEC="9" * 400), "9' is no number"),
        (message("Number", "EQUATORIAL_EOD_COORD", RA="1", DEC="91"), "Declination is 91"),
        (
            message("Number", "TELESCOPE_TIMED_GUIDE_NS", TIMED_GUIDE_N="9" * 20),
            "Duration is '1000.*whole number",
        ),
        (message("Number", "TELESCOPE_TIMED_GUIDE_NS", TIMED_GUIDE_N="9" * 400), "9' is no number"),
        (message("Number", "GEOGRAPHIC_COORD", LAT="52.15", LONG="9" * 400), "9' is no number"),
        (message("Number", "GEOGRAPHIC_COORD", LAT="12", LONG="4"), "the site is set to 52.1541"),
        (message("Text", "TIME_UTC", UTC="2026-10-02T22:05:07", OFFSET="2"), "clock is .3600 s off"),
        (message("Switch", "SAT_TRACKING_STAT", SAT_TRACK="On"), "send the satellite's elements first"),
    ],
)
def test_what_cannot_be_set_is_told_with_its_reason(asked: ElementTree.Element, why: str) -> None:
    device = indi_device()
    with pytest.raises(Fault) as fault:
        device.take(asked, 1, NOW_S)
    assert re.search(why, fault.value.message)


def test_a_connection_that_succeeds_is_no_alert_any_more() -> None:
    telescope = client_of().telescope
    telescope.state = None
    device = indi.ServedIndiDevice(telescope, -1)
    connect = message("Switch", "CONNECTION", CONNECT="On")
    with pytest.raises(Fault, match="not heard") as fault:
        device.take(connect, 1, NOW_S)
    device.refuse("CONNECTION", fault.value.message)
    assert device.values(NOW_S)["CONNECTION"] == ("Alert", ("Off", "On"))
    telescope.state = STATE
    device.take(connect, 1, NOW_S)
    assert device.values(NOW_S)["CONNECTION"] == ("Ok", ("On", "Off"))


def test_scripts_that_connect_under_ever_new_numbers_disconnect_no_indi_client() -> None:
    device = indi_device()
    for number in range(2 * MOST_CONNECTED):
        device.telescope.put("connect", Form((), any_case=False), number, NOW_S)
    assert device.telescope.clients == MOST_CONNECTED
    assert device.telescope.connected(2 * MOST_CONNECTED - 1)
    assert device.values(NOW_S)["CONNECTION"] == ("Ok", ("On", "Off"))


def test_a_place_may_be_as_small_as_libindi_writes_it() -> None:
    # libindi's clients write numbers by %.20g.
    place = {"RA": "5.4999999999999997e+00", "DEC": "1.0000000000000000818e-05"}
    asked = indi_device().take(message("Number", "EQUATORIAL_EOD_COORD", **place), 1, NOW_S)
    assert isinstance(asked, Asked)
    assert asked.orders == (Slew(82.5, 1e-5),)


def test_nothing_is_moved_before_a_client_connects_but_a_stop_always_stops() -> None:
    device = indi.ServedIndiDevice(client_of().telescope, -1)
    with pytest.raises(Fault, match="connect first"):
        device.take(message("Number", "EQUATORIAL_EOD_COORD", RA="1", DEC="40"), 1, NOW_S)
    asked = device.take(message("Switch", "TELESCOPE_ABORT_MOTION", ABORT="On"), 1, NOW_S)
    assert isinstance(asked, Asked)
    assert asked.orders == (Abort(),)
    other = message("Switch", "TELESCOPE_ABORT_MOTION", ABORT="On")
    other.set("device", "CCD Simulator")
    assert device.take(other, 1, NOW_S) is None


def test_a_client_hears_what_changed_and_nothing_else() -> None:
    device = indi_device()
    view = indi.ClientView(device)
    assert view.changes(NOW_S) == b""
    defined = view.definitions(ElementTree.Element("getProperties", device=indi.DEVICE), NOW_S)
    assert defined.count(b"<def") == len(indi.VECTORS) + sum(len(one.elements) for one in indi.VECTORS)
    assert view.changes(NOW_S + 1.0) == b""
    device.telescope.state = TelescopeState(utc_s=NOW_S, heard=True, ra_h=5.6, dec_deg=-5.3, tracking=True)
    told = ElementTree.fromstring(b"<all>" + view.changes(NOW_S) + b"</all>")
    assert {one.get("name") for one in told} == {"EQUATORIAL_EOD_COORD"}
    device.refuse("TELESCOPE_PARK", "no <place>")
    told = ElementTree.fromstring(b"<all>" + view.changes(NOW_S) + b"</all>")
    assert [one.get("message", one.get("state")) for one in told] == ["Alert", "no <place>"]


@pytest.mark.parametrize(("device", "answered"), [("*", True), ("", True), ("CCD Simulator", False)])
def test_a_server_that_chains_all_devices_finds_ours(device: str, answered: bool) -> None:
    asked = ElementTree.Element("getProperties", version="1.7", device=device)
    assert (b"defSwitchVector" in indi.ClientView(indi_device()).definitions(asked, NOW_S)) is answered


def test_the_place_of_a_mount_that_is_not_heard_is_an_alert_until_it_is_heard_again() -> None:
    device = indi_device()
    view = indi.ClientView(device)
    view.definitions(ElementTree.Element("getProperties"), NOW_S)
    late_s = NOW_S + 60.0
    (told,) = ElementTree.fromstring(b"<all>" + view.changes(late_s) + b"</all>")
    assert (told.get("name"), told.get("state")) == ("EQUATORIAL_EOD_COORD", "Alert")
    assert [one.text for one in told] == ["5.5041666", "-5.3911111"]
    assert view.changes(late_s) == b""
    (told,) = ElementTree.fromstring(b"<all>" + view.changes(NOW_S) + b"</all>")
    assert (told.get("name"), told.get("state")) == ("EQUATORIAL_EOD_COORD", "Idle")


def test_a_client_that_comes_while_the_mount_is_not_heard_gets_the_rest_when_it_is() -> None:
    device = indi_device()
    device.telescope.state = None
    everything, nothing = indi.ClientView(device), indi.ClientView(device)
    first = everything.definitions(ElementTree.Element("getProperties"), NOW_S)
    nothing.definitions(ElementTree.Element("getProperties", name="DRIVER_INFO"), NOW_S)
    assert b'"EQUATORIAL_EOD_COORD"' not in first
    device.telescope.state = STATE
    rest = ElementTree.fromstring(b"<all>" + everything.changes(NOW_S) + b"</all>")
    assert {one.tag for one in rest} == {"defNumberVector", "defSwitchVector"}
    assert "EQUATORIAL_EOD_COORD" in {one.get("name") for one in rest}
    assert first.count(b"</def") + len(rest) + sum(map(len, rest)) == len(indi.VECTORS) + sum(
        len(one.elements) for one in indi.VECTORS
    )
    assert everything.changes(NOW_S) == nothing.changes(NOW_S) == b""


def test_a_key_that_another_protocols_stop_has_ended_is_not_shown_as_held() -> None:
    device = indi_device()
    device.take(message("Switch", "TELESCOPE_MOTION_NS", MOTION_SOUTH="On"), 7, NOW_S)
    held, let_go = ("Busy", ("Off", "On")), ("Idle", ("Off", "Off"))
    assert device.values(NOW_S)["TELESCOPE_MOTION_NS"] == held
    device.carried_out("TELESCOPE_MOTION_NS")
    device.telescope.state = msgspec.structs.replace(STATE, slewing=True, doing=MOVING_BY_RATES)
    assert device.values(NOW_S)["TELESCOPE_MOTION_NS"] == held
    device.telescope.state = msgspec.structs.replace(STATE, slewing=True, doing="stopping")
    assert device.values(NOW_S)["TELESCOPE_MOTION_NS"] == let_go


@pytest.mark.parametrize(
    ("ends", "told", "why"),
    [
        ({"ra_h": 1.0, "dec_deg": 40.001}, "Ok", None),
        ({"ra_h": 3.0, "dec_deg": 20.0}, "Idle", None),
        ({"ra_h": 3.0, "dec_deg": 20.0, "failure": "stopped by floor"}, "Alert", "stopped by floor"),
    ],
)
def test_a_slew_that_fails_or_is_stopped_does_not_end_as_one_that_is_there(
    ends: dict[str, Any], told: str, why: str | None
) -> None:
    device = indi_device()
    device.take(message("Number", "EQUATORIAL_EOD_COORD", RA="1", DEC="40"), 1, NOW_S)
    device.telescope.state = msgspec.structs.replace(STATE, slewing=True)
    device.carried_out("EQUATORIAL_EOD_COORD")
    assert device.values(NOW_S)["EQUATORIAL_EOD_COORD"][0] == "Busy"
    device.telescope.state = msgspec.structs.replace(STATE, **ends)
    assert [device.values(NOW_S)["EQUATORIAL_EOD_COORD"][0] for _ in range(2)] == [told, told]
    assert [words for _, words in device.messages] == ([] if why is None else [why])


@pytest.mark.parametrize(("parked", "told"), [(True, "Ok"), (False, "Idle")])
def test_a_park_that_was_stopped_is_not_done(parked: bool, told: str) -> None:
    device = indi_device()
    device.telescope.device = Device(
        MountProfile(park=AxesPosition(0.0, 60.0)), LEIDEN, "a test", "1.2", "here"
    )
    device.take(message("Switch", "TELESCOPE_PARK", PARK="On"), 1, NOW_S)
    device.carried_out("TELESCOPE_PARK")
    device.telescope.state = msgspec.structs.replace(STATE, at_park=parked, tracking=False)
    assert device.values(NOW_S)["TELESCOPE_PARK"][0] == told


def test_a_satellite_that_has_set_is_no_longer_followed() -> None:
    device = indi_device()
    device.take(message("Text", "SAT_TLE_TEXT", TLE="two lines"), 1, NOW_S)
    device.take(message("Switch", "SAT_TRACKING_STAT", SAT_TRACK="On"), 1, NOW_S)
    assert device.values(NOW_S)["SAT_TRACKING_STAT"] == ("Busy", ("Off", "On"))
    followed = FollowedState("ISS", 25544, "following", 0.0, 0.0, 1.0, acquired=True)
    device.telescope.state = msgspec.structs.replace(STATE, following=followed)
    device.carried_out("SAT_TRACKING_STAT")
    assert device.values(NOW_S)["SAT_TRACKING_STAT"] == ("Busy", ("On", "Off"))
    device.telescope.state = STATE
    assert device.values(NOW_S)["SAT_TRACKING_STAT"] == ("Idle", ("Off", "On"))


def test_keys_of_an_indi_client_end_with_it_and_with_nobody_else() -> None:
    device = indi_device()
    asked = device.take(message("Switch", "TELESCOPE_MOTION_WE", MOTION_WEST="On"), 7, NOW_S)
    assert isinstance(asked, Asked)
    assert [(one.axis, one.rate_deg_s) for one in asked.orders if isinstance(one, MoveOrder)] == [(0, 0.5)]
    assert device.left(8).orders == ()
    assert device.left(7).orders == (MoveOrder(0, 0.0),)


class Feeder:
    """In place of the line to the feeding process: keeps orders, and answers them while it does not hang."""

    def __init__(self) -> None:
        self.orders: list[object] = []
        self.answers = asyncio.Event()
        self.answers.set()
        self.lines: list[str] = []
        self.refuses: str | None = None

    @property
    def stops(self) -> int:
        return sum(isinstance(order, Abort) for order in self.orders)

    async def order(self, order: object, waits: bool = False) -> None:
        self.orders.append(order)
        await self.answers.wait()
        if self.refuses is not None:
            raise Fault(Number.INVALID_OPERATION, self.refuses)

    def log(self, text: str) -> None:
        self.lines.append(text)


class Transport(asyncio.Transport):
    def __init__(self) -> None:
        super().__init__()
        self.aborted = asyncio.Event()
        self.closed = False

    def get_extra_info(self, name: str, default: object = None) -> object:
        return ("127.0.0.1", 4030) if name == "peername" else default

    def abort(self) -> None:
        self.aborted.set()

    def write(self, data: bytes | bytearray | memoryview) -> None:
        pass

    def close(self) -> None:
        self.closed = True

    def is_closing(self) -> bool:
        return self.closed


class Writer:
    """Takes what is written, and waits for ever where the client does not read."""

    def __init__(self, transport: Transport, *, is_read: bool) -> None:
        self.transport, self._is_read, self.written_bytes = transport, is_read, 0

    def write(self, data: bytes) -> None:
        self.written_bytes += len(data)

    async def drain(self) -> None:
        if not self._is_read:
            await asyncio.Event().wait()

    def close(self) -> None:
        pass


class Client:
    """A client of one protocol before a server without a port."""

    def __init__(
        self, protocol: str, *, reads: bool = True, requests_per_s: float = 100.0, **served: bool
    ) -> None:
        self.feeder, self.transport = Feeder(), Transport()
        self._reader = asyncio.StreamReader()
        connections = OpenConnections(CallerLimits(4, 300.0, 100.0, None))
        self.planetariums = planetariums = Planetariums(
            client_of().telescope,
            cast("FeederLine", self.feeder),
            connections,
            SimulatedClock(NOW_S, time.monotonic()),
            requests_per_s,
            cast("Any", None),
        )
        self.connection = ClientConnection(connections, lambda: Serving(self._reader))
        self.connection.connection_made(self.transport)
        # A serial line is no connection that can be hung up on.
        self.writer = Writer(Transport() if served else self.transport, is_read=reads)
        serve = getattr(planetariums, protocol)
        self._serving = asyncio.ensure_future(serve(self._reader, self.writer, **served))

    async def send(self, data: bytes) -> None:
        """Send bytes, and have them read."""
        for start in range(0, len(data), 65536):
            self.connection.data_received(data[start : start + 65536])
            await self.until(lambda: not self._reader._buffer)  # type: ignore[attr-defined]

    async def until(self, what: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not what():
                await asyncio.sleep(0)

    async def leave(self) -> None:
        self._reader.feed_eof()
        await asyncio.wait_for(self._serving, PATIENCE_S)


class Serving(asyncio.Protocol):
    def __init__(self, reader: asyncio.StreamReader) -> None:
        self._reader = reader

    def data_received(self, data: bytes) -> None:
        self._reader.feed_data(data)


@pytest.mark.parametrize(
    ("protocol", "sent", "logged"),
    [
        ("lx200", b":MS#", ["LX200: no target is set"]),
        ("lx200", b":Sr01:00:00#:Sd+40*00#:MS#", ["LX200: below the floor"]),
        ("indi", b"", ["INDI: below the floor"]),
    ],
)
def test_the_reason_of_every_refused_slew_is_logged_with_its_protocol(
    protocol: str, sent: bytes, logged: list[str]
) -> None:
    async def slewed() -> list[str]:
        client = Client(protocol)
        client.feeder.refuses = "below the floor"
        for message_sent in (
            message("Switch", "CONNECTION", CONNECT="On"),
            message("Number", "EQUATORIAL_EOD_COORD", RA="1", DEC="40"),
        ):
            await client.send(sent or ElementTree.tostring(message_sent))
        await client.until(lambda: bool(client.feeder.lines))
        await client.leave()
        return client.feeder.lines[:1]

    assert asyncio.run(slewed()) == logged


def test_questions_about_a_mount_that_is_not_heard_fill_no_log() -> None:
    async def asked() -> list[str]:
        client = Client("lx200")
        client.planetariums.telescope.state = None
        await client.send(b":GR#:GD#" * 20 + b":MS#")
        await client.until(lambda: bool(client.feeder.lines))
        await client.leave()
        return client.feeder.lines

    (line,) = asyncio.run(asked())
    assert line.startswith("LX200 'MS' was refused: the mount at a test is not heard")


STOPS = {"lx200": b":Q#", "indi": ElementTree.tostring(message("Switch", indi.ABORT, ABORT="On"))}
QUESTIONS = {"lx200": b":GR#", "indi": b'<getProperties version="1.7"/>'}
SERVED = pytest.mark.parametrize("protocol", list(STOPS))


def test_a_client_that_only_ever_stops_is_not_taken_for_one_that_sends_half_requests() -> None:
    async def stopped_once() -> bool:
        client = Client("lx200")
        await client.send(b":Q#")
        await client.until(lambda: client.feeder.stops == 1)
        overdue = client.connection.overdue(asyncio.get_running_loop().time() + 60.0, 300.0)
        await client.leave()
        return overdue

    assert asyncio.run(stopped_once()) is False


@SERVED
def test_who_sends_and_never_reads_fills_no_memory_and_is_hung_up_on_but_may_stop(
    protocol: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planetarium, "FINISH_WITHIN_S", 0.0)

    async def flooded() -> None:
        client = Client(protocol, reads=False)
        question = QUESTIONS[protocol]
        await client.send(question)
        await client.until(lambda: client.writer.written_bytes > 0)
        tracemalloc.start()
        await client.send(question * (2**20 // len(question)))
        _, most_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most_bytes < 2**22
        await client.send(STOPS[protocol])
        await client.until(lambda: client.feeder.stops == 1)
        await asyncio.wait_for(client.transport.aborted.wait(), PATIENCE_S)
        assert [line for line in client.feeder.lines if "too much ahead of its answers" in line]
        assert len(client.feeder.lines) == 1
        await client.leave()

    asyncio.run(flooded())


@pytest.mark.parametrize("protocol", ["lx200", "indi", "stellarium"])
def test_the_end_of_the_program_beside_a_client_is_no_defect(protocol: str) -> None:
    told: list[object] = []

    async def ended() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: told.append(context))
        planetariums = Client(protocol).planetariums
        connection = planetariums.protocol(getattr(planetariums, protocol))
        connection.connection_made(Transport())
        await asyncio.sleep(0)
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.sleep(0)

    asyncio.run(ended())
    assert told == []


@SERVED
def test_a_flood_of_stops_makes_few_orders_and_the_last_is_obeyed_too(protocol: str) -> None:
    async def flooded() -> None:
        client = Client(protocol)
        client.feeder.answers.clear()
        await client.send(STOPS[protocol] * 5000)
        await client.until(lambda: client.feeder.stops == planetarium.MOST_STOPS)
        assert len(asyncio.all_tasks()) < 2 * planetarium.MOST_STOPS
        client.feeder.answers.set()
        await client.until(lambda: client.feeder.stops > planetarium.MOST_STOPS)
        await client.leave()
        assert client.feeder.stops == planetarium.MOST_STOPS + 1

    asyncio.run(flooded())


def test_no_motion_that_waits_for_its_clients_pace_begins_after_a_stop() -> None:
    async def moved_after() -> list[object]:
        client = Client("lx200", requests_per_s=2.0)
        await client.send(b":Mn#:Mw#:Me#")
        await client.until(lambda: bool(client.feeder.orders))
        await client.send(b":Q#")
        await client.until(lambda: client.feeder.stops == 1)
        after = len(client.feeder.orders)
        await client.leave()
        return client.feeder.orders[after:]

    assert not [one for one in asyncio.run(moved_after()) if isinstance(one, MoveOrder) and one.rate_deg_s]


def test_a_question_about_the_stop_is_answered_and_another_devices_stop_drops_nothing() -> None:
    question = b'<getProperties version="1.7" device="sattrack" name="TELESCOPE_ABORT_MOTION"/>'
    other = message("Switch", indi.ABORT, ABORT="On")
    other.set("device", "Dome Simulator")
    connect = message("Switch", "CONNECTION", CONNECT="On")
    moves = [message("Switch", "TELESCOPE_MOTION_NS", MOTION_NORTH="On") for _ in range(2)]

    async def moved() -> list[object]:
        client = Client("indi")
        await client.send(question)
        await client.until(lambda: client.writer.written_bytes > 0)
        client.feeder.answers.clear()
        await client.send(b"".join(ElementTree.tostring(one) for one in (connect, *moves, other)))
        await client.send(question)
        client.feeder.answers.set()
        await client.leave()
        assert client.feeder.stops == 0
        return [one for one in client.feeder.orders if isinstance(one, MoveOrder) and one.rate_deg_s]

    assert len(asyncio.run(moved())) == 2


def test_a_serial_line_is_obeyed_again_after_too_much_at_once() -> None:
    async def flooded() -> None:
        client = Client("lx200", requests_per_s=1e6, is_serial=True)
        client.feeder.answers.clear()
        await client.send(b":Mn#" + b":GR#" * 5000)
        await client.until(lambda: bool(client.feeder.lines))
        client.feeder.answers.set()
        async with asyncio.timeout(PATIENCE_S):
            while len(client.feeder.orders) < 2:
                await client.send(b":Mw#")
        await client.leave()

    asyncio.run(flooded())

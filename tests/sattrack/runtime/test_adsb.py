"""Aircraft by ADS-B: recorded messages that others decoded, Beast frames by hand, runs that follow fixes."""

from __future__ import annotations

import math
import select
import socket
import threading

import msgspec
import pytest
from test_followed_targets import BEFORE, LEIDEN, replayed, request, seconds

from sattrack.control.engine_view import view_of
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.runtime.adsb import AdsbFeed, Aircraft, aircraft_now, beast_messages
from sattrack.runtime.facts import build_engine, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.views.messages import PlaceFix, decode_message, decode_observation
from tle.fixes import Fix, path_of
from tle.instants import Utc
from tle.propagator import Propagator

# From the description of the BaseStation port (Ryanair 1427, 2008-11-28).
SBS = (
    b"MSG,1,1,1,738065,1,2008/11/28,23:48:18.611,2008/11/28,23:53:19.161,RYR1427,,,,,,,0,,0,0\r\n",
    b"MSG,4,1,1,738065,1,2008/11/28,23:48:18.611,2008/11/28,23:53:19.161,,,420,179,,,0,0,0,0\r\n",
    b"MSG,3,1,1,738065,1,2008/11/28,23:48:18.611,2008/11/28,23:53:19.161,,36000,,,51.45735,1.02826,,,0,0,0,0\r\n",
)
# Real messages (J. Sun, The 1090 Megahertz Riddle).
EVEN, ODD = (bytes.fromhex(f"8D40621D58C38{rest}") for rest in ("2D690C8AC2863A7", "6435CC412692AD6"))
# Real positions of 40058B about 49.81755, 6.08442 (the tests of pyModeS).
PAIR = bytes.fromhex("8D40058B58C901375147EFD09357"), bytes.fromhex("8D40058B58C904A87F402D3B8C59")
START_S = seconds(BEFORE)
SPEED_M_S, LAT_DEG, LON_DEG, HEIGHT_M = 230.0, 52.0, 4.3, 10000.0


def test_base_station_lines_give_a_fix_as_soon_as_place_and_velocity_are_known():
    aircraft = Aircraft("738065")
    assert aircraft.sbs(SBS[2], 100.0) is None
    assert [aircraft.sbs(line, 100.0) for line in SBS[:2]] == [None, None]
    fix = aircraft.sbs(SBS[2], 101.0)
    assert fix[:4] == (101.0, 51.45735, 1.02826, pytest.approx(10972.8))
    knot = 1852.0 / 3600.0
    assert fix.east_m_s == pytest.approx(420.0 * knot * math.sin(math.radians(179.0)))
    assert fix.north_m_s == pytest.approx(420.0 * knot * math.cos(math.radians(179.0)))
    assert aircraft.callsign == "RYR1427"
    # A velocity does not last.
    assert aircraft.sbs(SBS[2], 120.0) is None


@pytest.mark.parametrize(
    "line", [b"", b"MSG,3", b"\xff" * 30, b"AIR,,1", SBS[2].replace(b"738065", b"738066")]
)
def test_what_is_no_line_of_the_aircraft_is_passed_over(line):
    aircraft = Aircraft("738065")
    aircraft.sbs(SBS[1], 100.0)
    assert aircraft.sbs(line, 100.0) is None


def frame(message, stamp=b"\x00\x1a\x02\x03\x04\x05"):
    kind = {7: b"2", 14: b"3"}[len(message)]
    return b"\x1a" + kind + (stamp + b"\x7f" + message).replace(b"\x1a", b"\x1a\x1a")


def test_beast_frames_are_found_in_a_stream_cut_anywhere():
    short = bytes.fromhex("02E197B00179C3")
    stream = b"junk" + frame(EVEN) + frame(short) + frame(ODD)
    for cut in range(len(stream) + 1):
        first, rest = beast_messages(stream[:cut])
        more, _ = beast_messages(rest + stream[cut:])
        assert first + more == [EVEN, short, ODD], cut


def test_mode_s_positions_are_those_that_others_decode():
    aircraft = Aircraft("40058b")
    aircraft.sbs(SBS[1].replace(b"738065", b"40058B"), 100.0)
    # A position counts once several pairs agree.
    found = [aircraft.mode_s(PAIR[k % 2], 100.0 + 0.5 * k) for k in range(14)]
    assert found[0] is None
    fix = found[-1]
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((49.81755, 6.08442), abs=1e-4)
    assert fix.height_m == pytest.approx(39000 * 0.3048, rel=0.02)
    damaged = PAIR[0][:-1] + b"\x00"
    assert aircraft.mode_s(damaged, 107.5) is None
    # A velocity: 159 kt, 182.88°, 832 ft a minute down.
    other = Aircraft("485020")
    assert other.mode_s(bytes.fromhex("8D485020994409940838175B284F"), 100.0) is None
    east, north, up = other._velocity
    assert (math.hypot(east, north), up) == pytest.approx((159 * 1852 / 3600, -832 * 0.3048 / 60), rel=1e-3)


@pytest.fixture
def receiver():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server, f"adsb:127.0.0.1:{server.getsockname()[1]}/738065"


def test_a_feed_gives_the_last_fix_as_a_message_and_never_waits(receiver):
    server, address = receiver
    feed = AdsbFeed(address, lambda: START_S)
    with server.accept()[0] as client:
        assert feed.lines() == []
        client.sendall(b"".join(SBS) + SBS[2][:50])
        (line,) = feed.lines()
        fix = decode_observation(line)
        assert (fix.utc, fix.lat_deg) == (Utc(START_S).isoformat("microseconds"), 51.45735)
        client.sendall(SBS[2][50:])
        assert len(feed.lines()) == 1
    assert feed.lines() == []
    feed.close()


def test_beast_frames_are_taken_from_a_feed_though_a_piece_ends_in_a_frame_of_another_kind(receiver):
    server, address = receiver
    feed = AdsbFeed(address)
    found = []
    feed.aircraft.mode_s = lambda message, _: found.append(message)
    # Kind 4, the settings of a receiver by Beast's description: passed over.
    other = b"\x1a4" + bytes(range(32, 45))
    with server.accept()[0] as client:
        for piece in (frame(EVEN) + other[:8], other[8:] + frame(ODD), frame(EVEN), frame(ODD)):
            client.sendall(piece)
            select.select([feed._socket], [], [])
            assert feed.lines() == []
    feed.close()
    assert found == [EVEN, ODD, EVEN, ODD]


def test_a_receiver_that_hangs_up_is_told_at_once(receiver):
    server, address = receiver

    def serve():
        with server.accept()[0] as client:
            client.sendall(SBS[0])

    thread = threading.Thread(target=serve)
    thread.start()
    with pytest.raises(SattrackError, match="the receiver has closed the connection"):
        aircraft_now(address)
    thread.join()


def test_an_aircraft_is_found_by_its_first_fix(receiver):
    server, address = receiver

    def serve():
        with server.accept()[0] as client:
            client.sendall(b"".join(SBS))
            client.recv(1)

    thread = threading.Thread(target=serve)
    thread.start()
    assert aircraft_now(address).label == "RYR1427"
    thread.join()


@pytest.mark.parametrize("address", ["adsb:", "adsb:host/40621D", "adsb:host:0/40621D", "adsb:host:1/xyz"])
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(BadInputError, match="write adsb:HOST:PORT/ICAO"):
        AdsbFeed(address)


def test_a_receiver_that_is_not_there_is_told(receiver):
    server, address = receiver
    server.close()
    with pytest.raises(SattrackError, match=r"no receiver answers.*start dump1090"):
        AdsbFeed(address)


def flown(since_s):
    """Return the place of something that flies east along a parallel of the ellipsoid."""
    normal_m = 6378137.0 / math.sqrt(1.0 - 0.00669437999014 * math.sin(math.radians(LAT_DEG)) ** 2)
    turn = SPEED_M_S * since_s / ((normal_m + HEIGHT_M) * math.cos(math.radians(LAT_DEG)))
    return LAT_DEG, LON_DEG + math.degrees(turn), HEIGHT_M


def fix_at(since_s, off_deg=0.0):
    lat, lon, height = flown(since_s)
    return Fix(START_S + since_s, lat + off_deg, lon, height, SPEED_M_S, 0.0, 0.0)


def test_a_new_fix_bends_the_path_without_a_jump():
    before = path_of("A", fix_at(0.0))
    # A hundred metres north of what was predicted.
    after = path_of("A", fix_at(10.0, 0.0009), before, START_S + 10.25)
    old, new = Propagator(before, LEIDEN), Propagator(after, LEIDEN)
    for since_s in (9.0, 10.0, 10.25):
        at = Utc(START_S + since_s)
        assert new.at(at).az_deg == pytest.approx(old.at(at).az_deg, abs=1e-7)
    for edge_s in (10.25, 12.25):
        early, late = (new.at(Utc(START_S + edge_s + s)) for s in (-1e-4, 1e-4))
        assert early.alt_deg == pytest.approx(late.alt_deg, abs=1e-4)
        assert early.alt_rate_deg_s == pytest.approx(late.alt_rate_deg_s, abs=1e-4)
    straight = Propagator(path_of("A", fix_at(10.0, 0.0009)), LEIDEN)
    at = Utc(START_S + 40.0)
    assert new.at(at).alt_deg == pytest.approx(straight.at(at).alt_deg, abs=1e-9)
    assert float(after.spans[-1][1].unix_s) > START_S + 70.0


def test_a_run_follows_an_aircraft_by_its_fixes_until_they_end(tmp_path):
    recording = tmp_path / "aircraft.mcap"
    prepared = prepare(request(path_of("A", fix_at(0.0)), record=recording))
    said = [fix_at(0.5 * k, 1e-5 * (k % 3)) for k in range(1, 41)]
    messages = tuple(
        (fix.utc_s + 0.1, PlaceFix(Utc(fix.utc_s).isoformat("microseconds"), *fix[1:])) for fix in said
    )
    summary = fly_virtual(prepared, messages=messages)
    assert summary.ended_by == "set"
    # The last fix is of 20 s after the start, and is flown on for a minute.
    assert seconds(summary.ended_utc) == pytest.approx(START_S + 80.0, abs=4.0)
    # The mount takes some seconds to get there, and some more to change its side of the pier.
    assert summary.on_target_s > 30.0
    assert summary.true_rms_arcsec < 0.2
    replayed(recording)


def test_a_run_without_a_fix_ends_a_minute_after_the_first_one():
    prepared = prepare(request(path_of("A", fix_at(0.0))))
    summary = fly_virtual(prepared)
    assert summary.ended_by == "set"
    assert seconds(summary.ended_utc) == pytest.approx(START_S + 60.0, abs=4.0)


def test_the_age_shown_is_that_of_the_last_fix():
    engine = build_engine(prepare(request(path_of("A", fix_at(0.0)))).facts)
    fix = fix_at(10.0)
    engine.operate(PlaceFix(Utc(fix.utc_s).isoformat("microseconds"), *fix[1:]), START_S + 10.1)
    assert view_of(engine, START_S + 12.0).elements_age_s == pytest.approx(2.0, abs=0.01)


def test_fixes_that_are_old_or_of_nothing_that_is_followed_by_them_are_refused():
    engine = build_engine(prepare(request(path_of("A", fix_at(0.0)))).facts)
    before = engine.tracker.plan
    old = PlaceFix(Utc(START_S - 1.0).isoformat(), 52.0, 4.0, 1e4)
    engine.operate(old, START_S + 1.0)
    assert "is not news" in engine.tracker.steering.refusal
    ahead = PlaceFix(Utc(START_S + 60.0).isoformat(), 52.0, 4.0, 1e4)
    engine.operate(ahead, START_S + 2.0)
    assert engine.tracker.plan == before


@pytest.mark.parametrize(
    "changes", [{"lat_deg": 90.0}, {"east_m_s": 1e5}, {"utc": "now"}, {"height_m": 1e9}, {"speed": 1.0}]
)
def test_a_fix_that_is_none_is_no_message(changes):
    fields = {"type": "fix", "utc": "2026-10-02T13:00:00Z", "lat_deg": 52.0, "lon_deg": 4.0, "height_m": 1e4}
    assert isinstance(decode_message(msgspec.json.encode(fields)), PlaceFix)
    for decode in (decode_message, decode_observation):
        with pytest.raises(msgspec.MsgspecError):
            decode(msgspec.json.encode(fields | changes))

"""The bridge alone: a session's bytes in, requests out; what was read in, a session's bytes out."""

from __future__ import annotations

import asyncio
import math
import struct
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import pytest
from skyfield.api import load
from skyfield.positionlib import position_of_radec

from sattrack.mount.alpaca.bridge import DEADMAN_S, STOP_AGAIN_S, Bridge, Equinox, Lateness
from sattrack.mount.alpaca.client import AlpacaRefusalError
from sattrack.mount.alpaca.device import DeviceFacts, DeviceState, RateSpan, SkyPlace, nearest_rate, spans_of
from sattrack.mount.alpaca.gateway_process import AlpacaClient
from sattrack.mount.alpaca.link import parse_alpaca, pier_doubt
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile, mean_sidereal_deg

if TYPE_CHECKING:
    from sattrack.mount.alpaca.bridge import Order

RATES = (RateSpan(0.0, 4.0),)
FACTS = DeviceFacts(
    latitude_deg=52.0,
    longitude_deg=4.5,
    can_set_tracking=True,
    can_slew=True,
    can_sync=True,
    primary_rates=RATES,
    secondary_rates=RATES,
)
T0 = 1_790_000_000.0
ABORT, MOVE_RA, MOVE_DEC, PULSE, SLEW, SYNC = 73, 75, 76, 78, 79, 80
"""Where the paper's command table has the flags."""


def datagram(*flags: int, **doubles: float) -> bytes:
    """82 bytes as the paper's table has them: `at_16=...` puts a double at byte 16."""
    data = bytearray(82)
    struct.pack_into("<Q", data, 0, 0x5555AAAA)
    for name, value in doubles.items():
        struct.pack_into("<d", data, int(name.removeprefix("at_")), value)
    for flag in flags:
        data[flag] = 0xFF
    return bytes(data)


def told(orders: list[Order]) -> list[tuple[str, dict[str, str]]]:
    return [(order.member, dict(order.fields)) for order in orders]


def bridge(**facts: object) -> Bridge:
    made = Bridge(DeviceFacts(**{**{f: getattr(FACTS, f) for f in FACTS.__struct_fields__}, **facts}), 4.5)
    made.stand(DeviceState(0.0))
    return made


def moving(made: Bridge, now_s: float = 100.0) -> Bridge:
    made.hear(datagram(MOVE_RA, MOVE_DEC, at_40=0.5, at_32=-0.25), now_s)
    made.turn(now_s)
    return made


def place(utc_s: float, ra_deg: float = 100.0, dec_deg: float = 20.0) -> SkyPlace:
    return SkyPlace(utc_s, ra_deg, utc_s, dec_deg)


def test_rates_become_moveaxis_of_either_axis_and_a_flag_that_falls_becomes_a_rate_of_0() -> None:
    made = bridge()
    made.hear(datagram(MOVE_RA, MOVE_DEC, at_40=0.5, at_32=-0.25), 1.0)
    assert told(made.turn(1.0)) == [
        ("moveaxis", {"Axis": "0", "Rate": "0.500000000"}),
        ("moveaxis", {"Axis": "1", "Rate": "-0.250000000"}),
    ]
    made.hear(datagram(MOVE_RA, MOVE_DEC, at_40=0.5, at_32=0.75), 1.1)
    assert told(made.turn(1.1)) == [("moveaxis", {"Axis": "1", "Rate": "0.750000000"})]
    made.hear(datagram(), 1.2)
    assert told(made.turn(1.2)) == [
        ("moveaxis", {"Axis": "0", "Rate": "0.000000000"}),
        ("moveaxis", {"Axis": "1", "Rate": "0.000000000"}),
    ]


def test_who_only_listens_tells_the_telescope_nothing() -> None:
    made = bridge()
    for turn in range(50):
        made.hear(datagram(), turn * 0.1)
        assert made.turn(turn * 0.1) == []
        made.see(place(T0 + turn * 0.1))
    assert not made.in_force


def test_an_abort_stops_slews_and_both_axes_again_and_again_until_the_telescope_rests() -> None:
    made = moving(bridge())
    made.hear(datagram(ABORT), 100.1)
    orders = made.turn(100.1)
    assert [order.member for order in orders] == ["abortslew", "moveaxis", "moveaxis"]
    assert [order.rate_deg_s for order in orders] == [0.0, 0.0, 0.0]
    made.stand(DeviceState(100.2, slewing=True))
    assert made.turn(100.3) == []
    assert len(made.turn(100.1 + STOP_AGAIN_S)) == 3
    made.stand(DeviceState(101.0))
    made.hear(datagram(), 101.1)
    assert made.turn(101.3) == []
    assert not made.in_force


def test_a_session_that_falls_silent_has_the_telescope_stopped_and_one_that_speaks_has_not() -> None:
    made = moving(bridge())
    assert made.turn(100.0 + DEADMAN_S - 0.01) == []
    silent = made.turn(100.0 + DEADMAN_S + 0.01)
    assert [order.member for order in silent] == ["abortslew", "moveaxis", "moveaxis"]
    resting = bridge()
    resting.hear(datagram(), 100.0)
    resting.turn(100.0)
    assert resting.turn(105.0) == []


def test_tracking_is_put_on_before_a_motion_and_given_back_after_the_stop() -> None:
    made = bridge()
    made.stand(DeviceState(1.0, tracking=False))
    made.hear(datagram(MOVE_RA, at_40=0.5), 2.0)
    assert told(made.turn(2.0)) == [("tracking", {"Tracking": "true"})]
    made.stand(DeviceState(2.05, tracking=True))
    assert [order.member for order in made.turn(2.1)] == ["moveaxis"]
    made.hear(datagram(ABORT), 3.0)
    assert [order.member for order in made.turn(3.0)] == ["abortslew", "moveaxis", "moveaxis"]
    made.stand(DeviceState(3.5, tracking=True))
    assert told(made.turn(3.6)) == [("tracking", {"Tracking": "false"})]
    made.stand(DeviceState(4.0, tracking=False))
    assert made.turn(4.1) == []
    assert not made.in_force


@pytest.mark.parametrize("follows_by_both", [False, True])
def test_tracking_is_let_be_during_a_motion_whatever_the_driver_reports_of_it(follows_by_both: bool) -> None:
    made = bridge(axes_known=follows_by_both)
    made.stand(DeviceState(1.0, tracking=not follows_by_both))
    orders = []
    for turn in range(100):
        now_s = 2.0 + 0.1 * turn
        made.hear(datagram(MOVE_RA, at_40=1.0 + 0.001 * turn), now_s)
        orders += made.turn(now_s)
        made.stand(DeviceState(now_s, slewing=True, tracking=follows_by_both))
    # Each rate is asked for at once, too.
    assert [order.rate_deg_s for order in orders] == pytest.approx([1.0 + 0.001 * k for k in range(100)])
    assert {order.member for order in orders} == {"moveaxis"}


@pytest.mark.parametrize(
    ("low_deg_s", "can_set_tracking", "asks"), [(0.1, True, True), (0.1, False, False), (0.0, True, False)]
)
def test_a_first_axis_stands_without_tracking_where_no_rate_is_slow_enough(
    low_deg_s: float, can_set_tracking: bool, asks: bool
) -> None:
    made = bridge(primary_rates=(RateSpan(low_deg_s, 4.0),), can_set_tracking=can_set_tracking)
    made.hear(datagram(MOVE_RA, MOVE_DEC, at_40=0.5, at_32=0.3), 2.0)
    made.turn(2.0)
    orders = []
    for turn in range(1, 9):
        made.hear(datagram(MOVE_RA, MOVE_DEC, at_40=1e-6, at_32=0.3), 2.0 + 0.1 * turn)
        orders.append(told(made.turn(2.0 + 0.1 * turn)))
    slowest = "0.000000000" if low_deg_s else "0.000001000"
    assert orders[0] == [("moveaxis", {"Axis": "0", "Rate": slowest})]
    # Once MoveAxis has ended: before, its end could give tracking back.
    assert orders[1] == ([("tracking", {"Tracking": "false"})] if asks else [])
    assert orders[2:] == [[]] * 6
    made.stand(DeviceState(3.0, tracking=not asks))
    made.hear(datagram(ABORT), 3.0)
    made.turn(3.0)
    made.stand(DeviceState(3.5, tracking=not asks))
    assert made.turn(3.6) == []
    assert not made.in_force


@pytest.mark.parametrize("reads", [True, False])
def test_tracking_that_was_given_back_a_moment_ago_is_put_on_before_the_next_motion(reads: bool) -> None:
    made = bridge()
    made.stand(DeviceState(1.0, tracking=False))
    made.hear(datagram(MOVE_RA, at_40=0.5), 2.0)
    made.turn(2.0)
    made.hear(datagram(ABORT), 3.0)
    made.turn(3.0)
    made.stand(DeviceState(3.5, tracking=True))
    assert told(made.turn(3.6)) == [("tracking", {"Tracking": "false"})]
    # What was read last may be older than that.
    made.stand(DeviceState(3.65, tracking=reads))
    made.hear(datagram(MOVE_RA, at_40=0.5), 3.7)
    assert told(made.turn(3.7)) == [("tracking", {"Tracking": "true"})]
    assert [order.member for order in made.turn(3.8)] == ["moveaxis"]


def test_what_is_refused_is_not_acknowledged_and_is_asked_for_again_as_long_as_it_is_wanted() -> None:
    made = bridge()
    made.hear(datagram(MOVE_RA, at_40=0.5), 1.0)
    (order,) = made.turn(1.0)
    first = made.see(place(T0))
    assert first is not None
    assert first[147] == 0xFF
    made.answered(order, "The telescope is parked (0x408)", 1.05)
    assert made.words == "the telescope refuses moveaxis: The telescope is parked (0x408)"
    (again,) = made.turn(1.1)
    assert again == order
    second = made.see(place(T0 + 0.1))
    assert second is not None
    assert second[147] == 0
    made.answered(again, None, 1.15)
    assert made.words is None
    assert made.turn(1.2) == []


def test_a_slew_and_a_sync_go_out_once_a_rising_flag_in_hours_and_degrees() -> None:
    made = bridge()
    made.stand(DeviceState(1.0))
    target = {"at_24": 5.5, "at_16": -12.5}
    made.hear(datagram(SLEW, **target), 1.0)
    made.hear(datagram(SLEW, **target), 1.05)
    assert told(made.turn(1.1)) == [
        ("slewtocoordinatesasync", {"RightAscension": "5.5000000000", "Declination": "-12.500000000"})
    ]
    made.hear(datagram(SYNC, **target), 1.2)
    assert told(made.turn(1.2))[0][0] == "synctocoordinates"


def test_a_slew_shows_until_the_telescope_was_asked_after_it_had_answered() -> None:
    made = bridge()
    made.hear(datagram(SLEW, at_24=5.5), 1.0)
    (order,) = made.turn(1.0)
    slewing = []
    made.stand(DeviceState(1.0))
    slewing.append(made.see(place(T0)))
    made.answered(order, None, 1.06)
    made.stand(DeviceState(1.05))
    slewing.append(made.see(place(T0 + 0.1)))
    made.stand(DeviceState(1.1, slewing=True))
    slewing.append(made.see(place(T0 + 0.2)))
    made.stand(DeviceState(1.2))
    slewing.append(made.see(place(T0 + 0.3)))
    assert [status is not None and status[143] for status in slewing] == [0xFF, 0xFF, 0xFF, 0]


def test_a_status_has_the_place_and_its_sidereal_time_where_the_paper_has_them() -> None:
    made = bridge()
    status = made.see(place(T0, 150.0, -33.25))
    assert status is not None
    assert len(status) == 160
    assert status[:8] == b"XERXESxx"
    assert struct.unpack_from("<d", status, 40)[0] == 10.0
    assert struct.unpack_from("<d", status, 24)[0] == -33.25
    ts = load.timescale(builtin=True)
    at = ts.from_datetime(datetime.fromtimestamp(T0, UTC))
    # Mean sidereal time by UTC, where skyfield's is by UT1: they differ by less than a second.
    expected_h = (at.gmst + 4.5 / 15.0) % 24.0
    assert abs(struct.unpack_from("<d", status, 56)[0] - expected_h) < 1.0 / 3600.0


@pytest.mark.parametrize(
    ("told_h", "ahead_s"),
    # Its answer may take a second; none, or one that is no time, says nothing.
    [
        (0.0, 0.0),
        (2.0 / 3600.0, 0.0),
        (2.0, 7180.3),
        (-1.0, -3590.2),
        (None, 0.0),
        (math.nan, 0.0),
        (30.0, 0.0),
    ],
)
def test_a_telescope_with_a_wrong_clock_or_site_has_its_own_sidereal_time_in_its_statuses(
    told_h: float | None, ahead_s: float
) -> None:
    made, ours_h = bridge(), mean_sidereal_deg(T0, 4.5) / 15.0
    made.see_clock(told_h if told_h is None or told_h == 30.0 else (ours_h + told_h) % 24.0, T0)
    status = made.see(place(T0))
    assert status is not None
    (sidereal_h,) = struct.unpack_from("<d", status, 56)
    gap_h = math.remainder(sidereal_h - ours_h, 24.0)
    assert gap_h * 15.0 / SIDEREAL_RATE_DEG_S == pytest.approx(ahead_s, abs=0.1)


def test_a_telescope_whose_clock_was_set_right_is_dated_by_ours_again() -> None:
    made, ours_h = bridge(), mean_sidereal_deg(T0, 4.5) / 15.0
    for off_h in (1.0, 1.0001, 1e-4):
        made.see_clock((ours_h + off_h) % 24.0, T0)
    status = made.see(place(T0))
    assert status is not None
    assert struct.unpack_from("<d", status, 56)[0] == pytest.approx(ours_h, abs=1e-9)


def test_the_declination_is_reckoned_to_the_instant_of_the_right_ascension() -> None:
    made = bridge()
    for turn in range(8):
        ra_s = T0 + 0.1 * turn
        status = made.see(SkyPlace(ra_s, 100.0, ra_s - 0.02, 20.0 + 0.5 * (0.1 * turn - 0.02)))
    assert status is not None
    assert struct.unpack_from("<d", status, 24)[0] == pytest.approx(20.0 + 0.5 * 0.7, abs=2e-4)


def test_a_place_that_stays_the_same_in_motion_is_no_news_but_not_for_ever() -> None:
    made = moving(bridge())
    for turn in range(6):
        assert made.see(place(T0 + 0.1 * turn, 100.0 - 0.05 * turn, 20.0 - 0.025 * turn)) is not None
    stale = [made.see(place(T0 + 0.5 + 0.1 * more, 99.75, 19.875)) for more in range(1, 9)]
    assert made.doubt is not None
    assert "ms old or more" in made.doubt
    assert stale[0] is None
    assert stale[-1] is not None


@pytest.mark.parametrize(
    ("wanted", "borne"),
    [(0.39, 0.3), (0.41, 0.5), (-9.0, -4.0), (0.0, 0.0), (math.nan, 0.0), (0.0004, 0.0), (0.0006, 0.001)],
)
def test_of_the_rates_that_an_axis_bears_the_nearest_is_asked(wanted: float, borne: float) -> None:
    assert nearest_rate(wanted, (RateSpan(0.001, 0.3), RateSpan(0.5, 4.0))) == borne


def test_axis_rates_that_make_no_sense_are_left_out() -> None:
    given = [
        {"Minimum": 0, "Maximum": 2.5},
        {"Minimum": 3, "Maximum": 1},
        {"Maximum": 1},
        "x",
        {"Minimum": "a"},
    ]
    assert spans_of(given) == (RateSpan(0.0, 2.5),)
    assert spans_of(None) == ()


@pytest.mark.parametrize(
    ("facts", "says"),
    [
        ({"secondary_rates": ()}, "no MoveAxis on both axes"),
        ({"primary_rates": (RateSpan(0.5, 0.5), RateSpan(1.0, 1.0))}, "single rates only"),
        ({"equatorial_system": 4}, "EquatorialSystem 4"),
        ({"alignment_mode": 0}, "alt-azimuth telescope (AlignmentMode 0)"),
    ],
)
def test_a_telescope_that_cannot_follow_is_refused_in_words(facts: dict[str, object], says: str) -> None:
    objection = bridge(**facts).facts.objection()
    assert objection is not None
    assert says in objection
    assert FACTS.objection() is None


def test_j2000_is_turned_to_the_equinox_of_date_as_skyfield_turns_it() -> None:
    ts = load.timescale(builtin=True)
    at = ts.from_datetime(datetime.fromtimestamp(T0, UTC))
    equinox = Equinox()
    for ra_deg, dec_deg in ((10.0, 60.0), (200.0, -35.0), (300.0, 5.0)):
        fixed = position_of_radec(ra_deg / 15.0, dec_deg, t=at)
        ra, dec, _ = fixed.radec(epoch=at)
        got = equinox.of_date(ra_deg, dec_deg, T0)
        assert abs(math.remainder(got[0] - ra.hours * 15.0, 360.0)) * 3600.0 < 0.01
        assert abs(got[1] - dec.degrees) * 3600.0 < 0.01
        assert equinox.j2000(*got, T0) == pytest.approx((ra_deg, dec_deg), abs=1e-9)


def test_the_drives_rates_are_those_of_the_places_that_were_read() -> None:
    made = bridge()
    for turn in range(8):
        status = made.see(place(T0 + 0.1 * turn, 100.0, 20.0 + 0.02 * turn))
    assert status is not None
    tics_a_degree = 2**26 / 360.0 * 10.0
    # A right ascension that stays is an hour angle that goes with the sky.
    assert struct.unpack_from("<q", status, 48)[0] / tics_a_degree == pytest.approx(
        SIDEREAL_RATE_DEG_S, abs=1e-5
    )
    assert struct.unpack_from("<q", status, 32)[0] / tics_a_degree == pytest.approx(0.2, abs=1e-5)


def test_a_request_that_took_much_longer_than_the_others_tells_no_place_but_a_longer_way_is_believed() -> (
    None
):
    lateness = Lateness()
    usual = [0.030 + 0.001 * (n % 5) for n in range(50)]
    assert not any(lateness.is_late(took_s) for took_s in usual)
    assert lateness.is_late(0.130)
    assert not lateness.is_late(0.031)
    longer = [lateness.is_late(0.130) for _ in range(6)]
    assert longer == [True, True, True, False, False, False]


def test_the_status_of_a_held_up_request_is_left_out_and_counted_on() -> None:
    made = bridge()
    for turn in range(20):
        assert made.see(place(T0 + 0.1 * turn)._replace(took_s=0.03)) is not None
    assert made.see(place(T0 + 2.0)._replace(took_s=0.13)) is None
    status = made.see(place(T0 + 2.1)._replace(took_s=0.03))
    assert status is not None
    assert struct.unpack_from("<q", status, 104)[0] == 22


def test_guide_pulses_go_west_and_north_where_positive_and_a_telescope_without_is_not_asked() -> None:
    data = bytearray(datagram(PULSE))
    struct.pack_into("<ii", data, 64, -300, 200)
    made = bridge(can_pulse_guide=True)
    made.hear(bytes(data), 1.0)
    # Alpaca's directions: 0 north, 1 south, 2 east, 3 west.
    assert told(made.turn(1.0)) == [
        ("pulseguide", {"Direction": "2", "Duration": "300"}),
        ("pulseguide", {"Direction": "0", "Duration": "200"}),
    ]
    without = bridge()
    without.hear(bytes(data), 1.0)
    assert without.turn(1.0) == []
    status = without.see(place(T0))
    assert status is not None
    assert status[157] == 0
    assert without.words == "the telescope has no pulse guide"


def test_a_right_ascension_that_rounds_to_24_hours_is_0() -> None:
    made = bridge()
    made.hear(datagram(SLEW, at_24=24.0 - 1e-12), 1.0)
    assert told(made.turn(1.0))[0][1]["RightAscension"] == "0.0000000000"


@pytest.mark.parametrize(("tells", "site", "holds"), [(52.0, -33.0, 52.0), (None, -33.0, -33.0)])
def test_altitudes_are_those_of_the_telescopes_latitude_or_else_of_the_sites(
    tells: float | None, site: float, holds: float
) -> None:
    facts = DeviceFacts(latitude_deg=tells, longitude_deg=4.5, primary_rates=RATES, secondary_rates=RATES)
    status = Bridge(facts, 4.5, site).see(place(T0, dec_deg=10.0))
    assert status is not None
    altitude_deg, ra_h, sidereal_h = (struct.unpack_from("<d", status, at)[0] for at in (8, 40, 56))
    latitude, dec, hour_angle = (math.radians(x) for x in (holds, 10.0, (sidereal_h - ra_h) * 15.0))
    up = math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * math.cos(hour_angle)
    assert math.sin(math.radians(altitude_deg)) == pytest.approx(up, abs=1e-12)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "told"),
    [(52.0, 4.5, (52.0, 4.5)), (52.0, None, (0.0, 0.0)), (None, 4.5, (0.0, 0.0)), (0.0, 4.5, (0.0, 4.5))],
)
def test_half_a_site_is_told_as_none(
    latitude_deg: float | None, longitude_deg: float | None, told: tuple[float, float]
) -> None:
    status = bridge(latitude_deg=latitude_deg, longitude_deg=longitude_deg).see(place(T0))
    assert status is not None
    assert struct.unpack_from("<dd", status, 72) == told


@pytest.mark.parametrize(
    ("alignment", "side", "each_time"),
    [(2, 0, True), (2, None, True), (None, 1, True), (None, None, False), (1, 0, False)],
)
def test_a_german_telescope_is_asked_for_its_side_with_each_place(
    monkeypatch: pytest.MonkeyPatch, alignment: int | None, side: int | None, each_time: bool
) -> None:
    """A side that is a second old makes another place of the axes of the same place on the sky."""
    known = {"rightascension": 1.0, "declination": 2.0, "alignmentmode": alignment, "sideofpier": side}

    async def get(_: AlpacaClient, member: str, **fields: str) -> object:
        if known.get(member) is None:
            raise AlpacaRefusalError(0x400, "not implemented")
        return known[member]

    async def asked() -> list[set[str]]:
        client = AlpacaClient(parse_alpaca("alpaca://192.0.2.9/0", resolve=False))
        await client.facts()
        return [set((await client.read()).values) for _ in range(10)]

    monkeypatch.setattr(AlpacaClient, "get", get)
    turns = asyncio.run(asked())
    assert sum("sideofpier" in turn for turn in turns) == (10 if each_time else 1)
    assert sum("slewing" in turn for turn in turns) == 5


@pytest.mark.parametrize(
    ("profile", "alignment", "says"),
    [
        ({}, 2, 'set "ascom", or slews that change the side'),
        ({}, 1, None),
        ({}, None, None),
        ({"pier_rule": "hour_angle"}, None, "in the east"),
        ({"pier_rule": "ascom"}, 2, "[-270, 270]"),
        ({"pier_rule": "ascom", "dec_axis_limits_deg": (-100.0, 230.0)}, 2, None),
    ],
)
def test_a_profile_that_does_not_fit_the_sides_of_the_pier_is_doubted(
    profile: dict[str, Any], alignment: int | None, says: str | None
) -> None:
    doubt = pier_doubt(MountProfile(**profile), DeviceFacts(alignment_mode=alignment))
    assert (doubt is None) is (says is None)
    assert says is None or (doubt is not None and says in doubt)

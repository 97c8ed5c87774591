"""A simulated mount behind the interface, in virtual time: what section 5.0 of the paper asks for."""

from __future__ import annotations

import math
from decimal import Decimal
from itertools import pairwise
from typing import Literal

import pytest
from antenna_harness import SITE, VirtualAntenna, rms
from msgspec.structs import replace

from sattrack.cli.serve_antenna import _antenna
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import AxesPosition, MountProfile, SitePlace
from sattrack.mount.simulator.mount import StartPosition
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.servers.antenna.led_mount import axis_range
from sattrack.servers.antenna.protocol import encode, to_ns
from sattrack.servers.antenna.trajectory import HaDec
from tle.instants import Utc

BEGIN_UTC_S = Utc.parse("2026-10-02T13:05:00Z").unix_s
SIDEREAL = 0.0041780746


@pytest.fixture
def antenna() -> VirtualAntenna:
    made = VirtualAntenna(BEGIN_UTC_S)
    made.run_for(1.0)
    return made


def position(antenna: VirtualAntenna) -> dict[str, str]:
    names = ["ps", "c1", "c2", "a1", "a2", "cr1", "cr2", "ar1", "ar2", "cw", "aw", "epoch", "mode", "servo"]
    return dict(zip(names, antenna.say("PS").split(), strict=True))


def altitude(antenna: VirtualAntenna) -> float:
    truth = antenna.truths[-1]
    ha = math.radians(antenna.sky.sidereal_deg(truth.utc_s) - truth.ra_deg)
    dec, latitude = math.radians(truth.dec_deg), math.radians(antenna.sky.site.latitude_deg)
    sine = math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * math.cos(ha)
    return math.degrees(math.asin(sine))


def test_a_new_source_is_slewed_to_and_joined(antenna: VirtualAntenna) -> None:
    assert antenna.say(f"TD 20 40 {SIDEREAL} 0") == "TD ACK"
    antenna.run_for(1.0)
    assert position(antenna)["servo"] == "SLEWING"
    antenna.run_for(8.0)
    told = position(antenna)
    assert told["servo"] == "TRACKING"
    assert abs(float(told["a1"]) - float(told["c1"])) * 3600.0 < 1.0
    assert abs(float(told["a2"]) - 40.0) * 3600.0 < 1.0
    antenna.say(f"TD 15 45 {SIDEREAL} 0")
    antenna.run_for(4.0)
    assert position(antenna)["servo"] == "TRACKING"


@pytest.mark.parametrize("said", ["TD 15 45", "FIXED 15 45", "STOW"])
def test_a_new_place_is_not_reached_before_the_mount_is_there(antenna: VirtualAntenna, said: str) -> None:
    """`onsource` may ask right after `source`, before any status was judged against the new trajectory."""
    antenna.say("TD 20 40 0 0")
    antenna.run_for(9.0)
    antenna.say("TD 20.001 40 0 0")
    assert position(antenna)["servo"] == "TRACKING"
    assert antenna.say(said).endswith("ACK")
    assert position(antenna)["servo"] == "SLEWING"


def test_what_position_status_tells_is_where_the_axes_are(antenna: VirtualAntenna) -> None:
    antenna.say("TD 20 40 0.5 -0.25")
    antenna.run_for(8.0)
    antenna.run_until(antenna.truths[-1].utc_s + 0.033)
    told = position(antenna)
    antenna.run_for(0.1)
    before, after = antenna.truths[-3], antenna.truths[-2]
    share = (antenna.now_utc_s - 0.1 - before.utc_s) / (after.utc_s - before.utc_s)
    dec = before.dec_deg + share * (after.dec_deg - before.dec_deg)
    assert 0.0 < share < 1.0
    assert abs(float(told["a2"]) - dec) * 3600.0 < 0.5


def test_commanded_is_the_designation_itself_to_the_last_digit(antenna: VirtualAntenna) -> None:
    second = Decimal(antenna.say("TIME").split()[2])
    first, rate, epoch = (
        Decimal("12.123456789012"),
        Decimal("0.31415926535"),
        second.quantize(Decimal("0.000001")),
    )
    antenna.say(f"TD {first} 40 {rate} 0 {epoch}")
    for _ in range(5):
        antenna.run_for(0.7071)
        told = position(antenna)
        exact = first + rate * (Decimal(told["epoch"]) - epoch)
        assert Decimal(told["c1"]) == exact.quantize(Decimal("1e-8"))


def test_a_step_of_a_tenth_of_a_beam_settles_within_half_a_second(antenna: VirtualAntenna) -> None:
    antenna.say("TD 30 30 0 0")
    antenna.run_for(9.0)
    antenna.say(f"TD 30 {30.0 + 30.0 / 3600.0:.9f} 0 0")
    began = antenna.now_utc_s
    antenna.run_for(2.0)
    off = [abs(t.dec_deg - 30.0 - 30.0 / 3600.0) * 3600.0 for t in antenna.truths if t.utc_s > began + 0.5]
    assert max(off) < 1.0


def test_a_source_designated_once_a_second_is_tracked_smoothly(antenna: VirtualAntenna) -> None:
    """Azimuth and elevation of a source bend; each second has its own rates, as antcn computes them."""
    ra, dec = antenna.sky.sidereal_deg(antenna.now_utc_s) - 20.0, 40.0
    antenna.say(f"TD 20 {dec} {SIDEREAL} 0")
    antenna.run_for(10.0)
    begun = len(antenna.truths)
    for second in range(15):
        now_ns = to_ns(antenna.now_utc_s)
        ha = antenna.sky.sidereal_deg(antenna.now_utc_s) - ra
        # What antcn knows is rounded, and moves the trajectory by 2 milliarcseconds, to and fro.
        error_deg = (-1) ** second * 5e-7
        epoch = Decimal(now_ns % (86400 * 10**9)) / 10**9
        assert antenna.say(f"TD {ha + error_deg:.9f} {dec} {SIDEREAL} 0 {epoch:.6f}") == "TD ACK"
        antenna.run_for(1.0)
        assert position(antenna)["servo"] == "TRACKING"
    truths = antenna.truths[begun:]
    off = [math.remainder(t.ra_deg - ra, 360.0) * 3600.0 for t in truths]
    assert rms(off) < 0.1
    jumps = [abs(b - a) for a, b in pairwise(off)]
    assert max(jumps) < 0.1


def test_a_trajectory_below_the_floor_is_accepted_and_picked_up_as_it_comes_out(
    antenna: VirtualAntenna,
) -> None:
    # At hour angle 0 over 52.15° north, declination -40° is 2° below the horizon; it rises 0.5° a second.
    assert antenna.say("TD 0 -40 0 0.5") == "TD ACK"
    antenna.run_for(4.0)
    antenna.say("TD 0 -40 0 0.5")
    antenna.run_for(3.0)
    assert antenna.station.tripped is None
    lowest = min(t.dec_deg for t in antenna.truths)
    assert lowest > -37.8459
    antenna.run_for(9.0)
    assert antenna.station.tripped is None
    assert position(antenna)["servo"] == "TRACKING"


def test_a_fixed_direction_outside_the_limits_is_come_near_to(antenna: VirtualAntenna) -> None:
    antenna.say("TD 0 -45 0 0")
    antenna.run_for(15.0)
    assert antenna.station.tripped is None
    assert antenna.say("STATUS").split()[5] == "1"
    assert 0.0 < altitude(antenna) < 1.0
    assert position(antenna)["servo"] == "SLEWING"


def test_a_silent_antcn_leaves_the_antenna_at_its_limit_and_not_beyond(antenna: VirtualAntenna) -> None:
    antenna.say("TD 150 60 3.0 0")
    antenna.run_for(45.0)
    assert antenna.station.tripped is None
    axis = antenna.truths[-1].hour_angle_axis_deg
    assert 195.0 < axis < 200.0
    assert position(antenna)["aw"] == "1"


@pytest.mark.parametrize("past_deg", [0.05, 0.5, 20.0])
@pytest.mark.parametrize(("said_deg", "there_deg"), [(0.0, 0.0), (59.0, 59.0), (90.0, 59.9)])
def test_an_antenna_that_the_sky_has_carried_past_its_limit_is_led_back_in(
    past_deg: float, said_deg: float, there_deg: float
) -> None:
    """To where it is wanted, or as near as its limit lets it; a mount that tracks by itself gets there."""
    start, profile = StartPosition(hour_angle_deg=60.0 + past_deg, dec_deg=40.0), MountProfile()
    antenna = VirtualAntenna(BEGIN_UTC_S, profile=replace(profile, hour_angle_limit_deg=60.0), start=start)
    antenna.run_for(1.0)
    antenna.say(f"FIXED {said_deg} 30")
    antenna.run_for(30.0)
    assert antenna.station.tripped is None
    truths = [truth.hour_angle_axis_deg for truth in antenna.truths]
    assert truths[-1] == pytest.approx(there_deg, abs=0.3 if said_deg > 60.0 else 0.01)
    assert max(truths) < 60.02 + past_deg
    assert max(truths[-400:]) < 60.0


def test_a_turn_that_a_session_before_has_left_is_counted_on(antenna: VirtualAntenna) -> None:
    """An axis at 190° is no axis at -170°: from there to 0° it turns back, not on to its limit at 200°."""
    antenna.say("FIXED -170 60 1")
    antenna.run_for(40.0)
    assert antenna.truths[-1].hour_angle_axis_deg == pytest.approx(190.0, abs=0.01)
    noted_deg = antenna.station.safety.first_axis_deg
    antenna.station = antenna.make_station()
    antenna.station.safety.begin_at(noted_deg)
    antenna.run_for(1.0)
    told = position(antenna)
    assert (told["aw"], float(told["a1"])) == ("1", pytest.approx(-170.0, abs=0.01))
    antenna.say("FIXED 0 60")
    antenna.run_for(40.0)
    assert antenna.truths[-1].hour_angle_axis_deg == pytest.approx(0.0, abs=0.01)
    assert position(antenna)["servo"] == "TRACKING"


@pytest.mark.parametrize("axes", ["hadec", "azel"])
def test_the_shortest_way_is_counted_from_where_the_axis_was_heard_last(
    antenna: VirtualAntenna, axes: str
) -> None:
    """Statuses are missing for a moment as the command comes, and the axis is at 190°."""
    antenna.say("FIXED -170 60 1")
    antenna.run_for(40.0)
    there = "-175 60"
    if axes == "azel":
        antenna.axes, wound_deg = axes, antenna.station.safety.first_axis_deg
        antenna.station = antenna.make_station()
        antenna.station.safety.begin_at(wound_deg)
        place = antenna.sky.horizontal(HaDec(-175.0, 60.0), antenna.now_utc_s)
        there = f"{place.az_deg:.4f} {place.el_deg:.4f}"
    antenna.say("STOP")
    antenna.run_for(3.0)
    antenna.silent_until_s = antenna.now_utc_s + 0.6
    antenna.run_for(0.5)
    begun = len(antenna.truths)
    assert antenna.say(f"FIXED {there}") == "FIXED ACK"
    antenna.run_for(10.0)
    turned = [truth.hour_angle_axis_deg for truth in antenna.truths[begun:]]
    assert min(turned) > 184.0
    assert turned[-1] == pytest.approx(185.0, abs=0.01)


def test_stop_brings_the_antenna_to_rest(antenna: VirtualAntenna) -> None:
    antenna.say("TD 0 40 0 0")
    antenna.run_for(2.0)
    assert antenna.say("STOP") == "STOP ACK"
    antenna.run_for(4.0)
    told = position(antenna)
    assert told["servo"] == "IDLE"
    assert told["c1"] == ",,"
    assert abs(float(told["ar1"])) <= 0.0042
    assert abs(float(told["ar2"])) < 1e-4
    assert antenna.station.session.stopped


@pytest.mark.parametrize("reports", ["axes", "sky"])
def test_a_mount_with_a_geometry_is_stowed_where_its_profile_parks_it(
    reports: Literal["axes", "sky"],
) -> None:
    """Park is in angles of its own axes, and positions are hour angles and declinations."""
    profile = MountProfile(
        additive=False,
        park=AxesPosition(20.0, 50.0),
        geometry=AxisGeometry(0.0, 90.0, reports=reports),
        stands_at=SitePlace(SITE.latitude_deg, SITE.longitude_deg),
    )
    options = {"axes": "hadec", "stow": None, "service": None, "refraction": "off", "crc": False}
    stow = _antenna(options, profile, SITE, None).stow
    antenna = VirtualAntenna(BEGIN_UTC_S, profile=profile, start=StartPosition(10.0, 40.0), stow=stow)
    antenna.run_for(1.0)
    assert antenna.say("STOW") == "STOW ACK"
    antenna.run_for(15.0)
    truth = antenna.truths[-1]
    assert (truth.hour_angle_axis_deg, truth.dec_axis_deg) == pytest.approx((20.0, 50.0), abs=0.01)
    assert position(antenna)["servo"] == "TRACKING"


def test_local_ends_the_trajectory_and_refuses_another(antenna: VirtualAntenna) -> None:
    antenna.say("TD 0 40 0 0")
    antenna.run_for(2.0)
    antenna.station.controller.switch(False, to_ns(antenna.now_utc_s))
    antenna.run_for(4.0)
    assert antenna.station.session.stopped
    assert antenna.say("TD 0 40 0 0") == "TD NAK 8"
    assert position(antenna)["mode"] == "LOCAL"


def designate_for(antenna: VirtualAntenna, seconds: int) -> set[str]:
    """Let antcn designate a source to the east once a second; return what it was answered."""
    answers = set()
    for _ in range(seconds):
        answers.add(antenna.say(f"TD -40 40 {SIDEREAL} 0"))
        antenna.run_for(1.0)
    return answers


@pytest.mark.parametrize("said", ["STOP", "RESET", "FIXED 0 40", "nothing", "remote", "reset"])
def test_the_operators_stop_holds_for_an_antcn_that_goes_on(antenna: VirtualAntenna, said: str) -> None:
    controller = antenna.station.controller
    assert designate_for(antenna, 3) == {"TD ACK"}
    controller.stop(to_ns(antenna.now_utc_s))
    antenna.run_for(0.5)
    begun = len(antenna.truths)
    assert designate_for(antenna, 15) == {"TD NAK 8"}
    axes = [truth.hour_angle_axis_deg for truth in antenna.truths[begun + 40 :]]
    assert max(axes) - min(axes) < 0.1
    assert antenna.station.session.stopped
    if said == "remote":
        controller.switch(True, to_ns(antenna.now_utc_s))
    elif said == "reset":
        controller.reset()
    elif said == "nothing":
        antenna.run_for(10.0)
    else:
        assert antenna.say(said).endswith("ACK")
    assert designate_for(antenna, 1) == {"TD ACK"}


def test_after_an_interlock_nothing_moves_until_reset(antenna: VirtualAntenna) -> None:
    antenna.say("TD 40 20 0 0")
    antenna.run_for(3.0)
    antenna.station.safety._trip("obedience")
    antenna.run_for(2.0)
    assert "obedience" in antenna.say("STATUS")
    assert antenna.say("TD 45 20 0 0") == "TD ACK"
    antenna.run_for(2.0)
    assert antenna.station.session.stopped
    assert antenna.say("RESET") == "RESET ACK"
    antenna.run_for(0.5)
    assert antenna.say("STATUS").split()[4] == "OK"
    antenna.say("TD 45 20 0 0")
    antenna.run_for(4.0)
    assert position(antenna)["servo"] == "TRACKING"


def test_an_end_brings_the_mount_to_rest_first(antenna: VirtualAntenna) -> None:
    antenna.say("TD 0 40 0.5 0")
    antenna.run_for(3.0)
    antenna.station.end(antenna.now_utc_s)
    assert not antenna.station.finished
    antenna.run_for(3.0)
    assert antenna.station.finished
    assert antenna.station.mount_stopped


@pytest.mark.parametrize("said", ["TD 0 40", "FIXED 0 40", "STOW", "RESET", "TIME 20728 47000", "FOCUS 1"])
def test_nothing_is_taken_while_the_service_ends(antenna: VirtualAntenna, said: str) -> None:
    antenna.say("TD 0 40 0.5 0")
    antenna.run_for(3.0)
    antenna.station.end(antenna.now_utc_s)
    antenna.run_for(0.1)
    assert antenna.say(said) == f"{said.split(maxsplit=1)[0]} NAK 8"
    assert antenna.say("STOP") == "STOP ACK"
    told = position(antenna)
    assert (told["c1"], told["servo"]) == (",,", "IDLE")
    assert float(told["ar1"]) < -1.0
    antenna.run_for(3.0)
    assert antenna.station.mount_stopped


def test_an_end_without_any_motion_asks_nothing_of_the_mount(antenna: VirtualAntenna) -> None:
    antenna.station.end(antenna.now_utc_s)
    antenna.run_for(0.2)
    assert antenna.station.finished
    assert antenna.station.mount_stopped is None


def test_azimuth_and_elevation_are_followed_where_positions_are_those() -> None:
    antenna = VirtualAntenna(BEGIN_UTC_S, axes="azel")
    antenna.run_for(1.0)
    antenna.say("TD 200 45 0.1 0.05")
    antenna.run_for(9.0)
    told = position(antenna)
    assert told["servo"] == "TRACKING"
    assert abs(float(told["a1"]) - float(told["c1"])) * 3600.0 < 2.0
    assert abs(float(told["a2"]) - float(told["c2"])) * 3600.0 < 2.0
    assert float(told["ar1"]) == pytest.approx(0.1, abs=0.01)


def test_a_mount_that_takes_rates_by_edges_is_followed_with_too() -> None:
    antenna = VirtualAntenna(BEGIN_UTC_S, profile=MountProfile(move_axis="edge"))
    antenna.run_for(1.0)
    antenna.say(f"TD 40 25 {SIDEREAL} 0")
    antenna.run_for(12.0)
    told = position(antenna)
    assert abs(float(told["a1"]) - float(told["c1"])) * 3600.0 < 5.0
    assert antenna.station.tripped is None


def test_a_source_by_coordinates_stands_still_against_the_sky(antenna: VirtualAntenna) -> None:
    ra = antenna.sky.sidereal_deg(antenna.now_utc_s) - 40.0
    assert antenna.say(f"RADEC DATE {ra:.6f} 25 S") == "RADEC ACK"
    antenna.run_for(8.0)
    truth = antenna.truths[-1]
    assert abs(math.remainder(truth.ra_deg - ra, 360.0)) * 3600.0 < 1.0
    assert abs(truth.dec_deg - 25.0) * 3600.0 < 1.0
    antenna.say("OFFSET RADEC 0.1 -0.2")
    antenna.run_for(3.0)
    truth = antenna.truths[-1]
    assert abs(math.remainder(truth.ra_deg - ra - 0.1, 360.0)) * 3600.0 < 1.0
    assert abs(truth.dec_deg - 24.8) * 3600.0 < 1.0


def test_a_clock_that_is_set_is_gone_by_from_then_on(antenna: VirtualAntenna) -> None:
    before = antenna.say("TIME").split()
    assert antenna.say(f"TIME {before[1]} {float(before[2]) + 3.0:.6f}") == "TIME ACK"
    antenna.run_for(2.0)
    assert float(antenna.say("TIME").split()[2]) == pytest.approx(float(before[2]) + 5.0, abs=1e-5)
    # Its sidereal time has gone on with it: a source stands 3 s further west.
    ra = antenna.sky.sidereal_deg(antenna.now_utc_s) - 40.0
    antenna.say(f"RADEC DATE {ra:.6f} 25 S")
    assert float(position(antenna)["c1"]) == pytest.approx(40.0 + 3.0 * SIDEREAL, abs=1e-5)
    antenna.run_for(6.0)
    assert position(antenna)["servo"] == "TRACKING"
    assert antenna.station.tripped is None


def set_time(antenna: VirtualAntenna, step_s: float) -> None:
    day, second = antenna.say("TIME").split()[1:]
    days, seconds = divmod(float(second) + step_s, 86400.0)
    assert antenna.say(f"TIME {int(day) + days:.0f} {seconds:.6f}") == "TIME ACK"


def test_what_comes_at_once_with_a_new_time_is_by_that(antenna: VirtualAntenna) -> None:
    """antcn need not wait for a response, and several lines may come as one packet."""
    day, second = antenna.say("TIME").split()[1:]
    later = f"{float(second) + 30.0:.6f}"
    for epoch in ("", f" {later}"):
        said = (f"TIME {day} {later}", "TIME", f"TD 20 40 1 0{epoch}")
        lines = b"".join(encode(one) for one in said)
        answers, _ = antenna.station.receive_command(lines, antenna.now_utc_s)
        assert answers.split(b"\n")[1].startswith(f"TIME {day} {later} ".encode())
        assert float(position(antenna)["c1"]) == pytest.approx(20.0, abs=1e-4)
        antenna.say("STOP")
    said = ("STOP", f"TIME {day} {float(second) + 7200.0:.6f}", f"TD 20 40 1 0 {float(second) + 7200.0:.6f}")
    answers, _ = antenna.station.receive_command(b"".join(encode(one) for one in said), antenna.now_utc_s)
    assert answers.split(b"\n")[2].startswith(b"TD ACK")


@pytest.mark.parametrize("after_s", [0.0, 5.0])
@pytest.mark.parametrize("step_s", [-50000.0, -90.0, -0.7, 0.7, 90.0])
def test_a_stopped_antenna_is_seen_stopped_whatever_its_clock_is_set_to(
    antenna: VirtualAntenna, after_s: float, step_s: float
) -> None:
    antenna.say("TD 0 40 0 0")
    antenna.run_for(3.0)
    antenna.say("STOP")
    antenna.run_for(after_s)
    set_time(antenna, step_s)
    antenna.run_for(5.0)
    assert antenna.station.session.stopped
    antenna.station.end(antenna.now_utc_s)
    antenna.run_for(1.0)
    assert antenna.station.finished
    assert antenna.station.mount_stopped is True


def test_an_antenna_is_ready_again_once_its_clock_is_set_right(antenna: VirtualAntenna) -> None:
    """The clock's interlock stops it while its clock is ten minutes ahead of the mount's."""
    set_time(antenna, 600.0)
    antenna.run_for(1.0)
    antenna.say("TD 0 40 0 0")
    antenna.run_for(2.0)
    assert antenna.say("STATUS").split()[4] == "clock"
    antenna.say("STOP")
    set_time(antenna, -600.0)
    antenna.say("RESET")
    antenna.run_for(2.0)
    assert antenna.say("STATUS").split()[4] == "OK"
    antenna.say("TD 0 40 0 0")
    antenna.run_for(15.0)
    assert position(antenna)["servo"] == "TRACKING"


def test_a_mount_that_falls_silent_is_told_of_stopped_and_taken_up_again_after_reset(
    antenna: VirtualAntenna,
) -> None:
    antenna.say("TD 45 20 0.2 0.1")
    antenna.run_for(4.0)
    antenna.silent_until_s = antenna.now_utc_s + 6.0
    antenna.run_for(1.0)
    assert position(antenna)["a1"] == ",,"
    antenna.run_for(4.0)
    assert antenna.say("STATUS").split()[3:5] == ["LINK-DOWN", "status_age"]
    antenna.run_for(4.0)
    assert antenna.say("STATUS").split()[3] == "LINK-UP"
    assert antenna.station.session.stopped
    antenna.say("RESET")
    antenna.run_for(0.5)
    antenna.say("TD 45 20 0 0")
    antenna.run_for(5.0)
    assert position(antenna)["servo"] == "TRACKING"


@pytest.mark.parametrize("move_axis", ["held", "edge"])
def test_a_mount_that_restarts_on_its_way_is_not_led_by_what_it_has_forgotten(
    move_axis: Literal["held", "edge"],
) -> None:
    antenna = VirtualAntenna(BEGIN_UTC_S, profile=MountProfile(move_axis=move_axis))
    antenna.run_for(1.0)
    mount, status = antenna._wires.mount, antenna.station.session.status
    assert status is not None
    # Another program syncs it: its hour angle is 20° less than its axis' from then on.
    sync = Command(1, sync=True, target_ra_h=status.ra_h + 20.0 / 15.0, target_dec_deg=status.dec_deg)
    mount.receive(encode_command(sync))
    mount.tick(antenna.now_utc_s)
    antenna.run_for(1.0)
    antenna.say("TD 20 40 0 0")
    antenna.run_for(15.0)
    assert position(antenna)["servo"] == "TRACKING"
    axis_deg = antenna.truths[-1].hour_angle_axis_deg
    assert axis_deg == pytest.approx(40.0, abs=0.01)
    mount.restart(antenna.now_utc_s)
    antenna.run_for(4.0)
    assert antenna.say("TD 20 40 0 0") == "TD ACK"
    antenna.run_for(4.0)
    assert antenna.say("STATUS").split()[4] == "restart"
    assert position(antenna)["servo"] == "IDLE"
    assert antenna.truths[-1].hour_angle_axis_deg == pytest.approx(axis_deg, abs=0.2)
    antenna.say("RESET")
    antenna.run_for(1.0)
    antenna.say("TD 20 40 0 0")
    antenna.run_for(15.0)
    assert antenna.say("STATUS").split()[4] == "OK"
    assert antenna.truths[-1].hour_angle_axis_deg == pytest.approx(20.0, abs=0.01)


def test_the_axes_limits_are_those_of_the_mounts_profile() -> None:
    profile = MountProfile(hour_angle_limit_deg=120.0, dec_axis_limits_deg=(-30.0, 190.0))
    limits = axis_range(profile, "hadec")
    assert (limits.first_least_deg, limits.first_most_deg) == (-120.0, 120.0)
    assert (limits.second_least_deg, limits.second_most_deg) == (-30.0, 89.9)
    # Of both turns only one is within them.
    assert limits.shortest_turns(230.0, 110.0) == -1


def test_sensors_tell_the_currents_of_the_drives_and_no_tilts(antenna: VirtualAntenna) -> None:
    antenna.say("TD 20 40 0.5 -0.25")
    antenna.run_for(1.0)
    status = antenna.station.session.status
    assert status is not None
    told = antenna.say("SENSORS").split()
    assert told[:3] == ["SENSORS", ",,", ",,"]
    # The mount tells them in hundredths of an ampere.
    assert Decimal(told[3]) == Decimal(status.ra_current_10ma) / 100
    assert Decimal(told[4]) == Decimal(status.dec_current_10ma) / 100
    assert told[5] == position(antenna)["epoch"]


def test_sensors_of_a_mount_that_is_not_heard_are_not_told() -> None:
    assert VirtualAntenna(BEGIN_UTC_S).say("SENSORS") == "SENSORS NAK 9"

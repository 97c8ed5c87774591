"""A simulated mount behind rotctld, in virtual time: where its axes really go."""

from __future__ import annotations

import math

import pytest
import rotctld as bench
from rotctld_harness import VirtualRotator

from sattrack.mount.model import AxesPosition, MountProfile
from sattrack.runtime.connection import Connection
from sattrack.runtime.system import StopRequest
from sattrack.safety import SafetyLimits
from sattrack.safety.bodies import sun_over
from sattrack.servers.antenna.trajectory import HaDec
from sattrack.servers.rotctld.serve import RotctldLoop
from tle.instants import Utc

BEGIN_UTC_S = Utc.parse("2026-10-02T13:05:00Z").unix_s
PARKS = MountProfile(park=AxesPosition(hour_angle_deg=10.0, dec_deg=70.0))


@pytest.fixture
def rotator() -> VirtualRotator:
    made = VirtualRotator(BEGIN_UTC_S, profile=PARKS)
    made.run_for(1.0)
    return made


def told(rotator: VirtualRotator) -> tuple[float, float]:
    az, el = rotator.say("p").split()
    return float(az), float(el)


def moved_deg(rotator: VirtualRotator, since: int) -> float:
    """Return how far the axes went since a sample, against the ground."""
    first, last = rotator.truths[since], rotator.truths[-1]
    return math.hypot(last.hour_angle_axis_deg - first.hour_angle_axis_deg, last.dec_deg - first.dec_deg)


def test_a_position_is_gone_to_and_stood_at(rotator: VirtualRotator) -> None:
    assert rotator.say("P 200.5 45.25") == "RPRT 0\n"
    assert "MOVING" in rotator.say("s") or not rotator.run_for(0.5)
    rotator.run_for(15.0)
    assert rotator.pointed() == pytest.approx((200.5, 45.25), abs=2.0 / 3600.0)
    assert told(rotator) == (200.5, 45.25)
    # Against the ground, whatever the sky does.
    since = len(rotator.truths)
    rotator.run_for(10.0)
    assert moved_deg(rotator, since) < 2.0 / 3600.0
    assert rotator.say("s") == "\n"


def test_a_pass_at_one_hertz_is_followed_without_jerks() -> None:
    span = (BEGIN_UTC_S - 15.0, BEGIN_UTC_S + 20.0)
    smooth = bench.follow(begin_utc_s=span[0], end_utc_s=span[1])
    straight = bench.follow(make=bench.Steps, begin_utc_s=span[0], end_utc_s=span[1])
    # A hundredth of a degree is 36″; a step of this pass is up to 0.97°.
    assert smooth.rms_arcsec < 36.0
    assert straight.rms_arcsec > 30.0 * smooth.rms_arcsec
    assert smooth.jerk_deg_s2 < 0.5
    assert straight.jerk_deg_s2 > 10.0 * smooth.jerk_deg_s2


def test_a_turn_that_a_session_before_has_left_is_counted_on(rotator: VirtualRotator) -> None:
    """An axis at 190° is no axis at -170°: from there to 0° it turns back, not on to its limit at 200°."""
    for hour_angle_deg in (100.0, 190.0):
        place = rotator.sky.horizontal(HaDec(hour_angle_deg, 60.0), rotator.now_utc_s)
        rotator.say(f"P {place.az_deg:.3f} {place.el_deg:.3f}")
        rotator.run_for(40.0)
    assert rotator.truths[-1].hour_angle_axis_deg == pytest.approx(190.0, abs=0.1)
    noted_deg = rotator.station.safety.first_axis_deg
    rotator.station = rotator.make_station()
    rotator.station.safety.begin_at(noted_deg)
    rotator.clients.clear()
    rotator.run_for(1.0)
    place = rotator.sky.horizontal(HaDec(0.0, 60.0), rotator.now_utc_s)
    rotator.say(f"P {place.az_deg:.3f} {place.el_deg:.3f}")
    rotator.run_for(40.0)
    assert rotator.truths[-1].hour_angle_axis_deg == pytest.approx(0.0, abs=0.1)


def test_stop_brings_the_mount_to_rest(rotator: VirtualRotator) -> None:
    rotator.say("P 300 30")
    rotator.run_for(2.0)
    assert rotator.say("S") == "RPRT 0\n"
    rotator.run_for(4.0)
    assert rotator.station.session.stopped
    since = len(rotator.truths)
    rotator.run_for(10.0)
    # It may track the sky, as mounts do by themselves.
    assert moved_deg(rotator, since) < 0.05


def test_anybody_may_stop_whoever_commands() -> None:
    rotator = VirtualRotator(BEGIN_UTC_S, one_at_a_time=True)
    rotator.run_for(1.0)
    assert rotator.say("P 300 30", client=1) == "RPRT 0\n"
    rotator.run_for(1.0)
    assert rotator.say("P 100 30", client=2) == "RPRT -9\n"
    assert rotator.say("S", client=2) == "RPRT 0\n"
    rotator.run_for(4.0)
    assert rotator.station.session.stopped


def test_park_slews_to_the_profiles_position_and_leaves_the_power_on(rotator: VirtualRotator) -> None:
    assert rotator.say("K") == "RPRT 0\n"
    rotator.run_for(25.0)
    truth = rotator.truths[-1]
    # The simulated mount's clock is of mean sidereal time, and of UTC.
    assert truth.hour_angle_axis_deg == pytest.approx(10.0, abs=0.005)
    assert truth.dec_deg == pytest.approx(70.0, abs=0.001)
    status = rotator.station.session.status
    assert status is not None
    assert not status.at_park
    # It still goes where it is sent.
    assert rotator.say("P 200 45") == "RPRT 0\n"
    rotator.run_for(20.0)
    assert told(rotator) == (200.0, 45.0)


def test_a_move_goes_on_for_ten_seconds_at_its_speed(rotator: VirtualRotator) -> None:
    rotator.say("P 180 40")
    rotator.run_for(20.0)
    assert rotator.say("M UP 25") == "RPRT 0\n"
    rotator.run_for(5.0)
    assert told(rotator)[1] == pytest.approx(42.5, abs=0.1)
    rotator.run_for(10.0)
    assert told(rotator) == pytest.approx((180.0, 45.0), abs=0.02)
    assert rotator.say("M LEFT 50") == "RPRT 0\n"
    rotator.run_for(15.0)
    assert told(rotator) == pytest.approx((170.0, 45.0), abs=0.02)


def test_a_move_downward_is_held_at_the_limit_of_altitude(rotator: VirtualRotator) -> None:
    rotator.say("P 180 10")
    rotator.run_for(20.0)
    rotator.say("M DOWN 100")
    rotator.run_for(15.0)
    assert rotator.station.tripped is None
    assert 0.0 < rotator.pointed().el_deg < 1.0


def test_a_position_in_the_sun_is_come_near_to_and_no_nearer() -> None:
    noon = Utc.parse("2026-10-02T11:30:00Z").unix_s
    rotator = VirtualRotator(noon, limits=SafetyLimits())
    rotator.run_for(1.0)
    site = rotator.sky.site
    body = sun_over(site.latitude_deg, site.longitude_deg).at(noon)
    sun = rotator.sky.horizontal(HaDec(math.remainder(body.hour_angle_deg, 360.0), body.dec_deg), noon)
    assert rotator.say(f"P {sun.az_deg:.2f} {sun.el_deg:.2f}") == "RPRT 0\n"
    nearest_deg = 180.0
    log: list[str] = []
    loop = RotctldLoop(Connection(None, None), StopRequest(), rotator.station, None, log.append)
    for _ in range(40):
        rotator.run_for(0.5)
        here = rotator.pointed()
        across = math.remainder(here.az_deg - sun.az_deg, 360.0) * math.cos(math.radians(sun.el_deg))
        nearest_deg = min(nearest_deg, math.hypot(across, here.el_deg - sun.el_deg))
        loop.report_mount("position", "R")
    assert "a limit keeps the antenna off its position: sun" in log
    assert nearest_deg > SafetyLimits().sun_deg - 1.0
    assert rotator.station.tripped is None


def test_a_client_that_is_gone_in_mid_slew_leaves_the_mount_to_its_end(rotator: VirtualRotator) -> None:
    rotator.say("P 300 60")
    rotator.run_for(1.0)
    rotator.hang_up()
    rotator.run_for(25.0)
    assert rotator.pointed() == pytest.approx((300.0, 60.0), abs=0.001)


def test_a_client_that_is_gone_in_mid_pass_leaves_the_mount_standing_soon(rotator: VirtualRotator) -> None:
    for second in range(24):
        rotator.say(f"P {100.0 + 0.8 * second:.2f} {40.0 + 0.3 * second:.2f}")
        rotator.run_for(1.0)
    assert told(rotator)[0] == pytest.approx(119.2, abs=0.05)
    rotator.hang_up()
    rotator.run_for(4.5)
    since = len(rotator.truths)
    rotator.run_for(10.0)
    assert moved_deg(rotator, since) < 0.01
    # Three seconds and a second of coming to rest after it asked last, at 0.8°/s.
    assert rotator.pointed().az_deg == pytest.approx(119.2 + 0.8 * 3.5, abs=0.1)


def test_after_an_interlock_positions_are_rejected_until_reset(rotator: VirtualRotator) -> None:
    rotator.say("P 200 45")
    rotator.run_for(5.0)
    rotator.station.safety._trip("obedience")
    rotator.run_for(4.0)
    assert rotator.say("P 210 45") == "RPRT -9\n"
    assert rotator.station.session.stopped
    assert rotator.say("R 1") == "RPRT 0\n"
    rotator.run_for(1.0)
    assert rotator.say("P 210 45") == "RPRT 0\n"
    rotator.run_for(15.0)
    assert told(rotator) == (210.0, 45.0)


def test_a_mount_that_restarts_on_its_way_is_stopped_until_reset(rotator: VirtualRotator) -> None:
    rotator.say("P 300 30")
    rotator.run_for(2.0)
    rotator._wires.mount.restart(rotator.now_utc_s)
    rotator.run_for(3.0)
    stood = len(rotator.truths)
    for _ in range(10):
        assert rotator.say("P 300 30") == "RPRT -9\n"
        rotator.run_for(1.0)
    assert moved_deg(rotator, stood) < 0.1
    rotator.say("R 1")
    rotator.run_for(1.0)
    assert rotator.say("P 300 30") == "RPRT 0\n"


def test_a_mount_that_falls_silent_is_an_error_to_clients() -> None:
    rotator = VirtualRotator(BEGIN_UTC_S)
    assert rotator.say("p") == "RPRT -6\n"
    assert rotator.say("P 10 20") == "RPRT -6\n"
    rotator.run_for(1.0)
    rotator.silent_until_s = rotator.now_utc_s + 5.0
    rotator.run_for(3.0)
    assert rotator.say("p") == "RPRT -6\n"


def test_an_elevation_past_the_zenith_is_the_other_way_up(rotator: VirtualRotator) -> None:
    assert rotator.say("P 20 135") == "RPRT 0\n"
    rotator.run_for(20.0)
    assert rotator.pointed() == pytest.approx((200.0, 45.0), abs=0.001)
    assert told(rotator) == (20.0, 135.0)


def test_an_end_brings_the_mount_to_rest_first(rotator: VirtualRotator) -> None:
    rotator.say("P 300 60")
    rotator.run_for(1.0)
    rotator.station.end(rotator.now_utc_s)
    rotator.run_for(3.0)
    assert rotator.station.finished
    assert rotator.station.mount_stopped

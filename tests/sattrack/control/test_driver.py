"""The stop at the end, and what is told of sites and mounts, by hand; whole stops are in `test_link_loss`."""

from __future__ import annotations

import math
from types import SimpleNamespace as Made
from typing import Any

import pytest
from msgspec.structs import replace

from sattrack.control.driver import (
    DirectStop,
    Driver,
    StopProcedure,
    limit_text,
    sample_by_axes,
    site_warnings,
)
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.link_loss import OVERTAKEN_SHARE, STOPS_MOVING_S, STOPS_SENT_S
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    MountProfile,
    MoveAxes,
    SitePlace,
    Slew,
    Status,
    StatusSample,
    Stop,
    mean_sidereal_deg,
)
from sattrack.mount.xerxes.datagrams import decode_command, encode_status
from sattrack.mount.xerxes.link import LinkState
from sattrack.mount.xerxes.session import Session
from sattrack.safety import Safety, SafetyLimits
from tle.site import Site

NOW, SITE = 1_790_000_000.0, Site(52.0, 4.5, 0.0)
UP, STALE, LOST = LinkState.UP, LinkState.STALE, LinkState.LOST


def session(stopped: bool = True, link: LinkState = UP, heard: bool = True, overtaken_s: float = 0.0) -> Any:
    """Return a session as it is seen by a stop."""
    return Made(
        link_state=lambda _: link,
        stopped=stopped,
        sample=Made(arrival_utc_s=NOW) if heard else None,
        health=Made(overtaken_s=overtaken_s),
    )


def looked(stop: StopProcedure, one: Any, after_s: float) -> bool:
    """Look at a stop just after a status has come, if any does; tell whether it is over."""
    if one.sample is not None:
        one.sample.arrival_utc_s = NOW + after_s - 0.01
    return stop.look(one, NOW + after_s)


def looked_at(stop: StopProcedure, one: Any, until_s: float, since_s: float = 0.0) -> bool:
    """Look at a stop twice a second and at the end of a span; tell whether it is over."""
    for half in range(math.ceil(2.0 * since_s), math.ceil(2.0 * until_s)):
        looked(stop, one, half / 2.0)
    return looked(stop, one, until_s)


class TestTheStopAtTheEnd:
    def test_it_is_over_a_quarter_of_a_second_after_rest(self) -> None:
        stop = StopProcedure(NOW)
        assert (stop.finished, stop.at_rest) == (False, None)
        assert not looked(stop, session(stopped=False), 1.0)
        assert not looked(stop, session(), 2.0)
        assert not looked(stop, session(), 2.24)
        assert looked(stop, session(), 2.26)
        assert (stop.finished, stop.at_rest) == (True, True)

    def test_unless_it_is_blind_it_does_not_wait_for_what_was_never_heard(self) -> None:
        stop = StopProcedure(NOW)
        assert looked(stop, session(stopped=False, heard=False), 0.3)
        assert stop.at_rest is None

    @pytest.mark.parametrize("other", [session(stopped=False), session(link=LOST)])
    def test_rest_that_is_not_seen_on_begins_anew(self, other: Any) -> None:
        stop = StopProcedure(NOW)
        looked(stop, session(), 1.0)
        looked(stop, other, 1.2)
        assert not looked(stop, session(), 1.3)
        assert not looked(stop, session(), 1.5)
        assert looked(stop, session(), 1.6)

    def test_one_status_that_says_rest_is_not_enough_however_long_ago(self) -> None:
        stop, one = StopProcedure(NOW), session()
        looked(stop, one, 1.0)
        for tenth in range(11, 29):
            assert not stop.look(one, NOW + tenth / 10.0)
        assert looked(stop, one, 2.9)
        assert stop.at_rest is True

    @pytest.mark.parametrize("every_s", [0.35, 0.5, 1.0, 1.9])
    def test_a_mount_that_is_heard_seldom_is_seen_at_rest_by_its_second_status(self, every_s: float) -> None:
        stop, one = StopProcedure(NOW), session(link=STALE)
        assert not looked(stop, one, 1.0)
        assert not stop.look(one, NOW + 1.0 + 0.95 * every_s)
        assert looked(stop, one, 1.0 + every_s)
        assert stop.at_rest is True

    def test_where_datagrams_were_overtaken_it_lasts_longer(self) -> None:
        late = session(overtaken_s=2.0)
        stop = StopProcedure(NOW)
        looked(stop, late, 0.1)
        assert not looked(stop, late, 2.0 * OVERTAKEN_SHARE - 0.01)
        assert looked(stop, late, 2.0 * OVERTAKEN_SHARE + 0.01)

    @pytest.mark.parametrize(
        ("link", "within_s"), [(UP, STOPS_MOVING_S), (STALE, STOPS_MOVING_S), (LOST, STOPS_SENT_S)]
    )
    def test_a_mount_that_does_not_rest_is_given_up(self, link: LinkState, within_s: float) -> None:
        stop, moving = StopProcedure(NOW), session(stopped=False, link=link)
        assert not looked_at(stop, moving, within_s - 0.1)
        assert looked(stop, moving, within_s + 0.1)
        assert stop.at_rest is False
        # Seen at rest later, it is.
        assert looked(stop, session(), within_s + 1.0)
        assert stop.at_rest is False
        assert looked(stop, session(), within_s + 1.3)
        assert stop.at_rest is True

    @pytest.mark.parametrize("leap_s", [25.0, 3600.0, -3600.0])
    def test_what_the_machine_slept_or_its_clock_was_set_by_does_not_count(self, leap_s: float) -> None:
        stop, moving = StopProcedure(NOW), session(stopped=False, link=LOST)
        assert not looked_at(stop, moving, 3.0)
        over_s = leap_s + STOPS_SENT_S
        assert not looked_at(stop, moving, over_s - 0.1, since_s=leap_s + 3.0)
        assert looked(stop, moving, over_s + 0.1)
        assert stop.at_rest is False

    @pytest.mark.parametrize(
        ("needed", "blind", "heard", "within_s", "at_rest"),
        [
            (False, False, True, 0.25, None),
            (False, True, False, 0.25, None),
            (True, False, False, 0.25, None),
            (True, True, False, STOPS_MOVING_S, None),
            (True, False, True, STOPS_MOVING_S, False),
        ],
    )
    def test_what_was_never_set_going_is_not_waited_for(
        self, needed: bool, blind: bool, heard: bool, within_s: float, at_rest: bool | None
    ) -> None:
        stop, moving = StopProcedure(NOW, needed, blind), session(stopped=False, heard=heard)
        assert not looked_at(stop, moving, within_s - 0.01)
        assert looked(stop, moving, within_s + 0.01)
        assert stop.at_rest is at_rest
        for after_s in (1.0, 2.0):
            looked(stop, session(), within_s + after_s)
        assert stop.at_rest is (True if needed else None)


def heard(one: Driver, number: int, at_s: float = NOW, turned_deg: float = 0.0, **changes: Any) -> None:
    """Have a driver take a status of a mount an hour past the meridian, turned on by so much since."""
    sidereal_h = mean_sidereal_deg(at_s, SITE.longitude_deg) % 360.0 / 15.0
    ra_h = (sidereal_h - 1.0 - turned_deg / 15.0) % 24.0
    status = Status(counter=number, sidereal_h=sidereal_h, ra_h=ra_h, dec_deg=20.0, altitude_deg=50.0)
    one.receive(encode_status(replace(status, **changes)), at_s)


class TestDirectStop:
    def test_it_goes_on_with_the_numbers_of_whoever_is_gone(self) -> None:
        one = DirectStop(MountProfile(), NOW, counter=41)
        sent = decode_command(one.tick(NOW + 0.05))
        assert (sent.counter, sent.abort) == (42, True)
        assert one.repeat() is None

    def test_it_sends_no_abort_before_one_that_was_acknowledged_acts(self) -> None:
        one = DirectStop(MountProfile(), NOW, counter=41, acts_in_s=0.2)
        sent = [decode_command(one.tick(NOW + 0.05 * tick)) for tick in range(1, 7)]
        assert [command.abort for command in sent] == [False] * 3 + [True] * 3
        assert not any(command.move_ra or command.move_dec or command.slew for command in sent)

    def test_it_tells_when_the_mount_was_last_heard_and_what_it_did(self) -> None:
        one = DirectStop(MountProfile(), NOW)
        assert one.last_heard(NOW + 5.0) == "the mount has not been heard since"
        # 2^26 tics a turn: 186414 of them a degree; told in tenths a second.
        for number in range(1, 4):
            at_s = NOW + 0.05 * number
            heard(one, number, at_s, 0.025 * number, ra_rate_dtics_s=932068, dec_rate_dtics_s=-1864135)
        last_s = NOW + 0.15
        moving = "moving at 0.500 and -1.000 °/s (hour angle, declination)"
        assert one.last_heard(last_s + 0.9) == f"last heard now, {moving}"
        for later_s, seconds in ((1.1, 1), (3.2, 3)):
            assert one.last_heard(last_s + later_s) == f"last heard {seconds} s ago, {moving}"

    def test_a_mount_that_stands_is_told_to_be_at_rest(self) -> None:
        one = DirectStop(MountProfile(), NOW)
        for number in range(1, 60):
            heard(one, number, NOW + 0.05 * number)
        assert one.last_heard(NOW + 3.0) == "last heard now, at rest"

    def test_positions_that_repeat_from_the_first_on_are_no_rest_so_soon(self) -> None:
        """What it did before is not known: its encoders may hang while it moves on."""
        one = DirectStop(MountProfile(), NOW)
        for number in range(1, 31):
            heard(one, number, NOW + 0.05 * number, ack_abort=number > 3)
            one.tick(NOW + 0.05 * number + 0.01)
        assert "at rest" not in one.last_heard(NOW + 1.5)
        assert not one.finished

    def test_it_can_be_given_its_whole_time_again(self) -> None:
        one = DirectStop(MountProfile(), NOW)
        for tick in range(20 * int(STOPS_SENT_S + STOPS_MOVING_S)):
            one.tick(NOW + 0.05 * tick)
        assert one.finished
        one.renew(NOW + 100.0)
        assert (one.finished, one.stop.begun_utc_s) == (False, NOW + 100.0)
        one.tick(NOW + 101.0)
        # It was never heard, and may move all the same.
        assert (one.finished, one.mount_stopped) == (False, None)


class TestDrivers:
    def driver(self, **profile: Any) -> Driver:
        made = MountProfile(**profile)
        return Driver(made, Safety(made, SafetyLimits(optical=False), 52.0, 4.5))

    def test_before_it_is_heard_a_mount_is_only_stopped(self) -> None:
        one = self.driver()
        assert one.clear(Slew(10.0, 50.0), NOW).motion == Stop()
        assert one.clear(MoveAxes(0.1, 0.0), NOW).motion == Stop()
        assert one.clear(Hold(), NOW).motion == Hold()
        assert (one.link_up, one.sample, one.finished, one.mount_stopped) == (False, None, False, None)
        heard(one, 1)
        assert one.clear(MoveAxes(0.1, 0.0), NOW).motion == MoveAxes(0.1, 0.0)

    def test_one_that_knows_no_axes_in_space_moves_no_mount_with_a_geometry(self) -> None:
        geometry = {"geometry": AxisGeometry(0.0, 90.0), "stands_at": SitePlace(52.0, 4.5), "additive": False}
        one = self.driver(**geometry)
        heard(one, 1)
        assert one.clear(MoveAxes(0.1, 0.0), NOW).motion == Stop()
        assert one.sample is not None
        # Its sample is by the axes: azimuth and altitude of that hour angle and declination, from here.
        latitude, hour_angle, dec = (math.radians(angle) for angle in (52.0, 15.0, 20.0))
        altitude = math.asin(
            math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * math.cos(hour_angle)
        )
        assert one.sample.dec_deg == pytest.approx(math.degrees(altitude), abs=1e-6)
        assert 0.0 <= one.sample.ra_deg < 360.0

    def test_rates_are_judged_by_how_old_the_last_status_is(self) -> None:
        one = self.driver()
        heard(one, 1)
        assert one.clear(MoveAxes(0.1, 0.0), NOW + 0.5).motion == MoveAxes(0.1, 0.0)
        assert one.clear(MoveAxes(0.1, 0.0), NOW + 60.0).motion == Stop()
        assert one.safety.tripped == "status_age"

    @pytest.mark.parametrize(("waits_s", "stops"), [(0.0, False), (60.0, True)])
    def test_rates_that_hold_it_at_a_limit_and_do_not_reach_it_are_a_stop(
        self, waits_s: float, stops: bool, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Half a degree above the horizon, sinking, on a mount that takes rates by edges."""
        made = MountProfile(move_axis="edge")
        one = Driver(made, Safety(made, SafetyLimits(optical=False), 52.0, 4.5, holds=True))
        monkeypatch.setattr(Session, "rates_wait_s", waits_s)
        for number in (1, 2):
            heard(one, number, NOW + 0.05 * (number - 2), turned_deg=-15.0, dec_deg=-37.4 - 0.05 * number)
        cleared = one.clear(MoveAxes(SIDEREAL_RATE_DEG_S, -1.0), NOW)
        assert (cleared.motion == Stop()) is stops
        assert (one.safety.holding, one.safety.tripped) == (
            (None, "altitude") if stops else ("altitude", None)
        )

    @pytest.mark.parametrize("geometry", [False, True])
    def test_a_status_tells_safety_how_far_the_first_axis_is_from_half_a_turn(self, geometry: bool) -> None:
        """An hour past the meridian; by its axes, at the azimuth from the south of that direction."""
        placed = {"geometry": AxisGeometry(0.0, 90.0), "stands_at": SitePlace(52.0, 4.5), "additive": False}
        one = self.driver(**(placed if geometry else {}))
        assert one.safety.turns_known_s(MoveAxes(0.1, 0.0)) == math.inf
        heard(one, 1)
        p, h, d = (math.radians(angle) for angle in (52.0, 15.0, 20.0))
        west, south = math.sin(h), math.cos(h) * math.sin(p) - math.tan(d) * math.cos(p)
        first_deg = math.degrees(math.atan2(west, south)) if geometry else 15.0
        on_s, back_s = (
            one.safety.turns_known_s(MoveAxes(SIDEREAL_RATE_DEG_S - rate, 0.0)) for rate in (0.5, -0.5)
        )
        assert on_s / back_s == pytest.approx((180.0 - first_deg) / (180.0 + first_deg), rel=1e-3)

    def test_in_force_is_what_was_last_sent(self) -> None:
        one = self.driver()
        heard(one, 1)
        one.session.apply(one.clear(MoveAxes(0.1, 0.0), NOW))
        one.compose(NOW)
        assert one.in_force == MoveAxes(0.1, 0.0)
        one.session.apply(one.clear(Hold(), NOW))
        one.compose(NOW + 0.05)
        assert one.in_force == Hold()

    def test_turns_stay_known_for_the_last_rates_until_rest_is_seen(self) -> None:
        one = self.driver()
        heard(one, 1)
        assert one.turns_known_s == math.inf
        one.session.apply(one.clear(MoveAxes(0.1, 0.0), NOW))
        one.compose(NOW)
        known_s = one.safety.turns_known_s(MoveAxes(0.1, 0.0))
        assert one.turns_known_s == known_s < 2000.0
        # A stop that nobody has answered leaves the mount moving.
        one.session.apply(one.clear(Stop(), NOW))
        one.compose(NOW + 0.05)
        assert one.turns_known_s == known_s
        for number in range(2, 60):
            heard(one, number, NOW + 0.05 * number)
        one.compose(NOW + 3.0)
        assert one.turns_known_s == math.inf

    def test_a_mount_that_slews_by_itself_knows_its_turns(self) -> None:
        one = self.driver()
        heard(one, 1)
        one.session.apply(one.clear(MoveAxes(0.1, 0.0), NOW))
        one.compose(NOW)
        assert one.turns_known_s < math.inf
        sidereal_deg = mean_sidereal_deg(NOW, SITE.longitude_deg)
        one.session.apply(one.clear(Slew((sidereal_deg - 20.0) % 360.0, 60.0), NOW))
        for tick in range(1, 4):
            heard(one, 1 + tick, NOW + 0.05 * tick, 0.005 * tick, dec_rate_dtics_s=186414)
            one.compose(NOW + 0.05 * tick + 0.01)
        assert isinstance(one.in_force, Slew)
        assert not one.session.at_rest
        assert one.turns_known_s == math.inf

    @pytest.mark.parametrize(("link", "up"), [(UP, True), (STALE, True), (LOST, False)])
    def test_a_link_that_is_late_is_up(self, link: LinkState, up: bool) -> None:
        one = self.driver()
        one.link_state = link
        assert one.link_up is up

    def test_once_it_stops_nothing_is_repeated(self) -> None:
        one = self.driver(repeat_rates="always")
        for number in range(1, 12):
            heard(one, number, NOW + 0.05 * number)
            one.session.apply(one.clear(MoveAxes(0.1, 0.0), NOW + 0.05 * number))
            one.compose(NOW + 0.05 * number)
        assert one.repeat() is not None
        one.stop = StopProcedure(NOW + 1.0)
        assert one.repeat() is None


def test_a_mount_that_reports_its_axes_is_taken_as_it_reports() -> None:
    geometry = AxisGeometry(0.0, 90.0, reports="axes")
    frame = MountProfile(geometry=geometry, stands_at=SitePlace(52.0, 4.5)).frame
    assert frame is not None
    seen = StatusSample(7, NOW, 8.0, 150.0, 30.0, True, True, 0.3, -0.2, True, move_acknowledged=True)
    by_axes = sample_by_axes(seen, frame)
    assert (by_axes.ra_deg, by_axes.dec_deg) == pytest.approx((150.0, 30.0))
    assert replace(by_axes, ra_deg=150.0, dec_deg=30.0) == seen


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "told"),
    [(52.05, 4.45, False), (52.2, 4.5, True), (52.0, 4.7, True), (51.85, 4.5, True), (52.0, 364.45, False)],
)
def test_a_mount_that_believes_itself_elsewhere_is_told(
    latitude_deg: float, longitude_deg: float, told: bool
) -> None:
    status = Status(site_latitude_deg=latitude_deg, site_longitude_deg=longitude_deg)
    assert bool(site_warnings(status, SITE)) is told
    assert site_warnings(None, SITE) == site_warnings(status, None) == site_warnings(Status(), SITE) == []


def test_the_words_of_a_limit_name_its_cause_or_the_way_out() -> None:
    assert limit_text("sun", "it came near") == "safety stopped the mount at its sun limit: it came near"
    assert limit_text("sun").startswith("safety stopped the mount at its sun limit (")
    assert "); to go on: " in limit_text("sun")

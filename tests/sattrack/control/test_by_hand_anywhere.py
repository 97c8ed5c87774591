"""Mounts whose axes point anywhere, operated by hand and by servers' clients.

The mounts are strangers (`bench/axes_anywhere.py`); where their tubes point is a stranger's rotations' and
ERFA's to say. Of these mounts those with even numbers report the sky, those with odd ones their axes' angles.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any

import axes_anywhere
import erfa
import msgspec
import pytest
from console_builders import PROFILE, SITE, Bench

from sattrack.control.console import Console
from sattrack.control.manual_operation import ConsoleSession, ManualOperation
from sattrack.control.procedures import SlewThere, procedure_for
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import AxesPosition, SitePlace, Slew
from sattrack.mount.requests import FindHome, FineRate, Park, PulseGuide, Sync, TicketState
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.protocol import MoveOrder, NumberedOrder, TrackOrder
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.rotator import RotatorStation
from sattrack.views.messages import Jog, Leave
from tle.site import Site

ANYWHERE = axes_anywhere.ANYWHERE
ARCSEC = math.radians(1.0 / 3600.0)


@dataclass
class Hand:
    """A stranger and what feeds it, in virtual time."""

    number: int
    limits: SafetyLimits = ANYWHERE
    changes: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        axes = axes_anywhere.draw(self.number)
        # Of itself such a mount stands: a drive that goes on at the sky's rate turns one axis only.
        hardware = replace(axes.drawn.hardware, tracking=False)
        self.axes = axes._replace(drawn=replace(axes.drawn, hardware=hardware))
        self.mount = axes_anywhere.SkyStranger(self.axes)
        self.tube = axes_anywhere.Tube(self.axes)
        self.profile = msgspec.structs.replace(axes_anywhere.profile_of(self.axes), **self.changes)
        place = self.axes.drawn.site
        self.site = Site(place.latitude_deg, place.longitude_deg, 0.0)
        self.now_s = self.mount.next_turn_s
        self.part: Any = None

    def console(self) -> Console:
        return Console(self.profile, self.limits, self.site, "stranger")

    def turn(self) -> None:
        self.now_s = self.mount.next_turn_s
        self.part.receive(self.mount.turn(), self.now_s + 0.001)
        datagram = self.part.tick(self.now_s + 0.002)
        if datagram is not None:
            self.mount.receive(datagram)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.turn()

    def until(self, happens: Any, within_s: float = 120.0) -> None:
        end_s = self.now_s + within_s
        while not happens():
            self.turn()
            assert self.now_s < end_s, "did not happen"

    def carry_out(self, procedure: Any) -> ManualOperation:
        operation = ManualOperation(self.console(), procedure, self.now_s)
        self.part = operation
        self.until(lambda: operation.finished, 300.0)
        return operation

    @property
    def horizontal(self) -> tuple[float, float]:
        truth = self.mount.truth()
        return self.tube.horizontal(truth.hour_angle_deg, truth.dec_axis_deg)

    @property
    def altitude_deg(self) -> float:
        return self.horizontal[1]

    def sky(self) -> tuple[float, float]:
        """Return right ascension and declination of date to which the tube points, airless.

        Of a mount that reports the sky by its own clock, which it was pointed by.
        """
        truth = self.mount.truth()
        hour_angle, dec = self.tube.sky(truth.hour_angle_deg, truth.dec_axis_deg)
        if self.axes.geometry.reports == "sky":
            return (truth.ra_deg + truth.hour_angle_deg - hour_angle) % 360.0, dec
        azimuth, altitude = (math.radians(angle) for angle in self.horizontal)
        a, b = erfa.refco(1013.25, 15.0, 0.0, 0.55)
        zenith = 0.5 * math.pi - altitude
        for _ in range(3):
            true = 0.5 * math.pi - altitude + a * math.tan(zenith) + b * math.tan(zenith) ** 3
        hour_angle, dec = erfa.ae2hd(azimuth, 0.5 * math.pi - true, math.radians(self.site.latitude_deg))
        day = truth.utc_s / 86400.0
        sidereal = erfa.gst06a(2440587.5, day, 2440587.5, day + 69.2 / 86400.0)
        return math.degrees(
            sidereal - hour_angle + math.radians(self.site.longitude_deg)
        ) % 360.0, math.degrees(dec)

    def off_arcsec(self, ra_deg: float, dec_deg: float) -> float:
        ours = self.sky()
        apart = erfa.seps(*(math.radians(angle) for angle in (*ours, ra_deg, dec_deg)))
        return float(apart) / ARCSEC

    def beside(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return the direction to which axes turned on by so much would point, right ascension first."""
        truth = self.mount.truth()
        moved = truth.hour_angle_deg + first_deg, truth.dec_axis_deg + second_deg
        hour_angle, dec = self.tube.sky(*moved)
        return (truth.ra_deg + truth.hour_angle_deg - hour_angle) % 360.0, dec


SKY, AXES = (6, 12), (3, 15)
"""Draws whose tubes begin higher than 50°, where air matters little; that of the first one looks west."""
BOUND_ARCSEC = 25.0
"""Slews end within 10″; the air of two models, and the clock of a mount, make the rest."""


def test_a_slew_slows_down_before_a_limit_and_ends_beside_it() -> None:
    """An azimuth mount led to 1° above the floor: at full speed a fault of a second would lead past it."""
    geometry, place = AxisGeometry(0.0, 90.0), SitePlace(SITE.latitude_deg, SITE.longitude_deg)
    profile = msgspec.structs.replace(PROFILE, geometry=geometry, stands_at=place, additive=False)
    bench = Bench(profile, start=StartPosition(10.0, 50.0))
    bench.run(2.0)
    latitude = math.radians(SITE.latitude_deg)
    hour_angle, dec = erfa.ae2hd(math.radians(190.0), math.radians(1.0), latitude)
    sample = bench.console.session.sample
    assert sample is not None
    ra = (15.0 * sample.sidereal_h - math.degrees(hour_angle)) % 360.0
    operation = bench.carry_out(SlewThere(Slew(ra, math.degrees(dec))))
    assert operation.outcome is not None
    assert operation.outcome.state is TicketState.COMPLETE
    assert bench.truth is not None
    assert bench.truth.dec_axis_deg == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    "number",
    [SKY[0], AXES[0], *(pytest.param(one, marks=pytest.mark.soak) for one in (*SKY[1:], *AXES[1:]))],
)
def test_a_slew_ends_where_it_was_asked_for_and_the_mount_stands_after_it(number: int) -> None:
    hand = Hand(number)
    hand.mount.turn()
    ra, dec = hand.beside(12.0, -8.0)
    off: list[float] = []
    operation = ManualOperation(hand.console(), SlewThere(Slew(ra, dec)), hand.now_s)
    hand.part = operation
    while not operation.finished:
        hand.turn()
        if operation.outcome is not None and not off:
            off.append(hand.off_arcsec(ra, dec))
    assert operation.outcome is not None
    assert operation.outcome.state is TicketState.COMPLETE
    assert off[0] < BOUND_ARCSEC
    assert operation.mount_stopped
    stood = hand.horizontal
    hand.part = hand.console()
    hand.run(2.0)
    assert hand.horizontal == pytest.approx(stood, abs=0.005)


@pytest.mark.parametrize("number", [SKY[0], pytest.param(AXES[0], marks=pytest.mark.soak)])
def test_a_console_keeps_the_telescope_on_the_sky_and_after_a_jog_where_it_then_looks(number: int) -> None:
    hand = Hand(number)
    session = ConsoleSession(hand.console(), hand.now_s)
    hand.part = session
    hand.run(1.0)
    ra, dec = hand.beside(6.0, 5.0)
    session.obey(Slew(ra, dec), hand.now_s)
    assert session.console.refusal is None
    hand.until(lambda: session.console.outcome is not None)
    # The sky turns by 15″ a second.
    hand.run(10.0)
    assert hand.off_arcsec(ra, dec) < BOUND_ARCSEC
    for _ in range(20):
        session.obey(Jog(None, 0.5), hand.now_s)
        hand.run(0.1)
    hand.run(8.0)
    assert 0.5 * 3600.0 < hand.off_arcsec(ra, dec) < 2.0 * 3600.0
    there = hand.sky()
    hand.run(10.0)
    assert hand.off_arcsec(*there) < 5.0
    session.obey(Leave(), hand.now_s)
    hand.until(lambda: session.finished)
    assert session.mount_stopped


def test_what_the_mount_does_by_its_own_model_is_refused_and_nothing_moves() -> None:
    for request in (Sync(10.0, 10.0), FindHome(), PulseGuide(ra_ms=500), FineRate(0.001)):
        hand = Hand(SKY[0])
        stood = hand.horizontal
        operation = hand.carry_out(procedure_for(request, hand.profile))
        assert operation.ended_by == "refused"
        assert operation.outcome is not None
        assert "geometry" in (operation.outcome.reason or "")
        assert hand.horizontal == pytest.approx(stood, abs=0.005)


@pytest.mark.parametrize("turned", [(120.0, -30.0), (90.0, 0.0)])
def test_a_slew_with_the_geometry_of_another_mount_is_stopped_and_names_it(
    turned: tuple[float, float],
) -> None:
    hand = Hand(SKY[0])
    own = hand.axes.geometry
    elsewhere = msgspec.structs.replace(
        own,
        pole_azimuth_deg=math.remainder(own.pole_azimuth_deg + turned[0], 360.0),
        pole_altitude_deg=own.pole_altitude_deg + turned[1],
    )
    hand.profile = msgspec.structs.replace(hand.profile, geometry=elsewhere)
    hand.mount.turn()
    operation = hand.carry_out(SlewThere(Slew(*hand.beside(25.0, -20.0))))
    assert operation.ended_by == "limit:obedience"
    assert operation.outcome is not None
    assert "geometry" in (operation.outcome.reason or "")


def test_a_direction_below_the_floor_is_refused() -> None:
    hand = Hand(SKY[0])
    floor = SafetyLimits(floor_altitude_deg=hand.altitude_deg - 3.0, optical=False)
    hand.limits = floor
    hand.part = hand.console()
    hand.run(1.0)
    azimuth, altitude = hand.horizontal
    truth = hand.mount.truth()
    sidereal = truth.ra_deg + truth.hour_angle_deg
    hour_angle, dec = erfa.ae2hd(
        math.radians(azimuth), math.radians(altitude - 6.0), math.radians(hand.site.latitude_deg)
    )
    ra = (sidereal - math.degrees(hour_angle)) % 360.0
    operation = hand.carry_out(SlewThere(Slew(ra, math.degrees(dec))))
    assert operation.ended_by == "refused"
    assert operation.outcome is not None
    assert operation.outcome.refusal is not None
    assert operation.outcome.refusal.by_safety
    assert hand.horizontal == pytest.approx((azimuth, altitude), abs=0.01)


def test_the_sky_is_left_where_it_leads_below_the_floor() -> None:
    # A star that sets: the mount is kept on it, and stopped above the floor.
    hand = Hand(SKY[0])
    assert 185.0 < hand.horizontal[0] < 355.0
    hand.limits = SafetyLimits(floor_altitude_deg=hand.altitude_deg - 0.25, optical=False)
    session = ConsoleSession(hand.console(), hand.now_s)
    hand.part = session
    hand.run(1.0)
    session.obey(Slew(*hand.beside(0.0, 0.0)), hand.now_s)
    hand.until(lambda: session.console.outcome is not None)
    assert session.console.lead is not None
    lowest = 90.0
    end_s = hand.now_s + 200.0
    while hand.now_s < end_s:
        hand.run(0.5)
        lowest = min(lowest, hand.altitude_deg)
        if session.console.safety.tripped is not None:
            end_s = min(end_s, hand.now_s + 10.0)
    assert session.console.safety.tripped == "altitude"
    assert session.console.lead is None
    assert lowest > hand.limits.floor_altitude_deg - 0.01


def test_parking_ends_with_the_axes_at_the_park_position() -> None:
    for number in (SKY[0], AXES[0]):
        hand = Hand(number)
        truth = hand.mount.truth()
        senses, zeros = hand.axes.senses, hand.axes.zeros_deg
        own = [
            sense * (angle - zero)
            for sense, angle, zero in zip(
                senses, (truth.hour_angle_deg + 9.0, truth.dec_axis_deg - 7.0), zeros, strict=True
            )
        ]
        hand.profile = msgspec.structs.replace(hand.profile, park=AxesPosition(own[0], own[1]))
        operation = hand.carry_out(procedure_for(Park(), hand.profile))
        assert operation.outcome is not None
        assert operation.outcome.state in {TicketState.COMPLETE, TicketState.UNCONFIRMED}
        after = hand.mount.truth()
        assert after.hour_angle_deg == pytest.approx(truth.hour_angle_deg + 9.0, abs=0.05)
        assert after.dec_axis_deg == pytest.approx(truth.dec_axis_deg - 7.0, abs=0.05)


@pytest.mark.parametrize("number", [pytest.param(SKY[1], marks=pytest.mark.soak), AXES[1]])
def test_an_alpaca_client_slews_sees_where_the_tube_looks_and_turns_axes(number: int) -> None:
    hand = Hand(number)

    def no_engine(*_: Any) -> Any:
        raise ValueError

    station = TelescopeStation(hand.profile, hand.limits, hand.site, "stranger", no_engine)
    hand.part = station
    hand.run(1.0)
    ra, dec = hand.beside(-7.0, 6.0)
    station.obey(NumberedOrder(1, Slew(ra, dec)), hand.now_s)
    assert station.state(hand.now_s).slewing
    hand.until(lambda: not station.state(hand.now_s).slewing)
    hand.run(10.0)
    seen = station.state(hand.now_s)
    assert seen.tracking
    assert not seen.slewing
    assert hand.off_arcsec(ra, dec) < BOUND_ARCSEC
    assert hand.off_arcsec(15.0 * seen.ra_h, seen.dec_deg) < BOUND_ARCSEC
    azimuth, altitude = hand.horizontal
    assert (seen.azimuth_deg, seen.altitude_deg) != (None, None)
    if hand.axes.geometry.reports == "axes":
        assert seen.altitude_deg == pytest.approx(altitude, abs=0.03)
        assert math.remainder((seen.azimuth_deg or 0.0) - azimuth, 360.0) == pytest.approx(0.0, abs=0.05)
    # Another slew replaces it, and tracking ends and begins on request.
    station.obey(NumberedOrder(2, Slew(*hand.beside(3.0, 0.0))), hand.now_s)
    hand.until(lambda: not station.state(hand.now_s).slewing)
    station.obey(NumberedOrder(3, TrackOrder(False)), hand.now_s)
    hand.run(4.0)
    assert not station.state(hand.now_s).tracking
    stood = hand.mount.truth()
    station.obey(NumberedOrder(4, MoveOrder(1, 0.5)), hand.now_s)
    hand.run(2.0)
    station.obey(NumberedOrder(5, MoveOrder(1, 0.0)), hand.now_s)
    hand.run(4.0)
    after = hand.mount.truth()
    assert 0.5 < abs(after.dec_axis_deg - stood.dec_axis_deg) < 1.6
    assert after.hour_angle_deg == pytest.approx(stood.hour_angle_deg, abs=0.02)
    station.obey(NumberedOrder(6, TrackOrder(True)), hand.now_s)
    hand.run(4.0)
    there = hand.sky()
    hand.run(10.0)
    assert hand.off_arcsec(*there) < 5.0


@pytest.mark.parametrize("number", [SKY[0], pytest.param(AXES[1], marks=pytest.mark.soak)])
def test_a_rotators_client_points_the_tube_to_azimuth_and_elevation(number: int) -> None:
    hand = Hand(number)
    station = RotatorStation(SiteSky(hand.site), hand.profile, hand.limits)
    hand.part = station
    hand.run(1.0)
    truth = hand.mount.truth()
    azimuth, altitude = hand.tube.horizontal(truth.hour_angle_deg + 8.0, truth.dec_axis_deg - 6.0)
    azimuth = math.remainder(azimuth, 360.0)
    assert station.rotator.point(1, azimuth, altitude, hand.now_s).value == 0
    hand.run(20.0)
    there = hand.horizontal
    assert math.remainder(there[0] - azimuth, 360.0) * math.cos(math.radians(altitude)) == pytest.approx(
        0.0, abs=0.005
    )
    assert there[1] == pytest.approx(altitude, abs=0.005)
    shown = station.rotator.where(round(hand.now_s * 1e9))
    assert shown is not None
    assert shown.el_deg == pytest.approx(altitude, abs=0.005)


def test_the_view_says_where_the_telescope_looks() -> None:
    hand = Hand(AXES[0])
    session = ConsoleSession(hand.console(), hand.now_s)
    hand.part = session
    hand.run(1.0)
    looks = json.loads(msgspec.json.encode(session.view(hand.now_s)))["looks_at_deg"]
    assert hand.off_arcsec(*looks) < BOUND_ARCSEC

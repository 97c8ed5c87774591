"""Calibrated tracking on simulated Alpaca telescopes in virtual time, held to the simulated axes' truth."""

from __future__ import annotations

import math
from dataclasses import replace as replace_fields
from datetime import UTC, datetime
from typing import Literal

import pytest
from alpaca_harness import (
    TwoAxes,
    VirtualTelescope,
    address,
    calibrate,
    facts_of,
    follow,
    follow_two_axes,
)
from alpaca_mount import AXES, KEYHOLE_DEG, followed_live, of_axes
from msgspec.structs import replace
from skyfield.api import load
from strangers.alpaca_two_axes import Parameters

from sattrack.calibration.guard import CalibrationEndedError, Leg, Plan
from sattrack.control.console import Console
from sattrack.control.driver import Driver, StopProcedure
from sattrack.mount.alpaca.bridge import Bridge
from sattrack.mount.alpaca.device import SkyPlace
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Motion, MoveAxes, Stop
from sattrack.mount.simulator.alpaca_telescope import SimulatedPlace, SimulatedTelescope, TelescopeSettings
from sattrack.safety import Safety, SafetyLimits
from tle.site import Site

T0 = 1_790_000_000.0
BOUND_ARCSEC = 10.0
STRANGER = Parameters(azimuth_deg=200.0, altitude_deg=45.0)
BEGINS_S, LASTS_S = 60.0, 50.0
"""From a slew into the pass to half a minute of following."""
SHORT = Plan(
    toggles=10,
    most_toggles=14,
    toggles_after=4,
    legs=(Leg(-0.8, 2.4), Leg(0.8, 2.4), Leg(0.4, 3.6), Leg(-0.4, 3.6), Leg(0.2, 4.0)),
)
VARIANTS = {
    "as the standard": TelescopeSettings(),
    "additive, both turned": TelescopeSettings(additive=True, ra_sign=-1, dec_sign=-1),
    "J2000, gains, soft": TelescopeSettings(
        system="j2000", ra_sign=-1, ra_gain=1.03, dec_gain=0.96, servo_hz=2.0, acceleration_deg_s2=4.0
    ),
    "additive, without tracking": TelescopeSettings(additive=True, dec_sign=-1, tracking=False),
}
WARNED_OF = {"J2000, gains, soft": ["WARNING: the declination axis moves"]}
"""A gain of 1.03 is one that an equatorial mount has, 0.96 is none."""
LEFT_OUT = {"as the standard", "additive, both turned"}
"""What the others have in them, too."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.soak if name in LEFT_OUT else ()) for name in VARIANTS]
)
def test_what_a_telescope_does_with_moveaxis_is_found_out_and_a_pass_followed_within_the_bound(
    name: str,
) -> None:
    settings = VARIANTS[name]
    profile, found = calibrate(settings, plan=SHORT)
    assert (profile.ra_rate_sign, profile.dec_rate_sign) == (settings.ra_sign, settings.dec_sign)
    assert profile.additive is settings.additive
    assert [note.partition(" 0.")[0] for note in found.notes] == WARNED_OF.get(name, [])
    assert profile.move_axis == "held"
    assert profile.ra_rate_gain == pytest.approx(settings.ra_gain, abs=0.003)
    assert profile.dec_rate_gain == pytest.approx(settings.dec_gain, abs=0.003)
    assert profile.ra.max_rate_deg_s == 6.0
    # Both ways together, of which the middle is taken.
    assert found.delays.round_trip.seconds == pytest.approx(settings.latency_s, abs=0.006)
    assert profile.clock_offset_s == 0.0
    assert profile.dated_within_s == pytest.approx(settings.latency_s / 2.0, abs=0.004)
    result = follow(settings, profile, seconds=LASTS_S, begins_s=BEGINS_S)
    assert result.message is None
    assert result.ended_by == "operator"
    assert result.stopped
    assert len(result.errors) > 1000
    assert result.true.rms_arcsec is not None
    assert result.true.rms_arcsec < BOUND_ARCSEC


@pytest.mark.parametrize("latency_s", [pytest.param(0.002, marks=pytest.mark.soak), 0.1])
def test_dates_hold_on_a_fast_and_on_a_slow_driver_that_nobody_has_measured(latency_s: float) -> None:
    settings = TelescopeSettings(latency_s=latency_s)
    result = follow(settings, address(settings).usual_profile(), seconds=LASTS_S, begins_s=BEGINS_S)
    assert result.message is None
    errors = sorted(error for _, error in result.errors)
    assert len(errors) > 1000
    assert errors[len(errors) // 2] < 1.0


@pytest.mark.parametrize(
    ("hz", "latency_s"), [(10.0, 0.03), pytest.param(2.0, 0.03, marks=pytest.mark.soak), (2.0, 0.6)]
)
def test_a_wrong_sign_is_stopped_by_the_obedience_limit(hz: float, latency_s: float) -> None:
    settings = TelescopeSettings(ra_sign=-1, dec_sign=-1, latency_s=latency_s)
    result = follow(settings, address(settings, hz).usual_profile(), hz, seconds=LASTS_S, begins_s=BEGINS_S)
    assert result.ended_by == "limit:obedience"
    assert result.stopped


@pytest.mark.parametrize("ra_sign", [1, -1])
def test_a_telescope_that_is_held_at_its_western_limit_stands_there(ra_sign: Literal[-1, 1]) -> None:
    settings = TelescopeSettings(hour_angle_deg=59.0, dec_deg=30.0, ra_sign=ra_sign)
    profile = replace(
        address(settings).usual_profile(), hour_angle_limit_deg=60.0, ra_rate_sign=settings.ra_sign
    )
    place = settings.latitude_deg, settings.longitude_deg
    driver = Driver(profile, Safety(profile, SafetyLimits(optical=False), *place, holds=True))
    bridge, telescope = Bridge(facts_of(settings), settings.longitude_deg), SimulatedTelescope(settings, T0)
    stood_deg = []
    for now in (T0 + 0.1 * k for k in range(600)):
        seen = telescope.truth(now)
        status = bridge.see(SkyPlace(now, seen.ra_deg, now, seen.dec_deg))
        assert status is not None
        driver.receive(status, now)
        driver.session.apply(driver.clear(MoveAxes(SIDEREAL_RATE_DEG_S - 0.5, 0.0), now))
        bridge.hear(driver.compose(now), now)
        for order in bridge.turn(now):
            telescope.move_axis(int(order.lane == "dec"), order.rate_deg_s, now)
        if now > T0 + 20.0:
            stood_deg.append(telescope.axes(now)[0])
    assert (driver.safety.tripped, driver.safety.holding) == (None, "hour_angle")
    assert 59.7 < min(stood_deg) <= max(stood_deg) < 60.0
    # In 40 s the sky goes on by 0.17°.
    assert stood_deg[-1] - stood_deg[0] < 0.001


@pytest.mark.parametrize("dec_deg_s", [0.0, 0.3])
def test_a_telescope_with_no_slow_rates_stands_at_its_western_limit_and_is_left_there(
    dec_deg_s: float,
) -> None:
    """By a stranger's axes, which go on with the sky after a MoveAxis of 0, as the standard has it."""
    settings = TelescopeSettings(rates_deg_s=((0.1, 4.0),))
    profile = replace(address(settings).usual_profile(), hour_angle_limit_deg=60.0)
    place = settings.latitude_deg, settings.longitude_deg
    driver = Driver(profile, Safety(profile, SafetyLimits(optical=False), *place, holds=True))
    device = TwoAxes(
        Parameters(
            *place,
            pole_altitude_deg=settings.latitude_deg,
            alignment_mode=1,
            azimuth_deg=250.0,
            altitude_deg=45.0,
            min_rate_deg_s=0.1,
            max_rate_deg_s=4.0,
            tracking=True,
        ),
        T0,
    )
    engine = Driven(driver, settings, device)
    engine.run(45.0, MoveAxes(SIDEREAL_RATE_DEG_S - 0.5, dec_deg_s))
    assert (driver.safety.tripped, driver.safety.holding) == (None, "hour_angle")
    stood_deg = engine.hour_angle_deg()
    assert 59.7 < stood_deg < 60.0
    engine.run(60.0, MoveAxes(SIDEREAL_RATE_DEG_S - 0.5, -dec_deg_s))
    assert driver.safety.tripped is None
    # In a minute the sky goes on by 0.25°.
    assert abs(engine.hour_angle_deg() - stood_deg) < 0.001
    engine.run(10.0, MoveAxes(SIDEREAL_RATE_DEG_S + 0.5, 0.0))
    assert engine.hour_angle_deg() < stood_deg - 4.0
    engine.run(25.0, MoveAxes(SIDEREAL_RATE_DEG_S - 0.5, 0.0))
    driver.stop = StopProcedure(engine.now)
    engine.run(15.0, Stop())
    assert driver.mount_stopped
    assert not device.tracks()
    assert 59.7 < engine.hour_angle_deg() < 60.0
    assert engine.virtual.refusals == []


@pytest.mark.parametrize("latency_s", [1.0, 1.7])
def test_a_telescope_that_answers_slowly_is_seen_at_rest(latency_s: float) -> None:
    settings = TelescopeSettings(latency_s=latency_s)
    profile = address(settings, 2.0).usual_profile()
    place = settings.latitude_deg, settings.longitude_deg
    driver = Driver(profile, Safety(profile, SafetyLimits(optical=False), *place, holds=True))
    equatorial = replace_fields(STRANGER, pole_altitude_deg=place[0], alignment_mode=1, tracking=True)
    engine = Driven(
        driver,
        settings,
        TwoAxes(replace_fields(equatorial, latitude_deg=place[0], longitude_deg=place[1]), T0),
    )
    engine.run(10.0, MoveAxes(0.0, 0.3))
    driver.stop = StopProcedure(engine.now)
    engine.run(30.0, Stop())
    assert driver.mount_stopped
    assert max(abs(speed) for speed in engine.device.scope.speeds) < 0.005


def test_a_telescope_that_is_asked_twice_a_second_is_jogged_whenever_a_key_is_pressed() -> None:
    settings = TelescopeSettings()
    site = Site(settings.latitude_deg, settings.longitude_deg, 0.0)
    console = Console(address(settings, 2.0).usual_profile(), SafetyLimits(optical=False), site, "telescope")
    virtual = VirtualTelescope(settings, T0, 2.0, console.receive)
    refused = []
    for step in range(300):
        now = T0 + 0.05 * step
        while virtual.queue[0][0] < now:
            virtual.next()
        if step % 10 == 0:
            virtual.hear(console.tick(now), now)
        if step > 100:
            refused.append(console.jog(None, 0.2, now))
    assert refused == [None] * len(refused)
    assert virtual.telescope.truth(now).dec_deg > settings.dec_deg + 1.0


class Driven:
    """A driver and a telescope in virtual time."""

    def __init__(self, driver: Driver, settings: TelescopeSettings, device: TwoAxes) -> None:
        self.driver, self.device, self.now = driver, device, T0
        self.virtual = VirtualTelescope(settings, T0, 10.0, driver.receive, device)

    def run(self, seconds: float, motion: Motion) -> None:
        until = self.now + seconds
        while self.now < until:
            while self.virtual.queue[0][0] < self.now:
                self.virtual.next()
            if self.driver.sample is not None:
                self.driver.session.apply(self.driver.clear(motion, self.now))
            self.virtual.hear(self.driver.compose(self.now), self.now)
            self.now += self.driver.profile.period_s

    def hour_angle_deg(self) -> float:
        seen = self.device.truth(self.now)
        return math.remainder(self.device.scope.sidereal_deg(seen.utc_s) - seen.ra_deg, 360.0)


def test_each_status_of_a_slow_telescope_counts() -> None:
    profile = address(TelescopeSettings(), 2.0).usual_profile()
    result = follow(TelescopeSettings(), profile, 2.0, LASTS_S, begins_s=BEGINS_S)
    first_utc_s, last_utc_s = result.errors[0][0], result.errors[-1][0]
    assert result.reported.count == pytest.approx(2.0 * (last_utc_s - first_utc_s), abs=2.0)


@pytest.mark.parametrize(
    ("settings", "hz"),
    [
        pytest.param(TelescopeSettings(), 5.0, marks=pytest.mark.soak),
        (TelescopeSettings(move_interval_s=0.25), 3.5),
        pytest.param(TelescopeSettings(rates_deg_s=((0.001, 1.5),)), 10.0, marks=pytest.mark.soak),
    ],
)
def test_at_the_rate_that_a_telescope_bears_the_bound_is_kept_too(
    settings: TelescopeSettings, hz: float
) -> None:
    profile, _ = calibrate(settings, hz, SHORT)
    result = follow(settings, profile, hz, LASTS_S, begins_s=BEGINS_S)
    assert result.refusals == []
    assert result.stopped
    assert result.true.rms_arcsec is not None
    assert result.true.rms_arcsec < BOUND_ARCSEC


def test_a_simulated_alt_azimuth_telescope_follows_the_sky_and_slews() -> None:
    settings = TelescopeSettings(alignment="altaz", hour_angle_deg=-40.0, dec_deg=30.0)
    scope = SimulatedTelescope(settings, 1.79e9)
    begun = scope.truth(1.79e9 + 5.0)
    later = scope.truth(1.79e9 + 65.0)
    assert later.ra_deg == pytest.approx(begun.ra_deg, abs=1e-3)
    assert later.dec_deg == pytest.approx(begun.dec_deg, abs=1e-3)
    scope.slew(begun.ra_deg + 10.0, 50.0, 1.79e9 + 65.0)
    there = scope.truth(1.79e9 + 80.0)
    assert there.ra_deg == pytest.approx(begun.ra_deg + 10.0, abs=1e-3)
    assert there.dec_deg == pytest.approx(50.0, abs=1e-3)
    scope.move_axis(1, 1.0, 1.79e9 + 80.0)
    altitudes = [altitude_of(scope.truth(1.79e9 + t), settings) for t in (82.0, 87.0)]
    assert altitudes[1] - altitudes[0] == pytest.approx(5.0, abs=0.01)


def altitude_of(place: SimulatedPlace, settings: TelescopeSettings) -> float:
    """By another library."""
    ts = load.timescale(builtin=True)
    at = ts.from_datetime(datetime.fromtimestamp(place.utc_s, UTC))
    hour_angle = math.radians(at.gast * 15.0 + settings.longitude_deg - place.ra_deg)
    dec, latitude = math.radians(place.dec_deg), math.radians(settings.latitude_deg)
    sine = math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * math.cos(hour_angle)
    return math.degrees(math.asin(sine))


def test_calibration_refuses_axes_that_are_not_those_of_an_equatorial_mount() -> None:
    settings = TelescopeSettings(alignment="altaz", hour_angle_deg=30.0, dec_deg=20.0)
    with pytest.raises(CalibrationEndedError, match="is it an alt-azimuth mount"):
        calibrate(settings, plan=SHORT)


@pytest.mark.soak
@pytest.mark.parametrize("gain", [0.71, 0.96, 1.04])
def test_calibration_warns_of_a_gain_that_no_equatorial_mount_has(gain: float) -> None:
    _, found = calibrate(TelescopeSettings(ra_gain=gain), plan=SHORT)
    (note,) = found.notes
    assert note.startswith("WARNING: the right ascension axis moves")
    assert found.ra.gain == pytest.approx(gain, rel=1e-3)


@pytest.mark.soak
def test_calibration_warns_of_no_gain_that_an_equatorial_mount_has() -> None:
    _, found = calibrate(TelescopeSettings(ra_gain=1.02, dec_gain=0.98), plan=SHORT)
    assert found.notes == ()


def test_calibration_warns_of_an_alt_azimuth_telescope_on_the_meridian() -> None:
    """There azimuth moves the hour angle alone: by cos altitude / cos declination."""
    settings = TelescopeSettings(alignment="altaz", hour_angle_deg=0.0, dec_deg=7.0)
    _, found = calibrate(settings, plan=SHORT)
    altitude_deg = 90.0 - settings.latitude_deg + 7.0
    gain = math.cos(math.radians(altitude_deg)) / math.cos(math.radians(7.0))
    assert found.ra.gain == pytest.approx(gain, rel=0.02)
    assert any(note.startswith("WARNING: the right ascension axis") for note in found.notes)


def test_a_strangers_alt_azimuth_telescope_is_followed_as_near_as_its_driver_allows() -> None:
    """A part of what `python bench/alpaca_mount.py --two-axes` prints, the bound several times that."""
    result = follow_two_axes(STRANGER, seconds=50.0, begins_s=60.0)
    assert result.message is None
    assert result.stopped
    assert result.refusals == []
    assert len(result.errors) > 500
    assert result.true.rms_arcsec is not None
    assert result.true.rms_arcsec < 4.0


@pytest.mark.soak
@pytest.mark.parametrize("name", [name for name in AXES if name != "alt-azimuth"])
def test_whole_passes_are_followed_with_a_strangers_axes_anywhere(name: str) -> None:
    azimuth, altitude = AXES[name]
    result = follow_two_axes(of_axes(azimuth, altitude, TelescopeSettings().latitude_deg))
    assert result.ended_by == "set"
    away = [error for error, from_pole_deg in result.of_first_axis if from_pole_deg > KEYHOLE_DEG]
    assert len(away) > 10000
    assert math.sqrt(sum(one * one for one in away) / len(away)) < 3.0


@pytest.mark.soak
def test_a_strangers_alt_azimuth_telescope_is_calibrated_and_followed_over_http() -> None:
    errors, ended_by = followed_live(0.0, 90.0)
    assert ended_by == "set"
    away = [error for error, from_pole_deg in errors if from_pole_deg > KEYHOLE_DEG]
    assert len(away) > 1000
    assert math.sqrt(sum(one * one for one in away) / len(away)) < 20.0

"""The simulated mount's clock and what it derives from it, refraction, and the two sides of the pole.

Sidereal time and horizontal coordinates are held against ERFA, refraction against Saemundsson's formula
(Sky & Telescope, July 1986), written for the airless altitude where the mount's own is for the apparent one.
"""

from __future__ import annotations

import math

import erfa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulator_bench import PERIOD_S, SIDEREAL_DEG_S, SITE, Bench, StartPosition, moving, turned

from sattrack.mount.simulator.sky import airless, direction, equatorial, horizontal, refracted

MODEL_DEG = 0.2 / 60.0
"""How far apart the two formulae of refraction may be."""


def sidereal_deg(utc_s: float) -> float:
    day, fraction = divmod(utc_s / 86400.0, 1.0)
    return math.degrees(erfa.gmst82(2440587.5 + day, fraction)) + SITE.longitude_deg


class TestClock:
    @pytest.mark.parametrize("offset_s", [-1.5, 0.0, 0.35])
    def test_sidereal_time_is_that_of_a_clock_ahead_by_the_offset(self, offset_s: float) -> None:
        bench = Bench(clock_offset_s=offset_s)
        expected = sidereal_deg(bench.now + offset_s)
        assert turned(bench.status.sidereal_h * 15 - expected) == pytest.approx(0.0, abs=0.1 / 3600)

    def test_it_drifts_by_millionths(self) -> None:
        true, drifting = Bench(), Bench(clock_drift_ppm=50.0)
        for bench in (true, drifting):
            bench.turn(1000.0 - PERIOD_S)
        ahead_deg = turned((drifting.status.sidereal_h - true.status.sidereal_h) * 15)
        assert ahead_deg == pytest.approx(1000.0 * 50e-6 * SIDEREAL_DEG_S, abs=1e-7)

    def test_right_ascensions_are_by_its_clock_and_so_is_truth(self) -> None:
        true, ahead = Bench(), Bench(clock_offset_s=2.0)
        expected = 2.0 * SIDEREAL_DEG_S
        assert turned((ahead.status.ra_h - true.status.ra_h) * 15) == pytest.approx(expected, abs=1e-6)
        assert turned(ahead.truth.ra_deg - true.truth.ra_deg) == pytest.approx(expected, abs=1e-6)
        assert ahead.truth.hour_angle_axis_deg == true.truth.hour_angle_axis_deg

    def test_a_slew_ends_where_the_target_is_by_its_clock(self) -> None:
        true, ahead = Bench(), Bench(clock_offset_s=2.0)
        target = true.target(5.0, 5.0)
        for bench in (true, ahead):
            bench.obeys(slew=True, **target)
            bench.run(4.0)
            assert bench.status.ra_h == pytest.approx(target["target_ra_h"], abs=1e-6)
        apart = ahead.truth.hour_angle_axis_deg - true.truth.hour_angle_axis_deg
        assert apart == pytest.approx(2.0 * SIDEREAL_DEG_S, abs=1e-7)

    def test_a_step_of_the_clock_shifts_what_is_reported_at_once(self) -> None:
        bench = Bench()
        before = bench.status
        bench.mount.step_clock(-0.5)
        after = bench.turn(0.0).status
        assert turned((after.sidereal_h - before.sidereal_h) * 15) == pytest.approx(
            -0.5 * SIDEREAL_DEG_S, abs=1e-7
        )
        assert turned((after.ra_h - before.ra_h) * 15) == pytest.approx(-0.5 * SIDEREAL_DEG_S, abs=1e-6)

    def test_it_tracks_at_the_sidereal_rate_for_a_day(self) -> None:
        bench = Bench(start=StartPosition(-175.0, 20.0))
        ra_deg = bench.truth.ra_deg
        bench.turn(86164.0905 - 3000.0)
        gone = bench.truth.hour_angle_axis_deg + 175.0
        assert gone == pytest.approx(360.0 - 3000.0 * SIDEREAL_DEG_S, abs=1e-3)
        assert turned(bench.truth.ra_deg - ra_deg) == pytest.approx(0.0, abs=1e-4)


class TestRefraction:
    @pytest.mark.parametrize("altitude_deg", [2.0, 5.0, 10.0, 20.0, 45.0, 80.0])
    def test_axes_point_above_the_airless_direction(self, altitude_deg: float) -> None:
        hour_angle_deg, dec_deg = equatorial(altitude_deg, 120.0, 48.0)
        apparent_deg, azimuth_deg = horizontal(*refracted(hour_angle_deg, dec_deg, 48.0), 48.0)
        saemundsson_deg = 1.02 / math.tan(math.radians(altitude_deg + 10.3 / (altitude_deg + 5.11))) / 60.0
        assert apparent_deg - altitude_deg == pytest.approx(saemundsson_deg, abs=MODEL_DEG)
        assert azimuth_deg == pytest.approx(120.0, abs=1e-9)

    @given(altitude=st.floats(1.0, 89.9), azimuth=st.floats(0.0, 359.9), latitude=st.floats(-89.0, 89.0))
    def test_one_way_undoes_the_other(self, altitude: float, azimuth: float, latitude: float) -> None:
        there = refracted(*equatorial(altitude, azimuth, latitude), latitude)
        back = horizontal(*airless(*there, latitude), latitude)
        assert back[0] == pytest.approx(altitude, abs=1e-6)
        off = turned(back[1] - azimuth) * math.cos(math.radians(altitude))
        assert off == pytest.approx(0.0, abs=1e-6)

    def test_a_mount_that_does_it_says_so_and_reports_airless_coordinates(self) -> None:
        start = StartPosition(80.0, 10.0)
        plain, refracting = Bench(start=start), Bench(start=start, does_refraction=True)
        assert (plain.status.does_refraction, refracting.status.does_refraction) == (False, True)
        assert refracting.truth.hour_angle_axis_deg == plain.truth.hour_angle_axis_deg
        # Altitude and azimuth are the axes'; the reported direction is lower by the refraction.
        assert refracting.status.altitude_deg == plain.status.altitude_deg
        hour_angle = math.radians((refracting.status.sidereal_h - refracting.status.ra_h) * 15)
        _, airless_altitude = erfa.hd2ae(
            hour_angle, math.radians(refracting.status.dec_deg), math.radians(SITE.latitude_deg)
        )
        h = math.degrees(airless_altitude)
        expected = 1.02 / math.tan(math.radians(h + 10.3 / (h + 5.11))) / 60.0
        assert refracting.status.altitude_deg - h == pytest.approx(expected, abs=MODEL_DEG)

    def test_its_slews_end_where_the_target_is_reported(self) -> None:
        bench = Bench(does_refraction=True)
        target = bench.target(-60.0, 5.0)
        bench.obeys(slew=True, **target)
        bench.run(12.0)
        assert not bench.status.slewing
        assert bench.status.dec_deg == pytest.approx(target["target_dec_deg"], abs=1e-3)


class TestDirections:
    @given(hour_angle=st.floats(-200.0, 200.0), dec_axis=st.floats(-269.0, 269.0))
    def test_axes_and_the_direction_they_give_are_one_vector(
        self, hour_angle: float, dec_axis: float
    ) -> None:
        given_deg, dec_deg = direction(hour_angle, dec_axis)
        assert -90.0 <= dec_deg <= 90.0
        for angle, dec in ((hour_angle, dec_axis), (given_deg, dec_deg)):
            h, d = math.radians(angle), math.radians(dec)
            vector = (math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d))
            if (angle, dec) == (hour_angle, dec_axis):
                expected = vector
        assert vector == pytest.approx(expected, abs=1e-12)

    def test_declination_rates_beyond_the_pole_are_those_reported(self) -> None:
        bench = Bench(start=StartPosition(0.0, 120.0))
        bench.run(1.0, **moving(None, 0.5))
        before = bench.status.dec_deg
        bench.run(1.0, **moving(None, 0.5))
        assert bench.status.dec_deg - before == pytest.approx(0.5, abs=1e-5)
        assert bench.truth.dec_rate_deg_s == pytest.approx(0.5, abs=1e-9)

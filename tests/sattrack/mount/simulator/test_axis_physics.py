"""One simulated axis against closed forms: constant acceleration, friction, an oscillator, whole tics."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sattrack.mount.model import AxisLimits
from sattrack.mount.simulator.axis import Axis, Reference, Swing, Trajectory
from sattrack.mount.simulator.drives import Encoder
from sattrack.mount.simulator.profile import ServoSettings, SimulatorProfile

LIMITS = AxisLimits(max_rate_deg_s=4.0, max_acceleration_deg_s2=2.0, slew_rate_deg_s=4.0)
TIC_DEG = 360.0 / 2**26
STEP_S = 0.001


def axis(limits: AxisLimits = LIMITS, **servo: float) -> Axis:
    return Axis(limits, SimulatorProfile(servo=ServoSettings(**servo)))  # type: ignore[arg-type]


def sampled(moved: Axis, seconds: float, step_s: float = STEP_S) -> np.ndarray:
    """Position, rate, acceleration and current after each step."""
    rows = []
    for _ in range(round(seconds / step_s)):
        moved.advance(step_s)
        rows.append(
            (moved.position_deg, moved.velocity_deg_s, moved.plant.acceleration_deg_s2, moved.current_a)
        )
    return np.array(rows)


class TestRates:
    def test_a_ramp_is_v_equals_a_t(self) -> None:
        moved = axis()
        moved.run(3.0)
        for time_s in np.arange(1, 31) * 0.1:
            moved.advance(0.1)
            ramp_s = min(time_s, 1.5)
            assert moved.velocity_deg_s == pytest.approx(2.0 * ramp_s, abs=1e-12)
            assert moved.position_deg == pytest.approx(ramp_s**2 + 3.0 * (time_s - ramp_s), abs=1e-12)

    def test_the_stopping_distance_is_v_squared_over_2a(self) -> None:
        moved = axis()
        moved.place(10.0, 3.0)
        moved.run(0.0)
        moved.advance(10.0)
        assert moved.velocity_deg_s == 0.0
        assert moved.position_deg == pytest.approx(10.0 + 3.0**2 / (2 * 2.0), abs=1e-12)

    @given(cuts=st.lists(st.floats(1e-4, 2.0), min_size=1, max_size=20), rate=st.floats(-4.0, 4.0))
    @settings(max_examples=50, deadline=None)
    def test_many_steps_lead_where_one_does(self, cuts: list[float], rate: float) -> None:
        one, many = axis(), axis()
        for moved in (one, many):
            moved.place(0.0, 0.5)
            moved.run(rate)
        one.advance(sum(cuts))
        for cut in cuts:
            many.advance(cut)
        assert many.position_deg == pytest.approx(one.position_deg, abs=1e-9)
        assert many.velocity_deg_s == pytest.approx(one.velocity_deg_s, abs=1e-9)

    def test_acceleration_costs_current(self) -> None:
        moved = axis(inertia_a_per_deg_s2=0.2, friction_a=0.7)
        moved.run(3.0)
        moved.advance(0.5)
        assert moved.current_a == pytest.approx(2.0 * 0.2 + 0.7)
        moved.advance(5.0)
        assert moved.current_a == pytest.approx(0.7)
        moved.run(-3.0)
        moved.advance(0.5)
        assert moved.current_a == pytest.approx(-2.0 * 0.2 + 0.7)


WAYS = st.builds(
    Trajectory,
    distance=st.floats(-300.0, 300.0),
    rate=st.floats(-4.0, 4.0),
    most_rate=st.just(4.0),
    acceleration=st.just(2.0),
    jerk=st.sampled_from([0.0, 10.0, 40.0]),
)


class TestWays:
    @given(way=WAYS)
    @settings(max_examples=100, deadline=None)
    def test_rate_acceleration_and_jerk_are_bounded_and_the_end_is_rest_at_the_goal(
        self, way: Trajectory
    ) -> None:
        count = 2000
        step_s = (way.duration_s + 0.2) / count
        position, rate, acceleration = np.array([way.at(i * step_s) for i in range(count + 1)]).T
        assert position[0] == pytest.approx(-way.distance, abs=1e-9)
        assert rate[0] == pytest.approx(way.rate, abs=1e-9)
        assert np.abs(rate).max() <= 4.0 + 1e-9
        assert np.abs(acceleration).max() <= 2.0 + 1e-9
        # The derivatives are found by differencing, not by asking.
        assert np.abs(np.diff(position) / step_s).max() <= 4.0 + 1e-6
        assert np.abs(np.diff(rate)).max() <= 2.0 * step_s + 1e-9
        if way.jerk:
            assert np.abs(np.diff(acceleration)).max() <= way.jerk * step_s + 1e-9
        assert way.at(way.duration_s) == (0.0, 0.0, 0.0)
        before = way.at(way.duration_s - 1e-6)
        assert before == pytest.approx((0.0, 0.0, 0.0), abs=1e-4 if way.jerk else 2.1)

    @pytest.mark.parametrize("distance", [0.5, 7.9, 8.1, 100.0, -30.0])
    def test_from_rest_it_takes_the_trapezoids_time_and_the_jerks(self, distance: float) -> None:
        far = abs(distance)
        shortest_s = 2 * math.sqrt(far / 2.0) if far < 8.0 else far / 4.0 + 4.0 / 2.0
        # Where it does not cruise, acceleration has to turn to its opposite.
        turn = 1 if far > 8.0 + 4.0 * 0.05 else 2
        way = Trajectory(distance, 0.0, 4.0, 2.0, 40.0)
        assert way.duration_s == pytest.approx(shortest_s + turn * 2.0 / 40.0, abs=1e-9)

    def test_position_is_the_integral_of_the_rate(self) -> None:
        way = Trajectory(25.0, -1.5, 4.0, 2.0, 10.0)
        times = np.linspace(0.0, way.duration_s, 20001)
        position, rate, _ = np.array([way.at(float(t)) for t in times]).T
        gone = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(times))])
        assert position - position[0] == pytest.approx(gone, abs=1e-5)


class TestLimits:
    @given(
        rates=st.lists(st.tuples(st.floats(-6.0, 6.0), st.floats(0.01, 8.0)), min_size=1, max_size=12),
        seconds=st.sampled_from([0.05, 0.0625, 0.3]),
    )
    @settings(max_examples=50, deadline=None)
    def test_no_rate_takes_it_past_the_hard_limit(
        self, rates: list[tuple[float, float]], seconds: float
    ) -> None:
        reference = Reference(2.0, 4.0, 0.0, travel_deg=(-15.0, 15.0))
        for rate, lasting_s in rates:
            reference.run(rate)
            for _ in range(math.ceil(lasting_s / seconds)):
                before = reference.rate_deg_s
                reference.step(seconds)
                assert abs(reference.position_deg) <= 15.0 + 1e-6
                assert abs(reference.rate_deg_s - before) <= 2.0 * seconds + 1e-9

    def test_it_stops_close_to_the_limit_says_so_and_comes_back(self) -> None:
        reference = Reference(2.0, 4.0, 0.0, travel_deg=(-15.0, 15.0))
        reference.run(3.0)
        for _ in range(400):
            reference.step(0.05)
        assert reference.position_deg == pytest.approx(15.0, abs=0.1)
        assert (abs(reference.rate_deg_s) < 0.01, reference.limited) == (True, True)
        reference.run(-1.0)
        for _ in range(100):
            reference.step(0.05)
        assert reference.rate_deg_s == -1.0
        assert not reference.limited
        assert reference.position_deg == pytest.approx(15.0 - 5.0, abs=0.5)

    def test_each_end_of_the_travel_stands_for_itself(self) -> None:
        reference = Reference(2.0, 4.0, 0.0, travel_deg=(-40.0, 15.0))
        for rate, end_deg in ((-3.0, -40.0), (3.0, 15.0)):
            reference.run(rate)
            for _ in range(800):
                reference.step(0.05)
                assert -40.0 - 1e-6 <= reference.position_deg <= 15.0 + 1e-6
            assert reference.position_deg == pytest.approx(end_deg, abs=0.1)
            assert reference.limited


class TestFriction:
    def test_without_power_it_coasts_v_squared_over_twice_the_friction(self) -> None:
        moved = axis(inertia_a_per_deg_s2=0.15, friction_a=0.3)
        moved.place(5.0, 2.0)
        moved.coast()
        energies = sampled(moved, 2.0, 0.01)[:, 1] ** 2
        assert (np.diff(energies) <= 0.0).all()
        assert energies[-1] == 0.0
        assert moved.position_deg == pytest.approx(5.0 + 2.0**2 / (2 * 0.3 / 0.15), abs=1e-9)
        assert moved.current_a == 0.0

    @pytest.mark.parametrize(
        ("current_a", "moves"), [(0.59, False), (-0.59, False), (0.61, True), (-0.61, True)]
    )
    def test_it_breaks_loose_above_the_stiction_alone(self, current_a: float, moves: bool) -> None:
        plant = axis(friction_a=0.4, stiction_a=0.6).plant
        for _ in range(200):
            plant.push(current_a, STEP_S)
        assert (plant.rate_deg_s != 0.0) is moves
        if moves:
            # Once loose, Coulomb friction alone brakes it.
            expected = math.copysign((abs(current_a) - 0.4) / 0.15 * 0.2, current_a)
            assert plant.rate_deg_s == pytest.approx(expected, rel=0.01)

    def test_sticking_is_exact_rest(self) -> None:
        plant = axis(friction_a=0.4, stiction_a=0.6).plant
        plant.place(0.0, 0.5)
        for _ in range(1000):
            plant.push(0.3, STEP_S)
        assert plant.rate_deg_s == 0.0
        at_deg = plant.position_deg
        for _ in range(1000):
            plant.push(-0.55, STEP_S)
        assert plant.position_deg == at_deg

    def test_without_an_integral_the_offset_is_friction_over_stiffness(self) -> None:
        """Balance of forces: inertia x omega^2 x error = friction."""
        moved = axis(bandwidth_hz=5.0, friction_a=0.5, friction_feedforward=0.0)
        moved.reference.place(0.0, 0.0)
        moved.run(1.0)
        sampled(moved, 4.0)
        offset = moved.reference.position_deg - moved.position_deg
        assert offset == pytest.approx(0.5 / 0.15 / (2 * math.pi * 5.0) ** 2, rel=0.01)
        assert offset * 3600 == pytest.approx(12.0, abs=0.3)

    def test_an_integral_takes_the_offset_away(self) -> None:
        moved = axis(bandwidth_hz=5.0, integral_hz=0.5, friction_a=0.5, friction_feedforward=0.0)
        moved.run(1.0)
        sampled(moved, 6.0)
        assert abs(moved.reference.position_deg - moved.position_deg) * 3600 < 0.02

    def test_sidereal_tracking_through_stiction_neither_sticks_nor_hunts(self) -> None:
        sidereal = 15.041 / 3600
        moved = axis(
            bandwidth_hz=12.0, integral_hz=2.0, friction_a=0.5, stiction_a=0.6, friction_feedforward=0.7
        )
        moved.run(sidereal)
        sampled(moved, 5.0)
        rows = sampled(moved, 20.0)
        wanted = moved.reference.position_deg - sidereal * STEP_S * np.arange(len(rows))[::-1]
        assert np.abs(rows[:, 0] - wanted).max() * 3600 < 0.1


class TestRipple:
    def test_its_period_is_a_share_of_the_turn(self) -> None:
        moved = axis(bandwidth_hz=5.0, friction_a=0.0, ripple_a=0.05, ripple_per_turn=60)
        moved.run(2.0)
        sampled(moved, 4.0)
        rows = sampled(moved, 30.0)
        error = rows[:, 0] - np.polyval(np.polyfit(np.arange(len(rows)), rows[:, 0], 1), np.arange(len(rows)))
        spectrum = np.abs(np.fft.rfft(error * np.hanning(len(error))))
        frequency_hz = np.fft.rfftfreq(len(error), STEP_S)[spectrum.argmax()]
        assert frequency_hz == pytest.approx(2.0 * 60 / 360, abs=1 / 30)

    def test_none_is_left_without_power(self) -> None:
        moved = axis(friction_a=0.0, ripple_a=0.05)
        moved.place(0.0, 1.0)
        moved.coast()
        moved.advance(3.0)
        assert (moved.velocity_deg_s, moved.position_deg) == (1.0, 3.0)


class TestCurrent:
    def test_it_is_limited_and_with_it_the_acceleration(self) -> None:
        limits = AxisLimits(max_acceleration_deg_s2=10.0, slew_rate_deg_s=10.0)
        moved = axis(limits, inertia_a_per_deg_s2=0.15, friction_a=0.5, current_limit_a=1.0, integral_hz=1.0)
        moved.run(5.0)
        rows = sampled(moved, 1.0)
        assert rows[:, 3].max() == 1.0
        assert rows[10:900, 2] == pytest.approx((1.0 - 0.5) / 0.15, rel=1e-6)
        assert moved.velocity_deg_s == pytest.approx(0.5 / 0.15 * 1.0, rel=0.02)
        sampled(moved, 10.0)
        assert moved.velocity_deg_s == pytest.approx(5.0, abs=1e-3)

    def test_a_place_is_reached_when_the_servo_is_there_and_not_before(self) -> None:
        limits = AxisLimits(max_acceleration_deg_s2=10.0, slew_rate_deg_s=10.0)
        quick, weak = axis(limits), axis(limits, current_limit_a=1.0)
        took_s = []
        for moved in (quick, weak):
            moved.go(20.0, 0.0)
            time_s = 0.0
            while moved.going:
                moved.advance(0.05)
                time_s += 0.05
                assert time_s < 60.0
            took_s.append(time_s)
            assert moved.position_deg == pytest.approx(20.0, abs=0.01)
        assert took_s[1] > took_s[0] + 1.0

    def test_an_axis_that_cannot_move_is_refused_by_name(self) -> None:
        with pytest.raises(ValueError, match=r"stiction_a is 0\.1, below friction_a"):
            ServoSettings(friction_a=0.5, stiction_a=0.1)


class TestStructure:
    def test_it_rings_at_its_frequency_and_falls_to_1_over_e_in_its_time(self) -> None:
        swing = Swing(1.0 / 3600.0, frequency_hz=4.0, decay_s=0.5)
        step_s = 1e-4
        for _ in range(60000):
            swing.step(2.0, step_s)
        assert swing.deflection_deg == pytest.approx(-2.0 / 3600.0, rel=1e-3)
        deflections = []
        for _ in range(10000):
            swing.step(0.0, step_s)
            deflections.append(swing.deflection_deg)
        ringing = np.array(deflections)
        crossings = np.nonzero(np.diff(np.sign(ringing)))[0]
        damped_hz = math.sqrt(4.0**2 - (1 / 0.5 / (2 * math.pi)) ** 2)
        assert np.diff(crossings).mean() * step_s == pytest.approx(0.5 / damped_hz, rel=0.01)
        troughs = [abs(ringing[a:b]).max() for a, b in itertools.pairwise(crossings)]
        fall = troughs[2] / troughs[0]
        assert fall == pytest.approx(math.exp(-1 / damped_hz / 0.5), rel=0.02)


class TestEncoder:
    @given(angle=st.floats(-170.0, 170.0))
    def test_it_reads_the_whole_tic_below(self, angle: float) -> None:
        read = Encoder(2**26).read(angle)
        assert -1e-9 <= angle - read < TIC_DEG * (1 + 1e-6)
        assert abs(read / TIC_DEG - round(read / TIC_DEG)) < 1e-6

    def test_its_noise_is_as_wide_as_said_and_without_bias(self) -> None:
        encoder = Encoder(2**26, noise_tics=3.0, seed="x")
        off = np.array([encoder.read(10.0) / TIC_DEG for _ in range(4000)]) - 10.0 / TIC_DEG
        assert off.min() == pytest.approx(-3.5, abs=0.6)
        assert off.max() == pytest.approx(2.5, abs=0.6)
        assert off.mean() == pytest.approx(-0.5, abs=0.1)

    @pytest.mark.parametrize(
        ("stands", "reads"), [(170.0, 170.0), (190.0, -170.0), (-190.0, 170.0), (370.0, 10.0)]
    )
    def test_at_power_up_it_reads_within_half_a_turn(self, stands: float, reads: float) -> None:
        """ "Beyond 180 degrees, the Renishaw encoder will report that as a negative angle"."""
        assert Encoder(2**26).at_power_up(stands) == pytest.approx(reads)

    def test_its_own_zero_decides_where_the_wrap_lies(self) -> None:
        encoder = Encoder(2**26, zero_deg=30.0)
        assert encoder.at_power_up(149.0) == pytest.approx(149.0)
        assert encoder.at_power_up(151.0) == pytest.approx(151.0 - 360.0)
        assert encoder.read(151.0) == pytest.approx(151.0, abs=2 * TIC_DEG)

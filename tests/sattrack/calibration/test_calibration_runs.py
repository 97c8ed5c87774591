"""What whole runs find out of mounts in closed form, against what those mounts are."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from calibration import Network, Timer
from calibration_builders import BEGIN, Ended, run
from ramp_mount import RampMount

from sattrack.calibration.clocks import clock_line
from sattrack.calibration.findings import (
    ClockTruth,
    Findings,
    MeasuredDelays,
    conclude,
    round_trip,
    split_delays,
)
from sattrack.calibration.guard import EndKind
from sattrack.calibration.profile import found_rows

FEW = (1, 5, 8)
"""Edge and held, added to tracking and in its place, both sides of the pole, each law of the timer."""


def drawn(seed: int) -> tuple[RampMount, Network, Timer]:
    rng = np.random.default_rng([seed, 20])

    def either(a: object, b: object) -> object:
        return a if rng.random() < 0.5 else b

    mount = RampMount(
        hour_angle=float(rng.uniform(-40, 40)),
        declination=float(rng.uniform(5, 70)),
        ra_sign=either(1, -1),
        dec_sign=either(1, -1),
        ra_gain=float(rng.uniform(0.9, 1.1)),
        dec_gain=float(rng.uniform(0.9, 1.1)),
        additive=either(True, False),
        edge=either(True, False),
        beyond_pole=either(True, False),
        ra_acceleration=float(rng.uniform(2, 20)),
        dec_acceleration=float(rng.uniform(2, 20)),
        clock_ahead=float(rng.uniform(-10, 10)),
        clock_drift=float(rng.uniform(-5e-5, 5e-5)),
        doubles=either(True, False),
    )
    network = Network(
        float(rng.uniform(0, 0.08)),
        float(rng.uniform(0, 0.08)),
        (0.0, 0.0005, 0.002)[seed % 3],
        0.01 * (seed % 2),
    )
    law = ("even", "windows", "loose")[seed // 3 % 3]
    return mount, network, Timer(law, phase_s=float(rng.uniform(0, 0.05)))


@functools.cache
def ended_of(seed: int) -> Ended:
    mount, network, timer = drawn(seed)
    return run(mount, network, timer, seed=seed)


@functools.cache
def found_of(seed: int) -> Findings:
    ended = ended_of(seed)
    return conclude(ended.calibrator.seen, ended.mount.longitude)


@pytest.mark.parametrize(
    "seed", [n if n in FEW else pytest.param(n, marks=pytest.mark.soak) for n in range(9)]
)
def test_a_drawn_mount_is_found_out_as_it_is(seed: int) -> None:
    _, network, _ = drawn(seed)
    ended = ended_of(seed)
    mount = ended.mount
    assert ended.calibrator.ending is not None
    assert ended.calibrator.ending.kind is EndKind.DONE
    assert ended.calibrator.ending.at_rest
    found = found_of(seed)
    assert (found.ra.sign, found.dec.sign) == (mount.ra_sign, mount.dec_sign)
    assert found.additive == mount.additive
    assert found.move_axis == ("edge" if mount.edge else "held")
    assert found.zero_ends == (True if mount.edge else None)
    assert found.beyond_pole == mount.beyond_pole
    assert found.ra.gain == pytest.approx(mount.ra_gain, abs=2e-5)
    assert found.dec.gain == pytest.approx(mount.dec_gain, abs=2e-5)
    for motion, true in (
        (found.ra_motion, mount.ra_acceleration),
        (found.dec_motion, mount.dec_acceleration),
    ):
        braking = motion.braking
        assert braking is not None
        assert braking.limited
        assert braking.acceleration_deg_s2 == pytest.approx(true, rel=0.01)
        assert braking.acceleration_sigma_deg_s2 is not None
        assert braking.acceleration_sigma_deg_s2 <= 0.1 * true
        assert braking.stop.deg == pytest.approx(braking.stop.rate_deg_s**2 / (2.0 * true), rel=0.02)
        assert motion.lag is not None
        # A step of 0.02 deg/s takes 0.02 / a seconds, and half of that is its mean delay.
        assert motion.lag.seconds == pytest.approx(0.01 / true, abs=2.0 * motion.lag.sigma_s)
    assert found.rate_fields == "true"
    assert found.clock.drift_ppm == pytest.approx(mount.clock_drift * 1e6, abs=3.0)
    assert found.readings["counter"] == ("double" if mount.doubles else "int64")

    delays, late = found.delays, network.jitter_s
    truth = network.command_s + network.status_s + 2 * late
    assert delays.round_trip.seconds == pytest.approx(truth, abs=0.0015)
    for interval, least in ((delays.command_s, network.command_s), (delays.status_s, network.status_s)):
        assert interval[0] <= least
        assert least + late <= interval[1]
        assert interval[1] - interval[0] <= truth + 0.004
    ahead = mount.clock(found.utc_s) - found.utc_s
    assert delays.clock_offset_s[0] <= ahead <= delays.clock_offset_s[1]
    assert delays.clock_offset_s[1] - delays.clock_offset_s[0] <= truth + 0.004


@functools.cache
def ended_half_a_second_behind() -> Ended:
    return run(RampMount(clock_ahead=-0.5), Network(0.030, 0.010))


def delays_if(truth: ClockTruth) -> tuple[MeasuredDelays, tuple[str, ...]]:
    """Return what is found of the delays, and the notes, if this is stated of the clock."""
    ended = ended_half_a_second_behind()
    seen, notes = ended.calibrator.seen, list[str]()
    line = clock_line(seen.log.heard)
    trip = round_trip(seen, line)
    return split_delays(trip, seen.log.heard[-1], line, ended.mount.longitude, truth, notes), tuple(notes)


def test_a_clock_stated_to_be_true_tells_the_two_ways_apart() -> None:
    # The clock is of kind b, half a second behind mean time with UT1 = UTC.
    delays, _ = delays_if(ClockTruth(0.002, {"a": 0.0, "b": -0.5, "c": 0.7}))
    assert delays.clock_reading == "b"
    assert delays.status_s[0] <= 0.010 <= delays.status_s[1]
    assert delays.command_s[0] <= 0.030 <= delays.command_s[1]
    assert delays.status_s[1] - delays.status_s[0] < 0.008
    assert delays.command_s[1] - delays.command_s[0] < 0.008


def test_two_kinds_of_clock_that_fit_alike_leave_an_interval_over_both() -> None:
    delays, notes = delays_if(ClockTruth(0.001, {"by UTC": -0.5, "by UT1": -0.48}))
    assert delays.clock_reading is None
    assert delays.status_s[0] <= 0.010
    assert delays.status_s[1] >= 0.030
    assert any("by UTC and by UT1" in note for note in notes)


def test_a_clock_stated_to_be_true_that_is_not_is_told_and_left_out() -> None:
    delays, notes = delays_if(ClockTruth(0.002, {"mean": -3.5}))
    assert any("not true to 0.002 s" in note for note in notes)
    assert delays.status_s[0] == 0.0
    assert delays.clock_offset_s[0] <= -0.5 <= delays.clock_offset_s[1]


def test_the_run_stays_near_where_it_began_and_ends_near_it() -> None:
    mount = RampMount(ra_gain=1.1, dec_gain=1.1, ra_sign=-1, edge=True)
    farthest = [0.0, 0.0]

    def watch(now: float, _: object) -> None:
        for i, (axis, began) in enumerate(((mount.ra, mount.hour_angle), (mount.dec, mount.declination))):
            farthest[i] = max(farthest[i], abs(axis.at(now)[0] - began))

    ended = run(mount, Network(0.08, 0.08), watch=watch)
    assert 0.5 < max(farthest) < ended.calibrator.plan.largest_displacement_deg()
    assert abs(mount.ra.at(ended.run.now_utc_s)[0] - mount.hour_angle) < 2.0
    assert abs(mount.dec.at(ended.run.now_utc_s)[0] - mount.declination) < 2.0


def test_the_same_inputs_give_the_same_datagrams() -> None:
    assert run(*drawn(FEW[0]), seed=FEW[0]).run.commands == ended_of(FEW[0]).run.commands


def test_every_finding_is_told_with_what_is_not_known_of_it() -> None:
    rows = dict(found_rows(found_of(FEW[0])))
    assert "±" in rows["right ascension, gain"]
    assert "±" in rows["round trip"]
    assert " to " in rows["status delay"]


def test_axes_that_disagree_on_held_and_edge_are_no_finding() -> None:
    from sattrack.calibration.guard import CalibrationEndedError

    seen = run(RampMount()).calibrator.seen
    one, other = seen.semantics
    seen.semantics[1] = dataclasses.replace(
        other, second_deg_s=other.first_deg_s, after_deg_s=other.first_deg_s
    )
    with pytest.raises(CalibrationEndedError, match="do not agree"):
        conclude(seen, 4.5)
    seen.semantics[1] = dataclasses.replace(one, second_deg_s=0.75 * one.first_deg_s)
    with pytest.raises(CalibrationEndedError, match="neither held nor edge"):
        conclude(seen, 4.5)


def test_the_stand_in_follows_its_own_closed_form() -> None:
    mount = RampMount(dec_acceleration=2.0)
    mount.begin(BEGIN)
    mount.dec.go(BEGIN + 1.0, 1.0)
    # Half a second of ramp covers 0.25 degrees, then 1 degree a second.
    assert mount.dec.at(BEGIN + 1.5)[0] - mount.declination == pytest.approx(0.25)
    assert mount.dec.at(BEGIN + 3.5)[0] - mount.declination == pytest.approx(2.25)

"""Whole passes in the bench's harness: true axes against the satellite, one seed of each scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

import feeder
import feeder_calibrated
import pytest

if TYPE_CHECKING:
    from feeder_harness import Scenario

ISS, KANOPUS = 0, 1


@pytest.fixture(scope="module")
def subject() -> feeder.Subject:
    return feeder.subjects()[ISS]


@pytest.mark.parametrize("scenario", feeder.SCENARIOS, ids=lambda scenario: scenario.name)
def test_a_pass_is_followed_within_the_scenarios_bounds(subject: feeder.Subject, scenario: Scenario) -> None:
    rms_arcsec, peak_arcsec, back_s = feeder.ours(subject, scenario, seed=1)
    assert rms_arcsec <= scenario.bounds_arcsec[0]
    assert peak_arcsec <= scenario.bounds_arcsec[1]
    assert back_s <= feeder.BACK_WITHIN_S
    # Errors of nothing at all would be as suspicious: the encoders' noise alone is 0.006″.
    assert rms_arcsec > 0.005


def test_nudges_are_settled_in_two_seconds_and_no_rate_steps(subject: feeder.Subject) -> None:
    rms_arcsec, peak_arcsec, worst_step, longest_s = feeder.nudged(subject, seed=1)
    bounds = feeder.SCENARIOS[0].bounds_arcsec
    assert 0.005 < rms_arcsec <= bounds[0]
    assert peak_arcsec <= bounds[1]
    assert 0.1 < worst_step <= 1.0
    assert longest_s <= 2.0 + 1e-6


def test_the_strongest_simple_rival_is_far_behind_where_delays_vary(subject: feeder.Subject) -> None:
    scenario = next(s for s in feeder.SCENARIOS if "±" in s.name)
    theirs = feeder.rival(subject, scenario, 1, "FF + PI at 20 Hz, delay given").rms_arcsec
    assert theirs > 2.0 * feeder.ours(subject, scenario, 1).rms_arcsec


@pytest.mark.parametrize("subject_number", [KANOPUS])
def test_an_edge_mount_is_followed_nearly_as_an_oracle_would(subject_number: int) -> None:
    scenario = next(s for s in feeder.SCENARIOS if s.name == "edge")
    one = feeder.subjects()[subject_number]
    theirs = feeder.rival(one, scenario, 1, feeder.ORACLE).rms_arcsec
    ours = feeder.ours(one, scenario, 1).rms_arcsec
    assert ours <= max(feeder.ORACLE_ARCSEC, feeder.ORACLE_RATIO * theirs)


def test_losses_leave_no_old_rates_in_force_for_long() -> None:
    """Where the rate changes fastest; without copies, losses in a row come to more than two arcseconds."""
    scenario = next(s for s in feeder.SCENARIOS if s.link.loss)
    assert feeder.ours(feeder.subjects()[KANOPUS], scenario, seed=1).peak_arcsec < 1.0


def test_slow_drives_that_stick_are_followed_past_where_an_axis_turns_back() -> None:
    scenario = next(s for s in feeder.SCENARIOS if s.servo)
    rms_arcsec, peak_arcsec, _ = feeder.ours(feeder.subjects()[KANOPUS], scenario, seed=2, bandwidth_hz=3.0)
    assert rms_arcsec <= 0.2
    assert peak_arcsec <= scenario.bounds_arcsec[1]


def test_what_a_calibration_leaves_open_is_said_beforehand_and_no_more_comes_of_it(
    subject: feeder.Subject,
) -> None:
    """Delays of 5 and 35 ms that nobody tells; the calibration takes each for the half of their sum."""
    figures = feeder_calibrated.follow(subject, feeder_calibrated.SCENARIOS[1], seed=1)
    assert figures.peak_share <= 1.0
    assert figures.rms_share <= 1.0
    assert 0.5 < figures.implied_share <= 1.0
    # 15 ms at 1 °/s, and what the calibration itself is unsure of.
    assert 54.0 <= figures.announced_arcsec < 90.0

"""Whole passes in the bench's harness: true axes against the satellite, one seed of each scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

import feeder
import pytest

if TYPE_CHECKING:
    from feeder_harness import Scenario

ISS = 0


@pytest.fixture(scope="module")
def subject() -> feeder.Subject:
    return feeder.subjects()[ISS]


@pytest.mark.parametrize("scenario", feeder.SCENARIOS, ids=lambda scenario: scenario.name)
def test_a_pass_is_followed_within_the_scenarios_bounds(subject: feeder.Subject, scenario: Scenario) -> None:
    rms_arcsec, peak_arcsec = feeder.ours(subject, scenario, seed=1)
    assert rms_arcsec <= scenario.bounds_arcsec[0]
    assert peak_arcsec <= scenario.bounds_arcsec[1]
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
    make = feeder.rivals(subject, scenario)["FF + PI at 20 Hz, delay given"]
    theirs, _ = feeder.rival(subject, scenario, 1, make)
    assert theirs > 2.0 * feeder.ours(subject, scenario, 1)[0]

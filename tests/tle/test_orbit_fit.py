"""Orbital corrections against SGP4 itself, and a filter of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sattrack.runtime import demo_pass
from tle.bias import Bias
from tle.elements import Elements
from tle.instants import DAY_S, Utc
from tle.orbit_filter import FilterBank, OrbitFilter
from tle.orbit_fit import ALONG, STATES, CorrectableOrbit, Sighting
from tle.propagator import Propagator

MOLNIYA = (
    "1 40296U 14069A   26100.50000000  .00000100  00000-0  00000+0 0  9990",
    "2 40296  63.4000 120.0000 7000000 270.0000  20.0000  2.00600000 10000",
)
GATE = 18.4


def orbit(elements: Elements | None = None, days: float = 1.0) -> CorrectableOrbit:
    given = elements or demo_pass.elements()
    return CorrectableOrbit(given, Utc(float(given.epoch.unix_s) + days * DAY_S))


def places_km(elements: Elements, about: Utc, part_s: float) -> np.ndarray:
    site = demo_pass.SITE.place()
    seen = [
        Propagator(elements, site, place="geometric").at(Utc(float(about.unix_s) + s * part_s))
        for s in (-1, 0, 1)
    ]
    return np.array([one.unit * one.range_km for one in seen])


@pytest.mark.parametrize("days", [-3.0, 0.0, 13.0])
@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"inclination_deg": 0.01, "eccentricity": 1e-6, "mean_motion_rev_day": 1.0027},
        {"inclination_deg": 144.0},
        {"inclination_deg": 63.4, "eccentricity": 0.7, "mean_motion_rev_day": 2.006},
    ],
)
def test_elements_moved_to_another_epoch_keep_their_orbit_about_it(
    fields: dict[str, float], days: float
) -> None:
    given = replace(demo_pass.elements(), **fields)
    one = orbit(given, days)
    before, after = (places_km(elements, one.epoch, 300.0) for elements in (given, one.elements))
    assert np.abs(before - after).max() < 0.02
    assert one.corrected(np.zeros(STATES)).epoch == one.epoch


@pytest.mark.parametrize("state", range(STATES))
def test_a_correction_of_a_km_moves_the_satellite_by_about_as_much(state: int) -> None:
    one = orbit()
    moved = places_km(one.corrected(np.eye(STATES)[state]), one.epoch, 700.0) - places_km(
        one.elements, one.epoch, 700.0
    )
    most = np.linalg.norm(moved, axis=1).max()
    assert 0.3 < most < 3.0


def test_a_correction_along_is_a_time_bias() -> None:
    one = orbit()
    site, ahead_s = demo_pass.SITE.place(), 3.0
    correction = np.eye(STATES)[ALONG] * ahead_s * one.speed_km_s
    moved = Propagator(one.corrected(correction), site, place="geometric").at(one.epoch)
    biased = Propagator(one.elements, site, place="geometric").at(one.epoch, Bias(ahead_s))
    assert np.linalg.norm(moved.unit * moved.range_km - biased.unit * biased.range_km) < 0.1


def sightings(true: Propagator, believed: Propagator, about: Utc, count: int, seed: int) -> list[Sighting]:
    rng = np.random.default_rng(seed)
    sigma = np.radians(3.0 / 3600.0)
    found = []
    for i in range(count):
        t = Utc(float(about.unix_s) + 2.0 * i)
        unit = true.at(t).unit + rng.normal(0.0, sigma, 3)
        found.append(Sighting(t, unit / np.linalg.norm(unit), sigma, believed))
    return found


def test_errors_are_as_large_as_the_covariance_says() -> None:
    """Errors drawn from what is expected, then filtered: the squared distance is that of six degrees."""
    one = orbit()
    believed = Propagator(one.elements, demo_pass.SITE.place())
    expected = one.expected()
    root = np.linalg.cholesky(expected.covariance_km2)
    rng = np.random.default_rng(3)
    distances = []
    for seed in range(20):
        off = root @ rng.normal(size=STATES)
        true = believed.with_elements(one.corrected(off))
        known = OrbitFilter(one, expected)
        for sighting in sightings(true, believed, one.epoch, 40, seed):
            assert known.observe(sighting, GATE)
        gap = known.correction_km - off
        distances.append(float(gap @ np.linalg.solve(known.covariance_km2, gap)))
    # The mean of twenty has a sigma of 0.77; noise that is expected, and not there, makes it smaller.
    assert 2.5 < np.mean(distances) < 8.3


def test_the_order_of_sightings_matters_little_and_a_rejected_one_not_at_all() -> None:
    one = orbit()
    believed = Propagator(one.elements, demo_pass.SITE.place())
    true = believed.with_elements(one.corrected(np.array([20.0, 0.1, 0.3, -0.3, 0.1, 0.2])))
    made = sightings(true, believed, one.epoch, 30, 1)
    prompt, late = OrbitFilter(one, one.expected()), OrbitFilter(one, one.expected())
    for sighting in made:
        assert prompt.observe(sighting, GATE)
    before = prompt.correction_km.copy()
    wild = replace(made[3], unit=-made[3].unit)
    assert not prompt.observe(wild, GATE)
    assert np.array_equal(prompt.correction_km, before)
    for i in (0, 5, 3, 4, 1, 2, *range(29, 5, -1)):
        assert late.observe(made[i], GATE)
    assert np.allclose(late.correction_km, prompt.correction_km, atol=0.05)
    assert np.trace(late.covariance_km2) > np.trace(prompt.covariance_km2), "noise since then counts"


@pytest.mark.parametrize("times", [1.0, 8.0])
def test_the_mean_of_filters_is_as_sure_as_it_may_be_however_far_elements_are_off(times: float) -> None:
    """Errors drawn from what is expected, or from eight times as much; nothing says which."""
    one = orbit()
    believed = Propagator(one.elements, demo_pass.SITE.place())
    root = np.linalg.cholesky(one.expected(times).covariance_km2)
    rng = np.random.default_rng(5)
    distances = []
    for seed in range(20):
        true = believed.with_elements(one.corrected(root @ rng.normal(size=STATES)))
        bank = FilterBank(one, seen_by_camera=True)
        for sighting in sightings(true, believed, one.epoch, 40, seed)[:12]:
            bank.observe(sighting, GATE)
        # Ahead, where the filters part.
        at = sighting.utc.plus(20.0)
        unit, spread = bank.pointing(believed, at, False)
        off = true.at(at).unit - unit
        distances.append(float(off @ np.linalg.pinv(spread, rcond=1e-6) @ off))
    assert sum(distance < 2.0**2 + 2.0 for distance in distances) >= 17, distances
    assert 0.6 < np.mean(distances) < 4.0


def test_a_sighting_that_the_best_filter_rejects_leaves_the_mean_as_it_was() -> None:
    one = orbit()
    believed = Propagator(one.elements, demo_pass.SITE.place())
    true = believed.with_elements(one.corrected(np.array([20.0, 0.1, 0.3, -0.3, 0.1, 0.2])))
    made = sightings(true, believed, one.epoch, 30, 1)
    bank = FilterBank(one, seen_by_camera=True)
    for sighting in made:
        assert bank.observe(sighting, GATE)
    before = bank.correction_km, bank.pointing(believed, made[-1].utc, False)
    left = np.cross([0.0, 0.0, 1.0], made[9].unit)
    beside = made[9].unit + 6.0 * made[9].sigma_rad * left / np.linalg.norm(left)
    assert not bank.observe(replace(made[9], unit=beside / np.linalg.norm(beside)), GATE)
    assert np.array_equal(bank.correction_km, before[0])
    assert all(map(np.array_equal, bank.pointing(believed, made[-1].utc, False), before[1]))


def test_elements_of_great_eccentricity_are_corrected_too() -> None:
    given = Elements.from_tle(*(with_checksum(line) for line in MOLNIYA))
    one = orbit(given, 0.3)
    believed = Propagator(one.elements, demo_pass.SITE.place())
    off = np.array([30.0, 0.5, 1.0, -1.0, 0.5, 0.5])
    known = OrbitFilter(one, one.expected())
    for sighting in sightings(believed.with_elements(one.corrected(off)), believed, one.epoch, 30, 1):
        assert known.observe(sighting, GATE)
    apart = places_km(one.corrected(known.correction_km), one.epoch, 30.0) - places_km(
        one.corrected(off), one.epoch, 30.0
    )
    site_to_it = places_km(one.corrected(off), one.epoch, 30.0)
    across = np.cross(apart, site_to_it / np.linalg.norm(site_to_it, axis=1)[:, None])
    assert np.linalg.norm(across, axis=1).max() < 3.0


def with_checksum(line: str) -> str:
    total = sum(int(c) if c.isdigit() else c == "-" for c in line[:68])
    return f"{line[:68]}{total % 10}"

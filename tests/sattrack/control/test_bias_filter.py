"""The filter of biases against a satellite that really runs early: its errors against its own sigma."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

from sattrack import practice
from sattrack.control.bias_filter import BiasFilter
from tle.bias import Bias
from tle.instants import Utc
from tle.propagator import Propagator
from tle.residuals import bias_from_observation

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
EARLY_S = 3.0
SIGMA_ARCSEC = 20.0
SOLUTIONS = 20


def run(seed: int) -> tuple[BiasFilter, float]:
    """Return the filter after one solution a second, and its error on the sky at the last, arcseconds."""
    rng = random.Random(seed)
    elements = practice.elements()
    site = practice.SITE.place()
    true = Propagator(replace(elements, epoch=Utc(float(elements.epoch.unix_s) - EARLY_S)), site)
    believed = Propagator(elements, site)
    known = BiasFilter()
    for second in range(SOLUTIONS):
        utc = Utc(CULMINATION_S + second)
        seen = true.with_place("astrometric").at(utc)
        noise_deg = SIGMA_ARCSEC / 3600.0
        dec = float(seen.dec_deg) + rng.gauss(0.0, noise_deg)
        ra = float(seen.ra_deg) + rng.gauss(0.0, noise_deg) / math.cos(math.radians(float(seen.dec_deg)))
        said = bias_from_observation(believed, ra % 360.0, dec, utc, "icrf", SIGMA_ARCSEC)
        known.observe(
            float(utc.unix_s), said.along_s, said.cross_deg, said.along_sigma_s, said.cross_sigma_deg
        )
    pointed = believed.at(utc, Bias(known.along_s, known.cross_deg)).unit
    chord = float(sum((a - b) ** 2 for a, b in zip(pointed, true.at(utc).unit, strict=True))) ** 0.5
    return known, math.degrees(2.0 * math.asin(0.5 * chord)) * 3600.0


def judge(seeds: int, slack: float) -> None:
    runs = [run(seed) for seed in range(seeds)]
    along = sum(abs(k.along_s - EARLY_S) <= 2.0 * k.along_sigma_s for k, _ in runs)
    cross = sum(abs(k.cross_deg) <= 2.0 * k.cross_sigma_deg for k, _ in runs)
    near = sum(error <= 2.5 * SIGMA_ARCSEC / math.sqrt(SOLUTIONS) for _, error in runs)
    print(f"{seeds} seeds: along {along / seeds:.3f}, cross {cross / seeds:.3f}, near {near / seeds:.3f}")
    assert along / seeds == pytest.approx(0.95, abs=slack)
    assert cross / seeds == pytest.approx(0.95, abs=slack)
    assert near / seeds >= 0.95 - (slack if slack > 0.03 else 0.0)


def test_errors_match_the_sigma_over_some_seeds() -> None:
    judge(40, 0.09)


@pytest.mark.soak
def test_errors_match_the_sigma_over_five_hundred_seeds() -> None:
    judge(500, 0.03)


def test_what_lies_beyond_the_gate_changes_nothing_but_the_count() -> None:
    known = BiasFilter()
    assert known.observe(0.0, 3.0, 0.0, 0.01, 0.005)
    before = (known.along_s, known.cross_deg, known.along_sigma_s, known.cross_sigma_deg)
    assert not known.observe(1.0, 3.4, 0.3, 0.01, 0.005)
    assert (known.along_s, known.cross_deg, known.along_sigma_s, known.cross_sigma_deg) == before
    assert (known.accepted, known.rejected) == (1, 1)


def test_equal_observations_average_in_any_order() -> None:
    """The mean of n equal measurements: sigma over the root of n, late ones included."""
    known = BiasFilter()
    for utc_s, along_s in ((0.0, 3.0), (5.0, 3.02), (2.0, 2.99), (3.0, 2.99)):
        assert known.observe(utc_s, along_s, 0.0, 0.01, 0.001)
    assert known.along_s == pytest.approx(3.0, abs=1e-4)
    assert known.along_sigma_s == pytest.approx(0.005, rel=1e-2)

"""The filter of biases alone: its gate, and that equal observations average in any order."""

from __future__ import annotations

import pytest

from sattrack.control.steering import BiasFilter


def test_what_lies_beyond_the_gate_changes_nothing_but_the_count() -> None:
    known = BiasFilter()
    assert known.observe(0.0, 3.0, 0.0, 0.01, 0.005)
    before = (known.along_s, known.cross_km, known.along_sigma_s, known.cross_sigma_km)
    assert not known.observe(1.0, 3.4, 0.3, 0.01, 0.005)
    assert (known.along_s, known.cross_km, known.along_sigma_s, known.cross_sigma_km) == before
    assert (known.accepted, known.rejected) == (1, 1)


def test_equal_observations_average_in_any_order() -> None:
    """The mean of n equal measurements: sigma over the root of n, late ones included."""
    known = BiasFilter()
    for utc_s, along_s in ((0.0, 3.0), (5.0, 3.02), (2.0, 2.99), (3.0, 2.99)):
        assert known.observe(utc_s, along_s, 0.0, 0.01, 0.001)
    assert known.along_s == pytest.approx(3.0, abs=1e-4)
    assert known.along_sigma_s == pytest.approx(0.005, rel=1e-2)

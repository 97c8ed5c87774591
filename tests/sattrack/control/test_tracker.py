"""Errors on the sky against spherical trigonometry, and what the tracker asks of a mount."""

from __future__ import annotations

import math
from types import SimpleNamespace

import erfa
import pytest

from sattrack.control.target import sky_error

MOVING_NORTH = {"ra_rate_deg_s": 0.0, "dec_rate_deg_s": 0.5}


def target(ra_deg: float, dec_deg: float, **rates: float) -> SimpleNamespace:
    return SimpleNamespace(ra_deg=ra_deg, dec_deg=dec_deg, **{**MOVING_NORTH, **rates})


@pytest.mark.parametrize(
    ("mount", "goal"),
    [
        ((10.0, 20.0), (10.0, 20.0)),
        ((10.0, 20.0), (10.001, 20.002)),
        ((359.9999, 0.0), (0.0001, 0.0)),
        ((0.0, 89.999), (180.0, 89.999)),
        ((120.0, -45.0), (300.0, 45.0)),
        ((10.0, 60.0), (50.0, -20.0)),
    ],
)
def test_the_total_is_the_great_circle(mount: tuple[float, float], goal: tuple[float, float]) -> None:
    error = sky_error(0.0, *mount, target(*goal))  # type: ignore[arg-type]
    expected = erfa.seps(*(math.radians(x) for x in (*mount, *goal)))
    assert error.total_arcsec == pytest.approx(math.degrees(expected) * 3600.0, abs=1e-6)


def test_signs_for_a_northward_motion_overhead() -> None:
    """A mount to the north leads; one to the west (smaller RA) is to the left, seen from below."""
    north = sky_error(0.0, 100.0, 52.001, target(100.0, 52.0))  # type: ignore[arg-type]
    assert north.along_arcsec == pytest.approx(3.6)
    assert north.across_arcsec == pytest.approx(0.0)
    west = sky_error(0.0, 99.999, 52.0, target(100.0, 52.0))  # type: ignore[arg-type]
    assert west.across_arcsec == pytest.approx(3.6 * math.cos(math.radians(52.0)), rel=1e-6)
    assert west.along_arcsec == pytest.approx(0.0)


def test_signs_for_an_eastward_motion_overhead() -> None:
    moving = {"ra_rate_deg_s": 0.5, "dec_rate_deg_s": 0.0}
    error = sky_error(0.0, 100.001, 0.002, target(100.0, 0.0, **moving))  # type: ignore[arg-type]
    assert error.along_arcsec == pytest.approx(3.6, rel=1e-6)
    assert error.across_arcsec == pytest.approx(7.2, rel=1e-6)

"""What is expected of old elements, against what newer elements of the same objects say."""

from __future__ import annotations

import dataclasses
import math
import statistics

import pytest
from tle_facts import ISS, TDRS3

from tle.elements import Elements, Motion, expected_along_arcsec, expected_along_s
from tle.errors import PropagationError
from tle.sources import load_elements

ZARYA = Elements.from_tle(*ISS)


def test_the_three_parts_and_their_bound():
    calm = dataclasses.replace(ZARYA, mean_motion_dot_rev_day2=0.0)
    assert expected_along_s(calm, calm.epoch) == pytest.approx(0.05)
    assert expected_along_s(calm, calm.epoch.plus(10 * 86400.0)) == pytest.approx(math.hypot(0.05, 0.5))
    # Drag: 0.15 of 3.738e-5 turns a day squared, times 100 days squared and 92.98 minutes.
    dragged = expected_along_s(ZARYA, ZARYA.epoch.plus(100 * 86400.0))
    assert dragged == pytest.approx(math.hypot(0.15 * 3.738e-5 * 1e4 * 92.9807 * 60.0, 5.0), rel=1e-3)
    assert expected_along_s(ZARYA, ZARYA.epoch.plus(-8.64e6)) == dragged
    assert expected_along_s(ZARYA, ZARYA.epoch.plus(3e9)) == 0.5 * ZARYA.period_s


def test_on_the_sky():
    # At 416 km and 7.67 km/s, 0.05 s are 0.38 km, 190″; a geostationary one at 3.07 km/s and 35786 km, 0.9″.
    assert expected_along_arcsec(ZARYA, ZARYA.epoch) == pytest.approx(190.0, abs=2.0)
    tdrs = Elements.from_tle(*TDRS3)
    assert expected_along_arcsec(tdrs, tdrs.epoch) == pytest.approx(0.9, abs=0.05)


def test_catalogues_of_different_days_agree_with_it(cases):
    """Over months the expected error is the typical one: about half the objects come nearer."""
    folder = cases / "catalogues"
    older = {
        e.catalog_number: e for e in load_elements(folder / "omm_json_20250525" / "active_tle.dat").accepted
    }
    newer = load_elements(folder / "spacetrack_full_20250901.tle.gz").accepted
    shares = []
    for new in newer:
        old = older.get(new.catalog_number)
        if (
            old is None
            or old.mean_motion_rev_day < 11.0
            or new.name.startswith(("0 STARLINK", "STARLINK", "ONEWEB"))
        ):
            continue
        try:
            there = Motion(old).at(new.epoch.unix_s, 0.0)
            here = Motion(new).at(new.epoch.unix_s, 0.0)
        except PropagationError:
            continue
        speed = math.sqrt(sum(v * v for v in here[3:6]))
        along_km = sum((a - b) * v for a, b, v in zip(there[:3], here[:3], here[3:6], strict=True)) / speed
        shares.append(abs(along_km / speed) / expected_along_s(old, new.epoch))
    print(
        f"{len(shares)} objects, 131 days: median error {statistics.median(shares):.2f} of what is expected"
    )
    assert len(shares) > 500
    assert 0.3 < statistics.median(shares) < 3.0

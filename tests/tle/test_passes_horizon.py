from __future__ import annotations

import numpy as np
import pytest

from tle.errors import SiteError, SourceError
from tle.horizon import Horizon, HorizonMask

HILLS = HorizonMask((10.0, 100.0, 100.0, 350.0), (5.0, 20.0, 60.0, 15.0))


def test_the_skyline_is_linear_between_points_and_round_through_north():
    assert HILLS.altitude_deg(55.0) == pytest.approx(12.5)
    assert HILLS.altitude_deg(0.0) == pytest.approx(10.0)
    assert HILLS.altitude_deg(360.0) == pytest.approx(10.0)
    assert HILLS.altitude_deg(np.array([99.999, 100.001])) == pytest.approx([20.0, 60.0], abs=0.01)


def test_walls_on_both_sides_of_north():
    wall = HorizonMask((0.0, 40.0, 40.0, 320.0, 320.0, 360.0), (60.0, 60.0, 5.0, 5.0, 60.0, 60.0))
    inside = np.array([0.0, 20.0, 39.9, 320.1, 359.99, 360.0])
    assert wall.altitude_deg(inside).tolist() == [60.0] * 6
    assert wall.altitude_deg(np.array([40.1, 180.0, 319.9])).tolist() == [5.0] * 3
    at_north = HorizonMask((0.0, 0.0, 360.0, 360.0), (80.0, 5.0, 5.0, 80.0))
    assert at_north.altitude_deg(np.array([0.01, 90.0, 359.99])).tolist() == [5.0, 5.0, 5.0]


def test_bounds_hold_over_any_range_of_azimuths():
    horizon = Horizon(8.0, HILLS)
    rng = np.random.default_rng(2)
    azimuth, aside = rng.uniform(0.0, 360.0, 300), rng.uniform(0.0, 190.0, 300) ** rng.uniform(0.0, 1.0, 300)
    low, high = horizon.extremes_deg(azimuth, aside)
    for part in np.linspace(-1.0, 1.0, 201):
        skyline = horizon.altitude_deg((azimuth + part * aside) % 360.0)
        assert (low <= skyline + 1e-9).all()
        assert (high >= skyline - 1e-9).all()
    assert horizon.lowest_deg == 8.0
    flat = Horizon(12.0)
    assert flat.altitude_deg(3.0) == 12.0
    assert [float(v[0]) for v in flat.extremes_deg(np.zeros(1), np.ones(1))] == [12.0, 12.0]


def test_a_file(tmp_path):
    path = tmp_path / "skyline.txt"
    path.write_text("# azimuth altitude\n10 5\n100, 20  # the wall\n100 60\n\n350 15\n")
    assert HorizonMask.read(path) == HILLS


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("10 5\n20 north\n", r":2: '20 north' is no point of a horizon: write azimuth"),
        ("10 5 3\n", r":1: .* is no point"),
        ("10 5\n5 5\n", r":2: azimuth 5° comes after 10°: sort"),
        ("370 5\n", r":1: an azimuth of 370° is outside 0° to 360°"),
        ("10 95\n", r":1: an altitude of 95° is outside"),
        ("10 nan\n", r":1: an altitude of nan° is outside"),
        ("# nothing\n", r"holds no points"),
    ],
)
def test_a_bad_file_is_told_with_its_line(tmp_path, text, says):
    path = tmp_path / "skyline.txt"
    path.write_text(text)
    with pytest.raises(SourceError, match=says):
        HorizonMask.read(path)


def test_what_is_no_horizon():
    with pytest.raises(SourceError, match="cannot read the horizon"):
        HorizonMask.read("/nowhere/at/all")
    for azimuths, altitudes in (((), ()), ((1.0,), (1.0, 2.0)), ((2.0, 1.0), (0.0, 0.0)), ((1.0,), (99.0,))):
        with pytest.raises(SiteError):
            HorizonMask(azimuths, altitudes)
    with pytest.raises(SiteError, match="least altitude"):
        Horizon(91.0)

"""Fits of pointing models to a stranger's mount, and to measurements that others have fitted."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pytest
from strangers.tilted_mount import TiltedMount, apart_arcsec, local

from sattrack.core.errors import SattrackError
from sattrack.mount.geometry import Pole
from sattrack.mount.model import PointingTerms
from sattrack.pointing.fit import Star, core_terms, find_bump, fit, residuals_of
from sattrack.pointing.tour import chosen, grid_deg, slewed_deg, toured

LATITUDE = 47.0
MOUNT = TiltedMount(LATITUDE, 5000.0, -3000.0, 500.0, 60.0, 900.0, -700.0, 25.0)


@functools.cache
def sky() -> np.ndarray:
    """Return directions above 20°, hour angle and declination."""
    places = grid_deg(LATITUDE)
    return places[np.array([local(h, d, LATITUDE)[2] for h, d in places]) > 0.34]


def measured(mount: TiltedMount, count: int, seed: int = 1, noise_arcsec: float = 2.0) -> list[Star]:
    """Return stars as a mount with noisy encoders shows them."""
    return list(shown(mount, count, seed, noise_arcsec))


@functools.cache
def shown(mount: TiltedMount, count: int, seed: int, noise_arcsec: float) -> tuple[Star, ...]:
    rng = np.random.default_rng(seed)
    places = sky()[chosen(sky(), count)]
    found = []
    for h, d in places.tolist():
        axes = mount.stands(local(h, d, LATITUDE), (h, d)) + rng.normal(0.0, noise_arcsec / 3600.0, 2)
        found.append(Star(h, d, float(axes[0]), float(axes[1])))
    return tuple(found)


def missed(mount: TiltedMount, stars: list[Star]) -> float:
    """Return by how much the telescope misses the sky with the model of some stars, RMS."""
    model = fit(stars, LATITUDE).model
    off = [apart_arcsec(mount.looks(*model.axes_of(h, d)), local(h, d, LATITUDE)) for h, d in sky() + 1.5]
    return math.sqrt(sum(one * one for one in off) / len(off))


def test_a_mount_that_is_far_off_is_found_again_within_arcseconds() -> None:
    found = fit(measured(MOUNT, 15), LATITUDE)
    values = dict(zip(found.names, found.values, strict=True))
    sigmas = dict(zip(found.names, np.sqrt(np.diag(found.covariance)), strict=True))
    truth = {"ME": -5000.0, "MA": 3000.0, "CH": -500.0, "NP": -60.0, "IH": -900.0, "ID": 700.0, "TF": 25.0}
    assert set(truth) <= set(found.names)
    for name, value in truth.items():
        assert abs(values[name] - value) < 4.0 * sigmas[name]
        assert sigmas[name] < 20.0
    missed_arcsec = missed(MOUNT, measured(MOUNT, 15))
    assert missed_arcsec < 5.0
    assert found.predicted_arcsec(sky()) == pytest.approx(missed_arcsec, rel=1.0)


def test_stars_that_are_looked_at_again_tell_no_more_terms_apart() -> None:
    one, two = measured(MOUNT, 2)
    beside = one._replace(hour_angle_deg=one.hour_angle_deg + 0.2)
    assert fit([one, two, one, beside, two, one, two, beside, one, two, one], LATITUDE).names == ("IH", "ID")
    past = Star(one.hour_angle_deg, one.dec_deg, one.axis_hour_angle_deg + 180.0, 180.0 - one.axis_dec_deg)
    assert fit([one, two, past], LATITUDE).names == ("IH", "ID", "MA", "ME")


def test_a_star_without_noise_leaves_nothing() -> None:
    assert fit(measured(MOUNT, 12, noise_arcsec=0.0), LATITUDE).rms_arcsec < 0.01


def test_few_stars_give_few_terms() -> None:
    assert core_terms(2) == ("IH", "ID")
    assert fit(measured(MOUNT, 3), LATITUDE).names == ("IH", "ID", "MA", "ME")
    assert fit(measured(MOUNT, 3), LATITUDE).held_out_rms_arcsec is not None


def test_no_star_at_all_is_said() -> None:
    with pytest.raises(SattrackError, match="no star was measured"):
        fit([], LATITUDE)


def test_a_wrongly_solved_star_is_left_out() -> None:
    stars = measured(MOUNT, 14)
    stars[5] = stars[5]._replace(hour_angle_deg=stars[5].hour_angle_deg + 9.0, dec_deg=12.0)
    found = fit(stars, LATITUDE)
    assert list(np.flatnonzero(~found.used)) == [5]
    assert missed(MOUNT, stars) < 6.0


def wrongly_solved(stars: list[Star], seed: int) -> tuple[list[Star], int]:
    """Return the stars, one of them solved to be anywhere on the sphere, and which."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.standard_normal(3)
    one, h, d = (
        int(rng.integers(len(stars))),
        math.degrees(math.atan2(y, x)),
        math.degrees(math.asin(z / 9.0)),
    )
    return [
        star._replace(hour_angle_deg=h, dec_deg=d) if k == one else star for k, star in enumerate(stars)
    ], one


@pytest.mark.parametrize(
    "count", [4, 6, 9, *(pytest.param(count, marks=pytest.mark.soak) for count in (5, 7))]
)
def test_one_wrongly_solved_star_of_few_is_left_out_and_no_other(count: int) -> None:
    for seed in range(3):
        stars, one = wrongly_solved(measured(MOUNT, count, seed), seed)
        found = fit(stars, LATITUDE)
        assert np.flatnonzero(~found.used).tolist() == [one]
        # What is left is what so few stars cannot tell of this mount: CH, NP and TF.
        assert found.rms_arcsec < 200.0
        assert fit(measured(MOUNT, count, seed), LATITUDE).used.all()


def test_three_stars_that_do_not_agree_are_refused_and_never_two_taken() -> None:
    for seed in range(3):
        stars, _ = wrongly_solved(measured(MOUNT, 3, seed), seed)
        with pytest.raises(SattrackError, match="more stars show whether one is wrongly solved"):
            fit(stars, LATITUDE)
        assert fit(measured(MOUNT, 3, seed), LATITUDE).used.all()


def test_stars_that_contradict_one_another_are_refused() -> None:
    stars = [one._replace(dec_deg=one.dec_deg + 3.0 * (k % 2)) for k, one in enumerate(measured(MOUNT, 14))]
    with pytest.raises(SattrackError, match="contradict"):
        fit(stars, LATITUDE)


def test_a_term_beyond_the_geometry_is_taken_in_only_where_it_helps() -> None:
    stars = measured(MOUNT, 25)
    assert set(fit(stars, LATITUDE).names) == {"IH", "ID", "MA", "ME", "CH", "NP", "TF"}
    wave = [40.0 / 3600.0 * math.sin(math.radians(2.0 * one.axis_dec_deg)) for one in stars]
    eccentric = [
        one._replace(axis_dec_deg=one.axis_dec_deg + more) for one, more in zip(stars, wave, strict=True)
    ]
    assert "HDSD2" in fit(eccentric, LATITUDE).names
    assert fit(eccentric, LATITUDE).rms_arcsec < 5.0


@pytest.mark.parametrize("first", [4, 8, 11])
def test_a_bump_is_found_where_it_was(first: int) -> None:
    moved = dataclasses.replace(MOUNT, pole_up=MOUNT.pole_up + 200.0, zero_ha=MOUNT.zero_ha - 150.0)
    stars = [*measured(MOUNT, 16)[:first], *measured(moved, 16)[first:]]
    bump = find_bump(stars, LATITUDE)
    assert bump is not None
    assert bump.before_star == first
    assert 50.0 < bump.moved_arcsec < 400.0


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(2, 6))]
)
def test_a_mount_that_was_not_bumped_is_not_said_to_be(seed: int) -> None:
    stars = measured(MOUNT, 16, seed)
    assert find_bump(stars, LATITUDE) is None
    stars[9] = stars[9]._replace(dec_deg=stars[9].dec_deg - 4.0)
    assert find_bump(stars, LATITUDE) is None


def test_both_sides_of_the_pole_share_one_model() -> None:
    rng = np.random.default_rng(3)
    stars = []
    for h, d in sky()[chosen(sky(), 16)].tolist():
        near = (h, d) if h < 0.0 else (h + 180.0, 180.0 - d)
        axes = MOUNT.stands(local(h, d, LATITUDE), near) + rng.normal(0.0, 2.0 / 3600.0, 2)
        stars.append(Star(h, d, float(axes[0]), float(axes[1])))
    found = fit(stars, LATITUDE)
    values = dict(zip(found.names, found.values, strict=True))
    assert values["CH"] == pytest.approx(-500.0, abs=5.0)
    assert found.rms_arcsec < 6.0


def test_an_azimuth_mount_is_an_equatorial_one_at_the_pole() -> None:
    mount, rng = TiltedMount(90.0, 900.0, -500.0, 300.0, 40.0, 200.0, -150.0, 20.0), np.random.default_rng(5)
    stars = []
    for _ in range(18):
        azimuth, altitude = rng.uniform(0.0, 360.0), rng.uniform(20.0, 75.0)
        axes = mount.stands(local(-azimuth, altitude, 90.0), (-azimuth, altitude))
        stars.append(Star(azimuth, altitude, -axes[0], axes[1]))
    found = fit(stars, 33.0, "altaz")
    values = dict(zip(found.names, found.values, strict=True))
    expected = {"AN": 900.0, "AW": -500.0, "CA": -300.0, "NPAE": -40.0, "IA": -200.0, "IE": 150.0, "TF": 20.0}
    assert values == pytest.approx(expected, abs=0.05)


def test_a_mount_with_a_pole_of_its_own_is_an_equatorial_one_about_it() -> None:
    """Of its stars the fit gets hour angles and declinations of the sky, by the stranger's own rotations."""
    errors = {"pole_up": 900.0, "pole_west": -500.0, "cone": 300.0, "leaning": 40.0, "sag": 20.0}
    errors |= {"zero_ha": 200.0, "zero_dec": -150.0}
    mount = TiltedMount(20.0, **errors, pole_azimuth_deg=75.0)
    faultless, rng = TiltedMount(20.0, pole_azimuth_deg=75.0), np.random.default_rng(5)
    stars = []
    while len(stars) < 18:
        axes = rng.uniform(-90.0, 90.0), rng.uniform(-70.0, 70.0)
        looks, told = mount.looks(*axes), faultless.looks(*axes)
        if looks[2] > 0.3:
            stars.append(Star(*hour_angle_and_dec(looks), *hour_angle_and_dec(told)))
    found = fit(stars, LATITUDE, Pole(75.0, 20.0))
    values = dict(zip(found.names, found.values, strict=True))
    expected = {"ME": -900.0, "MA": 500.0, "CH": -300.0, "NP": -40.0, "IH": -200.0, "ID": 150.0, "TF": 20.0}
    assert values == pytest.approx(expected, abs=0.05)
    assert found.terms("2026-10-01T00:00:00Z").axes == Pole(75.0, 20.0)


def hour_angle_and_dec(vector: np.ndarray) -> tuple[float, float]:
    x, y, z = (float(local(*one, LATITUDE) @ vector) for one in ((0.0, 0.0), (90.0, 0.0), (0.0, 90.0)))
    return math.degrees(math.atan2(y, x)), math.degrees(math.asin(z))


@pytest.mark.parametrize(
    ("axes", "star", "expected"),
    [
        ("equatorial", Star(10.0, 60.0, 11.0, 60.5), (1800.0, 1800.0)),
        # Past the pole: it reports the hour angle 11° + 180° and the declination 60.5°.
        ("equatorial", Star(10.0, 60.0, 191.0, 119.5), (1800.0, 1800.0)),
        ("altaz", Star(10.0, 60.0, 11.0, 60.5), (1800.0, 1800.0)),
    ],
)
def test_residuals_lead_to_where_the_mount_reports_the_star(
    axes: Any, star: Star, expected: tuple[float, float]
) -> None:
    terms = PointingTerms("2026-10-01T00:00:00Z", LATITUDE, {}, 1.0, 9, axes=axes)
    assert residuals_of([star], terms).before_arcsec[0] == pytest.approx(expected, rel=0.02)


def test_a_tour_sees_all_of_the_sky_early_and_slews_little() -> None:
    places = sky()
    rows = chosen(places, 24)
    assert len(set(rows.tolist())) == 24
    first = places[rows[:8]]
    # Eight caps that hold all the sky above 20° have a radius of 23° at least.
    looks = np.array([local(h, d, LATITUDE) for h, d in places])
    near = np.max(looks @ np.array([local(h, d, LATITUDE) for h, d in first]).T, axis=1)
    assert math.degrees(math.acos(near.min())) < 45.0
    order = toured(places[rows], (0.0, 40.0))
    assert sorted(order.tolist()) == list(range(24))
    assert set(order[:8].tolist()) == set(range(8))
    way = sum(slewed_deg(*places[rows][order[k : k + 2]]) for k in range(7))
    straight = sum(slewed_deg(*places[rows][k : k + 2]) for k in range(7))
    assert way < 0.7 * straight

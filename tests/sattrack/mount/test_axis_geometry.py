"""Axes anywhere, judged by a stranger's rotations, by ERFA, and by closed forms."""

from __future__ import annotations

import math
import random
from typing import Any, Literal

import erfa
import msgspec
import numpy as np
import pytest

from bench.strangers.alpaca_two_axes import Parameters, Telescope
from sattrack.mount.geometry import AxisFrame, AxisGeometry
from sattrack.mount.model import AxesPosition, MountProfile, PointingTerms, SitePlace

SIDEREAL_DEG_S = 360.98564736629 / 86400.0
MOUNTS = range(200)


def drawn(number: int) -> tuple[AxisFrame, Telescope, random.Random]:
    """Return a mount anywhere, as ours and as the stranger's."""
    rng = random.Random(f"geometry {number}")
    latitude, pole_azimuth = rng.uniform(-89.0, 89.0), rng.uniform(0.0, 360.0)
    pole_altitude = math.degrees(math.asin(rng.uniform(-1.0, 1.0)))
    axes, cone = 90.0 + rng.uniform(-3.0, 3.0), rng.uniform(-2.0, 2.0)
    geometry = AxisGeometry(pole_azimuth, pole_altitude, axes, cone)
    stranger = Parameters(
        latitude_deg=latitude,
        pole_azimuth_deg=pole_azimuth,
        pole_altitude_deg=pole_altitude,
        axes_deg=axes,
        cone_deg=cone,
    )
    return AxisFrame(geometry, latitude), Telescope(stranger, 0.0), rng


def sky_of(telescope: Telescope, angles: list[float]) -> tuple[float, float]:
    """Return hour angle and declination of a stranger's tube, by ERFA from its azimuth and altitude."""
    telescope.angles = angles
    azimuth, altitude = telescope.horizontal()
    sky = erfa.ae2hd(math.radians(azimuth), math.radians(altitude), math.radians(telescope.p.latitude_deg))
    return math.degrees(sky[0]), math.degrees(sky[1])


@pytest.mark.parametrize("number", MOUNTS)
def test_a_stranger_s_axes_are_found_from_where_its_tube_points(number: int) -> None:
    frame, telescope, rng = drawn(number)
    first, second = rng.uniform(-180.0, 180.0), rng.uniform(-80.0, 80.0)
    found = frame.angles(*sky_of(telescope, [first, second]))
    # The stranger counts the first angle from the other end of the meridian.
    assert math.remainder(found.first_deg - 180.0 - first, 360.0) == pytest.approx(0.0, abs=1e-9)
    assert found.second_deg == pytest.approx(second, abs=1e-9)


@pytest.mark.parametrize("number", MOUNTS)
def test_both_solutions_point_where_the_stranger_s_tube_does(number: int) -> None:
    frame, telescope, rng = drawn(number)
    angles = [rng.uniform(-180.0, 180.0), rng.uniform(-80.0, 80.0)]
    sky = sky_of(telescope, angles)
    for beyond in (False, True):
        found = frame.angles(*sky, beyond=beyond)
        there = sky_of(telescope, [found.first_deg - 180.0, found.second_deg])
        assert erfa.seps(*map(math.radians, (*sky, *there))) == pytest.approx(0.0, abs=1e-9)
        assert (abs(found.second_deg) > 90.0) is beyond


@pytest.mark.parametrize("number", MOUNTS)
def test_rates_are_those_at_which_the_stranger_s_axes_turn(number: int) -> None:
    frame, telescope, rng = drawn(number)
    angles, rates = [0.0, 90.0], (rng.uniform(-2, 2), rng.uniform(-2, 2))
    while abs(angles[1]) > 75.0 or abs(sky_of(telescope, angles)[1]) > 85.0:
        angles = [rng.uniform(-180, 180), rng.uniform(-90, 90)]
    step = 0.001
    before, here, after = (
        sky_of(telescope, [a + sign * step * r for a, r in zip(angles, rates, strict=True)])
        for sign in (-1.0, 0.0, 1.0)
    )
    hour_angle_rate = math.remainder(after[0] - before[0], 360.0) / (2.0 * step)
    dec_rate = (after[1] - before[1]) / (2.0 * step)
    found = frame.angles(*here, hour_angle_rate, dec_rate)
    assert found[2:] == pytest.approx(rates, abs=2e-4)


def test_arrays_give_what_floats_do() -> None:
    frame, _, rng = drawn(3)
    sky = [
        (rng.uniform(-180, 180), rng.uniform(-80, 80), rng.gauss(0, 1), rng.gauss(0, 1)) for _ in range(50)
    ]
    columns: Any = np.array(sky).T
    together = np.array(frame.angles(*columns, fn=np)).T
    assert together == pytest.approx(np.array([frame.angles(*one) for one in sky]), abs=1e-11)


@pytest.mark.parametrize("latitude_deg", [52.0, -33.0, 5.0])
def test_an_equatorial_mount_has_hour_angle_and_declination_and_a_field_that_stands(
    latitude_deg: float,
) -> None:
    frame = AxisFrame(AxisGeometry(0.0, latitude_deg), latitude_deg)
    assert frame.angles(37.0, -12.0, 0.3, -0.2) == pytest.approx((37.0, -12.0, 0.3, -0.2), abs=1e-9)
    assert frame.field_angle_deg(37.0, -12.0) == pytest.approx(0.0, abs=1e-9)
    assert abs(frame.field_angle_deg(37.0, 120.0)) == pytest.approx(180.0, abs=1e-9)
    assert frame.field_rate_deg_s(37.0, -12.0, SIDEREAL_DEG_S, 0.0) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("place", [(-30.0, 40.0), (80.0, 10.0), (5.0, 70.0)])
def test_an_alt_azimuth_mount_is_erfa_s_horizon(place: tuple[float, float]) -> None:
    latitude = math.radians(52.0)
    frame = AxisFrame(AxisGeometry(0.0, 90.0), 52.0)
    hour_angle, dec = map(math.radians, place)
    azimuth, altitude = erfa.hd2ae(hour_angle, dec, latitude)
    found = frame.angles(*place, SIDEREAL_DEG_S, 0.0)
    assert math.remainder(found.first_deg + 180.0 - math.degrees(azimuth), 360.0) == pytest.approx(
        0.0, abs=1e-9
    )
    assert found.second_deg == pytest.approx(math.degrees(altitude), abs=1e-9)
    # Rates of a star, and of the field about it (Smart, Textbook on Spherical Astronomy, chapter 2).
    tan_alt = math.tan(altitude)
    azimuth_rate = SIDEREAL_DEG_S * (math.sin(latitude) - math.cos(latitude) * math.cos(azimuth) * tan_alt)
    altitude_rate = SIDEREAL_DEG_S * math.cos(latitude) * math.sin(azimuth)
    assert found.first_rate_deg_s == pytest.approx(azimuth_rate, rel=1e-9)
    assert found.second_rate_deg_s == pytest.approx(altitude_rate, rel=1e-9)
    assert frame.field_angle_deg(*found[:2]) == pytest.approx(
        math.degrees(erfa.hd2pa(hour_angle, dec, latitude)), abs=1e-9
    )
    field = -SIDEREAL_DEG_S * math.cos(latitude) * math.cos(azimuth) / math.cos(altitude)
    assert frame.field_rate_deg_s(*found) == pytest.approx(field, rel=1e-6)


@pytest.mark.parametrize(("cone_deg", "axes_deg"), [(2.0, 90.0), (0.0, 87.0), (1.0, 92.0)])
def test_axes_that_are_not_square_leave_a_hole_about_the_pole(cone_deg: float, axes_deg: float) -> None:
    frame = AxisFrame(AxisGeometry(0.0, 90.0, axes_deg, cone_deg), 52.0)
    zenith = 0.0, 52.0
    nearest = frame.direction(*frame.angles(*zenith)[:2])
    apart = math.degrees(erfa.seps(*map(math.radians, (*zenith, *nearest))))
    least = min(
        math.degrees(erfa.seps(*map(math.radians, (*zenith, *frame.direction(0.0, 80.0 + 0.01 * k)))))
        for k in range(2000)
    )
    assert apart == pytest.approx(least, abs=0.02)
    assert apart > 0.5


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"stands_at": None}, "geometry is given without stands_at"),
        (
            {"pointing": PointingTerms("2026-01-01T00:00:00Z", 52.0, {"IH": (10.0, 1.0)}, 5.0, 9)},
            "pointing is a model of equatorial axes, and geometry is alt-azimuth",
        ),
        (
            {
                "pointing": PointingTerms(
                    "2026-01-01T00:00:00Z", 52.0, {"IA": (1.0, 1.0)}, 5.0, 9, axes="altaz"
                ),
                "geometry": AxisGeometry(0.0, 60.0),
            },
            "pointing is a model of altaz axes, and geometry is two-axis",
        ),
        ({"through_pole": True}, "through_pole is true"),
        (
            {"geometry": {"pole_azimuth_deg": 0.0, "pole_altitude_deg": 91.0}},
            "geometry.pole_altitude_deg is 91",
        ),
        ({"geometry": {"pole_azimuth_deg": 0.0, "pole_altitude_deg": math.nan}}, "pole_altitude_deg is nan"),
        (
            {"geometry": {"pole_azimuth_deg": 0.0, "pole_altitude_deg": 90.0, "cone_deg": 40.0}},
            "geometry.cone_deg is 40",
        ),
        (
            {"geometry": {"pole_azimuth_deg": 0.0, "pole_altitude_deg": 90.0, "first_sense": -1}},
            'geometry.reports is "sky"',
        ),
    ],
)
def test_a_profile_with_a_geometry_that_cannot_be_is_refused(changes: dict[str, Any], says: str) -> None:
    good: dict[str, Any] = {
        "additive": False,
        "stands_at": SitePlace(52.0, 4.5),
        "geometry": AxisGeometry(0.0, 90.0),
        "park": AxesPosition(0.0, 10.0),
    }
    assert MountProfile(**good).frame is not None
    if isinstance(table := changes.get("geometry"), dict):
        with pytest.raises((ValueError, msgspec.ValidationError), match=says):
            msgspec.convert(table, AxisGeometry)
        return
    with pytest.raises(ValueError, match=says):
        MountProfile(**good | changes)


@pytest.mark.parametrize("reports", ["sky", "axes"])
@pytest.mark.parametrize("number", range(20))
def test_zero_points_are_found_from_where_a_stranger_s_tube_looks_and_what_it_reports(
    number: int, reports: Literal["sky", "axes"]
) -> None:
    """The mount takes its angles for others by so much, and reports by them."""
    frame, telescope, rng = drawn(number)
    zeros = rng.uniform(-170.0, 170.0), rng.uniform(-9.0, 9.0)
    plain = msgspec.structs.replace(frame.geometry, reports=reports)
    found = AxisFrame(plain, telescope.p.latitude_deg)
    for angles in ([20.0, 30.0], [-75.0, -60.0]):
        looks = sky_of(telescope, list(angles))
        counted = [angle + zero for angle, zero in zip(angles, zeros, strict=True)]
        # The stranger counts the first angle from the other end of the meridian.
        told = sky_of(telescope, counted) if reports == "sky" else (counted[0] + 180.0, counted[1])
        if found.geometry.has_zeros:
            means = found.of_report(*told)
            assert math.remainder(means.first_deg - 180.0 - angles[0], 360.0) == pytest.approx(0.0, abs=1e-6)
            assert means.second_deg == pytest.approx(angles[1], abs=1e-6)
            back = found.reported(means.first_deg, means.second_deg)
            assert math.remainder(back[0] - told[0], 360.0) == pytest.approx(0.0, abs=1e-6)
            assert back[1] == pytest.approx(told[1], abs=1e-6)
        else:
            found = AxisFrame(found.aligned(looks, told), telescope.p.latitude_deg)
    assert math.remainder(found.geometry.first_zero_deg - zeros[0], 360.0) == pytest.approx(0.0, abs=1e-6)
    assert found.geometry.second_zero_deg == pytest.approx(zeros[1], abs=1e-6)

"""Axes found from small motions of strangers' mounts, and mounts that are refused with a reason."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import axes_anywhere
import erfa
import msgspec
import pytest

from sattrack.calibration.axes_in_space import LEGS, AxisTurn, find_axes, kind_of, with_axes
from sattrack.core.errors import SattrackError
from sattrack.mount.geometry import AxisFrame, AxisGeometry
from sattrack.mount.model import MountProfile, SitePlace
from sattrack.safety import SafetyLimits

LATITUDE_DEG = 47.0
STRANGER = axes_anywhere.Telescope


def motions(
    stranger: axes_anywhere.Parameters, first: float = 200.0, second: float = 30.0, **how: Any
) -> list[AxisTurn]:
    """Return the motions of a stranger's telescope from drive angles on; `how` makes it disobey."""
    telescope = STRANGER(stranger, 0.0)
    turns, slip = how.get("turns", (1.0, 1.0)), how.get("slip", 0.0)

    def place() -> tuple[float, float]:
        azimuth, altitude = (math.radians(angle) for angle in telescope.horizontal())
        hour_angle, dec = erfa.ae2hd(azimuth, altitude, math.radians(stranger.latitude_deg))
        return math.degrees(hour_angle), math.degrees(dec)

    telescope.angles = [first, second]
    legs = []
    for axis, sense in LEGS:
        before = place()
        telescope.angles[axis] += 4.0 * sense * turns[axis]
        telescope.angles[1 - axis] += slip * abs(telescope.angles[axis] - 200.0) if axis == 0 else 0.0
        legs.append(AxisTurn(axis, 4.0 * sense, before, place()))
    return legs


def parameters(pole: tuple[float, float], **more: float) -> axes_anywhere.Parameters:
    return axes_anywhere.Parameters(
        latitude_deg=LATITUDE_DEG,
        pole_azimuth_deg=pole[0],
        pole_altitude_deg=pole[1],
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("pole", "kind"),
    [
        ((0.0, 90.0), "alt-azimuth"),
        ((0.0, 47.0), "equatorial"),
        ((0.0, 30.0), "neither"),
        ((130.0, 12.0), "neither"),
    ],
)
def test_axes_are_found_and_named(pole: tuple[float, float], kind: str) -> None:
    found = find_axes(motions(parameters(pole, axes_deg=91.0, cone_deg=0.5), turns=(-1.0, 1.0)), LATITUDE_DEG)
    assert found.geometry.pole_altitude_deg == pytest.approx(pole[1], abs=1e-4)
    if pole[1] < 89.0:
        off_deg = math.remainder(found.geometry.pole_azimuth_deg - pole[0], 360.0)
        assert off_deg == pytest.approx(0.0, abs=1e-4)
    assert found.geometry.axes_deg == pytest.approx(91.0, abs=1e-3)
    assert found.geometry.cone_deg == pytest.approx(0.5, abs=1e-3)
    assert found.gains == pytest.approx((-1.0, 1.0), abs=1e-4)
    assert kind_of(found.geometry, LATITUDE_DEG) == kind
    profile = with_axes(MountProfile(), found, SitePlace(LATITUDE_DEG, 5.0))
    assert (profile.ra_rate_sign, profile.dec_rate_sign, profile.additive) == (-1, 1, False)


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"turns": (0.0, 1.0)}, "the first axis does not move"),
        ({"turns": (1.0, 0.0)}, "the second axis does not move"),
        ({"turns": (1.0, 2.5)}, "the second axis went 2.50 times as far as commanded"),
        ({"slip": 0.2}, "the tube does not move as two axes make it"),
        ({"second": 75.0}, "the tube points within 20° of where the first axis does"),
    ],
)
def test_a_mount_that_does_not_fit_is_refused_with_the_reason(how: dict[str, Any], says: str) -> None:
    with pytest.raises(SattrackError, match=says):
        find_axes(motions(parameters((0.0, 90.0)), **how), LATITUDE_DEG)


@pytest.mark.parametrize("number", [3, 6])
def test_a_whole_run_finds_the_axes_of_a_stranger_and_ends_at_rest(number: int) -> None:
    axes = axes_anywhere.draw_to_find(number)
    run = axes_anywhere.Finding(axes).run()
    finder: Any = run.engine
    assert (finder.words, finder.finished, finder.mount_stopped) == (None, True, True)
    found = find_axes(finder.legs, axes.drawn.site.latitude_deg)
    assert axes_anywhere.poles_apart_deg(found.geometry, axes.geometry) < 0.01


def test_nothing_moves_where_a_limit_is_near() -> None:
    axes = axes_anywhere.draw_to_find(3)
    run = axes_anywhere.Finding(axes)
    altitude = axes_anywhere.Tube(axes).horizontal(*axes.drawn.stands)[1]
    limits = SafetyLimits(floor_altitude_deg=altitude - 15.0, optical=False)
    run.engine = axes_anywhere.finder_of(axes, limits)  # type: ignore[assignment]
    run.run()
    finder: Any = run.engine
    assert "altitude limit" in finder.words
    assert finder.legs == []
    azimuths = {round(azimuth, 1) for _, azimuth, _ in run.tube_deg}
    assert len(azimuths) <= 8, "it has only followed the sky"


def test_a_mount_that_runs_away_is_stopped_within_the_circle() -> None:
    axes = axes_anywhere.draw_to_find(3)
    fast = replace(axes.drawn.hardware, gains=(8.0, 8.0))
    axes = axes._replace(drawn=replace(axes.drawn, hardware=fast))
    run = axes_anywhere.Finding(axes).run()
    finder: Any = run.engine
    assert "obedience limit" in finder.words
    assert finder.mount_stopped is True
    begin, end = run.tube_deg[0], run.tube_deg[-1]
    apart = math.degrees(erfa.seps(*(math.radians(angle) for one in (begin, end) for angle in one[1:])))
    assert apart < 20.0


def test_the_found_profile_can_be_written_and_read() -> None:
    found = find_axes(motions(parameters((0.0, 90.0))), LATITUDE_DEG)
    profile = with_axes(MountProfile(), found, SitePlace(LATITUDE_DEG, 5.0))
    read = msgspec.json.decode(msgspec.json.encode(profile), type=MountProfile)
    assert read == profile
    assert isinstance(read.geometry, AxisGeometry)
    assert isinstance(read.frame, AxisFrame)

"""How an image lies by what the mount's motion does to it: by hand, with vectors on a small flat sky."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sattrack.control.camera_image import AS_SET, FEWEST, KEPT, STEP_S, Camera, Deviation, ImageFit

if TYPE_CHECKING:
    from collections.abc import Callable

    Path = Callable[[float], np.ndarray]

ARCSEC = math.radians(1.0 / 3600.0)
SET_DEG = 25.0
OFF, DRIFT = np.array([900.0, -400.0]), np.array([15.0, 8.0])
"""Where the satellite is beside its elements, east and north, arcseconds, and how that grows in a second."""


def axes(position_angle_deg: float, mirrored: bool) -> np.ndarray:
    """Return right and up of an image as rows, east and north: right is 90° from up, to the west."""
    right_deg = position_angle_deg + (90.0 if mirrored else -90.0)
    return np.array(
        [[math.sin(math.radians(a)), math.cos(math.radians(a))] for a in (right_deg, position_angle_deg)]
    )


def mount(to: np.ndarray, begins_s: float = 1.0, lasts_s: float = 3.0) -> Path:
    """Return where a mount is beside the elements that goes to a place, smoothly."""

    def at(t: float) -> np.ndarray:
        u = min(1.0, max(0.0, (t - begins_s) / lasts_s))
        return to * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

    return at


def fitted(
    path: Path, flip: bool, true: Deviation, noise_arcsec: float = 1.5, frames: int = 12, seed: int = 1
) -> ImageFit:
    """Return what frames twice a second are made of, of a camera that was set upright but for SET_DEG."""
    rng, fit = np.random.default_rng(seed), ImageFit()
    said, lies = axes(SET_DEG, flip), axes(SET_DEG + true.turned_deg, flip != true.mirrored)
    for number in range(frames):
        dated_s = 0.5 * number
        t = dated_s - true.clock_s
        seen = lies @ (OFF + DRIFT * t - path(t)) / true.scale + rng.normal(0.0, noise_arcsec, 2)
        predicted = [complex(*(said @ -path(dated_s + k * STEP_S))) * ARCSEC for k in (-1.0, 0.0, 1.0)]
        fit.see(dated_s, predicted, complex(*seen) * ARCSEC)
    return fit


@pytest.mark.parametrize("true", [AS_SET, Deviation(90.0), Deviation(-60.0, 1.2, mirrored=True)])
def test_a_late_satellite_is_off_along_a_way_that_turns(true: Deviation) -> None:
    """By five degrees a second: a straight line would leave 100″ of it, and take it for a scale."""
    rng, fit, path = np.random.default_rng(3), ImageFit(), mount(np.array([3000.0, -2500.0]))
    said, lies = axes(SET_DEG, False), axes(SET_DEG + true.turned_deg, true.mirrored)
    for number in range(12):
        t = 0.5 * number
        turned = math.radians(5.0 * t)
        motion = np.array([math.cos(turned), math.sin(turned)]) * (1500.0 + 20.0 * t)
        seen = lies @ (2.5 * motion - path(t)) / true.scale + rng.normal(0.0, 1.5, 2)
        predicted = [complex(*(said @ -path(t + k * STEP_S))) * ARCSEC for k in (-1.0, 0.0, 1.0)]
        fit.see(t, predicted, complex(*seen) * ARCSEC, complex(*(said @ motion)) * ARCSEC)
    found = fit.deviation(False, AS_SET)
    if true is AS_SET:
        assert found is None
    else:
        assert found is not None
        assert found.turned_deg == pytest.approx(true.turned_deg, abs=0.5)
        assert found.scale == pytest.approx(true.scale, rel=0.01)
        assert found.mirrored == true.mirrored


STRAIGHT = mount(np.array([700.0, -300.0]))


def bent(t: float) -> np.ndarray:
    """Go one way, then another: a mirrored image moves otherwise then than a turned one."""
    return STRAIGHT(t) + mount(np.array([200.0, 500.0]), 3.0)(t)


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(
    "true",
    [
        Deviation(90.0),
        Deviation(-135.0, 2.0),
        Deviation(180.0),
        Deviation(0.0, 0.5),
        Deviation(25.0),
        Deviation(mirrored=True),
        Deviation(70.0, 1.6, mirrored=True),
    ],
)
def test_what_the_motion_does_to_an_image_shows_how_it_lies(flip: bool, true: Deviation) -> None:
    found = fitted(bent, flip, true).deviation(flip, AS_SET)
    assert found is not None
    assert math.remainder(found.turned_deg - true.turned_deg, 360.0) == pytest.approx(0.0, abs=1.5)
    assert found.scale == pytest.approx(true.scale, rel=0.03)
    assert found.mirrored == true.mirrored
    # What is believed already is no news.
    assert fitted(bent, flip, true).deviation(flip, true) is None


@pytest.mark.parametrize("flip", [False, True])
def test_along_one_line_an_image_may_be_turned_or_mirrored_and_is_taken_for_turned(flip: bool) -> None:
    found = fitted(STRAIGHT, flip, Deviation(mirrored=True)).deviation(flip, AS_SET)
    assert found is not None
    assert not found.mirrored
    believed = fitted(STRAIGHT, flip, Deviation(60.0)).deviation(flip, Deviation(10.0, mirrored=True))
    assert believed is not None
    assert believed.mirrored


@pytest.mark.parametrize(
    ("path", "true", "noise_arcsec", "frames"),
    [
        (bent, AS_SET, 1.5, 16),
        (bent, Deviation(1.0, 1.01), 1.5, 16),
        (bent, Deviation(clock_s=0.3), 1.5, 16),
        (bent, AS_SET, 60.0, 16),
        (bent, Deviation(90.0), 1.5, FEWEST - 1),
        (mount(np.array([20.0, 30.0])), Deviation(180.0), 1.5, 16),
        (lambda t: np.array([40.0, 70.0]) * t, Deviation(180.0), 1.5, 16),
        (bent, Deviation(90.0), 150.0, 16),
    ],
)
def test_an_image_lies_as_set_until_it_is_sure_that_it_does_not(
    path: Path, true: Deviation, noise_arcsec: float, frames: int
) -> None:
    """Right, a little off, a wrong clock, noise, too few frames, hardly moved, or moved as what drifts."""
    for seed in range(20):
        assert fitted(path, False, true, noise_arcsec, frames, seed).deviation(False, AS_SET) is None


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("lies", [AS_SET, Deviation(90.0), Deviation(-30.0, 2.0, mirrored=True)])
@pytest.mark.parametrize("clock_s", [0.3, -0.3, 0.2])
def test_a_clock_is_wrong_by_how_much_the_image_moves_too_early(
    flip: bool, lies: Deviation, clock_s: float
) -> None:
    found_s = fitted(bent, flip, lies.and_then(Deviation(clock_s=clock_s))).clock_s(flip, lies)
    assert found_s == pytest.approx(clock_s, abs=0.03)


@pytest.mark.parametrize(
    ("path", "true", "believed"),
    [
        (bent, AS_SET, AS_SET),
        (bent, Deviation(clock_s=0.1), AS_SET),
        # An image that lies otherwise moves at other times, too.
        (bent, Deviation(180.0), AS_SET),
        (bent, Deviation(mirrored=True), AS_SET),
        (bent, AS_SET, Deviation(180.0)),
        (lambda t: np.array([40.0, 70.0]) * t, Deviation(clock_s=0.3), AS_SET),
    ],
)
def test_no_clock_is_wrong_that_is_not_sure_to_be(path: Path, true: Deviation, believed: Deviation) -> None:
    for seed in range(20):
        for frames in (FEWEST - 1, FEWEST, 10, 16):
            assert fitted(path, False, true, frames=frames, seed=seed).clock_s(False, believed) is None


def test_one_thing_that_hardly_moves_is_told_from_noise_and_from_what_jumps() -> None:
    still = mount(np.zeros(2))
    assert fitted(still, False, Deviation(90.0)).is_steady
    assert not fitted(still, False, AS_SET, frames=FEWEST - 1).is_steady
    assert not fitted(still, False, AS_SET, noise_arcsec=60.0).is_steady
    assert not fitted(bent, False, AS_SET).is_steady


def test_only_the_last_frames_count() -> None:
    assert fitted(bent, False, Deviation(90.0), frames=14).deviation(False, AS_SET) is not None
    # All motion is over when the first of these was made.
    assert fitted(bent, False, Deviation(90.0), frames=14 + KEPT).deviation(False, AS_SET) is None


def test_deviations_add_up_and_are_those_of_the_camera() -> None:
    both = Deviation(100.0, 2.0, True, 0.1).and_then(Deviation(100.0, 1.5, True, 0.2))
    assert both == Deviation(-160.0, 3.0, False, pytest.approx(0.3))
    found = Deviation(90.0, 2.0, True).applied_to(Camera(12.0, False, 1.5, "coarse"))
    assert found == Camera(102.0, True, 3.0, "coarse", stretch=2.0)

"""The small picture of a frame: where things lie in it, and what stays visible."""

from __future__ import annotations

import numpy as np
import pytest

from sattrack.camera.frames import CameraFrame, reduced
from sattrack.views.picture import MOST_PICTURE_BYTES, MOST_SIDE
from tle.instants import Utc

UTC = Utc.parse("2026-10-02T13:05:24.5Z")


def frame(width: int = 1280, height: int = 960, sky: float = 600.0, noise: float = 8.0) -> CameraFrame:
    rng = np.random.default_rng(3)
    pixels = rng.normal(sky, noise, (height, width)).astype(np.float32)
    return CameraFrame(pixels, UTC, 0.1, "a")


def star(one: CameraFrame, x: float, y: float, peak: float, sigma: float = 1.2) -> None:
    rows, columns = np.indices(one.pixels.shape)
    one.pixels[...] += peak * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2.0 * sigma**2))


def levels(one: CameraFrame, side: int = 160) -> np.ndarray:
    columns, rows, pixels = reduced(one, side)
    return np.frombuffer(pixels, np.uint8).reshape(rows, columns)


def test_the_first_row_is_the_top_and_places_are_kept() -> None:
    one = frame()
    star(one, 204.0, 900.0, 300.0)  # left, and high: y goes up in a frame
    found = levels(one)
    assert found.shape == (120, 160)
    row, column = np.unravel_index(found.argmax(), found.shape)
    assert (row, column) == ((959 - 900) // 8, 204 // 8)


def test_a_faint_point_shows_and_noise_and_hot_pixels_do_not() -> None:
    one = frame()
    star(one, 640.0, 480.0, 90.0)
    one.pixels[100, 100] += 5000.0
    found = levels(one)
    around = np.median(found)
    assert found[58:62, 78:82].max() > 3 * around
    assert found[(959 - 100) // 8, 100 // 8] < found[58:62, 78:82].max()
    assert np.percentile(found, 99.0) < 0.4 * found.max()


@pytest.mark.parametrize("value", [0.0, 65535.0])
def test_a_frame_of_one_value_is_a_picture_too(value: float) -> None:
    one = CameraFrame(np.full((48, 64), value, np.float32), UTC, 0.1, "a")
    assert len(set(levels(one, 16).ravel())) == 1


@pytest.mark.parametrize(("width", "height"), [(1281, 961), (5, 3), (961, 4000), (17, 300)])
def test_odd_sizes_fit_into_the_side_and_the_bound(width: int, height: int) -> None:
    columns, rows, pixels = reduced(frame(width, height), MOST_SIDE)
    assert max(columns, rows) <= MOST_SIDE
    assert len(pixels) == columns * rows > 0
    assert MOST_SIDE * MOST_SIDE * 4 // 3 < MOST_PICTURE_BYTES

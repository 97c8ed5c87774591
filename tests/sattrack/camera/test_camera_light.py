"""Exposure and gain by what is seen: the rule, and a driver of INDI's own that is asked for them."""

from __future__ import annotations

import math
import select
import socket
import struct
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from camera_frames import Canvas, star_streaks
from indi_programs import indi_server

from sattrack.camera.detection import Detection, Detector, ExpectedMotion, light_wanted
from sattrack.camera.frames import CameraFrame, more_light
from sattrack.camera.sources import CONTROL, SourceOptions, open_source, v4l_range
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

FINDS_WITHIN_S = 20.0


@pytest.mark.parametrize(
    ("before", "factor", "after"),
    [
        ((0.1, 90.0), 1.4, (0.14, 90.0)),
        ((0.4, 90.0), 1.4, (0.5, 90.0)),
        ((0.5, 85.0), 1.4, (0.5, 95.0)),
        ((0.5, 95.0), 1.4, (0.5, 100.0)),
        ((0.1, 90.0), 0.5, (0.05, 90.0)),
        ((0.01, 5.0), 0.5, (0.01, 0.0)),
        ((0.1, 90.0), 1.0, (0.1, 90.0)),
    ],
)
def test_the_exposure_changes_first_and_at_its_limit_the_gain(
    before: tuple[float, float], factor: float, after: tuple[float, float]
) -> None:
    found = more_light(before[0], factor, (0.01, 3600.0), before[1], (0.0, 100.0))
    assert found == pytest.approx(after)


def test_a_camera_without_gain_has_its_exposure_alone() -> None:
    assert more_light(0.5, 1.4, (0.001, 10.0), None, None) == (0.5, None)
    assert more_light(0.3, 2.0, (0.001, 0.2), None, None) == (0.2, None)


FULL = 65535.0
STARS_PX_S = 700.0
ELECTRONS_A_UNIT = 0.5
"""Of a camera that saturates at some 30,000 electrons."""


def exposed(
    detector: Detector, number: int, exposure_s: float, magnitude: float, rng: np.random.Generator
) -> tuple[CameraFrame, Detection]:
    """Return a frame by a closed form, of a lens that gets one electron a second of magnitude 20."""
    canvas = Canvas(320, 240, 0.85, sky=60.0 * exposure_s, read_noise=2.5)
    star_streaks(canvas, rng, 10, STARS_PX_S * exposure_s, 35.0)
    canvas.point(160.2, 120.4, 10.0 ** (-0.4 * (magnitude - 20.0)) * exposure_s)
    pixels = canvas.exposed(rng, gain=ELECTRONS_A_UNIT).astype(np.float32)
    frame = CameraFrame(pixels, Utc(1790946324.0 + 0.7 * number), exposure_s, "a frame", FULL)
    return frame, detector.look(frame, ExpectedMotion(STARS_PX_S, 0.0))


@pytest.mark.parametrize("magnitude", [-4.0, 0.0, 4.0, 8.0])
@pytest.mark.parametrize("exposure_s", [0.005, pytest.param(0.1, marks=pytest.mark.soak), 0.5])
def test_the_exposure_settles_within_ten_frames_from_any_start(magnitude: float, exposure_s: float) -> None:
    rng = np.random.default_rng(3)
    detector, exposures, found = Detector(), [], []
    for number in range(14):
        frame, detection = exposed(detector, number, exposure_s, magnitude, rng)
        exposures.append(exposure_s)
        found.append(detection.kind == "point" and math.hypot(detection.x - 160.2, detection.y - 120.4) < 1.0)
        exposure_s, _ = more_light(exposure_s, light_wanted(frame, detection), (0.001, 1.0), None, None)
    assert exposures[9:] == exposures[9:10] * 5
    assert all(found[2:])
    # What a Gaussian of 0.85 px has in its middle pixel, by the error function.
    top = 10.0 ** (-0.4 * (magnitude - 20.0)) * math.erf(0.5 / 0.85 / math.sqrt(2.0)) ** 2 / ELECTRONS_A_UNIT
    assert top * exposures[-1] < FULL or exposures[-1] == 0.005
    assert top * exposures[-1] > 0.04 * FULL


def test_a_satellite_is_found_again_after_a_flare() -> None:
    rng = np.random.default_rng(5)
    detector, exposure_s, found = Detector(), 0.1, []
    # Magnitude 6, a flare of magnitude -2 for some seconds, then behind a cloud, and faint again.
    for number, magnitude in enumerate([6.0] * 3 + [2.0, -2.0, -2.0, -2.0, 2.0] + [30.0] * 5 + [9.0] * 6):
        frame, detection = exposed(detector, number, exposure_s, magnitude, rng)
        found.append(detection.kind == "point")
        exposure_s, _ = more_light(exposure_s, light_wanted(frame, detection), (0.001, 1.0), None, None)
    assert found == [True] * 8 + [False] * 5 + [True] * 6
    assert exposure_s >= 0.1


def grey_frame(sky: float, exposure_s: float = 0.1) -> CameraFrame:
    pixels = np.full((60, 80), sky * FULL, dtype=np.float32)
    return CameraFrame(pixels, Utc(0.0), exposure_s, "a frame", FULL)


@pytest.mark.parametrize(
    ("frame", "detection", "factor"),
    [
        # A bright sky: the satellite saturates though it is not far above it.
        (grey_frame(0.7), Detection("point", peak=0.95 * FULL), 0.5),
        (grey_frame(0.9), Detection("none"), 0.5),
        (grey_frame(0.0), Detection("none", saturated=1.0), 0.5),
        # It is too faint, but the sky would saturate.
        (grey_frame(0.5), Detection("point", peak=0.52 * FULL), 1.0),
        (grey_frame(0.3), Detection("point", peak=0.32 * FULL), 2.0),
        # Nothing is found: back to the exposure of the start, and no further.
        (grey_frame(0.1, 0.02), Detection("none"), 2.0),
        (grey_frame(0.1, 0.08), Detection("none"), 1.25),
        (grey_frame(0.1, 0.1), Detection("none"), 1.0),
        (grey_frame(0.1, 0.5), Detection("none"), 1.0),
        # A driver's own automatic exposure goes on.
        (grey_frame(0.1, 0.0), Detection("none"), 1.0),
    ],
)
def test_the_next_exposure_is_by_sky_and_satellite(
    frame: CameraFrame, detection: Detection, factor: float
) -> None:
    assert light_wanted(frame, detection) == pytest.approx(factor)


def test_a_v4l2_query_has_the_kernels_size_and_what_is_no_camera_has_no_gain() -> None:
    # _IOWR('V', 36, struct v4l2_queryctrl), by the kernel's rule: direction, size, type and number.
    assert CONTROL.size == 68
    assert 3 << 30 | CONTROL.size << 16 | ord("V") << 8 | 36 == struct.unpack(">I", b"\xc0\x44\x56\x24")[0]
    assert v4l_range("/dev/null", 0x00980913) is None
    assert v4l_range("/dev/nothing", 0x00980913) is None


@pytest.mark.needs("indiserver")
@pytest.mark.needs("indi_simulator_ccd")
def test_indis_own_simulated_camera_is_exposed_longer_and_then_with_more_gain(
    program: Callable[[str], str],
) -> None:
    pytest.importorskip("indipyclient")
    with indi_server(program, program("indi_simulator_ccd")) as port:
        until_s = time.monotonic() + FINDS_WITHIN_S
        while True:
            with socket.socket() as door:
                if not door.connect_ex(("127.0.0.1", port)):
                    break
            assert time.monotonic() < until_s
            select.select([], [], [], 0.1)
        camera = open_source(f"indi://127.0.0.1:{port}/CCD%20Simulator", SourceOptions())
        seen = []
        for frame in camera.frames():
            assert not isinstance(frame, Exception), frame
            seen.append((frame.exposure_s, frame.header["EXPTIME"], frame.header["GAIN"]))
            if len(seen) == 4:
                break
            camera.adjust(3.0)
        camera.close()
    exposures, written, gains = zip(*seen, strict=True)
    assert exposures == pytest.approx((0.1, 0.3, 0.5, 0.5))
    assert written == pytest.approx(exposures)
    assert gains == (90.0, 90.0, 90.0, 100.0)

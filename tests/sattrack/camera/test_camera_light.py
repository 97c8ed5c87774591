"""Exposure and gain by what is seen: the rule, and a driver of INDI's own that is asked for them."""

from __future__ import annotations

import select
import socket
import struct
import time
from typing import TYPE_CHECKING

import pytest
from indi_programs import indi_server

from sattrack.camera.frames import more_light
from sattrack.camera.sources import CONTROL, SourceOptions, open_source, v4l_range

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

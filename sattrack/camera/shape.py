"""Whether a peak has the shape of a star's image, and where exactly it is. No I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sattrack.camera.prepared import PreparedImage

    Pixels = NDArray[np.float32]
    Array = NDArray[np.float64]

CENTROID_FLOOR_PX = 0.03
SHARPEST, SURELY_SHARP = 0.8, 0.3
"""Of a star's middle pixel, the eight about it have at least so much light together; of a hot one none.
With less than the second it needs no fit."""
LEAST_WITHOUT, SHARE_WITHOUT = 4.5, 0.7
"""A star is significant without its brightest pixel too: so much, or a share of what a faint one is with it.
What is left of a hot pixel is noise, however bright it is."""
SURELY_POINT = 100.0
"""How much likelier than a star's trail a point must be: a field has many faint stars, and one satellite."""
LEAST_OWN = 0.45
"""The share of the pixels of a fit that are on nothing else."""


class Point(NamedTuple):
    """A point that a Gaussian fits: its place and one sigma, pixels; its flux and peak above the sky."""

    x: float
    y: float
    sigma_px: float
    snr: float
    flux: float
    peak: float


def reach_of_fit(psf_px: float) -> int:
    """Return how many pixels about its middle one a point is fitted to, each way."""
    return max(4, math.ceil(3.2 * psf_px))


def fitted_point(
    prepared: PreparedImage,
    x: float,
    y: float,
    snr: float,
    ridge: float,
    angle_deg: float,
    psf_px: float,
    others: NDArray[np.bool_] | None = None,
) -> Point | None:
    """Return a point as a Gaussian fits it; None where its shape is not that of a star's image.

    Of the pixels to which it is fitted, by rows, `others` are on something else.
    """
    half = reach_of_fit(psf_px)
    col, row = round(x), round(y)
    height, width = prepared.image.shape
    if not (half <= col < width - half and half <= row < height - half):
        return None
    box = (slice(row - half, row + half + 1), slice(col - half, col + half + 1))
    data = prepared.image[box].astype(np.float64)
    good = ~prepared.bad[box]
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64)
    variance = np.full(data.shape, prepared.noise**2)
    apart = prepared.sharp[box] - prepared.image[box]
    if ridge > 0.0:
        under = _ridge_under(prepared.image, col, row, half, angle_deg, psf_px)
        data -= under
        variance *= 1.3
    usable = good.sum() >= 0.6 * good.size
    if others is not None:
        good &= ~others
    if not usable or good.sum() < LEAST_OWN * good.size:
        return None
    hot = _around(data, half) < SURELY_SHARP * float(data[half, half])
    start = (x - col, y - row)
    fit = None if hot else _gauss_newton(data, np.sqrt(variance), good, dx, dy, start, psf_px)
    if fit is None:
        return None
    (flux, ox, oy, sky, sigma), covariance, residual, dof = fit
    top = data - sky
    sharp = _around(top, half) < SHARPEST * float(top[half, half])
    limit = 1.9 + (0.25 * snr) ** 2 / dof + 0.01 * ridge
    if sharp or residual > limit or flux <= 0.0:
        return None
    noise = np.sqrt(variance * max(1.0, residual)) * (prepared.sharp_noise / prepared.noise)
    # Noise beside a hot pixel makes it look like a star that is sharper than others.
    if _is_one_pixel(top + apart, noise, good, (ox, oy, max(sigma, 0.9 * psf_px)), snr) or _is_long(
        top, np.sqrt(variance), good, dx - ox, dy - oy, (flux, sigma)
    ):
        return None
    grown = prepared.common * math.sqrt(max(1.0, residual))
    of_place = math.sqrt(max(covariance[1, 1], covariance[2, 2])) * grown
    if prepared.gain is not None:
        # The satellite's own photons: their share of a place is sigma over the root of their number.
        of_place = math.hypot(of_place, sigma / math.sqrt(max(flux * prepared.gain, 1.0)))
    # What the star's image has at its middle: of the pixels there, one may be hot.
    middle = 0.5 / (math.sqrt(2.0) * sigma)
    under = float(prepared.pixels[row, col]) - data[half, half] + sky
    peak = under + flux * math.erf(middle) ** 2
    return Point(col + ox, row + oy, math.hypot(of_place, CENTROID_FLOOR_PX), snr, flux, peak)


def is_point_for_sure(
    prepared: PreparedImage,
    point: Point,
    length_px: float,
    angles_deg: Sequence[float],
    psf_px: float,
    times: float = SURELY_POINT,
) -> bool:
    """Tell whether a point is so many times as likely as a star's trail of a length, in some directions.

    The likelihood ratio of the two images, of the best flux each. A trail may lie shifted along itself: noise
    says where on it a point was seen.
    """
    half = math.ceil(length_px + 3.0 * psf_px)
    col, row = round(point.x), round(point.y)
    height, width = prepared.image.shape
    low, high = max(0, row - half), min(height, row + half + 1)
    left, right = max(0, col - half), min(width, col + half + 1)
    data = np.where(prepared.bad[low:high, left:right], 0.0, prepared.image[low:high, left:right])
    dy, dx = np.mgrid[low:high, left:right].astype(np.float64)
    dx, dy = dx - point.x, dy - point.y
    least = _explains(data, dx, dy, 0.0, psf_px) - 2.0 * math.log(times) * prepared.noise**2
    shifts = np.linspace(-0.5, 0.5, 2 * math.ceil(length_px / psf_px / 2.0) + 1) * length_px
    for angle in np.radians(angles_deg).tolist():
        along, across = (
            dx * math.cos(angle) + dy * math.sin(angle),
            dy * math.cos(angle) - dx * math.sin(angle),
        )
        if any(_explains(data, along - shift, across, length_px, psf_px) > least for shift in shifts):
            return False
    return True


def _explains(data: Array, along: Array, across: Array, length_px: float, psf_px: float) -> float:
    """Return by how much a Gaussian swept over a length, of the best flux, lessens the sum of squares."""
    from scipy.special import erf

    # A pixel's own width widens the image by a twelfth of a square.
    sigma = math.hypot(psf_px, 0.289)
    bell = np.exp(-0.5 * (across / sigma) ** 2)
    if length_px > 0.0:
        scale = math.sqrt(2.0) * sigma
        bell *= erf((along + 0.5 * length_px) / scale) - erf((along - 0.5 * length_px) / scale)
    else:
        bell *= np.exp(-0.5 * (along / sigma) ** 2)
    return max(0.0, float((data * bell).sum())) ** 2 / float((bell * bell).sum())


def _around(data: Array, half: int) -> float:
    """Return the light of the eight pixels about the middle one."""
    return float(data[half - 1 : half + 2, half - 1 : half + 2].sum()) - float(data[half, half])


def _is_one_pixel(
    data: Array, noise: Array, good: NDArray[np.bool_], shape: tuple[float, float, float], snr: float
) -> bool:
    """Tell whether the brightest pixel alone explains more than a Gaussian (x, y from the middle, sigma).

    So it does where all the others have too little of the Gaussian's light.
    """
    from scipy.special import erf

    half = data.shape[0] // 2
    edges = np.arange(-half, half + 2) - 0.5
    x, y, sigma = shape
    across, up = (np.diff(erf((edges - centre) / (math.sqrt(2.0) * sigma))) for centre in (x, y))
    bell, light = np.where(good, np.outer(up, across), 0.0) / noise, data / noise
    row, col = np.unravel_index(int(data[half - 1 : half + 2, half - 1 : half + 2].argmax()), (3, 3))
    brightest = float(light[row + half - 1, col + half - 1])
    explained = float((bell * light).sum()) / math.sqrt(float((bell * bell).sum()))
    bell[row + half - 1, col + half - 1] = 0.0
    without = float((bell * light).sum()) / math.sqrt(float((bell * bell).sum()))
    return brightest > explained or without < min(LEAST_WITHOUT, SHARE_WITHOUT * snr)


def _is_long(
    data: Array, noise: Array, good: NDArray[np.bool_], dx: Array, dy: Array, shape: tuple[float, float]
) -> bool:
    """Tell whether an image is longer than wide by more than noise makes it: its second moments in a window.

    `dx`, `dy` are from its middle, `shape` its flux and the sigma of a Gaussian that fits it.
    """
    flux, sigma = shape
    window = good * np.exp(-(dx * dx + dy * dy) / (2.0 * (1.5 * sigma) ** 2))
    across, crossed = window * (dx * dx - dy * dy), 2.0 * window * dx * dy
    bell = flux / (2.0 * math.pi * sigma * sigma) * np.exp(-(dx * dx + dy * dy) / (2.0 * sigma * sigma))
    size = float((bell * window * (dx * dx + dy * dy)).sum())
    length = math.hypot(float((data * across).sum()), float((data * crossed).sum()))
    spread = math.sqrt(float(((noise * across) ** 2).sum() + ((noise * crossed) ** 2).sum()) / 2.0)
    return length > 0.2 * size + 3.7 * spread


def _ridge_under(image: Pixels, col: int, row: int, half: int, angle_deg: float, psf_px: float) -> Array:
    """Return what a streak has under a point, by its neighbouring parts in the direction where it goes on."""
    along = math.radians(angle_deg)
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64)
    parts = []
    for step in psf_px * (5.0 + 2.0 * np.arange(6)):
        y = row + dy + step * math.sin(along)
        x = col + dx + step * math.cos(along)
        parts.append(map_coordinates(image, [y, x], order=1, mode="nearest"))
    under: Array = np.median(np.array(parts), axis=0)
    return under


def _gauss_newton(
    data: Array,
    noise: Array,
    good: NDArray[np.bool_],
    dx: Array,
    dy: Array,
    start: tuple[float, float],
    psf: float,
) -> tuple[Array, Array, float, int] | None:
    """Fit flux, x, y, sky and sigma of a pixel-integrated Gaussian; None where it goes elsewhere.

    Returns the values, their covariance, the squared residuals for each degree of freedom, and their number.
    """
    from scipy.special import erf

    root = math.sqrt(2.0)

    def parts(centre: float, at: Array, sigma: float) -> tuple[Array, Array, Array]:
        low, high = (at - 0.5 - centre) / sigma, (at + 0.5 - centre) / sigma
        value = 0.5 * (erf(high / root) - erf(low / root))
        bell_low, bell_high = (np.exp(-0.5 * e * e) / math.sqrt(2.0 * math.pi) for e in (low, high))
        return value, (bell_low - bell_high) / sigma, (bell_low * low - bell_high * high) / sigma

    axis_x, axis_y = dx[0], dy[:, 0]
    weight = (good / noise).ravel()
    values = np.array([max(float((data * good).sum()), 1e-9), *start, 0.0, psf])
    damping = 1e-3
    last = math.inf
    for _ in range(25):
        flux, x, y, sky, sigma = values
        ex, ex_x, ex_s = parts(x, axis_x, sigma)
        ey, ey_y, ey_s = parts(y, axis_y, sigma)
        shape = np.outer(ey, ex)
        model = flux * shape + sky
        columns = np.stack(
            [
                shape.ravel(),
                flux * np.outer(ey, ex_x).ravel(),
                flux * np.outer(ey_y, ex).ravel(),
                np.ones(shape.size),
                flux * (np.outer(ey, ex_s) + np.outer(ey_s, ex)).ravel(),
            ],
            axis=1,
        )
        columns *= weight[:, None]
        # Of a faint point the width is known better by the streaks than by itself.
        prior = 1.0 / (0.15 * psf) ** 2
        wanted = (data - model).ravel() * weight
        normal = columns.T @ columns
        normal[4, 4] += prior
        right = columns.T @ wanted
        right[4] += prior * (psf - sigma)
        chi = float(wanted @ wanted) + prior * (psf - sigma) ** 2
        try:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), right)
        except np.linalg.LinAlgError:
            return None
        values = values + step
        values[4] = min(max(values[4], 0.5 * psf), 2.0 * psf)
        if abs(values[1] - start[0]) > 2.0 * psf or abs(values[2] - start[1]) > 2.0 * psf:
            return None
        if abs(last - chi) < 1e-3 * max(chi, 1.0) and abs(step[1]) + abs(step[2]) < 1e-3:
            break
        damping = damping / 3.0 if chi <= last else damping * 5.0
        last = chi
    if not 0.55 * psf < values[4] < 1.8 * psf:
        return None
    dof = int(good.sum()) - len(values)
    return values, np.linalg.inv(normal), float(wanted @ wanted) / dof, dof

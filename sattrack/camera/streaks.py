"""What is long in a frame: stars' trails, a satellite's streak, and how stars trail by the run. No I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from sattrack.camera.prepared import EDGE_PX
from sattrack.camera.shape import CENTROID_FLOOR_PX

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.camera.prepared import Disc, PreparedImage

    Pixels = NDArray[np.float32]
    Array = NDArray[np.float64]

LONG_SNR = 4.0
"""Significance that every pixel of a streak has in the filtered image."""
UNBROKEN_SNR = 2.4 * LONG_SNR
"""A streak whose brightest pixel has less may be a piece of a faint one."""
FEWEST_PIXELS = 25
LONG_RATIO = 2.5
"""Length over width from which on a detection is a streak."""
NEARER = 0.6
"""Of what is between a streak's middle line and a point beside it, the share that is the streak's."""
RIDGE_SNR = 3.0
SPLINE_PX = 0.577
"""The sigma of a cubic B-spline."""
ENDS_PSF = 8.0
"""By so many sigmas of a star's image a trail may be seen longer than others."""
MISSED_SHARE = 0.02
"""Of what is typical of a streak, by how much parts of it differ beside their noise."""

Velocity = tuple[float, float] | float
"""Pixels a second in the image; a speed alone where the camera's rotation is not known."""


class Streak(NamedTuple):
    """Something long in a frame: its middle, length and direction in pixels and degrees from x towards y."""

    x: float
    y: float
    length_px: float
    angle_deg: float
    width_px: float
    flux: float
    whole: bool
    """Whether both of its ends are within the frame."""
    snr: float
    extent_px: float = 0.0
    """From one end to the other, the faint parts too."""

    def from_middle(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return how far along the streak, and across, a place is from its middle; so of arrays."""
        angle = math.radians(self.angle_deg)
        c, s = math.cos(angle), math.sin(angle)
        dx, dy = x - self.x, y - self.y
        return dx * c + dy * s, dy * c - dx * s


class Footprints(NamedTuple):
    """Which streak each pixel is part of: numbers from 1, those of other things among them, 0 for none."""

    numbers: NDArray[np.int32]
    streaks: dict[int, Streak]

    def of_others(self, peaks: Array, x: Array, y: Array, core_px: float) -> NDArray[np.bool_]:
        """Tell which places are on another streak than each peak is; shape (..., n, k) for n peaks.

        Within `core_px` of a streak's middle line a peak is on it; noise joins to it what is close beside.
        """
        there, own = self._numbers_at(x, y), self._numbers_at(peaks[:, 0], peaks[:, 1])
        for number in np.unique(own[own > 0]).tolist():
            _, across = self.streaks[number].from_middle(peaks[:, 0], peaks[:, 1])
            own[(own == number) & (np.abs(across) > core_px)] = 0
        others: NDArray[np.bool_] = (there > 0) & (there != own[:, None])
        return others

    def about(self, x: float, y: float, columns: Array, rows: Array, beside_px: float) -> NDArray[np.bool_]:
        """Tell which pixels about a place are of streaks that it is not on.

        Of one that reaches it, but whose middle line is more than `beside_px` off, those near that line.
        """
        there, own = self._numbers_at(columns, rows), int(self._numbers_at(np.array([x]), np.array([y]))[0])
        others: NDArray[np.bool_] = (there > 0) & (there != own)
        if own > 0:
            off = abs(float(self.streaks[own].from_middle(x, y)[1]))
            if off > beside_px:
                _, across = self.streaks[own].from_middle(columns, rows)
                others |= (there == own) & (np.abs(across) < NEARER * off)
        return others

    def _numbers_at(self, x: Array, y: Array) -> NDArray[np.intp]:
        """Return the numbers of the streaks at places, 0 where there is none."""
        height, width = self.numbers.shape
        columns = np.clip(np.rint(x), 0, width - 1).astype(np.intp)
        rows = np.clip(np.rint(y), 0, height - 1).astype(np.intp)
        kept = np.zeros(max(self.streaks, default=0) + 2, dtype=np.intp)
        kept[list(self.streaks)] = list(self.streaks)
        numbers: NDArray[np.intp] = kept[np.minimum(self.numbers[rows, columns], len(kept) - 1)]
        return numbers


def streaks_of(prepared: PreparedImage) -> tuple[list[Streak], Footprints]:
    """Return what is long in a frame, the brightest first, and where it is."""
    import sep

    height, width = prepared.snr.shape
    try:
        found, numbers = sep.extract(
            prepared.snr,
            LONG_SNR,
            minarea=FEWEST_PIXELS,
            filter_kernel=None,
            # What touches stays together; with more levels each part would be looked at again, for nothing.
            deblend_nthresh=1,
            clean=False,
            segmentation_map=True,
        )
    except Exception as error:
        if "limit" in str(error) or "buffer" in str(error):
            return [], Footprints(np.zeros((height, width), dtype=np.int32), {})
        raise
    long: dict[int, Streak] = {}
    for k in np.argsort(-found["flux"]).tolist():
        one = found[k]
        a, b = float(one["a"]), max(float(one["b"]), 0.3)
        if a / b < LONG_RATIO:
            continue
        # A box of length L has a variance of L²/12 along it.
        length = math.sqrt(12.0 * max(a * a - b * b, 0.0))
        whole = (
            one["xmin"] > EDGE_PX
            and one["ymin"] > EDGE_PX
            and one["xmax"] < width - 1 - EDGE_PX
            and one["ymax"] < height - 1 - EDGE_PX
        )
        long[k + 1] = Streak(
            float(one["x"]),
            float(one["y"]),
            length,
            math.degrees(float(one["theta"])) % 180.0,
            b,
            float(one["flux"]),
            bool(whole),
            float(one["peak"]),
            math.hypot(float(one["xmax"] - one["xmin"]), float(one["ymax"] - one["ymin"])),
        )
    return list(long.values()), Footprints(numbers, long)


def cross_section_px(prepared: PreparedImage, streak: Streak, psf_px: float) -> float | None:
    """Return the sigma of a streak's cross-section, a Gaussian's; None where it is none."""
    reach = 0.3 * streak.length_px
    half = math.ceil(reach + 5.0 * psf_px)
    col, row = round(streak.x), round(streak.y)
    x0, x1 = max(0, col - half), min(prepared.image.shape[1], col + half + 1)
    y0, y1 = max(0, row - half), min(prepared.image.shape[0], row + half + 1)
    y, x = np.mgrid[y0:y1, x0:x1].astype(np.float64)
    along, across = streak.from_middle(x, y)
    part = (np.abs(along) < reach) & (np.abs(across) < 5.0 * psf_px) & ~prepared.bad[y0:y1, x0:x1]
    along, across, values = along[part], across[part], prepared.image[y0:y1, x0:x1][part].astype(np.float64)
    if len(values) < 30:
        return None
    height, middle, slope, sigma, sky = float(values.max()), 0.0, 0.0, psf_px, 0.0
    for _ in range(12):
        at = (across - middle - slope * along) / sigma
        bell = np.exp(-0.5 * at * at)
        columns = np.stack(
            [
                bell,
                height * bell * at / sigma,
                height * bell * at / sigma * along,
                height * bell * at * at / sigma,
                np.ones_like(bell),
            ],
            axis=1,
        )
        step = np.linalg.lstsq(columns, values - height * bell - sky, rcond=None)[0]
        height, middle, slope, sigma, sky = np.array([height, middle, slope, sigma, sky]) + step
        if not 0.3 < sigma < 10.0 or abs(middle) > 5.0 * psf_px or height <= 0.0:
            return None
    # The square of a pixel's own width is a twelfth.
    return math.sqrt(max(sigma * sigma - 1.0 / 12.0, 0.25))


def runs_through(streak: Streak, disc: Disc) -> bool:
    """Tell whether a disc lies on a streak's middle line."""
    along, across = streak.from_middle(disc.x, disc.y)
    return bool(abs(across) < disc.radius_px and abs(along) < 0.5 * streak.length_px + disc.radius_px)


class Trail(NamedTuple):
    """How stars trail in a frame: whether they do, their direction (None: unknown) and length, pixels."""

    known: bool
    angle_deg: float | None
    length_px: float | None
    shown: bool = False
    """Whether the frame shows it, and not the run alone."""


def trail_of(long: list[Streak], stars: Velocity | None, exposure_s: float) -> Trail:
    """Return how stars trail: as the frame shows it, else as the run expects it."""
    by_run = swept_px(stars, exposure_s)
    angle = _common_angle(long)
    alike = [] if angle is None else [one for one in long if apart_deg(one.angle_deg, angle) < 5.0]
    if len(alike) > 1:
        whole = [one for one in alike if one.whole] or alike
        return Trail(True, angle, _common_length(whole, by_run), True)
    return Trail(by_run is not None, swept_deg(stars), by_run)


def _common_angle(long: list[Streak]) -> float | None:
    """Return the direction that more than half of the light of what is long has; None where none is."""
    if not long:
        return None
    # Twice the angle: a streak has no sense.
    weights = np.sqrt([one.flux for one in long])
    turned = weights * np.exp(2j * np.radians([one.angle_deg for one in long]))
    mean = complex(turned.sum())
    if abs(mean) < 0.6 * float(weights.sum()):
        return None
    return math.degrees(math.atan2(mean.imag, mean.real)) / 2.0 % 180.0


def _common_length(long: list[Streak], by_run: float | None) -> float:
    """Return the length that most of the bright streaks have; what a run expects chooses among them.

    Faint ones come in pieces, and some are of several stars in line.
    """
    expected = [one for one in long if by_run is not None and abs(one.length_px - by_run) < 0.15 * by_run]
    bright = expected or [one for one in long if one.snr >= UNBROKEN_SNR] or long
    return float(np.median([one.length_px for one in bright[:9]]))


def apart_deg(one_deg: float, other_deg: float) -> float:
    """Return the angle between two directions without a sense, degrees, 0 to 90."""
    return abs((one_deg - other_deg + 90.0) % 180.0 - 90.0)


def swept_px(velocity: Velocity | None, exposure_s: float) -> float | None:
    """Return how far something moves in an exposure, pixels; None where its motion is not known."""
    if velocity is None:
        return None
    speed = velocity if isinstance(velocity, float | int) else math.hypot(*velocity)
    return speed * exposure_s


def swept_deg(velocity: Velocity | None) -> float | None:
    """Return the direction of a motion; None where it is not known, or nothing moves."""
    if velocity is None or isinstance(velocity, float | int) or math.hypot(*velocity) == 0.0:
        return None
    return math.degrees(math.atan2(velocity[1], velocity[0])) % 180.0


def standing_on(snr: Pixels, long: list[Streak], least: float, psf_px: float) -> Array:
    """Return of each streak what stands out most of what is typical of it; rows as `_peaks` gives them.

    Typical is the median along a streak, at each distance from its middle line, and so is the noise there.
    Near its ends nothing is known.
    """
    found = []
    across = 0.5 * psf_px * np.arange(-6.0, 7.0)
    # Interpolation shows the pattern of the pixels; a cubic spline of them as they are does not. It widens
    # the filter: noise is less by so much.
    calmer = psf_px / math.hypot(psf_px, SPLINE_PX)
    for one in long:
        reach = math.floor(one.length_px / 2.0 - 3.0 * psf_px)
        if reach < 6.0 * psf_px:
            continue
        angle = math.radians(one.angle_deg)
        along = np.arange(-reach, reach + 1.0)
        x = one.x + along[:, None] * math.cos(angle) - across * math.sin(angle)
        y = one.y + along[:, None] * math.sin(angle) + across * math.cos(angle)
        values = map_coordinates(snr, [y, x], order=3, mode="nearest", prefilter=False) / calmer
        typical = np.median(values, axis=0)
        rest = values - typical
        if reach > 20.0 * psf_px:
            # By a direction that is a little wrong, one side of the line rises along it, and one falls.
            lower, upper = (np.median(half, axis=0) for half in (rest[:reach], rest[reach + 1 :]))
            rest -= along[:, None] * (upper - lower) / (reach + 1.0)
        noisier = (1.4826 * np.median(np.abs(rest), axis=0)) ** 2 - 1.0
        noise = np.sqrt(1.0 + max(0.0, float(noisier @ typical / (typical @ typical))) * np.abs(typical))
        left = np.where(typical > RIDGE_SNR, rest / np.hypot(noise, MISSED_SHARE * typical), 0.0)
        i, k = np.unravel_index(int(np.argmax(left)), left.shape)
        if left[i, k] >= least:
            found.append((x[i, k], y[i, k], typical[k] + left[i, k], typical[k], one.angle_deg))
    return np.array(found).reshape(-1, 5)


def may_end_at(x: float, y: float, long: list[Streak], trail: Trail, psf_px: float) -> bool:
    """Tell whether a trail may end on another in line at a place on a streak: they are brighter there.

    So it may be on a streak that is longer than trails are, on the longest, which no other one confirms, and
    where a part of another trail is so near that its end may be there.
    """
    longest = math.inf if trail.length_px is None else 1.1 * trail.length_px + ENDS_PSF * psf_px
    for on in long:
        along, across = on.from_middle(x, y)
        if abs(across) > 4.0 * psf_px or abs(along) > 0.5 * on.extent_px:
            continue
        others = [one for one in long if one is not on]
        if on.extent_px > longest or not any(one.length_px > 0.85 * on.length_px for one in others):
            return True
        for one in others:
            along, across = one.from_middle(x, y)
            far = abs(along) + 0.5 * one.extent_px
            both = abs(one.from_middle(on.x, on.y)[0]) + 0.5 * (one.extent_px + on.extent_px)
            in_line = abs(across) < 4.0 * psf_px and apart_deg(one.angle_deg, on.angle_deg) < 10.0
            if in_line and one.extent_px < far < longest < both:
                return True
    return False


def ends_of(prepared: PreparedImage, streak: Streak) -> tuple[float, float, float] | None:
    """Return the middle between the two ends of a streak, and one sigma; None where they do not fit.

    The light across the streak, summed at each distance along it, is an even strip with blurred ends.
    """
    from scipy.optimize import leastsq
    from scipy.special import erf

    angle = math.radians(streak.angle_deg)
    along_x, along_y = math.cos(angle), math.sin(angle)
    reach = math.ceil(0.5 * streak.length_px + 6.0 * streak.width_px)
    at = np.arange(-reach, reach + 1.0)
    side = np.arange(-3.0, 3.5) * streak.width_px / 1.5
    x = streak.x + at[:, None] * along_x - side * along_y
    y = streak.y + at[:, None] * along_y + side * along_x
    light = map_coordinates(prepared.image, [y, x], order=1, mode="nearest").sum(axis=1)

    def strip(place: Array, height: float, first: float, last: float, blur: float, sky: float) -> Array:
        scale = math.sqrt(2.0) * max(abs(blur), 0.3)
        model: Array = sky + 0.5 * height * (erf((place - first) / scale) - erf((place - last) / scale))
        return model

    half = 0.5 * streak.length_px
    start = (float(np.median(light[np.abs(at) < 0.8 * half])), -half, half, streak.width_px, 0.0)
    noise = prepared.noise * math.sqrt(len(side))
    values, covariance, *_ = leastsq(
        lambda shape: (light - strip(at, *shape)) / noise, start, full_output=True, maxfev=400
    )
    if covariance is None:
        return None
    first, last = float(values[1]), float(values[2])
    misfit = float(np.mean(((light - strip(at, *values)) / noise) ** 2))
    variance = 0.25 * float(covariance[1, 1] + covariance[2, 2] + 2.0 * covariance[1, 2]) * max(1.0, misfit)
    if (
        not first < last
        or not variance < 25.0
        or abs(last - first - streak.length_px) > 0.5 * streak.length_px
    ):
        return None
    middle = 0.5 * (first + last)
    across = streak.width_px / max(streak.snr, 1.0)
    sigma = math.hypot(prepared.common * max(math.sqrt(variance), across), CENTROID_FLOOR_PX)
    return streak.x + middle * along_x, streak.y + middle * along_y, sigma

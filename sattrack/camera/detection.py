"""Where the satellite is in a frame: a point among the stars' streaks, or a streak among stars. No I/O.

A matched filter gives every pixel the significance of a point there. Of its peaks those are left that are a
point by their shape, and that stand out of anything that runs through them along the stars' streaks: a star's
streak, its ends and its noise do not. `sep` (Bertin & Arnouts 1996, A&AS 117, 393) takes the background, and
finds what is long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from sattrack.camera.frames import START_EXPOSURE_S
from sattrack.camera.prepared import EDGE_PX, Disc, PreparedImage, Unusable, prepared_of
from sattrack.camera.shape import (
    SURELY_POINT,
    SURELY_SHARP,
    Point,
    fitted_point,
    is_point_for_sure,
    reach_of_fit,
)
from sattrack.camera.streaks import (
    LONG_RATIO,
    RIDGE_SNR,
    Footprints,
    Streak,
    Trail,
    apart_deg,
    cross_section_px,
    ends_of,
    may_end_at,
    runs_through,
    standing_on,
    streaks_of,
    swept_deg,
    swept_px,
    trail_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sattrack.camera.frames import CameraFrame
    from sattrack.camera.streaks import Velocity

    Pixels = NDArray[np.float32]
    Array = NDArray[np.float64]

SURE_SNR = 6.5
"""Significance of a point anywhere: of 1.2 million pixels of noise, one in 10,000 frames has it."""
EXPECTED_SNR = 4.5
"""Significance of a point where one is expected, by the frames before."""
EXPECTED_WITHIN_PX = 8.0
"""How far from where it is expected a point may be, beside what its motion is unsure by."""
RECENT_S = 5.0
"""For so long the place of the satellite tells where it is expected."""
USUAL_PSF_PX = 1.3
PSF_PX = (0.6, 6.0)
"""Between these the sigma of a star's image is believed to be."""
MOST_CANDIDATES, MOST_ALIKE = 60, 300
AMBIGUOUS = 0.6
"""Of two points, the brighter one counts where the other has less than this share of its flux."""
MOST_STANDING = 3
"""More points than that are stars, where a run says that stars trail and the frame shows no trail."""
FEWEST_ROUND = 3
"""Among fewer round stars a streak is no satellite."""
LEAST_TRAIL_PX = 3.0
"""Of shorter trails no single frame shows that they are none."""
OF_DISC_PX = 0.3
"""One sigma of the middle of a disc: its edge goes by whole pixels."""
CORE_PSF = 4.0
"""Within so many sigmas of a star's image from the middle of a streak something is on it."""
FAINT_RIDGE_SNR = 0.85
"""Fainter trails cover so little of a frame that noise on them is as rare as noise beside them."""
FEWEST_BESIDE = 3
"""Places on each side of a peak at which a star's trail through it is looked for."""
Kind = Literal["point", "streak", "none"]
T_EVEN = 2.0


class PointSource(NamedTuple):
    """Something round in a frame."""

    x: float
    y: float
    flux: float
    snr: float


class ExpectedMotion(NamedTuple):
    """What a run says of a frame: how stars and the satellite move in the image, in pixels a second.

    A velocity is a pair, or a speed alone where the camera's rotation is not known. `near` is where the
    satellite must be, with one sigma, pixels from the middle of the first pixel.
    """

    stars: Velocity | None = None
    target: Velocity | None = None
    near: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Detection:
    """What was seen in one frame. x and y in pixels, one sigma of each; None where nothing was seen."""

    kind: Kind
    x: float | None = None
    y: float | None = None
    sigma_px: float | None = None
    snr: float | None = None
    why: str | None = None
    """Why there is nothing, in words."""
    stars: tuple[PointSource, ...] = ()
    """The other things, the brightest first: the middles of streaks that are whole, or points."""
    saturated: float = 0.0
    """The share of pixels that are."""
    peak: float | None = None
    """The highest value, above zero, in the image of the satellite; where none is found, of a candidate's."""
    streaks: int = 0


@dataclass(slots=True)
class Detector:
    """Looks at the frames of one camera, in order of time; what it learns of one serves the next."""

    psf_px: float = USUAL_PSF_PX
    _last: list[tuple[float, float, float]] = field(default_factory=list)
    """The last places of the satellite: UTC, x, y."""
    _psf_seen: int = 0
    _stood: tuple[float, tuple[Disc, ...]] = (-math.inf, ())
    """What was saturated and compact in the last frame, with its UTC."""

    def look(self, frame: CameraFrame, expected: ExpectedMotion | None = None) -> Detection:
        """Return what is seen in a frame."""
        prepared = prepared_of(frame, self.psf_px)
        if isinstance(prepared, Unusable):
            return Detection("none", why=prepared.why, saturated=prepared.saturated)
        discs = prepared.discs
        every, footprints = streaks_of(prepared)
        # A column into which a disc overflows is no trail.
        long = [one for one in every if not any(runs_through(one, disc) for disc in discs)]
        self._learn_psf(prepared, long)
        expected = expected or ExpectedMotion()
        near = expected.near or self._near(float(frame.utc.unix_s))
        trail = trail_of(long, expected.stars, frame.exposure_s)
        wanted = swept_px(expected.target, frame.exposure_s)
        if wanted is not None and wanted > T_EVEN * LONG_RATIO * self.psf_px:
            found = _streak_target(prepared, long, expected, frame.exposure_s)
        else:
            steady = [one for one in discs if self._stands(one, float(frame.utc.unix_s), expected)]
            found = _point_target(prepared, long, footprints, trail, near, self.psf_px, steady)
        if found.kind == "none" and expected.target is None and not trail.known:
            found = _lone_streak(prepared, long, found, self.psf_px)
        self._stood = float(frame.utc.unix_s), discs
        if found.x is not None and found.y is not None:
            self._last = [*self._last[-3:], (float(frame.utc.unix_s), found.x, found.y)]
        return found

    def _learn_psf(self, prepared: PreparedImage, long: list[Streak]) -> None:
        bright = [one for one in long if one.snr > 12.0 and one.length_px > 15.0 * self.psf_px]
        found = [cross_section_px(prepared, one, self.psf_px) for one in bright[:3]]
        widths = [one for one in found if one is not None]
        if widths:
            share = 1.0 / (1.0 + min(self._psf_seen, 9))
            self.psf_px += share * (min(max(float(np.median(widths)), PSF_PX[0]), PSF_PX[1]) - self.psf_px)
            self._psf_seen += 1

    def _stands(self, disc: Disc, utc_s: float, expected: ExpectedMotion) -> bool:
        """Tell whether a disc stands where the satellite was last, or one while the stars moved."""
        places = [(x, y) for then_s, x, y in self._last[-1:] if 0.0 < utc_s - then_s < RECENT_S]
        since_s = utc_s - self._stood[0]
        moved_px = swept_px(expected.stars, since_s) if 0.0 < since_s < RECENT_S else None
        if moved_px is not None and moved_px > 4.0 * EXPECTED_WITHIN_PX:
            places += [(one.x, one.y) for one in self._stood[1]]
        return any(math.hypot(disc.x - x, disc.y - y) < EXPECTED_WITHIN_PX for x, y in places)

    def _near(self, utc_s: float) -> tuple[float, float, float] | None:
        """Return where the satellite is expected by the last two frames in which it was seen."""
        recent = [one for one in self._last if 0.0 < utc_s - one[0] < RECENT_S]
        if len(recent) < 2:
            return None
        (t0, x0, y0), (t1, x1, y1) = recent[-2:]
        if t1 - t0 <= 0.0:
            return None
        share = (utc_s - t1) / (t1 - t0)
        moved = math.hypot(x1 - x0, y1 - y0) * share
        return x1 + (x1 - x0) * share, y1 + (y1 - y0) * share, EXPECTED_WITHIN_PX + 0.3 * moved


def _point_target(
    prepared: PreparedImage,
    long: list[Streak],
    footprints: Footprints,
    trail: Trail,
    near: tuple[float, float, float] | None,
    psf_px: float,
    steady: list[Disc],
) -> Detection:
    """Return the satellite as a point; `steady` is what is saturated and stands while stars move."""
    stars = _star_middles(long, trail)
    discs = prepared.discs
    told = trail.shown or (trail.length_px or 0.0) > LEAST_TRAIL_PX
    none = Detection(
        "none",
        stars=stars,
        saturated=prepared.saturated,
        peak=max(one.peak for one in discs) if told and discs else None,
        streaks=len(long),
    )
    trailing = trail.length_px is not None and trail.length_px > 2.0 * LONG_RATIO * psf_px
    least = SURE_SNR if near is None else EXPECTED_SNR
    peaks = found = _spread(prepared.sharp, _peaks(prepared.snr, least))
    on_streaks = standing_on(prepared.snr, long, least, psf_px)
    peaks, on_streaks = (_without(discs, one, psf_px) for one in (peaks, on_streaks))
    if not len(peaks) and not len(on_streaks) and not discs:
        return _because(none, "nothing stands out of the noise")
    angles = [] if trail.angle_deg is None else [trail.angle_deg]
    angles += [one.angle_deg for one in long[:8] if all(apart_deg(one.angle_deg, a) > 3.0 for a in angles)]
    samples = int(min(max(_rest(trail, psf_px), FEWEST_BESIDE), 12))
    everywhere = list(np.arange(0.0, 180.0, 3.75))
    # Stars' streaks that lie beside a peak pass it at up to about half a right angle.
    beside = [one for one in everywhere if angles and apart_deg(one, angles[0]) < 45.0]
    across = [one for one in everywhere if one not in beside]
    passes = (
        (angles[:1], samples, False),
        (angles[1:], 0, False),
        (beside, 0, True),
        (across, 0, False),
    )
    for directions, count, both in passes:
        if directions and len(peaks):
            peaks = _standing_out(prepared.snr, peaks, footprints, directions, psf_px, least, count, both)
    peaks = np.concatenate([peaks, on_streaks])
    # Where two trails in line overlap, no more stands on the brighter one than is as bright itself.
    ends = [
        height - ridge < 1.2 * ridge + 3.0 and may_end_at(x, y, long, trail, psf_px)
        for x, y, height, ridge, _ in peaks.tolist()
    ]
    peaks = peaks[~np.array(ends, dtype=bool)]
    # The strongest first, and only so many: what looks like more is no satellite among stars.
    peaks = peaks[np.argsort(peaks[:, 3] - peaks[:, 2])][:MOST_CANDIDATES]
    directions_deg = angles[:1] or everywhere[::4]
    points = _points(prepared, footprints, peaks, near, trail, directions_deg, psf_px)
    lone = [one for one in discs if not any(one.holds(other.x, other.y, 3.0 * psf_px) for other in points)]
    if lone and not steady and not told and trail.known:
        why = "trails are too short to tell whether what is saturated is the satellite"
        return _because(none, why)
    points += [
        _point_of(prepared, one) for one in lone if one.whole and (one in steady or _is_no_trail(one, trail))
    ]
    if not points:
        return _because(none, "nothing that stands out has the shape of a point")
    standing = [one for one in points if any(disc.holds(one.x, one.y, 0.0) for disc in steady)]
    if near is None and not trail.shown and not standing:
        # Stars that stand close together hide one another: others that are about as bright are looked for.
        found = _beside(long, found, psf_px)
        bright = max(one.snr for one in points)
        found = found[np.argsort(np.abs(found[:, 2] - bright))][:MOST_ALIKE]
        seen = _points(prepared, footprints, found, None, trail, directions_deg, psf_px, 1.0)
        points += [
            one for one in seen if all(math.hypot(one.x - o.x, one.y - o.y) > 3.0 * psf_px for o in points)
        ]
    if trailing and not trail.shown and not standing and len(points) > MOST_STANDING:
        return _because(none, "the stars stand still: does this camera look along the mount?")
    return _chosen(prepared, standing or points, trailing or bool(standing), near, none)


def _spread(image: Pixels, peaks: Array) -> Array:
    """Return the peaks whose light is not that of one pixel."""
    rows, columns = peaks[:, 1].astype(np.intp), peaks[:, 0].astype(np.intp)
    values = np.stack([image[rows + dy, columns + dx] for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
    most = values.max(axis=0)
    kept: Array = peaks[values.sum(axis=0) - most >= SURELY_SHARP * most]
    return kept


def _beside(long: list[Streak], peaks: Array, psf_px: float) -> Array:
    """Return the peaks that are on no streak."""
    for one in long:
        along, across = one.from_middle(peaks[:, 0], peaks[:, 1])
        reach_px = 0.5 * one.length_px + 3.0 * psf_px
        peaks = peaks[(np.abs(along) > reach_px) | (np.abs(across) > 3.0 * psf_px)]
    return peaks


def _points(
    prepared: PreparedImage,
    footprints: Footprints,
    peaks: Array,
    near: tuple[float, float, float] | None,
    trail: Trail,
    angles_deg: list[float],
    psf_px: float,
    times: float = SURELY_POINT,
) -> list[Point]:
    """Return the peaks that are points, and so many times as likely as a trail, eight at most."""
    points: list[Point] = []
    reach = reach_of_fit(psf_px)
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    for x, y, height, ridge, angle in peaks:
        snr = height - ridge
        expected_here = near is not None and math.hypot(x - near[0], y - near[1]) <= near[2]
        if snr >= SURE_SNR or expected_here:
            others = footprints.about(x, y, round(x) + dx, round(y) + dy, 0.75 * CORE_PSF * psf_px)
            found = fitted_point(prepared, x, y, snr, ridge, angle, psf_px, others)
            if found is None or any(math.hypot(found.x - o.x, found.y - o.y) < 3.0 * psf_px for o in points):
                continue
            # Of a longer trail more is seen on both sides of a peak than the peak itself tells.
            if _rest(trail, psf_px) >= FEWEST_BESIDE or is_point_for_sure(
                prepared, found, trail.length_px or 0.0, angles_deg, psf_px, times
            ):
                points.append(found)
        if len(points) >= 8:
            break
    return points


def _rest(trail: Trail, psf_px: float) -> float:
    """Return at how many places on each side of a peak a trail through it is seen."""
    return math.inf if trail.length_px is None else (trail.length_px / 2.0 / psf_px - 5.0) / 2.0


def _without(discs: Sequence[Disc], peaks: Array, psf_px: float) -> Array:
    """Return the peaks that are in no large disc nor close beside: noise and halo show some there."""
    for disc in discs:
        if disc.radius_px > 2.0 * psf_px:
            peaks = peaks[~disc.holds(peaks[:, 0], peaks[:, 1], 3.0 * psf_px)]
    return peaks


def _is_no_trail(disc: Disc, trail: Trail) -> bool:
    """Tell whether something saturated is much shorter than stars' trails, if those are known."""
    if trail.length_px is None:
        return True
    return trail.length_px > LEAST_TRAIL_PX and disc.length_px < 0.5 * trail.length_px


def _point_of(prepared: PreparedImage, disc: Disc) -> Point:
    """Return something saturated as a point."""
    snr = float(prepared.snr[round(disc.y), round(disc.x)])
    return Point(disc.x, disc.y, OF_DISC_PX, snr, disc.flux, disc.peak)


def _because(none: Detection, why: str) -> Detection:
    return replace(none, why=why)


def _chosen(
    prepared: PreparedImage,
    points: list[Point],
    trailing: bool,
    near: tuple[float, float, float] | None,
    none: Detection,
) -> Detection:
    """Return which of the points is the satellite."""
    there = points
    if near is not None:
        close = [one for one in points if math.hypot(one.x - near[0], one.y - near[1]) <= near[2]]
        there = close or [one for one in points if one.snr >= SURE_SNR]
    if not there:
        return _because(none, "nothing stands out of the noise")
    there = sorted(there, key=lambda one: -one.flux)
    best = there[0]
    if near is None and not trailing and len(there) > 1:
        stars = tuple(PointSource(one.x, one.y, one.flux, one.snr) for one in points)
        why = "stars do not trail, and nothing distinguishes the satellite from them"
        return replace(none, why=why, stars=stars)
    if len(there) > 1 and there[1].flux > AMBIGUOUS * best.flux:
        return _because(none, f"{len(there)} points are alike, and nothing shows which is the satellite")
    return Detection(
        "point",
        best.x,
        best.y,
        best.sigma_px,
        best.snr,
        stars=none.stars,
        saturated=prepared.saturated,
        peak=best.peak,
        streaks=none.streaks,
    )


def _peaks(snr: Pixels, least: float) -> Array:
    """Return the peaks of the filtered image: x, y, significance, 0 (their ridge) and 0 (its direction)."""
    inner = snr[EDGE_PX:-EDGE_PX, EDGE_PX:-EDGE_PX]
    rows, columns = np.divmod(np.flatnonzero(inner > 0.9 * least), inner.shape[1])
    rows, columns = rows + EDGE_PX, columns + EDGE_PX
    values = snr[rows, columns]
    top = np.ones(len(values), dtype=bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if (dy, dx) != (0, 0):
                other = snr[rows + dy, columns + dx]
                top &= values >= other if (dy, dx) < (0, 0) else values > other
    rows, columns, values = rows[top], columns[top], values[top].astype(np.float64)
    for step in ((0, 1), (1, 0)):
        # The top of the parabola through a peak and its neighbours, of a peak between pixels.
        below, above = (snr[rows + k * step[0], columns + k * step[1]] for k in (-1, 1))
        values += np.clip(
            (above - below) ** 2 / (8.0 * np.maximum(2.0 * values - above - below, 1e-6)), 0.0, 1.0
        )
    sure = values >= least
    found = np.zeros((int(sure.sum()), 5))
    found[:, 0], found[:, 1], found[:, 2] = columns[sure], rows[sure], values[sure]
    return found


def _standing_out(
    snr: Pixels,
    peaks: Array,
    footprints: Footprints,
    directions: list[float],
    psf_px: float,
    least: float,
    samples: int = 0,
    both: bool = False,
) -> Array:
    """Return the peaks that stand out of what runs through them, or ends in them, in any of some directions.

    The brighter side of a peak counts: so the ends of a streak do not stand out. With `samples`, so many are
    averaged on each side, in a direction in which stars are known to trail: the faintest star matters then,
    and a peak at the image's edge, where no side can be seen, does not stand out. With `both`, the fainter
    side counts: what runs through a peak matters, and not what passes beside it.
    """
    steps = psf_px * (5.0 + 2.0 * np.arange(samples or 6))
    along = np.radians(directions)
    # Axes: the two senses, directions, peaks, steps.
    senses = np.array([1.0, -1.0])[:, None, None, None] * steps
    x = peaks[:, :1] + senses * np.cos(along)[:, None, None]
    y = peaks[:, 1:2] + senses * np.sin(along)[:, None, None]
    inside = (x >= 0) & (y >= 0) & (x <= snr.shape[1] - 1) & (y <= snr.shape[0] - 1)
    cut = (inside.sum(axis=-1) < FEWEST_BESIDE).any(axis=(0, 1)) & bool(samples)
    # What is on another streak tells nothing of one through the peak.
    seen = inside & ~footprints.of_others(peaks, x, y, CORE_PSF * psf_px)
    if samples:
        seen = np.where((seen.sum(axis=-1) < FEWEST_BESIDE)[..., None], inside, seen)
    values = np.where(seen, map_coordinates(snr, [y, x], order=1, mode="nearest"), 0.0)
    sides: Array = values.sum(axis=-1) / np.maximum(seen.sum(axis=-1), 1) if samples else _medians(values)
    first = sides[0] < sides[1] if both else sides[0] >= sides[1]
    levels = np.where(first, sides[0], sides[1])
    # Of each peak, the direction in which most runs through it.
    most, each = levels.argmax(axis=0), np.arange(len(peaks))
    first, level = first[most, each], levels[most, each]
    higher = level > peaks[:, 3]
    one_side = np.where(first, 0, 1), most, each
    rough = 1.4826 * _medians(np.abs(values[one_side] - level[:, None]), seen[one_side])
    turned = np.array(directions)[most] - np.where(first, 0.0, 180.0)
    ridge, angle = np.where(higher, level, peaks[:, 3]), np.where(higher, turned, peaks[:, 4])
    ridge[ridge < (max(2.0 / math.sqrt(samples), FAINT_RIDGE_SNR) if samples else RIDGE_SNR)] = 0.0
    excess = peaks[:, 2] - ridge
    # A bright streak is noisier than the sky, by its photons and by what a few samples show.
    rougher = np.where(ridge > RIDGE_SNR, np.maximum(rough**2 - 1.0, 0.0) + 0.15 * ridge, 0.0)
    noise = np.where(ridge > RIDGE_SNR, np.sqrt(1.0 + 1.0 / (samples or 6) + rougher), 1.0)
    # What runs through less than in the directions before has been judged there.
    standing = (excess > least * noise) & (excess > 0.25 * ridge) | ~higher
    standing &= ~cut
    kept: Array = peaks[standing].copy()
    kept[:, 3], kept[:, 4] = ridge[standing], angle[standing]
    return kept


def _medians(values: Array, seen: NDArray[np.bool_] | None = None) -> Array:
    """Return the medians along the last axis, whose few numbers are sorted faster than parted.

    With `seen` those of what is seen, shape (n, k); 0 where nothing is.
    """
    n = values.shape[-1]
    if seen is None:
        ordered = np.sort(values, axis=-1)
        middle: Array = 0.5 * (ordered[..., (n - 1) // 2] + ordered[..., n // 2])
        return middle
    ordered, count = np.sort(np.where(seen, values, np.inf), axis=-1), np.maximum(seen.sum(axis=-1), 1)
    places = np.stack([(count - 1) // 2, count // 2], axis=-1)
    return np.where(seen.any(axis=-1), np.take_along_axis(ordered, places, axis=-1).mean(axis=-1), 0.0)


def _star_middles(long: list[Streak], trail: Trail) -> tuple[PointSource, ...]:
    """Return the middles of the stars' streaks that are whole, and as long as most."""
    if trail.angle_deg is None or trail.length_px is None:
        return ()
    return tuple(
        PointSource(one.x, one.y, one.flux, one.snr)
        for one in long
        if one.whole
        and apart_deg(one.angle_deg, trail.angle_deg) < 5.0
        and abs(one.length_px - trail.length_px) < max(0.15 * trail.length_px, 2.0)
    )


def _streak_target(
    prepared: PreparedImage, long: list[Streak], expected: ExpectedMotion, exposure_s: float
) -> Detection:
    """Return the satellite as the streak that has the length and the direction that a run expects."""
    length, angle = swept_px(expected.target, exposure_s), swept_deg(expected.target)
    assert length is not None
    fits = [
        one
        for one in long
        if abs(one.length_px - length) < max(0.25 * length, 4.0)
        and (angle is None or apart_deg(one.angle_deg, angle) < 10.0)
    ]
    none = Detection("none", stars=_round(prepared, long), saturated=prepared.saturated, streaks=len(long))
    if not fits:
        return _because(none, f"no streak of {length:.0f} pixels as the satellite must make it")
    return _streak_found(prepared, fits, none)


def _lone_streak(
    prepared: PreparedImage, long: list[Streak], otherwise: Detection, psf_px: float
) -> Detection:
    """Return the one streak among round stars as the satellite, where there is just one."""
    if len(long) != 1:
        return otherwise
    stars = _round(prepared, long)
    # Hot pixels are round in the filtered image too.
    shaped = [fitted_point(prepared, one.x, one.y, one.snr, 0.0, 0.0, psf_px) for one in stars[:30]]
    if len(shaped) - shaped.count(None) < FEWEST_ROUND:
        return otherwise
    return _streak_found(
        prepared, long, Detection("none", stars=stars, saturated=prepared.saturated, streaks=1)
    )


def _streak_found(prepared: PreparedImage, fits: list[Streak], none: Detection) -> Detection:
    best = fits[0]
    if len(fits) > 1 and fits[1].flux > AMBIGUOUS * best.flux:
        return _because(none, f"{len(fits)} streaks are alike, and nothing shows which is the satellite")
    if not best.whole:
        return _because(none, "the streak leaves the image: its middle is unknown")
    if best.snr < SURE_SNR:
        return _because(none, "the streak is too faint")
    ends = ends_of(prepared, best)
    if ends is None:
        return _because(none, "the streak has no two ends that can be seen")
    x, y, sigma = ends
    return Detection(
        "streak",
        x,
        y,
        sigma,
        best.snr,
        stars=none.stars,
        saturated=prepared.saturated,
        peak=float(prepared.pixels[round(best.y), round(best.x)]),
        streaks=len(fits),
    )


def _round(prepared: PreparedImage, long: list[Streak]) -> tuple[PointSource, ...]:
    """Return the round things of a frame, the brightest first, without what belongs to a streak."""
    import sep

    found = sep.extract(prepared.snr, SURE_SNR, minarea=5, filter_kernel=None, deblend_cont=0.05)
    sources = []
    for one in found[np.argsort(-found["flux"])]:
        if one["a"] > 1.8 * max(one["b"], 0.5):
            continue
        if any(math.hypot(one["x"] - s.x, one["y"] - s.y) < 0.5 * s.length_px for s in long):
            continue
        sources.append(PointSource(float(one["x"]), float(one["y"]), float(one["flux"]), float(one["peak"])))
    return tuple(sources)


LEVEL = (0.05, 0.8)
"""Between these shares of the full scale the satellite's peak is left alone."""
MOST_SATURATED = 0.02
"""Of all pixels: more is the sky."""


def light_wanted(frame: CameraFrame, detection: Detection) -> float:
    """Return how many times the light the next exposure should take, by how bright the satellite is.

    Where nothing is found, the exposure returns to START_EXPOSURE_S, unless that would saturate something:
    what is found by less light and not by more would make it swing for good.
    """
    full = frame.saturation or 65535.0
    sample = frame.pixels[::16, ::16]
    sample = sample[np.isfinite(sample)]
    sky = float(np.median(sample)) / full if sample.size else 0.0
    peak = None if detection.peak is None else detection.peak / full
    if detection.saturated > MOST_SATURATED or sky > LEVEL[1] or (peak is not None and peak > LEVEL[1]):
        return 0.5
    # Twice the light must not be too much.
    if sky > LEVEL[1] / 2.0 or detection.saturated > MOST_SATURATED / 4.0:
        return 1.0
    if detection.kind != "none":
        return 2.0 if peak is not None and peak - sky < LEVEL[0] else 1.0
    if not 0.0 < frame.exposure_s < START_EXPOSURE_S or _brightest(frame) > LEVEL[1] / 2.0 * full:
        return 1.0
    return min(2.0, START_EXPOSURE_S / frame.exposure_s)


def _brightest(frame: CameraFrame) -> float:
    """Return the highest value that four pixels in a square have: hot ones stand alone."""
    pairs = np.minimum(frame.pixels[:-1], frame.pixels[1:])
    return float(np.nanmax(np.minimum(pairs[:, :-1], pairs[:, 1:]), initial=0.0))

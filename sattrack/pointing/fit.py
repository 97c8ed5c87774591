"""Fit a pointing model to stars: robustly, with sigmas, terms chosen by cross-validation. Pure.

Residuals are on the sky, at the position that the mount reports. A few wrong stars are found by a fit of
absolute values and left out; what is left is fitted by least squares. Terms beyond the geometry are taken in
where the stars that a fit without them predicts come nearer by it (Allen's PRESS: each star's residual over
its leverage; Technometrics 16, 125, 1974).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.core.angles import wrap180
from sattrack.core.errors import SattrackError
from sattrack.mount.model import PointingTerms
from sattrack.pointing.terms import ALTAZ, PointingModel, frame_of
from sattrack.pointing.tour import units

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sattrack.pointing.terms import Axes

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]

CORE = ((1, ("IH", "ID")), (3, ("MA", "ME")), (5, ("CH",)), (6, ("NP",)), (8, ("TF",)))
"""How many stars each term needs that every mount has: with fewer it is not told from the others."""
APART_DEG = 1.0
"""A star nearer to one before it, on the same side of the pole, tells terms apart no better."""
CHOSEN = ("DAF", "FO", "HCES", "HCEC", "DCES", "DCEC", "HDSH2", "HDCH2", "HDSD2", "HDCD2")
CHOSEN_ALTAZ = ("ACES", "ACEC", "ECES", "ECEC")
FEWEST_TO_CHOOSE = 10
SIGMA_ARCSEC = 2.0
"""What a star is expected to be off by, where nothing else is known: both axes alike."""
BETTER_SHARE = 0.97
"""A term is taken in where it brings the held-out residuals down to this share, or further."""
SURE_SIGMAS, LEAST_TERM_ARCSEC = 3.5, 1.0
WRONG_SIGMAS, LEAST_WRONG_ARCSEC = 6.0, 10.0
"""A star is wrong where it is off by so many robust sigmas, and by the second at least."""
MOST_WRONG_SHARE, MOST_LEFT_ARCSEC = 0.34, 300.0
FEWEST_TO_REFUSE = 5
"""Where more stars are wrong, or those that agree are farther off, nothing was measured; fewer stars than the
last may show terms that are not fitted yet."""
FEW_LEFT_ARCSEC, FEWEST_TO_TELL = 1200.0, 3
"""So few stars, from the second on, are off by more only where one of them is wrong."""
UNFITTED_ARCSEC = 40.0
"""What terms leave that so few stars cannot tell yet: no star is wrong by it."""
LONE_TIMES, FEWEST_WITH_LONE, MOST_WITH_LONE = 10.0, 4, 30
"""A star is the lone wrong one if without any other so many times more is left. Among more stars than the
last the fit of absolute values finds it."""
BUMP_SIGMAS, LEAST_BUMP_ARCSEC, BUMP_SHARE = 8.0, 20.0, 0.5
"""A bump is one by so many times the noise, by the second at least, where it explains as large a share."""
LEAST_EACH_SIDE = 4
NO_MODEL = (
    "contradict the others: no pointing model fits them; check site, clock and camera, and that nothing on "
    "the mount is loose"
)
_STEP_ARCSEC = 1.0
_ROUNDS = 8


class Star(NamedTuple):
    """Where a star was, by hour angle and declination (refracted, of date), and where the mount stood for it.

    Degrees. `axis_dec_deg` is beyond 90° where the mount stood past the pole. For an azimuth mount the first
    of both are azimuths, the second altitudes; with a pole of its own they are hour angles and declinations
    all the same, and `fit` turns them. `icrs_deg` is the direction in the catalogue's frame.
    """

    hour_angle_deg: float
    dec_deg: float
    axis_hour_angle_deg: float
    axis_dec_deg: float
    icrs_deg: tuple[float, float] = (0.0, 0.0)
    sidereal_deg: float = 0.0
    """Local apparent sidereal time."""


@dataclass(frozen=True, slots=True)
class PointingFit:
    """A fitted model: the terms' names, values and covariance in arcseconds, residuals of all stars.

    `residuals_arcsec` has shape (n, 2): on the sky towards growing hour angle and declination, those about
    the mount's own pole, or azimuth and altitude of an azimuth mount; reported minus the model.
    `before_arcsec` are those without any model. `used` tells which stars were fitted.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    residuals_arcsec: Array
    before_arcsec: Array
    used: Bools
    held_out_rms_arcsec: float | None
    latitude_deg: float
    axes: Axes

    @property
    def rms_arcsec(self) -> float:
        """What is left on the sky at the stars that were fitted."""
        return rms(self.residuals_arcsec[self.used])

    @property
    def stars(self) -> int:
        """How many stars were fitted."""
        return int(self.used.sum())

    @property
    def model(self) -> PointingModel:
        """The model, of the normal side of the pole."""
        return _model(self.names, self.values, self.latitude_deg, self.axes)

    def terms(self, utc: str) -> PointingTerms:
        """Return the model as a profile keeps it."""
        sigmas = np.sqrt(np.diag(self.covariance))
        pairs = {
            name: (round(float(value), 3), round(float(sigma), 3))
            for name, value, sigma in zip(self.names, self.values, sigmas, strict=True)
        }
        held_out = self.held_out_rms_arcsec
        return PointingTerms(
            utc,
            self.latitude_deg,
            pairs,
            round(self.rms_arcsec, 3),
            self.stars,
            None if held_out is None else round(held_out, 3),
            self.axes,
            signs="tpoint",
        )

    def predicted_arcsec(self, directions_deg: Array) -> float:
        """Return the error on the sky that the terms' covariance leaves at directions (n, 2), RMS."""
        sky = _Sky.of_directions(directions_deg, self.latitude_deg, self.axes)
        jacobian = sky.jacobian(self.names, self.values)
        return math.sqrt(
            float(np.einsum("nki,ij,nkj->", jacobian, self.covariance, jacobian)) / len(jacobian)
        )


def rms(residuals: Array) -> float:
    """Return the root of the mean square of residuals on the sky, shape (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))) if len(residuals) else 0.0


class _Sky:
    """Stars as arrays: directions, reported positions, and the model's residuals at them, arcseconds."""

    def __init__(self, stars: Sequence[Star], latitude_deg: float, axes: Axes) -> None:
        at = np.array([star[:4] for star in stars], dtype=np.float64).reshape(-1, 4)
        frame = frame_of(axes, latitude_deg)
        if frame is not None:
            looks, stands = (frame.angles(at[:, k], at[:, k + 1], fn=np)[:2] for k in (0, 2))
            at = np.stack([*looks, *stands], axis=1)
        sign = -1.0 if axes == "altaz" else 1.0
        self.direction = sign * at[:, 0], at[:, 1]
        self.reported = sign * at[:, 2], at[:, 3]
        self.latitude_deg, self.axes = latitude_deg, axes
        self.beyond = np.abs(at[:, 3]) > 90.0
        # Past the pole both axes turn the other way on the sky.
        self._outward = np.where(self.beyond, -1.0, 1.0)[:, None] * np.array([sign, 1.0])

    @cached_property
    def places(self) -> int:
        """How many stars are apart from those before them."""
        at = units(np.stack(self.direction, axis=1))
        near = (at @ at.T > math.cos(math.radians(APART_DEG))) & (self.beyond[:, None] == self.beyond)
        kept: list[int] = []
        for row in range(len(at)):
            if not near[row, kept].any():
                kept.append(row)
        return len(kept)

    @classmethod
    def of_directions(cls, directions_deg: Array, latitude_deg: float, axes: Axes) -> _Sky:
        """Return directions with a mount that has no errors."""
        return cls([Star(h, d, h, d) for h, d in directions_deg.tolist()], latitude_deg, axes)

    def residuals(self, names: tuple[str, ...], values: Array) -> Array:
        """Return reported minus modelled positions by the axes' angles, on the sky, shape (n, 2)."""
        model = _model(names, values, self.latitude_deg, self.axes)
        h, d = (np.empty_like(one) for one in self.direction)
        for side in (False, True):
            rows = self.beyond == side
            if rows.any():
                h[rows], d[rows] = model.on_side(side).axes_of(
                    self.direction[0][rows], self.direction[1][rows]
                )
        first = wrap180(self.reported[0] - h)
        second = wrap180(self.reported[1] - d)
        return 3600.0 * np.stack([first * np.cos(np.radians(self.reported[1])), second], axis=1)

    def seen(self, names: tuple[str, ...], values: Array) -> Array:
        """Return the same on the sky, towards growing coordinates as `Star` has them."""
        found: Array = self.residuals(names, values) * self._outward
        return found

    def jacobian(self, names: tuple[str, ...], values: Array) -> Array:
        """Return by how much a second of arc of each term moves the model, shape (n, 2, terms)."""
        columns = []
        for index in range(len(names)):
            step = np.zeros(len(names))
            step[index] = _STEP_ARCSEC
            moved = self.residuals(names, values - step) - self.residuals(names, values + step)
            columns.append(moved / (2.0 * _STEP_ARCSEC))
        return np.stack(columns, axis=2)


def _model(names: tuple[str, ...], values: Array, latitude_deg: float, axes: Axes) -> PointingModel:
    return PointingModel(dict(zip(names, values.tolist(), strict=True)), latitude_deg, axes)


def core_terms(stars: int, axes: Axes = "equatorial") -> tuple[str, ...]:
    """Return the terms that every mount has, as far as so many stars can tell them apart."""
    names = tuple(name for fewest, some in CORE if stars >= fewest for name in some)
    if axes != "altaz":
        return names
    other = {known: name for name, (known, _) in ALTAZ.items()}
    return tuple(other[name] for name in names)


def fit(
    stars: Sequence[Star],
    latitude_deg: float,
    axes: Axes = "equatorial",
    names: tuple[str, ...] | None = None,
    sigma_arcsec: float = SIGMA_ARCSEC,
) -> PointingFit:
    """Return the model of stars in the order in which they were taken; `names` None chooses the terms.

    `sigma_arcsec` is one star's sigma in either axis, as far as its residuals do not tell that. Raises
    SattrackError without a star, or where more stars contradict one another than agree.
    """
    if not stars:
        raise SattrackError("no star was measured: there is nothing to fit a pointing model to")
    sky = _Sky(stars, latitude_deg, axes)
    lone = _lone_wrong(sky, stars) if names is None else None
    kept = np.arange(len(stars)) != (-1 if lone is None else lone)
    rest = sky if lone is None else _without(sky, stars, lone)
    places = rest.places
    chosen = names or core_terms(places, axes)
    if lone is not None and places < CORE[-1][0]:
        used = np.ones(len(stars) - 1, dtype=bool)
        values = _least_squares(rest, chosen, np.zeros(len(chosen)), used)
    else:
        values, used = _robust(rest, chosen, sigma_arcsec)
    if names is None and min(places, used.sum()) >= FEWEST_TO_CHOOSE:
        chosen, values, used = _with_chosen(rest, chosen, values, used, sigma_arcsec)
    kept[kept] = used
    return _result(sky, chosen, values, kept, sigma_arcsec)


def _without(sky: _Sky, stars: Sequence[Star], one: int) -> _Sky:
    """Return all stars but one."""
    return _Sky([*stars[:one], *stars[one + 1 :]], sky.latitude_deg, sky.axes)


def _lone_wrong(sky: _Sky, stars: Sequence[Star]) -> int | None:
    """Return the star without which the others agree, where that is so of no other; None where none is.

    A fit of absolute values does not find it where each of few stars decides about a term.
    """
    if sky.places < FEWEST_WITH_LONE or len(stars) > MOST_WITH_LONE or _left(sky) <= MOST_LEFT_ARCSEC:
        return None
    left = np.array([_left(_without(sky, stars, one)) for one in range(len(stars))])
    least, next_least = np.partition(left, 1)[:2]
    if least > MOST_LEFT_ARCSEC or next_least < max(LONE_TIMES * least, MOST_LEFT_ARCSEC):
        return None
    return int(np.argmin(left))


def _left(sky: _Sky) -> float:
    """Return what a fit of all stars leaves in either axis, its freedom counted."""
    names, count = core_terms(sky.places, sky.axes), len(sky.beyond)
    values = _least_squares(sky, names, np.zeros(len(names)), np.ones(count, dtype=bool))
    return math.sqrt(float(np.sum(sky.residuals(names, values) ** 2)) / (2 * count - len(names)))


def _result(
    sky: _Sky, names: tuple[str, ...], values: Array, used: Bools, sigma_arcsec: float
) -> PointingFit:
    residuals = sky.residuals(names, values)
    jacobian = sky.jacobian(names, values)[used]
    covariance, held_out = _covariance(jacobian, residuals[used], sigma_arcsec)
    left, before = sky.seen(names, values), sky.seen((), np.zeros(0))
    return PointingFit(names, values, covariance, left, before, used, held_out, sky.latitude_deg, sky.axes)


def _covariance(jacobian: Array, residuals: Array, sigma_arcsec: float) -> tuple[Array, float | None]:
    """Return the terms' covariance, and the RMS of held-out residuals.

    Twice the sigmas hold the truth as often as twice a normal sigma does, however few the residuals are.
    """
    flat = jacobian.reshape(-1, jacobian.shape[2])
    inverse: Array = np.linalg.pinv(flat.T @ flat).astype(np.float64)
    freedom = len(flat) - flat.shape[1]
    square = sigma_arcsec**2
    if freedom > 0:
        seen = float(np.sum(residuals**2)) / freedom
        square = seen * _wider(freedom) ** 2 if freedom >= 6 else max(seen, square)
    return square * inverse, _held_out(jacobian, residuals, inverse)


def _wider(freedom: int) -> float:
    """Return Student's quantile of two sigmas over the normal one (Abramowitz and Stegun 26.7.5)."""
    z = 2.0
    first, second = (z**3 + z) / 4.0, (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    return (z + first / freedom + second / freedom**2) / z


def _held_out(jacobian: Array, residuals: Array, inverse: Array) -> float | None:
    """Return the RMS at each star of a fit without it, on the sky; None where a fit needs every star."""
    if len(residuals) * 2 <= jacobian.shape[2] + 1:
        return None
    hat = np.einsum("nki,ij,nlj->nkl", jacobian, inverse, jacobian)
    left = np.eye(2) - hat
    if float(np.linalg.det(left).min()) < 1e-6:
        return None
    return rms(np.linalg.solve(left, residuals[:, :, None])[:, :, 0])


def _solved(sky: _Sky, names: tuple[str, ...], values: Array, weights: Array) -> Array:
    """Return values after one step of Gauss and Newton with a weight for each star."""
    root = np.sqrt(weights)[:, None]
    jacobian = (sky.jacobian(names, values) * root[:, :, None]).reshape(-1, len(names))
    residuals = (sky.residuals(names, values) * root).ravel()
    return values + np.linalg.lstsq(jacobian, residuals, rcond=1e-10)[0]


def _least_squares(sky: _Sky, names: tuple[str, ...], values: Array, used: Bools) -> Array:
    for _ in range(_ROUNDS):
        before, values = values, _solved(sky, names, values, used.astype(np.float64))
        if float(np.abs(values - before).max()) < 1e-4:
            break
    return values


def _robust(sky: _Sky, names: tuple[str, ...], sigma_arcsec: float) -> tuple[Array, Bools]:
    """Return values, and which stars agree with them: first by least absolute values, then by squares."""
    count = len(sky.beyond)
    values = np.zeros(len(names))
    for _ in range(4 * _ROUNDS):
        size = np.linalg.norm(sky.residuals(names, values), axis=1)
        weights = 1.0 / np.maximum(size, sigma_arcsec) if values.any() else np.ones(count)
        before, values = values, _solved(sky, names, values, weights)
        if float(np.abs(values - before).max()) < 0.01 * sigma_arcsec:
            break
    used = np.ones(count, dtype=bool)
    for _ in range(_ROUNDS):
        size = np.linalg.norm(sky.residuals(names, values), axis=1)
        share = max(0.1, 1.0 - len(names) / (2.0 * count))
        # Of a plane's normal errors half are within 1.18 sigma of the middle; a fit takes its share away.
        spread = float(np.median(size)) / 1.1774 / math.sqrt(share)
        limit = max(WRONG_SIGMAS * max(spread, sigma_arcsec), LEAST_WRONG_ARCSEC)
        before_used, used = used, size <= limit
        if count - used.sum() > MOST_WRONG_SHARE * count or used.sum() * 2 <= len(names):
            everyone = np.ones(count, dtype=bool)
            whole = _least_squares(sky, names, values, everyone)
            few = sky.places < CORE[-1][0] and rms(sky.residuals(names, whole)) <= UNFITTED_ARCSEC
            if few or sky.places < FEWEST_TO_REFUSE:
                values, used = whole, everyone
                break
            raise SattrackError(f"{count - int(used.sum())} of {count} stars {NO_MODEL}")
        values = _least_squares(sky, names, values, used)
        if (used == before_used).all():
            break
    left = rms(sky.residuals(names, values)[used])
    few = sky.places < FEWEST_TO_REFUSE
    if left > (FEW_LEFT_ARCSEC if few else MOST_LEFT_ARCSEC) and sky.places >= FEWEST_TO_TELL:
        hint = "; more stars show whether one is wrongly solved" if few else ""
        raise SattrackError(f"stars {NO_MODEL}: {left:.0f}″ are left{hint}")
    return values, used


def _with_chosen(
    sky: _Sky, names: tuple[str, ...], values: Array, used: Bools, sigma_arcsec: float
) -> tuple[tuple[str, ...], Array, Bools]:
    """Take terms in, the best one first, as long as the held-out stars come nearer by them."""
    candidates = CHOSEN_ALTAZ if sky.axes == "altaz" else CHOSEN
    best = _result(sky, names, values, used, sigma_arcsec)
    while 2 * best.stars - len(best.names) > max(6, best.stars // 2):
        tried = []
        for name in candidates:
            if name in best.names:
                continue
            wider = (*best.names, name)
            found = _least_squares(sky, wider, np.append(best.values, 0.0), best.used)
            tried.append(_result(sky, wider, found, best.used, sigma_arcsec))
        good = [one for one in tried if _better(one, best)]
        if not good:
            break
        next_best = min(good, key=lambda one: one.held_out_rms_arcsec or math.inf)
        # What seemed a wrong star may have been a missing term.
        values, used = _robust(sky, next_best.names, sigma_arcsec)
        best = _result(sky, next_best.names, values, used, sigma_arcsec)
    return best.names, best.values, best.used


def _better(one: PointingFit, than: PointingFit) -> bool:
    if one.held_out_rms_arcsec is None or than.held_out_rms_arcsec is None:
        return False
    least = max(SURE_SIGMAS * math.sqrt(float(one.covariance[-1, -1])), LEAST_TERM_ARCSEC)
    return (
        abs(float(one.values[-1])) > least
        and one.held_out_rms_arcsec < BETTER_SHARE * than.held_out_rms_arcsec
    )


def residuals_of(stars: Sequence[Star], terms: PointingTerms) -> PointingFit:
    """Return a known model held against stars; its covariance is that of its sigmas alone."""
    sky = _Sky(stars, terms.latitude_deg, terms.axes)
    values = np.array([value for value, _ in terms.terms.values()])
    sigmas = np.array([sigma for _, sigma in terms.terms.values()])
    names = tuple(terms.terms)
    used = np.ones(len(stars), dtype=bool)
    left, before = sky.seen(names, values), sky.seen((), np.zeros(0))
    return PointingFit(
        names, values, np.diag(sigmas**2), left, before, used, None, terms.latitude_deg, terms.axes
    )


class Bump(NamedTuple):
    """A mount that was moved beside its axes: before which star (an index), and by how much on the sky."""

    before_star: int
    moved_arcsec: float

    def text(self, left_out: int) -> str:
        """Say it of a run of which so many stars before those that were searched are left out already."""
        return (
            f"the mount was moved before star {left_out + self.before_star + 1}, by {self.moved_arcsec:.0f}″ "
            "on the sky: the stars before it are left out"
        )


def find_bump(stars: Sequence[Star], latitude_deg: float, axes: Axes = "equatorial") -> Bump | None:
    """Return where the stars from one on show another mount than those before; None where none do.

    Index errors and the tilt of the first axis may change at the bump, cone and non-perpendicularity not.
    """
    count = len(stars)
    if count < 2 * LEAST_EACH_SIDE:
        return None
    sky = _Sky(stars, latitude_deg, axes)
    names = core_terms(count, axes)
    moving = core_terms(4, axes)
    values = _least_squares(sky, names, np.zeros(len(names)), np.ones(count, dtype=bool))
    plain = sky.jacobian(names, values)
    residuals = sky.residuals(names, values)
    step = sky.jacobian(moving, np.zeros(len(moving)))
    tried = []
    for first in range(LEAST_EACH_SIDE, count - LEAST_EACH_SIDE + 1):
        later = (np.arange(count) >= first)[:, None, None]
        found, size = _absolute(np.concatenate([plain, step * later], axis=2), residuals)
        tried.append((size, first, found[len(names) :]))
    size, first, moved = min(tried, key=lambda one: one[0])
    _, without = _absolute(plain, residuals)
    noise = max(size / max(1.0, count - 0.5 * (len(names) + len(moving))), SIGMA_ARCSEC)
    jump = rms((step @ moved)[first:])
    if jump < max(BUMP_SIGMAS * noise, LEAST_BUMP_ARCSEC) or size > BUMP_SHARE * without:
        return None
    return Bump(first, jump)


def _absolute(jacobian: Array, residuals: Array) -> tuple[Array, float]:
    """Return the linear fit of least absolute values on the sky, and the sum of what it leaves."""
    matrix, flat = jacobian.reshape(2 * len(jacobian), -1), residuals.ravel()
    weights, found, size = np.ones(len(residuals)), np.zeros(matrix.shape[1]), np.zeros(len(residuals))
    for _ in range(12):
        root = np.repeat(np.sqrt(weights), 2)
        found = np.linalg.lstsq(matrix * root[:, None], flat * root, rcond=1e-10)[0]
        size = np.linalg.norm((flat - matrix @ found).reshape(-1, 2), axis=1)
        weights = 1.0 / np.maximum(size, SIGMA_ARCSEC)
    return found, float(np.sum(size))

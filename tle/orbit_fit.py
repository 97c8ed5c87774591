"""An orbit corrected by observed directions: six corrections, what to expect of them, and a fit.

The corrections are displacements in km at an epoch, of the mean elements that SGP4 has there: along the
orbit, of the semi-major axis, of the eccentricity vector (two), of the orbit's plane (two). They are made in
equinoctial elements, which no inclination or eccentricity of a satellite makes singular, and SGP4 itself
takes the corrected elements: along the track, across it and in height they act over a pass as errors of
elements do. What SGP4 leaves out moves a satellite as small random accelerations would.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.bias import Bias
from tle.earth import EarthOrientation
from tle.elements import propagation_error
from tle.errors import BiasError, ObservationError, PropagationError
from tle.formats.observations import DEFAULT_SIGMA_ARCSEC
from tle.instants import DAY_S, UNIX_EPOCH_JD, Utc
from tle.observed import apparent_unit, bias_from_observation
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.elements import Elements
    from tle.formats.observations import Observation

    Array = NDArray[np.float64]

STATES = 6
ALONG, AXIS, ECCENTRIC_X, ECCENTRIC_Y, PLANE_X, PLANE_Y = range(STATES)
FIRST_ALONG_S = 30.0
"""Elements are seconds late or early, after a manoeuvre a minute: one sigma."""
# One sigma at the elements' own epoch, km, and its growth a day; `bench/element_errors.py` prints what sets
# of one object a month apart differ by. Of the plane: the inclination, and the node.
_AXIS_KM, _AXIS_KM_DAY = 0.03, 0.03
_ECCENTRIC_KM, _ECCENTRIC_KM_DAY = 0.4, 0.05
_INCLINATION_KM, _INCLINATION_KM_DAY = 0.15, 0.015
_NODE_KM, _NODE_KM_DAY = 0.15, 0.15
_LOW_KM = 7000.0
_NOISE_KM2_S3 = 1.2e-11
"""Spectral density of the accelerations that SGP4 leaves out, at 7000 km from the Earth's centre."""
_NOISE_POWER = 6.0
_STEP_KM = 0.5
LONGEST_STEP_KM = 150.0
# A fit: its steps, of which the first weigh sightings, from so many sigmas on, by how far they lie off.
_MOST_FITS, _ROBUST_FITS, _NEAR_SIGMAS = 60, 12, 1.5
_FIT_WIDER = 3.0
_MOST_SCATTER_RAD = math.radians(0.5)
_SETTLED_FIT_KM = 0.01
_MEDIAN_SQUARE = 2.0 * math.log(2.0)
_REBASE_STEPS = 4
_REBASE_PART = 1.0 / 12.0
_DRIFT_SPAN_S = 1.0
"""Over a shorter span no drift is reported."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What is expected of the corrections: mean, km, and covariance, km²; shapes (6,) and (6, 6)."""

    mean_km: Array
    covariance_km2: Array


class CorrectableOrbit:
    """The orbit of some elements about an epoch, and the elements that a correction makes of it."""

    def __init__(self, elements: Elements, epoch: Utc) -> None:
        """Move the elements to the epoch (Utc of one instant). Raises PropagationError."""
        self.given = elements
        self.epoch = epoch
        self.elements = _rebased(elements, epoch)

    def corrected(self, correction_km: Array) -> Elements:
        """Return the elements at the epoch with a correction, shape (6,), km."""
        return _corrected(self.elements, correction_km)

    def expected(self, wider: float = 1.0) -> Expected:
        """Return what is expected of the corrections by the elements' age, `wider` times that but along."""
        days = abs(float(self.given.age_s(self.epoch))) / DAY_S
        one = self.elements
        far = max(1.0, one.semi_major_axis_km / _LOW_KM)
        axis, eccentric, inclination, node = (
            wider * far * math.hypot(first, daily * days)
            for first, daily in (
                (_AXIS_KM, _AXIS_KM_DAY),
                (_ECCENTRIC_KM, _ECCENTRIC_KM_DAY),
                (_INCLINATION_KM, _INCLINATION_KM_DAY),
                (_NODE_KM, _NODE_KM_DAY),
            )
        )
        along = FIRST_ALONG_S * self.speed_km_s
        covariance = np.diag(np.square([along, axis, eccentric, eccentric, 0.0, 0.0]))
        # The inclination is the length of the plane's vector, the node its angle.
        c, s = math.cos(math.radians(one.raan_deg)), math.sin(math.radians(one.raan_deg))
        turn = np.array([[c, -s], [s, c]])
        covariance[4:, 4:] = turn @ np.diag([inclination**2, node**2]) @ turn.T
        return Expected(np.zeros(STATES), covariance)

    @property
    def speed_km_s(self) -> float:
        """Give the mean speed along the orbit."""
        return float(2.0 * math.pi * self.elements.semi_major_axis_km / self.elements.period_s)

    @property
    def noise_km2_s3(self) -> float:
        """Give the spectral density of the accelerations that SGP4 leaves out."""
        return float(_NOISE_KM2_S3 * (_LOW_KM / self.elements.semi_major_axis_km) ** _NOISE_POWER)


@dataclass(frozen=True, slots=True)
class Sighting:
    """An observed direction, a unit vector as the propagator's apparent place has it, and its sigma, rad.

    `propagator` is one of the satellite, without a bias, for the air that the direction went through.
    With `image` it was seen in the image of a camera on the mount: the terms of both count.
    """

    utc: Utc
    unit: Array
    sigma_rad: float
    propagator: Propagator
    image: Image | None = None


@dataclass(frozen=True, slots=True)
class Image:
    """A place in a camera's image, and where that lies on the sky as far as is known before.

    `fed` is the direction to which the mount was fed, a unit vector, `fed_rate` its derivative, rad/s;
    `right` and `up` are the image's axes there, x and y the place on them: tangents of angles from `fed`.
    """

    camera: str
    coarse: bool
    fed: Array
    fed_rate: Array
    right: Array
    up: Array
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class FittedBias:
    """The fitted orbit as biases of the given elements at an instant, with one sigma each."""

    utc: Utc
    along_s: float
    along_sigma_s: float
    cross_deg: float
    cross_sigma_deg: float


@dataclass(frozen=True, slots=True)
class OrbitFit:
    """Corrections fitted to all observations at once.

    `off_arcsec` is how far each observation lies from the fitted orbit, along the track and across, shape
    (n, 2); `used` tells which were; `scatter` is how much larger the errors of those are than their sigmas
    say, at least 1, and is in the covariance (km²).
    """

    orbit: CorrectableOrbit
    correction_km: Array
    covariance_km2: Array
    off_arcsec: Array
    used: NDArray[np.bool_]
    scatter: float

    @property
    def elements(self) -> Elements:
        """The corrected elements."""
        return self.orbit.corrected(self.correction_km)

    @property
    def rms_arcsec(self) -> float:
        """How far the used observations lie off on the sky, RMS."""
        return math.sqrt(float(np.mean(np.sum(np.square(self.off_arcsec[self.used]), axis=1))))

    def bias_at(self, believed: Propagator, t: Utc) -> FittedBias:
        """Return the biases of the given elements at an instant; `believed` is a propagator of those."""
        there = believed.with_elements(self.elements).at(t)
        found = bias_from_observation(believed, float(there.ra_deg), float(there.dec_deg), t)
        by_state = believed.of_date(t, Partials(self.orbit, self.correction_km).states(t)[:3])
        basis, u = track_basis(there.unit, by_state), there.unit
        spread = basis @ by_state @ self.covariance_km2 @ by_state.T @ basis.T
        later = believed.at(t, Bias(found.along_s + 0.05, found.cross_deg)).unit
        pace = float(np.linalg.norm(later - u)) / 0.05
        range_km = float(there.range_km)
        along, across = (math.sqrt(float(square)) / range_km for square in np.diag(spread))
        return FittedBias(t, found.along_s, along / pace, found.cross_deg, math.degrees(across))

    def state_covariance_km2(self) -> Array:
        """Return the covariance of position and velocity at the epoch, TEME, km and km/s, shape (6, 6)."""
        by_state = Partials(self.orbit, self.correction_km).states(self.orbit.epoch)
        spread: Array = by_state @ self.covariance_km2 @ by_state.T
        return spread


def fit_orbit(orbit: CorrectableOrbit, sightings: Sequence[Sighting], gate: float = 18.4) -> OrbitFit | None:
    """Fit the corrections to all sightings at once; None where they agree on no orbit near the elements.

    Sightings that lie beyond the gate, a squared distance in their own sigmas and the scatter of all, are
    left out. They are weighed by how far they lie off before, so that a minority of wild ones has no say.
    """
    expected = orbit.expected(_FIT_WIDER)
    weight_of_expected = np.linalg.inv(expected.covariance_km2)
    at, partials = np.zeros(STATES), Partials(orbit, np.zeros(STATES))
    at[ALONG] = _first_along_km(orbit, sightings)
    used = np.ones(len(sightings), dtype=bool)
    scatter = 1.0
    for step in range(_MOST_FITS):
        if float(np.abs(at - partials.at_km).max()) > _SETTLED_FIT_KM:
            partials = Partials(orbit, at)
        found = [compared(orbit, one, at, partials) for one in sightings]
        off = np.array([one.off for one in found])
        sigmas = np.array([one.sigma_rad for one in sightings])
        square = np.sum(np.square(off / sigmas[:, None]), axis=1)
        scatter = max(1.0, math.sqrt(float(np.median(square[used])) / _MEDIAN_SQUARE))
        distance = square / scatter**2
        robust = step < _ROBUST_FITS
        used = distance <= gate if not robust else np.ones(len(sightings), dtype=bool)
        scattered = not robust and scatter * float(np.median(sigmas)) > _MOST_SCATTER_RAD
        if scattered or 2 * int(used.sum()) <= len(sightings):
            return None
        share = np.minimum(1.0, _NEAR_SIGMAS / np.sqrt(np.maximum(distance, 1e-12))) if robust else used
        weights = share / np.square(sigmas * scatter)
        normal, pull = weight_of_expected.copy(), -weight_of_expected @ at
        for (gap, by_state, _), weight in zip(found, weights, strict=True):
            normal += weight * by_state.T @ by_state
            pull += weight * by_state.T @ gap
        change = np.linalg.solve(normal, pull)
        longest = float(np.abs(change).max())
        at = at + change * min(1.0, LONGEST_STEP_KM / max(longest, 1e-12))
        if not robust and longest < _SETTLED_FIT_KM:
            arcsec = np.degrees(off) * 3600.0
            return OrbitFit(orbit, at, np.linalg.inv(normal), arcsec, used, scatter)
    return None


@dataclass(frozen=True, slots=True)
class ObservedFit:
    """What was fitted to which observations, in order of time: the biases, and what each says alone."""

    elements: Elements
    observations: Sequence[Observation]
    alone: Sequence[tuple[float, float] | None]
    """Of each observation seconds along and arcseconds across, None where no bias leads there."""
    fit: OrbitFit
    believed: Propagator
    first: FittedBias
    last: FittedBias

    @property
    def drift_s_min(self) -> float | None:
        """Give the change of the bias along from the first to the last observation used; None within 1 s."""
        minutes = float(self.last.utc.unix_s - self.first.utc.unix_s) / 60.0
        if 60.0 * minutes < _DRIFT_SPAN_S:
            return None
        return (self.last.along_s - self.first.along_s) / minutes

    def document(self) -> dict[str, float | int | str | None]:
        """Return the bias at the last observation used, and of how many it is, for JSON."""
        used = int(self.fit.used.sum())
        return {
            "along_s": self.last.along_s,
            "along_sigma_s": self.last.along_sigma_s,
            "drift_s_min": self.drift_s_min,
            "cross_deg": self.last.cross_deg,
            "cross_sigma_deg": self.last.cross_sigma_deg,
            "at_utc": self.last.utc.isoformat(),
            "used": used,
            "rejected": len(self.observations) - used,
            "rms_arcsec": self.fit.rms_arcsec,
        }


def fit_observations(elements: Elements, seen: Sequence[Observation]) -> ObservedFit | None:
    """Return the fit to observations of one satellite in order of time; None where they agree on no orbit.

    Each has its own site, frame and sigma. Raises PropagationError.
    """
    earth = EarthOrientation.installed()
    sites = {one.site: Propagator(elements, one.site, earth=earth) for one in seen}
    middle = Utc(0.5 * float(seen[0].utc.unix_s + seen[-1].utc.unix_s))
    orbit = CorrectableOrbit(elements, middle)
    sightings: list[Sighting] = []
    alone: list[tuple[float, float] | None] = []
    for one in seen:
        unit = apparent_unit(one.ra_deg, one.dec_deg, one.utc, one.frame, one.site, earth)
        sigma_arcsec = DEFAULT_SIGMA_ARCSEC if one.sigma_arcsec is None else one.sigma_arcsec
        pace_arcsec_s = math.degrees(float(np.linalg.norm(sites[one.site].at(one.utc).unit_rate))) * 3600.0
        sigma_arcsec = math.hypot(max(sigma_arcsec, 0.1), pace_arcsec_s * (one.sigma_time_s or 0.0))
        sightings.append(Sighting(one.utc, unit, math.radians(sigma_arcsec / 3600.0), sites[one.site]))
        try:
            bias = one.residual(elements, earth)
            alone.append((bias.along_s, bias.cross_deg * 3600.0))
        except ObservationError:
            alone.append(None)
    fit = fit_orbit(orbit, sightings)
    if fit is None:
        return None
    used = [one for one, taken in zip(seen, fit.used, strict=True) if taken]
    believed = sites[used[-1].site]
    first, last = fit.bias_at(sites[used[0].site], used[0].utc), fit.bias_at(believed, used[-1].utc)
    return ObservedFit(elements, seen, alone, fit, believed, first, last)


def _first_along_km(orbit: CorrectableOrbit, sightings: Sequence[Sighting]) -> float:
    """Return the median of what single sightings say of the correction along; 0 where none says anything."""
    found = []
    for one in sightings:
        seen = one.unit
        ra_deg = math.degrees(math.atan2(seen[1], seen[0])) % 360.0
        dec_deg = math.degrees(math.asin(max(-1.0, min(1.0, float(seen[2])))))
        try:
            bias = bias_from_observation(one.propagator, ra_deg, dec_deg, one.utc)
        except (ObservationError, BiasError, PropagationError):
            continue
        found.append(bias.along_s)
    return float(np.median(found)) * orbit.speed_km_s if found else 0.0


class Partials:
    """What each correction changes of position and velocity, by differences of SGP4's own."""

    def __init__(self, orbit: CorrectableOrbit, at_km: Array) -> None:
        self.at_km = at_km
        steps = [np.zeros(STATES), *(_STEP_KM * row for row in np.eye(STATES))]
        self._records = [orbit.corrected(at_km + step).satrec() for step in steps]
        # A filter asks for the same instant at each of its steps.
        self._last: tuple[float, Array] | None = None

    def states(self, t: Utc) -> Array:
        """Return km and km/s a km of each correction, TEME, shape (6, 6): a column a correction."""
        if self._last is not None and self._last[0] == t.unix_s:
            return self._last[1]
        jd, fraction = _jd(t)
        states = np.array([(*r, *v) for _, r, v in (record.sgp4(jd, fraction) for record in self._records)])
        by_state: Array = (states[1:] - states[0]).T / _STEP_KM
        self._last = float(t.unix_s), by_state
        return by_state


def compared(orbit: CorrectableOrbit, sighting: Sighting, at_km: Array, partials: Partials) -> Compared:
    """Return how far a sighting lies from a correction, along the track and left of it.

    Raises PropagationError.
    """
    propagator = sighting.propagator.with_elements(orbit.corrected(at_km))
    seen = propagator.at(sighting.utc)
    u = seen.unit
    by_state = propagator.of_date(sighting.utc, partials.states(sighting.utc)[:3])
    basis = track_basis(u, by_state)
    ahead, left = (float(value) for value in basis @ sighting.unit)
    off = np.array([math.atan2(ahead, float(sighting.unit @ u)), math.asin(max(-1.0, min(1.0, left)))])
    range_km = float(seen.range_km)
    return Compared(off, basis @ by_state / range_km, range_km)


class Compared(NamedTuple):
    """How far a sighting lies from what is expected, rad, (2,); what that is by state, (2, n); the range."""

    off: Array
    by_state: Array
    range_km: float


def track_basis(u: Array, by_state: Array) -> Array:
    """Return the directions on the sky along the track and left of it, shape (2, 3)."""
    m = by_state[:, ALONG] - (by_state[:, ALONG] @ u) * u
    m = m / math.sqrt(float(m @ m))
    return np.array([m, cross_product(u, m)])


def cross_product(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors, shape (3,): numpy's own takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _jd(t: Utc) -> tuple[float, float]:
    days, second = divmod(float(t.unix_s), DAY_S)
    return days + UNIX_EPOCH_JD, second / DAY_S


def _corrected(one: Elements, correction_km: Array) -> Elements:
    along, axis, ex, ey, px, py = (float(value) for value in correction_km)
    a = one.semi_major_axis_km
    angles = (one.raan_deg, one.arg_perigee_deg, one.mean_anomaly_deg)
    raan, arg, mean = (math.radians(angle) for angle in angles)
    half = 0.5 * math.radians(one.inclination_deg)
    e, length, unit = one.eccentricity, math.tan(half), 2.0 * math.cos(half) ** 2 * a
    k, h = e * math.cos(arg + raan) + ex / a, e * math.sin(arg + raan) + ey / a
    x, y = length * math.cos(raan) + px / unit, length * math.sin(raan) + py / unit
    node, perigee = math.atan2(y, x), math.atan2(h, k)
    # Turned with the plane, an orbit keeps its places: what the node gains, the argument of latitude loses.
    longitude = mean + arg + raan + along / a
    return replace(
        one,
        inclination_deg=2.0 * math.degrees(math.atan(math.hypot(x, y))),
        raan_deg=math.degrees(node) % 360.0,
        eccentricity=math.hypot(k, h),
        arg_perigee_deg=math.degrees(perigee - node) % 360.0,
        mean_anomaly_deg=math.degrees(longitude - perigee) % 360.0,
        mean_motion_rev_day=one.mean_motion_rev_day * (1.0 + axis / a) ** -1.5,
    )


def _rebased(elements: Elements, epoch: Utc) -> Elements:
    """Return elements with another epoch of the same orbit about it.

    First the mean elements that SGP4 has then; what their drag and their lunisolar terms lack of the orbit
    over the sixth of a revolution about the epoch is then fitted away.
    """
    given = elements.satrec()
    given.sgp4(given.jdsatepoch, given.jdsatepochF)
    motion_at_first = given.nm
    code, _, _ = given.sgp4(*_jd(epoch))
    if code:
        raise propagation_error(code, elements, epoch)
    motion = elements.mean_motion_rev_day * given.nm / motion_at_first
    angles = (given.im, given.Om, given.om, given.mm)
    inclination, node, perigee, anomaly = (math.degrees(angle) for angle in angles)
    found = replace(
        elements,
        epoch=epoch,
        inclination_deg=inclination,
        raan_deg=node % 360.0,
        arg_perigee_deg=perigee % 360.0,
        mean_anomaly_deg=anomaly % 360.0,
        eccentricity=given.em,
        mean_motion_rev_day=motion,
    )
    part_s = _REBASE_PART * elements.period_s
    instants = [Utc(float(epoch.unix_s) + part_s * step / 3.0) for step in range(-3, 4)]
    wanted = np.concatenate([given.sgp4(*_jd(t))[1] for t in instants])
    for _ in range(_REBASE_STEPS):
        steps = [np.zeros(STATES), *(_STEP_KM * row for row in np.eye(STATES))]
        here, *moved = (
            np.concatenate([record.sgp4(*_jd(t))[1] for t in instants])
            for record in (_corrected(found, step).satrec() for step in steps)
        )
        by_state = np.stack([(there - here) / _STEP_KM for there in moved], axis=1)
        correction = np.linalg.lstsq(by_state, wanted - here, rcond=None)[0]
        found = _corrected(found, correction)
    return found

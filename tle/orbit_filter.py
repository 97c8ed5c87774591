"""Filters of an orbit's corrections, and of a mount's and its cameras' terms, fed by single sightings.

`OrbitFilter` is an iterated, extended Kalman filter. How far elements are off, and whether what was learnt
of mount and cameras at an earlier pass still holds, is not known beforehand: `FilterBank` runs filters that
expect different things beside one another, and answers with their mean, each by how well it predicts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.errors import PropagationError
from tle.orbit_fit import LONGEST_STEP_KM, STATES, Compared, Expected, Partials, compared, cross_product

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from tle.direction import Direction
    from tle.instants import Utc
    from tle.orbit_fit import CorrectableOrbit, Image, Sighting
    from tle.propagator import Propagator

    Array = NDArray[np.float64]

MOUNT = 6
"""Terms of the mount: a turn of its base (three), a delay, the telescope beside its axis, and a zero."""
CAMERA = 5
"""Terms of a camera: rotation and scale of its image, its clock, and where its middle points (two)."""
TURN_X, TURN_Y, TURN_Z, DELAY, CONE, INDEX = range(STATES, STATES + MOUNT)
ROTATION, SCALE, CLOCK, MIDDLE_X, MIDDLE_Y = range(CAMERA)
MOUNT_TERMS = ("turn_x_deg", "turn_y_deg", "turn_z_deg", "delay_s", "cone_deg", "index_deg")
CAMERA_TERMS = ("rotation_deg", "scale", "clock_s", "middle_x_deg", "middle_y_deg")
"""Their names, with their units for people; `terms` returns them so, and `KnownTerms` has them so."""
_MOUNT_UNITS, _CAMERA_UNITS = (
    np.array([math.radians(1.0) if name.endswith("_deg") else 1.0 for name in names])
    for names in (MOUNT_TERMS, CAMERA_TERMS)
)
EARTH_RAD_S = 7.2921159e-5
# One sigma of each: rad, but for the delay (s), the scale (a share) and the clock (s).
_TURN_RAD, _DELAY_S, _CONE_RAD = math.radians(0.1), 0.02, math.radians(0.03)
_SQUARE_RAD = math.radians(2.0 / 3600.0)
"""Of cone and index of a mount that was set up well, or whose pointing model is fed."""
_ROTATION_RAD, _SCALE, _CLOCK_S, _MIDDLE_RAD = math.radians(4.0), 0.02, 0.05, math.radians(0.5)
_TURN_WALK_RAD2_S = math.radians(0.05 / 3600.0) ** 2
"""How the turn of the base changes, as bending and worm gears make it."""
_LEAST_ALONG = 0.2
_RELINEARISE_KM = 5.0
_MOST_STEPS, _WHOLE_STEPS, _HALF_STEPS = 32, 4, 12
_SETTLED_KM, _SETTLED_SIGMAS, _SETTLED_PRIOR_SIGMAS = 1e-4, 0.02, 0.02
_WORST_SQUARE = 36.0
_FAR, _FAR_STEPS = 4.0, 3
"""A sighting that lies so many times beyond the gate, step after step, needs no further ones."""
_FORGETTING = 0.98
_BETTER = 3.0
_NO_SHARE = -5.0
"""A filter that is less likely than the best by that (logarithms) has no share in the answer."""


@dataclass(frozen=True, slots=True)
class KnownTerms:
    """What is known of a mount's terms and its cameras' before the first sighting: means and sigmas.

    Shapes (6,) and (5,), in the order and the units of `MOUNT_TERMS` and `CAMERA_TERMS`.
    """

    mount: tuple[Array, Array]
    cameras: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)


def usual_terms(square: bool = False) -> KnownTerms:
    """Return what is expected of an unknown mount; of a `square` one, that it has no cone and no index."""
    beside = _SQUARE_RAD if square else _CONE_RAD
    sigma = np.array([_TURN_RAD] * 3 + [_DELAY_S] + [beside] * 2)
    return KnownTerms((np.zeros(MOUNT), sigma / _MOUNT_UNITS))


class OrbitFilter:
    """An iterated, extended Kalman filter of the six corrections and, where cameras see, of their terms.

    The middle of a fine camera is where the target is centred: its own pointing is the mount's. A coarse one
    may look beside it.
    """

    def __init__(
        self,
        orbit: CorrectableOrbit,
        expected: Expected,
        noisier: float = 1.0,
        kicked: float = 1.0,
        terms: KnownTerms | None = None,
    ) -> None:
        """Begin with what is expected; `noisier` and `kicked` are factors of sigmas and accelerations."""
        self.orbit = orbit
        self._terms = terms or usual_terms()
        mean, sigma = (one * _MOUNT_UNITS for one in self._terms.mount)
        self._state = np.concatenate([expected.mean_km, mean])
        self._covariance = np.zeros((STATES + MOUNT, STATES + MOUNT))
        self._covariance[:STATES, :STATES] = expected.covariance_km2
        self._covariance[STATES:, STATES:] = np.diag(np.square(sigma))
        self._noisier, self._kicked = noisier, kicked
        self._last_utc_s: float | None = None
        self._partials = Partials(orbit, self.correction_km)
        self.cameras: tuple[str, ...] = ()
        self.last_distance: float | None = None
        """Squared distance of the last sighting that was taken."""
        self.accepted = 0
        self.rejected = 0

    @property
    def correction_km(self) -> Array:
        """The six corrections, km."""
        return self._state[:STATES]

    @property
    def covariance_km2(self) -> Array:
        """The covariance of the six corrections, km²."""
        return self._covariance[:STATES, :STATES]

    def copy(self) -> OrbitFilter:
        """Return a filter of the same state."""
        other = object.__new__(OrbitFilter)
        other.__dict__.update(self.__dict__)
        return other

    def terms(self, camera: str | None = None) -> tuple[Array, Array]:
        """Return the mount's terms, or a camera's that has been seen, and one sigma of each."""
        begin = STATES if camera is None else self._slot(camera)
        units = _MOUNT_UNITS if camera is None else _CAMERA_UNITS
        part = slice(begin, begin + len(units))
        return self._state[part] / units, np.sqrt(np.diag(self._covariance)[part]) / units

    def pointing(self, propagator: Propagator, t: Utc, mount: bool) -> tuple[Array, Array]:
        """Return where the satellite is seen at an instant, a unit vector, and its covariance, rad², (3, 3).

        With `mount` it is where the mount must point by its own idea, its errors made up for.
        """
        unit, pointed, by_mount, range_km = self._pointing(propagator, t, mount)
        by_state = propagator.of_date(t, self._partials.states(t)[:3]) / range_km
        by = np.hstack([by_state - np.outer(unit, unit @ by_state), by_mount])
        n = STATES + MOUNT
        spread: Array = by @ self._grown(t)[:n, :n] @ by.T
        return pointed, spread

    def direction(self, propagator: Propagator, t: Utc, mount: bool) -> Array:
        """Return the unit vector of `pointing` alone."""
        return self._pointing(propagator, t, mount)[1]

    def _pointing(self, propagator: Propagator, t: Utc, mount: bool) -> tuple[Array, Array, Array, float]:
        """Return where the satellite is seen, where to point, what the mount's terms do, and the range."""
        seen = propagator.with_elements(self.orbit.corrected(self.correction_km)).at(t)
        unit = seen.unit
        by_mount = mount_terms(seen, unit, seen.unit_rate) * float(mount)
        u = unit + by_mount @ self._state[STATES : STATES + MOUNT]
        return unit, u / math.sqrt(float(u @ u)), by_mount, float(seen.range_km)

    def distance(self, sighting: Sighting) -> float:
        """Return the squared Mahalanobis distance of a sighting from what is expected of it (two degrees)."""
        self._meet(sighting)
        solved = self._solve(sighting, self._grown(sighting.utc))
        return math.inf if solved is None else solved.distance

    def observe(self, sighting: Sighting, gate: float) -> bool:
        """Take a sighting in; tell whether it lay within the gate, a squared Mahalanobis distance.

        One that comes later than it was made counts as the other sightings do, with the growth since then
        added to its own uncertainty.
        """
        return self.weigh(sighting, gate)[0]

    def weigh(self, sighting: Sighting, gate: float) -> tuple[bool, float]:
        """Take a sighting in as `observe` does; return whether, and the logarithm of how likely it was."""
        self._meet(sighting)
        solved = self._solve(sighting, self._grown(sighting.utc), _FAR * max(gate, _WORST_SQUARE))
        if solved is None or not solved.distance <= gate:
            self.rejected += 1
            size = 2.0 * math.log(self._noisier * sighting.sigma_rad) if solved is None else solved.size
            worst = _WORST_SQUARE if solved is None else min(_WORST_SQUARE, solved.distance)
            return False, -0.5 * worst - size
        self._state, self._covariance, self._partials = solved.state, solved.covariance, solved.partials
        utc_s = float(sighting.utc.unix_s)
        self._last_utc_s = utc_s if self._last_utc_s is None else max(utc_s, self._last_utc_s)
        self.accepted += 1
        self.last_distance = solved.distance
        return True, -0.5 * solved.distance - solved.size

    def _meet(self, sighting: Sighting) -> None:
        """Have terms for the camera of a sighting."""
        image = sighting.image
        if image is None or image.camera in self.cameras:
            return
        middle = _MIDDLE_RAD if image.coarse else 0.0
        mean, sigma = np.zeros(CAMERA), np.array([_ROTATION_RAD, _SCALE, _CLOCK_S, middle, middle])
        if image.camera in self._terms.cameras:
            mean, sigma = (one * _CAMERA_UNITS for one in self._terms.cameras[image.camera])
        n = len(self._state)
        covariance = np.zeros((n + CAMERA, n + CAMERA))
        covariance[:n, :n] = self._covariance
        covariance[n:, n:] = np.diag(np.square(sigma))
        self._state, self._covariance = np.concatenate([self._state, mean]), covariance
        self.cameras = (*self.cameras, image.camera)

    def _slot(self, camera: str) -> int:
        return STATES + MOUNT + CAMERA * self.cameras.index(camera)

    def _grown(self, t: Utc) -> Array:
        """Return the covariance with the noise from the newest sighting to an instant, or back to it."""
        if self._last_utc_s is None:
            return self._covariance
        seconds = abs(float(t.unix_s) - self._last_utc_s)
        if seconds == 0.0:
            return self._covariance
        middle = t.plus(-0.5 * (float(t.unix_s) - self._last_utc_s))
        kick = np.linalg.inv(self._partials.states(middle))[:, 3:]
        grown: Array = self._covariance.copy()
        noise = (self._kicked * self._noisier) ** 2 * self.orbit.noise_km2_s3 * seconds
        grown[:STATES, :STATES] += noise * (kick @ kick.T)
        grown[TURN_X:DELAY, TURN_X:DELAY] += _TURN_WALK_RAD2_S * seconds * np.eye(3)
        return grown

    def _solve(self, sighting: Sighting, covariance: Array, far: float = math.inf) -> _Solved | None:
        """Return state, covariance and squared distance with a sighting; None where none leads there.

        Where whole steps leave it beyond `far`, a squared distance, only distance and size are of use.
        """
        prior, at, partials = self._state, self._state, self._partials
        noise = (self._noisier * sighting.sigma_rad) ** 2 * np.eye(2)
        sigmas = np.sqrt(np.diag(covariance)) + 1e-12
        beyond = 0
        for number in range(_MOST_STEPS):
            try:
                if float(np.abs(at[:STATES] - partials.at_km).max()) > _RELINEARISE_KM:
                    partials = Partials(self.orbit, at[:STATES])
                off, by_state, range_km = self._compared(sighting, at, partials)
            except PropagationError:
                return None
            by_spread = by_state @ covariance
            spread = by_spread @ by_state.T + noise
            gap = off + by_state @ (at - prior)
            (a, b), (c, d) = spread.tolist()
            determinant = a * d - b * c
            weight = np.array([[d, -b], [-c, a]]) / determinant
            gain = by_spread.T @ weight
            distance, size = float(gap @ weight @ gap), 0.5 * math.log(determinant)
            wanted = prior + gain @ gap
            step = wanted - at
            longest = float(np.abs(step[:STATES]).max())
            if longest > LONGEST_STEP_KM:
                step = step * (LONGEST_STEP_KM / longest)
            beyond = beyond + 1 if distance > far and longest <= LONGEST_STEP_KM else 0
            if beyond == _FAR_STEPS and number < _WHOLE_STEPS:
                return _Solved(prior, covariance, distance, size, partials)
            if number >= _WHOLE_STEPS and sighting.image is not None:
                step = (0.5 if number < _HALF_STEPS else 0.25) * step
            at = at + step
            if sighting.image is None:
                settled = longest < max(_SETTLED_KM, 0.5 * _SETTLED_SIGMAS * sighting.sigma_rad * range_km)
            else:
                # Along what is hardly known, steps need not end: there the expected sigma is the measure.
                moved = float(np.abs(by_state @ step).max()) / sighting.sigma_rad
                small = np.all(np.abs(step) <= _SETTLED_PRIOR_SIGMAS * sigmas)
                settled = moved < _SETTLED_SIGMAS and bool(small)
            if settled:
                kept = np.eye(len(at)) - gain @ by_state
                # Joseph's form keeps it symmetric and positive.
                left = kept @ covariance @ kept.T + gain @ noise @ gain.T
                return _Solved(at, 0.5 * (left + left.T), distance, size, partials)
        return None

    def _compared(self, sighting: Sighting, at: Array, partials: Partials) -> Compared:
        """Return how far a sighting lies from a state, by its track or by the image's axes."""
        image = sighting.image
        if image is None:
            plain = compared(self.orbit, sighting, at[:STATES], partials)
            nothing = np.zeros((2, len(at) - STATES))
            return plain._replace(by_state=np.hstack([plain.by_state, nothing]))
        propagator = sighting.propagator.with_elements(self.orbit.corrected(at[:STATES]))
        seen = propagator.at(sighting.utc)
        range_km, unit, rate = float(seen.range_km), seen.unit, seen.unit_rate
        by_orbit = propagator.of_date(sighting.utc, partials.states(sighting.utc)[:3]) / range_km
        by_mount = mount_terms(seen, unit, rate)
        slot = self._slot(image.camera)
        terms = at[slot : slot + CAMERA]
        drift = rate - image.fed_rate
        u = unit + by_mount @ at[STATES : STATES + MOUNT] - terms[CLOCK] * drift
        place, by_u, by_terms = _in_image(image, u, terms)
        by_terms[:, CLOCK] = by_u @ -drift
        by_state = np.zeros((2, len(at)))
        by_state[:, :STATES] = by_u @ by_orbit
        by_state[:, STATES : STATES + MOUNT] = by_u @ by_mount
        by_state[:, slot : slot + CAMERA] = by_terms
        return Compared(np.array([image.x, image.y]) - place, by_state, range_km)


class _Member(NamedTuple):
    """What a filter of a bank expects: `wider` errors of elements, `kicked` accelerations, the terms that
    are known, a telescope that is `square` to its axes; and how likely that is, a logarithm.
    """

    wider: float = 1.0
    kicked: float = 1.0
    weight: float = 0.0
    known: bool = False
    square: bool = False


_CURVED = 6.0
"""Where elements are off by kilometres, what early sightings say of them bends with the range; a filter
that has learnt it as a plane is surer than it may be. Accelerations so many times as large make up for it."""
_BY_CAMERA = (
    _Member(),
    _Member(square=True),
    _Member(wider=8.0, kicked=_CURVED, weight=-2.0),
    _Member(wider=8.0, kicked=_CURVED, weight=-2.0, square=True),
    _Member(wider=60.0, kicked=100.0, weight=-8.0),
)


class FilterBank:
    """Filters that expect different errors of the elements, beside one another; their mean answers.

    The one that predicts best decides what lies within the gate: what does not leaves the answer as it was.
    With terms that were learnt earlier there is one more, which expects those; it is the best at first.
    """

    def __init__(
        self,
        orbit: CorrectableOrbit,
        mean_km: Array | None = None,
        wider: float = 1.0,
        noisier: float = 1.0,
        known: KnownTerms | None = None,
        seen_by_camera: bool = False,
    ) -> None:
        """Begin about a correction, with `wider` times the usual errors of elements and `noisier` sigmas.

        What a camera sees is followed on any way (`seen_by_camera`); directions only as an orbit can be off:
        in a wrong frame they must not be believed.
        """
        self.orbit = orbit
        members: tuple[_Member, ...] = _BY_CAMERA if seen_by_camera else (_Member(),)
        if known is not None:
            members = (_Member(known=True), *(one._replace(weight=one.weight - 3.0) for one in members))
        self._kinds, self._members, self._weights = members, [], []
        for kind in members:
            expected = orbit.expected(wider * kind.wider)
            if mean_km is not None:
                expected = Expected(mean_km, expected.covariance_km2)
            terms = known if kind.known else usual_terms(kind.square)
            self._members.append(OrbitFilter(orbit, expected, noisier, kind.kicked, terms))
            self._weights.append(kind.weight)
        self._best = 0
        self._answering = self._shares()
        self.knows_terms = known is not None
        self.accepted = self.rejected = 0

    @property
    def best(self) -> OrbitFilter:
        """The filter that predicts best."""
        return self._members[self._best]

    @property
    def correction_km(self) -> Array:
        """The six corrections, km."""
        shares, filters = self._answering
        return _mean([one.correction_km for one in filters], shares)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras whose sightings are in the answer."""
        return self._answering[1][0].cameras

    @property
    def uses_known_terms(self) -> bool:
        """Whether the terms that were known beforehand predict what is seen."""
        return self._kinds[self._best].known

    def copy(self) -> FilterBank:
        """Return a bank of the same state."""
        other = object.__new__(FilterBank)
        other.__dict__.update(self.__dict__)
        other._members = [one.copy() for one in self._members]
        return other

    def pointing(self, propagator: Propagator, t: Utc, mount: bool) -> tuple[Array, Array]:
        """See OrbitFilter; how far the filters are apart is in the covariance."""
        shares, filters = self._answering
        units, spreads = zip(*(one.pointing(propagator, t, mount) for one in filters), strict=True)
        middle = _unit(_mean(units, shares))
        apart = [spread + np.outer(u - middle, u - middle) for u, spread in zip(units, spreads, strict=True)]
        return middle, _mean(apart, shares)

    def direction(self, propagator: Propagator, t: Utc, mount: bool) -> Array:
        """See OrbitFilter."""
        shares, filters = self._answering
        return _unit(_mean([one.direction(propagator, t, mount) for one in filters], shares))

    def terms(self, camera: str | None = None) -> tuple[Array, Array]:
        """See OrbitFilter; how far the filters are apart is in the sigmas."""
        shares, filters = self._answering
        values, sigmas = zip(*(one.terms(camera) for one in filters), strict=True)
        middle = _mean(values, shares)
        apart = [np.hypot(sigma, value - middle) for value, sigma in zip(values, sigmas, strict=True)]
        return middle, np.sqrt(_mean(np.square(apart), shares))

    def _shares(self) -> tuple[Array, list[OrbitFilter]]:
        """Return how likely each filter is, of 1, and copies of those that have a share."""
        most = self._weights[self._best]
        alike = [
            (weight - most, one)
            for weight, one in zip(self._weights, self._members, strict=True)
            if weight - most >= _NO_SHARE
        ]
        shares = np.exp([weight for weight, _ in alike])
        return shares / shares.sum(), [one.copy() for _, one in alike]

    def distance(self, sighting: Sighting) -> float:
        """Return the squared distance of a sighting; before the first, from where the usual errors lead."""
        if self.accepted:
            return self.best.distance(sighting)
        return min(
            one.distance(sighting)
            for one, kind in zip(self._members, self._kinds, strict=True)
            if kind.wider == 1.0
        )

    def observe(self, sighting: Sighting, gate: float) -> bool:
        """Take a sighting in; tell whether it lay within the gate of the best filter."""
        found = [one.weigh(sighting, gate) for one in self._members]
        self._weights = [
            _FORGETTING * weight + likely for weight, (_, likely) in zip(self._weights, found, strict=True)
        ]
        most = max(self._weights)
        likeliest = self._weights.index(most)
        # What no filter takes is noise: it changes no answer.
        another = self._weights[self._best] < most - _BETTER and found[likeliest][0]
        if another:
            self._best = likeliest
        taken = found[self._best][0]
        if taken or another:
            self._answering = self._shares()
        self.accepted += taken
        self.rejected += not taken
        return taken


def _mean(values: Sequence[Array] | Array, shares: Array) -> Array:
    mean: Array = np.average(values, axis=0, weights=shares)
    return mean


def _unit(vector: Array) -> Array:
    return vector / math.sqrt(float(vector @ vector))


class _Solved(NamedTuple):
    """What a sighting makes of the state: state, covariance, squared distance, half the logarithm of the
    spread's determinant, and partials near it."""

    state: Array
    covariance: Array
    distance: float
    size: float
    partials: Partials


def _in_image(image: Image, u: Array, terms: Array) -> tuple[Array, Array, Array]:
    """Return where a direction is in an image of such terms, (2,), what that is by direction and by terms."""
    axes = np.array([image.right, image.up])
    along = float(u @ image.fed)
    if along < _LEAST_ALONG * math.sqrt(float(u @ u)):
        raise PropagationError("what was seen lies behind the camera", 0)
    flat = axes @ u / along
    # Position angles grow from north to east: to the left of up, or, in a mirrored image, to the right.
    sense = 1.0 if float(cross_product(image.right, image.up) @ image.fed) < 0.0 else -1.0
    angle, scale = sense * float(terms[ROTATION]), 1.0 + float(terms[SCALE])
    c, s = math.cos(angle) / scale, math.sin(angle) / scale
    turn = np.array([[c, s], [-s, c]])
    turned = turn @ flat
    by_u = turn @ (axes - np.outer(flat, image.fed)) / along
    by_terms = np.zeros((2, CAMERA))
    by_terms[:, ROTATION] = sense * turned[1], -sense * turned[0]
    by_terms[:, SCALE] = -turned / scale
    by_terms[:, MIDDLE_X:] = np.eye(2)
    return turned + terms[MIDDLE_X:], by_u, by_terms


def mount_terms(seen: Direction, u: Array, rate: Array) -> Array:
    """Return how a direction's unit vector `u`, of that `rate`, is moved by the mount's terms, shape (3, 6).

    Three turns about axes fixed to the Earth, rad: in the equator towards the meridian and 90° from it, and
    the pole; a second by which the mount is ahead; then on the sky along right ascension and declination.
    """
    meridian = math.radians(float(seen.ra_deg) + float(seen.ha_deg))
    c, s = math.cos(meridian), math.sin(meridian)
    x, y, z = u.tolist()
    flat = max(1e-6, math.hypot(x, y))
    east = -y / flat, x / flat, 0.0
    north = -z * east[1], z * east[0], flat
    vx, vy, vz = rate.tolist()
    pace = vx + EARTH_RAD_S * y, vy - EARTH_RAD_S * x, vz
    # The columns are cross products of the axes (c, s, 0), (s, -c, 0) and (0, 0, 1) with u.
    turns = (s * z, -c * z, c * y - s * x), (-c * z, -s * z, s * y + c * x), (-y, x, 0.0)
    return np.array([*turns, pace, east, north]).T

"""A satellite whose orbit is integrated step by step, and the elements that a catalogue gives it.

Forces: the Earth's field to degree and order 4 (EGM96), the Sun's, and drag in an exponential atmosphere
whose density swings and drifts. Frame: TEME, taken as inertial. The elements are SGP4's, fitted as a
catalogue does to the positions of the last days before their epoch, their drag with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tle.earth import EarthOrientation
from tle.instants import DAY_S, UNIX_EPOCH_JD, Utc
from tle.orbit_fit import STATES, CorrectableOrbit
from tle.propagator import Propagator
from tle.sun import sun_km

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import Elements
    from tle.refraction import Refraction
    from tle.site import Site

    Array = NDArray[np.float64]

MU, RADIUS_KM, SUN_MU = 398600.4415, 6378.1363, 1.32712440018e11
EARTH_RAD_S = 7.2921159e-5
DEGREE = 4
# EGM96, fully normalised: degree, order, C, S.
FIELD = (
    (2, 0, -4.84165371736e-4, 0.0),
    (2, 1, -1.86987635955e-10, 1.19528012031e-9),
    (2, 2, 2.43914352398e-6, -1.40016683654e-6),
    (3, 0, 9.57254173792e-7, 0.0),
    (3, 1, 2.02998882184e-6, 2.48513158716e-7),
    (3, 2, 9.04627768605e-7, -6.19025944205e-7),
    (3, 3, 7.21072657057e-7, 1.41435626958e-6),
    (4, 0, 5.39873863789e-7, 0.0),
    (4, 1, -5.36321616971e-7, -4.73440265853e-7),
    (4, 2, 3.50694105785e-7, 6.62671572540e-7),
    (4, 3, 9.90771803829e-7, -2.00928369177e-7),
    (4, 4, -1.88560802735e-7, 3.08853169333e-7),
)
GRID_S = 10.0
FITTED_DAYS = 2.0
FITTED_EVERY_S = 600.0


@dataclass(frozen=True)
class Air:
    """Drag: the ballistic coefficient Cd·A/m and what the density does, m²/kg and shares."""

    ballistic_m2_kg: float = 0.01
    swing: float = 0.3
    swing_days: float = 1.1
    phase: float = 0.0
    drift_a_day: float = 0.03

    def acceleration_km_s2(self, r: Array, v: Array, days: float) -> Array:
        """Return the drag at a place and speed (TEME, km, km/s), so many days after the beginning."""
        height_km = float(np.linalg.norm(r)) - RADIUS_KM
        density = 4e-12 * math.exp(-(height_km - 400.0) / 60.0)
        density *= 1.0 + self.swing * math.sin(2.0 * math.pi * days / self.swing_days + self.phase)
        density *= max(0.2, 1.0 + self.drift_a_day * days)
        wind = v - EARTH_RAD_S * np.array([-r[1], r[0], 0.0])
        # m² to km², kg/m³ to kg/km³, half of the product: 500.
        return -500.0 * density * self.ballistic_m2_kg * float(np.linalg.norm(wind)) * 1000.0 * wind / 1000.0


class IntegratedMotion:
    """The orbit over a span, as `tle.propagator` asks for it: TEME, km, at an instant."""

    def __init__(
        self, elements: Elements, first_s: float, last_s: float, air: Air, state: Array | None = None
    ) -> None:
        """Begin where SGP4 has the satellite at `first_s` (POSIX seconds of UTC), or with a state."""
        self.elements, self._first_s = elements, first_s
        self._earth, self._air = EarthOrientation.installed(), air
        _, r, v = elements.satrec().sgp4(*julian(first_s))
        begin = np.array([*r, *v]) if state is None else state
        from scipy.integrate import DOP853

        solver = DOP853(self._slope, 0.0, begin, last_s - first_s, rtol=1e-11, atol=1e-9)
        grid, states = np.arange(0.0, last_s - first_s, GRID_S), []
        at = 0
        while at < len(grid) and solver.status == "running":
            solver.step()
            piece = solver.dense_output()
            until = int(np.searchsorted(grid, solver.t, "right"))
            states.append(piece(grid[at:until]).T)
            at = until
        self._states = np.concatenate(states)

    def state_before(self, state: Array, from_s: float, to_s: float) -> Array:
        """Return the state at an earlier instant that leads to a state at `from_s`."""
        from scipy.integrate import DOP853

        solver = DOP853(
            self._slope, from_s - self._first_s, state, to_s - self._first_s, rtol=1e-11, atol=1e-9
        )
        while solver.status == "running":
            solver.step()
        return solver.y

    def at(self, unix_s: float, later_s: float) -> tuple[float, ...]:
        """Return position, velocity and acceleration at an instant plus `later_s`, and 0: no error."""
        since = unix_s + later_s - self._first_s
        i = min(len(self._states) - 2, max(0, int(since // GRID_S)))
        y = self._hermite(i, (since - i * GRID_S) / GRID_S)
        gravity = self._slope(since, y)[3:]
        return (*map(float, y), *map(float, gravity), 0)

    def _hermite(self, i: int, u: float) -> Array:
        a, b = self._states[i], self._states[i + 1]
        aa, bb = self._gravity(i), self._gravity(i + 1)
        h = GRID_S
        c0, c1, c2 = a[:3], a[3:] * h, 0.5 * aa * h * h
        way, v1, a1 = b[:3] - c0 - c1 - c2, b[3:] * h - c1 - 2.0 * c2, bb * h * h - 2.0 * c2
        c3, c4, c5 = (
            10.0 * way - 4.0 * v1 + 0.5 * a1,
            -15.0 * way + 7.0 * v1 - a1,
            6.0 * way - 3.0 * v1 + 0.5 * a1,
        )
        r = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        v = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / h
        return np.concatenate([r, v])

    def _gravity(self, i: int) -> Array:
        # Nearly all that is asked for lies between the same two rows as what was asked for before.
        known = self.__dict__.setdefault("_gravities", {})
        if i not in known:
            known[i] = self._slope(i * GRID_S, self._states[i])[3:]
        return known[i]

    def _slope(self, since: float, y: Array) -> Array:
        r, v = y[:3], y[3:]
        utc_s = self._first_s + since
        theta = self._theta(utc_s)
        c, s = math.cos(theta), math.sin(theta)
        turned = np.array([r[0] * c + r[1] * s, r[1] * c - r[0] * s, r[2]])
        fx, fy, fz = field_km_s2(turned)
        pull = np.array([fx * c - fy * s, fx * s + fy * c, fz])
        sun = self._sun(utc_s)
        away = sun - r
        tide = SUN_MU * (away / np.linalg.norm(away) ** 3 - sun / np.linalg.norm(sun) ** 3)
        return np.concatenate([v, pull + tide + self._air.acceleration_km_s2(r, v, since / DAY_S)])

    def _theta(self, utc_s: float) -> float:
        # The Earth turns evenly between two looks at its table, a day apart.
        day = math.floor(utc_s / DAY_S)
        known = self.__dict__.setdefault("_thetas", {})
        if day not in known:
            begin, spin = self._earth.rotation(day * DAY_S)[:2]
            known[day] = float(begin), float(spin)
        begin, spin = known[day]
        return begin + spin * (utc_s - day * DAY_S)

    def _sun(self, utc_s: float) -> Array:
        hour = math.floor(utc_s / 3600.0)
        known = self.__dict__.setdefault("_suns", {})
        if hour not in known:
            known[hour] = np.asarray(sun_km(Utc((hour + 0.5) * 3600.0)), dtype=np.float64).reshape(3)
        return known[hour]


def field_km_s2(r: Array) -> tuple[float, float, float]:
    """Return the Earth's pull at a place fixed to it, km, by the recursion of Cunningham (1970)."""
    x, y, z = (float(value) for value in r)
    square = x * x + y * y + z * z
    rho = RADIUS_KM * RADIUS_KM / square
    x0, y0, z0 = RADIUS_KM * x / square, RADIUS_KM * y / square, RADIUS_KM * z / square
    size = DEGREE + 2
    v = [[0.0] * size for _ in range(size)]
    w = [[0.0] * size for _ in range(size)]
    v[0][0] = RADIUS_KM / math.sqrt(square)
    for m in range(size):
        if m:
            v[m][m] = (2 * m - 1) * (x0 * v[m - 1][m - 1] - y0 * w[m - 1][m - 1])
            w[m][m] = (2 * m - 1) * (x0 * w[m - 1][m - 1] + y0 * v[m - 1][m - 1])
        for n in range(m + 1, size):
            v[n][m] = (2 * n - 1) / (n - m) * z0 * v[n - 1][m]
            w[n][m] = (2 * n - 1) / (n - m) * z0 * w[n - 1][m]
            if n > m + 1:
                v[n][m] -= (n + m - 1) / (n - m) * rho * v[n - 2][m]
                w[n][m] -= (n + m - 1) / (n - m) * rho * w[n - 2][m]
    ax, ay, az = -v[1][1], -w[1][1], -v[1][0]
    for n, m, c, s in _UNNORMALISED:
        if m == 0:
            ax -= c * v[n + 1][1]
            ay -= c * w[n + 1][1]
        else:
            share = 0.5 * (n - m + 1) * (n - m + 2)
            ax += 0.5 * (-c * v[n + 1][m + 1] - s * w[n + 1][m + 1])
            ax += share * (c * v[n + 1][m - 1] + s * w[n + 1][m - 1])
            ay += 0.5 * (-c * w[n + 1][m + 1] + s * v[n + 1][m + 1])
            ay += share * (-c * w[n + 1][m - 1] + s * v[n + 1][m - 1])
        az += (n - m + 1) * (-c * v[n + 1][m] - s * w[n + 1][m])
    unit = MU / RADIUS_KM**2
    return unit * ax, unit * ay, unit * az


def _factor(n: int, m: int) -> float:
    return math.sqrt((1 if m == 0 else 2) * (2 * n + 1) * math.factorial(n - m) / math.factorial(n + m))


_UNNORMALISED = [(n, m, c * _factor(n, m), s * _factor(n, m)) for n, m, c, s in FIELD]


def julian(unix_s: float) -> tuple[float, float]:
    """Return an instant as a whole Julian date and a fraction."""
    days, second = divmod(unix_s, DAY_S)
    return days + UNIX_EPOCH_JD, second / DAY_S


def catalogued(
    elements: Elements, motion: IntegratedMotion, epoch_s: float, noise_km: float = 0.3
) -> Elements:
    """Return elements fitted to the orbit's last FITTED_DAYS before an epoch, with noise of tracking."""
    rng = np.random.default_rng(1)
    instants = np.arange(epoch_s - FITTED_DAYS * DAY_S, epoch_s, FITTED_EVERY_S)
    wanted = np.array([motion.at(float(t), 0.0)[:3] for t in instants])
    wanted = wanted + rng.normal(0.0, noise_km, wanted.shape)
    found = elements
    for _ in range(8):
        orbit = CorrectableOrbit(found, Utc(epoch_s))
        steps = [np.zeros(STATES), *(0.5 * np.eye(STATES))]
        trials = [orbit.corrected(step) for step in steps]
        trials.append(replace(trials[0], bstar_per_earth_radius=found.bstar_per_earth_radius + 1e-5))
        here, *moved = (
            np.array([one.satrec().sgp4(*julian(float(t)))[1] for t in instants]).ravel() for one in trials
        )
        by = np.stack([*((there - here) / 0.5 for there in moved[:-1]), (moved[-1] - here) / 1e-5], axis=1)
        change = np.linalg.lstsq(by * [1, 1, 1, 1, 1, 1, 1e-5], wanted.ravel() - here, rcond=None)[0]
        fitted = orbit.corrected(change[:STATES])
        found = replace(
            fitted, bstar_per_earth_radius=found.bstar_per_earth_radius + 1e-5 * float(change[STATES])
        )
    return found


def true_propagator(motion: IntegratedMotion, site: Site, refraction: Refraction | None = None) -> Propagator:
    """Return a propagator of the integrated orbit, for one instant at a time."""
    seen = Propagator(motion.elements, site, refraction=refraction)
    return follow(seen, motion)


def follow(seen: Propagator, motion: IntegratedMotion) -> Propagator:
    """Have a propagator, or one made of it by `with_place`, take places from the integrated orbit."""
    if not hasattr(seen, "_states"):
        raise AttributeError("a propagator keeps what tells its places elsewhere: nothing would be hidden")
    seen._states = motion  # type: ignore[assignment] # a propagator asks for no more, for one instant
    return seen

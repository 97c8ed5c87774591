"""By how much a camera's clock is off: fields solved among the stars, against the mount's own statuses. Pure.

Directions of one satellite cannot tell a camera that is late from elements that are early. The stars can: a
solved field says where the telescope pointed at the camera's date, the statuses where it pointed at ours. The
difference is what the mount points wrong, which changes slowly, and the clock's error times the mount's rate,
which changes over a pass. Least squares part the two. A status that is dated wrongly looks like the camera's
clock: how well the statuses' delay is known limits the result.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sattrack.views.run import ClockView
from tle.earth import ARCSEC
from tle.instants import Utc
from tle.observed import apparent_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.target import Course
    from sattrack.mount.model import MountProfile
    from sattrack.views.messages import SolvedField

    Array = NDArray[np.float64]

CLOCK = 0
TERMS = 6
"""The clock, a turn of the mount's base (three), a telescope beside its axis, and a zero of declination."""
BEFORE = np.array([5.0, *np.radians([0.3] * 3), *np.radians([0.1] * 2)])
"""One sigma of each before the first field: seconds, then rad."""
POINTING_ARCSEC = 3.0
"""How well a single status says where the telescope points, beside slow errors."""
DELAY_S, MEASURED_DELAY_S = 0.02, 0.002
"""How well the delay of statuses is known, one sigma: by a usual profile, by a measured one."""
HALF_S = 0.2
"""Rates of the mount are taken over twice that."""
REMEMBERED = 400
"""Statuses, of twenty a second."""
MOST_WAITING = 50
FEWEST = 4
SURE_SIGMAS, LEAST_S, SURE_S = 4.0, 0.03, 0.1
"""A clock is corrected where it is off by that many sigmas and seconds, and known that well."""
AGAIN_SIGMAS = 3.0
"""Of the new value: how far it goes from the one with which the estimate began before another begins."""
GATE_ARCSEC, GATE_SIGMAS = 60.0, 6.0
"""A field that lies further from what the others say counts as solved wrongly."""


@dataclass(slots=True)
class _Clock:
    """What the fields of one camera say, as normal equations."""

    information: Array = field(default_factory=lambda: np.diag(BEFORE**-2.0))
    vector: Array = field(default_factory=lambda: np.zeros(TERMS))
    frames: int = 0
    left_out: int = 0
    applied_s: float = 0.0
    begun_s: float = 0.0
    """What was corrected when the estimate began with it."""

    def solved(self) -> tuple[Array, Array]:
        """Return the terms and their covariance."""
        spread = np.asarray(np.linalg.inv(self.information), dtype=np.float64)
        return spread @ self.vector, spread

    def take(self, rows: Array, off: Array, sigma: float) -> bool:
        """Take one field, tell whether it fits: how it depends on the terms (2, TERMS), and what was seen."""
        terms, spread = self.solved()
        away = off - rows @ terms
        expected = rows @ spread @ rows.T + sigma**2 * np.eye(2)
        far = float(away @ np.linalg.solve(expected, away)) > GATE_SIGMAS**2
        if self.frames >= FEWEST and far and math.hypot(*away) > GATE_ARCSEC * ARCSEC:
            self.left_out += 1
            return False
        self.information = self.information + rows.T @ rows / sigma**2
        self.vector = self.vector + rows.T @ off / sigma**2
        self.frames += 1
        return True


class CameraClocks:
    """The clocks of a run's cameras, from the fields that they solve while the mount follows."""

    def __init__(self, profile: MountProfile) -> None:
        self._delay_s = DELAY_S if profile.calibration is None else MEASURED_DELAY_S
        self._statuses: deque[tuple[float, float, float]] = deque(maxlen=REMEMBERED)
        self.waiting: deque[SolvedField] = deque(maxlen=MOST_WAITING)
        """Fields whose statuses have not come yet."""
        self._clocks: dict[str, _Clock] = {}

    def note(self, utc_s: float, ra_deg: float, dec_deg: float) -> None:
        """Remember where the mount pointed at an instant, by its status: of date."""
        if not self._statuses or utc_s > self._statuses[-1][0]:
            self._statuses.append((utc_s, ra_deg, dec_deg))

    def hear(self, seen: SolvedField) -> None:
        """Keep a field until the statuses about its date have come."""
        self.waiting.append(seen)

    def correction_s(self, camera: str | None) -> float:
        """Return by how much a camera's dates are late: what must be taken off them."""
        clock = self._clocks.get(camera or "")
        return 0.0 if clock is None else clock.applied_s

    def watch(self, course: Course) -> bool:
        """Use the fields whose statuses have come; tell whether a correction has changed by much."""
        changed = False
        for _ in range(len(self.waiting)):
            seen = self.waiting.popleft()
            utc_s = float(Utc.parse(seen.utc).unix_s)
            if not self._statuses or utc_s + HALF_S > self._statuses[-1][0]:
                self.waiting.append(seen)
            elif utc_s - HALF_S >= self._statuses[0][0]:
                changed |= self._use(seen, utc_s, course)
        return changed

    def views(self) -> tuple[ClockView, ...]:
        """Return what is known of each camera's clock."""
        found = []
        for name, clock in self._clocks.items():
            clock_s, sigma_s = self._read(clock)
            found.append(ClockView(name, clock_s, sigma_s, clock.frames, clock.applied_s))
        return tuple(found)

    def _use(self, seen: SolvedField, utc_s: float, course: Course) -> bool:
        """Take one field in; tell whether the correction of its camera has changed by much."""
        clock = self._clocks.setdefault(seen.camera or "", _Clock())
        m, rate = self._pointing(utc_s)
        t = Utc(utc_s)
        fed, airless = course.propagator.at(t), course.airless.at(t)
        unit = apparent_unit(
            seen.ra_deg, seen.dec_deg, t, "icrf", course.propagator.site, course.propagator.earth
        )
        # The air raises the field as it raises the satellite in it.
        there = unit + fed.unit - airless.unit
        sidereal = math.radians(float(fed.ra_deg) + float(fed.ha_deg))
        east = np.array([-m[1], m[0], 0.0]) / math.hypot(m[0], m[1])
        axes = np.stack([east, np.cross(m, east)])
        c, s = math.cos(sidereal), math.sin(sidereal)
        turns = [np.cross(axis, m) for axis in ((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0))]
        rows = axes @ np.stack([-rate, *turns, *axes], axis=1)
        sigma = math.hypot(seen.sigma_arcsec, POINTING_ARCSEC) * ARCSEC
        clock.take(rows, axes @ (there - m), sigma)
        return self._apply(clock)

    def _apply(self, clock: _Clock) -> bool:
        clock_s, sigma_s = self._read(clock)
        sure = clock.frames >= FEWEST and sigma_s < SURE_S
        if not (sure and (clock.applied_s or abs(clock_s) > max(LEAST_S, SURE_SIGMAS * sigma_s))):
            return False
        clock.applied_s = clock_s
        if abs(clock_s - clock.begun_s) <= max(LEAST_S, AGAIN_SIGMAS * sigma_s):
            return False
        clock.begun_s = clock_s
        return True

    def _read(self, clock: _Clock) -> tuple[float, float]:
        """Return a clock's error and its sigma, seconds."""
        terms, spread = clock.solved()
        return float(terms[CLOCK]), math.hypot(math.sqrt(float(spread[CLOCK, CLOCK])), self._delay_s)

    def _pointing(self, utc_s: float) -> tuple[Array, Array]:
        """Return where the mount pointed at an instant (a unit vector), and how it moved, rad/s."""
        sooner, here, later = (self._at(utc_s + k * HALF_S) for k in (-1.0, 0.0, 1.0))
        return here, (later - sooner) / (2.0 * HALF_S)

    def _at(self, utc_s: float) -> Array:
        """Return the direction at an instant, by a parabola through the three statuses about it."""
        after = bisect_left(self._statuses, utc_s, key=lambda one: one[0])
        first = max(0, min(len(self._statuses) - 3, after - 1))
        times, units = [], []
        for at_s, ra_deg, dec_deg in (self._statuses[k] for k in range(first, first + 3)):
            ra, dec = math.radians(ra_deg), math.radians(dec_deg)
            times.append(at_s - utc_s)
            units.append(
                np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
            )
        found = np.zeros(3)
        for k, unit in enumerate(units):
            others = [times[j] for j in range(3) if j != k]
            found = found + unit * (others[0] * others[1]) / math.prod(times[k] - one for one in others)
        return found / math.sqrt(float(found @ found))

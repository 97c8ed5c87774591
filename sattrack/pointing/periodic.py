"""Errors of an axis that repeat in its turn: what the axis must report to stand at an angle. Pure.

A gear or an encoder errs by a function of its angle, here a sum of waves. A wave that an axis goes through
faster than a servo follows is left out, little by little: fed, it would come late and make things worse.

Whether a table still holds, a camera shows during a pass: the satellite of a mount whose table is right does
not move with the axes' angles. A wave that is half a wave beside the true one shows as twice its size, less
what the camera's corrections hide meanwhile. `TableJudge` looks for that.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.pointing.terms import axes_moved

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import PeriodicErrors, PointingTerms, Wave

TURNED_DEG = 30.0
"""By so much of its own turn a wave may be beside the true one; farther, it takes away less than half."""
SLOW_HZ = 3.0
"""A wave that comes so often a second is fed by half."""
ROUNDS = 3
BESIDE_DEG = 8.0
"""Beside the angles that passes have covered, a table fades out over so much."""
JUMPS = 3.0
"""An offset that jumps by so many times all waves together is not their doing."""
BEFORE_S, LEAST_BEFORE = 20.0, 5
"""An offset is compared with the mean of those of so many seconds before, where there are so many."""
CORRECTED_HZ = 0.05
"""Of a wave that comes so often a second, the camera's corrections leave 0.7 times; of slower ones less."""
FADES = 0.993
"""What an offset says counts by so much less with each one after it: the first ones are of the way there."""
HARMS_SHARE, SURE_SIGMAS, LEAST_SEEN = 0.5, 4.0, 60.0
"""A table is left aside where the satellite moves with so much of a wave, so surely, in so many offsets."""


class AxisStand(NamedTuple):
    """Angles of both axes, degrees, and their rates, degrees a second."""

    first_deg: float
    second_deg: float
    first_rate_deg_s: float = 0.0
    second_rate_deg_s: float = 0.0


def past_pole(stand: AxisStand, north: bool) -> AxisStand:
    """Return a direction as angles of an equatorial mount's axes past the elevated pole, or the reverse."""
    pole = 180.0 if north else -180.0
    return AxisStand(
        stand.first_deg + 180.0, pole - stand.second_deg, stand.first_rate_deg_s, -stand.second_rate_deg_s
    )


class PeriodicTable:
    """The errors of both axes of one mount."""

    def __init__(self, errors: PeriodicErrors) -> None:
        self._axes = tuple(
            tuple((wave.cycles, wave.sin_arcsec / 3600.0, wave.cos_arcsec / 3600.0) for wave in waves)
            for waves in (errors.first, errors.second)
        )
        self._seen = errors.first_seen_deg, errors.second_seen_deg

    def error_deg(self, stand: AxisStand) -> tuple[float, float]:
        """Return by how much the axes stand past the angles that they report, degrees."""
        first, _ = self._error(0, stand.first_deg, stand.first_rate_deg_s)
        second, _ = self._error(1, stand.second_deg, stand.second_rate_deg_s)
        return first, second

    def reported(self, stand: AxisStand) -> AxisStand:
        """Return what the axes report, and how fast that changes, where they stand at angles."""
        first, first_rate = self._reported(0, stand.first_deg, stand.first_rate_deg_s)
        second, second_rate = self._reported(1, stand.second_deg, stand.second_rate_deg_s)
        return AxisStand(first, second, first_rate, second_rate)

    def _reported(self, axis: int, angle_deg: float, rate_deg_s: float) -> tuple[float, float]:
        reported, slope = angle_deg, 0.0
        for _ in range(ROUNDS):
            error, slope = self._error(axis, reported, rate_deg_s)
            reported = angle_deg - error
        return reported, rate_deg_s / (1.0 + slope)

    def _error(self, axis: int, angle_deg: float, rate_deg_s: float) -> tuple[float, float]:
        """Return the error at an angle that is reported, and what it gains a degree."""
        angle, error, slope = math.radians(angle_deg), 0.0, 0.0
        for cycles, sine, cosine in self._axes[axis]:
            share = 1.0 / (1.0 + (cycles * rate_deg_s / (360.0 * SLOW_HZ)) ** 4)
            s, c = math.sin(cycles * angle), math.cos(cycles * angle)
            error += share * (sine * s + cosine * c)
            slope += share * math.radians(cycles) * (sine * c - cosine * s)
        known, gain = _known(self._seen[axis], angle_deg)
        return known * error, known * slope + gain * error


def _known(spans: tuple[tuple[float, float], ...], angle_deg: float) -> tuple[float, float]:
    """Return the share of a table that is fed at an angle, and what it gains a degree.

    1 within the spans, falling to 0 as a cosine over BESIDE_DEG beside them.
    """
    beside, sense = BESIDE_DEG, 0.0
    for low, high in spans:
        after = (angle_deg - low) % 360.0
        if after <= high - low:
            return 1.0, 0.0
        before = 360.0 - after
        after -= high - low
        if min(after, before) < beside:
            beside, sense = min((after, 1.0), (before, -1.0))
    turn = math.pi * beside / BESIDE_DEG
    return 0.5 * (1.0 + math.cos(turn)), -sense * 0.5 * math.pi / BESIDE_DEG * math.sin(turn)


class TableJudge:
    """Tells whether a table does harm, by offsets of a camera whose corrections the run feeds."""

    def __init__(self, errors: PeriodicErrors) -> None:
        self._sums = tuple(_AxisSums(waves) for waves in (errors.first, errors.second))
        self._most_arcsec = JUMPS * sum(wave.size_arcsec for wave in (*errors.first, *errors.second))

    def take(self, utc_s: float, seen: tuple[float, float], stand: AxisStand, level: float) -> None:
        """Take where the satellite was seen, arcseconds on the sky towards growing angles of the axes.

        `stand` is what the axes reported then, `level` what an angle of the first axis is worth on the sky.
        """
        angles, rates = stand[:2], stand[2:]
        for sums, off, angle, rate, worth in zip(self._sums, seen, angles, rates, (level, 1.0), strict=True):
            sums.take(utc_s, off, angle, rate, worth, self._most_arcsec)

    @property
    def harms(self) -> bool:
        """Whether a wave of the table surely makes more of an error than it takes away."""
        return any(sums.harms for sums in self._sums)


class _AxisSums:
    """How the satellite moves with each wave of one axis: normal equations, and how many offsets are in."""

    def __init__(self, waves: tuple[Wave, ...]) -> None:
        self._cycles = np.array([wave.cycles for wave in waves], dtype=np.float64)
        self._sizes = np.array([wave.size_arcsec for wave in waves])
        count = 2 * len(waves)
        self._normal, self._pull, self._square = np.zeros((count, count)), np.zeros(count), 0.0
        self._rates = self._count = 0.0
        self._last: deque[tuple[float, NDArray[np.float64]]] = deque()

    def take(
        self, utc_s: float, off: float, angle_deg: float, rate_deg_s: float, worth: float, most: float
    ) -> None:
        """Take an offset along this axis, compared with the mean of those before it."""
        if not len(self._cycles):
            return
        angles = np.radians(angle_deg) * self._cycles
        row = np.array([off, *(worth * np.sin(angles)), *(worth * np.cos(angles))])
        while self._last and not 0.0 < utc_s - self._last[0][0] <= BEFORE_S:
            self._last.popleft()
        if len(self._last) >= LEAST_BEFORE:
            moved = row - np.mean([one for _, one in self._last], axis=0)
            if abs(moved[0]) < most:
                self._normal = FADES * self._normal + np.outer(moved[1:], moved[1:])
                self._pull = FADES * self._pull + moved[0] * moved[1:]
                self._square = FADES * self._square + float(moved[0]) ** 2
                self._rates = FADES * self._rates + abs(rate_deg_s)
                self._count = FADES * self._count + 1.0
        self._last.append((utc_s, row))

    @property
    def harms(self) -> bool:
        """See TableJudge."""
        count = len(self._cycles)
        if not count or self._count < LEAST_SEEN:
            return False
        inverse = np.linalg.inv(self._normal + 1e-9 * np.eye(2 * count))
        found = inverse @ self._pull
        # Neighbours share the offsets before them: what one of them says, half of the next says too.
        left = 2.0 * max(0.0, self._square - float(found @ self._pull)) / self._count
        sizes = np.hypot(found[:count], found[count:])
        sigmas = np.sqrt(left * np.maximum(np.diag(inverse)[:count], np.diag(inverse)[count:]))
        often = self._cycles * self._rates / self._count / 360.0
        shows = often / np.hypot(often, CORRECTED_HZ)
        return bool(np.any(sizes - SURE_SIGMAS * sigmas > HARMS_SHARE * shows * self._sizes))


def zeros_moved(errors: PeriodicErrors, before: PointingTerms, after: PointingTerms) -> bool:
    """Tell whether a mount's zero points moved so far between two models that a table is another phase's.

    They may have where the models are about other axes, or the signs of one are unknown.
    """
    if axes_moved(before.axes, after.axes) or before.signs != after.signs:
        return True
    for zero, waves in (("IH", errors.first), ("ID", errors.second)):
        name = zero.replace("H", "A").replace("D", "E") if after.axes == "altaz" else zero
        moved = after.terms.get(name, (0.0, 0.0))[0] - before.terms.get(name, (0.0, 0.0))[0]
        if any(abs(wave.cycles * moved) / 3600.0 > TURNED_DEG for wave in waves):
            return True
    return False


def wave_text(wave: Wave) -> str:
    """Return a wave for people."""
    return f"{wave.size_arcsec:.1f} ± {wave.sigma_arcsec:.1f}″ {wave.cycles} times a turn"

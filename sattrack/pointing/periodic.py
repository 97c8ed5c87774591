"""Errors of an axis that repeat in its turn: what the axis must report to stand at an angle. Pure.

A gear or an encoder errs by a function of its angle, here a sum of waves. A wave that an axis goes through
faster than a servo follows is left out, little by little: fed, it would come late and make things worse.

Whether a table still holds, a camera shows during a pass. `TableJudge` compares what it sees in a few seconds
with what the table does in them: the satellite of a mount whose table is right does not move with it.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sattrack.mount.model import PeriodicErrors, PointingTerms, Wave

TURNED_DEG = 30.0
"""By so much of its own turn a wave may be beside the true one; farther, it takes away less than half."""
SLOW_HZ = 3.0
"""A wave that comes so often a second is fed by half."""
ROUNDS = 3
BESIDE_DEG = 8.0
"""Beside the angles that passes have covered, a table fades out over so much."""
JUMPS = 3.0
BEFORE_S, LEAST_BEFORE = 8.0, 3
"""An offset is compared with the mean of those of so many seconds before, where there are so many."""
HARMS_SHARE, SURE_SIGMAS, LEAST_SEEN = 0.15, 5.0, 30
"""A table is left aside where the satellite moves with so much of it, so surely, in so many offsets. What the
camera corrects meanwhile hides most of a slow wave."""


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
        self.most_arcsec = sum(wave.size_arcsec for wave in (*errors.first, *errors.second))

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
    """Tells whether a table does harm, by offsets of a camera; both on the sky, arcseconds."""

    def __init__(self, most_arcsec: float) -> None:
        """Take how much the table adds at most: what jumps farther than it can is not its doing."""
        self._most_arcsec = JUMPS * most_arcsec
        self._last: deque[tuple[float, float, float, float, float]] = deque()
        self._count = 0
        self._with = self._of_table = self._of_seen = 0.0

    def take(self, utc_s: float, seen: tuple[float, float], fed: tuple[float, float]) -> None:
        """Take where the satellite was seen beside the image's middle, and what the table had added there.

        Both towards growing angles of the two axes.
        """
        while self._last and not 0.0 < utc_s - self._last[0][0] <= BEFORE_S:
            self._last.popleft()
        count = len(self._last)
        if count >= LEAST_BEFORE:
            means = [sum(one[k] for one in self._last) / count for k in (1, 2, 3, 4)]
            moved = [now - mean for now, mean in zip((*seen, *fed), means, strict=True)]
            if math.hypot(*moved[:2]) < self._most_arcsec:
                self._count += 1
                for k in (0, 1):
                    self._with += moved[k] * moved[2 + k]
                    self._of_table += moved[2 + k] ** 2
                    self._of_seen += moved[k] ** 2
        self._last.append((utc_s, *seen, *fed))

    @property
    def harms(self) -> bool:
        """Whether the satellite surely moves with the table: without it, it would stand stiller."""
        if self._count < LEAST_SEEN or self._of_table <= 0.0:
            return False
        share = self._with / self._of_table
        left = max(0.0, self._of_seen - share * self._with) / (2.0 * self._count)
        # Neighbours share the offsets before them: what one of them says, half of the next says too.
        sigma = math.sqrt(2.0 * left / self._of_table)
        return share - SURE_SIGMAS * sigma > HARMS_SHARE


def zeros_moved(errors: PeriodicErrors, before: PointingTerms, after: PointingTerms) -> bool:
    """Tell whether a mount's zero points moved so far between two models that a table is another phase's."""
    for zero, waves in (("IH", errors.first), ("ID", errors.second)):
        name = zero if after.axes == "equatorial" else zero.replace("H", "A").replace("D", "E")
        moved = after.terms.get(name, (0.0, 0.0))[0] - before.terms.get(name, (0.0, 0.0))[0]
        if any(abs(wave.cycles * moved) / 3600.0 > TURNED_DEG for wave in waves):
            return True
    return False


def wave_text(wave: Wave) -> str:
    """Return a wave for people."""
    return f"{wave.size_arcsec:.1f} ± {wave.sigma_arcsec:.1f}″ {wave.cycles} times a turn"

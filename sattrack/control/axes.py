"""Both axes of a mount as they are known: filters, gates, and which command it was that acted.

A datagram may be lost, repeated or late, and no status tells which one the mount has read. Where a sample
contradicts the history, the commands before and after the expected one are tried, and the one that explains
both axes' movement is believed to have acted; what none of them explains is a disturbance, or a sample that
is not to be believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.kalman import AxisFilter, wrap180

if TYPE_CHECKING:
    from sattrack.control.history import CommandHistory, Motion
    from sattrack.control.kalman import Noise
    from sattrack.mount import MountProfile, StatusSample

GATE_DEG = 0.1
OUTLIERS_BELIEVED = 5
"""Samples in a row that jump the same way are no glitch: the mount's coordinates have changed."""
GAP_S = 5.0
"""A gap in the samples after which the filters begin anew."""
STUCK_DEG, STUCK_TICS = 2.0 / 3600.0, 3.0
"""A reported place that stays the same to the last bit while commands move the axis so far is no reading."""
SURPRISE_SIGMAS = 4.0
EXPLAINED_SHARE = 0.25
"""Another command is believed to have acted where it leaves less than this share of the surprise, squared."""
OTHERS = (-1, 1, -2)
"""Commands tried instead of the expected one, by their distance in the order of sending."""


@dataclass(slots=True)
class Axes:
    """Filters of right ascension and declination, as of the last sample."""

    profile: MountProfile
    history: CommandHistory
    ra: AxisFilter
    dec: AxisFilter
    sample_utc_s: float
    outliers: int = 0
    rates_deg_s: tuple[float, float] | None = None
    """How fast the axes move at the last sample, by the commands and what the axes can do."""
    _rates_deg_s: tuple[float, float] | None = None
    """Mean commanded rates over the last interval."""
    _seen_deg: tuple[float, float] | None = None
    """What the last sample reported."""
    misread: int = 0
    """Samples that were explained by another command than the expected one."""

    @classmethod
    def begin(
        cls,
        profile: MountProfile,
        history: CommandHistory,
        sample: StatusSample,
        utc_s: float,
        noise: Noise | None = None,
    ) -> Axes:
        """Return filters that know one sample."""
        ra, dec = AxisFilter(sample.ra_deg, noise), AxisFilter(sample.dec_deg, noise)
        return cls(profile, history, ra, dec, utc_s)

    @property
    def lost(self) -> bool:
        """Whether the last samples contradict everything that the filters expect."""
        return self.outliers >= OUTLIERS_BELIEVED

    def follows(self, utc_s: float) -> bool:
        """Tell whether a sample of an instant can be joined to those before."""
        return 0.0 < utc_s - self.sample_utc_s < GAP_S

    def take(self, sample: StatusSample, utc_s: float, commanded: bool) -> bool:
        """Bring the filters to a sample; tell whether it was believed.

        `commanded` where the mount moves by our rates; else it moves by a plan of its own, which no history
        of commands tells.
        """
        seconds = utc_s - self.sample_utc_s
        if commanded:
            expected = self._motion(utc_s)
            ra_moved, dec_moved = self._explain(sample, utc_s, expected.moved)
            self.rates_deg_s = expected.rates_deg_s
        else:
            ra_moved = wrap180(sample.ra_deg - self.ra.position_deg)
            dec_moved = sample.dec_deg - self.dec.position_deg
            self.rates_deg_s = (ra_moved / seconds, dec_moved / seconds)
        ra_jolt, dec_jolt = self._jolts((ra_moved, dec_moved), seconds)
        self.ra.advance(seconds, ra_moved, commanded, ra_jolt)
        self.dec.advance(seconds, dec_moved, commanded, dec_jolt)
        self._rates_deg_s = (ra_moved / seconds, dec_moved / seconds) if commanded else None
        self.sample_utc_s = utc_s
        if self._is_stuck(sample, ra_moved, dec_moved):
            return False
        # No axis gets further from the prediction than by running full speed the other way.
        ra_gate = GATE_DEG + 2.0 * self.profile.ra.max_rate_deg_s * seconds
        dec_gate = GATE_DEG + 2.0 * self.profile.dec.max_rate_deg_s * seconds
        ra_jump = abs(wrap180(sample.ra_deg - self.ra.position_deg))
        if ra_jump > ra_gate or abs(sample.dec_deg - self.dec.position_deg) > dec_gate:
            self.outliers += 1
            return False
        self.outliers = 0
        self.ra.measure(sample.ra_deg, ra_moved / seconds)
        self.dec.measure(sample.dec_deg, dec_moved / seconds)
        return True

    def _is_stuck(self, sample: StatusSample, ra_moved_deg: float, dec_moved_deg: float) -> bool:
        """Tell whether an axis is said to stand where it stood to the last bit, though commands moved it."""
        seen, self._seen_deg = self._seen_deg, (sample.ra_deg, sample.dec_deg)
        if seen is None:
            return False
        least_deg = max(STUCK_DEG, STUCK_TICS * 360.0 / self.profile.encoder_tics)
        return (seen[0] == sample.ra_deg and abs(ra_moved_deg) > least_deg) or (
            seen[1] == sample.dec_deg and abs(dec_moved_deg) > least_deg
        )

    def moved_by(self, utc_s: float) -> tuple[float, float]:
        """Return how far the commands will have moved the axes from the last sample to an instant."""
        return self._motion(utc_s).moved

    def _motion(self, utc_s: float) -> Motion:
        limits = (self.profile.ra.max_acceleration_deg_s2, self.profile.dec.max_acceleration_deg_s2)
        return self.history.motion(self.sample_utc_s, utc_s, self.rates_deg_s, limits)

    def _explain(
        self, sample: StatusSample, utc_s: float, expected: tuple[float, float]
    ) -> tuple[float, float]:
        """Return how far the commands moved the axes since the last sample."""
        surprise = self._surprise(sample, utc_s, expected)
        # Over a gap of lost samples, more than one command acted, and there is no telling.
        if surprise < SURPRISE_SIGMAS**2 or not self.history.is_one_turn(self.sample_utc_s, utc_s):
            return expected
        best, least = expected, surprise * EXPLAINED_SHARE
        for step in OTHERS:
            moved = self.history.displacement_by(step, self.sample_utc_s, utc_s)
            if moved is None:
                continue
            left = self._surprise(sample, utc_s, moved)
            if left < least:
                best, least = moved, left
        self.misread += best is not expected
        return best

    def _surprise(self, sample: StatusSample, utc_s: float, moved: tuple[float, float]) -> float:
        """Return the square of what a displacement leaves unexplained, in sigmas, over both axes."""
        seconds = utc_s - self.sample_utc_s
        ra_jolt, dec_jolt = self._jolts(moved, seconds)
        ra_left = wrap180(sample.ra_deg - self.ra.foretold_deg(seconds, moved[0]))
        dec_left = wrap180(sample.dec_deg - self.dec.foretold_deg(seconds, moved[1]))
        ra_sigma, dec_sigma = self.ra.expected_sigma_deg(ra_jolt), self.dec.expected_sigma_deg(dec_jolt)
        return (ra_left / ra_sigma) ** 2 + (dec_left / dec_sigma) ** 2

    def _jolts(self, moved: tuple[float, float], seconds: float) -> tuple[float, float]:
        """Return by how much the commanded rates have changed since the interval before."""
        if self._rates_deg_s is None:
            return moved[0] / seconds, moved[1] / seconds
        return moved[0] / seconds - self._rates_deg_s[0], moved[1] / seconds - self._rates_deg_s[1]

"""Statuses as the mount sent them, dated by the mount's own clock, and that clock against ours.

A status sampled at the mount's second m arrives at m + offset + drift m + delay, and a delay has a least
value and no largest. So the fastest arrivals of each stretch of the run lie on a line: its slope is the
drift, and it says for every status when the fastest datagram would have arrived.

The mount looks into its mailbox once a loop. A command sent at S is seen in the loop of the status that
arrives at A exactly where A - S is at least the round trip, so each flag raised or lowered puts the round
trip between the status before and the status that first shows it. Single delays scatter by an amount that
is estimated as well; brackets that miss by many times that are counted as strays.

A Windows timer of 50 ms fires at interrupts that come every 15.6 ms: its turns are uneven, but they come
again in the same rhythm. So turns are predicted from those a whole rhythm before, of any length.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sattrack.control.latency import SIDEREAL_SECONDS_PER_SECOND
from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Readings, Status
from sattrack.mount.xerxes.datagrams import DOUBTFUL, DatagramError, decode_status, status_readings
from sattrack.mount.xerxes.link import RESTART_PROOF
from sattrack.mount.xerxes.standstill import Positions

if TYPE_CHECKING:
    from collections.abc import Sequence

LONGEST_RHYTHM = 8
FEWEST_PAIRS = 5
LEAST_TURN_S = 0.01
CLEARLY = 0.7
"""A longer rhythm is taken where it leaves so much less scatter."""


class TurnForecast:
    """Predicts turns, in seconds of the mount's clock, from two statuses or more in order."""

    def __init__(self, heard: Sequence[HeardStatus]) -> None:
        self._at = {h.counter: h.mount_s for h in heard}
        self._last = heard[-1].counter
        turns = self._last - heard[0].counter
        self._rhythm, self.scatter_s = 1, float("inf")
        self.mean_s = (heard[-1].mount_s - heard[0].mount_s) / turns
        for rhythm in range(1, LONGEST_RHYTHM + 1):
            steps = [self._at[c] - self._at[c - rhythm] for c in self._at if c - rhythm in self._at]
            if len(steps) >= FEWEST_PAIRS and np.std(steps) < CLEARLY * self.scatter_s:
                self._rhythm, self.scatter_s = rhythm, float(np.std(steps))
                self.mean_s = float(np.mean(steps)) / rhythm
        self.mean_s = max(LEAST_TURN_S, self.mean_s)

    def next_after(self, mount_s: float) -> float:
        """Return the first turn predicted at or after a second of the mount's clock."""
        counter = self._last
        while True:
            counter += 1
            at = self._predicted(counter)
            if at >= mount_s:
                return at

    def _predicted(self, counter: int) -> float:
        before = counter - self._rhythm * -(-(counter - self._last) // self._rhythm)
        while before not in self._at and before > self._last - 4 * LONGEST_RHYTHM:
            before -= self._rhythm
        if before not in self._at:
            before = self._last
        return self._at[before] + (counter - before) * self.mean_s


RESTART_COUNTS = 50
"""A counter that falls by less than this is a late datagram's."""
STILL_WITHIN_DEG_S = 5e-4
STILL_STATUSES = 6
STILL_SPAN_S = 0.25


@dataclass(frozen=True, slots=True)
class HeardStatus:
    """One status as it was heard.

    `arrival_utc_s` is ours; `mount_s` are seconds of the mount's clock since the first status. The hour angle
    is the mount's sidereal time less its right ascension, degrees, counted on through whole turns.
    """

    counter: int
    arrival_utc_s: float
    mount_s: float
    hour_angle_deg: float
    dec_deg: float
    status: Status


@dataclass(slots=True)
class StatusLog:
    """Takes datagrams; keeps what is new and in order."""

    heard: list[HeardStatus] = field(default_factory=list)
    rejected: int = 0
    late: int = 0
    restarted: bool = False
    """Whether the counter began anew: the mount's program was started again."""
    readings: dict[str, str] = field(default_factory=dict)
    """Types seen of the doubtful fields; a field that held zeros only is not in it."""
    contradictory: set[str] = field(default_factory=set)
    """Doubtful fields that were seen with both types."""

    positions: Positions = field(default_factory=Positions)
    """What tells whether a stop has come to rest."""
    _anew: list[int] = field(default_factory=list)

    @property
    def last(self) -> HeardStatus | None:
        """The newest status."""
        return self.heard[-1] if self.heard else None

    def take(self, data: bytes, arrival_utc_s: float) -> HeardStatus | None:
        """Keep a status and return it; None for what is no status, or comes late, or twice."""
        try:
            status = decode_status(data)
            readings = status_readings(data)
        except DatagramError:
            self.rejected += 1
            return None
        before = self.last
        if before is not None and status.counter <= before.counter and not self._began_anew(status, before):
            self.late += 1
            return None
        self._note_readings(readings)
        hour_angle = (status.sidereal_h - status.ra_h) * 15.0
        reference = 0.0 if before is None else before.hour_angle_deg
        heard = HeardStatus(
            status.counter,
            arrival_utc_s,
            self._mount_seconds(status.sidereal_h, before),
            reference + wrap180(hour_angle - reference),
            status.dec_deg,
            status,
        )
        self.heard.append(heard)
        self.positions.take(
            arrival_utc_s, status.sidereal_h, status.ra_h * 15.0, status.dec_deg, status.side_of_pier
        )
        return heard

    def still(self) -> bool:
        """Tell whether both axes stand, or follow the sky, by the newest statuses."""
        newest = self.heard[-STILL_STATUSES:]
        if len(newest) < STILL_STATUSES:
            return False
        first, last = newest[0], newest[-1]
        span_s = last.mount_s - first.mount_s
        if span_s < STILL_SPAN_S * 0.8:
            return False
        turned = last.hour_angle_deg - first.hour_angle_deg
        off_deg = min(abs(turned), abs(turned - SIDEREAL_RATE_DEG_S * span_s))
        return max(off_deg, abs(last.dec_deg - first.dec_deg)) < STILL_WITHIN_DEG_S * span_s

    def _began_anew(self, status: Status, before: HeardStatus) -> bool:
        """Tell whether low counters that rise again and again are those of a program started anew."""
        if before.counter - status.counter <= RESTART_COUNTS:
            return False
        rising = bool(self._anew) and status.counter > self._anew[-1]
        self._anew = [*self._anew, status.counter] if rising else [status.counter]
        self.restarted = self.restarted or len(self._anew) >= RESTART_PROOF
        return len(self._anew) >= RESTART_PROOF

    @staticmethod
    def _mount_seconds(sidereal_h: float, before: HeardStatus | None) -> float:
        if before is None:
            return 0.0
        hours = (sidereal_h - before.status.sidereal_h + 12.0) % 24.0 - 12.0
        return before.mount_s + hours * 3600.0 / SIDEREAL_SECONDS_PER_SECOND

    def _note_readings(self, readings: Readings) -> None:
        for name in DOUBTFUL:
            seen = getattr(readings, name)
            if seen is None:
                continue
            if self.readings.setdefault(name, seen) != seen:
                self.contradictory.add(name)


Array = NDArray[np.float64]

LONGEST_S = 0.6
STEP_S = 0.0001
SCATTERS_S = (0.0001, 0.0002, 0.0004, 0.0008, 0.0016, 0.0032, 0.0064)
STRAY_SHARE = 0.02
"""Prior share of brackets that tell nothing: the command was lost and acted by its repetition."""
STRAY_BEYOND = 8.0
LARGEST_STRAY_SHARE = 0.25
LARGEST_SIGMA_S = 0.01


class Bracket(NamedTuple):
    """The round trip of one change lies above `above_s` and is at most `within_s`."""

    above_s: float
    within_s: float


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Typical round trip and its standard uncertainty, seconds; `scatter_s` is that of single datagrams.

    `fastest_s` has the shortest delay of a status in place of the typical one: it belongs to instants that
    are given by the fastest arrivals.
    """

    seconds: float
    fastest_s: float
    sigma_s: float
    scatter_s: float
    brackets: int
    strays: int

    @property
    def margin_s(self) -> float:
        """By how much an interval is widened to hold the truth: three sigma, and half a millisecond."""
        return 3.0 * self.sigma_s + 0.0005


def _step(x: Array) -> Array:
    """Return a smooth step at 0, in the place of its argument: new arrays of this size take longer."""
    # Logistic: its wings are heavier than a normal one's, as those of network delays are.
    np.clip(x, -40.0, 40.0, out=x)
    np.exp(np.negative(x, out=x), out=x)
    x += 1.0
    return np.divide(1.0, x, out=x)


@dataclass(slots=True)
class RoundTripEstimate:
    """What brackets say of the round trip: a probability for each value and each scatter of single delays."""

    _seconds: Array = field(default_factory=lambda: np.arange(0.0, LONGEST_S, STEP_S))
    _scatters: Array = field(default_factory=lambda: np.array(SCATTERS_S)[:, None])
    _log: Array = field(init=False)
    _brackets: list[Bracket] = field(default_factory=list)
    _result: RoundTrip | None = None
    """What is known by these brackets, once somebody has asked."""

    def __post_init__(self) -> None:
        """Begin with nothing known."""
        self._log = np.zeros((len(SCATTERS_S), len(self._seconds)))

    def add(self, bracket: Bracket) -> None:
        """Take one bracket."""
        self._brackets.append(bracket)
        self._result = None
        above = _step((bracket.within_s - self._seconds) / self._scatters)
        below = _step((bracket.above_s - self._seconds) / self._scatters)
        above -= below
        np.maximum(above, 0.0, out=above)
        above *= 1.0 - STRAY_SHARE
        above += STRAY_SHARE * 0.05
        self._log += np.log(above, out=above)

    @property
    def median_s(self) -> float:
        """The value that the truth is as likely above as below."""
        cumulative = np.cumsum(_marginal(self._likelihood()))
        return float(self._seconds[np.searchsorted(cumulative, 0.5)])

    def result(self) -> RoundTrip:
        """Return what is known."""
        if self._result is None:
            self._result = self._found()
        return self._result

    def _found(self) -> RoundTrip:
        likelihood = self._likelihood()
        probability = _marginal(likelihood)
        mean = float((probability * self._seconds).sum())
        sigma = float(np.sqrt((probability * (self._seconds - mean) ** 2).sum()))
        weights = likelihood.sum(axis=1)
        scatter = float((weights * self._scatters[:, 0]).sum() / weights.sum())
        far = STRAY_BEYOND * scatter + 3.0 * sigma
        strays = sum(1 for b in self._brackets if mean < b.above_s - far or mean > b.within_s + far)
        return RoundTrip(mean, mean, max(sigma, STEP_S), scatter, len(self._brackets), strays)

    def _likelihood(self) -> Array:
        likelihood: Array = np.exp(self._log - self._log.max())
        return likelihood


def _marginal(likelihood: Array) -> Array:
    """Return the probability of each value, whatever the scatter."""
    probability: Array = likelihood.sum(axis=0)
    probability /= probability.sum()
    return probability


def contradiction(trip: RoundTrip) -> str | None:
    """Say so where acknowledgements do not fit one round trip."""
    if trip.sigma_s > LARGEST_SIGMA_S:
        return (
            "acknowledgements do not fit one round trip: it comes out as "
            f"{trip.seconds * 1e3:.0f} ± {trip.sigma_s * 1e3:.0f} ms; "
            "another program commands the mount, or the network is too uneven"
        )
    if trip.brackets and trip.strays > LARGEST_STRAY_SHARE * trip.brackets:
        return (
            f"{trip.strays} of {trip.brackets} acknowledgements do not fit one round trip: "
            "another program commands the mount, or the network loses much"
        )
    return None


STRETCHES = 24
FEWEST_IN_STRETCH = 20
SMALLEST_SIGMA_S = 2e-6
"""What is left of a float's and a kernel stamp's rounding, taken as the least scatter of fast arrivals."""
LARGEST_DRIFT = 1e-3
LARGEST_SCATTER_S = 0.005


@dataclass(frozen=True, slots=True)
class ClockLine:
    """When the fastest status of each second of the mount's clock would have arrived, our UTC."""

    middle_s: float
    arrival_utc_s: float
    """At the mount's second `middle_s`."""
    slope: float
    """Our seconds in a second of the mount's clock, less one."""
    slope_sigma: float
    scatter_s: float
    """Of the fastest arrivals about the line."""
    jitter_s: float
    """Mean lateness of all arrivals against the line."""

    @property
    def drift_ppm(self) -> float:
        """How much faster than ours the mount's clock runs, parts in a million."""
        return -self.slope / (1.0 + self.slope) * 1e6

    def arrival_at(self, mount_s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the fastest possible arrival, our UTC, of statuses sampled at these seconds."""
        since = np.asarray(mount_s, dtype=np.float64) - self.middle_s
        return self.arrival_utc_s + since * (1.0 + self.slope)

    def objection(self) -> str | None:
        """Say what is wrong with the mount's clock, if it cannot date statuses."""
        if self.scatter_s > LARGEST_SCATTER_S:
            return (
                f"the mount's sidereal clock and the arrivals disagree by {self.scatter_s * 1e3:.0f} ms:"
                " one of the clocks was set during the run, or the network is too uneven"
            )
        if abs(self.slope) > LARGEST_DRIFT:
            return f"the mount's sidereal clock runs {self.drift_ppm:.0f} millionths too fast"
        return None


def clock_line(heard: list[HeardStatus]) -> ClockLine:
    """Return the line of the fastest arrivals. Needs two stretches of FEWEST_IN_STRETCH statuses or more."""
    mount = np.array([h.mount_s for h in heard])
    zero = heard[0].arrival_utc_s
    late = np.array([h.arrival_utc_s - zero for h in heard]) - mount
    stretches = max(2, min(STRETCHES, len(heard) // FEWEST_IN_STRETCH))
    fastest = [part[np.argmin(late[part])] for part in np.array_split(np.arange(len(heard)), stretches)]
    x, y = mount[fastest], late[fastest]
    slope, level, kept = _line_without_strays(x, y)
    middle = float(x[kept].mean())
    residuals = y[kept] - (level + slope * x[kept])
    count = int(kept.sum())
    scatter = max(SMALLEST_SIGMA_S, float(np.sqrt((residuals**2).sum() / max(1, count - 2))))
    spread = float(np.sqrt(((x[kept] - middle) ** 2).sum()))
    return ClockLine(
        middle_s=middle,
        arrival_utc_s=zero + middle + level + slope * middle,
        slope=slope,
        slope_sigma=scatter / spread if spread > 0.0 else float("inf"),
        scatter_s=scatter,
        jitter_s=float(np.mean(late - (level + slope * mount))),
    )


def _line_without_strays(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[float, float, NDArray[np.bool_]]:
    """Return slope and level by least squares, stretches without a fast arrival left out."""
    kept = np.ones(len(x), dtype=np.bool_)
    slope = level = 0.0
    for _ in range(4):
        slope, level = (float(c) for c in np.polyfit(x[kept], y[kept], 1))
        residuals = y - (level + slope * x)
        typical = max(SMALLEST_SIGMA_S, 1.4826 * float(np.median(np.abs(residuals[kept]))))
        new = np.abs(residuals) < 4.0 * typical
        if new.sum() < max(3, len(x) // 2) or bool((new == kept).all()):
            break
        kept = new
    return slope, level, kept


@dataclass(frozen=True, slots=True)
class StatusPeriod:
    """How often the mount's loop turns, by its own clock, seconds."""

    mean_s: float
    jitter_s: float
    """Standard deviation of one turn."""


def status_period(heard: list[HeardStatus]) -> StatusPeriod:
    """Return the loop's period; statuses that were lost are counted by the counter."""
    turns = heard[-1].counter - heard[0].counter
    mean = (heard[-1].mount_s - heard[0].mount_s) / turns
    single = [b.mount_s - a.mount_s for a, b in pairwise(heard) if b.counter == a.counter + 1]
    return StatusPeriod(mean, float(np.std(single)) if single else float("nan"))

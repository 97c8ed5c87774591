"""A Kalman filter per axis: where the axis is, which rate nobody asked for, and what comes of a command when.

State: position in degrees, rate disturbance in degrees per second, and the shares of the axis' response (see
`lag_of`): their sum is the gain, their mean lag the servo's. Input: the commands that acted. Measurement:
the reported position at its own instant. Nothing is clamped: what is bounded is so by its prior, and a filter
that contradicts what it measures begins anew.

How an axis answers commands: how much of a change of rate has come out so long after it began to act.

The answer is given as shares of the change, one for each of the lags between KNOTS_S (the first at once): a
finite impulse response. So a servo of any kind is described by numbers in which the motion is linear, and
which a Kalman filter can learn: velocity loops, position loops that catch up, planners that come a turn late.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from sattrack.core.angles import wrap180

if TYPE_CHECKING:
    from collections.abc import Iterable

    Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

TURN_S = 0.05
"""Period of the mount's loop: a command that is read a turn early comes out that much earlier."""
JUMPS_S = (-TURN_S, 0.0, TURN_S)
"""Lags at which a share comes out at once: a turn before the command should act, then, and a turn after."""
KNOTS_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.75, 1.0, 1.4)
"""Between each two of these lags, seconds, a share comes out evenly. What comes later is a disturbance."""
SETTLED_S = KNOTS_S[-1]
SHARES = len(JUMPS_S) + len(KNOTS_S) - 1
_PROMPT = 1
"""Index of what comes out as the command is thought to act."""
_FIRST = len(JUMPS_S)
_STARTS = np.array((*JUMPS_S, *KNOTS_S[:-1]))
_WIDTHS = np.array((*(0.0 for _ in JUMPS_S), *np.diff(KNOTS_S)))
FADES_S, ALIKE_S = 0.25, 0.2
"""How soon after a change little is uncertain any more, and over which lags what is uncertain is alike."""
_MIDDLES = _STARTS + 0.5 * _WIDTHS
_MOMENTS = np.array((np.ones(SHARES), _MIDDLES, _MIDDLES * _MIDDLES + _WIDTHS * _WIDTHS / 12.0))
_LAGS_S = (*JUMPS_S, *KNOTS_S[2:])
"""All ends of lags; the first knots are jumps as well."""
_SPAN_STARTS, _SPAN_ENDS = slice(_PROMPT, -1), slice(_PROMPT + 1, None)
"""Where among them the spans between the knots begin and end."""
_SPAN_WIDTHS_S = np.diff(KNOTS_S)
BEFORE_S = 10.0
MOST_KEPT = 200
SHORTEST_S = 1e-9
Summed = tuple[float, float, float, float, float, float, float]
"""An instant, the rates from then on, the places that former ones led to, and the integrals of those."""


class Step(NamedTuple):
    """Rates of both axes that act from an instant on, degrees per second; UTC as POSIX seconds."""

    utc_s: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


class Rates(Protocol):
    """Rates of both axes, degrees per second."""

    @property
    def ra_rate_deg_s(self) -> float:
        """Of right ascension."""

    @property
    def dec_rate_deg_s(self) -> float:
        """Of declination."""


class Lag(NamedTuple):
    """Mean and variance of the delay with which changes of rate come out, seconds and seconds squared.

    `whole` is what comes out in all: the gain.
    """

    mean_s: float
    variance_s2: float
    whole: float = 1.0


class LoopTurn(NamedTuple):
    """One turn of the mount's loop as seen: what the expected command leaves of both axes' motion, degrees.

    `answers_s` is how far a rate moves each axis within the turn that reads it, over the rate; `sigmas_deg`
    how well the motion is predicted.
    """

    left_deg: tuple[float, float]
    answers_s: tuple[float, float]
    sigmas_deg: tuple[float, float]
    expected: Step

    def surprise(self, acted: Rates) -> float:
        """Return the square of what is left, in sigmas of both axes, if these rates have acted."""
        ra = self.left_deg[0] - (acted.ra_rate_deg_s - self.expected.ra_rate_deg_s) * self.answers_s[0]
        dec = self.left_deg[1] - (acted.dec_rate_deg_s - self.expected.dec_rate_deg_s) * self.answers_s[1]
        ra_sigma, dec_sigma = self.sigmas_deg
        return (ra / ra_sigma) ** 2 + (dec / dec_sigma) ** 2


class Commanded:
    """The rates that have acted on both axes, and how far each share of the axes' response moves them.

    A share that comes out at once after a lag moves an axis as far as the commands did until that lag ago.
    One that comes out over a span of lags moves it as far as they did in the mean of that span. So the
    integral of the rates, and the integral of that, are taken at the ends of the lags.
    """

    def __init__(self, utc_s: float, ra_rate_deg_s: float = 0.0, dec_rate_deg_s: float = 0.0) -> None:
        """Begin with rates that have acted since long before an instant."""
        self._utc_s = [utc_s - BEFORE_S]
        self._steps: list[Summed] = [(utc_s - BEFORE_S, ra_rate_deg_s, dec_rate_deg_s, 0.0, 0.0, 0.0, 0.0)]

    @property
    def last(self) -> Step:
        """What has acted last."""
        return Step(*self._steps[-1][:3])

    def add(self, step: Step) -> None:
        """Take what acts from an instant on; instants rise."""
        self._append(step)
        if len(self._utc_s) > MOST_KEPT:
            answered = bisect_right(self._utc_s, step.utc_s - 2.0 * SETTLED_S) - 1
            del self._utc_s[:answered], self._steps[:answered]

    def effects(self, from_s: float, to_s: float, coming: Iterable[Step] = ()) -> Array:
        """Return how far both axes move between two instants for each share, degrees, shape (2, SHARES).

        `coming` is what is expected to act after what has acted.
        """
        count = len(self._utc_s)
        for step in coming:
            self._append(step)
        ends = np.array((self._at_lags(to_s), self._at_lags(from_s)))
        del self._utc_s[count:], self._steps[count:]
        moved = ends[0] - ends[1]
        effects = np.empty((2, SHARES))
        effects[:, :_FIRST] = moved[:2, :_FIRST]
        effects[:, _FIRST:] = (moved[2:, _SPAN_STARTS] - moved[2:, _SPAN_ENDS]) / _SPAN_WIDTHS_S
        return effects

    def _append(self, step: Step) -> None:
        begun_s, ra_rate, dec_rate, ra, dec, ra_sum, dec_sum = self._steps[-1]
        for_s = step.utc_s - begun_s
        ra_moved, dec_moved = ra_rate * for_s, dec_rate * for_s
        ra_sum += (ra + 0.5 * ra_moved) * for_s
        dec_sum += (dec + 0.5 * dec_moved) * for_s
        self._utc_s.append(step.utc_s)
        self._steps.append((*step, ra + ra_moved, dec + dec_moved, ra_sum, dec_sum))

    def _at_lags(self, utc_s: float) -> tuple[list[float], list[float], list[float], list[float]]:
        """Return the rates' integrals and the integrals of those, as of each lag before an instant."""
        times, steps, count = self._utc_s, self._steps, len(self._utc_s)
        moved: tuple[list[float], list[float], list[float], list[float]] = ([], [], [], [])
        add_ra, add_dec, add_ra_sum, add_dec_sum = (one.append for one in moved)
        for lag_s in _LAGS_S:
            at_s = utc_s - lag_s
            count = bisect_right(times, at_s, 0, count)
            begun_s, ra_rate, dec_rate, ra, dec, ra_sum, dec_sum = steps[count - 1]
            for_s = at_s - begun_s
            ra_moved, dec_moved = ra_rate * for_s, dec_rate * for_s
            add_ra(ra + ra_moved)
            add_dec(dec + dec_moved)
            add_ra_sum(ra_sum + (ra + 0.5 * ra_moved) * for_s)
            add_dec_sum(dec_sum + (dec + 0.5 * dec_moved) * for_s)
        return moved


def rest_of(step: Step, seconds: float) -> Array:
    """Return how far a step's rates move both axes in so many seconds, for each share, (2, SHARES)."""
    rates = np.array(step[1:])
    both: Array = rates[:, None] * (seconds - _MIDDLES)
    return both


def answers_of(seconds: Array | float) -> Array:
    """Return how far a step of rate has moved an axis so long after it by each share, over the step."""
    since_s = np.maximum(np.asarray(seconds)[..., None] - _STARTS, 0.0)
    into_s = np.minimum(since_s, _WIDTHS)
    moved_s: Array = since_s - into_s + 0.5 * into_s * into_s / np.maximum(_WIDTHS, SHORTEST_S)
    return moved_s


def lag_of(shares: Array) -> Lag:
    """Return the mean lag of a response and its spread."""
    whole, first_s, square_s2 = np.add.reduce(_MOMENTS * shares, axis=1).tolist()
    mean_s = first_s / whole
    return Lag(mean_s, square_s2 / whole - mean_s * mean_s, whole)


def lag_sigma_s(covariance: Array) -> float:
    """Return one sigma of the mean lag for the covariance of the shares."""
    variance = float(np.add.reduce(np.add.reduce(covariance * _MIDDLES, axis=1) * _MIDDLES))
    return math.sqrt(max(0.0, variance))


def _total(values: Array) -> float:
    return float(sum(values.tolist()))


def expected_shares(lag_s: float) -> Array:
    """Return the shares of a first-order servo with a mean lag, seconds."""
    shares = np.zeros(SHARES)
    if lag_s <= 0.0:
        shares[_PROMPT] = 1.0
        return shares
    reached = [1.0 - math.exp(-knot / lag_s) for knot in KNOTS_S]
    reached[-1] = 1.0
    shares[_FIRST:] = np.diff(reached)
    # A share lies evenly within its lags; what comes at once makes up for the difference in the mean.
    over_s = _total(shares * _MIDDLES) - lag_s
    moved = min(max(over_s / float(_MIDDLES[_FIRST]), 0.0), float(shares[_FIRST]))
    shares[_PROMPT] += moved
    shares[_FIRST] -= moved
    return shares


def share_spread(late_sigma: float, turn_sigma: float, gain_sigma: float) -> Array:
    """Return the covariance of the shares of a servo of which little is known, shape (SHARES, SHARES).

    What has come out so long after a change is uncertain by `late_sigma` at first, by less and less later on,
    and by `gain_sigma` for good; a share of about `turn_sigma` may come a turn early or late.
    """
    sigmas = np.array([late_sigma * math.exp(-0.5 * (knot / FADES_S) ** 2) for knot in KNOTS_S])
    near = np.array([[math.exp(-abs(a - b) / ALIKE_S) for b in KNOTS_S] for a in KNOTS_S])
    reached = sigmas[:, None] * sigmas[None, :] * near + gain_sigma**2
    # What comes out between two knots is a difference; what comes at once is what has come by the first.
    shares = np.diff(np.diff(reached, axis=0, prepend=0.0), axis=1, prepend=0.0)
    come = np.array([_PROMPT, *range(_FIRST, SHARES)])
    covariance = np.zeros((SHARES, SHARES))
    covariance[come[:, None], come] = shares
    for turn in (_PROMPT - 1, _PROMPT + 1):
        moved = np.zeros(SHARES)
        moved[turn], moved[_PROMPT] = turn_sigma, -turn_sigma
        covariance += moved[:, None] * moved[None, :]
    return covariance


@dataclass(frozen=True, slots=True)
class Noise:
    """What the filter expects of an axis, one sigma. Raises ValueError for what it cannot compute with."""

    position_deg: float = 0.03 / 3600.0
    """Encoder and packing noise of one sample."""
    timing_s: float = 30e-6
    """Error in the date of one sample: it acts through the rate."""
    walk_deg_sqrt_s: float = 0.02 / 3600.0
    """Position noise that grows with the root of time: what the servo does within a loop."""
    rate_walk_deg_s_sqrt_s: float = 0.5 / 3600.0
    """Growth of the rate disturbance with the root of time."""
    rate_fades_s: float = 60.0
    """Time in which a rate disturbance that is not seen is forgotten."""
    response_s: float = 0.003
    """Position noise for each change of the commanded rate, over that change: turns come a little off."""
    first_rate_deg_s: float = 20.0 / 3600.0
    learning: float = 0.01
    """How fast the measurement noise is learnt, a share each sample."""
    first_gain: float = 0.02
    gain_walk_sqrt_s: float = 1e-5
    """Growth of the gain's error with the root of time: it is the mount's own, and stays."""
    late_walk_sqrt_s: float = 0.003
    """Growth of the uncertainty of `late` with the root of time: small changes come out sooner than large."""
    turn: float = 0.3
    """How uncertain it is at first whether a command is read a turn early or late, as a share."""
    first_lag_s: float = 0.03
    """The servo's mean lag where the profile tells none."""
    late: float = 0.5
    """How uncertain it is at first what has come out shortly after a command, as a share."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        for one in fields(self):
            value = getattr(self, one.name)
            # By the time in which a rate fades the filter divides.
            if not 0.0 <= value < math.inf or (one.name == "rate_fades_s" and value == 0.0):
                raise ValueError(f"{one.name} is {value:g}: give one above 0")


SURPRISE_SIGMAS = 4.0
SURPRISING = SURPRISE_SIGMAS**2
SMALLEST_NOISE_SHARE, LARGEST_NOISE_SHARE = 0.002, 400.0
"""How far the measurement's variance may go from the expected one: the sigma by up to twenty times."""
SMALLEST_ROUGH_SHARE, LARGEST_ROUGH_SHARE = 1e-4, 16.0
"""How far the variance of the motion's own noise may. Taken for rougher than it is, a motion would have every
noise of a measurement in the commands, and what comes of commands would be learnt from that."""
ROUGH_LEARNING = 5.0
"""How much faster the motion's own noise is learnt than that of the measurements."""
ONE_SIDED = 0.5
"""Mean product of a surprise and the one before, in their sigmas, from which on they are motion."""
SURELY_ALIKE = 4.0
"""That product from which on a motion that was smooth is as rough as any within a few samples."""
REOPENED_PER_S = 0.03
"""Share of an unknown axis' variance of gain that its gain gets back a second, for each unit by which the
motion is rougher than expected: at its bound, the gain is as uncertain as at first after two seconds."""
NEAR_REST_DEG_S = 0.05
"""Slower than this an axis may stick. How far it stays behind then its servo takes away by itself, so that is
no rate: compensated as one, the axis breaks loose the further."""
STICKS_DEG_S = 0.01
"""Slower than this friction may stop an axis that moved smoothly before."""
PLAUSIBLE_RATE_DEG_S = 40.0 / 3600.0
"""A rate disturbance beyond this was an axis that was stopped: near rest too, it may be over at once."""
OVER_S = 1.0
"""Time in which such a rate of an axis that was known is likely to end."""
LASTS_S = 3.0
"""A rate that has lasted for so long is no stopped axis: it may be a gain that was learnt wrongly."""
LARGEST_RATE_DEG_S = 0.1
"""One sigma of a rate that has set in at once."""
STEADY, LOST = 0.05, 9.0
"""What a sample counts in the mean of the squared surprises, and the mean from which the filter is lost."""
DISTURBED, CALM = 4.0, 2.0
"""The mean from which motion is disturbed, and the mean below which that is over."""
LIKELY_SIGMAS = 1.25
"""How far gain and rate may be from those of an unknown axis to be kept after a disturbed motion."""
ROUNDING = 1e-9
"""By how much shares whose sum is known exactly may sum to something else."""
MOST_RATIO = 40.0
"""What one sample may count at most."""
SHORTEST_TRIAL = 20
"""Samples that a filter is given before it is judged."""
TRUSTED_SAMPLES, TRUSTED_EVERY = 80, 20
"""Samples without surprises after which what is known of the response is kept for the next beginning, and how
often it is brought up to date."""
TRUSTED_SPREAD = 4.0
"""By how much its covariance grows then."""
DOUBTED_SPREAD = 16.0
"""The same after the way to a target by rates."""
DOUBTED_GAIN = 0.005
"""By how much a gain may be wrong then, one sigma, with a rate that makes up for it. With twice as much, the
ripple of a motor is taken for one or the other, and draws the lag along."""

RELEARNT = 0.1
"""How uncertain an axis' response becomes, over that of an unknown one, when the commands' delay changes."""
Matrix = np.ndarray[tuple[int, int], np.dtype[np.float64]]


class LeanKalmanFilter:
    """A Kalman filter for one axis: position, rate, shares; the position measured.

    The algebra is written out: `foretell` and `correct` are `predict` and `update` of filterpy's KalmanFilter
    for a transition that is the unit matrix but for the first row. They change one row and column of the
    covariance, and take a tenth of the time. And filterpy imports scipy: 50 MB that a real-time process would
    lock into memory.
    """

    def __init__(self, state: Array, covariance: Matrix) -> None:
        self.state, self.covariance = state, covariance
        self.innovation_deg = 0.0
        self.innovation_variance = 1.0
        self.gain = np.zeros(len(state))

    def foretell(self, moves: Array, moved_deg: float) -> None:
        """Predict: the position moves by `moves` times the rest of the state, and by `moved_deg`."""
        state, covariance = self.state, self.covariance
        state[0] += float(moves.dot(state[1:])) + moved_deg
        gained = moves.dot(covariance[1:])
        covariance[0] += gained
        covariance[:, 0] += gained
        covariance[0, 0] += gained[1:].dot(moves)

    def fade(self, share: float) -> None:
        """Predict that the rate fades to a share of what it is."""
        self.state[1] *= share
        self.covariance[1] *= share
        self.covariance[:, 1] *= share

    def blur(self, own: float, cross: float, rate: float, shares: Array) -> None:
        """Add the process noise: variances of position and rate, what they share, and that of the shares."""
        covariance = self.covariance
        covariance[0, 0] += own
        covariance[0, 1] += cross
        covariance[1, 0] += cross
        covariance[1, 1] += rate
        covariance[2:, 2:] += shares

    def correct(self, measured: float, variance: float) -> None:
        """Take one measurement of the position in."""
        covariance = self.covariance
        self.innovation_deg = left = measured - float(self.state[0])
        self.innovation_variance = total = float(covariance[0, 0]) + variance
        row = covariance[0].copy()
        self.gain = gain = row / total
        self.state += gain * left
        covariance -= gain[:, None] * row[None, :]


class AxisFilter:
    """One axis, in unwrapped degrees; `lag_s` is the servo's mean lag where the profile tells it."""

    def __init__(self, position_deg: float, noise: Noise | None = None, lag_s: float | None = None) -> None:
        self._noise = noise = noise or Noise()
        self._rate_walk = noise.rate_walk_deg_s_sqrt_s**2
        self._walk = noise.walk_deg_sqrt_s**2
        self._walks = share_spread(noise.late_walk_sqrt_s, 0.0, noise.gain_walk_sqrt_s)
        self._reading = noise.position_deg**2
        self.moves = np.zeros(1 + SHARES)
        """How far the rest of the state moved the position in the last interval."""
        self._first_lag_s = noise.first_lag_s if lag_s is None else lag_s
        self.innovation_sigmas = 0.0
        """The last measurement's surprise, in its own expected sigma."""
        self.innovation_sigma_deg = 1e-2
        """What the last measurement's surprise was expected to be, one sigma."""
        self.begun_anew = 0
        """How often the filter contradicted its measurements, and began anew."""
        self._disturbed = False
        """Whether surprises showed unpredicted motion, of which something may have been learnt."""
        self._noise_share = 1.0
        """Variance of the measurements over the expected one, as innovations show it."""
        self._parted = False
        """Whether gain and rate were parted: where that happens again, it is the motion that is rough."""
        self._trusted: tuple[Array, Array] | None = None
        """Shares and their covariance, from the last motion that was long without surprises."""
        self._begin(position_deg)

    def _begin(self, position_deg: float, kept: Array | None = None) -> None:
        """Begin with a position; `kept` are rate and shares, None for those of an unknown axis.

        A response that was trusted is kept, once: it may be what has changed.
        """
        noise = self._noise
        covariance = np.zeros((2 + SHARES, 2 + SHARES))
        covariance[0, 0], covariance[1, 1] = 1e-4, noise.first_rate_deg_s**2
        covariance[2:, 2:] = share_spread(noise.late, noise.turn, noise.first_gain)
        first = [0.0, *expected_shares(self._first_lag_s)] if kept is None else kept
        if self._trusted is not None:
            shares, known = self._trusted
            first, covariance[2:, 2:] = [float(first[0]), *shares], TRUSTED_SPREAD * known
            self._trusted = None
        self._kalman = LeanKalmanFilter(np.array([position_deg, *first]), covariance)
        self._surprised_deg = 0.0
        """The last measurement's surprise where it was too large, else 0."""
        self._seconds = 1.0
        self._rough_share = 1.0
        """Variance of the motion's own noise over the expected one, as innovations in a row show it."""
        self._may_stick = False
        """Whether the axis was so near rest, as it moved last, that it may stick."""
        self._implausible_s = 0.0
        """For how long the axis has had a rate beside its commands that is implausible."""
        self._last_ratio = 0.0
        """The last surprise in its expected sigma."""
        self._square, self._alike = 1.0, 0.0
        """Means of the squared surprises, and of those times the ones before, over what was expected."""
        self._rough_deg = 0.0
        """By how much rougher than usual the motion was lately expected to be."""
        self._surprises = 1.0
        """Mean of the squared surprises, over what is usual where less was expected."""
        self._taken = self._calm = 0
        self._look()

    def begin_anew(self, position_deg: float) -> None:
        """Begin anew at a position, of a mount whose coordinates have changed or that was long silent."""
        self._disturbed = False
        self._begin(position_deg)

    def _look(self) -> None:
        known = self._kalman
        self.position_deg = float(known.state[0])
        self.disturbance_deg_s = float(known.state[1])
        shares = known.state[2:]
        self.lag: Lag = lag_of(shares)
        self.gain_error = self.lag.whole - 1.0
        self.lag_sigma_s = lag_sigma_s(known.covariance[2:, 2:])

    @property
    def shares(self) -> Array:
        """The shares of the response."""
        shares: Array = self._kalman.state[2:]
        return shares

    @property
    def has_just_begun(self) -> bool:
        """Whether no measurement was taken in since the filter began."""
        return self._taken == 0

    @property
    def innovation_deg(self) -> float:
        """The last measurement's surprise."""
        return self._kalman.innovation_deg

    @property
    def kalman_gain(self) -> Array:
        """What the last measurement's surprise changed the state by, over the surprise."""
        return self._kalman.gain

    def change(self, by: Array) -> None:
        """Change the state: the commands acted at other times, and what was learnt of them is doubtful."""
        noise = self._noise
        self._kalman.state += by
        self._kalman.covariance[2:, 2:] += RELEARNT * share_spread(noise.late, noise.turn, 0.0)
        self._look()

    def expected_sigma_deg(self, jolt_deg_s: float) -> float:
        """Return how far off the next measurement may be, one sigma, after a change of the commanded rate."""
        return math.hypot(self.innovation_sigma_deg, self._noise.response_s * jolt_deg_s)

    def rough_deg(self, jolt_deg_s: float) -> float:
        """Return how much rougher than usual a motion is after a change of the commanded rate, one sigma."""
        return self._noise.response_s * abs(jolt_deg_s)

    def answers_s(self, seconds: float) -> float:
        """Return how far a step of rate has moved the axis so long after it, over the step."""
        return float(self._kalman.state[2:].dot(answers_of(seconds)))

    def moved_deg(self, effects: Array) -> float:
        """Return how far commands move the axis, by their effects."""
        return float(effects.dot(self._kalman.state[2:]))

    def predicted_deg(self, seconds: float, effects: Array) -> float:
        """Return where the axis will be after commands with these effects."""
        drifted_deg: float = self.disturbance_deg_s * seconds
        return self.position_deg + drifted_deg + self.moved_deg(effects)

    def advance(
        self,
        seconds: float,
        displacement_deg: float,
        effects: Array | None = None,
        rough_deg: float = 0.0,
        shaken: bool = False,
    ) -> None:
        """Predict over an interval in which the axis moved by `displacement_deg` and by commands' effects.

        Where there are none, what was moved is what was seen, and says nothing of the response. `rough_deg`
        is the additional uncertainty of the motion, one sigma. `shaken` shortly after a large change of rate:
        surprises that go on to one side are then what the servo's integral learns, a rate that nobody asked
        for. Taken for a rough motion, they would teach no rate.
        """
        self._seconds, self._rough_deg = seconds, rough_deg
        # White noise in rate and in its derivative, integrated over the interval.
        turned_deg = displacement_deg if effects is None else displacement_deg + self.moved_deg(effects)
        # Near rest an axis may stick, however smoothly it moved before: its response is not to explain that.
        self._may_stick = abs(turned_deg) < STICKS_DEG_S * seconds
        rough = max(1.0, self._rough_share) if shaken or self._may_stick else self._rough_share
        drifts = rough if shaken else 1.0
        rate_variance = rough * drifts * self._rate_walk * seconds
        implausible = abs(float(self._kalman.state[1])) - PLAUSIBLE_RATE_DEG_S
        self._implausible_s = self._implausible_s + seconds if implausible > 0.0 else 0.0
        if 0.0 < self._implausible_s <= LASTS_S and self._trusted is not None:
            rate_variance += implausible * implausible * seconds / OVER_S
        own = rough * (self._walk * seconds + rough_deg * rough_deg / drifts)
        own += rate_variance * seconds * seconds / 3.0
        moves = self.moves
        moves[0], moves[1:] = seconds, 0.0 if effects is None else effects
        self._kalman.foretell(moves, displacement_deg)
        self._kalman.fade(1.0 - seconds / self._noise.rate_fades_s)
        # What is not measured after this is where the axis is taken to be.
        self.position_deg = float(self._kalman.state[0])
        walks = self._walks * seconds
        if rough > 1.0:
            # What goes on to one side may be a gain that was learnt wrongly, and too surely, on the way here.
            first = self._noise.first_gain**2
            unknown = max(0.0, first - float(self._kalman.covariance[2:, 2:].sum()))
            gained = min(REOPENED_PER_S * (rough - 1.0) * seconds * first, unknown)
            walks += gained * self.shares[:, None] * self.shares
        self._kalman.blur(own, 0.5 * rate_variance * seconds, rate_variance, walks)

    def doubt_gain(self, commanded_deg_s: float) -> None:
        """Be less sure which part of the motion is the gain's and which a rate that nobody asked for.

        Their sum at this commanded rate is known as well as before. What told them apart was the way to the
        target, with the drive at its limit, where no response describes the motion.
        """
        known, shares = self._kalman, self.shares
        instead = np.array((0.0, -commanded_deg_s * self.lag.whole, *shares))
        instead *= DOUBTED_GAIN
        known.covariance += instead[:, None] * instead
        self._look()

    def doubt_response(self) -> None:
        """Be less sure of the shares: after large changes of the rate, they all err alike."""
        self._kalman.covariance[2:, 2:] *= DOUBTED_SPREAD
        self._look()

    def stand_at(self, position_deg: float) -> None:
        """Take a place as it is seen, of an axis whose motion nothing predicts; all else stays as it is."""
        known = self._kalman
        known.state[0] += wrap180(position_deg - float(known.state[0]))
        known.covariance[0] = known.covariance[:, 0] = 0.0
        known.covariance[0, 0] = self._reading
        self._look()

    def measure(self, position_deg: float, rate_deg_s: float) -> None:
        """Take in a reported position (any turn) of an axis that moves at about `rate_deg_s`."""
        known = self._kalman
        predicted = float(known.state[0])
        surprise = wrap180(position_deg - predicted)
        reading = self._reading + (rate_deg_s * self._noise.timing_s) ** 2
        variance = self._noise_share * reading
        expected = float(known.covariance[0, 0]) + variance
        # However well an axis is known: what is usual for one is no contradiction.
        ratio = surprise * surprise / max(expected, reading + self._rough_deg * self._rough_deg)
        sigmas = surprise / math.sqrt(expected)
        # A glitch counts for no more than a large but ordinary surprise; many of them are noise all the same.
        self._learn_noise(max(-SURPRISE_SIGMAS, min(SURPRISE_SIGMAS, sigmas)), variance / expected)
        large = ratio > SURPRISING
        if not (large and self._sets_in(surprise, rate_deg_s)):
            # It may be a glitch, and is believed only as far as a large but ordinary surprise would be.
            variance += max(0.0, surprise * surprise / SURPRISING - expected)
        self._surprised_deg = surprise if large else 0.0
        self._surprises += STEADY * (min(ratio, MOST_RATIO) - self._surprises)
        self._taken += 1
        known.correct(predicted + surprise, variance)
        self.innovation_sigma_deg = math.sqrt(known.innovation_variance)
        self.innovation_sigmas = known.innovation_deg / self.innovation_sigma_deg
        if self._taken > SHORTEST_TRIAL:
            self._judge(predicted + surprise)
        self._look()

    def _judge(self, measured_deg: float) -> None:
        """Begin anew where the filter contradicts its measurements, and after a disturbed motion.

        Then the response and the rate are kept where they are likely ones, but no longer relied upon. Of gain
        and rate, steady motion shows only what both come to together, so it would not correct them.
        """
        self._calm = self._calm + 1 if self._surprises < CALM else 0
        if self._calm >= TRUSTED_SAMPLES and self._calm % TRUSTED_EVERY == 0:
            kalman = self._kalman
            self._trusted = kalman.state[2:].copy(), kalman.covariance[2:, 2:].copy()
        # What a new filter is surprised at soon after its beginning may be the axis itself.
        self._disturbed = self._disturbed or self._surprises > DISTURBED
        if self._surprises > LOST:
            self.begun_anew += 1
            # It may have been too sure of its measurements.
            self._noise_share = min(LARGEST_NOISE_SHARE, 2.0 * self._noise_share)
            self._begin(measured_deg)
        elif self._disturbed and self._surprises < CALM and self._taken > 2 * SHORTEST_TRIAL:
            self._disturbed = False
            known, noise = self._kalman.state, self._noise
            gain_error = float(sum(known[2:].tolist())) - 1.0
            likely = abs(gain_error) <= LIKELY_SIGMAS * noise.first_gain + ROUNDING
            likely &= abs(float(known[1])) <= LIKELY_SIGMAS * noise.first_rate_deg_s
            self.begun_anew += not likely
            self._begin(measured_deg, known[1:] if likely else None)
        elif not self._parted and self._surprises < CALM and self._taken > 2 * SHORTEST_TRIAL:
            self._part_gain_and_rate(measured_deg)

    def _part_gain_and_rate(self, measured_deg: float) -> None:
        """Begin anew where gain and rate are both unlikely and cancel: the axis obeys, and both are wrong.

        Such a pair is learnt on the way to a target, too surely. While it lasts, the rate has to follow every
        change of the commanded one, and comes late. The response is kept but for its gain.
        """
        rate_deg_s, noise = float(self._kalman.state[1]), self._noise
        most_deg_s = LIKELY_SIGMAS * noise.first_rate_deg_s
        gain_error = self.gain_error
        if abs(rate_deg_s) <= most_deg_s or abs(gain_error) <= LIKELY_SIGMAS * noise.first_gain:
            return
        whole = 1.0 + gain_error
        commanded_deg_s = self.moved_deg(self.moves[1:]) / whole / self._seconds
        left_deg_s = rate_deg_s + gain_error * commanded_deg_s
        if abs(left_deg_s) < most_deg_s:
            self._parted, self._trusted = True, None
            self._begin(measured_deg, np.array([left_deg_s, *(self.shares / whole)]))

    def _learn_noise(self, sigmas: float, measured: float) -> None:
        """Let the noises follow, slowly, what a surprise and the one before are against expectation.

        Surprises that go on to one side are motion that was not predicted; those that go to and fro are noise
        of the measurements (Mehra 1970), of which they tell as much as it has a share in them, `measured`.
        Where both noises are what they are taken for, one surprise tells nothing of the next.
        """
        alike, self._last_ratio = sigmas * self._last_ratio, sigmas
        learning = self._noise.learning
        against = measured * (sigmas * sigmas - 1.0 - 2.0 * alike)
        share = self._noise_share * (1.0 + learning * against)
        self._noise_share = max(SMALLEST_NOISE_SHARE, min(LARGEST_NOISE_SHARE, share))
        self._square += STEADY * (sigmas * sigmas - self._square)
        self._alike += STEADY * (alike - self._alike)
        # Motion that is less rough than expected leaves surprises that are too small, and hardly to one side.
        one_sided = min(1.0, max(0.0, self._alike) / ONE_SIDED)
        smooth = (1.0 - measured) * (1.0 - one_sided) * min(0.0, self._square - 1.0)
        if self._may_stick:
            # Less is expected there than shows.
            smooth = 0.0
        rough = self._rough_share * (1.0 + ROUGH_LEARNING * learning * (alike + smooth))
        if alike > SURELY_ALIKE:
            rough = max(rough, min(1.0, alike * self._rough_share))
        self._rough_share = max(SMALLEST_ROUGH_SHARE, min(LARGEST_ROUGH_SHARE, rough))

    def _sets_in(self, surprise_deg: float, rate_deg_s: float) -> bool:
        """Tell whether a large surprise is the second to the same side, and allow for what it means then.

        That is a rate that has set in, which the filter then learns at once; an axis near rest, that friction
        may hold, is where it stands.
        """
        if surprise_deg * self._surprised_deg <= 0.0:
            return False
        covariance, disturbance_deg_s = self._kalman.covariance, float(self._kalman.state[1])
        gone = abs(disturbance_deg_s) > PLAUSIBLE_RATE_DEG_S and disturbance_deg_s * surprise_deg < 0.0
        if abs(rate_deg_s) >= NEAR_REST_DEG_S or gone:
            covariance[1, 1] += min(abs(surprise_deg) / self._seconds, LARGEST_RATE_DEG_S) ** 2
        covariance[0, 0] += surprise_deg * surprise_deg
        return True

"""How an axis answers commands: how much of a change of rate has come out so long after it began to act.

The answer is given as shares of the change, one for each of the lags between KNOTS_S (the first at once): a
finite impulse response. So a servo of any kind is described by numbers in which the motion is linear, and
which a Kalman filter can learn: velocity loops, position loops that catch up, planners that come a turn late.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

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
_SPAN_STARTS = [_LAGS_S.index(a) for a in KNOTS_S[:-1]]
_SPAN_ENDS = [_LAGS_S.index(b) for b in KNOTS_S[1:]]
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
    how well the motion is foretold.
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
        moved = np.array(self._at_lags(to_s)) - np.array(self._at_lags(from_s))
        del self._utc_s[count:], self._steps[count:]
        return np.concatenate(
            (moved[:2, :_FIRST], (moved[2:, _SPAN_STARTS] - moved[2:, _SPAN_ENDS]) / _SPAN_WIDTHS_S), axis=1
        )

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


def answered_s(shares: Array, seconds: float) -> float:
    """Return how far a step of rate has moved the axis so long after it, over the step."""
    since_s = np.maximum(seconds - _STARTS, 0.0)
    into_s = np.minimum(since_s, _WIDTHS)
    moved_s = since_s - into_s + 0.5 * into_s * into_s / np.maximum(_WIDTHS, SHORTEST_S)
    return float(shares.dot(moved_s))


def lag_of(shares: Array) -> Lag:
    """Return the mean lag of a response and its spread."""
    whole, first_s, square_s2 = (_MOMENTS * shares).sum(axis=1).tolist()
    mean_s = first_s / whole
    return Lag(mean_s, square_s2 / whole - mean_s * mean_s, whole)


def lag_sigma_s(covariance: Array) -> float:
    """Return one sigma of the mean lag for the covariance of the shares."""
    variance = float(((covariance * _MIDDLES).sum(axis=1) * _MIDDLES).sum())
    return math.sqrt(max(0.0, variance))


def _total(values: Array) -> float:
    return float(sum(values.tolist()))


def expected(lag_s: float) -> Array:
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


def spread(late_sigma: float, turn_sigma: float, gain_sigma: float) -> Array:
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

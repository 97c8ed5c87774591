"""The round trip, from which status is the first to acknowledge what was sent when.

The mount looks into its mailbox once a loop. A command sent at S is seen in the loop of the status that
arrives at A exactly where A - S is at least the round trip, so each flag raised or lowered puts the round
trip between the status before and the status that first shows it. Single delays scatter by an amount that is
estimated as well; brackets that miss by many times that are counted as strays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    are told by the fastest arrivals.
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
    # Logistic: its wings are heavier than a normal one's, as those of network delays are.
    step: Array = 1.0 / (1.0 + np.exp(-np.clip(x, -40.0, 40.0)))
    return step


@dataclass(slots=True)
class RoundTripEstimate:
    """What brackets say of the round trip: a probability for each value and each scatter of single delays."""

    _seconds: Array = field(default_factory=lambda: np.arange(0.0, LONGEST_S, STEP_S))
    _scatters: Array = field(default_factory=lambda: np.array(SCATTERS_S)[:, None])
    _log: Array = field(init=False)
    _brackets: list[Bracket] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Begin with nothing known."""
        self._log = np.zeros((len(SCATTERS_S), len(self._seconds)))

    def add(self, bracket: Bracket) -> None:
        """Take one bracket."""
        self._brackets.append(bracket)
        above = _step((bracket.within_s - self._seconds) / self._scatters)
        below = _step((bracket.above_s - self._seconds) / self._scatters)
        self._log += np.log((1.0 - STRAY_SHARE) * np.maximum(above - below, 0.0) + STRAY_SHARE * 0.05)

    @property
    def median_s(self) -> float:
        """The value that the truth is as likely above as below."""
        cumulative = np.cumsum(self._marginal())
        return float(self._seconds[np.searchsorted(cumulative, 0.5)])

    def result(self) -> RoundTrip:
        """Return what is known."""
        probability = self._marginal()
        mean = float((probability * self._seconds).sum())
        sigma = float(np.sqrt((probability * (self._seconds - mean) ** 2).sum()))
        weights = np.exp(self._log - self._log.max()).sum(axis=1)
        scatter = float((weights * self._scatters[:, 0]).sum() / weights.sum())
        far = STRAY_BEYOND * scatter + 3.0 * sigma
        strays = sum(1 for b in self._brackets if mean < b.above_s - far or mean > b.within_s + far)
        return RoundTrip(mean, mean, max(sigma, STEP_S), scatter, len(self._brackets), strays)

    def _marginal(self) -> Array:
        probability: Array = np.exp(self._log - self._log.max()).sum(axis=0)
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

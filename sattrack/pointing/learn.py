"""What recorded passes teach of a mount: its axes' errors that repeat in a turn, its pointing model. Pure.

In one pass an orbit, wrong dates and the pointing model may look like much; a wave of an axis' angle that
none of them makes, and that is the same in every pass, is the gear's. Each pass has its own orbit, dates and
image, and its own small change of the mount: they are fitted with it, each as far as it may be off
(ridge regression: Hoerl and Kennard, Technometrics 12, 55, 1970), and what is left is shared. A wave is
taken where it lowers what is left at passes that were held out of its fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.core.errors import SattrackError
from sattrack.mount.model import PeriodicErrors, Wave

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MOST_CYCLES = 720
MOST_WAVES = 8
FOUND_POWER = 40.0
"""Power of a wave over the noise's from which on it may be one: by chance once in some 100,000 fits."""
NEIGHBOURS = 3
LEAST_SHARE = 0.1
"""So much of a wave must be left where orbit and pointing model have taken what they can of it."""
LEAST_GAIN, WORSE_BY = 9.0, 4.0
"""By how much a wave lowers the held-out passes' squares, at least; by how much it may raise one of them."""
OTHER_SHARE, SURE_SIGMAS = 0.5, 4.0
"""A pass contradicts the others where it shows less than that share of their waves, so surely."""
KEPT_WIDER = 1.5
"""A table's waves are taken for so many times less well known at later passes: gears wear."""
WALK_ARCSEC = 3.0
"""How much a pointing model's terms may have changed since it was made, one sigma of each."""
LEAST_BETTER, PASS_WORSE = 0.98, 1.05
SPAN_DEG = 5.0
WILD_SIGMAS, ROUNDS = 6.0, 4
FEWEST_PASSES = 2


class Prior(NamedTuple):
    """The pointing terms' names; how far off each may be in the mean of passes, and at any one; arcseconds.

    `known` where they are those of a model; else they stand for one that nobody made.
    """

    names: tuple[str, ...]
    mean_arcsec: Array
    apart_arcsec: Array
    known: bool


@dataclass(frozen=True, slots=True)
class PassResiduals:
    """What cameras saw at one pass, (n, 2): on the sky towards growing angles of both axes, arcseconds.

    `left` is where the axes should stand less where they report to stand; `sigma` is of each, (n,).
    `on_sky` is what a second of arc of each axis' error makes there: 0 where nothing of the mount shows.
    `own`, (n, 2, k), are columns of what is this pass' alone, one sigma of each; `terms`, (n, 2, m), those of
    the pointing terms of `prior`, a second of arc of each.
    """

    utc: str
    left: Array
    sigma: Array
    angles_deg: Array
    on_sky: Array
    own: Array
    terms: Array
    prior: Prior

    def own_fit(self) -> Array:
        """Return the part of the columns that is this pass' alone, in their sigmas, fitted robustly."""
        return _Pass(self).fitted()[: self.own.shape[2]]


class HeldOut(NamedTuple):
    """One pass, held against what the others teach: what is left on the sky without that and with it, RMS."""

    utc: str
    without_arcsec: float
    with_arcsec: float


@dataclass(frozen=True, slots=True)
class Learnt:
    """What passes have taught; `notes` say what was not taken, and why."""

    periodic: PeriodicErrors | None
    held_out: tuple[HeldOut, ...]
    terms: dict[str, tuple[float, float]] | None
    """By how much the pointing model's terms change, and one sigma of each after it; None for none."""
    terms_held_out: tuple[HeldOut, ...]
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Pass:
    """One pass with weights, and the columns that are its own taken out of whatever is asked."""

    seen: PassResiduals
    weight: Array = field(init=False)
    columns: Array = field(init=False)
    nuisance: Array = field(init=False)
    inverse: Array = field(init=False)

    def __post_init__(self) -> None:
        """Weigh what was seen by the sigmas that came with it, wild ones out."""
        self.weight = 1.0 / self.seen.sigma
        self.set_nuisance(pass_alone=True)
        self.reweigh(np.zeros_like(self.seen.left))

    def set_nuisance(self, pass_alone: bool) -> None:
        """Take the mount's terms as unknown at this pass, or but for what changes from pass to pass."""
        prior = self.seen.prior
        sigmas = np.hypot(prior.mean_arcsec, prior.apart_arcsec) if pass_alone else prior.apart_arcsec
        self.columns = np.concatenate([self.seen.own, self.seen.terms * sigmas], axis=2)
        self.nuisance = self.white(self.columns)
        normal = self.nuisance.T @ self.nuisance + np.eye(self.nuisance.shape[1])
        self.inverse = np.linalg.inv(normal).astype(np.float64)

    def white(self, values: Array) -> Array:
        """Return values of shape (n, 2) or (n, 2, m) by their weights, as rows."""
        weights = self.weight[:, None] if values.ndim == 2 else self.weight[:, None, None]
        return (values * weights).reshape(2 * len(values), *values.shape[2:])

    def fitted(self, explained: Array | float = 0.0) -> Array:
        """Return the nuisance's values, in their sigmas, once `explained`, (n, 2), is taken away."""
        found: Array = self.inverse @ (self.nuisance.T @ self.white(self.seen.left - explained))
        return found

    def off(self, values: Array) -> Array:
        """Return what is left of whitened rows when the nuisance has taken its part."""
        left: Array = values - self.nuisance @ (self.inverse @ (self.nuisance.T @ values))
        return left

    def square(self, values: Array) -> float:
        """Return the sum of squares of whitened rows, and of the nuisance that takes its part of them."""
        return float(values @ self.off(values))

    def reweigh(self, explained: Array) -> None:
        """Set the weights by how what is left scatters, once `explained`, (n, 2), is taken away."""
        for _ in range(ROUNDS):
            left = self.off(self.white(self.seen.left - explained)).reshape(-1, 2)
            with np.errstate(divide="ignore", invalid="ignore"):
                size = np.hypot(*left.T) / (self.weight * self.seen.sigma)
            # Of a plane's normal errors half are within 1.18 sigma of the middle.
            size = np.where(self.weight > 0.0, size, math.inf)
            typical = float(np.median(size[np.isfinite(size)])) / 1.1774
            arcsec = np.hypot(*(self._plain_left(explained)).T) / self.seen.sigma
            scatter = max(typical, 0.2)
            self.weight = np.where(arcsec < WILD_SIGMAS * scatter, 1.0 / (self.seen.sigma * scatter), 0.0)
            self.set_nuisance(pass_alone=True)

    def _plain_left(self, explained: Array) -> Array:
        left: Array = self.seen.left - explained - self.columns @ self.fitted(explained)
        return left

    def waves(self, axis: int, cycles: Array) -> Array:
        """Return columns of sines and cosines of an axis' angle on the sky, (n, 2, 2 m): s, c, s, c, ..."""
        angle = np.radians(self.seen.angles_deg[:, axis])[:, None] * cycles
        both = np.stack([np.sin(angle), np.cos(angle)], axis=2).reshape(len(angle), -1)
        columns = np.zeros((len(angle), 2, both.shape[1]))
        columns[:, axis] = both * self.seen.on_sky[:, axis, None]
        return columns

    def spectrum(self, axis: int, left: Array) -> tuple[Array, ...]:
        """Return, for 1 to MOST_CYCLES cycles, what decides how much a wave of an axis explains.

        Sums over the pass, the nuisance's part taken out: of squared cosines, of cosines times sines, of
        squared sines; of both, as a complex number, times the whitened rows that are `left`; and half of the
        squares of both before the nuisance takes its part.
        """
        turn = np.exp(1j * np.radians(self.seen.angles_deg[:, axis]))
        waves = np.cumprod(np.repeat(turn[:, None], MOST_CYCLES, axis=1), axis=1)
        waves *= (self.seen.on_sky[:, axis] * self.weight)[:, None]
        part = waves.T @ self.nuisance.reshape(len(turn), 2, -1)[:, axis]
        root = part @ np.linalg.cholesky(self.inverse)
        squares, whole = np.sum(waves**2, axis=0), np.sum(np.abs(waves) ** 2, axis=0)
        cosines = 0.5 * (whole + squares.real) - np.sum(root.real**2, axis=1)
        sines = 0.5 * (whole - squares.real) - np.sum(root.imag**2, axis=1)
        both = 0.5 * squares.imag - np.sum(root.real * root.imag, axis=1)
        return cosines, both, sines, waves.T @ left.reshape(-1, 2)[:, axis], 0.5 * whole

    def rms_arcsec(self, explained: Array) -> float:
        """Return what is left on the sky, the nuisance fitted, wild ones apart."""
        left = self._plain_left(explained)[self.weight > 0.0]
        return float(np.sqrt(np.mean(np.sum(np.square(left), axis=1))))


Key = tuple[int, int]
"""An axis and a number of cycles."""


def learn(
    passes: Sequence[PassResiduals], names: Sequence[str], before: PeriodicErrors | None = None
) -> Learnt:
    """Return what passes teach; `names` are those of their files, `before` a table of earlier passes.

    Raises SattrackError where there are too few passes, where one contradicts the others, or is given twice.
    """
    notes: list[str] = []
    for k, one in enumerate(passes):
        # Held against itself a pass proves whatever it shows.
        twice = next((j for j in range(k) if np.array_equal(passes[j].left, one.left)), None)
        if twice is not None:
            raise SattrackError(f"{names[k]}: it is the same pass as {names[twice]}: give it once")
    if before is not None and any(one.utc <= before.utc for one in passes):
        notes.append(
            f"the table of {before.utc[:10]} is made anew: it may have been learnt from these passes"
        )
        before = None
    held = [_Pass(one) for one in passes]
    if before is not None and _contradicted(held, names, before):
        notes.append(
            f"the table of {before.utc[:10]} does not hold any more: the mount was homed or synced elsewhere"
        )
        before = None
    if before is None and len(held) < FEWEST_PASSES:
        why = f" ({notes[-1]})" if notes else ""
        raise SattrackError(
            f"{names[0]}: one pass teaches nothing that is proven by another{why}; give {FEWEST_PASSES}"
        )
    table = _Table(held, before)
    table.search()
    table.check(names)
    table.prune()
    table.check(names)
    outcome = table.held_out()
    periodic = table.errors(passes[-1].utc, outcome) if table.keys else None
    if periodic is None:
        notes.append("no wave of an axis' angle makes held-out passes better")
    corrected, of_terms, note = _terms(table, held)
    return Learnt(periodic, outcome, corrected, of_terms, (*notes, *note))


def _contradicted(held: Sequence[_Pass], names: Sequence[str], before: PeriodicErrors) -> bool:
    """Tell whether passes show that a table is not the mount's any more, all of them that show anything."""
    table = _Table(held, before)
    found = [table.shown(one, table.amplitudes(())) for one in held]
    against = [share + SURE_SIGMAS * sigma < OTHER_SHARE for share, sigma in found]
    supported = [share - SURE_SIGMAS * sigma > OTHER_SHARE for share, sigma in found]
    if any(against) and any(supported):
        first = names[against.index(True)]
        raise SattrackError(
            f"{first}: it contradicts the table of {before.utc[:10]}, and other passes support that: give "
            "those from before the mount was homed or synced, or those from after it"
        )
    return any(against)


class _Table:
    """Waves that passes share, and what each pass says of them."""

    def __init__(self, held: Sequence[_Pass], before: PeriodicErrors | None) -> None:
        self.held, self.before = list(held), before
        self.keys: list[Key] = []
        self._known: dict[Key, Wave] = {}
        for axis, waves in enumerate(() if before is None else (before.first, before.second)):
            self._known |= {(axis, wave.cycles): wave for wave in waves}
        self.keys = list(self._known)

    def columns(self, one: _Pass, keys: Sequence[Key] | None = None) -> Array:
        """Return a pass' columns of the waves, (n, 2, 2 m)."""
        keys = self.keys if keys is None else keys
        if not keys:
            return np.zeros((len(one.seen.left), 2, 0))
        return np.concatenate([one.waves(axis, np.array([float(n)])) for axis, n in keys], axis=2)

    def _normal(self, without: Sequence[_Pass]) -> tuple[Array, Array]:
        count = 2 * len(self.keys)
        normal, pull = 1e-12 * np.eye(count), np.zeros(count)
        for place, key in enumerate(self.keys):
            wave = self._known.get(key)
            if wave is not None:
                weight = 1.0 / (KEPT_WIDER * wave.sigma_arcsec) ** 2
                for k, value in enumerate((wave.sin_arcsec, wave.cos_arcsec)):
                    normal[2 * place + k, 2 * place + k] += weight
                    pull[2 * place + k] += weight * value
        for one in self.held:
            if not any(one is other for other in without):
                columns = one.white(self.columns(one))
                clear = one.off(columns)
                normal += columns.T @ clear
                pull += clear.T @ one.white(one.seen.left)
        return normal, pull

    def amplitudes(self, without: Sequence[_Pass]) -> Array:
        """Return the waves' sines and cosines, arcseconds, by all passes but some."""
        normal, pull = self._normal(without)
        found: Array = np.linalg.solve(normal, pull).astype(np.float64)
        return found

    def search(self) -> None:
        """Take the strongest waves, one after the other, as long as they stand out of the noise."""
        while len(self.keys) < MOST_WAVES:
            amplitudes = self.amplitudes(())
            left = [one.off(one.white(one.seen.left - self.columns(one) @ amplitudes)) for one in self.held]
            powers = np.stack([self._powers(axis, left) for axis in (0, 1)])
            for axis, cycles in self.keys:
                powers[axis, cycles - 1] = 0.0
            axis, at = divmod(int(np.argmax(powers)), MOST_CYCLES)
            if powers[axis, at] < FOUND_POWER:
                return
            self.keys.append((axis, at + 1))
            # The wave's own part of the scatter was in the weights.
            for _ in range(2):
                self._settle()
                amplitudes = self.amplitudes(())
                for one in self.held:
                    one.reweigh(self.columns(one) @ amplitudes)

    def _settle(self) -> None:
        """Move each wave to the number of cycles with which all of them leave least.

        Over a part of a turn neighbours are alike, and the first wave that was taken had others in its way.
        """
        moving = True
        while moving:
            moving = False
            for place, (axis, cycles) in enumerate(self.keys):
                if (axis, cycles) in self._known:
                    continue
                kept = list(self.keys)
                tried = [(axis, n) for n in range(max(1, cycles - NEIGHBOURS), cycles + NEIGHBOURS + 1)]
                left = {}
                for key in (one for one in tried if one == kept[place] or one not in kept):
                    self.keys = [*kept[:place], key, *kept[place + 1 :]]
                    left[key] = self._square()
                best = min(left, key=lambda key: left[key])
                self.keys = [*kept[:place], best, *kept[place + 1 :]]
                moving |= best != kept[place]

    def _square(self) -> float:
        """Return what the waves leave of all passes."""
        amplitudes = self.amplitudes(())
        return sum(one.square(one.white(one.seen.left - self.columns(one) @ amplitudes)) for one in self.held)

    def _powers(self, axis: int, left: Sequence[Array]) -> Array:
        """Return the power over the noise of 1, 2, ... cycles of an axis, by all passes together."""
        sums = [one.spectrum(axis, rest) for one, rest in zip(self.held, left, strict=True)]
        cosines, both, sines, pull, whole = (sum(part) for part in zip(*sums, strict=True))
        by_cosine, by_sine = pull.real, pull.imag
        determinant = np.maximum(cosines * sines - both * both, 1e-12)
        power = sines * by_cosine**2 - 2.0 * both * by_cosine * by_sine + cosines * by_sine**2
        half, apart = 0.5 * (cosines + sines), np.hypot(0.5 * (cosines - sines), both)
        found: Array = np.where(half - apart > LEAST_SHARE * whole, power / determinant, 0.0)
        return found

    def shown(self, one: _Pass, amplitudes: Array) -> tuple[float, float]:
        """Return which share of some waves a pass shows, and one sigma."""
        wave = one.white(self.columns(one) @ amplitudes)
        clear = one.off(wave)
        size = float(wave @ clear)
        if size <= 0.0:
            return 0.0, math.inf
        return float(clear @ one.white(one.seen.left)) / size, 1.0 / math.sqrt(size)

    def check(self, names: Sequence[str]) -> None:
        """Raise SattrackError where a pass contradicts what the others show."""
        if not self.keys or (self.before is None and len(self.held) < FEWEST_PASSES):
            return
        for one, name in zip(self.held, names, strict=True):
            amplitudes = self.amplitudes((one,))
            share, sigma = self.shown(one, amplitudes)
            if share + SURE_SIGMAS * sigma < OTHER_SHARE:
                raise SattrackError(
                    f"{name}: {self._turned(one, amplitudes)}: the mount was homed or synced elsewhere "
                    "between the passes, and no table holds for all; give those from one side of that"
                )

    def _turned(self, one: _Pass, amplitudes: Array) -> str:
        """Say how the strongest wave is turned at a pass against the others."""
        at = int(np.argmax(np.hypot(amplitudes[0::2], amplitudes[1::2])))
        axis, cycles = self.keys[at]
        columns = one.white(self.columns(one, [self.keys[at]]))
        clear = one.off(columns)
        sine, cosine = np.linalg.lstsq(columns.T @ clear, clear.T @ one.white(one.seen.left), rcond=1e-9)[0]
        turn = math.atan2(cosine, sine) - math.atan2(amplitudes[2 * at + 1], amplitudes[2 * at])
        turn_deg = math.degrees(math.remainder(turn, 2.0 * math.pi))
        words = "first" if axis == 0 else "second"
        return (
            f"its wave of {cycles} a turn of the {words} axis is turned by {turn_deg:+.0f}° against the "
            f"other passes', {turn_deg / cycles:+.2f}° of the axis"
        )

    def prune(self) -> None:
        """Drop the waves that do not make held-out passes better."""
        while self.keys:
            gains = [self._gain(place) for place in range(len(self.keys))]
            worst = min(range(len(gains)), key=lambda place: gains[place])
            if gains[worst] > 0.0:
                return
            del self.keys[worst]

    def _gain(self, place: int) -> float:
        """Return by how much a wave lowers the squares of held-out passes; 0 or less for too little."""
        gains = []
        for one in self.held:
            amplitudes = self.amplitudes((one,))
            other = amplitudes.copy()
            other[2 * place : 2 * place + 2] = 0.0
            columns = self.columns(one)
            without, within = (
                one.square(one.white(one.seen.left - columns @ a)) for a in (other, amplitudes)
            )
            gains.append(without - within)
        return sum(gains) if min(gains) > -WORSE_BY and sum(gains) > LEAST_GAIN else min(0.0, sum(gains))

    def held_out(self) -> tuple[HeldOut, ...]:
        """Return what is left at each pass, without a table and with that of the others."""
        return tuple(
            HeldOut(
                one.seen.utc,
                one.rms_arcsec(np.zeros_like(one.seen.left)),
                one.rms_arcsec(self.columns(one) @ self.amplitudes((one,))),
            )
            for one in self.held
        )

    def errors(self, utc: str, outcome: Sequence[HeldOut]) -> PeriodicErrors:
        """Return the table for a profile."""
        amplitudes, covariance = self.amplitudes(()), np.linalg.inv(self._normal(())[0])
        waves: tuple[list[Wave], list[Wave]] = ([], [])
        for place, (axis, cycles) in enumerate(self.keys):
            sine, cosine = (round(float(one), 3) for one in amplitudes[2 * place : 2 * place + 2])
            spread = 0.5 * float(np.trace(covariance[2 * place : 2 * place + 2, 2 * place : 2 * place + 2]))
            waves[axis].append(Wave(cycles, sine, cosine, round(max(math.sqrt(spread), 0.001), 3)))
        without, within = (math.sqrt(one / len(outcome)) for one in _squares(outcome))
        passes = len(self.held) + (0 if self.before is None else self.before.passes)
        first, second = (tuple(sorted(one, key=lambda wave: wave.cycles)) for one in waves)
        seen = [self._spans(axis) for axis in (0, 1)]
        return PeriodicErrors(
            utc, passes, first, second, seen[0], seen[1], round(without, 3), round(within, 3)
        )

    def _spans(self, axis: int) -> tuple[tuple[float, float], ...]:
        """Return the angles of an axis that passes have covered, in whole steps of SPAN_DEG, joined."""
        bins = {int(angle // SPAN_DEG) for one in self.held for angle in one.seen.angles_deg[:, axis] % 360.0}
        for low, high in (
            () if self.before is None else (self.before.first_seen_deg, self.before.second_seen_deg)[axis]
        ):
            bins |= set(range(round(low / SPAN_DEG), round(high / SPAN_DEG)))
        spans: list[tuple[float, float]] = []
        for number in sorted(bins):
            low = number * SPAN_DEG
            if spans and spans[-1][1] == low:
                low = spans.pop()[0]
            spans.append((low, (number + 1) * SPAN_DEG))
        return tuple(spans)


def _terms(
    table: _Table, held: Sequence[_Pass]
) -> tuple[dict[str, tuple[float, float]] | None, tuple[HeldOut, ...], tuple[str, ...]]:
    """Return by how much the pointing model's terms change, and what that makes of held-out passes."""
    prior = held[0].seen.prior
    if not prior.known:
        return None, (), ("the profile has no pointing model to correct: make one with `sattrack star-run`",)
    if len(held) < FEWEST_PASSES:
        return None, (), ("one pass alone does not correct the pointing model",)
    amplitudes = table.amplitudes(())
    parts = []
    for one in held:
        one.set_nuisance(pass_alone=False)
        columns = one.white(one.seen.terms)
        clear = one.off(columns)
        left = one.seen.left - table.columns(one) @ amplitudes
        parts.append((columns.T @ clear, clear.T @ one.white(left), left))
    expected = np.diag(1.0 / (prior.mean_arcsec**2 + WALK_ARCSEC**2))

    def change(without: int | None) -> tuple[Array, Array]:
        taken = [part for k, part in enumerate(parts) if k != without]
        covariance: Array = np.linalg.inv(expected + sum(part[0] for part in taken)).astype(np.float64)
        return covariance @ sum(part[1] for part in taken), covariance

    outcome = []
    for k, one in enumerate(held):
        found, _ = change(k)
        rest = [_own_rms(one, parts[k][2] - by) for by in (0.0, one.seen.terms @ found)]
        outcome.append(HeldOut(one.seen.utc, *rest))
    without, within = _squares(outcome)
    worse = any(one.with_arcsec > PASS_WORSE * one.without_arcsec for one in outcome)
    if worse or within > LEAST_BETTER**2 * without:
        return None, tuple(outcome), ("no change of the pointing model makes held-out passes better",)
    found, covariance = change(None)
    sigmas = np.sqrt(np.diag(covariance))
    return (
        {name: (float(a), float(b)) for name, a, b in zip(prior.names, found, sigmas, strict=True)},
        tuple(outcome),
        (),
    )


def _squares(outcome: Sequence[HeldOut]) -> tuple[float, float]:
    """Return the sums of squares of what is left, without and with."""
    return sum(one.without_arcsec**2 for one in outcome), sum(one.with_arcsec**2 for one in outcome)


def _own_rms(one: _Pass, left: Array) -> float:
    """Return what is left on the sky when only orbit, dates and image are fitted to a pass."""
    own = one.white(one.seen.own)
    values = np.linalg.solve(own.T @ own + np.eye(own.shape[1]), own.T @ one.white(left))
    rest = (left - one.seen.own @ values)[one.weight > 0.0]
    return float(np.sqrt(np.mean(np.sum(np.square(rest), axis=1))))

"""How well observations tell a satellite's biases: 3 s late elements, one plate solution a second.

python bench/bias.py [--seeds N] [--pass ISS|KANOPUS]

The true satellite is SGP4 with the elements' epoch moved by 3 s; its astrometric places carry noise of 20″ an
axis and go, as messages, through the program's own estimator. Solutions begin at the pass' rise to 10°, or
later. For every n: the share of seeds in which the estimate is within two of its own sigmas, along and
across, and in which the error on the sky is within 2.5 times 20″ over the root of n: over the arc of the n
solutions (RMS), and at the instant of the last. Beside the latter, the share that the best possible has.
"""

from __future__ import annotations

import argparse
import math
import random
from dataclasses import dataclass, replace

import numpy as np

from sattrack.control.biases import Course
from sattrack.control.steering import Estimator
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import choose_pass
from sattrack.views.messages import Observation, decode_message, encode_message
from tle.bias import NO_BIAS, Bias
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

LATE_S = 3.0
SIGMA_ARCSEC = 20.0
FACTOR = 2.5
COUNTS = (1, 2, 3, 5, 10, 20, 50, 100, 150, 200, 300, 400)
STARTS = {"from the rise": None, "from 60 s before culmination": -60, "from culmination": 0}
KANOPUS = (
    "1 38707U 12039A   24247.82317651  .00138984  00000-0  16635-2 0  9998",
    "2 38707  97.4945 189.8924 0007050 108.0286 252.1739 15.60479551673427",
)


@dataclass(frozen=True)
class Pass:
    """A pass: what is believed of the satellite, and how it really goes; UTC as POSIX seconds."""

    name: str
    believed: Propagator
    true: Propagator
    rise_s: float
    culminate_s: float
    set_s: float


def passes() -> dict[str, Pass]:
    """Return the two passes."""
    return {
        "ISS": _pass("ISS", demo_pass.elements(), demo_pass.SITE.place(), Utc.parse(demo_pass.BEFORE_PASS)),
        "KANOPUS": _pass(
            "KANOPUS",
            Elements.from_tle(*KANOPUS, "KANOPUS-V 1"),
            Site(48.6622, 34.8862, 0.0),
            Utc.parse("2024-09-04T23:57:00Z"),
        ),
    }


def _pass(name: str, elements: Elements, site: Site, now: Utc, late_s: float = LATE_S) -> Pass:
    found = choose_pass(elements, site, now, 10.0)
    assert found.rise_utc is not None
    assert found.set_utc is not None
    rise_s, culminate_s, set_s = (
        math.ceil(float(t.unix_s)) for t in (found.rise_utc, found.culminate_utc, found.set_utc)
    )
    return Pass(
        name,
        Propagator(elements, site, refraction=Refraction.standard(site.height_m)),
        true_satellite(elements, site, late_s),
        rise_s,
        culminate_s,
        set_s,
    )


def true_satellite(elements: Elements, site: Site, ahead_s: float) -> Propagator:
    """Return a satellite that runs ahead of its elements by so many seconds, their epoch being earlier."""
    return Propagator(replace(elements, epoch=Utc(float(elements.epoch.unix_s) - ahead_s)), site)


def solution(true: Propagator, utc_s: float, rng: random.Random, sigma_arcsec: float) -> Observation:
    """Return a plate solution of the true satellite at an instant, its noise drawn."""
    seen = true.with_place("astrometric").at(Utc(utc_s))
    return noisy(float(seen.ra_deg), float(seen.dec_deg), utc_s, rng, sigma_arcsec)


def noisy(
    ra_deg: float, dec_deg: float, utc_s: float, rng: random.Random, sigma_arcsec: float
) -> Observation:
    """Return an astrometric place with noise, as a message."""
    noise_deg = sigma_arcsec / 3600.0
    north_deg = rng.gauss(0.0, noise_deg)
    east_deg = rng.gauss(0.0, noise_deg) / math.cos(math.radians(dec_deg))
    return Observation(
        Utc(utc_s).isoformat("microseconds"),
        (ra_deg + east_deg) % 360.0,
        dec_deg + north_deg,
        "icrs",
        sigma_arcsec,
    )


@dataclass
class Arc:
    """One second after another of a pass from some start on: true places, and what the geometry is there."""

    one: Pass
    start_s: float

    def __post_init__(self) -> None:
        self.course = Course(self.one.believed)
        count = min(COUNTS[-1], int(self.one.set_s - self.start_s))
        self.instants = [self.start_s + second for second in range(count)]
        astrometric = self.one.true.with_place("astrometric")
        self.places = [
            (float(seen.ra_deg), float(seen.dec_deg))
            for seen in (astrometric.at(Utc(t)) for t in self.instants)
        ]
        going = [self.course.going(t + LATE_S) for t in self.instants]
        self.paces = np.array([g.pace_deg_s for g in going]) * 3600.0
        self.by_km = np.array([math.degrees(1.0 / g.range_km) for g in going]) * 3600.0
        self.counts = [n for n in COUNTS if n <= count]

    def spread(self, n: int) -> tuple[float, float]:
        """Return the sigmas along and across, on the sky at the nth instant, of the best estimate from n."""
        return tuple(
            SIGMA_ARCSEC * by[n - 1] / math.sqrt(float(by[:n] @ by[:n])) for by in (self.paces, self.by_km)
        )  # type: ignore[return-value]


@dataclass(frozen=True)
class Found:
    """One seed's estimate after n solutions; booleans that are counted."""

    along: bool
    cross: bool
    over_arc: bool
    at_end: bool


def run(arc: Arc, seed: int) -> dict[int, Found]:
    """Return what one seed's solutions lead to."""
    rng = random.Random(f"{arc.one.name} {arc.start_s} {seed}")
    estimator = Estimator(arc.one.believed.elements.catalog_number, arc.one.rise_s)
    found = {}
    for n, (utc_s, place) in enumerate(zip(arc.instants, arc.places, strict=True), start=1):
        line = encode_message(noisy(*place, utc_s, rng, SIGMA_ARCSEC))
        seen = decode_message(line)
        assert isinstance(seen, Observation)
        estimator.take(seen, utc_s + 0.5, arc.course, NO_BIAS)
        if n in arc.counts:
            found[n] = _judged(arc, estimator, n, utc_s)
    return found


def _judged(arc: Arc, estimator: Estimator, n: int, utc_s: float) -> Found:
    known = estimator.filter
    if known is None:
        return Found(False, False, False, False)
    off_s, off_km = known.along_s - LATE_S, known.cross_km
    bound = FACTOR * SIGMA_ARCSEC / math.sqrt(n)
    squares = (off_s * arc.paces[:n]) ** 2 + (off_km * arc.by_km[:n]) ** 2
    range_km = arc.course.going(utc_s + known.along_s).range_km
    bias = Bias(known.along_s, math.degrees(math.atan(known.cross_km / range_km)))
    pointed = arc.course.airless.at(Utc(utc_s), bias).unit
    apart = float(np.linalg.norm(pointed - arc.one.true.at(Utc(utc_s)).unit))
    return Found(
        abs(off_s) <= 2.0 * known.along_sigma_s,
        abs(off_km) <= 2.0 * known.cross_sigma_km,
        math.sqrt(float(squares.mean())) <= bound,
        math.degrees(2.0 * math.asin(0.5 * apart)) * 3600.0 <= bound,
    )


def share_within(bound: float, one: float, other: float) -> float:
    """Return the probability that a point with two axes of these sigmas lies within `bound` of the centre."""
    angles = (np.arange(720) + 0.5) * (math.pi / 1440.0)
    exponent = (np.cos(angles) / one) ** 2 + (np.sin(angles) / other) ** 2
    inside = (1.0 - np.exp(-0.5 * bound**2 * exponent)) / exponent
    return float(inside.sum() * (math.pi / 1440.0) * 4.0 / (2.0 * math.pi * one * other))


def shares(arc: Arc, seeds: range) -> dict[int, tuple[float, float, float, float]]:
    """Return, for each n, the shares of seeds: along, across, over the arc, at its end."""
    runs = [run(arc, seed) for seed in seeds]
    return {
        n: (
            sum(one[n].along for one in runs) / len(runs),
            sum(one[n].cross for one in runs) / len(runs),
            sum(one[n].over_arc for one in runs) / len(runs),
            sum(one[n].at_end for one in runs) / len(runs),
        )
        for n in arc.counts
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=500)
    parser.add_argument("--pass", dest="name", choices=["ISS", "KANOPUS"])
    options = parser.parse_args()
    print(f"{LATE_S:g} s off, a solution a second, {SIGMA_ARCSEC:g}″ an axis, {options.seeds} seeds; in %")
    rows = []
    for name, one in passes().items():
        if options.name not in {None, name}:
            continue
        for words, ahead_s in STARTS.items():
            arc = Arc(one, one.rise_s if ahead_s is None else one.culminate_s + ahead_s)
            print(f"{name}, {words}")
            print(
                f"{'n':>5} {'along':>7} {'across':>7} {'arc':>7} {'end':>7} {'best at end':>12}", flush=True
            )
            for n, figures in shares(arc, range(1, options.seeds + 1)).items():
                rows.append(figures)
                best = share_within(FACTOR * SIGMA_ARCSEC / math.sqrt(n), *arc.spread(n))
                row = " ".join(f"{100.0 * share:7.1f}" for share in figures)
                print(f"{n:5d} {row} {100.0 * best:12.1f}", flush=True)
    along, cross, over_arc, _ = np.mean(rows, axis=0) * 100.0
    print(f"mean of all rows: along {along:.1f}, across {cross:.1f}, arc {over_arc:.1f}")


if __name__ == "__main__":
    main()

"""How near and how smoothly rotctld's clients keep a mount to a satellite: `python bench/rotctld.py`.

The built-in pass, in virtual time, by a client that sends positions at 1 Hz: rounded to a hundredth of a
degree as satellite programs send them, and to a millionth; late, by what a client needs to send them; ahead,
as gpredict sends them; and by one that sends them only where the rotator is off by more than a tolerance.
Beside them: the straight way, the same mount sent to each position as it comes, to stand there until then.
"""

from __future__ import annotations

import argparse
import random
import sys
from typing import TYPE_CHECKING, NamedTuple

from antenna import peak_rate_deg_s
from antenna_harness import SITE, rms, separation_arcsec
from rotctld_harness import VirtualRotator

from sattrack.runtime import demo_pass
from sattrack.servers.rotctld import rotator as rotator_module
from sattrack.servers.rotctld.rotator import SmoothedTrack
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.simulator.mount import Truth
    from sattrack.servers.antenna.trajectory import AzEl

RISE_UTC_S = Utc.parse("2026-10-02T13:01:56Z").unix_s
SET_UTC_S = Utc.parse("2026-10-02T13:08:54Z").unix_s
SETTLED_S = 20.0
NETWORK_S = 0.0003


class Steps(SmoothedTrack):
    """The straight way: to each position as it comes."""

    def take(self, place: AzEl, utc_s: float) -> None:
        self._last = place


class Figures(NamedTuple):
    rms_arcsec: float
    peak_arcsec: float
    jerk_deg_s2: float
    """The greatest change of the axes' rate over a tenth of a second, by its length."""
    positions: int


def follow(
    digits: int = 2,
    late_s: float = 0.0,
    ahead_s: float = 0.0,
    tolerance_deg: float = 0.0,
    make: Callable[[], SmoothedTrack] = SmoothedTrack,
    begin_utc_s: float = RISE_UTC_S,
    end_utc_s: float = SET_UTC_S,
) -> Figures:
    """Follow the pass by a client that asks where the mount is, and sends a position, once a second."""
    rotator_module.SmoothedTrack = make
    rotator = VirtualRotator(begin_utc_s - 15.0)
    propagator, chance = Propagator(demo_pass.elements(), SITE), random.Random(3)
    sent = []

    def turn(now: float) -> None:
        seen = propagator.at(Utc(now + chance.uniform(0.0, ahead_s)))
        az_deg, el_deg = float(seen.az_deg), max(0.0, float(seen.alt_deg))
        answer = rotator.say("p").split()
        off = 1e9
        if len(answer) == 2:
            there = (float(text) for text in answer)
            off = max(abs(a - b) for a, b in zip(there, (az_deg, el_deg), strict=True))
        if off >= tolerance_deg:
            line = f"P {az_deg:.{digits}f} {el_deg:.{digits}f}"
            sent.append(now)
            rotator.call(now + NETWORK_S + chance.uniform(0.0, late_s), lambda _: rotator.say(line))
        rotator.call(now + 1.0, turn)

    rotator.call(begin_utc_s - 14.0, turn)
    rotator.run_until(end_utc_s)
    rotator_module.SmoothedTrack = SmoothedTrack
    errors, rates = [], []
    for truth in rotator.truths:
        if begin_utc_s + SETTLED_S < truth.utc_s < end_utc_s - 1.0:
            there = propagator.at(Utc(truth.utc_s))
            errors.append(separation_arcsec(truth.ra_deg, truth.dec_deg, there.ra_deg, there.dec_deg))
            rates.append(truth)
    return Figures(rms(errors), max(errors), jerk(rates), len(sent))


def jerk(truths: list[Truth]) -> float:
    """Return the greatest change of rate of the axes over two samples, degrees a second squared."""
    worst = 0.0
    for a, b, c in zip(truths, truths[2:], truths[4:], strict=False):
        first = (b.hour_angle_axis_deg - a.hour_angle_axis_deg) / (b.utc_s - a.utc_s)
        second = (c.hour_angle_axis_deg - b.hour_angle_axis_deg) / (c.utc_s - b.utc_s)
        worst = max(worst, abs(second - first) / (0.5 * (c.utc_s - a.utc_s)))
    return worst


def highest_deg() -> float:
    """Return how high the satellite gets."""
    propagator = Propagator(demo_pass.elements(), SITE)
    seconds = range(int(SET_UTC_S - RISE_UTC_S))
    return max(float(propagator.at(Utc(RISE_UTC_S + second)).alt_deg) for second in seconds)


def told(figures: Figures) -> str:
    return (
        f"true error {figures.rms_arcsec:.1f}″ RMS, {figures.peak_arcsec:.1f}″ peak; "
        f"{figures.positions} positions; hour angle axis: up to {figures.jerk_deg_s2:.2f} °/s²"
    )


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    rate = peak_rate_deg_s()
    print(f"the pass: up to {highest_deg():.0f}° high, up to {rate:.2f} °/s: 10 ms are {rate * 36.0:.0f}″")
    print(f"straight way, 1 Hz, 0.01°:           {told(follow(make=Steps))}")
    print(f"followed, 1 Hz, 0.01°:               {told(follow())}")
    print(f"followed, 1 Hz, 0.000001°:           {told(follow(digits=6))}")
    print(f"followed, up to 20 ms late:          {told(follow(late_s=0.02))}")
    print(f"followed, up to 0.7 s ahead:         {told(follow(ahead_s=0.7))}")
    print(f"followed, off by 0.1°:               {told(follow(tolerance_deg=0.1))}")
    print(f"straight way, off by 0.1°:           {told(follow(tolerance_deg=0.1, make=Steps))}")


if __name__ == "__main__":
    sys.exit(main())

"""Gain and phase margins of the control law's loop, computed with the program's own functions.

python bench/margins.py

The loop is opened where a rate is sent. A small pulse of rate goes out, and the law answers each turn from
where the axis is and from what it knows to have been commanded: that is the loop's impulse response, and its
transform along the unit circle the open loop's gain and phase. The axis answers later or sooner than the law
believes by some sigmas of the lag that it states. Each row is the worst over dead times, lags and their
sigmas. Where the axis is, the law is told exactly: what the filters do is judged by `bench/family.py`.
"""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from sattrack.control.axis_filter import SETTLED_S, Commanded, Step, expected_shares, lag_of, rest_of
from sattrack.control.following import AxisCourse, rate_deg_s
from sattrack.mount.model import AxisLimits

INTERVALS_S = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)
DEAD_TIMES_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)
LAGS_S = (0.0, 0.03, 0.16)
LAG_SIGMAS_S = (0.01, 0.025, 0.05, 0.1)
ERRORS = (0.0, 1.0, 2.0)
"""By how many of its sigmas a lag is wrong, either way."""
PULSE_DEG_S = 1e-6
AXIS = AxisLimits()
AT_REST = Step(-math.inf, 0.0, 0.0)
LONG_AGO_S = -9.0


class Loop(NamedTuple):
    """One loop, in seconds: how long a command acts, after what time, and what is known of the servo."""

    interval_s: float
    dead_time_s: float
    lag_s: float
    lag_sigma_s: float
    late_s: float
    """By how much later the axis answers than is believed."""


class Margins(NamedTuple):
    """By how much the loop's gain may grow, and its phase fall, before it oscillates."""

    gain_db: float
    phase_deg: float


def answers(loop: Loop) -> np.ndarray:
    """Return what the law sends in each turn after a pulse of rate, over the pulse."""
    shares = expected_shares(loop.lag_s)
    known = SimpleNamespace(
        disturbance_deg_s=0.0, gain_error=0.0, lag=lag_of(shares), lag_sigma_s=loop.lag_sigma_s
    )
    interval_s = loop.interval_s
    pulse = [Step(loop.dead_time_s, PULSE_DEG_S, 0.0), Step(loop.dead_time_s + interval_s, 0.0, 0.0)]
    acted = Commanded(LONG_AGO_S)
    for step in pulse:
        acted.add(step._replace(utc_s=step.utc_s + loop.late_s))
    turns = math.ceil((loop.dead_time_s + abs(loop.late_s) + SETTLED_S) / interval_s) + 3
    sent = []
    for turn in range(1, turns):
        now_s = turn * interval_s
        acts_s = now_s + loop.dead_time_s
        stands_deg = float(acted.effects(LONG_AGO_S, now_s)[0] @ shares)
        sent_before = [step for step in pulse if step.utc_s < acts_s - 1e-9]
        comes = Commanded(LONG_AGO_S).effects(now_s, acts_s + SETTLED_S, sent_before)
        comes -= rest_of((AT_REST, *sent_before)[-1], SETTLED_S)
        way = AxisCourse(0.0, 0.0, interval_s, 0.0, 0.0)
        bound_for_deg = stands_deg + float(comes[0] @ shares)
        sent.append(
            rate_deg_s(way, bound_for_deg, known, AXIS.max_acceleration_deg_s2, AXIS.max_rate_deg_s)
            / PULSE_DEG_S
        )
    return np.array(sent)


def margins(loop: Loop) -> Margins:
    """Return the margins of the loop, its gain counted against its own sign."""
    sent = -answers(loop)
    rest = sent[-1]
    angles = np.linspace(1e-3, math.pi, 1500)
    turns = np.arange(1, sent.size + 1)
    opened = np.exp(-1j * angles[:, None] * turns) @ (sent - rest)
    # What stays for good is an integrator.
    opened += rest * np.exp(-1j * angles) / (1.0 - np.exp(-1j * angles))
    phases, gains = np.angle(opened), np.abs(opened)
    negative = (opened[:-1].imag * opened[1:].imag <= 0.0) & (opened[:-1].real < 0.0)
    # At half the turns' rate the loop is real without a crossing.
    largest = max([*gains[:-1][negative], gains[-1] if opened[-1].real < 0.0 else 0.0])
    crossings = (gains[:-1] - 1.0) * (gains[1:] - 1.0) <= 0.0
    least = min((math.pi - abs(phase) for phase in phases[:-1][crossings]), default=math.pi)
    return Margins(-20.0 * math.log10(max(largest, 1e-9)), math.degrees(least))


def worst(interval_s: float, dead_times_s: tuple[float, ...], error: float) -> Margins:
    """Return the worst margins of lags that are wrong by so many sigmas."""
    found = [
        margins(Loop(interval_s, dead_s, lag_s, sigma_s, sign * error * sigma_s))
        for dead_s, lag_s, sigma_s in itertools.product(dead_times_s, LAGS_S, LAG_SIGMAS_S)
        for sign in (-1.0, 1.0)
        # No axis answers before it is told.
        if dead_s + lag_s + sign * error * sigma_s >= 0.0
    ]
    return Margins(min(one.gain_db for one in found), min(one.phase_deg for one in found))


def main() -> None:
    print("worst over dead times of 0 to 350 ms and lags of 0 to 160 ms, by how wrong the lag is")
    print("interval     exact           1 sigma         2 sigma")
    for interval_s in INTERVALS_S:
        found = [worst(interval_s, DEAD_TIMES_S, error) for error in ERRORS]
        told = "   ".join(f"{gain_db:4.1f} dB {phase_deg:3.0f}°" for gain_db, phase_deg in found)
        print(f"{1e3 * interval_s:5.0f} ms   {told}")


if __name__ == "__main__":
    main()

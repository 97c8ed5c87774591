"""What to change after a recorded pass: advice that the figures of a report are sure of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sattrack.control.stages import KEYHOLE, RATE
from sattrack.recording.mount_fit import SURE_SIGMAS
from sattrack.safety import ROWS

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.recording.report import AxisFigures, BiasFigures, MissedFigures, Report, TimeFigures
    from sattrack.recording.trace import Trace

GAIN_OFF = 0.002
DELAY_OFF_S = 0.01
LOST_SHARE = 0.01
DRIFT_SIGMAS = 3.0
BIAS_SIGMAS = 3.0
LINE_ARCSEC = 0.2
LIMIT_SHARE = 0.1
"""Share of the commands at a limit from which on the limit is told as a cause."""
OFF_SHARE = 0.1
"""Share of the following off target from which on that is told."""
ONE_AXIS = 5.0
"""By so much one axis must be farther off than the other to be told as the one that is."""
TOLD_S = 1.0
"""Spans that are shorter than this are not told in words."""


def advice(report: Report, run: Trace) -> list[str]:
    """Return what to change, the most telling first; empty where nothing asks for it."""
    profile, times, link = run.engine.spec.profile, report.times, report.link
    told = []
    if not report.acquired:
        why = run.engine.why_not_acquired()
        # The engine's reason is of today's commands: it holds where the mount was sent these. Of a run that
        # limits held, the limits' own words tell.
        told += [why] if why is not None and run.result.agrees and not times.held_s else []
        told += _why_missed(profile, report.missed, times)
    elif times.off_target_s > OFF_SHARE * times.following_s:
        told.append(_off_words(run, times))
    if report.bias is not None:
        told += _bias_words(report.bias)
    told += _mount_words(profile, report.ra, report.dec)
    told += _ripple_words(report.ra, report.dec)
    if link is not None and link.lost > LOST_SHARE * max(1, link.received + link.lost):
        told.append(
            f"{100.0 * link.lost / (link.received + link.lost):.1f} % of the statuses were lost: look at the "
            "network"
        )
    return [*told, *_held_words(times)]


def _bias_words(bias: BiasFigures) -> list[str]:
    if bias.along_sigma_s is None or bias.cross_sigma_deg is None:
        return []
    told = []
    significant = (
        abs(bias.along_s) > BIAS_SIGMAS * bias.along_sigma_s
        or abs(bias.cross_deg) > BIAS_SIGMAS * bias.cross_sigma_deg
    )
    if significant:
        told.append(
            "with these elements, begin with "
            f"--bias-along {bias.along_s:.2f} --bias-cross {bias.cross_deg:.3f}, or fetch newer ones"
        )
    drift, sigma = bias.along_drift_s_s, bias.along_drift_sigma_s_s
    if drift is not None and sigma is not None and abs(drift) > DRIFT_SIGMAS * sigma:
        told.append(f"the satellite runs away by {drift * 60.0:+.2f} s a minute: the elements are old")
    return told


def _mount_words(profile: MountProfile, ra: AxisFigures, dec: AxisFigures) -> list[str]:
    """Return where gains and delays are surely not those of the profile."""
    told = []
    for name, fit, gain in (("ra", ra, profile.ra_rate_gain), ("dec", dec, profile.dec_rate_gain)):
        if _is_off(fit.gain, fit.gain_sigma, gain, GAIN_OFF * gain):
            told.append(f"set {name}_rate_gain = {fit.gain:.4f} in the mount's profile; it says {gain:g}")
    expected_s = profile.command_delay_s + 0.5 * profile.period_s
    for name, fit in (("right ascension", ra), ("declination", dec)):
        if fit.delay_s is None or not _is_off(fit.delay_s, fit.delay_sigma_s, expected_s, DELAY_OFF_S):
            continue
        delay_ms = fit.delay_s * 1000.0
        if delay_ms < 0.0:
            told.append(
                f"commands in {name} seem to act {-delay_ms:.0f} ms before they are sent: the profile dates "
                "statuses wrongly (status_delay_s, clock_offset_s): run sattrack mount calibrate"
            )
        else:
            told.append(
                f"commands in {name} act {delay_ms:.0f} ms after their tick, "
                f"{expected_s * 1000.0:.0f} ms are expected: run sattrack mount calibrate"
            )
    return told


def _ripple_words(ra: AxisFigures, dec: AxisFigures) -> list[str]:
    return [
        f"the {name} axis errs by {line.amplitude_arcsec:.2f}″ {line.cycles_a_turn:.0f} times "
        "a turn: its motor's ripple, or its encoder"
        for name, fit in (("hour angle", ra), ("declination", dec))
        for line in fit.lines
        if line.amplitude_arcsec > LINE_ARCSEC
    ]


def _is_off(value: float | None, sigma: float | None, expected: float, least: float) -> bool:
    """Tell whether a fitted value is surely another than the expected one, by so much at least."""
    if value is None or sigma is None:
        return False
    return abs(value - expected) > max(least, SURE_SIGMAS * sigma)


def _why_missed(profile: MountProfile, missed: MissedFigures | None, times: TimeFigures) -> list[str]:
    """Return what may be done about a mount that was never on target."""
    held_s = sum(times.held_s.values())
    if held_s > times.acquiring_s:
        # What was seen in between, on the way to where a limit held it, is no cause.
        return []
    if missed is None:
        return ["the mount never came to follow: look at the run's messages, and rehearse the pass"]
    told = []
    for name, axis, other in (
        ("right ascension", missed.ra, missed.dec),
        ("declination", missed.dec, missed.ra),
    ):
        if max(axis.at_rate_limit, axis.at_acceleration_limit) > LIMIT_SHARE:
            told.append(
                f"{100.0 * axis.at_rate_limit:.0f} % of the commands in {name} were at the rate limit and "
                f"{100.0 * axis.at_acceleration_limit:.0f} % at the acceleration limit: `sattrack rehearse` "
                "tells whether the mount is fast enough for the pass"
            )
        if axis.typical_arcsec > ONE_AXIS * other.typical_arcsec:
            told.append(f"only {name} was far off: look for what is peculiar to that axis")
    if profile.calibration is None:
        told.append("the mount's profile was never measured: run sattrack mount calibrate")
    return told or ["the recording does not tell why: measure the mount again, sattrack mount calibrate"]


def _off_words(run: Trace, times: TimeFigures) -> str:
    """Say for how long a mount that had been on target was off it, and by how much."""
    off = run.off_target
    ra, dec = (float(np.median(np.abs(error[off]))) for error in (run.ra_error, run.dec_error))
    spec = run.engine.spec
    measure = ""
    if spec.profile.calibration is None:
        measure = "; the mount's profile was never measured: run sattrack mount calibrate"
    return (
        f"the mount was more than {spec.plan.on_target_arcsec:g}″ off for {times.off_target_s:.0f} of the "
        f"{times.following_s:.0f} s that it followed, typically by {ra:.1f}″ in right ascension and "
        f"{dec:.1f}″ in declination{measure}"
    )


def _held_words(times: TimeFigures) -> list[str]:
    return [
        f"{_held_by(name)} for {seconds:.0f} s: `sattrack rehearse` shows that beforehand"
        for name, seconds in times.held_s.items()
        if seconds > TOLD_S
    ]


def _held_by(name: str) -> str:
    if name == KEYHOLE:
        return "the target was too fast for the hour angle axis near the pole (the keyhole)"
    if name == RATE:
        return "the target was too fast for the axes (max_rate_deg_s, max_acceleration_deg_s2)"
    row = ROWS.get(name)
    told = "" if row is None else f" ({row.bound} sets it)"
    return f"the {name.replace('_', ' ')} limit held the mount off its target{told}"

"""What a recorded pass tells: figures, the satellite's biases, what the mount did, and what to change."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from sattrack.messages import Nudge, OffsetBy, decode_message
from sattrack.recording.format import OPERATOR
from sattrack.recording.mount_fit import AxisFit, Line, fit_axes, lines, spectrum
from sattrack.recording.observed import FRAMES, observations
from sattrack.recording.smoothing import BiasFit, Said, fit_biases
from tle.errors import ObservationError
from tle.instants import Utc
from tle.propagator import Propagator
from tle.residuals import bias_from_observation

if TYPE_CHECKING:
    from sattrack.messages import Observation
    from sattrack.recording.reading import Recording
    from sattrack.recording.trace import Trace

GAIN_OFF = 0.002
DELAY_OFF_S = 0.01
LOST_SHARE = 0.01
DRIFT_SIGMAS = 3.0
BIAS_SIGMAS = 3.0
LINE_ARCSEC = 0.2


class ErrorFigures(msgspec.Struct, frozen=True):
    """The error on the sky while following, arcseconds; means are signed, along positive where it leads."""

    rms_arcsec: float
    peak_arcsec: float
    median_arcsec: float
    p95_arcsec: float
    mean_along_arcsec: float
    mean_across_arcsec: float
    rms_along_arcsec: float
    rms_across_arcsec: float


class LinkFigures(msgspec.Struct, frozen=True):
    """How the link was: statuses a second, what was lost, and how late statuses came, milliseconds."""

    received: int
    lost: int
    rate_hz: float
    delay_ms: float
    delay_p99_ms: float


class BiasFigures(msgspec.Struct, frozen=True):
    """The satellite's biases and where they are from: "observations", or "nudge", the operator's last word.

    Those of observations are as of `utc` and have one sigma each and drifts, a second; the nudge has none.
    The angle across is that at `utc`; what is constant over a pass is the distance.
    """

    source: str
    utc: str
    along_s: float
    cross_deg: float
    cross_km: float | None = None
    along_sigma_s: float | None = None
    cross_sigma_deg: float | None = None
    along_drift_s_s: float | None = None
    along_drift_sigma_s_s: float | None = None
    cross_drift_km_s: float | None = None
    cross_drift_sigma_km_s: float | None = None
    observations: int = 0
    rejected: int = 0


class AxisFigures(msgspec.Struct, frozen=True):
    """What one axis made of its commands, as `mount_fit.AxisFit` has it, and what repeats with its angle."""

    gain: float | None
    gain_sigma: float | None
    delay_s: float | None
    delay_sigma_s: float | None
    lines: tuple[Line, ...]


class Report(msgspec.Struct, frozen=True):
    """Everything that a report says of one recording; null where nothing tells."""

    recording: str
    name: str
    catalog_number: int
    mount: str
    began_utc: str
    followed_s: float
    samples: int
    ended_by: str | None
    error: ErrorFigures | None
    link: LinkFigures | None
    bias: BiasFigures | None
    ra: AxisFigures
    dec: AxisFigures
    advice: tuple[str, ...]
    problems: tuple[str, ...]


def make_report(recording: Recording, run: Trace) -> tuple[Report, BiasFit | None]:
    """Return the report of a run made again, and the fit of its biases where there were observations."""
    spec = run.engine.spec
    fit, bias = find_biases(recording, run)
    ra_fit, dec_fit = fit_axes(run, spec.profile)
    ra, dec = _axis(run, ra_fit, 0), _axis(run, dec_fit, 1)
    link = _link(run)
    at = run.utc_s[run.following]
    report = Report(
        recording=str(recording.path),
        name=spec.propagator.elements.label,
        catalog_number=spec.propagator.elements.catalog_number,
        mount=spec.mount_name,
        began_utc=Utc(spec.started_utc_s).isoformat("seconds"),
        followed_s=round(float(np.ptp(at)), 3) if len(at) else 0.0,
        samples=len(at),
        ended_by=run.result.recorded.ended_by or run.engine.tracker.ended_by,
        error=_errors(run),
        link=link,
        bias=bias,
        ra=ra,
        dec=dec,
        advice=tuple(_advice(run, ra, dec, link, bias)),
        problems=tuple(recording.problems),
    )
    return report, fit


def _errors(run: Trace) -> ErrorFigures | None:
    total, along, across = (column[run.following] for column in (run.total, run.along, run.across))
    if not len(total):
        return None
    return ErrorFigures(
        _rms(total),
        float(total.max()),
        float(np.median(total)),
        float(np.quantile(total, 0.95)),
        float(along.mean()),
        float(across.mean()),
        _rms(along),
        _rms(across),
    )


def _rms(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _link(run: Trace) -> LinkFigures | None:
    if len(run.utc_s) < 2:
        return None
    health = run.engine.session.health
    delay_ms = (run.arrival_utc_s - run.utc_s) * 1000.0
    seconds = float(run.arrival_utc_s[-1] - run.arrival_utc_s[0])
    return LinkFigures(
        health.received,
        health.lost,
        (len(run.utc_s) - 1) / seconds if seconds > 0.0 else 0.0,
        float(np.median(delay_ms)),
        float(np.quantile(delay_ms, 0.99)),
    )


def _axis(run: Trace, fit: AxisFit | None, axis: int) -> AxisFigures:
    error = (run.ra_error if axis == 0 else run.dec_error)[run.following]
    found: list[Line] = []
    if len(error):
        found = lines(*spectrum(axis_angle_deg(run, axis), error))
    if fit is None:
        return AxisFigures(None, None, None, None, tuple(found))
    return AxisFigures(fit.gain, fit.gain_sigma, fit.delay_s, fit.delay_sigma_s, tuple(found))


def axis_angle_deg(run: Trace, axis: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the angle of an axis while following, unwrapped: the hour angle, or the declination."""
    if axis == 1:
        return run.dec_deg[run.following]
    turned: np.ndarray[tuple[int], np.dtype[np.float64]] = np.unwrap(
        (run.sidereal_h * 15.0 - run.ra_deg)[run.following], period=360.0
    )
    return turned


def find_biases(recording: Recording, run: Trace) -> tuple[BiasFit | None, BiasFigures | None]:
    """Return what observations say of the biases, else the operator's last word; None for neither.

    A mount that follows tells nothing of the satellite: without observations nothing is fitted.
    """
    spec = run.engine.spec
    elements, site = spec.propagator.elements, spec.propagator.site
    airless = Propagator(elements, site)
    said = []
    for seen in observations(recording, elements.catalog_number):
        one = _said(seen, spec.propagator if seen.frame == "of_date" else airless)
        if one is not None:
            said.append(one)
    fit = fit_biases(said)
    if fit is None:
        return None, _nudged(recording, run)
    range_km = float(airless.at(Utc(fit.utc_s + fit.along.value)).range_km)
    figures = BiasFigures(
        source="observations",
        utc=Utc(fit.utc_s).isoformat("milliseconds"),
        along_s=fit.along.value,
        cross_deg=math.degrees(math.atan(fit.cross.value / range_km)),
        cross_km=fit.cross.value,
        along_sigma_s=fit.along.sigma,
        cross_sigma_deg=math.degrees(fit.cross.sigma / range_km),
        along_drift_s_s=fit.along.drift,
        along_drift_sigma_s_s=fit.along.drift_sigma,
        cross_drift_km_s=fit.cross.drift,
        cross_drift_sigma_km_s=fit.cross.drift_sigma,
        observations=fit.taken,
        rejected=fit.rejected + len(observations(recording, elements.catalog_number)) - len(said),
    )
    return fit, figures


def _said(seen: Observation, propagator: Propagator) -> Said | None:
    """Return what one observation says; None where no bias leads from the elements to it."""
    t = Utc.parse(seen.utc)
    try:
        found = bias_from_observation(
            propagator, seen.ra_deg, seen.dec_deg, t, FRAMES[seen.frame], seen.sigma_arcsec
        )
    except ObservationError:
        return None
    utc_s = float(t.unix_s)
    range_km = float(propagator.at(Utc(utc_s + found.along_s)).range_km)
    cross = math.radians(found.cross_deg)
    return Said(
        utc_s,
        found.along_s,
        range_km * math.tan(cross),
        found.along_sigma_s,
        math.radians(found.cross_sigma_deg) * range_km / math.cos(cross) ** 2,
    )


def _nudged(recording: Recording, run: Trace) -> BiasFigures | None:
    """Return the bias that was in force after the operator's last word about it; None without one."""
    last_utc_s = None
    for entry in recording.entries():
        if entry.topic == OPERATOR:
            try:
                message = decode_message(entry.data)
            except msgspec.MsgspecError:
                continue
            if isinstance(message, Nudge | OffsetBy):
                last_utc_s = entry.utc_s
    if last_utc_s is None:
        return None
    view = run.engine.view(float(run.utc_s[-1]) if len(run.utc_s) else last_utc_s)
    at = Utc(last_utc_s).isoformat("milliseconds")
    return BiasFigures("nudge", at, view.bias_along_goal_s, view.bias_cross_goal_deg)


def _advice(
    run: Trace, ra: AxisFigures, dec: AxisFigures, link: LinkFigures | None, bias: BiasFigures | None
) -> list[str]:
    """Return what to change, the most telling first; empty where nothing asks for it."""
    profile = run.engine.spec.profile
    told = []
    if bias is not None and bias.along_sigma_s is not None and bias.cross_sigma_deg is not None:
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
    for name, fit, gain in (("ra", ra, profile.ra_rate_gain), ("dec", dec, profile.dec_rate_gain)):
        if fit.gain is not None and abs(fit.gain / gain - 1.0) > GAIN_OFF:
            told.append(f"set {name}_rate_gain = {fit.gain:.4f} in the mount's profile; it says {gain:g}")
    expected_s = profile.command_delay_s + 0.5 * profile.period_s
    for name, fit in (("right ascension", ra), ("declination", dec)):
        if fit.delay_s is not None and abs(fit.delay_s - expected_s) > DELAY_OFF_S:
            told.append(
                f"commands in {name} act {fit.delay_s * 1000.0:.0f} ms after their tick, "
                f"{expected_s * 1000.0:.0f} ms are expected: run sattrack mount calibrate"
            )
    for name, fit in (("hour angle", ra), ("declination", dec)):
        for line in fit.lines:
            if line.amplitude_arcsec > LINE_ARCSEC:
                told.append(
                    f"the {name} axis errs by {line.amplitude_arcsec:.2f}″ {line.cycles_a_turn:.0f} times "
                    "a turn: its motor's ripple, or its encoder"
                )
    if link is not None and link.lost > LOST_SHARE * max(1, link.received + link.lost):
        told.append(
            f"{100.0 * link.lost / (link.received + link.lost):.1f} % of the statuses were lost: look at the "
            "network"
        )
    return told

"""The report of a recorded pass: figures, the satellite's biases, what the mount did, and what to change."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from sattrack.control.biases import ALONG, CROSS
from sattrack.control.stages import KEYHOLE, RATE, STOPPED, RunStage, measuring
from sattrack.core import local_time
from sattrack.mount.model import whole_title
from sattrack.recording.fits import (
    SURE_SIGMAS,
    AxisFit,
    BiasFit,
    NoFit,
    ObservedBias,
    SpectralLine,
    fit_axes,
    fit_biases,
    one_way,
    repeats,
)
from sattrack.recording.format import clock_steps, lasted_s, messages, observations
from sattrack.safety import ROWS
from sattrack.views.messages import FRAMES, Nudge, OffsetBy, Search
from tle.elements import Elements
from tle.errors import ObservationError
from tle.instants import DAY_S, Utc
from tle.observed import bias_from_observation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.engine import RunSpec
    from sattrack.mount.model import AxisLimits, MountProfile
    from sattrack.recording.format import Recording
    from sattrack.recording.trace import Trace
    from sattrack.views.messages import ObservationMessage
    from tle.propagator import Propagator

AT_LIMIT = 0.98
"""Of an axis' greatest rate, or acceleration, what counts as asking for all of it."""


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


class TimeFigures(msgspec.Struct, frozen=True):
    """For how long the run did what, seconds; each second is counted once.

    `acquiring_s` is before the mount was first on target, `held_s` by limits, `rejoining_s` on the way back
    after a pause or a limit, `following_s` from the acquisition on. `off_target_s` is the part of it with a
    larger error than counts as on target, `fitted_s` the part from which gains, delays and what repeats are
    fitted: the error was not much larger, and no offset changed.
    """

    acquiring_s: float
    held_s: dict[str, float]
    paused_s: float
    rejoining_s: float
    following_s: float
    off_target_s: float
    fitted_s: float


class AxisMissed(msgspec.Struct, frozen=True):
    """How far one axis was off the target on the sky, arcseconds, and the share of commands at its limits."""

    typical_arcsec: float
    largest_arcsec: float
    at_rate_limit: float
    at_acceleration_limit: float


class MissedFigures(msgspec.Struct, frozen=True):
    """What was seen of a mount that followed and was never on target, arcseconds; typical is the median."""

    typical_arcsec: float
    largest_arcsec: float
    ra: AxisMissed
    dec: AxisMissed


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
    """What one axis made of its commands, as `mount_fit.AxisFit` has it, and what repeats with its angle.

    `untold` says why something is missing.
    """

    gain: float | None
    gain_sigma: float | None
    delay_s: float | None
    delay_sigma_s: float | None
    lines: tuple[SpectralLine, ...]
    untold: tuple[str, ...] = ()


class Report(msgspec.Struct, frozen=True):
    """The report of one recording; null where a figure is not known."""

    recording: str
    name: str
    catalog_number: int | None
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
    acquired: bool
    """Whether the mount was ever on target."""
    missed: MissedFigures | None
    """Of a mount that followed and was never on target; null for others."""
    times: TimeFigures
    elements_age_days: float | None = None
    """Age of the elements that the error is against, when the run began; null for what has no epoch."""
    axes: tuple[str, ...] = ("hour angle", "declination")
    """What the axes of `ra` and `dec` are called: of a mount with a geometry "first axis", "second axis"."""


def unused(run: Trace, what: str) -> tuple[str, ...]:
    """Return from when on a recording is not used: what the run knew after a gap is not known.

    The same holds after today's code broke. `what` is what is made of it, in words.
    """
    if run.result.broke is not None:
        return (f"{what} ends where today's code broke: {run.result.broke}; what came after is not used",)
    if run.result.stopped_utc_s is None:
        return ()
    at = local_time.clock(run.result.stopped_utc_s)
    return (f"{what} ends at {at}, where messages are missing; what came after that is not used",)


def make_report(recording: Recording, run: Trace) -> tuple[Report, BiasFit | None]:
    """Return the report of a run made again, and the fit of its biases where there were observations."""
    spec = run.engine.spec
    fit, bias = find_biases(recording, run)
    ra_fit, dec_fit = fit_axes(run, spec.profile)
    ra, dec = _axis(run, ra_fit, 0), _axis(run, dec_fit, 1)
    link, times, missed = _link(run), _times(run), _missed(run)
    report = Report(
        recording=str(recording.path),
        name=spec.propagator.elements.label,
        catalog_number=spec.propagator.elements.catalog_number or None,
        mount=spec.mount_name,
        began_utc=Utc(spec.started_utc_s).isoformat("seconds"),
        followed_s=times.following_s,
        samples=int(run.following.sum()),
        ended_by=_ended_by(run),
        error=_errors(run),
        link=link,
        bias=bias,
        ra=ra,
        dec=dec,
        advice=(),
        problems=(
            *recording.problems,
            *(step.text for step in clock_steps(recording)),
            *unused(run, "this report"),
        ),
        acquired=run.acquired,
        missed=missed,
        times=times,
        elements_age_days=_age_days(spec),
        axes=spec.profile.axis_titles(),
    )
    return msgspec.structs.replace(report, advice=tuple(advice(report, run))), fit


def _ended_by(run: Trace) -> str | None:
    """Return why the run ended: what today's code makes of it counts only where that is the same run."""
    seen = run.result.recorded.ended_by or run.ended_by
    return seen or (run.engine.tracker.ended_by if run.result.agrees else None)


def _age_days(spec: RunSpec) -> float | None:
    source = spec.propagator.elements
    return source.age_s(Utc(spec.started_utc_s)) / DAY_S if isinstance(source, Elements) else None


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
    seconds = lasted_s(run.arrival_utc_s.tolist())
    return LinkFigures(
        health.received,
        health.lost,
        (len(run.utc_s) - 1) / seconds if seconds > 0.0 else 0.0,
        float(np.median(delay_ms)),
        float(np.quantile(delay_ms, 0.99)),
    )


def _times(run: Trace) -> TimeFigures:
    acquiring, paused, rejoining, following = (
        round(run.seconds(run.doing == doing), 3)
        for doing in (RunStage.ACQUIRING, RunStage.PAUSED, RunStage.REJOINING, RunStage.FOLLOWING)
    )
    held = {name: round(run.seconds(run.held == name), 3) for name in sorted({*run.held} - {""})}
    off, fitted = (round(run.seconds(marked), 3) for marked in (run.off_target, run.fit_for))
    return TimeFigures(acquiring, held, paused, rejoining, following, off, fitted)


def _missed(run: Trace) -> MissedFigures | None:
    """Return what was seen of a mount that was never on target; None where it was, or never followed."""
    tried = run.doing == RunStage.ACQUIRING
    if run.acquired or not tried.any():
        return None
    profile = run.engine.spec.profile
    total = run.total[tried]
    return MissedFigures(
        float(np.median(total)),
        float(total.max()),
        _axis_missed(run, tried, 0, profile.ra),
        _axis_missed(run, tried, 1, profile.dec),
    )


def _axis_missed(run: Trace, tried: NDArray[np.bool_], axis: int, limits: AxisLimits) -> AxisMissed:
    off = np.abs((run.ra_error if axis == 0 else run.dec_error)[tried])
    begin_s, end_s = run.utc_s[tried][[0, -1]]
    during = (run.sent_utc_s >= begin_s) & (run.sent_utc_s <= end_s) & ~np.isnan(run.sent[:, axis])
    rates, at_s = run.sent[during, axis], run.sent_utc_s[during]
    asked = np.abs(np.diff(rates)) / np.maximum(np.diff(at_s), 1e-3)
    return AxisMissed(
        float(np.median(off)),
        float(off.max()),
        _share(np.abs(rates) >= AT_LIMIT * limits.max_rate_deg_s),
        _share(asked >= AT_LIMIT * limits.max_acceleration_deg_s2),
    )


def _share(marked: NDArray[np.bool_]) -> float:
    return round(float(marked.mean()), 4) if len(marked) else 0.0


def _axis(run: Trace, fit: AxisFit | NoFit, axis: int) -> AxisFigures:
    if not run.acquired:
        reason = "gain, delay or what repeats: the mount was never on target"
        return AxisFigures(None, None, None, None, (), (reason,))
    found = repeats(*repeating(run, axis))
    lines = () if isinstance(found, NoFit) else tuple(found)
    untold = (found.why,) if isinstance(found, NoFit) else ()
    if isinstance(fit, NoFit):
        return AxisFigures(None, None, None, None, lines, (f"gain or delay: {fit.why}", *untold))
    if fit.missing is not None:
        untold = (fit.missing, *untold)
    return AxisFigures(fit.gain, fit.gain_sigma, fit.delay_s, fit.delay_sigma_s, lines, untold)


def repeating(run: Trace, axis: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angles of an axis, unwrapped, and its errors there, while it went one way on target.

    The angle is the hour angle, or the declination; of a mount with a geometry that of its axis.
    """
    good = run.fit_for
    angle = run.axes_deg[:, axis]
    if axis == 0:
        angle = run.sidereal_h * 15.0 - angle
    unwrapped: NDArray[np.float64] = np.unwrap(angle[good], period=360.0)
    part = one_way(unwrapped)
    return unwrapped[part], (run.ra_error if axis == 0 else run.dec_error)[good][part]


def find_biases(recording: Recording, run: Trace) -> tuple[BiasFit | None, BiasFigures | None]:
    """Return the biases by observations, else by the operator's last nudge; None for neither.

    A mount that follows shows nothing of the satellite: without observations nothing is fitted.
    """
    steering = run.engine.tracker.steering
    propagator = steering.biases.course.propagator
    seen = observations(recording, propagator.elements.catalog_number)
    found = (_observed_bias(one, steering.clocks.correction_s(one.camera), propagator) for one in seen)
    observed = [one for one in found if one is not None]
    fit = fit_biases(observed)
    if fit is None:
        return None, _nudged(recording, run)
    range_km = float(propagator.at(Utc(fit.utc_s + fit.along.value)).range_km)
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
        rejected=fit.rejected + len(seen) - len(observed),
    )
    return fit, figures


def _observed_bias(seen: ObservationMessage, late_s: float, propagator: Propagator) -> ObservedBias | None:
    """Return the biases by one observation; None where no bias leads from the elements to it.

    `late_s` is by how much its camera's clock is ahead.
    """
    t = Utc.parse(seen.utc).plus(-late_s)
    try:
        found = bias_from_observation(
            propagator, seen.ra_deg, seen.dec_deg, t, FRAMES[seen.frame], seen.sigma_arcsec
        )
    except ObservationError:
        return None
    utc_s = float(t.unix_s)
    range_km = float(propagator.at(Utc(utc_s + found.along_s)).range_km)
    cross = math.radians(found.cross_deg)
    return ObservedBias(
        utc_s,
        found.along_s,
        range_km * math.tan(cross),
        found.along_sigma_s,
        math.radians(found.cross_sigma_deg) * range_km / math.cos(cross) ** 2,
    )


def _nudged(recording: Recording, run: Trace) -> BiasFigures | None:
    """Return the bias that was in force after the operator's last word about it; None without one."""
    last_utc_s = None
    for utc_s, message in messages(recording):
        if isinstance(message, Nudge | Search) or (
            isinstance(message, OffsetBy) and message.what in (ALONG, CROSS)
        ):
            last_utc_s = utc_s
    if last_utc_s is None:
        return None
    goals = run.engine.tracker.steering.biases.totals(float(run.utc_s[-1]) if len(run.utc_s) else last_utc_s)
    at = Utc(last_utc_s).isoformat("milliseconds")
    return BiasFigures("nudge", at, *goals) if any(goals) else None


GAIN_OFF = 0.002
DELAY_OFF_S = 0.01
LOST_SHARE = 0.01
DRIFT_SIGMAS = 3.0
BIAS_SIGMAS = 3.0
LINE_ARCSEC = 0.2
LIMIT_SHARE = 0.1
"""Share of the commands at a limit from which on the limit is given as a cause."""
OFF_SHARE = 0.1
"""Share of the following off target from which on that is reported."""
ONE_AXIS = 5.0
"""By so much one axis must be farther off than the other to be named alone."""
BUSY = "the mount is simulated: this machine was busy, or its delays were set otherwise"
REPORTED_S = 1.0
"""Spans that are shorter than this are not reported."""


def advice(report: Report, run: Trace) -> list[str]:
    """Return what to change, the most important first; empty for nothing."""
    profile, times, link = run.engine.spec.profile, report.times, report.link
    simulated, found = run.engine.spec.simulated, []
    if report.ended_by is None and not report.acquired:
        # Cut off before the mount was on target: what kept it from there may lie in what is missing.
        pass
    elif not report.acquired:
        why = run.engine.why_not_acquired()
        if why == STOPPED:
            return [why]
        # The engine's reason is of today's commands: it holds where the mount was sent these. Of a run that
        # limits held, the limits' own messages say more.
        found += [why] if why is not None and run.result.agrees and not times.held_s else []
        found += _why_missed(run.engine.spec, report.missed, times)
    elif times.off_target_s > OFF_SHARE * times.following_s:
        found.append(_off_advice(run, times))
    if report.bias is not None:
        found += _bias_advice(report.bias)
    found += _mount_advice(profile, report.ra, report.dec, BUSY if simulated else measuring(profile))
    found += _ripple_advice(profile, report.ra, report.dec)
    if link is not None and link.lost > LOST_SHARE * max(1, link.received + link.lost):
        found.append(
            f"{100.0 * link.lost / (link.received + link.lost):.1f} % of the statuses were lost: look at the "
            "network"
        )
    return [*found, *_held_advice(times)]


def _bias_advice(bias: BiasFigures) -> list[str]:
    if bias.along_sigma_s is None or bias.cross_sigma_deg is None:
        return []
    found = []
    significant = (
        abs(bias.along_s) > BIAS_SIGMAS * bias.along_sigma_s
        or abs(bias.cross_deg) > BIAS_SIGMAS * bias.cross_sigma_deg
    )
    if significant:
        found.append(
            "with these elements, begin with "
            f"--bias-along {bias.along_s:.4f} --bias-cross {bias.cross_deg:.5f}, or fetch newer ones"
        )
    drift, sigma = bias.along_drift_s_s, bias.along_drift_sigma_s_s
    if drift is not None and sigma is not None and abs(drift) > DRIFT_SIGMAS * sigma:
        found.append(f"the satellite runs away by {drift * 60.0:+.2f} s a minute: the elements are old")
    return found


def _mount_advice(profile: MountProfile, ra: AxisFigures, dec: AxisFigures, do: str) -> list[str]:
    """Return where gains and delays are surely not those of the profile, and what to do about delays."""
    found = []
    for name, fit, gain in (("ra", ra, profile.ra_rate_gain), ("dec", dec, profile.dec_rate_gain)):
        if _is_off(fit.gain, fit.gain_sigma, gain, GAIN_OFF * gain):
            found.append(f"set {name}_rate_gain = {fit.gain:.4f} in the mount's profile; it says {gain:g}")
    expected_s = profile.command_delay_s + 0.5 * profile.period_s
    for name, fit in zip(profile.axis_names("right ascension"), (ra, dec), strict=True):
        if fit.delay_s is None or not _is_off(fit.delay_s, fit.delay_sigma_s, expected_s, DELAY_OFF_S):
            continue
        delay_ms = fit.delay_s * 1000.0
        if delay_ms < 0.0:
            found.append(
                f"commands in {name} seem to act {-delay_ms:.0f} ms before they are sent: the profile dates "
                f"statuses wrongly (status_delay_s, clock_offset_s): {do}"
            )
        else:
            found.append(
                f"commands in {name} act {delay_ms:.0f} ms after their tick, "
                f"{expected_s * 1000.0:.0f} ms are expected: {do}"
            )
    return found


def _ripple_advice(profile: MountProfile, ra: AxisFigures, dec: AxisFigures) -> list[str]:
    return [
        f"the {whole_title(title)} errs by {line.amplitude_arcsec:.2f}″ "
        f"{line.cycles_a_turn:.0f} times a turn: its motor's ripple, or its encoder"
        for title, fit in zip(profile.axis_titles(), (ra, dec), strict=True)
        for line in fit.lines
        if line.amplitude_arcsec > LINE_ARCSEC
    ]


def _is_off(value: float | None, sigma: float | None, expected: float, least: float) -> bool:
    """Return whether a fitted value surely differs from the expected one, by `least` or more."""
    if value is None or sigma is None:
        return False
    return abs(value - expected) > max(least, SURE_SIGMAS * sigma)


def _why_missed(spec: RunSpec, missed: MissedFigures | None, times: TimeFigures) -> list[str]:
    """Return what may be done about a mount that was never on target."""
    held_s = sum(times.held_s.values())
    if held_s > times.acquiring_s:
        # What was seen in between, on the way to where a limit held it, is no cause.
        return []
    if missed is None:
        return ["the mount never came to follow: look at the run's messages, and rehearse the pass"]
    found = []
    first, second = spec.profile.axis_names("right ascension")
    for name, axis, other in ((first, missed.ra, missed.dec), (second, missed.dec, missed.ra)):
        if max(axis.at_rate_limit, axis.at_acceleration_limit) > LIMIT_SHARE:
            found.append(
                f"{100.0 * axis.at_rate_limit:.0f} % of the commands in {name} were at the rate limit and "
                f"{100.0 * axis.at_acceleration_limit:.0f} % at the acceleration limit: `sattrack rehearse` "
                "shows whether the mount is fast enough for the pass"
            )
        if axis.typical_arcsec > ONE_AXIS * other.typical_arcsec:
            found.append(f"only {name} was far off: look for what is peculiar to that axis")
    if spec.simulated:
        return found
    if spec.profile.calibration is None:
        found.append(f"the mount's profile was never measured: {measuring(spec.profile)}")
    return found or [f"the recording does not tell why: {measuring(spec.profile)}"]


def _off_advice(run: Trace, times: TimeFigures) -> str:
    """Return for how long a mount that had been on target was off it, and by how much, as text."""
    off = run.off_target
    ra, dec = (float(np.median(np.abs(error[off]))) for error in (run.ra_error, run.dec_error))
    spec = run.engine.spec
    first, second = spec.profile.axis_names("right ascension")
    measure = ""
    if spec.profile.calibration is None and not spec.simulated:
        measure = f"; the mount's profile was never measured: {measuring(spec.profile)}"
    return (
        f"the mount was more than {spec.plan.on_target_arcsec:g}″ off for {times.off_target_s:.0f} of the "
        f"{times.following_s:.0f} s that it followed, typically by {ra:.1f}″ in {first} and "
        f"{dec:.1f}″ in {second}{measure}"
    )


def _held_advice(times: TimeFigures) -> list[str]:
    return [
        f"{_held_by(name)} for {seconds:.0f} s: `sattrack rehearse` shows that beforehand"
        for name, seconds in times.held_s.items()
        if seconds > REPORTED_S
    ]


def _held_by(name: str) -> str:
    if name == KEYHOLE:
        return "the target was too fast for the hour angle axis near the pole (the keyhole)"
    if name == RATE:
        return "the target was too fast for the axes (max_rate_deg_s, max_acceleration_deg_s2)"
    row = ROWS.get(name)
    bound = "" if row is None else f" ({row.bound} sets it)"
    return f"the {name.replace('_', ' ')} limit held the mount off its target{bound}"

"""What a run came to: figures from the engine, periods from the loop, truth from a simulated mount."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.control.engine_view import estimate_view, learnt_view, offset_views
from sattrack.core.errors import InterruptedRunError, LinkLostError, SafetyLimitError, SattrackError
from sattrack.core.figures import RunningError, quantile
from sattrack.views.run import DatagramsView, PeriodView, Summary
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.control.engine import Engine


@dataclass(slots=True)
class RunStatistics:
    """What the loop gathers beside the engine."""

    periods_s: list[float] = field(default_factory=list)
    true_error: RunningError = field(default_factory=RunningError)
    strangers: int = 0
    unsent: int = 0
    _last_sent_s: float | None = None

    def note_sent(self, at_s: float) -> None:
        """Note the instant of a send, seconds of the run's clock."""
        if self._last_sent_s is not None:
            self.periods_s.append(at_s - self._last_sent_s)
        self._last_sent_s = at_s

    def note_truth(self, engine: Engine, counter: int, utc_s: float, ra_deg: float, dec_deg: float) -> None:
        """Note where a simulated mount's axes really were."""
        error = engine.true_error(counter, utc_s, ra_deg, dec_deg)
        if error is not None:
            self.true_error.add(error.total_arcsec)

    def period(self) -> PeriodView | None:
        """Return how regularly datagrams went out, milliseconds; None before the second one."""
        if not self.periods_s:
            return None
        ordered = [round(1000.0 * p, 4) for p in sorted(self.periods_s)]
        p50, p99, p999 = (quantile(ordered, share) for share in (0.5, 0.99, 0.999))
        return PeriodView(p50=p50, p99=p99, p999=p999, max=ordered[-1])


def summarise(engine: Engine, statistics: RunStatistics, ended_utc_s: float) -> Summary:
    """Return the summary of a finished run."""
    spec, tracker, health = engine.spec, engine.tracker, engine.session.health
    acquired = tracker.acquired_utc_s
    followable = tracker.followable_utc_s
    along_s, cross_deg = tracker.steering.biases.totals(ended_utc_s)
    why = engine.why_not_acquired()
    return Summary(
        name=spec.propagator.elements.label,
        catalog_number=spec.propagator.elements.catalog_number or None,
        mount=spec.mount_name,
        started_utc=Utc(spec.started_utc_s).isoformat("milliseconds"),
        ended_utc=Utc(ended_utc_s).isoformat("milliseconds"),
        ended_by=tracker.ended_by or "error",
        samples=engine.reported.count,
        on_target_s=round(engine.on_target_s, 3),
        acquired_after_s=_seconds_between(followable, acquired),
        reported_rms_arcsec=engine.reported.rms_arcsec,
        reported_peak_arcsec=engine.reported.peak_arcsec,
        true_rms_arcsec=statistics.true_error.rms_arcsec,
        true_peak_arcsec=statistics.true_error.peak_arcsec,
        period_ms=statistics.period(),
        datagrams=DatagramsView(
            sent=health.sent,
            received=health.received,
            lost=health.lost,
            late=health.late,
            duplicate=health.duplicate,
            rejected=health.rejected + health.frozen + statistics.strangers,
            unsent=statistics.unsent,
        ),
        bias_along_s=along_s,
        bias_cross_deg=cross_deg,
        offsets=offset_views(tracker, ended_utc_s),
        estimate=estimate_view(tracker, ended_utc_s, engine.malformed + engine.dropped),
        remembered=tracker.steering.remembered,
        recording=spec.recording,
        mount_stopped=engine.mount_stopped,
        message=engine.message or _never_followed(engine, why),
        held_s={name: round(seconds, 3) for name, seconds in engine.held_s.items()},
        paused_s=round(engine.paused_s, 3),
        rejoining_s=round(engine.rejoining_s, 3),
        lost_peak_arcsec=engine.lost_peak_arcsec if engine.held_s and acquired is not None else None,
        calibrated=spec.profile.calibration is not None,
        learnt=learnt_view(engine),
        why_not_acquired=why,
    )


def _seconds_between(first_s: float | None, second_s: float | None) -> float | None:
    return None if first_s is None or second_s is None else round(max(0.0, second_s - first_s), 3)


def _never_followed(engine: Engine, why: str | None) -> str | None:
    if engine.tracker.ended_by == "set" and engine.tracker.acquired_utc_s is None:
        paused = f" (it was paused for {engine.paused_s:.0f} s)" if engine.paused_s else ""
        cause = "" if why is None else f": {why}"
        return f"the pass ended before the mount was on the satellite{paused}{cause}"
    return None


def failure(summary: Summary, interrupted: bool) -> SattrackError | None:
    """Return the error whose exit code a run ends with; None where it went as planned."""
    words = summary.message or f"the run ended: {summary.ended_by}"
    if summary.mount_stopped is False:
        words += "; THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand"
    if summary.ended_by.startswith("limit:"):
        return SafetyLimitError(words)
    if summary.ended_by == "link":
        return LinkLostError(words)
    never_followed = summary.ended_by == "set" and summary.message is not None
    if summary.ended_by == "error" or summary.mount_stopped is False or never_followed:
        return SattrackError(words)
    if interrupted:
        return InterruptedRunError(f"interrupted; {_stop_words(summary)}")
    if summary.recording_trouble is not None:
        return SattrackError(summary.recording_trouble)
    return None


def _stop_words(summary: Summary) -> str:
    return "no mount was ever heard" if summary.mount_stopped is None else "the mount is stopped"

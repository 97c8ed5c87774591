"""What is said on the plain terminal once a run is over."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.views.run import LearntView, Summary

ALONG_AND_ACROSS = ("along_s", "cross_deg")
NO_PRIORITY = ", without real-time priority (`sattrack doctor` says how to grant it)"


def named(name: str, catalog_number: int | None) -> str:
    """Return an object's name, with its catalogue number where it has one."""
    return name if catalog_number is None else f"{name} ({catalog_number})"


def _bias_lines(summary: Summary) -> list[str]:
    others = [one for one in summary.offsets if one.what not in ALONG_AND_ACROSS]
    lines = [f"  offset {one.what}: {one.total:+.4f}" for one in others]
    if summary.remembered is not None:
        known = summary.remembered
        lines.append(f"  began with a remembered bias ({known.source}): {known.state}")
    if summary.bias_memory is not None:
        lines.append(f"  bias memory: {summary.bias_memory}")
    estimate = summary.estimate
    if estimate is None:
        return lines
    counts = f"{estimate.accepted} taken, {estimate.rejected} rejected, {estimate.refused} refused"
    lines.append(f"  observations: {counts}")
    if estimate.along_s is not None and estimate.cross_deg is not None:
        lines.append(
            f"  estimated {estimate.along_s:+.4f} ± {estimate.along_sigma_s or 0.0:.4f} s along, "
            f"{estimate.cross_deg:+.5f} ± {estimate.cross_sigma_deg or 0.0:.5f}° across"
        )
    return lines


def learnt_words(learnt: LearntView) -> str:
    """Return what was learnt of a mount in a line."""
    ra, dec = _lag(learnt.ra_lag_s, learnt.ra_lag_sigma_s), _lag(learnt.dec_lag_s, learnt.dec_lag_sigma_s)
    gains = f"gain RA {_gain(learnt.ra_gain)}, Dec {_gain(learnt.dec_gain)}"
    delay = f"command delay {1e3 * learnt.command_delay_s:.1f} ms"
    anew = f", filters begun anew {learnt.restarts} times" if learnt.restarts else ""
    return f"lag RA {ra}, Dec {dec}; {gains}; {delay}; settling {learnt.settling_s:.2f} s{anew}"


def _lag(lag_s: float, sigma_s: float) -> str:
    return f"{1e3 * lag_s:.0f}±{1e3 * sigma_s:.0f} ms"


def _gain(gain: float | None) -> str:
    return "not known" if gain is None else f"{gain:.4f}"


def summary_lines(summary: Summary) -> list[str]:
    """Return the summary for people."""
    uncalibrated = ", uncalibrated" if summary.calibrated is False and summary.mount != "sim" else ""
    lines = [
        f"{named(summary.name, summary.catalog_number)} with {summary.mount}{uncalibrated}: "
        f"ended by {summary.ended_by}",
        f"  {summary.started_utc} to {summary.ended_utc}, on target {summary.on_target_s:.1f} s",
    ]
    if summary.acquired_after_s is not None:
        lines.append(f"  acquired {summary.acquired_after_s:.1f} s after it could be followed")
    for word, rms, peak in (
        ("reported", summary.reported_rms_arcsec, summary.reported_peak_arcsec),
        ("true", summary.true_rms_arcsec, summary.true_peak_arcsec),
    ):
        if rms is not None and peak is not None:
            lines.append(f"  {word} error {rms:.3f}″ RMS, {peak:.3f}″ peak")
    for name, seconds in summary.held_s.items():
        lines.append(f"  held {seconds:.1f} s at the {name} limit")
    if summary.paused_s:
        lines.append(f"  paused for {summary.paused_s:.1f} s")
    if summary.rejoining_s:
        off = f", up to {summary.lost_peak_arcsec / 3600.0:.2g}° off" if summary.lost_peak_arcsec else ""
        lines.append(f"  on the way back to the target {summary.rejoining_s:.1f} s{off}: not in the error")
    counts = summary.datagrams
    lines.append(
        f"  datagrams: {counts.sent} sent, {counts.received} received, {counts.lost} lost, "
        f"{counts.late} late, {counts.rejected} rejected"
    )
    if summary.period_ms is not None:
        plain = "" if summary.realtime_priority is not False else NO_PRIORITY
        lines.append(
            f"  period {summary.period_ms.p50:.2f} ms median, {summary.period_ms.p99:.2f} ms p99{plain}"
        )
    if summary.bias_along_s or summary.bias_cross_deg:
        lines.append(f"  bias {summary.bias_along_s:+.3f} s along, {summary.bias_cross_deg:+.4f}° across")
    lines.extend(_bias_lines(summary))
    if summary.why_not_acquired is not None and summary.why_not_acquired not in (summary.message or ""):
        lines.append(f"  never on target: {summary.why_not_acquired}")
    if summary.learnt is not None:
        lines.append(f"  learnt of the mount: {learnt_words(summary.learnt)}")
    if summary.recording is not None:
        trouble = "" if summary.recording_trouble is None else f": {summary.recording_trouble}"
        lines.append(f"  recorded in {summary.recording}{trouble}")
    return lines

"""A report in words: lines for a terminal, and one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import html
import io
from typing import TYPE_CHECKING, Any

from sattrack.views.summary_text import named

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sattrack.recording.report import AxisFigures, AxisMissed, BiasFigures, Report, TimeFigures

TOLD_S = 1.0
UNFITTED_S = 5.0
"""Times that are shorter are not told: of the run's stages, and of what was left out of fits."""
LEAST_SHARE = 0.005
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1b2a41; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.5rem } h2 { font-size: 1.1rem; margin-top: 2rem }
table { border-collapse: collapse }
td, th { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top }
img { max-width: 100% } .what { color: #5b6b80 } .bad { color: #b3263a }
"""


def report_rows(report: Report) -> list[tuple[str, str]]:
    """Return what a report says as pairs of a name and a value, both in words."""
    rows = [
        ("pass", f"{named(report.name, report.catalog_number)}, {report.began_utc}"),
        ("mount", report.mount),
        ("followed", f"{report.followed_s:.0f} s, {report.samples} samples; ended by {report.ended_by}"),
    ]
    if not report.acquired:
        rows[:0] = [("NEVER ON TARGET", _missed(report))]
    if apart := _apart(report.times):
        rows.append(("counted apart", apart))
    if report.error is not None:
        e = report.error
        rows += [
            ("error", f"{e.rms_arcsec:.3f}″ RMS, {e.peak_arcsec:.3f}″ peak, 95 % within {e.p95_arcsec:.3f}″"),
            (
                "along, across",
                f"RMS {e.rms_along_arcsec:.3f}″, {e.rms_across_arcsec:.3f}″; mean "
                f"{e.mean_along_arcsec:+.4f}″, {e.mean_across_arcsec:+.4f}″",
            ),
        ]
    if report.link is not None:
        n = report.link
        rows.append(
            (
                "link",
                f"{n.received} statuses at {n.rate_hz:.2f} a second, {n.lost} lost; "
                f"late by {n.delay_ms:.1f} ms, 99 % by {n.delay_p99_ms:.1f} ms at most",
            )
        )
    rows.append(("the satellite's biases", _bias(report.bias)))
    for name, axis in (("hour angle axis", report.ra), ("declination axis", report.dec)):
        rows += [(name, words) for words in (_axis(axis), *_untold(axis)) if words]
    return rows


def _missed(report: Report) -> str:
    """Return what was seen of a mount that was never on target, in words."""
    if report.missed is None:
        held_s = sum(report.times.held_s.values())
        return f"limits held the mount for {held_s:.0f} s" if held_s else "the mount never came to follow"
    seen = report.missed
    return (
        f"in {report.times.acquiring_s:.0f} s of trying {seen.typical_arcsec:.1f}″ off typically, "
        f"{seen.largest_arcsec:.0f}″ at most; right ascension {_axis_missed(seen.ra)}; "
        f"declination {_axis_missed(seen.dec)}"
    )


def _axis_missed(axis: AxisMissed) -> str:
    limits = [
        f"{100.0 * share:.0f} % of its commands at the {name} limit"
        for name, share in (("rate", axis.at_rate_limit), ("acceleration", axis.at_acceleration_limit))
        if share >= LEAST_SHARE
    ]
    seen = f"{axis.typical_arcsec:.2f}″ and {axis.largest_arcsec:.0f}″"
    return ", ".join([seen, *(limits or ["no command at a limit"])])


def _apart(times: TimeFigures) -> str:
    """Return the time that no figure of the error counts, in words; empty where there is none to speak of."""
    told = [("before it was on target", times.acquiring_s)]
    told += [(f"held by the {name.replace('_', ' ')} limit", held) for name, held in times.held_s.items()]
    told += [("paused", times.paused_s), ("rejoining", times.rejoining_s)]
    words = [f"{name} {seconds:.1f} s" for name, seconds in told if seconds >= TOLD_S]
    if times.following_s - times.fitted_s >= UNFITTED_S:
        words.append(f"following, but not steadily enough to fit {times.following_s - times.fitted_s:.1f} s")
    return "; ".join(words)


def _bias(bias: BiasFigures | None) -> str:
    if bias is None:
        return "not known: no observation in it, and a mount that follows tells nothing of the satellite"
    if bias.source == "nudge":
        return (
            f"{bias.along_s:+.3f} s along, {bias.cross_deg:+.4f}° across: the operator's last word, "
            f"at {bias.utc}, not measured"
        )
    along, along_sigma, cross, cross_sigma = (
        60.0 * (value or 0.0)
        for value in (
            bias.along_drift_s_s,
            bias.along_drift_sigma_s_s,
            bias.cross_drift_km_s,
            bias.cross_drift_sigma_km_s,
        )
    )
    return (
        f"{bias.along_s:+.4f} ± {bias.along_sigma_s or 0.0:.4f} s along, "
        f"{bias.cross_deg:+.5f} ± {bias.cross_sigma_deg or 0.0:.5f}° across, as of {bias.utc}; "
        f"drift {along:+.4f} ± {along_sigma:.4f} s and {cross:+.4f} ± {cross_sigma:.4f} km a minute; "
        f"from {bias.observations} observations, {bias.rejected} left out"
    )


def _axis(axis: AxisFigures) -> str:
    """Return what was fitted of an axis; empty where nothing was."""
    told = []
    if axis.gain is not None:
        sigma = axis.gain_sigma or 0.0
        sigma_words = f"{sigma:.6f}" if sigma >= 1e-6 else f"{sigma:.0e}"
        told.append(f"gain {axis.gain:.6f} ± {sigma_words}")
    if axis.delay_s is not None:
        sigma_ms = 1000.0 * (axis.delay_sigma_s or 0.0)
        dated = "" if axis.delay_s >= 0.0 else " by the statuses' dates, which are wrong then"
        told.append(f"acts {axis.delay_s * 1000.0:.2f} ± {sigma_ms:.2f} ms after the tick{dated}")
    words = ", ".join(told)
    repeating = [
        f"repeats {line.cycles_a_turn:.1f} times a turn with {line.amplitude_arcsec:.3f}″"
        for line in axis.lines
    ]
    return "; ".join([words, *repeating] if words else repeating)


def _untold(axis: AxisFigures) -> list[str]:
    return [f"not enough to tell {words}" for words in axis.untold]


def nothing_to_change(report: Report) -> str:
    """Return what to say where there is no advice: "nothing" only where everything could be told."""
    if report.acquired and not report.ra.untold and not report.dec.untold:
        return "nothing"
    return "nothing, as far as this recording tells"


def all_rows(report: Report) -> list[tuple[str, str]]:
    """Return a report for a terminal: what it says, what to change, and what is wrong with the file."""
    advice = report.advice or (nothing_to_change(report),)
    return [
        *report_rows(report),
        *(("to change", words) for words in advice),
        *(("wrong with the file", words) for words in report.problems),
    ]


TREND_HEADS = ("began", "object", "RMS ″", "peak ″", "along s", "across °", "gain HA", "gain Dec", "delay ms")


def trend_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    """Return one row a recording, in order of time, under TREND_HEADS."""
    rows: list[tuple[str, ...]] = []
    for one in sorted(reports, key=lambda r: r.began_utc):
        bias, error = one.bias, one.error
        label = "" if bias is None or bias.source == "observations" else " (nudge)"
        rows.append(
            (
                one.began_utc,
                one.name,
                _number(None if error is None else error.rms_arcsec, 3),
                _number(None if error is None else error.peak_arcsec, 3),
                _number(None if bias is None else bias.along_s, 3) + label,
                _number(None if bias is None else bias.cross_deg, 4) + label,
                _number(one.ra.gain, 5),
                _number(one.dec.gain, 5),
                _number(None if one.ra.delay_s is None else one.ra.delay_s * 1000.0, 2),
            )
        )
    return rows


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def report_html(reports: Sequence[tuple[Report, Mapping[str, Any]]], trend: Any | None, version: str) -> str:
    """Return one HTML file with figures and plots; nothing in it is fetched from anywhere."""
    title = "Recorded passes" if len(reports) > 1 else f"{reports[0][0].name}, {reports[0][0].began_utc}"
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>",
        f"<h1>{html.escape(title)}</h1>",
    ]
    if len(reports) > 1:
        heads = "".join(f"<th>{html.escape(head)}</th>" for head in TREND_HEADS)
        parts.append(f"<h2>Trend</h2><table><tr>{heads}</tr>")
        for row in trend_rows([report for report, _ in reports]):
            cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row)
            parts.append(f"<tr>{cells}</tr>")
        parts.append("</table>")
        if trend is not None:
            parts.append(_image("Trend", trend))
    for report, plots in reports:
        if len(reports) > 1:
            parts.append(f"<h1>{html.escape(report.name)}, {html.escape(report.began_utc)}</h1>")
        parts += _sections(report, plots)
    parts.append(f'<p class="what">sattrack {html.escape(version)}</p></body></html>')
    return "\n".join(parts) + "\n"


def _sections(report: Report, plots: Mapping[str, Any]) -> list[str]:
    parts = ["<table>"]
    for number, (name, value) in enumerate(report_rows(report)):
        tone = "what" if report.acquired or number else "bad"
        parts.append(f'<tr><td class="{tone}">{html.escape(name)}</td><td>{html.escape(value)}</td></tr>')
    parts.append("</table><h2>What to change</h2><ul>")
    parts += [f"<li>{html.escape(words)}</li>" for words in report.advice or (nothing_to_change(report),)]
    parts.append("</ul>")
    if report.problems:
        words = "; ".join(report.problems)
        parts.append(f'<p class="bad">{html.escape(words)}</p>')
    for title, figure in plots.items():
        parts.append(f"<h2>{html.escape(title)}</h2>{_image(title, figure)}")
    return parts


def _image(title: str, figure: Any) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, dpi=110, format="png")
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(title)}" src="data:image/png;base64,{data}">'

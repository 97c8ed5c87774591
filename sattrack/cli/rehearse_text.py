"""A rehearsal's report as lines of a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tle.errors import printable

if TYPE_CHECKING:
    from sattrack.planning.rehearsal import CutMoment, RehearsalReport

ROWS = 9
"""Moments of the pass for which the time after a cut link is printed."""


def report_lines(report: RehearsalReport) -> list[str]:
    """Return the report in colours."""
    return [
        *_head(report),
        *_lost(report),
        *_limits(report),
        *_keyholes(report),
        *_sides(report),
        *_link_loss(report),
        *_budget(report),
        *(f"Note: {note}" for note in report.notes),
    ]


def _head(report: RehearsalReport) -> list[str]:
    verdict = click.style(report.verdict, fg="green" if report.go else "red", bold=True)
    return [
        f"{printable(report.name)} from {report.start_utc[:19]}Z to {_clock(report.end_utc, report)}, "
        f"{report.max_alt_deg:.1f}° high at {_clock(report.culminate_utc, report)}, "
        f"with {printable(report.profile)}",
        verdict,
    ]


def _clock(utc: str, report: RehearsalReport, decimals: int = 0) -> str:
    """Return the time of day of an instant, after month and day where a pass goes on past midnight."""
    first = 11 if report.start_utc[:10] == report.end_utc[:10] else 5
    return utc[first : 19 + (decimals + 1 if decimals else 0)].replace("T", " ")


def _title(words: str) -> str:
    return click.style(words, bold=True)


def _lost(report: RehearsalReport) -> list[str]:
    if not report.lost:
        return []
    lines = ["", _title(f"{'Lost from':16} {'to':16} {'seconds':>8}  {'limit':13} why")]
    lines += [
        f"{_clock(lost.from_utc, report, 1):16} {_clock(lost.to_utc, report, 1):16} "
        f"{lost.seconds:8.1f}  {lost.limit:13} {lost.why}"
        for lost in report.lost
    ]
    return lines


def _limits(report: RehearsalReport) -> list[str]:
    lines = [
        "",
        _title(
            f"{'Axis':13} {'asked °/s':>10} {'followed':>10} {'limit':>8} {'asked °/s²':>11} {'limit':>8}"
        ),
    ]
    for peak in report.peaks:
        reached = "-" if peak.reached_rate_deg_s is None else f"{peak.reached_rate_deg_s:.3f}"
        over = (
            peak.asked_rate_deg_s > peak.limit_rate_deg_s
            or peak.asked_acceleration_deg_s2 > peak.limit_acceleration_deg_s2
        )
        lines.append(
            click.style(
                f"{peak.axis.replace('_', ' '):13} {peak.asked_rate_deg_s:10.3f} {reached:>10} "
                f"{peak.limit_rate_deg_s:8g} {peak.asked_acceleration_deg_s2:11.3f} "
                f"{peak.limit_acceleration_deg_s2:8g}",
                fg="red" if over else None,
            )
        )
    lines += ["", _title(f"{'Limit':20} {'nearest':>9}  at")]
    for margin in report.margins:
        words = f"{margin.limit.replace('_', ' '):20} {margin.least_deg:8.1f}°  {_clock(margin.utc, report)}"
        lines.append(click.style(words, fg="red" if margin.least_deg < 0.0 else None))
    return lines


def _keyholes(report: RehearsalReport) -> list[str]:
    lines = []
    for hole in report.keyholes:
        through = "the mount cannot" if hole.through_pole_s is None else f"{hole.through_pole_s:.1f} s"
        lines.append(
            f"Keyhole at {_clock(hole.utc, report)}, {hole.polar_distance_deg:.2f}° from the pole, "
            f"{hole.peak_rate_deg_s:.1f} °/s: {hole.clipped_s:.1f} s lost by clipping, {hole.round_s:.1f} s "
            f"by the best way round, through the pole {through}; it goes {hole.chosen}"
        )
    return ["", *lines] if lines else []


def _sides(report: RehearsalReport) -> list[str]:
    cables = report.cables
    return [
        "",
        f"Side: {report.sides.words}",
        f"Cables: the hour angle axis stands between {cables.low_deg:.0f}° and {cables.high_deg:.0f}°, "
        f"of {cables.limit_deg:g}° either way",
    ]


def _link_loss(report: RehearsalReport) -> list[str]:
    loss = report.link_loss
    lines = [
        "",
        f"If the link is cut and the mount holds its rates: {_cut(loss.worst, report)}",
        *_cut_table(report),
    ]
    if loss.watchdog_s is None:
        lines.append("The mount has no watchdog: nothing on this side can stop it then")
    elif loss.rests_inside:
        lines.append(
            f"Its watchdog ({loss.watchdog_s:g} s) brings it to rest before any limit, whenever that is"
        )
    else:
        lines.append(
            click.style(f"Its watchdog ({loss.watchdog_s:g} s) comes too late at some moments", fg="red")
        )
    return lines


def _cut_table(report: RehearsalReport) -> list[str]:
    """Return the time to the first limit from moments of the pass; nothing where none is ever met."""
    loss = report.link_loss
    if loss.worst.seconds_to_limit is None:
        return []
    count = len(loss.curve)
    shown = sorted({round(k * (count - 1) / max(1, ROWS - 1)) for k in range(min(ROWS, count))})
    head = f"{'Cut at':14} {'to a limit':>12}  {'limit':13}"
    lines = [_title(head.rstrip() if loss.watchdog_s is None else f"{head} {'at rest':>8}")]
    for k in shown:
        moment = loss.curve[k]
        seconds = f"over {loss.looked_s:.0f} s"
        if moment.seconds_to_limit is not None:
            seconds = f"{moment.seconds_to_limit:.1f} s"
        words = f"{_clock(moment.utc, report):14} {seconds:>12}  {(moment.limit or '-').replace('_', ' '):13}"
        if moment.seconds_to_rest is not None:
            words += f" {moment.seconds_to_rest:6.1f} s"
        lines.append(words.rstrip())
    return lines


def _cut(moment: CutMoment, report: RehearsalReport) -> str:
    if moment.seconds_to_limit is None:
        return f"no limit within {report.link_loss.looked_s / 60.0:.0f} minutes, at any moment"
    return (
        f"at worst {moment.seconds_to_limit:.1f} s to the {(moment.limit or '').replace('_', ' ')} limit "
        f"(cut at {_clock(moment.utc, report)})"
    )


def _budget(report: RehearsalReport) -> list[str]:
    budget = report.budget
    lines = [
        "",
        _title(f"{'Error expected, 1σ':20} {'along ″':>9} {'across ″':>9}")
        + f"  at {_clock(budget.utc, report)}, {budget.alt_deg:.0f}° high",
    ]
    lines += [
        f"{part.name:20} {part.along_arcsec:9.2f} {part.across_arcsec:9.2f}  {part.why}"
        for part in budget.parts
    ]
    words = ""
    if budget.fov_deg is not None:
        inside = "within" if budget.fits else "NOT within"
        words = f"  two sigmas are {inside} a field of {budget.fov_deg:g}°"
    lines.append(_title(f"{'all':20} {budget.along_arcsec:9.2f} {budget.across_arcsec:9.2f}") + words)
    return lines

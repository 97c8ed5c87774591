"""A plan as text: the passes taken, those that lost and why, and what each entry came to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tle.errors import printable

if TYPE_CHECKING:
    from sattrack.schedule.plan import Asked, LostPass, Plan, PlannedPass

MOST_LOST = 60
_HEAD = "  #  Start UTC  End       Idle     Slew s  Alt°   Sun°  Useful s  Value     Satellite"
_LOST_HEAD = "     Start UTC  End       Alt°  Value     Why"


def plan_lines(plan: Plan) -> list[str]:
    """Return the lines of a table."""
    lines = [
        f"{printable(plan.schedule)}: {_short(plan.from_utc)} to {_short(plan.to_utc)} UTC, "
        f"mount {printable(plan.profile)}; times in the file without a zone are {plan.timezone}"
    ]
    if plan.passes:
        lines += ["", click.style(_HEAD, bold=True)]
    day = plan.from_utc[:10]
    for one in plan.passes:
        day = _new_day(lines, one.start_utc, day)
        lines += _pass_lines(one)
    lines += ["", _total(plan)]
    if plan.lost:
        lines += ["", click.style("Not taken", bold=True), click.style(_LOST_HEAD, bold=True)]
        day = plan.from_utc[:10]
        for lost in plan.lost[:MOST_LOST]:
            day = _new_day(lines, lost.start_utc, day)
            lines.append(_lost_line(lost))
        if plan.lost[MOST_LOST:]:
            lines.append(f"     and {len(plan.lost) - MOST_LOST} more; --json has them all")
    lines += ["", click.style("Asked for", bold=True)]
    lines += [_asked_line(one) for one in plan.asked]
    lines.append(_conditions(plan))
    return lines


def _new_day(lines: list[str], utc: str, day: str) -> str:
    if utc[:10] != day:
        lines.append(click.style(utc[:10], bold=True))
    return utc[:10]


def _pass_lines(one: PlannedPass) -> list[str]:
    name = printable(one.name or str(one.catalog_number))
    sun = "-" if one.sun_alt_deg is None else f"{one.sun_alt_deg:.0f}"
    words = name + ("  shortened" if one.shortened else "")
    if one.priority != 1.0:
        words += f"  priority {one.priority:g}"
    lines = [
        f"{one.number:3d}  {one.start_utc[11:19]}   {one.end_utc[11:19]}  {duration(one.idle_s):>7}  "
        f"{one.slew_s:6.1f}  {one.max_alt_deg:5.1f}  {sun:>4}  {one.useful_s:8.0f}  {one.value:8.0f}  {words}"
    ]
    indent = " " * 5
    extra = [("before", list(one.before)), ("after", list(one.after))]
    if one.bias_along_s or one.bias_cross_deg:
        extra.append(("bias", [f"{one.bias_along_s:g} s along, {one.bias_cross_deg:g}° across"]))
    extra.append(("lost", [f"{lost.seconds:.0f} s to the {lost.limit}: {lost.why}" for lost in one.lost_to]))
    if one.rehearsed is not None:
        extra.append(("rehearsed", [one.rehearsed.verdict]))
    extra.append(("note", list(one.notes)))
    lines += [f"{indent}{what}: {printable('; '.join(said))}" for what, said in extra if said]
    return lines


def _lost_line(one: LostPass) -> str:
    name = printable(one.name or str(one.catalog_number))
    return (
        f"     {one.start_utc[11:19]}   {one.end_utc[11:19]}  {one.max_alt_deg:5.1f}  {one.value:8.0f}  "
        f"{name}: {click.style(one.reason, fg='yellow')}: {printable(one.why)}"
    )


def _total(plan: Plan) -> str:
    count = len(plan.passes)
    return (
        f"{count} {'pass' if count == 1 else 'passes'}, {plan.useful_s:.0f} useful seconds, "
        f"value {plan.value:.0f}; {duration(plan.slew_s)} of slews, "
        f"{duration(plan.idle_s)} idle before and between; {len(plan.lost)} lost"
    )


def _asked_line(one: Asked) -> str:
    said = [f"{one.passes} seen", f"{one.planned} planned", f"{one.lost} lost"]
    said += [f"{count} {why}" for why, count in one.left_out.items()]
    return f"     {printable(one.asked_at)}: {printable(one.asked_by)}: {', '.join(said)}"


def _conditions(plan: Plan) -> str:
    weather = "nobody is asked about the weather" if plan.weather is None else f"weather by {plan.weather}"
    return f"     {printable(weather)}; the mount is {'parked' if plan.park_at_end else 'left'} at the end"


def duration(seconds: float) -> str:
    """Return seconds as 95s, 12m05s or 3h07m."""
    whole = round(seconds)
    if whole < 100:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}s"
    return f"{whole // 3600}h{whole % 3600 // 60:02d}m"


def _short(utc: str) -> str:
    return utc[:16].replace("T", " ")

"""The morning's summary of a night: as text, and as a page of HTML with links to the recordings. Pure."""

from __future__ import annotations

from collections import Counter
from html import escape
from typing import TYPE_CHECKING, NamedTuple

from sattrack.schedule.night import Mount
from sattrack.schedule.results import held_words
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.schedule.night import NightPass, Result, Run

COLOURS = {"done": "#2e7d32", "partly": "#b26a00", "lost": "#b3261e"}


class Figures(NamedTuple):
    """What a night came to, in numbers; seconds."""

    planned: int
    done: int
    partly: int
    lost: int
    on_target_s: float
    planned_s: float
    causes: dict[str, int]
    others: dict[str, int]


def figures(run: Run) -> Figures:
    """Return the figures of a night; a pass without a result counts as lost, "not reached"."""
    pairs = list(zip(run.passes, run.results, strict=False))
    states = Counter(result.state for _, result in pairs)
    causes = Counter(str(result.cause) for _, result in pairs if result.state != "done")
    missing = len(run.passes) - len(pairs)
    if missing:
        causes["not reached"] = missing
    return Figures(
        planned=len(run.passes),
        done=states["done"],
        partly=states["partly"],
        lost=states["lost"] + missing,
        on_target_s=round(sum(result.on_target_s for _, result in pairs), 1),
        planned_s=round(sum(one.end_utc_s - one.start_utc_s for one in run.passes), 1),
        causes=dict(sorted(causes.items())),
        others=dict(sorted(run.others.items())),
    )


def summary_name(run: Run) -> str:
    """Return the name of a night's files, without an ending."""
    return f"night-{run.night:03d}-{_iso(run.night_from_utc_s)[:10]}"


def headline(run: Run) -> str:
    """Return a night in one sentence."""
    found = figures(run)
    words = f"{found.done} of {found.planned} passes done"
    if found.partly:
        words += f", {found.partly} in part"
    if found.lost:
        words += f", {found.lost} lost"
    return f"night {run.night}: {words}; {found.on_target_s:.0f} s on target; {_mount_words(run)}"


def text_lines(run: Run, schedule: str) -> list[str]:
    """Return the summary as lines of text."""
    lines = [
        headline(run),
        f"{printable(schedule)}: {_iso(run.night_from_utc_s)} to {_iso(run.night_to_utc_s)}",
        "",
    ]
    if run.passes:
        lines.append("  #  Start UTC  State   On target s   RMS ″  Satellite")
    for one, result in _rows(run):
        lines.append(_line(one, result))
        if result is not None and result.recordings:
            lines.append(f"     {', '.join(printable(name) for name in result.recordings)}")
    found = figures(run)
    if found.causes:
        lines += ["", "Not done, by cause: " + _counted(found.causes)]
    if found.others:
        lines += ["", "Seen and not planned: " + _counted(found.others)]
    if run.notes:
        lines += ["", "Notes"]
        lines += [f"  {printable(note)}" for note in run.notes]
    return lines


def page(run: Run, schedule: str, recordings: str = "") -> str:
    """Return the summary as a page of HTML; `recordings` is what leads from it to their folder."""
    found = figures(run)
    rows = "\n".join(_row(one, result, recordings) for one, result in _rows(run))
    lists = ""
    for title, counted in (("Not done, by cause", found.causes), ("Seen and not planned", found.others)):
        if counted:
            lists += f"<p>{title}: {escape(_counted(counted))}</p>\n"
    notes = "".join(f"<li>{escape(note)}</li>" for note in run.notes)
    if notes:
        notes = f"<h2>Notes</h2>\n<ul>{notes}</ul>\n"
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(headline(run))}</title>
<meta name="viewport" content="width=device-width">
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 60rem; padding: 0 1rem; }}
h1 {{ font-size: 1.4rem; }}
h2 {{ font-size: 1.1rem; }}
td:nth-child(2) {{ white-space: nowrap; }}
table {{ border-collapse: collapse; width: 100%; }}
th, td {{ text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #8884; vertical-align: top; }}
td.n, th.n {{ text-align: right; font-variant-numeric: tabular-nums; }}
@media (prefers-color-scheme: dark) {{ body {{ background: #15171a; color: #ddd; }} a {{ color: #8ab4f8; }} }}
</style></head><body>
<h1>{escape(headline(run))}</h1>
<p>{escape(schedule)}: {_iso(run.night_from_utc_s)} to {_iso(run.night_to_utc_s)}</p>
<table>
<tr><th class="n">#</th><th>Start UTC</th><th>Satellite</th><th>State</th><th class="n">On target s</th>
<th class="n">RMS ″</th><th class="n">Peak ″</th><th>Recordings</th></tr>
{rows}
</table>
{lists}{notes}</body></html>
"""


def _rows(run: Run) -> list[tuple[NightPass, Result | None]]:
    return [(one, run.results[k] if k < len(run.results) else None) for k, one in enumerate(run.passes)]


def _line(one: NightPass, result: Result | None) -> str:
    start = _iso(one.start_utc_s)[11:19]
    if result is None:
        return f"{one.number:3d}  {start}   not reached                   {printable(one.name)}"
    whole_s = one.end_utc_s - one.start_utc_s
    rms = "-" if result.rms_arcsec is None else f"{result.rms_arcsec:.2f}"
    on_target = f"{result.on_target_s:.0f} of {whole_s:.0f}"
    why = f": {result.cause}" if result.cause else ""
    why += f": {printable(result.words)}" if result.words else ""
    held = held_words(result)
    why += f"; {held}" if held else ""
    return (
        f"{one.number:3d}  {start}   {result.state:<6}  {on_target:>11}  {rms:>6}  {printable(one.name)}{why}"
    )


def _row(one: NightPass, result: Result | None, recordings: str) -> str:
    state = "not reached" if result is None else result.state
    colour = COLOURS.get(state, "#777")
    why = "" if result is None or result.cause is None else escape(f": {result.cause}: {result.words or ''}")
    why += f"; {escape(held_words(result))}" if result is not None and held_words(result) else ""
    cells = ["-", "-", "-"]
    links = ""
    if result is not None:
        whole_s = one.end_utc_s - one.start_utc_s
        arcsec = ("-" if x is None else f"{x:.2f}" for x in (result.rms_arcsec, result.peak_arcsec))
        cells = [f"{result.on_target_s:.0f} of {whole_s:.0f}", *arcsec]
        links = "<br>".join(
            f'<a href="{escape(recordings + name)}">{escape(name)}</a>' for name in result.recordings
        )
    numbers = "".join(f'<td class="n">{cell}</td>' for cell in cells)
    return (
        f'<tr><td class="n">{one.number}</td><td>{_iso(one.start_utc_s)[:19].replace("T", " ")}</td>'
        f'<td>{escape(one.name)}</td><td><span style="color:{colour}">{state}</span>{why}</td>'
        f"{numbers}<td>{links}</td></tr>"
    )


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.items())


def _mount_words(run: Run) -> str:
    if run.mount is Mount.PARKED:
        return "the mount is parked"
    if run.mount is Mount.AT_PARK:
        return "the mount rests at its park position, drives on"
    return "THE MOUNT IS NOT PARKED" if run.ways.park else "the mount is left where it is"


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("seconds")

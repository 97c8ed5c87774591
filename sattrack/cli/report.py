"""`sattrack report`: what recorded passes tell of error, mount, link and satellite."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack import __version__
from sattrack.cli.common import CommandContext, common_options, renew, show, table, tell
from sattrack.cli.recording import write_tdm
from sattrack.core.errors import BadInputError
from sattrack.recording.rendering import TREND_HEADS, all_rows, report_html, trend_rows
from sattrack.recording.report import make_report
from sattrack.recording.trace import trace
from sattrack.runtime.bias_memory import keep_fit
from sattrack.runtime.facts import engine_of, open_recording

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.recording.fits import BiasFit
    from sattrack.recording.format import Recording
    from sattrack.recording.report import Report
    from sattrack.recording.trace import Trace
    from sattrack.runtime.facts import RunFacts

_path = click.Path(path_type=Path)


@click.command("report")
@click.argument("files", nargs=-1, required=True, type=_path)
@click.option("--html", "html_file", type=_path, metavar="FILE", help="Figures and plots in one HTML file.")
@click.option("--png", "folder", type=_path, metavar="FOLDER", help="Each plot as a PNG in this folder.")
@click.option("--tdm", type=_path, metavar="FILE", help="The observations of one recording as a CCSDS TDM.")
@click.option("--part", default=1, show_default=True, help="Which, where a file holds several recordings.")
@click.option(
    "--bias-memory",
    type=click.Choice(("auto", "on", "off")),
    default="auto",
    show_default=True,
    help="Keep the fitted biases for the next pass: auto those of real mounts, on all, off none.",
)
@common_options
def command(context: CommandContext, files: tuple[Path, ...], **options: Any) -> int:
    """Tell what recorded passes show: error, link, gains and delays, the satellite's biases, what to change.

    With several files, the trend over them too. Biases are fitted from observations that came in during the
    run; without any, the operator's last nudge is told as such.
    """
    html_file, folder, tdm = options["html_file"], options["folder"], options["tdm"]
    if tdm is not None and len(files) > 1:
        raise BadInputError("--tdm takes one recording at a time")
    for out in (html_file, tdm):
        if out is not None and out.exists():
            raise BadInputError(f"{out}: exists already; give another name")
    found = []
    for number, file in enumerate(files):
        recording, facts = open_recording(file, options["part"])
        if tdm is not None:
            write_tdm(recording, facts, tdm)
        run = trace(recording, engine_of, _progress(number, len(files)))
        report, fit = make_report(recording, run)
        kept = None if fit is None else keep_fit(fit, facts, options["bias_memory"])
        if kept is not None:
            tell(f"bias memory: {kept}")
        found.append((recording, facts, run, report, fit))
    _wipe()
    reports = [report for _, _, _, report, _ in found]
    if html_file is not None or folder is not None:
        _draw(found, html_file, folder)
    if context.json:
        click.echo(msgspec.json.encode(reports if len(reports) > 1 else reports[0]).decode())
        return 0
    for report in reports:
        show(table("", "", rows=all_rows(report)), *([""] if len(reports) > 1 else []))
    if len(reports) > 1:
        show(table(*TREND_HEADS, rows=trend_rows(reports)))
    return 0


def _draw(
    found: Sequence[tuple[Recording, RunFacts, Trace, Report, BiasFit | None]],
    html_file: Path | None,
    folder: Path | None,
) -> None:
    from sattrack.recording.rendering import figures, save, trend

    plots = [(report, figures(run, fit)) for _, _, run, report, fit in found]
    over_time = trend([report for report, _ in plots])
    try:
        if html_file is not None:
            html_file.write_text(report_html(plots, over_time, __version__), encoding="utf-8")
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"{html_file or folder}: cannot be written: {error.strerror}") from error
    if folder is None:
        return
    for (recording, *_), (_, drawn) in zip(found, plots, strict=True):
        for title, figure in drawn.items():
            name = title.lower().replace(" ", "-").replace("'", "")
            save(figure, folder / f"{recording.path.stem}-{name}.png")
    if over_time is not None:
        save(over_time, folder / "trend.png")
    tell(f"plots are in {folder}")


def _progress(number: int, count: int) -> Callable[[float], None] | None:
    if not sys.stderr.isatty():
        return None
    return lambda share: renew(f"{100.0 * (number + share) / count:.0f} %")


def _wipe() -> None:
    if sys.stderr.isatty():
        renew()

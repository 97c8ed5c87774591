"""What was recorded: `sattrack recording` and `sattrack report`."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack import __version__
from sattrack.cli.common import CommandContext, OutputFile, RenamedOption, common_options
from sattrack.cli.output import renew, say, share_progress, show, table, tell, write_file
from sattrack.core import local_time
from sattrack.core.angles import wrap180
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.files import replace_file
from sattrack.recording.export import (
    ERROR,
    TABLES,
    error_columns,
    random_shift_s,
    table_of,
    write_anonymous,
    write_as_it_is,
)
from sattrack.recording.rendering import (
    TREND_HEADS,
    all_rows,
    new_figure,
    pictures,
    png,
    report_html,
    trend,
    trend_rows,
)
from sattrack.recording.report import make_report, unused
from sattrack.recording.trace import trace
from sattrack.runtime.bias_memory import keep_fit
from sattrack.runtime.facts import SAME_SITE_DEG, engine_of, open_recording
from sattrack.views.formatting import iso_unix_s
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.control.engine import Engine
    from sattrack.recording.export import Columns
    from sattrack.recording.fits import BiasFit
    from sattrack.recording.format import Recording, RecordingView
    from sattrack.recording.report import Report
    from sattrack.recording.trace import Trace
    from sattrack.runtime.facts import RunFacts

    _Reported = tuple[Recording, RunFacts, Trace, Report, BiasFit | None]
    _Drawn = tuple[Path, Report, dict[str, bytes]]
    _Passed = tuple[Recording, RunFacts, Trace]

_path = click.Path(path_type=Path)


FORMATS = ("mcap", "pcapng", "csv", "json", "parquet", "tdm")
_part = click.option("--part", default=1, show_default=True, help="Which recording, if a file holds several.")


@click.group("recording")
def command() -> None:
    """Look into a recording, or write what is in it in another format.

    \b
    Examples:
      sattrack recording info tonight.mcap
      sattrack recording export tonight.mcap tonight.pcapng
    """


@command.command("info", short_help="Show what a recording holds, and what is wrong with it.")
@click.argument("file", type=click.Path(path_type=Path))
@_part
@common_options("json", "utc")
def info(context: CommandContext, file: Path, part: int) -> int:
    """Show what a recording holds, where it was made, and what is wrong with it.

    \b
    Examples:
      sattrack recording info tonight.mcap
    """
    from sattrack.recording.format import look

    recording, facts = open_recording(file, part)
    view = look(recording)
    if context.json:
        click.echo(msgspec.json.encode(view).decode())
    else:
        say("\n".join(_lines(view, facts, recording.parts)))
    return 0


def _lines(view: RecordingView, facts: RunFacts, parts: int) -> list[str]:
    site = facts.site
    made = view.environment
    times = "nothing in it"
    if view.began_utc is not None and view.ended_utc is not None:
        times = local_time.span(iso_unix_s(view.began_utc), iso_unix_s(view.ended_utc))
    lines = [
        f"{facts.target.label}, {times} ({view.seconds:.0f} s)",
        f"mount {facts.mount_name}, profile {facts.profile.name}; "
        f"site {site.latitude_deg:.4f}, {site.longitude_deg:.4f}, {site.height_m:.0f} m",
        f"format {view.format_version}, sattrack {view.program_version}"
        + ("" if view.fingerprint is None else f", code {view.fingerprint}"),
    ]
    if made is not None:
        libraries = ", ".join(f"{name} {version}" for name, version in made.libraries.items())
        lines.append(f"made on {made.processor}, {made.machine}, Python {made.python}, {libraries}")
    lines.append(", ".join(f"{count} {topic}" for topic, count in view.messages.items()))
    whole = view.seconds > 0.0 and parts == 1
    rate = f", {view.bytes * 600.0 / view.seconds / 1e6:.1f} MB for ten minutes" if whole else ""
    lines.append(f"{view.bytes / 1e6:.2f} MB{rate}")
    lines += view.problems or ("nothing is wrong with it",)
    return lines


@command.command("export", short_help="Write a recording in another format.")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("out", type=OutputFile(new=True))
@click.option("--format", "kind", type=click.Choice(FORMATS), help="Default: by the ending of OUT.")
@click.option(
    "--table",
    type=click.Choice(TABLES),
    default="status",
    show_default=True,
    help="The table, for CSV and JSON.",
)
@click.option("--anonymous", is_flag=True, help="Shift site and time together, and omit names.")
@_part
@common_options()
def export(context: CommandContext, file: Path, out: Path, **options: Any) -> int:
    """Write a recording as pcapng (Wireshark), CSV, JSON, Parquet or CCSDS TDM, or its readable part as MCAP.

    pcapng holds every datagram, TDM the observations that came in. CSV, JSON and Parquet hold one table; the
    table "error" has the error at every status, from which the figures of `sattrack report` can be computed.
    --anonymous moves the site to another longitude and shifts all instants to match. The latitude stays, and
    anyone who finds the orbit in a catalogue's history can find the rest.

    \b
    Examples:
      sattrack recording export tonight.mcap tonight.pcapng
      sattrack recording export tonight.mcap error.csv --table error
    """
    kind = options["kind"] or out.suffix.removeprefix(".")
    if kind not in FORMATS:
        raise BadInputError(f"{out}: unknown ending; give --format {'|'.join(FORMATS)}")
    recording, facts = open_recording(file, options["part"])
    for text in recording.problems:
        tell(f"{file}: {text}")
    with tempfile.TemporaryDirectory() as folder:
        if options["anonymous"]:
            moved = Path(folder) / "anonymous.mcap"
            with moved.open("wb") as stream:
                write_anonymous(recording, stream, random_shift_s())
            recording, facts = open_recording(moved)
        try:
            _write(kind, recording, facts, out, options["table"])
        except BaseException:
            # There was no such file: half of one must not be taken for all of it.
            out.unlink(missing_ok=True)
            raise
    return 0


def _write(kind: str, recording: Recording, facts: RunFacts, out: Path, table: str) -> None:
    from sattrack.recording.export import write_csv, write_json, write_parquet, write_pcapng

    if kind == "mcap":
        try:
            with out.open("xb") as stream:
                write_as_it_is(recording, stream)
        except OSError as error:
            raise BadInputError(f"{out}: cannot be written: {error.strerror}") from error
    elif kind == "pcapng":
        write_pcapng(recording, out)
    elif kind == "tdm":
        write_tdm(recording, facts, out)
    else:
        columns = _errors(recording) if table == ERROR else table_of(recording, table)
        {"csv": write_csv, "json": write_json, "parquet": write_parquet}[kind](columns, out)


def _errors(recording: Recording) -> Columns:
    """Return the table of errors; a message says where it ends before the recording does."""
    run = trace(recording, engine_of)
    for text in unused(run, "the table"):
        tell(text)
    return error_columns(run)


def write_tdm(recording: Recording, facts: RunFacts, out: Path, engine: Engine | None = None) -> None:
    """Write the observations in a recording as a TDM; raises SattrackError where there are none.

    `engine` is that of its run made again, where that is available.
    """
    from sattrack.recording.export import knowing, seen_in, tdm_text
    from sattrack.recording.format import observations

    if facts.elements is None:
        raise SattrackError(
            f"{recording.path}: a TDM is written of a satellite with elements, not of {facts.target.label}"
        )
    count = len(observations(recording, facts.elements.catalog_number))
    if not count:
        raise SattrackError(
            f"{recording.path}: it holds no observation, so there is nothing for a TDM: where a mount points "
            "says nothing about the satellite"
        )
    seen = seen_in(recording, engine or knowing(recording, engine_of))
    if len(seen) < count:
        tell(f"{count - len(seen)} of {count} observations are nowhere near the orbit, and are left out")
    write_file(out, tdm_text(seen, facts.elements, facts.site.place(), time.time(), "observed with sattrack"))


@click.command("report")
@click.argument("files", nargs=-1, required=True, type=_path)
@click.option(
    "--output",
    "--html",
    "html_file",
    cls=RenamedOption,
    type=OutputFile(new=True, endings=(".html", ".htm")),
    metavar="FILE",
    help="Write figures and plots to one HTML file.",
)
@click.option(
    "--plot",
    "--png",
    "folder",
    cls=RenamedOption,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Write each plot as an image (PNG) into this folder.",
)
@click.option(
    "--tdm",
    type=OutputFile(new=True),
    metavar="FILE",
    help="The observations of one recording as a CCSDS TDM.",
)
@click.option("--part", default=1, show_default=True, help="Which recording, if a file holds several.")
@click.option(
    "--bias-memory",
    type=click.Choice(("auto", "on", "off")),
    default="auto",
    show_default=True,
    help="Keep the fitted biases for the next pass: auto for real mounts, on for all, off for none.",
)
@click.option(
    "--learn-profile",
    type=OutputFile(new=True),
    metavar="FILE",
    help="Write a new profile with what cameras showed of the mount at these passes.",
)
@click.option(
    "--profile",
    type=_path,
    metavar="FILE",
    help="The profile that --learn-profile corrects; default: that of the last recording.",
)
@common_options("json", "utc")
def report(context: CommandContext, files: tuple[Path, ...], **options: Any) -> int:
    """Report what recorded passes show: error, link, gains, delays, the satellite's biases, what to change.

    Several files also give the trend over them; one that cannot be read is left out, with the exit code 2.
    Biases are fitted from the observations that came in during the run; without observations, the operator's
    last nudge is reported as such.

    --learn-profile takes two passes or more with a camera. It finds errors of the axes that repeat in a turn,
    and corrects the pointing model, where passes that are held out of the fit become better by it.

    \b
    Examples:
      sattrack report tonight.mcap
      sattrack report tonight.mcap --output tonight.html
      sattrack report night1.mcap night2.mcap --learn-profile mount.toml
    """
    html_file, folder = options["html_file"], options["folder"]
    drawing, learning = html_file is not None or folder is not None, options["learn_profile"] is not None
    if options["tdm"] is not None and len(files) > 1:
        raise BadInputError("--tdm takes one recording at a time")
    if options["profile"] is not None and not learning:
        raise BadInputError("--profile is what --learn-profile corrects: give that too, or neither")
    if drawing:
        # What keeps plots from being written is reported before the work.
        new_figure(1.0, 1.0)
        _make_folder(folder)
    found, passes, code = _all(files, options, drawing, learning)
    renew()
    reports = [report for _, report, _ in found]
    if not reports:
        return code
    if drawing:
        _draw(found, html_file, folder)
    if context.json:
        click.echo(msgspec.json.encode(reports if len(files) > 1 else reports[0]).decode())
    else:
        for report in reports:
            show(table("", "", rows=all_rows(report)), *([""] if len(reports) > 1 else []))
        if len(reports) > 1:
            show(table(*TREND_HEADS, rows=trend_rows(reports)))
    if learning:
        _learn(passes, options["learn_profile"], options["profile"])
    return code


def _all(
    files: tuple[Path, ...], options: dict[str, Any], drawing: bool, learning: bool
) -> tuple[list[_Drawn], list[_Passed], int]:
    """Return the reports of all files, the passes to learn from, and the exit code.

    A run made again is large: of many recordings only what is shown is kept. Raises SattrackError, TleError.
    """
    found: list[_Drawn] = []
    passes: list[_Passed] = []
    code = 0
    for number, file in enumerate(files):
        try:
            recording, facts, run, report, fit = _reported(file, share_progress(number, len(files)), options)
            found.append((file, report, pictures(run, fit) if drawing else {}))
            if learning:
                passes.append((recording, facts, run))
        except (SattrackError, TleError) as error:
            if len(files) == 1:
                raise
            renew()
            tell(f"left out: {error}")
            code = max(code, error.exit_code)
    return found, passes, code


def _reported(file: Path, progress: Callable[[float], None] | None, options: dict[str, Any]) -> _Reported:
    """Return one recording's report with all that it was made from. Raises SattrackError, TleError."""
    recording, facts = open_recording(file, options["part"])
    run = trace(recording, engine_of, progress)
    if options["tdm"] is not None:
        write_tdm(recording, facts, options["tdm"], run.engine)
    report, fit = make_report(recording, run)
    kept = None
    if fit is not None and not recording.header.anonymous:
        kept = keep_fit(fit, run.engine.spec, options["bias_memory"])
    if kept is not None:
        tell(f"bias memory: {kept}")
    return recording, facts, run, report, fit


def _learn(passes: Sequence[_Passed], target: Path, base: Path | None) -> None:
    """Write a profile with what cameras showed at passes. Raises SattrackError where they contradict."""
    from sattrack.calibration.profile import passes_lines, with_passes
    from sattrack.mount.profiles import load_profile_file, profile_file, profile_text
    from sattrack.pointing.learn import learn
    from sattrack.recording.fits import NoFit
    from sattrack.recording.sky_residuals import sky_residuals

    ordered = sorted(passes, key=lambda one: one[1].started_utc_s)
    last = ordered[-1][1]
    profile = profile_file(last.profile) if base is None else load_profile_file(base)
    seen, names = [], []
    for recording, facts, run in ordered:
        north_deg = facts.site.latitude_deg - last.site.latitude_deg
        east_deg = wrap180(facts.site.longitude_deg - last.site.longitude_deg)
        if max(abs(north_deg), abs(east_deg)) > SAME_SITE_DEG:
            raise BadInputError(f"{recording.path}: it is of another site than the last: another mount's")
        one = sky_residuals(recording, run, profile.mount)
        if isinstance(one, NoFit):
            tell(f"{recording.path}: left out: {one.why}")
            continue
        seen.append(one)
        names.append(str(recording.path))
    if not seen:
        raise SattrackError(f"{target} was not written: no camera saw anything at these passes")
    found = learn(seen, names, profile.periodic)
    lines = passes_lines(found)
    for line in lines:
        tell(line)
    if found.periodic == profile.periodic and found.terms is None:
        tell(f"{target} was not written: nothing was learnt")
        return
    head = "".join(f"# {line}\n" for line in (f"Learnt from {len(seen)} recorded passes.", *lines))
    write_file(target, f"{head}\n{profile_text(with_passes(profile, found, len(seen), target.stem))}")
    tell(f"written to {target}")


def _make_folder(folder: Path | None) -> None:
    try:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"{folder}: cannot be made: {error.strerror}") from error


def _draw(found: Sequence[_Drawn], html_file: Path | None, folder: Path | None) -> None:
    figure = trend([report for _, report, _ in found])
    over_time, path = None if figure is None else png(figure), html_file
    try:
        if html_file is not None:
            plots = [(report, drawn) for _, report, drawn in found]
            replace_file(html_file, report_html(plots, over_time, __version__).encode())
            tell(f"the report is in {html_file}")
        if folder is None:
            return
        taken: Counter[str] = Counter()
        for file, _, drawn in found:
            # Recordings in different folders may have one name.
            taken[file.stem] += 1
            stem = file.stem + (f"-{taken[file.stem]}" if taken[file.stem] > 1 else "")
            for title, picture in drawn.items():
                name = title.lower().replace(" ", "-").replace("'", "")
                path = folder / f"{stem}-{name}.png"
                replace_file(path, picture, synced=False)
        if over_time is not None:
            path = folder / "trend.png"
            replace_file(path, over_time, synced=False)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror}") from error
    tell(f"plots are in {folder}")

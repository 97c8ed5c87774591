"""`sattrack recording VERB`: what is in a recording, and its content in other programs' formats."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, tell
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.recording.anonymous import random_shift_s, write_anonymous, write_as_it_is
from sattrack.recording.export import ERROR, TABLES, error_columns, table_of
from sattrack.recording.trace import trace
from sattrack.runtime.facts import engine_of, open_recording

if TYPE_CHECKING:
    from sattrack.recording.reading import Recording, RecordingView
    from sattrack.runtime.facts import RunFacts

FORMATS = ("mcap", "pcapng", "csv", "json", "parquet", "tdm")
_part = click.option("--part", default=1, show_default=True, help="Which, where a file holds several.")


@click.group("recording")
def command() -> None:
    """Look into a recording, or write what is in it in another format."""


@command.command("info")
@click.argument("file", type=click.Path(path_type=Path))
@_part
@common_options
def info(context: CommandContext, file: Path, part: int) -> int:
    """Say what a recording holds, on what it was made, and what is wrong with it."""
    from sattrack.recording.reading import look

    recording, facts = open_recording(file, part)
    view = look(recording)
    if context.json:
        click.echo(msgspec.json.encode(view).decode())
    else:
        click.echo("\n".join(_lines(view, facts, recording.parts)))
    return 0


def _lines(view: RecordingView, facts: RunFacts, parts: int) -> list[str]:
    site = facts.site
    made = view.environment
    lines = [
        f"{facts.target.label}, {view.began_utc} to {view.ended_utc} ({view.seconds:.0f} s)",
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


@command.command("export")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--format", "kind", type=click.Choice(FORMATS), help="Else told by OUT's ending.")
@click.option("--table", type=click.Choice(TABLES), default="status", show_default=True, help="Of CSV, JSON.")
@click.option("--anonymous", is_flag=True, help="Move site and time together, and leave names out.")
@_part
@common_options
def export(context: CommandContext, file: Path, out: Path, **options: Any) -> int:
    """Write a recording as pcapng (Wireshark), CSV, JSON, Parquet or CCSDS TDM, or what is readable as MCAP.

    pcapng holds every datagram, TDM the observations that came in; CSV, JSON and Parquet hold one table:
    "error" is the error at every status, from which the figures of `sattrack report` can be made again.
    --anonymous takes the site to another longitude and all instants with it; the latitude stays, and whoever
    finds the orbit in a catalogue's history finds the rest.
    """
    kind = options["kind"] or out.suffix.removeprefix(".")
    if kind not in FORMATS:
        raise BadInputError(f"{out}: its ending tells no format; give --format {'|'.join(FORMATS)}")
    if out.exists():
        raise BadInputError(f"{out}: exists already; give another name")
    recording, facts = open_recording(file, options["part"])
    for words in recording.problems:
        tell(f"{file}: {words}")
    if not options["anonymous"]:
        _write(kind, recording, facts, out, options["table"])
        return 0
    with tempfile.TemporaryDirectory() as folder:
        moved = Path(folder) / "anonymous.mcap"
        with moved.open("wb") as stream:
            write_anonymous(recording, stream, random_shift_s())
        _write(kind, *open_recording(moved), out, options["table"])
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
        columns = error_columns(trace(recording, engine_of)) if table == ERROR else table_of(recording, table)
        {"csv": write_csv, "json": write_json, "parquet": write_parquet}[kind](columns, out)


def write_tdm(recording: Recording, facts: RunFacts, out: Path) -> None:
    """Write the observations in a recording as a TDM; raises SattrackError where there are none."""
    from sattrack.recording.observed import seen_in, tdm_text

    if facts.elements is None:
        raise SattrackError(
            f"{recording.path}: a TDM is written of a satellite with elements, not of {facts.target.label}"
        )
    seen = seen_in(recording, facts.elements.catalog_number)
    if not seen:
        raise SattrackError(
            f"{recording.path}: no observation in it, so there is nothing for a TDM: where a mount points "
            "while it follows tells nothing of the satellite"
        )
    text = tdm_text(seen, facts.elements, facts.site.place(), time.time(), "observed with sattrack")
    try:
        out.write_text(text)
    except OSError as error:
        raise BadInputError(f"{out}: cannot be written: {error.strerror}") from error

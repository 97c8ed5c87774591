"""What `track` and `demo` share: progress, the summary, the exit code."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import stat
import sys
from dataclasses import dataclass

import click
import msgspec

from sattrack.runtime.outcome import failure
from sattrack.view import Summary, TrackView
from tle.instants import Utc

SECONDS_BETWEEN_LINES = 5.0


class SummaryLine(msgspec.Struct, frozen=True):
    """The last object of a run's JSON."""

    summary: Summary


@dataclass(slots=True)
class Progress:
    """Tells on standard error how a run goes: a line that renews itself on a terminal, else one now and then.

    With `quiet_off_terminal`, nothing is told but on a terminal.
    """

    quiet_off_terminal: bool
    _phase: str = ""
    _told_utc_s: float = float("-inf")

    def show(self, view: TrackView) -> None:
        """Take one state."""
        terminal = sys.stderr.isatty()
        if not terminal and self.quiet_off_terminal:
            return
        due = view.utc_s - self._told_utc_s >= (1.0 if terminal else SECONDS_BETWEEN_LINES)
        if view.phase == self._phase and not due:
            return
        self._phase, self._told_utc_s = view.phase, view.utc_s
        if terminal:
            click.echo(f"\r\x1b[K{progress_line(view)}", err=True, nl=False)
        else:
            click.echo(progress_line(view), err=True)

    def end(self) -> None:
        """Leave the renewed line."""
        if sys.stderr.isatty() and self._phase:
            click.echo(err=True)


def progress_line(view: TrackView) -> str:
    """Return one line about a state."""
    clock = Utc(view.utc_s).isoformat("seconds")[11:]
    error = "" if view.error is None else f"  error {view.error.total_arcsec:.2f}″"
    rms = "" if view.rms_10s_arcsec is None else f"  rms {view.rms_10s_arcsec:.2f}″"
    if view.phase not in {"acquiring", "tracking"}:
        error = rms = ""
    return (
        f"{clock}  {view.name}  {view.phase:<9} "
        f"alt {view.target_alt_deg:5.1f}°  az {view.target_az_deg:5.1f}°{error}{rms}  link {view.link.state}"
    )


def tui_possible() -> bool:
    """Tell whether there is a terminal to draw on, and what it takes to draw."""
    return sys.stdin.isatty() and sys.stdout.isatty() and importlib.util.find_spec("textual_plot") is not None


def with_tui() -> int:
    """Run this very command line headless in a process of its own, and the terminal UI here on top of it.

    The loop that feeds the mount must not share a process with anything that draws.
    """
    from sattrack.tui.launch import fly_with_tui

    arguments = [*sys.argv[1:], "--stream", "--control"]
    return fly_with_tui([sys.executable, "-m", "sattrack", *arguments])


class Stream:
    """Writes views as JSON lines on standard output.

    A reader that does not keep up loses views: into a pipe, a line is written whole or not at all (POSIX
    promises that up to PIPE_BUF bytes), and the loop that feeds the mount never waits.
    """

    def __init__(self) -> None:
        self._encoder = msgspec.json.Encoder()
        self._out = sys.stdout.fileno()
        if stat.S_ISFIFO(os.fstat(self._out).st_mode):
            os.set_blocking(self._out, False)

    def show(self, view: TrackView) -> None:
        """Take one state."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._out, self._encoder.encode(view) + b"\n")

    def end(self) -> None:
        """Let what comes after the views be written whole, however long that takes."""
        os.set_blocking(self._out, True)


def finish(summary: Summary, interrupted: bool, as_json: bool) -> int:
    """Tell the summary; raises the error whose exit code the run ends with, else returns 0."""
    if as_json:
        click.echo(msgspec.json.encode(SummaryLine(summary)).decode())
    else:
        click.echo("\n".join(summary_lines(summary)))
    error = failure(summary, interrupted)
    if error is not None:
        raise error
    return 0


def summary_lines(summary: Summary) -> list[str]:
    """Return the summary for people."""
    lines = [
        f"{summary.name} ({summary.catalog_number}) with {summary.mount}: ended by {summary.ended_by}",
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
    counts = summary.datagrams
    lines.append(
        f"  datagrams: {counts.sent} sent, {counts.received} received, {counts.lost} lost, "
        f"{counts.late} late, {counts.rejected} rejected"
    )
    if summary.period_ms is not None:
        lines.append(f"  period {summary.period_ms.p50:.2f} ms median, {summary.period_ms.p99:.2f} ms p99")
    if summary.recording is not None:
        lines.append(f"  recorded in {summary.recording}")
    return lines

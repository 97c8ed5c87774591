"""`sattrack replay`: run a recording's inputs through today's code and compare every output."""

from __future__ import annotations

import contextlib
import select
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, fov_option
from sattrack.cli.output import JsonLines, renew, say, share_progress, tell
from sattrack.cli.screen import appearance, refuse_screen, screen_options, tui_possible
from sattrack.control.engine_view import view_of
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.process import self_command
from sattrack.recording.format import COMMAND, VIEW
from sattrack.recording.replay import Choice, replay, replay_lines, replay_view
from sattrack.runtime.facts import engine_of, open_recording
from sattrack.runtime.flight import RunStatistics, read_law, summarise, what_if
from sattrack.views.run import SummaryLine
from tle.errors import TleError

if TYPE_CHECKING:
    from sattrack.control.engine import Engine
    from sattrack.control.following import ControlLaw
    from sattrack.recording.format import Entry, Recording
    from sattrack.recording.replay import Figures
    from sattrack.runtime.facts import RunFacts

VIEW_EVERY_S = 0.1
MOST_VIEWS = 20_000
"""Of a recording of hours, so many, evenly: they are all held at once."""
HEED_EVERY = 20
LONGEST_PAUSE_S = 5.0


class LeftError(Exception):
    """Whoever looked on has left."""


class ViewsAtOnce(JsonLines):
    """Writes a view for each tenth of a second of a run being made again, and waits for its reader.

    Raises LeftError where standard input says stop, or ends.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__()
        instants = [entry.utc_s for entry in recording.entries() if entry.topic == COMMAND]
        span_s = max(instants, default=0.0) - min(instants, default=0.0)
        # A little less: the ticks' own jitter must not leave every second one out.
        self._every_s = max(VIEW_EVERY_S, span_s / MOST_VIEWS) - 0.01
        self._count = 0
        self._last_utc_s: float | None = None
        self.engine: Engine | None = None
        self.utc_s = 0.0

    def __call__(self, engine: Engine, entry: Entry) -> None:
        """Take one entry of the recording, handed to the engine already."""
        if entry.topic != COMMAND or engine.failed:
            return
        if self._last_utc_s is not None and 0.0 <= entry.utc_s - self._last_utc_s < self._every_s:
            return
        self._last_utc_s = self.utc_s = entry.utc_s
        self.engine = engine
        self.write_whole(view_of(engine, entry.utc_s))
        self._count += 1
        if self._count % HEED_EVERY == 0:
            self._heed()

    def _heed(self) -> None:
        heard, _, _ = select.select([sys.stdin], [], [], 0.0)
        if heard:
            line = sys.stdin.buffer.readline()
            if not line or b'"stop"' in line:
                raise LeftError


@click.command("replay")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--tui", is_flag=True, help="Show the run in the terminal UI: pause, step, jump; ? lists the keys."
)
@click.option(
    "--stream", is_flag=True, help="Write views as JSON lines to standard output, as they were recorded."
)
@click.option("--speed", type=float, metavar="X", help="With --tui or --stream: speed factor (1).")
@click.option("--control", is_flag=True, hidden=True)
@click.option("--at-once", is_flag=True, hidden=True)
@fov_option
@screen_options
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=N", help="Try another law: feeder.settling_s=0.2."
)
@click.option("--law", type=click.Path(path_type=Path), metavar="FILE", help="Try the law of a TOML file.")
@click.option("--part", default=1, show_default=True, help="Which recording, if a file holds several.")
@common_options("json", "utc")
def command(context: CommandContext, files: tuple[Path, ...], **options: Any) -> int:
    """Run recorded inputs through today's code and compare every output.

    A recording is the same to the last byte, equivalent (with its largest difference), or not the same. The
    exit code is 1 if one of them is not the same, 2 if one of several cannot be read, else 0.

    Outputs are compared byte by byte if code, libraries and kind of processor are those of the recording.
    Otherwise commands may differ by 1e-9 °/s, and for another version's code only figures are compared. --set
    and --law judge nothing: they print what that control law would have commanded, and the error it would
    have given with the mount simulated as the recording shows it.

    \b
    Examples:
      sattrack replay tonight.mcap
      sattrack replay tonight.mcap --tui --speed 4
    """
    speed = options["speed"]
    shown = options["tui"] or options["stream"]
    if speed is not None and not (shown and 0.01 <= speed <= 1000.0):
        raise BadInputError("--speed: give a factor from 0.01 to 1000, with --tui or --stream")
    if options["fov_deg"] is not None and not shown:
        raise BadInputError("--fov needs --tui: it is drawn on the screen")
    if len(files) > 1 and (shown or options["settings"] or options["law"]):
        raise BadInputError("--tui, --stream, --set and --law take one recording at a time")
    if len(files) > 1:
        return max([_compare_named(context, file, options["part"]) for file in files])
    (file,) = files
    if options["tui"]:
        return _with_tui(file, context, options)
    if not (options["stream"] or options["settings"] or options["law"]):
        return _compare(context, file, options["part"])
    recording, facts = _opened(file, options["part"])
    if options["stream"] and options["at_once"]:
        fov_deg = facts.fov_deg if options["fov_deg"] is None else options["fov_deg"]
        return _give_all(recording, msgspec.structs.replace(facts, fov_deg=fov_deg))
    if options["stream"]:
        return _play(recording, _Player(speed or 1.0, options["control"]))
    return _try(context, recording, facts, read_law(options["law"], options["settings"], facts.plan.law))


def _opened(file: Path, part: int) -> tuple[Recording, RunFacts]:
    recording, facts = open_recording(file, part)
    for text in recording.problems:
        tell(f"{file}: {text}")
    return recording, facts


def _compare(context: CommandContext, file: Path, part: int, name: bool = False) -> int:
    """Replay a recording and tell how it came out; return the exit code. Of several, each is named."""
    recording, _ = _opened(file, part)
    began_s = time.perf_counter()
    result = replay(recording, engine_of, progress=share_progress())
    took_s = time.perf_counter() - began_s
    renew()
    if context.json:
        view = replay_view(str(file), result, recording.problems, took_s)
        click.echo(msgspec.json.encode(view).decode())
    else:
        lines = replay_lines(result, took_s)
        if name:
            lines = [f"{file}: {lines[0]}", *(f"  {line}" for line in lines[1:])]
        say("\n".join(lines))
    return 0 if result.agrees else 1


def _compare_named(context: CommandContext, file: Path, part: int) -> int:
    """Replay one of several recordings; where it cannot be read, tell that, and return the exit code."""
    try:
        return _compare(context, file, part, name=True)
    except (SattrackError, TleError) as error:
        renew()
        tell(str(error))
        return error.exit_code


def _try(context: CommandContext, recording: Recording, facts: RunFacts, law: ControlLaw) -> int:
    """Tell what another law would have done."""
    choice = Choice("figures", "another control law was asked for")
    found = what_if(recording, facts, law, choice, share_progress())
    renew()
    before, after = found.before.rms_arcsec, found.after.rms_arcsec
    gained = None if before is None or after is None else after - before
    if context.json:
        document = {
            "recording": str(recording.path),
            "commands_differing": found.replayed.differing,
            "largest_rate_difference_deg_s": found.replayed.largest_rate_deg_s,
            "simulated": {
                "rms_arcsec": before,
                "peak_arcsec": found.before.peak_arcsec,
                "rms_with_law_arcsec": after,
                "peak_with_law_arcsec": found.after.peak_arcsec,
                "delta_rms_arcsec": gained,
                "fitted": found.fitted,
            },
        }
        click.echo(msgspec.json.encode(document).decode())
        return 0
    say(
        f"{found.replayed.differing} of {found.replayed.ticks} commands would have differed, "
        f"by {found.replayed.largest_rate_deg_s:.3g} °/s at most\n"
        f"simulated with the mount of the recording ({found.fitted}):\n"
        f"  the recorded law: {_error_text(found.before)}\n"
        f"  this law:         {_error_text(found.after)}"
        + ("" if gained is None else f"\n  ΔRMS {gained:+.4f}″")
    )
    return 0


def _error_text(figures: Figures) -> str:
    if figures.rms_arcsec is None:
        return "never on target"
    return f"RMS {figures.rms_arcsec:.4f}″, peak {figures.peak_arcsec:.3f}″"


def _give_all(recording: Recording, facts: RunFacts) -> int:
    """Write the facts of the pass, then all views, for the screen."""
    from sattrack.runtime.pass_scene import pass_scene

    views = ViewsAtOnce(recording)
    with contextlib.suppress(TleError):
        # Without it there is no chart; the run is shown all the same.
        views.write_whole(pass_scene(facts))
    with contextlib.suppress(LeftError):
        result = replay(recording, engine_of, watch=views)
        if not result.agrees:
            tell("NOT the same as recorded; run without --tui to see the difference")
    views.end()
    if views.engine is not None:
        summary = summarise(views.engine, RunStatistics(), views.utc_s)
        click.echo(msgspec.json.encode(SummaryLine(summary)).decode())
    return 0


def _play(recording: Recording, player: _Player) -> int:
    with contextlib.suppress(LeftError):
        result = replay(recording, engine_of, watch=player)
        if not result.agrees:
            tell("NOT the same as recorded; run without --stream to see the difference")
    player.finish()
    return 0


class _Player(JsonLines):
    """Writes the views of a run being made again at the pace at which they were seen."""

    def __init__(self, speed: float, control: bool) -> None:
        super().__init__()
        self._speed = speed
        self._control = control
        self._engine: Engine | None = None
        self._utc_s: float | None = None
        self._due_s = time.monotonic()

    def __call__(self, engine: Engine, entry: Entry) -> None:
        """Take one entry of the recording, handed to the engine already."""
        if entry.topic != VIEW:
            return
        if self._utc_s is not None:
            # A clock that was set in the middle of the run is no reason to wait for it.
            self._due_s += max(0.0, min(LONGEST_PAUSE_S, entry.utc_s - self._utc_s)) / self._speed
        self._engine, self._utc_s = engine, entry.utc_s
        self._wait()
        self.write(view_of(engine, entry.utc_s))

    def _wait(self) -> None:
        """Wait for the next view's time; raises LeftError where standard input says stop, or ends."""
        while True:
            left_s = max(0.0, self._due_s - time.monotonic())
            heard, _, _ = select.select([sys.stdin] if self._control else [], [], [], left_s)
            if not heard:
                return
            line = sys.stdin.buffer.readline()
            if not line or b'"stop"' in line:
                raise LeftError

    def finish(self) -> None:
        """Write what the run came to, as far as it was shown."""
        self.end()
        if self._engine is not None and self._utc_s is not None:
            click.echo(
                msgspec.json.encode(
                    SummaryLine(summarise(self._engine, RunStatistics(), self._utc_s))
                ).decode()
            )


def _with_tui(file: Path, context: CommandContext, options: dict[str, Any]) -> int:
    from sattrack.tui.launch import replay_with_tui

    if not tui_possible():
        refuse_screen("--tui")
    arguments = ["replay", str(file), "--stream", "--control", "--at-once", "--part", str(options["part"])]
    fov_deg = context.settings.camera.fov_deg if options["fov_deg"] is None else options["fov_deg"]
    if fov_deg is not None:
        arguments += ["--fov", str(fov_deg)]
    look = appearance(context, options["theme"], options["plain"])
    return replay_with_tui([*self_command(), *arguments], file.name, options["speed"] or 1.0, look)

"""`sattrack attach`: look at the run that goes on, or take part in it."""

from __future__ import annotations

import importlib.util
import os
import sys
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import CommandContext, appearance, common_options, screen_options
from sattrack.cli.screened import beside, needed_terminal, tui_possible
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.runtime.view_server import SUPPORTED, feeders

if TYPE_CHECKING:
    from sattrack.views.run import Welcome


@click.command("attach")
@click.option("--run", "pid", type=int, metavar="PID", help="The process of the run, where several go on.")
@click.option("--as", "name", metavar="NAME", help="Your name for the others; default: this terminal.")
@screen_options
@common_options
def command(context: CommandContext, pid: int | None, name: str | None, **options: Any) -> int:
    """Watch a run that was started elsewhere, or take control of it, on the same screen as that of `track`.

    Up to 64 can watch. SPACE stops the mount, for everybody. One at a time has control and can move the
    target: c takes it. Leaving the screen does nothing to the run. After a pass of a schedule, the screen
    goes on to the next one. --json writes what is seen of one run, an object a line.
    """
    pid = chosen_run(pid)
    name = name or _terminal()
    if context.json:
        return _as_json(pid, name)
    if importlib.util.find_spec("textual_plot") is None:
        raise SattrackError("the screen needs textual: pip install 'sattrack[tui]'")
    from sattrack.tui.launch import SEEN_BY_BROWSER, attach_with_tui

    if not (tui_possible() or SEEN_BY_BROWSER in os.environ):
        raise BadInputError(f"attach needs {needed_terminal()}; --json is for programs")

    look = appearance(context, options["theme"], options["plain"])
    return attach_with_tui(pid, name, look, beside(context, None, None, practising=False))


def chosen_run(pid: int | None) -> int:
    """Return the process of the run to look at. Raises BadInputError where that is none, or in doubt."""
    if not SUPPORTED:
        raise SattrackError("runs can be looked at on Linux only")
    if pid is not None:
        return pid
    found = feeders()
    if not found:
        raise SattrackError(
            "no run goes on: `sattrack track` and `sattrack demo` start one; "
            "between the passes of a schedule, `sattrack run FILE --status` shows its state"
        )
    if len(found) > 1:
        choices = "; ".join(f"--run {one}: {_told(one)}" for one in found)
        raise BadInputError(f"{len(found)} runs go on; choose one: {choices}")
    return found[0]


def _told(pid: int) -> str:
    welcome = welcome_of(pid)
    return "it does not answer" if welcome is None else in_words(welcome)


def welcome_of(pid: int) -> Welcome | None:
    """Return what a run says of itself; None where it does not answer."""
    from sattrack.tui.attached import welcomed

    try:
        door, lines, welcome = welcomed(pid, "a list of runs")
    except SattrackError:
        return None
    lines.close()
    door.close()
    return welcome


def in_words(welcome: Welcome) -> str:
    """Return what a run is."""
    return f"{welcome.name} with {welcome.mount}, `{welcome.command}`, since {welcome.since_utc}"


def _terminal() -> str:
    try:
        return os.ttyname(sys.stdin.fileno()).removeprefix("/dev/")
    except (OSError, ValueError):
        return f"process {os.getpid()}"


def _as_json(pid: int, name: str) -> int:
    """Write what is seen as JSON lines, until the run ends; raises SattrackError where it is lost."""
    from sattrack.tui.attached import welcomed

    door, lines, _ = welcomed(pid, name)
    whole = False
    with door, lines:
        for line in lines:
            if line.startswith(b'{"elements"'):
                continue
            whole = line.startswith(b'{"summary"')
            sys.stdout.buffer.write(line)
            sys.stdout.buffer.flush()
    if not whole:
        raise SattrackError("the run ended without a word: its guardian stops the mount; look after it")
    return 0

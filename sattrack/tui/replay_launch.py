"""Start the reading of a recording in a process of its own, and the screen here on top of it."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import click

from sattrack.tui.child import FeederProcess
from sattrack.tui.hangup import end_with_the_terminal
from sattrack.tui.showing import INTERRUPTED, run_until_left
from sattrack.views.summary_text import summary_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.tui.appearance import Appearance
    from sattrack.tui.feed import Feed
    from sattrack.tui.tape import Tape

GRACE_S = 2.0


def replay_with_tui(
    command: Sequence[str],
    tape: Tape,
    appearance: Appearance,
    show: Callable[[Feed, Tape, Appearance], None] | None = None,
) -> int:
    """Show what `command` makes of a recording (views as JSON lines, all at once); return the exit code.

    The screen stays until it is left. `show` stands in for it.
    """
    reader = FeederProcess(command)
    end_with_the_terminal(reader, GRACE_S, GRACE_S)
    if show is None:
        # While the reading begins: the screen is to be there with its first view.
        importlib.import_module("sattrack.tui.replay_app")
    shown = interrupted = False
    try:
        shown = reader.wait_first_view()
        if shown:
            (show or show_tape)(reader, tape, appearance)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        summary = reader.summary
        reader.close_input()
        code = reader.wait(GRACE_S)
        if code is None:
            code = reader.end_by_force(GRACE_S)
        told = reader.close()
    if shown and summary is not None:
        click.echo("\n".join(summary_lines(summary)))
    if told:
        click.echo(told, err=True, nl=not told.endswith("\n"))
    if interrupted:
        return INTERRUPTED
    # A reading that was cut short by leaving is no failure.
    return 0 if shown else code


def show_tape(source: Feed, tape: Tape, appearance: Appearance) -> None:
    """Run the screen until it is left; raises SattrackError where it broke."""
    from sattrack.tui.replay_app import ReplayApp, TapeFeed

    app = ReplayApp(TapeFeed(source, tape), appearance=appearance)
    if run_until_left(app, "the screen broke"):
        raise KeyboardInterrupt

"""The screen on a run that was started elsewhere."""

from __future__ import annotations

import importlib
import os
import threading
from typing import TYPE_CHECKING

import click

from sattrack.tui.attached import AttachedRun
from sattrack.tui.beside import Aside
from sattrack.tui.hangup import end_with_the_server, end_with_the_terminal
from sattrack.tui.showing import INTERRUPTED, run_until_left
from sattrack.views.summary_text import summary_lines

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.tui.appearance import Appearance
    from sattrack.tui.beside import Beside
    from sattrack.views.run import PassView

SEEN_BY_BROWSER = "TEXTUAL_DRIVER"
"""Set where another program draws the screen, as a browser's server."""


def attach_with_tui(pid: int, name: str, appearance: Appearance, beside: Beside) -> int:
    """Show the run of a process until that is left; return the exit code. Raises SattrackError.

    `beside` is what the screen starts itself.
    """
    run = AttachedRun(pid, name, sky_of_run)
    if SEEN_BY_BROWSER in os.environ:
        end_with_the_server(run)
    else:
        end_with_the_terminal(run, 0.0, 0.0)
    # While the first views come.
    importing = threading.Thread(target=importlib.import_module, args=("sattrack.tui.app",), daemon=True)
    importing.start()
    interrupted = False
    try:
        if run.wait_first_view():
            importing.join()
            from sattrack.tui.app import TrackApp

            interrupted = run_until_left(
                TrackApp(run, appearance=appearance, aside=Aside.of(beside, pid)), "the screen broke"
            )
    except KeyboardInterrupt:
        interrupted = True
    finally:
        run.close()
    if run.summary is not None:
        click.echo("\n".join(summary_lines(run.summary)))
    return INTERRUPTED if interrupted else 0


def sky_of_run(facts: RunFacts) -> PassView:
    """Return the sky of a run from its facts."""
    from sattrack.runtime.kernel_clock import read_kernel_clock
    from sattrack.runtime.pass_scene import pass_scene

    clock = read_kernel_clock()
    known = clock is not None and clock.synchronised
    return pass_scene(facts, clock.estimated_error_s if clock is not None and known else None)

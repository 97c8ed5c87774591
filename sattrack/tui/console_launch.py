"""Start the console in a process of its own, and its screen here on top of it."""

from __future__ import annotations

import importlib
import sys
import termios
from functools import partial
from typing import TYPE_CHECKING

import click

from sattrack.tui.appearance import Appearance
from sattrack.tui.child import ConsoleProcess
from sattrack.tui.hangup import end_with_the_terminal
from sattrack.tui.showing import INTERRUPTED, run_until_left
from sattrack.views.messages import Leave

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.tui.console_feed import ConsoleFeed
    from sattrack.views.messages import ConsoleMessage

NIGHT = Appearance()
PATIENCE_S = 75.0
"""Longer than the console goes on sending stops to a mount that does not come to rest."""
TELL_AFTER_S = 0.6
GRACE_S = 2.0


def watch_with_tui(
    command: Sequence[str],
    show: Callable[[ConsoleFeed], bool] | None = None,
    patience_s: float = PATIENCE_S,
    first: ConsoleMessage | None = None,
    appearance: Appearance = NIGHT,
) -> int:
    """Run `command` (a console with `--stream --control`) under the screen; return its exit code.

    However the screen ends, the console is told to leave, and has `patience_s` to bring to rest what it has
    set going. `show` stands in for the screen; it tells whether it was interrupted. `first` is said as soon
    as the mount is heard.
    """
    console = ConsoleProcess(command)
    end_with_the_terminal(console, patience_s, GRACE_S)
    if show is None:
        # While the console starts: the screen is to be there with its first view.
        importlib.import_module("sattrack.tui.console_app")
    interrupted = False
    code: int | None = None
    try:
        if console.wait_first_view():
            interrupted = (show or partial(show_console, first=first, appearance=appearance))(console)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        code = _end(console, patience_s)
        told = console.close()
        if told:
            click.echo(told, err=True, nl=not told.endswith("\n"))
    return INTERRUPTED if interrupted and code == 0 else code


def show_console(
    feed: ConsoleFeed, first: ConsoleMessage | None = None, appearance: Appearance = NIGHT
) -> bool:
    """Run the screen until it is left; raises SattrackError where it broke."""
    from sattrack.tui.console_app import ConsoleApp

    if sys.stdin.isatty():
        # Keys from before there was a screen were not meant for it.
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
    app = ConsoleApp(feed, first=first, appearance=appearance)
    return run_until_left(app, "the screen broke; the mount was told to stop")


def _end(console: ConsoleProcess, patience_s: float) -> int:
    """Have the console leave, and wait for its end for a bounded time."""
    console.tell(Leave())
    console.close_input()
    code = console.wait(min(TELL_AFTER_S, patience_s))
    if code is None:
        click.echo("sattrack: waiting for the mount to come to rest …", err=True)
        code = console.wait(patience_s)
    if code is None:
        click.echo("sattrack: THE CONSOLE DOES NOT END: STOP THE MOUNT BY HAND; ending it by force", err=True)
        console.end_by_force(GRACE_S)
        return 1
    return code if code >= 0 else 128 - code

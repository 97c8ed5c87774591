"""Start the feeder in a process of its own, and the screen here on top of it."""

from __future__ import annotations

import importlib
import time
from functools import partial
from typing import TYPE_CHECKING

import click

from sattrack.tui.appearance import Appearance
from sattrack.tui.beside import Aside
from sattrack.tui.child import FeederProcess
from sattrack.tui.hangup import end_with_the_terminal
from sattrack.tui.showing import INTERRUPTED, run_until_left
from sattrack.views.messages import StopNow
from sattrack.views.summary_text import summary_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.tui.beside import Beside
    from sattrack.tui.feed import Feed

NIGHT = Appearance()
PATIENCE_S = 20.0
TELL_AFTER_S = 0.3
SHOW_AFTER_S = 0.4
"""How long after the feeder's start the screen is there without a view, to say that one is to come."""
GRACE_S = 2.0


def fly_with_tui(
    command: Sequence[str],
    appearance: Appearance = NIGHT,
    stay: bool = True,
    show: Callable[[Feed, bool], None] | None = None,
    patience_s: float = PATIENCE_S,
    beside: Beside | None = None,
) -> int:
    """Run `command` (a feeder with `--stream --control`) under the screen; return its exit code.

    With `stay`, the screen of an ended run remains until it is left, so that it can be read. However the
    screen ends, the mount is told to stop, and the feeder has `patience_s` to bring it to rest. `show`
    stands in for the screen. A feeder that
    has said that it is left running is left alone. `beside` is what the screen starts itself.
    """
    begun_s = time.monotonic()
    feeder = FeederProcess(command)
    end_with_the_terminal(feeder, patience_s, GRACE_S)
    if show is None:
        # While the feeder starts: the screen is to be there with its first view.
        importlib.import_module("sattrack.tui.app")
    code: int | None = None
    interrupted = False
    try:
        if feeder.wait_first_view() if show is not None else feeder.may_still_view(_left(begun_s)):
            aside = None if beside is None else Aside.of(beside, feeder.pid)
            (show or partial(show_screen, appearance=appearance, aside=aside))(feeder, stay)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        code = _end(feeder, patience_s)
        _tell(feeder)
    return INTERRUPTED if interrupted else code


def show_screen(feed: Feed, stay: bool, appearance: Appearance, aside: Aside | None = None) -> None:
    """Run the screen until it is left; raises SattrackError where it broke."""
    from sattrack.tui.app import TrackApp

    app = TrackApp(feed, stay, appearance=appearance, aside=aside)
    if run_until_left(app, "the screen broke; the mount was told to stop"):
        raise KeyboardInterrupt


def _left(begun_s: float) -> float:
    return max(0.0, begun_s + SHOW_AFTER_S - time.monotonic())


def _end(feeder: FeederProcess, patience_s: float) -> int:
    """Stop the mount and wait for the feeder's end, for a bounded time; one that is left running goes on."""
    if feeder.left_running:
        return 0
    feeder.send(StopNow())
    feeder.close_input()
    code = feeder.wait(min(TELL_AFTER_S, patience_s))
    if code is None:
        if feeder.summary is None:
            _say("stopping the mount …")
        code = feeder.wait(patience_s)
    if code is None:
        _say("THE RUN DOES NOT END: STOP THE MOUNT BY HAND; ending it by force")
        feeder.end_by_force(GRACE_S)
        return 1
    return code if code >= 0 else 128 - code


def _tell(feeder: FeederProcess) -> None:
    left = feeder.left_running
    told = feeder.close()
    if left:
        _say("the run goes on: `sattrack attach` looks at it again, `sattrack stop` stops the mount")
        return
    if feeder.summary is not None:
        click.echo("\n".join(summary_lines(feeder.summary)))
    elif feeder.viewed:
        _say("the run ended without a summary: make sure that the mount is at rest")
    if told:
        click.echo(told, err=True, nl=not told.endswith("\n"))


def _say(text: str) -> None:
    click.echo(f"sattrack: {text}", err=True)

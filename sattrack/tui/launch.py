"""Start what a screen shows in a process of its own, and the screen here on top of it.

Light: the screens take a while to load, and are imported while the process starts.
"""

from __future__ import annotations

import fcntl
import importlib
import os
import re
import select
import signal
import stat
import struct
import sys
import termios
import threading
import time
import tty
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeVar

import click

from sattrack.core.errors import SattrackError
from sattrack.tui.feeds import AntennaProcess, ConsoleProcess, FeederProcess, Helpers
from sattrack.tui.scene import DEFAULT_APPEARANCE, TerminalPixels
from sattrack.views.formatting import summary_lines
from sattrack.views.messages import Leave, StopNow
from tle.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sattrack.runtime.facts import RunFacts
    from sattrack.tui.feeds import ConsoleFeed, Feed, HelperOptions
    from sattrack.tui.look import ScreenApp
    from sattrack.tui.scene import Appearance
    from sattrack.views.messages import ConsoleMessage
    from sattrack.views.run import PassView

INTERRUPTED = 130
HUNG_UP = 128 + signal.SIGHUP
LEAVING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Without a handler, asyncio turns SIGINT into a cancellation, which a screen may swallow."""
SEEN_BY_BROWSER = "TEXTUAL_DRIVER"
"""Set where another program draws the screen, as a browser's server."""
STDIN, STDOUT = 0, 1
RUN_PATIENCE_S = 20.0
MOUNT_PATIENCE_S = 75.0
"""Longer than a console or a service goes on sending stops to a mount that does not come to rest."""
REPORT_AFTER_S = 0.5
SHOW_AFTER_S = 0.4
"""How long after the feeder's start the screen is there without a view, to say that one will come."""
GRACE_S = 2.0
BROKE = "the screen broke"
WHAT_ARE_YOU, ATTRIBUTES, SIXELS = b"\x1b[c", re.compile(rb"\x1b\[\?([\d;]*)c"), b"4"
"""Every terminal is asked that ("primary device attributes"); the answer lists what it has."""
CAN_YOU_PLACE = b"\x1b_Gi=1,a=q,U=1,f=24,s=1,v=1;AAAA\x1b\\"
"""Asked first, by kitty's graphics protocol. To U, kitty before 0.28 is silent: it has no images in cells."""
PLACES, GRAPHICS = re.compile(rb"\x1b_Gi=1;OK\x1b\\"), re.compile(rb"\x1b_G[^\x1b]*\x1b\\")
WITHIN_ANOTHER = ("TMUX", "STY")
"""Set within tmux and screen, which take what is asked by that protocol for a title."""
BROWSER_CELL_PX = (9, 21)
"""About what a page's cells have at its usual size; it scales the picture to them."""
ANSWERS_WITHIN_S = 0.3
NO_ANSWER = frozenset({"dumb", "linux"})
STOPPING_KEYS = (b" ", b"q", b"\x11")

ProcessT = TypeVar("ProcessT", bound="Endable")


class Endable(Protocol):
    """What ends with its screen, and with the terminal."""

    def close_input(self) -> None:
        """Say that nobody is there any more."""

    def wait(self, seconds: float) -> int | None:
        """Wait for the end; None where it is not over within `seconds`."""

    def end_by_force(self, grace_s: float) -> int:
        """End it by force."""


def fly_with_tui(
    command: Sequence[str],
    appearance: Appearance = DEFAULT_APPEARANCE,
    stay: bool = True,
    show: Callable[[Feed], bool] | None = None,
    patience_s: float = RUN_PATIENCE_S,
    helpers: HelperOptions | None = None,
) -> int:
    """Run `command` (a feeder with `--stream --control`) under the screen; return its exit code.

    With `stay`, the screen of an ended run remains until it is left, so that it can be read. However the
    screen ends, the mount is stopped, and the feeder has `patience_s` to bring it to rest. A feeder that
    reported that it is left running is left alone. `show` stands in for the screen; it returns whether it was
    interrupted. `helpers` is what the screen starts itself.
    """
    pixels = _terminal_pixels(appearance) if show is None else None
    begun_s = time.monotonic()
    feeder = FeederProcess(command)
    end_with_the_terminal(feeder, patience_s)

    def show_run(feed: Feed) -> bool:
        from sattrack.tui.app import TrackApp

        started = None if helpers is None else Helpers.of(helpers, feeder.pid)
        app = TrackApp(feed, stay, appearance=appearance, helpers=started, pixels=pixels)
        return run_until_left(app, stopping=True)

    def comes() -> bool:
        if show is not None:
            return feeder.wait_first_view()
        return feeder.may_still_view(max(0.0, begun_s + SHOW_AFTER_S - time.monotonic()))

    module = "sattrack.tui.app" if show is None else None
    interrupted, code = _under_screen(feeder, module, comes, show or show_run, partial(_end_run, patience_s))
    return INTERRUPTED if interrupted else code


def watch_with_tui(
    command: Sequence[str],
    show: Callable[[ConsoleFeed], bool] | None = None,
    patience_s: float = MOUNT_PATIENCE_S,
    first: ConsoleMessage | None = None,
    appearance: Appearance = DEFAULT_APPEARANCE,
) -> int:
    """Run `command` (a console with `--stream --control`) under the screen; return its exit code.

    However the screen ends, the console must leave, and has `patience_s` to bring to rest what it has
    set going. `show` stands in for the screen; it returns whether it was interrupted. `first` is sent as soon
    as the mount is heard.
    """
    console = ConsoleProcess(command)
    end_with_the_terminal(console, patience_s)

    def show_console(feed: ConsoleFeed) -> bool:
        from sattrack.tui.console_app import ConsoleApp

        if sys.stdin.isatty():
            # Keys from before there was a screen were not meant for it.
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
        return run_until_left(ConsoleApp(feed, first=first, appearance=appearance), stopping=True)

    def end(console: ConsoleProcess) -> int:
        console.tell(Leave())
        return _end_service(console, patience_s, "CONSOLE")

    module = "sattrack.tui.console_app" if show is None else None
    interrupted, code = _under_screen(console, module, console.wait_first_view, show or show_console, end)
    return INTERRUPTED if interrupted and code == 0 else code


def serve_with_console(command: Sequence[str], appearance: Appearance = DEFAULT_APPEARANCE) -> int:
    """Run `command` (`serve antenna` with --stream and --control) under the screen; return its exit code."""
    antenna = AntennaProcess(command)
    end_with_the_terminal(antenna, MOUNT_PATIENCE_S)

    def show(feed: AntennaProcess) -> bool:
        from sattrack.tui.console_app import AntennaApp

        return run_until_left(AntennaApp(feed, appearance), stopping=True)

    def end(antenna: AntennaProcess) -> int:
        return _end_service(antenna, MOUNT_PATIENCE_S, "SERVICE")

    interrupted, code = _under_screen(antenna, "sattrack.tui.console_app", antenna.wait_first_view, show, end)
    return INTERRUPTED if interrupted and code == 0 else code


def replay_with_tui(
    command: Sequence[str],
    name: str,
    speed: float,
    appearance: Appearance = DEFAULT_APPEARANCE,
    show: Callable[[Feed], bool] | None = None,
) -> int:
    """Show what `command` makes of a recording (views as JSON lines, all at once); return the exit code.

    The screen stays until it is left; it begins at `speed` times the run's. `show` stands in for it.
    """
    reader = FeederProcess(command)
    end_with_the_terminal(reader, GRACE_S)

    def show_tape(source: Feed) -> bool:
        from sattrack.tui.replay_app import ReplayApp, Tape, TapeFeed

        return run_until_left(ReplayApp(TapeFeed(source, Tape(name, speed)), appearance=appearance))

    module = "sattrack.tui.replay_app" if show is None else None
    interrupted, code = _under_screen(reader, module, reader.wait_first_view, show or show_tape, _end_reading)
    # A reading that was cut short by leaving is no failure.
    return INTERRUPTED if interrupted else 0 if reader.viewed else code


def attach_with_tui(pid: int, name: str, appearance: Appearance, helpers: HelperOptions) -> int:
    """Show the run of a process until that is left; return the exit code. Raises SattrackError.

    `helpers` is what the screen starts itself.
    """
    from sattrack.tui.attached import AttachedRun

    run = AttachedRun(pid, name, sky_of_run)
    if SEEN_BY_BROWSER in os.environ:
        _end_with((STDIN, STDOUT), run, 0.0)
    else:
        end_with_the_terminal(run, 0.0)

    def show(run: AttachedRun) -> bool:
        from sattrack.tui.app import TrackApp

        pixels = _browser_pixels(appearance)
        app = TrackApp(run, appearance=appearance, helpers=Helpers.of(helpers, pid), pixels=pixels)
        return run_until_left(app)

    def end(run: AttachedRun) -> int:
        run.close()
        return 0

    interrupted, code = _under_screen(run, "sattrack.tui.app", run.wait_first_view, show, end)
    if run.summary is not None:
        _echo("\n".join(summary_lines(run.summary)), err=False)
    return INTERRUPTED if interrupted else code


def sky_of_run(facts: RunFacts) -> PassView:
    """Return the sky of a run from its facts."""
    from sattrack.runtime.pass_scene import pass_scene
    from sattrack.runtime.system import read_kernel_clock

    clock = read_kernel_clock()
    known = clock is not None and clock.synchronised
    return pass_scene(facts, clock.estimated_error_s if clock is not None and known else None)


def _browser_pixels(appearance: Appearance) -> TerminalPixels | None:
    """Return the pixels of a browser's page, where that shows the screen: it scales images to its cells."""
    if SEEN_BY_BROWSER not in os.environ or appearance.plain or os.environ.get("NO_COLOR"):
        return None
    return TerminalPixels(lambda: BROWSER_CELL_PX, browser=True)


def _terminal_pixels(appearance: Appearance) -> TerminalPixels | None:
    """Return the pixels of the terminal, where it says at once that it draws them: sixels, else kitty's way.

    Its answer comes as keys do. So this is asked before anything is set going, never where a run goes on
    already: a stop may be typed there at once. The keys of an answer that comes later send nothing. Raises
    KeyboardInterrupt where a stop or a quit is typed meanwhile.
    """
    kind = os.environ.get("TERM", "dumb")
    terminal = os.isatty(STDIN) and os.isatty(STDOUT) and kind not in NO_ANSWER
    if not terminal or appearance.plain or os.environ.get("NO_COLOR") or _cell_px() is None:
        return None
    within = kind.startswith(("screen", "tmux")) or any(name in os.environ for name in WITHIN_ANOTHER)
    question = WHAT_ARE_YOU if within else CAN_YOU_PLACE + WHAT_ARE_YOU
    mode, heard, answer = termios.tcgetattr(STDIN), b"", None
    until_s = time.monotonic() + ANSWERS_WITHIN_S
    try:
        tty.setcbreak(STDIN, termios.TCSANOW)
        os.write(STDOUT, question)
        while answer is None and select.select([STDIN], [], [], max(0.0, until_s - time.monotonic()))[0]:
            more = os.read(STDIN, 1024)
            if not more:
                break
            heard += more
            answer = ATTRIBUTES.search(heard)
    finally:
        termios.tcsetattr(STDIN, termios.TCSANOW, mode)
    if any(key in ATTRIBUTES.sub(b"", GRAPHICS.sub(b"", heard)) for key in STOPPING_KEYS):
        raise KeyboardInterrupt
    if answer is None:
        return None
    if SIXELS in answer[1].split(b";"):
        return TerminalPixels(_cell_px)
    return TerminalPixels(_cell_px, kitty=True) if PLACES.search(heard, 0, answer.start()) else None


def _cell_px() -> tuple[int, int] | None:
    """Return the pixels of the terminal's cells, across and down; None where it does not tell them."""
    rows, columns, across, down = struct.unpack("HHHH", fcntl.ioctl(STDOUT, termios.TIOCGWINSZ, bytes(8)))
    return (across // columns, down // rows) if rows and columns and across and down else None


def run_until_left(app: ScreenApp, stopping: bool = False) -> bool:
    """Run a screen until it is left; return whether it was interrupted. Raises SattrackError where it broke.

    With `stopping`, the error says that a stop was sent.
    """
    with _leaving(app.ask_to_leave):
        app.run()
    if app.return_code and not app.interrupted:
        raise SattrackError(f"{BROKE}; a stop was sent to the mount" if stopping else BROKE)
    return app.interrupted


@contextmanager
def _leaving(leave: Callable[[], None]) -> Iterator[None]:
    """Have the signals that end programs leave the screen as its own key does, the terminal restored."""
    before = {number: signal.signal(number, lambda *_: leave()) for number in LEAVING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _under_screen(
    process: ProcessT,
    module: str | None,
    comes: Callable[[], bool],
    show: Callable[[ProcessT], bool],
    end: Callable[[ProcessT], int],
) -> tuple[bool, int]:
    """Show a process until its screen is left, and end it; return whether it was interrupted, and its code.

    The screen's module is imported while the process starts. `comes` returns whether there is anything to
    show.
    """
    if module is not None:
        importlib.import_module(module)
    interrupted = False
    try:
        interrupted = comes() and show(process)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        code = end(process)
    return interrupted, code


def _end_run(patience_s: float, feeder: FeederProcess) -> int:
    """Stop the mount and wait for the feeder's end, for a bounded time; one that is left running goes on."""
    if feeder.left_running:
        feeder.close()
        _say("the run continues: `sattrack attach` shows it again, `sattrack stop` stops the mount")
        return 0
    feeder.send(StopNow())
    code = _wait_end(feeder, patience_s, "stopping the mount …", "RUN")
    # What it said as it went comes before its summary, and why it failed after that.
    errors = feeder.close()
    told, _, why = errors.rstrip("\n").rpartition("\n") if code else (errors, "", "")
    _echo(told)
    if feeder.summary is not None:
        _echo("\n".join(summary_lines(feeder.summary)), err=False)
    elif feeder.viewed:
        _say("the run ended without a summary: make sure that the mount is at rest")
    _echo(why)
    return code


def _end_service(process: FeederProcess, patience_s: float, what: str) -> int:
    """Wait for the end of what operates a mount, for a bounded time, and hand on what it wrote."""
    code = _wait_end(process, patience_s, "waiting for the mount to come to rest …", what)
    _echo(process.close())
    return code


def _end_reading(reader: FeederProcess) -> int:
    """End the reading of a recording; write the summary where it was shown to its end."""
    summary = reader.summary
    reader.close_input()
    code = reader.wait(GRACE_S)
    if code is None:
        code = reader.end_by_force(GRACE_S)
    errors = reader.close()
    if reader.viewed and summary is not None:
        _echo("\n".join(summary_lines(summary)), err=False)
    _echo(errors)
    return code


def _wait_end(process: FeederProcess, patience_s: float, waiting: str, what: str) -> int:
    """Close the channel and wait for the end, then end it by force; return a shell's exit code."""
    process.close_input()
    code = process.wait(min(REPORT_AFTER_S, patience_s))
    if code is None:
        if process.summary is None:
            _say(waiting)
        code = process.wait(patience_s)
    if code is None:
        _say(f"THE {what} DOES NOT END: STOP THE MOUNT BY HAND; ending it by force")
        process.end_by_force(GRACE_S)
        return 1
    return code if code >= 0 else 128 - code


def _echo(text: str, *, err: bool = True) -> None:
    """Print what there is to print; what commands a terminal in it becomes `?`."""
    if text:
        click.echo(printable(text, "\n"), err=err, nl=not text.endswith("\n"))


def _say(text: str) -> None:
    _echo(f"sattrack: {text}")


def end_with_the_terminal(process: Endable, patience_s: float) -> None:
    """Watch standard input from now on, where that is a terminal; its end ends the process, and this one.

    A pseudo-terminal or a pipe may vanish without a signal; a screen would then wait for keys forever, and
    the run with it, with nobody at the stop key. The process must stop the mount, has `patience_s` for
    that, and is ended by force after it: its guardian stops the mount then. Nothing is written any more:
    there is nobody to read.
    """
    try:
        descriptor = sys.stdin.fileno()
    except (OSError, ValueError):
        return
    # Of a terminal that is gone already, nothing but this says that it was one.
    if stat.S_ISCHR(os.fstat(descriptor).st_mode):
        _end_with((descriptor,), process, patience_s)


def _end_with(descriptors: tuple[int, ...], process: Endable, patience_s: float) -> None:
    """End a process and this one with a terminal, or with the pipes to the program that shows this screen."""
    poller = select.poll()
    for descriptor in descriptors:
        # Without any event asked for, only the end is reported.
        poller.register(descriptor, 0)

    def watch() -> None:
        poller.poll()
        process.close_input()
        if process.wait(patience_s) is None:
            process.end_by_force(GRACE_S)
        os._exit(HUNG_UP)

    threading.Thread(target=watch, name="terminal's end", daemon=True).start()

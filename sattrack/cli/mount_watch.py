"""`sattrack mount watch`: the manual console on a terminal, or as a stream of JSON lines."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import JsonLines, appearance, screen_options, tell
from sattrack.cli.mount_common import MountCall, mount_options, resolve
from sattrack.cli.screened import needed_terminal, tui_possible
from sattrack.control.manual.sitting import ConsoleSession
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.own_program import own_program
from sattrack.mount.requests import Park
from sattrack.runtime.console import OrderInbox, attend_console_session, stop_session
from sattrack.runtime.mounts import owner_of

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext
    from sattrack.runtime.mounts import Owner


@click.command("watch")
@click.option("--stream", is_flag=True, help="No screen: views as JSON lines on standard output.")
@click.option(
    "--control", is_flag=True, help="With --stream: orders as JSON lines on standard input; its end leaves."
)
@click.option("--park", is_flag=True, help="Park at once, as the key p does; SPACE stops it.")
@screen_options
@mount_options
def watch(context: CommandContext, stream: bool, control: bool, park: bool, **options: Any) -> int:
    """Operate a mount by hand, full screen: every field of its status live; jog, slew, sync, park, stop.

    SPACE stops the mount, everywhere. A jog ends by itself when its key is let go. Beside a session that owns
    the mount, it looks on.
    """
    call = resolve(context, options)
    if call.clock.speed != 1.0:
        raise BadInputError("--clock: a person jogs in real time; leave its speed out")
    if control and not stream:
        raise BadInputError("--control goes with --stream")
    if call.timeout_s is not None:
        raise BadInputError("--timeout: a console lasts until it is left")
    if park and stream:
        raise BadInputError("--park goes with the screen; `sattrack mount park` parks without one")
    if stream and sys.stdout.isatty():
        # A terminal that is held, by Ctrl-S or a full line, would hold up the loop that ends jogs.
        raise BadInputError("--stream is for programs, not for a terminal; leave it out, or pipe it on")
    if stream:
        return _stream(call, control)
    if importlib.util.find_spec("textual") is None:
        raise SattrackError("the screen needs textual: pip install 'sattrack[tui]'")
    if not tui_possible():
        raise BadInputError(
            f"watch needs {needed_terminal()}; `sattrack mount status` is one look, --stream is for programs"
        )
    from sattrack.tui.launch import watch_with_tui

    called = [word for word in sys.argv[1:] if word != "--park"]
    command = [*own_program(), *called, "--stream", "--control"]
    look = appearance(context, options["theme"], options["plain"])
    return watch_with_tui(command, first=Park() if park else None, appearance=look)


def _stop(owner: Owner) -> None:
    """Have the session that owns the mount stop it; where it does not answer, its silence shows."""
    with contextlib.suppress(SattrackError):
        stop_session(owner, lambda: None)


class _NoOrders(OrderInbox):
    """Nobody's orders."""

    def __init__(self) -> None:
        self.ignored = 0

    def orders(self) -> tuple[()]:
        """Return none."""
        return ()


def _stream(call: MountCall, control: bool) -> int:
    lines = JsonLines()
    inbox = OrderInbox() if control else _NoOrders()
    owner = None if call.address is None else owner_of(call.address.name)
    with call.connected(own=owner is None) as connection:
        console_session = ConsoleSession(
            call.console(), connection.now_utc_s(), None if owner is None else str(owner)
        )
        attend_console_session(
            console_session,
            connection,
            inbox,
            lambda now_utc_s: lines.write(console_session.view(now_utc_s)),
            None if owner is None else partial(_stop, owner),
        )
    if inbox.ignored:
        tell(f"{inbox.ignored} control lines were no orders")
    if console_session.mount_stopped is False:
        raise SattrackError("THE MOUNT DID NOT CONFIRM THE STOP: stop it by its own console")
    if console_session.mount_stopped:
        tell("the mount was stopped and seen at rest")
    return 0

"""`sattrack mount status`: one look at all that a mount tells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.commands.mount_common import mount_options, resolve
from sattrack.console_words import status_text
from sattrack.errand import Look
from sattrack.errors import InterruptedRunError, LinkLostError
from sattrack.runtime.console import attend

if TYPE_CHECKING:
    from sattrack.commands.common import CommandContext

PATIENCE_S = 3.0


@click.command("status")
@mount_options
def status(context: CommandContext, **options: Any) -> int:
    """Tell all that the mount says, once, with units; how well it is heard; and what its clock is off by.

    Nothing is sent, so that whatever drives the mount is not disturbed. Only a mount on this machine, which
    is a simulated one, is sent datagrams without a command where it keeps silent.
    """
    call = resolve(context, options, needs_site=False)
    with call.connected() as connection:
        local = connection.link.address.host.startswith("127.")
        began_utc_s = connection.now_utc_s()
        look = Look(call.console(), began_utc_s, call.timeout_s or PATIENCE_S, knock=local)
        interrupted = attend(look, connection, lambda _: None)
        view = look.console.view(connection.now_utc_s())
        silent = view.status is None
        advice = call.silence(connection, sent=local) if silent and not interrupted else ""
    if interrupted:
        raise InterruptedRunError("interrupted; nothing was asked of the mount")
    if context.json:
        click.echo(msgspec.json.encode(view).decode())
    if silent:
        counted = [
            f"{count} {what}"
            for count, what in (
                (view.link.rejected, "datagrams came that are no status"),
                (view.link.strangers, f"came from other hosts ({', '.join(view.stranger_hosts)})"),
            )
            if count
        ]
        heard = f" ({', '.join(counted)})" if counted else ""
        raise LinkLostError(
            f"no status from {call.name} within {call.timeout_s or PATIENCE_S:g} s{heard}; {advice}"
        )
    if not context.json:
        click.echo(status_text(view))
    return 0

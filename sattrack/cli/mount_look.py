"""`sattrack mount status`: one look at all that a mount tells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import tell
from sattrack.cli.mount_common import MountCall, mount_options, resolve, tell_result
from sattrack.control.manual.errand import Look
from sattrack.control.manual.procedures import Outcome
from sattrack.control.manual.report import view_of
from sattrack.core.errors import InterruptedRunError, LinkLostError
from sattrack.mount.alpaca.device import J2000_SYSTEM
from sattrack.mount.requests import TicketState
from sattrack.runtime.console import attend
from sattrack.runtime.owner import owner_of
from sattrack.views.console_words import Group, Line, status_text, yes

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.views.run import ConsoleView

PATIENCE_S = 3.0


@click.command("status")
@mount_options
def status(context: CommandContext, **options: Any) -> int:
    """Tell all that the mount says, once, with units; how well it is heard; and what its clock is off by.

    Nothing is sent, so that whatever drives the mount is not disturbed. A mount that a session on this
    machine owns is told of as that session hears it. Only a mount on this machine that nobody owns, which is
    a simulated one, is sent datagrams without a command where it keeps silent.
    """
    call = resolve(context, options, needs_site=False)
    owner = None if call.address is None else owner_of(call.address.name)
    if owner is not None:
        tell(f"as its owner hears it: {owner}")
    with call.connected(own=False) as connection:
        local = owner is None and connection.link.address.host.startswith("127.")
        began_utc_s = connection.now_utc_s()
        look = Look(call.console(), began_utc_s, call.timeout_s or PATIENCE_S, knock=local)
        interrupted = attend(look, connection, lambda _: None)
        view = view_of(look.console, connection.now_utc_s())
        silent = view.status is None
        advice = call.silence(connection, sent=local) if silent and not interrupted else ""
        told = [] if connection.telescope is None else [_telescope(connection.telescope)]
    if interrupted:
        raise InterruptedRunError("interrupted; nothing was asked of the mount")
    words = _silence_words(call, view, advice)
    if context.json:
        state = TicketState.FAILED if silent else TicketState.COMPLETE
        outcome = Outcome(state, False, words if silent else None)
        tell_result({"type": "status"}, outcome, ("link" if silent else "done", None), view)
    elif not silent:
        click.echo(status_text(view, *told))
    if silent:
        raise LinkLostError(words)
    return 0


def _telescope(facts: DeviceFacts) -> Group:
    """Return what an Alpaca telescope is, and can do."""
    modes = {1: "polar", 2: "German", None: "not told, taken for an equatorial one"}
    return Group(
        "telescope",
        (
            Line("name", facts.name),
            Line("interface", f"ITelescopeV{facts.interface_version}"),
            Line("alignment", modes.get(facts.alignment_mode, str(facts.alignment_mode))),
            Line("coordinates", "J2000" if facts.equatorial_system == J2000_SYSTEM else "of date"),
            *(
                Line(name, ", ".join(f"{one.low_deg_s:g} to {one.high_deg_s:g} °/s" for one in spans))
                for name, spans in (
                    ("turns HA at", facts.primary_rates),
                    ("turns Dec at", facts.secondary_rates),
                )
            ),
            Line("sets tracking", yes(facts.can_set_tracking)),
            Line("slews", yes(facts.can_slew)),
            Line("syncs", yes(facts.can_sync)),
            Line("guides", yes(facts.can_pulse_guide)),
        ),
    )


def _silence_words(call: MountCall, view: ConsoleView, advice: str) -> str:
    """Return that a mount was not heard, what came in its stead, and what to check."""
    counted = [
        f"{count} {what}"
        for count, what in (
            (view.link.rejected, "datagrams came that are no status"),
            (view.link.strangers, f"came from other hosts: {', '.join(view.stranger_hosts)}"),
        )
        if count
    ]
    heard = f" ({', '.join(counted)})" if counted else ""
    return f"no status from {call.name} within {call.timeout_s or PATIENCE_S:g} s{heard}; {advice}"

"""`sattrack mount abort`, `park` and `home`: what brings a mount to rest, or to where it rests."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import tell
from sattrack.cli.mount_common import mount_options, perform, resolve
from sattrack.control.manual.procedures import ParkThere, procedure_for
from sattrack.mount.requests import Abort, FindHome, Park
from sattrack.runtime.owner import owner_of
from sattrack.runtime.stopping import stop_session, wait_until_free

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext
    from sattrack.mount.requests import Request


@click.command("abort")
@mount_options
def abort(context: CommandContext, **options: Any) -> int:
    """Stop both axes at once, and see them at rest; the drives stay on. A silent mount is told, too.

    A session that owns the mount stops it and ends, as by `sattrack stop`; then it is told once more.
    """
    call = resolve(context, options, needs_site=False)
    owner = None if call.address is None else owner_of(call.address.name)
    if owner is not None and call.address is not None:
        stopped = stop_session(owner, lambda: None)
        tell(f"stopping it through its session, {owner}" if stopped is None else stopped.words)
        if stopped is not None and (error := stopped.error()) is not None:
            raise error
        wait_until_free(call.address, lambda: None)
    if call.address is not None:
        call = replace(call, address=call.address.to_stop())
    return perform(call, procedure_for(Abort(), call.described.mount), {"type": "abort"}, "abort")


@click.command("park")
@click.option("--drives-on", is_flag=True, help="Rest at the park position, the drives' power left on.")
@mount_options
def park(context: CommandContext, drives_on: bool, **options: Any) -> int:
    """Slew to the profile's park position, stop there, see the mount at rest, cut the drives' power.

    The protocol has no acknowledgement for parking: it ends as "sent, unconfirmed" unless the mount says that
    it is at park. There is no unpark: the mount's own window gives the power back.
    """
    if not drives_on:
        return _ask(context, "park", Park(), options)
    call = resolve(context, options)
    call.check(Park())
    asked = {"type": "park", "drives_on": True}
    return perform(call, ParkThere(call.described.mount, power_off=False), asked, "rest at the park position")


@click.command("home")
@mount_options
def home(context: CommandContext, **options: Any) -> int:
    """Go to the home position and watch the way there.

    The protocol has no acknowledgement for it: it ends as "sent, unconfirmed" unless the mount says that it
    is at home.
    """
    return _ask(context, "home", FindHome(), options)


def _ask(context: CommandContext, name: str, request: Request, options: dict[str, Any]) -> int:
    call = resolve(context, options)
    call.check(request)
    return perform(call, procedure_for(request, call.described.mount), {"type": name}, name)

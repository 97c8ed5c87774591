"""The verbs of `sattrack mount` that end by themselves: status, slew, sync, abort, park, home and moves."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import tell
from sattrack.cli.mount_common import MountCall, mount_options, perform, resolve, tell_result
from sattrack.control.console import view_of
from sattrack.control.manual_operation import Look, MoveFor, Outcome, ParkThere, procedure_for, request_text
from sattrack.core.errors import BadInputError, InterruptedRunError, LinkLostError
from sattrack.mount.alpaca.device import J2000_SYSTEM
from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, FineRate, MoveAxis, Park, PulseGuide, Sync, TicketState
from sattrack.runtime.console import attend
from sattrack.runtime.owner import owner_of
from sattrack.runtime.stopping import stop_session, wait_until_free
from sattrack.views.console_words import (
    DEC_FORMS,
    MINUS,
    RA_FORMS,
    Group,
    Line,
    parse_dec,
    parse_ra,
    status_text,
    yes,
)

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.mount.requests import Request
    from sattrack.views.run import ConsoleView

LONGEST_MOVE_S = 600.0
_NEGATIVE = re.compile(r"-[0-9.]")
PATIENCE_S = 3.0


@click.command("move")
@click.option("--ra-rate", type=float, metavar="DEG_S", help="Rate of right ascension; positive goes east.")
@click.option("--dec-rate", type=float, metavar="DEG_S", help="Rate of declination; positive goes north.")
@click.option(
    "--seconds", type=float, required=True, metavar="S", help=f"How long; {LONGEST_MOVE_S:g} at most."
)
@mount_options
def move(
    context: CommandContext, ra_rate: float | None, dec_rate: float | None, seconds: float, **options: Any
) -> int:
    """Move at rates against the stars for some seconds, then track.

    Rates are those at which the reported right ascension and declination change, in degrees of the axis a
    second: 0 stays with the stars, positive goes east (right ascension grows) and north. An axis without a
    rate is left alone. Which way the motors must turn for that, the mount's profile says.
    """
    if not 0.0 < seconds <= LONGEST_MOVE_S:
        raise BadInputError(f"--seconds {seconds:g}: give seconds, above 0 and {LONGEST_MOVE_S:g} at most")
    call = resolve(context, options)
    request = MoveAxis(ra_rate, dec_rate)
    call.check(request)
    asked = {"type": "move", "ra_rate_deg_s": ra_rate, "dec_rate_deg_s": dec_rate, "seconds": seconds}
    words = f"{request_text(request)} for {seconds:g} s"
    return perform(call, MoveFor(request, seconds), asked, words)


@click.command("pulse")
@click.option("--ra", "ra_ms", type=int, default=0, metavar="MS", help="Milliseconds; negative is east.")
@click.option("--dec", "dec_ms", type=int, default=0, metavar="MS", help="Milliseconds; negative is south.")
@mount_options
def pulse(context: CommandContext, ra_ms: int, dec_ms: int, **options: Any) -> int:
    """Move at the mount's guide rate for some milliseconds on either axis, and see it end."""
    call = resolve(context, options, needs_site=False)
    request = PulseGuide(ra_ms, dec_ms)
    call.check(request)
    asked = {"type": "pulse", "ra_ms": ra_ms, "dec_ms": dec_ms}
    return perform(call, procedure_for(request, call.described.mount), asked, request_text(request))


@click.command("fine-rate")
@click.option(
    "--ra", "ra_deg_s", type=float, default=0.0, metavar="DEG_S", help="Added to tracking, westward."
)
@click.option("--dec", "dec_deg_s", type=float, default=0.0, metavar="DEG_S", help="Positive goes north.")
@mount_options
def fine_rate(context: CommandContext, ra_deg_s: float, dec_deg_s: float, **options: Any) -> int:
    """Adjust the tracking by small rates; without any, take adjustments back.

    The rates hold until another program sends to the mount: every datagram says them anew, and the other
    verbs say zero. The protocol gives them no sign and no acknowledgement.
    """
    call = resolve(context, options, needs_site=False)
    request = FineRate(ra_deg_s, dec_deg_s)
    call.check(request)
    asked = {"type": "fine_rate", "ra_deg_s": ra_deg_s, "dec_deg_s": dec_deg_s}
    return perform(call, procedure_for(request, call.described.mount), asked, request_text(request))


class DirectionCommand(click.Command):
    """A command whose arguments may be negative numbers, which are no options then."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Write the minus of an argument in a way that no option begins with."""
        takes_value = {
            name
            for param in self.params
            if isinstance(param, click.Option) and not param.is_flag
            for name in param.opts
        }
        before = ["", *args]
        marked = [
            MINUS + text[1:] if _NEGATIVE.match(text) and last not in takes_value else text
            for text, last in zip(args, before, strict=False)
        ]
        return super().parse_args(ctx, marked)


@click.command("slew", cls=DirectionCommand, epilog=f"RA: {RA_FORMS}. DEC: {DEC_FORMS}.")
@click.argument("ra")
@click.argument("dec")
@mount_options
def slew(context: CommandContext, ra: str, dec: str, **options: Any) -> int:
    """Go to RA and DEC, of date as the mount reports them, and track there. Ends when the mount stands."""
    return _point(context, Slew(parse_ra(ra), parse_dec(dec)), options)


@click.command("sync", cls=DirectionCommand, epilog=f"RA: {RA_FORMS}. DEC: {DEC_FORMS}.")
@click.argument("ra")
@click.argument("dec")
@mount_options
def sync(context: CommandContext, ra: str, dec: str, **options: Any) -> int:
    """Make the mount report RA and DEC, of date, for where it points. Refused while it moves."""
    return _point(context, Sync(parse_ra(ra), parse_dec(dec)), options)


def _point(context: CommandContext, request: Slew | Sync, options: dict[str, Any]) -> int:
    call = resolve(context, options)
    call.check(request)
    kind = "slew" if isinstance(request, Slew) else "sync"
    asked = {"type": kind, "ra_deg": request.ra_deg, "dec_deg": request.dec_deg}
    return perform(call, procedure_for(request, call.described.mount), asked, request_text(request))


@click.command("abort")
@mount_options
def abort(context: CommandContext, **options: Any) -> int:
    """Stop both axes at once, and see them at rest; the drives stay on. A silent mount is sent it, too.

    A session that owns the mount stops it and ends, as by `sattrack stop`; then it is sent once more.
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


@click.command("status")
@mount_options
def status(context: CommandContext, **options: Any) -> int:
    """Tell all that the mount says, once, with units; how well it is heard; and what its clock is off by.

    Nothing is sent, so that what drives the mount is not disturbed. A mount that a session on this
    machine owns is shown as that session hears it. Only a mount on this machine that nobody owns, which is
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
        groups = [] if connection.telescope is None else [_telescope(connection.telescope)]
    if interrupted:
        raise InterruptedRunError("interrupted; nothing was asked of the mount")
    words = _silence_words(call, view, advice)
    if context.json:
        state = TicketState.FAILED if silent else TicketState.COMPLETE
        outcome = Outcome(state, False, words if silent else None)
        tell_result({"type": "status"}, outcome, ("link" if silent else "done", None), view)
    elif not silent:
        click.echo(status_text(view, *groups))
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

"""`sattrack mount slew` and `sync`: a direction of date, in the forms that people write."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.mount_common import mount_options, perform, resolve
from sattrack.control.manual.procedures import procedure_for, request_words
from sattrack.mount.model import Slew
from sattrack.mount.requests import Sync
from sattrack.views.console_words import DEC_FORMS, MINUS, RA_FORMS, parse_dec, parse_ra

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext

_NEGATIVE = re.compile(r"-[0-9.]")


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
    return perform(call, procedure_for(request, call.described.mount), asked, request_words(request))

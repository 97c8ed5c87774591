"""`sattrack mount move`, `pulse` and `fine-rate`: rates and durations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.mount_common import mount_options, perform, resolve
from sattrack.control.manual.procedures import MoveFor, procedure_for, request_words
from sattrack.core.errors import BadInputError
from sattrack.mount.requests import FineRate, MoveAxis, PulseGuide

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext

LONGEST_MOVE_S = 600.0


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
    words = f"{request_words(request)} for {seconds:g} s"
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
    return perform(call, procedure_for(request, call.described.mount), asked, request_words(request))


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
    return perform(call, procedure_for(request, call.described.mount), asked, request_words(request))

"""`sattrack mount VERB`: one operation with a mount, its outcome, and the manual console."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import math
import re
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, mount_option, profile_option
from sattrack.cli.output import JsonLines, renew, renew_at_once, say, tell
from sattrack.cli.screen import appearance, refuse_screen, screen_options, tui_possible
from sattrack.control.console import Console
from sattrack.control.manual_operation import ConsoleSession, Look, ManualOperation, view_of
from sattrack.control.procedures import DONE, MoveFor, Outcome, ParkThere, procedure_for, request_text
from sattrack.core.errors import (
    BadInputError,
    InterruptedRunError,
    LinkLostError,
    SafetyLimitError,
    SattrackError,
    error_type,
    how_to_install,
)
from sattrack.core.process import self_command
from sattrack.mount.alpaca.device import J2000_SYSTEM
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, LinkView, Readings, Slew, Status
from sattrack.mount.requests import (
    Abort,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Sync,
    TicketState,
    objection,
)
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import Connection, connected
from sattrack.runtime.console import OrderInbox, attend, attend_console_session, stop_session, wait_until_free
from sattrack.runtime.mounts import owner_of
from sattrack.runtime.system import StopRequest, stopping
from sattrack.runtime.turns import folder, forget, left_moving
from sattrack.views.formatting import (
    DEC_FORMS,
    MINUS,
    RA_FORMS,
    Group,
    StatusLine,
    parse_dec,
    parse_ra,
    pointing_text,
    status_text,
    yes,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from sattrack.control.procedures import Procedure
    from sattrack.core.clock import Clock
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.requests import Request
    from sattrack.runtime.mounts import MountAddress, Owner
    from sattrack.views.run import ConsoleView
    from tle.site import Site


def mount_name(address: MountAddress | None) -> str:
    """Return a mount's name for people; None is the simulated one."""
    return "sim" if address is None else str(address)


@dataclass(frozen=True, slots=True)
class MountCall:
    """Which mount a verb is for, and how to reach it; `address` None is the simulated one."""

    context: CommandContext
    address: MountAddress | None
    described: ProfileFile
    site: Site | None
    clock: Clock
    timeout_s: float | None

    @property
    def name(self) -> str:
        """The mount's name for people."""
        return mount_name(self.address)

    def console(self) -> Console:
        """Return a console for it."""
        return Console(self.described.mount, self.context.settings.safety.limits(), self.site, self.name)

    def connected(self, own: bool = True) -> AbstractContextManager[Connection]:
        """Return a connection to it, to be entered; without `own`, only to look at it."""
        return connected(self.address, self.described, self.site, self.clock, own)

    def check(self, request: Request) -> None:
        """Raise BadInputError where a request cannot be one, before anything is sent."""
        text = objection(request, self.described.mount)
        if text is None and self.address is not None:
            text = self.address.not_carried(request)
        if text is not None:
            raise BadInputError(f"{text}; nothing was sent")

    def silence(self, connection: Connection, sent: bool) -> str:
        """Return what to check where a mount was not heard; `sent` where it has been written to anyway."""
        if self.address is None:
            return "the simulated mount did not answer"
        if sent and connection.refused():
            return f"nothing listens for UDP on {self.address.name}"
        return self.address.silence_advice


def mount_options(
    function: Callable[..., Any],
    shared: tuple[str, ...] = ("site", "clock", "json"),
    ends: bool = True,
    goes_on: bool = False,
) -> Callable[..., Any]:
    """Add the options of every verb; the function's first argument becomes a CommandContext.

    One that `ends` by itself has a time limit; one that `goes_on` needs no settings that can be read.
    """
    options: tuple[Callable[[Callable[..., Any]], Callable[..., Any]], ...] = (
        common_options(*shared, goes_on=goes_on),
        profile_option,
        mount_option,
        click.option(
            "--timeout",
            type=float,
            metavar="S",
            hidden=not ends,
            help="Give up after this time; a motion is stopped.",
        ),
    )
    return functools.reduce(lambda made, option: option(made), options, function)


def resolve(
    context: CommandContext,
    options: dict[str, Any],
    needs_site: bool = True,
    uses_model: bool = True,
    stops: bool = False,
) -> MountCall:
    """Return which mount a verb is for. Raises BadInputError; no socket is opened.

    A verb that needs no site needs no pointing model: it goes without one that is refused. One that `stops`
    the mount goes without a profile that is refused.
    """
    url, address = context.mount(options["mount_url"])
    timeout_s = options["timeout"]
    if timeout_s is not None and not (math.isfinite(timeout_s) and timeout_s > 0.0):
        raise BadInputError(f"--timeout {timeout_s:g}: give seconds, above 0")
    described = (context.profile_to_stop if stops else context.profile)(options["profile"], url)
    site = context.site() if context.has_site() or (needs_site and address is not None) else None
    if site is None and address is None:
        site = demo_pass.SITE.place()
    if site is not None and address is not None:
        address = address.seen_from(site)
    if site is not None and described.pointing is not None:
        from sattrack.runtime.facts import check_model_site, pointing_of

        try:
            (pointing_of if uses_model else check_model_site)(described.mount, site)
        except BadInputError as error:
            if needs_site:
                raise
            tell(f"{error}; this goes without it")
            described = msgspec.structs.replace(described, pointing=None)
    return MountCall(context, address, described, site, context.clock(), timeout_s)


class VerbResult(msgspec.Struct, frozen=True):
    """What came of a verb, as scripts read it."""

    request: dict[str, Any]
    state: str
    acknowledged: bool
    reason: str | None
    ended_by: str
    mount_stopped: bool | None
    """Whether the mount was stopped at the end and seen at rest; null where it was not stopped."""
    hour_angle_deg: float | None
    looks_at_deg: tuple[float, float] | None
    """Right ascension and declination in which the telescope looks, by geometry and pointing model."""
    mount: str
    status: Status | None
    readings: Readings
    link: LinkView
    clock_offset_s: float | None
    stranger_hosts: tuple[str, ...]
    warnings: tuple[str, ...]


def perform(call: MountCall, procedure: Procedure, asked: dict[str, Any], text: str) -> int:
    """Carry a procedure out and tell what came of it; `text` says what was asked.

    Raises the SattrackError whose exit code the verb ends with, else returns 0.
    """
    with contextlib.ExitStack() as signals, call.connected() as connection:
        operation = ManualOperation(call.console(), procedure, connection.now_utc_s(), call.timeout_s)
        console = operation.console

        def show(now_utc_s: float) -> None:
            if sys.stderr.isatty():
                renew_at_once(f"{operation.doing}: {pointing_text(view_of(console, now_utc_s))}")

        attend(operation, connection, show)
        # What closes is closed whatever signals come: the outcome is told after that.
        signals.enter_context(stopping(StopRequest()))
        renew()
        never_heard = console.sample is None
        advice = call.silence(connection, sent=True) if never_heard else console.way_trouble
        view = view_of(console, connection.now_utc_s())
    outcome = operation.outcome
    assert outcome is not None
    if call.context.json:
        ending = (operation.ended_by or "error", operation.mount_stopped)
        tell_result(asked, outcome, ending, view)
    failed = failure(operation, outcome, text, advice)
    if failed is not None:
        raise failed
    if not call.context.json:
        how = outcome.state.value + (", acknowledged" if outcome.acknowledged else "")
        say(f"{text}: {how}" + (f" ({outcome.reason})" if outcome.reason else ""))
        say(pointing_text(view))
        for warning in view.warnings:
            tell(warning)
    return 0


def tell_result(
    asked: dict[str, Any], outcome: Outcome, ending: tuple[str, bool | None], view: ConsoleView
) -> None:
    """Write the document of a verb; `ending` is what ended it, and whether the mount was stopped then."""
    ended_by, mount_stopped = ending
    result = VerbResult(
        request=asked,
        state=outcome.state.value,
        acknowledged=outcome.acknowledged,
        reason=outcome.reason,
        ended_by=ended_by,
        mount_stopped=mount_stopped,
        hour_angle_deg=view.hour_angle_deg,
        looks_at_deg=view.looks_at_deg,
        mount=view.mount,
        status=view.status,
        readings=view.readings,
        link=view.link,
        clock_offset_s=view.clock_offset_s,
        stranger_hosts=view.stranger_hosts,
        warnings=view.warnings,
    )
    click.echo(msgspec.json.encode(result).decode())


def failure(
    operation: ManualOperation, outcome: Outcome, text: str, advice: str | None
) -> SattrackError | None:
    """Return the error that a verb ends with, its class by the exit code; None where it was done."""
    why = operation.ended_by or "error"
    if why == "done" and outcome.state in DONE:
        return None
    message = f"{text}: {outcome.reason or outcome.state.value}"
    if advice is not None:
        message += f"; {advice}"
    if operation.mount_stopped:
        message += "; the mount was stopped and seen at rest"
    elif operation.mount_stopped is False:
        message += "; THE MOUNT DID NOT CONFIRM THE STOP: stop it by its own console"
    elif not operation.begun:
        message += "; nothing was asked of the mount"
    by_safety = outcome.refusal is not None and outcome.refusal.by_safety
    if why in ("refused", "done") and by_safety:
        return SafetyLimitError(message)
    return error_type(why)(message)


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

    The rates are those of the reported right ascension and declination, in degrees of the axis per second: 0
    stays with the stars, positive goes east (right ascension grows) and north. An axis without a rate keeps
    its motion. The mount's profile gives the signs of the motors. With a geometry in the profile they are
    rates of the axes: 0 stands, --ra-rate turns the first axis against its angle, --dec-rate the second.

    \b
    Examples:
      sattrack mount move --ra-rate 0.5 --dec-rate -0.1 --seconds 4 --mount sim
    """
    if not 0.0 < seconds <= LONGEST_MOVE_S:
        raise BadInputError(f"--seconds {seconds:g}: give seconds, above 0 and {LONGEST_MOVE_S:g} at most")
    call = resolve(context, options)
    request = sent = MoveAxis(ra_rate, dec_rate)
    if call.described.mount.geometry is not None:
        sent = MoveAxis(SIDEREAL_RATE_DEG_S + (ra_rate or 0.0), dec_rate or 0.0)
    call.check(request)
    asked = {"type": "move", "ra_rate_deg_s": ra_rate, "dec_rate_deg_s": dec_rate, "seconds": seconds}
    text = f"{request_text(request)} for {seconds:g} s"
    return perform(call, MoveFor(sent, seconds), asked, text)


@click.command("pulse")
@click.option("--ra", "ra_ms", type=int, default=0, metavar="MS", help="Milliseconds; negative is east.")
@click.option("--dec", "dec_ms", type=int, default=0, metavar="MS", help="Milliseconds; negative is south.")
@mount_options
def pulse(context: CommandContext, ra_ms: int, dec_ms: int, **options: Any) -> int:
    """Move at the mount's guide rate for some milliseconds on either axis, and wait for the end.

    \b
    Examples:
      sattrack mount pulse --ra -500 --mount sim
    """
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
    """Adjust the tracking by small rates; without any, remove the adjustment.

    The rates hold until another program sends to the mount: every datagram carries them, and the other verbs
    send zero. The protocol defines no sign and no acknowledgement for them.

    \b
    Examples:
      sattrack mount fine-rate --ra 0.0001
      sattrack mount fine-rate
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
    """Go to RA and DEC, of date as the mount reports them, and track there. Ends when the slew has ended.

    With a pointing model in the profile the telescope looks at RA and DEC, air included. A mount with a
    geometry is led there by rates, and stopped at the end: then it tracks if it tracked before.

    \b
    Examples:
      sattrack mount slew 14h15m40s 19d10m --mount sim
      sattrack mount slew 213.92 -19.18
    """
    return _point(context, Slew(parse_ra(ra), parse_dec(dec)), options)


@click.command("sync", cls=DirectionCommand, epilog=f"RA: {RA_FORMS}. DEC: {DEC_FORMS}.")
@click.argument("ra")
@click.argument("dec")
@mount_options
def sync(context: CommandContext, ra: str, dec: str, **options: Any) -> int:
    """Make the mount report RA and DEC, of date, for where it points. Refused while the mount moves.

    \b
    Examples:
      sattrack mount sync 14h15m40s 19d10m
    """
    return _point(context, Sync(parse_ra(ra), parse_dec(dec)), options)


def _point(context: CommandContext, request: Slew | Sync, options: dict[str, Any]) -> int:
    call = resolve(context, options)
    call.check(request)
    kind = "slew" if isinstance(request, Slew) else "sync"
    asked = {"type": kind, "ra_deg": request.ra_deg, "dec_deg": request.dec_deg}
    return perform(call, procedure_for(request, call.described.mount), asked, request_text(request))


@click.command("abort")
@functools.partial(mount_options, goes_on=True)
def abort(context: CommandContext, **options: Any) -> int:
    """Stop both axes at once, and confirm that they are at rest; the drives stay on.

    It is sent to a silent mount, too. A session that owns the mount stops it and ends, as by `sattrack stop`;
    then the abort is sent once more.

    \b
    Examples:
      sattrack mount abort
    """
    call = resolve(context, options, needs_site=False, stops=True)
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
@click.option("--drives-on", is_flag=True, help="Stay at the park position with the drives' power on.")
@mount_options
def park(context: CommandContext, drives_on: bool, **options: Any) -> int:
    """Slew to the profile's park position, stop there, confirm rest, and cut the drives' power.

    The protocol has no acknowledgement for parking: it ends as "sent, unconfirmed" unless the mount reports
    that it is at park. There is no unpark: the mount's own window gives the power back.

    \b
    Examples:
      sattrack mount park --mount sim
      sattrack mount park --drives-on
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
    """Go to the home position, and wait until it is there.

    The protocol has no acknowledgement for it: it ends as "sent, unconfirmed" unless the mount reports that
    it is at home.

    \b
    Examples:
      sattrack mount home --mount sim
    """
    return _ask(context, "home", FindHome(), options)


@click.command("unwound")
@mount_option
@common_options("json")
def unwound(context: CommandContext, mount_url: str | None) -> int:
    """Confirm that the cables are looked at, and that the axes are within half a turn of the meridian.

    A mount that moved while nobody heard it, as in a loss of power, may have gone half round. No status tells
    how its cables are wound then, and sattrack does not move it until this is confirmed. Nothing is sent.

    \b
    Examples:
      sattrack mount unwound
    """
    _, address = context.mount(mount_url)
    left = owner = None
    if address is not None:
        owner, left = owner_of(address.name), left_moving(address.name)
    if owner is not None:
        raise BadInputError(f"{address} has an owner: {owner}; `sattrack stop` ends it, then confirm")
    trouble = None if left is None else left.trouble(time.time())
    if address is not None:
        try:
            forget(address.name)
        except OSError as error:
            raise SattrackError(
                f"{folder()}: nothing can be noted there: {error.strerror}: set XDG_STATE_HOME to a folder "
                "that can be written"
            ) from error
    if context.json:
        click.echo(msgspec.json.encode({"mount": mount_name(address), "was": left}).decode())
    elif trouble is None and left is not None and left.first_axis_deg is not None:
        was = f"it was left with its first axis at {left.first_axis_deg:.0f}°"
        say(f"{mount_name(address)}: confirmed; {was}, and that is now taken to be within half a turn of 0°")
    elif trouble is None:
        say(f"{mount_name(address)}: there was nothing to confirm: the turns of its axes are known")
    else:
        say(f"{mount_name(address)}: confirmed; its axes are taken to be within half a turn of the meridian")
    return 0


def _ask(context: CommandContext, name: str, request: Request, options: dict[str, Any]) -> int:
    call = resolve(context, options)
    call.check(request)
    return perform(call, procedure_for(request, call.described.mount), {"type": name}, name)


@click.command("status")
@functools.partial(mount_options, shared=("site", "clock", "json", "utc"))
def status(context: CommandContext, **options: Any) -> int:
    """Show the mount's whole status once, with units, the link, and the offset of the mount's clock.

    Nothing is sent, so the program that drives the mount is not disturbed. If a session here owns the
    mount, the status is as that session receives it. Only a silent mount on this machine that nobody owns,
    which is a simulated one, is sent datagrams without a command.

    \b
    Examples:
      sattrack mount status --mount sim
    """
    call = resolve(context, options, needs_site=False)
    owner = None if call.address is None else owner_of(call.address.name)
    if owner is not None:
        tell(f"as its owner receives it: {owner}")
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
    text = _silence_text(call, view, advice)
    if context.json:
        state = TicketState.FAILED if silent else TicketState.COMPLETE
        outcome = Outcome(state, False, text if silent else None)
        tell_result({"type": "status"}, outcome, ("link" if silent else "done", None), view)
    elif not silent:
        say(status_text(view, *groups))
    if silent:
        raise LinkLostError(text)
    return 0


def _telescope(facts: DeviceFacts) -> Group:
    """Return what an Alpaca telescope is, and can do."""
    modes = {1: "polar", 2: "German", None: "not reported, taken as equatorial"}
    return Group(
        "telescope",
        (
            StatusLine("name", facts.name),
            StatusLine("interface", f"ITelescopeV{facts.interface_version}"),
            StatusLine("alignment", modes.get(facts.alignment_mode, str(facts.alignment_mode))),
            StatusLine("coordinates", "J2000" if facts.equatorial_system == J2000_SYSTEM else "of date"),
            *(
                StatusLine(name, ", ".join(f"{one.low_deg_s:g} to {one.high_deg_s:g} °/s" for one in spans))
                for name, spans in (
                    ("turns HA at", facts.primary_rates),
                    ("turns Dec at", facts.secondary_rates),
                )
            ),
            StatusLine("sets tracking", yes(facts.can_set_tracking)),
            StatusLine("slews", yes(facts.can_slew)),
            StatusLine("syncs", yes(facts.can_sync)),
            StatusLine("guides", yes(facts.can_pulse_guide)),
        ),
    )


def _silence_text(call: MountCall, view: ConsoleView, advice: str) -> str:
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


@click.command("watch")
@click.option("--stream", is_flag=True, help="Write views as JSON lines to standard output; no screen.")
@click.option(
    "--control",
    is_flag=True,
    help="With --stream: read orders as JSON lines from standard input until it ends.",
)
@click.option("--park", is_flag=True, help="Park at once, as the key p does; SPACE stops it.")
@screen_options
@functools.partial(mount_options, shared=("site", "clock", "utc"), ends=False)
def watch(context: CommandContext, stream: bool, control: bool, park: bool, **options: Any) -> int:
    """Operate a mount by hand, full screen: every field of its status live; jog, slew, sync, park, stop.

    SPACE always stops the mount. A jog ends when its key is released. If a session owns the mount, the
    console only watches.

    \b
    Examples:
      sattrack mount watch --mount sim
    """
    call = resolve(context, options)
    if call.clock.speed != 1.0:
        raise BadInputError("--clock: jogging needs real time; give no speed")
    if control and not stream:
        raise BadInputError("--control needs --stream")
    if call.timeout_s is not None:
        raise BadInputError("--timeout: a console has no time limit")
    if park and stream:
        raise BadInputError("--park needs the screen; `sattrack mount park` parks without one")
    if stream and sys.stdout.isatty():
        # A terminal that is held, by Ctrl-S or a full line, would hold up the loop that ends jogs.
        raise BadInputError("--stream is for programs, not for a terminal; omit it, or pipe the output")
    if stream:
        return _stream(call, control)
    if importlib.util.find_spec("textual") is None:
        raise SattrackError(f"the screen needs textual: {how_to_install('tui')}")
    if not tui_possible():
        refuse_screen("watch", "; `sattrack mount status` shows one status, --stream is for programs")
    from sattrack.tui.launch import watch_with_tui

    called = [word for word in sys.argv[1:] if word != "--park"]
    command = [*self_command(), *called, "--stream", "--control"]
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
        tell(f"{inbox.ignored} control lines were not valid orders")
    if console_session.mount_stopped is False:
        raise SattrackError("THE MOUNT DID NOT CONFIRM THE STOP: stop it by its own console")
    if console_session.mount_stopped:
        tell("the mount was stopped and seen at rest")
    return 0

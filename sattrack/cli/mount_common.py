"""What the verbs of `sattrack mount` share: options, one operation with a mount, and its outcome."""

from __future__ import annotations

import functools
import math
import select
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, mount_option, profile_option, renew, tell
from sattrack.control.manual.console import Console
from sattrack.control.manual.errand import DONE, ManualOperation
from sattrack.control.manual.report import view_of
from sattrack.core.errors import (
    BadInputError,
    InterruptedRunError,
    LinkLostError,
    SafetyLimitError,
    SattrackError,
)
from sattrack.mount.model import LinkView, Readings, Status
from sattrack.mount.requests import objection
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import Connection, connected
from sattrack.runtime.console import attend
from sattrack.runtime.mounts import mount_address
from sattrack.views.console_words import where_words

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from sattrack.control.manual.procedures import Outcome, Procedure
    from sattrack.core.clock import Clock
    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.requests import Request
    from sattrack.runtime.mounts import MountAddress
    from sattrack.views.run import ConsoleView
    from tle.site import Site


@dataclass(frozen=True, slots=True)
class MountCall:
    """Which mount a verb is for, and how it is to be met; `address` None is the simulated one."""

    context: CommandContext
    address: MountAddress | None
    described: ProfileFile
    site: Site | None
    clock: Clock
    timeout_s: float | None

    @property
    def name(self) -> str:
        """The mount's name for people."""
        return "sim" if self.address is None else str(self.address)

    def console(self) -> Console:
        """Return a console for it."""
        return Console(self.described.mount, self.context.settings.safety.limits(), self.site, self.name)

    def connected(self, own: bool = True) -> AbstractContextManager[Connection]:
        """Return a connection to it, to be entered; without `own`, only to look at it."""
        return connected(self.address, self.described, self.site, self.clock, own)

    def check(self, request: Request) -> None:
        """Raise BadInputError where a request cannot be one, before anything is sent."""
        words = objection(request, self.described.mount)
        if words is None and self.address is not None:
            words = self.address.not_carried(request)
        if words is not None:
            raise BadInputError(f"{words}; nothing was sent")

    def silence(self, connection: Connection, sent: bool) -> str:
        """Return what to check where a mount was not heard; `sent` where it has been written to anyway."""
        if self.address is None:
            return "the simulated mount did not answer"
        if sent and connection.refused():
            return f"nothing listens on {self.address.name}"
        return self.address.silence_advice


def mount_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of every verb; the function's first argument becomes a CommandContext."""
    options: tuple[Callable[[Callable[..., Any]], Callable[..., Any]], ...] = (
        common_options,
        profile_option,
        mount_option,
        click.option(
            "--timeout", type=float, metavar="S", help="Give up, and stop the mount, after so long."
        ),
    )
    return functools.reduce(lambda made, option: option(made), options, function)


def resolve(context: CommandContext, options: dict[str, Any], needs_site: bool = True) -> MountCall:
    """Return which mount a verb is for. Raises BadInputError; no socket is opened."""
    url = options["mount_url"] or context.settings.mount.url
    address = mount_address(url)
    if address is not None and context.clock_option is not None:
        raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
    timeout_s = options["timeout"]
    if timeout_s is not None and not (math.isfinite(timeout_s) and timeout_s > 0.0):
        raise BadInputError(f"--timeout {timeout_s:g}: give seconds, above 0")
    described = context.profile(options["profile"], url)
    site = context.site() if context.has_site() or (needs_site and address is not None) else None
    if site is None and address is None:
        site = demo_pass.SITE.place()
    if site is not None and address is not None:
        address = address.seen_from(site)
    return MountCall(context, address, described, site, context.clock(), timeout_s)


class VerbResult(msgspec.Struct, frozen=True):
    """What came of a verb, as scripts read it."""

    request: dict[str, Any]
    state: str
    acknowledged: bool
    reason: str | None
    ended_by: str
    mount_stopped: bool | None
    """Whether the mount was told to stop at the end and seen at rest; null where it was not told to."""
    hour_angle_deg: float | None
    mount: str
    status: Status | None
    readings: Readings
    link: LinkView
    clock_offset_s: float | None
    stranger_hosts: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(slots=True)
class Progress:
    """A line about an operation that renews itself, on a terminal only, and never waited for."""

    operation: ManualOperation
    _shown: bool = False

    def show(self, now_utc_s: float) -> None:
        """Renew it."""
        if not sys.stderr.isatty():
            return
        _, writable, _ = select.select([], [sys.stderr], [], 0.0)
        if writable:
            self._shown = True
            words = where_words(view_of(self.operation.console, now_utc_s))
            renew(f"{self.operation.doing}: {words}")

    def wipe(self) -> None:
        """Take the line away."""
        if self._shown:
            renew()


def perform(call: MountCall, procedure: Procedure, asked: dict[str, Any], words: str) -> int:
    """Carry a procedure out and tell what came of it; `words` say what was asked.

    Raises the SattrackError whose exit code the verb ends with, else returns 0.
    """
    with call.connected() as connection:
        operation = ManualOperation(call.console(), procedure, connection.now_utc_s(), call.timeout_s)
        progress = Progress(operation)
        attend(operation, connection, progress.show)
        progress.wipe()
        never_heard = operation.console.sample is None
        advice = call.silence(connection, sent=True) if never_heard else operation.console.way_trouble
        view = view_of(operation.console, connection.now_utc_s())
    outcome = operation.outcome
    assert outcome is not None
    if call.context.json:
        ending = (operation.ended_by or "error", operation.mount_stopped)
        tell_result(asked, outcome, ending, view)
    failed = failure(operation, outcome, words, advice)
    if failed is not None:
        raise failed
    if not call.context.json:
        how = outcome.state.value + (", acknowledged" if outcome.acknowledged else "")
        click.echo(f"{words}: {how}" + (f" ({outcome.reason})" if outcome.reason else ""))
        click.echo(where_words(view))
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
    operation: ManualOperation, outcome: Outcome, words: str, advice: str | None
) -> SattrackError | None:
    """Return the error that a verb ends with, its class by the exit code; None where it was done."""
    why = operation.ended_by or "error"
    if why == "done" and outcome.state in DONE:
        return None
    message = f"{words}: {outcome.reason or outcome.state.value}"
    if advice is not None:
        message += f"; {advice}"
    if operation.mount_stopped:
        message += "; the mount was stopped and seen at rest"
    elif operation.mount_stopped is False:
        message += "; THE MOUNT DID NOT CONFIRM THE STOP: stop it by its own console"
    elif not operation.begun:
        message += "; nothing was asked of the mount"
    by_safety = outcome.refusal is not None and outcome.refusal.by_safety
    if why.startswith("limit:") or (why in ("refused", "done") and by_safety):
        return SafetyLimitError(message)
    kinds: dict[str, type[SattrackError]] = {"link": LinkLostError, "operator": InterruptedRunError}
    return kinds.get(why, SattrackError)(message)

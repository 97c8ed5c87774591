"""`sattrack stop`: stop the mount from any terminal."""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.commands.common import CommandContext, common_options, profile_option
from sattrack.errors import BadInputError, SattrackError
from sattrack.runtime.mounts import FORMS, mount_address
from sattrack.runtime.night_stop import NightStop, begin_stops, listed_nights
from sattrack.runtime.owner import ask_give_up, owner_of, owners, this_user
from sattrack.runtime.stopping import MountStop, stop_after, stop_directly, stop_session

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.mount import MountProfile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.runtime.night_stop import Night
    from sattrack.runtime.owner import Owner

SHOW_EVERY = 4


class StopDocument(msgspec.Struct, frozen=True):
    """What scripts read."""

    stopped: tuple[MountStop, ...]
    errors: tuple[str, ...]
    nights: tuple[NightStop, ...] = ()


@dataclass(slots=True)
class Waiting:
    """A line on a terminal that says that the stop is not seen through yet."""

    _calls: itertools.count[int] = field(default_factory=itertools.count)
    _shown: bool = False

    def show(self) -> None:
        """Renew it now and then."""
        number = next(self._calls)
        if sys.stderr.isatty() and number and number % SHOW_EVERY == 0:
            self._shown = True
            click.echo(f"\r\x1b[Kstopping{'.' * (number // SHOW_EVERY % 4)}", nl=False, err=True)

    def wipe(self) -> None:
        """Take it away."""
        if self._shown:
            click.echo("\r\x1b[K", nl=False, err=True)


@click.command("stop")
@click.option(
    "--mount",
    "mount_url",
    metavar="URL",
    help=f"Only this mount: {FORMS}. Default: whatever sessions of yours move, and the mount of the "
    "settings.",
)
@click.option(
    "--give-up",
    is_flag=True,
    help="Stop nothing: end guardians that go on telling mounts to stop after their sessions.",
)
@profile_option
@common_options
def command(context: CommandContext, mount_url: str | None, give_up: bool, profile: Path | None) -> int:
    """Stop the mount, from any terminal, and see it at rest; stop the schedule that moves it.

    The session that owns it stops it and ends: track, demo, a verb, a console; where it hangs, its guardian
    does. A mount that no session owns is told directly. Where the mount is not seen at rest, a guardian goes
    on telling it to stop until it is, or until --give-up. A schedule's run ends and follows nothing more,
    restarted or not, until a person says `sattrack run FILE --resume`.
    """
    url = mount_url or context.settings.mount.url
    address = _address(url)
    # Before the mount is told: a runner that sees its session end must not begin it again.
    nights = [] if give_up else begin_stops(_nights(mount_url, address))
    sessions = _sessions(mount_url, address)
    if not sessions and not nights and address is None:
        raise BadInputError(
            "nothing to stop: no session of yours moves a mount on this machine; "
            "--mount URL stops a mount directly"
        )
    if give_up:
        return _give_up(context, sessions)
    waiting = Waiting()
    usual = context.profile(profile, url).mount
    done, failed = _stop_all(sessions, address, usual, waiting)
    stopped = [night.finish(waiting.show) for night in nights]
    if nights:
        # A session that a runner had just begun when we looked.
        known = {owner.pid for owner in sessions}
        begun = [owner for owner in _sessions(mount_url, address) if owner.pid not in known]
        later = _stop_all(begun, None, usual, waiting)
        done, failed = done + later[0], failed + later[1]
    failed += [SattrackError(night.words) for night in stopped if not night.kept]
    waiting.wipe()
    _tell(done, stopped, failed, context.json)
    if failed:
        raise failed[0]
    return 0


def _address(url: str | None) -> MountAddress | None:
    """Return the mount that a URL names; None for simulated ones, which end with their sessions."""
    return None if url is None else mount_address(url)


def _sessions(mount_url: str | None, address: MountAddress | None) -> list[Owner]:
    """Return the sessions that are meant: that of the mount that was named, else all of ours."""
    if mount_url is None:
        return [owner for owner in owners() if this_user() in (0, owner.user)]
    owner = None if address is None else owner_of(address.name)
    return [] if owner is None else [owner]


def _nights(mount_url: str | None, address: MountAddress | None) -> list[Night]:
    """Return the schedules' runs that are meant: those with the mount that was named, else all of ours."""
    if mount_url is None:
        return listed_nights()
    return [] if address is None else [night for night in listed_nights() if night.mount == address.name]


def _give_up(context: CommandContext, sessions: list[Owner]) -> int:
    """End the guardians that go on, and tell of each."""
    ended = [(owner, was) for owner in sessions if (was := ask_give_up(owner)) is not None]
    if context.json:
        given_up = [{"mount": owner.mount, "goes_on": was} for owner, was in ended]
        click.echo(msgspec.json.encode({"given_up": given_up}).decode())
    else:
        for owner, was in ended:
            click.echo(f"{owner.mount}: process {was.pid} gave up; {was.heard}; IT IS NOT KNOWN AT REST")
    if not ended:
        raise BadInputError("nothing to give up: no guardian goes on telling a mount to stop")
    return 0


def _stop_all(
    sessions: list[Owner], address: MountAddress | None, profile: MountProfile, waiting: Waiting
) -> tuple[list[MountStop], list[SattrackError]]:
    """Stop each session's mount, and `address` where it is none of them."""
    done: list[MountStop] = []
    failed: list[SattrackError] = []
    for owner in sessions:
        try:
            done.append(stop_session(owner, waiting.show) or stop_after(owner, profile, waiting.show))
        except SattrackError as error:
            failed.append(error)
    here = None if address is None else address.name
    if address is not None and here not in {owner.mount for owner in sessions}:
        try:
            done.append(stop_directly(address, profile, waiting.show))
        except SattrackError as error:
            failed.append(error)
    unsure = [stopped.error() for stopped in done]
    failed.extend(error for error in unsure if error is not None)
    return done, failed


def _tell(done: list[MountStop], nights: list[NightStop], failed: list[SattrackError], as_json: bool) -> None:
    """Tell what came of it; the first error is told by whoever catches it."""
    if as_json:
        document = StopDocument(tuple(done), tuple(str(error) for error in failed), tuple(nights))
        click.echo(msgspec.json.encode(document).decode())
    else:
        for stopped in done:
            if stopped.error() is None:
                click.echo(f"{stopped.mount}: {stopped.words}")
        for night in nights:
            if night.kept:
                click.echo(night.words)
    for other in failed[1:]:
        click.echo(f"sattrack: {other}", err=True)

"""The hands of `sattrack run` with a mount in real time: which commands, whose clock, whom to tell."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

from sattrack.cli.common import tell
from sattrack.core.clock import SimulatedClock
from sattrack.runtime.mounts import mount_address
from sattrack.schedule.night_commands import Errands
from sattrack.schedule.night_hands import Kit, LiveHands
from sattrack.schedule.night_session import this_program
from tle.instants import Utc
from tle.sources import newest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.cli.common import CommandContext
    from sattrack.cli.run_night import NightPlans
    from sattrack.cli.run_told import Told
    from sattrack.mount.profiles import ProfileFile
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.night import NightPass, Ways
    from sattrack.schedule.night_files import NightFiles
    from sattrack.schedule.night_journal import Journal
    from sattrack.schedule.night_stop import NightRequests
    from tle.elements import Elements


def live_hands(
    context: CommandContext,
    schedule: Schedule,
    profile: ProfileFile,
    mount_url: str,
    parts: tuple[NightPlans, NightFiles, Journal, Told, NightRequests],
    read_again: Callable[[], tuple[Schedule, Ways]],
) -> LiveHands:
    """Return what carries a schedule out in real time."""
    plans, files, journal, told, requests = parts
    clock = context.clock()
    simulated = clock if isinstance(clock, SimulatedClock) else None

    def now() -> float:
        return time.time() if simulated is None else simulated.utc_s(time.monotonic())

    def clock_option() -> tuple[str, ...]:
        if simulated is None:
            return ()
        return ("--clock", f"{Utc(now()).isoformat('milliseconds')}x{simulated.speed:g}")

    kit = Kit(
        schedule=schedule,
        site=context.site(),
        profile=profile.mount,
        address=mount_address(mount_url),
        folder=plans.file.absolute().parent,
        program=tuple(this_program()),
        common=_common(context, mount_url, files.profile(profile)),
        now=now,
        speed=1.0 if simulated is None else simulated.speed,
        clock=clock_option,
        plan=plans.make,
        renew=renewer(context, schedule),
        waits=told.waits,
        follows=told.follows,
        tell=tell,
        troubled=told.troubled,
        read_again=read_again,
        errands=Errands(tell),
        requests=requests,
        service=told.service,
    )
    return LiveHands(kit, files, journal)


def _common(context: CommandContext, mount_url: str, profile: Path) -> tuple[str, ...]:
    """Return the options that every command of ours is given, as this one was."""
    given = click.get_current_context().params
    site = context.site()
    options = ["--mount", mount_url, "--site", f"{site.latitude_deg},{site.longitude_deg},{site.height_m}"]
    if given.get("config") is not None:
        options += ["--config", str(given["config"])]
    return (*options, "--profile", str(profile))


def renewer(context: CommandContext, schedule: Schedule) -> Callable[[NightPass], Elements | None]:
    """Return what gives a pass' satellite's newest elements, by the providers' rules; None where none are."""

    def renew(one: NightPass) -> Elements | None:
        sources = (*context.sources(), *schedule.elements) if one.source is None else (one.source,)
        number = one.elements.catalog_number
        found = [each for each in newest(context.load(sources).accepted) if each.catalog_number == number]
        return found[0] if found and found[0].epoch.unix_s > one.elements.epoch.unix_s else None

    return renew

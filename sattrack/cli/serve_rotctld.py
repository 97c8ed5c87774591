"""`sattrack serve rotctld`: the mount as a rotator for programs that speak Hamlib's rotctld protocol."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import click

from sattrack import __version__
from sattrack.cli.common import CommandContext, JsonLines, common_options, mount_option, profile_option
from sattrack.cli.serving import (
    Log,
    caller_limits,
    caller_options,
    end_of_service,
    reached_from_outside,
    what_is_served,
)
from sattrack.runtime.callers import listen
from sattrack.runtime.connection import connected
from sattrack.runtime.system import StopRequest, stopping
from sattrack.servers.antenna.log_lines import spoken
from sattrack.servers.antenna.sky import Sky
from sattrack.servers.rotctld.door import RotctldServer
from sattrack.servers.rotctld.rotator import RotatorStation
from sattrack.servers.rotctld.serve import PROGRAM, RotctldLoop, client_maker

MOST_CLIENTS = 500
BACKLOG = 128


@click.command("rotctld")
@mount_option
@profile_option
@caller_options(4533, idle_s=3600.0, requests_per_s=1000.0)
@click.option(
    "--one-commander",
    is_flag=True,
    help="While one client commands, refuse the others, until it hangs up, is silent for 10 s, or S is sent.",
)
@common_options
def command(context: CommandContext, **options: Any) -> int:
    """Serve Hamlib's rotctld protocol on TCP, until interrupted: for gpredict, rotctl and their like.

    The mount is a rotator of azimuth and elevation; successive positions are followed smoothly.
    docs/rotctld.md tells what each command does.
    """
    limits = caller_limits(options, MOST_CLIENTS)
    served = what_is_served(context, options["mount_url"], options["profile"], "rotctld's clients live")
    stop, log = StopRequest(), Log(served.clock)
    with ExitStack() as closing:
        closing.callback(log.close)
        station = RotatorStation(
            Sky(served.site),
            served.described.mount,
            context.settings.safety.limits(),
            options["one_commander"],
        )
        listener = listen(options["host"], options["port"], BACKLOG)
        info = f"sattrack {__version__}: {served.described.mount.name}"
        # One list for both, so that the log tells things in the order in which they happened.
        words = station.rotator.words
        door = RotctldServer(listener, limits, client_maker(station.rotator, info), words=words)
        closing.callback(door.close)
        connection = closing.enter_context(
            connected(served.address, served.described, served.site, served.clock)
        )
        closing.enter_context(stopping(stop))
        if context.json:
            JsonLines().write({"listening": door.port, "host": options["host"]})
        where = f"{options['host']}:{door.port}"
        log.tell(spoken(f"rotctld is on {where}; Ctrl-C stops the mount and ends it", PROGRAM))
        warning = reached_from_outside(PROGRAM, options["host"], door.port, limits.allowed)
        if warning is not None:
            log.tell(spoken(warning, PROGRAM))
        RotctldLoop(connection, stop, station, door, log.tell).run()
    return end_of_service(station.mount_stopped, stop)

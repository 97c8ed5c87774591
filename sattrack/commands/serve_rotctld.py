"""`sattrack serve rotctld`: the mount as a rotator for programs that speak Hamlib's rotctld protocol."""

from __future__ import annotations

import ipaddress
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import click

from sattrack import __version__, practice
from sattrack.antenna.log_lines import spoken
from sattrack.antenna.sky import Sky
from sattrack.commands.common import CommandContext, common_options, profile_option
from sattrack.commands.json_lines import JsonLines
from sattrack.commands.serve_log import Log
from sattrack.errors import BadInputError, InterruptedRunError, SattrackError
from sattrack.rotctld.station import RotatorStation
from sattrack.runtime.antenna_door import listen
from sattrack.runtime.console import connected
from sattrack.runtime.mounts import mount_address
from sattrack.runtime.rotctld_door import DoorLimits, RotctldDoor
from sattrack.runtime.rotctld_serve import PROGRAM, RotctldLoop, client_maker
from sattrack.runtime.signals import StopRequest, stopping

if TYPE_CHECKING:
    from collections.abc import Sequence

DEFAULT_PORT = 4533
MOST_CLIENTS = 500
BACKLOG = 128


@click.command("rotctld")
@click.option("--mount", "mount_url", metavar="URL", help="sim, or xerxes://HOST:PORT?listen=PORT.")
@profile_option
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. The protocol has no authentication: whoever reaches it moves the mount.",
)
@click.option("--port", default=DEFAULT_PORT, show_default=True, help="TCP port; 0 takes a free one.")
@click.option(
    "--allow",
    multiple=True,
    metavar="ADDRESS",
    help="Serve this address or network alone, as 192.0.2.7 or 192.0.2.0/24; may be repeated.",
)
@click.option(
    "--one-commander",
    is_flag=True,
    help="While one client commands, refuse the others, until it hangs up, is silent for 10 s, or S is sent.",
)
@click.option("--clients", default=256, show_default=True, help="How many clients at once.")
@click.option(
    "--idle", default=3600.0, show_default=True, help="Seconds of silence after which a client is hung up on."
)
@click.option(
    "--requests", default=1000.0, show_default=True, help="Requests a second of one client; the rest waits."
)
@common_options
def command(context: CommandContext, **options: Any) -> int:
    """Serve Hamlib's rotctld protocol on TCP, until interrupted: for gpredict, rotctl and their like.

    The mount is a rotator of azimuth and elevation; successive positions are followed smoothly.
    docs/rotctld.md tells what each command does.
    """
    address = mount_address(options["mount_url"] or context.settings.mount.url)
    if address is not None and context.clock_option is not None:
        raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
    limits = _limits(options)
    described = context.profile(options["profile"])
    practising = address is None and not context.has_site()
    site = practice.SITE.place() if practising else context.site()
    clock = context.clock()
    if clock.speed != 1.0:
        raise BadInputError("--clock: rotctld's clients live in real time; leave its speed out")
    stop, log = StopRequest(), Log(clock)
    with ExitStack() as closing:
        closing.callback(log.close)
        station = RotatorStation(
            Sky(site), described.mount, context.settings.safety.limits(), options["one_commander"]
        )
        listener = listen(options["host"], options["port"], BACKLOG)
        info = f"sattrack {__version__}: {described.mount.name}"
        # One list for both, so that the log tells things in the order in which they happened.
        words = station.rotator.words
        door = RotctldDoor(listener, limits, client_maker(station.rotator, info), words=words)
        closing.callback(door.close)
        connection = closing.enter_context(connected(address, described, site, clock))
        closing.enter_context(stopping(stop))
        if context.json:
            JsonLines().write({"listening": door.port, "host": options["host"]})
        where = f"{options['host']}:{door.port}"
        log.tell(spoken(f"rotctld is on {where}; Ctrl-C stops the mount and ends it", PROGRAM))
        if not _is_loopback(options["host"]):
            log.tell(spoken(f"WARNING: {_warning(where, limits)}", PROGRAM))
        RotctldLoop(station, connection, door, stop, log.tell).run()
    if station.mount_stopped is False:
        raise SattrackError("THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand")
    if stop.asked:
        ended = "the mount is stopped" if station.mount_stopped else "nothing was asked of the mount"
        raise InterruptedRunError(f"interrupted; {ended}")
    return 0


def _limits(options: dict[str, Any]) -> DoorLimits:
    """Return what callers may take. Raises BadInputError."""
    if not 0 <= options["port"] <= 65535:
        raise BadInputError(f"--port {options['port']}: ports run to 65535; 0 takes a free one")
    if not 1 <= options["clients"] <= MOST_CLIENTS:
        raise BadInputError(f"--clients {options['clients']}: from 1 to {MOST_CLIENTS}")
    for name in ("idle", "requests"):
        if not options[name] >= 1.0:
            raise BadInputError(f"--{name} {options[name]:g}: 1 or more")
    return DoorLimits(options["clients"], options["idle"], options["requests"], _allowed(options["allow"]))


def _allowed(
    given: Sequence[str],
) -> tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...] | None:
    networks = []
    for text in given:
        try:
            networks.append(ipaddress.ip_network(text))
        except ValueError as error:
            raise BadInputError(f"--allow {text}: {error}; write 192.0.2.7 or 192.0.2.0/24") from error
    return tuple(networks) or None


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _warning(where: str, limits: DoorLimits) -> str:
    words = f"rotctld has no authentication: whoever reaches {where} moves the mount"
    if limits.allowed is None:
        return words + "; --allow ADDRESS names those who may"
    return words + f", if its address is {', '.join(str(one) for one in limits.allowed)}"

"""What every `sattrack serve` that moves the mount shares, and `sattrack serve rotctld`."""

from __future__ import annotations

import ipaddress
import queue
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click

from sattrack import __version__
from sattrack.cli.common import CommandContext, common_options, mount_option, profile_option
from sattrack.cli.output import JsonLines, say
from sattrack.core.errors import BadInputError, InterruptedRunError, SattrackError
from sattrack.core.local_time import stamped
from sattrack.runtime import demo_pass
from sattrack.runtime.callers import CallerLimits, listen
from sattrack.runtime.connection import connected
from sattrack.runtime.system import StopRequest, stopping
from sattrack.servers.antenna.protocol import log_stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sattrack.core.clock import Clock
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.callers import Networks
    from sattrack.runtime.mounts import MountAddress
    from tle.site import Site


Command = TypeVar("Command", bound="Callable[..., Any]")
LAST_LINES_WITHIN_S = 1.0
LONGEST_IDLE_S, MOST_REQUESTS = 86_400.0, 1e6


@dataclass(frozen=True, slots=True)
class Served:
    """The mount that a server leads to, where it stands, and the clock; no `address`: a simulated one."""

    address: MountAddress | None
    described: ProfileFile
    site: Site
    clock: Clock


def what_is_served(
    context: CommandContext, mount_url: str | None, profile: Path | None, lives_in_real_time: str
) -> Served:
    """Return what the options and the settings say of the mount behind a server.

    `lives_in_real_time` names who does. A simulated mount without a site stands at the practice site. Raises
    BadInputError.
    """
    url, address = context.mount(mount_url)
    described = context.profile(profile, url)
    practising = address is None and not context.has_site()
    site = demo_pass.SITE.place() if practising else context.site()
    clock = context.clock()
    if described.pointing is not None:
        from sattrack.runtime.facts import pointing_of

        pointing_of(described.mount, site)
    if clock.speed != 1.0:
        raise BadInputError(f"--clock: {lives_in_real_time} in real time; give no speed")
    return Served(address if address is None else address.seen_from(site), described, site, clock)


def end_of_service(mount_stopped: bool | None, stop: StopRequest) -> int:
    """Return the exit code of a service that has ended.

    Raises SattrackError where the mount did not confirm the stop, InterruptedRunError where it was
    interrupted.
    """
    if mount_stopped is False:
        raise SattrackError("THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand")
    if stop.asked:
        ended = "the mount is stopped" if mount_stopped else "nothing was asked of the mount"
        raise InterruptedRunError(f"interrupted; {ended}")
    return 0


def caller_options(port: int, idle_s: float, requests_per_s: float) -> Callable[[Command], Command]:
    """Add the options of a server on TCP without authentication; the defaults are its own."""
    options = (
        click.option(
            "--host",
            default="127.0.0.1",
            show_default=True,
            help="Address to listen on. No authentication: anyone who reaches it can move the mount.",
        ),
        click.option("--port", default=port, show_default=True, help="TCP port; 0 takes a free one."),
        click.option(
            "--allow",
            multiple=True,
            metavar="ADDRESS",
            help="Serve only this address or network, as 192.0.2.7 or 192.0.2.0/24; may be repeated.",
        ),
        click.option("--clients", default=256, show_default=True, help="Clients at once, at most."),
        click.option(
            "--idle",
            default=idle_s,
            show_default=True,
            help="Disconnect a client after this many seconds of silence.",
        ),
        click.option(
            "--requests",
            default=requests_per_s,
            show_default=True,
            help="Requests per second from one client; more must wait.",
        ),
    )

    def add(function: Command) -> Command:
        for option in reversed(options):
            function = option(function)
        return function

    return add


def check_idle(idle_s: float) -> None:
    """Raise BadInputError for a time that nobody may be silent for."""
    if not 1.0 <= idle_s <= LONGEST_IDLE_S:
        raise BadInputError(f"--idle {idle_s:g}: 1 or more, {LONGEST_IDLE_S:g} at most")


def only_with_serial(*names: str) -> None:
    """Raise BadInputError where one of these options was given, and no serial line."""
    context = click.get_current_context()
    for name in names:
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            raise BadInputError(f"--{name} needs --serial DEVICE")


def caller_limits(options: dict[str, Any], most_clients: int) -> CallerLimits:
    """Return what `caller_options` let callers take. Raises BadInputError."""
    check_port(options["port"])
    if not 1 <= options["clients"] <= most_clients:
        raise BadInputError(f"--clients {options['clients']}: give 1 to {most_clients}")
    check_idle(options["idle"])
    if not 1.0 <= options["requests"] <= MOST_REQUESTS:
        raise BadInputError(f"--requests {options['requests']:g}: 1 or more, {MOST_REQUESTS:g} at most")
    allowed = _networks(options["allow"])
    return CallerLimits(options["clients"], options["idle"], options["requests"], allowed)


def check_port(port: int, given: str = "--port") -> None:
    """Raise BadInputError for a number that is no port; `given` is what it was given as."""
    if not 0 <= port <= 65535:
        raise BadInputError(f"{given} {port}: ports run to 65535; 0 takes a free one")


def _networks(given: Sequence[str]) -> Networks | None:
    """Return the addresses and networks of `--allow`; None lets everybody in. Raises BadInputError."""
    networks = []
    for text in given:
        try:
            networks.append(ipaddress.ip_network(text))
        except ValueError as error:
            raise BadInputError(f"--allow {text}: {error}; write 192.0.2.7 or 192.0.2.0/24") from error
    return tuple(networks) or None


def reached_from_outside(program: str, host: str, port: int, allowed: Networks | None) -> str | None:
    """Return the warning that a server without authentication is open to others; None on loopback."""
    if _is_loopback(host):
        return None
    text = f"WARNING: {program} has no authentication: whoever reaches {host}:{port} moves the mount"
    if allowed is None:
        return text + "; --allow ADDRESS names those who may"
    return text + f", if its address is {', '.join(str(one) for one in allowed)}"


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Log:
    """Lines on standard error, each with its instant; of no `program` in the Field System's style.

    They are written by a thread of their own: a terminal that is held holds nothing else up.
    """

    def __init__(self, clock: Clock, program: str | None = None) -> None:
        self._clock, self._program = clock, program
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def tell(self, text: str) -> None:
        """Log one line, without waiting."""
        utc_s, program = self._clock.utc_s(time.monotonic()), self._program
        self._lines.put(log_stamp(utc_s) + text if program is None else stamped(utc_s, program, text))

    def close(self) -> None:
        """Write the last lines, if that does not take long."""
        self._lines.put(None)
        self._thread.join(LAST_LINES_WITHIN_S)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            say(line, err=True)


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
@common_options("site", "clock", "json")
def rotctld(context: CommandContext, **options: Any) -> int:
    """Serve Hamlib's rotctld protocol on TCP, until interrupted: for gpredict, rotctl and similar clients.

    The mount is a rotator of azimuth and elevation; successive positions are followed smoothly.
    docs/rotctld.md describes each command.

    \b
    Examples:
      sattrack serve rotctld --mount sim
    """
    from sattrack.servers.antenna.trajectory import SiteSky
    from sattrack.servers.rotctld.rotator import RotatorStation
    from sattrack.servers.rotctld.serve import PROGRAM, RotctldLoop, RotctldServer

    limits = caller_limits(options, MOST_CLIENTS)
    served = what_is_served(context, options["mount_url"], options["profile"], "rotctld's clients live")
    stop, log = StopRequest(), Log(served.clock, PROGRAM)
    # What closes is closed whatever signals come: the outcome of the stop is told after that.
    with ExitStack() as signals, ExitStack() as closing:
        closing.callback(log.close)
        station = RotatorStation(
            SiteSky(served.site),
            served.described.mount,
            context.settings.safety.limits(),
            options["one_commander"],
        )
        listener = listen(options["host"], options["port"], BACKLOG)
        info = f"sattrack {__version__}: {served.described.mount.name}"
        server = RotctldServer(listener, limits, station.rotator, info)
        closing.callback(server.close)
        connection = closing.enter_context(
            connected(served.address, served.described, served.site, served.clock)
        )
        signals.enter_context(stopping(stop))
        if context.json:
            JsonLines().write({"listening": server.port, "host": options["host"]})
        where = f"{options['host']}:{server.port}"
        log.tell(f"rotctld is on {where}; Ctrl-C stops the mount and ends it")
        warning = reached_from_outside(PROGRAM, options["host"], server.port, limits.allowed)
        if warning is not None:
            log.tell(warning)
        RotctldLoop(connection, stop, station, server, log.tell).run()
    return end_of_service(station.mount_stopped, stop)

"""`sattrack serve antenna`: the mount as an antenna that a VLBI Field System can drive."""

from __future__ import annotations

import os
import select
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import (
    CommandContext,
    common_options,
    mount_option,
    profile_option,
    refraction_option,
)
from sattrack.cli.output import JsonLines
from sattrack.cli.screen import appearance, refuse_screen, screen_options, tui_possible
from sattrack.cli.serve import (
    Log,
    check_idle,
    check_port,
    end_of_service,
    only_with_serial,
    what_is_served,
)
from sattrack.core.errors import BadInputError
from sattrack.core.process import self_command
from sattrack.runtime.callers import CallerLimits, listen
from sattrack.runtime.connection import connected
from sattrack.runtime.system import StopRequest, stopping
from sattrack.servers.antenna.alpaca_focuser import FORM, parse_focuser, start_focusers
from sattrack.servers.antenna.controller import AntennaStation
from sattrack.servers.antenna.equipment import Antenna, Focuser, SimulatedFocusAxis
from sattrack.servers.antenna.led_mount import DEC_LIMIT_DEG, axis_range, park_direction
from sattrack.servers.antenna.protocol import Checksum, program_line, to_ns
from sattrack.servers.antenna.serve import (
    BAUDS,
    DEFAULT_FRAMING,
    LEAVE,
    AntennaLoop,
    AntennaServer,
    SerialChannel,
)
from sattrack.servers.antenna.trajectory import SiteSky

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.mount.model import MountProfile
    from sattrack.servers.antenna.alpaca_focuser import FocuserConfig
    from sattrack.servers.antenna.trajectory import AxisKind
    from tle.site import Site

DEFAULT_PORT = 7621
READ_BYTES = 4096
MOST_FOCUS_AXES = 3


@click.command("antenna")
@mount_option
@profile_option
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=DEFAULT_PORT, show_default=True, help="TCP port; 0 takes a free one.")
@click.option(
    "--idle",
    default=60.0,
    show_default=True,
    help="Seconds of silence after which antcn makes room for a caller from another address.",
)
@click.option("--serial", "device", metavar="DEVICE", help="Serve a serial line instead, as /dev/ttyUSB0.")
@click.option(
    "--baud",
    type=click.Choice([str(b) for b in BAUDS]),
    default="9600",
    show_default=True,
    help="Baud, with --serial.",
)
@click.option(
    "--framing", default=DEFAULT_FRAMING, show_default=True, help="Bits, parity, stop bits, with --serial."
)
@click.option("--crc", is_flag=True, help="Use CRC-16 (CCITT) in four digits instead of the sum in two.")
@click.option(
    "--axes",
    type=click.Choice(["hadec", "azel"]),
    default="hadec",
    show_default=True,
    help="What positions are: hour angle and declination, the mount's own axes, or azimuth and elevation.",
)
@click.option("--local", is_flag=True, help="Start in local: information only.")
@click.option("--stow", metavar="FIRST,SECOND", help="Stow position; default: the profile's park.")
@click.option("--service", metavar="FIRST,SECOND", help="Service position.")
@click.option(
    "--focus",
    "focus",
    multiple=True,
    metavar="N|URL",
    help=f"Axes of a simulated focuser, 1 to 3; or {FORM}, once for each axis.",
)
@refraction_option("For satellites by elements. What is sent as positions is taken as it is.")
@click.option("--console", is_flag=True, help="The controller's console, full screen.")
@click.option("--stream", is_flag=True, help="Write views as JSON lines to standard output, four a second.")
@click.option(
    "--control", is_flag=True, help="The end of standard input stops the mount and ends the service."
)
@screen_options
@common_options("site", "clock", "json")
def command(context: CommandContext, **options: Any) -> int:
    """Serve the Field System's antenna interface, on TCP or on a serial line, until interrupted.

    On standard input: local, remote, stop, reset, last (the last lines), leave; docs/antenna-interface.md
    tells the commands.

    \b
    Examples:
      sattrack serve antenna --mount sim
      sattrack serve antenna --serial /dev/ttyUSB0 --baud 9600
    """
    if options["console"]:
        return _with_console(context, options)
    if options["stream"] and sys.stdout.isatty():
        # A terminal that is held would hold up the loop that feeds the mount.
        raise BadInputError("--stream is for programs, not for a terminal; omit it, or pipe the output")
    served = what_is_served(context, options["mount_url"], options["profile"], "antcn lives")
    profile, clock = served.described.mount, served.clock
    simulated, configs = _focusers(options["focus"])
    server, where = _server(options)
    stop, log = StopRequest(), Log(clock)
    lines = JsonLines() if context.json or options["stream"] else None
    # What closes is closed whatever signals come: the outcome of the stop is told after that.
    with ExitStack() as signals, ExitStack() as closing:
        closing.callback(log.close)
        closing.callback(server.close)
        focus = start_focusers(configs) if configs else None
        if focus is not None:
            closing.callback(focus.close)
        antenna = _antenna(options, profile, served.site, simulated if focus is None else focus.focuser)
        station = AntennaStation(antenna, profile, context.settings.safety.limits())
        station.controller.switch(not options["local"], to_ns(clock.utc_s(time.monotonic())))
        connection = closing.enter_context(connected(served.address, served.described, served.site, clock))
        signals.enter_context(stopping(stop))
        if lines is not None and context.json:
            lines.write({"listening": server.port, "serial": options["device"]})
        log.tell(program_line(f"the antenna interface is on {where}; Ctrl-C stops the mount and ends it"))
        show = lines.write if lines is not None and options["stream"] else None
        text = Words(options["control"]).typed
        AntennaLoop(connection, stop, station, server, log.tell, text, where, show, focus).run()
    return end_of_service(station.mount_stopped, stop)


def _antenna(options: dict[str, Any], profile: MountProfile, site: Site, focuser: Focuser | None) -> Antenna:
    """Return the antenna that the options describe. Raises BadInputError."""
    axes: AxisKind = options["axes"]
    return Antenna(
        SiteSky(site),
        axes,
        axis_range(profile, axes),
        stow=_place("--stow", options["stow"], axes) or _park(profile, axes),
        service=_place("--service", options["service"], axes),
        focuser=focuser,
        refraction=options["refraction"],
        check=Checksum.CRC16 if options["crc"] else Checksum.SUM,
    )


def _focusers(given: Sequence[str]) -> tuple[Focuser | None, list[FocuserConfig]]:
    """Return the simulated focuser, or the addresses of real ones. Raises BadInputError."""
    if len(given) == 1 and given[0].isdecimal():
        if not 0 <= int(given[0]) <= MOST_FOCUS_AXES:
            raise BadInputError(f"--focus {given[0]}: a focuser has up to {MOST_FOCUS_AXES} axes")
        axes = [SimulatedFocusAxis() for _ in range(int(given[0]))]
        return Focuser(axes) if axes else None, []
    if len(given) > MOST_FOCUS_AXES:
        raise BadInputError(f"--focus: there are up to {MOST_FOCUS_AXES} axes, and {len(given)} were given")
    return None, [parse_focuser(one) for one in given]


def _with_console(context: CommandContext, options: dict[str, Any]) -> int:
    """Run this very command line in a process of its own, and its console here on top of it."""
    if options["stream"] or options["control"]:
        raise BadInputError("--console is for people, --stream and --control are for programs: give either")
    if not tui_possible():
        refuse_screen("--console")
    from sattrack.tui.launch import serve_with_console

    arguments = [one for one in sys.argv[1:] if one != "--console"]
    look = appearance(context, options["theme"], options["plain"])
    return serve_with_console([*self_command(), *arguments, "--stream", "--control"], look)


def _server(options: dict[str, Any]) -> tuple[AntennaServer, str]:
    device = options["device"]
    if device is not None:

        def reopen() -> SerialChannel:
            return SerialChannel(device, int(options["baud"]), options["framing"])

        return AntennaServer(
            channel=reopen(), reopen=reopen
        ), f"{device}, {options['baud']} baud, {options['framing']}"
    only_with_serial("baud", "framing")
    check_port(options["port"])
    check_idle(options["idle"])
    limits = CallerLimits(callers=1, elsewhere_s=options["idle"])
    server = AntennaServer(listen(options["host"], options["port"]), limits=limits)
    return server, f"{options['host']}:{server.port}"


def _place(option: str, text: str | None, axes: str) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise BadInputError(f"{option} {text!r}: write two positions, degrees, as -45,10") from error
    most = 90.0 if axes == "azel" else DEC_LIMIT_DEG
    if not (abs(first) <= 360.0 and abs(second) <= most):
        raise BadInputError(f"{option} {text}: the first goes to 360 degrees, the second to {most:g}")
    return first, second


def _park(profile: MountProfile, axes: str) -> tuple[float, float] | None:
    """Return the direction of the profile's park position, which a geometry has as angles of its own axes."""
    park = park_direction(profile)
    return None if park is None or axes == "azel" else (park.hour_angle_deg, park.dec_deg)


class Words:
    """What is typed on standard input, a word a line, without ever waiting for it.

    With `leave_at_end`, its end is the word to leave; else it ends nothing: a service may have none.
    """

    def __init__(self, leave_at_end: bool = False) -> None:
        self._leave_at_end = leave_at_end
        self._rest = b""
        self._open = sys.stdin is not None and not sys.stdin.closed

    def typed(self) -> Sequence[str]:
        """Return the words of the lines that are complete now."""
        try:
            if not self._open or not select.select([sys.stdin], [], [], 0.0)[0]:
                return ()
            data = os.read(sys.stdin.fileno(), READ_BYTES)
        except (OSError, ValueError):
            data = b""
        self._open = bool(data)
        if not data:
            return (LEAVE,) if self._leave_at_end else ()
        *lines, self._rest = (self._rest + data)[-READ_BYTES:].split(b"\n")
        return [line.decode("ascii", "replace").strip().lower() for line in lines]

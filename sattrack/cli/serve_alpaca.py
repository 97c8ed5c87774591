"""`sattrack serve alpaca`, `lx200` and `stellarium`: the mount as a telescope for other programs."""

from __future__ import annotations

import os
import platform
import socket
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import click
import msgspec

from sattrack import __version__
from sattrack.cli.common import (
    CommandContext,
    common_options,
    mount_option,
    profile_option,
    refraction_option,
)
from sattrack.cli.output import JsonLines, tell
from sattrack.cli.serve import (
    Log,
    Served,
    caller_limits,
    caller_options,
    check_port,
    end_of_service,
    only_with_serial,
    reached_from_outside,
    what_is_served,
)
from sattrack.core.channel import Channel, see_off, start_process
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import BadInputError, InterruptedRunError, SattrackError
from sattrack.mount.alpaca.link import GatewayLink
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.profiles import profile_file
from sattrack.mount.requests import FineRate, Park
from sattrack.runtime import demo_pass
from sattrack.runtime.callers import listen
from sattrack.runtime.connection import connected
from sattrack.runtime.facts import check_site
from sattrack.runtime.system import StopRequest, stopping
from sattrack.runtime.view_server import SUPPORTED
from sattrack.servers.alpaca.run_station import RunServersTask
from sattrack.servers.alpaca.serve import (
    SERIAL_FRAMING,
    AlpacaLoop,
    AlpacaTask,
    ClockNumbers,
    Satellites,
    SerialEnd,
    discovery_sockets,
    engine_maker,
    start_http_process,
)
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.alpaca.telescope import Abilities
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.serve import RotctldServer
from sattrack.settings import SiteSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sattrack.cli.serve import Command
    from sattrack.mount.alpaca.device import DeviceFacts, RateSpan
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.callers import CallerLimits
    from sattrack.runtime.connection import Connection
    from sattrack.runtime.facts import Prepared
    from sattrack.runtime.mounts import MountAddress
    from sattrack.servers.alpaca.telescope import Spans
    from sattrack.servers.antenna.serve import SerialChannel
    from tle.elements import Elements

MOST_CLIENTS = 1000
BACKLOG = 256
CALLERS = {"clients": 256, "idle": 300.0, "requests": 1000.0}
"""What clients of a run are allowed."""
END_WITHIN_S = 5.0


ALPACA, INDI, LX200, ROTCTLD, STELLARIUM = "alpaca", "indi", "lx200", "rotctld", "stellarium"
PORTS = {ALPACA: 11111, INDI: 7624, LX200: 4030, ROTCTLD: 4533, STELLARIUM: 10001}
NAMES = {
    ALPACA: "Alpaca",
    INDI: "INDI",
    LX200: "LX200",
    ROTCTLD: "rotctld",
    STELLARIUM: "Stellarium's own protocol",
}


def also(*protocols: str) -> Callable[[Command], Command]:
    """Add the other protocols that one telescope may be served by at the same time."""
    metavar = " ".join(f"[{one}[:PORT]]" for one in protocols)
    return click.argument("others", nargs=-1, metavar=metavar)


@click.command(ALPACA)
@also(INDI, LX200, ROTCTLD, STELLARIUM)
@mount_option
@profile_option
@caller_options(PORTS[ALPACA], idle_s=300.0, requests_per_s=2000.0)
@click.option(
    "--discovery/--no-discovery", default=True, show_default=True, help="Answer discovery on UDP port 32227."
)
@refraction_option("For satellites: raise directions by the air's refraction; auto where the mount does not.")
@click.option(
    "--name",
    "names",
    multiple=True,
    help="Another host name that clients use for this computer; may be repeated.",
)
@common_options("site", "elements", "clock", "json")
def command(context: CommandContext, **options: Any) -> int:
    """Serve the mount as an ASCOM telescope (Alpaca, ITelescopeV4) over HTTP, until interrupted.

    docs/alpaca.md tells what each member does, and of the actions TrackSatellite, Bias and Passes. With indi,
    lx200, rotctld or stellarium, the same mount is served by those protocols too.

    \b
    Examples:
      sattrack serve alpaca --mount sim
      sattrack serve alpaca --host 0.0.0.0 --allow 192.0.2.0/24
      sattrack serve alpaca lx200 rotctld --mount sim
    """
    return serve_telescope(context, ALPACA, options)


@click.command(LX200)
@also(INDI, ROTCTLD, STELLARIUM)
@mount_option
@profile_option
@caller_options(PORTS[LX200], idle_s=300.0, requests_per_s=1000.0)
@click.option("--serial", "device", metavar="DEVICE", help="Serve a serial line too, as /dev/ttyUSB0.")
@click.option("--baud", default=9600, show_default=True, help="Baud of the serial line; 8N1.")
@common_options("site", "clock", "json")
def lx200(context: CommandContext, **options: Any) -> int:
    """Serve the mount as an LX200 telescope on TCP, until interrupted: for SkySafari, Stellarium, INDI.

    docs/planetarium.md lists the commands.

    \b
    Examples:
      sattrack serve lx200 --mount sim
      sattrack serve lx200 --host 0.0.0.0 --allow 192.0.2.0/24
      sattrack serve lx200 --serial /dev/ttyUSB0
    """
    return serve_telescope(context, LX200, options)


@click.command(INDI)
@also(LX200, ROTCTLD, STELLARIUM)
@mount_option
@profile_option
@caller_options(PORTS[INDI], idle_s=300.0, requests_per_s=1000.0)
@common_options("site", "clock", "json")
def indi(context: CommandContext, **options: Any) -> int:
    """Serve the mount as an INDI telescope on TCP, until interrupted: for KStars, PHD2 and an indiserver.

    docs/planetarium.md lists the properties.

    \b
    Examples:
      sattrack serve indi --mount sim
    """
    return serve_telescope(context, INDI, options)


@click.command(STELLARIUM)
@also(INDI, LX200, ROTCTLD)
@mount_option
@profile_option
@caller_options(PORTS[STELLARIUM], idle_s=300.0, requests_per_s=1000.0)
@common_options("site", "clock", "json")
def stellarium(context: CommandContext, **options: Any) -> int:
    """Serve the mount by Stellarium's own telescope protocol, until interrupted.

    In Stellarium: telescope control, "External software or a remote computer", port 10001, J2000.

    \b
    Examples:
      sattrack serve stellarium --mount sim
    """
    return serve_telescope(context, STELLARIUM, options)


class Ends(NamedTuple):
    """What clients reach: listening sockets by protocol, a serial line, sockets of discovery."""

    listeners: dict[str, socket.socket]
    serial: SerialChannel | None
    discovery: Sequence[socket.socket]
    no_discovery: str | None
    """Why discovery is not answered, although it was asked for."""

    @property
    def ports(self) -> dict[str, int]:
        """The TCP port of each protocol."""
        return {protocol: int(one.getsockname()[1]) for protocol, one in self.listeners.items()}


def serve_telescope(context: CommandContext, first: str, options: dict[str, Any]) -> int:
    """Serve one telescope by one protocol or several; return the exit code."""
    callers = caller_limits(options, MOST_CLIENTS)
    ports = _ports(first, options)
    served = what_is_served(
        context, options["mount_url"], options["profile"], "the clients of a telescope live"
    )
    check_site(served.described.mount, served.site)
    limits = context.settings.safety.limits()
    mount = "the simulated mount" if served.address is None else str(served.address)
    stop, log = StopRequest(), Log(served.clock, first)
    # What closes is closed whatever signals come: the outcome of the stop is told after that.
    with ExitStack() as signals, ExitStack() as closing:
        closing.callback(log.close)
        chosen_by = {first: "--port"} | {other: f"{other}:PORT" for other in ports if other != first}
        ends = _opened(ports, options, closing, chosen_by)
        connection = closing.enter_context(
            connected(served.address, served.described, served.site, served.clock)
        )
        described = without_places(within_its_rates(served.described, connection), served.address)
        served = replace(served, described=described)
        abilities = abilities_of(connection, served.address, described.mount)
        station = TelescopeStation(described.mount, limits, served.site, mount, engine_maker(limits))
        elements = _elements(context, served) if ALPACA in ends.listeners else []
        server = start_http_process(_task(context, served, options, ends, mount, abilities, elements))
        closing.callback(server.close)
        if ends.serial is not None:
            # An adapter that is plugged in again has its name back once nobody has the old one open.
            ends.serial.close()
        rotctld = None
        if ROTCTLD in ends.listeners:
            rotator, info = (
                station.share(SiteSky(served.site)),
                f"sattrack {__version__}: {described.mount.name}",
            )
            rotctld = RotctldServer(ends.listeners[ROTCTLD], callers, rotator, info)
            closing.callback(rotctld.close)
        signals.enter_context(stopping(stop))
        if context.json:
            ports = ends.ports
            JsonLines().write({"listening": ports[first], "host": options["host"], "ports": ports})
        for text in _announcements(ends, options, callers):
            log.tell(text)
        if (refused := refusals(connection, served.address)) is not None:
            tell(refused)
        AlpacaLoop(connection, stop, station, server, log.tell, rotctld).run()
    if stop.asked and station.had_orders and station.mount_stopped is None:
        raise InterruptedRunError("interrupted; the mount was not moving, and continues as it was")
    return end_of_service(station.mount_stopped, stop)


def run_ports(texts: Sequence[str]) -> dict[str, int]:
    """Return the ports by protocol of `--serve`. Raises BadInputError."""
    return _ports_of(texts, set(PORTS), "--serve")


@contextmanager
def run_servers(
    context: CommandContext, texts: Sequence[str], options: dict[str, Any], prepared: Prepared
) -> Iterator[None]:
    """Serve a run of this process to clients meanwhile, by protocols as `PROTOCOL` or `PROTOCOL:PORT`.

    Raises BadInputError, and SattrackError where a port is not available.
    """
    if not SUPPORTED:
        raise SattrackError("--serve: runs can be served on Linux only")
    if prepared.clock.speed != 1.0:
        raise BadInputError("--serve: clients live in real time; give --clock no speed")
    ports = run_ports(texts)
    first = next(iter(ports))
    callers = {"host": options["serve_host"], "allow": options["serve_allow"], "port": 0, **CALLERS}
    limits, facts, log = caller_limits(callers, MOST_CLIENTS), prepared.facts, Log(prepared.clock, first)
    served = Served(prepared.address, profile_file(facts.profile), facts.site.place(), prepared.clock)
    with ExitStack() as closing:
        closing.callback(log.close)
        chosen_by = {protocol: f"--serve {protocol}:PORT" for protocol in ports}
        ends = _opened(ports, {**callers, "discovery": ALPACA in ports}, closing, chosen_by)
        elements = [] if facts.elements is None else [facts.elements]
        telescope = _task(context, served, callers, ends, facts.mount_name, Abilities(), elements)
        rotctld = ends.listeners[ROTCTLD].fileno() if ROTCTLD in ports else None
        task = RunServersTask(os.getpid(), telescope, rotctld, first)
        ours, theirs = socket.socketpair()
        with theirs:
            numbers = (one.fileno() for one in (theirs, *ends.listeners.values(), *ends.discovery))
            process = start_process(
                "sattrack.servers.alpaca.run_process",
                str(theirs.fileno()),
                str(os.getpid()),
                f"clients of {', '.join(ports)}",
                inherits=tuple(numbers),
            )
        channel = Channel(ours.detach(), most_waiting=1 << 28)
        closing.callback(see_off, process, END_WITHIN_S)
        closing.callback(channel.close)
        # Nothing is waited for: the run's clock goes, and clients wait at ports that are open.
        channel.send(task.encode())
        for text in _announcements(ends, callers, limits, "clients see the run, and may stop it"):
            log.tell(text)
        yield


def _opened(
    ports: dict[str, int], options: dict[str, Any], closing: ExitStack, chosen_by: dict[str, str]
) -> Ends:
    """Open what clients reach; `chosen_by` has how each protocol's port is given. Raises SattrackError."""
    listeners = {
        protocol: closing.enter_context(listen(options["host"], port, BACKLOG, chosen_by[protocol]))
        for protocol, port in ports.items()
    }
    sockets, trouble = discovery_sockets(options["host"]) if options.get("discovery") else ((), None)
    for one in sockets:
        closing.callback(one.close)
    return Ends(listeners, _serial_line(options, closing), sockets, trouble)


def _announcements(
    ends: Ends,
    options: dict[str, Any],
    callers: CallerLimits,
    more: str = "Ctrl-C stops the mount and ends it",
) -> list[str]:
    """Return where clients find the telescope, with warnings."""
    host, texts = options["host"], []
    for protocol, port in ends.ports.items():
        texts.append(f"{NAMES[protocol]} is on {host}:{port}; {more}")
        warning = reached_from_outside(protocol, host, port, callers.allowed)
        texts += [] if warning is None else [warning]
    if ends.serial is not None:
        texts.append(f"{NAMES[LX200]} is on {options['device']} too")
    return texts if ends.no_discovery is None else [*texts, ends.no_discovery]


def _serial_line(options: dict[str, Any], closing: ExitStack) -> SerialChannel | None:
    """Return the serial line; None without one. Raises SattrackError."""
    if options.get("device") is None:
        only_with_serial("baud")
        return None
    from sattrack.servers.antenna.serve import SerialChannel

    line = SerialChannel(options["device"], options["baud"], SERIAL_FRAMING)
    closing.callback(line.close)
    return line


def _ports(first: str, options: dict[str, Any]) -> dict[str, int]:
    """Return the ports by protocol, of the first and of the others. Raises BadInputError."""
    known = {one for one in PORTS if one not in {ALPACA, first}}
    others = _ports_of(options["others"], known, f"serve {first}", "beside it")
    return {first: int(options["port"]), **others}


def _ports_of(texts: Sequence[str], known: set[str], who: str, how: str = "") -> dict[str, int]:
    """Return the ports by protocol of PROTOCOL or PROTOCOL:PORT, each once. Raises BadInputError."""
    ports: dict[str, int] = {}
    for text in texts:
        protocol, _, number = text.partition(":")
        if protocol not in known or protocol in ports:
            choice = " or ".join(sorted(known - set(ports)))
            raise BadInputError(f"{text}: {who} takes {choice or 'no more'} {how}".rstrip())
        if number and not number.isdecimal():
            raise BadInputError(f"{text}: write {protocol}, or {protocol}:PORT")
        ports[protocol] = int(number or PORTS[protocol])
        check_port(ports[protocol], f"{who} {protocol}, port")
    return ports


def _task(
    context: CommandContext,
    served: Served,
    options: dict[str, Any],
    ends: Ends,
    mount: str,
    abilities: Abilities,
    elements: list[Elements],
) -> AlpacaTask:
    """Return the task of the process that clients talk to."""
    clock, serial = served.clock, None
    if ends.serial is not None:
        serial = SerialEnd(ends.serial.fileno(), options["device"], options["baud"])
    numbers = {protocol: one.fileno() for protocol, one in ends.listeners.items()}
    return AlpacaTask(
        listener=numbers.get(ALPACA),
        lx200=numbers.get(LX200),
        indi=numbers.get(INDI),
        serial=serial,
        stellarium=numbers.get(STELLARIUM),
        discovery=tuple(one.fileno() for one in ends.discovery),
        port=ends.ports.get(ALPACA, 0),
        version=__version__,
        host=platform.node(),
        callers=options["clients"],
        idle_s=options["idle"],
        requests_per_s=options["requests"],
        allowed=tuple(options["allow"]) or None,
        names=options.get("names", ()),
        satellites=Satellites(
            elements=elements,
            site=SiteSettings(served.site.latitude_deg, served.site.longitude_deg, served.site.height_m),
            profile=served.described.mount,
            limits=context.settings.safety.limits(),
            min_alt_deg=context.settings.min_altitude_deg,
            refraction=options.get("refraction", "auto"),
            mount=mount,
        ),
        abilities=abilities,
        clock=ClockNumbers(clock.start_utc_s, clock.anchor_s, clock.speed)
        if isinstance(clock, SimulatedClock)
        else None,
    )


def _elements(context: CommandContext, served: Served) -> list[Elements]:
    """Return whose passes can be asked for: those set, for practice the practice satellite's, or none."""
    if context.sources():
        return context.elements()
    return [demo_pass.elements()] if served.address is None else []


def within_its_rates(described: ProfileFile, connection: Connection) -> ProfileFile:
    """Return a profile whose axes turn no faster than the mount says that it bears."""
    link = connection.link
    if not isinstance(link, GatewayLink):
        return described
    ra, dec = (
        msgspec.structs.replace(
            limits, max_rate_deg_s=min(limits.max_rate_deg_s, gain * link.facts.fastest_deg_s(axis))
        )
        for axis, (limits, gain) in enumerate(
            zip((described.ra, described.dec), _gains(described.mount), strict=True)
        )
    )
    return msgspec.structs.replace(described, ra=ra, dec=dec)


def without_places(described: ProfileFile, address: MountAddress | None) -> ProfileFile:
    """Return a profile without places to park and to be home where the mount is not sent there by us."""
    if address is None or address.not_carried(Park()) is None:
        return described
    return msgspec.structs.replace(described, park=None, home=None)


def abilities_of(connection: Connection, address: MountAddress | None, profile: MountProfile) -> Abilities:
    """Return what clients may ask of the mount at the other end of a connection."""
    link = connection.link
    led = profile.geometry is not None
    if address is None or not isinstance(link, GatewayLink):
        return Abilities(syncs=not led, guides=not led, fine_rates=not led)
    facts = link.facts
    ra_gain, dec_gain = _gains(profile)
    if led:
        rates = (
            _own_rates(facts.primary_rates, ra_gain, 0.0),
            _own_rates(facts.secondary_rates, dec_gain, 0.0),
        )
        return Abilities(
            syncs=False, guides=False, guide_rates=False, fine_rates=False, axis_rates_deg_s=rates
        )
    return Abilities(
        slews=facts.can_slew,
        syncs=facts.can_sync,
        guides=facts.can_pulse_guide,
        guide_rates=facts.guide_rates_deg_s is not None,
        # The gateway gives tracking back after each stop, as it was.
        sets_tracking=False,
        fine_rates=address.not_carried(FineRate()) is None,
        axis_rates_deg_s=(
            # What MoveAxis adds to, or replaces, is the sky's rate.
            _own_rates(facts.primary_rates, ra_gain, SIDEREAL_RATE_DEG_S if profile.additive else 0.0),
            _own_rates(facts.secondary_rates, dec_gain, 0.0),
        ),
    )


def refusals(connection: Connection, address: MountAddress | None) -> str | None:
    """Return in a line what clients are refused on this mount; None where they are refused nothing."""
    link = connection.link
    why_not = None if address is None else address.not_carried(Park())
    if why_not is None or not isinstance(link, GatewayLink):
        return None
    lacking = _lacking(link.facts)
    more = f", and this one has no {' or '.join(lacking)}" if lacking else ""
    return f"{why_not}{more}: clients are refused that"


def _lacking(facts: DeviceFacts) -> list[str]:
    can = {"slews": facts.can_slew, "sync": facts.can_sync, "guide pulses": facts.can_pulse_guide}
    return [what for what, there in can.items() if not there]


def _gains(profile: MountProfile) -> tuple[float, float]:
    return profile.ra_rate_gain, profile.dec_rate_gain


def _own_rates(borne: tuple[RateSpan, ...], gain: float, sky_deg_s: float) -> Spans:
    """Return an axis' own rates, in either direction, for the rates that it may have."""
    return tuple(
        (gain * span.low_deg_s + (sky_deg_s if span.low_deg_s else 0.0), gain * span.high_deg_s - sky_deg_s)
        for span in borne
    )

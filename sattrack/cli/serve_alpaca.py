"""`sattrack serve alpaca`: the mount as an ASCOM telescope for whatever speaks Alpaca."""

from __future__ import annotations

import platform
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack import __version__
from sattrack.cli.common import CommandContext, JsonLines, common_options, mount_option, profile_option, tell
from sattrack.cli.serve import (
    Log,
    caller_limits,
    caller_options,
    end_of_service,
    reached_from_outside,
    what_is_served,
)
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import InterruptedRunError
from sattrack.mount.alpaca.link import GatewayLink
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.requests import FineRate, Park
from sattrack.runtime import demo_pass
from sattrack.runtime.callers import listen
from sattrack.runtime.connection import connected
from sattrack.runtime.facts import check_site
from sattrack.runtime.system import StopRequest, stopping
from sattrack.servers.alpaca.serve import (
    PROGRAM,
    AlpacaLoop,
    AlpacaTask,
    ClockNumbers,
    Satellites,
    discovery_sockets,
    engine_maker,
    start_http_process,
)
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.alpaca.telescope import Abilities
from sattrack.servers.antenna.protocol import program_line
from sattrack.settings import SiteSettings

if TYPE_CHECKING:
    import socket

    from sattrack.cli.serve import Served
    from sattrack.mount.alpaca.device import DeviceFacts, RateSpan
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.connection import Connection
    from sattrack.runtime.mounts import MountAddress
    from sattrack.servers.alpaca.telescope import Spans
    from tle.elements import Elements

MOST_CLIENTS = 1000
BACKLOG = 256


@click.command("alpaca")
@mount_option
@profile_option
@caller_options(11111, idle_s=300.0, requests_per_s=2000.0)
@click.option(
    "--discovery/--no-discovery", default=True, show_default=True, help="Answer discovery on UDP port 32227."
)
@click.option(
    "--refraction",
    type=click.Choice(("auto", "on", "off")),
    default="auto",
    show_default=True,
    help="For satellites: raise directions by the air's refraction; auto where the mount does not.",
)
@click.option(
    "--name",
    "names",
    multiple=True,
    help="Another host name that clients use for this computer; may be repeated.",
)
@common_options("site", "elements", "clock", "json")
def command(context: CommandContext, **options: Any) -> int:
    """Serve the mount as an ASCOM telescope (Alpaca, ITelescopeV4) over HTTP, until interrupted.

    docs/alpaca.md tells what each member does, and of the actions TrackSatellite, Bias and Passes.

    \b
    Examples:
      sattrack serve alpaca --mount sim
      sattrack serve alpaca --host 0.0.0.0 --allow 192.0.2.0/24
    """
    callers = caller_limits(options, MOST_CLIENTS)
    served = what_is_served(context, options["mount_url"], options["profile"], "Alpaca's clients live")
    check_site(served.described.mount, served.site)
    limits = context.settings.safety.limits()
    mount = "the simulated mount" if served.address is None else str(served.address)
    stop, log = StopRequest(), Log(served.clock)
    with ExitStack() as closing:
        closing.callback(log.close)
        listener = closing.enter_context(listen(options["host"], options["port"], BACKLOG))
        port = int(listener.getsockname()[1])
        sockets, trouble = discovery_sockets(options["host"]) if options["discovery"] else ((), None)
        for one in sockets:
            closing.callback(one.close)
        connection = closing.enter_context(
            connected(served.address, served.described, served.site, served.clock)
        )
        described = without_places(within_its_rates(served.described, connection), served.address)
        served = replace(served, described=described)
        abilities = abilities_of(connection, served.address, described.mount)
        station = TelescopeStation(described.mount, limits, served.site, mount, engine_maker(limits))
        server = start_http_process(_task(context, served, options, (listener, *sockets), mount, abilities))
        closing.callback(server.close)
        closing.enter_context(stopping(stop))
        if context.json:
            JsonLines().write({"listening": port, "host": options["host"]})
        log.tell(
            program_line(
                f"Alpaca is on {options['host']}:{port}; Ctrl-C stops the mount and ends it", PROGRAM
            )
        )
        if (refused := refusals(connection, served.address)) is not None:
            tell(refused)
        for text in (trouble, reached_from_outside(PROGRAM, options["host"], port, callers.allowed)):
            if text is not None:
                log.tell(program_line(text, PROGRAM))
        AlpacaLoop(connection, stop, station, server, log.tell).run()
    if stop.asked and station.had_orders and station.mount_stopped is None:
        raise InterruptedRunError("interrupted; the mount was not moving, and continues as it was")
    return end_of_service(station.mount_stopped, stop)


def _task(
    context: CommandContext,
    served: Served,
    options: dict[str, Any],
    sockets: tuple[socket.socket, ...],
    mount: str,
    abilities: Abilities,
) -> AlpacaTask:
    """Return the task of the process that clients talk to; the first socket is the one for HTTP."""
    clock = served.clock
    listener, *discovery = sockets
    return AlpacaTask(
        listener=listener.fileno(),
        discovery=tuple(one.fileno() for one in discovery),
        port=int(listener.getsockname()[1]),
        version=__version__,
        host=platform.node(),
        callers=options["clients"],
        idle_s=options["idle"],
        requests_per_s=options["requests"],
        allowed=tuple(options["allow"]) or None,
        names=options["names"],
        satellites=Satellites(
            elements=_elements(context, served),
            site=SiteSettings(served.site.latitude_deg, served.site.longitude_deg, served.site.height_m),
            profile=served.described.mount,
            limits=context.settings.safety.limits(),
            min_alt_deg=context.settings.min_altitude_deg,
            refraction=options["refraction"],
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
    if address is None or not isinstance(link, GatewayLink):
        return Abilities()
    facts = link.facts
    ra_gain, dec_gain = _gains(profile)
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

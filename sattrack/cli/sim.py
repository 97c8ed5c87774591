"""`sattrack sim`: a simulated mount alone, on UDP, or with --alpaca an ASCOM telescope over HTTP."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.common import CommandContext, JsonLines, common_options
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.toml_text import read_toml
from sattrack.mount.alpaca.link import DEFAULT_PORT as ALPACA_PORT
from sattrack.mount.profiles import ProfileFile, load_profile_file
from sattrack.mount.simulator.installation import GRAMMAR, parse_faults, simulator_profile
from sattrack.mount.simulator.mount import SimulatedSite
from sattrack.mount.simulator.process import ClockSetting, SimulatorConfig, make_server
from sattrack.mount.xerxes.client import DEFAULT_PORT
from sattrack.runtime import demo_pass

if TYPE_CHECKING:
    from sattrack.mount.simulator.alpaca_telescope import TelescopeSettings
    from sattrack.mount.simulator.mount import Truth


FAULTS_HELP = "\n".join(
    (
        "Faults, separated by commas; those with = are for one way alone as in loss-status=3%:",
        *(f"{example:22}{meaning}" for example, meaning in GRAMMAR),
    )
)


@click.command("sim", epilog=f"\b\n{FAULTS_HELP}")
@click.option(
    "--port",
    type=int,
    help=f"UDP port for commands, {DEFAULT_PORT} by default (with --alpaca TCP, {ALPACA_PORT}); "
    "0 takes a free one.",
)
@click.option(
    "--peer", type=int, metavar="PORT", help="Port to send statuses to; default: where commands come from."
)
@click.option(
    "--profile",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The mount's profile; its table [simulator] has the settings of the simulation.",
)
@click.option("--faults", metavar="FAULT,...", help="What goes wrong, and when; see below.")
@click.option(
    "--alpaca", is_flag=True, help="Simulate an ASCOM Alpaca telescope instead, for --mount alpaca://…."
)
@click.option(
    "--telescope",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="With --alpaca: the telescope (TOML), as examples/alpaca_telescope.toml.",
)
@click.option("--seed", type=int, help="Random seed; default: the profile's.")
@common_options("site", "clock", "json")
def command(
    context: CommandContext,
    port: int | None,
    peer: int | None,
    profile: Path | None,
    faults: str | None,
    seed: int | None,
    alpaca: bool,
    telescope: Path | None,
) -> int:
    """Run the simulated mount alone, on UDP, until interrupted.

    With --json, one line a status: where the axes really are, in the frame that the mount reports.

    \b
    Examples:
      sattrack sim --profile edge.toml
      sattrack sim --faults loss=3%,silent@20s+3s
    """
    for number in (port, peer):
        if number is not None and not 0 <= number <= 65535:
            raise BadInputError(f"port {number}: ports run to 65535; 0 takes a free one")
    if alpaca:
        from sattrack.cli.sim import simulate

        if not (peer is None and profile is None and faults is None and seed is None):
            raise BadInputError("--alpaca takes --telescope FILE; omit the other options")
        return simulate(context, port, telescope)
    if telescope is not None:
        raise BadInputError(f"--telescope {telescope}: it needs --alpaca")
    where = context.site() if context.has_site() else None
    site = SimulatedSite(demo_pass.SITE.latitude_deg, demo_pass.SITE.longitude_deg, demo_pass.SITE.height_m)
    if where is not None:
        site = SimulatedSite(where.latitude_deg, where.longitude_deg, where.height_m)
    described = ProfileFile() if profile is None else load_profile_file(profile)
    hardware = simulator_profile(described.simulator, str(profile))
    if seed is not None:
        hardware = msgspec.structs.replace(hardware, seed=seed)
    parse_faults(hardware.faults, f"{profile}, simulator.faults:")
    config = SimulatorConfig(
        site=site,
        profile=described.mount,
        start=demo_pass.START,
        port=DEFAULT_PORT if port is None else port,
        peer_port=peer,
        clock=_setting(context),
        hardware=hardware,
        faults=None if faults is None else parse_faults(faults),
    )
    server = make_server(config)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _: ended.append(got))
    click.echo(f"simulated mount on 127.0.0.1:{server.port}; Ctrl-C ends it", err=True)
    tell = _silent
    if context.json:
        lines = JsonLines()
        lines.write({"listening": server.port})
        tell = partial(_tell, lines)
    try:
        server.run(lambda: not ended, tell, [])
    finally:
        server.close()
    return 130 if ended == [signal.SIGINT] else 0


def _setting(context: CommandContext) -> ClockSetting | None:
    clock = context.clock()
    if not isinstance(clock, SimulatedClock):
        return None
    return ClockSetting(clock.start_utc_s, clock.anchor_s, clock.speed)


def _silent(_: Truth) -> None:
    """Tell nobody."""


def _tell(lines: JsonLines, truth: Truth) -> None:
    lines.write(msgspec.structs.asdict(truth))


def simulate(context: CommandContext, port: int | None, telescope: Path | None) -> int:
    """Serve a simulated telescope until interrupted; return the exit code.

    It stands at the site of the options or the settings, else where the practice pass is seen. Raises
    BadInputError, naming file, line and key, SattrackError where the port is in use.
    """
    if context.clock_option is not None:
        raise BadInputError(
            "--clock does not go with --alpaca: what drives the telescope follows the real sky"
        )
    from sattrack.mount.simulator.alpaca_telescope import TelescopeSettings

    settings = TelescopeSettings()
    if telescope is not None:
        settings = read_toml(telescope, TelescopeSettings, "the simulated telescope")
    if telescope is None or context.has_site():
        site = context.site() if context.has_site() else demo_pass.SITE.place()
        settings = msgspec.structs.replace(
            settings,
            latitude_deg=site.latitude_deg,
            longitude_deg=site.longitude_deg,
            height_m=site.height_m,
        )
    port = ALPACA_PORT if port is None else port
    try:
        ended = asyncio.run(_until_signalled(settings, port, context.json))
    except OSError as error:
        raise SattrackError(f"TCP port {port} is not available: {error.strerror}") from error
    return 130 if ended == signal.SIGINT else 0


async def _until_signalled(settings: TelescopeSettings, port: int, as_json: bool) -> int:
    from sattrack.mount.simulator.alpaca_server import serve

    loop, stopped, ended = asyncio.get_running_loop(), asyncio.Event(), [0]

    def end(number: int) -> None:
        ended[0] = number
        stopped.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end, number)

    def ready(taken: int) -> None:
        url = f"alpaca://127.0.0.1:{taken}/0"
        click.echo(f"simulated telescope: --mount {url}; Ctrl-C ends it", err=True)
        if as_json:
            click.echo(msgspec.json.encode({"listening": taken, "mount": url}).decode())

    serving = asyncio.create_task(serve(settings, port, ready))
    waiting = asyncio.create_task(stopped.wait())
    await asyncio.wait({serving, waiting}, return_when=asyncio.FIRST_COMPLETED)
    if not stopped.is_set():
        # Nothing else ends the service: its error is the user's to see.
        await serving
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving
    return ended[0]

"""`sattrack sim`: a simulated mount on UDP, or with --alpaca over HTTP, and with --camera what it sees."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, load_simulator_profile
from sattrack.cli.output import JsonLines
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.toml_text import read_toml
from sattrack.mount.alpaca.link import DEFAULT_PORT as ALPACA_PORT
from sattrack.mount.profiles import ProfileFile, load_profile_file
from sattrack.mount.simulator.hidden import GRAMMAR as HIDDEN_GRAMMAR
from sattrack.mount.simulator.hidden import Hidden, SimulatedCamera, parse_hidden, split_delays_s
from sattrack.mount.simulator.installation import GRAMMAR, parse_faults
from sattrack.mount.simulator.mount import SimulatedSite
from sattrack.mount.simulator.process import ClockSetting, SimulatorConfig, make_clock, make_server
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.client import DEFAULT_PORT
from sattrack.runtime import demo_pass

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sattrack.core.channel import PipedProcess
    from sattrack.mount.simulator.alpaca_server import CameraConfig
    from sattrack.mount.simulator.alpaca_telescope import TelescopeSettings
    from sattrack.mount.simulator.mount import Truth
    from tle.elements import Elements

CAMERA_WITHIN_S = 30.0
CAMERA_ENDS_WITHIN_S = 5.0
DEFAULT_CAMERA = "2.5,1280,960"

WORDS = {
    "Faults, separated by commas; with = also for one way alone, as loss-status=3%": GRAMMAR,
    "Keys of --hidden, separated by commas, with their units": HIDDEN_GRAMMAR,
}
"""Of the values of options: what each word means."""


class SimCommand(click.Command):
    """A command whose help explains the words of its values."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the words below the options."""
        for title, grammar in WORDS.items():
            with formatter.section(title):
                formatter.write_dl(grammar)


@click.command("sim", cls=SimCommand)
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
@click.option(
    "--camera",
    metavar="[SCALE[,WIDTH,HEIGHT]]",
    is_flag=False,
    flag_value=DEFAULT_CAMERA,
    help="Serve a camera on the mount that sees stars and the satellite, as an Alpaca camera: arcseconds per "
    f"pixel and pixels, {DEFAULT_CAMERA} by default.",
)
@click.option("--camera-port", type=int, help="With --camera: its TCP port; a free one by default.")
@click.option(
    "--satellite",
    "satellites",
    multiple=True,
    metavar="SAT",
    help="With --camera: a satellite of --elements, which are its true orbit; may be repeated.",
)
@click.option(
    "--hidden",
    metavar="KEY=VALUE,...|FILE",
    help="With --camera: errors of elements, alignment and clocks, clouds, and the camera's own figures; "
    "see below. FILE is TOML.",
)
@click.option(
    "--frames",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="With --camera: take pictures all the time and write them there as FITS.",
)
@click.option("--exposure", default=0.1, show_default=True, metavar="S", help="Exposure of --frames.")
@click.option("--every", default=0.5, show_default=True, metavar="S", help="Interval of --frames.")
@common_options("site", "elements", "clock", "json")
def command(
    context: CommandContext,
    port: int | None,
    peer: int | None,
    profile: Path | None,
    faults: str | None,
    seed: int | None,
    alpaca: bool,
    telescope: Path | None,
    **camera_options: Any,
) -> int:
    """Run the simulated mount alone, on UDP, until interrupted.

    With --json, one line a status: where the axes really are, in the frame that the mount reports.

    \b
    Examples:
      sattrack sim --profile edge.toml
      sattrack sim --faults loss=3%,silent@20s+3s
      sattrack sim --camera --elements iss.tle --hidden along=1,rotation=12
    """
    for number in (port, peer):
        if number is not None and not 0 <= number <= 65535:
            raise BadInputError(f"port {number}: ports run to 65535; 0 takes a free one")
    pictured = CameraOptions.of(camera_options)
    if alpaca:
        if not (peer is None and profile is None and faults is None and seed is None):
            raise BadInputError("--alpaca takes --telescope FILE and --camera; omit the other options")
        return simulate(context, port, telescope, pictured)
    if telescope is not None:
        raise BadInputError(f"--telescope {telescope}: it needs --alpaca")
    where = context.site() if context.has_site() else None
    site = SimulatedSite(demo_pass.SITE.latitude_deg, demo_pass.SITE.longitude_deg, demo_pass.SITE.height_m)
    if where is not None:
        site = SimulatedSite(where.latitude_deg, where.longitude_deg, where.height_m)
    described = ProfileFile() if profile is None else load_profile_file(profile)
    hardware = SimulatorProfile() if profile is None else load_simulator_profile(profile)
    if seed is not None:
        hardware = msgspec.structs.replace(hardware, seed=seed)
    parse_faults(hardware.faults, f"{profile}, simulator.faults:")
    if pictured is not None and described.mount.geometry is not None:
        raise BadInputError(
            f"--camera: {profile} has a [geometry], and this camera turns with equatorial axes only; "
            "sim --alpaca --telescope FILE has one that turns with azimuth axes"
        )
    if pictured is not None and pictured.hidden.split:
        command_s, status_s = split_delays_s(pictured.hidden, described.mount)
        hardware = msgspec.structs.replace(hardware, command_delay_s=command_s, status_delay_s=status_s)
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
    listeners: list[Callable[[Truth], None]] = []
    with contextlib.ExitStack() as stack:
        stack.callback(server.close)
        first: dict[str, Any] = {"listening": server.port}
        if pictured is not None:
            process, url = _start_camera(pictured, context, config)
            stack.callback(process.close, CAMERA_ENDS_WITHIN_S)
            first["camera"] = url
            listeners.append(lambda truth: process.channel.send(msgspec.json.encode(truth) + b"\n"))
            click.echo(f"simulated camera: {url}", err=True)
        click.echo(f"simulated mount on 127.0.0.1:{server.port}; Ctrl-C ends it", err=True)
        if context.json:
            lines = JsonLines()
            lines.write(first)
            listeners.append(lambda truth: lines.write(msgspec.structs.asdict(truth)))

        def tell(truth: Truth) -> None:
            for listen in listeners:
                listen(truth)

        server.run(lambda: not ended, tell, [])
    return 130 if ended == [signal.SIGINT] else 0


def _setting(context: CommandContext) -> ClockSetting | None:
    clock = context.clock()
    if not isinstance(clock, SimulatedClock):
        return None
    return ClockSetting(clock.start_utc_s, clock.anchor_s, clock.speed)


class CameraOptions:
    """The options of `--camera`, checked. Raises BadInputError."""

    def __init__(
        self,
        camera: str,
        camera_port: int | None,
        satellites: tuple[str, ...],
        hidden: str | None,
        frames: Path | None,
        exposure: float,
        every: float,
    ) -> None:
        self.settings = SimulatedCamera.parse(camera)
        self.satellites, self.frames = satellites, frames
        self.exposure, self.every = exposure, every
        self.port = camera_port or 0
        if not 0 <= self.port <= 65535:
            raise BadInputError(f"--camera-port {self.port}: ports run to 65535; 0 takes a free one")
        if hidden is not None and "=" not in hidden:
            self.hidden = read_toml(Path(hidden), Hidden, "what is hidden")
        else:
            self.hidden = parse_hidden(hidden or "")
        for name, value in (("exposure", exposure), ("every", every)):
            if not 0.0001 <= value <= 600.0:
                raise BadInputError(f"--{name} {value:g}: it goes from 0.0001 to 600 s")
        if frames is not None and not frames.is_dir():
            raise BadInputError(f"--frames {frames}: there is no such folder")

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> CameraOptions | None:
        """Return the options, None without --camera. Raises BadInputError for an option that needs it."""
        if options["camera"] is not None:
            return cls(**options)
        for name in ("camera_port", "satellites", "hidden", "frames"):
            if options[name]:
                raise BadInputError(f"--{name.rstrip('s').replace('_', '-')}: it needs --camera")
        return None

    def config(
        self,
        context: CommandContext,
        site: SimulatedSite,
        seed: int,
        clock: ClockSetting | None = None,
        clock_offset_s: float = 0.0,
    ) -> CameraConfig:
        """Return how to make the camera of a mount that starts now."""
        from sattrack.mount.simulator.alpaca_server import CameraConfig
        from tle.sources import write_elements

        return CameraConfig(
            site,
            write_elements(self._true_orbits(context), "json"),
            self.settings,
            self.hidden,
            begin_utc_s=make_clock(clock).utc_s(time.monotonic()),
            clock_offset_s=clock_offset_s,
            seed=seed,
            clock=clock,
            port=self.port,
            frames=None if self.frames is None else str(self.frames),
            exposure_s=self.exposure,
            every_s=self.every,
        )

    def _true_orbits(self, context: CommandContext) -> list[Elements]:
        """Return the satellites in the sky; raises BadInputError where it is not clear which."""
        from tle.sources import find

        if not context.sources() and not self.satellites:
            return [demo_pass.elements()]
        known = context.elements(*self.satellites)
        if self.satellites:
            return [find(known, key) for key in self.satellites]
        if len(known) > 1:
            raise BadInputError(f"--elements hold {len(known)} satellites: choose with --satellite SAT")
        return known


def _start_camera(
    pictured: CameraOptions, context: CommandContext, mount: SimulatorConfig
) -> tuple[PipedProcess, str]:
    """Start the camera's process; return it and its URL. Raises SattrackError where it does not come up."""
    from sattrack.core.channel import PipedProcess
    from sattrack.mount.simulator.alpaca_server import CameraStarted

    offset_s = mount.hardware.clock_offset_s
    offset_s = (mount.profile.clock_offset_s or 0.0) if offset_s is None else offset_s
    config = pictured.config(context, mount.site, mount.hardware.seed, mount.clock, offset_s)
    argument = msgspec.json.encode(config).decode()
    process = PipedProcess.start("sattrack.mount.simulator.alpaca_server", argument)
    lines = process.channel.first(CAMERA_WITHIN_S)
    started = CameraStarted(error="it did not start")
    if lines:
        started = msgspec.json.decode(lines[0], type=CameraStarted)
    if not started.port:
        process.close(0.0)
        raise SattrackError(f"the simulated camera: {started.error}")
    return process, f"alpaca://127.0.0.1:{started.port}/0"


def simulate(
    context: CommandContext, port: int | None, telescope: Path | None, pictured: CameraOptions | None
) -> int:
    """Serve a simulated telescope, and its camera, until interrupted; return the exit code.

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
    config = None
    if pictured is not None:
        if pictured.port or pictured.hidden.split:
            raise BadInputError("--camera-port and the hidden split do not go with --alpaca")
        where = SimulatedSite(settings.latitude_deg, settings.longitude_deg, settings.height_m)
        config = pictured.config(context, where, settings.seed)
    try:
        ended = asyncio.run(_until_signalled(settings, port, context.json, config))
    except OSError as error:
        raise SattrackError(f"TCP port {port} is not available: {error.strerror}") from error
    return 130 if ended == signal.SIGINT else 0


async def _until_signalled(
    settings: TelescopeSettings, port: int, as_json: bool, config: CameraConfig | None
) -> int:
    from sattrack.mount.simulator.alpaca_server import serve, telescope_server

    server = telescope_server(settings, config)
    loop, stopped, ended = asyncio.get_running_loop(), asyncio.Event(), [0]

    def end(number: int) -> None:
        ended[0] = number
        stopped.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end, number)

    def ready(taken: int) -> None:
        url = f"alpaca://127.0.0.1:{taken}/0"
        first = {"listening": taken, "mount": url}
        if config is not None:
            first["camera"] = url
            click.echo(f"simulated camera: {url}", err=True)
        click.echo(f"simulated telescope: --mount {url}; Ctrl-C ends it", err=True)
        if as_json:
            click.echo(msgspec.json.encode(first).decode())

    serving = asyncio.create_task(serve(server, port, ready))
    waiting = asyncio.create_task(stopped.wait())
    await asyncio.wait({serving, waiting}, return_when=asyncio.FIRST_COMPLETED)
    if not stopped.is_set():
        # Nothing else ends the service: its error is the user's to see.
        await serving
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving
    return ended[0]

"""`sattrack track`: follow the pass now in progress, else the next."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sattrack.cli.common import (
    CommandContext,
    OutputFile,
    bias_options,
    common_options,
    fov_option,
    profile_option,
    refraction_option,
    satellite_names,
    stream_options,
)
from sattrack.cli.screen import appearance, screen_options, tui_possible, with_tui
from sattrack.cli.targets import ephemeris_option


@click.command("track")
@click.argument("target", shell_complete=satellite_names)
@ephemeris_option
@click.option(
    "--mount",
    "mount_url",
    metavar="URL",
    help="sim, xerxes://HOST:PORT?listen=PORT, alpaca://HOST:PORT/DEVICE, indi://HOST:PORT/DEVICE, or "
    "antenna://HOST:PORT.",
)
@profile_option
@click.option("--headless", is_flag=True, help="No terminal UI.")
@click.option("--record", type=OutputFile(new=True), help="Write every input and output to a new MCAP file.")
@click.option(
    "--learn-profile",
    type=OutputFile(),
    metavar="FILE",
    help="Write what the pass shows about the mount to a new profile.",
)
@refraction_option("Raise directions by the air's refraction; auto where the mount does not.")
@click.option("--bias-along", default=0.0, metavar="S", help="Seconds; positive leads.")
@click.option(
    "--bias-cross",
    default=0.0,
    metavar="DEG",
    help="Degrees; positive to your left as you face the way it flies.",
)
@click.option("--min-alt", type=float, metavar="DEG", help="Follow above this altitude (10, or as set).")
@click.option(
    "--from", "begin", metavar="UTC", help="Follow from this time on: the pass in progress then, or the next."
)
@click.option("--to", "end", metavar="UTC", help="Stop following at this time at the latest.")
@click.option(
    "--old-elements", is_flag=True, help="Follow even if the elements are too old to find the satellite."
)
@click.option("--virtual", is_flag=True, help="With --mount sim: in virtual time, as fast as it goes.")
@click.option(
    "--camera",
    "cameras",
    multiple=True,
    metavar="[NAME=]SOURCE",
    help="Look through a camera, and correct by it: see `sattrack camera`; may be repeated.",
)
@click.option("--scale", type=float, metavar="ARCSEC_PER_PIXEL", help="Of the camera: arcseconds in a pixel.")
@click.option("--exposure", metavar="S", help="Of the camera: seconds, or auto (default).")
@click.option(
    "--save", type=click.Path(path_type=Path), metavar="DIR", help="Keep the camera's frames there."
)
@bias_options
@fov_option
@click.option(
    "--serve",
    multiple=True,
    metavar="PROTOCOL[:PORT]",
    help="Let clients of alpaca, indi, lx200, rotctld or stellarium see and stop the run; may be repeated.",
)
@click.option(
    "--serve-host",
    default="127.0.0.1",
    show_default=True,
    metavar="ADDRESS",
    help="Address to listen on for --serve. No authentication: anyone who reaches it can stop the run.",
)
@click.option(
    "--serve-allow",
    multiple=True,
    metavar="ADDRESS",
    help="Serve only this address or network, as 192.0.2.7 or 192.0.2.0/24; may be repeated.",
)
@stream_options
@screen_options
@common_options("site", "elements", "clock", "json", "utc")
def command(context: CommandContext, target: str, **options: Any) -> int:
    """Follow the pass of TARGET now in progress, else the next.

    TARGET is a satellite (catalogue number, international designator or name), Moon or a planet, or RA,DEC;
    with --ephemeris an object of that file.

    \b
    Examples:
      sattrack track ISS --mount sim
      sattrack track ISS --record tonight.mcap
      sattrack track ISS --camera alpaca://192.0.2.7:11111/0 --scale 2.5
      sattrack track ISS --serve alpaca --serve lx200
      sattrack track 25544 --mount 'xerxes://192.0.2.7:15001?listen=15001'
    """
    url = options["mount_url"] or context.settings.mount.url
    if _wants_screen(context, options, url) and tui_possible():
        # Whatever is wrong with the rest, the feeder says, before there is a screen.
        return _on_screen(context, options, url)
    from sattrack.cli.running import follow

    return follow(context, target, options)


def _wants_screen(context: CommandContext, options: dict[str, Any], url: str | None) -> bool:
    streams = options["stream"] or options["control"] or options["observations"] == "stdin"
    plain = options["headless"] or options["virtual"] or context.json or streams
    # An antenna's controller has a screen of its own kind.
    return not plain and not (url or "").startswith("antenna:")


def _on_screen(context: CommandContext, options: dict[str, Any], url: str | None) -> int:
    from sattrack.cli.screen import helper_options

    practising = url == "sim" and not context.sources() and not context.has_site()
    look = appearance(context, options["theme"], options["plain"])
    started = helper_options(context, options["profile"], options["min_alt"], practising, url)
    return with_tui(look, helpers=started)

"""`sattrack sim --alpaca`: a simulated ASCOM Alpaca telescope, over HTTP on loopback."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.toml_text import read_toml
from sattrack.mount.alpaca.address import DEFAULT_PORT
from sattrack.mount.simulator.alpaca.server import serve
from sattrack.mount.simulator.alpaca.telescope import TelescopeSettings
from sattrack.runtime import demo_pass

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.cli.common import CommandContext


def simulate(context: CommandContext, port: int | None, telescope: Path | None) -> int:
    """Serve a simulated telescope until interrupted; return the exit code.

    It stands at the site of the options or the settings, else where the practice pass is seen. Raises
    BadInputError, naming file, line and key, SattrackError where the port is in use.
    """
    if context.clock_option is not None:
        raise BadInputError(
            "--clock does not go with --alpaca: what drives the telescope follows the real sky"
        )
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
    port = DEFAULT_PORT if port is None else port
    try:
        ended = asyncio.run(_until_told(settings, port, context.json))
    except OSError as error:
        raise SattrackError(f"TCP port {port} is not available: {error.strerror}") from error
    return 130 if ended == signal.SIGINT else 0


async def _until_told(settings: TelescopeSettings, port: int, as_json: bool) -> int:
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
    telling = asyncio.create_task(stopped.wait())
    await asyncio.wait({serving, telling}, return_when=asyncio.FIRST_COMPLETED)
    if not stopped.is_set():
        # Nothing else ends the service: its error is the user's to see.
        await serving
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving
    return ended[0]

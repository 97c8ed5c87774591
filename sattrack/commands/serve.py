"""`sattrack serve DOOR`: the mount for other people's programs."""

from __future__ import annotations

import click

from sattrack.commands.serve_antenna import command as antenna


@click.group("serve")
def command() -> None:
    """Make the mount available to other people's programs."""


command.add_command(antenna, "antenna")

"""`sattrack serve DOOR`: the mount for other people's programs."""

from __future__ import annotations

import importlib

import click

DOORS = {
    "alpaca": "The mount as an ASCOM telescope for programs that speak Alpaca, over HTTP.",
    "antenna": "The mount as an antenna for a VLBI Field System, on TCP or a serial line.",
    "rotctld": "The mount as a rotator for gpredict and other clients of Hamlib, on TCP.",
    "web": "The screen of the run that goes on, in a browser.",
}


class LazyDoors(click.Group):
    """A group that knows its doors by name and imports `sattrack.cli.serve_NAME` on first use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the doors in the order of the table."""
        return list(DOORS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the door's module; None for an unknown name."""
        if cmd_name not in DOORS:
            return None
        door: click.Command = importlib.import_module(f"sattrack.cli.serve_{cmd_name}").command
        return door

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the doors from the table, so that help imports none of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(DOORS.items()))


@click.group("serve", cls=LazyDoors)
def command() -> None:
    """Make the mount available to other people's programs."""

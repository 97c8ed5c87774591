"""`sattrack mount`: look at a mount, and operate it by hand. A verb's module is imported on its first use."""

from __future__ import annotations

import importlib

import click

VERBS = {
    "status": ("mount_move", "status", "All that the mount tells, once; nothing is sent to a real mount."),
    "watch": ("mount_watch", "watch", "A full-screen manual console: status live, jog, slew, sync, park."),
    "slew": ("mount_move", "slew", "Go to a right ascension and declination, and track there."),
    "sync": ("mount_move", "sync", "Make the mount report a direction for where it points."),
    "abort": ("mount_move", "abort", "Stop both axes, and see them at rest."),
    "park": ("mount_move", "park", "Slew to the park position, stop there, cut the drives' power."),
    "home": ("mount_move", "home", "Go to the home position."),
    "move": ("mount_move", "move", "Move at rates for some seconds, then track."),
    "pulse": ("mount_move", "pulse", "Guide: move at the guide rate for some milliseconds."),
    "fine-rate": ("mount_move", "fine_rate", "Adjust the tracking by small rates."),
    "calibrate": ("mount_calibrate", "command", "Find out what a mount does, and write its profile."),
}


class VerbGroup(click.Group):
    """A group that imports `sattrack.cli.MODULE` for the verb that is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs in the order of the table."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the verb's module; None for an unknown verb."""
        if cmd_name not in VERBS:
            return None
        module, attribute, _ = VERBS[cmd_name]
        found: click.Command = getattr(importlib.import_module(f"sattrack.cli.{module}"), attribute)
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs from the table, so that help imports none of them."""
        with formatter.section("Commands"):
            formatter.write_dl([(verb, words) for verb, (_, _, words) in VERBS.items()])


@click.group("mount", cls=VerbGroup)
def command() -> None:
    """Look at a mount, and operate it by hand.

    All verbs take --mount URL, --profile FILE and --site; --mount sim is a simulated mount for practice.
    Ctrl-C stops the mount first.
    """

"""The command line: parse, call, print. Each command's module is imported only when it is asked for."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from typing import TYPE_CHECKING, Any

import click

from sattrack import __version__
from sattrack.errors import SattrackError
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Sequence

COMMANDS = {
    "demo": "Follow a real pass with an embedded simulated mount.",
    "ephemeris": "Directions and rates of a satellite.",
    "passes": "Coming passes of one satellite, some, or a whole catalogue.",
    "rehearse": "The coming pass against the mount's limits: what will be lost, and why.",
    "track": "Follow the pass now in progress, else the next.",
    "attach": "Look at the run that goes on, or take part in it.",
    "run": "A schedule of passes: its plan, and why the others lost.",
    "replay": "Run a recording through today's code and compare every output.",
    "report": "What recorded passes tell of error, mount, link and satellite.",
    "recording": "What is in a recording, and its content in other programs' formats.",
    "biases": "Biases remembered from earlier passes: which there are, and dropping one.",
    "stop": "Stop the mount, from any terminal.",
    "mount": "Look at a mount, and operate it by hand: status, watch, slew, park, ...",
    "sim": "The simulated mount alone, on UDP.",
    "serve": "The mount for other people's programs: antenna (VLBI Field System), rotctld (Hamlib).",
    "elements": "Fetch, show and check element sets.",
    "doctor": "What is fine, what is not, and what to do: clock, elements, priority, mount.",
}


class LazyGroup(click.Group):
    """A group that knows its commands by name and imports `sattrack.commands.NAME` on first use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command's module; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"sattrack.commands.{cmd_name}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table, so that help imports none of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sattrack")
def cli() -> None:
    """Make a telescope mount follow satellites by streaming axis rates."""


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line and end the process with the exit code that CLI users rely on."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    sys.exit(run(arguments))


def run(arguments: list[str]) -> int:
    """Run one command line and return its exit code; errors are told in one line on standard error."""
    try:
        result: Any = cli.main(args=arguments, prog_name="sattrack", standalone_mode=False)
    except click.exceptions.Abort:
        return 130
    except BrokenPipeError:
        # Whoever read our output is gone; what is still buffered would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (SattrackError, TleError) as error:
        if "--debug" in arguments:
            traceback.print_exc()
        click.echo(f"sattrack: {error}", err=True)
        return error.exit_code
    except Exception as error:  # noqa: BLE001 - a defect is told in a line too, and in full with --debug
        if "--debug" in arguments:
            traceback.print_exc()
        click.echo(f"sattrack: a defect of sattrack: {error!r}; --debug shows where", err=True)
        return 1
    return result if isinstance(result, int) else 0

"""The command line: parse, call, print. Each command's module is imported only when it is asked for."""

from __future__ import annotations

import importlib
import os
import re
import sys
import traceback
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from sattrack import __version__
from sattrack.core.errors import SattrackError
from sattrack.core.origin import meant
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Sequence

COMMANDS = {
    "demo": "Show a real pass with a simulated mount; needs nothing else.",
    "ephemeris": "Print directions and rates of a satellite.",
    "passes": "List the coming passes of one satellite, some, or a whole catalogue.",
    "rehearse": "Run the coming pass against the mount's limits: what is lost, and why.",
    "track": "Follow the pass now in progress, else the next one.",
    "attach": "Watch a run that was started elsewhere, or take control of it.",
    "run": "Follow a schedule of passes; --dry-run prints its plan.",
    "replay": "Run a recording through today's code and compare every output.",
    "report": "Print errors, mount, link and satellite of recorded passes.",
    "recording": "Show what is in a recording, or export it.",
    "bias": "Fit observations of a satellite: the bias to use, and refined elements.",
    "biases": "List the biases remembered from earlier passes, or drop one.",
    "stop": "Stop the mount, from any terminal.",
    "mount": "Look at a mount, and operate it by hand: status, watch, slew, park, ...",
    "sim": "Start the simulated mount alone, on UDP.",
    "serve": "Serve the mount to other programs: antenna, alpaca, rotctld, web.",
    "elements": "Fetch, show and check element sets.",
    "doctor": "Check settings, clock, elements, priority and mount, and say what to do.",
}
PLAIN_WORDS = (
    ("is not a valid float", "is not a number"),
    ("is not a valid integer", "is not a whole number"),
    ("Got unexpected extra", "unexpected"),
)
"""Of click's messages, what is said in plain English."""


class LazyGroup(click.Group):
    """A group that knows its commands by name and imports `sattrack.cli.NAME` on first use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command's module; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"sattrack.cli.{cmd_name}")
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
    _open_closed_streams()
    sys.exit(run(arguments))


def _open_closed_streams() -> None:
    """Open what of the three standard streams was closed by whoever started us, to nowhere."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # It takes the lowest free number, which is the closed stream's.
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


def run(arguments: list[str]) -> int:
    """Run one command line and return its exit code; errors are told in one line on standard error."""
    try:
        result: Any = cli.main(args=arguments, prog_name="sattrack", standalone_mode=False)
    except click.exceptions.Abort:
        return 130
    except Exception as error:  # noqa: BLE001 - a defect is told in a line too, and in full with --debug
        return _told(error, "--debug" in arguments)
    return result if isinstance(result, int) else 0


def _told(error: Exception, debug: bool) -> int:
    """Tell an error on standard error; return its exit code."""
    code: int = getattr(error, "exit_code", 1)
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        return code
    if debug and not isinstance(error, click.ClickException):
        traceback.print_exception(error)
    if not isinstance(error, BrokenPipeError):
        click.echo(f"sattrack: {_words(error)}", err=True)
    if isinstance(error, OSError):
        _forget_output()
    return code


def _words(error: Exception) -> str:
    if isinstance(error, click.UsageError):
        return usage_words(error)
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, SattrackError | TleError):
        return str(error)
    if isinstance(error, OSError):
        where = "" if error.filename is None else f"{error.filename}: "
        return f"{where}{error.strerror or error}; --debug shows where"
    return f"a defect of sattrack: {error!r}; --debug shows where"


def _forget_output() -> None:
    """Let what is still buffered go nowhere: it would fail again when Python ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def usage_words(error: click.UsageError) -> str:
    """Return what is wrong with a command line, and what to do, in one line."""
    words = " ".join(error.format_message().split()).rstrip(".")
    for technical, plain in PLAIN_WORDS:
        words = words.replace(technical, plain)
    words = f"{words[:1].lower()}{words[1:]}"
    if error.ctx is None:
        return words
    unknown = re.fullmatch(r"no such command '(.*?)'.*", words)
    if unknown is not None and isinstance(error.ctx.command, click.Group):
        words = (
            f"no such command '{unknown[1]}'{meant(unknown[1], error.ctx.command.list_commands(error.ctx))}"
        )
    elif isinstance(error, click.NoSuchOption):
        options = [each for one in error.ctx.command.params for each in one.opts if each.startswith("--")]
        words = f"no such option {error.option_name}{meant(error.option_name, options)}"
    return f"{words}{'' if words.endswith('?') else ';'} see `{error.ctx.command_path} --help`"

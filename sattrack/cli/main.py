"""The command line: parse, call, print. Each command's module is imported only when it is asked for."""

from __future__ import annotations

import errno
import importlib
import io
import os
import re
import shlex
import sys
import traceback
import warnings
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TextIO

import click

from sattrack import __version__
from sattrack.core.errors import BadInputError, SattrackError, how_to_install, meant
from tle.errors import SatelliteNotFoundError, TleError, printable

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from click.shell_completion import CompletionItem

COMMANDS = {
    "init": "Ask for place, mount and satellites, and write the settings file.",
    "demo": "Show a real pass with a simulated mount; needs nothing else.",
    "ephemeris": "Print directions and rates of a satellite.",
    "passes": "List the coming passes of one satellite, some, or a whole catalogue.",
    "rehearse": "Run the coming pass against the mount's limits: what is lost, and why.",
    "track": "Follow the pass now in progress, else the next one.",
    "camera": "Find the satellite in a camera's frames, and centre it.",
    "attach": "Watch a run that was started elsewhere, or take control of it.",
    "run": "Follow a schedule of passes; --dry-run prints its plan.",
    "replay": "Run a recording through today's code and compare every output.",
    "report": "Report the errors of recorded passes, and what to change.",
    "recording": "Show what is in a recording, or export it.",
    "bias": "Fit observations of a satellite: the bias to use, and refined elements.",
    "biases": "List the biases remembered from earlier passes, or drop one.",
    "stop": "Stop the mount, from any terminal.",
    "mount": "Look at a mount, and operate it by hand: status, watch, slew, park, ...",
    "star-run": "Measure pointing errors by stars, and keep the model in the mount's profile.",
    "sim": "Start the simulated mount alone, on UDP.",
    "network": "Plan the passes of many stations, and collect what they saw.",
    "serve": "Serve the mount to other programs: antenna, alpaca, rotctld, web.",
    "elements": "Fetch, show and check element sets.",
    "doctor": "Check settings, clock, elements, priority and mount, and say what to do.",
    "storm": "Run the program through a storm of faults, in virtual time, from a seed.",
}
GROUPS = {
    "Observe": ("demo", "track", "camera", "run", "attach", "stop"),
    "Mount": ("mount", "star-run", "sim"),
    "Plan": ("passes", "ephemeris", "rehearse", "elements", "bias", "biases", "network"),
    "Recordings": ("report", "replay", "recording"),
    "Servers": ("serve",),
    "Set up and check": ("init", "doctor", "storm"),
}
"""The commands of each section of the help; one that is in none is listed last."""
PLACES = {
    "report": "recording:report",
    "biases": "elements:biases",
    "star-run": "star_run:command",
    "mount": "main:mount",
    "serve": "main:serve",
    "network": "main:network",
}
"""Module and attribute of the commands that are no `command` in a module of their name."""
MOUNT_VERBS = {
    "status": "Show the mount's whole status once; nothing is sent to a real mount.",
    "watch": "A full-screen manual console: status live, jog, slew, sync, park.",
    "slew": "Go to a right ascension and declination, and track there.",
    "sync": "Make the mount report a direction for where it points.",
    "abort": "Stop both axes, and confirm that they are at rest.",
    "park": "Slew to the park position, stop there, cut the drives' power.",
    "home": "Go to the home position.",
    "unwound": "Confirm that its cables are looked at, after it moved unheard.",
    "move": "Move at rates for some seconds, then track.",
    "pulse": "Guide: move at the guide rate for some milliseconds.",
    "fine-rate": "Adjust the tracking by small rates.",
    "calibrate": "Measure how a mount moves, and write its profile.",
}
MOUNT_PLACES = {verb: f"mount:{verb.replace('-', '_')}" for verb in MOUNT_VERBS} | {
    "calibrate": "mount_calibrate:command"
}
MOUNT_HELP = """Look at a mount, and operate it by hand.

All verbs take --mount URL; --mount sim is a simulated mount for practice. All but calibrate and unwound take
--profile FILE.
Ctrl-C stops the mount first.

\b
Examples:
  sattrack mount status --mount sim
  sattrack mount slew 14h15m40s 19d10m --mount sim
"""
NETWORK_VERBS = {
    "passes": "Find the passes of all satellites over all stations: a Parquet data set.",
    "assign": "Assign satellites to stations and times: a schedule for each station.",
    "collect": "Gather what the stations have seen, and refine the elements for all.",
}
NETWORK_PLACES = {verb: f"network:{verb}" for verb in NETWORK_VERBS}
NETWORK_HELP = """Plan and gather the work of many stations.

\b
Examples:
  sattrack network passes --stations s.toml --elements v.tle --output passes
"""
SERVERS = {
    "alpaca": "The mount as an ASCOM telescope for programs that speak Alpaca, over HTTP.",
    "antenna": "The mount as an antenna for a VLBI Field System, on TCP or a serial line.",
    "indi": "The mount as an INDI telescope for KStars, PHD2 and others, on TCP.",
    "lx200": "The mount as an LX200 telescope for SkySafari, Stellarium and others, on TCP.",
    "rotctld": "The mount as a rotator for gpredict and other clients of Hamlib, on TCP.",
    "stellarium": "The mount as a telescope by Stellarium's own protocol, on TCP.",
    "web": "The screen of the active run, in a browser.",
}
SERVER_PLACES = {
    "alpaca": "serve_alpaca:command",
    "antenna": "serve_antenna:command",
    "indi": "serve_alpaca:indi",
    "lx200": "serve_alpaca:lx200",
    "rotctld": "serve:rotctld",
    "stellarium": "serve_alpaca:stellarium",
    "web": "attach:web",
}
SERVE_HELP = """Make the mount available to other people's programs.

\b
Examples:
  sattrack serve rotctld --mount sim
  sattrack serve web
"""
HELP = """Make a telescope mount follow satellites by streaming axis rates.

\b
Examples:
  sattrack demo
  sattrack init
  sattrack passes ISS
  sattrack track ISS --mount sim
"""
PLAIN_TEXT = (
    ("is not a valid float", "is not a number"),
    ("is not a valid integer", "is not a whole number"),
    ("Got unexpected extra", "unexpected"),
    ("requires an argument", "needs a value after it"),
    ("is a directory", "is a folder; give a file"),
)
"""click's terms, and the plain English for them."""
EXTRA_OF = {"scipy": "camera"}
"""The extra that brings a package which modules import at their beginning."""
POSIX_ONLY = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")
UNIX_COMMANDS = frozenset({"demo", "track", "run", "attach", "stop", "mount", "star-run", "sim", "serve"})
"""Commands, and groups of them, that need processes, signals and sockets which Windows does not have."""
CALCULATING = ("virtual", "dry_run", "check", "fit_only")
"""Options with which such a command only calculates."""
ADVICE = {
    os.strerror(errno.ENOENT): "; check the name and the folder",
    os.strerror(errno.EISDIR): "; give a file",
    os.strerror(errno.ENOSPC): "; make room there, or write elsewhere",
    os.strerror(errno.EACCES): "; choose another folder, or change who may use this one",
}
"""What to do, by the system's words at the end of a message."""
CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class LazyGroup(click.Group):
    """A group that lists its commands from a table and imports one of them on its first use.

    `table` has the help of each by name; `places` its module and attribute in `sattrack.cli`, by default
    `NAME:command`; `groups` the commands of each section of the help.
    """

    def __init__(
        self,
        name: str,
        table: Mapping[str, str],
        places: Mapping[str, str],
        groups: Mapping[str, Sequence[str]] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(name, **settings)
        self._table, self._places, self._groups = table, places, groups or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of the table."""
        return list(self._table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command's module; None for an unknown name."""
        if cmd_name not in self._table:
            return None
        module, _, attribute = self._places.get(cmd_name, f"{cmd_name}:command").partition(":")
        command: click.Command = getattr(importlib.import_module(f"sattrack.cli.{module}"), attribute)
        if sys.platform == "win32" and not UNIX_COMMANDS.isdisjoint({self.name, cmd_name}):
            _refuse_to_run(command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table, so that help imports none of them."""
        grouped = {name for names in self._groups.values() for name in names}
        rest = [name for name in self._table if name not in grouped]
        width = max(map(len, self._table))
        for title, names in (*self._groups.items(), ("Commands", rest)):
            if names:
                with formatter.section(title):
                    formatter.write_dl([(name.ljust(width), self._table[name]) for name in names])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return the commands that begin so, from the table: a TAB imports none of them."""
        from click.shell_completion import CompletionItem

        own = [CompletionItem(name, help=text) for name, text in self._table.items()]
        return [one for one in own if one.value.startswith(incomplete)] + click.Command.shell_complete(
            self, ctx, incomplete
        )


def _refuse_to_run(command: click.Command) -> None:
    """Let a command that needs Unix say so; its help is shown, and what only calculates runs."""
    run_it = command.callback

    def refuse(*arguments: Any, **options: Any) -> Any:
        if run_it is not None and any(options.get(name) for name in CALCULATING):
            return run_it(*arguments, **options)
        raise SattrackError(
            f"`{click.get_current_context().command_path}` needs Linux, macOS or WSL, the Linux of Windows; "
            "here sattrack calculates: passes, ephemeris, rehearse, report, replay, and "
            "`track --mount sim --virtual`"
        )

    if not isinstance(command, click.Group):
        command.callback = refuse


cli = click.version_option(__version__, prog_name="sattrack")(
    LazyGroup(
        "sattrack",
        COMMANDS,
        PLACES,
        GROUPS,
        help=HELP,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
)
mount = LazyGroup("mount", MOUNT_VERBS, MOUNT_PLACES, help=MOUNT_HELP)
network = LazyGroup("network", NETWORK_VERBS, NETWORK_PLACES, help=NETWORK_HELP)
serve = LazyGroup("serve", SERVERS, SERVER_PLACES, help=SERVE_HELP)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line and end the process with the exit code that CLI users rely on."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    _prepare_streams()
    sys.exit(run(arguments))


def _prepare_streams() -> None:
    """Open those of the three standard streams that were closed at the start, to nowhere.

    What an older encoding than UTF-8 cannot write, such as the sign of arcseconds, becomes a question mark.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # It takes the lowest free number, which is the closed stream's.
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")


def run(arguments: list[str]) -> int:
    """Run one command line and return its exit code; errors and warnings are one line on standard error."""
    try:
        for one in arguments:
            # Recordings, JSON and notes are UTF-8: they cannot name a file whose name is not.
            one.encode()
        with _warnings_as_lines():
            result: Any = cli.main(args=arguments, prog_name="sattrack", standalone_mode=False)
    except click.exceptions.Abort:
        click.echo("\nsattrack: interrupted", err=True)
        return 130
    except UnicodeEncodeError as error:
        return _report_error(_of_name(error), arguments)
    except Exception as error:  # noqa: BLE001 - a defect is one line too; --debug shows all of it
        return _report_error(error, arguments)
    return result if isinstance(result, int) else 0


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """Show warnings of the libraries as the program's own, each text once."""
    shown: set[str] = set()

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            click.echo(printable(f"sattrack: warning: {message}", "\n"), err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield


def _report_error(error: Exception, arguments: list[str]) -> int:
    """Report an error on standard error; return its exit code."""
    code: int = getattr(error, "exit_code", 1)
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        return code
    if "--debug" in arguments and not isinstance(error, click.ClickException):
        click.echo(printable("".join(traceback.format_exception(error)), "\n"), nl=False, err=True)
    if not isinstance(error, BrokenPipeError):
        click.echo(printable(f"sattrack: {_error_text(error, arguments)}", "\n"), err=True)
    if isinstance(error, OSError):
        _forget_output()
    return code


def _error_text(error: Exception, arguments: list[str]) -> str:
    if isinstance(error, click.UsageError):
        return _usage_text(error, arguments)
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, SattrackError | TleError):
        return f"{error}{_advice(error)}"
    if isinstance(error, ModuleNotFoundError) and (needed := _needed((error.name or "").partition(".")[0])):
        return needed
    if isinstance(error, OSError):
        named = error.filename or ("standard output" if _is_of_output(error) else None)
        where = "" if named is None else f"{named}: "
        return f"{where}{error.strerror or error}{ADVICE.get(error.strerror or '', '; --debug shows where')}"
    return f"a defect of sattrack: {error!r}; --debug shows where"


def _of_name(error: UnicodeEncodeError) -> Exception:
    """Return the error about a name that is not UTF-8; any other as it is."""
    if error.encoding != "utf-8":
        return error
    refused = error.object[error.start]
    word = next(word for word in error.object.split() if refused in word).rstrip(":")
    bad = BadInputError(f"{word}: this is no text in UTF-8; give the file or folder another name")
    bad.__cause__ = error
    return bad


def _advice(error: SattrackError | TleError) -> str:
    """Return what to do about an error that does not say it itself."""
    if isinstance(error, SatelliteNotFoundError) and error.key and not str(error).endswith("?"):
        from sattrack.elements.downloads import named_source

        source = shlex.quote(named_source(error.key))
        return f": check the spelling, or give --elements {source} to fetch it"
    return ADVICE.get(str(error).rpartition(": ")[2], "")


def _needed(module: str) -> str:
    """Return what to do about a module that is not there; nothing where that is a defect."""
    if module in EXTRA_OF:
        return f"this needs {module}: {how_to_install(EXTRA_OF[module])}"
    if module in POSIX_ONLY:
        return f"this needs Linux, macOS or WSL: Python has no {module} here; calculations do not"
    return ""


def _is_of_output(error: OSError) -> bool:
    """Tell whether standard output fails in the same way: the system names only what it opens."""
    if error.errno in CANNOT_WRITE:
        try:
            os.write(sys.stdout.fileno(), b"\n")
        except (OSError, ValueError) as again:
            return isinstance(again, OSError) and again.errno == error.errno
    return False


def _forget_output() -> None:
    """Let what is still buffered go nowhere: it would fail again when Python ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _usage_text(error: click.UsageError, arguments: list[str]) -> str:
    """Return what is wrong with a command line, and what to do, in one line."""
    text = " ".join(error.format_message().split()).rstrip(".")
    for technical, plain in PLAIN_TEXT:
        text = text.replace(technical, plain)
    text = f"{text[:1].lower()}{text[1:]}"
    if error.ctx is None:
        return text
    unknown = re.fullmatch(r"no such command '(.*?)'.*", text)
    if unknown is not None and isinstance(error.ctx.command, click.Group):
        text = (
            f"no such command '{unknown[1]}'{meant(unknown[1], error.ctx.command.list_commands(error.ctx))}"
        )
    elif isinstance(error, click.NoSuchOption):
        shown = [one for one in error.ctx.command.params if isinstance(one, click.Option) and not one.hidden]
        options = ["--help", *(each for one in shown for each in one.opts if each.startswith("--"))]
        # Of -mount click tells -m only.
        name = next((word for word in arguments if re.match(rf"{re.escape(error.option_name)}\w", word)), "")
        text = f"no such option {name or error.option_name}{meant(name or error.option_name, options)}"
        if error.option_name == "--city" and "--site" in options:
            text += ": give --site LAT,LON,HEIGHT; `sattrack init --city NAME` writes it into settings"
    elif re.search(r"[–—]\w", text):
        text += "; options begin with --, two hyphens"
    return f"{text}{'' if text.endswith('?') else ';'} see `{error.ctx.command_path} --help`"

"""`sattrack attach` and `sattrack serve web`: watch the active run, on a terminal or in a browser."""

from __future__ import annotations

import importlib.util
import os
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options
from sattrack.cli.output import tell
from sattrack.cli.screen import appearance, helper_options, needed_terminal, screen_options, tui_possible
from sattrack.core import local_time
from sattrack.core.errors import BadInputError, SattrackError, how_to_install
from sattrack.core.process import self_command
from sattrack.runtime.callers import listen
from sattrack.runtime.view_server import SUPPORTED, feeders
from sattrack.views.formatting import counted
from tle.errors import printable

if TYPE_CHECKING:
    from sattrack.views.run import Welcome


@click.command("attach")
@click.option("--run", "pid", type=int, metavar="PID", help="The process of the run, if several are active.")
@click.option("--as", "name", metavar="NAME", help="Your name, shown to the others; default: this terminal.")
@screen_options
@common_options("site", "elements", "json", "utc")
def command(context: CommandContext, pid: int | None, name: str | None, **options: Any) -> int:
    """Watch a run that was started elsewhere, or take control of it, on the screen that `track` has.

    Up to 64 can watch. SPACE stops the mount for everybody. One at a time has control and can move the
    target: c takes it. The run continues when you leave the screen. After a pass of a schedule, the screen
    goes on to the next one. --json writes the views of one run, one object a line.

    \b
    Examples:
      sattrack attach
      sattrack attach --run 4711 --json
    """
    pid = chosen_run(pid)
    name = name or _terminal()
    if context.json:
        return _as_json(pid, name)
    if importlib.util.find_spec("textual_plot") is None:
        raise SattrackError(f"the screen needs textual: {how_to_install('tui')}")
    from sattrack.tui.launch import SEEN_BY_BROWSER, attach_with_tui

    if not (tui_possible() or SEEN_BY_BROWSER in os.environ):
        raise BadInputError(f"attach needs {needed_terminal()}; --json is for programs")

    look = appearance(context, options["theme"], options["plain"])
    return attach_with_tui(pid, name, look, helper_options(context, None, None, practising=False))


def chosen_run(pid: int | None) -> int:
    """Return the process of the run to look at. Raises BadInputError where that is none, or in doubt."""
    if not SUPPORTED:
        raise SattrackError("runs can be watched on Linux only")
    if pid is not None:
        return pid
    found = feeders()
    if not found:
        raise SattrackError(
            "no run is active: `sattrack track` and `sattrack demo` start one; "
            "between the passes of a schedule, `sattrack run FILE --status` shows its state"
        )
    if len(found) > 1:
        choices = "; ".join(f"--run {one}: {_run_text(one)}" for one in found)
        raise BadInputError(f"{len(found)} runs are active; choose one: {choices}")
    return found[0]


def _run_text(pid: int) -> str:
    welcome = welcome_of(pid)
    return "it does not answer" if welcome is None else welcome_text(welcome)


def welcome_of(pid: int) -> Welcome | None:
    """Return what a run says of itself; None where it does not answer."""
    from sattrack.tui.attached import welcomed

    try:
        channel, lines, welcome = welcomed(pid, "a list of runs")
    except SattrackError:
        return None
    lines.close()
    channel.close()
    return welcome


def welcome_text(welcome: Welcome) -> str:
    """Return what a run is."""
    since = local_time.localised(welcome.since_utc)
    return printable(f"{welcome.name} with {welcome.mount}, `{welcome.command}`, since {since}")


def _terminal() -> str:
    try:
        return os.ttyname(sys.stdin.fileno()).removeprefix("/dev/")
    except (OSError, ValueError):
        return f"process {os.getpid()}"


def _as_json(pid: int, name: str) -> int:
    """Write what is seen as JSON lines, until the run ends; raises SattrackError where it is lost."""
    from sattrack.tui.attached import welcomed

    channel, lines, _ = welcomed(pid, name)
    whole = False
    with channel, lines:
        for line in lines:
            if line.startswith(b'{"elements"'):
                continue
            whole = line.startswith(b'{"summary"')
            sys.stdout.buffer.write(line)
            sys.stdout.buffer.flush()
    if not whole:
        raise SattrackError("the run ended unexpectedly: its guardian stops the mount; check the mount")
    return 0


PORT = 8137
FEWEST_CHARACTERS = 16


@click.command("web")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on; 0.0.0.0 for all. Any but a loopback address needs a token.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=PORT,
    show_default=True,
    help="Port to listen on; 0 for any free one.",
)
@click.option(
    "--token",
    envvar="SATTRACK_WEB_TOKEN",
    metavar="WORDS",
    help="The token that visitors must give, 16 characters or more; generated if needed and not given. "
    "Or set SATTRACK_WEB_TOKEN, which other users cannot read.",
)
@click.option("--run", "pid", type=int, metavar="PID", help="Show only this run, by its process.")
@screen_options
@common_options("site", "elements", "json", "utc")
def web(
    context: CommandContext, host: str, port: int, token: str | None, pid: int | None, **options: Any
) -> int:
    """Show a run in a browser; each visitor gets a screen as `attach` shows it.

    SPACE stops the mount for everybody. One visitor at a time has control; c takes it. With several runs, the
    page links to each. Only this machine can open the page, unless --host says otherwise; visitors from
    elsewhere need a token. There is no encryption: use a proxy or a tunnel with encryption on any network
    that is not yours.

    \b
    Examples:
      sattrack serve web
      sattrack serve web --host 0.0.0.0 --port 8137
    """
    if importlib.util.find_spec("textual_serve") is None:
        raise SattrackError(f"the browser's screen needs textual-serve: {how_to_install('web')}")
    if token is not None and len(token) < FEWEST_CHARACTERS:
        raise BadInputError(f"--token: {counted(len(token), 'character')}; give {FEWEST_CHARACTERS} or more")
    if ":" not in host:
        listen(host, port).close()
    from sattrack.servers.web import Visit, needs_token, new_token, serve

    if token is None and needs_token(host):
        token = new_token()
    visit = Visit(host, port, token, (*self_command(), "attach", *_handed_on(context, options)))
    serve(visit, partial(_runs, pid, {}), partial(_tell_addresses, context.json))
    return 0


def _runs(pid: int | None, known: dict[int, str]) -> dict[int, str]:
    """Return the runs that can be looked at, as text without their commands: others may read this.

    `known` keeps the words, since a run notes everybody who asks it.
    """
    found = [each for each in feeders() if pid is None or each == pid]
    if len(found) == 1:
        return {found[0]: "the run"}
    for each in found:
        if each not in known:
            welcome = welcome_of(each)
            if welcome is not None:
                known[each] = (
                    f"{welcome.name} with {welcome.mount}, since {local_time.localised(welcome.since_utc)}"
                )
    return {each: known[each] for each in found if each in known}


def _tell_addresses(as_json: bool, urls: tuple[str, ...]) -> None:
    if as_json:
        click.echo(msgspec.json.encode({"url": urls[0], "urls": urls}).decode())
        return
    for url in urls:
        tell(f"open {url}")
    tell("Ctrl-C closes the page; the run continues")


def _handed_on(context: CommandContext, options: dict[str, Any]) -> list[str]:
    text: list[str] = []
    for name, value in (
        ("--theme", options["theme"]),
        ("--site", context.site_option),
        ("--config", context.settings_file),
    ):
        if value is not None:
            text += [name, str(value)]
    for source in context.element_sources:
        text += ["--elements", source]
    if options["plain"]:
        text.append("--ascii")
    if context.utc:
        text.append("--utc")
    return text

"""`sattrack serve web`: the screen of the run that goes on, in a browser."""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import click
import msgspec

from sattrack.cli.attach import welcome_of
from sattrack.cli.common import CommandContext, common_options, screen_options, tell
from sattrack.cli.screened import given
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.own_program import own_program
from sattrack.runtime.view_server import feeders

PORT = 8137
FEWEST_CHARACTERS = 16


@click.command("web")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on; 0.0.0.0 for all. Any other than this machine's own needs a token.",
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
    help="What a visitor has to bring, 16 characters or more; made up where one is needed and none is given. "
    "Also from SATTRACK_WEB_TOKEN, where other users cannot read it.",
)
@click.option("--run", "pid", type=int, metavar="PID", help="Show this run only, by its process.")
@screen_options
@common_options
def command(
    context: CommandContext, host: str, port: int, token: str | None, pid: int | None, **options: Any
) -> int:
    """Show a run in a browser: each visitor has a screen like that of `attach`.

    SPACE stops the mount, for everybody. One at a time has control: c takes it. With several runs, the page
    links to each. Only this machine can open the page, unless --host says otherwise; visitors from elsewhere
    need a token. There is no encryption: use a proxy or a tunnel with encryption before the page crosses a
    network that is not yours.
    """
    if importlib.util.find_spec("textual_serve") is None:
        raise SattrackError("the browser's screen needs textual-serve: pip install 'sattrack[web]'")
    if token is not None and len(token) < FEWEST_CHARACTERS:
        raise BadInputError(f"--token: {len(token)} characters; give {FEWEST_CHARACTERS} or more")
    from sattrack.servers.web.server import Visit, needs_token, new_token, serve

    if token is None and needs_token(host):
        token = new_token()
    visit = Visit(host, port, token, (*own_program(), "attach", *_handed_on(context, options)))
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
                known[each] = f"{welcome.name} with {welcome.mount}, since {welcome.since_utc}"
    return {each: known[each] for each in found if each in known}


def _tell_addresses(as_json: bool, urls: tuple[str, ...]) -> None:
    if as_json:
        click.echo(msgspec.json.encode({"url": urls[0], "urls": urls}).decode())
        return
    for url in urls:
        tell(f"open {url}")
    tell("Ctrl-C ends the page, and does nothing to the run")


def _handed_on(context: CommandContext, options: dict[str, Any]) -> list[str]:
    words: list[str] = []
    for name, value in (
        ("--theme", options["theme"]),
        ("--site", context.site_option),
        ("--config", given("--config")),
    ):
        if value is not None:
            words += [name, str(value)]
    for source in context.element_sources:
        words += ["--elements", source]
    if options["plain"]:
        words.append("--ascii")
    return words

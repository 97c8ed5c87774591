"""`sattrack doctor`: settings, clock, elements, Earth orientation, priority, terminal, mount: fine or not."""

from __future__ import annotations

import getpass
import importlib.util
import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli import doctor_checks as doctor
from sattrack.cli.common import CommandContext, common_options, profile_option
from sattrack.cli.doctor_checks import Check, ElementFacts, TerminalFacts
from sattrack.core.errors import SattrackError
from sattrack.core.realtime import how_to_grant, undisturbed
from sattrack.mount.model import MountProfile
from sattrack.runtime.kernel_clock import read_kernel_clock
from sattrack.settings import find_settings_file, load_settings
from tle.earth import earth_orientation_age
from tle.errors import TleError
from tle.sources import newest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tle.instants import Utc

EXTRA_MODULES = {"tui": ("textual", "textual_plot"), "plot": ("matplotlib",), "keyring": ("keyring",)}
COLOURS = {"ok": "green", "warn": "yellow", "bad": "red"}


class Findings(msgspec.Struct, frozen=True):
    """What `--json` prints."""

    worst: doctor.State
    checks: list[Check]


class _PatientCommand(click.Command):
    """Runs without the settings file where that is wrong, and keeps what is wrong with it."""

    def invoke(self, ctx: click.Context) -> Any:
        """Read the settings first, only to see whether they can be read."""
        ctx.meta[__name__] = find_settings_file(ctx.params["config"]), None
        try:
            load_settings(ctx.params["config"])
        except SattrackError as error:
            ctx.meta[__name__] = ctx.params["config"], str(error)
            ctx.params["config"] = Path(os.devnull)
        return super().invoke(ctx)


@click.command("doctor", cls=_PatientCommand)
@click.option(
    "--mount",
    "mount_url",
    metavar="URL",
    help="Listen to this mount: xerxes://HOST:PORT?listen=PORT or alpaca://HOST:PORT/DEVICE.",
)
@profile_option
@click.option(
    "--record-folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Where recordings will go; default: the current folder.",
)
@common_options
def command(context: CommandContext, **options: Any) -> int:
    """Tell what is fine, what is not, and what to do. Nothing is sent to the mount, and nothing changed.

    Exit code 1 where something is bad.
    """
    checks: list[Check] = []
    for check in _checks(context, options):
        checks.append(check)
        if not context.json:
            _tell(check)
    if context.json:
        click.echo(msgspec.json.encode(Findings(doctor.worst(checks), checks)).decode())
    return 1 if doctor.worst(checks) == "bad" else 0


def _tell(check: Check) -> None:
    state = click.style(f"{check.state:<4}", fg=COLOURS[check.state])
    click.echo(f"{state}  {check.subject:<9} {check.what}")
    for way in check.do:
        click.echo(f"{'':<16}→ {way}")


def _checks(context: CommandContext, options: dict[str, Any]) -> Iterator[Check]:
    path, settings_error = click.get_current_context().meta[__name__]
    yield doctor.check_settings(path, settings_error)
    yield _check_site(context)
    now = context.now()
    yield doctor.check_elements(_element_facts(context), float(now.unix_s))
    yield _check_earth(now)
    yield doctor.check_clock(read_kernel_clock())
    with undisturbed() as grant:
        # Asked for and given back at once: nothing else tells for certain what a run will get.
        pass
    ways = how_to_grant(_user())
    yield doctor.check_priority(grant, ways)
    yield doctor.check_memory(grant, ways)
    yield doctor.check_terminal(_terminal_facts())
    yield doctor.check_extras(
        {
            name: all(importlib.util.find_spec(module) is not None for module in modules)
            for name, modules in EXTRA_MODULES.items()
        }
    )
    yield from _check_mount(context, options["mount_url"] or context.settings.mount.url, options["profile"])
    yield _check_disk(options["record_folder"])


def _check_site(context: CommandContext) -> Check:
    if not context.has_site():
        return doctor.check_site(None, None)
    try:
        return doctor.check_site(context.site(), None)
    except (SattrackError, TleError) as error:
        return doctor.check_site(None, str(error))


def _element_facts(context: CommandContext) -> ElementFacts:
    sources = context.sources()
    if not sources:
        return ElementFacts(())
    try:
        sets = context.load(sources)
    except (SattrackError, TleError) as error:
        return ElementFacts(sources, error=str(error))
    return ElementFacts(
        sources,
        epochs_utc_s=tuple(float(elements.epoch.unix_s) for elements in newest(sets.accepted)),
        refused=len(sets.rejected),
        first_refusal=str(sets.rejected[0]).splitlines()[0] if sets.rejected else None,
    )


def _check_earth(now: Utc) -> Check:
    try:
        return doctor.check_earth(earth_orientation_age(now), None)
    except (TleError, OSError) as error:
        return doctor.check_earth(None, str(error))


def _terminal_facts() -> TerminalFacts:
    size = None
    if sys.stdin.isatty() and sys.stdout.isatty():
        with suppress(OSError):
            columns, rows = os.get_terminal_size(sys.stdout.fileno())
            size = columns, rows
    environment = os.environ
    return TerminalFacts(
        size, environment.get("TERM", ""), sys.stdout.encoding, bool(environment.get("NO_COLOR"))
    )


def _check_mount(context: CommandContext, url: str | None, explicit: Path | None) -> Iterator[Check]:
    real = url not in (None, "sim")
    configured = str(explicit) if explicit is not None else context.settings.mount.profile
    profile: MountProfile | None = None
    error = None
    try:
        profile = context.profile(explicit, url).mount
    except SattrackError as refusal:
        error = str(refusal)
    yield doctor.check_profile(configured, profile, error, real)
    if url is None:
        words = "no mount is set: with --mount, or [mount] url in sattrack.toml, its statuses are listened to"
        yield Check("link", "ok", words)
        return
    yield _check_link(url, profile or MountProfile())


def _check_link(url: str, profile: MountProfile) -> Check:
    # The session's modules are many; without a mount they are not needed.
    from sattrack.runtime.links import LISTEN_S, listen
    from sattrack.runtime.mounts import mount_address

    try:
        address = mount_address(url)
        health = None if address is None else listen(address, profile)
    except SattrackError as refusal:
        return doctor.check_link(url, None, LISTEN_S, str(refusal))
    return doctor.check_link(url, health, LISTEN_S, None)


def _check_disk(folder: Path) -> Check:
    absolute = folder.absolute()
    try:
        free_bytes: float | None = shutil.disk_usage(absolute).free
    except OSError:
        free_bytes = None
    return doctor.check_disk(absolute, free_bytes, os.access(absolute, os.W_OK))


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "YOU"

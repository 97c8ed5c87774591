"""`sattrack doctor`: what is fine, what is not, and what to do about it; each check a pure function of facts.

`bad` is what will spoil a pass or keep it from beginning, `warn` what may.
"""

from __future__ import annotations

import getpass
import importlib.util
import os
import re
import shutil
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, how_to_renew, profile_option, read_settings
from sattrack.cli.output import may_colour, say
from sattrack.core import local_time
from sattrack.core.errors import SattrackError, how_to_install
from sattrack.core.realtime import how_to_grant, undisturbed
from sattrack.mount.model import MountProfile
from sattrack.runtime.system import read_kernel_clock
from sattrack.settings import find_settings_file
from sattrack.views import formatting
from sattrack.views.formatting import OLD_ELEMENTS_DAYS, arcsec
from tle.earth import earth_orientation_age
from tle.elements import expected_along_arcsec
from tle.errors import TleError, printable
from tle.instants import DAY_S, Utc
from tle.sources import newest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sattrack.core.realtime import Grant
    from sattrack.mount.xerxes.link import LinkHealth
    from sattrack.runtime.system import KernelClock
    from tle.earth import EarthOrientationAge
    from tle.site import Site

State = Literal["ok", "warn", "bad"]

OLD_ORIENTATION_DAYS = 60.0
"""From here on a prediction of UT1 may be off by tenths of an arcsecond."""
POOR_CLOCK_S = 0.01
ARCSEC_PER_MS = 3.6
"""What a millisecond is on a target that moves by 1°/s."""
LEAST_COLUMNS, LEAST_ROWS = 80, 24
LITTLE_SPACE_BYTES = 200e6
NO_SPACE_BYTES = 10e6
UNEVEN_MS = 10.0
EXTRAS = {
    "tui": ("the terminal screen", "textual", "textual_plot"),
    "plot": ("plots to files, biases in reports", "matplotlib", "filterpy"),
    "web": ("the screen in a browser", "textual_serve"),
    "serial": ("serial lines", "serial"),
    "camera": ("cameras, FITS, PNG", "sep", "tetra3rs", "astropy", "PIL", "scipy"),
    "indi": ("cameras by INDI", "indipyclient"),
    "v4l": ("webcams", "cv2"),
    "adsb": ("aircraft", "pyModeS"),
    "cluster": ("many stations", "dask", "distributed", "highspy"),
    "parquet": ("Parquet files", "pyarrow"),
    "keyring": ("passwords in the key ring", "keyring"),
}
"""What each optional part is for, and the modules that it brings."""
COLOURS = {"ok": "green", "warn": "yellow", "bad": "red"}


class CheckResult(msgspec.Struct, frozen=True):
    """One line of the doctor's: what it is about, how it is, in words, what to do (the best way first)."""

    subject: str
    state: State
    what: str
    do: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ElementFacts:
    """What the element sources held; epochs are POSIX seconds of UTC, one an object."""

    sources: tuple[str, ...]
    epochs_utc_s: tuple[float, ...] = ()
    refused: int = 0
    first_refusal: str | None = None
    error: str | None = None
    """Why a source could not be read."""
    along_arcsec: tuple[float, ...] = ()
    """By how much each may be off along its track now, at its largest."""
    only_number: int | None = None
    """The catalogue number where they are of one object alone."""
    fetched_by_name: bool = False
    """Whether CelesTrak is asked for a satellite that is named, where there is no source."""


@dataclass(frozen=True, slots=True)
class TerminalFacts:
    """The terminal: columns and rows, None where there is none."""

    size: tuple[int, int] | None
    kind: str
    encoding: str
    colour_refused: bool = False


def worst(checks: Sequence[CheckResult]) -> State:
    """Return the worst state of all."""
    order: tuple[State, ...] = ("ok", "warn", "bad")
    return max((check.state for check in checks), key=order.index, default="ok")


def check_settings(path: Path | None, error: str | None) -> CheckResult:
    """Judge the settings file: `error` is what is wrong in it."""
    if error is not None:
        what = "correct that line" if re.search(r":\d+: ", error) else "give another with --config"
        return CheckResult("settings", "bad", error, (f"{what}; what follows is without the file",))
    if path is None:
        return CheckResult("settings", "ok", "no sattrack.toml: options and built-in values are in force")
    return CheckResult("settings", "ok", f"{path} is in force")


def check_site(site: Site | None, error: str | None) -> CheckResult:
    """Judge where the mount stands."""
    ways = ("give --site LAT,LON,HEIGHT, or run `sattrack init`",)
    if error is not None:
        return CheckResult("site", "bad", error, ways)
    if site is None:
        return CheckResult("site", "warn", "none is set: only practice with --mount sim is possible", ways)
    where = f"{site.latitude_deg:.5f}° north, {site.longitude_deg:.5f}° east, {site.height_m:.0f} m"
    return CheckResult("site", "ok", where)


def check_elements(facts: ElementFacts, now_utc_s: float) -> CheckResult:
    """Judge the elements by their number, their age and what was refused."""
    if facts.error is not None:
        return CheckResult(
            "elements", "bad", facts.error, ("name a source that can be read with --elements",)
        )
    if not facts.sources:
        what = "none are set: only practice with --mount sim is possible"
        if facts.fetched_by_name:
            what = "none are set: those of a satellite that is named are fetched from CelesTrak"
        ways = (
            "give --elements FILE, or set elements in sattrack.toml; `sattrack elements get` fetches them",
        )
        return CheckResult("elements", "warn", what, ways)
    refusal = "" if not facts.refused else f", {facts.refused} refused, the first: {facts.first_refusal}"
    if not facts.epochs_utc_s:
        ways = ("`sattrack elements check` says what is wrong with each",)
        return CheckResult(
            "elements", "bad", f"no set in {', '.join(facts.sources)} can be used{refusal}", ways
        )
    newest_s, oldest_s = max(facts.epochs_utc_s), min(facts.epochs_utc_s)
    ages = [(now_utc_s - epoch_s) / DAY_S for epoch_s in facts.epochs_utc_s]
    old = sum(abs(age) > OLD_ELEMENTS_DAYS for age in ages)
    epochs = [Utc(epoch_s).isoformat("seconds") for epoch_s in sorted({oldest_s, newest_s})]
    what = (
        f"{len(ages)} {'object' if len(ages) == 1 else 'objects'}, "
        f"{'epoch' if len(epochs) == 1 else 'epochs'} {' to '.join(epochs)}, "
        f"the newest {formatting.old(now_utc_s - newest_s)}, "
        f"{old} more than {OLD_ELEMENTS_DAYS:g} days off{refusal}"
    )
    todo: list[str] = []
    if old == len(ages):
        best = f": expect {arcsec(min(facts.along_arcsec))} along track" if facts.along_arcsec else ""
        do = how_to_renew(facts.sources, facts.only_number)
        todo.append(f"{do}{best}{' at best' if len(ages) > 1 else ''}")
    if facts.refused:
        todo.append("`sattrack elements check` says what is wrong with those refused")
    return CheckResult("elements", "warn" if todo else "ok", what, tuple(todo))


def check_earth(age: EarthOrientationAge | None, error: str | None) -> CheckResult:
    """Judge the Earth orientation for the instant that is now."""
    ways = ("update the package: pip install --upgrade astropy-iers-data",)
    if age is None or age.observed_until is None or age.predicted_until is None or age.age_s is None:
        return CheckResult("earth", "bad", error or "no table of the Earth's orientation", ways)
    observed, predicted = (at.isoformat("seconds")[:10] for at in (age.observed_until, age.predicted_until))
    what = f"{age.status} today; table observed to {observed}, predicted to {predicted}"
    if age.status == "extrapolated":
        return CheckResult("earth", "bad", f"{what}: directions may be off by seconds of arc", ways)
    if age.status == "predicted" and age.age_s > OLD_ORIENTATION_DAYS * DAY_S:
        text = f"{what}: {age.age_s / DAY_S:.0f} days of prediction may be off by tenths of an arcsecond"
        return CheckResult("earth", "warn", text, ways)
    return CheckResult("earth", "ok", what)


def check_clock(clock: KernelClock | None) -> CheckResult:
    """Judge the machine's clock: time is pointing."""
    scale = f"1 ms is {ARCSEC_PER_MS:g}″ on a target at 1°/s"
    ways = (
        "run chrony (or another NTP or PTP daemon), a receiver for GNSS time beside it where there is one; "
        "`chronyc tracking` says how it does",
    )
    if clock is None:
        return CheckResult("clock", "warn", f"this system does not say how good its clock is; {scale}", ways)
    if not clock.synchronised:
        return CheckResult(
            "clock", "warn", f"nothing disciplines it, so its error is not known; {scale}", ways
        )
    what = (
        f"synchronised, error {1e3 * clock.estimated_error_s:.3g} ms by estimate, "
        f"{1e3 * clock.largest_error_s:.3g} ms at most; {scale}"
    )
    poor = clock.estimated_error_s > POOR_CLOCK_S
    return CheckResult("clock", "warn" if poor else "ok", what, ways if poor else ())


def check_priority(grant: Grant, ways: Sequence[str]) -> CheckResult:
    """Judge whether the loop that feeds the mount goes before everything else."""
    if grant.priority is not None:
        return CheckResult("priority", "ok", f"real-time priority {grant.priority} is granted")
    why = "; ".join(text for text in grant.refusals if "memory" not in text) or "not granted"
    return CheckResult("priority", "warn", f"{why}; on a busy machine datagrams go out late", tuple(ways))


def check_memory(grant: Grant, ways: Sequence[str]) -> CheckResult:
    """Judge whether the loop's memory stays in memory."""
    if grant.memory_locked:
        return CheckResult("memory", "ok", "can be locked: the loop never waits for a page from the disk")
    why = "; ".join(text for text in grant.refusals if "memory" in text) or "not locked"
    return CheckResult("memory", "warn", why, tuple(ways) if grant.realtime else ("as for the priority",))


def check_terminal(facts: TerminalFacts) -> CheckResult:
    """Judge what the terminal screen will look like."""
    if facts.size is None:
        return CheckResult("terminal", "ok", "none here: runs tell their progress in lines")
    columns, rows = facts.size
    colours = "no colours, as NO_COLOR asks" if facts.colour_refused else f"TERM={facts.kind or '(not set)'}"
    what = f"{columns} × {rows}, {facts.encoding}, {colours}"
    todo: list[str] = []
    if columns < LEAST_COLUMNS or rows < LEAST_ROWS:
        todo.append(f"make it {LEAST_COLUMNS} × {LEAST_ROWS} or larger")
    if facts.encoding.lower().replace("-", "") != "utf8":
        todo.append("set a UTF-8 locale (LANG=C.UTF-8): the screen draws with Unicode")
    if facts.kind in ("", "dumb"):
        todo.append("set TERM to what the terminal is, or use --headless")
    return CheckResult("terminal", "warn" if todo else "ok", what, tuple(todo))


def check_extras(installed: Mapping[str, bool]) -> CheckResult:
    """Judge the optional parts; only the terminal screen is missed in every run."""
    missing = [name for name in EXTRAS if not installed.get(name, False)]
    if not missing:
        return CheckResult("extras", "ok", f"all installed: {', '.join(EXTRAS)}")
    what = "not installed: " + ", ".join(f"{name} ({EXTRAS[name][0]})" for name in missing)
    wanted = "tui" if "tui" in missing else missing[0] if len(missing) == 1 else "NAME,NAME"
    ways = (how_to_install(wanted),)
    return CheckResult("extras", "warn" if "tui" in missing else "ok", what, ways)


def check_profile(
    path: str | None, profile: MountProfile | None, error: str | None, real: bool
) -> CheckResult:
    """Judge the mount's profile; `real` where a real mount is set."""
    ways = ("`sattrack mount calibrate` measures the mount and writes a profile",)
    if profile is None:
        return CheckResult(
            "profile", "bad", error or "cannot be read", ("correct the file, or measure it again",)
        )
    record = profile.calibration
    name = profile.name if path is None else f"{profile.name} ({path})"
    if record is None:
        unknown = f"signs, gains, delays and MoveAxis semantics ({profile.move_axis})"
        if profile.geometry is not None:
            unknown = f"its geometry is {profile.geometry.kind}; gains, delays and MoveAxis semantics"
            ways = ("`sattrack track --learn-profile FILE` learns lags and gains during a pass",)
        what = (
            f"{name}, uncalibrated: {unknown} are not measured; 20 ms of delay are "
            f"{20.0 * ARCSEC_PER_MS:g}″ on a target at 1°/s"
        )
        return CheckResult("profile", "warn" if real else "ok", what, ways if real else ())
    what = (
        f"{name}: calibrated {record.utc}, {record.side_of_pier.replace('_', ' ')} side"
        f"{' and the other' if record.both_sides else ''}; MoveAxis is {profile.move_axis}, "
        f"delays {1e3 * profile.command_delay_s:.1f} ms out and {1e3 * profile.status_delay_s:.1f} ms back"
    )
    return CheckResult("profile", "ok", what)


def check_link(
    mount: str, health: LinkHealth | None, listened_s: float, error: str | None, advice: str = ""
) -> CheckResult:
    """Judge the link by what came while nothing was sent; `health` None where nobody listened.

    `advice` is what to check where nothing came.
    """
    if error is not None:
        return CheckResult("link", "bad", error)
    if health is None:
        return CheckResult("link", "ok", f"{mount}: nothing to listen to")
    if health.received == 0:
        beside = f", {health.rejected} datagrams that are no status" if health.rejected else ""
        beside += f", {health.strangers} from other hosts" if health.strangers else ""
        ways = (f"{advice or 'check that the mount is on and sends here'}; is there a firewall between?",)
        return CheckResult("link", "bad", f"{mount}: no status within {listened_s:g} s{beside}", ways)
    rate = "" if health.rate_hz is None else f", {health.rate_hz:.1f} a second"
    jitter_ms = None if health.jitter_s is None else 1e3 * health.jitter_s
    jitter = "" if jitter_ms is None else f", uneven by {jitter_ms:.1f} ms"
    what = (
        f"{mount}: {health.received} statuses{rate}{jitter}; {health.lost} lost, {health.late} late, "
        f"{health.rejected} rejected, {health.strangers} from other hosts"
    )
    todo: list[str] = []
    if health.lost or health.late:
        todo.append("use a wire and a switch of the mount's own: datagrams are lost or overtaken on the way")
    if jitter_ms is not None and jitter_ms > UNEVEN_MS:
        todo.append("look for what holds the mount's computer up, or the network")
    if health.rejected or health.strangers:
        todo.append("something else sends to this port: give the mount one of its own")
    if health.trouble is not None:
        todo.append(health.trouble)
    return CheckResult("link", "warn" if todo else "ok", what, tuple(todo))


def check_disk(folder: Path, free_bytes: float | None, writable: bool) -> CheckResult:
    """Judge the folder that recordings would go to; `free_bytes` None where it cannot be asked."""
    if free_bytes is None:
        return CheckResult("disk", "bad", f"{folder}: no such folder", ("give another with --record-folder",))
    if not writable:
        return CheckResult(
            "disk", "warn", f"{folder}: cannot be written", ("record elsewhere: --record FILE",)
        )
    what = f"{folder}: {free_bytes / 1e9:.1f} GB free for recordings"
    if free_bytes < LITTLE_SPACE_BYTES:
        state: State = "bad" if free_bytes < NO_SPACE_BYTES else "warn"
        return CheckResult("disk", state, what, ("make room, or record elsewhere: --record FILE",))
    return CheckResult("disk", "ok", what)


class DoctorReport(msgspec.Struct, frozen=True):
    """What `--json` prints."""

    worst: State
    checks: list[CheckResult]


class _PatientCommand(click.Command):
    """Runs without the settings file where that is wrong, and keeps what is wrong with it."""

    def invoke(self, ctx: click.Context) -> Any:
        """Read the settings first, only to see whether they can be read."""
        try:
            ctx.meta[__name__] = find_settings_file(ctx.params["config"]), None
            read_settings(ctx.params["config"])
        except SattrackError as error:
            ctx.meta[__name__] = ctx.params["config"], str(error)
            ctx.params["config"] = Path(os.devnull)
        return super().invoke(ctx)


@click.command("doctor", cls=_PatientCommand)
@click.option(
    "--mount",
    "mount_url",
    metavar="URL",
    help="Listen to this mount: xerxes://HOST:PORT?listen=PORT, alpaca://HOST:PORT/DEVICE or "
    "indi://HOST:PORT/DEVICE.",
)
@profile_option
@click.option(
    "--record-folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Where recordings will go; default: the current folder.",
)
@common_options("site", "elements", "clock", "json", "utc")
def command(context: CommandContext, **options: Any) -> int:
    """Report what is in order, what is not, and what to do. Nothing is sent to the mount; nothing is changed.

    Exits with 1 if something is bad.

    \b
    Examples:
      sattrack doctor
      sattrack doctor --mount sim --json
    """
    checks: list[CheckResult] = []
    for check in _checks(context, options):
        checks.append(check)
        if not context.json:
            _tell(check)
    if context.json:
        click.echo(msgspec.json.encode(DoctorReport(worst(checks), checks)).decode())
    return 1 if worst(checks) == "bad" else 0


def _tell(check: CheckResult) -> None:
    state = click.style(f"{check.state:<4}", fg=COLOURS[check.state])
    what = printable(local_time.localised(check.what), "\n")
    click.echo(f"{state}  {check.subject:<9} {what}", color=may_colour())
    for way in check.do:
        say(f"{'':<16}→ {way}")


def _checks(context: CommandContext, options: dict[str, Any]) -> Iterator[CheckResult]:
    path, settings_error = click.get_current_context().meta[__name__]
    yield check_settings(path, settings_error)
    yield _check_site(context)
    now = context.now()
    yield check_elements(_element_facts(context, now), float(now.unix_s))
    yield _check_earth(now)
    yield check_clock(read_kernel_clock())
    with undisturbed() as grant:
        # Asked for and given back at once: nothing else tells for certain what a run will get.
        pass
    ways = how_to_grant(_user()) if sys.platform.startswith("linux") else ()
    yield check_priority(grant, ways)
    yield check_memory(grant, ways)
    yield check_terminal(_terminal_facts())
    yield check_extras(
        {
            name: all(importlib.util.find_spec(module) is not None for module in modules)
            for name, (_, *modules) in EXTRAS.items()
        }
    )
    yield from _check_mount(context, options["mount_url"] or context.settings.mount.url, options["profile"])
    yield _check_disk(options["record_folder"])


def _check_site(context: CommandContext) -> CheckResult:
    if not context.has_site():
        return check_site(None, None)
    try:
        return check_site(context.site(), None)
    except (SattrackError, TleError) as error:
        return check_site(None, str(error))


def _element_facts(context: CommandContext, now: Utc) -> ElementFacts:
    sources = context.sources()
    if not sources:
        return ElementFacts((), fetched_by_name=context.settings.fetch_by_name)
    try:
        sets = context.load(sources)
    except (SattrackError, TleError) as error:
        return ElementFacts(sources, error=str(error))
    known = newest(sets.accepted, now)
    return ElementFacts(
        sources,
        epochs_utc_s=tuple(float(elements.epoch.unix_s) for elements in known),
        along_arcsec=tuple(expected_along_arcsec(elements, now) for elements in known),
        refused=len(sets.rejected),
        only_number=known[0].catalog_number if len(known) == 1 else None,
        first_refusal=str(sets.rejected[0]).splitlines()[0] if sets.rejected else None,
    )


def _check_earth(now: Utc) -> CheckResult:
    try:
        return check_earth(earth_orientation_age(now), None)
    except (TleError, OSError) as error:
        return check_earth(None, str(error))


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


def _check_mount(context: CommandContext, url: str | None, explicit: Path | None) -> Iterator[CheckResult]:
    from sattrack.runtime.mounts import is_antenna

    real = url not in (None, "sim") and not is_antenna(url)
    configured = str(explicit) if explicit is not None else context.settings.mount.profile
    profile: MountProfile | None = None
    error = None
    try:
        profile = context.profile(explicit, url).mount
    except SattrackError as refusal:
        error = str(refusal)
    yield check_profile(configured, profile, error, real)
    if url is None:
        text = "no mount is set: with --mount, or [mount] url in sattrack.toml, its statuses are listened to"
        yield CheckResult("link", "ok", text)
        return
    if is_antenna(url):
        text = f"{url}: an antenna's controller is tried by `sattrack track` alone"
        yield CheckResult("link", "ok", text)
        return
    yield from _check_link(url, profile or MountProfile())


def _check_link(url: str, profile: MountProfile) -> Iterator[CheckResult]:
    # The session's modules are many; without a mount they are not needed.
    from sattrack.runtime.mounts import LISTEN_S, listen, mount_address
    from sattrack.runtime.turns import noted_axis_deg, trouble_before

    try:
        address = mount_address(url)
        health = None if address is None else listen(address, profile)
    except SattrackError as refusal:
        yield check_link(url, None, LISTEN_S, str(refusal))
        return
    yield check_link(url, health, LISTEN_S, None, "" if address is None else address.silence_advice)
    trouble = None if address is None else trouble_before(address.name, time.time())
    if trouble is not None:
        yield CheckResult("cables", "bad", f"{url} {trouble}")
        return
    wound_deg = None if address is None else noted_axis_deg(address.name)
    if wound_deg is not None:
        yield CheckResult("cables", "ok", f"{url} was left with its first axis at {wound_deg:.0f}°")


def _check_disk(folder: Path) -> CheckResult:
    absolute = folder.absolute()
    try:
        free_bytes = float(shutil.disk_usage(absolute).free) if absolute.is_dir() else None
    except OSError:
        free_bytes = None
    return check_disk(absolute, free_bytes, os.access(absolute, os.W_OK))


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "YOU"

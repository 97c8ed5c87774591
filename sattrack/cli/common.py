"""The options of every command, what they resolve to, and what the shell completes them to."""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.output import WRITTEN, renew, tell
from sattrack.core import local_time
from sattrack.core.clock import Clock, make_clock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.toml_text import line_of_key, read_toml
from sattrack.settings import (
    NO_ELEMENTS,
    NO_SITE,
    Settings,
    UnseenSettingsError,
    find_settings_file,
    load_settings,
    whose_settings,
)
from tle.errors import SourceError, TleError
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from click.shell_completion import CompletionItem

    from sattrack.elements.downloads import Downloads
    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.simulator.profile import SimulatorProfile
    from sattrack.runtime.mounts import MountAddress
    from tle.elements import Elements
    from tle.instants import Utc
    from tle.sources import ElementSets


@dataclass(frozen=True, slots=True)
class CommandContext:
    """What the common options and the settings file say, options first."""

    settings: Settings
    site_option: str | None
    element_sources: tuple[str, ...]
    clock_option: str | None
    json: bool
    debug: bool
    settings_file: Path | None = None
    utc: bool = False
    """Whether people read times in UTC, whatever zone the settings name."""

    def has_site(self) -> bool:
        """Tell whether a site was given anywhere."""
        return self.site_option is not None or self.settings.site is not None

    def site(self) -> Site:
        """Return the site; raises BadInputError where none is set or it is out of range."""
        if self.site_option is not None:
            return Site.parse(self.site_option)
        if self.settings.site is not None:
            return self.settings.site.place()
        where = "" if self.settings_file else f"; there is no sattrack.toml in {Path.cwd()}"
        raise BadInputError(f"{NO_SITE}{where}")

    def known_elements(self) -> Callable[[], list[Elements]]:
        """Return what reads all element sources, when it is first called, and none where none is set."""
        return functools.cache(lambda: self.elements() if self.sources() else [])

    def sources(self) -> tuple[str, ...]:
        """Return the element sources: the options', else the settings file's."""
        return self.element_sources or self.settings.elements

    def elements(self, *satellites: str) -> list[Elements]:
        """Read all element sources, the epoch of an object that is nearest to now winning.

        Where none is set, the named satellites are fetched one by one from CelesTrak.
        Sets that are refused beside good ones are named on standard error. Raises BadInputError, TleError.
        """
        from tle.sources import newest

        if not self.sources():
            return newest(self.fetched(satellites))
        return newest([one for _, accepted in self.load_each() for one in accepted], self.now())

    def load_each(self) -> list[tuple[str, list[Elements]]]:
        """Read each element source; sets that are refused beside good ones are named on standard error.

        Raises TleError, SattrackError.
        """
        from tle.sources import ElementSets

        loaded, sets = [], ElementSets()
        for source in self.sources():
            one = self.load([source])
            loaded.append((source, one.accepted))
            sets.accepted.extend(one.accepted)
            sets.rejected.extend(one.rejected)
        if sets.rejected and not sets.accepted:
            raise sets.rejected[0]
        if sets.rejected:
            first = str(sets.rejected[0]).splitlines()[0]
            tell(f"{_refused_text(sets)}, the first: {first}")
        return loaded

    def fetched(self, satellites: Sequence[str], renewing: bool = False) -> list[Elements]:
        """Return elements of satellites as CelesTrak has them; raises BadInputError where that cannot be.

        `renewing`: the user asks for a download.
        """
        if not satellites or not (renewing or self.settings.fetch_by_name):
            raise BadInputError(NO_ELEMENTS)
        from sattrack.elements.downloads import DownloadError

        downloads = _downloads(renewing)
        try:
            return [one for key in satellites for one in downloads.fetch_satellite(key)]
        except DownloadError as error:
            raise BadInputError(str(error)) from error

    def load(self, sources: Sequence[str], renewing: bool = False) -> ElementSets:
        """Read element sources, good sets and refused ones; notes on them go to standard error.

        Files, folders, - for standard input, URLs, and the short names celestrak:... and spacetrack:...
        `renewing`: the user asks for new ones; where kept ones must do, a note says so.
        Raises TleError, SattrackError.
        """
        from tle.sources import load_elements

        try:
            sets = load_elements(*sources, fetch=_fetcher(renewing))
        except (SourceError, BadInputError) as error:
            if self.element_sources or self.settings_file is None or not set(sources) <= set(self.sources()):
                raise
            raise type(error)(self.by_settings("elements", error)) from None
        for note in sets.notes:
            tell(note)
        return sets

    def profile(self, explicit: Path | None, mount_url: str | None = None) -> ProfileFile:
        """Return the mount's profile: the option's, else the settings file's, else the usual one of its kind.

        Raises BadInputError, naming file, line and key.
        """
        from sattrack.mount.profiles import load_profile_file, profile_file
        from sattrack.runtime.mounts import dated_as, usual_profile

        configured = self.settings.mount.profile
        path = explicit if explicit is not None or configured is None else Path(configured)
        url = mount_url or self.settings.mount.url
        if path is None:
            return profile_file(usual_profile(url))
        try:
            described = load_profile_file(path)
            # What only a simulated mount needs is refused here, where the file's name is known.
            load_simulator_profile(path)
            return dated_as(described, url)
        except BadInputError as error:
            if explicit is not None:
                raise
            raise BadInputError(self.by_settings("profile", error)) from None

    def profile_to_stop(self, explicit: Path | None, mount_url: str | None = None) -> ProfileFile:
        """Return the mount's profile; where that is refused, the usual one: no file keeps a mount moving."""
        from sattrack.mount.profiles import profile_file
        from sattrack.runtime.mounts import usual_profile

        try:
            return self.profile(explicit, mount_url)
        except BadInputError as error:
            tell(f"{error}; going on without the profile")
            return profile_file(usual_profile(mount_url or self.settings.mount.url))

    def by_settings(self, key: str, error: Exception) -> str:
        """Return an error's text after where the settings name what it is about."""
        file = self.settings_file
        return str(error) if file is None else f"{file}{line_of_key(file, key)}: {key}: {error}"

    def clock(self) -> Clock:
        """Return the clock to run by, the simulated one started now."""
        return make_clock(self.clock_option)[0]

    def now(self) -> Utc:
        """Return the instant that is now by the clock in force."""
        return make_clock(self.clock_option)[1]

    def mount(self, option: str | None) -> tuple[str | None, MountAddress | None]:
        """Return the mount's URL, by the option, else the settings, and its address; None: a simulated mount.

        Raises BadInputError for a URL that is none, and for --clock with a real mount.
        """
        from sattrack.runtime.mounts import mount_address

        url = option or self.settings.mount.url
        address = mount_address(url)
        if address is not None and self.clock_option is not None:
            raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
        return url, address


def read_settings(explicit: Path | None) -> Settings:
    """Return the settings in force; raises BadInputError also where they name what can be no mount."""
    settings = load_settings(explicit)
    path = find_settings_file(explicit)
    if path is not None and settings.mount.url not in (None, "sim"):
        from sattrack.runtime.mounts import check_setting

        check_setting(path, settings.mount.url)
    return settings


def given_instant(option: str, text: str) -> Utc:
    """Return the instant of an option; tells what one without a zone means in local time.

    Raises BadInputError.
    """
    from tle.instants import Utc, has_zone

    try:
        at = Utc.parse(text)
    except TleError as error:
        raise BadInputError(f"{option}: {error}") from None
    utc_s = float(at.unix_s)
    if not has_zone(text) and local_time.offset_s(utc_s):
        here = local_time.instant(utc_s)
        tell(f"{option} {text}: is UTC, {here} here; with a zone after it, as +02:00, it is local time")
    return at


def given_utc_s(option: str, text: str | None, otherwise: float | None = None) -> float | None:
    """Return the instant of an option as POSIX seconds, or what holds without it. Raises BadInputError."""
    return otherwise if text is None else float(given_instant(option, text).unix_s)


def load_simulator_profile(path: Path) -> SimulatorProfile:
    """Return what `[simulator]` of a profile file says. Raises BadInputError, naming file, line and key."""
    from sattrack.mount.simulator.profile import SimulatorPart

    return read_toml(path, SimulatorPart, "the mount profile").simulator


def _refused_text(sets: ElementSets) -> str:
    """Return how many element sets were refused, and how many files hold none."""
    from tle.errors import FormatError

    empty = sum(isinstance(error, FormatError) and error.line is None for error in sets.rejected)
    refused = len(sets.rejected) - empty
    parts = [f"{empty} {'file holds' if empty == 1 else 'files hold'} no element sets"] if empty else []
    if refused:
        parts.append(f"{refused} of {refused + len(sets.accepted)} element sets refused")
    return " and ".join(parts)


def how_to_renew(sources: Sequence[str], catalog_number: int | None = None) -> str:
    """Return how to get newer elements than those of some sources, of one satellite or of many."""
    from tle.sources import is_fetched

    if all(is_fetched(source) for source in sources):
        return "fetch new ones (`sattrack elements get`)"
    wanted = "celestrak:GROUP" if catalog_number is None else catalog_number
    return f"fetch new ones: `sattrack elements get {wanted} --output new.csv`, then give --elements new.csv"


def check_writable(path: Path, what: str) -> None:
    """Raise BadInputError or OSError for a file that cannot be written; `what` names it."""
    folder = path.absolute().parent
    if path.is_dir():
        raise BadInputError(f"{what}: is a folder; give a file")
    if not folder.is_dir():
        raise BadInputError(f"{what}: there is no folder {folder}; make it first")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


class OutputFile(click.Path):
    """A file that a command writes: what will keep it from being written is reported before the work.

    `new`: there must be no such file yet; `endings`: its name ends in one of them, if in any.
    """

    def __init__(self, new: bool = False, endings: Sequence[str] = ()) -> None:
        super().__init__(path_type=Path)
        self.name = "file"
        self._new, self._endings = new, endings

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; raises BadInputError, OSError."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if ctx is not None and ctx.resilient_parsing:
            return path
        what = f"{param.opts[0]} {path}" if isinstance(param, click.Option) else f"{path}"
        if path.exists() and self._new and not path.is_dir():
            raise BadInputError(f"{what}: exists already; give another name")
        check_writable(path, what)
        if path.suffix and self._endings and path.suffix.lower() not in self._endings:
            raise BadInputError(f"{what}: its ending is unknown; give one of {', '.join(self._endings)}")
        return path


PLOT_ENDINGS = (".png", ".svg", ".pdf", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".eps", ".ps")
PLOT = OutputFile(endings=PLOT_ENDINGS)


def _downloads(renewing: bool = False) -> Downloads:
    from sattrack.elements.downloads import Downloads

    return Downloads(tell, _show_progress if sys.stderr.isatty() else None, renewing=renewing)


def _fetcher(renewing: bool) -> Callable[[str], str]:
    """Return what fetches URLs; the network's modules are imported when the first is asked for."""
    downloads: list[Downloads] = []

    def fetch(source: str) -> str:
        if not downloads:
            downloads.append(_downloads(renewing))
        return downloads[0].fetch(source)

    return fetch


def _show_progress(source: str, count: int | None) -> None:
    """Show on the terminal how much of a download has come; None wipes it away."""
    renew("" if count is None else f"{source}: {count / 1e6:.1f} MB")


profile_option = click.option(
    "--profile", type=click.Path(path_type=Path), metavar="FILE", help="The mount's profile (TOML)."
)
fov_option = click.option(
    "--fov",
    "fov_deg",
    type=float,
    metavar="DEG",
    help="Diameter of the camera's field of view, shown with the expected error.",
)


def refraction_option(text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option that says whether directions are raised by the air's refraction."""
    modes = click.Choice(("auto", "on", "off"))
    return click.option("--refraction", type=modes, default="auto", show_default=True, help=text)


def bias_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a run about observations and the camera that makes them."""
    for option in (
        click.option(
            "--bias-memory",
            type=click.Choice(("auto", "on", "nudge", "off")),
            default="auto",
            show_default=True,
            help="Start with the bias that earlier passes found for the same elements, and keep the new one: "
            "auto for real mounts, on for simulated ones too, nudge also for an operator's nudge, or off.",
        ),
        click.option(
            "--observations",
            metavar="SOURCE",
            help="Read observed directions of the satellite as JSON lines: udp:PORT (of this machine) or "
            "stdin.",
        ),
        click.option(
            "--search-lost",
            is_flag=True,
            help="Search by itself where the satellite is lost and may be out of the camera's field.",
        ),
        click.option(
            "--flip",
            "--camera-flip",
            "camera_flip",
            cls=RenamedOption,
            is_flag=True,
            help="The camera's image is mirrored.",
        ),
        click.option(
            "--rotation",
            "--camera-rotation",
            "camera_rotation",
            cls=RenamedOption,
            type=float,
            metavar="DEG",
            help="Position angle of the camera's y axis, from north through east; 0 unless the settings say "
            "so.",
        ),
    ):
        function = option(function)
    return function


def stream_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a run that another program watches and leads."""
    function = click.option(
        "--control",
        is_flag=True,
        help="Read messages as JSON lines from standard input; its end stops the mount.",
    )(function)
    return click.option(
        "--stream", is_flag=True, help="Write views as JSON lines to standard output, ten a second."
    )(function)


SHARED = ("site", "elements", "clock", "json", "utc")
"""The options that a command takes if they mean something there."""


def common_options(*used: str, goes_on: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add --config, --debug and the shared options; the function's first argument becomes a CommandContext.

    `used` are those of SHARED that mean something to the command. Scripts may give the others too: they are
    accepted if they could be right, hidden, and do nothing. With `goes_on`, wrong settings are reported, and
    the built-in ones hold. So they do where no settings can be looked for, for commands that move no mount.
    """

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        @click.option("--config", type=click.Path(path_type=Path), help="Settings file.")
        @click.option(
            "--site",
            "site_option",
            metavar="LAT,LON,HEIGHT",
            hidden="site" not in used,
            help="Degrees north, degrees east, metres.",
        )
        @click.option(
            "--elements",
            "element_sources",
            multiple=True,
            metavar="SRC",
            hidden="elements" not in used,
            shell_complete=element_sources,
            help="File, folder or URL of elements, celestrak:GROUP, celestrak:NUMBER, celestrak-sup:GROUP, "
            "spacetrack:NUMBER, spacetrack:NUMBER@DAY or - (standard input).",
        )
        @click.option(
            "--clock",
            "clock_option",
            metavar="UTC[xSPEED]",
            hidden="clock" not in used,
            help="Run as if this were the current time; x10 after it runs ten times as fast.",
        )
        @click.option(
            "--json",
            "as_json",
            is_flag=True,
            hidden="json" not in used,
            help="JSON on standard output, messages on standard error.",
        )
        @click.option(
            "--utc",
            is_flag=True,
            hidden="utc" not in used,
            help="Times that people read in UTC, not in the local zone.",
        )
        @click.option("--debug", is_flag=True, help="Show tracebacks.")
        @functools.wraps(function)
        def wrapper(
            *,
            config: Path | None,
            site_option: str | None,
            element_sources: tuple[str, ...],
            clock_option: str | None,
            as_json: bool,
            utc: bool,
            debug: bool,
            **rest: Any,
        ) -> Any:
            found = None
            try:
                found = find_settings_file(config)
                if config is None and found is not None and (whose := whose_settings(found)) is not None:
                    tell(
                        f"{found.absolute()}: {whose}; it sets the mount and the limits: give --config FILE "
                        "to take another, or this one without a word"
                    )
                settings = read_settings(config)
            except BadInputError as error:
                moves = rest.get("mount_url", "sim") != "sim"
                if not goes_on and (moves or not isinstance(error, UnseenSettingsError)):
                    raise
                tell(f"{error}; going on without the settings")
                settings = Settings()
            local_time.use_zone("UTC" if utc else settings.zone)
            _check_unread(used, site_option, element_sources, clock_option)
            context = CommandContext(
                settings,
                site_option,
                element_sources,
                clock_option,
                as_json,
                debug,
                found,
                utc,
            )
            _keep_inputs(rest, [*element_sources, context.settings_file])
            named = (found, settings.safety.horizon, settings.mount.profile, rest.get("profile"))
            watch = SettingsWatch(config, [Path(path) for path in named if path is not None])
            result = function(context, **rest)
            text = watch.change()
            if text is not None:
                tell(text)
            return result

        return wrapper

    return add


def _check_unread(
    used: Sequence[str], site: str | None, element_sources: Sequence[str], clock: str | None
) -> None:
    """Raise BadInputError, SiteError for options that can mean nothing, of those that the command ignores."""
    if site is not None and "site" not in used:
        Site.parse(site)
    if clock is not None and "clock" not in used:
        make_clock(clock)
    for source in () if "elements" in used else element_sources:
        if ":" not in source and source != "-" and not Path(source).exists():
            raise BadInputError(f"--elements {source}: there is no such file; check name and folder")


def _keep_inputs(options: Mapping[str, Any], others: Iterable[Path | str | None]) -> None:
    """Raise BadInputError where a file to be written is one that the command reads; `others` are read too."""
    outputs = {
        one.name: one.opts[0]
        for one in click.get_current_context().command.params
        if isinstance(one.type, OutputFile) and options.get(one.name or "") is not None
    }
    given = [one for name, one in options.items() if name not in outputs]
    read = [*others, *(each for one in given for each in (one if isinstance(one, tuple) else (one,)))]
    for name, option in outputs.items():
        path = Path(options[name or ""])
        if any(_same_file(path, one) for one in read if isinstance(one, str | Path)):
            raise BadInputError(f"{option} {path}: this command reads that file; give another name")


def _same_file(one: Path, other: Path | str) -> bool:
    with contextlib.suppress(OSError, ValueError):
        return one.samefile(other)
    return False


MOST_COMPLETED_BYTES = 2_000_000
"""Larger files of elements are not read for a TAB."""
_SHORTEST_WORD = 4
USUAL_GROUPS = ("celestrak:stations", "celestrak:visual", "celestrak:active")


def satellite_names(ctx: click.Context, _: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the satellites that the shell may complete to, from local files and what was downloaded before.

    A name that a shell would split is offered as the catalogue number.
    """
    from click.shell_completion import CompletionItem

    from tle.sources import COMMON_NAMES, load_elements

    found: dict[str, str] = {}
    with contextlib.suppress(SattrackError, TleError, OSError):
        sources = ctx.params.get("element_sources") or load_settings(ctx.params.get("config")).elements
        for one in load_elements(*map(_at_hand, sources)).accepted:
            common = [_spoken(name) for name, number in COMMON_NAMES.items() if number == one.catalog_number]
            found |= dict.fromkeys((*common, one.name or "", str(one.catalog_number)), one.label)
    return [
        CompletionItem(key, help=name)
        for key, name in sorted(found.items())
        if re.fullmatch(r"[\w.+-]+", key) and key.casefold().startswith(incomplete.casefold())
    ]


def element_sources(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return what the shell may complete a source to: files, and where none begins so satellites."""
    from click.shell_completion import CompletionItem

    from tle.sources import COMMON_NAMES

    files = [CompletionItem(incomplete, type="file")]
    parent = Path(incomplete).parent
    name = incomplete.rpartition(os.sep)[2]
    with contextlib.suppress(OSError):
        if not incomplete or any(one.name.startswith(name) for one in parent.iterdir()):
            return files
    wanted = incomplete.casefold()
    known = [*USUAL_GROUPS]
    if isinstance(param, click.Argument):
        known += map(_spoken, COMMON_NAMES)
    return [CompletionItem(one) for one in known if one.casefold().startswith(wanted)] or files


def _spoken(common_name: str) -> str:
    """Return a name of COMMON_NAMES as people write it."""
    return common_name.upper() if len(common_name) < _SHORTEST_WORD else common_name.capitalize()


def _at_hand(source: str) -> str:
    """Return the text of a source that can be read at once, without the network; of others an empty line."""
    from tle.sources import is_fetched

    text = "\n"
    if is_fetched(source):
        from sattrack.elements.downloads import DownloadCache, query_of, user_cache_folder

        kept = DownloadCache(user_cache_folder(os.environ)).read(query_of(source, os.environ).url)
        text = "\n" if kept is None else kept.text
    elif Path(source).is_file() and Path(source).stat().st_size <= MOST_COMPLETED_BYTES:
        text = f"{Path(source).read_text(encoding='utf-8', errors='replace')}\n"
    return text if len(text) <= MOST_COMPLETED_BYTES else "\n"


class RenamedOption(click.Option):
    """An option of which help shows the first name only; scripts may use its former ones."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the name and the help."""
        names = self.opts
        try:
            self.opts = names[:1]
            return super().get_help_record(ctx)
        finally:
            self.opts = names


class SettingsWatch:
    """Remembers how the files stand from which settings came."""

    def __init__(self, config: Path | None, named: list[Path]) -> None:
        self._config = config
        self._before = {path: _stamp(path) for path in named}

    def change(self) -> str | None:
        """Return what to tell where others have changed a file, and None where all are as they were."""
        own = click.get_current_context().meta.get(WRITTEN, ())
        changed = [
            path
            for path, stamp in self._before.items()
            if _stamp(path) != stamp and Path(os.path.realpath(path)) not in own
        ]
        if not changed:
            return None
        names = ", ".join(str(path) for path in changed)
        kept = f"{names} changed during the run: the run kept the settings of its start"
        try:
            load_settings(self._config).safety.limits()
        except SattrackError as error:
            return f"{kept}; the next command will refuse them: {error}"
        return f"{kept}; the next command takes them"


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size


def mount_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add `--mount URL`, handed on as `mount_url`, which `runtime.mounts.mount_address` reads."""
    from sattrack.runtime.mounts import FORMS

    return click.option("--mount", "mount_url", metavar="URL", help=f"sim, {FORMS}; else as set.")(function)

"""`sattrack init`: ask for place, mount and elements, write sattrack.toml, and show tonight's passes."""

from __future__ import annotations

import csv
import gzip
import io
import json
import os
import re
import shlex
import sys
import textwrap
import unicodedata
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from sattrack.cli.common import CommandContext, OutputFile, element_sources, how_to_renew
from sattrack.cli.output import say, tell, write_file
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.local_time import is_zone
from sattrack.runtime.mounts import FORMS, LISTEN_S, is_antenna, listen, mount_address, usual_profile
from sattrack.settings import FILE_NAME, Settings, load_settings
from tle.errors import SourceError, TleError
from tle.instants import DAY_S
from tle.site import Site
from tle.sources import is_fetched

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.runtime.mounts import MountAddress
    from tle.elements import Elements
    from tle.instants import Utc

USUAL_ELEMENTS = "celestrak:stations"
USUAL_MOUNT = "sim"
LOCAL_TIME = "/etc/localtime"
"""The system's time zone, where TZ names no other."""
CENTRE_WARNING = (
    "The site is the middle of the city. 10 km away a satellite appears up to a degree elsewhere. For a real "
    "mount, write your own coordinates (a phone shows them) into the file."
)
HEIGHT = "Height above the sea in metres"
ELEMENTS = "Satellites: celestrak:stations, celestrak:visual, or a file of elements"
NEXT = "`sattrack rehearse SATELLITE` checks a pass, `sattrack track SATELLITE` follows it."
NEXT_WITHOUT_ELEMENTS = "`%s --elements FILE` with a file; `sattrack demo` needs none."
if sys.platform == "win32":
    NEXT_WITHOUT_ELEMENTS = "`%s --elements FILE` with a file."
FAMOUS = ("ISS", "Tiangong")
"""Of a long list of elements, whose passes are shown at the end."""
MOST_LISTED = 5
BRIGHT = ("--dark", "--sunlit", "--min-alt", "40")
"""Which passes are shown where none of these is among them."""
RIVAL_RANK = 3.0
"""Cities of a name count as of one size up to so many times the rank of the largest."""
_LEAST_MATCH, MOST_MEANT, LEAST_ALIKE = 3, 3, 0.75


class City(NamedTuple):
    """A city of the packaged list: degrees north and east, and its IANA time zone."""

    name: str
    country: str
    latitude_deg: float
    longitude_deg: float
    zone: str
    others: str = ""
    """What it is called elsewhere, with | between."""

    @property
    def place(self) -> str:
        """Say which city it is, and where."""
        where = _compass(self.latitude_deg, self.longitude_deg, 2)
        return f"{self.name}, {self.country}, {self.zone}: {where}"


@dataclass(frozen=True, slots=True)
class InitialSettings:
    """What `init` was answered, as it is written down."""

    site: Site
    zone: str
    mount_url: str
    elements: tuple[str, ...]
    place: str | None = None
    """Which city it is, where the site is the middle of one."""


@click.command("init")
@click.option("--site", "site_text", metavar="LAT,LON,HEIGHT", help="Degrees north, degrees east, metres.")
@click.option("--city", metavar="NAME", help="A city of 50,000 people or more, instead of --site.")
@click.option("--height", "height_m", type=float, metavar="M", help="Metres above the sea, with --city.")
@click.option("--zone", metavar="NAME", help="Time zone, as Europe/Amsterdam; the city's or the system's.")
@click.option("--mount", "mount_url", metavar="URL", help="sim, xerxes://…, alpaca://…; alpaca searches.")
@click.option(
    "--elements",
    "sources",
    multiple=True,
    metavar="SRC",
    shell_complete=element_sources,
    help="A file, or celestrak:GROUP.",
)
@click.option("--config", type=OutputFile(), help="The file to write (./sattrack.toml).")
@click.option("--yes", is_flag=True, help="Ask nothing: use the usual values for what no option gives.")
@click.option("--force", is_flag=True, help="Overwrite the file if there is one.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document on standard output.")
@click.option("--debug", is_flag=True, help="Show tracebacks.")
def command(**options: Any) -> int:
    """Ask where the telescope stands, which mount it has and which satellites to list; write sattrack.toml.

    Ends with tonight's passes. Every command run in the same folder reads the file.

    \b
    Examples:
      sattrack init
      sattrack init --yes --city Leiden --mount sim
      sattrack init --yes --site 52.15,4.49,6 --elements celestrak:visual
    """
    path = options["config"] or Path(FILE_NAME)
    if path.exists() and not options["force"]:
        raise BadInputError(f"{path}: exists already; --force overwrites it, --config names another file")
    ask = None if options["yes"] else _ask
    answers, failure = _with_elements(collected(options, ask), None if options["sources"] else ask)
    write_file(path, settings_text(answers, path))
    load_settings(path)
    note = _mount_note(answers)
    if not options["as_json"]:
        everywhere = "Every command in this folder reads it"
        readers = everywhere if path == Path(FILE_NAME) else f"Commands read it with --config {path}"
        say(f"{path} is written. {readers}; change it with any editor.")
        tell(answers.place or f"the site is at {_site_text(answers.site)}")
        if answers.place is not None:
            tell(CENTRE_WARNING)
        if note is not None:
            tell(note)
    passes, too_old = _tonight(path, options["as_json"], failure)
    if not options["as_json"]:
        following = NEXT if passes is not None else NEXT_WITHOUT_ELEMENTS % _again(answers)
        say(f"\nNext: {too_old or following}")
    else:
        site = answers.site
        document = {
            "settings": str(path),
            "site": [site.latitude_deg, site.longitude_deg, site.height_m],
            "zone": answers.zone,
            "mount": answers.mount_url,
            "mount_note": note,
            "elements": list(answers.elements),
            "passes": passes,
        }
        click.echo(json.dumps(document, allow_nan=False))
    return 0


def collected(options: dict[str, Any], ask: Callable[..., str] | None) -> InitialSettings:
    """Return the answers: the options', else those given to `ask`, else the usual ones.

    `ask` takes a question, the usual answer, and a check that raises for an answer that cannot be; it is None
    where nobody must be asked. Raises BadInputError, SiteError.
    """
    city = None if options["city"] is None else _chosen_city(options["city"], ask)
    site = None if options["site_text"] is None else Site.parse(options["site_text"])
    if city is not None and site is not None:
        raise BadInputError("--site and --city: give one of them")
    if city is None and site is None:
        if ask is None:
            raise BadInputError("no site: give --site LAT,LON,HEIGHT or --city NAME")
        answer = ask("Where is the telescope? LAT,LON,HEIGHT (degrees, metres), or a city", None, place_of)
        city, site = place_of(answer)
        city = city and _chosen_city(answer, ask)
        if site is not None and answer.count(",") == 1:
            site = replace(site, height_m=float(ask(HEIGHT, "0", _height_m)))
    height_m = options["height_m"]
    if city is not None:
        if height_m is None:
            height_m = float(ask(f"{HEIGHT}; the list of cities has none", "0", _height_m)) if ask else 0.0
        site = Site(city.latitude_deg, city.longitude_deg, height_m).on_ground()
    elif height_m is not None:
        raise BadInputError("--height goes with --city; --site has the height as its third number")
    assert site is not None
    zone = options["zone"] or (city.zone if city else None)
    if zone is None:
        usual = _system_zone()
        zone = ask("Time zone", usual, _zone) if ask else usual
    mount_url = options["mount_url"]
    if mount_url is None:
        question = f"Mount: sim (simulated), {FORMS}, or alpaca to search"
        mount_url = _answered_mount(ask, question) if ask else USUAL_MOUNT
    sources = options["sources"]
    if not sources:
        sources = (ask(ELEMENTS, USUAL_ELEMENTS, _source) if ask else USUAL_ELEMENTS,)
    for source in sources:
        _source(source)
    return InitialSettings(
        site, _zone(zone), _found_mount(_mount(mount_url)), tuple(sources), _place(city, ask is None)
    )


def _with_elements(
    answers: InitialSettings, ask: Callable[..., str] | None
) -> tuple[InitialSettings, str | None]:
    """Return the answers after fetching elements, and why that failed, if it did.

    Where there are none of that name, `ask` asks for others. Raises BadInputError where it is None.
    """
    from sattrack.elements.downloads import NothingThereError

    while True:
        try:
            CommandContext(Settings(), None, (), None, False, False).load(answers.elements)
        except NothingThereError as error:
            if ask is None:
                raise BadInputError(f"{error}; nothing is written") from error
            say(f"  {error}", err=True)
            answers = replace(answers, elements=(ask(ELEMENTS, USUAL_ELEMENTS, _source),))
        except (SattrackError, TleError) as error:
            return answers, str(error)
        else:
            return answers, None


def _compass(latitude_deg: float, longitude_deg: float, decimals: int) -> str:
    north, east = "south" if latitude_deg < 0 else "north", "west" if longitude_deg < 0 else "east"
    return f"{abs(latitude_deg):.{decimals}f}° {north}, {abs(longitude_deg):.{decimals}f}° {east}"


def _site_text(site: Site) -> str:
    return f"{_compass(site.latitude_deg, site.longitude_deg, 4)}, {site.height_m:g} m above the ellipsoid"


def _again(answers: InitialSettings) -> str:
    """Return the command line that writes the same settings anew, but for the elements."""
    site = answers.site
    place = f"{site.latitude_deg},{site.longitude_deg},{site.height_m}"
    given = ["--site", place, "--zone", answers.zone, "--mount", answers.mount_url, *_file_option()]
    return f"sattrack init --force --yes {shlex.join(given)}"


def _without_asking() -> str:
    """Return this command line as it would have to be to ask nothing."""
    given = click.get_current_context().params
    options = [("--site", given["site_text"]), ("--city", given["city"]), ("--height", given["height_m"])]
    options += [("--zone", given["zone"]), ("--mount", given["mount_url"])]
    options += [("--elements", source) for source in given["sources"]]
    if given["site_text"] is None and given["city"] is None:
        options.insert(0, ("--site", "LAT,LON,HEIGHT"))
    words = [word for name, value in options if value is not None for word in (name, str(value))]
    words += [*_file_option(), *(["--force"] if given["force"] else [])]
    return f"sattrack init --yes {shlex.join(words)}"


def _file_option() -> list[str]:
    """Return the option that names the file to write, where one was given."""
    file = click.get_current_context().params["config"]
    return [] if file is None else ["--config", str(file)]


def _ask(question: str, usual: str | None, check: Callable[[str], object]) -> str:
    """Ask until the answer can be one; the end of standard input ends the command with nothing written."""
    while True:
        try:
            answer = str(click.prompt(question, default=usual, err=True)).strip()
        except click.Abort:
            click.echo(err=True)
            raise BadInputError(
                f"no answer: nothing is written; `{_without_asking()}` asks nothing"
            ) from None
        try:
            check(answer)
        except (SattrackError, TleError) as error:
            say(f"  {error}", err=True)
        else:
            return answer


def place_of(text: str) -> tuple[City | None, Site | None]:
    """Return the city or the site that a text names. Raises BadInputError, SiteError."""
    if any(c.isdigit() for c in text) and not _called(_cities(), text.partition(",")[0].strip()):
        return None, Site.parse(text)
    return find_cities(text)[0], None


def _chosen_city(name: str, ask: Callable[..., str] | None) -> City:
    """Return the city that a name means, the largest; of several of about one size, that answered."""
    found = find_cities(name)
    if ask is None:
        return found[0]
    if len(found) == 1:
        say(f"  {found[0].place}", err=True)
        return found[0]
    for number, one in enumerate(found, start=1):
        say(f"  {number}  {one.place}", err=True)

    def check(answer: str) -> None:
        if answer not in {str(number) for number in range(1, len(found) + 1)}:
            raise BadInputError(f"{answer!r}: give a number from 1 to {len(found)}")

    return found[int(ask(f"Which {found[0].name}?", "1", check)) - 1]


def _place(city: City | None, unasked: bool) -> str | None:
    """Return which city was taken, and how many others might have been meant where nobody was asked."""
    if city is None:
        return None
    others = len(find_cities(f"{city.name}")) - 1 if unasked else 0
    return city.place + (f"; {others} more are called so: --site gives one of them" if others else "")


def find_cities(name: str) -> list[City]:
    """Return the largest city of a name, "Paris" or "Paris, US", first, and those of about its size.

    Raises BadInputError, naming near ones.
    """
    every = _cities()
    wanted, _, country = (part.strip() for part in name.partition(","))
    if not wanted:
        raise BadInputError(f"{name!r} is no city: give its name, or LAT,LON,HEIGHT")
    # Some have a comma in their name: Washington, D.C.
    for text, where in ((name, ""), (wanted, country.upper())):
        named = _called(every, text)
        ranks = [rank for rank, one in named.items() if where in ("", one.country)]
        if ranks:
            return [named[rank] for rank in ranks if rank <= RIVAL_RANK * ranks[0]]
    if named:
        there = ", ".join(sorted({one.country for one in named.values()}))
        raise BadInputError(f"{name!r}: there is no {wanted} in {country}, but in {there}")
    raise BadInputError(f"{name!r} is not in the list of cities{_near(every, wanted)}")


def _called(cities: Sequence[City], name: str) -> dict[int, City]:
    """Return the cities of a name by their rank, where there are none those that are called so elsewhere."""
    wanted = folded(name)
    ranked = dict(enumerate(cities, start=1))
    own = {rank: one for rank, one in ranked.items() if folded(one.name) == wanted}
    return own or {rank: one for rank, one in ranked.items() if wanted in folded(one.others).split("|")}


def _near(cities: Sequence[City], name: str) -> str:
    """Return what was meant, the end of a message: names that begin so, else the one most alike."""
    wanted = folded(name)
    every = {f"{one.name}, {one.country}": folded(one.name) for one in cities}
    near = [label for label, known in every.items() if known.startswith(wanted)][:MOST_MEANT]
    if not near:
        alike = get_close_matches(wanted, every.values(), n=1, cutoff=LEAST_ALIKE)
        near = [label for label, known in every.items() if known in alike][:1]
    if len(name) < _LEAST_MATCH or not near:
        return ": name a larger one nearby, or give LAT,LON,HEIGHT"
    return f"; did you mean {' or '.join(near)}?"


def _cities() -> list[City]:
    """Return the packaged list, the largest first (GeoNames, CC BY 4.0; `python -m tools.cities`)."""
    packed = (files("sattrack") / "data" / "cities.csv.gz").read_bytes()
    rows = csv.reader(io.StringIO(gzip.decompress(packed).decode()))
    return [City(row[0], row[1], float(row[2]), float(row[3]), *row[4:]) for row in rows]


def folded(name: str) -> str:
    """Return a name by which others are found: without accents and case."""
    if not name.isascii():
        name = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    return name.casefold()


def _height_m(text: str) -> float:
    try:
        return Site(0.0, 0.0, float(text)).on_ground().height_m
    except ValueError:
        raise BadInputError(f"{text!r} is no height: write metres, as 120") from None


def _zone(name: str) -> str:
    if not is_zone(name):
        raise BadInputError(f"{name!r} is no time zone: write it as Europe/Amsterdam, or UTC")
    return name


def _system_zone() -> str:
    """Return the name of the system's time zone, UTC where it has none that can be found."""
    # A colon before a file or a name is glibc's; many set TZ=:/etc/localtime, which is the system's own.
    there = os.environ.get("TZ", "").removeprefix(":") or LOCAL_TIME
    if there.startswith("/"):
        there = os.path.realpath(there).partition("/zoneinfo/")[2]
    return there if there and is_zone(there) else "UTC"


def _mount(url: str) -> str:
    if url != "alpaca" and not is_antenna(url):
        mount_address(url)
    return url


def _answered_mount(ask: Callable[..., str], question: str) -> str:
    """Return the mount that is answered; where a search finds none, or several, the question is put again."""
    while True:
        answer = ask(question, USUAL_MOUNT, _mount)
        try:
            return _found_mount(answer)
        except SattrackError as error:
            say(f"  {error}", err=True)


def _found_mount(url: str) -> str:
    """Return the URL of a mount; `alpaca` stands for the one telescope that answers discovery."""
    if url != "alpaca":
        return url
    # HTTP's modules are many; without a search they are not needed.
    from sattrack.mount.alpaca.client import discover_telescopes

    tell("searching the network for Alpaca telescopes")
    found = discover_telescopes()
    if not found:
        raise BadInputError(
            "--mount alpaca: no Alpaca telescope answered on this network; start its driver, or give "
            "--mount alpaca://HOST:PORT/DEVICE"
        )
    if len(found) > 1:
        listed = ", ".join(f"{one.url} ({one.name})" for one in found)
        raise BadInputError(f"--mount alpaca: {len(found)} telescopes answered: {listed}; give one of them")
    tell(f"found {found[0].name} at {found[0].url}")
    return found[0].url


def _source(source: str) -> None:
    """Raise where a source of elements cannot be one: a file that holds none, a name that means nothing."""
    if is_fetched(source):
        from sattrack.elements.downloads import query_of

        query_of(source, os.environ)
        return
    from tle.sources import read_elements

    if source == "-":
        raise SourceError("standard input cannot be kept in settings: give a file or celestrak:GROUP")
    if re.fullmatch(r"[\w-]+", source) and not Path(source).exists():
        raise BadInputError(
            f"{source}: there is no such file; for CelesTrak's group of that name write celestrak:{source}"
        )
    read_elements(source)


def _mount_note(answers: InitialSettings) -> str | None:
    """Try the mount, without moving it; return what is wrong, None where it answers or is simulated."""
    if is_antenna(answers.mount_url):
        return "an antenna's controller is driven by `sattrack track`, and tried by nothing before"
    address: MountAddress | None = mount_address(answers.mount_url)
    if address is None:
        return None
    try:
        health = listen(address.seen_from(answers.site), usual_profile(answers.mount_url))
    except SattrackError as error:
        return f"the mount does not answer yet: {error}; `sattrack doctor` tries again"
    if health.received == 0:
        return (
            f"{answers.mount_url} sent nothing within {LISTEN_S:g} s: {address.silence_advice}; "
            "`sattrack doctor` tries again"
        )
    return None


def _as_kept(source: str, path: Path) -> str:
    """Return a source as a settings file says it: a file is named from where the settings are."""
    if is_fetched(source):
        return source
    beside = os.path.relpath(source, path.absolute().parent)
    return str(Path(source).absolute()) if beside.startswith("../..") else beside


def settings_text(answers: InitialSettings, path: Path) -> str:
    """Return the settings file, with comments. Elements that are files are named relative to it."""
    sources = [_as_kept(source, path) for source in answers.elements]
    site = answers.site
    centre = "\n".join(textwrap.wrap(CENTRE_WARNING, 100, initial_indent="# ", subsequent_indent="# "))
    centre = f"{centre}\n" if answers.place else ""
    return f"""\
# Settings of sattrack. Commands read --config FILE, else ./sattrack.toml, else that of the user's folder
# for configuration. Options on the command line win. docs/settings.md has every key.

# Where element sets come from: files or folders beside this file, celestrak:GROUP, or a URL.
elements = {json.dumps(sources, ensure_ascii=False)}

# Times for people are shown in this zone; --utc shows UTC. JSON is always UTC.
zone = {json.dumps(answers.zone)}

# Passes are listed and followed above this altitude.
min_altitude_deg = 10

# Degrees north, degrees east, metres above the WGS 84 ellipsoid.
{centre}[site]
latitude_deg = {site.latitude_deg}
longitude_deg = {site.longitude_deg}
height_m = {site.height_m}

# sim is a simulated mount, to practise with. `sattrack mount calibrate` measures a real one, and writes the
# file that `profile` names.
[mount]
url = {json.dumps(answers.mount_url)}
# profile = "mount.toml"

# The camera's field of view, to judge whether a pass stays in it.
# [camera]
# fov_deg = 0.25

# The terminal's screen: night, red or contrast.
# [screen]
# theme = "red"

# The mount is kept away from the Sun and above the floor. optical = false is for a radio dish alone.
[safety]
optical = true
floor_altitude_deg = 0
"""


def _tonight(path: Path, as_json: bool, failure: str | None) -> tuple[Any, str | None]:
    """Print the passes of the coming night by the new settings, or as JSON return them; None: not possible.

    `failure`: why there are no elements. What keeps passes from being found is reported, and no error: the
    settings are written. Returned as well is what to do where all elements are too old for `track`.
    """
    from sattrack.cli.passes import command as passes
    from tle.sources import find, newest

    old = None
    if failure is not None:
        tell(f"passes cannot be listed yet: {failure}")
        return None, old
    try:
        settings = load_settings(path)
        context = CommandContext(settings, None, (), None, as_json, False)
        now = context.now()
        elements = newest(context.load(settings.elements).accepted, now)
        old = _all_too_old(elements, settings.elements, now)
        words = ["--config", str(path), "--hours", "24"]
        known = []
        for name in FAMOUS:
            with suppress(TleError):
                known.append(find(elements, name))
        listed = ""
        if len(elements) > MOST_LISTED:
            words += [str(one.catalog_number) for one in known] or list(BRIGHT)
            shown = " and ".join(one.label for one in known) or "high, sunlit passes at night"
            listed = f", {shown} of {len(elements)} satellites (`sattrack passes` lists all)"
        if not as_json:
            say(f"\nThe coming 24 hours{listed}:")
            passes.main(words, standalone_mode=False)
            return [], old
        with redirect_stdout(io.StringIO()) as out:
            passes.main([*words, "--json"], standalone_mode=False)
        return json.loads(out.getvalue()), old
    except (SattrackError, TleError) as error:
        tell(f"passes cannot be listed yet: {error}")
        return None, old


def _all_too_old(elements: list[Elements], sources: tuple[str, ...], now: Utc) -> str | None:
    """Return what to do where all elements are too old for `track`; None where some are not."""
    from sattrack.cli.running import OLDEST_DAYS

    days = min((abs(now - one.epoch) / DAY_S for one in elements), default=0.0)
    if days <= OLDEST_DAYS:
        return None
    number = elements[0].catalog_number if len(elements) == 1 else None
    return (
        f"{how_to_renew(sources, number)}. `sattrack track` follows with elements of {OLDEST_DAYS:g} days at "
        f"most, and these are {days:.0f} days old."
    )

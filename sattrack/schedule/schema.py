"""The schedule's file as TOML has it: its tables and keys, what each may be, rules in words, and stars.

Times are text here, of any TOML type; `file` reads them in the file's time zone. Stars to slew to are those
of Hipparcos, ICRS at epoch J2000. A rule is "all of celestrak:visual, above 30°, sunlit, magnitude < 4,
max 12":

rule      = what *("," condition)
what      = "all" ["of" SOURCE]              SOURCE as --elements takes it; without one, all elements
condition = "above" N ["°"]                  followed while so high
          | "culminates above" N ["°"]       only passes that get so high
          | "sunlit"                         only while the satellite sees the whole Sun: counts those seconds
          | "dark"                           the Sun 6° or more below the horizon at culmination
          | "sun below" N ["°"]              the same for any altitude of the Sun
          | "magnitude <" N                  only passes that get as bright
          | "rate <" N ["°/s"]               neither hour angle nor declination ever turns faster
          | "longer than" N ("s" | "min")    only passes with as many useful seconds
          | "named" GLOB                     only satellites whose names match
          | "designator" GLOB                only those whose international designator matches: 1998-067*
          | "launched" ["since" | "before"] YEAR   only those launched in, from or before a year
          | "once a" ("night" | "run")       each satellite once
          | "at most" N "an hour"            so many passes culminate within any 60 minutes, no more
          | "max" N                          no more than so many passes in the plan
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from urllib.parse import urlsplit

import msgspec

from sattrack.control.biases import MOST_ALONG_S, MOST_CROSS_DEG
from sattrack.core.errors import meant

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.core.errors import BadInputError, Origin

    _Take = Callable[[re.Match[str]], dict[str, Any]]

LONGEST_S = 86_400.0
OnFailure = Literal["go_on", "skip"]


class SlewAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="slew"):
    """Slew to a star by name, to a fixed place among the stars (ICRS), or to an altitude and azimuth; wait.

    Degrees, azimuth from north through east. Raises ValueError for none of the three, or more than one.
    """

    star: str | None = None
    ra_deg: float | None = None
    dec_deg: float | None = None
    alt_deg: float | None = None
    az_deg: float | None = None
    wait_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the direction and the wait."""
        given = [self.star is not None, self._pair("ra_deg", "dec_deg"), self._pair("alt_deg", "az_deg")]
        if sum(given) != 1:
            raise ValueError("give one of star, ra_deg with dec_deg, or alt_deg with az_deg to slew to")
        if self.star is not None and find_star(self.star) is None:
            hint = meant(self.star, STARS) or "; give ra_deg and dec_deg"
            raise ValueError(f"star is {self.star!r}; that one is not known{hint}")
        between("ra_deg", self.ra_deg, 0.0, 360.0)
        between("dec_deg", self.dec_deg, -90.0, 90.0)
        between("alt_deg", self.alt_deg, 0.0, 90.0)
        between("az_deg", self.az_deg, -360.0, 360.0)
        between("wait_s", self.wait_s, 0.0, LONGEST_S)

    def _pair(self, one: str, other: str) -> bool:
        there = [getattr(self, name) is not None for name in (one, other)]
        if any(there) and not all(there):
            raise ValueError(f"{one} and {other} go together; one is missing")
        return all(there)

    @property
    def words(self) -> str:
        """A short name for people."""
        if self.star is not None:
            place = self.star
        elif self.ra_deg is not None:
            place = f"RA {self.ra_deg:g}° Dec {self.dec_deg:g}°"
        else:
            place = f"alt {self.alt_deg:g}° az {self.az_deg:g}°"
        return f"slew to {place}" + (f", wait {self.wait_s:g} s" if self.wait_s else "")


class SearchAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="search"):
    """Search about the satellite once it is followed: a spiral, or a sweep along the track.

    As in a run: `spacing_deg` and `speed_deg_s` of a spiral, `reach_s` and `period_s` of a sweep; for
    `seconds`, then back to the centre. Raises ValueError.
    """

    how: Literal["spiral", "sweep"]
    spacing_deg: float | None = None
    speed_deg_s: float | None = None
    reach_s: float | None = None
    period_s: float | None = None
    seconds: float = 60.0

    def __post_init__(self) -> None:
        """Check that what the pattern needs is there, and nothing else."""
        needs = {"spiral": ("spacing_deg", "speed_deg_s"), "sweep": ("reach_s", "period_s")}
        for how, names in needs.items():
            for name in names:
                value = getattr(self, name)
                if (value is not None) != (how == self.how):
                    there = (
                        "is missing; it goes with" if value is None else f"is {value:g}; it does not go with"
                    )
                    raise ValueError(f"{name} {there} a {self.how}")
                if value is not None and not (math.isfinite(value) and value > 0.0):
                    raise ValueError(f"{name} is {value:g}; it must be above 0")
        between("seconds", self.seconds, 1.0, LONGEST_S)

    @property
    def words(self) -> str:
        """A short name for people."""
        return f"search by a {self.how} for {self.seconds:g} s"


class CommandAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="command"):
    """Run a program, without a shell, with the pass' facts in its environment.

    With `wait` the schedule waits for its end, `timeout_s` at most, then ends it. Raises ValueError.
    """

    run: tuple[str, ...]
    timeout_s: float = 30.0
    wait: bool = True
    if_it_fails: OnFailure = "go_on"

    def __post_init__(self) -> None:
        """Check that there is a program, and for how long."""
        if not self.run or not self.run[0].strip():
            raise ValueError('run is empty; give the program and its arguments, as ["./dome", "open"]')
        between("timeout_s", self.timeout_s, 0.1, LONGEST_S)

    @property
    def words(self) -> str:
        """A short name for people."""
        return f"run {' '.join(self.run)}" + (
            f", {self.timeout_s:g} s at most" if self.wait else ", not waited for"
        )


class WebhookAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="webhook"):
    """Post the pass' facts as JSON to an address; the run does not wait for the answer. Raises ValueError."""

    url: str
    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        """Check the address."""
        check_http("url", self.url)
        between("timeout_s", self.timeout_s, 0.1, LONGEST_S)

    @property
    def words(self) -> str:
        """A short name for people."""
        return f"post to {urlsplit(self.url).hostname}"


Action = SlewAction | SearchAction | CommandAction | WebhookAction


class Weather(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The source of weather reports: one of a file, a command, an Alpaca SafetyMonitor.

    The file's first word is `safe` or `unsafe`, and it is no older than `oldest_s`; the command ends with 0
    where it is safe, within `timeout_s`; the monitor is `alpaca://HOST:PORT/DEVICE`. What cannot be asked is
    unsafe. Raises ValueError.
    """

    file: str | None = None
    command: tuple[str, ...] | None = None
    alpaca: str | None = None
    every_s: float = 30.0
    timeout_s: float = 10.0
    oldest_s: float = 300.0

    def __post_init__(self) -> None:
        """Check that there is one source, and its form."""
        if sum(one is not None for one in (self.file, self.command, self.alpaca)) != 1:
            raise ValueError("give one of file, command and alpaca to ask about the weather")
        if self.command is not None and not (self.command and self.command[0].strip()):
            raise ValueError('command is empty; give the program and its arguments, as ["./weather"]')
        if self.alpaca is not None:
            _check_alpaca(self.alpaca)
        for name in ("every_s", "timeout_s", "oldest_s"):
            between(name, getattr(self, name), 0.1, LONGEST_S)

    @property
    def words(self) -> str:
        """The name of the source."""
        if self.file is not None:
            return f"the file {self.file}"
        return " ".join(self.command) if self.command is not None else str(self.alpaca)


Notice = Literal["pass", "lost", "trouble", "morning"]


class Notify(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whom to notify of what: a program that is run, or an address to which JSON is posted.

    `on`: "pass" (one was followed), "lost" (one was not), "trouble" (anything else worth reporting),
    "morning" (the night's summary). Nobody waits for it. Raises ValueError.
    """

    run: tuple[str, ...] | None = None
    url: str | None = None
    on: tuple[Notice, ...] = ("lost", "trouble", "morning")
    timeout_s: float = 30.0

    def __post_init__(self) -> None:
        """Check that there is one of the two."""
        if (self.run is None) == (self.url is None):
            raise ValueError("give one of run and url to notify by")
        if self.run is not None and not (self.run and self.run[0].strip()):
            raise ValueError('run is empty; give the program and its arguments, as ["./tell-me"]')
        if self.url is not None:
            check_http("url", self.url)
        between("timeout_s", self.timeout_s, 0.1, LONGEST_S)


class Wake(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The program that gives the drives their power back after they were parked; done when it ends with 0."""

    run: tuple[str, ...]
    timeout_s: float = 60.0

    def __post_init__(self) -> None:
        """Check that there is a program, and for how long."""
        if not self.run or not self.run[0].strip():
            raise ValueError('run is empty; give the program and its arguments, as ["./power", "on"]')
        between("timeout_s", self.timeout_s, 0.1, 3600.0)


class Recordings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How long recordings are kept: in days, and by free space on the disk. Raises ValueError."""

    keep_days: float | None = None
    keep_free_gb: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        between("keep_days", self.keep_days, 1.0, 36_500.0)
        between("keep_free_gb", self.keep_free_gb, 0.0, 1e6)


def _check_alpaca(address: str) -> None:
    try:
        parts = urlsplit(address)
        good = parts.scheme == "alpaca" and parts.hostname and parts.port and parts.path[1:].isdecimal()
        # What is no host's name cannot be looked up.
        (parts.hostname or "").encode("idna")
    except ValueError:
        good = False
    if not good:
        raise ValueError(
            f"alpaca is {address!r}; write alpaca://HOST:PORT/DEVICE, as alpaca://192.0.2.7:11111/0"
        )


def check_http(name: str, url: str) -> None:
    """Raise ValueError where a text is no http address, or holds a password."""
    try:
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
    except ValueError:
        host, parts = None, urlsplit("")
    if parts.scheme not in ("http", "https") or not host:
        raise ValueError(f"{name} is {url!r}; write https://HOST/PATH")
    if parts.username is not None or parts.password is not None:
        # Not shown again: it holds a password.
        raise ValueError(f"{name} is an address with a name or password; others can read schedules")


def between(name: str, value: float | None, low: float, high: float) -> None:
    """Raise ValueError where a number is outside its bounds; None is inside."""
    if value is not None and not low <= value <= high:
        raise ValueError(f"{name} is {value:g}; give {low:g} to {high:g}")


class StarCoordinates(NamedTuple):
    """Right ascension and declination, degrees; proper motions, mas a year, that in RA times cos Dec."""

    ra_deg: float
    dec_deg: float
    pm_ra_mas: float
    pm_dec_mas: float


def _star(ra: str, dec: str, pm_ra_mas: float, pm_dec_mas: float) -> StarCoordinates:
    hours, minutes, seconds = (float(part) for part in ra.split())
    degrees, arcmin, arcsec = (float(part) for part in dec[1:].split())
    size = degrees + arcmin / 60.0 + arcsec / 3600.0
    return StarCoordinates(
        15.0 * (hours + minutes / 60.0 + seconds / 3600.0),
        -size if dec[0] == "-" else size,
        pm_ra_mas,
        pm_dec_mas,
    )


STARS = {
    "Aldebaran": _star("04 35 55.239", "+16 30 33.49", 63.45, -188.94),
    "Alkaid": _star("13 47 32.438", "+49 18 47.76", -121.17, -14.91),
    "Alphard": _star("09 27 35.243", "-08 39 30.96", -15.23, 34.37),
    "Alpheratz": _star("00 08 23.260", "+29 05 25.55", 137.46, -163.44),
    "Altair": _star("19 50 46.999", "+08 52 05.96", 536.23, 385.29),
    "Antares": _star("16 29 24.460", "-26 25 55.21", -12.11, -23.30),
    "Arcturus": _star("14 15 39.672", "+19 10 56.67", -1093.39, -2000.06),
    "Betelgeuse": _star("05 55 10.305", "+07 24 25.43", 27.54, 11.30),
    "Capella": _star("05 16 41.359", "+45 59 52.77", 75.25, -426.89),
    "Caph": _star("00 09 10.685", "+59 08 59.21", 523.50, -179.77),
    "Castor": _star("07 34 35.873", "+31 53 17.82", -191.45, -145.19),
    "Deneb": _star("20 41 25.915", "+45 16 49.22", 2.01, 1.85),
    "Denebola": _star("11 49 03.578", "+14 34 19.41", -497.68, -114.67),
    "Diphda": _star("00 43 35.371", "-17 59 11.78", 232.55, 31.99),
    "Dubhe": _star("11 03 43.672", "+61 45 03.72", -134.11, -34.70),
    "Eltanin": _star("17 56 36.370", "+51 29 20.02", -8.48, -22.79),
    "Enif": _star("21 44 11.156", "+09 52 30.03", 26.92, 0.44),
    "Hamal": _star("02 07 10.406", "+23 27 44.70", 188.55, -148.08),
    "Kochab": _star("14 50 42.326", "+74 09 19.81", -32.61, 11.42),
    "Menkar": _star("03 02 16.773", "+04 05 23.06", -10.41, -76.85),
    "Menkent": _star("14 06 40.948", "-36 22 11.84", -520.53, -518.06),
    "Mirach": _star("01 09 43.924", "+35 37 14.01", 175.90, -112.20),
    "Mirfak": _star("03 24 19.370", "+49 51 40.25", 23.75, -26.23),
    "Polaris": _star("02 31 49.095", "+89 15 50.79", 44.48, -11.85),
    "Pollux": _star("07 45 18.950", "+28 01 34.32", -626.55, -45.80),
    "Procyon": _star("07 39 18.120", "+05 13 29.96", -714.59, -1036.80),
    "Regulus": _star("10 08 22.311", "+11 58 01.95", -248.73, 5.59),
    "Rigel": _star("05 14 32.272", "-08 12 05.90", 1.31, 0.50),
    "Scheat": _star("23 03 46.457", "+28 04 58.03", 187.65, 136.93),
    "Sirius": _star("06 45 08.917", "-16 42 58.02", -546.01, -1223.07),
    "Spica": _star("13 25 11.579", "-11 09 40.75", -42.35, -30.67),
    "Vega": _star("18 36 56.336", "+38 47 01.28", 200.94, 286.23),
}


def find_star(name: str) -> StarCoordinates | None:
    """Return a star by its name in upper or lower case; None where it is not known."""
    return next((star for known, star in STARS.items() if known.casefold() == name.strip().casefold()), None)


MOST_PRIORITY = 1e6
FIXED_PRIORITY = 100.0
"""The default priority of a pass by fixed times."""
PierSide = Literal["any", "normal", "beyond_pole"]
SkipOrRun = Literal["skip", "run"]
OnWeather = Literal["wait", "skip", "run"]


class PassOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What can be set for passes, in `[defaults]` or with each; the next wider place sets what is absent.

    Raises ValueError, naming the key, for a value that cannot be one.
    """

    priority: float | None = None
    min_altitude_deg: float | None = None
    settle_s: float | None = None
    shorten: bool | None = None
    least_s: float | None = None
    longest_s: float | None = None
    bias_along_s: float | None = None
    bias_cross_deg: float | None = None
    pier_side: PierSide | None = None
    before: tuple[Action, ...] | None = None
    after: tuple[Action, ...] | None = None
    if_infeasible: SkipOrRun | None = None
    if_elements_old: SkipOrRun | None = None
    elements_oldest_days: float | None = None
    if_weather_unsafe: OnWeather | None = None
    if_sun_up: SkipOrRun | None = None
    sun_up_deg: float | None = None

    def __post_init__(self) -> None:
        """Check every number."""
        if self.priority is not None and not 0.0 < self.priority <= MOST_PRIORITY:
            raise ValueError(
                f"priority is {self.priority:g}; give a number above 0, {MOST_PRIORITY:g} at most"
            )
        between("min_altitude_deg", self.min_altitude_deg, -5.0, 89.0)
        between("settle_s", self.settle_s, 0.0, 3600.0)
        between("least_s", self.least_s, 1.0, LONGEST_S)
        between("longest_s", self.longest_s, 1.0, LONGEST_S)
        between("bias_along_s", self.bias_along_s, -MOST_ALONG_S, MOST_ALONG_S)
        between("bias_cross_deg", self.bias_cross_deg, -MOST_CROSS_DEG, MOST_CROSS_DEG)
        between("elements_oldest_days", self.elements_oldest_days, 0.01, 3660.0)
        between("sun_up_deg", self.sun_up_deg, -90.0, 90.0)


class Terms(msgspec.Struct, frozen=True, kw_only=True):
    """PassOptions with all that was absent filled in: degrees, seconds, days."""

    priority: float = 1.0
    min_altitude_deg: float = 10.0
    settle_s: float = 5.0
    shorten: bool = False
    least_s: float = 60.0
    longest_s: float | None = None
    bias_along_s: float = 0.0
    bias_cross_deg: float = 0.0
    pier_side: PierSide = "any"
    before: tuple[Action, ...] = ()
    after: tuple[Action, ...] = ()
    if_infeasible: SkipOrRun = "skip"
    if_elements_old: SkipOrRun = "skip"
    elements_oldest_days: float = 7.0
    if_weather_unsafe: OnWeather = "wait"
    if_sun_up: SkipOrRun = "skip"
    sun_up_deg: float = -6.0


def terms_of(*wishes: PassOptions, **last: float) -> Terms:
    """Return what holds for a pass: the first of the wishes that sets it, then `last`, then our default."""
    values = dict(last)
    for one in reversed(wishes):
        given = {name: getattr(one, name) for name in PassOptions.__struct_fields__}
        values |= {name: value for name, value in given.items() if value is not None}
    return Terms(**values)  # type: ignore[arg-type]


class PassEntry(PassOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[passes]]`: passes by a rule, or of satellites named; `from` and `to` are a window."""

    name: str | None = None
    rule: str | None = None
    satellite: str | None = None
    satellites: tuple[str, ...] | None = None
    ephemeris: str | tuple[str, ...] = ()
    elements: str | None = None
    where: str | None = None
    from_: str | None = msgspec.field(default=None, name="from")
    to: str | None = None

    def __post_init__(self) -> None:
        """Check that it says of what, once."""
        super().__post_init__()
        if sum(one is not None for one in (self.rule, self.satellite, self.satellites)) != 1:
            raise ValueError("give one of rule, satellite and satellites: whose passes are these?")
        if self.satellites is not None and not self.satellites:
            raise ValueError("satellites is empty; name one")
        if self.rule is not None and self.ephemeris:
            raise ValueError("ephemeris is for an object by name: give satellite, as the file calls it")
        if self.rule is not None and self.elements is not None:
            raise ValueError("elements is for a satellite by name: write 'all of SOURCE' into the rule")
        if self.rule is not None and self.where is not None:
            raise ValueError("where is for satellites by name; write its conditions into the rule")
        if (self.from_ is None) != (self.to is None):
            raise ValueError("from and to go together; one is missing")


class FixedEntry(PassOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[fixed]]`: a satellite from one instant to another."""

    satellite: str
    start: str
    end: str
    ephemeris: str | tuple[str, ...] = ()
    elements: str | None = None
    name: str | None = None


class ImportEntry(PassOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[imports]]`: fixed times from another file, a table (CSV) or a list."""

    file: str
    format: Literal["csv", "list"] | None = None
    timezone: str | None = None


class ScheduleText(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All of a file. An included one sets nothing for the plan as a whole."""

    timezone: str | None = None
    include: tuple[str, ...] = ()
    from_: str | None = msgspec.field(default=None, name="from")
    to: str | None = None
    elements: tuple[str, ...] = ()
    magnitudes: str | None = None
    park_at_end: bool | None = None
    weather: Weather | None = None
    wake: Wake | None = None
    notify: tuple[Notify, ...] = ()
    recordings: Recordings = Recordings()
    defaults: PassOptions = msgspec.field(default_factory=PassOptions)
    passes: tuple[PassEntry, ...] = ()
    fixed: tuple[FixedEntry, ...] = ()
    imports: tuple[ImportEntry, ...] = ()
    fixed_list: str | None = None


ONLY_AT_THE_TOP = (
    "from",
    "to",
    "elements",
    "magnitudes",
    "park_at_end",
    "weather",
    "wake",
    "notify",
    "recordings",
    "defaults",
)
"""Keys that an included file cannot have."""


DARK_SUN_DEG = -6.0
_NUMBER = r"([+\-]?\d+(?:\.\d*)?|[+\-]?\.\d+)"
_DEG = r"\s*(?:°|deg|degrees)?"
_WORDS = ("above", "culminates above", "sunlit", "dark", "sun below", "magnitude <", "rate <", "longer than")
_ONCE = ("once a night", "once a run")
KNOWN = (*_WORDS, "named", "designator", "launched", *_ONCE, "at most", "max")
_BEGIN = ": begin with 'all' or 'all of SOURCE', as all of celestrak:visual"
_EXAMPLES = {
    "above": "above 30°",
    "culminates above": "culminates above 60°",
    "culminates": "culminates above 60°",
    "sunlit": "sunlit",
    "dark": "dark",
    "sun below": "sun below -12°",
    "sun": "sun below -12°",
    "magnitude <": "magnitude < 4",
    "magnitude": "magnitude < 4",
    "rate <": "rate < 1.5 °/s",
    "rate": "rate < 1.5 °/s",
    "longer than": "longer than 90 s",
    "longer": "longer than 90 s",
    "named": "named STARLINK*",
    "designator": "designator 1998-067*",
    "launched": "launched since 2024",
    "launched since": "launched since 2024",
    "launched before": "launched before 2000",
    "once": "once a night",
    "once a": "once a night",
    "once per": "once a night",
    "at": "at most 4 an hour",
    "at most": "at most 4 an hour",
    "max": "max 12",
}


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions on passes; degrees, seconds. None, or an empty text, for no condition."""

    above_deg: float | None = None
    culminates_deg: float | None = None
    sunlit: bool = False
    sun_below_deg: float | None = None
    brighter_than: float | None = None
    slower_than_deg_s: float | None = None
    longer_than_s: float | None = None
    named: str = ""
    most: int | None = None
    designator: str = ""
    launched_from: int | None = None
    launched_before: int | None = None
    once_a_night: bool = False
    once_a_run: bool = False
    most_an_hour: int | None = None


NO_CONDITIONS = Conditions()


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule: whose passes (`source` None for all elements that are loaded), and which of them."""

    source: str | None
    conditions: Conditions


def parse_rule(text: str, origin: Origin) -> Rule:
    """Return the rule in a text; `origin` is where its first character stands.

    Raises BadInputError.
    """
    parts = _parts(text)
    at, what = parts[0]
    match = re.fullmatch(r"all(?:\s+of\s+(\S(?:.*\S)?))?", what, re.IGNORECASE)
    if match is None:
        first = what.split()[0] if what.split() else ""
        hint = (meant(first, ["all"]) if first else "") or _BEGIN
        raise origin.moved(at).wrong(f"{what!r} begins no rule{hint}")
    return Rule(match.group(1), _conditions(parts[1:], origin))


def parse_conditions(text: str, origin: Origin) -> Conditions:
    """Return conditions alone, as `where` has them for satellites by name. Raises BadInputError."""
    return _conditions(_parts(text), origin)


def _parts(text: str) -> list[tuple[int, str]]:
    """Return the parts between commas, each with the column from 0 at which it begins."""
    parts, at = [], 0
    for piece in text.split(","):
        parts.append((at + len(piece) - len(piece.lstrip()), piece.strip()))
        at += len(piece) + 1
    return parts


def _conditions(parts: list[tuple[int, str]], origin: Origin) -> Conditions:
    found: dict[str, Any] = {}
    seen: set[str] = set()
    for at, words in parts:
        here = origin.moved(at)
        if not words:
            raise here.wrong("nothing stands between two commas, or after the last: take one away")
        for pattern, take in _GRAMMAR:
            match = re.fullmatch(pattern, words, re.IGNORECASE)
            if match is None:
                continue
            try:
                given = take(match)
                twice = next((_TWICE[name] for name in given if name in _TWICE and name in found), None)
                if twice is not None:
                    raise ValueError(twice)
            except ValueError as error:
                raise here.moved(match.start(1)).wrong(f"{words!r}: {error}") from None
            if pattern in seen:
                raise here.wrong(f"{words!r}: given twice; keep one")
            seen.add(pattern)
            found |= given
            break
        else:
            raise _unknown(words, here)
    return Conditions(**found)


def _unknown(words: str, here: Origin) -> BadInputError:
    """Return the error for what is no condition, with what was meant."""
    first = re.split(r"[\s<>=]", words, maxsplit=1)[0].lower()
    two = " ".join(words.lower().split()[:2])
    for known in (two, first):
        if known in _EXAMPLES:
            return here.wrong(f"{words!r} is not understood: write it as {_EXAMPLES[known]!r}")
    near = meant(first, [word.split()[0] for word in KNOWN]) or f"; there are {', '.join(KNOWN)}"
    return here.wrong(f"{words!r} is no condition{near}")


def _within(text: str, low: float, high: float, what: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f"{what} go from {low:g} to {high:g}")
    return value


def _year(text: str) -> int:
    if not text.isdigit():
        raise ValueError("elements tell the year of launch alone: give a year, as launched since 2024")
    return int(_within(text, 1957.0, 2056.0, "years of launch"))


def _designator(text: str) -> str:
    if not re.match(r"\d{4}-|\d{0,4}[*?\[]", text):
        raise ValueError("a designator begins with the year of launch, as 1998-067A or 2024-*")
    return text


def _seconds(m: re.Match[str]) -> float:
    return (60.0 if m[2].lower().startswith("m") else 1.0) * _within(m[1], 0.0, 86400.0, "durations")


_TWICE = {
    "sun_below_deg": "the Sun's altitude is asked twice; keep one",
    "launched_from": "the launch is asked twice; keep one",
    "launched_before": "the launch is asked twice; keep one",
}
"""Fields that more than one form sets."""
_GRAMMAR: tuple[tuple[str, _Take], ...] = (
    (rf"above\s+{_NUMBER}{_DEG}", lambda m: {"above_deg": _within(m[1], -5.0, 89.0, "altitudes")}),
    (
        rf"culminates\s+above\s+{_NUMBER}{_DEG}",
        lambda m: {"culminates_deg": _within(m[1], -5.0, 90.0, "altitudes")},
    ),
    (r"(sunlit)", lambda _: {"sunlit": True}),
    (r"(dark)", lambda _: {"sun_below_deg": DARK_SUN_DEG}),
    (
        rf"sun\s+below\s+{_NUMBER}{_DEG}",
        lambda m: {"sun_below_deg": _within(m[1], -90.0, 90.0, "altitudes of the Sun")},
    ),
    (rf"magnitude\s*<\s*{_NUMBER}", lambda m: {"brighter_than": _within(m[1], -30.0, 30.0, "magnitudes")}),
    (
        rf"rate\s*<\s*{_NUMBER}\s*(?:°/s|deg/s)?",
        lambda m: {"slower_than_deg_s": _within(m[1], 1e-4, 1000.0, "rates in degrees a second")},
    ),
    (rf"longer\s+than\s+{_NUMBER}\s*(s|sec|seconds|min|minutes)", lambda m: {"longer_than_s": _seconds(m)}),
    (r"named\s+(\S(?:.*\S)?)", lambda m: {"named": m[1]}),
    (r"max\s+(\d+)", lambda m: {"most": int(_within(m[1], 1.0, 10_000.0, "numbers of passes"))}),
    (r"designator\s+(\S+)", lambda m: {"designator": _designator(m[1])}),
    (
        r"launched\s+(\d[\d-]*)",
        lambda m: {"launched_from": _year(m[1]), "launched_before": _year(m[1]) + 1},
    ),
    (r"launched\s+since\s+(\d[\d-]*)", lambda m: {"launched_from": _year(m[1])}),
    (r"launched\s+before\s+(\d[\d-]*)", lambda m: {"launched_before": _year(m[1])}),
    (r"once\s+a\s+(night|run)", lambda m: {f"once_a_{m[1].lower()}": True}),
    (
        r"at\s+most\s+(\d+)\s+an\s+hour",
        lambda m: {"most_an_hour": int(_within(m[1], 1.0, 1000.0, "passes an hour"))},
    ),
)

"""The schedule's file as TOML has it: its tables and keys, and what each may be.

Times are text here, of whatever kind TOML had them; `moments` reads them in the file's time zone.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from sattrack.control.orders import MOST_ALONG_S, MOST_CROSS_DEG
from sattrack.schedule.actions import LONGEST_S, Action, Notify, Recordings, Wake, Weather, between

MOST_PRIORITY = 1e6
FIXED_PRIORITY = 100.0
"""What a pass by fixed times counts unless it is told otherwise: somebody waits for it."""
PierSide = Literal["any", "normal", "beyond_pole"]
SkipOrRun = Literal["skip", "run"]
OnWeather = Literal["wait", "skip", "run"]


class Wishes(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What may be said of passes, in `[defaults]` or with each; absent is what the next wider place says.

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
    """Wishes with all that nobody said filled in: degrees, seconds, days."""

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


def terms_of(*wishes: Wishes, **last: float) -> Terms:
    """Return what holds for a pass: the first of the wishes that says something, then `last`, then ours."""
    values = dict(last)
    for one in reversed(wishes):
        said = {name: getattr(one, name) for name in Wishes.__struct_fields__}
        values |= {name: value for name, value in said.items() if value is not None}
    return Terms(**values)  # type: ignore[arg-type]


class PassEntry(Wishes, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[passes]]`: passes by a rule, or of satellites named; `from` and `to` are a window."""

    name: str | None = None
    rule: str | None = None
    satellite: str | None = None
    satellites: tuple[str, ...] | None = None
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
        if self.rule is not None and self.where is not None:
            raise ValueError("where is for satellites by name; write its conditions into the rule")
        if (self.from_ is None) != (self.to is None):
            raise ValueError("from and to go together; one is missing")


class FixedEntry(Wishes, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[fixed]]`: a satellite from one instant to another."""

    satellite: str
    start: str
    end: str
    name: str | None = None


class ImportEntry(Wishes, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[imports]]`: fixed times from another file, a table (CSV) or a list."""

    file: str
    format: Literal["csv", "list"] | None = None
    timezone: str | None = None


class ScheduleText(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All of a file. An included one says nothing of the plan as a whole."""

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
    defaults: Wishes = msgspec.field(default_factory=Wishes)
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

"""What the runner of a schedule knows of a night: passes, results, events, orders; and what follows from it.

Plain data that JSON keeps, as the journal does; instants are POSIX seconds of UTC.
"""

from __future__ import annotations

import math
import zlib
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

import msgspec
from msgspec.structs import replace

from sattrack.runtime.target_facts import TargetFacts
from sattrack.schedule.schema import Terms
from sattrack.views.run import SAME_PASS_S
from sattrack.views.schedule import LostTo
from tle.elements import Elements
from tle.instants import DAY_S
from tle.sources import NO_NUMBERS

if TYPE_CHECKING:
    from sattrack.schedule.schema import Action
    from tle.ephemeris import Ephemeris


class RunState(StrEnum):
    """What the runner is doing, as text for people."""

    PLANNING = "planning"
    PLANLESS = "without a plan"
    WAITING = "waiting"
    PREPARING = "preparing"
    ASKING = "asking about the weather"
    HOLDING = "holding for the weather"
    READYING = "readying"
    FOLLOWING = "following"
    FINISHING = "finishing"
    PARKING = "parking"
    PAUSING = "pausing before it parks again"
    SUMMING_UP = "summing up"
    RESTING = "resting"
    STOPPED = "stopped"
    ENDED = "ended"


class Mount(StrEnum):
    """Where the mount was left, as far as the runner knows."""

    UNKNOWN = "unknown"
    AT_REST = "at rest"
    AT_PARK = "at park"
    PARKED = "parked"


class NightPass(msgspec.Struct, frozen=True):
    """A pass of the plan, with all that is needed to run it; `key` names it among those of all nights."""

    key: str
    number: int
    elements: Elements | None
    """None where `followed` has what is followed."""
    start_utc_s: float
    culminate_utc_s: float
    end_utc_s: float
    leave_utc_s: float
    """When the mount must set out at the latest, what is done before the pass included."""
    max_alt_deg: float
    priority: float
    useful_s: float
    terms: Terms
    asked_by: str
    source: str | None = None
    """Where its elements came from, as the schedule names it; None for all that is set."""
    renewable: bool = False
    lost_to: tuple[LostTo, ...] = ()
    """What the mount's limits take of it, as the plan predicts."""
    followed: TargetFacts | None = None
    asked: str = ""
    """What the schedule calls the target."""
    ephemeris: str | None = None
    """The file that it is an object of."""

    @property
    def target(self) -> Elements | Ephemeris:
        """Give what is followed, made anew."""
        if self.elements is not None:
            return self.elements
        assert self.followed is not None
        return self.followed.target()

    @property
    def name(self) -> str:
        """Its satellite's name, or number."""
        return self.elements.label if self.followed is None and self.elements else self.target.label

    @property
    def catalog_number(self) -> int | None:
        """Its satellite's number, None where it has none."""
        known = self.elements or self.followed
        return None if known is None else known.catalog_number or None

    @property
    def object_number(self) -> int:
        """What tells its target from others."""
        return object_number(self.catalog_number, self.name)


class Result(msgspec.Struct, frozen=True):
    """The outcome of a pass: "done", or "partly" or "lost" to a cause that has a name."""

    state: str
    cause: str | None = None
    words: str | None = None
    on_target_s: float = 0.0
    lost_s: float = 0.0
    """Seconds of the pass in which nothing followed, because the runner had died or the session had ended."""
    rms_arcsec: float | None = None
    peak_arcsec: float | None = None
    parts: int = 0
    recordings: tuple[str, ...] = ()
    held_s: dict[str, float] = {}
    """Seconds that each limit took, as a run's summary has them."""
    rejoining_s: float = 0.0
    lost_peak_arcsec: float | None = None
    """Largest error meanwhile, and on the way back."""


class PassAttempt(msgspec.Struct, frozen=True):
    """How an attempt at a pass ended: `ended_by` as in a run's summary, "weather", "stopped" or "crash"."""

    ended_by: str
    ended_utc_s: float
    on_target_s: float = 0.0
    rms_arcsec: float | None = None
    peak_arcsec: float | None = None
    words: str | None = None
    recording: str | None = None
    held_s: dict[str, float] = {}
    """Seconds that each limit took, as a run's summary has them."""
    rejoining_s: float = 0.0
    lost_peak_arcsec: float | None = None
    """Largest error meanwhile, and on the way back."""


class RunSettings(msgspec.Struct, frozen=True):
    """Settings for all nights: the run's span (None: no end), the schedule's and the site's.

    Nights change at `noon_s`, seconds after midnight UTC: the site's mean noon.
    """

    from_utc_s: float
    to_utc_s: float | None
    noon_s: float
    park: bool = True
    weather_every_s: float = 30.0
    prepare_s: float = 90.0
    """How long before the mount sets out a pass is prepared."""
    wake_s: float = 0.0
    """How much sooner while the drives have no power: how long the program may take that switches it on."""
    rest_after_s: float = 1800.0
    """A mount with so long to wait waits at its park position, drives on. It is sent there again after as
    long: nothing ends a mount's tracking of the sky but the end of its drives' power."""
    revision: int = 1
    """Of the machine's rules: events that an earlier one led to are read back by that."""


class FinishedPass(msgspec.Struct, frozen=True):
    """A pass that has a result already, by its satellite, when it is highest, and when it was to end."""

    catalog_number: int
    """As `NightPass.object_number` has it."""
    culminate_utc_s: float
    end_utc_s: float | None = None

    def is_pass(self, one: NightPass) -> bool:
        """Return whether it is this one, or what is left of this one: its highest instant may be over."""
        near = abs(one.culminate_utc_s - self.culminate_utc_s) < SAME_PASS_S
        rest = self.end_utc_s is not None and self.culminate_utc_s < one.start_utc_s < self.end_utc_s
        return one.object_number == self.catalog_number and (near or rest)


class Recovered(msgspec.Struct, frozen=True):
    """What is known from the last status of a run whose journal cannot be read."""

    night: int
    night_from_utc_s: float
    night_to_utc_s: float
    mount: Mount
    over: tuple[FinishedPass, ...] = ()
    summary: str | None = None


class _Event(msgspec.Struct, frozen=True, tag_field="event", kw_only=True):
    """Something happened at an instant."""

    utc_s: float


class Started(_Event, frozen=True, tag="started"):
    """The runner has come up, for the first time or again; `last_utc_s` is when it was last alive."""

    settings: RunSettings = msgspec.field(name="ways")
    last_utc_s: float | None = None
    on_target_s: float = 0.0
    """Of the attempt at a pass that was under way then."""
    recording: str | None = None
    recovered: Recovered | None = None
    """What was known without the journal, where that could not be read."""
    words: str | None = None
    """What is worth telling of the start."""


class Reread(_Event, frozen=True, tag="reread"):
    """The schedule's file was read again on request."""

    settings: RunSettings = msgspec.field(name="ways")


class Due(_Event, frozen=True, tag="due"):
    """The instant that was waited for has come."""


class ClockSet(_Event, frozen=True, tag="clock set"):
    """The machine's clock jumped by so many seconds, or the machine slept for them."""

    seconds: float
    slept: bool = False


class Planned(_Event, frozen=True, tag="planned"):
    """The night has a plan; so many other passes were seen and are not in it, by reason."""

    passes: tuple[NightPass, ...]
    others: dict[str, int] = {}
    words: str | None = None


class NotPlanned(_Event, frozen=True, tag="not planned"):
    """No plan could be made."""

    words: str


class PassPrepared(_Event, frozen=True, tag="prepared"):
    """Elements were renewed where that is due, the drives have power; or why the pass cannot be taken."""

    cause: str | None = None
    words: str | None = None
    elements: Elements | None = None
    woken: bool = False


class WeatherReported(_Event, frozen=True, tag="weather"):
    """Whether the weather is safe; None without a weather source."""

    safe: bool | None
    words: str | None = None


class StepDone(_Event, frozen=True, tag="step done"):
    """An action before or after a pass is over."""

    done: bool
    words: str | None = None


class Followed(_Event, frozen=True, tag="followed"):
    """An attempt at a pass is over."""

    attempt: PassAttempt = msgspec.field(name="go")


class Parked(_Event, frozen=True, tag="laid"):
    """The mount was sent to its park position: is it there, and have its drives no power?"""

    mount: Mount
    words: str | None = None


class SummedUp(_Event, frozen=True, tag="summed up"):
    """The night's summary is written."""

    file: str | None = None
    words: str | None = None


class StopAsked(_Event, frozen=True, tag="stop asked"):
    """The operator wants an end."""

    words: str = "interrupted"


Event = (
    Started
    | Reread
    | Due
    | ClockSet
    | Planned
    | NotPlanned
    | PassPrepared
    | WeatherReported
    | StepDone
    | Followed
    | Parked
    | SummedUp
    | StopAsked
)


class _Order(msgspec.Struct, frozen=True, tag_field="order", kw_only=True):
    """What to do next; each order ends with one event."""


class Wait(_Order, frozen=True, tag="wait"):
    """Wait for an instant: ends with Due, ClockSet or StopAsked."""

    until_utc_s: float


class MakePlan(_Order, frozen=True, tag="plan"):
    """Plan the night: ends with Planned or NotPlanned."""


class Prepare(_Order, frozen=True, tag="prepare"):
    """Renew a pass' elements, give the drives power where they have none: ends with PassPrepared."""

    index: int
    wake: bool


class AskWeather(_Order, frozen=True, tag="ask weather"):
    """Ask about the weather: ends with WeatherReported."""


class DoStep(_Order, frozen=True, tag="do"):
    """Carry out an action before or after a pass: ends with StepDone.

    One before it is not begun in unsafe weather, and ends with WeatherReported.
    """

    index: int
    when: str
    step: int

    def action_of(self, one: NightPass) -> Action:
        """Return the action that is meant of a pass'."""
        terms = one.terms
        return (terms.before if self.when == "before" else terms.after)[self.step]

    def asks_weather(self, one: NightPass) -> bool:
        """Tell whether the weather must be safe for an action of a pass to begin."""
        return self.when == "before" and one.terms.if_weather_unsafe != "run"


class Follow(_Order, frozen=True, tag="follow"):
    """Follow a pass, or what is left of it, after a pause: ends with Followed."""

    index: int
    part: int
    from_utc_s: float
    pause_s: float = 0.0


class ParkMount(_Order, frozen=True, tag="lay down"):
    """Bring the mount to its park position, and with `power_off` cut its drives' power: ends with Parked."""

    power_off: bool


class SumUp(_Order, frozen=True, tag="sum up"):
    """Write the night's summary: ends with SummedUp."""


class End(_Order, frozen=True, tag="end"):
    """Nothing is left to do."""

    why: str
    interrupted: bool = False


Order = Wait | MakePlan | Prepare | AskWeather | DoStep | Follow | ParkMount | SumUp | End


class Run(msgspec.Struct, frozen=True):
    """All that the runner knows; every event makes a new one."""

    settings: RunSettings = RunSettings(0.0, None, 0.0)
    state: RunState = RunState.PLANNING
    mount: Mount = Mount.UNKNOWN
    first_utc_s: float = 0.0
    """When the run began for the first time; 0 where that is not known."""
    night: int = 0
    night_from_utc_s: float = 0.0
    night_to_utc_s: float = 0.0
    passes: tuple[NightPass, ...] = ()
    results: tuple[Result, ...] = ()
    """Of the passes so far, in their order: those that are over."""
    others: dict[str, int] = {}
    over: tuple[FinishedPass, ...] = ()
    """Passes of this night that had a result before the journal was set aside."""
    step: int = 0
    part: int = 0
    attempts: tuple[PassAttempt, ...] = ()
    """Those at the pass in progress."""
    part_from_utc_s: float = 0.0
    tries: int = 0
    parked_utc_s: float = 0.0
    """When the mount was last sent to its park position."""
    moved_utc_s: float = 0.0
    """When it was last moved, as far as the runner knows."""
    waking: bool = False
    """Whether the drives of a parked mount may have power: the program that switches it on was begun."""
    weather: str | None = None
    summary: str | None = None
    notes: tuple[str, ...] = ()
    noted_night: int = 0
    """The night that the notes are of."""
    message: str | None = None
    """What to report of the last event."""

    @property
    def at(self) -> NightPass | None:
        """The pass that is next, or in progress; None where none is left."""
        place = len(self.results)
        return self.passes[place] if place < len(self.passes) else None


S_PER_DEG = 240.0
SHORT_S = 4.0 * 3600.0
"""A shorter rest of a run does not count as a night."""
LATE_S = 5.0
"""A pass that is shorter by no more than this was followed to its end."""


def at_of(run: Run) -> NightPass:
    """Return the pass that is next, or in progress; there must be one."""
    found = run.at
    assert found is not None
    return found


def stepped(run: Run) -> NightPass:
    """Return the pass whose actions are carried out: after it, it is the last that has a result."""
    return run.passes[len(run.results) - 1] if run.state is RunState.FINISHING else at_of(run)


def actions_of(run: Run) -> tuple[Action, ...]:
    """Return the actions that are being carried out, those before a pass or those after it."""
    terms = stepped(run).terms
    return terms.after if run.state is RunState.FINISHING else terms.before


def prepared_from_s(run: Run) -> float:
    """Return from when on the next pass is prepared, POSIX seconds."""
    wake_s = run.settings.wake_s if run.mount is Mount.PARKED else 0.0
    return at_of(run).leave_utc_s - run.settings.prepare_s - wake_s


def decided_since(run: Run, revision: int) -> bool:
    """Tell whether what is decided here is decided by the rules of a revision, or later ones."""
    return run.settings.revision >= revision


def enough_left(run: Run, utc_s: float, another: bool = False) -> bool:
    """Return whether enough of the next pass is left to be worth following."""
    one = at_of(run)
    left_s = one.end_utc_s - max(utc_s, one.start_utc_s)
    # What was begun is followed on however short the rest is, if it can be reached at all.
    least_s = 2.0 * LATE_S if another else min(one.terms.least_s, one.end_utc_s - one.start_utc_s)
    return left_s >= least_s - 1.0


class FollowedPass(NamedTuple):
    """A pass that was followed for a while: its satellite, when it is highest, and the entry that asked."""

    catalog_number: int
    culminate_utc_s: float
    asked_by: str


def object_number(catalog_number: int | None, name: str) -> int:
    """Return what tells an object from others: below 0, by its name, where it has no catalogue number."""
    if catalog_number is None or catalog_number in NO_NUMBERS:
        return -zlib.crc32(name.encode())
    return catalog_number


def mean_noon_s(longitude_deg: float) -> float:
    """Return the site's mean noon, at which nights change, seconds after midnight UTC."""
    return (0.5 * DAY_S - S_PER_DEG * longitude_deg) % DAY_S


def first_night(run: Run, now_utc_s: float) -> Run:
    """Return a run with its first night found: the one in progress, where it could have begun before."""
    return _night_from(run, max(run.settings.from_utc_s, now_utc_s), 1)


def run_begun(run: Run, now_utc_s: float) -> bool:
    """Return whether the run's first night is known and has begun; before that its beginning may be moved."""
    return run.night > 1 or (run.night == 1 and (run.passes != () or now_utc_s >= run.night_from_utc_s))


def recovered_night(run: Run, known: Recovered, now_utc_s: float) -> Run:
    """Return a run that goes on from the last status: its night, or the next where that is over."""
    run = replace(run, mount=known.mount, summary=known.summary)
    if now_utc_s >= known.night_to_utc_s:
        return _night_from(run, max(run.settings.from_utc_s, now_utc_s), known.night + 1)
    run = _night_from(run, known.night_from_utc_s, known.night)
    return replace(run, over=known.over)


def with_settings(run: Run, settings: RunSettings) -> Run:
    """Return the run with the schedule's new settings; a night that has begun keeps its beginning."""
    return _night_from(replace(run, settings=settings), run.night_from_utc_s, run.night)


def next_night(run: Run, now_utc_s: float) -> Run:
    """Return the run with the next night: the one in progress where some were slept through."""
    begin, number = run.night_to_utc_s, run.night + 1
    while _end_of(run, begin) <= now_utc_s and not _is_last(run, begin):
        begin = _end_of(run, begin)
    return _night_from(replace(run, passes=(), results=(), others={}, over=()), begin, number)


def near_night(run: Run, now_utc_s: float) -> Run:
    """Return the run with the night in progress in place of one that a clock far ahead has made it wait for.

    A clock that is behind the run's own beginning is wrong now, and by that one nothing is begun.
    """
    far = run.night > 1 and run.night_from_utc_s - now_utc_s > DAY_S + SHORT_S
    waits = run.passes == () or run.state in (RunState.WAITING, RunState.STOPPED)
    if not (far and waits and 0.0 < run.first_utc_s <= now_utc_s):
        return run
    return _night_from(replace(run, passes=(), results=(), others={}, over=()), now_utc_s, run.night)


def _night_from(run: Run, begin: float, number: int) -> Run:
    return replace(run, night=number, night_from_utc_s=begin, night_to_utc_s=_end_of(run, begin))


def _end_of(run: Run, begin: float) -> float:
    """Return the end of the night that begins then: the next noon at the site, or the run's end."""
    noon = run.settings.noon_s
    end = (math.floor((begin - noon) / DAY_S + 1e-9) + 1.0) * DAY_S + noon
    last = run.settings.to_utc_s
    # A few hours at the end are no night of their own.
    return last if last is not None and end + SHORT_S >= last else end


def _is_last(run: Run, begin: float) -> bool:
    return run.settings.to_utc_s is not None and _end_of(run, begin) >= run.settings.to_utc_s

"""A night of the network: what may be followed, by whom best, and the schedule of each station."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, field, replace
from itertools import count, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.core.errors import BadInputError
from sattrack.network.assign import Assigned, Assignment, StationPasses, assign, repaired
from sattrack.network.dataset import MANIFEST
from sattrack.network.search import parquet_modules, station_days
from sattrack.network.stations import station_named
from sattrack.schedule.candidates import Loaded, PlanSituation
from sattrack.schedule.file import load_schedule
from sattrack.schedule.making import make_plan
from sattrack.schedule.night import object_number
from sattrack.schedule.transitions import ActionCost, Overhead, SlewTransitions, place_above
from tle.errors import AmbiguousSatelliteError
from tle.instants import DAY_S, Utc
from tle.passes import HOUR_S
from tle.sources import NO_NUMBERS, find, key_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.network import stations as listed
    from sattrack.safety.limits import SafetyLimits
    from tle.elements import Elements

    Array = NDArray[np.float64]
    Span = tuple[float, float]

DARK_SUN_DEG = -6.0
MOST_A_STATION = 2000
LEAST_COMMON_S = 60.0
_LEAST_SEARCH_S = 2.0
_MOST_ROUNDS = 6
"""So often passes with a conflict are tried in other plans, before they are left out."""
_COLUMNS = ("rise_utc", "culminate_utc", "set_utc", "sunlit_from_utc", "sunlit_to_utc")
_FIELDS = ("max_alt_deg", "rise_az_deg", "culminate_az_deg", "set_az_deg", "sun_alt_deg")


class Begun(NamedTuple):
    """An assignment that has begun: POSIX seconds."""

    station: str
    number: int
    """As `NightPasses` has it."""
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Wishes:
    """What makes a pass worth following.

    `priorities` and `seen_s` (POSIX seconds of the last sight) are by catalogue number. A satellite that was
    not seen for `gap_s` is fresh; another pass counts the share `repeat`. Two stations further apart than
    `baseline_km` that look at once add the share `parallax` to either. Passes are followed for `longest_s`
    around their highest instant; those shorter than that and than `least_s` do not count, nor do elements
    older than `oldest_days`. In `any_light` neither the night nor sunlight matter. `closed` are spans of bad
    weather by station, `begun` the assignments that have begun by `now_s`; nothing else starts before that.
    `sources` are those of the elements.
    """

    priorities: Mapping[int, float] = field(default_factory=dict)
    seen_s: Mapping[int, float] = field(default_factory=dict)
    gap_s: float = 12.0 * 3600.0
    repeat: float = 0.25
    parallax: float = 0.5
    baseline_km: float = 100.0
    longest_s: float = 600.0
    least_s: float = 60.0
    oldest_days: float = 7.0
    any_light: bool = False
    settle_s: float = 5.0
    closed: Mapping[str, Sequence[Span]] = field(default_factory=dict)
    now_s: float = -math.inf
    sources: Sequence[str] = ()
    begun: Sequence[Begun] = ()


@dataclass(frozen=True, slots=True)
class Mounted:
    """A station with its mount: profile and limits."""

    station: listed.Station
    profile: MountProfile
    limits: SafetyLimits


@dataclass(frozen=True, slots=True)
class NightPasses:
    """Passes that may be followed, in columns: station by index, POSIX seconds, degrees.

    `number` is `object_number`'s: below 0 where a satellite has no catalogue number.
    """

    station: NDArray[np.intp]
    number: NDArray[np.intp]
    name: NDArray[Any]
    start_s: Array
    end_s: Array
    value: Array
    start_altaz_deg: Array
    end_altaz_deg: Array

    def take(self, which: NDArray[Any]) -> NightPasses:
        """Return some of them."""
        return NightPasses(*(getattr(self, name)[which] for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class Night:
    """The outcome: the passes taken, each with what it adds and whether another station looks as well."""

    span: Span
    passes: NightPasses
    worths: Array
    together: NDArray[np.bool_]
    assigned: Assigned
    left_out: int

    def document(self, stations: Sequence[Mounted]) -> dict[str, Any]:
        """Return the JSON document of `network assign`."""
        rows = [
            {
                "station": stations[self.passes.station[k]].station.name,
                "catalog_number": number if (number := int(self.passes.number[k])) > 0 else None,
                "name": str(self.passes.name[k]),
                "start_utc": Utc(float(self.passes.start_s[k])).isoformat("seconds"),
                "end_utc": Utc(float(self.passes.end_s[k])).isoformat("seconds"),
                "value": round(float(self.worths[k]), 3),
                "together": bool(self.together[k]),
            }
            for k in range(len(self.worths))
        ]
        figures = self.assigned
        return {
            "value": round(figures.value, 3),
            "bound": round(figures.bound, 3),
            "gap": round(figures.gap, 6),
            "assignments": rows,
        }


def data_set_span(folder: Path) -> Span:
    """Return the span of a data set of passes, POSIX seconds. Raises BadInputError where it is none."""
    try:
        settings = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["settings"]
        start_s = float(Utc.parse(settings["from_utc"]).unix_s)
        return start_s, start_s + 3600.0 * settings["hours"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInputError(
            f"{folder}: no data set of passes; make one with `sattrack network passes`"
        ) from None


def by_object(elements: Sequence[Elements], tell: Callable[[str], None]) -> dict[int, Elements]:
    """Return elements by `object_number`, without satellites that a schedule cannot name.

    `tell` takes what they have in common.
    """
    found: dict[int, list[Elements]] = {}
    for one in elements:
        found.setdefault(object_number(one.catalog_number, one.label), []).append(one)
    named = {}
    for number, alike in found.items():
        try:
            if number < 0 or len(alike) > 1:
                find(elements, key_of(alike[0]))
            named[number] = alike[0]
        except AmbiguousSatelliteError as error:
            tell(f"left out: {error}")
    return named


def read_passes(
    folder: Path,
    stations: Sequence[Mounted],
    wishes: Wishes,
    elements: Mapping[int, Elements],
    tell: Callable[[str], None],
) -> NightPasses:
    """Return the passes of a data set that are worth following, the most valuable of each station.

    `tell` takes how many are left out as their elements are too old. Raises BadInputError for a folder that
    is no data set, lacks a station, or is not finished.
    """
    span = data_set_span(folder)
    hours = (span[1] - span[0]) / HOUR_S
    found, too_old = [], 0
    for index, one in enumerate(stations):
        place = folder / f"station={one.station.name}"
        if not place.is_dir():
            raise BadInputError(f"{folder}: holds no passes over the station {one.station.name!r}")
        files = [day.path for day in station_days([one.station], Utc(span[0]), hours)]
        if absent := [file for file in files if not (folder / file).is_file()]:
            raise BadInputError(
                f"{folder}: is not finished: there is no {absent[0]}; the command that made it continues it"
            )
        some = _worth_following(_read(place), index, one, wishes, span)
        ages = np.array([_age_days(elements, k, t) for k, t in zip(some.number, some.end_s, strict=True)])
        is_old = ages > wishes.oldest_days
        too_old += int(np.count_nonzero(is_old))
        some = some.take(np.flatnonzero(~is_old))
        order = np.lexsort((some.number, some.start_s, -some.value))[:MOST_A_STATION]
        begun = _begun(some, one.station.name, wishes)
        some = some.take(np.union1d(order, begun))
        found.append(some)
    if too_old:
        days = f"{wishes.oldest_days:g} days"
        tell(f"{too_old} passes left out: their elements are more than {days} from them, or are not given")
    return NightPasses(
        *(np.concatenate([getattr(one, name) for one in found]) for name in NightPasses.__slots__)
    )


def _age_days(elements: Mapping[int, Elements], number: int, at_s: float) -> float:
    one = elements.get(int(number))
    return math.inf if one is None else abs(at_s - float(one.epoch.unix_s)) / DAY_S


def _read(place: Path) -> dict[str, Any]:
    _, parquet = parquet_modules()
    table = parquet.read_table(place, columns=["catalog_number", "name", *_COLUMNS, *_FIELDS])
    numbers = table["catalog_number"].to_numpy().astype(np.intp)
    rows: dict[str, Any] = {"name": np.array(table["name"].to_pylist(), dtype=object)}
    for k in np.flatnonzero(np.isin(numbers, NO_NUMBERS)).tolist():
        numbers[k] = object_number(int(numbers[k]), rows["name"][k] or str(numbers[k]))
    rows["number"] = numbers
    for name in _COLUMNS:
        ms = table[name].to_numpy().astype("datetime64[ms]")
        rows[name] = np.where(np.isnat(ms), np.nan, ms.astype(np.int64) / 1000.0)
    for name in _FIELDS:
        rows[name] = table[name].to_numpy(zero_copy_only=False).astype(np.float64)
    return rows


def _worth_following(
    rows: dict[str, Any], index: int, one: Mounted, wishes: Wishes, span: Span
) -> NightPasses:
    top = rows["culminate_utc"]
    low, high = np.nan_to_num(rows["rise_utc"], nan=span[0]), np.nan_to_num(rows["set_utc"], nan=span[1])
    middle = np.clip(top, low + 0.5 * wishes.longest_s, np.maximum(high - 0.5 * wishes.longest_s, low))
    is_long = high - low > wishes.longest_s
    start = np.ceil(np.where(is_long, middle - 0.5 * wishes.longest_s, low))
    end = np.floor(np.where(is_long, middle + 0.5 * wishes.longest_s, high))
    useful = end - start
    keep = is_long | (useful >= wishes.least_s)
    if not wishes.any_light:
        keep &= rows["sun_alt_deg"] <= DARK_SUN_DEG
        with np.errstate(invalid="ignore"):
            lit = np.minimum(end, rows["sunlit_to_utc"]) - np.maximum(start, rows["sunlit_from_utc"])
        useful = np.nan_to_num(lit, nan=0.0)
        keep &= useful > 0.0
    for closed_from, closed_to in wishes.closed.get(one.station.name, ()):
        keep &= (end <= closed_from) | (start >= closed_to)
    priority = np.array([wishes.priorities.get(int(n), 1.0) for n in rows["number"]], dtype=np.float64)
    value = priority * np.maximum(useful, 0.0) * np.sin(np.radians(rows["max_alt_deg"]))
    # Where a pass is cut it is entered or left near its highest instant.
    skyline = one.station.skyline()

    def altaz(cut: Any, azimuth: Any) -> Array:
        at_edge = np.stack([skyline.altitude_deg(np.nan_to_num(azimuth)) + 0.0 * top, azimuth])
        return np.where(cut, np.stack([rows["max_alt_deg"], rows["culminate_az_deg"]]), at_edge).T

    found = NightPasses(
        np.full(len(top), index, dtype=np.intp),
        rows["number"],
        rows["name"],
        start,
        end,
        value,
        altaz(is_long | np.isnan(rows["rise_utc"]), rows["rise_az_deg"]),
        altaz(is_long | np.isnan(rows["set_utc"]), rows["set_az_deg"]),
    )
    keep &= value > 0.0
    keep &= start >= wishes.now_s
    keep[_begun(found, one.station.name, wishes)] = True
    return found.take(np.flatnonzero(keep))


def _begun(passes: NightPasses, station: str, wishes: Wishes) -> NDArray[np.intp]:
    """Return which passes of a station have begun by an earlier assignment, and are not closed.

    By other elements, or from another beginning of the search, the same pass has other instants.
    """
    is_begun = np.zeros(len(passes.value), dtype=bool)
    for one in wishes.begun:
        if one.station == station:
            at_once = (passes.start_s < one.end_s) & (passes.end_s > one.start_s)
            is_begun |= at_once & (passes.number == one.number)
    for closed_from, closed_to in wishes.closed.get(station, ()):
        is_begun &= (passes.end_s <= closed_from) | (passes.start_s >= closed_to)
    return np.flatnonzero(is_begun)


def _clash(passes: NightPasses, one: Mounted, settle_s: float) -> NDArray[np.bool_]:
    """Return which passes of a station, in order of their ends, do not fit one after the other."""
    count = len(passes.value)
    mounted = one.station.site, one.profile
    firsts, lasts = (
        [place_above(alt, az, *mounted) for alt, az in altaz_deg.tolist()]
        for altaz_deg in (passes.start_altaz_deg, passes.end_altaz_deg)
    )
    overheads = [
        Overhead(ActionCost(first, 0.0, first), settle_s, ActionCost(last, 0.0, last))
        for first, last in zip(firsts, lasts, strict=True)
    ]
    slews = SlewTransitions.of(overheads, one.profile)
    clash = np.zeros((count, count), dtype=bool)
    every = np.arange(count)
    for later in range(count):
        clash[:, later] = passes.end_s + slews.seconds(every, later) > passes.start_s[later]
    # Of two, one must be before the other.
    both: NDArray[np.bool_] = clash & clash.T
    np.fill_diagonal(both, val=False)
    return both


def together_of(
    passes: NightPasses, stations: Sequence[Mounted], baseline_km: float
) -> dict[int, NDArray[np.intp]]:
    """Return of each pass those of other stations, far enough away, that show the satellite at once."""
    places = np.array([one.station.site.itrs_km for one in stations])
    apart = np.linalg.norm(places[:, None] - places[None, :], axis=2) >= baseline_km
    order = np.lexsort((passes.start_s, passes.number))
    found: dict[int, list[int]] = {}
    edges = np.flatnonzero(np.diff(passes.number[order], prepend=-1, append=-1))
    for low, high in pairwise(edges.tolist()):
        for at in range(low, high):
            one = int(order[at])
            for other in order[at + 1 : high].tolist():
                if passes.start_s[other] > passes.end_s[one] - LEAST_COMMON_S:
                    break
                common = min(passes.end_s[one], passes.end_s[other]) - passes.start_s[other]
                if common >= LEAST_COMMON_S and apart[passes.station[one], passes.station[other]]:
                    found.setdefault(one, []).append(other)
                    found.setdefault(other, []).append(one)
    return {one: np.array(sorted(others), dtype=np.intp) for one, others in found.items()}


def _fresh(passes: NightPasses, wishes: Wishes, start_s: float) -> NDArray[np.intp]:
    """Return the number of each pass' satellite and time in which one counts in full; -1 where none does."""
    numbers: dict[tuple[int, int], int] = {}
    fresh = np.full(len(passes.value), -1, dtype=np.intp)
    for k, (number, at) in enumerate(zip(passes.number.tolist(), passes.start_s.tolist(), strict=True)):
        seen_s = wishes.seen_s.get(number)
        stretch = math.floor((at - (start_s if seen_s is None else seen_s)) / wishes.gap_s)
        if seen_s is None or stretch > 0:
            fresh[k] = numbers.setdefault((number, stretch), len(numbers))
    return fresh


def plan_night(
    passes: NightPasses,
    stations: Sequence[Mounted],
    wishes: Wishes,
    elements: Mapping[int, Elements],
    folder: Path,
    span: Span,
    seconds: float = 60.0,
    progress: Callable[[str, int, int], None] | None = None,
) -> Night:
    """Assign passes to stations, and write a schedule for each that its planner takes as it is.

    Where a station's planner refuses a pass, by the mount's limits or a way round them, the choice is made
    anew without it. Raises SattrackError, BadInputError, TleError.
    """
    members = [np.flatnonzero(passes.station == k) for k in range(len(stations))]
    members = [which[np.argsort(passes.end_s[which], kind="stable")] for which in members]
    clashes = [_clash(passes.take(w), one, wishes.settle_s) for w, one in zip(members, stations, strict=True)]
    value = passes.value.copy()
    kept = np.concatenate(
        [np.empty(0, dtype=np.intp)]
        + [
            w[_begun(passes.take(w), one.station.name, wishes)]
            for w, one in zip(members, stations, strict=True)
        ]
    )
    value[kept] = np.maximum(value[kept], 1e-6)
    fresh, together = _fresh(passes, wishes, span[0]), together_of(passes, stations, wishes.baseline_km)
    left_out: set[int] = set()
    checked: list[set[tuple[int, int]]] = [set() for _ in stations]
    left_s, again = seconds, list[int]()
    found = Assigned(np.empty(0, dtype=np.intp), 0.0, math.inf)
    for number in count():
        every = [StationPasses(w, clash) for w, clash in zip(members, clashes, strict=True)]
        problem = Assignment(
            passes.start_s, value, every, fresh, together, kept, wishes.repeat, wishes.parallax
        )
        begun_s = time.monotonic()
        found = _chosen(problem, found, [every[k] for k in again], left_s)
        left_s -= time.monotonic() - begun_s
        again = []
        for k, one in enumerate(stations):
            if progress is not None:
                progress("planned", k, len(stations))
            mine = np.intersect1d(members[k], found.taken)
            mine = mine[np.argsort(passes.start_s[mine], kind="stable")]
            file = folder / f"{one.station.name}.toml"
            text = schedule_text(passes.take(mine), one, wishes, elements, span)
            file.write_text(text, encoding="utf-8")
            refused = _refused(file, mine, passes, one, elements, span, checked[k])
            again += [k] if refused else []
            for lost, others in refused:
                rows = np.flatnonzero(np.isin(members[k], others))
                if len(rows) and number < _MOST_ROUNDS and lost not in kept:
                    own = np.flatnonzero(members[k] == lost)
                    clashes[k][own, rows] = clashes[k][rows, own] = True
                else:
                    value[lost] = 0.0
                    kept = kept[kept != lost]
                    left_out.add(lost)
        if progress is not None:
            progress("planned", len(stations), len(stations))
        if not again:
            break
    taken = found.taken
    worths = problem.worths(taken)
    order = np.lexsort((passes.station[taken], passes.start_s[taken]))
    shared = np.array([bool(np.isin(together.get(int(k), ()), taken).any()) for k in taken], dtype=bool)
    return Night(span, passes.take(taken[order]), worths[order], shared[order], found, len(left_out))


def _chosen(problem: Assignment, before: Assigned, again: Sequence[StationPasses], left_s: float) -> Assigned:
    """Return a choice, begun with one of a problem that allowed more: its bound holds for this one too.

    It takes half of the time that is left; where little is, some stations alone are planned `again`.
    """
    known = repaired(problem, before.taken, again)
    found = Assigned(known, problem.worth(known), before.bound)
    if left_s > _LEAST_SEARCH_S or math.isinf(before.bound):
        found = assign(problem, 0.5 * left_s, known=known)
    return replace(found, bound=max(found.value, min(found.bound, before.bound)))


def _refused(
    file: Path,
    mine: NDArray[np.intp],
    passes: NightPasses,
    one: Mounted,
    elements: Mapping[int, Elements],
    span: Span,
    checked: set[tuple[int, int]],
) -> list[tuple[int, list[int]]]:
    """Return the passes of a schedule that its planner loses, each with those that it conflicts with.

    What the planner allows, each pass and the way from one to the next, depends on those two alone: passes
    that follow each other as in `checked` are left out, and those that it allows are added there (-1: none).
    """
    pairs = set(pairwise([-1, *mine.tolist(), -1]))
    fresh = np.isin(mine, list({k for pair in pairs - checked for k in pair}))
    if not fresh.any():
        return []
    known = Loaded([elements[int(n)] for n in dict.fromkeys(passes.number[mine].tolist())], False, str(file))
    situation = PlanSituation(span, span[0], one.station.site, one.profile, one.limits)
    schedule = load_schedule(file)
    entries = tuple(entry for entry, is_fresh in zip(schedule.entries, fresh, strict=True) if is_fresh)
    plan, _ = make_plan(replace(schedule, entries=entries), situation, lambda _: known)
    # A pass that is cut by a skyline begins later than it was asked for.
    at = {str(entry.origin): k for entry, k in zip(schedule.entries, mine.tolist(), strict=True)}
    taken = [at[one.asked_at] for one in plan.passes]
    refused = {at[lost.asked_at]: [taken[number - 1] for number in lost.with_numbers] for lost in plan.lost}
    checked |= {pair for pair in pairs if not refused.keys() & set(pair)}
    return list(refused.items())


def _iso(utc_s: float) -> str:
    return Utc(float(utc_s)).isoformat("seconds")


def schedule_text(
    passes: NightPasses, one: Mounted, wishes: Wishes, elements: Mapping[int, Elements], span: Span
) -> str:
    """Return a station's schedule for `sattrack run`: its passes at fixed times."""
    import tomlkit

    site = one.station.site
    where = f"{site.latitude_deg},{site.longitude_deg},{site.height_m}"
    document: dict[str, Any] = {
        "timezone": "UTC",
        "from": _iso(span[0]),
        "to": _iso(math.ceil(span[1])),
        "elements": list(wishes.sources),
        "defaults": {
            "min_altitude_deg": one.station.min_altitude_deg,
            "settle_s": wishes.settle_s,
            "elements_oldest_days": wishes.oldest_days,
            "least_s": wishes.least_s,
            **({"if_sun_up": "run"} if wishes.any_light else {}),
        },
        "fixed": [
            {"satellite": key_of(elements[number]), "start": _iso(start), "end": _iso(end)}
            for number, start, end in zip(
                passes.number.tolist(), passes.start_s.tolist(), passes.end_s.tolist(), strict=True
            )
        ],
    }
    head = f"# {one.station.name}: sattrack run {one.station.name}.toml --site {where}\n"
    if not document["fixed"]:
        return f"{head}# Nothing is assigned to this station.\n"
    return head + tomlkit.dumps(document)


def read_closed(texts: Sequence[str], stations: Sequence[listed.Station]) -> dict[str, list[Span]]:
    """Return spans of bad weather by station, of STATION=FROM/TO each. Raises BadInputError, TleError."""
    closed: dict[str, list[Span]] = {}
    for text in texts:
        name, equals, span = text.partition("=")
        start, slash, end = span.partition("/")
        if not (equals and slash):
            raise BadInputError(
                f"--closed {text!r}: write STATION=FROM/TO, as leiden=2026-10-02T20:00Z/2026-10-03T06:00Z"
            )
        at = float(Utc.parse(start).unix_s), float(Utc.parse(end).unix_s)
        if not at[1] > at[0]:
            raise BadInputError(f"--closed {text!r}: ends before it begins")
        closed.setdefault(station_named(stations, name).name, []).append(at)
    return closed

"""Passes that a plan may be made of: those that the entries of a schedule ask for, judged by the mount."""

from __future__ import annotations

import fnmatch
import math
import re
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.core.angles import altitude_deg
from sattrack.core.errors import BadInputError, meant
from sattrack.planning.kinematics import ability_at, verdict_on
from sattrack.planning.path import AxisSamples, bodies_deg, margins_deg
from sattrack.safety.bodies import sun_over
from sattrack.schedule.night import object_number
from tle.elements import Elements
from tle.ephemeris import SourceRank, source_rank
from tle.errors import AmbiguousSatelliteError, SatelliteNotFoundError, TleError
from tle.facts import pass_facts, sun_altitudes_deg
from tle.horizon import Horizon, HorizonMask
from tle.instants import DAY_S, Utc
from tle.passes import find_catalogue_passes, find_ephemeris_passes
from tle.propagator import Propagator
from tle.sources import find

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.planning.kinematics import PredictedLoss
    from sattrack.safety.limits import SafetyLimits
    from sattrack.schedule.file import Schedule, ScheduleEntry
    from sattrack.schedule.night import FollowedPass
    from tle.ephemeris import Ephemeris
    from tle.facts import PassFacts
    from tle.passes import CataloguePasses, SatellitePass
    from tle.site import Site

    Array = NDArray[np.float64]
    Span = tuple[float, float]
    Load = Callable[[str | None], "Loaded"]
    Progress = Callable[[str, int, int], None]
    Cut = tuple[Span, tuple[str, str] | None]
    """What of a pass may be followed, and why it is lost all the same."""


TOO_LOW, CUT, SHORT, NOT_LIT = "too low", "cut", "too short", "not sunlit"
FAINT, FAST = "too faint", "too fast"
OLD, SUN, INFEASIBLE, PIER, CROWDED = "elements too old", "Sun up", "infeasible", "pier side", "too many"


SOON_S = 120.0
"""What begins so soon after a night is followed by that night: the next must first plan, prepare and slew."""


@dataclass(frozen=True, slots=True)
class Loaded:
    """The elements of one source; fresh ones are available before each pass where it is a provider's."""

    elements: list[Elements]
    renewable: bool
    name: str


@dataclass(frozen=True, slots=True)
class PlanSituation:
    """Where and when: the plan's span in POSIX seconds of UTC, the instant of planning, site and mount."""

    span: Span
    now_utc_s: float
    site: Site
    profile: MountProfile
    limits: SafetyLimits
    magnitudes: Mapping[int, float] = field(default_factory=dict)
    followed: tuple[FollowedPass, ...] = ()
    """What the run has followed already, by culmination: it counts where a rule takes only so many."""
    workers: int = 1
    stars: str | None = None
    """The file of all stars of the Hipparcos catalogue, where there is one."""
    whole_until_utc_s: float | None = None
    """Until when passes by fixed times that begin in the span or soon after, and must be whole, may last.

    None: the span's end.
    """


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pass that may be taken: POSIX seconds of UTC, degrees.

    `start_utc_s` to `end_utc_s` is all that may be followed of it; where it may be shortened it is entered
    by `latest_start_utc_s` and left from `earliest_end_utc_s` on. `culminate_utc_s` is its highest instant
    between start and end, `max_alt_deg` its altitude then. `useful` are the stretches that count. `lost` says
    why it is none, kind and words, None where it may be chosen. One that `may_join` is entered late where the
    mount cannot be there at its start from the plan's beginning; `late_s` is by how much.
    """

    number: int
    entry: int
    elements: Elements | Ephemeris
    start_utc_s: float
    culminate_utc_s: float
    end_utc_s: float
    latest_start_utc_s: float
    earliest_end_utc_s: float
    max_alt_deg: float
    useful: tuple[Span, ...]
    priority: float
    sun_alt_deg: float | None = None
    magnitude: float | None = None
    lost: tuple[str, str] | None = None
    notes: tuple[str, ...] = ()
    may_join: bool = False
    late_s: float = 0.0
    foretold: tuple[PredictedLoss, ...] = ()
    """What the mount's limits take of it; no part of `useful`, unless it is run though infeasible."""

    asked: str = ""
    """What the schedule calls the target."""
    file: str | None = None
    """The file that places it, None where none does."""

    @property
    def object_number(self) -> int:
        """Give what tells the target from others."""
        return object_number(self.elements.catalog_number, self.elements.label)

    @property
    def useful_s(self) -> float:
        """Give the seconds that count of the whole."""
        return self.useful_within(self.start_utc_s, self.end_utc_s)

    @property
    def value(self) -> float:
        """Give the worth of the whole: priority times useful seconds."""
        return self.priority * self.useful_s

    def without(self, lost: tuple[PredictedLoss, ...]) -> Candidate:
        """Return the candidate without what the mount's limits take of it."""
        useful = list(self.useful)
        for loss in lost:
            cut = ((a, min(b, loss.begin_utc_s)) for a, b in useful)
            rest = ((max(a, loss.end_utc_s), b) for a, b in useful)
            useful = sorted((a, b) for a, b in (*cut, *rest) if b > a)
        return replace(self, useful=tuple(useful), foretold=lost)

    def useful_within(self, start_utc_s: float, end_utc_s: float) -> float:
        """Return the seconds that count between two instants."""
        return sum(max(0.0, min(b, end_utc_s) - max(a, start_utc_s)) for a, b in self.useful)


@dataclass(slots=True)
class Found:
    """The outcome of an entry: passes found, the count dropped for each reason, and a note for the user."""

    passes: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)


class EntrySearch:
    """The passes that one entry asks for."""

    def __init__(
        self, number: int, entry: ScheduleEntry, situation: PlanSituation, progress: Progress | None
    ) -> None:
        """Take an entry with its number in the schedule."""
        self.found = Found()
        self._number, self._entry, self._situation = number, entry, situation
        self._progress = progress
        self._by_name = bool(entry.satellites)
        self._named: dict[int, Named] = {}

    def run(self, load: Load, magnitudes_known: bool) -> list[Candidate]:
        """Return those that are reported. Raises BadInputError that names the entry, TleError."""
        entry, span = self._entry, self._situation.span
        if entry.conditions.brighter_than is not None and not magnitudes_known:
            raise entry.origin.wrong(
                "the rule asks for magnitudes, which element sets do not tell: set magnitudes = FILE"
            )
        self._load = load
        chosen = self._chosen()
        if entry.fixed is not None:
            last, until = span[1], self._situation.whole_until_utc_s
            if until is not None and entry.fixed[0] < last + SOON_S and not entry.terms.shorten:
                last = until
            clipped = (max(entry.fixed[0], span[0]), min(entry.fixed[1], last))
            if clipped != entry.fixed and not (entry.terms.shorten and clipped[0] < clipped[1]):
                return [self._not_fixed(chosen[0], CUT, "not whole within the plan's time")]
            windows, span = [clipped], clipped
        else:
            windows = [span] if entry.windows is None else entry.windows(span)
        if not chosen or not windows:
            if not windows:
                self.found.notes.append("its window lies outside the plan's time")
            return []
        passes = self._passes(chosen, span)
        if passes.failed:
            count, first = len(passes.failed), passes.failed[0][1]
            self.found.notes.append(f"{count} of {len(chosen)} objects left out, the first: {first}")
        if entry.fixed is not None and not len(passes):
            words = f"below {entry.terms.min_altitude_deg:g}° or the skyline throughout"
            return [self._not_fixed(chosen[0], TOO_LOW, words)]
        return self._candidates(passes, windows)

    def _not_fixed(self, elements: Elements | Ephemeris, why: str, words: str) -> Candidate:
        """Return the pass by fixed times that cannot be."""
        low, high = self._entry.fixed or self._situation.span
        instants = np.linspace(low, high, 60)
        seen: Any = Propagator(elements, self._situation.site).at(Utc(instants))
        alt = np.nan_to_num(np.asarray(seen.alt_deg), nan=-90.0)
        return Candidate(
            number=-1,
            entry=self._number,
            elements=elements,
            start_utc_s=low,
            culminate_utc_s=float(instants[int(np.argmax(alt))]),
            end_utc_s=high,
            latest_start_utc_s=low,
            earliest_end_utc_s=high,
            max_alt_deg=float(np.max(alt)),
            useful=((low, high),),
            priority=self._entry.terms.priority,
            lost=(why, words),
        )

    def _chosen(self) -> Sequence[Elements | Ephemeris]:
        entry = self._entry
        if not self._by_name:
            loaded = self._load(entry.source)
            glob = entry.conditions.named.casefold()
            matching = [
                e for e in loaded.elements if not glob or fnmatch.fnmatchcase(e.name.casefold(), glob)
            ]
            if not matching:
                of = f" whose name matches {entry.conditions.named!r}" if glob else ""
                self.found.notes.append(
                    f"matches no object: {loaded.name} holds {len(loaded.elements)}, none{of}"
                )
            return self._launched(matching)
        named = named_by(entry, self._load, self._situation, self.found.notes.append)
        self._named = {id(one.target): one for one in named}
        return self._launched([one.target for one in named])

    def _launched(self, found: Sequence[Elements | Ephemeris]) -> Sequence[Elements | Ephemeris]:
        """Return those of some satellites that were launched when and as what the conditions ask for."""
        c = self._entry.conditions
        if not (c.designator or c.launched_from or c.launched_before):
            return found
        low, high = c.launched_from or 0, c.launched_before or math.inf
        kept = [
            e
            for e in found
            if isinstance(e, Elements)
            and (year := re.match(r"\d{4}(?=-)", e.designator))
            and low <= int(year[0]) < high
            and fnmatch.fnmatchcase(e.designator, c.designator.upper() or "*")
        ]
        if found and not kept:
            unknown = sum(not (isinstance(e, Elements) and re.match(r"\d{4}-", e.designator)) for e in found)
            self.found.notes.append(
                f"none of {len(found)} objects has the launch or designator asked for"
                + (f"; {unknown} have no designator" if unknown else "")
            )
        return kept

    def _passes(self, chosen: Sequence[Elements | Ephemeris], span: Span) -> CataloguePasses:
        situation = self._situation
        skyline = situation.limits.horizon
        mask = None
        if skyline:
            mask = HorizonMask(tuple(a for a, _ in skyline), tuple(h for _, h in skyline))
        progress = self._progress
        horizon, hours = Horizon(self._entry.terms.min_altitude_deg, mask), (span[1] - span[0]) / 3600.0
        elements = [one for one in chosen if isinstance(one, Elements)]
        if len(elements) < len(chosen):
            return find_ephemeris_passes(chosen, situation.site, Utc(span[0]), hours, horizon)
        return find_catalogue_passes(
            elements,
            situation.site,
            Utc(span[0]),
            hours,
            horizon,
            workers=situation.workers,
            progress=None if progress is None else lambda done, total: progress("searched", done, total),
        )

    def _candidates(self, passes: CataloguePasses, windows: list[Span]) -> list[Candidate]:
        """Return the passes that are reported: of a rule only those that meet its conditions."""
        self.found.passes = len(passes)
        if not len(passes):
            if not passes.failed:
                self._report_none(passes)
            return []
        seen = list(passes)
        suns = sun_altitudes_deg(passes)
        kept: list[tuple[int, Cut, float]] = []
        for k, one in enumerate(seen):
            cuts = self._cuts(passes, one, windows)
            if not cuts:
                self.found.dropped["outside the window"] += 1
            for cut in cuts:
                sun_deg = self._sun_deg(one, cut, float(suns[k]))
                if self._keep_before_facts(one, sun_deg, cut):
                    kept.append((k, cut, sun_deg))
        progress = self._progress
        wanted = sorted({k for k, _, _ in kept})
        facts = pass_facts(
            passes,
            wanted,
            self._situation.magnitudes,
            None if progress is None else lambda done, total: progress("looked at", done, total),
        )
        known = dict(zip(wanted, facts, strict=True))
        made = (self._candidate(seen[k], known[k], sun_deg, cut) for k, cut, sun_deg in kept)
        return self._by_best_source([one for one in made if one is not None])

    def _by_best_source(self, found: list[Candidate]) -> list[Candidate]:
        """Return each pass once: where several ephemerides of an object have it, the one by the best of them.

        One by which the pass is not lost comes first. What overlaps is one pass, placed a little differently.
        """
        passes: list[list[Candidate]] = []
        for one in sorted(found, key=lambda one: (one.asked, one.start_utc_s)):
            same = passes[-1] if passes and self._by_name and passes[-1][0].asked == one.asked else []
            others = [each for each in same if each.elements is not one.elements]
            if any(one.start_utc_s < each.end_utc_s for each in others):
                same.append(one)
            else:
                passes.append([one])
        if len(passes) == len(found):
            return found
        self.found.passes -= len(found) - len(passes)
        best = [min(same, key=partial(_rank_among, same)) for same in passes]
        return sorted(best, key=lambda one: one.start_utc_s)

    def _sun_deg(self, one: SatellitePass, cut: Cut, at_culmination_deg: float) -> float:
        """Return the Sun's altitude at the highest instant of what may be followed."""
        top = float(one.seen.culminate_utc.unix_s)
        if cut[0][0] <= top <= cut[0][1]:
            return at_culmination_deg
        site = self._situation.site
        sun = sun_over(site.latitude_deg, site.longitude_deg).at(min(max(top, cut[0][0]), cut[0][1]))
        return altitude_deg(sun.hour_angle_deg, sun.dec_deg, site.latitude_deg)

    def _report_none(self, passes: CataloguePasses) -> None:
        low = self._entry.terms.min_altitude_deg
        names = ", ".join(e.label for e in passes.elements[:3]) if self._by_name else "nothing of it"
        self.found.notes.append(f"{names}: not above {low:g}° in the plan's time")

    def _cuts(self, passes: CataloguePasses, one: SatellitePass, windows: list[Span]) -> list[Cut]:
        """Return what of a pass may be followed, a stretch for each window, and why one is lost by times."""
        begin, end = passes.start, passes.start.plus(passes.task.span[1])
        low = float((one.seen.rise_utc or begin).unix_s)
        high = float((one.seen.set_utc or end).unix_s)
        is_cut = (one.seen.rise_utc is None, one.seen.set_utc is None)
        for first, last in one.elements.spans:
            # Where rows begin or end, so does all that there is of the pass.
            if first <= one.seen.culminate_utc <= last:
                is_cut = (
                    is_cut[0] and float(first.unix_s) <= low,
                    is_cut[1] and float(last.unix_s) >= high,
                )
                low, high = max(low, float(first.unix_s)), min(high, float(last.unix_s))
        return [
            self._cut(one, any(is_cut), (low, high), (max(low, a), min(high, b)))
            for a, b in windows
            if a < high and b > low
        ]

    def _cut(self, one: SatellitePass, is_cut: bool, seen: Span, span: Span) -> Cut:
        terms, fixed = self._entry.terms, self._entry.fixed
        always = one.seen.rise_utc is None and one.seen.set_utc is None
        is_whole = span == fixed if fixed is not None else span == seen and not is_cut
        lost: tuple[str, str] | None = None
        if fixed is not None and not (always or is_whole or terms.shorten):
            off_s = fixed[1] - fixed[0] - (span[1] - span[0])
            lost = (TOO_LOW, f"below {terms.min_altitude_deg:g}° or the skyline for {off_s:.0f} s of it")
        elif terms.longest_s is not None and span[1] - span[0] >= terms.longest_s:
            top = min(max(float(one.seen.culminate_utc.unix_s), span[0]), span[1])
            first = min(max(top - 0.5 * terms.longest_s, span[0]), span[1] - terms.longest_s)
            span = (first, first + terms.longest_s)
        elif not (always or is_whole or terms.shorten):
            lost = (CUT, "not whole within the plan's time or its window; shorten = true takes a part")
        return span, lost

    def _keep_before_facts(self, one: SatellitePass, sun_deg: float, cut: Cut) -> bool:
        """Return whether a pass is reported, by what is known at once; count those of a rule that are not."""
        conditions, terms = self._entry.conditions, self._entry.terms
        if self._by_name:
            return True
        too_low = conditions.culminates_deg is not None and one.seen.max_alt_deg < conditions.culminates_deg
        if too_low:
            self.found.dropped[TOO_LOW] += 1
        elif self._is_too_bright(sun_deg):
            self.found.dropped[SUN] += 1
        elif cut[0][1] - cut[0][0] < min(terms.least_s, terms.longest_s or terms.least_s):
            self.found.dropped[SHORT] += 1
        else:
            return True
        return False

    def _is_too_bright(self, sun_deg: float) -> bool:
        terms, asked = self._entry.terms, self._entry.conditions.sun_below_deg
        return (terms.if_sun_up == "skip" and sun_deg > terms.sun_up_deg) or (
            asked is not None and sun_deg > asked
        )

    def _candidate(
        self,
        one: SatellitePass,
        facts: PassFacts | None,
        sun_deg: float,
        cut: Cut,
    ) -> Candidate | None:
        span, lost = cut
        entry, terms = self._entry, self._entry.terms
        useful: tuple[Span, ...] = (span,)
        if entry.conditions.sunlit:
            lit = () if facts is None else facts.sunlit
            useful = tuple(
                (max(span[0], float(a.unix_s)), min(span[1], float(b.unix_s)))
                for a, b in lit
                if float(a.unix_s) < span[1] and float(b.unix_s) > span[0]
            )
        top = min(max(float(one.seen.culminate_utc.unix_s), span[0]), span[1])
        latest_start, earliest_end = self._shortest(span, top)
        named = self._named.get(id(one.elements))
        made = Candidate(
            number=-1,
            entry=self._number,
            elements=one.elements,
            start_utc_s=span[0],
            culminate_utc_s=top,
            end_utc_s=span[1],
            latest_start_utc_s=latest_start,
            earliest_end_utc_s=earliest_end,
            max_alt_deg=float(one.seen.max_alt_deg),
            useful=useful,
            priority=terms.priority,
            sun_alt_deg=sun_deg,
            magnitude=None if facts is None else facts.magnitude,
            may_join=terms.shorten or (entry.fixed is None and one.seen.rise_utc is None),
            asked=named.key if named else "",
            file=named.file if named else None,
        )
        why = lost or next(self._reasons(made, facts), None)
        if top != float(one.seen.culminate_utc.unix_s):
            # The conditions are on the whole pass; what is told is of what may be followed.
            there = Propagator(one.elements, self._situation.site, place="geometric").at(Utc(top))
            made = replace(made, max_alt_deg=float(there.alt_deg))
        if why is None and terms.if_elements_old == "run":
            age = self._too_old(made)
            made = made if age is None else replace(made, notes=(age,))
        if why is None:
            return made
        if not (self._by_name or why[0] in (OLD, CUT)):
            self.found.dropped[why[0]] += 1
            return None
        return replace(made, lost=why)

    def _shortest(self, span: Span, top_utc_s: float) -> Span:
        """Return when a pass must be entered at the latest, and when it may be left at the earliest.

        A culmination stays within; one that lies outside the time that there is for the pass does not count.
        """
        terms = self._entry.terms
        if not terms.shorten:
            return span
        least_s = min(terms.least_s, span[1] - span[0])
        return (
            span[1] - least_s if top_utc_s <= span[0] else top_utc_s,
            span[0] + least_s if top_utc_s >= span[1] else top_utc_s,
        )

    def _reasons(self, one: Candidate, facts: PassFacts | None) -> Iterator[tuple[str, str]]:
        """Yield why a pass is none, or is not what was asked for, the first thing first."""
        entry, c = self._entry, self._entry.conditions
        terms = entry.terms
        least_s = terms.least_s if entry.fixed is None else 0.0
        fastest = math.inf if facts is None else max(facts.peak_ha_rate_deg_s, facts.peak_dec_rate_deg_s)
        if c.culminates_deg is not None and one.max_alt_deg < c.culminates_deg:
            yield TOO_LOW, f"culminates at {one.max_alt_deg:.1f}°, below {c.culminates_deg:g}°"
        if self._is_too_bright(one.sun_alt_deg or 0.0):
            yield SUN, f"the Sun is at {one.sun_alt_deg:.1f}°, above {terms.sun_up_deg:g}°"
        if one.end_utc_s - one.start_utc_s < min(least_s, terms.longest_s or least_s):
            yield SHORT, f"{one.end_utc_s - one.start_utc_s:.0f} s, less than {least_s:g} s"
        if facts is None:
            yield INFEASIBLE, "the elements have it come down before the pass ends"
        if c.sunlit and one.useful_s <= 0.0:
            yield NOT_LIT, "in the Earth's shadow throughout"
        if c.longer_than_s is not None and one.useful_s < c.longer_than_s:
            yield SHORT, f"{one.useful_s:.0f} useful seconds, less than {c.longer_than_s:g}"
        if c.brighter_than is not None and (one.magnitude is None or one.magnitude >= c.brighter_than):
            shown = "not known" if one.magnitude is None else f"{one.magnitude:.1f}"
            yield FAINT, f"magnitude {shown}, not below {c.brighter_than:g}"
        if c.slower_than_deg_s is not None and fastest >= c.slower_than_deg_s:
            yield FAST, f"an axis turns {fastest:.2f} °/s, not below {c.slower_than_deg_s:g} °/s"
        old = self._too_old(one)
        if old is not None and terms.if_elements_old == "skip":
            yield OLD, old

    def _too_old(self, one: Candidate) -> str | None:
        """Note the age of elements that are too old; those of a provider are renewed before the pass."""
        if not isinstance(one.elements, Elements):
            return None
        loaded = self._load(self._entry.source)
        at = self._situation.now_utc_s if loaded.renewable else one.culminate_utc_s
        days = abs(at - float(one.elements.epoch.unix_s)) / DAY_S
        if days <= self._entry.terms.elements_oldest_days:
            return None
        when = "today" if loaded.renewable else "at the pass"
        return f"elements {days:.1f} days old {when}, more than {self._entry.terms.elements_oldest_days:g}"


def _rank_among(same: Sequence[Candidate], one: Candidate) -> tuple[bool, SourceRank]:
    """Return the rank of a candidate among those of one pass by several ephemerides; the least is best."""
    first, last = min(each.start_utc_s for each in same), max(each.end_utc_s for each in same)
    return one.lost is not None, source_rank(one.elements, Utc(first), Utc(one.culminate_utc_s), Utc(last))


class Named(NamedTuple):
    """What an entry names: by what, what that is, and the file that has it, None for others."""

    key: str
    target: Elements | Ephemeris
    file: str | None = None


def named_by(
    entry: ScheduleEntry, load: Load, situation: PlanSituation, note: Callable[[str], None]
) -> list[Named]:
    """Return what an entry names, each once, by every ephemeris that the entry gives for it.

    `note` takes which files and elements are left out, as they have not the object. Raises BadInputError
    with its place.
    """
    chosen: dict[int, list[Named]] = {}
    for key in entry.satellites:
        found = _in_files(key, entry, situation, note)
        if not found:
            body = _body(key, entry, load, situation)
            found = [Named(key, body or _satellite(key, entry, load(entry.source).elements))]
        first = found[0].target
        if found[0].file is not None and entry.source is not None:
            same = str(first.catalog_number or key)
            if _has(same, entry, load):
                found.append(Named(key, _satellite(same, entry, load(entry.source).elements)))
            else:
                note(f"left out: no {first.label} ({same}) in {entry.source}")
        chosen[object_number(first.catalog_number, first.label)] = found
    return [one for found in chosen.values() for one in found]


def _in_files(
    key: str, entry: ScheduleEntry, situation: PlanSituation, note: Callable[[str], None]
) -> list[Named]:
    """Return an object of the entry's files, by each that has it; one of them must."""
    from tle.formats.ephemerides import find_ephemeris, read_ephemerides

    found: list[Named] = []
    missing: list[SatelliteNotFoundError] = []
    for file in entry.ephemeris:
        try:
            found.append(Named(key, find_ephemeris(read_ephemerides(file, situation.site), key), file))
        except SatelliteNotFoundError as error:
            missing.append(error)
        except TleError as error:
            raise entry.origin.wrong(str(error)) from None
    if missing and not found:
        raise entry.origin.wrong(str(missing[0]))
    for lacking in missing:
        note(f"left out: {lacking}")
    return found


def _body(key: str, entry: ScheduleEntry, load: Load, situation: PlanSituation) -> Ephemeris | None:
    """Return a body, a direction, or a star by its number or by a name that no satellite has; else None."""
    if key.startswith("adsb:"):
        raise entry.origin.wrong(f"{key}: an aircraft is heard only now: follow it with sattrack track")
    if key.casefold().endswith(".csv"):
        raise entry.origin.wrong(f"{key}: name the table as ephemeris, and what it holds as satellite")
    from tle.bodies import find_body, read_star, star_number

    try:
        body = find_body(key)
        if body is not None and body.name == "Sun":
            raise entry.origin.wrong(
                "the Sun is in no schedule: follow it with sattrack track, its filter on"
            )
        number = None if body is not None else star_number(key)
        if number is None:
            return body
        if not key.strip().casefold().startswith("hip") and _has(key, entry, load):
            return None
        return read_star(number, key, situation.stars)
    except TleError as error:
        raise entry.origin.wrong(str(error)) from None


def _has(key: str, entry: ScheduleEntry, load: Load) -> bool:
    """Tell whether a satellite has a name; none has where no elements are set."""
    try:
        find(load(entry.source).elements, key)
    except (BadInputError, SatelliteNotFoundError):
        return False
    except AmbiguousSatelliteError:
        return True
    return True


def _satellite(key: str, entry: ScheduleEntry, known: list[Elements]) -> Elements:
    try:
        return find(known, key)
    except AmbiguousSatelliteError as error:
        raise entry.origin.wrong(str(error)) from None
    except SatelliteNotFoundError as error:
        hint = meant(key, [e.name for e in known if e.name])
        raise entry.origin.wrong(f"{error}{hint}") from None


MOST_CANDIDATES = 2000
"""So many passes, the most valuable, are weighed against one another."""
MOST_JUDGED = 400
"""Of more, those alone are judged by the mount's limits that a plan would take, after a coarse look."""
PAST_DEG, PAST_SHARE = 1.0, 0.2
"""A pass that is so far past a limit for such a share of it is infeasible, however coarsely it is looked at:
a verdict asks for nine tenths."""


def gather(
    schedule: Schedule,
    situation: PlanSituation,
    load: Load,
    progress: Progress | None = None,
) -> tuple[list[Candidate], list[Found]]:
    """Return all candidates in order of time, not judged yet, and of each entry what it came to.

    `load` gives the elements of a source, of all that is set for None. Raises BadInputError that names the
    entry for satellites that are not known, TleError.
    """
    candidates: list[Candidate] = []
    found: list[Found] = []
    for number, entry in enumerate(schedule.entries):
        search = EntrySearch(number, entry, situation, progress)
        candidates += search.run(load, schedule.magnitudes is not None)
        found.append(search.found)
    candidates.sort(key=lambda one: (one.start_utc_s, one.end_utc_s, one.object_number, one.entry))
    candidates = _most_valuable(candidates)
    return [replace(one, number=number) for number, one in enumerate(candidates)], found


def _most_valuable(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates, those beyond the number that is weighed lost."""
    fit = [k for k, one in enumerate(candidates) if one.lost is None]
    fit.sort(key=lambda k: (-candidates[k].value, k))
    crowded = set(fit[MOST_CANDIDATES:])
    words = f"not among the {MOST_CANDIDATES} most valuable passes that are weighed"
    return [replace(one, lost=(CROWDED, words)) if k in crowded else one for k, one in enumerate(candidates)]


class Judge:
    """The mount's verdict on candidates, the one of `passes --feasible`; each is asked for once."""

    def __init__(self, schedule: Schedule, situation: PlanSituation) -> None:
        self._schedule, self._site = schedule, situation.site
        self._ability = ability_at(situation.site, situation.profile, situation.limits)
        self._known: set[int] = set()

    def knows(self, one: Candidate) -> bool:
        """Return whether a candidate was judged, or needs no verdict because it is lost anyway."""
        return one.lost is not None or one.number in self._known

    def judged(self, one: Candidate) -> Candidate:
        """Return a candidate with the verdict on it. Raises TimeRangeError."""
        if self.knows(one):
            return one
        self._known.add(one.number)
        span = (one.start_utc_s, one.end_utc_s)
        why, lost = verdict_on(one.elements, self._site, span, self._ability, None)
        if why is None:
            return one.without(lost)
        one = replace(one, foretold=lost)
        if self._schedule.entries[one.entry].terms.if_infeasible == "run":
            return replace(one, notes=(*one.notes, f"infeasible, run all the same: {why}"))
        return replace(one, lost=(INFEASIBLE, why))

    def coarsely(
        self, one: Candidate, utc_s: Array, hour_angle_axis_deg: Array, dec_axis_deg: Array
    ) -> Candidate:
        """Return a candidate, lost where its axes, at some instants, are past a limit beyond doubt."""
        if self.knows(one) or self._schedule.entries[one.entry].terms.if_infeasible == "run":
            return one
        ability = self._ability
        sun, moon = bodies_deg(self._site, utc_s, ability.profile.frame)
        pointing = AxisSamples(utc_s, hour_angle_axis_deg, dec_axis_deg, *sun, *moon)
        margins = margins_deg(pointing, ability.profile, ability.limits, ability.latitude_deg)
        name, margin = min(margins.items(), key=lambda item: -float(np.mean(item[1] < -PAST_DEG)))
        share = float(np.mean(margin < -PAST_DEG))
        if share <= PAST_SHARE:
            return one
        words = f"{name}: past the limit for {100.0 * share:.0f} % of it, by a coarse look"
        return replace(one, lost=(INFEASIBLE, words))

    def all_if_few(self, candidates: list[Candidate], progress: Progress | None) -> list[Candidate]:
        """Return the candidates with the verdict on each, or as they are where that would take too long."""
        if sum(one.lost is None for one in candidates) > MOST_JUDGED:
            return candidates
        judged = []
        for done, one in enumerate(candidates):
            if progress is not None:
                progress("judged", done, len(candidates))
            judged.append(self.judged(one))
        if progress is not None and candidates:
            progress("judged", len(candidates), len(candidates))
        return judged

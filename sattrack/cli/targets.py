"""What a command's TARGET is: an object of an ephemeris file, a body, a direction, or a satellite."""

from __future__ import annotations

import functools
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from sattrack.cli.common import given_instant
from sattrack.cli.output import tell
from sattrack.core.errors import BadInputError
from sattrack.views.formatting import source_error
from tle.elements import Elements
from tle.ephemeris import SourceRank, TableEphemeris, expected_error_m, source_rank
from tle.errors import AmbiguousSatelliteError, PropagationError, SatelliteNotFoundError, SourceError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from sattrack.cli.common import CommandContext
    from tle.ephemeris import Ephemeris
    from tle.instants import Utc
    from tle.site import Site


TargetT = TypeVar("TargetT", Elements, TableEphemeris)
_T0, _SOURCE = "sattrack.t0", "sattrack.source"
_DISAGREES = 5.0
"""So many times what they state together are two ephemerides apart that cannot both be right."""


class FollowedTarget(NamedTuple):
    """What to follow a target with: elements or another ephemeris, and from where.

    All are None for practice, which is with a simulated mount where neither elements nor a site are set.
    `culminate_utc_s` is about when the pass is highest, where several ephemerides were compared for it.
    """

    elements: list[Elements] | None
    site: Site | None
    target: Elements | Ephemeris | None
    culminate_utc_s: float | None = None


def followed(
    context: CommandContext,
    target: str,
    mount_url: str | None,
    files: Sequence[Path],
    wanted: Wanted,
) -> FollowedTarget:
    """Return what to follow a target with: of several ephemerides the best one for the pass that is wanted.

    Raises what the context's `elements` and `site` may.
    """
    from tle.sources import newest, same_object

    loaded = functools.cache(context.load_each)

    def known() -> list[Elements]:
        return newest([one for _, sets in loaded() for one in sets], context.now())

    if len(files) <= 1 and _word() is None:
        found = find_target(context, target, files, known)
        if found is not None:
            return FollowedTarget(None, context.site(), found)
        if mount_url in (None, "sim") and not context.sources() and not context.has_site():
            return FollowedTarget(None, None, None)
        if not context.sources():
            site = context.site()
            fetched = [replace(one, source="CelesTrak") for one in context.elements(target)]
            return FollowedTarget(fetched, site, None)
    site = context.site()
    (origins,), left_out = _origins(context, [target], files, loaded())
    tell_left_out(left_out)
    chosen = _chosen(origins, target, wanted, site)
    culminate_utc_s = None
    if chosen.window.first != chosen.window.last:
        culminate_utc_s = _culmination_s(chosen, site, wanted)
    if not isinstance(chosen.target, Elements):
        return FollowedTarget(None, site, chosen.target, culminate_utc_s)
    # Others may be asked for later; of this object it is the set that was chosen.
    taken = replace(chosen.target, source=Path(chosen.origin).name)
    elements = [taken if same_object(one, taken) else one for one in known()]
    return FollowedTarget(elements, site, None, culminate_utc_s)


def ephemeris_files(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --ephemeris and --t0 to a command; the first comes as `ephemeris`, a tuple of paths.

    T0 is kept in the context of click, from which this module takes it.
    """
    for option in (
        click.option(
            "--t0",
            metavar="UTC",
            expose_value=False,
            callback=lambda ctx, _, value: ctx.meta.update({_T0: value}),
            help="The instant T0, for a table whose times count from it.",
        ),
        click.option(
            "--ephemeris",
            type=click.Path(path_type=Path, dir_okay=False),
            multiple=True,
            metavar="FILE",
            help="Take TARGET from this CPF, OEM or SP3 file, or table (CSV), by name, designator or number "
            "(a CPF's SIC number too); may be repeated.",
        ),
    ):
        function = option(function)
    return function


def ephemeris_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --ephemeris, --t0 and --source, which is kept like T0, to a command."""
    source = click.option(
        "--source",
        metavar="WORD",
        expose_value=False,
        callback=lambda ctx, _, value: ctx.meta.update({_SOURCE: value}),
        help="Which ephemeris of TARGET to use if there are several, elements among them: the one with "
        "WORD in its name or its file's; `best`, the default, has the least expected error at the pass.",
    )
    return ephemeris_files(source(function))


class Wanted(NamedTuple):
    """Which pass is wanted: the so-manyth from an instant on, above an altitude."""

    begin: Utc
    min_alt_deg: float
    number: int = 1


class Window(NamedTuple):
    """When an ephemeris is asked: for a whole pass, whose error counts at an instant; or for one instant."""

    first: Utc
    at: Utc
    last: Utc


class EphemerisChoice(NamedTuple):
    """One ephemeris of a target, where it comes from, and when it is asked."""

    origin: str
    target: Elements | Ephemeris
    window: Window

    @property
    def error_m(self) -> float | None:
        """Give by how much it misses its object, typically; None where it does not say."""
        return expected_error_m(self.target, self.window.at)

    @property
    def rank(self) -> SourceRank:
        """Give how it compares with others."""
        return source_rank(self.target, *self.window)

    @property
    def text(self) -> str:
        """Say what it is in one line."""
        error_m, at = self.error_m, self.window.at.isoformat("seconds")
        missed = source_error(error_m)
        miss = missed if error_m is None else f"expected {missed} at {at}"
        over, in_part, _ = self.rank
        lack = ", not for the whole pass" if in_part else ""
        if over:
            lack = f", over since {self.target.spans[-1][1].isoformat('seconds')}"
        return f"{self.origin}: {self.target.provenance}, {miss}{lack}"


class _Origin(NamedTuple):
    """A file or element source, and all that it has of one object: ephemerides, or sets of several epochs."""

    name: str
    targets: Sequence[Elements | Ephemeris]

    def best(self, window: Window) -> EphemerisChoice:
        """Return its best one for a time."""
        return min(
            (EphemerisChoice(self.name, one, window) for one in self.targets), key=lambda one: one.rank
        )


class LeftOut(NamedTuple):
    """A file or element source that has nothing of an object which others have, and why."""

    origin: str
    reason: str


def candidates(
    context: CommandContext, key: str, files: Sequence[Path], wanted: Wanted, site: Site | None
) -> tuple[list[EphemerisChoice], list[LeftOut]]:
    """Return all ephemerides of a target, the best one first, and the files and sources that have none.

    Without a site it is the best one at the beginning, else for the pass that is wanted. The one object of a
    file is taken even if nothing shows that it is the target, as long as nothing shows that it is another.
    Raises SatelliteNotFoundError where none has it, TleError, BadInputError.
    """
    loaded = context.load_each()
    (origins,), left_out = _origins(context, [key], files, loaded, alone=True)
    known = {*(one.name for one in origins), *(one.origin for one in left_out)}
    target = _numbered(origins[0].targets[0])
    left_out += [LeftOut(name, f"no {target} in {name}") for name, _ in loaded if name not in known]
    return _ranked(origins, wanted, site), left_out


def tell_left_out(left_out: Sequence[LeftOut]) -> None:
    """Say on standard error what has nothing of the object."""
    for one in left_out:
        tell(f"left out: {one.reason}")


def _ranked(origins: list[_Origin], wanted: Wanted, site: Site | None) -> list[EphemerisChoice]:
    now = Window(wanted.begin, wanted.begin, wanted.begin)
    window = now if site is None else _pass_window(origins, wanted, site) or now
    if all(one.best(window).rank.in_part for one in origins):
        # Of none that has places now, the one that has some first.
        starts = [low for one in origins for low, _ in one.best(window).target.spans if low >= window.first]
        window = Window(*[min(starts)] * 3) if starts else window
    return sorted((one.best(window) for one in origins), key=lambda one: one.rank)


def _origins(
    context: CommandContext,
    keys: Sequence[str],
    files: Sequence[Path],
    loaded: list[tuple[str, list[Elements]]],
    alone: bool = False,
) -> tuple[list[list[_Origin]], list[LeftOut]]:
    """Return what files and element sources have of each object, and what has none of them.

    `alone` takes the one object of a file where neither number nor designator tells whether it is the same.
    """
    held = {str(path): _read(context, path, files) for path in files}
    found, lacking = zip(*(_origins_of(context, key, held, loaded, alone) for key in keys), strict=True)
    names = [name for name in lacking[0] if all(name in one for one in lacking)]
    return list(found), [LeftOut(name, lacking[0][name]) for name in names]


def _origins_of(
    context: CommandContext,
    key: str,
    held: dict[str, list[TableEphemeris]],
    loaded: list[tuple[str, list[Elements]]],
    alone: bool,
) -> tuple[list[_Origin], dict[str, str]]:
    """Return what files, by name, and element sources have of one object, and why others have none.

    The first that has the key says which object it is. One that does not know the key is asked for the number
    and the designator that another one gives it; one whose number or designator differs has another object.
    """
    from tle.formats.ephemerides import find_ephemeris
    from tle.sources import find, newest, same_object

    searches = {name: functools.partial(find_ephemeris, table) for name, table in held.items()}
    in_sets = functools.partial(find, newest([one for _, sets in loaded for one in sets], context.now()))
    found: dict[str, TableEphemeris] = {}
    for name, search in searches.items():
        one = _by_any(search, [key], found.values())
        if one is not None:
            found[name] = one
    # By its number first: a SIC number may be the catalogue number of another satellite.
    words = [word for one in found.values() for word in _identities(one)]
    meant = _by_any(in_sets, [*words, key], found.values())
    other = None if meant is not None else _by_any(in_sets, [key], [])
    known: list[Elements | Ephemeris] = [*found.values()]
    if meant is not None:
        known.append(meant)
    if not known:
        for search in searches.values():
            search(key)
        if loaded:
            in_sets(key)
        raise BadInputError(f"{key}: give --ephemeris FILE or --elements SRC")
    words = [word for one in known for word in _identities(one)]
    lacking: dict[str, str] = {}
    for name in [name for name in held if name not in found]:
        one = _by_any(searches[name], words, known)
        if one is None and alone:
            one = _only(held[name], key, name, known)
        if one is None:
            lacking[name] = _why_lacking(searches[name], key, name, known[0])
        else:
            found[name] = one
    origins = [_Origin(name, [found[name]]) for name in held if name in found]
    for source, accepted in loaded:
        of_it = [one for one in accepted if meant is not None and same_object(one, meant)]
        origins += [_Origin(source, of_it)] if of_it else []
        if other is not None and any(same_object(one, other) for one in accepted):
            lacking[source] = _why_lacking(in_sets, key, source, known[0])
    return origins, lacking


def _by_any(
    search: Callable[[str], TargetT], words: Sequence[str], known: Collection[Elements | Ephemeris]
) -> TargetT | None:
    """Return what is found by one of the words, if it is not known to be another object."""
    for word in words:
        try:
            found = search(word)
        except SatelliteNotFoundError:
            continue
        if all(_agree(found, one) is not False for one in known):
            return found
    return None


def _only(
    table: list[TableEphemeris], key: str, name: str, known: Sequence[Elements | Ephemeris]
) -> TableEphemeris | None:
    """Return the one object of a file that nothing shows to be another, and say what the file calls it."""
    if len(table) > 1 or table[0].refused or any(_agree(table[0], one) is False for one in known):
        return None
    tell(f"{name} calls its one object {table[0].label}: compared as {key}")
    return table[0]


def _why_lacking(
    search: Callable[[str], Elements | Ephemeris], key: str, name: str, target: Elements | Ephemeris
) -> str:
    """Return why a file or element source has nothing of a target: no such name, or another object of it."""
    try:
        other = search(key)
    except SatelliteNotFoundError as error:
        return str(error)
    return f"{key} in {name} is {_numbered(other)}, not {_numbered(target)}"


def _identities(target: Elements | Ephemeris) -> list[str]:
    """Return an object's catalogue number and designators, where they are known."""
    from tle.sources import full_designator

    names = target.names if isinstance(target, TableEphemeris) else (getattr(target, "designator", ""),)
    full = [full_designator(one) or "" for one in names]
    designators = [one for one in full if one[-1:].isalpha()]
    return [str(target.catalog_number), *designators] if target.catalog_number else designators


def _agree(one: Elements | Ephemeris, other: Elements | Ephemeris) -> bool | None:
    """Tell whether two are of one object, by number or designator; None where these do not tell."""
    ids, others = _identities(one), _identities(other)
    if set(ids) & set(others):
        return True
    numbers = one.catalog_number and other.catalog_number
    designators = any("-" in each for each in ids) and any("-" in each for each in others)
    return False if numbers or designators else None


def _numbered(target: Elements | Ephemeris) -> str:
    """Return an object's name with its catalogue number where it has both."""
    both = target.name and target.catalog_number
    return f"{target.name} ({target.catalog_number})" if both else target.label


def _passes(target: Elements | Ephemeris, site: Site, wanted: Wanted) -> list[tuple[Window, float]]:
    """Return from when to when passes can be followed by an ephemeris, and how long that is, seconds."""
    from sattrack.runtime.facts import SEARCH_HOURS, plan_for
    from tle.instants import Utc
    from tle.passes import find_passes
    from tle.propagator import Propagator

    try:
        seen = find_passes(Propagator(target, site), wanted.begin, SEARCH_HOURS, wanted.min_alt_deg)
    except PropagationError:
        return []
    plans = [(plan_for(one, wanted.begin, target), one.culminate_utc) for one in seen]
    return [
        (Window(Utc(plan.start_utc_s), top, Utc(plan.end_utc_s)), plan.end_utc_s - plan.start_utc_s)
        for plan, top in plans
    ]


def _pass_window(origins: list[_Origin], wanted: Wanted, site: Site) -> Window | None:
    """Return when the wanted pass is, by whichever ephemeris has the most of it; None where there is none.

    What overlaps is one pass, which ephemerides place a little differently.
    """
    begin = Window(wanted.begin, wanted.begin, wanted.begin)
    seen = [one for origin in origins for one in _passes(origin.best(begin).target, site, wanted)]
    passes: list[list[tuple[Window, float]]] = []
    for one in sorted(seen, key=lambda one: float(one[0].first.unix_s)):
        if passes and any(one[0].first <= other.last for other, _ in passes[-1]):
            passes[-1].append(one)
        else:
            passes.append([one])
    if not 0 < wanted.number <= len(passes):
        return None
    return max(passes[wanted.number - 1], key=lambda one: one[1])[0]


def _culmination_s(chosen: EphemerisChoice, site: Site, wanted: Wanted) -> float | None:
    """Return when the chosen ephemeris has the pass highest; None where it has it not."""
    first, _, last = chosen.window
    for window, _ in _passes(chosen.target, site, wanted):
        if window.first <= last and first <= window.last:
            return float(window.at.unix_s)
    return None


def _word() -> str | None:
    word: str | None = click.get_current_context().meta.get(_SOURCE)
    return word


def _chosen(origins: list[_Origin], key: str, wanted: Wanted, site: Site | None) -> EphemerisChoice:
    """Return the ephemeris that --source names, the best without it; tell what there is."""
    word = _word()
    meant = origins
    if word not in (None, "best"):
        assert word is not None
        meant = [
            _Origin(name, kept)
            for name, targets in origins
            if (kept := [one for one in targets if word.casefold() in f"{name} {one.provenance}".casefold()])
        ]
    if not meant:
        listed = "; ".join(one.text for one in _ranked(origins, wanted, site))
        raise BadInputError(f"--source {word}: none of the ephemerides of {key} is called so: {listed}")
    if len(meant) == len(meant[0].targets) == len(origins) == 1 and word is None:
        return EphemerisChoice(meant[0].name, meant[0].targets[0], Window(*[wanted.begin] * 3))
    best = _ranked(meant, wanted, site)[0]
    if word is None and len(origins) == 1:
        return best
    tell(f"using {best.text}")
    others = [one.best(best.window) for one in origins if one.name != best.origin]
    for one in sorted(others, key=lambda one: one.rank):
        tell(f"not   {one.text}")
        tell_disagreement(best, one)
    return best


def tell_disagreement(best: EphemerisChoice, other: EphemerisChoice) -> None:
    """Tell where two ephemerides of one object are much further apart than they state."""
    from tle.earth import EarthOrientation

    at, earth = best.window.at, EarthOrientation.installed()
    try:
        places = [one.target.states(earth).at(float(at.unix_s), 0.0)[:3] for one in (best, other)]
    except PropagationError:
        return
    if not (best.target.ranged and other.target.ranged):
        return
    apart_m = 1000.0 * math.dist(*places)
    share = apart_m / math.hypot(best.rank.error_m, other.rank.error_m)
    if share > _DISAGREES:
        tell(
            f"warning: {other.origin} has it {apart_m / 1000.0:.3g} km from where {best.origin} has it at "
            f"{at.isoformat('seconds')}, {share:.0f} times what they state: one of the two is wrong"
        )


def _check_key(key: str) -> None:
    """Raise BadInputError for what names no target, but something that belongs elsewhere."""
    if not key.strip():
        raise BadInputError("TARGET is empty: give a satellite's number, designator or name")
    if set("./") & set(key) and Path(key).is_file():
        raise BadInputError(f"{key} is a file: give it with --elements, and name a satellite as TARGET")
    if re.fullmatch(r"\s*[+-]?\d{1,3}[:hd]\d[\d:dhms.]*\s*", key):
        raise BadInputError(
            f"{key!r} is one angle: a direction has two, RA,DEC, in degrees as 83.6331,22.0145"
        )


def find_target(
    context: CommandContext, key: str, files: Sequence[Path], elements: Callable[[], list[Elements]]
) -> Ephemeris | None:
    """Return what TARGET is where it has no elements, None where it is a satellite that must have some.

    It is an object of an ephemeris file where one is given, a table where TARGET ends in `.csv`, else Sun,
    Moon, a planet, RA,DEC, or a star by its number, or by its name where no satellite has it: then alone are
    `elements` asked for.
    Raises TleError, BadInputError.
    """
    if files:
        return _objects_of(context, files[0], [key])[0]
    if key.startswith("adsb:"):
        from sattrack.runtime.adsb import aircraft_now

        if context.clock_option is not None:
            raise BadInputError("--clock: aircraft are received now; omit it")
        return aircraft_now(key)
    if key.casefold().endswith(".csv"):
        return _objects_of(context, Path(key), [])[0]
    _check_key(key)
    if click.get_current_context().meta.get(_T0) is not None:
        raise BadInputError("--t0 goes with a table whose times count from it: track launch.csv --t0 UTC")
    from tle.bodies import find_body, find_star

    body = find_body(key)
    by_number = key.strip().casefold().startswith("hip")
    if body is not None or not (by_number or _has_no(elements(), key)):
        return body
    try:
        return find_star(key, context.settings.stars)
    except SourceError as error:
        raise SourceError(context.by_settings("stars", error)) from None


def _objects_of(context: CommandContext, ephemeris: Path, keys: Sequence[str]) -> list[Ephemeris]:
    """Return the named objects of an ephemeris file, all of them without names; it is read once."""
    from tle.formats.ephemerides import find_ephemeris

    known = _read(context, ephemeris, [ephemeris])
    if keys:
        return [find_ephemeris(known, key) for key in keys]
    refused = list(known[0].refused.values())
    if refused:
        tell(f"{len(refused)} of {len(refused) + len(known)} objects left out, the first: {refused[0]}")
    return list(known)


def _read(context: CommandContext, path: Path, files: Sequence[Path]) -> list[TableEphemeris]:
    """Return the objects of one of several ephemeris files: --t0 is for those whose times count from it."""
    from tle.formats.ephemerides import counts_from_t0, read_ephemerides

    text = click.get_current_context().meta.get(_T0)
    t0 = None if text is None else given_instant("--t0", text)
    if t0 is not None and not counts_from_t0(path) and any(map(counts_from_t0, files)):
        t0 = None
    return read_ephemerides(path, context.site() if context.has_site() else None, t0)


def _has_no(elements: list[Elements], key: str) -> bool:
    """Tell whether elements have no satellite that is meant."""
    from tle.sources import find

    try:
        find(elements, key)
    except SatelliteNotFoundError:
        return True
    except AmbiguousSatelliteError:
        return False
    return False


def find_targets(
    context: CommandContext, keys: Sequence[str], files: Sequence[Path], at: Utc
) -> list[Elements | Ephemeris]:
    """Return what a user means by each TARGET; without any, everything in the file, or in the elements.

    Of several ephemerides it is the best one at an instant. Elements are read where a satellite of theirs may
    be asked for. Raises TleError, BadInputError.
    """
    if len(files) == 1 and _word() is None:
        return list(_objects_of(context, files[0], keys))
    if not keys and files:
        raise BadInputError("name a target: of several files one ephemeris is chosen for each")
    if not keys:
        return list(context.elements())
    if files or _word() is not None:
        wanted = Wanted(at, 0.0)
        each, left_out = _origins(context, keys, files, context.load_each())
        tell_left_out(left_out)
        return [_chosen(one, key, wanted, None).target for key, one in zip(keys, each, strict=True)]
    from tle.sources import find

    known = context.known_elements()
    others = [find_target(context, key, files, known) for key in keys]
    missing = [key for key, other in zip(keys, others, strict=True) if other is None]
    elements = (known() or context.elements(*missing)) if missing else []
    return [other or find(elements, key) for key, other in zip(keys, others, strict=True)]

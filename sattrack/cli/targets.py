"""What a command's TARGET is: an object of an ephemeris file, a body, a direction, or a satellite."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from sattrack.cli.common import tell
from sattrack.core.errors import BadInputError
from tle.elements import expected_error_m
from tle.errors import AmbiguousSatelliteError, SatelliteNotFoundError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.cli.common import CommandContext
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.instants import Utc
    from tle.site import Site


_T0, _SOURCE = "sattrack.t0", "sattrack.source"
UNSTATED_M = 100.0
"""What a file that states no error is taken to miss: what laser predictions and operators do in some days."""


def followed(
    context: CommandContext, target: str, mount_url: str | None, files: Sequence[Path]
) -> tuple[list[Elements] | None, Site | None, Ephemeris | None]:
    """Return what to follow a target with: elements or another ephemeris, and the site.

    All are None for practice, which is with a simulated mount where neither elements nor a site are set.
    Raises what the context's `elements` and `site` may.
    """
    from tle.elements import Elements

    known = context.known_elements()
    found = find_target(context, target, files, known)
    if isinstance(found, Elements):
        return [found], context.site(), None
    if found is not None:
        return None, context.site(), found
    if mount_url in (None, "sim") and not context.sources() and not context.has_site():
        return None, None, None
    site = context.site()
    return known() or context.elements(target), site, None


def ephemeris_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --ephemeris, --t0 and --source to a command; the first comes as `ephemeris`, a tuple of paths.

    The others are kept in the context of click, from which this module takes them.
    """
    for option in (
        click.option(
            "--source",
            metavar="WORD",
            expose_value=False,
            callback=lambda ctx, _, value: ctx.meta.update({_SOURCE: value}),
            help="Of several ephemerides of TARGET, elements among them, the one whose file or name has this "
            "in it; `best` for the least expected error, as without it where --ephemeris is repeated.",
        ),
        click.option(
            "--t0",
            metavar="UTC",
            expose_value=False,
            callback=lambda ctx, _, value: ctx.meta.update({_T0: value}),
            help="When T0 is, of a table whose times count from it.",
        ),
        click.option(
            "--ephemeris",
            type=click.Path(path_type=Path, dir_okay=False),
            multiple=True,
            metavar="FILE",
            help="TARGET is an object of this CPF, OEM or SP3 file, or of this table (CSV); may be repeated.",
        ),
    ):
        function = option(function)
    return function


class Candidate(NamedTuple):
    """One ephemeris of a target, and where it comes from."""

    origin: str
    target: Elements | Ephemeris
    at: Utc
    """When it is first asked: now, or where its places begin."""
    ended: bool
    """Whether its places end before now."""

    @property
    def error_m(self) -> float | None:
        """Give by how much it misses its object, typically; None where it does not say."""
        return expected_error_m(self.target, self.at)

    @property
    def worth(self) -> tuple[bool, float]:
        """Give what is least for the best one."""
        error_m = self.error_m
        return self.ended, UNSTATED_M if error_m is None else error_m

    @property
    def text(self) -> str:
        """Say what it is in one line."""
        error_m = self.error_m
        miss = "states no error" if error_m is None else f"expected error {error_m:.3g} m"
        over = ", over" if self.ended else ""
        return f"{self.origin}: {self.target.provenance}, {miss}{over}"


def candidates(context: CommandContext, key: str, files: Sequence[Path]) -> list[Candidate]:
    """Return all ephemerides of a target that files and element sources have, the best one first.

    Raises SatelliteNotFoundError where none has it, TleError, BadInputError.
    """
    from tle.sources import find, newest

    now, missing = context.now(), None
    found: list[Candidate] = []
    for path in files:
        try:
            (one,) = _objects_of(context, path, [key])
            found.append(_candidate(str(path), one, now))
        except SatelliteNotFoundError as error:
            missing = missing or error
    for source in context.sources():
        try:
            sets = newest(context.load([source]).accepted, now)
            found.append(_candidate(source, find(sets, key), now))
        except SatelliteNotFoundError as error:
            missing = missing or error
    if not found:
        raise missing or BadInputError(f"{key}: give --ephemeris FILE or --elements SRC")
    return sorted(found, key=lambda one: one.worth)


def _candidate(origin: str, target: Elements | Ephemeris, now: Utc) -> Candidate:
    spans = target.spans
    later = [max(now, first) for first, last in spans if now <= last]
    at = now if not spans else min(later, default=spans[-1][1])
    return Candidate(origin, target, at, bool(spans) and not later)


def _chosen(
    context: CommandContext, key: str, files: Sequence[Path], word: str | None
) -> Ephemeris | Elements:
    """Return the ephemeris that a word names, the best without one; tell what there is."""
    known = candidates(context, key, files)
    meant = known
    if word not in (None, "best"):
        assert word is not None
        meant = [
            one for one in known if word.casefold() in f"{one.origin} {one.target.provenance}".casefold()
        ]
    if not meant:
        listed = "; ".join(one.text for one in known)
        raise BadInputError(f"--source {word}: none of the ephemerides of {key} is called so: {listed}")
    for one in known:
        click.echo(f"sattrack: {'using' if one is meant[0] else 'not  '} {one.text}", err=True)
    return meant[0].target


def find_target(
    context: CommandContext, key: str, files: Sequence[Path], elements: Callable[[], list[Elements]]
) -> Ephemeris | Elements | None:
    """Return what TARGET is where it has no elements, None where it is a satellite that must have some.

    It is an object of an ephemeris file where one is given, the best one where several are or --source is,
    a table where TARGET ends in `.csv`, else Sun, Moon, a planet, RA,DEC, or a star by its number, or by its
    name where no satellite has it: then alone are `elements` asked for.
    Raises TleError, BadInputError.
    """
    word = click.get_current_context().meta.get(_SOURCE)
    if word is not None or len(files) > 1:
        return _chosen(context, key, files, word)
    if files:
        return _objects_of(context, files[0], [key])[0]
    if key.startswith("adsb:"):
        from sattrack.runtime.adsb import aircraft_now

        if context.clock_option is not None:
            raise BadInputError("--clock: aircraft are received now; omit it")
        return aircraft_now(key)
    if key.casefold().endswith(".csv"):
        return _objects_of(context, Path(key), [])[0]
    if click.get_current_context().meta.get(_T0) is not None:
        raise BadInputError("--t0 goes with a table whose times count from it: track launch.csv --t0 UTC")
    from tle.bodies import find_body, read_star, star_number

    body = find_body(key)
    by_number = key.strip().casefold().startswith("hip")
    if body is not None or not (by_number or _has_no(elements(), key)):
        return body
    number = star_number(key)
    return None if number is None else read_star(number, key, context.settings.stars)


def _objects_of(context: CommandContext, ephemeris: Path, keys: Sequence[str]) -> list[Ephemeris]:
    """Return the named objects of an ephemeris file, all of them without names; it is read once."""
    from tle.formats.ephemerides import find_ephemeris, read_ephemerides
    from tle.instants import Utc

    t0 = click.get_current_context().meta.get(_T0)
    site = context.site() if context.has_site() else None
    known = read_ephemerides(ephemeris, site, None if t0 is None else Utc.parse(t0))
    if keys:
        return [find_ephemeris(known, key) for key in keys]
    refused = list(known[0].refused.values())
    if refused:
        tell(f"{len(refused)} of {len(refused) + len(known)} objects left out, the first: {refused[0]}")
    return list(known)


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
    context: CommandContext, keys: Sequence[str], files: Sequence[Path]
) -> list[Elements | Ephemeris]:
    """Return what a user means by each TARGET; without any, everything in the file, or in the elements.

    Elements are read where a satellite of theirs may be asked for. Raises TleError, BadInputError.
    """
    if len(files) == 1 and click.get_current_context().meta.get(_SOURCE) is None:
        return list(_objects_of(context, files[0], keys))
    if not keys and files:
        raise BadInputError("name a target: of several files one ephemeris is chosen for each")
    if not keys:
        return list(context.elements())
    from tle.sources import find

    known = context.known_elements()
    others = [find_target(context, key, files, known) for key in keys]
    missing = [key for key, other in zip(keys, others, strict=True) if other is None]
    elements = (known() or context.elements(*missing)) if missing else []
    return [other or find(elements, key) for key, other in zip(keys, others, strict=True)]

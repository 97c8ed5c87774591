"""What a command's TARGET is: an object of an ephemeris file, a body, a direction, or a satellite."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.core.errors import BadInputError
from tle.errors import AmbiguousSatelliteError, SatelliteNotFoundError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.cli.common import CommandContext
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris


_T0 = "sattrack.t0"


def ephemeris_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --ephemeris and --t0 to a command; the first comes as `ephemeris`, a path or None.

    The second is kept in the context of click, from which `_objects_of` takes it.
    """
    function = click.option(
        "--t0",
        metavar="UTC",
        expose_value=False,
        callback=lambda ctx, _, value: ctx.meta.update({_T0: value}),
        help="When T0 is, of a table whose times count from it.",
    )(function)
    return click.option(
        "--ephemeris",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="TARGET is an object of this CPF, OEM or SP3 file, or of this table (CSV).",
    )(function)


def find_target(
    context: CommandContext, key: str, ephemeris: Path | None, elements: Callable[[], list[Elements]]
) -> Ephemeris | None:
    """Return what TARGET is where it has no elements, None where it is a satellite that must have some.

    It is an object of the ephemeris file where one is given, a table where TARGET ends in `.csv`, else Sun,
    Moon, a planet, RA,DEC, or a star by its number, or by its name where no satellite has it: then alone are
    `elements` asked for.
    Raises TleError, BadInputError.
    """
    if ephemeris is not None:
        return _objects_of(context, ephemeris, [key])[0]
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
    return [find_ephemeris(known, key) for key in keys] if keys else list(known)


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
    context: CommandContext, keys: Sequence[str], ephemeris: Path | None
) -> list[Elements | Ephemeris]:
    """Return what a user means by each TARGET; without any, everything in the file, or in the elements.

    Elements are read where a satellite of theirs may be asked for. Raises TleError, BadInputError.
    """
    if ephemeris is not None:
        return list(_objects_of(context, ephemeris, keys))
    if not keys:
        return list(context.elements())
    from tle.sources import find

    known = context.known_elements()
    others = [find_target(context, key, None, known) for key in keys]
    missing = [key for key, other in zip(keys, others, strict=True) if other is None]
    elements = (known() or context.elements(*missing)) if missing else []
    return [other or find(elements, key) for key, other in zip(keys, others, strict=True)]

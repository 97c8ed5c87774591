"""What a command's TARGET is: an object of an ephemeris file, a body, a direction, or a satellite."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tle.errors import AmbiguousSatelliteError, SatelliteNotFoundError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.cli.common import CommandContext
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris


def ephemeris_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --ephemeris to a command; it comes as `ephemeris`, a path or None."""
    return click.option(
        "--ephemeris",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="TARGET is an object of this CPF, OEM or SP3 file.",
    )(function)


def find_target(
    context: CommandContext, key: str, ephemeris: Path | None, elements: Callable[[], list[Elements]]
) -> Ephemeris | None:
    """Return what TARGET is where it has no elements, None where it is a satellite that must have some.

    It is an object of the ephemeris file where one is given, else Sun, Moon, a planet, RA,DEC, or a star by
    its number, or by its name where no satellite has it: then alone are `elements` asked for.
    Raises TleError, BadInputError.
    """
    if ephemeris is not None:
        return _objects_of(ephemeris, [key])[0]
    from tle.bodies import find_body, read_star, star_number

    body = find_body(key)
    by_number = key.strip().casefold().startswith("hip")
    if body is not None or not (by_number or _has_no(elements(), key)):
        return body
    number = star_number(key)
    return None if number is None else read_star(number, key, context.settings.stars)


def _objects_of(ephemeris: Path, keys: Sequence[str]) -> list[Ephemeris]:
    """Return the named objects of an ephemeris file, all of them without names; it is read once."""
    from tle.formats.ephemerides import find_ephemeris, read_ephemerides

    known = read_ephemerides(ephemeris)
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
        return list(_objects_of(ephemeris, keys))
    if not keys:
        return list(context.elements())
    from tle.sources import find

    known = context.known_elements()
    others = [find_target(context, key, None, known) for key in keys]
    missing = [key for key, other in zip(keys, others, strict=True) if other is None]
    elements = (known() or context.elements(*missing)) if missing else []
    return [other or find(elements, key) for key, other in zip(keys, others, strict=True)]

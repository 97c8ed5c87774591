"""What a command's TARGET is: an object of an ephemeris file, a body, a direction, or a satellite."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

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


def find_targets(
    context: CommandContext, keys: Sequence[str], ephemeris: Path | None
) -> list[Elements | Ephemeris]:
    """Return what a user means by each TARGET.

    An object of the ephemeris file where one is given; else Sun, Moon, a planet, or RA,DEC; else a satellite
    of the elements, which are read where one is asked for. Without keys it is everything in the file, or in
    the elements. Raises TleError, BadInputError.
    """
    if ephemeris is not None:
        from tle.formats.ephemerides import find_ephemeris, read_ephemerides

        found = read_ephemerides(ephemeris)
        return [find_ephemeris(found, key) for key in keys] if keys else list(found)
    if not keys:
        return list(context.elements())
    from tle.bodies import find_body
    from tle.sources import find

    bodies = [find_body(key) for key in keys]
    elements = context.elements() if None in bodies else []
    return [body or find(elements, key) for key, body in zip(keys, bodies, strict=True)]

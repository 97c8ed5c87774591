"""What a command's TARGET is: an object of an ephemeris file, a body, a direction, or a satellite."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable

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


def find_target(context: CommandContext, key: str, ephemeris: Path | None) -> Elements | Ephemeris:
    """Return what a user means by TARGET.

    An object of the ephemeris file where one is given; else Sun, Moon, a planet, or RA,DEC; else a satellite
    of the elements. Raises TleError, BadInputError.
    """
    if ephemeris is not None:
        from tle.formats.ephemerides import find_ephemeris, read_ephemerides

        return find_ephemeris(read_ephemerides(ephemeris), key)
    from tle.bodies import find_body

    body = find_body(key)
    if body is not None:
        return body
    from tle.sources import find

    return find(context.elements(), key)

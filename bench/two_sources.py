"""How far two sources of one object are apart, against what each states: files, element sets.

    python bench/two_sources.py FILE FILE [...]

Every pair with the same catalogue number, or the same name, is compared at 200 instants of the time that both
have, of a day at most. Stated is the root of the squares' sum, with 100 m for a file that states nothing.
"""

from __future__ import annotations

import itertools
import sys
from typing import TYPE_CHECKING

import numpy as np

from tle.earth import EarthOrientation
from tle.ephemeris import UNSTATED_M, expected_error_m
from tle.errors import TleError
from tle.formats.ephemerides import read_ephemerides
from tle.instants import Utc
from tle.sources import read_elements

if TYPE_CHECKING:
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris

INSTANTS, DAY_S = 200, 86400.0


def objects(path: str) -> list[Elements | Ephemeris]:
    """Return what a file has: objects of an ephemeris, or element sets."""
    try:
        return list(read_ephemerides(path))
    except TleError:
        return list(read_elements(path))


def overlap(one: Elements | Ephemeris, other: Elements | Ephemeris) -> tuple[float, float] | None:
    """Return from when to when both have places, POSIX seconds, a day at most."""
    spans = [[float(end.unix_s) for end in span] for each in (one, other) for span in each.spans[:1]]
    if not spans:
        return None
    low, high = max(span[0] for span in spans), min(span[1] for span in spans)
    return (low, min(high, low + DAY_S)) if high > low else None


def main() -> None:
    earth = EarthOrientation.installed()
    files = [(path, one) for path in sys.argv[1:] for one in objects(path)]
    for (a, one), (b, other) in itertools.combinations(files, 2):
        same = one.catalog_number == other.catalog_number if one.catalog_number else one.name == other.name
        span = overlap(one, other) if same and a != b else None
        if span is None:
            continue
        at = np.linspace(*span, INSTANTS)
        places = [np.array(each.states(earth).at_many(at, 0.0)[:3]) for each in (one, other)]
        apart_m = 1000.0 * np.linalg.norm(places[1] - places[0], axis=0)
        stated = [
            [expected_error_m(each, Utc(t)) or UNSTATED_M for t in at.tolist()] for each in (one, other)
        ]
        share = apart_m / np.hypot(*np.array(stated))
        print(
            f"{one.label}, {one.provenance} and {other.provenance}: {apart_m.mean():.3g} m apart, at most "
            f"{apart_m.max():.3g} m, {np.sqrt((share**2).mean()):.2f} of what they state (RMS), at most "
            f"{share.max():.2f}"
        )


if __name__ == "__main__":
    main()

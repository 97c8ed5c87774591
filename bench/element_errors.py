"""How errors of elements grow: element sets of one object weeks apart, the older against the newer.

python bench/element_errors.py [CATALOGUES]

Of every object in low orbit of which the catalogues, a folder of files, hold two sets 15 to 45 days apart,
the older is propagated to the newer's epoch and its mean elements are compared: along the
orbit, semi-major axis, eccentricity vector, inclination, node, km. Median, 68 % and 90 % of the amounts.
Starlinks manoeuvre every few days.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tle.errors import TleError
from tle.instants import DAY_S
from tle.sources import load_elements

if TYPE_CHECKING:
    from tle.elements import Elements

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases" / "catalogues"
LEAST_DAYS, MOST_DAYS = 15.0, 45.0
LOW_S = 8000.0
COLUMNS = ("along", "axis", "ecc. x", "ecc. y", "incl.", "node")


def sequences(folder: Path) -> dict[int, list[Elements]]:
    """Return every object's sets in the order of their epochs, one an epoch."""
    found: dict[int, dict[int, Elements]] = defaultdict(dict)
    for path in sorted(one for one in folder.rglob("*") if one.is_file()):
        try:
            sets = load_elements(path)
        except TleError:
            continue
        for one in sets.accepted:
            found[one.catalog_number][round(float(one.epoch.unix_s))] = one
    return {number: [sets[epoch] for epoch in sorted(sets)] for number, sets in found.items()}


def differences_km(older: Elements, newer: Elements) -> tuple[float, ...] | None:
    """Return by what the newer set's mean elements differ from the older's then; None where SGP4 fails."""
    one, other = older.satrec(), newer.satrec()
    jd, fraction = other.jdsatepoch, other.jdsatepochF
    if one.sgp4(jd, fraction)[0] or other.sgp4(jd, fraction)[0]:
        return None
    a = newer.semi_major_axis_km
    node = math.remainder(other.Om - one.Om, 2.0 * math.pi)
    latitude = math.remainder(other.om + other.mm - one.om - one.mm, 2.0 * math.pi)
    return (
        a * (latitude + node * math.cos(other.im)),
        -2.0 / 3.0 * a * (other.nm - one.nm) / other.nm,
        a * (other.em * math.cos(other.om) - one.em * math.cos(one.om)),
        a * (other.em * math.sin(other.om) - one.em * math.sin(one.om)),
        a * (other.im - one.im),
        a * node * math.sin(other.im),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("catalogues", type=Path, nargs="?", default=CASES)
    options = parser.parse_args()
    rows: dict[str, list[tuple[float, ...]]] = {"Starlink": [], "others": []}
    days: list[float] = []
    for sets in sequences(options.catalogues).values():
        for older, newer in pairwise(sets):
            apart = float(newer.age_s(older.epoch)) / -DAY_S
            if LEAST_DAYS < apart < MOST_DAYS and older.period_s < LOW_S and older.eccentricity < 0.02:
                found = differences_km(older, newer)
                if found is not None:
                    name = f"{older.name} {newer.name}".upper()
                    rows["Starlink" if "STARLINK" in name else "others"].append(found)
                    days.append(apart)
    if not days:
        print(f"{options.catalogues}: no two sets of one object {LEAST_DAYS:g} to {MOST_DAYS:g} days apart")
        return
    print(f"{len(days)} pairs, {np.median(days):.0f} days apart; km, median / 68 % / 90 %")
    print(f"{'':<16}" + "".join(f"{name:>28}" for name in COLUMNS))
    for name, found in rows.items():
        if found:
            amounts = np.quantile(np.abs(np.array(found)), (0.5, 0.68, 0.9), axis=0).T
            cells = (f"{a:.2f} / {b:.2f} / {c:.2f}" for a, b, c in amounts)
            print(f"{name:<9}{len(found):>7}" + "".join(f"{cell:>28}" for cell in cells))


if __name__ == "__main__":
    main()

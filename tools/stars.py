"""Writes the stars that targets know without a catalogue: `python -m tools.stars HIP_MAIN.DAT IAU-CSN.TSV`.

HIP_MAIN.DAT is ESA's Hipparcos catalogue (SP-1200, 1997; CDS I/239), whole or in part, packed by gzip or not;
IAU-CSN.TSV the names approved by the IAU's Working Group on Star Names, by columns. Written are the stars to
magnitude 6.5 that have a place, a parallax and a proper motion, as lines of the catalogue with only those
columns, and in its column for the proximity flag the names: the IAU's, then those of skyfield.
"""

from __future__ import annotations

import csv
import gzip
import sys
from pathlib import Path

from skyfield.named_stars import named_star_dict

FAINTEST = 6.5
TARGET = Path(__file__).parent.parent / "tle" / "data" / "hipparcos_bright.dat.gz"


def names(path: Path) -> dict[str, list[str]]:
    """Return the names of stars by Hipparcos number."""
    with path.open(encoding="utf-8", newline="") as file:
        found = [(row["HIP"], row["Name/ASCII"]) for row in csv.DictReader(file, delimiter="\t")]
    approved = {name for _, name in found}
    found += [(str(number), name) for name, number in named_star_dict.items() if name not in approved]
    by_number: dict[str, list[str]] = {}
    for number, name in found:
        by_number.setdefault(number, []).append(name)
    return by_number


def line(fields: list[str], known: dict[str, list[str]]) -> str | None:
    """Return what is kept of a star; None where it is too faint, or has no place."""
    number, place = fields[1].strip(), [fields[k].strip() for k in (8, 9, 11, 12, 13)]
    magnitude = fields[5].strip()
    if not all(place) or not magnitude or float(magnitude) > FAINTEST:
        return None
    ra, dec, parallax, pm_ra, pm_dec = place
    called = ",".join(known.get(number, ()))
    return f"H|{number}|{called}||||||{ra}|{dec}||{parallax}|{pm_ra}|{pm_dec}|"


def main() -> None:
    """Write the stars in the order of the catalogue."""
    data = Path(sys.argv[1]).read_bytes()
    if data[:2] == b"\x1f\x8b":
        data = gzip.decompress(data)
    known = names(Path(sys.argv[2]))
    rows = [one.split("|") for one in data.decode("ascii").splitlines()]
    kept = [one for row in rows if (one := line(row, known)) is not None]
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_bytes(gzip.compress("\n".join([*kept, ""]).encode(), mtime=0))
    sys.stdout.write(f"{TARGET.name}: {len(kept)} stars, {TARGET.stat().st_size} bytes\n")


if __name__ == "__main__":
    main()

"""Fetch a group from CelesTrak, or take it as kept, and follow one of it in virtual time over Leiden.

Run from the project's root: python examples/follow_celestrak_group.py [GROUP [SATELLITE [UTC]]]
The group is asked for at most once in two hours, however often this runs.
"""

from __future__ import annotations

import argparse
import sys
import time

from sattrack.core.errors import SattrackError
from sattrack.elements.downloads import Downloads
from sattrack.runtime.facts import RunRequest, prepare
from sattrack.runtime.flight import fly_virtual
from tle import Site, TleError, Utc, find, read_elements


def main(group: str, satellite: str, start: str) -> None:
    """Fetch, choose, follow."""
    downloads = Downloads(tell=lambda words: print(words, file=sys.stderr))
    elements = read_elements(f"celestrak:{group}", fetch=downloads.fetch)
    print(f"{len(elements)} objects in {group}")
    chosen = find(elements, satellite)
    print(f"{chosen.name} ({chosen.catalog_number}), elements of {chosen.epoch.isoformat('seconds')}")
    request = RunRequest(
        satellite=str(chosen.catalog_number),
        mount_url="sim",
        elements=elements,
        site=Site(52.1541, 4.4908, 0.0),
        clock_option=start or Utc.of(time.time()).isoformat("seconds"),
        min_alt_deg=10.0,
        virtual=True,
    )
    summary = fly_virtual(prepare(request))
    print(f"on target for {summary.on_target_s:.0f} s, true error {summary.true_rms_arcsec:.3f}″ RMS")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Follow one satellite of a CelesTrak group in virtual time.")
    parser.add_argument("group", nargs="?", default="stations", help="CelesTrak's name of the group")
    parser.add_argument("satellite", nargs="?", default="ISS (ZARYA)", help="its name or catalogue number")
    parser.add_argument("start", nargs="?", default="", help="an instant in UTC; default: now")
    given = parser.parse_args()
    try:
        main(given.group, given.satellite, given.start)
    except (SattrackError, TleError) as error:
        sys.exit(str(error))

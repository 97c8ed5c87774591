"""Where the Moon, and a satellite of a CPF, OEM or SP3 file, are seen from Leiden.

python examples/moon_and_laser_satellite.py [FILE]
"""

from __future__ import annotations

import sys

from tle import Propagator, Site, Utc, find_body, find_passes, read_ephemerides

LEIDEN = Site(52.1541, 4.4908)

moon = find_body("Moon")
assert moon is not None
noon = Utc.parse("2026-10-02T12:00:00Z")
seen = Propagator(moon, LEIDEN).at(noon)
print(f"Moon: RA {seen.ra_deg:.4f}°, Dec {seen.dec_deg:.4f}°, {seen.range_km:.0f} km")
for one in find_passes(Propagator(moon, LEIDEN), noon, 24.0, min_alt_deg=0.0):
    print(f"highest at {one.culminate_utc.isoformat('seconds')}, {one.max_alt_deg:.1f}°")

for path in sys.argv[1:]:
    for target in read_ephemerides(path):
        start, end = target.spans[0]
        seen = Propagator(target, LEIDEN).at(start)
        print(f"{target.name}: {target.provenance}, {target.frame}")
        print(f"  {start.isoformat('seconds')} to {end.isoformat('seconds')}, at first {seen.az_deg:.3f}° az")

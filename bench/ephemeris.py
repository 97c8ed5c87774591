"""Directions against skyfield: how much faster, and how far apart; all ratios are taken by turns in one run.

Prints lines for a single instant and for many: the ratio of the times for RA, Dec, range and their rates, and
the largest difference on the sky in arcsec. Run it as `python bench/ephemeris.py`; it needs skyfield.
"""

from __future__ import annotations

import statistics
import time
from typing import TYPE_CHECKING

import numpy as np
from skyfield.api import EarthSatellite, load, wgs84
from skyfield.framelib import true_equator_and_equinox_of_date
from skyfield.timelib import Timescale

from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

# CelesTrak, elements of the ISS of 2026-10-02, and its pass over Leiden that day.
LINES = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
SITE = (52.1541, 4.4908, 0.0)
START_S = Utc.parse("2026-10-02T13:01:06Z").unix_s
DUT1_S, XP_ARCSEC, YP_ARCSEC = -0.0234, 0.1729, 0.3242
MANY = 12000
ROUNDS = 7
ONES = 400


def skyfield_peer() -> tuple[object, Timescale]:
    """Return skyfield's satellite minus site, and a timescale with the same UT1 and pole as ours."""
    builtin = load.timescale(builtin=True)
    ends = np.array([2400000.0, 2500000.0])
    delta_t = np.full(2, 37.0 + 32.184 - DUT1_S)
    timescale = Timescale((ends, delta_t), builtin.leap_dates, builtin.leap_offsets)
    timescale.polar_motion_table = (ends, np.full(2, XP_ARCSEC), np.full(2, YP_ARCSEC))
    return EarthSatellite(*LINES, ts=timescale) - wgs84.latlon(SITE[0], SITE[1], SITE[2]), timescale


def seconds_of(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def compare(
    label: str, ours: Callable[[], object], theirs: Callable[[], object], off: tuple[float, float]
) -> None:
    """Time both by turns and print the median ratio, with the smallest and largest, and the differences."""
    ours()
    theirs()
    ratios = sorted(seconds_of(theirs) / seconds_of(ours) for _ in range(ROUNDS))
    print(
        f"{label}: {statistics.median(ratios):.0f} times as fast as skyfield "
        f"({ratios[0]:.0f} to {ratios[-1]:.0f}), apart by at most {off[0]:.4f}″ and {off[1]:.4f}″/s"
    )


def main() -> None:
    peer, timescale = skyfield_peer()
    earth = EarthOrientation.fixed(DUT1_S, XP_ARCSEC, YP_ARCSEC)
    propagator = Propagator(Elements.from_tle(*LINES), Site(*SITE), earth=earth, place="geometric")
    apparent = Propagator(Elements.from_tle(*LINES), Site(*SITE), earth=earth)
    many_s = START_S + np.linspace(0.0, 516.0, MANY)
    ones_s = [float(s) for s in many_s[:: MANY // ONES]]

    def tt_of(unix_s):  # type: ignore[no-untyped-def]
        day = unix_s // 86400.0
        return timescale.tt_jd(day + 2440587.5, (unix_s - day * 86400.0 + 69.184) / 86400.0)

    def theirs_at(unix_s):  # type: ignore[no-untyped-def]
        return peer.at(tt_of(unix_s)).frame_latlon_and_rates(true_equator_and_equinox_of_date)

    def ours_at(seen):  # type: ignore[no-untyped-def]
        return (
            seen.ra_deg,
            seen.dec_deg,
            seen.range_km,
            seen.ra_rate_deg_s,
            seen.dec_rate_deg_s,
            seen.range_rate_km_s,
        )

    seen = propagator.at(Utc(many_s))
    dec, ra, _, dec_rate, ra_rate, _ = theirs_at(many_s)
    across = np.cos(np.radians(seen.dec_deg))
    east = (np.remainder(ra.degrees - seen.ra_deg + 180.0, 360.0) - 180.0) * across
    off = float(np.hypot(east, dec.degrees - seen.dec_deg).max() * 3600.0)
    east_rate = (ra_rate.degrees.per_second - seen.ra_rate_deg_s) * across
    rate_off = float(np.hypot(east_rate, dec_rate.degrees.per_second - seen.dec_rate_deg_s).max() * 3600.0)
    for place, one in (("geometric", propagator), ("apparent", apparent)):
        compare(
            f"one instant, {place}",
            lambda one=one: [ours_at(one.at(Utc(s))) for s in ones_s],  # type: ignore[misc]
            lambda: [theirs_at(s) for s in ones_s],
            (off, rate_off),
        )
        compare(
            f"{MANY} instants, {place}",
            lambda one=one: ours_at(one.at(Utc(many_s))),  # type: ignore[misc]
            lambda: theirs_at(many_s),
            (off, rate_off),
        )
    print("Differences are of the geometric place; skyfield's rates are made of SGP4's own velocities.")


if __name__ == "__main__":
    main()

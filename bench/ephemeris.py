"""Directions against skyfield: how much faster, and how far apart; all ratios are taken by turns in one run.

Prints lines for a single instant and for many: the ratio of the times for RA, Dec, range and their rates, and
the largest difference on the sky in arcsec. Run it as `python bench/ephemeris.py`; it needs skyfield. With
`--budget` it prints the size of each effect instead, over the ISS's passes of 2026-10-02 over Leiden and
Paranal above 10°.
"""

from __future__ import annotations

import statistics
import sys
import time
from typing import TYPE_CHECKING

import erfa
import numpy as np
from sgp4.api import WGS72, WGS84, Satrec
from skyfield.api import EarthSatellite, load, wgs84
from skyfield.framelib import true_equator_and_equinox_of_date
from skyfield.timelib import Timescale

from tle.bias import Bias
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
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
PARANAL = (-24.627, -70.404, 2635.0)
PARANAL_START_S = Utc.parse("2026-10-02T01:10:27Z").unix_s
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


def budget() -> list[tuple[str, str, str]]:
    """Return the effects as (name, from-to, unit), over two passes above 10°, Earth orientation fixed."""
    seen = [track(*pair) for pair in ((LINES, SITE, START_S), (LINES, PARANAL, PARANAL_START_S))]
    rows = []
    for name, unit, effect in EFFECTS:
        values = np.concatenate([np.atleast_1d(effect(one)) for one in seen])
        rows.append((name, f"{plainly(values.min())} to {plainly(values.max())}", unit))
    return rows


class Sky:
    """A pass: its propagator's arguments, the instants above 10°, and directions with one thing changed."""

    def __init__(self, lines: tuple[str, str], site: Site, times: Utc) -> None:
        self.lines, self.elements, self.site, self.times = lines, Elements.from_tle(*lines), site, times

    def at(
        self,
        times: Utc | None = None,
        orientation: tuple[float, float, float] | None = None,
        **changed: object,
    ):  # type: ignore[no-untyped-def]
        earth = EarthOrientation.fixed(*(orientation or (DUT1_S, XP_ARCSEC, YP_ARCSEC)))
        return Propagator(self.elements, self.site, earth=earth, **changed).at(times or self.times)  # type: ignore[arg-type]


def track(lines: tuple[str, str], place: tuple[float, float, float], start_s: float) -> Sky:
    sky = Sky(lines, Site(*place), Utc(start_s + np.arange(0.0, 520.0, 2.0)))
    return Sky(lines, Site(*place), Utc(sky.times.unix_s[sky.at().alt_deg > 10.0]))


def apart(one, other):  # type: ignore[no-untyped-def]
    """Return the angle between two directions, arcsec."""
    return np.degrees(2.0 * np.arcsin(0.5 * np.linalg.norm(one.unit - other.unit, axis=1))) * 3600.0


def sgp4_velocity_error(sky: Sky):  # type: ignore[no-untyped-def]
    """Return the rate that SGP4's own velocities miss, arcsec/s."""
    jd, fraction = sky.times.split()
    record = sky.elements.satrec()
    _, _, velocity = record.sgp4_array(jd, fraction)
    _, early, _ = record.sgp4_array(jd, fraction - 0.5 / 86400.0)
    _, late, _ = record.sgp4_array(jd, fraction + 0.5 / 86400.0)
    off = late - early - velocity
    u = sky.at(place="geometric").unit
    across = off - np.sum(off * u, axis=1, keepdims=True) * u
    return np.degrees(np.linalg.norm(across, axis=1) / sky.at().range_km) * 3600.0


def gravity_constants(sky: Sky):  # type: ignore[no-untyped-def]
    """Return what WGS 84 in place of WGS 72 within SGP4 would do, arcsec."""
    jd, fraction = sky.times.split()
    there = [Satrec.twoline2rv(*sky.lines, which).sgp4_array(jd, fraction)[1] for which in (WGS72, WGS84)]
    off = there[1] - there[0]
    u = sky.at(place="geometric").unit
    across = off - np.sum(off * u, axis=1, keepdims=True) * u
    return np.degrees(np.linalg.norm(across, axis=1) / sky.at().range_km) * 3600.0


def teme_as_of_date(sky: Sky):  # type: ignore[no-untyped-def]
    earth = EarthOrientation.fixed(DUT1_S)
    equinoxes = earth.rotation(sky.times.unix_s)[2]
    return np.degrees(np.abs(equinoxes)) * 3600.0 * np.cos(np.radians(sky.at().dec_deg))


def interpolation(sky: Sky):  # type: ignore[no-untyped-def]
    """Return what the daily polynomials miss of ERFA's own GAST06A - GMST82, arcsec, over thirty years."""
    unix_s = np.linspace(Utc.parse("2018-01-01").unix_s, Utc.parse("2048-01-01").unix_s, 3001)
    days = np.floor(unix_s / 86400.0)
    second, whole = unix_s - days * 86400.0, days + 2440587.5
    ut1, tt = second / 86400.0, (second + 69.184) / 86400.0
    theirs = erfa.gst06a(whole, ut1, whole, tt) - erfa.gmst82(whole, ut1)
    ours = EarthOrientation.fixed(0.0).rotation(unix_s)[2]
    return np.degrees(np.abs(np.remainder(ours - theirs + np.pi, 2.0 * np.pi) - np.pi)).max() * 3600.0


EFFECTS = (
    ("light time", "″", lambda s: apart(s.at(diurnal_aberration=False), s.at(place="geometric"))),
    ("diurnal aberration", "″", lambda s: apart(s.at(), s.at(diurnal_aberration=False))),
    (
        "UT1-UTC of 0.1 s",
        "″",
        lambda s: apart(s.at(), s.at(orientation=(DUT1_S + 0.1, XP_ARCSEC, YP_ARCSEC))),
    ),
    ("polar motion", "″", lambda s: apart(s.at(), s.at(orientation=(DUT1_S, 0.0, 0.0)))),
    ("TEME taken for the true equinox", "″", teme_as_of_date),
    ("ICRF taken for the equinox of date", "″", lambda s: apart(s.at(), s.at(place="astrometric"))),
    (
        "refraction in the standard air",
        "″",
        lambda s: apart(s.at(), s.at(refraction=Refraction.standard(s.site.height_m))),
    ),
    ("10 ms of time", "″", lambda s: apart(s.at(), s.at(s.times.plus(0.01)))),
    (
        "a time bias of 1 s, applied to the observer, too",
        "″",
        lambda s: apart(s.at(bias=Bias(1.0)), s.at(s.times.plus(1.0))),
    ),
    ("WGS 84 in place of WGS 72 in SGP4", "″", gravity_constants),
    ("SGP4's velocities taken as rates", "″/s", sgp4_velocity_error),
    ("Earth orientation by daily polynomials", "″", interpolation),
    (
        "an instant's own rounding (a float of POSIX seconds)",
        "″",
        lambda s: apart(s.at(), s.at(s.times.plus(1.2e-7))),
    ),
)


def plainly(value: float) -> str:
    """Return three figures of a number, without powers of ten."""
    return str(np.format_float_positional(value, precision=3, fractional=False, trim="-"))


def print_budget() -> None:
    """Print the error budget as the table that docs/accuracy.md shows."""
    print("| effect | size |")
    print("|---|---|")
    for name, size, unit in budget():
        print(f"| {name} | {size}{unit} |")


if __name__ == "__main__":
    if "--budget" in sys.argv[1:]:
        print_budget()
    else:
        main()

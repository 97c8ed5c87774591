"""Print a SNAP schedule for the coming minutes: a source, offsets, a fixed place, and a satellite overhead.

python examples/field-system/schedule.py > /usr2/sched/overhead.snp

The source is one of the brighter ones that geodesy observes, whichever is west of the meridian and nearest to
it now. The satellite does not exist: its elements are made so that it passes the station now, moving north,
15° south of it and 6,400 km high. A real one's come from any element set.
"""

from __future__ import annotations

from tle import Elements, Site, Utc, write_elements
from tle.earth import EarthOrientation

SITE = Site(52.1541, 4.4908, 0.0)
SOURCES = {
    "0059+581": ("010245.7624", "582411.137"),
    "3c84": ("031948.1601", "413042.105"),
    "0552+398": ("055530.8056", "394849.165"),
    "4c39.25": ("092703.0139", "390220.852"),
    "1156+295": ("115931.8339", "291443.827"),
    "oq208": ("140700.3944", "282714.690"),
    "3c345": ("164258.8100", "394836.994"),
    "2113+293": ("211529.4135", "293338.367"),
    "3c454.3": ("225357.7479", "160853.561"),
}
"""Right ascension and declination, as SNAP has them (hhmmss, ddmmss), ICRF."""


def source(sidereal_deg: float) -> str:
    """Return the command for the source west of the meridian and nearest to it."""

    def hour_angle_deg(name: str) -> float:
        ra = SOURCES[name][0]
        return (sidereal_deg - 15.0 * (int(ra[:2]) + int(ra[2:4]) / 60.0)) % 360.0

    name = min(SOURCES, key=hour_angle_deg)
    return f"source={name},{','.join(SOURCES[name])},2000.0"


def overhead(now: Utc, sidereal_deg: float) -> list[str]:
    """Return the commands that give the Field System the satellite's elements."""
    orbit = Elements(
        name="OVERHEAD",
        catalog_number=99901,
        classification="U",
        designator="",
        epoch=now,
        inclination_deg=90.0,
        raan_deg=sidereal_deg,
        eccentricity=0.0001,
        arg_perigee_deg=0.0,
        mean_anomaly_deg=SITE.latitude_deg - 15.0,
        mean_motion_rev_day=6.0,
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=0.0,
    )
    lines = write_elements([orbit], "tle").splitlines()
    return [f"tle={number},{orbit.catalog_number},{line}" for number, line in enumerate(lines)]


def main() -> None:
    """Print the schedule."""
    now = Utc.now()
    sidereal_deg = float(EarthOrientation.installed().local_apparent_sidereal_deg(now, SITE))
    commands = [
        source(sidereal_deg),
        "onsource",
        "onsource=60",
        "track",
        '" an offset, as in a pointing scan',
        "offset",
        '" a fixed place of the antenna',
        "source=azel,200d,50d",
        "onsource=60",
        "track",
        '" a satellite; then 10 s ahead and 0.25 degrees left of it; then held, for a drift scan',
        *overhead(now, sidereal_deg),
        "satellite=,,track",
        "onsource=60",
        "track",
        "satoff=10,0.25,track",
        "onsource=20",
        "track",
        "drift",
        "source=stow",
        "onsource=60",
    ]
    print("\n".join(commands))


if __name__ == "__main__":
    main()

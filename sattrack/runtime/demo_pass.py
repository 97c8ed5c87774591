"""The pass that the demonstration follows: a real one, with its elements and site.

ISS, elements of 2026-275 (Space-Track, by way of CelesTrak), over Leiden on 2026-10-02: above 10° from
13:01:55 to 13:08:54 UTC, culminating at 13:05:24 UTC at 81.27°.
"""

from __future__ import annotations

from sattrack.mount.simulator.mount import StartPosition
from sattrack.settings import SiteSettings
from tle.elements import Elements

NAME = "ISS (ZARYA)"
LINE_1 = "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992"
LINE_2 = "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318"
SITE = SiteSettings(latitude_deg=52.1541, longitude_deg=4.4908, height_m=0.0)
BEFORE_PASS = "2026-10-02T13:00:00Z"
LEAD_S = 9.0
"""The demonstration starts so long before the satellite is high enough: time for the slew, no more."""
START = StartPosition(hour_angle_deg=50.0, dec_deg=15.0)
"""Where the demonstration's mount stands at first."""


def elements() -> Elements:
    """Return the satellite's elements."""
    return Elements.from_tle(LINE_1, LINE_2, NAME)

"""What a calibration run will move, how far and how long: known before anything moves.

Where the Sun is, and what a true sidereal clock would show, at a site.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, mean_sidereal_deg
from tle.earth import EarthOrientation
from tle.instants import Utc
from tle.sun import sun_km

if TYPE_CHECKING:
    from tle.site import Site


def sun_hour_angle_and_dec(utc_s: float, site: Site) -> tuple[float, float]:
    """Return the Sun's hour angle and declination of date at an instant, degrees, to a few arcseconds.

    Raises TimeRangeError where the Earth's orientation is not known.
    """
    earth, at = EarthOrientation.installed(), Utc(utc_s)
    x, y, z = (float(c) for c in earth.celestial_matrix(at) @ sun_km(at))
    right_ascension = math.degrees(math.atan2(y, x))
    sidereal = float(earth.local_apparent_sidereal_deg(at, site))
    hour_angle = (sidereal - right_ascension + 180.0) % 360.0 - 180.0
    return hour_angle, math.degrees(math.atan2(z, math.hypot(x, y)))


def true_clocks(utc_s: float, site: Site) -> dict[str, float]:
    """Return by how many seconds each kind of true sidereal clock is ahead of mean time with UT1 = UTC.

    A mount's clock may show mean or apparent sidereal time, and may know UT1 or take UTC for it. Raises
    TimeRangeError.
    """
    earth, at = EarthOrientation.installed(), Utc(utc_s)
    plain = mean_sidereal_deg(utc_s, site.longitude_deg)
    apparent = float(earth.local_apparent_sidereal_deg(at, site))
    equinoxes_deg = float(np.degrees(earth.rotation(utc_s)[2]))

    def ahead_s(sidereal_deg: float) -> float:
        return ((sidereal_deg - plain + 180.0) % 360.0 - 180.0) / SIDEREAL_RATE_DEG_S

    return {
        "mean, UT1 taken as UTC": 0.0,
        "mean, by UT1": ahead_s(apparent - equinoxes_deg),
        "apparent, by UT1": ahead_s(apparent),
    }


FIRST_RATE_DEG_S = 0.2
SECOND_RATE_DEG_S = 0.1
CENTRED_WITHIN_DEG = 0.25
"""How near to where it began an axis is brought back after that test."""
SEMANTICS_PART_S = 1.2
"""How long each part of the test for held or edge lasts: first rate, second rate, flag down."""
STEP_RATES_DEG_S = (0.10, 0.12, 0.10, 0.12, 0.10)
"""Rates one after another without a stop, whose steps are too small to meet the axis' limits."""
STEP_PART_S = 1.2
USUAL_STATUS_PERIOD_S = 0.1
"""Where statuses come more rarely, motions take longer and are slower by as much."""
SILENT_PERIODS = 10.0
LARGEST_GAIN = 1.5
"""An axis that goes faster than this times its command is stopped."""
REACTION_S = 0.45
"""What a round trip, a turn of the mount's loop and braking may add to each motion."""
LARGEST_DISPLACEMENT_DEG = 3.0
"""The run is stopped where an axis stands farther than this from where it began."""
BOX_DEG = 4.2
"""What is checked beforehand: the largest displacement and the way to stop from it."""
LARGEST_DURATION_S = 600.0


@dataclass(frozen=True, slots=True)
class Leg:
    """One steady motion of one axis."""

    rate_deg_s: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Plan:
    """A run: how often the harmless flag is raised before and after, and each axis' motions.

    Motions come in pairs of opposite ones, so that an axis ends near where it began, and to both sides of
    that: torque ripple bends the rate over a stretch of one degree, and bends it back farther on. The fastest
    ones lead back to the middle.
    """

    toggles: int = 36
    most_toggles: int = 120
    """So often where delays scatter."""
    toggles_after: int = 12
    silent_after_s: float = 0.6
    """A mount that says nothing for so long has fallen silent."""
    steps: bool = True
    """Whether the rate of a motion is changed by small steps, too."""
    legs: tuple[Leg, ...] = (
        Leg(-0.8, 2.4),
        Leg(1.6, 0.9),
        Leg(0.8, 2.4),
        Leg(-1.6, 0.9),
        Leg(0.8, 2.4),
        Leg(-1.6, 0.9),
        Leg(-0.8, 2.4),
        Leg(1.6, 0.9),
        Leg(-0.4, 3.6),
        Leg(0.4, 3.6),
        Leg(0.4, 3.6),
        Leg(-0.4, 3.6),
        Leg(-0.2, 4.0),
        Leg(0.2, 4.0),
    )

    def suited(self, largest_deg_s: float | None, status_period_s: float) -> Plan:
        """Return the plan with motions no faster than an axis bears, and so long that enough is seen of each.

        Raises ValueError where the largest rate is below FIRST_RATE_DEG_S.
        """
        slower = max(1.0, status_period_s / USUAL_STATUS_PERIOD_S)
        part = 1.0 / slower
        if largest_deg_s is not None and part * self.fastest_deg_s > largest_deg_s:
            part = largest_deg_s / self.fastest_deg_s
        if largest_deg_s is not None and largest_deg_s < FIRST_RATE_DEG_S:
            raise ValueError(
                f"the mount's largest rate is {largest_deg_s:g} °/s: no satellite can be followed"
            )
        legs = tuple(Leg(part * leg.rate_deg_s, slower * leg.seconds) for leg in self.legs)
        silent_after_s = max(self.silent_after_s, SILENT_PERIODS * status_period_s)
        return replace(self, legs=legs, silent_after_s=silent_after_s)

    @property
    def fastest_deg_s(self) -> float:
        """The largest rate commanded."""
        return max(FIRST_RATE_DEG_S, *(abs(leg.rate_deg_s) for leg in self.legs))

    def largest_displacement_deg(self) -> float:
        """Return how far an axis of gain 1.1 comes from where it began, at most, by either semantics."""
        farthest = FIRST_RATE_DEG_S * (4.0 * SEMANTICS_PART_S + 2.0 * REACTION_S)
        at = CENTRED_WITHIN_DEG
        for leg in self.legs:
            at += leg.rate_deg_s * (leg.seconds + REACTION_S)
            farthest = max(farthest, abs(at))
        return 1.1 * farthest

    def expected_s(self) -> float:
        """Return about how long the run takes, for showing how far it has come."""
        motions = sum(leg.seconds + 1.6 for leg in self.legs) + 4.0 * SEMANTICS_PART_S + 6.0
        motions += 2.0 * (len(STEP_RATES_DEG_S) * STEP_PART_S + 1.6)
        return 4.0 + 0.36 * (self.toggles + self.toggles_after) + 2.0 * motions

    def words(self) -> list[str]:
        """Say to the operator what will happen."""
        return [
            f"each axis in turn goes up to {self.largest_displacement_deg():.1f}° to either side of where it "
            f"stands, at {self.fastest_deg_s:g} °/s at most, and ends near where it began "
            f"(beyond {LARGEST_DISPLACEMENT_DEG:g}° the run is stopped)",
            f"it takes about {self.expected_s() / 60.0:.1f} minutes; the mount is brought to rest first and "
            "left at rest",
        ]

"""The bounds that are a site's own, as settings: floor, horizon, Sun and Moon, and the longest fault."""

from __future__ import annotations

import math
from itertools import pairwise

import msgspec

SUN_CONE_DEG = 15.0
"""How near to the Sun's centre a telescope with optics may point unless the settings say otherwise."""
WIDEST_GAP_DEG = 90.0
"""A horizon with a wider gap between two of its azimuths says nothing of what stands there."""
MOST_FAULT_S = 10.0

HorizonPoint = tuple[float, float]
"""Azimuth (0 to 360, from north through east) and altitude of the skyline there, degrees."""


class SiteLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The bounds that are the site's own but for its skyline; degrees and seconds.

    `floor_altitude_deg` holds in every direction. `optical` says that there is a telescope with optics on the
    mount: then a cone about the Sun is forbidden, of `sun_cone_deg` where that is given and 15° where it is
    not. `moon_cone_deg` is the same about the Moon, 0 for none. `longest_fault_s` is the longest time for
    which commands, statuses or both may be lost without a limit being passed. `clock_tolerance_s` is how far
    the mount's sidereal clock may be from ours.

    Raises ValueError, naming the key, for a bound that cannot be one or that contradicts another.
    """

    floor_altitude_deg: float = 0.0
    optical: bool = True
    sun_cone_deg: float | None = None
    moon_cone_deg: float = 0.0
    longest_fault_s: float = 1.0
    clock_tolerance_s: float = 60.0

    @property
    def sun_deg(self) -> float:
        """The half angle of the cone about the Sun in force, 0 for none."""
        if self.sun_cone_deg is not None:
            return self.sun_cone_deg
        return SUN_CONE_DEG if self.optical else 0.0

    def __post_init__(self) -> None:
        """Check every bound, and each against the others."""
        if not -90.0 <= self.floor_altitude_deg < 90.0:
            raise ValueError(
                f"floor_altitude_deg is {self.floor_altitude_deg:g}; it goes from -90 to below 90"
            )
        if not 0.0 <= self.longest_fault_s <= MOST_FAULT_S:
            raise ValueError(
                f"longest_fault_s is {self.longest_fault_s:g}; give 0 to {MOST_FAULT_S:g} seconds"
            )
        if not (math.isfinite(self.clock_tolerance_s) and self.clock_tolerance_s > 0.0):
            raise ValueError(f"clock_tolerance_s is {self.clock_tolerance_s:g}; it must be above 0")
        self._check_cones(self.floor_altitude_deg)

    def _check_cones(self, lowest_deg: float) -> None:
        if self.optical and self.sun_cone_deg == 0.0:
            raise ValueError(
                "sun_cone_deg is 0, but there is a telescope with optics: "
                "say optical = false where there is none"
            )
        sky_deg = 90.0 - lowest_deg
        for name, cone_deg in (("sun_cone_deg", self.sun_deg), ("moon_cone_deg", self.moon_cone_deg)):
            if not (math.isfinite(cone_deg) and cone_deg >= 0.0):
                raise ValueError(f"{name} is {cone_deg:g}; it must be 0 or more")
            if cone_deg >= sky_deg:
                raise ValueError(
                    f"{name} is {cone_deg:g}, and the sky left reaches {sky_deg:g}° from the zenith: with "
                    "the body there, nothing could be pointed at; give a narrower cone or a lower floor"
                )


class SafetyLimits(SiteLimits, frozen=True, forbid_unknown_fields=True):
    """The bounds that are the site's own, with its skyline.

    `horizon` holds where it stands higher than the floor: points of rising azimuth, straight between them and
    round through north, none for no skyline.
    """

    horizon: tuple[HorizonPoint, ...] = ()

    def __post_init__(self) -> None:
        """Check every bound, and each against the others."""
        super().__post_init__()
        if self.horizon:
            self._check_horizon()
            self._check_cones(max(self.floor_altitude_deg, min(altitude for _, altitude in self.horizon)))

    def _check_horizon(self) -> None:
        azimuths = [azimuth for azimuth, _ in self.horizon]
        for azimuth, altitude in self.horizon:
            if not (0.0 <= azimuth <= 360.0 and -90.0 <= altitude < 90.0):
                raise ValueError(
                    f"horizon is {azimuth:g} {altitude:g} at one point; azimuths go from 0 to 360, "
                    "altitudes from -90 to below 90"
                )
        for one, other in pairwise(azimuths):
            if other < one:
                raise ValueError(f"horizon is not sorted: azimuth {other:g}° comes after {one:g}°")
        for one, other in zip(azimuths, [*azimuths[1:], *(a + 360.0 for a in azimuths[:1])], strict=True):
            if other - one > WIDEST_GAP_DEG:
                raise ValueError(
                    f"horizon is not known between azimuths {one:g}° and {other % 360.0:g}°; give points no "
                    f"more than {WIDEST_GAP_DEG:g}° apart"
                )

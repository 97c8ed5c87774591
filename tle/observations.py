"""Observed directions of satellites: one type, its sources, and what elements say about them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tle.errors import ObservationError
from tle.residuals import BiasEstimate, Frame, bias_from_observation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.instants import Utc
    from tle.site import Site

DEFAULT_SIGMA_ARCSEC = 1.0


@dataclass(frozen=True, slots=True)
class Observation:
    """A satellite's direction at an instant, as seen from a station.

    `object_key` is a catalogue number, designator or name, or "" where the source names none. The standard
    deviations are None where the source gives none. `source` and `line` say where it was read.
    """

    utc: Utc
    ra_deg: float
    dec_deg: float
    frame: Frame
    site: Site
    object_key: str = ""
    sigma_arcsec: float | None = None
    sigma_time_s: float | None = None
    source: str = ""
    line: int | None = None

    def __post_init__(self) -> None:
        """Check that the direction is one. Raises ObservationError."""
        if not -90.0 <= self.dec_deg <= 90.0:
            raise self.error(f"a declination of {self.dec_deg}° is outside -90° to 90°")
        if not 0.0 <= self.ra_deg <= 360.0:
            raise self.error(f"a right ascension of {self.ra_deg}° is outside 0° to 360°")
        for sigma in (self.sigma_arcsec, self.sigma_time_s):
            if sigma is not None and not (sigma >= 0.0 and math.isfinite(sigma)):
                raise self.error(f"an uncertainty of {sigma} is negative or no number")

    def error(self, reason: str) -> ObservationError:
        """Return an exception that says where the observation was read."""
        return ObservationError(placed(self.source, self.line, reason))

    def residual(self, elements: Elements, earth: EarthOrientation | None = None) -> BiasEstimate:
        """Return what the observation says of the elements: seconds along the track, degrees across it.

        Raises ObservationError naming the source where no bias along the track leads there.
        """
        from tle.propagator import Propagator

        try:
            return bias_from_observation(
                Propagator(elements, self.site, earth=earth),
                self.ra_deg,
                self.dec_deg,
                self.utc,
                self.frame,
                DEFAULT_SIGMA_ARCSEC if self.sigma_arcsec is None else self.sigma_arcsec,
                self.sigma_time_s or 0.0,
            )
        except ObservationError as error:
            raise self.error(f"{error}") from None


@dataclass(frozen=True, slots=True)
class Stations:
    """Sites by the name that observations give them, and the one for observations that name none."""

    by_name: Mapping[str, Site]
    default: Site | None = None

    def find(self, name: str) -> Site | None:
        """Return the site of a station; the default site for an unknown or empty name, None without one."""
        return self.by_name.get(name.strip(), self.default)


def placed(source: str, line: int | None, reason: str) -> str:
    """Return a reason with the file and line it is about."""
    if source and line:
        return f"{source}:{line}: {reason}"
    return f"{source}: {reason}" if source else reason

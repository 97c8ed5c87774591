"""Observed directions of satellites: one type, its sources, and what elements say about them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tle.errors import ObservationError, SourceError
from tle.residuals import BiasEstimate, Frame, bias_from_observation
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.instants import Utc

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


def read_observations(path: str | Path, stations: Stations) -> list[Observation]:
    """Return the observations in a file of CSV, IOD or CCSDS TDM (KVN or XML), told by its content.

    Raises SourceError where the file cannot be read, ObservationError where it, or one of them, is wrong.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig", errors="replace")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SourceError(f"{path}: cannot read observations: {reason}") from None
    return parse_observations(text, stations, str(path))


def parse_observations(text: str, stations: Stations, source: str = "") -> list[Observation]:
    """Return the observations in a text of CSV, IOD or CCSDS TDM. Raises ObservationError."""
    from tle.formats import iod, observations_csv, tdm

    if "CCSDS_TDM_VERS" in text or "<tdm" in text:
        found = tdm.parse_text(text, stations, source)
    elif iod.looks_like_iod(text):
        found = iod.parse_text(text, stations, source)
    elif observations_csv.looks_like_csv(text):
        found = observations_csv.parse_text(text, stations, source)
    else:
        raise ObservationError(
            placed(source, None, "holds no observations: give CSV with utc, ra_deg and dec_deg, IOD, or TDM")
        )
    if not found:
        raise ObservationError(placed(source, None, "holds no observations of RA and Dec"))
    return found


def read_stations(path: str | Path, default: Site | None = None) -> Stations:
    """Return the stations of an observers' list: number, initials, latitude and longitude in degrees, metres.

    Blank lines and `#` comments are skipped. Raises SourceError, ObservationError for a bad line, SiteError.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise SourceError(f"{path}: cannot read stations: {error.strerror}") from None
    number = r"[+-]?\d+\.?\d*"
    line_format = re.compile(rf"(\S+) +\S+ +({number}) +({number}) +({number})(?: .*)?", re.ASCII)
    sites = {}
    for at, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        match = line_format.fullmatch(line.expandtabs().strip())
        if match is None:
            raise ObservationError(
                placed(str(path), at, "is no station: write number, initials, latitude, longitude, height")
            )
        sites[match.group(1)] = Site(*(float(g) for g in match.groups()[1:]))
    return Stations(sites, default)


def placed(source: str, line: int | None, reason: str) -> str:
    """Return a reason with the file and line it is about."""
    if source and line:
        return f"{source}:{line}: {reason}"
    return f"{source}: {reason}" if source else reason


def site_of(stations: Stations, name: str, source: str, line: int | None) -> Site:
    """Return a station's site. Raises ObservationError where it is unknown and there is no default."""
    site = stations.find(name)
    if site is None:
        told = f"station {name.strip()!r} is not known" if name.strip() else "no station is named"
        raise ObservationError(placed(source, line, f"{told}: give a list of stations, or a site"))
    return site

"""What a satellite must stand above at a site: a least altitude, and a skyline where that is higher."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tle.errors import SiteError, SourceError
from tle.formats.rows import read_table

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tle.instants import Quantity


_CELL_DEG = 0.1
_CELLS = 3600


@dataclass(frozen=True, slots=True)
class HorizonMask:
    """Altitudes of the skyline at azimuths, both in degrees, linear between them and round through north.

    Azimuths rise from 0 up to 360; two with the same azimuth make a wall. Raises SiteError.
    """

    azimuths_deg: tuple[float, ...]
    altitudes_deg: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the points."""
        if not self.azimuths_deg or len(self.azimuths_deg) != len(self.altitudes_deg):
            raise SiteError("a horizon needs at least one azimuth and an altitude for each")
        for azimuth, altitude in zip(self.azimuths_deg, self.altitudes_deg, strict=True):
            _check_point(azimuth, altitude)
        if any(b < a for a, b in zip(self.azimuths_deg, self.azimuths_deg[1:], strict=False)):
            raise SiteError("the azimuths of a horizon must rise: sort its points")

    @classmethod
    def read(cls, path: str | Path) -> HorizonMask:
        """Return the horizon in a text file: azimuth and altitude in degrees on each line.

        Blanks or a comma part the two numbers; `#` begins a comment; an azimuth of 360 is that of 0.
        Raises SourceError, naming file and line.
        """
        points: list[tuple[float, float]] = []
        for number, line, words in read_table(path, "the horizon"):
            try:
                azimuth, altitude = (float(word) for word in words)
                _check_point(azimuth, altitude)
            except ValueError:
                raise SourceError(
                    f"{path}:{number}: {line!r} is no point of a horizon: "
                    "write azimuth and altitude in degrees, as 135 12.5"
                ) from None
            except SiteError as error:
                raise SourceError(f"{path}:{number}: {error}") from None
            if points and azimuth < points[-1][0]:
                raise SourceError(
                    f"{path}:{number}: azimuth {azimuth:g}° comes after {points[-1][0]:g}°: "
                    "sort the lines by azimuth"
                )
            points.append((azimuth, altitude))
        if not points:
            raise SourceError(
                f"{path}: holds no points of a horizon: write azimuth and altitude on each line"
            )
        return cls(tuple(p[0] for p in points), tuple(p[1] for p in points))

    def altitude_deg(self, azimuth_deg: Quantity) -> Quantity:
        """Return the altitude of the skyline in directions of any shape."""
        first, last = self.azimuths_deg[0], self.azimuths_deg[-1]
        azimuths = [last - 360.0, *self.azimuths_deg, first + 360.0]
        altitudes = [self.altitudes_deg[-1], *self.altitudes_deg, self.altitudes_deg[0]]
        return np.interp(azimuth_deg, azimuths, altitudes)


class Horizon:
    """What a satellite must stand above: a least altitude everywhere, and a skyline where it is higher."""

    def __init__(self, min_alt_deg: float, mask: HorizonMask | None = None) -> None:
        """Prepare bounds over ranges of azimuth. Raises SiteError for an altitude outside -90° to 90°."""
        if not -90.0 <= min_alt_deg <= 90.0:
            raise SiteError(f"a least altitude of {min_alt_deg}° is outside -90° to 90°")
        self.min_alt_deg = min_alt_deg
        self.mask = mask
        self.lowest_deg = min_alt_deg
        self._low: list[NDArray[np.float64]] = []
        self._high: list[NDArray[np.float64]] = []
        if mask is not None:
            low, high = _cells(mask)
            low, high = np.maximum(low, min_alt_deg), np.maximum(high, min_alt_deg)
            self.lowest_deg = float(low.min())
            # Level k holds the extremes of 2**k cells from each on, round through north.
            for level in range(12):
                self._low.append(low)
                self._high.append(high)
                low = np.minimum(low, np.roll(low, -(1 << level)))
                high = np.maximum(high, np.roll(high, -(1 << level)))

    def __repr__(self) -> str:
        """Show the least altitude, and how many points the skyline has."""
        skyline = "" if self.mask is None else f", skyline of {len(self.mask.azimuths_deg)} points"
        return f"<Horizon above {self.min_alt_deg:g}°{skyline}>"

    def altitude_deg(self, azimuth_deg: Quantity) -> Quantity:
        """Return the altitude to be exceeded at azimuths in degrees."""
        if self.mask is None:
            return self.min_alt_deg
        return np.maximum(self.mask.altitude_deg(azimuth_deg), self.min_alt_deg)

    def extremes_deg(
        self, azimuth_deg: NDArray[np.float64], aside_deg: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return bounds of the altitude to be exceeded within `aside_deg` of azimuths; shapes (m,)."""
        if self.mask is None:
            flat = np.full(np.shape(azimuth_deg), self.min_alt_deg)
            return flat, flat
        first = np.floor((azimuth_deg - aside_deg) / _CELL_DEG).astype(np.int64)
        last = np.floor((azimuth_deg + aside_deg) / _CELL_DEG).astype(np.int64)
        count = np.clip(last - first + 1, 1, _CELLS)
        level = np.floor(np.log2(count)).astype(np.int64)
        second = (first + count - (1 << level)) % _CELLS
        low, high = np.array(self._low), np.array(self._high)
        first %= _CELLS
        return (
            np.minimum(low[level, first], low[level, second]),
            np.maximum(high[level, first], high[level, second]),
        )


def _check_point(azimuth_deg: float, altitude_deg: float) -> None:
    if not 0.0 <= azimuth_deg <= 360.0:
        raise SiteError(f"an azimuth of {azimuth_deg:g}° is outside 0° to 360°")
    if not (math.isfinite(altitude_deg) and -90.0 <= altitude_deg <= 90.0):
        raise SiteError(f"an altitude of {altitude_deg:g}° is outside -90° to 90°")


def _cells(mask: HorizonMask) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest altitude in each tenth of a degree of azimuth, borders included."""
    edges = mask.altitude_deg(np.arange(_CELLS + 1) * _CELL_DEG)
    low, high = np.minimum(edges[:-1], edges[1:]), np.maximum(edges[:-1], edges[1:])
    for azimuth, altitude in zip(mask.azimuths_deg, mask.altitudes_deg, strict=True):
        middle = int(azimuth / _CELL_DEG)
        # The point may stand on a border, which rounding puts on either side.
        for cell in (middle - 1, middle, middle + 1):
            low[cell % _CELLS] = min(low[cell % _CELLS], altitude)
            high[cell % _CELLS] = max(high[cell % _CELLS], altitude)
    return low, high

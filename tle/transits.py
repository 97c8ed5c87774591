"""When satellites cross the discs of Sun and Moon as a site sees them.

Which passes come near either is known from `tle.facts.fact_columns`; here those are looked at closely, with
the apparent places of satellite and body. Both are without air, which bends them alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from tle.bodies import Body
from tle.elements import Elements, expected_along_s
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from tle.direction import Direction
    from tle.ephemeris import Ephemeris
    from tle.facts import FactColumns
    from tle.passes import CataloguePasses

    Array = NDArray[np.float64]

_RADIUS_KM = {"Sun": 695700.0, "Moon": 1737.4}
"""IAU 2015 (B3) and IAU/IAG 2015."""
# The largest disc is 0.28° in radius; the separations of passes are good to a hundredth.
_NEAR_DEG = 0.32
_STEP_S = 1.0
_MOST_LOOKS = 100_000
_CLOSER = 200
_ROUNDS = 3
_LINE_STEP_S = 0.05


@dataclass(frozen=True, slots=True)
class Transit:
    """One object before one body: when, how near to the centre of the disc, and where else it is seen.

    `separation_deg` is between the centres at `utc`, `radius_deg` the disc's. The strip on the ground from
    which it is seen is `width_km` wide, and its middle `off_line_km` from the site. `sigma_s` is by how much
    the elements let it come early or late, None where they do not say.
    """

    target: Elements | Ephemeris
    body: str
    utc: Utc
    begin_utc: Utc
    end_utc: Utc
    separation_deg: float
    radius_deg: float
    alt_deg: float
    az_deg: float
    range_km: float
    width_km: float
    off_line_km: float
    sunlit: bool
    sigma_s: float | None

    @property
    def duration_s(self) -> float:
        """Give how long the centre of the object is before the disc."""
        return float(self.end_utc.unix_s - self.begin_utc.unix_s)


def find_transits(passes: CataloguePasses, facts: FactColumns) -> list[Transit]:
    """Return the transits in passes whose facts are `facts`, with separations, in order of time.

    Raises PropagationError, BodyError.
    """
    ends = passes.search.ends(passes.found)
    site, start_s = passes.task.site, passes.task.span[0]
    found: list[Transit] = []
    for body, near_deg in (("Sun", facts.min_sun_separation_deg), ("Moon", facts.min_moon_separation_deg)):
        before = Propagator(Body(body), site, earth=passes.task.earth)
        for k in np.flatnonzero(near_deg < _NEAR_DEG).tolist():
            target = cast("Elements | Ephemeris", passes.elements[int(passes.found.obj[k])])
            if isinstance(target, Body) and target.name == body:
                continue
            pair = _Pair(Propagator(target, site, earth=passes.task.earth), before, body)
            span = start_s + float(ends[0][k]), start_s + float(ends[1][k])
            found += pair.transits(*span)
    return sorted(found, key=lambda one: float(one.utc.unix_s))


class _Looked(NamedTuple):
    unix_s: Array
    apart_rad: Array
    radius_rad: Array


class _Pair(NamedTuple):
    satellite: Propagator
    disc: Propagator
    body: str

    def look(self, first_s: float, last_s: float, count: int) -> _Looked:
        """Return how far apart the centres are at evenly spaced instants, and how large the disc is."""
        unix_s = np.linspace(first_s, last_s, count)
        there, disc = (one.at(Utc(unix_s)) for one in (self.satellite, self.disc))
        chord = np.linalg.norm(there.unit - disc.unit, axis=1)
        radius = np.arcsin(_RADIUS_KM[self.body] / np.asarray(disc.range_km))
        return _Looked(unix_s, 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)), radius)

    def transits(self, first_s: float, last_s: float) -> Iterator[Transit]:
        """Yield the transits between two instants, POSIX seconds."""
        count = int(np.clip((last_s - first_s) / _STEP_S, 10, _MOST_LOOKS)) + 1
        seen = self.look(first_s, last_s, count)
        step_s = (last_s - first_s) / (count - 1)
        apart = np.concatenate([[np.inf], seen.apart_rad, [np.inf]])
        least = np.flatnonzero((apart[1:-1] <= apart[:-2]) & (apart[1:-1] < apart[2:]))
        for k in least.tolist():
            after = seen.apart_rad[max(k - 1, 0) : k + 2]
            if seen.apart_rad[k] < seen.radius_rad[k] + float(np.ptp(after)):
                transit = self._closer(float(seen.unix_s[k]), step_s, (first_s, last_s))
                if transit is not None:
                    yield transit

    def _closer(self, about_s: float, reach_s: float, span: tuple[float, float]) -> Transit | None:
        """Return the transit that is nearest to the disc's centre about an instant; None where it misses."""
        for _ in range(_ROUNDS):
            close = self.look(max(span[0], about_s - reach_s), min(span[1], about_s + reach_s), _CLOSER + 1)
            k = int(np.argmin(close.apart_rad))
            about_s, reach_s = float(close.unix_s[k]), 2.0 * reach_s / _CLOSER
        apart, radius = float(close.apart_rad[k]), float(close.radius_rad[k])
        if apart >= radius:
            return None
        edges = [self._edge(about_s, way, span) for way in (-1.0, 1.0)]
        at = Utc(about_s)
        there = self.satellite.at(at)
        width_km, off_km = self._strip(at, radius)
        target = self.satellite.elements
        return Transit(
            target,
            self.body,
            at,
            Utc(edges[0]),
            Utc(edges[1]),
            float(np.degrees(apart)),
            float(np.degrees(radius)),
            float(there.alt_deg),
            float(there.az_deg),
            float(there.range_km),
            width_km,
            off_km,
            bool(there.sunlit),
            expected_along_s(target, at) if isinstance(target, Elements) else None,
        )

    def _edge(self, about_s: float, way: float, span: tuple[float, float]) -> float:
        """Return when the object is on the edge of the disc, before (-1) or after (1) an instant inside."""
        inside_s, outside_s, step_s = about_s, about_s, 0.1
        while True:
            outside_s = float(np.clip(about_s + way * step_s, *span))
            ends = self.look(about_s, outside_s, 2)
            if ends.apart_rad[1] >= ends.radius_rad[1]:
                break
            if outside_s in span:
                return outside_s
            inside_s, step_s = outside_s, 2.0 * step_s
        for _ in range(_ROUNDS):
            close = self.look(inside_s, outside_s, _CLOSER + 1)
            k = int(np.argmax(close.apart_rad >= close.radius_rad))
            inside_s, outside_s = float(close.unix_s[max(k - 1, 0)]), float(close.unix_s[k])
        return 0.5 * (inside_s + outside_s)

    def _strip(self, at: Utc, radius_rad: float) -> tuple[float, float]:
        """Return how wide the strip is on the level ground, and how far its middle is from the site; km."""
        points = []
        for seconds in (-_LINE_STEP_S, _LINE_STEP_S):
            moment = at.plus(seconds)
            there, disc = self.satellite.at(moment), self.disc.at(moment)
            place, towards = float(there.range_km) * _east_north_up(there), _east_north_up(disc)
            points.append((place - towards * (place[2] / towards[2]))[:2])
        run = points[1] - points[0]
        across = np.array([-run[1], run[0]]) / float(np.hypot(*run))
        # The cylinder about the line to the body's centre cuts an ellipse out of the ground.
        half_km = float(there.range_km) * radius_rad
        level = towards[:2] / float(np.hypot(towards[0], towards[1]) or 1.0)
        along = float(across @ level)
        width = 2.0 * half_km * float(np.hypot(along / towards[2], np.sqrt(max(0.0, 1.0 - along * along))))
        return width, abs(float(across @ points[0]))


def _east_north_up(seen: Direction) -> Array:
    alt, az = np.radians([float(seen.alt_deg), float(seen.az_deg)])
    return np.array([np.cos(alt) * np.sin(az), np.cos(alt) * np.cos(az), np.sin(alt)])

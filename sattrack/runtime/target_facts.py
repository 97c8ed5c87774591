"""What a run follows, where that has no elements, as plain data: rows or polynomials for the time of the run.

A run is made of what is kept here, live and in a replay, so both compute the same to the last bit, without
the file and without skyfield.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from tle.bodies import Body, StarPlace
from tle.earth import EarthOrientation
from tle.elements import gravity_km_s2
from tle.ephemeris import (
    CARRIED,
    Frame,
    FrameKind,
    Interpolation,
    Segment,
    TableEphemeris,
)
from tle.errors import EphemerisError
from tle.instants import Utc, leaps_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import State
    from tle.ephemeris import Ephemeris

    Array = NDArray[np.float64]

MARGIN_S = 1800.0
"""How long before the run, and after its end, there are places: for screens, slews and biases."""
REST_S = 86400.0
"""How long something that is no orbit is kept at rest before its first row, and after its last."""
STEP_S = 60.0
"""The step of rows that continue a table beyond its ends."""


class SegmentFacts(msgspec.Struct, frozen=True):
    """Rows of a table, as `tle.ephemeris.Segment` has them."""

    zero_s: float
    since_s: list[float]
    place_km: list[list[float]]
    velocity_km_s: list[list[float]] | None
    frame: FrameKind
    written: str
    frame_at: Utc | None
    rows: int
    hermite: bool
    use_s: tuple[float, float]


class BodyFacts(msgspec.Struct, frozen=True):
    """A body's polynomials, as `tle.bodies.Body` keeps them."""

    star: StarPlace | None
    parts: dict[str, list[list[float]]]


class TargetFacts(msgspec.Struct, frozen=True):
    """An object that is followed by rows, or as a body."""

    name: str
    provenance: str
    epoch: Utc
    catalog_number: int = 0
    source: str = ""
    sigma_km: float | None = None
    t0: Utc | None = None
    segments: tuple[SegmentFacts, ...] = ()
    body: BodyFacts | None = None

    def target(self) -> Ephemeris:
        """Return what gives the object's places. Raises EphemerisError."""
        if self.body is not None:
            parts = {key: np.array(rows) for key, rows in self.body.parts.items()}
            return Body(self.name, self.body.star, parts)
        table = TableEphemeris(
            self.name,
            [_segment(one) for one in self.segments],
            self.provenance,
            epoch=self.epoch,
            catalog_number=self.catalog_number,
            source=self.source,
            sigma_km=self.sigma_km,
        )
        table.t0 = self.t0
        return table


def target_facts(target: Ephemeris, begin_utc_s: float, end_utc_s: float) -> TargetFacts:
    """Return what is kept of a target for a run between two instants, POSIX seconds.

    Of a table it is the rows from which the places of the run are interpolated, continued beyond the table's
    ends, so that a slew can be planned before its first row, and a bias lead past its last: by gravity alone,
    or at rest what is no orbit.
    Raises TleError, and EphemerisError for a target of another kind.
    """
    begin_s, end_s = begin_utc_s - MARGIN_S, end_utc_s + MARGIN_S
    if isinstance(target, Body):
        body = BodyFacts(target.star, target.kept_parts(begin_s, end_s))
        return TargetFacts(target.name, target.provenance, target.epoch, body=body)
    if not isinstance(target, TableEphemeris):
        raise EphemerisError(f"{target.label}: neither a table nor a body")
    middle = Utc(0.5 * (begin_utc_s + end_utc_s))
    known = target.covariance(middle)
    return TargetFacts(
        target.name,
        target.provenance,
        target.epoch,
        target.catalog_number,
        target.source,
        None if known is None else known.sigma_km,
        target.t0,
        _kept_segments(target, end_utc_s, begin_s, end_s),
    )


def _segment(facts: SegmentFacts) -> Segment:
    return Segment(
        facts.zero_s,
        np.array(facts.since_s),
        np.array(facts.place_km),
        None if facts.velocity_km_s is None else np.array(facts.velocity_km_s),
        Frame(facts.frame, facts.written, facts.frame_at),
        Interpolation(facts.rows, facts.hermite),
        facts.use_s,
    )


def _kept_segments(
    target: TableEphemeris, within_s: float, begin_s: float, end_s: float
) -> tuple[SegmentFacts, ...]:
    """Return the segments that meet one another about an instant, and what continues them at both ends."""
    span = next(
        (ends for ends in target.spans if ends[0].unix_s - 1e-3 <= within_s <= ends[1].unix_s + 1e-3), None
    )
    if span is None:
        raise EphemerisError(
            f"{target.name}: no places at {Utc(within_s).isoformat('seconds')}", source=target.source
        )
    first_s, last_s = float(span[0].unix_s), float(span[1].unix_s)
    kept = [
        _rows(one, begin_s, end_s)
        for one in target.segments
        if float(one.span[1].unix_s) > max(first_s, begin_s)
        and float(one.span[0].unix_s) < min(last_s, end_s)
    ]
    if target.segments[0].frame.kind in CARRIED:
        rest = (_rest(kept[0], 0, first_s - REST_S), _rest(kept[-1], -1, last_s + REST_S))
        return (rest[0], *kept, rest[1])
    states = target.states(EarthOrientation.installed())
    if begin_s < first_s:
        kept.insert(0, _fall(states.at(first_s, 0.0), first_s, begin_s - first_s))
    if end_s > last_s:
        kept.append(_fall(states.at(last_s, 0.0), last_s, end_s - last_s))
    return tuple(kept)


def _rows(one: Segment, begin_s: float, end_s: float) -> SegmentFacts:
    """Return the rows from which the places between two instants are interpolated."""
    begin, end = (unix_s - one.zero_s + leaps_s(unix_s) for unix_s in (begin_s, end_s))
    reach = one.interpolation.rows
    first = max(0, int(np.searchsorted(one.since_s, begin)) - reach)
    last = int(np.searchsorted(one.since_s, end)) + reach
    velocity = one.velocity_km_s if one.interpolation.with_velocities else None
    return SegmentFacts(
        one.zero_s,
        one.since_s[first:last].tolist(),
        one.place_km[first:last].tolist(),
        None if velocity is None else velocity[first:last].tolist(),
        one.frame.kind,
        one.frame.written,
        one.frame.at,
        one.interpolation.rows,
        one.interpolation.with_velocities,
        (max(one.use_s[0], begin), min(one.use_s[1], end)),
    )


def _rest(rows: SegmentFacts, end: int, to_utc_s: float) -> SegmentFacts:
    """Return a place fixed to the Earth, kept from the first or last row of a table to an instant."""
    at_s = rows.use_s[end]
    to_s = to_utc_s + float(leaps_s(to_utc_s)) - rows.zero_s
    since_s = sorted((at_s, to_s))
    place = rows.place_km[end]
    return msgspec.structs.replace(
        rows,
        since_s=since_s,
        place_km=[place, place],
        velocity_km_s=[[0.0] * 3] * 2,
        rows=2,
        use_s=(since_s[0], since_s[1]),
    )


def _fall(state: State, at_s: float, seconds: float) -> SegmentFacts:
    """Return rows of free fall about the Earth, in TEME, from a state at POSIX seconds, on or back in time.

    By Runge and Kutta's method of fourth order, a step a row.
    """
    count = max(1, math.ceil(abs(seconds) / STEP_S))
    step = seconds / count
    zero_s = math.floor(at_s) + float(leaps_s(at_s))
    rows = [np.array(state[:6])]
    for _ in range(count):
        now = rows[-1]
        one = _fallen(now)
        two = _fallen(now + 0.5 * step * one)
        three = _fallen(now + 0.5 * step * two)
        four = _fallen(now + step * three)
        rows.append(now + step / 6.0 * (one + 2.0 * two + 2.0 * three + four))
    since = at_s - math.floor(at_s) + step * np.arange(count + 1)
    order = slice(None) if step > 0.0 else slice(None, None, -1)
    table, since = np.array(rows)[order], since[order]
    return SegmentFacts(
        zero_s,
        since.tolist(),
        table[:, :3].tolist(),
        table[:, 3:].tolist(),
        "TEME",
        "TEME",
        None,
        2,
        True,
        (float(since[0]), float(since[-1])),
    )


def _fallen(state: Array) -> Array:
    """Return the derivative of place and velocity."""
    x, y, z, *velocity = state.tolist()
    return np.array([*velocity, *gravity_km_s2(x, y, z)])

"""From what a run has seen to what is known of the mount, each number with its uncertainty.

Whether the drive rates and the Slewing flag of a mount's statuses tell what its axes do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sattrack.calibration.calibrator import AXIS_WORDS, AxisName, LegHeard, Observations
from sattrack.calibration.clocks import (
    Bracket,
    ClockLine,
    RoundTrip,
    RoundTripEstimate,
    StatusPeriod,
    clock_line,
    contradiction,
    status_period,
)
from sattrack.calibration.guard import CalibrationEndedError, EndKind
from sattrack.calibration.motion import (
    AxisMotion,
    AxisResponse,
    Stretch,
    axis_motion,
    axis_response,
    steady_part,
)
from sattrack.core.angles import wrap180
from sattrack.mount.model import DTICS_S_PER_DEG_S, SIDEREAL_RATE_DEG_S, mean_sidereal_deg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sattrack.calibration.clocks import HeardStatus

RateFields = Literal["true", "meaningless"]
SlewingField = Literal["true", "quiet", "meaningless"]

MOST_OF = 0.9
RATE_WITHIN = 0.1
"""Part of the commanded rate by which a field may be off it and still tell it."""
SETTLED_SHARE = 0.5
"""The last of each motion, of which so much is taken, is steady."""


def rate_fields(seen: Observations) -> RateFields | None:
    """Return whether the drive rates follow the axes; None where no axis moved.

    They must tell the rate of a steady motion, and still tell it in the status that acknowledges a stop: the
    axis has not begun to brake then.
    """
    right = [_tells_rate(seen, leg, place) for leg in seen.legs for place in _steady(leg)]
    at_stops = [_tells_rate(seen, leg, leg.end) for leg in seen.legs]
    if not right:
        return None
    return "true" if _mostly(right) and _mostly(at_stops) else "meaningless"


def slewing_field(seen: Observations) -> SlewingField | None:
    """Return whether Slewing is up while an axis moves and down while both rest; None where no axis moved."""
    heard = seen.log.heard
    moving = [heard[place].status.slewing for leg in seen.legs for place in _steady(leg)]
    resting = [not heard[leg.first - 1].status.slewing for leg in seen.legs]
    if not moving:
        return None
    if not (_mostly(moving) and _mostly(resting)):
        return "meaningless"
    return "true" if _mostly([heard[leg.end].status.slewing for leg in seen.legs]) else "quiet"


def _mostly(ones: Sequence[bool]) -> bool:
    return sum(ones) >= MOST_OF * len(ones)


def _steady(leg: LegHeard) -> range:
    return range(leg.end - int(SETTLED_SHARE * (leg.end - leg.first)), leg.end)


def _tells_rate(seen: Observations, leg: LegHeard, place: int) -> bool:
    """Tell whether a status has the rate of the axis over the statuses before it."""
    heard: list[HeardStatus] = seen.log.heard
    status = heard[place].status
    before, here = heard[place - 4], heard[place]
    seconds = here.mount_s - before.mount_s
    if leg.axis == "dec":
        reported, moved = status.dec_rate_dtics_s, here.dec_deg - before.dec_deg
    else:
        reported, moved = status.ra_rate_dtics_s, here.hour_angle_deg - before.hour_angle_deg
    within = max(RATE_WITHIN * abs(leg.rate_deg_s), 0.5 * SIDEREAL_RATE_DEG_S)
    # Beyond the pole, and by a convention of the mount's own, an axis' rate may have the other sign.
    return abs(abs(reported) / DTICS_S_PER_DEG_S - abs(moved) / seconds) < within


FEWEST_BRACKETS = 10
PLAUSIBLE_GAIN = 0.03
"""How far from 1 the gain of an axis may be before it is reported."""
DOUBTFUL_GAIN = (
    "WARNING: the {axis} axis moves {gain:.4f}° for each degree commanded: is it an equatorial mount, "
    "and are its gear ratio or steps a turn set right?"
)
OTHER_AXIS_MOST = 0.1
"""What one axis may move of the other, degrees on the sky for one: of an equatorial mount set up badly."""

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ClockTruth:
    """What the operator states of the mount's clock: true to so many seconds, by one of these readings.

    `readings` says by how many seconds each kind of true clock is ahead of mean sidereal time with UT1 = UTC.
    """

    uncertainty_s: float
    readings: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class MeasuredDelays:
    """What is known of the two ways and of the mount's clock, seconds; intervals are (lowest, highest)."""

    round_trip: RoundTrip
    command_s: Interval
    status_s: Interval
    clock_offset_s: Interval
    """Mount's clock, as UTC by mean sidereal time at the site, less ours, at the end of the run."""
    best_command_s: float
    best_status_s: float
    """Of the fastest status, as the tracker wants it; the middle of what is possible."""
    clock_reading: str | None = None
    """Which kind of true clock the mount has, where the operator states that it is true."""
    clock_reading_s: float | None = None


@dataclass(frozen=True, slots=True)
class Findings:
    """Everything a run found out. `notes` are what the operator should know besides."""

    utc_s: float
    """The instant of the last status."""
    beyond_pole: bool
    ra: AxisResponse
    dec: AxisResponse
    ra_motion: AxisMotion
    dec_motion: AxisMotion
    rate_fields: RateFields | None
    slewing_field: SlewingField | None
    additive: bool
    move_axis: Literal["held", "edge"]
    zero_ends: bool | None
    delays: MeasuredDelays
    clock: ClockLine
    period: StatusPeriod
    readings: Mapping[str, str]
    statuses: int
    lost: int
    seconds: float
    notes: tuple[str, ...]


def conclude(seen: Observations, longitude_deg: float, truth: ClockTruth | None = None) -> Findings:
    """Return what a run found out at a site; raises CalibrationEndedError where it contradicts itself."""
    heard = seen.log.heard
    line = clock_line(heard)
    _refuse(line.objection())
    _refuse_readings(seen)
    trip = round_trip(seen, line)
    _refuse_other_axes(seen)
    ra, dec = (_response(seen, axis, line) for axis in ("ra", "dec"))
    additive = ra.additive
    if additive is None:
        part = ra.added_deg_s / SIDEREAL_RATE_DEG_S
        raise CalibrationEndedError(
            EndKind.DOUBT,
            f"in right ascension MoveAxis adds {part:.2f} of the sidereal rate: neither all nor none",
        )
    move_axis, zero_ends = _semantics(seen)
    notes: list[str] = []
    delays = split_delays(trip, heard[-1], line, longitude_deg, truth, notes)
    for axis, gain in (("right ascension", ra.gain), ("declination", dec.gain)):
        if abs(gain - 1.0) > PLAUSIBLE_GAIN:
            notes.append(DOUBTFUL_GAIN.format(axis=axis, gain=gain))
    if heard[-1].status.does_refraction:
        notes.append("the mount applies refraction itself: gains are those of refracted coordinates")
    return Findings(
        utc_s=heard[-1].arrival_utc_s,
        beyond_pole=heard[-1].status.side_of_pier,
        ra=ra,
        dec=dec,
        ra_motion=axis_motion(seen, "ra", line, ra, trip.fastest_s),
        dec_motion=axis_motion(seen, "dec", line, dec, trip.fastest_s),
        rate_fields=rate_fields(seen),
        slewing_field=slewing_field(seen),
        additive=additive,
        move_axis=move_axis,
        zero_ends=zero_ends,
        delays=delays,
        clock=line,
        period=status_period(heard),
        readings=dict(seen.log.readings),
        statuses=len(heard),
        lost=heard[-1].counter - heard[0].counter + 1 - len(heard),
        seconds=heard[-1].arrival_utc_s - heard[0].arrival_utc_s,
        notes=tuple(notes),
    )


def _refuse(words: str | None) -> None:
    if words is not None:
        raise CalibrationEndedError(EndKind.DOUBT, words)


def _refuse_readings(seen: Observations) -> None:
    if seen.log.contradictory:
        _refuse(
            f"the status field {min(seen.log.contradictory)} came as an integer and as a double: "
            "two mounts send here"
        )


def dated_by_requests(seen: Observations) -> ClockTruth | None:
    """Return what is known of a clock that says the middle of each request, on our own clock.

    It cannot tell which part of the round trip is the way there. None where too little was heard.
    """
    if len(seen.log.heard) < FEWEST_BRACKETS:
        return None
    trip = round_trip(seen, clock_line(seen.log.heard))
    return ClockTruth(0.5 * trip.seconds, {"the middle of each request": 0.0})


def round_trip(seen: Observations, line: ClockLine) -> RoundTrip:
    """Return the round trip from all flags that were raised and lowered. Raises CalibrationEndedError."""
    heard = seen.log.heard
    estimate = RoundTripEstimate()
    for edge in seen.edges:
        above, within = (float(line.arrival_at(heard[i].mount_s)) for i in (edge.before, edge.after))
        estimate.add(Bracket(above - edge.sent_utc_s, within - edge.sent_utc_s))
    # The brackets are those of the fastest statuses; a typical one takes longer by the mean lateness.
    trip = estimate.result()
    trip = replace(trip, seconds=trip.fastest_s + line.jitter_s)
    if trip.brackets < FEWEST_BRACKETS:
        _refuse(f"only {trip.brackets} acknowledgements could be timed: too many datagrams are lost")
    _refuse(contradiction(trip))
    return trip


def _semantics(seen: Observations) -> tuple[Literal["held", "edge"], bool | None]:
    kinds: dict[str, AxisName] = {}
    zero_ends: bool | None = None
    for one in seen.semantics:
        kind = {(True, False): "held", (False, True): "edge"}.get((bool(one.follows), one.goes_on))
        if kind is None or one.follows is None:
            _refuse(
                f"MoveAxis in {AXIS_WORDS[one.axis]} is neither held nor edge: {one.first_deg_s:+.3f} °/s at "
                f"first, {one.second_deg_s:+.3f} after a new rate, {one.after_deg_s:+.3f} with the flag down"
            )
        kinds[kind or ""] = one.axis
        if one.zero_ends is not None:
            zero_ends = one.zero_ends and zero_ends is not False
    if len(kinds) != 1:
        _refuse("the two axes do not agree on whether MoveAxis is held or edge")
    return ("held" if "held" in kinds else "edge"), zero_ends


def _refuse_other_axes(seen: Observations) -> None:
    """Refuse a mount of which one axis moves what is reported of both: it is no equatorial one."""
    for leg in seen.legs:
        first, last = seen.log.heard[leg.first], seen.log.heard[leg.end - 1]
        sky_deg = SIDEREAL_RATE_DEG_S * (last.mount_s - first.mount_s)
        turned_deg = last.hour_angle_deg - first.hour_angle_deg
        moved_deg = {
            # What moves in hour angle may be the axis or the sky.
            # A pole that is off moves it the more the nearer it is.
            "ra": min(abs(turned_deg), abs(turned_deg - sky_deg)) * math.cos(math.radians(last.dec_deg)) ** 2,
            "dec": abs(last.dec_deg - first.dec_deg),
        }
        other: AxisName = "dec" if leg.axis == "ra" else "ra"
        told_deg = abs(leg.rate_deg_s) * (last.mount_s - first.mount_s)
        if moved_deg[other] > OTHER_AXIS_MOST * told_deg + sky_deg:
            _refuse(
                f"MoveAxis in {AXIS_WORDS[leg.axis]} moves the {AXIS_WORDS[other]} as well, "
                f"{moved_deg[other] / told_deg:.2f}° for each degree: is it an alt-azimuth mount? Only "
                "equatorial ones can be driven"
            )


def _response(seen: Observations, axis: AxisName, line: ClockLine) -> AxisResponse:
    parts = [steady_part(_stretch(leg, seen.log.heard, line)) for leg in seen.legs if leg.axis == axis]
    response = axis_response([p for p in parts if p is not None])
    if response is None:
        raise CalibrationEndedError(
            EndKind.DOUBT,
            f"the {AXIS_WORDS[axis]} axis did not move steadily: does it slip, or accelerate very slowly?",
        )
    return response


def _stretch(leg: LegHeard, heard: list[HeardStatus], line: ClockLine) -> Stretch:
    during = heard[leg.first : leg.end]
    # Our instants, less the first, so that no digit is lost in the fit.
    seconds = line.arrival_at(np.array([h.mount_s for h in during]))
    angles = np.array([h.dec_deg if leg.axis == "dec" else h.hour_angle_deg for h in during])
    return Stretch(leg.rate_deg_s, seconds - seconds[0], angles)


def split_delays(
    trip: RoundTrip,
    last: HeardStatus,
    line: ClockLine,
    longitude_deg: float,
    truth: ClockTruth | None,
    notes: list[str],
) -> MeasuredDelays:
    """Return what is known of the two ways; without a true clock that is an interval as wide as both."""
    most = trip.seconds + trip.margin_s
    arrival = float(line.arrival_at(last.mount_s))
    true_deg = mean_sidereal_deg(arrival, longitude_deg)
    # As if the status had taken no time at all; each second that it took, the clock is ahead by as much.
    ahead = wrap180(last.status.sidereal_h * 15.0 - true_deg) / SIDEREAL_RATE_DEG_S
    offset = (ahead - trip.margin_s, ahead + trip.fastest_s + trip.margin_s)
    unknown = MeasuredDelays(
        trip, (0.0, most), (0.0, most), offset, trip.fastest_s / 2.0, trip.fastest_s / 2.0
    )
    if truth is None:
        return unknown
    slack = truth.uncertainty_s + trip.margin_s
    fitting = {
        name: reading - ahead
        for name, reading in truth.readings.items()
        if -slack <= reading - ahead <= trip.fastest_s + slack
    }
    if not fitting:
        notes.append(
            f"the mount's clock is not true to {truth.uncertainty_s:g} s: by any kind of sidereal time it is "
            f"off by {min((ahead - r for r in truth.readings.values()), key=abs):+.3f} s or more; "
            "what was stated of it is left out"
        )
        return unknown
    # These are of the fastest statuses; a typical one takes longer by its mean lateness.
    least_s = max(0.0, min(fitting.values()) - slack)
    most_s = min(most, max(fitting.values()) + slack + line.jitter_s)
    command = (max(0.0, trip.fastest_s - max(fitting.values()) - slack), min(most, most - least_s))
    best_s = min(trip.fastest_s, max(0.0, 0.5 * (min(fitting.values()) + max(fitting.values()))))
    one = next(iter(fitting)) if len(fitting) == 1 else None
    if one is None:
        notes.append("the mount's clock fits " + " and ".join(fitting) + ": the intervals hold both")
    offsets = [truth.readings[name] for name in fitting]
    return MeasuredDelays(
        trip,
        command,
        (least_s, most_s),
        (min(offsets) - truth.uncertainty_s, max(offsets) + truth.uncertainty_s),
        trip.fastest_s - best_s,
        best_s,
        one,
        None if one is None else truth.readings[one],
    )

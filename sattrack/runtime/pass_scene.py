"""A pass beforehand: its chart, the error to expect, what limits take, what an uncalibrated mount costs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sattrack.core import local_time
from sattrack.core.angles import altitude_deg, azimuth_deg
from sattrack.planning.budget import PROBE_S, Circumstances, error_budget
from sattrack.planning.kinematics import ability_at, verdict_over
from sattrack.planning.rehearsal import uncalibrated_text
from sattrack.runtime.facts import SEARCH_HOURS, build_engine, first_bias
from sattrack.runtime.mounts import SIMULATED
from sattrack.safety.bodies import moon_over, sun_over
from sattrack.views.run import PassView, PathPoint, SkyPoint
from tle.bias import Bias
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from sattrack.control.engine import RunSpec
    from sattrack.planning.kinematics import PredictedLoss
    from sattrack.runtime.facts import RunFacts
    from sattrack.safety.bodies import Wanderer
    from tle.site import Site

    Array = NDArray[np.float64]

PATH_POINTS = 121
BODY_STEP_S = 600.0
MOST_BODY_POINTS = 97
SERVO_ARCSEC = 0.1
"""What following adds to the error to expect: nothing beside the elements, and nothing was rehearsed."""

LEAST_LOST_S, LEAST_LOST_SHARE = 4.0, 0.02
"""Less is lost where any pass begins and ends, and is not worth a word."""
LOW_DEG = 30.0
"""Higher up nothing rises or sets: what begins or ends there is a window in time."""


def pass_scene(facts: RunFacts, clock_error_s: float | None = None) -> PassView:
    """Return the chart of a pass beforehand; `clock_error_s` is that of this machine's clock, one sigma.

    Raises PropagationError or TimeRangeError where the path itself cannot be computed.
    """
    spec = build_engine(facts).spec
    plan, limits, site = facts.plan, facts.limits, spec.propagator.site
    utc_s = np.linspace(plan.start_utc_s, plan.end_utc_s, PATH_POINTS)
    seen = spec.propagator.at(Utc(utc_s))
    later = spec.propagator.at(Utc(utc_s), Bias(PROBE_S, 0.0))
    along_deg_s = np.degrees(np.linalg.norm(later.unit - seen.unit, axis=1)) / PROBE_S
    columns = (utc_s, seen.alt_deg, seen.az_deg, along_deg_s)
    rows = np.column_stack(columns)
    along, across = _expected_arcsec(facts, spec, clock_error_s)
    profile, dec_deg = facts.profile, seen.dec_deg
    if profile.frame is not None:
        dec_deg = profile.frame.angles(seen.ha_deg, dec_deg, fn=np).second_deg
    geometry = profile.geometry
    lost = _foretold_losses(facts, spec)
    worst = max(lost, key=lambda one: one.seconds, default=None)
    return PassView(
        latitude_deg=site.latitude_deg,
        longitude_deg=site.longitude_deg,
        path=tuple(PathPoint(*row) for row in _rounded(rows[np.all(np.isfinite(rows), axis=1)])),
        rises=plan.start_utc_s > facts.started_utc_s and _low(seen.alt_deg[0]),
        sets=plan.end_utc_s < facts.started_utc_s + SEARCH_HOURS * 3600.0 - 1.0 and _low(seen.alt_deg[-1]),
        culminate_utc_s=facts.culminate_utc_s,
        sun=_way(sun_over(site.latitude_deg, site.longitude_deg), plan.start_utc_s, plan.end_utc_s, site),
        moon=_way(moon_over(site.latitude_deg, site.longitude_deg), plan.start_utc_s, plan.end_utc_s, site),
        sun_cone_deg=limits.sun_deg,
        moon_cone_deg=limits.moon_cone_deg,
        floor_altitude_deg=limits.floor_altitude_deg,
        horizon=limits.horizon,
        keyhole_deg=keyhole_deg(dec_deg, seen.unit_rate, profile.ra.max_rate_deg_s),
        command_delay_s=facts.profile.command_delay_s,
        delays_measured=facts.profile.calibration is not None,
        along_arcsec=along,
        across_arcsec=across,
        fov_deg=facts.fov_deg,
        can_park=facts.profile.park is not None,
        mount_pole_deg=None if geometry is None else (geometry.pole_altitude_deg, geometry.pole_azimuth_deg),
        lost_s=round(sum(one.seconds for one in lost), 1),
        lost_to=None if worst is None else worst.limit,
        lost_from_utc_s=None if worst is None else worst.begin_utc_s,
    )


def fastest_deg_s(facts: RunFacts) -> float:
    """Return the largest speed of the satellite on the sky over a pass, degrees a second."""
    spec = build_engine(facts).spec
    utc_s = np.linspace(facts.plan.start_utc_s, facts.plan.end_utc_s, PATH_POINTS)
    return float(np.degrees(np.nanmax(np.linalg.norm(spec.propagator.at(Utc(utc_s)).unit_rate, axis=1))))


def uncalibrated(facts: RunFacts) -> str | None:
    """Return what a mount that was not calibrated costs at this pass.

    None for one that was, and for the simulated mount: its axes are made from the very profile.
    """
    if facts.profile.calibration is not None or facts.mount_name == SIMULATED:
        return None
    return uncalibrated_text(facts.profile, fastest_deg_s(facts))


def _foretold_losses(facts: RunFacts, spec: RunSpec) -> tuple[PredictedLoss, ...]:
    """Return what of a pass the mount will lose; nothing where that is little, or is not known."""
    span = facts.plan.start_utc_s, facts.plan.end_utc_s
    ability = ability_at(spec.propagator.site, facts.profile, facts.limits)
    try:
        lost = verdict_over(spec.propagator, first_bias(facts), span, ability).lost
    except TleError:
        return ()
    least_s = max(LEAST_LOST_S, LEAST_LOST_SHARE * (span[1] - span[0]))
    return lost if sum(one.seconds for one in lost) > least_s else ()


def foretold(facts: RunFacts) -> str | None:
    """Return what of a pass the mount will lose, in words; None where that is little, or is not known."""
    lost = _foretold_losses(facts, build_engine(facts).spec)
    if not lost:
        return None
    worst = max(lost, key=lambda one: one.seconds)
    since = local_time.clock(worst.begin_utc_s)
    return (
        f"about {sum(one.seconds for one in lost):.0f} s of the pass will be lost, most from {since} on: "
        f"{worst.limit}: {worst.words}; `sattrack rehearse` shows it"
    )


def _low(alt_deg: float) -> bool:
    return bool(alt_deg < LOW_DEG)


def keyhole_deg(dec_deg: Array, unit_rate: Array, max_rate_deg_s: float) -> float | None:
    """Return the distance from the pole within which the first axis is too slow for a satellite, degrees.

    At a distance p it passes a pole with the hour angle turning by v / sin p, v the speed on the sky where it
    is nearest (`unit_rate`, radians a second, shape (n, 3)). None where it is too fast everywhere.
    """
    good = np.flatnonzero(np.isfinite(dec_deg))
    if not len(good):
        return None
    nearest = good[int(np.argmax(np.abs(dec_deg[good])))]
    share = math.degrees(float(np.linalg.norm(unit_rate[nearest]))) / max_rate_deg_s
    return math.degrees(math.asin(share)) if share < 1.0 else None


def _expected_arcsec(
    facts: RunFacts, spec: RunSpec, clock_error_s: float | None
) -> tuple[float, float] | tuple[None, None]:
    circumstances = Circumstances(
        clock_error_s, SERVO_ARCSEC, SERVO_ARCSEC, "not rehearsed", facts.refraction != "off", facts.fov_deg
    )
    span = (facts.plan.start_utc_s, facts.plan.end_utc_s)
    try:
        budget = error_budget(spec.propagator, first_bias(facts), span, facts.profile, circumstances)
    except (TleError, ValueError):
        # Where some of it is not known, nothing is shown: the run itself does not depend on it.
        return None, None
    return budget.along_arcsec, budget.across_arcsec


def _way(body: Wanderer, begin_utc_s: float, end_utc_s: float, site: Site) -> tuple[SkyPoint, ...]:
    count = min(MOST_BODY_POINTS, 2 + int((end_utc_s - begin_utc_s) / BODY_STEP_S))
    points = []
    for utc_s in np.linspace(begin_utc_s, end_utc_s, count).tolist():
        at = body.at(utc_s)
        place = at.hour_angle_deg, at.dec_deg, site.latitude_deg
        points.append((utc_s, altitude_deg(*place), azimuth_deg(*place)))
    return tuple(SkyPoint(*row) for row in _rounded(points))


def _rounded(rows: Iterable[Iterable[float]]) -> list[list[float]]:
    """Return rows as plain numbers of three decimals: finer than any chart, and short on the pipe."""
    return [[round(float(x), 3) for x in row] for row in rows]

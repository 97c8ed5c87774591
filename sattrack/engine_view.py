"""What a run looks like to anyone who looks: its view, and what it warns of. Nothing of the run changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.bias_view import (
    bias_fields,
    estimate_view,
    observation_warnings,
    offset_views,
    search_view,
)
from sattrack.control.kalman import wrap180
from sattrack.mount import SIDEREAL_RATE_DEG_S, mean_sidereal_deg
from sattrack.safety import ROWS
from sattrack.tracker import FOLLOWING, Phase
from sattrack.view import PauseView, TrackView
from sattrack.xerxes.link import STALE_AFTER_S, LinkState
from sattrack.xerxes.link_view import link_view

if TYPE_CHECKING:
    from sattrack.engine import Engine
    from sattrack.mount import StatusSample
    from sattrack.view import ErrorView, LinkView

HOLDING = "holding"
"""The phase in which a limit keeps the mount off its target."""
LOST_TOLD_S = 10.0
"""For how long it is told that the mount was lost."""
SITE_TOLERANCE_DEG = 0.1


def view_of(engine: Engine, now_utc_s: float) -> TrackView:
    """Return what anyone who looks may see of a run, as of an instant (UTC, POSIX seconds)."""
    spec, tracker, sample = engine.spec, engine.tracker, engine.session.sample
    error = tracker.error
    fresh = error is not None and 0.0 <= now_utc_s - error.utc_s < STALE_AFTER_S
    # Target and mount are shown for one instant: a tick apart they would seem to disagree.
    target = tracker.direction_at(error.utc_s if error is not None and fresh else now_utc_s)
    return TrackView(
        utc_s=now_utc_s,
        phase=engine.phase,
        name=spec.propagator.elements.label,
        catalog_number=spec.propagator.elements.catalog_number,
        mount=spec.mount_name,
        start_utc_s=spec.plan.start_utc_s,
        culminate_utc_s=spec.culminate_utc_s,
        end_utc_s=spec.plan.end_utc_s,
        max_alt_deg=spec.max_alt_deg,
        elements_age_s=now_utc_s - float(spec.propagator.elements.epoch.unix_s),
        target_ra_deg=float(target.ra_deg),
        target_dec_deg=float(target.dec_deg),
        target_alt_deg=float(target.alt_deg),
        target_az_deg=float(target.az_deg),
        range_km=float(target.range_km),
        mount_ra_deg=None if sample is None else sample.ra_deg,
        mount_dec_deg=None if sample is None else sample.dec_deg,
        error=error,
        rms_10s_arcsec=engine.rms_10s_arcsec,
        rms_pass_arcsec=engine.reported.rms_arcsec,
        ra_rate_deg_s=tracker.rates.ra_rate_deg_s,
        dec_rate_deg_s=tracker.rates.dec_rate_deg_s,
        max_ra_rate_deg_s=spec.profile.ra.max_rate_deg_s,
        max_dec_rate_deg_s=spec.profile.dec.max_rate_deg_s,
        **bias_fields(tracker, now_utc_s),
        offsets=offset_views(tracker, now_utc_s),
        search=search_view(tracker, now_utc_s),
        estimate=estimate_view(tracker, now_utc_s, engine.malformed + engine.dropped),
        remembered=tracker.steering.remembered,
        link=_link_view(engine, now_utc_s),
        recording=spec.recording,
        ended_by=tracker.ended_by,
        warnings=_warnings(engine),
        ra_rate_reached_deg_s=None if sample is None else SIDEREAL_RATE_DEG_S - sample.ra_drive_deg_s,
        dec_rate_reached_deg_s=None if sample is None else _reported_dec_rate_deg_s(sample),
        pause=_pause_view(engine),
    )


def _link_view(engine: Engine, now_utc_s: float) -> LinkView:
    sample, error, health = engine.session.sample, engine.tracker.error, engine.session.health
    delay_ms = clock_offset_s = None
    if sample is not None and error is not None:
        delay_ms = 1000.0 * (sample.arrival_utc_s - error.utc_s)
        clock_offset_s = _clock_offset_s(engine, sample, error)
    age_s = None if sample is None else now_utc_s - sample.arrival_utc_s
    return link_view(health, engine.link_state, age_s, delay_ms, clock_offset_s)


def _clock_offset_s(engine: Engine, sample: StatusSample, error: ErrorView) -> float:
    """Return how far the mount's sidereal clock is ahead of mean sidereal time by our UTC, seconds."""
    mean_deg = mean_sidereal_deg(error.utc_s, engine.spec.propagator.site.longitude_deg)
    return wrap180(sample.sidereal_h * 15.0 - mean_deg) / SIDEREAL_RATE_DEG_S


def _reported_dec_rate_deg_s(sample: StatusSample) -> float:
    """Return the declination drive's rate as one of the reported declination, which turns past the pole."""
    return -sample.dec_drive_deg_s if sample.beyond_pole else sample.dec_drive_deg_s


def _pause_view(engine: Engine) -> PauseView | None:
    rest = engine.tracker.rest
    if rest is None:
        return None
    at_rest = rest.at_rest and not engine.led_out
    return PauseView(rest.begun_utc_s, at_rest, rest.jogging, rest.going_on)


def _warnings(engine: Engine) -> tuple[str, ...]:
    tracker, session = engine.tracker, engine.session
    warnings = []
    if engine.link_state is LinkState.STALE:
        warnings.append("no fresh status from the mount: following by prediction")
    warnings.extend(_held_warnings(engine))
    if engine.safety.clamping and tracker.phase in FOLLOWING:
        warnings.append("the mount's rate limit is reached")
    if tracker.phase is Phase.STOPPING and not engine.finished and not session.stopped:
        warnings.append("the stop is not confirmed yet: it is being sent again and again")
    if tracker.steering.refusal is not None:
        warnings.append(tracker.steering.refusal)
    warnings.extend(observation_warnings(tracker, engine.malformed, engine.dropped))
    if session.intruder is not None:
        warnings.append(session.intruder)
    warnings.extend(_clock_warnings(engine))
    heard_utc_s = 0.0 if session.sample is None else session.sample.arrival_utc_s
    if tracker.lost_utc_s is not None and heard_utc_s - tracker.lost_utc_s < LOST_TOLD_S:
        warnings.append("the mount was not where its commands lead: lost, and taken up where it is")
    warnings.extend(_side_warnings(engine))
    warnings.extend(_site_warnings(engine))
    if engine.message:
        warnings.append(engine.message)
    return tuple(warnings)


def _held_warnings(engine: Engine) -> list[str]:
    """Say at which limit safety holds the mount, or that it moves one that rests."""
    paused, name = engine.tracker.rest is not None, engine.safety.holding
    if engine.led_out:
        return ["the telescope is led out of the Sun's or the Moon's way"]
    if name is None or not (paused or engine.phase == HOLDING):
        return []
    then = "it goes on when the satellite comes back"
    if paused:
        then = "the paused mount goes no farther"
    return [f"held at the {ROWS[name].name} limit ({ROWS[name].bound}): {then}"]


def _clock_warnings(engine: Engine) -> list[str]:
    """Say where the mount's clock is not one to date its samples by."""
    tracker, warnings = engine.tracker, []
    if not tracker.clock_holds:
        warnings.append("the mount's clock is not where the profile says: samples are dated by arrival")
    elif not tracker.clock_runs:
        warnings.append("the mount's clock does not run as ours: samples are dated by arrival")
    if tracker.clock_step_s is not None:
        step_ms = 1000.0 * tracker.clock_step_s
        warnings.append(f"the mount's clock goes in steps of {step_ms:.1f} ms: samples are dated by its mean")
    return warnings


def _side_warnings(engine: Engine) -> list[str]:
    """Say that the mount is on a side of the pier for which its signs were never measured."""
    status, record = engine.session.status, engine.spec.profile.calibration
    if status is None or record is None:
        return []
    beyond = status.side_of_pier
    measured = record.both_sides or (record.side_of_pier == "beyond_pole") == beyond
    words = "this side of the pier is not in the mount's profile: its rates may go the other way"
    return [] if measured else [words]


def _site_warnings(engine: Engine) -> list[str]:
    """Say where the mount believes it stands, if that is somewhere else."""
    status, site = engine.session.status, engine.spec.propagator.site
    if status is None or (status.site_latitude_deg == 0.0 and status.site_longitude_deg == 0.0):
        return []
    apart = (
        abs(status.site_latitude_deg - site.latitude_deg),
        abs(wrap180(status.site_longitude_deg - site.longitude_deg)),
    )
    if max(apart) < SITE_TOLERANCE_DEG:
        return []
    where = f"{status.site_latitude_deg:.2f}, {status.site_longitude_deg:.2f}"
    return [f"the mount believes it stands at {where}: check the site on both sides"]

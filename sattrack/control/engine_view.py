"""What a run looks like to anyone who looks: its view, and what it warns of. Nothing of the run changes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypedDict

from sattrack.control.driver import site_warnings
from sattrack.control.engine import HOLDING, learnt_view
from sattrack.control.estimate import LOST_AFTER_S
from sattrack.control.following import FREE_REST_DEG_S
from sattrack.control.tracker import FOLLOWING, Phase
from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, mean_sidereal_deg
from sattrack.mount.xerxes.link import STALE_AFTER_S, LinkState
from sattrack.safety import ROWS
from sattrack.views.formatting import camera_clock_text, counted, times_text
from sattrack.views.run import (
    EstimateView,
    LoopView,
    OffsetView,
    PauseView,
    SearchView,
    TrackView,
    TwoAxesView,
)
from tle.bodies import Body
from tle.elements import Elements
from tle.ephemeris import TableEphemeris, expected_error_m
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.control.engine import Engine
    from sattrack.control.tracker import Tracker
    from sattrack.mount.model import LinkView, StatusSample
    from sattrack.views.run import ErrorView
    from tle.ephemeris import Ephemeris

LOST_SHOWN_S = 10.0
"""For how long a warning says that the mount was lost."""
DRIFT_TOLERANCE_DEG_S, DRIFT_SIGMA_DEG_S = 2.0 / 3600.0, 4.0 / 3600.0
"""How near to the sidereal rate a drift in right ascension must be, and how surely, to be taken for it."""
LOOSE_FACTOR = 2.0
"""How many times slower than at its tightest the loop may be run before a warning says so."""


def view_of(engine: Engine, now_utc_s: float) -> TrackView:
    """Return what anyone who looks may see of a run, as of an instant (UTC, POSIX seconds)."""
    spec, tracker, sample = engine.spec, engine.tracker, engine.sample
    followed, now_followed = spec.propagator.elements, tracker.steering.biases.course.propagator.elements
    error = tracker.error
    fresh = error is not None and 0.0 <= now_utc_s - error.utc_s < STALE_AFTER_S
    # Target and mount are shown for one instant: a tick apart they would seem to disagree.
    target = tracker.direction_at(error.utc_s if error is not None and fresh else now_utc_s)
    place = engine.pointing_deg
    return TrackView(
        utc_s=now_utc_s,
        phase=engine.phase,
        name=followed.label,
        catalog_number=followed.catalog_number or None,
        mount=spec.mount_name,
        start_utc_s=tracker.plan.start_utc_s,
        culminate_utc_s=spec.culminate_utc_s + tracker.slipped_s,
        end_utc_s=tracker.plan.end_utc_s,
        max_alt_deg=spec.max_alt_deg,
        elements_age_s=None if isinstance(followed, Body) else now_utc_s - float(now_followed.epoch.unix_s),
        target_ra_deg=float(target.ra_deg),
        target_dec_deg=float(target.dec_deg),
        target_alt_deg=float(target.alt_deg),
        target_az_deg=float(target.az_deg),
        range_km=float(target.range_km) if followed.ranged else None,
        mount_ra_deg=None if place is None else place[0],
        mount_dec_deg=None if place is None else place[1],
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
        calibrated=spec.profile.calibration is not None,
        learnt=learnt_view(engine),
        stages=tuple(engine.stages),
        loop=loop_view(tracker, now_utc_s),
        t0_utc_s=tracker.t0_utc_s,
        source=followed.provenance,
        source_file=source_file(followed),
        expected_error_m=expected_error_m(followed, Utc(now_utc_s)),
        axes=_axes_view(engine),
        periodic_arcsec=tracker.periodic_arcsec(error.utc_s if error is not None and fresh else now_utc_s),
    )


def source_file(source: Elements | Ephemeris) -> str | None:
    """Return the name of what elements or an ephemeris were read from, without folders; None for none."""
    if not isinstance(source, Elements | TableEphemeris) or not source.source:
        return None
    return source.source.replace("\\", "/").rpartition("/")[2]


def _axes_view(engine: Engine) -> TwoAxesView | None:
    sample, frame = engine.sample, engine.frame
    if sample is None or frame is None:
        return None
    first_deg = math.remainder(sample.sidereal_h * 15.0 - sample.ra_deg, 360.0)
    rates = sample.ra_drive_deg_s, sample.dec_drive_deg_s
    return TwoAxesView(
        first_deg=first_deg,
        second_deg=sample.dec_deg,
        first_rate_deg_s=rates[0],
        second_rate_deg_s=rates[1],
        field_angle_deg=frame.field_angle_deg(first_deg, sample.dec_deg),
        field_rate_deg_s=frame.field_rate_deg_s(first_deg, sample.dec_deg, *rates),
    )


def _link_view(engine: Engine, now_utc_s: float) -> LinkView:
    sample, error, health = engine.session.sample, engine.tracker.error, engine.session.health
    delay_ms = clock_offset_s = None
    if sample is not None and error is not None:
        delay_ms = 1000.0 * (sample.arrival_utc_s - error.utc_s)
        clock_offset_s = _clock_offset_s(engine, sample, error)
    age_s = None if sample is None else now_utc_s - sample.arrival_utc_s
    return health.view(engine.link_state, age_s, delay_ms, clock_offset_s)


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
    if tracker.table_left:
        warnings.append(
            "the profile's periodic errors are not this mount's any more, and were left aside: it was homed "
            "or synced elsewhere; learn them anew with `sattrack report --learn-profile`"
        )
    if session.intruder is not None:
        warnings.append(session.intruder)
    warnings.extend(session.ignored_fields)
    warnings.extend(_clock_warnings(engine))
    warnings.extend(_looseness_warnings(engine))
    warnings.extend(_additive_warnings(engine))
    heard_utc_s = 0.0 if session.sample is None else session.sample.arrival_utc_s
    lost_utc_s = tracker.follower.lost_utc_s
    if lost_utc_s is not None and heard_utc_s - lost_utc_s < LOST_SHOWN_S:
        warnings.append("the mount was not where its commands lead: lost, and taken up where it is")
    warnings.extend(_side_warnings(engine))
    warnings.extend(site_warnings(engine.session.status, engine.spec.propagator.site))
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
    clock, warnings = engine.tracker.follower.clock, []
    if not clock.known_holds:
        warnings.append("the mount's clock is not where the profile says: samples are dated by arrival")
    elif not clock.trusted:
        warnings.append("the mount's clock does not run as ours: samples are dated by arrival")
    if clock.coarse_step_s is not None:
        step_ms = 1000.0 * clock.coarse_step_s
        warnings.append(f"the mount's clock goes in steps of {step_ms:.1f} ms: samples are dated by its mean")
    return warnings


def _additive_warnings(engine: Engine) -> list[str]:
    """Say that right ascension drifts by the sky's rate beside its commands."""
    line = engine.tracker.follower.learning.fits[0].line(FREE_REST_DEG_S)
    if line is None or line.rest_sigma_deg_s > DRIFT_SIGMA_DEG_S:
        return []
    additive = engine.spec.profile.additive
    drift_deg_s = SIDEREAL_RATE_DEG_S if additive else -SIDEREAL_RATE_DEG_S
    if abs(line.rest_deg_s - drift_deg_s) > DRIFT_TOLERANCE_DEG_S:
        return []
    does, so = ("replace", "false") if additive else ("add to", "true")
    return [
        f"the mount's rates in right ascension {does} sidereal tracking: set additive = {so} in the profile"
    ]


def _looseness_warnings(engine: Engine) -> list[str]:
    """Say that errors are taken out slowly, because rates act long, or the servo answers late or unknown."""
    tracker, law = engine.tracker, engine.spec.plan.law.feeder
    follower = tracker.follower
    if tracker.phase is not Phase.TRACKING:
        return []
    if follower.unanswered:
        return [
            f"the mount acknowledges no rates: each acts for {follower.acting_s:.1f} s, and errors are taken "
            "out no faster"
        ]
    known, settling_s = follower.learning.learnt(), follower.settling_s
    tightest_s = max(law.settling_s, law.intervals * follower.acting_s)
    if settling_s is None or known is None:
        return []
    if settling_s <= LOOSE_FACTOR * tightest_s:
        return []
    lag_s, sigma_s = max(one.lag_s for one in known), max(one.lag_sigma_s for one in known)
    why = f"the servo answers {1000.0 * lag_s:.0f} ms late"
    if law.lag_sigmas * sigma_s > law.lags * lag_s:
        why = f"the servo's lag is known to {1000.0 * sigma_s:.0f} ms only"
    return [
        f"{why}: an error is taken out in {settling_s:.2f} s instead of {tightest_s:.2f} s, so gusts and "
        "nudges take as much longer"
    ]


def _side_warnings(engine: Engine) -> list[str]:
    """Say that the mount is on a side of the pier that its profile does not know."""
    status, profile = engine.session.status, engine.spec.profile
    if status is None:
        return []
    beyond, record, warnings = status.side_of_pier, profile.calibration, []
    if record is not None and not record.both_sides and (record.side_of_pier == "beyond_pole") != beyond:
        warnings.append("this side of the pier is not in the mount's profile: its rates may go the other way")
    if beyond and profile.behind_gateway and profile.pier_rule == "never" and not profile.through_pole:
        warnings.append(
            'the telescope stands beyond the pole, and pier_rule in the profile is "never": for a German one '
            'set "ascom"'
        )
    return warnings


class BiasFields(TypedDict):
    """The fields of a view that say what is in force along and across the track, and what was asked for."""

    bias_along_s: float
    bias_cross_deg: float
    bias_along_goal_s: float
    bias_cross_goal_deg: float


def bias_fields(tracker: Tracker, utc_s: float) -> BiasFields:
    """Return what is in force, the search included, and what is asked for, as of an instant."""
    along, cross = tracker.steering.biases.applied(utc_s)
    along_goal_s, cross_goal_deg = tracker.steering.biases.totals(utc_s)
    return BiasFields(
        bias_along_s=along.value,
        bias_cross_deg=cross.value,
        bias_along_goal_s=along_goal_s,
        bias_cross_goal_deg=cross_goal_deg,
    )


def offset_views(tracker: Tracker, utc_s: float) -> tuple[OffsetView, ...]:
    """Return the operator's offsets that are not nothing."""
    found = []
    for what, offset in tracker.steering.biases.offsets.items():
        total, state = offset.total_at(utc_s), offset.state(utc_s)
        if total or state.value or offset.rate:
            found.append(OffsetView(what, total, state.value, offset.rate))
    return tuple(found)


def search_view(tracker: Tracker, utc_s: float) -> SearchView | None:
    """Return the search that runs, or is about to."""
    biases = tracker.steering.biases
    pattern = biases.pattern_at(utc_s) or next(
        (one for one in biases.patterns if one.begins_utc_s > utc_s and one.ends_utc_s == math.inf), None
    )
    if pattern is None:
        return None
    base = biases.along_without_search(utc_s)
    along, cross = pattern.states(utc_s, base, biases.course)
    return SearchView(pattern.how, max(0.0, utc_s - pattern.begins_utc_s), along.value, cross.value)


def estimate_view(tracker: Tracker, utc_s: float, unused: int) -> EstimateView | None:
    """Return what observations say, and the outcome; None where none have come.

    `unused` counts what came and was not even tried.
    """
    estimator = tracker.steering.estimator
    refused = estimator.refused + unused
    if not (estimator.accepted or estimator.rejected or refused):
        return None
    known = estimator.reading(utc_s, tracker.steering.biases.course)
    if known is None:
        none = (None, None, None, None)
        return EstimateView(*none, estimator.accepted, estimator.rejected, refused, estimator.last_utc_s)
    range_km = tracker.steering.biases.course.going(utc_s + known.along_s).range_km
    # Dates that were corrected are as uncertain as the correction, all of them alike.
    dates_s = max((one.sigma_s for one in tracker.steering.clocks.views() if one.corrected_s), default=0.0)
    return EstimateView(
        known.along_s,
        math.hypot(known.along_sigma_s, dates_s) if dates_s else known.along_sigma_s,
        math.degrees(math.atan(known.cross_km / range_km)),
        math.degrees(known.cross_sigma_km / range_km),
        estimator.accepted,
        estimator.rejected,
        refused,
        estimator.last_utc_s,
        60.0 * known.along_rate,
        estimator.begun_anew,
    )


def loop_view(tracker: Tracker, utc_s: float) -> LoopView | None:
    """Return what closes the loop on the sky; None where no camera is set and no observation has come."""
    steering = tracker.steering
    estimator = steering.estimator
    clocks = steering.clocks.views()
    seen = estimator.accepted or estimator.rejected or estimator.refused or steering.last_seen
    if not (steering.cameras.named or seen or clocks):
        return None
    last_s, guided, last = estimator.last_utc_s, steering.guided, steering.last_seen
    if estimator.filter is None or last_s is None:
        return LoopView("elements", guided=guided, last=last, clocks=clocks)
    state = "lost" if utc_s - last_s > LOST_AFTER_S else "camera"
    sigma_arcsec = estimator.sigma_arcsec(utc_s, steering.biases.course)
    cameras = steering.camera_views()
    return LoopView(state, max(0.0, utc_s - last_s), sigma_arcsec, cameras, guided, last, clocks)


def observation_warnings(tracker: Tracker, malformed: int, dropped: int) -> list[str]:
    """Say which observations were not taken, and why the last of them."""
    estimator = tracker.steering.estimator
    words = []
    if estimator.words is not None:
        counts = f"{estimator.rejected} rejected, {estimator.refused} refused, {estimator.accepted} taken"
        words.append(f"the last observation was not taken: {estimator.words} ({counts})")
    words.extend(estimator.camera_words)
    words.extend(
        f"camera {one.camera or 'without a name'}: {camera_clock_text(one)}"
        for one in tracker.steering.clocks.views()
        if one.corrected_s
    )
    if estimator.begun_anew:
        words.append(
            f"the estimate restarted {times_text(estimator.begun_anew)}: "
            "the rejected observations agreed with one another"
        )
    if malformed:
        words.append(f"{counted(malformed, 'line was', 'lines were')} neither messages nor observations")
    if dropped:
        words.append(f"{counted(dropped, 'observation')} came too fast to be used, and went lost")
    return words

"""What a run does at each status, acquiring, held, paused, on its way back or following; why it never
acquired. Pure.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.target import POLE_WITHIN_DEG
from sattrack.mount.model import LONGEST_STEP_S, SIDEREAL_RATE_DEG_S
from sattrack.safety import ROWS
from sattrack.views.formatting import times_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.target import TargetState
    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile
    from sattrack.views.run import LearntView

KEYHOLE, RATE = "keyhole", "rate"


class RunStage(IntEnum):
    """What a run did at a status; only FOLLOWING counts in the figures of the error."""

    OTHER = 0
    """It waited, slewed or stopped."""
    ACQUIRING = 1
    """It followed, and had never been on target yet."""
    HELD = 2
    """A limit kept it from following: one of place, or the target was faster than an axis can turn."""
    PAUSED = 3
    REJOINING = 4
    """It was on its way back to the target, after a pause or a limit."""
    FOLLOWING = 5


class Situation(NamedTuple):
    """What is known of a run at a status; `holding` names the limit of place that holds the mount."""

    following: bool
    tracking: bool
    paused: bool
    acquired: bool
    ended: bool
    holding: str | None
    error_arcsec: float


class Stages:
    """Tells of one status after the other what the run does, and which limit it is held by."""

    def __init__(self, plan: TrackPlan, profile: MountProfile) -> None:
        """Begin before the first status."""
        self._on_target_arcsec = plan.on_target_arcsec
        self._too_fast = _TooFast(plan, profile)
        self._rejoining = False

    def take(self, now: Situation, utc_s: float, target: TargetState) -> tuple[RunStage, str]:
        """Return what the run does, and the limit's name, empty for none."""
        beyond = self._too_fast.limit(utc_s, target)
        if now.paused:
            self._rejoining = now.acquired
            return RunStage.PAUSED, ""
        if now.following and now.holding is not None:
            self._rejoining = now.acquired
            return RunStage.HELD, now.holding
        off = now.error_arcsec > self._on_target_arcsec
        if self._rejoining and now.tracking:
            self._rejoining = off
        if now.following and now.acquired and beyond is not None and off:
            self._rejoining = True
            return RunStage.HELD, beyond
        if self._rejoining and not now.ended:
            return RunStage.REJOINING, ""
        if not now.following:
            return RunStage.OTHER, ""
        return (RunStage.FOLLOWING if now.acquired else RunStage.ACQUIRING), ""


class _TooFast:
    """Where the target turns an axis, or changes its rate, faster than the mount can."""

    def __init__(self, plan: TrackPlan, profile: MountProfile) -> None:
        self._detours, self._axes = plan.detours, (profile.ra, profile.dec)
        self._before: tuple[float, tuple[float, float]] | None = None

    def limit(self, utc_s: float, target: TargetState) -> str | None:
        """Return the limit's name; None where the mount is fast enough."""
        rates = SIDEREAL_RATE_DEG_S - target.ra_rate_deg_s, target.dec_rate_deg_s
        before, self._before = self._before, (utc_s, rates)
        if any(one.begin_utc_s <= utc_s <= one.end_utc_s for one in self._detours):
            return KEYHOLE
        fast = any(abs(rate) > axis.max_rate_deg_s for rate, axis in zip(rates, self._axes, strict=True))
        if before is not None and 0.0 < utc_s - before[0] < LONGEST_STEP_S:
            fast |= any(
                abs(rate - was) > axis.max_acceleration_deg_s2 * (utc_s - before[0])
                for rate, was, axis in zip(rates, before[1], self._axes, strict=True)
            )
        if not fast:
            return None
        return KEYHOLE if abs(abs(target.dec_deg) - 90.0) < POLE_WITHIN_DEG else RATE


LEAST_FOLLOWED_S = 2.0
"""A mount that followed for less than this had no time to get there, and tells little of itself."""
MOSTLY = 0.3
"""Share of the time for which a limit must have been in the way to be the reason."""
LATE_S, SOONER_S = 0.15, 0.025
"""How much later, or sooner, than the profile says an answer must come to be the reason."""
STILL, TURNED, OFF = 0.1, -0.5, 0.05
"""Motion over commanded motion of an axis that stands still, or turns; and how far off a gain is."""
FALLS_SHORT, MOVES_DEG_S = 0.8, 0.02
RESTARTS = 3
STOPPED = "the operator ended the run before the mount could follow"


def measuring(profile: MountProfile) -> str:
    """Return in words how delays and gains of a mount are measured."""
    if profile.geometry is not None:
        return "let `sattrack track --learn-profile FILE` learn the mount in a pass"
    return "run `sattrack mount calibrate`"


class AxisAttempt(NamedTuple):
    """What was seen of one axis: motion over commanded motion, fastest rates, and the typical error."""

    name: str
    field: str
    """How the profile's fields begin."""
    ratio: float | None = None
    fastest_deg_s: float = 0.0
    fastest_asked_deg_s: float = 0.0
    typical_arcsec: float | None = None


class Attempt(NamedTuple):
    """What was seen of a run that was never on target; times in seconds."""

    profile: MountProfile
    ra: AxisAttempt
    dec: AxisAttempt
    heard: bool = True
    stopped: bool = False
    """Whether an operator ended the run."""
    slewing: bool = False
    followed_s: float = 0.0
    clamped_s: float = 0.0
    held_s: dict[str, float] = {}  # noqa: RUF012 - never changed
    learnt: LearntView | None = None
    later_s: float | None = None
    """By how much later than the profile says the axes answered, by their rates alone; None for unknown."""
    calibrated: bool = True

    @property
    def axes(self) -> tuple[AxisAttempt, AxisAttempt]:
        """Right ascension and declination."""
        return self.ra, self.dec

    @property
    def measure(self) -> str:
        """How the mount is measured, in words."""
        return measuring(self.profile)


def why_not(attempt: Attempt) -> str | None:
    """Return why, and what to do, in one line; None where nothing that was seen tells it."""
    found = next((words for reason in REASONS if (words := reason(attempt)) is not None), None)
    if (
        found is None
        or found == STOPPED
        or attempt.calibrated
        or attempt.measure in found
        or not attempt.heard
    ):
        return found
    return f"{found} (the mount is not calibrated: {attempt.measure})"


def unheard(attempt: Attempt) -> str | None:
    """The mount was never heard."""
    return None if attempt.heard else "the mount was never heard: see to its power, its cable and its address"


def held(attempt: Attempt) -> str | None:
    """A limit kept the mount off its target."""
    if not attempt.held_s:
        return None
    name = max(attempt.held_s, key=lambda one: attempt.held_s[one])
    if attempt.held_s[name] < MOSTLY * (attempt.followed_s + sum(attempt.held_s.values())):
        return None
    return (
        f"the {ROWS[name].name} limit held it for {attempt.held_s[name]:.0f} s ({ROWS[name].bound} sets it): "
        "`sattrack rehearse` shows that beforehand"
    )


def stopped(attempt: Attempt) -> str | None:
    """An operator ended the run before the mount could follow: no other reason counts, and no advice."""
    early = attempt.slewing or attempt.followed_s < LEAST_FOLLOWED_S
    return STOPPED if attempt.stopped and early else None


def slewing(attempt: Attempt) -> str | None:
    """The mount was still on its way."""
    if not attempt.slewing:
        return None
    return "the mount was still slewing to where it could follow: start earlier, or choose a longer pass"


def too_fast(attempt: Attempt) -> str | None:
    """The target was faster than the axes may turn."""
    if attempt.clamped_s <= MOSTLY * attempt.followed_s:
        return None
    ra, dec = attempt.profile.ra.max_rate_deg_s, attempt.profile.dec.max_rate_deg_s
    return (
        f"the target was faster than the axes may turn (max_rate_deg_s, {ra:g} and {dec:g} °/s) for "
        f"{attempt.clamped_s:.0f} of {attempt.followed_s:.0f} s: `sattrack rehearse` finds passes that the "
        "mount can follow"
    )


def stands_still(attempt: Attempt) -> str | None:
    """An axis does not move."""
    for axis in attempt.axes:
        if axis.ratio is not None and abs(axis.ratio) < STILL:
            return (
                f"{axis.name} did not move as commanded: see to its drive, its brake and its clutch, and to "
                f"{axis.field}_rate_gain in the profile"
            )
    return None


def turned(attempt: Attempt) -> str | None:
    """An axis turns the other way."""
    for axis in attempt.axes:
        if axis.ratio is not None and axis.ratio < TURNED:
            return f"{axis.name} turned the other way: change {axis.field}_rate_sign in the profile"
    return None


def out_of_time(attempt: Attempt) -> str | None:
    """The axes move as commanded, at another time: rates and gains that are fitted mean nothing then."""
    later_s = attempt.later_s
    if later_s is None or abs(later_s) < LATE_S:
        return None
    if later_s < 0.0:
        return _sooner(attempt, -later_s)
    return (
        f"the axes answer {1000.0 * later_s:.0f} ms later than the profile says: {attempt.measure}, "
        "or look for what delays datagrams"
    )


def _sooner(attempt: Attempt, seconds: float) -> str:
    return (
        f"commands act at least {1000.0 * seconds:.0f} ms sooner than the profile says: command_delay_s is "
        f"too large, {attempt.measure}"
    )


def falls_short(attempt: Attempt) -> str | None:
    """An axis does not reach the rates that the profile allows."""
    for axis in attempt.axes:
        off = axis.ratio is not None and axis.ratio < 1.0 - OFF and axis.fastest_deg_s > MOVES_DEG_S
        if off and axis.fastest_deg_s < FALLS_SHORT * axis.fastest_asked_deg_s:
            return (
                f"{axis.name} came to {axis.fastest_deg_s:.2f} °/s where {axis.fastest_asked_deg_s:.2f} °/s "
                f"was commanded: set {axis.field}.max_rate_deg_s to what the axis can do, and choose a "
                "slower pass"
            )
    return None


def late(attempt: Attempt) -> str | None:
    """The mount answers later, or sooner, than the profile says."""
    known, profile = attempt.learnt, attempt.profile
    if known is None:
        return None
    sooner_s = profile.command_delay_s - known.command_delay_s
    if sooner_s >= SOONER_S:
        return _sooner(attempt, sooner_s)
    extra_s, sigma_s, axis = max(
        (known.ra_lag_s - profile.ra.lag_s, known.ra_lag_sigma_s, attempt.ra),
        (known.dec_lag_s - profile.dec.lag_s, known.dec_lag_sigma_s, attempt.dec),
        key=lambda one: one[0],
    )
    if extra_s - sooner_s < LATE_S or sigma_s > 0.2 * LATE_S:
        return None
    return (
        f"{axis.name} answers {1000.0 * (extra_s - sooner_s):.0f} ms later than the profile says: "
        f"{attempt.measure}, or look for what delays datagrams"
    )


def gain_off(attempt: Attempt) -> str | None:
    """An axis moves more or less than commanded."""
    for axis in attempt.axes:
        if axis.ratio is not None and abs(axis.ratio - 1.0) > OFF:
            return (
                f"{axis.name} moved {100.0 * (axis.ratio - 1.0):+.0f} % against what was commanded: "
                f"{axis.field}_rate_gain in the profile is wrong, {attempt.measure}"
            )
    return None


def unforeseen(attempt: Attempt) -> str | None:
    """The mount's motion is not that of any servo."""
    known = attempt.learnt
    if known is None or known.restarts < RESTARTS:
        return None
    seen = [axis for axis in attempt.axes if axis.typical_arcsec is not None]
    off = " and ".join(f"{axis.typical_arcsec:.0f}″ in {axis.name}" for axis in seen)
    return (
        f"the mount moved as no servo explains, and the filters restarted {times_text(known.restarts)}; "
        f"it was off by {off or 'too much'}, typically: see to drives, balance and link, "
        f"then {attempt.measure}"
    )


def too_short(attempt: Attempt) -> str | None:
    """There was hardly any time."""
    if attempt.followed_s >= LEAST_FOLLOWED_S or attempt.held_s:
        return None
    return f"it followed for {attempt.followed_s:.1f} s only: start earlier, or choose a longer pass"


REASONS: tuple[Callable[[Attempt], str | None], ...] = (
    unheard,
    held,
    stopped,
    slewing,
    too_fast,
    out_of_time,
    falls_short,
    stands_still,
    turned,
    late,
    gain_off,
    unforeseen,
    too_short,
)

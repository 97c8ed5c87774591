"""The mount's state in ASCOM's terms: parked, at home, tracking, following; and answers to orders.

The Xerxes status has no usable bits for park and home, and its tracking bit is always true or the opposite of
slewing. So a mount is parked when its power was cut from here and it was not seen alive since; it tracks when
its drive turns with the sky. An order is answered at once, after the next statuses, or when a move that was
ended is seen at rest.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.control.engine_view import bias_fields
from sattrack.control.procedures import NEAR_DEG, off_axes_deg
from sattrack.core.angles import altitude_deg, azimuth_deg
from sattrack.mount.model import DTICS_S_PER_DEG_S, SIDEREAL_RATE_DEG_S, AxesPosition
from sattrack.servers.alpaca.protocol import Answered, Fault, FollowedState, Number, TelescopeState
from sattrack.views.messages import OffsetBy

if TYPE_CHECKING:
    from sattrack.control.engine import Engine
    from sattrack.mount.model import MountProfile, Status
    from sattrack.mount.xerxes.session import Session
    from sattrack.servers.alpaca.protocol import BiasOrder

ALIVE_STATUSES = 20
"""A parked mount that turns with the sky, or slews, in so many statuses in a row is not parked any more."""
SYNCED_WITHIN_DEG = 3.0
RESTING_STATUSES = 10
"""An axis that brakes to the sky's rate passes through others."""
SEEN_AFTER_S = 1.0
"""After so long, a new offset is in force."""
SAME_OFFSET = 1e-9
SETTLING_TICKS = 2
"""How many datagrams an answer waits for a status that shows its effect."""
ANSWER_WITHIN_TICKS = 80
"""Four seconds; a client waits five."""


class MountState:
    """Follows one mount from status to status."""

    def __init__(self, profile: MountProfile) -> None:
        self._profile = profile
        self._parked = False
        self._home: AxesPosition | None = None
        """Where it stood at the end of its slew home, as syncs shift the reported position."""
        self._alive = 0
        self._restarts = 0
        self._resting = 0
        self._tracking = True
        """Whether it tracked the sky when it last did nothing else."""

    def see(self, session: Session) -> None:
        """Take the session's last status."""
        status, sample = session.status, session.sample
        if status is None or sample is None:
            return
        off_sky = abs(sample.ra_drive_deg_s - SIDEREAL_RATE_DEG_S - session.fine_rate.ra_deg_s)
        turning = off_sky < 0.5 * SIDEREAL_RATE_DEG_S
        idle = not (status.slewing or status.pulse_guiding)
        self._resting = self._resting + 1 if idle and not turning else 0
        if idle and turning:
            self._tracking = True
        elif self._resting >= RESTING_STATUSES:
            self._tracking = False
        self._alive = self._alive + 1 if turning or status.slewing else 0
        if self._parked and (session.health.restarts > self._restarts or self._alive >= ALIVE_STATUSES):
            self._parked = False

    def moved(self, kind: str) -> None:
        """Note that an operation begins: "slew" and "follow" end in tracking, "move" in what was before."""
        self._home = None
        self._tracking = self._tracking or kind in {"slew", "follow"}

    def parked(self, session: Session) -> None:
        """Note that the drives' power was cut."""
        self._parked, self._alive = True, 0
        self._restarts = session.health.restarts

    def came_home(self, session: Session) -> bool:
        """Note the end of the slew home; return whether it ended there, as far as is known."""
        home, sample = self._profile.home, session.sample
        reported = session.status is not None and session.status.at_home
        near = home is not None and sample is not None and off_axes_deg(sample, home) <= SYNCED_WITHIN_DEG
        if sample is not None and (reported or near):
            hour_angle_deg = math.remainder(sample.sidereal_h * 15.0 - sample.ra_deg, 360.0)
            self._home = AxesPosition(hour_angle_deg, sample.dec_deg)
        return self._home is not None

    def at_park(self, session: Session) -> bool:
        """Return whether the mount is parked."""
        status = session.status
        return self._parked or (status is not None and status.at_park and not status.slewing)

    def at_home(self, session: Session) -> bool:
        """Return whether the mount stands where it was sent home to."""
        reported = session.status is not None and session.status.at_home
        place, sample = self._home, session.sample
        stands = place is not None and sample is not None and off_axes_deg(sample, place) <= NEAR_DEG
        return reported or stands

    def tracking(self, session: Session) -> bool:
        """Return whether the mount follows the sky, or will when what moves it is over."""
        return self._tracking and not self.at_park(session)


def state_of(  # noqa: PLR0913 - one argument for each value that statuses do not have
    session: Session,
    mount_state: MountState,
    *,
    utc_s: float,
    heard: bool,
    slewing: bool,
    pulsing: bool,
    doing: str,
    failure: str | None,
    tripped: str | None,
    following: FollowedState | None,
    looks_at_deg: tuple[float, float] | None = None,
    kept: bool | None = None,
    turning: tuple[int, ...] = (),
) -> TelescopeState:
    """Return the state of a mount that clients see, at an instant.

    `looks_at_deg` is where the telescope looks, if that differs from what the mount reports; `kept` whether
    rates keep it on the sky, None for a mount that tracks by itself; `turning` which axes MoveAxis turns.
    """
    status = session.status
    if status is None:
        return TelescopeState(utc_s=utc_s, heard=False, doing=doing, failure=failure)
    latitude, longitude, height = _site(status)
    fine = session.fine_rate
    ra_h, dec_deg = status.ra_h % 24.0, status.dec_deg
    altitude, azimuth = status.altitude_deg, status.azimuth_deg
    if looks_at_deg is not None:
        ra_h, dec_deg = looks_at_deg[0] / 15.0, looks_at_deg[1]
    geometry = session.profile.geometry
    told = geometry is None or not (geometry.reports == "axes" or geometry.has_zeros)
    if not told and session.profile.stands_at is not None:
        place = 15.0 * (status.sidereal_h - ra_h), dec_deg, session.profile.stands_at.latitude_deg
        altitude, azimuth = altitude_deg(*place), azimuth_deg(*place)
    return TelescopeState(
        utc_s=utc_s,
        heard=heard,
        measured_utc_s=_measured_utc_s(session, utc_s),
        ra_h=ra_h,
        dec_deg=dec_deg,
        altitude_deg=altitude,
        azimuth_deg=azimuth,
        sidereal_h=status.sidereal_h % 24.0,
        site_latitude_deg=latitude,
        site_longitude_deg=longitude,
        site_height_m=height,
        ra_guide_rate_deg_s=_rate(status.ra_guide_rate_dtics_s),
        dec_guide_rate_deg_s=_rate(status.dec_guide_rate_dtics_s),
        slewing=slewing,
        tracking=mount_state.tracking(session) if kept is None else kept,
        at_home=mount_state.at_home(session) and not slewing,
        at_park=mount_state.at_park(session),
        pulse_guiding=pulsing or status.pulse_guiding,
        beyond_pole=status.side_of_pier,
        does_refraction=status.does_refraction or session.profile.pointing is not None,
        ra_offset_deg_s=fine.ra_deg_s,
        dec_offset_deg_s=fine.dec_deg_s,
        doing=doing,
        turning=turning,
        failure=failure,
        tripped=tripped,
        following=following,
    )


def _measured_utc_s(session: Session, utc_s: float) -> float:
    """Return when the mount measured its last status."""
    sample = session.sample
    return utc_s if sample is None else sample.arrival_utc_s - session.profile.status_delay_s


def _site(status: Status) -> tuple[float | None, float | None, float | None]:
    """Return latitude, longitude and height, None each where the mount does not know its site."""
    latitude, longitude = status.site_latitude_deg, status.site_longitude_deg
    if not latitude and not longitude:
        return None, None, None
    return latitude, longitude, status.site_height_m


def _rate(dtics_s: float | None) -> float | None:
    return None if dtics_s is None else dtics_s / DTICS_S_PER_DEG_S


def offset(engine: Engine | None, order: BiasOrder, now_utc_s: float) -> None:
    """Change the offsets of the satellite that is followed; raises Fault where there is none, or no such."""
    if engine is None:
        raise Fault(Number.INVALID_OPERATION, "no satellite is followed: TrackSatellite first")
    before = engine.tracker.steering.biases.totals(now_utc_s + SEEN_AFTER_S)
    wanted = (("along_s", order.along_s, before[0]), ("cross_deg", order.cross_deg, before[1]))
    for index, (what, value, had) in enumerate(wanted):
        if value is None:
            continue
        engine.operate(OffsetBy(what, "add" if order.add else "set", value), now_utc_s)
        goal = had + value if order.add else value
        has = engine.tracker.steering.biases.totals(now_utc_s + SEEN_AFTER_S)[index]
        if abs(has - goal) > SAME_OFFSET:
            reason = engine.tracker.steering.refusal or "the offset was not taken"
            raise Fault(Number.INVALID_VALUE, reason)


def followed(engine: Engine, now_utc_s: float) -> FollowedState:
    """Return the state of the satellite that is followed."""
    elements, tracker = engine.spec.propagator.elements, engine.tracker
    bias = bias_fields(tracker, now_utc_s + SEEN_AFTER_S)
    error = tracker.error
    return FollowedState(
        name=elements.label,
        catalog_number=elements.catalog_number,
        phase=engine.phase,
        along_s=bias["bias_along_goal_s"],
        cross_deg=bias["bias_cross_goal_deg"],
        error_arcsec=None if error is None or not math.isfinite(error.total_arcsec) else error.total_arcsec,
        acquired=tracker.acquired_utc_s is not None,
    )


class Answers:
    """Answers to clients' orders; whoever sends those in `ready` removes them."""

    def __init__(self) -> None:
        self.ready: list[Answered] = []
        self._ticks = 0
        self._due: list[tuple[int, Answered]] = []
        self._ends: list[tuple[int, int]] = []
        """Orders that ended a move, and until when they wait for its end."""

    @property
    def await_rest(self) -> bool:
        """Whether an order waits for the end of a move."""
        return bool(self._ends)

    def done(self, number: int) -> None:
        """Answer that an order is carried out."""
        self.ready.append(Answered(number))

    def refused(self, number: int, fault: Fault) -> None:
        """Answer that it is refused."""
        self.ready.append(Answered(number, int(fault.number), fault.message))

    def soon(self, number: int, fault: Fault | None) -> None:
        """Answer when a status is there that shows it."""
        answer = Answered(number) if fault is None else Answered(number, int(fault.number), fault.message)
        self._due.append((self._ticks + SETTLING_TICKS, answer))

    def at_rest(self, number: int) -> None:
        """Answer when the mount has come to rest, or does not in time."""
        self._ends.append((number, self._ticks + ANSWER_WITHIN_TICKS))

    def supersede(self, kind: str, number: int | None) -> None:
        """Answer the orders that wait, as another operation begins; `number` waited for one of `kind`."""
        if number is not None:
            self.refused(number, Fault(Number.CANCELLED, f"{kind} was ended by another command"))
        for waiting, _ in self._ends:
            self.done(waiting)
        self._ends.clear()

    def tick(self, rests: bool) -> None:
        """Make ready the answers that are due; `rests`: no move is under way."""
        self._ticks += 1
        self.ready += [answer for at, answer in self._due if at <= self._ticks]
        self._due = [(at, answer) for at, answer in self._due if at > self._ticks]
        over = [number for number, until in self._ends if rests or until <= self._ticks]
        self._ends = [one for one in self._ends if one[0] not in over]
        for number in over:
            self.done(number)

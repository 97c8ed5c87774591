"""How a mount stands in ASCOM's words: parked, at home, tracking; what statuses say, and what they do not.

The protocol's bits for park and home are not packed, and its tracking bit is always true or the opposite of
slewing. So parked is a mount whose power was cut from here and that was not seen alive since; tracking is one
whose drive turns with the sky.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.control.manual.procedures import NEAR_DEG, off_axes_deg
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxesPosition
from sattrack.mount.xerxes.datagrams import DTICS_S_PER_DEG_S
from sattrack.servers.alpaca.messages import FollowedState, TelescopeState

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.datagrams import Status
    from sattrack.mount.xerxes.session import Session

ALIVE_STATUSES = 20
"""A parked mount that turns with the sky, or slews, for so many statuses in a row is parked no more."""
SYNCED_WITHIN_DEG = 3.0
RESTING_STATUSES = 10
"""An axis that brakes to the sky's rate passes through others."""


class Standing:
    """Follows one mount from status to status."""

    def __init__(self, profile: MountProfile) -> None:
        self._profile = profile
        self._parked = False
        self._home: AxesPosition | None = None
        """Where it stood when its way home was over; syncs shift what is reported."""
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
        """Note that something else is asked of the mount: "slew" and "move" end in tracking."""
        self._home = None
        self._tracking = self._tracking or kind in {"slew", "move"}

    def parked(self, session: Session) -> None:
        """Note that the drives' power was cut."""
        self._parked, self._alive = True, 0
        self._restarts = session.health.restarts

    def came_home(self, session: Session) -> bool:
        """Note that the way home is over; tell whether it ended there, as far as is known."""
        home, sample = self._profile.home, session.sample
        told = session.status is not None and session.status.at_home
        near = home is not None and sample is not None and off_axes_deg(sample, home) <= SYNCED_WITHIN_DEG
        if sample is not None and (told or near):
            hour_angle_deg = math.remainder(sample.sidereal_h * 15.0 - sample.ra_deg, 360.0)
            self._home = AxesPosition(hour_angle_deg, sample.dec_deg)
        return self._home is not None

    def at_park(self, session: Session) -> bool:
        """Tell whether the mount is parked."""
        status = session.status
        return self._parked or (status is not None and status.at_park and not status.slewing)

    def at_home(self, session: Session) -> bool:
        """Tell whether the mount stands where it was sent home to."""
        told = session.status is not None and session.status.at_home
        place, sample = self._home, session.sample
        stands = place is not None and sample is not None and off_axes_deg(sample, place) <= NEAR_DEG
        return told or stands

    def tracking(self, session: Session) -> bool:
        """Tell whether the mount follows the sky, or will when what moves it is over."""
        return self._tracking and not self.at_park(session)


def state_of(  # noqa: PLR0913 - one argument for everything that statuses do not tell
    session: Session,
    standing: Standing,
    *,
    utc_s: float,
    heard: bool,
    slewing: bool,
    pulsing: bool,
    doing: str,
    failure: str | None,
    tripped: str | None,
    following: FollowedState | None,
) -> TelescopeState:
    """Return what clients may see of a mount at an instant."""
    status = session.status
    if status is None:
        return TelescopeState(utc_s=utc_s, heard=False, doing=doing, failure=failure)
    latitude, longitude, height = _site(status)
    fine = session.fine_rate
    return TelescopeState(
        utc_s=utc_s,
        heard=heard,
        measured_utc_s=_measured_utc_s(session, utc_s),
        ra_h=status.ra_h % 24.0,
        dec_deg=status.dec_deg,
        altitude_deg=_finite(status.altitude_deg),
        azimuth_deg=_finite(status.azimuth_deg),
        sidereal_h=status.sidereal_h % 24.0,
        site_latitude_deg=latitude,
        site_longitude_deg=longitude,
        site_height_m=height,
        ra_guide_rate_deg_s=_rate(status.ra_guide_rate_dtics_s),
        dec_guide_rate_deg_s=_rate(status.dec_guide_rate_dtics_s),
        slewing=slewing,
        tracking=standing.tracking(session),
        at_home=standing.at_home(session) and not slewing,
        at_park=standing.at_park(session),
        pulse_guiding=pulsing or status.pulse_guiding,
        beyond_pole=status.side_of_pier,
        does_refraction=status.does_refraction,
        ra_offset_deg_s=fine.ra_deg_s,
        dec_offset_deg_s=fine.dec_deg_s,
        doing=doing,
        failure=failure,
        tripped=tripped,
        following=following,
    )


def _measured_utc_s(session: Session, utc_s: float) -> float:
    """Return when the mount measured what its last status says."""
    sample = session.sample
    return utc_s if sample is None else sample.arrival_utc_s - session.profile.status_delay_s


def _site(status: Status) -> tuple[float | None, float | None, float | None]:
    """Return latitude, longitude and height, None each where the mount was never told its site."""
    latitude, longitude = _finite(status.site_latitude_deg), _finite(status.site_longitude_deg)
    if not latitude and not longitude:
        return None, None, None
    return latitude, longitude, _finite(status.site_height_m)


def _rate(dtics_s: float) -> float | None:
    return dtics_s / DTICS_S_PER_DEG_S if math.isfinite(dtics_s) else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

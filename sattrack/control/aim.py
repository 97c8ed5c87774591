"""Where a mount stands for a direction of the sky that is asked for by hand, and the way back. Pure.

A mount whose profile has a pointing model or a geometry is not sent a client's direction as it is: the
telescope would look elsewhere, or its axes know no such coordinates. With a model, or where a mount reports
the angles of its axes, directions are airless, and refraction is added unless the mount adds it.

A mount with a geometry is led by rates: how it slews by itself, nobody knows. `Lead` is one such slew, and
the direction kept in the telescope after it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.approach import slew_time_s
from sattrack.control.target import SatelliteTarget, TargetState, sky_error
from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Slew, mean_sidereal_deg

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.following import Follower
    from sattrack.mount.model import Motion, MountProfile, StatusSample
    from sattrack.safety import Safety
    from tle.site import Site

CLOCK_SET_DEG, CLOCK_SAMPLES = 0.01, 400
"""A jump by which the mount's clock was set, and how many samples its error is averaged over."""
DIFFERENCE_S = 0.5
AIR_ROUNDS = 4
ON_ARCSEC, CLOSE_ARCSEC, NEAR_ARCSEC = 2.0, 10.0, 180.0
"""A mount has arrived that stays on its direction. One that comes only close has after `CLOSE_S`, and one
that comes only near after `NEAR_S`."""
ARRIVED_SAMPLES, CLOSE_S, NEAR_S = 5, 2.0, 10.0


class MountSidereal:
    """A mount's sidereal clock against local mean sidereal time by our UTC."""

    def __init__(self, longitude_deg: float) -> None:
        self._longitude_deg = longitude_deg
        self._gap_deg, self._samples = 0.0, 0
        """How far it is ahead, in the mean of late."""

    def note(self, sidereal_deg: float, utc_s: float) -> None:
        """Take a reading at an instant."""
        gap_deg = math.remainder(sidereal_deg - mean_sidereal_deg(utc_s, self._longitude_deg), 360.0)
        off_deg = math.remainder(gap_deg - self._gap_deg, 360.0)
        if not self._samples or abs(off_deg) > CLOCK_SET_DEG:
            self._gap_deg, self._samples = gap_deg, 1
        else:
            self._samples = min(self._samples + 1, CLOCK_SAMPLES)
            self._gap_deg += off_deg / self._samples

    def at(self, utc_s: float) -> float:
        """Return what it shows at an instant, degrees on any turn."""
        return mean_sidereal_deg(utc_s, self._longitude_deg) + self._gap_deg


class MountInstant(NamedTuple):
    """An instant, POSIX seconds of UTC, and what a mount is at it: its sidereal time, and two facts."""

    utc_s: float
    sidereal_deg: float
    refracts: bool = False
    beyond_pole: bool = False

    @classmethod
    def of(cls, sample: StatusSample, utc_s: float) -> MountInstant:
        """Return an instant at which a mount stands as in a sample."""
        return cls(utc_s, sample.sidereal_h * 15.0, sample.does_refraction, sample.beyond_pole)


class Aim:
    """Directions of the sky and a mount's coordinates: hour angle and declination, or the axes' angles."""

    def __init__(self, profile: MountProfile, site: Site) -> None:
        from tle.earth import EarthOrientation
        from tle.refraction import Refraction

        self._frame, self._model = profile.frame, None
        if profile.pointing is not None:
            from sattrack.pointing.terms import PointingModel

            self._model = PointingModel.of(profile.pointing)
        self._site, self._earth = site, EarthOrientation.installed()
        self._by_axes = self._frame is not None and self._frame.geometry.reports != "sky"
        needs_air = self._model is not None or self._by_axes
        self._air = Refraction.standard(site.height_m) if needs_air else None
        self.adds_air = True
        """Whether directions are airless; else they are what the mount is fed, as they are."""

    def own_deg(self, ra_deg: float, dec_deg: float, at: MountInstant) -> tuple[float, float]:
        """Return where a mount stands for a direction of date: its own hour angle and declination, degrees.

        With a geometry these are the angles of the axes. A declination beyond 90° is past the pole.
        """
        hour_angle, dec = self._sidereal_deg(at) - ra_deg, dec_deg
        if not at.refracts:
            hour_angle, dec = self._bent(hour_angle, dec)
        if self._model is not None:
            hour_angle, dec = self._model.on_side(at.beyond_pole).reported(hour_angle, dec)
        if self._frame is not None:
            hour_angle, dec, _, _ = self._frame.angles(hour_angle, dec)
        return hour_angle, dec

    def sky_deg(self, hour_angle_deg: float, dec_deg: float, at: MountInstant) -> tuple[float, float]:
        """Return right ascension (0 to 360) and declination in which the telescope looks, airless."""
        hour_angle, dec = hour_angle_deg, dec_deg
        if self._frame is not None:
            hour_angle, dec = self._frame.direction(hour_angle, dec)
        if self._model is not None:
            hour_angle, dec = self._model.on_side(at.beyond_pole).looks(hour_angle, dec)
        if not at.refracts:
            seen = hour_angle, dec
            for _ in range(AIR_ROUNDS):
                again = self._bent(hour_angle, dec)
                hour_angle, dec = hour_angle + wrap180(seen[0] - again[0]), dec + seen[1] - again[1]
        return (self._sidereal_deg(at) - hour_angle) % 360.0, dec

    def looks_at_deg(self, sample: StatusSample) -> tuple[float, float]:
        """Return the same of a sample, by the axes where the profile has a geometry."""
        at = MountInstant.of(sample, sample.arrival_utc_s)
        return self.sky_deg(at.sidereal_deg - sample.ra_deg, sample.dec_deg, at)

    def reported_deg(self, ra_deg: float, dec_deg: float, at: MountInstant) -> tuple[float, float]:
        """Return the right ascension and declination that an equatorial mount reports for a direction."""
        hour_angle, dec = self.own_deg(ra_deg, dec_deg, at)
        if abs(dec) > 90.0:
            hour_angle, dec = hour_angle + 180.0, math.copysign(180.0, dec) - dec
        return (at.sidereal_deg - hour_angle) % 360.0, dec

    def _sidereal_deg(self, at: MountInstant) -> float:
        """Return the sidereal time by which a direction has its hour angle.

        A mount that reports the sky is led by what it reports, and its own clock counts.
        """
        if not self._by_axes:
            return at.sidereal_deg
        from tle.instants import Utc

        return float(self._earth.local_apparent_sidereal_deg(Utc(at.utc_s), self._site))

    def _bent(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return a direction as it is seen through the air."""
        if self._air is None or not self.adds_air:
            return hour_angle_deg, dec_deg
        h, d, p = (math.radians(x) for x in (hour_angle_deg, dec_deg, self._site.latitude_deg))
        up = (math.cos(p), 0.0, math.sin(p))
        u = (math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d))
        still = (0.0, 0.0, 0.0)
        (x, y, z), _ = self._air.refract(u, still, up, still)
        return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


class Lead:
    """One direction that rates lead a mount to, and keep it at.

    `place_at` gives the angles of the axes for it at an instant, `clock` is the mount's. `legs` lead there
    past what is in the way; the last of them ends where the direction will be.
    """

    def __init__(
        self,
        place_at: Callable[[float], tuple[float, float]],
        clock: MountSidereal,
        follower: Follower,
        begun_utc_s: float,
        within_s: float,
    ) -> None:
        self._place_at, self._clock, self._follower = place_at, clock, follower
        self._target = SatelliteTarget(self.state_at, ())
        self._begun_utc_s, self._within_s = begun_utc_s, within_s
        self._there_utc_s: float | None = None
        self._near = 0
        self._error_arcsec = math.inf
        self.legs: list[Slew] = []

    @property
    def arrived(self) -> bool:
        """Whether the telescope is on its direction."""
        return self._near >= ARRIVED_SAMPLES

    def overdue(self, now_utc_s: float) -> bool:
        """Tell whether the mount should have arrived long ago."""
        return not self.arrived and now_utc_s - self._begun_utc_s > self._within_s

    def state_at(self, utc_s: float) -> TargetState:
        """Return the direction by the mount's axes, as a right ascension and a declination of them."""
        first, second = self._place_at(utc_s)
        before, after = self._place_at(utc_s - DIFFERENCE_S), self._place_at(utc_s + DIFFERENCE_S)
        first_rate, second_rate = (
            math.remainder(b - a, 360.0) / (2.0 * DIFFERENCE_S) for a, b in zip(before, after, strict=True)
        )
        ra_deg = (self._clock.at(utc_s) - first) % 360.0
        return TargetState(ra_deg, second, SIDEREAL_RATE_DEG_S - first_rate, second_rate)

    def goal(self, sample: StatusSample, profile: MountProfile, now_utc_s: float) -> Slew:
        """Return the slew that ends where the direction is when it is reached."""
        takes_s = 0.0
        for _ in range(3):
            first, second = self._place_at(now_utc_s + takes_s)
            here = sample.sidereal_h * 15.0 - sample.ra_deg
            takes_s = max(
                slew_time_s(wrap180(first - here), profile.ra),
                slew_time_s(second - sample.dec_deg, profile.dec),
            )
        return Slew((self._clock.at(now_utc_s + takes_s) - first) % 360.0, second)

    def wanted(self, safety: Safety, now_utc_s: float) -> Motion | None:
        """Return the motion wanted now; `safety` tells of the leg under way. None before the first sample."""
        if self.legs and safety.led_there and safety.on_last_leg:
            self.legs.pop(0)
        if self.legs:
            return self.legs[0]
        if self._there_utc_s is None:
            self._there_utc_s = now_utc_s
        return self._follower.follow(now_utc_s, self._target)

    def see(self, sample: StatusSample, utc_s: float) -> None:
        """Take a sample of an instant, by the angles of the axes."""
        if self._there_utc_s is None:
            return
        error = sky_error(utc_s, sample.ra_deg, sample.dec_deg, self._target.state(utc_s)).total_arcsec
        waited_s = utc_s - self._there_utc_s
        most = NEAR_ARCSEC if waited_s > NEAR_S else CLOSE_ARCSEC if waited_s > CLOSE_S else ON_ARCSEC
        self._near = self._near + 1 if error <= most else 0

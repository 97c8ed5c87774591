"""The driver of a mount that follows a path of positions, without I/O.

Datagrams from the mount go in with their instants, datagrams for it come out. Safety clears every motion, and
holds the axes at a limit while the path leads beyond it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from sattrack.control.aim import MountSidereal
from sattrack.control.driver import Driver, StopProcedure
from sattrack.control.following import Follower
from sattrack.control.target import TargetSpan
from sattrack.mount.model import AxesPosition, Hold, Motion, MoveAxes, Stop
from sattrack.pointing.terms import PointingModel
from sattrack.safety import Safety
from sattrack.safety.gate import HALF_TURN_DEG
from sattrack.servers.antenna.equipment import Feedback, Sensors
from sattrack.servers.antenna.protocol import to_ns
from sattrack.servers.antenna.trajectory import (
    AxisKind,
    AxisRange,
    AxisState,
    AzEl,
    HaDec,
    Path,
    ProfileModel,
    SiteSky,
)

if TYPE_CHECKING:
    from sattrack.control.target import Pair
    from sattrack.mount.model import MountProfile, StatusSample
    from sattrack.safety import SafetyLimits

ON_TRAJECTORY_DEG = 10.0 / 3600.0
SAMPLES_ON_TRAJECTORY = 4
DEC_LIMIT_DEG = 89.9
"""No command tells a Xerxes mount to go past the pole, and at the pole its right ascension jumps."""
RATE_STEP_S = 0.05
OLDEST_S = 0.3
"""A sample older than this does not tell where the axes are now."""
AMPERES = 0.01
"""A unit of the currents that the mount tells."""


def axis_range(profile: MountProfile, kind: str) -> AxisRange:
    """Return how far a mount's axes turn, as the antenna interface counts them.

    Where positions are azimuths, or hour angles of a mount with a geometry, there is no such axis: they are
    of wrap 0.
    """
    if kind == "azel":
        return AxisRange(0.0, 0.0, 360.0, 0.0, 90.0)
    if kind == "hadec" and profile.geometry is not None:
        return AxisRange(-180.0, -180.0, 180.0, -90.0, 90.0)
    limit = profile.hour_angle_limit_deg
    low, high = profile.dec_axis_limits_deg
    return AxisRange(-180.0, -limit, limit, max(low, -DEC_LIMIT_DEG), min(high, DEC_LIMIT_DEG))


def park_direction(profile: MountProfile) -> AxesPosition | None:
    """Return the hour angle and declination of the profile's park position; None where it has none."""
    park, frame = profile.park, profile.frame
    if park is None or frame is None:
        return park
    return AxesPosition(*frame.direction(park.hour_angle_deg, park.dec_deg))


class PathTarget(Protocol):
    """What a path driver follows."""

    path: Path | None
    """The path in force; None: the mount rests."""
    reset_asked: bool
    """Whether a mount that an interlock has stopped may move again; set to False once that is done."""

    def commanded(self, utc_ns: int) -> AxisState | None:
        """Return where the path is at an instant; None without one, or after its end."""


class PathDriver(Driver, Feedback):  # type: ignore[override]
    """One mount that follows the paths of a target, until `end` is called and the mount is seen at rest.

    `kind` says what the target's positions are; the follower gets hour angle and declination, or the angles
    of the axes of a mount with a geometry. Reported right ascension does not tell the turn of the first axis:
    it is the one that safety counts, which knows how a session before has left it. Positions that are
    azimuths and elevations go through the profile's pointing model; whoever counts the axes has one himself.
    """

    by_axes = True

    def __init__(
        self, target: PathTarget, sky: SiteSky, kind: AxisKind, profile: MountProfile, limits: SafetyLimits
    ) -> None:
        self._sky, self._limits = sky, limits
        super().__init__(profile, self._make_safety(profile))
        self._follower = self._make_follower()
        self._ha_deg = 0.0
        self._target = target
        self._kind = kind
        self._sidereal = MountSidereal(sky.site.longitude_deg)
        self._model = None
        if profile.pointing is not None and kind == "azel":
            self._model = ProfileModel(PointingModel.of(profile.pointing))
        self._hour_angles = axis_range(profile, "own")
        self._moved = False
        self._near = 0
        self._judged: Path | None = None
        """The trajectory by which the last status was judged."""
        self._beyond = False
        self._wanted_ha_deg: float | None = None
        self._last_wanted: Pair = (0.0, 0.0)
        self._path: Path | None = None
        self.clock_ahead_s = 0.0
        """By how much the antenna's clock was set ahead of the computer's."""

    def _make_safety(self, profile: MountProfile) -> Safety:
        site = self._sky.site
        return Safety(profile, self._limits, site.latitude_deg, site.longitude_deg, holds=True)

    def _make_follower(self) -> Follower:
        return Follower(self.profile, self._sky.site.longitude_deg)

    # What the target reads of the axes.

    @property
    def on_trajectory(self) -> bool:  # type: ignore[override]
        """Whether the mount is heard, follows the trajectory, and was within 10″ of it of late."""
        if self._near < SAMPLES_ON_TRAJECTORY or not self.link_up or self.tripped is not None:
            return False
        axes = self._follower.axes
        # A trajectory taken since the last status: that status was judged by the one before.
        return self._target.path is self._judged or (axes is not None and self._is_near(axes.sample_utc_s))

    @property
    def outside_limits(self) -> bool:  # type: ignore[override]
        """Whether a limit keeps the axes off the trajectory."""
        return self._beyond or self.safety.holding is not None

    @property
    def tripped(self) -> str | None:  # type: ignore[override]
        """Name of the interlock that stopped the mount."""
        return self.safety.tripped

    @property
    def does_refraction(self) -> bool:  # type: ignore[override]
        """Whether the mount raises directions itself."""
        return self.session.sample is not None and self.session.sample.does_refraction

    @property
    def sensors(self) -> Sensors | None:  # type: ignore[override]
        """What the mount measures of itself, while it is heard: the currents of its drives."""
        status = self.session.status
        if status is None or not self.link_up:
            return None
        return Sensors(None, None, status.ra_current_10ma * AMPERES, status.dec_current_10ma * AMPERES)

    @property
    def first_deg(self) -> float | None:  # type: ignore[override]
        """Where the hour angle axis was heard last; None where positions are not the axes' own."""
        own = self._kind == "hadec" and self.frame is None
        return self._ha_deg if own and self._follower.axes is not None else None

    def actual(self, utc_ns: int) -> AxisState | None:
        """Return where the axes are, as positions of the antenna's kind."""
        utc_s = utc_ns / 1e9
        axes = self._axes_at(utc_s)
        if axes is None or (self._kind == "hadec" and self.frame is None):
            return axes
        ha_deg, dec_deg, ha_rate, dec_rate = axes
        place = self._looks(HaDec(ha_deg, dec_deg), utc_s)
        moved = self._looks(
            HaDec(ha_deg + ha_rate * RATE_STEP_S, dec_deg + dec_rate * RATE_STEP_S), utc_s + RATE_STEP_S
        )
        if self._kind == "hadec":
            turning = math.remainder(moved.ha_deg - place.ha_deg, 360.0) / RATE_STEP_S
            return AxisState(*place, turning, (moved.dec_deg - place.dec_deg) / RATE_STEP_S)
        here, later = self._sky.horizontal(place, utc_s), self._sky.horizontal(moved, utc_s)
        turning = math.remainder(later.az_deg - here.az_deg, 360.0) / RATE_STEP_S
        return AxisState(here.az_deg, here.el_deg, turning, (later.el_deg - here.el_deg) / RATE_STEP_S)

    @property
    def rests(self) -> bool:
        """Whether nothing that was asked of the mount moves it."""
        return not self._moved or self.session.stopped

    # What comes in, and what goes out.

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount; return its sample, None where it was refused.

        A mount that restarts while it moves is stopped, until the target resets it: it has forgotten its
        syncs, would be led elsewhere, and called on its trajectory there.
        """
        sample = super().receive(data, arrival_utc_s + self.clock_ahead_s)
        if self.restarted:
            self.safety.see_restart(self.session.wanted)
        if sample is not None:
            self._judge(self._take(sample))
            # What another program left moving is ours to stop.
            self._moved = self._moved or self.found_moving
        return sample

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send to the mount now; call once a period."""
        now_utc_s += self.clock_ahead_s
        self.link_state = self.session.link_state(now_utc_s)
        self._reset()
        self.session.apply(self.clear(self._motion(now_utc_s), now_utc_s))
        datagram = self.compose(now_utc_s)
        if self.sent_motion is not None:
            self._follower.note_sent(self.sent_motion, now_utc_s)
        return datagram

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next `tick` beyond one period, seconds of UTC."""
        near = self._near >= SAMPLES_ON_TRAJECTORY
        return self._follower.send_shift_s(now_utc_s + self.clock_ahead_s, on_target=near)

    def end(self, now_utc_s: float) -> None:
        """Bring the mount to rest, and be finished when it is seen there."""
        if self.stop is None:
            self.stop = StopProcedure(now_utc_s + self.clock_ahead_s, needed=self._moved)
            self.stop.finished = not self._moved

    def _motion(self, now_utc_s: float) -> Motion:
        path = self._target.path
        if self.stop is not None or self._target.commanded(to_ns(now_utc_s)) is None:
            self._near, self._beyond, self._path = 0, False, None
            return Stop() if self._moved else Hold()
        if path is not self._path:
            self._path, self._wanted_ha_deg = path, None
        motion = self._follower.follow(now_utc_s, self)
        if motion is None:
            return Hold()
        self._moved = True
        return motion

    def _clock_deg(self, utc_s: float) -> float:
        """Return how far the mount's sidereal clock is ahead of the true one."""
        return math.remainder(self._sidereal.at(utc_s) - self._sky.sidereal_deg(utc_s), 360.0)

    def _stands(self, place: HaDec, utc_s: float) -> HaDec:
        """Return where the axes stand for a direction: a mount that reports the sky goes by its own clock."""
        if self._model is not None:
            place = self._model.axes(place)
        if self.frame is None:
            return place
        ahead = self._clock_deg(utc_s)
        own = ahead if self.frame.geometry.reports == "sky" else 0.0
        first, second, _, _ = self.frame.angles(place.ha_deg + own, place.dec_deg)
        return HaDec(first - ahead, second)

    def _looks(self, axes: HaDec, utc_s: float) -> HaDec:
        """Return the direction of axes that stand so."""
        if self.frame is not None:
            ahead = self._clock_deg(utc_s)
            own = ahead if self.frame.geometry.reports == "sky" else 0.0
            hour_angle, dec = self.frame.direction(axes.ha_deg + ahead, axes.dec_deg)
            axes = HaDec(hour_angle - own, dec)
        return axes if self._model is None else self._model.inverse(axes)

    @property
    def _following(self) -> bool:
        """Whether the mount moves by rates that were sent."""
        return isinstance(self.in_force, MoveAxes)

    def _take(self, sample: StatusSample) -> float:
        """Take in one sample; return its instant."""
        utc_s = self._follower.date(sample)
        self._sidereal.note(sample.sidereal_h * 15.0, utc_s)
        self._follower.take(sample, utc_s, self._following)
        axes, counted_deg = self._follower.axes, self.safety.first_axis_deg
        if counted_deg is not None:
            # Beyond the pole the axis stands half a turn from the hour angle.
            self._ha_deg = counted_deg - (HALF_TURN_DEG if sample.beyond_pole else 0.0)
        if axes is not None:
            self._ha_deg = self._turned(self._sky.sidereal_deg(axes.sample_utc_s) - axes.ra.position_deg)
        return utc_s

    def _axes_at(self, utc_s: float) -> AxisState | None:
        """Return hour angle, with its turn, and declination near the last sample, with their rates.

        That sample is one period of the mount's loop and its delay old at most while the link is up. None
        where it is older.
        """
        axes = self._follower.axes
        seen = self._follower.axes_at(utc_s, self._following)
        if axes is None or seen is None or abs(utc_s - axes.sample_utc_s) > OLDEST_S:
            return None
        (ra, dec), (ra_rate, dec_rate) = seen
        ha = self._turned(self._sky.sidereal_deg(utc_s) - ra)
        return AxisState(ha, dec, self._sky.sidereal_rate_deg_s(utc_s) - ra_rate, dec_rate)

    def span(self, begin_utc_s: float, interval_s: float, bound_deg: Pair) -> TargetSpan:
        """Return the path over an interval, in right ascension against the sidereal time of its begin."""
        begin, middle, end = (self._wanted(begin_utc_s + share * interval_s) for share in (0.0, 0.5, 1.0))
        bend = [4.0 * (a - 2.0 * b + c) / interval_s**2 for a, b, c in zip(begin, middle, end, strict=True)]
        turn_deg = self._sky.sidereal_rate_deg_s(begin_utc_s) * interval_s
        # Right ascension runs against the hour angle, which knows the turn.
        bound_ha = self._turned(self._sky.sidereal_deg(begin_utc_s) - bound_deg[0])
        return TargetSpan(
            (-begin[0], begin[1]),
            (turn_deg - (end[0] - begin[0]), end[1] - begin[1]),
            (-bend[0], bend[1]),
            (-bound_ha, bound_deg[1]),
        )

    def _turned(self, ha_deg: float) -> float:
        """Return an hour angle on the turn that the axis is on."""
        return self._ha_deg + math.remainder(ha_deg - self._ha_deg, 360.0)

    def _wanted(self, utc_s: float) -> Pair:
        """Return hour angle and declination of the trajectory at an instant, as the axes can turn."""
        state = self._target.commanded(to_ns(utc_s))
        if state is None:
            # The satellite has ended on the way: stand where it was, until the next turn stops the mount.
            return self._last_wanted
        ha_deg, dec_deg = state.first_deg, state.second_deg
        if self._kind == "azel" or self.frame is not None:
            seen = HaDec(ha_deg, dec_deg)
            if self._kind == "azel":
                seen = self._sky.equatorial(AzEl(ha_deg, dec_deg), utc_s)
            place = self._stands(seen, utc_s)
            near_deg = self._ha_deg if self._wanted_ha_deg is None else self._wanted_ha_deg
            ha_deg = place.ha_deg + 360.0 * self._hour_angles.shortest_turns(place.ha_deg, near_deg)
            dec_deg, self._wanted_ha_deg = place.dec_deg, ha_deg
        axes = self._hour_angles
        within = (
            max(axes.first_least_deg, min(axes.first_most_deg, ha_deg)),
            max(axes.second_least_deg, min(axes.second_most_deg, dec_deg)),
        )
        self._beyond = within != (ha_deg, dec_deg)
        self._last_wanted = within
        return within

    def _judge(self, utc_s: float) -> None:
        """See whether the axes are on the trajectory."""
        self._judged = self._target.path
        self._near = self._near + 1 if self._is_near(utc_s) else 0

    def _is_near(self, utc_s: float) -> bool:
        """Return whether the axes were within 10″ of the trajectory now in force at an instant."""
        axes = self._axes_at(utc_s)
        if axes is None or self._target.path is None:
            return False
        ha_deg, dec_deg = self._wanted(utc_s)
        off_deg = math.hypot(
            (axes.first_deg - ha_deg) * math.cos(math.radians(dec_deg)), axes.second_deg - dec_deg
        )
        return off_deg <= ON_TRAJECTORY_DEG and not self._beyond

    def _reset(self) -> None:
        if not self._target.reset_asked:
            return
        if self.safety.tripped is None:
            self._target.reset_asked = False
        elif self.session.stopped:
            former, self.safety = self.safety, self._make_safety(self.profile)
            self.safety.follow_on(former)
            self._target.reset_asked = False

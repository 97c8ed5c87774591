"""The driver of a mount, without I/O: session, safety, and the stop at the end. What moves a mount is one.

A session whose motion is `Stop` sends abort until the mount acknowledges it, and anew where the mount moves
on. `StopProcedure` decides when that is over. `DirectStop` is a driver for whoever takes over a mount from a
session that is gone, or that cannot be relied on.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.link_loss import AWAY_S, STOP_LINGER_S, lets_go_after_s, longest_stop_s
from sattrack.mount.model import Hold, MoveAxes, Slew, StatusSample, Stop, seen_of
from sattrack.mount.xerxes.link import LinkState
from sattrack.mount.xerxes.session import Session
from sattrack.safety import ROWS, Safety, SafetyLimits

if TYPE_CHECKING:
    from sattrack.mount.geometry import AxisFrame
    from sattrack.mount.model import Cleared, Motion, MountProfile, Status
    from tle.site import Site

NO_ANSWER_AFTER_S = 3.0
"""A mount that has sent nothing for so long from the beginning does not answer."""
SITE_TOLERANCE_DEG = 0.1
FOUND_MOVING_S = 10.0
"""A mount that nothing is asked of, and that was not seen at rest within so long, moves."""
FOUND_MOVING = "the mount was moving when it was taken over: it was stopped"


def limit_text(name: str, cause: str | None = None) -> str:
    """Return which safety limit stopped the mount, and its cause where that is known, else the way out."""
    row = ROWS[name]
    if cause is not None:
        return f"safety stopped the mount at its {name} limit: {cause}"
    return f"safety stopped the mount at its {name} limit ({row.watches}); to go on: {row.way_out}"


def site_warnings(status: Status | None, site: Site | None) -> list[str]:
    """Return a warning where the mount believes it stands somewhere else than at our site."""
    if status is None or site is None or status.site_deg is None:
        return []
    latitude, longitude = status.site_deg
    off = (abs(latitude - site.latitude_deg), abs(math.remainder(longitude - site.longitude_deg, 360.0)))
    if max(off) < SITE_TOLERANCE_DEG:
        return []
    return [f"the mount believes it stands at {latitude:.2f}, {longitude:.2f}: check the site on both sides"]


class StopProcedure:
    """One stop by a session: over when the mount is seen at rest, or when its time has passed.

    `needed` False: nothing was set going; only the last datagrams are waited for. `blind`: the mount may move
    although it was never heard; without, what was never heard was never set going.
    """

    def __init__(self, begun_utc_s: float, needed: bool = True, blind: bool = False) -> None:
        self.begun_utc_s = begun_utc_s
        self.finished = False
        self.at_rest: bool | None = None
        """Whether the mount was seen at rest by the end of the stop, or later; None before the end, where no
        stop was needed, and where the mount was never heard."""
        self.needed = needed
        self._blind = blind
        self._rest_utc_s: float | None = None
        """Since when the mount is seen at rest."""
        self._rest_heard_utc_s = begun_utc_s
        """When the status had come by which it was seen so first."""
        self._looked_utc_s = begun_utc_s
        self._away_s = 0.0
        """How much of the time since the begin the machine slept, or its clock was set by."""

    def look(self, session: Session, now_utc_s: float) -> bool:
        """Tell whether it is over; call once a period."""
        since_s, self._looked_utc_s = now_utc_s - self._looked_utc_s, now_utc_s
        if not 0.0 <= since_s <= AWAY_S:
            self._away_s += since_s
        link, waited_s = session.link_state(now_utc_s), now_utc_s - self.begun_utc_s - self._away_s
        rested = self._rested(session, link, now_utc_s)
        rested = rested and waited_s >= lets_go_after_s(session.health.overtaken_s)
        heard = session.sample is not None
        if self.finished:
            if rested and self.needed:
                self.at_rest = True
            return True
        if not self.needed or not (heard or self._blind):
            self.finished = waited_s >= STOP_LINGER_S
        else:
            self.finished = rested or waited_s > longest_stop_s(link in {LinkState.UP, LinkState.STALE})
        if self.finished and self.needed and heard:
            self.at_rest = rested
        return self.finished

    def _rested(self, session: Session, link: LinkState, now_utc_s: float) -> bool:
        """Tell whether the mount has been seen at rest for long enough.

        One old status is not enough: another must come that shows rest as well. A telescope that answers
        slowly, or a machine that is busy, may take longer for it than STOP_LINGER_S.
        """
        sample = session.sample
        if sample is None or not session.stopped or link is LinkState.LOST:
            self._rest_utc_s = None
            return False
        if self._rest_utc_s is None:
            self._rest_utc_s, self._rest_heard_utc_s = now_utc_s, sample.arrival_utc_s
        heard_again = sample.arrival_utc_s > self._rest_heard_utc_s
        return heard_again and now_utc_s - self._rest_utc_s >= STOP_LINGER_S


class Driver:
    """One mount: the session with it, the safety that clears its motions, and the stop at the end.

    Subclasses decide which motion is wanted. Those with `by_axes` think in the angles of the mount's axes,
    where its profile has a geometry: a right ascension is then the mount's sidereal time less the angle of
    the first axis, a declination that of the second. The others move no such mount.
    """

    by_axes = False

    def __init__(self, profile: MountProfile, safety: Safety) -> None:
        self.profile = profile
        self.session = Session(profile)
        self.safety = safety
        self.link_state = LinkState.SILENT
        """State of the link as of the last tick."""
        self.stop: StopProcedure | None = None
        """The stop at the end, once it has begun."""
        self.frame = profile.frame
        """The axes in space; None for an equatorial mount."""
        self._by_axes: StatusSample | None = None
        self.in_force: Motion = Hold()
        """The motion last sent: to a mount that takes rates by edges, not each of them is."""
        self.found_moving = False
        """Whether the mount has moved ever since it was first heard, by what another program left."""
        self.restarted = False
        """Whether the last datagram has shown that the mount's program began anew."""
        self._first_heard_utc_s: float | None = None
        self._has_rested = False
        """Whether it has been at rest since, or in a motion of ours."""
        self.turns_known_s = math.inf
        """For how long after its newest status the mount may go on unheard, its axes' turns still known; inf
        where it is at rest, or slews by itself."""

    @property
    def sample(self) -> StatusSample | None:
        """The last sample, by the angles of the axes where the profile has a geometry."""
        return self.session.sample if self.frame is None else self._by_axes

    @property
    def finished(self) -> bool:
        """Whether the stop at the end is over."""
        return self.stop is not None and self.stop.finished

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the mount was seen at rest at the end; None: no stop was needed, or it was not heard."""
        return None if self.stop is None else self.stop.at_rest

    @property
    def limit_reached(self) -> str | None:
        """Which safety limit stopped the mount, as text, with the cause that its motion shows; None: none."""
        name = self.safety.tripped
        if name is None:
            return None
        return limit_text(name, self.safety.cause if name == "obedience" else None)

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""
        return self.link_state in {LinkState.UP, LinkState.STALE}

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount; return its sample, None where it was refused."""
        restarts = self.session.health.restarts
        sample = self.session.receive(data, arrival_utc_s)
        self.restarted = self.session.health.restarts > restarts
        if sample is None or self.session.status is None:
            return sample
        seen = seen_of(self.session.status, arrival_utc_s)
        if self.frame is not None:
            sample = sample_by_axes(sample, self.frame)
            seen = msgspec.structs.replace(seen, ra_deg=sample.ra_deg, dec_deg=sample.dec_deg)
            self._by_axes = sample
        # Rates that the mount is yet to take are not disobeyed.
        self.safety.watch(seen, Hold() if self.session.waits_for_slew else self.in_force)
        self._watch_begin(sample.arrival_utc_s)
        return sample

    def _watch_begin(self, utc_s: float) -> None:
        """See whether a mount was left in motion: one that keeps the last rates goes on for ever."""
        if self._has_rested:
            return
        ours = not isinstance(self.in_force, Hold) and not self.found_moving
        if ours or self.session.at_rest:
            self._has_rested, self.found_moving = True, False
            return
        if self._first_heard_utc_s is None:
            self._first_heard_utc_s = utc_s
        long_since = utc_s - self._first_heard_utc_s > FOUND_MOVING_S
        self.found_moving = self.found_moving or long_since or self.session.surely_moves

    def clear(self, motion: Motion, now_utc_s: float) -> Cleared:
        """Return a motion as far as safety lets the mount make it; before its first status, only a stop."""
        sample = self.sample
        if sample is None or (self.frame is not None and not self.by_axes):
            return self.safety.clear(motion if isinstance(motion, Hold) else Stop(), 0.0, 0.0, 0.0)
        age_s = max(0.0, now_utc_s - sample.arrival_utc_s)
        lst_deg = sample.sidereal_h * 15.0
        # Before the first rates of a run: they too may have to last until an answer that never comes.
        self.safety.handshakes_last(self.session.unanswered_s)
        cleared = self.safety.clear(motion, lst_deg, sample.ra_deg, sample.dec_deg, age_s, now_utc_s)
        return self.safety.in_time(cleared, self.session.rates_wait_s, self.in_force)

    def compose(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now, and follow the stop at the end; call once a period."""
        if self.stop is not None:
            self.stop.look(self.session, now_utc_s)
        datagram = self.session.compose()
        self.in_force = self.in_force if self.sent_motion is None else self.sent_motion
        if isinstance(self.in_force, MoveAxes):
            self.turns_known_s = self.safety.turns_known_s(self.in_force)
        elif isinstance(self.in_force, Slew) or self.session.at_rest:
            self.turns_known_s = math.inf
        return datagram

    def repeat(self) -> bytes | None:
        """Return what to send once more before the next datagram, None for nothing."""
        return None if self.stop is not None else self.session.repeat()

    @property
    def sent_motion(self) -> Motion | None:
        """The motion that the last datagram asks for, None where the mount takes no new rates from it."""
        wanted = self.session.wanted
        return self.session.begun_move if isinstance(wanted, MoveAxes) else wanted


def sample_by_axes(sample: StatusSample, frame: AxisFrame) -> StatusSample:
    """Return a sample with the angles of the axes in place of the reported direction."""
    sidereal_deg = sample.sidereal_h * 15.0
    reported = sidereal_deg - sample.ra_deg, sample.dec_deg, sample.ra_drive_deg_s, sample.dec_drive_deg_s
    first, second, first_rate, second_rate = frame.of_report(*reported)
    return msgspec.structs.replace(
        sample,
        ra_deg=(sidereal_deg - first) % 360.0,
        dec_deg=second,
        ra_drive_deg_s=first_rate,
        dec_drive_deg_s=second_rate,
    )


class DirectStop(Driver):
    """A stop by a session of its own; call `tick` once a period until `finished`.

    `counter` is the number of the last datagram that the mount was sent. `acts_in_s` is the time until an
    abort acts that it has acknowledged: no other is sent before, from which it might count anew. After the
    end, more ticks keep the mount at rest: should it move again, it is stopped again.
    """

    def __init__(
        self, profile: MountProfile, begun_utc_s: float, counter: int = 0, acts_in_s: float = 0.0
    ) -> None:
        super().__init__(profile, Safety(profile, SafetyLimits(), 0.0))
        self.session.health.sent = counter
        # What it did before is not known: positions that repeat from the first on may be a hung encoder's.
        self.session.taken_over()
        self.stop: StopProcedure = StopProcedure(begun_utc_s, blind=True)
        self._aborts_from_utc_s = begun_utc_s + acts_in_s
        self._abort(begun_utc_s)

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount, whose limits are not known here."""
        return self.session.receive(data, arrival_utc_s)

    def renew(self, now_utc_s: float) -> None:
        """Give a stop that was finished without rest its whole time again."""
        self.stop = StopProcedure(now_utc_s, blind=True)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now."""
        self._abort(now_utc_s)
        return self.compose(now_utc_s)

    def _abort(self, now_utc_s: float) -> None:
        if now_utc_s >= self._aborts_from_utc_s and not isinstance(self.session.wanted, Stop):
            self.session.apply(self.clear(Stop(), now_utc_s))

    def last_heard(self, now_utc_s: float) -> str:
        """Return what the mount reported last, as text."""
        sample, age_s = self.session.sample, self.session.health.age_s(now_utc_s)
        if sample is None or age_s is None:
            return "the mount has not been heard since"
        when = "now" if age_s < 1.0 else f"{age_s:.0f} s ago"
        if self.session.at_rest:
            return f"last heard {when}, at rest"
        ra, dec = sample.ra_drive_deg_s, sample.dec_drive_deg_s
        return f"last heard {when}, moving at {ra:.3f} and {dec:.3f} °/s (hour angle, declination)"

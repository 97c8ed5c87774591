"""Tickets under way: what is asked of the mount, how far it has come, and when it is given up.

Requests that move the mount as a whole (slew, abort, MoveAxis and its end) become the motion that the session
wants; `MotionTicket` follows what the session sees of it. One at a time: the next motion supersedes it.

The others (sync, pulse guide, home, park, rates) are one-shots, one after the other in `Launches`. Each waits
until nothing else is up and the mount stands as it must; its flag goes through the handshake; what the status
then shows decides how its ticket settles. The protocol has no acknowledgement for park, home, fine rates and
tracking rate: those are sent for a while and end unconfirmed, unless the status shows them done.

Time is counted in datagrams, one each period.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.mount.model import DTICS_S_PER_DEG_S, SIDEREAL_RATE_DEG_S, Slew, Stance, stance_of
from sattrack.mount.requests import (
    EndMove,
    FindHome,
    FineRate,
    Park,
    PulseGuide,
    Sync,
    Ticket,
    TicketState,
    TrackingRate,
    park_objection,
)
from sattrack.mount.xerxes.flags import Handshake, OneShot

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile, Status

STARTED_WITHIN_S = 30.0
"""How long a slew may wait for the mount to stand still."""
ACK_WITHIN = 160
"""Datagrams, eight seconds, for an acknowledgement: a missed edge is asked for anew meanwhile."""
SLEW_WITHIN_S = 240.0
"""How long a slew may take at least."""
REST_WITHIN_S = 30.0
ARRIVED_WITHIN_DEG = 0.25
QUEUED_AT_MOST_S = 30.0
"""How long a request may wait for its turn."""
ACK_AT_MOST = 60
"""Datagrams, three seconds, within which an acknowledgement must come."""
UNCONFIRMED_AFTER = 20
"""Datagrams, a second, for which a flag without an acknowledgement is sent."""
SHOWN_WITHIN = 20
"""Statuses within which what was acknowledged must show."""
SYNCED_WITHIN_DEG = 0.02
FINE_RATE_SHARE = 0.2

Launchable = Sync | PulseGuide | FindHome | Park | FineRate | TrackingRate
ACKNOWLEDGED_KINDS = (Sync, PulseGuide)


@dataclass(slots=True)
class MotionTicket:
    """A request that moves the mount as a whole, under way."""

    ticket: Ticket
    profile: MountProfile
    sent: bool = False
    """Whether its flags have been in a datagram."""
    _ticks: int = 0
    """Datagrams since the ticket's state changed."""

    def tick(self) -> bool:
        """Count one datagram; tell whether the request has been given up for want of time."""
        self._ticks += 1
        if self.ticket.settled:
            return False
        if self.sent and self.ticket.state is TicketState.QUEUED:
            self._become(TicketState.RAISED)
        limit, reason = self._limit()
        if self._ticks <= round(limit):
            return False
        self.ticket.become(TicketState.TIMED_OUT, reason)
        return True

    def see(self, acknowledged: bool, done: bool, off_target_deg: float | None) -> None:
        """Take what the session has seen of it; the distance is that of a slew's end from its target."""
        ticket = self.ticket
        if ticket.settled:
            return
        if acknowledged and ticket.state is TicketState.RAISED:
            self._become(TicketState.ACKNOWLEDGED)
        # The end of MoveAxis has no acknowledgement of its own.
        ends = TicketState.RAISED if isinstance(ticket.request, EndMove) else TicketState.ACKNOWLEDGED
        if not done or ticket.state is not ends:
            return
        if off_target_deg is None or off_target_deg <= ARRIVED_WITHIN_DEG:
            self._become(TicketState.COMPLETE)
        else:
            ticket.become(TicketState.FAILED, f"the slew ended {off_target_deg:.2f}° away from its target")

    def _become(self, state: TicketState) -> None:
        self.ticket.become(state)
        self._ticks = 0

    def _limit(self) -> tuple[float, str]:
        """Return after how many datagrams the request is given up, and why."""
        a_second = 1.0 / self.profile.period_s
        match self.ticket.state:
            case TicketState.QUEUED:
                return (
                    STARTED_WITHIN_S * a_second,
                    "never sent: the mount did not come to rest, or was not heard",
                )
            case TicketState.RAISED if isinstance(self.ticket.request, EndMove):
                return REST_WITHIN_S * a_second, "the mount did not come back to tracking"
            case TicketState.RAISED:
                return ACK_WITHIN, "the mount did not acknowledge it"
            case _ if isinstance(self.ticket.request, Slew):
                lasts_s = max(SLEW_WITHIN_S, self.profile.goes_within_s())
                return lasts_s * a_second, "the mount acknowledged the slew and did not finish it"
            case _:
                return REST_WITHIN_S * a_second, "the mount acknowledged it and was not seen to obey"


@dataclass(slots=True)
class _Active:
    ticket: Ticket
    flag: OneShot
    ticks: int = 0
    statuses: int = 0
    """Statuses since the acknowledgement, or since the flag rose where there is none."""
    seen_pulsing: bool = False
    before: Status | None = None
    """The status at the time the flag rose."""


@dataclass(slots=True)
class Launches:
    """The queue of such requests, and the one that is under way."""

    profile: MountProfile
    fine_rate: FineRate = field(default_factory=FineRate)
    """What every datagram says of the fine rates; kept until asked otherwise."""
    tracking_rate: int = 0
    _sync_flag: OneShot = field(default_factory=OneShot)
    _pulse_flag: OneShot = field(default_factory=OneShot)
    _queue: deque[tuple[Ticket, int]] = field(default_factory=deque)
    _active: _Active | None = None
    _ticks: int = 0

    @property
    def busy(self) -> bool:
        """Whether any request waits or is under way."""
        return self._active is not None or bool(self._queue)

    def submit(self, ticket: Ticket) -> None:
        """Put a request into the queue; fine rates take the place of those that are only looked at."""
        active = self._active
        rates = isinstance(ticket.request, FineRate)
        if rates and active is not None and isinstance(active.ticket.request, FineRate):
            self._end(active, TicketState.SUPERSEDED, "other fine rates were asked for")
        self._queue.append((ticket, self._ticks))

    def supersede(self, reason: str) -> None:
        """Give up everything that waits or is under way."""
        for ticket, _ in self._queue:
            ticket.become(TicketState.SUPERSEDED, reason)
        self._queue.clear()
        if self._active is not None:
            self._end(self._active, TicketState.SUPERSEDED, reason)

    def begin_anew(self) -> None:
        """Note a mount that has restarted: what was under way is lost with it."""
        if self._active is not None:
            self._end(self._active, TicketState.FAILED, "the mount restarted meanwhile")
        self._sync_flag, self._pulse_flag = OneShot(), OneShot()

    def tick(self) -> None:
        """Count one datagram; give up what has waited too long."""
        self._ticks += 1
        self._expire_queue()
        if self._active is not None:
            self._active.ticks += 1
            self._watch_time(self._active)

    def compose(self, clear: bool, status: Status | None, at_rest: bool) -> Launchable | None:
        """Return the request whose flag is up in the next datagram.

        `clear` where a flag may rise, `at_rest` where the mount's positions say so.
        """
        released = all(flag.state is Handshake.IDLE for flag in (self._sync_flag, self._pulse_flag))
        may_rise = self._active is None and self._queue and clear and released
        if (
            may_rise
            and status is not None
            and not self._waits_for_rest(stance_of(status, at_rest, self.profile.frame))
        ):
            self._launch(self._queue.popleft()[0], status, at_rest)
        active = self._active
        if active is None:
            return None
        request: Launchable = active.ticket.request  # type: ignore[assignment]
        return request if active.flag.up else None

    def _waits_for_rest(self, stance: Stance) -> bool:
        """Tell whether the next request is a park at the right place, where the mount still swings."""
        if not isinstance(self._queue[0][0].request, Park) or stance.drives_at_rest:
            return False
        return park_objection(self.profile, stance._replace(drives_at_rest=True)) is None

    def see(self, status: Status) -> None:
        """Take one status."""
        synced = self._sync_flag.see(status.ack_sync)
        pulsed = self._pulse_flag.see(status.ack_pulse_guide)
        active = self._active
        if active is None:
            return
        if synced or pulsed:
            active.ticket.become(TicketState.ACKNOWLEDGED)
        if active.ticket.was_acknowledged or not isinstance(active.ticket.request, ACKNOWLEDGED_KINDS):
            active.statuses += 1
        match active.ticket.request:
            case Sync():
                self._see_synced(active, status)
            case PulseGuide():
                self._see_pulse(active, status)
            case _:
                self._see_unacknowledged(active, status)

    def _launch(self, ticket: Ticket, status: Status, at_rest: bool) -> None:
        flag = OneShot()
        if isinstance(ticket.request, Park):
            # It was judged when it was submitted; what counts is where the mount stands as the flag rises.
            refused = park_objection(self.profile, stance_of(status, at_rest, self.profile.frame))
            if refused is not None:
                ticket.become(TicketState.FAILED, refused)
                return
        match ticket.request:
            case Sync():
                flag = self._sync_flag
            case PulseGuide():
                flag = self._pulse_flag
            case FineRate():
                self.fine_rate = ticket.request
            case TrackingRate():
                self.tracking_rate = ticket.request.rate
        flag.happen("request")
        ticket.become(TicketState.RAISED)
        self._active = _Active(ticket, flag, before=status)

    def _expire_queue(self) -> None:
        most = round(QUEUED_AT_MOST_S / self.profile.period_s)
        while self._queue and self._ticks - self._queue[0][1] > most:
            ticket, _ = self._queue.popleft()
            ticket.become(
                TicketState.TIMED_OUT, "never sent: the mount did not come to rest, or was not heard"
            )

    def _watch_time(self, active: _Active) -> None:
        acknowledged = isinstance(active.ticket.request, ACKNOWLEDGED_KINDS)
        if acknowledged and active.flag.state is Handshake.RAISED and active.ticks > ACK_AT_MOST:
            self._end(active, TicketState.TIMED_OUT, "the mount did not acknowledge it")
        elif not acknowledged and active.ticks > UNCONFIRMED_AFTER:
            self._end(active, TicketState.UNCONFIRMED, "the protocol has no acknowledgement for it")
        elif active.ticks > self._most_ticks(active):
            self._end(active, TicketState.TIMED_OUT, "the mount fell silent, or did not finish it")

    def _most_ticks(self, active: _Active) -> float:
        request = active.ticket.request
        pulse_s = 0.0
        if isinstance(request, PulseGuide):
            pulse_s = max(abs(request.ra_ms), abs(request.dec_ms)) / 1000.0
        return 2 * ACK_AT_MOST + 2.0 * pulse_s / self.profile.period_s

    def _see_synced(self, active: _Active, status: Status) -> None:
        request = active.ticket.request
        assert isinstance(request, Sync)
        if not active.ticket.was_acknowledged or active.flag.state is not Handshake.IDLE:
            return
        cos_dec = math.cos(math.radians(request.dec_deg))
        off = max(
            abs(math.remainder(status.ra_h * 15.0 - request.ra_deg, 360.0)) * cos_dec,
            abs(status.dec_deg - request.dec_deg),
        )
        if off <= SYNCED_WITHIN_DEG:
            self._end(active, TicketState.COMPLETE)
        elif active.statuses > SHOWN_WITHIN:
            self._end(
                active, TicketState.FAILED, f"acknowledged, but the mount reports a direction {off:.2f}° away"
            )

    def _see_pulse(self, active: _Active, status: Status) -> None:
        request = active.ticket.request
        assert isinstance(request, PulseGuide)
        if not active.ticket.was_acknowledged:
            return
        active.seen_pulsing = active.seen_pulsing or status.pulse_guiding
        if status.pulse_guiding or active.flag.state is not Handshake.IDLE:
            return
        longest_s = max(abs(request.ra_ms), abs(request.dec_ms)) / 1000.0
        if active.seen_pulsing:
            self._end(active, TicketState.COMPLETE)
        elif active.statuses > SHOWN_WITHIN + longest_s / self.profile.period_s:
            self._end(active, TicketState.UNCONFIRMED, "acknowledged, but the mount was not seen to guide")

    def _see_unacknowledged(self, active: _Active, status: Status) -> None:
        before, request = active.before, active.ticket.request
        assert before is not None
        shown = False
        match request:
            case FindHome():
                shown = status.at_home and not before.at_home and not status.slewing
            case Park():
                shown = status.at_park and not before.at_park
            case TrackingRate():
                shown = status.tracking_rate == request.rate != before.tracking_rate
            case FineRate():
                shown = self._fine_rate_shows(request, before, status)
        if shown:
            self._end(active, TicketState.COMPLETE)

    @staticmethod
    def _fine_rate_shows(request: FineRate, before: Status, status: Status) -> bool:
        """Tell whether the drives went over to what was asked, from other rates than that."""
        asked = (
            (SIDEREAL_RATE_DEG_S + request.ra_deg_s, before.ra_rate_dtics_s, status.ra_rate_dtics_s),
            (request.dec_deg_s, before.dec_rate_dtics_s, status.dec_rate_dtics_s),
        )
        changed = False
        for goal_deg_s, was, is_now in asked:
            step = abs(goal_deg_s * DTICS_S_PER_DEG_S - was)
            if abs(goal_deg_s * DTICS_S_PER_DEG_S - is_now) > max(2.0, FINE_RATE_SHARE * step):
                return False
            changed = changed or step > 20.0
        return changed

    def _end(self, active: _Active, state: TicketState, reason: str | None = None) -> None:
        active.flag.happen("withdraw")
        active.ticket.become(state, reason)
        self._active = None

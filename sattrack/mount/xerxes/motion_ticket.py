"""Tickets of requests that move the mount as a whole: slew, abort, MoveAxis and its end.

Such a request becomes the motion that the session wants; its ticket follows what the session sees of it. One
at a time: the next motion supersedes it. Time is counted in datagrams.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sattrack.mount.requests import Abort, EndMove, MoveAxis, Slew, Ticket, TicketState
from sattrack.mount.xerxes.slewing import SlewState

STARTED_WITHIN = 600
"""Datagrams, half a minute, that a slew may wait for the mount to stand still."""
ACK_WITHIN = 160
"""Datagrams, eight seconds, for an acknowledgement: a missed edge is asked for anew meanwhile."""
SLEW_WITHIN = 4800
REST_WITHIN = 600
ARRIVED_WITHIN_DEG = 0.25


class Seen(NamedTuple):
    """What the session knows of the motion that it wants."""

    sent: bool
    """Whether its flags have been in a datagram."""
    slew_state: SlewState
    aborted: bool
    stopped: bool
    moving: bool
    """Whether MoveAxis with these flags is acknowledged."""
    move_over: bool
    off_target_deg: float | None
    """Distance of a slew's end from its target."""


@dataclass(slots=True)
class MotionTicket:
    """One such ticket under way."""

    ticket: Ticket
    _ticks: int = 0

    def tick(self, seen: Seen) -> bool:
        """Count one datagram; tell whether the request has been given up for want of time."""
        self._ticks += 1
        if self.ticket.settled:
            return False
        if seen.sent and self.ticket.state is TicketState.QUEUED:
            self._become(TicketState.RAISED)
        limit, words = self._limit()
        if self._ticks <= limit:
            return False
        self.ticket.become(TicketState.TIMED_OUT, words)
        return True

    def see(self, seen: Seen) -> None:
        """Take what a status told."""
        if self.ticket.settled:
            return
        match self.ticket.request:
            case Slew():
                self._see_slew(seen)
            case Abort():
                if seen.aborted and self.ticket.state is TicketState.RAISED:
                    self._become(TicketState.ACKNOWLEDGED)
                if seen.stopped and self.ticket.state is TicketState.ACKNOWLEDGED:
                    self._become(TicketState.COMPLETE)
            case MoveAxis():
                if seen.moving and self.ticket.state is TicketState.RAISED:
                    self._become(TicketState.ACKNOWLEDGED)
                    self._become(TicketState.COMPLETE)
            case EndMove():
                if seen.move_over and self.ticket.state is TicketState.RAISED:
                    self._become(TicketState.COMPLETE)

    def _see_slew(self, seen: Seen) -> None:
        if seen.slew_state in {SlewState.UNDER_WAY, SlewState.DONE}:
            if self.ticket.state is TicketState.RAISED:
                self._become(TicketState.ACKNOWLEDGED)
            if seen.slew_state is SlewState.DONE and self.ticket.state is TicketState.ACKNOWLEDGED:
                off = seen.off_target_deg
                if off is None or off <= ARRIVED_WITHIN_DEG:
                    self._become(TicketState.COMPLETE)
                else:
                    self.ticket.become(TicketState.FAILED, f"the slew ended {off:.2f}° away from its target")

    def _become(self, state: TicketState) -> None:
        self.ticket.become(state)
        self._ticks = 0

    def _limit(self) -> tuple[int, str]:
        match self.ticket.state:
            case TicketState.QUEUED:
                return STARTED_WITHIN, "never sent: the mount did not come to rest, or was not heard"
            case TicketState.RAISED if isinstance(self.ticket.request, EndMove):
                return REST_WITHIN, "the mount did not come back to tracking"
            case TicketState.RAISED:
                return ACK_WITHIN, "the mount did not acknowledge it"
            case _ if isinstance(self.ticket.request, Slew):
                return SLEW_WITHIN, "the mount acknowledged the slew and did not finish it"
            case _:
                return REST_WITHIN, "the mount acknowledged it and was not seen to obey"

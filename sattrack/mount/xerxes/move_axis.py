"""The MoveAxis flags and rates, by either of the two readings that the protocol leaves open.

*Held*: the latest rates act while a flag is up, so the flags stay up for as long as motion is wanted.
*Edge*: rates are read as a flag rises and stay in force after its fall. The flags then go through the whole
handshake for every change, both together where both are wanted: up with rates that do not change meanwhile,
held until acknowledged, down until the acknowledgement has fallen. Rate 0 ends MoveAxis on its axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

from sattrack.mount.xerxes.handshake import QUIET_STATUSES, Handshake, OneShot

if TYPE_CHECKING:
    from sattrack.mount.xerxes.datagrams import Status

EDGE_ACK_WITHIN_STATUSES = 20


class AxisRates(NamedTuple):
    """MoveAxis rates as they go on the wire, degrees per second; None leaves that axis' flag down."""

    ra: float | None
    dec: float | None


NO_RATES = AxisRates(None, None)


class Sent(NamedTuple):
    """What one datagram says of MoveAxis; `begins` tells whether these rates are new with it."""

    rates: AxisRates
    begins: bool


class MoveAxisRule(Protocol):
    """What the session needs of either reading."""

    @property
    def over(self) -> bool:
        """Whether the mount no longer moves by MoveAxis, as far as statuses tell."""

    def compose(self, wish: AxisRates) -> Sent:
        """Return what the next datagram says; NO_RATES asks for the end."""

    def hush(self) -> None:
        """Note a datagram that goes out without the flags because something outranks them."""

    def see(self, status: Status) -> None:
        """Take one status."""

    def stopped(self) -> None:
        """Note that an abort was acknowledged: nothing is in force any more."""

    def insist(self) -> None:
        """Ask for the end anew: the mount moves on though it has acknowledged it."""

    def renew(self) -> None:
        """Send the next rates even where they are those in force."""


@dataclass(slots=True)
class HeldMove:
    """The flags stay up while motion is wanted.

    The last status may be older than the last command: what tells that the mount has let go is the
    acknowledgement seen up and then down since, or a silence so long that none is to come.
    """

    over: bool = True
    """Whether the mount no longer moves by MoveAxis, as far as statuses tell."""
    _up: bool = False
    _acked: bool = False
    _statuses: int = 0

    def compose(self, wish: AxisRates) -> Sent:
        """Return what the next datagram says."""
        up = wish != NO_RATES
        if up:
            # An acknowledgement from before they rose says nothing of now.
            self._acked = self._acked and self._up
            self.over, self._statuses = False, 0
        self._up = up
        return Sent(wish, up)

    def hush(self) -> None:
        """Note a datagram without the flags."""
        self._up = False

    def see(self, status: Status) -> None:
        """Take one status."""
        if self.over:
            return
        self._statuses += 1
        up = status.ack_move_ra or status.ack_move_dec
        self._acked = self._acked or up
        fallen = self._acked and not up
        self.over = fallen or self._statuses >= QUIET_STATUSES

    def stopped(self) -> None:
        """Nothing to do: flags that are down have let go already."""

    def insist(self) -> None:
        """Nothing to do, for the same reason."""

    def renew(self) -> None:
        """Nothing to do: every datagram has them."""


@dataclass(slots=True)
class EdgeMove:
    """Every change of rate is an edge of its own."""

    _flags: OneShot = field(default_factory=OneShot)
    _latched: AxisRates = NO_RATES
    _in_force: AxisRates = NO_RATES

    @property
    def over(self) -> bool:
        """Whether the mount no longer moves by MoveAxis, as far as statuses tell."""
        return self._in_force == NO_RATES and self._flags.state is Handshake.IDLE

    def compose(self, wish: AxisRates) -> Sent:
        """Return what the next datagram says."""
        begins = False
        if self._flags.state is Handshake.IDLE:
            # What is wanted is wanted whole: an axis that it does not name has its motion ended.
            rates = _over(_ending(self._in_force), wish)
            if _moving(_over(self._in_force, rates)) != self._in_force:
                begins = self._flags.happen("request")
                self._latched = rates
                # From here on the mount may have them, whether or not we hear of it.
                self._in_force = _over(self._in_force, rates)
        return Sent(self._latched if self._flags.up else NO_RATES, begins)

    def hush(self) -> None:
        """Note a datagram without the flags."""
        self._flags.happen("withdraw")

    def see(self, status: Status) -> None:
        """Take one status."""
        state = self._flags.state
        acks = [
            ack
            for ack, rate in (
                (status.ack_move_ra, self._latched.ra),
                (status.ack_move_dec, self._latched.dec),
            )
            if rate is not None
        ]
        if self._flags.see(all(acks) if state is Handshake.RAISED else any(acks)):
            self._in_force = _moving(self._in_force)
        elif state is Handshake.RAISED and self._flags.statuses > EDGE_ACK_WITHIN_STATUSES:
            self._flags.happen("withdraw")
            # Neither acknowledged nor refused: unlike any rate, so that whatever is wanted is asked for.
            self._in_force = AxisRates(*(None if rate is None else math.nan for rate in self._in_force))

    def stopped(self) -> None:
        """Note that an abort was acknowledged."""
        self._in_force = NO_RATES

    def renew(self) -> None:
        """Send the next rates even where they are those in force."""
        self._in_force = AxisRates(*(None if rate is None else math.nan for rate in self._in_force))

    def insist(self) -> None:
        """Ask for the end anew: a late copy of an edge was read, and acknowledged, in place of the end."""
        if self.over:
            self._in_force = AxisRates(math.nan, math.nan)


def _moving(rates: AxisRates) -> AxisRates:
    return AxisRates(*(rate or None for rate in rates))


def _ending(in_force: AxisRates) -> AxisRates:
    return AxisRates(*(None if rate is None else 0.0 for rate in in_force))


def _over(before: AxisRates, rates: AxisRates) -> AxisRates:
    return AxisRates(*(old if new is None else new for old, new in zip(before, rates, strict=True)))

"""The flags of a command that move the mount, and their acknowledgements: abort, slew, MoveAxis.

"Xerxes Mount Control Protocol", Details: a one-shot flag rises once, is held until its acknowledgement is
seen, falls, and the mount takes the acknowledgement away. A flag may not rise again before that: the mount
acts on rising edges, and an acknowledgement that still stands, or is still to come, would be taken for the
next.

MoveAxis has two readings, which the protocol leaves open. *Held*: the latest rates act while a flag is up, so
the flags stay up for as long as motion is wanted. *Edge*: rates are read as a flag rises and stay in force
after its fall. The flags then go through the whole handshake for every change, both together where both are
wanted: up with rates that do not change meanwhile, held until acknowledged, down until the acknowledgement
has fallen. Rate 0 ends MoveAxis on its axis.

Each part of the session keeps one state and changes it by `follow` alone, by the transitions in a table; the
protocol's page is written from the tables. A row under ANY holds in every state that has no row of its own
for the event. The states of a request are `requests.TicketState`, those of the link are in `link`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import TYPE_CHECKING, ClassVar, NamedTuple, TypeVar

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sattrack.mount.model import Slew, Status

ANY = None
State = TypeVar("State", bound=Enum)


class Handshake(Enum):
    """Where a one-shot flag stands."""

    IDLE = "idle"
    RAISED = "raised, not acknowledged"
    WITHDRAWN = "fallen before its acknowledgement was seen"
    RELEASING = "acknowledged and fallen"


HANDSHAKE: Mapping[tuple[Handshake | None, str], Handshake] = {
    (Handshake.IDLE, "request"): Handshake.RAISED,
    (Handshake.RAISED, "ack up"): Handshake.RELEASING,
    (Handshake.RAISED, "withdraw"): Handshake.WITHDRAWN,
    (Handshake.WITHDRAWN, "ack up"): Handshake.RELEASING,
    (Handshake.WITHDRAWN, "quiet"): Handshake.IDLE,
    (Handshake.RELEASING, "ack down"): Handshake.IDLE,
}


class SlewState(Enum):
    """Where the slew last asked for stands."""

    NONE = "none"
    WAITING = "waiting for standstill"
    ASKED = "asked"
    LAUNCHED = "acknowledged, not yet seen to move"
    UNDER_WAY = "under way"
    DONE = "done"


SLEW: Mapping[tuple[SlewState | None, str], SlewState] = {
    (SlewState.WAITING, "flag up"): SlewState.ASKED,
    (SlewState.ASKED, "acknowledged"): SlewState.LAUNCHED,
    (SlewState.ASKED, "no answer"): SlewState.WAITING,
    (SlewState.LAUNCHED, "seen to move"): SlewState.UNDER_WAY,
    (SlewState.LAUNCHED, "too short to be seen"): SlewState.DONE,
    (SlewState.UNDER_WAY, "at rest"): SlewState.DONE,
    (ANY, "new target"): SlewState.WAITING,
    (ANY, "dropped"): SlewState.NONE,
}


class StopState(Enum):
    """How far the stop in force, or the last one, has come."""

    ASKED = "not acknowledged"
    HEARD = "acknowledged"
    AGAIN = "sent again after its acknowledgement"


STOP: Mapping[tuple[StopState | None, str], StopState] = {
    (StopState.ASKED, "acknowledged"): StopState.HEARD,
    (StopState.HEARD, "goes again"): StopState.AGAIN,
    (StopState.AGAIN, "acknowledged"): StopState.HEARD,
    (ANY, "asked for"): StopState.ASKED,
    (ANY, "mount restarted"): StopState.ASKED,
}


class HeldState(Enum):
    """Where MoveAxis stands on a mount that holds."""

    OVER = "over"
    RAISED = "flags up, not acknowledged"
    IN_FORCE = "flags up and acknowledged"
    LAPSED = "flags up, acknowledgement fallen"
    ENDING = "flags down, not acknowledged"
    RELEASING = "flags down, acknowledgement stands"


HELD: Mapping[tuple[HeldState | None, str], HeldState] = {
    (HeldState.OVER, "rates"): HeldState.RAISED,
    (HeldState.RAISED, "ack up"): HeldState.IN_FORCE,
    (HeldState.RAISED, "flags down"): HeldState.ENDING,
    (HeldState.RAISED, "quiet"): HeldState.OVER,
    (HeldState.IN_FORCE, "ack down"): HeldState.LAPSED,
    (HeldState.IN_FORCE, "quiet"): HeldState.LAPSED,
    (HeldState.IN_FORCE, "flags down"): HeldState.RELEASING,
    (HeldState.LAPSED, "rates"): HeldState.IN_FORCE,
    (HeldState.LAPSED, "flags down"): HeldState.OVER,
    (HeldState.ENDING, "rates"): HeldState.RAISED,
    (HeldState.ENDING, "ack up"): HeldState.RELEASING,
    (HeldState.ENDING, "quiet"): HeldState.OVER,
    (HeldState.RELEASING, "rates"): HeldState.RAISED,
    (HeldState.RELEASING, "ack down"): HeldState.OVER,
    (HeldState.RELEASING, "quiet"): HeldState.OVER,
}


def follow(table: Mapping[tuple[State | None, str], State], state: State, event: str) -> State:
    """Return the state that follows an event; the same one where the table has no row for it."""
    return table.get((state, event)) or table.get((ANY, event), state)


QUIET_STATUSES = 10
"""Statuses without an acknowledgement after which none is on its way any more: half a second."""
ABORT_AGAIN_TICKS = 8
MISSED_TICKS, DIP_TICKS, LONGEST_MISSED_TICKS = 21, 3, 336
"""After so many datagrams without the abort's acknowledgement its flag is down for a few: a mount that has
missed the edge sees another. The next time it is up for twice as long. A mount that obeys an abort late may
count its delay anew from each edge: what its profile tells of that delay is added to the first time."""
NEVER_SEEN_AFTER = 5
"""Statuses after a slew's acknowledgement without motion that mean it was too short to be seen."""
NEAR_DEG = 0.5
LATEST_BEGIN_STATUSES = 200
ACK_WITHIN_STATUSES = 20
"""Statuses after which a slew that is not acknowledged is asked for anew."""
EDGE_ACK_WITHIN_STATUSES, MUTE_ACK_WITHIN_STATUSES = 20, 4
"""Statuses after which an edge of MoveAxis that is not acknowledged falls; that on a mount that is mute."""
MUTE_QUIET_STATUSES, MUTE_AFTER = 4, 2
"""As QUIET_STATUSES on such a mount, and how many handshakes it leaves unanswered, all from the first on."""
STILL_MOVING_STATUSES, VAIN_ENDS = 20, 2
"""Statuses after which the end of a MoveAxis that goes on is asked for anew, and how often, before an abort
is: some mounts leave MoveAxis by nothing else, and stay in it at rate 0."""
REFUSED_STATUSES, MOST_REFUSED_STATUSES = QUIET_STATUSES, 160
"""Statuses in a row of a mount at rest, which has not acknowledged the flags of MoveAxis, after which these
fall and rise anew; twice as many the next time."""
SLEWS_ON_STATUSES = 200
"""So long the flags may wait for the end of a slew."""


@dataclass(slots=True)
class OneShot:
    """One one-shot flag."""

    state: Handshake = Handshake.IDLE
    statuses: int = 0
    """Statuses seen in this state."""

    @property
    def up(self) -> bool:
        """Whether the flag is up in the next datagram."""
        return self.state is Handshake.RAISED

    def happen(self, event: str) -> bool:
        """Make the transition that the table has for an event; tell whether there is one."""
        before, self.state = self.state, follow(HANDSHAKE, self.state, event)
        if self.state is not before:
            self.statuses = 0
        return self.state is not before

    def see(self, ack: bool, quiet_statuses: int = QUIET_STATUSES) -> bool:
        """Take one status's acknowledgement; tell whether it is the one that the raised flag waits for."""
        self.statuses += 1
        if self.state is Handshake.IDLE:
            return False
        raised = self.up
        acknowledged = self.happen("ack up" if ack else "ack down") and raised
        if self.state is Handshake.WITHDRAWN and self.statuses >= quiet_statuses:
            self.happen("quiet")
        return acknowledged


@dataclass(slots=True)
class AbortFlag:
    """The abort of the stop in force. It goes out again while the mount moves on, and where no answer comes.

    Time is counted in datagrams: in a silence no status must be needed for the flag to rise again.
    """

    late_ticks: int = 0
    """How many datagrams later than any other command an abort acts; no other edge may come before."""
    state: StopState = StopState.ASKED
    flag: OneShot = field(default_factory=OneShot)
    acks_not_ours: int = 0
    """Statuses in a row that acknowledge an abort which we have not sent."""
    _ticks: int = 0
    """Datagrams since the stop was asked for."""
    _raised_ticks: int = 0
    """Datagrams since the flag rose, 0 while it is down."""
    _blind_left: int = 0
    """Datagrams left of an abort of which no acknowledgement can tell, because one stands already."""

    def ask(self) -> None:
        """Begin a stop, or ask for it anew."""
        self.state = follow(STOP, self.state, "asked for")
        self._ticks = 0

    def raise_once(self) -> None:
        """Send an abort that is to end a motion, though no stop is wanted."""
        self.ask()
        self.flag.happen("request")

    def begin_anew(self) -> None:
        """Note a mount that has restarted: it knows of no stop."""
        self.state, self.flag = follow(STOP, self.state, "mount restarted"), OneShot()

    @property
    def on_its_way(self) -> bool:
        """Whether an abort must go on to its end, even where something else is wanted by now."""
        return self.flag.up or self._blind_left > 0

    @property
    def acknowledged(self) -> bool:
        """Whether an abort of this stop was acknowledged, even one that another client sent.

        One that is sent again may go without an answer.
        """
        return self.state is not StopState.ASKED or self.acks_not_ours >= QUIET_STATUSES

    def goes_again(self) -> bool:
        """Send the stop once more to a mount that has set off; tell whether the flag is free for that."""
        stuck = self.flag.state is Handshake.RELEASING and self.flag.statuses > QUIET_STATUSES
        if self.flag.state is not Handshake.IDLE and not stuck:
            return False
        self.state = follow(STOP, self.state, "goes again")
        return True

    def compose(self, ack_stands: bool) -> tuple[bool, bool]:
        """Return whether the flag is up in the next datagram, and whether the stop is being sent.

        `ack_stands` where the last status acknowledges an abort.
        """
        heard = self.state is StopState.HEARD
        if not heard and not ack_stands:
            self.flag.happen("request")
        # An acknowledgement that stands, ours or another's, must not keep a stop from going out, statuses or
        # none: the flag then rises by the count of datagrams.
        standing = not heard and not self.flag.up
        if standing and self._ticks % (ABORT_AGAIN_TICKS + self.late_ticks) == 0:
            self._blind_left = ABORT_AGAIN_TICKS // 2
        again = standing and self._blind_left > 0
        self._blind_left = max(0, self._blind_left - 1) if standing else 0
        self._ticks += 1
        self._raised_ticks = self._raised_ticks + 1 if self.flag.up else 0
        return (self.flag.up and not self._dips) or again, self.flag.up or again

    @property
    def _dips(self) -> bool:
        """Whether a raised flag is down for a moment."""
        left, up = self._raised_ticks, MISSED_TICKS + self.late_ticks
        while left >= up + DIP_TICKS:
            left, up = left - up - DIP_TICKS, min(2 * up, LONGEST_MISSED_TICKS + self.late_ticks)
        return left >= up

    def see(self, ack: bool, wanted: bool) -> bool:
        """Take one status, `wanted` while a stop is; tell whether it acknowledges the stop."""
        heard = self.flag.see(ack)
        if heard:
            self.state = follow(STOP, self.state, "acknowledged")
        missing = wanted and self.state is not StopState.HEARD
        self.acks_not_ours = self.acks_not_ours + 1 if missing and ack else 0
        return heard


@dataclass(slots=True)
class SlewFlag:
    """One slew after the other: asked, launched, seen to move, seen to stand.

    "Xerxes Mount Control Protocol", Details: a status that says "not slewing" may be older than the slew, so
    only those count that came after its acknowledgement; and the mount has arrived when its positions rest. A
    mount may acknowledge a slew some time before it begins: one that was not seen to move has arrived where
    it is near the target, or when it has stood for LATEST_BEGIN_STATUSES.
    """

    state: SlewState = SlewState.NONE
    flag: OneShot = field(default_factory=OneShot)
    target: Slew | None = None
    """Where it goes; None in state NONE."""
    launched_utc_s: float = 0.0
    """When the slew was seen acknowledged."""
    _asked: Slew | None = None
    """The target that the flag rose with: another one wanted meanwhile needs an edge of its own."""
    _statuses: int = 0
    """Statuses since the acknowledgement."""

    def want(self, target: Slew) -> None:
        """Begin a slew, unless it is the one under way."""
        if target != self.target:
            self.target = target
            self._happen("new target")

    def drop(self) -> None:
        """Note that something else is wanted; the flag's handshake goes on to its end."""
        self.target = None
        self._happen("dropped")

    def begin_anew(self) -> None:
        """Note a mount that has restarted: it knows of no slew."""
        self.flag = OneShot()
        if self.target is not None:
            self._happen("new target")

    def compose(self, wanted: Slew, may_rise: bool) -> tuple[bool, Slew]:
        """Return whether the flag is up in the next datagram, and with which target."""
        if may_rise and self.state is SlewState.WAITING and self.flag.happen("request"):
            self._happen("flag up")
            self._asked = wanted
        return self.flag.up, self._asked if self.flag.up and self._asked is not None else wanted

    def see(self, status: Status, arrival_utc_s: float) -> None:
        """Take one status."""
        launched = self.flag.see(status.ack_slew)
        if self.target is None:
            return
        if launched:
            self.launched_utc_s = arrival_utc_s
            self._happen("acknowledged")
        elif self.state is SlewState.ASKED and self.flag.statuses > ACK_WITHIN_STATUSES:
            # The mount missed the edge, or was slewing when it came: fall, and rise again.
            self.flag.happen("withdraw")
            self._happen("no answer")
        if self.state in (SlewState.LAUNCHED, SlewState.UNDER_WAY):
            self._statuses += 1
            if status.slewing:
                self._happen("seen to move")

    def rests(self, off_deg: float) -> None:
        """Note that the mount rests so far from the target, by positions newer than the acknowledgement."""
        self._happen("at rest")
        if self._statuses > (NEVER_SEEN_AFTER if off_deg < NEAR_DEG else LATEST_BEGIN_STATUSES):
            self._happen("too short to be seen")

    def _happen(self, event: str) -> None:
        self.state = follow(SLEW, self.state, event)
        if self.state is SlewState.WAITING:
            self._statuses = 0


class AxisRates(NamedTuple):
    """MoveAxis rates as they go on the wire, degrees per second; None leaves that axis' flag down."""

    ra: float | None
    dec: float | None


NO_RATES = AxisRates(None, None)
UNKNOWN_RATES = AxisRates(math.nan, math.nan)


class Sent(NamedTuple):
    """What one datagram says of MoveAxis; `begins` tells whether these rates are new with it."""

    rates: AxisRates
    begins: bool


@dataclass(slots=True)
class HeldMove:
    """MoveAxis on a mount that holds: the flags stay up while motion is wanted.

    The last status may be older than the last command: what tells that the mount has let go is the
    acknowledgement seen up and then down since, or a silence so long that none is to come.
    """

    waits: ClassVar[int] = 0
    """New rates never wait."""
    state: HeldState = HeldState.OVER
    _statuses: int = 0
    """Statuses since the last datagram with rates."""
    _raised: int = 0
    """Statuses since the flags rose, without an acknowledgement."""
    _refused: int = 0
    """Statuses in a row of a mount that has not taken the flags."""
    _patience: int = REFUSED_STATUSES
    _down_left: int = 0
    """Datagrams that still go without the flags, for them to rise anew."""

    @property
    def over(self) -> bool:
        """Whether the mount no longer moves by MoveAxis, as far as statuses tell."""
        return self.state in (HeldState.OVER, HeldState.LAPSED)

    def compose(self, wish: AxisRates) -> Sent:
        """Return what the next datagram says; NO_RATES asks for the end."""
        if wish == NO_RATES or self._down_left:
            self._down_left = max(0, self._down_left - 1)
            self.hush()
            return Sent(NO_RATES, False)
        self.state, self._statuses = follow(HELD, self.state, "rates"), 0
        return Sent(wish, True)

    def hush(self) -> None:
        """Note a datagram that goes out without the flags."""
        self.state = follow(HELD, self.state, "flags down")

    @property
    def may_wait(self) -> bool:
        """Whether a mount that slews, and has acknowledged nothing, may take the flags when it has slewed."""
        return 0 < self._raised < SLEWS_ON_STATUSES

    def rests(self, rests: bool) -> None:
        """Note whether the mount rests for all that is asked of it.

        It may have slewed as the flags rose, and have refused them: then it waits for another edge.
        """
        if self.state is HeldState.IN_FORCE:
            self._patience = REFUSED_STATUSES
        if self.state is not HeldState.ENDING:
            self._raised = self._raised + 1 if self.state is HeldState.RAISED else 0
        self._refused = self._refused + 1 if rests and self.state is HeldState.RAISED else 0
        if self._refused >= self._patience:
            self._refused, self._down_left = 0, DIP_TICKS
            self._patience = min(2 * self._patience, MOST_REFUSED_STATUSES)

    def see(self, status: Status) -> bool:
        """Take one status; tell whether it acknowledges the flags that were raised."""
        if self.over:
            return False
        self._statuses += 1
        up, raised = status.ack_move_ra or status.ack_move_dec, self.state is HeldState.RAISED
        self.state = follow(HELD, self.state, "ack up" if up else "ack down")
        acknowledged = raised and self.state is HeldState.IN_FORCE
        if self._statuses >= QUIET_STATUSES and not self.over:
            self.state = follow(HELD, self.state, "quiet")
        return acknowledged

    def stopped(self) -> None:
        """Note that an abort was acknowledged: flags that are down have let go already."""

    def insist(self) -> None:
        """Ask for the end anew: nothing to do, for the same reason."""

    def renew(self) -> None:
        """Send the next rates even where they are those in force: every datagram has them."""


@dataclass(slots=True)
class EdgeAnswers:
    """How a mount that reads edges answers them, as far as its handshakes have told."""

    ever: bool = False
    """Whether any was acknowledged."""
    missed: int = 0
    """Handshakes in a row that were not."""

    @property
    def mute(self) -> bool:
        """Whether the mount answers none: then an edge is up and down for as long as it takes to be read."""
        return not self.ever and self.missed >= MUTE_AFTER

    @property
    def within_statuses(self) -> int:
        """How many statuses an edge waits for its acknowledgement."""
        return MUTE_ACK_WITHIN_STATUSES if self.mute else EDGE_ACK_WITHIN_STATUSES

    @property
    def quiet_statuses(self) -> int:
        """How many statuses without an acknowledgement show that none is to come."""
        return MUTE_QUIET_STATUSES if self.mute else QUIET_STATUSES

    @property
    def unanswered_statuses(self) -> int:
        """How long the next handshake takes if it is not answered, in statuses; 0 where it will be.

        Before the first was answered, and after one that was not, the next may not be, either.
        """
        sure = self.ever and not self.missed
        return 0 if sure else self.within_statuses + self.quiet_statuses + 2

    def take(self, acknowledged: bool) -> None:
        """Note how a handshake ended."""
        self.ever = self.ever or acknowledged
        self.missed = 0 if acknowledged else self.missed + 1


@dataclass(slots=True)
class EdgeMove:
    """MoveAxis on a mount that reads edges: every change of rate is an edge of its own."""

    answers: EdgeAnswers = field(default_factory=EdgeAnswers)
    """What earlier handshakes tell of the next."""
    waits: int = 0
    """Datagrams for which new rates have waited for the handshake of those before."""
    _flags: OneShot = field(default_factory=OneShot)
    _latched: AxisRates = NO_RATES
    _in_force: AxisRates = NO_RATES
    _unanswered: int = 0
    """Statuses since flags rose of which none were acknowledged."""

    @property
    def may_wait(self) -> bool:
        """Whether a mount that slews, and has acknowledged nothing, may take an edge when it has slewed."""
        return 0 < self._unanswered < SLEWS_ON_STATUSES

    @property
    def over(self) -> bool:
        """Whether the mount no longer moves by MoveAxis, as far as statuses tell."""
        return self._in_force == NO_RATES and self._flags.state is Handshake.IDLE

    def compose(self, wish: AxisRates) -> Sent:
        """Return what the next datagram says; NO_RATES asks for the end."""
        begins = False
        self.waits = 0 if self._flags.state is Handshake.IDLE or wish == self._latched else self.waits + 1
        if self._flags.state is Handshake.IDLE:
            # What is wanted is wanted whole: an axis that it does not name has its motion ended.
            ending = AxisRates(*(None if rate is None else 0.0 for rate in self._in_force))
            rates = _over(ending, wish)
            if _moving(_over(self._in_force, rates)) != self._in_force:
                begins = self._flags.happen("request")
                self._latched = rates
                # From here on the mount may have them, whether or not we hear of it.
                self._in_force = _over(self._in_force, rates)
        return Sent(self._latched if self._flags.up else NO_RATES, begins)

    def hush(self) -> None:
        """Note a datagram without the flags."""
        self._flags.happen("withdraw")

    def see(self, status: Status) -> bool:
        """Take one status; tell whether it acknowledges the flags that were raised."""
        state = self._flags.state
        acks = [
            ack
            for ack, rate in (
                (status.ack_move_ra, self._latched.ra),
                (status.ack_move_dec, self._latched.dec),
            )
            if rate is not None
        ]
        # Too late, or of one axis only: it is not mute, and is given its time.
        self.answers.ever = self.answers.ever or (any(acks) and state is not Handshake.IDLE)
        ack = all(acks) if state is Handshake.RAISED else any(acks)
        waiting = not self.over and (self._unanswered > 0 or self._flags.up)
        self._unanswered = self._unanswered + 1 if waiting else 0
        if self._flags.see(ack, self.answers.quiet_statuses):
            self._unanswered = 0
            self._in_force = _moving(self._in_force)
            self.answers.take(True)
            return True
        if state is Handshake.RAISED and self._flags.statuses > self.answers.within_statuses:
            self._flags.happen("withdraw")
            self.answers.take(False)
            self.renew()
        return False

    def rests(self, rests: bool) -> None:
        """Note whether the mount rests for all that is asked of it: an edge without an answer goes anew."""

    def stopped(self) -> None:
        """Note that an abort was acknowledged: nothing is in force any more."""
        self._in_force = NO_RATES

    def renew(self) -> None:
        """Send the next rates even where they are those in force: what is unknown is unlike any rate."""
        self._in_force = AxisRates(*(None if rate is None else math.nan for rate in self._in_force))

    def insist(self) -> None:
        """Ask for the end anew: a late copy of an edge was read, and acknowledged, in place of the end."""
        if self.over:
            self._in_force = UNKNOWN_RATES


def _moving(rates: AxisRates) -> AxisRates:
    return AxisRates(*(rate or None for rate in rates))


def _over(before: AxisRates, rates: AxisRates) -> AxisRates:
    return AxisRates(*(old if new is None else new for old, new in zip(before, rates, strict=True)))


class Again(Enum):
    """What a MoveAxis that goes on after its end needs."""

    NOTHING = auto()
    END = auto()
    ABORT = auto()


@dataclass(slots=True)
class MoveWatch:
    """Whether the mount moves on after the end of a MoveAxis of ours; nobody else's motion is ended."""

    ours: bool = False
    """Whether the mount may still be in a MoveAxis of ours."""
    _going_on: int = 0
    """Statuses in a row with Slewing though nothing of ours should make the mount move."""

    def see(self, over: bool, slewing: bool, unwanted: bool) -> Again:
        """Take one status; tell what must be asked for anew."""
        self.ours = self.ours and not (over and not slewing)
        self._going_on = self._going_on + 1 if unwanted else 0
        if not self._going_on or self._going_on % STILL_MOVING_STATUSES or not self.ours:
            return Again.NOTHING
        return Again.END if self._going_on <= VAIN_ENDS * STILL_MOVING_STATUSES else Again.ABORT

"""The client's side of the Xerxes protocol as a state machine without I/O: bytes and instants in, bytes out.

Rules, from "Xerxes Mount Control Protocol", Details and Theory of Operation:

1. A datagram goes out every period, whether or not anything changed.
2. A one-shot flag rises once, is held until its acknowledgement is seen, falls, and may not rise again before
   the acknowledgement has fallen.
3. MoveAxis flags follow the profile: held up for as long as motion is wanted, or an edge for every change.
4. A slew is ignored while Slewing is true, and MoveAxis makes it true: end MoveAxis, see it fall, then slew.
5. "Not slewing" counts only in a status that came after the slew's acknowledgement.
6. An abort outranks everything: no other flag is up beside it.

The paper leaves the order of priorities open. So that it never matters, one flag is up at a time (both of
MoveAxis count as one), and between two one-shots nothing is up for QUIET_TICKS: a datagram that comes late
then repeats a request that the mount has just obeyed, not one that something else has replaced.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.angles import separation_deg
from sattrack.mount.model import (
    DTICS_S_PER_DEG_S,
    SIDEREAL_RATE_DEG_S,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    Readings,
    Slew,
    StatusSample,
    Stop,
    stance_of,
)
from sattrack.mount.requests import (
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    TicketState,
)
from sattrack.mount.xerxes.datagrams import (
    DOUBTFUL,
    Command,
    DatagramError,
    decode_status,
    encode_command,
    status_readings,
)
from sattrack.mount.xerxes.flags import (
    NEAR_DEG,
    NO_RATES,
    AbortFlag,
    Again,
    AxisRates,
    EdgeAnswers,
    EdgeMove,
    Handshake,
    HeldMove,
    MoveWatch,
    SlewFlag,
    SlewState,
    StopState,
)
from sattrack.mount.xerxes.link import AckWatch, LinkHealth, LinkState, StatusSequence
from sattrack.mount.xerxes.standstill import SURELY_MOVES_DEG_S, Standstill
from sattrack.mount.xerxes.tickets import Launchable, Launches, MotionTicket

if TYPE_CHECKING:
    from sattrack.mount.geometry import AxisFrame
    from sattrack.mount.model import Cleared, Stance, Status
    from sattrack.mount.requests import ClearedRequest

QUIET_TICKS = 4
READINGS_EVERY = 20
REPEAT_AFTER_PERIODS = 0.25
"""When the copy goes, in periods after the datagram, which itself comes half a period before the mount looks:
late enough to escape what took the first, and early enough for any timer of the mount."""
STREAMING_TICKS = 5
"""Datagrams in a row that say nothing but rates, before one of them is repeated: what came before is over."""
MARK_EVERY_S = 1.0
MARKS = 30
"""Statuses missing within so many seconds tell that the link loses datagrams."""
NEVER_ZERO_DEG_S = 1e-9
"""What an edge mount with absolute rates is sent to stand still: 0 would end MoveAxis."""
STANDS_DEG_S = 1e-6
"""What a telescope behind a gateway is sent for its first axis to stand still: after a rate of 0 it would
track. It comes to 0.09° a day; drivers that cannot go so slowly stop the motor."""
DESCRIBED = (
    "altitude_deg",
    "azimuth_deg",
    "site_height_m",
    "site_latitude_deg",
    "site_longitude_deg",
    "target_dec_deg",
    "target_ra_h",
    "dec_guide_rate_dtics_s",
    "ra_guide_rate_dtics_s",
)
"""Numbers of a status that decide nothing; those that are none become None."""
_described = attrgetter(*DESCRIBED)
_others = attrgetter("abort", "sync", "pulse_guide", "park", "find_home", "move_ra", "move_dec")


@dataclass(slots=True)
class Repeats:
    """Keeps the last datagram, and tells whether it goes out once more: a loss must not leave old rates.

    The mount keeps the latest datagram only and looks at it once a turn of its loop ("Xerxes Mount Control
    Protocol", Theory of Operation), so a copy of the one that is there changes nothing. That holds for rates
    on a *held* mount alone: with a one-shot flag up, or rates that are read on an edge, a copy that comes
    late is a second rising edge.
    """

    profile: MountProfile
    _datagram: bytes | None = None
    _streaming: int = 0
    _marks: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=MARKS))
    """Instants, and how many statuses had been lost by then."""

    def sent(self, command: Command, datagram: bytes) -> None:
        """Take a datagram that goes out, and what it says."""
        rates = command.move_ra or command.move_dec
        once = command.abort or command.slew or command.sync or command.park or command.find_home
        self._streaming = self._streaming + 1 if rates and not (once or command.pulse_guide) else 0
        self._datagram = datagram

    def see(self, arrival_utc_s: float, lost: int) -> None:
        """Take notice of a status, and of how many have been lost so far."""
        if not self._marks or arrival_utc_s - self._marks[-1][0] >= MARK_EVERY_S:
            self._marks.append((arrival_utc_s, lost))

    def copy(self, lost: int) -> bytes | None:
        """Return the last datagram where it goes out once more, else None."""
        policy = self.profile.repeat_rates
        if policy == "never" or self.profile.move_axis != "held" or self._streaming < STREAMING_TICKS:
            return None
        lossy = bool(self._marks) and lost > self._marks[0][1]
        return self._datagram if lossy or policy == "always" else None


@dataclass(slots=True)
class Session:
    """One client's conversation with one mount; `profile` settles what the paper leaves open."""

    profile: MountProfile
    health: LinkHealth = field(default_factory=LinkHealth)
    status: Status | None = None
    """The last accepted status; of fields that mean nothing (`ignored_fields`), what positions say."""
    sample: StatusSample | None = None
    readings: Readings = field(default_factory=Readings)
    """Types of the doubtful fields, as far as statuses have shown them."""
    begun_move: MoveAxes | None = None
    """The MoveAxis motion that the last datagram began, None where it began none."""
    _frame: AxisFrame | None = field(init=False)
    _sequence: StatusSequence = field(init=False)
    _acks: AckWatch = field(init=False)
    _answers: EdgeAnswers = field(default_factory=EdgeAnswers)
    _move: HeldMove | EdgeMove = field(init=False)
    _launches: Launches = field(init=False)
    _signs: tuple[tuple[int, int], tuple[int, int]] = field(init=False)
    """Of the axes' rates, short of the pole and beyond it."""
    _repeats: Repeats = field(init=False)
    _wanted: Motion = field(default_factory=Hold)
    _move_axes: tuple[bool, bool] = (True, True)
    """Which axes' flags MoveAxis uses."""
    _move_watch: MoveWatch = field(default_factory=MoveWatch)
    _abort: AbortFlag = field(default_factory=AbortFlag)
    _slew: SlewFlag = field(default_factory=SlewFlag)
    _standstill: Standstill = field(default_factory=Standstill)
    _motion_ticket: MotionTicket | None = None
    _acts_until: int = 0
    """Count of datagrams by which an acknowledged abort acts; 0 once anything that moves was asked for."""
    _since_slew_ticks: int = QUIET_TICKS
    _since_other_ticks: int = QUIET_TICKS

    def __post_init__(self) -> None:
        """Begin to count statuses."""
        self._frame = self.profile.frame
        late = math.ceil(self.profile.abort_delay_s / self.profile.period_s)
        self._standstill.late_statuses = self._abort.late_ticks = late
        self._sequence = StatusSequence(self.health)
        self._acks = AckWatch(self.health)
        self._launches = Launches(self.profile)
        self._signs = self.profile.signs(False), self.profile.signs(True)
        self._repeats = Repeats(self.profile)
        self._move = self._make_move()

    def _make_move(self) -> HeldMove | EdgeMove:
        return EdgeMove(self._answers) if self.profile.move_axis == "edge" else HeldMove()

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram; return its sample, or None where it was refused and counted."""
        try:
            status = decode_status(data)
        except DatagramError:
            self.health.rejected += 1
            return None
        if self._frame is not None and self._frame.geometry.reports == "horizon":
            status = _by_horizon(status, self._frame)
        if not _plausible(status):
            self.health.rejected += 1
            return None
        if self._is_frozen(status):
            self.health.freeze()
            return None
        restarts = self.health.restarts
        if not self._sequence.is_news(status.counter, arrival_utc_s):
            return None
        if self.health.restarts > restarts:
            self._begin_anew()
        if self.health.received % READINGS_EVERY == 0:
            self._read_types(data)
        self.health.received += 1
        self._repeats.see(arrival_utc_s, self.health.lost)
        sample = StatusSample(
            counter=status.counter,
            arrival_utc_s=arrival_utc_s,
            sidereal_h=status.sidereal_h,
            ra_deg=status.ra_h * 15.0,
            dec_deg=status.dec_deg,
            slewing=status.slewing,
            does_refraction=status.does_refraction,
            ra_drive_deg_s=status.ra_rate_dtics_s / DTICS_S_PER_DEG_S,
            dec_drive_deg_s=status.dec_rate_dtics_s / DTICS_S_PER_DEG_S,
            beyond_pole=status.side_of_pier,
        )
        may_move = not self._move.over or status.ack_move_ra or status.ack_move_dec
        goal = self._slew.target
        arrived = goal is not None and _off_target_deg(goal, status) < NEAR_DEG
        self.sample = self._standstill.see(sample, self._abort.state is StopState.HEARD, may_move, arrived)
        self.status = _made_good(status, sample, self.sample)
        self._follow_acknowledgements(self.status, arrival_utc_s)
        return self.sample

    def _is_frozen(self, status: Status) -> bool:
        """Tell whether a mount in motion sends the same again: that is no news of where it is.

        A moving axis and a clock that runs never give the same three numbers twice. Once they do, the end of
        the motion makes no news of them either.
        """
        last = self.status
        moves = isinstance(self._wanted, MoveAxes) or self.health.froze
        return last is not None and moves and says_the_same(status, last)

    def apply(self, cleared: Cleared) -> None:
        """Make a motion that safety has cleared the one that is wanted from the next datagram on."""
        motion = cleared.motion
        if self._motion_ticket is not None and type(motion) is not type(self._wanted):
            self._supersede("another motion was asked for")
        if not isinstance(motion, Hold):
            self._launches.supersede("a motion was asked for")
        if not (isinstance(motion, MoveAxes) and isinstance(self._wanted, MoveAxes)):
            self._move_axes = (True, True)
        self._want(motion)

    def submit(self, cleared: ClearedRequest) -> Ticket:
        """Take one request that safety has cleared; return its ticket, which follows it to its end."""
        ticket = Ticket(cleared.request)
        motion = self._motion_of(cleared.request)
        if motion is None:
            self._launches.submit(ticket)
            self._acts_until = 0
            return ticket
        self._supersede("another motion was asked for")
        if not isinstance(cleared.request, EndMove):
            self._launches.supersede("a motion was asked for")
        self._motion_ticket = MotionTicket(ticket, self.profile)
        self._want(motion)
        return ticket

    def compose(self) -> bytes:
        """Return the next datagram to send."""
        self.health.sent += 1
        self.begun_move = None
        self._launches.tick()
        self._make_way()
        command = self._next_command()
        self._acks.sent(command)
        self._since_other_ticks = 0 if True in _others(command) else self._since_other_ticks + 1
        self._since_slew_ticks = 0 if command.slew else self._since_slew_ticks + 1
        if self._motion_ticket is not None and self._motion_ticket.tick():
            # Given up: nothing of it may go on being asked for behind the caller's back.
            self._want(Hold() if not isinstance(self._wanted, Stop) else self._wanted)
        datagram = encode_command(command)
        self._repeats.sent(command, datagram)
        return datagram

    def repeat(self) -> bytes | None:
        """Return the last datagram where it is to go out once more before the next, else None."""
        copy = self._repeats.copy(self.health.lost) if isinstance(self._wanted, MoveAxes) else None
        self.health.repeated += copy is not None
        return copy

    def clock_set(self, step_s: float) -> None:
        """Take notice that instants from now on are by a clock that was set ahead by so much."""
        self._standstill.clock_set(step_s)

    def link_state(self, now_utc_s: float) -> LinkState:
        """Return the state of the link at an instant."""
        return self.health.look(now_utc_s)

    @property
    def slew_state(self) -> SlewState:
        """Where the slew last asked for stands; NONE once anything else was asked for."""
        return self._slew.state

    @property
    def wanted(self) -> Motion:
        """The motion that is wanted."""
        return self._wanted

    @property
    def move_over(self) -> bool:
        """Whether the mount no longer moves by MoveAxis, as far as statuses tell."""
        return self._move.over

    @property
    def rates_wait_s(self) -> float:
        """For how long new rates have waited for a mount that takes them by edges; 0 for any other."""
        return self._move.waits * self.profile.period_s

    @property
    def unanswered_s(self) -> float:
        """For how long new rates may wait for a handshake that the mount does not answer; 0 where it does.

        Statuses are counted, of which the link may lose as many as by three sigmas of chance.
        """
        statuses = self._answers.unanswered_statuses if isinstance(self._move, EdgeMove) else 0
        if not statuses:
            return 0.0
        lost = self.health.lost / max(1, self.health.received)
        mean, variance = (1.0 + lost) * statuses, lost * (1.0 + lost) * statuses
        return (mean + 3.0 * math.sqrt(variance)) * self.profile.period_s

    @property
    def fine_rate(self) -> FineRate:
        """The fine rates that every datagram asks for."""
        return self._launches.fine_rate

    @property
    def busy(self) -> bool:
        """Whether a request waits or is under way."""
        motion = self._motion_ticket
        return self._launches.busy or (motion is not None and not motion.ticket.settled)

    @property
    def intruder(self) -> str | None:
        """A warning of another sender to the same mount; None without a sign of one."""
        return self._acks.intruder

    @property
    def stopped(self) -> bool:
        """Whether the stop asked for was acknowledged, and positions have shown rest since."""
        return self._abort.acknowledged and isinstance(self._wanted, Stop) and self._standstill.stopped

    @property
    def at_rest(self) -> bool:
        """Whether the mount stands or follows the sky, by its positions."""
        return self._standstill.at_rest

    @property
    def waits_for_slew(self) -> bool:
        """Whether the mount says that it slews, rests, and has not taken the rates: it may after the slew."""
        status = self.status
        slews = self._move.may_wait and status is not None and status.slewing
        return slews and self._standstill.positions.rest() is not None

    @property
    def surely_moves(self) -> bool:
        """Whether positions show a motion that no rest ends in."""
        return self._standstill.surely_moves

    @property
    def stands(self) -> bool:
        """Whether the mount stands, by its positions: it does not follow the sky."""
        return self._standstill.stands

    @property
    def stance(self) -> Stance | None:
        """How the mount stands, by its axes, for safety to judge; None before the first status."""
        if self.status is None:
            return None
        return stance_of(self.status, self._standstill.at_rest, self._frame)

    def taken_over(self) -> None:
        """Note that the mount may have been moving before its first status."""
        self._standstill.positions.may_have_moved = True

    @property
    def ignored_fields(self) -> tuple[str, ...]:
        """Which fields of the status are not used because positions contradict them, and why, in words."""
        ignored = self._standstill.fields.ignored
        return tuple(f"the mount's {name} {why}: positions are used instead" for name, why in ignored.items())

    def _want(self, motion: Motion) -> None:
        if isinstance(motion, Slew):
            self._slew.want(motion)
        else:
            self._slew.drop()
        if not isinstance(motion, Stop | Hold):
            self._acts_until = 0
        elif isinstance(motion, Stop) and not isinstance(self._wanted, Stop):
            if not self._abort_acts_later:
                self._abort.ask()
            self._standstill.asked()
        self._wanted = motion

    @property
    def _abort_acts_later(self) -> bool:
        """Whether an abort was acknowledged and is yet to act: sent again, the mount might count anew."""
        return self._abort.state is StopState.HEARD and self.health.sent < self._acts_until

    def _motion_of(self, request: Request) -> Motion | None:
        """Return the motion that a request makes the wanted one; None for those that are launched beside."""
        match request:
            case Slew():
                # A new slew to the same place is one all the same.
                self._slew.drop()
                return request
            case Abort():
                # Asked for again, it is sent again; and nothing that moves an axis outlasts it.
                if not self._abort_acts_later:
                    self._abort.ask()
                self._launches.fine_rate = FineRate()
                return Stop()
            case MoveAxis():
                self._move.renew()
                return self._joined(request)
            case EndMove():
                return Hold()
        return None

    def _joined(self, request: MoveAxis) -> MoveAxes:
        """Return a request's rates with those in force on the axis that it leaves alone."""
        before, axes = MoveAxes(0.0, 0.0), (False, False)
        if isinstance(self._wanted, MoveAxes):
            before, axes = self._wanted, self._move_axes
        ra, dec = request.ra_rate_deg_s, request.dec_rate_deg_s
        self._move_axes = (axes[0] or ra is not None, axes[1] or dec is not None)
        return request.after(before)

    def _supersede(self, reason: str) -> None:
        if self._motion_ticket is not None and not self._motion_ticket.ticket.settled:
            self._motion_ticket.ticket.become(TicketState.SUPERSEDED, reason)
        self._motion_ticket = None

    def _begin_anew(self) -> None:
        """Forget what a mount that has restarted cannot know of."""
        # Whether it answers handshakes at all is a matter of its program.
        self._move = self._make_move()
        self._abort.begin_anew()
        self._acts_until = 0
        self._slew.begin_anew()
        self._launches.begin_anew()
        self._acks.forget()
        motion = self._motion_ticket
        if motion is not None and motion.ticket.state in {TicketState.RAISED, TicketState.ACKNOWLEDGED}:
            motion.ticket.become(TicketState.FAILED, "the mount restarted meanwhile")
            if not isinstance(self._wanted, Stop):
                self._want(Hold())

    def _make_way(self) -> None:
        """Let go of a motion that is done where another request waits for the mount."""
        if not self._launches.busy or self._abort.flag.up:
            return
        if self.stopped or self.slew_state is SlewState.DONE:
            self._want(Hold())

    def _next_command(self) -> Command:
        if self._abort.on_its_way or isinstance(self._wanted, Stop):
            # An abort that is on its way goes on to its end, even where something else is wanted by now.
            self._move.hush()
            return self._compose_stop()
        if isinstance(self._wanted, MoveAxes):
            self._slew.flag.happen("withdraw")
            return self._compose_move(self._wire_rates(self._wanted), self._wanted)
        ending = self._compose_move(NO_RATES, MoveAxes(0.0, 0.0))
        if ending.move_ra or ending.move_dec:
            return ending
        if isinstance(self._wanted, Slew):
            return self._compose_slew(self._wanted)
        self._slew.flag.happen("withdraw")
        self._note_sent(True)
        return self._compose_launch()

    def _command(self, **fields: Any) -> Command:
        fine = self._launches.fine_rate
        return Command(
            counter=self.health.sent,
            ra_fine_rate_dtics_s=round(fine.ra_deg_s * DTICS_S_PER_DEG_S),
            dec_fine_rate_dtics_s=round(fine.dec_deg_s * DTICS_S_PER_DEG_S),
            tracking_rate=self._launches.tracking_rate,
            **fields,
        )

    def _note_sent(self, sent: bool) -> None:
        """Note whether this datagram brings the motion that was asked for."""
        if self._motion_ticket is not None and sent:
            self._motion_ticket.sent = True

    def _compose_stop(self) -> Command:
        self._slew.flag.happen("withdraw")
        if self._standstill.goes_again and not self._abort_acts_later and self._abort.goes_again():
            self._standstill.again(0.0 if self.sample is None else self.sample.arrival_utc_s)
        up, sent = self._abort.compose(self.status is not None and self.status.ack_abort)
        self._note_sent(sent or self._abort.state is StopState.HEARD)
        return self._command(abort=up)

    def _compose_move(self, wish: AxisRates, meant: MoveAxes) -> Command:
        rates, begins = self._move.compose(wish)
        self._move_watch.ours = self._move_watch.ours or rates != NO_RATES
        if begins:
            self.begun_move = meant
        self._note_sent(begins)
        return self._command(
            move_ra=rates.ra is not None,
            move_dec=rates.dec is not None,
            move_ra_rate_deg_s=rates.ra or 0.0,
            move_dec_rate_deg_s=rates.dec or 0.0,
        )

    def _wire_rates(self, move: MoveAxes) -> AxisRates:
        profile = self.profile
        ra_sign, dec_sign = self._signs[self.status is not None and self.status.side_of_pier]
        westward = (0.0 if profile.additive else SIDEREAL_RATE_DEG_S) - move.ra_rate_deg_s
        ra = ra_sign * westward / profile.ra_rate_gain
        dec = dec_sign * move.dec_rate_deg_s / profile.dec_rate_gain
        if profile.additive and self._frame is not None and self._frame.geometry.reports != "axes":
            first, second = self._tracking_deg_s(self._frame)
            ra = ra_sign * (SIDEREAL_RATE_DEG_S - move.ra_rate_deg_s - first) / profile.ra_rate_gain
            dec = dec_sign * (move.dec_rate_deg_s - second) / profile.dec_rate_gain
        if profile.move_axis == "edge" and not profile.additive:
            ra = ra or NEVER_ZERO_DEG_S
        elif profile.behind_gateway and not profile.additive and self._frame is None:
            ra = ra if abs(ra) > STANDS_DEG_S else STANDS_DEG_S
        return AxisRates(ra if self._move_axes[0] else None, dec if self._move_axes[1] else None)

    def _tracking_deg_s(self, frame: AxisFrame) -> tuple[float, float]:
        """Return the rates of both axes by which the mount tracks the sky, to which it adds MoveAxis."""
        status = self.status
        if status is None:
            return SIDEREAL_RATE_DEG_S, 0.0
        hour_angle_deg = 15.0 * (status.sidereal_h - status.ra_h)
        own = frame.angles(hour_angle_deg, status.dec_deg, SIDEREAL_RATE_DEG_S, 0.0)
        return own.first_rate_deg_s, own.second_rate_deg_s

    def _compose_slew(self, wanted: Slew) -> Command:
        status = self.status
        # A late slew does not hurt another: the mount ignores it while it slews.
        quiet = self._since_other_ticks >= QUIET_TICKS
        standing = status is not None and self._move.over and not status.slewing and not status.ack_slew
        up, target = self._slew.compose(wanted, quiet and standing)
        self._note_sent(up)
        return self._command(slew=up, target_ra_h=target.ra_deg % 360.0 / 15.0, target_dec_deg=target.dec_deg)

    def _compose_launch(self) -> Command:
        status = self.status
        idle = self._abort.flag.state is self._slew.flag.state is Handshake.IDLE
        standing = status is not None and not status.slewing and self._move.over
        quiet = min(self._since_slew_ticks, self._since_other_ticks) >= QUIET_TICKS
        clear = idle and standing and quiet
        return self._command(**_launch_fields(self._launches.compose(clear, status, self.at_rest)))

    def _read_types(self, data: bytes) -> None:
        seen = status_readings(data)
        self.readings = Readings(*(getattr(seen, name) or getattr(self.readings, name) for name in DOUBTFUL))

    def _progress(self, request: Request, status: Status) -> tuple[bool, bool]:
        """Return whether the mount has acknowledged a motion that was asked for, and whether it is done."""
        match request:
            case Slew():
                state = self._slew.state
                launched = (SlewState.LAUNCHED, SlewState.UNDER_WAY, SlewState.DONE)
                return state in launched, state is SlewState.DONE
            case Abort():
                return self._abort.state is StopState.HEARD, self.stopped
            case MoveAxis():
                ra, dec = self._move_axes
                acknowledged = (status.ack_move_ra or not ra) and (status.ack_move_dec or not dec)
                moving = acknowledged and isinstance(self._wanted, MoveAxes)
                return moving, moving
        # Fine rates that the mount was given keep it from rest, and the end of a move does not end them.
        rests = self.at_rest or self.fine_rate != FineRate()
        return False, self._move.over and not status.slewing and rests

    def _follow_acknowledgements(self, status: Status, arrival_utc_s: float) -> None:
        self._acks.see(status)
        unwanted = self._slew.state is SlewState.WAITING or isinstance(self._wanted, Hold)
        goes_on = status.slewing and not self._standstill.slowing
        again = self._move_watch.see(self._move.over, status.slewing, goes_on and unwanted)
        if again is Again.END:
            self._move.insist()
        elif again is Again.ABORT and not self._abort_acts_later:
            self._abort.raise_once()
        if self._move.see(status) and self.sample is not None:
            self.sample = msgspec.structs.replace(self.sample, move_acknowledged=True)
        self._move.rests(_is_fast(self._wanted) and self._standstill.at_rest)
        if self._abort.see(status.ack_abort, isinstance(self._wanted, Stop)):
            self._standstill.acknowledged(arrival_utc_s)
            self._acts_until = self.health.sent + self._abort.late_ticks
            self._move.stopped()
        if self._abort.acks_not_ours == 1:
            self._standstill.acknowledged(arrival_utc_s)
        self._slew.see(status, arrival_utc_s)
        if self._slew.target is not None and self._standstill.rests_since(self._slew.launched_utc_s):
            self._slew.rests(_off_target_deg(self._slew.target, status))
        self._launches.see(status)
        if self._motion_ticket is not None:
            off_deg = _off_target_deg(self._wanted, status) if isinstance(self._wanted, Slew) else None
            self._motion_ticket.see(*self._progress(self._motion_ticket.ticket.request, status), off_deg)


def _is_fast(motion: Motion) -> bool:
    """Tell whether axes at rest contradict a motion."""
    if not isinstance(motion, MoveAxes):
        return False
    hour_angle_rate = SIDEREAL_RATE_DEG_S - motion.ra_rate_deg_s
    return max(abs(hour_angle_rate), abs(motion.dec_rate_deg_s)) > SURELY_MOVES_DEG_S


def _launch_fields(request: Launchable | None) -> dict[str, float | bool]:
    match request:
        case Sync():
            return {"sync": True, "target_ra_h": request.ra_deg / 15.0, "target_dec_deg": request.dec_deg}
        case PulseGuide():
            return {"pulse_guide": True, "pulse_ra_ms": request.ra_ms, "pulse_dec_ms": request.dec_ms}
        case FindHome():
            return {"find_home": True}
        case Park():
            return {"park": True}
    # Fine rates and the tracking rate are levels, in every datagram.
    return {}


def _off_target_deg(target: Slew, status: Status) -> float:
    return separation_deg(target.ra_deg, target.dec_deg, status.ra_h * 15.0, status.dec_deg)


def says_the_same(status: Status, last: Status) -> bool:
    """Tell whether a new status repeats the clock and the place of the last one."""
    return (
        status.sidereal_h == last.sidereal_h
        and status.ra_h == last.ra_h
        and status.dec_deg == last.dec_deg
        and status.counter != last.counter
    )


def _by_horizon(status: Status, frame: AxisFrame) -> Status:
    """Return a status with right ascension and declination by its azimuth and altitude, and its own clock.

    Without those two the declination is none.
    """
    azimuth, altitude = status.azimuth_deg, status.altitude_deg
    if azimuth is None or altitude is None or not (math.isfinite(azimuth) and abs(altitude) <= 90.0):
        return msgspec.structs.replace(status, dec_deg=math.nan)
    hour_angle_deg, dec_deg = frame.of_horizon(azimuth, altitude)
    ra_h = (status.sidereal_h - hour_angle_deg / 15.0) % 24.0
    return msgspec.structs.replace(status, ra_h=ra_h, dec_deg=dec_deg)


def _plausible(status: Status) -> bool:
    """Tell whether the numbers that decide anything are finite and within their ranges."""
    return 0.0 <= status.ra_h <= 24.0 and -90.0 <= status.dec_deg <= 90.0 and 0.0 <= status.sidereal_h <= 24.0


def _made_good(status: Status, reported: StatusSample, believed: StatusSample) -> Status:
    """Return a status with what is believed in place of fields that mean nothing."""
    changes: dict[str, Any] = {}
    if not all(map(math.isfinite, _described(status))):
        changes = {name: None for name in DESCRIBED if not math.isfinite(getattr(status, name))}
    if believed is not reported:
        changes |= {
            "ra_rate_dtics_s": believed.ra_drive_deg_s * DTICS_S_PER_DEG_S,
            "dec_rate_dtics_s": believed.dec_drive_deg_s * DTICS_S_PER_DEG_S,
            "slewing": believed.slewing,
        }
    return msgspec.structs.replace(status, **changes) if changes else status

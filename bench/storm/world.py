"""The world of a storm: one heap of instants, in which the program's own loop runs as it does in real time.

What the program asks of its machine (`time`, `select`, the socket, the guardian's page, the disk) is the
world's. `select` is where time passes: it runs the world on until the loop would be awake again. So the loop,
the engine, the arbiter, the recorder and the guardian are the program's own, and nothing waits.
"""

from __future__ import annotations

import heapq
import io
import math
import random
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest.mock import patch

import msgspec

from sattrack.core.clock import SystemClock
from sattrack.core.errors import SattrackError
from sattrack.mount.xerxes.client import Address, Arrival
from sattrack.mount.xerxes.datagrams import Command, decode_command, decode_status, encode_command
from sattrack.recording.recorder import NoRecording, Recorder
from sattrack.runtime.connection import HANG_AFTER_S, Connection, Guarded
from sattrack.runtime.control_arbiter import ControlArbiter, Observers, SessionInbox
from sattrack.runtime.facts import build_engine, encode_facts
from sattrack.runtime.flight import LiveLoop, summarise
from sattrack.runtime.guardian import SIZE, Guardian, GuardianTask, Word, note_status
from sattrack.runtime.mounts import Owner
from sattrack.runtime.system import StopRequest
from sattrack.runtime.view_server import ViewClientEvent
from sattrack.views.messages import decode_said, is_observation
from storm.mounts import mount_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.control.driver import Driver
    from sattrack.control.engine import Engine
    from sattrack.runtime.turns import LeftMoving
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import Summary, TrackView
    from storm.draws import Fault, Person, Storm, Way
    from storm.mounts import Axes

WATCHED_ON_S = 8.0
"""How long the mount is watched after everybody has let go of it."""
ENDLESS_S = 600.0
"""A program that has not ended so long after a person's stop never will."""
GUARDIAN_POLL_S = 0.1
GUARDIAN_UP_S = 0.2
"""From a guardian's start to its watch."""
BOOTED_S = 1000.0
FEEDERS = ("runtime.loop", "runtime.flight", "runtime.connection", "core.clock")
GUARDIANS = ("runtime.guardian", "runtime.turns")
"""Modules whose `time` is the world's, by whose process reads it."""
RECORDED_SEEDS = 4
"""One in so many storms is recorded, and replayed."""
RESOLUTION_S = 1e-6
"""The least step of time: an instant of UTC cannot be told from the next below a quarter of it."""
RAISED = (SattrackError, OSError, ValueError, ArithmeticError, LookupError, AttributeError, TypeError)
"""What a program may end with; all but the first are defects of it."""
SYNCED_WITHIN_TURNS = 3.0
MOST_GUARDED_S = 60.0
"""How long a guardian is watched that goes on with a mount which it does not see at rest."""


class Killed(BaseException):
    """The process has ended: nothing of it runs any more."""


class Sent(NamedTuple):
    """One datagram towards the mount: who sent it when, and of when the newest status was that it knew."""

    utc_s: float
    who: str
    data: bytes
    knows_utc_s: float
    """Instant of the mount's turn that made the newest status which the sender had."""
    heard_utc_s: float
    """When that arrived."""


@dataclass
class Happening:
    """A line of the trace."""

    at_s: float
    what: str
    text: str


@dataclass
class Ended:
    """What came of a run."""

    storm: Storm
    summary: Summary | None = None
    error: BaseException | None = None
    engine: Engine | None = None
    recording: bytes = b""
    ended_s: float = math.nan
    """When the program's loop ended, or was killed; seconds after the begin."""
    over_s: float = math.nan
    killed: bool = False
    guardian_at_rest: bool | None = None
    trace: list[Happening] = field(default_factory=list)


class Judging:
    """Is shown all that happens in a world; a subclass judges."""

    def violated(self, name: str, world: World, text: str) -> None:
        """Take a broken promise that the world itself has seen."""

    def turn(self, world: World, axes: Axes) -> None:
        """Take where the axes are, at a turn of the mount's loop, or while its program stands still."""

    def sent(self, world: World, sent: Sent) -> None:
        """Take a datagram that has just left for the mount."""

    def arrived(self, world: World, sent: Sent) -> None:
        """Take a datagram that has just arrived at a mount that can read it."""

    def period(self, world: World, driver: Driver, ended_by: str | None) -> None:
        """Take the program's driver, and by what its run has ended, once a period."""

    def begins(self, world: World) -> None:
        """Take notice that another process of the program has the mount from now on."""

    def stopping(self, world: World) -> None:
        """Take notice that a person, or the program by itself, stops the mount, and the run goes on."""

    def told(self, world: World, moves: bool) -> None:
        """Take a person's order to a run that goes on; `moves` where it sets the mount going."""

    def synced(self, deg: float) -> None:
        """Take notice that the mount was told that it is elsewhere, by so much."""

    def ended(self, world: World, ended: Ended) -> None:
        """Take the end."""


class Time:
    """`time` of the modules of one of the machine's processes."""

    CLOCK_BOOTTIME = 7

    def __init__(self, world: World, feeder: bool) -> None:
        self._world, self._feeder = world, feeder

    def monotonic(self) -> float:
        world = self._world
        if self._feeder and world.feeder_is_late:
            world.catch_up()
        return world.monotonic_s

    def time(self) -> float:
        return self._world.now_s + self._world.host_offset_s

    def clock_gettime(self, clock: int) -> float:
        assert clock == self.CLOCK_BOOTTIME
        return self._world.monotonic_s + self._world.slept_s

    def sleep(self, seconds: float) -> None:
        self._world.run_until(self._world.now_s + seconds)
        self._world.catch_up()


class Link:
    """The socket towards the mount, which a program and its guardian share, as one of them sees it."""

    def __init__(self, world: World, who: str) -> None:
        self._world, self._who = world, who
        self.address = Address("192.0.2.1", 7624, 7625)
        self.strangers = 0
        self.stranger_hosts: list[str] = []
        self.unsent = 0
        self.trouble: str | None = None
        self.onlooker: Callable[[float, bytes], None] | None = None
        self.knows_utc_s = self.heard_utc_s = -math.inf

    def fileno(self) -> int:
        return -1

    def send(self, data: bytes) -> None:
        if self._who == "feeder":
            self._world.catch_up()
        self._world.leave(Sent(self._world.now_s, self._who, data, self.knows_utc_s, self.heard_utc_s))

    def receive(self) -> list[Arrival]:
        arrivals = []
        for data, monotonic_s, knows_utc_s, utc_s in self._world.take_arrivals():
            arrivals.append(Arrival(data, monotonic_s))
            self.knows_utc_s, self.heard_utc_s = max(self.knows_utc_s, knows_utc_s), utc_s
            if self.onlooker is not None:
                self.onlooker(monotonic_s, data)
        return arrivals


class Guard(Guarded):
    """The feeder's end of its guardian, without the process."""

    def __init__(self, world: World, link: Link) -> None:
        self._world = world
        self._words = world.page
        link.onlooker = partial(note_status, self._words)
        self._name = "xerxes://storm"
        left, now_s = world.left_moving, world.now_s + world.host_offset_s
        self._turns_before = None if left is None else left.trouble(now_s)
        self.first_axis_deg = None if left is None else left.first_axis_deg
        self._words[Word.TURNS_LOST] = self._turns_before is not None
        self._beats = 0
        self._armed = self._aborts = self._restarted = False
        self._lost: str | None = None

    def _look(self) -> None:
        if self._world.guardian is not None:
            return
        if self._restarted:
            self._lost = "the guardian died twice: the mount is not moved without one"
            return
        self._restarted = True
        self._world.start_guardian()


class VirtualGuardian(Guardian):
    """The guardian, with its turns given by the world; what it writes goes to the trace."""

    world: World

    def _note(self, what: str) -> None:
        self.world.trace("guardian", f"{self._why}; {what}")

    def _keep(self, moving: LeftMoving | None) -> None:
        self.noted = self.world.left_moving = moving

    @property
    def due_s(self) -> float:
        """When it must run next, monotonic."""
        return self._due_s if self._stop is not None else self.world.monotonic_s + GUARDIAN_POLL_S

    def feeder_gone(self) -> None:
        self._gone = True

    @property
    def acts(self) -> bool:
        """Whether the mount is the guardian's."""
        return self._stop is not None

    @property
    def gave_up(self) -> bool:
        """Whether its stop goes on beyond its time."""
        return self._goes_on_utc is not None

    @property
    def seen_at_rest(self) -> bool | None:
        return None if self._stop is None else self._stop.mount_stopped


class Disk(io.BytesIO):
    """A file on a disk that may be full; what was written outlives its end."""

    full = False
    kept = b""

    def write(self, data: Any) -> int:
        if self.full:
            raise OSError(28, "No space left on device")
        return super().write(data)

    def flush(self) -> None:
        if self.full:
            raise OSError(28, "No space left on device")

    def close(self) -> None:
        self.kept = self.getvalue()


class Lines:
    """The channels by which people's lines come: to the starter's, to others', and of a camera."""

    def __init__(self, observers: Observers) -> None:
        self._observers = observers
        self._starter: list[str] = []
        self._others: list[ViewClientEvent] = [ViewClientEvent(7, "came", "other")]
        self.malformed = 0
        self.ended = False
        self.stops_at_end = True

    def put(self, person: Person) -> None:
        if person.channel == "camera":
            self._observers.put(person.line.encode())
        elif person.channel == "other":
            self._others.append(ViewClientEvent(7, "sent", person.line))
        else:
            self._starter.append(person.line)

    def messages(self) -> list[Message | SessionMessage]:
        found: list[Message | SessionMessage] = []
        for line in self._starter:
            if is_observation(line.encode()):
                self._observers.put(line.encode())
                continue
            try:
                found.append(decode_said(line.encode()))
            except (msgspec.MsgspecError, RecursionError):
                self.malformed += 1
        self._starter = []
        return found

    def heard(self) -> list[ViewClientEvent]:
        events, self._others = self._others, []
        return events


class World:
    """One run of a storm; `run` gives what came of it."""

    def __init__(self, storm: Storm, judge: Judging, tracing: bool = False) -> None:
        self.storm, self.judge = storm, judge
        self.now_s = self.begin_s = storm.begin_s
        self.host_offset_s = 0.0
        self.slept_s = 0.0
        self.mount = mount_of(storm)
        self.page = memoryview(bytearray(SIZE)).cast("Q")
        self.guardian: VirtualGuardian | None = None
        self.feeder_lives = True
        self.left_moving: LeftMoving | None = None
        """What guardians keep of the mount for programs to come."""
        self.stopped_by_person_s: float | None = None
        """When a person asked for a stop, seconds of UTC."""
        self.ended_by: str | None = None
        """By what the whole program has ended, where that is more than the run of one driver."""
        self.abandoned = False
        """Whether program and guardian were both killed: nothing is left that could stop the mount."""
        self.down = False
        """Whether the mount's program does not run."""
        self._kill = False
        self._queue: list[tuple[float, int, Callable[[Any], None], Any]] = []
        self._order = 0
        self._dice = random.Random(f"world {storm.seed}")
        self._lost_until_s = {"commands": -math.inf, "statuses": -math.inf}
        self._held_until_s = {"commands": -math.inf, "statuses": -math.inf}
        self._burst_until_s = -math.inf
        self._feeder_from_s = self._guardian_from_s = -math.inf
        self._arrived: list[tuple[bytes, float, float, float]] = []
        self._turn_of: dict[bytes, float] = {}
        self._status: bytes | None = None
        self._looked_s = 0.0
        self._guardian_link = Link(self, "guardian")
        self._guardian_turn = 0
        self.disk = Disk()
        self.ended = Ended(storm)
        self._tracing = tracing
        self._shown: tuple[object, ...] = ()

    @property
    def is_synced(self) -> bool:
        """Whether people sync the mount in this storm."""
        return self.storm.other is not None and self.storm.other.what == "synced"

    def looks(self) -> tuple[float, float]:
        """Return hour angle and declination of where the telescope looks, degrees."""
        truth = self.mount.truth()
        if self.storm.other is None:
            return truth.hour_angle_deg, truth.dec_axis_deg
        meridian, west, pole = self.storm.judge().looks(truth.hour_angle_deg, truth.dec_axis_deg)
        return math.degrees(math.atan2(west, meridian)), math.degrees(math.asin(max(-1.0, min(1.0, pole))))

    @property
    def monotonic_s(self) -> float:
        """The machine's monotonic clock, which stands while it sleeps."""
        return self.now_s - self.begin_s + BOOTED_S - self.slept_s

    @property
    def at_s(self) -> float:
        return self.now_s - self.begin_s

    @property
    def somebody_sends(self) -> bool:
        """Whether the program or its guardian still runs."""
        return self.feeder_lives or self.guardian is not None

    def trace(self, what: str, text: str) -> None:
        if self._tracing:
            self.ended.trace.append(Happening(self.at_s, what, text))

    # time

    def at(self, utc_s: float, happen: Callable[[Any], None], what: Any = None) -> None:
        self._order += 1
        now_s = self.now_s
        heapq.heappush(self._queue, (now_s if now_s > utc_s else utc_s, self._order, happen, what))

    def run_until(self, utc_s: float, awake: Callable[[], bool] = lambda: False) -> None:
        """Let things happen until an instant, or until `awake`."""
        queue = self._queue
        while not awake():
            if not queue or queue[0][0] > utc_s:
                self.now_s = max(self.now_s, utc_s)
                return
            at_s, _, happen, what = heapq.heappop(queue)
            if at_s > self.now_s:
                self.now_s = at_s
            happen(what)

    @property
    def feeder_is_late(self) -> bool:
        """Whether the feeder is not where the world is: it ends, or stands still."""
        return self._kill or self.now_s < self._feeder_from_s

    def catch_up(self) -> None:
        """Be where the feeder is: a process that stands still sees time pass when it goes on."""
        if self._kill:
            raise Killed
        if self.now_s < self._feeder_from_s:
            self.run_until(self._feeder_from_s)
            if self._kill:
                raise Killed

    def select(
        self, readers: list[Any], writers: list[Any], errors: list[Any], timeout_s: float
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """`select.select` of the feeder."""
        del writers, errors
        link = next((one for one in readers if isinstance(one, Link)), None)
        until = self.monotonic_s + timeout_s

        def awake() -> bool:
            if self._kill or (link is not None and self._arrived):
                return True
            return self.now_s - self.begin_s + BOOTED_S - self.slept_s >= until

        # A machine that sleeps stops the clock by which this waits.
        while not awake():
            self.run_until(self.now_s + max(RESOLUTION_S, until - self.monotonic_s), awake)
        self.catch_up()
        return ([link] if link is not None and self._arrived else []), [], []

    # the link

    def leave(self, sent: Sent) -> None:
        """Send a datagram to the mount."""
        self.judge.sent(self, sent)
        if self._tracing:
            self._trace_command(sent)
        for arrives_s, data in self._carried("commands", self.storm.commands, sent.data):
            self.at(arrives_s, self._command_arrives, sent._replace(data=data))

    def _trace_command(self, sent: Sent) -> None:
        """Trace a datagram that asks for something else than the one before it, or in another second."""
        command = decode_command(sent.data)
        names = ("abort", "park", "slew", "sync", "find_home", "move_ra", "move_dec", "pulse_guide")
        up = [name for name in names if getattr(command, name)]
        text = f"{sent.who} {command.counter}: {' '.join(up) or 'nothing'}"
        if command.move_ra or command.move_dec:
            text += f" {command.move_ra_rate_deg_s:+.4f} {command.move_dec_rate_deg_s:+.4f} °/s"
        shown = (sent.who, tuple(up), int(self.at_s) if up else None)
        if shown != self._shown:
            self._shown = shown
            self.trace("command", text)

    def _carried(self, way: str, law: Way, data: bytes) -> Iterator[tuple[float, bytes]]:
        dice, now_s = self._dice, self.now_s
        copies = 2 if dice.random() < law.duplicate else 1
        for _ in range(copies):
            if now_s < self._lost_until_s[way] or dice.random() < law.loss:
                continue
            if now_s < self._burst_until_s and dice.random() < 0.9:
                continue
            delay_s = law.delay_s + dice.uniform(0.0, law.jitter_s)
            if dice.random() < law.late:
                delay_s += dice.uniform(0.0, self.storm.late_most_s)
            arrives_s = max(now_s + delay_s, self._held_until_s[way])
            yield arrives_s, self._spoilt(data) if dice.random() < law.corrupt else data

    def _spoilt(self, data: bytes) -> bytes:
        spoilt = bytearray(data)
        spoilt[self._dice.randrange(len(data))] ^= 1 << self._dice.randrange(8)
        return bytes(spoilt)

    def _command_arrives(self, sent: Sent) -> None:
        if self.down:
            return
        self.mount.receive(sent.data)
        self.judge.arrived(self, sent)

    def _mount_turn(self, number: int) -> None:
        if self.down or number != self._turns:
            return
        if self.mount.next_turn_s > self.now_s + 1e-6:
            self.at(self.mount.next_turn_s, self._mount_turn, number)
            return
        status = self._status = self.mount.turn()
        self.judge.turn(self, self.mount.truth())
        for arrives_s, data in self._carried("statuses", self.storm.statuses, status):
            self.at(arrives_s, self._status_arrives, (data, self.now_s))
        self.at(self.mount.next_turn_s, self._mount_turn, number)

    def _status_arrives(self, what: tuple[bytes, float]) -> None:
        data, turned_s = what
        if self.feeder_lives or self.guardian is not None:
            self._arrived.append((data, self.monotonic_s, turned_s, self.now_s))
            if self.guardian is not None and self.guardian.acts:
                self.at(self.now_s, self._guardian_runs, self._guardian_turn)

    def take_arrivals(self) -> list[tuple[bytes, float, float, float]]:
        arrived, self._arrived = self._arrived, []
        return arrived

    # the guardian

    def start_guardian(self) -> None:
        address = self._guardian_link.address
        owner = Owner(0, 0, "storm", "", "storm", address.listen_port)
        profile = self.storm.facts.profile
        task = GuardianTask(0, 0, -1, address, profile, 1.0, HANG_AFTER_S, owner, False)
        life: Any = None
        link, noted = self._guardian_link, self.left_moving
        self.guardian = VirtualGuardian(task, life, self.page, link, None, None, noted=noted)
        self.guardian.world = self
        self._looked_s = self.monotonic_s
        self._schedule_guardian(GUARDIAN_UP_S)

    def _schedule_guardian(self, after_s: float) -> None:
        self._guardian_turn += 1
        self.at(self.now_s + after_s, self._guardian_runs, self._guardian_turn)

    def _guardian_runs(self, number: int) -> None:
        guardian = self.guardian
        if guardian is None or number != self._guardian_turn:
            return
        if self.now_s < self._guardian_from_s:
            self.at(self._guardian_from_s, self._guardian_runs, number)
            return
        guardian.hear()
        guardian.turn(self.monotonic_s, self.monotonic_s - self._looked_s)
        self._looked_s = self.monotonic_s
        if guardian.over:
            self.trace("guardian", "ends")
            self.ended.guardian_at_rest = guardian.seen_at_rest
            self.guardian = None
            return
        self._schedule_guardian(max(RESOLUTION_S, guardian.due_s - self.monotonic_s))

    # faults and people

    def _befall(self, fault: Fault) -> None:
        self.trace("fault", str(fault))
        until_s = self.now_s + fault.lasts_s
        match fault.kind:
            case "deaf":
                self._lost_until_s["commands"] = until_s
            case "silent":
                self._lost_until_s["statuses"] = until_s
            case "cut":
                self._lost_until_s["commands"] = self._lost_until_s["statuses"] = until_s
            case "queue":
                self._held_until_s["commands"] = self._held_until_s["statuses"] = until_s
            case "burst":
                self._burst_until_s = until_s
            case "freeze":
                self.mount.hold_up(until_s)
            case "restart":
                self._crash(until_s)
            case "drive":
                self.mount.fail_drives(self.now_s)
            case "clock":
                self.mount.step_clock(fault.amount)
            case "sync":
                self._sync(fault.amount)
            case "stall":
                self._feeder_from_s = max(self._feeder_from_s, until_s)
            case "halt":
                self._feeder_from_s = max(self._feeder_from_s, until_s)
                self._guardian_from_s = max(self._guardian_from_s, until_s)
            case "sleep":
                self._sleep(fault.lasts_s)
            case "step":
                self.host_offset_s += fault.amount
            case "kill":
                self._kill = True
            case "disk":
                self.disk.full = True
            case "guardian":
                self.guardian = None
            case _:
                raise AssertionError(fault.kind)

    def _sync(self, deg: float) -> None:
        """Have another program tell the mount that it is elsewhere."""
        if self.down or self._status is None:
            return
        told = decode_status(self._status)
        dec_deg = max(-85.0, min(85.0, told.dec_deg + 0.5 * deg))
        target_ra_h = (told.ra_h + deg / 15.0) % 24.0
        self.mount.receive(
            encode_command(Command(target_dec_deg=dec_deg, target_ra_h=target_ra_h, sync=True))
        )
        # It is carried out at a turn to come: what moves has moved on by then.
        turns_s = SYNCED_WITHIN_TURNS * self.storm.facts.profile.period_s
        self.judge.synced(1.5 * abs(deg) + turns_s * self.mount.truth().speed_deg_s)

    def _sleep(self, seconds: float) -> None:
        """The machine sleeps: nothing of it runs, and its monotonic clock stands."""
        until_s, slept_s = self.now_s + seconds, self.slept_s
        self._feeder_from_s = max(self._feeder_from_s, until_s)
        self._guardian_from_s = max(self._guardian_from_s, until_s)

        def wakes(_: Any) -> None:
            self.slept_s = slept_s + seconds
            # What came meanwhile found no machine.
            self._arrived = [one for one in self._arrived if one[3] <= until_s - seconds]

        self.at(until_s, wakes)

    def _crash(self, until_s: float) -> None:
        if self.down:
            return
        self.mount.crash(self.now_s)
        self.down = True
        self._turns += 1
        self.at(until_s, self._restart)

    def _restart(self, _: Any) -> None:
        self.mount.restart(self.now_s)
        self.down = False
        self.at(max(self.now_s, self.mount.next_turn_s), self._mount_turn, self._turns)

    def _act(self, person: Person) -> None:
        self.trace("person", f"{person.channel}: {person.line[:80]}")
        if person.channel == "stop":
            self._ask_stop()
        else:
            self._lines.put(person)
        if person.channel == "stop" or '"stop"}' in person.line:
            self.stopped_by_person_s = self.stopped_by_person_s or self.now_s

    def _ask_stop(self) -> None:
        self.page[Word.STOP_ASKED] = 1
        self.at(self.now_s + ENDLESS_S, self._end_endless, self.page)

    def _end_endless(self, page: Any) -> None:
        """End a process that runs on after a person's stop; the judge sees for how long."""
        self._kill = self._kill or (self.feeder_lives and page is self.page)

    # the run

    def run(self) -> Ended:
        """Run the program to its end, and the world on until nobody sends any more."""
        storm = self.storm
        self._turns = 0
        self.at(self.mount.next_turn_s, self._mount_turn, 0)
        for fault in storm.faults:
            self.at(storm.begin_s + fault.at_s, self._befall, fault)
        with self._machine():
            self.start_guardian()
            observers = Observers()
            self._lines = Lines(observers)
            for person in storm.people:
                self.at(storm.begin_s + person.at_s, self._act, person)
            try:
                self._feed(observers)
            except Killed:
                self.ended.killed = True
                self.trace("program", "killed")
            self.feeder_lives = False
            self.abandoned = self.guardian is None and self.ended.killed
            self.ended.ended_s = self.at_s
            self._linger()
        self.ended.over_s = self.at_s
        self.judge.ended(self, self.ended)
        return self.ended

    def _feed(self, observers: Observers) -> None:
        engine = self.ended.engine = self.engine()
        sink = self._sink()
        arbiter = ControlArbiter(with_starter=True)
        inbox = SessionInbox(arbiter, self._lines, self._lines, observers)  # type: ignore[arg-type]
        link: Any = Link(self, "feeder")
        connection = Connection(link, SystemClock(), None, Guard(self, link))
        screen: Any = SimpleNamespace(show=self._show)
        loop = self.loop(connection, StopRequest(), engine, sink, screen, inbox, math.inf, observers)
        try:
            ended_utc_s = loop.run()
            self.ended.summary = summarise(engine, loop.statistics, ended_utc_s)
            sink.summary(ended_utc_s, self.ended.summary)
            self.trace("program", f"ended by {self.ended.summary.ended_by}: {self.ended.summary.message}")
        except RAISED as error:
            self.ended.error = error
            self.trace("program", f"raised {error!r}")
        finally:
            self.disk.full = self.disk.full or self.ended.killed
            if isinstance(sink, Recorder) and not self._kill:
                sink.close()
            self.ended.recording = self.disk.kept or self.disk.getvalue()

    def _sink(self) -> Recorder | NoRecording:
        """Return a recording for some seeds, and where it is judged: it takes a fifth of a run's time."""
        storm = self.storm
        recorded = storm.seed % RECORDED_SEEDS == 0 or any(one.kind == "disk" for one in storm.faults)
        if storm.fault_free or not recorded:
            return NoRecording()
        return Recorder(self.disk, msgspec.Raw(encode_facts(self.storm.facts)))

    def engine(self) -> Engine:
        """Return the driver; a test puts another one here."""
        return build_engine(self.storm.facts)

    loop: Callable[..., LiveLoop] = LiveLoop

    def _show(self, view: TrackView) -> None:
        engine = self.ended.engine
        assert engine is not None
        self.judge.period(self, engine, engine.tracker.ended_by)
        if self._tracing:
            held = f" held at {view.holding}" if getattr(view, "holding", None) else ""
            error = "" if view.error is None else f", error {view.error.total_arcsec:.1f}″"
            self.trace("status", f"{view.phase}{held}{error}")

    def _linger(self) -> None:
        """Let the guardian end, and watch what the mount does then."""
        guardian = self.guardian
        if guardian is not None:
            guardian.feeder_gone()
            self._schedule_guardian(0.0)
            begun_s = self.now_s
            while self.guardian is not None and self.now_s - begun_s < MOST_GUARDED_S:
                self.run_until(self.now_s + 1.0)
                if self.guardian is not None and self.guardian.gave_up and not self.storm_goes_on:
                    self.run_until(self.now_s + WATCHED_ON_S)
                    break
        self.run_until(self.now_s + WATCHED_ON_S)

    @property
    def storm_goes_on(self) -> bool:
        return self.at_s < self.storm.storm_ends_s + 5.0

    @contextmanager
    def _machine(self) -> Iterator[None]:
        """Put the world in the place of the machine."""
        select = SimpleNamespace(select=self.select)
        with ExitStack() as stack:
            for module in (*FEEDERS, *GUARDIANS):
                clock = Time(self, module in FEEDERS)
                stack.enter_context(patch(f"sattrack.{module}.time", clock))
            stack.enter_context(patch("sattrack.runtime.loop.select", select))
            stack.enter_context(patch("sattrack.runtime.loop.undisturbed", lambda: nullcontext(None)))
            stack.enter_context(patch("sattrack.runtime.guardian.utc_now", lambda: "now"))
            yield

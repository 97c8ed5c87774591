"""The loop that feeds a mount in real time: one thread, one `select`, absolute deadlines.

`StationLoop` is that of a server: a client's request is answered as soon as its bytes are read, unless a
datagram is being computed just then, which takes about a millisecond twenty times a second.
"""

from __future__ import annotations

import math
import select
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from sattrack.core.clock import SHORTEST_SLEEP_S, slept
from sattrack.core.errors import SattrackError
from sattrack.core.realtime import undisturbed
from sattrack.mount.xerxes.datagrams import Command, encode_command, sets_going
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.core.realtime import Grant
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.client import Arrival
    from sattrack.mount.xerxes.session import Session
    from sattrack.runtime.connection import Connection
    from sattrack.runtime.system import StopRequest
    from sattrack.safety import Safety


LEAD_S = 0.002
"""How long before it is due a datagram is computed: several times as long as that takes."""
LATE_ENOUGH_TO_SKIP_S = 0.5
LAST_STOPS = 40


class DriverLike(Protocol):
    """A driver of one mount, or what holds one: statuses in, datagrams out; all instants are our UTC."""

    @property
    def profile(self) -> MountProfile:
        """What is known of the mount."""

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the mount was stopped and seen at rest; None: not needed, or not known."""

    @property
    def safety(self) -> Safety | None:
        """What judges its motions, and counts the turns of the first axis; None where nothing does."""

    @property
    def turns_known_s(self) -> float:
        """For how long after its newest status the mount may go on unheard, its axes' turns still known."""

    def receive(self, data: bytes, arrival_utc_s: float) -> object:
        """Take one datagram from the mount."""

    def tick(self, now_utc_s: float) -> bytes | None:
        """Return the datagram to send at an instant, if any; called once a period."""


@dataclass(slots=True)
class RealtimeLoop:
    """Feeds a driver's datagrams to a mount until the driver is finished, each at the instant it is due.

    One thread, one `select`, absolute deadlines. A datagram is computed a little before it is due, for the
    instant at which it is due: what the computing takes, and how much that varies, is then no part of the
    period. An error has the driver stop the mount; where its own `tick` goes on raising, stops are
    sent without it. The first error is raised at the end.

    Subclasses say how the driver is stopped, and do their own part in the methods that do nothing here.
    """

    reported: ClassVar[tuple[type[Exception], ...]] = ()
    """Errors that the summary of the run reports: they are not raised."""

    connection: Connection
    stop: StopRequest
    driver: DriverLike
    grant: Grant | None = field(default=None, init=False)
    """What the system granted for the run; None before it."""
    ticks: int = field(default=0, init=False)
    error: Exception | None = field(default=None, init=False)
    _due_s: float = field(default=0.0, init=False)
    _computed_utc_s: float = field(default=math.inf, init=False)
    """For which instant the last datagram was computed."""
    _slept_s: float = field(default_factory=slept, init=False)
    """For how long the machine had slept as the mount was last listened to."""

    @property
    def period_s(self) -> float:
        """How often a datagram is due, seconds of the monotonic clock."""
        return self.driver.profile.period_s / self.connection.clock.speed

    @property
    def rest(self) -> bool | None:
        """What the guardian learns of the mount at the end."""
        return self.driver.mount_stopped

    @property
    def over(self) -> bool:
        """Whether nothing more must be sent."""
        return self.driver.finished or self.connection.guard.deposed

    def readers(self) -> Sequence[Any]:
        """Return what to wait for beside the mount."""
        return ()

    def writers(self) -> Sequence[Any]:
        """Return what to wait for to take more."""
        return ()

    def serve(self, ready: list[Any]) -> None:
        """Do what must be done with the readers that are ready; called whenever the loop has waited."""

    def flush(self) -> None:
        """Send to writers what waits for them."""

    def take(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self.driver.receive(data, arrival_utc_s)

    def heard(self) -> None:
        """Take notice of datagrams from the mount."""

    def obey(self, now_utc_s: float) -> None:
        """Carry out requests; called once a period, before the datagram is computed."""

    def interrupt(self, now_utc_s: float) -> None:
        """Have the driver stop the mount, and be finished then; called every period from the request on."""
        raise NotImplementedError

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """Have the driver stop the mount, and be finished then, for the first error."""
        raise NotImplementedError

    def sent(self, now_utc_s: float, datagram: bytes) -> None:
        """Take notice of a datagram computed for an instant: it has left, unless late or kept back."""

    def repeat(self) -> None:
        """Send the last datagram once more, if that is wanted."""

    def report(self) -> None:
        """Report what has changed; called once a period, when the next datagram is longest away."""

    def gather(self) -> None:
        """Take the truth from a simulated mount, wanted or not: its pipe must not fill up."""
        if self.connection.simulated is not None:
            self.connection.simulated.truths()

    def shift_s(self, now_utc_s: float) -> float:
        """Return how much longer the next period is than the others, seconds of UTC."""
        del now_utc_s
        return 0.0

    def due_s(self) -> float:
        """Return when the next datagram is due, by the monotonic clock."""
        return self._due_s

    def run(self) -> Any:
        """Run to the end; raises the first error, once the mount is stopped."""
        self.feed()
        guard = self.connection.guard
        if guard.deposed:
            raise SattrackError(guard.trouble)
        guard.release(self.rest)
        self.raise_error()

    def raise_error(self) -> None:
        """Raise the first error, unless it is reported elsewhere."""
        if self.error is not None and not isinstance(self.error, self.reported):
            raise self.error

    def feed(self) -> None:
        """Feed the mount until the driver is finished, or the mount is taken away."""
        with undisturbed() as self.grant:
            self._due_s = time.monotonic()
            wound_deg = self.connection.guard.first_axis_deg
            if wound_deg is not None and self.driver.safety is not None:
                self.driver.safety.begin_at(wound_deg)
            followed_deg = self.connection.guard.followed_deg
            if followed_deg is not None and self.driver.safety is not None:
                self.driver.safety.expect_at(followed_deg)
            while not self.over:
                self.guarded(self._wait_until_due)
                self.guarded(self.heed_guard)
                self.guarded(self._obey)
                self.guarded(self._send)
                self.guarded(self.repeat)
                self.guarded(self.report)
                self.ticks += 1
                self._due_s += self.period_s
                self.guarded(self._shift)
                if time.monotonic() - self._due_s > LATE_ENOUGH_TO_SKIP_S:
                    self._due_s = time.monotonic()

    def guarded(self, part: Callable[..., None], *arguments: Any) -> None:
        """Do one part of a turn; an error in it turns the run into a stop of the mount."""
        try:
            part(*arguments)
        except Exception as error:
            if self.error is None:
                self.error = error
                self.fail(error, self.connection.now_utc_s())
            elif part == self._send:
                self._stop_without_driver()
                raise

    def heed_guard(self) -> None:
        """Stop where that is requested from outside, or where the guardian is lost, or has the mount."""
        guard = self.connection.guard
        if guard.stop_asked:
            self.stop.ask()
        if guard.trouble is not None:
            raise SattrackError(guard.trouble)

    def send_copy(self, repeat: Callable[[], bytes | None]) -> bytes | None:
        """Send a datagram once more, a part of a period after the first; return it."""
        due_s = self._due_s + REPEAT_AFTER_PERIODS * self.period_s
        self._wait(lambda: due_s)
        if self.stop.asked or self.connection.guard.deposed or self._too_late:
            return None
        datagram = repeat()
        if datagram is not None:
            self.connection.link.send(datagram)
        return datagram

    def _obey(self) -> None:
        now_utc_s = self.connection.now_utc_s()
        if self.stop.asked:
            self.interrupt(now_utc_s)
        self.obey(now_utc_s)
        self.gather()

    def _wait_until_due(self) -> None:
        self._wait(lambda: self.due_s() - LEAD_S)

    def _wait(self, until_s: Callable[[], float]) -> None:
        """Wait for an instant, taking datagrams and serving clients as they come."""
        connection = self.connection
        while True:
            left_s = max(0.0, until_s() - time.monotonic())
            watched = [connection.link, *self.readers()]
            ready, takes_more, _ = select.select(watched, self.writers(), [], left_s)
            if connection.link in ready:
                for arrival in self._arrivals():
                    self.take(arrival.data, connection.clock.utc_s(arrival.monotonic_s))
                self.heard()
            self.serve(ready)
            if takes_more:
                self.flush()
            if time.monotonic() >= until_s():
                return

    @property
    def _too_late(self) -> bool:
        """Whether this process, or the machine, has stood still since the last datagram was computed."""
        late_s = (self.connection.now_utc_s() - self._computed_utc_s) / self.connection.clock.speed
        return late_s >= LATE_ENOUGH_TO_SKIP_S

    def _arrivals(self) -> list[Arrival]:
        """Return what the mount has sent, but for what waited while the machine slept: its age is unknown."""
        arrivals, slept_s = self.connection.link.receive(), slept()
        woken = slept_s - self._slept_s > SHORTEST_SLEEP_S
        self._slept_s = slept_s
        return [] if woken else arrivals

    def _send(self) -> None:
        """Compute the datagram and send it when it is due, to the guardian's knowledge."""
        connection, due_s = self.connection, self.due_s()
        now_utc_s = connection.clock.utc_s(max(due_s, time.monotonic()))
        self._computed_utc_s = now_utc_s
        datagram = self.driver.tick(now_utc_s)
        while (left_s := due_s - time.monotonic()) > 0.0:
            # A client whose request comes while a datagram waits is answered at once.
            ready, _, _ = select.select(self.readers(), [], [], left_s)
            if ready:
                self.guarded(self.serve, ready)
        known_s = self.driver.turns_known_s / connection.clock.speed
        first_deg = None if self.driver.safety is None else self.driver.safety.first_axis_deg
        may_leave = connection.guard.beat(datagram, known_s, first_deg)
        if datagram is not None and not connection.guard.deposed:
            if may_leave and not (self._too_late and sets_going(datagram)):
                connection.link.send(datagram)
            # What was kept back was computed all the same, and a replay computes it.
            self.guarded(self.sent, now_utc_s, datagram)

    def _shift(self) -> None:
        """Move what is due next against the instant that the last datagram was computed for.

        What else the turn did since then, a copy of the datagram above all, took a part of the period.
        """
        self._due_s += self.shift_s(self._computed_utc_s) / self.connection.clock.speed

    def _stop_without_driver(self) -> None:
        """Send stops without anything that may be broken."""
        for counter in range(LAST_STOPS):
            stop = encode_command(Command(counter, abort=counter > 0))
            if self.connection.guard.beat(stop):
                self.connection.link.send(stop)
            time.sleep(self.period_s)


class ServerPort(Protocol):
    """The port at which clients come in."""

    def readers(self) -> list[Any]:
        """Return what to wait for."""

    def writers(self) -> list[Any]:
        """Return what to wait for to take more."""

    def flush(self) -> None:
        """Send what waits, as far as it can be sent now."""


class StationDriver(DriverLike, Protocol):
    """The driver of a server's mount, until it must end and the mount is seen at rest."""

    @property
    def safety(self) -> Safety:
        """What clears its motions."""

    @property
    def session(self) -> Session:
        """The conversation with it."""

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""

    @property
    def on_trajectory(self) -> bool:
        """Whether it is where it should be."""

    @property
    def tripped(self) -> str | None:
        """Name of the interlock that stopped the mount."""

    def repeat(self) -> bytes | None:
        """Return what to send once more before the next datagram, None for nothing."""

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next `tick` beyond one period, seconds of UTC."""

    def end(self, now_utc_s: float) -> None:
        """Bring the mount to rest, and be finished when it is seen there."""


@dataclass(slots=True)
class StationLoop(RealtimeLoop):
    """Serves one mount to clients until `stop` is asked for and the mount is seen at rest."""

    driver: StationDriver
    server: ServerPort
    log: Callable[[str], None]
    """Takes lines without their instant."""
    _reported_trip: str | None = field(default=None, init=False)
    _reported_hold: str | None = field(default=None, init=False)
    _reported_link: bool = field(default=False, init=False)

    def readers(self) -> list[Any]:
        """See RealtimeLoop."""
        return self.server.readers()

    def writers(self) -> list[Any]:
        """See RealtimeLoop."""
        return self.server.writers()

    def flush(self) -> None:
        """See RealtimeLoop."""
        self.server.flush()

    def interrupt(self, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        self.driver.end(now_utc_s)

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        del error
        self.driver.end(now_utc_s)

    def repeat(self) -> None:
        """Send the last datagram once more where the link loses some."""
        self.send_copy(self.driver.repeat)

    def shift_s(self, now_utc_s: float) -> float:
        """See RealtimeLoop."""
        return self.driver.send_shift_s(now_utc_s)

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        raise NotImplementedError

    def report_mount(self, way: str, ready_again: str) -> None:
        """Report what has changed of the mount: interlocks, limits, the link.

        `way` is what the caller's positions are called, `ready_again` what makes a stopped mount ready.
        """
        station = self.driver
        if station.tripped != self._reported_trip:
            self._reported_trip = station.tripped
            if station.tripped is not None:
                self.tell(f"safety stopped the mount: {station.tripped}; {ready_again} makes it ready again")
        held_by = station.safety.holding
        if held_by is not None and held_by != self._reported_hold:
            self._reported_hold = held_by
            self.tell(f"a limit keeps the antenna off its {way}: {held_by}")
        elif station.on_trajectory:
            self._reported_hold = None
        if station.link_up != self._reported_link:
            self._reported_link = station.link_up
            did = f"the mount {station.session.health.did}"
            self.tell("the mount is heard" if station.link_up else did)

"""The loop that feeds a mount in real time, and what it asks of the system so that nothing holds it up.

Priority, locked memory, no garbage collection: each is asked for by itself and may be refused; the run goes
on without, and says what it lacks. sched(7), mlockall(2), prctl(2). Priorities and locked memory are asked
for on Linux only.
"""

from __future__ import annotations

import ctypes
import gc
import os
import re
import select
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from sattrack.core.errors import SattrackError
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from sattrack.mount.model import MountProfile
    from sattrack.runtime.console import Connection
    from sattrack.runtime.signals import StopRequest

LEAD_S = 0.002
"""How long before it is due a datagram is computed: several times as long as that takes."""
LATE_ENOUGH_TO_SKIP_S = 0.5
LAST_STOPS = 40
PRIORITY = 10
"""Above everything that has no real-time priority, below the kernel's own threads for interrupts (50)."""
SWITCH_S = 0.0005
"""How long the loop waits before it asks another thread for the interpreter."""
VARIABLE = "SATTRACK_REALTIME"
"""Set to 0, no priority and no locked memory is asked for."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
_SHORTEST_SLACK_NS = 1
_DEFAULT_SLACK = 0
_CAP_IPC_LOCK = 14


@dataclass(frozen=True, slots=True)
class Grant:
    """What was granted, `priority` None where none was; `refusals` say why, without how to get it."""

    priority: int | None
    memory_locked: bool
    refusals: tuple[str, ...] = ()

    @property
    def realtime(self) -> bool:
        """Whether the loop goes before everything that has no such priority."""
        return self.priority is not None


def wanted(environment: Mapping[str, str]) -> bool:
    """Tell whether to ask for priority and locked memory."""
    return environment.get(VARIABLE, "1") != "0"


@contextmanager
def undisturbed(ask: bool | None = None) -> Iterator[Grant]:
    """Run the calling thread, and it alone, as little disturbed as the system lets it; give what was granted.

    With `ask` None the environment decides whether priority and locked memory are asked for. Threads and
    processes begun meanwhile have normal priority. What is made meanwhile must be free of cycles: no garbage
    is collected.
    """
    if ask is None:
        ask = wanted(os.environ)
    with _quiet_memory(), _eager():
        refusals: list[str] = []
        locked = priority = None
        if not ask:
            refusals.append(f"not asked for: {VARIABLE}=0")
        elif not sys.platform.startswith("linux"):
            refusals.append(f"real-time priority is asked for on Linux only, and this is {sys.platform}")
        else:
            locked = _lock_memory(refusals)
            priority = _take_priority(refusals)
        try:
            yield Grant(priority, locked is not None, tuple(refusals))
        finally:
            if priority is not None:
                # Without privileges, what was asked for once about children cannot be taken back.
                os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            if locked is not None:
                locked.munlockall()


def go_before_others() -> None:
    """Ask for the priority of `undisturbed` for this process to its end, where it is wanted and granted."""
    if wanted(os.environ) and sys.platform.startswith("linux"):
        _take_priority([])


def how_to_grant(user: str) -> tuple[str, ...]:
    """Return the ways to get priority and locked memory on Linux, the one that lasts first."""
    return (
        f"for good: put the lines `{user} - rtprio {2 * PRIORITY}` and `{user} - memlock unlimited` into "
        "/etc/security/limits.d/sattrack.conf, and log in again",
        "for this shell, at once: sudo prlimit --pid $$ "
        f"--rtprio={2 * PRIORITY}:{2 * PRIORITY} --memlock=unlimited:unlimited",
        f"in a systemd unit: LimitRTPRIO={2 * PRIORITY} and LimitMEMLOCK=infinity, "
        "or AmbientCapabilities=CAP_SYS_NICE CAP_IPC_LOCK",
        "for one Python of its own (a copy, no link; whoever may run it gets both): "
        "sudo setcap cap_sys_nice,cap_ipc_lock+ep /path/to/that/python3",
    )


def _take_priority(refusals: list[str]) -> int | None:
    try:
        # Threads and processes begun from here on are not to have it.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except OSError as error:
        refusals.append(f"no real-time priority: {error.strerror}")
        return None
    return PRIORITY


def _lock_memory(refusals: list[str]) -> ctypes.CDLL | None:
    libc = ctypes.CDLL(None, use_errno=True)
    # Pages as they come into use: whole mappings would be several times what is ever touched.
    flags = _MCL_CURRENT | _MCL_ONFAULT
    if _unlimited_locking():
        # Under a limit, memory to come could not be had at all once the limit is reached.
        flags |= _MCL_FUTURE
    if libc.mlockall(flags) != 0:
        refusals.append(f"memory is not locked: {os.strerror(ctypes.get_errno())}")
        return None
    return libc


def _unlimited_locking() -> bool:
    import resource

    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    try:
        status = Path("/proc/self/status").read_bytes()
    except OSError:
        return False
    capabilities = re.search(rb"^CapEff:\s*([0-9a-f]+)", status, re.MULTILINE)
    return capabilities is not None and bool(int(capabilities[1], 16) >> _CAP_IPC_LOCK & 1)


@contextmanager
def _eager() -> Iterator[None]:
    """Wait for the interpreter and for the kernel's timers no longer than need be."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    _set_timer_slack(_SHORTEST_SLACK_NS)
    try:
        yield
    finally:
        _set_timer_slack(_DEFAULT_SLACK)
        sys.setswitchinterval(before_s)


def _set_timer_slack(nanoseconds: int) -> None:
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(nanoseconds), 0, 0, 0)


@contextmanager
def _quiet_memory() -> Iterator[None]:
    # A collection of garbage would hold the loop for longer than its period allows.
    was_enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
        gc.unfreeze()


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
        """Whether the mount was told to stop and seen at rest; None: not needed, or not known."""

    def receive(self, data: bytes, arrival_utc_s: float) -> object:
        """Take one datagram from the mount."""

    def tick(self, now_utc_s: float) -> bytes | None:
        """Return the datagram to send at an instant, if any; called once a period."""


@dataclass(slots=True)
class RealtimeLoop:
    """Feeds a driver's datagrams to a mount until the driver is finished, each at the instant it is due.

    One thread, one `select`, absolute deadlines. A datagram is computed a little before it is due, for the
    instant at which it is due: what the computing takes, and how much that varies, is then no part of the
    period. Whatever raises has the driver stop the mount; where its own `tick` goes on raising, stops are
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

    @property
    def period_s(self) -> float:
        """How often a datagram is due, seconds of the monotonic clock."""
        return self.driver.profile.period_s / self.connection.clock.speed

    @property
    def rest(self) -> bool | None:
        """What the guardian is told of the mount at the end."""
        return self.driver.mount_stopped

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
        """Take notice that the mount has said something."""

    def obey(self, now_utc_s: float) -> None:
        """Do what was asked for meanwhile; called once a period, before the datagram is computed."""

    def interrupt(self, now_utc_s: float) -> None:
        """Have the driver stop the mount, and be finished then; called every period from the request on."""
        raise NotImplementedError

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """Have the driver stop the mount, and be finished then, for the first error."""
        raise NotImplementedError

    def sent(self, now_utc_s: float, datagram: bytes) -> None:
        """Take notice of a datagram that has just left, computed for an instant."""

    def repeat(self) -> None:
        """Send the last datagram once more, if that is wanted."""

    def report(self) -> None:
        """Say what has changed; called once a period, when the next datagram is longest away."""

    def gather(self) -> None:
        """Take the truth from a simulated mount, wanted or not: its pipe must not fill up."""
        if self.connection.simulated is not None:
            self.connection.simulated.truths()

    def shift_s(self, now_utc_s: float) -> float:
        """Return by how much the next period is longer than the others, seconds of UTC."""
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
            while not self.driver.finished and not self.connection.guard.deposed:
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
        """Stop where somebody asks for it from outside, or where the guardian is lost, or has the mount."""
        guard = self.connection.guard
        if guard.stop_asked:
            self.stop.ask()
        if guard.trouble is not None:
            raise SattrackError(guard.trouble)

    def send_copy(self, repeat: Callable[[], bytes | None]) -> bytes | None:
        """Send what is to go out once more, a part of a period after the first; return it."""
        due_s = self._due_s + REPEAT_AFTER_PERIODS * self.period_s
        self._wait(lambda: due_s)
        if self.stop.asked or self.connection.guard.deposed:
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
        """Wait for an instant, taking datagrams and serving whoever is ready as they come."""
        connection = self.connection
        while True:
            left_s = max(0.0, until_s() - time.monotonic())
            watched = [connection.link, *self.readers()]
            ready, takes_more, _ = select.select(watched, self.writers(), [], left_s)
            if connection.link in ready:
                for arrival in connection.link.receive():
                    self.take(arrival.data, connection.clock.utc_s(arrival.monotonic_s))
                self.heard()
            self.serve(ready)
            if takes_more:
                self.flush()
            if time.monotonic() >= until_s():
                return

    def _send(self) -> None:
        """Compute the datagram and send it when it is due, to the guardian's knowledge."""
        connection, due_s = self.connection, self.due_s()
        now_utc_s = connection.clock.utc_s(max(due_s, time.monotonic()))
        datagram = self.driver.tick(now_utc_s)
        while (left_s := due_s - time.monotonic()) > 0.0:
            # Whoever asks while a datagram waits to be due is not kept waiting.
            ready, _, _ = select.select(self.readers(), [], [], left_s)
            if ready:
                self.guarded(self.serve, ready)
        if connection.guard.beat(datagram) and datagram is not None:
            connection.link.send(datagram)
            self.guarded(self.sent, now_utc_s, datagram)

    def _shift(self) -> None:
        connection = self.connection
        self._due_s += self.shift_s(connection.now_utc_s()) / connection.clock.speed

    def _stop_without_driver(self) -> None:
        """Send stops without anything that may be broken."""
        for counter in range(LAST_STOPS):
            stop = encode_command(Command(counter, abort=counter > 0))
            if self.connection.guard.beat(stop):
                self.connection.link.send(stop)
            time.sleep(self.period_s)

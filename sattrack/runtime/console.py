"""Manual operation in real time; and the stop of a mount from outside, by its session or directly."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.control.driver import DirectStop
from sattrack.core.channel import LineReader
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import LinkLostError, SattrackError
from sattrack.mount.xerxes.client import Address, nobody_listens
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.runtime.connection import Connection, owned
from sattrack.runtime.guardian import ASK_WITHIN_S, GONE_AFTER_S
from sattrack.runtime.loop import DriverLike, RealtimeLoop
from sattrack.runtime.mounts import GoesOn, Taken, ask_stop, owned_address, owner_of
from sattrack.runtime.system import StopRequest, stopping, utc_now
from sattrack.views.messages import Leave, decode_order

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.control.console import Console
    from sattrack.control.manual_operation import ConsoleSession
    from sattrack.mount.model import MountProfile
    from sattrack.runtime.mounts import MountAddress, Owner
    from sattrack.views.messages import ConsoleMessage

SHOW_EVERY_TICKS = 2


class Part(DriverLike, Protocol):
    """What the loop drives: an operation, a look, or an operator's console_session."""

    @property
    def console(self) -> Console:
        """The console at work."""

    def interrupt(self, now_utc_s: float) -> None:
        """Come to a safe end."""

    def fail(self, words: str, now_utc_s: float) -> None:
        """Come to a safe end, for a defect."""


class OrderInbox:
    """An operator's orders as JSON lines; the end of the channel is a leave. Other lines do nothing."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._reader = LineReader(sys.stdin.fileno() if descriptor is None else descriptor)
        self._ended = False
        self.ignored = 0
        """Lines that were no orders."""

    def orders(self) -> Sequence[ConsoleMessage]:
        """Return what has come, without waiting."""
        if self._ended:
            return ()
        orders: list[ConsoleMessage] = []
        for line in self._reader.lines():
            try:
                orders.append(decode_order(line))
            except msgspec.MsgspecError:
                self.ignored += 1
        if self._reader.ended:
            self._ended = True
            orders.append(Leave())
        return orders


@dataclass(slots=True)
class ConsoleLoop(RealtimeLoop):
    """Feeds one part until it is finished; `show` is called a few times a second, `orders` once a period."""

    driver: Part
    show: Callable[[float], None]
    orders: Callable[[float], None] | None = None
    _interrupted: bool = field(default=False, init=False)

    @property
    def rest(self) -> bool | None:
        """See RealtimeLoop. A mount that was sent a stop and never heard may move on."""
        console = self.driver.console
        return False if console.stopping and console.sample is None else self.driver.mount_stopped

    def interrupt(self, now_utc_s: float) -> None:
        """Have the part come to its end, once."""
        if not self._interrupted:
            self.driver.interrupt(now_utc_s)
            self._interrupted = True

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        self.driver.fail(str(error), now_utc_s)

    def obey(self, now_utc_s: float) -> None:
        """Have the operator's orders obeyed, and tell the console what the link knows."""
        console, link = self.driver.console, self.connection.link
        console.session.health.strangers = link.strangers
        console.way_trouble = link.trouble
        if len(link.stranger_hosts) > len(console.stranger_hosts):
            console.stranger_hosts = tuple(link.stranger_hosts)
        if self.orders is not None:
            self.orders(now_utc_s)

    def report(self) -> None:
        """Show how the mount stands."""
        if self.ticks % SHOW_EVERY_TICKS == 0:
            self.show(self.connection.now_utc_s())


def attend(
    part: Part,
    connection: Connection,
    show: Callable[[float], None],
    orders: Callable[[float], None] | None = None,
) -> bool:
    """Run a part to its end; return whether a signal interrupted it.

    Signals that end programs bring the mount to rest first, however often they come.
    """
    stop = StopRequest()
    with stopping(stop):
        ConsoleLoop(connection, stop, part, show, orders).run()
    return stop.asked


def attend_console_session(
    console_session: ConsoleSession,
    connection: Connection,
    inbox: OrderInbox,
    show: Callable[[float], None],
    stop_owner: Callable[[], None] | None = None,
) -> bool:
    """Run an operator's console_session to its end; return whether a signal ended it.

    `stop_owner` is called once, without waiting for it, when one who looks on wants the mount to be stopped.
    """
    started: list[threading.Thread] = []

    def obey(now_utc_s: float) -> None:
        for order in inbox.orders():
            console_session.obey(order, now_utc_s)
        if console_session.stop_wanted and stop_owner is not None and not started:
            started.append(threading.Thread(target=stop_owner, name="stop", daemon=True))
            started[0].start()

    return attend(console_session, connection, show, obey)


NOBODY = "nothing listens for UDP there"
GIVE_UP = "`sattrack stop --give-up` ends that"
FREE_WITHIN_S = 10.0
"""How long a session that has stopped its mount may take to close its recording and end."""
LOOK_AGAIN_S = 0.05
OTHERS_WITHIN_S = 20.0
"""How long another user's session may take to stop its mount, before it is stopped without it."""


class MountStop(msgspec.Struct, frozen=True):
    """The outcome of the stop of one mount; `at_rest` None where it was not seen."""

    mount: str
    by: str
    """"session", "guardian", "direct", or "gone": a simulated mount ended with its session."""
    at_rest: bool | None
    pid: int | None
    command: str | None
    words: str
    goes_on: GoesOn | None = None
    """The guardian that goes on with the stop where it is not known at rest."""

    def error(self) -> SattrackError | None:
        """Return the error whose exit code this is; None where the mount is at rest, or no more."""
        if self.at_rest or self.by == "gone":
            return None
        return (LinkLostError if self.at_rest is None else SattrackError)(f"{self.mount}: {self.words}")


def stop_session(owner: Owner, waiting: Callable[[], None]) -> MountStop | None:
    """Have a session stop its mount and end; None where the session is gone, or the mount not known at rest.

    Another user's session is asked as well, but its word does not count: the mount is sent an abort, and is
    not known at rest. Raises SattrackError where a session does not answer.
    """
    if not owner.trusted:
        with contextlib.suppress(SattrackError):
            address = owned_address(owner)
            if isinstance(address, Address):
                nobody_listens(address, encode_command(Command(abort=True)), ASK_WITHIN_S)
            ask_stop(owner, waiting, OTHERS_WITHIN_S)
        return None
    stopped = ask_stop(owner, waiting)
    if stopped is not None and stopped.goes_on is not None:
        words = f"IT IS NOT KNOWN AT REST: {stopped.goes_on}; {GIVE_UP}"
        return MountStop(
            owner.mount, stopped.by, stopped.at_rest, owner.pid, owner.command, words, stopped.goes_on
        )
    if stopped is None or not stopped.at_rest:
        return None
    who = "its guardian" if stopped.by == "guardian" else "it"
    words = f"stopped and seen at rest; `{owner.command}`, process {owner.pid}, has ended, {who} saw to it"
    return MountStop(owner.mount, stopped.by, True, owner.pid, owner.command, words)


@dataclass(slots=True)
class DirectLoop(RealtimeLoop):
    """Stops a mount until it is seen at rest, or its time has passed, or nothing is there to be stopped."""

    driver: DirectStop
    waiting: Callable[[], None]
    ends_with_session: bool = False
    """Whether the mount is a simulated one that its session took with it, though it was heard just now."""
    nobody: bool = field(default=False, init=False)
    _asked_s: float = field(default_factory=time.monotonic, init=False)

    @property
    def rest(self) -> bool | None:
        """See RealtimeLoop."""
        return None if self.nobody else bool(self.driver.mount_stopped)

    def interrupt(self, now_utc_s: float) -> None:
        """See RealtimeLoop: the mount is being stopped already."""

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """See RealtimeLoop: likewise."""

    def report(self) -> None:
        """Look whether a mount that is not heard is there at all."""
        self.waiting()
        now_s = time.monotonic()
        heard_s = 0.0
        age_s = self.driver.session.health.age_s(now_s)
        if age_s is not None:
            if not self.ends_with_session:
                return
            heard_s = now_s - age_s
        if now_s - max(self._asked_s, heard_s) < GONE_AFTER_S:
            return
        self._asked_s = now_s
        address = self.connection.link.address
        assert isinstance(address, Address)
        if nobody_listens(address, encode_command(Command(abort=True)), LOOK_AGAIN_S):
            self.nobody = self.driver.stop.finished = True


def stop_directly(
    address: MountAddress,
    profile: MountProfile,
    waiting: Callable[[], None],
    ends_with_session: bool = False,
) -> MountStop:
    """Stop a mount that no session owns, by datagrams of our own, and see it at rest.

    `ends_with_session` tells that it is a simulated one, which may end meanwhile as its session has. Raises
    SattrackError where another session comes in between, or the port is not available.
    """
    wait_until_free(address, waiting)
    mount = address.name
    with owned(address.to_stop(), profile) as (link, guard):
        # By the monotonic clock itself: nothing here depends on the time of day.
        connection = Connection(link, SimulatedClock(0.0, 0.0), guard=guard)
        stop = DirectStop(profile, time.monotonic())
        loop = DirectLoop(connection, StopRequest(), stop, waiting, ends_with_session)
        loop.run()
        if loop.nobody:
            return MountStop(mount, "direct", None, None, None, NOBODY)
        goes_on = (
            None if stop.mount_stopped else GoesOn(guard.pid, utc_now(), stop.last_heard(time.monotonic()))
        )
    if stop.mount_stopped:
        return MountStop(mount, "direct", True, None, None, "stopped and seen at rest")
    words = "it was sent a stop and IS NOT AT REST" if stop.mount_stopped is False else "it was sent a stop"
    if stop.mount_stopped is None:
        words += ", but is NOT HEARD: it is unknown whether it obeyed"
    words = f"{words}; {goes_on}; look after it, and stop it by its own console; {GIVE_UP}"
    return MountStop(mount, "direct", stop.mount_stopped, None, None, words, goes_on)


def stop_after(owner: Owner, profile: MountProfile, waiting: Callable[[], None]) -> MountStop:
    """Stop directly a mount whose session has ended without knowing it at rest. Raises SattrackError."""
    address = owned_address(owner)
    stopped = stop_directly(address, profile, waiting, owner.simulated)
    if stopped.words == NOBODY and address.host.startswith("127."):
        words = f"the simulated mount has ended with its session, `{owner.command}`, process {owner.pid}"
        return msgspec.structs.replace(stopped, by="gone", pid=owner.pid, command=owner.command, words=words)
    return stopped


def wait_until_free(address: MountAddress, waiting: Callable[[], None]) -> None:
    """Wait for the end of a session that owns the mount still; raises Taken where it does not come."""
    until_s = time.monotonic() + FREE_WITHIN_S
    while (owner := owner_of(address.name)) is not None:
        if time.monotonic() > until_s:
            raise Taken(
                f"{address} has an owner: {owner}; it does not end: `kill {owner.pid}`, "
                "and stop the mount by its own console"
            )
        waiting()
        time.sleep(LOOK_AGAIN_S)

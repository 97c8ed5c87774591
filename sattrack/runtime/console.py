"""Manual operation in real time."""

from __future__ import annotations

import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.core.channel import LineReader
from sattrack.mount.xerxes.client import Address, UdpLink, nobody_listens
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.runtime import practice
from sattrack.runtime.embedded import simulator_config, start_embedded
from sattrack.runtime.guard import Guard, Unguarded, owned
from sattrack.runtime.links import heard
from sattrack.runtime.loop import DriverLike, RealtimeLoop
from sattrack.runtime.signals import StopRequest, stopping
from sattrack.views.messages import Leave, decode_order

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sattrack.control.console import Console, ConsoleSession
    from sattrack.core.clock import Clock
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.embedded import EmbeddedMount
    from sattrack.runtime.mounts import MountAddress
    from sattrack.runtime.owner import OverheardLink
    from sattrack.views.messages import ConsoleMessage
    from tle.site import Site

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


@dataclass(slots=True)
class Connection:
    """A socket towards a mount, and the clock to run by; `simulated` is the one started for it.

    `guard` watches whoever may set the mount going.
    """

    link: UdpLink | OverheardLink
    clock: Clock
    simulated: EmbeddedMount | None = None
    guard: Guard = field(default_factory=Unguarded)

    @property
    def telescope(self) -> DeviceFacts | None:
        """What an Alpaca telescope at the other end is; None for other mounts, and where it is overheard."""
        return getattr(self.link, "facts", None)

    def now_utc_s(self) -> float:
        """Return the instant that is now, UTC."""
        return self.clock.utc_s(time.monotonic())

    def refused(self) -> bool:
        """Tell whether the mount's host says that nothing listens at the mount's port."""
        address = self.link.address
        return isinstance(address, Address) and nobody_listens(address, encode_command(Command()))


@contextmanager
def connected(
    address: MountAddress | None, described: ProfileFile, site: Site | None, clock: Clock, own: bool = True
) -> Iterator[Connection]:
    """Give a connection to a mount; with `address` None, to a simulated one in a process of its own.

    With `own`, the mount is owned, and guarded, meanwhile; without, nothing may be asked of it, and where a
    session owns it, what that hears is overheard. Raises SattrackError where it has another owner, or the
    port, or the simulated mount, is not available.
    """
    with ExitStack() as stack:
        simulated = None
        if address is None:
            simulated = start_embedded(
                simulator_config(described.mount, described.simulator, site or practice.SITE.place(), clock)
            )
            stack.callback(simulated.close)
            address = simulated.address
        if own:
            name = None if simulated is None else "sim"
            link, guard = stack.enter_context(owned(address, described.mount, clock.speed, name))
            yield Connection(link, clock, simulated, guard)
            return
        yield Connection(stack.enter_context(heard(address)), clock, simulated)


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
            except (msgspec.MsgspecError, RecursionError):
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
        """See RealtimeLoop. A mount that was told to stop and never heard may move on."""
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
    told: list[threading.Thread] = []

    def obey(now_utc_s: float) -> None:
        for order in inbox.orders():
            console_session.obey(order, now_utc_s)
        if console_session.stop_wanted and stop_owner is not None and not told:
            told.append(threading.Thread(target=stop_owner, name="stop", daemon=True))
            told[0].start()

    return attend(console_session, connection, show, obey)

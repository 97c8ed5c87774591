"""A connection to a mount, real or simulated, owned by one session and watched by its guardian.

A guardian is a small process in a session of its own, so that what ends the feeder does not end it. It holds
the feeder's socket, so that the port stays bound, and the mount's name. It stops the mount when the feeder is
gone without having let go, or stands still for HANG_AFTER_S; a feeder that wakes up then must not send any
more.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from sattrack.core.channel import PipedProcess
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import SattrackError
from sattrack.core.process import self_command
from sattrack.mount.alpaca.link import AlpacaAddress
from sattrack.mount.simulator.mount import SimulatedSite, Truth
from sattrack.mount.simulator.process import ClockSetting, Ready, SimulatorConfig
from sattrack.mount.simulator.profile import simulator_profile
from sattrack.mount.xerxes.client import Address, nobody_listens
from sattrack.mount.xerxes.datagrams import Command, encode_command, sets_going
from sattrack.runtime import demo_pass
from sattrack.runtime.guardian import (
    GuardianTask,
    Release,
    Word,
    angle_word,
    create_page,
    note_status,
    open_page,
)
from sattrack.runtime.mounts import SIMULATED, Owner, claim, open_link, open_listener
from sattrack.runtime.system import this_command, this_user, utc_now
from sattrack.runtime.turns import LOOK_AT_CABLES, followed_axis_deg, left_moving

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.core.clock import Clock
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.simulator.mount import StartPosition
    from sattrack.mount.xerxes.client import UdpLink
    from sattrack.runtime.mounts import MountAddress, OverheardLink
    from sattrack.settings import SiteSettings
    from tle.site import Site


HANG_AFTER_S = 1.0
"""How long a feeder may stand still before its guardian takes the mount from it."""
START_WITHIN_S = 20.0
END_WITHIN_S = 3.0
LOOK_EVERY_BEATS = 20
LONGEST_KNOWN_S = 1e6
"""Turns that are known for longer are as good as known for ever."""
NO_FLAGS = bytes(8)
FLAGS = slice(73, 81)
COUNTER = slice(8, 16)
"""Where a command has its flags, and its number."""


class MountGuard(Protocol):
    """The watch over a loop that feeds a mount: what the loop reports, and what it must obey."""

    @property
    def deposed(self) -> bool:
        """Whether the mount was taken away: nothing more may be sent, and the loop must end."""

    @property
    def stop_asked(self) -> bool:
        """Whether the mount must be stopped and the session end."""

    @property
    def trouble(self) -> str | None:
        """Why the loop must stop the mount, or has lost it; None while all is well."""

    @property
    def first_axis_deg(self) -> float | None:
        """Where a session before left the first axis, turns counted; None: within half a turn of its zero."""

    @property
    def followed_deg(self) -> float | None:
        """Where the first axis is, turns counted, if it has followed the sky since; None: not known."""

    def beat(
        self,
        datagram: bytes | None = None,
        turns_known_s: float = math.inf,
        first_axis_deg: float | None = None,
    ) -> bool:
        """Report that the loop turns, just before `datagram` is sent; return whether it may be sent.

        From its newest status on, the turns of the mount's axes are known for `turns_known_s`; the first axis
        is at `first_axis_deg`, turns counted, None where that is not known.
        """

    def release(self, at_rest: bool | None) -> None:
        """Release the mount: the loop's work is done, and `at_rest` is what is known of the mount."""


class Unguarded:
    """No watch: the loop cannot set the mount going."""

    deposed = stop_asked = False
    trouble: str | None = None
    first_axis_deg: float | None = None
    followed_deg: float | None = None

    def beat(
        self,
        datagram: bytes | None = None,
        turns_known_s: float = math.inf,
        first_axis_deg: float | None = None,
    ) -> bool:
        """See MountGuard."""
        del datagram, turns_known_s, first_axis_deg
        return True

    def release(self, at_rest: bool | None) -> None:
        """See MountGuard."""
        del at_rest


class Guarded:
    """A guardian at work; where it dies, another takes its place once, and then the run ends."""

    followed_deg: float | None = None

    def __init__(
        self, link: UdpLink, listener: int, profile: MountProfile, speed: float, name: str, owned_as: str
    ) -> None:
        self._memory = create_page()
        self._words = open_page(self._memory)
        link.onlooker = partial(note_status, self._words)
        self._task = GuardianTask(
            memory=self._memory,
            link=link.fileno(),
            listener=listener,
            address=link.address,
            profile=profile,
            speed=speed,
            hang_after_s=HANG_AFTER_S,
            owner=Owner(
                pid=os.getpid(),
                user=this_user(),
                command=this_command(),
                since_utc=utc_now(),
                mount=owned_as,
                listen_port=link.listen_port,
                simulated=name == SIMULATED,
            ),
            local=not name.startswith("xerxes://"),
            simulated=name == SIMULATED,
        )
        self._name = name
        before = None if name == SIMULATED else left_moving(owned_as)
        self._turns_before = None if before is None else before.trouble(time.time())
        self.first_axis_deg = None if before is None else before.first_axis_deg
        if name != SIMULATED:
            self.followed_deg = followed_axis_deg(owned_as, time.time())
        # Its guardian, which writes this word, does not run yet.
        self._words[Word.TURNS_LOST] = self._turns_before is not None
        self._beats = 0
        self._armed = False
        self._aborts = False
        """Whether the last datagram has the abort's flag up."""
        self._restarted = False
        self._lost: str | None = None
        try:
            self._process, self._life = self._start()
        except OSError as error:
            os.close(self._memory)
            raise SattrackError(
                f"the guardian cannot be started ({error.strerror}): nothing is moved without"
            ) from error

    @property
    def pid(self) -> int:
        """The guardian's process number."""
        return self._process.pid

    @property
    def deposed(self) -> bool:
        """See MountGuard."""
        return self._words[Word.DEPOSED] != 0

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the guardian, where it had to, saw the mount at rest; None before, or without an answer."""
        stopped = self._words[Word.STOPPED]
        return Release(stopped).at_rest if stopped else None

    @property
    def stop_asked(self) -> bool:
        """See MountGuard."""
        if not self._words[Word.STOP_ASKED]:
            return False
        self._words[Word.OBEYING] = 1
        return True

    @property
    def trouble(self) -> str | None:
        """See MountGuard."""
        if not self.deposed:
            return self._lost
        rest = "was sent a stop, and NOT SEEN AT REST" if self.mount_stopped is False else "is being stopped"
        if self.mount_stopped:
            rest = "was stopped and seen at rest"
        return f"this process stood still, so its guardian took the mount from it: {self._name} {rest}"

    def beat(
        self,
        datagram: bytes | None = None,
        turns_known_s: float = math.inf,
        first_axis_deg: float | None = None,
    ) -> bool:
        """See MountGuard. Writes a few words of memory; once a second it asks whether the guardian lives.

        Nothing is set going while the turns of the mount's axes are not known.
        """
        words = self._words
        if words[Word.DEPOSED]:
            return False
        self._beats = words[Word.BEATS] = self._beats + 1
        known_ms = max(1, int(min(turns_known_s, LONGEST_KNOWN_S) * 1e3))
        words[Word.FIRST_AXIS] = angle_word(first_axis_deg)
        words[Word.TURNS_KNOWN_MS] = known_ms if turns_known_s < LONGEST_KNOWN_S else 0
        if words[Word.TURNS_LOST] and datagram is not None and sets_going(datagram):
            why = self._turns_before or f"has moved unheard, and may have gone half round: {LOOK_AT_CABLES}"
            self._lost = f"nothing is moved: {self._name} {why}"
            return False
        if datagram is not None:
            words[Word.COUNTER] = int.from_bytes(datagram[COUNTER], "little")
            flags = datagram[FLAGS] != NO_FLAGS
            if flags and not self._armed:
                self._armed = True
                words[Word.ARMED] = 1
            if flags or self._aborts:
                words[Word.ABORT_FELL] = 0 if flags else self._beats
                self._aborts = flags and not sets_going(datagram)
        if self._beats % LOOK_EVERY_BEATS == 0 and self._lost is None:
            self._look()
        return True

    def release(self, at_rest: bool | None) -> None:
        """See MountGuard."""
        if not self.deposed:
            self._words[Word.RELEASED] = Release.of(at_rest)

    def wait_ready(self) -> None:
        """Wait until the guardian watches; raises SattrackError where it does not come up."""
        readable, _, _ = select.select([self._life], [], [], START_WITHIN_S)
        try:
            watches = bool(readable) and self._life.recv(1) == b"r"
        except OSError:
            # It has ended without having read its task.
            watches = False
        if not watches:
            self._process.kill()
            self._process.wait()
            raise SattrackError(
                "the guardian did not start: nothing is moved without; "
                f"`{sys.executable} -m sattrack.runtime.guardian` shows why"
            )
        self._life.setblocking(False)

    def close(self) -> None:
        """End the watch. The guardian goes on with a mount that is not known at rest, and ends by itself."""
        self._life.close()
        ends_by_itself = self._words[Word.RELEASED] not in (0, Release.NOT_CONFIRMED) or not self._armed
        try:
            self._process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            if ends_by_itself:
                self._process.kill()
                self._process.wait()
            else:
                # It outlives us on purpose: no wait, and no warning.
                self._process.returncode = 0
        os.close(self._memory)

    def _start(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        ours, theirs = socket.socketpair()
        with contextlib.ExitStack() as closing, theirs:
            closing.callback(ours.close)
            process = subprocess.Popen(
                [*self_command("sattrack.runtime.guardian"), str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[
                    number
                    for number in (theirs.fileno(), self._memory, self._task.link, self._task.listener)
                    if number >= 0
                ],
                # Signals to the feeder's terminal or process group are not for its guardian.
                start_new_session=True,
            )
            theirs.close()
            ours.sendall(msgspec.json.encode(self._task) + b"\n")
            closing.pop_all()
        return process, ours

    def _look(self) -> None:
        """Replace a guardian that has died, once."""
        try:
            alive = self._life.recv(1) != b""
        except BlockingIOError:
            return
        except OSError:
            alive = False
        if alive:
            return
        self._life.close()
        self._process.poll()
        if self._restarted:
            self._lost = "the guardian died twice: the mount is not moved without one"
            return
        self._restarted = True
        try:
            self._process, self._life = self._start()
        except OSError as error:
            self._lost = f"the guardian died and cannot be started again ({error.strerror})"
            return
        self._life.setblocking(False)


@contextmanager
def owned(
    address: MountAddress, profile: MountProfile | None, speed: float = 1.0, name: str | None = None
) -> Iterator[tuple[UdpLink, Guarded]]:
    """Own a mount: give a link to it and the guard of its feeder; `profile` None: not known yet.

    Raises Taken, naming the owner, where the mount has one, SattrackError where the port is not available, or
    a gateway finds no mount.
    """
    with contextlib.ExitStack() as stack:
        held = claim(address)
        stack.callback(held.close)
        if isinstance(address, AlpacaAddress) and profile is not None and profile.geometry is not None:
            address = address._replace(axes_known=True)
        link = stack.enter_context(open_link(address, profile))
        profile = profile or address.usual_profile()
        guard = Guarded(link, held.fileno(), profile, speed, name or str(address), address.name)
        stack.callback(guard.close)
        guard.wait_ready()
        yield link, guard


@dataclass(slots=True)
class Connection:
    """A socket towards a mount, and the clock to run by; `simulated` is the one started for it.

    `guard` watches a loop that may set the mount going.
    """

    link: UdpLink | OverheardLink
    clock: Clock
    simulated: EmbeddedMount | None = None
    guard: MountGuard = field(default_factory=Unguarded)

    @property
    def telescope(self) -> DeviceFacts | None:
        """What an Alpaca telescope at the other end is; None for other mounts, and where it is overheard."""
        return getattr(self.link, "facts", None)

    @property
    def gone(self) -> bool:
        """Whether the simulated mount that was started for us has ended: nothing is left that could move."""
        return self.simulated is not None and self.simulated.running.process.poll() is not None

    def now_utc_s(self) -> float:
        """Return the instant that is now, UTC."""
        return self.clock.utc_s(time.monotonic())

    def refused(self) -> bool:
        """Return whether the mount's host says that nothing listens at the mount's port."""
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
    with contextlib.ExitStack() as stack:
        simulated = None
        if address is None:
            simulated = start_embedded(
                simulator_config(described.mount, described.simulator, site or demo_pass.SITE.place(), clock)
            )
            stack.callback(simulated.close)
            address = simulated.address
        if own:
            name = None if simulated is None else SIMULATED
            link, guard = stack.enter_context(owned(address, described.mount, clock.speed, name))
            yield Connection(link, clock, simulated, guard)
            return
        if isinstance(address, AlpacaAddress) and described.mount.geometry is not None:
            address = address._replace(axes_known=True)
        yield Connection(stack.enter_context(open_listener(address, described.mount)), clock, simulated)


_TRUTHS = msgspec.json.Decoder(Truth)


@dataclass(slots=True)
class EmbeddedMount:
    """A running simulated mount: its port, and where its axes really are."""

    running: PipedProcess
    port: int

    @property
    def address(self) -> Address:
        """Where the mount listens."""
        return Address("127.0.0.1", self.port, 0)

    def truths(self) -> list[Truth]:
        """Return the true positions since the last call."""
        return self.running.channel.messages(_TRUTHS)

    def close(self) -> None:
        """End the process."""
        self.running.close(END_WITHIN_S)


def simulated_site(site: Site | SiteSettings) -> SimulatedSite:
    """Return where a simulated mount stands."""
    return SimulatedSite(site.latitude_deg, site.longitude_deg, site.height_m)


def simulator_config(
    profile: MountProfile,
    table: dict[str, Any],
    site: Site,
    clock: Clock,
    start: StartPosition = demo_pass.START,
) -> SimulatorConfig:
    """Return how to simulate a mount by a clock; `table` is `[simulator]` of its profile.

    Raises BadInputError for a table that says what it cannot.
    """
    setting = None
    if isinstance(clock, SimulatedClock):
        setting = ClockSetting(clock.start_utc_s, clock.anchor_s, clock.speed)
    return SimulatorConfig(
        simulated_site(site), profile, start, clock=setting, hardware=simulator_profile(table)
    )


def start_embedded(config: SimulatorConfig) -> EmbeddedMount:
    """Start a simulated mount; raises SattrackError where it does not come up."""
    running = PipedProcess.start("sattrack.mount.simulator.process", msgspec.json.encode(config).decode())
    lines = running.channel.first(START_WITHIN_S)
    if not lines:
        running.close(0.0)
        raise SattrackError("the simulated mount did not start; run `sattrack sim --debug` to see why")
    return EmbeddedMount(running, msgspec.json.decode(lines[0], type=Ready).port)

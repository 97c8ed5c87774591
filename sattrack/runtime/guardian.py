"""The guardian: a small process that stops the mount when the feeder cannot do it any more.

Started by `connection.Guarded`, which sends it its task in one JSON line on the descriptor that is its only
argument. The end of that channel is the feeder's end. A page of shared memory, written without ever waiting,
shows whether the feeder's loop turns, and whether it has let go. Each word of the page has one writer and is
read and written whole, so nothing needs a lock. The page lives as long as one of both has its descriptor; a
hung or dead process holds nothing up.
"""

from __future__ import annotations

import contextlib
import math
import mmap
import os
import select
import signal
import socket
import struct
import sys
import tempfile
import time
from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.control.driver import DirectStop, sample_by_axes
from sattrack.core.angles import wrap180
from sattrack.core.errors import NO_JSON
from sattrack.core.files import user_folder
from sattrack.mount.link_loss import STOPS_SLOW_FOR_S, STOPS_SLOW_S, STOPS_SLOWEST_S
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address, UdpLink, nobody_listens
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.mount.xerxes.link import LinkState
from sattrack.runtime.mounts import (
    LONGEST_LINE,
    STOP_OR_GIVE_UP,
    Ask,
    GivenUp,
    GoesOn,
    Overheard,
    Owner,
    Stopped,
)
from sattrack.runtime.system import is_trusted, outlive, peer_of, utc_now
from sattrack.runtime.turns import (
    WOUND_DEG,
    WOUND_KNOWN_S,
    LeftAtRest,
    LeftMoving,
    NoteKeeper,
    left_moving,
    note,
    seconds_since_boot,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.mount.model import StatusSample

SIZE = mmap.PAGESIZE
STATUSES_AT = 1024
STATUSES = 8
"""So many of the last statuses are kept, each in a place of its own."""
_STATUS = struct.Struct("@dH160s")
PLACE_BYTES = 256


class Word(IntEnum):
    """The words, by their place; each has one writer, the feeder or the guardian."""

    BEATS = 0
    """Counts turns of the feeder's loop."""
    COUNTER = 1
    """Number of the last datagram that was sent."""
    ARMED = 2
    """1 once a datagram has gone out that may set the mount going."""
    RELEASED = 3
    """How the feeder ended its work, a `Release`; 0 before that."""
    OBEYING = 4
    """1 once the feeder has seen that it must stop."""
    STOP_ASKED = 5
    """1 once a stop of the mount and the end of the session was requested."""
    DEPOSED = 6
    """1 once the mount is the guardian's: the feeder has stood still for too long."""
    STOPPED = 7
    """How the guardian's own stop ended, a `Release`; 0 before that."""
    HEARD = 8
    """The feeder's count of statuses from the mount."""
    TURNS_KNOWN_MS = 9
    """For how long after the newest status the turns of the mount's axes stay known; 0 for ever."""
    TURNS_LOST = 10
    """1 once the mount may have gone half round unheard."""
    ABORT_FELL = 11
    """The beat with which an abort's flag fell, which the mount has acknowledged; 0 once any flag is up."""
    FIRST_AXIS = 12
    """The first axis' angle with its turns, by `angle_word`; 0 while it is not known. The guardian's to write
    once the mount is."""


FULL_TURNS_DEG = 360_000.0
"""More than any cables bear: what is added to an angle, so that its word is positive."""


def angle_word(angle_deg: float | None) -> int:
    """Return an angle as a word, to a thousandth of a degree; 0 for None."""
    return 0 if angle_deg is None else max(1, round(1e3 * (angle_deg + FULL_TURNS_DEG)))


def angle_of(word: int) -> float | None:
    """Return the angle that a word says, degrees; None for 0."""
    return word / 1e3 - FULL_TURNS_DEG if word else None


class Release(IntEnum):
    """How a feeder, or its guardian, ended its work: what is known of the mount."""

    UNKNOWN = 1
    AT_REST = 2
    NOT_CONFIRMED = 3

    @classmethod
    def of(cls, at_rest: bool | None) -> Release:
        """Return the one for what is known."""
        if at_rest is None:
            return cls.UNKNOWN
        return cls.AT_REST if at_rest else cls.NOT_CONFIRMED

    @property
    def at_rest(self) -> bool | None:
        """Whether the mount is at rest; None where that is not known."""
        return {Release.UNKNOWN: None, Release.AT_REST: True, Release.NOT_CONFIRMED: False}[self]


class ReceivedStatus(NamedTuple):
    """One datagram from the mount, and the reading of the monotonic clock when it arrived."""

    monotonic_s: float
    data: bytes


def note_status(page: memoryview, monotonic_s: float, data: bytes) -> None:
    """Keep a datagram from the mount for clients that look on, cut to the length of a status."""
    bytes_, count = page.cast("B"), page[Word.HEARD]
    place = STATUSES_AT + count % STATUSES * PLACE_BYTES
    _STATUS.pack_into(bytes_, place, monotonic_s, min(len(data), 160), data)
    # Only now: a reader takes what the count covers.
    page[Word.HEARD] = count + 1


def statuses_since(page: memoryview, count: int) -> tuple[int, list[ReceivedStatus]]:
    """Return the count of datagrams so far, and those after `count` that are still kept."""
    bytes_, heard = page.cast("B"), page[Word.HEARD]
    found = []
    # The oldest place may be written anew this very moment.
    for number in range(max(count, heard - STATUSES + 1), heard):
        place = STATUSES_AT + number % STATUSES * PLACE_BYTES
        monotonic_s, length, data = _STATUS.unpack_from(bytes_, place)
        found.append(ReceivedStatus(monotonic_s, data[:length]))
    return heard, found


def create_page() -> int:
    """Return the descriptor of a fresh page, all words 0; it has no name that anybody else could open."""
    if sys.platform.startswith("linux"):
        descriptor = os.memfd_create("sattrack-guard")
    else:
        descriptor, path = tempfile.mkstemp(prefix="sattrack-guard-")
        os.unlink(path)  # noqa: PTH108 - it came as a string
    os.ftruncate(descriptor, SIZE)
    return descriptor


def open_page(descriptor: int) -> memoryview:
    """Return the page as a view of words, indexed by `Word`."""
    page = mmap.mmap(descriptor, SIZE)
    page[0] = page[0]  # touched, so that the first beat finds it in memory
    return memoryview(page).cast("Q")


POLL_S = 0.1
WATCH_S = 0.02
"""How often it looks for statuses to hand on, while somebody looks on."""
NOTE_EVERY_S = 1.0
"""How often it notes how the mount moves, for a session after a loss of power."""
OBEY_WITHIN_S = 1.0
"""How long a feeder whose loop turns may ignore a stop."""
GONE_AFTER_S = 1.0
"""After each so long in silence, a mount on this machine is asked whether it is there at all."""
ASK_WITHIN_S = 0.02
MOST_CLIENTS = 32


class GuardianTask(msgspec.Struct, frozen=True):
    """The task of a guardian: descriptors, the mount, and whose it is."""

    memory: int
    link: int
    listener: int
    address: Address
    profile: MountProfile
    speed: float
    hang_after_s: float
    owner: Owner
    local: bool = False
    """Whether the mount is a program of this machine, simulated or a gateway, that may end."""
    simulated: bool = False
    """Whether it is the simulated mount that the feeder has started."""


@dataclass(slots=True)
class GuardianClient:
    """A client of the guardian, and what it has sent so far of a line."""

    connection: socket.socket
    received: bytes = b""
    waits: bool = False
    """Whether it asked for a stop, and waits for its end."""
    heard: int | None = None
    """The count of statuses sent to it; None where it does not look on."""


@dataclass(slots=True)
class FeederWatch:
    """Judges a feeder by its heartbeat, without I/O.

    `silent_s` counts only time in which the guardian itself was awake: time in which the
    whole machine stood still does not count.
    """

    words: memoryview
    hang_after_s: float
    silent_s: float = 0.0
    ignored_s: float = 0.0
    _beats: int = 0

    def look(self, elapsed_s: float) -> str | None:
        """Return why the mount must be taken from a feeder that lives, or None."""
        elapsed_s = min(elapsed_s, 2.0 * POLL_S)
        words = self.words
        if words[Word.RELEASED] or not words[Word.ARMED]:
            return None
        beats = words[Word.BEATS]
        self.silent_s = 0.0 if beats != self._beats else self.silent_s + elapsed_s
        self._beats = beats
        ignores = words[Word.STOP_ASKED] and not words[Word.OBEYING]
        self.ignored_s = self.ignored_s + elapsed_s if ignores else 0.0
        if self.silent_s > self.hang_after_s:
            return f"stood still for {self.silent_s:.1f} s"
        if self.ignored_s > OBEY_WITHIN_S:
            return "did not obey a stop"
        return None


@dataclass(slots=True)
class Guardian:
    """Watches one feeder until it has ended, and the mount's rest after that if need be."""

    task: GuardianTask
    life: socket.socket
    words: memoryview
    link: UdpLink
    listener: socket.socket | None
    feeder: int | None
    """Descriptor of the feeder's process, for its end by force; None where there is no such thing."""
    clients: list[GuardianClient] = field(default_factory=list)
    noted: LeftMoving | None = None
    """What is noted of the mount for sessions to come."""
    keep: Callable[[str, LeftMoving | LeftAtRest | None], None] = note
    """Keeps such a note."""
    _watch: FeederWatch = field(init=False)
    _stop: DirectStop | None = None
    _why: str = ""
    _begun_s: float = 0.0
    _asked_s: float = 0.0
    """When the mount was last asked whether it is there."""
    _due_s: float = 0.0
    _reported: bool = False
    """Whether the end of the stop in hand, good or bad, has been reported."""
    _concluded: bool = False
    """Whether nothing is left to stop: the mount rests, or is not there any more."""
    _goes_on_utc: str | None = None
    """Since when the stop goes on beyond its time; None where it does not."""
    _goes_on_s: float = 0.0
    """The same by the monotonic clock."""
    _gone: bool = False
    _heard: int = 0
    """The count of statuses when it looked last."""
    _heard_s: float = 0.0
    """When that count was seen to rise, by the clock that counts sleep."""
    _left: LeftMoving | None = None
    """How a session before left the mount, until it is heard."""
    _noted_s: float = -math.inf

    def __post_init__(self) -> None:
        """Begin to watch."""
        self._watch = FeederWatch(self.words, self.task.hang_after_s)
        self._left, self._heard, self._heard_s = self.noted, self.words[Word.HEARD], seconds_since_boot()
        if self._left is not None:
            self._heard_s -= time.time() - self._left.heard_utc_s

    def run(self) -> None:
        """Watch to the end."""
        looked_s = time.monotonic()
        while not self.over:
            self._wait()
            now_s = time.monotonic()
            self.turn(now_s, now_s - looked_s)
            looked_s = now_s
        self._follow_turns(seconds_since_boot())
        self.note_left(seconds_since_boot())
        self._answer_all()

    def note_left(self, now_s: float) -> None:
        """Note where the first axis of a mount is that is left at rest: its drives may go on with the sky.

        That leads an equatorial mount's first axis alone, and at one rate.
        """
        first_deg = angle_of(self.words[Word.FIRST_AXIS])
        free = self.noted is None and not self.words[Word.TURNS_LOST]
        if free and first_deg is not None and not self.task.simulated and self.task.profile.frame is None:
            heard_utc_s = time.time() - (now_s - self._heard_s)
            self.keep(self.task.owner.mount, LeftAtRest(heard_utc_s, first_deg))

    def turn(self, now_s: float, elapsed_s: float) -> None:
        """Judge the feeder, or send what is due to the mount; `elapsed_s` is the time since the last turn."""
        self._follow_turns(seconds_since_boot())
        if self._stop is None:
            self._judge(elapsed_s)
        else:
            self._stop_mount(now_s)

    def _follow_turns(self, now_s: float) -> None:
        """Judge whether the turns of the mount's axes are known still, and note for how long they will be.

        `now_s` is by a clock that counts sleep. Until the mount is heard, what was left of it counts.
        """
        words = self.words
        # Read once: the feeder may write it meanwhile.
        known_s = words[Word.TURNS_KNOWN_MS] / 1e3
        moves = known_s > 0.0 and self._may_move()
        if self._left is not None:
            known_s, moves = self._left.known_for_s, True
        unheard_s = now_s - self._heard_s
        if moves and unheard_s > known_s:
            words[Word.TURNS_LOST] = 1
        if words[Word.HEARD] != self._heard:
            self._heard, self._heard_s, self._left = words[Word.HEARD], now_s, None
        if words[Word.TURNS_LOST]:
            lost = self.noted or LeftMoving(time.time() - unheard_s, known_s)
            if not lost.lost:
                self._keep(msgspec.structs.replace(lost, lost=True))
        elif moves:
            if now_s - self._noted_s > NOTE_EVERY_S:
                self._noted_s = now_s
                heard_utc_s = time.time() - (now_s - self._heard_s)
                self._keep(LeftMoving(heard_utc_s, known_s, first_axis_deg=self._wound_deg()))
        elif words[Word.FIRST_AXIS] or self._wound_deg() is None:
            self._note_rest(now_s)

    def _wound_deg(self) -> float | None:
        """Return the first axis' angle, turns counted, as heard or noted last; None within half a turn."""
        known_deg = angle_of(self.words[Word.FIRST_AXIS])
        if known_deg is None:
            return None if self.noted is None else self.noted.first_axis_deg
        off_deg = known_deg - self.task.profile.first_axis_middle_deg
        return known_deg if abs(off_deg) > WOUND_DEG else None

    def _note_rest(self, now_s: float) -> None:
        """Note how the cables are wound of a mount that is at rest, or nothing."""
        wound_deg = self._wound_deg()
        if wound_deg is None:
            if self.noted is not None:
                self._keep(None)
        elif self.noted is None or self.noted.lost or now_s - self._noted_s > NOTE_EVERY_S:
            self._noted_s = now_s
            self._keep(LeftMoving(time.time(), WOUND_KNOWN_S, first_axis_deg=wound_deg))

    def _may_move(self) -> bool:
        """Return whether the mount may be in motion, as far as feeder and guardian know."""
        if self._stop is None:
            return self._left_moving()
        # What stands behind a gateway that has ended is not known to rest.
        return not (self._stop.mount_stopped or (self._concluded and self.task.simulated))

    def _keep(self, moving: LeftMoving | None) -> None:
        """Keep a note of the mount for sessions to come."""
        self.noted = moving
        if not self.task.simulated:
            self.keep(self.task.owner.mount, moving)

    @property
    def over(self) -> bool:
        """Whether the feeder has ended, and nothing is left to stop."""
        if self._stop is not None:
            return self._gone and self._reported and self._goes_on_utc is None
        return self._gone and not self._left_moving()

    def _left_moving(self) -> bool:
        """Return whether the feeder has let go, if at all, of a mount that is not known at rest."""
        return bool(self.words[Word.ARMED]) and self.words[Word.RELEASED] in (0, Release.NOT_CONFIRMED)

    def _wait(self) -> None:
        watched: list[socket.socket | UdpLink] = [client.connection for client in self.clients]
        if not self._gone:
            watched.append(self.life)
        if self.listener is not None:
            watched.append(self.listener)
        looks_on = any(client.heard is not None for client in self.clients)
        timeout_s = WATCH_S if looks_on else POLL_S
        if self._stop is not None:
            watched.append(self.link)
            timeout_s = max(0.0, self._due_s - time.monotonic())
        readable, _, _ = select.select(watched, [], [], timeout_s)
        if self.life in readable:
            self._receive_from_feeder()
        if self.listener is not None and self.listener in readable:
            self._admit()
        for client in [client for client in self.clients if client.connection in readable]:
            self._receive(client)
        for client in [client for client in self.clients if client.heard is not None]:
            self._show(client)
        if self.link in readable:
            self.hear()

    def hear(self) -> None:
        """Take what the mount has sent, where it is the guardian's to stop."""
        if self._stop is None:
            return
        arrivals = self.link.receive()
        heard = [self._stop.receive(one.data, one.monotonic_s * self.task.speed) for one in arrivals]
        for sample in heard:
            if sample is not None:
                self._count_turns(sample)
        # Only a status ends the waiting; any program may send something to this port.
        if any(sample is not None for sample in heard) and self._due_s - time.monotonic() > self._period_s:
            self._due_s = time.monotonic()

    def _count_turns(self, sample: StatusSample) -> None:
        """Take on where the first axis is, which its feeder does no more."""
        before_deg, frame = angle_of(self.words[Word.FIRST_AXIS]), self.task.profile.frame
        if before_deg is None:
            return
        one = sample if frame is None else sample_by_axes(sample, frame)
        axis_deg = one.sidereal_h * 15.0 - one.ra_deg + (180.0 if one.beyond_pole else 0.0)
        self.words[Word.FIRST_AXIS] = angle_word(before_deg + wrap180(axis_deg - before_deg))

    def _receive_from_feeder(self) -> None:
        try:
            self._gone = self.life.recv(LONGEST_LINE) == b""
        except OSError:
            self._gone = True

    def _judge(self, elapsed_s: float) -> None:
        """Decide whether the mount is the guardian's from here on."""
        if self.words[Word.RELEASED] == Release.NOT_CONFIRMED and self._left_moving():
            self._take_over("ended without seeing the mount at rest")
            if self.task.simulated and self._refused():
                self._conclude()
            else:
                self._go_on(time.monotonic())
            return
        if self._gone:
            if self._left_moving():
                self._take_over("ended without a word")
            return
        why = self._watch.look(elapsed_s)
        if why is not None:
            self.words[Word.DEPOSED] = 1
            self._take_over(why)
        elif self.words[Word.RELEASED]:
            self._answer_all()

    def _take_over(self, why: str) -> None:
        self._why = why
        now_s = self._begun_s = self._due_s = time.monotonic()
        counter = self.words[Word.COUNTER]
        utc_s = now_s * self.task.speed
        self._stop = DirectStop(self.task.profile, utc_s, counter, self._abort_acts_in_s())
        self.link.onlooker = partial(note_status, self.words)
        # What has waited unread since the feeder read last is old, but for the newest.
        for arrival in self.link.receive()[-1:]:
            self._stop.receive(arrival.data, arrival.monotonic_s * self.task.speed)
        self._stop_mount(now_s)

    def _abort_acts_in_s(self) -> float:
        """Return the mount's time until an abort of the feeder's acts, which the mount has acknowledged."""
        words, profile = self.words, self.task.profile
        if not words[Word.ABORT_FELL]:
            return 0.0
        since_s = (words[Word.BEATS] - words[Word.ABORT_FELL]) * profile.period_s
        since_s += self._watch.silent_s * self.task.speed
        return max(0.0, profile.abort_delay_s - since_s)

    def _stop_mount(self, now_s: float) -> None:
        """Send the datagram that is due, and report how the stop has ended, once it has."""
        assert self._stop is not None
        if now_s < self._due_s:
            return
        self.link.send(self._stop.tick(now_s * self.task.speed))
        self._due_s = max(self._due_s + self._pause_s(now_s), now_s)
        if self._stop.mount_stopped or self._nobody_there(now_s):
            if not (self._reported and self._goes_on_utc is None):
                self._conclude()
        elif self._stop.finished and not self._reported:
            self._go_on(now_s)

    @property
    def _period_s(self) -> float:
        return self.task.profile.period_s / self.task.speed

    def _pause_s(self, now_s: float) -> float:
        """Return how long to wait after a datagram: longer where a mount has been silent for long."""
        assert self._stop is not None
        heard = self._stop.session.link_state(now_s * self.task.speed) in {LinkState.UP, LinkState.STALE}
        if self._goes_on_utc is None or not self._reported or heard:
            return self._period_s
        return STOPS_SLOW_S if now_s - self._goes_on_s < STOPS_SLOW_FOR_S else STOPS_SLOWEST_S

    def _conclude(self) -> None:
        """Report that there is nothing left to stop."""
        assert self._stop is not None
        self._reported, self._concluded, self._goes_on_utc = True, True, None
        self.words[Word.STOPPED] = Release.of(self._stop.mount_stopped)
        self._report_stop()
        self._answer_all()

    def _go_on(self, now_s: float) -> None:
        """Report that the stop's time has passed, and go on beyond it."""
        assert self._stop is not None
        self._reported = True
        self.words[Word.STOPPED] = Release.of(self._stop.mount_stopped)
        if self._goes_on_utc is None:
            self._goes_on_utc, self._goes_on_s = utc_now(), now_s
            self._report_stop()
        self._answer_all()

    def _goes_on(self) -> GoesOn | None:
        if self._goes_on_utc is None or self._stop is None:
            return None
        heard = self._stop.last_heard(time.monotonic() * self.task.speed)
        return GoesOn(os.getpid(), self._goes_on_utc, heard)

    def _give_up(self) -> None:
        """Go on no more, as somebody has asked."""
        self._goes_on_utc = None
        self._reported = True
        # A feeder that hangs would hold the mount, and this process, forever.
        self._end_feeder()
        self._note("gave up on request; the mount is NOT KNOWN AT REST")

    def _nobody_there(self, now_s: float) -> bool:
        """Return whether a simulated mount, or a gateway, has ended itself.

        Behind another address on this machine may be a tunnel to a mount that moves on.
        """
        assert self._stop is not None
        age_s = self._stop.session.health.age_s(now_s * self.task.speed)
        heard_s = self._begun_s if age_s is None else now_s - age_s / self.task.speed
        since_s = max(self._begun_s, self._asked_s, heard_s)
        if not (self.task.local and now_s - since_s > GONE_AFTER_S):
            return False
        self._asked_s = now_s
        return self._refused()

    def _refused(self) -> bool:
        """Return whether the mount's host says that nothing listens at its port."""
        return nobody_listens(self.task.address, encode_command(Command(abort=True)), ASK_WITHIN_S)

    def _report_stop(self) -> None:
        """Report what was done, on the feeder's terminal and in a file."""
        assert self._stop is not None
        rest = "found that the mount is not there any more"
        if self._stop.mount_stopped:
            rest = f"stopped the mount: seen at rest after {time.monotonic() - self._begun_s:.1f} s"
        elif self._goes_on_utc is not None:
            rest = (
                f"still sends stops to the mount, which is NOT KNOWN AT REST, as process {os.getpid()}; "
                f"{STOP_OR_GIVE_UP}; or stop it by its own console"
            )
        self._note(rest)

    def _note(self, what: str) -> None:
        """Write a message to the feeder's terminal and to a file."""
        owner = self.task.owner
        words = f"process {owner.pid} (`{owner.command}`) {self._why}; its guardian {what}"
        with contextlib.suppress(OSError):
            os.write(2, f"sattrack: {words}\n".encode())
        with contextlib.suppress(OSError):
            path = log_path()
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a", encoding="utf-8") as file:
                file.write(f"{utc_now()} {owner.mount} {words}\n")
        if self._goes_on_utc is not None:
            # A reader of the feeder's standard error must not wait for the end of this process.
            with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - no path of ours
                os.dup2(nowhere.fileno(), 2)

    def _admit(self) -> None:
        assert self.listener is not None
        with contextlib.suppress(OSError):
            connection, _ = self.listener.accept()
            connection.setblocking(False)
            self.clients.append(GuardianClient(connection))
        if len(self.clients) > MOST_CLIENTS:
            # The client that has been silent for the longest time is dropped; a stop must always get through.
            idle = [client for client in self.clients if not client.waits]
            self._dismiss((idle or self.clients)[0])

    def _receive(self, client: GuardianClient) -> None:
        try:
            data = client.connection.recv(LONGEST_LINE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        client.received += data
        if not data or len(client.received) > LONGEST_LINE:
            self._dismiss(client)
        elif client.received.endswith(b"\n"):
            self._obey(client)

    def _obey(self, client: GuardianClient) -> None:
        try:
            ask = msgspec.json.decode(client.received, type=Ask).ask
        except (msgspec.MsgspecError, *NO_JSON):
            self._dismiss(client)
            return
        client.received = b""
        if ask == "who":
            owner = msgspec.structs.replace(self.task.owner, state=self._state(), goes_on=self._goes_on())
            self._send(client, owner)
            return
        if ask == "give-up":
            # Anybody may stop the mount; that it goes on unstopped is for its user to say.
            goes_on = self._goes_on() if is_trusted(peer_of(client.connection)[1]) else None
            self._send(client, GivenUp(goes_on))
            self._dismiss(client)
            if goes_on is not None:
                self._give_up()
            return
        if ask == "watch":
            client.heard = self.words[Word.HEARD]
            return
        client.waits = True
        self.words[Word.STOP_ASKED] = 1
        if self._goes_on_utc is not None and self._stop is not None and self._reported:
            self._reported, self._due_s = False, time.monotonic()
            self._stop.renew(self._due_s * self.task.speed)
        elif self._reported or (self._stop is None and self.words[Word.RELEASED]):
            self._answer_all()

    def _show(self, client: GuardianClient) -> None:
        """Send a client that looks on what the feeder has received meanwhile."""
        client.heard, statuses = statuses_since(self.words, client.heard or 0)
        for status in statuses:
            if client in self.clients:
                self._send(client, Overheard(status.monotonic_s, status.data))

    def _state(self) -> str:
        if self._gone:
            return "ended without a word, its guardian stops the mount"
        if self.words[Word.DEPOSED]:
            return "hangs, its guardian has the mount"
        return "stopping" if self.words[Word.OBEYING] or self.words[Word.RELEASED] else "running"

    def _answer_all(self) -> None:
        """Answer the clients that wait for the stop; a feeder that hangs is ended with it."""
        waiting = [client for client in self.clients if client.waits]
        if not waiting:
            return
        if self._stop is not None:
            self._end_feeder()
            stopped = Stopped("guardian", self._stop.mount_stopped, self._goes_on())
        else:
            released = self.words[Word.RELEASED]
            stopped = Stopped("session", Release(released).at_rest if released else None)
        for client in waiting:
            self._send(client, stopped)
            self._dismiss(client)

    def _end_feeder(self) -> None:
        if self.words[Word.DEPOSED] and not self._gone and self.feeder is not None:
            with contextlib.suppress(OSError):
                signal.pidfd_send_signal(self.feeder, signal.SIGKILL)

    def _send(self, client: GuardianClient, what: object) -> None:
        try:
            client.connection.send(msgspec.json.encode(what) + b"\n")
        except OSError:
            self._dismiss(client)

    def _dismiss(self, client: GuardianClient) -> None:
        client.connection.close()
        self.clients = [other for other in self.clients if other is not client]


def log_path() -> Path:
    """Return the file in which guardians say what they did: $XDG_STATE_HOME/sattrack/guardian.log."""
    return user_folder("XDG_STATE_HOME", ".local/state") / "guardian.log"


def main() -> int:
    """Run the process; returns its exit code."""
    outlive()
    life = socket.socket(fileno=int(sys.argv[1]))
    with life.makefile("rb") as lines:
        task = msgspec.json.decode(lines.readline(), type=GuardianTask)
    words = open_page(task.memory)
    link = UdpLink(task.address, socket.socket(fileno=task.link))
    listener = None if task.listener < 0 else socket.socket(fileno=task.listener)
    feeder = None
    with contextlib.suppress(OSError, AttributeError):
        feeder = os.pidfd_open(task.owner.pid)
        if os.getppid() != task.owner.pid:
            feeder = None
    life.sendall(b"r")
    life.setblocking(False)
    noted, keeper = None if task.simulated else left_moving(task.owner.mount), NoteKeeper()
    Guardian(task, life, words, link, listener, feeder, noted=noted, keep=keeper.note).run()
    keeper.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The loop alone, with an engine and a link that only note when they are called."""

from __future__ import annotations

import itertools
import math
import socket
import time
from contextlib import closing
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from sattrack.core.clock import SimulatedClock
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.datagrams import decode_command
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import flight
from sattrack.runtime.connection import Connection, Unguarded
from sattrack.runtime.flight import LiveLoop
from sattrack.runtime.loop import LAST_STOPS
from sattrack.runtime.system import StopRequest
from sattrack.views.messages import StopNow

TICKS = 40
PERIOD_S = 0.005


@dataclass
class NotedEngine:
    """Ends after some ticks; `instants_s` are what they were for, `called_s` when they were asked for."""

    shift_s: float = 0.0
    breaks_at: int | None = None
    ticks_break_from: int = 10**9
    instants_s: list[float] = field(default_factory=list)
    called_s: list[float] = field(default_factory=list)
    copy: bytes | None = None
    operated: list[Any] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    failed: bool = False
    mount_stopped: bool = True
    turns_known_s: float = math.inf
    safety: None = None
    stop: None = None
    profile: MountProfile = field(default_factory=lambda: MountProfile(period_s=PERIOD_S))
    tracker: Any = field(default_factory=lambda: SimpleNamespace(ended_by=None))
    session: Any = field(default_factory=lambda: SimpleNamespace(health=SimpleNamespace(strangers=0)))

    @property
    def finished(self) -> bool:
        return len(self.instants_s) >= TICKS

    def tick(self, now_utc_s: float) -> bytes:
        self.called_s.append(time.monotonic())
        self.instants_s.append(now_utc_s)
        if len(self.instants_s) >= self.ticks_break_from:
            raise ArithmeticError("no datagram")
        return b""

    def repeat(self) -> bytes | None:
        return self.copy

    def send_shift_s(self, _: float) -> float:
        if len(self.instants_s) == self.breaks_at:
            raise ArithmeticError("no next turn")
        return self.shift_s

    def prepare(self, _: float) -> None:
        """Nothing is computed beforehand."""

    def operate(self, message: object, _: float) -> None:
        self.operated.append(message)

    def fail(self, words: str) -> None:
        self.failed = True
        self.told.append(words)

    def view(self, _: float) -> None:
        """Nobody looks."""


class NotedLink:
    """Sends nothing anywhere, and nothing comes; a socket that nobody knows is there to be waited on."""

    strangers = unsent = 0
    trouble: str | None = None

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.sent: list[bytes] = []
        self.sent_s: list[float] = []
        self.periods_s: list[float] = []

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> list[Any]:
        return []

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        self.sent_s.append(time.monotonic())

    def close(self) -> None:
        self._socket.close()


class NotedGuard(Unguarded):
    """Takes the mount away with one of the beats; `asks_at` is the beat from which a stop is asked for."""

    def __init__(self, taken_at: int = 10**9, asks_at: int = 10**9) -> None:
        self.beats = 0
        self.released: list[bool | None] = []
        self._taken_at, self._asks_at = taken_at, asks_at

    @property
    def deposed(self) -> bool:
        return self.beats >= self._taken_at

    @property
    def stop_asked(self) -> bool:
        return self.beats >= self._asks_at

    @property
    def trouble(self) -> str | None:
        return "taken away" if self.deposed else None

    def beat(self, *_: object) -> bool:
        self.beats += 1
        return not self.deposed

    def release(self, at_rest: bool | None) -> None:
        self.released.append(at_rest)


def run(
    engine: NotedEngine,
    stop: StopRequest | None = None,
    speed: float = 1.0,
    guard: NotedGuard | None = None,
    link: NotedLink | None = None,
) -> NotedLink:
    """Run the loop to its end by a clock that shows the monotonic one's own reading."""
    link = link or NotedLink()
    screen = SimpleNamespace(show=lambda _: None)
    clock = SimulatedClock(0.0, 0.0, speed)
    connection: Any = Connection(link, clock, guard=guard or Unguarded())  # type: ignore[arg-type]
    parts: Any = (engine, NoRecording(), screen)
    with pytest.MonkeyPatch.context() as patch, closing(link):
        patch.setattr(flight, "view_of", lambda engine, now_utc_s: engine.view(now_utc_s))
        loop = LiveLoop(connection, stop or StopRequest(), *parts)
        loop.run()
    link.periods_s = [us / 1e6 for us in loop.statistics.periods_us.elements()]
    return link


def median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def test_a_datagram_is_computed_before_the_instant_it_is_for_and_never_sent_before_it() -> None:
    engine = NotedEngine()
    link = run(engine)
    assert len(link.sent_s) == TICKS
    # The first is due at once.
    ahead_s = [due - called for due, called in zip(engine.instants_s, engine.called_s, strict=True)][1:]
    assert median(ahead_s) > 0.0
    assert all(sent >= due for due, sent in zip(engine.instants_s, link.sent_s, strict=True))


def test_deadlines_are_a_period_apart_and_as_much_as_the_engine_asks() -> None:
    for shift_s in (0.0, 0.001):
        engine = NotedEngine(shift_s)
        run(engine)
        periods_s = [b - a for a, b in itertools.pairwise(engine.instants_s)]
        assert median(periods_s) == pytest.approx(PERIOD_S + shift_s, rel=1e-6)


def test_a_clock_that_runs_faster_shortens_the_real_period() -> None:
    engine = NotedEngine()
    link = run(engine, speed=2.0)
    periods_s = [b - a for a, b in itertools.pairwise(engine.instants_s)]
    assert median(periods_s) == pytest.approx(PERIOD_S, rel=1e-6)
    assert link.sent_s[-1] - link.sent_s[0] >= (TICKS - 2) * PERIOD_S / 2.0


def test_a_stop_is_obeyed_in_the_datagram_that_is_computed_next() -> None:
    stop = StopRequest()
    stop.ask()
    engine = NotedEngine()
    run(engine, stop)
    assert engine.operated[0] == StopNow()
    assert len(engine.operated) == TICKS


def test_the_guard_hears_every_datagram_and_how_it_ended() -> None:
    guard = NotedGuard()
    link = run(NotedEngine(), guard=guard)
    assert guard.beats == len(link.sent_s) == TICKS
    assert guard.released == [True]


def test_a_stop_that_comes_through_the_guard_is_the_operators() -> None:
    engine = NotedEngine()
    run(engine, guard=NotedGuard(asks_at=20))
    assert engine.operated == [StopNow()] * (TICKS - 20)


def test_once_the_mount_is_taken_away_nothing_more_is_sent_copies_neither() -> None:
    engine, guard = NotedEngine(copy=b"copy"), NotedGuard(taken_at=11)
    link = run(engine, guard=guard)
    assert guard.beats == 11
    assert len(link.sent_s) == 2 * 10
    assert engine.told == ["taken away"]
    assert guard.released == []


def test_datagrams_go_on_where_finding_the_next_deadline_breaks() -> None:
    engine = NotedEngine(breaks_at=5)
    with pytest.raises(ArithmeticError):
        run(engine)
    assert engine.told == ["no next turn"]
    assert len(engine.instants_s) == TICKS


def test_an_engine_that_goes_on_failing_ends_with_stops_said_without_it() -> None:
    engine, link, guard = NotedEngine(ticks_break_from=5), NotedLink(), NotedGuard()
    with pytest.raises(ArithmeticError, match="no datagram"):
        run(engine, guard=guard, link=link)
    assert engine.told == ["no datagram"]
    stops = [decode_command(data) for data in link.sent[4:]]
    assert [stop.abort for stop in stops] == [False] + [True] * (LAST_STOPS - 1)
    assert guard.released == []


def test_copies_go_a_quarter_of_a_period_later_and_are_no_part_of_the_period() -> None:
    engine = NotedEngine(copy=b"copy")
    link = run(engine)
    assert len(link.sent_s) == 2 * TICKS
    assert len(link.periods_s) == TICKS - 1
    assert median(link.periods_s) == pytest.approx(PERIOD_S, rel=0.2)
    after_s = [copied - sent for sent, copied in zip(link.sent_s[::2], link.sent_s[1::2], strict=True)]
    assert median(after_s) == pytest.approx(PERIOD_S / 4.0, rel=0.4)

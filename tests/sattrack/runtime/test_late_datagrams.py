"""A datagram computed before the process, or the machine, stood still is not sent if it moves the mount."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.runtime.connection import Unguarded
from sattrack.runtime.loop import LATE_ENOUGH_TO_SKIP_S, RealtimeLoop

MOVES = encode_command(Command(3, move_ra=True, move_ra_rate_deg_s=1.0))
STOPS = encode_command(Command(4, abort=True))
ENDS = encode_command(Command(5))


class Loop(RealtimeLoop):
    """A loop whose clock goes on by `late_s` between the computing and the sending."""


class Withheld(Unguarded):
    """A guard that lets nothing leave; `deposed` where it has taken the mount from the loop."""

    def __init__(self, deposed: bool) -> None:
        self.deposed = deposed

    def beat(self, *_: Any) -> bool:
        return False


def sent_by(
    datagram: bytes, late_s: float, guard: Unguarded | None = None
) -> tuple[list[bytes], list[bytes]]:
    """Return what leaves, and what is recorded, of a datagram that is late by so much."""
    instants = iter((1000.0, 1000.0 + late_s))
    left: list[bytes] = []
    recorded: list[bytes] = []
    connection: Any = SimpleNamespace(
        clock=SimpleNamespace(speed=1.0, utc_s=lambda _: next(instants)),
        now_utc_s=lambda: next(instants),
        guard=guard or Unguarded(),
        link=SimpleNamespace(send=left.append),
    )
    driver: Any = SimpleNamespace(tick=lambda _: datagram, turns_known_s=math.inf, safety=None)
    stop: Any = SimpleNamespace(asked=False)
    loop = Loop(connection, stop, driver)
    loop.sent = lambda _, data: recorded.append(data)  # type: ignore[method-assign]
    loop._send()
    return left, recorded


@pytest.mark.parametrize("datagram", [MOVES, STOPS, ENDS])
def test_in_time_everything_leaves(datagram: bytes) -> None:
    assert sent_by(datagram, 0.01) == ([datagram], [datagram])


@pytest.mark.parametrize("late_s", [LATE_ENOUGH_TO_SKIP_S, 26.0])
def test_too_late_only_what_stops_leaves_and_all_is_recorded(late_s: float) -> None:
    assert sent_by(MOVES, late_s) == ([], [MOVES])
    assert sent_by(STOPS, late_s) == ([STOPS], [STOPS])
    assert sent_by(ENDS, late_s) == ([ENDS], [ENDS])


def test_what_the_guard_keeps_back_is_recorded_so_that_a_replay_counts_alike() -> None:
    assert sent_by(MOVES, 0.01, Withheld(deposed=False)) == ([], [MOVES])
    assert sent_by(MOVES, 0.01, Withheld(deposed=True)) == ([], [])


def test_what_comes_next_is_moved_by_when_the_last_datagram_was_due_not_by_when_the_turn_is_over() -> None:
    """Copies and clients take a part of the period: it is the datagram that must fall between two turns."""
    asked: list[float] = []
    connection: Any = SimpleNamespace(
        clock=SimpleNamespace(speed=2.0, utc_s=lambda _: 1000.0),
        now_utc_s=lambda: 1000.0125,
        guard=Unguarded(),
        link=SimpleNamespace(send=lambda _: None),
    )
    driver: Any = SimpleNamespace(tick=lambda _: STOPS, turns_known_s=math.inf, safety=None)
    stop: Any = SimpleNamespace(asked=False)
    loop = Loop(connection, stop, driver)
    loop.shift_s = lambda now_utc_s: asked.append(now_utc_s) or 0.0002  # type: ignore[method-assign, func-returns-value]
    loop._send()
    due_s = loop.due_s()
    loop._shift()
    assert asked == [1000.0]
    assert loop.due_s() - due_s == pytest.approx(0.0001)

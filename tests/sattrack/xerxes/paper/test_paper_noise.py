"""Random and mutated datagrams, each way: counted, without motion, without a trace in memory.

What has the wrong length or header is no datagram of the protocol and must change nothing at all: both ends
are compared with twins that never got it. What keeps length and header but is mutated elsewhere is one, and
may be believed: then the claims are that no byte of a status makes a client send a flag unasked,
that no byte of a command outside the flags and fine rates moves a mount, and that whatever is obeyed stays
within the axes' limits.
"""

from __future__ import annotations

import dataclasses
import gc
import math
import random
import tracemalloc
from typing import TYPE_CHECKING

import pytest
from paper_link import T0
from paper_mount import LOOP_S, PaperMount
from paper_packing import FLAG_BYTES, CommandRow, pack_command, unpack_command

from sattrack.mount import AxisLimits, MountProfile
from sattrack.requests import MoveAxis, Slew
from sattrack.safety import ClearedRequest
from sattrack.xerxes.session import Session
from sattrack.xerxes.simulator.mount import SimulatedMount, SimulatedSite, StartPosition

if TYPE_CHECKING:
    from collections.abc import Callable

HOW_MANY = [pytest.param(20_000, id="20,000"), pytest.param(1_000_000, id="10^6", marks=pytest.mark.soak)]
GROWTH_BYTES = 8_192
"""What a run of any length may leave behind: counters that grew past small integers, a bounded history."""
COMMAND = pack_command(
    CommandRow(
        counter=123456,
        TargetDec=45.0,
        TargetRA=12.5,
        MoveAxisRateDec=1.0,
        MoveAxisRateRA=-1.0,
        PulseGuideRADuration=500,
        PulseGuideDecDuration=-500,
    )
)
STATUS = PaperMount(count=5000).turn()
FINE_RATES = range(48, 64)


def wrong(rng: random.Random, valid: bytes) -> bytes:
    """Something that is no such datagram: noise, or a valid one of another length or with another header."""
    kind = rng.randrange(5)
    if kind == 0:
        return b"\xff" + rng.randbytes(rng.randrange(400))
    if kind == 1:
        return valid[: rng.randrange(len(valid))]
    if kind == 2:
        return valid + rng.randbytes(rng.randint(1, 200))
    if kind == 3:
        bit = rng.randrange(64)
        data = bytearray(valid)
        data[bit // 8] ^= 1 << bit % 8
        return bytes(data)
    return b"\x00" + rng.randbytes(len(valid) - 1)


def mutated(rng: random.Random, valid: bytes, untouched: frozenset[int] = frozenset()) -> bytes:
    """A datagram by length and header with one to eight of its other bytes changed at random."""
    data = bytearray(valid)
    for _ in range(rng.randint(1, 8)):
        offset = rng.randrange(8, len(valid))
        if offset not in untouched:
            data[offset] = rng.randrange(256)
    return bytes(data)


def session_counts(session: Session) -> tuple[int, ...]:
    health = session.health
    return health.received, health.late, health.duplicate, health.rejected


def grown_bytes(step: Callable[[int], None], count: int) -> int:
    """How much more is allocated after all steps than after nine tenths of them.

    Tracing slows everything down many times, so it begins after eight tenths; what has a bound is replaced
    by then, and what grows by an object a step shows in the last tenth.
    """
    traced, measured = count * 8 // 10, count * 9 // 10
    for number in range(traced):
        step(number)
    gc.collect()
    tracemalloc.start()
    try:
        for number in range(traced, measured):
            step(number)
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for number in range(measured, count):
            step(number)
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("count", HOW_MANY)
class TestTheClient:
    def test_what_is_no_status_is_counted_and_changes_nothing(self, count: int) -> None:
        rng = random.Random(1)
        noisy, quiet = Session(MountProfile()), Session(MountProfile())
        mount = PaperMount(ra_deg=150.0)
        rejected = 0

        def period(number: int) -> None:
            nonlocal rejected
            now = T0 + number * LOOP_S
            for _ in range(10):
                assert noisy.receive(wrong(rng, STATUS), now) is None
                rejected += 1
            if number == 20:
                for session in (noisy, quiet):
                    session.submit(ClearedRequest(Slew(160.0, 25.0)))
            data = noisy.compose()
            assert data == quiet.compose()
            mount.receive(data)
            status = mount.turn()
            assert noisy.receive(status, now) == quiet.receive(status, now)

        grown = grown_bytes(period, count // 10)
        assert noisy.health.rejected == rejected == count // 10 * 10
        assert quiet.health.rejected == 0
        assert session_counts(noisy)[:3] == session_counts(quiet)[:3]
        assert (mount.ra_deg, mount.dec_deg) == (160.0, 25.0)
        assert len(mount.launches) == 1
        assert grown < GROWTH_BYTES

    def test_no_status_whatever_makes_it_send_a_flag_unasked(self, count: int) -> None:
        rng = random.Random(2)
        session = Session(MountProfile())
        mount = PaperMount()

        def datagram(number: int) -> None:
            now = T0 + number * LOOP_S
            before = sum(session_counts(session))
            session.receive(mutated(rng, mount.turn()), now)
            assert sum(session_counts(session)) == before + 1
            assert not unpack_command(session.compose()).up()

        grown = grown_bytes(datagram, count)
        assert sum(session_counts(session)) == count
        assert session.health.rejected > 0
        assert session.health.received > 0
        assert grown < GROWTH_BYTES


def simulated() -> SimulatedMount:
    return SimulatedMount(LIMITED, SimulatedSite(48.0, 11.0, 500.0), StartPosition(-30.0, 20.0))


LIMITED = MountProfile(ra=AxisLimits(4.0, 8.0, 6.0), dec=AxisLimits(3.0, 8.0, 5.0))


@pytest.mark.parametrize("count", HOW_MANY)
class TestTheMount:
    def test_what_is_no_command_is_counted_and_moves_nothing(self, count: int) -> None:
        rng = random.Random(3)
        noisy, quiet = simulated(), simulated()
        rejected = 0

        def period(number: int) -> None:
            nonlocal rejected
            for _ in range(10):
                assert noisy.receive(wrong(rng, COMMAND)) is False
                rejected += 1
            now = T0 + number * LOOP_S
            status, truth = noisy.tick(now)
            quiet_status, quiet_truth = quiet.tick(now)
            assert status == quiet_status
            assert dataclasses.astuple(truth) == dataclasses.astuple(quiet_truth)

        grown = grown_bytes(period, count // 10)
        assert noisy.refused == rejected == count // 10 * 10
        assert quiet.refused == 0
        assert grown < GROWTH_BYTES

    def test_a_command_without_a_flag_moves_nothing_whatever_its_other_bytes(self, count: int) -> None:
        rng = random.Random(4)
        noisy, quiet = simulated(), simulated()
        untouched = frozenset(FLAG_BYTES.values()) | frozenset(FINE_RATES)
        taken = 0

        def period(number: int) -> None:
            nonlocal taken
            for _ in range(10):
                taken += noisy.receive(mutated(rng, COMMAND, untouched))
            now = T0 + number * LOOP_S
            truth, quiet_truth = noisy.tick(now)[1], quiet.tick(now)[1]
            assert dataclasses.astuple(truth) == dataclasses.astuple(quiet_truth)

        grown = grown_bytes(period, count // 10)
        assert taken + noisy.refused == count // 10 * 10
        assert taken > 0
        assert grown < GROWTH_BYTES

    def test_whatever_is_obeyed_stays_within_the_axes_limits(self, count: int) -> None:
        rng = random.Random(5)
        mount = simulated()
        session = Session(LIMITED)
        accepted = 0

        def period(number: int) -> None:
            nonlocal accepted
            for _ in range(5):
                mount.receive(mutated(rng, COMMAND))
            now = T0 + number * LOOP_S
            status, truth = mount.tick(now)
            assert all(math.isfinite(value) for value in dataclasses.astuple(truth))
            # The axis turns by the sky's rate less that of the right ascension; limits are the slew's.
            assert abs(truth.ra_rate_deg_s) <= 6.0 + 0.01
            assert abs(truth.dec_rate_deg_s) <= 5.0 + 0.001
            assert -90.0 <= truth.dec_deg <= 90.0
            accepted += session.receive(status, now) is not None

        grown = grown_bytes(period, count // 5)
        # Every status that it sent meanwhile was one that can be.
        assert accepted == count // 5
        assert session.health.rejected == 0
        assert grown < GROWTH_BYTES


@pytest.mark.parametrize("count", HOW_MANY)
@pytest.mark.parametrize("how", ["held", "edge"])
def test_noise_of_the_right_form_never_makes_a_moving_client_send_two_commands_at_once(
    count: int, how: str
) -> None:
    rng = random.Random(6)
    session = Session(MountProfile(move_axis="held" if how == "held" else "edge"))
    mount = PaperMount()
    ticket = session.submit(ClearedRequest(MoveAxis(1.0, -1.0)))
    for number in range(count // 2):
        session.receive(mutated(rng, mount.turn()), T0 + number * LOOP_S)
        assert unpack_command(session.compose()).up() <= {"MoveAxisRA", "MoveAxisDec"}
        if ticket.settled and number % 97 == 0:
            ticket = session.submit(ClearedRequest(MoveAxis(rng.uniform(-1, 1), rng.uniform(-1, 1))))

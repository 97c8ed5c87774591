"""Random and mutated datagrams to the client: counted, without a flag raised, without a trace in memory.

What has the wrong length or header is no status and must change nothing at all: the session is compared with
a twin that never got it. What keeps length and header but is mutated elsewhere is a status, and may be
believed: then the claim is that nothing in it makes a client send a flag that nobody asked for.
"""

from __future__ import annotations

import random
import struct

import pytest
from paper_link import T0
from paper_mount import LOOP_S, PaperMount
from paper_noise import GROWTH_BYTES, HOW_MANY, STATUS, grown_bytes, mutated, wrong
from paper_packing import unpack_command

from sattrack.mount.model import MountProfile, Slew
from sattrack.mount.requests import ClearedRequest, MoveAxis, Sync
from sattrack.mount.xerxes.session import Session


def session_counts(session: Session) -> tuple[int, ...]:
    health = session.health
    return health.received, health.late, health.duplicate, health.rejected


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

        def datagram(number: int) -> None:
            now = T0 + number * LOOP_S
            before = sum(session_counts(session))
            status = STATUS[:104] + struct.pack("<d", number + 1.0) + STATUS[112:]
            session.receive(mutated(rng, status), now)
            assert sum(session_counts(session)) == before + 1
            assert not unpack_command(session.compose()).up()

        grown = grown_bytes(datagram, count)
        assert sum(session_counts(session)) == count
        assert session.health.rejected > 0
        assert session.health.received > 0
        assert grown < GROWTH_BYTES


@pytest.mark.parametrize("count", HOW_MANY)
@pytest.mark.parametrize("how", ["held", pytest.param("edge", marks=pytest.mark.soak)])
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


@pytest.mark.parametrize(
    ("count", "most_bytes"),
    [(100, GROWTH_BYTES // 2), pytest.param(50_000, GROWTH_BYTES, marks=pytest.mark.soak)],
)
def test_requests_that_are_settled_leave_nothing_behind(count: int, most_bytes: int) -> None:
    session = Session(MountProfile())
    mount = PaperMount()
    now = T0

    def asked(number: int) -> None:
        nonlocal now
        ticket = session.submit(ClearedRequest(Sync(150.0 + number % 7, 20.0)))
        while not ticket.settled:
            now += LOOP_S
            mount.receive(session.compose())
            session.receive(mount.turn(), now)
        mount.launches.clear()

    assert grown_bytes(asked, count) < most_bytes

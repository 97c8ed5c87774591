"""Random and mutated datagrams to the simulated mount: counted, without motion, without a trace in memory.

What has the wrong length or header is no command and must change nothing at all: the mount is compared with a
twin that never got it. What keeps length and header but is mutated elsewhere is a command, and may be obeyed:
then the claims are that no byte outside the flags and the fine rates moves a mount, and that whatever is
obeyed stays within the axes' limits.
"""

from __future__ import annotations

import math
import random

import msgspec
import pytest
from paper_link import T0
from paper_mount import LOOP_S
from paper_noise import COMMAND, FINE_RATES, GROWTH_BYTES, HOW_MANY, grown_bytes, mutated, wrong
from paper_packing import FLAG_BYTES

from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.xerxes.session import Session


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
            assert msgspec.structs.astuple(truth) == msgspec.structs.astuple(quiet_truth)

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
            assert msgspec.structs.astuple(truth) == msgspec.structs.astuple(quiet_truth)

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
            assert all(math.isfinite(value) for value in msgspec.structs.astuple(truth))
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

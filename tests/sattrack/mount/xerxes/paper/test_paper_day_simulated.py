"""A day of requests to the project's own simulated mount, over the wires of test_paper_day.py."""

from __future__ import annotations

import random
from typing import Any, Literal

import pytest
from paper_day import DAYS, LOSSY, Day, accounts
from paper_link import Wires

from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.xerxes.session import Session

How = Literal["held", "edge"]


def simulated_day(seed: int, how: Any, **wires: float) -> Day:
    """A day with the project's own simulated mount."""
    profile = MountProfile(move_axis=how, ra=AxisLimits(6.0, 10.0, 10.0), dec=AxisLimits(6.0, 10.0, 10.0))
    mount = SimulatedMount(profile, SimulatedSite(48.0, 11.0, 500.0), StartPosition(-30.0, 20.0))
    return Day(
        Session(profile),
        mount.receive,
        lambda now: mount.tick(now)[0],
        Wires(random.Random(seed + 1), **wires),  # type: ignore[arg-type]
        Wires(random.Random(seed + 2), **wires),  # type: ignore[arg-type]
        random.Random(seed),
    )


@DAYS
class TestAgainstTheSimulatedMount:
    def test_every_request_settles_once(self, hours: float, how: How) -> None:
        day = simulated_day(201, how, **LOSSY)
        day.run(hours)
        day.finish()
        accounts(day, hours)
        assert day.session.intruder is None

    @pytest.mark.soak
    def test_nothing_is_doubled_where_datagrams_are_only_lost(self, hours: float, how: How) -> None:
        day = simulated_day(202, how, loss=0.05)
        day.run(hours)
        day.finish()
        accounts(day, hours)
        assert day.session.health.doubled_launches == 0
        assert day.session.health.foreign_acks == 0

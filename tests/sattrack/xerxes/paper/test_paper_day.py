"""A day of requests over wires with 5 % loss, 1 % duplication and 1 % reordering; and without.

Source: Van Deventer, "Xerxes Mount Control Protocol", Overview ("inherently tolerant of lost or occasionally
misordered packets") and Details (only the rising edge counts, so what comes late with a flag up is another).
"""

from __future__ import annotations

import random
from collections import Counter
from typing import TYPE_CHECKING, Any, Literal

import pytest
from paper_day import ONE_SHOT_FLAGS, Day, doubled_launches, paper_day
from paper_link import Wires

from sattrack.mount import AxisLimits, MountProfile
from sattrack.requests import Abort, TicketState
from sattrack.xerxes.session import Session
from sattrack.xerxes.simulator.mount import SimulatedMount, SimulatedSite, StartPosition

if TYPE_CHECKING:
    from paper_mount import PaperMount

How = Literal["held", "edge"]
HELD_AND_EDGE = pytest.mark.parametrize("how", ["held", "edge"])
HOURS = pytest.mark.parametrize(
    "hours", [pytest.param(1.0 / 6.0, id="10 min"), pytest.param(24.0, id="24 h", marks=pytest.mark.soak)]
)
LOSSY = {"loss": 0.05, "duplication": 0.01, "reorder": 0.01}


def accounts(day: Day, hours: float) -> None:
    """What holds of every day, whatever the wires did."""
    assert day.late == []
    assert day.twice == []
    assert day.rules.broken == []
    assert len(day.settled) > 200 * hours
    states = day.states()
    assert states[TicketState.COMPLETE] > len(day.settled) / 4
    assert day.session.health.restarts == 0
    assert day.session.health.rejected == 0


def launches_against_tickets(day: Day, mount: PaperMount, doubled: int) -> None:
    """No launch without a flag, no flag without a ticket, no completion without a launch."""
    assert mount.crowded == 0
    rises = Counter(name for _, name in day.rules.rises)
    launched = Counter(launch.command for launch in mount.launches)
    for kind, flag in ONE_SHOT_FLAGS.items():
        tickets = [ticket for ticket in day.settled if isinstance(ticket.request, kind)]
        raised = sum(TicketState.RAISED in ticket.history for ticket in tickets)
        complete = sum(ticket.state is TicketState.COMPLETE for ticket in tickets)
        if kind is not Abort:
            # A stop may be asked for again on its own account; nothing else may.
            assert rises[flag] <= raised
        assert launched[flag] <= rises[flag] + doubled
        assert complete <= launched[flag]


MOUNT_PERIOD_S = 0.0503
"""The two loops slide through each other's phases every eight seconds."""


@HOURS
@HELD_AND_EDGE
class TestAgainstTheStandIn:
    def test_every_request_settles_once_and_what_is_doubled_repeats_what_was_just_obeyed(
        self, hours: float, how: How
    ) -> None:
        day, mount = paper_day(101, how, MOUNT_PERIOD_S, **LOSSY)
        day.run(hours)
        day.finish()
        accounts(day, hours)
        doubled = doubled_launches(day, mount)
        launches_against_tickets(day, mount, len(doubled))
        assert all(double.repeats for double in doubled)
        # Of FindHome nothing is acknowledged, so its doubles cannot be seen.
        assert day.session.health.doubled_launches <= sum(double.axes for double in doubled)
        assert day.session.health.foreign_acks == 0
        assert day.session.intruder is None

    def test_none_are_doubled_where_datagrams_are_only_lost(self, hours: float, how: How) -> None:
        day, mount = paper_day(102, how, MOUNT_PERIOD_S, loss=0.05)
        day.run(hours)
        day.finish()
        accounts(day, hours)
        assert doubled_launches(day, mount) == []
        launches_against_tickets(day, mount, 0)
        assert mount.ignored == []
        assert day.session.health.doubled_launches == 0
        assert day.session.health.foreign_acks == 0


@pytest.mark.parametrize(("how", "mount_period_s"), [("held", 0.05), ("edge", 0.0503)])
def test_every_doubled_slew_sync_and_pulse_is_counted_where_its_status_comes(
    how: How, mount_period_s: float
) -> None:
    day, mount = paper_day(104, how, mount_period_s, loss=0.05, duplication=0.3, reorder=0.3)
    day.back = Wires(random.Random(1))
    counted: list[int] = []

    def note(day: Day) -> None:
        counted.extend([mount.loop] * (day.session.health.doubled_launches - len(counted)))

    day.run(0.15, note)
    day.finish()
    seen = ("SlewToTargetCmd", "SyncToTargetCmd", "PulseGuideCmd")
    doubled = [d.launch for d in doubled_launches(day, mount) if d.launch.command in seen]
    assert len(doubled) >= 2
    for launch in doubled:
        assert any(0 <= loop - launch.loop <= 6 for loop in counted), launch
    assert day.late == day.twice == day.rules.broken == []


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


@HOURS
@HELD_AND_EDGE
class TestAgainstTheSimulatedMount:
    def test_every_request_settles_once(self, hours: float, how: How) -> None:
        day = simulated_day(201, how, **LOSSY)
        day.run(hours)
        day.finish()
        accounts(day, hours)
        assert day.session.intruder is None

    def test_nothing_is_doubled_where_datagrams_are_only_lost(self, hours: float, how: How) -> None:
        day = simulated_day(202, how, loss=0.05)
        day.run(hours)
        day.finish()
        accounts(day, hours)
        assert day.session.health.doubled_launches == 0
        assert day.session.health.foreign_acks == 0

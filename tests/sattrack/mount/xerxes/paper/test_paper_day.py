"""A day of requests over wires with 5 % loss, 1 % duplication and 1 % reordering; and without.

Source: Van Deventer, "Xerxes Mount Control Protocol", Overview ("inherently tolerant of lost or occasionally
misordered packets") and Details (only the rising edge counts, so what comes late with a flag up is another).
"""

from __future__ import annotations

import random
from collections import Counter
from typing import TYPE_CHECKING, Literal

import pytest
from paper_day import DAYS, LOSSY, ONE_SHOT_FLAGS, Day, accounts, doubled_launches, paper_day
from paper_link import Wires

from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, TicketState

if TYPE_CHECKING:
    from paper_mount import PaperMount

How = Literal["held", "edge"]


def launches_against_tickets(day: Day, mount: PaperMount, doubled: int) -> None:
    """No launch without a flag, no flag without a ticket, no completion without a launch."""
    assert mount.crowded == 0
    rises = Counter(name for _, name in day.rules.rises)
    launched = Counter(launch.command for launch in mount.launches)
    for kind, flag in ONE_SHOT_FLAGS.items():
        tickets = [ticket for ticket in day.settled if isinstance(ticket.request, kind)]
        raised = sum(TicketState.RAISED in ticket.history for ticket in tickets)
        complete = sum(ticket.state is TicketState.COMPLETE for ticket in tickets)
        if kind is Slew:
            # One whose target was written under the flag of another rises once more by itself, as does one
            # that the mount ignored because a doubled one before it had set it slewing.
            assert rises[flag] <= raised + day.rules.changed + len(mount.ignored)
        elif kind is not Abort:
            # A stop may be asked for again on its own account; nothing else may.
            assert rises[flag] <= raised
        assert launched[flag] <= rises[flag] + doubled
        assert complete <= launched[flag]


MOUNT_PERIOD_S = 0.0503
"""The two loops slide through each other's phases every eight seconds."""


@DAYS
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

    @pytest.mark.soak
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


@pytest.mark.parametrize(("how", "mount_period_s"), [("held", 0.0625), ("edge", 0.0468)])
def test_a_mount_whose_timer_is_a_windows_timer_misses_no_edge(how: How, mount_period_s: float) -> None:
    """ "Approximately, as the Windows forms timer is imprecise": three or four ticks of 15.6 ms."""
    day, mount = paper_day(103, how, mount_period_s, loss=0.05)
    day.run(0.05)
    day.finish()
    accounts(day, 0.05)
    assert doubled_launches(day, mount) == []
    launches_against_tickets(day, mount, 0)
    assert mount.ignored == []
    assert day.session.health.doubled_launches == 0
    assert day.session.health.foreign_acks == 0


@pytest.mark.parametrize(("how", "mount_period_s"), [("held", 0.05), ("edge", 0.0503)])
def test_every_doubled_slew_sync_and_pulse_is_counted_where_its_status_comes(
    how: How, mount_period_s: float
) -> None:
    day, mount = paper_day(112, how, mount_period_s, loss=0.05, duplication=0.3, reorder=0.3)
    day.back = Wires(random.Random(1))
    counted: list[int] = []

    def note(day: Day) -> None:
        counted.extend([mount.loop] * (day.session.health.doubled_launches - len(counted)))

    day.run(0.03, note)
    day.finish()
    seen = ("SlewToTargetCmd", "SyncToTargetCmd", "PulseGuideCmd")
    doubled = [d.launch for d in doubled_launches(day, mount) if d.launch.command in seen]
    assert doubled
    for launch in doubled:
        assert any(0 <= loop - launch.loop <= 6 for loop in counted), launch
    assert day.late == day.twice == day.rules.broken == []

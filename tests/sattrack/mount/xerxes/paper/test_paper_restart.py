"""The mount is switched off and on in the middle of anything; every ticket still settles once.

Source: Van Deventer, "Xerxes Mount Control Protocol": the counter is a "rolling tic counter from master event
timer in mount", which begins again, and a flag that is up is a rising edge to a mount that has just begun.
"""

from __future__ import annotations

import random
from typing import Any, Literal

import pytest
from paper_day import Day, paper_day
from paper_link import T0, Bench, Wires
from paper_mount import LOOP_S, PaperMount

from sattrack.mount.model import AxesPosition, MountProfile, Slew
from sattrack.mount.requests import (
    SETTLED,
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    TicketState,
    TrackingRate,
)

How = Literal["held", "edge"]
HELD_AND_EDGE = pytest.mark.parametrize("how", ["held", "edge"])
EVERY: list[Request] = [
    Slew(165.0, 30.0),
    Sync(150.5, 20.25),
    PulseGuide(900, -300),
    Abort(),
    FindHome(),
    Park(),
    MoveAxis(1.0, -0.5),
    EndMove(),
    FineRate(1e-3, 0.0),
    TrackingRate(1),
]


class EverySecond(Wires):
    """Loses every second status."""

    count = 0

    def put(self, period: int, data: bytes) -> None:
        self.count += 1
        if self.count % 2:
            super().put(period, data)


def bench_of(how: How, halved: bool) -> Bench:
    back = EverySecond(random.Random(0)) if halved else None
    profile = MountProfile(move_axis=how, park=AxesPosition(-30.0, 20.0))
    return Bench(PaperMount(move_axis=how, ack_after=1), profile, back=back)


def switch_off(bench: Bench, for_periods: int) -> None:
    """Power off: nothing is heard and nothing said; then on, with everything forgotten."""
    for _ in range(for_periods):
        bench.now += LOOP_S
        bench.period += 1
        bench.rules.send(bench.session.compose())
    bench.mount.restart()
    bench.rules.restarted()


def ways(request: Request) -> list[Any]:
    """How MoveAxis is read and which statuses come: all four of requests for it, else two by default."""
    reads = isinstance(request, (MoveAxis, EndMove))
    return [
        pytest.param(
            request,
            halved,
            how,
            id=f"{type(request).__name__}-{'every second' if halved else 'every'} status-{how}",
            marks=() if reads or halved is (how == "edge") else pytest.mark.soak,
        )
        for halved in (False, True)
        for how in ("held", "edge")
    ]


@pytest.mark.parametrize(("request_", "halved", "how"), [way for request in EVERY for way in ways(request)])
def test_at_any_instant_the_ticket_settles_once(request_: Request, halved: bool, how: How) -> None:
    rng = random.Random(f"{request_} {halved} {how}")
    for instant in [*range(4), rng.randrange(4, 60)]:
        bench = bench_of(how, halved)
        bench.run(2.0)
        ticket = bench.submit(request_)
        for _ in range(instant):
            bench.turn()
        switch_off(bench, rng.choice([0, 1, 20]))
        state = bench.settle(ticket, 300.0)
        bench.run(3.0)
        assert ticket.state is state
        assert sum(step in SETTLED for step in ticket.history) == 1
        assert bench.session.health.restarts == 1 or halved
        assert bench.rules.broken == []
        if isinstance(request_, Slew) and state is TicketState.COMPLETE:
            assert (bench.mount.ra_deg, bench.mount.dec_deg) == pytest.approx((165.0, 30.0), abs=1e-6)
        if isinstance(request_, Sync) and state is TicketState.COMPLETE:
            assert bench.launched("SyncToTargetCmd")
        if isinstance(request_, Abort):
            assert not bench.mount.moving


@HELD_AND_EDGE
@pytest.mark.parametrize("halved", [False, True], ids=["every status", "every second status"])
def test_what_is_asked_for_afterwards_is_done(halved: bool, how: How) -> None:
    for instant in range(6):
        bench = bench_of(how, halved)
        bench.run(2.0)
        first = bench.submit(MoveAxis(0.5, 0.5))
        for _ in range(instant):
            bench.turn()
        switch_off(bench, 20)
        bench.settle(first, 300.0)
        bench.run(2.0)
        assert bench.settle(bench.submit(Abort())) is TicketState.COMPLETE
        assert not bench.mount.moving
        assert bench.settle(bench.submit(Slew(165.0, 30.0))) is TicketState.COMPLETE
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == (165.0, 30.0)


@pytest.mark.parametrize(
    ("halved", "how"),
    [
        pytest.param(False, "held", id="every status-held"),
        pytest.param(True, "edge", id="every second status-edge"),
        pytest.param(False, "edge", id="every status-edge", marks=pytest.mark.soak),
        pytest.param(True, "held", id="every second status-held", marks=pytest.mark.soak),
    ],
)
def test_restarts_at_random_among_requests_at_random(halved: bool, how: How) -> None:
    day, mount = paper_day(301, how, loss=0.05)
    if halved:
        day.back = EverySecond(random.Random(303))
    rng = random.Random(302)
    due = [T0 + 20.0]
    restarts = 0

    def spell(day: Day) -> None:
        nonlocal restarts
        if day.now >= due[0]:
            due[0] = day.now + rng.uniform(10.0, 30.0)
            mount.restart()
            day.rules.restarted()
            restarts += 1

    day.run(0.06, spell)
    day.finish()
    assert restarts > 8
    assert day.late == day.twice == []
    assert day.session.health.restarts == restarts or halved
    assert day.session.health.rejected == 0
    assert len(day.settled) > 10
    assert mount.crowded == 0


@pytest.mark.parametrize("up_periods", [40, 101, 500, 1201])
def test_a_restart_is_told_within_a_second(up_periods: int) -> None:
    bench = bench_of("held", halved=False)
    bench.run(up_periods * LOOP_S)
    switch_off(bench, 0)
    bench.run(1.0)
    assert bench.session.health.restarts == 1


@pytest.mark.parametrize("up_periods", [40, 500, 41, 101, 501, 1201])
def test_a_restart_is_told_within_a_second_though_every_second_status_is_lost(up_periods: int) -> None:
    bench = bench_of("held", halved=True)
    bench.run(up_periods * LOOP_S)
    switch_off(bench, 0)
    received = bench.session.health.received
    bench.run(1.0)
    assert bench.session.health.restarts == 1
    assert bench.session.health.received > received


@pytest.mark.parametrize("halved", [False, True], ids=["every status", "every second status"])
def test_no_restart_is_told_where_there_is_none(halved: bool) -> None:
    bench = bench_of("held", halved)
    bench.run(30.0)
    assert bench.session.health.restarts == 0
    switch_off(bench, 0)
    bench.run(1.0)
    assert bench.session.health.restarts == 1
    bench.run(30.0)
    assert bench.session.health.restarts == 1

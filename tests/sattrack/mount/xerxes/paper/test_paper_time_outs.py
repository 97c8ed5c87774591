"""Requests to mounts that do not answer, answer half, or never come to an end: each settles, with a reason.

Source: Van Deventer, "Xerxes Mount Control Protocol", Details: "it's the mount driver's responsibility to
wait on the mount reply datagram contents to see that the action was completed".
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import pytest
from paper_link import Bench
from paper_mount import ACKS, LOOP_S, PaperMount

from sattrack.mount.model import AxesPosition, MountProfile, Slew
from sattrack.mount.requests import (
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    TicketState,
    TrackingRate,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

How = Literal["held", "edge"]
HELD_AND_EDGE = pytest.mark.parametrize("how", ["held", "edge"])
SLEW = Slew(200.0, 30.0)
SYNC = Sync(150.5, 20.25)
PULSE = PulseGuide(700, -300)
MOVE = MoveAxis(1.0, -0.5)
WITH_ACK: list[Request] = [SLEW, SYNC, PULSE, Abort(), MOVE]
WITHOUT_ACK: list[Request] = [Park(), FindHome(), TrackingRate(1), FineRate(1e-3, 0.0)]
NOT_DONE = {TicketState.TIMED_OUT, TicketState.FAILED}
LONG_S = 900.0
"""No slew, pulse or stop of these tests could take so long."""


def request_id(value: Any) -> str | None:
    return type(value).__name__


def awake(mount: PaperMount) -> Bench:
    bench = Bench(mount, MountProfile(move_axis=mount.move_axis, park=AxesPosition(-30.0, 20.0)))
    bench.run(1.0)
    return bench


def patient(bench: Bench, ticket: Ticket) -> TicketState:
    return bench.settle(ticket, LONG_S)


class TestDeaf:
    """The mount's statuses come, our datagrams do not arrive: a firewall, a wrong port."""

    @HELD_AND_EDGE
    @pytest.mark.parametrize("request_", WITH_ACK, ids=request_id)
    def test_no_acknowledgement_is_a_time_out_with_a_reason(self, request_: Request, how: How) -> None:
        bench = awake(PaperMount(move_axis=how, deaf=True))
        ticket = bench.submit(request_)
        assert patient(bench, ticket) is TicketState.TIMED_OUT
        assert ticket.reason
        assert not ticket.was_acknowledged
        assert bench.mount.launches == []
        assert bench.rules.broken == []

    @pytest.mark.parametrize("request_", WITHOUT_ACK, ids=request_id)
    def test_commands_without_an_acknowledgement_are_never_called_complete(self, request_: Request) -> None:
        bench = awake(PaperMount(deaf=True))
        ticket = bench.submit(request_)
        assert patient(bench, ticket) in {TicketState.UNCONFIRMED, *NOT_DONE}
        assert ticket.reason

    @HELD_AND_EDGE
    @pytest.mark.parametrize("request_", [SLEW, SYNC, PULSE, MOVE], ids=request_id)
    def test_a_command_given_up_does_not_launch_when_the_mount_hears_again(
        self, request_: Request, how: How
    ) -> None:
        bench = awake(PaperMount(move_axis=how, deaf=True))
        patient(bench, bench.submit(request_))
        bench.run(1.0)
        bench.mount.deaf = False
        for _ in range(200):
            bench.turn()
            # An edge of rate 0 makes sure of the end and moves nothing.
            assert not bench.mount.moving
        assert {launch.command for launch in bench.mount.launches} <= {"MoveAxis"}
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == pytest.approx((150.0, 20.0), abs=1e-9)

    @pytest.mark.parametrize("deaf_s", [2.0, 120.0])
    def test_an_abort_that_is_not_heard_is_sent_until_it_is(self, deaf_s: float) -> None:
        bench = awake(PaperMount())
        bench.submit(Slew(300.0, 60.0))
        bench.run(0.5)
        bench.mount.stuck = True
        bench.mount.deaf = True
        bench.submit(Abort())
        bench.run(deaf_s)
        bench.mount.deaf = False
        bench.turn()
        assert [launch.command for launch in bench.mount.launches][-1] == "AbortSlewCmd"
        bench.run(2.0)
        assert not bench.mount.moving


class TestMute:
    """No status comes at all."""

    @pytest.mark.parametrize("request_", [*WITH_ACK, *WITHOUT_ACK, EndMove()], ids=request_id)
    def test_whatever_is_asked_for_settles_and_is_not_complete(self, request_: Request) -> None:
        bench = Bench(PaperMount(), MountProfile(park=AxesPosition(-30.0, 20.0)))
        ticket = bench.session.submit(_cleared(request_))
        for _ in _periods(LONG_S):
            if ticket.settled:
                break
            bench.now += LOOP_S
            bench.rules.send(bench.session.compose())
        assert ticket.settled
        assert ticket.state in {TicketState.UNCONFIRMED, *NOT_DONE}
        assert ticket.reason
        assert bench.rules.broken == []

    @pytest.mark.parametrize("request_", [*WITH_ACK, *WITHOUT_ACK[:3]], ids=request_id)
    def test_falling_silent_under_way_settles_too(self, request_: Request) -> None:
        bench = awake(PaperMount(stuck=True, ack_after=3))
        ticket = bench.submit(request_)
        bench.run(0.1)
        for _ in _periods(LONG_S):
            if ticket.settled:
                break
            bench.rules.send(bench.session.compose())
        assert ticket.settled
        assert ticket.state in {TicketState.UNCONFIRMED, *NOT_DONE}


def _cleared(request: Request) -> Any:
    from sattrack.mount.requests import ClearedRequest

    return ClearedRequest(request)


def _periods(seconds: float) -> Iterator[int]:
    return iter(range(round(seconds / LOOP_S)))


class TestStages:
    @HELD_AND_EDGE
    @pytest.mark.parametrize("request_", WITH_ACK, ids=request_id)
    def test_launched_but_never_acknowledged(self, request_: Request, how: How) -> None:
        bench = awake(PaperMount(move_axis=how, silent=frozenset(ACKS)))
        ticket = bench.submit(request_)
        state = patient(bench, ticket)
        assert not ticket.was_acknowledged
        assert state in {TicketState.TIMED_OUT, TicketState.UNCONFIRMED}
        assert ticket.reason
        assert bench.rules.broken == []

    def test_a_slew_whose_slewing_never_falls_is_over_when_positions_rest_at_its_target(self) -> None:
        bench = awake(PaperMount(stuck=True))
        ticket = bench.submit(SLEW)
        assert bench.settle(ticket, 2 * LONG_S) is TicketState.COMPLETE
        assert ticket.was_acknowledged
        assert "Slewing stays true while positions stand" in "".join(bench.session.ignored_fields)
        assert bench.rules.broken == []

    def test_a_slew_that_waits_for_a_standstill_that_never_comes(self) -> None:
        bench = awake(PaperMount(stuck=True, target_deg=(10.0, 10.0)))
        ticket = bench.submit(SLEW)
        assert bench.settle(ticket, 2 * LONG_S) in NOT_DONE
        assert bench.mount.target_deg == (10.0, 10.0)
        assert ticket.reason

    def test_a_pulse_that_never_ends(self) -> None:
        bench = awake(PaperMount(stuck=True))
        ticket = bench.submit(PULSE)
        assert patient(bench, ticket) is TicketState.TIMED_OUT
        assert ticket.was_acknowledged
        assert ticket.reason

    def test_a_long_pulse_is_not_given_up_early(self) -> None:
        bench = awake(PaperMount())
        ticket = bench.submit(PulseGuide(120_000, 0))
        assert bench.settle(ticket, 180.0) is TicketState.COMPLETE
        assert not bench.mount.pulse_s

    def test_a_long_slew_is_not_given_up_early(self) -> None:
        bench = awake(PaperMount())
        bench.mount.ra_deg, bench.mount.dec_deg = 20.0, -90.0
        ticket = bench.submit(SLEW)
        assert bench.settle(ticket, 60.0) is TicketState.COMPLETE

    @pytest.mark.parametrize("request_", [SLEW, SYNC, PULSE], ids=request_id)
    def test_an_acknowledgement_that_never_falls_lets_the_next_of_its_kind_settle(
        self, request_: Request
    ) -> None:
        bench = awake(PaperMount(sticky=frozenset(ACKS)))
        patient(bench, bench.submit(request_))
        again = bench.submit(request_)
        patient(bench, again)
        assert bench.rules.broken == []

    @HELD_AND_EDGE
    def test_moveaxis_of_which_one_axis_never_acknowledges(self, how: How) -> None:
        bench = awake(PaperMount(move_axis=how, silent=frozenset({"MoveAxisDec"})))
        ticket = bench.submit(MOVE)
        assert patient(bench, ticket) in {TicketState.TIMED_OUT, TicketState.FAILED, TicketState.UNCONFIRMED}
        assert ticket.reason

    @HELD_AND_EDGE
    def test_a_time_out_does_not_block_what_comes_next(self, how: How) -> None:
        bench = awake(PaperMount(move_axis=how, deaf=True))
        patient(bench, bench.submit(SYNC))
        bench.mount.deaf = False
        bench.run(1.0)
        assert bench.settle(bench.submit(SYNC)) is TicketState.COMPLETE
        assert bench.settle(bench.submit(PULSE)) is TicketState.COMPLETE
        assert bench.settle(bench.submit(SLEW)) is TicketState.COMPLETE
        assert bench.rules.broken == []

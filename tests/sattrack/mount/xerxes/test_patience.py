"""How long each part of the session waits, to the datagram or the status: the table of the protocol's page.

Flags and tickets are judged by themselves; what goes out is read by eye. At 20 Hz 20 datagrams are a second.
"""

from __future__ import annotations

import importlib
import itertools
import math
from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace
from xerxes_builders import (
    MOVE,
    PERIOD_S,
    SIDEREAL_DTICS_S,
    T0,
    TRACKING,
    A,
    Client,
    dtics,
    want,
)

from sattrack.mount.model import AxesPosition, AxisLimits, Hold, Motion, MountProfile, MoveAxes, Slew, Stop
from sattrack.mount.requests import (
    Abort,
    ClearedRequest,
    EndMove,
    FindHome,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    TicketState,
    TrackingRate,
)
from sattrack.mount.xerxes.flags import (
    NO_RATES,
    AbortFlag,
    Again,
    AxisRates,
    EdgeMove,
    Handshake,
    HeldMove,
    HeldState,
    MoveWatch,
    OneShot,
    Sent,
    SlewFlag,
    SlewState,
    StopState,
)
from sattrack.mount.xerxes.session import Session

if TYPE_CHECKING:
    from collections.abc import Callable

SYNC = Sync(150.5, 20.25)
PULSE = PulseGuide(700, -300)
PARK = AxesPosition(-15.0, 20.0)
"""Where the client's mount stands: sidereal time 9 h, right ascension 10 h."""
HERE, SYNC_HERE = Slew(150.0, 20.0), Sync(150.0, 20.0)


def submit(client: Client, request: Request) -> Ticket:
    return client.session.submit(ClearedRequest(request))


def periods(client: Client, ticket: Ticket, hears: bool = True, **heard: Any) -> int:
    """How many datagrams go out until a ticket's state changes."""
    state, count = ticket.state, 0
    while ticket.state is state:
        assert count < 30_000
        if hears:
            client.hear(**heard)
        client.send()
        count += 1
    return count


def tracking(profile: MountProfile | None = None) -> Client:
    """A client that has heard the mount track the sky until its rest is seen."""
    client = Client(profile)
    for _ in range(15):
        client.hear()
        client.send()
    return client


class TestTickets:
    """A ticket that enters a state stays in it for so many datagrams; the next one gives it up."""

    @pytest.mark.parametrize(
        ("request_", "datagrams", "state", "reason"),
        [
            (SYNC, 60, TicketState.TIMED_OUT, "the mount did not acknowledge it"),
            (PULSE, 60, TicketState.TIMED_OUT, "the mount did not acknowledge it"),
            (FindHome(), 20, TicketState.UNCONFIRMED, "the protocol has no acknowledgement for it"),
            (TrackingRate(2), 20, TicketState.UNCONFIRMED, "the protocol has no acknowledgement for it"),
            (A, 160, TicketState.TIMED_OUT, "the mount did not acknowledge it"),
            (MoveAxis(1.0, None), 160, TicketState.TIMED_OUT, "the mount did not acknowledge it"),
            (Abort(), 160, TicketState.TIMED_OUT, "the mount did not acknowledge it"),
        ],
    )
    def test_without_an_answer(
        self, request_: Request, datagrams: int, state: TicketState, reason: str
    ) -> None:
        client = tracking()
        assert client.session.busy is False
        ticket = submit(client, request_)
        assert client.session.busy is True
        assert periods(client, ticket) == 1
        assert ticket.state is TicketState.RAISED
        assert client.session.busy is True
        assert periods(client, ticket) == datagrams + 1
        assert (ticket.state, ticket.reason) == (state, reason)
        assert client.session.busy is False
        assert isinstance(client.session.wanted, Stop if isinstance(request_, Abort) else Hold)

    @pytest.mark.parametrize("request_", [SYNC, FindHome(), A])
    def test_of_a_mount_that_is_not_heard(self, request_: Request) -> None:
        client = Client()
        ticket = submit(client, request_)
        assert periods(client, ticket, hears=False) == 601
        assert (ticket.state, ticket.reason) == (
            TicketState.TIMED_OUT,
            "never sent: the mount did not come to rest, or was not heard",
        )
        assert client.session.busy is False

    @pytest.mark.parametrize(
        ("request_", "ack", "datagrams", "reason"),
        [
            (A, "ack_slew", 4800, "the mount acknowledged the slew and did not finish it"),
            (Abort(), "ack_abort", 600, "the mount acknowledged it and was not seen to obey"),
        ],
    )
    def test_of_a_mount_that_moves_on(self, request_: Request, ack: str, datagrams: int, reason: str) -> None:
        client = tracking()
        ticket = submit(client, request_)
        client.send()
        client.hear(slewing=True, **{ack: True})
        assert ticket.state is TicketState.ACKNOWLEDGED
        going = {"slewing": True, "ra_rate_dtics_s": dtics(1.0)}
        # Statuses make no difference to it, and cost time.
        client.hear(**going)
        assert periods(client, ticket, hears=False) == datagrams + 1
        assert (ticket.state, ticket.reason) == (TicketState.TIMED_OUT, reason)

    @pytest.mark.parametrize(
        ("request_", "hears", "seconds"),
        [(A, False, 30), (SYNC, False, 30), (Abort(), True, 30), (EndMove(), True, 30), (A, True, 240)],
    )
    @pytest.mark.parametrize("period_s", [0.02, 0.1])
    def test_with_another_period(self, request_: Request, hears: bool, seconds: int, period_s: float) -> None:
        """What a mount needs to stand or to move takes its time, however often it is spoken to."""
        profile = MountProfile(period_s=period_s)
        client = tracking(profile) if hears else Client(profile)
        ticket = submit(client, request_)
        if hears:
            client.send()
            client.hear(slewing=True, ack_slew=True, ack_abort=True)
        assert periods(client, ticket, hears=False) == round(seconds / period_s) + 1
        assert ticket.state is TicketState.TIMED_OUT

    @pytest.mark.parametrize(("slew_rate_deg_s", "seconds"), [(2.25, 240), (0.5, 1080)])
    def test_of_a_slow_mount_that_moves_on(self, slew_rate_deg_s: float, seconds: int) -> None:
        """A turn takes 12 minutes at half a degree a second; it may take half as long again."""
        client = tracking(MountProfile(dec=AxisLimits(slew_rate_deg_s=slew_rate_deg_s)))
        ticket = submit(client, A)
        client.send()
        client.hear(slewing=True, ack_slew=True)
        assert periods(client, ticket, hears=False) == round(seconds / PERIOD_S) + 1
        assert ticket.state is TicketState.TIMED_OUT

    def test_of_a_moveaxis_that_does_not_end(self) -> None:
        client = tracking()
        want(client.session, MOVE)
        client.send()
        client.hear(ack_move_ra=True, ack_move_dec=True, slewing=True, ra_rate_dtics_s=dtics(1.0))
        ticket = submit(client, EndMove())
        assert periods(client, ticket, slewing=True, ra_rate_dtics_s=dtics(1.0)) == 1
        assert ticket.state is TicketState.RAISED
        assert periods(client, ticket, slewing=True, ra_rate_dtics_s=dtics(1.0)) == 601
        assert (ticket.state, ticket.reason) == (
            TicketState.TIMED_OUT,
            "the mount did not come back to tracking",
        )

    @pytest.mark.parametrize(("ra_ms", "dec_ms", "longest_s"), [(700, -300, 0.7), (-1500, 4000, 4.0)])
    def test_of_a_pulse_that_does_not_end(self, ra_ms: int, dec_ms: int, longest_s: float) -> None:
        """Twice as long as it takes, and twice the three seconds of an acknowledgement."""
        client = tracking()
        ticket = submit(client, PulseGuide(ra_ms, dec_ms))
        client.send()
        client.hear(ack_pulse_guide=True, pulse_guiding=True)
        assert ticket.state is TicketState.ACKNOWLEDGED
        assert periods(client, ticket, pulse_guiding=True) == 120 + round(2.0 * longest_s / PERIOD_S) + 1
        assert ticket.state is TicketState.TIMED_OUT

    @pytest.mark.parametrize(("ra_ms", "dec_ms", "longest_s"), [(700, -300, 0.7), (-1500, 4000, 4.0)])
    def test_of_a_pulse_that_is_not_seen(self, ra_ms: int, dec_ms: int, longest_s: float) -> None:
        client = tracking()
        ticket = submit(client, PulseGuide(ra_ms, dec_ms))
        client.send()
        client.hear(ack_pulse_guide=True)
        # A second more than it takes, the status of the acknowledgement counted.
        assert periods(client, ticket) == 20 + round(longest_s / PERIOD_S)
        assert ticket.state is TicketState.UNCONFIRMED
        assert ticket.reason == "acknowledged, but the mount was not seen to guide"

    @pytest.mark.parametrize(("ra_deg", "dec_deg", "off_deg"), [(150.0, 20.03, 0.03), (150.1, 20.0, 0.094)])
    @pytest.mark.parametrize("unanswered", [0, 30])
    def test_of_a_sync_that_does_not_show(
        self, ra_deg: float, dec_deg: float, off_deg: float, unanswered: int
    ) -> None:
        client = tracking()
        ticket = submit(client, Sync(ra_deg, dec_deg))
        client.send()
        for _ in range(unanswered):
            client.hear()
            client.send()
        client.hear(ack_sync=True)
        assert periods(client, ticket) == 20
        assert ticket.state is TicketState.FAILED
        assert ticket.reason == f"acknowledged, but the mount reports a direction {off_deg:.2f}° away"

    @pytest.mark.parametrize(
        ("asked", "reported", "state"),
        [
            (Sync(0.01, 20.0), (359.995, 20.0), TicketState.COMPLETE),
            (Sync(359.99, 20.0), (0.005, 20.0), TicketState.COMPLETE),
            (Sync(150.0, 60.0), (150.035, 60.0), TicketState.COMPLETE),
            (Sync(150.0, 60.0), (150.045, 60.0), TicketState.ACKNOWLEDGED),
            (Sync(150.0, 60.0), (150.0, 59.985), TicketState.COMPLETE),
            (Sync(150.0, 60.0), (150.0, 59.975), TicketState.ACKNOWLEDGED),
        ],
    )
    def test_a_sync_shows_within_a_fiftieth_of_a_degree_once_its_handshake_is_over(
        self, asked: Sync, reported: tuple[float, float], state: TicketState
    ) -> None:
        client = tracking()
        ticket = submit(client, asked)
        client.send()
        there = {"ra_h": reported[0] / 15.0, "dec_deg": reported[1]}
        for heard, told in (
            ({}, TicketState.RAISED),
            ({"ack_sync": True}, TicketState.ACKNOWLEDGED),
            ({"ack_sync": True}, TicketState.ACKNOWLEDGED),
            ({}, state),
        ):
            client.hear(**there, **heard)
            client.send()
            assert ticket.state is told

    def test_the_first_of_a_queue_waits_no_longer_for_the_second(self) -> None:
        client = Client()
        first = submit(client, SYNC)
        for _ in range(10):
            client.send()
        second = submit(client, PULSE)
        assert periods(client, first, hears=False) == 591
        assert not second.settled
        assert periods(client, second, hears=False) == 10


@pytest.mark.parametrize(
    ("first", "ack", "second", "flag"),
    [
        (SYNC_HERE, {"ack_sync": True}, PULSE, "pulse_guide"),
        (PULSE, {"ack_pulse_guide": True, "pulse_guiding": True}, SYNC, "sync"),
        (SYNC_HERE, {"ack_sync": True}, HERE, "slew"),
        (Abort(), {"ack_abort": True}, HERE, "slew"),
        (HERE, {"ack_slew": True}, SYNC, "sync"),
    ],
)
def test_between_two_one_shots_four_datagrams_have_no_flag(
    first: Request, ack: dict[str, Any], second: Request, flag: str
) -> None:
    client = tracking()
    submit(client, first)
    client.send()
    client.hear(**ack)
    want(client.session, Hold())
    submit(client, second)
    sent = []
    while not sent or not getattr(sent[-1], flag):
        sent.append(client.send())
        client.hear()
    ups = [[n for n in FLAGS if getattr(one, n)] for one in sent]
    assert ups == [[]] * 4 + [[flag]]


FLAGS = ("abort", "find_home", "move_ra", "move_dec", "park", "pulse_guide", "slew", "sync")


def test_a_park_waits_for_a_mount_that_still_swings_where_it_parks() -> None:
    client = Client(MountProfile(park=PARK))
    client.stopped_by_abort()
    want(client.session, Hold())
    swings = {"ra_rate_dtics_s": 0, "dec_rate_dtics_s": dtics(0.01)}
    client.hear(**swings)
    ticket = submit(client, Park())
    for _ in range(6):
        client.hear(**swings)
        assert not client.send().park
        assert ticket.state is TicketState.QUEUED
    client.hear(ra_rate_dtics_s=0)
    assert client.send().park
    elsewhere = Client(MountProfile(park=AxesPosition(-18.0, 20.0)))
    elsewhere.stopped_by_abort()
    want(elsewhere.session, Hold())
    elsewhere.hear(**swings)
    refused = submit(elsewhere, Park())
    for _ in range(6):
        elsewhere.hear(**swings)
        assert not elsewhere.send().park
    assert refused.state is TicketState.FAILED


def statuses_until(see: Any, reached: Any) -> int:
    for count in range(1, 1000):
        see()
        if reached():
            return count
    raise AssertionError("never")


class TestFlags:
    def test_a_flag_that_fell_without_an_answer_is_free_after_half_a_second(self) -> None:
        flag = OneShot()
        assert flag.see(True) is False
        assert flag.happen("request") is True
        assert flag.happen("request") is False
        assert flag.up is True
        assert flag.see(False) is False
        assert flag.happen("withdraw") is True
        assert flag.statuses == 0
        assert statuses_until(lambda: flag.see(False), lambda: flag.state is Handshake.IDLE) == 10
        assert flag.happen("request") is True
        assert flag.see(True) is True
        assert flag.state is Handshake.RELEASING
        assert flag.see(True) is False

    def test_a_slew_without_an_answer_falls_after_a_second_and_rises_again_half_a_second_later(self) -> None:
        slew = SlewFlag()
        slew.want(A)
        assert slew.compose(A, True) == (True, A)
        still = replace(TRACKING, slewing=False)
        assert statuses_until(lambda: slew.see(still, 0.0), lambda: not slew.flag.up) == 21
        assert slew.state is SlewState.WAITING
        waits = statuses_until(lambda: slew.see(still, 0.0), lambda: slew.compose(A, True)[0])
        assert waits == 10

    @pytest.mark.parametrize(("off_deg", "statuses"), [(0.49, 5), (0.51, 200)])
    def test_a_slew_that_is_not_seen_to_move(self, off_deg: float, statuses: int) -> None:
        slew = SlewFlag()
        slew.want(A)
        slew.compose(A, True)
        slew.see(replace(TRACKING, ack_slew=True), 12.5)
        assert (slew.state, slew.launched_utc_s) == (SlewState.LAUNCHED, 12.5)

        def see() -> None:
            slew.see(TRACKING, 13.0)
            slew.rests(off_deg)

        # The status with the acknowledgement is the first of them.
        assert statuses_until(see, lambda: slew.state is SlewState.DONE) == statuses
        assert slew.launched_utc_s == 12.5

    def test_a_slew_that_was_seen_to_move_is_done_at_rest(self) -> None:
        slew = SlewFlag()
        slew.want(A)
        slew.compose(A, True)
        slew.see(replace(TRACKING, ack_slew=True, slewing=True), 0.0)
        assert slew.state is SlewState.UNDER_WAY
        slew.rests(30.0)
        assert slew.state is SlewState.DONE

    def test_an_abort_without_an_answer_dips_for_three_after_ever_longer_times(self) -> None:
        """After 21 datagrams, then twice as many each time, and never more than 336: one second to 17."""
        abort = AbortFlag()
        abort.ask()
        sent = [abort.compose(False) for _ in range(1400)]
        runs = [(up, len(list(run))) for up, run in itertools.groupby(up for up, _ in sent)]
        # The edge itself is the first of the 21.
        lasted = [20, 42, 84, 168, 336, 336, 336]
        assert [count for up, count in runs if up][:7] == lasted
        assert {count for up, count in runs[:-1] if not up} == {3}
        assert all(sending for _, sending in sent)

    def test_an_abort_that_acts_late_has_no_second_edge_before_it_acts(self) -> None:
        late = AbortFlag(late_ticks=40)
        ups = [late.compose(False)[0] for _ in range(1000)]
        runs = [(up, len(list(run))) for up, run in itertools.groupby(ups)]
        assert runs[:6] == [(True, 60), (False, 3), (True, 122), (False, 3), (True, 244), (False, 3)]
        standing = AbortFlag(late_ticks=40)
        assert [standing.compose(True)[0] for _ in range(96)] == ([True] * 4 + [False] * 44) * 2

    def test_an_abort_whose_acknowledgement_stands_is_up_for_four_of_eight(self) -> None:
        abort = AbortFlag()
        abort.ask()
        sent = [abort.compose(True) for _ in range(24)]
        assert sent == ([(True, True)] * 4 + [(False, False)] * 4) * 3
        assert abort.on_its_way is False

    def test_an_abort_on_its_way_goes_on(self) -> None:
        abort = AbortFlag()
        assert abort.on_its_way is False
        # Four datagrams have it where an acknowledgement stands already.
        went = []
        for _ in range(8):
            up, _ = abort.compose(True)
            went.append((up, abort.on_its_way))
        assert went == [(True, True)] * 3 + [(True, False)] + [(False, False)] * 4
        abort = AbortFlag()
        abort.compose(False)
        assert abort.on_its_way is True
        assert abort.see(True, True) is True
        assert (abort.on_its_way, abort.state, abort.acknowledged) == (False, StopState.HEARD, True)

    def test_an_abort_of_anothers_counts_after_half_a_second(self) -> None:
        abort = AbortFlag()
        abort.ask()
        assert statuses_until(lambda: abort.see(True, True), lambda: abort.acknowledged) == 10
        abort.see(False, True)
        assert (abort.acks_not_ours, abort.acknowledged) == (0, False)
        abort.see(True, False)
        assert abort.acks_not_ours == 0

    def test_an_abort_goes_again_once_its_flag_is_free_or_its_acknowledgement_stuck(self) -> None:
        abort = AbortFlag()
        abort.ask()
        abort.compose(False)
        assert abort.goes_again() is False
        abort.see(True, True)
        stuck = AbortFlag()
        stuck.compose(False)
        stuck.see(True, True)
        assert statuses_until(lambda: stuck.see(True, True), stuck.goes_again) == 11
        assert stuck.state is StopState.AGAIN
        abort.see(False, True)
        assert abort.goes_again() is True
        assert (abort.state, abort.acknowledged) == (StopState.AGAIN, True)

    def test_held_a_mount_that_does_not_answer_is_over_half_a_second_after_the_last_rates(self) -> None:
        for ack in (False, True):
            move = HeldMove()
            assert move.over is True
            assert move.compose(AxisRates(1.0, None)) == Sent(AxisRates(1.0, None), True)
            for _ in range(5):
                move.see(TRACKING)
            move.compose(AxisRates(1.0, None))
            assert move.compose(NO_RATES) == Sent(NO_RATES, False)
            assert move.over is False
            said = replace(TRACKING, ack_move_ra=ack)
            assert (
                statuses_until(lambda move=move, said=said: move.see(said), lambda move=move: move.over) == 10
            )
            assert move.state is HeldState.OVER

    def test_held_flags_that_a_mount_at_rest_has_not_taken_fall_and_rise_anew_ever_more_rarely(self) -> None:
        move, rates = HeldMove(), AxisRates(1.0, -0.5)
        fell = []
        for turn in range(100):
            if move.compose(rates) == Sent(NO_RATES, False):
                fell.append(turn)
            move.see(TRACKING)
            move.rests(True)
        assert fell == [10, 11, 12, 33, 34, 35, 76, 77, 78]

    @pytest.mark.parametrize(("rests", "ack"), [(False, False), (True, True)])
    def test_held_flags_stay_up_where_the_mount_moves_or_has_acknowledged_them(
        self, rests: bool, ack: bool
    ) -> None:
        move, rates = HeldMove(), AxisRates(1.0, -0.5)
        for _ in range(100):
            assert move.compose(rates) == Sent(rates, True)
            move.see(replace(TRACKING, ack_move_ra=ack, ack_move_dec=ack))
            move.rests(rests)

    def test_held_a_mount_may_take_the_flags_after_its_slew_for_ten_seconds(self) -> None:
        move = HeldMove()
        waits = []
        for _ in range(300):
            move.compose(AxisRates(1.0, -0.5))
            move.see(TRACKING)
            move.rests(False)
            waits.append(move.may_wait)
        assert waits == [True] * 199 + [False] * 101
        move.see(replace(TRACKING, ack_move_ra=True))
        move.rests(False)
        assert move.may_wait is False

    def test_edge_a_mount_may_take_rates_after_its_slew_for_ten_seconds(self) -> None:
        move, waits = EdgeMove(), []
        assert move.may_wait is False
        for _ in range(300):
            move.compose(AxisRates(1.0, -0.5))
            move.see(TRACKING)
            waits.append(move.may_wait)
        assert waits == [True] * 199 + [False] * 101

    def test_edge_a_mount_that_has_taken_rates_does_not_wait(self) -> None:
        move = EdgeMove()
        move.compose(AxisRates(1.0, -0.5))
        move.see(TRACKING)
        assert move.may_wait is True
        move.compose(AxisRates(1.0, -0.5))
        move.see(replace(TRACKING, ack_move_ra=True, ack_move_dec=True))
        assert move.may_wait is False
        move.compose(AxisRates(1.0, -0.5))
        move.see(TRACKING)
        assert move.may_wait is False

    @pytest.mark.parametrize("ack", ["ack_move_ra", "ack_move_dec"])
    def test_held_it_is_over_when_either_acknowledgement_was_seen_up_and_then_down(self, ack: str) -> None:
        move = HeldMove()
        move.compose(AxisRates(1.0, 1.0))
        move.see(replace(TRACKING, **{ack: True}))
        move.hush()
        assert (move.over, move.state) == (False, HeldState.RELEASING)
        move.see(TRACKING)
        assert move.over is True

    def test_edge_rates_without_an_answer_fall_after_a_second_and_are_sent_again(self) -> None:
        move, rates = EdgeMove(), AxisRates(1.0, -0.5)
        assert move.over is True
        assert move.compose(rates) == Sent(rates, True)
        assert move.compose(rates) == Sent(rates, False)
        still = TRACKING
        fell = statuses_until(lambda: move.see(still), lambda: move.compose(rates).rates == NO_RATES)
        assert fell == 21
        rose = statuses_until(lambda: move.see(still), lambda: move.compose(rates).begins)
        assert rose == 10
        assert (move.over, move.waits) == (False, 0)

    def test_edge_rates_that_are_never_answered_fall_soon_from_the_third_on(self) -> None:
        move, rates = EdgeMove(), AxisRates(1.0, -0.5)
        move.compose(rates)
        lasted = []
        for _ in range(4):
            fell = statuses_until(lambda: move.see(TRACKING), lambda: move.compose(rates).rates == NO_RATES)
            rose = statuses_until(lambda: move.see(TRACKING), lambda: move.compose(rates).begins)
            lasted.append((fell, rose))
        # The second has fallen when it is known that the mount answers none.
        assert lasted == [(21, 10), (21, 4), (5, 4), (5, 4)]
        assert move.answers.unanswered_statuses == 10

    @pytest.mark.parametrize("before", [0, 1, 4])
    @pytest.mark.parametrize("acks", [("ack_move_ra", "ack_move_dec"), ("ack_move_dec",)])
    @pytest.mark.parametrize("late", [False, True])
    def test_edge_rates_have_their_time_where_any_was_answered(
        self, before: int, acks: tuple[str, ...], late: bool
    ) -> None:
        """Late, or on one axis only: so a mount is not mute, before or after it was taken for that."""
        move, rates = EdgeMove(), AxisRates(1.0, -0.5)

        def until(reached: Callable[[], bool]) -> int:
            return statuses_until(lambda: move.see(TRACKING), reached)

        def falls() -> bool:
            return move.compose(rates).rates == NO_RATES

        def rises() -> bool:
            return move.compose(rates).begins

        move.compose(rates)
        for _ in range(before):
            until(falls)
            until(rises)
        if late:
            until(falls)
        move.see(replace(TRACKING, **dict.fromkeys(acks, True)))
        assert not move.answers.mute
        move.see(TRACKING)
        for _ in range(4):
            move.renew()
            until(rises)
            assert until(falls) == 21
        assert move.answers.unanswered_statuses == 32

    def test_edge_new_rates_wait_for_the_handshake_of_those_before(self) -> None:
        move, rates, others = EdgeMove(), AxisRates(1.0, None), AxisRates(2.0, None)
        move.compose(rates)
        assert [move.compose(others).rates for _ in range(3)] == [rates] * 3
        assert move.waits == 3
        move.see(replace(TRACKING, ack_move_ra=True))
        assert move.compose(others) == Sent(NO_RATES, False)
        assert move.waits == 4
        move.see(TRACKING)
        assert move.compose(others) == Sent(others, True)
        assert move.waits == 0
        assert move.compose(others).rates == others
        assert move.waits == 0

    def test_edge_the_end_is_rate_0_on_every_axis_in_force(self) -> None:
        move = EdgeMove()
        move.compose(AxisRates(1.0, None))
        move.see(replace(TRACKING, ack_move_ra=True))
        move.see(TRACKING)
        assert move.compose(NO_RATES) == Sent(AxisRates(0.0, None), True)
        assert move.over is False
        move.see(replace(TRACKING, ack_move_ra=True))
        move.see(TRACKING)
        assert move.over is True
        assert move.compose(NO_RATES) == Sent(NO_RATES, False)
        move.insist()
        assert move.over is False
        assert move.compose(NO_RATES) == Sent(AxisRates(0.0, 0.0), True)

    def test_edge_both_axes_acknowledgements_end_the_flags_and_one_keeps_them_from_rising(self) -> None:
        move, rates = EdgeMove(), AxisRates(1.0, 1.0)
        move.compose(rates)
        move.see(replace(TRACKING, ack_move_ra=True))
        assert move.compose(rates).rates == rates
        move.see(replace(TRACKING, ack_move_ra=True, ack_move_dec=True))
        assert move.compose(rates).rates == NO_RATES
        move.see(replace(TRACKING, ack_move_dec=True))
        assert move.compose(AxisRates(2.0, 1.0)).begins is False
        move.see(TRACKING)
        assert move.compose(AxisRates(2.0, 1.0)).begins is True

    def test_edge_after_an_abort_nothing_is_in_force(self) -> None:
        move = EdgeMove()
        move.compose(AxisRates(1.0, 1.0))
        move.hush()
        move.stopped()
        for _ in range(10):
            assert move.over is False
            move.see(TRACKING)
        assert move.over is True

    def test_a_moveaxis_of_ours_that_goes_on_is_ended_anew_each_second_and_no_one_elses(self) -> None:
        watch = MoveWatch(ours=True)
        second = [Again.NOTHING] * 19
        ends = [*second, Again.END, *second, Again.END]
        assert [watch.see(True, True, True) for _ in range(80)] == ends + 2 * [*second, Again.ABORT]
        watch = MoveWatch(ours=True)
        for _ in range(59):
            watch.see(True, True, True)
        assert watch.see(True, True, False) is Again.NOTHING
        assert [watch.see(True, True, True) for _ in range(20)] == [*second, Again.END]
        assert watch.see(False, False, False) is Again.NOTHING
        assert watch.ours is True
        watch.see(True, False, False)
        assert watch.ours is False
        assert {watch.see(True, True, True) for _ in range(60)} == {Again.NOTHING}


@pytest.mark.parametrize("move_axis", ["held", "edge"])
@pytest.mark.parametrize("kind", ["planner", "velocity_servo", "position_servo"])
def test_a_moveaxis_of_a_stranger_ends_and_a_slew_follows_it(kind: str, move_axis: str) -> None:
    """Some leave it by an abort alone: at rate 0 they are in it still, and slew nowhere."""
    module: Any = importlib.import_module(f"strangers.{kind}")
    mount = module.Mount(module.Parameters(move_axis=move_axis, start_utc_s=T0, dec_deg=20.0))
    session = Session(MountProfile(move_axis=move_axis))

    def turns(count: int) -> None:
        for _ in range(count):
            at_s = mount.next_turn_s
            session.receive(bytes(mount.turn()), at_s)
            mount.receive(session.compose())

    turns(20)
    want(session, MOVE)
    turns(40)
    assert abs(mount.truth().dec_rate_deg_s - MOVE.dec_rate_deg_s) < 0.1
    ticket = session.submit(ClearedRequest(EndMove()))
    turns(200)
    assert ticket.state is TicketState.COMPLETE
    assert session.status is not None
    assert session.status.slewing is False
    want(session, MOVE)
    turns(40)
    goal = Slew(mount.truth().ra_deg - 3.0, 15.0)
    want(session, goal)
    turns(300)
    assert session.slew_state is SlewState.DONE
    assert math.isclose(mount.truth().reported_dec_deg, goal.dec_deg, abs_tol=0.01)


def test_unknown_rates_are_unlike_any() -> None:
    move = EdgeMove()
    move.compose(AxisRates(1.0, None))
    move.see(replace(TRACKING, ack_move_ra=True))
    move.see(TRACKING)
    assert move.compose(AxisRates(1.0, None)).begins is False
    move.renew()
    assert move.compose(AxisRates(1.0, None)) == Sent(AxisRates(1.0, None), True)
    assert not math.isnan(move.compose(AxisRates(1.0, None)).rates.ra or 0.0)


def test_moveaxis_on_one_axis_leaves_both_to_the_motion_that_follows_its_end() -> None:
    client = tracking()
    submit(client, MoveAxis(1.0, None))
    assert (client.send().move_ra, client.send().move_dec) == (True, False)
    want(client.session, Hold())
    client.send()
    command = client.asks(MoveAxes(-1.0, 0.5))
    assert (command.move_ra, command.move_dec) == (True, True)


def test_a_motion_takes_the_place_of_requests_that_wait_and_its_end_does_not() -> None:
    client = Client()
    first = submit(client, SYNC)
    want(client.session, Hold())
    assert first.state is TicketState.QUEUED
    want(client.session, MOVE)
    assert (first.state, first.reason) == (TicketState.SUPERSEDED, "a motion was asked for")
    second = submit(client, SYNC)
    submit(client, EndMove())
    assert second.state is TicketState.QUEUED
    submit(client, A)
    assert second.state is TicketState.SUPERSEDED


def test_the_end_of_moveaxis_is_complete_when_the_mount_neither_slews_nor_turns() -> None:
    client = tracking()
    want(client.session, MOVE)
    client.send()
    client.hear(ack_move_ra=True, ack_move_dec=True, slewing=True, ra_rate_dtics_s=dtics(1.25))
    ticket = submit(client, EndMove())
    client.send()
    client.hear(slewing=True, ra_rate_dtics_s=dtics(1.0))
    client.hear(slewing=True)
    client.hear(slewing=False)
    client.send()
    assert ticket.state is TicketState.RAISED
    client.rest(ra_rate_dtics_s=SIDEREAL_DTICS_S)
    assert ticket.state is TicketState.COMPLETE


def test_moveaxis_asked_for_again_at_the_same_rates_has_an_edge_and_an_answer_of_its_own() -> None:
    client = tracking(MountProfile(move_axis="edge"))
    acknowledged = {"ack_move_ra": True, "ack_move_dec": True, "slewing": True}
    for _ in range(2):
        ticket = submit(client, MoveAxis(1.0, 0.5))
        command = client.send()
        assert (command.move_ra, command.move_dec) == (True, True)
        client.hear(**acknowledged)
        assert ticket.state is TicketState.COMPLETE
        assert not client.send().move_ra
        client.hear(slewing=True)
        client.send()


class TestMotionThatGoesOn:
    """A late copy of an edge, read after the end, sets the mount going again; it is ended anew."""

    @staticmethod
    def edges(client: Client, statuses: int, rate_deg_s: float = 1.25) -> list[int]:
        """After how many statuses the end of MoveAxis goes out."""
        found = []
        for number in range(1, statuses + 1):
            client.hear(slewing=True, ra_rate_dtics_s=dtics(rate_deg_s))
            command = client.send()
            assert not command.slew
            if command.move_ra or command.move_dec:
                assert (command.move_ra_rate_deg_s, command.move_dec_rate_deg_s) == (0.0, 0.0)
                found.append(number)
        return found

    @pytest.mark.parametrize("then", [Hold(), A])
    @pytest.mark.parametrize("slows", [False, True])
    def test_of_ours_is_ended_after_a_second_unless_it_slows_down(self, then: Motion, slows: bool) -> None:
        client = tracking(MountProfile(move_axis="edge"))
        both = {"ack_move_ra": True, "ack_move_dec": True}
        client.asks(MOVE)
        client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25), **both)
        client.send()
        client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25))
        ended = client.asks(then)
        assert (ended.move_ra, ended.move_ra_rate_deg_s, ended.move_dec_rate_deg_s) == (True, 0.0, 0.0)
        client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25), **both)
        client.send()
        if slows:
            assert [self.edges(client, 1, 1.2 - 0.02 * number) for number in range(40)] == [[]] * 40
        else:
            assert self.edges(client, 18) == []
            assert self.edges(client, 1) == [1]

    @pytest.mark.parametrize("then", [Hold(), A])
    def test_of_anothers_is_left_alone(self, then: Motion) -> None:
        client = tracking(MountProfile(move_axis="edge"))
        want(client.session, then)
        client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25))
        assert self.edges(client, 60) == []

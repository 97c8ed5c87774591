"""The client's end of the Xerxes protocol, told by hand what the mount says.

Source: Van Deventer, "Xerxes Mount Control Protocol": Details (the six steps of a slew, the warning about a
stale "not slewing", the rising edge), the command table (flags, units, 50 ms) and the status table
(acknowledgements, Slewing during MoveAxis).
"""

from __future__ import annotations

import dataclasses
import math
import random
import struct
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from xerxes_builders import (
    MOVE,
    PERIOD_S,
    SEEN_AT_REST_STATUSES,
    SIDEREAL_DEG_S,
    SIDEREAL_DTICS_S,
    T0,
    TIC_DEG,
    TRACKING,
    A,
    B,
    Client,
    dtics,
    moving_flags,
    overwritten,
    spoilt,
    unused_flags,
    want,
)

from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxesPosition,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    Readings,
    SitePlace,
    Slew,
    Stop,
)
from sattrack.mount.requests import (
    Abort,
    ClearedRequest,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    Sync,
    TicketState,
    TrackingRate,
)
from sattrack.mount.xerxes.datagrams import Command, encode_status
from sattrack.mount.xerxes.flags import (
    HANDSHAKE,
    HELD,
    LATEST_BEGIN_STATUSES,
    SLEW,
    STOP,
    Handshake,
    HeldState,
    SlewState,
    StopState,
    follow,
)
from sattrack.mount.xerxes.link import LINK, LONG_QUIET, LinkState
from sattrack.mount.xerxes.session import Session

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from enum import Enum


@pytest.fixture
def client() -> Client:
    """One that has heard the mount track the sky."""
    client = Client()
    for _ in range(3):
        client.hear()
        client.send()
    return client


class TestDatagrams:
    def test_nothing_asked_is_header_counter_and_no_flag(self) -> None:
        data = Session(MountProfile()).compose()
        assert len(data) == 82
        assert data[:8] == bytes.fromhex("AA AA 55 55 00 00 00 00")
        assert data[73:] == bytes(9)

    def test_the_counter_rises_by_one_a_datagram_heard_or_not(self, client: Client) -> None:
        counters = []
        for motion in (Hold(), A, Stop(), MOVE):
            want(client.session, motion)
            for heard in (False, True):
                if heard:
                    client.hear()
                counters.append(client.send().counter)
        assert counters == list(range(counters[0], counters[0] + 8))
        assert client.session.health.sent == 11

    def test_a_slew_byte_by_byte(self, client: Client) -> None:
        want(client.session, A)
        data = client.session.compose()
        assert data[16:32] == bytes.fromhex(
            "00 00 00 00 00 80 28 40 00 00 00 00 00 00 15 40"
        )  # 12.25°, 5.25 h
        assert data[73:] == bytes.fromhex("00 00 00 00 00 00 FF 00 00")

    def test_a_move_byte_by_byte(self, client: Client) -> None:
        """Reported right ascension falling at 1.25°/s is the axis going west: positive."""
        want(client.session, MOVE)
        data = client.session.compose()
        assert data[32:48] == bytes.fromhex("00 00 00 00 00 00 E8 BF 00 00 00 00 00 00 F4 3F")
        assert data[73:] == bytes.fromhex("00 00 FF FF 00 00 00 00 00")

    def test_an_abort_byte_by_byte(self, client: Client) -> None:
        want(client.session, Stop())
        assert client.session.compose()[73:] == bytes.fromhex("FF 00 00 00 00 00 00 00 00")


class TestSlew:
    def test_the_six_steps_of_the_paper(self, client: Client) -> None:
        assert client.slew_state() is SlewState.NONE
        asked = client.asks(A)
        assert asked.slew
        assert client.slew_state() is SlewState.ASKED
        client.hear(ack_slew=True, slewing=True)
        assert client.slew_state() is SlewState.UNDER_WAY
        assert not client.send().slew
        client.hear(slewing=True)
        assert client.slew_state() is SlewState.UNDER_WAY
        assert not client.send().slew
        client.hear()
        assert client.slew_state() is SlewState.UNDER_WAY
        client.rest(ra_rate_dtics_s=SIDEREAL_DTICS_S)
        assert client.slew_state() is SlewState.DONE
        assert not client.send().slew

    def test_flag_and_target_stay_until_the_acknowledgement_is_seen(self, client: Client) -> None:
        want(client.session, A)
        for heard in (False, True, True, False, True):
            if heard:
                client.hear()
            command = client.send()
            assert (command.slew, command.target_ra_h, command.target_dec_deg) == (True, 5.25, 12.25)

    def test_a_stale_not_slewing_does_not_end_the_slew(self, client: Client) -> None:
        """The paper: an older datagram "may fool the client into thinking that the slew is complete"."""
        assert client.asks(A).slew
        for _ in range(5):
            client.hear(slewing=False, ack_slew=False)
            assert client.slew_state() is SlewState.ASKED
            assert client.send().slew

    def test_a_status_overtaken_by_the_acknowledgement_does_not_end_the_slew(self, client: Client) -> None:
        assert client.asks(A).slew
        overtaken = client.status(slewing=False)
        client.hear(ack_slew=True, slewing=True)
        assert client.session.receive(overtaken, client.now) is None
        assert client.slew_state() is SlewState.UNDER_WAY

    def test_a_slew_that_ends_before_the_acknowledgement_falls_is_done(self, client: Client) -> None:
        there = {"ra_h": A.ra_deg / 15.0, "dec_deg": A.dec_deg}
        assert client.asks(A).slew
        client.hear(ack_slew=True, slewing=False, **there)
        assert not client.send().slew
        assert client.slew_state() is not SlewState.DONE
        for _ in range(40):
            client.hear(**there)
            assert not client.send().slew
        assert client.slew_state() is SlewState.DONE

    def test_a_slew_that_begins_late_is_not_done_before_it_begins(self, client: Client) -> None:
        assert client.asks(A).slew
        client.hear(ack_slew=True, slewing=False)
        for _ in range(LATEST_BEGIN_STATUSES - 10):
            client.send()
            client.hear()
            assert client.slew_state() is SlewState.LAUNCHED
        for _ in range(20):
            client.send()
            client.hear()
        assert client.slew_state() is SlewState.DONE

    def test_asking_for_the_same_every_period_launches_once(self, client: Client) -> None:
        rises, before = 0, False
        for turn in range(60):
            command = client.asks(A)
            rises += command.slew and not before
            before = command.slew
            client.hear(ack_slew=2 <= turn < 5, slewing=2 <= turn < 30)
        assert rises == 1
        assert client.slew_state() is SlewState.DONE

    @pytest.mark.parametrize("moving", [{"ack_move_ra": True}, {}])
    def test_a_slew_waits_for_standstill(self, client: Client, moving: dict[str, bool]) -> None:
        """The command table: "Ignore if still slewing"."""
        client.hear(slewing=True, **moving)
        for _ in range(4):
            assert not client.asks(A).slew
            assert client.slew_state() is SlewState.WAITING
            client.hear(slewing=True, **moving)
        client.hear(slewing=False)
        assert client.send().slew
        assert client.slew_state() is SlewState.ASKED

    def test_a_slew_out_of_moveaxis_first_ends_moveaxis(self, client: Client) -> None:
        assert moving_flags(client.asks(MOVE)) == ["move_ra", "move_dec"]
        client.hear(slewing=True, ack_move_ra=True, ack_move_dec=True)
        client.send()
        assert moving_flags(client.asks(A)) == []
        client.hear(slewing=True)
        assert moving_flags(client.send()) == []
        client.hear(slewing=False)
        # After a few datagrams' distance: a late one with MoveAxis must not launch over the slew.
        sent = [moving_flags(client.send()) for _ in range(4)]
        assert sent[-1] == ["slew"]
        assert all(flags in ([], ["slew"]) for flags in sent)

    def test_the_flag_rises_again_only_after_the_acknowledgement_fell(self, client: Client) -> None:
        assert client.asks(A).slew
        client.hear(ack_slew=True, slewing=True)
        assert not client.send().slew
        for _ in range(4):
            client.hear(ack_slew=True, slewing=False)
            assert not client.asks(B).slew
        client.hear(ack_slew=False, slewing=False)
        again = client.send()
        assert again.slew
        assert (again.target_ra_h, again.target_dec_deg) == (10.0, -33.375)

    def test_an_acknowledgement_left_by_another_client_is_not_ours(self) -> None:
        """The mount saw no rising edge of ours; its acknowledgement is of a flag still in its mailbox."""
        client = Client()
        client.hear(ack_slew=True)
        for _ in range(4):
            assert not client.asks(A).slew
            client.hear(ack_slew=True)
            assert client.slew_state() not in (SlewState.UNDER_WAY, SlewState.DONE)
        client.hear(ack_slew=False)
        assert client.send().slew

    def test_another_target_before_the_acknowledgement_is_asked_for_by_itself(self, client: Client) -> None:
        """The mount read the first target on the edge; the second needs an edge of its own."""
        assert client.asks(A).slew
        held = client.asks(B)
        assert (held.slew, held.target_ra_h, held.target_dec_deg) == (True, 5.25, 12.25)
        client.hear(ack_slew=True, slewing=True)
        client.send()
        client.hear(slewing=True)
        client.send()
        client.hear(slewing=False)
        assert client.slew_state() is not SlewState.DONE
        second = client.send()
        assert second.slew
        assert (second.target_ra_h, second.target_dec_deg) == (10.0, -33.375)

    def test_another_target_under_way_waits_for_its_turn(self, client: Client) -> None:
        assert client.asks(A).slew
        client.hear(ack_slew=True, slewing=True)
        client.send()
        client.hear(slewing=True)
        for _ in range(4):
            assert not client.asks(B).slew
            client.hear(slewing=True)
            assert client.slew_state() is SlewState.WAITING
        client.hear(slewing=False)
        second = client.send()
        assert second.slew
        assert (second.target_ra_h, second.target_dec_deg) == (10.0, -33.375)

    @pytest.mark.parametrize("other", [Hold(), MOVE, Stop()])
    def test_the_state_is_none_once_anything_else_is_asked_for(self, client: Client, other: Motion) -> None:
        client.asks(A)
        client.hear(ack_slew=True, slewing=True)
        client.send()
        client.rest(ra_rate_dtics_s=SIDEREAL_DTICS_S)
        assert client.slew_state() is SlewState.DONE
        client.asks(other)
        assert client.slew_state() is SlewState.NONE

    @pytest.mark.parametrize(
        ("ra_deg", "hours"), [(0.0, 0.0), (359.0, 359.0 / 15), (-15.0, 23.0), (360.0, 0.0), (735.0, 1.0)]
    )
    def test_right_ascension_goes_out_in_hours_0_to_24(
        self, client: Client, ra_deg: float, hours: float
    ) -> None:
        assert client.asks(Slew(ra_deg, 0.0)).target_ra_h == pytest.approx(hours, abs=1e-12)

    @given(ra_deg=st.floats(-1e4, 1e4), dec_deg=st.floats(-90, 90))
    @settings(max_examples=60, deadline=None)
    def test_any_target_goes_out_in_range(self, ra_deg: float, dec_deg: float) -> None:
        client = Client()
        client.hear()
        command = client.asks(Slew(ra_deg, dec_deg))
        assert 0.0 <= command.target_ra_h <= 24.0
        assert math.remainder(command.target_ra_h * 15 - ra_deg, 360.0) == pytest.approx(0.0, abs=1e-8)
        assert command.target_dec_deg == dec_deg


class TestMoveAxis:
    def test_flags_stay_up_through_the_acknowledgement_with_the_latest_rates(self, client: Client) -> None:
        for turn in range(20):
            command = client.asks(MoveAxes(0.01 * (turn + 1), -0.02 * (turn + 1)))
            assert moving_flags(command) == ["move_ra", "move_dec"]
            assert command.move_ra_rate_deg_s == pytest.approx(-0.01 * (turn + 1))
            assert command.move_dec_rate_deg_s == pytest.approx(-0.02 * (turn + 1))
            client.hear(slewing=turn > 2, ack_move_ra=turn > 2, ack_move_dec=turn > 2)

    def test_one_status_is_the_first_to_acknowledge_raised_flags(self) -> None:
        """On a mount that holds, once; of edges, each has its own; both axes' where both were raised."""
        both = {"slewing": True, "ack_move_ra": True, "ack_move_dec": True}
        for move_axis, again in (("held", False), ("edge", True)):
            client = tracked(MountProfile(move_axis=move_axis))
            found = []
            for rate, acks in (
                (0.5, {"slewing": True}),
                (0.5, both | {"ack_move_dec": move_axis == "held"}),
                (0.5, both),
                (0.5, both),
                (0.5, {"slewing": True}),
                (0.7, {"slewing": True}),
                (0.7, both),
                (0.7, both),
            ):
                client.asks(MoveAxes(rate, 0.25))
                sample = client.hear(**acks)
                assert sample is not None
                found.append(sample.move_acknowledged)
            first = [False, move_axis == "held", move_axis == "edge"]
            assert found == [*first, False, False, False, again, False]

    def test_flags_stay_up_without_being_asked_again_and_unheard(self, client: Client) -> None:
        want(client.session, MOVE)
        for _ in range(50):
            command = client.send()
            assert moving_flags(command) == ["move_ra", "move_dec"]
            assert (command.move_ra_rate_deg_s, command.move_dec_rate_deg_s) == (1.25, -0.75)

    def test_hold_takes_the_flags_down_at_once(self, client: Client) -> None:
        client.asks(MOVE)
        client.hear(slewing=True, ack_move_ra=True, ack_move_dec=True)
        assert moving_flags(client.asks(Hold())) == []

    @pytest.mark.parametrize("ra_sign", [-1, 1])
    @pytest.mark.parametrize("dec_sign", [-1, 1])
    @pytest.mark.parametrize("additive", [True, False])
    def test_signs_and_additivity_follow_the_profile(
        self, ra_sign: Literal[-1, 1], dec_sign: Literal[-1, 1], additive: bool
    ) -> None:
        """The axis turns by the sky's rate less the wanted one; an additive mount adds the sky's itself."""
        profile = MountProfile(ra_rate_sign=ra_sign, dec_rate_sign=dec_sign, additive=additive)
        client = Client(profile)
        client.hear()
        command = client.asks(MoveAxes(0.3, 0.2))
        axis_rate = -0.3 + (0.0 if additive else SIDEREAL_DEG_S)
        assert command.move_ra_rate_deg_s == pytest.approx(ra_sign * axis_rate, abs=1e-9)
        assert command.move_dec_rate_deg_s == pytest.approx(dec_sign * 0.2, abs=1e-9)

    @pytest.mark.parametrize("beyond", [False, True])
    @pytest.mark.parametrize(("told", "signs"), [((-1, -1), (-1, -1)), ((0, 0), (1, 1)), ((0, -1), (1, -1))])
    def test_beyond_the_pole_signs_are_those_of_that_side(
        self, beyond: bool, told: tuple[Any, Any], signs: tuple[int, int]
    ) -> None:
        profile = MountProfile(
            ra_rate_sign_beyond_pole=told[0] or None, dec_rate_sign_beyond_pole=told[1] or None
        )
        client = Client(profile)
        client.hear(side_of_pier=beyond)
        command = client.asks(MoveAxes(-0.3, 0.2))
        ra_sign, dec_sign = signs if beyond else (1, 1)
        assert command.move_ra_rate_deg_s == pytest.approx(ra_sign * 0.3)
        assert command.move_dec_rate_deg_s == pytest.approx(dec_sign * 0.2)

    @pytest.mark.parametrize(
        ("motion", "moves", "anew"),
        [
            (MOVE, False, True),
            # It moves, or may seem to rest by what is asked of it: then it has not refused them.
            (MOVE, True, False),
            (MoveAxes(0.02, 0.01), False, False),
        ],
    )
    def test_held_flags_rise_anew_where_a_mount_rests_that_should_be_seen_to_move(
        self, client: Client, motion: MoveAxes, moves: bool, anew: bool
    ) -> None:
        want(client.session, motion)
        flags = []
        for _ in range(60):
            flags.append(moving_flags(client.send()))
            client.hear(ra_rate_dtics_s=dtics(1.25) if moves else SIDEREAL_DTICS_S)
        assert (flags.count([]) > 0) is anew


class TestAbort:
    def test_it_is_alone_held_until_acknowledged_and_falls(self, client: Client) -> None:
        want(client.session, Stop())
        for _ in range(4):
            client.hear()
            command = client.send()
            assert command.abort
            assert moving_flags(command) == []
        client.hear(ack_abort=True)
        assert not client.send().abort

    def test_it_goes_out_before_anything_was_heard(self) -> None:
        assert Client().asks(Stop()).abort

    @pytest.mark.parametrize("before", [A, MOVE])
    @pytest.mark.parametrize("heard", [{}, {"slewing": True}, {"slewing": True, "ack_slew": True}])
    def test_it_takes_every_other_flag_down(
        self, client: Client, before: Motion, heard: dict[str, bool]
    ) -> None:
        client.asks(before)
        client.hear(**heard)
        command = client.asks(Stop())
        assert command.abort
        assert moving_flags(command) == []

    def test_it_rises_once(self, client: Client) -> None:
        client.stopped_by_abort()
        for _ in range(100):
            assert not client.asks(Stop()).abort
            client.hear(ra_rate_dtics_s=0)
        assert client.session.stopped

    @pytest.mark.parametrize("then", [Hold(), MOVE, A])
    def test_it_is_held_until_acknowledged_though_something_else_is_wanted(
        self, client: Client, then: Motion
    ) -> None:
        client.asks(Stop())
        want(client.session, then)
        for _ in range(4):
            client.hear()
            command = client.send()
            assert command.abort
            assert moving_flags(command) == []
        client.hear(ack_abort=True)
        assert not client.send().abort

    @pytest.mark.parametrize(("then", "flags"), [(MOVE, ["move_ra", "move_dec"]), (A, ["slew"])])
    def test_motion_resumes_after_it(self, client: Client, then: Motion, flags: list[str]) -> None:
        client.stopped_by_abort()
        want(client.session, then)
        sent = []
        # One-shots keep a few datagrams' distance, so that a late abort does not hit the slew.
        for _ in range(6):
            sent.append(client.send())
            client.hear(ra_rate_dtics_s=0)
        assert [moving_flags(command) for command in sent][-1] == flags
        assert not any(command.abort for command in sent)

    @pytest.mark.parametrize("between", [Stop(), MOVE, Hold()])
    def test_a_slew_that_was_cut_short_unanswered_is_not_sent_any_more(
        self, client: Client, between: Motion
    ) -> None:
        assert client.asks(A).slew
        if isinstance(between, Stop):
            client.stopped_by_abort()
        else:
            client.asks(between)
            client.hear()
        want(client.session, B)
        sent = []
        while not sent or not sent[-1].slew:
            sent.append(client.send())
            client.hear()
        assert (sent[-1].target_ra_h, sent[-1].target_dec_deg) == (10.0, -33.375)

    def test_a_second_stop_is_a_second_abort(self, client: Client) -> None:
        client.stopped_by_abort()
        client.asks(MOVE)
        client.hear(slewing=True, ack_move_ra=True, ack_move_dec=True, ra_rate_dtics_s=dtics(1.25))
        want(client.session, Stop())
        assert not client.session.stopped
        command = client.send()
        assert command.abort
        assert moving_flags(command) == []

    @pytest.mark.parametrize("between", [None, Hold()])
    def test_a_stop_asked_for_again_leaves_an_abort_that_is_yet_to_act(self, between: Motion | None) -> None:
        """A mount that obeys it 1.5 s late, counted from the newest edge, must not see another."""
        client = Client(MountProfile(abort_delay_s=1.5))
        client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25))
        assert client.asks(Stop()).abort
        client.hear(ack_abort=True, slewing=True, ra_rate_dtics_s=dtics(1.25))
        assert not client.send().abort
        if between is not None:
            want(client.session, between)
        for _ in range(10):
            client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25))
            assert not client.send().abort
        ticket = client.session.submit(ClearedRequest(Abort()))
        for _ in range(15):
            assert not client.send().abort
            client.hear(slewing=True, ra_rate_dtics_s=dtics(1.25))
        for _ in range(SEEN_AT_REST_STATUSES + 60):
            assert not client.send().abort
            client.hear(ra_rate_dtics_s=0)
        assert ticket.state is TicketState.COMPLETE

    def test_a_mount_that_moved_since_an_abort_is_sent_another(self) -> None:
        client = Client(MountProfile(abort_delay_s=1.5))
        client.hear()
        assert client.asks(Stop()).abort
        client.hear(ack_abort=True, ra_rate_dtics_s=0)
        client.send()
        client.hear(ra_rate_dtics_s=0)
        client.asks(MOVE)
        client.hear(ra_rate_dtics_s=0)
        assert client.asks(Stop()).abort

    def test_a_mount_set_going_again_by_a_late_datagram_is_stopped_again(self, client: Client) -> None:
        """The mount ignores the counter: a late slew is a second rising edge, after the abort's end too."""
        client.stopped_by_abort()
        for _ in range(3):
            client.hear(slewing=True, ra_rate_dtics_s=dtics(5.0))
        assert not client.session.stopped
        assert client.send().abort

    def test_axes_that_stood_and_turn_with_the_sky_by_a_late_datagram_are_stopped_again(
        self, client: Client
    ) -> None:
        """A late MoveAxis acts though the abort came later, and gives the axis back to the sky at its end."""
        client.stopped_by_abort()
        for _ in range(3):
            client.hear(ra_rate_dtics_s=SIDEREAL_DTICS_S)
        assert not client.session.stopped
        assert client.send().abort
        client.hear(ack_abort=True, ra_rate_dtics_s=0)
        client.send()
        client.rest()
        assert client.session.stopped

    def test_a_mount_that_takes_to_the_sky_by_itself_counts_as_stopped_in_the_end(
        self, client: Client
    ) -> None:
        client.stopped_by_abort()
        aborts = 0
        for _ in range(40):
            client.hear(ra_rate_dtics_s=SIDEREAL_DTICS_S)
            if client.send().abort:
                aborts += 1
                client.hear(ack_abort=True, ra_rate_dtics_s=0)
                client.send()
                client.hear(ra_rate_dtics_s=0)
                client.send()
        assert 1 <= aborts <= 3
        assert client.session.stopped

    def test_an_acknowledgement_left_by_another_client_is_not_ours(self) -> None:
        client = Client()
        client.hear(ack_abort=True, ra_rate_dtics_s=0)
        want(client.session, Stop())
        for _ in range(3):
            assert not client.session.stopped
            client.send()
            client.hear(ack_abort=True, ra_rate_dtics_s=0)
        client.hear(ack_abort=False, ra_rate_dtics_s=0)
        assert client.send().abort


class TestStopped:
    def test_not_before_the_acknowledgement(self, client: Client) -> None:
        assert not client.session.stopped
        client.asks(Stop())
        for _ in range(3):
            client.hear(ra_rate_dtics_s=0)
            assert not client.session.stopped

    @pytest.mark.parametrize("ra_dtics", [0, SIDEREAL_DTICS_S, 7788, 7790])
    def test_at_rest_or_on_the_sky(self, client: Client, ra_dtics: int) -> None:
        client.asks(Stop())
        client.hear(ack_abort=True, ra_rate_dtics_s=ra_dtics)
        client.send()
        client.rest(ra_rate_dtics_s=ra_dtics)
        assert client.session.stopped

    @pytest.mark.parametrize(
        "fields",
        [
            {"slewing": True},
            {"ra_rate_dtics_s": dtics(0.1)},
            {"ra_rate_dtics_s": dtics(-0.1)},
            {"ra_rate_dtics_s": -SIDEREAL_DTICS_S},
            {"dec_rate_dtics_s": dtics(0.1)},
            {"dec_rate_dtics_s": dtics(-0.1)},
            {"dec_rate_dtics_s": SIDEREAL_DTICS_S},
        ],
    )
    def test_not_while_it_moves(self, client: Client, fields: dict[str, Any]) -> None:
        doubles = Readings(dec_rate_dtics_s="double", ra_rate_dtics_s="double")
        client.asks(Stop())
        client.hear(ack_abort=True, readings=doubles, **fields)
        assert not client.session.stopped
        for _ in range(SEEN_AT_REST_STATUSES):
            client.send()
            client.hear(readings=doubles, **fields)
            assert not client.session.stopped

    @pytest.mark.parametrize("number", [math.nan, math.inf])
    def test_rates_that_are_no_numbers_are_named_and_positions_used(
        self, client: Client, number: float
    ) -> None:
        doubles = Readings(dec_rate_dtics_s="double", ra_rate_dtics_s="double")
        client.asks(Stop())
        for _ in range(SEEN_AT_REST_STATUSES + 1):
            client.now += PERIOD_S
            fields = {"ra_rate_dtics_s": number, "dec_rate_dtics_s": number}
            assert client.session.receive(
                client.status(ack_abort=True, readings=doubles, **fields), client.now
            )
        assert client.session.stopped
        assert client.session.sample is not None
        assert client.session.sample.ra_drive_deg_s == pytest.approx(0.0, abs=1e-6)
        status = client.session.status
        assert status is not None
        assert (status.ra_rate_dtics_s, status.dec_rate_dtics_s) == pytest.approx((0.0, 0.0), abs=2.0)
        assert client.session.ignored_fields == (
            "the mount's RightAscensionRate is no number: positions are used instead",
            "the mount's DeclinationRate is no number: positions are used instead",
        )

    def test_of_a_mount_in_motion_such_rates_are_those_of_positions(self, client: Client) -> None:
        """Of right ascension and declination, in the status' unit, from the first such number on."""
        doubles = Readings(dec_rate_dtics_s="double", ra_rate_dtics_s="double")
        for number in range(20):
            client.now += PERIOD_S
            client.turned_deg -= 1.0 * PERIOD_S
            fields = {"ra_rate_dtics_s": math.nan, "dec_rate_dtics_s": math.nan}
            told = client.status(readings=doubles, dec_deg=20.0 + 0.5 * number * PERIOD_S, **fields)
            client.session.receive(told, client.now)
        status = client.session.status
        assert status is not None
        rates = (status.ra_rate_dtics_s, status.dec_rate_dtics_s)
        assert rates == pytest.approx((dtics(-1.0), dtics(0.5)), rel=1e-4)

    def test_not_once_something_else_is_wanted(self, client: Client) -> None:
        client.stopped_by_abort()
        want(client.session, MOVE)
        assert not client.session.stopped


class TestSamples:
    @pytest.mark.parametrize("reading", ["int64", "double"])
    def test_units(self, client: Client, reading: Any) -> None:
        sample = client.hear(
            counter=77,
            readings=Readings(dec_rate_dtics_s=reading, ra_rate_dtics_s=reading, counter=reading),
            ra_h=5.25,
            dec_deg=-12.5,
            sidereal_h=6.75,
            slewing=True,
            does_refraction=True,
            ra_rate_dtics_s=7789,
            dec_rate_dtics_s=-(2**26) // 36 * 10,
        )
        assert sample is not None
        assert sample == client.session.sample
        assert (sample.counter, sample.arrival_utc_s) == (77, client.now)
        assert (sample.ra_deg, sample.dec_deg, sample.sidereal_h) == (78.75, -12.5, 6.75)
        assert (sample.slewing, sample.does_refraction) == (True, True)
        assert sample.ra_drive_deg_s == pytest.approx(SIDEREAL_DEG_S, rel=1e-4)
        assert sample.dec_drive_deg_s == pytest.approx(-10.0, rel=1e-5)
        assert client.session.status is not None
        assert client.session.status.ra_h == 5.25

    @pytest.mark.parametrize(
        ("field", "value"),
        [
            ("ra_h", 0.0),
            ("ra_h", 24.0),
            ("dec_deg", -90.0),
            ("dec_deg", 90.0),
            ("sidereal_h", 0.0),
            ("sidereal_h", 24.0),
        ],
    )
    def test_the_ends_of_the_ranges_are_in(self, client: Client, field: str, value: float) -> None:
        assert client.hear(**{field: value}) is not None

    @pytest.mark.parametrize(
        ("field", "value"),
        [
            *(
                (field, bad)
                for field in ("ra_h", "dec_deg", "sidereal_h")
                for bad in (math.nan, math.inf, -math.inf)
            ),
            ("ra_h", -0.001),
            ("ra_h", 24.001),
            ("ra_h", 1e300),
            ("dec_deg", 90.001),
            ("dec_deg", -90.001),
            ("sidereal_h", -0.001),
            ("sidereal_h", 24.001),
        ],
    )
    def test_impossible_coordinates_are_refused_and_counted(
        self, client: Client, field: str, value: float
    ) -> None:
        sample, status = client.session.sample, client.session.status
        assert client.hear(**{field: value}) is None
        assert client.session.health.rejected == 1
        assert (client.session.sample, client.session.status) == (sample, status)
        assert client.hear() is not None


class TestCounters:
    def test_none_missing(self, client: Client) -> None:
        health = client.session.health
        assert (health.received, health.lost, health.late, health.duplicate) == (3, 0, 0, 0)
        assert (health.rejected, health.restarts) == (0, 0)

    def test_the_first_status_may_have_any_counter(self) -> None:
        client = Client()
        assert client.hear(counter=123456) is not None
        assert client.session.health.lost == 0

    def test_a_gap_is_counted_and_the_status_taken(self, client: Client) -> None:
        assert client.hear(counter=8) is not None
        assert client.session.health.lost == 4

    def test_a_duplicate_is_refused(self, client: Client) -> None:
        sample = client.session.sample
        assert client.hear(counter=3, dec_deg=-5.0) is None
        assert client.session.health.duplicate == 1
        assert client.session.sample == sample

    def test_an_old_one_is_refused(self, client: Client) -> None:
        sample = client.session.sample
        assert client.hear(counter=2, dec_deg=-5.0) is None
        assert client.session.health.late == 1
        assert client.session.sample == sample
        assert client.hear(counter=4) is not None

    def test_a_restarted_mount_is_taken_after_three(self) -> None:
        client = Client()
        client.hear(counter=5000)
        assert client.hear(counter=1) is None
        assert client.hear(counter=2) is None
        assert client.session.health.restarts == 0
        assert client.hear(counter=3) is not None
        assert client.hear(counter=4) is not None
        assert client.session.health.restarts == 1
        assert client.session.health.lost == 0

    @pytest.mark.parametrize("seed", range(5))
    def test_a_restarted_mount_is_taken_though_statuses_are_lost(self, seed: int) -> None:
        client = Client()
        client.hear(counter=5000)
        rng = random.Random(seed)
        taken = [client.hear(counter=counter) for counter in range(1, 60) if rng.random() > 0.3]
        assert taken[-1] is not None
        assert client.session.health.restarts == 1

    def test_latecomers_between_fresh_ones_are_no_restart(self) -> None:
        client = Client()
        client.hear(counter=1000)
        for turn in range(1, 20):
            assert client.hear(counter=100 + turn) is None
            assert client.hear(counter=1000 + turn) is not None
        assert client.session.health.restarts == 0

    def test_one_latecomer_repeated_is_no_restart(self) -> None:
        client = Client()
        client.hear(counter=1000)
        assert [client.hear(counter=990) for _ in range(10)] == [None] * 10
        assert client.hear(counter=1001) is not None
        assert client.session.health.restarts == 0

    def test_latecomers_and_a_duplicate_of_the_newest_are_no_restart(self) -> None:
        client = Client()
        client.hear(counter=1000)
        assert [client.hear(counter=counter) for counter in (998, 999, 1000)] == [None] * 3
        assert client.session.health.restarts == 0

    def test_an_outage_is_no_restart(self) -> None:
        """A restarted mount's counter goes back, this one's went on for 30 s unheard."""
        client = Client()
        client.hear(counter=1000)
        client.now += 30.0
        taken = [client.hear(counter=1600 + turn) is not None for turn in range(10)]
        assert taken[-1]
        assert client.session.health.restarts == 0

    def test_latecomers_falling_back_are_no_restart(self) -> None:
        client = Client()
        client.hear(counter=1000)
        assert [client.hear(counter=999 - turn) for turn in range(10)] == [None] * 10
        assert client.session.health.restarts == 0

    def test_one_status_from_far_ahead_does_not_deafen_for_long(self) -> None:
        client = Client()
        client.hear(counter=1000)
        client.hear(counter=2**50)
        taken = [client.hear(counter=1000 + turn) is not None for turn in range(1, 10)]
        assert taken[-1]


class TestLink:
    def test_the_rate_is_how_often_statuses_arrive(self) -> None:
        client = Client()
        assert client.session.health.rate_hz is None
        for _ in range(30):
            client.hear()
        assert client.session.health.rate_hz == pytest.approx(1.0 / PERIOD_S)

    def test_silent_up_stale_lost(self) -> None:
        client = Client()
        assert client.session.link_state(T0) is LinkState.SILENT
        assert client.session.link_state(T0 + 100) is LinkState.SILENT
        client.hear()
        for age, state in (
            (0.0, LinkState.UP),
            (0.29, LinkState.UP),
            (0.31, LinkState.STALE),
            (1.99, LinkState.STALE),
            (2.01, LinkState.LOST),
            (1e6, LinkState.LOST),
        ):
            assert client.session.link_state(client.now + age) is state
        client.now += 10
        client.hear()
        assert client.session.link_state(client.now) is LinkState.UP

    def test_only_what_was_accepted_keeps_it_up(self, client: Client) -> None:
        for _ in range(60):
            client.hear(counter=3)
            client.hear(dec_deg=math.nan)
            client.session.receive(b"", client.now)
        assert client.session.link_state(client.now) is LinkState.LOST


@dataclasses.dataclass(frozen=True)
class Heard:
    """A status of some mount, likely or not."""

    ack_slew: bool
    ack_abort: bool
    slewing: bool
    step: int


STEPS = st.lists(
    st.one_of(
        st.sampled_from((Hold(), A, B, MOVE, Stop())),
        st.builds(Heard, st.booleans(), st.booleans(), st.booleans(), st.sampled_from((0, 1, 1, 1, 1, 2))),
        st.just("send"),
    ),
    min_size=5,
    max_size=60,
)


@dataclasses.dataclass(frozen=True)
class Turn:
    """One datagram sent: what was wanted, the one before it, and the statuses accepted by then."""

    wanted: Motion
    before: Command
    command: Command
    heard: tuple[Heard, ...]
    """Since the one before."""
    last: Heard

    @property
    def rises(self) -> list[str]:
        return [n for n in ("abort", "slew") if getattr(self.command, n) and not getattr(self.before, n)]


def played(steps: list[Motion | Heard | str]) -> Iterator[Turn]:
    client = Client()
    last = Heard(ack_slew=False, ack_abort=False, slewing=False, step=1)
    wanted: Motion = Hold()
    before = client.send()
    heard: list[Heard] = []
    for step in steps:
        if isinstance(step, Heard):
            fields = {"ack_slew": step.ack_slew, "ack_abort": step.ack_abort, "slewing": step.slewing}
            if client.hear(counter=client.counter + step.step, **fields):
                last = step
                heard.append(step)
            continue
        if not isinstance(step, str):
            wanted = step
            want(client.session, wanted)
        command = client.send()
        yield Turn(wanted, before, command, tuple(heard), last)
        before = command
        heard.clear()


class TestAnySequence:
    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_counters_and_flags_that_are_none_of_ours(self, steps: list[Motion | Heard | str]) -> None:
        for turn in played(steps):
            assert turn.command.counter == turn.before.counter + 1
            assert unused_flags(turn.command) == []

    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_no_flag_is_up_beside_an_abort_or_a_slew(self, steps: list[Motion | Heard | str]) -> None:
        for turn in played(steps):
            if turn.command.abort:
                assert moving_flags(turn.command) == []
            if turn.command.slew:
                assert moving_flags(turn.command) == ["slew"]

    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_no_slew_rises_while_its_acknowledgement_stands(self, steps: list[Motion | Heard | str]) -> None:
        for turn in played(steps):
            assert not ("slew" in turn.rises and turn.last.ack_slew)

    @pytest.mark.parametrize("heard", [True, False])
    def test_a_stop_goes_out_at_once_whatever_acknowledgement_stands(self, heard: bool) -> None:
        """A stop is one call away from every state; another sender may have caused an acknowledgement."""
        client = Client()
        for _ in range(5):
            client.hear(ack_abort=True)
            client.send()
        assert client.asks(Stop()).abort or client.send().abort
        client.asks(MOVE)
        for _ in range(3):
            if heard:
                client.hear(ack_abort=True, slewing=True)
            client.send()
        assert client.asks(Stop()).abort or client.send().abort

    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_no_slew_is_begun_while_the_mount_reports_slewing(
        self, steps: list[Motion | Heard | str]
    ) -> None:
        for turn in played(steps):
            assert not ("slew" in turn.rises and turn.last.slewing)

    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_an_abort_falls_only_on_its_acknowledgement(self, steps: list[Motion | Heard | str]) -> None:
        """Where one stands already it tells nothing: the abort then stays up for four datagrams at least."""
        untold = 0
        for turn in played(steps):
            if turn.before.abort and not turn.command.abort:
                assert any(heard.ack_abort for heard in turn.heard) or untold >= 4
            untold = untold + 1 if turn.command.abort and turn.last.ack_abort else 0

    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_nothing_moves_beside_a_wanted_stop_or_hold(self, steps: list[Motion | Heard | str]) -> None:
        for turn in played(steps):
            if isinstance(turn.wanted, Stop):
                assert moving_flags(turn.command) == []
            if isinstance(turn.wanted, Hold):
                assert not turn.command.move_ra
                assert not turn.command.move_dec

    @given(steps=STEPS)
    @settings(max_examples=100, deadline=None)
    def test_a_stop_is_in_the_next_datagram_from_every_state(self, steps: list[Motion | Heard | str]) -> None:
        """But for the one that follows an abort whose acknowledgement still stands: it may not rise yet."""
        wanted_before: Motion = Hold()
        for turn in played(steps):
            newly = isinstance(turn.wanted, Stop) and not isinstance(wanted_before, Stop)
            if newly and not turn.last.ack_abort:
                assert turn.command.abort
            wanted_before = turn.wanted

    @given(steps=STEPS)
    @settings(max_examples=60, deadline=None)
    def test_the_same_inputs_give_the_same_bytes(self, steps: list[Motion | Heard | str]) -> None:
        clients = (Client(), Client())
        for step in steps:
            sent = []
            for client in clients:
                if isinstance(step, Heard):
                    client.hear(ack_slew=step.ack_slew, ack_abort=step.ack_abort, slewing=step.slewing)
                elif not isinstance(step, str):
                    want(client.session, step)
                sent.append(client.session.compose())
            assert sent[0] == sent[1]


VALID = encode_status(msgspec.structs.replace(TRACKING, counter=500))


class TestNoise:
    @given(noise=st.lists(spoilt(VALID), min_size=1, max_size=8))
    @settings(max_examples=100, deadline=None)
    def test_what_is_no_status_is_counted_and_changes_nothing(self, noise: list[bytes]) -> None:
        client = Client()
        client.hear()
        client.asks(A)
        session = client.session
        before = (session.sample, session.status, session.slew_state, session.stopped)
        for data in noise:
            assert session.receive(data, client.now + 0.01) is None
        assert session.health.rejected == len(noise)
        assert (session.sample, session.status, session.slew_state, session.stopped) == before
        assert session.link_state(client.now + 0.305) is LinkState.STALE
        assert client.send().slew

    @given(
        datagrams=st.lists(overwritten(VALID), min_size=1, max_size=8),
        motion=st.sampled_from((Hold(), A, MOVE, Stop())),
    )
    @settings(max_examples=100, deadline=None)
    def test_any_body_is_taken_or_counted(self, datagrams: list[bytes], motion: Motion) -> None:
        client = Client()
        session = client.session
        want(session, motion)
        taken = 0
        for data in datagrams:
            sample = session.receive(data, client.now)
            if sample is not None:
                taken += 1
                assert 0.0 <= sample.ra_deg <= 360.0
                assert -90.0 <= sample.dec_deg <= 90.0
                assert math.isfinite(sample.sidereal_h)
            assert isinstance(session.slew_state, SlewState)
            assert isinstance(session.stopped, bool)
            command = client.send()
            assert unused_flags(command) == []
            if isinstance(motion, (Hold, Stop)):
                assert moving_flags(command) == []
        health = session.health
        counted = health.late + health.duplicate + health.rejected + health.frozen
        assert taken + counted == len(datagrams)

    @given(raw=st.binary(min_size=8, max_size=8), offset=st.sampled_from((32, 48, 104, 112, 120)))
    @settings(max_examples=100, deadline=None)
    def test_any_bits_in_the_fields_of_two_types(self, raw: bytes, offset: int) -> None:
        client = Client()
        client.hear()
        data = VALID[:offset] + raw + VALID[offset + 8 :]
        sample = client.session.receive(data, client.now)
        health = client.session.health
        assert (sample is not None) + health.late + health.duplicate + health.rejected == 1

    @pytest.mark.parametrize("wire", ["nan", "inf", "-inf", "1e300"])
    def test_a_counter_that_is_no_counter_is_refused_or_survived(self, client: Client, wire: str) -> None:
        data = VALID[:104] + struct.pack("<d", float(wire)) + VALID[112:]
        client.session.receive(data, client.now)
        taken = [client.hear() is not None for _ in range(5)]
        assert taken[-1]


class TestStates:
    """The tables of states, without a session."""

    @pytest.mark.parametrize(
        ("table", "start"),
        [
            (HANDSHAKE, Handshake.IDLE),
            (SLEW, SlewState.NONE),
            (STOP, StopState.ASKED),
            (HELD, HeldState.OVER),
            (LINK, LinkState.SILENT),
        ],
    )
    def test_every_state_is_reached_and_left(self, table: Mapping[Any, Any], start: Enum) -> None:
        events = {event for _, event in table}
        reached = {start}
        while more := {follow(table, state, event) for state in reached for event in events} - reached:
            reached |= more
        assert reached == set(type(start))
        assert all(any(follow(table, state, event) is not state for event in events) for state in reached)

    def test_an_event_without_a_row_changes_nothing(self) -> None:
        assert follow(HANDSHAKE, Handshake.RELEASING, "request") is Handshake.RELEASING
        assert follow(SLEW, SlewState.WAITING, "acknowledged") is SlewState.WAITING
        assert follow(LINK, LinkState.SILENT, LONG_QUIET) is LinkState.SILENT


class TestAltAzimuth:
    """An alt-azimuth mount in the plane of the meridian and due west: textbook rates of azimuth and altitude.

    With the sky turning by w: on the southern meridian azimuth grows by w cos(dec)/cos(altitude), altitude by
    nothing; due west altitude falls by w cos(latitude).
    """

    LATITUDE_DEG = 48.0

    def client(self, reports: Literal["sky", "horizon", "axes"] = "sky", **changes: Any) -> Client:
        geometry = AxisGeometry(0.0, 90.0, reports=reports)
        stands_at = SitePlace(self.LATITUDE_DEG, 11.0)
        return Client(MountProfile(geometry=geometry, stands_at=stands_at, **changes))

    @staticmethod
    def at(client: Client, hour_angle_deg: float, dec_deg: float, **fields: Any) -> None:
        """Have the mount report a direction; its clock says 9 h and a little."""
        client.now += PERIOD_S
        sidereal_h = 9.0 + (client.now - T0) / 3600.0
        ra_h = (sidereal_h - hour_angle_deg / 15.0) % 24.0
        told = client.status(sidereal_h=sidereal_h, ra_h=ra_h, dec_deg=dec_deg, **fields)
        assert client.session.receive(told, client.now) is not None

    @pytest.mark.parametrize(
        ("gains", "signs"), [((1.0, 1.0), (1, 1)), ((0.5, 2.0), (-1, 1)), ((1.0, 4.0), (1, -1))]
    )
    def test_what_it_is_sent_adds_to_its_tracking_of_the_sky(
        self, gains: tuple[float, float], signs: tuple[Literal[-1, 1], Literal[-1, 1]]
    ) -> None:
        client = self.client(
            ra_rate_gain=gains[0], dec_rate_gain=gains[1], ra_rate_sign=signs[0], dec_rate_sign=signs[1]
        )
        # The first axis is to turn by 0.5°/s, the second by 0.25°/s.
        asked = MoveAxes(SIDEREAL_DEG_S - 0.5, 0.25)
        unheard = client.asks(asked)
        assert unheard.move_ra_rate_deg_s == pytest.approx(
            signs[0] * (0.5 - SIDEREAL_DEG_S) / gains[0], abs=1e-8
        )
        assert unheard.move_dec_rate_deg_s == pytest.approx(signs[1] * 0.25 / gains[1], abs=1e-8)
        self.at(client, 0.0, 20.0)
        south = client.asks(asked)
        azimuth_rate = SIDEREAL_DEG_S * math.cos(math.radians(20.0)) / math.cos(math.radians(62.0))
        assert south.move_ra_rate_deg_s == pytest.approx(signs[0] * (0.5 - azimuth_rate) / gains[0], abs=1e-7)
        assert south.move_dec_rate_deg_s == pytest.approx(signs[1] * 0.25 / gains[1], abs=1e-7)
        # Due west: sin(altitude) = sin(dec)/sin(latitude), and cos(hour angle) = tan(dec)/tan(latitude).
        hour_angle = math.degrees(math.acos(math.tan(math.radians(20.0)) / math.tan(math.radians(48.0))))
        self.at(client, hour_angle, 20.0)
        west = client.asks(asked)
        falls = SIDEREAL_DEG_S * math.cos(math.radians(48.0))
        assert west.move_dec_rate_deg_s == pytest.approx(signs[1] * (0.25 + falls) / gains[1], abs=1e-7)

    @pytest.mark.parametrize(("reports", "additive"), [("axes", True), ("sky", False)])
    def test_one_whose_axes_are_given_or_whose_rates_are_absolute_needs_no_frame(
        self, reports: Literal["sky", "axes"], additive: bool
    ) -> None:
        client = self.client(reports, additive=additive)
        self.at(client, 0.0, 20.0)
        sent = client.asks(MoveAxes(0.3, 0.2))
        turn = -0.3 + (0.0 if additive else SIDEREAL_DEG_S)
        assert sent.move_ra_rate_deg_s == pytest.approx(turn, abs=1e-8)
        assert sent.move_dec_rate_deg_s == pytest.approx(0.2, abs=1e-8)

    def test_where_it_points_is_taken_from_azimuth_and_altitude(self) -> None:
        client = self.client("horizon")
        # On the southern meridian the declination is latitude + altitude - 90°, the hour angle 0.
        self.at(client, 77.0, 5.0, azimuth_deg=180.0, altitude_deg=62.0)
        assert client.session.sample is not None
        assert client.session.sample.dec_deg == pytest.approx(20.0)
        assert math.remainder(
            client.session.sample.ra_deg - client.session.sample.sidereal_h * 15.0, 360.0
        ) == (pytest.approx(0.0, abs=1e-9))
        assert client.session.stance is not None
        # Of the axes: azimuth from the south, and altitude.
        assert client.session.stance.dec_deg == pytest.approx(62.0)

    def test_due_west_the_hour_angle_is_that_of_the_textbook(self) -> None:
        """sin(dec) = sin(latitude) sin(altitude), and sin(hour angle) = cos(altitude)/cos(dec)."""
        client = self.client("horizon")
        self.at(client, 77.0, 5.0, azimuth_deg=270.0, altitude_deg=40.0)
        sample = client.session.sample
        assert sample is not None
        sin_dec = math.sin(math.radians(48.0)) * math.sin(math.radians(40.0))
        assert sample.dec_deg == pytest.approx(math.degrees(math.asin(sin_dec)))
        hour_angle = math.asin(math.cos(math.radians(40.0)) / math.sqrt(1.0 - sin_dec**2))
        gone_deg = math.remainder(sample.sidereal_h * 15.0 - sample.ra_deg, 360.0)
        assert gone_deg == pytest.approx(math.degrees(hour_angle))

    def test_below_the_pole_right_ascension_stays_within_a_day(self) -> None:
        """tan(hour angle) = -sin(A) cos(a) / (sin(a) cos(latitude) - cos(a) sin(latitude) cos(A))."""
        client = self.client("horizon")
        self.at(client, 77.0, 5.0, azimuth_deg=350.0, altitude_deg=10.0)
        sample = client.session.sample
        assert sample is not None
        az, alt, lat = (math.radians(angle) for angle in (350.0, 10.0, 48.0))
        hour_angle_deg = math.degrees(
            math.atan2(
                -math.sin(az) * math.cos(alt),
                math.sin(alt) * math.cos(lat) - math.cos(alt) * math.sin(lat) * math.cos(az),
            )
        )
        assert 135.0 < hour_angle_deg < 180.0
        assert sample.ra_deg == pytest.approx((sample.sidereal_h * 15.0 - hour_angle_deg) % 360.0)

    @pytest.mark.parametrize(
        ("azimuth_deg", "altitude_deg", "taken"),
        [
            (180.0, 90.0, True),
            (180.0, -90.0, True),
            (180.0, 90.01, False),
            (180.0, math.nan, False),
            (math.nan, 62.0, False),
            (math.inf, 62.0, False),
        ],
    )
    def test_without_an_azimuth_and_an_altitude_it_points_nowhere(
        self, azimuth_deg: float, altitude_deg: float, taken: bool
    ) -> None:
        client = self.client("horizon")
        client.now += PERIOD_S
        told = client.status(azimuth_deg=azimuth_deg, altitude_deg=altitude_deg)
        assert (client.session.receive(told, client.now) is not None) is taken
        assert client.session.health.rejected == (not taken)


class TestWhatItTells:
    @pytest.mark.parametrize("another", [False, True])
    def test_stopped_is_told_by_positions_that_are_newer_than_the_acknowledgement(
        self, another: bool
    ) -> None:
        """Even of a mount that had been at rest before; and where the abort was another client's."""
        client = tracked(MountProfile())
        for _ in range(5):
            client.hear(ack_abort=another)
        client.asks(Stop())
        told = []
        for _ in range(14):
            client.hear(ack_abort=True)
            client.send()
            told.append(client.session.stopped)
        assert told[:11] == [False] * 11
        assert told[-1]

    def test_an_acknowledgement_of_what_was_never_sent_is_counted_and_one_of_ours_is_not(self) -> None:
        client = tracked(MountProfile())
        client.asks(A)
        client.hear(ack_slew=True, slewing=True)
        assert client.session.health.foreign_acks == 0
        client.hear(ack_slew=True, ack_sync=True, slewing=True)
        assert client.session.health.foreign_acks == 1
        for counter in (1, 2, 3):
            client.hear(counter=counter, ack_sync=True)
        # Of a mount that has begun anew it is another one.
        assert client.session.health.foreign_acks == 2

    def test_a_mount_that_restarts_is_sent_the_stop_again(self, client: Client) -> None:
        client.stopped_by_abort()
        assert not client.send().abort
        for counter in (1, 2, 3):
            client.hear(counter=counter, ra_rate_dtics_s=0)
        assert not client.session.stopped
        assert client.send().abort

    def test_an_abort_leaves_an_edge_mount_nothing_to_end_or_to_take_up_again(self) -> None:
        acks = {"ack_move_ra": True, "ack_move_dec": True}
        for answered in (False, True):
            client = tracked(MountProfile(move_axis="edge"))
            client.asks(MOVE)
            if answered:
                client.hear(slewing=True, **acks)
                client.send()
            client.stopped_by_abort()
            want(client.session, Hold())
            for _ in range(5):
                assert moving_flags(client.send()) == []
                client.hear(ra_rate_dtics_s=0)
            sent = client.asks(MoveAxes(0.5, 0.25))
            assert (sent.move_ra_rate_deg_s, sent.move_dec_rate_deg_s) == pytest.approx((-0.5, 0.25))
            assert client.session.begun_move == MoveAxes(0.5, 0.25)

    @pytest.mark.parametrize("moves", [MoveAxis(0.5, None), MoveAxis(None, 0.5)])
    def test_an_edge_mount_is_told_the_end_on_the_axis_that_moves(self, moves: MoveAxis) -> None:
        client = tracked(MountProfile(move_axis="edge"))
        client.session.submit(ClearedRequest(moves))
        (flag,) = moving_flags(client.send())
        client.hear(slewing=True, **{f"ack_{flag}": True})
        client.send()
        client.hear(slewing=True)
        sent = client.asks(Hold())
        assert moving_flags(sent) == [flag]
        assert (sent.move_ra_rate_deg_s, sent.move_dec_rate_deg_s) == (0.0, 0.0)

    def test_of_a_mount_that_is_taken_over_positions_that_repeat_show_rest_late(self) -> None:
        seen = []
        for taken in (False, True):
            client = Client()
            if taken:
                client.session.taken_over()
            while not client.session.at_rest:
                client.hear(ra_rate_dtics_s=0)
            seen.append(client.counter * PERIOD_S)
        assert seen[0] < 0.7
        assert 2.0 < seen[1] < 2.2

    def test_before_anything_was_heard(self) -> None:
        session = Session(MountProfile())
        assert (session.stance, session.sample, session.status) == (None, None, None)
        assert (session.stopped, session.at_rest, session.busy, session.move_over) == (
            False,
            False,
            False,
            True,
        )
        assert (session.wanted, session.slew_state) == (Hold(), SlewState.NONE)
        assert (session.rates_wait_s, session.fine_rate, session.begun_move) == (0.0, FineRate(), None)
        assert (session.ignored_fields, session.intruder) == ((), None)

    def test_the_types_of_doubtful_fields_as_far_as_they_have_shown(self, client: Client) -> None:
        assert client.session.readings.ra_rate_dtics_s == "int64"
        assert client.session.readings.dec_rate_dtics_s is None
        doubles = Readings("double", "double", "double", "double", "double")
        for _ in range(20):
            client.hear(readings=doubles, dec_rate_dtics_s=7.0)
        assert client.session.readings.dec_rate_dtics_s == client.session.readings.counter == "double"
        for _ in range(20):
            client.hear(readings=Readings("int64", "int64", "int64", "int64", "int64"))
        # A rate of 0 tells nothing of its type: what was seen before stays.
        assert client.session.readings.dec_rate_dtics_s == "double"
        assert client.session.readings.counter == "int64"

    def test_numbers_that_decide_nothing_and_are_none_become_none(self, client: Client) -> None:
        assert client.hear(altitude_deg=math.nan, site_height_m=math.inf) is not None
        status = client.session.status
        assert status is not None
        assert (status.altitude_deg, status.site_height_m) == (None, None)
        assert (status.azimuth_deg, status.site_latitude_deg) == (180.0, 48.0)

    def test_a_mount_in_motion_that_says_the_same_again_is_not_heard(self, client: Client) -> None:
        said = {"sidereal_h": 9.5, "ra_h": 10.5, "dec_deg": 20.0}
        assert client.hear(**said) is not None
        assert client.hear(**said) is not None
        want(client.session, MOVE)
        assert client.hear(**said) is None
        assert client.session.health.frozen == 1
        want(client.session, Hold())
        # Once frozen it takes another clock or place to be heard, moving or not.
        assert client.hear(**said) is None
        for name, value in list(said.items()):
            said[name] = value + 0.01
            assert client.hear(**said) is not None
        assert client.hear(**said) is not None
        assert client.session.health.frozen == 2

    def test_a_move_is_told_with_the_datagram_that_begins_it(self) -> None:
        held, edge = tracked(MountProfile()), tracked(MountProfile(move_axis="edge"))
        for client, begins in ((held, [MOVE] * 3), (edge, [MOVE, None, None])):
            want(client.session, MOVE)
            told = []
            for _ in range(3):
                client.send()
                told.append(client.session.begun_move)
            assert told == begins
            want(client.session, Hold())
            client.send()
        assert held.session.begun_move is None

    def test_rates_that_wait_for_an_edge_mount_are_counted_in_seconds(self) -> None:
        client = tracked(MountProfile(move_axis="edge"))
        client.asks(MOVE)
        client.asks(MoveAxes(0.5, 0.5))
        client.send()
        assert client.session.rates_wait_s == pytest.approx(2 * PERIOD_S)

    def test_a_handshake_that_an_edge_mount_leaves_unanswered_tells_how_long_the_next_ones_last(self) -> None:
        client = tracked(MountProfile(move_axis="edge"))
        client.asks(MOVE)
        # Before its first answer it is taken for one that gives none.
        takes_s = client.session.unanswered_s
        for _ in range(21):
            client.hear()
        assert client.session.unanswered_s == takes_s
        sent = [client.asks(MoveAxes(0.5, 0.5)).move_ra]
        while not sent[-1]:
            client.hear()
            sent.append(client.send().move_ra)
        # From the edge on: 21 statuses without an answer, and those until the flags may rise again.
        assert 21 + len(sent) == round(client.session.unanswered_s / PERIOD_S)
        # One that restarts answers no better than before; it is known to by an answer.
        for counter in (1, 2, 3):
            client.hear(counter=counter)
        assert client.session.health.restarts == 1
        assert client.session.unanswered_s > 0.0
        client.asks(MoveAxes(0.4, 0.4))
        client.hear(ack_move_ra=True, ack_move_dec=True)
        assert client.session.unanswered_s == 0.0

    def test_a_mount_that_answers_no_edge_is_not_waited_for_for_long_even_after_a_restart(self) -> None:
        client = tracked(MountProfile(move_axis="edge"))
        client.asks(MOVE)
        first_s = client.session.unanswered_s
        for _ in range(70):
            client.hear()
            client.send()
        mute_s = client.session.unanswered_s
        assert 0.0 < mute_s < 0.5 * first_s
        for counter in (1, 2, 3):
            client.hear(counter=counter)
        assert client.session.health.restarts == 1
        assert client.session.unanswered_s == mute_s

    @pytest.mark.parametrize(
        "loss", [0.1, 0.5, *(pytest.param(loss, marks=pytest.mark.soak) for loss in (0.02, 0.3))]
    )
    def test_an_unanswered_handshake_may_last_as_long_as_lost_statuses_make_it(self, loss: float) -> None:
        client, dice = tracked(MountProfile(move_axis="edge")), random.Random(7)
        statuses = round(client.session.unanswered_s / PERIOD_S)
        for counter in range(100, 4100):
            if dice.random() >= loss:
                client.hear(counter=counter)
        may_last = client.session.unanswered_s / PERIOD_S
        lasted = []
        for _ in range(3000):
            heard = periods = 0
            while heard < statuses:
                periods += 1
                heard += dice.random() >= loss
            lasted.append(periods)
        assert sum(periods <= may_last for periods in lasted) / len(lasted) > 0.99
        assert may_last < 1.1 * max(lasted)

    def test_an_edge_mount_with_absolute_rates_is_never_sent_0_to_stand(self) -> None:
        """A rate of 0 would end MoveAxis; one that adds to its tracking stands by what cancels it."""
        for how, additive, rate in (("held", False, 0.0), ("edge", False, 1e-9), ("held", True, 0.0)):
            client = tracked(MountProfile(move_axis=how, additive=additive))  # type: ignore[arg-type]
            sent = client.asks(MoveAxes(0.0 if additive else SIDEREAL_RATE_DEG_S, 0.0))
            assert (sent.move_ra, sent.move_ra_rate_deg_s) == (True, rate)
        ended = tracked(MountProfile(move_axis="edge", additive=True))
        assert ended.asks(MoveAxes(0.0, 0.5)).move_ra_rate_deg_s == 0.0

    @pytest.mark.parametrize("ra_rate_deg_s", [SIDEREAL_RATE_DEG_S, SIDEREAL_RATE_DEG_S - 1e-12])
    def test_a_telescope_behind_a_gateway_is_never_sent_0_to_stand(self, ra_rate_deg_s: float) -> None:
        """A MoveAxis of 0 would give its tracking back. One that adds to tracking is sent it to track."""
        client = tracked(MountProfile(additive=False, dated_by_requests=True))
        sent = client.asks(MoveAxes(ra_rate_deg_s, 0.0))
        assert (sent.move_ra, sent.move_dec_rate_deg_s) == (True, 0.0)
        assert 0.0 < abs(sent.move_ra_rate_deg_s) * 86400.0 < 0.1
        adds = tracked(MountProfile(additive=True, dated_by_requests=True))
        assert adds.asks(MoveAxes(0.0, 0.5)).move_ra_rate_deg_s == 0.0

    @pytest.mark.parametrize("moves", [MoveAxis(0.5, None), MoveAxis(None, 0.5)])
    def test_moveaxis_of_one_axis_uses_its_flag_until_the_other_joins(self, moves: MoveAxis) -> None:
        client = tracked(MountProfile())
        first = client.session.submit(ClearedRequest(moves))
        command = client.send()
        ra = moves.ra_rate_deg_s is not None
        assert (command.move_ra, command.move_dec) == (ra, not ra)
        assert client.session.wanted == (MoveAxes(0.5, 0.0) if ra else MoveAxes(0.0, 0.5))
        client.hear(ack_move_ra=ra, ack_move_dec=not ra, slewing=True)
        assert first.state is TicketState.COMPLETE
        other = MoveAxis(None, 0.25) if ra else MoveAxis(0.25, None)
        second = client.session.submit(ClearedRequest(other))
        command = client.send()
        assert (command.move_ra, command.move_dec) == (True, True)
        rates = (0.5, 0.25) if ra else (0.25, 0.5)
        assert command.move_ra_rate_deg_s == pytest.approx(-rates[0])
        assert command.move_dec_rate_deg_s == pytest.approx(rates[1])
        client.hear(ack_move_ra=ra, ack_move_dec=not ra, slewing=True)
        client.send()
        assert second.state is TicketState.RAISED
        client.hear(ack_move_ra=True, ack_move_dec=True, slewing=True)
        assert second.state is TicketState.COMPLETE

    def test_fine_rates_end_with_an_abort_and_stay_through_a_move(self) -> None:
        client = tracked(MountProfile())
        client.session.submit(ClearedRequest(FineRate(1e-3, -2e-3)))
        sent = client.send()
        # 2^26 tics a turn, tenths of a tic a second.
        dtics_s = (round(1e-3 / TIC_DEG * 10), round(-2e-3 / TIC_DEG * 10))
        assert (sent.ra_fine_rate_dtics_s, sent.dec_fine_rate_dtics_s) == dtics_s
        sent = client.asks(MOVE)
        assert (sent.ra_fine_rate_dtics_s, sent.dec_fine_rate_dtics_s) == dtics_s
        client.session.submit(ClearedRequest(Abort()))
        sent = client.send()
        assert (sent.ra_fine_rate_dtics_s, sent.dec_fine_rate_dtics_s) == (0, 0)

    def test_other_fine_rates_take_the_place_of_those_that_are_only_looked_at(self) -> None:
        client = tracked(MountProfile())
        first = client.session.submit(ClearedRequest(FineRate(1e-3, 0.0)))
        client.send()
        second = client.session.submit(ClearedRequest(FineRate(0.0, 1e-3)))
        assert (first.state, first.reason) == (TicketState.SUPERSEDED, "other fine rates were asked for")
        sent = client.send()
        assert (sent.ra_fine_rate_dtics_s, sent.dec_fine_rate_dtics_s) == (0, dtics(1e-3))
        assert second.state is TicketState.RAISED
        # A sync waits, and does not take the place of anything.
        client.session.submit(ClearedRequest(Sync(150.0, 20.0)))
        assert second.state is TicketState.RAISED

    @pytest.mark.parametrize(
        ("ra_share", "dec_share", "shows"),
        [(1.0, 1.0, True), (0.81, 1.19, True), (0.79, 1.0, False), (1.0, 1.21, False), (0.0, 0.0, False)],
    )
    def test_fine_rates_show_where_both_drives_come_within_a_fifth_of_the_change(
        self, ra_share: float, dec_share: float, shows: bool
    ) -> None:
        client = tracked(MountProfile())
        ticket = client.session.submit(ClearedRequest(FineRate(0.01, -0.02)))
        client.send()
        ra, dec = SIDEREAL_DEG_S + ra_share * 0.01, -dec_share * 0.02
        client.hear(ra_rate_dtics_s=dtics(ra), dec_rate_dtics_s=dtics(dec))
        assert (ticket.state is TicketState.COMPLETE) is shows

    @pytest.mark.parametrize(
        ("asked_dtics_s", "off_dtics_s", "shows"),
        [
            # A change of at most two tics a second may be noise.
            ((19, 0), (0, 0), False),
            ((21, 0), (0, 0), True),
            ((0, -19), (0, 0), False),
            ((0, -21), (0, 0), True),
            # A fifth of a change, and two tenths of a tic where there is none.
            ((100, 0), (19, 1), True),
            ((100, 0), (22, 0), False),
            ((100, 0), (0, 3), False),
        ],
    )
    def test_fine_rates_show_by_a_change_of_the_drives(
        self, asked_dtics_s: tuple[int, int], off_dtics_s: tuple[int, int], shows: bool
    ) -> None:
        client = tracked(MountProfile())
        asked = FineRate(*(number / 10 * TIC_DEG for number in asked_dtics_s))
        ticket = client.session.submit(ClearedRequest(asked))
        client.send()
        ra, dec = (a + b for a, b in zip(asked_dtics_s, off_dtics_s, strict=True))
        client.hear(ra_rate_dtics_s=SIDEREAL_DTICS_S + ra, dec_rate_dtics_s=dec)
        assert (ticket.state is TicketState.COMPLETE) is shows

    def test_the_end_of_a_move_under_fine_rates_needs_no_rest(self) -> None:
        client = tracked(MountProfile())
        client.session.submit(ClearedRequest(FineRate(0.0, 0.01)))
        client.send()
        ticket = client.session.submit(ClearedRequest(EndMove()))
        client.send()
        client.hear(dec_rate_dtics_s=dtics(0.01), slewing=True)
        assert ticket.state is TicketState.RAISED
        client.hear(dec_rate_dtics_s=dtics(0.01))
        assert ticket.state is TicketState.COMPLETE

    @pytest.mark.parametrize(
        ("before", "now", "shows"),
        [
            ({}, {"at_home": True}, True),
            ({}, {"at_home": True, "slewing": True}, False),
            ({"at_home": True}, {"at_home": True}, False),
            ({}, {"at_park": True}, False),
        ],
    )
    def test_home_shows_where_the_mount_says_so_anew_and_does_not_slew(
        self, before: dict[str, bool], now: dict[str, bool], shows: bool
    ) -> None:
        client = tracked(MountProfile())
        client.hear(**before)
        ticket = client.session.submit(ClearedRequest(FindHome()))
        assert client.send().find_home
        client.hear(**now)
        assert (ticket.state is TicketState.COMPLETE) is shows

    @pytest.mark.parametrize("before", [False, True])
    def test_a_park_shows_where_the_mount_says_so_anew(self, before: bool) -> None:
        client = Client(MountProfile(park=AxesPosition(-15.0, 20.0)))
        client.stopped_by_abort()
        want(client.session, Hold())
        client.hear(ra_rate_dtics_s=0, at_park=before)
        ticket = client.session.submit(ClearedRequest(Park()))
        while not client.send().park:
            client.hear(ra_rate_dtics_s=0, at_park=before)
        client.hear(ra_rate_dtics_s=0, at_park=True)
        assert (ticket.state is TicketState.COMPLETE) is not before

    @pytest.mark.parametrize(
        ("motion", "acks", "ignored"),
        [
            (Hold(), {}, True),
            (Hold(), {"ack_move_ra": True}, False),
            (Hold(), {"ack_move_dec": True}, False),
            (MOVE, {}, False),
        ],
    )
    def test_slewing_that_stays_true_at_rest_means_something_in_a_moveaxis(
        self, motion: Motion, acks: dict[str, bool], ignored: bool
    ) -> None:
        """The paper: "Slewing will be true during a MoveAxis command", at any rate."""
        client = Client()
        want(client.session, motion)
        for _ in range(75):
            client.send()
            client.hear(slewing=True, **acks)
        reason = "the mount's Slewing stays true while positions stand: positions are used instead"
        assert client.session.ignored_fields == ((reason,) if ignored else ())

    def test_a_tracking_rate_shows_where_the_mount_goes_over_to_it(self) -> None:
        for before, now, shows in ((0, 2, True), (0, 1, False), (2, 2, False)):
            client = tracked(MountProfile())
            client.hear(tracking_rate=before)
            ticket = client.session.submit(ClearedRequest(TrackingRate(2)))
            assert client.send().tracking_rate == 2
            client.hear(tracking_rate=now)
            assert (ticket.state is TicketState.COMPLETE) is shows

    def test_rates_go_on_under_a_ticket_and_another_motion_takes_its_place(self) -> None:
        client = tracked(MountProfile())
        ticket = client.session.submit(ClearedRequest(MoveAxis(0.5, 0.5)))
        client.send()
        want(client.session, MoveAxes(0.6, 0.6))
        assert ticket.state is TicketState.RAISED
        want(client.session, Hold())
        assert (ticket.state, ticket.reason) == (TicketState.SUPERSEDED, "another motion was asked for")

    def test_a_slew_to_the_same_place_is_one_all_the_same(self) -> None:
        client = tracked(MountProfile())
        for _ in range(2):
            client.session.submit(ClearedRequest(A))
            sent = [client.send() for _ in range(6)]
            assert sent[-1].slew
            client.hear(ack_slew=True, slewing=True)
            client.send()
            client.hear(slewing=False)

    @pytest.mark.parametrize("off_deg", [0.24, 0.26])
    def test_a_slew_is_complete_within_a_quarter_of_a_degree_of_its_target(self, off_deg: float) -> None:
        client = tracked(MountProfile())
        ticket = client.session.submit(ClearedRequest(A))
        client.send()
        client.hear(ack_slew=True, slewing=True)
        client.send()
        there = {"ra_h": A.ra_deg / 15.0, "dec_deg": A.dec_deg + off_deg}
        for _ in range(40):
            client.hear(**there)
            client.send()
        assert ticket.state is (TicketState.COMPLETE if off_deg < 0.25 else TicketState.FAILED)
        assert ticket.reason == (
            None if off_deg < 0.25 else f"the slew ended {off_deg:.2f}° away from its target"
        )

    def test_a_mount_that_restarts_has_lost_what_was_under_way(self) -> None:
        client = tracked(MountProfile())
        sync = client.session.submit(ClearedRequest(Sync(150.0, 20.0)))
        client.send()
        for counter in (1, 2, 3):
            client.hear(counter=counter)
        assert (sync.state, sync.reason) == (TicketState.FAILED, "the mount restarted meanwhile")
        slew = client.session.submit(ClearedRequest(A))
        while not client.send().slew:
            client.hear()
        for counter in (1, 2, 3):
            client.hear(counter=counter)
        assert (slew.state, slew.reason) == (TicketState.FAILED, "the mount restarted meanwhile")
        assert client.session.wanted == Hold()


def tracked(profile: MountProfile) -> Client:
    """A client that has heard the mount track the sky until its rest is seen."""
    client = Client(profile)
    for _ in range(15):
        client.hear()
        client.send()
    return client

"""Every request of a client against a mount written from the paper: flags, acknowledgements, ends, refusals.

Source: Van Deventer, "Xerxes Mount Control Protocol". A slew's six steps, the stale "not slewing" and the
rising edge: "Details". Ranges, units and signs: the text under the command table. Which commands have an
acknowledgement: the status table.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import pytest
from paper_link import ONE_SHOTS, Bench
from paper_mount import LOOP_S, PaperMount
from paper_packing import DOUBTFUL

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxesPosition, Cleared, Hold, MountProfile, Slew
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
    TicketState,
    TrackingRate,
)

if TYPE_CHECKING:
    from paper_packing import CommandRow

How = Literal["held", "edge"]
HELD_AND_EDGE = pytest.mark.parametrize("how", ["held", "edge"])
PARK = AxesPosition(hour_angle_deg=-30.0, dec_deg=20.0)
"""Where the stand-in mount wakes up: sidereal time 120°, right ascension 150°, declination 20°."""
SLEW = Slew(200.0, 30.0)
SYNC = Sync(150.5, 20.25)
PULSE = PulseGuide(1500, -300)
BOTH = MoveAxis(-1.5, 0.75)
ACKNOWLEDGED: list[tuple[Request, str]] = [
    (SLEW, "SlewToTargetCmd"),
    (SYNC, "SyncToTargetCmd"),
    (PULSE, "PulseGuideCmd"),
    (Abort(), "AbortSlewCmd"),
]
"""One-shot commands for which the status table has an acknowledgement, and their flags."""
FLAGLESS: list[Request] = [FineRate(1e-3, -1e-3), TrackingRate(1)]
UNACKNOWLEDGED: list[tuple[Request, str]] = [(FindHome(), "FindHomeCmd"), (Park(), "ParkCmd")]
EVERY: list[Request] = [SLEW, SYNC, PULSE, Abort(), FindHome(), Park(), BOTH, EndMove(), *FLAGLESS]


def request_id(value: Any) -> str | None:
    return type(value).__name__ if not isinstance(value, str) else value


def awake(mount: PaperMount | None = None, **profile: Any) -> Bench:
    """A client and a mount that have heard each other for a second."""
    mount = mount or PaperMount()
    bench = Bench(mount, MountProfile(move_axis=mount.move_axis, park=PARK, **profile))
    bench.run(1.0)
    return bench


def flags_of(row: CommandRow) -> set[str]:
    return set(row.up())


class TestHandshake:
    @pytest.mark.parametrize("ack_after", [0, 1, 5, 15])
    @pytest.mark.parametrize(("request_", "flag"), ACKNOWLEDGED, ids=request_id)
    def test_the_flag_rises_once_is_held_until_the_acknowledgement_and_falls(
        self, request_: Request, flag: str, ack_after: int
    ) -> None:
        bench = awake(PaperMount(ack_after=ack_after))
        ticket = bench.submit(request_)
        assert bench.settle(ticket) is TicketState.COMPLETE
        bench.run(2.0)
        rises = [period for period, name in bench.rules.rises if name == flag]
        falls = [period for period, name in bench.rules.falls if name == flag]
        assert len(rises) == len(falls) == 1
        # Up in the first datagram, seen by the mount in the same turn, acknowledged `ack_after` turns later.
        assert falls[0] - rises[0] == ack_after + 1
        assert bench.rules.early_falls == []
        assert bench.rules.broken == []
        assert len(bench.mount.launches) == 1

    @pytest.mark.parametrize(("request_", "flag"), ACKNOWLEDGED, ids=request_id)
    def test_the_ticket_is_raised_then_acknowledged_then_complete(self, request_: Request, flag: str) -> None:
        bench = awake()
        ticket = bench.submit(request_)
        bench.settle(ticket)
        assert ticket.history == [
            TicketState.QUEUED,
            TicketState.RAISED,
            TicketState.ACKNOWLEDGED,
            TicketState.COMPLETE,
        ]

    @pytest.mark.parametrize(("request_", "flag"), ACKNOWLEDGED[:3], ids=request_id)
    def test_the_same_flag_rises_again_only_after_its_acknowledgement_fell(
        self, request_: Request, flag: str
    ) -> None:
        bench = awake(PaperMount(sticky=frozenset({flag})))
        bench.submit(request_)
        bench.run(12.0)
        assert flag in bench.mount.acks
        again = bench.submit(request_)
        bench.run(1.0)
        assert bench.rules.rose(flag) == 1
        bench.mount.sticky = frozenset()
        bench.mount.acks.clear()
        if not again.settled:
            assert bench.settle(again) is TicketState.COMPLETE
            assert bench.rules.rose(flag) == 2
        assert bench.rules.broken == []

    @pytest.mark.parametrize(("request_", "flag"), ACKNOWLEDGED, ids=request_id)
    def test_two_of_a_kind_are_two_launches(self, request_: Request, flag: str) -> None:
        bench = awake()
        for _ in range(2):
            assert bench.settle(bench.submit(request_)) is TicketState.COMPLETE
        assert bench.rules.rose(flag) == len(bench.mount.launches) == 2
        assert bench.rules.broken == []

    def test_a_burst_is_done_one_after_the_other_each_once(self) -> None:
        bench = awake()
        asked: list[Request] = [SYNC, PULSE, SYNC, FineRate(1e-3, 0.0), PULSE, FindHome(), SYNC]
        tickets = [bench.submit(request) for request in asked]
        for ticket in tickets:
            bench.settle(ticket)
        assert {ticket.state for ticket in tickets} <= {TicketState.COMPLETE, TicketState.UNCONFIRMED}
        launched = [launch.command for launch in bench.mount.launches]
        assert launched == [
            "SyncToTargetCmd",
            "PulseGuideCmd",
            "SyncToTargetCmd",
            "PulseGuideCmd",
            "FindHomeCmd",
            "SyncToTargetCmd",
        ]
        assert bench.mount.crowded == 0
        assert bench.rules.broken == []

    @HELD_AND_EDGE
    @pytest.mark.parametrize("request_", EVERY, ids=request_id)
    def test_every_request_settles_once_and_nothing_else_is_up(self, request_: Request, how: How) -> None:
        bench = awake(PaperMount(move_axis=how))
        ticket = bench.submit(request_)
        bench.settle(ticket)
        settled_as = list(ticket.history)
        bench.run(5.0)
        assert ticket.history == settled_as
        assert sum(state in _ENDS for state in ticket.history) == 1
        assert bench.rules.broken == []
        assert bench.mount.crowded == 0
        assert all(not row.spare for row in bench.sent)


_ENDS = {
    TicketState.COMPLETE,
    TicketState.UNCONFIRMED,
    TicketState.TIMED_OUT,
    TicketState.SUPERSEDED,
    TicketState.FAILED,
}


class TestWithoutAcknowledgement:
    @pytest.mark.parametrize(("request_", "flag"), UNACKNOWLEDGED, ids=request_id)
    def test_park_and_home_are_sent_for_a_while_and_stay_unconfirmed(
        self, request_: Request, flag: str
    ) -> None:
        bench = awake()
        # Power is cut at standstill only, and a mount that tracks the sky does not stand still.
        assert bench.settle(bench.submit(Abort())) is TicketState.COMPLETE
        launched = len(bench.mount.launches)
        ticket = bench.submit(request_)
        assert bench.settle(ticket) is TicketState.UNCONFIRMED
        assert ticket.reason
        bench.run(5.0)
        assert bench.rules.rose(flag) == len(bench.mount.launches) - launched == 1
        # Longer than one datagram, so that the loss of one does not lose the command.
        assert len(bench.up_rows(flag)) >= 4
        assert not bench.sent[-1].up()
        assert not ticket.was_acknowledged

    def test_a_tracking_rate_stays_in_the_datagram_and_is_unconfirmed(self) -> None:
        bench = awake()
        ticket = bench.submit(TrackingRate(2))
        assert bench.settle(ticket) is TicketState.UNCONFIRMED
        assert [row.tracking_rate for row in bench.run(5.0)] == [2] * 100
        assert bench.mount.launches == []

    def test_fine_rates_that_the_drives_do_not_show_are_unconfirmed(self) -> None:
        class Indifferent(PaperMount):
            def receive(self, data: bytes) -> bool:
                return super().receive(data[:48] + bytes(16) + data[64:])

        bench = awake(Indifferent())
        ticket = bench.submit(FineRate(1e-3, 0.0))
        assert bench.settle(ticket) is TicketState.UNCONFIRMED
        assert {row.RAFineRate for row in bench.run(1.0)} != {0}


class TestUnits:
    def test_a_target_goes_out_in_hours_and_degrees(self) -> None:
        bench = awake()
        bench.submit(Slew(187.5, -33.25))
        bench.run(0.5)
        assert {(row.TargetRA, row.TargetDec) for row in bench.up_rows("SlewToTargetCmd")} == {(12.5, -33.25)}

    @pytest.mark.parametrize("ra_deg", [0.0, 359.999, math.nextafter(360.0, 0.0)])
    @pytest.mark.parametrize("dec_deg", [-90.0, 90.0])
    def test_the_ends_of_the_sky_stay_within_24_h_and_90_degrees(self, ra_deg: float, dec_deg: float) -> None:
        bench = awake()
        bench.submit(Sync(ra_deg, dec_deg))
        bench.run(0.5)
        row = bench.up_rows("SyncToTargetCmd")[0]
        assert 0.0 <= row.TargetRA < 24.0
        assert row.TargetRA == pytest.approx(ra_deg / 15.0, abs=1e-12)
        assert row.TargetDec == dec_deg

    def test_the_sidereal_rate_as_a_fine_rate_is_roughly_the_paper_s_7789(self) -> None:
        """ "Sidereal rate is roughly 7789. (778.9 tics/sec x 10)": 2^26 tics in 86164.0905 s are 7788.49."""
        bench = awake()
        bench.submit(FineRate(SIDEREAL_RATE_DEG_S, 0.0))
        bench.run(0.5)
        assert bench.sent[-1].RAFineRate in (7788, 7789)
        assert bench.sent[-1].DecFineRate == 0

    def test_the_paper_s_sidereal_rate_of_778_9_tics_a_second_is_7789(self) -> None:
        bench = awake()
        bench.submit(FineRate(0.0, 778.9 * 360.0 / 2**26))
        bench.run(0.5)
        assert (bench.sent[-1].RAFineRate, bench.sent[-1].DecFineRate) == (0, 7789)

    @pytest.mark.parametrize("dtics", [1, -1, 100, -7789, 50_000])
    def test_fine_rates_are_tics_a_second_times_ten(self, dtics: int) -> None:
        bench = awake()
        bench.submit(FineRate(dtics / 10.0 * 360.0 / 2**26, -dtics / 10.0 * 360.0 / 2**26))
        bench.run(0.5)
        assert (bench.sent[-1].RAFineRate, bench.sent[-1].DecFineRate) == (dtics, -dtics)

    def test_fine_rates_stay_until_zero_takes_them_back(self) -> None:
        bench = awake()
        bench.submit(FineRate(1e-3, -2e-3))
        bench.run(0.5)
        bench.settle(bench.submit(PULSE))
        assert len({(row.RAFineRate, row.DecFineRate) for row in bench.run(1.0)} - {(0, 0)}) == 1
        bench.settle(bench.submit(FineRate(0.0, 0.0)))
        assert {(row.RAFineRate, row.DecFineRate) for row in bench.run(1.0)} == {(0, 0)}

    @pytest.mark.parametrize(
        ("ra_ms", "dec_ms"), [(1500, 0), (-1500, 0), (0, 250), (0, -250), (1, -1), (2000, 3000)]
    )
    def test_pulses_are_signed_milliseconds(self, ra_ms: int, dec_ms: int) -> None:
        bench = awake()
        ticket = bench.submit(PulseGuide(ra_ms, dec_ms))
        state = bench.settle(ticket)
        rows = bench.up_rows("PulseGuideCmd")
        assert {(row.PulseGuideRADuration, row.PulseGuideDecDuration) for row in rows} == {(ra_ms, dec_ms)}
        assert state is TicketState.COMPLETE
        assert not bench.mount.pulse_s

    def test_a_pulse_ends_when_the_mount_no_longer_pulse_guides(self) -> None:
        bench = awake()
        ticket = bench.submit(PulseGuide(3000, 0))
        bench.run(2.5)
        assert ticket.state is TicketState.ACKNOWLEDGED
        bench.run(1.0)
        assert ticket.state is TicketState.COMPLETE

    def test_negative_is_east(self) -> None:
        bench = awake()
        before = bench.mount.ra_deg
        bench.settle(bench.submit(PulseGuide(-2000, 0)))
        # East is towards larger right ascension; the guide rate is 3500 tics/s x 10.
        assert bench.mount.ra_deg - before == pytest.approx(2.0 * 350.0 * 360.0 / 2**26, rel=0.05)


class TestSlew:
    def test_a_stale_not_slewing_does_not_end_it(self) -> None:
        """ "An older datagram can be received that say slewing status is false immediately after"."""
        bench = awake()
        stale = [bench.mount.turn() for _ in range(6)]
        ticket = bench.submit(SLEW)
        bench.now += LOOP_S
        bench.mount.receive(bench.session.compose())
        for status in stale:
            bench.session.receive(status, bench.now)
            assert not ticket.settled
        bench.rules.last.counter += 1
        assert bench.settle(ticket) is TicketState.COMPLETE
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == (200.0, 30.0)

    def test_not_slewing_before_the_acknowledgement_does_not_end_it(self) -> None:
        bench = awake(PaperMount(deaf=True))
        ticket = bench.submit(SLEW)
        bench.run(0.5)
        assert ticket.state is TicketState.RAISED
        bench.mount.deaf = False
        assert bench.settle(ticket) is TicketState.COMPLETE
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == (200.0, 30.0)

    def test_it_is_complete_only_where_it_stands_at_the_target(self) -> None:
        bench = awake()
        ticket = bench.submit(SLEW)
        while not ticket.settled:
            bench.turn()
            assert bench.mount.target_deg is None or not ticket.settled
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == (200.0, 30.0)

    def test_a_slew_to_where_it_stands_is_complete(self) -> None:
        bench = awake()
        ticket = bench.submit(Slew(bench.mount.ra_deg, bench.mount.dec_deg))
        assert bench.settle(ticket) is TicketState.COMPLETE

    @HELD_AND_EDGE
    @pytest.mark.parametrize("move", [BOTH, MoveAxis(1.0, None), MoveAxis(None, 1.0)], ids=repr)
    def test_out_of_moveaxis_it_waits_for_slewing_to_fall(self, how: How, move: MoveAxis) -> None:
        """ "Ignore if still slewing", and "Slewing will be true during a MoveAxis command"."""
        bench = awake(PaperMount(move_axis=how))
        bench.submit(move)
        bench.run(1.0)
        assert bench.mount.moving
        ticket = bench.submit(SLEW)
        while not ticket.settled:
            before = bench.mount.moving
            if bench.turn().SlewToTargetCmd and not bench.launched("SlewToTargetCmd"):
                assert not before
        assert ticket.state is TicketState.COMPLETE
        assert bench.mount.ignored == []
        assert len(bench.launched("SlewToTargetCmd")) == 1
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == (200.0, 30.0)
        assert bench.rules.broken == []

    def test_a_second_one_is_not_sent_into_the_first(self) -> None:
        bench = awake()
        first = bench.submit(Slew(300.0, 60.0))
        bench.run(1.0)
        second = bench.submit(SLEW)
        bench.settle(first, 120.0)
        bench.settle(second, 120.0)
        assert bench.mount.ignored == []
        assert second.state is TicketState.COMPLETE
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == (200.0, 30.0)


class TestSync:
    def test_it_is_complete_when_the_mount_reports_the_target(self) -> None:
        bench = awake()
        assert bench.settle(bench.submit(SYNC)) is TicketState.COMPLETE
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == pytest.approx((150.5, 20.25), abs=1e-6)

    def test_acknowledged_but_not_obeyed_is_not_complete(self) -> None:
        bench = awake(PaperMount(unmoved=True))
        ticket = bench.submit(SYNC)
        assert bench.settle(ticket) in {TicketState.FAILED, TicketState.TIMED_OUT, TicketState.UNCONFIRMED}
        assert ticket.was_acknowledged
        assert ticket.reason

    def test_across_0_h_it_is_verified_too(self) -> None:
        bench = awake(PaperMount(ra_deg=359.9999))
        assert bench.settle(bench.submit(Sync(0.0, 20.0))) is TicketState.COMPLETE


class TestMoveAxis:
    @HELD_AND_EDGE
    @pytest.mark.parametrize(
        ("move", "flags"),
        [
            (MoveAxis(1.0, None), {"MoveAxisRA"}),
            (MoveAxis(None, -1.0), {"MoveAxisDec"}),
            (BOTH, {"MoveAxisRA", "MoveAxisDec"}),
        ],
        ids=["RA only", "Dec only", "both"],
    )
    def test_each_axis_by_its_own_flag_both_in_one_datagram(
        self, how: How, move: MoveAxis, flags: set[str]
    ) -> None:
        bench = awake(PaperMount(move_axis=how))
        ticket = bench.submit(move)
        assert bench.settle(ticket) is TicketState.COMPLETE
        bench.run(2.0)
        assert {frozenset(row.up()) for row in bench.sent if row.up()} == {frozenset(flags)}
        ra, dec = bench.mount.ra_deg, bench.mount.dec_deg
        bench.run(1.0)
        # Rates are additive to tracking, so those asked for are those of the reported coordinates.
        assert bench.mount.ra_deg - ra == pytest.approx(move.ra_rate_deg_s or 0.0, abs=1e-6)
        assert bench.mount.dec_deg - dec == pytest.approx(move.dec_rate_deg_s or 0.0, abs=1e-6)
        assert len(bench.mount.launches) == 1
        assert bench.rules.broken == []

    def test_held_flags_stay_up_until_the_end_is_asked_for(self) -> None:
        bench = awake()
        bench.submit(BOTH)
        rows = bench.run(5.0)
        assert all(flags_of(row) == {"MoveAxisRA", "MoveAxisDec"} for row in rows[1:])
        ticket = bench.submit(EndMove())
        assert bench.settle(ticket) is TicketState.COMPLETE
        assert not bench.mount.moving
        assert not any(row.up() for row in bench.run(1.0))

    def test_held_a_new_rate_needs_no_edge(self) -> None:
        bench = awake()
        bench.submit(MoveAxis(0.5, 0.5))
        bench.run(1.0)
        assert bench.settle(bench.submit(MoveAxis(-0.25, 0.125))) is TicketState.COMPLETE
        bench.run(1.0)
        assert bench.mount.rates_deg_s == {"RA": pytest.approx(0.25), "Dec": pytest.approx(0.125)}

    def test_edge_every_rate_is_an_edge_of_its_own_and_does_not_change_while_the_flag_is_up(self) -> None:
        bench = awake(PaperMount(move_axis="edge", ack_after=2))
        for rate in (0.5, 0.25, -1.0):
            assert bench.settle(bench.submit(MoveAxis(rate, rate))) is TicketState.COMPLETE
            bench.run(1.0)
            assert bench.mount.rates_deg_s == {"RA": pytest.approx(-rate), "Dec": pytest.approx(rate)}
        assert bench.rules.rose("MoveAxisRA") == bench.rules.rose("MoveAxisDec") == 3
        assert bench.rules.early_falls == []
        assert bench.rules.broken == []
        for before, after in zip(bench.sent, bench.sent[1:], strict=False):
            if before.MoveAxisRA and after.MoveAxisRA:
                assert before.MoveAxisRateRA == after.MoveAxisRateRA
                assert before.MoveAxisRateDec == after.MoveAxisRateDec

    def test_edge_flags_fall_when_both_are_acknowledged(self) -> None:
        bench = awake(PaperMount(move_axis="edge", ack_after=5))
        bench.submit(BOTH)
        bench.run(2.0)
        assert len(bench.up_rows("MoveAxisRA")) == len(bench.up_rows("MoveAxisDec")) == 6
        assert bench.mount.moving

    def test_edge_the_end_is_an_edge_of_rate_0(self) -> None:
        bench = awake(PaperMount(move_axis="edge"))
        bench.submit(BOTH)
        bench.run(1.0)
        ticket = bench.submit(EndMove())
        assert bench.settle(ticket) is TicketState.COMPLETE
        assert not bench.mount.moving
        ra_deg = bench.mount.ra_deg
        bench.run(1.0)
        assert bench.mount.ra_deg == ra_deg

    @HELD_AND_EDGE
    def test_one_axis_follows_the_other(self, how: How) -> None:
        bench = awake(PaperMount(move_axis=how))
        bench.settle(bench.submit(MoveAxis(1.0, None)))
        bench.settle(bench.submit(MoveAxis(None, 0.5)))
        bench.run(1.0)
        assert bench.mount.rates_deg_s == {"RA": pytest.approx(-1.0), "Dec": pytest.approx(0.5)}
        assert bench.rules.broken == []

    @HELD_AND_EDGE
    def test_a_gain_is_divided_out(self, how: How) -> None:
        bench = awake(PaperMount(move_axis=how), ra_rate_gain=0.5, dec_rate_gain=2.0)
        bench.settle(bench.submit(MoveAxis(1.0, 1.0)))
        row = bench.up_rows("MoveAxisRA")[-1]
        assert row.MoveAxisRateRA == pytest.approx(-2.0)
        assert row.MoveAxisRateDec == pytest.approx(0.5)

    @HELD_AND_EDGE
    @pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
    @pytest.mark.parametrize("additive", [True, False])
    def test_signs_and_additivity_are_the_profile_s(
        self, how: How, signs: tuple[Any, Any], additive: bool
    ) -> None:
        bench = awake(
            PaperMount(move_axis=how), ra_rate_sign=signs[0], dec_rate_sign=signs[1], additive=additive
        )
        bench.settle(bench.submit(BOTH))
        row = bench.up_rows("MoveAxisRA")[-1]
        # The hour angle grows as right ascension falls; an absolute rate carries the sky's turn itself.
        turn = 1.5 + (0.0 if additive else SIDEREAL_RATE_DEG_S)
        assert row.MoveAxisRateRA == pytest.approx(signs[0] * turn, abs=1e-9)
        assert row.MoveAxisRateDec == pytest.approx(signs[1] * 0.75, abs=1e-9)


class TestAbort:
    @HELD_AND_EDGE
    @pytest.mark.parametrize("state", EVERY, ids=request_id)
    @pytest.mark.parametrize("after", [0, 1, 2, pytest.param(3, marks=pytest.mark.soak), 7])
    def test_it_is_alone_in_the_next_datagram_or_the_one_after_from_every_state(
        self, how: How, state: Request, after: int
    ) -> None:
        bench = awake(PaperMount(move_axis=how))
        other = bench.submit(state)
        for _ in range(after):
            bench.turn()
        launched_before = state == Abort()
        abort = bench.submit(Abort())
        rows = [bench.turn(), bench.turn()]
        if not launched_before:
            assert "AbortSlewCmd" in rows[0].up() | rows[1].up()
            first = rows[0] if rows[0].AbortSlewCmd else rows[1]
            assert flags_of(first) == {"AbortSlewCmd"}
        assert bench.settle(abort) is TicketState.COMPLETE
        bench.settle(other)
        bench.run(2.0)
        assert not bench.mount.moving
        assert bench.rules.broken == []

    @pytest.mark.parametrize("state", [SLEW, SYNC, PULSE, FindHome(), BOTH], ids=request_id)
    def test_what_was_under_way_or_waiting_is_superseded(self, state: Request) -> None:
        bench = awake(PaperMount(ack_after=4))
        under_way = bench.submit(state)
        waiting = bench.submit(PULSE)
        bench.turn()
        abort = bench.submit(Abort())
        bench.settle(abort)
        assert under_way.state is TicketState.SUPERSEDED
        assert waiting.state is TicketState.SUPERSEDED
        assert under_way.reason
        launched = len(bench.mount.launches)
        bench.run(5.0)
        assert len(bench.mount.launches) == launched

    def test_it_goes_out_before_anything_was_heard(self) -> None:
        bench = Bench(PaperMount(), MountProfile())
        bench.submit(Abort())
        assert flags_of(bench.turn()) == {"AbortSlewCmd"}

    @pytest.mark.parametrize("sticky", ["SlewToTargetCmd", "SyncToTargetCmd", "PulseGuideCmd"])
    def test_acknowledgements_that_stand_do_not_keep_it_back(self, sticky: str) -> None:
        bench = awake(PaperMount(sticky=frozenset({sticky})))
        bench.submit({"SlewToTargetCmd": SLEW, "SyncToTargetCmd": SYNC, "PulseGuideCmd": PULSE}[sticky])
        bench.run(0.5)
        assert sticky in bench.mount.acks
        bench.submit(Abort())
        assert flags_of(bench.turn()) == {"AbortSlewCmd"}

    @HELD_AND_EDGE
    def test_a_slew_after_it_is_done(self, how: How) -> None:
        bench = awake(PaperMount(move_axis=how))
        bench.submit(BOTH)
        bench.run(1.0)
        bench.settle(bench.submit(Abort()))
        assert bench.settle(bench.submit(SLEW)) is TicketState.COMPLETE
        assert bench.settle(bench.submit(BOTH)) is TicketState.COMPLETE
        bench.run(0.5)
        assert bench.mount.moving

    @HELD_AND_EDGE
    @pytest.mark.parametrize("state", [Slew(300.0, 60.0), BOTH], ids=request_id)
    def test_it_is_not_repeated_while_the_mount_is_seen_to_slow_down(self, how: How, state: Request) -> None:
        """ "It will slow and then stop drive"."""
        bench = awake(PaperMount(move_axis=how))
        bench.submit(state)
        bench.run(1.0)
        bench.settle(bench.submit(Abort()))
        assert bench.rules.rose("AbortSlewCmd") == 1

    def test_complete_means_at_rest(self) -> None:
        bench = awake()
        bench.submit(Slew(300.0, 60.0))
        bench.run(1.0)
        ticket = bench.submit(Abort())
        while not ticket.settled:
            bench.turn()
        assert ticket.state is TicketState.COMPLETE
        assert not bench.mount.moving


class TestNeverTwoFlags:
    @HELD_AND_EDGE
    def test_with_everything_asked_for_at_once_and_in_every_order(self, how: How) -> None:
        asked: list[Request] = [SLEW, BOTH, SYNC, PULSE, FindHome(), FineRate(1e-3, 0.0), EndMove()]
        for first in range(len(asked)):
            bench = awake(PaperMount(move_axis=how))
            for request in asked[first:] + asked[:first]:
                bench.submit(request)
                bench.run(0.15)
            bench.run(10.0)
            assert bench.rules.broken == []
            assert bench.mount.crowded == 0
            for row in bench.sent:
                assert len(flags_of(row) & ONE_SHOTS) <= 1


class TestOneAfterTheOther:
    """A second motion comes at any instant of the first's: before its flag, under it, after it."""

    @pytest.mark.parametrize(
        ("ack_after", "how"),
        [
            (0, "edge"),
            (3, "held"),
            *(pytest.param(*one, marks=pytest.mark.soak) for one in ((0, "held"), (3, "edge"))),
        ],
    )
    @pytest.mark.parametrize("second", [Slew(140.0, 10.0), MoveAxis(0.5, -0.5), EndMove()], ids=request_id)
    @pytest.mark.parametrize("first", [SLEW, BOTH, PULSE, SYNC, FindHome()], ids=request_id)
    def test_the_second_is_done_whenever_it_comes(
        self, how: How, ack_after: int, first: Request, second: Request
    ) -> None:
        for after in (0, 1, 2, 5):
            bench = awake(PaperMount(move_axis=how, ack_after=ack_after))
            bench.submit(first)
            for _ in range(after):
                bench.turn()
            ticket = bench.submit(second)
            assert bench.settle(ticket) is TicketState.COMPLETE, f"after {after} periods"
            bench.run(0.5)
            assert bench.rules.broken == []
            assert bench.mount.crowded == 0
            if isinstance(second, Slew):
                # A pulse that still runs shifts it by a fraction of an arcminute.
                assert (bench.mount.ra_deg, bench.mount.dec_deg) == pytest.approx((140.0, 10.0), abs=0.01)
            elif isinstance(second, MoveAxis):
                assert bench.mount.rates_deg_s == {"RA": pytest.approx(-0.5), "Dec": pytest.approx(-0.5)}
            else:
                assert not bench.mount.rates_deg_s


class TestNothingWaitsForEver:
    @pytest.mark.parametrize("later", [SYNC, PULSE, FindHome(), *FLAGLESS], ids=request_id)
    def test_what_is_asked_for_after_a_slew_is_done(self, later: Request) -> None:
        bench = awake()
        assert bench.settle(bench.submit(SLEW)) is TicketState.COMPLETE
        state = bench.settle(bench.submit(later))
        assert state in {TicketState.COMPLETE, TicketState.UNCONFIRMED}

    @pytest.mark.parametrize("later", [SYNC, PULSE, FindHome(), *FLAGLESS], ids=request_id)
    def test_what_is_asked_for_after_an_abort_is_done(self, later: Request) -> None:
        bench = awake()
        assert bench.settle(bench.submit(Abort())) is TicketState.COMPLETE
        state = bench.settle(bench.submit(later))
        assert state in {TicketState.COMPLETE, TicketState.UNCONFIRMED}

    @pytest.mark.parametrize("later", [SYNC, PULSE, FindHome(), *FLAGLESS], ids=request_id)
    def test_what_is_asked_for_behind_a_slew_is_done_after_it(self, later: Request) -> None:
        bench = awake()
        bench.submit(SLEW)
        bench.run(0.5)
        state = bench.settle(bench.submit(later))
        assert state in {TicketState.COMPLETE, TicketState.UNCONFIRMED}
        assert (bench.mount.ra_deg, bench.mount.dec_deg) == pytest.approx((200.0, 30.0), abs=60.0)

    @HELD_AND_EDGE
    @pytest.mark.parametrize("later", [SYNC, PULSE, FindHome(), *FLAGLESS], ids=request_id)
    def test_what_is_asked_for_during_moveaxis_settles(self, how: How, later: Request) -> None:
        bench = awake(PaperMount(move_axis=how))
        bench.settle(bench.submit(MoveAxis(1e-3, 1e-3)))
        bench.settle(bench.submit(later), 60.0)


class TestReadings:
    """What the paper leaves open must not change what becomes of a request."""

    @pytest.mark.parametrize("kind", ["long", "double"])
    @pytest.mark.parametrize(
        "request_", [SLEW, SYNC, PULSE, Abort(), BOTH, FineRate(1e-3, -1e-3)], ids=request_id
    )
    def test_every_type_of_the_doubtful_fields(
        self, request_: Request, kind: Literal["long", "double"]
    ) -> None:
        bench = awake(PaperMount(types=dict.fromkeys(DOUBTFUL, kind)))
        assert bench.settle(bench.submit(request_)) is TicketState.COMPLETE
        assert bench.session.health.rejected == bench.session.health.lost == 0
        assert bench.rules.broken == []

    @pytest.mark.parametrize("true_byte", [0x01, 0x80, 0xFF])
    @pytest.mark.parametrize("request_", [SLEW, SYNC, PULSE, Abort(), BOTH], ids=request_id)
    def test_every_byte_that_is_not_zero_is_true(self, request_: Request, true_byte: int) -> None:
        bench = awake(PaperMount(true_byte=true_byte))
        assert bench.settle(bench.submit(request_)) is TicketState.COMPLETE
        assert bench.rules.broken == []


class TestParkBehindOthers:
    """ "It disables the drives wherever the mount is": what was cleared in one place is to go out there."""

    def test_a_park_that_waited_behind_a_slew_is_not_sent_elsewhere(self) -> None:
        bench = awake()
        bench.submit(SLEW)
        park = bench.submit(Park())
        bench.run(20.0)
        bench.session.apply(Cleared(Hold()))
        bench.run(5.0)
        assert bench.rules.rose("ParkCmd") == 0
        assert bench.mount.powered
        assert park.state in {TicketState.FAILED, TicketState.SUPERSEDED, TicketState.TIMED_OUT}

    def test_a_park_that_waited_behind_a_sync_is_not_sent_where_the_position_is_another(self) -> None:
        bench = awake()
        bench.submit(Sync(250.0, -20.0))
        bench.submit(Park())
        bench.run(10.0)
        assert bench.rules.rose("ParkCmd") == 0
        assert bench.mount.powered

"""What must not reach the mount, and what must not be believed of it.

Source: Van Deventer, "Xerxes Mount Control Protocol": "verify RA is 0 to 24 and dec is -90 to 90", durations
as "signed int" of 4 bytes, one command datagram for all ("mailbox"), fixed length and header.
"""

from __future__ import annotations

import math
import random
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import pytest
from paper_link import Bench
from paper_mount import LOOP_S, PaperMount
from paper_packing import CommandRow, pack_command

from sattrack.mount.model import AxesPosition, AxisLimits, MountProfile, Slew, Stance
from sattrack.mount.requests import (
    Abort,
    ClearedRequest,
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
    objection,
)
from sattrack.safety import Safety, SafetyLimits

if TYPE_CHECKING:
    from collections.abc import Callable

How = Literal["held", "edge"]
LATITUDE_DEG = 48.0
SLOW = AxisLimits(max_rate_deg_s=3.0)
PARK = AxesPosition(hour_angle_deg=-30.0, dec_deg=20.0)
PROFILE = MountProfile(ra=SLOW, dec=AxisLimits(max_rate_deg_s=2.0), park=PARK)
PARKED = Stance(sidereal_deg=120.0, ra_deg=150.0, dec_deg=20.0, slewing=False, drives_at_rest=True)
"""At rest at the park position: 120° - 150° is an hour angle of -30°."""
NO_NUMBERS = (math.nan, math.inf, -math.inf)


def answer(request: Request, stance: Stance | None = PARKED, profile: MountProfile = PROFILE) -> Any:
    # Where the Sun stands is not asked here: there are no optics.
    limits = SafetyLimits(optical=False)
    return Safety(profile, limits, LATITUDE_DEG).clear_request(request, stance)


def hours(value: float) -> float:
    return value * 15.0


class TestRefusedBeforeAnythingIsSent:
    @pytest.mark.parametrize("kind", [Slew, Sync])
    @pytest.mark.parametrize(
        ("ra_deg", "dec_deg", "named"),
        [
            (hours(24.0), 10.0, ("right ascension", "24 h", "360")),
            (hours(-0.1), 10.0, ("right ascension", "-0.1 h", "0")),
            (math.nan, 10.0, ("right ascension", "nan")),
            (math.inf, 10.0, ("right ascension", "inf")),
            (10.0, 91.0, ("declination", "91", "90")),
            (10.0, -90.0001, ("declination", "-90")),
            (10.0, math.nan, ("declination", "nan")),
            (10.0, -math.inf, ("declination", "-inf")),
        ],
    )
    def test_directions_off_the_sky_with_the_field_the_value_and_the_range(
        self, kind: Any, ra_deg: float, dec_deg: float, named: tuple[str, ...]
    ) -> None:
        refusal = answer(kind(ra_deg, dec_deg))
        assert isinstance(refusal, str)
        assert all(word in refusal for word in named), refusal
        assert "\n" not in refusal

    @pytest.mark.parametrize("rate", [*NO_NUMBERS, 3.001, -3.001, 1e300])
    def test_rates_over_the_profile_s_limit_or_no_numbers(self, rate: float) -> None:
        for request in (MoveAxis(rate, None), MoveAxis(rate, 0.0)):
            refusal = answer(request)
            assert isinstance(refusal, str)
            assert "right ascension" in refusal
            assert f"{rate:g}" in refusal

    @pytest.mark.parametrize("rate", [*NO_NUMBERS, 2.001, -2.001])
    def test_each_axis_has_its_own_limit(self, rate: float) -> None:
        for request in (MoveAxis(None, rate), MoveAxis(2.0, rate)):
            refusal = answer(request)
            assert isinstance(refusal, str)
            assert "declination" in refusal

    @pytest.mark.parametrize("rate", [3.0, -3.0, 0.0])
    def test_rates_at_the_limit_pass(self, rate: float) -> None:
        assert answer(MoveAxis(rate, None)) == ClearedRequest(MoveAxis(rate, None))

    @pytest.mark.parametrize(
        "request_",
        [
            MoveAxis(None, None),
            PulseGuide(0, 0),
            PulseGuide(2**31, 0),
            PulseGuide(0, 2**31),
            PulseGuide(-(2**31) - 1, 0),
            PulseGuide(0, -(2**40)),
            FineRate(math.nan, 0.0),
            FineRate(0.0, math.inf),
            FineRate(1.0, 0.0),
            TrackingRate(4),
            TrackingRate(-1),
        ],
        ids=repr,
    )
    def test_values_that_do_not_fit_their_field_or_mean_nothing(self, request_: Request) -> None:
        refusal = answer(request_)
        assert isinstance(refusal, str)
        assert refusal
        assert "\n" not in refusal

    @pytest.mark.parametrize("ms", [600_000, -600_000, 1, -1])
    def test_pulses_of_up_to_minutes_pass(self, ms: int) -> None:
        assert answer(PulseGuide(ms, 0)) == ClearedRequest(PulseGuide(ms, 0))

    @pytest.mark.parametrize("ms", [2**31 - 1, -(2**31) + 1])
    def test_pulses_of_weeks_would_end_past_a_limit(self, ms: int) -> None:
        assert objection(PulseGuide(ms, 0), PROFILE) is None
        assert "limit" in str(answer(PulseGuide(0, ms)))

    @pytest.mark.parametrize(
        "request_",
        [
            Slew(10.0, 20.0),
            Sync(10.0, 20.0),
            MoveAxis(1.0, 1.0),
            PulseGuide(100, 0),
            Park(),
            FindHome(),
            FineRate(1e-3, 0.0),
        ],
        ids=repr,
    )
    def test_everything_but_an_abort_while_the_mount_has_not_been_heard(self, request_: Request) -> None:
        assert isinstance(answer(request_, None), str)
        assert answer(Abort(), None) == ClearedRequest(Abort())

    def test_a_slew_under_the_horizon(self) -> None:
        # Opposite the meridian it stands at 48° - 60° - 90° = -102°, past the nadir: 78° under the horizon.
        refusal = answer(Slew(PARKED.sidereal_deg + 180.0, -60.0))
        assert isinstance(refusal, str)
        assert "altitude" in refusal


class TestPark:
    """ "It disables the drives wherever the mount is": so only at standstill at the park position."""

    def test_at_rest_at_the_park_position_it_passes(self) -> None:
        assert answer(Park()) == ClearedRequest(Park())

    @pytest.mark.parametrize(
        "stance",
        [
            Stance(120.0, 150.0, 20.0, slewing=True, drives_at_rest=True),
            Stance(120.0, 150.0, 20.0, slewing=False, drives_at_rest=False),
            Stance(120.0, 150.0, 20.0, slewing=True, drives_at_rest=False),
        ],
        ids=["slewing", "drives turning", "both"],
    )
    def test_refused_while_anything_moves(self, stance: Stance) -> None:
        refusal = answer(Park(), stance)
        assert isinstance(refusal, str)
        assert "move" in refusal

    @pytest.mark.parametrize(
        "stance",
        [
            Stance(120.0, 155.0, 20.0, slewing=False, drives_at_rest=True),
            Stance(120.0, 145.0, 20.0, slewing=False, drives_at_rest=True),
            Stance(120.0, 150.0, 25.0, slewing=False, drives_at_rest=True),
            Stance(120.0, 150.0, 15.0, slewing=False, drives_at_rest=True),
            Stance(300.0, 150.0, 20.0, slewing=False, drives_at_rest=True),
            Stance(135.0, 150.0, 20.0, slewing=False, drives_at_rest=True),
        ],
        ids=["east", "west", "north", "south", "half a turn", "an hour later"],
    )
    def test_refused_anywhere_else(self, stance: Stance) -> None:
        refusal = answer(Park(), stance)
        assert isinstance(refusal, str)
        assert "park position" in refusal

    def test_refused_without_a_park_position(self) -> None:
        refusal = answer(Park(), PARKED, MountProfile())
        assert isinstance(refusal, str)
        assert "park position" in refusal

    @pytest.mark.parametrize("turns", [-1, 1])
    def test_the_park_position_is_the_same_through_0_h(self, turns: int) -> None:
        profile = MountProfile(park=AxesPosition(hour_angle_deg=-30.0 + 360.0 * turns, dec_deg=20.0))
        assert answer(Park(), PARKED, profile) == ClearedRequest(Park())
        assert answer(Park(), Stance(330.0, 0.0, 20.0, False, True)) == ClearedRequest(Park())


@dataclass
class Shared(PaperMount):
    """A mount to which a second client writes too: its datagram is the latest in some turns of the loop."""

    theirs: Callable[[int], CommandRow] = lambda turn: CommandRow(counter=turn)
    share: float = 0.5
    rng: random.Random = field(default_factory=lambda: random.Random(1))
    theirs_sent: int = 0

    def turn(self, seconds: float = LOOP_S) -> bytes:
        self.theirs_sent += 1
        if self.rng.random() < self.share:
            self.receive(pack_command(self.theirs(self.theirs_sent)))
        return super().turn(seconds)


def idle(turn: int) -> CommandRow:
    return CommandRow(counter=turn)


def pulsing(flag: str) -> Callable[[int], CommandRow]:
    """A second client that asks for something every two seconds, for half a second each."""
    return lambda turn: CommandRow(counter=turn, **{flag: turn % 40 < 10}, TargetRA=10.0, TargetDec=20.0)


class TestTwoClients:
    @pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
    def test_a_second_sender_that_makes_our_flags_toggle_is_reported(self, share: float) -> None:
        bench = Bench(Shared(share=share))
        bench.run(1.0)
        bench.submit(MoveAxis(0.01, 0.01))
        bench.run(10.0)
        assert len(bench.launched("MoveAxis")) > 1
        assert bench.session.intruder
        assert bench.session.health.foreign_acks + bench.session.health.doubled_launches > 0

    @pytest.mark.parametrize("how", ["held", "edge"])
    @pytest.mark.parametrize(
        "flag",
        ["SyncToTargetCmd", "AbortSlewCmd", "PulseGuideCmd", "MoveAxisRA", "MoveAxisDec", "SlewToTargetCmd"],
    )
    def test_a_second_sender_that_commands_is_reported(self, flag: str, how: How) -> None:
        bench = Bench(Shared(move_axis=how, theirs=pulsing(flag), ra_deg=150.0))
        bench.run(20.0)
        assert bench.mount.launches
        assert bench.session.intruder
        assert bench.session.health.foreign_acks >= 3

    def test_an_acknowledgement_of_theirs_does_not_complete_a_request_of_ours(self) -> None:
        bench = Bench(Shared(theirs=pulsing("PulseGuideCmd"), deaf=False, share=1.0))
        bench.run(1.0)
        ticket = bench.submit(Sync(151.0, 21.0))
        bench.settle(ticket, 120.0)
        assert ticket.state is not TicketState.COMPLETE

    def test_one_client_alone_is_no_intruder_to_itself(self) -> None:
        for how in ("held", "edge"):
            bench = Bench(PaperMount(move_axis=how))
            bench.run(1.0)
            for request in (Slew(170.0, 30.0), MoveAxis(0.5, -0.5), Abort(), MoveAxis(0.1, None), EndMove()):
                bench.settle(bench.submit(request))
                bench.run(2.0)
            assert bench.session.intruder is None
            assert bench.session.health.foreign_acks == bench.session.health.doubled_launches == 0


class TestStrangers:
    def test_what_comes_of_a_command_datagram_s_own_port_is_no_status(self) -> None:
        """Both ends' ports mixed up, our own datagrams come back to us."""
        bench = Bench()
        for _ in range(50):
            bench.now += LOOP_S
            assert bench.session.receive(bench.session.compose(), bench.now) is None
        assert bench.session.health.rejected == 50
        assert bench.session.health.received == 0
        assert bench.session.link_state(bench.now).value == "silent"


class TestImpossibleStatuses:
    @pytest.mark.parametrize(
        ("offset", "value"),
        [
            *[(offset, value) for offset in (24, 40, 56) for value in NO_NUMBERS],
            (24, 90.1),
            (24, -90.1),
            (40, -0.1),
            (40, 24.1),
            (56, -0.1),
            (56, 24.1),
        ],
    )
    def test_a_status_of_what_cannot_be_is_rejected_and_counted(self, offset: int, value: float) -> None:
        bench = Bench()
        bench.run(0.5)
        good = bench.session.sample
        data = bytearray(bench.mount.turn())
        data[offset : offset + 8] = struct.pack("<d", value)
        assert bench.session.receive(bytes(data), bench.now + LOOP_S) is None
        assert bench.session.health.rejected == 1
        assert bench.session.sample == good

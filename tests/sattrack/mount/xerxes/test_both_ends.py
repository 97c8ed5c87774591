"""The client's end and the mount's end of the Xerxes protocol, joined by wires that lose, double, reorder.

Source: Van Deventer, "Xerxes Mount Control Protocol", Overview: the scheme is to be "inherently tolerant of
lost or occasionally misordered" packets; Details: the stale "not slewing". A stop takes effect within two
datagrams from every state. All time is virtual, all disturbance comes from a seed.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from xerxes_builders import (
    PERIOD_S,
    SIDEREAL_DEG_S,
    T0,
    moving_flags,
    spoilt,
    trapezoid_s,
    turned,
    unused_flags,
    want,
)

from sattrack.mount.model import Hold, Motion, MountProfile, MoveAxes, Slew, Status, Stop
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition, Truth
from sattrack.mount.xerxes.datagrams import (
    Command,
    decode_command,
    decode_status,
    encode_command,
    encode_status,
)
from sattrack.mount.xerxes.flags import SlewState
from sattrack.mount.xerxes.session import Session

if TYPE_CHECKING:
    from collections.abc import Callable

PROFILE = MountProfile()
SITE = SimulatedSite(48.0, 11.0, 520.0)
SEEN_S = 2.1
"""Rest is seen in half a second of positions."""
SETTLING_S = 0.5
"""What a servo may need beyond the motion's closed form."""


class Wires(NamedTuple):
    """How both ways treat a datagram: chances of loss and doubling, delay in turns drawn for each copy."""

    loss: float = 0.0
    doubling: float = 0.0
    shortest: int = 0
    longest: int = 0


CLEAN = Wires()
LAGGING = Wires(shortest=3, longest=3)
LOSSY = Wires(loss=0.3, doubling=0.3)
ROUGH = Wires(loss=0.2, doubling=0.2, longest=3)


def seeds(count: int) -> pytest.MarkDecorator:
    """Take one seed by default, and the others as a soak."""
    return pytest.mark.parametrize(
        "seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, count))]
    )


ALL_WIRES = pytest.mark.parametrize(
    "wires", [CLEAN, LAGGING, LOSSY, ROUGH], ids=["clean", "lagging", "lossy", "rough"]
)


class Way:
    """One direction of the link."""

    def __init__(self, wires: Wires, rng: random.Random) -> None:
        self.wires = wires
        self.rng = rng
        self.cut = False
        self._under_way: list[tuple[int, int, bytes]] = []
        self._count = 0

    def put(self, turn: int, data: bytes) -> None:
        copies = 2 if self.rng.random() < self.wires.doubling else 1
        for _ in range(copies):
            if self.cut or self.rng.random() < self.wires.loss:
                continue
            self._count += 1
            due = turn + self.rng.randint(self.wires.shortest, self.wires.longest)
            self._under_way.append((due, self._count, data))

    def take(self, turn: int) -> list[bytes]:
        due = sorted(item for item in self._under_way if item[0] <= turn)
        self._under_way = [item for item in self._under_way if item[0] > turn]
        return [data for _, _, data in due]


class Pair:
    """A session and a mount, both at 20 Hz: `want` speaks to the one, `status` and `truth` show the other."""

    def __init__(self, wires: Wires = CLEAN, seed: int = 0) -> None:
        rng = random.Random(seed)
        self.session = Session(PROFILE)
        self.mount = SimulatedMount(PROFILE, SITE, StartPosition(-30.0, 20.0))
        self.out = Way(wires, rng)
        self.back = Way(wires, rng)
        self.turn = 0
        self.sent: list[Command] = []
        self.said: list[Status] = []
        self.went: list[Truth] = []
        self.run(1.0)
        self.home = self.truth
        """Where it tracked the sky before anything was asked."""

    @property
    def status(self) -> Status:
        return self.said[-1]

    @property
    def truth(self) -> Truth:
        return self.went[-1]

    @property
    def now(self) -> float:
        return T0 + self.turn * PERIOD_S

    def step(self) -> None:
        self.turn += 1
        data = self.session.compose()
        assert len(data) == 82
        self.sent.append(decode_command(data))
        assert unused_flags(self.sent[-1]) == []
        self.out.put(self.turn, data)
        for data in self.out.take(self.turn):
            assert self.mount.receive(data)
        data, truth = self.mount.tick(self.now)
        self.said.append(decode_status(data))
        self.went.append(truth)
        self.back.put(self.turn, data)
        for data in self.back.take(self.turn):
            self.session.receive(data, self.now)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.step()

    def want(self, motion: Motion, seconds: float = 0.0) -> None:
        want(self.session, motion)
        self.run(seconds)

    def until(self, reached: Callable[[], bool], seconds: float) -> None:
        """Run until it is so; fail where that takes longer."""
        end = self.turn + round(seconds / PERIOD_S)
        while not reached():
            assert self.turn < end
            self.step()

    def place(self, east_deg: float, north_deg: float) -> Slew:
        return Slew(self.home.ra_deg + east_deg, self.home.dec_deg + north_deg)

    def off_deg(self, place: Slew) -> float:
        return max(abs(turned(self.truth.ra_deg - place.ra_deg)), abs(self.truth.dec_deg - place.dec_deg))

    def is_done(self) -> bool:
        return self.session.slew_state is SlewState.DONE

    def drive_rates(self) -> tuple[float, float]:
        return self.truth.ra_rate_deg_s - SIDEREAL_DEG_S, self.truth.dec_rate_deg_s

    def at_rest(self) -> bool:
        return max(abs(rate) for rate in self.drive_rates()) < 1e-3

    def on_the_sky(self) -> bool:
        return max(abs(self.truth.ra_rate_deg_s), abs(self.truth.dec_rate_deg_s)) < 1e-3

    def launches(self) -> int:
        """How often the mount set out on a slew."""
        slewing = [status.slewing and not (status.ack_move_ra or status.ack_move_dec) for status in self.said]
        moved = [status.ack_move_ra or status.ack_move_dec for status in self.said]
        return sum(
            now and not before and not was_moved
            for before, now, was_moved in zip(slewing, slewing[1:], moved, strict=False)
        )

    def restart_mount(self) -> None:
        """Switch the mount off and on where it stands."""
        hour_angle_deg = turned(self.status.sidereal_h * 15 - self.truth.ra_deg)
        self.mount = SimulatedMount(PROFILE, SITE, StartPosition(hour_angle_deg, self.truth.dec_deg))


class TestSlew:
    @ALL_WIRES
    @seeds(4)
    def test_every_slew_launches_once_and_done_is_there(self, wires: Wires, seed: int) -> None:
        pair = Pair(wires, seed)
        places = [pair.place(4.0, 3.0), pair.place(-6.0, 10.0), pair.place(0.0, -15.0)]
        for asked, place in enumerate(places):
            assert pair.launches() == asked
            pair.want(place)
            pair.until(pair.is_done, trapezoid_s(30.0, 10.0, 5.0) + 3.0)
            assert pair.off_deg(place) < 1e-2
        pair.run(2.0)
        assert pair.launches() == len(places)
        assert pair.off_deg(places[-1]) < 1e-4
        assert pair.is_done()

    @ALL_WIRES
    @seeds(3)
    def test_asked_every_turn_it_launches_once(self, wires: Wires, seed: int) -> None:
        pair = Pair(wires, seed)
        place = pair.place(4.0, 3.0)
        for _ in range(120):
            pair.want(place, PERIOD_S)
        assert pair.launches() == 1
        assert pair.is_done()
        assert pair.off_deg(place) < 1e-4

    @ALL_WIRES
    @pytest.mark.parametrize("turns", [*range(1, 9), 30])
    def test_out_of_moveaxis_done_is_there(self, wires: Wires, turns: int) -> None:
        """The last status heard may tell of the time before MoveAxis began."""
        pair = Pair(wires, turns)
        place = pair.place(4.0, 3.0)
        pair.want(MoveAxes(-1.0, 0.5), turns * PERIOD_S)
        pair.want(place)
        pair.until(pair.is_done, 10.0)
        assert pair.off_deg(place) < 1e-2

    @ALL_WIRES
    @pytest.mark.parametrize("turns", [*range(1, 9), 30])
    def test_with_the_target_changed_done_is_at_the_second(self, wires: Wires, turns: int) -> None:
        pair = Pair(wires, turns)
        second = pair.place(-2.0, 8.0)
        pair.want(pair.place(4.0, 3.0), turns * PERIOD_S)
        pair.want(second)
        pair.until(pair.is_done, 15.0)
        assert pair.off_deg(second) < 1e-2

    @ALL_WIRES
    @pytest.mark.parametrize("turns", [1, 2, 4, 8])
    @pytest.mark.parametrize("pause", [1, pytest.param(3, marks=pytest.mark.soak)])
    @pytest.mark.parametrize("between", [Hold(), MoveAxes(-1.0, 0.5), Stop()])
    def test_after_one_given_up_done_is_at_the_second(
        self, wires: Wires, turns: int, pause: int, between: Motion
    ) -> None:
        pair = Pair(wires, turns)
        second = pair.place(-2.0, 8.0)
        pair.want(pair.place(4.0, 3.0), turns * PERIOD_S)
        pair.want(between, pause * PERIOD_S)
        pair.want(second)
        pair.until(pair.is_done, 15.0)
        assert pair.off_deg(second) < 1e-2

    @ALL_WIRES
    @pytest.mark.parametrize("turns", range(1, 9))
    def test_after_a_stop_done_is_there(self, wires: Wires, turns: int) -> None:
        pair = Pair(wires, turns)
        place = pair.place(-2.0, 8.0)
        pair.want(pair.place(40.0, 3.0), 1.0)
        pair.want(Stop(), turns * PERIOD_S)
        pair.want(place)
        pair.until(pair.is_done, 20.0)
        assert pair.off_deg(place) < 1e-2

    def test_a_slew_to_where_it_stands_is_done(self) -> None:
        pair = Pair()
        place = pair.place(0.0, 0.0)
        pair.want(place)
        pair.until(pair.is_done, 2.0)
        assert pair.off_deg(place) < 1e-2


MOVE = MoveAxes(-2.0, 1.5)
FAR = (40.0, 30.0)
Program = list[tuple[Motion | tuple[float, float], int]]
"""What is wanted and for how many turns; a pair of degrees is a slew to there from where the mount began."""
STATES: dict[str, Program] = {
    "tracking": [(Hold(), 5)],
    "asked": [(FAR, 1)],
    "slewing": [(FAR, 30)],
    "arrived": [((1.0, 1.0), 60)],
    "moving": [(MOVE, 40)],
    "moving for a turn": [(MOVE, 1)],
    "moving by small rates": [(MoveAxes(0.01, -0.01), 40)],
    "waiting for standstill": [(MOVE, 40), (FAR, 1)],
    "waiting behind a slew": [(FAR, 30), ((-40.0, 0.0), 10)],
    "leaving moveaxis": [(MOVE, 40), (Hold(), 1)],
    "stopping": [(FAR, 30), (Stop(), 1)],
    "stopped": [(FAR, 30), (Stop(), 60)],
    "stop given up": [(FAR, 30), (Stop(), 1), (Hold(), 1)],
    "moving after a stop": [(FAR, 30), (Stop(), 60), (MOVE, 20)],
    "moving the turn after a stop": [(FAR, 30), (Stop(), 60), (MOVE, 1)],
    **{f"moving {n} turns into a stop": [(FAR, 30), (Stop(), n), (MOVE, 2)] for n in (1, 2, 3, 4)},
    **{f"slewing {n} turns into a stop": [(MOVE, 30), (Stop(), n), (FAR, 2)] for n in (1, 2, 3, 4)},
}


def played(program: Program, wires: Wires, seed: int) -> Pair:
    pair = Pair(wires, seed)
    for motion, turns in program:
        pair.want(pair.place(*motion) if isinstance(motion, tuple) else motion, turns * PERIOD_S)
    return pair


class TestStop:
    @pytest.mark.parametrize("state", STATES)
    def test_it_is_on_the_wire_within_two_datagrams_and_the_axes_rest_in_time(self, state: str) -> None:
        pair = played(STATES[state], CLEAN, 0)
        speed = max(abs(rate) for rate in pair.drive_rates())
        before = len(pair.sent)
        aborting = pair.status.ack_abort or pair.sent[-1].abort or pair.at_rest()
        pair.want(Stop(), 2 * PERIOD_S)
        assert [moving_flags(command) for command in pair.sent[before:]] == [[], []]
        assert aborting or any(command.abort for command in pair.sent[before:])
        pair.run(speed / PROFILE.ra.max_acceleration_deg_s2 + SETTLING_S)
        assert pair.at_rest()
        pair.run(SEEN_S)
        assert pair.session.stopped
        assert not pair.status.slewing
        pair.run(2.0)
        assert pair.at_rest()

    @pytest.mark.parametrize("wires", [LAGGING, LOSSY, ROUGH], ids=["lagging", "lossy", "rough"])
    @seeds(2)
    @pytest.mark.parametrize("state", STATES)
    def test_over_bad_wires_the_axes_come_to_rest_and_stay(self, state: str, wires: Wires, seed: int) -> None:
        pair = played(STATES[state], wires, seed)
        pair.want(Stop(), 4.0)
        assert pair.at_rest()
        assert pair.session.stopped
        for _ in range(60):
            pair.step()
            assert pair.at_rest()

    @pytest.mark.parametrize("wires", [LAGGING, LOSSY, ROUGH], ids=["lagging", "lossy", "rough"])
    @seeds(3)
    def test_stopped_is_said_only_of_a_mount_that_stands(self, wires: Wires, seed: int) -> None:
        """Of one that stood when it last spoke: the word lags by the way back."""
        pair = Pair(wires, seed)
        for motion in (pair.place(*FAR), MOVE, pair.place(-30.0, -20.0)):
            pair.want(motion, 1.5)
            want(pair.session, Stop())
            for _ in range(100):
                assert not pair.session.stopped or pair.at_rest() or pair.on_the_sky()
                pair.step()
            assert pair.session.stopped

    def test_asked_during_an_outage_it_acts_when_the_link_is_back(self) -> None:
        pair = played(STATES["moving"], CLEAN, 0)
        pair.out.cut = pair.back.cut = True
        pair.want(Stop(), 3.0)
        assert not pair.at_rest()
        assert not pair.session.stopped
        pair.out.cut = pair.back.cut = False
        pair.run(2 / 10 + SETTLING_S)
        assert pair.at_rest()
        pair.run(SEEN_S)
        assert pair.session.stopped

    def test_deaf_it_still_stops_the_mount(self) -> None:
        """Nothing comes back, so the flag stays up."""
        pair = played(STATES["slewing"], CLEAN, 0)
        pair.back.cut = True
        pair.want(Stop(), 3.0)
        assert pair.at_rest()
        assert pair.sent[-1].abort
        assert not pair.session.stopped

    def test_a_late_slew_is_stopped_again(self) -> None:
        """The mount ignores the counter: an overtaken datagram is an edge, though a stop came after it."""
        pair = played(STATES["stopped"], CLEAN, 0)
        late = Command(counter=3, slew=True, target_ra_h=pair.home.ra_deg / 15, target_dec_deg=-20.0)
        pair.mount.receive(encode_command(late))
        pair.mount.tick(pair.now + PERIOD_S / 2)
        pair.run(1.0 + SETTLING_S)
        assert pair.at_rest()
        pair.run(SEEN_S)
        assert pair.session.stopped

    def test_a_mount_restarted_while_stopping_is_at_rest_or_on_the_sky(self) -> None:
        pair = played(STATES["moving"], CLEAN, 0)
        pair.want(Stop(), PERIOD_S)
        pair.restart_mount()
        pair.run(3.0)
        assert pair.at_rest() or pair.on_the_sky()
        assert pair.session.health.restarts == 1


RATES = st.sampled_from((-1.5, -0.2, 0.01, 0.7, 1.5))
PLACES = st.tuples(st.integers(-15, 15).map(float), st.integers(-15, 15).map(float))
MOTIONS = st.one_of(st.just(Hold()), st.just(Stop()), st.builds(MoveAxes, RATES, RATES), PLACES)
PROGRAMS = st.lists(st.tuples(MOTIONS, st.integers(1, 25)), max_size=6)
LINKS = st.sampled_from((CLEAN, LAGGING, LOSSY, ROUGH))
SEEDS = st.integers(0, 2**32)


class TestTheLastMotionWins:
    """Whatever was wanted before, and however the wires treated it."""

    @given(program=PROGRAMS, wires=LINKS, seed=SEEDS)
    @settings(max_examples=20, deadline=None, derandomize=True)
    def test_stop(self, program: Program, wires: Wires, seed: int) -> None:
        pair = played(program, wires, seed)
        pair.want(Stop(), 5.0)
        for _ in range(40):
            assert pair.at_rest()
            assert pair.session.stopped
            pair.step()

    @given(program=PROGRAMS, place=PLACES, wires=LINKS, seed=SEEDS)
    @settings(max_examples=15, deadline=None, derandomize=True)
    def test_slew(
        self,
        program: Program,
        place: tuple[float, float],
        wires: Wires,
        seed: int,
    ) -> None:
        pair = played(program, wires, seed)
        target = pair.place(*place)
        pair.want(target)
        pair.until(pair.is_done, 25.0)
        assert pair.off_deg(target) < 1e-2
        pair.run(1.0)
        assert pair.off_deg(target) < 1e-4
        assert pair.on_the_sky()

    @given(program=PROGRAMS, wires=LINKS, seed=SEEDS)
    @settings(max_examples=15, deadline=None, derandomize=True)
    def test_move(self, program: Program, wires: Wires, seed: int) -> None:
        pair = played(program, wires, seed)
        pair.want(MoveAxes(-0.8, 0.4), 12.0)
        for _ in range(20):
            assert pair.truth.ra_rate_deg_s == pytest.approx(-0.8, abs=1e-3)
            assert pair.truth.dec_rate_deg_s == pytest.approx(0.4, abs=1e-3)
            pair.step()

    @given(program=PROGRAMS, wires=LINKS, seed=SEEDS)
    @settings(max_examples=15, deadline=None, derandomize=True)
    def test_hold(self, program: Program, wires: Wires, seed: int) -> None:
        pair = played(program, wires, seed)
        pair.want(Hold(), 12.0)
        for _ in range(20):
            assert pair.on_the_sky() or pair.at_rest()
            assert not pair.status.slewing
            pair.step()


class TestMove:
    @ALL_WIRES
    @seeds(3)
    def test_streamed_rates_arrive(self, wires: Wires, seed: int) -> None:
        pair = Pair(wires, seed)
        for turn in range(100):
            pair.want(MoveAxes(-0.01 * turn, 0.005 * turn), PERIOD_S)
        pair.run(1.0)
        assert pair.truth.ra_rate_deg_s == pytest.approx(-0.99, abs=1e-3)
        assert pair.truth.dec_rate_deg_s == pytest.approx(0.495, abs=1e-3)
        moved = [status.ack_move_ra for status in pair.said]
        first = moved.index(True)
        assert wires is ROUGH or all(moved[first:])

    def test_a_restarted_mount_goes_on_moving(self) -> None:
        pair = Pair()
        pair.want(MOVE, 2.0)
        pair.restart_mount()
        pair.run(1.0)
        assert pair.drive_rates() == pytest.approx((-2.0 - SIDEREAL_DEG_S, 1.5), abs=1e-3)
        assert pair.session.health.restarts == 1
        assert pair.session.sample is not None
        assert pair.session.sample.counter == pair.status.counter

    def test_a_slew_interrupted_by_a_restart_is_not_done_elsewhere(self) -> None:
        pair = Pair()
        place = pair.place(40.0, 10.0)
        pair.want(place, 2.0)
        pair.restart_mount()
        for _ in range(200):
            pair.step()
            assert not pair.is_done() or pair.off_deg(place) < 1e-2

    def test_a_new_client_ends_the_moveaxis_of_the_old(self) -> None:
        pair = Pair()
        pair.want(MOVE, 2.0)
        pair.session = Session(PROFILE)
        pair.run(2 / 10 + SETTLING_S)
        assert pair.on_the_sky()

    def test_a_new_client_stops_the_slew_of_the_old(self) -> None:
        pair = Pair()
        pair.want(pair.place(*FAR), 1.5)
        pair.session = Session(PROFILE)
        pair.want(Stop(), 1.0 + 2 * PERIOD_S + SETTLING_S)
        assert pair.at_rest()
        pair.run(SEEN_S)
        assert pair.session.stopped

    @pytest.mark.parametrize("turns", range(1, 4))
    def test_a_new_client_stops_while_the_flag_of_the_old_is_in_the_mailbox(self, turns: int) -> None:
        pair = played(STATES["slewing"], CLEAN, 0)
        pair.want(Stop(), PERIOD_S)
        pair.session = Session(PROFILE)
        pair.want(Stop(), turns * PERIOD_S)
        pair.run(1.0 + SETTLING_S)
        assert pair.at_rest()
        pair.run(SEEN_S)
        assert pair.session.stopped


class TestAccounts:
    @seeds(4)
    def test_all_datagrams_are_accounted_for(self, seed: int) -> None:
        pair = Pair(LOSSY, seed)
        pair.want(MOVE, 10.0)
        health = pair.session.health
        assert health.sent == len(pair.sent)
        assert [command.counter for command in pair.sent] == list(
            range(pair.sent[0].counter, pair.sent[0].counter + len(pair.sent))
        )
        assert pair.session.status is not None
        first_heard = pair.session.status.counter - (health.received + health.lost) + 1
        assert 1 <= first_heard <= 10
        assert health.duplicate > 0
        assert (health.late, health.rejected, health.restarts) == (0, 0, 0)

    @seeds(4)
    def test_reordered_statuses_are_no_restart(self, seed: int) -> None:
        pair = Pair(ROUGH, seed)
        pair.want(MOVE, 10.0)
        health = pair.session.health
        assert health.late > 0
        assert (health.rejected, health.restarts) == (0, 0)

    @given(
        noise=st.lists(
            st.tuples(
                spoilt(encode_command(Command(abort=True, slew=True, move_ra=True, move_ra_rate_deg_s=1.0))),
                spoilt(encode_status(Status(counter=5, ack_abort=True, ack_slew=True))),
            ),
            min_size=1,
            max_size=20,
        )
    )
    @settings(max_examples=10, deadline=None)
    def test_noise_on_the_wires_changes_nothing(self, noise: list[tuple[bytes, bytes]]) -> None:
        quiet, noisy = Pair(), Pair()
        turns = 0
        for motion in (quiet.place(2.0, 1.0), MOVE, Stop(), Hold()):
            for pair in (quiet, noisy):
                want(pair.session, motion)
            for _ in range(20):
                to_mount, to_client = noise[turns % len(noise)]
                turns += 1
                quiet.step()
                noisy.mount.receive(to_mount)
                noisy.session.receive(to_client, noisy.now)
                noisy.step()
        assert noisy.sent == quiet.sent
        assert noisy.said == quiet.said
        assert noisy.mount.refused == turns
        assert noisy.session.health.rejected == turns

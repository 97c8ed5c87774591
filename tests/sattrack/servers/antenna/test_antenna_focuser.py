"""Real focusers behind ASCOM Alpaca: a stand-in by the reference on the other side."""

from __future__ import annotations

import math
import select
import time
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from alpaca_stand_in import StandIn, StandInFocuser
from antenna_setup import NOON_NS

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.alpaca.client import AlpacaRefusalError
from sattrack.servers.antenna.alpaca_focuser import (
    AlpacaAxis,
    FocuserConfig,
    FocuserDriver,
    FocuserError,
    focuser_at,
    parse_focuser,
    start_focusers,
)
from sattrack.servers.antenna.equipment import FocusAxisState, Focuser, FocusOrder, RemoteAxis
from sattrack.servers.antenna.protocol import NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TURN_S = 0.1
Make = "Callable[..., tuple[AlpacaAxis, StandInFocuser, Time]]"


class Time:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def make() -> Iterator[Callable[..., tuple[AlpacaAxis, StandInFocuser, Time]]]:
    opened: list[StandIn] = []

    def build(
        step_um: float | None = None, zero_step: int = 0, **has: object
    ) -> tuple[AlpacaAxis, StandInFocuser, Time]:
        clock = Time()
        focuser = StandInFocuser(clock, **has)  # type: ignore[arg-type]
        stand_in = StandIn(focuser)
        opened.append(stand_in)
        config = FocuserConfig(stand_in.address, 0, step_um, zero_step)
        return AlpacaAxis(focuser_at(config), config), focuser, clock

    yield build
    for stand_in in opened:
        stand_in.close()


def run(axis: AlpacaAxis, clock: Time, seconds: float) -> list[tuple[float, bool]]:
    told = []
    for _ in range(round(seconds / TURN_S)):
        told.append(axis.turn(clock.now_s))
        clock.now_s += TURN_S
    return told


def test_steps_are_millimetres_by_their_size_and_the_step_that_is_zero(make: Make) -> None:
    axis, _, clock = make(zero_step=4000)
    axis.connect()
    # Steps of 2 µm, from 0 to 10,000, standing at 5000.
    assert axis.limits_mm == pytest.approx((-8.0, 12.0))
    assert axis.turn(clock.now_s) == (pytest.approx(2.0), False)


def test_it_goes_to_a_place_and_tells_when_it_stands_there(make: Make) -> None:
    axis, focuser, clock = make()
    axis.connect()
    axis.begin(FocusOrder(1, to_mm=12.0), clock.now_s)
    told = run(axis, clock, 2.0)
    # 1000 steps of 2 µm at 1000 steps a second.
    assert told[0] == (10.0, True)
    assert told[5] == (pytest.approx(11.0), True)
    assert told[-1] == (12.0, False)
    assert focuser.moves == [6000]


def test_a_move_longer_than_one_increment_is_made_in_several(make: Make) -> None:
    axis, focuser, clock = make(max_increment=300)
    axis.connect()
    axis.begin(FocusOrder(1, to_mm=12.0), clock.now_s)
    told = run(axis, clock, 3.0)
    assert focuser.moves == [5300, 5600, 5900, 6000]
    assert told[-1] == (12.0, False)


def test_places_beyond_its_reach_are_come_near_to(make: Make) -> None:
    axis, focuser, clock = make()
    axis.connect()
    axis.begin(FocusOrder(1, to_mm=1e4), clock.now_s)
    run(axis, clock, 6.0)
    assert focuser.moves == [10_000]


def test_a_sweep_is_uniform_and_turns_at_both_limits(make: Make) -> None:
    axis, focuser, clock = make(max_step=6000)
    axis.connect()
    axis.begin(FocusOrder(1, sweep_mm_s=1.0), clock.now_s)
    told = [mm for mm, _ in run(axis, clock, 20.0)]
    # 10 mm up to 12 mm in 2 s, then down to 0 mm in 12 s, and up again for 6 s.
    for at_s, mm in ((1.0, 11.0), (4.0, 10.0), (8.0, 6.0), (12.0, 2.0), (17.0, 3.0)):
        assert told[round(at_s / TURN_S)] == pytest.approx(mm, abs=0.11)
    assert max(focuser.moves) == 6000
    assert min(focuser.moves) < 60
    rates = [abs(b - a) / TURN_S for a, b in pairwise(told[30:130])]
    assert max(rates) < 1.5
    assert min(rates) > 0.5


def test_a_stop_halts_it_and_ends_a_sweep(make: Make) -> None:
    axis, focuser, clock = make()
    axis.connect()
    axis.begin(FocusOrder(1, sweep_mm_s=1.0), clock.now_s)
    run(axis, clock, 1.0)
    axis.begin(FocusOrder(2), clock.now_s)
    stood = axis.turn(clock.now_s)[0]
    moves = len(focuser.moves)
    told = run(axis, clock, 1.0)
    assert told[-1] == (stood, False)
    assert len(focuser.moves) == moves


def test_what_cannot_halt_is_told_to_go_where_it_is(make: Make) -> None:
    axis, focuser, clock = make(halts=False)
    axis.connect()
    axis.begin(FocusOrder(1, to_mm=20.0), clock.now_s)
    run(axis, clock, 1.0)
    axis.begin(FocusOrder(2), clock.now_s)
    assert focuser.moves == [10_000, 6000]
    assert run(axis, clock, 1.0)[-1] == (12.0, False)


def test_a_focuser_without_positions_is_of_no_use(make: Make) -> None:
    axis, _, _ = make(absolute=False)
    with pytest.raises(FocuserError, match="knows no positions"):
        axis.connect()


@pytest.mark.parametrize("reported", [None, 0.0, math.nan])
def test_the_size_of_a_step_may_have_to_be_given(make: Make, reported: float | None) -> None:
    axis, _, _ = make(step_size=reported)
    with pytest.raises(FocuserError, match=r"\?step="):
        axis.connect()
    axis, _, clock = make(step_um=4.0, step_size=reported)
    axis.connect()
    assert axis.turn(clock.now_s)[0] == pytest.approx(20.0)


def test_what_the_focuser_refuses_is_told_and_it_is_taken_up_anew(make: Make) -> None:
    axis, focuser, clock = make()
    told: list[FocusAxisState] = []
    worker = FocuserDriver(axis.focuser, axis.config, told.append)
    worker.turn([], clock.now_s)
    focuser.max_step = 5500
    worker.turn([FocusOrder(1, to_mm=18.0)], clock.now_s)
    assert told[-1].mm is None
    assert told[-1].trouble.startswith("Position 9000 is out of range")
    worker.turn([], clock.now_s + 1.0)
    assert len(told) == 2
    worker.turn([], clock.now_s + 2.1)
    assert (told[-1].mm, told[-1].moving, told[-1].serial) == (10.0, False, 1)
    assert told[-1].most_mm == pytest.approx(11.0)


def test_an_order_that_finds_no_focuser_is_not_obeyed_later(make: Make) -> None:
    axis, focuser, clock = make()
    told: list[FocusAxisState] = []
    there, axis.focuser.server = axis.focuser.server, "127.0.0.1:9"
    worker = FocuserDriver(axis.focuser, axis.config, told.append)
    worker.turn([FocusOrder(1, to_mm=18.0)], clock.now_s)
    assert (told[-1].mm, told[-1].serial, told[-1].trouble) == (None, 1, "nothing listens there")
    axis.focuser.server = there
    worker.turn([], clock.now_s + 5.0)
    assert (told[-1].mm, told[-1].moving, told[-1].serial) == (10.0, False, 1)
    assert focuser.moves == []


def test_the_stand_in_keeps_to_its_own_limits(make: Make) -> None:
    axis, _, _ = make()
    axis.connect()
    with pytest.raises(AlpacaRefusalError, match="0x401"):
        axis.focuser.put("move", Position="10001")


def test_an_order_counts_as_moving_until_it_has_been_taken_up() -> None:
    axis = RemoteAxis(-8.0, 12.0)
    focuser = Focuser([axis])
    axis.hear(FocusAxisState(0.0, 2.0, moving=False, serial=0), NOON_NS)
    assert focuser.report(NOON_NS + 1) == (((None, 2.0, NOON_NS, False),), NOON_NS, False)
    axis.move(50.0, NOON_NS)
    assert axis.orders == [FocusOrder(1, to_mm=12.0)]
    assert focuser.report(NOON_NS + 1) == (((12.0, 2.0, NOON_NS, True),), NOON_NS, True)
    axis.hear(FocusAxisState(0.0, 12.0, moving=False, serial=1), NOON_NS + 2)
    assert focuser.report(NOON_NS + 3) == (((12.0, 12.0, NOON_NS + 2, False),), NOON_NS + 2, False)


def test_a_place_heard_long_ago_is_not_told() -> None:
    axis = RemoteAxis(-8.0, 12.0)
    focuser = Focuser([axis])
    axis.hear(FocusAxisState(0.0, 2.0, moving=False, serial=0), NOON_NS)
    later_ns = NOON_NS + 4 * NS
    assert not focuser.known(later_ns)
    assert focuser.report(later_ns) == (((None, None, NOON_NS, True),), later_ns, True)


@pytest.mark.parametrize(
    ("url", "config"),
    [
        ("alpaca://focus.example:11111/0", FocuserConfig("focus.example:11111", 0)),
        ("alpaca://10.0.0.7:80/2?step=0.5&zero=-300", FocuserConfig("10.0.0.7:80", 2, 0.5, -300)),
    ],
)
def test_a_focusers_address_is_read(url: str, config: FocuserConfig) -> None:
    assert parse_focuser(url) == config


@pytest.mark.parametrize(
    "url",
    [
        "alpaca://host/0",
        "alpaca://host:1/",
        "alpaca://host:1/-1",
        "http://host:1/0",
        "alpaca://host:99999/0",
        "alpaca://host:1/0?step=0",
        "alpaca://host:1/0?step=nan",
        "alpaca://host:1/0?colour=red",
        "4.5",
    ],
)
def test_an_address_that_cannot_be_meant_is_told(url: str) -> None:
    with pytest.raises(BadInputError, match="write a number, or alpaca://HOST:PORT/DEVICE"):
        parse_focuser(url)


def test_a_focuser_that_is_not_there_is_told_at_the_start() -> None:
    with pytest.raises(SattrackError, match=r"device 0: nothing listens there"):
        start_focusers([FocuserConfig("127.0.0.1:9", 0)])


def test_a_focuser_is_driven_by_its_process_and_halted_at_the_end() -> None:
    stand_in = StandIn(StandInFocuser(time.monotonic, steps_a_second=500.0))
    focus = start_focusers([FocuserConfig(stand_in.address, 0)])
    try:
        focus.focuser.axes[0].move(20.0, 0)
        deadline_s = time.monotonic() + 30.0

        def at_ns() -> int:
            return round(time.monotonic() * NS)

        while (focus.focuser.report(at_ns()).axes[0].actual_mm or 0.0) <= 10.0:
            assert select.select([focus.parts[0].running.channel], [], [], deadline_s - time.monotonic())[0]
            assert focus.exchange(lambda monotonic_s: round(monotonic_s * NS)) == []
        report = focus.focuser.report(at_ns())
        assert report.moving
        assert report.axes[0].commanded_mm == 20.0
        assert 0 <= at_ns() - report.epoch_ns < 3 * NS
    finally:
        focus.close()
    assert stand_in.focuser.where() < 10_000
    assert not stand_in.focuser.get("ismoving")
    stand_in.close()

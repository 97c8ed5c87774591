"""The mount's side of an Alpaca telescope: slews past what is in the way, trouble, drifts, and the end."""

from __future__ import annotations

import pytest
from alpaca_stand import PROFILE, VirtualTelescope
from antenna_harness import START
from msgspec.structs import replace

from sattrack.mount.model import PierZone
from sattrack.mount.requests import Abort
from sattrack.servers.alpaca.protocol import Answered, Fault, MoveOrder, Number, NumberedOrder
from sattrack.servers.alpaca.serve import AlpacaHttpProcess

WALL = PierZone("wall", ((10.0, -20.0), (30.0, -20.0), (30.0, 35.0), (10.0, 35.0)))


def test_a_slew_goes_round_what_is_in_its_way_and_is_one_slew_to_its_client() -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, pier_zones=(WALL,)))
    ra_h = (scope.get("siderealtime") + 1.0) % 24.0
    begun = len(scope.truths)
    scope.put("slewtocoordinatesasync", RightAscension=ra_h, Declination=15.0)
    doing = set()
    while scope.get("slewing"):
        assert scope.telescope.state is not None
        doing.add(scope.telescope.state.doing)
        scope.run_for(0.1)
    assert "slewing round what is in the way" in doing
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1e-3)
    # The straight way from hour angle 50° to -15° at declination 15° leads through the wall.
    for truth in scope.truths[begun:]:
        assert not (10.0 < truth.hour_angle_axis_deg < 30.0 and -20.0 < truth.dec_axis_deg < 35.0)
    assert (
        scope.fault_of(
            "slewtocoordinatesasync",
            RightAscension=(scope.get("siderealtime") - 20.0 / 15.0) % 24.0,
            Declination=0.0,
        )
        is Number.INVALID_OPERATION
    )


def test_a_slew_in_mid_move_stops_the_move_first_and_then_goes_its_way() -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, pier_zones=(WALL,)))
    scope.put("moveaxis", Axis=1, Rate=4.0)
    scope.run_for(1.0)
    ra_h = (scope.get("siderealtime") + 1.0) % 24.0
    scope.put("slewtocoordinates", RightAscension=ra_h, Declination=15.0)
    assert scope.get("rightascension") == pytest.approx(ra_h, abs=1e-3)
    assert scope.get("declination") == pytest.approx(15.0, abs=1e-2)
    scope.put("moveaxis", Axis=1, Rate=1.0)
    scope.put("park")
    scope.wait_while("slewing")
    assert scope.get("atpark") is True


def test_a_mount_that_falls_silent_in_mid_move_is_stopped_and_its_clients_are_told() -> None:
    scope = VirtualTelescope()
    scope.put("moveaxis", Axis=1, Rate=1.0)
    scope.run_for(1.0)
    scope.silent_until_s = scope.now_utc_s + 4.0
    scope.run_for(8.0)
    stands = scope.truths[-1].dec_deg
    scope.run_for(2.0)
    assert scope.truths[-1].dec_deg == stands
    with pytest.raises(Fault, match="silent"):
        scope.get("slewing")
    assert any("silent" in words for words in scope.station.log_lines)
    assert scope.fault_of("moveaxis", Axis=1, Rate=1.0) is Number.OK
    assert scope.get("slewing") is True


def test_a_stop_goes_out_to_a_mount_that_is_not_heard() -> None:
    scope = VirtualTelescope()
    scope.put("slewtocoordinatesasync", RightAscension=scope.get("siderealtime"), Declination=60.0)
    scope.run_for(1.0)
    scope.silent_until_s = scope.now_utc_s + 1e9
    scope.run_for(2.6)
    assert scope.get_fault("slewing") is Number.DRIVER
    assert scope.put("abortslew") is None
    scope.run_for(3.0)
    stands = scope.truths[-1].dec_deg
    assert stands < 59.0
    scope.run_for(2.0)
    assert scope.truths[-1].dec_deg == stands


@pytest.mark.parametrize("moving", ["nothing", "slew", "moveaxis"])
def test_once_slewing_falls_after_an_abort_another_motion_can_begin(moving: str) -> None:
    scope = VirtualTelescope()
    if moving == "slew":
        scope.put("slewtocoordinatesasync", RightAscension=scope.get("siderealtime"), Declination=60.0)
    if moving == "moveaxis":
        scope.put("moveaxis", Axis=0, Rate=2.0)
    scope.run_for(1.0)
    scope.put("abortslew")
    assert scope.get("slewing") is True
    until_s = scope.now_utc_s + 10.0
    # Looks oftener than datagrams go: the abort is settled a tick after the mount is seen at rest.
    while scope.get("slewing"):
        assert scope.now_utc_s < until_s
        scope.run_for(0.005)
    assert scope.fault_of("findhome") is Number.OK


def test_an_offset_rate_that_drifts_to_a_limit_is_ended_and_told() -> None:
    low = replace(START, hour_angle_deg=76.0, dec_deg=-5.0)
    scope = VirtualTelescope(start=low)
    assert scope.get("altitude") < 10.0
    scope.put("declinationrate", DeclinationRate=-300.0)
    scope.run_for(100.0)
    assert scope.get("altitude") > -1.0
    with pytest.raises(Fault, match="limit"):
        scope.get("slewing")
    scope.put("abortslew")
    scope.run_for(2.0)
    assert scope.get("slewing") is False
    assert scope.get("declinationrate") == 0.0


@pytest.mark.parametrize("moving", ["moveaxis", "slew", "offset", "nothing"])
def test_at_the_end_of_the_service_what_moves_is_stopped_and_seen_at_rest(moving: str) -> None:
    scope = VirtualTelescope()
    if moving == "moveaxis":
        scope.put("moveaxis", Axis=0, Rate=2.0)
    if moving == "slew":
        scope.put("slewtocoordinatesasync", RightAscension=scope.get("siderealtime"), Declination=60.0)
    if moving == "offset":
        scope.put("declinationrate", DeclinationRate=100.0)
    scope.run_for(1.0)
    scope.station.end(scope.now_utc_s)
    assert scope.fault_of("moveaxis", Axis=0, Rate=1.0) is Number.INVALID_OPERATION
    until_s = scope.now_utc_s + 20.0
    while not scope.station.finished:
        assert scope.now_utc_s < until_s
        scope.run_for(0.05)
    assert scope.station.mount_stopped is (None if moving == "nothing" else True)
    before = scope.truths[-1].dec_deg
    scope.run_for(1.0)
    assert scope.truths[-1].dec_deg == pytest.approx(before, abs=1e-6)


@pytest.mark.parametrize("late_s", [0.5, 0.9])
@pytest.mark.parametrize("late", ["the server", "the mount"])
def test_rest_at_the_end_of_the_service_is_seen_though_one_side_is_held_up_just_then(
    late: str, late_s: float
) -> None:
    scope = VirtualTelescope(profile=replace(PROFILE, period_s=0.1))
    scope.put("moveaxis", Axis=0, Rate=2.0)
    scope.run_for(1.0)
    scope.station.end(scope.now_utc_s)
    until_s = scope.now_utc_s + 10.0
    while not scope.station.session.stopped:
        assert scope.now_utc_s < until_s
        scope.run_for(0.01)
    if late == "the mount":
        scope.silent_until_s = scope.now_utc_s + late_s
    else:
        # Once it has seen the first of the rest.
        scope.run_for(0.1)
        scope.held_up_s = late_s
    while not scope.station.finished:
        assert scope.now_utc_s < until_s
        scope.run_for(0.05)
    assert scope.station.mount_stopped is True


def test_a_mount_that_was_parked_and_is_started_anew_is_parked_no_more() -> None:
    scope = VirtualTelescope()
    scope.put("park")
    scope.wait_while("slewing")
    assert scope.get("atpark") is True
    scope._wires.mount.restart(scope.now_utc_s)
    scope.run_for(5.0)
    assert scope.get("atpark") is False
    assert scope.get("tracking") is True
    assert scope.fault_of("moveaxis", Axis=1, Rate=1.0) is Number.OK


class NoProcess:
    """Stands for a process that is not there."""


def process_with(*asked: NumberedOrder) -> AlpacaHttpProcess:
    process = AlpacaHttpProcess(None, NoProcess())  # type: ignore[arg-type]
    process._orders.extend(asked)
    return process


def test_one_order_is_obeyed_a_period_and_a_stop_goes_before_all_that_wait() -> None:
    moves = [NumberedOrder(number, MoveOrder(0, 1.0)) for number in (1, 2, 3)]
    process = process_with(*moves, NumberedOrder(4, Abort()), NumberedOrder(5, MoveOrder(1, 1.0)))
    asked, void = process.next_order()
    assert asked == NumberedOrder(4, Abort())
    assert void == [
        Answered(number, Number.CANCELLED, "AbortSlew came before it had begun") for number in (1, 2, 3)
    ]
    assert process.next_order() == (NumberedOrder(5, MoveOrder(1, 1.0)), [])
    process = process_with(*moves)
    assert process.next_order() == (moves[0], [])
    assert process.next_order() == (None, [])
    process.begin_period(0.05)
    assert process.next_order() == (moves[1], [])


def test_an_order_that_took_long_lets_datagrams_go_first_for_a_while_and_a_stop_does_not_wait() -> None:
    process = process_with(*(NumberedOrder(number, MoveOrder(0, 1.0)) for number in (1, 2)))
    process.next_order()
    process.took(0.4, 10.0)
    process.begin_period(13.5)
    assert process.next_order() == (None, [])
    process._orders.append(NumberedOrder(3, Abort()))
    assert process.next_order()[0] == NumberedOrder(3, Abort())
    process._orders.append(NumberedOrder(4, MoveOrder(0, 1.0)))
    process.begin_period(13.7)
    assert process.next_order() == (NumberedOrder(4, MoveOrder(0, 1.0)), [])

"""What the gate lets through at its bounds: requests by hand, ramps, ages, and what counts as in force."""

from __future__ import annotations

import math
from typing import Any, Literal

import pytest
from msgspec.structs import replace

from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    PierZone,
    Seen,
    Slew,
    Stance,
    Stop,
    mean_sidereal_deg,
)
from sattrack.mount.requests import FineRate, MoveAxis, PulseGuide, Request
from sattrack.safety import Safety, SafetyLimits
from sattrack.safety.bodies import sun_over
from sattrack.safety.bounds import Bounds
from sattrack.safety.geometry import AxesState, Place, axis_rates
from sattrack.safety.rate_limit import Ahead, Spot, nearest_rates

S = SIDEREAL_RATE_DEG_S
LATITUDE_DEG, T0 = 52.0, 1_790_000_000.0
DARK = SafetyLimits(floor_altitude_deg=-90.0, optical=False)
PROFILE = MountProfile(hour_angle_limit_deg=40.0, dec_axis_limits_deg=(-50.0, 130.0))
SIDEREAL_DEG = 100.0


def gate(holds: bool = False, profile: MountProfile = PROFILE, fault_s: float = 1.0) -> Safety:
    return Safety(profile, replace(DARK, longest_fault_s=fault_s), LATITUDE_DEG, holds=holds)


def refuses(request: Request, ha_deg: float, dec_deg: float, beyond_pole: bool = False) -> bool:
    """Tell whether a request is refused with the axes at a place, beyond the pole by half a turn."""
    ra_deg = SIDEREAL_DEG - ha_deg + (180.0 if beyond_pole else 0.0)
    stance = Stance(SIDEREAL_DEG, ra_deg % 360.0, dec_deg, False, True, beyond_pole)
    return isinstance(gate().clear_request(request, stance, T0), str)


@pytest.mark.parametrize(
    ("request_", "axis", "sense", "way_deg"),
    [
        # Fine rates for half a minute, pulses for as long as they last, at no more than the sky's own rate.
        (FineRate(0.0, 0.0), 0, 1.0, 30.0 * S),
        (FineRate(0.04, 0.0), 0, 1.0, 30.0 * (S + 0.04)),
        (FineRate(-0.04, 0.0), 0, -1.0, 30.0 * (0.04 - S)),
        (FineRate(0.0, 0.02), 1, 1.0, 0.6),
        (FineRate(0.0, -0.02), 1, -1.0, 0.6),
        # Motions for the latency, 0.2004 s, and the longest fault; then they brake.
        (MoveAxis(None, -1.0), 1, -1.0, 1.2004 + 1.0 / 16.0),
        (MoveAxis(-1.0, None), 0, 1.0, 1.2004 * (1.0 + S) + (1.0 + S) ** 2 / 16.0),
        (PulseGuide(60_000, 0), 0, 1.0, 120.0 * S),
        (PulseGuide(60_000, 120_000), 0, 1.0, 180.0 * S),
        (PulseGuide(60_000, 120_000), 1, 1.0, 120.0 * S),
        (PulseGuide(120_000, -60_000), 1, -1.0, 60.0 * S),
        (PulseGuide(0, 60_000), 0, 1.0, 60.0 * S),
    ],
    ids=repr,
)
def test_what_drifts_to_a_limit_is_refused_from_its_way_and_its_margin_on(
    request_: Request, axis: int, sense: float, way_deg: float
) -> None:
    end_deg = ((-40.0, 40.0), (-50.0, 130.0))[axis][int(sense > 0.0)]
    for more_deg, refused in ((-0.002, True), (0.002, False)):
        at_deg = end_deg - sense * (0.1 + way_deg + more_deg)
        if axis == 0:
            assert refuses(request_, at_deg, 0.0) == refused
        elif at_deg <= 90.0:
            assert refuses(request_, 0.0, at_deg) == refused
        else:
            # Past the pole the reported declination falls while the axis turns on.
            turned = replace(request_, **{
                name: -getattr(request_, name) for name in ("dec_deg_s", "dec_ms") if hasattr(request_, name)
            })  # fmt: skip
            assert refuses(turned, 0.0, 180.0 - at_deg, True) == refused


def test_an_axis_that_is_not_asked_for_goes_with_the_sky() -> None:
    for ha_deg, request_, refused in (
        (-39.85, MoveAxis(None, 1.0), False),
        (39.85, MoveAxis(None, 1.0), False),
        (-39.85, MoveAxis(1.0, None), True),
        (39.85, MoveAxis(-1.0, None), True),
        (-39.85, MoveAxis(-1.0, None), False),
    ):
        assert refuses(request_, ha_deg, 0.0) == refused
    for dec_deg, request_, refused in (
        (-49.85, MoveAxis(1.0, None), False),
        (-49.85, MoveAxis(None, -1.0), True),
    ):
        assert refuses(request_, 0.0, dec_deg) == refused


@pytest.mark.parametrize("beyond_pole", [False, True])
def test_rates_of_axes_are_those_of_the_hour_angle_and_of_the_axis_declination(beyond_pole: bool) -> None:
    sense = -1.0 if beyond_pole else 1.0
    assert axis_rates(MoveAxes(0.3, 0.2), beyond_pole) == (S - 0.3, sense * 0.2)


def sent(
    safety: Safety, wish: MoveAxes, utc_s: float | None, dec_deg: float = 0.0, age_s: float = 0.0
) -> tuple[float, float]:
    """Clear a wish on the meridian; return the rates of the axes that come out."""
    motion = safety.clear(wish, SIDEREAL_DEG, SIDEREAL_DEG, dec_deg, age_s, utc_s).motion
    assert isinstance(motion, MoveAxes)
    return S - motion.ra_rate_deg_s, motion.dec_rate_deg_s


@pytest.mark.parametrize(
    ("swung_deg_s", "periods", "near_deg", "goes"),
    [
        # In the latency, 0.2004 s, at 2 °/s 0.4 degrees, and 0.2 until it stands.
        (2.0, 2, 0.59, False),
        (2.0, 2, 0.62, True),
        (2.0, 59, 0.59, False),
        (2.0, 62, 0.59, True),
        (-2.0, 59, 0.59, False),
        (0.9, 2, 0.22, True),
        (1.1, 2, 0.28, False),
    ],
)
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_axes_that_moved_unlike_what_they_were_sent_keep_that_much_farther_from_a_limit_for_a_while(
    axis: int, sense: float, swung_deg_s: float, periods: int, near_deg: float, goes: bool
) -> None:
    """At rest for half a second, to and fro for two statuses each, at rest until rates are asked for."""
    safety = gate(True, replace(PROFILE, dec_axis_limits_deg=(-40.0, 40.0)), fault_s=0.1)
    at_deg, motion = [0.0, 0.0], MoveAxes(S, 0.0)
    at_deg[axis] = sense * (40.0 - 0.1 - near_deg)
    for k in range(14 + periods):
        at_deg[axis] += 0.05 * swung_deg_s * (float(k in (10, 11)) - float(k in (12, 13)))
        sidereal_deg, utc_s = SIDEREAL_DEG + 0.05 * k * S, T0 + 0.05 * k
        at = sidereal_deg, sidereal_deg - at_deg[0], at_deg[1]
        safety.watch(Seen(utc_s, *at), MoveAxes(S, 0.0))
        if k == 13 + periods:
            motion = MoveAxes(S - 0.5 * sense, 0.0) if axis == 0 else MoveAxes(S, 0.5 * sense)
        cleared = safety.clear(motion, *at, 0.0, utc_s).motion
    assert (cleared == motion) == goes
    if not goes:
        assert isinstance(cleared, MoveAxes)
        assert (cleared.ra_rate_deg_s, cleared.dec_rate_deg_s) == pytest.approx((S, 0.0))


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_stream_steps_by_twice_what_the_axes_can_do_since_the_last_and_slows_at_once(sense: float) -> None:
    """10 °/s² make 0.5 °/s in a period; what came sooner than that counts as one."""
    for later_s, step in ((0.05, 1.0), (0.02, 1.0), (0.1, 2.0), (0.15, 3.0)):
        for axis in (0, 1):
            safety = gate(holds=True)
            assert sent(safety, MoveAxes(S, 0.0), T0) == (0.0, 0.0)
            fast = MoveAxes(S - 4.0 * sense, 0.0) if axis == 0 else MoveAxes(S, 4.0 * sense)
            assert sent(safety, fast, T0 + later_s)[axis] == pytest.approx(sense * step, abs=1e-4)
            assert sent(safety, fast, T0 + later_s + 0.05)[axis] == pytest.approx(
                sense * min(4.0, step + 1.0)
            )
            assert sent(safety, MoveAxes(S, 0.0), T0 + later_s + 0.1) == pytest.approx((0.0, 0.0))
            # Through rest, a step in the other direction is one from rest.
            assert sent(safety, fast, T0 + later_s + 0.15)[axis] == pytest.approx(sense, abs=1e-4)
            back = MoveAxes(S + 4.0 * sense, 0.0) if axis == 0 else MoveAxes(S, -4.0 * sense)
            assert sent(safety, back, T0 + later_s + 0.2)[axis] == pytest.approx(-sense, abs=1e-4)
    # Where nobody knows when, there is no ramp.
    for safety in (gate(), gate(holds=True)):
        sent(safety, MoveAxes(S, 0.0), None)
        assert sent(safety, MoveAxes(S, 4.0), None)[1] == pytest.approx(4.0)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_by_hand_rates_grow_by_half_of_what_the_axes_can_do_and_fall_at_once(axis: int, sense: float) -> None:
    """10 °/s² make 0.25 °/s a period, however often rates are cleared in it."""
    safety = gate()
    rates = (sense, 0.0) if axis == 0 else (0.0, sense)
    fast, back = (MoveAxes(S - far * rates[0], far * rates[1]) for far in (1.0, -1.0))
    for k in range(8):
        for _ in range(2):
            found = sent(safety, fast, T0 + 0.05 * k)
            assert found[axis] == pytest.approx(sense * min(1.0, 0.25 * (k + 1)), abs=1e-4)
            assert found[1 - axis] == pytest.approx(0.0, abs=1e-9)
    assert sent(safety, back, T0 + 0.4)[axis] == pytest.approx(-sense * 0.25, abs=1e-4)
    assert sent(safety, MoveAxes(S, 0.0), T0 + 0.45)[axis] == 0.0
    # A clock that is set back gives no room.
    assert sent(safety, fast, T0)[axis] == 0.0


def test_by_hand_the_rate_that_is_grown_to_is_judged_from_the_first_datagram_on() -> None:
    """At 4 °/s it comes 4.8 + 0.8 + 0.1° on its way; what is sent first is 0.25 °/s."""
    for more_deg in (-0.2, 0.2):
        safety = gate()
        at = (SIDEREAL_DEG, SIDEREAL_DEG, -50.0 + 1.2004 * 4.0 + 1.1 + more_deg)
        found = safety.clear(MoveAxes(S, -4.0), *at, 0.0, T0).motion
        assert isinstance(found, MoveAxes) == (more_deg > 0.0)


def grown(safety: Safety, move: MoveAxes, dec_deg: float) -> tuple[float, float]:
    """Send rates by hand until they have grown to what is asked, at T0; return the last."""
    found = [sent(safety, move, T0 + 0.05 * k, dec_deg) for k in range(-20, 1)]
    return found[-1]


def test_what_was_sent_counts_until_the_mount_has_obeyed_what_came_after_it() -> None:
    """Latency is 0.2004 s. At 4 °/s an axis comes 0.8 + 1 = 1.8° on its way, and brakes."""
    for later_s, lets in ((0.15, False), (0.19, False), (0.26, True), (5.0, True)):
        safety = gate()
        assert grown(safety, MoveAxes(S, -4.0), -20.0) == pytest.approx((0.0, -4.0))
        safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG, -30.0, 0.0, T0 + 0.05)
        wish = MoveAxes(S, -0.01)
        cleared = safety.clear(wish, SIDEREAL_DEG, SIDEREAL_DEG, -49.0, 0.0, T0 + 0.05 + later_s)
        assert (cleared.motion == wish) == lets
    # What a status says that is 0.4 s old, was before the mount obeyed what came after it.
    for later_s, lets in ((0.45, False), (0.66, True)):
        safety = gate()
        grown(safety, MoveAxes(S, -4.0), -20.0)
        safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG, -30.0, 0.0, T0 + 0.05)
        cleared = safety.clear(wish, SIDEREAL_DEG, SIDEREAL_DEG, -48.0, 0.4, T0 + 0.05 + later_s)
        assert (cleared.motion == wish) == lets


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("begun_s", [None, 0.1, 5.0])
@pytest.mark.parametrize(("rate_deg_s", "lets"), [(-4.0, False), (4.0, True), (0.0, True)])
def test_what_statuses_show_counts_though_nobody_sent_it(
    axis: int, rate_deg_s: float, lets: bool, begun_s: float | None
) -> None:
    """One degree before its end an axis goes 4 °/s: in 0.2 s and the braking, 1.8°.

    It was sent nothing, or rest, so long ago.
    """
    safety, end_deg = gate(), (-40.0, -50.0)[axis]
    if begun_s is not None:
        sent(safety, MoveAxes(S, 0.0), T0 - begun_s)
    for k in range(6):
        at_deg = end_deg + 1.0 - rate_deg_s * 0.05 * (5 - k)
        ha, dec = (at_deg, 0.0) if axis == 0 else (0.0, at_deg)
        sidereal_deg = SIDEREAL_DEG + 0.05 * k * S
        safety.watch(Seen(None, sidereal_deg, sidereal_deg - ha, dec), Hold())
    wish = MoveAxes(S + 0.01, 0.0) if axis == 0 else MoveAxes(S, -0.01)
    cleared = safety.clear(wish, sidereal_deg, sidereal_deg - ha, dec, 0.0, T0)
    assert (cleared.motion == wish) == lets


@pytest.mark.parametrize(("move_axis", "ends_deg"), [("edge", -49.9), ("held", -50.08)])
def test_a_mount_by_edges_that_goes_on_though_it_is_to_rest_is_stopped_before_its_limit(
    move_axis: Literal["held", "edge"], ends_deg: float
) -> None:
    """A mount that takes the latest rates hears them again, and is stopped once it is seen outside."""
    safety, dec = gate(True, replace(PROFILE, move_axis=move_axis), fault_s=0.5), -40.0
    rests = ends = None
    for k in range(240):
        at, utc_s = (SIDEREAL_DEG + 0.05 * k * S, SIDEREAL_DEG + 0.05 * k * S, dec), T0 + 0.05 * k
        safety.watch(Seen(utc_s, *at), MoveAxes(S, 0.0 if rests else -0.9))
        cleared = safety.clear(MoveAxes(S, -0.9), *at, 0.0, utc_s).motion
        rests = rests or (k if cleared == MoveAxes(S, 0.0) else None)
        ends = ends or (dec if safety.tripped else None)
        dec -= 0.05 * 0.9
    assert safety.tripped == "declination"
    assert ends == pytest.approx(ends_deg, abs=0.001)


@pytest.mark.parametrize("seen_deg_s", [0.02, 0.04, 0.1, 0.3])
def test_a_mount_by_edges_that_creeps_on_though_it_is_to_rest_is_stopped_when_it_must_have_obeyed(
    seen_deg_s: float,
) -> None:
    """It is to rest long before its limit, and is not there yet."""
    safety, dec_deg = gate(True, replace(PROFILE, move_axis="edge"), fault_s=1.0), -49.0
    rests_s = None
    while safety.tripped is None:
        utc_s = T0 + (-49.0 - dec_deg) / seen_deg_s
        sidereal_deg = SIDEREAL_DEG + (utc_s - T0) * S
        safety.watch(Seen(utc_s, sidereal_deg, sidereal_deg, dec_deg), MoveAxes(S, -seen_deg_s))
        cleared = safety.clear(MoveAxes(S, -1.0), sidereal_deg, sidereal_deg, dec_deg, 0.0, utc_s).motion
        rests_s = rests_s or (utc_s if cleared == MoveAxes(S, 0.0) else None)
        dec_deg -= 0.05 * seen_deg_s
    assert safety.tripped == "declination"
    assert rests_s is not None
    assert utc_s - rests_s > 0.5
    assert dec_deg > -49.94


@pytest.mark.parametrize("back_s", [0.4, 0.6])
def test_our_clock_may_go_back_by_half_a_second(back_s: float) -> None:
    safety = gate()
    safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG, 0.0, 0.0, T0)
    safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG, 0.0, 0.0, T0 - 0.3)
    safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG, 0.0, 0.0, T0 - back_s)
    assert safety.tripped == (None if back_s < 0.5 else "clock")


@pytest.mark.parametrize(("age_s", "tripped"), [(1.99, None), (2.01, "status_age"), (math.nan, "command")])
def test_a_status_may_be_two_seconds_old(age_s: float, tripped: str | None) -> None:
    for motion in (MoveAxes(S, 0.0), Slew(SIDEREAL_DEG, 10.0)):
        safety = gate()
        safety.clear(motion, SIDEREAL_DEG, SIDEREAL_DEG, 0.0, age_s, T0)
        assert safety.tripped == tripped


def test_a_gate_that_has_cleared_nothing_tells_of_nothing() -> None:
    for safety in (gate(), gate(holds=True)):
        assert (safety.tripped, safety.holding, safety.led, safety.cause) == (None,) * 4
        assert (safety.led_there, safety.clamping, safety.keeps_first, safety.on_last_leg) == (
            False, False, False, True,
        )  # fmt: skip


@pytest.mark.parametrize("place", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, math.nan)])
def test_a_place_that_is_none_moves_nothing(place: tuple[float, float, float]) -> None:
    for motion in (MoveAxes(S, 0.0), Slew(0.0, 10.0)):
        safety = gate()
        assert safety.clear(motion, *place, 0.0, T0).motion == Stop()
        assert safety.tripped == "command"


def held_by_edges(
    above_deg: float, fault_s: float, waits_s: float, unanswered_s: float = 0.0, sent_deg_s: float = -1.0
) -> Safety:
    """Return a gate whose axes go at 1 °/s towards the lower end, so far from it, and are held there.

    For so long they have been sent a rate, and no other.
    """
    edge = replace(PROFILE, move_axis="edge")
    safety = gate(holds=True, profile=edge, fault_s=fault_s)
    safety.handshakes_last(unanswered_s)
    wish = MoveAxes(S, -1.0)
    for k in range(40):
        utc_s, dec_deg = T0 + 0.05 * k, -50.0 + above_deg + 0.05 * (39 - k)
        sidereal_deg = SIDEREAL_DEG + S * 0.05 * k
        safety.watch(Seen(utc_s, sidereal_deg, sidereal_deg, dec_deg), wish)
        cleared = safety.clear(wish, sidereal_deg, sidereal_deg, dec_deg, 0.0, utc_s)
    assert safety.holding == "declination"
    found = safety.in_time(cleared, waits_s, MoveAxes(S, sent_deg_s))
    assert (found.motion == Stop()) == (safety.tripped == "declination")
    return safety


def test_a_mount_by_edges_is_stopped_where_the_rates_that_hold_it_come_too_late() -> None:
    """When a handshake is overdue by 0.2 s, a stop and the longest fault must have room."""
    for fault_s in (0.5, 1.0):
        way_deg = 0.2004 + fault_s + 1.0 / 16.0 + 0.1
        for more_deg, stopped in ((-0.01, True), (0.01, False)):
            for waits_s, due in ((0.49, False), (0.51, True), (9.0, True)):
                safety = held_by_edges(way_deg + more_deg, fault_s, waits_s)
                assert (safety.tripped is not None) == (stopped and due)
    # A mount that leaves handshakes unanswered is given more time, and was judged for it.
    for waits_s, stopped in ((1.19, False), (1.21, True)):
        safety = held_by_edges(way_deg - 0.01, 1.0, waits_s, unanswered_s=1.0)
        assert (safety.tripped is not None) == stopped


def test_a_mount_by_edges_is_stopped_that_is_seen_to_disobey_the_rates_before() -> None:
    """It obeys within 0.2 s, and is not slower then; a stop and the longest fault must have room."""
    way_deg = 0.2004 + 1.0 + 1.0 / 16.0 + 0.1
    for sent_deg_s, disobeys in ((-0.4, True), (0.4, True), (-0.94, True), (-0.96, False), (-1.0, False)):
        for more_deg in (-0.01, 0.01):
            for waits_s, due in ((0.15, False), (0.25, True), (0.45, True)):
                safety = held_by_edges(way_deg + more_deg, 1.0, waits_s, sent_deg_s=sent_deg_s)
                assert (safety.tripped is not None) == (disobeys and due and more_deg < 0.0)


def test_axes_that_brake_towards_the_rates_before_do_not_disobey_them() -> None:
    """By 8 °/s² from 2 or 3 °/s to 1; the other axis has been at rest."""
    limits = replace(DARK, longest_fault_s=1.0)
    edge = replace(PROFILE, move_axis="edge")
    ahead = Ahead(edge, limits, Bounds(edge, limits, LATITUDE_DEG, None))
    spots = [Spot(Place(0.0, -49.0), 0.0)]
    for before_deg_s, obeyed_s in ((0.5, 0.2004), (1.0, 0.2004), (2.0, 0.3254), (3.0, 0.4504)):
        for more_s in (-0.001, 0.001):
            limit = ahead.disobeying(spots, (0.0, -1.0), (0.0, before_deg_s), obeyed_s + more_s)
            assert limit == (None if more_s < 0.0 else "declination")
    assert ahead.disobeying(spots, (0.0, 1.0), (0.0, 1.0), 9.0) is None


@pytest.mark.parametrize("seen_deg_s", [1.0, 1.5, 2.5])
def test_motion_by_hand_is_judged_by_how_fast_it_is_seen(seen_deg_s: float) -> None:
    """1 °/s is asked for, towards the lower end; a servo that catches up goes faster, and may go on so."""
    for more_deg, stopped in ((-0.02, True), (0.02, False)):
        safety, wish = gate(fault_s=0.5), MoveAxes(S, -1.0)
        way_deg = seen_deg_s * (0.2004 + 0.5) + seen_deg_s**2 / 16.0 + 0.1 + more_deg
        for k in range(40):
            utc_s, dec_deg = T0 + 0.05 * k, -50.0 + way_deg + 0.05 * seen_deg_s * (39 - k)
            sidereal_deg = SIDEREAL_DEG + S * 0.05 * k
            safety.watch(Seen(utc_s, sidereal_deg, sidereal_deg, dec_deg), wish)
            assert safety.tripped is None
            safety.clear(wish, sidereal_deg, sidereal_deg, dec_deg, 0.0, utc_s)
        assert (safety.tripped == "declination") == stopped


def test_motion_by_hand_that_slows_down_is_judged_by_what_is_asked_of_it_now() -> None:
    """An axis that was sent 2 °/s and comes down to 1 within 0.6 s is not one that catches up."""
    safety, dec_deg, rate_deg_s = gate(fault_s=0.5), -47.5, -2.0
    for k in range(20):
        utc_s, sidereal_deg = T0 + 0.05 * k, SIDEREAL_DEG + S * 0.05 * k
        wish = MoveAxes(S, -2.0 if k < 5 else -1.0)
        safety.watch(Seen(utc_s, sidereal_deg, sidereal_deg, dec_deg), wish)
        assert isinstance(
            safety.clear(wish, sidereal_deg, sidereal_deg, dec_deg, 0.0, utc_s).motion, MoveAxes
        )
        assert safety.tripped is None
        rate_deg_s = min(-1.0, rate_deg_s + (0.0 if k < 8 else 0.1))
        dec_deg += 0.05 * rate_deg_s
    assert dec_deg == pytest.approx(-49.1, abs=0.06)


@pytest.mark.parametrize(("unanswered_s", "waits_s"), [(0.0, 0.3), (0.2, 0.3), (1.0, 1.0)])
def test_rates_by_edges_are_judged_for_as_long_as_the_handshake_before_them_may_last(
    unanswered_s: float, waits_s: float
) -> None:
    """Six periods, or what a mount that does not answer lets pass."""
    edge, wish = replace(PROFILE, move_axis="edge"), MoveAxes(S, -1.0)
    for more in (-0.01, 0.01):
        safety = gate(profile=edge)
        safety.handshakes_last(unanswered_s)
        way_deg = 0.2004 + waits_s + 1.0 + 1.0 / 16.0 + 0.1
        at = (SIDEREAL_DEG, SIDEREAL_DEG, -50.0 + way_deg + more)
        assert isinstance(safety.clear(wish, *at, 0.0, T0).motion, MoveAxes) == (more > 0.0)


@pytest.mark.parametrize(
    ("commanded", "trips"),
    [(MoveAxes(1.0, 0.0), True), (Slew(0.0, 0.0), True), (Hold(), False), (Stop(), False)],
)
def test_an_interlock_stops_what_moves(commanded: MoveAxes | Slew | Hold | Stop, trips: bool) -> None:
    profile = replace(PROFILE, ra=replace(PROFILE.ra, max_current_a=1.0))
    safety = gate(profile=profile)
    for k in range(30):
        safety.watch(Seen(None, k * 0.05 * S, 0.05 * k, 20.0, ra_current_a=2.0), commanded)
    assert safety.tripped == ("current" if trips else None)


def test_axes_outside_are_stopped_by_the_third_status_that_finds_them_there() -> None:
    """A stream by which they are led out is let go on until then, and they are not led farther out."""
    safety, found = gate(holds=True), []
    for k in range(6):
        at = (SIDEREAL_DEG, SIDEREAL_DEG - 40.5, 0.0)
        safety.watch(Seen(None, *at), MoveAxes(S, 0.0))
        for _ in range(2):
            # Clearances without news count once.
            motion = safety.clear(MoveAxes(S - 1.0, 0.0), *at, 0.0, T0 + 0.05 * k).motion
        found.append(motion)
    held = pytest.approx((S, 0.0))
    rates = [(one.ra_rate_deg_s, one.dec_rate_deg_s) if isinstance(one, MoveAxes) else one for one in found]
    assert rates == [held, held, *[Stop()] * 4]
    assert safety.tripped == "hour_angle"


@pytest.mark.parametrize(
    ("rates", "cleared"),
    [((-1.0, 0.0), (-1.0, 0.0)), ((1.0, 0.5), (0.0, 0.5)), ((0.04, 0.0), (0.0, 0.0)), ((1.0, 0.0), None)],
)
def test_a_stream_that_begins_outside_leads_in_or_along_and_once_inside_out_no_more(
    rates: tuple[float, float], cleared: tuple[float, float] | None
) -> None:
    """Axis rates: what is to stand, or hardly more, waits there; what is to go farther out is stopped."""
    safety = gate(holds=True)

    def sees(k: int, ha_deg: float, ha_rate: float, dec_rate: float) -> Any:
        at = (SIDEREAL_DEG + 0.05 * k * S, SIDEREAL_DEG + 0.05 * k * S - ha_deg, 0.0)
        wish = MoveAxes(S - ha_rate, dec_rate)
        safety.watch(Seen(None, *at), wish)
        return safety.clear(wish, *at, 0.0, T0 + 0.05 * k).motion

    found = [sees(k, 40.5, *rates) for k in range(12)][-1]
    if cleared is None:
        assert found == Stop()
        return
    assert (S - found.ra_rate_deg_s, found.dec_rate_deg_s) == pytest.approx(cleared)
    assert sees(12, 39.0, -1.0, 0.0) == MoveAxes(S + 1.0, 0.0)
    assert [sees(13 + k, 40.5, -1.0, 0.0) for k in range(3)][-1] == Stop()


@pytest.mark.parametrize("holds", [True, False])
@pytest.mark.parametrize("beside_deg", [1.0, 0.05, -0.5])
def test_axes_that_have_used_up_one_margin_keep_that_of_another_limit(holds: bool, beside_deg: float) -> None:
    """At 4 °/s the other one is 4.8 + 1 + 0.1 degrees ahead."""
    for more_deg in (-0.05, 0.05):
        safety, wish = gate(holds), MoveAxes(S, -4.0)
        at = (SIDEREAL_DEG, SIDEREAL_DEG - (40.0 - beside_deg), -50.0 + 1.2004 * 4.0 + 1.1 + more_deg)
        found = safety.clear(wish, *at, 0.0, T0).motion
        assert (found == wish if holds else isinstance(found, MoveAxes)) == (more_deg > 0.0)
        assert holds or safety.tripped == (None if more_deg > 0.0 else "declination")


def test_a_status_from_inside_begins_the_proof_that_axes_are_outside_anew() -> None:
    safety = gate(holds=True)
    for k, ha_deg in enumerate((40.5, 40.5, 39.4, 40.5, 40.5, 40.5)):
        sidereal_deg = SIDEREAL_DEG + 0.05 * k * S
        at = (sidereal_deg, sidereal_deg - ha_deg, 0.0)
        safety.watch(Seen(None, *at), MoveAxes(S, 0.0))
        found = safety.clear(MoveAxes(S + 0.5, 0.0), *at, 0.0, T0 + 0.05 * k).motion
        assert (found == Stop()) == (k == 5)


def test_what_is_held_is_looked_for_every_other_period_or_where_it_would_lead_too_far(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[Any] = []
    monkeypatch.setattr(
        "sattrack.safety.gate.nearest_rates",
        lambda *given: looked.append(given) or nearest_rates(*given),
    )
    safety = gate(holds=True)

    def looks(later_s: float | None, dec_deg: float = -48.0) -> bool:
        before = len(looked)
        utc_s = None if later_s is None else T0 + later_s
        _, rate = sent(safety, MoveAxes(S, -4.0), utc_s, dec_deg)
        # In the latency and the longest fault, and until it stands, it leads no farther than the margin.
        assert -4.0 < rate <= 0.0
        assert dec_deg + rate * 1.2004 - rate**2 / 16.0 >= -49.9
        return len(looked) > before

    assert [looks(0.05 * k) for k in range(6)] == [True, False] * 3
    assert [looks(0.30), looks(0.35, -49.5), looks(0.40)] == [True, True, False]
    # Where our clock goes back, or nobody knows when, nothing is kept.
    assert [looks(0.20), looks(None), looks(None)] == [True, True, True]
    # What was let go in between, is looked for again.
    assert looks(0.5)
    assert sent(safety, MoveAxes(S, 0.5), T0 + 0.52) == pytest.approx((0.0, 0.5))
    assert looks(0.55, -48.9)


@pytest.mark.parametrize(("clear_deg", "dec_deg_s"), [(0.5, 0.0), (0.05, 0.05), (-0.02, 0.07)])
def test_axes_that_rest_beside_the_sun_give_way_to_it_at_once(clear_deg: float, dec_deg_s: float) -> None:
    """North of it, where the way out is up: at 0.05 °/s, and faster by what they are inside its cone."""
    sun = sun_over(LATITUDE_DEG, 4.5).at(T0)
    sidereal_deg = mean_sidereal_deg(T0, 4.5)
    ra_deg, dec_deg = sidereal_deg - sun.hour_angle_deg, sun.dec_deg + 15.0 + S + clear_deg
    safety = Safety(MountProfile(), SafetyLimits(floor_altitude_deg=-90.0), LATITUDE_DEG, 4.5, holds=True)
    found = safety.clear(MoveAxes(S, 0.0), sidereal_deg, ra_deg, dec_deg, 0.0, T0).motion
    assert isinstance(found, MoveAxes)
    assert (found.ra_rate_deg_s, found.dec_rate_deg_s) == pytest.approx((S, dec_deg_s), abs=1e-3)


def test_turns_are_counted_from_the_first_place_where_no_status_was_watched() -> None:
    """170° west comes first; 185° west after it is past the end, and not 175° east."""
    safety = gate(profile=replace(PROFILE, hour_angle_limit_deg=180.0))
    safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG - 170.0, 0.0, 0.0, T0)
    safety.clear(MoveAxes(S - 1.0, 0.0), SIDEREAL_DEG, SIDEREAL_DEG - 185.0, 0.0, 0.0, T0 + 1.0)
    assert safety.tripped == "hour_angle"


@pytest.mark.parametrize("latitude_deg", [52.0, -33.0])
def test_turns_are_counted_on_from_where_the_axis_was(latitude_deg: float) -> None:
    axes = AxesState(latitude_deg)
    assert axes.place(350.0, 40.0, False) == Place(-10.0, 40.0)
    assert axes.place(190.0, 40.0, False) == Place(-170.0, 40.0)
    axes.take(Place(370.0, 40.0), False)
    assert axes.place(350.0, 40.0, False) == Place(350.0, 40.0)
    assert axes.place(175.0, 40.0, False) == Place(535.0, 40.0)
    pole = math.copysign(180.0, latitude_deg)
    assert axes.place(190.0, 40.0, True) == Place(370.0, pole - 40.0)
    later = AxesState(latitude_deg)
    later.follow_on(axes)
    assert later.place(0.0, 40.0, False) == Place(360.0, 40.0)
    later.take(Place(0.0, 40.0), False)
    later.begin_anew()
    assert later.hour_angle_deg == 370.0
    axes.begin_anew()
    assert axes.hour_angle_deg is None
    # A session before left it wound; what it was heard at since counts more.
    axes.begin_at(205.0)
    assert axes.place(190.0, 40.0, False) == Place(190.0, 40.0)
    assert axes.place(20.0, 40.0, False) == Place(380.0, 40.0)
    axes.take(Place(190.0, 40.0), False)
    axes.begin_at(-300.0)
    assert axes.hour_angle_deg == 190.0
    axes.begin_anew()
    assert axes.hour_angle_deg == 205.0


@pytest.mark.parametrize(
    ("left_deg", "hours", "true_deg"),
    [
        # By 15.04° an hour; the second one comes past half a turn, the third all but round.
        (100.0, 5.0, 175.2),
        (100.0, 6.0, 190.25),
        (160.0, 20.0, 460.8),
        (-160.0, 6.0, -69.75),
    ],
)
@pytest.mark.parametrize("beyond_pole", [False, True])
def test_an_axis_that_has_followed_the_sky_since_it_was_left_is_where_that_has_led_it(
    left_deg: float, hours: float, true_deg: float, beyond_pole: bool
) -> None:
    safety = gate()
    safety.expect_at(left_deg + 15.0411 * hours)
    reported_deg = true_deg - (180.0 if beyond_pole else 0.0)
    safety.watch(Seen(T0, SIDEREAL_DEG, (SIDEREAL_DEG - reported_deg) % 360.0, 40.0, beyond_pole), Hold())
    assert safety.first_axis_deg == pytest.approx(true_deg, abs=1e-9)
    # A place that is new to it is counted from there.
    safety.watch(Seen(T0 + 1.0, SIDEREAL_DEG, SIDEREAL_DEG - reported_deg, 40.0, beyond_pole), Hold())
    assert safety.first_axis_deg == pytest.approx(true_deg, abs=1e-9)


@pytest.mark.parametrize("reported_deg", [-100.0, 100.0, 171.0, -172.0, -168.0])
def test_an_axis_that_stands_elsewhere_was_stopped_or_moved_and_is_within_half_a_turn(
    reported_deg: float,
) -> None:
    """The sky would have led it to 190°: by hand it came to -100°, by its own switch it stayed."""
    safety = gate()
    safety.expect_at(190.0)
    safety.watch(Seen(T0, SIDEREAL_DEG, (SIDEREAL_DEG - reported_deg) % 360.0, 40.0), Hold())
    assert safety.first_axis_deg == pytest.approx(reported_deg, abs=1e-9)
    # Where it was believed to be is forgotten.
    safety.watch(Seen(T0 + 60.0, SIDEREAL_DEG, SIDEREAL_DEG - reported_deg, 40.0), Hold())
    assert safety.first_axis_deg == pytest.approx(reported_deg, abs=1e-9)


def test_cables_that_the_sky_has_wound_are_not_wound_farther() -> None:
    """At 100° six hours ago, at 190° now, which a status reports as -170°: west is the wrong way."""
    true_deg = 100.0 + 6.0 * 15.0411
    for rate_deg_s, expected, moves in ((3.0, True, False), (-3.0, True, True), (3.0, False, True)):
        safety = gate(profile=MountProfile(hour_angle_limit_deg=170.0))
        if expected:
            safety.expect_at(true_deg)
        seen = (SIDEREAL_DEG, (SIDEREAL_DEG - true_deg) % 360.0, 60.0)
        safety.watch(Seen(T0, *seen), Hold())
        cleared = safety.clear(MoveAxes(SIDEREAL_RATE_DEG_S - rate_deg_s, 0.0), *seen, 0.01, T0).motion
        assert isinstance(cleared, MoveAxes) is moves, (rate_deg_s, cleared)


@pytest.mark.parametrize(
    ("ha_deg", "slewing", "stops"),
    [(39.98, False, False), (39.984, False, False), (39.988, False, True), (39.988, True, False)],
)
def test_a_mount_that_waits_where_its_slew_has_ended_is_stopped_before_the_sky_leads_it_past_a_limit(
    ha_deg: float, slewing: bool, stops: bool
) -> None:
    """A hundredth of a degree before it, and what the sky goes on in a second."""
    safety, slew = gate(), Slew(SIDEREAL_DEG - 39.5, 0.0)
    assert safety.clear(slew, SIDEREAL_DEG, SIDEREAL_DEG - 39.0, 0.0, 0.0, T0).motion == slew
    at = (slew.ra_deg + ha_deg, slew.ra_deg, 0.0)
    for k in range(5):
        safety.watch(Seen(None, at[0] - 0.01 * (4 - k), *at[1:], slewing=slewing), slew)
    found = safety.clear(slew, *at, 0.0, T0 + 120.0).motion
    assert found == (Stop() if stops else slew)
    assert safety.tripped == ("hour_angle" if stops else None)


@pytest.mark.parametrize("between", [MoveAxes(S, 0.0), Hold()], ids=repr)
def test_a_slew_that_is_asked_for_again_after_another_motion_is_judged_anew(between: Motion) -> None:
    """A zone of the pier stands on the meridian; the axes have come round it meanwhile."""
    wall = PierZone("wall", ((-5.0, -20.0), (5.0, -20.0), (5.0, 60.0), (-5.0, 60.0)))
    safety, slew = gate(profile=replace(PROFILE, pier_zones=(wall,))), Slew(SIDEREAL_DEG - 30.0, 10.0)
    west, east = ((SIDEREAL_DEG, SIDEREAL_DEG - ha, 10.0, 0.0, T0) for ha in (20.0, -20.0))
    assert safety.clear(slew, *west).motion == slew
    assert safety.clear(between, *east).motion == between
    assert safety.clear(slew, *east).motion == Stop()
    assert safety.tripped == "pier"


@pytest.mark.parametrize("holds", [True, False])
@pytest.mark.parametrize("streams", [True, False])
def test_a_slew_that_has_no_way_holds_a_pass_where_it_is_and_stops_anything_else(
    holds: bool, streams: bool
) -> None:
    """The axis turns 40° either way; the goal is past the end of it, and there is no place to wait at."""
    safety = gate(holds, replace(PROFILE, dec_axis_limits_deg=(-1.0, 1.0)))
    at = (SIDEREAL_DEG, SIDEREAL_DEG, 0.0, 0.0)
    if streams:
        safety.clear(MoveAxes(S, 0.0), *at, T0)
    found = safety.clear(Slew(SIDEREAL_DEG - 170.0, 0.0), *at, T0 + 0.05).motion
    assert found == (MoveAxes(S, 0.0) if holds and streams else Stop())
    assert safety.tripped == (None if holds and streams else "hour_angle")


class TestHowLongTurnsAreKnown:
    """What is left to half a turn, at one and a half times the rate; the sky's is no motion of the axis."""

    @staticmethod
    def known_s(ha_deg: float | None, first_deg_s: float, dec_deg_s: float = 0.0) -> float:
        safety = gate()
        if ha_deg is not None:
            safety._standing.take(Place(ha_deg, 20.0), beyond_pole=False)
        return safety.turns_known_s(MoveAxes(S - first_deg_s, dec_deg_s))

    @pytest.mark.parametrize(
        ("ha_deg", "first_deg_s", "left_deg"),
        [
            (-41.0, -0.66, 139.0),
            (-41.0, 0.66, 221.0),
            (100.0, 1.0, 80.0),
            (0.0, -1.0, 180.0),
            # Past half a turn this session counts on; from there it is half a turn more.
            (190.0, 1.0, 180.0),
            (-190.0, -1.0, 180.0),
        ],
    )
    def test_the_way_that_is_left_counts(self, ha_deg: float, first_deg_s: float, left_deg: float) -> None:
        known_s = left_deg / (1.5 * abs(first_deg_s))
        assert self.known_s(ha_deg, first_deg_s) == pytest.approx(known_s)

    def test_the_second_axis_has_half_a_turn(self) -> None:
        assert self.known_s(0.0, 0.1, -2.0) == pytest.approx(60.0)

    def test_a_short_silence_is_always_allowed(self) -> None:
        assert self.known_s(179.0, 2.0) == 5.0

    def test_it_is_endless_before_the_first_status_and_with_a_watchdog(self) -> None:
        assert self.known_s(None, 1.0) == math.inf
        safety = gate(profile=replace(PROFILE, watchdog_s=2.0))
        safety._standing.take(Place(0.0, 20.0), beyond_pole=False)
        assert safety.turns_known_s(MoveAxes(1.0, 0.0)) == math.inf

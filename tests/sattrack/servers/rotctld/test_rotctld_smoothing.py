"""One smooth way of coarse steps: against ways in closed form, and what is no way at all."""

from __future__ import annotations

import math

import pytest

from sattrack.servers.antenna.protocol import NS
from sattrack.servers.antenna.trajectory import AzEl
from sattrack.servers.rotctld.rotator import SmoothedTrack

T0 = 1_790_000_000.0


def great_circle(t: float, rate_deg_s: float = 1.0) -> AzEl:
    """A way at a constant rate that rises in the east, passes 10° north of the zenith, sets in the west."""
    along, tilt = math.radians(rate_deg_s * t), math.radians(80.0)
    e = math.cos(along)
    n, u = math.sin(along) * math.cos(tilt), math.sin(along) * math.sin(tilt)
    return AzEl(math.degrees(math.atan2(e, n)) % 360.0, math.degrees(math.asin(u)))


def apart_deg(a: AzEl, b: AzEl) -> float:
    cosine = math.sin(math.radians(a.el_deg)) * math.sin(math.radians(b.el_deg))
    cosine += (
        math.cos(math.radians(a.el_deg))
        * math.cos(math.radians(b.el_deg))
        * math.cos(math.radians(a.az_deg - b.az_deg))
    )
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def at(track: SmoothedTrack, t: float) -> AzEl:
    state = track.at(round((T0 + t) * NS))
    return AzEl(state.first_deg, state.second_deg)


def sent(track: SmoothedTrack, t: float, place: AzEl, digits: int = 2) -> None:
    track.take(AzEl(round(place.az_deg, digits), round(place.el_deg, digits)), T0 + t)


def following(until: int, rate_deg_s: float = 1.0, from_s: int = 20) -> SmoothedTrack:
    track = SmoothedTrack()
    for second in range(from_s, until + 1):
        sent(track, second, great_circle(second, rate_deg_s))
    assert track.following
    return track


def test_a_way_is_gone_along_between_its_steps_far_nearer_than_they_are_apart() -> None:
    track, worst = following(30), 0.0
    for second in range(31, 150):
        for part in range(20):
            t = second - 1 + part / 20
            worst = max(worst, apart_deg(at(track, t), great_circle(t)))
        sent(track, second, great_circle(second))
    # Steps are of 1°, and rounded by up to 0.005° in either angle.
    assert worst < 0.02


def test_a_way_that_is_told_exactly_is_followed_to_what_a_parabola_leaves_of_it() -> None:
    track, worst = SmoothedTrack(), 0.0
    for second in range(20, 150):
        if second > 30:
            worst = max(worst, apart_deg(at(track, second - 0.01), great_circle(second - 0.01)))
        sent(track, second, great_circle(second), 9)
    # The third derivative of a unit vector at 1°/s is (π/180)³, times (1 + 3.5)³/6 s³ at the very most.
    assert worst < math.degrees(math.radians(1.0) ** 3 * 4.5**3 / 6.0)


def test_neither_the_zenith_nor_north_is_anything_special() -> None:
    for offset_deg in (0.0, 359.5, 180.0):
        track = SmoothedTrack()
        for second in range(70, 110):
            place = AzEl(
                offset_deg if second < 90 else (offset_deg + 180.0) % 360.0, 90.0 - abs(second - 90.0)
            )
            sent(track, second, place)
            if second > 80:
                later = second + 0.5
                el_deg = 90.0 - abs(later - 90.0)
                there = AzEl(offset_deg if later < 90 else offset_deg + 180.0, el_deg)
                assert apart_deg(at(track, later), there) < 0.03


def test_position_and_rate_have_no_steps_where_a_new_position_comes() -> None:
    track = following(40)
    for second in range(41, 120):
        before, slope_before = (
            at(track, second - 1e-3),
            apart_deg(at(track, second - 0.011), at(track, second - 1e-3)),
        )
        sent(track, second, great_circle(second))
        after, slope_after = (
            at(track, second + 1e-3),
            apart_deg(at(track, second + 1e-3), at(track, second + 0.011)),
        )
        # In 2 ms the way itself goes 0.002°.
        assert apart_deg(before, after) == pytest.approx(0.002, abs=0.0002)
        assert slope_after == pytest.approx(slope_before, rel=0.01)


def test_positions_that_do_not_continue_each_other_are_gone_to_and_stood_at() -> None:
    track = SmoothedTrack()
    places = [AzEl(10.0, 20.0), AzEl(50.0, 60.0), AzEl(50.0, 30.0), AzEl(300.0, 31.0), AzEl(299.0, 45.0)]
    for number, place in enumerate(places):
        sent(track, 2.0 * number, place)
        for later in (0.1, 1.9, 100.0):
            assert at(track, 2.0 * number + later) == place
        assert not track.following


def test_one_position_again_and_again_is_stood_at() -> None:
    track = SmoothedTrack()
    for second in range(20):
        sent(track, second, AzEl(123.45, 67.89))
        assert apart_deg(at(track, second + 0.7), AzEl(123.45, 67.89)) < 1e-6


def test_positions_that_are_now_more_and_now_less_ahead_are_one_track() -> None:
    """gpredict 2.3 was seen to send positions of 0 to 0.7 s later, from one to the next at random."""
    ahead_s = (0.0, 0.7, 0.1, 0.6, 0.0, 0.3, 0.7, 0.7, 0.0, 0.5)
    track = following(40)
    for second in range(41, 140):
        sent(track, second, great_circle(second + ahead_s[second % len(ahead_s)]))
        assert track.following
        here = at(track, second + 0.5)
        assert min(apart_deg(here, great_circle(second + 0.5 + s)) for s in (0.0, 0.35, 0.7)) < 0.7
    assert apart_deg(at(track, 139.5), great_circle(139.5)) < 1.0


def test_a_position_beside_the_track_is_none_of_it() -> None:
    track = following(40)
    there = great_circle(41)
    # It rises steeply from the east here: azimuths are across.
    sent(track, 41, AzEl(there.az_deg + 1.0, there.el_deg))
    assert not track.following


def test_a_step_off_the_track_ends_it() -> None:
    track = following(40)
    sent(track, 41, AzEl(200.0, 20.0))
    assert not track.following
    assert at(track, 41.5) == AzEl(200.0, 20.0)


def test_positions_at_once_are_one_the_last() -> None:
    track = following(40)
    for _ in range(5):
        sent(track, 41, great_circle(41))
    assert track.following
    assert apart_deg(at(track, 41.5), great_circle(41.5)) < 0.02


def test_a_client_that_falls_silent_is_gone_on_for_three_seconds_and_then_stood_still_at() -> None:
    track = following(60)
    assert apart_deg(at(track, 63.0), great_circle(63.0)) < 0.05
    # It comes to rest within a second, and the way of that is half as long.
    resting = at(track, 64.0)
    assert apart_deg(resting, great_circle(63.5)) < 0.05
    for t in (65.0, 80.0, 3600.0):
        assert at(track, t) == resting
    state = track.at(round((T0 + 70.0) * NS))
    assert state[2:] == (0.0, 0.0)


def test_a_client_that_goes_on_asking_is_gone_on_for_ten_seconds_and_then_taken_at_its_word() -> None:
    track = following(60)
    for second in range(61, 80):
        track.heard(T0 + second)
    assert apart_deg(at(track, 68.0), great_circle(68.0)) < 0.3
    resting = at(track, 71.0)
    assert apart_deg(resting, great_circle(70.5)) < 0.5
    assert at(track, 74.9) == resting
    last = great_circle(60)
    for t in (75.1, 100.0):
        assert apart_deg(at(track, t), last) < 0.01


def test_a_client_that_hangs_up_is_as_good_as_silent() -> None:
    track = following(60)
    track.hang_up()
    resting = at(track, 64.0)
    assert at(track, 100.0) == resting


def test_a_client_that_is_heard_again_after_its_track_has_ended_does_not_begin_it_again() -> None:
    track = following(60)
    resting = at(track, 64.0)
    for second in (70, 71, 72):
        track.heard(T0 + second)
        assert at(track, second + 0.5) == resting


def test_a_client_that_sends_only_what_it_must_is_followed_between() -> None:
    """Positions every 8 s, the client asking each second where the mount is: its track does not end."""
    track, worst = SmoothedTrack(), 0.0
    for second in range(10, 150):
        if (second - 10) % 8 == 0:
            sent(track, second, great_circle(second, 0.5))
        else:
            track.heard(T0 + second)
        if second > 60:
            worst = max(worst, apart_deg(at(track, second + 0.9), great_circle(second + 0.9, 0.5)))
    assert worst < 0.15


def test_nothing_that_comes_makes_it_grow_or_break() -> None:
    track = SmoothedTrack()
    for number in range(2000):
        track.take(
            AzEl(number * 37.0 % 630.0 - 180.0, number * 13.0 % 180.0), T0 + 0.001 * (number % 7) * number
        )
        assert all(math.isfinite(value) for value in track.at(round((T0 + number) * NS)))

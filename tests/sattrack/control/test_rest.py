"""A pause and the jogs within it, by hand: what is sent, for how long, and what is refused."""

from __future__ import annotations

import msgspec
import pytest

from sattrack.control.rest import STANDING, Jogs, Rest
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    Hold,
    MountProfile,
    MoveAxes,
    StatusSample,
    Stop,
)
from sattrack.views.messages import Jog

AXIS = AxisLimits(max_rate_deg_s=4.0, max_acceleration_deg_s2=8.0)
"""It brakes in half a second."""
PROFILE = MountProfile(ra=AXIS, dec=AxisLimits(max_rate_deg_s=1.0, max_acceleration_deg_s2=8.0))


def drives(ra_deg_s: float, slewing: bool = False) -> StatusSample:
    return StatusSample(0, 0.0, 0.0, 0.0, 0.0, slewing, False, ra_deg_s, 0.0)


class TestJogs:
    def test_a_touch_moves_for_half_a_second_and_a_held_key_for_three_tenths_more(self) -> None:
        jogs = Jogs()
        assert not jogs
        jogs.move(0.5, None, 10.0)
        assert (bool(jogs), jogs.rates_deg_s) == (True, (0.5, 0.0))
        assert jogs.end_over(10.499) is False
        jogs.move(0.5, None, 10.1)
        assert jogs.end_over(10.499) is False
        assert jogs.end_over(10.5) is True
        assert (bool(jogs), jogs.rates_deg_s) == (False, (0.0, 0.0))
        jogs.move(0.5, None, 20.0)
        jogs.move(0.5, None, 20.4)
        assert [jogs.end_over(t) for t in (20.5, 20.699, 20.701)] == [False, False, True]

    def test_another_rate_begins_anew_and_each_axis_has_its_own_time(self) -> None:
        jogs = Jogs()
        jogs.move(0.5, -0.25, 10.0)
        jogs.move(-0.5, None, 10.3)
        assert jogs.rates_deg_s == (-0.5, -0.25)
        assert jogs.end_over(10.6) is True
        assert (jogs.rates_deg_s, bool(jogs)) == ((-0.5, 0.0), True)
        assert jogs.end_over(10.7) is False
        assert jogs.end_over(10.81) is True

    def test_a_touch_is_fresh_after_four_tenths(self) -> None:
        jogs = Jogs()
        assert [jogs.is_fresh(t) for t in (10.0, 10.39, 10.78, 11.19, 20.0)] == [
            True,
            False,
            False,
            True,
            True,
        ]

    def test_a_stop_blocks_a_held_key_and_a_clearance_does_not(self) -> None:
        jogs = Jogs()
        jogs.move(0.5, None, 10.0)
        jogs.clear()
        assert (bool(jogs), jogs.blocked) == (False, False)
        jogs.move(0.5, None, 10.0)
        jogs.block()
        assert (bool(jogs), jogs.blocked) == (False, True)
        jogs.move(0.5, None, 11.0)
        assert jogs.blocked is False


class Paused:
    def __init__(self, drive_deg_s: float = 0.0) -> None:
        self.rest = Rest(100.0, PROFILE)
        self.rest.see(drives(drive_deg_s))

    def stands(self, now_s: float = 101.0) -> None:
        """Have the stop seen through, and for a quarter of a second more."""
        assert self.rest.step(now_s, True) == Stop()
        assert self.rest.step(now_s + 0.24, True) == Stop()
        assert self.rest.at_rest is False
        self.rest.step(now_s + 0.25, True)
        assert self.rest.at_rest is True


class TestRest:
    def test_it_stops_until_rest_has_lasted_and_then_holds(self) -> None:
        paused = Paused()
        assert paused.rest.step(100.0, False) == Stop()
        assert paused.rest.step(100.2, True) == Stop()
        # A stop that is undone in between is waited for anew.
        assert paused.rest.step(100.3, False) == Stop()
        paused.stands()
        assert paused.rest.step(102.0, True) == Hold()
        assert (paused.rest.streams, paused.rest.jogging, paused.rest.begun_utc_s) == (False, False, 100.0)

    def test_a_mount_that_takes_to_the_sky_is_commanded_to(self) -> None:
        for drive, streams in ((0.51, True), (0.49, False), (-0.51, True)):
            paused = Paused(drive * SIDEREAL_RATE_DEG_S)
            assert paused.rest.streams is False
            paused.stands()
            assert paused.rest.streams is streams
            assert paused.rest.step(102.0, True) == (MoveAxes(0.0, 0.0) if streams else Hold())

    def test_axes_that_stood_and_take_to_the_sky_are_stopped_again(self) -> None:
        paused = Paused()
        paused.stands()
        paused.rest.see(drives(SIDEREAL_RATE_DEG_S, slewing=True))
        assert paused.rest.step(102.0, True) == Hold()
        paused.rest.see(drives(SIDEREAL_RATE_DEG_S))
        assert paused.rest.at_rest is False
        assert paused.rest.step(102.05, False) == Stop()
        # They go on following it while that is seen through, and then they are commanded to.
        for number in range(6):
            paused.rest.see(drives(SIDEREAL_RATE_DEG_S))
            assert paused.rest.step(102.1 + 0.05 * number, True) == (
                Stop() if number < 5 else MoveAxes(0.0, 0.0)
            )
        sky = Paused(SIDEREAL_RATE_DEG_S)
        sky.stands()
        sky.rest.see(drives(SIDEREAL_RATE_DEG_S))
        assert sky.rest.at_rest is True

    def test_axes_that_stand_are_left_standing(self) -> None:
        paused = Paused()
        paused.stands()
        paused.rest.see(drives(0.0))
        assert paused.rest.at_rest is True
        assert paused.rest.step(102.0, True) == Hold()

    def test_a_mount_that_was_not_heard_since_may_have_taken_to_the_sky(self) -> None:
        """So it is commanded to, and safety judges where that leads."""
        rest = Rest(100.0, PROFILE)
        assert [rest.step(t, True) for t in (100.0, 100.25)] == [Stop(), MoveAxes(0.0, 0.0)]
        assert rest.streams is True

    def test_after_a_jog_rest_has_to_last_anew(self) -> None:
        paused = Paused()
        paused.stands()
        paused.rest.jog(Jog(0.5, None), 110.0)
        paused.rest.step(110.5, False)
        paused.stands(112.0)

    def test_while_an_axis_is_jogged_it_is_the_jog_that_is_sent(self) -> None:
        paused = Paused(SIDEREAL_RATE_DEG_S)
        paused.stands()
        assert paused.rest.streams is True
        paused.rest.jog(Jog(0.5, None), 110.0)
        assert paused.rest.streams is False

    @pytest.mark.parametrize("slow", ["ra", "dec"])
    def test_it_settles_for_as_long_as_the_slower_axis_brakes(self, slow: str) -> None:
        """4 °/s by 2 °/s² takes two seconds, and half a second is added."""
        profile = msgspec.structs.replace(PROFILE, **{slow: AxisLimits(4.0, 2.0)})
        rest = Rest(100.0, profile)
        rest.see(drives(0.0))
        for t in (101.0, 101.25):
            rest.step(t, True)
        rest.jog(Jog(0.5, None), 110.0)
        for t, wanted in ((110.5, STANDING), (112.99, STANDING), (113.01, Stop())):
            assert rest.step(t, False) == wanted

    @pytest.mark.parametrize("drive", [0.0, SIDEREAL_RATE_DEG_S])
    def test_a_jog_adds_to_rest_and_then_the_axes_settle(self, drive: float) -> None:
        paused = Paused(drive)
        assert paused.rest.jog(Jog(0.5, None), 100.5) == "the mount is coming to rest: jog once it stands"
        paused.stands()
        at_rest = 0.0 if drive else SIDEREAL_RATE_DEG_S
        assert paused.rest.jog(Jog(0.5, -0.25), 110.0) is None
        assert (paused.rest.jogging, paused.rest.at_rest) == (True, False)
        assert paused.rest.step(110.0, False) == MoveAxes(at_rest + 0.5, -0.25)
        # It brakes for 0.5 s and settles for 0.5 s: rest is commanded for so long.
        for t in (110.5, 111.49):
            assert paused.rest.step(t, False) == MoveAxes(at_rest, 0.0)
        assert paused.rest.jogging is False
        assert paused.rest.step(111.51, False) == Stop()
        # Another jog may come before it is at rest again.
        assert paused.rest.jog(Jog(0.5, None), 111.6) is None
        assert paused.rest.step(111.6, False) == MoveAxes(at_rest + 0.5, 0.0)

    def test_what_an_axis_cannot_do_is_refused(self) -> None:
        paused = Paused()
        paused.stands()
        told = paused.rest.jog(Jog(None, 1.5), 110.0)
        assert told is not None
        assert "declination" in told
        assert (paused.rest.jogging, paused.rest.at_rest) == (False, True)
        # The other axis can.
        assert paused.rest.jog(Jog(1.5, None), 110.5) is None

    def test_going_on_ends_jogs_and_refuses_more(self) -> None:
        paused = Paused()
        paused.stands()
        paused.rest.go_on()
        assert (paused.rest.going_on, paused.rest.at_rest) == (True, True)
        assert paused.rest.jog(Jog(0.5, None), 110.0) == "the run is about to go on"
        jogged = Paused()
        jogged.stands()
        jogged.rest.jog(Jog(0.5, None), 110.0)
        jogged.rest.go_on()
        assert jogged.rest.jogging is False
        assert jogged.rest.step(110.1, False) == Stop()
        jogged.stands(111.0)
        assert jogged.rest.step(112.0, True) == Hold()
        # Nor is it waited for until the axes have settled.
        settling = Paused()
        settling.stands()
        settling.rest.jog(Jog(0.5, None), 110.0)
        assert settling.rest.step(110.6, False) == MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
        settling.rest.go_on()
        assert settling.rest.step(110.65, False) == Stop()

    def test_jogs_that_are_ended_stay_so_while_the_key_is_held(self) -> None:
        paused = Paused()
        paused.stands()
        paused.rest.jog(Jog(0.5, None), 110.0)
        paused.rest.end_jogs("the operator stopped it")
        assert paused.rest.step(110.05, False) == Stop()
        assert paused.rest.jog(Jog(0.5, None), 110.1) == "the operator stopped it"
        # A fresh touch counts once the mount stands.
        assert paused.rest.jog(Jog(0.5, None), 111.0) == "the operator stopped it"
        paused.stands(112.0)
        assert paused.rest.jog(Jog(0.5, None), 113.0) is None
        again = Paused()
        again.stands()
        again.rest.jog(Jog(0.5, None), 110.0)
        again.rest.end_jogs("no")
        again.stands(110.1)
        assert again.rest.jog(Jog(0.5, None), 110.3) == "no"
        assert again.rest.jog(Jog(0.5, None), 110.6) == "no"
        assert again.rest.jog(Jog(0.5, None), 111.1) is None

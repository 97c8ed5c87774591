"""What offsets may ask of a mount, and where a course is, by hand: paces, ranges and limits made up here."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from sattrack.control.biases import (
    Biases,
    begin_search,
    change_offset,
    clear_biases,
    end_reached,
    follow_estimate,
    forget_estimate,
    nudge_biases,
)
from sattrack.control.camera_image import Camera
from sattrack.control.estimate import EstimatedBiases
from sattrack.control.offset import ChangeLimits, Offset, State, spiral_lasts_s
from sattrack.control.target import AxisPace, Course, Going, _cubic
from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.views.messages import OffsetBy, Search, SeenOffset
from tle.bias import NO_BIAS

NOW = 1_790_000_000.0
RA = AxisLimits(max_rate_deg_s=3.0, max_acceleration_deg_s2=10.0)
DEC = AxisLimits(max_rate_deg_s=2.0, max_acceleration_deg_s2=4.0)
PACE = AxisPace(2.0, -0.5, 1.0, -0.3, 0.5)
GOING = Going(0.05, 0.0, 1000.0, -3.0)
WIDE = ChangeLimits(100.0, 100.0)


class Paced(Biases):
    """Biases of a satellite whose pace and range are told."""

    def __init__(self, pace: AxisPace = PACE, going: Going = GOING) -> None:
        nowhere: Any = None
        super().__init__(NO_BIAS, nowhere, MountProfile(ra=RA, dec=DEC))
        self.asked: list[tuple[float, float]] = []
        self.going_at: list[float] = []
        course: Any = SimpleNamespace(axis_pace=self.pace_at, going=self.going)
        self.course, self._pace, self._going = course, pace, going

    def pace_at(self, utc_s: float, along_s: float) -> AxisPace:
        self.asked.append((utc_s - NOW, along_s))
        return self._pace

    def going(self, utc_s: float) -> Going:
        self.going_at.append(utc_s - NOW)
        return self._going


class TestBounds:
    @pytest.mark.parametrize(
        ("what", "change_s", "rate", "acceleration"),
        [
            # 80 % of what is spare beyond following, over the axis' motion for each unit; of the slower axis.
            ("along_s", 0.0, 0.8 * (3.0 - 1.0) / 2.0, 10.0 / 2.0),
            ("along_s", 0.5, 0.8 * (3.0 - 1.0) / 2.0, 10.0 / 2.0),
            # Back along the track an axis first loses the rate that it has.
            ("along_s", -0.5, 0.8 * (3.0 + 1.0) / 2.0, 10.0 / 2.0),
            ("cross_deg", 0.0, 0.8 * (3.0 - 1.0) * 0.5, 4.0),
            ("ra_cos_dec_deg", 0.0, 0.8 * (3.0 - 1.0) * 0.5, 4.0),
            ("ra_axis_deg", 0.0, 0.8 * (3.0 - 1.0), 10.0),
            ("dec_deg", 0.0, 0.8 * (2.0 - 0.3), 4.0),
            ("dec_axis_deg", 0.0, 0.8 * (2.0 - 0.3), 4.0),
        ],
    )
    def test_a_change_may_ask_for_what_the_slower_axis_has_to_spare(
        self, what: str, change_s: float, rate: float, acceleration: float
    ) -> None:
        limits = Paced().bounds(what, NOW, 2.0, 2.0 + change_s)
        assert limits == pytest.approx((rate, 0.45 * acceleration))
        assert Paced().bounds(what, NOW, 2.0, 2.0 + change_s, 0.15).acceleration == pytest.approx(
            0.15 * acceleration
        )

    def test_declination_may_be_the_slower_axis(self) -> None:
        pace = AxisPace(0.1, 2.0, -1.0, 0.5, 0.5)
        assert Paced(pace).bounds("along_s", NOW, 0.0, 0.0) == pytest.approx((0.8 * 1.5 / 2.0, 0.45 * 2.0))
        back = Paced(pace).bounds("along_s", NOW, 0.0, -0.5)
        assert back == pytest.approx((0.8 * 2.5 / 2.0, 0.45 * 2.0))
        # Forward, an axis that the satellite takes the other way than its bias has more to spare.
        other = AxisPace(0.1, -2.0, -1.0, 0.5, 0.5)
        assert Paced(other).bounds("along_s", NOW, 0.0, 0.5).rate == pytest.approx(0.8 * 2.5 / 2.0)
        assert Paced(other).bounds("along_s", NOW, 0.0, -0.5).rate == pytest.approx(0.8 * 1.5 / 2.0)

    def test_an_offset_of_one_axis_does_not_wait_for_the_other(self) -> None:
        """Of which the target takes nearly all."""
        ra_is_fast, dec_is_fast = AxisPace(2.0, -0.5, 2.9, 0.3, 0.5), AxisPace(2.0, -0.5, 1.0, -1.9, 0.5)
        for what in ("dec_deg", "dec_axis_deg"):
            assert Paced(ra_is_fast).bounds(what, NOW, 0.0, 0.0) == pytest.approx((0.8 * 1.7, 0.45 * 4.0))
        assert Paced(dec_is_fast).bounds("ra_axis_deg", NOW, 0.0, 0.0) == pytest.approx(
            (0.8 * 2.0, 0.45 * 10.0)
        )

    def test_where_the_target_takes_all_a_tenth_is_left(self) -> None:
        pace = AxisPace(2.0, 0.0, 3.5, 0.0, 0.5)
        assert Paced(pace).bounds("along_s", NOW, 0.0, 0.0) == pytest.approx((0.8 * 0.3 / 2.0, 0.45 * 5.0))

    def test_long_changes_are_judged_along_their_way_and_short_ones_at_their_end(self) -> None:
        short, long = Paced(), Paced()
        short.bounds("along_s", NOW, 1.0, 2.0)
        assert short.asked == [(0.0, 2.0), (2.0, 2.0)]
        long.bounds("along_s", NOW, 1.0, 4.0)
        assert long.asked == [(2.0, pytest.approx(1.0 + 0.5 * number)) for number in range(7)]
        # Those of more than a second are long, either way.
        for way_s, looks in ((0.99, 2), (-0.99, 2), (1.01, 7), (-1.01, 7)):
            one = Paced()
            one.bounds("along_s", NOW, 1.0, 1.0 + way_s)
            assert len(one.asked) == looks


class TestOrders:
    @pytest.mark.parametrize(
        ("order", "refused"),
        [
            (OffsetBy("along_s", "set", 60.0), False),
            (OffsetBy("along_s", "set", -60.1), True),
            (OffsetBy("cross_deg", "add", 5.0), False),
            (OffsetBy("cross_deg", "add", -5.1), True),
            (OffsetBy("along_s", "rate", 1.0), False),
            (OffsetBy("along_s", "rate", -1.01), True),
            (OffsetBy("dec_deg", "rate", 0.5), False),
            (OffsetBy("dec_deg", "rate", -0.51), True),
            (OffsetBy("dec_deg", "gradual", 1.0, 3600.0), False),
            (OffsetBy("dec_deg", "gradual", 1.0, 3601.0), True),
            (OffsetBy("dec_deg", "gradual", 1.0, 0.0), False),
            (OffsetBy("dec_deg", "gradual", 1.0, -0.1), True),
        ],
    )
    def test_how_far_an_offset_goes(self, order: OffsetBy, refused: bool) -> None:
        biases = Paced()
        assert (change_offset(biases, order, NOW) is not None) is refused
        assert biases.moving is not refused
        assert biases.offsets[order.what].idle is refused

    def test_one_that_is_too_far_may_come_back(self) -> None:
        biases = Paced()
        biases.offsets["dec_deg"] = Offset(8.0)
        assert change_offset(biases, OffsetBy("dec_deg", "add", -1.0), NOW) is None
        assert change_offset(biases, OffsetBy("dec_deg", "add", 1.0), NOW + 60.0) is not None

    @pytest.mark.parametrize(
        ("how", "value", "total", "rate"),
        [
            ("add", 0.5, 1.5, 0.0),
            ("set", 0.5, 0.5, 0.0),
            ("gradual", 0.5, 0.5, 0.0),
            ("stop", None, 1.0, 0.0),
            ("reset", None, 0.0, 0.0),
            ("rate", 0.01, 1.0 + 0.01 * 99.25, 0.01),
        ],
    )
    def test_each_order_leads_there(self, how: Any, value: float | None, total: float, rate: float) -> None:
        biases = Paced()
        biases.offsets["along_s"] = Offset(1.0)
        assert (
            change_offset(biases, OffsetBy("along_s", how, value, 10.0 if how == "gradual" else None), NOW)
            is None
        )
        assert biases.offsets["along_s"].state(NOW + 100.0) == pytest.approx((total, rate, 0.0))
        # The bounds are those of the way from where it is to where it goes.
        goes_to = {"add": 1.5, "set": 0.5, "gradual": 0.5, "reset": 0.0}.get(how, 1.0)
        assert biases.asked[-1] == (2.0, pytest.approx(goes_to))
        gradual = biases.offsets["along_s"].ended_utc_s() - NOW
        assert (gradual == pytest.approx(10.0)) is (how == "gradual")

    @pytest.mark.parametrize(
        ("along_s", "cross_deg", "refused"),
        [(60.0, 5.0, False), (60.1, 0.0, True), (0.0, -5.1, True), (-61.0, 0.0, True)],
    )
    def test_a_nudge_moves_along_and_across_together_or_not_at_all(
        self, along_s: float, cross_deg: float, refused: bool
    ) -> None:
        biases = Paced()
        told = nudge_biases(biases, along_s, cross_deg, NOW)
        assert told == ("nudge refused: biases go to 60 s along and 5° across" if refused else None)
        there = (0.0, 0.0) if refused else (along_s, cross_deg)
        assert biases.totals(NOW + 100.0) == pytest.approx(there)

    @pytest.mark.parametrize(
        ("along_s", "cross_deg", "refused"),
        [(0.0, -0.1, False), (0.5, 0.0, False), (0.5, -0.1, False), (0.0, 0.1, True), (0.0, -10.3, True)],
    )
    def test_a_nudge_may_come_back_from_where_a_rate_or_a_search_has_led(
        self, along_s: float, cross_deg: float, refused: bool
    ) -> None:
        biases = Paced()
        biases.offsets["cross_deg"] = Offset(5.15)
        assert (nudge_biases(biases, along_s, cross_deg, NOW) is not None) is refused

    def test_a_nudge_of_one_leaves_the_other(self) -> None:
        biases = Paced()
        nudge_biases(biases, 1.0, 0.0, NOW)
        assert (biases.offsets["along_s"].idle, biases.offsets["cross_deg"].idle) == (False, True)


class TestSearches:
    @pytest.mark.parametrize(
        ("search", "limits", "refused"),
        [
            # Turning in the centre 4π·v²/spacing, coming up to speed 1.5·v/2 s: 0.63277°/s² together.
            (Search("spiral", 0.2, 0.1), (0.101, 0.633), None),
            (Search("spiral", 0.2, 0.1), (0.099, 0.633), "the mount cannot do 0.1°/s with arms 0.2° apart"),
            (Search("spiral", 0.2, 0.1), (0.101, 0.632), "the mount cannot do 0.1°/s"),
            (Search("spiral", 0.001, 0.0001), (9.0, 9.0), None),
            (Search("spiral", 2.0, 2.0), (9.0, 99.0), None),
            (Search("spiral", 0.0009, 0.01), (9.0, 9.0), "spacing_deg 0.0009; give 0.001 to 2"),
            (Search("spiral", 2.1, 0.01), (9.0, 9.0), "spacing_deg 2.1; give"),
            (Search("spiral", 0.1, 0.00009), (9.0, 9.0), "speed_deg_s 9e-05; give 0.0001 to 2"),
            (Search("spiral", 0.1, 2.1), (9.0, 999.0), "speed_deg_s 2.1; give"),
            # 2 s · 2π/20 s = 0.6283 s/s, and 0.75 of that a second as it begins.
            (Search("sweep", reach_s=2.0, period_s=20.0), (0.629, 0.472), None),
            (
                Search("sweep", reach_s=2.0, period_s=20.0),
                (0.628, 0.472),
                "the mount cannot sweep 2 s in 20 s",
            ),
            (Search("sweep", reach_s=2.0, period_s=20.0), (0.629, 0.471), "the mount cannot sweep 2 s"),
            # 0.5 s · (2π/4 s)² = 1.2337 s/s² once it turns faster than it begins.
            (Search("sweep", reach_s=0.5, period_s=4.0), (9.0, 1.234), None),
            (Search("sweep", reach_s=0.5, period_s=4.0), (9.0, 1.233), "the mount cannot sweep"),
            (Search("sweep", reach_s=0.01, period_s=2.0), (9.0, 9.0), None),
            (Search("sweep", reach_s=60.0, period_s=600.0), (9.0, 9.0), None),
            (Search("sweep", reach_s=0.009, period_s=9.0), (9.0, 9.0), "reach_s 0.009; give 0.01 to 60"),
            (Search("sweep", reach_s=61.0, period_s=600.0), (9.0, 9.0), "reach_s 61; give"),
            (Search("sweep", reach_s=0.01, period_s=1.9), (9.0, 9.0), "period_s 1.9; give 2 to 600"),
            (Search("sweep", reach_s=0.01, period_s=601.0), (9.0, 9.0), "period_s 601; give"),
        ],
    )
    def test_what_a_mount_can_do_is_begun(
        self, search: Search, limits: tuple[float, float], refused: str | None
    ) -> None:
        biases = Paced()
        asked: list[str] = []
        biases.bounds = lambda what, *_: asked.append(what) or ChangeLimits(*limits)  # type: ignore[method-assign, func-returns-value]
        told = begin_search(biases, search, NOW)
        assert asked == ["cross_deg" if search.how == "spiral" else "along_s"]
        assert (told is None) is (refused is None)
        if refused is not None:
            assert told is not None
            assert told.startswith(f"{search.how} refused: {refused}")
        assert (biases.pattern_at(NOW + 1.0) is None) is (refused is not None)
        assert biases.pattern_at(NOW - 1.0) is None

    @pytest.mark.parametrize(("pace", "reach"), [(0.05, 3.0), (0.5, 5.0)])
    def test_a_spiral_goes_as_far_as_a_bias_may(self, pace: float, reach: float) -> None:
        biases = Paced(going=Going(pace, 0.0, 1000.0, 0.0))
        biases.bounds = lambda *_: WIDE  # type: ignore[method-assign]
        biases.offsets["along_s"] = Offset(0.5)
        begin_search(biases, Search("spiral", 1.0, 0.5), NOW)
        lasts_s = spiral_lasts_s(reach, 1.0, 0.5)
        assert end_reached(biases, NOW + lasts_s - 0.01) is None
        # At the satellite's own pace there, half a second further on.
        assert biases.going_at[-1] == pytest.approx(lasts_s + 0.49)
        told = end_reached(biases, NOW + lasts_s + 0.01)
        assert told == f"the spiral found nothing within {reach:.1f}° and went back"
        assert biases.pattern_at(NOW + lasts_s + 0.02) is None

    @pytest.mark.parametrize(
        "second", [Search("spiral", 1.0, 0.5), Search("sweep", reach_s=0.5, period_s=20.0)]
    )
    def test_another_search_begins_where_the_first_has_led_and_goes_back_gently(self, second: Search) -> None:
        biases = Paced()
        biases.bounds = lambda *_: WIDE  # type: ignore[method-assign]
        assert begin_search(biases, Search("spiral", 1.0, 0.5), NOW) is None
        before = biases.applied(NOW + 4.9999)
        assert math.hypot(before[0].value, before[1].value) > 0.1
        assert begin_search(biases, second, NOW + 5.0) is None
        after = biases.applied(NOW + 5.0001)
        assert [one.value for one in after] == pytest.approx([one.value for one in before], abs=5e-3)

    @pytest.mark.parametrize(
        "search", [Search("spiral", 0.2, 0.1), Search("sweep", reach_s=0.5, period_s=20.0)]
    )
    def test_a_search_that_is_cancelled_goes_back_to_what_the_operator_has_found(
        self, search: Search
    ) -> None:
        biases = Paced()
        nudge_biases(biases, 0.3, 0.1, NOW - 60.0)
        begin_search(biases, search, NOW)
        assert begin_search(biases, Search("cancel"), NOW + 8.0) is None
        assert [one.value for one in biases.applied(NOW + 120.0)] == pytest.approx([0.3, 0.1])

    @pytest.mark.parametrize("ended_by", ["cancel", "clear", "estimate"])
    @pytest.mark.parametrize("share", [0.2, 0.4, 0.6, 0.8])
    def test_no_way_back_from_a_search_asks_more_of_an_axis_than_it_has(
        self, share: float, ended_by: str
    ) -> None:
        """An axis at 1 °/s of its 3 that 2 °/s follow for each second a second: from behind, 1 s/s is all."""
        biases = Paced()
        assert begin_search(biases, Search("sweep", reach_s=6.0, period_s=60.0), NOW) is None
        ends_s = NOW + 60.0 * share
        if ended_by == "cancel":
            assert begin_search(biases, Search("cancel"), ends_s) is None
        elif ended_by == "clear":
            clear_biases(biases, ends_s)
        else:
            follow_estimate(biases, EstimatedBiases(0.0, 0.0, 0.0, 0.0, 0.1, 0.1), True, ends_s)
        before_s = biases.applied(ends_s)[0].value
        rates = [biases.applied(ends_s + 0.1 * number)[0].rate for number in range(1, 200)]
        assert abs(before_s) > 2.9
        assert biases.applied(ends_s + 30.0)[0] == pytest.approx(State(0.0, 0.0, 0.0), abs=1e-9)
        assert min(rates) >= -2.0
        assert max(rates) <= 1.0 + 1e-9

    @pytest.mark.parametrize("search", [Search("spiral", 0.1, 0.05), Search("sweep", reach_s=2, period_s=20)])
    def test_a_target_that_has_no_track_is_not_searched_along_it(self, search: Search) -> None:
        """Of a star, a planet and the Moon a second of bias moves too little: a spiral would be a line."""
        words = (
            f"{search.how} refused: the target hardly moves along a track; offset ra_cos_dec_deg and dec_deg"
        )
        assert begin_search(Paced(going=GOING._replace(pace_deg_s=0.001)), search, NOW) == words
        assert begin_search(Paced(going=GOING._replace(pace_deg_s=0.0042)), search, NOW) is None

    def test_a_sweep_goes_on_until_it_is_told_to_end(self) -> None:
        biases = Paced()
        assert begin_search(biases, Search("sweep", reach_s=0.5, period_s=20.0), NOW) is None
        for after_s in (1.0, 100.0, 10_000.0):
            assert end_reached(biases, NOW + after_s) is None
        assert biases.pattern_at(NOW + 10_000.0) is not None

    def test_what_was_fed_during_a_search_is_known_after_the_next_has_begun(self) -> None:
        """Frames come seconds late, and are compared with what was fed at their own instants."""
        biases = Paced()
        assert begin_search(biases, Search("sweep", reach_s=0.5, period_s=20.0), NOW) is None
        before = biases.applied(NOW + 3.0)
        assert abs(before[0].value) > 0.1
        for after_s in (5.0, 7.0):
            assert begin_search(biases, Search("sweep", reach_s=0.2, period_s=9.0), NOW + after_s) is None
        assert biases.applied(NOW + 3.0) == before

    @pytest.mark.parametrize(("what", "most"), [("along_s", 60.0), ("dec_deg", 5.0)])
    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_a_rate_that_leads_out_is_stopped_and_one_that_leads_back_is_not(
        self, what: str, most: float, sign: float
    ) -> None:
        biases = Paced()
        biases.offsets[what] = Offset(sign * (most - 0.5))
        change_offset(biases, OffsetBy(what, "rate", sign * 0.1), NOW)
        assert end_reached(biases, NOW + 4.0) is None
        assert end_reached(biases, NOW + 7.0) == f"{what} went as far as it may, {most:g}, and was stopped"
        assert end_reached(biases, NOW + 8.0) is None
        change_offset(biases, OffsetBy(what, "rate", -sign * 0.1), NOW + 20.0)
        assert end_reached(biases, NOW + 21.0) is None


def test_what_is_cleared_leaves_from_where_it_is() -> None:
    biases = Paced()
    biases.begin_estimated(0.5, 2.0)
    nudge_biases(biases, 1.0, 0.2, NOW - 60.0)
    clear_biases(biases, NOW)
    (along, cross), (along_later, cross_later) = biases.applied(NOW + 1e-3), biases.applied(NOW + 60.0)
    assert along.value == pytest.approx(1.5, abs=1e-3)
    assert cross.value == pytest.approx(0.2 + math.degrees(math.atan(0.002)), abs=1e-3)
    assert (along_later.value, cross_later.value) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_an_offset_across_is_cleared_without_a_step_though_nothing_was_observed() -> None:
    """In the middle of its change: place, rate and acceleration go on from what they are."""
    biases = Paced()
    nudge_biases(biases, 0.0, 0.2, NOW)
    before = biases.applied(NOW + 0.7)[1]
    assert min(before.value, before.rate) > 0.05
    clear_biases(biases, NOW + 0.7)
    assert biases.applied(NOW + 0.7)[1] == pytest.approx(before)
    assert biases.applied(NOW + 60.0)[1] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("estimated_km", [0.0, 2.0])
def test_a_search_is_cleared_from_where_it_has_led(estimated_km: float) -> None:
    """A satellite that moves by 1° for each second along its track."""
    biases = Paced(going=Going(1.0, 0.0, 1000.0, 0.0))
    biases.begin_estimated(0.0, estimated_km)
    assert begin_search(biases, Search("spiral", 0.2, 0.1), NOW) is None
    before = biases.applied(NOW + 6.0)
    assert abs(before[1].value - math.degrees(math.atan(estimated_km / 1000.0))) > 0.1
    clear_biases(biases, NOW + 6.0)
    for was, goes_on in zip(before, biases.applied(NOW + 6.0), strict=True):
        assert goes_on[:2] == pytest.approx(was[:2])
    assert biases.applied(NOW + 120.0) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_the_first_estimate_takes_the_place_of_the_operators_biases_without_a_step() -> None:
    """In the middle of a nudge: place and rate go on from what they are."""
    biases = Paced()
    nudge_biases(biases, 1.0, 0.2, NOW)
    before = biases.applied(NOW + 0.7)
    assert min(before[0].rate, before[1].rate) > 0.05
    follow_estimate(biases, EstimatedBiases(0.3, -2.0, 0.0, 0.0, 0.1, 0.1), True, NOW + 0.7)
    for was, goes_on in zip(before, biases.applied(NOW + 0.7), strict=True):
        assert goes_on.value == pytest.approx(was.value, rel=1e-6)
        assert goes_on.rate == pytest.approx(was.rate, rel=2e-3)
    along, cross = biases.applied(NOW + 60.0)
    assert (along.value, cross.value) == pytest.approx((0.3, -math.degrees(math.atan(0.002))))


def test_what_was_fed_is_known_as_far_back_as_every_offset_is() -> None:
    """An estimate that is followed twice a second is remembered for a minute."""
    by_hand, followed = Paced(), Paced()
    assert by_hand.known_since_utc_s == -math.inf
    for number in range(131):
        change_offset(by_hand, OffsetBy("camera_x_deg", "add", 1e-4), NOW + number)
        read = EstimatedBiases(1e-4 * number, 1e-3 * number, 0.0, 0.0, 0.1, 0.1)
        follow_estimate(followed, read, False, NOW + 0.5 * number)
    assert by_hand.known_since_utc_s == NOW + 3.0
    assert followed.known_since_utc_s == NOW + 1.5


@pytest.mark.parametrize("away_km", [20.0, 200.0])
def test_an_estimate_that_is_left_is_left_as_gently_as_the_sky_allows(away_km: float) -> None:
    """From rest to rest by a quintic, at 0.8°/s and 0.15 of 4°/s² across, 1000 km away."""
    biases = Paced()
    biases.begin_estimated(0.0, away_km)
    forget_estimate(biases, NOW)
    rate, acceleration = math.radians(0.8) * 1000.0, math.radians(0.15 * 4.0) * 1000.0
    takes_s = max(1.875 * away_km / rate, math.sqrt(10.0 / math.sqrt(3.0) * away_km / acceleration))
    assert biases.estimated_cross_km.ended_utc_s() - NOW == pytest.approx(takes_s, rel=1e-3)
    assert biases.totals(NOW + 60.0) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    # At 0.05 °/s and 1000 km: 1″ and 5.3″ away.
    ("along_s", "cross_km", "within_s"),
    [(0.002, -0.005, 0.2), (0.0185, -0.02, 0.5)],
)
def test_what_an_observation_changes_by_little_is_fed_within_half_a_second_and_sooner_where_it_is_close(
    first: bool, along_s: float, cross_km: float, within_s: float
) -> None:
    biases = Paced()
    follow_estimate(biases, EstimatedBiases(along_s, cross_km, 1e-3, 2e-4, 0.1, 0.1), first, NOW)
    for one in (biases.estimated_along, biases.estimated_cross_km):
        assert one.ended_utc_s() - NOW == pytest.approx(within_s)
    after_s = NOW + within_s
    assert biases.estimated_along.state(after_s)[:2] == pytest.approx((along_s + 1e-3 * within_s, 1e-3))
    assert biases.estimated_cross_km.state(after_s)[:2] == pytest.approx((cross_km + 2e-4 * within_s, 2e-4))


class TestAcross:
    def test_kilometres_are_an_angle_at_the_satellites_range(self) -> None:
        """At 1000 km, 2 km are atan(0.002); as the range shrinks by 3 km/s the angle grows."""
        biases = Paced()
        biases.begin_estimated(0.5, 2.0)
        along, cross = biases.applied(NOW)
        assert along == (0.5, 0.0, 0.0)
        assert biases.going_at == [0.5]
        assert cross.value == pytest.approx(math.degrees(math.atan(0.002)))
        assert cross.rate == pytest.approx(math.degrees(3.0 * 2.0 / (1000.0**2 + 2.0**2)))
        assert biases.totals(NOW) == pytest.approx((0.5, cross.value))
        assert (biases.moving, Paced().moving) == (True, False)

    def test_an_estimate_that_is_being_left_bends_by_as_many_degrees(self) -> None:
        biases = Paced()
        biases.begin_estimated(0.0, 20.0)
        forget_estimate(biases, NOW)
        bent = biases.estimated_cross_km.state(NOW + 1.0).acceleration
        assert abs(bent) > 0.1
        _, cross = biases.applied(NOW + 1.0)
        assert cross.acceleration == pytest.approx(math.degrees(bent / 1000.0))

    def test_degrees_are_kilometres_there(self) -> None:
        biases = Paced()
        nudge_biases(biases, 0.5, 0.0, NOW - 60.0)
        biases.going_at.clear()
        km = biases.cross_km(NOW, State(0.1, 0.02, 0.003))
        assert biases.going_at == [0.5]
        assert km.value == pytest.approx(1000.0 * math.tan(math.radians(0.1)))
        assert km.rate == pytest.approx(math.radians(0.02) * 1000.0 - math.radians(0.1) * 3.0)
        assert km.acceleration == pytest.approx(math.radians(0.003) * 1000.0 - 2.0 * math.radians(0.02) * 3.0)


class TestCourse:
    """Right ascension by 0.6°/s through 0 h at 60° of declination; a range of 1000 + 3 x + x²/2 km."""

    @staticmethod
    def course() -> Course:
        def at(t: Any, bias: Any) -> SimpleNamespace:
            x = float(t.unix_s) - NOW + bias.along_s
            return SimpleNamespace(
                ra_deg=(359.0 + 0.6 * x) % 360.0,
                dec_deg=60.0,
                ra_rate_deg_s=0.6,
                dec_rate_deg_s=0.0,
                range_km=1000.0 + 3.0 * x + 0.5 * x * x,
            )

        propagator: Any = SimpleNamespace(at=at)
        return Course(propagator)

    @pytest.mark.parametrize("x", [0.0, 0.3, 1.7, 2.5, 40.25])
    def test_pace_and_range_are_those_of_the_sky_with_their_rates(self, x: float) -> None:
        going = self.course().going(NOW + x)
        assert going.pace_deg_s == pytest.approx(0.3, rel=1e-4)
        assert going.pace_rate == pytest.approx(0.0, abs=1e-5)
        assert going.range_km == pytest.approx(1000.0 + 3.0 * x + 0.5 * x * x, abs=0.05)
        assert going.range_rate_km_s == pytest.approx(3.0 + x, abs=1e-3)

    def test_one_that_comes_straight_on_has_some_pace_and_one_at_the_pole_some_width(self) -> None:
        """A spiral's degrees along the track, and limits of the right ascension, are divided by them."""
        stands = SimpleNamespace(
            ra_deg=10.0, dec_deg=90.0, ra_rate_deg_s=0.0, dec_rate_deg_s=0.0, range_km=500.0
        )
        propagator: Any = SimpleNamespace(at=lambda *_: stands)
        course = Course(propagator)
        assert course.going(NOW + 0.3) == pytest.approx((1e-3, 0.0, 500.0, 0.0))
        assert course.axis_pace(NOW, 0.0).cos_dec == 0.01

    def test_axes_move_by_the_bias_and_by_themselves(self) -> None:
        pace = self.course().axis_pace(NOW + 1.6, 0.0)
        assert pace == pytest.approx((0.6, 0.0, 0.6, 0.0, 0.5), abs=1e-4)


class TestCamera:
    @pytest.mark.parametrize(
        ("camera", "axes"),
        [
            (Camera(), (3.0, 2.0)),
            (Camera(flip=True), (-3.0, 2.0)),
            (Camera(rotation_deg=90.0), (-2.0, 3.0)),
            (Camera(rotation_deg=90.0, flip=True), (-2.0, -3.0)),
            (Camera(rotation_deg=-90.0), (2.0, -3.0)),
        ],
    )
    def test_right_and_up_are_hour_angle_and_declination_turned(
        self, camera: Camera, axes: tuple[float, float]
    ) -> None:
        assert camera.on_axes(3.0, 2.0) == pytest.approx(axes)

    def test_pixels_need_a_scale(self) -> None:
        utc = "2026-10-02T13:05:24Z"
        pixels = SeenOffset(utc, dx_px=10.0, dy_px=-4.0, sigma_px=0.5)
        assert Camera().in_arcsec(pixels) is None
        assert Camera(scale_arcsec_px=2.5).in_arcsec(pixels) == (25.0, -10.0, 1.25)
        middle = SeenOffset(utc, dx_px=0.0, dy_px=0.0, sigma_px=0.5)
        assert Camera(scale_arcsec_px=2.5).in_arcsec(middle) == (0.0, 0.0, 1.25)
        seconds = SeenOffset(utc, dx_arcsec=10.0, dy_arcsec=-4.0, sigma_arcsec=0.5)
        for camera in (Camera(), Camera(scale_arcsec_px=2.5)):
            assert camera.in_arcsec(seconds) == (10.0, -4.0, 0.5)


@pytest.mark.parametrize("values", [(0.0, 0.0, 1.0, 0.0), (3.0, -1.0, 4.0, 1.5)])
def test_a_spline_goes_through_the_middle_two_with_the_slopes_of_their_neighbours(
    values: tuple[float, float, float, float],
) -> None:
    """Catmull and Rom: at both ends value and central difference; in the middle as their weights have it."""
    a, b, c, d = values
    assert _cubic(values, 0.0) == pytest.approx((b, 0.5 * (c - a)))
    assert _cubic(values, 1.0) == pytest.approx((c, 0.5 * (d - b)))
    assert _cubic(values, 0.5)[0] == pytest.approx((-a + 9.0 * b + 9.0 * c - d) / 16.0)
    assert _cubic(values, 0.5)[1] == pytest.approx((a - 11.0 * b + 11.0 * c - d) / 8.0)

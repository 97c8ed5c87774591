"""The operator's messages and an estimate as offsets, by hand: pace, range and readings are made up."""

from __future__ import annotations

import math
from types import SimpleNamespace as Made
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from test_bias_bounds import NOW, Paced

from sattrack.control.camera_image import NO_CAMERAS, Camera, Cameras
from sattrack.control.estimate import EstimatedBiases
from sattrack.control.offset import Pattern
from sattrack.control.steering import Steering
from sattrack.mount.model import MountProfile
from sattrack.runtime import demo_pass
from sattrack.views.messages import (
    ClearBias,
    DropRemembered,
    Guide,
    Nudge,
    ObservationMessage,
    OffsetBy,
    Search,
    SeenOffset,
)
from sattrack.views.run import CameraView, RememberedView
from tle.bias import NO_BIAS, Bias
from tle.errors import SubOrbitalError
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Sequence

PROFILE = MountProfile(command_delay_s=0.02)
REACTS_S = 3 * 0.05 + 0.02
SEEN = RememberedView("observations", NOW - 6000.0, 0.8, 0.1, 2.0, 0.3, None, 40, 7)
NUDGED = RememberedView("nudge", NOW - 6000.0, 0.8, None, None, None, 0.05, 0, 7)


def steering(cameras: Cameras = NO_CAMERAS, remembered: RememberedView | None = None) -> Steering:
    """Return the steering of a satellite 1000 km away that moves by 0.05° for each second along its track."""
    propagator = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    bias = Bias(0.8, 0.05) if remembered is NUDGED else NO_BIAS
    one = Steering(propagator, PROFILE, bias, cameras, NOW - 60.0, remembered)
    paced = Paced()
    paced.offsets, paced._plain = one.biases.offsets, one.biases._plain
    paced.estimated_along = one.biases.estimated_along
    paced.estimated_cross_km = one.biases.estimated_cross_km
    one.biases = paced
    return one


def reads(one: Steering, **changes: float) -> None:
    """Have the estimate read so from now on."""
    numbers = dict.fromkeys(EstimatedBiases._fields, 0.0) | changes
    one.estimator.reading = lambda *_, **__: EstimatedBiases(**numbers)  # type: ignore[method-assign]


@pytest.mark.parametrize("order", [OffsetBy("along_s", "set", 0.3), Nudge(along_s=0.1)])
def test_an_offset_of_a_target_below_the_ground_is_refused_in_words(order: OffsetBy | Nudge) -> None:
    """Its elements are no orbit where the offset leads: the run goes on, or ends, by its own rules."""
    one = steering()

    def ended(*_: float) -> Any:
        raise SubOrbitalError("ISS (25544) is below the ground", 6)

    one.biases._paces = ended  # type: ignore[method-assign]
    one.obey(order, NOW)
    assert one.refusal == "nothing is offset: ISS (25544) is below the ground"
    assert one.biases.applied(NOW)[0].value == 0.0


class TestRemembered:
    @pytest.mark.parametrize("known", [SEEN, NUDGED])
    def test_a_bias_that_is_dropped_is_taken_away_once(self, known: RememberedView) -> None:
        one = steering(remembered=known)
        assert one.remembered == known
        along, cross = one.biases.applied(NOW)
        assert along.value == 0.8
        assert cross.value == pytest.approx(0.05 if known is NUDGED else math.degrees(math.atan(0.002)))
        one.obey(DropRemembered(), NOW)
        assert one.refusal is None
        assert one.biases.totals(NOW + 60.0) == pytest.approx((0.0, 0.0), abs=1e-12)
        assert (one.remembered or known).state == "dropped"
        one.obey(DropRemembered(), NOW + 60.0)
        assert one.refusal == "no remembered bias is in force: it was dropped"
        assert one.biases.totals(NOW + 120.0) == pytest.approx((0.0, 0.0), abs=1e-12)

    @pytest.mark.parametrize("how", ["set", "gradual", "reset"])
    def test_dropping_leaves_what_the_operator_put_in_its_place(self, how: str) -> None:
        one, put = steering(remembered=NUDGED), 0.0 if how == "reset" else 2.0
        value, seconds = None if how == "reset" else put, 10.0 if how == "gradual" else None
        one.obey(OffsetBy("along_s", how, value, seconds), NOW)
        one.obey(DropRemembered(), NOW + 20.0)
        assert one.biases.totals(NOW + 60.0) == pytest.approx((put, 0.0), abs=1e-12)

    def test_one_whose_drop_is_refused_stays_in_force(self) -> None:
        one = steering(remembered=NUDGED)
        one.obey(Nudge(along_s=-60.5), NOW)
        one.obey(DropRemembered(), NOW + 20.0)
        assert one.refusal == "nudge refused: biases go to 60 s along and 5° across"
        assert (one.remembered or SEEN).state == "in force"
        assert one.biases.totals(NOW + 60.0) == pytest.approx((-59.7, 0.05))

    def test_without_one_there_is_nothing_to_drop(self) -> None:
        one = steering()
        one.obey(DropRemembered(), NOW)
        assert (one.remembered, one.refusal) == (None, "no remembered bias is in force")

    def test_one_that_is_cleared_stays_so(self) -> None:
        one = steering(remembered=SEEN)
        one.obey(ClearBias(), NOW)
        assert (one.remembered or SEEN).state == "cleared"
        assert one.biases.totals(NOW + 60.0) == (0.0, 0.0)
        one.obey(DropRemembered(), NOW + 60.0)
        one.obey(ClearBias(), NOW + 60.0)
        assert (one.remembered or SEEN).state == "cleared"

    def test_one_is_replaced_while_observations_are_followed(self) -> None:
        one = steering(remembered=SEEN)
        reads(one, along_s=0.3, cross_km=-1.0)
        one.estimator.filter, one._estimated = Made(), True  # type: ignore[assignment]
        assert one.watch(NOW) is True
        assert (one.remembered or SEEN).state == "replaced"
        assert one.biases.totals(NOW + 60.0)[0] == pytest.approx(0.3)

    @pytest.mark.parametrize("known", [SEEN, NUDGED])
    def test_one_that_was_replaced_does_not_come_back_where_the_estimate_is_left(
        self, known: RememberedView
    ) -> None:
        one = steering(remembered=known)
        reads(one, along_s=0.3, cross_km=-1.0)
        one.estimator.filter, one._estimated = Made(), True  # type: ignore[assignment]
        assert one.watch(NOW) is True
        one._leave_estimate(NOW + 5.0)
        assert (one.remembered or known).state == "replaced"
        one.obey(DropRemembered(), NOW + 60.0)
        assert one.refusal == "no remembered bias is in force: it was replaced"
        assert one.biases.totals(NOW + 120.0) == pytest.approx((0.0, 0.0), abs=1e-12)

    def test_one_stays_in_force_where_what_would_have_replaced_it_was_never_followed(self) -> None:
        one = steering(remembered=SEEN)
        one._estimated = True
        one._leave_estimate(NOW)
        assert (one.remembered or NUDGED).state == "in force"
        assert one.biases.totals(NOW + 60.0)[0] == 0.8


class TestFollowing:
    def following(self, **reading: float) -> Steering:
        one = steering()
        reads(one, **reading)
        one.estimator.filter, one._estimated = Made(), True  # type: ignore[assignment]
        assert one.watch(NOW) is True
        return one

    @pytest.mark.parametrize(
        ("changes", "news"),
        [
            ({}, False),
            ({"along_s": 0.5 + 1.9e-6}, False),
            ({"along_s": 0.5 - 2.1e-6}, True),
            ({"cross_km": -1.5 + 0.9e-5}, False),
            ({"cross_km": -1.5 - 1.1e-5}, True),
        ],
    )
    def test_what_is_fed_already_is_no_news(self, changes: dict[str, float], news: bool) -> None:
        one = self.following(along_s=0.5, cross_km=-1.5)
        reads(one, **({"along_s": 0.5, "cross_km": -1.5} | changes))
        assert one.watch(NOW + 0.49) is False
        assert one.watch(NOW + 0.51) is news

    def test_a_drift_and_a_bend_are_followed_as_a_parabola(self) -> None:
        moving = {
            "along_rate": 0.01, "along_curve": 0.002, "cross_rate_km_s": -0.02, "cross_curve_km_s2": 0.004,
        }  # fmt: skip
        one = self.following(along_s=0.5, cross_km=-1.5, **moving)
        for t in (10.0, 30.0):
            gone = t - REACTS_S
            along, cross = one.biases.estimated_along, one.biases.estimated_cross_km
            assert along.total_at(NOW + t) == pytest.approx(0.5 + 0.01 * gone + 0.001 * gone * gone)
            assert cross.total_at(NOW + t) == pytest.approx(-1.5 - 0.02 * gone + 0.002 * gone * gone)
        # Half a second on, the estimate says of then what is fed: nothing changes.
        reads(
            one,
            along_s=0.5 + 0.01 * 0.6 + 0.001 * 0.36,
            along_rate=0.01 + 0.002 * 0.6,
            along_curve=0.002,
            cross_km=-1.5 - 0.02 * 0.6 + 0.002 * 0.36,
            cross_rate_km_s=-0.02 + 0.004 * 0.6,
            cross_curve_km_s2=0.004,
        )
        assert one.watch(NOW + 0.6) is False

    @pytest.mark.parametrize("order", [ClearBias(), Guide("reject")])
    def test_after_an_estimate_was_left_the_next_is_a_first_one_again(self, order: ClearBias | Guide) -> None:
        """It takes the place of what the operator has found meanwhile; nothing is left of the one before."""
        one = self.following(along_s=0.5, cross_km=-1.5)
        one.estimator._undo = (None, None)
        one.obey(order, NOW + 10.0)
        assert one.estimator.filter is None
        assert one.biases.totals(NOW + 60.0) == pytest.approx((0.0, 0.0), abs=1e-12)
        one.obey(Nudge(along_s=2.0, cross_deg=0.1), NOW + 60.0)
        assert one.watch(NOW + 61.0) is False
        reads(one, along_s=0.3, cross_km=1.0)
        one.estimator.filter, one._estimated = Made(), True  # type: ignore[assignment]
        assert one.watch(NOW + 70.0) is True
        assert one.biases.totals(NOW + 90.0) == pytest.approx((0.3, math.degrees(math.atan(0.001))))

    def test_an_estimate_that_says_nothing_changes_nothing(self) -> None:
        one = self.following(along_s=0.5)
        one.estimator.reading = lambda *_, **__: None  # type: ignore[method-assign]
        assert one.watch(NOW + 0.6) is False
        assert one.biases.totals(NOW + 60.0)[0] == 0.5


def test_what_was_seen_by_dates_that_turn_out_wrong_is_forgotten() -> None:
    one, forgotten = steering(), []
    one.estimator.forget = lambda: forgotten.append(True)  # type: ignore[method-assign]
    for waiting, changed, forgets in (([], True, False), ([1], False, False), ([1], True, True)):
        one.clocks = Made(waiting=waiting, watch=lambda _, changed=changed: changed)  # type: ignore[assignment]
        one.watch(NOW)
        assert bool(forgotten) is forgets


class TestSearches:
    """On a mount that moves by up to 0.8 seconds of the track a second, and 0.8°/s across it."""

    def found(self, field_deg: float | None, along_sigma_s: float, cross_sigma_km: float) -> Any:
        one = steering(Cameras(field_deg=field_deg))
        reads(one, along_sigma_s=along_sigma_s, cross_sigma_km=cross_sigma_km)
        one.obey(Search("auto"), NOW)
        return one.refusal or one.biases.patterns[-1]

    def test_it_goes_by_where_the_mount_must_be_fed_and_not_by_where_the_satellite_is(self) -> None:
        one, fed = steering(Cameras(field_deg=0.1)), []
        one.estimator.reading = lambda *_, **how: fed.append(how)  # type: ignore[method-assign]
        one.obey(Search("auto"), NOW)
        assert fed == [{"fed": True}]
        assert one.refusal == "auto refused: nothing seen yet shows where to search"

    def test_along_the_track_it_sweeps_two_sigmas_as_fast_as_the_mount_can(self) -> None:
        """0.1° at half a field of 0.1° a second is a turn of 4π s: too fast, and 0.7 times that is not."""
        one = self.found(0.1, 1.0, 0.2)
        seconds = 4.0 * math.pi / 0.7
        assert one == Pattern("sweep", 2.0, pytest.approx(seconds), NOW + REACTS_S, math.inf)

    @pytest.mark.parametrize(
        ("field_deg", "spacing_deg", "speed_deg_s"),
        [
            (0.1, 0.07, 0.05),
            (0.001, 0.001, 0.0005),
            # Arms of 2° at most; 4π v²/2° is within 1.8°/s², 0.45 of the declination's, from 0.7⁴ on.
            (4.0, 2.0, 2.0 * 0.7**4),
        ],
    )
    def test_across_it_too_it_runs_in_a_spiral(
        self, field_deg: float, spacing_deg: float, speed_deg_s: float
    ) -> None:
        one = self.found(field_deg, 1.0, 80.0 if field_deg > 1.0 else 2.0)
        assert (one.how, one.first, one.second) == (
            "spiral",
            pytest.approx(spacing_deg),
            pytest.approx(speed_deg_s),
        )

    @pytest.mark.parametrize(
        ("field_deg", "along_sigma_s", "cross_sigma_km", "words"),
        [
            (None, 1.0, 1.0, "auto refused: the camera's field is not known; give --fov"),
            (0.2, 0.6, 0.6, "auto refused: the target is within the camera's field by what is known"),
            (0.1, 30.1, 0.1, "sweep refused: reach_s 60.2; give 0.01 to 60"),
        ],
    )
    def test_else_it_says_why_not(
        self, field_deg: float | None, along_sigma_s: float, cross_sigma_km: float, words: str
    ) -> None:
        told = self.found(field_deg, along_sigma_s, cross_sigma_km)
        assert told.startswith(words)

    def test_two_sigmas_either_way_are_held_against_half_a_field(self) -> None:
        for sigma_s, within in ((0.99, True), (1.01, False)):
            assert isinstance(self.found(0.2, sigma_s, 0.0), str) is within
        for sigma_km, within in ((0.86, True), (0.88, False)):
            assert isinstance(self.found(0.2, 0.0, sigma_km), str) is within

    def lost(self, guided: bool = True, wanted: bool = True) -> Steering:
        one = steering(Cameras(field_deg=0.1, search_when_lost=wanted))
        reads(one, along_sigma_s=1.0, cross_sigma_km=2.0)
        one.estimator.last_utc_s, one.guided = NOW, guided
        return one

    def test_a_target_that_was_not_seen_for_three_seconds_is_searched_for_once(self) -> None:
        one = self.lost()
        assert one.watch(NOW + 2.9) is False
        assert one.watch(NOW + 3.1) is True
        assert one.refusal == "the target is lost, and may be out of the field: searching"
        assert one.biases.pattern_at(NOW + 4.0) is not None
        assert one.watch(NOW + 3.2) is False
        one.obey(Search("stop"), NOW + 5.0)
        assert one.watch(NOW + 6.0) is False
        assert one.biases.pattern_at(NOW + 7.0) is None
        # Seen again, and lost again.
        one.estimator.last_utc_s = NOW + 7.0
        assert one.watch(NOW + 11.0) is True

    def test_a_search_goes_on_while_what_was_learnt_drifts_and_ends_with_what_is_seen(self) -> None:
        """And one that the operator has stopped is not begun again because of the drift."""
        one = self.lost()
        one.estimator.filter, one._estimated = Made(), True  # type: ignore[assignment]
        assert one.watch(NOW) is True
        reads(one, along_sigma_s=1.0, cross_sigma_km=2.0, along_s=0.1)
        assert one.watch(NOW + 3.1) is True
        reads(one, along_sigma_s=1.0, cross_sigma_km=2.0, along_s=0.2)
        assert one.watch(NOW + 4.0) is True
        assert one.biases.pattern_at(NOW + 5.0) is not None
        one.obey(Search("stop"), NOW + 5.0)
        for number in range(1, 4):
            reads(one, along_sigma_s=1.0, cross_sigma_km=2.0, along_s=0.2 + 0.1 * number)
            assert one.watch(NOW + 5.0 + number) is True
            assert one.biases.pattern_at(NOW + 6.0 + number) is None
        one.obey(Search("sweep", reach_s=0.5, period_s=20.0), NOW + 10.0)
        assert one.biases.pattern_at(NOW + 11.0) is not None
        reads(one, along_s=0.6)
        one._estimated = True
        assert one.watch(NOW + 12.0) is True
        assert one.biases.pattern_at(NOW + 13.0) is None

    def test_what_is_seen_just_where_it_was_expected_ends_a_search_too(self) -> None:
        one = self.lost()
        one.estimator.filter, one._estimated = Made(), True  # type: ignore[assignment]
        reads(one, along_s=0.1)
        assert one.watch(NOW) is True
        one.obey(Search("sweep", reach_s=0.5, period_s=20.0), NOW + 1.0)
        assert one.watch(NOW + 2.0) is False
        assert one.biases.pattern_at(NOW + 3.0) is not None
        one._estimated = True
        assert one.watch(NOW + 3.0) is True
        assert one.biases.pattern_at(NOW + 4.0) is None

    def test_a_search_that_is_kept_stays_where_it_has_led(self) -> None:
        one = steering()
        one.obey(Search("sweep", reach_s=0.5, period_s=20.0), NOW)
        one.keep_search(NOW + 6.0)
        along, _ = one.biases.applied(NOW + 60.0)
        # A quarter of a turn after half the time to come up to its speed it is as far ahead as it goes.
        assert along.value == pytest.approx(0.5, abs=0.05)
        assert (along.rate, along.acceleration) == (0.0, 0.0)
        one.keep_search(NOW + 60.0)
        assert one.biases.applied(NOW + 120.0)[0] == along

    def test_degrees_along_the_track_are_those_of_where_the_satellite_is_by_then(self) -> None:
        one = steering(Cameras(field_deg=0.1))
        reads(one, along_s=20.0, along_sigma_s=1.0, cross_sigma_km=0.2)
        one.obey(Search("auto"), NOW)
        assert one.refusal is None
        assert one.biases.going_at[0] == pytest.approx(REACTS_S + 20.0)  # type: ignore[attr-defined]

    @pytest.mark.parametrize("why_not", [{"guided": False}, {"wanted": False}])
    def test_unless_the_operator_guides_or_does_not_want_it(self, why_not: dict[str, bool]) -> None:
        one = self.lost(**why_not)
        assert one.watch(NOW + 3.1) is False
        assert one.biases.patterns == []


def in_pixels(dx_px: float, dy_px: float) -> SeenOffset:
    return SeenOffset(Utc(NOW).isoformat("microseconds"), dx_px=dx_px, dy_px=dy_px, sigma_px=1.0)


def middle(*_: object) -> Any:
    """Return an image whose middle is where right ascension and declination begin."""
    return Made(fed=np.array([1.0, 0.0, 0.0]), right=np.array([0.0, 1.0, 0.0]), up=np.array([0.0, 0.0, 1.0]))


def in_the_middle(one: Steering) -> None:
    """Have the elements predict the satellite in the middle of each image, which lies there."""
    one.biases.image_at = middle  # type: ignore[method-assign, assignment]
    one.biases.predicted_at = lambda *_: 0j  # type: ignore[method-assign]
    one.biases.motion_at = lambda *_: 0j  # type: ignore[method-assign]


class TestMessages:
    def test_a_change_begins_when_a_command_that_knows_of_it_can_act(self) -> None:
        """Three periods and the command's delay after it was asked for, and never before an earlier one."""
        one = steering()
        one.obey(Nudge(0.5, 0.0), NOW)
        along = one.biases.offsets["along_s"]
        assert along.state(NOW + REACTS_S - 1e-3).value == 0.0
        assert along.state(NOW + REACTS_S + 1e-2).value > 0.0
        one.obey(Nudge(0.5, 0.0), NOW - 1.0)
        assert [change.begins_utc_s for change in along._changes] == [NOW + REACTS_S] * 2

    def test_a_refusal_is_shown_for_five_seconds_or_until_the_next(self) -> None:
        one = steering()
        one.obey(Search("stop"), NOW)
        assert one.refusal == "no search is running"
        for after_s, words in ((4.9, "no search is running"), (5.1, None)):
            one.obey(OffsetBy("along_s", "add", 0.01), NOW + after_s)
            assert one.refusal == words

    def test_what_cannot_be_accepted_says_why(self) -> None:
        one = steering()
        one.obey(Guide("accept"), NOW)
        assert one.refusal == "nothing to accept: the last observation was taken"
        one.obey(Guide("off"), NOW)
        one.obey(in_pixels(30.0, 40.0), NOW)
        assert one.last_seen == "held"
        one.obey(Guide("accept"), NOW)
        assert (one.refusal or "").startswith("not accepted: it is in pixels, and their size is not known")

    @pytest.mark.parametrize(
        ("dx_px", "dy_px", "taken"), [(1801.0, 0.0, False), (0.0, -1801.0, False), (1799.0, -1799.0, True)]
    )
    def test_offsets_are_refused_that_no_camera_has(self, dx_px: float, dy_px: float, taken: bool) -> None:
        one = steering(Cameras(Camera(scale_arcsec_px=10.0)))
        in_the_middle(one)
        one._observe = lambda *_, **__: None  # type: ignore[method-assign]
        one.obey(in_pixels(dx_px, dy_px), NOW)
        assert one.estimator.words == (None if taken else "offsets go to 18000 arcseconds either way")
        assert (one.last_offset is not None) is taken

    def test_what_was_held_is_not_accepted_once_it_is_guided_again(self) -> None:
        one = steering()
        one.obey(Guide("off"), NOW)
        one.obey(in_pixels(30.0, 40.0), NOW)
        one.obey(Guide("on"), NOW)
        one.obey(Guide("accept"), NOW)
        assert one.refusal == "nothing to accept: the last observation was taken"

    def observed(self, one: Steering, words: str | None = None) -> list[ObservationMessage]:
        """Return what will be held against the estimate; each is answered with such words."""
        seen: list[ObservationMessage] = []

        def observe(message: ObservationMessage, *_: object, **__: object) -> None:
            seen.append(message)
            one.estimator.words = words

        in_the_middle(one)
        one._observe = observe  # type: ignore[method-assign, assignment]
        return seen

    def test_a_date_is_mended_once_however_often_a_message_is_offered(self) -> None:
        """The camera's clock is 0.25 s ahead; what was rejected is accepted by hand, twice."""
        one = steering()
        seen = self.observed(one, "it contradicts the estimate")
        one.clocks = Made(correction_s=lambda camera: 0.25 if camera == "guide" else 0.0)  # type: ignore[assignment]
        utc = Utc(NOW).isoformat("microseconds")
        one.obey(SeenOffset(utc, 3.0, 4.0, 1.0, "guide"), NOW)
        for _ in range(2):
            one.obey(Guide("accept"), NOW)
        assert [float(Utc.parse(message.utc).unix_s) for message in seen] == [NOW - 0.25] * 3

    @pytest.mark.parametrize(
        ("sigma_px", "scale_arcsec_px", "sigma_arcsec"),
        [(1e5, 10.0, 3600.0), (2.0, 1.5, 3.0), (0.02, 0.1, 0.01)],
    )
    def test_a_blurred_or_a_sharp_image_is_as_good_as_any_observation_may_be(
        self, sigma_px: float, scale_arcsec_px: float, sigma_arcsec: float
    ) -> None:
        """Pixels times their size may be beyond what a sigma goes to: the offset is used all the same."""
        one = steering(Cameras(Camera(scale_arcsec_px=scale_arcsec_px)))
        seen = self.observed(one)
        one.obey(SeenOffset(Utc(NOW).isoformat("microseconds"), dx_px=1.0, dy_px=1.0, sigma_px=sigma_px), NOW)
        assert [message.sigma_arcsec for message in seen] == [sigma_arcsec]

    def test_a_message_says_how_its_camera_lies_and_the_settings_where_it_does_not(self) -> None:
        one = steering(Cameras(Camera(180.0), {"guide": Camera(90.0, True, 1.5, "coarse")}))
        utc = Utc(NOW).isoformat("microseconds")
        for said, lies in (
            ({}, Camera(180.0)),
            ({"camera": "other"}, Camera(180.0)),
            ({"camera": "guide"}, Camera(90.0, True, 1.5, "coarse")),
            # A rotation of nothing and an image that is not mirrored are said, too.
            ({"camera": "guide", "rotation_deg": 0.0}, Camera(0.0, True, 1.5, "coarse")),
            ({"camera": "guide", "flipped": False}, Camera(90.0, False, 1.5, "coarse")),
            ({"camera": "guide", "scale_arcsec_px": 2.5}, Camera(90.0, True, 2.5, "coarse")),
            ({"rotation_deg": 45.0, "flipped": True, "scale_arcsec_px": 2.5}, Camera(45.0, True, 2.5)),
        ):
            assert one.camera_of(SeenOffset(utc, 3.0, 4.0, 1.0, **said)) == lies

    @pytest.mark.parametrize(
        ("said", "words"),
        [
            (({"scale_arcsec_px": 1.1}, {"scale_arcsec_px": 1.43}), "1.43″ a pixel, not 1.1″"),
            (({"rotation_deg": -5.0}, {"rotation_deg": 12.0}), "up at 12°, not 355°"),
            (({"flipped": True}, {"flipped": False}), "an image that is not mirrored"),
            (
                ({"flipped": False, "rotation_deg": 0.0}, {"flipped": True, "rotation_deg": 90.0}),
                "a mirrored image, up at 90°, not 0°",
            ),
            # What a solution leaves open, and a field that turns slowly.
            ([{"scale_arcsec_px": 1.0 + 0.02 * i, "rotation_deg": 340.0 + 4.0 * i} for i in range(6)], None),
            (({}, {"scale_arcsec_px": 1.1}), None),
            (({"rotation_deg": 20.0},), None),
        ],
    )
    def test_a_camera_that_contradicts_what_it_said_of_its_image_begins_the_estimate_anew(
        self, said: Sequence[dict[str, Any]], words: str | None
    ) -> None:
        one = steering()
        self.observed(one)
        told = self.begun_anew(one, said)
        shows = f"camera guide: its field shows {words}: the estimate begins anew; correct its settings"
        assert told == ([] if words is None else [shows])

    def begun_anew(self, one: Steering, said: Sequence[dict[str, Any]]) -> list[str | None]:
        """Return what was told as often as the estimate was forgotten, of offsets that say so much."""
        forgotten: list[None] = []
        told: list[str | None] = []
        one.estimator.forget = lambda: forgotten.append(None)  # type: ignore[method-assign]
        for i, each in enumerate(said):
            now = NOW + 0.5 * i
            one.obey(SeenOffset(Utc(now).isoformat("microseconds"), 3.0, 4.0, 1.0, "guide", **each), now)
            told += [one.refusal] * (len(forgotten) - len(told))
        return told

    def test_two_cameras_of_one_name_take_turns_and_the_estimate_goes_on(self) -> None:
        one = steering()
        self.observed(one)
        assert len(self.begun_anew(one, [{"scale_arcsec_px": 1.0 + i % 2} for i in range(10)])) == 1

    def test_each_camera_that_was_used_is_told_with_what_was_found_of_it(self) -> None:
        one = steering(Cameras(named={"guide": Camera(12.0, True, 1.5, "coarse")}))
        self.observed(one)
        assert one.camera_views() == ()
        one.obey(SeenOffset(Utc(NOW).isoformat("microseconds"), 3.0, 4.0, 1.0, "guide"), NOW)
        found = np.array([2.0, 0.03, 0.04, 0.5, 0.6]), np.array([0.2, 0.003, 0.004, 0.05, 0.06])
        one.estimator.filter = Made(cameras=("guide",), terms=lambda _: found)  # type: ignore[assignment]
        (view,) = one.camera_views()
        assert view == CameraView(
            "guide", "coarse", 12.0, True, 1.5, 2.0, 0.2, pytest.approx(0.03), 0.003, 0.04, 0.004
        )

    def test_where_it_was_seen_on_the_axes(self) -> None:
        """In an image turned by 90°, up is towards smaller hour angles; mirrored, right is left."""
        for camera, first, second in (
            (Camera(), 3.0, 4.0), (Camera(90.0), -4.0, 3.0), (Camera(0.0, True), -3.0, 4.0)
        ):  # fmt: skip
            one = steering(Cameras(camera))
            in_the_middle(one)
            one._observe = lambda *_, **__: None  # type: ignore[method-assign]
            one.obey(SeenOffset(Utc(NOW).isoformat("microseconds"), 3.0, 4.0, 1.0), NOW)
            assert one.last_offset == pytest.approx((NOW, first, second))
            one.obey(OffsetBy("along_s", "add", 0.01), NOW)
            assert one.last_offset is None

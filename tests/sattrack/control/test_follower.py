"""What follows a target, by hand: samples believed, places, sending, and what is learnt."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace as Made
from typing import Any

import pytest
from msgspec.structs import replace

from sattrack.control.following import FeederLaw, Follower, Learning
from sattrack.control.target import TargetSpan
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    Hold,
    MountProfile,
    MoveAxes,
    StatusSample,
    mean_sidereal_deg,
)

NOW, LONGITUDE, PERIOD_S = 1_790_000_000.0, 11.0, 0.05


def sample(turn: int, ra_deg: float = 100.0, dec_deg: float = 20.0, late_s: float = 0.0) -> StatusSample:
    utc_s = NOW + PERIOD_S * turn
    sidereal_h = mean_sidereal_deg(utc_s, LONGITUDE) % 360.0 / 15.0
    return StatusSample(turn, utc_s + late_s, sidereal_h, ra_deg, dec_deg, False, False, 0.0, 0.0)


def follower(**profile: Any) -> Follower:
    return Follower(MountProfile(**profile), LONGITUDE)


def seen(one: Follower, *samples: StatusSample, following: bool = True) -> list[bool]:
    return [one.take(each, one.date(each), following) for each in samples]


class TestSamples:
    def test_a_known_clock_dates_the_first_sample_however_late_it_comes(self) -> None:
        """The clock is 2 s ahead of UTC, so what it shows is of 2 s before."""
        one = follower(clock_offset_s=2.0)
        ahead_h = (mean_sidereal_deg(NOW, LONGITUDE) + 2.0 * SIDEREAL_RATE_DEG_S) % 360.0 / 15.0
        late = StatusSample(0, NOW + 0.01, ahead_h, 0.0, 0.0, False, False, 0.0, 0.0)
        assert one.date(late) == pytest.approx(NOW, abs=1e-4)
        # Without it a status is as late as the profile says.
        assert follower(status_delay_s=0.01).date(late) == pytest.approx(NOW, abs=1e-4)

    def test_samples_of_one_instant_are_left_out_until_there_are_too_many(self) -> None:
        one = follower()
        assert one.take(sample(0), NOW, True) is True
        for _ in range(15):
            assert one.take(sample(1), NOW + 0.5e-3, True) is False
        first = one.axes
        # The clock is learnt anew meanwhile: it begins with what comes then.
        assert one.take(sample(1), NOW + 0.5e-3, True) is True
        assert one.axes is not first
        assert one.take(sample(2), NOW + 0.05, True) is True
        assert one.take(sample(2), NOW + 0.05, True) is False

    def test_acknowledgements_tell_how_long_a_command_takes_while_rates_are_followed(self) -> None:
        """Each comes 81 ms after its datagram was sent, and not yet 31 ms after."""
        for following in (True, False):
            one = follower(move_axis="edge", command_delay_s=0.0)
            before_s = one.command_delay_sigma_s
            for cycle in range(12):
                sent_s = NOW + 0.15 * cycle + 0.019
                seen(one, sample(3 * cycle), following=following)
                one.note_sent(MoveAxes(SIDEREAL_RATE_DEG_S, 0.0), sent_s)
                seen(one, sample(3 * cycle + 1), following=following)
                seen(one, replace(sample(3 * cycle + 2), move_acknowledged=True), following=following)
            assert (one.command_delay_sigma_s < 0.8 * before_s) is following
            assert (0.025 < one.command_delay_s < 0.085) is following

    def test_flags_that_stay_up_are_acknowledged_from_when_they_were_raised(self) -> None:
        """81 ms before; rates that came meanwhile did not raise them."""
        one = follower(move_axis="held", command_delay_s=0.0)
        for cycle in range(12):
            turn, raised_s = 4 * cycle, NOW + 0.2 * cycle + 0.019
            seen(one, sample(turn))
            one.note_sent(MoveAxes(SIDEREAL_RATE_DEG_S, 0.0), raised_s)
            seen(one, sample(turn + 1))
            one.note_sent(MoveAxes(SIDEREAL_RATE_DEG_S, 0.0), raised_s + PERIOD_S)
            seen(one, replace(sample(turn + 2), move_acknowledged=True))
            one.note_sent(Hold(), raised_s + 2.0 * PERIOD_S)
            seen(one, sample(turn + 3))
        assert 0.025 < one.command_delay_s < 0.085

    def test_a_sample_that_is_not_believed_tells_nothing_of_rates(self) -> None:
        one = follower()
        seen(one, *(sample(turn) for turn in range(10)))
        before = one.learning.fits[0].samples
        assert seen(one, sample(10, ra_deg=130.0), sample(11), sample(12)) == [False, True, True]
        # Of the three only the last follows on one that was believed.
        assert one.learning.fits[0].samples == before + 1
        assert one.learning.fits[0].fastest_deg_s < 1.0

    def test_delays_that_a_calibration_found_are_surer(self) -> None:
        """To 3 ms instead of 16, of which 45 are all that is looked for."""
        assert follower(calibration=Made()).command_delay_sigma_s == pytest.approx(0.003, abs=0.0003)
        assert follower().command_delay_sigma_s == pytest.approx(0.016, abs=0.0006)

    def test_a_mount_that_is_elsewhere_is_lost_and_taken_up_there(self) -> None:
        one = follower()
        assert seen(one, *(sample(turn) for turn in range(10))) == [True] * 10
        assert (one.lost_utc_s, one.learning.times_begun_anew) == (None, 0)
        elsewhere = [sample(10 + turn, ra_deg=130.0 + 1e-4 * turn, dec_deg=-5.0) for turn in range(5)]
        assert seen(one, *elsewhere) == [False] * 5
        assert one.lost_utc_s == pytest.approx(NOW + PERIOD_S * (9 + 5), abs=1e-3)
        assert one.axes is not None
        assert one.axes.ra.position_deg == pytest.approx(130.0, abs=1e-3)
        assert one.axes.dec.position_deg == pytest.approx(-5.0, abs=1e-3)
        assert one.learning.times_begun_anew == 1

    @pytest.mark.parametrize("led", [False, True])
    def test_gain_and_rate_are_doubted_at_the_target_and_the_response_where_all_the_way_was_by_rates(
        self, led: bool
    ) -> None:
        one = follower(command_delay_s=0.0)
        one.note_sent(MoveAxes(0.3, -0.2), NOW - 1.0)
        moving = [sample(turn, 100.0 + 0.015 * turn, 20.0 - 0.01 * turn) for turn in range(80)]
        seen(one, *moving)
        axes = one.axes
        assert axes is not None
        assert axes.rates_deg_s == (0.3, -0.2)
        before = [axis._kalman.covariance.copy() for axis in (axes.ra, axes.dec)]
        one.arrive(led)
        for axis, rate_deg_s, known in zip((axes.ra, axes.dec), (0.3, -0.2), before, strict=True):
            now = axis._kalman.covariance
            both = -(0.005**2) * rate_deg_s
            assert now[1, 2:].sum() - known[1, 2:].sum() == pytest.approx(both, rel=0.05)
            wider = now[2:, 2:].sum() / (known[2:, 2:].sum() + 0.005**2)
            assert wider == pytest.approx(16.0 if led else 1.0, rel=0.05)
        assert one.learning.fits[0].samples == 0

    def test_a_place_that_repeats_to_the_last_bit_while_commands_move_the_axis_is_not_believed(self) -> None:
        one = follower(command_delay_s=0.0)
        seen(one, sample(0))
        believed = []
        for turn in range(1, 6):
            one.note_sent(MoveAxes(1.0, 0.0), NOW + PERIOD_S * (turn - 1) - 0.01)
            believed += seen(one, sample(turn))
        assert believed[-1] is False
        still = follower()
        assert seen(still, *(sample(turn) for turn in range(6))) == [True] * 6

    def test_a_mount_with_a_plan_of_its_own_is_where_it_is_seen(self) -> None:
        one = follower()
        samples = [sample(turn, 100.0 + 0.2 * turn, 20.0 - 0.1 * turn) for turn in range(4)]
        assert seen(one, *samples, following=False) == [True] * 4
        known = one.axes_at(NOW + 0.25, following=False)
        assert known is not None
        assert known[0] == pytest.approx((101.0, 19.5), abs=1e-2)
        assert known[1] == pytest.approx((4.0, -2.0), abs=1e-2)

    def test_before_the_first_nothing_is_known(self) -> None:
        one = follower()
        target: Any = None
        assert (one.axes_at(NOW, True), one.follow(NOW, target), one.settling_s) == (None, None, None)
        assert one.learning.learnt() is None
        seen(one, sample(0))
        one.forget_axes()
        assert one.axes_at(NOW, True) is None


class TestCorrections:
    @pytest.mark.parametrize(("share", "most_deg_s"), [((), (2.0, 0.5)), ((0.5,), (1.0, 0.25))])
    def test_one_far_off_is_gone_to_as_fast_as_each_axis_turns_or_at_the_share_of_that(
        self, share: tuple[float], most_deg_s: tuple[float, float]
    ) -> None:
        axes = {"ra": AxisLimits(max_rate_deg_s=2.0), "dec": AxisLimits(max_rate_deg_s=0.5)}
        one, ra_deg, dec_deg = follower(**axes), 100.0, 20.0
        stands: Any = Made(
            span=lambda begin, interval, bound: TargetSpan((160.0, -30.0), (0.0, 0.0), (0.0, 0.0), bound)
        )
        asked = []
        for turn in range(60):
            now = sample(turn, ra_deg, dec_deg)
            seen(one, now)
            rates = one.follow(now.arrival_utc_s, stands, *share)
            assert rates is not None
            one.note_sent(rates, now.arrival_utc_s)
            asked.append((rates.ra_rate_deg_s, -rates.dec_rate_deg_s))
            ra_deg, dec_deg = (
                ra_deg + PERIOD_S * rates.ra_rate_deg_s,
                dec_deg + PERIOD_S * rates.dec_rate_deg_s,
            )
        assert tuple(map(max, zip(*asked, strict=True))) == pytest.approx(most_deg_s, rel=1e-3)

    def test_an_error_is_that_which_is_left_when_all_that_was_commanded_has_come_out(self) -> None:
        """Commands of 1 °/s that are 0.3 s under way: what they will turn is not asked for again."""
        one = follower(command_delay_s=0.3, status_delay_s=0.0)
        bounds: list[float] = []

        def span(begin_utc_s: float, interval_s: float, bound: Any) -> TargetSpan:
            bounds.append(bound[1] - (20.0 + begin_utc_s - NOW))
            return TargetSpan((100.0, 20.0), (0.0, 0.0), (0.0, 0.0), bound)

        target: Any = Made(span=span)
        for turn in range(-8, 60):
            now_s = NOW + PERIOD_S * turn
            if turn >= 0:
                seen(one, sample(turn, dec_deg=20.0 + PERIOD_S * turn))
            one.note_sent(MoveAxes(0.0, 1.0), now_s + 0.01)
        one.follow(NOW + PERIOD_S * 59 + 0.02, target)
        # It has come a mean lag further than where the interval begins, or less.
        assert bounds == [pytest.approx(0.0, abs=0.06)]

    def test_the_rates_of_each_axis_change_by_a_share_of_its_own_acceleration(self) -> None:
        """By half of 8 and of 1 °/s² in 50 ms: 0.2 and 0.025 °/s a period."""
        axes = {"ra": AxisLimits(max_acceleration_deg_s2=8.0), "dec": AxisLimits(max_acceleration_deg_s2=1.0)}
        one, far = follower(**axes), TargetSpan((160.0, 60.0), (0.0, 0.0), (0.0, 0.0), (100.0, 20.0))
        stands: Any = Made(span=lambda begin, interval, bound: far)
        asked = [(0.0, 0.0)]
        for turn in range(6):
            now = sample(turn)
            seen(one, now)
            rates = one.follow(now.arrival_utc_s, stands)
            assert rates is not None
            one.note_sent(rates, now.arrival_utc_s)
            asked.append((rates.ra_rate_deg_s, rates.dec_rate_deg_s))
        for (ra, dec), (ra_next, dec_next) in itertools.pairwise(asked):
            assert ra_next - ra == pytest.approx(0.2, abs=0.005)
            assert dec_next - dec == pytest.approx(0.025, abs=0.005)

    @pytest.mark.parametrize(("lag_s", "turns"), [(0.0, 1), (0.1, 2), (0.12, 2)])
    @pytest.mark.parametrize(("move_axis", "acts_s"), [("held", 0.05), ("edge", 0.1)])
    def test_a_command_is_made_for_the_turns_of_the_mount_from_its_arrival_on_and_for_the_lag_of_its_axes(
        self, move_axis: str, acts_s: float, lag_s: float, turns: int
    ) -> None:
        """Sent 10 ms after a turn it arrives 130 ms after it: the third turn is the first to obey it.

        The axes answer later by whole turns; where no lag is told, 30 ms are expected.
        """
        slow = AxisLimits(lag_s=lag_s)
        one = follower(move_axis=move_axis, command_delay_s=0.12, status_delay_s=0.0, ra=slow, dec=slow)
        seen(one, *(sample(turn) for turn in range(40)))
        asked: list[tuple[float, float]] = []

        def span(begin_utc_s: float, interval_s: float, bound: Any) -> TargetSpan:
            asked.append((begin_utc_s, interval_s))
            return TargetSpan((100.0, 20.0), (0.0, 0.0), (0.0, 0.0), bound)

        target: Any = Made(span=span)
        one.follow(NOW + PERIOD_S * 39 + 0.01, target)
        begins_s = NOW + PERIOD_S * (42 + turns)
        assert asked == [(pytest.approx(begins_s, abs=1e-3), pytest.approx(acts_s, abs=1e-6))]


class TestPlaces:
    def axes(self) -> Any:
        return Made(
            sample_utc_s=NOW,
            rates_deg_s=(0.5, -0.25),
            moved_by=lambda utc_s: (3.0, 4.0),
            ra=Made(position_deg=100.0, disturbance_deg_s=0.1, gain_error=0.2),
            dec=Made(position_deg=20.0, disturbance_deg_s=-0.3, gain_error=-0.4),
        )

    @pytest.mark.parametrize(
        ("later_s", "following", "moved"),
        [(2.0, True, (3.0, 4.0)), (2.0, False, (1.0, -0.5)), (-2.0, True, (-1.0, 0.5))],
    )
    def test_by_the_commands_since_or_at_the_rates_that_were_seen(
        self, later_s: float, following: bool, moved: tuple[float, float]
    ) -> None:
        """Beside them each axis moves by a rate of its own, and more or less than it is commanded."""
        one = follower()
        one.axes = self.axes()
        known = one.axes_at(NOW + later_s, following)
        assert known is not None
        places = 100.0 + moved[0] + 0.1 * later_s, 20.0 + moved[1] - 0.3 * later_s
        assert known == (
            pytest.approx(places),
            pytest.approx((0.5 * 1.2 + 0.1, -0.25 * 0.6 - 0.3)),
        )


class TestSending:
    def turning(self, **profile: Any) -> Follower:
        """A follower that knows the mount's turns, every 50 ms from NOW on."""
        one = follower(**profile)
        for turn in range(40):
            one.date(sample(turn))
        return one

    @pytest.mark.parametrize(
        ("behind_s", "idle_s", "following_s"),
        [(0.0, 0.0, 0.0), (0.005, -0.001, -0.0001), (-0.005, 0.001, 0.0001), (0.02, -0.002, -0.0002)],
    )
    def test_datagrams_fall_into_step_halfway_between_turns(
        self, behind_s: float, idle_s: float, following_s: float
    ) -> None:
        """By a fifth of what they are off, 2 ms a period at most; while following by a fiftieth, 0.2 ms."""
        one = self.turning(command_delay_s=0.012, status_delay_s=0.0)
        now_s = NOW + 2.0 + 0.025 - 0.012 + behind_s
        assert one.send_shift_s(now_s, following=False) == pytest.approx(idle_s, abs=5e-6)
        assert one.send_shift_s(now_s) == pytest.approx(following_s, abs=5e-6)
        assert follower().send_shift_s(now_s) == 0.0

    @pytest.mark.parametrize(
        ("command_delay_s", "status_delay_s", "early_s"),
        [
            # Of the 20 ms to spare, half of what is left of them if the delay is longer by 3 ms.
            (0.010, 0.020, 0.0115),
            # Of 9 ms, 6 for the answer to be there.
            (0.030, 0.011, 0.003),
            # Of 6 ms, too little would be left for the turn to read it: half of them and a turn more.
            (0.030, 0.014, 0.0295),
            # 40 ms to spare after a turn more.
            (0.040, 0.020, 0.0215),
        ],
    )
    def test_those_of_a_handshake_share_what_is_to_spare(
        self, command_delay_s: float, status_delay_s: float, early_s: float
    ) -> None:
        self.falls_into_step(command_delay_s, status_delay_s, early_s, Made())

    def test_those_of_a_handshake_come_sooner_where_the_delay_is_not_known_well(self) -> None:
        """By 15.7 ms: of the 30 to spare, half of what is left for the answer, and the rest for it."""
        self.falls_into_step(0.010, 0.010, 0.02285, None)

    @pytest.mark.parametrize(("scatter_s", "early_s"), [(0.003, 0.004), (0.004, 0.0315)])
    def test_they_come_a_turn_sooner_where_turns_scatter_by_what_is_to_spare(
        self, scatter_s: float, early_s: float
    ) -> None:
        """Of 10 ms to spare, 6 are for the answer: a turn that is 4 ms early would not read the command."""
        one = follower(move_axis="edge", command_delay_s=0.03, status_delay_s=0.01, calibration=Made())
        for turn in range(400):
            one._loop.note(turn, NOW + PERIOD_S * turn + (scatter_s if turn % 2 else -scatter_s))
        now_s = one._loop.first_from(NOW + 21.0) - 0.03 - early_s
        assert one.send_shift_s(now_s, on_target=False) == pytest.approx(0.0, abs=5e-5)
        assert one.send_shift_s(now_s + 0.005, on_target=False) == pytest.approx(-0.001, abs=5e-5)

    def test_they_come_just_with_a_turn_while_acknowledgements_may_tell_the_delay(self) -> None:
        one = self.falls_into_step(0.010, 0.010, 0.02285, None)
        turn_s = one._loop.first_from(NOW + 3.0)

        def just_with_a_turn() -> bool:
            return one.send_shift_s(turn_s - 0.010) == pytest.approx(0.0, abs=2e-5)

        assert just_with_a_turn()
        one._history.acknowledged.noted += 63
        assert just_with_a_turn()
        one._history.acknowledged.noted += 1
        assert not just_with_a_turn()

    def falls_into_step(
        self, command_delay_s: float, status_delay_s: float, early_s: float, calibration: Any
    ) -> Follower:
        """Return a follower that is in step where datagrams arrive so early, on the way to a target."""
        one = self.turning(
            move_axis="edge",
            command_delay_s=command_delay_s,
            status_delay_s=status_delay_s,
            calibration=calibration,
        )
        turn_s = one._loop.first_from(NOW + 3.0)
        now_s = turn_s - command_delay_s - early_s
        for following in (False, True):
            at_s, later_s = (
                one.send_shift_s(now_s + later_s, following, on_target=False) for later_s in (0.0, 0.005)
            )
            assert at_s == pytest.approx(0.0, abs=2e-5)
            assert later_s == pytest.approx(-0.001, abs=2e-5)
        return one

    def test_a_command_acts_for_a_turn_or_for_as_long_as_a_handshake_takes(self) -> None:
        assert follower(move_axis="held").acting_s == PERIOD_S
        one = follower(move_axis="edge")
        assert one.acting_s == 2.0 * PERIOD_S
        sent_s = NOW
        for gap_s, acts_s in ((0.0, 0.1), (0.05, 0.1), (0.2, 0.2), (0.6, 0.6), (9.0, 0.6), (0.15, 0.15)):
            sent_s += gap_s
            one.note_sent(MoveAxes(0.1, 0.2), sent_s)
            assert one.acting_s == pytest.approx(acts_s)
            seen(one, replace(sample(round((sent_s - NOW) / PERIOD_S)), move_acknowledged=True))

    def test_a_command_that_is_not_acknowledged_acts_for_longer(self) -> None:
        one = follower(move_axis="edge")
        for sent_s, acts_s in ((0.0, 0.1), (1.6, 1.6), (3.3, 1.7), (12.0, 2.0), (13.6, 1.6)):
            one.note_sent(MoveAxes(0.1, 0.2), NOW + sent_s)
            assert one.acting_s == pytest.approx(acts_s)
            seen(one, sample(round(sent_s / PERIOD_S)))

    def test_what_is_no_rate_ends_all_that_acts(self) -> None:
        one = follower(command_delay_s=0.02)
        one.note_sent(MoveAxes(0.1, 0.2), NOW)
        assert one._history.acting(NOW + 0.021).dec_rate_deg_s == 0.2
        one.note_sent(Hold(), NOW + 0.05)
        assert one._history.acting(NOW + 0.1).dec_rate_deg_s == 0.0
        assert one.command_delay_s == 0.02


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"settling_s": 0.0}, "settling_s is 0; it must be above 0"),
        ({"settling_s": math.inf}, "settling_s is inf"),
        ({"braking_share": 0.0}, "braking_share is 0; it must be above 0, and 1 at most"),
        ({"braking_share": 1.1}, "braking_share is 1.1"),
        ({"tracking_share": 0.0}, "tracking_share is 0; it must be above 0, and 1 at most"),
        ({"tracking_share": 1.1}, "tracking_share is 1.1"),
    ],
)
def test_a_law_that_no_loop_can_be_run_with_is_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FeederLaw(**changes)
    assert FeederLaw(braking_share=1.0, tracking_share=1.0).settling_s == 0.1


class TestLearning:
    def axes(self, turned_over_s: float = PERIOD_S) -> Any:
        def axis(gain_error: float, mean_s: float, begun_anew: int) -> Any:
            lag = Made(mean_s=mean_s)
            return Made(gain_error=gain_error, lag=lag, lag_sigma_s=0.01, begun_anew=begun_anew)

        ra, dec = axis(0.25, 0.02, 1), axis(-0.5, 0.4, 2)
        return Made(
            ra=ra,
            dec=dec,
            predicted_deg=(0.05, -0.02),
            turned_over_s=turned_over_s,
            rates_deg_s=(1.0, -0.4),
        )

    def test_rates_are_those_between_samples_next_to_one_another(self) -> None:
        """Commanded: what was predicted less what the gain makes of it. Seen: over the pole of 360°, too."""
        known = Learning()
        known.take(self.axes(), sample(0, 359.98, 20.0), NOW)
        assert known.fits[0].samples == 0
        known.take(self.axes(), sample(1, 0.02, 19.97), NOW + PERIOD_S)
        assert [fit.samples for fit in known.fits] == [1, 1]
        asked = [fit.fastest_asked_deg_s for fit in known.fits]
        assert asked == pytest.approx([0.05 / 1.25 / PERIOD_S, 0.02 / 0.5 / PERIOD_S])
        assert [fit.fastest_deg_s for fit in known.fits] == pytest.approx([0.04 / PERIOD_S, 0.03 / PERIOD_S])

    @pytest.mark.parametrize("moves", [0, 1])
    def test_when_an_axis_answers_is_seen_in_each_alone(self, moves: int) -> None:
        known, late_s = Learning(), 0.5

        def rate_deg_s(utc_s: float) -> float:
            return math.sin(2.0 * utc_s) + 0.3 * math.sin(5.0 * utc_s)

        places = [50.0, 20.0]
        for count in range(200):
            utc_s = count * PERIOD_S
            commanded = [0.0, 0.0]
            commanded[moves] = rate_deg_s(utc_s)
            places[moves] += rate_deg_s(utc_s - late_s) * PERIOD_S
            axes = self.axes()
            axes.rates_deg_s = tuple(commanded)
            known.take(axes, sample(count, *places), NOW + utc_s)
        assert known.timing.later_s(0.0) == pytest.approx(late_s, abs=0.02)

    def test_others_tell_nothing_of_a_rate(self) -> None:
        known = Learning()
        known.take(self.axes(), sample(0), NOW)
        known.pause()
        known.take(self.axes(), sample(1), NOW + PERIOD_S)
        known.take(self.axes(0.0), sample(2), NOW + 2.0 * PERIOD_S)
        known.take(self.axes(), sample(4), NOW + 4.0 * PERIOD_S)
        assert known.fits[0].samples == 0
        known.take(self.axes(), sample(5), NOW + 5.0 * PERIOD_S)
        assert known.fits[0].samples == 1
        known.forget_rates()
        known.take(self.axes(), sample(6), NOW + 6.0 * PERIOD_S)
        assert known.fits[0].samples == 0

    def test_the_slower_axis_is_the_loops(self) -> None:
        known, law = Learning(), FeederLaw()
        assert known.times_begun_anew == 0
        known.take(self.axes(), sample(0), NOW)
        known.anew()
        assert known.times_begun_anew == 1 + 1 + 2
        # Half of 0.4 s; else 1.25 intervals and four sigmas.
        assert known.settling_s(PERIOD_S, law) == pytest.approx(0.2)
        assert known.settling_s(0.2, law) == pytest.approx(0.25 + 0.04)
        learnt = known.learnt()
        assert learnt is not None
        assert [(one.lag_s, one.lag_sigma_s, one.line) for one in learnt] == [
            (0.02, 0.01, None),
            (0.4, 0.01, None),
        ]

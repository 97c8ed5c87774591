"""Both axes through lost and late commands, and rates that nobody asked for; the mount is made here."""

from __future__ import annotations

import copy
import functools
import math
import random
from types import SimpleNamespace as Made
from typing import Any

import msgspec
import numpy as np
import pytest

from sattrack.control.axes import (
    AT_REST,
    TRIED_S,
    Axes,
    CommandHistory,
    DelayTrials,
    Drive,
    MountLoop,
    SentRates,
)
from sattrack.control.axis_filter import SHARES, Step
from sattrack.mount.model import AxisLimits, MountProfile, StatusSample

PERIOD_S = 0.05
ARCSEC = 1.0 / 3600.0
ACCELERATION_DEG_S2 = 0.02


class Mount:
    """Moves at the rates of the command that it has read, each turn, exactly; noise as of half a tic."""

    def __init__(self, seed: int, shares: tuple[float, float] = (-1.0, 0.5)) -> None:
        self.rng, self.shares = random.Random(seed), shares
        self.ra_deg, self.dec_deg, self.turn = 100.0, 20.0, 0
        self.loop = MountLoop(PERIOD_S)
        self.history = CommandHistory(0.0, self.loop)
        self.axes: Axes | None = None
        self.commands: list[SentRates] = []
        self.changed_deg_s = 0.0

    def sample(self) -> StatusSample:
        ra, dec = (x + self.rng.gauss(0.0, 0.01 * ARCSEC) for x in (self.ra_deg, self.dec_deg))
        utc_s = self.turn * PERIOD_S
        return StatusSample(self.turn, utc_s, 0.0, ra % 360.0, dec, True, False, 0.0, 0.0)

    def step(self, *, acts: int = -1, extra_deg_s: float = 0.0, change_deg_s: float = 0.0) -> None:
        """One turn: a command is sent, the one at index `acts` is read, a status comes at the turn's end."""
        utc_s = self.turn * PERIOD_S
        self.changed_deg_s += change_deg_s
        rate = 0.3 + ACCELERATION_DEG_S2 * utc_s + self.changed_deg_s
        self.commands.append(SentRates(utc_s, self.shares[0] * rate, self.shares[1] * rate))
        self.history.add(self.commands[-1])
        read = self.commands[acts]
        self.ra_deg += (read.ra_rate_deg_s + extra_deg_s) * PERIOD_S
        self.dec_deg += read.dec_rate_deg_s * PERIOD_S
        self.turn += 1
        sample = self.sample()
        now_s = self.turn * PERIOD_S
        self.loop.note(self.turn, now_s)
        if self.axes is None:
            self.axes = Axes.begin(MountProfile(), self.history, sample, now_s)
        else:
            self.axes.take(sample, now_s, commanded=True)

    @property
    def off_arcsec(self) -> float:
        assert self.axes is not None
        return (self.axes.ra.position_deg - self.ra_deg) / ARCSEC


def settled(shares: tuple[float, float] = (-1.0, 0.5)) -> Mount:
    """Return a mount whose rate has changed at times, so that its response is known."""
    return copy.deepcopy(made_to_settle(shares))


@functools.cache
def made_to_settle(shares: tuple[float, float]) -> Mount:
    mount = Mount(1, shares)
    for turn in range(200):
        mount.step(change_deg_s={20: 0.1, 60: -0.1}.get(turn, 0.0))
    return mount


@pytest.mark.parametrize(
    ("acts", "shares"),
    [(-2, (-1.0, 0.5)), (-3, (-1.0, 0.5)), (-2, (1.0, 0.0)), (-2, (0.0, -1.0))],
)
def test_a_lost_or_a_late_command_is_told_from_the_movement(acts: int, shares: tuple[float, float]) -> None:
    """Also where one axis alone turns."""
    mount = settled(shares=shares)
    assert mount.axes is not None
    before = mount.axes.misread
    mount.step(change_deg_s=0.02)
    mount.step(change_deg_s=0.02, acts=acts)
    assert mount.axes.misread == before + 1
    mount.step()
    assert mount.axes.misread == before + 1
    # 0.02 deg/s is 72″/s: taken for a disturbance, it would show.
    assert abs(mount.axes.ra.disturbance_deg_s) < 0.3 * ARCSEC
    assert abs(mount.off_arcsec) < 0.05


def test_what_commands_will_have_moved_is_each_axis_rate_over_the_time() -> None:
    mount = settled()
    assert mount.axes is not None
    rate = mount.commands[-1].ra_rate_deg_s
    ra_deg, dec_deg = mount.axes.moved_by(mount.axes.sample_utc_s + 2.0 * PERIOD_S)
    # The last sample was at the end of the newest command's turn.
    assert ra_deg == pytest.approx(2.0 * PERIOD_S * rate, rel=0.01)
    assert dec_deg == pytest.approx(-0.5 * ra_deg, rel=0.01)


@pytest.mark.parametrize(
    ("changes_deg_s", "shaken"),
    [
        ({0: 0.056}, False),
        ({0: 0.104}, True),
        # While the first is being answered, and when it has mostly been.
        ({0: 0.047, 1: 0.047}, True),
        ({0: 0.047, 4: 0.047}, False),
    ],
)
def test_only_a_large_change_of_rate_shakes_an_axis_and_for_a_while(
    changes_deg_s: dict[int, float], shaken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By 0.08 °/s in all, for 6 s. Right ascension takes the whole of it, declination half."""
    mount, seen = settled(), []
    assert mount.axes is not None
    advance = mount.axes.ra.advance

    def watched(*given: Any) -> None:
        seen.append(given[-1])
        advance(*given)

    monkeypatch.setattr(mount.axes.ra, "advance", watched)
    for turn in range(145):
        mount.step(change_deg_s=changes_deg_s.get(turn, 0.0))
    assert any(seen) is shaken
    assert seen[119] is shaken
    assert seen[-1] is False


def test_an_axis_whose_rate_never_changed_by_much_was_never_shaken(monkeypatch: pytest.MonkeyPatch) -> None:
    mount = Mount(1)
    mount.step()
    assert mount.axes is not None
    seen: list[bool] = []
    for axis in (mount.axes.ra, mount.axes.dec):

        def watched(*given: Any, advance: Any = axis.advance) -> None:
            seen.append(given[-1])
            advance(*given)

        monkeypatch.setattr(axis, "advance", watched)
    for _ in range(20):
        mount.step()
    assert seen == [False] * 40


def test_of_a_mount_that_was_seen_once_no_motion_is_known() -> None:
    axes = Axes.begin(MountProfile(), CommandHistory(0.0, MountLoop(PERIOD_S)), Mount(1).sample(), 3.0)
    assert axes.sample_utc_s == 3.0
    assert (axes.rates_deg_s, axes.predicted_deg, axes.turned_over_s) == ((0.0, 0.0), (0.0, 0.0), 0.0)
    assert (axes.lost, axes.strained, axes.misread) == (False, False, 0)


def test_a_mount_that_moves_by_a_plan_of_its_own_is_where_it_is_seen_and_as_fast() -> None:
    """By no commands: of how they move it such a motion tells nothing, and those before it are over."""
    mount = settled()
    axes = mount.axes
    assert axes is not None
    assert axes.turned_over_s == pytest.approx(PERIOD_S)
    mount.step(change_deg_s=1.0)
    assert axes.strained is True
    gain, utc_s = axes.ra.gain_error, axes.sample_utc_s + 0.2
    ra_deg, dec_deg = axes.ra.position_deg, axes.dec.position_deg
    moved = StatusSample(0, utc_s, 0.0, (ra_deg - 0.4) % 360.0, dec_deg + 0.1, True, False, 0.0, 0.0)
    assert axes.take(moved, utc_s, commanded=False) is True
    assert axes.rates_deg_s == pytest.approx((-2.0, 0.5))
    assert (axes.ra.position_deg, axes.dec.position_deg) == pytest.approx((ra_deg - 0.4, dec_deg + 0.1))
    assert (axes.sample_utc_s, axes.turned_over_s, axes.outliers) == (utc_s, 0.0, 0)
    assert (axes.strained, axes.ra.gain_error) == (False, gain)
    # Of how fast its drives change their rates neither.
    assert [drive._place_deg for drive in axes.drives] == [None, None]


class Steady:
    """Both axes at rates that were commanded long ago, and seen without any noise; commands take no time."""

    def __init__(self, ra_deg_s: float, dec_deg_s: float, profile: MountProfile | None = None) -> None:
        self.rates, self.profile = (ra_deg_s, dec_deg_s), profile or MountProfile()
        loop = MountLoop(PERIOD_S)
        self.history = CommandHistory(0.0, loop)
        self.history.add(SentRates(-1.0, *self.rates))
        loop.note(0, 0.0)
        self.axes = Axes.begin(self.profile, self.history, self.sample(0.0), 0.0)
        for turn in range(1, 40):
            loop.note(turn, turn * PERIOD_S)
            assert self.axes.take(self.sample(turn * PERIOD_S), turn * PERIOD_S, commanded=True) is True

    def sample(self, utc_s: float) -> StatusSample:
        ra, dec = 100.0 + self.rates[0] * utc_s, self.rates[1] * utc_s
        return StatusSample(0, utc_s, 0.0, ra % 360.0, dec, True, False, 0.0, 0.0)

    def stands(self) -> bool:
        """Have the last place reported once more; tell whether it was believed."""
        utc_s = self.axes.sample_utc_s
        return self.axes.take(self.sample(utc_s), utc_s + PERIOD_S, commanded=True)


@pytest.mark.parametrize("turns", [0, 1])
def test_how_well_an_axis_is_dated_matters_by_its_own_rate(turns: int) -> None:
    """30 µs of 20°/s are 2.2″, beside which nothing else counts."""
    axes = Steady(*((20.0, 0.0) if turns == 0 else (0.0, 20.0))).axes
    sigmas = [axis.innovation_sigma_deg / ARCSEC for axis in (axes.ra, axes.dec)]
    assert sigmas[turns] > 5.0 * sigmas[1 - turns]


@pytest.mark.parametrize("turns", [0, 1])
@pytest.mark.parametrize(
    ("rate_deg_s", "encoder_tics", "believed"),
    [(1.9 / 180.0, 2**26, True), (2.1 / 180.0, 2**26, False), (0.3, 2**16, True), (-0.4, 2**16, False)],
)
def test_a_place_that_stays_to_the_last_bit_is_no_reading_of_an_axis_that_was_commanded(
    turns: int, rate_deg_s: float, encoder_tics: int, believed: bool
) -> None:
    """To move by more than 2″ a turn of 0.05 s, and than three tics: 59″ of a coarse encoder."""
    rates = (rate_deg_s, 0.0) if turns == 0 else (0.0, rate_deg_s)
    steady = Steady(*rates, MountProfile(encoder_tics=encoder_tics))
    place = (steady.axes.ra, steady.axes.dec)[turns].position_deg
    assert steady.stands() is believed
    # What is not believed is where the commands have moved it to meanwhile; that is no outlier.
    if not believed:
        moved = (steady.axes.ra, steady.axes.dec)[turns].position_deg - place
        assert moved == pytest.approx(rate_deg_s * PERIOD_S, rel=1e-3)
    assert steady.axes.outliers == 0
    assert Steady(0.0, 0.0).stands() is True


@pytest.mark.parametrize(
    ("rates", "told", "lags_s"),
    [
        ((0.4, -0.2), {"ra": AxisLimits(lag_s=0.1)}, (0.1, 0.03)),
        ((-0.1, 0.3), {"dec": AxisLimits(lag_s=0.15)}, (0.03, 0.15)),
    ],
)
def test_axes_are_bound_for_where_they_would_come_to_rest(
    rates: tuple[float, float], told: dict[str, AxisLimits], lags_s: tuple[float, float]
) -> None:
    """What is commanded from now on they do in full, and what was before they still do for their lag.

    A rate that nobody asked for goes on until that is over. A profile that tells no lag means 30 ms.
    """
    steady = Steady(*rates, msgspec.structs.replace(MountProfile(), **told))
    axes, now_s = steady.axes, steady.axes.sample_utc_s
    assert (axes.ra.lag.mean_s, axes.dec.lag.mean_s) == pytest.approx(lags_s, abs=0.005)
    extra = 0.01, -0.02
    for axis, extra_deg_s in zip((axes.ra, axes.dec), extra, strict=True):
        axis.change(np.array([0.0, extra_deg_s, *np.zeros(SHARES)]))
    until_s = 2.0 * PERIOD_S
    for new in (rates, (1.0, 0.7)):
        steady.history.add(SentRates(now_s - 1e-6, *new))
        # This one acts later.
        steady.history.add(SentRates(now_s + until_s - 1e-6, 5.0, 5.0))
        places, last = axes.bound_for(now_s + until_s)
        steady.history.clear()
        assert last == new
        for axis, place, before, after, disturbance in zip(
            (axes.ra, axes.dec), places, rates, new, extra, strict=True
        ):
            lag_s = axis.lag.mean_s
            rest = axis.position_deg + after * until_s + before * lag_s + disturbance * (until_s + lag_s)
            assert place == pytest.approx(rest, abs=1e-5)


def test_after_a_plan_of_its_own_a_mount_answers_no_commands_of_before() -> None:
    steady = Steady(0.4, -0.2, MountProfile(ra=AxisLimits(lag_s=0.1), dec=AxisLimits(lag_s=0.1)))
    utc_s = steady.axes.sample_utc_s + PERIOD_S
    steady.history.clear()
    # The servos' lag: without that plan they would move on.
    assert steady.axes.moved_by(utc_s) == pytest.approx((0.0157, -0.0079), abs=0.002)
    steady.axes.take(steady.sample(utc_s), utc_s, commanded=False)
    assert steady.axes.moved_by(utc_s + PERIOD_S) == (0.0, 0.0)


def test_a_mount_that_is_taken_up_again_is_somewhere_else_and_as_it_was_known() -> None:
    steady = Steady(0.4, -0.2)
    steady.axes.drives[1].acceleration_deg_s2 = 3.0
    steady.axes.ra.change(np.array([0.0, 0.0, 0.01, *np.zeros(SHARES - 1)]))
    for _ in range(100):
        steady.axes.ra.advance(PERIOD_S, 0.0, np.zeros(SHARES))
        steady.axes.ra.measure(steady.axes.ra.position_deg, 0.0)
    there = StatusSample(0, 60.0, 0.0, 250.0, -10.0, True, False, 0.0, 0.0)
    again = Axes.begin(steady.profile, steady.history, there, 60.0, former=steady.axes)
    assert (again.ra.position_deg, again.dec.position_deg) == (250.0, -10.0)
    assert [drive.acceleration_deg_s2 for drive in again.drives] == [10.0, 3.0]
    assert again.ra.gain_error == pytest.approx(0.01, abs=1e-6)


@pytest.mark.parametrize(
    ("later_s", "follows"), [(-0.05, False), (0.0009, False), (0.0011, True), (4.99, True), (5.01, False)]
)
def test_a_sample_is_joined_to_those_of_the_last_five_seconds_but_not_to_one_of_its_own_turn(
    later_s: float, follows: bool
) -> None:
    axes = Steady(0.4, -0.2).axes
    assert axes.follows(axes.sample_utc_s + later_s) is follows


def test_a_delay_that_acknowledgements_tell_is_used_once_it_is_another_one() -> None:
    """Flags were not there 10 ms after they were raised, and others were after 20 ms: it is between."""
    axes = Steady(0.4, -0.2).axes
    now_s, unlearnt = axes.sample_utc_s, DelayTrials().evidence
    axes.trials.evidence[:] = -1.0
    axes.acknowledge(now_s - 0.01, now_s + PERIOD_S)
    # What motion has said of other delays was against the one that was in use.
    assert (axes.trials.evidence == unlearnt).all()
    for _ in range(5):
        axes.acknowledge(now_s - 0.01, now_s + PERIOD_S)
        axes.acknowledge(now_s - 0.02 + PERIOD_S, now_s + PERIOD_S)
    told_s, sigma_s = axes.history.acknowledged.delay_s
    assert told_s == pytest.approx(0.015, abs=0.001)
    assert sigma_s == pytest.approx(0.003, abs=0.001)
    assert axes.history.delay_s == pytest.approx(told_s, abs=0.001)
    # Less than a millisecond is not worth to have learnt the rest in vain.
    used_s = axes.history.delay_s
    axes.trials.evidence[:] = -1.0
    axes.acknowledge(now_s - 0.01, now_s + PERIOD_S)
    assert (axes.history.delay_s, set(axes.trials.evidence)) == (used_s, {-1.0})


def test_a_change_that_a_drive_takes_a_while_for_strains_it_so_long() -> None:
    """Half the acceleration, 5°/s², is surely there: 0.25°/s a turn of a change by 1°/s."""
    mount = settled()
    assert mount.axes is not None
    assert mount.axes.strained is False
    trials = mount.axes.trials = DelayTrials()
    first = trials.evidence.copy()
    mount.step(change_deg_s=1.0)
    for turn in range(1, 4):
        assert mount.axes.strained is True
        # Of when commands act, its motion says nothing so long.
        assert trials.evidence == pytest.approx(0.999**turn * first)
        mount.step()
    mount.step()
    assert mount.axes.strained is False


def test_a_drive_that_keeps_up_tells_when_commands_act() -> None:
    """Commands are read as they are sent: if they took longer, the ones before would have acted."""
    mount = settled()
    assert mount.axes is not None
    trials = mount.axes.trials = DelayTrials()
    first, later = trials.evidence.copy(), TRIED_S > 0.0
    for turn in range(8):
        mount.step(change_deg_s=0.02 if turn % 2 else -0.02)
    assert (trials.evidence[later] < first[later] - 5.0).all()
    assert trials.evidence[~later] == pytest.approx(0.999**8 * first[~later])


def test_a_delay_may_be_as_much_too_short_as_too_long() -> None:
    tried = TRIED_S.tolist()
    assert tried == sorted(tried)
    assert tried == [-one for one in reversed(tried)]
    # As of one that is 5 ms off, one sigma: nobody measures a delay so that half a turn is likely.
    assert DelayTrials().evidence == pytest.approx([-0.5 * (one / 0.0049) ** 2 for one in tried], rel=1e-3)


def filtered(innovation_deg: float) -> Any:
    """Return an axis whose last measurement surprised by so much, one sigma a degree, and taught nothing."""
    return Made(
        has_just_begun=False,
        innovation_deg=innovation_deg,
        innovation_sigma_deg=1.0,
        kalman_gain=np.zeros(2 + SHARES),
    )


@pytest.mark.parametrize(("off_sigmas", "says"), [(1.0, 0.5), (1.9, 1.805), (2.5, 2.0), (100.0, 2.0)])
@pytest.mark.parametrize("axis", [0, 1])
def test_what_one_sample_says_of_a_delay_is_half_its_squared_surprise_and_two_at_most(
    axis: int, off_sigmas: float, says: float
) -> None:
    """For the first delay, by which the axis was to be there, if it is not where the one in use has it."""
    for seen, sense in ((off_sigmas, 1.0), (0.0, -1.0)):
        trials = DelayTrials()
        trials.evidence[:] = 0.0
        trials.apart[axis, 0, 0] = off_sigmas
        axes: Any = Made(strained=False, ra=filtered(0.0), dec=filtered(0.0))
        setattr(axes, "dec" if axis else "ra", filtered(seen))
        trials.correct(axes)
        assert trials.evidence[0] == pytest.approx(0.999 * sense * says)
        assert trials.evidence[1:] == pytest.approx(np.zeros(7), abs=1e-12)


def test_by_a_longer_delay_an_axis_is_a_turn_of_each_change_behind_once_it_has_answered() -> None:
    """Sent a millisecond before a turn, rates are read by the next one if they take six longer."""
    slow = AxisLimits(lag_s=0.2)
    steady, trials = Steady(0.4, -0.2, MountProfile(ra=slow, dec=slow)), DelayTrials()
    axes, begins_s = steady.axes, steady.axes.sample_utc_s
    steady.history.add(SentRates(begins_s - 0.001, 1.4, 0.3))
    behind = np.where(TRIED_S > 0.0, PERIOD_S, 0.0)
    for turn in range(40):
        from_s, to_s = begins_s + turn * PERIOD_S, begins_s + (turn + 1) * PERIOD_S
        acted, coming = (steady.history.steps(t, t + PERIOD_S) for t in (from_s, to_s))
        trials.predict(acted, coming, to_s, axes)
        # Some of it within the turn, and all of it once the servos have come to rest.
        assert (abs(trials.apart[0, :, 0]) <= behind + 1e-9).all()
    assert trials.apart[0, :, 0] == pytest.approx(-1.0 * behind, abs=1e-6)
    assert trials.apart[1, :, 0] == pytest.approx(-0.5 * behind, abs=1e-6)


def test_evidence_against_a_delay_counts_to_thirty_and_no_further() -> None:
    """It may be right later."""
    steady = Steady(0.4, -0.2)
    trials = steady.axes.trials
    trials.evidence[:] = -29.0
    trials.evidence[3] = -50.0
    trials.correct(steady.axes)
    assert trials.evidence == pytest.approx([-29.0 * 0.999] * 3 + [-30.0] + [-29.0 * 0.999] * 4, abs=0.01)


def test_a_command_that_acted_in_place_of_the_expected_one_speaks_for_the_delays_that_expect_it() -> None:
    """Sent 60 and 10 ms before its turn: read before the second was there, that takes 12 ms or longer."""
    history, trials = CommandHistory(0.0, MountLoop(PERIOD_S)), DelayTrials()
    history.add(SentRates(0.0, 1.0, 2.0))
    history.add(SentRates(0.05, 3.0, 4.0))
    trials.evidence[:] = 0.0
    trials.misread(Step(0.06, 1.0, 2.0), history)
    assert trials.evidence.tolist() == [4.0 if longer_s >= 0.012 else 0.0 for longer_s in TRIED_S]


@pytest.mark.parametrize(("apart_s", "used"), [(0.0009, False), (0.0011, True), (-0.0009, False)])
def test_another_delay_is_worth_having_learnt_the_rest_in_vain_from_a_millisecond_on(
    apart_s: float, used: bool
) -> None:
    axes = Steady(0.4, -0.2).axes
    told: Any = Made(note=lambda *_: None, delay_s=(axes.history.delay_s + apart_s, 0.002))
    axes.history.acknowledged = told
    trials, before_s = axes.trials, axes.history.delay_s
    axes.acknowledge(0.0, 1.0)
    assert axes.history.delay_s == pytest.approx(before_s + (apart_s if used else 0.0))
    assert (axes.trials is not trials) is used


@pytest.mark.parametrize(("share", "misread"), [(0.6, 0), (0.65, 0), (0.7, 1), (1.0, 1)])
def test_another_command_has_acted_where_it_leaves_less_than_a_quarter_of_what_surprises(
    share: float, misread: int
) -> None:
    """Squared: an axis that has done so much of the way to the rate before leaves (1/share - 1)²."""
    mount = settled(shares=(1.0, 0.0))
    assert mount.axes is not None
    mount.step(change_deg_s=0.02)
    before = mount.axes.misread
    changed_deg_s = 0.02 + ACCELERATION_DEG_S2 * PERIOD_S
    mount.step(change_deg_s=0.02, extra_deg_s=-share * changed_deg_s)
    assert mount.axes.misread == before + misread


def test_a_delay_is_proven_against_the_one_in_use_by_motion_and_acknowledgements_together() -> None:
    """How unlikely a third one is counts for nothing."""
    history, trials = CommandHistory(0.04, MountLoop(PERIOD_S)), DelayTrials()
    trials.evidence[:] = -20.0
    longer = TRIED_S.tolist().index(0.006)
    # A profile's delay is 16 ms off, one sigma: 6 ms are less likely than none by 0.07.
    for evidence, proven in ((6.0, None), (6.15, longer)):
        trials.evidence[longer] = evidence
        assert trials.proven(history) == proven
    trials.evidence[longer] = 5.5
    assert trials.proven(history) is None
    # It was no less than 26 ms, as both of them say; then no less than 43 ms: against the one in use.
    history.acknowledged.note(0.0, 0.026, 0.076)
    assert trials.proven(history) is None
    history.acknowledged.note(0.0, 0.043, 0.093)
    assert trials.proven(history) == longer


@pytest.mark.parametrize("shares", [(1.0, 0.0), (0.0, -1.0)])
def test_a_longer_delay_is_learnt_where_one_axis_alone_turns(shares: tuple[float, float]) -> None:
    mount = Mount(1, shares)
    for turn in range(60):
        mount.step(acts=-2 if turn else -1, change_deg_s={20: 0.1, 40: -0.1}.get(turn, 0.0))
    assert mount.history.delay_s > 0.0


@pytest.mark.parametrize("off_ms", [-12, -6, 6])
def test_a_delay_that_is_told_wrong_is_learnt_to_the_millisecond(off_ms: int) -> None:
    """Of commands that are sent at any instants within the turns."""
    rng, loop, told_s = random.Random(1), MountLoop(PERIOD_S), 0.04
    history, sent, axes = CommandHistory(told_s, loop), [AT_REST], None
    ra_deg, dec_deg = 100.0, 20.0
    for turn in range(130):
        read_s, now_s = turn * PERIOD_S, (turn + 1) * PERIOD_S
        sent_s = read_s - rng.uniform(0.0, PERIOD_S)
        rate = 0.3 + 0.2 * math.sin(2.0 * sent_s)
        sent.append(SentRates(sent_s, -rate, 0.5 * rate))
        history.add(sent[-1])
        read = max(
            (one for one in sent if one.sent_utc_s + told_s + 1e-3 * off_ms <= read_s),
            key=lambda one: one.sent_utc_s,
        )
        ra_deg += read.ra_rate_deg_s * PERIOD_S
        dec_deg += read.dec_rate_deg_s * PERIOD_S
        seen_deg = (rng.gauss(one, 0.01 * ARCSEC) for one in (ra_deg, dec_deg))
        loop.note(turn + 1, now_s)
        sample = StatusSample(turn + 1, now_s, 0.0, *seen_deg, True, False, 0.0, 0.0)
        if axes is None:
            axes = Axes.begin(MountProfile(), history, sample, now_s)
        else:
            axes.take(sample, now_s, commanded=True)
    assert 1e3 * (history.delay_s - told_s) == pytest.approx(off_ms, abs=0.5)
    # What the wrong delay has taught of the axis is unlearnt.
    assert axes is not None
    assert abs(axes.ra.gain_error) < 0.003


def test_a_rate_that_sets_in_is_learnt_in_a_few_samples() -> None:
    mount = settled()
    assert mount.axes is not None
    before = mount.axes.ra.disturbance_deg_s
    for _ in range(6):
        mount.step(extra_deg_s=10.0 * ARCSEC)
    assert (mount.axes.ra.disturbance_deg_s - before) / ARCSEC == pytest.approx(10.0, abs=1.5)
    assert abs(mount.off_arcsec) < 0.1


def test_one_glitch_is_hardly_believed() -> None:
    mount = settled()
    mount.ra_deg += 20.0 * ARCSEC
    mount.step()
    mount.ra_deg -= 20.0 * ARCSEC
    assert abs(mount.off_arcsec) < 1.0
    mount.step()
    assert mount.axes is not None
    assert abs(mount.axes.ra.disturbance_deg_s) < 2.0 * ARCSEC


def test_a_gain_is_learnt_from_changing_rates() -> None:
    mount = Mount(3)
    for _ in range(600):
        before = mount.ra_deg
        mount.step()
        mount.ra_deg += 0.01 * (mount.ra_deg - before)
    assert mount.axes is not None
    assert mount.axes.ra.gain_error == pytest.approx(0.01, abs=0.001)


def test_a_mount_that_is_somewhere_else_is_lost_and_said_to_be() -> None:
    mount = settled()
    mount.ra_deg += 30.0
    assert mount.axes is not None
    for _ in range(4):
        mount.step()
        assert not mount.axes.lost
    mount.step()
    assert mount.axes.lost


def test_jumps_that_do_not_come_in_a_row_are_no_other_coordinates() -> None:
    mount = settled()
    assert mount.axes is not None
    for _ in range(2):
        mount.ra_deg += 30.0
        for _ in range(4):
            mount.step()
        assert mount.axes.outliers == 4
        mount.ra_deg -= 30.0
        mount.step()
        assert (mount.axes.outliers, mount.axes.lost) == (0, False)


@pytest.mark.parametrize(
    ("ra_off_deg", "dec_off_deg", "believed"),
    [
        (1.69, 0.0, True),
        (-1.69, 0.0, True),
        (1.71, 0.0, False),
        (-1.71, 0.0, False),
        (0.0, 0.49, True),
        (0.0, -0.49, True),
        (0.0, 0.51, False),
        (0.0, -0.51, False),
        (1.69, -0.49, True),
    ],
)
def test_no_axis_gets_further_than_by_full_speed_the_other_way(
    ra_off_deg: float, dec_off_deg: float, believed: bool
) -> None:
    """0.1°, and twice 2 °/s and 0.5 °/s for 0.4 s."""
    profile = MountProfile(ra=AxisLimits(max_rate_deg_s=2.0), dec=AxisLimits(max_rate_deg_s=0.5))
    loop = MountLoop(PERIOD_S)
    loop.note(0, 0.0)
    first = StatusSample(0, 0.0, 0.0, 359.5, 20.0, True, False, 0.0, 0.0)
    axes = Axes.begin(profile, CommandHistory(0.0, loop), first, 0.0)
    there = (359.5 + ra_off_deg) % 360.0, 20.0 + dec_off_deg
    assert (
        axes.take(StatusSample(8, 0.4, 0.0, *there, True, False, 0.0, 0.0), 0.4, commanded=True) is believed
    )
    assert axes.outliers == (0 if believed else 1)
    assert (axes.ra.position_deg == 359.5) is (not believed or ra_off_deg == 0.0)


def test_coordinates_that_jump_by_some_degrees_lead_the_filter_astray_for_moments_only() -> None:
    """A sync by other hands: what the axis cannot do at once is not taken for a disturbance."""
    mount = settled()
    mount.ra_deg += 1.5
    for _ in range(60):
        mount.step()
    assert mount.axes is not None
    assert abs(mount.axes.ra.gain_error) < 0.02
    assert abs(mount.axes.ra.disturbance_deg_s) < 0.02


TOLD_DEG_S2 = 5.0
STEP_DEG_S, STEP_TURNS = 0.8, 6


def climbed(drive: Drive, acceleration_deg_s2: float, lag_s: float = 0.0, step: float = STEP_DEG_S) -> None:
    """Let an axis climb stairs of rate, as its acceleration and its servo's lag let it; the lag is known."""
    place = rate = answer = 0.0
    short_s = 0.001
    for turn in range(8 * STEP_TURNS):
        commanded, predicted, before = step * (turn // STEP_TURNS), 0.0, place
        for _ in range(round(PERIOD_S / short_s)):
            answer += (commanded - answer) * (min(1.0, short_s / lag_s) if lag_s else 1.0)
            most = acceleration_deg_s2 * short_s
            rate += max(-most, min(most, answer - rate))
            predicted += answer * short_s
            place += rate * short_s
        assert place >= before
        drive.see(place % 360.0, predicted, PERIOD_S)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_a_drive_that_is_weaker_than_told_is_known_by_its_motion(share: float) -> None:
    drive = Drive(TOLD_DEG_S2)
    climbed(drive, share * TOLD_DEG_S2)
    assert drive.acceleration_deg_s2 == pytest.approx(share * TOLD_DEG_S2, rel=0.01)
    small = Drive(0.1 * TOLD_DEG_S2)
    climbed(small, 0.1 * share * TOLD_DEG_S2, step=0.1 * STEP_DEG_S)
    assert small.acceleration_deg_s2 == pytest.approx(0.1 * share * TOLD_DEG_S2, rel=0.01)


@pytest.mark.parametrize(("share", "weak"), [(0.24, False), (0.26, True)])
def test_no_drive_has_less_than_a_quarter_of_what_is_told(share: float, weak: bool) -> None:
    """That is a motion of another command."""
    drive = Drive(TOLD_DEG_S2)
    climbed(drive, share * TOLD_DEG_S2)
    known = share * TOLD_DEG_S2 if weak else TOLD_DEG_S2
    assert drive.acceleration_deg_s2 == pytest.approx(known, rel=0.01)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("off_deg_s", "weak"), [(0.149, False), (0.151, True)])
def test_a_drive_is_at_its_limit_where_three_samples_miss_their_rate_by_more_than_a_servo(
    off_deg_s: float, weak: bool, sense: float
) -> None:
    """By 30 ms of the acceleration told: 0.15 °/s, which neither of two commands in a row may explain."""
    drive, step_deg_s, place_deg = Drive(TOLD_DEG_S2), 0.5 * TOLD_DEG_S2 * PERIOD_S, 0.0
    for turn in range(8):
        place_deg += sense * step_deg_s * turn * PERIOD_S
        predicted_deg = sense * (step_deg_s * (turn + 1) + off_deg_s) * PERIOD_S
        drive.see(place_deg, predicted_deg, PERIOD_S)
        known = 0.5 * TOLD_DEG_S2 if weak and turn >= 4 else TOLD_DEG_S2
        assert drive.acceleration_deg_s2 == pytest.approx(known)


def test_samples_at_a_drives_limit_count_in_a_row_only() -> None:
    """One at which the axis has its rate begins the count anew, and what was reached before is over."""
    drive, rate_deg_s, place_deg = Drive(TOLD_DEG_S2), 0.0, 0.0
    found = []
    # The first sample of each run has the rate that was commanded before it.
    for acceleration_deg_s2, turns in ((0.0, 2), (4.0, 3), (0.0, 1), (2.0, 4)):
        for _ in range(turns):
            rate_deg_s += acceleration_deg_s2 * PERIOD_S
            place_deg += rate_deg_s * PERIOD_S
            asked_deg_s = 9.0 if acceleration_deg_s2 else rate_deg_s
            drive.see(place_deg, asked_deg_s * PERIOD_S, PERIOD_S)
            found.append(drive.acceleration_deg_s2)
    assert found[:-1] == [TOLD_DEG_S2] * 9
    assert found[-1] == pytest.approx(2.0)


@pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.2])
def test_a_servo_that_lags_as_is_known_of_it_is_no_weak_drive(lag_s: float) -> None:
    drive = Drive(TOLD_DEG_S2)
    climbed(drive, 4.0 * TOLD_DEG_S2, lag_s)
    assert drive.acceleration_deg_s2 == TOLD_DEG_S2


def test_what_a_plan_of_the_mounts_own_lay_between_is_not_counted_together() -> None:
    """Two samples at its limit, its own plan, and two more: a servo's answer may look so."""
    drive = Drive(TOLD_DEG_S2)
    for _ in range(2):
        place = 0.0
        for turn in range(4):
            rate = 0.5 * TOLD_DEG_S2 * PERIOD_S * turn
            place += rate * PERIOD_S
            drive.see(place, 6.0 * PERIOD_S, PERIOD_S)
        assert drive.acceleration_deg_s2 == TOLD_DEG_S2
        drive.forget()


def test_a_drive_that_was_taken_for_weak_shows_that_it_is_not() -> None:
    drive = Drive(TOLD_DEG_S2)
    climbed(drive, 0.4 * TOLD_DEG_S2)
    drive.forget()
    climbed(drive, 4.0 * TOLD_DEG_S2)
    assert drive.acceleration_deg_s2 == TOLD_DEG_S2


def test_a_drive_that_misses_a_command_or_stands_still_is_not_taken_for_weak() -> None:
    drive, rng = Drive(TOLD_DEG_S2), random.Random(5)
    for _ in range(200):
        drive.see(rng.gauss(0.0, 0.1 * ARCSEC), 1.0 * PERIOD_S, PERIOD_S)
    assert drive.acceleration_deg_s2 == TOLD_DEG_S2

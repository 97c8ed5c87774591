"""Statuses that freeze, run backwards or burst, slews not carried out, a target below the horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from late_start import late
from test_trouble import NEAR_S

from sattrack.control.target import sky_error
from sattrack.core.angles import altitude_deg
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, Truth
from sattrack.mount.xerxes.datagrams import (
    Command,
    decode_command,
    decode_status,
    encode_command,
    encode_status,
)
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun, summarise
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import Status
    from sattrack.views.run import Summary, TrackView

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
Span = tuple[float, float]


@dataclass(slots=True)
class StrangeRun(VirtualRun):
    """A run whose statuses are spoilt and held up in bursts, over a span of seconds after culmination.

    `spoil` makes what arrives of a status and of the first one that is spoilt.
    """

    spoil: Callable[[Status, Status], Status] | None = None
    span_s: tuple[float, float] = (0.0, math.inf)
    burst: int = 1
    slews_left_out: int = 0
    first: Status | None = None
    held_up: list[Any] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)
    views: list[TrackView] = field(default_factory=list)
    slews: list[Command] = field(default_factory=list)
    """Rising edges of slews."""
    last: Command = field(default_factory=Command)

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        data, truth = what
        self.truths.append(truth)
        if self.span_s[0] <= now_utc_s - CULMINATION_S < self.span_s[1]:
            status = decode_status(data)
            self.first = self.first or status
            if self.spoil is not None:
                data = encode_status(self.spoil(status, self.first))
            self.held_up.append((data, truth))
            if len(self.held_up) < self.burst:
                return
        else:
            self.held_up.append((data, truth))
        waiting, self.held_up = self.held_up, []
        for one in waiting:
            super(StrangeRun, self)._status_arrives(now_utc_s, one)

    def _command_arrives(self, now_utc_s: float, datagram: bytes) -> None:
        command, before = decode_command(datagram), self.last
        self.last = command
        if command.slew and not before.slew:
            self.slews.append(command)
        if command.slew and len(self.slews) <= self.slews_left_out:
            # Acknowledged like any other, it leads to where the mount is.
            status = decode_status(self._installation.turn(now_utc_s)[0] or b"")
            here = msgspec.structs.replace(command, target_ra_h=status.ra_h, target_dec_deg=status.dec_deg)
            datagram = encode_command(here)
        super(StrangeRun, self)._command_arrives(now_utc_s, datagram)

    def off_arcsec(self, after_s: float, until_s: float) -> float:
        """The true axes' largest error between two instants, seconds after culmination."""
        track = self.engine.tracker
        return max(
            sky_error(t.utc_s, t.ra_deg, t.dec_deg, track.direction_at(t.utc_s)).total_arcsec
            for t in self.truths
            if after_s <= t.utc_s - CULMINATION_S <= until_s
        )

    def warned(self, words: str) -> bool:
        return any(words in warning for view in self.views for warning in view.warnings)


def fly(
    min_alt_deg: float = 65.0, around_end_s: Span | None = None, **strange: Any
) -> tuple[Summary, StrangeRun]:
    """Fly the practice pass above an altitude, or only so many seconds before and after the end of that."""
    facts = prepare(RunRequest("25544", "sim", None, None, None, min_alt_deg, virtual=True)).facts
    if around_end_s is not None:
        end_s = facts.plan.end_utc_s
        plan = msgspec.structs.replace(
            facts.plan, start_utc_s=end_s - around_end_s[0], end_utc_s=end_s + around_end_s[1]
        )
        facts = msgspec.structs.replace(facts, plan=plan)
    facts = late(facts, 25.0 if around_end_s else NEAR_S)
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg)
    mount = SimulatedMount(facts.profile, site, demo_pass.START)
    run = StrangeRun(build_engine(facts), mount, facts.started_utc_s, NoRecording(), (), **strange)
    run.progress = run.views.append
    ended_utc_s = run.run()
    return summarise(run.engine, run.statistics, ended_utc_s), run


def at_rest(run: StrangeRun) -> bool:
    return abs(run.truths[-1].dec_rate_deg_s) < 0.01 and -0.01 < run.truths[-1].ra_rate_deg_s < 0.015


def all_frozen(status: Status, first: Status) -> Status:
    return msgspec.structs.replace(
        status, sidereal_h=first.sidereal_h, ra_h=first.ra_h, dec_deg=first.dec_deg
    )


def place_frozen(status: Status, first: Status) -> Status:
    return msgspec.structs.replace(status, ra_h=first.ra_h, dec_deg=first.dec_deg)


def clock_backwards(status: Status, first: Status) -> Status:
    return msgspec.structs.replace(status, sidereal_h=(2.0 * first.sidereal_h - status.sidereal_h) % 24.0)


def clock_frozen(status: Status, first: Status) -> Status:
    return msgspec.structs.replace(status, sidereal_h=first.sidereal_h)


def test_statuses_that_freeze_for_good_stop_the_mount_like_silence_does() -> None:
    summary, run = fly(75.0, spoil=all_frozen)
    assert summary.ended_by == "link"
    assert "said the same again and again" in (summary.message or "")
    assert at_rest(run)
    assert run.off_arcsec(0.0, 1.9) < 2.0


@pytest.mark.parametrize("spoil", [all_frozen, place_frozen])
def test_what_freezes_for_a_second_is_followed_through(spoil: Any) -> None:
    summary, run = fly(75.0, spoil=spoil, span_s=(0.0, 1.0))
    assert summary.ended_by == "set"
    assert run.off_arcsec(-5.0, 10.0) < 0.1


def test_a_clock_that_runs_backwards_is_left_aside_and_said_to_be() -> None:
    summary, run = fly(spoil=clock_backwards, span_s=(0.0, 12.0))
    assert summary.ended_by == "set"
    assert run.off_arcsec(-5.0, 20.0) < 1.0
    assert run.warned("does not run as ours")


def test_coordinates_that_jump_and_stay_are_the_mounts_new_ones_and_that_is_told() -> None:
    """As after a sync by other hands: 8° are more than the axes can do in a loop."""
    summary, run = fly(spoil=lambda status, _: msgspec.structs.replace(status, dec_deg=status.dec_deg - 8.0))
    assert summary.ended_by == "set"
    assert run.warned("was not where its commands lead")
    shown = run.views[-40].error
    assert shown is not None
    assert shown.total_arcsec < 1.0
    assert run.off_arcsec(10.0, 15.0) == pytest.approx(8.0 * 3600.0, rel=1e-3)


def test_bursts_under_a_clock_that_stands_still_are_told_apart_by_their_count() -> None:
    summary, run = fly(spoil=clock_frozen, span_s=(-20.0, 15.0), burst=4)
    assert summary.ended_by == "set"
    assert run.off_arcsec(-20.0, 15.0) < 2.0


def test_slews_that_are_acknowledged_and_not_carried_out_are_asked_for_again() -> None:
    summary, run = fly(75.0, slews_left_out=2)
    assert len(run.slews) == 3
    assert summary.ended_by == "set"
    assert summary.acquired_after_s is not None
    assert summary.acquired_after_s < 2.0


def test_a_mount_that_never_carries_out_a_slew_is_given_up_in_words() -> None:
    summary, run = fly(slews_left_out=100)
    assert summary.ended_by == "error"
    assert "got 3 slew commands" in (summary.message or "")
    assert at_rest(run)


def test_a_target_that_goes_below_the_horizon_is_followed_down_to_it_and_no_further() -> None:
    summary, run = fly(min_alt_deg=1.5, around_end_s=(10.0, 62.0))
    latitude_deg = run.engine.spec.propagator.site.latitude_deg
    lowest_deg = min(altitude_deg(t.hour_angle_axis_deg, t.dec_axis_deg, latitude_deg) for t in run.truths)
    assert 0.0 < lowest_deg < 1.0
    assert run.engine.tracker.direction_at(run.truths[-1].utc_s).alt_deg < -1.0
    assert run.warned("held at the altitude limit")
    assert summary.ended_by == "set"
    assert at_rest(run)

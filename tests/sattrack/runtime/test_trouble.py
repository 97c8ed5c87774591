"""What goes wrong in a pass, in virtual time: outages, wrong signs, glitches, set clocks, absurd nudges."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from late_start import late

from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, Truth
from sattrack.mount.xerxes.datagrams import decode_status, encode_status
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun, failure, summarise
from sattrack.views.messages import Message, Nudge, StopNow
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.views.run import Summary, TrackView

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
NEAR_S = 10.0
"""The way from where the simulated mount stands at first to where the practice pass is high."""
Span = tuple[float, float]
NEVER: Span = (0.0, 0.0)


@dataclass(slots=True)
class TroubledRun(VirtualRun):
    """A run whose link loses or spoils datagrams over spans of seconds after culmination."""

    lost_commands: Span = NEVER
    lost_statuses: Span = NEVER
    spoilt: Span = NEVER
    spoil: dict[str, float] = field(default_factory=dict)
    truths: list[Truth] = field(default_factory=list)
    views: list[TrackView] = field(default_factory=list)

    def _command_arrives(self, now_utc_s: float, datagram: bytes) -> None:
        if not within(now_utc_s, self.lost_commands):
            super(TroubledRun, self)._command_arrives(now_utc_s, datagram)

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        status, truth = what
        self.truths.append(truth)
        if within(now_utc_s, self.lost_statuses):
            return
        if within(now_utc_s, self.spoilt):
            decoded = decode_status(status)
            moved = {name: getattr(decoded, name) + by for name, by in self.spoil.items()}
            status = encode_status(msgspec.structs.replace(decoded, **moved))
        super(TroubledRun, self)._status_arrives(now_utc_s, (status, truth))


def within(utc_s: float, span: Span) -> bool:
    return span[0] <= utc_s - CULMINATION_S < span[1]


@dataclass(frozen=True, slots=True)
class Flown:
    summary: Summary
    run: TroubledRun

    @property
    def exit_code(self) -> int:
        error = failure(self.summary, interrupted=False)
        return 0 if error is None else error.exit_code

    def error_arcsec(self, after_s: float, until_s: float) -> float:
        """The largest error that was shown between two instants, seconds after culmination."""
        shown = (v.error for v in self.run.views if after_s <= v.utc_s - CULMINATION_S <= until_s)
        return max(e.total_arcsec for e in shown if e is not None)

    def at_rest(self) -> bool:
        truth = self.run.truths[-1]
        return abs(truth.dec_rate_deg_s) < 0.01 and -0.01 < truth.ra_rate_deg_s < 0.015


def fly(
    messages: tuple[tuple[float, Message], ...] = (),
    mount_profile: MountProfile | None = None,
    profile: MountProfile | None = None,
    min_alt_deg: float = 45.0,
    from_s: float | None = None,
    **trouble: Any,
) -> Flown:
    """Fly the practice pass as far as it is above an altitude: above 45° it is for a minute each way.

    Messages are dated from culmination, and so is `from_s`, where the pass is to be followed from later on.
    """
    request = RunRequest("25544", "sim", None, None, None, min_alt_deg, virtual=True)
    facts: RunFacts = prepare(request).facts
    if from_s is not None:
        plan = msgspec.structs.replace(facts.plan, start_utc_s=CULMINATION_S + from_s)
        facts = msgspec.structs.replace(facts, plan=plan)
    facts = late(facts, NEAR_S)
    if profile is not None:
        facts = msgspec.structs.replace(facts, profile=profile)
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg)
    mount = SimulatedMount(mount_profile or facts.profile, site, demo_pass.START)
    timed = tuple((CULMINATION_S + at_s, message) for at_s, message in messages)
    run = TroubledRun(build_engine(facts), mount, facts.started_utc_s, NoRecording(), timed, **trouble)
    run.progress = run.views.append
    ended_utc_s = run.run()
    return Flown(summarise(run.engine, run.statistics, ended_utc_s), run)


def test_an_outage_that_ends_finds_the_stop_still_being_sent() -> None:
    flown = fly(lost_commands=(0.0, 8.0), lost_statuses=(0.0, 8.0), min_alt_deg=75.0)
    assert flown.exit_code == 4
    assert flown.summary.ended_by == "link"
    assert flown.summary.mount_stopped is True
    assert flown.at_rest()


def test_a_stop_is_sent_until_it_is_confirmed() -> None:
    flown = fly(messages=((0.0, StopNow()),), lost_commands=(-0.5, 20.0), min_alt_deg=75.0)
    assert flown.summary.ended_by == "operator"
    assert flown.summary.mount_stopped is True
    assert flown.at_rest()
    assert any("being sent again" in words for view in flown.run.views for words in view.warnings)


def test_a_short_silence_is_followed_through() -> None:
    flown = fly(lost_statuses=(0.0, 1.0), min_alt_deg=65.0, from_s=-10.0)
    assert flown.summary.ended_by == "set"
    assert flown.error_arcsec(2.0, 24.0) < 1.0


@pytest.mark.parametrize("turned", [{"ra_rate_sign": -1}, {"dec_rate_sign": -1}])
def test_a_mount_that_goes_the_other_way_is_stopped(turned: dict[str, Any]) -> None:
    flown = fly(mount_profile=msgspec.structs.replace(MountProfile(), **turned))
    assert flown.exit_code == 3
    assert flown.summary.ended_by == "limit:obedience"
    assert f"turn {next(iter(turned))} in the profile" in (flown.summary.message or "")
    assert flown.at_rest()
    begun = next(v for v in flown.run.views if v.phase == "acquiring")
    assert Utc.parse(flown.summary.ended_utc).unix_s - begun.utc_s < 6.0


def test_the_hour_angle_axis_is_held_inside_its_limit() -> None:
    limited = msgspec.structs.replace(MountProfile(), hour_angle_limit_deg=60.0)
    flown = fly(profile=limited, min_alt_deg=35.0, from_s=45.0)
    assert flown.summary.ended_by == "set"
    assert flown.summary.held_s["hour_angle"] > 10.0
    assert 59.5 < max(abs(truth.hour_angle_axis_deg) for truth in flown.run.truths) <= 60.0
    assert any(view.phase == "holding" for view in flown.run.views)
    assert flown.at_rest()


@pytest.mark.parametrize("spoil", [{"dec_deg": -10.0}, {"ra_h": 0.7}])
def test_one_wrong_status_does_not_throw_the_mount(spoil: dict[str, float]) -> None:
    flown = fly(spoilt=(0.0, 0.05), spoil=spoil, min_alt_deg=65.0, from_s=-10.0)
    assert flown.summary.ended_by == "set"
    truth = max(
        flown.run.truths, key=lambda t: abs(t.dec_rate_deg_s) if abs(t.utc_s - CULMINATION_S) < 2.0 else 0.0
    )
    assert abs(truth.dec_rate_deg_s) < 0.2
    assert flown.error_arcsec(0.0, 24.0) < 0.1


@pytest.mark.parametrize(
    "step_s", [-3.0, 0.5, *(pytest.param(step_s, marks=pytest.mark.soak) for step_s in (-0.5, 3.0))]
)
def test_a_mounts_clock_that_is_set_costs_a_second_or_two(step_s: float) -> None:
    """Its sidereal time jumps, and with it the right ascension that it reports."""
    step_h = step_s / 3600.0
    flown = fly(
        spoilt=(0.0, 1e6), spoil={"sidereal_h": step_h, "ra_h": step_h}, min_alt_deg=60.0, from_s=-10.0
    )
    assert flown.summary.ended_by == "set"
    assert flown.error_arcsec(8.0, 30.0) < 2.0


def test_absurd_nudges_are_refused_and_the_pass_goes_on() -> None:
    """A refusal is told until another word is obeyed, at least 5 s later."""
    absurd = {-11.0: Nudge(cross_deg=80.0), -4.0: Nudge(along_s=1e308), 3.0: Nudge(along_s=float("nan"))}
    messages = ((at_s + after_s, word) for at_s, nudge in absurd.items()
                for after_s, word in ((0.0, nudge), (5.5, Nudge())))  # fmt: skip
    flown = fly(messages=tuple(messages), min_alt_deg=75.0)
    assert flown.summary.ended_by == "set"
    assert (flown.summary.bias_along_s, flown.summary.bias_cross_deg) == (0.0, 0.0)
    assert flown.summary.true_peak_arcsec is not None
    assert flown.summary.true_peak_arcsec < 1.0
    for at_s in absurd:
        told = {
            round(view.utc_s - CULMINATION_S - at_s): any("nudge refused" in words for words in view.warnings)
            for view in flown.run.views
        }
        assert [told[after_s] for after_s in (1, 4, 6)] == [True, True, False]


def test_a_mount_that_stands_elsewhere_is_told() -> None:
    flown = fly(
        messages=((0.0, StopNow()),), spoilt=(-1e6, 1e6), spoil={"site_latitude_deg": -80.0}, min_alt_deg=75.0
    )
    assert any("believes it stands at -27.85" in words for view in flown.run.views for words in view.warnings)


def test_a_pass_that_ends_before_it_is_reached_is_not_a_success() -> None:
    request = RunRequest("25544", "sim", None, None, "2026-10-02T13:08:40Z", 10.0, virtual=True)
    request = replace(request, elements=None, site=None)
    facts = prepare(request).facts
    mount = SimulatedMount(facts.profile, SimulatedSite(52.1541, 4.4908), demo_pass.START)
    run = VirtualRun(build_engine(facts), mount, facts.started_utc_s, NoRecording())
    summary = summarise(run.engine, run.statistics, run.run())
    error = failure(summary, interrupted=False)
    assert error is not None
    assert error.exit_code == 1
    assert "before the mount was on the satellite" in str(error)


def test_an_unconfirmed_stop_outranks_the_interrupt() -> None:
    flown = fly(messages=((0.0, StopNow()),), lost_commands=(0.0, 1e6), min_alt_deg=75.0)
    assert flown.summary.mount_stopped is False
    error = failure(flown.summary, interrupted=True)
    assert error is not None
    assert error.exit_code == 1
    assert "stop it by hand" in str(error)


def test_a_start_that_takes_long_is_no_silence_of_the_mount() -> None:
    facts = prepare(RunRequest("25544", "sim", None, None, None, 45.0, virtual=True)).facts
    engine = build_engine(facts)
    slow_s = facts.started_utc_s + 10.0
    engine.tick(slow_s)
    assert engine.tracker.ended_by is None
    engine.tick(slow_s + 2.9)
    assert engine.tracker.ended_by is None
    engine.tick(slow_s + 3.1)
    assert engine.tracker.ended_by == "link"

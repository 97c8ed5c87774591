"""The link-loss contract by rows: passes in virtual time, faults at 1.2 °/s, judged by the true axes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pytest

from sattrack.control.driver import DirectStop
from sattrack.mount import link_loss
from sattrack.mount.link_loss import (
    ROWS,
    braking_s,
    standstill_after_s,
    standstill_s,
)
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile
from sattrack.mount.profiles import ProfileFile
from sattrack.mount.simulator.installation import Installation, parse_faults
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import HANG_AFTER_S
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.guardian import POLL_S
from sattrack.views.messages import StopNow

if TYPE_CHECKING:
    from sattrack.control.engine import Engine

PERIOD_S = 0.05
PHASE_S = 0.0217
AT_S = 8.0
"""The fault's begin, from the run's: by then the mount follows, near culmination."""
LASTS_S = 8.0
BEGIN = "2026-10-02T13:05:05Z"
WATCHDOG_S = 1.5


def profile(move_axis: str, watchdog_s: float | None) -> ProfileFile:
    return ProfileFile(move_axis=move_axis, watchdog_s=watchdog_s)  # type: ignore[arg-type]


@dataclass
class Laboratory:
    """An engine and a mount with its faults, which goes on after the engine has ended."""

    engine: Engine
    installation: Installation
    begin_utc_s: float
    client: Engine | DirectStop | None = None
    truths: list[tuple[float, float]] = field(default_factory=list)
    """Seconds from the begin, and how fast the faster axis turns."""
    turns: int = 0

    def __post_init__(self) -> None:
        self.client = self.engine

    @property
    def elapsed_s(self) -> float:
        return self.turns * PERIOD_S

    def until(self, elapsed_s: float) -> None:
        while self.elapsed_s < elapsed_s - 1e-9:
            now_utc_s = self.begin_utc_s + self.elapsed_s
            if self.client is not None and not self.client.finished:
                self.installation.receive(self.client.tick(now_utc_s))
            status, truth = self.installation.turn(now_utc_s + PHASE_S)
            if status is not None and self.client is not None:
                self.client.receive(status, now_utc_s + PHASE_S)
            if truth is not None:
                ra = abs(truth.ra_rate_deg_s)
                speed = max(min(ra, abs(ra - SIDEREAL_RATE_DEG_S)), abs(truth.dec_rate_deg_s))
                self.truths.append((self.elapsed_s + PHASE_S, speed))
            self.turns += 1

    def rest_after_s(self, since_s: float) -> float:
        """When, counted from an instant, the axes came to rest for good; inf where they move at the end."""
        if self.truths[-1][1] > 1e-4:
            return math.inf
        moving = [at_s for at_s, speed in self.truths if speed > 1e-4]
        return moving[-1] + PERIOD_S - since_s

    def speed_at(self, elapsed_s: float) -> float:
        return next(speed for at_s, speed in self.truths if at_s >= elapsed_s)


def laboratory(described: ProfileFile, faults: str = "", **hardware: object) -> Laboratory:
    prepared = prepare(
        RunRequest(
            satellite="25544",
            mount_url="sim",
            elements=None,
            site=None,
            clock_option=BEGIN,
            min_alt_deg=10.0,
            profile=described,
        )
    )
    facts = prepared.facts
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    settings = SimulatorProfile(**hardware)  # type: ignore[arg-type]
    mount = SimulatedMount(facts.profile, site, demo_pass.START, settings)
    installation = Installation(mount, parse_faults(faults))
    installation.next_turn_s(facts.started_utc_s)
    return Laboratory(build_engine(facts), installation, facts.started_utc_s)


MOVE_AXIS = pytest.mark.parametrize("move_axis", ["held", "edge"])


def kept(lab: Laboratory, key: str, measured_s: float) -> float:
    """Hold a row to its promise at the rate at hand; return the rate."""
    speed = lab.speed_at(AT_S - 0.1)
    assert speed > 0.8
    assert measured_s <= standstill_s(ROWS[key], lab.engine.spec.profile, speed)
    return speed


@MOVE_AXIS
def test_lost_statuses(move_axis: str) -> None:
    lab = laboratory(profile(move_axis, None), f"silent@{AT_S}s+60s")
    lab.until(AT_S + 20.0)
    rest_s = lab.rest_after_s(AT_S)
    kept(lab, "statuses", rest_s)
    assert rest_s > link_loss.STATUS_LOST_S
    assert lab.engine.finished
    assert lab.engine.tracker.ended_by == "link"


@MOVE_AXIS
def test_statuses_lost_for_a_second_cost_nothing(move_axis: str) -> None:
    lab = laboratory(profile(move_axis, None), f"silent@{AT_S}s+1s")
    lab.until(AT_S + 3.0)
    assert lab.engine.tracker.ended_by is None
    assert lab.speed_at(AT_S + 2.0) > 0.8


@MOVE_AXIS
@pytest.mark.parametrize(("fault", "key"), [("deaf", "commands"), ("cut", "both")])
def test_lost_commands_and_a_cut_without_a_watchdog_last_until_the_link_is_back(
    move_axis: str, fault: str, key: str
) -> None:
    lab = laboratory(profile(move_axis, None), f"{fault}@{AT_S}s+{LASTS_S}s")
    lab.until(AT_S + 1.0)
    speed = lab.speed_at(AT_S - 0.1)
    lab.engine.operate(StopNow(), lab.begin_utc_s + lab.elapsed_s)
    lab.until(AT_S + LASTS_S - 0.1)
    # Nothing that is said reaches it: it is as fast as it was at the fault's begin.
    assert standstill_s(ROWS[key], lab.engine.spec.profile) == math.inf
    assert lab.truths[-1][1] == pytest.approx(speed, rel=0.02)
    lab.until(AT_S + LASTS_S + 5.0)
    after_s = lab.rest_after_s(AT_S + LASTS_S)
    assert 0.0 < after_s <= standstill_after_s(ROWS[key], lab.engine.spec.profile, speed)


@MOVE_AXIS
def test_a_cut_that_outlasts_the_stops_that_are_sent_leaves_the_mount_moving(move_axis: str) -> None:
    lasts_s = link_loss.STATUS_LOST_S + link_loss.STOPS_SENT_S + 1.0
    lab = laboratory(profile(move_axis, None), f"cut@{AT_S}s+{lasts_s}s")
    lab.until(AT_S + lasts_s + 5.0)
    assert lab.engine.finished
    assert lab.engine.mount_stopped is False
    assert lab.rest_after_s(AT_S) == math.inf
    # `sattrack stop`, once the link is back.
    lab.client = DirectStop(lab.engine.spec.profile, lab.begin_utc_s + lab.elapsed_s)
    asked_s, speed = lab.elapsed_s, lab.truths[-1][1]
    lab.until(asked_s + 5.0)
    assert lab.client.mount_stopped
    assert lab.rest_after_s(asked_s) <= standstill_after_s(ROWS["machine"], lab.engine.spec.profile, speed)


@MOVE_AXIS
@pytest.mark.parametrize(("fault", "key"), [("deaf", "commands-watchdog"), ("cut", "both-watchdog")])
def test_lost_commands_and_a_cut_with_a_watchdog(move_axis: str, fault: str, key: str) -> None:
    lab = laboratory(profile(move_axis, WATCHDOG_S), f"{fault}@{AT_S}s+60s")
    lab.until(AT_S + 10.0)
    rest_s = lab.rest_after_s(AT_S)
    kept(lab, key, rest_s)
    assert rest_s > WATCHDOG_S - 2 * PERIOD_S
    assert lab.engine.tracker.ended_by is not None


@MOVE_AXIS
@pytest.mark.parametrize(("key", "notices_s"), [("feeder", link_loss.NOTICED_S), ("hang", None)])
def test_a_feeder_that_dies_or_hangs_is_followed_by_its_guardian(
    move_axis: str, key: str, notices_s: float | None
) -> None:
    lab = laboratory(profile(move_axis, None))
    lab.until(AT_S)
    lab.client = None
    # How soon the guardian notices is measured with real processes, in test_guardian.py.
    lab.until(AT_S + (HANG_AFTER_S + 2 * POLL_S if notices_s is None else notices_s))
    counter = lab.engine.session.health.sent
    lab.client = DirectStop(lab.engine.spec.profile, lab.begin_utc_s + lab.elapsed_s, counter)
    lab.until(AT_S + 8.0)
    kept(lab, key, lab.rest_after_s(AT_S))
    assert lab.client.finished
    assert lab.client.mount_stopped
    assert lab.client.session.health.doubled_launches == 0


@MOVE_AXIS
@pytest.mark.parametrize("ticks", [1, 2, pytest.param(4, marks=pytest.mark.soak), 10])
def test_a_guardian_sees_a_stop_through_that_its_feeder_had_begun(move_axis: str, ticks: int) -> None:
    """The abort's flag, or its acknowledgement, stands already: an edge must come all the same."""
    lab = laboratory(profile(move_axis, None))
    lab.until(AT_S)
    lab.engine.operate(StopNow(), lab.begin_utc_s + lab.elapsed_s)
    lab.until(AT_S + ticks * PERIOD_S)
    counter = lab.engine.session.health.sent
    lab.client = DirectStop(lab.engine.spec.profile, lab.begin_utc_s + lab.elapsed_s, counter)
    lab.until(AT_S + 6.0)
    assert lab.rest_after_s(AT_S) <= standstill_s(ROWS["feeder"], lab.engine.spec.profile, 1.3)
    assert lab.client.mount_stopped


@MOVE_AXIS
@pytest.mark.parametrize("at_s", [0.8, 1.8])
def test_a_guardian_stops_a_slew_whose_feeder_dies(move_axis: str, at_s: float) -> None:
    lab = laboratory(profile(move_axis, None))
    lab.until(at_s)
    assert lab.truths[-1][1] > 2.0
    lab.client = DirectStop(lab.engine.spec.profile, lab.begin_utc_s + lab.elapsed_s, 7)
    lab.until(at_s + 8.0)
    slew_rate_deg_s = lab.engine.spec.profile.ra.slew_rate_deg_s
    assert lab.rest_after_s(at_s) <= standstill_s(ROWS["feeder"], lab.engine.spec.profile, slew_rate_deg_s)
    assert lab.client.mount_stopped


@MOVE_AXIS
def test_a_machine_that_dies_leaves_a_mount_without_a_watchdog_moving(move_axis: str) -> None:
    lab = laboratory(profile(move_axis, None))
    lab.until(AT_S)
    lab.client = None
    lab.until(AT_S + 8.0)
    assert standstill_s(ROWS["machine"], lab.engine.spec.profile) == math.inf
    assert lab.rest_after_s(AT_S) == math.inf
    lab.client = DirectStop(lab.engine.spec.profile, lab.begin_utc_s + lab.elapsed_s)
    asked_s, speed = lab.elapsed_s, lab.truths[-1][1]
    lab.until(asked_s + 5.0)
    assert lab.rest_after_s(asked_s) <= standstill_after_s(ROWS["machine"], lab.engine.spec.profile, speed)


@MOVE_AXIS
def test_a_machine_that_dies_leaves_a_mount_with_a_watchdog_at_rest(move_axis: str) -> None:
    lab = laboratory(profile(move_axis, WATCHDOG_S))
    lab.until(AT_S)
    lab.client = None
    lab.until(AT_S + 10.0)
    kept(lab, "machine-watchdog", lab.rest_after_s(AT_S))


@MOVE_AXIS
def test_a_mount_whose_program_ends_brakes_with_it_and_is_followed_on_if_it_is_back_soon(
    move_axis: str,
) -> None:
    lab = laboratory(profile(move_axis, None), f"crash@{AT_S}s+{LASTS_S}s")
    lab.until(AT_S + LASTS_S - 0.1)
    mount = lab.installation.mount
    # While its program is down nobody tells the truth: the axes themselves are asked.
    mount._advance(lab.begin_utc_s + lab.elapsed_s)
    truth = mount._truth(lab.begin_utc_s + lab.elapsed_s)
    assert abs(truth.dec_rate_deg_s) < 1e-4
    assert truth.ra_rate_deg_s == pytest.approx(SIDEREAL_RATE_DEG_S, abs=1e-4)
    assert standstill_s(ROWS["mount-stops"], lab.engine.spec.profile) < LASTS_S
    lab.until(AT_S + LASTS_S + 5.0)
    after_s = lab.rest_after_s(AT_S + LASTS_S)
    assert after_s <= standstill_after_s(ROWS["mount-stops"], lab.engine.spec.profile, 1.0)
    assert lab.engine.tracker.ended_by == "link"


@MOVE_AXIS
def test_a_mount_that_restarts_within_two_seconds_is_followed_on(move_axis: str) -> None:
    lab = laboratory(profile(move_axis, None), f"crash@{AT_S}s+1s")
    lab.until(AT_S + 4.0)
    assert lab.engine.session.health.restarts == 1
    assert lab.speed_at(AT_S + 3.0) > 0.8


@MOVE_AXIS
@pytest.mark.parametrize("fault", ["crash", "freeze"])
def test_a_mount_whose_drives_go_on_without_its_program_rests_once_it_is_back(
    move_axis: str, fault: str
) -> None:
    lab = laboratory(profile(move_axis, WATCHDOG_S), f"{fault}@{AT_S}s+{LASTS_S}s", crashed_drives="hold")
    lab.until(AT_S + LASTS_S + 6.0)
    speed = lab.speed_at(AT_S - 0.1)
    assert standstill_s(ROWS["mount-holds"], lab.engine.spec.profile) == math.inf
    after_s = lab.rest_after_s(AT_S + LASTS_S)
    # It moved on for as long as its program was gone.
    assert 0.0 < after_s <= standstill_after_s(ROWS["mount-holds"], lab.engine.spec.profile, speed)


def test_the_figures_are_those_of_whoever_keeps_them() -> None:
    assert link_loss.HANG_S == HANG_AFTER_S
    assert link_loss.NOTICED_S > 2 * POLL_S


def test_standstill_is_counted_with_the_slower_axis_and_the_watchdog() -> None:
    slow = MountProfile(
        ra=AxisLimits(max_rate_deg_s=6.0, max_acceleration_deg_s2=10.0),
        dec=AxisLimits(max_rate_deg_s=3.0, max_acceleration_deg_s2=2.0),
        watchdog_s=4.0,
    )
    assert braking_s(slow) == pytest.approx(1.5)
    assert braking_s(slow, -1.0) == pytest.approx(0.5)
    row = ROWS["both-watchdog"]
    assert standstill_s(row, slow, 1.0) == pytest.approx(4.0 + row.during_s + 0.5)
    with pytest.raises(ValueError, match="no watchdog_s"):
        standstill_s(row, MountProfile())

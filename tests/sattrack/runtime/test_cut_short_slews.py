"""What a slew cannot reach for a limit: the mount waits as near as may be, and is there as the way opens."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import erfa
import msgspec
import numpy as np
import pytest
from late_start import late
from rehearsal_draws import draw, noisy

from sattrack.control.tracker import FOLLOWING, Phase
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.mount.simulator.profile import simulator_profile
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import build_engine
from sattrack.runtime.flight import VirtualRun
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts

SUN_CONE_DEG = 15.0
JOINING_S = 4.0
"""A slew of some degrees, its handshake, and the control's settling."""


@dataclass(slots=True)
class Watched(VirtualRun):
    """A run whose statuses are noted: when, whether on target, and the slews begun."""

    on: list[tuple[float, bool]] = field(default_factory=list)
    axes: list[tuple[float, float, float]] = field(default_factory=list)
    slews: int = 0
    _slewing: bool = False

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        VirtualRun._status_arrives(self, now_utc_s, what)
        tracker, truth = self.engine.tracker, what[1]
        assert tracker.error is not None
        good = tracker.phase in FOLLOWING and tracker.error.total_arcsec < 60.0
        self.on.append((now_utc_s, good))
        self.axes.append((now_utc_s, truth.hour_angle_axis_deg, truth.dec_axis_deg))
        slewing = tracker.phase is Phase.SLEWING
        self.slews += slewing and not self._slewing
        self._slewing = slewing


def flown(seed: int, longest_s: float = math.inf) -> tuple[RunFacts, Watched]:
    prepared = noisy(draw(seed), seed, sticky=False)
    facts = late(prepared.facts, 40.0)
    end_utc_s = min(facts.plan.end_utc_s, facts.plan.start_utc_s + longest_s)
    facts = msgspec.structs.replace(facts, plan=msgspec.structs.replace(facts.plan, end_utc_s=end_utc_s))
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(facts.profile, site, demo_pass.START, simulator_profile(prepared.simulator))
    run = Watched(build_engine(facts), mount, facts.started_utc_s, NoRecording())
    run.run()
    return facts, run


@pytest.mark.parametrize(
    ("seed", "longest_s"), [pytest.param(46, math.inf, marks=pytest.mark.soak), (121, 150.0)]
)
def test_a_target_is_taken_up_again_as_it_comes_out_of_the_suns_cone(seed: int, longest_s: float) -> None:
    """The Sun's place is ERFA's, as seen from the Earth's centre: right to 0.003°."""
    facts, run = flown(seed, longest_s)
    utc_s = np.arange(facts.plan.start_utc_s, facts.plan.end_utc_s, 0.05)
    seen = Propagator(facts.elements, facts.site.place(), place="astrometric").at(Utc(utc_s))
    earth_au = erfa.epv00(2440587.5, utc_s / 86400.0)[0]["p"]
    sun = -earth_au / np.linalg.norm(earth_au, axis=1)[:, None]
    ra, dec = np.radians(seen.ra_deg), np.radians(seen.dec_deg)
    target = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    apart_deg = np.degrees(np.arccos(np.sum(sun * target, axis=1)))
    behind = utc_s[apart_deg < SUN_CONE_DEG + 0.2]
    assert len(behind) > 200
    again = min(t for t, good in run.on if good and t > behind[-1])
    assert again < behind[-1] + JOINING_S


def test_a_mount_waits_at_the_end_of_its_travel_and_is_not_worn_by_slews_that_lead_nowhere() -> None:
    """The satellite rises 60° beyond where the hour angle ends, and comes there after 110 s."""
    facts, run = flown(120, 130.0)
    begin, limit = facts.plan.start_utc_s, facts.profile.hour_angle_limit_deg
    waiting = [ha for t, ha, _ in run.axes if begin < t < begin + 100.0]
    assert max(waiting) < -limit + 8.0
    assert run.slews <= 12

"""Random passes for benches and tests: orbit, site, mount and limits from a seed, and the run."""

from __future__ import annotations

import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from sattrack.control.tracker import FOLLOWING
from sattrack.core.errors import SattrackError
from sattrack.mount.model import DTICS_S_PER_DEG_S, AxisLimits
from sattrack.mount.profiles import ProfileFile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.mount.simulator.profile import simulator_profile
from sattrack.mount.xerxes.datagrams import decode_status
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun, summarise
from tle.elements import Elements
from tle.instants import Utc
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.runtime.facts import Prepared
    from sattrack.views.run import Summary

LONGEST_S = 600.0
SHORTEST_S = 90.0
GAP_S = 0.5
BEGIN_UTC = "2026-10-02T00:00:00Z"
STICKY = {
    "bandwidth_hz": 12.0,
    "friction_a": 0.5,
    "stiction_a": 0.6,
    "friction_feedforward": 0.7,
    "integral_hz": 2.0,
    "ripple_a": 0.04,
}


@dataclass(frozen=True)
class Flown:
    """What the run that followed came to: its summary, and the peak rates that its statuses tell."""

    summary: Summary
    lost_s: float
    peak_hour_angle_deg_s: float | None
    peak_dec_deg_s: float | None


def draw(seed: int) -> Prepared:
    """Return a prepared pass of 90 s to ten minutes, with a random mount and limits; two in five are slow."""
    dice = random.Random(f"rehearsal {seed}")
    while True:
        elements = orbit(dice)
        site = Site(dice.uniform(-65.0, 65.0), dice.uniform(-180.0, 180.0), dice.uniform(0.0, 3000.0))
        hour = dice.uniform(0.0, 24.0)
        at = Utc(float(Utc.parse(BEGIN_UTC).unix_s) + hour * 3600.0).isoformat("seconds")
        axis = {
            "max_rate_deg_s": dice.uniform(0.25, 1.0) if dice.random() < 0.4 else dice.uniform(1.0, 7.0),
            "max_acceleration_deg_s2": dice.uniform(3.0, 12.0),
            "slew_rate_deg_s": dice.uniform(4.0, 12.0),
        }
        profile = ProfileFile(
            name=f"drawn {seed}",
            ra=AxisLimits(**axis),
            dec=AxisLimits(**axis),
            hour_angle_limit_deg=dice.choice([200.0, 200.0, 120.0, 95.0, 70.0]),
        )
        request = RunRequest(
            satellite=elements.name,
            mount_url="sim",
            elements=[elements],
            site=site,
            clock_option=at,
            min_alt_deg=dice.choice([10.0, 15.0, 25.0]),
            virtual=True,
            profile=profile,
        )
        try:
            prepared = prepare(request)
        except SattrackError:
            continue
        plan = prepared.facts.plan
        if SHORTEST_S <= plan.end_utc_s - plan.start_utc_s <= LONGEST_S:
            return prepared


def orbit(dice: random.Random) -> Elements:
    height_km = dice.choice([dice.uniform(350.0, 650.0), dice.uniform(500.0, 1400.0)])
    period_min = 84.4886 * ((6378.135 + height_km) / 6378.135) ** 1.5
    return Elements(
        name="DRAWN",
        catalog_number=dice.randrange(1, 90000),
        classification="U",
        designator="",
        epoch=Utc.parse(BEGIN_UTC),
        inclination_deg=dice.uniform(20.0, 105.0),
        raan_deg=dice.uniform(0.0, 360.0),
        eccentricity=dice.uniform(0.0001, 0.01),
        arg_perigee_deg=dice.uniform(0.0, 360.0),
        mean_anomaly_deg=dice.uniform(0.0, 360.0),
        mean_motion_rev_day=1440.0 / period_min,
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=0.0,
    )


def noisy(prepared: Prepared, seed: int, sticky: bool) -> Prepared:
    """Return the same run with a mount of its own clock, timer, link and noise, and friction if sticky."""
    dice = random.Random(f"noise {seed}")
    table: dict[str, Any] = {
        "clock_offset_s": dice.uniform(-2.0, 2.0),
        "clock_drift_ppm": dice.uniform(-20.0, 20.0),
        "timer": dice.choice(["exact", "windows"]),
        "timer_drift_ppm": dice.uniform(-20.0, 20.0),
        "command_jitter_s": dice.uniform(0.0, 0.001),
        "status_jitter_s": dice.uniform(0.0, 0.001),
        "encoder_noise_tics": dice.uniform(0.0, 0.5),
        "seed": seed,
    }
    if sticky:
        table["servo"] = STICKY
    return replace(prepared, simulator={**prepared.simulator, **table})


def fly(prepared: Prepared) -> Flown:
    """Fly the pass as `track --mount sim --virtual` does, looking on at each status that arrives."""
    facts = prepared.facts
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(facts.profile, site, demo_pass.START, simulator_profile(prepared.simulator))
    run = WatchedRun(build_engine(facts), mount, facts.started_utc_s, NoRecording())
    ended_utc_s = run.run()
    summary = summarise(run.engine, run.statistics, ended_utc_s)
    lost_s = facts.plan.end_utc_s - facts.plan.start_utc_s - summary.on_target_s
    return Flown(summary, lost_s, *_peaks(run.rows, facts.plan.on_target_arcsec))


@dataclass(slots=True)
class WatchedRun(VirtualRun):
    """A virtual run of which each status' instant, error on the sky and drive rates are kept."""

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        # As slots make the class anew, `super` without arguments would not find it.
        VirtualRun._status_arrives(self, now_utc_s, what)
        status, tracker = decode_status(what[0]), self.engine.tracker
        error = tracker.error
        if error is None or self.engine.safety.holding is not None or tracker.acquired_utc_s is None:
            return
        if tracker.phase in FOLLOWING:
            rates = abs(status.ra_rate_dtics_s), abs(status.dec_rate_dtics_s)
            self.rows.append((error.utc_s, error.total_arcsec, *rates))


def _peaks(
    rows: list[tuple[float, float, float, float]], within_arcsec: float
) -> tuple[float | None, float | None]:
    """Return the peak drive rates while on target, from a second after each joining on; degrees a second."""
    followed = []
    joined = before = float("-inf")
    for utc_s, error, ra, dec in rows:
        if error > within_arcsec:
            joined = float("inf")
            continue
        if joined == float("inf") or utc_s - before > GAP_S:
            joined = utc_s
        before = utc_s
        if utc_s >= joined + 1.0:
            followed.append((ra, dec))
    if not followed:
        return None, None
    ra_most, dec_most = (max(row[axis] for row in followed) for axis in (0, 1))
    return ra_most / DTICS_S_PER_DEG_S, dec_most / DTICS_S_PER_DEG_S

"""Random passes for benches and tests: orbit, site, mount and limits from a seed, and the run."""

from __future__ import annotations

import random
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.errors import SattrackError
from sattrack.mount import AxisLimits
from sattrack.profiles import ProfileFile
from sattrack.recording.format import STATUS, VIEW
from sattrack.recording.reading import Recording
from sattrack.runtime.fly import fly_virtual
from sattrack.runtime.prepare import RunRequest, prepare
from sattrack.view import TrackView
from sattrack.xerxes.datagrams import DTICS_S_PER_DEG_S, decode_status
from tle.elements import Elements
from tle.instants import Utc
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.runtime.prepare import Prepared
    from sattrack.view import Summary

LONGEST_S = 600.0
SHORTEST_S = 90.0
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
    """What the run that followed came to: its summary, and the peak rates that its recording tells."""

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
    """Fly the pass, recorded, and read the recording."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        facts = msgspec.structs.replace(prepared.facts, recording=str(path))
        summary = fly_virtual(replace(prepared, facts=facts))
        peaks = _peaks(path, facts.plan.on_target_arcsec)
    plan = prepared.facts.plan
    lost_s = plan.end_utc_s - plan.start_utc_s - summary.on_target_s
    return Flown(summary, lost_s, *peaks)


def _peaks(path: Path, within_arcsec: float) -> tuple[float | None, float | None]:
    """Return the peak drive rates between the first and the last view on target."""
    rows, on = [], []
    for entry in Recording(path).entries():
        if entry.topic == STATUS:
            status = decode_status(entry.data)
            rows.append((entry.utc_s, abs(status.ra_rate_dtics_s), abs(status.dec_rate_dtics_s)))
        elif entry.topic == VIEW:
            view = msgspec.json.decode(entry.data, type=TrackView)
            near = view.error is not None and view.error.total_arcsec <= within_arcsec
            if view.phase == "tracking" and near:
                on.append(entry.utc_s)
    if not on:
        return None, None
    inside = [row for row in rows if on[0] <= row[0] <= on[-1]]
    return (
        max(row[1] for row in inside) / DTICS_S_PER_DEG_S,
        max(row[2] for row in inside) / DTICS_S_PER_DEG_S,
    )

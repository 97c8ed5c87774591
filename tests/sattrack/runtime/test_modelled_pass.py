"""Passes with a mount that has pointing errors: where its telescope looks, by a stranger's geometry."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import camera_sky
import msgspec
import numpy as np
import pytest
from late_start import late
from strangers.tilted_mount import TiltedMount, apart_arcsec, local, turn

from sattrack.mount.geometry import AxisGeometry, Pole
from sattrack.mount.model import MountProfile, PointingTerms, SitePlace, mean_sidereal_deg
from sattrack.mount.simulator.camera import TruePath
from sattrack.mount.simulator.mount import SimulatedSite, StartPosition
from sattrack.mount.simulator.night_sky import NightSky
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun
from sattrack.runtime.rehearse import rehearse
from sattrack.safety import SafetyLimits
from sattrack.safety.bounds import Bounds
from tle.instants import Utc
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.runtime.facts import Prepared

SITE = camera_sky.SITE
MOUNT = TiltedMount(SITE.latitude_deg, 4000.0, -3500.0, 600.0, 90.0, 700.0, -900.0, 30.0)
TERMS = {"ME": -4000.0, "MA": 3500.0, "CH": -600.0, "NP": -90.0, "IH": -700.0, "ID": 900.0, "TF": 30.0}
MODEL = PointingTerms(
    "2026-10-01T00:00:00Z",
    SITE.latitude_deg,
    {name: (value, 1.0) for name, value in TERMS.items()},
    2.0,
    20,
    signs="tpoint",
)
POLE = Pole(55.0, 25.0)
TILTED = dataclasses.replace(
    MOUNT, latitude_deg=POLE.pole_altitude_deg, pole_azimuth_deg=POLE.pole_azimuth_deg
)
"""The same errors about a first axis that points low into the north-east."""


STEP_S = 2.0
JOINED_S = 4.0
APPROACH_S = {"never": 15.0, "hour_angle": 25.0}
BESIDE_FOR_S = 25.0
"""So long a span shows how far beside the satellite the telescope looks without the model."""
FLIPS_WITHIN_S = 66.0
"""The way of a mount to the other side of its pier, and back to the satellite."""


def prepared(
    modelled: bool, pier_rule: str = "never", min_alt_deg: float = 62.0, lasts_s: float = math.inf
) -> Prepared:
    """Return the middle of the practice pass, with or without the model in the profile."""
    made = prepare(RunRequest("25544", "sim", None, None, None, min_alt_deg, virtual=True))
    plan = made.facts.plan
    end_utc_s = min(plan.end_utc_s, plan.start_utc_s + lasts_s)
    facts = msgspec.structs.replace(made.facts, plan=msgspec.structs.replace(plan, end_utc_s=end_utc_s))
    made = dataclasses.replace(made, facts=late(facts, APPROACH_S[pier_rule]))
    profile = msgspec.structs.replace(
        made.facts.profile, pointing=MODEL if modelled else None, pier_rule=pier_rule
    )
    return dataclasses.replace(made, facts=msgspec.structs.replace(made.facts, profile=profile))


def tilted(modelled: bool, reports: str) -> Prepared:
    """Return the same for a mount with a geometry."""
    made = prepared(False, lasts_s=math.inf if modelled else BESIDE_FOR_S)
    profile = msgspec.structs.replace(
        made.facts.profile,
        additive=False,
        geometry=AxisGeometry(POLE.pole_azimuth_deg, POLE.pole_altitude_deg, reports=reports),  # type: ignore[arg-type]
        stands_at=SitePlace(SITE.latitude_deg, SITE.longitude_deg),
        pointing=msgspec.structs.replace(MODEL, axes=POLE) if modelled else None,
    )
    return dataclasses.replace(made, facts=msgspec.structs.replace(made.facts, profile=profile))


def looked_beside_arcsec(made: Prepared, flip: str) -> np.ndarray:
    """Fly a pass; return every two seconds how far the stranger's telescope looks beside the satellite."""
    facts = made.facts
    place = SimulatedSite(SITE.latitude_deg, SITE.longitude_deg)
    hardware = SimulatorProfile(flip=flip)  # type: ignore[arg-type]
    mount = camera_sky.SeenMount(facts.profile, place, StartPosition(), hardware)
    mount.path = TruePath(keep_s=3600.0)
    begin_s = facts.started_utc_s
    end_s = VirtualRun(build_engine(facts), mount, begin_s, NoRecording()).run()
    sky = NightSky(
        SITE, [demo_pass.elements()], camera_sky.NONE, Refraction(facts.pressure_hpa, facts.temperature_c)
    )
    zero_deg = sky.hour_angle_zero_deg(mean_sidereal_deg(begin_s, SITE.longitude_deg), begin_s)
    at_s = np.arange(facts.plan.start_utc_s + JOINED_S, end_s - 12.0, STEP_S)
    first, second = mount.path.at(at_s)
    there = sky.satellite(0, at_s, 0.0 * at_s, 0.0 * at_s).directions
    geometry = facts.profile.geometry
    mount, turned = MOUNT, np.eye(3)
    if geometry is not None:
        # What reports the sky does so by its clock, as if its base were turned about the Earth's axis.
        by_clock = zero_deg if geometry.reports == "sky" else 0.0
        mount, turned = TILTED, turn(local(0.0, 90.0, SITE.latitude_deg), -math.radians(by_clock))
        zero_deg = 0.0
    return np.array(
        [
            apart_arcsec(turned @ mount.looks(h + zero_deg, d), one)
            for h, d, one in zip(first, second, there, strict=True)
        ]
    )


@pytest.mark.parametrize("flip", ["never", "hour_angle"])
def test_a_modelled_mount_keeps_its_telescope_on_the_satellite(flip: str) -> None:
    turns = flip == "hour_angle"
    with_model = looked_beside_arcsec(prepared(True, flip, 27.0 if turns else 62.0), flip)
    # A mount that flips leaves the target for some seconds on its way round; it is on it on both sides.
    beside_s = STEP_S * np.count_nonzero(with_model >= 1.0)
    assert (0.0 < beside_s < FLIPS_WITHIN_S) if turns else beside_s == 0.0
    assert float(with_model[:20].max()) < 1.0
    assert float(with_model[-20:].max()) < 1.0


@pytest.mark.parametrize("reports", ["sky", "axes"])
def test_a_modelled_mount_with_a_pole_of_its_own_keeps_its_telescope_on_the_satellite(reports: str) -> None:
    assert float(looked_beside_arcsec(tilted(True, reports), "never").max()) < 1.0
    assert float(np.median(looked_beside_arcsec(tilted(False, reports), "never"))) > 1800.0


def test_without_a_model_the_telescope_looks_a_degree_beside() -> None:
    assert float(np.median(looked_beside_arcsec(prepared(False, lasts_s=BESIDE_FOR_S), "never"))) > 1800.0


def test_a_rehearsal_takes_the_axes_where_the_model_has_them() -> None:
    paths = [rehearse(prepared(modelled)).path for modelled in (False, True)]
    plain, fed = (path.pointing for path in paths)
    rows = np.searchsorted(plain.utc_s, fed.utc_s[::50].clip(plain.utc_s[0], plain.utc_s[-1]))
    rows = rows.clip(0, len(plain.utc_s) - 1)
    off = np.abs(plain.dec_axis_deg[rows] - fed.dec_axis_deg[::50])
    assert 0.3 < float(off.max()) < 2.5


def test_the_cone_about_the_sun_grows_by_what_the_model_may_hide() -> None:
    noon_s = float(Utc.parse("2026-06-21T11:40:00Z").unix_s)
    limits = SafetyLimits(optical=True)
    boxes = []
    for profile in (MountProfile(), MountProfile(pointing=MODEL)):
        bounds = Bounds(profile, limits, SITE.latitude_deg, SITE.longitude_deg)
        assert bounds.look(noon_s, 0.0)
        boxes.append(next(cone.cone_deg for cone in bounds._cones if cone.name == "sun"))
    assert boxes[1] - boxes[0] == pytest.approx(sum(map(abs, TERMS.values())) / 3600.0)
    assert math.isfinite(boxes[0])

"""What benches with random skies share: a satellite and a site drawn from a seed, a run that follows it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sattrack.control.tracker import TrackPlan
from sattrack.core.angles import wrap180
from sattrack.mount.model import MountProfile, mean_sidereal_deg
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunFacts
from sattrack.runtime.target_facts import target_facts
from sattrack.safety import SafetyLimits
from sattrack.settings import SiteSettings
from tle.elements import Elements
from tle.instants import Utc
from tle.site import Site

if TYPE_CHECKING:
    import random

    from tle.ephemeris import Ephemeris
    from tle.propagator import Propagator

NO_LIMITS = SafetyLimits(floor_altitude_deg=-89.0, optical=False)
"""What stands in the way is another matter: the mount's own limits are what counts here."""


def drawn_orbit(dice: random.Random, revolutions_a_day: tuple[float, float]) -> tuple[Elements, Site, float]:
    """Draw a satellite, a site, and an instant within a day of its epoch, POSIX seconds of UTC."""
    elements = replace(
        demo_pass.elements(),
        inclination_deg=dice.uniform(30.0, 120.0),
        raan_deg=dice.uniform(0.0, 360.0),
        mean_anomaly_deg=dice.uniform(0.0, 360.0),
        mean_motion_rev_day=dice.uniform(*revolutions_a_day),
    )
    site = Site(dice.uniform(-60.0, 60.0), dice.uniform(-180.0, 180.0), 0.0)
    return elements, site, float(elements.epoch.unix_s) + dice.uniform(0.0, 86400.0)


def hour_angle_deg(propagator: Propagator, utc_s: float) -> float:
    """Return the satellite's hour angle by the mean sidereal time."""
    ra_deg = float(propagator.at(Utc(utc_s)).ra_deg)
    return wrap180(mean_sidereal_deg(utc_s, propagator.site.longitude_deg) - ra_deg)


def airless_facts(
    orbit: tuple[Elements | Ephemeris, Site, float],
    span: tuple[float, float],
    profile: MountProfile,
    limits: SafetyLimits = NO_LIMITS,
    mount_name: str = "drawn",
) -> RunFacts:
    """Return a run over a span, without refraction and biases, that begins at the instant of the orbit."""
    target, site, begin_s = orbit
    return RunFacts(
        elements=target if isinstance(target, Elements) else None,
        followed=None if isinstance(target, Elements) else target_facts(target, *span),
        site=SiteSettings(site.latitude_deg, site.longitude_deg, 0.0),
        refraction="off",
        pressure_hpa=1010.0,
        temperature_c=10.0,
        plan=TrackPlan(*span),
        culminate_utc_s=span[0],
        max_alt_deg=90.0,
        profile=profile,
        limits=limits,
        bias_along_s=0.0,
        bias_cross_deg=0.0,
        mount_name=mount_name,
        started_utc_s=begin_s,
    )

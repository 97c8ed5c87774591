"""What a schedule's pass is run by on the simulated mount: rehearsed beforehand, or flown in virtual time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from sattrack.runtime.facts import SIMULATED, RunFacts
from sattrack.runtime.prepare import with_detours
from sattrack.settings import SiteSettings
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile
    from sattrack.safety import SafetyLimits
    from sattrack.schedule.schema import Terms
    from tle.elements import Elements
    from tle.site import Site


class PlannedPass(Protocol):
    """A pass of a plan, chosen or not."""

    @property
    def elements(self) -> Elements:
        """Its satellite's elements."""

    @property
    def culminate_utc_s(self) -> float:
        """When it is highest, POSIX seconds of UTC."""

    @property
    def max_alt_deg(self) -> float:
        """How high it comes."""


def planned_facts(
    one: PlannedPass,
    terms: Terms,
    plan: TrackPlan,
    started_utc_s: float,
    site: Site,
    mount: MountProfile,
    limits: SafetyLimits,
) -> RunFacts:
    """Return the facts of a pass' run, by the terms of its schedule, in standard air."""
    air = Refraction.standard(site.height_m)
    return with_detours(
        RunFacts(
            elements=one.elements,
            site=SiteSettings(site.latitude_deg, site.longitude_deg, site.height_m),
            refraction="auto",
            pressure_hpa=air.pressure_hpa,
            temperature_c=air.temperature_c,
            plan=plan,
            culminate_utc_s=one.culminate_utc_s,
            max_alt_deg=one.max_alt_deg,
            profile=mount,
            limits=limits,
            bias_along_s=terms.bias_along_s,
            bias_cross_deg=terms.bias_cross_deg,
            mount_name=SIMULATED,
            started_utc_s=started_utc_s,
        )
    )

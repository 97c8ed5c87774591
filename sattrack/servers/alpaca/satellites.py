"""What the actions of an Alpaca telescope need of satellites: passes to list, and the facts of a run.

What computes them is imported when the first is asked for.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.faults import Fault, Number
from sattrack.settings import SiteSettings
from tle.elements import Elements
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.servers.alpaca.actions import Passes, TrackSatellite
    from tle.passes import Pass

NO_ELEMENTS = "no elements: give --elements FILE to `sattrack serve alpaca`, or set elements in sattrack.toml"


class Satellites(msgspec.Struct, frozen=True):
    """Whose passes there are, over which site, and for which mount."""

    elements: list[Elements]
    site: SiteSettings
    profile: MountProfile
    limits: SafetyLimits
    min_alt_deg: float
    refraction: Literal["auto", "on", "off"]
    mount: str

    def prepare(self) -> None:
        """Import what passes and facts are computed with, and read its tables: nobody waits for it then."""
        if not self.elements:
            return
        from sattrack.runtime import facts, prepare
        from tle.propagator import Propagator

        del facts, prepare
        if self.profile.through_pole:
            from sattrack.planning import passing

            del passing
        with contextlib.suppress(TleError):
            Propagator(self.elements[0], self.site.place())

    def passes(self, asked: Passes, now_utc_s: float) -> list[dict[str, Any]]:
        """Return a satellite's coming passes, fields named as by `sattrack passes --json`. Raises Fault."""
        from tle.passes import find_passes
        from tle.propagator import Propagator

        elements = self._find(asked.satellite)
        floor_deg = self.min_alt_deg if asked.min_alt_deg is None else asked.min_alt_deg
        try:
            propagator = Propagator(elements, self.site.place())
            found = find_passes(propagator, Utc(now_utc_s), asked.hours, floor_deg)
        except TleError as error:
            raise Fault(Number.INVALID_OPERATION, str(error)) from error
        return [_row(elements, seen) for seen in found]

    def facts(self, asked: TrackSatellite, now_utc_s: float) -> RunFacts:
        """Return the facts of a run: the pass in progress, else the next. Raises Fault."""
        from sattrack.runtime.facts import RunFacts, choose_pass, plan_for
        from sattrack.runtime.prepare import with_detours
        from tle.refraction import Refraction

        elements, site, now = self._find(asked.satellite), self.site.place(), Utc(now_utc_s)
        floor_deg = self.min_alt_deg if asked.min_alt_deg is None else asked.min_alt_deg
        lowest_deg = self.limits.floor_altitude_deg
        if floor_deg < lowest_deg:
            words = f"min_alt_deg is {floor_deg:g}; the mount is kept above {lowest_deg:g}"
            raise Fault(Number.INVALID_VALUE, words)
        air = Refraction.standard(site.height_m)
        try:
            seen = choose_pass(elements, site, now, floor_deg)
            return with_detours(
                RunFacts(
                    elements=elements,
                    site=self.site,
                    refraction=self.refraction,
                    pressure_hpa=air.pressure_hpa,
                    temperature_c=air.temperature_c,
                    plan=plan_for(seen, now),
                    culminate_utc_s=float(seen.culminate_utc.unix_s),
                    max_alt_deg=float(seen.max_alt_deg),
                    profile=self.profile,
                    limits=self.limits,
                    bias_along_s=0.0,
                    bias_cross_deg=0.0,
                    mount_name=self.mount,
                    started_utc_s=now_utc_s,
                )
            )
        except (SattrackError, TleError) as error:
            raise Fault(Number.INVALID_OPERATION, str(error)) from error

    def _find(self, name: str) -> Elements:
        from tle.sources import find

        if not self.elements:
            raise Fault(Number.INVALID_OPERATION, NO_ELEMENTS)
        try:
            return find(self.elements, name)
        except TleError as error:
            raise Fault(Number.INVALID_VALUE, str(error)) from error


def run_told(facts: RunFacts) -> dict[str, Any]:
    """Return what a client is told of a run that begins."""
    return {
        "name": facts.elements.name,
        "catalog_number": facts.elements.catalog_number,
        "from_utc": Utc(facts.plan.start_utc_s).isoformat("milliseconds"),
        "to_utc": Utc(facts.plan.end_utc_s).isoformat("milliseconds"),
        "culminate_utc": Utc(facts.culminate_utc_s).isoformat("milliseconds"),
        "max_alt_deg": facts.max_alt_deg,
    }


def _row(elements: Elements, seen: Pass) -> dict[str, Any]:
    def told(instant: Utc | None) -> str | None:
        return None if instant is None else instant.isoformat("milliseconds")

    return {
        "name": elements.name,
        "catalog_number": elements.catalog_number,
        "rise_utc": told(seen.rise_utc),
        "culminate_utc": told(seen.culminate_utc),
        "set_utc": told(seen.set_utc),
        "max_alt_deg": float(seen.max_alt_deg),
    }

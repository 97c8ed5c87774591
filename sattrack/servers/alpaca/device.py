"""What is said of a telescope before anything is asked of its mount, and what its profile lets it do."""

from __future__ import annotations

import uuid
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from tle.site import Site

Spans = tuple[tuple[float, float], ...]
MAKER = "sattrack"
GERMAN, POLAR = 2, 1
ANY_RATE: Spans = ((0.0, 360.0),)
FINE_RATES = frozenset({"RightAscensionRate", "DeclinationRate"})


class Abilities(msgspec.Struct, frozen=True):
    """What a mount can do that not every mount can."""

    slews: bool = True
    syncs: bool = True
    guides: bool = True
    guide_rates: bool = True
    """Whether it reports them."""
    fine_rates: bool = True
    sets_tracking: bool = True
    axis_rates_deg_s: tuple[Spans, Spans] = (ANY_RATE, ANY_RATE)
    """Which rates of its own each axis bears, the lowest and the highest of each range."""

    def lack(self, member: str) -> str | None:
        """Return what it lacks for a member of ITelescopeV4, as text; None for nothing."""
        if member in FINE_RATES:
            return None if self.fine_rates else "no offset rates"
        if member in {"PulseGuide", "IsPulseGuiding"}:
            return None if self.guides else "no guide pulses"
        if member.startswith("GuideRate"):
            return None if self.guide_rates else "no guide rates to report"
        if member.startswith("SlewTo"):
            return None if self.slews else "no slews"
        return "no sync" if member.startswith("SyncTo") and not self.syncs else None


@dataclass(frozen=True, slots=True)
class Device:
    """One telescope: its mount's profile, where it stands, and its identity."""

    profile: MountProfile
    site: Site
    mount: str
    """What `--mount` says."""
    version: str
    host: str
    """Which computer serves it."""
    abilities: Abilities = Abilities()  # noqa: RUF009 - frozen

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{MAKER}: {self.profile.name}"

    @property
    def description(self) -> str:
        """What it is."""
        return f"mount {self.profile.name} at {self.mount}, driven by {MAKER}"

    @property
    def info(self) -> str:
        """What drives it."""
        spoken = "ASCOM Alpaca" if self.mount.startswith("alpaca:") else "Xerxes mount control protocol"
        return f"{MAKER} {self.version}, {spoken}"

    @property
    def unique_id(self) -> str:
        """A number that no other telescope has, and that stays the same."""
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"{MAKER}:{self.host}:{self.mount}"))

    @property
    def alignment(self) -> int:
        """The AlignmentMode: only a mount that changes sides counts as a German one."""
        return GERMAN if self.profile.pier_rule == "hour_angle" else POLAR

    def max_rate_deg_s(self, axis: int) -> float:
        """Return the fastest rate that an axis may be given; 0 for an axis that does not exist.

        The hour angle axis' rate replaces the sidereal one, to which the mount adds MoveAxis.
        """
        if axis == 0:
            return max(0.0, self.profile.ra.max_rate_deg_s - SIDEREAL_RATE_DEG_S)
        return self.profile.dec.max_rate_deg_s if axis == 1 else 0.0

    def axis_rates_deg_s(self, axis: int) -> Spans:
        """Return the ranges of rates that an axis may be given; none for an axis that does not exist."""
        most = self.max_rate_deg_s(axis)
        if most == 0.0:
            return ()
        spans = self.abilities.axis_rates_deg_s[axis]
        return tuple((low, min(high, most)) for low, high in spans if low < most)

    def destination_side(self, hour_angle_deg: float) -> int:
        """Return on which side of the pier a slew to an hour angle (±180) ends: 1 is beyond the pole."""
        return int(self.profile.pier_rule == "hour_angle" and hour_angle_deg > 0.0)

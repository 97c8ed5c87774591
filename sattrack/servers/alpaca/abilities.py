"""What clients of `sattrack serve alpaca` may be offered where the mount is an Alpaca telescope itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.alpaca.link import GatewayLink
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.requests import FineRate, Park
from sattrack.servers.alpaca.device import Abilities

if TYPE_CHECKING:
    from sattrack.mount.alpaca.device import DeviceFacts, Span
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.console import Connection
    from sattrack.runtime.mounts import MountAddress
    from sattrack.servers.alpaca.device import Spans


def within_its_rates(described: ProfileFile, connection: Connection) -> ProfileFile:
    """Return a profile whose axes turn no faster than the mount says that it bears."""
    link = connection.link
    if not isinstance(link, GatewayLink):
        return described
    ra, dec = (
        msgspec.structs.replace(
            limits, max_rate_deg_s=min(limits.max_rate_deg_s, gain * link.facts.fastest_deg_s(axis))
        )
        for axis, (limits, gain) in enumerate(
            zip((described.ra, described.dec), _gains(described.mount), strict=True)
        )
    )
    return msgspec.structs.replace(described, ra=ra, dec=dec)


def without_places(described: ProfileFile, address: MountAddress | None) -> ProfileFile:
    """Return a profile without places to park and to be home where the mount is not sent there by us."""
    if address is None or address.not_carried(Park()) is None:
        return described
    return msgspec.structs.replace(described, park=None, home=None)


def abilities_of(connection: Connection, address: MountAddress | None, profile: MountProfile) -> Abilities:
    """Return what clients may ask of the mount at the other end of a connection."""
    link = connection.link
    if address is None or not isinstance(link, GatewayLink):
        return Abilities()
    facts = link.facts
    ra_gain, dec_gain = _gains(profile)
    return Abilities(
        slews=facts.can_slew,
        syncs=facts.can_sync,
        guides=facts.can_pulse_guide,
        guide_rates=facts.guide_rates_deg_s is not None,
        # The gateway gives tracking back after each stop, as it was.
        sets_tracking=False,
        fine_rates=address.not_carried(FineRate()) is None,
        axis_rates_deg_s=(
            # What MoveAxis adds to, or replaces, is the sky's rate.
            _own_rates(facts.primary_rates, ra_gain, SIDEREAL_RATE_DEG_S if profile.additive else 0.0),
            _own_rates(facts.secondary_rates, dec_gain, 0.0),
        ),
    )


def refusals(connection: Connection, address: MountAddress | None) -> str | None:
    """Return in a line what clients are refused on this mount; None where they are refused nothing."""
    link = connection.link
    why_not = None if address is None else address.not_carried(Park())
    if why_not is None or not isinstance(link, GatewayLink):
        return None
    lacking = _lacking(link.facts)
    more = f", and this one has no {' or '.join(lacking)}" if lacking else ""
    return f"{why_not}{more}: clients are refused that"


def _lacking(facts: DeviceFacts) -> list[str]:
    can = {"slews": facts.can_slew, "sync": facts.can_sync, "guide pulses": facts.can_pulse_guide}
    return [what for what, there in can.items() if not there]


def _gains(profile: MountProfile) -> tuple[float, float]:
    return profile.ra_rate_gain, profile.dec_rate_gain


def _own_rates(borne: tuple[Span, ...], gain: float, sky_deg_s: float) -> Spans:
    """Return the rates of an axis itself, whichever way it turns, that come of the rates that it bears."""
    return tuple(
        (gain * span.low_deg_s + (sky_deg_s if span.low_deg_s else 0.0), gain * span.high_deg_s - sky_deg_s)
        for span in borne
    )

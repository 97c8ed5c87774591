"""Whom a door on TCP lets in, and how much each may ask: the same for every door without authentication."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import TypeAlias

Networks: TypeAlias = tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...]


@dataclass(frozen=True, slots=True)
class CallerLimits:
    """What callers may take; with `allowed` None, every address may call."""

    callers: int = 256
    """So many at once."""
    idle_s: float = 300.0
    """One that was silent for so long is hung up on."""
    requests_per_s: float = 1000.0
    allowed: Networks | None = None

    def allow(self, address: str) -> bool:
        """Tell whether an address may call, or ask where we are."""
        if self.allowed is None:
            return True
        return any(ipaddress.ip_address(address) in network for network in self.allowed)

    def objection(self, address: str, already: int) -> str | None:
        """Return why an address may not call while there are so many callers already."""
        if not self.allow(address):
            return "it is not among those that --allow names"
        if already >= self.callers:
            return f"there are {already} clients already, as many as --clients allows"
        return None

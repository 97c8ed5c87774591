"""Requests and limits in words."""

from __future__ import annotations

from sattrack.mount.requests import (
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Slew,
    Sync,
    TrackingRate,
)
from sattrack.safety import ROWS
from sattrack.views.console_words import degrees, hours

_PLAIN: dict[type, str] = {Abort: "abort", Park: "park", FindHome: "home", EndMove: "end the move"}


def limit_words(name: str) -> str:
    """Return what a safety limit did, and which way out there is."""
    row = ROWS[name]
    return f"safety stopped the mount at its {row.name} limit ({row.watches}); to go on: {row.way_out}"


def request_words(request: Request) -> str:
    """Return a request in words, with its numbers."""
    match request:
        case Slew() | Sync():
            verb = "slew" if isinstance(request, Slew) else "sync"
            return f"{verb} to RA {hours(request.ra_deg / 15.0)} Dec {degrees(request.dec_deg)}"
        case MoveAxis():
            rates = (("RA", request.ra_rate_deg_s), ("Dec", request.dec_rate_deg_s))
            return "move " + " ".join(f"{axis} {rate:+g} °/s" for axis, rate in rates if rate is not None)
        case PulseGuide():
            return f"pulse RA {request.ra_ms:+d} ms Dec {request.dec_ms:+d} ms"
        case FineRate():
            return f"fine rate RA {request.ra_deg_s:+g} °/s Dec {request.dec_deg_s:+g} °/s"
        case TrackingRate():
            return f"tracking rate {request.rate}"
    return _PLAIN[type(request)]

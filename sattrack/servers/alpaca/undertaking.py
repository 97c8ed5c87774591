"""What an order begins: a procedure of the console's, and what is known of it until its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.manual.procedures import procedure_for
from sattrack.mount.requests import FindHome, FineRate, Park, PulseGuide, Slew, Sync
from sattrack.safety.geometry import altitude_deg
from sattrack.servers.alpaca.drive import SetTracking
from sattrack.servers.alpaca.faults import Fault, Number
from sattrack.servers.alpaca.messages import (
    FineOrder,
    HomeOrder,
    ParkOrder,
    PulseOrder,
    SlewOrder,
    SyncOrder,
    TrackOrder,
)

if TYPE_CHECKING:
    from sattrack.control.manual.procedures import Procedure, Refusal
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.datagrams import Status
    from sattrack.safety import SafetyLimits
    from sattrack.servers.alpaca.messages import Order


@dataclass(slots=True)
class Undertaking:
    """A procedure that an order began; `waiting` is the order that is answered at its end."""

    kind: str
    procedure: Procedure
    waiting: int | None = None


def procedure_of(  # noqa: PLR0911 - one for each kind of order
    order: Order, profile: MountProfile, fine: FineRate
) -> tuple[str, Procedure]:
    """Return how an order is carried out, and of which kind that is; `fine` are the rates in force.

    Raises TypeError for orders that are no procedure.
    """
    match order:
        case SlewOrder():
            return "slew", procedure_for(Slew(order.ra_deg, order.dec_deg), profile)
        case SyncOrder():
            return "sync", procedure_for(Sync(order.ra_deg, order.dec_deg), profile)
        case ParkOrder():
            return "park", procedure_for(Park(), profile)
        case HomeOrder():
            return "home", procedure_for(FindHome(), profile)
        case PulseOrder():
            return "pulse", procedure_for(PulseGuide(order.ra_ms, order.dec_ms), profile)
        case FineOrder():
            ra_deg_s = fine.ra_deg_s if order.ra_deg_s is None else order.ra_deg_s
            dec_deg_s = fine.dec_deg_s if order.dec_deg_s is None else order.dec_deg_s
            return "fine", procedure_for(FineRate(ra_deg_s, dec_deg_s), profile)
        case TrackOrder():
            return "tracking", SetTracking(order.on)
    raise TypeError(type(order))


def refuse(refusal: Refusal | None) -> None:
    """Raise Fault for a refusal of the console's."""
    if refusal is not None:
        raise Fault(Number.INVALID_OPERATION, refusal.words)


def check_floor(order: SlewOrder, status: Status | None, limits: SafetyLimits, latitude_deg: float) -> None:
    """Raise Fault for a direction so low that nothing that moves is to be stopped for it."""
    if status is None:
        return
    altitude = altitude_deg(status.sidereal_h * 15.0 - order.ra_deg, order.dec_deg, latitude_deg)
    if altitude < limits.floor_altitude_deg:
        words = f"that direction is at {altitude:.1f}° altitude; the limit is {limits.floor_altitude_deg:g}°"
        raise Fault(Number.INVALID_OPERATION, words)

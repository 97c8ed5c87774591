"""What can be asked of a mount one thing at a time, and how far each request has come.

Each request becomes a ticket. A ticket settles exactly once: complete, sent without a confirmation that the
protocol has none for, or not done and why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.model import MoveAxes, Slew

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile, Stance

NO_PARK = "the mount profile has no park position, and parking cuts the drives' power: add `park` to it"
PARKED_WITHIN_DEG = 0.5
BY_OWN_MODEL = (
    "the profile has a geometry, by which this program leads the mount: {} by the mount itself may turn both "
    "axes, and is not asked of it"
)
INT32 = range(-(2**31), 2**31)
LARGEST_FINE_RATE_DEG_S = 0.1
"""A fine rate adjusts the tracking; anything near an axis' own speeds is a slip of the unit."""


class Sync(msgspec.Struct, frozen=True, tag="sync", forbid_unknown_fields=True):
    """Make the mount report this direction of date for where it points."""

    ra_deg: float
    dec_deg: float


class Abort(msgspec.Struct, frozen=True, tag="abort", forbid_unknown_fields=True):
    """Bring both axes to rest."""


class FindHome(msgspec.Struct, frozen=True, tag="home", forbid_unknown_fields=True):
    """Go to the home position; the protocol has it as not used yet.

    `in_daylight` says that the path is free of the Sun where nobody but the operator can know.
    """

    in_daylight: bool = False


class Park(msgspec.Struct, frozen=True, tag="park", forbid_unknown_fields=True):
    """Cut the drives' power; only ever at standstill at the profile's park position."""


class PulseGuide(msgspec.Struct, frozen=True, tag="pulse"):
    """Run at the guide rate for so many milliseconds; negative is east, and south."""

    ra_ms: int = 0
    dec_ms: int = 0


class MoveAxis(msgspec.Struct, frozen=True):
    """Move one axis or both; None leaves an axis alone, rates as in `mount.MoveAxes`."""

    ra_rate_deg_s: float | None = None
    dec_rate_deg_s: float | None = None

    def after(self, before: MoveAxes) -> MoveAxes:
        """Return its rates, with those before it on an axis that it leaves alone."""
        ra, dec = self.ra_rate_deg_s, self.dec_rate_deg_s
        return MoveAxes(
            before.ra_rate_deg_s if ra is None else ra, before.dec_rate_deg_s if dec is None else dec
        )


class EndMove(msgspec.Struct, frozen=True):
    """End MoveAxis on both axes and go back to sidereal tracking."""


class FineRate(msgspec.Struct, frozen=True):
    """Adjust the tracking by so much, degrees of axis per second, from now on; zero takes it back.

    The protocol gives no sign: positive is taken to add to the tracking rate (westward), and to go north.
    """

    ra_deg_s: float = 0.0
    dec_deg_s: float = 0.0


class TrackingRate(msgspec.Struct, frozen=True):
    """Choose the enumerated tracking rate, 0 (sidereal) to 3; the protocol has it as not used yet."""

    rate: int = 0


Request = Slew | Sync | Abort | FindHome | Park | PulseGuide | MoveAxis | EndMove | FineRate | TrackingRate


BY_ITSELF: dict[type, str] = {
    Sync: "the profile has a geometry, which a sync would make wrong: sync with the mount's own program, "
    "then run `sattrack mount calibrate --axes`",
    FindHome: BY_OWN_MODEL.format("a way home"),
    PulseGuide: BY_OWN_MODEL.format("a guide pulse"),
    FineRate: BY_OWN_MODEL.format("a fine rate"),
    TrackingRate: BY_OWN_MODEL.format("a tracking rate"),
}
"""Why a mount with a geometry is not asked for something."""


class ClearedRequest(msgspec.Struct, frozen=True, gc=False):
    """A request that safety has let through: nothing else makes one."""

    request: Request


class TicketState(StrEnum):
    """How far a request has come; the last five are ends."""

    QUEUED = "queued"
    RAISED = "sent, not acknowledged yet"
    ACKNOWLEDGED = "acknowledged"
    COMPLETE = "complete"
    UNCONFIRMED = "sent, unconfirmed"
    TIMED_OUT = "timed out"
    SUPERSEDED = "superseded"
    FAILED = "failed"


_GIVEN_UP = frozenset({TicketState.TIMED_OUT, TicketState.SUPERSEDED, TicketState.FAILED})
SETTLED = _GIVEN_UP | {TicketState.COMPLETE, TicketState.UNCONFIRMED}
TICKET_TRANSITIONS = {
    TicketState.QUEUED: _GIVEN_UP | {TicketState.RAISED},
    TicketState.RAISED: SETTLED | {TicketState.ACKNOWLEDGED},
    TicketState.ACKNOWLEDGED: SETTLED,
}


@dataclass(slots=True)
class Ticket:
    """One request under way. `reason` says in words why it was not done, or what is not known."""

    request: Request
    state: TicketState = TicketState.QUEUED
    reason: str | None = None
    history: list[TicketState] = field(default_factory=lambda: [TicketState.QUEUED])

    @property
    def was_acknowledged(self) -> bool:
        """Whether the mount has acknowledged it."""
        return TicketState.ACKNOWLEDGED in self.history

    @property
    def settled(self) -> bool:
        """Whether it has come to an end."""
        return self.state in SETTLED

    def become(self, state: TicketState, reason: str | None = None) -> None:
        """Move on; raises ValueError for a step that the table does not have, as from any end."""
        if state not in TICKET_TRANSITIONS.get(self.state, frozenset()):
            raise ValueError(f"a request that is {self.state.value} cannot become {state.value}")
        self.state, self.reason = state, reason
        self.history.append(state)


def objection(request: Request, profile: MountProfile) -> str | None:
    """Return why a request cannot be one, naming field and value, or None where nothing speaks against it."""
    objected = None
    if profile.geometry is not None and type(request) in BY_ITSELF:
        return BY_ITSELF[type(request)]
    match request:
        case Slew() | Sync():
            objected = _direction_objection(request.ra_deg, request.dec_deg)
        case MoveAxis():
            objected = _move_objection(request, profile)
        case PulseGuide():
            objected = _pulse_objection(request)
        case FineRate():
            objected = _fine_rate_objection(request)
        case TrackingRate() if request.rate not in range(4):
            objected = f"tracking rate is {request.rate}; it is 0 (sidereal) to 3"
        case Park() if profile.park is None:
            objected = NO_PARK
    return objected


def _fine_rate_objection(request: FineRate) -> str | None:
    for axis, rate in (("right ascension", request.ra_deg_s), ("declination", request.dec_deg_s)):
        if not abs(rate) <= LARGEST_FINE_RATE_DEG_S:
            return f"fine rate in {axis} is {rate:g} °/s; at most {LARGEST_FINE_RATE_DEG_S:g} °/s"
    return None


def _direction_objection(ra_deg: float, dec_deg: float) -> str | None:
    if not 0.0 <= ra_deg < 360.0:
        return f"right ascension is {ra_deg:g}° ({ra_deg / 15.0:g} h); it runs from 0 to below 360° (24 h)"
    if not -90.0 <= dec_deg <= 90.0:
        return f"declination is {dec_deg:g}°; it runs from -90° to 90°"
    return None


def _move_objection(request: MoveAxis, profile: MountProfile) -> str | None:
    if request.ra_rate_deg_s is None and request.dec_rate_deg_s is None:
        return "no axis to move: give a rate in right ascension, in declination, or both"
    axes = (
        ("right ascension", request.ra_rate_deg_s, profile.ra.max_rate_deg_s),
        ("declination", request.dec_rate_deg_s, profile.dec.max_rate_deg_s),
    )
    for axis, rate, limit in axes:
        if rate is not None and not (math.isfinite(rate) and abs(rate) <= limit):
            return f"rate in {axis} is {rate:g} °/s; the mount profile's limit is {limit:g} °/s"
    return None


def _pulse_objection(request: PulseGuide) -> str | None:
    if request.ra_ms == 0 and request.dec_ms == 0:
        return "a pulse of 0 ms on both axes guides nothing"
    for axis, duration in (("right ascension", request.ra_ms), ("declination", request.dec_ms)):
        if duration not in INT32:
            return f"pulse in {axis} is {duration} ms; it must be a whole number of 32 bits"
    return None


def park_objection(profile: MountProfile, stance: Stance) -> str | None:
    """Return why the drives' power may not be cut as the mount stands, or None where it may."""
    park = profile.park
    if park is None:
        return NO_PARK
    hour_angle = math.remainder(stance.sidereal_deg - stance.ra_deg - park.hour_angle_deg, 360.0)
    # At the pole the hour angle says nothing of where the tube points, but the axis has its place.
    off = max(abs(hour_angle), abs(stance.dec_deg - park.dec_deg))
    if off > PARKED_WITHIN_DEG:
        return f"the mount stands {off:.2f}° away from its park position: slew there and stop first"
    if stance.slewing or not stance.drives_at_rest:
        return "the mount moves: parking cuts the drives' power, so stop it first"
    return None

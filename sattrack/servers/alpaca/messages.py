"""What goes between the process that clients talk to and the one that feeds the mount: JSON lines.

Orders go one way, each in an envelope with a number; states and answers come the other way. A state that
stands before an answer is one in which the order shows.
"""

from __future__ import annotations

import msgspec


class SlewOrder(msgspec.Struct, frozen=True, tag="slew"):
    """Go to a direction of date, degrees; with `wait`, the answer comes when the mount is there."""

    ra_deg: float
    dec_deg: float
    wait: bool = False


class SyncOrder(msgspec.Struct, frozen=True, tag="sync"):
    """Make the mount report this direction, degrees of date, for where it points."""

    ra_deg: float
    dec_deg: float


class AbortOrder(msgspec.Struct, frozen=True, tag="abort"):
    """Stop everything; where safety has stopped the mount, make it ready again once it is at rest."""


class ParkOrder(msgspec.Struct, frozen=True, tag="park"):
    """Go to the park position, stop there, cut the drives' power."""


class HomeOrder(msgspec.Struct, frozen=True, tag="home"):
    """Go to the home position."""


class PulseOrder(msgspec.Struct, frozen=True, tag="pulse"):
    """Run at the guide rate for so many milliseconds; negative is east, and south."""

    ra_ms: int = 0
    dec_ms: int = 0


class MoveOrder(msgspec.Struct, frozen=True, tag="move"):
    """Turn one axis (0 hour angle, 1 declination) at a rate of its own, degrees per second.

    Positive turns westward, and northward. 0 gives the axis back to what it did before.
    """

    axis: int
    rate_deg_s: float


class FineOrder(msgspec.Struct, frozen=True, tag="fine"):
    """Adjust the tracking: degrees per second, westward and northward; None leaves an axis as it is."""

    ra_deg_s: float | None = None
    dec_deg_s: float | None = None


class TrackOrder(msgspec.Struct, frozen=True, tag="track"):
    """Have a mount that does nothing else follow the sky, or stand."""

    on: bool


class FollowOrder(msgspec.Struct, frozen=True, tag="follow"):
    """Follow a satellite; `facts` are those of a run, as `runtime.facts` writes them."""

    facts: msgspec.Raw


class BiasOrder(msgspec.Struct, frozen=True, tag="bias"):
    """Offset the satellite that is followed: seconds along its track, degrees across it.

    None leaves an offset alone; `add` adds to what is in force.
    """

    along_s: float | None = None
    cross_deg: float | None = None
    add: bool = False


Order = (
    SlewOrder
    | SyncOrder
    | AbortOrder
    | ParkOrder
    | HomeOrder
    | PulseOrder
    | MoveOrder
    | FineOrder
    | TrackOrder
    | FollowOrder
    | BiasOrder
)


class Asked(msgspec.Struct, frozen=True, tag="asked"):
    """An order with the number by which it is answered."""

    number: int
    order: Order


class Told(msgspec.Struct, frozen=True, tag="told"):
    """A line for the log from the process that clients talk to."""

    words: str


class Answered(msgspec.Struct, frozen=True, tag="answered"):
    """What became of an order: `fault` is an error number, 0 where there was none."""

    number: int
    fault: int = 0
    words: str = ""


class FollowedState(msgspec.Struct, frozen=True):
    """A satellite that is followed; error in arcseconds on the sky, None before it is known."""

    name: str
    catalog_number: int
    phase: str
    along_s: float
    cross_deg: float
    error_arcsec: float | None
    acquired: bool


class TelescopeState(msgspec.Struct, frozen=True, tag="state"):
    """A mount at one instant, as clients may see it; None is what the mount does not tell.

    Degrees, hours where the name says so, UTC as POSIX seconds: `utc_s` is when it was told, `measured_utc_s`
    when the mount measured where it was. `ra_offset_deg_s` and `dec_offset_deg_s` are
    the fine rates in force, westward and northward.
    """

    utc_s: float
    heard: bool
    measured_utc_s: float = 0.0
    ra_h: float = 0.0
    dec_deg: float = 0.0
    altitude_deg: float | None = None
    azimuth_deg: float | None = None
    sidereal_h: float = 0.0
    site_latitude_deg: float | None = None
    site_longitude_deg: float | None = None
    site_height_m: float | None = None
    ra_guide_rate_deg_s: float | None = None
    dec_guide_rate_deg_s: float | None = None
    slewing: bool = False
    tracking: bool = False
    at_home: bool = False
    at_park: bool = False
    pulse_guiding: bool = False
    beyond_pole: bool = False
    does_refraction: bool = False
    ra_offset_deg_s: float = 0.0
    dec_offset_deg_s: float = 0.0
    doing: str = "idle"
    failure: str | None = None
    """Why the last slew, park, home or move came to a bad end; None once something else is asked for."""
    tripped: str | None = None
    following: FollowedState | None = None


_NEWS: msgspec.json.Decoder[TelescopeState | Answered] = msgspec.json.Decoder(TelescopeState | Answered)
_ASKED: msgspec.json.Decoder[Asked | Told] = msgspec.json.Decoder(Asked | Told)


def encode(message: Asked | Told | Answered | TelescopeState) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def decode_news(line: bytes) -> TelescopeState | Answered:
    """Return what the feeding process says in one line; raises msgspec.MsgspecError."""
    return _NEWS.decode(line)


def decode_asked(line: bytes) -> Asked | Told:
    """Return what the clients' process says in one line; raises msgspec.MsgspecError."""
    return _ASKED.decode(line)

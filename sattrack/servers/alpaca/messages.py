"""Messages between the process that clients talk to and the one that feeds the mount, and their faults.

Orders go one way, each in an envelope with a number; states and answers come the other way. A state that
stands before an answer already shows the order. A custom action has one text parameter: a JSON object or,
where it suffices, a name.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

ACTIONS = ("TrackSatellite", "Bias", "Passes")
MOST_HOURS = 48.0


class Number(IntEnum):
    """The error numbers that Alpaca reserves, "ASCOM Alpaca API Reference", ASCOM reserved error numbers."""

    OK = 0
    NOT_IMPLEMENTED = 0x400
    INVALID_VALUE = 0x401
    VALUE_NOT_SET = 0x402
    NOT_CONNECTED = 0x407
    PARKED = 0x408
    INVALID_OPERATION = 0x40B
    ACTION_NOT_IMPLEMENTED = 0x40C
    CANCELLED = 0x40E
    DRIVER = 0x500


class Fault(Exception):  # noqa: N818 - the protocol's own word is error number, not error
    """A request that the device answers with an error number; HTTP's own status is 200 all the same."""

    def __init__(self, number: Number, words: str) -> None:
        super().__init__(words)
        self.number = number
        self.words = words


class BadRequest(Exception):  # noqa: N818 - it is named after HTTP's own words
    """What cannot be read as a request: answered with an HTTP status and a line of text."""

    def __init__(self, words: str, status: int = 400) -> None:
        super().__init__(words)
        self.words = words
        self.status = status


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


class BiasOrder(msgspec.Struct, frozen=True, tag="bias", forbid_unknown_fields=True):
    """Offset the satellite that is followed: seconds along its track, degrees across it.

    None leaves an offset alone; `add` adds to what is in force. An action without offsets only asks for them.
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


class NumberedOrder(msgspec.Struct, frozen=True, tag="asked"):
    """An order with the number by which it is answered."""

    number: int
    order: Order


class LogLine(msgspec.Struct, frozen=True, tag="told"):
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

    Degrees, hours where the name says so, UTC as POSIX seconds: `utc_s` is when it was sent, `measured_utc_s`
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
_ASKED: msgspec.json.Decoder[NumberedOrder | LogLine] = msgspec.json.Decoder(NumberedOrder | LogLine)


def encode(message: NumberedOrder | LogLine | Answered | TelescopeState) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def decode_news(line: bytes) -> TelescopeState | Answered:
    """Return what the feeding process says in one line; raises msgspec.MsgspecError."""
    return _NEWS.decode(line)


def decode_order(line: bytes) -> NumberedOrder | LogLine:
    """Return what the clients' process says in one line; raises msgspec.MsgspecError."""
    return _ASKED.decode(line)


class TrackSatellite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Follow a satellite: the pass in progress above `min_alt_deg`, else the next."""

    satellite: str
    min_alt_deg: float | None = None


class Passes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """List a satellite's coming passes."""

    satellite: str
    hours: float = 24.0
    min_alt_deg: float | None = None


CustomAction = TrackSatellite | Passes | BiasOrder
_KINDS: dict[str, type[TrackSatellite] | type[Passes] | type[BiasOrder]] = {
    "tracksatellite": TrackSatellite,
    "passes": Passes,
    "bias": BiasOrder,
}


def read_action(name: str, parameters: str) -> CustomAction:
    """Return what an action asks for; its name may be of any case. Raises Fault."""
    kind = _KINDS.get(name.lower())
    if kind is None:
        raise Fault(Number.ACTION_NOT_IMPLEMENTED, f"no action {name[:40]!r}: there are {', '.join(ACTIONS)}")
    text = parameters.strip()
    try:
        if text.startswith("{") or (kind is BiasOrder and text):
            action: CustomAction = msgspec.json.decode(text, type=kind)
        else:
            action = BiasOrder() if kind is BiasOrder else msgspec.convert({"satellite": text}, kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise Fault(Number.INVALID_VALUE, f"{name}: {error}") from error
    _check(name, action)
    return action


def _check(name: str, action: CustomAction) -> None:
    if isinstance(action, BiasOrder):
        return
    if not action.satellite:
        raise Fault(Number.INVALID_VALUE, f"{name}: name a satellite, by name, number or designator")
    if action.min_alt_deg is not None and not 0.0 <= action.min_alt_deg < 90.0:
        raise Fault(Number.INVALID_VALUE, f"{name}: min_alt_deg is {action.min_alt_deg:g}; from 0 to 90")
    if isinstance(action, Passes) and not 0.0 < action.hours <= MOST_HOURS:
        raise Fault(
            Number.INVALID_VALUE, f"{name}: hours is {action.hours:g}; above 0, {MOST_HOURS:g} at most"
        )

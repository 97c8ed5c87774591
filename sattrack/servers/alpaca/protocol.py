"""The Alpaca protocol of a telescope: its members as a table, its errors, and the orders that come of it.

Sources: "ASCOM Alpaca Device API" for names and parameters, ITelescopeV4's own definition for meanings and
errors; "ASCOM Alpaca API Reference", Alpaca API contract, for requests: parameter names in a query may be of
any case, those in a form may not. A value that cannot be read is a bad request; one out of range is an
invalid value. A custom action has one text parameter: a JSON object or, where it suffices, a name.

Messages between the process that serves HTTP and the one that feeds the mount are JSON lines. Orders go one
way, each in an envelope with a number; states and answers come the other way. A state that is sent before an
answer already shows the order.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Literal
from urllib.parse import parse_qsl

import msgspec

from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, Park, PulseGuide, Sync

if TYPE_CHECKING:
    from collections.abc import Iterable


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
    """A request that the device answers with an error number; the HTTP status is 200."""

    def __init__(self, number: Number, message: str) -> None:
        super().__init__(message)
        self.number = number
        self.message = message


class BadRequest(Exception):  # noqa: N818 - HTTP's own term
    """A request that cannot be read: answered with an HTTP status and a line of text.

    `allow` are the methods that would be understood, where the method is what is wrong.
    """

    def __init__(self, message: str, status: int = 400, allow: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.status = status
        self.allow = allow


ValueKind = Literal["int", "float", "bool", "text"]
Value = int | float | bool | str
MOST_FIELDS = 64
LARGEST_ID = 2**32 - 1
LONGEST_QUOTED = 40
_ID = re.compile(r"[0-9]{1,10}")
_INT = re.compile(r"[+-]?[0-9]{1,18}")
_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
_WHAT = {"int": "a whole number", "float": "a number", "bool": "True or False", "text": "text"}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a member: its name, its kind and its bounds, both inclusive."""

    name: str
    kind: ValueKind
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def read(self, text: str) -> Value:
        """Return the value of a text; raises BadRequest where it has none."""
        value: Value | None = None
        if self.kind == "text":
            value = text
        elif self.kind == "bool":
            value = {"true": True, "false": False}.get(text.lower())
        elif self.kind == "int":
            value = int(text) if _INT.fullmatch(text) else None
        elif _FLOAT.fullmatch(text):
            value = float(text)
        if value is None or (isinstance(value, float) and not math.isfinite(value)):
            raise BadRequest(f"{self.name} is {text[:LONGEST_QUOTED]!r}: it must be {_WHAT[self.kind]}")
        return value

    def check(self, value: Value) -> None:
        """Raise Fault where a value is out of range."""
        if isinstance(value, str | bool) or self.low <= value <= self.high:
            return
        span = f"{self.low:g} or more" if self.high == math.inf else f"from {self.low:g} to {self.high:g}"
        raise Fault(Number.INVALID_VALUE, f"{self.name} is {value:g}; it must be {span}")


@dataclass(frozen=True, slots=True)
class Form:
    """The parameters of a request: names and values as they came, any case, any order."""

    pairs: tuple[tuple[str, str], ...]
    any_case: bool

    def all_of(self, name: str) -> list[str]:
        """Return every value of a name, by the rule for its case."""
        if self.any_case:
            wanted = name.lower()
            return [value for given, value in self.pairs if given.lower() == wanted]
        return [value for given, value in self.pairs if given == name]

    def one_of(self, name: str) -> str | None:
        """Return the value of a name, None where it has none; raises BadRequest where it has several."""
        values = self.all_of(name)
        if len(values) > 1:
            raise BadRequest(f"{name} is given {len(values)} times")
        return values[0] if values else None

    def id_of(self, name: str) -> int:
        """Return a client's number, 0 where it gives none. Raises BadRequest."""
        text = self.one_of(name)
        if text is None:
            return 0
        if not _ID.fullmatch(text) or int(text) > LARGEST_ID:
            raise BadRequest(f"{name} is {text[:LONGEST_QUOTED]!r}: it must be a whole number of 32 bits")
        return int(text)

    def values(self, parameters: Iterable[Parameter]) -> dict[str, Value]:
        """Return the values of parameters by name. Raises BadRequest where one is missing or unreadable."""
        found: dict[str, Value] = {}
        for parameter in parameters:
            if parameter.optional:
                # Some clients send a list of parameters as several of one name, and an empty one as none.
                found[parameter.name] = " ".join(self.all_of(parameter.name))
                continue
            text = self.one_of(parameter.name)
            if text is None:
                raise BadRequest(f"{parameter.name} is missing{self._near_miss(parameter.name)}")
            found[parameter.name] = parameter.read(text)
        return found

    def _near_miss(self, name: str) -> str:
        near = [given for given, _ in self.pairs if given.lower() == name.lower()]
        return f": {near[0][:LONGEST_QUOTED]} is not the same, case counts in a PUT" if near else ""


def read_form(data: bytes, any_case: bool) -> Form:
    """Return what a query, or a form, says. Raises BadRequest where it is neither."""
    try:
        pairs = parse_qsl(
            data.decode("ascii"),
            keep_blank_values=True,
            errors="strict",
            max_num_fields=MOST_FIELDS,
        )
    except ValueError as error:
        raise BadRequest(f"the parameters cannot be read: {_reason(error)}") from error
    return Form(tuple(pairs), any_case)


def _reason(error: ValueError) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "they are not percent-encoded UTF-8"
    return f"there are more than {MOST_FIELDS}"


Access = Literal["no", "yes", "absent"]
"""Whether a member has the request; absent: it has, but not on this mount, which answers 0x400."""
INTERFACE_VERSION = 4
DRIVE_RATES = (0, 3)
LONGEST_PULSE_MS = 2**31 - 1
RIGHT_ASCENSION = Parameter("RightAscension", "float", 0.0, 24.0)
DECLINATION = Parameter("Declination", "float", -90.0, 90.0)
AXIS = Parameter("Axis", "int", 0, 2)
COMMAND = (Parameter("Command", "text"), Parameter("Raw", "bool"))
ALT_AZ = (Parameter("Azimuth", "float"), Parameter("Altitude", "float"))


@dataclass(frozen=True, slots=True)
class Member:
    """One member. `takes` are the parameters of its GET if it has no PUT that works, else of its PUT."""

    name: str
    does: str
    read: Access = "no"
    write: Access = "no"
    takes: tuple[Parameter, ...] = ()
    connected: bool = True
    """Whether it is for connected clients alone."""
    heard: bool = False
    """Whether reading it needs a mount that is heard."""
    unparked: bool = False
    """Whether its PUT is refused while the mount is parked."""

    @property
    def path(self) -> str:
        """Its name in a path."""
        return self.name.lower()


def _reads(name: str, does: str, connected: bool = True) -> Member:
    return Member(name, does, read="yes", connected=connected)


def _reported(name: str, does: str) -> Member:
    return Member(name, does, read="yes", heard=True)


def _property(
    name: str,
    does: str,
    kind: ValueKind,
    span: tuple[float, float] = (-math.inf, math.inf),
    write: Access = "yes",
    heard: bool = False,
    unparked: bool = False,
) -> Member:
    takes = (Parameter(name, kind, *span),)
    return Member(name, does, "yes", write, takes, heard=heard, unparked=unparked)


def _lacks(name: str, does: str, takes: tuple[Parameter, ...], read: Access = "absent") -> Member:
    return Member(name, does, read=read, write="absent", takes=takes)


def _does(name: str, does: str, *takes: Parameter) -> Member:
    return Member(name, does, write="yes", takes=takes, unparked=True)


MEMBERS = (
    Member(
        "Action",
        "`TrackSatellite`, `Bias` or `Passes`, see below",
        write="yes",
        takes=(Parameter("Action", "text"), Parameter("Parameters", "text", optional=True)),
    ),
    Member("CommandBlind", "none: the mount has no text commands", write="absent", takes=COMMAND),
    Member("CommandBool", "none", write="absent", takes=COMMAND),
    Member("CommandString", "none", write="absent", takes=COMMAND),
    Member("Connect", "connects the client, at once", write="yes", connected=False),
    Member(
        "Connected",
        "whether this client is connected; the mount is held by the server, whoever is",
        read="yes",
        write="yes",
        takes=(Parameter("Connected", "bool"),),
        connected=False,
    ),
    _reads("Connecting", "false: connecting takes no time", connected=False),
    _reads("Description", "the program and the mount", connected=False),
    _reported("DeviceState", "everything below that changes, at one instant"),
    Member("Disconnect", "disconnects the client; what moves goes on", write="yes", connected=False),
    _reads("DriverInfo", "the program", connected=False),
    _reads("DriverVersion", "its version", connected=False),
    _reads("InterfaceVersion", f"{INTERFACE_VERSION}", connected=False),
    _reads("Name", "the profile's name", connected=False),
    _reads("SupportedActions", "the names of the actions", connected=False),
    _reads(
        "AlignmentMode",
        "by the profile: 0 (alt-azimuth) by its geometry, 2 (German) by its pier rule, else 1 (polar)",
    ),
    _reported("Altitude", "as the mount reports it, degrees"),
    Member("ApertureArea", "unknown", read="absent"),
    Member("ApertureDiameter", "unknown", read="absent"),
    _reported("AtHome", "whether it stands where `FindHome` brought it"),
    _reported("AtPark", "whether its drives' power was cut from here"),
    _reported("Azimuth", "as the mount reports it, degrees from north through east"),
    _reads("CanFindHome", "whether the profile has a home position"),
    _reads("CanPark", "whether the profile has a park position"),
    _reads("CanPulseGuide", "true; of an Alpaca telescope what its driver says"),
    _reads("CanSetDeclinationRate", "true; false of an Alpaca telescope"),
    _reads("CanSetGuideRates", "false: the protocol only reports them"),
    _reads("CanSetPark", "false: the profile says where it is"),
    _reads("CanSetPierSide", "false: no command chooses a side"),
    _reads("CanSetRightAscensionRate", "true; false of an Alpaca telescope"),
    _reads(
        "CanSetTracking", "true; false of an Alpaca telescope, which tracks after a stop as it did before"
    ),
    _reads("CanSlew", "true; of an Alpaca telescope what its driver says"),
    _reads("CanSlewAltAz", "false"),
    _reads("CanSlewAltAzAsync", "false"),
    _reads("CanSlewAsync", "true; of an Alpaca telescope what its driver says"),
    _reads("CanSync", "true; of an Alpaca telescope what its driver says"),
    _reads("CanSyncAltAz", "false"),
    _reads("CanUnpark", "false: a parked mount is woken at its own console"),
    _reported("Declination", "as reported, degrees of date"),
    _property(
        "DeclinationRate",
        "the fine rate in declination, arcseconds a second; AbortSlew ends it",
        "float",
        heard=True,
        unparked=True,
    ),
    _property("DoesRefraction", "as the mount reports it", "bool", write="absent", heard=True),
    _reads("EquatorialSystem", "1: equator and equinox of date"),
    Member("FocalLength", "unknown", read="absent"),
    _property(
        "GuideRateDeclination",
        "as the mount reports it, degrees a second",
        "float",
        write="absent",
        heard=True,
    ),
    _property(
        "GuideRateRightAscension",
        "as the mount reports it, degrees a second",
        "float",
        write="absent",
        heard=True,
    ),
    _reported("IsPulseGuiding", "whether a pulse is under way"),
    _reported("RightAscension", "as reported, hours of date"),
    _property(
        "RightAscensionRate",
        "the fine rate in right ascension, seconds of it a sidereal second; AbortSlew ends it",
        "float",
        heard=True,
        unparked=True,
    ),
    _property(
        "SideOfPier",
        "0, or 1 where the status says beyond the pole",
        "int",
        span=(0, 1),
        write="absent",
        heard=True,
    ),
    _reported("SiderealTime", "the mount's own clock, hours"),
    _lacks("SiteElevation", "the mount's, else the site's", (Parameter("SiteElevation", "float"),), "yes"),
    _lacks("SiteLatitude", "the mount's, else the site's", (Parameter("SiteLatitude", "float"),), "yes"),
    _lacks("SiteLongitude", "the mount's, else the site's", (Parameter("SiteLongitude", "float"),), "yes"),
    _reported("Slewing", "true in a slew, park, home or MoveAxis; an error where the last one failed"),
    _lacks("SlewSettleTime", "none", (Parameter("SlewSettleTime", "int"),)),
    _property("TargetDeclination", "what was set, or slewed or synced to last", "float", span=(-90.0, 90.0)),
    _property("TargetRightAscension", "what was set, or slewed or synced to last", "float", span=(0.0, 24.0)),
    _property(
        "Tracking",
        "whether the drive turns with the sky, or will after what moves it; false at rest after AbortSlew",
        "bool",
        heard=True,
    ),
    _property("TrackingRate", "0, sidereal; nothing else can be set", "int", span=(0, 0)),
    _reads("TrackingRates", "0 alone"),
    _property("UTCDate", "this computer's clock", "text", write="absent"),
    Member(
        "AxisRates",
        "the mount's own, else from 0, to the profile's limit; sidereal less on axis 0",
        read="yes",
        takes=(AXIS,),
    ),
    Member("CanMoveAxis", "true for axes 0 and 1", read="yes", takes=(AXIS,)),
    Member(
        "DestinationSideOfPier",
        "by the profile's pier rule",
        read="yes",
        takes=(RIGHT_ASCENSION, DECLINATION),
        heard=True,
    ),
    _does("AbortSlew", "stops everything; makes ready what safety stopped"),
    _does("FindHome", "goes to the profile's home position"),
    _does(
        "MoveAxis", "turns an axis; 0 gives it back to what it did before", AXIS, Parameter("Rate", "float")
    ),
    Member("Park", "slews to the park position, stops, cuts the drives' power", write="yes"),
    _does(
        "PulseGuide",
        "one pulse of each axis at a time; the second begins when the first has ended",
        Parameter("Direction", "int", 0, 3),
        Parameter("Duration", "int", 0, LONGEST_PULSE_MS),
    ),
    Member("SetPark", "none", write="absent"),
    Member("SlewToAltAz", "none", write="absent", takes=ALT_AZ),
    Member("SlewToAltAzAsync", "none", write="absent", takes=ALT_AZ),
    _does("SlewToCoordinates", "answered when the mount is there", RIGHT_ASCENSION, DECLINATION),
    _does("SlewToCoordinatesAsync", "answered when it is under way", RIGHT_ASCENSION, DECLINATION),
    _does("SlewToTarget", "the same, to the target"),
    _does("SlewToTargetAsync", "the same, to the target"),
    Member("SyncToAltAz", "none", write="absent", takes=ALT_AZ),
    _does("SyncToCoordinates", "makes the mount report this direction", RIGHT_ASCENSION, DECLINATION),
    _does("SyncToTarget", "the same, with the target"),
    Member("Unpark", "none", write="absent"),
)
BY_PATH = {member.path: member for member in MEMBERS}
ACTIONS = ("TrackSatellite", "Bias", "Passes")
MOST_HOURS = 48.0
GUIDING = "guiding"
MOVING_BY_RATES = "moving by MoveAxis"
"""What a telescope does whose axes turn at rates of their own."""


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


class TrackOrder(msgspec.Struct, frozen=True, tag="tracking"):
    """Make an idle mount follow the sky, or stand."""

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
    Slew
    | Sync
    | Abort
    | Park
    | FindHome
    | PulseGuide
    | MoveOrder
    | FineOrder
    | TrackOrder
    | FollowOrder
    | BiasOrder
)


class NumberedOrder(msgspec.Struct, frozen=True, tag="order"):
    """An order with the number by which it is answered; `waits` holds a slew's answer until its end."""

    number: int
    order: Order
    waits: bool = False


class LogMessage(msgspec.Struct, frozen=True, tag="log"):
    """A line for the log from the process that serves HTTP."""

    text: str


class Answered(msgspec.Struct, frozen=True, tag="answered"):
    """The outcome of an order: `fault` is an error number, 0 where there was none."""

    number: int
    fault: int = 0
    message: str = ""


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
    """A mount at one instant, as clients may see it; None is what the mount does not report.

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
    turning: tuple[int, ...] = ()
    """The axes that MoveAxis turns."""
    failure: str | None = None
    """Why the last slew, park, home or move failed; None once something else is requested."""
    tripped: str | None = None
    following: FollowedState | None = None


_REPORTS: msgspec.json.Decoder[TelescopeState | Answered] = msgspec.json.Decoder(TelescopeState | Answered)
_ORDERS: msgspec.json.Decoder[NumberedOrder | LogMessage] = msgspec.json.Decoder(NumberedOrder | LogMessage)


def encode(message: NumberedOrder | LogMessage | Answered | TelescopeState) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def decode_report(line: bytes) -> TelescopeState | Answered:
    """Return one line of the feeding process; raises msgspec.MsgspecError."""
    return _REPORTS.decode(line)


def decode_order(line: bytes) -> NumberedOrder | LogMessage:
    """Return one line of the HTTP process; raises msgspec.MsgspecError."""
    return _ORDERS.decode(line)


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
    """Return the request of an action; its name may be of any case. Raises Fault."""
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

"""Every member of ITelescopeV4, as a table: its parameters, what it needs, and what it does here.

Sources: "ASCOM Alpaca Device API" for names and parameters, ITelescopeV4's own definition for meanings and
errors; "ASCOM Alpaca API Reference", Alpaca API contract, for requests: parameter names in a query may be of
any case, those in a form may not. A value that cannot be read is a bad request; one out of range is an
invalid value.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from urllib.parse import parse_qsl

from sattrack.servers.alpaca.messages import BadRequest, Fault, Number

if TYPE_CHECKING:
    from collections.abc import Iterable

Kind = Literal["int", "float", "bool", "text"]
Value = int | float | bool | str
MOST_FIELDS = 64
LARGEST_ID = 2**32 - 1
LONGEST_TOLD = 40
_ID = re.compile(r"[0-9]{1,10}")
_INT = re.compile(r"[+-]?[0-9]{1,18}")
_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
_WHAT = {"int": "a whole number", "float": "a number", "bool": "True or False", "text": "text"}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a member: what it is called, what it is, and between which bounds, both inclusive."""

    name: str
    kind: Kind
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def read(self, text: str) -> Value:
        """Return the value that a text says; raises BadRequest where it says none."""
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
            raise BadRequest(f"{self.name} is {text[:LONGEST_TOLD]!r}: it must be {_WHAT[self.kind]}")
        return value

    def check(self, value: Value) -> None:
        """Raise Fault where a value is out of range."""
        if isinstance(value, str | bool) or self.low <= value <= self.high:
            return
        span = f"{self.low:g} or more" if self.high == math.inf else f"from {self.low:g} to {self.high:g}"
        raise Fault(Number.INVALID_VALUE, f"{self.name} is {value:g}; it must be {span}")


@dataclass(frozen=True, slots=True)
class Form:
    """What a request says beside its path: names and values as they came, any case, any order."""

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
            raise BadRequest(f"{name} is {text[:LONGEST_TOLD]!r}: it must be a whole number of 32 bits")
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
        return f": {near[0][:LONGEST_TOLD]} is not the same, case counts in a PUT" if near else ""


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
"""Whether there is such a request, and whether this mount has what it asks for: absent is 0x400."""
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


def _tells(name: str, does: str) -> Member:
    return Member(name, does, read="yes", heard=True)


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
    _tells("DeviceState", "everything below that changes, at one instant"),
    Member("Disconnect", "disconnects the client; what moves goes on", write="yes", connected=False),
    _reads("DriverInfo", "the program", connected=False),
    _reads("DriverVersion", "its version", connected=False),
    _reads("InterfaceVersion", f"{INTERFACE_VERSION}", connected=False),
    _reads("Name", "the profile's name", connected=False),
    _reads("SupportedActions", "the names of the actions", connected=False),
    _reads("AlignmentMode", "2 (German) where the profile's pier rule is `hour_angle`, else 1 (polar)"),
    _tells("Altitude", "as the mount reports it, degrees"),
    Member("ApertureArea", "unknown", read="absent"),
    Member("ApertureDiameter", "unknown", read="absent"),
    _tells("AtHome", "whether it stands where `FindHome` brought it"),
    _tells("AtPark", "whether its drives' power was cut from here"),
    _tells("Azimuth", "as the mount reports it, degrees from north through east"),
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
    _tells("Declination", "as reported, degrees of date"),
    Member(
        "DeclinationRate",
        "the fine rate in declination, arcseconds a second; AbortSlew ends it",
        read="yes",
        write="yes",
        takes=(Parameter("DeclinationRate", "float"),),
        heard=True,
        unparked=True,
    ),
    Member(
        "DoesRefraction",
        "as the mount reports it",
        read="yes",
        write="absent",
        takes=(Parameter("DoesRefraction", "bool"),),
        heard=True,
    ),
    _reads("EquatorialSystem", "1: equator and equinox of date"),
    Member("FocalLength", "unknown", read="absent"),
    Member(
        "GuideRateDeclination",
        "as the mount reports it, degrees a second",
        read="yes",
        write="absent",
        takes=(Parameter("GuideRateDeclination", "float"),),
        heard=True,
    ),
    Member(
        "GuideRateRightAscension",
        "as the mount reports it, degrees a second",
        read="yes",
        write="absent",
        takes=(Parameter("GuideRateRightAscension", "float"),),
        heard=True,
    ),
    _tells("IsPulseGuiding", "whether a pulse is under way"),
    _tells("RightAscension", "as reported, hours of date"),
    Member(
        "RightAscensionRate",
        "the fine rate in right ascension, seconds of it a sidereal second; AbortSlew ends it",
        read="yes",
        write="yes",
        takes=(Parameter("RightAscensionRate", "float"),),
        heard=True,
        unparked=True,
    ),
    Member(
        "SideOfPier",
        "0, or 1 where the status says beyond the pole",
        read="yes",
        write="absent",
        takes=(Parameter("SideOfPier", "int", 0, 1),),
        heard=True,
    ),
    _tells("SiderealTime", "the mount's own clock, hours"),
    _lacks("SiteElevation", "the mount's, else the site's", (Parameter("SiteElevation", "float"),), "yes"),
    _lacks("SiteLatitude", "the mount's, else the site's", (Parameter("SiteLatitude", "float"),), "yes"),
    _lacks("SiteLongitude", "the mount's, else the site's", (Parameter("SiteLongitude", "float"),), "yes"),
    _tells("Slewing", "true in a slew, park, home or MoveAxis; an error where the last one failed"),
    _lacks("SlewSettleTime", "none", (Parameter("SlewSettleTime", "int"),)),
    Member(
        "TargetDeclination",
        "what was set, or slewed or synced to last",
        read="yes",
        write="yes",
        takes=(Parameter("TargetDeclination", "float", -90.0, 90.0),),
    ),
    Member(
        "TargetRightAscension",
        "what was set, or slewed or synced to last",
        read="yes",
        write="yes",
        takes=(Parameter("TargetRightAscension", "float", 0.0, 24.0),),
    ),
    Member(
        "Tracking",
        "whether the drive turns with the sky, or will after what moves it; false at rest after AbortSlew",
        read="yes",
        write="yes",
        takes=(Parameter("Tracking", "bool"),),
        heard=True,
    ),
    Member(
        "TrackingRate",
        "0, sidereal; nothing else can be set",
        read="yes",
        write="yes",
        takes=(Parameter("TrackingRate", "int", 0, 0),),
    ),
    _reads("TrackingRates", "0 alone"),
    Member(
        "UTCDate",
        "this computer's clock",
        read="yes",
        write="absent",
        takes=(Parameter("UTCDate", "text"),),
    ),
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
    _does("MoveAxis", "turns an axis; 0 gives it back to the sky", AXIS, Parameter("Rate", "float")),
    Member("Park", "slews to the park position, stops, cuts the drives' power", write="yes"),
    _does(
        "PulseGuide",
        "one pulse at a time: the mount has one command for both axes",
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

"""ConformU's checks of the Alpaca protocol: its requests of a telescope, by its names, and its judgement.

ConformU (ASCOM Initiative, as of June 2026) sends each member good and bad requests. It judges tolerantly,
unless it is set to be strict; both judgements are here. `http.client` sends.
"""

from __future__ import annotations

import http.client
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlencode

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Fields = tuple[tuple[str, str], ...]
CLIENT, TRANSACTION = ("ClientID", "123456"), ("ClientTransactionID", "67890")
GOOD: Fields = (CLIENT, TRANSACTION)
UNREADABLE = "asduio6fghZZ"
OK, BAD = frozenset({200}), frozenset({400})
REJECTED = frozenset({400, 401, 402, 403, 404, 405, 406, 407, 409, 410})
ANY: frozenset[int] = frozenset()
NOT_IMPLEMENTED, INVALID_VALUE = 0x400, 0x401
BAD_IDS: tuple[tuple[str, Fields], ...] = (
    ("ClientID is empty", (("ClientID", ""), TRANSACTION)),
    ("ClientID is white space", (("ClientID", "     "), TRANSACTION)),
    ("ClientID is negative", (("ClientID", "-12345"), TRANSACTION)),
    ("ClientID is not numeric", (("ClientID", "NASDAQ"), TRANSACTION)),
    ("ClientTransactionID is empty", (CLIENT, ("ClientTransactionID", ""))),
    ("ClientTransactionID is white space", (CLIENT, ("ClientTransactionID", "     "))),
    ("ClientTransactionID is negative", (CLIENT, ("ClientTransactionID", "-67890"))),
    ("ClientTransactionID is a string", (CLIENT, ("ClientTransactionID", "qweqwe"))),
)
OTHER_CASES: tuple[tuple[str, Fields], ...] = (
    ("ClientID casing", (("clientid", "123456"), TRANSACTION)),
    ("ClientTransactionID casing", (CLIENT, ("clienttransactionid", "67890"))),
)
COMMON = (
    "Connected",
    "Description",
    "DriverInfo",
    "DriverVersion",
    "InterfaceVersion",
    "Name",
    "SupportedActions",
    "DeviceState",
    "Connecting",
)
READ = (
    *("AlignmentMode", "Altitude", "ApertureArea", "ApertureDiameter", "AtHome", "AtPark", "Azimuth"),
    *(
        "CanPark",
        "CanPulseGuide",
        "CanSetDeclinationRate",
        "CanSetGuideRates",
        "CanSetPark",
        "CanSetPierSide",
    ),
    *(
        "CanSetTracking",
        "CanSlew",
        "CanSlewAltAz",
        "CanSlewAltAzAsync",
        "CanSync",
        "CanSyncAltAz",
        "CanUnpark",
    ),
    *("Declination", "DeclinationRate", "DoesRefraction", "EquatorialSystem", "FocalLength"),
    *("GuideRateDeclination", "GuideRateRightAscension", "IsPulseGuiding", "RightAscension"),
    *("RightAscensionRate", "SideOfPier", "SiderealTime", "SiteElevation", "SiteLatitude", "SiteLongitude"),
    *("Slewing", "SlewSettleTime", "TargetDeclination", "TargetRightAscension", "Tracking", "TrackingRate"),
    *("TrackingRates", "UTCDate"),
)
WRITTEN = {
    "DeclinationRate": "0.0",
    "DoesRefraction": "false",
    "GuideRateDeclination": "0.0",
    "GuideRateRightAscension": "0.0",
    "RightAscensionRate": "0.0",
    "SideOfPier": "0",
    "SiteElevation": "0.0",
    "SiteLatitude": "0.0",
    "SiteLongitude": "0.0",
    "SlewSettleTime": "0",
    "TargetDeclination": "0.0",
    "TargetRightAscension": "0.0",
    "Tracking": "false",
    "TrackingRate": "0",
    "UTCDate": "2022-12-04T17:45:31.1234567Z",
}
"""What is written where the property cannot be read; otherwise what it holds."""
PLACE = ("RightAscension", "Declination")
HORIZONTAL = ("Azimuth", "Altitude")
METHODS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("AbortSlew", (), ()),
    ("MoveAxis", ("Axis", "Rate"), ("0", "0.0")),
    ("PulseGuide", ("Direction", "Duration"), ("0", "0")),
    ("SlewToCoordinatesAsync", PLACE, ("21.0", "70")),
    ("SlewToCoordinates", PLACE, ("12.0", "80")),
    ("SlewToTargetAsync", (), ()),
    ("SlewToTarget", (), ()),
    ("SyncToCoordinates", PLACE, ("45", "45")),
    ("SyncToTarget", (), ()),
    ("SlewToAltAzAsync", HORIZONTAL, ("60", "60")),
    ("SlewToAltAz", HORIZONTAL, ("45", "45")),
    ("SyncToAltAz", HORIZONTAL, ("45", "45")),
    ("FindHome", (), ()),
    ("SetPark", (), ()),
    ("Unpark", (), ()),
    ("Disconnect", (), ()),
    ("Connect", (), ()),
    ("Park", (), ()),
)
"""What is called, in this order: a parked mount cannot be unparked, so that Park comes last."""


@dataclass(frozen=True, slots=True)
class Request:
    """A request: ConformU's names of the test and of it, what is sent, and the statuses that it wants."""

    test: str
    name: str
    verb: str
    path: str
    fields: Fields = GOOD
    wanted: frozenset[int] = OK
    wanted_if_strict: frozenset[int] | None = None
    invalid_value_will_do: bool = False

    @property
    def sent_transaction(self) -> int:
        """The transaction number that the answer must carry."""
        name, text = next((one for one in self.fields if one[0].lower() == "clienttransactionid"), ("", ""))
        counts = self.verb == "GET" or name == "ClientTransactionID"
        return int(text) if counts and text.isdigit() else 0


def member(verb: str, name: str, what: str, **more: Any) -> Request:
    """Return a request of a member."""
    return Request(f"{verb} {name}", what, verb, f"/api/v1/telescope/0/{name.lower()}", **more)


def addresses() -> Iterator[Request]:
    """Give the requests with a wrong address, verb or value of Connected."""
    for what, base in (
        ("base element (api = apx)", "/apx/v1/telescope/0"),
        ("version element (no v)", "/api/1/telescope/0"),
        ("version element (no number)", "/api/v/telescope/0"),
        ("version element (capital V)", "/api/V1/telescope/0"),
        ("version element (v2)", "/api/v2/telescope/0"),
    ):
        yield Request("GET Description", f"Bad Alpaca URL {what}", "GET", f"{base}/description", wanted=ANY)
    for verb in ("POST", "DELETE"):
        for what, value in (("True", "True"), ("Value empty", ""), ("Number", "123456")):
            yield member(verb, "Connected", what, fields=(*GOOD, ("Connected", value)), wanted=ANY)
    for what, path in (
        ("device type (capitalised TELESCOPE)", "TELESCOPE/0/description"),
        ("device type (baddevicetype)", "baddevicetype/0/description"),
        ("device number (-1)", "telescope/-1/description"),
        ("device number (99999)", "telescope/99999/description"),
        ("device number (A)", "telescope/A/description"),
        ("method name (descrip)", "telescope/0/descrip"),
    ):
        yield Request("GET Description", f"Bad Alpaca URL {what}", "GET", f"/api/v1/{path}", wanted=REJECTED)
    for what, value in (("Empty string", ""), ("Number", "123456"), ("Meaningless string", "asdqwe")):
        yield member(
            "PUT",
            "Connected",
            f"Bad parameter value - {what}",
            fields=(*GOOD, ("Connected", value)),
            wanted=BAD,
            invalid_value_will_do=True,
        )


def variations(
    verb: str, name: str, names: tuple[str, ...] = (), values: tuple[str, ...] = ()
) -> list[Request]:
    """Return the good and bad requests of a member whose parameters are given."""
    given = tuple(zip(names, values, strict=True))
    called = " and ".join(names) or "ClientID and ClientTransactionID"
    found = [
        member(verb, name, f"{called} (Good casing)", fields=(*GOOD, *given)),
        member(
            verb,
            name,
            f"{called} (Good casing + extra parameter)",
            fields=(*GOOD, ("ExtraParameter", "x"), *given),
        ),
    ]
    for place, one in enumerate(names):
        unread = (*given[:place], (one, UNREADABLE), *given[place + 1 :])
        other_case = (*given[:place], (one.swapcase(), values[place]), *given[place + 1 :])
        found += [
            member(
                verb,
                name,
                f"{one} (Bad value)",
                fields=(*GOOD, *unread),
                wanted=BAD,
                invalid_value_will_do=True,
            ),
            member(
                verb,
                name,
                f"{one} (Bad casing)",
                fields=(*GOOD, *other_case),
                wanted=BAD if verb == "PUT" else OK,
            ),
        ]
    found += [member(verb, name, f"Different {what}", fields=(*ids, *given)) for what, ids in OTHER_CASES]
    found += [
        member(
            verb,
            name,
            what,
            fields=(*ids, *given),
            wanted=OK | BAD,
            wanted_if_strict=BAD,
            invalid_value_will_do=True,
        )
        for what, ids in BAD_IDS
    ]
    return found


class Client:
    """One connection, whose requests are judged."""

    def __init__(self, port: int) -> None:
        self._port = port

    def ask(self, request: Request) -> tuple[int, bytes]:
        """Return the status and the body of the answer."""
        # One connection for each: a wrong verb may end it.
        line = http.client.HTTPConnection("127.0.0.1", self._port, timeout=120.0)
        words = urlencode(request.fields, quote_via=quote)
        if request.verb == "GET":
            line.request("GET", f"{request.path}?{words}")
        else:
            kind = {"Content-Type": "application/x-www-form-urlencoded"}
            line.request(request.verb, request.path, words, kind)
        answer = line.getresponse()
        status, body = answer.status, answer.read()
        line.close()
        return status, body

    def value(self, name: str) -> Any:
        """Return a member's value, None where it has none."""
        return json.loads(self.ask(member("GET", name, ""))[1]).get("Value")


def objections(request: Request, status: int, body: bytes, strict: bool) -> list[str]:
    """Return what ConformU would call an issue of an answer."""
    wanted = request.wanted_if_strict if strict and request.wanted_if_strict else request.wanted
    told: dict[str, Any] = json.loads(body) if status == 200 else {}
    found = _of_the_answer(request, told, strict) if status == 200 else []
    if not wanted or status in wanted:
        return found
    number = told.get("ErrorNumber")
    if request.invalid_value_will_do and number == INVALID_VALUE:
        return found
    if not strict and number == NOT_IMPLEMENTED and wanted == BAD:
        return found
    return [*found, f"HTTP status {status}"]


def _of_the_answer(request: Request, told: dict[str, Any], strict: bool) -> list[str]:
    names = ("ClientTransactionID", "ServerTransactionID", "ErrorNumber", "ErrorMessage")
    found = [f"no {name}" for name in names if name not in told]
    if request.verb == "GET" and "Value" not in told and (strict or not told["ErrorNumber"]):
        found.append("no Value beside an error number")
    if told.get("ClientTransactionID") != request.sent_transaction:
        found.append(f"transaction {told.get('ClientTransactionID')}")
    if not told.get("ServerTransactionID", 0) >= 1:
        found.append("no number of the server's")
    for item in told.get("Value", ()) if request.test in {"GET AxisRates", "GET DeviceState"} else ():
        parts = {"Minimum", "Maximum"} if request.test == "GET AxisRates" else {"Name", "Value"}
        found += [f"{part} is missing in an item" for part in parts - set(item)]
    return found


def all_requests(client: Client, members: Iterable[str] | None = None) -> Iterator[Request]:
    """Give every request; values of what can be read are asked for when its turn comes."""
    chosen = set(members) if members is not None else None

    def takes_part(name: str) -> bool:
        return chosen is None or name in chosen

    if takes_part("Description"):
        yield from addresses()
    for name in (*COMMON, *READ):
        if takes_part(name):
            yield from variations("GET", name)
    for name, otherwise in WRITTEN.items():
        if takes_part(name):
            value = client.value(name)
            text = otherwise if value is None else str(value)
            yield from variations("PUT", name, (name,), (text,))
    yield member("PUT", "Tracking", "True", fields=(*GOOD, ("Tracking", "True")))
    if takes_part("AxisRates"):
        yield from variations("GET", "AxisRates", ("Axis",), ("0",))
        yield from variations("GET", "CanMoveAxis", ("Axis",), ("0",))
        yield from variations("GET", "DestinationSideOfPier", PLACE, ("21.0", "70"))
    for name, names, values in METHODS:
        if takes_part(name):
            here = [client.value(one) for one in names] if names in {PLACE, HORIZONTAL} else [None]
            texts = values if None in here else tuple(str(one) for one in here)
            yield from variations("PUT", name, names, texts)

"""The telescope that Alpaca's clients see: requests in, answers and orders out, without I/O.

Values come from the mount's last state, orders from requests. Clients share the target. Instants are UTC as
POSIX seconds. Source: "ASCOM Alpaca API Reference": paths, transaction numbers, HTTP statuses, the management
interface.
"""

from __future__ import annotations

import math
import re
import uuid
from collections import OrderedDict
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import UNHEARD
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Slew, beyond_after_slew
from sattrack.mount.requests import LARGEST_FINE_RATE_DEG_S, Abort, FindHome, Park, PulseGuide, Sync
from sattrack.servers.alpaca.protocol import (
    ACTIONS,
    BY_PATH,
    DRIVE_RATES,
    GUIDING,
    INTERFACE_VERSION,
    LARGEST_ID,
    BadRequest,
    Fault,
    FineOrder,
    Form,
    MoveOrder,
    Number,
    Passes,
    TrackOrder,
    TrackSatellite,
    read_action,
    read_form,
)
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sattrack.mount.model import MountProfile
    from sattrack.servers.alpaca.protocol import CustomAction, Member, Order, TelescopeState, Value
    from tle.site import Site

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="5"><title>{title}</title>
<style>body{{font:16px sans-serif;margin:2em;max-width:44em}}th{{text-align:left;padding-right:2em}}</style>
</head><body><h1>{title}</h1>
<table>{rows}</table>
<p>Nothing is set here. The mount, its profile, the site, the safety limits and the elements of satellites are
set by the options of <code>sattrack serve alpaca</code> and by <code>sattrack.toml</code>; see
<code>sattrack serve alpaca --help</code>.</p>
<p>The protocol has no authentication: whoever reaches this port moves the mount.</p>
</body></html>
"""
JSON, TEXT, HTML = "application/json", "text/plain", "text/html"
DEVICE = "/api/v1/telescope/0/"
NOTHING = object()
"""The answer of a PUT without a value."""
_MEMBER = re.compile(r"[a-z]{1,40}")
Spans = tuple[tuple[float, float], ...]
MAKER = "sattrack"
ALT_AZ, POLAR, GERMAN = 0, 1, 2
ANY_RATE: Spans = ((0.0, 360.0),)
FINE_RATES = frozenset({"RightAscensionRate", "DeclinationRate"})
SIDEREAL_A_SECOND = 86400.0 / 86164.0905
"""Sidereal seconds in one of UTC."""
DEG_A_TIME_SECOND = 15.0 / 3600.0
TOPOCENTRIC = 1
CHANGING = (
    "Altitude",
    "AtHome",
    "AtPark",
    "Azimuth",
    "Declination",
    "IsPulseGuiding",
    "RightAscension",
    "SideOfPier",
    "SiderealTime",
    "Slewing",
    "Tracking",
)
"""The members of DeviceState by ITelescopeV4's definition, beside the instant."""
MOST_CONNECTED = 4096
NORTH, SOUTH, EAST, WEST = range(4)
OLDEST_STATE_S = 2.5
"""An older state is not used."""


class Abilities(msgspec.Struct, frozen=True):
    """The optional abilities of a mount."""

    slews: bool = True
    syncs: bool = True
    guides: bool = True
    guide_rates: bool = True
    """Whether it reports guide rates."""
    fine_rates: bool = True
    sets_tracking: bool = True
    axis_rates_deg_s: tuple[Spans, Spans] = (ANY_RATE, ANY_RATE)
    """The rates that each axis supports, the lowest and the highest of each range, degrees per second."""

    def lack(self, member: str) -> str | None:
        """Return the ability that a member of ITelescopeV4 needs and the mount lacks, as text, or None."""
        if member in FINE_RATES:
            return None if self.fine_rates else "no offset rates"
        if member in {"PulseGuide", "IsPulseGuiding"}:
            return None if self.guides else "no guide pulses"
        if member.startswith("GuideRate"):
            return None if self.guide_rates else "no guide rates to report"
        if member.startswith("SlewTo"):
            return None if self.slews else "no slews"
        return "no sync" if member.startswith("SyncTo") and not self.syncs else None


@dataclass(frozen=True, slots=True)
class Device:
    """One telescope: its mount's profile, where it stands, and its identity."""

    profile: MountProfile
    site: Site
    mount: str
    """The mount's address as text."""
    version: str
    host: str
    """Name of the computer that serves it."""
    abilities: Abilities = Abilities()  # noqa: RUF009 - frozen

    @property
    def name(self) -> str:
        """See Name of ITelescopeV4."""
        return f"{MAKER}: {self.profile.name}"

    @property
    def description(self) -> str:
        """See Description."""
        return f"mount {self.profile.name} at {self.mount}, driven by {MAKER}"

    @property
    def info(self) -> str:
        """See DriverInfo."""
        protocols = {"alpaca": "ASCOM Alpaca", "indi": "INDI"}
        protocol = protocols.get(self.mount.partition(":")[0], "Xerxes mount control protocol")
        return f"{MAKER} {self.version}, {protocol}"

    @property
    def unique_id(self) -> str:
        """A number that no other telescope has, and that stays the same."""
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"{MAKER}:{self.host}:{self.mount}"))

    @property
    def alignment(self) -> int:
        """See AlignmentMode: only a mount that changes pier sides is a German one."""
        geometry = self.profile.geometry
        if geometry is not None:
            return ALT_AZ if geometry.kind == "alt-azimuth" else POLAR
        return POLAR if self.profile.pier_rule == "never" else GERMAN

    def max_rate_deg_s(self, axis: int) -> float:
        """Return the highest rate that clients may command; 0 for an axis that does not exist.

        The hour angle axis' rate replaces the sidereal one, to which the mount adds MoveAxis.
        """
        if axis == 0:
            return max(0.0, self.profile.ra.max_rate_deg_s - SIDEREAL_RATE_DEG_S)
        return self.profile.dec.max_rate_deg_s if axis == 1 else 0.0

    def axis_rates_deg_s(self, axis: int) -> Spans:
        """Return the ranges of rates that clients may command; none for an axis that does not exist."""
        most = self.max_rate_deg_s(axis)
        if most == 0.0:
            return ()
        spans = self.abilities.axis_rates_deg_s[axis]
        return tuple((low, min(high, most)) for low, high in spans if low < most)

    def destination_side(self, hour_angle_deg: float) -> int:
        """Return on which side of the pier a slew to an hour angle (±180) ends: 1 is beyond the pole."""
        return int(beyond_after_slew(self.profile.pier_rule, hour_angle_deg))


@dataclass(frozen=True, slots=True)
class Reply:
    """An HTTP answer; `allow` is its Allow header, none where that is empty."""

    status: int
    kind: str
    body: bytes
    allow: str = ""


@dataclass(frozen=True, slots=True)
class Transaction:
    """One request's numbers: the client's, 0 where it gave none, and the server's own."""

    client: int
    theirs: int
    ours: int


@dataclass(frozen=True, slots=True)
class Pending:
    """A request that is answered when its order is carried out; `Server.finish` makes the answer."""

    order: Order | CustomAction
    transaction: Transaction
    waits: bool = False
    """Whether it is a slew that is answered at its end."""


class Server:
    """An Alpaca device with one telescope, number 0; `place` is its site as text."""

    def __init__(self, telescope: ServedTelescope, place: str) -> None:
        self.telescope = telescope
        self._place = place
        self._count = 0

    def answer(self, method: str, path: str, query: bytes, body: bytes, now_utc_s: float) -> Reply | Pending:
        """Return the answer to a request, or the order that it waits for."""
        try:
            if method not in ("GET", "PUT"):
                allow = "GET, PUT" if path.startswith("/api/") else "GET"
                raise BadRequest(f"{method[:10]} is not used here, only {allow}", 405, allow)
            if path.startswith("/api/"):
                return self._device(method, path, query, body, now_utc_s)
            if path.startswith("/management/"):
                return self._management(method, path, query)
            return self._page(method, path, now_utc_s)
        except BadRequest as bad:
            return Reply(bad.status, TEXT, bad.message.encode("utf-8", "replace") + b"\n", bad.allow)

    def finish(self, pending: Pending, value: Any = NOTHING, fault: Fault | None = None) -> Reply:
        """Return the answer to a request that had to wait."""
        return _json(pending.transaction, value, fault)

    def _device(self, method: str, path: str, query: bytes, body: bytes, now_utc_s: float) -> Reply | Pending:
        member = path.removeprefix(DEVICE)
        if member == path or not _MEMBER.fullmatch(member):
            raise BadRequest(f"no such device or member: paths begin with {DEVICE}, in lower case")
        form = read_form(query, any_case=True) if method == "GET" else read_form(body, any_case=False)
        transaction = self._begin(form)
        telescope = self.telescope
        try:
            if method == "GET":
                value = telescope.get(member, form, transaction.client, now_utc_s)
                return _json(transaction, value)
            order = telescope.put(member, form, transaction.client, now_utc_s)
        except Fault as fault:
            return _json(transaction, fault=fault)
        if order is None:
            return _json(transaction)
        return Pending(order, transaction, isinstance(order, Slew) and not member.endswith("async"))

    def _begin(self, form: Form) -> Transaction:
        client, theirs = form.id_of("ClientID"), form.id_of("ClientTransactionID")
        self._count = self._count % LARGEST_ID + 1
        return Transaction(client, theirs, self._count)

    def _management(self, method: str, path: str, query: bytes) -> Reply:
        device = self.telescope.device
        answers: dict[str, Any] = {
            "/management/apiversions": [1],
            "/management/v1/description": {
                "ServerName": f"{MAKER}, {device.host}",
                "Manufacturer": MAKER,
                "ManufacturerVersion": device.version,
                "Location": self._place,
            },
            "/management/v1/configureddevices": [
                {
                    "DeviceName": device.name,
                    "DeviceType": "Telescope",
                    "DeviceNumber": 0,
                    "UniqueID": device.unique_id,
                }
            ],
        }
        if path not in answers:
            raise BadRequest(f"no {path[:60]!r}: there are {', '.join(answers)}", 404)
        if method != "GET":
            raise BadRequest(f"{path} has no {method}", 405, "GET")
        return _json(self._begin(read_form(query, any_case=True)), answers[path])

    def _page(self, method: str, path: str, now_utc_s: float) -> Reply:
        if path not in ("/", "/setup", "/setup/v1/telescope/0/setup"):
            raise BadRequest(f"no {path[:60]!r}: /setup is the page for people", 404)
        if method != "GET":
            raise BadRequest(f"{path} has no {method}", 405, "GET")
        page = setup_page(self.telescope, self._place, now_utc_s)
        return Reply(200, HTML, page.encode())


class ServedTelescope:
    """One telescope; `state` is the mount's last one, None before the first."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.state: TelescopeState | None = None
        self._connected: OrderedDict[int, None] = OrderedDict()
        self._target_ra_h: float | None = None
        self._target_dec_deg: float | None = None

    @property
    def clients(self) -> int:
        """How many clients are connected."""
        return len(self._connected)

    def connected(self, client: int) -> bool:
        """Return whether a client is connected."""
        return client in self._connected

    def get(self, path: str, form: Form, client: int, now_utc_s: float) -> Any:
        """Return the answer of a member's GET. Raises BadRequest, Fault."""
        member = self._member(path, "GET")
        takes = member.takes if member.write == "no" else ()
        values = form.values(takes)
        if member.read == "absent":
            raise Fault(Number.NOT_IMPLEMENTED, f"{member.name} is not implemented: {member.does}")
        if member.name not in FINE_RATES:
            # A rate that cannot be set can be read, and is 0.
            self._require_ability(member)
        self._require_connected(member)
        for parameter in takes:
            parameter.check(values[parameter.name])
        if member.name == "Connected":
            return self.connected(client)
        if member.path.startswith("target"):
            return self._target(member.name)
        if member.heard:
            return reported_value(self.heard(now_utc_s), self.device, member.name, values)
        return fixed_value(self.state, self.device, member.name, values, now_utc_s)

    def put(self, path: str, form: Form, client: int, now_utc_s: float) -> Order | CustomAction | None:
        """Return the order of a member's PUT, None where nothing is left to do. Raises BadRequest, Fault."""
        member = self._member(path, "PUT")
        values = form.values(member.takes)
        if member.write == "absent":
            raise Fault(Number.NOT_IMPLEMENTED, f"{member.name} cannot be done by this mount")
        self._require_ability(member)
        self._require_connected(member)
        for parameter in member.takes:
            parameter.check(values[parameter.name])
        if member.path in {"connect", "connected", "disconnect"}:
            self._connect(client, member.path == "connect" or values.get("Connected") is True, now_utc_s)
            return None
        if member.unparked and self._is_parked(member, now_utc_s):
            raise Fault(Number.PARKED, f"{member.name}: the mount is parked, and is woken at its own console")
        return self._order(member.name, values, now_utc_s)

    def order(self, member: str, client: int, now_utc_s: float, **values: float) -> Order | None:
        """Return the order of a member's PUT for a client of another protocol. Raises Fault."""
        form = Form(tuple((name, str(value)) for name, value in values.items()), any_case=False)
        try:
            order = self.put(member, form, client, now_utc_s)
        except BadRequest as bad:
            raise Fault(Number.INVALID_VALUE, bad.message) from bad
        assert not isinstance(order, TrackSatellite | Passes), "an action is no member"
        return order

    def _member(self, path: str, verb: str) -> Member:
        member = BY_PATH.get(path)
        if member is None:
            raise BadRequest(f"no member {path[:40]!r}: names are those of ITelescopeV4 in lower case")
        if (member.read if verb == "GET" else member.write) == "no":
            raise BadRequest(f"{member.name} has no {verb}")
        return member

    def _require_ability(self, member: Member) -> None:
        lack = self.device.abilities.lack(member.name)
        if lack is not None:
            raise Fault(
                Number.NOT_IMPLEMENTED,
                f"{member.name} is not implemented: for clients the mount at {self.device.mount} has {lack}",
            )

    def _require_connected(self, member: Member) -> None:
        if member.connected and not self._connected:
            raise Fault(Number.NOT_CONNECTED, f"{member.name}: no client is connected")

    def heard(self, now_utc_s: float) -> TelescopeState:
        """Return the mount's newest state; raises Fault where it is not heard."""
        state = self.state
        if state is None or not state.heard or abs(now_utc_s - state.utc_s) > OLDEST_STATE_S:
            raise Fault(
                Number.DRIVER,
                f"the mount at {self.device.mount} is not heard: {UNHEARD}",
            )
        return state

    def _is_parked(self, member: Member, now_utc_s: float) -> bool:
        """Return whether the mount is parked; raises Fault where it is not heard, but for a stop."""
        state = self.state if member.name == "AbortSlew" else self.heard(now_utc_s)
        return state is not None and state.at_park

    def _target(self, name: str) -> float:
        target = self._target_ra_h if name == "TargetRightAscension" else self._target_dec_deg
        if target is None:
            raise Fault(Number.VALUE_NOT_SET, f"{name} was not set yet")
        return target

    def _connect(self, client: int, connects: bool, now_utc_s: float) -> None:
        if not connects:
            self._connected.pop(client, None)
            return
        self.heard(now_utc_s)
        self._connected[client] = None
        self._connected.move_to_end(client)
        if len(self._connected) > MOST_CONNECTED:
            # Alpaca's clients alone come under new numbers and never leave; those of others are negative.
            del self._connected[next(one for one in self._connected if one >= 0)]

    def _order(  # noqa: PLR0911 - one for each kind of request
        self, name: str, values: Mapping[str, Value], now_utc_s: float
    ) -> Order | CustomAction | None:
        match name:
            case "Action":
                return read_action(str(values["Action"]), str(values["Parameters"]))
            case "TargetRightAscension":
                self._target_ra_h = float(values[name])
            case "TargetDeclination":
                self._target_dec_deg = float(values[name])
            case "RightAscensionRate" | "DeclinationRate":
                return self._fine(name, float(values[name]), now_utc_s)
            case "Tracking":
                return self._track(bool(values[name]), now_utc_s)
            case "AbortSlew":
                return Abort()
            case "FindHome" | "Park":
                return self._place(name, now_utc_s)
            case "MoveAxis":
                return self._move(int(values["Axis"]), float(values["Rate"]))
            case "PulseGuide":
                return self._pulse(int(values["Direction"]), int(values["Duration"]), now_utc_s)
            case "SlewToCoordinates" | "SlewToCoordinatesAsync" | "SyncToCoordinates":
                self._target_ra_h = float(values["RightAscension"])
                self._target_dec_deg = float(values["Declination"])
                return self._to_target(name, now_utc_s)
            case "SlewToTarget" | "SlewToTargetAsync" | "SyncToTarget":
                return self._to_target(name, now_utc_s)
        return None

    def _track(self, on: bool, now_utc_s: float) -> TrackOrder | None:
        if not self.device.abilities.sets_tracking:
            raise Fault(Number.NOT_IMPLEMENTED, "Tracking is as the telescope's own programs set it")
        state = self.heard(now_utc_s)
        if on and state.at_park:
            raise Fault(Number.PARKED, "Tracking: the mount is parked, and is woken at its own console")
        # A stop that is not over ends the tracking that is still there.
        return None if on == state.tracking and state.doing != "stopping" else TrackOrder(on)

    def _fine(self, name: str, value: float, now_utc_s: float) -> FineOrder:
        if value and not self.heard(now_utc_s).tracking:
            message = f"{name} is an offset to tracking, and the mount is not tracking: set Tracking first"
            raise Fault(Number.INVALID_OPERATION, message)
        of_ra = name == "RightAscensionRate"
        asked = -value * DEG_A_TIME_SECOND * SIDEREAL_A_SECOND if of_ra else value / 3600.0
        if not abs(asked) <= LARGEST_FINE_RATE_DEG_S:
            message = (
                f"{name} is {value:g}; at most {LARGEST_FINE_RATE_DEG_S:g}° a second: MoveAxis is faster"
            )
            raise Fault(Number.INVALID_VALUE, message)
        # No -0, which would be read back as it is.
        return FineOrder(ra_deg_s=asked + 0.0) if of_ra else FineOrder(dec_deg_s=asked + 0.0)

    def _place(self, name: str, now_utc_s: float) -> FindHome | Park | None:
        profile = self.device.profile
        if (profile.home if name == "FindHome" else profile.park) is None:
            place = "home" if name == "FindHome" else "park"
            raise Fault(Number.NOT_IMPLEMENTED, f"{name}: the mount's profile has no {place} position")
        if name == "FindHome":
            return FindHome()
        return None if self.heard(now_utc_s).at_park else Park()

    def _move(self, axis: int, rate_deg_s: float) -> MoveOrder:
        spans = self.device.axis_rates_deg_s(axis)
        if not spans:
            raise Fault(Number.NOT_IMPLEMENTED, f"MoveAxis: the mount has no axis {axis}")
        if rate_deg_s and not any(low <= abs(rate_deg_s) <= high for low, high in spans):
            borne = " and ".join(f"{low:g} to {high:g}" for low, high in spans)
            message = f"Rate is {rate_deg_s:g} °/s; axis {axis} turns at {borne} °/s"
            raise Fault(Number.INVALID_VALUE, message)
        return MoveOrder(axis, rate_deg_s)

    def _pulse(self, direction: int, duration_ms: int, now_utc_s: float) -> PulseGuide | None:
        state = self.heard(now_utc_s)
        # A pulse of ours may be of the other axis, and who holds the mount knows.
        guides = state.pulse_guiding and state.doing != GUIDING
        if state.slewing or not state.tracking or guides:
            why = "slews" if state.slewing else "guides already" if state.tracking else "is not tracking"
            raise Fault(Number.INVALID_OPERATION, f"PulseGuide: the mount {why}")
        if duration_ms == 0:
            return None
        signed = -duration_ms if direction in (EAST, SOUTH) else duration_ms
        return PulseGuide(ra_ms=signed) if direction in (EAST, WEST) else PulseGuide(dec_ms=signed)

    def _to_target(self, name: str, now_utc_s: float) -> Slew | Sync:
        ra_h, dec_deg = self._target_ra_h, self._target_dec_deg
        if ra_h is None or dec_deg is None:
            raise Fault(Number.VALUE_NOT_SET, f"{name}: set TargetRightAscension and TargetDeclination first")
        ra_deg = ra_h * 15.0 % 360.0
        if name.startswith("Slew"):
            return Slew(ra_deg, dec_deg)
        if not self.heard(now_utc_s).tracking:
            raise Fault(
                Number.INVALID_OPERATION, f"{name}: the mount is not tracking; a slew sets it tracking"
            )
        return Sync(ra_deg, dec_deg)


def fixed_value(
    state: TelescopeState | None, device: Device, name: str, values: Mapping[str, Value], now_utc_s: float
) -> Any:
    """Return the value of a member that needs no state of the mount."""
    if name == "UTCDate":
        return _now(now_utc_s)
    if name.startswith("Site"):
        return _site(state, device)[("SiteLatitude", "SiteLongitude", "SiteElevation").index(name)]
    if name in {"AxisRates", "CanMoveAxis"}:
        spans = device.axis_rates_deg_s(int(values["Axis"]))
        if name == "CanMoveAxis":
            return bool(spans)
        return [{"Maximum": high, "Minimum": low} for low, high in spans]
    return _FIXED[name](device)


def reported_value(state: TelescopeState, device: Device, name: str, values: Mapping[str, Value]) -> Any:
    """Return the value of a member from the mount's state. Raises Fault where the state has none."""
    if name == "DeviceState":
        return _device_state(state, device)
    if name == "DestinationSideOfPier":
        hour_angle_h = state.sidereal_h - float(values["RightAscension"])
        return device.destination_side(math.remainder(hour_angle_h * 15.0, 360.0))
    if name == "Slewing" and state.failure is not None and not state.slewing:
        raise Fault(Number.DRIVER, state.failure)
    value = _REPORTED[name](state)
    if value is None:
        raise Fault(Number.NOT_IMPLEMENTED, f"{name}: the mount does not report it")
    return value


def _device_state(state: TelescopeState, device: Device) -> list[dict[str, Any]]:
    values: list[dict[str, Any]] = []
    for name in CHANGING:
        value = _REPORTED[name](state)
        # By the definition, what is not known is left out.
        known = value is not None and device.abilities.lack(name) is None
        if known and (name != "Slewing" or state.failure is None):
            values.append({"Name": name, "Value": value})
    measured = _now(state.measured_utc_s)
    return [*values, {"Name": "UTCDate", "Value": measured}, {"Name": "TimeStamp", "Value": measured}]


def _site(state: TelescopeState | None, device: Device) -> tuple[float, float, float]:
    """Return latitude, longitude (±180°) and height: the mount's own where it has them, else the site's."""
    place = device.site.latitude_deg, device.site.longitude_deg, device.site.height_m
    if state is not None and state.site_latitude_deg is not None and state.site_longitude_deg is not None:
        place = state.site_latitude_deg, state.site_longitude_deg, state.site_height_m or 0.0
    return place[0], math.remainder(place[1], 360.0), place[2]


def _now(now_utc_s: float) -> str:
    return Utc(now_utc_s).isoformat("milliseconds")


_FIXED: dict[str, Callable[[Device], Any]] = {
    "AlignmentMode": lambda device: device.alignment,
    "CanFindHome": lambda device: device.profile.home is not None,
    "CanPark": lambda device: device.profile.park is not None,
    "Description": lambda device: device.description,
    "DriverInfo": lambda device: device.info,
    "DriverVersion": lambda device: device.version,
    "Name": lambda device: device.name,
    "Connecting": lambda _: False,
    "InterfaceVersion": lambda _: INTERFACE_VERSION,
    "SupportedActions": lambda _: list(ACTIONS),
    "EquatorialSystem": lambda _: TOPOCENTRIC,
    "TrackingRate": lambda _: DRIVE_RATES[0],
    "TrackingRates": lambda _: [DRIVE_RATES[0]],
    "CanPulseGuide": lambda device: device.abilities.guides,
    "CanSetDeclinationRate": lambda device: device.abilities.fine_rates,
    "CanSetRightAscensionRate": lambda device: device.abilities.fine_rates,
    "CanSlew": lambda device: device.abilities.slews,
    "CanSlewAsync": lambda device: device.abilities.slews,
    "CanSync": lambda device: device.abilities.syncs,
    "CanSetGuideRates": lambda _: False,
    "CanSetPark": lambda _: False,
    "CanSetPierSide": lambda _: False,
    "CanSetTracking": lambda device: device.abilities.sets_tracking,
    "CanSlewAltAz": lambda _: False,
    "CanSlewAltAzAsync": lambda _: False,
    "CanSyncAltAz": lambda _: False,
    "CanUnpark": lambda _: False,
}
_REPORTED: dict[str, Callable[[TelescopeState], Any]] = {
    "Altitude": lambda state: state.altitude_deg,
    "AtHome": lambda state: state.at_home,
    "AtPark": lambda state: state.at_park,
    "Azimuth": lambda state: state.azimuth_deg,
    "Declination": lambda state: state.dec_deg,
    "DeclinationRate": lambda state: state.dec_offset_deg_s * 3600.0,
    "DoesRefraction": lambda state: state.does_refraction,
    "GuideRateDeclination": lambda state: state.dec_guide_rate_deg_s,
    "GuideRateRightAscension": lambda state: state.ra_guide_rate_deg_s,
    "IsPulseGuiding": lambda state: state.pulse_guiding,
    "RightAscension": lambda state: state.ra_h,
    "RightAscensionRate": lambda state: -state.ra_offset_deg_s / DEG_A_TIME_SECOND / SIDEREAL_A_SECOND + 0.0,
    "SideOfPier": lambda state: int(state.beyond_pole),
    "SiderealTime": lambda state: state.sidereal_h,
    "Slewing": lambda state: state.slewing,
    "Tracking": lambda state: state.tracking,
}


def setup_page(telescope: ServedTelescope, place: str, now_utc_s: float) -> str:
    """Return the page as of an instant."""
    device, state = telescope.device, telescope.state
    rows = [
        ("Program", device.info),
        ("Mount", f"{device.profile.name}, {device.mount}"),
        ("Site", place),
        ("Telescope number", "0"),
        ("Clients connected", str(telescope.clients)),
        ("Actions", ", ".join(ACTIONS)),
        ("Now", Utc(now_utc_s).isoformat("seconds")),
    ]
    if state is None or not state.heard:
        rows.append(("State", "the mount is not heard"))
    else:
        rows += [
            ("State", "parked" if state.at_park else state.doing),
            ("Right ascension", f"{state.ra_h:.5f} h of date"),
            ("Declination", f"{state.dec_deg:+.4f}°"),
            ("Side of the pier", "beyond the pole" if state.beyond_pole else "normal"),
        ]
        if state.tripped is not None:
            rows.append(("Stopped by safety", f"{state.tripped}; AbortSlew makes it ready again"))
    lines = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return PAGE.format(title=escape(device.name), rows="\n".join(lines))


def _json(transaction: Transaction, value: Any = NOTHING, fault: Fault | None = None) -> Reply:
    answer: dict[str, Any] = {} if value is NOTHING or fault is not None else {"Value": value}
    answer |= {
        "ClientTransactionID": transaction.theirs,
        "ServerTransactionID": transaction.ours,
        "ErrorNumber": int(Number.OK if fault is None else fault.number),
        "ErrorMessage": "" if fault is None else fault.message,
    }
    return Reply(200, JSON, msgspec.json.encode(answer))

"""A telescope as its clients see it: values from the mount's last state, orders from their requests.

What clients share is here: the target, and which of them are connected. Instants are UTC as POSIX seconds.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import TYPE_CHECKING, Any

from sattrack.mount.requests import LARGEST_FINE_RATE_DEG_S
from sattrack.servers.alpaca.device import FINE_RATES
from sattrack.servers.alpaca.members import BY_PATH, DRIVE_RATES, INTERFACE_VERSION
from sattrack.servers.alpaca.messages import (
    ACTIONS,
    AbortOrder,
    BadRequest,
    Fault,
    FineOrder,
    HomeOrder,
    MoveOrder,
    Number,
    ParkOrder,
    PulseOrder,
    SlewOrder,
    SyncOrder,
    TrackOrder,
    read_action,
)
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sattrack.servers.alpaca.device import Device
    from sattrack.servers.alpaca.members import Form, Member, Value
    from sattrack.servers.alpaca.messages import CustomAction, Order, TelescopeState

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
"""What DeviceState holds by ITelescopeV4's definition, beside the instant."""
MOST_CONNECTED = 4096
NORTH, SOUTH, EAST, WEST = range(4)
OLDEST_STATE_S = 2.5
"""A state older than this says nothing about the mount."""


def fixed_value(
    state: TelescopeState | None, device: Device, name: str, values: Mapping[str, Value], now_utc_s: float
) -> Any:
    """Return the value of a member that needs no mount that is heard."""
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


def told_value(state: TelescopeState, device: Device, name: str, values: Mapping[str, Value]) -> Any:
    """Return the value of a member by what the mount says of itself. Raises Fault where it does not."""
    if name == "DeviceState":
        return _device_state(state, device)
    if name == "DestinationSideOfPier":
        hour_angle_h = state.sidereal_h - float(values["RightAscension"])
        return device.destination_side(math.remainder(hour_angle_h * 15.0, 360.0))
    if name == "Slewing" and state.failure is not None and not state.slewing:
        raise Fault(Number.DRIVER, state.failure)
    value = _TOLD[name](state)
    if value is None:
        raise Fault(Number.NOT_IMPLEMENTED, f"{name}: the mount does not report it")
    return value


def _device_state(state: TelescopeState, device: Device) -> list[dict[str, Any]]:
    told: list[dict[str, Any]] = []
    for name in CHANGING:
        value = _TOLD[name](state)
        # By the definition, what is not known is left out.
        known = value is not None and device.abilities.lack(name) is None
        if known and (name != "Slewing" or state.failure is None):
            told.append({"Name": name, "Value": value})
    measured = _now(state.measured_utc_s)
    return [*told, {"Name": "UTCDate", "Value": measured}, {"Name": "TimeStamp", "Value": measured}]


def _site(state: TelescopeState | None, device: Device) -> tuple[float, float, float]:
    """Return latitude, longitude and height: the mount's own where it has them, else the site's."""
    site = device.site
    if state is None or state.site_latitude_deg is None or state.site_longitude_deg is None:
        return site.latitude_deg, site.longitude_deg, site.height_m
    return state.site_latitude_deg, state.site_longitude_deg, state.site_height_m or 0.0


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
_TOLD: dict[str, Callable[[TelescopeState], Any]] = {
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


class Telescope:
    """One telescope; `state` is what its mount said last, None before it said anything."""

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

    def get(self, path: str, form: Form, client: int, now_utc_s: float) -> Any:
        """Return what a member's GET gives. Raises BadRequest, Fault."""
        member = self._member(path, "GET")
        takes = member.takes if member.write == "no" else ()
        values = form.values(takes)
        if member.read == "absent":
            raise Fault(Number.NOT_IMPLEMENTED, f"{member.name} is not implemented: {member.does}")
        if member.name not in FINE_RATES:
            # A rate that cannot be set can be read, and is 0.
            self._demand_able(member)
        self._demand_connected(member)
        for parameter in takes:
            parameter.check(values[parameter.name])
        if member.name == "Connected":
            return client in self._connected
        if member.path.startswith("target"):
            return self._target(member.name)
        if member.heard:
            return told_value(self._heard(now_utc_s), self.device, member.name, values)
        return fixed_value(self.state, self.device, member.name, values, now_utc_s)

    def put(self, path: str, form: Form, client: int, now_utc_s: float) -> Order | CustomAction | None:
        """Return what a member's PUT asks of the mount, None where it is done. Raises BadRequest, Fault."""
        member = self._member(path, "PUT")
        values = form.values(member.takes)
        if member.write == "absent":
            raise Fault(Number.NOT_IMPLEMENTED, f"{member.name} cannot be done by this mount")
        self._demand_able(member)
        self._demand_connected(member)
        for parameter in member.takes:
            parameter.check(values[parameter.name])
        if member.path in {"connect", "connected", "disconnect"}:
            self._connect(client, member.path == "connect" or values.get("Connected") is True, now_utc_s)
            return None
        if member.unparked and self._is_parked(member, now_utc_s):
            raise Fault(Number.PARKED, f"{member.name}: the mount is parked, and is woken at its own console")
        return self._order(member.name, values, now_utc_s)

    def _member(self, path: str, verb: str) -> Member:
        member = BY_PATH.get(path)
        if member is None:
            raise BadRequest(f"no member {path[:40]!r}: names are those of ITelescopeV4 in lower case")
        if (member.read if verb == "GET" else member.write) == "no":
            raise BadRequest(f"{member.name} has no {verb}")
        return member

    def _demand_able(self, member: Member) -> None:
        lack = self.device.abilities.lack(member.name)
        if lack is not None:
            raise Fault(
                Number.NOT_IMPLEMENTED,
                f"{member.name} is not implemented: for clients the mount at {self.device.mount} has {lack}",
            )

    def _demand_connected(self, member: Member) -> None:
        if member.connected and not self._connected:
            raise Fault(Number.NOT_CONNECTED, f"{member.name}: no client is connected")

    def _heard(self, now_utc_s: float) -> TelescopeState:
        """Return the mount's state; raises Fault where it is not heard."""
        state = self.state
        if state is None or not state.heard or abs(now_utc_s - state.utc_s) > OLDEST_STATE_S:
            raise Fault(
                Number.DRIVER,
                f"the mount at {self.device.mount} is not heard: is it on, and set to send here?",
            )
        return state

    def _is_parked(self, member: Member, now_utc_s: float) -> bool:
        """Return whether the mount is parked; raises Fault where it is not heard, but for a stop."""
        state = self.state if member.name == "AbortSlew" else self._heard(now_utc_s)
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
        self._heard(now_utc_s)
        self._connected[client] = None
        self._connected.move_to_end(client)
        if len(self._connected) > MOST_CONNECTED:
            self._connected.popitem(last=False)

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
                return AbortOrder()
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
        state = self._heard(now_utc_s)
        if on and state.at_park:
            raise Fault(Number.PARKED, "Tracking: the mount is parked, and is woken at its own console")
        return None if on == state.tracking else TrackOrder(on)

    def _fine(self, name: str, value: float, now_utc_s: float) -> FineOrder:
        if value and not self._heard(now_utc_s).tracking:
            words = f"{name} is an offset to tracking, and the mount is not tracking: set Tracking first"
            raise Fault(Number.INVALID_OPERATION, words)
        of_ra = name == "RightAscensionRate"
        asked = -value * DEG_A_TIME_SECOND * SIDEREAL_A_SECOND if of_ra else value / 3600.0
        if not abs(asked) <= LARGEST_FINE_RATE_DEG_S:
            words = f"{name} is {value:g}; at most {LARGEST_FINE_RATE_DEG_S:g}° a second: MoveAxis is faster"
            raise Fault(Number.INVALID_VALUE, words)
        # No -0, which would be read back as it is.
        return FineOrder(ra_deg_s=asked + 0.0) if of_ra else FineOrder(dec_deg_s=asked + 0.0)

    def _place(self, name: str, now_utc_s: float) -> HomeOrder | ParkOrder | None:
        profile = self.device.profile
        if (profile.home if name == "FindHome" else profile.park) is None:
            place = "home" if name == "FindHome" else "park"
            raise Fault(Number.NOT_IMPLEMENTED, f"{name}: the mount's profile has no {place} position")
        if name == "FindHome":
            return HomeOrder()
        return None if self._heard(now_utc_s).at_park else ParkOrder()

    def _move(self, axis: int, rate_deg_s: float) -> MoveOrder:
        spans = self.device.axis_rates_deg_s(axis)
        if not spans:
            raise Fault(Number.NOT_IMPLEMENTED, f"MoveAxis: the mount has no axis {axis}")
        if rate_deg_s and not any(low <= abs(rate_deg_s) <= high for low, high in spans):
            borne = " and ".join(f"{low:g} to {high:g}" for low, high in spans)
            words = f"Rate is {rate_deg_s:g} °/s; axis {axis} turns at {borne} °/s"
            raise Fault(Number.INVALID_VALUE, words)
        return MoveOrder(axis, rate_deg_s)

    def _pulse(self, direction: int, duration_ms: int, now_utc_s: float) -> PulseOrder | None:
        state = self._heard(now_utc_s)
        if state.slewing or not state.tracking or state.pulse_guiding:
            why = "slews" if state.slewing else "guides already" if state.tracking else "is not tracking"
            raise Fault(Number.INVALID_OPERATION, f"PulseGuide: the mount {why}")
        if duration_ms == 0:
            return None
        signed = -duration_ms if direction in (EAST, SOUTH) else duration_ms
        return PulseOrder(ra_ms=signed) if direction in (EAST, WEST) else PulseOrder(dec_ms=signed)

    def _to_target(self, name: str, now_utc_s: float) -> SlewOrder | SyncOrder:
        ra_h, dec_deg = self._target_ra_h, self._target_dec_deg
        if ra_h is None or dec_deg is None:
            raise Fault(Number.VALUE_NOT_SET, f"{name}: set TargetRightAscension and TargetDeclination first")
        ra_deg = ra_h * 15.0 % 360.0
        if name.startswith("Slew"):
            return SlewOrder(ra_deg, dec_deg, wait=not name.endswith("Async"))
        if not self._heard(now_utc_s).tracking:
            raise Fault(
                Number.INVALID_OPERATION, f"{name}: the mount is not tracking; a slew sets it tracking"
            )
        return SyncOrder(ra_deg, dec_deg)

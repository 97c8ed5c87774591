"""The values of members: what the device fixes, and what the mount said last. UTC as POSIX seconds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from sattrack.servers.alpaca.actions import ACTIONS
from sattrack.servers.alpaca.faults import Fault, Number
from sattrack.servers.alpaca.members import DRIVE_RATES, INTERFACE_VERSION
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sattrack.servers.alpaca.device import Device
    from sattrack.servers.alpaca.messages import TelescopeState
    from sattrack.servers.alpaca.parameters import Value

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
"""What DeviceState tells, by ITelescopeV4's definition, beside the instant."""


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
        raise Fault(Number.NOT_IMPLEMENTED, f"{name}: the mount does not tell it")
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

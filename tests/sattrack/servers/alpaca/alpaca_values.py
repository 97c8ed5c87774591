"""What the simulated mount's members are read as, by whatever client."""

from __future__ import annotations

from typing import Any

EVERYWHERE: dict[str, Any] = {
    "InterfaceVersion": 4,
    "Description": str,
    "DriverVersion": str,
    "SupportedActions": ["TrackSatellite", "Bias", "Passes"],
    "AlignmentMode": 1,
    "Altitude": float,
    "AtHome": False,
    "AtPark": False,
    "Azimuth": float,
    "CanFindHome": True,
    "CanPark": True,
    "CanPulseGuide": True,
    "CanSetDeclinationRate": True,
    "CanSetGuideRates": False,
    "CanSetPark": False,
    "CanSetPierSide": False,
    "CanSetRightAscensionRate": True,
    "CanSetTracking": True,
    "CanSlew": True,
    "CanSlewAltAz": False,
    "CanSlewAltAzAsync": False,
    "CanSlewAsync": True,
    "CanSync": True,
    "CanSyncAltAz": False,
    "CanUnpark": False,
    "Declination": float,
    "DeclinationRate": 0.0,
    "DoesRefraction": False,
    "EquatorialSystem": 1,
    "GuideRateDeclination": float,
    "GuideRateRightAscension": float,
    "IsPulseGuiding": False,
    "RightAscension": float,
    "RightAscensionRate": 0.0,
    "SiderealTime": float,
    "SiteLatitude": 52.1541,
    "SiteLongitude": 4.4908,
    "Slewing": False,
    "Tracking": True,
    "TrackingRates": [0],
}
"""Member, and what its value must be: a type, or the value itself."""

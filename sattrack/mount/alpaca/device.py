"""What is known of an Alpaca telescope: what it can do, asked once, and how it stands, asked again."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import msgspec

JNOW_SYSTEMS = frozenset({0, 1})
"""EquatorialSystem "other" is taken for topocentric of date, as most drivers mean it."""
J2000_SYSTEM = 2
ALT_AZ, GERMAN = 0, 2
"""AlignmentMode of a telescope whose axes are azimuth and altitude, and of a German one; 1 is polar."""
PIER_EAST, PIER_WEST = 0, 1
"""SideOfPier of a telescope on its normal side, and of one that points through the pole, as a German one does
that looks east."""


class RateSpan(msgspec.Struct, frozen=True):
    """One of AxisRates: degrees a second."""

    low_deg_s: float
    high_deg_s: float


class DeviceFacts(msgspec.Struct, frozen=True):
    """What a telescope can do; degrees, metres. Site None where the driver does not tell it."""

    name: str = "telescope"
    interface_version: int = 3
    equatorial_system: int = 1
    alignment_mode: int | None = None
    """None where the driver does not tell it: then it is taken for an equatorial one."""
    does_refraction: bool = False
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    height_m: float = 0.0
    can_set_tracking: bool = False
    can_slew: bool = False
    can_sync: bool = False
    can_pulse_guide: bool = False
    guide_rates_deg_s: tuple[float, float] | None = None
    """Right ascension's and declination's, as first reported; None where it has, or reports, none."""
    has_device_state: bool = False
    primary_rates: tuple[RateSpan, ...] = ()
    secondary_rates: tuple[RateSpan, ...] = ()
    moved_by: str = "MoveAxis"
    """What turns its axes at rates."""
    stops_without_rates: bool = False
    """Whether it can be stopped where it has no such rates."""

    axes_known: bool = False
    """Whether the profile that it is driven by tells how its axes lie."""

    @property
    def follows_by_both(self) -> bool:
        """Whether it follows the sky with both axes, so that a MoveAxis of 0 sets either going."""
        return self.axes_known or self.alignment_mode == ALT_AZ

    def objection(self, stops_only: bool = False) -> str | None:
        """Return why it cannot be driven, or only stopped, as text; None where it can."""
        if self.alignment_mode == ALT_AZ and not (stops_only or self.axes_known):
            return (
                f"{self.name} is an alt-azimuth telescope (AlignmentMode 0): its MoveAxis turns azimuth and "
                "altitude; give --profile with a [geometry] to `sattrack track`, which `sattrack mount "
                "calibrate` measures"
            )
        if stops_only and self.stops_without_rates:
            return None
        if not (self.primary_rates and self.secondary_rates):
            return f"{self.name} has no {self.moved_by} on both axes: satellites cannot be followed with it"
        for axis in (0, 1):
            if all(span.low_deg_s == span.high_deg_s for span in self.rates(axis)):
                return (
                    f"{self.name} moves its axes at single rates only: satellites cannot be followed with it"
                )
        if self.equatorial_system not in JNOW_SYSTEMS | {J2000_SYSTEM}:
            return (
                f"{self.name} gives coordinates of EquatorialSystem {self.equatorial_system}; set it to JNow"
            )
        return None

    def rates(self, axis: int) -> tuple[RateSpan, ...]:
        """Return the rates that one axis bears."""
        return self.secondary_rates if axis else self.primary_rates

    def fastest_deg_s(self, axis: int) -> float:
        """Return the largest rate of one axis."""
        return max((span.high_deg_s for span in self.rates(axis)), default=0.0)


class DeviceState(NamedTuple):
    """How a telescope stands besides its place; `began_s`, monotonic: when asked whether it slews."""

    began_s: float
    slewing: bool = False
    tracking: bool = True
    at_park: bool = False
    at_home: bool = False
    beyond_pole: bool = False
    pulse_guiding: bool = False

    def with_values(self, began_s: float, values: dict[str, Any]) -> DeviceState:
        """Return it with new values, named as by Alpaca in lower case; a value of a wrong type is ignored."""
        known: dict[str, bool] = {}
        for name, member in MEMBERS.items():
            value = values.get(member)
            if name == "beyond_pole" and isinstance(value, int):
                known[name] = value == PIER_WEST
            elif isinstance(value, bool):
                known[name] = value
        began_s = began_s if "slewing" in known else self.began_s
        return self._replace(began_s=began_s, **known)


MEMBERS = {
    "slewing": "slewing",
    "tracking": "tracking",
    "at_park": "atpark",
    "at_home": "athome",
    "beyond_pole": "sideofpier",
    "pulse_guiding": "ispulseguiding",
}


class SkyPlace(NamedTuple):
    """A place that was read: each axis with its own instant, the middle of its request, UTC POSIX seconds.

    Degrees, in the telescope's own equinox.
    """

    ra_utc_s: float
    ra_deg: float
    dec_utc_s: float
    dec_deg: float
    took_s: float = 0.0
    """How long the longer of the requests took."""


class Reading(NamedTuple):
    """What was read at once: members by Alpaca's names, and each coordinate with its instant, monotonic."""

    asked_s: float
    values: dict[str, Any]
    ra: tuple[float, Any]
    dec: tuple[float, Any]
    took_s: float


def nearest_rate(rate_deg_s: float, spans: tuple[RateSpan, ...]) -> float:
    """Return the rate that an axis bears and that is nearest to a wanted one, with its sign.

    0 is 0, and so is what is no number.
    """
    speed = abs(rate_deg_s)
    if not (math.isfinite(speed) and speed > 0.0 and spans):
        return 0.0
    borne = [min(max(speed, span.low_deg_s), span.high_deg_s) for span in spans]
    # Below the slowest rate there is standing still as well.
    best = min([0.0, *borne], key=lambda one: abs(one - speed))
    return -best if rate_deg_s < 0.0 else best


def spans_of(axis_rates: Any) -> tuple[RateSpan, ...]:
    """Return AxisRates as they come in JSON; what is no range is left out."""
    if not isinstance(axis_rates, list):
        return ()
    spans = []
    for one in axis_rates:
        low, high = (one.get("Minimum"), one.get("Maximum")) if isinstance(one, dict) else (None, None)
        if isinstance(low, int | float) and isinstance(high, int | float) and 0.0 <= low <= high > 0.0:
            spans.append(RateSpan(float(low), float(high)))
    return tuple(spans)

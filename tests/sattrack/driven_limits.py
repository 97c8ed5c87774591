"""Each limit with a mount that is driven at it, and a measure of its own of how far inside the axes are."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import erfa
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, NEVER, T0, Span, Stand, steadily

from sattrack.mount.model import MountProfile, PierZone
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import SafetyLimits

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.simulator.mount import Truth

DARK = SafetyLimits(optical=False)
LATENCY_S = 0.2004


def direction(truth: Truth) -> tuple[float, float, float]:
    return vector(truth.hour_angle_axis_deg, truth.dec_axis_deg)


def vector(ha_deg: float, dec_deg: float) -> tuple[float, float, float]:
    h, d = math.radians(ha_deg), math.radians(dec_deg)
    return math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)


def angle_deg(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    return math.degrees(math.acos(max(-1.0, min(1.0, sum(a * b for a, b in zip(one, other, strict=True))))))


def apart_of(truth: Truth, place: tuple[float, float]) -> float:
    return angle_deg(direction(truth), vector(*place))


def altitude(truth: Truth, _: float) -> float:
    return 90.0 - angle_deg(direction(truth), vector(0.0, LATITUDE_DEG))


def body_place(x: float, y: float, z: float, utc_s: float) -> tuple[float, float]:
    """Hour angle and declination of a vector of date, by ERFA's own sidereal time."""
    ra = math.degrees(math.atan2(y, x))
    sidereal = math.degrees(erfa.gmst82(2440587.5, utc_s / 86400.0)) + LONGITUDE_DEG
    return sidereal - ra, math.degrees(math.atan2(z, math.hypot(x, y)))


def sun_place(utc_s: float) -> tuple[float, float]:
    """The Astronomical Almanac's low-precision Sun, good to 0.01°."""
    days = utc_s / 86400.0 - 10957.5
    anomaly = math.radians(357.528 + 0.9856003 * days)
    longitude = 280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    x, y = math.cos(math.radians(longitude)), math.sin(math.radians(longitude))
    tilt = math.radians(23.439)
    return body_place(x, math.cos(tilt) * y, math.sin(tilt) * y, utc_s)


def moon_place(utc_s: float) -> tuple[float, float]:
    """The Almanac's low-precision Moon: 0.3°; from the site it stands up to 1° lower."""
    t = (utc_s / 86400.0 - 10957.5) / 36525.0

    def wave(size: float, phase: float, turns: float) -> float:
        return size * math.sin(math.radians(phase + turns * t))

    longitude = math.radians(
        218.32
        + 481267.881 * t
        + wave(6.29, 135.0, 477198.87)
        - wave(1.27, 259.3, -413335.36)
        + wave(0.66, 235.7, 890534.22)
        + wave(0.21, 269.9, 954397.74)
        - wave(0.19, 357.5, 35999.05)
        - wave(0.11, 186.5, 966404.03)
    )
    latitude = math.radians(
        wave(5.13, 93.3, 483202.02)
        + wave(0.28, 228.2, 960400.89)
        - wave(0.28, 318.3, 6003.15)
        - wave(0.17, 217.6, -407332.21)
    )
    x, y = math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude)
    c, s = math.cos(math.radians(23.439)), math.sin(math.radians(23.439))
    return body_place(x, c * y - s * math.sin(latitude), s * y + c * math.sin(latitude), utc_s)


def from_sun(truth: Truth, t: float) -> float:
    return angle_deg(direction(truth), vector(*sun_place(T0 + t)))


SUN_HA, SUN_DEC = sun_place(T0)
HILL = ((0.0, 0.0), (90.0, 5.0), (170.0, 5.0), (170.0, 25.0), (190.0, 25.0), (190.0, 5.0), (270.0, 0.0))
ZONE = PierZone("north", ((-40.0, 50.0), (40.0, 50.0), (0.0, 80.0)))


def from_zone(truth: Truth, _: float) -> float:
    """Below the zone's lower edge, as long as the hour angle stays inside it."""
    assert abs(truth.hour_angle_axis_deg) < 30.0
    return 50.0 - truth.dec_axis_deg


ROWS: dict[str, tuple[Stand, Callable[[Truth, float], float], float]] = {
    "altitude": (
        Stand(
            steadily(0.0, -5.0),
            SafetyLimits(floor_altitude_deg=10.0, optical=False),
            StartPosition(0.0, 20.0),
        ),
        altitude,
        10.0,
    ),
    "horizon": (
        Stand(
            steadily(0.0, -5.0),
            SafetyLimits(
                optical=False,
                horizon=HILL,
            ),
            StartPosition(0.0, 30.0),
        ),
        altitude,
        25.0,
    ),
    "hour_angle": (
        Stand(steadily(6.0, 0.0), DARK, StartPosition(0.0, 40.0), MountProfile(hour_angle_limit_deg=40.0)),
        lambda truth, _: 40.0 - truth.hour_angle_axis_deg,
        0.0,
    ),
    "declination": (
        Stand(
            steadily(0.0, 6.0),
            DARK,
            StartPosition(0.0, 20.0),
            MountProfile(dec_axis_limits_deg=(-40.0, 60.0)),
        ),
        lambda truth, _: 60.0 - truth.dec_axis_deg,
        0.0,
    ),
    "pier": (
        Stand(steadily(0.0, 4.0), DARK, StartPosition(0.0, 20.0), MountProfile(pier_zones=(ZONE,))),
        from_zone,
        0.0,
    ),
    "sun": (
        Stand(steadily(4.0, 0.0), SafetyLimits(), StartPosition(SUN_HA % 360.0 - 40.0, SUN_DEC)),
        from_sun,
        15.0,
    ),
}  # fmt: skip


def flown(name: str, deaf: Span = NEVER, silent: Span = NEVER, seconds: float = 20.0) -> Stand:
    stand = ROWS[name][0]
    return replace(stand, truths=[], sent=[], met_s=None, deaf=deaf, silent=silent).run(seconds)


def nearest(name: str, stand: Stand) -> float:
    _, measure, bound = ROWS[name]
    return min(measure(truth, t) for t, truth in stand.truths) - bound


SUN_WEST_HA = (SUN_HA + 180.0) % 360.0 - 180.0

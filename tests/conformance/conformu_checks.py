"""ConformU's checks of a telescope's members and methods, by its names, with alpyca as the client.

What each wants stands in ConformU's messages and in ITelescopeV4's definition. Waits are as long as its own
by default. The order differs in one place: a parked mount cannot be unparked, so Park is last.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from alpaca.exceptions import (
    InvalidValueException,
    NotImplementedException,
    ParkedException,
    ValueNotSetException,
)
from alpaca.telescope import AlignmentModes, GuideDirections, PierSide, Telescope, TelescopeAxes

if TYPE_CHECKING:
    from collections.abc import Callable

SLEW_WITHIN_S = 300.0
ENDS_WITHIN_S = 30.0
SLEW_TOLERANCE_ARCSEC = 10.0
SYNC_OFF_ARCMIN = 60.0
MOVE_S, OFFSET_S, PULSE_S = 2.0, 10.0, 5.0
PULSE_TOLERANCE_ARCSEC = 1.0
SIDEREAL_A_SECOND = 0.9972695677
"""Sidereal seconds have this many SI seconds."""
HOUR_ANGLES_H = (-9.0, 3.0, 9.0, -3.0)
AXES = {
    "Primary": TelescopeAxes.axisPrimary,
    "Secondary": TelescopeAxes.axisSecondary,
    "Tertiary": TelescopeAxes.axisTertiary,
}
CANS = (
    *("CanFindHome", "CanPark", "CanPulseGuide", "CanSetDeclinationRate", "CanSetGuideRates", "CanSetPark"),
    *("CanSetPierSide", "CanSetRightAscensionRate", "CanSetTracking", "CanSlew", "CanSlewAltAz"),
    *("CanSlewAltAzAsync", "CanSlewAsync", "CanSync", "CanSyncAltAz", "CanUnpark"),
)
STATES = (
    *(
        "Altitude",
        "AtHome",
        "AtPark",
        "Azimuth",
        "Declination",
        "IsPulseGuiding",
        "RightAscension",
        "SideOfPier",
    ),
    *("SiderealTime", "Slewing", "Tracking", "UTCDate"),
)
BOUNDS = {
    "Altitude": (0.0, 90.0),
    "Azimuth": (0.0, 360.0),
    "Declination": (-90.0, 90.0),
    "RightAscension": (0.0, 24.0),
    "SiderealTime": (0.0, 24.0),
    "SiteElevation": (-300.0, 10000.0),
    "SiteLatitude": (-90.0, 90.0),
    "SiteLongitude": (-180.0, 180.0),
    "GuideRateDeclination": (0.0, math.inf),
    "GuideRateRightAscension": (0.0, math.inf),
    "DeclinationRate": (0.0, math.inf),
}
OPTIONAL = ("ApertureArea", "ApertureDiameter", "FocalLength", "SlewSettleTime")


class Finding(NamedTuple):
    test: str
    holds: bool
    words: str


@dataclass
class Bench:
    """A telescope that is connected, and what was found of it."""

    scope: Telescope
    findings: list[Finding] = field(default_factory=list)

    def say(self, test: str, holds: bool, words: str) -> None:
        """Note one outcome of a test."""
        self.findings.append(Finding(test, holds, words))

    def refused(self, test: str, what: str, call: Callable[[], object], *kinds: type[Exception]) -> None:
        """Note whether a call ends in one of these exceptions."""
        try:
            call()
        except kinds as error:
            self.say(test, True, f"{what}: {type(error).__name__}")
        except Exception as error:  # noqa: BLE001 - any other is the finding
            self.say(test, False, f"{what}: {type(error).__name__}: {error}")
        else:
            self.say(test, False, f"{what}: no exception")

    def put(self, member: str, **values: object) -> None:
        """Set or call what alpyca has no name for, or not for every value."""
        self.scope._put(member.lower(), SLEW_WITHIN_S, **values)

    def set(self, name: str, value: object) -> Callable[[], None]:
        """Return a call that writes a property."""
        return lambda: self.put(name, **{name: value})

    def ends(self, what: Callable[[], bool], within_s: float = SLEW_WITHIN_S) -> bool:
        """Wait while something is so; return whether it ended in time."""
        until_s = time.monotonic() + within_s
        while what():
            if time.monotonic() > until_s:
                return False
            time.sleep(0.05)
        return True

    def stands(self, within_s: float = SLEW_WITHIN_S) -> bool:
        """Wait for Slewing to become false."""
        return self.ends(lambda: bool(self.scope.Slewing), within_s)

    def right_ascension_at(self, hour_angle_h: float) -> float:
        return float((self.scope.SiderealTime - hour_angle_h) % 24.0)

    def altitudes(self, hour_angle_h: float) -> dict[float, float]:
        """Return the altitudes of declinations from -85° to 85° at an hour angle, degrees."""
        latitude = math.radians(self.scope.SiteLatitude)
        turned = math.cos(math.radians(15.0 * hour_angle_h))
        found = {}
        for dec_deg in range(-85, 90, 10):
            dec = math.radians(dec_deg)
            sine = math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * turned
            found[float(dec_deg)] = math.degrees(math.asin(sine))
        return found

    def half_way_up(self, hour_angle_h: float) -> float:
        """Return the declination half way from the lowest above the horizon to the north pole."""
        lowest = min(dec for dec, altitude in self.altitudes(hour_angle_h).items() if altitude > 0.0)
        return (lowest + 90.0) / 2.0

    def below_65(self, hour_angle_h: float) -> float:
        """Return the declination of the highest altitude below 65°."""
        heights = {dec: altitude for dec, altitude in self.altitudes(hour_angle_h).items() if altitude < 65.0}
        return max(heights, key=lambda dec: heights[dec])

    def slew(self, hour_angle_h: float, dec_deg: float) -> None:
        """Slew, and wait for the end."""
        if not self.scope.Tracking:
            self.scope.Tracking = True
        self.scope.SlewToCoordinatesAsync(self.right_ascension_at(hour_angle_h), dec_deg)
        self.stands()

    def near(self, test: str, what: str, ra_h: float, dec_deg: float, tolerance_arcsec: float) -> None:
        """Note whether the telescope reports a direction."""
        off_ra = abs(math.remainder(self.scope.RightAscension - ra_h, 24.0)) * 15.0 * 3600.0
        off_dec = abs(self.scope.Declination - dec_deg) * 3600.0
        good = max(off_ra, off_dec) <= tolerance_arcsec
        self.say(
            test,
            good,
            f"{what}, within {tolerance_arcsec:g}″" if good else f"{what}: {off_ra:.1f}″, {off_dec:.1f}″ off",
        )


def connect(bench: Bench) -> None:
    """Connected and Connect, there and back."""
    scope = bench.scope
    for wanted in (True, False):
        scope.Connected = wanted
        bench.say("Connected", scope.Connected is wanted, f"Connected = {wanted}")
    scope.Connect()
    bench.ends(lambda: bool(scope.Connecting), 10.0)
    bench.say("Connect", scope.Connected is True, "connected by Connect()")


def common(bench: Bench) -> None:
    """What every device has."""
    scope = bench.scope
    bench.say("InterfaceVersion", scope.InterfaceVersion >= 1, f"{scope.InterfaceVersion}")
    bench.say("CreateDevice", scope.InterfaceVersion in {1, 2, 3, 4}, "an interface version that there is")
    for name in ("Description", "DriverInfo", "DriverVersion", "Name"):
        bench.say(name, bool(getattr(scope, name)), "a text")
    actions = scope.SupportedActions
    bench.say(
        "SupportedActions", all(isinstance(one, str) and one for one in actions), f"{len(actions)} names"
    )
    told = {item["Name"] for item in scope.DeviceState}
    bench.say("DeviceState", told - {"TimeStamp"} <= set(STATES), "operational properties alone")
    bench.say("DeviceState", set(STATES) <= told, "all of them")
    for name in CANS:
        bench.say(name, isinstance(getattr(scope, name), bool), f"{getattr(scope, name)}")
    bench.say("CanUnPark", scope.CanPark or not scope.CanUnpark, "not without CanPark")


def properties(bench: Bench) -> None:
    """Properties that are read, and what of them cannot be written."""
    scope = bench.scope
    for name in ("TargetDeclination", "TargetRightAscension"):
        bench.refused(
            f"{name} Read",
            "before it is written",
            lambda name=name: getattr(scope, name),
            ValueNotSetException,
        )
    for name, (low, high) in BOUNDS.items():
        value = getattr(scope, name)
        read = name if name in STATES else f"{name} Read"
        bench.say(read, low <= value <= high, f"from {low:g} to {high:g}")
    for name in ("AlignmentMode", "AtHome", "AtPark", "EquatorialSystem", "IsPulseGuiding"):
        getattr(scope, name)
        bench.say(name, True, "is read")
    for name in ("DoesRefraction", "RightAscensionRate", "SideOfPier", "Tracking", "TrackingRate", "UTCDate"):
        getattr(scope, name)
        bench.say(f"{name} Read", True, "is read")
    bench.say("Slewing", scope.Slewing is False, "false at rest")
    for name in OPTIONAL:
        said = name if name != "SlewSettleTime" else "SlewSettleTime Read"
        bench.refused(said, "optional", lambda name=name: getattr(scope, name), NotImplementedException)
    sky = (18.697374558 + 24.065709824419081 * (scope.UTCDate.timestamp() / 86400.0 - 10957.5)) % 24.0
    off_s = abs(math.remainder(scope.SiderealTime - sky - scope.SiteLongitude / 15.0, 24.0)) * 3600.0
    bench.say(
        "SiderealTime",
        off_s <= 1.0,
        f"within {1.0:g} s of the sky's" if off_s <= 1.0 else f"{off_s:.1f} s off",
    )
    for name, values in (
        ("SiteElevation", (-301.0, 10001.0, 10.0)),
        ("SiteLatitude", (-91.0, 91.0, 52.0)),
        ("SiteLongitude", (-181.0, 181.0, 4.0)),
        ("SlewSettleTime", (-1, 1)),
        ("DoesRefraction", (True, False)),
        ("GuideRateDeclination", (0.002,)),
        ("GuideRateRightAscension", (0.002,)),
        ("UTCDate", ("2026-10-02T13:00:00Z",)),
    ):
        for value in values:
            bench.refused(
                f"{name} Write", f"{value}, optional", bench.set(name, value), NotImplementedException
            )


def tracking(bench: Bench) -> None:
    """Tracking, its rates, and rates beside sidereal ones."""
    scope = bench.scope
    for wanted in (False, True):
        scope.Tracking = wanted
        bench.say("Tracking Write", scope.Tracking is wanted, f"{wanted} is read back")
    rates = list(scope.TrackingRates)
    bench.say("TrackingRates", bool(rates) and rates == list(scope.TrackingRates), "the same each time")
    for rate in rates:
        bench.put("TrackingRate", TrackingRate=int(rate))
        bench.say("TrackingRate Write", int(scope.TrackingRate) == int(rate), f"{int(rate)} is read back")
    for value in (*sorted(set(range(4)) - {int(rate) for rate in rates}), 5, -1):
        bench.refused(
            "TrackingRate Write", f"{value}", bench.set("TrackingRate", value), InvalidValueException
        )


def offset_rates(bench: Bench) -> None:
    """DeclinationRate and RightAscensionRate: set, read back."""
    scope = bench.scope
    for name, unit in (("DeclinationRate", 1.0), ("RightAscensionRate", 1.0 / 15.0)):
        for rate in (0.0, 0.05, -0.05, 40.0, -40.0, 0.0):
            setattr(scope, name, rate * unit)
            good = abs(getattr(scope, name) - rate * unit) < 1e-5 and not scope.Slewing
            bench.say(f"{name} Write", good, f"{rate:g}″/s is read back, not slewing")


def offset_motion(hour_angle_h: float) -> Callable[[Bench], None]:
    """Return the extended check of both rates at an hour angle."""

    def check(bench: Bench) -> None:
        scope = bench.scope
        for name in ("DeclinationRate", "RightAscensionRate"):
            test = f"{name} Write {hour_angle_h:+.1f}"
            bench.slew(hour_angle_h, bench.half_way_up(hour_angle_h))
            for rate in (0.05, -0.05, 40.0, -40.0):
                began = scope.RightAscension, scope.Declination, time.monotonic()
                # ITelescope has the rate in right ascension by sidereal seconds.
                setattr(scope, name, rate if name == "DeclinationRate" else rate / 15.0 * SIDEREAL_A_SECOND)
                time.sleep(OFFSET_S)
                ended = scope.RightAscension, scope.Declination, time.monotonic()
                setattr(scope, name, 0.0)
                seconds = ended[2] - began[2]
                moved = (
                    math.remainder(ended[0] - began[0], 24.0) * 15.0 * 3600.0 / seconds,
                    (ended[1] - began[1]) * 3600.0 / seconds,
                )
                wanted = (0.0, rate) if name == "DeclinationRate" else (rate, 0.0)
                # ConformU allows 0.05, of seconds of right ascension or of arcseconds.
                tolerance = 0.05 if name == "DeclinationRate" else 0.75
                off = max(abs(a - b) for a, b in zip(moved, wanted, strict=True))
                words = (
                    f"{rate:g}″/s moves the mount so"
                    if off <= tolerance
                    else f"{rate:g}″/s: {off:.3f}″/s off"
                )
                bench.say(test, off <= tolerance, words)

    return check


def axes(bench: Bench) -> None:
    """CanMoveAxis, AxisRate and MoveAxis of the three axes."""
    scope = bench.scope
    for name, axis in AXES.items():
        moves = scope.CanMoveAxis(axis)
        bench.say(f"CanMoveAxis:{name}", isinstance(moves, bool), f"{moves}")
        spans = [(rate.Minimum, rate.Maximum) for rate in scope.AxisRates(axis)]
        good = all(0.0 <= low <= high and high > 0.0 for low, high in spans)
        bench.say(f"AxisRate:{name}", good, "positive, or none where the axis does not move")
        bench.say(f"AxisRate:{name}", bool(spans) is moves, "as CanMoveAxis says")
        apart = all(a == b or a[0] > b[1] or b[0] > a[1] for a in spans for b in spans)
        bench.say(f"AxisRate:{name}", apart and len(set(spans)) == len(spans), "no overlaps, no duplicates")
        if not moves:
            bench.refused(
                f"MoveAxis {name}", "CanMoveAxis is false", lambda axis=axis: scope.MoveAxis(axis, 0.0),
                NotImplementedException, InvalidValueException,
            )  # fmt: skip
            continue
        _move(bench, f"MoveAxis {name}", axis, min(low for low, _ in spans), max(high for _, high in spans))


def _move(bench: Bench, test: str, axis: TelescopeAxes, least: float, most: float) -> None:
    scope = bench.scope
    scope.MoveAxis(axis, 0.0)
    bench.say(test, bench.stands(ENDS_WITHIN_S), "a rate of 0")
    below = least / 2.0 if least > 0.0 else -most - 1.0
    bench.refused(test, "below the lowest rate", lambda: scope.MoveAxis(axis, below), InvalidValueException)
    bench.refused(
        test, "above the highest rate", lambda: scope.MoveAxis(axis, most + 1.0), InvalidValueException
    )
    for words, rate in (
        ("lowest", least),
        ("lowest, back", -least),
        ("highest", most),
        ("highest, back", -most),
    ):
        scope.MoveAxis(axis, rate)
        bench.say(test, scope.Slewing is (rate != 0.0), f"Slewing at the {words} rate")
        time.sleep(MOVE_S)
        scope.MoveAxis(axis, 0.0)
        bench.say(test, bench.stands(ENDS_WITHIN_S), f"{words}: ends with a rate of 0")
    for before in (True, False):
        scope.Tracking = before
        scope.MoveAxis(axis, most if before else -most)
        time.sleep(MOVE_S)
        scope.MoveAxis(axis, 0.0)
        bench.stands(ENDS_WITHIN_S)
        bench.say(test, scope.Tracking is before, f"Tracking is {before} afterwards, as before")
    scope.Tracking = True


def abort(bench: Bench) -> None:
    """AbortSlew at rest and in a slew."""
    scope = bench.scope
    scope.AbortSlew()
    bench.stands()
    bench.say("AbortSlew", True, "at rest")
    scope.Tracking = True
    scope.SlewToCoordinatesAsync(bench.right_ascension_at(-3.0), bench.below_65(-3.0))
    time.sleep(1.5)
    bench.say("AbortSlew", scope.Slewing is True, "a slew is under way")
    scope.AbortSlew()
    bench.say("AbortSlew", bench.stands(ENDS_WITHIN_S), "ends a slew")


def home(bench: Bench) -> None:
    """FindHome, and AtHome after it."""
    scope = bench.scope
    scope.FindHome()
    bench.stands()
    scope.Tracking = False
    bench.say("FindHome", scope.AtHome is True, "AtHome")
    bench.say("FindHome", scope.AtPark is False, "not parked")
    scope.Tracking = True


def pulses(bench: Bench) -> None:
    """PulseGuide: one axis, then both."""
    scope = bench.scope
    scope.Tracking = True
    bench.say("PulseGuide", scope.IsPulseGuiding is False, "IsPulseGuiding is false at rest")
    for direction in (GuideDirections.guideEast, GuideDirections.guideNorth):
        scope.PulseGuide(direction, 2000)
        bench.say("PulseGuide", scope.IsPulseGuiding is True, f"{direction.name}: answered while it goes on")
        ended = bench.ends(lambda: bool(scope.IsPulseGuiding), 6.0)
        bench.say("PulseGuide", ended, f"{direction.name}: ends")
    scope.PulseGuide(GuideDirections.guideEast, 2000)
    scope.PulseGuide(GuideDirections.guideNorth, 2000)
    bench.say("PulseGuide", scope.IsPulseGuiding is True, "another axis meanwhile: answered while it goes on")
    bench.say("PulseGuide", bench.ends(lambda: bool(scope.IsPulseGuiding), 9.0), "both end")


def pulse_motion(hour_angle_h: float) -> Callable[[Bench], None]:
    """Return the extended check of PulseGuide at an hour angle."""

    def check(bench: Bench) -> None:
        scope = bench.scope
        bench.slew(hour_angle_h, bench.below_65(hour_angle_h))
        ra_rate = scope.GuideRateRightAscension / SIDEREAL_A_SECOND * PULSE_S * 3600.0
        dec_rate = scope.GuideRateDeclination * PULSE_S * 3600.0
        for direction, wanted in (
            (GuideDirections.guideNorth, (0.0, dec_rate)),
            (GuideDirections.guideSouth, (0.0, -dec_rate)),
            (GuideDirections.guideEast, (ra_rate, 0.0)),
            (GuideDirections.guideWest, (-ra_rate, 0.0)),
        ):
            before = scope.RightAscension, scope.Declination
            scope.PulseGuide(direction, int(PULSE_S * 1000.0))
            bench.ends(lambda: bool(scope.IsPulseGuiding), PULSE_S + 5.0)
            moved = (
                math.remainder(scope.RightAscension - before[0], 24.0) * 15.0 * 3600.0,
                (scope.Declination - before[1]) * 3600.0,
            )
            off = max(abs(a - b) for a, b in zip(moved, wanted, strict=True))
            test = f"PulseGuide {hour_angle_h:+.1f} {direction.name.removeprefix('guide')}"
            good = off <= PULSE_TOLERANCE_ARCSEC
            bench.say(test, good, f"within {PULSE_TOLERANCE_ARCSEC:g}″" if good else f"{off:.2f}″ off")

    return check


def slews(bench: Bench) -> None:
    """The four slews to coordinates and target, and coordinates that there are not."""
    scope = bench.scope
    ways = ("SlewToCoordinates", "SlewToCoordinatesAsync", "SlewToTarget", "SlewToTargetAsync")
    for number, test in enumerate(ways, start=1):
        scope.Tracking = True
        ra_h, dec_deg = bench.right_ascension_at(float(number)), float(number)
        given: dict[str, object] = {"RightAscension": ra_h, "Declination": dec_deg}
        if "Target" in test:
            scope.TargetRightAscension, scope.TargetDeclination = ra_h, dec_deg
            given = {}
        bench.put(test, **given)
        if test.endswith("Async"):
            bench.say(test, scope.Slewing is True, "Slewing when it is answered")
        bench.say(test, bench.stands(), "ends")
        bench.near(test, "there", ra_h, dec_deg, SLEW_TOLERANCE_ARCSEC)
        held = (scope.TargetRightAscension, scope.TargetDeclination)
        bench.say(
            test, max(abs(held[0] - ra_h), abs(held[1] - dec_deg)) < 1e-6, "the target is the one given"
        )
    for test in (*ways, "SyncToCoordinates", "SyncToTarget"):
        bad_coordinates(bench, test)
    for test in ("SlewToAltAz", "SlewToAltAzAsync", "SyncToAltAz"):
        place = {"Azimuth": scope.Azimuth, "Altitude": scope.Altitude}
        bench.refused(
            test, "its Can property is false", lambda test=test, place=place: bench.put(test, **place),
            NotImplementedException,
        )  # fmt: skip


def bad_coordinates(bench: Bench, test: str) -> None:
    """Coordinates out of range, low and high."""
    for said, ra_h, dec_deg in (("Bad L", -1.0, -100.0), ("Bad H", 25.0, 100.0)):
        name = f"{test} ({said})"
        if "Target" in test:
            calls = [bench.set("TargetRightAscension", ra_h), bench.set("TargetDeclination", dec_deg)]
        else:
            calls = [
                lambda at=at: bench.put(test, RightAscension=at[0], Declination=at[1])
                for at in ((ra_h, 10.0), (bench.right_ascension_at(1.0), dec_deg))
            ]
        for words, call in zip(("right ascension", "declination"), calls, strict=True):
            bench.refused(name, f"a bad {words}", call, InvalidValueException)


def targets(bench: Bench) -> None:
    """TargetRightAscension and TargetDeclination are written and read back."""
    scope = bench.scope
    for name, bad, good in (
        ("TargetRightAscension", (-1.0, 25.0), scope.RightAscension),
        ("TargetDeclination", (-91.0, 91.0), 1.0),
    ):
        for value in bad:
            bench.refused(f"{name} Write", f"{value:g}", bench.set(name, value), InvalidValueException)
        setattr(scope, name, good)
        bench.say(f"{name} Write", abs(getattr(scope, name) - good) < 1e-9, "is read back")


def syncs(bench: Bench) -> None:
    """SyncToCoordinates and SyncToTarget, to a place beside and back."""
    scope = bench.scope
    dec_deg = 90.0 - (180.0 - scope.SiteLatitude) / 2.0
    for test in ("SyncToCoordinates", "SyncToTarget"):
        ra_h = bench.right_ascension_at(3.0)
        scope.SlewToCoordinatesAsync(ra_h, dec_deg)
        bench.stands()
        bench.near(test, "at the start", ra_h, dec_deg, SLEW_TOLERANCE_ARCSEC)
        beside = (ra_h - SYNC_OFF_ARCMIN / 900.0) % 24.0, dec_deg - SYNC_OFF_ARCMIN / 60.0
        for words, place in (("beside it", beside), ("back", (ra_h, dec_deg))):
            if test == "SyncToTarget":
                scope.TargetRightAscension, scope.TargetDeclination = place
                scope.SyncToTarget()
            else:
                scope.SyncToCoordinates(*place)
            bench.near(test, f"synced {words}", *place, SLEW_TOLERANCE_ARCSEC)
            held = scope.TargetRightAscension, scope.TargetDeclination
            bench.say(test, held == place, f"{words}: the target is the one given")


def german(bench: Bench) -> None:
    """SideOfPier and DestinationSideOfPier on both sides of the meridian, of a German mount."""
    scope = bench.scope
    bench.say(
        "AlignmentMode", scope.AlignmentMode is AlignmentModes.algGermanPolar, "German, as the profile says"
    )
    bench.slew(3.0, bench.half_way_up(3.0))
    sides = [scope.DestinationSideOfPier(bench.right_ascension_at(at), 45.0) for at in (2.0, -2.0)]
    bench.say("DestinationSideOfPier", len(set(sides)) == 2, "different on both sides of the meridian")
    found = {}
    for hour_angle_h in (-3.0, -9.0, 3.0, 9.0):
        dec_deg = bench.half_way_up(hour_angle_h)
        foretold = scope.DestinationSideOfPier(bench.right_ascension_at(hour_angle_h), dec_deg)
        bench.slew(hour_angle_h, dec_deg)
        found[hour_angle_h] = (PierSide(foretold), scope.SideOfPier)
    for place, test in enumerate(("DestinationSideofPier", "SideofPier")):
        side = {at: both[place] for at, both in found.items()}
        physical = side[-3.0] == side[9.0] and side[3.0] == side[-9.0]
        bench.say(test, not physical, "the pointing state, not the side")
        bench.say(test, side[-3.0] is PierSide.pierWest, "pierWest from -6 h to 0 h")
        bench.say(test, side[3.0] is PierSide.pierEast, "pierEast from 0 h to 6 h")
    bench.refused(
        "SideOfPier Write", "CanSetPierSide is false", bench.set("SideOfPier", 0), NotImplementedException
    )


def park(bench: Bench) -> None:
    """Park, what is refused then, and Unpark."""
    scope = bench.scope
    bench.refused("Unpark", "CanUnpark is false", scope.Unpark, NotImplementedException)
    bench.slew(-3.0, bench.below_65(-3.0))
    for words in ("parks", "twice is harmless"):
        scope.Park()
        bench.stands()
        bench.say("Park", scope.AtPark is True, words)
    ra_h = bench.right_ascension_at(-1.0)
    scope.TargetRightAscension, scope.TargetDeclination = ra_h, 0.0
    place = {"RightAscension": ra_h, "Declination": 0.0}
    calls: dict[str, Callable[[], Any]] = {
        "AbortSlew": scope.AbortSlew,
        "FindHome": scope.FindHome,
        "MoveAxis Primary": lambda: scope.MoveAxis(TelescopeAxes.axisPrimary, 0.0),
        "MoveAxis Secondary": lambda: scope.MoveAxis(TelescopeAxes.axisSecondary, 0.0),
        "PulseGuide": lambda: scope.PulseGuide(GuideDirections.guideEast, 0),
        "SlewToCoordinates": lambda: bench.put("SlewToCoordinates", **place),
        "SlewToCoordinatesAsync": lambda: scope.SlewToCoordinatesAsync(ra_h, 0.0),
        "SlewToTarget": lambda: bench.put("SlewToTarget"),
        "SlewToTargetAsync": scope.SlewToTargetAsync,
        "SyncToCoordinates": lambda: scope.SyncToCoordinates(ra_h, 0.0),
        "SyncToTarget": scope.SyncToTarget,
        "Tracking = true": bench.set("Tracking", True),
    }
    for name, call in calls.items():
        bench.refused(f"Parked:{name}", "when parked", call, ParkedException)
    scope.Tracking = False
    bench.say("Parked:Tracking = false", scope.Tracking is False, "when parked")
    bench.refused("Unpark", "when parked", scope.Unpark, NotImplementedException)


QUICK = (connect, common, properties, tracking, offset_rates, targets)
"""What moves nothing far."""
METHODS = (abort, axes, home, pulses, slews, syncs)
AFTER_EVERYTHING = (park,)
OF_A_GERMAN_MOUNT = (german,)

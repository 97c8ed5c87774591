"""What every mount is to the program: its profile, what it reports, and what it can be sent.

Directions are right ascension and declination in the frame that the mount reports (JNow, its own sidereal
clock), rates are derivatives of those: a right ascension rate of 0 leaves the mount on its sidereal tracking.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import msgspec

from sattrack.mount.geometry import SAME_POLE_DEG, AxisFrame, AxisGeometry, Pole

SIDEREAL_DAY_S = 86164.0905
SIDEREAL_RATE_DEG_S = 360.0 / SIDEREAL_DAY_S
"""Rate of the hour angle of a fixed direction, degrees per second of UTC."""


TICS_PER_TURN = 2**26
"""Of an encoder, by the protocol's paper."""
DTICS_S_PER_DEG_S = TICS_PER_TURN / 360.0 * 10.0
"""Tenths of encoder tics per second in a degree per second."""
LONGEST_STEP_S = 0.5
"""Statuses farther apart tell no rate and no acceleration, and the time between them is not counted."""
LONGEST_STEPS = 3.0
"""But where a mount usually sends them seldom, those count that are up to so many times as far apart."""
STATUS_LOST_S = 2.0
"""Silence of the mount after which it is stopped."""
UNIX_EPOCH_DAYS_FROM_J2000 = -10957.5
TURN_DEG = 360.0
LEAST_SURE_PART = 0.5
"""Of a measured acceleration at least so much counts, however large its sigma is."""


def mean_sidereal_deg(utc_s: float, longitude_deg: float) -> float:
    """Return local mean sidereal time at an instant of UTC (POSIX seconds), degrees, UT1 taken as UTC.

    Linear part of the IAU 1982 expression (Aoki et al. 1982). It differs from apparent sidereal time by up to
    18 arcseconds, which is 1.2 s of a clock: an offset that was measured against it holds for it alone.
    """
    days = utc_s / 86400.0 + UNIX_EPOCH_DAYS_FROM_J2000
    whole = math.floor(days)
    turns = (days - whole) * 360.0 + 0.98564736629 * days + 280.46061837
    return (turns + longitude_deg) % 360.0


def whole_title(title: str) -> str:
    """Return what an axis is called where nothing else says that it is one: "hour angle axis"."""
    return title if title.endswith("axis") else f"{title} axis"


class AxisLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What one axis can do."""

    max_rate_deg_s: float = 6.0
    max_acceleration_deg_s2: float = 10.0
    slew_rate_deg_s: float = 10.0
    max_current_a: float | None = None
    """Drive current above which something is in the way, amperes; None where nothing is known of it."""
    lag_s: float = 0.0
    """Mean delay of the axis' rate behind the commanded one, seconds, beyond command_delay_s and the wait for
    the mount's loop."""

    @property
    def fastest_deg_s(self) -> float:
        """The rate that it has at most, commanded or in a slew of the mount's own."""
        return max(self.max_rate_deg_s, self.slew_rate_deg_s)


class AxesPosition(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the axes stand: hour angle and declination of the direction reported there, degrees."""

    hour_angle_deg: float
    dec_deg: float


class SitePlace(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A place on the Earth, degrees north and east. Raises ValueError for what is none."""

    latitude_deg: float
    longitude_deg: float

    def __post_init__(self) -> None:
        """Check the angles."""
        for name, most in (("latitude_deg", 90.0), ("longitude_deg", 360.0)):
            if not abs(getattr(self, name)) <= most:
                raise ValueError(f"{name} is {getattr(self, name):g}; it goes from {-most:g} to {most:g}")


def _cross(*ends: tuple[float, float]) -> bool:
    """Tell whether the line from the first to the second end crosses that from the third to the fourth."""

    def side(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    a, b, c, d = ends
    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0


class PierZone(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where tube or counterweight would meet the pier: a polygon of hour angle and declination, degrees.

    Corners are directions as the mount reports them while it stands on `side` of the pier, joined by straight
    lines, the last to the first; hour angles may pass ±180 so that the polygon is in one piece. Raises
    ValueError for fewer than three corners, one that is no direction, or sides that cross: such a polygon is
    open where its corners were not meant to leave it so.
    """

    name: str
    corners: tuple[tuple[float, float], ...]
    side: Literal["normal", "beyond_pole", "both"] = "both"

    def __post_init__(self) -> None:
        """Check the corners."""
        if len(self.corners) < 3:
            raise ValueError(f"corners is of {len(self.corners)} in {self.name!r}; a zone needs three")
        for hour_angle, dec in self.corners:
            if not (abs(hour_angle) <= 360.0 and abs(dec) <= 90.0):
                raise ValueError(
                    f"corners is {hour_angle:g}, {dec:g} at one point of {self.name!r}; hour angles go from "
                    "-360 to 360, declinations from -90 to 90"
                )
        sides = list(zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True))
        if abs(sum(x1 * y2 - x2 * y1 for (x1, y1), (x2, y2) in sides)) < 1e-9 or any(
            _cross(*one, *other) for k, one in enumerate(sides) for other in sides[:k]
        ):
            raise ValueError(
                f"corners is a line, or has sides that cross, in {self.name!r}; write the corners in order "
                "round the zone"
            )


class MeasuredMotion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How an axis took up a rate from rest, or came to rest from it, since the mount read the command.

    `seconds` passed until the rate stayed within 2 % of the step. `deg` is the farthest that the axis fell
    behind a motion that began at once, or that it went on after the command to stop.
    """

    rate_deg_s: float
    seconds: float
    seconds_sigma: float
    deg: float
    deg_sigma: float


class CalibrationRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a calibration run found beside the profile's own values, and how sure it was.

    Intervals are (lowest, highest) and hold the truth as far as the run could tell; `clock_offset_s` is the
    mount's sidereal clock, as a UTC instant by the profile's site, minus ours. `both_sides` where the signs
    of the other side of the pier were measured too, by an earlier run. An acceleration's sigma is None where
    the axis stopped too quickly for it to be seen, a lag's where none was measured. An acceleration is the
    axis' limit where `limit_reached`, else what its stop from the fastest rate amounts to. `fastest_deg_s` is
    the fastest rate seen: the axis can do at least that, or no more where `rate_limit_reached`.
    `rate_fields` tells whether RightAscensionRate and DeclinationRate follow the axes; `slewing_field` is
    "true" where Slewing is up while an axis moves, "quiet" where it falls before the axis rests. What was not
    looked at is None.
    """

    utc: str
    program: str
    side_of_pier: Literal["normal", "beyond_pole"]
    ra_gain_sigma: float
    dec_gain_sigma: float
    round_trip_s: float
    round_trip_sigma_s: float
    command_delay_interval_s: tuple[float, float]
    status_delay_interval_s: tuple[float, float]
    clock_offset_interval_s: tuple[float, float]
    clock_drift_ppm: float
    clock_drift_sigma_ppm: float
    status_period_s: float
    status_period_jitter_s: float
    both_sides: bool = False
    ra_acceleration_sigma_deg_s2: float | None = None
    dec_acceleration_sigma_deg_s2: float | None = None
    ra_limit_reached: bool | None = None
    dec_limit_reached: bool | None = None
    ra_starting: MeasuredMotion | None = None
    dec_starting: MeasuredMotion | None = None
    ra_braking: MeasuredMotion | None = None
    dec_braking: MeasuredMotion | None = None
    ra_lag_sigma_s: float | None = None
    dec_lag_sigma_s: float | None = None
    ra_fastest_deg_s: float | None = None
    dec_fastest_deg_s: float | None = None
    ra_rate_limit_reached: bool | None = None
    dec_rate_limit_reached: bool | None = None
    rate_fields: Literal["true", "meaningless"] | None = None
    slewing_field: Literal["true", "quiet", "meaningless"] | None = None


class SkyTerms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What cameras on a mount have shown of it and of themselves: values with one sigma each, by name.

    Of the mount: `turn_x_deg`, `turn_y_deg`, `turn_z_deg` (how its base is turned, about axes in the equator
    towards the meridian and 90° from it, and about the pole), `delay_s` (by which its statuses are dated
    late), `cone_deg`, `index_deg` (beside the axes, along right ascension and declination). Of a camera:
    `rotation_deg` and `scale` (a share) beyond what was set, `clock_s`, `middle_x_deg`, `middle_y_deg`.
    """

    utc: str
    mount: dict[str, tuple[float, float]]
    cameras: dict[str, dict[str, tuple[float, float]]] = {}


class PointingTerms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A pointing model as a star run found it: values with one sigma each, arcseconds, by the terms' names.

    `rms_arcsec` is what was left at the stars it was fitted to, on the sky; `held_out_rms_arcsec` at stars
    that a fit without them predicts, None where there were too few. `sattrack.pointing.terms` defines terms.
    """

    utc: str
    latitude_deg: float
    terms: dict[str, tuple[float, float]]
    rms_arcsec: float
    stars: int
    held_out_rms_arcsec: float | None = None
    axes: Literal["equatorial", "altaz"] | Pole = "equatorial"
    """What the terms are about: an equatorial mount's axes, an azimuth mount's, or those about a pole."""
    passes: int = 0
    """How many recorded passes have corrected it since."""
    signs: Literal["tpoint"] | None = None
    """By whose definition the terms are; None in a table of a time when their signs were others."""

    @property
    def most_deg(self) -> float:
        """How far on the sky the telescope may look beside what is reported: all terms together."""
        return sum(abs(value) for value, _ in self.terms.values()) / 3600.0


class Wave(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One wave of an axis' error: its cycles in a turn, sine and cosine in arcseconds, one sigma of each."""

    cycles: int
    sin_arcsec: float
    cos_arcsec: float
    sigma_arcsec: float

    def __post_init__(self) -> None:
        """Raise ValueError where it is none."""
        if self.cycles < 1:
            raise ValueError(f"cycles is {self.cycles}; it must be 1 or more")

    @property
    def size_arcsec(self) -> float:
        """Its amplitude."""
        return math.hypot(self.sin_arcsec, self.cos_arcsec)


class PeriodicErrors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """By how much each axis stands past the angle that it reports, as waves of that angle.

    The angle of the first axis of an equatorial mount is the mount's sidereal time less the right ascension
    that it reports, of the second the declination, both counted on past the pole; with a geometry the angles
    of its axes. `first_seen_deg` and `second_seen_deg` are the spans of angles, from 0 to 360, that passes
    have covered: elsewhere nothing is known, and nothing corrected. `without_arcsec` and `with_arcsec` are
    what was left on the sky, RMS, at passes that were held out of the fit, without the waves and with them.
    """

    utc: str
    passes: int
    first: tuple[Wave, ...] = ()
    second: tuple[Wave, ...] = ()
    first_seen_deg: tuple[tuple[float, float], ...] = ()
    second_seen_deg: tuple[tuple[float, float], ...] = ()
    without_arcsec: float | None = None
    with_arcsec: float | None = None


MOST = {"period_s": 0.5, "hour_angle_limit_deg": 720.0}
"""Beyond these a number is a slip: rates that wait longer lead no mount, and no cables bear more turns."""
LEAST_PERIOD_S = 0.001
"""A shorter period is microseconds in the wrong unit: no loop turns so often."""


USUAL_TRAVEL_DEG = (-190.0, 190.0)
GOES_SLOWER, LEAST_GOES_WITHIN_S = 1.5, 240.0
"""By how much a mount may be slower than its profile, and how long any may be on its way."""
GERMAN_TRAVEL_DEG = (-270.0, 270.0)
"""Of a mount that slews beyond the pole to any declination."""
POLE_KEPT_DEG = 1.0
"""How far a mount with a geometry stays from where its reports pass over its pole."""


def _told_limits_deg(geometry: AxisGeometry) -> tuple[float, float]:
    """Return from where to where the second axis may turn, for what the mount reports to tell where it is."""
    if not geometry.second_zero_deg:
        return USUAL_TRAVEL_DEG
    low, high = geometry.told_range_deg
    return low + POLE_KEPT_DEG, high - POLE_KEPT_DEG


PierRule = Literal["never", "hour_angle", "ascom"]


def beyond_after_slew(rule: PierRule, hour_angle_deg: float) -> bool:
    """Return whether a slew to an hour angle, -180 to 180, ends beyond the pole.

    That is so above 0 by "hour_angle", and below 0 by "ascom": ASCOM and INDI call a German mount that looks
    east "through the pole", and say pierWest.
    """
    return hour_angle_deg > 0.0 if rule == "hour_angle" else rule == "ascom" and hour_angle_deg < 0.0


class MountProfile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of one mount. Signs, delays and semantics are measured, never assumed for good.

    `ra_rate_sign` is +1 where a positive MoveAxisRateRA increases the hour angle, `dec_rate_sign` +1 where a
    positive MoveAxisRateDec increases the reported declination; those `_beyond_pole` hold while SideOfPier
    says so, None where that side was never measured and is taken to be like the other. A gain is the rate
    that comes of a commanded one, divided by it. `additive` where MoveAxis rates add to sidereal tracking.
    `move_axis` is "held" where the latest rates act while the flag is up, and "edge" where they are read as
    the flag rises and stay in force after its fall. Delays are seconds: the mean one from our send call to
    the mount's mailbox, and the shortest one from its sample to our socket, as samples are dated by the
    fastest arrivals. `watchdog_s` is the silence after which the mount stops by itself, None where it never
    does. `readings` are the types of the doubtful fields of a status. `repeat_rates` tells when rates go out
    twice in a period (`xerxes.session`): "when_lossy" while statuses are being lost, as commands
    then are too; a copy helps nowhere else, so a good link carries the paper's 20 datagrams a second.
    """

    name: str = "xerxes-default"
    ra: AxisLimits = AxisLimits()
    dec: AxisLimits = AxisLimits()
    ra_rate_sign: Literal[-1, 1] = 1
    dec_rate_sign: Literal[-1, 1] = 1
    ra_rate_sign_beyond_pole: Literal[-1, 1] | None = None
    dec_rate_sign_beyond_pole: Literal[-1, 1] | None = None
    ra_rate_gain: float = 1.0
    dec_rate_gain: float = 1.0
    additive: bool = True
    move_axis: Literal["held", "edge"] = "held"
    hour_angle_limit_deg: float = 200.0
    """How far the hour angle axis may turn either way of the meridian, the cables counted."""
    dec_axis_limits_deg: tuple[float, float] = USUAL_TRAVEL_DEG
    """How far the declination axis may turn; beyond 90° either way it stands past a pole."""
    pier_rule: PierRule = "never"
    """Where a slew ends: see `beyond_after_slew`."""
    slew_path: Literal["any", "together"] = "any"
    """How the axes go in a slew: each in its own time, or on a straight line so that they arrive together."""
    pier_zones: tuple[PierZone, ...] = ()
    stands_at: SitePlace | None = None
    """The site that the profile was made at; None for a profile that may be used anywhere."""
    through_pole: bool = False
    """Whether following may go through the celestial pole, on to the other side of the pier."""
    solar_filter: bool = False
    """Whether a filter is fitted through which the Sun may be looked at."""
    period_s: float = 0.05
    command_delay_s: float = 0.0003
    status_delay_s: float = 0.0001
    abort_delay_s: float = 0.0
    """How much later than any other command an abort acts; until then the axes go on as they did."""
    clock_offset_s: float | None = None
    """The mount's sidereal clock ahead of local mean sidereal time by UTC at the site, seconds; None where it
    is not known, and arrivals must tell when a status was sampled."""
    dated_by_requests: bool = False
    """Whether our own clock dates positions, at the middle of the request for each: Alpaca's and INDI's. The
    mount's address decides it."""
    encoder_tics: int = 2**26
    watchdog_s: float | None = None
    repeat_rates: Literal["never", "when_lossy", "always"] = "when_lossy"
    park: AxesPosition | None = None
    home: AxesPosition | None = None
    readings: dict[str, Reading] = {}
    calibration: CalibrationRecord | None = None
    sky: SkyTerms | None = None
    """What cameras have shown at earlier passes; what the next one begins with."""
    pointing: PointingTerms | None = None
    """By how much reports differ from where the telescope points; None where that is not known."""
    periodic: PeriodicErrors | None = None
    """Errors of the axes that repeat in a turn; None where none are known."""
    geometry: AxisGeometry | None = None
    """How the axes lie; None for an equatorial mount. Hour angles and declinations of this profile (limits,
    zones, park, home, and those of `ra` and `dec`) are then the angles of the first and the second axis."""

    @property
    def behind_gateway(self) -> bool:
        """Whether it is an Alpaca or INDI telescope: positions of these alone are dated by requests."""
        return self.dated_by_requests

    @property
    def frame(self) -> AxisFrame | None:
        """The axes in space, None for an equatorial mount."""
        if self.geometry is None or self.stands_at is None:
            return None
        return AxisFrame(self.geometry, self.stands_at.latitude_deg)

    def with_geometry(self, geometry: AxisGeometry) -> MountProfile:
        """Return the profile with another geometry, its second axis kept where reports tell where it is.

        Limits that came of the former geometry's zero points are no limits any more.
        """
        former = USUAL_TRAVEL_DEG if self.geometry is None else _told_limits_deg(self.geometry)
        own = [
            free if math.isclose(limit, told, abs_tol=1e-6) else limit
            for limit, told, free in zip(self.dec_axis_limits_deg, former, USUAL_TRAVEL_DEG, strict=True)
        ]
        told = _told_limits_deg(geometry)
        limits = max(own[0], told[0]), min(own[1], told[1])
        return msgspec.structs.replace(self, geometry=geometry, dec_axis_limits_deg=limits)

    def goes_within_s(self, by_rates: bool = False) -> float:
        """Return the time after which a mount that goes somewhere, slewing or by rates, is given up, seconds.

        Each axis may go once round meanwhile, and half as long again; four minutes at least.
        """
        axes = (self.ra, self.dec)
        slowest = min(axis.slew_rate_deg_s for axis in axes)
        if by_rates:
            slowest = min(slowest, *(axis.max_rate_deg_s for axis in axes))
        return max(LEAST_GOES_WITHIN_S, GOES_SLOWER * 360.0 / slowest)

    @property
    def first_axis_middle_deg(self) -> float:
        """The angle of the first axis within half a turn of which a session that begins takes it to be.

        By "ascom" slews end from 0 to 180°, and following goes on past both: 180° must not become -180°.
        """
        return 90.0 if self.pier_rule == "ascom" else 0.0

    @property
    def own_axes(self) -> Literal["equatorial", "altaz"] | Pole:
        """What the terms of a pointing model are about that a star run finds."""
        if self.geometry is None:
            return "equatorial"
        level = self.geometry.pole_altitude_deg >= 90.0 - SAME_POLE_DEG
        return "altaz" if level else self.geometry.pole

    def axis_titles(self, first: str = "hour angle") -> tuple[str, str]:
        """Return what the axes are called: those of a geometry are none of hour angle and declination."""
        return (first, "declination") if self.geometry is None else ("first axis", "second axis")

    def axis_names(self, first: str = "hour angle") -> tuple[str, str]:
        """Return what the axes are called in a sentence."""
        one, other = self.axis_titles(first)
        return (one, other) if self.geometry is None else (f"the {one}", f"the {other}")

    @property
    def dated_within_s(self) -> float | None:
        """By how much the instants of samples may be off, as the calibration tells; None without one."""
        record = self.calibration
        if record is None:
            return None
        if self.clock_offset_s is not None:
            (low, high), taken = record.clock_offset_interval_s, self.clock_offset_s
        else:
            (low, high), taken = record.status_delay_interval_s, self.status_delay_s
        return max(high - taken, taken - low)

    @property
    def braking_deg_s2(self) -> tuple[float, float]:
        """Accelerations to predict stops with, right ascension first: measured ones less two sigma."""
        record = self.calibration
        ra, dec = self.ra.max_acceleration_deg_s2, self.dec.max_acceleration_deg_s2
        if record is None:
            return ra, dec
        return (
            _surely(ra, record.ra_acceleration_sigma_deg_s2),
            _surely(dec, record.dec_acceleration_sigma_deg_s2),
        )

    def signs(self, beyond_pole: bool) -> tuple[int, int]:
        """Return the signs of the two axes' rates, right ascension first, on one side of the pier."""
        if not beyond_pole:
            return self.ra_rate_sign, self.dec_rate_sign
        return (
            self.ra_rate_sign_beyond_pole or self.ra_rate_sign,
            self.dec_rate_sign_beyond_pole or self.dec_rate_sign,
        )

    def __post_init__(self) -> None:
        """Raise ValueError, naming the field, where it cannot be one of a mount."""
        if not self.name.strip() or not self.name.isprintable():
            raise ValueError(f"name is {self.name!r}; give a word or more, in one line")
        positive = {
            "ra.max_rate_deg_s": self.ra.max_rate_deg_s,
            "ra.max_acceleration_deg_s2": self.ra.max_acceleration_deg_s2,
            "ra.slew_rate_deg_s": self.ra.slew_rate_deg_s,
            "dec.max_rate_deg_s": self.dec.max_rate_deg_s,
            "dec.max_acceleration_deg_s2": self.dec.max_acceleration_deg_s2,
            "dec.slew_rate_deg_s": self.dec.slew_rate_deg_s,
            "ra_rate_gain": self.ra_rate_gain,
            "dec_rate_gain": self.dec_rate_gain,
            "period_s": self.period_s,
            "hour_angle_limit_deg": self.hour_angle_limit_deg,
            "encoder_tics": self.encoder_tics,
        }
        if self.watchdog_s is not None:
            positive["watchdog_s"] = self.watchdog_s
        for name, value in positive.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} is {value:g}; it must be above 0")
        for name, most in MOST.items():
            if positive[name] > most:
                raise ValueError(f"{name} is {positive[name]:g}; give {most:g} at most")
        if self.period_s < LEAST_PERIOD_S:
            raise ValueError(f"period_s is {self.period_s:g}; give {LEAST_PERIOD_S:g} at least")
        delays = {
            "command_delay_s": self.command_delay_s,
            "status_delay_s": self.status_delay_s,
            "abort_delay_s": self.abort_delay_s,
            "ra.lag_s": self.ra.lag_s,
            "dec.lag_s": self.dec.lag_s,
        }
        for name, value in delays.items():
            if not 0.0 <= value < 5.0:
                raise ValueError(f"{name} is {value:g}; delays are 0 s or more, and below 5 s")
        if self.clock_offset_s is not None and not math.isfinite(self.clock_offset_s):
            raise ValueError(f"clock_offset_s is {self.clock_offset_s:g}; it must be a number")
        fields = [name for name in Readings.__struct_fields__ if name != "tracking"]
        if unknown := self.readings.keys() - fields:
            raise ValueError(f"readings.{min(unknown)} is no field; give one of {', '.join(fields)}")
        self._check_travel()
        self._check_geometry()

    def _check_geometry(self) -> None:
        if self.geometry is None:
            return
        if self.stands_at is None:
            raise ValueError("geometry is given without stands_at: axes lie so at one site only; give both")
        known = None if self.pointing is None else self.pointing.axes
        if known == "equatorial" or (known == "altaz" and self.geometry.kind != "alt-azimuth"):
            raise ValueError(
                f"pointing is a model of {known} axes, and geometry is {self.geometry.kind}: leave one of "
                "them out; a star run with the geometry makes a model of it"
            )
        if self.through_pole:
            raise ValueError("through_pole is true: only equatorial mounts are led through their pole")

    def _check_travel(self) -> None:
        low, high = self.dec_axis_limits_deg
        if not (-TURN_DEG < low < high < TURN_DEG and low < 90.0 and high > -90.0):
            raise ValueError(
                f"dec_axis_limits_deg is {low:g} to {high:g}; give a lower and a higher angle that "
                "leave some of -90 to 90"
            )
        currents = {"ra.max_current_a": self.ra.max_current_a, "dec.max_current_a": self.dec.max_current_a}
        for name, limit in currents.items():
            if limit is not None and not (math.isfinite(limit) and limit > 0.0):
                raise ValueError(f"{name} is {limit:g}; it must be above 0")
        for name, place in (("park", self.park), ("home", self.home)):
            if place is None:
                continue
            if not abs(math.remainder(place.hour_angle_deg, TURN_DEG)) <= self.hour_angle_limit_deg:
                raise ValueError(
                    f"{name} is at hour angle {place.hour_angle_deg:g}, beyond hour_angle_limit_deg, "
                    f"{self.hour_angle_limit_deg:g}"
                )
            if not low <= place.dec_deg <= high:
                raise ValueError(
                    f"{name} is at declination {place.dec_deg:g}, "
                    f"outside dec_axis_limits_deg, {low:g} to {high:g}"
                )


def horizon_latitude_deg(profile: MountProfile, latitude_deg: float) -> float:
    """Return the latitude at which an equatorial mount sees the horizon as this one does at a site's."""
    return latitude_deg if profile.geometry is None else profile.geometry.pole_altitude_deg


def _surely(value: float, sigma: float | None) -> float:
    return value if sigma is None else max(value - 2.0 * sigma, LEAST_SURE_PART * value)


class Status(msgspec.Struct, frozen=True, gc=False):
    """What one status datagram says; names, units and meanings are those of `xerxes.datagrams.STATUS_FIELDS`.

    None stands for a number that the mount sends as infinite, or as none.
    """

    altitude_deg: float | None = 0.0
    azimuth_deg: float | None = 0.0
    dec_deg: float = 0.0
    dec_rate_dtics_s: float = 0.0
    ra_h: float = 0.0
    ra_rate_dtics_s: float = 0.0
    sidereal_h: float = 0.0
    site_height_m: float | None = 0.0
    site_latitude_deg: float | None = 0.0
    site_longitude_deg: float | None = 0.0
    target_dec_deg: float | None = 0.0
    target_ra_h: float | None = 0.0
    counter: int = 0
    dec_guide_rate_dtics_s: float | None = 3500.0
    ra_guide_rate_dtics_s: float | None = 3500.0
    dec_current_10ma: int = 0
    ra_current_10ma: int = 0
    at_home: bool = False
    at_park: bool = False
    connected: bool = True
    does_refraction: bool = False
    equatorial_system: int = 0
    pulse_guiding: bool = False
    side_of_pier: bool = False
    slewing: bool = False
    tracking: bool = True
    tracking_rate: int = 0
    ack_move_dec: bool = False
    ack_move_ra: bool = False
    utc_1: int = 0
    utc_2: int = 0
    utc_3: int = 0
    ra_drive_status_1: int = 0
    ra_drive_status_2: int = 0
    dec_drive_status_1: int = 0
    dec_drive_status_2: int = 0
    ack_abort: bool = False
    ack_sync: bool = False
    ack_pulse_guide: bool = False
    ack_slew: bool = False
    spare: int = 0

    @property
    def site_deg(self) -> tuple[float, float] | None:
        """Where the mount believes it stands, degrees north and east; None where it was never set."""
        latitude_deg, longitude_deg = self.site_latitude_deg, self.site_longitude_deg
        if latitude_deg is None or longitude_deg is None or latitude_deg == longitude_deg == 0.0:
            return None
        return latitude_deg, longitude_deg


Reading = Literal["int64", "double"]


class Readings(msgspec.Struct, frozen=True):
    """How a mount reads what the protocol's paper gives two readings; None where it has not shown yet."""

    dec_rate_dtics_s: Reading | None = None
    ra_rate_dtics_s: Reading | None = None
    counter: Reading | None = None
    dec_guide_rate_dtics_s: Reading | None = None
    ra_guide_rate_dtics_s: Reading | None = None
    tracking: str | None = None
    """"always true", or "the opposite of slewing"."""


class StatusSample(msgspec.Struct, frozen=True, gc=False):
    """One accepted status of the mount.

    `arrival_utc_s` is ours, `sidereal_h` the mount's own date of the sample (local sidereal hours); the drive
    rates are those of the axes themselves, sidereal tracking included, as the mount tells them. Where its
    rate fields or Slewing mean nothing, they say what its positions do.
    """

    counter: int
    arrival_utc_s: float
    sidereal_h: float
    ra_deg: float
    dec_deg: float
    slewing: bool
    does_refraction: bool
    ra_drive_deg_s: float
    dec_drive_deg_s: float
    beyond_pole: bool = False
    move_acknowledged: bool = False
    """Whether this is the first status that acknowledges the MoveAxis flags that were raised last."""


class Hold(msgspec.Struct, frozen=True, gc=False):
    """Ask for nothing: the mount goes on with what it does by itself, at rest after a stop."""


class Slew(msgspec.Struct, frozen=True, gc=False, tag="slew", forbid_unknown_fields=True):
    """Go to a direction of date and track the sky there; asked for by hand, RA is 0 to below 360."""

    ra_deg: float
    dec_deg: float


class MoveAxes(msgspec.Struct, frozen=True, gc=False):
    """Move at these rates of the reported right ascension (not times cos Dec) and declination."""

    ra_rate_deg_s: float
    dec_rate_deg_s: float


class Stop(msgspec.Struct, frozen=True, gc=False):
    """Bring both axes to rest."""


Motion = Hold | Slew | MoveAxes | Stop


class Cleared(msgspec.Struct, frozen=True, gc=False):
    """A motion that safety has let through: nothing else makes one."""

    motion: Motion


class Stance(NamedTuple):
    """How the mount stands when a request comes: its clock and direction, degrees, and whether it moves."""

    sidereal_deg: float
    ra_deg: float
    dec_deg: float
    slewing: bool
    drives_at_rest: bool
    """Whether both axes stand or follow the sky, by their positions."""
    beyond_pole: bool = False


class Seen(msgspec.Struct, frozen=True, gc=False):
    """What one status tells: when it came by our clock, and how the mount stands by its own.

    `utc_s` POSIX seconds, None where nobody knows; degrees, amperes.
    """

    utc_s: float | None
    sidereal_deg: float
    ra_deg: float
    dec_deg: float
    beyond_pole: bool = False
    slewing: bool = False
    ra_current_a: float = 0.0
    dec_current_a: float = 0.0


def stance_of(status: Status, at_rest: bool, frame: AxisFrame | None) -> Stance:
    """Return how a mount stands, for safety to judge; `at_rest` where its positions say so.

    With a `frame` right ascension and declination are those of the axes.
    """
    sidereal_deg, ra_deg, dec_deg = status.sidereal_h * 15.0, status.ra_h * 15.0, status.dec_deg
    if frame is not None:
        first_deg, dec_deg, _, _ = frame.of_report(sidereal_deg - ra_deg, dec_deg, 0.0, 0.0)
        ra_deg = (sidereal_deg - first_deg) % 360.0
    return Stance(
        sidereal_deg=sidereal_deg,
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        slewing=status.slewing,
        drives_at_rest=at_rest,
        beyond_pole=status.side_of_pier,
    )


def seen_of(status: Status, arrival_utc_s: float) -> Seen:
    """Return what a status that came at an instant (POSIX seconds of UTC) tells safety."""
    return Seen(
        utc_s=arrival_utc_s,
        sidereal_deg=status.sidereal_h * 15.0,
        ra_deg=status.ra_h * 15.0,
        dec_deg=status.dec_deg,
        beyond_pole=status.side_of_pier,
        slewing=status.slewing,
        ra_current_a=status.ra_current_10ma / 100.0,
        dec_current_a=status.dec_current_10ma / 100.0,
    )


class LinkView(msgspec.Struct, frozen=True):
    """State of the link to the mount: counted datagrams, and the age of the last status."""

    state: str
    age_s: float | None
    sent: int
    received: int
    lost: int
    late: int
    duplicate: int
    rejected: int
    rate_hz: float | None
    """Statuses a second that the mount sends, over the last seconds."""
    jitter_ms: float | None = None
    """Standard deviation of the intervals between them."""
    restarts: int = 0
    strangers: int = 0
    """Datagrams from other hosts, dropped."""
    doubled_launches: int = 0
    """Commands that the mount acknowledged a second time, as a late or repeated datagram makes it."""
    foreign_acks: int = 0
    """Acknowledgements of what was never sent from here."""
    delay_ms: float | None = None
    """From the last status' date to its arrival, as it is dated by the fastest ones and the profile."""
    clock_offset_s: float | None = None
    """The mount's sidereal clock minus local mean sidereal time by our UTC at the site, seconds."""

"""The simulated telescope without I/O: two axes with servos, tracking, MoveAxis, slews. Time is an argument.

Its settings say how its driver reads the standard, and how well it does. The axes are hour angle and
declination, or with `alignment = "altaz"` azimuth and altitude. Instants are UTC as POSIX seconds and rise
from call to call. Sidereal time is the apparent one (ERFA).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import erfa
import msgspec

from sattrack.mount.model import SIDEREAL_RATE_DEG_S

LONGEST_S = 10.0
EquatorialSystem = Literal["jnow", "j2000"]
AlignmentMode = Literal["altaz", "polar", "german"]
STEP_S = 0.002
SLEW_GAIN_HZ = 4.0
ARRIVED_DEG = 0.5 / 3600.0
ARRIVED_DEG_S = 1.0 / 3600.0
STANDS_DEG_S = 0.5 / 3600.0
MJD_ZERO = 2400000.5
MJD_OF_POSIX_ZERO = 40587.0
TT_AHEAD_OF_UTC_S = 69.184
TURN_DEG = 360.0
GUIDED_LATELY_S = 0.5
"""For how long after a guide pulse an axis is not asked whether it stands: that motion is no slew."""
NORTH, SOUTH, EAST, WEST = range(4)
INVALID_VALUE, NOT_CONNECTED = 0x401, 0x407
INVALID_WHILE_PARKED, INVALID_OPERATION = 0x408, 0x40B


class TelescopeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One simulated telescope. Degrees, seconds, hertz.

    `additive` where MoveAxis adds to tracking in place of replacing it; a sign of -1 turns an axis round;
    `latency_s` is what a request takes to the driver and back together, `jitter_s` how much either way of
    that each takes at random. `rates_deg_s` are AxisRates: pairs of the lowest and the highest.
    """

    latitude_deg: float = 52.1541
    longitude_deg: float = 4.4908
    height_m: float = 0.0
    hour_angle_deg: float = 50.0
    """Where it stands at first."""
    dec_deg: float = 15.0
    additive: bool = False
    ra_sign: Literal[-1, 1] = 1
    dec_sign: Literal[-1, 1] = 1
    ra_gain: float = 1.0
    dec_gain: float = 1.0
    system: EquatorialSystem = "jnow"
    alignment: AlignmentMode = "polar"
    """What its axes are: those of "altaz" turn in azimuth and altitude, and "german" ones end slews to the
    east of the meridian beyond the pole."""
    tells_alignment: bool = True
    """Whether its driver answers AlignmentMode."""
    rates_deg_s: tuple[tuple[float, float], ...] = ((0.0, 6.0),)
    acceleration_deg_s2: float = 10.0
    slew_rate_deg_s: float = 6.0
    servo_hz: float = 5.0
    """Frequency at which the critically damped servo follows its reference."""
    tracking: bool = True
    parked: bool = False
    refuses_connection: bool = False
    can_slew: bool = True
    can_sync: bool = True
    guide_rate_deg_s: float = 0.0
    """How much a guide pulse adds to an axis' rate; 0 where it has no guide pulses."""
    device_state: bool = True
    """Whether one request returns the whole state (Platform 7), or each property needs its own."""
    latency_s: float = 0.030
    jitter_s: float = 0.002
    held_up_share: float = 0.0
    """Share of the ways there, and of those back, that take `held_up_s` longer."""
    held_up_s: float = 0.1
    cache_s: float = 0.0
    """Places are those of the last turn of a loop with this period; 0 gives them as they are."""
    move_interval_s: float = 0.0
    """A MoveAxis that changes an axis' rate sooner after the last one is refused."""
    seed: int = 1

    def __post_init__(self) -> None:
        """Raise ValueError, naming the field, where a number cannot be one of a telescope."""
        above = {
            "ra_gain": self.ra_gain,
            "dec_gain": self.dec_gain,
            "acceleration_deg_s2": self.acceleration_deg_s2,
            "slew_rate_deg_s": self.slew_rate_deg_s,
            "servo_hz": self.servo_hz,
        }
        for name, value in above.items():
            if not value > 0.0:
                raise ValueError(f"{name} is {value:g}; it must be above 0")
        least = {
            "latency_s": self.latency_s,
            "jitter_s": self.jitter_s,
            "held_up_share": self.held_up_share,
            "held_up_s": self.held_up_s,
            "cache_s": self.cache_s,
            "move_interval_s": self.move_interval_s,
            "guide_rate_deg_s": self.guide_rate_deg_s,
        }
        for name, value in least.items():
            if not 0.0 <= value <= LONGEST_S:
                raise ValueError(f"{name} is {value:g}; it goes from 0 to {LONGEST_S:g}")


class RefusedError(Exception):
    """The driver refuses a request: the standard's number and words."""

    def __init__(self, number: int, words: str) -> None:
        super().__init__(words)
        self.number = number
        self.words = words


class SimulatedPlace(NamedTuple):
    """Where the telescope truly points at an instant: right ascension and declination of date, degrees."""

    utc_s: float
    ra_deg: float
    dec_deg: float


@dataclass(slots=True)
class SimulatedAxis:
    """A reference that keeps within its acceleration, and a critically damped servo that follows it."""

    acceleration_deg_s2: float
    servo_hz: float
    position_deg: float
    rate_deg_s: float = 0.0
    reference_deg: float = field(init=False)
    reference_deg_s: float = 0.0
    _stiffness: float = field(init=False)
    _damping: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin at rest upon the reference."""
        self.reference_deg = self.position_deg
        omega = 2.0 * math.pi * self.servo_hz
        self._stiffness, self._damping = omega**2, 2.0 * omega

    def step(self, wanted_deg_s: float, seconds: float) -> None:
        """Let time pass with a rate asked for."""
        most = self.acceleration_deg_s2 * seconds
        self.reference_deg_s += max(-most, min(most, wanted_deg_s - self.reference_deg_s))
        self.reference_deg += self.reference_deg_s * seconds
        pull = self._stiffness * (self.reference_deg - self.position_deg)
        pull += self._damping * (self.reference_deg_s - self.rate_deg_s)
        self.rate_deg_s += pull * seconds
        self.position_deg += self.rate_deg_s * seconds


class SimulatedTelescope:
    """One telescope from the instant it is switched on."""

    def __init__(self, settings: TelescopeSettings, utc_s: float) -> None:
        self.settings = settings
        self.connected = False
        self.parked = settings.parked
        self._utc_s = utc_s
        self._tracking = settings.tracking
        self._moves: list[float | None] = [None, None]
        """Rates of MoveAxis as they were asked for; None on an axis that has none."""
        self._moved_s = [-math.inf, -math.inf]
        self._target: tuple[float, float] | None = None
        self._pulses = [(-math.inf, 0.0), (-math.inf, 0.0)]
        """Of the last guide pulse of each axis, its end and what it adds to the rate."""
        self._ra_offset_deg = self._dec_offset_deg = 0.0
        self._cached: SimulatedPlace | None = None
        self._begun_s = utc_s
        first_deg, second_deg = self._axes_of(settings.hour_angle_deg, settings.dec_deg)
        self._first = SimulatedAxis(settings.acceleration_deg_s2, settings.servo_hz, first_deg)
        self._second = SimulatedAxis(settings.acceleration_deg_s2, settings.servo_hz, second_deg)
        if self._tracking:
            for axis, rate_deg_s in zip((self._first, self._second), self._sky(), strict=True):
                axis.rate_deg_s = axis.reference_deg_s = rate_deg_s

    def run_to(self, utc_s: float) -> None:
        """Let time pass up to an instant."""
        first_deg_s, second_deg_s = self._wanted()
        steady = self._target is None and self.settings.alignment != "altaz" and not self._guided(0.0)
        while self._utc_s < utc_s:
            seconds = min(STEP_S, utc_s - self._utc_s)
            if self.settings.cache_s and self._due(seconds):
                self._cached = self._place()
            if not steady:
                first_deg_s, second_deg_s = self._wanted()
            self._first.step(first_deg_s, seconds)
            self._second.step(second_deg_s, seconds)
            self._utc_s += seconds
        if self._target is not None and self._arrived():
            self._target = None

    def truth(self, utc_s: float) -> SimulatedPlace:
        """Return where it truly points, in the frame of date in which it was synced."""
        self.run_to(utc_s)
        return self._place()

    def axes(self, utc_s: float) -> tuple[float, float, float, float]:
        """Return the true angles of both axes, degrees, and their rates."""
        self.run_to(utc_s)
        first, second = self._first, self._second
        return first.position_deg, second.position_deg, first.rate_deg_s, second.rate_deg_s

    def reported(self, utc_s: float) -> SimulatedPlace:
        """Return what its driver says of its place: perhaps an old one, and in the driver's own equinox."""
        self.run_to(utc_s)
        place = self._place() if self._cached is None else self._cached
        if self.settings.system == "jnow":
            return place
        return SimulatedPlace(place.utc_s, *turned(place.ra_deg, place.dec_deg, utc_s, to_j2000=True))

    def sidereal_h(self, utc_s: float) -> float:
        """Return the driver's sidereal time, hours."""
        return _apparent_sidereal_deg(utc_s, self.settings.longitude_deg) / 15.0

    def beyond_pole(self, utc_s: float) -> bool:
        """Return whether its second axis stands past the pole: pierWest."""
        self.run_to(utc_s)
        return self._beyond()

    def slewing(self, utc_s: float) -> bool:
        """Return whether it goes somewhere, or moves by MoveAxis, or has not come to rest from that."""
        self.run_to(utc_s)
        stands = self._stands() or self._guided(GUIDED_LATELY_S)
        return self._target is not None or self._moves != [None, None] or not stands

    def guiding(self, utc_s: float) -> bool:
        """Return whether a guide pulse is under way."""
        self.run_to(utc_s)
        return self._guided(0.0)

    def tracks(self) -> bool:
        """Return whether tracking is on."""
        return self._tracking

    def track(self, on: bool, utc_s: float) -> None:
        """Switch tracking."""
        self.run_to(utc_s)
        self._check_moves()
        self._tracking = on

    def move_axis(self, axis: int, rate_deg_s: float, utc_s: float) -> None:
        """Move one axis at a rate, 0 to end that. Raises Refused."""
        self.run_to(utc_s)
        self._check_moves()
        if axis not in (0, 1):
            raise RefusedError(INVALID_VALUE, f"Axis {axis} does not move")
        inside = any(low <= abs(rate_deg_s) <= high for low, high in self.settings.rates_deg_s)
        if rate_deg_s != 0.0 and not inside:
            raise RefusedError(INVALID_VALUE, f"Rate {rate_deg_s} is not in AxisRates")
        if utc_s - self._moved_s[axis] < self.settings.move_interval_s:
            raise RefusedError(INVALID_OPERATION, "MoveAxis came too soon after the last one")
        self._moved_s[axis] = utc_s
        self._target = None
        self._moves[axis] = rate_deg_s if rate_deg_s != 0.0 else None

    def slew(self, ra_deg: float, dec_deg: float, utc_s: float) -> None:
        """Go to a direction in the driver's equinox. Raises Refused."""
        self.run_to(utc_s)
        self._check_moves()
        if not self._tracking:
            raise RefusedError(INVALID_OPERATION, "Slews need Tracking to be on")
        if self.settings.system == "j2000":
            ra_deg, dec_deg = turned(ra_deg, dec_deg, utc_s, to_j2000=False)
        self._moves = [None, None]
        self._target = (ra_deg, dec_deg)

    def sync(self, ra_deg: float, dec_deg: float, utc_s: float) -> None:
        """Report a direction, in the driver's equinox, for where it points. Raises Refused."""
        self.run_to(utc_s)
        self._check_moves()
        if self.settings.system == "j2000":
            ra_deg, dec_deg = turned(ra_deg, dec_deg, utc_s, to_j2000=False)
        place = self._place()
        self._ra_offset_deg += math.remainder(ra_deg - place.ra_deg, TURN_DEG)
        self._dec_offset_deg += dec_deg - place.dec_deg

    def pulse(self, direction: int, milliseconds: int, utc_s: float) -> None:
        """Begin a guide pulse. Raises Refused."""
        self.run_to(utc_s)
        self._check_moves()
        if direction not in (NORTH, SOUTH, EAST, WEST) or milliseconds < 0:
            raise RefusedError(INVALID_VALUE, f"Direction {direction}, Duration {milliseconds} is no pulse")
        rate = self.settings.guide_rate_deg_s
        added = rate if direction in (NORTH, WEST) else -rate
        self._pulses[direction in (NORTH, SOUTH)] = utc_s + milliseconds / 1000.0, added

    def abort(self, utc_s: float) -> None:
        """End a slew. MoveAxis goes on, as with many drivers. Raises Refused."""
        self.run_to(utc_s)
        self._check_moves()
        self._target = None

    def park(self, parked: bool) -> None:
        """Be parked, or not, where it stands."""
        self.parked = parked
        self._moves, self._target = [None, None], None

    def _check_moves(self) -> None:
        if self.parked:
            raise RefusedError(INVALID_WHILE_PARKED, "The telescope is parked")

    def _place(self) -> SimulatedPlace:
        sidereal_deg = _apparent_sidereal_deg(self._utc_s, self.settings.longitude_deg)
        hour_angle_deg, dec_deg = self._first.position_deg, self._second.position_deg
        if self.settings.alignment == "altaz":
            hour_angle, dec = erfa.ae2hd(
                math.radians(hour_angle_deg), math.radians(dec_deg), math.radians(self.settings.latitude_deg)
            )
            hour_angle_deg, dec_deg = math.degrees(hour_angle), math.degrees(dec)
        elif self._beyond():
            hour_angle_deg, dec_deg = self._other_side(hour_angle_deg, dec_deg)
        ra_deg = (sidereal_deg - hour_angle_deg + self._ra_offset_deg) % TURN_DEG
        return SimulatedPlace(self._utc_s, ra_deg, dec_deg + self._dec_offset_deg)

    def _axes_of(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return where both axes point to a direction."""
        if self.settings.alignment == "german" and hour_angle_deg < 0.0:
            return self._other_side(hour_angle_deg, dec_deg)
        if self.settings.alignment != "altaz":
            return hour_angle_deg, dec_deg
        azimuth, altitude = erfa.hd2ae(
            math.radians(hour_angle_deg), math.radians(dec_deg), math.radians(self.settings.latitude_deg)
        )
        return math.degrees(azimuth), math.degrees(altitude)

    def _beyond(self) -> bool:
        return self.settings.alignment == "german" and abs(self._second.position_deg) > 90.0

    def _other_side(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        return first_deg + 180.0, math.copysign(180.0, self.settings.latitude_deg) - second_deg

    def _sky(self) -> tuple[float, float]:
        """Return the rates of both axes that follow the sky."""
        if self.settings.alignment != "altaz":
            return SIDEREAL_RATE_DEG_S, 0.0
        azimuth, altitude, latitude = (
            math.radians(angle_deg)
            for angle_deg in (
                self._first.position_deg,
                self._second.position_deg,
                self.settings.latitude_deg,
            )
        )
        turning = math.sin(latitude) - math.cos(latitude) * math.cos(azimuth) * math.tan(altitude)
        rising = math.cos(latitude) * math.sin(azimuth)
        return SIDEREAL_RATE_DEG_S * turning, SIDEREAL_RATE_DEG_S * rising

    def _due(self, seconds: float) -> bool:
        turn = math.floor((self._utc_s - self._begun_s) / self.settings.cache_s)
        before = math.floor((self._utc_s - seconds - self._begun_s) / self.settings.cache_s)
        return self._cached is None or turn != before

    def _guided(self, lately_s: float) -> bool:
        return any(until_s + lately_s > self._utc_s for until_s, _ in self._pulses)

    def _wanted(self) -> tuple[float, float]:
        """Return the rates of both axes that are asked for at this instant."""
        first_sky, second_sky = self._sky() if self._tracking else (0.0, 0.0)
        west, north = (added if until_s > self._utc_s else 0.0 for until_s, added in self._pulses)
        north = -north if self._beyond() else north
        if self.parked:
            return 0.0, 0.0
        if self._target is not None:
            first_gap, second_gap = self._gaps()
            return first_sky + self._slew_rate(first_gap), second_sky + self._slew_rate(second_gap)
        settings, (primary, secondary) = self.settings, self._moves
        first, second = first_sky + west, second_sky + north
        if primary is not None:
            added = first_sky if settings.additive else 0.0
            first = settings.ra_sign * settings.ra_gain * primary + added
        if secondary is not None:
            added = second_sky if settings.additive else 0.0
            second = settings.dec_sign * settings.dec_gain * secondary + added
        return first, second

    def _gaps(self) -> tuple[float, float]:
        assert self._target is not None
        ra_deg, dec_deg = self._target[0] - self._ra_offset_deg, self._target[1] - self._dec_offset_deg
        hour_angle_deg = _apparent_sidereal_deg(self._utc_s, self.settings.longitude_deg) - ra_deg
        first_deg, second_deg = self._axes_of(math.remainder(hour_angle_deg, TURN_DEG), dec_deg)
        gap_deg = math.remainder(first_deg - self._first.position_deg, TURN_DEG)
        return gap_deg, second_deg - self._second.position_deg

    def _slew_rate(self, gap_deg: float) -> float:
        # As fast as it can still brake from, and in proportion to the rest near the end.
        brakes_from = math.sqrt(0.8 * self.settings.acceleration_deg_s2 * abs(gap_deg))
        rate = min(self.settings.slew_rate_deg_s, brakes_from, SLEW_GAIN_HZ * abs(gap_deg))
        return math.copysign(rate, gap_deg)

    def _arrived(self) -> bool:
        near = max(abs(gap_deg) for gap_deg in self._gaps()) < ARRIVED_DEG
        return near and self._off_sky_deg_s(self._tracking) < ARRIVED_DEG_S

    def _stands(self) -> bool:
        follows = self._tracking and not self.parked
        return self._off_sky_deg_s(follows) < STANDS_DEG_S

    def _off_sky_deg_s(self, follows: bool) -> float:
        """Return how fast the faster axis moves against the sky, or where that is not followed, at all."""
        first_sky, second_sky = self._sky() if follows else (0.0, 0.0)
        return max(abs(self._first.rate_deg_s - first_sky), abs(self._second.rate_deg_s - second_sky))


def _apparent_sidereal_deg(utc_s: float, longitude_deg: float) -> float:
    day = utc_s / 86400.0 + MJD_OF_POSIX_ZERO
    sidereal_deg: float = math.degrees(erfa.gst00b(MJD_ZERO, day)) + longitude_deg
    return sidereal_deg % TURN_DEG


def turned(ra_deg: float, dec_deg: float, utc_s: float, to_j2000: bool) -> tuple[float, float]:
    """Return a direction turned between the equinoxes of date and of J2000, degrees (IAU 2000B)."""
    tt = utc_s / 86400.0 + MJD_OF_POSIX_ZERO + TT_AHEAD_OF_UTC_S / 86400.0
    matrix = erfa.pnm00b(MJD_ZERO, tt)
    vector = erfa.s2c(math.radians(ra_deg), math.radians(dec_deg))
    ra, dec = erfa.c2s(erfa.trxp(matrix, vector) if to_j2000 else erfa.rxp(matrix, vector))
    return math.degrees(ra) % TURN_DEG, math.degrees(dec)

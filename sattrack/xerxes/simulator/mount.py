"""The simulated mount's logic: mailbox, rising edges, priorities, acknowledgements, axes and its own clock.

Source: "Xerxes Mount Control Protocol", Theory of Operation. A loop of about 50 ms reads the latest command
in the mailbox, acts on rising edges (on the level for MoveAxis), and packs a snapshot of everything.
Where the paper is silent: abort outranks slew, slew outranks MoveAxis; an abort leaves the axes at rest
until the next motion command; MoveAxis flags that fall give the axis back to sidereal tracking.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount import SIDEREAL_RATE_DEG_S, MountProfile
from sattrack.xerxes.datagrams import Command, DatagramError, Status, decode_command, encode_status
from sattrack.xerxes.simulator.axis import Axis, AxisDrive

if TYPE_CHECKING:
    from sattrack.mount import AxisLimits

UNIX_EPOCH_DAYS_FROM_J2000 = -10957.5
DTICS_S_PER_DEG_S = 2**26 / 360.0 * 10.0


class SimulatedSite(msgspec.Struct, frozen=True):
    """Where the simulated mount believes it stands, degrees and metres."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0


class StartPosition(msgspec.Struct, frozen=True):
    """Where the axes are at power-up, degrees."""

    hour_angle_deg: float = -30.0
    dec_deg: float = 20.0


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the axes really were when a status was packed, in the frame that the mount reports."""

    counter: int
    utc_s: float
    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


def mean_sidereal_deg(utc_s: float, longitude_deg: float) -> float:
    """Return local mean sidereal time, degrees, UT1 taken as UTC.

    The linear part of the IAU 1982 expression, which is all that a mount's own clock needs; it differs from
    apparent sidereal time by up to 18 arcseconds, as real mounts' clocks do.
    """
    days = utc_s / 86400.0 + UNIX_EPOCH_DAYS_FROM_J2000
    whole = math.floor(days)
    turns = (days - whole) * 360.0 + 0.98564736629 * days + 280.46061837
    return (turns + longitude_deg) % 360.0


def _axis(limits: AxisLimits) -> Axis:
    return Axis(AxisDrive(limits.max_acceleration_deg_s2, limits.slew_rate_deg_s))


@dataclass(slots=True)
class SimulatedMount:
    """A mount with two axes; `receive` fills its mailbox, `tick` runs its loop once."""

    profile: MountProfile
    site: SimulatedSite
    start: StartPosition = field(default_factory=StartPosition)
    counter: int = 0
    refused: int = 0
    """Command datagrams that were no such thing."""
    _ra: Axis = field(init=False)
    _dec: Axis = field(init=False)
    _mailbox: Command = field(default_factory=Command)
    _previous: Command = field(default_factory=Command)
    _now_s: float | None = None
    _slewing: bool = False
    _moving: bool = False
    _target: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Power up: the axes at their start position, tracking the sky."""
        self._ra = _axis(self.profile.ra)
        self._dec = _axis(self.profile.dec)
        self._ra.place(self.start.hour_angle_deg, SIDEREAL_RATE_DEG_S)
        self._dec.place(self.start.dec_deg, 0.0)

    def receive(self, data: bytes) -> bool:
        """Put a command datagram into the mailbox; whatever was there is gone. False where it is refused."""
        try:
            command = decode_command(data)
        except DatagramError:
            self.refused += 1
            return False
        rates = (command.move_ra_rate_deg_s, command.move_dec_rate_deg_s)
        targets = (command.target_ra_h, command.target_dec_deg)
        aimed = not (command.slew or command.sync) or _is_direction(*targets)
        if not aimed or not all(math.isfinite(x) for x in (*rates, *targets)):
            if not command.abort:
                self.refused += 1
                return False
            # Whatever else it says, a stop is a stop.
            command = Command(command.counter, abort=True)
        self._mailbox = command
        return True

    def tick(self, now_utc_s: float) -> tuple[bytes, Truth]:
        """Run the loop once at an instant: let the axes move up to it, obey the mailbox, pack a status."""
        if self._now_s is not None and now_utc_s > self._now_s:
            self._ra.advance(now_utc_s - self._now_s)
            self._dec.advance(now_utc_s - self._now_s)
        self._now_s = now_utc_s
        self.counter += 1
        self._obey(self._mailbox, now_utc_s)
        self._previous = self._mailbox
        return self._pack(now_utc_s), self._truth(now_utc_s)

    def _obey(self, command: Command, now_utc_s: float) -> None:
        if command.abort:
            if not self._previous.abort:
                self._slewing = self._moving = False
                self._ra.run(0.0)
                self._dec.run(0.0)
        elif command.slew:
            if not self._previous.slew and not self._slewing and not self._moving:
                self._start_slew(command, now_utc_s)
        elif command.move_ra or command.move_dec:
            if not self._slewing:
                self._move(command)
        elif self._moving:
            self._moving = False
            self._ra.run(SIDEREAL_RATE_DEG_S)
            self._dec.run(0.0)
        if self._slewing and not self._ra.going and not self._dec.going:
            self._slewing = False

    def _start_slew(self, command: Command, now_utc_s: float) -> None:
        self._target = (command.target_ra_h, command.target_dec_deg)
        hour_angle = self._sidereal_deg(now_utc_s) - command.target_ra_h * 15.0
        # The cable wrap allows half a turn either way of the meridian.
        self._ra.go((hour_angle + 180.0) % 360.0 - 180.0, SIDEREAL_RATE_DEG_S)
        self._dec.go(command.target_dec_deg, 0.0)
        self._slewing = True

    def _move(self, command: Command) -> None:
        self._moving = True
        ra_rate, dec_rate = SIDEREAL_RATE_DEG_S, 0.0
        if command.move_ra:
            asked = self.profile.ra_rate_sign * command.move_ra_rate_deg_s
            ra_rate = ra_rate * self.profile.additive + _within(asked, self.profile.ra.slew_rate_deg_s)
        if command.move_dec:
            asked = self.profile.dec_rate_sign * command.move_dec_rate_deg_s
            dec_rate = _within(asked, self.profile.dec.slew_rate_deg_s)
        self._ra.run(ra_rate)
        self._dec.run(dec_rate)

    def _sidereal_deg(self, now_utc_s: float) -> float:
        return mean_sidereal_deg(now_utc_s, self.site.longitude_deg)

    def _encoder_deg(self, position_deg: float) -> float:
        tics = self.profile.encoder_tics
        return math.floor(position_deg / 360.0 * tics) / tics * 360.0

    def _truth(self, now_utc_s: float) -> Truth:
        return Truth(
            counter=self.counter,
            utc_s=now_utc_s,
            ra_deg=(self._sidereal_deg(now_utc_s) - self._ra.position_deg) % 360.0,
            dec_deg=self._dec.position_deg,
            ra_rate_deg_s=SIDEREAL_RATE_DEG_S - self._ra.velocity_deg_s,
            dec_rate_deg_s=self._dec.velocity_deg_s,
        )

    def _pack(self, now_utc_s: float) -> bytes:
        sidereal = self._sidereal_deg(now_utc_s)
        hour_angle = self._encoder_deg(self._ra.position_deg)
        dec = self._encoder_deg(self._dec.position_deg)
        altitude, azimuth = _horizontal(hour_angle, dec, self.site.latitude_deg)
        command = self._mailbox
        return encode_status(
            Status(
                altitude_deg=altitude,
                azimuth_deg=azimuth,
                dec_deg=dec,
                dec_rate_dtics_s=round(self._dec.velocity_deg_s * DTICS_S_PER_DEG_S),
                ra_h=(sidereal - hour_angle) % 360.0 / 15.0,
                ra_rate_dtics_s=round(self._ra.velocity_deg_s * DTICS_S_PER_DEG_S),
                sidereal_h=sidereal / 15.0,
                site_height_m=self.site.height_m,
                site_latitude_deg=self.site.latitude_deg,
                site_longitude_deg=self.site.longitude_deg,
                target_ra_h=self._target[0],
                target_dec_deg=self._target[1],
                counter=self.counter,
                ra_current_10ma=round(self._ra.current_a * 100.0),
                dec_current_10ma=round(self._dec.current_a * 100.0),
                slewing=self._slewing or self._moving,
                tracking=not (self._slewing or self._moving),
                ack_move_ra=command.move_ra and self._moving,
                ack_move_dec=command.move_dec and self._moving,
                ack_abort=command.abort,
                ack_slew=command.slew and not command.abort,
            )
        )


def _is_direction(ra_h: float, dec_deg: float) -> bool:
    """Tell whether a target is one: "verify RA is 0 to 24 and dec is -90 to 90"."""
    return 0.0 <= ra_h <= 24.0 and -90.0 <= dec_deg <= 90.0


def _within(rate_deg_s: float, limit_deg_s: float) -> float:
    return max(-limit_deg_s, min(limit_deg_s, rate_deg_s))


def _horizontal(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return altitude and azimuth (from north through east), degrees."""
    h, d, p = (math.radians(x) for x in (hour_angle_deg, dec_deg, latitude_deg))
    east = -math.cos(d) * math.sin(h)
    north = math.cos(p) * math.sin(d) - math.sin(p) * math.cos(d) * math.cos(h)
    up = math.sin(p) * math.sin(d) + math.cos(p) * math.cos(d) * math.cos(h)
    return (
        math.degrees(math.atan2(up, math.hypot(east, north))),
        math.degrees(math.atan2(east, north)) % 360.0,
    )

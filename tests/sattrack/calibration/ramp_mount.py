"""A mount in closed form, written from the protocol paper: ramps of constant acceleration, no servo.

It packs and unpacks with `struct` by the paper's offsets, and shares nothing with the package but numbers.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

SIDEREAL_DEG_S = 360.0 / 86164.0905
TIC_DEG = 360.0 / 2**26


@dataclass
class Ramp:
    """An axis: position at any instant after the last change of speed."""

    acceleration: float
    since: float = 0.0
    start: float = 0.0
    speed_before: float = 0.0
    speed: float = 0.0

    def at(self, t: float) -> tuple[float, float]:
        passed = t - self.since
        change = self.speed - self.speed_before
        ramp = abs(change) / self.acceleration
        if passed < ramp:
            a = math.copysign(self.acceleration, change)
            return self.start + self.speed_before * passed + a * passed**2 / 2, self.speed_before + a * passed
        return self.start + self.speed * passed - change * ramp / 2, self.speed

    def go(self, t: float, speed: float) -> None:
        self.start, self.speed_before = self.at(t)
        self.since, self.speed = t, speed


@dataclass
class RampMount:
    """What the mount is; `speed` of an axis is of its hour angle or its reported declination."""

    latitude: float = 52.0
    longitude: float = 4.5
    hour_angle: float = -20.0
    declination: float = 30.0
    ra_sign: int = 1
    dec_sign: int = 1
    ra_gain: float = 1.0
    dec_gain: float = 1.0
    additive: bool = True
    edge: bool = False
    beyond_pole: bool = False
    ra_acceleration: float = 8.0
    dec_acceleration: float = 12.0
    clock_ahead: float = 0.0
    clock_drift: float = 0.0
    clock_epoch: float = 0.0
    doubles: bool = False
    deaf: bool = False
    stuck: bool = False
    longitude_told: float | None = None
    slewing: bool = False
    parked: bool = False
    counter: int = 0
    mailbox: bytes = bytes(82)
    before: bytes = bytes(82)
    moving: bool = False
    ra: Ramp = field(init=False)
    dec: Ramp = field(init=False)

    def begin(self, t: float) -> None:
        self.ra = Ramp(self.ra_acceleration, t, self.hour_angle, SIDEREAL_DEG_S, SIDEREAL_DEG_S)
        self.dec = Ramp(self.dec_acceleration, t, self.declination)
        self.clock_epoch = t

    def receive(self, data: bytes) -> None:
        assert len(data) == 82
        assert data[:8] == b"\xaa\xaa\x55\x55\x00\x00\x00\x00"
        if not self.deaf:
            self.mailbox = data

    def tick(self, t: float) -> bytes:
        """Run the loop once and return the status."""
        now, was = self.mailbox, self.before
        self.before = now
        abort, move_ra, move_dec = now[73], now[75], now[76]
        dec_rate, ra_rate = struct.unpack_from("<dd", now, 32)
        if abort:
            if not was[73]:
                self.moving = False
                self._speeds(t, 0.0, 0.0)
        elif move_ra or move_dec:
            new = (move_ra and not was[75]) or (move_dec and not was[76])
            if new or not self.edge:
                self._move(t, move_ra, move_dec, ra_rate, dec_rate)
        elif self.moving and not self.edge:
            self.moving = False
            self._speeds(t, SIDEREAL_DEG_S, 0.0)
        self.counter += 1
        return self._pack(t, abort, move_ra and not abort, move_dec and not abort)

    def _move(self, t: float, ra: int, dec: int, ra_rate: float, dec_rate: float) -> None:
        self.moving = True
        ra_speed, dec_speed = SIDEREAL_DEG_S, 0.0
        if self.edge:
            ra_speed, dec_speed = self.ra.speed, self.dec.speed
        if ra:
            ra_speed = self.ra_sign * self.ra_gain * ra_rate + SIDEREAL_DEG_S * self.additive
            if self.edge and ra_rate == 0.0:
                ra_speed = SIDEREAL_DEG_S
        if dec:
            dec_speed = self.dec_sign * self.dec_gain * dec_rate
        self._speeds(t, ra_speed, dec_speed)

    def _speeds(self, t: float, ra: float, dec: float) -> None:
        if self.stuck:
            ra = dec = 0.0
        if ra != self.ra.speed:
            self.ra.go(t, ra)
        if dec != self.dec.speed:
            self.dec.go(t, dec)

    def clock(self, t: float) -> float:
        """Return the mount's belief of UTC."""
        return t + self.clock_ahead + self.clock_drift * (t - self.clock_epoch)

    def _pack(self, t: float, abort: int, move_ra: int, move_dec: int) -> bytes:
        days = self.clock(t) / 86400.0 - 10957.5
        longitude = self.longitude if self.longitude_told is None else self.longitude_told
        lst = ((days % 1.0) * 360.0 + 0.98564736629 * days + 280.46061837 + longitude) % 360.0
        ha = math.floor(self.ra.at(t)[0] / TIC_DEG) * TIC_DEG
        dec = math.floor(self.dec.at(t)[0] / TIC_DEG) * TIC_DEG
        data = bytearray(160)
        data[:8] = b"XERXESxx"
        struct.pack_into("<d", data, 24, dec)
        struct.pack_into("<d", data, 40, (lst - ha) % 360.0 / 15.0)
        struct.pack_into("<d", data, 56, lst / 15.0)
        struct.pack_into("<dd", data, 72, self.latitude, longitude)
        rates = [round(axis.at(t)[1] / TIC_DEG * 10.0) for axis in (self.dec, self.ra)]
        kind = "<d" if self.doubles else "<q"
        struct.pack_into(kind, data, 32, rates[0])
        struct.pack_into(kind, data, 48, rates[1])
        struct.pack_into(kind, data, 104, self.counter)
        struct.pack_into("<dd", data, 112, 3500.0, 3500.0)
        data[137] = 255 * self.parked
        data[138] = 255
        data[142] = 255 * self.beyond_pole
        data[143] = 255 * (self.moving or self.slewing)
        data[146], data[147], data[155] = move_dec, move_ra, abort
        return bytes(data)

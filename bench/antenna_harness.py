"""A station with a simulated mount in virtual time, and whoever talks to it: no sockets, no waiting."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.installation import Installation
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.runtime import demo_pass
from sattrack.safety import SafetyLimits
from sattrack.servers.antenna.controller import AntennaStation
from sattrack.servers.antenna.equipment import Antenna, Focuser, SimulatedFocusAxis
from sattrack.servers.antenna.led_mount import axis_range
from sattrack.servers.antenna.protocol import encode
from sattrack.servers.antenna.trajectory import SiteSky

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.simulator.mount import Truth

MOUNT_PHASE_S = 0.0217
SITE = demo_pass.SITE.place()
START = StartPosition(hour_angle_deg=50.0, dec_deg=15.0)


@dataclass
class VirtualAntenna:
    """Runs a station; `at` schedules what is said to it, `truths` are the axes' own places."""

    begin_utc_s: float
    axes: str = "hadec"
    profile: MountProfile = field(default_factory=MountProfile)
    limits: SafetyLimits = field(default_factory=lambda: SafetyLimits(optical=False))
    start: StartPosition = START
    stow: tuple[float, float] | None = (0.0, 80.0)
    service: tuple[float, float] | None = (-45.0, 10.0)
    refraction: str = "off"
    truths: list[Truth] = field(default_factory=list)
    silent_until_s: float = 0.0
    """Until when statuses are lost."""
    held_up_s: float = 0.0
    """How much later than it is due the next datagram is computed."""

    def __post_init__(self) -> None:
        self.sky = SiteSky(SITE)
        self.station = self.make_station()
        site = SimulatedSite(SITE.latitude_deg, SITE.longitude_deg, SITE.height_m)
        mount = SimulatedMount(self.profile, site, self.start)
        self._wires = Installation(mount, None, self.profile.command_delay_s, self.profile.status_delay_s)
        self._queue: list[tuple[float, int, Callable[[float, Any], None], Any]] = []
        self._order = 0
        self.now_utc_s = self.begin_utc_s
        self._at(self.begin_utc_s, self._tick, None)
        first = self._wires.next_turn_s(self.begin_utc_s - self.profile.period_s + MOUNT_PHASE_S)
        self._at(first, self._mount_turn, None)

    def make_station(self) -> AntennaStation:
        span = axis_range(self.profile, self.axes)
        focuser = Focuser((SimulatedFocusAxis(),))
        antenna = Antenna(self.sky, self.axes, span, self.stow, self.service, focuser, self.refraction)
        return AntennaStation(antenna, self.profile, self.limits)

    def call(self, utc_s: float, what: Callable[[float], None]) -> None:
        self._at(utc_s, lambda now, _: what(now), None)

    def say(self, message: str) -> str:
        """Say something now; return the answer without its check."""
        answer, _ = self.station.receive_command(encode(message), self.now_utc_s)
        return answer.decode().rsplit(" ", 1)[0]

    def run_until(self, utc_s: float) -> None:
        while self._queue and self._queue[0][0] <= utc_s:
            self.now_utc_s, _, happen, what = heappop(self._queue)
            happen(self.now_utc_s, what)
        self.now_utc_s = utc_s

    def run_for(self, seconds: float) -> None:
        self.run_until(self.now_utc_s + seconds)

    def _at(self, utc_s: float, happen: Callable[[float, Any], None], what: Any) -> None:
        self._order += 1
        heappush(self._queue, (utc_s, self._order, happen, what))

    def _tick(self, now: float, _: None) -> None:
        if self.held_up_s:
            late_s, self.held_up_s = self.held_up_s, 0.0
            self._at(now + late_s, self._tick, None)
            return
        datagram = self.station.tick(now)
        for delay_s, arriving in self._wires.commands.carry(datagram):
            self._at(now + delay_s, lambda _, data: self._wires.receive(data) and None, arriving)
        self._at(now + self.profile.period_s + self.station.send_shift_s(now), self._tick, None)

    def _mount_turn(self, now: float, _: None) -> None:
        status, truth = self._wires.turn(now)
        if truth is not None:
            self.truths.append(truth)
        if status is not None and now >= self.silent_until_s:
            for delay_s, arriving in self._wires.statuses.carry(status):
                self._at(now + delay_s, lambda at, data: self.station.receive(data, at), arriving)
        self._at(self._wires.next_turn_s(now), self._mount_turn, None)


def separation_arcsec(ra1: float, dec1: float, ra2: float, dec2: float) -> float:
    """Return the angle between two directions, degrees in, arcseconds out."""
    half_ra = math.radians(math.remainder(ra1 - ra2, 360.0)) / 2.0
    half_dec = math.radians(dec1 - dec2) / 2.0
    cosines = math.cos(math.radians(dec1)) * math.cos(math.radians(dec2))
    chord = math.sin(half_dec) ** 2 + cosines * math.sin(half_ra) ** 2
    return math.degrees(2.0 * math.asin(math.sqrt(chord))) * 3600.0


def rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values))

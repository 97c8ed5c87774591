"""A simulated mount under `Safety` alone: a wish a period, what is cleared to the wire, the true axes out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile, MoveAxes, Stop, seen_of
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.session import Session
from sattrack.safety import Safety, SafetyLimits

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import Motion
    from sattrack.mount.simulator.mount import Truth

T0 = 1_790_000_000.0
"""2026-09-21 14:13:20 UTC: the Sun stands in the south-west at the stand's site."""
LATITUDE_DEG, LONGITUDE_DEG = 52.0, 4.5
PERIOD_S = 0.05
FREE_DEG = 300.0
Span = tuple[float, float]
NEVER: Span = (math.inf, math.inf)


@dataclass
class Stand:
    """`wish` gives what is wanted so many seconds after the start; `deaf` and `silent` lose one way.

    The mount has no limits of its own short of FREE_DEG; `real` is what it is where that is not the profile.
    """

    wish: Callable[[float], Motion]
    limits: SafetyLimits
    start: StartPosition
    profile: MountProfile = field(default_factory=MountProfile)
    real: MountProfile | None = None
    hardware: SimulatorProfile = field(default_factory=lambda: SimulatorProfile(hard_margin_deg=100.0))
    deaf: Span = NEVER
    silent: Span = NEVER
    holds: bool = True
    escapes: bool = False
    begin_s: float = T0
    truths: list[tuple[float, Truth]] = field(default_factory=list)
    sent: list[Motion] = field(default_factory=list)
    met_s: float | None = None
    """When safety first held or stopped what was wished."""

    turns: int = field(default=0, init=False)
    wanted: Motion = field(default_factory=Stop, init=False)

    def __post_init__(self) -> None:
        self.safety = Safety(self.profile, self.limits, LATITUDE_DEG, LONGITUDE_DEG, self.holds, self.escapes)
        self.session = Session(self.profile)
        site = SimulatedSite(LATITUDE_DEG, LONGITUDE_DEG)
        self.mount = SimulatedMount(self.real or self.profile, site, self.start, self.hardware)

    def run(self, seconds: float) -> Stand:
        """Go on for so many seconds."""
        for _ in range(round(seconds / PERIOD_S)):
            t = self.turns * PERIOD_S
            self.turns += 1
            now_s = self.begin_s + t
            status, truth = self.mount.tick(now_s)
            self.truths.append((t, truth))
            if not self.silent[0] <= t < self.silent[1]:
                restarts = self.session.health.restarts
                sample = self.session.receive(status, now_s + 0.0001)
                if self.session.health.restarts > restarts:
                    self.safety.see_restart(self.wanted)
                if sample is not None and self.session.status is not None:
                    self.safety.watch(seen_of(self.session.status, now_s), self.wanted)
            sample = self.session.sample
            if sample is None:
                continue
            sends_s = now_s + 0.02
            cleared = self.safety.clear(
                self.wish(t),
                sample.sidereal_h * 15.0,
                sample.ra_deg,
                sample.dec_deg,
                sends_s - sample.arrival_utc_s,
                sends_s,
            )
            self.wanted = cleared.motion
            self.sent.append(self.wanted)
            held = self.safety.holding is not None or self.safety.tripped is not None
            if held and self.met_s is None:
                self.met_s = t
            self.session.apply(cleared)
            datagram = self.session.compose()
            if not self.deaf[0] <= t < self.deaf[1]:
                self.mount.receive(datagram)
        return self

    @property
    def standstill_s(self) -> float:
        """How long after the limit was met the axes came to rest, to stay so."""
        assert self.met_s is not None
        moving = [t for t, truth in self.truths if axis_speed_deg_s(truth) > 1e-3]
        return max([t for t in moving if t >= self.met_s] or [self.met_s]) + PERIOD_S - self.met_s


def axis_speed_deg_s(truth: Truth) -> float:
    return max(abs(SIDEREAL_RATE_DEG_S - truth.ra_rate_deg_s), abs(truth.dec_rate_deg_s))


def steadily(ha_deg_s: float, dec_deg_s: float) -> Callable[[float], Motion]:
    """Rates of the axes that are wished all the time."""
    return lambda _: MoveAxes(SIDEREAL_RATE_DEG_S - ha_deg_s, dec_deg_s)

"""Random passes with random limits, mounts and faults, flown in virtual time, and judged by the true axes.

The judge shares no geometry with what it judges: directions are vectors, the Sun is the Astronomical
Almanac's, zones and skylines are looked up as they are written.
"""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import erfa
import msgspec
from rehearsal_draws import BEGIN_UTC, orbit

from sattrack.core.errors import SattrackError
from sattrack.mount.model import AxisLimits, MountProfile, PierZone
from sattrack.mount.profiles import ProfileFile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.recording.recorder import NoRecording
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun
from sattrack.safety import SafetyLimits
from tle.instants import Utc
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.simulator.installation import LoopRun
    from sattrack.mount.simulator.mount import Truth
    from sattrack.runtime.facts import RunFacts

FREE_DEG = 300.0
"""The simulated mount's own limits: wider than any that is commanded, so that a violation shows."""
AT_REST_DEG_S = 1e-4
LONGEST_S = 600.0
SHORTEST_S = 30.0
LEAD_S = 3.0
TRAVELS = (
    ("never", (-190.0, 190.0)),
    ("never", (-60.0, 88.0)),
    ("never", (-30.0, 70.0)),
    ("hour_angle", (-190.0, 190.0)),
)
"""Pier rules with travels of the declination axis that let them be."""
STAR_DEG_S = 360.0 / 86164.0905


@dataclass(frozen=True)
class Drawn:
    """One run to be flown: what it is, the mount that plays it, and its start."""

    facts: RunFacts
    hardware: SimulatorProfile
    start: StartPosition
    words: str


@dataclass
class Judged:
    """What came of one run: how near the true axes came to each limit, degrees, and how it ended."""

    nearest_deg: dict[str, float] = field(default_factory=dict)
    ended_by: str = ""
    at_rest: bool = False
    seconds: float = 0.0
    held_s: float = 0.0
    sun_up: bool = False

    @property
    def violated(self) -> list[str]:
        """The limits that were passed."""
        return [name for name, nearest in self.nearest_deg.items() if nearest < 0.0]


def draw(seed: int, longest_s: float = LONGEST_S) -> Drawn:
    """Return a run: orbit, site, hour, limits, mount, start and faults from a seed."""
    dice = random.Random(f"safety {seed}")
    while True:
        site = Site(dice.uniform(-60.0, 65.0), dice.uniform(-180.0, 180.0), dice.uniform(0.0, 3000.0))
        limits = drawn_limits(dice)
        profile = drawn_profile(dice)
        at_s = float(Utc.parse(BEGIN_UTC).unix_s) + dice.uniform(0.0, 86400.0)
        satellite = orbit(dice)
        request = RunRequest(
            satellite=satellite.name,
            mount_url="sim",
            elements=[satellite],
            site=site,
            clock_option=Utc(at_s).isoformat("seconds"),
            min_alt_deg=max(5.0, limits.floor_altitude_deg),
            virtual=True,
            profile=ProfileFile(**{n: getattr(profile, n) for n in MountProfile.__struct_fields__}),
            limits=limits,
        )
        try:
            facts = prepare(request).facts
        except SattrackError:
            continue
        plan = facts.plan
        sun_up = Judge(facts).sun_altitude_deg(plan.start_utc_s) > 0.0
        if sun_up != (seed % 3 > 0) or plan.end_utc_s - plan.start_utc_s < SHORTEST_S:
            continue
        length = min(
            plan.end_utc_s - plan.start_utc_s, longest_s, SHORTEST_S * math.exp(3.0 * dice.random() ** 2)
        )
        start_s = dice.uniform(plan.start_utc_s, plan.end_utc_s - length)
        approach_s = dice.choice([25.0, 25.0, 60.0])
        plan = msgspec.structs.replace(
            plan, start_utc_s=start_s, end_utc_s=start_s + length, approach_s=approach_s
        )
        facts = msgspec.structs.replace(facts, plan=plan, started_utc_s=start_s - approach_s - LEAD_S)
        start = drawn_start(dice, facts)
        if start is None:
            continue
        faults = drawn_faults(dice, length + approach_s, limits.longest_fault_s)
        hardware = drawn_hardware(dice, profile, faults, seed)
        return Drawn(facts, hardware, start, f"seed {seed}: {profile.name}, faults {faults or 'none'}")


def drawn_limits(dice: random.Random) -> SafetyLimits:
    floor = dice.choice([0.0, 0.0, 10.0, dice.uniform(0.0, 30.0)])
    horizon: tuple[tuple[float, float], ...] = ()
    if dice.random() < 0.4:
        azimuths = sorted({round(dice.uniform(0.0, 60.0) + 60.0 * k, 1) for k in range(6)})
        horizon = tuple((azimuth, round(dice.uniform(0.0, 40.0), 1)) for azimuth in azimuths)
        if any(b - a > 90.0 for a, b in zip(azimuths, [*azimuths[1:], azimuths[0] + 360.0], strict=True)):
            horizon = ()
    return SafetyLimits(
        floor_altitude_deg=floor,
        horizon=horizon,
        sun_cone_deg=dice.choice([None, 15.0, dice.uniform(5.0, 45.0)]),
        moon_cone_deg=0.0,
        longest_fault_s=dice.choice([1.0, 1.0, 0.5, 1.7]),
    )


def drawn_profile(dice: random.Random) -> MountProfile:
    axes = [
        AxisLimits(
            max_rate_deg_s=dice.uniform(1.5, 8.0),
            max_acceleration_deg_s2=dice.uniform(3.0, 12.0),
            slew_rate_deg_s=dice.uniform(4.0, 10.0),
        )
        for _ in range(2)
    ]
    zones = []
    if dice.random() < 0.4:
        ha, dec = dice.uniform(-120.0, 120.0), dice.uniform(-20.0, 80.0)
        wide, high = dice.uniform(5.0, 40.0), dice.uniform(5.0, 30.0)
        top = min(89.0, dec + high)
        zones.append(PierZone("drawn", ((ha, dec), (ha + wide, dec), (ha + 0.5 * wide, top))))
    rule, travel = dice.choice(TRAVELS)
    return MountProfile(
        name="drawn",
        ra=axes[0],
        dec=axes[1],
        move_axis="edge" if dice.random() < 0.2 else "held",
        hour_angle_limit_deg=dice.choice([200.0, 120.0, dice.uniform(40.0, 150.0)]),
        dec_axis_limits_deg=travel,
        pier_rule=rule,
        pier_zones=tuple(zones),
    )


def drawn_faults(dice: random.Random, seconds: float, longest_fault_s: float) -> str:
    """Return faults no longer than the stated longest one; a share of the runs has none."""
    words = []
    if dice.random() < 0.3:
        words.append(f"loss={dice.uniform(0.0, 20.0):.1f}%")
    if dice.random() < 0.2:
        words.append(f"duplicate={dice.uniform(0.0, 10.0):.1f}%")
    if dice.random() < 0.2:
        words.append(f"reorder={dice.uniform(0.0, 5.0):.1f}%")
    if dice.random() < 0.1:
        words.append(f"corrupt-status={dice.uniform(0.0, 0.5):.2f}%")
    if dice.random() < 0.2:
        words.append(f"delay={dice.uniform(0.0, 30.0):.0f}ms~{dice.uniform(0.0, 20.0):.0f}ms")
    at = dice.uniform(2.0, 15.0)
    while at < seconds and dice.random() < 0.9:
        kind = dice.choice(["freeze", "silent", "deaf", "cut", "cut", "deaf"])
        words.append(f"{kind}@{at:.2f}s+{dice.choice([1.0, dice.random()]) * longest_fault_s:.3f}s")
        at += longest_fault_s + dice.uniform(2.0, 40.0)
    if dice.random() < 0.05:
        words.append(f"{dice.choice(['drive', 'drive-ra', 'drive-dec'])}@{dice.uniform(5.0, seconds):.1f}s")
    if dice.random() < 0.05:
        words.append(f"crash@{dice.uniform(5.0, seconds):.1f}s+{dice.uniform(0.2, 6.0):.1f}s")
    if dice.random() < 0.05:
        words.append(
            f"clock-step@{dice.uniform(5.0, seconds):.1f}s{dice.choice('+-')}{dice.uniform(0.1, 5):.1f}s"
        )
    return ",".join(words)


def drawn_hardware(dice: random.Random, profile: MountProfile, faults: str, seed: int) -> SimulatorProfile:
    table: dict[str, Any] = {"seed": seed, "faults": faults, "hard_margin_deg": 30.0}
    if profile.pier_rule == "hour_angle":
        table["flip"] = "hour_angle"
    if dice.random() < 0.5:
        table |= {
            "clock_offset_s": dice.uniform(-5.0, 5.0),
            "timer": dice.choice(["exact", "windows"]),
            "command_jitter_s": dice.uniform(0.0, 0.002),
            "status_jitter_s": dice.uniform(0.0, 0.002),
            "encoder_noise_tics": dice.uniform(0.0, 3.0),
        }
    return SimulatorProfile(**table)


def drawn_start(dice: random.Random, facts: RunFacts) -> StartPosition | None:
    """Return where the axes stand at first, inside of all limits and clear of them."""
    judge = Judge(facts)
    low, high = facts.profile.dec_axis_limits_deg
    limit = min(150.0, facts.profile.hour_angle_limit_deg)
    for _ in range(200):
        place = (dice.uniform(-limit, limit), dice.uniform(max(-85.0, low), min(85.0, high)))
        if judge.least_deg(*place, facts.started_utc_s) > 1.5:
            return StartPosition(*place)
    return None


SUN_KNOWN_DEG = 0.01
Vector = tuple[float, float, float]


class Judge:
    """Tells how far inside of each limit two axes are, degrees; hour angle with its turns."""

    def __init__(self, facts: RunFacts) -> None:
        self._facts = facts
        self._zenith = vector(0.0, facts.site.latitude_deg)
        self._horizon = facts.limits.horizon
        self._sun: tuple[float, tuple[float, float]] = (-math.inf, (0.0, 0.0))

    def clearances(self, ha: float, dec: float, utc_s: float) -> dict[str, float]:
        profile, limits = self._facts.profile, self._facts.limits
        low, high = profile.dec_axis_limits_deg
        here = self.points(ha, dec)
        altitude = 90.0 - angle_deg(here, self._zenith)
        found = {
            "hour_angle": profile.hour_angle_limit_deg - abs(ha),
            "declination": min(dec - low, high - dec),
            "altitude": altitude - limits.floor_altitude_deg,
        }
        if self._horizon:
            found["horizon"] = altitude - self._skyline_deg(self._azimuth_deg(here))
        if limits.sun_deg:
            sun = vector(*self._sun_place(utc_s))
            if 90.0 - angle_deg(sun, self._zenith) > -3.0:
                found["sun"] = angle_deg(self.looks(ha, dec), sun) - limits.sun_deg + SUN_KNOWN_DEG
        for zone in profile.pier_zones:
            found["pier"] = min(found.get("pier", math.inf), zone_distance_deg(zone, ha, dec))
        return found

    def least_deg(self, ha: float, dec: float, utc_s: float) -> float:
        """Return how far inside of the nearest limit two axes are that stand still for a minute."""
        return min(value for s in (0.0, 60.0) for value in self.clearances(ha, dec, utc_s + s).values())

    def points(self, ha: float, dec: float) -> Vector:
        """Return where axes point at two angles: meridian, west, pole."""
        return vector(ha, dec)

    def looks(self, ha: float, dec: float) -> Vector:
        """Return where the telescope looks then, which is beside that by what a pointing model has."""
        return self.points(ha, dec)

    def sun_altitude_deg(self, utc_s: float) -> float:
        return 90.0 - angle_deg(vector(*self._sun_place(utc_s)), self._zenith)

    def _sun_place(self, utc_s: float) -> tuple[float, float]:
        """Hour angle and declination by the Almanac's low-precision formula, good to SUN_KNOWN_DEG."""
        minute = math.floor(utc_s / 60.0)
        if minute != self._sun[0]:
            days = utc_s / 86400.0 - 10957.5
            anomaly = math.radians(357.528 + 0.9856003 * days)
            longitude = math.radians(
                280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
            )
            tilt = math.radians(23.439)
            ra = math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude))
            dec = math.asin(math.sin(tilt) * math.sin(longitude))
            self._sun = (minute, (math.degrees(ra), math.degrees(dec)))
        sidereal = math.degrees(erfa.gmst82(2440587.5, utc_s / 86400.0)) + self._facts.site.longitude_deg
        ra_deg, dec_deg = self._sun[1]
        return sidereal - ra_deg, dec_deg

    def _azimuth_deg(self, here: Vector) -> float:
        """From north through east; the vector's axes are meridian, west, pole."""
        p = math.radians(self._facts.site.latitude_deg)
        north = -math.sin(p) * here[0] + math.cos(p) * here[2]
        return math.degrees(math.atan2(-here[1], north)) % 360.0

    def _skyline_deg(self, azimuth: float) -> float:
        points = [(z + 360.0 * k, a) for k in (-1, 0, 1) for z, a in self._horizon]
        for (z1, a1), (z2, a2) in itertools.pairwise(points):
            if z1 <= azimuth <= z2 and z2 > z1:
                return a1 + (a2 - a1) * (azimuth - z1) / (z2 - z1)
        raise AssertionError(azimuth)


def zone_distance_deg(zone: PierZone, ha: float, dec: float) -> float:
    """How far axes are from a zone in its own plane, by its edges; negative inside."""
    dec = math.remainder(dec, 360.0)
    beyond = abs(dec) > 90.0
    if beyond:
        ha, dec = ha + 180.0, math.copysign(180.0, dec) - dec
    if zone.side == ("normal" if beyond else "beyond_pole"):
        return math.inf
    best = math.inf
    for turn in (-360.0, 0.0, 360.0):
        x, y = math.remainder(ha, 360.0) + turn, dec
        inside, nearest = False, math.inf
        for (x1, y1), (x2, y2) in zip(zone.corners, (*zone.corners[1:], zone.corners[0]), strict=True):
            part = ((x - x1) * (x2 - x1) + (y - y1) * (y2 - y1)) / ((x2 - x1) ** 2 + (y2 - y1) ** 2)
            part = max(0.0, min(1.0, part))
            nearest = min(nearest, math.hypot(x - x1 - part * (x2 - x1), y - y1 - part * (y2 - y1)))
            if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
                inside = not inside
        best = min(best, -nearest if inside else nearest)
    return best


def vector(ha_deg: float, dec_deg: float) -> Vector:
    h, d = math.radians(ha_deg), math.radians(dec_deg)
    return math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)


def angle_deg(one: Vector, other: Vector) -> float:
    (a, b, c), (d, e, f) = one, other
    return math.degrees(math.acos(max(-1.0, min(1.0, a * d + b * e + c * f))))


@dataclass(slots=True)
class WatchedRun(VirtualRun):
    """A run that shows the truth of every turn of the mount's loop to a listener."""

    hears: Callable[[float, Truth], None] | None = None

    def __post_init__(self) -> None:
        """Listen at the mount."""
        super(WatchedRun, self).__post_init__()
        turn, hears = self._installation.turn, self.hears

        def heard(now_utc_s: float) -> LoopRun:
            found = turn(now_utc_s)
            if found.truth is not None and hears is not None:
                hears(now_utc_s, found.truth)
            return found

        object.__setattr__(self, "_installation", Listened(self._installation, heard))


@dataclass
class Listened:
    """An installation with another `turn`."""

    inner: Any
    turn: Callable[[float], LoopRun]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def fly(drawn: Drawn) -> Judged:
    """Fly a run to its end and judge every turn of the mount's loop by the true axes."""
    facts = drawn.facts
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    free = msgspec.structs.replace(
        facts.profile, hour_angle_limit_deg=FREE_DEG, dec_axis_limits_deg=(-FREE_DEG, FREE_DEG)
    )
    mount = SimulatedMount(free, site, drawn.start, drawn.hardware)
    judge, judged, last = Judge(facts), Judged(), []

    def hears(now_utc_s: float, truth: Truth) -> None:
        last[:] = [truth]
        found = judge.clearances(truth.hour_angle_axis_deg, truth.dec_axis_deg, now_utc_s)
        for name, value in found.items():
            judged.nearest_deg[name] = min(value, judged.nearest_deg.get(name, math.inf))

    engine = build_engine(facts)
    run = WatchedRun(engine, mount, facts.started_utc_s, NoRecording(), hears=hears)
    ended_s = run.run()
    truth = last[0]
    judged.at_rest = (
        abs(STAR_DEG_S - truth.ra_rate_deg_s) < AT_REST_DEG_S or not engine.tracker.followable_utc_s
    )
    judged.at_rest = judged.at_rest and abs(truth.dec_rate_deg_s) < AT_REST_DEG_S
    judged.ended_by = engine.tracker.ended_by or ""
    judged.seconds = ended_s - facts.started_utc_s
    judged.held_s = sum(engine.held_s.values())
    judged.sun_up = "sun" in judged.nearest_deg
    return judged

"""Calibration against mounts drawn at random: what it finds against what they are.

python bench/calibration.py [DRAWS [SEED]]

Each draw is a whole run of `sattrack.calibration` against the simulated mount in virtual time, with delays,
a network that scatters and loses, the mount's irregular timer, and a clock that is off and drifts.
"""

from __future__ import annotations

import heapq
import math
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.findings import Findings, conclude
from sattrack.calibration.guard import Kind, Surroundings
from sattrack.mount import AxisLimits, MountProfile
from sattrack.xerxes.datagrams import Readings
from sattrack.xerxes.simulator import timer as simulator_timer
from sattrack.xerxes.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.xerxes.simulator.settings import ServoSettings, SimulatorProfile
from sattrack.xerxes.simulator.wire import Wire, WireLaw

if TYPE_CHECKING:
    from collections.abc import Callable

SITE = SimulatedSite(52.0, 4.5, 0.0)
SLICE_S = 0.015625
"""Windows looks for expired timers at multiples of this."""


class Loop(Protocol):
    """A mount: a mailbox and a loop, at instants of true time."""

    def receive(self, data: bytes) -> object: ...

    def tick(self, now_utc_s: float) -> bytes: ...


class Wires(Protocol):
    """Two ways: what arrives of a datagram, as (seconds after it was sent, bytes)."""

    def command(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]: ...

    def status(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]: ...


class Turns(Protocol):
    """When the mount's loop turns."""

    def after(self, last_s: float, rng: np.random.Generator) -> float: ...


@dataclass
class Network:
    """Two ways with their own least delays; `jitter_s` is the mean of what is added, exponentially."""

    command_s: float = 0.0
    status_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0

    def command(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]:
        return self._carry(self.command_s, data, rng)

    def status(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]:
        return self._carry(self.status_s, data, rng)

    def _carry(self, least_s: float, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]:
        if self.loss and rng.random() < self.loss:
            return []
        late_s = float(rng.exponential(self.jitter_s)) if self.jitter_s else 0.0
        return [(least_s + late_s, data)]


@dataclass
class Timer:
    """When the mount's loop turns: "even", "windows" (multiples of 1/64 s) or "loose" (normal scatter)."""

    law: str = "even"
    period_s: float = 0.05
    scatter_s: float = 0.002
    phase_s: float = 0.0

    def after(self, last_s: float, rng: np.random.Generator) -> float:
        if self.law == "windows":
            late = float(rng.uniform(0.0, 0.0005))
            return (math.floor((last_s + self.period_s) / SLICE_S) + 1) * SLICE_S + late
        if self.law == "loose":
            return last_s + max(0.02, self.period_s + float(rng.normal(0.0, self.scatter_s)))
        return last_s + self.period_s


@dataclass
class VirtualRun:
    """One calibrator and one mount in virtual time: a heap of events, and nothing that waits."""

    calibrator: Calibrator
    mount: Loop
    network: Wires
    timer: Turns
    rng: np.random.Generator
    begin_utc_s: float
    watch: Callable[[float, Calibrator], None] | None = None
    commands: list[tuple[float, bytes]] = field(default_factory=list)
    cut: tuple[float, float] = (math.inf, math.inf)
    """Seconds of the run between which no status arrives."""
    now_utc_s: float = 0.0

    def run(self) -> float:
        """Run to the end; return how long it took, seconds of virtual time."""
        events: list[tuple[float, int, str, bytes]] = []
        count = 0

        def put(at: float, kind: str, data: bytes = b"") -> None:
            nonlocal count
            count += 1
            heapq.heappush(events, (at, count, kind, data))

        put(self.timer.after(self.begin_utc_s, self.rng), "tick")
        while self.calibrator.ending is None:
            due = self.calibrator.due()
            if due <= events[0][0]:
                self.now_utc_s = due = max(due, self.now_utc_s)
                if self.watch is not None:
                    self.watch(due, self.calibrator)
                data = self.calibrator.send(due)
                self.commands.append((due, data))
                for late_s, arrived in self.network.command(data, self.rng):
                    put(due + late_s, "command", arrived)
                self.calibrator.sent(due)
                continue
            at, _, kind, data = heapq.heappop(events)
            self.now_utc_s = at
            if kind == "tick":
                status = self.mount.tick(at)
                if not self.cut[0] <= at - self.begin_utc_s < self.cut[1]:
                    for late_s, arrived in self.network.status(status, self.rng):
                        put(at + late_s, "status", arrived)
                put(self.timer.after(at, self.rng), "tick")
            elif kind == "command":
                self.mount.receive(data)
            else:
                self.calibrator.receive(data, at)
        return self.now_utc_s - self.begin_utc_s


@dataclass
class SimulatedWires:
    """The simulator's own two ways."""

    out: Wire
    back: Wire

    def command(self, data: bytes, _: np.random.Generator) -> list[tuple[float, bytes]]:
        return self.out.carry(data)

    def status(self, data: bytes, _: np.random.Generator) -> list[tuple[float, bytes]]:
        return self.back.carry(data)


@dataclass
class SimulatedTurns:
    """The simulator's own timer."""

    timer: simulator_timer.Timer

    def after(self, last_s: float, _: np.random.Generator) -> float:
        return self.timer.next(last_s)


@dataclass
class SimulatedLoop:
    """The simulated mount."""

    mount: SimulatedMount

    def receive(self, data: bytes) -> bool:
        return self.mount.receive(data)

    def tick(self, now_utc_s: float) -> bytes:
        return self.mount.tick(now_utc_s)[0]


@dataclass(frozen=True)
class Drawn:
    """One mount as it is, and where it stands."""

    profile: MountProfile
    hardware: SimulatorProfile
    start: StartPosition
    beyond_pole: bool
    loss: float
    begin_utc_s: float


def draw(number: int, seed: int) -> Drawn:
    """Draw a mount: everything uniform within its bounds, and each choice as likely as the others."""
    rng = np.random.default_rng([seed, number])

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def one_of(*choices: Any) -> Any:
        return choices[int(rng.integers(len(choices)))]

    beyond = one_of(True, False)
    hour_angle, dec = uniform(-40.0, 40.0), uniform(10.0, 70.0)
    friction, hunts = uniform(0.2, 1.5), one_of(True, False)
    profile = MountProfile(
        ra=AxisLimits(max_acceleration_deg_s2=uniform(3.0, 20.0)),
        dec=AxisLimits(max_acceleration_deg_s2=uniform(3.0, 20.0)),
        ra_rate_sign=one_of(-1, 1),
        dec_rate_sign=one_of(-1, 1),
        ra_rate_sign_beyond_pole=one_of(-1, 1),
        dec_rate_sign_beyond_pole=one_of(-1, 1),
        ra_rate_gain=uniform(0.9, 1.1),
        dec_rate_gain=uniform(0.9, 1.1),
        additive=one_of(True, False),
        move_axis=one_of("held", "edge"),
        readings={name: one_of("int64", "double") for name in Readings.__slots__},
    )
    hardware = SimulatorProfile(
        clock_offset_s=uniform(-10.0, 10.0),
        clock_drift_ppm=uniform(-50.0, 50.0),
        timer=one_of("exact", "windows", "windows_rearmed"),
        timer_drift_ppm=uniform(-200.0, 200.0),
        command_delay_s=uniform(0.0, 0.08),
        command_jitter_s=one_of(0.0, 0.0005, 0.002),
        status_delay_s=uniform(0.0, 0.08),
        status_jitter_s=one_of(0.0, 0.0005, 0.002),
        servo=ServoSettings(
            bandwidth_hz=uniform(3.0, 15.0),
            damping=uniform(0.7, 1.3),
            # With an integral part and friction that is not fed forward, these axes hunt and never rest.
            integral_hz=0.0 if hunts else uniform(0.2, 1.0),
            friction_a=friction,
            stiction_a=friction * uniform(1.0, 1.5),
            friction_feedforward=uniform(0.7, 1.0) if hunts else 1.0,
            ripple_a=uniform(0.0, 0.1),
        ),
        settling_arcsec=uniform(0.0, 2.0),
        encoder_noise_tics=uniform(0.0, 2.0),
        seed=number,
    )
    start = StartPosition(hour_angle, dec)
    if beyond:
        start = StartPosition(hour_angle - 180.0 if hour_angle > 0.0 else hour_angle + 180.0, 180.0 - dec)
    return Drawn(profile, hardware, start, beyond, one_of(0.0, 0.01), 1.79e9 + uniform(0.0, 86400.0))


@dataclass(frozen=True)
class Outcome:
    """One draw's errors: found less true."""

    semantics_right: bool
    gains: tuple[float, float]
    gain_sigmas: tuple[float, float]
    round_trip_s: float
    round_trip_sigma_s: float
    intervals_hold: bool
    widest_excess_s: float
    drift_ppm: float
    drift_sigma_ppm: float
    accelerations: tuple[float, ...]
    """Relative; none where the limit was too high to be seen."""
    seconds: float


def run_drawn(drawn: Drawn) -> tuple[Findings, float]:
    """Calibrate a drawn mount; return what was found and how long it took, seconds."""
    hard = drawn.hardware
    around = Surroundings(SITE.latitude_deg, SITE.longitude_deg, 170.0, -20.0, 200.0)
    calibrator = Calibrator(around, drawn.begin_utc_s)
    wires = SimulatedWires(
        Wire(WireLaw(hard.command_delay_s or 0.0, hard.command_jitter_s, drawn.loss), f"out {hard.seed}"),
        Wire(WireLaw(hard.status_delay_s or 0.0, hard.status_jitter_s, drawn.loss), f"back {hard.seed}"),
    )
    turns = SimulatedTurns(
        simulator_timer.Timer(hard.timer, drawn.profile.period_s, hard.timer_drift_ppm, hard.seed)
    )
    loop = SimulatedLoop(SimulatedMount(drawn.profile, SITE, drawn.start, hard))
    run = VirtualRun(calibrator, loop, wires, turns, np.random.default_rng(0), drawn.begin_utc_s)
    seconds = run.run()
    assert calibrator.ending is not None
    if calibrator.ending.kind is not Kind.DONE or not calibrator.ending.at_rest:
        raise AssertionError(f"{calibrator.ending}, {drawn}")
    return conclude(calibrator.seen, SITE.longitude_deg), seconds


def judge(drawn: Drawn, found: Findings, seconds: float) -> Outcome:
    """Hold what was found to what is."""
    profile, hard, delays = drawn.profile, drawn.hardware, found.delays
    command_s, status_s = hard.command_delay_s or 0.0, hard.status_delay_s or 0.0
    trip_s = command_s + status_s
    passed_s = found.utc_s - drawn.begin_utc_s
    ahead_s = (hard.clock_offset_s or 0.0) + hard.clock_drift_ppm * 1e-6 * passed_s
    intervals = ((delays.command_s, command_s), (delays.status_s, status_s), (delays.clock_offset_s, ahead_s))
    pairs = ((found.ra, profile.ra), (found.dec, profile.dec))
    return Outcome(
        semantics_right=(
            (found.ra.sign, found.dec.sign) == profile.signs(drawn.beyond_pole)
            and found.additive == profile.additive
            and found.move_axis == profile.move_axis
            and found.beyond_pole == drawn.beyond_pole
            and all(profile.readings[name] == seen for name, seen in found.readings.items())
        ),
        gains=(found.ra.gain - profile.ra_rate_gain, found.dec.gain - profile.dec_rate_gain),
        gain_sigmas=(found.ra.gain_sigma, found.dec.gain_sigma),
        round_trip_s=delays.round_trip.seconds - trip_s,
        round_trip_sigma_s=delays.round_trip.sigma_s,
        intervals_hold=all(low <= true <= high for (low, high), true in intervals),
        widest_excess_s=max(high - low for (low, high), _ in intervals) - trip_s,
        drift_ppm=found.clock.drift_ppm - hard.clock_drift_ppm,
        drift_sigma_ppm=found.clock.slope_sigma * 1e6,
        accelerations=tuple(
            f.acceleration_deg_s2 / t.max_acceleration_deg_s2 - 1.0
            for f, t in pairs
            if f.acceleration_deg_s2 is not None
        ),
        seconds=seconds,
    )


def outcomes(numbers: range, seed: int) -> list[Outcome]:
    """Calibrate the mounts of these numbers."""
    done = []
    for number in numbers:
        drawn = draw(number, seed)
        done.append(judge(drawn, *run_drawn(drawn)))
        if sys.stderr.isatty():
            print(f"\r{len(done)} of {len(numbers)}", end="", file=sys.stderr, flush=True)
    return done


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def table(done: list[Outcome]) -> list[str]:
    """Return the figures, a line each."""
    gains = [g for o in done for g in o.gains]
    pulls = [g / s for o in done for g, s in zip(o.gains, o.gain_sigmas, strict=True)]
    trips = [o.round_trip_s * 1e3 for o in done]
    accelerations = [a for o in done for a in o.accelerations]
    seconds = sorted(o.seconds for o in done)
    excess_ms = max(o.widest_excess_s for o in done) * 1e3
    return [
        f"mounts: {len(done)}",
        f"semantics right: {sum(o.semantics_right for o in done)}",
        f"gain error: {max(map(abs, gains)) * 100:.5f} % worst, {_rms(gains) * 100:.5f} % RMS",
        f"gain error over its sigma: {_rms(pulls):.2f} RMS, {max(map(abs, pulls)):.1f} worst",
        f"round trip error: {max(map(abs, trips)):.2f} ms worst, {_rms(trips):.2f} ms RMS",
        f"round trip sigma told: {_rms([o.round_trip_sigma_s * 1e3 for o in done]):.2f} ms RMS",
        f"intervals hold the truth: {sum(o.intervals_hold for o in done)}",
        f"intervals are wider than the round trip by {excess_ms:.2f} ms at most",
        f"clock drift error: {max(abs(o.drift_ppm) for o in done):.2f} ppm worst, "
        f"{_rms([o.drift_ppm for o in done]):.2f} ppm RMS, "
        f"{_rms([o.drift_ppm / o.drift_sigma_ppm for o in done]):.2f} of its sigma RMS",
        f"acceleration limit seen on {len(accelerations)} of {2 * len(done)} axes, error "
        f"{max(map(abs, accelerations)) * 100:.2f} % worst, {_rms(accelerations) * 100:.2f} % RMS",
        f"a run takes {seconds[0]:.0f} to {seconds[-1]:.0f} s of the mount's time",
    ]


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    done = outcomes(range(draws), seed)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    print("\n".join(table(done)))


if __name__ == "__main__":
    main()

"""The harness of `bench/feeder.py`: a simulated mount, a link with delays and losses, and whoever steers it.

The mount's loop runs by the law of a Windows forms timer: due every 50 ms, it fires at the next multiple of
15.625 ms, up to 1 ms late. Datagrams take their delays, each way, drawn by seed; those that are lost, doubled
or held back are drawn by seed as well. The client sends every 50 ms, at a phase of its own.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from sattrack.control.target import sky_error
from sattrack.mount.xerxes.datagrams import Command, decode_command, encode_command
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import MountProfile
    from sattrack.mount.simulator.mount import SimulatedMount
    from tle.direction import Direction
    from tle.propagator import Propagator

PERIOD_S = 0.05
GRAIN_S = 0.015625
LATE_S = 0.001
HELD_BACK_S = 0.08


@dataclass(frozen=True)
class Link:
    """Delays in seconds, one way each, uniform within `jitter_s`; shares lost, doubled and held back."""

    command_s: float = 0.002
    status_s: float = 0.002
    jitter_s: float = 0.0
    loss: float = 0.0
    doubled: float = 0.0
    held_back: float = 0.0


@dataclass(frozen=True)
class Scenario:
    """One row: how the mount, the link and the world differ from what the controller is told."""

    name: str
    bounds_arcsec: tuple[float, float]
    """RMS and peak that are not to be passed."""
    link: Link = field(default_factory=Link)
    gain: float = 1.0
    disturbance_arcsec_s: float = 0.0
    """Rate that comes on top of the commanded one in right ascension, from the middle of the pass on."""
    move_axis: str = "held"
    clock_offset_s: float = 0.0
    servo: dict[str, float] = field(default_factory=dict)
    """What the drives have beside their bandwidth."""


class Controller(Protocol):
    """Whoever steers."""

    period_s: float

    def status(self, data: bytes, arrival_utc_s: float) -> None: ...

    def command(self, now_utc_s: float) -> bytes: ...

    def shift_s(self, now_utc_s: float) -> float: ...

    def repeat(self) -> bytes | None: ...


@dataclass
class Timer:
    """Instants of the mount's loop."""

    begin_s: float
    rng: random.Random
    _turn: int = 0
    _phase_s: float = field(init=False)
    _last_s: float = 0.0

    def __post_init__(self) -> None:
        self._phase_s = self.rng.uniform(0.0, GRAIN_S)

    def following(self) -> float:
        due_s = self._turn * PERIOD_S
        self._turn += 1
        grains = math.ceil((due_s - self._phase_s) / GRAIN_S)
        fires_s = self._phase_s + grains * GRAIN_S + self.rng.uniform(0.0, LATE_S)
        self._last_s = max(fires_s, self._last_s + 0.001)
        return self.begin_s + self._last_s


class World:
    """One run: all loop instants and delays can be told beforehand, so that an oracle may know them."""

    def __init__(
        self,
        scenario: Scenario,
        mount: SimulatedMount,
        propagator: Propagator,
        span: tuple[float, float],
        seed: int,
    ) -> None:
        self.scenario, self.mount, self.propagator = scenario, mount, propagator
        self.target: Callable[[float], Direction] = lambda utc_s: propagator.at(Utc(utc_s))
        """Where the satellite is to be followed: without any bias, unless a run says otherwise."""
        self.begin_s, self.end_s = span
        rng = random.Random(f"{scenario.name} {seed}")
        timer = Timer(self.begin_s - 0.2, rng)
        self.ticks_s: list[float] = []
        while not self.ticks_s or self.ticks_s[-1] < self.end_s:
            self.ticks_s.append(timer.following())
        self.phase_s = rng.uniform(0.0, PERIOD_S)
        self._rng = rng
        self._delays: dict[tuple[str, int], list[float]] = {}
        self.disturbed_from_s = 0.5 * (self.begin_s + self.end_s)
        self.errors: list[tuple[float, float]] = []
        self.rates: list[tuple[float, float, float]] = []
        self.read: list[int] = []
        """Which datagram was in the mailbox at each of the mount's turns so far, -1 for none."""

    def travels_s(self, way: str, number: int) -> float:
        """Return how long a datagram takes unless it is held back; lost or not."""
        return self._travel_s(way, random.Random(f"{self.phase_s} {way} {number}"))

    def _travel_s(self, way: str, rng: random.Random) -> float:
        link = self.scenario.link
        base_s = link.status_s if way == "status" else link.command_s
        return max(0.0, base_s + rng.uniform(-link.jitter_s, link.jitter_s))

    def delays(self, way: str, number: int) -> list[float]:
        """Return when a datagram arrives after it was sent: never, once or twice."""
        key = (way, number)
        if key not in self._delays:
            rng = random.Random(f"{self.phase_s} {way} {number}")
            link = self.scenario.link
            delay_s = self._travel_s(way, rng)
            if rng.random() < link.held_back:
                delay_s += HELD_BACK_S
            copies = [] if rng.random() < link.loss else [delay_s]
            if copies and rng.random() < link.doubled:
                copies.append(delay_s + rng.uniform(0.0, 0.02))
            self._delays[key] = copies
        return self._delays[key]

    def disturbance_deg_s(self, utc_s: float) -> float:
        return self.scenario.disturbance_arcsec_s / 3600.0 if utc_s >= self.disturbed_from_s else 0.0

    def run(self, controller: Controller) -> None:
        """Run to the end."""
        queue: list[tuple[float, int, Callable[..., None], Any]] = []
        order, mailbox = 0, -1

        def at(utc_s: float, happen: Callable[..., None], what: Any) -> None:
            nonlocal order
            order += 1
            heappush(queue, (utc_s, order, happen, what))

        def client_turn(now_s: float, turn: int) -> None:
            data = controller.command(now_s)
            for delay_s in self.delays("command", turn):
                at(now_s + delay_s, command_arrives, (turn, data))
            at(now_s + REPEAT_AFTER_PERIODS * PERIOD_S, copy, turn)
            at(now_s + controller.period_s + controller.shift_s(now_s), client_turn, turn + 1)

        def copy(now_s: float, turn: int) -> None:
            data = controller.repeat()
            if data is not None:
                for delay_s in self.delays("copy", turn):
                    at(now_s + delay_s, command_arrives, (turn, data))

        def mount_turn(now_s: float, turn: int) -> None:
            self.read.append(mailbox)
            status, truth = self.mount.tick(now_s)
            self._judge(truth)
            for delay_s in self.delays("status", turn):
                at(now_s + delay_s, lambda t, data: controller.status(data, t), status)
            if turn + 1 < len(self.ticks_s):
                at(self.ticks_s[turn + 1], mount_turn, turn + 1)

        def command_arrives(now_s: float, what: tuple[int, bytes]) -> None:
            nonlocal mailbox
            mailbox, data = what
            self.mount.receive(self._disturbed(data, now_s))

        at(self.begin_s + self.phase_s, client_turn, 0)
        at(self.ticks_s[0], mount_turn, 0)
        now_s = self.begin_s
        while queue and now_s < self.end_s:
            now_s, _, happen, what = heappop(queue)
            happen(now_s, what)

    def _disturbed(self, data: bytes, now_s: float) -> bytes:
        extra = self.disturbance_deg_s(now_s)
        if not extra:
            return data
        command = decode_command(data)
        if not command.move_ra:
            return data
        return encode_command(
            msgspec.structs.replace(command, move_ra_rate_deg_s=command.move_ra_rate_deg_s + extra)
        )

    def _judge(self, truth: Any) -> None:
        target = self.target(truth.utc_s)
        error = sky_error(truth.utc_s, truth.ra_deg, truth.dec_deg, target)
        self.errors.append((truth.utc_s, error.total_arcsec))
        self.rates.append((truth.utc_s, truth.ra_rate_deg_s, truth.dec_rate_deg_s))

    def figures(self, from_s: float, to_s: float) -> tuple[float, float]:
        """Return RMS and peak of the error on the sky between two instants, arcseconds."""
        errors = [error for utc_s, error in self.errors if from_s <= utc_s <= to_s]
        return math.sqrt(sum(e * e for e in errors) / len(errors)), max(errors)


def wire(profile: MountProfile, number: int, ra_rate_deg_s: float, dec_rate_deg_s: float) -> bytes:
    """Return the MoveAxis datagram of a controller that speaks to a held, additive mount."""
    assert profile.additive
    return encode_command(
        Command(
            number,
            move_ra=True,
            move_dec=True,
            move_ra_rate_deg_s=-ra_rate_deg_s,
            move_dec_rate_deg_s=dec_rate_deg_s,
        )
    )

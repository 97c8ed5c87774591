"""Stops of mounts written from the paper alone, in virtual time: is rest ever announced too early, or never?

`python bench/rest.py --stops 10000 --seed 1`, `--encoders` for encoders that hang and clocks of whole seconds
or that stand still. A session moves a mount at random rates; then it, or a
`DirectStop` like a guardian's, stops it. The mount's true axes are the judge: at the instant of the
announcement each must be slower than REST_RATE_DEG_S against standstill or the sky. Fields lie, aborts act
late, datagrams are lost and late, by draws that follow from the seed and the number of the stop.
"""

from __future__ import annotations

import argparse
import heapq
import math
import random
import struct
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))

from strangers import planner, position_servo, velocity_servo

from sattrack.control.driver import DirectStop
from sattrack.core.figures import quantile
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Cleared, MountProfile, MoveAxes, Stop
from sattrack.mount.xerxes.session import Session
from sattrack.mount.xerxes.standstill import REST_RATE_DEG_S

if TYPE_CHECKING:
    from types import ModuleType

MOUNTS: tuple[ModuleType, ...] = (velocity_servo, position_servo, planner)
START_UTC_S = 1.79e9
PERIOD_S = 0.05
MOVES_S = (1.0, 3.0)
LONGEST_S = 60.0
STAYS_S = 0.25
"""Datagrams go on for so long after the announcement, as at the end of every stop."""
MODES = [
    (rates, slewing, delay)
    for rates in ("true", "constant", "late", "lying", "nan")
    for slewing in ("true", "false", "quiet", "always")
    for delay in (False, True)
]


class Draw(NamedTuple):
    """One stop: which mount, how it is made, how the link is."""

    seed: int
    mount: int
    parameters: dict[str, Any]
    rates_deg_s: tuple[float, float]
    loss: float
    delay_s: float
    jitter_s: float
    moves_s: float
    halts: bool
    encoders: Encoders | None = None


class Encoders(NamedTuple):
    """An encoder that hangs for a while, after the stop was asked for, and the clock of the statuses."""

    axis: str
    """"ra" where the reported right ascension hangs, "hour angle" where the encoder's does, "dec", "both"."""
    begins_s: float
    lasts_s: float
    clock: str


CLOCKS = ("even", "even", "whole seconds", "still")
DEC_AT, RA_AT, SIDEREAL_AT = 24, 40, 56
"""Places in a status, by the paper's table."""


def draw_encoders(seed: int, number: int) -> Encoders:
    """Return what hangs in a stop, and when."""
    dice = random.Random(f"encoders {seed}/{number}")
    axis = dice.choice(("ra", "hour angle", "dec", "both", "both"))
    return Encoders(axis, dice.uniform(-0.5, 1.5), dice.uniform(0.1, 1.9), dice.choice(CLOCKS))


@dataclass(slots=True)
class Outcome:
    """What came of one stop; instants in seconds after it was asked for."""

    draw: Draw
    rested_s: float | None = None
    """When the true axes came to rest for good, as far as was looked."""
    called_s: float | None = None
    """When rest was announced."""
    speed_deg_s: float = 0.0
    """How fast the true axes were then, against standstill or the sky."""
    moved_on_deg_s: float = 0.0
    """The same, at most, until STAYS_S later."""
    ignored: tuple[str, ...] = ()

    @property
    def early(self) -> bool:
        """Whether the axes moved as rest was announced, or after it."""
        return max(self.speed_deg_s, self.moved_on_deg_s) > REST_RATE_DEG_S


def draw(seed: int, number: int) -> Draw:
    """Return what follows from a seed and a stop's number."""
    dice = random.Random(f"{seed}/{number}")
    rates, slewing, late = MODES[number // len(MOUNTS) % len(MODES)]
    parameters = {
        "start_utc_s": START_UTC_S,
        "hour_angle_deg": dice.uniform(-60.0, 60.0),
        "dec_deg": dice.choice([dice.uniform(-60.0, 80.0), dice.uniform(84.0, 89.0)]),
        "bandwidth_hz": dice.uniform(2.0, 20.0),
        "damping": dice.uniform(0.5, 1.2),
        "feedforward": dice.uniform(0.0, 1.0),
        "acceleration_deg_s2": dice.uniform(2.0, 20.0),
        "move_axis": dice.choice(["held", "edge"]),
        "timer": dice.choice(["even", "windows"]),
        "timer_jitter_s": dice.choice([0.0, 0.01]),
        "stall_s": dice.choice([0.0, 0.1]),
        "encoder_noise_deg": dice.choice([1e-6, 1e-5, 5e-5]),
        "clock_error_s": dice.uniform(-5.0, 5.0),
        "clock_drift_ppm": dice.uniform(-50.0, 50.0),
        "rate_fields": rates,
        "rates_as": "double" if rates == "nan" else dice.choice(["int64", "double"]),
        "slewing_field": slewing,
        "abort_delay_s": dice.uniform(0.0, 8.0) if late else 0.0,
        "move_ack": dice.choice([True, True, False]),
        "seed": dice.randrange(2**31),
    }
    return Draw(
        number,
        number % len(MOUNTS),
        parameters,
        (dice.uniform(-1.7, 1.7), dice.uniform(-1.0, 1.0)),
        dice.choice([0.0, 0.0, dice.uniform(0.0, 0.1)]),
        dice.choice([0.0003, dice.uniform(0.0, 0.06)]),
        dice.choice([0.0, dice.uniform(0.0, 0.02)]),
        dice.uniform(*MOVES_S),
        dice.random() < 0.5,
    )


class Link:
    """Both ways between a mount and whoever sends to it, in virtual time."""

    def __init__(self, mount: Any, drawn: Draw) -> None:
        self.mount, self._drawn = mount, drawn
        self._dice = random.Random(f"link/{drawn.seed}")
        self._under_way: list[tuple[float, int, bool, bytes]] = []
        self._count = 0
        self.now_s = START_UTC_S
        self._next_tick_s = START_UTC_S
        self.asked_s = float("inf")
        """When the stop was asked for."""
        self._hung: tuple[float, float] | None = None
        self._first_h: float | None = None

    def _status(self) -> bytes:
        """Return the mount's status, as its encoders and its clock have it."""
        data, drawn = self.mount.turn(), self._drawn.encoders
        if drawn is None:
            return bytes(data)
        status = bytearray(data)
        (ra_h,), (sidereal_h,) = (struct.unpack_from("<d", status, at) for at in (RA_AT, SIDEREAL_AT))
        (dec_deg,) = struct.unpack_from("<d", status, DEC_AT)
        since_s = self.mount.truth().utc_s - self.asked_s - drawn.begins_s
        if 0.0 <= since_s < drawn.lasts_s:
            clock_h = 0.0 if drawn.axis == "ra" else sidereal_h
            self._hung = (clock_h - ra_h, dec_deg) if self._hung is None else self._hung
            ra_h = ra_h if drawn.axis == "dec" else (clock_h - self._hung[0]) % 24.0
            dec_deg = self._hung[1] if drawn.axis in ("dec", "both") else dec_deg
        else:
            self._hung = None
        if drawn.clock == "whole seconds":
            shown_h = math.floor(sidereal_h * 3600.0) / 3600.0
        else:
            self._first_h = sidereal_h if self._first_h is None else self._first_h
            shown_h = self._first_h if drawn.clock == "still" else sidereal_h
        struct.pack_into("<d", status, RA_AT, ra_h)
        struct.pack_into("<d", status, DEC_AT, dec_deg)
        struct.pack_into("<d", status, SIDEREAL_AT, shown_h)
        return bytes(status)

    def put(self, at_s: float, outward: bool, data: bytes) -> None:
        """Send a datagram one way."""
        if self._dice.random() < self._drawn.loss:
            return
        late_s = self._drawn.delay_s + self._dice.uniform(0.0, self._drawn.jitter_s)
        self._count += 1
        heapq.heappush(self._under_way, (at_s + late_s, self._count, outward, data))

    def run_period(self, session: Session) -> None:
        """Go on until it is time to send again."""
        self._next_tick_s += PERIOD_S
        while True:
            arrives_s = self._under_way[0][0] if self._under_way else float("inf")
            turns_s = self.mount.next_turn_s
            if min(arrives_s, turns_s) > self._next_tick_s:
                break
            if arrives_s <= turns_s:
                at_s, _, outward, data = heapq.heappop(self._under_way)
                if outward:
                    self.mount.receive(data)
                else:
                    session.receive(data, at_s)
            else:
                self.put(turns_s, False, self._status())
        self.now_s = self._next_tick_s

    def speed_deg_s(self) -> float:
        """How fast the faster true axis is, against standstill or the sky."""
        truth = self.mount.truth()
        ra = truth.hour_angle_rate_deg_s
        return max(min(abs(ra), abs(ra - SIDEREAL_RATE_DEG_S)), abs(truth.dec_rate_deg_s))


def run(drawn: Draw) -> Outcome:
    """Move one mount and stop it."""
    module = MOUNTS[drawn.mount]
    mount = module.Mount(module.Parameters(**drawn.parameters))
    profile = MountProfile(move_axis=drawn.parameters["move_axis"])
    link, session = Link(mount, drawn), Session(profile)
    for tick in range(round((0.5 + drawn.moves_s) / PERIOD_S)):
        if tick * PERIOD_S >= 0.5:
            session.apply(Cleared(MoveAxes(*drawn.rates_deg_s)))
        link.put(link.now_s, True, session.compose())
        link.run_period(session)
    if drawn.halts:
        session = DirectStop(profile, link.now_s, session.health.sent).session
    else:
        session.apply(Cleared(Stop()))
    return _stop(link, session, Outcome(drawn))


def _stop(link: Link, session: Session, outcome: Outcome) -> Outcome:
    asked_s = link.asked_s = link.now_s
    while link.now_s - asked_s < LONGEST_S:
        link.put(link.now_s, True, session.compose())
        link.run_period(session)
        speed, after_s = link.speed_deg_s(), link.now_s - asked_s
        if speed > REST_RATE_DEG_S:
            outcome.rested_s = None
        elif outcome.rested_s is None:
            outcome.rested_s = after_s
        if outcome.called_s is None and session.stopped:
            outcome.called_s, outcome.speed_deg_s = after_s, speed
        if outcome.called_s is not None:
            outcome.moved_on_deg_s = max(outcome.moved_on_deg_s, speed)
            if after_s - outcome.called_s >= STAYS_S:
                break
    outcome.ignored = session.ignored_fields
    return outcome


def stops(count: int, seed: int, processes: int, encoders: bool = False) -> list[Outcome]:
    """Run so many stops of a seed."""
    one = partial(_numbered, seed, encoders)
    if processes == 1:
        return [one(number) for number in range(count)]
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(one, range(count), chunksize=50))


def _numbered(seed: int, encoders: bool, number: int) -> Outcome:
    drawn = draw(seed, number)
    return run(drawn._replace(encoders=draw_encoders(seed, number)) if encoders else drawn)


def main() -> int:
    """Print the figures; returns 1 where rest was announced of axes that moved, or never."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--encoders", action="store_true", help="encoders that hang, clocks that stand")
    options = parser.parse_args()
    outcomes = stops(options.stops, options.seed, options.processes, options.encoders)
    early = [one for one in outcomes if one.called_s is not None and one.early]
    never = [one for one in outcomes if one.called_s is None]
    late_s = sorted(
        one.called_s - one.rested_s
        for one in outcomes
        if one.called_s is not None and one.rested_s is not None
    )
    print(f"{len(outcomes)} stops, seed {options.seed}; bound {REST_RATE_DEG_S:.4f} °/s")
    print(f"announced at rest while an axis was faster: {len(early)}")
    print(f"at rest and never announced within {LONGEST_S:g} s: {len(never)}")
    shares = ", ".join(f"{quantile(late_s, share):.2f} s ({share:.0%})" for share in (0.1, 0.5, 0.9, 0.99))
    print(f"announced after the axes rested: {shares}, {late_s[-1]:.2f} s at most")
    kinds = Counter(
        words.partition("mount's ")[2].partition(":")[0] for one in outcomes for words in one.ignored
    )
    for words, count in sorted(kinds.items()):
        print(f"  {count} times: {words}")
    for one in (early + never)[:10]:
        print(one)
    return 1 if early or never else 0


if __name__ == "__main__":
    sys.exit(main())

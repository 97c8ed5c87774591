"""A schedule run for many nights in virtual time: passes accounted for, the mount parked, and what if killed.

    python bench/schedule_night.py                  # 14 nights, 300 satellites, troubles drawn from a seed
    python bench/schedule_night.py --kills 300 --nights 10 --most 6 --longest 120
    python bench/schedule_night.py --nights 2 --satellites 40 --again

`--again` runs the same once more and compares the two journals. `--kills N` ends the runner by SIGKILL at N
random instants: by turns at one of the nights' clock, anywhere or within passes, as something is kept, and
after up to an eighth of a second of ours. What comes of it is compared with the same nights undisturbed, both
without other troubles. Margins are measured here, of the simulated axes at each turn of the mount's loop, by
formulas that share nothing with the safety gate; the Sun is the Astronomical Almanac's low-precision one. The
ratio is that of the time that the nights take to what the process took.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import signal
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "sattrack" / "schedule"))
from planning_nights import random_sky

from sattrack.cli.main import run as run_command
from sattrack.schedule import machine
from sattrack.schedule.night import Event, Mount, Run, RunState, Started
from sattrack.schedule.night_folder import FILE_NAME, Journal
from sattrack.schedule.virtual_executor import WatchedMount
from tle.instants import Utc
from tle.sources import write_elements

BEGIN = "2026-10-02T12:00:00Z"
LATITUDE_DEG, LONGITUDE_DEG = 52.1541, 4.4908
SITE = f"{LATITUDE_DEG},{LONGITUDE_DEG},0"
HOUR_ANGLE_LIMIT_DEG, SUN_CONE_DEG, FLOOR_DEG = 200.0, 15.0, 0.0
PROFILE = 'name = "simulated"\npark = { hour_angle_deg = 0.0, dec_deg = 30.0 }\n'
LONGEST_LIFE_S = 0.125
"""A runner that is killed by our time lives no longer than this."""
RULE = "all, above 20°, dark, max {most}"


@dataclass
class Margins:
    """How near the axes came to each limit, degrees; below 0 is past it."""

    altitude: float = 90.0
    hour_angle: float = 360.0
    sun: float = 180.0
    looks: int = 0

    def look(self, ha_deg: float, dec_deg: float, utc_s: float) -> None:
        self.looks += 1
        h, d, p = (math.radians(x) for x in (ha_deg, dec_deg, LATITUDE_DEG))
        sine = math.sin(p) * math.sin(d) + math.cos(p) * math.cos(d) * math.cos(h)
        self.altitude = min(self.altitude, math.degrees(math.asin(max(-1.0, min(1.0, sine)))) - FLOOR_DEG)
        self.hour_angle = min(self.hour_angle, HOUR_ANGLE_LIMIT_DEG - abs(ha_deg))
        if self.looks % 20 == 0:
            sun_ha, sun_dec = sun_place(utc_s)
            if altitude_deg(sun_ha, sun_dec) > -1.0:
                self.sun = min(self.sun, apart_deg(ha_deg, dec_deg, sun_ha, sun_dec) - SUN_CONE_DEG)


def altitude_deg(ha_deg: float, dec_deg: float) -> float:
    h, d, p = (math.radians(x) for x in (ha_deg, dec_deg, LATITUDE_DEG))
    return math.degrees(math.asin(math.sin(p) * math.sin(d) + math.cos(p) * math.cos(d) * math.cos(h)))


def apart_deg(ha_1: float, dec_1: float, ha_2: float, dec_2: float) -> float:
    h, one, other = (math.radians(x) for x in (ha_1 - ha_2, dec_1, dec_2))
    cosine = math.sin(one) * math.sin(other) + math.cos(one) * math.cos(other) * math.cos(h)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def sun_place(utc_s: float) -> tuple[float, float]:
    """Hour angle and declination of the Sun, degrees, good to 0.01°; sidereal time as the Almanac has it."""
    days = utc_s / 86400.0 - 10957.5
    anomaly = math.radians(357.528 + 0.9856003 * days)
    longitude = math.radians(
        280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    )
    tilt = math.radians(23.439)
    ra = math.degrees(math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude)))
    dec = math.degrees(math.asin(math.sin(tilt) * math.sin(longitude)))
    sidereal = 280.46062 + 360.98564737 * days + LONGITUDE_DEG
    return (sidereal - ra) % 360.0, dec


@contextmanager
def watched(margins: Margins):
    """Look at the axes of every simulated mount."""
    tick = WatchedMount.tick

    def look(self, now_utc_s):
        status, truth = tick(self, now_utc_s)
        margins.look(truth.hour_angle_axis_deg, truth.dec_axis_deg, truth.utc_s)
        return status, truth

    WatchedMount.tick = look
    try:
        yield
    finally:
        WatchedMount.tick = tick


@dataclass
class Plan:
    """Which nights are run, and where."""

    folder: Path
    nights: int = 2
    satellites: int = 40
    most: int = 4
    longest_s: float = 60.0
    least_s: float = 30.0
    seed: int | None = None
    extra: str = ""

    def write(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "sky.tle").write_text(write_elements(random_sky(self.satellites), "tle"))
        (self.folder / "mount.toml").write_text(PROFILE)
        end = Utc(float(Utc.parse(BEGIN).unix_s) + self.nights * 86400.0).isoformat("seconds")
        rule = RULE.format(most=self.most)
        (self.folder / "nights.toml").write_text(
            f'from = {BEGIN}\nto = {end}\n[weather]\nfile = "weather.txt"\n'
            f"[defaults]\nshorten = true\nleast_s = {self.least_s}\nelements_oldest_days = 30\n"
            f"longest_s = {self.longest_s}\n{self.extra}"
            f'[[passes]]\nrule = "{rule}"\n',
            encoding="utf-8",
        )

    def arguments(self, into: str) -> list[str]:
        f = self.folder
        options = ["--elements", str(f / "sky.tle"), "--profile", str(f / "mount.toml"), "--site", SITE]
        if self.seed is not None:
            options += ["--seed", str(self.seed)]
        return [
            "run",
            str(f / "nights.toml"),
            "--virtual",
            "--mount",
            "sim",
            "--folder",
            str(f / into),
            *options,
        ]

    def run(self, into: str = "run") -> int:
        with (self.folder / f"{into}.log").open("a") as log, redirect_stderr(log), redirect_stdout(log):
            return run_command(self.arguments(into))

    def journal(self, into: str = "run") -> Path:
        return self.folder / into / FILE_NAME


def rows(journal: Path) -> list[tuple]:
    with sqlite3.connect(journal) as base:
        return base.execute(
            "SELECT number, utc_s, event, state, doing FROM events ORDER BY number"
        ).fetchall()


@dataclass
class Told:
    """What a journal tells: each night as it was summed up, and when the runner was last alive."""

    nights: list[Run] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)


def told(journal: Path) -> Told:
    found, run = Told(), Run()
    for _, _, event, state, _ in rows(journal):
        before = run.state
        back = msgspec.json.decode(event, type=Event, dec_hook=lambda _, value: Utc(float(value)))
        run, _ = machine.step(run, back)
        assert run.state == state
        if isinstance(back, Started) and back.last_utc_s is not None:
            found.ends.append(back.last_utc_s)
        if run.state is RunState.SUMMING_UP and before is not RunState.SUMMING_UP:
            found.nights.append(run)
    return found


def killed(plan: Plan, into: str, instants: list[float], rng: random.Random) -> int:
    """Run with the runner ended by SIGKILL again and again; return how often it was.

    At each instant of its own clock, just before or after something is kept; between these, some time of ours
    after it came up.
    """
    kills, waiting = 0, sorted(instants)
    while True:
        by_clock = kills % 2 == 0
        dies = waiting.pop(0) if waiting and by_clock else math.inf
        child = os.fork()
        if child == 0:
            _die_at(dies, rng.random() < 0.5)
            os._exit(plan.run(into))
        if waiting and not by_clock:
            time.sleep(rng.uniform(0.0, LONGEST_LIFE_S))
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if os.WIFEXITED(status):
            assert os.WEXITSTATUS(status) == 0, (plan.folder / f"{into}.log").read_text()[-2000:]
            return kills
        assert os.WTERMSIG(status) == signal.SIGKILL
        kills += 1
        rng.random()


def _die_at(utc_s: float, before: bool) -> None:
    """Let this process end as soon as its journal hears of an instant: before it is kept, or just after."""
    append, beat = Journal.append, Journal.beat

    def die(at: float) -> None:
        if at >= utc_s:
            os.kill(os.getpid(), signal.SIGKILL)

    def appending(self, event, run, order):
        if before:
            die(event.utc_s)
        append(self, event, run, order)
        die(event.utc_s)

    def beating(self, sign):
        if before:
            die(sign.utc_s)
        beat(self, sign)
        die(sign.utc_s)

    Journal.append, Journal.beat = appending, beating


def instants_for(nights: list[Run], count: int, rng: random.Random) -> list[float]:
    passes = [one for night in nights for one in night.passes]
    begin, end = nights[0].night_from_utc_s, passes[-1].leave_utc_s
    found = [rng.uniform(begin, end) for _ in range(count // 2)]
    while len(found) < count:
        one = rng.choice(passes)
        found.append(rng.uniform(one.leave_utc_s, one.end_utc_s))
    return found


@dataclass
class Loss:
    """What kills cost: passes compared, those that differ though none was killed in them, seconds lost."""

    passes: int = 0
    in_progress: int = 0
    unlike: int = 0
    lost_s: float = 0.0
    worst_s: float = 0.0
    twice: int = 0


def compared(undisturbed: Told, disturbed: Told) -> Loss:
    loss = Loss()
    for one, other in zip(undisturbed.nights, disturbed.nights, strict=True):
        assert [p.key for p in one.passes] == [p.key for p in other.passes]
        for k, (target, was, became) in enumerate(zip(one.passes, one.results, other.results, strict=True)):
            loss.passes += 1
            begin = min(one.passes[k - 1].end_utc_s if k else math.inf, target.leave_utc_s - 200.0)
            hit = any(begin <= at <= target.end_utc_s for at in disturbed.ends)
            less = was.on_target_s - became.on_target_s
            if not hit:
                loss.unlike += abs(less) > 0.3 or was.state != became.state
                continue
            loss.in_progress += 1
            loss.lost_s += max(0.0, less)
            loss.worst_s = max(loss.worst_s, less)
            loss.twice += became.on_target_s > target.end_utc_s - target.start_utc_s + 0.1
    return loss


def tell_nights(found: Told, nights: int) -> None:
    passes = sum(len(night.passes) for night in found.nights)
    states = Counter(result.state for night in found.nights for result in night.results)
    causes = Counter(r.cause for night in found.nights for r in night.results if r.state != "done")
    without = (
        passes
        - sum(states.values())
        + sum(not r.cause for night in found.nights for r in night.results if r.state != "done")
    )
    parked = sum(night.mount is Mount.PARKED for night in found.nights)
    print(
        f"{nights} nights, {passes} passes planned: {states['done']} done, {states['partly']} in part, "
        f"{states['lost']} lost; {without} not accounted for"
    )
    print("not done, by cause: " + ", ".join(f"{n} {cause}" for cause, n in sorted(causes.items())))
    print(f"the mount was parked at the end of {parked} of {len(found.nights)} nights")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nights", type=int, default=14)
    parser.add_argument("--satellites", type=int, default=300)
    parser.add_argument("--most", type=int, default=12, help="passes a night")
    parser.add_argument("--longest", type=float, default=600.0, help="seconds of a pass")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--kills", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(
            Path(folder), options.nights, options.satellites, options.most, options.longest, seed=options.seed
        )
        if options.kills:
            plan.seed = None
        plan.write()
        margins = Margins()
        began_s, used_s = time.perf_counter(), time.process_time()
        with watched(margins):
            assert plan.run() == 0, (plan.folder / "run.log").read_text()[-2000:]
        took_s, used_s = time.perf_counter() - began_s, time.process_time() - used_s
        found = told(plan.journal())
        tell_nights(found, options.nights)
        sun = "the Sun below the horizon throughout" if margins.sun == 180.0 else ""
        print(
            f"at the nearest {margins.altitude:.1f}° above the floor, {margins.hour_angle:.1f}° inside the "
            f"hour angle's travel, {sun or f'{margins.sun:.1f}° outside the cone of the Sun'}, in "
            f"{margins.looks} turns"
        )
        real_s = options.nights * 86400.0
        ratios = [f"{real_s / seconds:.0f}" for seconds in (took_s, used_s)]
        print(f"{ratios[0]} times faster than real time by the clock, {ratios[1]} by the processor's time")
        if options.again:
            plan.run("again")
            same = rows(plan.journal()) == rows(plan.journal("again"))
            print(f"the same seed once more: {'the same journal' if same else 'ANOTHER JOURNAL'}")
        if options.kills:
            instants = instants_for(found.nights, (options.kills + 1) // 2, rng)
            kills = killed(plan, "killed", instants, rng)
            loss = compared(found, told(plan.journal("killed")))
            print(
                f"killed {kills} times in {loss.passes} passes, while {loss.in_progress} of them were in "
                f"progress or prepared: these lost {loss.lost_s:.0f} s together, {loss.worst_s:.0f} s "
                f"at most; of the others {loss.unlike} differ; {loss.twice} were followed twice"
            )


if __name__ == "__main__":
    main()

"""Passes against skyfield's `find_events`: how much faster, whether the same; ratios are taken by turns.

A random 300 objects of each class of orbit (near the Earth and round; near and eccentric; about synchronous;
deep space and eccentric; other deep space) stand for the class: skyfield's time is extrapolated by the
class's size, ours is of the whole catalogue, with all processors. Both get the same Earth orientation. Prints
each class, then the ratios for 24 h above 10° over one site, what is missed or invented of passes longer than
a second, how far apart the times are, the largest memory, and the ratios for one satellite over ten days and
for the command's start. Times are compared with skyfield's own root of its altitude: `find_events` stops
within a tenth of a second of it.

Run it as `python bench/passes.py CATALOGUE` with a TLE file, gzipped or not; `--each N` takes N instead of
300, `--workers N` the number of processes (as many as processors without it). It needs skyfield, but
with `--command`, which measures the command with a whole catalogue and nothing else. Ratios of time by
the clock shrink where other work leaves ours fewer processors than there are; those of the processors' own
time, of one against the sum of all, do not.
"""

from __future__ import annotations

import argparse
import gzip
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np

from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.errors import TleError
from tle.instants import Utc
from tle.passes import find_catalogue_passes, find_passes
from tle.propagator import Propagator
from tle.site import Site
from tle.sources import parse_elements

SITE = (52.1541, 4.4908, 0.0)
DUT1_S, XP_ARCSEC, YP_ARCSEC = 0.05, 0.17, 0.32
EARTH = EarthOrientation.fixed(DUT1_S, XP_ARCSEC, YP_ARCSEC)
START = Utc.parse("2025-09-01T00:00:00Z")
HOURS, MIN_ALT_DEG = 24.0, 10.0
ROUNDS = 5
# As many of ours as take about as long as one of skyfield's.
REPEATS = 10
ISS = 25544
# Matches no name: the command reads the catalogue and ends.
_NOBODY = "no such satellite"
PEERS = ("skyfield", "sgp4", "numpy")


def timescale():  # type: ignore[no-untyped-def]
    # Imported here, so that `--command` does without.
    from skyfield.api import load
    from skyfield.timelib import Timescale

    builtin = load.timescale(builtin=True)
    ends = np.array([2400000.0, 2500000.0])
    made = Timescale((ends, np.full(2, 69.184 - DUT1_S)), builtin.leap_dates, builtin.leap_offsets)
    made.polar_motion_table = (ends, np.full(2, XP_ARCSEC), np.full(2, YP_ARCSEC))
    return made


def orbit_class(one: Elements) -> str:
    deep, eccentric = one.period_s >= 225.0 * 60.0, one.eccentricity >= 0.05
    if not deep:
        return "near, eccentric" if eccentric else "near, round"
    if eccentric:
        return "deep, eccentric"
    return "synchronous" if abs(one.mean_motion_rev_day - 1.0) < 0.1 else "deep, round"


class Peer:
    """skyfield with the same Earth orientation."""

    def __init__(self, hours: float) -> None:
        from skyfield.api import EarthSatellite, wgs84

        self.timescale, self.satellite = timescale(), EarthSatellite.from_satrec
        self.place = wgs84.latlon(SITE[0], SITE[1], elevation_m=SITE[2])
        day, fraction = START.split()
        self.ends = [
            self.timescale.tt_jd(day, fraction + (69.184 + s) / 86400.0) for s in (0.0, hours * 3600.0)
        ]

    def events(self, one: Elements):  # type: ignore[no-untyped-def]
        """Return seconds since the start and kinds (0 rise, 1 culmination, 2 set)."""
        times, kinds = self.satellite(one.satrec(), self.timescale).find_events(
            self.place, *self.ends, altitude_degrees=MIN_ALT_DEG
        )
        day, fraction = START.split()
        return ((times.whole - day) + (times.tt_fraction - fraction)) * 86400.0 - 69.184, kinds

    def altitude_deg(self, one: Elements, since_s):  # type: ignore[no-untyped-def]
        day, fraction = START.split()
        times = self.timescale.tt_jd(day, fraction + (69.184 + since_s) / 86400.0)
        seen = (self.satellite(one.satrec(), self.timescale) - self.place).at(times)
        return seen.altaz()[0].degrees

    def highest(self, one: Elements, rise_s: float, set_s: float) -> float:
        return float(self.altitude_deg(one, np.arange(rise_s, set_s, 0.05)).max())

    def seconds_from_root(self, one: Elements, edges_s) -> list[float]:  # type: ignore[no-untyped-def]
        """Return how far from instants this altitude is the one asked for, by its value and slope there."""
        if len(edges_s) == 0:
            return []
        before, at, after = (self.altitude_deg(one, edges_s + d) for d in (-0.05, 0.0, 0.05))
        return [float(s) for s in np.abs((at - MIN_ALT_DEG) / ((after - before) / 0.1))]


def timed(work):  # type: ignore[no-untyped-def]
    start = time.perf_counter()
    done = work()
    return time.perf_counter() - start, done


def timed_twice(work):  # type: ignore[no-untyped-def]
    """Return seconds by the clock and of processors, those of other processes included, and what is done."""
    start_s, (spent_s, done) = processor_s(), timed(work)
    return np.array([spent_s, processor_s() - start_s]), done


def processor_s() -> float:
    own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def compare(peer: Peer, one: Elements, ours, events) -> tuple[int, int, int, list[float]]:  # type: ignore[no-untyped-def]
    """Return how many passes over 1 s there are, missed and invented ones, and differences in seconds."""
    end_s = HOURS * 3600.0
    theirs = spans(*events)
    mine = [
        (
            0.0 if p.rise_utc is None else p.rise_utc - START,
            end_s if p.set_utc is None else p.set_utc - START,
        )
        for p in ours
    ]
    missed = [t for t in theirs if t[1] - t[0] > 1.0 and not any(m[0] < t[1] and m[1] > t[0] for m in mine)]
    extra = [m for m in mine if m[1] - m[0] > 1.0 and not any(t[0] < m[1] and t[1] > m[0] for t in theirs)]
    # What one has and the other not is put to skyfield's altitude, every 50 ms.
    wrong = [t for t in missed if peer.highest(one, *t) > MIN_ALT_DEG]
    invented = [m for m in extra if peer.highest(one, *m) <= MIN_ALT_DEG]
    for what, rise, set_ in [*(("skyfield", *t) for t in missed), *(("ours", *m) for m in extra)]:
        print(f"  {what} alone: {one.label}, {START.plus(rise).isoformat()} for {set_ - rise:.2f} s")
    edges = np.array([s for m in mine for s in m if 0.0 < s < end_s])
    return len(mine), len(wrong), len(invented), peer.seconds_from_root(one, edges)


def spans(times, kinds) -> list[tuple[float, float]]:  # type: ignore[no-untyped-def]
    """Return rise and set of each pass among skyfield's events, the span's ends where it gives none."""
    found, rise, up = [], 0.0, bool(len(kinds)) and kinds[0] != 0
    for t, kind in zip(times.tolist(), kinds.tolist(), strict=True):
        if kind == 0:
            rise, up = t, True
        elif kind == 2:
            found.append((rise, t))
            up = False
    return [*found, (rise, HOURS * 3600.0)] if up else found


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    arguments.add_argument("catalogue", type=Path)
    arguments.add_argument("--each", type=int, default=300)
    arguments.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    arguments.add_argument("--command", action="store_true", help="measure the command as users run it only")
    given = arguments.parse_args()
    if not given.catalogue.is_file():
        sys.exit(f"{given.catalogue}: no such catalogue: nothing measured")
    if given.command:
        whole_command(given.catalogue)
        return
    data = given.catalogue.read_bytes()
    text = (gzip.decompress(data) if given.catalogue.suffix == ".gz" else data).decode()
    catalogue = [e for e in parse_elements(text) if isinstance(e, Elements)]
    names = sorted({orbit_class(e) for e in catalogue})
    versions = ", ".join(f"{p} {version(p)}" for p in PEERS)
    print(
        f"{versions}; {len(catalogue)} objects, {HOURS:.0f} h, above {MIN_ALT_DEG:.0f}°, "
        f"{given.workers} processes"
    )
    compare_catalogue(catalogue, names, given)
    one_satellite(next((e for e in catalogue if e.catalog_number == ISS), catalogue[0]))
    start_up()
    whole_command(given.catalogue)


def compare_catalogue(catalogue: list[Elements], names: list[str], given: argparse.Namespace) -> None:
    """Print speed and agreement over a whole catalogue."""
    peer, site = Peer(HOURS), Site(*SITE)
    rng = np.random.default_rng(20250901)
    theirs_s: list[np.ndarray] = []
    ours_s: list[np.ndarray] = []
    totals = np.zeros(3, dtype=int)
    apart: list[float] = []
    for number in range(ROUNDS):
        # A part of each class at a time, so that both meet the same other work on the machine.
        whole_s = np.zeros(2)
        for name in names:
            members = [e for e in catalogue if orbit_class(e) == name]
            share = max(1, min(given.each, len(members)) // ROUNDS)
            chosen = [members[i] for i in rng.choice(len(members), share, replace=False)]
            spent, events = timed_twice(lambda chosen=chosen: [safely(peer, e) for e in chosen])
            whole_s += spent * len(members) / share
            passes = find_catalogue_passes(chosen, site, START, HOURS, MIN_ALT_DEG, earth=EARTH)
            failed = {id(e) for e, _ in passes.failed}
            for one, pair in zip(chosen, events, strict=True):
                if pair is None or id(one) in failed:
                    continue
                mine = [p.seen for p in passes if p.elements is one]
                counts = compare(peer, one, mine, pair)
                totals += counts[:3]
                apart += counts[3]
            print(
                f"  {name}: {len(members)} objects, skyfield {spent[0] / share * 1e3:.2f} ms each", flush=True
            )
        theirs_s.append(whole_s)
        print(f"round {number + 1}: skyfield {whole_s[0]:.1f} s (extrapolated)", flush=True)
        spent, passes = timed_twice(
            lambda: find_catalogue_passes(
                catalogue, site, START, HOURS, MIN_ALT_DEG, earth=EARTH, workers=given.workers
            )
        )
        ours_s.append(spent)
        print(f"  ours {spent[0]:.2f} s, {len(passes)} passes", flush=True)
    wall, processor = np.sort(np.array(theirs_s) / np.array(ours_s), axis=0).T
    print(
        f"whole catalogue: {np.median(wall):.0f} times as fast as skyfield "
        f"({wall[0]:.0f} to {wall[-1]:.0f}), {np.median(processor):.0f} times by processors' time "
        f"({processor[0]:.0f} to {processor[-1]:.0f})"
    )
    print(
        f"  {totals[0]} passes compared: {totals[1]} missed, {totals[2]} invented of "
        f"those over 1 s; times apart by at most {max(apart):.4f} s"
    )
    memory = sum(
        resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    print(f"at most {memory / 1024.0:.0f} MiB, skyfield's own included")


def safely(peer: Peer, one: Elements):  # type: ignore[no-untyped-def]
    try:
        return peer.events(one)
    except (TleError, ValueError, IndexError):
        return None


def one_satellite(one: Elements) -> None:
    """Print the ratio for one satellite over ten days."""
    peer, site = Peer(240.0), Site(*SITE)
    ratios = []
    for _ in range(21):
        theirs, events = timed_twice(lambda: peer.events(one))
        ours, found = timed_twice(
            lambda: [
                find_passes(Propagator(one, site, earth=EARTH), START, 240.0, MIN_ALT_DEG)
                for _ in range(REPEATS)
            ]
        )
        ratios.append(REPEATS * theirs / ours)
    wall, processor = np.sort(np.array(ratios), axis=0).T
    rises = int((events[1] == 0).sum())
    print(
        f"one satellite ({one.label}), 10 days: {np.median(wall):.1f} times as fast ({wall[0]:.1f} to "
        f"{wall[-1]:.1f}), {np.median(processor):.1f} times by processors' time ({processor[0]:.1f} to "
        f"{processor[-1]:.1f}); {len(found[0])} passes, skyfield {rises} rises"
    )


def start_up() -> None:
    """Print how long the command takes to its first line, against importing numpy and sgp4 alone."""
    source = Path(__file__).parents[1] / "examples" / "iss_leiden.tle"
    site = ",".join(str(value) for value in SITE)
    command = ["-m", "sattrack", "passes", "25544", "--elements", str(source), "--site", site]
    ratios = []
    with tempfile.TemporaryDirectory() as name:
        # Both find the bytecode that their first start has left, as on any machine from the second start on.
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        environment["PYTHONPYCACHEPREFIX"] = name

        def start(*arguments: str) -> float:
            line = [sys.executable, *arguments]
            out = subprocess.DEVNULL
            return timed(lambda: subprocess.run(line, check=True, stdout=out, env=environment))[0]

        for k in range(12):
            bare = start("-c", "import numpy, sgp4")
            whole = start(*command, "--from", "2026-10-02")
            if k:
                ratios.append(whole / bare)
    ratios.sort()
    print(
        f"the command for one satellite: {statistics.median(ratios):.2f} times as long as importing "
        f"numpy and sgp4 ({ratios[0]:.2f} to {ratios[-1]:.2f})"
    )


def whole_command(catalogue: Path) -> None:
    """Print how long the command takes with a whole catalogue, reading and showing included."""
    command = [sys.executable, "-m", "sattrack", "passes", "--elements", str(catalogue)]
    command += ["--site", ",".join(str(value) for value in SITE), "--from", START.isoformat()]
    kinds = ((), ("--json",), ("--csv",), ("--dark", "--sunlit"), ("--name", "COSMOS*"))
    for options in kinds:
        ratios, spent = [], (0.0, 0.0)
        for _ in range(ROUNDS):
            bare = run_whole([*command, "--name", _NOBODY])
            spent = run_whole([*command, *options])
            ratios.append(spent[1] / bare[1])
        ratios.sort()
        print(
            f"the command for the whole catalogue, {' '.join(('passes', *options))}: {spent[0]:.1f} s, "
            f"{spent[1]:.1f} s of processors, {memory_mib([*command, *options]):.0f} MiB; "
            f"{statistics.median(ratios):.1f} times the processors' time of reading the catalogue alone "
            f"({ratios[0]:.1f} to {ratios[-1]:.1f})"
        )


def run_whole(command: list[str]) -> tuple[float, float]:
    """Run a command; return its seconds by the clock and of processors, those of its children included."""
    before_s, start = processor_s(), time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    return time.perf_counter() - start, processor_s() - before_s


def memory_mib(command: list[str]) -> float:
    """Run a command; return the most that it and its children held, what they share counted once (Linux)."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        most = 0.0
        while process.poll() is None:
            most = max(most, sum(_share_mib(pid) for pid in [process.pid, *_children(process.pid)]))
            time.sleep(0.1)
    return most


def _children(pid: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def _share_mib(pid: int) -> float:
    """Return what a process holds, its part of what it shares with others; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024.0


if __name__ == "__main__":
    main()

"""Errors of the axes that repeat in a turn, hidden, learnt from recorded passes: python bench/periodic.py.

python bench/periodic.py [--seeds N] [--first N] [--passes N] [--waves W]

For each seed a mount is hidden: its axes stand past what they report by 10″ at 7 a turn, each with a phase
of its own, and by 2″ at 144 a turn; its pole is beside the celestial one, its telescope beside its axis, its
tube bends. `sattrack.mount.simulator.camera` says where its camera sees the satellite: rotations of vectors,
ERFA and SGP4, no formula of the fit. Passes of two orbits are followed in virtual time and recorded; the
satellite's orbit is not that of its elements, the camera's image is turned, with 1.5″ of noise.

`sattrack report --learn-profile` learns from the first passes. Later ones are followed without what was
learnt, with it, and with it after the first gear was turned by half a wave. *seen*: the satellite from the
middle of the image, RMS from 20 s after the first frame on, while the camera corrects. *waves*: what hidden
waves make on the sky along the later pass, RMS, and what the table leaves of them, in the share of the pass
in which an axis stands where it did in the passes before; the first axis, then the second.
"""

from __future__ import annotations

import argparse
import math
import random
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from feeder_passes import pass_facts

from sattrack.cli.main import run as sattrack
from sattrack.control.camera_image import Camera
from sattrack.control.engine_view import view_of
from sattrack.mount.model import MountProfile, mean_sidereal_deg
from sattrack.mount.profiles import load_profile_file
from sattrack.mount.simulator.camera import SkyCamera, TruePath, make_sky
from sattrack.mount.simulator.hidden import Hidden, SimulatedCamera, waves
from sattrack.mount.simulator.mount import SimulatedMount, Truth
from sattrack.pointing.periodic import AxisStand, PeriodicTable
from sattrack.recording.recorder import NoRecording, Recorder, Sink, create
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import simulated_site
from sattrack.runtime.facts import RunFacts, build_engine, encode_facts
from sattrack.runtime.flight import VirtualRun, summarise
from sattrack.views.messages import SeenOffset
from tle.instants import Utc
from tle.passes import find_passes
from tle.propagator import Propagator

if TYPE_CHECKING:
    from tle.elements import Elements

FRAME_S, EXPOSURE_S, NOISE_ARCSEC = 1.0, 0.05, 1.5
LATE_S = (0.3, 0.9)
SETTLED_S = 20.0
SCALE = 2.5
LOWEST_DEG, LEAST_CULMINATION_DEG, MOST_CULMINATION_DEG = 15.0, 30.0, 80.0
HOURS = 200.0
HALF_WAVE_DEG = 180.0 / 7.0


def passes_of_demo(count: int) -> list[RunFacts]:
    """Return passes over Leiden of the practice pass' satellite, and of one in a polar orbit, by time."""
    iss, site = demo_pass.elements(), demo_pass.SITE.place()
    polar = replace(iss, name="POLAR", catalog_number=90001, inclination_deg=98.0)
    now, found = Utc.parse(demo_pass.BEFORE_PASS), []
    every = [
        (float(one.culminate_utc.unix_s), one, elements)
        for elements in (iss, polar)
        for one in find_passes(Propagator(elements, site), now, HOURS, LOWEST_DEG)
    ]
    for _, one, elements in sorted(every, key=lambda known: known[0]):
        if not LEAST_CULMINATION_DEG < one.max_alt_deg < MOST_CULMINATION_DEG:
            continue
        if one.rise_utc is None or one.set_utc is None:
            continue
        facts = pass_facts(one, elements, site, now, before_s=40.0)
        found.append(msgspec.structs.replace(facts, cameras={"guide": Camera(0.0, False, SCALE)}))
        if len(found) == count:
            break
    return found


@dataclass
class Mount:
    """One mount, hidden: what its axes and its telescope do; and chances."""

    hidden: Hidden
    rng: random.Random

    def satellite(self, elements: Elements) -> Elements:
        """Draw where a satellite is: up to a second early or late, and beside its elements as orbits are."""
        draw, revolutions = self.rng, elements.mean_motion_rev_day
        early_deg = draw.uniform(-1.0, 1.0) * revolutions * 360.0 / 86400.0
        return replace(
            elements,
            mean_anomaly_deg=(elements.mean_anomaly_deg + early_deg) % 360.0,
            mean_motion_rev_day=revolutions * (1.0 + draw.gauss(0.0, 1e-6)),
            inclination_deg=elements.inclination_deg + draw.gauss(0.0, 0.001),
            raan_deg=(elements.raan_deg + draw.gauss(0.0, 0.001)) % 360.0,
            eccentricity=abs(elements.eccentricity + draw.gauss(0.0, 3e-5)),
        )


def drawn(seed: int, sizes: str = "10x7+2x144") -> Mount:
    """Return a mount of a seed; `sizes` are the waves of either axis, without their phases."""
    rng = random.Random(f"gears {seed}")
    texts = [
        "+".join(f"{one}@{rng.uniform(0.0, 360.0):.1f}" for one in sizes.split("+") if one) for _ in (0, 1)
    ]
    hidden = Hidden(
        ha_wave=texts[0],
        dec_wave=texts[1],
        polar_az=rng.uniform(-2.0, 2.0),
        polar_alt=rng.uniform(-2.0, 2.0),
        ha=rng.uniform(-60.0, 60.0),
        dec=rng.uniform(-60.0, 60.0),
        cone=rng.uniform(-60.0, 60.0),
        flexure=rng.uniform(0.0, 15.0),
        rotation=rng.gauss(0.0, 2.0),
        scale=1.0 + rng.gauss(0.0, 0.01),
        shadow=0,
    )
    return Mount(hidden, rng)


@dataclass
class Followed:
    """What came of a pass, in truth: errors on the sky, arcseconds, since the first frame on target."""

    seen: list[tuple[float, float]] = field(default_factory=list)
    """Seconds since the first frame, and how far the satellite is from the middle of the image."""
    table_left: bool = False
    warnings: tuple[str, ...] = ()

    def seen_rms(self) -> float:
        """Return the error that the camera shows once it has settled."""
        off = [one for since, one in self.seen if since >= SETTLED_S]
        return math.sqrt(sum(one * one for one in off) / len(off))


class WatchedRun(VirtualRun):
    """A virtual run whose camera looks along the simulated mount's true axes."""

    def watch(self, camera: SkyCamera, rng: random.Random, guided: bool = True) -> Followed:
        self._camera, self._rng, self._guided = camera, rng, guided
        self._path, self._next_s, self._first_s = TruePath(), 0.0, math.inf
        self._found = Followed()
        self.run()
        self._found.table_left = self.engine.tracker.table_left
        self._found.warnings = view_of(self.engine, self.engine.spec.plan.end_utc_s).warnings
        return self._found

    def _mount_turn(self, now_utc_s: float, _: None) -> None:
        status, truth = self._installation.turn(now_utc_s)
        if status is not None and truth is not None:
            for delay_s, arriving in self._installation.statuses.carry(status):
                self._at(now_utc_s + delay_s, self._status_arrives, (arriving, truth))
            self._path.note(truth)
            self._expose(truth)
        self._at(self._installation.next_turn_s(now_utc_s), self._mount_turn, None)

    def _expose(self, truth: Truth) -> None:
        if self.engine.phase != "tracking" or truth.utc_s < self._next_s:
            return
        self._next_s = truth.utc_s + FRAME_S - 0.01
        seen = self._camera.seen(truth.utc_s - EXPOSURE_S, EXPOSURE_S, self._path)
        self._first_s = min(self._first_s, seen.true_utc_s)
        off = math.hypot(seen.dx_arcsec, seen.dy_arcsec)
        self._found.seen.append((seen.true_utc_s - self._first_s, off))
        if self._guided and seen.inside:
            noise = [self._rng.gauss(0.0, NOISE_ARCSEC) for _ in (0, 1)]
            message = SeenOffset(
                Utc(seen.utc_s).isoformat("microseconds"),
                dx_arcsec=seen.dx_arcsec + noise[0],
                dy_arcsec=seen.dy_arcsec + noise[1],
                sigma_arcsec=NOISE_ARCSEC,
                camera="guide",
            )
            self._at(truth.utc_s + self._rng.uniform(*LATE_S), self._operate, message)


def follow(
    facts: RunFacts,
    mount: Mount,
    profile: MountProfile,
    seed: int,
    record: Path | None = None,
    guided: bool = True,
    turned_deg: float = 0.0,
) -> Followed:
    """Follow a pass with a hidden mount; `turned_deg` is how far its first gear was turned since."""
    facts = msgspec.structs.replace(facts, profile=profile, recording=None if record is None else str(record))
    assert facts.elements is not None
    there, hidden = mount.satellite(facts.elements), mount.hidden
    if turned_deg:
        turned = "+".join(
            f"{size:g}x{n:g}@{phase + n * turned_deg:g}" for size, n, phase in waves(hidden.ha_wave)
        )
        hidden = msgspec.structs.replace(hidden, ha_wave=turned)
    site = facts.site.place()
    sky = make_sky(site, [there], hidden, seed)
    begin_s = facts.started_utc_s
    zero_deg = sky.hour_angle_zero_deg(mean_sidereal_deg(begin_s, site.longitude_deg), begin_s)
    camera = SkyCamera(sky, SimulatedCamera(SCALE), hidden, begin_s, seed, zero_deg)
    simulated = SimulatedMount(msgspec.structs.replace(profile, periodic=None), simulated_site(facts.site))
    with ExitStack() as stack:
        sink: Sink = NoRecording()
        if record is not None:
            sink = Recorder(create(record), msgspec.Raw(encode_facts(facts)))
            stack.callback(sink.close)
        run = WatchedRun(build_engine(facts), simulated, begin_s, sink)
        found = run.watch(camera, random.Random(f"frames {seed}"), guided)
        sink.summary(facts.plan.end_utc_s, summarise(run.engine, run.statistics, facts.plan.end_utc_s))
    return found


def learnt(recordings: list[Path], profile: Path, base: Path | None = None) -> int:
    """Learn as a user does; return the exit code."""
    given = [] if base is None else ["--profile", str(base)]
    return sattrack(["report", *map(str, recordings), "--learn-profile", str(profile), *given])


def waves_left(mount: Mount, facts: RunFacts, profile: MountProfile) -> str:
    """Return what the hidden waves are along a pass, and what a table leaves of them, for either axis."""
    assert facts.elements is not None
    assert profile.periodic is not None
    propagator, table = Propagator(facts.elements, facts.site.place()), PeriodicTable(profile.periodic)
    spans = profile.periodic.first_seen_deg, profile.periodic.second_seen_deg
    rows: tuple[list[tuple[float, float]], ...] = ([], [])
    count = round(facts.plan.end_utc_s - facts.plan.start_utc_s)
    for since_s in range(count):
        seen = propagator.at(Utc(facts.plan.start_utc_s + since_s))
        stand = AxisStand(*map(float, (seen.ha_deg, seen.dec_deg, seen.ha_rate_deg_s, seen.dec_rate_deg_s)))
        fed, level = table.error_deg(stand), (math.cos(math.radians(stand.second_deg)), 1.0)
        for axis, text in enumerate((mount.hidden.ha_wave, mount.hidden.dec_wave)):
            angle = stand[axis]
            if not any((angle - low) % 360.0 <= high - low for low, high in spans[axis]):
                continue
            true = sum(size * math.sin(math.radians(n * angle + phase)) for size, n, phase in waves(text))
            rows[axis].append((level[axis] * true, level[axis] * (true - 3600.0 * fed[axis])))
    words = []
    for own in filter(None, rows):
        before, after = (
            math.sqrt(sum(one * one for one in part) / len(own)) for part in zip(*own, strict=True)
        )
        words.append(f"{before:.2f}″ to {after:.2f}″ in {100.0 * len(own) / count:.0f} %")
    return "waves " + ", ".join(words)


def figures(mount: Mount, passes: list[RunFacts], profile: MountProfile, seed: int) -> str:
    """Return what a later pass is like: without a profile's errors, with them, and with a turned gear."""
    state, found = mount.rng.getstate(), []
    for own, turned_deg in ((MountProfile(), 0.0), (profile, 0.0), (profile, HALF_WAVE_DEG)):
        mount.rng.setstate(state)
        found.append(follow(passes[-1], mount, own, 100 * seed + len(passes), turned_deg=turned_deg))
    one, other, turned = found
    left = ["left aside" if each.table_left else "kept" for each in found]
    return (
        f"{waves_left(mount, passes[-1], profile)}; "
        f"seen {one.seen_rms():.2f}″ to {other.seen_rms():.2f}″, table {left[1]}; gear turned: seen "
        f"{turned.seen_rms():.2f}″, table {left[2]}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--passes", type=int, default=5, help="that are learnt from")
    parser.add_argument("--waves", default="10x7+2x144", help="of either axis: arcseconds x cycles a turn")
    parser.add_argument("--folder", type=Path, help="keep the recordings here, and take those that are there")
    options = parser.parse_args()
    passes = passes_of_demo(options.passes + 1)
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(options.first, options.first + options.seeds):
            mount = drawn(seed, options.waves)
            folder = (options.folder or Path(temporary)) / f"seed{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            files = [folder / f"pass{k}.mcap" for k in range(options.passes)]
            for k, file in enumerate(files):
                elements = passes[k].elements
                assert elements is not None
                if file.exists():
                    mount.satellite(elements)
                else:
                    follow(passes[k], mount, MountProfile(), 100 * seed + k, file)
            profile = folder / "learnt.toml"
            profile.unlink(missing_ok=True)
            if learnt(files, profile):
                print(f"seed {seed}: nothing was learnt", flush=True)
                continue
            known = load_profile_file(profile).mount
            print(f"seed {seed}: {figures(mount, passes, known, seed)}", flush=True)


if __name__ == "__main__":
    main()

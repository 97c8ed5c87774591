"""The loop closed on the sky: a camera's offsets, a hidden sky, and where the telescope really points.

python bench/sky_loop.py [--seeds N] [--pass ISS|KANOPUS] [--mount|--next] [--wrong HOW] [--beside ARCSEC]
                         [--said ARCSEC] [--solved] [--bound]

Hidden from the program, and drawn for each seed: an orbit that is integrated (`bench/integrated.py`), 3 s
early or late, drifting by 0.3 s a minute, 60″ to the left or the right of its elements, drifting too (`warp`:
the elements' own place, at a wrong and drifting time, pushed aside); a mount whose polar axis points 5′
beside the pole, turned in space, and whose hour angle has a wrong zero; statuses that are dated 20 ms wrong;
a camera, by gnomonic projection, whose rotation is known to 2.5° and whose scale to 1 %, with 1.5″ of noise
an axis, two frames a second, 0.3 to 0.9 s late. None of that uses the filter's model.

*rms*: where the satellite is seen from the middle of the camera's true axis, from 10 s after the first frame
to the end; *clouds*: the worst of the second in which it comes back after 20 s without a frame. *2 sigma*:
the share of instants at which the pointing that the filter would have lies within two of its sigmas of the
one that centres the satellite, along the track and across. *NIS*: 2 where sigmas are right.

`--next` begins with what another satellite's pass has left of the mount and its camera in the profile,
`--wrong` with a camera that is not as it was set. With `--beside` the telescope looks so far beside its
axis (cone error), and its declination has a zero that is so wrong. `--said` is the noise that
the camera claims.

`--bound` prints the rms that no estimator gets below in the mean, whatever its model of what is hidden.

Without `--mount` the telescope points exactly where it is fed; with it the run of `track --virtual` follows
with a simulated mount, and offsets are made from its true axes.
"""

from __future__ import annotations

import argparse
import math
import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from feeder_passes import subjects
from integrated import Air, IntegratedMotion, julian, true_propagator

from sattrack.control.camera_image import Camera, Cameras
from sattrack.control.steering import Steering
from sattrack.mount.model import MountProfile, SkyTerms
from sattrack.mount.simulator.mount import SimulatedMount
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import simulated_site
from sattrack.runtime.facts import build_engine
from sattrack.runtime.flight import VirtualRun
from sattrack.views.messages import ObservationMessage, SeenOffset
from tle.bias import NO_BIAS, Bias
from tle.instants import Utc
from tle.orbit_fit import cross_product

if TYPE_CHECKING:
    from feeder_passes import Subject
    from numpy.typing import NDArray

    from sattrack.control.estimate import Estimator
    from tle.propagator import Propagator

    Array = NDArray[np.float64]

ARCSEC = math.pi / 648000.0
FRAME_S, NOISE_ARCSEC = 0.5, 1.5
LATE_S = (0.3, 0.9)
BEFORE_S, AFTER_S = 90.0, 110.0
"""The camera looks from so long before culmination to so long after."""
CLOUDS_S = (60.0, 80.0)
"""Since the first frame."""
SETTLED_S = 10.0
SCALE_ARCSEC_PX = 2.0
STEP_S = 0.1
SHOWN_EVERY = 100
POLE = np.array([0.0, 0.0, 1.0])
DIVERGED_ARCSEC = 60.0


@dataclass
class Hidden:
    """What the program does not know, drawn by a seed."""

    late_s: float
    drift: float
    cross_rad: float
    cross_drift_rad_s: float
    polar: tuple[float, float, float]
    """Turn of the mount's base, rad: in the equator towards the meridian and 90° from it, and the pole."""
    delay_s: float
    rotation_deg: float
    scale: float
    clock_s: float = 0.0
    mirrored: bool = False
    beside: tuple[float, float] = (0.0, 0.0)
    """Of the telescope beside its axes, rad: to the east and to the north."""

    @classmethod
    def drawn(cls, rng: random.Random) -> Hidden:
        """Return one of a seed; sizes are those of the module's text, signs and directions by chance."""

        def sign() -> int:
            return rng.choice((-1, 1))

        towards = rng.uniform(0.0, 2.0 * math.pi)
        pole = 300.0 * ARCSEC
        return cls(
            3.0 * sign(),
            sign() * 0.3 / 60.0,
            sign() * 60.0 * ARCSEC,
            sign() * 10.0 * ARCSEC / 60.0,
            (pole * math.cos(towards), pole * math.sin(towards), rng.gauss(0.0, 100.0 * ARCSEC)),
            0.02 * sign(),
            rng.gauss(0.0, 2.5),
            1.0 + rng.gauss(0.0, 0.01),
        )


class Satellite:
    """Where the satellite really is."""

    def __init__(self, subject: Subject, hidden: Hidden, truth: str) -> None:
        self._believed, self._hidden, self._truth = subject.propagator, hidden, truth
        self._middle_s = subject.facts.culminate_utc_s
        if truth == "orbit":
            self._true = self._integrated(subject)

    def _integrated(self, subject: Subject) -> Propagator:
        hidden, middle_s, first_s = self._hidden, self._middle_s, self._middle_s - 400.0
        elements = subject.propagator.elements
        air = Air(0.006)
        plain = IntegratedMotion(elements, first_s, middle_s, air)
        _, r, v = elements.satrec().sgp4(*julian(middle_s + hidden.late_s))
        r, v = np.array(r), np.array(v)
        out = r / np.linalg.norm(r)
        left = cross_product(r, v) / np.linalg.norm(cross_product(r, v))
        range_km = float(subject.propagator.at(Utc(middle_s)).range_km)
        # Higher is later along the track, seen from below: the angle is the way over the range.
        r = r + range_km * (-hidden.drift * out + hidden.cross_rad * left)
        v = v + range_km * hidden.cross_drift_rad_s * left
        first = plain.state_before(np.concatenate([r, v]), middle_s, first_s)
        motion = IntegratedMotion(elements, first_s, middle_s + 400.0, air, first)
        return true_propagator(motion, subject.propagator.site, subject.propagator.refraction)

    def at(self, utc_s: float) -> tuple[Array, float]:
        """Return the direction (unit vector, of date) and the local sidereal time, rad."""
        if self._truth == "orbit":
            seen = self._true.at(Utc(utc_s))
        else:
            hidden, since_s = self._hidden, utc_s - self._middle_s
            along_s = hidden.late_s + hidden.drift * since_s
            cross = hidden.cross_rad + hidden.cross_drift_rad_s * since_s
            seen = self._believed.at(Utc(utc_s), Bias(along_s, math.degrees(cross)))
        return seen.unit, math.radians(float(seen.ra_deg + seen.ha_deg))


def turned(u: Array, sidereal: float, turn: tuple[float, float, float], sign: int = 1) -> Array:
    """Return a direction turned about axes that are fixed to the Earth (Rodrigues)."""
    c, s = math.cos(sidereal), math.sin(sidereal)
    axis = (
        turn[0] * np.array([c, s, 0.0]) + turn[1] * np.array([s, -c, 0.0]) + turn[2] * np.array([0, 0, 1.0])
    )
    angle = float(np.linalg.norm(axis))
    if angle == 0.0:
        return u
    k = axis / angle * sign
    return u * math.cos(angle) + cross_product(k, u) * math.sin(angle) + k * (k @ u) * (1.0 - math.cos(angle))


def aside(u: Array, by_rad: tuple[float, float]) -> Array:
    """Return where a telescope looks beside its axes: to the north by its declination, then to the east."""
    dec = math.asin(max(-1.0, min(1.0, float(u[2])))) + by_rad[1]
    ra = math.atan2(float(u[1]), float(u[0]))
    there = direction(math.degrees(ra), math.degrees(dec))
    return there * math.cos(by_rad[0]) + np.array([-math.sin(ra), math.cos(ra), 0.0]) * math.sin(by_rad[0])


def direction(ra_deg: float, dec_deg: float) -> Array:
    """Return a unit vector."""
    ra, dec = math.radians(ra_deg), math.radians(dec_deg)
    return np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])


@dataclass
class Sky:
    """The hidden sky of a seed, its camera, and what was seen of it."""

    subject: Subject
    hidden: Hidden
    rng: random.Random
    truth: str = "orbit"
    camera: Camera = field(default_factory=lambda: Camera(40.0, False, SCALE_ARCSEC_PX))
    said_arcsec: float = NOISE_ARCSEC
    solved: bool = False
    first_s: float | None = None
    times: list[float] = field(default_factory=list)
    off_arcsec: list[float] = field(default_factory=list)
    in_sigmas: list[float] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.satellite = Satellite(self.subject, self.hidden, self.truth)
        middle_s = self.subject.facts.culminate_utc_s
        self.begin_s, self.end_s = middle_s - BEFORE_S, middle_s + AFTER_S

    def plane(self, pointing: Array, utc_s: float) -> tuple[float, float]:
        """Return where the satellite is seen, tangents on the camera's axes: right and up, unscaled.

        `pointing` is where the mount's axes point by its own idea, at the instant.
        """
        u, sidereal = self.satellite.at(utc_s)
        pointing = aside(pointing, self.hidden.beside)
        c = turned(pointing, sidereal, self.hidden.polar)
        east = cross_product(POLE, pointing)
        north = turned(cross_product(pointing, east / np.linalg.norm(east)), sidereal, self.hidden.polar)
        angle = math.radians(self.camera.rotation_deg + self.hidden.rotation_deg)
        east = cross_product(north, c)
        up = math.cos(angle) * north + math.sin(angle) * east
        right = -cross_product(c, up) if self.camera.flip != self.hidden.mirrored else cross_product(c, up)
        along = float(u @ c)
        return float(u @ right) / along, float(u @ up) / along

    def frame(self, pointing: Array, utc_s: float) -> SeenOffset:
        """Return what the camera sees, its noise drawn, in pixels."""
        scale = self.hidden.scale * SCALE_ARCSEC_PX * ARCSEC
        sigma_px = NOISE_ARCSEC / SCALE_ARCSEC_PX
        dx, dy = (one / scale + self.rng.gauss(0.0, sigma_px) for one in self.plane(pointing, utc_s))
        dated = Utc(utc_s + self.hidden.clock_s).isoformat("microseconds")
        said_px = self.said_arcsec / SCALE_ARCSEC_PX
        return SeenOffset(dated, dx_px=dx, dy_px=dy, sigma_px=said_px, camera="guide")

    def messages(self, pointing: Array, utc_s: float) -> list[SeenOffset | ObservationMessage]:
        """Return what the camera sends of a frame: where it solves the field, a direction too."""
        seen = self.frame(pointing, utc_s)
        if not self.solved:
            return [seen]
        u = self.satellite.at(utc_s)[0] + NOISE_ARCSEC * ARCSEC * np.array(
            [self.rng.gauss(0.0, 1.0) for _ in range(3)]
        )
        ra_deg = math.degrees(math.atan2(u[1], u[0])) % 360.0
        dec_deg = math.degrees(math.atan2(u[2], math.hypot(u[0], u[1])))
        direction = ObservationMessage(seen.utc, ra_deg, dec_deg, "of_date", NOISE_ARCSEC, camera="guide")
        return [seen, direction]

    def note(self, pointing: Array, utc_s: float) -> None:
        """Note how far from the middle the satellite is."""
        self.times.append(utc_s)
        self.off_arcsec.append(math.hypot(*self.plane(pointing, utc_s)) / ARCSEC)

    def wanted(self, utc_s: float) -> Array:
        """Return what must be fed at an instant so that the satellite is in the middle."""
        u, sidereal = self.satellite.at(utc_s - self.hidden.delay_s)
        looks = turned(u, sidereal, self.hidden.polar, -1)
        axes = looks
        for _ in range(3):
            axes = axes + looks - aside(axes, self.hidden.beside)
        return axes / float(np.linalg.norm(axes))

    def note_distance(self, estimator: Estimator) -> None:
        """Note how far the last offset that was taken lay from what was expected."""
        if estimator.filter is not None and estimator.words is None:
            distance = estimator.filter.best.last_distance
            if distance is not None:
                self.nis.append(distance)

    def look(self, estimator: Estimator, propagator: Propagator, utc_s: float) -> None:
        """Note by how many of its sigmas the estimate's pointing is off, along the track and across."""
        if estimator.filter is None:
            return
        u, spread = estimator.filter.pointing(propagator, Utc(utc_s), True)
        off, later = self.wanted(utc_s) - u, self.wanted(utc_s + 0.5)
        ahead = later - (later @ u) * u
        ahead = ahead / np.linalg.norm(ahead)
        for axis in (ahead, cross_product(u, ahead)):
            self.in_sigmas.append(float(off @ axis) / math.sqrt(float(axis @ spread @ axis)))

    def cloudy(self, utc_s: float) -> bool:
        """Tell whether clouds hide the satellite."""
        first = self.begin_s if self.first_s is None else self.first_s
        return CLOUDS_S[0] <= utc_s - first < CLOUDS_S[1]

    def rms(self, from_s: float, to_s: float) -> float:
        """Return the error between two instants since the first frame, clouds and the second after apart."""
        assert self.first_s is not None
        chosen = [
            off
            for t, off in zip(self.times, self.off_arcsec, strict=True)
            if from_s <= t - self.first_s < to_s
        ]
        return math.sqrt(sum(off * off for off in chosen) / len(chosen)) if chosen else math.nan


@dataclass
class Result:
    """What came of a seed."""

    rms_arcsec: float
    clouds_arcsec: float
    worst_arcsec: float
    rejected: int
    begun_anew: int
    sky: Sky
    words: tuple[str, ...] = ()
    sky_terms: SkyTerms | None = None


def result(sky: Sky, estimator: Estimator) -> Result:
    """Return the figures of a seed that was run."""
    assert sky.first_s is not None
    since = [(t - sky.first_s, off) for t, off in zip(sky.times, sky.off_arcsec, strict=True)]
    clear = [
        off for t, off in since if t >= SETTLED_S and not CLOUDS_S[0] <= t < CLOUDS_S[1] + LATE_S[1] + 2.0
    ]
    back = [off for t, off in since if CLOUDS_S[1] - 1.0 <= t < CLOUDS_S[1]]
    rms = math.sqrt(sum(off * off for off in clear) / len(clear))
    return Result(
        rms,
        max(back, default=math.nan),
        max(clear),
        estimator.rejected,
        estimator.begun_anew,
        sky,
        estimator.camera_words,
        estimator.sky_terms,
    )


def without_mount(sky: Sky, profile: MountProfile) -> Result:
    """Run a seed with a telescope that points exactly where it is fed, its dates wrong."""
    steering = Steering(
        sky.subject.propagator,
        profile,
        NO_BIAS,
        Cameras(named={"guide": sky.camera}),
        sky.begin_s - 5.0,
    )
    fed = steering.biases.at
    waiting: list[tuple[float, SeenOffset | ObservationMessage]] = []
    now, tick, next_frame_s = sky.begin_s, 0, sky.begin_s
    while now < sky.end_s:
        exposed = now >= next_frame_s
        if exposed or tick % 2 == 0:
            pointing = fed(now + sky.hidden.delay_s).unit
        if exposed:
            next_frame_s += FRAME_S
            if not sky.cloudy(now):
                if sky.first_s is None:
                    sky.first_s = now
                due_s = now + sky.rng.uniform(*LATE_S)
                waiting += [(due_s, one) for one in sky.messages(pointing, now)]
        for one in sorted(waiting, key=lambda w: w[0]):
            if one[0] <= now:
                waiting.remove(one)
                steering.obey(one[1], now)
                sky.note_distance(steering.estimator)
        steering.watch(now)
        if tick % 2 == 0:
            sky.note(pointing, now)
        if tick % 10 == 0 and sky.first_s is not None and now - sky.first_s >= SETTLED_S:
            sky.look(steering.estimator, sky.subject.propagator, now)
        now, tick = now + STEP_S, tick + 1
    return result(sky, steering.estimator)


def learnt_before(sky: Sky, seed: int) -> MountProfile:
    """Return the profile that a pass of another satellite left, with the same mount and camera."""
    rng = random.Random(f"before {seed}")
    other, same = Hidden.drawn(rng), sky.hidden
    kept = {name: getattr(same, name) for name in ("polar", "delay_s", "rotation_deg", "scale", "mirrored")}
    subject = next(one for one in subjects() if one.name != sky.subject.name)
    before = Sky(subject, replace(other, **kept), rng, sky.truth)
    return msgspec.structs.replace(MountProfile(), sky=without_mount(before, MountProfile()).sky_terms)


SIZES = np.array(
    [3.0, 0.3 / 60.0, 60.0 * ARCSEC, ARCSEC / 6.0, 212.0 * ARCSEC, 212.0 * ARCSEC, 100.0 * ARCSEC, 0.02]
)
"""One sigma of what is hidden: late, drift, cross, its drift, the three turns of the base, the delay."""


def bound_arcsec(subject: Subject) -> float:
    """Return the RMS that no estimator can get below that knows how large what is hidden is, in the mean.

    Cramér and Rao's, with those sizes as priors: of the time and place of the elements' own way (`warp`), the
    turns of the base and the delay. Camera's rotation and scale are taken as known, frames as 0.6 s late.
    """
    drawn = Hidden.drawn(random.Random(0))
    truth = np.array(
        [drawn.late_s, drawn.drift, drawn.cross_rad, drawn.cross_drift_rad_s, *drawn.polar, drawn.delay_s]
    )
    begin_s = subject.facts.culminate_utc_s - BEFORE_S
    since_s = np.arange(0.0, BEFORE_S + AFTER_S, FRAME_S)

    def wanted(hidden: Array) -> Array:
        late, drift, cross, cross_drift, *polar, delay = hidden.tolist()
        base = (polar[0], polar[1], polar[2])
        sky = Sky(
            subject,
            replace(drawn, late_s=late, drift=drift, cross_rad=cross, cross_drift_rad_s=cross_drift,
                    polar=base, delay_s=delay),
            random.Random(0),
            "warp",
        )  # fmt: skip
        return np.array([sky.wanted(begin_s + s) for s in since_s])

    at = wanted(truth)
    steps = np.diag(0.01 * SIZES)
    turned_by = np.stack([(wanted(truth + one) - at) / 0.01 for one in steps], axis=2)
    east = np.cross(POLE, at)
    east /= np.linalg.norm(east, axis=1)[:, None]
    rows = np.stack([np.einsum("ti,tik->tk", axis, turned_by) for axis in (east, np.cross(at, east))], 1)
    known, squares = np.eye(len(SIZES)), []
    late = round(0.6 / FRAME_S)
    for k, s in enumerate(since_s.tolist()):
        if k >= late and not CLOUDS_S[0] <= s - late * FRAME_S < CLOUDS_S[1]:
            seen = rows[k - late]
            known = known + seen.T @ seen / (NOISE_ARCSEC * ARCSEC) ** 2
        if s >= SETTLED_S and not CLOUDS_S[0] <= s < CLOUDS_S[1] + LATE_S[1] + 2.0:
            squares.append(np.trace(rows[k] @ np.linalg.inv(known) @ rows[k].T))
    return math.sqrt(float(np.mean(squares))) / ARCSEC


class SkyRun(VirtualRun):
    """A virtual run whose camera looks along the simulated mount's true axes."""

    def attach(self, sky: Sky) -> None:
        self.sky = sky
        self._before: Any = None
        self._next_frame_s = sky.begin_s

    def _mount_turn(self, now_utc_s: float, what: None) -> None:
        status, truth = self._installation.turn(now_utc_s)
        if status is not None:
            for delay_s, arriving in self._installation.statuses.carry(status):
                self._at(now_utc_s + delay_s, self._status_arrives, (arriving, truth))
            self._expose(truth)
        self._at(self._installation.next_turn_s(now_utc_s), self._mount_turn, what)

    def _operate(self, now_utc_s: float, message: Any) -> None:
        super()._operate(now_utc_s, message)
        self.sky.note_distance(self.engine.tracker.steering.estimator)

    def _expose(self, truth: Any) -> None:
        """Expose at the truth's instant: the true axes are known exactly there."""
        sky, utc_s = self.sky, truth.utc_s
        if not sky.begin_s <= utc_s < sky.end_s:
            return
        pointing = direction(truth.ra_deg, truth.dec_deg)
        tracking = self.engine.phase == "tracking"
        if sky.first_s is not None:
            sky.note(pointing, utc_s)
        if utc_s < self._next_frame_s or not tracking:
            return
        self._next_frame_s = utc_s + FRAME_S - 0.01
        if not sky.cloudy(utc_s):
            if sky.first_s is None:
                sky.first_s = utc_s
            due_s = utc_s + sky.rng.uniform(*LATE_S)
            for seen in sky.messages(pointing, utc_s):
                self._at(due_s, self._operate, seen)
        estimator = self.engine.tracker.steering.estimator
        if sky.first_s is not None and utc_s - sky.first_s >= SETTLED_S:
            sky.look(estimator, sky.subject.propagator, utc_s)


def with_mount(sky: Sky, seed: int) -> Result:
    """Run a seed as `track --virtual` runs, with a mount whose delays are not split as its profile says."""
    facts = sky.subject.facts
    profile = msgspec.structs.replace(
        facts.profile, command_delay_s=0.03, status_delay_s=0.03, clock_offset_s=None
    )
    plan = msgspec.structs.replace(facts.plan, end_utc_s=min(facts.plan.end_utc_s, sky.end_s + 1.0))
    facts = msgspec.structs.replace(facts, profile=profile, plan=plan, cameras={"guide": sky.camera})
    hardware = SimulatorProfile(encoder_noise_tics=0.5, seed=seed)
    mount = SimulatedMount(profile, simulated_site(facts.site), demo_pass.START, hardware)
    begin_s = facts.plan.start_utc_s - facts.plan.approach_s - 5.0
    engine = build_engine(msgspec.structs.replace(facts, started_utc_s=begin_s))
    run = SkyRun(engine, mount, begin_s, NoRecording())
    split_s = sky.hidden.delay_s
    shifted = msgspec.structs.replace(profile, command_delay_s=0.03 - split_s, status_delay_s=0.03 + split_s)
    run._installation = type(run._installation)(mount, None, shifted.command_delay_s, shifted.status_delay_s)
    run.attach(sky)
    run.run()
    return result(sky, engine.tracker.steering.estimator)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pass", dest="name", choices=["ISS", "KANOPUS"])
    parser.add_argument("--truth", choices=["orbit", "warp"], default="orbit")
    parser.add_argument("--mount", action="store_true")
    parser.add_argument("--next", action="store_true", help="begin with what another pass has left")
    parser.add_argument("--wrong", choices=[*WRONG], help="how the camera is not as it was set")
    parser.add_argument("--beside", type=float, default=0.0, metavar="ARCSEC", help="cone and index error")
    parser.add_argument("--said", type=float, default=NOISE_ARCSEC, metavar="ARCSEC")
    parser.add_argument(
        "--solved", action="store_true", help="the camera solves its field among the stars too"
    )
    parser.add_argument("--bound", action="store_true", help="what no estimator can get below")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    if options.bound:
        for subject in subjects():
            print(f"{subject.name:<8} {bound_arcsec(subject):.2f}″")
        return
    print(f"truth {options.truth}, {'a virtual mount' if options.mount else 'no mount'}")
    print(HEAD)
    found: dict[str, list[Result]] = {}
    for seed in range(options.first, options.first + options.seeds):
        for subject in subjects():
            if options.name in {None, subject.name}:
                one = of_seed(subject, seed, options)
                found.setdefault(subject.name, []).append(one)
                if options.verbose:
                    print(f"  {subject.name}, seed {seed}: {detailed(one)}", flush=True)
        done = seed + 1 - options.first
        if done % SHOWN_EVERY == 0 or done == options.seeds:
            for name, results in found.items():
                print(row(name, results), flush=True)


def of_seed(subject: Subject, seed: int, options: argparse.Namespace) -> Result:
    """Run one seed of a pass."""
    rng = random.Random(f"{subject.name} {seed}")
    hidden = replace(Hidden.drawn(rng), **WRONG.get(options.wrong, {}))
    signs = random.Random(f"beside {seed}")
    beside = [signs.choice((-1, 1)) * options.beside * ARCSEC for _ in range(2)]
    hidden = replace(hidden, beside=(beside[0], beside[1]))
    sky = Sky(subject, hidden, rng, options.truth, said_arcsec=options.said, solved=options.solved)
    if options.mount:
        return with_mount(sky, seed)
    return without_mount(sky, learnt_before(sky, seed) if options.next else subject.facts.profile)


def detailed(one: Result) -> str:
    """Return the figures of one seed."""
    parts = ", ".join(
        f"{a}-{b} s {one.sky.rms(a, b):.2f}" for a, b in ((10, 20), (20, 40), (40, 60), (110, 400))
    )
    return (
        f"rms {one.rms_arcsec:.2f}, clouds {one.clouds_arcsec:.2f}, worst {one.worst_arcsec:.2f}, "
        f"rejected {one.rejected}, anew {one.begun_anew}; {parts}; {'; '.join(one.words)}"
    )


WRONG: dict[str, dict[str, Any]] = {
    "scale": {"scale": 1.25},
    "rotation": {"rotation_deg": 30.0},
    "on its side": {"rotation_deg": 90.0},
    "upside down": {"rotation_deg": 180.0},
    "mirrored": {"mirrored": True},
    "binned": {"scale": 2.0},
    "clock": {"clock_s": 0.3},
    "late clock": {"clock_s": -0.3},
}
HEAD = (
    "pass     seeds  rms: median   95 %    max <= 1″  clouds: 95 %   max 2 sigma  NIS diverged rejected anew"
)


def row(name: str, found: list[Result]) -> str:
    """Return the figures of all seeds of a pass."""
    rms = np.array([one.rms_arcsec for one in found])
    clouds = np.array([one.clouds_arcsec for one in found])
    sigmas = np.abs(np.concatenate([one.sky.in_sigmas for one in found]))
    nis = float(np.mean([one for each in found for one in each.sky.nis] or [math.nan]))
    diverged = sum(one.worst_arcsec > DIVERGED_ARCSEC for one in found)
    return (
        f"{name:<8} {len(found):5d} {np.median(rms):12.2f} {np.quantile(rms, 0.95):6.2f} {rms.max():6.2f} "
        f"{100.0 * np.mean(rms <= 1.0):5.1f} {np.quantile(clouds, 0.95):14.2f} {clouds.max():6.2f} "
        f"{100.0 * np.mean(sigmas <= 2.0):7.1f} {nis:4.2f} {diverged:8d} "
        f"{sum(one.rejected for one in found):8d} {sum(one.begun_anew for one in found):4d}"
    )


if __name__ == "__main__":
    main()

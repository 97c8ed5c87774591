"""A star run: slews over the sky, finds where the telescope really looks, and fits the pointing model to it.

`StarRun` decides, called once a period by the loop that feeds the mount; it reads no clock. The camera is a
process of its own (`sattrack camera`): what it solves comes as lines.
"""

from __future__ import annotations

import json
import math
import os
import select
import subprocess
from collections import deque
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

import erfa
import msgspec
import numpy as np

from sattrack.core.angles import separation_deg, wrap180
from sattrack.core.channel import LineReader, see_off
from sattrack.core.errors import LinkLostError, SattrackError, error_type
from sattrack.core.process import ending_with_us, self_command
from sattrack.mount.model import MountProfile, Slew, beyond_after_slew, mean_sidereal_deg
from sattrack.mount.requests import Sync, TicketState
from sattrack.mount.xerxes.link import LinkState
from sattrack.planning.path import skyline_deg
from sattrack.pointing.fields import ALIKE_DEG, FieldCamera, FieldWait, Solved
from sattrack.pointing.fit import PointingFit, Star, find_bump, fit, rms
from sattrack.pointing.terms import frame_of, swung
from sattrack.pointing.tour import chosen, grid_deg, toured
from sattrack.views.messages import Jog
from tle.bodies import Body, StarPlace, named_stars
from tle.instants import DAY_S, MJD_JD, UNIX_EPOCH_MJD, Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from sattrack.control.manual_operation import ConsoleSession
    from sattrack.mount.model import StatusSample
    from sattrack.pointing.terms import Axes, PointingModel
    from sattrack.safety import SafetyLimits
    from tle.refraction import Refraction
    from tle.site import Site

    Array = NDArray[np.float64]

LEAST_ALT_DEG, CLEAR_DEG = 20.0, 2.0
"""Lower than the first no star is looked at, nor nearer to the floor and the skyline than the second."""
POLE_DEG = 5.0
"""Nearer to the pole the hour angle tells nothing."""
SYNC_DEG = 3.0
"""A mount whose reports are off by more where it stands is synced before it is slewed.

One with a geometry gets zero points instead: what a sync does to its axes, nobody knows.
"""
SETTLE_S = 1.5
HEARD_WITHIN_S = 6.0
MOST_MISSED = 6
FEWEST_TO_PREDICT, FEWEST_STARS = 8, 12
"""With fewer stars a fit has not all terms of a mount; and a run does not end early, whatever it predicts."""
END_WITHIN_S = 3.0
STEPS_DEG_S = (0.002, 0.01, 0.05, 0.25)
"""Rates by which an operator centres a star."""


class CameraProcess:
    """`sattrack camera` beside us; `poll` gives the frames that have come since."""

    def __init__(self, source: str, words: Sequence[str]) -> None:
        """Start it. Raises OSError."""
        self.source = source
        self._process = subprocess.Popen(
            [*self_command(), "camera", source, "--json", "--alone", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            env=ending_with_us(),
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self._descriptor = self._process.stdout.fileno()
        self._lines = LineReader(self._descriptor, 1 << 20)

    @property
    def ended(self) -> bool:
        """Whether no more frames will come."""
        return self._lines.ended

    def poll(self) -> list[Solved]:
        """Return the frames that have come since the last call."""
        found: list[Solved] = []
        while not self.ended and select.select([self._descriptor], [], [], 0.0)[0]:
            for line in self._lines.lines():
                one = json.loads(line)
                field_of = one["solved"]
                icrs = None if field_of is None else (field_of["ra_deg"], field_of["dec_deg"])
                found.append(Solved(float(Utc.parse(one["utc"]).unix_s), one["exposure_s"], icrs))
        return found

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        see_off(self._process, END_WITHIN_S)


@dataclass(slots=True)
class RunSky:
    """Directions of the sky over a site, and what must be kept clear of."""

    site: Site
    profile: MountProfile
    limits: SafetyLimits
    air: Refraction | None = None
    """None for a mount that applies refraction itself."""
    looked_deg: tuple[tuple[float, float], ...] = ()
    """Hour angles and declinations at which another run looked: tours keep away from them."""
    judged_axes: Axes | None = None
    """What the model is about that is judged; None where one is found."""

    @property
    def axes(self) -> Axes:
        """What the model is about."""
        return self.judged_axes or self.profile.own_axes

    def own_deg(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return a direction as stars of the mount have it: azimuth and altitude of an azimuth mount."""
        if self.axes != "altaz":
            return hour_angle_deg, dec_deg
        west, altitude = swung(hour_angle_deg, dec_deg, self.site.latitude_deg)
        return -west % 360.0, altitude

    def place_deg(self, star: Star) -> tuple[float, float]:
        """Return hour angle and declination of a star."""
        if self.axes != "altaz":
            return star.hour_angle_deg, star.dec_deg
        return swung(-star.hour_angle_deg, star.dec_deg, self.site.latitude_deg)

    def own_grid(self) -> Array:
        """Return the directions of `grid` as stars of the mount have them."""
        if self.axes != "altaz":
            return self.grid()
        return np.array([self.own_deg(h, d) for h, d in self.grid().tolist()]).reshape(-1, 2)

    def seen(self, body: Body, utc_s: float, model: PointingModel | None = None) -> Any:
        """Return where a body is seen, or where a mount with a pointing model must be fed."""
        propagator = Propagator(body, self.site, refraction=self.air, pointing=model)
        return propagator.at(Utc(utc_s))

    def clear(self, places_deg: Array) -> NDArray[np.bool_]:
        """Tell of hour angles and declinations, shape (n, 2), which may be looked at."""
        h, d = np.radians(places_deg).T
        p = math.radians(self.site.latitude_deg)
        up = math.sin(p) * np.sin(d) + math.cos(p) * np.cos(d) * np.cos(h)
        north = math.cos(p) * np.sin(d) - math.sin(p) * np.cos(d) * np.cos(h)
        azimuth = np.degrees(np.arctan2(-np.cos(d) * np.sin(h), north)) % 360.0
        low = np.maximum(LEAST_ALT_DEG, skyline_deg(azimuth, self.limits) + CLEAR_DEG)
        lowest, highest = self.profile.dec_axis_limits_deg
        first, second = places_deg.T
        if self.profile.frame is not None:
            first, second, _, _ = self.profile.frame.angles(first, second, fn=np)
        within = (second > lowest + CLEAR_DEG) & (second < highest - CLEAR_DEG)
        far = np.abs(first) < self.profile.hour_angle_limit_deg - CLEAR_DEG
        away = np.abs(second) < 90.0 - POLE_DEG
        good: NDArray[np.bool_] = (np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))) > low) & within & far & away
        return good

    def grid(self) -> Array:
        """Return directions that may be looked at, all over the sky."""
        places = grid_deg(self.site.latitude_deg)
        good: Array = places[self.clear(places)]
        return good

    def beside(self, count: int) -> RunSky:
        """Return the same for a run that keeps away from the places at which one of `count` stars looked."""
        grid = self.grid()
        return replace(self, looked_deg=tuple((h, d) for h, d in grid[chosen(grid, count)].tolist()))

    def tour(
        self, places_deg: Array, count: int, done: Sequence[tuple[float, float]], start: tuple[float, float]
    ) -> Any:
        """Return the rows of so many places away from those `done`, in the order in which to look at them."""
        kept_from = [*done, *self.looked_deg]
        rows = chosen(places_deg, count, np.array(kept_from) if kept_from else None)
        axes = places_deg[rows]
        if self.axes == "altaz":
            axes = np.array([self.own_deg(h, d) for h, d in axes.tolist()]).reshape(-1, 2)
            return rows[toured(axes, start)]
        frame = frame_of(self.axes, self.site.latitude_deg)
        if frame is not None:
            first, second, _, _ = frame.angles(axes[:, 0], axes[:, 1], fn=np)
            return rows[toured(np.stack([first, second], axis=1), frame.angles(*start)[:2])]
        # Past the pole the hour angle axis stands half a turn on, and the declination axis beyond 90°.
        rule, hour_angles = self.profile.pier_rule, axes[:, 0]
        beyond = np.array([beyond_after_slew(rule, h) for h in hour_angles.tolist()], dtype=bool)
        pole = 180.0 if self.site.latitude_deg >= 0.0 else -180.0
        past = np.stack([hour_angles - np.copysign(180.0, hour_angles), pole - axes[:, 1]], axis=1)
        return rows[toured(np.where(beyond[:, None], past, axes), start)]


class Stage(Enum):
    """What a run is doing."""

    LISTENING = "listening to the mount"
    HERE = "looking where the telescope stands"
    SLEWING = "slewing"
    SETTLING = "settling"
    LOOKING = "looking"
    CENTRING = "waiting for you to centre the star"
    OVER = "over"


@dataclass(slots=True)
class StarRun:
    """One run; call `step` once a period, and `finish` is what came of it.

    `camera` None: the operator centres named stars by `key`. With `judged` no model is fitted: stars are
    compared with that one.
    """

    session: ConsoleSession
    sky: RunSky
    camera: FieldCamera | None
    most: int
    until_arcsec: float
    tell: Callable[[str], None]
    keep: Callable[[Star], None]
    stars: list[Star] = field(default_factory=list)
    judged: PointingModel | None = None
    stage: Stage = Stage.LISTENING
    trouble: SattrackError | None = None
    """Why it ended before it was done."""
    bumped_at: int = 0
    """The first star that counts: before it the mount stood otherwise."""
    fitted: PointingFit | None = None
    known: int = 0
    """How many of the stars are of an earlier run."""
    realigned: bool = False
    """Whether the mount's zero points are already those of a field."""
    alignment: MountProfile | None = None
    """The profile with which to begin again: a mount with a geometry was found to have other zero points."""
    _queue: deque[Body] = field(default_factory=deque)
    _done: list[tuple[float, float]] = field(default_factory=list)
    """Where was looked, or will be: hour angles and declinations."""
    _body: Body | None = None
    _begun_s: float | None = None
    _since_s: float = 0.0
    _wait: FieldWait | None = field(init=False)
    _seen_first: tuple[float, float] | None = None
    """Where the last frame looked that shows a mount far off."""
    _missed: int = 0
    _samples: deque[StatusSample] = field(default_factory=lambda: deque(maxlen=4000))
    _speed: int = 1

    def __post_init__(self) -> None:
        """Wait for the camera's frames, where there is one."""
        self._wait = None if self.camera is None else FieldWait(self.camera)

    @property
    def doing(self) -> str:
        """What goes on, in words."""
        name = "" if self._body is None else f" {self._body.name}"
        return f"{len(self.stars) - self.known} of {self.most}: {self.stage.value}{name}"

    @property
    def counting(self) -> list[Star]:
        """The stars since the mount was last bumped."""
        return self.stars[self.bumped_at :]

    def step(self, now_utc_s: float) -> None:
        """Go on with the run."""
        console = self.session.console
        self._begun_s = now_utc_s if self._begun_s is None else self._begun_s
        sample = console.session.sample
        if sample is not None and (not self._samples or self._samples[-1] is not sample):
            self._samples.append(sample)
        if self.stage is Stage.OVER:
            return
        if console.link_state is LinkState.LOST or (
            sample is None and now_utc_s - self._begun_s > HEARD_WITHIN_S
        ):
            self.end(LinkLostError(f"no status from {console.mount_name}"), now_utc_s)
            return
        if sample is None:
            return
        if console.trouble is not None:
            words = console.refusal or console.trouble
            self.end(error_type(console.trouble)(words), now_utc_s)
            return
        match self.stage:
            case Stage.LISTENING:
                self._listen(sample, now_utc_s)
            case Stage.SLEWING:
                self._slew(now_utc_s)
            case Stage.SETTLING:
                if now_utc_s - self._since_s >= SETTLE_S:
                    self._go(Stage.LOOKING if self.camera is not None else Stage.CENTRING, now_utc_s)
            case Stage.HERE | Stage.LOOKING:
                self._look(now_utc_s)

    def end(self, trouble: SattrackError | None, now_utc_s: float) -> None:
        """End the run, and leave the mount."""
        self.stage, self.trouble = Stage.OVER, trouble
        self.session.interrupt(now_utc_s)

    def key(self, text: str, now_utc_s: float) -> None:
        """Obey a key of the operator who centres a star: arrows move, + and - set the speed."""
        if text == "q":
            self.end(None, now_utc_s)
        if self.stage is not Stage.CENTRING or self._body is None:
            return
        rate = STEPS_DEG_S[self._speed]
        moves = {"\x1b[A": (0.0, rate), "\x1b[B": (0.0, -rate), "\x1b[C": (-rate, 0.0), "\x1b[D": (rate, 0.0)}
        if text in moves:
            self.session.obey(Jog(*moves[text]), now_utc_s)
        elif text in {"+", "-"}:
            self._speed = min(len(STEPS_DEG_S) - 1, max(0, self._speed + (1 if text == "+" else -1)))
            self.tell(f"{STEPS_DEG_S[self._speed]:g} °/s")
        elif text in {"\r", "\n"}:
            self._take(self._body, now_utc_s, 0.2, now_utc_s)
        elif text == "s":
            self._next(now_utc_s)

    def _go(self, stage: Stage, now_utc_s: float) -> None:
        self.stage, self._since_s = stage, now_utc_s
        if self._wait is not None:
            self._wait.begin(now_utc_s)

    def _listen(self, sample: StatusSample, now_utc_s: float) -> None:
        if sample.does_refraction:
            self.sky.air = None
        if self.session.console.sky_aim is not None:
            # Stars are fed by the run's own model, and as they are seen.
            self.session.console.sky_aim.adds_air = False
        self._done = [self.sky.place_deg(star) for star in self.stars]
        self._queue.extend(self._planned(self.most, now_utc_s))
        if not self._queue:
            words = "nothing of the sky may be looked at: see the floor, the skyline and the axes' limits"
            self.end(SattrackError(words), now_utc_s)
        elif self.camera is None or self.stars:
            self._next(now_utc_s)
        else:
            self._go(Stage.HERE, now_utc_s)

    def _planned(self, count: int, now_utc_s: float) -> list[Body]:
        """Return what to look at from here on."""
        sidereal = mean_sidereal_deg(now_utc_s, self.sky.site.longitude_deg)
        bodies = fields(self.sky, sidereal) if self.camera is not None else named_stars()
        # Precession since the catalogue's epoch does not matter here.
        stars = [body.star for body in bodies if body.star is not None]
        places = np.array([[math.remainder(sidereal - one.ra_deg, 360.0), one.dec_deg] for one in stars])
        good: NDArray[np.intp] = np.flatnonzero(self.sky.clear(places)) if len(places) else np.zeros(0, int)
        if not len(good):
            return []
        start = self._axes(self._samples[-1], sidereal)
        rows = self.sky.tour(places[good], count, self._done, start)
        self._done += [(float(h), float(d)) for h, d in places[good][rows]]
        return [bodies[good[row]] for row in rows]

    def _axes(self, sample: StatusSample, sidereal_deg: float) -> tuple[float, float]:
        """Return where the axes stand by a status: hour angle and declination, past the pole beyond 90°.

        With a geometry it is the direction that the mount's reports mean, as stars have it.
        """
        hour_angle, dec = math.remainder(sidereal_deg - sample.ra_deg, 360.0), sample.dec_deg
        frame = self.sky.profile.frame
        if frame is not None:
            # What reports the sky does so by its own clock.
            mounts_deg = sample.sidereal_h * 15.0
            hour_angle, dec = frame.direction(
                *frame.of_report(mounts_deg - sample.ra_deg, sample.dec_deg)[:2]
            )
            if frame.geometry.reports == "sky":
                hour_angle += sidereal_deg - mounts_deg
            return self.sky.own_deg(hour_angle, dec)
        if not sample.beyond_pole:
            return hour_angle, dec
        pole = 180.0 if self.sky.site.latitude_deg >= 0.0 else -180.0
        return math.remainder(hour_angle + 180.0, 360.0), pole - dec

    def _next(self, now_utc_s: float) -> None:
        """Slew to the next place, or end where there is enough."""
        missing = self.most - (len(self.stars) - self.known)
        if not self._queue and missing > 0:
            self._queue.extend(self._planned(missing, now_utc_s))
        if not self._queue or missing <= 0:
            self.end(None, now_utc_s)
            return
        self._body = self._queue.popleft()
        model = self.judged
        if model is None and self.counting and self.fitted is not None:
            model = self.fitted.model
        if model is not None:
            model = model.on_side(self._samples[-1].beyond_pole)
        fed = self.sky.seen(self._body, now_utc_s, model)
        self._go(Stage.SLEWING, now_utc_s)
        refusal = self._ask(Slew(float(fed.ra_deg), float(fed.dec_deg)), now_utc_s)
        if refusal is not None:
            self._miss(f"not slewed to: {refusal}", now_utc_s)

    def _ask(self, request: Slew | Sync, now_utc_s: float) -> str | None:
        """Ask for something; return why it is refused, None where it goes on."""
        self.session.obey(request, now_utc_s)
        console = self.session.console
        return (console.refusal or "refused") if console.procedure is None else None

    def _slew(self, now_utc_s: float) -> None:
        console = self.session.console
        if console.outcome is not None:
            if console.outcome.state is TicketState.COMPLETE:
                self._go(Stage.SETTLING, now_utc_s)
            else:
                self._miss(f"not reached: {console.outcome.reason or 'the mount did not obey'}", now_utc_s)

    def _look(self, now_utc_s: float) -> None:
        """Take the first solved frame that began since the mount stands."""
        assert self.camera is not None
        assert self._wait is not None
        for frame in self._wait.look(now_utc_s)[:1]:
            assert frame.icrs_deg is not None
            if self.stage is Stage.HERE:
                self._found_here(frame, now_utc_s)
            else:
                ra, dec = frame.icrs_deg
                body = Body(f"{ra:.4f},{dec:.4f}", StarPlace(ra, dec))
                self._take(body, frame.utc_s, frame.exposure_s, now_utc_s)
            return
        words = self._wait.trouble(now_utc_s)
        if words is not None and self.camera.ended:
            self.end(SattrackError(words), now_utc_s)
        elif words is not None:
            self._unseen(words, now_utc_s)

    def _unseen(self, words: str, now_utc_s: float) -> None:
        if self.stage is Stage.HERE:
            self.tell(f"{words}; going on by what the mount reports")
            self._next(now_utc_s)
        else:
            self._miss(words, now_utc_s)

    def _found_here(self, frame: Solved, now_utc_s: float) -> None:
        """Sync a mount whose reports have little to do with the sky; others are modelled as they are."""
        assert frame.icrs_deg is not None
        there = self.sky.seen(Body("here", StarPlace(*frame.icrs_deg)), frame.utc_s)
        sample = self._samples[-1]
        axes = self._axes(sample, float(there.ra_deg) + float(there.ha_deg))
        before = Star(*self.sky.own_deg(float(there.ha_deg), float(there.dec_deg)), *axes)
        zeros = fit([before], self.sky.site.latitude_deg, self.sky.axes)
        off_deg = rms(zeros.before_arcsec) / 3600.0
        if off_deg > SYNC_DEG and not self._seen_twice(frame.icrs_deg):
            return
        if off_deg > SYNC_DEG and self.sky.profile.geometry is not None:
            self._align(there, sample, off_deg, now_utc_s)
            return
        if off_deg > SYNC_DEG:
            self.tell(f"the mount's reports are off by {off_deg:.1f}°: it is synced on the field it looks at")
            sync = Sync(float(there.ra_deg), float(there.dec_deg))
            refusal = self._ask(sync, now_utc_s)
            if refusal is not None:
                self.end(SattrackError(f"the mount cannot be synced: {refusal}"), now_utc_s)
                return
            self._body = None
            self._go(Stage.SLEWING, now_utc_s)
            return
        self._next(now_utc_s)

    def _seen_twice(self, icrs_deg: tuple[float, float]) -> bool:
        """Tell whether the frame before was solved alike: one that was wrong would lead everything astray."""
        before, self._seen_first = self._seen_first, icrs_deg
        return before is not None and separation_deg(*before, *icrs_deg) < ALIKE_DEG

    def _align(self, there: Any, sample: StatusSample, off_deg: float, now_utc_s: float) -> None:
        """End the run, for another with the zero points of the field that the telescope looks at."""
        words = f"the mount's reports are off by {off_deg:.1f}°"
        if self.judged is not None or self.realigned:
            why = "the model is of other zero points: make a new star run" if self.judged else "they jump"
            self.end(SattrackError(f"{words}: {why}"), now_utc_s)
            return
        frame, mounts_deg = self.sky.profile.frame, sample.sidereal_h * 15.0
        assert frame is not None
        own = frame.geometry.reports == "sky"
        hour_angle = mounts_deg - float(there.ra_deg) if own else float(there.ha_deg)
        looks, told = (hour_angle, float(there.dec_deg)), (mounts_deg - sample.ra_deg, sample.dec_deg)
        self.alignment = aligned(self.sky.profile, looks, told)
        self.tell(f"{words}: it gets the zero points of the field it looks at")
        self.end(None, now_utc_s)

    def _miss(self, words: str, now_utc_s: float) -> None:
        """Leave a place out."""
        self._missed += 1
        name = "the field" if self._body is None else self._body.name
        self.tell(f"{name}: {words}")
        if self._missed >= MOST_MISSED:
            self.end(
                SattrackError(f"{MOST_MISSED} places in a row gave no star, the last: {words}"), now_utc_s
            )
            return
        self._next(now_utc_s)

    def _take(self, body: Body, utc_s: float, exposure_s: float, now_utc_s: float) -> None:
        """Take a star in: where it was, and where the mount stood for it in the mean of its statuses."""
        seen = self.sky.seen(body, utc_s)
        sidereal = float(seen.ra_deg) + float(seen.ha_deg)
        near = [one for one in self._samples if abs(one.arrival_utc_s - utc_s) <= 0.5 * exposure_s + 0.3]
        places = np.array([self._axes(one, sidereal) for one in near or [self._samples[-1]]])
        first = places[0, 0] + float(np.mean(wrap180(places[:, 0] - places[0, 0])))
        assert body.star is not None
        icrs = icrs_at(body.star, utc_s)
        axes = first, float(np.mean(places[:, 1]))
        own = self.sky.own_deg(float(seen.ha_deg), float(seen.dec_deg))
        star = Star(*own, *axes, icrs, sidereal % 360.0)
        self._missed = 0
        self.stars.append(star)
        self.keep(star)
        if self.judged is None:
            self._fit(now_utc_s)
        if self.stage is not Stage.OVER:
            self._next(now_utc_s)

    def _fit(self, now_utc_s: float) -> None:
        """Fit what there is; end the run where it predicts as little as was asked."""
        latitude = self.sky.site.latitude_deg
        bump = find_bump(self.counting, latitude, self.sky.axes)
        if bump is not None:
            self.tell(bump.text(self.bumped_at))
            self.bumped_at += bump.before_star
            # What was measured before does not count: the stars are chosen anew.
            self.most += bump.before_star
            self._done = [self.sky.place_deg(star) for star in self.counting]
            self._queue.clear()
        try:
            self.fitted = fit(self.counting, latitude, self.sky.axes)
        except SattrackError as error:
            self.tell(str(error))
            return
        count = len(self.stars) - self.known
        off = rms(self.fitted.before_arcsec[-1:]) / 60.0
        text = f"{count} of {self.most}: off by {off:.1f}′"
        if len(self.counting) < FEWEST_TO_PREDICT:
            self.tell(text)
            return
        predicted = self.fitted.predicted_arcsec(self.sky.own_grid())
        left = rms(self.fitted.residuals_arcsec[-1:])
        self.tell(f"{text}, the model leaves {left:.1f}″ here and predicts {predicted:.1f}″ over the sky")
        if len(self.counting) >= FEWEST_STARS and predicted <= self.until_arcsec:
            self.end(None, now_utc_s)


def icrs_at(star: StarPlace, utc_s: float) -> tuple[float, float]:
    """Return where a star is in the ICRS at an instant, degrees: its catalogue's place, moved on.

    A file of stars has no proper motions; near stars move by a minute of arc between catalogue and run. ERFA.
    """
    if not (star.pm_ra_mas or star.pm_dec_mas):
        return star.ra_deg, star.dec_deg
    ra, dec = math.radians(star.ra_deg), math.radians(star.dec_deg)
    mas = math.radians(1.0 / 3.6e6)
    motions = star.pm_ra_mas * mas / math.cos(dec), star.pm_dec_mas * mas
    far = star.parallax_mas * 1e-3, star.radial_km_s
    now_jd = MJD_JD + UNIX_EPOCH_MJD + utc_s / DAY_S
    found = erfa.pmsafe(ra, dec, *motions, *far, star.epoch_jd, 0.0, now_jd, 0.0)
    return math.degrees(float(found[0])) % 360.0, math.degrees(float(found[1]))


def fields(sky: RunSky, sidereal_deg: float) -> list[Body]:
    """Return directions all over the sky, for a camera that finds any field."""
    places = [((sidereal_deg - h) % 360.0, d) for h, d in sky.grid().tolist()]
    return [Body(f"{ra:.2f},{dec:+.2f}", StarPlace(ra, dec)) for ra, dec in places]


def aligned(
    profile: MountProfile, direction_deg: tuple[float, float], reported_deg: tuple[float, float]
) -> MountProfile:
    """Return the profile of a mount that looks there while it reports that: hour angles and declinations."""
    frame = profile.frame
    assert frame is not None
    found = frame.aligned(direction_deg, reported_deg)
    zeros = round(found.first_zero_deg, 4), round(found.second_zero_deg, 4)
    return profile.with_geometry(
        msgspec.structs.replace(found, first_zero_deg=zeros[0], second_zero_deg=zeros[1])
    )


def without_zeros(profile: MountProfile) -> MountProfile:
    """Return the profile of the same mount without zero points: so its stars are kept in a file.

    Those of a mount with a pole of its own are kept as it reports them: no geometry is in them.
    """
    if profile.geometry is None:
        return profile
    if profile.own_axes != "altaz":
        return msgspec.structs.replace(profile, geometry=None)
    geometry = msgspec.structs.replace(profile.geometry, first_zero_deg=0.0, second_zero_deg=0.0)
    return msgspec.structs.replace(profile, geometry=geometry)


def seen_with(star: Star, before: MountProfile, after: MountProfile, site: Site) -> Star:
    """Return a star measured with one profile as it is with another, whose zero points may differ."""
    old, new = before.frame, after.frame
    if before.geometry == after.geometry:
        return star
    axes = star.axis_hour_angle_deg, star.axis_dec_deg
    if "altaz" not in {before.own_axes, after.own_axes}:
        told = axes if old is None else old.reported(*old.angles(*axes)[:2])
        told = told[0], math.remainder(told[1], 360.0)
        looks = told if new is None else new.direction(*new.of_report(*told)[:2])
        return star._replace(axis_hour_angle_deg=looks[0], axis_dec_deg=looks[1])
    assert old is not None
    assert new is not None
    axes = swung(-axes[0], axes[1], site.latitude_deg)
    looks = new.direction(*new.of_report(*old.reported(*old.angles(*axes)[:2]))[:2])
    west, altitude = swung(*looks, site.latitude_deg)
    return star._replace(axis_hour_angle_deg=-west % 360.0, axis_dec_deg=altitude)


def aligned_by(stars: Sequence[Star], profile: MountProfile, site: Site) -> MountProfile:
    """Return the profile with the zero points of stars as a file keeps them, if its own are far off.

    Raises SattrackError where the stars contradict one another.
    """
    if profile.geometry is None or not stars:
        return profile
    bare, axes = without_zeros(profile), profile.own_axes
    found = fit([seen_with(star, bare, profile, site) for star in stars], site.latitude_deg, axes)
    if rms(found.before_arcsec[found.used]) <= SYNC_DEG * 3600.0:
        return profile
    star = stars[int(np.flatnonzero(found.used)[0])]
    looks, told = star[:2], star[2:4]
    if axes == "altaz":
        looks, told = (swung(-one[0], one[1], site.latitude_deg) for one in (looks, told))
    frame = bare.frame
    return aligned(profile, looks, told if frame is None else frame.reported(*frame.angles(*told)[:2]))


def read_keys(descriptor: int) -> list[str]:
    """Return the keys that were pressed since, each as the terminal sends it."""
    if not select.select([descriptor], [], [], 0.0)[0]:
        return []
    text = os.read(descriptor, 64).decode(errors="replace")
    keys: list[str] = []
    while text:
        length = 3 if text.startswith("\x1b[") else 1
        keys.append(text[:length])
        text = text[length:]
    return keys

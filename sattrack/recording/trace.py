"""A recorded run made again, with what each sample was: errors, targets, rates, link, as columns."""

from __future__ import annotations

import math
import re
from array import array
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from sattrack.control.biases import ON_SKY
from sattrack.control.engine import HOLDING
from sattrack.control.stages import RunStage, Situation, Stages
from sattrack.control.tracker import FOLLOWING, Phase
from sattrack.core.errors import NO_JSON
from sattrack.mount.model import LONGEST_STEP_S, LONGEST_STEPS
from sattrack.mount.xerxes.datagrams import DatagramError, decode_command
from sattrack.recording.format import COMMAND, STATUS, VIEW
from sattrack.recording.replay import Replay, replay
from sattrack.views.run import StageView

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sattrack.control.biases import Biases
    from sattrack.control.engine import Engine
    from sattrack.control.target import TargetState
    from sattrack.recording.format import Entry, Recording

    Array = NDArray[np.float64]

SKY_EVERY_S = 1.0
STEADY_S_S = 0.01
STEADY_DEG_S = 0.002
"""An offset that changes more slowly (along in seconds, others in degrees, a second) leaves a run steady."""
SETTLES_S = 2.0
"""For how long after a change the drives may still show it."""
FIT_WITHIN = 5.0
"""Spans of SPAN_S whose median is so many times what counts as on target show no gain, delay or ripple."""
SPAN_S = 20.0
FOLLOWED = frozenset({HOLDING, *(phase.value for phase in FOLLOWING)})
ACQUIRED = ("following", "rejoining")
DENSE_S = 0.75
"""Views that come so often show what the run did between two, where the recording holds no stages."""
UNKNOWN = "unknown"
"""The name of a limit that a recording does not give."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Columns of a run. UTC as POSIX seconds; errors in arcseconds on the sky; angles in degrees.

    `doing` is the `RunStage` of each sample, `steady` is true where no offset was changing. `sent`
    are MoveAxis rates as they went out, in the mount's own sense, not a number where none was asked for.
    """

    engine: Engine
    result: Replay
    utc_s: Array
    arrival_utc_s: Array
    total: Array
    along: Array
    across: Array
    ra_error: Array
    dec_error: Array
    ra_deg: Array
    dec_deg: Array
    sidereal_h: Array
    counter: Array
    axes_deg: Array
    """The mount's sidereal time less the angle of the first axis, and the angle of the second, shape (n, 2):
    the right ascension and declination reported by an equatorial mount."""
    doing: NDArray[np.int8]
    held: NDArray[np.str_]
    """The limit that held the mount at each sample, empty for none."""
    acquired: bool
    """Whether the mount was ever on target."""
    ended_by: str | None
    """Why the run ended, by its recorded views; None where they do not show it."""
    steady: NDArray[np.bool_]
    beyond_pole: NDArray[np.bool_]
    """Whether the mount stood past the pole."""
    sent_utc_s: Array
    sent: Array
    sky_utc_s: Array
    sky: Array
    """Target altitude and azimuth, once a second."""

    @property
    def following(self) -> NDArray[np.bool_]:
        """The samples that the figures of the error count."""
        marked: NDArray[np.bool_] = self.doing == RunStage.FOLLOWING
        return marked

    @property
    def off_target(self) -> NDArray[np.bool_]:
        """The samples at which it followed, and was farther off than counts as on target."""
        return self.following & (self.total > self.engine.spec.plan.on_target_arcsec)

    @property
    def fit_for(self) -> NDArray[np.bool_]:
        """The samples that show the mount: it followed on target, and no offset changed, for SETTLES_S.

        After each disturbance the mount must have been on target again.
        """
        good = self.following & self.steady
        arrived, on_target = False, ~self.off_target
        for k in range(len(good)):
            arrived = bool(good[k]) and (arrived or bool(on_target[k]))
            good[k] = arrived
        disturbed = self.utc_s[~good]
        if not len(disturbed):
            return self._near(good)
        before = np.searchsorted(disturbed, self.utc_s, side="right") - 1
        since_s = self.utc_s - disturbed[np.maximum(before, 0)]
        return self._near(good & ((before < 0) | (since_s > SETTLES_S)))

    def _near(self, marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which of the samples are of spans in which the mount was typically near the target."""
        within_arcsec = FIT_WITHIN * self.engine.spec.plan.on_target_arcsec
        near = np.zeros_like(marked)
        spans = ((self.utc_s - self.utc_s[:1]) // SPAN_S).astype(int)
        at = np.flatnonzero(marked)
        at = at[np.argsort(spans[at], kind="stable")]
        for span in np.split(at, np.flatnonzero(np.diff(spans[at])) + 1):
            near[span] = len(span) > 0 and np.median(self.total[span]) < within_arcsec
        return near

    def seconds(self, marked: NDArray[np.bool_]) -> float:
        """Return the seconds that some of the samples stand for."""
        steps = np.diff(self.utc_s, prepend=self.utc_s[:1])
        usual_s = float(np.median(steps[1:])) if len(steps) > 1 else 0.0
        counted = marked & (steps > 0.0) & (steps < max(LONGEST_STEP_S, LONGEST_STEPS * usual_s))
        return float(steps[counted].sum())


class _RecordedView(msgspec.Struct):
    """The run's state by a recorded view; `stages` is None in recordings that are older than those."""

    phase: str
    ended_by: str | None = None
    pause: object | None = None
    warnings: tuple[str, ...] = ()
    stages: tuple[StageView, ...] | None = None

    def situation(self, acquired: bool, error_arcsec: float) -> Situation:
        """Return what was known of the run then."""
        names = (re.match(r"held at the (\w+) limit", text) for text in self.warnings)
        name = next((one[1] for one in names if one is not None), UNKNOWN)
        return Situation(
            following=self.phase in FOLLOWED,
            tracking=self.phase == Phase.TRACKING,
            paused=self.pause is not None,
            acquired=acquired,
            ended=self.ended_by is not None,
            holding=name if self.phase == HOLDING else None,
            error_arcsec=error_arcsec,
        )


COLUMNS = 15


class _Sample(NamedTuple):
    """One status; `situation` is as today's code has it, for recordings without it."""

    utc_s: float
    target: TargetState
    sky: tuple[float, ...]
    situation: Situation


class _Columns:
    """Gathers what a run shows while it is made again; later views show what it did.

    Rows of numbers stand one after the other in arrays: of a night there are a million.
    """

    def __init__(self) -> None:
        self.samples = array("d")
        self.doing = array("b")
        self.held: list[str] = []
        self.sent = array("d")
        self.sky = array("d")
        self.engine: Engine | None = None
        self.acquired = False
        self.ended_by: str | None = None
        self._sorted: Stages | None = None
        self._stages: dict[float, StageView] = {}
        self._seen_utc_s = self._sky_utc_s = -math.inf
        self._unsorted: list[_Sample] = []
        self._sorted_utc_s = math.nan

    def __call__(self, engine: Engine, entry: Entry) -> None:
        """Take one entry, handed to the engine already."""
        self.engine = engine
        if entry.topic == COMMAND:
            self._take_command(entry)
        elif entry.topic == STATUS:
            self._take_status(engine)
        elif entry.topic == VIEW:
            try:
                seen = msgspec.json.decode(entry.data, type=_RecordedView)
            except (msgspec.MsgspecError, *NO_JSON):
                return
            self.ended_by = seen.ended_by
            near = entry.utc_s - self._seen_utc_s < DENSE_S
            self._seen_utc_s = entry.utc_s
            self.sort(engine, seen, near)

    def _take_status(self, engine: Engine) -> None:
        sample, error = engine.session.sample, engine.tracker.error
        if sample is None or error is None or engine.failed:
            return
        if self.samples and self.samples[-COLUMNS] == error.utc_s:
            return
        by_axes = engine.sample or sample
        row = (
            error.utc_s,
            sample.arrival_utc_s,
            error.total_arcsec,
            error.along_arcsec,
            error.across_arcsec,
            error.ra_arcsec,
            error.dec_arcsec,
            sample.ra_deg,
            sample.dec_deg,
            sample.sidereal_h,
            float(sample.counter),
            float(_steady(engine.tracker.steering.biases, error.utc_s)),
            float(sample.beyond_pole),
            by_axes.ra_deg,
            by_axes.dec_deg,
        )
        sky: tuple[float, ...] = ()
        if error.utc_s - self._sky_utc_s >= SKY_EVERY_S:
            self._sky_utc_s = error.utc_s
            known = engine.tracker.direction_at(error.utc_s)
            sky = error.utc_s, float(known.alt_deg), float(known.az_deg)
        self.samples.extend(row)
        self._unsorted.append(_Sample(error.utc_s, engine.tracker.target, sky, engine.situation(error)))

    def sort(self, engine: Engine, seen: _RecordedView | None, near: bool) -> None:
        """Set what the run did at the samples since the last view, by this one where it is near enough."""
        if self._sorted is None:
            self._sorted = Stages(engine.spec.plan, engine.spec.profile)
        if seen is not None and seen.stages is not None:
            self._stages |= {stage.utc_s: stage for stage in seen.stages}
            self.acquired |= any(stage.doing in ACQUIRED for stage in seen.stages)
        for one in self._unsorted:
            step_s, self._sorted_utc_s = one.utc_s - self._sorted_utc_s, one.utc_s
            if not 0.0 < step_s < LONGEST_STEP_S:
                # The run counts neither its first sample nor one that follows a silence.
                doing, held = RunStage.OTHER, ""
            elif self._stages:
                doing, held = self._recorded(one.utc_s)
            else:
                now = one.situation
                if seen is not None and near:
                    now = seen.situation(self.acquired or seen.phase == Phase.TRACKING, now.error_arcsec)
                self.acquired |= now.acquired
                doing, held = self._sorted.take(now, one.utc_s, one.target)
            self.doing.append(doing)
            self.held.append(held)
            if doing is RunStage.FOLLOWING:
                self.sky.extend(one.sky)
        self._unsorted.clear()

    def _recorded(self, utc_s: float) -> tuple[RunStage, str]:
        """Return what the run did at a status, by the recording."""
        last = next((one for one in reversed(self._stages.values()) if one.utc_s <= utc_s), None)
        return (RunStage.OTHER, "") if last is None else (RunStage[last.doing.upper()], last.held_by or "")

    def _take_command(self, entry: Entry) -> None:
        try:
            command = decode_command(entry.data)
        except DatagramError:
            return
        ra = command.move_ra_rate_deg_s if command.move_ra else np.nan
        dec = command.move_dec_rate_deg_s if command.move_dec else np.nan
        self.sent.extend((entry.utc_s, ra, dec))


def _steady(biases: Biases, utc_s: float) -> bool:
    """Return whether no offset changes at an instant, but for what is too slow to be seen."""
    if not biases.moving:
        return True
    along, cross = biases.applied(utc_s)
    turned = (biases.offsets[what].state(utc_s).rate for what in ON_SKY)
    return abs(along.rate) < STEADY_S_S and all(abs(rate) < STEADY_DEG_S for rate in (cross.rate, *turned))


def trace(
    recording: Recording,
    build: Callable[[msgspec.Raw], Engine],
    progress: Callable[[float], None] | None = None,
) -> Trace:
    """Return a run made again; its errors follow from the inputs alone, not from today's commands.

    What the run did meanwhile is what its recorded views say.
    """
    columns = _Columns()
    result = replay(recording, build, watch=columns, progress=progress)
    engine = columns.engine or build(recording.header.spec)
    columns.sort(engine, None, near=False)
    samples = np.asarray(columns.samples).reshape(-1, COLUMNS).T
    sent, sky = (np.asarray(rows).reshape(-1, 3) for rows in (columns.sent, columns.sky))
    errors = ("total", "along", "across", "ra_error", "dec_error")
    names = ("utc_s", "arrival_utc_s", *errors, "ra_deg", "dec_deg", "sidereal_h", "counter")
    return Trace(
        engine=engine,
        result=result,
        doing=np.asarray(columns.doing),
        held=np.array(columns.held, dtype=str),
        acquired=columns.acquired,
        ended_by=columns.ended_by,
        steady=samples[11] > 0.0,
        beyond_pole=samples[12] > 0.0,
        axes_deg=samples[13:].T,
        sent_utc_s=sent[:, 0],
        sent=sent[:, 1:],
        sky_utc_s=sky[:, 0],
        sky=sky[:, 1:],
        **dict(zip(names, samples[:11], strict=True)),
    )

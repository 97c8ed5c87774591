"""A recorded run made again, with what each sample was: errors, targets, rates, link, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from sattrack.control.biases import ON_SKY
from sattrack.recording.format import COMMAND, STATUS
from sattrack.recording.replay import Replay, replay
from sattrack.tracker import FOLLOWING, Phase
from sattrack.xerxes.datagrams import DatagramError, decode_command

if TYPE_CHECKING:
    from collections.abc import Callable

    import msgspec
    from numpy.typing import NDArray

    from sattrack.control.biases import Biases
    from sattrack.engine import Engine
    from sattrack.recording.reading import Entry, Recording

    Array = NDArray[np.float64]

SKY_EVERY_S = 1.0
STEADY_S_S = 0.01
STEADY_DEG_S = 0.002
"""An offset that changes more slowly (along in seconds, others in degrees, a second) leaves a run steady."""
SETTLES_S = 2.0
"""For how long after a change the drives may still show it."""
FIT_WITHIN = 5.0
"""Spans of SPAN_S whose median is so many times what counts as on target tell of no gain, delay or ripple."""
SPAN_S = 20.0
LONGEST_STEP_S = 0.5
"""A gap between samples that is longer counts for no time."""


class Doing(IntEnum):
    """What a run did at a sample; only FOLLOWING counts in the figures of the error."""

    OTHER = 0
    """It waited, slewed or stopped."""
    ACQUIRING = 1
    """It followed, and had never been on target yet."""
    HELD = 2
    """A limit kept it from following."""
    PAUSED = 3
    REJOINING = 4
    """It was on its way back to the target, after a pause or a limit."""
    FOLLOWING = 5


@dataclass(frozen=True, slots=True)
class Trace:
    """Columns of a run. UTC as POSIX seconds; errors in arcseconds on the sky; angles in degrees.

    `doing` says what went on at each sample (`Doing`), `steady` is true where no offset was changing. `sent`
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
    doing: NDArray[np.int8]
    held: NDArray[np.str_]
    """The limit that held the mount at each sample, empty for none."""
    steady: NDArray[np.bool_]
    sent_utc_s: Array
    sent: Array
    sky_utc_s: Array
    sky: Array
    """Target altitude and azimuth, once a second."""

    @property
    def following(self) -> NDArray[np.bool_]:
        """The samples that the figures of the error count."""
        marked: NDArray[np.bool_] = self.doing == Doing.FOLLOWING
        return marked

    @property
    def off_target(self) -> NDArray[np.bool_]:
        """The samples at which it followed, and was farther off than counts as on target."""
        return self.following & (self.total > self.engine.spec.plan.on_target_arcsec)

    @property
    def fit_for(self) -> NDArray[np.bool_]:
        """The samples that tell of the mount: it followed on target, and no offset changed, for SETTLES_S."""
        good = self.following & self.steady
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
        for number in np.unique(spans[marked]):
            span = marked & (spans == number)
            near |= span & (np.median(self.total[span]) < within_arcsec)
        return near

    def seconds(self, marked: NDArray[np.bool_]) -> float:
        """Return the seconds that some of the samples stand for."""
        steps = np.diff(self.utc_s, prepend=self.utc_s[:1])
        counted = marked & (steps > 0.0) & (steps < LONGEST_STEP_S)
        return float(steps[counted].sum())


class _Columns:
    """Gathers what a run shows while it is made again."""

    def __init__(self) -> None:
        self.samples: list[tuple[float, ...]] = []
        self.held: list[str] = []
        self.sent: list[tuple[float, float, float]] = []
        self.sky: list[tuple[float, float, float]] = []
        self.engine: Engine | None = None
        self._rejoining = False
        """Whether a limit held the mount, and it was not on target since."""

    def __call__(self, engine: Engine, entry: Entry) -> None:
        """Take one entry, handed to the engine already."""
        self.engine = engine
        if entry.topic == COMMAND:
            self._take_command(entry)
        sample, error = engine.session.sample, engine.tracker.error
        if entry.topic != STATUS or sample is None or error is None or engine.failed:
            return
        if self.samples and self.samples[-1][0] == error.utc_s:
            return
        doing = self._doing(engine, error.total_arcsec)
        self.held.append(engine.safety.holding or "" if doing is Doing.HELD else "")
        self.samples.append(
            (
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
                float(doing),
                float(_steady(engine.tracker.steering.biases, error.utc_s)),
            )
        )
        if doing is Doing.FOLLOWING and (not self.sky or error.utc_s - self.sky[-1][0] >= SKY_EVERY_S):
            target = engine.tracker.direction_at(error.utc_s)
            self.sky.append((error.utc_s, float(target.alt_deg), float(target.az_deg)))

    def _doing(self, engine: Engine, error_arcsec: float) -> Doing:
        tracker = engine.tracker
        if tracker.rest is not None:
            return Doing.PAUSED
        following = tracker.phase in FOLLOWING
        if following and engine.safety.holding is not None:
            self._rejoining = tracker.acquired_utc_s is not None
            return Doing.HELD
        if self._rejoining and tracker.phase is Phase.TRACKING:
            self._rejoining = error_arcsec > engine.spec.plan.on_target_arcsec
        if tracker.ended_by is None and (self._rejoining or tracker.rejoining):
            return Doing.REJOINING
        if not following:
            return Doing.OTHER
        return Doing.ACQUIRING if tracker.acquired_utc_s is None else Doing.FOLLOWING

    def _take_command(self, entry: Entry) -> None:
        try:
            command = decode_command(entry.data)
        except DatagramError:
            return
        ra = command.move_ra_rate_deg_s if command.move_ra else np.nan
        dec = command.move_dec_rate_deg_s if command.move_dec else np.nan
        self.sent.append((entry.utc_s, ra, dec))


def _steady(biases: Biases, utc_s: float) -> bool:
    """Tell whether no offset changes at an instant, but for what is too slow to be seen."""
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
    """Return a run made again; its errors follow from the inputs alone, whatever today's commands are."""
    columns = _Columns()
    result = replay(recording, build, watch=columns, progress=progress)
    engine = columns.engine or build(recording.header.spec)
    samples = np.array(columns.samples).reshape(-1, 13).T
    sent = np.array(columns.sent).reshape(-1, 3)
    sky = np.array(columns.sky).reshape(-1, 3)
    errors = ("total", "along", "across", "ra_error", "dec_error")
    names = ("utc_s", "arrival_utc_s", *errors, "ra_deg", "dec_deg", "sidereal_h", "counter")
    return Trace(
        engine=engine,
        result=result,
        doing=samples[11].astype(np.int8),
        held=np.array(columns.held, dtype=str),
        steady=samples[12] > 0.0,
        sent_utc_s=sent[:, 0],
        sent=sent[:, 1:],
        sky_utc_s=sky[:, 0],
        sky=sky[:, 1:],
        **dict(zip(names, samples[:11], strict=True)),
    )

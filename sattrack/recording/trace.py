"""A recorded run made again, with what each sample was: errors, targets, rates, link, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sattrack.recording.format import COMMAND, STATUS
from sattrack.recording.replay import Replay, replay
from sattrack.tracker import FOLLOWING
from sattrack.xerxes.datagrams import DatagramError, decode_command

if TYPE_CHECKING:
    from collections.abc import Callable

    import msgspec
    from numpy.typing import NDArray

    from sattrack.engine import Engine
    from sattrack.recording.reading import Entry, Recording

    Array = NDArray[np.float64]

SKY_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class Trace:
    """Columns of a run. UTC as POSIX seconds; errors in arcseconds on the sky; angles in degrees.

    `following` marks the samples that figures count. `sent` are MoveAxis rates as they went out, in the
    mount's own sense, not a number where none was asked for.
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
    following: NDArray[np.bool_]
    sent_utc_s: Array
    sent: Array
    sky_utc_s: Array
    sky: Array
    """Target altitude and azimuth, once a second."""


class _Columns:
    """Gathers what a run shows while it is made again."""

    def __init__(self) -> None:
        self.samples: list[tuple[float, ...]] = []
        self.sent: list[tuple[float, float, float]] = []
        self.sky: list[tuple[float, float, float]] = []
        self.engine: Engine | None = None

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
        tracker = engine.tracker
        following = tracker.phase in FOLLOWING and not tracker.rejoining
        counted = following and tracker.acquired_utc_s is not None
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
                float(counted),
            )
        )
        if counted and (not self.sky or error.utc_s - self.sky[-1][0] >= SKY_EVERY_S):
            target = engine.tracker.direction_at(error.utc_s)
            self.sky.append((error.utc_s, float(target.alt_deg), float(target.az_deg)))

    def _take_command(self, entry: Entry) -> None:
        try:
            command = decode_command(entry.data)
        except DatagramError:
            return
        ra = command.move_ra_rate_deg_s if command.move_ra else np.nan
        dec = command.move_dec_rate_deg_s if command.move_dec else np.nan
        self.sent.append((entry.utc_s, ra, dec))


def trace(
    recording: Recording,
    build: Callable[[msgspec.Raw], Engine],
    progress: Callable[[float], None] | None = None,
) -> Trace:
    """Return a run made again; its errors follow from the inputs alone, whatever today's commands are."""
    columns = _Columns()
    result = replay(recording, build, watch=columns, progress=progress)
    engine = columns.engine or build(recording.header.spec)
    samples = np.array(columns.samples).reshape(-1, 12).T
    sent = np.array(columns.sent).reshape(-1, 3)
    sky = np.array(columns.sky).reshape(-1, 3)
    errors = ("total", "along", "across", "ra_error", "dec_error")
    names = ("utc_s", "arrival_utc_s", *errors, "ra_deg", "dec_deg", "sidereal_h", "counter")
    return Trace(
        engine=engine,
        result=result,
        following=samples[11] > 0.0,
        sent_utc_s=sent[:, 0],
        sent=sent[:, 1:],
        sky_utc_s=sky[:, 0],
        sky=sky[:, 1:],
        **dict(zip(names, samples[:11], strict=True)),
    )

"""Errors of the last minutes, and the scale they are drawn at."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from sattrack.views.run import TrackView

WINDOW_S = 180.0
GAP_S = 1.2
"""A pause between errors beyond which no line is drawn across; virtual runs give two views a second."""
RECENT_S = 2.0
HEADROOM = 1.1
TYPICAL_SHARE = 98.0
SMALLEST_ARCSEC = 0.05
LARGEST_ARCSEC = 5000.0


class ErrorSample(NamedTuple):
    """One error of both axes on the sky, arcseconds; `tracking` where it was acquired."""

    utc_s: float
    ra_arcsec: float
    dec_arcsec: float
    tracking: bool


class Trace(NamedTuple):
    """A line without gaps: seconds before now (negative) and the error of both axes, arcseconds."""

    ago_s: NDArray[np.float64]
    ra_arcsec: NDArray[np.float64]
    dec_arcsec: NDArray[np.float64]


class ErrorHistory:
    """Keeps the errors of following; the way of a slew is no error."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self.window_s = window_s
        self._samples: deque[ErrorSample] = deque()

    def add(self, view: TrackView) -> None:
        """Take the error of a view, if it has a new one."""
        error = view.error
        if error is None or view.phase not in {"acquiring", "tracking"}:
            return
        if self._samples and error.utc_s <= self._samples[-1].utc_s:
            return
        sample = ErrorSample(error.utc_s, error.ra_arcsec, error.dec_arcsec, view.phase == "tracking")
        self._samples.append(sample)
        while self._samples[0].utc_s < error.utc_s - self.window_s:
            self._samples.popleft()

    def need_arcsec(self) -> float | None:
        """Return how far the scale must reach: what is typical of tracking, and all of the last moments."""
        if not self._samples:
            return None
        last_utc_s = self._samples[-1].utc_s
        sizes = [(s, max(abs(s.ra_arcsec), abs(s.dec_arcsec))) for s in self._samples]
        recent = max(size for s, size in sizes if s.utc_s > last_utc_s - RECENT_S)
        tracking = [size for s, size in sizes if s.tracking]
        typical = float(np.percentile(tracking, TYPICAL_SHARE)) if tracking else 0.0
        return max(recent, typical)

    def traces(self, now_utc_s: float, columns: int) -> list[Trace]:
        """Return the lines to draw, thinned to two points in each of `columns` columns."""
        return [
            _thin(part, now_utc_s, self.window_s / max(1, columns))
            for part in self._parts(now_utc_s - self.window_s)
        ]

    def _parts(self, from_utc_s: float) -> Iterator[list[ErrorSample]]:
        part: list[ErrorSample] = []
        for sample in self._samples:
            if sample.utc_s < from_utc_s:
                continue
            if part and sample.utc_s - part[-1].utc_s > GAP_S:
                yield part
                part = []
            part.append(sample)
        if part:
            yield part


def _thin(part: list[ErrorSample], now_utc_s: float, column_s: float) -> Trace:
    table = np.array([sample[:3] for sample in part], dtype=np.float64)
    # Columns hang on the clock, not on now: the line must slide to the left, not shimmer.
    column = np.floor(table[:, 0] / column_s)
    starts = np.flatnonzero(np.diff(column, prepend=column[0] - 1.0))
    ends = np.append(starts[1:], len(table)) - 1
    lows, highs = (reduce.reduceat(table[:, 1:], starts, axis=0) for reduce in (np.minimum, np.maximum))
    # Each column keeps its extremes, so that a spike of one sample is still seen, in the order of its trend.
    falling = table[ends, 1:] < table[starts, 1:]
    first, second = np.where(falling, highs, lows), np.where(falling, lows, highs)
    values = np.stack((first, second), axis=1).reshape(-1, 2)
    ago = np.stack((table[starts, 0], table[ends, 0]), axis=1).ravel() - now_utc_s
    return Trace(ago, values[:, 0], values[:, 1])


class Scale:
    """A symmetric range in steps of 1, 2, 5: grows at once, shrinks once less has sufficed for a while."""

    def __init__(
        self,
        smallest_arcsec: float = SMALLEST_ARCSEC,
        largest_arcsec: float = LARGEST_ARCSEC,
        hold_s: float = 5.0,
    ) -> None:
        self._smallest_arcsec = smallest_arcsec
        self._largest_arcsec = largest_arcsec
        self._hold_s = hold_s
        self._less_since_s: float | None = None
        self.range_arcsec = smallest_arcsec

    def fit(self, need_arcsec: float, utc_s: float) -> float:
        """Return the range to draw, arcseconds to either side, given what must be seen at an instant."""
        wanted = self._step_for(need_arcsec * HEADROOM)
        if wanted >= self.range_arcsec:
            self.range_arcsec, self._less_since_s = wanted, None
        elif self._less_since_s is None or utc_s < self._less_since_s:
            self._less_since_s = utc_s
        elif utc_s - self._less_since_s >= self._hold_s:
            self.range_arcsec, self._less_since_s = wanted, None
        return self.range_arcsec

    def _step_for(self, need_arcsec: float) -> float:
        need = min(self._largest_arcsec, max(self._smallest_arcsec, need_arcsec))
        power = math.floor(math.log10(need))
        for factor in (1.0, 2.0, 5.0):
            step = float(f"{factor:g}e{power}")
            if need <= step * (1.0 + 1e-9):
                return step
        return float(f"1e{power + 1}")

"""Figures of a run: root mean squares, peaks and periods, gathered as they come."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field


@dataclass(slots=True)
class RunningError:
    """Root mean square and peak of errors, arcseconds."""

    count: int = 0
    peak_arcsec: float | None = None
    _sum: float = 0.0

    def add(self, error_arcsec: float) -> None:
        """Take in one error."""
        self.count += 1
        self._sum += error_arcsec * error_arcsec
        self.peak_arcsec = error_arcsec if self.peak_arcsec is None else max(self.peak_arcsec, error_arcsec)

    @property
    def rms_arcsec(self) -> float | None:
        """Root mean square; None before the first error."""
        return math.sqrt(self._sum / self.count) if self.count else None


@dataclass(slots=True)
class WindowedError:
    """Root mean square of the errors of the last seconds, arcseconds."""

    span_s: float = 10.0
    _errors: deque[tuple[float, float]] = field(default_factory=deque)
    _sum: float = 0.0

    def add(self, utc_s: float, error_arcsec: float) -> None:
        """Take in one error; instants rise."""
        square = error_arcsec * error_arcsec
        self._errors.append((utc_s, square))
        self._sum += square
        while self._errors and self._errors[0][0] < utc_s - self.span_s:
            self._sum -= self._errors.popleft()[1]

    def clear(self) -> None:
        """Forget everything."""
        self._errors.clear()
        self._sum = 0.0

    @property
    def rms_arcsec(self) -> float | None:
        """Root mean square; None where the window is empty."""
        return math.sqrt(max(0.0, self._sum) / len(self._errors)) if self._errors else None


def quantile(ordered: list[float], share: float) -> float:
    """Return the value below which a share of an ordered, non-empty list lies."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]

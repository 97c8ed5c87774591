"""Jogs by an operator's keys: kept going only by being asked for again; silence ends them. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

FIRST_JOG_S = 0.5
"""How long an axis moves at the first touch."""
NEXT_JOG_S = 0.3
"""How long it moves on after each touch that follows while it moves."""
FRESH_TOUCH_S = 0.4
"""After a stop, touches that follow one another more closely than this are still those of a held key."""


@dataclass(slots=True)
class _Jog:
    rate_deg_s: float
    until_utc_s: float


class Jogs:
    """Which axes are jogged, how fast and until when; true while any is. UTC as POSIX seconds."""

    def __init__(self) -> None:
        self._axes: dict[str, _Jog] = {}
        self._touched_utc_s = -math.inf
        self.blocked = False
        """Whether touches are those of a key that was held while a stop came."""

    def __bool__(self) -> bool:
        """Tell whether any axis is jogged."""
        return bool(self._axes)

    @property
    def rates_deg_s(self) -> tuple[float, float]:
        """The rates of right ascension and declination; 0 for an axis that is not jogged."""
        ra, dec = self._axes.get("ra"), self._axes.get("dec")
        return 0.0 if ra is None else ra.rate_deg_s, 0.0 if dec is None else dec.rate_deg_s

    def is_fresh(self, now_utc_s: float) -> bool:
        """Note a touch; tell whether it is one by itself, and not one of a key that has been held."""
        fresh = now_utc_s - self._touched_utc_s > FRESH_TOUCH_S
        self._touched_utc_s = now_utc_s
        return fresh

    def move(self, ra_rate_deg_s: float | None, dec_rate_deg_s: float | None, now_utc_s: float) -> None:
        """Move for FIRST_JOG_S, or for NEXT_JOG_S more where an axis is being jogged at that rate already."""
        self.blocked = False
        for axis, rate in (("ra", ra_rate_deg_s), ("dec", dec_rate_deg_s)):
            if rate is None:
                continue
            before = self._axes.get(axis)
            if before is not None and before.rate_deg_s == rate:
                before.until_utc_s = max(before.until_utc_s, now_utc_s + NEXT_JOG_S)
            else:
                self._axes[axis] = _Jog(rate, now_utc_s + FIRST_JOG_S)

    def end_over(self, now_utc_s: float) -> bool:
        """End the jogs whose time is over; tell whether there were any."""
        over = [axis for axis, jog in self._axes.items() if now_utc_s >= jog.until_utc_s]
        for axis in over:
            del self._axes[axis]
        return bool(over)

    def clear(self) -> None:
        """End all of them."""
        self._axes.clear()

    def block(self) -> None:
        """End all of them for a stop: a key that goes on being held does nothing."""
        self._axes.clear()
        self.blocked = True

"""Whether a mount that is fed by edges takes them: a rate has to last after its MoveAxis flag has fallen.

A mount that moves only while the flag is up is one that the profile should call held. It is watched until it
was on target once. Soft servos and weak drives may move like it for a while. So the flags are put on trial
before a mount is taken for one: for some seconds one rate is commanded and no other, the flags stay down, and
the axes go on or stand. Pure.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from sattrack.mount.model import MoveAxes

if TYPE_CHECKING:
    from sattrack.control.following import Learning
    from sattrack.control.target import TargetState
    from sattrack.mount.model import Motion

EDGES_MISSED_S, MUTE_MISSED_S, FALLEN = 5.0, 15.0, (0.2, 0.8)
"""How long a mount is watched before it is doubted: for longer where it acknowledges no edge, as its first
ones last. And the share of the commanded motion that is left where its rates end with the flag."""
DOUBTED_AFTER = 4
"""Filters that began anew so often found motion that no edges explain. On mounts that take edges they hardly
do; on those that do not, they go on doing so."""
SETTLES_S, SEEN_S, LONGEST_S = 0.5, 1.0, 5.0
"""After the handshake of a trial's rates the axes are given so long to take them, then looked at over so long
a time, until they are steady: drives that are weaker than told may first have way to make up for."""
STEADY_SHARE = 0.1
"""How far the halves of that time may be apart, as a share of the commanded rate."""
LEAST_DEG_S, MOST_DEG_S = 0.02, 0.3
"""The slowest target by which a trial tells anything, and the fastest axis in a trial: a mount that stands is
not yet one that safety stops, and one that goes on does not go far."""
STANDS_SHARE = 0.3
"""Share of the commanded rate below which the axes stand; those that do not track move at 0.0042°/s."""
ONLY_WHILE_UP = (
    "moves only while the MoveAxis flag is up: move_axis is held, and the profile says edge; it was sent a "
    "stop"
)
DISOBEYS = "the axes do not move as commanded: check the signs in the profile and the drives"


class FlagTrial:
    """One rate, commanded once, while the flags are down; rates are those of the reported axes."""

    def __init__(self, begun_utc_s: float, rates: MoveAxes, handshake_s: float) -> None:
        """Begin at an instant; the handshake of these rates takes so long if it is not answered."""
        self.rates = rates
        self.over = False
        self.stands = False
        """Whether the axes stood, at the end."""
        self._begun_utc_s = begun_utc_s
        self._from_utc_s = begun_utc_s + handshake_s + SETTLES_S
        self._places: deque[tuple[float, float, float]] = deque()

    @staticmethod
    def rates_for(target: TargetState) -> MoveAxes | None:
        """Return the rates of a target, as far as a trial may; None where it is too slow to tell anything."""
        ra, dec = target.ra_rate_deg_s, target.dec_rate_deg_s
        if math.hypot(ra, dec) < LEAST_DEG_S:
            return None
        share = min(1.0, MOST_DEG_S / max(abs(ra), abs(dec)))
        return MoveAxes(share * ra, share * dec)

    def see(self, utc_s: float, ra_deg: float, dec_deg: float) -> None:
        """Take the reported place at an instant."""
        # A clock that was set back would have it last for ever.
        self.over = not self._begun_utc_s <= utc_s <= self._from_utc_s + LONGEST_S
        if utc_s < self._from_utc_s:
            return
        places = self._places
        places.append((utc_s, ra_deg, dec_deg))
        middle = next(place for place in places if place[0] >= utc_s - 0.5 * SEEN_S)
        if utc_s - places[0][0] < SEEN_S or middle[0] == utc_s:
            return
        first, second = self._share(places[0], middle), self._share(middle, places[-1])
        steady = abs(second - first) < STEADY_SHARE
        self.stands = steady and abs(second) < STANDS_SHARE
        self.over = self.over or steady
        while places[0][0] <= utc_s - SEEN_S:
            places.popleft()

    def _share(self, first: tuple[float, float, float], last: tuple[float, float, float]) -> float:
        """Return how fast the axes went between two places, over what is commanded."""
        ra, dec = self.rates.ra_rate_deg_s, self.rates.dec_rate_deg_s
        came = ra * math.remainder(last[1] - first[1], 360.0) + dec * (last[2] - first[2])
        return came / ((ra * ra + dec * dec) * (last[0] - first[0]))


class EdgeWatch:
    """Watches a mount that was never on target; `why` says in words what is wrong with its edges."""

    def __init__(self, by_edges: bool) -> None:
        """Begin; a mount that is not fed by edges is not watched."""
        self.by_edges = by_edges
        self.why: str | None = None
        self._watched_s = 0.0
        """For how long it was off target since it last took up edges of which it had acknowledged none."""
        self._begun_anew = 0
        """How often the filters had begun anew before that."""
        self._unanswered = False
        self._trial: FlagTrial | None = None
        self._tried = False

    def miss(
        self,
        utc_s: float,
        seconds: float,
        learning: Learning,
        unanswered_s: float,
        target: TargetState | None,
    ) -> None:
        """Note that it was off target until an instant, for so long since the last one.

        `unanswered_s` is how long a handshake takes if it is not answered, 0 where it will be.
        """
        if not self.by_edges:
            return
        self._watched_s += seconds
        was, self._unanswered = self._unanswered, unanswered_s > 0.0
        if was and not self._unanswered:
            # What came of the rates that it did not take is no sign of how it takes others.
            self._watched_s, self._begun_anew = 0.0, learning.times_begun_anew
            learning.forget_rates()
        if self._watched_s < (MUTE_MISSED_S if self._unanswered else EDGES_MISSED_S):
            return
        low, high = FALLEN
        known = [fit.ratio for fit in learning.fits if fit.ratio is not None]
        falls_short = bool(known) and all(low < ratio < high for ratio in known)
        begun_anew = learning.times_begun_anew - self._begun_anew
        if self._tried or not (falls_short or begun_anew >= DOUBTED_AFTER):
            return
        rates = None if target is None else FlagTrial.rates_for(target)
        if rates is not None:
            self._trial, self._tried = FlagTrial(utc_s, rates, unanswered_s), True
        elif falls_short:
            self.why = ONLY_WHILE_UP

    def see(self, utc_s: float, ra_deg: float, dec_deg: float) -> None:
        """Take the reported place at an instant, on target or not."""
        if self._trial is None:
            return
        self._trial.see(utc_s, ra_deg, dec_deg)
        if self._trial.over:
            self.why = ONLY_WHILE_UP if self._trial.stands else None
            self._trial = None

    def motion(self, wanted: Motion, acquiring: bool) -> Motion:
        """Return what is wanted, or the rates of a trial in its place; other motion ends that."""
        if self._trial is not None and acquiring and isinstance(wanted, MoveAxes):
            return self._trial.rates
        self._trial = None
        return wanted

    @property
    def perhaps(self) -> str:
        """What else it may be, in words, where a mount that was never on target does not obey."""
        other, told = ("held", "edge") if self.by_edges else ("edge", "held")
        return f"perhaps move_axis is {other}, not {told} (`sattrack mount calibrate` finds out)"

    def sent(self, motion: Motion) -> None:
        """Note what safety made of the motion: by other rates than those of a trial nothing is shown."""
        if self._trial is not None and motion != self._trial.rates:
            self._trial = None

"""Passes that a plan may be made of: what is known of one, and of where and when."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sattrack.mount.model import MountProfile
    from sattrack.planning.kinematics import Loss
    from sattrack.safety.limits import SafetyLimits
    from tle.elements import Elements
    from tle.site import Site

    Span = tuple[float, float]
    Progress = Callable[[str, int, int], None]

TOO_LOW, CUT, SHORT, NOT_LIT = "too low", "cut", "too short", "not sunlit"
FAINT, FAST = "too faint", "too fast"
OLD, SUN, INFEASIBLE, PIER, CROWDED = "elements too old", "Sun up", "infeasible", "pier side", "too many"


@dataclass(frozen=True, slots=True)
class Loaded:
    """The elements of one source; fresh ones can be had before each pass where it is a provider's."""

    elements: list[Elements]
    renewable: bool
    name: str


@dataclass(frozen=True, slots=True)
class Situation:
    """Where and when: the plan's span in POSIX seconds of UTC, the instant of planning, site and mount."""

    span: Span
    now_utc_s: float
    site: Site
    profile: MountProfile
    limits: SafetyLimits
    magnitudes: Mapping[int, float] = field(default_factory=dict)
    taken: frozenset[int] = frozenset()
    """Catalogue numbers of satellites that were followed in the nights of the run before."""
    workers: int = 1


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pass that may be taken: POSIX seconds of UTC, degrees.

    `start_utc_s` to `end_utc_s` is all that may be followed of it; where it may be shortened it is entered
    by `latest_start_utc_s` and left from `earliest_end_utc_s` on. `culminate_utc_s` is its highest instant
    between start and end. `useful` are the stretches that count. `lost` says why it is none, kind and words,
    None where it may be chosen. One that `may_join` is entered late where the mount cannot be there at its
    start from the plan's beginning; `late_s` is by how much.
    """

    number: int
    entry: int
    elements: Elements
    start_utc_s: float
    culminate_utc_s: float
    end_utc_s: float
    latest_start_utc_s: float
    earliest_end_utc_s: float
    max_alt_deg: float
    useful: tuple[Span, ...]
    priority: float
    sun_alt_deg: float | None = None
    magnitude: float | None = None
    lost: tuple[str, str] | None = None
    notes: tuple[str, ...] = ()
    may_join: bool = False
    late_s: float = 0.0
    foretold: tuple[Loss, ...] = ()
    """What the mount's limits take of it; no part of `useful`, unless it is run though infeasible."""

    @property
    def useful_s(self) -> float:
        """Give the seconds that count of the whole."""
        return self.useful_within(self.start_utc_s, self.end_utc_s)

    @property
    def value(self) -> float:
        """Give the worth of the whole: priority times useful seconds."""
        return self.priority * self.useful_s

    def without(self, lost: tuple[Loss, ...]) -> Candidate:
        """Return the candidate without what the mount's limits take of it."""
        useful = list(self.useful)
        for loss in lost:
            cut = ((a, min(b, loss.begin_utc_s)) for a, b in useful)
            rest = ((max(a, loss.end_utc_s), b) for a, b in useful)
            useful = sorted((a, b) for a, b in (*cut, *rest) if b > a)
        return replace(self, useful=tuple(useful), foretold=lost)

    def useful_within(self, start_utc_s: float, end_utc_s: float) -> float:
        """Return the seconds that count between two instants."""
        return sum(max(0.0, min(b, end_utc_s) - max(a, start_utc_s)) for a, b in self.useful)


@dataclass(slots=True)
class Found:
    """What an entry came to: passes seen, how many of them were dropped for what, and words for the user."""

    passes: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

"""Which of a mount's reported places to believe: axes do not jump, but a bit of a datagram may. Pure."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount.model import MoveAxes

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.safety.geometry import Place

PROOF = 3
"""So many statuses in a row that go together are believed, however far they are from those before: a sync."""
FASTER = 1.5
"""By what factor axes may be faster than their slews."""
LOOSE_DEG = 0.5


class Former(NamedTuple):
    """Where the axes were last believed to be, and how much older that is than the last status, seconds."""

    place: Place
    older_s: float


class Belief(StrEnum):
    """What becomes of a status' place."""

    GOES_ON = "goes on"
    DOUBTED = "doubted"
    BORNE_OUT = "borne out"
    """It is far from those before, but so many in a row are: the axes are there after all."""
    ANEW = "anew"
    """Nothing had borne out the very first one: this one takes its place."""


class PositionFilter:
    """Follows the places of one mount, status by status."""

    def __init__(self, profile: MountProfile) -> None:
        self._fastest = (FASTER * profile.ra.slew_rate_deg_s, FASTER * profile.dec.slew_rate_deg_s)
        self._believed: Place | None = None
        self._believed_s = 0.0
        """How long ago that was reported."""
        self._claimed: Place | None = None
        """What the last status in doubt reported."""
        self._claims = 0
        self._begun = False
        """Whether a second place has gone together with the first."""
        self.moved = MoveAxes(0.0, 0.0)
        """The rates of the reported place between the last two statuses that are believed."""

    @property
    def former(self) -> Former | None:
        """Where the axes were before the place reported last, which nothing has borne out; else None."""
        if self._claimed is None or self._believed is None:
            return None
        return Former(self._believed, self._believed_s)

    def see(self, place: Place, seconds: float, moved: MoveAxes) -> Belief:
        """Take a status' place, how long after the one before it came, and the rates between the two."""
        seconds = max(0.0, seconds)
        self._believed_s += seconds
        if self._believed is None:
            self._believe(place)
            return Belief.ANEW
        if self._near(self._believed, place, self._believed_s):
            if self._claimed is None:
                self.moved = moved
            self._begun = True
            self._believe(place)
            return Belief.GOES_ON
        if not self._begun:
            self._believe(place)
            return Belief.ANEW
        goes_on = self._claimed is not None and self._near(self._claimed, place, seconds)
        self._claims = self._claims + 1 if goes_on else 1
        self._claimed = place
        if self._claims >= PROOF:
            self.moved = moved
            self._believe(place)
            return Belief.BORNE_OUT
        return Belief.DOUBTED

    def _near(self, one: Place, other: Place, seconds: float) -> bool:
        ha, dec = self._fastest
        return (
            abs(other[0] - one[0]) <= LOOSE_DEG + ha * seconds
            and abs(other[1] - one[1]) <= LOOSE_DEG + dec * seconds
        )

    def _believe(self, place: Place) -> None:
        self._believed, self._believed_s = place, 0.0
        self._claimed, self._claims = None, 0

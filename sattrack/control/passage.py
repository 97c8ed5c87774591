"""Following through the celestial pole: coordinates that go on past 90° of declination, and back.

A mount reports a direction and takes rates of it. Past the pole the declination that it reports falls as its
axis goes on, and the right ascension is half a turn from the axis'. Within a plan with detours everything
that steers is told in the axes' sense: as on the side of the pier on which following began.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount.model import MoveAxes, StatusSample

if TYPE_CHECKING:
    from sattrack.control.detour import Detour


class Place(NamedTuple):
    """Where the axes are to be, degrees; past 90° of declination, right ascension by half a turn."""

    ra_deg: float
    dec_deg: float


class Passage:
    """The detours of a plan, in order of time, and the side from which following began."""

    def __init__(self, detours: tuple[Detour, ...]) -> None:
        self._detours = detours
        self._turn_deg = 2.0 * detours[0].pole_dec_deg
        self._first_beyond: bool | None = None
        self.across = False
        """Whether the mount stands on the other side of the pole than at first, as last foreseen."""

    def from_instant(self, utc_s: float) -> Passage | None:
        """Return the passage for following that begins at an instant: what began before is not gone through.

        None where nothing is left.
        """
        ahead = tuple(detour for detour in self._detours if detour.begin_utc_s > utc_s)
        return Passage(ahead) if ahead else None

    def unfolded(self, sample: StatusSample) -> StatusSample:
        """Return a sample in the axes' sense. What comes before the first detour tells the first side."""
        begun = sample.arrival_utc_s >= self._detours[0].begin_utc_s
        if self._first_beyond is None or not begun:
            self._first_beyond = sample.beyond_pole
        if sample.beyond_pole == self._first_beyond:
            return sample
        return StatusSample(
            counter=sample.counter,
            arrival_utc_s=sample.arrival_utc_s,
            sidereal_h=sample.sidereal_h,
            ra_deg=(sample.ra_deg + 180.0) % 360.0,
            dec_deg=self._turn_deg - sample.dec_deg,
            slewing=sample.slewing,
            does_refraction=sample.does_refraction,
            ra_drive_deg_s=sample.ra_drive_deg_s,
            dec_drive_deg_s=sample.dec_drive_deg_s,
            beyond_pole=sample.beyond_pole,
        )

    def place(self, utc_s: float, ra_deg: float, dec_deg: float) -> Place:
        """Return where the axes are to be at an instant, for a target seen in a direction."""
        across = False
        for detour in self._detours:
            if utc_s >= detour.end_utc_s:
                across ^= detour.through_pole
            elif utc_s >= detour.begin_utc_s:
                if not across:
                    return Place(*detour.axes_at(utc_s, ra_deg, dec_deg))
                ra, dec = detour.axes_at(utc_s, ra_deg, dec_deg)
                return Place(ra + 180.0, self._turn_deg - dec)
        if not across:
            return Place(ra_deg, dec_deg)
        return Place((ra_deg + 180.0) % 360.0, self._turn_deg - dec_deg)

    def reported(self, rates: MoveAxes, dec_deg: float) -> MoveAxes:
        """Return rates of the direction for those of axes that stand at a declination, 90° and more too."""
        self.across = abs(dec_deg) > 90.0
        return self.turned(rates)

    def turned(self, rates: MoveAxes) -> MoveAxes:
        """Return rates from the one sense to the other, whichever of both they are in."""
        return MoveAxes(rates.ra_rate_deg_s, -rates.dec_rate_deg_s) if self.across else rates

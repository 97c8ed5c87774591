"""Whether a mount that was told to stop slows down, stands, and stays so; by its drives' rates. No I/O."""

from __future__ import annotations

from dataclasses import dataclass

from sattrack.mount import SIDEREAL_RATE_DEG_S, StatusSample

NOT_SLOWING_STATUSES = 3
TURNED_STATUSES = 2
MOST_TURNED_STOPS = 3
"""A mount that has taken to the sky after so many aborts does so by itself."""
REST_RATE_DEG_S = SIDEREAL_RATE_DEG_S * 0.5
"""A drive this near to standstill, or to sidereal tracking, is where it should be."""


@dataclass(slots=True)
class Standstill:
    """Follows one mount from status to status; `asked` begins a new stop."""

    _not_slowing: int = 0
    """Statuses in a row that show the mount moving, and no slower than before."""
    _speed_deg_s: float = 0.0
    _stood: int = 0
    """Statuses in a row that showed the axes standing since the abort was acknowledged."""
    _turning: int = 0
    """Statuses since then that showed them following the sky."""
    _stops_turned: int = 0
    slowing: bool = False
    """Whether the last status showed it slower than the one before."""

    def asked(self) -> None:
        """Begin with a stop that was not asked for before."""
        self._stood = self._turning = self._stops_turned = 0

    def see(self, sample: StatusSample, aborted: bool) -> None:
        """Take a status; `aborted` tells whether an abort of the stop in force has been acknowledged."""
        speed = abs(sample.ra_drive_deg_s) + abs(sample.dec_drive_deg_s)
        self.slowing = speed < self._speed_deg_s
        self._speed_deg_s = speed
        self._not_slowing = self._not_slowing + 1 if sample.slewing and not self.slowing else 0
        if not aborted or not is_at_rest(sample):
            self._stood = self._turning = 0
        elif abs(sample.ra_drive_deg_s) < REST_RATE_DEG_S:
            self._stood, self._turning = self._stood + 1, 0
        elif self._stood:
            self._turning += 1

    @property
    def turned(self) -> bool:
        """Whether axes that stood have taken to the sky, not of their mount's own habit."""
        return self._turning >= TURNED_STATUSES and self._stops_turned < MOST_TURNED_STOPS

    @property
    def goes_again(self) -> bool:
        """Whether something set the mount going again: a late datagram, or another client.

        The mount ignores the counters of commands, so a MoveAxis that comes after the abort acts, and leaves
        the mount on the sky when it ends.
        """
        return self._not_slowing >= NOT_SLOWING_STATUSES or self.turned

    def again(self) -> None:
        """Take notice that it is told to stop once more."""
        self._stops_turned += self.turned
        self._not_slowing = self._stood = self._turning = 0


def is_at_rest(sample: StatusSample) -> bool:
    """Tell whether both drives report rest, sidereal tracking counted as rest."""
    ra, dec = sample.ra_drive_deg_s, sample.dec_drive_deg_s
    resting = min(abs(ra), abs(ra - SIDEREAL_RATE_DEG_S)) < REST_RATE_DEG_S
    return resting and abs(dec) < REST_RATE_DEG_S

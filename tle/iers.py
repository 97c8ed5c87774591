"""The IERS table of Earth orientation, read from the installed package a few days at a time.

finals2000A.all has one record of fixed width a day since 1973-01-02, so that a day's place in the file is
known and the 3.7 MB need not be parsed. Layout: the IERS's readme.finals2000A.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import erfa
import numpy as np

from tle.errors import SourceError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_RECORD = 188
_TAIL_RECORDS = 800
UNIX_EPOCH_MJD = 40587
FIRST_MJD = 41684


@dataclass(frozen=True, slots=True)
class Orientation:
    """Earth orientation at 0h UTC of one day: UT1-UTC in seconds, pole in arcseconds."""

    mjd: int
    dut1_s: float
    xp_arcsec: float
    yp_arcsec: float


class IersTable:
    """finals2000A.all (Bulletin A): days read on demand, last observed and last predicted day known."""

    def __init__(self, path: str | Path) -> None:
        """Open the table and find its end. Raises SourceError where the file is no such table."""
        self._path = Path(path)
        try:
            self._text = self._path.read_bytes()
        except OSError as error:
            raise SourceError(f"{path}: cannot read Earth orientation: {error.strerror}") from None
        count = len(self._text) // _RECORD
        tail = range(max(0, count - _TAIL_RECORDS), count)
        last = [i for i in tail if self._field(i, 58, 68).strip()]
        observed = [i for i in last if self._field(i, 57, 58) == "I" and self._field(i, 16, 17) == "I"]
        if not observed or self._mjd(0) != FIRST_MJD:
            raise SourceError(
                f"{path}: is no finals2000A.all as the IERS publishes it: install astropy-iers-data"
            )
        self.last_observed_mjd = FIRST_MJD + observed[-1]
        self.last_mjd = FIRST_MJD + last[-1]

    def day(self, mjd: int) -> Orientation:
        """Return the record of a day from FIRST_MJD to `last_mjd`. Raises SourceError where it is damaged."""
        index = mjd - FIRST_MJD
        try:
            if index < 0 or self._mjd(index) != mjd:
                raise ValueError
            return Orientation(
                mjd,
                dut1_s=float(self._field(index, 58, 68)),
                xp_arcsec=float(self._field(index, 18, 27)),
                yp_arcsec=float(self._field(index, 37, 46)),
            )
        except ValueError:
            raise SourceError(
                f"{self._path}: no Earth orientation for MJD {mjd}: install astropy-iers-data again"
            ) from None

    def _field(self, index: int, first: int, last: int) -> str:
        start = index * _RECORD
        return self._text[start + first : start + last].decode("ascii", errors="replace")

    def _mjd(self, index: int) -> int:
        return int(float(self._field(index, 7, 15)))


@lru_cache(maxsize=1)
def installed_table() -> IersTable:
    """Return the table of the installed astropy-iers-data."""
    import astropy_iers_data

    return IersTable(astropy_iers_data.IERS_A_FILE)


@lru_cache(maxsize=1)
def _leap_seconds() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the days (MJD) from which TAI-UTC has its values since 1972, and the values in seconds."""
    table = erfa.leap_seconds.get()
    table = table[table["year"] >= 1972]
    starts = [
        int(erfa.cal2jd(int(y), int(m), 1)[1]) for y, m in zip(table["year"], table["month"], strict=True)
    ]
    return np.array(starts, dtype=np.int64), np.asarray(table["tai_utc"], dtype=np.float64)


def tai_minus_utc_s(mjd: int) -> float:
    """Return TAI-UTC on a day since 1972, in seconds."""
    starts, values = _leap_seconds()
    return float(values[max(0, int(np.searchsorted(starts, mjd, side="right")) - 1)])

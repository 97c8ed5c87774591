"""Stellarium's own telescope protocol, version 1.0, for the telescope that Alpaca's clients see; without I/O.

Messages begin with their length and type, two bytes each, little endian. The client sends one kind, a goto:
time, right ascension, declination. The server sends where the telescope points, with a status beside it.
Directions are of the mean equator and equinox of J2000, right ascension as 2³² a turn. Source: "Stellarium
Telescope Protocol version 1.0".
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

from tle.instants import Utc
from tle.observed import apparent_unit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tle.earth import EarthOrientation
    from tle.site import Site

GOTO = struct.Struct("<HHqIi")
POSITION = struct.Struct("<HHqIii")
TURN = 2**32
_ROUNDS = 3


class GotoReader:
    """Directions from a client's bytes."""

    def __init__(self) -> None:
        self.rest = b""
        """A message that has begun and not ended."""

    def read(self, data: bytes) -> list[tuple[float, float]] | None:
        """Return the directions asked for, degrees of J2000; None where this is another protocol."""
        self.rest += data
        found = []
        while len(self.rest) >= 4:
            length, kind = struct.unpack_from("<HH", self.rest)
            if (length, kind) != (GOTO.size, 0):
                return None
            if len(self.rest) < length:
                break
            _, _, _, ra, dec = GOTO.unpack_from(self.rest)
            dec_deg = 360.0 * dec / TURN
            if abs(dec_deg) > 90.0:
                return None
            found.append((360.0 * ra / TURN, dec_deg))
            self.rest = self.rest[length:]
        return found


def position(utc_s: float, ra_deg: float, dec_deg: float, is_well: bool) -> bytes:
    """Return the message that says where the telescope points, degrees of J2000."""
    ra = round(ra_deg % 360.0 / 360.0 * TURN) % TURN
    dec = round(dec_deg / 360.0 * TURN)
    return POSITION.pack(POSITION.size, 0, round(utc_s * 1e6), ra, dec, 0 if is_well else -1)


def of_date(
    ra_deg: float, dec_deg: float, utc_s: float, site: Site, earth: EarthOrientation
) -> tuple[float, float]:
    """Return the apparent direction of date of one of J2000, degrees."""
    return _angles(apparent_unit(ra_deg, dec_deg, Utc(utc_s), "j2000", site, earth))


def of_j2000(
    ra_deg: float, dec_deg: float, utc_s: float, site: Site, earth: EarthOrientation
) -> tuple[float, float]:
    """Return the direction of J2000 whose apparent direction of date is given, degrees."""
    wanted = apparent_unit(ra_deg, dec_deg, Utc(utc_s), "of_date", site, earth)
    turn = earth.celestial_matrix(Utc(utc_s))
    guess = turn.T @ wanted
    for _ in range(_ROUNDS):
        seen = apparent_unit(*_angles(guess), Utc(utc_s), "j2000", site, earth)
        guess = guess + turn.T @ (wanted - seen)
    return _angles(guess)


def _angles(unit: NDArray[np.float64]) -> tuple[float, float]:
    x, y, z = (float(value) for value in unit)
    return math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y)))

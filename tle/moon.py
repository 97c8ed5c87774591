"""The Moon as seen from the Earth's centre."""

from __future__ import annotations

from typing import TYPE_CHECKING

import erfa

from tle.sun import AU_KM, terrestrial_time

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tle.instants import Utc


def moon_km(at: Utc) -> NDArray[np.float64]:
    """Return the geometric Moon from the Earth's centre, GCRS, km, shape (3,) or (n, 3) (ERFA's moon98).

    Meeus's series: good to about 10″ and 20 km.
    """
    place: NDArray[np.float64] = erfa.moon98(*terrestrial_time(at))["p"] * AU_KM
    return place if at.is_array else place[0]

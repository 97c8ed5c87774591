"""A search so small that compiling is all it takes. Importing this module needs numba."""

from __future__ import annotations

from functools import lru_cache

from tle.compiled_search import near_crossings
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.ground import Ground
from tle.horizon import Horizon
from tle.instants import Utc
from tle.near_earth import start_near_earth
from tle.site import Site

_EPOCH_S = 1.75e9


@lru_cache
def run() -> None:
    """Search an hour for the passes of one object, once in a process."""
    elements = Elements(
        name="",
        catalog_number=1,
        classification="U",
        designator="",
        epoch=Utc(_EPOCH_S),
        inclination_deg=60.0,
        raan_deg=0.0,
        eccentricity=0.001,
        arg_perigee_deg=0.0,
        mean_anomaly_deg=0.0,
        mean_motion_rev_day=15.0,
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=0.0,
    )
    span = (_EPOCH_S, 3600.0)
    ground = Ground(Site(0.0, 0.0), EarthOrientation.fixed(0.0), *span)
    near_crossings(start_near_earth([elements]), ground, span, Horizon(10.0))

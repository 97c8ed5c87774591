"""Orbital elements in, topocentric directions and rates out.

>>> from tle import Propagator, Site, Utc, find, read_elements
>>> iss = find(read_elements("stations.tle"), "ISS")                         # doctest: +SKIP
>>> seen = Propagator(iss, Site(52.15, 4.49)).at(Utc.parse("2026-10-02T13:05:24Z"))  # doctest: +SKIP
>>> seen.ra_deg, seen.dec_deg, seen.ra_rate_deg_s                            # doctest: +SKIP

The public names are those of `dir(tle)`. `tle.skyfield` takes and gives skyfield's objects, and
`to_astropy()` gives astropy's; see docs/library.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tle.bias import Bias
    from tle.bodies import find_body, find_star
    from tle.direction import Direction
    from tle.earth import EarthOrientation, earth_orientation_age
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.errors import TleError
    from tle.facts import PassFacts, pass_facts, read_magnitudes
    from tle.formats.ephemerides import read_ephemerides
    from tle.formats.observations import Observation, Stations, read_observations, read_stations
    from tle.horizon import Horizon, HorizonMask
    from tle.instants import Utc
    from tle.observed import BiasEstimate, bias_from_observation
    from tle.passes import CataloguePasses, Pass, SatellitePass, find_catalogue_passes, find_passes
    from tle.propagator import Propagator
    from tle.refraction import Refraction
    from tle.site import Site
    from tle.sources import find, load_elements, parse_elements, read_elements, write_elements

__all__ = [
    "Bias",
    "BiasEstimate",
    "CataloguePasses",
    "Direction",
    "EarthOrientation",
    "Elements",
    "Ephemeris",
    "Horizon",
    "HorizonMask",
    "Observation",
    "Pass",
    "PassFacts",
    "Propagator",
    "Refraction",
    "SatellitePass",
    "Site",
    "Stations",
    "TleError",
    "Utc",
    "bias_from_observation",
    "earth_orientation_age",
    "find",
    "find_body",
    "find_catalogue_passes",
    "find_passes",
    "find_star",
    "load_elements",
    "parse_elements",
    "pass_facts",
    "read_elements",
    "read_ephemerides",
    "read_magnitudes",
    "read_observations",
    "read_stations",
    "write_elements",
]

_HOMES = {
    name: module
    for module, names in {
        "bias": ("Bias",),
        "bodies": ("find_body", "find_star"),
        "direction": ("Direction",),
        "earth": ("EarthOrientation", "earth_orientation_age"),
        "elements": ("Elements",),
        "ephemeris": ("Ephemeris",),
        "errors": ("TleError",),
        "facts": ("PassFacts", "pass_facts", "read_magnitudes"),
        "formats.ephemerides": ("read_ephemerides",),
        "formats.observations": ("Observation", "Stations", "read_observations", "read_stations"),
        "horizon": ("Horizon", "HorizonMask"),
        "instants": ("Utc",),
        "observed": ("BiasEstimate", "bias_from_observation"),
        "passes": (
            "CataloguePasses",
            "Pass",
            "SatellitePass",
            "find_catalogue_passes",
            "find_passes",
        ),
        "propagator": ("Propagator",),
        "refraction": ("Refraction",),
        "site": ("Site",),
        "sources": ("find", "load_elements", "parse_elements", "read_elements", "write_elements"),
    }.items()
    for name in names
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `import tle` costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'tle' has no attribute {name!r}")
    return getattr(import_module(f"tle.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """List the public names."""
    return __all__

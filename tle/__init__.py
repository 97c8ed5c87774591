"""Orbital elements in, topocentric directions and rates out.

>>> from tle import Propagator, Site, Utc, find, read_elements
>>> iss = find(read_elements("stations.tle"), "ISS")                         # doctest: +SKIP
>>> seen = Propagator(iss, Site(52.15, 4.49)).at(Utc.parse("2026-10-02T13:05:24Z"))  # doctest: +SKIP
>>> seen.ra_deg, seen.dec_deg, seen.ra_rate_deg_s                            # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tle.bias import Bias
    from tle.bodies import find_body
    from tle.catalogue_passes import CataloguePasses, SatellitePass, find_catalogue_passes
    from tle.direction import Direction
    from tle.earth import EarthOrientation, earth_orientation_age
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.errors import TleError
    from tle.facts import PassFacts, pass_facts
    from tle.formats.ephemerides import read_ephemerides
    from tle.formats.observations import read_observations
    from tle.formats.registry import parse_elements, write_elements
    from tle.horizon import Horizon, HorizonMask
    from tle.instants import Utc
    from tle.observations import Observation
    from tle.passes import Pass, find_passes
    from tle.propagator import Propagator
    from tle.refraction import Refraction
    from tle.residuals import BiasEstimate, bias_from_observation
    from tle.site import Site
    from tle.sources import find, load_elements, read_elements

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
    "TleError",
    "Utc",
    "bias_from_observation",
    "earth_orientation_age",
    "find",
    "find_body",
    "find_catalogue_passes",
    "find_passes",
    "load_elements",
    "parse_elements",
    "pass_facts",
    "read_elements",
    "read_ephemerides",
    "read_observations",
    "write_elements",
]

_HOMES = {
    "Bias": "bias",
    "BiasEstimate": "residuals",
    "CataloguePasses": "catalogue_passes",
    "Direction": "direction",
    "EarthOrientation": "earth",
    "Elements": "elements",
    "Ephemeris": "ephemeris",
    "Horizon": "horizon",
    "HorizonMask": "horizon",
    "Observation": "observations",
    "Pass": "passes",
    "PassFacts": "facts",
    "Propagator": "propagator",
    "Refraction": "refraction",
    "SatellitePass": "catalogue_passes",
    "Site": "site",
    "TleError": "errors",
    "Utc": "instants",
    "bias_from_observation": "residuals",
    "earth_orientation_age": "earth",
    "find": "sources",
    "find_body": "bodies",
    "find_catalogue_passes": "catalogue_passes",
    "find_passes": "passes",
    "load_elements": "sources",
    "parse_elements": "formats.registry",
    "pass_facts": "facts",
    "read_elements": "sources",
    "read_ephemerides": "formats.ephemerides",
    "read_observations": "formats.observations",
    "write_elements": "formats.registry",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `import tle` costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'tle' has no attribute {name!r}")
    return getattr(import_module(f"tle.{_HOMES[name]}"), name)

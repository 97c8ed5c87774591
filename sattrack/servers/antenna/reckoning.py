"""What the controller reduces by itself: offsets, the pointing model, sources, elements and their biases.

"Ideal Field System Antenna Interface", sections 7.0 and 8.0.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sattrack.servers.antenna.celestial import (
    Mean,
    OfDate,
    PointingModel,
    Reduction,
    Satellite,
    SkyPath,
    Target,
)
from sattrack.servers.antenna.element_store import ElementStore
from sattrack.servers.antenna.sky import AxisKind, AzEl, HaDec, RaDec, Sky
from tle.bias import NO_BIAS, Bias
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.servers.antenna.trajectory import AxisState
    from sattrack.servers.antenna.transactions import Request

MODEL_TERMS = ("ih", "id", "ch", "np", "ma", "me")


class Reckoning:
    """What has been sent of it so far, for one antenna."""

    def __init__(self, sky: Sky, axes: AxisKind) -> None:
        self.reduction = Reduction(sky, axes)
        self.elements = ElementStore()
        self.bias: Bias = NO_BIAS
        self.hold = False
        """Whether satellites are stood at, not tracked."""
        self._sky = sky

    def offset(self, request: Request) -> None:
        """Take the offsets of one kind."""
        pair = (request.number("first"), request.number("second"))
        match request.text("kind"):
            case "RADEC":
                self.reduction = replace(self.reduction, radec=pair)
            case "HADEC":
                self.reduction = replace(self.reduction, hadec=pair)
            case _:
                self.reduction = replace(self.reduction, azel=pair)

    def model(self, request: Request) -> None:
        """Take a pointing model."""
        model = PointingModel(*(request.number(term) for term in MODEL_TERMS))
        self.reduction = replace(self.reduction, model=model)

    def source(self, request: Request) -> Target:
        """Return the source that a command names."""
        coordinates = RaDec(request.number("ra"), request.number("dec"))
        return OfDate(coordinates) if request.text("frame") == "DATE" else Mean(coordinates, self._sky)

    def satellite(self, number: int, refracted: bool) -> Satellite:
        """Return the satellite whose elements were sent. Raises StoreError or TleError."""
        site = self._sky.site
        air = Refraction.standard(site.height_m) if refracted else None
        propagator = Propagator(self.elements.elements(number), site, earth=self._sky.earth, refraction=air)
        return Satellite(propagator, self.bias)

    def path(self, target: Target, near_deg: float = 0.0) -> SkyPath:
        """Return the way of a target, turns of the first axis counted from near a place."""
        return SkyPath(target, self.reduction, near_deg)

    def pointed_at(self, axes: AxisState, utc_s: float) -> tuple[float, float, float, float]:
        """Return where axes point: right ascension and declination of date, azimuth, elevation, degrees."""
        sky = self._sky
        if self.reduction.axes == "azel":
            seen = AzEl(axes.first_deg, axes.second_deg)
            place = sky.equatorial(seen, utc_s)
        else:
            place = self.reduction.model.inverse(HaDec(axes.first_deg, axes.second_deg))
            seen = sky.horizontal(place, utc_s)
        return (sky.sidereal_deg(utc_s) - place.ha_deg) % 360.0, place.dec_deg, seen.az_deg, seen.el_deg

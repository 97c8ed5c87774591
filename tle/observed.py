"""Directions as they were observed, by the frames of their sources, and the biases that follow from one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import erfa
import numpy as np

from tle.bias import Bias
from tle.earth import ARCSEC, to_tirs
from tle.elements import Elements
from tle.errors import ObservationError, PlaceError
from tle.instants import as_utc
from tle.sun import LIGHT_KM_S, earth_velocity_km_s

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.earth import EarthOrientation
    from tle.instants import Instant, Utc
    from tle.propagator import Propagator
    from tle.site import Site


Frame = Literal["of_date", "icrf", "j2000", "gcrs"]
_ALONG_STEP_S = 0.05
_LONGEST_STEP_S = 30.0
_MOST_STEPS = 40
# Places all round the orbit, and how far across the track a satellite may be that is looked for from there.
_PLACES, _FARTHEST_DEG = 180, 30.0
# The rounding of SGP4's time since epoch moves a low satellite by 1e-11 rad at 60 days and 7e-9 at a century.
_CLOSE_RAD = 5e-8
# A hundredth of Neptune's motion, and 30 times that of a star, by the Earth's.
_STANDS_RAD_S = 1e-10


@dataclass(frozen=True, slots=True)
class BiasEstimate:
    """Biases that bring the elements onto one observation, with standard deviations.

    `along_s` and `cross_deg` as `Bias` defines them; `separation_arcsec` is the distance on the sky between
    the observation and the elements without any bias.
    """

    along_s: float
    cross_deg: float
    along_sigma_s: float
    cross_sigma_deg: float
    separation_arcsec: float

    @property
    def bias(self) -> Bias:
        """The bias that the estimate stands for."""
        return Bias(self.along_s, self.cross_deg)


def bias_from_observation(
    propagator: Propagator,
    ra_deg: float,
    dec_deg: float,
    t: Instant,
    frame: Frame = "of_date",
    sigma_arcsec: float = 1.0,
    sigma_time_s: float = 0.0,
) -> BiasEstimate:
    """Return the biases with which the propagator sees its satellite where it was observed at an instant.

    Frames: "of_date" (true equator and equinox of date, the propagator's apparent or geometric place),
    "icrf" (astrometric, as a plate solution gives), "j2000" (the same by the mean equator and equinox of
    J2000), "gcrs" (the geometric direction by the axes of the ICRF, as `apparent_unit` has it). A bias of the
    propagator's own does not count. The standard deviations follow from those of the direction (each way,
    arcsec) and of the time (s).
    Raises ObservationError where no bias along the track leads to the direction (another satellite, most
    likely) or the direction is none; PlaceError for an unknown frame; BiasError; PropagationError.
    """
    t = as_utc(t)
    observed = _measured(ra_deg, dec_deg, frame)
    if not (sigma_arcsec >= 0.0 and sigma_time_s >= 0.0):
        raise ObservationError("a standard deviation is negative or no number: give arcseconds and seconds")
    seen = propagator
    if frame == "gcrs":
        seen = propagator.with_place("apparent")
        observed = apparent_unit(
            ra_deg, dec_deg, t, frame, propagator.site, propagator.earth, propagator.diurnal_aberration
        )
    elif frame != "of_date":
        seen = propagator.with_place("astrometric")
    model = _Model(seen, t)
    plain = model.unit(0.0, 0.0)
    along_s, cross_deg = _solve(model, observed, _orbit_s(propagator))
    _, m, n, speed = model.frame(along_s, cross_deg)
    motion = seen.at(t, Bias(along_s, cross_deg)).unit_rate
    sigma = sigma_arcsec * ARCSEC
    return BiasEstimate(
        along_s,
        cross_deg,
        math.hypot(sigma, float(motion @ m) * sigma_time_s) / speed,
        math.degrees(math.hypot(sigma, float(motion @ n) * sigma_time_s)),
        _angle(plain, observed) / ARCSEC,
    )


def apparent_unit(
    ra_deg: float,
    dec_deg: float,
    t: Instant,
    frame: Frame,
    site: Site,
    earth: EarthOrientation,
    diurnal_aberration: bool = True,
) -> NDArray[np.float64]:
    """Return the apparent direction, without air, of one that was measured at an instant; shape (3,).

    True equator and equinox of date, with annual and diurnal aberration: what the propagator's apparent place
    is compared with. Frames: "icrf" (astrometric, as a plate solution among catalogued stars gives it),
    "j2000" (the same by the mean equator and equinox of J2000), "of_date" (apparent already), "gcrs" (from
    the site to where the light left the satellite, by the axes of the ICRF, the Earth being at rest: annual
    aberration is in it, as the Earth takes satellites along, and diurnal aberration is not). Of a satellite
    the inverse of the astrometric place; bias, precession and nutation are ERFA's pnm06a, velocities add up
    without the terms of 0.001″ that relativity has. Raises ObservationError where it is no direction,
    PlaceError for an unknown frame, TimeRangeError.
    """
    t = as_utc(t)
    measured = _measured(ra_deg, dec_deg, frame)
    if frame == "of_date":
        return measured
    diurnal_km_s = _diurnal_km_s(t, site, earth) * diurnal_aberration
    if frame == "gcrs":
        return _unit(earth.celestial_matrix(t) @ (LIGHT_KM_S * measured) + diurnal_km_s)
    velocity = earth_velocity_km_s(t)
    # The light's own velocity against the barycentre, added to the observer's, has length c again, to 5e-9.
    own = measured * (LIGHT_KM_S - float(measured @ velocity))
    of_date = earth.celestial_matrix(t) @ (own + velocity)
    return _unit(of_date + diurnal_km_s)


class _Model:
    """The direction as a function of the two biases at one instant."""

    def __init__(self, propagator: Propagator, t: Utc) -> None:
        self._propagator = propagator
        self._t = t

    def unit(self, along_s: float, cross_deg: float) -> NDArray[np.float64]:
        return self._propagator.at(self._t, Bias(along_s, cross_deg)).unit

    def frame(
        self, along_s: float, cross_deg: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
        """Return the direction, the axes along and across its track, and its speed along, rad/s of bias.

        A bias across turns the direction about the axis along by just so much.
        """
        u = self.unit(along_s, cross_deg)
        later, sooner = (self.unit(along_s + s * _ALONG_STEP_S, cross_deg) for s in (1.0, -1.0))
        by_along = (later - sooner) / (2.0 * _ALONG_STEP_S)
        along = by_along - (by_along @ u) * u
        speed = float(np.linalg.norm(along))
        if speed < _STANDS_RAD_S:
            raise ObservationError(
                "the object stands still on the sky: no bias along its track follows from that"
            )
        m = along / speed
        return u, m, np.cross(u, m), speed


def _solve(model: _Model, observed: NDArray[np.float64], places_s: Sequence[float]) -> tuple[float, float]:
    """Return the biases that lead to a direction: from the elements' own place, else from the nearest place.

    `places_s` are biases along the track all round the orbit: elements of weeks ago may be minutes off.
    """
    found = _newton(model, observed, 0.0)
    if found is None and places_s:
        nearest_s = max(places_s, key=lambda along_s: float(model.unit(along_s, 0.0) @ observed))
        found = _newton(model, observed, nearest_s)
        if found is not None and abs(found[1]) > _FARTHEST_DEG:
            found = None
    if found is None:
        raise ObservationError(
            "no bias along the track leads from the elements to the observed direction: "
            "check the object, the time and the station"
        )
    return found


def _orbit_s(propagator: Propagator) -> Sequence[float]:
    """Return biases along the track that lead all round an orbit, seconds; none for other ephemerides."""
    if not isinstance(propagator.elements, Elements):
        return ()
    half = 0.5 * propagator.elements.period_s
    places: list[float] = np.linspace(-half, half, _PLACES).tolist()
    return places


def _newton(model: _Model, observed: NDArray[np.float64], along_s: float) -> tuple[float, float] | None:
    """Return the biases that lead to a direction, by Newton's method with bounded steps along the track.

    It goes on until a step no longer lessens the miss: then only rounding is left, at most 0.01 arcsec. None
    where it comes to no end.
    """
    cross_deg = 0.0
    best, least_miss = (along_s, cross_deg), math.inf
    for _ in range(_MOST_STEPS):
        u, m, n, speed = model.frame(along_s, cross_deg)
        # Angles of the observation in the frame of the track: along it as a turn, across it as a height.
        up, ahead = float(observed @ u), float(observed @ m)
        turn, height = math.atan2(ahead, up), math.atan2(float(observed @ n), math.hypot(up, ahead))
        miss = max(abs(turn), abs(height))
        if miss < least_miss:
            best, least_miss = (along_s, cross_deg), miss
        elif least_miss < _CLOSE_RAD:
            return best
        along_s += max(-_LONGEST_STEP_S, min(_LONGEST_STEP_S, turn / speed))
        cross_deg = max(-89.0, min(89.0, cross_deg + math.degrees(height)))
    return None


def _measured(ra_deg: float, dec_deg: float, frame: Frame) -> NDArray[np.float64]:
    """Return a measured direction as a vector of its frame, of the ICRF for j2000; checked."""
    if frame not in get_args(Frame):
        raise PlaceError(f"{frame!r} is no frame: give one of {', '.join(get_args(Frame))}")
    if not -90.0 <= dec_deg <= 90.0 or not math.isfinite(ra_deg):
        raise ObservationError(
            f"RA {ra_deg}°, Dec {dec_deg}° is no direction: Dec must be within -90° to 90°"
        )
    ra, dec = math.radians(ra_deg), math.radians(dec_deg)
    measured = np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    if frame != "j2000":
        return measured
    frame_bias, _, _ = erfa.bp06(2451545.0, 0.0)
    turned: NDArray[np.float64] = frame_bias.T @ measured
    return turned


def _unit(a: NDArray[np.float64]) -> NDArray[np.float64]:
    return a / math.sqrt(float(a @ a))


def _angle(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def _diurnal_km_s(t: Utc, site: Site, earth: EarthOrientation) -> NDArray[np.float64]:
    """Return the site's velocity by the Earth's turn, true equator and equinox of date, km/s."""
    theta, spin, equinoxes, _, xp, yp = earth.rotation(t.unix_s)
    x, y, _ = to_tirs(site.itrs_km, xp, yp)
    c, s = math.cos(theta + equinoxes), math.sin(theta + equinoxes)
    return np.array([-spin * (x * s + y * c), spin * (x * c - y * s), 0.0])

"""The error to expect on the sky, part by part, along and across the satellite's motion; one sigma.

| part | size | known from |
|---|---|---|
| elements | `tle.elements` along; across, a share of what that is at the epoch | their age |
| ephemeris | in place of elements: the standard deviation that a file states | the file |
| clock | its error times the direction's rate | what sets the clock, else taken as 10 ms |
| Earth orientation | UT1: 0.25 ms times days^0.75; the pole: 0.68 mas times days^0.8 | the last observation |
| refraction | 10 hPa and 10 K of the air; all of it where none is applied | taken |
| delay | the calibration's interval, as of a uniform distribution, times the rate | the profile, else 5 ms |
| servo | root of the mean square of the rehearsed run's errors | the rehearsal |

Predicted Earth orientation grows as the IERS's Bulletin A says of itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from sattrack.views.formatting import length
from tle.bias import Bias
from tle.earth import EarthOrientation
from tle.elements import Elements, expected_along_s
from tle.ephemeris import CARRIED, UNSTATED_M, TableEphemeris
from tle.instants import DAY_S, Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from tle.ephemeris import Ephemeris

    Array = NDArray[np.float64]

ARCSEC = 3600.0
ACROSS_SHARE = 0.3
"""Error across the track as a share of that along it at the elements' epoch; it does not grow with it."""
UNKNOWN_CLOCK_S = 0.01
UNMEASURED_DELAY_S = 0.005
UT1_S, UT1_POWER = 0.00025, 0.75
POLE_ARCSEC, POLE_POWER = 0.00068, 0.80
"""Growth of the errors of predicted Earth orientation with days (IERS Bulletin A, explanatory text)."""
OBSERVED_UT1_S, OBSERVED_POLE_ARCSEC = 0.00001, 0.0001
PRESSURE_SIGMA_HPA, TEMPERATURE_SIGMA_K = 10.0, 10.0
PROBE_S = 0.01
MOMENTS = 61


class BudgetPart(msgspec.Struct, frozen=True):
    """One part, arcseconds on the sky, one sigma, at the moment of the budget."""

    name: str
    along_arcsec: float
    across_arcsec: float
    why: str


class Budget(msgspec.Struct, frozen=True):
    """The parts at one moment of a pass, and their sum as the root of squares."""

    utc: str
    alt_deg: float
    parts: tuple[BudgetPart, ...]
    along_arcsec: float
    across_arcsec: float
    fov_deg: float | None
    fits: bool | None
    """Whether two sigmas lie within half of the field of view; null without one."""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What the budget needs beside the pass: the machine's clock, the run's own errors, the field of view."""

    clock_error_s: float | None
    servo_along_arcsec: float
    servo_across_arcsec: float
    servo_why: str
    refraction_applied: bool
    fov_deg: float | None = None


@dataclass(frozen=True, slots=True)
class _Frame:
    """Unit vectors of the direction and of along and across at each moment, shape (n, 3), arcsec."""

    along: Array
    across: Array

    def parts(self, moved: Array) -> tuple[Array, Array]:
        """Return a displacement of the unit vector as sizes along and across, arcseconds."""
        scale = math.degrees(1.0) * ARCSEC
        return (
            np.abs(np.sum(moved * self.along, axis=1)) * scale,
            np.abs(np.sum(moved * self.across, axis=1)) * scale,
        )


def error_budget(
    propagator: Propagator, bias: Bias, span: tuple[float, float], profile: MountProfile, facts: Circumstances
) -> Budget:
    """Return the budget at the moment of a span (POSIX seconds of UTC) at which the error along is largest.

    `propagator` gives what is fed. Raises TimeRangeError, PropagationError.
    """
    utc_s = np.linspace(span[0], span[1], MOMENTS)
    at = Utc(utc_s)
    seen = propagator.at(at, bias)
    later = propagator.at(at, Bias(bias.along_s + PROBE_S, bias.cross_deg))
    by_second = (later.unit - seen.unit) / PROBE_S
    frame = _frame(seen.unit, by_second)
    rate = seen.unit_rate
    source = "elements" if isinstance(propagator.elements, Elements) else "ephemeris"
    named: list[tuple[str, Array, Array, str | list[str]]] = [
        (source, *_elements(propagator, utc_s, by_second)),
        ("clock", *_timed(frame, rate, *_clock(facts.clock_error_s))),
        ("earth orientation", *_orientation(frame, propagator, bias, at)),
        ("refraction", *_refraction(frame, propagator, bias, at, facts.refraction_applied)),
        ("delay", *_timed(frame, rate, *_delay(profile))),
        (
            "servo",
            np.full(MOMENTS, facts.servo_along_arcsec),
            np.full(MOMENTS, facts.servo_across_arcsec),
            facts.servo_why,
        ),
    ]
    along = np.sqrt(sum(part[1] ** 2 for part in named))
    across = np.sqrt(sum(part[2] ** 2 for part in named))
    worst = int(np.nanargmax(np.hypot(along, across)))
    total = float(along[worst]), float(across[worst])
    fits = None if facts.fov_deg is None else 2.0 * max(total) <= 0.5 * facts.fov_deg * ARCSEC
    return Budget(
        utc=Utc(float(utc_s[worst])).isoformat("seconds"),
        alt_deg=float(seen.alt_deg[worst]),
        parts=tuple(
            BudgetPart(n, float(a[worst]), float(c[worst]), why if isinstance(why, str) else why[worst])
            for n, a, c, why in named
        ),
        along_arcsec=total[0],
        across_arcsec=total[1],
        fov_deg=facts.fov_deg,
        fits=fits,
    )


def _frame(unit: Array, by_second: Array) -> _Frame:
    along = by_second - unit * np.sum(unit * by_second, axis=1)[:, None]
    length = np.linalg.norm(along, axis=1)[:, None]
    # What stands still has no track.
    along = along / np.where(length > 0.0, length, 1.0)
    return _Frame(along, np.cross(unit, along))


def _elements(propagator: Propagator, utc_s: Array, by_second: Array) -> tuple[Array, Array, str | list[str]]:
    """Return the error along and across, and what it is known from: at each moment, or at all of them."""
    elements = propagator.elements
    if not isinstance(elements, Elements):
        return _ephemeris(elements, propagator, utc_s)
    seconds = np.array([expected_along_s(elements, Utc(float(t))) for t in utc_s])
    arcsec = np.linalg.norm(by_second, axis=1) * math.degrees(1.0) * ARCSEC
    at_epoch = ACROSS_SHARE * expected_along_s(elements, elements.epoch)
    days = (np.abs(elements.age_s(Utc(utc_s))) / DAY_S).tolist()
    return seconds * arcsec, at_epoch * arcsec, [f"{each:.1f} days from their epoch" for each in days]


def _ephemeris(ephemeris: Ephemeris, propagator: Propagator, utc_s: Array) -> tuple[Array, Array, str]:
    """Return what the covariance that an ephemeris states comes to on the sky, the same every way."""
    known = ephemeris.covariance(Utc(float(utc_s[0])))
    orbit = isinstance(ephemeris, TableEphemeris) and ephemeris.segments[0].frame.kind not in CARRIED
    if known is None and not orbit:
        none = np.zeros_like(utc_s)
        return none, none, f"not stated: {ephemeris.provenance}"
    sigma_km = UNSTATED_M / 1000.0 if known is None else known.sigma_km
    arcsec = sigma_km / math.sqrt(3.0) / propagator.at(Utc(utc_s)).range_km * math.degrees(1.0) * ARCSEC
    size = length(1000.0 * sigma_km)
    return arcsec, arcsec, f"not stated: taken as {size}" if known is None else f"{size} by the file"


def _clock(error_s: float | None) -> tuple[float, str]:
    if error_s is None:
        return UNKNOWN_CLOCK_S, f"not known: taken as {UNKNOWN_CLOCK_S * 1000.0:g} ms"
    return error_s, f"{error_s * 1000.0:.2g} ms by what sets it"


def _delay(profile: MountProfile) -> tuple[float, str]:
    record = profile.calibration
    if record is None:
        return UNMEASURED_DELAY_S, f"not measured: taken as {UNMEASURED_DELAY_S * 1000.0:g} ms"
    known = profile.clock_offset_s is not None
    low, high = record.clock_offset_interval_s if known else record.status_delay_interval_s
    what = "the mount's clock" if known else "the status' delay"
    return (high - low) / math.sqrt(12.0), f"{what} known to within {1000.0 * (high - low):.2g} ms"


def _timed(frame: _Frame, rate: Array, seconds: float, why: str) -> tuple[Array, Array, str]:
    along, across = frame.parts(rate * seconds)
    return along, across, why


def _orientation(frame: _Frame, propagator: Propagator, bias: Bias, at: Utc) -> tuple[Array, Array, str]:
    middle = Utc(float(at.unix_s[len(at.unix_s) // 2]))
    known = propagator.earth.orientation(middle)
    days = max(0.0, propagator.earth.age(middle).age_s or 0.0) / DAY_S
    ut1_s = max(OBSERVED_UT1_S, UT1_S * days**UT1_POWER)
    pole_arcsec = max(OBSERVED_POLE_ARCSEC, POLE_ARCSEC * days**POLE_POWER)

    def unit(ut1: float, pole: float) -> Any:
        earth = EarthOrientation.fixed(known.dut1_s + ut1, known.xp_arcsec + pole, known.yp_arcsec + pole)
        return (
            Propagator(propagator.elements, propagator.site, earth=earth, refraction=propagator.refraction)
            .at(at, bias)
            .unit
        )

    still = unit(0.0, 0.0)
    turned, tilted = frame.parts(unit(ut1_s, 0.0) - still), frame.parts(unit(0.0, pole_arcsec) - still)
    why = "observed" if days <= 0.0 else f"predicted {days:.0f} days ahead"
    return np.hypot(turned[0], tilted[0]), np.hypot(turned[1], tilted[1]), why


def _refraction(
    frame: _Frame, propagator: Propagator, bias: Bias, at: Utc, applied: bool
) -> tuple[Array, Array, str]:
    air = propagator.refraction or Refraction.standard(propagator.site.height_m)
    share = math.hypot(
        PRESSURE_SIGMA_HPA / air.pressure_hpa, TEMPERATURE_SIGMA_K / (air.temperature_c + 273.15)
    )
    why = f"the air known to {PRESSURE_SIGMA_HPA:g} hPa and {TEMPERATURE_SIGMA_K:g} °C"
    if not applied:
        share, why = 1.0, "none is applied"
    place = (propagator.elements, propagator.site)
    bent = Propagator(*place, earth=propagator.earth, refraction=air).at(at, bias).unit
    airless = Propagator(*place, earth=propagator.earth).at(at, bias).unit
    along, across = frame.parts((bent - airless) * share)
    return along, across, why

"""SGP4 for many near-Earth objects at once: arrays of objects and instants instead of one at a time.

Formulas of Hoots and Roehrich, Spacetrack Report 3 (1980), as revised by Vallado et al., AIAA 2006-6753:
improved mode, WGS 72, periods under 225 minutes. Lengths are Earth radii and times minutes within, as there.

Written out beside the package sgp4, whose arrays are of one object, or of all objects at the same instants: a
search for passes needs each object at instants of its own, and the mean orbit without the short-period terms.
Elsewhere the package is used; a test compares the two.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tle.elements import DEG, MU_KM3_S2, RADIUS_KM, REV_DAY_PER_RAD_MIN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.elements import Elements

    Array = NDArray[np.float64]

XKE = 60.0 / math.sqrt(RADIUS_KM**3 / MU_KM3_S2)
_J2, _J3, _J4 = 0.001082616, -0.00000253881, -0.00000165597
_J3_J2 = _J3 / _J2
DEEP_SPACE_MIN = 225.0
# Newton's next error is e/2 times the square of the last step: below rounding, and below 200 m where rough.
_EXACT_RAD, _ROUGH_RAD, _MOST_STEPS = 1e-8, 5e-3, 12
_LONGEST_STEP_RAD = 0.95


class NearEarth(NamedTuple):
    """What SGP4 makes of the elements at their epoch; arrays of shape (n,), names as in the papers."""

    epoch_s: Array
    ecco: Array
    argpo: Array
    nodeo: Array
    mo: Array
    inclo: Array
    bstar: Array
    no: Array
    ao: Array
    cosio: Array
    sinio: Array
    con41: Array
    x1mth2: Array
    x7thm1: Array
    mdot: Array
    argpdot: Array
    nodedot: Array
    nodecf: Array
    eta: Array
    cc1: Array
    cc4: Array
    cc5: Array
    d2: Array
    d3: Array
    d4: Array
    t2cof: Array
    t3cof: Array
    t4cof: Array
    t5cof: Array
    omgcof: Array
    xmcof: Array
    delmo: Array
    sinmao: Array
    xlcof: Array
    aycof: Array

    @property
    def period_s(self) -> Array:
        """Give the time of one revolution by Brouwer's mean motion, in seconds."""
        return 120.0 * math.pi / self.no

    def advanced(self, unix_s: float) -> NearEarth:
        """Return the same in single precision, with angles at POSIX seconds instead of at the epoch.

        Within a few days of there single precision places an object to 100 m, at half the cost.
        """
        t = (unix_s - self.epoch_s) / 60.0
        turn = 2.0 * math.pi
        moved = self._replace(
            mo=(self.mo + self.mdot * t) % turn,
            argpo=(self.argpo + self.argpdot * t) % turn,
            nodeo=(self.nodeo + self.nodedot * t) % turn,
        )
        single: list[Any] = [values.astype(np.float32) for values in moved]
        return NearEarth(*single)

    def spread(self, index: NDArray[np.intp]) -> NearEarth:
        """Return what goes with arrays about the objects of these indices; one object is left as it is."""
        return self if len(self.no) == 1 else self.take(index)

    def take(self, index: NDArray[np.intp]) -> NearEarth:
        """Return the objects of these indices, which may repeat."""
        return NearEarth(*(values[index] for values in self))


class MeanOrbit(NamedTuple):
    """SGP4's orbit at instants before the terms that go round twice a revolution; radii, rad; shape (m,)."""

    semi_major: Array
    axn: Array
    ayn: Array
    longitude: Array
    node: Array


def _brouwer(kozai: Array, e2: Array, cos2: Array) -> Array:
    ak = (XKE / kozai) ** (2.0 / 3.0)
    d1 = 0.75 * _J2 * (3.0 * cos2 - 1.0) / (np.sqrt(1.0 - e2) * (1.0 - e2))
    small = d1 / ak**2
    adel = ak * (1.0 - small * small - small * (1.0 / 3.0 + 134.0 * small * small / 81.0))
    return kozai / (1.0 + d1 / adel**2)


def start_near_earth(elements: Sequence[Elements]) -> NearEarth:
    """Return what SGP4 starts from, for objects with periods under 225 minutes; see `NearEarth`."""
    columns = np.array(
        [
            (
                e.epoch.unix_s,
                e.eccentricity,
                e.inclination_deg * DEG,
                e.raan_deg * DEG,
                e.arg_perigee_deg * DEG,
                e.mean_anomaly_deg * DEG,
                e.mean_motion_rev_day / REV_DAY_PER_RAD_MIN,
                e.bstar_per_earth_radius,
            )
            for e in elements
        ]
    ).reshape(-1, 8)
    epoch_s, ecco, inclo, nodeo, argpo, mo, kozai, bstar = (np.ascontiguousarray(c) for c in columns.T)
    no = _brouwer(kozai, ecco * ecco, np.cos(inclo) ** 2)
    return _start(epoch_s, (ecco, inclo, nodeo, argpo, mo), no, bstar)


def mean_start(eccentricity: Array, inclination_rad: Array, motion_rad_min: Array) -> NearEarth:
    """Return what SGP4 would start from of mean orbits, by Brouwer's motion, without drag; angles are 0."""
    none = np.zeros_like(eccentricity)
    return _start(none, (eccentricity, inclination_rad, none, none, none), motion_rad_min, none)


def _start(
    epoch_s: Array, elements: tuple[Array, Array, Array, Array, Array], no: Array, bstar: Array
) -> NearEarth:
    """Return what SGP4 starts from; elements are eccentricity and four angles, no is Brouwer's motion."""
    ecco, inclo, nodeo, argpo, mo = elements
    e2 = ecco * ecco
    cosio, sinio = np.cos(inclo), np.sin(inclo)
    cos2 = cosio * cosio
    cos4 = cos2 * cos2
    ao = (XKE / no) ** (2.0 / 3.0)
    con41, con42, x1mth2 = 3.0 * cos2 - 1.0, 1.0 - 5.0 * cos2, 1.0 - cos2
    beta2 = 1.0 - e2
    pinv2 = 1.0 / (ao * beta2) ** 2
    temp1 = 1.5 * _J2 * pinv2 * no
    temp2 = 0.5 * temp1 * _J2 * pinv2
    temp3 = -0.46875 * _J4 * pinv2 * pinv2 * no
    beta = np.sqrt(beta2)
    node_j2 = -temp1 * cosio
    drag = _drag(ecco, ao, no, bstar, (con41, x1mth2, sinio), argpo, mo)
    return NearEarth(
        epoch_s=epoch_s,
        ecco=ecco,
        argpo=argpo,
        nodeo=nodeo,
        mo=mo,
        inclo=inclo,
        bstar=bstar,
        no=no,
        ao=ao,
        cosio=cosio,
        sinio=sinio,
        con41=con41,
        x1mth2=x1mth2,
        x7thm1=7.0 * cos2 - 1.0,
        mdot=no + 0.5 * temp1 * beta * con41 + 0.0625 * temp2 * beta * (13.0 - 78.0 * cos2 + 137.0 * cos4),
        argpdot=-0.5 * temp1 * con42
        + 0.0625 * temp2 * (7.0 - 114.0 * cos2 + 395.0 * cos4)
        + temp3 * (3.0 - 36.0 * cos2 + 49.0 * cos4),
        nodedot=node_j2 + (0.5 * temp2 * (4.0 - 19.0 * cos2) + 2.0 * temp3 * (3.0 - 7.0 * cos2)) * cosio,
        nodecf=3.5 * beta2 * node_j2 * drag["cc1"],
        xlcof=-0.25 * _J3_J2 * sinio * (3.0 + 5.0 * cosio) / np.maximum(1.0 + cosio, 1.5e-12),
        aycof=-0.5 * _J3_J2 * sinio,
        delmo=(1.0 + drag["eta"] * np.cos(mo)) ** 3,
        sinmao=np.sin(mo),
        **drag,
    )


def _drag(
    ecco: Array, ao: Array, no: Array, bstar: Array, tilt: tuple[Array, Array, Array], argpo: Array, mo: Array
) -> dict[str, Array]:
    """Return the coefficients of drag; below 220 km of perigee those of the higher powers are zero."""
    con41, x1mth2, sinio = tilt
    perigee = ao * (1.0 - ecco)
    height_km = (perigee - 1.0) * RADIUS_KM
    s_km = np.where(height_km < 156.0, np.where(height_km < 98.0, 20.0, height_km - 78.0), 78.0)
    s = s_km / RADIUS_KM + 1.0
    tsi = 1.0 / (ao - s)
    eta = ao * ecco * tsi
    eta2, eeta = eta * eta, ecco * eta
    psi2 = np.abs(1.0 - eta2)
    coef = ((120.0 - s_km) / RADIUS_KM) ** 4 * tsi**4
    coef1 = coef / psi2**3.5
    cc2 = (
        coef1
        * no
        * (
            ao * (1.0 + 1.5 * eta2 + eeta * (4.0 + eta2))
            + 0.375 * _J2 * tsi / psi2 * con41 * (8.0 + 3.0 * eta2 * (8.0 + eta2))
        )
    )
    cc1 = bstar * cc2
    eccentric = ecco > 1.0e-4
    safe = np.where(eccentric, ecco, 1.0)
    cc3 = np.where(eccentric, -2.0 * coef * tsi * _J3_J2 * no * sinio / safe, 0.0)
    beta2 = 1.0 - ecco * ecco
    flat = -3.0 * con41 * (1.0 - 2.0 * eeta + eta2 * (1.5 - 0.5 * eeta))
    flat += 0.75 * x1mth2 * (2.0 * eta2 - eeta * (1.0 + eta2)) * np.cos(2.0 * argpo)
    round_ = eta * (2.0 + 0.5 * eta2) + ecco * (0.5 + 2.0 * eta2)
    full = perigee >= 220.0 / RADIUS_KM + 1.0
    d2 = 4.0 * ao * tsi * cc1 * cc1
    temp = d2 * tsi * cc1 / 3.0
    d3 = (17.0 * ao + s) * temp
    d4 = 0.5 * temp * ao * tsi * (221.0 * ao + 31.0 * s) * cc1
    t5 = 0.2 * (3.0 * d4 + 12.0 * cc1 * d3 + 6.0 * d2 * d2 + 15.0 * cc1 * cc1 * (2.0 * d2 + cc1 * cc1))
    return {
        "eta": eta,
        "cc1": cc1,
        "cc4": 2.0 * no * coef1 * ao * beta2 * (round_ - _J2 * tsi / (ao * psi2) * flat),
        "cc5": np.where(full, 2.0 * coef1 * ao * beta2 * (1.0 + 2.75 * (eta2 + eeta) + eeta * eta2), 0.0),
        "d2": np.where(full, d2, 0.0),
        "d3": np.where(full, d3, 0.0),
        "d4": np.where(full, d4, 0.0),
        "t2cof": 1.5 * cc1,
        "t3cof": np.where(full, d2 + 2.0 * cc1 * cc1, 0.0),
        "t4cof": np.where(full, 0.25 * (3.0 * d3 + cc1 * (12.0 * d2 + 10.0 * cc1 * cc1)), 0.0),
        "t5cof": np.where(full, t5, 0.0),
        "omgcof": np.where(full, bstar * cc3 * np.cos(argpo), 0.0),
        "xmcof": np.where(eccentric & full, -2.0 / 3.0 * coef * bstar / np.where(eccentric, eeta, 1.0), 0.0),
    }


def mean_orbit(c: NearEarth, t: Array, since: Array | None = None) -> MeanOrbit:
    """Return the secular and long-period orbit, t minutes after each object's epoch; shapes (m,).

    Angles move on for `since` minutes where `c` is `advanced`, otherwise for t too.
    NaN where SGP4 gives up: eccentricity outside -0.001 to 1, or no orbit left.
    """
    since = t if since is None else since
    xmdf = c.mo + c.mdot * since
    argp = c.argpo + c.argpdot * since
    node = c.nodeo + c.nodedot * since + c.nodecf * t * t
    wobble = c.omgcof * t + c.xmcof * ((1.0 + c.eta * np.cos(xmdf)) ** 3 - c.delmo)
    mean = xmdf + wobble
    argp = argp - wobble
    tempa = 1.0 - t * (c.cc1 + t * (c.d2 + t * (c.d3 + t * c.d4)))
    em = c.ecco - c.bstar * (c.cc4 * t + c.cc5 * (np.sin(mean) - c.sinmao))
    em = np.where((em < 1.0) & (em >= -0.001), np.maximum(em, 1.0e-6), np.nan)
    am = c.ao * tempa * tempa
    templ = t * t * (c.t2cof + t * (c.t3cof + t * (c.t4cof + t * c.t5cof)))
    axn = em * np.cos(argp)
    temp = 1.0 / (am * (1.0 - em * em))
    ayn = em * np.sin(argp) + temp * c.aycof
    return MeanOrbit(am, axn, ayn, mean + c.no * templ + argp + temp * c.xlcof * axn, node)


def mean_longitude(c: NearEarth) -> Array:
    """Return SGP4's mean anomaly plus argument of perigee as a polynomial in minutes since the epochs.

    Coefficients of the powers 0 to 5, rad, shape (6, n).
    """
    return np.stack(
        [
            c.mo + c.argpo,
            c.mdot + c.argpdot,
            c.no * c.t2cof,
            c.no * c.t3cof,
            c.no * c.t4cof,
            c.no * c.t5cof,
        ]
    )


def in_plane(orbit: MeanOrbit, exact: bool) -> tuple[Array, Array, Array, Array, Array]:
    """Return cos u, sin u, radius, 1 - e², e cos E of an orbit: Kepler's equation in u = E + ω."""
    a, axn, ayn = orbit.semi_major, orbit.axn, orbit.ayn
    u = orbit.longitude
    eo = u.copy()
    enough = _EXACT_RAD if exact else _ROUGH_RAD
    for _ in range(_MOST_STEPS):
        s, c = np.sin(eo), np.cos(eo)
        step = (u - ayn * c + axn * s - eo) / (1.0 - c * axn - s * ayn)
        np.clip(step, -_LONGEST_STEP_RAD, _LONGEST_STEP_RAD, out=step)
        eo += step
        if not np.abs(step).max(initial=0.0, where=np.isfinite(step)) >= enough:
            break
    s, c = np.sin(eo), np.cos(eo)
    ecos, esin = axn * c + ayn * s, axn * s - ayn * c
    beta2 = 1.0 - (axn * axn + ayn * ayn)
    radius = a * (1.0 - ecos)
    temp = esin / (1.0 + np.sqrt(beta2))
    scale = a / radius
    return scale * (c - axn + ayn * temp), scale * (s - ayn - axn * temp), radius, beta2, ecos


def teme_km(c: NearEarth, unix_s: Array) -> tuple[Array, Array, Array]:
    """Return SGP4's position, TEME, km, of objects each at its own instants; shapes that fit.

    NaN where SGP4 fails, or the object is under the Earth's radius. Agrees with Vallado's code to 1e-6 km.
    """
    orbit = mean_orbit(c, (unix_s - c.epoch_s) / 60.0)
    cosu, sinu, radius, beta2, _ = in_plane(orbit, exact=True)
    sin2u, cos2u = 2.0 * sinu * cosu, 1.0 - 2.0 * sinu * sinu
    temp = 1.0 / (orbit.semi_major * beta2)
    temp1 = 0.5 * _J2 * temp
    temp2 = temp1 * temp
    r = radius * (1.0 - 1.5 * temp2 * np.sqrt(beta2) * c.con41) + 0.5 * temp1 * c.x1mth2 * cos2u
    turn = -0.25 * temp2 * c.x7thm1 * sin2u
    node = orbit.node + 1.5 * temp2 * c.cosio * sin2u
    tilt = c.inclo + 1.5 * temp2 * c.cosio * c.sinio * cos2u
    r = np.where(r < 1.0, np.nan, r) * RADIUS_KM
    ct, st = np.cos(turn), np.sin(turn)
    cosu, sinu = (cosu * ct - sinu * st) * r, (sinu * ct + cosu * st) * r
    cn, sn = np.cos(node), np.sin(node)
    across = sinu * np.cos(tilt)
    return cosu * cn - across * sn, cosu * sn + across * cn, sinu * np.sin(tilt)


def short_period_bound_km(c: NearEarth, semi_major: Array, eccentricity: Array) -> Array:
    """Return how far the terms left out of `MeanOrbit` can move an object, km, for the largest orbit it has.

    They are four, each a sine or cosine of 2u times the factor in `teme_km`: one moves along the radius,
    three turn the position about the Earth's centre; the sum of their amplitudes bounds them all.
    """
    e = np.abs(eccentricity) + np.abs(c.aycof) / (semi_major * (1.0 - eccentricity**2))
    p = semi_major * (1.0 - e * e)
    temp1 = 0.5 * _J2 / p
    temp2 = temp1 / p
    apogee = semi_major * (1.0 + e)
    radial = 1.5 * temp2 * np.abs(c.con41) * apogee + 0.5 * temp1 * c.x1mth2
    angle = temp2 * (0.25 * np.abs(c.x7thm1) + 1.5 * np.abs(c.cosio) * (1.0 + c.sinio))
    bound: Array = (radial + angle * (apogee + radial)) * RADIUS_KM
    return bound

"""What cameras saw in a recorded pass, as residuals by the angles of the mount's axes.

The mount's own reports do not show by how much its axes stand past them; the sky does. Where the satellite
was seen beside the middle of the image, where the field's middle lay among the stars, and where the satellite
lay among them, are each held against what the mount reported at that instant. What else may be behind a
residual is given with it as columns: the orbit, dates, the camera's image, the pointing model.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.core.angles import wrap180
from sattrack.mount.model import mean_sidereal_deg
from sattrack.pointing.learn import PassResiduals, Prior
from sattrack.pointing.periodic import AxisStand, past_pole
from sattrack.pointing.terms import FORMULAS, PointingModel
from sattrack.recording.fits import NoFit
from sattrack.recording.format import messages
from sattrack.views.messages import FRAMES, ObservationMessage, SeenOffset, SolvedField
from tle.direction import teme_axis
from tle.elements import Elements
from tle.instants import ARRAYS, Utc
from tle.observed import apparent_unit
from tle.orbit_fit import STATES, CorrectableOrbit, Partials

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.recording.format import Recording
    from sattrack.recording.trace import Trace
    from tle.propagator import Propagator

    Array = NDArray[np.float64]

FEWEST_SEEN = 40
NEAR_S = 0.2
"""An instant counts where a status of the following is so near."""
ORBIT_WIDER, ORBIT_ROUNDS = 3.0, 4
DELAY_S, CLOCK_S, ROTATION_RAD, SCALE = 0.02, 0.1, math.radians(4.0), 0.02
"""One sigma of what else a residual may come from: dates of statuses, of frames, the camera's image."""
MOUNT_TERMS = ("IH", "ID", "CH", "NP", "MA", "ME", "TF")
UNKNOWN_ARCSEC, UNKNOWN_FLEXURE_ARCSEC, PASS_ARCSEC = 720.0, 60.0, 10.0
"""How far off a mount without a pointing model is, one sigma of each term, and any from pass to pass."""
PASS_TERMS = frozenset({"IH", "ID", "CH", "MA", "ME", "IA", "IE", "CA", "AN", "AW"})
MODEL_STEP_ARCSEC, TURN_RAD = 1.0, 1e-5
LEAST_SIGMA_ARCSEC = 0.3
OFFSET, FIELD, PLACE = range(3)
"""What was seen: the satellite in the image, the image among the stars, the satellite among them."""


class _Seen(NamedTuple):
    """What was seen at instants: the kinds, arcseconds or of-date unit vectors, and sigmas.

    `in_air` tells of which vectors refraction is a part.
    """

    kind: NDArray[np.int8]
    utc_s: Array
    offset: Array
    unit: Array
    sigma: Array
    in_air: NDArray[np.bool_]


def sky_residuals(recording: Recording, run: Trace, profile: MountProfile) -> PassResiduals | NoFit:
    """Return what cameras saw in a pass, by a profile's geometry and pointing model, or why it is nothing."""
    seen = _seen(recording, run)
    if len(seen.utc_s) < FEWEST_SEEN:
        return NoFit(f"cameras saw {len(seen.utc_s)} times where the axes pointed; it takes {FEWEST_SEEN}")
    sky = _PassSky(run, profile, seen)
    for _ in range(ORBIT_ROUNDS):
        residuals = sky.residuals()
        sky.correct(residuals.own_fit()[:STATES])
    return sky.residuals()


def _seen(recording: Recording, run: Trace) -> _Seen:
    """Return what came while the mount followed, in order of time."""
    steering, site = run.engine.tracker.steering, run.engine.spec.propagator.site
    earth = run.engine.spec.propagator.earth
    known_s, rows = run.utc_s[run.following], []
    for _, message in messages(recording):
        if not isinstance(message, SeenOffset | SolvedField | ObservationMessage):
            continue
        utc_s = float(Utc.parse(message.utc).unix_s) - steering.ahead_s(message.camera)
        at = int(np.searchsorted(known_s, utc_s))
        if not 0 < at < len(known_s) or known_s[at] - known_s[at - 1] > NEAR_S:
            continue
        if isinstance(message, SeenOffset):
            camera = steering.camera_of(message)
            in_arcsec = camera.in_arcsec(message)
            if in_arcsec is None or camera.kind == "coarse":
                continue
            dx, dy, sigma = in_arcsec
            rows.append((OFFSET, utc_s, *camera.on_axes(dx, dy), 0.0, 0.0, 0.0, sigma, False))
        else:
            field = isinstance(message, SolvedField)
            frame = "icrf" if isinstance(message, SolvedField) else FRAMES[message.frame]
            unit = apparent_unit(message.ra_deg, message.dec_deg, Utc(utc_s), frame, site, earth)
            kind, in_air = FIELD if field else PLACE, frame == "of_date"
            rows.append((kind, utc_s, 0.0, 0.0, *unit, message.sigma_arcsec, in_air))
    found = np.array(sorted(rows, key=lambda row: row[1])).reshape(-1, 9)
    sigma = np.hypot(found[:, 7], LEAST_SIGMA_ARCSEC)
    kinds = found[:, 0].astype(np.int8)
    return _Seen(kinds, found[:, 1], found[:, 2:4], found[:, 4:7], sigma, found[:, 8] > 0.0)


class _PassSky:
    """One pass' statuses and what was seen, about an orbit that is corrected step by step."""

    def __init__(self, run: Trace, profile: MountProfile, seen: _Seen) -> None:
        self._seen, self._profile, self._frame = seen, profile, profile.frame
        self._model = None if profile.pointing is None else PointingModel.of(profile.pointing)
        self._names = MOUNT_TERMS if self._model is None else tuple(self._model.terms)
        good = run.following
        self._utc_s, self._at = run.utc_s[good], seen.utc_s
        self._beyond = bool(np.median(run.beyond_pole[good]) > 0.5)
        self._bent: Propagator = run.engine.tracker.steering.biases.course.propagator
        self._airless = run.engine.tracker.steering.biases.course.airless
        longitude_deg = self._bent.site.longitude_deg
        mean = np.array([mean_sidereal_deg(one, longitude_deg) for one in self._utc_s])
        gap = np.unwrap(run.sidereal_h[good] * 15.0 - mean, period=360.0)
        self._gap_deg = float(np.median(gap))
        stands = self._reported(run.sidereal_h[good] * 15.0, run.ra_deg[good], run.dec_deg[good])
        self._stands = stands
        source = self._airless.elements
        self._orbit = None
        if isinstance(source, Elements):
            self._orbit = CorrectableOrbit(source, Utc(float(self._utc_s[0])))
        self._correction_km = np.zeros(STATES)

    def correct(self, by_sigmas: Array) -> None:
        """Correct the orbit, in the sigmas of what is expected of it."""
        if self._orbit is not None:
            self._correction_km = self._correction_km + self._spread() @ by_sigmas

    def _spread(self) -> Array:
        """Return a root of the covariance of what elements are off by, km."""
        assert self._orbit is not None
        covariance = self._orbit.expected(ORBIT_WIDER).covariance_km2
        root: Array = np.linalg.cholesky(covariance).astype(np.float64)
        return root

    def residuals(self) -> PassResiduals:
        """Return what is left, and the columns, about the orbit as it is corrected."""
        seen, at = self._seen, self._at
        airless = self._airless
        if self._orbit is not None:
            airless = airless.with_elements(self._orbit.corrected(self._correction_km))
        track = airless.at(Utc(self._utc_s)).unit
        wanted = self._wanted(track, self._utc_s)
        off = self._stands - wanted
        off[0] = np.unwrap(off[0], period=360.0) - 360.0 * np.round(np.median(off[0]) / 360.0)
        one_way = np.unwrap(wanted[0], period=360.0)
        rates = np.array([np.gradient(angle, self._utc_s) for angle in (one_way, wanted[1])])
        fed, unit = airless.at(Utc(at)), airless.at(Utc(at)).unit
        here = self._wanted(unit, at)
        reported = here + np.array([np.interp(at, self._utc_s, one) for one in off])
        rate = np.array([np.interp(at, self._utc_s, one) for one in rates])
        level = np.abs(np.cos(np.radians(reported[1])))
        scale = 3600.0 * np.array([level, np.ones_like(level)])
        directed = np.where((seen.kind == OFFSET)[:, None], unit, seen.unit)
        looked = self._wanted(directed, at, in_air=seen.in_air)
        sense = -1.0 if self._beyond and self._frame is None else 1.0
        offset = seen.offset.T * np.array([[1.0], [sense]])
        base = np.where(seen.kind == PLACE, here, reported)
        gap = looked - base
        gap[0] = wrap180(gap[0])
        own = [*self._of_orbit(fed, at, scale), *self._of_dates(rate * scale), *self._of_image(offset)]
        terms = self._of_terms(directed, at, scale)
        terms[:, :, seen.kind == PLACE] = 0.0
        first_s = float(self._utc_s[0])
        return PassResiduals(
            utc=Utc(first_s).isoformat("seconds"),
            left=(gap * scale - offset).T,
            sigma=seen.sigma,
            angles_deg=reported.T,
            on_sky=np.where((seen.kind == PLACE)[:, None], 0.0, scale.T / 3600.0),
            own=np.stack(own, axis=2),
            terms=terms.transpose(2, 1, 0),
            prior=self._prior(),
        )

    def _prior(self) -> Prior:
        """Return how far off the terms may be, one sigma, in the mean of all passes and at any one."""
        known = self._profile.pointing
        usual = {"TF": UNKNOWN_FLEXURE_ARCSEC}
        sigmas = [
            usual.get(name, UNKNOWN_ARCSEC) if known is None else known.terms[name][1] for name in self._names
        ]
        apart = [PASS_ARCSEC if name in PASS_TERMS else 0.0 for name in self._names]
        return Prior(self._names, np.array(sigmas), np.array(apart), known is not None)

    def _reported(self, sidereal_deg: Array, ra_deg: Array, dec_deg: Array) -> Array:
        """Return the axes' angles that are reported, shape (2, n), the first unwrapped."""
        first, second = sidereal_deg - ra_deg, dec_deg
        if self._frame is not None:
            found = self._frame.of_report(first, second, fn=np)
            if self._frame.geometry.reports == "axes":
                return np.array(found[:2])
            first, second = found.first_deg, found.second_deg
        elif self._beyond:
            first, second = self._past_pole(first, second)
        return np.array([np.unwrap(first, period=360.0), second])

    def _past_pole(self, first: Any, second: Any) -> tuple[Any, Any]:
        return past_pole(AxisStand(first, second), self._bent.site.latitude_deg >= 0.0)[:2]

    def _wanted(
        self,
        unit: Array,
        utc_s: Array,
        model: PointingModel | None = None,
        in_air: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Return the axes' angles for directions of date, (n, 3), by the pointing model; (2, n).

        They are airless but where `in_air`, (n,), has it.
        """
        site, earth = self._bent.site, self._bent.earth
        turn = earth.rotation(utc_s)
        (ux, uy, uz), (dx, dy, dz) = teme_axis(site.up, turn, ARRAYS)
        c, s = np.cos(turn[2]), np.sin(turn[2])
        up, up_rate = (c * ux - s * uy, s * ux + c * uy, uz), (c * dx - s * dy, s * dx + c * dy, dz)
        still = np.zeros_like(utc_s)
        q, q_rate = (unit[:, 0], unit[:, 1], unit[:, 2]), (still, still, still)
        if self._bent.refraction is not None:
            bent, _ = self._bent.refraction.refract(q, q_rate, up, up_rate)
            as_it_is = False if in_air is None else in_air
            x, y, z = (np.where(as_it_is, one, other) for one, other in zip(q, bent, strict=True))
            q = x, y, z
        model = self._model if model is None else model
        if model is not None:
            q, _ = model.on_side(self._beyond).applied(q, (still, still, still), up, up_rate)
        ra = np.degrees(np.arctan2(q[1], q[0]))
        dec = np.degrees(np.arctan2(q[2], np.hypot(q[0], q[1])))
        if self._frame is not None and self._frame.geometry.reports == "axes":
            sidereal = earth.local_apparent_sidereal_deg(Utc(utc_s), site)
        else:
            mean = np.array([mean_sidereal_deg(one, site.longitude_deg) for one in utc_s])
            sidereal = mean + self._gap_deg
        first, second = sidereal - ra, dec
        if self._frame is not None:
            found = self._frame.angles(first, second, fn=np)
            first, second = found.first_deg, found.second_deg
        elif self._beyond:
            first, second = self._past_pole(first, second)
        return np.array([first, second])

    def _moved(self, one: Array, other: Array, scale: Array) -> Array:
        """Return by how much wanted angles differ, on the sky."""
        apart = one - other
        apart[0] = wrap180(apart[0])
        moved: Array = (apart * scale).T
        return moved

    def _of_orbit(self, fed: object, at: Array, scale: Array) -> list[Array]:
        """Return by how much a sigma of each correction of the orbit moves what is left, (n, 2) each."""
        if self._orbit is None:
            return [np.zeros((len(at), 2))] * STATES
        partials, spread = Partials(self._orbit, self._correction_km), self._spread()
        unit, range_km = fed.unit, fed.range_km  # type: ignore[attr-defined]
        by_state = np.stack(
            [
                self._airless.of_date(Utc(float(t)), partials.states(Utc(float(t)))[:3]) @ spread / far
                for t, far in zip(at, range_km, strict=True)
            ]
        )
        by_state -= unit[:, :, None] * np.einsum("nk,nkj->nj", unit, by_state)[:, None, :]
        here, columns = self._wanted(unit, at), []
        # Seen in the image, a satellite that is farther on is left behind by the axes; among stars it is not.
        sign = np.select([self._seen.kind == OFFSET, self._seen.kind == PLACE], [-1.0, 1.0], 0.0)
        for k in range(STATES):
            size = np.maximum(np.linalg.norm(by_state[:, :, k], axis=1), 1e-15)
            there = unit + by_state[:, :, k] * (TURN_RAD / size)[:, None]
            moved = self._moved(self._wanted(there, at), here, scale) * (size / TURN_RAD)[:, None]
            columns.append(moved * sign[:, None])
        return columns

    def _of_dates(self, pace: Array) -> list[Array]:
        """Return what a sigma of the statuses' delay and one of the camera's clock do."""
        kind, moving = self._seen.kind, pace.T
        delay = moving * (kind != PLACE)[:, None]
        # A field is of where the mount was, the satellite among the stars of where that was.
        clock = moving * (kind != OFFSET)[:, None]
        return [DELAY_S * delay, CLOCK_S * clock]

    def _of_image(self, offset: Array) -> list[Array]:
        """Return what a sigma of the image's rotation and one of its scale do."""
        return [ROTATION_RAD * np.stack([-offset[1], offset[0]], axis=1), SCALE * offset.T]

    def _of_terms(self, unit: Array, at: Array, scale: Array) -> Array:
        """Return what a second of arc of each term of the mount takes off what is left, (terms, 2, n)."""
        if self._model is None:
            first, second = np.radians(self._wanted(unit, at))
            latitude = math.radians(
                self._bent.site.latitude_deg if self._frame is None else self._frame.horizon_latitude_deg
            )
            sin_p, cos_p = math.sin(latitude), math.cos(latitude)
            added = [FORMULAS[name](ARRAYS, first, second, sin_p, cos_p) for name in self._names]
            return -np.array(added) * scale / 3600.0
        here, columns = self._wanted(unit, at), []
        for name in self._names:
            values = {**self._model.terms, name: self._model.terms[name] + MODEL_STEP_ARCSEC}
            there = self._wanted(unit, at, replace(self._model, terms=values))
            columns.append(-self._moved(there, here, scale).T / MODEL_STEP_ARCSEC)
        return np.array(columns)

"""How a camera's image lies: what the mount's own motion does to it shows whether it is as set. Pure.

A first correction moves the mount by what the image says. In an image that lies as set the satellite goes to
the middle by it; in one that is turned it goes elsewhere, in a mirrored one to another side. Places in the
image are complex numbers here, right and i times up, rad. Where the elements predict that the satellite is
seen at z, it is seen at m = a z + (b + c t) v: a says how the image lies, b and c how far the elements are
off, along the way v in which the satellite moves and across it. A mirrored image has the conjugates of z and
v. Only what moves z faster than elements err says anything of a.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from sattrack.core.angles import wrap180
from tle.earth import ARCSEC

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.views.messages import SeenOffset

OTHER_SCALE, OTHER_ROTATION_DEG = 0.03, 5.0
"""An image lies otherwise where its scale differs by more than that share, or up by more than that angle."""
KEPT, FEWEST = 16, 7
"""So many frames are fitted, the last ones, and at least."""
MOVED_RAD = 40.0 * ARCSEC
"""The mount must have moved the image by that, beside what drifts."""
ASTRAY_RAD = 15.0 * ARCSEC
"""How far frames must lie from where an image that lies as set would have them, RMS."""
SURER = 2.5
"""So many times worse than the best the other way of lying must fit."""
FITS = 0.15
"""The best must explain all but that share of what was moved."""
STEADY_RAD = 20.0 * ARCSEC
"""One thing lies within so much of a line, RMS."""
LEAST_MOTION_RAD_S = 1.0 * ARCSEC
"""What moves less has no way."""
STEP_S = 0.2
CLOCK_OFF_S, CLOCK_SIGMA_S = 0.15, 0.015
"""Dates are mended that are off by more, and known that well. Less than that filters allow for."""
SURE_SIGMAS = 3.0
"""A scale that is off by less than that is as set."""


class Camera(NamedTuple):
    """How a camera's image lies on the sky: the position angle of its y axis, and whether it is mirrored.

    On a mount whose field rotates the angle is that from the tube's own up, where growing second angles lead.
    Not mirrored, north up has east to the left. A coarse camera finds what a fine one is centred on.
    """

    rotation_deg: float = 0.0
    flip: bool = False
    scale_arcsec_px: float | None = None
    kind: Literal["coarse", "fine"] = "fine"
    fov_deg: float | None = None
    stretch: float = 1.0
    """Arcseconds that a camera says count so many times."""

    def otherwise(self, shown: Camera) -> str | None:
        """Return how an image is shown to lie otherwise than this, in words; None where it hardly does."""
        words = []
        was, scale = self.scale_arcsec_px, shown.scale_arcsec_px
        if was is not None and scale is not None and abs(scale / was - 1.0) > OTHER_SCALE:
            words.append(f"{scale:.3g}″ a pixel, not {was:.3g}″")
        elif abs(shown.stretch / self.stretch - 1.0) > OTHER_SCALE:
            words.append(f"pixels {shown.stretch:.3g} times as large as set")
        if self.flip != shown.flip:
            words.append("a mirrored image" if shown.flip else "an image that is not mirrored")
        if abs(wrap180(shown.rotation_deg - self.rotation_deg)) > OTHER_ROTATION_DEG:
            words.append(f"up at {shown.rotation_deg % 360.0:.0f}°, not {self.rotation_deg % 360.0:.0f}°")
        return ", ".join(words) or None

    def in_arcsec(self, seen: SeenOffset) -> tuple[float, float, float] | None:
        """Return an offset and its sigma in arcseconds; None where it is in pixels of unknown size."""
        scale = self.stretch if seen.dx_px is None else self.scale_arcsec_px
        if scale is None:
            return None
        values = (
            (seen.dx_arcsec, seen.dy_arcsec, seen.sigma_arcsec)
            if seen.dx_px is None
            else (seen.dx_px, seen.dy_px, seen.sigma_px)
        )
        dx, dy, sigma = (scale * (one or 0.0) for one in values)
        return dx, dy, sigma

    def on_axes(self, dx: float, dy: float) -> tuple[float, float]:
        """Return a place in the image, right and up, towards growing hour angle and declination.

        On a mount whose field rotates: towards growing angles of its axes.
        """
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        right = -dx if self.flip else dx
        return right * c - dy * s, right * s + dy * c


UPRIGHT = Camera()


class Cameras(NamedTuple):
    """The cameras of a run by their names, any other, and whether and in which field a lost target is sought.

    `field_deg` is a diameter, None where it is not known.
    """

    other: Camera = UPRIGHT
    named: Mapping[str, Camera] = MappingProxyType({})
    field_deg: float | None = None
    search_when_lost: bool = False


NO_CAMERAS = Cameras()


class Deviation(NamedTuple):
    """How an image lies otherwise than it was set.

    It is turned by so much, in position angle, its pixels are so many times as large, it is mirrored, and its
    dates are ahead.
    """

    turned_deg: float = 0.0
    scale: float = 1.0
    mirrored: bool = False
    clock_s: float = 0.0

    def applied_to(self, camera: Camera) -> Camera:
        """Return how the image of a camera lies that was set like this one."""
        scale = camera.scale_arcsec_px
        return camera._replace(
            rotation_deg=camera.rotation_deg + self.turned_deg,
            flip=camera.flip != self.mirrored,
            scale_arcsec_px=None if scale is None else scale * self.scale,
            stretch=camera.stretch * self.scale,
        )

    def and_then(self, more: Deviation) -> Deviation:
        """Return both together, this one first."""
        return Deviation(
            wrap180(self.turned_deg + more.turned_deg),
            self.scale * more.scale,
            self.mirrored != more.mirrored,
            self.clock_s + more.clock_s,
        )


AS_SET = Deviation()


class _Frame(NamedTuple):
    utc_s: float
    predicted: complex
    rate: complex
    """A wrong clock adds so much, up to a factor, and `bend` by the factor's square."""
    bend: complex
    seen: complex
    motion: complex


class _Fitted(NamedTuple):
    """One way of lying: the factor, its sigma, and what frames are off by, RMS."""

    factor: complex
    sigma: float
    rms: float
    mirrored: bool


class ImageFit:
    """The last frames of one camera, and how its image lies by them."""

    def __init__(self) -> None:
        self._frames: deque[_Frame] = deque(maxlen=KEPT)

    def see(self, utc_s: float, predicted: Sequence[complex], seen: complex, motion: complex = 0j) -> None:
        """Take a frame in: where elements have the satellite, STEP_S before, then and after; where it is.

        `motion` is how it moves, rad/s: along that elements are off, and across it.
        """
        before, then, after = predicted
        rate, bend = (after - before) / (2.0 * STEP_S), (after - 2.0 * then + before) / STEP_S**2
        off = motion if abs(motion) > LEAST_MOTION_RAD_S else 1.0 + 0j
        self._frames.append(_Frame(utc_s, then, rate, bend, seen, off))

    @property
    def is_steady(self) -> bool:
        """Whether the frames show one thing that hardly moves: what is followed, however the image lies."""
        if len(self._frames) < FEWEST:
            return False
        return _rms(_left(self._columns(False)[:, 2:4], self._seen), 2) < STEADY_RAD

    def deviation(self, flip: bool, believed: Deviation) -> Deviation | None:
        """Return how the image lies otherwise than set; None where that is unknown, or as `believed`.

        `flip` tells whether it is set as mirrored.
        """
        if len(self._frames) < FEWEST:
            return None
        expected, seen = self._columns(believed.mirrored), self._seen
        moved = _left(expected[:, 1:4], expected[:, 0])
        if np.abs(moved).max() < MOVED_RAD:
            return None
        off = _rms(_left(expected[:, 1:], seen - _factor(believed, flip) * expected[:, 0]), 4)
        best, other = self._either_way()
        if off < max(ASTRAY_RAD, SURER * best.rms) or best.rms > FITS * abs(best.factor) * _rms(moved, 0):
            return None
        # Along one line either way explains all: then it is the one that was set.
        if other.mirrored == believed.mirrored and other.rms < SURER * best.rms:
            best = other
        return _deviation_by(best, flip)

    def clock_s(self, flip: bool, believed: Deviation) -> float | None:
        """Return by how much dates are ahead of the mount's motion; None where that is not much, or unsure.

        A mount that is late by so much looks the same.
        """
        if len(self._frames) < FEWEST:
            return None
        columns, factor = self._columns(believed.mirrored), _factor(believed, flip)
        moved = _left(columns[:, 2:], columns[:, 1])
        if np.abs(moved).max() < MOVED_RAD:
            return None
        found = _fitted(columns[:, 1:], self._seen - factor * columns[:, 0], moved, believed.mirrored)
        ahead_s, sigma_s = -(found.factor / factor).real, found.sigma / abs(factor)
        if abs(ahead_s) < CLOCK_OFF_S or sigma_s > CLOCK_SIGMA_S:
            return None
        # Where the image lies otherwise, a clock explains as little of this.
        lies = _rms(_left(columns[:, 1:], columns[:, 0]), 4)
        return ahead_s if found.rms < FITS * abs(factor) * lies else None

    def _either_way(self) -> list[_Fitted]:
        """Return the fits of images that are not mirrored and that are, the better one first."""
        fits = []
        for mirrored in (False, True):
            columns = self._columns(mirrored)[:, :4]
            fits.append(_fitted(columns, self._seen, _left(columns[:, 1:], columns[:, 0]), mirrored))
        return sorted(fits, key=lambda one: one.rms)

    def _columns(self, mirrored: bool) -> NDArray[np.complex128]:
        """Return the predicted places, what a clock adds to them, what drifts, and a clock's square."""
        utc_s, predicted, rate, bend, _, off = (np.array(one) for one in zip(*self._frames, strict=True))
        drift = off, off * (utc_s - utc_s.mean())
        columns = np.stack([predicted, rate, *drift, bend], axis=1)
        return np.conj(columns) if mirrored else columns

    @property
    def _seen(self) -> NDArray[np.complex128]:
        return np.array([one.seen for one in self._frames])


def _left(columns: NDArray[np.complex128], places: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return what is left of places beside what columns explain."""
    left: NDArray[np.complex128] = places - columns @ np.linalg.lstsq(columns, places, rcond=None)[0]
    return left


def _fitted(
    columns: NDArray[np.complex128],
    seen: NDArray[np.complex128],
    moved: NDArray[np.complex128],
    mirrored: bool,
) -> _Fitted:
    """Return the factor of the first column by least squares."""
    found = np.linalg.lstsq(columns, seen, rcond=None)[0]
    rms = _rms(seen - columns @ found, columns.shape[1])
    return _Fitted(complex(found[0]), rms / float(np.linalg.norm(moved)), rms, mirrored)


def _rms(places: NDArray[np.complex128], fitted: int) -> float:
    """Return the RMS of what is left by so many terms."""
    return float(np.linalg.norm(places)) / math.sqrt(len(places) - fitted)


def _sense(flip: bool, mirrored: bool) -> int:
    """Return which way a place in an image goes as its rotation grows."""
    return 1 if flip != mirrored else -1


def _factor(known: Deviation, flip: bool) -> complex:
    """Return what places predicted for an image as set, or their conjugates, are multiplied by."""
    turned = cmath.exp(1j * _sense(flip, known.mirrored) * math.radians(known.turned_deg)) / known.scale
    return -turned if known.mirrored else turned


def _deviation_by(found: _Fitted, flip: bool) -> Deviation:
    """Return how an image lies by what was fitted."""
    factor = -found.factor if found.mirrored else found.factor
    angle, size = cmath.phase(factor) * _sense(flip, found.mirrored), abs(factor)
    as_set = abs(size - 1.0) < SURE_SIGMAS * found.sigma
    return Deviation(math.degrees(angle), 1.0 if as_set else 1.0 / size, found.mirrored)

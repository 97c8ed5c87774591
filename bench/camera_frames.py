"""Frames by closed forms: Gaussians integrated over pixels, streaks as sums of them, and noise.

A star's image is a two-dimensional Gaussian; what a pixel gets of it is a product of differences of error
functions. A streak is that Gaussian swept evenly from one end to the other (Gauss-Legendre quadrature).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy.special import erf


@cache
def _quadrature(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(count)


@dataclass
class Canvas:
    """An image in the making: electrons above the sky, y up."""

    width: int = 1280
    height: int = 960
    psf_px: float = 1.3
    sky: float = 400.0
    read_noise: float = 5.0
    electrons: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.electrons = np.zeros((self.height, self.width))

    @property
    def noise(self) -> float:
        """One sigma of an empty pixel."""
        return math.sqrt(self.sky + self.read_noise**2)

    def flux_of(self, snr: float) -> float:
        """Return the flux of a point with this signal over noise in a filter that matches it."""
        return snr * 2.0 * math.sqrt(math.pi) * self.psf_px * self.noise

    def point(self, x: float, y: float, flux: float) -> None:
        self._add(np.array([x]), np.array([y]), np.array([flux]))

    def streak(self, x: float, y: float, length: float, angle_deg: float, flux_per_px: float) -> None:
        """Add a streak by its middle, with a flux for each pixel of its length."""
        nodes, weights = _quadrature(max(8, int(2.0 * length / self.psf_px)))
        along = nodes * length / 2.0
        angle = math.radians(angle_deg)
        self._add(
            x + along * math.cos(angle), y + along * math.sin(angle), weights / 2.0 * length * flux_per_px
        )

    def _add(self, x: np.ndarray, y: np.ndarray, flux: np.ndarray) -> None:
        reach = 6.0 * self.psf_px
        left, right = max(0, int(x.min() - reach)), min(self.width, int(x.max() + reach) + 1)
        low, high = max(0, int(y.min() - reach)), min(self.height, int(y.max() + reach) + 1)
        if left >= right or low >= high:
            return
        across = self._shares(np.arange(left, right + 1) - 0.5, x)
        up = self._shares(np.arange(low, high + 1) - 0.5, y)
        self.electrons[low:high, left:right] += (up * flux) @ across.T

    def _shares(self, edges: np.ndarray, centres: np.ndarray) -> np.ndarray:
        at = (edges[:, None] - centres[None, :]) / (self.psf_px * math.sqrt(2.0))
        return np.diff(0.5 * erf(at), axis=0)

    def exposed(self, rng: np.random.Generator, bias: float = 500.0, gain: float = 1.0) -> np.ndarray:
        """Return what the camera reads: photons by Poisson, noise of reading, whole numbers of 16 bits."""
        mean = self.electrons + self.sky
        # Above a few tens of electrons, Poisson's numbers are normal; that is much faster.
        read = mean + rng.standard_normal(mean.shape, dtype=np.float32) * np.sqrt(mean + self.read_noise**2)
        return np.clip(np.rint(read / gain + bias), 0, 65535).astype(np.uint16)


def star_streaks(
    canvas: Canvas, rng: np.random.Generator, count: int, length: float, angle_deg: float
) -> None:
    """Add streaks of stars, whose numbers grow with faintness as in the sky (10^0.4 a magnitude)."""
    faintest = 1.5 * canvas.noise
    for _ in range(count):
        bright = faintest * 10.0 ** (0.4 * min(rng.exponential(1.0 / (0.4 * math.log(10.0))), 8.0))
        canvas.streak(rng.uniform(0, canvas.width), rng.uniform(0, canvas.height), length, angle_deg, bright)

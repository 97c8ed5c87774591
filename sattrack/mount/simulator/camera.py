"""A camera on a simulated mount: what it sees of the true sky, in figures and pictures. Time is an argument.

The image is the gnomonic projection of the sky about where the true axes point. x is to the right and y up,
as the image is displayed; without a mirror and with +y to the north, east is on the left. Rows count from
the top, columns from the left, and whole numbers are the centres of pixels. Instants are UTC as POSIX
seconds, true ones unless they are said to be the camera's.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field
from functools import lru_cache
from statistics import NormalDist
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from sattrack.core.errors import BadInputError, how_to_install
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.simulator.hidden import cloud_windows, waves
from sattrack.mount.simulator.night_sky import NightSky, Stars, catalogue, faint_stars
from tle.instants import Utc
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from sattrack.mount.simulator.hidden import Hidden, SimulatedCamera
    from sattrack.mount.simulator.mount import Truth
    from tle.elements import Elements
    from tle.site import Site

    Array = NDArray[np.float64]

ARCSEC = math.pi / 648000.0
ARCMIN = 60.0 * ARCSEC
FWHM_SIGMAS = 2.0 * math.sqrt(2.0 * math.log(2.0))
KEPT_S = 300.0
"""For so long the path of the axes is kept, at least."""
NODE_S = 0.01
"""The axes' path within an exposure is taken at instants so far apart."""
MOST_NODES = 200
MOST_STEPS = 6000
SIGMAS = 5.0
"""A point's light is drawn so far from its centre."""
PIECE_PX = 48.0
"""Streaks are drawn in pieces of this length."""
MOST_ADU = 65535
GAIN_UNITS = 200.0
"""Units of gain in a factor of ten: a unit is 0.1 dB."""
MOST_GAIN = 400
PIXEL_UM = 3.75
SENSOR = "Simulated sky"
PLANE_S = 4.0
"""A plane takes so long from the left edge to the right one."""
PLANE_MAGNITUDE = 3.0
STAR_MARGIN_PX = 40.0


def make_sky(site: Site, satellites: Sequence[Elements], hidden: Hidden, seed: int) -> NightSky:
    """Return the sky over a site by what is hidden. Raises BadInputError where no stars are installed."""
    stars = catalogue()
    if hidden.faint:
        faint = faint_stars(hidden.faint, seed)
        stars = Stars(*(np.concatenate(both) for both in zip(stars, faint, strict=True)))
    air = Refraction.standard(site.height_m)
    pressure = air.pressure_hpa if hidden.pressure is None else hidden.pressure
    temperature = air.temperature_c if hidden.temperature is None else hidden.temperature
    return NightSky(site, satellites, stars, Refraction(pressure, temperature))


class TruePath:
    """Where the true axes were over time, degrees: at the instants noted, and by a cubic between them."""

    def __init__(self, keep_s: float = KEPT_S) -> None:
        self._keep_s = keep_s
        self._utc_s: list[float] = []
        self._rows: list[tuple[float, float, float, float]] = []

    @property
    def until_s(self) -> float:
        """The last instant noted."""
        return self._utc_s[-1] if self._utc_s else -math.inf

    def note(self, truth: Truth) -> None:
        """Take where a simulated mount's axes are."""
        dec_rate = -truth.dec_rate_deg_s if truth.beyond_pole else truth.dec_rate_deg_s
        ha_rate = SIDEREAL_RATE_DEG_S - truth.ra_rate_deg_s
        self.add(truth.utc_s, truth.hour_angle_axis_deg, truth.dec_axis_deg, ha_rate, dec_rate)

    def add(
        self, utc_s: float, first_deg: float, second_deg: float, first_deg_s: float, second_deg_s: float
    ) -> None:
        """Take both axes' angles and rates at an instant; one that is not later than the last is left out."""
        if utc_s <= self.until_s:
            return
        self._utc_s.append(utc_s)
        self._rows.append((first_deg, second_deg, first_deg_s, second_deg_s))
        if self._utc_s[0] < utc_s - 2.0 * self._keep_s:
            old = bisect_left(self._utc_s, utc_s - self._keep_s)
            del self._utc_s[:old], self._rows[:old]

    def part(self, from_s: float, to_s: float) -> TruePath:
        """Return a copy of the path about a span of time."""
        first = max(0, bisect_left(self._utc_s, from_s) - 1)
        last = bisect_left(self._utc_s, to_s) + 1
        copy = TruePath()
        copy._utc_s, copy._rows = self._utc_s[first:last], self._rows[first:last]
        return copy

    def at(self, utc_s: Array) -> tuple[Array, Array]:
        """Return both axes' angles at instants; before the first and after the last by the rates there.

        Raises ValueError where none was noted.
        """
        if not self._utc_s:
            raise ValueError("where the axes are is not known yet")
        first = max(0, bisect_left(self._utc_s, float(utc_s.min())) - 1)
        last = bisect_left(self._utc_s, float(utc_s.max())) + 1
        known_s, rows = np.array(self._utc_s[first:last]), np.array(self._rows[first:last])
        right = np.clip(np.searchsorted(known_s, utc_s), 1, max(1, len(known_s) - 1))
        left = right - 1
        right = np.minimum(right, len(known_s) - 1)
        span = np.maximum(known_s[right] - known_s[left], 1e-9)
        since = utc_s - known_s[left]
        inside = np.clip(since, 0.0, known_s[right] - known_s[left])
        past = since - inside
        t = inside / span
        angles = []
        for axis in (0, 1):
            p0, p1 = rows[left, axis], rows[right, axis]
            v0, v1 = rows[left, axis + 2] * span, rows[right, axis + 2] * span
            cubic = p0 + t * (v0 + t * (3.0 * (p1 - p0) - 2.0 * v0 - v1 + t * (2.0 * (p0 - p1) + v0 + v1)))
            angles.append(cubic + past * np.where(past < 0.0, rows[left, axis + 2], rows[right, axis + 2]))
        return angles[0], angles[1]


class TrueOffset(NamedTuple):
    """A satellite in an exposure, without rendering.

    `utc_s` is mid-exposure by the camera's clock, `true_utc_s` in truth. The offset from the image's centre
    is the mean over the exposure, in arcseconds by the scale that users see. `electrons` are those of
    the whole exposure, 0 in the shadow, behind clouds and below the horizon.
    """

    utc_s: float
    true_utc_s: float
    dx_arcsec: float
    dy_arcsec: float
    column: float
    row: float
    electrons: float
    inside: bool


class RenderedFrame(NamedTuple):
    """A picture: rows from the top, 16 bits. `utc_s` is its start by the camera's clock."""

    pixels: NDArray[np.uint16]
    utc_s: float
    exposure_s: float
    gain: int


@dataclass(slots=True)
class _Exposure:
    """Instants within an exposure, what looks where then, and how clear the air is: all of length n."""

    utc_s: Array
    x: Array
    """Unit vectors of the image's x, y and of the line of sight, (n, 3), east, north, up."""
    y: Array
    sight: Array
    clear: Array
    shift_px: tuple[float, float]


@dataclass(slots=True)
class SkyCamera:
    """One camera on a mount under a sky; hidden drifts and clouds count from `begin_utc_s`.

    `hour_angle_zero_deg` is added to the hour angles of the axes: what a sync at the start took away
    (`NightSky.hour_angle_zero_deg`). The axes of `alignment` "altaz" are azimuth and altitude.
    """

    sky: NightSky
    settings: SimulatedCamera
    hidden: Hidden
    begin_utc_s: float
    seed: int = 0
    hour_angle_zero_deg: float = 0.0
    alignment: Literal["equatorial", "altaz"] = "equatorial"
    _mount: Array = field(init=False)
    _windows: list[tuple[float, float]] = field(init=False)
    _waves: Array = field(init=False)
    _hot: tuple[NDArray[np.intp], Array] = field(init=False)

    def __post_init__(self) -> None:
        """Set up the mount, draw the clouds and the hot pixels."""
        self._mount = _mount_axes(self.hidden, *self.sky.pole(self.begin_utc_s), self.alignment)
        self._windows = cloud_windows(self.hidden.clouds)
        rng = np.random.default_rng([self.seed, 1])
        # Waves of 15 to 90 seconds, whose sum is normal, about.
        self._waves = np.stack([2.0 * math.pi / rng.uniform(15.0, 90.0, 12), rng.uniform(0.0, 6.3, 12)])
        count = self.settings.width * self.settings.height
        spots = rng.choice(count, min(self.hidden.hot, count), replace=False)
        self._hot = spots, 10.0 ** rng.uniform(2.0, 4.5, len(spots))

    def clearness(self, utc_s: Array) -> Array:
        """Return the share of light that clouds let through at instants, 0 to 1."""
        since = utc_s - self.begin_utc_s
        clear = np.ones_like(since)
        share = self.hidden.cloudiness
        if share > 0.0:
            angles = since[:, None] * self._waves[0] + self._waves[1]
            # Normal with sigma 1; what exceeds the level of the share is cloud, up to magnitudes deep.
            depth = np.sin(angles).sum(axis=1) / math.sqrt(6.0) - _normal_level(share)
            clear *= 10.0 ** (-0.4 * 4.0 * np.maximum(0.0, depth))
        for low, high in self._windows:
            clear[(since >= low) & (since < high)] = 0.0
        return clear

    def seen(self, start_utc_s: float, exposure_s: float, path: TruePath, index: int = 0) -> TrueOffset:
        """Return where a satellite is seen in an exposure; raises ValueError where the axes are not known."""
        exposure = self._exposure(start_utc_s, exposure_s, path)
        columns, rows, electrons_s = self._satellite(index, exposure)
        column, row = float(columns.mean()), float(rows.mean())
        width, height, scale = self.settings.width, self.settings.height, self.settings.scale_arcsec_px
        middle = start_utc_s + 0.5 * exposure_s
        return TrueOffset(
            middle + self.hidden.clock,
            middle,
            (column - 0.5 * (width - 1)) * scale,
            (0.5 * (height - 1) - row) * scale,
            column,
            row,
            float(electrons_s.mean()) * exposure_s,
            -0.5 <= column <= width - 0.5 and -0.5 <= row <= height - 0.5,
        )

    def stars(self, start_utc_s: float, exposure_s: float, path: TruePath) -> tuple[Array, Array, Array]:
        """Return the stars' columns and rows over an exposure, (n, stars) each, and their electrons."""
        columns, rows, electrons_s = self._stars(self._exposure(start_utc_s, exposure_s, path))
        return columns, rows, electrons_s.mean(axis=0) * exposure_s

    def frame(self, start_utc_s: float, exposure_s: float, path: TruePath, gain: int = 0) -> RenderedFrame:
        """Return the picture of an exposure; the same arguments give the same one."""
        exposure = self._exposure(start_utc_s, exposure_s, path)
        settings, hidden = self.settings, self.hidden
        light = np.zeros((settings.height, settings.width), dtype=np.float32)
        sigma_px = hidden.fwhm / FWHM_SIGMAS / self._scale_arcsec_px
        tracks = [self._satellite(index, exposure) for index in range(len(self.sky.satellites))]
        columns, rows, electrons_s = self._stars(exposure)
        tracks += [(columns[:, k], rows[:, k], electrons_s[:, k]) for k in range(columns.shape[1])]
        if hidden.plane is not None:
            tracks.append(self._plane(exposure.utc_s - self.begin_utc_s - hidden.plane))
        for column, row, rate in tracks:
            if rate.any():
                _draw(light, column, row, rate * exposure_s, sigma_px)
        rng = np.random.Generator(np.random.SFC64([self.seed, 2, round(start_utc_s * 1e3)]))
        sky = 10.0 ** (-0.4 * (hidden.sky - hidden.zero_point)) * self._scale_arcsec_px**2 * exposure_s
        pixels = self._digital(light, sky, exposure_s, gain, rng)
        return RenderedFrame(pixels, start_utc_s + hidden.clock, exposure_s, gain)

    def electrons_per_adu(self, gain: int) -> float:
        """Return the electrons in a step of the converter; a unit of gain is 0.1 dB."""
        return self.hidden.full_well / (MOST_ADU - self.hidden.bias) * float(10.0 ** (-gain / GAIN_UNITS))

    def write(self, frame: RenderedFrame, path: Path) -> None:
        """Write a picture as FITS, first row at the bottom. Raises OSError, BadInputError without astropy."""
        try:
            from astropy.io import fits
        except ImportError:
            raise BadInputError(f"FITS files need astropy: {how_to_install('camera-sim')}") from None
        image = fits.PrimaryHDU(np.ascontiguousarray(frame.pixels[::-1]))
        site = self.sky.site
        for name, value, comment in (
            ("DATE-OBS", Utc(frame.utc_s).isoformat().removesuffix("Z"), "start of the exposure, UTC"),
            ("EXPTIME", frame.exposure_s, "[s]"),
            ("GAIN", frame.gain, "[0.1 dB]"),
            ("EGAIN", self.electrons_per_adu(frame.gain), "[electron/adu]"),
            ("XPIXSZ", PIXEL_UM, "[um]"),
            ("YPIXSZ", PIXEL_UM, "[um]"),
            ("XBINNING", 1, None),
            ("YBINNING", 1, None),
            ("FOCALLEN", round(self.focal_length_mm, 3), "[mm]"),
            ("INSTRUME", SENSOR, None),
            ("IMAGETYP", "Light Frame", None),
            ("ROWORDER", "BOTTOM-UP", None),
            ("SITELAT", site.latitude_deg, "[deg] north"),
            ("SITELONG", site.longitude_deg, "[deg] east"),
        ):
            image.header[name] = (value, comment)
        part = path.with_name(f".{path.name}.part")
        image.writeto(part, overwrite=True)
        part.replace(path)

    @property
    def focal_length_mm(self) -> float:
        """The focal length that goes with the scale that users see."""
        return PIXEL_UM * 1e-3 / (self.settings.scale_arcsec_px * ARCSEC)

    @property
    def _scale_arcsec_px(self) -> float:
        return self.settings.scale_arcsec_px * self.hidden.scale

    def _exposure(self, start_utc_s: float, exposure_s: float, path: TruePath) -> _Exposure:
        """Return n instants, the middles of n equal parts of the exposure."""
        count = min(MOST_NODES, max(5, math.ceil(exposure_s / NODE_S)) | 1)
        utc_s = np.linspace(start_utc_s, start_utc_s + exposure_s, 2 * count + 1)[1::2]
        x, y, sight = self._look(*path.at(utc_s))
        jitter_px = self.hidden.jitter / self._scale_arcsec_px
        rng = np.random.default_rng([self.seed, 3, round(start_utc_s * 1e3)])
        right, down = rng.standard_normal(2) * jitter_px
        return _Exposure(utc_s, x, y, sight, self.clearness(utc_s), (float(right), float(down)))

    def _look(self, first_deg: Array, second_deg: Array) -> tuple[Array, Array, Array]:
        """Return the image's x and y and the line of sight of axes, as unit vectors (n, 3), ENU."""
        hidden = self.hidden
        first = np.radians(first_deg + self.hour_angle_zero_deg) + hidden.ha * ARCSEC
        second = np.radians(second_deg) + hidden.dec * ARCSEC
        # What repeats in a turn is the gear's and the encoder's: it goes by their own angles.
        first = first + _waved(hidden.ha_wave, first_deg)
        second = second + _waved(hidden.dec_wave, second_deg)
        cos_1, sin_1, cos_2, sin_2 = (
            wave(angle)[:, None] for angle in (first, second) for wave in (np.cos, np.sin)
        )
        meridian, side, pole = self._mount
        outward = cos_1 * meridian + sin_1 * side
        right = cos_1 * side - sin_1 * meridian
        # The declination axis leans: the plane in which it turns the telescope leans with it.
        cos_l, sin_l = math.cos(hidden.leaning * ARCSEC), math.sin(hidden.leaning * ARCSEC)
        upright = cos_l * pole - sin_l * right
        right = cos_l * right + sin_l * pole
        sight = cos_2 * outward + sin_2 * upright
        north = cos_2 * upright - sin_2 * outward
        cos_c, sin_c = math.cos(hidden.cone * ARCSEC), math.sin(hidden.cone * ARCSEC)
        sight, right = cos_c * sight + sin_c * right, cos_c * right - sin_c * sight
        if hidden.flexure:
            sunk = sight - hidden.flexure * ARCSEC * np.array([0.0, 0.0, 1.0])
            sight = sunk / np.linalg.norm(sunk, axis=1, keepdims=True)
            right = right - np.sum(right * sight, axis=1, keepdims=True) * sight
            north = north - np.sum(north * sight, axis=1, keepdims=True) * sight
        turn = math.radians(hidden.rotation)
        y = math.cos(turn) * north - math.sin(turn) * right
        x = math.cos(turn) * right + math.sin(turn) * north
        return (-x if hidden.mirror else x), y, sight

    def _project(self, exposure: _Exposure, directions: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return columns and rows of directions, (n, 3) or (n, m, 3), and which lie before the camera."""
        many = directions if directions.ndim == 3 else directions[:, None, :]
        depth, x, y = (
            np.einsum("nk,nmk->nm", axis, many) for axis in (exposure.sight, exposure.x, exposure.y)
        )
        before = depth > 0.1
        depth = np.where(before, depth, 1.0)
        scale = self._scale_arcsec_px * ARCSEC
        columns = 0.5 * (self.settings.width - 1) + x / depth / scale + exposure.shift_px[0]
        rows = 0.5 * (self.settings.height - 1) - y / depth / scale + exposure.shift_px[1]
        shape = directions.shape[:-1]
        return columns.reshape(shape), rows.reshape(shape), before.reshape(shape)

    def _satellite(self, index: int, exposure: _Exposure) -> tuple[Array, Array, Array]:
        """Return columns, rows and electrons a second, of length n."""
        hidden, utc_s = self.hidden, exposure.utc_s
        minutes = (utc_s - self.begin_utc_s) / 60.0
        along_s, cross_rad = np.zeros_like(minutes), np.zeros_like(minutes)
        if index == 0:
            along_s = hidden.along + minutes * (hidden.along_drift + minutes * hidden.along_curve)
            cross_rad = (hidden.cross + minutes * hidden.cross_drift) * ARCSEC
        place = self.sky.satellite(index, utc_s, along_s, cross_rad)
        columns, rows, before = self._project(exposure, place.directions)
        bright = 10.0 ** (-0.4 * (hidden.magnitude - hidden.zero_point))
        up = before & (place.directions[:, 2] > 0.0)
        lit = place.lit if hidden.shadow else 1.0
        return columns, rows, np.where(up, bright * lit * exposure.clear, 0.0)

    def _stars(self, exposure: _Exposure) -> tuple[Array, Array, Array]:
        """Return columns, rows and electrons a second, each (n, stars)."""
        middle = len(exposure.utc_s) // 2
        centre = exposure.sight[middle]
        swept = np.arccos(np.clip(exposure.sight @ centre, -1.0, 1.0)).max()
        corner_px = 0.5 * math.hypot(self.settings.width, self.settings.height) + STAR_MARGIN_PX
        radius = math.atan(corner_px * self._scale_arcsec_px * ARCSEC) + float(swept)
        near = self.sky.near(centre, radius, float(exposure.utc_s[middle]))
        directions = self.sky.directions(near, exposure.utc_s)
        columns, rows, before = self._project(exposure, directions)
        up = before & (directions[..., 2] > 0.0)
        bright = 10.0 ** (-0.4 * (near.magnitudes - self.hidden.zero_point))
        return columns, rows, np.where(up, bright * exposure.clear[:, None], 0.0)

    def _plane(self, since_s: Array) -> tuple[Array, Array, Array]:
        """Return columns, rows and electrons a second of a plane, so long after it is in the middle."""
        width, height = self.settings.width, self.settings.height
        along = since_s / PLANE_S
        bright = 10.0 ** (-0.4 * (PLANE_MAGNITUDE - self.hidden.zero_point))
        blinking = np.where(np.mod(since_s, 1.0) < 0.5, bright, 0.0)
        return (0.5 + along) * (width - 1), (0.5 - 0.5 * along) * (height - 1), blinking

    def _digital(
        self, light: NDArray[np.float32], sky: float, exposure_s: float, gain: int, rng: np.random.Generator
    ) -> NDArray[np.uint16]:
        """Return what the sensor makes of electrons: `light` a pixel, and `sky` on each."""
        hidden = self.hidden
        flat = light.ravel()
        spots, dark_s = self._hot
        flat[spots] += (dark_s * exposure_s).astype(np.float32)
        counted = rng.poisson(sky, flat.size).astype(np.float32)
        lit = np.flatnonzero(flat > 0.0)
        # A sum of independent Poisson numbers is one: the sky's and the light's may be drawn apart.
        counted[lit] += rng.poisson(flat[lit])
        np.minimum(counted, hidden.full_well, out=counted)
        counted += rng.standard_normal(flat.size, dtype=np.float32) * np.float32(hidden.read_noise)
        counted /= np.float32(self.electrons_per_adu(gain))
        counted += np.float32(hidden.bias + 0.5)
        return np.clip(counted, 0.0, MOST_ADU).astype(np.uint16).reshape(light.shape)


def _mount_axes(hidden: Hidden, altitude: float, azimuth: float, alignment: str) -> Array:
    """Return the mount's own meridian, side and pole as rows, east, north, up; the true pole is given.

    An axis that turns by a positive angle goes from the meridian to the side: hour angles westward,
    azimuths eastward. A misaligned pole is the elevated one; that of "altaz", the zenith, is tilted northward
    by `polar_alt`, then eastward by `polar_az`.
    """
    if alignment == "altaz":
        (cos_n, sin_n), (cos_e, sin_e) = (
            (math.cos(angle * ARCMIN), math.sin(angle * ARCMIN))
            for angle in (hidden.polar_alt, hidden.polar_az)
        )
        north, raised = np.array([0.0, cos_n, -sin_n]), np.array([0.0, sin_n, cos_n])
        aside = np.array([1.0, 0.0, 0.0])
        return np.array([north, cos_e * aside - sin_e * raised, cos_e * raised + sin_e * aside])
    sense = math.copysign(1.0, altitude)
    tilted = altitude + sense * hidden.polar_alt * ARCMIN
    east = azimuth + sense * hidden.polar_az * ARCMIN
    cos_t, sin_t, cos_e, sin_e = math.cos(tilted), math.sin(tilted), math.cos(east), math.sin(east)
    frame = np.array([[0.0, -sin_t, cos_t], [-1.0, 0.0, 0.0], [0.0, cos_t, sin_t]])
    turn = np.array([[cos_e, sin_e, 0.0], [-sin_e, cos_e, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(frame @ turn.T)


def _waved(text: str, angle_deg: Array) -> Array:
    """Return by how much an axis points past its angle, rad."""
    total = np.zeros_like(angle_deg)
    for arcsec, cycles, phase_deg in waves(text):
        total += arcsec * ARCSEC * np.sin(np.radians(cycles * angle_deg + phase_deg))
    return total


def _normal_level(share: float) -> float:
    """Return the level that a standard normal number exceeds with a chance of `share`."""
    return NormalDist().inv_cdf(min(1.0 - 1e-6, max(1e-6, 1.0 - share)))


def _draw(image: NDArray[np.float32], columns: Array, rows: Array, electrons: Array, sigma_px: float) -> None:
    """Add a point that moves through an exposure; `electrons` are the whole exposure's at each instant.

    Each pixel gets the integral of a Gaussian over its area, summed over steps finer than its sigma.
    """
    height, width = image.shape
    reach = SIGMAS * sigma_px + 1.0
    length = float(np.hypot(np.diff(columns), np.diff(rows)).sum())
    steps = min(MOST_STEPS, max(1, math.ceil(length / (0.5 * sigma_px + 0.1)))) * 2 + 1
    # Nodes are the middles of equal parts; the outer halves go on as the next ones.
    at = (np.arange(steps) + 0.5) * (len(columns) / steps) - 0.5
    left_node = np.clip(at.astype(np.intp), 0, len(columns) - 2)
    part = at - left_node
    x, y, flux = (
        values[left_node] + part * (values[left_node + 1] - values[left_node])
        for values in (columns, rows, electrons / steps)
    )
    keep = (x > -reach) & (x < width - 1 + reach) & (y > -reach) & (y < height - 1 + reach) & (flux > 0.0)
    x, y, flux = x[keep], y[keep], flux[keep]
    piece = max(1, int(PIECE_PX / max(length / steps, 1e-9))) if length > 0.0 else steps
    for i in range(0, len(x), piece):
        px, py, pf = x[i : i + piece], y[i : i + piece], flux[i : i + piece]
        left, right = max(0, int(px.min() - reach)), min(width, int(px.max() + reach) + 2)
        top, bottom = max(0, int(py.min() - reach)), min(height, int(py.max() + reach) + 2)
        if left >= right or top >= bottom:
            continue
        over_x = np.diff(_below((np.arange(left, right + 1) - 0.5 - px[:, None]) / sigma_px), axis=1)
        over_y = np.diff(_below((np.arange(top, bottom + 1) - 0.5 - py[:, None]) / sigma_px), axis=1)
        image[top:bottom, left:right] += (over_y * pf[:, None]).T @ over_x


def _below(sigmas: Array) -> Array:
    """Return the share of a normal distribution below values, to 1e-7."""
    return np.asarray(np.interp(sigmas, *_normal_table()))


@lru_cache(maxsize=1)
def _normal_table() -> tuple[Array, Array]:
    sigmas = np.linspace(-6.0, 6.0, 12001)
    return sigmas, np.array([0.5 * math.erfc(-one / math.sqrt(2.0)) for one in sigmas])

"""A satellite's path over one pass in a mount's two axes, its limits, and the keyhole about the celestial
pole.

The limits' names are those of the interlocks in `sattrack.safety`, which judges single moments with the
distance that the axes need to stop; here the limits themselves count, for whole passes at once.

Near the pole the hour angle turns by nearly half a turn in the time that the target takes past it. Where
that is faster than the axis can, time is lost; here the way that loses least is searched among all that
leave the target at one instant and join it at another, the hour angle axis running between them by a
trapezoid of rates within its limits: round the pole, lagging or leading, or through it, with the
declination axis past 90°, where the mount can do that. Along such a way the declination axis keeps as near
to the target as it can, so that the distance on the sky is |cos δ sin(H - h)| for a target at H, δ and an
hour angle axis at h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.control.target import POLE_WITHIN_DEG, Detour
from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.safety.bodies import moon_over, sun_over
from sattrack.safety.bounds import UP_DEG
from sattrack.safety.slews import TURN_MARGIN_DEG
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import AxisLimits, MountProfile
    from tle.bias import Bias
    from tle.propagator import Propagator
    from tle.site import Site

    Array = NDArray[np.float64]
    from sattrack.mount.geometry import AxisFrame
    from sattrack.mount.model import PierZone
    from sattrack.safety.bodies import Wanderer
    from sattrack.safety.limits import SafetyLimits

    Bools = NDArray[np.bool_]
    Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class AxisSamples:
    """How a mount's axes stand at instants (POSIX seconds of UTC), with what limits ask for; shape (n,).

    `hour_angle_axis_deg` is counted through turns, as cables count it; the declination axis passes 90° where
    the mount points from beyond the pole. Sun and Moon are those of `sattrack.safety.regions`.
    """

    utc_s: Array
    hour_angle_axis_deg: Array
    dec_axis_deg: Array
    sun_hour_angle_deg: Array
    sun_dec_deg: Array
    moon_hour_angle_deg: Array
    moon_dec_deg: Array

    def at(self, samples: slice | NDArray[Any]) -> AxisSamples:
        """Return some of the samples, by indices or a mask."""
        return AxisSamples(*(getattr(self, name)[samples] for name in AxisSamples.__slots__))


@dataclass(frozen=True, slots=True)
class AxisPath:
    """A target in the axes of a mount at rising instants; degrees and seconds, shape (n,) throughout.

    The axes' rates are those against the mount's base: sidereal tracking included. `sky_rate_deg_s` is the
    speed on the sky in that frame.
    """

    pointing: AxisSamples
    hour_angle_rate_deg_s: Array
    dec_rate_deg_s: Array
    hour_angle_acceleration_deg_s2: Array
    dec_acceleration_deg_s2: Array
    alt_deg: Array
    az_deg: Array
    ra_deg: Array
    """Right ascension of date of the direction, continuous."""

    @property
    def utc_s(self) -> Array:
        """Instants, POSIX seconds of UTC."""
        return self.pointing.utc_s

    @property
    def sky_rate_deg_s(self) -> Array:
        """Speed on the sky."""
        cos_dec = np.cos(np.radians(self.pointing.dec_axis_deg))
        speed: Array = np.hypot(self.hour_angle_rate_deg_s * cos_dec, self.dec_rate_deg_s)
        return speed

    def at(self, samples: slice | NDArray[np.intp]) -> AxisPath:
        """Return some of the samples."""
        pointing = self.pointing.at(samples)
        return AxisPath(pointing, *(getattr(self, name)[samples] for name in AxisPath.__slots__[1:]))

    def part(self, first: int, after: int) -> AxisPath:
        """Return the samples from one on, up to another that is left out."""
        return self.at(slice(first, after))

    def thinned(self, every: int) -> AxisPath:
        """Return one sample of so many, and the last one."""
        return self.at(np.unique(np.append(np.arange(0, len(self.utc_s), every), len(self.utc_s) - 1)))

    def wound_anew(self) -> AxisPath:
        """Return the same with the cables as a slew to the first sample leaves them: within half a turn."""
        return self.wound(-360.0 * float(np.floor((self.pointing.hour_angle_axis_deg[0] + 180.0) / 360.0)))

    def led(self, profile: MountProfile) -> AxisPath:
        """Return the same on the turn to which rates lead a mount that is not equatorial.

        That is a turn on which all of it fits, by the rule of `sattrack.safety.slews`; else, and for an
        equatorial mount, it is as it was.
        """
        axis = self.pointing.hour_angle_axis_deg
        most = profile.hour_angle_limit_deg - TURN_MARGIN_DEG
        fit = [turn for turn in (0.0, -360.0, 360.0) if float(np.max(np.abs(axis + turn))) <= most]
        return self.wound(fit[0]) if fit and profile.geometry is not None else self

    def wound(self, by_deg: float) -> AxisPath:
        """Return the same with the hour angle axis turned on by whole turns, in degrees."""
        p = self.pointing
        return replace(self, pointing=replace(p, hour_angle_axis_deg=p.hour_angle_axis_deg + by_deg))

    def until(self, utc_s: float) -> AxisPath:
        """Return the samples up to an instant."""
        return self.part(0, int(np.searchsorted(self.utc_s, utc_s, side="right")))

    def seen_from(self, beyond_pole: bool, latitude_deg: float) -> AxisPath:
        """Return the same target from a side of the pier, begun within half a turn of the meridian."""
        p = self.pointing
        folded = bool(np.any(np.abs(p.dec_axis_deg[:1]) > 90.0))
        pole_deg = 180.0 if latitude_deg >= 0.0 else -180.0
        if folded == beyond_pole:
            turn, dec, sense = 0.0, p.dec_axis_deg, 1.0
        else:
            turn, dec, sense = 180.0, pole_deg - p.dec_axis_deg, -1.0
        turned = replace(p, hour_angle_axis_deg=p.hour_angle_axis_deg + turn, dec_axis_deg=dec)
        return replace(
            self,
            pointing=turned,
            dec_rate_deg_s=self.dec_rate_deg_s * sense,
            dec_acceleration_deg_s2=self.dec_acceleration_deg_s2 * sense,
        ).wound_anew()


def axis_path(propagator: Propagator, bias: Bias, utc_s: Array, frame: AxisFrame | None = None) -> AxisPath:
    """Return the way of a satellite at rising instants, three or more, seen from the normal side of the pier.

    `frame` is that of axes that are not equatorial: hour angle and declination are then those axes' angles,
    and Sun and Moon are seen from their pole. Accelerations are differences of the rates. Instants at which
    SGP4 fails are NaN. Raises TimeRangeError.
    """
    seen: Any = propagator.at(Utc(utc_s), bias)
    place = (seen.ha_deg, seen.dec_deg, seen.ha_rate_deg_s, seen.dec_rate_deg_s)
    hour_angle, dec, ha_rate, dec_rate = (np.asarray(one) for one in place)
    if frame is not None:
        hour_angle, dec, ha_rate, dec_rate = frame.angles(hour_angle, dec, ha_rate, dec_rate, fn=np)
    axis = np.full_like(hour_angle, np.nan)
    good = np.isfinite(hour_angle)
    axis[good] = np.degrees(np.unwrap(np.radians(hour_angle[good])))
    bodies = bodies_deg(propagator.site, utc_s, frame)
    return AxisPath(
        AxisSamples(utc_s, axis, dec, *bodies[0], *bodies[1]),
        ha_rate,
        dec_rate,
        np.gradient(ha_rate, utc_s),
        np.gradient(dec_rate, utc_s),
        np.asarray(seen.alt_deg),
        np.asarray(seen.az_deg),
        np.degrees(np.unwrap(np.radians(seen.ra_deg), axis=0)),
    )


LOOK_S = 120.0
_OVER = {"sun": sun_over, "moon": moon_over}


def bodies_deg(site: Site, utc_s: Array, frame: AxisFrame | None = None) -> list[tuple[Array, Array]]:
    """Return hour angle and declination of Sun and Moon at rising instants, seen from the mount's pole."""
    places = [body_place_deg(name, site.latitude_deg, site.longitude_deg, utc_s) for name in _OVER]
    if frame is None:
        return places
    return [frame.square.angles(*place, fn=np)[:2] for place in places]


def body_place_deg(name: str, latitude_deg: float, longitude_deg: float, utc_s: Array) -> tuple[Array, Array]:
    """Return hour angle and declination of the "sun" or the "moon" at rising instants, degrees.

    Interpolated between looks two minutes apart, in which the sky turns by half a degree: good to 8″.
    """
    first, last = int(utc_s[0] // LOOK_S), int(utc_s[-1] // LOOK_S) + 1
    seen = np.array([_look(name, latitude_deg, longitude_deg, look) for look in range(first, last + 1)])
    looks = LOOK_S * np.arange(first, last + 1)
    x, y, z = (np.interp(utc_s, looks, seen[:, k]) for k in range(3))
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


@lru_cache(maxsize=16384)
def _look(name: str, latitude_deg: float, longitude_deg: float, look: int) -> tuple[float, float, float]:
    """Return a body's unit vector at a whole number of LOOK_S; many passes of a night share it."""
    body = _over(name, latitude_deg, longitude_deg).at(look * LOOK_S)
    return body.x, body.y, body.z


@lru_cache(maxsize=16)
def _over(name: str, latitude_deg: float, longitude_deg: float) -> Wanderer:
    return _OVER[name](latitude_deg, longitude_deg)


def stretches(mask: Bools) -> list[tuple[int, int]]:
    """Return the first and the last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _altitude_deg(hour_angle_deg: Array, dec_deg: Array, latitude_deg: float) -> Array:
    h, d = np.radians(hour_angle_deg), np.radians(dec_deg)
    p = np.radians(latitude_deg)
    sine = np.sin(p) * np.sin(d) + np.cos(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))


def _azimuth_deg(pointing: AxisSamples, latitude_deg: float) -> Array:
    """Return the azimuth of where the axes point, from north through east, 0 to below 360 degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    p = np.radians(latitude_deg)
    east = -np.cos(d) * np.sin(h)
    north = np.cos(p) * np.sin(d) - np.sin(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arctan2(east, north)) % 360.0)


def separations_deg(pointing: AxisSamples, hour_angle_deg: Array, dec_deg: Array) -> Array:
    """Return the distance on the sky between where the axes point and other directions, degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    k, s = np.radians(hour_angle_deg), np.radians(dec_deg)
    cosine = np.sin(d) * np.sin(s) + np.cos(d) * np.cos(s) * np.cos(h - k)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def skyline_deg(azimuths_deg: Array, limits: SafetyLimits) -> Array:
    """Return the least altitude at azimuths: the floor, and the horizon where that is higher."""
    floor = np.full(np.shape(azimuths_deg), limits.floor_altitude_deg)
    if not limits.horizon:
        return floor
    azimuths = np.array([point[0] for point in limits.horizon])
    altitudes = np.array([point[1] for point in limits.horizon])
    around = np.concatenate([azimuths[-1:] - 360.0, azimuths, azimuths[:1] + 360.0])
    heights = np.concatenate([altitudes[-1:], altitudes, altitudes[:1]])
    return np.asarray(np.maximum(floor, np.interp(azimuths_deg, around, heights)))


def _skyline_about_deg(azimuths: Array, altitudes: Array, limits: SafetyLimits, radius_deg: float) -> Array:
    """Return the highest of floor and horizon in the azimuths that circles on the sky cover."""
    highest = skyline_deg(azimuths, limits)
    if not radius_deg:
        return highest
    narrow = math.sin(math.radians(radius_deg)) / np.maximum(np.cos(np.radians(altitudes)), 1e-9)
    spread = np.where(narrow < 1.0, np.degrees(np.arcsin(np.minimum(narrow, 1.0))), 180.0)
    for end in (-1.0, 1.0):
        highest = np.maximum(highest, skyline_deg((azimuths + end * spread) % 360.0, limits))
    for azimuth, altitude in limits.horizon:
        within = np.abs(wrap180(azimuths - azimuth)) <= spread
        highest = np.maximum(highest, np.where(within, altitude, highest))
    return np.asarray(highest)


def margins_deg(
    pointing: AxisSamples, profile: MountProfile, limits: SafetyLimits, latitude_deg: float
) -> dict[str, Array]:
    """Return by limit how far inside it the axes stand, degrees; negative outside."""
    altitude = _altitude_deg(pointing.hour_angle_axis_deg, pointing.dec_axis_deg, latitude_deg)
    low, high = profile.dec_axis_limits_deg
    geometry = profile.geometry
    loose_deg = 0.0 if geometry is None else geometry.off_square_deg
    found = {
        "altitude": altitude - limits.floor_altitude_deg - loose_deg,
        "hour_angle": profile.hour_angle_limit_deg - np.abs(pointing.hour_angle_axis_deg),
        "declination": np.minimum(pointing.dec_axis_deg - low, high - pointing.dec_axis_deg),
    }
    if limits.horizon:
        azimuth = _azimuth_deg(pointing, latitude_deg)
        if geometry is not None:
            azimuth = (azimuth + geometry.pole_azimuth_deg) % 360.0
        found["horizon"] = altitude - loose_deg - _skyline_about_deg(azimuth, altitude, limits, loose_deg)
    if profile.pier_zones:
        found["pier"] = _clear_of_pier_deg(pointing, profile.pier_zones)
    # Below the horizon a body does no harm.
    cones = (
        ("sun", limits.sun_deg, pointing.sun_hour_angle_deg, pointing.sun_dec_deg),
        ("moon", limits.moon_cone_deg, pointing.moon_hour_angle_deg, pointing.moon_dec_deg),
    )
    for name, cone_deg, hour_angle, dec in cones:
        if cone_deg > 0.0:
            apart = separations_deg(pointing, hour_angle, dec) - cone_deg - loose_deg
            height = _altitude_deg(hour_angle, dec, latitude_deg)
            found[name] = np.where(height > UP_DEG, apart, np.inf)
    return found


def _clear_of_pier_deg(pointing: AxisSamples, zones: tuple[PierZone, ...]) -> Array:
    """Return the distance to the nearest zone's edge, in degrees of axis angles; negative within one."""
    hour_angle, dec = pointing.hour_angle_axis_deg, pointing.dec_axis_deg
    least = np.full(np.shape(hour_angle), np.inf)
    for zone in zones:
        for corners in _axis_polygons(zone):
            # A polygon is met wherever whole turns of the axes lead to.
            middle = np.mean(np.array(corners), axis=0)
            x = hour_angle - 360.0 * np.round((hour_angle - middle[0]) / 360.0)
            y = dec - 360.0 * np.round((dec - middle[1]) / 360.0)
            least = np.minimum(least, _outside_deg(x, y, corners))
    return least


def _axis_polygons(zone: PierZone) -> list[Corners]:
    """Return a zone's polygons in angles of the axes, one for each side of the pier that it holds on."""
    found: list[Corners] = []
    if zone.side != "beyond_pole":
        found.append(zone.corners)
    if zone.side != "normal":
        found.append(tuple((ha + 180.0, 180.0 - dec) for ha, dec in zone.corners))
    return found


def _outside_deg(x: Array, y: Array, corners: Corners) -> Array:
    """Return the distance of points from a polygon's edge, negative inside."""
    inside = np.zeros(np.shape(x), dtype=bool)
    nearest = np.full(np.shape(x), np.inf)
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        dx, dy = x2 - x1, y2 - y1
        along = np.clip(((x - x1) * dx + (y - y1) * dy) / max(dx * dx + dy * dy, 1e-30), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - x1 - along * dx, y - y1 - along * dy))
        if dy:
            inside ^= ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) / dy * dx)
    return np.where(inside, -nearest, nearest)


RATE_SHARE, ACCELERATION_SHARE = 0.99, 0.95
"""What a way may use of the axis' limits: the controller needs the rest to correct with."""
COARSE, FINE = 161, 21
"""Instants to leave and to join that are tried at first, and in each round of refinement."""
ROUNDS = 7
SHRINK = 0.25
TRIED = 60
"""Of the pairs of instants within reach, so many of the nearest are judged by what they lose."""
SAMPLES = 301
BISECTIONS = 50
LONGEST_S = 150.0
JOIN_S = 1.0
"""Stretches so near one another are one: a keyhole, or a time at a limit."""


@dataclass(frozen=True, slots=True)
class Keyhole:
    """A stretch in which the hour angle turns too fast, and what the ways past it lose; seconds of time.

    `clipped_s` is lost by an axis that follows as long as it can and then at its limits until it has caught
    up, `round_s` by the best way that keeps to this side of the pole, `through_s` by the best one through it,
    None where the mount cannot. `detour` is the way to take, None where none is better than clipping.
    """

    begin_utc_s: float
    end_utc_s: float
    nearest_utc_s: float
    polar_distance_deg: float
    peak_rate_deg_s: float
    clipped_s: float
    round_s: float
    through_s: float | None
    detour: Detour | None


@dataclass(frozen=True, slots=True)
class _KeyholeTrack:
    """The target around a keyhole: seconds since an origin, unwrapped hour angle, its rate, declination."""

    origin_utc_s: float
    time_s: Array
    hour_angle_deg: Array
    rate_deg_s: Array
    dec_deg: Array

    def hour_angle_at(self, time_s: Array) -> Array:
        return np.interp(time_s, self.time_s, self.hour_angle_deg)

    def rate_at(self, time_s: Array) -> Array:
        return np.interp(time_s, self.time_s, self.rate_deg_s)

    def dec_at(self, time_s: Array) -> Array:
        return np.interp(time_s, self.time_s, self.dec_deg)


class _Crossing(NamedTuple):
    """One path past the pole: instants to leave and to join, half turns on, rates, seconds lost."""

    leave_s: float
    join_s: float
    half_turns: float
    first_deg_s: float
    cruise_deg_s: float
    last_deg_s: float
    lost_s: float


def reach_deg(
    first_deg_s: Array, last_deg_s: Array, seconds: Array, limit_deg_s: float, acceleration_deg_s2: float
) -> tuple[Array, Array]:
    """Return the least and the most that an axis can turn in a time, between given rates at its two ends.

    Bounded rate and acceleration; arrays of any one shape. Where the time is too short to go from the one
    rate to the other both are NaN.
    """
    most = _extreme(first_deg_s, last_deg_s, seconds, limit_deg_s, acceleration_deg_s2)
    least = -_extreme(-first_deg_s, -last_deg_s, seconds, limit_deg_s, acceleration_deg_s2)
    return least, most


def _extreme(first: Array, last: Array, seconds: Array, limit: float, acceleration: float) -> Array:
    cruise = np.minimum(limit, 0.5 * (first + last + acceleration * seconds))
    short = acceleration * seconds < np.abs(last - first)
    return np.where(short, np.nan, _turned(first, cruise, last, seconds, acceleration))


def _turned(first: Array, cruise: Array, last: Array, seconds: Array, acceleration: float) -> Array:
    """Return how far a trapezoid turns."""
    on, off = np.abs(cruise - first) / acceleration, np.abs(last - cruise) / acceleration
    turned: Array = cruise * seconds + 0.5 * (first - cruise) * on + 0.5 * (last - cruise) * off
    return turned


def cruise_deg_s(
    first_deg_s: Array, last_deg_s: Array, seconds: Array, turn_deg: Array, acceleration_deg_s2: float
) -> Array:
    """Return the cruising rates of trapezoids that turn so far in those times; they must be within reach."""
    swing = 0.5 * (acceleration_deg_s2 * seconds - np.abs(last_deg_s - first_deg_s))
    low = np.minimum(first_deg_s, last_deg_s) - swing
    high = np.maximum(first_deg_s, last_deg_s) + swing
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        short = _turned(first_deg_s, middle, last_deg_s, seconds, acceleration_deg_s2) < turn_deg
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray(0.5 * (low + high))


def can_pass_pole(path: AxisPath, profile: MountProfile, at: int) -> bool:
    """Tell whether the declination axis' travel holds the path from a sample on, seen across the pole."""
    low, high = profile.dec_axis_limits_deg
    dec = path.pointing.dec_axis_deg[at:]
    across = math.copysign(180.0, float(dec[0])) - dec
    return bool(np.min(across) >= low and np.max(across) <= high)


def find_keyholes(
    path: AxisPath, profile: MountProfile, tolerance_deg: float, ways: bool = True
) -> list[Keyhole]:
    """Return the keyholes of a target's path, in order.

    `path` needs steps well below a second near the pole; `tolerance_deg` is how far on the sky from the
    target still counts as on it. The pole is passed through where the declination axis' travel allows that.
    Without `ways`, no way past it is looked for but that of an axis at its limits.
    """
    limits = profile.ra
    rate = limits.max_rate_deg_s
    fast = np.abs(path.hour_angle_rate_deg_s) > rate
    fast &= np.abs(path.hour_angle_acceleration_deg_s2) < np.inf
    fast |= np.abs(path.hour_angle_acceleration_deg_s2) > limits.max_acceleration_deg_s2
    # An axis that is too slow for the target wherever it is, and not by the pole, has no keyhole.
    fast &= np.abs(np.abs(path.pointing.dec_axis_deg) - 90.0) < POLE_WITHIN_DEG
    fast &= path.sky_rate_deg_s <= rate
    if not fast.any():
        return []
    keyholes: list[Keyhole] = []
    for first, last in _stretches(fast, path.utc_s):
        if keyholes and path.utc_s[last] <= keyholes[-1].end_utc_s:
            continue
        through_pole = profile.through_pole and can_pass_pole(path, profile, (first + last) // 2)
        turns: tuple[tuple[int, ...], ...] = ()
        if ways:
            turns = (_ROUND, _THROUGH) if through_pole else (_ROUND,)
        keyholes.append(_keyhole(path, first, last, limits, tolerance_deg, turns))
    return keyholes


def _stretches(fast: NDArray[np.bool_], utc_s: Array) -> list[tuple[int, int]]:
    """Return first and last index of each stretch, those joined that are near one another."""
    found: list[tuple[int, int]] = []
    for first, last in stretches(fast):
        if found and utc_s[first] - utc_s[found[-1][1]] < JOIN_S:
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return found


_ROUND, _THROUGH = (-2, 0, 2), (-1, 1)
"""Half turns of the hour angle on the ways round the pole, and through it."""


def _keyhole(
    path: AxisPath,
    first: int,
    last: int,
    limits: AxisLimits,
    tolerance_deg: float,
    turns: tuple[tuple[int, ...], ...],
) -> Keyhole:
    p = path.pointing
    distance = np.abs(90.0 - np.abs(p.dec_axis_deg))
    nearest = first + int(np.argmin(distance[first : last + 1]))
    low, high = np.searchsorted(p.utc_s, [p.utc_s[first] - LONGEST_S, p.utc_s[last] + LONGEST_S])
    part = slice(int(low), int(high))
    origin = float(p.utc_s[nearest])
    track = _KeyholeTrack(
        origin,
        p.utc_s[part] - origin,
        p.hour_angle_axis_deg[part],
        path.hour_angle_rate_deg_s[part],
        p.dec_axis_deg[part],
    )
    begin_s = float(p.utc_s[max(0, first - 1)]) - origin
    end_s = float(p.utc_s[min(last + 1, len(p.utc_s) - 1)]) - origin
    full = _DetourSearch(
        track, begin_s, end_s, limits.max_rate_deg_s, limits.max_acceleration_deg_s2, tolerance_deg
    )
    search = _DetourSearch(
        track,
        begin_s,
        end_s,
        limits.max_rate_deg_s * RATE_SHARE,
        limits.max_acceleration_deg_s2 * ACCELERATION_SHARE,
        tolerance_deg,
    )
    clipped = full.best((0,), lagging=True)
    around = search.best(_ROUND) if _ROUND in turns else None
    through = search.best(_THROUGH) if _THROUGH in turns else None
    rest_s = float(track.time_s[-1]) - begin_s
    clipped_s = rest_s if clipped is None else clipped.lost_s
    ways = [way for way in (around, through) if way is not None and way.lost_s < clipped_s]
    best = min(ways, key=lambda way: way.lost_s, default=None)
    return Keyhole(
        begin_utc_s=origin + begin_s,
        end_utc_s=origin + end_s,
        nearest_utc_s=origin,
        polar_distance_deg=float(distance[nearest]),
        peak_rate_deg_s=float(np.max(np.abs(path.hour_angle_rate_deg_s[first : last + 1]))),
        clipped_s=clipped_s,
        round_s=clipped_s if around is None else min(clipped_s, around.lost_s),
        through_s=None if through is None else through.lost_s,
        detour=None if best is None else search.detour(best, path),
    )


@dataclass(frozen=True, slots=True)
class _DetourSearch:
    """The search for the way past one keyhole that loses least, within limits of the hour angle axis."""

    track: _KeyholeTrack
    begin_s: float
    end_s: float
    limit_deg_s: float
    acceleration_deg_s2: float
    tolerance_deg: float

    def best(self, half_turns: tuple[int, ...], lagging: bool = False) -> _Crossing | None:
        """Return the way that loses least; `lagging` for those that leave only when they must."""
        first_s, last_s = float(self.track.time_s[0]), float(self.track.time_s[-1])
        leaves = np.array([self.begin_s]) if lagging else np.linspace(first_s, self.begin_s, COARSE)
        joins = np.linspace(self.end_s, last_s, COARSE)
        best = self._best_of(leaves, joins, half_turns)
        if best is None:
            return None
        leave_span, join_span = (first_s - self.begin_s) / COARSE, (last_s - self.end_s) / COARSE
        for _ in range(ROUNDS):
            if not lagging:
                leaves = _around(best.leave_s, leave_span, first_s, self.begin_s)
            joins = _around(best.join_s, join_span, self.end_s, last_s)
            finer = self._best_of(leaves, joins, (int(best.half_turns),))
            if finer is not None and finer.lost_s < best.lost_s:
                best = finer
            leave_span, join_span = leave_span * SHRINK, join_span * SHRINK
        return best

    def _best_of(self, leaves: Array, joins: Array, half_turns: tuple[int, ...]) -> _Crossing | None:
        leave, join, turns = (
            a.ravel() for a in np.meshgrid(leaves, joins, np.array(half_turns, dtype=float), indexing="ij")
        )
        first, last = self.track.rate_at(leave), self.track.rate_at(join)
        turn = self.track.hour_angle_at(join) + 180.0 * turns - self.track.hour_angle_at(leave)
        seconds = join - leave
        least, most = reach_deg(first, last, seconds, self.limit_deg_s, self.acceleration_deg_s2)
        possible = (turn >= least) & (turn <= most)
        possible &= (np.abs(first) <= self.limit_deg_s) & (np.abs(last) <= self.limit_deg_s)
        index = np.flatnonzero(possible)
        if not len(index):
            return None
        index = index[np.argsort(seconds[index], kind="stable")[:TRIED]]
        cruise = cruise_deg_s(
            first[index], last[index], seconds[index], turn[index], self.acceleration_deg_s2
        )
        columns = (leave[index], join[index], turns[index], first[index], cruise, last[index])
        lost = self._lost_s(*columns)
        first_of = int(np.argmin(lost))
        return _Crossing(*(float(column[first_of]) for column in (*columns, lost)))

    def _lost_s(
        self, leave: Array, join: Array, turns: Array, first: Array, cruise: Array, last: Array
    ) -> Array:
        """Return the seconds off target of each way, the edges of the tolerance found between samples."""
        share = np.linspace(0.0, 1.0, SAMPLES)
        seconds = (join - leave)[:, None]
        time = seconds * share
        on = np.abs(cruise - first)[:, None] / self.acceleration_deg_s2
        off = np.abs(last - cruise)[:, None] / self.acceleration_deg_s2
        ramp_on, ramp_off = np.minimum(time, on), np.maximum(0.0, time - (seconds - off))
        axis = self.track.hour_angle_at(leave)[:, None] + cruise[:, None] * time
        axis += (first - cruise)[:, None] * (ramp_on - 0.5 * ramp_on**2 / np.maximum(on, 1e-9))
        axis += (last - cruise)[:, None] * 0.5 * ramp_off**2 / np.maximum(off, 1e-9)
        at = leave[:, None] + time
        apart = np.radians(self.track.hour_angle_at(at) - axis)
        cos_dec = np.cos(np.radians(self.track.dec_at(at)))
        side = np.abs(cos_dec * np.sin(apart))
        # Without the far side of the pole, the pole itself is the nearest that there is to turn to.
        beyond = (turns[:, None] % 2.0 == 0.0) & (np.cos(apart) < 0.0)
        gap = np.degrees(np.arcsin(np.clip(np.where(beyond, np.abs(cos_dec), side), 0.0, 1.0)))
        over = gap - self.tolerance_deg
        before, after = over[:, :-1], over[:, 1:]
        span = np.where(before == after, 1.0, np.abs(after - before))
        part = np.clip(np.maximum(before, after) / span, 0.0, 1.0)
        outside = np.where(
            (before > 0.0) & (after > 0.0), 1.0, np.where((before > 0.0) | (after > 0.0), part, 0.0)
        )
        lost: Array = np.sum(outside, axis=1) * (join - leave) / (SAMPLES - 1)
        return lost

    def detour(self, way: _Crossing, path: AxisPath) -> Detour:
        """Return a way as rates of the right ascension, which falls as the hour angle rises."""
        begin = self.track.origin_utc_s + way.leave_s
        return Detour(
            begin_utc_s=begin,
            end_utc_s=self.track.origin_utc_s + way.join_s,
            ra_deg=float(np.interp(begin, path.utc_s, path.ra_deg)),
            first_deg_s=SIDEREAL_RATE_DEG_S - way.first_deg_s,
            cruise_deg_s=SIDEREAL_RATE_DEG_S - way.cruise_deg_s,
            last_deg_s=SIDEREAL_RATE_DEG_S - way.last_deg_s,
            acceleration_deg_s2=self.acceleration_deg_s2,
            through_pole=way.half_turns % 2.0 == 1.0,
            pole_dec_deg=math.copysign(90.0, float(self.track.dec_at(np.array(0.0)))),
        )


def _around(middle: float, span: float, low: float, high: float) -> Array:
    return np.clip(np.linspace(middle - abs(span), middle + abs(span), FINE), low, high)


STEP_S = 0.05
MOST_SAMPLES = 60_000


def detours_for(
    propagator: Propagator, bias: Bias, plan: TrackPlan, profile: MountProfile
) -> tuple[Detour, ...]:
    """Return the detours of a plan; none where the profile does not let following go through the pole.

    Round the pole no way loses less than following as long as the axes can and catching up, which needs no
    plan. `propagator` gives what is fed. Raises TimeRangeError, PropagationError.
    """
    if not profile.through_pole:
        return ()
    duration_s = plan.end_utc_s - plan.start_utc_s
    count = min(MOST_SAMPLES, max(8, math.ceil(duration_s / STEP_S) + 1))
    path = axis_path(propagator, bias, np.linspace(plan.start_utc_s, plan.end_utc_s, count), profile.frame)
    if not np.isfinite(path.pointing.dec_axis_deg).all():
        return ()
    found = find_keyholes(path, profile, plan.on_target_arcsec / 3600.0)
    return tuple(k.detour for k in found if k.detour is not None and k.detour.through_pole)

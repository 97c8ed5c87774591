"""Mounts whose axes point anywhere: followed, kept from limits of the sky, and not taken for one another.

Where a tube really points is computed by a stranger's rotations (`bench/strangers/alpaca_two_axes.py`).
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import Any

import axes_anywhere
import erfa
import family
import feeder
import msgspec
import numpy as np
import pytest

from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import MoveAxes
from sattrack.safety import SafetyLimits
from sattrack.views.messages import SeenOffset
from tle.bias import Bias
from tle.instants import Utc
from tle.propagator import Propagator

SETTLED_S = 10.0
"""Within so long from its beginning a mount is on its target."""
FOLLOWED_S, BRIEF_S = 30.0, 20.0
"""For so long of a pass it is followed here; `bench/axes_anywhere.py` follows the whole."""


def drawn_at_target(number: int) -> axes_anywhere.AxesDraw:
    """Return a draw that begins on its target."""
    axes = axes_anywhere.draw(number)
    frame = axes_anywhere.AxisFrame(axes.geometry, axes.drawn.site.latitude_deg)
    first, second = axes_anywhere._path(axes.drawn, frame)[0, :2]
    angles = [
        zero + sense * angle
        for zero, sense, angle in zip(axes.zeros_deg, axes.senses, (first, second), strict=True)
    ]
    return axes._replace(drawn=replace(axes.drawn, stands=(angles[0], angles[1])))


def passes_at(axes: axes_anywhere.AxesDraw, after_s: float) -> tuple[float, float]:
    """Return azimuth and altitude of a draw's satellite so long after its pass begins, degrees."""
    seen = Propagator(axes.drawn.elements, axes.drawn.site).at(Utc(axes.drawn.start_s + after_s))
    return float(seen.az_deg), float(seen.alt_deg)


@pytest.mark.parametrize("number", [pytest.param(0, marks=pytest.mark.soak), 1])
def test_a_satellite_is_followed(number: int) -> None:
    """The bound is several times what `python bench/axes_anywhere.py` prints of these draws."""
    run = axes_anywhere.AxesRun(axes_anywhere.draw(number)).run(lasts_s=BRIEF_S)
    assert run.ended_by is None
    assert 0.001 < run.settled_rms_arcsec() < 0.15


def test_a_way_by_rates_does_not_make_a_mount_worse_than_its_own_slew() -> None:
    """What drives answer at their limit would be relied on for half a minute: 0.25″ in place of 0.02″."""
    axes = axes_anywhere.draw(38)
    by_rates = axes_anywhere.AxesRun(axes).run(lasts_s=FOLLOWED_S)
    assert by_rates.ended_by is None
    assert 0.001 < by_rates.settled_rms_arcsec() < 0.15
    by_slew = family.Run(axes_anywhere.equatorial(axes), "truth").run(lasts_s=FOLLOWED_S)
    bound_arcsec = axes_anywhere.BOUND * by_slew.settled_rms_arcsec()
    assert by_rates.settled_rms_arcsec() < max(feeder.ORACLE_ARCSEC, bound_arcsec)


@pytest.mark.parametrize("skyline", [False, pytest.param(True, marks=pytest.mark.soak)])
@pytest.mark.parametrize("number", [1, pytest.param(8, marks=pytest.mark.soak)])
def test_the_tube_stays_above_floor_and_skyline(number: int, skyline: bool) -> None:
    axes = drawn_at_target(number)
    (_, first), (_, last) = passes_at(axes, SETTLED_S), passes_at(axes, FOLLOWED_S)
    middle = 0.5 * (first + last)
    assert first > middle + 1.0, "a pass that falls"
    horizon = tuple((float(azimuth), middle) for azimuth in range(0, 361, 60))
    limits = SafetyLimits(floor_altitude_deg=middle, optical=False)
    if skyline:
        limits = SafetyLimits(horizon=horizon, floor_altitude_deg=-89.0, optical=False)
    run = axes_anywhere.AxesRun(axes, limits=limits).run(lasts_s=FOLLOWED_S)
    begun, lowest = False, math.inf
    for _, _, altitude in run.tube_deg:
        begun = begun or altitude > middle + 0.2
        lowest = min(lowest, altitude) if begun else lowest
    assert begun
    assert lowest >= middle
    assert sum(run.engine.held_s.values()) > 1.0 or run.engine.tracker.acquired_utc_s is None


def test_a_skyline_stands_where_its_azimuths_are() -> None:
    # A wall to one side of the pass is not met; one in its way is.
    axes = drawn_at_target(33)
    last, _ = passes_at(axes, 0.5 * (SETTLED_S + family.LASTS_S))
    for beside_deg, met in ((0.0, True), (180.0, False)):
        wall = (last + beside_deg) % 360.0
        points = sorted(
            ((wall + off) % 360.0, 89.0 if abs(off) < 5 else 0.0) for off in (-40, -6, -4, 4, 6, 40)
        )
        around = [
            (float(az), 0.0) for az in range(0, 360, 60) if abs(math.remainder(az - wall, 360.0)) > 45.0
        ]
        limits = SafetyLimits(horizon=tuple(sorted([*points, *around])), optical=False)
        run = axes_anywhere.AxesRun(axes, limits=limits).run(lasts_s=FOLLOWED_S)
        assert ("horizon" in run.engine.held_s) is met
        _, azimuths, altitudes = np.array(run.tube_deg).T
        assert np.all(altitudes > np.interp(azimuths, *np.array(limits.horizon).T, period=360.0))


def sun_apart_deg(axes: axes_anywhere.AxesDraw, tube_deg: Any) -> tuple[Any, Any]:
    """Return how far a tube is from the Sun, and the Sun's altitude, at each instant, degrees, by astropy."""
    from astropy import units
    from astropy.coordinates import AltAz, EarthLocation, get_sun
    from astropy.time import Time

    site = axes.drawn.site
    place = EarthLocation.from_geodetic(site.longitude_deg, site.latitude_deg, 0.0)
    utc_s, azimuth, altitude = np.array(tube_deg).T
    frame: Any = AltAz(obstime=Time(utc_s, format="unix"), location=place)
    sun = get_sun(frame.obstime).transform_to(frame)
    pointing: Any = AltAz(
        az=azimuth * units.deg, alt=altitude * units.deg, obstime=frame.obstime, location=place
    )
    return sun.separation(pointing).deg, sun.alt.deg


@pytest.mark.parametrize(
    ("number", "cone_deg", "lasts_s"),
    [
        (29, 15.0, FOLLOWED_S),
        pytest.param(33, 43.0, FOLLOWED_S, marks=pytest.mark.soak),
        *(
            pytest.param(*one, family.LASTS_S, marks=pytest.mark.soak)
            for one in ((6, 20.0), (29, 15.0), (33, 38.0))
        ),
    ],
)
def test_the_tube_stays_out_of_the_sun(number: int, cone_deg: float, lasts_s: float) -> None:
    axes = drawn_at_target(number)
    limits = SafetyLimits(floor_altitude_deg=-89.0, sun_cone_deg=cone_deg)
    run = axes_anywhere.AxesRun(axes, limits=limits).run(lasts_s=lasts_s)
    begun, least = False, math.inf
    aparts, sun_alts = sun_apart_deg(axes, run.tube_deg[::10])
    assert min(sun_alts) > 0.0
    for apart in aparts:
        begun = begun or apart > cone_deg + 0.2
        least = min(least, apart) if begun else least
    assert begun
    assert cone_deg <= least < cone_deg + 3.0


@pytest.mark.parametrize(
    ("number", "other"), [(0, (200.0, 10.0)), (4, (0.0, 45.0)), (6, (10.0, 90.0)), (6, (200.0, 10.0))]
)
def test_a_geometry_of_another_mount_is_noticed_in_seconds_named_and_stopped(
    number: int, other: tuple[float, float]
) -> None:
    axes = axes_anywhere.draw(number)
    profile = msgspec.structs.replace(axes_anywhere.profile_of(axes), geometry=AxisGeometry(*other))
    moved_s = []

    def watch(run: Any, now_s: float) -> None:
        if isinstance(run.engine.in_force, MoveAxes):
            moved_s.append(now_s)

    run = axes_anywhere.AxesRun(axes, profile=profile).run(watch)
    assert run.ended_by == "limit:obedience"
    assert "geometry" in (run.message or "")
    assert moved_s[-1] - moved_s[0] < 5.0


@pytest.mark.parametrize("name", ["ra_rate_sign", "dec_rate_sign"])
def test_a_wrong_sign_is_named_as_such(name: str) -> None:
    axes = axes_anywhere.draw(4)
    profile = axes_anywhere.profile_of(axes)
    profile = msgspec.structs.replace(profile, **{name: -getattr(profile, name)})
    run = axes_anywhere.AxesRun(axes, profile=profile).run()
    assert run.ended_by == "limit:obedience"
    assert f"turn {name}" in (run.message or "")


LATE_S = 0.4
"""By how much the satellite is later than its elements say, in the passes with a camera."""


def unit(azimuth_deg: float, altitude_deg: float) -> Any:
    """Return a direction, east, north, up."""
    azimuth, altitude = math.radians(azimuth_deg), math.radians(altitude_deg)
    level = math.cos(altitude)
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(altitude)])


class CameraOnTube:
    """A camera on a stranger's tube: its image is turned by so much from the tube's own up."""

    def __init__(self, axes: axes_anywhere.AxesDraw, turned_deg: float, told_deg: float | None) -> None:
        self._tube, self._sense = axes_anywhere.Tube(axes), axes.senses[1]
        self._turned, self._told = math.radians(turned_deg), told_deg
        self._sent_s = -math.inf
        self.off_arcsec: list[float] = []
        self.first_arcsec = 0.0
        self.site = axes.drawn.site

    def satellite(self, run: Any, utc_s: float) -> Any:
        """Return where the satellite really is, airless as the passes are."""
        seen = run.propagator.at(Utc(utc_s), Bias(-LATE_S))
        hour_angle = float(seen.ha_deg)
        if run.profile.geometry.reports == "sky":
            # Pointed by the mount's own clock.
            truth = run.mount.truth()
            hour_angle = truth.ra_deg + truth.hour_angle_deg - float(seen.ra_deg)
        azimuth, altitude = erfa.hd2ae(
            math.radians(hour_angle), math.radians(float(seen.dec_deg)), math.radians(self.site.latitude_deg)
        )
        return unit(math.degrees(azimuth), math.degrees(altitude))

    def watch(self, run: Any, now_s: float) -> None:
        """Send what is seen twice a second, once the mount follows."""
        truth = run.mount.truth()
        first, second = truth.hour_angle_deg, truth.dec_axis_deg
        tube = unit(*self._tube.horizontal(first, second))
        sat = self.satellite(run, truth.utc_s)
        self.off_arcsec.append(float(np.linalg.norm(np.cross(tube, sat))) * 206264.8)
        if now_s - self._sent_s < 0.5 or run.engine.tracker.phase != "tracking":
            return
        self.first_arcsec = self.first_arcsec or self.off_arcsec[-1]
        self._sent_s = now_s
        above = unit(*self._tube.horizontal(first, second + 0.01 * self._sense))
        up = above - tube * float(above @ tube)
        up = up / np.linalg.norm(up)
        east = np.cross(up, tube)
        image_up = up * math.cos(self._turned) + east * math.sin(self._turned)
        image_right = np.cross(tube, image_up)
        dx, dy = (float(sat @ one) * 206264.8 for one in (image_right, image_up))
        utc = Utc(truth.utc_s - run.dated_late_s).isoformat("microseconds")
        run.engine.operate(SeenOffset(utc, dx, dy, 1.0, "on the tube", rotation_deg=self._told), now_s)


@pytest.mark.parametrize(
    ("number", "turned_deg"), [pytest.param(4, 0.0, marks=pytest.mark.soak), (33, 130.0)]
)
def test_offsets_of_a_camera_that_turns_on_the_sky_lead_to_the_satellite(
    number: int, turned_deg: float
) -> None:
    axes = drawn_at_target(number)
    frame = axes_anywhere.AxisFrame(axes.geometry, axes.drawn.site.latitude_deg)
    assert frame.turns_field
    camera = CameraOnTube(axes, turned_deg, turned_deg)
    run = axes_anywhere.AxesRun(axes).run(camera.watch, lasts_s=FOLLOWED_S)
    estimator = run.engine.tracker.steering.estimator
    assert camera.first_arcsec > 60.0
    assert estimator.accepted > 50
    assert estimator.rejected + estimator.refused < 5
    assert max(camera.off_arcsec[-200:]) < 5.0


@pytest.mark.parametrize("told_deg", [150.0, -90.0])
def test_by_how_much_a_camera_that_turns_on_the_sky_is_set_otherwise_is_found_out(told_deg: float) -> None:
    camera = CameraOnTube(drawn_at_target(4), 0.0, told_deg)
    run = axes_anywhere.AxesRun(drawn_at_target(4)).run(camera.watch, lasts_s=FOLLOWED_S)
    assert max(camera.off_arcsec[-200:]) < 5.0
    (view,) = run.engine.tracker.steering.camera_views()
    assert view.found_rotation_deg == pytest.approx(-told_deg, abs=0.5)


class HorizonStranger(axes_anywhere.SkyStranger):
    """A stranger that tells azimuth and altitude alone; its right ascension and declination mean nothing."""

    def turn(self) -> bytes:
        status = bytearray(super().turn())
        truth = self.truth()
        azimuth, altitude = self._tube.horizontal(truth.hour_angle_deg, truth.dec_axis_deg)
        struct.pack_into("<dd", status, 8, altitude, azimuth)
        struct.pack_into("<d", status, 24, 12.5)
        struct.pack_into("<d", status, 40, 3.0)
        return bytes(status)


class TrackingStranger(axes_anywhere.SkyStranger):
    """A stranger that tracks the sky by both axes, found by trying, and adds MoveAxis to that."""

    def __init__(self, axes: axes_anywhere.AxesDraw) -> None:
        super().__init__(axes)
        self._hard = axes.drawn.hardware

    def tracking_deg_s(self) -> tuple[float, float]:
        """Return by how much its drives must turn in a second, to stay on the sky."""
        truth = self.truth()
        at = np.array([truth.hour_angle_deg, truth.dec_axis_deg])
        hour_angle, dec = self._tube.sky(*at)
        step, moved = 1e-3, at
        wanted = np.array([hour_angle + 0.5 * 360.98564736629 / 86400.0, dec])
        for _ in range(4):
            here = np.array(self._tube.sky(*moved))
            slopes = np.stack(
                [(np.array(self._tube.sky(*(moved + one))) - here) / step for one in step * np.eye(2)], axis=1
            )
            moved = moved + np.linalg.solve(slopes, np.remainder(wanted - here + 180.0, 360.0) - 180.0)
        first, second = 2.0 * (moved - at)
        return float(first), float(second)

    def receive(self, data: bytes) -> None:
        """Take a datagram: rates reach the drives with those of tracking added."""
        packed = bytearray(data)
        first, second = self.tracking_deg_s()
        for flag, offset, own, sign, gain in (
            (75, 40, first, self._hard.signs[0], self._hard.gains[0]),
            (76, 32, second, self._hard.signs[1], self._hard.gains[1]),
        ):
            if packed[flag]:
                (rate,) = struct.unpack_from("<d", packed, offset)
                struct.pack_into("<d", packed, offset, rate + sign * own / gain)
        super().receive(bytes(packed))


def test_a_mount_that_tells_azimuth_and_altitude_alone_is_followed_with() -> None:
    axes = drawn_at_target(4)
    axes = axes._replace(geometry=msgspec.structs.replace(axes.geometry, reports="horizon"))
    run = axes_anywhere.AxesRun(axes)
    run.mount = HorizonStranger(axes)
    run.run(lasts_s=BRIEF_S)
    assert run.ended_by is None
    assert 0.001 < run.settled_rms_arcsec() < 0.15


def test_a_mount_that_adds_rates_to_its_tracking_by_both_axes_is_followed_with() -> None:
    axes = drawn_at_target(4)
    assert axes.geometry.reports == "sky"
    profile = msgspec.structs.replace(axes_anywhere.profile_of(axes), additive=True)
    run = axes_anywhere.AxesRun(axes, profile=profile)
    run.mount = TrackingStranger(axes)
    run.run(lasts_s=BRIEF_S)
    assert run.ended_by is None
    assert 0.001 < run.settled_rms_arcsec() < 0.15
    # Nothing of its tracking is left for the filters to learn.
    axes_now = run.engine.tracker.follower.axes
    assert axes_now is not None
    assert abs(axes_now.dec.disturbance_deg_s) < 0.5 / 3600.0

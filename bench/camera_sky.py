"""The simulated camera's sky, judged by astropy, skyfield and closed forms.

    python bench/camera_sky.py

Prints one line a figure: what was compared, the worst difference, and how long a frame takes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import math
import sys
import time
import warnings

import numpy as np

from sattrack.mount.model import mean_sidereal_deg
from sattrack.mount.simulator.camera import SkyCamera, TruePath, make_sky
from sattrack.mount.simulator.hidden import Hidden, SimulatedCamera, split_delays_s
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.mount.simulator.night_sky import LIGHT_KM_S, NightSky, Stars
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun
from tle.instants import Utc
from tle.refraction import Refraction

SITE = demo_pass.SITE.place()
START_S = float(Utc.parse("2026-10-02T13:03:00Z").unix_s)
NO_AIR = Refraction(0.0, 10.0)
ARCSEC = math.degrees(1.0) * 3600.0
NONE = Stars(np.zeros((0, 3)), np.zeros(0))


def mount_frame():
    """Meridian, west and pole of a mount whose pole is the true one, as rows east, north, up.

    By the closed form of what polar motion adds to latitude and azimuth, with astropy's values of it.
    """
    from astropy.time import Time
    from astropy.utils import iers

    iers.conf.auto_download = False
    x, y = (
        one.to_value("rad") for one in iers.earth_orientation_table.get().pm_xy(Time(START_S, format="unix"))
    )
    lon, lat = math.radians(SITE.longitude_deg), math.radians(SITE.latitude_deg)
    altitude = lat + x * math.cos(lon) - y * math.sin(lon)
    azimuth = -(x * math.sin(lon) + y * math.cos(lon)) / math.cos(lat)
    sin_a, cos_a, sin_z, cos_z = math.sin(altitude), math.cos(altitude), math.sin(azimuth), math.cos(azimuth)
    return np.array(
        [[-sin_a * sin_z, -sin_a * cos_z, cos_a], [-cos_z, sin_z, 0.0], [cos_a * sin_z, cos_a * cos_z, sin_a]]
    )


def axes_of(directions):
    """Hour angle and declination, degrees, of directions east, north, up."""
    meridian, west, pole = mount_frame() @ np.asarray(directions).T
    return np.degrees(np.unwrap(np.arctan2(west, meridian))), np.degrees(np.arcsin(pole))


def directions_of(ha_deg, dec_deg):
    """Directions east, north, up of hour angles and declinations in degrees."""
    h, d = np.radians(ha_deg), np.radians(dec_deg)
    return np.stack([np.cos(d) * np.cos(h), np.cos(d) * np.sin(h), np.sin(d)], axis=-1) @ mount_frame()


def resting(ha_deg, dec_deg):
    """A path of axes that stand still."""
    path = TruePath()
    path.add(START_S - 10.0, ha_deg, dec_deg, 0.0, 0.0)
    path.add(START_S + 3600.0, ha_deg, dec_deg, 0.0, 0.0)
    return path


def following(sky, seconds, begin_s=START_S, off_deg=(0.0, 0.0)):
    """A path of axes that follow a satellite exactly, but for an offset of both."""
    utc_s = begin_s + np.arange(-0.5, seconds + 0.5, 0.05)
    none = np.zeros_like(utc_s)
    ha, dec = axes_of(sky.satellite(0, utc_s, none, none).directions)
    path = TruePath()
    rates = np.gradient(ha, utc_s, edge_order=2), np.gradient(dec, utc_s, edge_order=2)
    for one in zip(utc_s, ha + off_deg[0], dec + off_deg[1], *rates, strict=True):
        path.add(*map(float, one))
    return path


def lone_star(ha_deg, dec_deg, magnitude, utc_s=START_S):
    """The catalogue of one star that is seen at an hour angle and a declination at an instant, by astropy."""
    place = to_icrs(directions_of(ha_deg, dec_deg), utc_s)
    return Stars(place.cartesian.xyz.value.reshape(1, 3), np.array([magnitude]))


def to_icrs(direction, utc_s):
    """Where on the sky a direction east, north, up is at an instant, without air, by astropy."""
    from astropy.coordinates import ICRS, AltAz, SkyCoord
    from astropy.time import Time

    east, north, up = direction
    frame = AltAz(obstime=Time(utc_s, format="unix"), location=SITE.to_astropy(), pressure=0.0)
    azimuth, altitude = math.degrees(math.atan2(east, north)) % 360.0, math.degrees(math.asin(up))
    return SkyCoord(azimuth, altitude, unit="deg", frame=frame).transform_to(ICRS())


def star_places(count=400):
    """Worst separation of stars' directions from astropy's AltAz, arcseconds."""
    from astropy.coordinates import ICRS, AltAz, SkyCoord
    from astropy.time import Time

    rng = np.random.default_rng(5)
    places = rng.standard_normal((count, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    sky = NightSky(SITE, (), Stars(places, np.zeros(count)), NO_AIR)
    utc_s = START_S + np.array([0.0, 0.25, 0.5])
    got = sky.directions(Stars(places, np.zeros(count)), utc_s)
    stars = SkyCoord(*places.T, representation_type="cartesian", frame=ICRS())
    stars = SkyCoord(stars.spherical.lon, stars.spherical.lat, frame="icrs")
    worst = 0.0
    for k, instant in enumerate(utc_s):
        frame = AltAz(obstime=Time(instant, format="unix"), location=SITE.to_astropy(), pressure=0.0)
        seen = stars.transform_to(frame)
        alt, az = seen.alt.rad, seen.az.rad
        want = np.stack([np.cos(alt) * np.sin(az), np.cos(alt) * np.cos(az), np.sin(alt)], axis=1)
        up = alt > 0.0
        worst = max(worst, float(np.linalg.norm(got[k] - want, axis=1)[up].max()) * ARCSEC)
    return worst


def satellite_places():
    """Worst separation of the satellite's direction from astropy's TEME to ITRS, arcseconds."""
    from astropy import units as u
    from astropy.coordinates import ITRS, TEME, CartesianRepresentation
    from astropy.time import Time
    from sgp4.api import Satrec

    record = Satrec.twoline2rv(demo_pass.LINE_1, demo_pass.LINE_2)
    sky = NightSky(SITE, [demo_pass.elements()], NONE, NO_AIR)
    utc_s = START_S + np.arange(0.0, 300.0, 20.0)
    none = np.zeros_like(utc_s)
    got = sky.satellite(0, utc_s, none, none).directions
    lon, lat = math.radians(SITE.longitude_deg), math.radians(SITE.latitude_deg)
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    north = np.array([-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)])
    horizon = np.array([east, north, np.cross(east, north)])
    home = SITE.to_astropy().get_itrs().cartesian.xyz.to_value(u.km)
    worst = 0.0
    for k, instant in enumerate(utc_s):
        light_s = 0.0
        for _ in range(4):
            then = Time(instant, format="unix") - light_s * u.s
            _, km, _ = record.sgp4(then.jd1, then.jd2)
            now = Time(instant, format="unix")
            place = TEME(CartesianRepresentation(km * u.km), obstime=now).transform_to(ITRS(obstime=now))
            away = place.cartesian.xyz.to_value(u.km) - home
            light_s = np.linalg.norm(away) / LIGHT_KM_S
        unit = horizon @ away / np.linalg.norm(away)
        # Diurnal aberration in closed form: the site moves east at 465 m/s times the distance from the axis.
        unit = unit + np.array([7.292115e-5 * math.hypot(home[0], home[1]) / LIGHT_KM_S, 0.0, 0.0])
        worst = max(worst, float(np.linalg.norm(got[k] - unit / np.linalg.norm(unit))) * ARCSEC)
    return worst


def projection(rotation=12.0, mirror=0, beyond=False):
    """Worst difference of stars' pixels from astropy.wcs (TAN), pixels."""
    from astropy.wcs import WCS

    rng = np.random.default_rng(7)
    ha0, dec0, scale = 40.0, 35.0, 2.5
    count = 60
    # Directions about the centre; the judge gets them as angles, the camera as vectors.
    dec = dec0 + rng.uniform(-0.3, 0.3, count)
    ra = -ha0 + rng.uniform(-0.4, 0.4, count)
    directions = directions_of(-ra, dec)
    sky = NightSky(SITE, (), NONE, NO_AIR)
    hidden = Hidden(rotation=rotation, mirror=mirror)
    camera = SkyCamera(sky, SimulatedCamera(scale), hidden, START_S)
    path = resting(ha0 + 180.0, 180.0 - dec0) if beyond else resting(ha0, dec0)
    exposure = camera._exposure(START_S, 0.1, path)
    columns, rows, _ = camera._project(exposure, np.repeat(directions[None], len(exposure.utc_s), axis=0))
    turn = math.radians(rotation + (180.0 if beyond else 0.0))
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    wcs.wcs.crval = [-ha0, dec0]
    wcs.wcs.crpix = [640.5, 480.5]
    # +y lies at the position angle `turn`, and +x, unmirrored, a quarter turn before it.
    right = -1.0 if mirror else 1.0
    cd = [[-right * math.cos(turn), math.sin(turn)], [right * math.sin(turn), math.cos(turn)]]
    wcs.wcs.cd = np.array(cd) * scale / 3600.0
    x, y = wcs.all_world2pix(ra, dec, 1)
    off = np.hypot(columns[0] + 1.0 - x, (960.0 - rows[0]) - y)
    return float(off.max())


def one_star_camera(magnitude=6.0, exposure_s=1.0, **hidden):
    """A camera that stands still, with one star that is in the middle at mid-exposure."""
    stars = lone_star(30.0, 20.0, magnitude, START_S + 0.5 * exposure_s)
    sky = NightSky(SITE, (), stars, NO_AIR)
    quiet = {"hot": 0, "read_noise": 0.0, "sky": 40.0, "full_well": 1e7}
    return SkyCamera(sky, SimulatedCamera(2.5, 320, 240), Hidden(**(quiet | hidden)), START_S)


def electrons(camera, frame):
    """What a picture's steps are in electrons, bias taken off."""
    return (frame.pixels.astype(float) - camera.hidden.bias) * camera.electrons_per_adu(frame.gain)


def light():
    """Flux over 10^(-0.4 (m - zero point)) t; width in arcseconds; streak's length over rate x exposure."""
    camera = one_star_camera(magnitude=3.0, exposure_s=4.0)
    picture = electrons(camera, camera.frame(START_S, 4.0, resting(30.0, 20.0)))
    flux = picture.sum() / (10.0 ** (-0.4 * (3.0 - 20.0)) * 4.0)
    rows, columns = np.indices(picture.shape)
    weight = np.where(picture > 50.0, picture, 0.0)
    weight /= weight.sum()
    x, y = (columns * weight).sum(), (rows * weight).sum()
    along = ((columns - x) ** 2 * weight).sum()
    across = ((rows - y) ** 2 * weight).sum()
    # A pixel is a twelfth of its square wide; a streak of length L has the variance L²/12 along.
    sigma = math.sqrt(max(0.0, across - 1.0 / 12.0))
    length = math.sqrt(12.0 * (along - across))
    # Stars turn once in a sidereal day: 15.041 arcseconds a second at the equator.
    want = 15.041067 * 4.0 * math.cos(math.radians(20.0)) / 2.5
    return flux, sigma * 2.5 * 2.354820, length / want, math.hypot(x - 159.5, y - 119.5)


def noise(level=8.0):
    """Variance over mean in electrons of a plain sky, and read noise of a dark frame over what it is."""
    sky = NightSky(SITE, (), NONE, NO_AIR)
    # The brightness at which a pixel of 2.5 arcseconds gets `level` electrons in a second.
    bright = 20.0 - 2.5 * math.log10(level / 2.5**2)
    hidden = Hidden(hot=0, read_noise=0.0, sky=bright, full_well=5000.0)
    camera = SkyCamera(sky, SimulatedCamera(2.5, 640, 480), hidden, START_S)
    one, two = (electrons(camera, camera.frame(START_S + k, 1.0, resting(0.0, 20.0))) for k in (0, 2))
    share = float(np.var(one - two) / 2.0 / one.mean())
    hidden = Hidden(hot=0, read_noise=3.0, sky=60.0, full_well=5000.0)
    camera = SkyCamera(sky, SimulatedCamera(2.5, 640, 480), hidden, START_S)
    dark = electrons(camera, camera.frame(START_S, 1.0, resting(0.0, 20.0)))
    return share, float(one.mean()) / level, float(dark.std()) / 3.0


def shadow():
    """Seconds between skyfield's and our instants at which the satellite enters or leaves the shadow."""
    from skyfield.api import EarthSatellite, load, load_file

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from skyfield_data import get_skyfield_data_path

        folder = get_skyfield_data_path()
    timescale = load.timescale(builtin=True)
    satellite = EarthSatellite(demo_pass.LINE_1, demo_pass.LINE_2, ts=timescale)
    planets = load_file(f"{folder}/de421.bsp")
    utc_s = START_S + np.arange(0.0, 11000.0, 1.0)
    days = utc_s / 86400.0 + 2440587.5
    with contextlib.closing(planets):
        theirs = satellite.at(timescale.ut1_jd(days)).is_sunlit(planets)
    none = np.zeros_like(utc_s)
    ours = NightSky(SITE, [demo_pass.elements()], NONE, NO_AIR).satellite(0, utc_s, none, none).lit > 0.5
    (a,), (b,) = np.nonzero(np.diff(theirs)), np.nonzero(np.diff(ours))
    return float(np.abs(a - b).max()) if len(a) == len(b) else math.inf


def offsets():
    """Worst difference, arcseconds, of a satellite's offset from what the axes were off by; of its pixels."""
    sky = NightSky(SITE, [demo_pass.elements()], NONE, NO_AIR)
    camera = SkyCamera(sky, SimulatedCamera(), Hidden(hot=0, magnitude=4.0), START_S)
    path = following(sky, 120.0, off_deg=(0.0, 60.0 / 3600.0))
    worst = pixel = 0.0
    for after in (5.0, 60.0, 110.0):
        seen = camera.seen(START_S + after, 0.1, path)
        # The telescope points 60 arcseconds too far north: the satellite is below the centre.
        worst = max(worst, abs(seen.dx_arcsec), abs(seen.dy_arcsec + 60.0))
        picture = electrons(camera, camera.frame(START_S + after, 0.1, path))
        row, column = round(seen.row), round(seen.column)
        part = picture[row - 6 : row + 7, column - 6 : column + 7].clip(0.0)
        rows, columns = np.indices(part.shape)
        y, x = (rows * part).sum() / part.sum(), (columns * part).sum() / part.sum()
        pixel = max(pixel, math.hypot(x + column - 6 - seen.column, y + row - 6 - seen.row))
    return worst, pixel


class SeenMount(SimulatedMount):
    """A simulated mount whose true axes are noted at every turn of its loop."""

    path: TruePath

    def tick(self, now_utc_s):
        status, truth = super().tick(now_utc_s)
        self.path.note(truth)
        return status, truth


def followed(hidden=None, min_alt_deg=10.0, clock=demo_pass.BEFORE_PASS, settled_s=75.0):
    """The practice pass followed in virtual time by the elements alone, and what a camera sees every second.

    Returns the offsets, arcseconds, (n, 2), from `settled_s` after the start: when the pass is followed.
    """
    hidden = Hidden() if hidden is None else hidden
    request = RunRequest("25544", "sim", None, None, clock, min_alt_deg, virtual=True)
    prepared = prepare(dataclasses.replace(request, elements=None, site=None))
    facts = prepared.facts
    command_s, status_s = split_delays_s(hidden, facts.profile)
    delays = SimulatorProfile(command_delay_s=command_s, status_delay_s=status_s)
    place = SimulatedSite(SITE.latitude_deg, SITE.longitude_deg)
    mount = SeenMount(facts.profile, place, hardware=delays)
    mount.path = TruePath(keep_s=3600.0)
    begin_s = facts.started_utc_s
    run = VirtualRun(build_engine(facts), mount, begin_s, NoRecording())
    end_s = run.run()
    air = Refraction(facts.pressure_hpa, facts.temperature_c)
    sky = NightSky(SITE, [demo_pass.elements()], NONE, air)
    zero_deg = sky.hour_angle_zero_deg(mean_sidereal_deg(begin_s, SITE.longitude_deg), begin_s)
    camera = SkyCamera(sky, SimulatedCamera(), hidden, begin_s, hour_angle_zero_deg=zero_deg)
    starts = np.arange(begin_s + settled_s, end_s - 10.0, 1.0)
    seen = [camera.seen(float(start), 0.1, mount.path) for start in starts]
    return np.array([(one.dx_arcsec, one.dy_arcsec) for one in seen])


def solved():
    """Blind solutions by tetra3rs: worst error of the centre, arcseconds, of +y's angle, degrees; mirrors."""
    import tetra3rs
    from astropy.coordinates import SkyCoord

    # Its database would read the magnitudes in the columns of proper motion as such.
    database = tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=6.5, min_fov_deg=5.0, star_max_magnitude=8.0, epoch_proper_motion_year=None
    )
    middle_s = START_S + 0.25
    path = TruePath()
    sidereal_deg_s = 15.041067 / 3600.0
    for t in np.arange(0.0, 1.0, 0.05):
        path.add(float(START_S + t), float(-20.0 + sidereal_deg_s * t), 40.0, sidereal_deg_s, 0.0)
    want = to_icrs(directions_of(-20.0 + sidereal_deg_s * 0.25, 40.0), middle_s)
    pole = to_icrs(directions_of(0.0, 90.0), middle_s)
    north_deg = want.position_angle(pole).deg
    worst, turned, mirrors = 0.0, 0.0, True
    for rotation, mirror in ((0.0, 0), (12.0, 0), (200.0, 0), (12.0, 1)):
        hidden = Hidden(rotation=rotation, mirror=mirror, fwhm=30.0, pressure=0.0)
        camera = SkyCamera(make_sky(SITE, [], hidden, 0), SimulatedCamera(15.0), hidden, START_S)
        picture = camera.frame(START_S, 0.5, path).pixels.astype(np.float32)
        found = tetra3rs.CentroidExtractor().extract(picture)
        solution = database.solve_from_centroids(
            found.centroids, fov_estimate_deg=5.33, image_width=1280, image_height=960, fov_max_error_deg=0.3
        )
        centre = SkyCoord(*solution.pixel_to_world(0.0, 0.0), unit="deg")
        above = SkyCoord(*solution.pixel_to_world(0.0, -50.0), unit="deg")
        worst = max(worst, float(centre.separation(want).arcsec))
        off_deg = math.remainder(centre.position_angle(above).deg - north_deg - rotation, 360.0)
        turned = max(turned, abs(off_deg))
        mirrors = mirrors and solution.parity_flip == bool(mirror)
    return worst, turned, mirrors


def speed():
    """Processor milliseconds of a frame of 1.2 megapixels with some 50 stars, and of an offset."""
    hidden = Hidden(faint=70.0)
    sky = make_sky(SITE, [demo_pass.elements()], hidden, 0)
    camera = SkyCamera(sky, SimulatedCamera(), hidden, START_S)
    path = following(sky, 20.0)
    columns, rows, light_of = camera.stars(START_S + 1.0, 0.1, path)
    stars = (np.abs(columns[0] - 640) < 640) & (np.abs(rows[0] - 480) < 480) & (light_of > 0.0)
    camera.frame(START_S, 0.1, path)
    began = time.process_time()
    for k in range(10):
        camera.frame(START_S + k, 0.1, path)
    frame_s = (time.process_time() - began) / 10
    began = time.process_time()
    for k in range(100):
        camera.seen(START_S + 0.1 * k, 0.1, path)
    return int(stars.sum()), frame_s * 1e3, (time.process_time() - began) * 10.0


def main() -> int:
    print(f"stars against astropy's AltAz              {star_places():.4f} arcsec at most")
    print(f"satellite against astropy's TEME to ITRS   {satellite_places():.4f} arcsec at most")
    print(f"shadow against skyfield                    {shadow():.0f} s at most")
    for name, options in (
        ("", {}),
        (", mirrored", {"mirror": 1}),
        (", beyond the pole", {"beyond": True}),
    ):
        print(f"pixels against astropy.wcs{name:17}{projection(**options):.5f} px at most")
    flux, width, streak, centre = light()
    print(f"light over 10^(-0.4 (m - zero point)) t    {flux:.4f}")
    print(f"width of a star of 5 arcsec                {width:.3f} arcsec")
    print(f"streak over sidereal rate x exposure       {streak:.4f}; its middle {centre:.3f} px off")
    share, mean, dark = noise()
    print(
        f"sky: variance over mean, mean over law     {share:.4f}, {mean:.4f}; read noise over law {dark:.4f}"
    )
    worst, pixel = offsets()
    print(f"offset of the satellite                    {worst:.3f} arcsec off the axes' own, {pixel:.3f} px")
    off = np.hypot(*followed().T)
    rms = math.sqrt((off**2).mean())
    print(f"a pass followed in virtual time            {rms:.3f} arcsec RMS, {off.max():.3f} peak")
    off = np.hypot(*followed(Hidden(split=-20.0)).T)
    print(f"  with statuses 20 ms late                 {off.max():.1f} arcsec peak")
    if importlib.util.find_spec("tetra3rs") is not None:
        centre, turned, mirrors = solved()
        mirror = "right" if mirrors else "WRONG"
        print(
            f"blind solutions by tetra3rs are off by     {centre:.2f} arcsec, {turned:.4f}°; mirror {mirror}"
        )
    stars, frame_ms, offset_ms = speed()
    print(f"a frame of 1280 x 960 with {stars} stars        {frame_ms:.0f} ms; an offset {offset_ms:.2f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Transits of the Sun and the Moon against dense sampling by skyfield with DE421."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tle.bodies import Body
from tle.earth import EarthOrientation
from tle.facts import fact_columns
from tle.instants import Utc
from tle.passes import find_catalogue_passes, find_ephemeris_passes
from tle.site import Site
from tle.sources import read_elements
from tle.transits import find_transits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import Elements
    from tle.transits import Transit

    Array = NDArray[np.float64]

LEIDEN = Site(52.1541, 4.4908)
START = Utc.parse("2026-10-05T12:00:00Z")
DAYS = 2.25
C_KM_S = 299792.458
RADIUS_KM = {"sun": 695700.0, "moon": 1737.4}


@pytest.fixture(scope="module")
def iss() -> Elements:
    (one,) = read_elements(Path(__file__).parents[2] / "examples" / "iss_leiden.tle")
    return one


@pytest.fixture(scope="module")
def found(iss: Elements) -> list[Transit]:
    passes = find_catalogue_passes([iss], LEIDEN, START, 24.0 * DAYS, 10.0)
    return find_transits(passes, fact_columns(passes))


class Sky:
    """Where skyfield has the satellite, the Sun and the Moon from the site."""

    def __init__(self, elements: Elements) -> None:
        from skyfield.api import EarthSatellite, load, wgs84
        from skyfield.jpllib import SpiceKernel

        at = EarthOrientation.installed().orientation(START)
        self.scale = load.timescale(delta_t=69.184 - at.dut1_s)
        self.scale.polar_motion_table = [0.0], [at.xp_arcsec], [at.yp_arcsec]
        kernel = SpiceKernel(str(resources.files("skyfield_data") / "data" / "de421.bsp"))
        self.site = wgs84.latlon(LEIDEN.latitude_deg, LEIDEN.longitude_deg, LEIDEN.height_m)
        self.kernel = kernel
        self.observer, self.bodies = kernel["earth"] + self.site, {name: kernel[name] for name in RADIUS_KM}
        self.satellite = EarthSatellite.from_satrec(elements.satrec(), self.scale)

    def time(self, since_s: Array) -> Any:
        return self.scale.tt_jd(2440587.5 + float(START.unix_s) / 86400.0, (since_s + 69.184) / 86400.0)

    def altitude_deg(self, since_s: Array) -> Array:
        altitude: Array = (self.satellite - self.site).at(self.time(since_s)).altaz()[0].degrees
        return altitude

    def apart(self, body: str, since_s: Array) -> tuple[Array, Array]:
        """Return the separation and the disc's radius, radians; the satellite's light is on its way, too."""
        t, site = self.time(since_s), self.site.at(self.time(since_s))
        delay = np.zeros(len(since_s))
        for _ in range(3):
            way = self.satellite.at(self.time(since_s - delay)).position.km - site.position.km
            delay = np.linalg.norm(way, axis=0) / C_KM_S
        seen = way / np.linalg.norm(way, axis=0) + site.velocity.km_per_s / C_KM_S
        disc = self.observer.at(t).observe(self.bodies[body]).apparent().position.km
        far = np.linalg.norm(disc, axis=0)
        cosine = np.einsum("ij,ij->j", seen / np.linalg.norm(seen, axis=0), disc / far)
        return np.arccos(np.clip(cosine, -1.0, 1.0)), np.arcsin(RADIUS_KM[body] / far)


def sampled(sky: Sky) -> list[tuple[float, str, float, float]]:
    """Return instant, body, separation (degrees) and duration of all transits that sampling shows."""
    # It is above the horizon for more than a minute before it is 9° high.
    minutes = np.arange(0.0, DAYS * 86400.0, 60.0)
    risen = minutes[sky.altitude_deg(minutes) > 0.0]
    coarse = (risen[:, None] + np.arange(-30.0, 30.0, 10.0)).ravel()
    up = coarse[sky.altitude_deg(coarse) > 9.0]
    transits = []
    for body in RADIUS_KM:
        apart, _ = sky.apart(body, up)
        # The satellite goes less than 7° in 5 s.
        near_by = np.r_[True, apart[1:] <= apart[:-1]] & np.r_[apart[:-1] < apart[1:], True]
        for near in up[near_by & (apart < np.radians(7.0))].tolist():
            apart, radius = sky.apart(body, near + np.arange(-5.0, 5.01, 0.1))
            if np.all(apart > radius + np.radians(0.2)):
                # It goes less than 0.07° until the nearest of these instants.
                continue
            fine = near + np.arange(-5.0, 5.01, 0.01)
            apart, radius = sky.apart(body, fine)
            inside = apart < radius
            k = int(np.argmin(apart))
            if inside.any() and 0 < k < len(fine) - 1 and sky.altitude_deg(fine[[k]])[0] > 10.0:
                transits.append((float(fine[k]), body, float(np.degrees(apart[k])), 0.01 * inside.sum()))
    return sorted(transits)


def test_the_transits_are_those_that_dense_sampling_shows(iss: Elements, found: list[Transit]) -> None:
    sky = Sky(iss)
    wanted = sampled(sky)
    sky.kernel.close()
    assert [body for _, body, _, _ in wanted].count("sun") >= 1
    assert [body for _, body, _, _ in wanted].count("moon") >= 1
    assert [one.body.lower() for one in found] == [body for _, body, _, _ in wanted]
    for one, (since_s, _, apart_deg, lasts_s) in zip(found, wanted, strict=True):
        assert float(one.utc.unix_s - START.unix_s) == pytest.approx(since_s, abs=0.02)
        assert one.separation_deg == pytest.approx(apart_deg, abs=2.0 / 3600.0)
        assert one.duration_s == pytest.approx(lasts_s, abs=0.03)


def test_the_strip_on_the_ground_is_where_it_is_seen(iss: Elements, found: list[Transit]) -> None:
    """As far off the middle as half its width, a transit begins to be none; in the middle it is central."""
    one = found[0]
    seen = []
    for off_km in np.linspace(-60.0, 60.0, 25).tolist():
        # One degree of latitude is 111.2 km here; the strip is wide enough for a flat piece of ground.
        site = Site(LEIDEN.latitude_deg + off_km / 111.26, LEIDEN.longitude_deg)
        passes = find_catalogue_passes([iss], site, one.utc.plus(-1800.0), 1.0, 5.0)
        seen += [t.separation_deg / t.radius_deg for t in find_transits(passes, fact_columns(passes))]
    # A north-south line cuts the strip aslant: what it sees is at least as long as the strip is wide.
    assert one.width_km - 5.0 <= 5.0 * len(seen) <= 3.0 * one.width_km
    assert min(seen) < 0.15
    assert one.off_line_km < 0.5 * one.width_km


def test_the_moon_does_not_cross_itself() -> None:
    passes = find_ephemeris_passes([Body("Moon")], LEIDEN, START, 24.0, 10.0)
    assert len(passes.found.obj)
    assert find_transits(passes, fact_columns(passes)) == []


def test_where_sun_and_moon_are_far_there_is_none(iss: Elements) -> None:
    passes = find_catalogue_passes([iss], LEIDEN, START.plus(18.0 * 3600.0), 24.0, 10.0)
    assert len(passes) > 3
    assert find_transits(passes, fact_columns(passes)) == []

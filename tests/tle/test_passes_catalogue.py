"""The passes of many objects, against SGP4 asked every second, skyfield, and the search for one."""

from __future__ import annotations

import gzip
import sys
from dataclasses import replace

import numpy as np
import pytest
from geometry import skyfield_timescale
from hypothesis import given, settings
from hypothesis import strategies as st
from skyfield.api import EarthSatellite, wgs84
from tle_facts import DECAYING, ISS, LEIDEN, MOLNIYA, PARANAL, STARLINK_ALPHA5, TDRS3

from tle.crossings import SURE_S, highest_between
from tle.earth import EarthOrientation, Ground
from tle.elements import Elements
from tle.horizon import Horizon, HorizonMask
from tle.instants import Utc
from tle.near_earth import in_plane, mean_orbit, mean_start, start_near_earth, teme_km
from tle.passes import find_catalogue_passes, find_passes
from tle.prefilter import DeepSpace, can_filter, deep_margin_km, orbit_bounds
from tle.propagator import Propagator
from tle.site import Site
from tle.sources import parse_elements

SETS = (ISS, STARLINK_ALPHA5, MOLNIYA, TDRS3)
START = Utc.parse("2026-10-02")
EARTH = EarthOrientation.fixed(0.05, 0.17, 0.32)


@pytest.fixture(scope="module")
def catalogue(cases):
    text = gzip.decompress((cases / "catalogues" / "spacetrack_full_20250901.tle.gz").read_bytes())
    return [e for e in parse_elements(text.decode()) if isinstance(e, Elements)]


def above_every_second(elements, site, start, hours, horizon):
    """Return seconds since start and whether SGP4 has the satellite above the horizon at each."""
    since = np.arange(0.0, hours * 3600.0, 1.0)
    seen = Propagator(elements, site, earth=EARTH, place="geometric").at(Utc(start.unix_s + since))
    good = seen.error == 0
    with np.errstate(invalid="ignore"):
        return since, good & (seen.alt_deg > horizon.altitude_deg(seen.az_deg))


def epochs(since):
    days = START.unix_s / 86400.0 + 2440587.5
    return np.full(len(since), days), since / 86400.0


def covered_every_second(found, since):
    reported = np.zeros(len(since), dtype=bool)
    for rise, set_ in zip(found.rise_s, found.set_s, strict=True):
        reported |= (since > np.nan_to_num(rise, nan=-1.0)) & (since < np.nan_to_num(set_, nan=1e9))
    return reported


@st.composite
def orbits(draw):
    """Return elements of any orbit with a perigee above 180 km that goes round in at most two days."""
    perigee_km = draw(st.floats(180.0, 3000.0))
    e = draw(st.sampled_from([0.0001, 0.002, 0.02, 0.1, 0.4, 0.72])) * draw(st.floats(0.5, 1.0))
    a = (6378.135 + perigee_km) / (1.0 - e)
    period_s = 2.0 * np.pi * np.sqrt(a**3 / 398600.8)
    angle = st.floats(0.0, 359.99)
    return Elements(
        name="ANY",
        catalog_number=1,
        classification="U",
        designator="",
        epoch=START.plus(draw(st.floats(-5.0, 5.0)) * 86400.0),
        inclination_deg=draw(st.floats(0.0, 179.9)),
        raan_deg=draw(angle),
        eccentricity=e,
        arg_perigee_deg=draw(angle),
        mean_anomaly_deg=draw(angle),
        mean_motion_rev_day=86400.0 / period_s,
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=draw(st.floats(-1e-4, 1e-3)),
    )


@st.composite
def sites(draw):
    latitude = draw(st.sampled_from([-90.0, 90.0, 0.0]) | st.floats(-90.0, 90.0))
    longitude = draw(st.sampled_from([-180.0, 180.0, 179.9999]) | st.floats(-180.0, 180.0))
    return Site(latitude, longitude, draw(st.floats(-400.0, 6000.0)))


def is_as_every_second(elements, site, min_alt_deg):
    passes = find_catalogue_passes([elements], site, START, 12.0, min_alt_deg, earth=EARTH)
    since, above = above_every_second(elements, site, START, 12.0, Horizon(min_alt_deg))
    if passes.failed:
        # Drag has ended the orbit, says SGP4 itself, and nothing was to be seen before that.
        assert elements.satrec().sgp4_array(*epochs(since))[0].any()
        assert not above.any()
        return
    assert (covered_every_second(passes.found, since) == above).all()
    assert (passes.found.max_alt_deg > min_alt_deg).all()


@settings(max_examples=40, deadline=None, derandomize=True)
@given(elements=orbits(), site=sites(), min_alt_deg=st.floats(-5.0, 80.0))
def test_nothing_is_missed_or_invented(elements, site, min_alt_deg):
    is_as_every_second(elements, site, min_alt_deg)


@pytest.mark.parametrize("inclination_deg", [5e-324, 2e-309, 1e-200])
def test_an_inclination_next_to_none_is_none(inclination_deg):
    """SGP4 divides by its sine, and numbers so small give no place."""
    elements = replace(Elements.from_tle(*MOLNIYA), inclination_deg=inclination_deg, epoch=START)
    is_as_every_second(elements, Site(0.0, 0.0, 0.0), 5.0)
    _, above = above_every_second(elements, Site(0.0, 0.0, 0.0), START, 12.0, Horizon(5.0))
    assert above.any()


@pytest.mark.soak
@settings(max_examples=1500, deadline=None)
@given(elements=orbits(), site=sites(), min_alt_deg=st.floats(-5.0, 80.0))
def test_nothing_is_missed_or_invented_in_many_orbits(elements, site, min_alt_deg):
    is_as_every_second(elements, site, min_alt_deg)


SKYLINES = (
    HorizonMask((0.0, 90.0, 180.0, 270.0), (5.0, 25.0, 8.0, 40.0)),
    HorizonMask((100.0, 100.0, 140.0, 140.0), (0.0, 70.0, 70.0, 0.0)),
    HorizonMask((359.9,), (30.0,)),
    HorizonMask((0.0, 40.0, 40.0, 320.0, 320.0, 360.0), (60.0, 60.0, 5.0, 5.0, 60.0, 60.0)),
)


@pytest.mark.parametrize("mask", SKYLINES, ids=["hills", "tower", "one point", "wall across north"])
@pytest.mark.parametrize("lines", SETS, ids=["ISS", "Starlink", "Molniya", "TDRS"])
def test_a_skyline(lines, mask):
    elements, site = Elements.from_tle(*lines), Site(*LEIDEN)
    horizon = Horizon(3.0, mask)
    passes = find_catalogue_passes([elements], site, START, 24.0, horizon, earth=EARTH)
    since, above = above_every_second(elements, site, START, 24.0, horizon)
    assert (covered_every_second(passes.found, since) == above).all()
    alone = find_passes(Propagator(elements, site, earth=EARTH), START, 24.0, 3.0, mask)
    assert len(alone) == len(passes)


@pytest.mark.parametrize("place", [LEIDEN, PARANAL])
def test_many_are_found_as_one_is(place):
    elements, site = [Elements.from_tle(*lines) for lines in SETS], Site(*place)
    passes = find_catalogue_passes(elements, site, START, 48.0, 5.0, earth=EARTH)
    alone = [
        (one, p)
        for one in elements
        for p in find_passes(Propagator(one, site, earth=EARTH), START, 48.0, 5.0)
    ]
    assert [p.elements for p in passes] == [one for one, _ in alone]
    for ours, (_, theirs) in zip(passes, alone, strict=True):
        for name in ("rise_utc", "culminate_utc", "set_utc"):
            one, other = getattr(ours.seen, name), getattr(theirs, name)
            assert (one is None) == (other is None)
            assert one is None or abs(one - other) < 2e-3
        assert ours.seen.max_alt_deg == pytest.approx(theirs.max_alt_deg, abs=1e-5)
        assert len(ours.seen.culminations_utc) == len(theirs.culminations_utc)
    assert passes[-1] == passes.take(np.array([len(passes) - 1]))[0]
    assert passes[1:3] == list(passes)[1:3]


def test_grazing_passes_down_to_the_stated_length():
    site = Site(*LEIDEN)
    elements = Elements.from_tle(*ISS)
    tops = [p.seen.max_alt_deg for p in find_catalogue_passes([elements], site, START, 24.0, 0.0)]
    for top in tops:
        for below_deg in (1e-6, 1e-5, 1e-3, 0.1):
            passes = find_catalogue_passes([elements], site, START, 24.0, top - below_deg)
            assert np.abs(passes.found.max_alt_deg - top).min() < 5e-7
        over = find_catalogue_passes([elements], site, START, 24.0, top + 1e-6)
        assert np.abs(over.found.max_alt_deg - top).min(initial=9.0) > 5e-7
    assert SURE_S <= 1.0


def test_the_parabola_bounds_what_bends_no_more():
    rng = np.random.default_rng(3)
    z0, rate, span = rng.normal(size=500), rng.normal(size=500), rng.uniform(0.1, 3.0, 500)
    c = rng.uniform(0.0, 4.0, 500)
    part = np.linspace(0.0, 1.0, 200)[:, None]
    z = z0 + rate * part * span - 0.5 * c * (part * span) ** 2
    top = highest_between(z[0], z[-1], c, span)
    assert (top >= z.max(axis=0) - 1e-12).all()
    assert np.abs(top - z.max(axis=0)).max() < 1e-3


def test_several_culminations_in_one_pass():
    passes = find_passes(
        Propagator(Elements.from_tle(*MOLNIYA), Site(50.0, 60.0)), Utc.parse("2025-09-02"), 48.0, 0.0
    )
    several = [p for p in passes if len(p.culminations_utc) > 1]
    assert several
    for one in several:
        assert one.culminate_utc in one.culminations_utc


def test_decayed_ones_are_listed_and_the_rest_is_found():
    elements = [Elements.from_tle(*lines) for lines in (DECAYING, ISS)]
    passes = find_catalogue_passes(elements, Site(*LEIDEN), START, 24.0)
    assert [one for one, _ in passes.failed] == elements[:1]
    assert "29141" in str(passes.failed[0][1])
    assert {p.elements.catalog_number for p in passes} == {25544}
    assert len(find_catalogue_passes([], Site(*LEIDEN), START, 24.0)) == 0


def test_our_sgp4_is_vallados(catalogue):
    near = [e for e in catalogue if 2.0 * np.pi / e.satrec().no < 225.0]
    near = sorted(near[::16], key=lambda e: e.eccentricity)
    start_s = Utc.parse("2025-09-01").unix_s
    times = start_s + np.random.default_rng(1).uniform(0.0, 86400.0, len(near))
    c = start_near_earth(near)
    ours = np.stack(teme_km(c, times), axis=1)
    regular = orbit_bounds(c, start_s, 86400.0).regular
    assert regular.mean() > 0.995
    for one, t, place in zip(
        [e for e, r in zip(near, regular, strict=True) if r], times[regular], ours[regular], strict=True
    ):
        jd, fraction = Utc(float(t)).split()
        error, theirs, _ = one.satrec().sgp4(jd, fraction)
        assert error == 0
        assert np.abs(place - theirs).max() < 1e-6


def test_the_mean_orbit_stays_within_its_bound(catalogue):
    near = [e for e in catalogue if 2.0 * np.pi / e.satrec().no < 225.0]
    c = start_near_earth(near[::8])
    start_s = Utc.parse("2025-09-01").unix_s
    bounds = orbit_bounds(c, start_s, 86400.0)
    index = np.flatnonzero(bounds.regular)
    c, bounds = c.take(index), bounds.take(index)
    for since_s in np.linspace(0.0, 86400.0, 7):
        times = np.full(len(index), start_s + since_s)
        place = np.stack(teme_km(c, times))
        orbit = mean_orbit(c, (times - c.epoch_s) / 60.0)
        cosu, sinu, radius, _, _ = in_plane(orbit, exact=True)
        cn, sn, r = np.cos(orbit.node), np.sin(orbit.node), radius * 6378.135
        rough = r * np.stack(
            [cosu * cn - sinu * c.cosio * sn, cosu * sn + sinu * c.cosio * cn, sinu * c.sinio]
        )
        distance = np.linalg.norm(place, axis=0)
        assert (np.linalg.norm(rough - place, axis=0) < bounds.margin_km).all()
        assert (distance > bounds.lowest_km).all()
        assert (distance < bounds.highest_km).all()


def bounded_by_a_closed_form():
    anomaly = np.linspace(0.0, np.pi, 20001)
    for e in np.linspace(0.0, 0.99, 100):
        true = 2.0 * np.arctan(np.sqrt((1.0 + e) / (1.0 - e)) * np.tan(0.5 * anomaly[:-1]))
        yield e, np.max(true - anomaly[:-1] + e * np.sin(anomaly[:-1]))


def test_the_equation_of_the_centre_stays_under_three_eccentricities():
    for e, most in bounded_by_a_closed_form():
        assert most <= 3.0 * e + 1e-12


def axes_km(orbits):
    return (398600.8 * (60.0 / orbits.motion) ** 2) ** (1.0 / 3.0)


def started(orbits):
    return mean_start(orbits.eccentricity, orbits.inclination, orbits.motion)


def mean_places(orbits, ground, span, since_s):
    """Return places east, north, up of the site, km, by Kepler from the span's middle with J2's drift."""
    drift, e = started(orbits), orbits.eccentricity
    minutes = (since_s - 0.5 * span[1]) / 60.0
    mean = orbits.anomaly + drift.mdot * minutes
    anomaly = mean.copy()
    for _ in range(200):
        anomaly -= np.clip((anomaly - e * np.sin(anomaly) - mean) / (1.0 - e * np.cos(anomaly)), -0.9, 0.9)
    true = 2.0 * np.arctan2(
        np.sqrt(1.0 + e) * np.sin(anomaly / 2.0), np.sqrt(1.0 - e) * np.cos(anomaly / 2.0)
    )
    latitude = true + orbits.perigee + drift.argpdot * minutes
    node = orbits.node + drift.nodedot * minutes - ground.turn_rad(span[0], np.array([since_s]))
    along, across = np.cos(latitude), np.sin(latitude) * np.cos(orbits.inclination)
    place = (
        axes_km(orbits)
        * (1.0 - e * np.cos(anomaly))
        * np.stack(
            [
                along * np.cos(node) - across * np.sin(node),
                along * np.sin(node) + across * np.cos(node),
                np.sin(latitude) * np.sin(orbits.inclination),
            ]
        )
    )
    return np.array(ground.axes) @ (place - np.array(ground.place)[:, None])


@pytest.mark.parametrize(("start", "hours"), [("2025-09-01", 24.0), ("2025-10-20", 72.0)])
def test_deep_space_stays_within_the_margin_of_its_prefilter(catalogue, start, hours):
    deep = [e for e in catalogue if e.period_s >= 225.0 * 60.0][::3]
    span = (Utc.parse(start).unix_s, hours * 3600.0)
    ground = Ground(Site(*LEIDEN), EARTH, *span)
    objects = DeepSpace(deep, ground, span)
    orbits = objects.mean_orbits()
    index = np.flatnonzero(can_filter(orbits, span[1]))
    assert len(index) > 0.9 * len(deep)
    orbits = orbits.take(index)
    margin_km = deep_margin_km(orbits, started(orbits), axes_km(orbits), span[1])
    for part in np.linspace(0.0, 1.0, 9):
        rough = mean_places(orbits, ground, span, part * span[1])
        true = objects.places(index, np.full((1, len(index)), part * span[1]))[:, 0]
        off = np.linalg.norm(true - rough, axis=0)
        assert (off < 0.5 * margin_km).all()


def test_skyfield_finds_the_same(catalogue):
    timescale = skyfield_timescale(0.05, 0.17, 0.32)
    start = Utc.parse("2025-09-02")
    chosen = [catalogue[i] for i in np.random.default_rng(7).choice(len(catalogue), 60, replace=False)]
    passes = find_catalogue_passes(chosen, Site(*LEIDEN), start, 12.0, 10.0, earth=EARTH)
    place = wgs84.latlon(*LEIDEN[:2], elevation_m=LEIDEN[2])
    ends = [timescale.tt_jd(start.split()[0], (s + 69.184) / 86400.0) for s in (0.0, 43200.0)]
    compared = 0
    for one in chosen:
        ours = [p.seen for p in passes if p.elements is one]
        peer = EarthSatellite.from_satrec(one.satrec(), timescale)
        times, events = peer.find_events(place, *ends, altitude_degrees=10.0)
        rises = times.tt[events == 0]
        mine = [p.rise_utc for p in ours if p.rise_utc is not None]
        assert len(rises) == len(mine)
        for rise in mine:
            # Its events are good to a tenth of a second: its altitude at ours says more.
            day, fraction = rise.split()
            altitude, _, _ = (peer - place).at(timescale.tt_jd(day, fraction + 69.184 / 86400.0)).altaz()
            rate = Propagator(one, Site(*LEIDEN), earth=EARTH, place="geometric").at(rise).alt_rate_deg_s
            assert abs(altitude.degrees - 10.0) / rate < 0.05
            assert np.abs((rises - day - fraction) * 86400.0 - 69.184).min() < 0.2
            compared += 1
    assert compared > 80


@pytest.mark.parametrize("forks", [True, False])
def test_two_at_work_find_what_one_does(catalogue, forks, monkeypatch):
    monkeypatch.setattr("tle.workers._may_fork", lambda: forks and sys.platform == "linux")
    # Just enough that the work is shared.
    chosen = catalogue[::7]
    reported = []
    one, two = (
        find_catalogue_passes(
            chosen,
            Site(*LEIDEN),
            Utc.parse("2025-09-01"),
            6.0,
            workers=n,
            progress=lambda *a: reported.append(a),
        )
        for n in (1, 2)
    )
    assert np.array_equal(one.found.rise_s, two.found.rise_s, equal_nan=True)
    assert np.array_equal(one.found.obj, two.found.obj)
    assert reported[-1] == (len(chosen), len(chosen))

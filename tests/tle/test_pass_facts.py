"""Light, Sun, Moon, rates and brightness of passes, against the propagator every half second and ERFA."""

from __future__ import annotations

import math
from dataclasses import replace

import erfa
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skyfield.api import EarthSatellite, load, wgs84
from skyfield.framelib import true_equator_and_equinox_of_date
from tle_facts import ISS, LEIDEN, MOLNIYA, STARLINK_ALPHA5, TDRS3

from tle.crossings import least, roots
from tle.elements import Elements
from tle.errors import SourceError
from tle.facts import magnitude, pass_facts, read_magnitudes, sun_altitudes_deg
from tle.instants import Utc
from tle.passes import CataloguePasses, find_catalogue_passes
from tle.propagator import Propagator
from tle.site import Site
from tle.sun import moon_km

START = Utc.parse("2026-10-02T12:00:00Z")
HOURS = 30.0
SITE = Site(*LEIDEN)
LINES = (ISS, STARLINK_ALPHA5, MOLNIYA, TDRS3)
SETS = [Elements.from_tle(*lines) for lines in LINES]
PASSES = find_catalogue_passes(SETS, SITE, START, HOURS, 10.0)
ALONE = [pass_facts(PASSES, [k])[0] for k in range(len(PASSES))]


def looks(one):
    first = one.seen.rise_utc or START
    last = one.seen.set_utc or START.plus(HOURS * 3600.0)
    step_s = 0.5 if last - first < 3600.0 else 5.0
    times = Utc(np.append(np.arange(first.unix_s, last.unix_s, step_s), last.unix_s))
    return Propagator(one.elements, SITE, place="geometric").at(times)


def within(t, intervals):
    slack_s = 1e-3
    ones = [(t > low.unix_s - slack_s) & (t < high.unix_s + slack_s) for low, high in intervals]
    return np.any([np.zeros(len(t), dtype=bool), *ones], axis=0)


def body_direction(place_km, at):
    """Return unit vectors from the site to a body, true of date, by ERFA alone."""
    jd, fraction = at.split()
    tt = fraction + 69.184 / 86400.0
    matrix = erfa.pnm06a(jd, tt)
    theta = erfa.gst06a(jd, fraction, jd, tt) + math.radians(LEIDEN[1])
    phi = math.radians(LEIDEN[0])
    x, _, z = erfa.gd2gc(1, 0.0, phi, LEIDEN[2]) / 1000.0
    site = np.stack([x * np.cos(theta), x * np.sin(theta), np.full_like(theta, z)], axis=1)
    seen = np.einsum("nij,nj->ni", matrix, place_km(jd, tt)) - site
    return seen / np.linalg.norm(seen, axis=1)[:, None]


def least_angle_deg(seen, place_km):
    """Return the least angle from a body: of every twentieth look, and of all about the least of them."""

    def angles(index):
        towards = body_direction(place_km, Utc(seen.utc.unix_s[index]))
        return np.degrees(np.arccos(np.sum(seen.unit[index] * towards, axis=1)))

    count = len(seen.utc)
    some = np.unique(np.append(np.arange(0, count, 20), count - 1))
    best = some[np.argmin(angles(some))]
    return angles(np.arange(max(best - 20, 0), min(best + 21, count))).min()


@pytest.mark.parametrize("index", range(len(PASSES)))
def test_the_facts_of_a_pass(index):
    one, (facts,) = PASSES[index], pass_facts(PASSES, [index])
    seen = looks(one)
    assert facts.peak_ha_rate_deg_s == pytest.approx(np.abs(seen.ha_rate_deg_s).max(), rel=3e-3)
    assert facts.peak_dec_rate_deg_s == pytest.approx(np.abs(seen.dec_rate_deg_s).max(), rel=3e-3)
    for ours, place in (
        (facts.min_sun_separation_deg, lambda a, b: -erfa.epv00(a, b)[0]["p"] * 149597870.7),
        (facts.min_moon_separation_deg, lambda a, b: erfa.moon98(a, b)["p"] * 149597870.7),
    ):
        assert ours == pytest.approx(least_angle_deg(seen, place), abs=0.003)
    # At the border of `sunlit` half of the disc is seen: penumbra, or what is sunlit, on either side.
    t = seen.utc.unix_s
    lit, part = (within(t, intervals) for intervals in (facts.sunlit, facts.penumbra))
    sunlit = np.asarray(seen.sunlit)
    edge = np.abs(np.subtract.outer(t, t[1:][sunlit[1:] != sunlit[:-1]])).min(axis=1, initial=1e9) < 60.0
    assert (sunlit[lit & ~edge]).all()
    assert (~sunlit[~lit & ~part & ~edge]).all()
    if (sunlit[1:] != sunlit[:-1]).any():
        assert part.any()


def assert_same(one, other):
    """Check that two facts of a pass are the same to what fitted polynomials and found roots may miss."""
    for name in (
        "sun_alt_deg",
        "min_sun_separation_deg",
        "min_moon_separation_deg",
        "peak_ha_rate_deg_s",
        "peak_dec_rate_deg_s",
    ):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-5)
    for name in ("sunlit", "penumbra"):
        edges, others = ([t.unix_s for pair in getattr(f, name) for t in pair] for f in (one, other))
        assert edges == pytest.approx(others, abs=0.02)


def test_facts_on_the_searchs_arcs_are_those_by_sgp4():
    found = PASSES.found
    assert 0 < np.isnan(found.arc[:, 0]).sum() < len(PASSES) / 2
    without = CataloguePasses(PASSES.search, replace(found, arc=np.full_like(found.arc, np.nan)), [])
    for one, other in zip(ALONE, pass_facts(without), strict=True):
        assert_same(one, other)


@given(st.permutations(range(len(PASSES))), st.integers(1, len(PASSES)))
@settings(max_examples=15, deadline=None)
def test_the_facts_of_a_pass_do_not_depend_on_other_passes(order, count):
    for index, facts in zip(order[:count], pass_facts(PASSES, order[:count]), strict=True):
        assert_same(facts, ALONE[index])


@pytest.mark.parametrize("names", [(3, 2, 1, 0), (1, 0), (0, 3), (0,)])
def test_the_facts_of_a_pass_do_not_depend_on_what_else_is_in_the_file(names):
    found = find_catalogue_passes([SETS[k] for k in names], SITE, START, HOURS, 10.0)
    for k in names:
        ours = [f for p, f in zip(found, pass_facts(found), strict=True) if p.elements == SETS[k]]
        alone = [f for p, f in zip(PASSES, ALONE, strict=True) if p.elements == SETS[k]]
        assert len(ours) == len(alone) > 0
        for one, other in zip(ours, alone, strict=True):
            assert_same(one, other)


@pytest.mark.parametrize("index", range(len(PASSES)))
def test_skyfield_and_erfa_see_the_same_however_a_pass_stands_among_others(index):
    timescale, one = load.timescale(builtin=True), PASSES[index]
    order = [index, *((index + apart) % len(PASSES) for apart in (1, 5, 11))]
    facts = pass_facts(PASSES, order)[0]
    first = one.seen.rise_utc or START
    last = one.seen.set_utc or START.plus(HOURS * 3600.0)
    at = Utc(np.linspace(first.unix_s, last.unix_s, 400))
    jd, fraction = at.split()
    lines = LINES[SETS.index(one.elements)]
    peer = EarthSatellite(*lines, ts=timescale) - wgs84.latlon(*LEIDEN[:2], LEIDEN[2])
    there = peer.at(timescale.tt_jd(jd, fraction + 69.184 / 86400.0))
    xyz = there.frame_xyz(true_equator_and_equinox_of_date).km
    units = (xyz / np.linalg.norm(xyz, axis=0)).T
    for ours, place in (
        (facts.min_sun_separation_deg, lambda a, b: -erfa.epv00(a, b)[0]["p"] * 149597870.7),
        (facts.min_moon_separation_deg, lambda a, b: erfa.moon98(a, b)["p"] * 149597870.7),
    ):
        towards = body_direction(place, at)
        angles = np.degrees(np.arccos(np.sum(units * towards, axis=1)))
        # Between looks so near each other, at most half of what the satellite goes from one to the next.
        step = np.degrees(np.linalg.norm(np.diff(units, axis=0), axis=1)).max()
        assert angles.min() - step < ours < angles.min() + 0.02
    dec, ha = np.arcsin(units[:, 2]), np.unwrap(np.arctan2(units[:, 1], units[:, 0]))
    slope_s = np.diff(at.unix_s)
    ha_rate = np.degrees(7.292115855e-5 - np.diff(ha) / slope_s)
    assert facts.peak_ha_rate_deg_s == pytest.approx(np.abs(ha_rate).max(), rel=0.02)
    assert facts.peak_dec_rate_deg_s == pytest.approx(
        np.degrees(np.abs(np.diff(dec) / slope_s)).max(), rel=0.02
    )


def test_the_altitude_of_the_sun():
    facts = pass_facts(PASSES)
    sun = [f.sun_alt_deg for f, p in zip(facts, PASSES, strict=True)]
    assert len(sun) == len(PASSES)
    for one, alt in zip(PASSES, sun, strict=True):
        at = Utc(np.array([one.seen.culminate_utc.unix_s]))
        towards = body_direction(lambda a, b: -erfa.epv00(a, b)[0]["p"] * 149597870.7, at)[0]
        theta = erfa.gst06a(*at.split(), at.split()[0], at.split()[1] + 69.184 / 86400.0) + math.radians(
            LEIDEN[1]
        )
        phi = math.radians(LEIDEN[0])
        up = np.array([math.cos(phi) * np.cos(theta[0]), math.cos(phi) * np.sin(theta[0]), math.sin(phi)])
        assert alt == pytest.approx(math.degrees(math.asin(up @ towards)), abs=0.001)


def test_the_quick_altitude_of_the_sun_is_that_of_the_facts():
    assert sun_altitudes_deg(PASSES) == pytest.approx([f.sun_alt_deg for f in pass_facts(PASSES)], abs=1e-9)


def test_progress_comes_to_its_end():
    reported = []
    pass_facts(PASSES, progress=lambda *counts: reported.append(counts))
    assert reported[-1] == (len(PASSES), len(PASSES))


def test_magnitudes_are_told_only_where_known():
    facts = pass_facts(PASSES, magnitudes={25544: -1.8})
    for one, fact in zip(PASSES, facts, strict=True):
        known = one.elements.catalog_number == 25544 and (fact.sunlit or fact.penumbra)
        assert (fact.magnitude is not None) == bool(known)
    assert all(f.magnitude is None for f in pass_facts(PASSES))


def test_a_diffuse_sphere():
    assert magnitude(4.0, 1000.0, math.pi / 2.0) == pytest.approx(4.0)
    assert magnitude(4.0, 2000.0, math.pi / 2.0) == pytest.approx(5.505, abs=1e-3)
    # Fully lit it is pi times as bright as half lit.
    assert magnitude(4.0, 1000.0, 0.0) == pytest.approx(4.0 - 2.5 * math.log10(math.pi))


def test_a_list_of_magnitudes(tmp_path):
    path = tmp_path / "known.txt"
    path.write_text("# number, magnitude, name\n25544 -1.8 ISS\n\n20580, 2.2\n")
    assert read_magnitudes(path) == {25544: -1.8, 20580: 2.2}
    path.write_text("25544 -1.8\n20580 bright\n")
    with pytest.raises(SourceError, match=r"known\.txt:2: '20580 bright' is no magnitude"):
        read_magnitudes(path)
    path.write_text("-5 1.0\n")
    with pytest.raises(SourceError, match=r"known\.txt:1: '-5 1\.0' is no magnitude"):
        read_magnitudes(path)
    with pytest.raises(SourceError, match="cannot read magnitudes"):
        read_magnitudes(tmp_path / "nothing")


def test_the_moon_is_where_the_almanac_has_it():
    # New Moon of the solar eclipse of 2026-08-12, greatest at 17:46 UTC: under 1.6° from the Sun.
    at = Utc.parse("2026-08-12T17:46:00Z")
    jd, fraction = at.split()
    sun = -erfa.epv00(jd, fraction + 69.184 / 86400.0)[0]["p"]
    moon = moon_km(at)
    cosine = sun @ moon / np.linalg.norm(sun) / np.linalg.norm(moon)
    assert math.degrees(math.acos(cosine)) < 1.6
    assert 350000.0 < np.linalg.norm(moon) < 410000.0


def test_roots_and_valleys():
    low, high = np.array([0.0, 1.0, -3.0]), np.array([2.0, 5.0, 3.0])
    wanted = np.array([1.25, 4.9, -2.0])
    assert roots(lambda x: (x - wanted) ** 3, low, high, 1e-9) == pytest.approx(wanted, abs=1e-3)
    assert roots(lambda x: np.expm1(wanted - x), low, high, 1e-9) == pytest.approx(wanted, abs=1e-9)
    where, what = least(lambda x: np.abs(x - wanted), low, high, 40)
    assert where == pytest.approx(wanted, abs=1e-7)
    assert what == pytest.approx(0.0, abs=1e-7)

"""Directions against others' tables: reference tracks, JPL Horizons, measured Doppler, skyfield."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from geometry import skyfield_timescale
from skyfield.api import EarthSatellite, wgs84
from skyfield.framelib import true_equator_and_equinox_of_date
from tle_facts import (
    ISS,
    LEIDEN,
    LEIDEN_ORIENTATION,
    LEIDEN_TRACK,
    MOLNIYA,
    PARANAL,
    TDRS3,
    separation_arcsec,
    unit,
)

from tle.bias import Bias
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site
from tle.sources import load_elements, read_elements

TRACKS = (
    "01_iss_leiden_high",
    "05_starlink_paranal",
    "06_tdrs3_gso_6h",
    "08_molniya_24h",
    "12_sixdigit_100534",
    "14_ra_wrap_0_24h",
)
DIRECTION_ARCSEC, RATE_ARCSEC_S = 0.05, 0.02


class Track:
    """A reference track: its elements, site, Earth orientation and columns."""

    def __init__(self, folder, tag):
        entry = next(e for e in json.loads((folder / "manifest.json").read_text()) if e["tag"] == tag)
        self.elements = Elements.from_tle(entry["line1"], entry["line2"])
        self.site = Site(entry["lat_deg"], entry["lon_deg"], entry["h_m"])
        self.fixed = EarthOrientation.fixed(entry["dut1_s"], entry["xp_as"], entry["yp_as"])
        with (folder / f"{tag}.csv").open() as file:
            rows = list(csv.DictReader(file))
        self.columns = {k: np.array([float(r[k]) for r in rows]) for k in rows[0] if k != "utc"}
        self.utc = Utc.of([Utc.parse(r["utc"]).unix_s for r in rows])
        assert len(rows) == entry["n"]


@pytest.mark.parametrize("tag", TRACKS)
@pytest.mark.parametrize("orientation", ["of the manifest", "of the IERS"])
def test_reference_tracks(cases, tag, orientation):
    track = Track(cases / "tracks", tag)
    earth = track.fixed if orientation == "of the manifest" else None
    c = track.columns
    for place, prefix in (("geometric", "geo"), ("apparent", "app")):
        seen = Propagator(track.elements, track.site, earth=earth, place=place).at(track.utc)
        off = separation_arcsec(seen.ra_deg, seen.dec_deg, c[f"{prefix}_ra_deg"], c[f"{prefix}_dec_deg"])
        assert off.max() < DIRECTION_ARCSEC
        off = separation_arcsec(seen.az_deg, seen.alt_deg, c[f"{prefix}_az_deg"], c[f"{prefix}_alt_deg"])
        assert off.max() < DIRECTION_ARCSEC
        across = 3600.0 * np.cos(np.radians(seen.dec_deg))
        assert np.abs(seen.ra_rate_deg_s * across - c[f"{prefix}_dra_cosdec_asps"]).max() < RATE_ARCSEC_S
        assert np.abs(seen.dec_rate_deg_s * 3600.0 - c[f"{prefix}_ddec_asps"]).max() < RATE_ARCSEC_S
    seen = Propagator(track.elements, track.site, earth=earth, place="geometric").at(track.utc)
    assert np.abs(seen.ra_rate_deg_s * 3600.0 / c["geo_dra_asps"] - 1.0).max() < 1e-5
    across = 3600.0 * np.cos(np.radians(seen.alt_deg))
    assert np.abs(seen.az_rate_deg_s * across - c["geo_daz_cosalt_asps"]).max() < RATE_ARCSEC_S
    assert np.abs(seen.alt_rate_deg_s * 3600.0 - c["geo_dalt_asps"]).max() < RATE_ARCSEC_S
    assert np.abs(seen.range_km - c["geo_range_km"]).max() < 1e-3
    assert np.abs(seen.range_rate_km_s - c["geo_range_rate_kmps"]).max() < 1e-5
    seen = Propagator(track.elements, track.site, earth=earth, place="astrometric").at(track.utc)
    off = separation_arcsec(seen.ra_deg, seen.dec_deg, c["ast_ra_icrs_deg"], c["ast_dec_icrs_deg"])
    assert off.max() < DIRECTION_ARCSEC


@pytest.mark.parametrize("row", LEIDEN_TRACK, ids=lambda row: row[0])
def test_the_pass_over_leiden(row):
    utc, equatorial, horizontal, apparent, astrometric = row
    earth = EarthOrientation.fixed(*LEIDEN_ORIENTATION)
    geometric = Propagator(Elements.from_tle(*ISS), Site(*LEIDEN), earth=earth, place="geometric")
    seen = geometric.at(Utc.parse(utc))
    assert separation_arcsec(seen.ra_deg, seen.dec_deg, *equatorial[:2]) < 0.002
    across = 3600.0 * np.cos(np.radians(seen.dec_deg))
    assert seen.ra_rate_deg_s * across == pytest.approx(equatorial[2], abs=0.002)
    assert seen.dec_rate_deg_s * 3600.0 == pytest.approx(equatorial[3], abs=0.002)
    assert separation_arcsec(seen.az_deg, seen.alt_deg, *horizontal[:2]) < 0.002
    assert (seen.range_km, seen.range_rate_km_s) == pytest.approx(horizontal[2:], abs=1e-5)
    for place, wanted in (("apparent", apparent), ("astrometric", astrometric)):
        seen = geometric.with_place(place).at(Utc.parse(utc))
        assert separation_arcsec(seen.ra_deg, seen.dec_deg, *wanted) < 0.002


def test_horizons(cases):
    folder = cases / "horizons_starlink"
    by_name = {}
    for one in load_elements(folder / "starlink.15JUL2021").accepted:
        by_name.setdefault(one.name, []).append(one)
    site = Site(48.519974, 236.582994, 244.2)
    worst = []
    for line in (folder / "dat").read_text().splitlines():
        name, rest = line.split(".txt: ")
        if name in by_name:
            worst.append(_off_horizons(rest, by_name[name], site))
    assert len(worst) == 809
    direction, ra_rate, dec_rate, altitude, distance, speed = np.abs(np.array(worst)).max(axis=0)
    assert direction < 0.5
    assert max(ra_rate, dec_rate) < 0.25
    assert altitude < 0.8
    assert distance < 0.1
    assert speed < 1e-3


def _off_horizons(row, candidates, site):
    """Return how far the nearest candidate is from a row: arcsec, arcsec/s twice, arcsec, km, km/s.

    Horizons' directions are astrometric; its rates are those of apparent RA (times cos Dec) and Dec, an hour.
    """
    months = {"Jul": "07"}
    year, month, day = row[:11].split("-")
    t = Utc.parse(f"{year}-{months[month]}-{day}T{row[12:24]}Z")
    words = row[24:].split()
    words = words if re.match(r"\d", words[0]) else words[1:]
    ra_deg = 15.0 * (float(words[0]) + float(words[1]) / 60.0 + float(words[2]) / 3600.0)
    dec_deg = float(words[3][1:]) + float(words[4]) / 60.0 + float(words[5]) / 3600.0
    dec_deg = -dec_deg if words[3][0] == "-" else dec_deg
    nearest = None
    for one in candidates:
        propagator = Propagator(one, site)
        astrometric, apparent = propagator.with_place("astrometric").at(t), propagator.at(t)
        across = np.cos(np.radians(apparent.dec_deg))
        off = (
            separation_arcsec(astrometric.ra_deg, astrometric.dec_deg, ra_deg, dec_deg),
            apparent.ra_rate_deg_s * 3600.0 * across - float(words[6]) / 3600.0,
            apparent.dec_rate_deg_s * 3600.0 - float(words[7]) / 3600.0,
            (apparent.alt_deg - float(words[9])) * 3600.0,
            astrometric.range_km - float(words[15]) * 149597870.7,
            astrometric.range_rate_km_s - float(words[16]),
        )
        nearest = off if nearest is None or off[0] < nearest[0] else nearest
    return nearest


@pytest.mark.parametrize(
    ("day", "closest", "late_s"),
    [("15", "2022-01-15T18:11:26Z", 9.0), ("16", "2022-01-16T17:58:56Z", 1.9)],
)
def test_measured_doppler(cases, day, closest, late_s):
    folder = cases / "doppler_delfi_pq"
    (elements,) = read_elements(folder / f"satnogs-2022-01-{day}-DELFI-PQ.tle")
    mjd, hertz = np.loadtxt(folder / f"2022-01-{day}_ATA_DELFI-PQ.dat", usecols=(0, 1), unpack=True)
    times = Utc.of((mjd - 40587.0) * 86400.0)
    propagator = Propagator(elements, Site(40.8175, -121.4733, 1008.0))

    def misfit(along_s):
        shift = 1.0 - propagator.at(times, Bias(along_s)).range_rate_km_s / 299792.458
        carrier = (shift @ hertz) / (shift @ shift)
        return np.sqrt(np.mean((hertz - carrier * shift) ** 2))

    tried = np.arange(-20.0, 20.0, 0.05)
    best = tried[np.argmin([misfit(a) for a in tried])]
    assert -best == pytest.approx(late_s, abs=0.5)
    assert misfit(best) < 100.0
    around = Utc.range(Utc.parse(closest).plus(-60.0), Utc.parse(closest).plus(60.0), 0.1)
    nearest = around[int(np.argmin(propagator.at(around).range_km))]
    assert abs(nearest - Utc.parse(closest)) < 1.0


@pytest.mark.parametrize("lines", [ISS, MOLNIYA, TDRS3])
@pytest.mark.parametrize("place", [LEIDEN, PARANAL])
def test_skyfield_with_the_same_earth_orientation(lines, place):
    elements = Elements.from_tle(*lines)
    dut1_s, xp, yp = 0.05, 0.17, 0.32
    timescale = skyfield_timescale(dut1_s, xp, yp)
    moments = elements.epoch.unix_s + np.linspace(0.0, 86400.0, 50)
    peer = EarthSatellite(*lines, ts=timescale) - wgs84.latlon(place[0], place[1], place[2])

    def theirs(unix_s):
        days = np.floor(unix_s / 86400.0)
        tt = timescale.tt_jd(days + 2440587.5, (unix_s - days * 86400.0 + 37.0 + 32.184) / 86400.0)
        dec, ra, distance, *_ = peer.at(tt).frame_latlon_and_rates(true_equator_and_equinox_of_date)
        return unit(ra.degrees, dec.degrees).T, distance.km

    earth = EarthOrientation.fixed(dut1_s, xp, yp)
    seen = Propagator(elements, Site(*place), earth=earth, place="geometric").at(Utc(moments))
    directions, distances = theirs(moments)
    assert np.degrees(np.linalg.norm(seen.unit - directions, axis=1)).max() * 3600.0 < 0.02
    assert np.abs(seen.range_km - distances).max() < 0.01
    # Differences of its positions: skyfield's rates are made of SGP4's own velocities, up to 1 m/s off here.
    (later, farther), (sooner, nearer) = theirs(moments + 0.25), theirs(moments - 0.25)
    rates = (later - sooner) / 0.5
    assert np.degrees(np.linalg.norm(seen.unit_rate - rates, axis=1)).max() * 3600.0 < 0.02
    assert np.abs(seen.range_rate_km_s - (farther - nearer) / 0.5).max() < 1e-5

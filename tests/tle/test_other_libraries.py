"""skyfield's and astropy's objects taken and given; directions and frames against those libraries' own."""

from __future__ import annotations

import sys
from datetime import UTC, datetime

import astropy_iers_data
import numpy as np
import pytest
from astropy import units
from astropy.coordinates import ICRS, ITRS, TEME, TETE, AltAz, CartesianRepresentation, EarthLocation
from astropy.time import Time as AstropyTime
from astropy.utils import iers
from sgp4.api import WGS84, Satrec
from skyfield.api import EarthSatellite, iers2010, load, wgs84
from tle_facts import ISS, LEIDEN, MOLNIYA, PARANAL, STARLINK_ALPHA5, TDRS3, separation_arcsec

from tle.bias import Bias
from tle.earth import EarthOrientation, earth_orientation_age
from tle.elements import Elements, expected_along_s
from tle.errors import ElementsError, PackageError, SiteError, UnwritableError
from tle.instants import Utc, as_utc
from tle.observed import bias_from_observation
from tle.passes import find_catalogue_passes, find_passes
from tle.propagator import Propagator
from tle.site import Site
from tle.skyfield import from_skyfield, to_skyfield

ALL = (ISS, MOLNIYA, TDRS3, STARLINK_ALPHA5)
T = Utc.parse("2026-10-02T13:05:24.25Z")
# As a Time of astropy: TAI is 37 s, TT 69.184 s ahead of UTC since 2017.
ATOMIC = {"utc": "2026-10-02T13:05:24.25", "tai": "2026-10-02T13:06:01.25", "tt": "2026-10-02T13:06:33.434"}


@pytest.fixture(scope="module")
def builtin():
    return load.timescale(builtin=True)


@pytest.fixture
def offline():
    table = iers.IERS_A.open(astropy_iers_data.IERS_A_FILE)
    with iers.conf.set_temp("auto_download", False), iers.earth_orientation_table.set(table):
        yield


@pytest.mark.parametrize("lines", ALL)
def test_a_satellite_of_skyfield_has_the_elements_of_its_lines(lines, builtin):
    assert from_skyfield(EarthSatellite(*lines, ts=builtin)) == Elements.from_tle(*lines)
    named = from_skyfield(EarthSatellite(*lines, name=" NAME ", ts=builtin))
    assert named == Elements.from_tle(*lines, "NAME")


@pytest.mark.parametrize("lines", ALL)
def test_elements_become_the_satellite_that_skyfield_makes_of_the_lines(lines, builtin):
    elements = Elements.from_tle(*lines, "NAME")
    given, made = EarthSatellite(*lines, name="NAME", ts=builtin), to_skyfield(elements, builtin)
    assert from_skyfield(made) == elements
    assert (made.name, made.target, made.target_name) == (given.name, given.target, given.target_name)
    for field in ("satnum", "intldesg", "classification", "elnum", "revnum", "ephtype", "bstar", "no_kozai"):
        assert getattr(made.model, field) == getattr(given.model, field), field
    t = builtin.utc(2026, 10, 2, 13, 5, 24.25)
    assert np.array_equal(made.at(t).position.km, given.at(t).position.km)


def test_a_satellite_by_omm_has_its_elements(builtin):
    fields = {
        "OBJECT_NAME": "ISS (ZARYA)", "OBJECT_ID": "1998-067A", "EPOCH": "2026-10-02T00:19:52.567968",
        "MEAN_MOTION": "15.48707684", "ECCENTRICITY": ".0006946", "INCLINATION": "51.6312",
        "RA_OF_ASC_NODE": "131.4121", "ARG_OF_PERICENTER": "211.9293", "MEAN_ANOMALY": "148.1275",
        "EPHEMERIS_TYPE": "0", "CLASSIFICATION_TYPE": "U", "NORAD_CAT_ID": "25544", "ELEMENT_SET_NO": "999",
        "REV_AT_EPOCH": "58831", "BSTAR": ".76743E-4", "MEAN_MOTION_DOT": ".3738E-4", "MEAN_MOTION_DDOT": "0",
    }  # fmt: skip
    elements = from_skyfield(EarthSatellite.from_omm(builtin, fields))
    assert (elements.name, elements.catalog_number, elements.designator) == (
        "ISS (ZARYA)",
        25544,
        "1998-067A",
    )
    assert (elements.raan_deg, elements.mean_motion_rev_day) == (131.4121, 15.48707684)
    assert elements.mean_motion_dot_rev_day2 == 0.3738e-4
    assert abs(elements.epoch - Utc.parse(fields["EPOCH"])) < 1e-6


def test_what_is_no_usual_satellite_or_place_is_refused(builtin):
    record = Satrec.twoline2rv(*ISS, WGS84)
    with pytest.raises(ElementsError, match=r"25544 is not .* improved mode with WGS 72"):
        from_skyfield(EarthSatellite.from_satrec(record, builtin))
    with pytest.raises(SiteError, match="another ellipsoid"):
        from_skyfield(iers2010.latlon(52.0, 4.0))
    with pytest.raises(UnwritableError, match="339999"):
        to_skyfield(Elements(**{**_fields(Elements.from_tle(*ISS)), "catalog_number": 340_000}), builtin)
    for convert in (from_skyfield, to_skyfield):
        with pytest.raises(TypeError, match="5 is no"):
            convert(5)


def _fields(elements):
    return {name: getattr(elements, name) for name in Elements.__dataclass_fields__}


def test_a_propagator_says_how_to_bring_what_is_skyfields(builtin):
    satellite = EarthSatellite(*ISS, None, builtin)
    with pytest.raises(ElementsError, match="from_skyfield makes ours"):
        Propagator(satellite, LEIDEN)
    with pytest.raises(SiteError, match="from_skyfield makes ours"):
        Propagator(from_skyfield(satellite), wgs84.latlon(52.0, 4.0))


@pytest.mark.parametrize("place", [LEIDEN, PARANAL])
def test_places_of_skyfield_are_sites(place):
    latlon = wgs84.latlon(*place[:2], elevation_m=place[2])
    site = from_skyfield(latlon)
    assert (site.latitude_deg, site.longitude_deg, site.height_m) == pytest.approx(place, abs=1e-12)
    assert np.abs(latlon.itrs_xyz.km - site.itrs_km).max() < 1e-6
    assert np.array_equal(to_skyfield(site).itrs_xyz.km, latlon.itrs_xyz.km)


def test_times_of_skyfield_are_instants(builtin):
    theirs = builtin.utc(2026, 10, 2, 13, 5, 24.25)
    assert abs(from_skyfield(theirs) - T) < 1e-6
    assert to_skyfield(T, builtin).utc_iso(places=3) == "2026-10-02T13:05:24.250Z"
    many = builtin.utc(2026, 10, 2, 13, 5, [24.25, 25.25])
    assert np.abs(as_utc(many) - Utc.of([T.unix_s, T.unix_s + 1.0])).max() < 1e-6
    assert np.abs(from_skyfield(to_skyfield(as_utc(many), builtin)) - as_utc(many)).max() < 1e-6


@pytest.mark.filterwarnings("ignore:ERFA function")  # of years whose leap seconds nobody knows
@pytest.mark.parametrize(
    ("clock", "expected"),
    [
        ((2016, 12, 31, 23, 59, 59.5), "2016-12-31T23:59:59.5Z"),
        ((2016, 12, 31, 23, 59, 60.5), "2017-01-01T00:00:00.5Z"),
        ((2017, 1, 1, 0, 0, 0.5), "2017-01-01T00:00:00.5Z"),
        ((2050, 7, 1, 6, 0, 0.0), "2050-07-01T06:00:00Z"),
    ],
)
def test_leap_seconds_count_on_past_midnight(clock, expected, builtin):
    assert abs(as_utc(builtin.utc(*clock)) - Utc.parse(expected)) < 1e-6
    year, month, day, hour, minute, second = clock
    text = f"{year}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:06.3f}"
    theirs = AstropyTime(text, scale="utc").tai
    assert abs(as_utc(theirs) - Utc.parse(expected)) < 1e-6


@pytest.mark.parametrize("scale", ["utc", "tai", "tt"])
def test_times_of_astropy_are_instants(scale):
    theirs = AstropyTime(ATOMIC[scale], scale=scale)
    assert abs(as_utc(theirs) - T) < 1e-6
    assert as_utc(AstropyTime([ATOMIC[scale]] * 2, scale=scale)).unix_s.shape == (2,)
    back = T.to_astropy()
    assert (back.scale, back.isot) == ("utc", "2026-10-02T13:05:24.250")
    assert (
        abs(as_utc(Utc.of([T.unix_s, 1483228799.5]).to_astropy()) - Utc.of([T.unix_s, 1483228799.5])).max()
        < 1e-6
    )
    assert Utc(1483228799.5).to_astropy().isot == "2016-12-31T23:59:59.500"


def test_an_instant_of_any_kind_is_taken_everywhere(builtin):
    elements, site = Elements.from_tle(*ISS), Site(*LEIDEN)
    propagator = Propagator(elements, site)
    seen = propagator.at(T)
    kinds = (
        datetime(2026, 10, 2, 13, 5, 24, 250000, tzinfo=UTC),
        AstropyTime(ATOMIC["utc"], scale="utc"),
        builtin.utc(2026, 10, 2, 13, 5, 24.25),
    )
    for t in kinds:
        assert propagator.at(t).ra_deg == pytest.approx(seen.ra_deg, abs=1e-6)
        assert elements.age_s(t) == pytest.approx(T - elements.epoch, abs=1e-5)
        assert expected_along_s(elements, t) == pytest.approx(expected_along_s(elements, T))
        (first, *_), (same, *_) = find_passes(propagator, t, 24.0), find_passes(propagator, T, 24.0)
        assert abs(first.culminate_utc - same.culminate_utc) < 1e-3
        assert len(find_catalogue_passes([elements], site, t, 24.0)) > 0
        assert earth_orientation_age(t).age_s == pytest.approx(earth_orientation_age(T).age_s, abs=1e-5)
        sidereal = propagator.earth.local_apparent_sidereal_deg
        assert sidereal(t, site) == pytest.approx(sidereal(T, site), abs=1e-6)
        assert Bias(1.0, along_rate=0.1, epoch=t).along_at_s(T.unix_s) == pytest.approx(1.0, abs=1e-6)
        estimate = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, t)
        assert estimate.along_s == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("lines", ALL)
@pytest.mark.parametrize("place", [LEIDEN, PARANAL])
def test_directions_are_skyfields_with_the_same_earth_orientation(lines, place, builtin):
    elements, site = Elements.from_tle(*lines), Site(*place)
    times = Utc(elements.epoch.unix_s + np.linspace(0.0, 86400.0, 50))
    installed = EarthOrientation.installed()
    for earth, timescale in ((installed, to_skyfield(installed)), (from_skyfield(builtin), builtin)):
        ours = Propagator(elements, site, earth=earth, place="geometric").at(times)
        peer = EarthSatellite(*lines, ts=timescale) - wgs84.latlon(*place[:2], elevation_m=place[2])
        theirs = peer.at(to_skyfield(times, timescale))
        ra, dec, distance = theirs.radec("date")
        altitude, azimuth, _ = theirs.altaz()
        assert separation_arcsec(ours.ra_deg, ours.dec_deg, ra.hours * 15.0, dec.degrees).max() < 1e-3
        assert separation_arcsec(ours.az_deg, ours.alt_deg, azimuth.degrees, altitude.degrees).max() < 1e-3
        assert np.abs(ours.range_km - distance.km).max() < 1e-5


def test_skyfields_own_table_of_ut1_is_what_sets_directions_apart(builtin):
    # The Earth's turn in the difference of UT1, along the equator: what the docstring calls 10″ and more.
    ours, theirs = EarthOrientation.installed().orientation(T), from_skyfield(builtin).orientation(T)
    elements = Elements.from_tle(*STARLINK_ALPHA5)
    place = wgs84.latlon(*PARANAL[:2], elevation_m=PARANAL[2])
    times = Utc(elements.epoch.unix_s + np.linspace(0.0, 86400.0, 500))
    peer = (EarthSatellite(*STARLINK_ALPHA5, ts=builtin) - place).at(to_skyfield(times, builtin))
    ra, dec, _ = peer.radec("date")
    seen = Propagator(elements, Site(*PARANAL), place="geometric").at(times)
    apart = separation_arcsec(seen.ra_deg, seen.dec_deg, ra.hours * 15.0, dec.degrees)
    assert abs(ours.dut1_s - theirs.dut1_s) > 0.02
    assert 10.0 < apart.max() < 30.0


def test_a_timescale_and_an_earth_orientation_hold_the_same(builtin):
    installed = EarthOrientation.installed()
    timescale = to_skyfield(installed)
    for text in ("1980-03-01T12:00:00Z", "2016-12-30T12:00:00Z", "2026-10-02T18:00:00Z"):
        t = Utc.parse(text)
        theirs, ours = to_skyfield(t, timescale), installed.orientation(t)
        _, x, y = theirs.polar_motion_angles()
        assert float(theirs.dut1) == pytest.approx(ours.dut1_s, abs=1e-6)
        assert (float(x), float(y)) == pytest.approx((ours.xp_arcsec, ours.yp_arcsec), abs=1e-6)
        back = from_skyfield(timescale).orientation(t)
        assert (back.dut1_s, back.xp_arcsec) == pytest.approx((ours.dut1_s, ours.xp_arcsec), abs=1e-6)
    fixed = to_skyfield(EarthOrientation.fixed(0.05, 0.17, 0.32))
    assert float(to_skyfield(T, fixed).dut1) == pytest.approx(0.05, abs=1e-6)
    assert from_skyfield(builtin).age(T).status == "fixed"


@pytest.mark.parametrize("lines", [ISS, MOLNIYA])
@pytest.mark.parametrize("place", [LEIDEN, PARANAL])
@pytest.mark.usefixtures("offline")
def test_geometric_directions_are_what_astropy_makes_of_teme(lines, place):
    elements, site = Elements.from_tle(*lines), Site(*place)
    times = Utc(elements.epoch.unix_s + np.linspace(0.0, 86400.0, 50))
    ours = Propagator(elements, site, place="geometric").at(times)
    _, position, _ = elements.satrec().sgp4_array(*times.split())
    t = AstropyTime(times.isoformats(), scale="utc")
    location = EarthLocation.from_geodetic(place[1], place[0], place[2])
    in_itrs = TEME(CartesianRepresentation(position.T * units.km), obstime=t).transform_to(ITRS(obstime=t))
    from_site = in_itrs.cartesian.xyz - location.get_itrs(t).cartesian.xyz
    theirs = ITRS(from_site, obstime=t, location=location)
    horizontal = theirs.transform_to(AltAz(obstime=t, location=location))
    of_date = theirs.transform_to(TETE(obstime=t, location=location))
    assert separation_arcsec(horizontal.az.deg, horizontal.alt.deg, ours.az_deg, ours.alt_deg).max() < 2e-3
    given = ours.to_astropy()
    assert separation_arcsec(of_date.ra.deg, of_date.dec.deg, given.ra.deg, given.dec.deg).max() < 2e-3
    assert np.abs(of_date.distance.km - given.distance.km).max() < 1e-4
    turned = given.transform_to(AltAz(obstime=t, location=location))
    assert (
        separation_arcsec(turned.az.deg, turned.alt.deg, horizontal.az.deg, horizontal.alt.deg).max() < 2e-3
    )


@pytest.mark.usefixtures("offline")
def test_an_astrometric_direction_is_one_of_the_icrs():
    seen = Propagator(Elements.from_tle(*ISS), Site(*LEIDEN), place="astrometric").at(T)
    given = seen.to_astropy()
    assert isinstance(given.frame, ICRS)
    assert (given.ra.deg, given.dec.deg) == pytest.approx((seen.ra_deg, seen.dec_deg), abs=1e-12)
    assert given.obstime.isot == "2026-10-02T13:05:24.250"


def test_without_astropy_the_error_says_what_to_install(monkeypatch):
    for name in ("astropy", "astropy.time", "astropy.coordinates"):
        monkeypatch.setitem(sys.modules, name, None)
    seen = Propagator(Elements.from_tle(*ISS), Site(*LEIDEN)).at(T)
    for give in (seen.to_astropy, seen.utc.to_astropy, Site(*LEIDEN).to_astropy):
        with pytest.raises(PackageError, match="astropy is not installed: pip install astropy"):
            give()

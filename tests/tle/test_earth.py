from __future__ import annotations

import math
import warnings

import erfa
import numpy as np
import pytest
from tle_facts import LEIDEN

from tle.earth import (
    FIRST_MJD,
    EarthOrientation,
    IersTable,
    earth_orientation_age,
    installed_table,
    to_tirs,
)
from tle.errors import EarthOrientationWarning, SourceError, TimeRangeError
from tle.instants import Utc, tai_minus_utc_s
from tle.site import Site

ARCSEC = math.pi / 648000.0
# Of the IERS's finals2000A.all: MJD 61315 (2026-10-02), Bulletin A, observed.
MJD, DUT1_S, XP_ARCSEC, YP_ARCSEC = 61315, -0.0230939, 0.173335, 0.324566
DAY = Utc.parse("2026-10-02")


def julian_dates(unix_s, dut1_s, tai_utc_s=37.0):
    """Return UT1 and TT as two-part Julian dates, without any code under test."""
    days = np.floor(unix_s / 86400.0)
    second = unix_s - days * 86400.0
    whole = days + 2440587.5
    return (whole, (second + dut1_s) / 86400.0), (whole, (second + tai_utc_s + 32.184) / 86400.0)


def test_sidereal_angle_and_equinoxes_are_erfas_to_a_thousandth_of_an_arcsecond():
    random = np.random.default_rng(4)
    unix_s = np.sort(random.uniform(Utc.parse("2018-01-01").unix_s, Utc.parse("2050-01-01").unix_s, 500))
    dut1_s = 0.123
    theta, _, equinoxes, _, _, _ = EarthOrientation.fixed(dut1_s).rotation(unix_s)
    ut1, tt = julian_dates(unix_s, dut1_s)
    mean, true = erfa.gmst82(*ut1), erfa.gst06a(*ut1, *tt)
    for ours, theirs in ((theta, mean), (theta + equinoxes, true)):
        off = np.remainder(ours - theirs + math.pi, 2.0 * math.pi) - math.pi
        assert np.abs(off).max() < 0.001 * ARCSEC


def test_the_matrix_to_date_is_erfas_to_a_thousandth_of_an_arcsecond():
    random = np.random.default_rng(5)
    unix_s = random.uniform(Utc.parse("2018-01-01").unix_s, Utc.parse("2050-01-01").unix_s, 200)
    earth = EarthOrientation.fixed(0.0)
    _, tt = julian_dates(unix_s, 0.0)
    theirs = erfa.pnm06a(*tt)
    assert np.abs(earth.celestial_matrix(Utc(unix_s)) - theirs).max() < 0.001 * ARCSEC
    assert np.abs(earth.celestial_matrix(Utc(float(unix_s[0]))) - theirs[0]).max() < 0.001 * ARCSEC


def test_rates_are_the_derivatives():
    earth = EarthOrientation.installed()
    t = DAY.unix_s + 40000.0
    early, now, late = (earth.rotation(t + s) for s in (-300.0, 0.0, 300.0))
    assert (late[0] - early[0]) / 600.0 == pytest.approx(now[1], rel=1e-12)
    assert (late[2] - early[2]) / 600.0 == pytest.approx(now[3], rel=1e-5)
    assert earth.sidereal_rate_deg_s(Utc(t)) == pytest.approx(math.degrees(now[1] + now[3]), rel=1e-15)
    # One sidereal turn in 86164.0905 s of UT1 (IERS Conventions 2010, table 1.1 gives 1.00273781191135448 for
    # the Earth's rotation; apparent sidereal time adds precession and nutation, under 1e-7 of it).
    assert now[1] / (2.0 * math.pi / 86164.0905) == pytest.approx(1.0, abs=2e-8)


def test_arrays_and_single_instants_agree():
    earth = EarthOrientation.installed()
    unix_s = DAY.unix_s + np.array([-90000.0, 0.0, 0.5, 86399.9, 86400.0, 300000.0, 10.0])
    many = np.array([np.broadcast_to(a, unix_s.shape) for a in earth.rotation(unix_s)])
    for i, one in enumerate(unix_s):
        assert many[:, i] == pytest.approx(earth.rotation(float(one)), rel=1e-15)
    assert np.shape(earth.rotation(np.array([]))[0]) == (0,)


def test_polar_motion_is_erfas():
    xp, yp = 0.4 * ARCSEC, -0.5 * ARCSEC
    site = Site(*LEIDEN).itrs_km
    theirs = erfa.pom00(xp, yp, 0.0).T @ np.array(site)
    assert np.array(to_tirs(site, xp, yp)) == pytest.approx(theirs, abs=1e-7)


def test_reads_the_installed_table():
    table = installed_table()
    first = table.day(MJD)
    assert (first.dut1_s, first.xp_arcsec, first.yp_arcsec) == (DUT1_S, XP_ARCSEC, YP_ARCSEC)
    assert table.last_observed_mjd > MJD
    assert table.last_mjd > table.last_observed_mjd
    earth = EarthOrientation.installed()
    half = earth.orientation(DAY.plus(43200.0))
    assert half.dut1_s == pytest.approx((DUT1_S + table.day(MJD + 1).dut1_s) / 2.0, abs=1e-12)
    _, _, _, _, xp, yp = earth.rotation(DAY.unix_s)
    assert (xp / ARCSEC, yp / ARCSEC) == pytest.approx((XP_ARCSEC, YP_ARCSEC), abs=1e-12)
    ut1, _ = julian_dates(DAY.unix_s, DUT1_S)
    assert earth.rotation(DAY.unix_s)[0] == pytest.approx(erfa.gmst82(*ut1), abs=1e-12)


def test_ut1_runs_through_a_leap_second():
    # At the end of 2016 UTC fell a second back against UT1: UT1-UTC went from -0.4077 s to +0.5912 s.
    earth = EarthOrientation.installed()
    midnight = Utc.parse("2017-01-01")
    before, after = earth.orientation(midnight.plus(-0.001)), earth.orientation(midnight)
    assert before.dut1_s == pytest.approx(-0.4087, abs=0.002)
    assert after.dut1_s - before.dut1_s == pytest.approx(1.0, abs=1e-6)
    assert (tai_minus_utc_s(57753), tai_minus_utc_s(57754)) == (36.0, 37.0)
    assert (tai_minus_utc_s(41684), tai_minus_utc_s(61315)) == (12.0, 37.0)


def test_sidereal_time_of_a_site():
    earth = EarthOrientation.fixed(DUT1_S)
    t = DAY.plus(12345.678)
    ut1, tt = julian_dates(t.unix_s, DUT1_S)
    wanted = (math.degrees(erfa.gst06a(*ut1, *tt)) + LEIDEN[1]) % 360.0
    assert earth.local_apparent_sidereal_deg(t, Site(*LEIDEN)) == pytest.approx(wanted, abs=1e-7)
    times = Utc(DAY.unix_s + np.linspace(0.0, 1e5, 50))
    angles = earth.local_apparent_sidereal_deg(times, Site(0.0, 359.0))
    assert ((angles >= 0.0) & (angles < 360.0)).all()


@pytest.mark.parametrize("unix_s", [float("nan"), float("inf"), -float("inf"), 0.0, 4e9, 1e300, -1e9])
def test_times_without_orientation_are_refused(unix_s):
    for value in (unix_s, np.array([DAY.unix_s, unix_s]), np.array([unix_s])):
        with pytest.raises(TimeRangeError, match=r"from 1973-01-02T00:00:00Z to 2057-01-01"):
            EarthOrientation.installed().rotation(value)
    with pytest.raises(TimeRangeError):
        EarthOrientation.installed().celestial_matrix(Utc(np.array([unix_s])))


def test_the_age_of_the_orientation():
    table = installed_table()
    observed = Utc((table.last_observed_mjd - 40587) * 86400.0)
    predicted = Utc((table.last_mjd - 40587) * 86400.0)
    assert earth_orientation_age(observed).status == "observed"
    assert earth_orientation_age(observed.plus(3600.0)).status == "predicted"
    assert earth_orientation_age(observed.plus(3600.0)).age_s == 3600.0
    assert earth_orientation_age(predicted).status == "predicted"
    late = earth_orientation_age(predicted.plus(1.0))
    assert (late.status, late.predicted_until, late.observed_until) == ("extrapolated", predicted, observed)
    assert earth_orientation_age(DAY, EarthOrientation.fixed(0.0)).status == "fixed"


def test_extrapolation_holds_the_last_values_and_warns_once():
    earth = EarthOrientation(installed_table())
    end = Utc((installed_table().last_mjd - 40587) * 86400.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        earth.rotation(end.unix_s)
    with pytest.warns(EarthOrientationWarning, match="extrapolated: the table ends at"):
        earth.rotation(end.unix_s + 86400.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        earth.rotation(end.unix_s + np.array([1e6, 1e7]))
    last = installed_table().day(installed_table().last_mjd)
    assert earth.orientation(end.plus(1e7)).dut1_s == last.dut1_s


def test_damaged_tables_are_refused(tmp_path):
    import astropy_iers_data

    with open(astropy_iers_data.IERS_A_FILE, "rb") as file:  # noqa: PTH123
        whole = file.read()
    path = tmp_path / "finals2000A.all"
    for content in (b"", b"no table\n" * 100, whole[1:], whole[188:]):
        path.write_bytes(content)
        with pytest.raises(SourceError, match=r"is no finals2000A\.all"):
            IersTable(path)
    day = (MJD - FIRST_MJD) * 188
    path.write_bytes(whole[: day + 58] + b"   broken  " + whole[day + 69 :])
    with pytest.raises(SourceError, match="no Earth orientation for MJD 61315"):
        IersTable(path).day(MJD)
    with pytest.raises(SourceError):
        installed_table().day(FIRST_MJD - 1)
    with pytest.raises(SourceError, match="cannot read Earth orientation"):
        IersTable(tmp_path / "absent")

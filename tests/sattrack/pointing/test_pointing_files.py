"""Files of models and stars: literal texts in the layouts that other programs write and read."""

from __future__ import annotations

import erfa
import numpy as np
import pytest

from sattrack.core.angles import altitude_deg, azimuth_deg
from sattrack.core.errors import BadInputError
from sattrack.mount.model import PointingTerms
from sattrack.pointing.files import (
    RunParameters,
    at_date,
    model_text,
    observed,
    read_stars,
    star_line,
    stars_head,
)
from sattrack.pointing.fit import Star

STARS = """! made by hand
A run of two stars
:EQUAT
:NODA
 52 09 00.0 2026 11 22 10.0 1013.0 6.0
 05 16 41.35871 +45 59 52.7693 0 0 2000.0 05 18 40.00000 +46 01 00.0000 05 30.5
 19 50 46.99855 +08 52 05.9563 0 0 2000.0 07 52 00.00000 171 06 00.0000 20 00.0 1 2
END
"""


def test_stars_are_read_as_rts2_writes_them() -> None:
    run, stars = read_stars(STARS, "run.dat")
    assert run == RunParameters(pytest.approx(52.15), "2026-11-22", 10.0, 1013.0, 6.0)
    assert len(stars) == 2
    assert stars[0].axis_hour_angle_deg == pytest.approx(
        15.0 * (5.0 + 30.5 / 60.0 - 5.0 - 18.0 / 60.0 - 40.0 / 3600.0)
    )
    assert stars[0].axis_dec_deg == pytest.approx(46.0 + 1.0 / 60.0)
    # Precession since 2000 has moved the star by some minutes of arc: 26.9 years of 50 arcseconds.
    assert stars[0].hour_angle_deg == pytest.approx(stars[0].axis_hour_angle_deg, abs=0.5)
    assert stars[1].axis_dec_deg == pytest.approx(171.1)
    assert abs(abs(stars[1].hour_angle_deg - stars[1].axis_hour_angle_deg) - 180.0) < 1.0


def test_places_are_those_of_erfa() -> None:
    run = RunParameters(-33.0, "2026-11-22", 10.0, 0.0, 800.0)
    first, second = erfa.cal2jd(2026, 11, 22)
    gst = np.degrees(erfa.gst06a(first, second + 0.5, first, second + 0.5))
    seen = erfa.atco13(
        *np.radians([100.0, -40.0]), 0, 0, 0, 0, first, second + 0.5, 0.0,
        np.radians(130.0 - gst), np.radians(-33.0), 800.0, 0, 0, 0, 0, 0, 0.55,
    )  # fmt: skip
    expected = np.degrees(seen[2]), np.degrees(seen[3])
    assert observed(100.0, -40.0, 130.0, run) == pytest.approx(expected, abs=1e-5)
    raised = observed(100.0, -40.0, 130.0, run._replace(pressure_hpa=1010.0))
    assert 0.001 < abs(raised[0] - expected[0]) + abs(raised[1] - expected[1]) < 0.02


def test_what_is_written_is_read_again() -> None:
    run = RunParameters(-33.25, "2026-11-22", 4.0, 920.0, 800.0)
    star = Star(0.0, 0.0, -64.123456, -131.5, (254.000123, -8.999877), 190.98765)
    _, (read,) = read_stars(stars_head("a run", run) + star_line(star), "run.dat")
    assert read.axis_hour_angle_deg == pytest.approx(star.axis_hour_angle_deg, abs=1e-6)
    assert read.axis_dec_deg == pytest.approx(star.axis_dec_deg, abs=1e-7)
    assert read.icrs_deg == pytest.approx(star.icrs_deg, abs=1e-6)
    assert read.sidereal_deg == pytest.approx(star.sidereal_deg, abs=1e-6)


@pytest.mark.parametrize("pressure", [0.0, 920.0])
def test_a_star_is_where_it_was_at_another_date(pressure: float) -> None:
    then = RunParameters(-33.25, "2020-01-31", 4.0, pressure, 800.0)
    now = then._replace(date="2026-11-22")
    seen = observed(254.0, -8.99, 190.98765, now)
    star = at_date(Star(*seen, 0.0, 0.0, (254.0, -8.99), 190.98765), then)
    # 6.8 years of precession are 340 seconds of arc.
    assert abs(star.icrs_deg[0] - 254.0) > 300.0 / 3600.0
    assert observed(*star.icrs_deg, 190.98765, then) == pytest.approx(seen, abs=0.02 / 3600.0)
    altitude = altitude_deg(*seen, -33.25)
    level = Star(azimuth_deg(*seen, -33.25), altitude, 0.0, 0.0, (254.0, -8.99), 190.98765)
    assert at_date(level, then, "altaz").icrs_deg == pytest.approx(star.icrs_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (":EQUAT", ":ALTAZ", "it has no :EQUAT, and the profile's mount is equatorial"),
        (":NODA", ":J2000\n:NODA", "run.dat: .*:J2000"),
        ("52 09 00.0 2026", "52 09 2026", "run.dat:5: .*latitude"),
        ("05 30.5", "", "run.dat:6: .*sidereal time"),
        ("0 0 2000.0 05", "0 0 1950.0 05", "run.dat:6: .*J2000"),
        ("171 06", "371 06", "run.dat:7: .*371"),
        ("+45 59 52.7693", "+45 61 52.7693", "run.dat:6"),
        ("2026 11 22", "inf 11 22", "run.dat:5: .*'inf'"),
        ("2026 11 22", "2026 0 22", "run.dat:5: .*month"),
        ("2026 11 22", "202 11 22", "run.dat:5: .*1960"),
        ("1013.0 6.0", "1013.0 nan", "run.dat:5: .*'nan'"),
        ("05 30.5", "05 inf", "run.dat:6: .*sidereal time"),
        ("05 18 40", "1e308 18 40", "run.dat:6: .*the mount's RA"),
    ],
)
def test_a_bad_line_of_stars_is_named(old: str, new: str, words: str) -> None:
    assert old in STARS
    with pytest.raises(BadInputError, match=words):
        read_stars(STARS.replace(old, new), "run.dat")


def test_a_colon_alone_says_nothing() -> None:
    assert read_stars(STARS.replace(":NODA", ":"), "run.dat") == read_stars(STARS, "run.dat")


def test_a_file_that_was_cut_off_gives_its_whole_lines() -> None:
    assert len(read_stars(STARS[: STARS.index("END")], "run.dat")[1]) == 2
    with pytest.raises(BadInputError, match="it is empty"):
        read_stars("", "run.dat")


def test_a_model_is_written_in_the_layout_that_rts2_reads() -> None:
    terms = PointingTerms(
        "2026-11-22T20:00:00Z", 52.0, {"IH": (-120.5, 3.1), "ME": (7000.0, 0.25)}, 2.5, 17, 3.0
    )
    lines = model_text(terms, "my mount").splitlines()
    assert lines[0] == "my mount 2026-11-22T20:00:00Z"
    assert lines[1].split() == ["T", "17", "2.5000", "0.0", "0.0"]
    assert [line.split() for line in lines[2:]] == [
        ["IH", "-120.5000", "3.10000"],
        ["ME", "7000.0000", "0.25000"],
        ["END"],
    ]

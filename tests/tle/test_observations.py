from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tle_facts import ISS, LEIDEN

from tle.bias import Bias
from tle.elements import Elements
from tle.errors import ObservationError, SourceError, TleError
from tle.formats.observations import Stations, parse_observations, read_observations, read_stations
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site
from tle.sources import find

HERE = Site(*LEIDEN)
STATIONS = Stations({"4353": HERE, "LEIDEN": HERE})
NOWHERE = Stations({})
ELEMENTS = Elements.from_tle(*ISS, name="ISS (ZARYA)")
AT = Utc.parse("2026-10-02T13:05:24.5Z")
SEEN = Propagator(ELEMENTS, HERE, Bias(1.25, 0.05), place="astrometric").at(AT)


def sexagesimal(value):
    """Return whole units, minutes and seconds of a positive angle."""
    minutes, seconds = divmod(value * 3600.0, 60.0)
    whole, minutes = divmod(int(minutes), 60)
    return whole, minutes, seconds


def test_reads_csv():
    text = (
        "# of the night\n"
        "utc,ra_deg,dec_deg,frame,station,object,sigma_arcsec,sigma_time_s\n"
        f"{AT.isoformat()},{SEEN.ra_deg!r},{SEEN.dec_deg!r},icrf,LEIDEN,25544,2.5,0.01\n"
        "\n"
        f"{AT.isoformat()},10.0,-5.5,of_date,LEIDEN,,,\n"
        f"{AT.isoformat()},10.0,-5.5,gcrs,LEIDEN,,,\n"
        f"{AT.isoformat()},10.0,-5.5,icrs,LEIDEN,,,\n"
    )
    one, two, three, four = parse_observations(text, STATIONS, "night.csv")
    assert (one.utc, one.frame, one.site, one.object_key) == (AT, "icrf", HERE, "25544")
    assert (one.sigma_arcsec, one.sigma_time_s, one.source, one.line) == (2.5, 0.01, "night.csv", 3)
    assert (two.frame, two.object_key, two.sigma_arcsec, two.line) == ("of_date", "", None, 5)
    assert (three.frame, four.frame) == ("gcrs", "icrf")
    found = one.residual(ELEMENTS)
    assert (found.along_s, found.cross_deg) == pytest.approx((1.25, 0.05), abs=1e-7)


def test_csv_may_bring_its_own_site():
    text = "utc,ra_deg,dec_deg,latitude_deg,longitude_deg,height_m\n2026-10-02,1,2,-24.627,-70.404,2635\n"
    (one,) = parse_observations(text, NOWHERE)
    assert one.site == Site(-24.627, -70.404, 2635.0)
    assert one.frame == "icrf"


def test_csv_may_have_all_in_quotes():
    text = '"utc","ra_deg","dec_deg","object"\n"2026-10-02T00:00:00Z","10.5","-5.5","ISS, NAUKA"\n'
    (one,) = parse_observations(text, Stations({}, HERE))
    assert (one.ra_deg, one.dec_deg, one.object_key) == (10.5, -5.5, "ISS, NAUKA")


def test_reads_iod():
    h, m, s = sexagesimal(SEEN.ra_deg / 15.0)
    d, dm, ds = sexagesimal(abs(SEEN.dec_deg))
    line = (
        f"25544 98 067A   4353 G 20261002130524500 17 15 {h:02d}{m:02d}{round(s * 10):03d}"
        f"{'+' if SEEN.dec_deg >= 0 else '-'}{d:02d}{dm:02d}{round(ds):02d} 58 S+030 05"
    )
    (one,) = parse_observations(f"Seen from the roof:\n\n{line}\n", STATIONS, "mail.txt")
    assert (one.utc, one.frame, one.site, one.object_key, one.line) == (AT, "j2000", HERE, "25544", 3)
    assert (one.sigma_arcsec, one.sigma_time_s) == pytest.approx((5.0, 0.1))
    found = one.residual(ELEMENTS)
    # The format's last places are 1.5″ and 1″; this satellite moves a degree in the 0.9 s they never show.
    assert found.along_s == pytest.approx(1.25, abs=0.002)
    assert found.cross_deg == pytest.approx(0.05, abs=0.001)


@pytest.mark.parametrize(
    ("fields", "ra_deg", "dec_deg", "sigma_arcsec"),
    [
        ("10 1122334+112233 36", 15 * (11 + 22 / 60 + 33.4 / 3600), 11 + 22 / 60 + 33 / 3600, 0.03),
        ("25 1122345-112233 28", 15 * (11 + 22.345 / 60), -(11 + 22.33 / 60), 120.0),
        ("35 1122345+112233 26", 15 * (11 + 22.345 / 60), 11.2233, 72.0),
        ("75 1122334+112222 36", 15 * (11 + 22 / 60 + 33.4 / 3600), 11.2222, 108.0),
        ("25 1122   +1122   28", 15 * (11 + 22 / 60), 11 + 22 / 60, 120.0),
        ("1  1122334+112233   ", 15 * (11 + 22 / 60 + 33.4 / 3600), 11 + 22 / 60 + 33 / 3600, None),
    ],
)
def test_angle_formats_of_iod(fields, ra_deg, dec_deg, sigma_arcsec):
    # The field layouts are the examples of the format's description (G. Lewis, 2002).
    (one,) = parse_observations(f"12345 98 123A   4353 G 200811221122334   27 {fields}", STATIONS)
    assert (one.ra_deg, one.dec_deg) == pytest.approx((ra_deg, dec_deg), abs=1e-9)
    assert one.sigma_arcsec == (None if sigma_arcsec is None else pytest.approx(sigma_arcsec))
    assert one.frame == ("j2000" if fields[1] == "5" else "of_date")
    assert one.utc == Utc.parse("2008-11-22T11:22:33.4Z")
    assert one.sigma_time_s == pytest.approx(0.2)


@pytest.mark.parametrize("number", ["A0534", "100534"])
def test_iod_numbers_of_six_digits_stand_as_alpha5_or_move_the_columns(number):
    rest = " 98 067A   4353 G 20261002130524500 17 15 1122334+112233 36"
    usual, one = parse_observations(f"25544{rest}\n{number}{rest}\n", STATIONS)
    assert one.object_key == number
    assert find([ELEMENTS, dataclasses.replace(ELEMENTS, catalog_number=100534)], number) != ELEMENTS
    assert dataclasses.replace(one, object_key="25544", line=1) == usual


TDM = """CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2026-10-02T14:00:00
ORIGINATOR = TEST
META_START
COMMENT angles of the sky
TIME_SYSTEM = UTC
PARTICIPANT_1 = 1998-067A
PARTICIPANT_2 = LEIDEN
MODE = SEQUENTIAL
PATH = 1,2
ANGLE_TYPE = RADEC
REFERENCE_FRAME = ICRF
META_STOP
DATA_START
ANGLE_1 = 2026-275T13:05:24.5 {ra}
ANGLE_2 = 2026-275T13:05:24.5 {dec}
MAG = 2026-275T13:05:24.5 -2.0
DATA_STOP
"""


def test_reads_tdm():
    text = TDM.format(ra=repr(SEEN.ra_deg), dec=repr(SEEN.dec_deg))
    for stations in (STATIONS, Stations({}, HERE)):
        (one,) = parse_observations(text, stations, "pass.tdm")
        assert (one.utc, one.frame, one.site, one.object_key) == (AT, "icrf", HERE, "1998-067A")
        assert one.line == 16
        assert one.residual(ELEMENTS).along_s == pytest.approx(1.25, abs=1e-6)


@pytest.mark.parametrize(("applied", "ra_deg", "dec_deg"), [("YES", 10.0, 20.0), ("NO", 9.5, 20.25)])
def test_corrections_of_a_tdm_that_were_not_applied_are(applied, ra_deg, dec_deg):
    told = f"CORRECTION_ANGLE_1 = -0.5\nCORRECTION_ANGLE_2 = 0.25\nCORRECTIONS_APPLIED = {applied}\nMETA_STOP"
    (one,) = parse_observations(TDM.format(ra=10, dec=20).replace("META_STOP", told), STATIONS)
    assert (one.ra_deg, one.dec_deg) == (ra_deg, dec_deg)


def test_reads_tdm_as_xml():
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
    <tdm id="CCSDS_TDM_VERS" version="2.0"><header/><body><segment><metadata>
    <TIME_SYSTEM>UTC</TIME_SYSTEM><PARTICIPANT_1>LEIDEN</PARTICIPANT_1><PARTICIPANT_2>25544</PARTICIPANT_2>
    <ANGLE_TYPE>RADEC</ANGLE_TYPE><REFERENCE_FRAME>EME2000</REFERENCE_FRAME></metadata><data>
    <observation><EPOCH>2026-10-02T13:05:24.5</EPOCH><ANGLE_1>{SEEN.ra_deg - 360.0!r}</ANGLE_1></observation>
    <observation><EPOCH>2026-10-02T13:05:24.5</EPOCH><ANGLE_2>{SEEN.dec_deg!r}</ANGLE_2></observation>
    </data></segment></body></tdm>"""
    (one,) = parse_observations(text, STATIONS)
    assert (one.utc, one.frame, one.object_key) == (AT, "j2000", "25544")
    assert one.ra_deg == pytest.approx(SEEN.ra_deg)


@pytest.mark.parametrize(
    "doctype",
    ["<!DOCTYPE tdm>", '<!DOCTYPE tdm SYSTEM "file:///etc/passwd">', "<!DOCTYPE tdm [<!ENTITY x 'LEIDEN'>]>"],
)
def test_a_tdm_with_a_document_type_is_refused(doctype):
    text = f"""<?xml version="1.0"?>{doctype}<tdm><body><segment><metadata>
    <ANGLE_TYPE>RANGE</ANGLE_TYPE><PARTICIPANT_1>&lt;</PARTICIPANT_1></metadata></segment></body></tdm>"""
    with pytest.raises(ObservationError, match=r"^x: declares a document type or entities") as refusal:
        parse_observations(text, STATIONS, "x")
    assert "\n" not in str(refusal.value)


IOD = "12345 98 123A   4353 G 200811221122334   27 15 1122334+112233 36"
CSV = "utc,ra_deg,dec_deg\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no observations: give CSV"),
        ("hello\n", "holds no observations: give CSV"),
        (CSV, "holds no observations of RA and Dec"),
        ("utc,ra_deg,dec_deg,mag\n", "x:1: column 'mag' is not known"),
        (CSV + "2026-10-02,1\n", "x:2: has 2 columns, the header 3"),
        (CSV + "yesterday,1,2\n", "x:2: 'yesterday' is no time"),
        (CSV + "2026-10-02,one,2\n", "x:2: ra_deg 'one' is no number"),
        (CSV + "2026-10-02,,2\n", "x:2: ra_deg or dec_deg is empty"),
        (CSV + "2026-10-02,1,2\n", "x:2: no station is named: give a list of stations"),
        ("utc,ra_deg,dec_deg,station\n2026-10-02,1,91,4353\n", "x:2: a declination of 91.0° is outside"),
        ("utc,ra_deg,dec_deg,station\n2026-10-02,nan,1,4353\n", "x:2: a right ascension of nan° is outside"),
        ("utc,ra_deg,dec_deg,station\n2026-10-02,1,1,9\n", "x:2: station '9' is not known"),
        ("utc,ra_deg,dec_deg,station,frame\n2026-10-02,1,1,4353,fk4\n", "x:2: 'fk4' is no frame"),
        (
            "utc,ra_deg,dec_deg,latitude_deg,longitude_deg\n2026-10-02,1,1,95,0\n",
            "x:2: the site's latitude of 95.0",
        ),
        (
            "utc,ra_deg,dec_deg,latitude_deg,longitude_deg\n2026-10-02,1,1,52,\n",
            "x:2: latitude_deg or longitude_deg is empty: give both",
        ),
        ("utc,ra_deg,dec_deg,station,sigma_arcsec\n2026-10-02,1,1,4353,-1\n", "x:2: an uncertainty of -1.0"),
        (IOD.replace("15 11", "45 11"), "x:1: angle format '4' is none of"),
        (IOD.replace("15 11", "14 11"), "x:1: epoch code '4' is none of"),
        (IOD.replace("+", "x"), "x:1: '1122334x112233' is no HHMMSSs±DDMMSS"),
        (IOD.replace("+112233", "+114298"), "x:1: '1122334+114298' is no HHMMSSs±DDMMSS"),
        (IOD.replace("15 1122334", "25 1174334"), "x:1: '1174334+112233' is no HHMMmmm±DDMMmm"),
        (IOD.replace("20081122", "20081322"), "x:1: '2008-13-22T11:22:33.400Z' is no time"),
        (IOD.replace("4353", "0001"), "x:1: station '0001' is not known"),
        (TDM.replace("ICRF", "B1950").format(ra=1, dec=2), "x:15: reference frame B1950 is none of"),
        (TDM.replace("2026-275T", "2026-400T").format(ra=1, dec=2), "x:16: '2026-400T13:05:24.5' is no time"),
        (TDM.replace("UTC", "GPS").format(ra=1, dec=2), "x:15: time system GPS is not UTC"),
        (TDM.format(ra="one", dec=2), "x:16: could not convert string to float"),
        (
            TDM.replace("ANGLE_1", "ANGLE_3").format(ra=1, dec=2),
            "x:16: ANGLE_2 at 2026-275T13:05:24.5 has no",
        ),
        (TDM.replace("MODE = SEQ", "MODE SEQ").format(ra=1, dec=2), "x:9: 'MODE SEQUENTIAL' is no KEYWORD"),
        (TDM.replace("RADEC", "AZEL").format(ra=1, dec=2), "holds no observations of RA and Dec"),
        ("<tdm><body>", "x: is no XML"),
    ],
)
def test_tells_what_is_wrong_and_where(text, words):
    with pytest.raises(ObservationError) as raised:
        parse_observations(text, STATIONS, "x")
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_reads_the_frames_of_a_camera_that_have_a_place_among_the_stars():
    line = (
        '{"utc": "2026-10-02T13:05:24.500000Z", "exposure_s": 0.1, "kind": "point", "dx_arcsec": 1.0, '
        '"dy_arcsec": 2.0, "sigma_arcsec": 2.5, "snr": 20.0, "solved": {"ra_deg": 144.8, "dec_deg": 13.6}, '
        '"why": null, "camera": "camera", "ra_deg": 144.9, "dec_deg": 13.7, "sent": null}\n'
    )
    without = line.replace("144.9", "null").replace("13.7", "null")
    (one,) = parse_observations(without + line, Stations({}, HERE), "seen.jsonl")
    assert (one.utc, one.ra_deg, one.dec_deg, one.frame, one.sigma_arcsec, one.line) == (
        AT,
        144.9,
        13.7,
        "icrf",
        2.5,
        2,
    )
    with pytest.raises(ObservationError, match=r"^seen.jsonl: holds no observations of RA and Dec"):
        parse_observations(without, Stations({}, HERE), "seen.jsonl")


@given(st.text() | st.text(alphabet="0123456789 +-.,=ANGLE_12T:\n<>").map(lambda t: "CCSDS_TDM_VERS" + t))
def test_no_text_raises_anything_but_our_errors(text):
    for start in ("", CSV, IOD[:40]):
        with pytest.raises(TleError):
            parse_observations(start + text, NOWHERE, "x")


def test_files_and_stations(tmp_path):
    with pytest.raises(SourceError, match="cannot read observations: No such file"):
        read_observations(tmp_path / "none.csv", STATIONS)
    with pytest.raises(SourceError, match="cannot read stations: No such file"):
        read_stations(tmp_path / "none.txt")
    places = tmp_path / "sites.txt"
    places.write_text(
        "# No ID   Latitude Longitude   Elev   Observer\n4353 ML   52.1541    4.4908      0    A B\n\n"
    )
    known = read_stations(places, HERE)
    assert known == Stations({"4353": HERE}, HERE, all=True)
    # The site of one's own is none of a station that the list has not.
    with pytest.raises(ObservationError, match=r"x:1: station '2701' is not known: add it to the list"):
        parse_observations(IOD.replace("4353", "2701"), known, "x")
    text = f"{CSV}{AT.isoformat()},1,2\n"
    assert [one.site for one in parse_observations(text, known)] == [HERE]
    path = tmp_path / "mail.txt"
    path.write_text(IOD)
    assert read_observations(path, read_stations(places))[0].site == HERE
    places.write_text("4353 ML north\n")
    with pytest.raises(ObservationError, match=r"sites\.txt:1: is no station"):
        read_stations(places)
    places.write_text("4353 ML 99.0 4.0 0\n")
    with pytest.raises(ObservationError, match=r"sites\.txt:1: the site's latitude of 99\.0 is outside"):
        read_stations(places)


def test_an_observation_of_something_else_is_told_with_its_line():
    text = "utc,ra_deg,dec_deg,station\n2026-10-02T13:05:24Z,100.0,-89.0,4353\n"
    (one,) = parse_observations(text, STATIONS, "night.csv")
    geostationary = dataclasses.replace(ELEMENTS, mean_motion_rev_day=1.0)
    with pytest.raises(ObservationError, match=r"night\.csv:2: no bias along the track leads"):
        one.residual(geostationary)


def test_the_stations_at_hand_are_read(cases):
    stations = read_stations(cases / "doppler_delfi_pq" / "sites.txt")
    assert stations.find("4353") == HERE
    assert len(stations.by_name) > 60
    for name in ("orekit_TDMExample2.txt", "orekit_TDMExample4.txt", "orekit_TDMExample8.txt"):
        with pytest.raises(ObservationError, match="no observations of RA and Dec"):
            read_observations(cases / "catalogues" / "formats" / name, stations)

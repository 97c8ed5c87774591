"""Writing element sets: every value survives, a TLE to the precision of its columns."""

from __future__ import annotations

import dataclasses
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sgp4.api import Satrec
from sgp4.exporter import export_tle
from tle_facts import DECAYING, ISS, MOLNIYA, STARLINK_ALPHA5, TDRS3

from tle.elements import Elements, format_alpha5, parse_alpha5
from tle.errors import SourceError, UnwritableError
from tle.formats.tle import format_set
from tle.instants import Utc
from tle.sources import WRITTEN, parse_elements, write_elements

OMM = ("csv", "json", "xml", "kvn")
ZARYA = Elements.from_tle(*ISS, name="ISS (ZARYA)")


def plus_zero(line: str) -> str:
    """Return a line with its powers of ten of zero as CelesTrak writes them: Space-Track has -0."""
    return re.sub(r"(?<=\d{5})-0(?= )", "+0", line)


@pytest.mark.parametrize("lines", [ISS, MOLNIYA, TDRS3, STARLINK_ALPHA5, DECAYING])
def test_a_tle_is_written_as_it_was_read(lines):
    for given_line, line in zip(lines, format_set(Elements.from_tle(*lines)), strict=True):
        assert line[:68] == plus_zero(given_line[:68])


@pytest.mark.parametrize("lines", [ISS, MOLNIYA, TDRS3, DECAYING])
def test_sgp4_writes_the_same_columns(lines):
    theirs = export_tle(Satrec.twoline2rv(*lines))
    ours = format_set(Elements.from_tle(*lines))
    for one, other in zip(theirs, ours, strict=True):
        assert plus_zero(one[:68]) == other[:68]


def test_three_lines_two_lines_and_names_that_look_like_something_else():
    odd = [
        dataclasses.replace(ZARYA, name=n) for n in ("ISS", "0 ISS", "# 7", "1 25544U", "", "1 " + "x" * 40)
    ]
    assert parse_elements(write_elements(odd, "tle"), "x")[0] == odd[0]
    names = [e.name for e in parse_elements(write_elements(odd, "tle"), "x")]
    assert names == [e.name for e in odd]
    assert write_elements([ZARYA], "2le") == "\n".join(ISS) + "\n"
    assert write_elements([ZARYA], "tle") == "ISS (ZARYA)\n" + "\n".join(ISS) + "\n"


@pytest.mark.parametrize("name", ["{", "[{", "{}", "[ {A", '{"A": 1}'])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_a_name_that_begins_like_json_is_none(name, ending):
    text = write_elements([dataclasses.replace(ZARYA, name=name), ZARYA], "tle").replace("\n", ending)
    for start in ("", ending, f"  {ending}"):
        found = parse_elements(start + text)
        assert [one.name for one in found] == [name, ZARYA.name]


def test_alpha5_both_ways():
    for number in (0, 5, 99_999, 100_000, 109_999, 179_999, 180_000, 220_001, 230_000, 339_999):
        field = format_alpha5(number)
        assert field is not None
        assert len(field) == 5
        assert parse_alpha5(field) == number
    assert format_alpha5(179_999) == "H9999"
    assert format_alpha5(180_000) == "J0000"
    assert format_alpha5(340_000) is None


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"catalog_number": 340_000},
            "ISS (ZARYA): catalogue number 340000 does not fit a TLE: Alpha-5 ends",
        ),
        ({"catalog_number": 999_999_999}, "write an OMM instead"),
        ({"mean_motion_dot_rev_day2": -1.0}, "first derivative of mean motion -1.0"),
        ({"eccentricity": 0.99999999}, "eccentricity 0.99999999"),
        ({"bstar_per_earth_radius": 1e10}, "drag term B* 10000000000.0"),
        ({"designator": "a note of its own"}, "eight columns"),
        ({"designator": "2057-001A"}, "its years"),
        ({"epoch": Utc.parse("2056-12-31T23:59:59.9999Z")}, "epoch"),
        ({"mean_motion_rev_day": 1e-9}, "mean motion"),
        ({"element_set_number": 10_000}, "element set number"),
    ],
)
def test_what_a_tle_cannot_hold_is_an_error(changed, words):
    with pytest.raises(UnwritableError) as error:
        write_elements([dataclasses.replace(ZARYA, **changed)], "tle")
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert error.value.exit_code == 2


def test_an_unknown_format_is_told():
    with pytest.raises(SourceError, match="'yaml' is no format of elements: give one of csv, json"):
        write_elements([ZARYA], "yaml")


def test_roundings_that_reach_the_next_unit():
    last = dataclasses.replace(
        ZARYA,
        epoch=Utc.parse("2026-12-31T23:59:59.999999Z"),
        raan_deg=359.99996,
        arg_perigee_deg=-0.00001,
        mean_anomaly_deg=-90.0,
        bstar_per_earth_radius=0.999999,
    )
    line1, line2 = format_set(last)
    assert line1[18:32] == "27001.00000000"
    assert line1[53:61] == " 10000+1"
    assert line2[17:25] == line2[34:42] == "  0.0000"
    assert line2[43:51] == "270.0000"


def test_headers_of_messages():
    created = "2026-10-02T13:05:24Z"
    for form in ("xml", "kvn"):
        text = write_elements([ZARYA], form, created, "A & B")
        assert created in text
        assert parse_elements(text, "x") == [ZARYA]
    assert write_elements([], "json") == "[]\n"


_ANGLES = st.floats(0.0, 360.0)
_SMALL = st.floats(-0.99, 0.99, allow_subnormal=False)
_SETS = st.builds(
    Elements,
    name=st.text(st.characters(categories=("L", "N", "P", "S"), include_characters=" "), max_size=24).map(
        str.strip
    ),
    catalog_number=st.integers(0, 339_999),
    classification=st.sampled_from("UCS"),
    designator=st.sampled_from(["", "1998-067A", "2056-999ZZZ", "1957-001B"]),
    # From 1957 to 2056 in whole microseconds.
    epoch=st.integers(-386_000_000_000_000, 2_745_000_000_000_000).map(lambda us: Utc(us / 1e6)),
    inclination_deg=st.floats(0.0, 180.0),
    raan_deg=_ANGLES,
    eccentricity=st.floats(0.0, 0.9999999),
    arg_perigee_deg=_ANGLES,
    mean_anomaly_deg=_ANGLES,
    mean_motion_rev_day=st.floats(0.001, 17.05),
    mean_motion_dot_rev_day2=_SMALL,
    mean_motion_ddot_rev_day3=_SMALL,
    bstar_per_earth_radius=_SMALL,
    ephemeris_type=st.sampled_from([0, 2]),
    element_set_number=st.integers(0, 9999),
    revolution_number=st.integers(0, 99_999),
)


def test_a_name_that_begins_like_a_comment_is_no_comment():
    header = "OBJECT_NAME,NORAD_CAT_ID,EPOCH,MEAN_MOTION,ECCENTRICITY,INCLINATION,RA_OF_ASC_NODE"
    header += ",ARG_OF_PERICENTER,MEAN_ANOMALY,BSTAR"
    row = "#1 SAT,25544,2026-10-02T00:00:00,15.5,0.0006,51.6,131.4,211.9,148.1,0.0001"
    found = parse_elements(f"{header}\n# fetched today, by hand\n{row}\n", "x")
    assert [one.name for one in found if isinstance(one, Elements)] == ["#1 SAT"]
    assert write_elements(found, "csv").splitlines()[1].startswith('"#1 SAT",')


@given(st.lists(_SETS, min_size=1, max_size=3), st.sampled_from(OMM))
def test_a_message_keeps_every_value_exactly(sets, form):
    found = parse_elements(write_elements(sets, form), "x")
    for one, other in zip(sets, found, strict=True):
        assert isinstance(other, Elements)
        # Microseconds of an epoch and the float that holds it: one unit of its last place.
        assert other.epoch.unix_s == pytest.approx(one.epoch.unix_s, abs=6e-7, rel=0.0)
        assert dataclasses.replace(other, epoch=one.epoch) == one


@given(_SETS, st.sampled_from(OMM))
def test_message_to_tle_to_message_keeps_the_precision_of_the_columns(one, form):
    (through,) = parse_elements(write_elements([one], "tle"), "x")
    (back,) = parse_elements(write_elements([through], form), "x")
    assert (back.name, back.catalog_number, back.designator) == (one.name, one.catalog_number, one.designator)
    assert (back.classification, back.ephemeris_type) == (one.classification, one.ephemeris_type)
    assert (back.element_set_number, back.revolution_number) == (
        one.element_set_number,
        one.revolution_number,
    )
    assert back.epoch.unix_s == pytest.approx(one.epoch.unix_s, abs=0.5e-8 * 86400.0 + 1e-6, rel=0.0)
    for name in ("inclination_deg", "raan_deg", "arg_perigee_deg", "mean_anomaly_deg"):
        apart = math.remainder(getattr(back, name) - getattr(one, name), 360.0)
        assert abs(apart) <= 0.5e-4 + 1e-10, name
    assert back.eccentricity == pytest.approx(one.eccentricity, abs=0.5000001e-7, rel=0.0)
    assert back.mean_motion_rev_day == pytest.approx(one.mean_motion_rev_day, abs=0.500001e-8, rel=0.0)
    assert back.mean_motion_dot_rev_day2 == pytest.approx(
        one.mean_motion_dot_rev_day2, abs=0.500001e-8, rel=0.0
    )
    for name in ("mean_motion_ddot_rev_day3", "bstar_per_earth_radius"):
        assert getattr(back, name) == pytest.approx(getattr(one, name), rel=0.5001e-4, abs=0.5001e-14), name


@pytest.mark.parametrize("form", WRITTEN)
def test_100534_is_written_and_read_in_every_format(form):
    starlink = Elements.from_tle(*STARLINK_ALPHA5)
    assert parse_elements(write_elements([starlink], form), "x") == [starlink]

"""CPF, OEM and SP3: real files at rows held out, every broken file, and texts made to be refused."""

from __future__ import annotations

import gzip
import random
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.ephemeris import (
    Frame,
    Interpolation,
    Segment,
    TableEphemeris,
    expected_error_m,
    without_poor_velocities,
)
from tle.errors import (
    AmbiguousSatelliteError,
    EphemerisError,
    EphemerisSpanError,
    SatelliteNotFoundError,
    SourceError,
)
from tle.formats.ephemerides import find_ephemeris, parse_ephemerides, read_ephemerides
from tle.instants import ARRAYS, Utc
from tle.propagator import Propagator
from tle.site import Site
from tle.sources import parse_elements

if TYPE_CHECKING:
    from pathlib import Path

Array = NDArray[np.float64]
EARTH = EarthOrientation.installed()
LEIDEN = Site(52.15, 4.49)
TURN, RADIUS = 1.0779e-3, 7000.0


def missed_mm(segment: Segment, edge: int, every: int = 2) -> Array:
    """Return what rows left out are missed by when interpolated, `edge` of them at either end not counted.

    Every so-manyth row is left out, so rows that are far apart have all their neighbours.
    """
    held = np.arange(1, len(segment.since_s) - 1, every)
    velocity = segment.velocity_km_s
    some = Segment(
        segment.zero_s,
        np.delete(segment.since_s, held),
        np.delete(segment.place_km, held, axis=0),
        None if velocity is None else np.delete(velocity, held, axis=0),
        segment.frame,
        segment.interpolation,
        segment.use_s,
    )
    places = some.native_many(segment.since_s[held])[:3].T
    missed: Array = np.linalg.norm(places - segment.place_km[held], axis=1) * 1e6
    return missed[edge:-edge]


@pytest.mark.parametrize(
    ("name", "most_mm"),
    [
        ("ilrs/lageos1_cpf_180613_16401.hts", 10.0),
        ("ilrs/galileo212_cpf_180613_6641.esa", 2.0),
        # Its rows are themselves turned about the pole; see the next test.
        ("Lageos2/lageos2_cpf_160213_5441.sgf", 25.0),
    ],
)
def test_rows_held_out_of_a_cpf_are_found_again(cases: Path, name: str, most_mm: float) -> None:
    (one,) = read_ephemerides(cases / "ephemerides" / name)
    (segment,) = one.segments
    missed = missed_mm(segment, 7)
    assert len(missed) > 80
    assert missed.max() < most_mm


def test_rows_whose_dates_were_rounded_are_found_again_when_that_is_undone(cases: Path) -> None:
    # Whoever made this file turned the Earth by a Julian date in one double, whose last bit is 40 µs: its
    # rows are up to 15 mm to the east or west of where they belong.
    (one,) = read_ephemerides(cases / "ephemerides/Lageos2/lageos2_cpf_160213_5441.sgf")
    (segment,) = one.segments
    days = (segment.since_s - segment.since_s[0]) / 86400.0
    lost_s = ((2457431.5 + days) - 2457431.5 - days) * 86400.0
    assert 17e-6 < np.abs(lost_s).max() < 21e-6
    c, s = np.cos(7.292115e-5 * lost_s), np.sin(7.292115e-5 * lost_s)
    x, y, z = segment.place_km.T
    back = replace(segment, place_km=np.stack([x * c - y * s, x * s + y * c, z], axis=1))
    assert missed_mm(segment, 7).max() > 20.0
    assert missed_mm(back, 7).max() < 6.0
    # With all other rows there, as in use; what a row itself is off by counts double.
    assert missed_mm(back, 1, every=15).max() < 7.0


def test_rows_held_out_of_an_sp3_of_all_constellations_are_found_again(cases: Path) -> None:
    found = read_ephemerides(cases / "ephemerides/sp3/gbm18432.sp3.Z")
    assert len(found) == 71
    for one in found:
        for segment in one.segments:
            if len(segment.since_s) > 100:
                assert missed_mm(segment, 6).max() < 5.0


@pytest.mark.parametrize(
    ("name", "most_mm"),
    [
        ("ilrs/lageos1_cpf_180613_16401.hts", 0.1),
        ("ilrs/galileo212_cpf_180613_6641.esa", 0.1),
        ("Lageos2/lageos2_cpf_160213_5441.sgf", 1.0),
        # Every three minutes, and an uneven field 800 km below.
        ("sp3/nsgf.orb.stella.v00.sp3.gz", 5.0),
    ],
)
def test_between_rows_as_they_stand_two_rows_more_change_little(
    cases: Path, name: str, most_mm: float
) -> None:
    (one,) = read_ephemerides(cases / "ephemerides" / name)
    (segment,) = one.segments
    rows = segment.interpolation.rows
    since = 0.5 * (segment.since_s[1:] + segment.since_s[:-1])[rows // 2 + 2 : -rows // 2 - 2]
    more = replace(segment, interpolation=replace(segment.interpolation, rows=rows + 2))
    moved = np.linalg.norm(more.native_many(since)[:3] - segment.native_many(since)[:3], axis=0)
    assert len(moved) > 80
    assert moved.max() * 1e6 < most_mm


def test_velocities_that_are_not_those_of_the_places_are_not_used(cases: Path) -> None:
    # The Earth's uneven field moves Stella, 800 km high, within minutes; its file's velocities are up to
    # 15 mm/s off those of its places, and rows interpolated with them are missed by two metres.
    (one,) = read_ephemerides(cases / "ephemerides/sp3/nsgf.orb.stella.v00.sp3.gz")
    (segment,) = one.segments
    assert segment.interpolation == Interpolation(12, False)
    assert "Lagrange, degree 11" in one.provenance
    assert max(missed_mm(segment, 1, every=13 + k).max() for k in range(13)) < 450.0


def test_velocities_that_are_those_of_the_places_are_used() -> None:
    t = np.arange(60) * 300.0
    place, velocity = orbit(t)
    place, velocity = np.round(place, 6), np.round(velocity, 9)
    given = Segment(
        0.0, t, place, velocity, Frame("GCRF", "GCRF"), Interpolation(6, True), (0.0, float(t[-1]))
    )
    assert without_poor_velocities(given, Interpolation(12, False)) is given
    velocity = velocity + 1e-5 * np.random.default_rng(1).normal(size=velocity.shape)
    poor = without_poor_velocities(replace(given, velocity_km_s=velocity), Interpolation(12, False))
    assert not poor.interpolation.with_velocities
    few = replace(given, since_s=t[:8], place_km=place[:8], velocity_km_s=velocity[:8])
    assert without_poor_velocities(few, Interpolation(12, False)) is few


# Of Space-Track, for the day after the file's; from the tests of CS-SI/Orekit.
LAGEOS_2 = (
    "1 22195U 92070B   16045.51027931 -.00000009  00000-0  00000+0 0  9990\n"
    "2 22195  52.6508 132.9147 0137738 336.2706   1.6348  6.47294052551192\n"
)


def test_predictions_and_elements_of_one_day_agree_within_what_they_state(cases: Path) -> None:
    (one,) = read_ephemerides(cases / "ephemerides/Lageos2/lageos2_cpf_160213_5441.sgf")
    (elements,) = parse_elements(LAGEOS_2)
    assert isinstance(elements, Elements)
    first, last = (float(end.unix_s) for end in one.spans[0])
    at = np.linspace(first, last, 200)
    places = [np.array(each.states(EARTH).at_many(at, 0.0)[:3]) for each in (one, elements)]
    apart_m = 1000.0 * np.linalg.norm(places[1] - places[0], axis=0)
    stated_m = np.array([expected_error_m(elements, Utc(t)) or 0.0 for t in at.tolist()])
    assert apart_m.min() > 50.0
    assert np.sqrt(np.mean((apart_m / stated_m) ** 2)) < 1.2
    assert (apart_m / stated_m).max() < 2.0


def test_two_files_of_one_day_agree_within_what_they_state(cases: Path) -> None:
    whole = read_ephemerides(cases / "ephemerides/sp3/gbm18432.sp3.Z")
    for part in read_ephemerides(cases / "ephemerides/sp3/three-hours.sp3"):
        other = find_ephemeris(whole, part.name)
        at = np.linspace(*(float(end.unix_s) for end in part.spans[0]), 200)
        places = [np.array(each.states(EARTH).at_many(at, 0.0)[:3]) for each in (part, other)]
        apart_m = 1000.0 * np.linalg.norm(places[1] - places[0], axis=0)
        stated_m = expected_error_m(part, Utc(float(at[0])))
        assert stated_m is not None
        # The polynomials lean to one side where the rows of one end, and are apart there alone.
        assert 1e-3 < apart_m.max() < 0.02 * stated_m
        assert apart_m[60:140].max() < 1e-4


def test_the_same_orbit_is_the_same_in_gcrf_and_itrf(cases: Path) -> None:
    # Orekit wrote both, without UT1 and polar motion.
    earth = EarthOrientation.fixed(0.0)
    folder = cases / "ephemerides/oem"
    turned = []
    for name, frame in (
        ("OEMExample5.txt", Frame("GCRF", "GCRF")),
        ("OEMExample5ITRF.txt", Frame("ITRF", "ITRF2014")),
    ):
        rows = [line.split() for line in (folder / name).read_text().splitlines() if line.startswith("2017-")]
        unix_s = np.array([float(Utc.parse(row[0][:26]).unix_s) for row in rows])
        state = np.array([[float(word) for word in row[1:7]] for row in rows]).T
        assert state.shape == (6, 49)
        turned.append(np.array(frame.to_teme(earth, unix_s, (*state, *np.zeros((3, 49))), ARRAYS)[:6]))
    assert np.abs(turned[0][:3] - turned[1][:3]).max() < 2e-3
    assert np.abs(turned[0][3:] - turned[1][3:]).max() < 2e-6


def test_every_file_is_read_or_refused_with_its_line(cases: Path) -> None:
    read, refused = {}, []
    for path in sorted((cases / "ephemerides").rglob("*.*")):
        if path.suffix == ".md":
            continue
        try:
            found = read_ephemerides(path)
            read[path.name] = len(found)
            refused += [(path, one.line, str(one)) for one in found[0].refused.values()]
            for one in found:
                at = np.array([float(one.spans[0][0].unix_s)])
                assert one.states(EARTH).at_many(at, 0.0)[-1].tolist() == [0]
        except EphemerisError as error:
            refused.append((path, error.line, str(error)))
    assert read == {
        "lageos2_cpf_160213_5441.sgf": 1,
        "galileo212_cpf_180613_6641.esa": 1,
        "lageos1_cpf_180613_16401.hts": 1,
        "gbm18432.sp3.Z": 71,
        "gbm19500_large_gap.sp3": 3,
        "gbm19500_truncated.sp3": 3,
        "issue1327-136-sats.sp3": 133,
        "nsgf.orb.stella.v00.sp3.gz": 1,
        "three-hours.sp3": 2,
    }
    # Whole files, and satellites of the three in which others can be placed.
    assert len(refused) == 23 + 84 + 84 + 3
    for path, line, words in refused:
        assert line is not None
        assert words.startswith(f"{path}:{line}: ")
        assert "\n" not in words


def orbit(t: Array) -> tuple[Array, Array]:
    """Return places (km) and velocities of a round orbit at seconds."""
    c, s = np.cos(TURN * t), np.sin(TURN * t)
    place = RADIUS * np.stack([c, 0.5 * s, np.sqrt(0.75) * s], axis=-1)
    velocity = RADIUS * TURN * np.stack([-s, 0.5 * c, np.sqrt(0.75) * c], axis=-1)
    return place, velocity


def stamp(second: float, date: str = "2026-03-01") -> str:
    hour, rest = divmod(second, 3600.0)
    return f"{date}T{int(hour):02d}:{int(rest // 60):02d}:{rest % 60:06.3f}"


def oem(count: int = 20, system: str = "UTC", frame: str = "GCRF", more: str = "", start: float = 0.0) -> str:
    t = np.arange(count) * 60.0
    place, velocity = orbit(t)
    rows = "\n".join(
        f"{stamp(start + s)} {' '.join(f'{v:.9f}' for v in (*p, *w))}"
        for s, p, w in zip(t.tolist(), place, velocity, strict=True)
    )
    return (
        f"META_START\nOBJECT_NAME = ROUND\nOBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\nREF_FRAME = {frame}\n"
        f"TIME_SYSTEM = {system}\nSTART_TIME = {stamp(start)}\nSTOP_TIME = {stamp(start + t[-1])}\n{more}"
        f"META_STOP\n{rows}\n"
    )


HEAD = "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-02-28T12:00:00\nORIGINATOR = US\n"
COVARIANCE = (
    "COVARIANCE_START\nEPOCH = 2026-03-01T00:10:00\nCOV_REF_FRAME = RTN\n4.0e-6\n0 9.0e-6\n0 0 1.0e-6\n"
    "0 0 0 1e-9\n0 0 0 0 1e-9\n0 0 0 0 0 1e-9\nCOVARIANCE_STOP\n"
)


def one_of(text: str) -> TableEphemeris:
    (one,) = parse_ephemerides(text.encode(), "a.oem")
    return one


def place_at(one: TableEphemeris, utc: str) -> Array:
    states = one.states(EARTH)
    return np.array(states.at(float(Utc.parse(utc).unix_s), 0.0)[:3])


@pytest.mark.parametrize(
    ("system", "first_utc_s"),
    [("UTC", 0.0), ("TAI", -37.0), ("GPS", -18.0), ("TT", -69.184), ("TDB", -69.184)],
)
def test_time_systems_differ_by_what_they_differ_by(system: str, first_utc_s: float) -> None:
    one = one_of(HEAD + oem(system=system, frame="TEME"))
    # TDB is within 1.7 ms of TT, and its rows are where erfa's TDB has them, not TT.
    assert float(one.spans[0][0].unix_s) - float(Utc.parse("2026-03-01").unix_s) == pytest.approx(
        first_utc_s, abs=2e-3 if system == "TDB" else 1e-6
    )
    at = float(Utc.parse("2026-03-01").unix_s) + 300.0
    expected, _ = orbit(np.array(300.0 - first_utc_s))
    state = np.array(one.states(EARTH).at(at, 0.0)[:3])
    assert np.linalg.norm(state - expected) < (0.015 if system == "TDB" else 1e-5)


@pytest.mark.parametrize(("name", "usual"), [("TEMEOFDATE", "TEME"), ("TOD_EARTH", "TOD")])
def test_frames_may_have_the_names_of_the_registry_of_ccsds(name: str, usual: str) -> None:
    places = [
        place_at(one_of(HEAD + oem(frame=frame)), "2026-03-01T00:05:30") for frame in (name, usual, "GCRF")
    ]
    assert np.array_equal(places[0], places[1])
    assert not np.allclose(places[0], places[2])


def test_a_leap_second_within_the_rows_is_a_second_of_motion() -> None:
    # 2016-12-31 had 86401 seconds: rows a minute apart by TAI, told in UTC.
    t = np.arange(20) * 60.0
    place, velocity = orbit(t)
    stamps = [
        f"2016-12-31T{23:02d}:{int(50 + s // 60):02d}:00"
        if s < 600.0
        else f"2017-01-01T00:{int(s // 60 - 11):02d}:59"
        for s in t.tolist()
    ]
    stamps[10] = "2016-12-31T23:59:60"
    rows = "\n".join(
        f"{when} {' '.join(f'{v:.9f}' for v in (*p, *w))}"
        for when, p, w in zip(stamps, place, velocity, strict=True)
    )
    head = oem(frame="TEME").split("META_STOP\n")[0]
    head = head.replace(stamp(0.0), stamps[0]).replace(stamp(19 * 60.0), stamps[-1])
    one = one_of(f"{HEAD}{head}META_STOP\n{rows}\n")
    for seconds, utc in ((570.0, "2016-12-31T23:59:30"), (631.0, "2017-01-01T00:00:30")):
        expected, _ = orbit(np.array(seconds))
        assert np.linalg.norm(place_at(one, utc) - expected) < 1e-5


def burn(t: Array) -> tuple[Array, Array]:
    """Return places and velocities of an orbit on which engines push northward from 9600 s to 10200 s."""
    place, velocity = orbit(t)
    push_km_s2, on = 1e-6, np.clip(t - 9600.0, 0.0, 600.0)
    place[:, 2] += push_km_s2 * (0.5 * on**2 + on * np.maximum(t - 10200.0, 0.0))
    velocity[:, 2] += push_km_s2 * on
    return place, velocity


@pytest.mark.parametrize("between", [(), (9660.0, 9720.0)])
def test_what_engines_do_is_not_carried_on_where_rows_are_far_apart(between: tuple[float, ...]) -> None:
    # As the ISS' public file has it: rows every 2 s in a burn, every few minutes elsewhere; one row here and
    # there between two others.
    inside = np.arange(9600.0, 10201.0, 2.0)
    if between:
        inside = np.concatenate([[9600.0, *between], np.arange(9740.0, 10201.0, 2.0)])
    t = np.concatenate([np.arange(0.0, 9600.0, 120.0), [4470.0], inside, np.arange(10320.0, 19900.0, 120.0)])
    t.sort()
    place, velocity = burn(t)
    rows = "\n".join(
        f"{stamp(s)} {' '.join(f'{v:.9f}' for v in (*p, *w))}"
        for s, p, w in zip(t.tolist(), place, velocity, strict=True)
    )
    head = oem(2).split("META_STOP")[0].replace(stamp(60.0), stamp(float(t[-1])))
    one = one_of(f"{HEAD}{head}META_STOP\n{rows}\n")
    assert len(one.spans) == 1
    at = np.linspace(10.0, float(t[-1]) - 10.0, 2000)
    start = float(Utc.parse("2026-03-01").unix_s)
    # Of the GCRF and of TEME alike, so that only distances count.
    places = np.array(one.states(EARTH).at_many(start + at, 0.0)[:3])
    wanted, _ = burn(at)
    frame = Frame("GCRF", "GCRF")
    turned = np.array(frame.to_teme(EARTH, start + at, (*wanted.T, *np.zeros((6, len(at)))), ARRAYS)[:3])
    assert np.linalg.norm(places - turned, axis=0).max() < 1e-3


def test_an_xml_is_read_as_its_kvn() -> None:
    text = HEAD + oem(frame="EME2000") + COVARIANCE
    lines = iter(text.splitlines())
    rows: list[str] = []
    metadata = []
    for line in lines:
        if line == "META_START":
            while (line := next(lines)) != "META_STOP":
                key, value = line.split(" = ")
                metadata.append(f"<{key}>{value}</{key}>")
        elif line == "COVARIANCE_START":
            break
        elif line[:1].isdigit():
            values = dict(zip(("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT"), line.split(), strict=True))
            rows.append(
                "<stateVector>" + "".join(f"<{k}>{v}</{k}>" for k, v in values.items()) + "</stateVector>"
            )
    xml = (
        '<?xml version="1.0"?>\n<oem id="CCSDS_OEM_VERS" version="2.0"><header>\n'
        "<CREATION_DATE>2026-02-28T12:00:00</CREATION_DATE><ORIGINATOR>US</ORIGINATOR></header>\n"
        f"<body><segment><metadata>{''.join(metadata)}</metadata>\n<data>" + "\n".join(rows) + "</data>"
        "</segment></body></oem>\n"
    )
    one, other = one_of(xml), one_of(text)
    # The last number of a row may be shorter than the one above it: that is no end in the middle.
    shorter = re.sub(r"\d{3}(</Z_DOT></stateVector>)$", r"\1", rows[-1])
    assert one_of(xml.replace(rows[-1], shorter)).provenance == other.provenance
    assert one.provenance == other.provenance
    assert np.array_equal(one.segments[0].place_km, other.segments[0].place_km)
    assert np.array_equal(one.segments[0].since_s, other.segments[0].since_s)
    with pytest.raises(EphemerisError, match=r"a\.oem:5: .*no X"):
        one_of(xml.replace("<X>", "<Q>").replace("</X>", "</Q>"))


def long_xml(count: int = 60) -> list[str]:
    """Return the lines of an XML whose rows take nine lines each."""
    lines = oem(count).splitlines()
    metadata = [line.split(" = ") for line in lines if " = " in line]
    xml = ['<?xml version="1.0"?>', '<oem version="2.0"><body><segment><metadata>']
    xml += [f"<{key}>{value}</{key}>" for key, value in metadata] + ["</metadata><data>"]
    for row in (line for line in lines if line[:1].isdigit()):
        xml.append("<stateVector>")
        names = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
        xml += [f"<{key}>{value}</{key}>" for key, value in zip(names, row.split(), strict=True)]
        xml.append("</stateVector>")
    return [*xml, "</data></segment></body></oem>", ""]


@pytest.mark.parametrize(
    ("before", "after", "line", "words"),
    [
        ("<Y>.*</Y>", "<Y>one</Y>", 1, "a row: 'one' is no number"),
        ("<Y>.*</Y>", "<Y>1 2</Y>", 1, "a row has 7 numbers where 6 or 9 belong"),
        ("<Y>.*</Y>", "<Y>1&gt;</Y>", 1, "a row: '1>' is no number"),
        ("<Y>.*</Y>", "", 1, "stateVector has no Y"),
        ("<X>", "<X units='m'>", 3, "X is in 'm': an OEM has km"),
        ("</Y>", "", 9, "no XML: mismatched tag"),
    ],
)
@pytest.mark.parametrize("at_once", [500, 1 << 20])
def test_what_is_wrong_in_a_row_of_a_long_xml_is_named_with_its_line(
    before: str, after: str, line: int, words: str, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tle.formats.oem._XML_AT_ONCE", at_once)
    lines = long_xml()
    first = lines.index("<stateVector>") + 9 * 40
    row = re.sub(before, after, "\n".join(lines[first : first + 9]))
    with pytest.raises(EphemerisError, match=f"^a.oem:{first + line}: {words}"):
        one_of("\n".join([*lines[:first], row, *lines[first + 9 :]]))


@pytest.mark.parametrize("at_once", [500, 1 << 20])
def test_a_long_xml_has_the_rows_of_its_kvn_and_none_of_its_comments(
    at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tle.formats.oem._XML_AT_ONCE", at_once)
    lines, other = long_xml(), one_of(HEAD + oem(60))
    first = lines.index("<stateVector>")
    aside = ["<!--", *lines[first : first + 18], "-->"]
    padded = [re.sub(r">(\d.*)<", r">  \1 <", line) for line in lines]
    for text in (lines, padded, *([*lines[:k], *aside, *lines[k:]] for k in (first, first + 90))):
        one = one_of("\n".join(text))
        assert np.array_equal(one.segments[0].place_km, other.segments[0].place_km)
        assert np.array_equal(one.segments[0].since_s, other.segments[0].since_s)


def test_each_of_many_covariances_has_its_instant_axes_and_numbers() -> None:
    axes = ("", "COV_REF_FRAME = RTN\n", "COV_REF_FRAME = TNW\n")
    blocks = [
        f"EPOCH = {stamp(60.0 * k)}\n{axes[k % 3]}"
        + "".join(" ".join(str(float(10 * k + row + j)) for j in range(row + 1)) + "\n" for row in range(6))
        for k in range(20)
    ]
    one = one_of(HEAD + oem(20) + "COVARIANCE_START\n" + "".join(blocks) + "COVARIANCE_STOP\n")
    for k in range(20):
        found = one.covariance(Utc.parse(stamp(60.0 * k)))
        assert found is not None
        assert (found.at, found.frame) == (Utc.parse(stamp(60.0 * k)), ("GCRF", "RTN", "TNW")[k % 3])
        row, column = np.indices((6, 6))
        assert np.array_equal(found.matrix, 10.0 * k + row + column)
    short = blocks[13].split("\n")
    short[4] = short[4].rpartition(" ")[0]
    blocks[13] = "\n".join(short)
    text = HEAD + oem(20) + "COVARIANCE_START\n" + "".join(blocks) + "COVARIANCE_STOP\n"
    line = text[: text.index(f"EPOCH = {stamp(60.0 * 13)}")].count("\n") + 5
    with pytest.raises(EphemerisError, match=f"^a.oem:{line}: a covariance's row has 2 numbers where 3"):
        one_of(text)


def test_a_covariance_is_that_of_the_nearest_instant() -> None:
    one = one_of(HEAD + oem() + COVARIANCE)
    found = one.covariance(Utc.parse("2026-03-01T00:02:00"))
    assert found is not None
    assert found.frame == "RTN"
    assert found.at == Utc.parse("2026-03-01T00:10:00")
    assert found.sigma_km == pytest.approx(np.sqrt(14.0e-6))
    assert found.matrix[1, 1] == 9.0e-6


@pytest.mark.parametrize(
    "name",
    [
        "RTN",
        "RSW",
        "RIC",
        "UVW",
        "TNW",
        "LVLH",
        "RSW_INERTIAL",
        "tnw_rotating",
        "ITRF-97",
        "MOD",
        "GRC",
        "TDR",
    ],
)
def test_a_covariance_is_read_in_the_axes_that_the_standard_names(name: str) -> None:
    found = one_of(HEAD + oem() + COVARIANCE.replace("RTN", name)).covariance(Utc.parse("2026-03-01"))
    assert found is not None
    assert found.frame == name


@pytest.mark.parametrize("name", ["RTM", "", "EQUINOCTIAL", "RTN RSW", "_"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_covariance_in_unknown_axes_is_refused_with_its_line(name: str, count: int) -> None:
    text = HEAD + oem() + (count - 1) * COVARIANCE + COVARIANCE.replace("RTN", name)
    line = text.splitlines().index(f"COV_REF_FRAME = {name}") + 1
    with pytest.raises(EphemerisError, match=f"^a.oem:{line}: COV_REF_FRAME '{name}' is not known: RTN, "):
        one_of(text)


def test_segments_hold_for_their_useable_times_and_nothing_between_them() -> None:
    first = oem(more=f"USEABLE_STOP_TIME = {stamp(900.0)}\n")
    second = oem(start=1200.0, more=f"USEABLE_START_TIME = {stamp(1260.0)}\n")
    one = one_of(HEAD + first + second)
    assert [(a.isoformat("seconds")[14:19], b.isoformat("seconds")[14:19]) for a, b in one.spans] == [
        ("00:00", "15:00"),
        ("21:00", "39:00"),
    ]
    propagator = Propagator(one, LEIDEN)
    with pytest.raises(
        EphemerisSpanError, match=r"no place at 2026-03-01T00:18:00.000Z: the end of a segment"
    ):
        propagator.at(Utc.parse("2026-03-01T00:18:00"))
    with pytest.raises(EphemerisSpanError, match=r"is from 2026-03-01T00:00:00.000Z to 2026-03-01T00:39:00"):
        propagator.at(Utc.parse("2026-03-01T02:00:00"))
    start = float(Utc.parse("2026-03-01").unix_s)
    seen = propagator.at(Utc(start + np.array([-1.0, 60.0, 1000.0, 1300.0, 9000.0])))
    assert seen.error.tolist() == [101, 0, 103, 0, 102]
    assert np.isnan(seen.alt_deg).tolist() == [True, False, True, False, True]


REFUSED = {
    "TOPOCENTRIC": (HEAD + oem(frame="TOPOCENTRIC"), 8, "REF_FRAME TOPOCENTRIC is not known"),
    "mars": (HEAD + oem().replace("EARTH", "MARS"), 7, "CENTER_NAME MARS"),
    "UT1": (HEAD + oem(system="UT1"), 9, "TIME_SYSTEM UT1 is not known"),
    "overlap": (HEAD + oem() + oem(start=600.0), 42, "overlap those from line 13"),
    "cut in a row": (HEAD + oem()[:-60], 32, "has 2 numbers where 6 or 9 belong"),
    "cut after a row": (HEAD + "\n".join(oem().splitlines()[:-3]) + "\n", 29, "the text is cut off"),
    "cut in the metadata": (HEAD + oem()[:90], 8, "ends before META_STOP"),
    "no rows": (HEAD + oem().split("META_STOP\n")[0] + "META_STOP\n", 12, "no rows follow"),
    "no row in its time": (
        HEAD
        + oem(start=600.0)
        .replace(f"= {stamp(600.0)}", f"= {stamp(0.0)}")
        .replace(f"= {stamp(1740.0)}", f"= {stamp(60.0)}"),
        11,
        "no row lies between START_TIME and STOP_TIME",
    ),
    "word": (HEAD + oem().replace(" 6985", " 69x5", 1), 14, "is no number"),
    "not finite": (HEAD + oem().replace(" -", " nan -", 1), 13, "has 7 numbers"),
    "time": (HEAD + oem().replace("T00:05:00.000 ", "T00:65:00.000 "), 18, "is no time"),
    "date": (HEAD + oem().replace("2026-03-01T00:05:00.000 ", "2026-02-29T00:05:00.000 "), 18, "is no time"),
    "order": (HEAD + oem().replace("T00:05:00.000 ", "T00:04:00.000 "), 18, "not later than the row before"),
    "version": (HEAD.replace("2.0", "9.0") + oem(), 1, "OEM version '9.0' is not known"),
    "interpolation": (HEAD + oem(more="INTERPOLATION = SPLINE\n"), 12, "SPLINE is not known"),
    "metres": (HEAD + oem().replace("GCRF", "ITRF2014"), 13, "no orbit about the Earth"),
    "covariance": (HEAD + oem() + COVARIANCE.replace("0 0 1.0e-6\n", ""), 38, "has 4 numbers where 3 belong"),
    "other": ("hello\n", 1, "neither CPF nor OEM nor SP3"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_text_is_refused_with_its_line(name: str) -> None:
    text, line, words = REFUSED[name]
    with pytest.raises(EphemerisError) as caught:
        one_of(text).states(EARTH)
    assert str(caught.value).startswith(f"a.oem:{line}: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def cpf(
    flag: int = 0, frame: int = 0, direction: int = 0, skip: tuple[int, ...] = (), end: str = "99\n"
) -> str:
    t = np.arange(40) * 60.0
    rows = "".join(
        f"10 {direction} 61100 {s:13.6f} {flag} {x * 1e3:.3f} {y * 1e3:.3f} {z * 1e3:.3f}\n"
        for k, (s, (x, y, z)) in enumerate(zip(t.tolist(), orbit(t)[0], strict=True))
        if k not in skip
    )
    return (
        "H1 CPF  2  XYZ 2026 02 28 12 059 1 round\n"
        "H2 2600101 1234 99999 2026 03 01 00 00 00 2026 03 01 00 39 00    60 1 1 "
        f"{frame} 0 0 1\nH9\n{rows}{end}"
    )


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (cpf(flag=1, frame=2), 4, "leap second flag 1, but 0 leap seconds came"),
        (cpf(frame=7), 2, "reference frame 7 is not known"),
        (cpf(direction=2, frame=2), 4, "direction flag 2 (receive)"),
        (cpf(frame=2, end=""), 43, "without its record 99"),
        (cpf(frame=2)[:1500], 26, "without its record 99"),
        (cpf(frame=2).replace("CPF  2", "CPF  3"), 1, "CPF version 3 is not known"),
        (cpf(frame=0), 4, "no orbit about the Earth"),
    ],
)
def test_bad_cpf_is_refused_with_its_line(text: str, line: int, words: str) -> None:
    with pytest.raises(EphemerisError) as caught:
        one_of(text).states(EARTH)
    assert str(caught.value).startswith(f"a.oem:{line}: ")
    assert words in str(caught.value)


def test_rows_of_a_cpf_are_no_gaps_where_its_header_has_another_step() -> None:
    one, other = (one_of(text) for text in (cpf(frame=2), cpf(frame=2).replace("   60 1 1", "   30 1 1")))
    assert one.spans == other.spans
    assert np.array_equal(one.segments[0].place_km, other.segments[0].place_km)


def test_a_gap_in_a_cpf_has_no_place() -> None:
    one = one_of(cpf(frame=2, skip=(19, 20, 21)))
    states = one.states(EARTH)
    start = float(Utc.parse("2026-03-01").unix_s)
    with pytest.raises(
        EphemerisSpanError, match=r"a gap in a\.oem from 2026-03-01T00:18:00.000Z to .*00:22:00"
    ):
        states.at(start + 1200.0, 0.0)
    assert states.at_many(start + np.array([1080.0, 1100.0, 1320.0]), 0.0)[-1].tolist() == [0, 103, 0]


def test_a_manoeuvre_in_an_sp3_is_not_interpolated_across() -> None:
    lines = sp3().splitlines()
    at = lines.index("*  2026  3  1  0 10  0.00000000") + 1
    lines[at] = lines[at].ljust(78) + "M"
    text = "\n".join([*lines, ""])
    one = one_of(text)
    assert [segment.why for segment in one.segments] == ["a gap", "a manoeuvre"]
    with pytest.raises(EphemerisSpanError, match="a manoeuvre"):
        one.states(EARTH).at(float(Utc.parse("2026-03-01T00:09:30").unix_s), 0.0)
    for name in ("J2000", "WGS72", "PZ-90"):
        with pytest.raises(EphemerisError, match=f"frame '{name}' is not known"):
            one_of(text.replace("IGS20", name))
    assert one_of(text.replace("IGS20", "WGS84"))


def test_of_several_satellites_those_that_can_be_placed_are_read(tmp_path: Path) -> None:
    path = tmp_path / "two.sp3"
    text = sp3().replace("+    1   L51", "+    2   L51G01")
    # Another one that stands still, which no satellite does.
    path.write_text(re.sub(r"(\*  .*\n)", r"\1PG01  20000.000000      0.000000      0.000000\n", text))
    found = read_ephemerides(path)
    assert [one.name for one in found] == ["L51"]
    assert find_ephemeris(found, "l51") is found[0]
    with pytest.raises(EphemerisError, match=r"two\.sp3:6: the rows of G01 .* no orbit about the Earth"):
        find_ephemeris(found, "G01")


def test_linear_and_lagrange_are_taken_from_the_file() -> None:
    # No orbit is straight between rows.
    with pytest.raises(EphemerisError, match=r"too far apart to interpolate \(Lagrange, degree 1\)"):
        one_of(HEAD + oem(more="INTERPOLATION = LINEAR\n"))
    more = "INTERPOLATION = LAGRANGE\nINTERPOLATION_DEGREE = 7\n"
    assert one_of(HEAD + oem(more=more)).segments[0].interpolation == Interpolation(8, False)
    more = "INTERPOLATION = HERMITE\nINTERPOLATION_DEGREE = 7\n"
    assert one_of(HEAD + oem(more=more)).segments[0].interpolation == Interpolation(4, True)


def test_an_object_is_found_by_what_its_file_calls_it(tmp_path: Path) -> None:
    path = tmp_path / "round.cpf.gz"
    path.write_bytes(gzip.compress(cpf(frame=2).encode()))
    found = read_ephemerides(path)
    for key in ("ROUND", "99999", "2026-001A", "26-001A", "26001A", "2026001a", "2600101", " 1234 "):
        assert find_ephemeris(found, key) is found[0]
    for key in ("0", "2026-001B", "2600102", "2026-001", ""):
        with pytest.raises(SatelliteNotFoundError):
            find_ephemeris(found, key)
    with pytest.raises(SatelliteNotFoundError, match=r"no object 'ISS' in .*gz, which holds round \(99999\)"):
        find_ephemeris(found, "ISS")
    with pytest.raises(SourceError, match="cannot read the ephemeris"):
        read_ephemerides(tmp_path / "absent")
    path.write_bytes(gzip.compress(cpf(frame=2).encode())[:-20])
    with pytest.raises(EphemerisError, match="gzip"):
        read_ephemerides(path)


def test_the_object_of_a_laser_stations_file_is_found_by_each_of_its_numbers(cases: Path) -> None:
    # The ILRS lists LAGEOS-1 as COSPAR 7603901, SIC 1155, NORAD 8820.
    found = read_ephemerides(cases / "ephemerides/ilrs/lageos1_cpf_180613_16401.hts")
    for key in ("LAGEOS-1", "1155", "8820", "7603901", "76039A", "76-039A", "1976-039A"):
        assert find_ephemeris(found, key) is found[0]


DESIGNATORS = ("1998-067A", "98067A", "1998067A", "98-067A", "9806701")


@pytest.mark.parametrize(
    ("written", "keys"),
    [("1998-067-A", DESIGNATORS), ("1998-067A", DESIGNATORS), ("98067A", DESIGNATORS), ("25544", ())],
)
def test_the_station_of_an_oem_is_found_however_its_id_is_written(
    written: str, keys: tuple[str, ...]
) -> None:
    text = (HEAD + oem(8)).replace("NAME = ROUND", "NAME = ISS").replace("2026-001A", written)
    found = parse_ephemerides(text.encode())
    for key in ("25544", "ISS", "International Space Station", *keys):
        assert find_ephemeris(found, key) is found[0]


@pytest.mark.parametrize("written", ["A0534", "100534"])
def test_a_number_above_99999_is_found_however_a_file_writes_it(written: str) -> None:
    for text in ((HEAD + oem(8)).replace("2026-001A", written), cpf(frame=2).replace("99999", written)):
        found = parse_ephemerides(text.encode())
        for key in ("100534", "A0534", "a0534"):
            assert find_ephemeris(found, key).catalog_number == 100534


def test_a_name_is_found_without_what_is_in_brackets_and_by_it() -> None:
    found = parse_ephemerides(
        (HEAD + oem(8)).replace("NAME = ROUND", "NAME = STARLINK-1234 (V1.5 X)").encode()
    )
    for key in ("starlink-1234", "STARLINK 1234", "v1.5 x", "starlink-1234 (v1.5 x)"):
        assert find_ephemeris(found, key) is found[0]
    for key in ("starlink-123", "starlink", "v1.5", "()"):
        with pytest.raises(SatelliteNotFoundError):
            find_ephemeris(found, key)


def test_of_two_objects_of_one_name_the_user_must_say_which() -> None:
    other = oem(8).replace("2026-001A", "2026-001B").replace("= GCRF", "= EME2000")
    found = parse_ephemerides((HEAD + oem(8) + other).encode(), "a.oem")
    with pytest.raises(AmbiguousSatelliteError) as caught:
        find_ephemeris(found, "round")
    assert str(caught.value) == (
        "'round' could be any of 2 in a.oem: ROUND (2026-001A), ROUND (2026-001B): "
        "give a number, designator or name that only one has"
    )
    assert find_ephemeris(found, "2026-001B") is found[1]
    assert find_ephemeris(found, "26001A") is found[0]


def test_a_cpf_whose_object_has_no_sic_number_is_found_by_others_only() -> None:
    for sic in ("0", "-1", "n/a"):
        found = parse_ephemerides(cpf(frame=2).replace(" 1234 ", f" {sic} ").encode())
        assert find_ephemeris(found, "round") is found[0]
        for key in ("0", "1", "na"):
            with pytest.raises(SatelliteNotFoundError):
                find_ephemeris(found, key)


def test_a_catalogue_number_is_taken_before_another_objects_sic_number() -> None:
    by_sic = parse_ephemerides(cpf(frame=2).encode())
    by_number = parse_ephemerides(cpf(frame=2).replace(" 1234 99999 ", " 99 1234 ").encode())
    assert find_ephemeris([*by_sic, *by_number], "1234") is by_number[0]


def sp3(count: int = 20) -> str:
    t = np.arange(count) * 60.0
    spin = 7.292115e-5 * t
    x, y, z = orbit(t)[0].T
    fixed = np.stack([x * np.cos(spin) + y * np.sin(spin), y * np.cos(spin) - x * np.sin(spin), z], axis=1)
    rows = "".join(
        f"*  2026  3  1  0 {k:2d}  0.00000000\nPL51{p[0]:14.6f}{p[1]:14.6f}{p[2]:14.6f}      0.000000\n"
        for k, p in enumerate(fixed)
    )
    return (
        f"#cP2026  3  1  0  0  0.00000000 {count:7d} ORBIT IGS20 HLM  XYZ\n"
        "## 2408      0.00000000    60.00000000 61100 0.0000000000000\n+    1   L51\n"
        f"%c L  cc UTC ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc\n{rows}EOF\n"
    )


WHOLE = {"oem": HEAD + oem(8), "cpf": cpf(frame=2), "sp3": sp3(8)}


@pytest.mark.parametrize("name", WHOLE)
def test_text_that_ends_anywhere_is_refused_with_a_line(name: str) -> None:
    data = WHOLE[name].encode()
    assert parse_ephemerides(data)
    # The line end of the last line may be missing.
    assert parse_ephemerides(data[:-1])
    for end in range(1, len(data) - 1, 5):
        with pytest.raises(EphemerisError) as caught:
            parse_ephemerides(data[:end])
        assert caught.value.line is not None


@pytest.mark.parametrize("name", WHOLE)
def test_whatever_is_in_a_text_it_is_read_or_refused_by_name(name: str) -> None:
    draw = random.Random(name)
    data = WHOLE[name].encode()
    refused = 0
    for _ in range(300):
        changed = bytearray(data)
        for _ in range(draw.choice((1, 1, 2, 8))):
            at = draw.randrange(len(changed))
            changed[at : at + draw.randrange(3)] = bytes(
                draw.randrange(256) for _ in range(draw.randrange(3))
            )
        try:
            for one in parse_ephemerides(bytes(changed)):
                one.states(EARTH)
        except EphemerisError:
            refused += 1
    assert refused > 50

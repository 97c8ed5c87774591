from __future__ import annotations

import dataclasses
import gzip
import io

import pytest
from tle_facts import ISS, STARLINK_ALPHA5, TDRS3

from tle.elements import Elements
from tle.errors import (
    AmbiguousSatelliteError,
    ChecksumError,
    SatelliteNotFoundError,
    SourceError,
)
from tle.instants import Utc
from tle.sources import find, load_elements, newest, read_elements, write_elements

ZARYA = Elements.from_tle(*ISS, name="ISS (ZARYA)")
STATION = [
    ZARYA,
    dataclasses.replace(ZARYA, name="ISS (NAUKA)", catalog_number=49044, designator="2021-066A"),
    dataclasses.replace(ZARYA, name="STARLINK-1008", catalog_number=44714, designator="2019-074B"),
    dataclasses.replace(ZARYA, name="Café 1", catalog_number=70001, designator="2026-150A"),
    dataclasses.replace(ZARYA, name="STARLINK-100", catalog_number=44800, designator="1957-001B"),
]


def text_of(*names_and_lines):
    return "\n".join(line for entry in names_and_lines for line in entry) + "\n"


def test_reads_files_folders_and_text(tmp_path):
    first, second = tmp_path / "a.tle", tmp_path / "b.txt"
    first.write_text(text_of(("ISS (ZARYA)", *ISS)))
    second.write_bytes(text_of(("TDRS 3", *TDRS3)).replace("\n", "\r\n").encode())
    (tmp_path / ".hidden").write_text("not this")
    assert [e.name for e in read_elements(first)] == ["ISS (ZARYA)"]
    assert [e.name for e in read_elements(str(tmp_path))] == ["ISS (ZARYA)", "TDRS 3"]
    assert [e.name for e in read_elements(text_of(STARLINK_ALPHA5), second)] == ["", "TDRS 3"]


def test_reads_standard_input(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO(text_of(ISS)))
    assert read_elements("-")[0].catalog_number == 25544
    bytes_of = {"utf-8": "Ñ", "latin-1": "�", "utf-16": "Ñ"}
    for encoding, read in bytes_of.items():
        data = text_of(("Ñ", *ISS)).encode(encoding)
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data), "utf-8"))
        assert read_elements("-")[0].name == read
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"\x1f\x8b\x08 damaged")))
    with pytest.raises(SourceError, match="standard input: cannot read elements"):
        read_elements("-")


def test_the_newest_epoch_of_an_object_wins(tmp_path):
    # CelesTrak, the same object on 2026-07-30.
    older = (
        "1 25544U 98067A   26211.86173118  .00009023  00000+0  17005-3 0  9996",
        "2 25544  51.6314  83.9591 0007096 355.3737   4.7185 15.49272805578527",
    )
    (tmp_path / "a").write_text(text_of(ISS, TDRS3))
    (tmp_path / "b").write_text(text_of(older))
    found = read_elements(tmp_path)
    assert [e.catalog_number for e in found] == [25544, 19548]
    assert found[0].epoch.isoformat("seconds") == "2026-10-02T00:19:53Z"
    assert newest([found[0], dataclasses.replace(found[0], epoch=Utc.of(0.0))]) == [found[0]]


def test_a_bad_set_is_an_error_or_a_refusal(tmp_path):
    path = tmp_path / "bad.tle"
    path.write_text(text_of((ISS[0], ISS[1][:-1] + "7"), TDRS3))
    with pytest.raises(ChecksumError, match=r"bad\.tle:2: line 2, checksum is 7"):
        read_elements(path)
    sets = load_elements(path)
    assert [e.catalog_number for e in sets.accepted] == [19548]
    assert [e.line for e in sets.rejected] == [2]


def test_sources_that_cannot_be_read(tmp_path):
    with pytest.raises(SourceError, match=r"nowhere\.tle: cannot read elements: No such file"):
        read_elements(tmp_path / "nowhere.tle")
    with pytest.raises(SourceError, match="holds no files"):
        read_elements(tmp_path)
    with pytest.raises(SourceError, match="not fetched from a network"):
        read_elements("https://example.org/iss.tle")
    with pytest.raises(SourceError, match="not fetched from a network"):
        read_elements("celestrak:active")
    with pytest.raises(SourceError, match="cannot read elements"):
        read_elements("a\x00b")
    (tmp_path / "cut.gz").write_bytes(gzip.compress(text_of(ISS).encode())[:-9])
    with pytest.raises(SourceError, match=r"cut\.gz: cannot read elements: its gzip compression is damaged"):
        read_elements(tmp_path / "cut.gz")


def test_a_fetcher_reads_urls():
    asked = []

    def fetch(url):
        asked.append(url)
        return text_of(ISS)

    assert read_elements("https://example.org/iss.tle", fetch=fetch)[0].catalog_number == 25544
    assert asked == ["https://example.org/iss.tle"]


@pytest.mark.parametrize(
    ("key", "number"),
    [
        ("25544", 25544),
        ("1998-067A", 25544),
        ("98067a", 25544),
        ("98-067A", 25544),
        ("57001B", 44800),
        ("1998-067-A", 25544),
        ("1998067A", 25544),
        ("9806701", 25544),
        ("5700102", 44800),
        ("2021-066", 49044),
        ("iss zarya", 25544),
        ("nauka", 49044),
        ("starlink1008", 44714),
        ("STARLINK-100", 44800),
        (" 44714 ", 44714),
        ("ｉss (zárya)", 25544),
        ("cafe 1", 70001),
        ("CAFÉ-1", 70001),
    ],
)
def test_finds_by_number_designator_and_name(key, number):
    assert find(STATION, key).catalog_number == number


@pytest.mark.parametrize(
    ("number", "letters"), [("08", "H"), ("09", "J"), ("24", "Z"), ("25", "AA"), ("48", "AZ"), ("49", "BA")]
)
def test_the_laser_stations_number_the_pieces_that_others_letter_without_i_and_o(number, letters):
    sets = [ZARYA, dataclasses.replace(ZARYA, catalog_number=70002, designator=f"2026-150{letters}")]
    assert find(sets, f"26150{number}").catalog_number == 70002


def test_seven_digits_are_a_catalogue_number_first():
    sets = [ZARYA, dataclasses.replace(ZARYA, catalog_number=9806701, designator="2026-001A")]
    assert find(sets, "9806701").catalog_number == 9806701
    with pytest.raises(SatelliteNotFoundError):
        find([ZARYA], "9806700")


def test_finds_alpha5_numbers():
    sets = [*STATION, Elements.from_tle(*STARLINK_ALPHA5)]
    assert find(sets, "A0534").catalog_number == find(sets, "100534").catalog_number == 100534


def test_an_ambiguous_name_lists_its_candidates():
    with pytest.raises(
        AmbiguousSatelliteError, match=r"could be any of 2: ISS \(ZARYA\) \(25544\), ISS"
    ) as e:
        find(STATION, "IS")
    assert e.value.candidates == ("ISS (ZARYA) (25544)", "ISS (NAUKA) (49044)")
    assert e.value.exit_code == 2


def test_a_common_name_is_one_satellite_where_others_begin_with_it():
    assert find(STATION, "ISS").catalog_number == 25544
    # Without it in the list, the name is as ambiguous as any other, or means what is there.
    assert find([one for one in STATION if one.catalog_number != 25544], "iss").name == "ISS (NAUKA)"


def test_a_missing_satellite_says_what_there_is():
    with pytest.raises(
        SatelliteNotFoundError, match=r"no satellite 'HST' in the elements, which hold ISS \(ZARYA\)"
    ):
        find(STATION, "HST")
    with pytest.raises(SatelliteNotFoundError, match="hold none"):
        find([], "HST")
    with pytest.raises(SatelliteNotFoundError):
        find(STATION, "99999")
    with pytest.raises(SatelliteNotFoundError):
        find(STATION, "()")
    many = [dataclasses.replace(ZARYA, catalog_number=i, name=f"S{i}") for i in range(100)]
    with pytest.raises(SatelliteNotFoundError, match="and 92 more"):
        find(many, "HST")


def test_reads_compressed_files_by_their_content(tmp_path):
    (tmp_path / "catalogue").write_bytes(gzip.compress(text_of(ISS, TDRS3).encode()))
    assert [e.catalog_number for e in read_elements(tmp_path)] == [25544, 19548]


def test_one_object_of_several_sources_is_one_even_where_a_source_leaves_its_designator_out():
    later = dataclasses.replace(ZARYA, designator="", epoch=ZARYA.epoch.plus(60.0))
    stranger = dataclasses.replace(ZARYA, designator="2026-001A")
    assert newest([ZARYA, later]) == [later]
    assert newest([later, ZARYA]) == [later]
    assert newest([ZARYA, stranger]) == [ZARYA, stranger]


@pytest.mark.parametrize("number", [0, 99999])
def test_objects_without_a_number_are_told_apart_by_their_names(number):
    first = dataclasses.replace(ZARYA, name="LAUNCH A", catalog_number=number, designator="")
    second = dataclasses.replace(first, name="LAUNCH B", inclination_deg=97.5)
    later = dataclasses.replace(first, epoch=first.epoch.plus(60.0))
    assert newest([first, second, later]) == [later, second]
    assert find([first, second], "launch b") == second
    with pytest.raises(AmbiguousSatelliteError, match="give the name or designator"):
        find([first, second], number)
    with pytest.raises(SatelliteNotFoundError, match=rf"did you mean LAUNCH A \({number}\)\?"):
        find([first, second], "LAUNCHA1")
    # A designator tells more than a name.
    known = dataclasses.replace(first, designator="2026-150A")
    assert newest([known, dataclasses.replace(known, name="NAMED")]) == [known]


@pytest.mark.parametrize(
    ("query", "truncated"),
    [
        ("GROUP=active&FORMAT=tle", True),
        ("GROUP=active&FORMAT=2LE", True),
        ("group=active", True),
        ("GROUP=active&FORMAT=csv", False),
        ("CATNR=25544&FORMAT=tle", False),
    ],
)
def test_a_list_in_tle_format_is_told_as_truncated(query, truncated):
    url = f"https://celestrak.org/NORAD/elements/gp.php?{query}"
    # An epoch before objects were numbered beyond 99999 makes a whole list again.
    older = dataclasses.replace(ZARYA, epoch=Utc.parse("2026-07-01T00:00:00Z"))
    text = write_elements([ZARYA], "tle")
    assert bool(load_elements(url, fetch=lambda _: text).notes) is truncated
    assert bool(load_elements(f"# source={url} of today\n{text}").notes) is truncated
    assert load_elements(url, fetch=lambda _: write_elements([older], "tle")).notes == []
    assert load_elements(text).notes == []
    whole = text + text_of(STARLINK_ALPHA5)
    assert load_elements(url, fetch=lambda _: whole).notes == []


def test_what_is_said_of_a_truncated_list():
    url = "https://celestrak.org/NORAD/elements/gp.php?GROUP=active&FORMAT=tle"
    (note,) = load_elements(url, fetch=lambda _: text_of(ISS)).notes
    assert note.startswith(f"{url}: is truncated")
    assert "100000 and above" in note
    assert "FORMAT=csv" in note

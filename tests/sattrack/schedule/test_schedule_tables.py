"""Tables and lists of fixed times."""

from __future__ import annotations

from datetime import UTC

import pytest

from sattrack.core.errors import BadInputError, Origin
from sattrack.schedule.file import find_zone, read_list, read_table
from tle.instants import Utc

HERE = Origin("t.csv", 1, 1)


def utc_s(text: str) -> float:
    return float(Utc.parse(text).unix_s)


def test_a_table_is_read_whatever_parts_its_fields_and_orders_its_columns() -> None:
    table = (
        "\n# made by hand, on 1 October\nEnd;Satellite;start;priority\n# a comment\n"
        "2026-10-02T01:05:00Z;ISS (ZARYA);2026-10-02T01:00:00Z;7\n"
    )
    with_commas = 'start,end,satellite\n\n2026-10-02 01:00:00,2026-10-02 01:05:00,"DEB, OLD"\n'
    (one,) = read_table(table, UTC, HERE)
    assert (one.satellite, one.start_utc_s, one.end_utc_s, one.priority) == (
        "ISS (ZARYA)",
        utc_s("2026-10-02T01:00:00Z"),
        utc_s("2026-10-02T01:05:00Z"),
        7.0,
    )
    (two,) = read_table(with_commas, find_zone("Europe/Amsterdam"), HERE)
    assert (two.satellite, two.start_utc_s, two.priority) == ("DEB, OLD", utc_s("2026-10-01T23:00:00Z"), None)
    assert two.origin.line == 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "t.csv:1:1: the table is empty"),
        ("satellite,start\n", "t.csv:1:1: the first line names no column end"),
        ("satellite,start,stop\n", "t.csv:1:17: unknown column 'stop'; "),
        ("satellite,start,ende\n", "t.csv:1:17: unknown column 'ende'; did you mean 'end'?"),
        ("satellite,start,end,end\n", "t.csv:1:17: the column 'end' is there twice"),
        ("satellite,start,end\nISS,2026-10-02\n", "t.csv:2:1: end is empty in this row of 2 fields"),
        ("satellite,start,end\nISS,2026-10-02,noon\n", "t.csv:2:16: 'noon' is no time: write "),
        (
            "satellite,start,end\nISS,2026-10-02,2026-10-01\n",
            "t.csv:2:1: ISS: ends before it starts; swap the two",
        ),
        (
            "satellite,start,end,priority\nISS,2026-10-02,2026-10-03,high\n",
            "t.csv:2:27: priority is 'high'; give a number above 0",
        ),
        ('satellite,start,end\n"ISS,2026-10-02,2026-10-03\n', "t.csv:2: no table: "),
    ],
)
def test_what_is_wrong_in_a_table_is_told_with_line_and_column(text: str, says: str) -> None:
    with pytest.raises(BadInputError) as error:
        read_table(text, UTC, HERE)
    assert str(error.value).startswith(says)


def test_a_list_is_read_as_stations_write_it() -> None:
    text = """* from the control file
2026.275.19:40:10    2026.275.19:46:00    25544          # day of year
2026-10-02T20:40:10  2026-10-02 20:46:00  ISS (ZARYA)

" another comment
2026-10-02 21:40:10 2026-10-02 21:46 TDRS 3
"""
    lines = read_list(text, UTC, Origin("l.txt", 10, 5))
    assert [(x.satellite, x.start_utc_s, x.end_utc_s, x.origin.line) for x in lines] == [
        ("25544", utc_s("2026-10-02T19:40:10Z"), utc_s("2026-10-02T19:46:00Z"), 11),
        ("ISS (ZARYA)", utc_s("2026-10-02T20:40:10Z"), utc_s("2026-10-02T20:46:00Z"), 12),
        ("TDRS 3", utc_s("2026-10-02T21:40:10Z"), utc_s("2026-10-02T21:46:00Z"), 15),
    ]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            "2026-10-02T19:40:10 2026-10-02T19:46:00",
            "l.txt:7:1: '2026-10-02T19:40:10 2026-10-02T19:46:00' is no line",
        ),
        ("2026-10-02T19:40:10 soon ISS", "l.txt:7:21: 'soon' is no time"),
        ("  2026.275.19:46:00 2026.275.19:40:00 ISS", "l.txt:7:3: ISS: ends before it starts"),
    ],
)
def test_what_is_wrong_in_a_list_is_told_with_line_and_column(line: str, says: str) -> None:
    with pytest.raises(BadInputError) as error:
        read_list(f"\n{line}\n", UTC, Origin("l.txt", 6, 1))
    assert str(error.value).startswith(says)

"""Times of schedules: zones, days of the year, and the hours that clocks pass over or show twice."""

from __future__ import annotations

from datetime import UTC, tzinfo

import pytest

from sattrack.schedule.file import find_zone, parse_moment
from tle.instants import Utc

AMSTERDAM = find_zone("Europe/Amsterdam")
ADELAIDE = find_zone("Australia/Adelaide")


@pytest.mark.parametrize(
    ("text", "zone", "utc"),
    [
        ("2026-10-02T19:40:10Z", AMSTERDAM, "2026-10-02T19:40:10Z"),
        ("2026-10-02 19:40:10", AMSTERDAM, "2026-10-02T17:40:10Z"),
        ("2026-12-02 19:40", AMSTERDAM, "2026-12-02T18:40:00Z"),
        ("2026-10-02T19:40:10.25+05:30", AMSTERDAM, "2026-10-02T14:10:10.25Z"),
        ("2026-10-02", AMSTERDAM, "2026-10-01T22:00:00Z"),
        ("2026-10-02 19:40:10", UTC, "2026-10-02T19:40:10Z"),
        ("2026.275.19:40:10", UTC, "2026-10-02T19:40:10Z"),
        ("2026.275.19:40:10", AMSTERDAM, "2026-10-02T17:40:10Z"),
        ("2026-275T19:40:10Z", AMSTERDAM, "2026-10-02T19:40:10Z"),
        ("2024.366.23:59", UTC, "2024-12-31T23:59:00Z"),
        # Half an hour of zone, and summer time in the south.
        ("2026-12-02 19:40:10", ADELAIDE, "2026-12-02T09:10:10Z"),
    ],
)
def test_times_are_read_in_their_zone(text: str, zone: tzinfo, utc: str) -> None:
    assert parse_moment(text, zone) == Utc.parse(utc)


@pytest.mark.parametrize(
    ("text", "zone", "says"),
    [
        (
            "2027-03-28 02:30:00",
            AMSTERDAM,
            "2027-03-28 02:30:00 in Europe/Amsterdam never comes, as clocks are put forward over it: write "
            "2027-03-28T00:30:00Z (01:30 CET) or 2027-03-28T01:30:00Z (03:30 CEST)",
        ),
        (
            "2026-10-25 02:30:00",
            AMSTERDAM,
            "2026-10-25 02:30:00 in Europe/Amsterdam comes twice, as clocks are put back: write "
            "2026-10-25T00:30:00Z (02:30 CEST) or 2026-10-25T01:30:00Z (02:30 CET)",
        ),
        ("2026-04-05 02:15:00", ADELAIDE, "2026-04-05 02:15:00 in Australia/Adelaide comes twice"),
        ("2026.366.00:00:00", UTC, "'2026.366.00:00:00' is no time: 2026 has no day 366"),
        ("2026-02-30", UTC, "'2026-02-30' is no time: day is out of range for month"),
        ("tomorrow", UTC, "'tomorrow' is no time: write 2026-10-02T19:40:10Z, "),
        ("2026-12-31 23:59:60", UTC, "'2026-12-31 23:59:60': write a leap second as UTC, with a Z"),
    ],
)
def test_times_that_are_none_or_two_are_refused(text: str, zone: tzinfo, says: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the words are compared below
        parse_moment(text, zone)
    assert str(error.value).startswith(says)


def test_the_edges_of_both_hours_are_times_like_others() -> None:
    for text, utc in (
        ("2027-03-28 01:59:59", "2027-03-28T00:59:59Z"),
        ("2027-03-28 03:00:00", "2027-03-28T01:00:00Z"),
        ("2026-10-25 01:59:59", "2026-10-24T23:59:59Z"),
        ("2026-10-25 03:00:00", "2026-10-25T02:00:00Z"),
    ):
        assert parse_moment(text, AMSTERDAM) == Utc.parse(utc)

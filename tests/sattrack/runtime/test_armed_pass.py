"""A pass is named by about when it culminates, before it, in it and past its highest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sattrack.cli.running import next_file
from sattrack.core.errors import SattrackError
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import choose_pass
from tle.instants import Utc

if TYPE_CHECKING:
    from pathlib import Path

FIRST, SECOND = "2026-10-02T13:05:24Z", "2026-10-02T14:42:12Z"
FIRST_SETS, SECOND_SETS = "2026-10-02T13:08", "2026-10-02T14:45"


@pytest.mark.parametrize(
    ("now", "culminates", "sets"),
    [
        ("2026-10-02T12:00:00Z", FIRST, FIRST_SETS),
        ("2026-10-02T12:00:00Z", SECOND, SECOND_SETS),
        ("2026-10-02T13:03:00Z", FIRST, FIRST_SETS),
        ("2026-10-02T13:07:00Z", FIRST, FIRST_SETS),
        ("2026-10-02T13:07:00Z", SECOND, SECOND_SETS),
        ("2026-10-02T13:03:00Z", None, FIRST_SETS),
    ],
)
def test_the_pass_that_is_meant_is_taken(now: str, culminates: str | None, sets: str) -> None:
    about = None if culminates is None else float(Utc.parse(culminates).unix_s) + 40.0
    found = choose_pass(demo_pass.elements(), demo_pass.SITE.place(), Utc.parse(now), 10.0, about)

    assert found.set_utc is not None
    assert found.set_utc.isoformat("seconds")[:16] == sets


@pytest.mark.parametrize("culminates", [FIRST, "2026-10-02T15:30:00Z"])
def test_a_pass_that_is_over_or_was_none_is_refused_by_name(culminates: str) -> None:
    about = float(Utc.parse(culminates).unix_s)
    with pytest.raises(
        SattrackError, match=f"ISS .* no pass above 10° that culminates about .* {culminates[11:16]}"
    ):
        choose_pass(
            demo_pass.elements(), demo_pass.SITE.place(), Utc.parse("2026-10-02T13:20:00Z"), 10.0, about
        )


@pytest.mark.parametrize("name", ["pass", "2026-10-02", "iss-25544"])
def test_each_armed_pass_is_recorded_beside_the_first_under_its_name(tmp_path: Path, name: str) -> None:
    first = tmp_path / f"{name}.mcap"
    for number in (2, 3):
        following = next_file(first)
        assert following.name == f"{name}-{number}.mcap"
        following.touch()

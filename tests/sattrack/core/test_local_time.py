"""Local times, against `date` of the system and closed forms; and in the commands that people read."""

from __future__ import annotations

import io
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import pytest

from sattrack.cli.main import run
from sattrack.core.local_time import (
    changes_within,
    clock,
    date,
    day,
    duration,
    instant,
    is_zone,
    localised,
    moment,
    span,
    until,
    use_zone,
    zone_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable

# Central Europe turned its clocks back on 2026-10-25 at 01:00 UTC.
SUMMER_S = datetime(2026, 10, 25, 0, 59, 59, tzinfo=UTC).timestamp()
WINTER_S = SUMMER_S + 1.0
ISS = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992\n"
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318\n"
)


def test_a_zone_is_kept_through_the_change_of_clocks():
    use_zone("Europe/Amsterdam")
    assert instant(SUMMER_S) == "Sun 25 Oct 2026 02:59:59 CEST"
    assert instant(WINTER_S) == "Sun 25 Oct 2026 02:00:00 CET"
    assert span(SUMMER_S, WINTER_S + 86400.0) == "Sun 25 Oct 2026 02:59:59 to Mon 26 Oct 2026 02:00:00 CET"
    assert (day(WINTER_S), date(WINTER_S), zone_name(SUMMER_S)) == ("Sun 25 Oct 2026", "2026-10-25", "CEST")


def test_a_zone_changes_from_winter_to_winter():
    use_zone("Europe/Amsterdam")
    winter_s, summer_s, next_winter_s = (
        datetime(2026, month, 15, tzinfo=UTC).timestamp() for month in (1, 7, 12)
    )
    assert changes_within(winter_s, next_winter_s)
    assert changes_within(winter_s, summer_s)
    assert changes_within(SUMMER_S, WINTER_S)
    assert not changes_within(WINTER_S, next_winter_s)
    assert not changes_within(WINTER_S, WINTER_S)


def test_the_day_beside_decimals_is_that_of_the_time_shown():
    use_zone("UTC")
    before_s = datetime(2026, 10, 2, 23, 59, 59, 600000, tzinfo=UTC).timestamp()
    assert instant(before_s, 3) == "Fri 2 Oct 2026 23:59:59.600 UTC"
    assert instant(before_s) == "Sat 3 Oct 2026 00:00:00 UTC"
    assert (date(before_s, 3), day(before_s, 3)) == ("2026-10-02", "Fri 2 Oct 2026")
    assert moment(before_s, before_s - 60.0, 1) == "23:59:59.6"


@pytest.mark.parametrize("zone", ["Asia/Kathmandu", "America/St_Johns", "Pacific/Kiritimati", "UTC"])
def test_times_are_those_of_the_python_library_in_any_zone(zone):
    use_zone(zone)
    for utc_s in (0.0, SUMMER_S, 1.7e9, 4.0e9):
        there = datetime.fromtimestamp(utc_s, ZoneInfo(zone))
        assert (date(utc_s), clock(utc_s)) == (f"{there:%Y-%m-%d}", f"{there:%H:%M:%S}")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.4, "now"), (40.0, "in 40 s"), (-40.0, "40 s ago"), (60.0, "in 1 min"), (240.0, "in 4 min"),
        (3600.0, "in 1 h"), (23220.0, "in 6 h 27 min"), (-23220.0, "6 h 27 min ago"),
        (3 * 86400.0, "in 3.0 days"),
    ],
)  # fmt: skip
def test_how_long_it_is_until_then(seconds, text):
    assert until(seconds) == text
    assert text in (f"in {duration(seconds)}", f"{duration(seconds)} ago", "now")


def test_decimals_are_rounded_and_never_carry_into_a_sixtieth_second():
    use_zone("Europe/Amsterdam")
    assert clock(SUMMER_S + 0.96, 1) == "02:00:00.0"
    assert clock(SUMMER_S + 0.04, 3) == "02:59:59.040"
    assert moment(WINTER_S + 86400.0, WINTER_S) == "Mon 26 02:00:00"
    assert moment(WINTER_S + 60.0, WINTER_S) == "02:01:00"


def test_stamps_within_a_text_become_local_and_nothing_else_does():
    use_zone("Asia/Kathmandu")
    text = "from 2026-10-02T18:14:30Z to 2026-10-02T18:15:00.250Z, day 2026-10-02"
    assert localised(text) == (
        "from Fri 2 Oct 2026 23:59:30 +0545 to Sat 3 Oct 2026 00:00:00 +0545, day 2026-10-02"
    )
    begin_s = datetime(2026, 10, 2, 18, 14, 30, tzinfo=UTC).timestamp()
    assert localised(text, begin_s) == "from 23:59:30 to Sat 3 00:00:00, day 2026-10-02"


def test_what_is_no_zone_is_refused():
    assert is_zone("Europe/Amsterdam")
    for name in ("", "Mars/Olympus", "../etc/passwd", "/etc/localtime", "CEST?"):
        assert not is_zone(name)


@pytest.fixture
def sattrack(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., list[str]]:
    """Run commands in a folder of the test's own; what one prints is given by lines."""
    monkeypatch.chdir(tmp_path)

    def printed(*words: str) -> list[str]:
        capsys.readouterr()
        assert run(list(words)) == 0
        return capsys.readouterr().out.splitlines()

    return printed


def test_passes_are_listed_in_the_settings_zone_and_with_utc_in_utc(
    sattrack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def listed(*options: str) -> list[str]:
        monkeypatch.setattr("sys.stdin", io.StringIO(ISS))
        words = ("passes", "--elements", "-", "--site", "52.1541,4.4908,0", "--from", "2026-10-02T12:00:00Z")
        return sattrack(*words, "--hours", "2", *options)

    (tmp_path / "sattrack.toml").write_text('zone = "Asia/Tokyo"\n')
    local, utc = listed(), listed("--utc")
    assert (local[1], utc[1]) == ("Fri 2 Oct 2026, JST", "Fri 2 Oct 2026, UTC")
    # docs/passes.md: the pass over Leiden rises at 13:01:55 UTC; Tokyo is 9 h ahead.
    assert (local[2][:6], utc[2][:6]) == ("22:01:", "13:01:")
    assert '"rise_utc": "2026-10-02T13:01:' in listed("--json")[0]


def test_a_rehearsal_is_shown_in_the_settings_zone_and_with_utc_in_utc(sattrack, tmp_path: Path):
    (tmp_path / "sattrack.toml").write_text('zone = "Pacific/Auckland"\n')
    (tmp_path / "iss.tle").write_text(ISS)
    words = ("rehearse", "ISS", "--elements", "iss.tle", "--site", "52.1541,4.4908,0", "--min-alt", "65")
    # Summer time begins there on 27 September 2026: 13 h ahead. By skyfield the satellite is above 65° from
    # 13:04:59.1 to 13:05:50.9 UTC.
    zones = (
        ((), "Sat 3 Oct 2026 02:04:59 to 02:05:50 NZDT"),
        (("--utc",), "Fri 2 Oct 2026 13:04:59 to 13:05:50 UTC"),
    )
    for options, shown in zones:
        head = sattrack(*words, "--clock", "2026-10-02T06:35:00Z", *options)[0]
        assert shown in head
        assert "begins in 6 h 30 min" in head


def test_a_zone_that_is_none_is_named_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    Path("sattrack.toml").write_text('\nzone = "Nowhere/Land"\n')
    assert run(["passes"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("sattrack: sattrack.toml:2: zone 'Nowhere/Land' is no time zone")

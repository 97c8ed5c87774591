"""Local times, against `date` of the system and closed forms; and in the commands that people read."""

from __future__ import annotations

import subprocess
import sys
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import pytest

from sattrack.core.local_time import clock, date, day, instant, is_zone, span, until, use_zone, zone_name

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


def test_what_is_no_zone_is_refused():
    assert is_zone("Europe/Amsterdam")
    for name in ("", "Mars/Olympus", "../etc/passwd", "/etc/localtime", "CEST?"):
        assert not is_zone(name)


def listed(folder, *options: str) -> list[str]:
    words = ("passes", "--elements", "-", "--site", "52.1541,4.4908,0", "--from", "2026-10-02T12:00:00Z")
    command = [sys.executable, "-m", "sattrack", *words, "--hours", "2", *options]
    done = subprocess.run(
        command, cwd=folder, input=ISS, capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout.splitlines()


def test_passes_are_listed_in_the_settings_zone_and_with_utc_in_utc(tmp_path):
    (tmp_path / "sattrack.toml").write_text('zone = "Asia/Tokyo"\n')
    local, utc = listed(tmp_path), listed(tmp_path, "--utc")
    assert (local[1], utc[1]) == ("Fri 2 Oct 2026, JST", "Fri 2 Oct 2026, UTC")
    # docs/passes.md: the pass over Leiden rises at 13:01:55 UTC; Tokyo is 9 h ahead.
    assert (local[2][:6], utc[2][:6]) == ("22:01:", "13:01:")
    assert '"rise_utc": "2026-10-02T13:01:' in listed(tmp_path, "--json")[0]


def test_a_zone_that_is_none_is_named_with_its_line(tmp_path):
    (tmp_path / "sattrack.toml").write_text('\nzone = "Nowhere/Land"\n')
    command = [sys.executable, "-m", "sattrack", "passes"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("sattrack: sattrack.toml:2: zone 'Nowhere/Land' is no time zone")

"""Schedules of what has no elements: a planet, a star, a direction, an object of a file, a table."""

from __future__ import annotations

import json

import pytest
from ephemeris_files import oem_text

from sattrack.cli.main import run

AROUND = ("--site", "52.1541,4.4908,0", "--mount", "sim", "--clock", "2026-10-02T12:40:00Z")
SCHEDULE = """
from = 2026-10-02T12:45:00Z
to = 2026-10-02T14:00:00Z
park_at_end = false

[defaults]
if_sun_up = "run"

[[passes]]
satellite = "Arcturus"
longest_s = 60
from = 2026-10-02T13:30:00Z
to = 2026-10-02T13:35:00Z

[[passes]]
satellite = "213.9,19.2"
longest_s = 60
from = 2026-10-02T13:40:00Z
to = 2026-10-02T13:45:00Z

[[passes]]
satellite = "Venus"
longest_s = 60
from = 2026-10-02T13:50:00Z
to = 2026-10-02T13:56:00Z

[[passes]]
satellite = "1998-067A"
ephemeris = "iss.oem"
longest_s = 120

[[fixed]]
satellite = "Balloon 7"
ephemeris = "balloon.csv"
start = "2026-10-02T13:20:00Z"
end = "2026-10-02T13:21:00Z"
"""


@pytest.fixture
def schedule(tmp_path):
    rows = "".join(
        f"2026-10-02T13:{minute:02d}:00Z,{52.3 + 0.003 * minute:.4f},{4.6 + 0.01 * minute:.4f},20000\n"
        for minute in range(10, 30)
    )
    (tmp_path / "balloon.csv").write_text(f"# name: Balloon 7\nutc,lat_deg,lon_deg,height_m\n{rows}")
    (tmp_path / "iss.oem").write_text(oem_text("2026-10-02T12:50:00Z", 40))
    path = tmp_path / "night.toml"
    path.write_text(SCHEDULE)
    return path


NAMES = ["ISS", "Balloon 7", "Arcturus", "213.9,19.2", "Venus"]


def test_they_are_planned_with_source_and_error(capsys, schedule):
    assert run(["run", str(schedule), "--dry-run", "--json", *AROUND]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in plan["passes"]] == NAMES
    numbers = [one["catalog_number"] for one in plan["passes"]]
    assert numbers == [None] * 5
    assert "OEM by SGP4" in plan["passes"][0]["source"]
    assert plan["passes"][1]["source"].startswith("table of height_m")
    assert plan["passes"][4]["elements_epoch"] is None
    assert plan["passes"][0]["expected_error_m"] is None


def test_they_are_rehearsed_and_run_in_virtual_time(capsys, schedule):
    assert run(["run", str(schedule), "--dry-run", "--rehearse", "--json", *AROUND]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert [one["rehearsed"]["go"] for one in plan["passes"]] == [True] * 5
    assert run(["run", str(schedule), "--virtual", "--json", *AROUND]) == 0
    capsys.readouterr()
    assert run(["run", str(schedule), "--status", "--json"]) == 0
    status = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in status["passes"]] == NAMES
    assert [one["state"] for one in status["passes"]] == ["done"] * 5
    assert all(one["rms_arcsec"] < 0.1 for one in status["passes"])
    text = next((schedule.parent / "night.run" / "summaries").glob("*.txt")).read_text()
    assert all(name in text for name in NAMES)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('satellite = "Sun"', "the Sun is in no schedule"),
        ('satellite = "adsb:localhost:30003/4CA2D6"', "an aircraft is heard only now"),
        ('satellite = "launch.csv"', "name the table as ephemeris"),
        ('satellite = "HST"\nephemeris = "iss.oem"', "no object 'HST' in"),
        ('satellite = "ISS"\nephemeris = "none.oem"', "none.oem: cannot read the ephemeris"),
        ('satellite = "Arcturrus"', "no elements"),
        ('rule = "all"\nephemeris = "iss.oem"', "ephemeris is for an object by name"),
    ],
)
def test_what_cannot_be_scheduled_is_refused_with_its_line(capsys, schedule, entry, words):
    schedule.write_text(f"park_at_end = false\n\n[[passes]]\n{entry}\n")
    assert run(["run", str(schedule), "--check", *AROUND]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert words in printed.err
    assert printed.err.count("\n") == 1
    assert "night.toml:" in printed.err

"""Schedules of what has no elements: a planet, a star, a direction, an object of a file, a table."""

from __future__ import annotations

import json

import pytest
from ephemeris_files import ISS, oem_text

from sattrack.cli.main import run

AROUND = ("--site", "52.1541,4.4908,0", "--mount", "sim", "--clock", "2026-10-02T12:40:00Z")
SCHEDULE = """
from = 2026-10-02T12:45:00Z
to = 2026-10-02T14:00:00Z
park_at_end = false

[defaults]
if_sun_up = "run"
least_s = 10

[[passes]]
satellite = "Arcturus"
longest_s = 12
from = 2026-10-02T13:30:00Z
to = 2026-10-02T13:35:00Z

[[passes]]
satellite = "213.9,19.2"
longest_s = 12
from = 2026-10-02T13:40:00Z
to = 2026-10-02T13:45:00Z

[[passes]]
satellite = "Venus"
longest_s = 12
from = 2026-10-02T13:50:00Z
to = 2026-10-02T13:56:00Z

[[passes]]
satellite = "1998-067A"
ephemeris = "iss.oem"
longest_s = 30

[[fixed]]
satellite = "Balloon 7"
ephemeris = "balloon.csv"
start = "2026-10-02T13:20:00Z"
end = "2026-10-02T13:20:12Z"
"""


@pytest.fixture
def schedule(tmp_path):
    rows = "".join(
        f"2026-10-02T13:{minute:02d}:00Z,{52.3 + 0.003 * minute:.4f},{4.6 + 0.01 * minute:.4f},20000\n"
        for minute in range(10, 30)
    )
    (tmp_path / "balloon.csv").write_text(f"# name: Balloon 7\nutc,lat_deg,lon_deg,height_m\n{rows}")
    (tmp_path / "launch.csv").write_text(
        "t_s,lat_deg,lon_deg,height_m\n0,52.3,4.6,20000\n1200,52.4,4.8,20000\n"
    )
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


def test_a_table_whose_times_count_from_t0_is_scheduled_by_the_t0_that_it_gives(capsys, schedule):
    table = schedule.parent / "launch.csv"
    table.write_text(f"# t0: 2026-10-02T13:10:00Z\n{table.read_text()}")
    entry = 'satellite = "launch"\nephemeris = "launch.csv"\n'
    times = 'start = "2026-10-02T13:20:00Z"\nend = "2026-10-02T13:20:12Z"\n'
    schedule.write_text(f"{SCHEDULE.partition('[[passes]]')[0]}[[fixed]]\n{entry}{times}")
    assert run(["run", str(schedule), "--virtual", "--json", *AROUND]) == 0
    capsys.readouterr()
    assert run(["run", str(schedule), "--status", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)["passes"]
    assert (one["name"], one["state"]) == ("launch", "done")
    assert one["rms_arcsec"] < 0.1


@pytest.mark.parametrize(("start", "end"), [("41:55", "42:10"), ("42:08", "42:23")])
def test_fixed_times_across_noon_or_soon_after_are_followed_whole_by_the_night_before(
    start, end, capsys, tmp_path
):
    # The mean noon of Leiden is at 11:42:02 UTC.
    file = tmp_path / "noon.toml"
    file.write_text(
        "from = 2026-10-02T11:00:00Z\nto = 2026-10-02T18:00:00Z\npark_at_end = false\n"
        "[[fixed]]\nsatellite = 'Vega'\nif_sun_up = 'run'\n"
        f"start = 2026-10-02T11:{start}Z\nend = 2026-10-02T11:{end}Z\n"
    )
    site = ("--site", "52.1541,4.4908,0")
    assert run(["run", str(file), "--virtual", "--mount", "sim", *site]) == 0
    capsys.readouterr()
    first, second = sorted((tmp_path / "noon.run" / "summaries").glob("*.txt"))
    assert " 15 of 15 " in first.read_text()
    assert "0 of 0 passes done" in second.read_text()
    # Where a plan or a run ends there is no night for the rest.
    assert run(["run", str(file), "--dry-run", "--json", "--to", "2026-10-02T11:42:00Z", *site]) == 0
    (lost,) = json.loads(capsys.readouterr().out)["lost"]
    assert lost["reason"] == "cut"


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('satellite = "Sun"', "the Sun is in no schedule"),
        ('satellite = "adsb:localhost:30003/4CA2D6"', "an aircraft is heard only now"),
        ('satellite = "launch.csv"', "name the table as ephemeris"),
        ('satellite = "HST"\nephemeris = "iss.oem"', "no object 'HST' in"),
        (
            'satellite = "launch"\nephemeris = "launch.csv"',
            "launch.csv:1: its times count from T0: write # t0: UTC",
        ),
        ('satellite = "ISS"\nephemeris = "none.oem"', "none.oem: cannot read the ephemeris"),
        ('satellite = "Arcturrus"', "no elements"),
        ('rule = "all"\nephemeris = "iss.oem"', "ephemeris is for an object by name"),
        ('rule = "all"\nelements = "iss.tle"', "elements is for a satellite by name"),
        ('satellite = "HST"\nephemeris = ["iss.oem", "balloon.csv"]', "no object 'HST' in"),
        ('satellite = "ISS"\nephemeris = ["iss.oem", "none.oem"]', "none.oem: cannot read the ephemeris"),
        ('satellite = "ISS"\nephemeris = 7', "night.toml:5:13: "),
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


COVARIANCE = """COVARIANCE_START
EPOCH = 2026-10-02T13:05:00
COV_REF_FRAME = RTN
1e-4
0 1e-4
0 0 1e-4
0 0 0 1e-9
0 0 0 0 1e-9
0 0 0 0 0 1e-9
COVARIANCE_STOP
"""
SEVERAL = """
from = 2026-10-02T12:45:00Z
to = 2026-10-02T15:00:00Z
park_at_end = false

[defaults]
if_sun_up = "run"
least_s = 10

[[passes]]
satellite = "ISS"
ephemeris = ["plain.oem", "stated.oem"]
elements = "iss.tle"
longest_s = 12
"""


@pytest.fixture
def several(tmp_path):
    text = oem_text("2026-10-02T12:50:00Z", 40)
    (tmp_path / "plain.oem").write_text(text)
    (tmp_path / "stated.oem").write_text(text.replace("SGP4", "CALM") + COVARIANCE)
    (tmp_path / "iss.tle").write_text("\n".join(("ISS", *ISS)) + "\n")
    path = tmp_path / "night.toml"
    path.write_text(SEVERAL)
    return path


def test_each_pass_is_taken_by_the_best_of_the_ephemerides_of_its_entry(capsys, several):
    # At 13:05 two files have it, and one states 17 m; at 14:41 the elements alone do.
    assert run(["run", str(several), "--dry-run", "--json", *AROUND]) == 0
    plan = json.loads(capsys.readouterr().out)
    first, second = plan["passes"]
    assert first["culminate_utc"][11:15] == "13:0"
    assert "OEM by CALM" in first["source"]
    assert first["expected_error_m"] == pytest.approx(17.3, abs=0.1)
    assert second["culminate_utc"][11:15] == "14:4"
    assert second["catalog_number"] == 25544
    assert plan["lost"] == []
    assert [one["passes"] for one in plan["asked"]] == [2]
    assert run(["run", str(several), "--virtual", "--json", *AROUND]) == 0
    capsys.readouterr()
    assert run(["run", str(several), "--status", "--json"]) == 0
    status = json.loads(capsys.readouterr().out)
    assert [one["state"] for one in status["passes"]] == ["done", "done"]
    assert all(one["rms_arcsec"] < 0.1 for one in status["passes"])


def test_a_file_and_elements_that_have_not_the_object_are_named_as_left_out(capsys, several):
    def change(name, *pairs):
        path = several.parent / name
        text = path.read_text()
        for before, after in pairs:
            assert before in text
            text = text.replace(before, after)
        path.write_text(text)

    change("plain.oem", ("= ISS", "= HST"), ("1998-067-A", "1990-037-B"))
    change("stated.oem", ("= 1998-067-A", "= 25544"))
    change("iss.tle", ("25544", "25553"))
    assert run(["run", str(several), "--check", *AROUND]) == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert all(f"{several.name}:" in line and " ISS: left out: no " in line for line in told), told
    assert "plain.oem, which holds HST" in told[0]
    assert told[1].endswith("iss.tle")
    assert " no ISS (25544) in " in told[1]
    assert run(["run", str(several), "--dry-run", "--json", *AROUND]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert all(any(note in line for note in notes) for line in told)


def test_a_pass_of_which_the_best_file_lacks_some_is_taken_by_one_that_has_it_whole(capsys, several):
    short = oem_text("2026-10-02T12:50:00Z", 15).replace("SGP4", "CALM") + COVARIANCE
    (several.parent / "stated.oem").write_text(short)
    several.write_text(SEVERAL.replace('elements = "iss.tle"\nlongest_s = 12', ""))
    assert run(["run", str(several), "--dry-run", "--json", *AROUND]) == 0
    (one,) = json.loads(capsys.readouterr().out)["passes"]
    assert "OEM by SGP4" in one["source"]


def test_an_entry_may_have_elements_of_its_own(capsys, several):
    several.write_text(SEVERAL.replace('ephemeris = ["plain.oem", "stated.oem"]\n', ""))
    assert run(["run", str(several), "--dry-run", "--json", *AROUND]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)["passes"]] == ["ISS", "ISS"]


def test_elements_that_an_entry_names_and_that_are_not_there_are_refused(capsys, several):
    (several.parent / "iss.tle").unlink()
    assert run(["run", str(several), "--check", *AROUND]) == 2
    printed = capsys.readouterr()
    assert "iss.tle: cannot read elements: No such file" in printed.err
    assert printed.err.count("\n") == 1


def test_a_fixed_pass_is_by_the_best_of_its_ephemerides(capsys, several):
    several.write_text(
        'park_at_end = false\n\n[[fixed]]\nsatellite = "ISS"\nif_sun_up = "run"\n'
        'ephemeris = ["plain.oem", "stated.oem"]\nstart = 2026-10-02T13:03:00Z\nend = 2026-10-02T13:06:00Z\n'
    )
    assert run(["run", str(several), "--dry-run", "--json", *AROUND]) == 0
    (one,) = json.loads(capsys.readouterr().out)["passes"]
    assert "OEM by CALM" in one["source"]

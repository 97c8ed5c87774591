"""`sattrack passes` as a user runs it."""

from __future__ import annotations

import csv
import io
import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from sattrack.cli import run

ISS = (
    "ISS (ZARYA)",
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
TDRS = (
    "TDRS 3",
    "1 19548U 88091B   26150.42208977 -.00000296  00000+0  00000+0 0  9992",
    "2 19548  12.6156 341.1225 0039238 356.7275  12.9243  1.00281048125214",
)
DECAYED = (
    "SPENT",
    "1 29141U 85108AA  06170.26783845  .99999999  00000-0  13519-0 0   718",
    "2 29141  82.4288 273.4882 0015848 277.2124  83.9133 15.93343074  6828",
)
FIELDS = [
    "name",
    "catalog_number",
    "elements_epoch",
    "rise_utc",
    "culminate_utc",
    "set_utc",
    "max_alt_deg",
    "rise_az_deg",
    "set_az_deg",
    "peak_ha_rate_deg_s",
    "peak_dec_rate_deg_s",
    "sunlit_from_utc",
    "sunlit_to_utc",
    "sun_alt_deg",
    "min_sun_separation_deg",
    "min_moon_separation_deg",
    "feasible",
    "why_not",
]


@pytest.fixture
def given(tmp_path: Path) -> list[str]:
    source = tmp_path / "sky.tle"
    source.write_text("".join(f"{line}\n" for line in (*ISS, *TDRS)))
    start = ("--from", "2026-10-02", "--hours", "24")
    return ["--elements", str(source), "--site", "52.1541,4.4908,0", *start]


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    assert run(["passes", *arguments, "--json"]) == 0
    out, _ = capsys.readouterr()
    found: list[dict[str, Any]] = json.loads(out)
    return found


def test_json(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    found = listed(capsys, "25544", *given)
    assert len(found) == 5
    assert list(found[0])[: len(FIELDS)] == FIELDS
    highest = max(found, key=lambda p: float(p["max_alt_deg"]))
    assert highest["max_alt_deg"] == pytest.approx(81.27188, abs=0.001)
    assert highest["culminate_utc"].startswith("2026-10-02T13:05:24.2")
    assert highest["rise_utc"].endswith("Z")
    assert highest["feasible"] is None
    assert highest["peak_ha_rate_deg_s"] == pytest.approx(1.337, abs=0.001)


def test_all_of_the_source_when_none_is_named(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert {p["catalog_number"] for p in listed(capsys, *given)} == {25544, 19548}
    assert {p["catalog_number"] for p in listed(capsys, *given, "--name", "iss*")} == {25544}
    assert len(listed(capsys, "25544", "TDRS", "25544", *given)) == len(listed(capsys, *given))


def test_a_pass_cut_by_the_span_has_no_rise(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    (cut,) = listed(capsys, "25544", *given[:-4], "--from", "2026-10-02T13:03:00Z", "--hours", "0.02")
    assert (cut["rise_utc"], cut["set_utc"], cut["rise_az_deg"]) == (None, None, None)


@pytest.mark.parametrize(
    ("filters", "count"),
    [
        ((), 5),
        (("--min-alt", "60"), 2),
        (("--max-rate", "1"), 4),
        (("--max-rate", "0.5"), 2),
        (("--sunlit",), 5),
        (("--dark",), 0),
    ],
)
def test_filters(
    filters: tuple[str, ...], count: int, given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert len(listed(capsys, "25544", *given, *filters)) == count


def test_magnitudes(given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = tmp_path / "known.txt"
    known.write_text("25544 -1.8\n")
    every = listed(capsys, *given, "--magnitudes", str(known), "--sort", "magnitude")
    assert [p["magnitude"] is None for p in every] == sorted(p["magnitude"] is None for p in every)
    bright = listed(capsys, *given, "--magnitudes", str(known), "--magnitude", "-2")
    assert {p["catalog_number"] for p in bright} == {25544}
    assert all(p["magnitude"] <= -2.0 for p in bright)


@pytest.mark.parametrize(
    ("by", "key"), [("altitude", "max_alt_deg"), ("rate", "peak_ha_rate_deg_s"), ("name", "name")]
)
def test_sorting(by: str, key: str, given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    values = [p[key] for p in listed(capsys, *given, "--sort", by)]
    assert values == sorted(values, reverse=by == "altitude")


def test_csv(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", "25544", *given, "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert len(rows) == 5
    assert set(FIELDS) <= set(rows[0])
    assert rows[0]["feasible"] == ""


def test_a_calendar(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", *given, "--ics"]) == 0
    text = capsys.readouterr().out
    lines = text.replace("\r\n ", "").splitlines()
    assert (lines[0], lines[-1]) == ("BEGIN:VCALENDAR", "END:VCALENDAR")
    assert lines.count("BEGIN:VEVENT") == lines.count("END:VEVENT") == 6
    assert "DTSTART:20261002T130159Z" in lines
    assert "SUMMARY:ISS (ZARYA) 81°" in lines
    assert max(len(line.encode()) for line in text.splitlines()) <= 75
    assert len({line for line in lines if line.startswith("UID:")}) == 6


def test_the_table(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", "25544", *given]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert "Satellite" in head
    assert len(lines) == 5
    assert "13:05:24" in lines[2]
    assert "81.3" in lines[2]
    assert "\x1b" not in head
    assert run(["passes", "25544", *given, "--dark"]) == 0
    assert "no pass" in capsys.readouterr().err


def test_a_chart(given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    skyline = tmp_path / "skyline.txt"
    skyline.write_text("0 5\n90 30\n180 10\n270 15\n")
    chart = tmp_path / "sky.png"
    assert run(["passes", *given, "--horizon", str(skyline), "--plot", str(chart)]) == 0
    assert chart.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    capsys.readouterr()
    assert run(["passes", *given, "--plot", str(tmp_path / "no" / "sky.png")]) == 2
    assert "cannot write the chart" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("--json", "--csv"), 2, "give one of them"),
        (("--magnitude", "4"), 2, "--magnitudes FILE"),
        (("--max-rate", "-1"), 2, "above 0"),
        (("--min-alt", "95"), 2, "95"),
        (("--hours", "-1"), 2, "no span"),
        (("--from", "soon"), 2, "soon"),
        (("--horizon", "/nowhere/skyline.txt"), 2, "cannot read the horizon"),
        (("--name", "HUBBLE"), 1, "HUBBLE"),
        (("77777",), 2, "77777"),
    ],
)
def test_what_cannot_be(
    arguments: tuple[str, ...],
    code: int,
    says: str,
    given: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["passes", *given, *arguments]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert err.startswith("sattrack: ")
    assert err.count("\n") == 1


def test_decayed_satellites(given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spent = tmp_path / "spent.tle"
    spent.write_text("".join(f"{line}\n" for line in DECAYED))
    assert run(["passes", *given, "--elements", str(spent), "--json"]) == 0
    out, err = capsys.readouterr()
    assert {p["catalog_number"] for p in json.loads(out)} == {25544, 19548}
    assert "1 of 3 objects left out" in err
    assert run(["passes", "29141", *given, "--elements", str(spent)]) == 1
    assert "29141" in capsys.readouterr().err


def test_nothing_heavy_is_imported_for_one_satellite(given: list[str]) -> None:
    code = f"""
import sys
from sattrack.cli import run
run({["passes", "25544", *given]!r})
heavy = "scipy matplotlib textual skyfield filterpy mcap aiohttp concurrent.futures.process"
print("imported:", [name for name in heavy.split() if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported: []"


def test_the_example_of_passes(capsys: pytest.CaptureFixture[str]) -> None:
    example = Path(__file__).parents[2] / "examples" / "passes_over_leiden.py"
    runpy.run_path(str(example), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert "81.3°  1.337 °/s  sunlit" in lines[2]

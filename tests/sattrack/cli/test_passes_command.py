"""`sattrack passes` as a user runs it."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import runpy
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest

from sattrack.cli.main import run
from tle.earth import EarthOrientation
from tle.instants import Utc

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


def test_json_and_csv_are_written_to_the_last_digit_as_python_writes_them(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["passes", *given, "--judged", "--json"]) == 0
    text = capsys.readouterr().out
    found = json.loads(text)
    assert len({p["sunlit_from_utc"] for p in found}) > 2
    assert text == json.dumps(found) + "\n"
    for one in found:
        instants = [
            one[key] for key in ("elements_epoch", "rise_utc", "culminate_utc", "set_utc") if one[key]
        ]
        instants += [t for key in ("sunlit_utc", "penumbra_utc") for pair in one[key] for t in pair]
        assert all(Utc.parse(text).isoformat() == text for text in [*instants, *one["culminations_utc"]])
        lit = one["sunlit_utc"]
        assert (one["sunlit_from_utc"], one["sunlit_to_utc"]) == (
            (lit[0][0], lit[-1][1]) if lit else (None, None)
        )
    assert run(["passes", *given, "--judged", "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    for row, one in zip(rows, found, strict=True):
        assert row == {key: "" if one[key] is None else str(one[key]) for key in row}


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


def uids(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    assert run(["passes", *arguments, "--format", "ics"]) == 0
    lines = capsys.readouterr().out.replace("\r\n ", "").splitlines()
    return [line for line in lines if line.startswith("UID:")]


def test_an_event_is_another_one_at_another_site(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    # A mile apart, the passes are highest in the same second.
    here = uids(capsys, "25544", *given)
    there = uids(capsys, "25544", *given, "--site", "52.16,4.48,0")
    assert [uid[:26] for uid in here] == [uid[:26] for uid in there]
    assert len({*here, *there}) == 10


def test_an_event_is_the_same_one_when_it_is_found_again(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    # The span cuts off the pass's beginning, then all to the top, then more.
    starts = ("2026-10-02T12:30:00Z", "2026-10-02T13:03:00Z", "2026-10-02T13:05:40Z", "2026-10-02T13:06:40Z")
    first = [uids(capsys, "25544", *given, "--from", start, "--hours", "1")[0] for start in starts]
    assert first[0] == first[1]
    assert first[2] == first[3]


def test_a_satellite_that_is_named_twice_is_listed_once(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert listed(capsys, "25544", "ISS (ZARYA)", "1998-067A", *given) == listed(capsys, "25544", *given)
    assert len(uids(capsys, "25544", "ISS (ZARYA)", *given)) == 5


def new_csv(folder: Path, number: int, *designators: str) -> Path:
    """Write elements of so many objects of one number as CSV."""
    names = "OBJECT_NAME,OBJECT_ID,EPOCH,MEAN_MOTION,ECCENTRICITY,INCLINATION,RA_OF_ASC_NODE"
    names += ",ARG_OF_PERICENTER,MEAN_ANOMALY,NORAD_CAT_ID,BSTAR,MEAN_MOTION_DOT,MEAN_MOTION_DDOT"
    values = "2026-10-02T00:19:52.568,15.48707685,0.0006946,51.6312,131.4121"
    values += f",211.9293,148.1275,{number},0.000076743,0.00003738,0"
    source = folder / "new.csv"
    source.write_text("\n".join([names, *(f"NEW,{one},{values}" for one in designators), ""]))
    return source


def test_events_of_two_objects_of_one_number_have_uids_of_their_own(
    given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = new_csv(tmp_path, 99999, "2026-001A", "2026-001B")
    found = uids(capsys, *given[2:], "--elements", str(source))
    assert len(found) == len(set(found)) == 10


def test_the_table(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", "25544", *given]) == 0
    head, day, *lines = capsys.readouterr().out.splitlines()
    assert "Satellite" in head
    assert day == "Fri 2 Oct 2026, UTC"
    assert len(lines) == 5
    assert "13:05:24" in lines[2]
    assert "81.3" in lines[2]
    assert "\x1b" not in head
    assert run(["passes", "25544", *given, "--dark"]) == 0
    assert "no pass" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("clock", "lines"),
    [
        ("13:00:00", ["The next pass begins in 2 min."]),
        ("13:03:00", ["A pass is under way: it ends in 6 min.", "The next pass begins in 1 h 36 min."]),
        ("13:09:00", ["The next pass begins in 1 h 30 min."]),
    ],
)
def test_what_is_up_now_is_said_first(
    given: list[str], capsys: pytest.CaptureFixture[str], clock: str, lines: list[str]
) -> None:
    assert run(["passes", "ISS", *given[:4], "--hours", "4", "--clock", f"2026-10-02T{clock}Z"]) == 0
    assert capsys.readouterr().out.splitlines()[: len(lines)] == lines


def on_a_terminal(arguments: list[str], **environ: str) -> tuple[str, str]:
    """Run a command with output and errors on pseudo-terminals; return what came out of each."""
    kept = {k: v for k, v in os.environ.items() if k != "NO_COLOR"}
    pairs = [os.openpty(), os.openpty()]
    with subprocess.Popen(
        [sys.executable, "-m", "sattrack", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=pairs[0][1],
        stderr=pairs[1][1],
        env={**kept, "TERM": "xterm", **environ},
    ) as process:
        told = []
        for ours, theirs in pairs:
            os.close(theirs)
            text = b""
            # A terminal that nobody writes to any more ends with an error.
            with contextlib.suppress(OSError):
                while piece := os.read(ours, 65536):
                    text += piece
            os.close(ours)
            told.append(text.decode())
    assert process.returncode == 0
    return told[0], told[1]


def test_colour_is_for_terminals(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", "25544", *given]) == 0
    plain = capsys.readouterr().out
    assert "\x1b" not in plain
    coloured, told = on_a_terminal(["passes", "25544", *given])
    assert "\x1b[1m" in coloured
    assert re.sub(r"\x1b\[[0-9;]*m", "", coloured).splitlines() == plain.splitlines()
    assert told == ""
    bare, _ = on_a_terminal(["passes", "25544", *given], NO_COLOR="1")
    assert bare.splitlines() == plain.splitlines()


def test_progress_is_for_terminals(
    given: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sattrack.cli.passes._FEWEST_FOR_PROGRESS", 1)
    assert run(["passes", *given]) == 0
    assert "searched" not in capsys.readouterr().err
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert run(["passes", *given]) == 0
    err = capsys.readouterr().err
    assert "\r\x1b[Ksearched 1 of 2 objects\r\x1b[K" in err
    assert err.endswith("\r\x1b[K")


def test_progress_never_wraps(
    given: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What wraps is not overwritten by the next line: a narrow terminal would fill up."""
    monkeypatch.setattr("sattrack.cli.passes._FEWEST_FOR_PROGRESS", 1)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys.stderr, "fileno", lambda: 2, raising=False)
    monkeypatch.setattr("os.get_terminal_size", lambda *_: os.terminal_size((12, 24)))
    assert run(["passes", *given]) == 0
    assert "\r\x1b[Ksearched 1 \r\x1b[K" in capsys.readouterr().err


def test_the_sun_is_lit(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", "SUN", "--site", "52,4,0", "--clock", "2026-10-02T12:00:00Z", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows
    # It may still be up where the search ends.
    assert all(
        row["sunlit_from_utc"] and row["sunlit_to_utc"] == (row["set_utc"] or row["sunlit_to_utc"])
        for row in rows
    )


def test_it_is_not_said_that_the_sun_lights_a_mere_direction(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "aa.csv"
    rows = [(0, 12, 100), (30, 20, 104), (60, 30, 110), (90, 35, 118), (120, 30, 128), (150, 12, 138)]
    table.write_text(
        "utc,alt_deg,az_deg\n"
        + "".join(f"2026-11-29T20:{s // 60:02}:{s % 60:02}Z,{alt},{az}\n" for s, alt, az in rows)
    )
    where = ["--site", "52.1541,4.4908,0", "--from", "2026-11-29T19:00:00Z", "--hours", "20"]
    of_table = ["passes", "aa", "--ephemeris", str(table), *where, "--json"]
    assert run(of_table) == 0
    (one,) = json.loads(capsys.readouterr().out)
    for key in ("sunlit_from_utc", "sunlit_to_utc", "sunlit_utc", "penumbra_utc"):
        assert one[key] is None
    assert run([*of_table, "--sunlit"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert run(["passes", "Moon", *where, "--json", "--sunlit"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["sunlit_utc"]


def test_elements_far_from_the_search_are_told(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    # It is told once of each Earth orientation, and another test may have used the installed one.
    EarthOrientation.installed.cache_clear()
    listed(capsys, "25544", *given)
    assert run(["passes", *given, "--json"]) == 0
    _, err = capsys.readouterr()
    assert err == (
        "sattrack: the elements of TDRS 3 are from 125 days before the search: "
        "passes may come early or late, or not at all\n"
    )
    assert run(["passes", "25544", *given[:-4], "--from", "2036-10-02", "--json"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line.split(":")[1].split()[0] for line in told] == ["warning", "the"]


def test_never_dark_at_the_pole_in_summer(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    at_pole = ["19548", *given[:2], "--site", "-90,0,0", "--from", "2026-12-21", "--min-alt", "-5"]
    every = listed(capsys, *at_pole)
    assert every
    assert all(p["sun_alt_deg"] > 20.0 for p in every)
    assert listed(capsys, *at_pole, "--dark") == []


def test_satellites_with_numbers_of_nine_digits(
    given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = new_csv(tmp_path, 799500303, "2026-001A")
    found = listed(capsys, "799500303", *given[2:], "--elements", str(source))
    assert {p["catalog_number"] for p in found} == {799500303}
    assert max(p["max_alt_deg"] for p in found) == pytest.approx(81.27, abs=0.05)
    assert run(["passes", "799500303", *given[2:], "--elements", str(source), "--ics"]) == 0
    assert "UID:799500303-" in capsys.readouterr().out


def test_an_empty_catalogue(given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "none.tle"
    source.write_text("")
    assert run(["passes", *given[2:], "--elements", str(source)]) == 2
    _, err = capsys.readouterr()
    assert f"{source}: is empty" in err
    assert err.count("\n") == 1


def test_a_chart(given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    skyline = tmp_path / "skyline.txt"
    skyline.write_text("0 5\n90 30\n180 10\n270 15\n")
    chart = tmp_path / "sky.png"
    assert run(["passes", *given, "--horizon", str(skyline), "--plot", str(chart)]) == 0
    assert chart.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    capsys.readouterr()
    assert run(["passes", *given, "--plot", str(tmp_path / "no" / "sky.png")]) == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("--json", "--csv"), 2, "give only one of"),
        (("--magnitude", "4"), 2, "--magnitudes FILE"),
        (("--max-rate", "-1"), 2, "above 0"),
        (("--max-rate", "nan"), 2, "nan"),
        (("--magnitude", "nan", "--magnitudes", "known.txt"), 2, "nan"),
        (("--magnitudes", "/nowhere/known.txt"), 2, "/nowhere/known.txt: cannot read"),
        (("--hours", "0"), 2, "0.0 hours"),
        (("--hours", "nan"), 2, "nan hours"),
        (("--hours", "9000"), 2, "to 8784 hours"),
        (("--min-alt", "nan"), 2, "nan"),
        (("--from", "1960-01-01"), 2, "1960-01-01T00:00:00Z is outside"),
        (("--from", "9999-01-01"), 2, "is outside"),
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
from sattrack.cli.main import run
run({["passes", "25544", *given]!r})
heavy = "scipy matplotlib textual skyfield filterpy mcap aiohttp concurrent.futures.process"
print("imported:", [name for name in heavy.split() if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported: []"


def test_the_example_of_passes(capsys: pytest.CaptureFixture[str]) -> None:
    example = Path(__file__).parents[3] / "examples" / "passes_over_leiden.py"
    runpy.run_path(str(example), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert "81.3°  1.337 °/s  sunlit" in lines[2]


def test_times_of_a_span_in_which_clocks_are_put_forward_and_back_are_the_zones_own(
    given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "sattrack.toml"
    settings.write_text('zone = "Europe/Amsterdam"\n')
    # From winter time to winter time, over a summer.
    span = ("--from", "2026-03-20", "--hours", "5424", "--min-alt", "84", "--config", str(settings))
    seen = [Utc.parse(p["rise_utc"]).datetime() for p in listed(capsys, "25544", *given[:-4], *span)]
    assert run(["passes", "25544", *given[:-4], *span]) == 0
    shown = re.findall(r"^(\d\d:\d\d:\d\d) ", capsys.readouterr().out, re.MULTILINE)
    local = [at.astimezone(ZoneInfo("Europe/Amsterdam")) for at in seen]
    assert {at.utcoffset() for at in local} == {timedelta(hours=1), timedelta(hours=2)}
    for at, clock in zip(local, shown, strict=True):
        assert abs(at.replace(tzinfo=None) - datetime.fromisoformat(f"{at:%Y-%m-%d} {clock}")) <= timedelta(
            seconds=1
        )

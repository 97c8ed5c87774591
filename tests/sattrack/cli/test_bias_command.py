"""`sattrack bias`: what observations in a file say of an element set."""

from __future__ import annotations

import json
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sattrack.cli.main import run
from tle.instants import Utc
from tle.sources import read_elements, write_elements

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
ELEMENTS = str(EXAMPLES / "iss_leiden.tle")
SOLUTIONS = EXAMPLES / "iss_plate_solutions.jsonl"
SITE = ("--site", "52.1541,4.4908,0")


def ran(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> tuple[str, str]:
    assert run(["bias", *arguments, *SITE]) == code
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out, err


def fitted(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(ran(capsys, *arguments, "--json")[0])
    return document


def solutions() -> list[dict[str, Any]]:
    return [json.loads(line) for line in SOLUTIONS.read_text().splitlines()]


def written(path: Path, rows: list[dict[str, Any]]) -> str:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return str(path)


def test_a_satellite_that_is_three_seconds_ahead_is_found_so(capsys: pytest.CaptureFixture[str]) -> None:
    document = fitted(capsys, ELEMENTS, "--observations", str(SOLUTIONS))
    bias, rows = document["bias"], document["observations"]
    assert set(bias) >= {"along_s", "along_sigma_s", "drift_s_min", "cross_deg", "cross_sigma_deg", "at_utc"}
    assert abs(bias["along_s"] - 3.0) < 3.0 * bias["along_sigma_s"] < 0.02
    assert abs(bias["cross_deg"]) < 3.0 * bias["cross_sigma_deg"] < 0.01
    assert abs(bias["drift_s_min"]) < 0.02
    assert (bias["used"], bias["rejected"]) == (60, 0)
    assert bias["rms_arcsec"] == pytest.approx(20.0 * 2.0**0.5, rel=0.15)
    assert bias["at_utc"] == rows[-1]["utc"]
    assert len(rows) == 60
    assert all(row["along_s"] == pytest.approx(3.0, abs=0.3) and row["used"] for row in rows)


def test_of_several_sets_the_nearest_to_the_observations_is_judged(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (iss,) = read_elements(ELEMENTS)
    later = replace(iss, epoch=iss.epoch.plus(20 * 86400.0), mean_anomaly_deg=100.0)
    both = tmp_path / "history.csv"
    both.write_text(write_elements([iss, later], "csv"))
    one = written(tmp_path / "one", solutions()[:1])
    assert fitted(capsys, str(both), "--observations", one)["bias"]["along_s"] == pytest.approx(3.0, abs=0.1)
    assert run(["elements", "check", str(both), "--observations", one, "--json", *SITE]) == 0
    (row,) = json.loads(capsys.readouterr().out)["residuals"]
    assert row["along_s"] == pytest.approx(3.0, abs=0.1)


def test_what_stands_in_two_files_was_seen_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rows = solutions()
    halves = [written(tmp_path / name, part) for name, part in (("a", rows[:40]), ("b", rows[20:]))]
    whole = fitted(capsys, ELEMENTS, "--observations", str(SOLUTIONS))
    out, err = ran(capsys, ELEMENTS, "--observations", *halves, "--json")
    assert json.loads(out) == whole
    assert "20 of 80 observations are repetitions, and are left out" in err


def test_every_format_says_the_same(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rows = solutions()[::4]
    table = tmp_path / "a.csv"
    lines = [f"{row['utc']},{row['ra_deg']},{row['dec_deg']},icrf,20" for row in rows]
    table.write_text("\n".join(["utc,ra_deg,dec_deg,frame,sigma_arcsec", *lines[:8]]))
    tdm = tmp_path / "b.tdm"
    data = [
        f"{angle} = {row['utc'].rstrip('Z')} {row[name]}"
        for row in rows[8:]
        for angle, name in (("ANGLE_1", "ra_deg"), ("ANGLE_2", "dec_deg"))
    ]
    head = (
        "CCSDS_TDM_VERS = 2.0\nCREATION_DATE = 2026-10-02T14:00:00\nORIGINATOR = A\nMETA_START\n"
        "COMMENT SIGMA_ARCSEC = 20\nTIME_SYSTEM = UTC\nPARTICIPANT_1 = HERE\nPARTICIPANT_2 = 25544\n"
        "MODE = SEQUENTIAL\nPATH = 2,1\nANGLE_TYPE = RADEC\nREFERENCE_FRAME = ICRF\nMETA_STOP\nDATA_START\n"
    )
    tdm.write_text(head + "\n".join(data) + "\nDATA_STOP\n")
    whole = fitted(capsys, ELEMENTS, "--observations", written(tmp_path / "all.jsonl", rows))
    parts = fitted(capsys, ELEMENTS, "--observations", str(table), str(tdm))
    again = fitted(capsys, ELEMENTS, "--observations", str(table), "--observations", str(tdm))
    assert parts == again == whole


def test_outliers_are_left_out_and_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rows = solutions()
    wild = (0, 7, 8, 9, 30, 31, 45, 50, 51, 59)
    for i in wild:
        rows[i]["dec_deg"] += 0.3 * (1 + i % 3)
    path = written(tmp_path / "wild.jsonl", rows)
    document = fitted(capsys, ELEMENTS, "--observations", path)
    assert document["bias"]["along_s"] == pytest.approx(3.0, abs=0.02)
    assert tuple(i for i, row in enumerate(document["observations"]) if not row["used"]) == wild
    out, _ = ran(capsys, ELEMENTS, "--observations", path)
    named = [line for line in out.splitlines() if "left out" in line]
    assert [re.search(r"jsonl:(\d+)", line)[1] for line in named] == [str(i + 1) for i in wild]  # type: ignore[index]


def test_the_refined_elements_are_read_again_and_have_no_bias(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out, nameless = tmp_path / "refined.kvn", tmp_path / "nameless.tle"
    nameless.write_text("".join(Path(ELEMENTS).read_text().splitlines(keepends=True)[-2:]))
    ran(capsys, str(nameless), "--observations", str(SOLUTIONS), "--out", str(out))
    (refined,) = read_elements(out)
    assert (refined.catalog_number, refined.name) == (25544, "1998-067A")
    text = out.read_text()
    (created,) = re.findall(r"^CREATION_DATE = (\S+)", text, re.MULTILINE)
    assert abs(float(Utc.parse(created).unix_s) - time.time()) < 600.0
    assert len(re.findall(r"^C[XYZ]\w* = ", text, re.MULTILINE)) == 21
    diagonal = {
        name: float(value)
        for name, value in re.findall(r"^C(X_X|Y_Y|Z_Z|X_DOT_X_DOT) = (\S+)", text, re.MULTILINE)
    }
    assert all(1e-6 < diagonal[name] < 1.0 for name in ("X_X", "Y_Y", "Z_Z"))
    assert 0.0 < diagonal["X_DOT_X_DOT"] < 1e-5
    bias = fitted(capsys, str(out), "--observations", str(SOLUTIONS))["bias"]
    assert bias["along_s"] == pytest.approx(0.0, abs=0.002)
    assert bias["cross_deg"] == pytest.approx(0.0, abs=0.001)


def test_one_observation_gives_a_bias_without_drift(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    bias = fitted(capsys, ELEMENTS, "--observations", written(tmp_path / "one", solutions()[:1]))["bias"]
    assert bias["along_s"] == pytest.approx(3.0, abs=0.1)
    assert bias["drift_s_min"] is None
    assert bias["used"] == 1


def test_what_to_use_is_told_and_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    picture = tmp_path / "bias.png"
    out, _ = ran(capsys, ELEMENTS, "--observations", str(SOLUTIONS), "--plot", str(picture))
    used = re.search(r"--bias-along (\S+) --bias-cross (\S+)", out)
    assert used is not None
    assert float(used[1]) == pytest.approx(3.0, abs=0.02)
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ({"catalog_number": 38707}, 2, "no satellite"),
        ({"dec_deg": None}, 2, "dec_deg is missing"),
        ({"utc": "yesterday"}, 2, "yesterday"),
    ],
)
def test_bad_observations_are_named(
    change: dict[str, Any], code: int, words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = written(tmp_path / "bad.jsonl", [row | change for row in solutions()[:3]])
    _, err = ran(capsys, ELEMENTS, "--observations", path, code=code)
    assert words in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("sigma_arcsec", [0, 0.001, 999999])
def test_a_sigma_that_a_run_refuses_is_refused_with_file_and_line(
    sigma_arcsec: float, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = solutions()[:3]
    rows[1]["sigma_arcsec"] = sigma_arcsec
    path = written(tmp_path / "sigma.jsonl", rows)
    _, err = ran(capsys, ELEMENTS, "--observations", path, code=2)
    assert err == f"sattrack: {path}:2: sigma_arcsec {sigma_arcsec:g} is outside 0.01 to 3600\n"


def test_a_frame_that_another_explains_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Precession since J2000 is 0.36° in 2026."""
    path = written(tmp_path / "frame.jsonl", [row | {"frame": "of_date"} for row in solutions()[::4]])
    out, err = ran(capsys, ELEMENTS, "--observations", path)
    scatter = re.search(r"RMS, (\S+) times what the sigmas say$", out, re.MULTILINE)
    assert scatter is not None
    words = (
        f"the observations lie {scatter[1]} times as far off as their sigmas say: in the frame icrs, "
        "not of_date, they would fit"
    )
    assert err == f"sattrack: warning: {words}\n"
    out, err = ran(capsys, ELEMENTS, "--observations", path, "--json")
    document = json.loads(out)
    assert document["warnings"] == [words]
    assert set(document) == {"bias", "observations", "warnings"}
    assert err == f"sattrack: warning: {words}\n"


def test_only_the_frame_that_is_wrong_is_told_of_several(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = [row | {"frame": ("j2000", "of_date")[i % 2]} for i, row in enumerate(solutions()[::4])]
    (words,) = fitted(capsys, ELEMENTS, "--observations", written(tmp_path / "mixed.jsonl", rows))["warnings"]
    assert words.endswith(": in the frame icrs, not of_date, they would fit")


def test_a_scatter_that_no_frame_explains_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rows = [row | {"sigma_arcsec": 1.0} for row in solutions()[::4]]
    (words,) = fitted(capsys, ELEMENTS, "--observations", written(tmp_path / "small.jsonl", rows))["warnings"]
    assert re.fullmatch(
        r"the observations lie \d+\.\d times as far off as their sigmas say: "
        r"check the sigmas, the satellite, the station, the frame and the clock",
        words,
    )


def test_of_observations_without_sigmas_none_are_called_wrong(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As those of a TDM are, whose standard has no place for them."""
    rows = [{key: row[key] for key in ("utc", "ra_deg", "dec_deg")} for row in solutions()[::8]]
    out, err = ran(capsys, ELEMENTS, "--observations", written(tmp_path / "plain.jsonl", rows))
    assert re.search(r"scatter +\d+\.\d\d″ RMS, no sigmas are given\n", out)
    assert re.fullmatch(
        r"sattrack: warning: the observations lie \d+\.\d times as far off as "
        r"the 1″ that holds without sigmas: give them, or check "
        r"the satellite, the station, the frame and the clock\n",
        err,
    )


def test_old_observations_among_new_ones_are_told_by_their_span(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = solutions()[::15]
    old = [row | {"utc": row["utc"].replace("2026", "2025")} for row in rows]
    _, err = ran(capsys, ELEMENTS, "--observations", written(tmp_path / "both.jsonl", old + rows), code=1)
    assert "they span 365.0 days, give those of one; or check the satellite" in err


def test_sigmas_that_are_small_by_a_few_times_are_no_cause_for_a_warning(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = [row | {"sigma_arcsec": 6.0} for row in solutions()[::4]]
    out, err = ran(capsys, ELEMENTS, "--observations", written(tmp_path / "few.jsonl", rows), "--json")
    assert (json.loads(out)["warnings"], err) == ([], "")


def test_a_satellite_that_the_elements_have_not_is_told_with_what_fetches_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = written(tmp_path / "other.jsonl", [row | {"catalog_number": 45085} for row in solutions()[:3]])
    _, err = ran(capsys, ELEMENTS, "--observations", path, code=2)
    assert err.endswith(": check the spelling, or give celestrak:45085 as ELEMENTS to fetch it\n")
    named = (ELEMENTS, "--observations", str(SOLUTIONS), "--satellite")
    _, err = ran(capsys, *named, "Big Bird", code=2)
    assert "give 'celestrak:name=Big Bird' as ELEMENTS to fetch it" in err
    _, err = ran(capsys, *named, "Zariya", code=2)
    assert err.endswith("; did you mean ISS (ZARYA) (25544)?\n")


def test_directions_of_no_orbit_near_the_elements_are_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = solutions()
    places = [(row["ra_deg"], row["dec_deg"]) for row in rows]
    for row, (ra_deg, dec_deg) in zip(rows, reversed(places), strict=True):
        row["ra_deg"], row["dec_deg"] = ra_deg, dec_deg
    path = written(tmp_path / "backwards.jsonl", rows)
    _, err = ran(capsys, ELEMENTS, "--observations", path, code=1)
    assert "agree on no orbit near the elements" in err

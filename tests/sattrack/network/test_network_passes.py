"""`network passes`: the data set holds what a search of the whole span finds, however it was made."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from network_builders import START, STATIONS, contents, made_up, written

from sattrack.cli.main import run
from sattrack.network import dataset
from sattrack.network.land import offshore_km
from sattrack.network.stations import read_stations
from tle.facts import pass_facts
from tle.instants import Utc
from tle.passes import find_catalogue_passes

if TYPE_CHECKING:
    from collections.abc import Iterator

HOURS = 48
LOOK_EVERY_S = 0.02
parquet = pytest.importorskip("pyarrow.parquet")


def command(folder: Path, out: Path, *more: str) -> list[str]:
    elements, stations = folder / "made_up.tle", folder / "stations.toml"
    span = ["--from", START, "--hours", str(HOURS)]
    where = ["--stations", str(stations), "--elements", str(elements), "--out", str(out)]
    return ["network", "passes", *where, *span, *more]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with elements, stations and the data set `made`, found in one process."""
    folder = tmp_path_factory.mktemp("network")
    written(folder)
    assert run(command(folder, folder / "made")) == 0
    return folder


def test_the_files_of_a_station_hold_what_a_search_of_the_whole_span_finds(folder: Path) -> None:
    start, elements = Utc.parse(START), made_up(40)
    for station in read_stations(folder / "stations.toml"):
        whole = find_catalogue_passes(elements, station.site, start, HOURS, station.min_altitude_deg)
        want = sorted(
            (
                one.elements.catalog_number,
                one.seen.culminate_utc - start,
                -1.0 if one.seen.rise_utc is None else one.seen.rise_utc - start,
                -1.0 if one.seen.set_utc is None else one.seen.set_utc - start,
                one.seen.max_alt_deg,
                None if facts is None else sum(b - a for a, b in facts.sunlit),
            )
            for one, facts in zip(whole, pass_facts(whole), strict=True)
        )
        rows = [
            (file.parent.name, row)
            for file in sorted((folder / "made" / f"station={station.name}").glob("day=*/passes.parquet"))
            for row in parquet.ParquetFile(file).read().to_pylist()
        ]
        got = sorted(
            (
                row["catalog_number"],
                row["culminate_utc"].timestamp() - float(start.unix_s),
                *(
                    -1.0 if row[k] is None else row[k].timestamp() - float(start.unix_s)
                    for k in ("rise_utc", "set_utc")
                ),
                row["max_alt_deg"],
                row["sunlit_s"],
            )
            for _, row in rows
        )
        assert len(got) == len(want) > 200
        for one, other in zip(got, want, strict=True):
            assert one[0] == other[0]
            assert one[2:4] == pytest.approx(other[2:4], abs=0.02)
            assert one[4] == pytest.approx(other[4], abs=1e-3)
            assert (one[5] is None) == (other[5] is None)
            assert one[5] is None or one[5] == pytest.approx(other[5], abs=0.1)
        for day, row in rows:
            begins = START[:10] if row["rise_utc"] is None else row["rise_utc"].date().isoformat()
            assert day == f"day={begins}"
        numbers = [row["catalog_number"] for _, row in rows]
        assert {95001, 95003} <= set(numbers)
    over = [
        r for _, r in rows if r["rise_utc"] and r["set_utc"] and r["rise_utc"].date() != r["set_utc"].date()
    ]
    assert over


def test_rows_are_in_order_of_rise_and_pandas_reads_the_keys(folder: Path) -> None:
    table = parquet.read_table(folder / "made")
    assert set(table.column("station").to_pylist()) == {"north", "south"}
    assert set(table.column("day").to_pylist()) == {"2026-10-02", "2026-10-03", "2026-10-04"}
    for file in (folder / "made").rglob("*.parquet"):
        rise = [
            -1.0 if t is None else t.timestamp()
            for t in parquet.ParquetFile(file).read()["rise_utc"].to_pylist()
        ]
        assert rise == sorted(rise)


def test_the_files_are_the_same_by_workers_and_from_lists_in_another_order(
    folder: Path, tmp_path: Path
) -> None:
    assert run(command(folder, tmp_path / "out", "--workers", "2")) == 0
    assert contents(tmp_path / "out") == contents(folder / "made")
    tables = STATIONS.split("\n\n")
    (tmp_path / "stations.toml").write_text("\n\n".join(reversed(tables)))
    lines = (folder / "made_up.tle").read_text().splitlines()
    sets = ["\n".join(lines[k : k + 3]) for k in range(0, len(lines), 3)]
    (tmp_path / "made_up.tle").write_text("\n".join(reversed(sets)) + "\n")
    assert run(command(tmp_path, tmp_path / "other")) == 0
    assert contents(tmp_path / "other") == contents(folder / "made")


def test_finished_files_are_verified_and_kept(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(command(folder, out)) == 0
    files = sorted(out.rglob("*.parquet"))
    kept = {file: file.stat().st_mtime_ns for file in files[2:]}
    files[0].write_bytes(files[0].read_bytes()[:-1] + b"?")
    files[1].unlink()
    (files[1].parent / ".passes.parquet.1.part").write_bytes(b"half")
    with (out / dataset.JOURNAL).open("ab") as stream:
        stream.write(b'{"path": "station=nor')
    capsys.readouterr()
    assert run(command(folder, out, "--json")) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["partitions"], answer["resumed"]) == (6, 4)
    assert answer["passes"] == parquet.read_table(out).num_rows
    assert {file: file.stat().st_mtime_ns for file in files[2:]} == kept
    assert contents(out) == contents(folder / "made")


@pytest.mark.parametrize(
    ("more", "differs"),
    [
        (["--hours", "24"], "settings.hours 48.0 there, 24.0 here"),
        (["--from", "2026-10-02T16:00:00Z"], 'settings.from_utc "2026-10-02T15:00:00.000Z" there'),
    ],
)
def test_a_data_set_of_other_settings_is_refused_by_what_differs(
    folder: Path, capsys: pytest.CaptureFixture[str], more: list[str], differs: str
) -> None:
    before = contents(folder / "made")
    assert run([*command(folder, folder / "made"), *more]) == 2
    told = capsys.readouterr().err
    assert differs in told
    assert told.count("\n") == 1
    assert contents(folder / "made") == before


def test_other_elements_and_versions_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, low=39)
    assert run(command(tmp_path, folder / "made")) == 2
    assert "settings.elements.count 43 there, 42 here" in capsys.readouterr().err
    monkeypatch.setattr("sattrack.__version__", "0.0.1")
    assert run(command(folder, folder / "made")) == 2
    assert 'versions.sattrack "' in capsys.readouterr().err


def test_a_folder_with_something_else_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    assert run(command(folder, tmp_path)) == 2
    assert "holds thesis.tex and no data set" in capsys.readouterr().err


def test_a_full_disk_is_one_line_and_what_is_finished_stays(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, synced = tmp_path / "out", []

    def full(number: int) -> None:
        synced.append(number)
        if len(synced) > 8:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(dataset.os, "fsync", full)
        assert run(command(folder, out)) == 1
    told = capsys.readouterr().err
    assert "No space left on device; 2 files finished and kept" in told
    assert told.count("\n") == 1
    assert not list(out.rglob("*.part"))
    assert run(command(folder, out, "--json")) == 0
    assert json.loads(capsys.readouterr().out)["resumed"] == 2
    assert contents(out) == contents(folder / "made")


def test_a_second_process_is_refused_while_one_writes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = json.loads((folder / "made" / dataset.MANIFEST).read_text())
    with dataset.DataSet(folder / "made", manifest):
        assert run(command(folder, folder / "made")) == 1
    assert "another process is writing this data set" in capsys.readouterr().err


def test_a_killed_client_leaves_no_process_and_goes_on_to_the_same_files(
    folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    program = [sys.executable, "-m", "sattrack", *command(folder, out, "--workers", "2")]
    with ended(subprocess.Popen(program, stderr=subprocess.PIPE)) as started:
        until_s = time.monotonic() + 60.0
        while not list(out.rglob("passes.parquet")):
            assert time.monotonic() < until_s
            assert not _ends_within(started, LOOK_EVERY_S)
        started.send_signal(signal.SIGKILL)
        # Its workers have its standard error: the pipe ends when the last of them has ended.
        started.communicate(timeout=60.0)
    assert 0 < len(list(out.rglob("passes.parquet"))) <= 6
    assert run(command(folder, out)) == 0
    assert contents(out) == contents(folder / "made")


def test_a_killed_worker_is_replaced(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    program = [sys.executable, "-m", "sattrack", *command(folder, out, "--workers", "2", "--json")]
    with ended(subprocess.Popen(program, stdout=subprocess.PIPE)) as started:
        children = Path(f"/proc/{started.pid}/task/{started.pid}/children")
        until_s = time.monotonic() + 60.0
        while not (found := [int(word) for word in _words(children) if "spawn_main" in _line_of(word)]):
            assert time.monotonic() < until_s
            assert not _ends_within(started, LOOK_EVERY_S)
        os.kill(found[0], signal.SIGKILL)
        answer, _ = started.communicate(timeout=60.0)
    assert started.returncode == 0
    assert json.loads(answer)["partitions"] == 6
    assert contents(out) == contents(folder / "made")


@contextmanager
def ended(started: subprocess.Popen[bytes]) -> Iterator[subprocess.Popen[bytes]]:
    """Give a program, and kill it at the end, so that nothing waits for one that hangs."""
    try:
        yield started
    finally:
        started.kill()
        started.communicate()


def _ends_within(started: subprocess.Popen[bytes], seconds: float) -> bool:
    """Wait for a program to end; tell whether it has."""
    with suppress(subprocess.TimeoutExpired):
        started.wait(seconds)
        return True
    return False


def _words(file: Path) -> list[str]:
    return file.read_text().split()


def _line_of(pid: str) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("name,latitude_deg,longitude_deg\na,1,2\nA,3,4\n", ":3: a station 'A' is in line 2 already"),
        (STATIONS + STATIONS, ":12: a station 'north' is in line 1 already"),
        (
            "name,latitude_deg,longitude_deg,height_m\nsea,0,-30,9000\n",
            ":2: height_m is 9000; give -500 to 8900",
        ),
        ("name,latitude_deg,longitude_deg\na,91,2\n", ":2: latitude_deg is 91; give -90 to 90"),
        ("name,latitude_deg,longitude_deg\na,nan,2\n", ":2: latitude_deg is nan; give -90 to 90"),
        ("name,latitude_deg,longitude_deg\na,north,2\n", ":2: latitude_deg is 'north'; give a number"),
        (
            "name,latitude_deg,longitude_deg,hight_m\na,1,2,3\n",
            ":1: unknown column 'hight_m'; did you mean 'height_m'?",
        ),
        (
            STATIONS.replace("height_m", "hight_m"),
            ":10: unknown key 'hight_m' in [stations]; did you mean 'height_m'?",
        ),
        ("name,latitude_deg\na,1\n", ":1: the first line names no column longitude_deg"),
        ("name,latitude_deg,longitude_deg\n../a,1,2\n", ":2: name is '../a'; begin with a letter"),
        ("name,latitude_deg,longitude_deg,horizon\na,1,2,no.txt\n", ":2: horizon of a: there is no file"),
        ("", ": lists no station"),
    ],
)
def test_a_bad_line_of_stations_is_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, told: str
) -> None:
    (tmp_path / "made_up.tle").write_text((folder / "made_up.tle").read_text())
    file = tmp_path / ("stations.toml" if "[[" in text else "stations.csv")
    file.write_text(text)
    arguments = command(tmp_path, tmp_path / "out")
    arguments[arguments.index("--stations") + 1] = str(file)
    assert run(arguments) == 2
    printed = capsys.readouterr().err
    assert f"{file.name}{told}" in printed
    assert printed.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_csv_says_the_same_as_toml(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "stations.csv"
    file.write_text(
        "# two of them\nname, latitude_deg, longitude_deg, height_m, min_altitude_deg\n"
        "south, -31.2733, 149.0617, 1165, 15\nnorth, 52.1541, 4.4908, ,\n"
    )
    assert read_stations(file) == read_stations(folder / "stations.toml")


def test_without_pyarrow_it_says_so(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert run(command(folder, tmp_path / "out")) == 1
    assert "run `pip install '.[parquet]'` in the folder of the clone" in capsys.readouterr().err


def test_objects_that_sgp4_refuses_are_counted_and_named(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path, low=2)
    arguments = command(tmp_path, tmp_path / "out")
    arguments[arguments.index("--from") + 1] = "2026-10-12T00:00:00Z"
    assert run(arguments) == 0
    assert "1 of 5 objects left out, the first: DECAYING" in capsys.readouterr().err
    assert np.isin(95003, parquet.read_table(tmp_path / "out")["catalog_number"]) == False  # noqa: E712


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "at_least_km", "at_most_km"),
    [
        pytest.param(28.76, -17.88, 0, 0, id="La Palma"),
        pytest.param(28.76, 342.12, 0, 0, id="La Palma, counted eastward"),
        pytest.param(19.82, -155.47, 0, 0, id="Mauna Kea"),
        pytest.param(67.5, 179.9, 0, 0, id="Chukotka, east"),
        pytest.param(67.5, -179.9, 0, 0, id="Chukotka, west"),
        pytest.param(-89.99, 10.0, 0, 0, id="the south pole"),
        pytest.param(42.0, 51.0, 50, 200, id="the Caspian Sea"),
        pytest.param(0.0, 0.0, 500, 650, id="the Gulf of Guinea"),
        pytest.param(90.0, 0.0, 680, 730, id="the north pole, 707 km from Kaffeklubben Island"),
        # 48° 52.6' S, 123° 23.6' W: Lukatela's place of 1992.
        pytest.param(-48.877, -123.393, 2600, 2730, id="Point Nemo, 2,688 km from land"),
    ],
)
def test_land_and_sea_are_where_they_are(
    latitude_deg: float, longitude_deg: float, at_least_km: float, at_most_km: float
) -> None:
    assert at_least_km <= offshore_km(latitude_deg, longitude_deg) <= at_most_km


def test_a_high_station_at_sea_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    elements, stations = written(tmp_path, low=2)
    stations.write_text(STATIONS.replace("149.0617", "-149.0617"))
    words = ["network", "passes", "--stations", str(stations), "--elements", str(elements)]
    assert run([*words, "--from", START, "--hours", "1", "--out", str(tmp_path / "passes")]) == 0
    printed = capsys.readouterr().err.splitlines()
    assert [line for line in printed if "south: 1165 m high" in line and "in the sea, 1" in line]
    assert not [line for line in printed if "north:" in line]

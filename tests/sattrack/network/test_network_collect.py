"""`network collect`: what two stations saw of a satellite that is late gives elements that are not."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from network_builders import EPOCH, STATIONS, made_up

from sattrack.cli.main import run
from sattrack.network.stations import read_stations
from sattrack.recording.export import SeenDirection, tdm_text
from tle.instants import Utc
from tle.propagator import Propagator
from tle.sources import read_elements, write_elements

if TYPE_CHECKING:
    from pathlib import Path

parquet = pytest.importorskip("pyarrow.parquet")
LATE_S = 1.5


@pytest.fixture
def delivered(tmp_path: Path) -> Path:
    """Deliver directions of a satellite that is late by its elements, from both stations, as TDM and CSV."""
    (tmp_path / "stations.toml").write_text(STATIONS)
    believed = made_up(1)[0]
    # Late along its orbit: its mean anomaly lags.
    lag_deg = LATE_S * believed.mean_motion_rev_day / 86400.0 * 360.0
    true = replace(believed, mean_anomaly_deg=believed.mean_anomaly_deg - lag_deg)
    (tmp_path / "made_up.tle").write_text(write_elements([believed, *made_up(3)[1:3]], "tle"))
    for station in read_stations(tmp_path / "stations.toml"):
        folder = tmp_path / "delivered" / station.name
        folder.mkdir(parents=True)
        times_s = float(EPOCH.unix_s) + np.arange(0.0, 86400.0, 20.0)
        at = Propagator(true, station.site, place="astrometric").at(Utc(times_s))
        rows = zip(
            times_s.tolist(), at.ra_deg.tolist(), at.dec_deg.tolist(), at.alt_deg.tolist(), strict=True
        )
        seen = [
            SeenDirection(utc_s, ra_deg, dec_deg, "icrs", 5.0)
            for utc_s, ra_deg, dec_deg, alt_deg in rows
            if alt_deg > 20.0
        ]
        if station.name == "north":
            text = tdm_text(seen, believed, station.site, float(EPOCH.unix_s), "made up")
            (folder / "night.tdm").write_text(text)
            (folder / "again.tdm").write_text(text)
        else:
            lines = [
                f"{EPOCH.plus(one.utc_s - float(EPOCH.unix_s))},{one.ra_deg!r},{one.dec_deg!r},90001,5"
                for one in seen
            ]
            (folder / "night.csv").write_text(
                "\n".join(["utc,ra_deg,dec_deg,object,sigma_arcsec", *lines]) + "\n"
            )
        (folder / "notes.txt").write_text("clouds after midnight\n")
    return tmp_path


def test_elements_and_biases_follow_from_what_all_stations_saw(
    delivered: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "network",
        "collect",
        str(delivered / "delivered"),
        "--stations",
        str(delivered / "stations.toml"),
    ]
    words += ["--elements", str(delivered / "made_up.tle"), "--out", str(delivered / "out"), "--json"]
    assert run(words) == 0
    answer, told = (json.loads(text) if k == 0 else text for k, text in enumerate(capsys.readouterr()))
    assert answer["stations"] == 2
    assert answer["refined"] == [90001]
    assert answer["used"] == answer["observations"] > 20
    assert told.count("left out") == 2
    assert "notes.txt" in told
    bias = json.loads((delivered / "out" / "biases.json").read_text())[0]
    assert bias["along_s"] == pytest.approx(-LATE_S, abs=0.05)
    table = parquet.read_table(delivered / "out" / "observations")
    assert table.num_rows == answer["observations"]
    assert set(table["station"].to_pylist()) == {"north", "south"}
    shared = {one.catalog_number: one for one in read_elements(delivered / "out" / "elements.kvn")}
    old = {one.catalog_number: one for one in made_up(3)[:3]}
    assert sorted(shared) == [90001, 90002, 90003]
    for number in (90002, 90003):
        assert shared[number].mean_anomaly_deg == pytest.approx(old[number].mean_anomaly_deg)
    site = read_stations(delivered / "stations.toml")[0].site
    for at, station in ((1234.0, site), (40_000.0, site)):
        lag_deg = LATE_S * old[90001].mean_motion_rev_day / 240.0
        true = Propagator(
            replace(old[90001], mean_anomaly_deg=old[90001].mean_anomaly_deg - lag_deg), station
        )
        refined = Propagator(shared[90001], station)
        assert refined.at(EPOCH.plus(at)).range_km == pytest.approx(true.at(EPOCH.plus(at)).range_km, abs=0.3)


def test_what_two_satellites_without_a_number_did_is_not_mixed_up(
    delivered: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen, other, third = read_elements(delivered / "made_up.tle")
    unnumbered = [
        replace(one, catalog_number=99999, designator="", name=name)
        for one, name in ((other, "OBJECT A"), (seen, "OBJECT B"))
    ]
    (delivered / "made_up.tle").write_text(write_elements([*unnumbered, third], "tle"))
    table = delivered / "delivered" / "south" / "night.csv"
    table.write_text(table.read_text().replace(",90001,", ",OBJECT B,"))
    words = ["network", "collect", str(delivered / "delivered"), "--json"]
    words += ["--elements", str(delivered / "made_up.tle"), "--stations", str(delivered / "stations.toml")]
    assert run([*words, "--out", str(delivered / "out")]) == 0
    assert json.loads(capsys.readouterr().out)["refined"] == [99999]
    (bias,) = json.loads((delivered / "out" / "biases.json").read_text())
    assert bias["name"] == "OBJECT B"
    assert bias["along_s"] == pytest.approx(-LATE_S, abs=0.05)
    shared = {one.name: one for one in read_elements(delivered / "out" / "elements.kvn")}
    assert shared["OBJECT A"].mean_anomaly_deg == pytest.approx(other.mean_anomaly_deg)
    assert shared["OBJECT B"].epoch != seen.epoch


def test_a_wrong_date_costs_no_other_satellite_its_fit(
    delivered: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elements = delivered / "more.tle"
    elements.write_text(write_elements([*made_up(3)[:3], made_up(3)[-1]], "tle"))
    late = "utc,ra_deg,dec_deg,object\n2029-10-02T20:00:00Z,10,20,95003\n2029-10-02T20:00:10Z,11,21,95003\n"
    (delivered / "delivered" / "north" / "wrong.csv").write_text(late)
    words = ["network", "collect", str(delivered / "delivered"), "--elements", str(elements), "--json"]
    stations = ["--stations", str(delivered / "stations.toml")]
    assert run([*words, *stations, "--out", str(delivered / "out")]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["refined"] == [90001]
    assert "DECAYING (95003) cannot be propagated to 2029-10-02T20:00:" in err
    rows = parquet.read_table(delivered / "out" / "observations").to_pylist()
    assert [one["used"] for one in rows if one["catalog_number"] == 95003] == [False, False]


def test_nothing_delivered_is_one_line(delivered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (delivered / "empty").mkdir()
    words = ["network", "collect", str(delivered / "empty"), "--stations", str(delivered / "stations.toml")]
    assert run([*words, "--elements", str(delivered / "made_up.tle"), "--out", str(delivered / "out")]) == 2
    assert "no station has delivered anything; it needs folders north, south" in capsys.readouterr().err

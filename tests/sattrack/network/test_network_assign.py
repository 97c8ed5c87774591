"""`network assign`: the best choice by a count of all, never worse than greed, and schedules that run."""

from __future__ import annotations

import json
import shutil
from contextlib import redirect_stdout
from dataclasses import replace as replace_elements
from io import StringIO
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec.structs import replace
from network_builders import START, made_up, written

from sattrack.cli.main import run
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import MountProfile, SitePlace
from sattrack.network import night
from sattrack.network.assign import Assignment, StationPasses, assign, exclusive_sets, greedy
from sattrack.network.night import Mounted, NightPasses
from sattrack.network.stations import Station
from sattrack.safety.limits import SafetyLimits
from tle.instants import Utc
from tle.sources import write_elements

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("highspy")
pytest.importorskip("pyarrow")


def drawn(rng: np.random.Generator, stations: int, each: int, satellites: int) -> Assignment:
    """Return a network of passes at random: slews by where each station looks, on a line."""
    start, value, fresh, members, groups = [], [], [], [], []
    end: list[float] = []
    for _ in range(stations):
        begin = rng.uniform(0.0, 600.0 * each, each)
        until = begin + rng.uniform(60.0, 600.0, each)
        order = np.argsort(until)
        begin, until = begin[order], until[order]
        place = rng.uniform(-90.0, 90.0, each)
        slew = 10.0 + np.abs(place[:, None] - place[None, :]) / 4.0
        fits = until[:, None] + slew <= begin[None, :]
        clash = ~(fits | fits.T)
        np.fill_diagonal(clash, val=False)
        groups.append(StationPasses(np.arange(each) + len(start), clash))
        start += begin.tolist()
        end += until.tolist()
        members += rng.integers(0, satellites, each).tolist()
        value += (rng.choice([1.0, 2.0, 5.0], each) * (until - begin)).tolist()
    fresh = [satellite if rng.uniform() < 0.9 else -1 for satellite in members]
    together = {}
    for one in range(len(start)):
        others = [
            other
            for other in range(len(start))
            if other // each != one // each
            and members[other] == members[one]
            and min(end[one], end[other]) - max(start[one], start[other]) >= 60.0
        ]
        if others:
            together[one] = np.array(others)
    return Assignment(np.array(start), np.array(value), groups, np.array(fresh), together)


def counted(problem: Assignment) -> float:
    """Return the best of all subsets, counted plainly: no part of the solver is used."""
    clashing = {
        frozenset((int(station.members[a]), int(station.members[b])))
        for station in problem.stations
        for a, b in combinations(range(len(station.members)), 2)
        if station.clash[a, b]
    }
    best = 0.0
    count = len(problem.value)
    for bits in range(1 << count):
        taken = [k for k in range(count) if bits >> k & 1]
        if any(frozenset(pair) in clashing for pair in combinations(taken, 2)):
            continue
        total, firsts = 0.0, {}
        for k in taken:
            group = int(problem.fresh[k])
            share = problem.repeat
            if any(other in taken for other in problem.together.get(k, np.array([])).tolist()):
                share += problem.parallax
            total += share * problem.value[k]
            if group >= 0:
                firsts[group] = max(firsts.get(group, 0.0), problem.value[k])
        best = max(best, total + (1.0 - problem.repeat) * sum(firsts.values()))
    return best


@pytest.mark.parametrize(
    "seed", [*range(12), *(pytest.param(k, marks=pytest.mark.soak) for k in range(12, 200))]
)
def test_small_networks_get_the_best_of_all_choices(seed: int) -> None:
    problem = drawn(np.random.default_rng(seed), 3, 4, 5)
    found = assign(problem, seconds=20.0)
    best = counted(problem)
    assert found.value == pytest.approx(best, rel=2e-4)
    assert found.bound >= best * (1.0 - 1e-9)
    assert found.value >= problem.worth(greedy(problem))
    for station in problem.stations:
        mine = np.flatnonzero(np.isin(station.members, found.taken))
        assert not station.clash[np.ix_(mine, mine)].any()


@pytest.mark.parametrize("seed", range(12))
def test_many_passes_are_chosen_part_by_part_below_a_bound_that_holds(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sattrack.network.assign._MOST", 0)
    monkeypatch.setattr("sattrack.network.assign._MOST_AT_ONCE", 4)
    problem = drawn(np.random.default_rng(seed), 3, 4, 3)
    found = assign(problem, seconds=20.0, gap=0.0)
    best = counted(problem)
    assert problem.worth(greedy(problem)) <= found.value == pytest.approx(problem.worth(found.taken))
    assert found.value <= best * (1.0 + 1e-9)
    assert best * (1.0 - 1e-9) <= found.bound <= 1.05 * best
    for station in problem.stations:
        mine = np.flatnonzero(np.isin(station.members, found.taken))
        assert not station.clash[np.ix_(mine, mine)].any()


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_twenty_stations_with_two_thousand_passes_are_within_two_percent(seed: int) -> None:
    problem = drawn(np.random.default_rng(seed), 20, 100, 400)
    found = assign(problem, seconds=60.0, gap=0.01)
    assert found.gap <= 0.02
    assert found.value > problem.worth(greedy(problem))


def test_each_pair_that_clashes_is_in_one_exclusive_set_and_no_other_pair() -> None:
    problem = drawn(np.random.default_rng(5), 1, 60, 60)
    station = problem.stations[0]
    order = np.argsort(problem.start_s)
    clash = station.clash[np.ix_(order, order)]
    pairs = {pair for one in exclusive_sets(clash) for pair in combinations(sorted(one.tolist()), 2)}
    assert pairs == {(a, b) for a, b in combinations(range(60), 2) if clash[a, b]}


def test_slews_between_passes_are_those_of_the_stations_own_axes() -> None:
    station = Station("north", 52.0, 4.5)
    sky, seconds = np.array([[52.0, 355.0], [52.0, 5.0]]), np.array([0.0, 100.0])
    # Both are 3° from the celestial pole, on either side: 180° apart in hour angle, 10° in azimuth.
    two = NightPasses(
        *(np.zeros(2, dtype=np.intp), np.array([1, 2]), np.array(["A", "B"]), seconds, seconds + 85.0),
        *(np.ones(2), sky, sky),
    )
    altaz = replace(MountProfile(), geometry=AxisGeometry(180.0, 90.0), stands_at=SitePlace(52.0, 4.5))
    for profile, clashes in ((MountProfile(), True), (altaz, False)):
        found = night._clash(two, Mounted(station, profile, SafetyLimits()), 5.0)
        assert found.tolist() == [[False, clashes], [clashes, False]]


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("assigned")
    elements, stations = written(folder, low=12)
    where = ["--stations", str(stations), "--elements", str(elements)]
    span = ["--from", START, "--hours", "12"]
    assert run(["network", "passes", *where, *span, "--out", str(folder / "passes")]) == 0
    return folder


def words_for(folder: Path, out: Path) -> list[str]:
    words = ["network", "assign", "--stations", str(folder / "stations.toml"), "--json", "--out", str(out)]
    return [
        *words,
        *("--elements", str(folder / "made_up.tle")),
        "--passes",
        str(folder / "passes"),
        "--any-light",
    ]


def assigned(folder: Path, out: Path, capsys: pytest.CaptureFixture[str], *more: str) -> dict[str, Any]:
    capsys.readouterr()
    assert run([*words_for(folder, out), *more]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


@pytest.fixture(scope="module")
def first(network: Path) -> dict[str, Any]:
    """Return the assignment of the whole night, whose files are in the folder `night`, with a plot."""
    page = ("--plot", str(network / "night.html"))
    with redirect_stdout(StringIO()) as printed:
        assert run([*words_for(network, network / "night"), *page]) == 0
    answer: dict[str, Any] = json.loads(printed.getvalue())
    return answer


def test_run_plans_all_of_each_schedule(
    network: Path, first: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    found = first
    assert found["value"] <= found["bound"]
    assert found["gap"] <= 0.02
    assert len(found["assignments"]) > 10
    for name, site in (("north", "52.1541,4.4908"), ("south", "-31.2733,149.0617,1165")):
        words = ["run", str(network / "night" / f"{name}.toml"), "--dry-run", "--json", "--site", site]
        assert run([*words, "--clock", START]) == 0
        plan = json.loads(capsys.readouterr().out)
        mine = [one for one in found["assignments"] if one["station"] == name]
        assert plan["lost"] == []
        assert [(one["catalog_number"], one["start_utc"][:19]) for one in plan["passes"]] == [
            (one["catalog_number"], one["start_utc"][:19]) for one in mine
        ]
    page = (network / "night.html").read_text()
    assert page.count("<tr>") == len(found["assignments"]) + 1
    assert "data:image/png;base64," in page


def test_bad_weather_empties_a_station_and_keeps_what_has_begun(
    network: Path, first: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    now = "2026-10-02T20:00:00Z"
    # By other elements the same passes were a second later.
    earlier = json.loads((network / "night" / "assignment.json").read_text())
    for row in earlier["assignments"]:
        for key in ("start_utc", "end_utc"):
            row[key] = Utc.parse(row[key]).plus(1.0).isoformat("seconds")
    (tmp_path / "earlier.json").write_text(json.dumps(earlier))
    again = assigned(
        network,
        tmp_path / "night",
        capsys,
        *("--previous", str(tmp_path / "earlier.json"), "--clock", now),
        *("--closed", "south=2026-10-02T20:30:00Z/2026-10-03T03:00:00Z"),
    )

    def begun(found: dict[str, Any]) -> set[tuple[str, int, str]]:
        rows = found["assignments"]
        return {(r["station"], r["catalog_number"], r["start_utc"]) for r in rows if r["start_utc"] < now}

    assert begun(first)
    assert begun(again) == begun(first)
    south = [r for r in again["assignments"] if r["station"] == "south"]
    assert all(r["end_utc"] <= "2026-10-02T20:30:00Z" for r in south)
    assert any(
        r["station"] == "south" and r["start_utc"] > "2026-10-02T20:30:00Z" for r in first["assignments"]
    )
    assert again["value"] < first["value"]


def test_a_data_set_that_is_not_finished_is_not_assigned(
    network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(network / "passes", tmp_path / "passes")
    day = "station=south/day=2026-10-02/passes.parquet"
    (tmp_path / "passes" / day).unlink()
    words = ["network", "assign", "--stations", str(network / "stations.toml"), "--out", str(tmp_path / "x")]
    words += ["--elements", str(network / "made_up.tle"), "--passes", str(tmp_path / "passes")]
    assert run(words) == 2
    told = capsys.readouterr().err
    assert told.endswith(f"is not finished: there is no {day}; the command that made it continues it\n")
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("text", ['{"assignments": [{}]}', '{"assignments": 3}', "[]"])
def test_an_earlier_assignment_that_is_none_is_one_line(
    text: str, network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    earlier = tmp_path / "earlier.json"
    earlier.write_text(text)
    words = ["network", "assign", "--stations", str(network / "stations.toml"), "--out", str(tmp_path / "x")]
    words += ["--elements", str(network / "made_up.tle"), "--passes", str(network / "passes")]
    assert run([*words, "--previous", str(earlier)]) == 2
    told = f"sattrack: {earlier}: no assignment; give the assignment.json of an earlier one\n"
    assert capsys.readouterr().err == told


def test_passes_may_be_followed_for_less_than_a_minute(
    network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = assigned(network, tmp_path / "night", capsys, "--longest", "45")
    assert len(found["assignments"]) > 10
    for one in found["assignments"]:
        seconds = Utc.parse(one["end_utc"]) - Utc.parse(one["start_utc"])
        assert seconds == pytest.approx(45.0, abs=1.0)


def test_passes_by_old_elements_are_left_out_with_a_word(
    network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = [replace_elements(one, epoch=one.epoch.plus(-8.0 * 86_400.0)) for one in made_up(12)]
    elements = tmp_path / "old.tle"
    elements.write_text(write_elements([*old[:-4], *made_up(12)[-4:]], "tle"))
    where = ["--stations", str(network / "stations.toml"), "--passes", str(network / "passes")]
    words = ["network", "assign", *where, "--any-light", "--out", str(tmp_path / "night"), "--seconds", "2"]
    assert run([*words, "--elements", str(elements)]) == 0
    told = capsys.readouterr().err
    assert "passes left out: their elements are more than 7 days from them, or are not given" in told


def test_passes_that_begin_behind_the_skyline_of_the_settings_are_left_out(
    network: Path, first: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "east.horizon").write_text("0 5\n90 35\n180 5\n270 5\n")
    settings = tmp_path / "sattrack.toml"
    settings.write_text('[safety]\nhorizon = "east.horizon"\n')
    some = assigned(network, tmp_path / "some", capsys, "--config", str(settings))
    assert 5 < len(some["assignments"]) < len(first["assignments"])


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (
            ["--closed", "nrth=2026-10-02T20:00Z/2026-10-03T00:00Z"],
            "no station is named 'nrth'; did you mean 'north'?",
        ),
        (["--closed", "north"], "write STATION=FROM/TO"),
        (["--closed", "north=2026-10-03T20:00Z/2026-10-03T00:00Z"], "ends before it begins"),
        (["--passes", "."], "no data set of passes"),
        (["--repeat", "2"], "--repeat 2: give a share from 0 to 1"),
    ],
)
def test_bad_wishes_are_one_line(
    network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], told: str
) -> None:
    words = ["network", "assign", "--stations", str(network / "stations.toml"), "--out", str(tmp_path / "x")]
    words += ["--elements", str(network / "made_up.tle"), "--passes", str(network / "passes"), *more]
    assert run(words) == 2
    printed = capsys.readouterr().err
    assert told in printed
    assert printed.count("\n") == 1


def test_satellites_without_a_catalogue_number_are_told_apart_by_their_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, stations = written(tmp_path)
    low = [
        replace_elements(one, name=name, catalog_number=number, designator="")
        for one, name, number in zip(
            made_up(5), ("OBJECT A", "OBJECT B", "ODD", "", ""), (99999, 99999, 0, 0, 0), strict=False
        )
    ]
    (tmp_path / "made_up.tle").write_text(write_elements([*low, made_up(6)[5]], "tle"))
    words = ["--stations", str(stations), "--elements", str(tmp_path / "made_up.tle"), "--from", START]
    assert run(["network", "passes", *words, "--hours", "24", "--out", str(tmp_path / "passes")]) == 0
    found = assigned(tmp_path, tmp_path / "night", capsys)
    numbers = {one["name"]: one["catalog_number"] for one in found["assignments"]}
    assert numbers == {"OBJECT A": None, "OBJECT B": None, "ODD": None, "LOW 5": 90006}
    for name, site in (("north", "52.1541,4.4908"), ("south", "-31.2733,149.0617,1165")):
        words = ["run", str(tmp_path / "night" / f"{name}.toml"), "--dry-run", "--json", "--site", site]
        assert run([*words, "--clock", START]) == 0
        plan = json.loads(capsys.readouterr().out)
        assert plan["lost"] == []
        assert [(one["name"], one["start_utc"][:19]) for one in plan["passes"]] == [
            (one["name"], one["start_utc"][:19]) for one in found["assignments"] if one["station"] == name
        ]
    previous = ("--previous", str(tmp_path / "night" / "assignment.json"), "--clock", "2026-10-02T20:00:00Z")
    again = assigned(tmp_path, tmp_path / "again", capsys, *previous)
    begun = [one for one in found["assignments"] if one["start_utc"] < "2026-10-02T20:00:00Z"]
    assert begun
    assert [one for one in again["assignments"] if one["start_utc"] < "2026-10-02T20:00:00Z"] == begun

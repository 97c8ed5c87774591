"""`sattrack elements get|show|check`, and every format of elements in the commands that follow satellites."""

from __future__ import annotations

import io
import json
import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from element_server import CSV, LINES, ElementServer, element_server

from sattrack.cli.main import run
from tle.elements import Elements
from tle.sources import WRITTEN, load_elements, parse_elements, write_elements

if TYPE_CHECKING:
    from collections.abc import Iterator

NOW = ("--clock", "2026-10-03T00:00:00Z")
SITE = ("--site", "52.1541,4.4908,0")
STARLINK = "100534"
HIGH_PASS = ("--clock", "2026-10-02T07:33:06Z")
"""It rises above 70° at 07:33:22."""
# Vallado et al. 2006, verification set: a rocket body whose perigee is inside the Earth.
SUB_ORBITAL = (
    "1 28872U 05037B   05333.02012661  .25992681  00000-0  24476-3 0  1534",
    "2 28872  96.4736 157.9986 0303955 244.0492 110.6523 16.46015938 10708",
)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[ElementServer]:
    with element_server() as found:
        monkeypatch.setenv("SATTRACK_CELESTRAK_URL", found.url)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        yield found


@pytest.fixture
def csv_file(tmp_path: Path) -> str:
    path = tmp_path / "elements"
    path.write_text(CSV)
    return str(path)


def ran(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> tuple[str, str]:
    assert run(list(arguments)) == code
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out, err


def test_show_tells_what_a_person_wants_to_know(csv_file, capsys):
    out, err = ran(capsys, "elements", "show", "iss", "--elements", csv_file, *NOW)
    lines = out.splitlines()
    assert lines[0] == "ISS (ZARYA)   25544   1998-067A"
    assert lines[1] == "  epoch        2026-10-02 00:19:53 UTC, 0.99 days old"
    # 1440 / 15.48707684 minutes; by hand, n = 1.126255e-3 rad/s, a = 6798.6 km, over 6378.135 km.
    assert lines[2] == "  period       92.98 min"
    assert lines[3] == "  apogee       425 km"
    assert lines[4] == "  perigee      416 km"
    assert lines[5] == "  inclination  51.6312°"
    assert lines[6].startswith("  expect it    within about 0.077 s along its track: ")
    assert err == ""


def test_show_as_json_has_no_made_up_numbers(csv_file, capsys):
    out, _ = ran(capsys, "elements", "show", STARLINK, "--json", "--elements", csv_file, *NOW)
    (row,) = json.loads(out)
    assert row["catalog_number"] == 100534
    assert row["designator"] == "2026-200A"
    assert row["period_min"] == pytest.approx(1440.0 / 15.7759124)
    assert row["age_days"] == pytest.approx(1.0754, abs=1e-4)
    assert row["expected_along_s"] > 0.05
    assert row["expected_along_arcsec"] > row["expected_along_s"]
    assert row["cannot_be_followed"] is None


def test_show_lists_all(csv_file, capsys):
    out, _ = ran(capsys, "elements", "show", "--elements", csv_file, *NOW)
    assert [line.split()[0] for line in out.splitlines()[1:]] == ["25544", STARLINK]


def test_show_says_that_an_object_cannot_be_followed(tmp_path, capsys):
    path = tmp_path / "x"
    path.write_text("\n".join(line[:68] + str(checksum(line)) for line in SUB_ORBITAL))
    # The mean anomaly of 110.6523° leaves 60.6 of its 87.48 minutes to the perigee.
    show = ("elements", "show", "28872", "--elements", str(path), "--clock")
    at_perigee, _ = ran(capsys, *show, "2005-11-29T01:29:34Z")
    assert "is below the ground at 2005-11-29T01:29:34Z: it is sub-orbital" in at_perigee
    later, _ = ran(capsys, *show, "2005-11-29T00:30:00Z")
    assert "km inside the Earth: it is sub-orbital" in later


def checksum(line: str) -> int:
    return sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10


def test_check_lists_every_refusal_and_ends_with_one(tmp_path, capsys):
    path = tmp_path / "mixed.csv"
    path.write_text(CSV.replace(".00032284", "1.0") + CSV.splitlines()[1][:50] + "\n")
    out, _ = ran(capsys, "elements", "check", str(path), code=1)
    first, second, last = out.splitlines()
    assert first.startswith(f"{path}:3: ECCENTRICITY '1.0' is outside 0 to below 1")
    assert second.startswith(f"{path}:4: ")
    assert last == "1 accepted, 2 rejected"
    out, _ = ran(capsys, "elements", "check", str(path), "--json", code=1)
    document = json.loads(out)
    assert document["accepted"] == 1
    assert [(r["line"], r["name"], r["catalog_number"]) for r in document["rejected"]] == [
        (3, "STARLINK-38244", 100534),
        (4, "ISS (ZARYA)", None),
    ]
    assert all(set(r) == {"line", "name", "catalog_number", "reason"} for r in document["rejected"])


def test_check_ends_with_nought_where_all_is_well(csv_file, capsys):
    assert ran(capsys, "elements", "check", csv_file)[0] == "2 accepted, 0 rejected\n"


def test_check_of_nothing_is_bad_usage(capsys, tmp_path):
    _, err = ran(capsys, "elements", "check", code=2)
    assert "name a file, folder, URL or celestrak:GROUP" in err
    assert "No such file" in ran(capsys, "elements", "check", str(tmp_path / "none"), code=2)[1]


@pytest.mark.parametrize("form", WRITTEN)
def test_get_writes_every_format(csv_file, tmp_path, form, capsys):
    target = tmp_path / "written"
    out, err = ran(capsys, "elements", "get", csv_file, "--format", form, "--output", str(target))
    assert out == ""
    assert "2 element sets written" in err
    wanted = load_elements(csv_file).accepted
    found = load_elements(target).accepted
    if form in ("tle", "2le"):
        wanted = [item for item in parse_elements(write_elements(wanted, form)) if isinstance(item, Elements)]
    assert found == wanted
    assert [one.catalog_number for one in found] == [25544, 100534]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["elements", "written"]


def test_what_is_written_goes_to_the_file_behind_a_link(csv_file, tmp_path, capsys):
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("of yesterday")
    link.symlink_to(real)
    ran(capsys, "elements", "get", csv_file, "--output", str(link))
    assert link.is_symlink()
    assert len(load_elements(real).accepted) == 2


def test_what_is_written_goes_into_a_pipe(csv_file, tmp_path, capsys):
    """As `--output >(gzip > iss.csv.gz)` makes one, and `--output /dev/stdout`."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        ran(capsys, "elements", "get", csv_file, "--output", str(pipe))
        assert os.read(reader, 1 << 16).startswith(b"OBJECT_NAME")
    finally:
        os.close(reader)
    assert pipe.is_fifo()


def test_a_file_that_may_be_written_in_a_folder_that_may_not_is_written(
    csv_file, tmp_path, monkeypatch, capsys
):
    target = tmp_path / "shared.csv"
    target.touch()
    before = target.stat().st_ino
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != tmp_path)
    ran(capsys, "elements", "get", csv_file, "--output", str(target))
    assert target.stat().st_ino == before
    assert len(load_elements(target).accepted) == 2


def test_get_takes_standard_input_and_one_satellite(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(LINES)))
    out, _ = ran(capsys, "elements", "get", "-", "--satellite", "1998-067A", "--json")
    (row,) = json.loads(out)
    assert row["NORAD_CAT_ID"] == 25544


def test_get_says_what_a_tle_cannot_hold(tmp_path, capsys):
    path = tmp_path / "x"
    path.write_text(CSV.replace("100534", "999999999"))
    out, err = ran(capsys, "elements", "get", str(path), "--format", "tle", code=2)
    assert out == ""
    assert "catalogue number 999999999 does not fit a TLE: Alpha-5 ends at 339999: write an OMM" in err


def test_get_fetches_keeps_and_tells_the_age(server, capsys):
    assert load_elements(ran(capsys, "elements", "get", "celestrak:active")[0]).accepted
    out, err = ran(capsys, "elements", "get", "celestrak:active", "celestrak:active")
    assert load_elements(out).accepted
    assert "sattrack: celestrak:active: using what was fetched" in err
    assert server.asked == ["GROUP=active&FORMAT=csv"]


def test_a_truncated_list_is_told(server, capsys):
    server.manner = "tle"
    url = f"{server.url}/NORAD/elements/gp.php?GROUP=active&FORMAT=tle"
    _, err = ran(capsys, "elements", "check", url)
    assert "is truncated: a list in TLE format lacks every object numbered 100000 and above" in err


def test_what_the_network_refuses_is_one_line_and_ends_with_one(server, capsys):
    where = ("--elements", "celestrak:nowhere", *SITE, "--mount", "sim")
    out, err = ran(capsys, "track", "25544", *where, code=1)
    assert out == ""
    assert err.startswith("sattrack: celestrak:nowhere: 127.0.0.1 has none of that name (Invalid query")
    assert err.count("\n") == 1


def test_files_of_a_folder_without_elements_count_as_files(tmp_path, capsys):
    (tmp_path / "iss.csv").write_text(CSV)
    (tmp_path / "notes.txt").write_text("clear tonight\n")
    _, err = ran(capsys, "elements", "show", "25544", "--elements", str(tmp_path))
    assert err.startswith(f"sattrack: 1 file holds no element sets, the first: {tmp_path}/notes.txt: ")


def test_sets_refused_beside_good_ones_are_told_and_do_not_stop_a_command(tmp_path, capsys):
    path = tmp_path / "mixed.csv"
    path.write_text(CSV.replace(".00032284", "1.0"))
    span = ("--from", "2026-10-02T13:05:00Z", "--to", "2026-10-02T13:05:00Z", "--step", "1", "--json")
    out, err = ran(capsys, "ephemeris", "25544", "--elements", str(path), *SITE, *span)
    assert json.loads(out)
    assert "1 of 2 element sets refused, the first: " in err
    assert (
        "no satellite '100534'"
        in ran(capsys, "ephemeris", STARLINK, "--elements", str(path), *SITE, *span, code=2)[1]
    )


def test_100534_is_found_in_every_format_and_followed(tmp_path, capsys):
    path = tmp_path / "elements"
    rest = ("--elements", str(path), *SITE, "--json")
    span = ("--from", "2026-10-02T06:00:00Z", "--to", "2026-10-02T06:00:30Z", "--step", "10")
    found = []
    for form in WRITTEN:
        path.write_text(write_elements(load_elements(CSV).accepted, form))
        out, _ = ran(capsys, "ephemeris", STARLINK, *rest, *span)
        found.append([row["alt_deg"] for row in json.loads(out)])
        assert len(found[-1]) == 4
        assert found[-1] == pytest.approx(found[0], abs=0.01)
    path.write_text(write_elements(load_elements(CSV).accepted, "tle"))
    summary = followed(capsys, *rest, *HIGH_PASS)
    assert summary["catalog_number"] == 100534
    assert summary["ended_by"] == "set"
    assert summary["true_rms_arcsec"] < 1.0


def followed(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    out, _ = ran(capsys, "track", STARLINK, "--mount", "sim", "--virtual", "--min-alt", "70", *arguments)
    return json.loads(out.splitlines()[-1])["summary"]


def test_track_takes_a_group_by_its_short_name(server, capsys):
    summary = followed(capsys, "--elements", "celestrak:active", *SITE, "--json", *HIGH_PASS)
    assert summary["catalog_number"] == 100534
    assert server.asked == ["GROUP=active&FORMAT=csv"]


def test_progress_is_shown_on_a_terminal_only(server, capsys, monkeypatch):
    assert ran(capsys, "elements", "get", "celestrak:active")[1] == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    _, err = ran(capsys, "elements", "get", "celestrak:stations")
    assert "celestrak:stations: 0.0 MB" in err
    assert err.endswith("\r\x1b[K")


def test_the_example_follows_a_group_that_is_fetched_once(server, tmp_path, capsys, monkeypatch):
    # In the last half minute of a pass.
    example = Path(__file__).parents[3] / "examples" / "follow_celestrak_group.py"
    monkeypatch.setattr(sys, "argv", [str(example), "stations", "ISS (ZARYA)", "2026-10-02T09:52:40Z"])
    said = []
    for _ in range(2):
        runpy.run_path(str(example), run_name="__main__")
        said.append(capsys.readouterr())
        assert "on target for" in said[-1].out
    assert server.asked == ["GROUP=stations&FORMAT=csv"]
    assert said[0].out == said[1].out
    assert "using what was fetched" in said[1].err
    assert list((tmp_path / "cache" / "sattrack" / "elements").glob("*.elements"))


def test_the_network_is_imported_only_for_what_needs_it(csv_file):
    code = (
        "import sys; from sattrack.cli.main import run;"
        f"run(['elements', 'check', {csv_file!r}]); print('aiohttp' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"


def asked_for(server: ElementServer) -> list[str]:
    return [query.partition("&")[0] for query in server.asked]


def test_a_satellite_is_fetched_by_name_where_no_elements_are_set(server, capsys):
    out, err = ran(capsys, "passes", "ISS", *SITE, *HIGH_PASS, "--json")
    assert {row["catalog_number"] for row in json.loads(out)} == {25544}
    assert "no elements are set: ISS was downloaded from 127.0.0.1, and is kept for 2 h" in err
    # What was fetched is kept: the second command asks nobody.
    high = ("--clock", "2026-10-02T13:05:20Z", "--min-alt", "75")
    ran(capsys, "track", "iss", "--mount", "sim", "--virtual", *SITE, *high)
    assert asked_for(server) == ["CATNR=25544"]


@pytest.mark.parametrize(
    ("satellite", "query"),
    [
        ("Tiangong", "CATNR=48274"),
        ("100534", "CATNR=100534"),
        ("A0534", "CATNR=100534"),
        ("2026-200A", "INTDES=2026-200"),
        ("26200A", "INTDES=2026-200"),
        ("Starlink-38244", "NAME=STARLINK-38244"),
    ],
)
def test_whatever_names_a_satellite_is_asked_for_as_celestrak_wants_it(server, capsys, satellite, query):
    ran(capsys, "elements", "get", satellite)
    assert asked_for(server) == [query]


def test_offline_a_satellite_comes_from_any_list_that_was_kept(server, capsys):
    ran(capsys, "elements", "get", "celestrak:stations")
    server.manner = "html"
    out, err = ran(capsys, "elements", "get", "ISS")
    assert "ISS (ZARYA)" in out
    assert "STARLINK" not in out
    assert err == (
        "sattrack: ISS: using celestrak:stations (2 satellites), fetched 0 s ago: celestrak:25544: "
        "the server sent a web page instead of elements: Down for maintenance\n"
    )


def test_offline_with_nothing_kept_says_what_is_held_and_how_to_bring_a_file(server, capsys):
    ran(capsys, "elements", "get", "celestrak:stations")
    server.manner = "html"
    _, err = ran(capsys, "passes", "Hubble", *SITE, code=2)
    line = err.splitlines()[-1]
    assert line.startswith("sattrack: no elements of Hubble: ")
    assert "kept from earlier downloads: celestrak:stations (2 satellites), fetched 0 s ago" in line
    assert f"save {server.url}/NORAD/elements/gp.php?CATNR=20580&FORMAT=csv as a file" in line
    assert "`track` and others take it by --elements FILE" in line


def test_a_satellite_that_celestrak_has_not_is_told_with_what_was_meant(server, capsys):
    for _ in range(2):
        _, err = ran(capsys, "passes", "hubbel", *SITE, code=2)
    assert asked_for(server) == ["NAME=HUBBEL"]
    assert err == "sattrack: 127.0.0.1 has no satellite 'hubbel'; did you mean Hubble?\n"
    ran(capsys, "elements", "get", "celestrak:stations")
    _, err = ran(capsys, "passes", "Zaria", *SITE, code=2)
    assert err == "sattrack: 127.0.0.1 has no satellite 'Zaria'; did you mean ISS (ZARYA) (25544)?\n"
    _, err = ran(capsys, "passes", "Xyzzy", *SITE, code=2)
    assert err.endswith("'Xyzzy': check the spelling, or give the catalogue number\n")


def test_what_is_asked_for_is_not_told_as_a_download_without_elements(server, capsys, tmp_path):
    out, err = ran(capsys, "elements", "get", "ISS")
    assert "ISS (ZARYA)" in out
    assert err == ""


def test_a_satellite_outside_the_elements_that_are_set_can_be_fetched_as_told(server, capsys, csv_file):
    _, err = ran(capsys, "passes", "Hubble", *SITE, "--elements", csv_file, code=2)
    assert err.endswith(": check the spelling, or give --elements celestrak:20580 to fetch it\n")
    _, err = ran(capsys, "passes", "Big Bird", *SITE, "--elements", csv_file, code=2)
    assert "give --elements 'celestrak:name=Big Bird' to fetch it" in err


def test_a_name_is_not_asked_for_where_the_settings_forbid_it(server, capsys, tmp_path):
    config = tmp_path / "sattrack.toml"
    config.write_text("fetch_by_name = false\n")
    _, err = ran(capsys, "passes", "ISS", *SITE, "--config", str(config), code=2)
    assert "no elements" in err
    assert server.asked == []


def test_practice_needs_no_elements_and_asks_nobody(server, capsys):
    ran(capsys, "rehearse", "ISS", "--json", "--min-alt", "75")
    assert server.asked == []


LATER = ("track", "ISS", "--mount", "sim", "--virtual", *SITE, "--clock")


def test_elements_too_old_to_find_the_satellite_with_are_refused(csv_file, capsys):
    # The epoch is 2026-10-02, 00:19 UTC; the next pass over Leiden is on the 23rd at 02:56 UTC.
    _, err = ran(capsys, *LATER, "2026-10-22T12:00:00Z", "--elements", csv_file, code=2)
    assert err.splitlines()[-1] == (
        "sattrack: the elements of ISS (ZARYA) are 21 days off the pass, 14 are allowed: "
        "fetch new ones: `sattrack elements get 25544 --output new.csv`, then give --elements new.csv, "
        "or give --old-elements"
    )


def test_old_elements_are_followed_where_that_is_asked_for_and_the_summary_says_so(csv_file, capsys):
    old = ("--elements", csv_file, "--old-elements", "--min-alt", "30")
    out, _ = ran(capsys, *LATER, "2026-10-23T03:00:30Z", *old)
    assert "  against elements 21 days old" in out.splitlines()
    out, _ = ran(capsys, *LATER, "2026-10-02T13:05:20Z", "--elements", csv_file, "--min-alt", "75")
    assert "against elements" not in out


def test_elements_whose_error_is_beyond_the_field_are_refused(csv_file, capsys):
    four_days = (*LATER, "2026-10-06T13:09:40Z", "--elements", csv_file)
    _, err = ran(capsys, *four_days, "--fov", "0.05", code=2)
    assert "off along its track, out of a field of 0.05°" in err.splitlines()[-1]
    ran(capsys, *four_days[:-3], "2026-10-06T13:10:15Z", *four_days[-2:], "--fov", "5", "--min-alt", "60")

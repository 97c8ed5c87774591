"""`sattrack ephemeris TARGET` for what is no element set: files, bodies and directions."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from ephemeris_files import ISS, cpf_text, oem_text

from sattrack.cli.main import run

SPAN = ("--from", "2026-10-02T13:01:00Z", "--to", "2026-10-02T13:09:00Z", "--step", "7")
LEIDEN = ("--site", "52.1541,4.4908,0")
ANGLES = ("ra_deg", "dec_deg", "ha_deg", "alt_deg", "az_deg")


@pytest.fixture
def ask(capsys):
    def asked(*arguments):
        code = run(["ephemeris", *arguments, *LEIDEN])
        told = capsys.readouterr()
        return code, told.out, told.err

    return asked


@pytest.fixture
def oem(tmp_path):
    path = tmp_path / "iss.oem"
    path.write_text(oem_text("2026-10-02T12:50:00Z", 40))
    return str(path)


def test_rows_of_a_satellite_are_those_of_the_elements_that_made_them(ask, oem, tmp_path):
    sets = tmp_path / "sets.tle"
    sets.write_text("\n".join(["ISS (ZARYA)", *ISS, ""]))
    code, out, err = ask("1998-067A", "--ephemeris", oem, "--json", *SPAN)
    assert code == 0
    assert err == "sattrack: ISS: OEM by SGP4, Lagrange, degree 11, TEME; error not stated\n"
    rows = json.loads(out)
    others = json.loads(ask("ISS", "--elements", str(sets), "--json", *SPAN)[1])
    assert len(rows) == len(others) > 60
    for row, other in zip(rows, others, strict=True):
        assert list(row) == list(other)
        assert row["utc"] == other["utc"]
        for name in ANGLES:
            assert row[name] == pytest.approx(other[name], abs=0.01 / 3600.0)
        for name in ("ra_rate_deg_s", "dec_rate_deg_s", "alt_rate_deg_s"):
            assert row[name] == pytest.approx(other[name], abs=5e-4 / 3600.0)
        assert row["range_km"] == pytest.approx(other["range_km"], abs=1e-4)
        assert row["sunlit"] == other["sunlit"]


def test_instants_outside_the_rows_are_null_and_told(ask, oem):
    code, out, err = ask(
        "ISS", "--ephemeris", oem, "--json", "--from", "2026-10-02T13:29:00Z", "--to", "2026-10-02T13:31:00Z"
    )
    rows = json.loads(out)
    assert code == 0
    assert [row["ra_deg"] is None for row in rows] == [False] * 7 + [True] * 6
    assert "6 of 13 instants have no position" in err
    assert "is from 2026-10-02T12:50:00.000Z to 2026-10-02T13:30:00.000Z" in err
    code, out, err = ask("ISS", "--ephemeris", oem, "--from", "2026-10-03T00:00:00Z")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("target", "ranged", "sunlit"),
    [("Moon", True, True), ("jupiter", True, True), ("Sun", True, None), ("05:34:31 +22:00:52", False, None)],
)
def test_bodies_and_directions_need_no_elements(ask, target, ranged, sunlit):
    code, out, err = ask(target, "--json", *SPAN)
    assert code == 0
    assert "skyfield" in err
    row = json.loads(out)[0]
    assert (row["range_km"] is not None) is ranged
    assert (row["range_rate_km_s"] is not None) is ranged
    assert row["sunlit"] is sunlit


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("25:00:00,10",), "'25:00:00,10' is no direction"),
        (("83.6,95",), "Dec from -90° to 90°"),
        (("1:60:00,10",), "write RA,DEC"),
        (("ISS", "--ephemeris", "absent.oem"), "absent.oem: cannot read the ephemeris: No such file"),
    ],
)
def test_what_is_no_target_is_refused_in_one_line(ask, arguments, words):
    code, out, err = ask(*arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_a_star_is_one_of_the_catalogue_that_the_settings_name(ask, tmp_path):
    (tmp_path / "stars.dat").write_text(
        "H|       91262| |18 36 56.19|+38 46 58.8| 0.03|1|H|279.23410832|+38.78299311| | 128.93|  201.02|"
        "  287.46|\n"
    )
    sets, settings = tmp_path / "sets.tle", tmp_path / "sattrack.toml"
    settings.write_text('stars = "stars.dat"\n')
    rows = [
        json.loads(ask(key, "--config", str(settings), "--json", *SPAN)[1])[0]
        for key in ("vega", "HIP 91262")
    ]
    assert rows[0] == rows[1]
    assert rows[0]["ra_deg"] == pytest.approx(279.46, abs=0.01)
    # Without that setting it is one of the packaged stars.
    assert json.loads(ask("Vega", "--json", *SPAN)[1])[0] == rows[0]
    code, _, err = ask("HIP 87937", *SPAN)
    assert code == 2
    assert "none of the packaged stars, to magnitude 6.5: set stars in sattrack.toml" in err
    # A satellite of that name is the satellite.
    sets.write_text("\n".join(["VEGA", *ISS, ""]))
    row = json.loads(ask("Vega", "--config", str(settings), "--elements", str(sets), "--json", *SPAN)[1])[0]
    assert row["range_km"] is not None


def test_a_satellite_is_found_without_skyfield(tmp_path):
    sets = tmp_path / "sets.tle"
    sets.write_text("\n".join(["ISS", *ISS, ""]))
    arguments = ["ephemeris", "ISS", "--elements", str(sets), *LEIDEN, *SPAN]
    code = f"""
import sys
from sattrack.cli.main import run
run({arguments!r})
print("imported:", "skyfield" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported: False"


@pytest.fixture
def three(tmp_path):
    """Old elements, fresh ones, and rows made of the fresh ones that state 20 m."""
    old, fresh, table = tmp_path / "old.tle", tmp_path / "fresh.tle", tmp_path / "rows.oem"
    fresh.write_text("\n".join(["ISS", *ISS, ""]))
    # The same orbit, its epoch ten days before, its checksum with it.
    first = ISS[0].replace("26275", "26265")
    old.write_text("\n".join(["ISS", with_checksum(first), ISS[1], ""]))
    table.write_text(oem_text("2026-10-02T12:50:00Z", 40))
    return old, fresh, table


def with_checksum(line):
    total = sum(int(c) if c.isdigit() else c == "-" for c in line[:68])
    return f"{line[:68]}{total % 10}"


AT = ("--clock", "2026-10-02T13:00:00Z")


def test_the_ephemerides_of_an_object_are_compared_and_the_best_is_taken(capsys, three):
    old, fresh, table = map(str, three)
    sources = ("--elements", old, "--elements", fresh, "--ephemeris", table, *AT)
    assert run(["elements", "compare", "ISS", *sources, *LEIDEN, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["ephemerides"]
    assert [row["source"] for row in rows] == [table, fresh, old]
    assert [row["expected_error_m"] is None for row in rows] == [True, False, False]
    assert rows[1]["expected_error_m"] < 1000.0 < rows[2]["expected_error_m"]
    assert rows[1]["age_days"] == pytest.approx(0.53, abs=0.01)
    # The rows were made of the fresh elements; those of another day are elsewhere on the orbit.
    assert rows[0]["from_best_arcsec"] == 0.0
    assert rows[1]["from_best_arcsec"] < 1.0
    assert rows[2]["from_best_arcsec"] > 3600.0
    assert run(["elements", "compare", "ISS", *sources]) == 0
    assert capsys.readouterr().out.splitlines()[0].startswith(f"{table}: OEM by SGP4")


def named(path, name, designator):
    """Write the rows of the ISS as another program may call it."""
    text = oem_text("2026-10-02T12:50:00Z", 40).replace("NAME = ISS", f"NAME = {name}")
    path.write_text(text.replace("1998-067-A", designator))
    return str(path)


@pytest.mark.parametrize("designator", ["1998-067-A", "98067A", "25544"])
def test_a_file_that_calls_the_object_otherwise_is_compared_by_number_or_designator(
    capsys, three, tmp_path, designator
):
    _, fresh, _ = map(str, three)
    other = named(tmp_path / "other.oem", "STATION 1", designator)
    sources = ("--elements", fresh, "--ephemeris", other, *AT, *LEIDEN)
    assert run(["elements", "compare", "ISS", *sources, "--json"]) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert [(row["source"], row["name"]) for row in found["ephemerides"]] == [
        (other, "STATION 1"),
        (fresh, "ISS"),
    ]
    assert (found["left_out"], printed.err) == ([], "")
    # The other way about: the file has the name, and the elements have its number.
    assert run(["elements", "compare", "station-1", *sources, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == found


def test_a_file_of_one_object_that_nothing_contradicts_is_compared_and_its_name_is_told(
    capsys, three, tmp_path
):
    _, fresh, _ = map(str, three)
    other = named(tmp_path / "other.oem", "TESTSAT", "TESTSAT")
    sources = ("--elements", fresh, "--ephemeris", other, *AT, *LEIDEN)
    assert run(["elements", "compare", "ISS", *sources, "--json"]) == 0
    printed = capsys.readouterr()
    rows = json.loads(printed.out)["ephemerides"]
    assert [row["source"] for row in rows] == [other, fresh]
    assert rows[1]["from_best_arcsec"] < 1.0
    assert printed.err == f"sattrack: {other} calls its one object TESTSAT: compared as ISS\n"
    # What a mount is to follow is not guessed.
    assert run(["ephemeris", "ISS", *sources, *SPAN, "--source", "best"]) == 0
    printed = capsys.readouterr()
    assert f"left out: no object 'ISS' in {other}, which holds TESTSAT" in printed.err
    assert f"using {fresh}" in printed.err


@pytest.mark.parametrize(
    ("designator", "holds"), [("2021-066A", "STATION 1"), ("49044", "STATION 1 (49044)")]
)
def test_a_file_of_another_object_is_left_out_with_the_reason(capsys, three, tmp_path, designator, holds):
    _, fresh, _ = map(str, three)
    other = named(tmp_path / "other.oem", "STATION 1", designator)
    strange = tmp_path / "strange.tle"
    strange.write_text(
        "\n".join(["STRANGER", *(with_checksum(x.replace("25544", "25545")) for x in ISS), ""])
    )
    sources = ("--elements", fresh, "--elements", str(strange), "--ephemeris", other, *AT)
    assert run(["elements", "compare", "ISS", *sources, "--json"]) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert [row["source"] for row in found["ephemerides"]] == [fresh]
    assert found["left_out"] == [
        {"source": other, "reason": f"no object 'ISS' in {other}, which holds {holds}"},
        {"source": str(strange), "reason": f"no ISS (25544) in {strange}"},
    ]
    assert printed.err.splitlines() == [f"sattrack: left out: {one['reason']}" for one in found["left_out"]]
    assert run(["elements", "compare", "nothing", *sources]) == 2
    assert f"no object 'nothing' in {other}, which holds {holds}" in capsys.readouterr().err


def test_elements_whose_catalogue_number_is_the_sic_number_of_a_file_are_left_out(capsys, three, tmp_path):
    _, fresh, _ = map(str, three)
    cpf, stranger = tmp_path / "station.cpf", tmp_path / "stranger.tle"
    cpf.write_text(cpf_text("2026-10-02T12:50:00Z", 40, sic=1155))
    lines = (with_checksum(x.replace("25544", "01155").replace("98067A", "64001A")) for x in ISS)
    stranger.write_text("\n".join(["STRANGER", *lines, ""]))
    sources = ("--ephemeris", str(cpf), "--elements", str(stranger), *AT)
    assert run(["elements", "compare", "1155", *sources, "--elements", fresh, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {row["source"] for row in found["ephemerides"]} == {str(cpf), fresh}
    assert [one["source"] for one in found["left_out"]] == [str(stranger)]
    assert run(["elements", "compare", "1155", *sources]) == 0
    printed = capsys.readouterr()
    assert f"left out: 1155 in {stranger} is STRANGER (1155), not station (25544)" in printed.err
    assert printed.out.startswith(f"{cpf}: CPF 2 by US")


def test_a_file_that_states_no_error_is_said_to_and_that_of_elements_has_a_unit_that_fits(
    capsys, three, tmp_path
):
    old, _, _ = map(str, three)
    cpf = tmp_path / "folder" / "station.cpf"
    cpf.parent.mkdir()
    cpf.write_text(cpf_text("2026-10-02T12:50:00Z", 40))
    sources = ("--elements", old, "--ephemeris", str(cpf), *AT)
    assert run(["elements", "compare", "ISS", *sources, "--json"]) == 0
    stated = [row["expected_error_m"] for row in json.loads(capsys.readouterr().out)["ephemerides"]]
    assert run(["elements", "compare", "ISS", *sources]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert stated[0] is None
    assert lines[0].endswith("CPF 2 by US of 2026-10-02T00h, Lagrange, degree 13, error not stated")
    # Elements of ten days before: kilometres.
    (kilometres,) = re.findall(r"expected error ([0-9.]+) km at ", lines[1])
    assert float(kilometres) == pytest.approx(stated[1] / 1000.0, rel=0.006)
    assert float(kilometres) > 1.0
    span = ("--clock", "2026-10-02T13:02:05Z", "--to", "2026-10-02T13:02:30Z")
    virtual = ("--mount", "sim", "--virtual", *LEIDEN, *span)
    assert run(["track", "ISS", "--ephemeris", str(cpf), *virtual]) == 0
    printed = capsys.readouterr()
    assert "by CPF 2 by US of 2026-10-02T00h, Lagrange, degree 13, error not stated" in printed.err
    (line,) = [line for line in printed.out.splitlines() if line.startswith("  by ")]
    assert line == (
        "  by station.cpf: CPF 2 by US of 2026-10-02T00h, Lagrange, degree 13, 13.1 h old, error not stated"
    )
    assert run(["track", "ISS", "--ephemeris", str(cpf), *virtual, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])["summary"]
    assert (summary["source_file"], summary["expected_error_m"]) == ("station.cpf", None)
    assert summary["source_age_s"] == pytest.approx(13.1 * 3600.0, abs=180.0)


@pytest.mark.parametrize(("word", "taken"), [("best", "fresh.tle"), ("OLD.tle", "old.tle")])
def test_a_source_is_chosen_by_a_word(ask, three, word, taken):
    old, fresh, _ = map(str, three)
    code, _, err = ask("ISS", "--elements", old, "--elements", fresh, *AT, *SPAN, "--source", word)
    assert code == 0
    assert sorted(line.split()[1] for line in err.splitlines()[:2]) == ["not", "using"]
    assert next(line for line in err.splitlines() if "using" in line).split(":")[1].endswith(taken)


def test_of_two_files_the_one_that_has_places_is_taken(ask, three, tmp_path):
    _, _, table = map(str, three)
    ended = tmp_path / "ended.oem"
    ended.write_text(oem_text("2026-10-01T12:50:00Z", 40))
    code, _, err = ask("ISS", "--ephemeris", str(ended), "--ephemeris", table, *AT, *SPAN)
    assert code == 0
    assert f"using {table}" in err
    assert "error not stated, over" in err


def test_two_sources_that_disagree_by_more_than_they_state_are_told(ask, capsys, three, tmp_path):
    _, fresh, table = map(str, three)
    late = tmp_path / "late.oem"
    # A clock that was a minute off: the same rows, each a minute later.
    begun, ended = (f"2026-10-02T{at}:00.000" for at in ("12:51", "13:29"))
    lines = oem_text("2026-10-02T12:50:00Z", 40).splitlines()
    head = next(k for k, line in enumerate(lines) if line == "META_STOP") + 1
    times, places = zip(*(line.split(" ", 1) for line in lines[head:]), strict=True)
    moved = [f"{time} {place}" for time, place in zip(times[1:], places[:-1], strict=True)]
    meta = "\n".join(lines[:head]).replace("T12:50:00.000", "T12:51:00.000")
    late.write_text("\n".join((meta, *moved)) + "\n")
    assert moved[0].startswith(begun)
    assert ended in late.read_text()
    code, _, err = ask("ISS", "--ephemeris", table, "--ephemeris", str(late), *AT, *SPAN)
    assert code == 0
    (warning,) = [line for line in err.splitlines() if "warning" in line]
    assert "late.oem" in warning
    assert re.search(r" 4[56]\d km from where ", warning)
    assert "one of the two is wrong" in warning
    assert run(["elements", "compare", "ISS", "--ephemeris", table, "--ephemeris", str(late), *AT]) == 0
    assert "one of the two is wrong" in capsys.readouterr().err
    code, _, err = ask("ISS", "--ephemeris", table, "--elements", fresh, *AT, *SPAN, "--source", "best")
    assert code == 0
    assert "warning" not in err


def test_the_best_is_that_for_the_pass_and_not_for_now(capsys, three, tmp_path):
    _, fresh, table = map(str, three)
    # Rows that hold now, hours before the pass, and rows that end in the middle of it.
    early, half = tmp_path / "early.oem", tmp_path / "half.oem"
    early.write_text(oem_text("2026-10-02T11:45:00Z", 40))
    half.write_text(oem_text("2026-10-02T12:45:00Z", 20))
    now = ("--clock", "2026-10-02T12:10:00Z", *LEIDEN)
    sources = ("--ephemeris", str(early), "--ephemeris", str(half), "--elements", fresh)
    assert run(["elements", "compare", "ISS", *sources, *now, "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)
    rows = compared["ephemerides"]
    assert compared["utc"].startswith("2026-10-02T13:05:")
    assert [row["source"] for row in rows] == [fresh, str(half), str(early)]
    assert [row["over"] for row in rows] == [False, False, True]
    assert [row["whole_pass"] for row in rows] == [True, False, False]
    virtual = ("--mount", "sim", "--virtual", "--min-alt", "80", "--json")
    assert run(["track", "ISS", *sources, *now, *virtual]) == 0
    printed = capsys.readouterr()
    assert f"using {fresh}" in printed.err
    assert f"not   {early}" in printed.err
    summary = json.loads(printed.out.splitlines()[-1])["summary"]
    assert summary["ended_by"] == "set"
    assert "SGP4" in summary["source"]
    assert summary["source_age_s"] == pytest.approx(0.53 * 86400.0, abs=1000.0)
    assert summary["expected_error_m"] == pytest.approx(rows[0]["expected_error_m"], rel=0.01)
    assert run(["track", "ISS", *sources, "--ephemeris", table, *now, *virtual]) == 0
    printed = capsys.readouterr()
    assert f"using {table}" in printed.err
    summary = json.loads(printed.out.splitlines()[-1])["summary"]
    assert summary["source"].startswith("OEM by SGP4")
    assert summary["source_age_s"] is not None
    assert summary["expected_error_m"] is None


def test_a_source_that_is_none_is_refused_with_what_there_is(ask, three):
    old, *_ = map(str, three)
    code, out, err = ask("ISS", "--elements", old, *SPAN, "--source", "supplemental")
    assert (code, out) == (2, "")
    assert "--source supplemental: none of the ephemerides of ISS is called so" in err
    assert old in err
    code, _, err = ask("nothing", "--elements", old, *SPAN, "--source", "best")
    assert code == 2
    assert "no satellite 'nothing' in the elements" in err


@pytest.fixture
def seen(ask, three, tmp_path):
    """Directions to it from 13:00 on, five seconds apart, in a table whose times count from T0."""
    _, fresh, _ = map(str, three)
    span = ("--from", "2026-10-02T13:00:00Z", "--to", "2026-10-02T13:12:00Z", "--step", "5")
    _, out, _ = ask("ISS", "--elements", fresh, *span, "--json")
    rows = [f"{5 * k},{row['alt_deg']:.9f},{row['az_deg']:.9f}" for k, row in enumerate(json.loads(out))]
    path = tmp_path / "seen.csv"
    path.write_text("\n".join(["# name: ISS", "t_s,alt_deg,az_deg", *rows, ""]))
    return str(path)


T0 = ("--t0", "2026-10-02T13:00:00Z")


def test_a_table_from_t0_is_compared_with_rows_of_absolute_times(capsys, three, seen):
    _, fresh, table = map(str, three)
    sources = ("--ephemeris", table, "--ephemeris", seen, "--elements", fresh, *AT, *LEIDEN)
    assert run(["elements", "compare", "ISS", *sources, *T0, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["ephemerides"]
    assert {row["source"] for row in rows} == {table, seen, fresh}
    assert all(row["from_best_arcsec"] < 1.0 for row in rows)
    assert run(["passes", "ISS", *sources, *T0, "--source", "seen", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)
    assert one["max_alt_deg"] == pytest.approx(81.27, abs=0.01)
    assert run(["passes", "ISS", *sources]) == 2
    assert "seen.csv:2: its times count from T0" in capsys.readouterr().err
    high = ("--mount", "sim", "--virtual", "--min-alt", "80", "--json", "--source", "seen")
    assert run(["track", "ISS", *sources, *T0, *high]) == 0
    printed = capsys.readouterr()
    assert f"not   {table}" in printed.err
    assert json.loads(printed.out.splitlines()[-1])["summary"]["source"].startswith("table of alt_deg")


def test_t0_is_refused_where_no_file_counts_from_it(ask, three, tmp_path):
    _, _, table = map(str, three)
    other = tmp_path / "other.oem"
    other.write_text(oem_text("2026-10-02T12:50:00Z", 40))
    code, _, err = ask("ISS", "--ephemeris", table, "--ephemeris", str(other), *T0, *SPAN)
    assert code == 2
    assert "rows.oem:1: its times are absolute: --t0 goes with a table" in err


def test_a_file_that_names_an_object_otherwise_is_found_by_its_designator(ask, capsys, three, tmp_path):
    _, fresh, table = map(str, three)
    other = tmp_path / "other.oem"
    other.write_text(oem_text("2026-10-02T12:50:00Z", 40).replace("OBJECT_NAME = ISS", "OBJECT_NAME = ZARYA"))
    # An OEM has no catalogue number, and of the elements' name it need know nothing.
    sources = ("--ephemeris", table, "--ephemeris", str(other), "--elements", fresh, *AT)
    for key in ("25544", "ISS", "1998-067A"):
        assert run(["elements", "compare", key, *sources, "--json"]) == 0
        rows = json.loads(capsys.readouterr().out)["ephemerides"]
        assert {row["source"] for row in rows} == {table, str(other), fresh}, key


def test_a_file_without_the_object_is_named(ask, three, tmp_path):
    _, _, table = map(str, three)
    other = tmp_path / "other.oem"
    text = oem_text("2026-10-02T12:50:00Z", 40).replace("OBJECT_NAME = ISS", "OBJECT_NAME = HST")
    other.write_text(text.replace("1998-067-A", "1990-037-B"))
    code, _, err = ask("ISS", "--ephemeris", table, "--ephemeris", str(other), *AT, *SPAN)
    assert code == 0
    assert f"left out: no object 'ISS' in {other}, which holds HST" in err


def test_each_target_may_be_in_a_file_of_its_own(capsys, three, tmp_path):
    _, _, table = map(str, three)
    other = tmp_path / "other.oem"
    text = oem_text("2026-10-02T12:50:00Z", 40).replace("OBJECT_NAME = ISS", "OBJECT_NAME = HST")
    other.write_text(text.replace("1998-067-A", "1990-037-B"))
    files = ("--ephemeris", table, "--ephemeris", str(other))
    assert run(["passes", "ISS", "HST", *files, *AT, *LEIDEN, "--json"]) == 0
    printed = capsys.readouterr()
    assert {one["name"] for one in json.loads(printed.out)} == {"ISS", "HST"}
    assert "left out" not in printed.err

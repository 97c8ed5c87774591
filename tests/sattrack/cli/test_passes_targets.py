"""`sattrack passes` of an ephemeris file and of bodies: SGP4's own passes, and skyfield's risings."""

from __future__ import annotations

import json
from importlib import resources

import pytest
from ephemeris_files import ISS, oem_text

from sattrack.cli.main import run
from tle.instants import Utc

LEIDEN = ("--site", "52.1541,4.4908,0")


def passes(capsys, *arguments):
    assert run(["passes", *arguments, *LEIDEN, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_passes_of_rows_are_those_of_the_elements_that_made_them(capsys, tmp_path):
    sets, oem = tmp_path / "sets.tle", tmp_path / "iss.oem"
    sets.write_text("\n".join(["ISS", *ISS, ""]))
    # From within a pass to within another one.
    oem.write_text(oem_text("2026-10-02T13:04:00Z", 361, 60.0))
    begin = ("--from", "2026-10-02T13:04:00Z", "--hours", "24")
    rows = passes(capsys, "ISS", "--ephemeris", str(oem), "--judged", *begin)
    others = passes(capsys, "ISS", "--elements", str(sets), "--judged", *begin)[: len(rows)]
    assert len(rows) == 3
    for row, other in zip(rows, others, strict=True):
        assert list(row) == list(other)
        for name in ("rise_utc", "culminate_utc", "set_utc", "sunlit_from_utc", "sunlit_to_utc"):
            ends = [None if one[name] is None else float(Utc.parse(one[name]).unix_s) for one in (row, other)]
            assert ends[0] == pytest.approx(ends[1], abs=0.02)
        for name in (
            "max_alt_deg",
            "peak_ha_rate_deg_s",
            "min_sun_separation_deg",
            "min_moon_separation_deg",
        ):
            assert row[name] == pytest.approx(other[name], abs=1e-3)
        assert row["feasible"] is other["feasible"]


def test_a_pass_cut_by_the_end_of_the_rows_has_no_set(capsys, tmp_path):
    oem = tmp_path / "iss.oem"
    oem.write_text(oem_text("2026-10-02T12:50:00Z", 16, 60.0))
    (row,) = passes(capsys, "ISS", "--ephemeris", str(oem), "--judged", "--from", "2026-10-02T12:00:00Z")
    assert row["rise_utc"].startswith("2026-10-02T13:01:59")
    assert row["set_utc"] is None
    assert row["sunlit_to_utc"] == "2026-10-02T13:06:00.000000Z"
    assert row["catalog_number"] is None
    code = run(["passes", "ISS", "--ephemeris", str(oem), *LEIDEN, "--from", "2026-10-03T00:00:00Z"])
    assert code == 1
    assert "is from 2026-10-02T12:50:00.000Z to 2026-10-02T13:06:00.000Z" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "key"), [("Moon", "moon"), ("Jupiter", "jupiter barycenter")])
def test_bodies_rise_and_set_when_skyfield_has_them_do_so(capsys, name, key):
    from skyfield import almanac
    from skyfield.api import load, wgs84
    from skyfield.jpllib import SpiceKernel

    rows = passes(capsys, name, "--from", "2026-03-01T12:00:00Z", "--hours", "30", "--min-alt", "10")
    kernel = SpiceKernel(str(resources.files("skyfield_data") / "data" / "de421.bsp"))
    scale = load.timescale(builtin=True)
    where = kernel["earth"] + wgs84.latlon(52.1541, 4.4908)
    span = scale.utc(2026, 3, 1, 12), scale.utc(2026, 3, 2, 18)
    for word, find in (("rise_utc", almanac.find_risings), ("set_utc", almanac.find_settings)):
        times, _ = find(where, kernel[key], *span, horizon_degrees=10.0)
        expected = [float(Utc.parse(text).unix_s) for text in times.utc_iso()]
        found = [float(Utc.parse(row[word]).unix_s) for row in rows if row[word] is not None]
        # skyfield's are of the apparent place, to the second; aberration is up to 20″.
        assert found == pytest.approx(expected, abs=4.0)
        assert found
    kernel.close()
    assert rows[0]["catalog_number"] is None
    assert rows[0]["elements_epoch"] is None


def test_transits_are_listed_with_time_length_and_strip(capsys, tmp_path):
    sets = tmp_path / "sets.tle"
    sets.write_text("\n".join(["ISS (ZARYA)", *ISS, ""]))
    arguments = ["passes", "ISS", "--elements", str(sets), *LEIDEN, "--transits"]
    span = ["--from", "2026-10-02T00:00:00Z", "--hours", "360"]
    assert run([*arguments, *span, "--json"]) == 0
    shown = capsys.readouterr()
    rows = json.loads(shown.out)
    assert {row["body"] for row in rows} == {"Sun", "Moon"}
    for row in rows:
        assert row["name"] == "ISS (ZARYA)"
        assert row["begin_utc"] < row["utc"] < row["end_utc"]
        assert 0.0 < row["duration_s"] < 3.0
        assert 2.0 * row["separation_deg"] < row["body_diameter_deg"] < 0.57
        assert row["path_centre_km"] < 0.5 * row["path_width_km"] + 1.0
    assert "look at the Sun through a solar filter only" in shown.err
    assert run([*arguments, *span]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1 + 2 * len(rows)
    assert run([*arguments, *span, "--format", "ics"]) == 2
    assert "printed as a table or as json" in capsys.readouterr().err


def test_events_of_what_has_no_number_have_uids_of_their_own_in_every_run(capsys):
    # Two culminate in the same second; two are still rising when the search ends.
    names = ("83.6,22", "83.6,22.001", "Altair", "Deneb")
    runs = []
    for begin in ("2026-10-02T18:12:40Z", "2026-10-02T18:13:41Z"):
        assert run(["passes", *names, *LEIDEN, "--from", begin, "--format", "ics"]) == 0
        lines = capsys.readouterr().out.replace("\r\n ", "").splitlines()
        runs.append([line for line in lines if line.startswith("UID:")])
    assert len(runs[0]) == len(set(runs[0])) == 6
    assert runs[0] == runs[1]

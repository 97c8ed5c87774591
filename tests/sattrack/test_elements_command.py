from __future__ import annotations

import json
from pathlib import Path

import pytest

from sattrack import cli
from tle.bias import Bias
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site

# CelesTrak, 2026-10-02 and 2026-05-30.
ISS = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
TDRS3 = (
    "1 19548U 88091B   26150.42208977 -.00000296  00000+0  00000+0 0  9992",
    "2 19548  12.6156 341.1225 0039238 356.7275  12.9243  1.00281048125214",
)
AT = Utc.parse("2026-10-02T13:05:24Z")
SITE = "52.1541,4.4908,0"


@pytest.fixture
def ask(capsys):
    def asked(*arguments):
        code = cli.run(["elements", *map(str, arguments)])
        told = capsys.readouterr()
        return code, told.out, told.err

    return asked


@pytest.fixture
def sets(tmp_path):
    path = tmp_path / "sets.tle"
    path.write_text("\n".join(["ISS (ZARYA)", *ISS, "TDRS 3", *TDRS3, ""]))
    return path


@pytest.fixture
def bad(tmp_path):
    path = tmp_path / "bad.tle"
    path.write_text("\n".join(["ISS (ZARYA)", ISS[0][:-1] + "3", ISS[1], "TDRS 3", *TDRS3, ""]))
    return path


@pytest.fixture
def observations(tmp_path):
    seen = Propagator(Elements.from_tle(*ISS), Site.parse(SITE), Bias(1.5, -0.02), place="astrometric").at(AT)
    path = tmp_path / "night.csv"
    path.write_text(
        "utc,ra_deg,dec_deg,object\n"
        f"{AT.isoformat()},{seen.ra_deg!r},{seen.dec_deg!r},ISS\n"
        f"{AT.isoformat()},{seen.ra_deg!r},{seen.dec_deg!r},HST\n"
    )
    return path


def test_check_accepts_sound_sets(ask, sets):
    assert ask("check", sets) == (0, "2 accepted, 0 rejected\n", "")
    code, out, _ = ask("check", "--elements", sets, "--json")
    assert (code, json.loads(out)) == (0, {"accepted": 2, "rejected": []})


def test_check_tells_what_is_refused(ask, bad):
    code, out, _ = ask("check", bad, "--json")
    assert code == 2
    document = json.loads(out)
    assert document["accepted"] == 1
    (refused,) = document["rejected"]
    assert (refused["line"], refused["name"], refused["catalog_number"]) == (2, "ISS (ZARYA)", 25544)
    assert "checksum is 3 but its columns add up to 2" in refused["reason"]
    code, out, _ = ask("check", bad)
    assert code == 2
    assert "bad.tle:2: line 1, checksum is 3" in out
    assert out.endswith("1 accepted, 1 rejected\n")


def test_check_lists_residuals(ask, sets, observations):
    code, out, _ = ask("check", sets, "--observations", observations, "--site", SITE, "--json")
    assert code == 0
    good, unknown = json.loads(out)["residuals"]
    assert (good["catalog_number"], good["name"], good["line"]) == (25544, "ISS (ZARYA)", 2)
    assert good["along_s"] == pytest.approx(1.5, abs=1e-6)
    assert good["cross_arcsec"] == pytest.approx(-72.0, abs=1e-3)
    assert good["separation_arcsec"] > 3600.0
    assert good["reason"] is None
    assert unknown["along_s"] is None
    assert "no satellite 'HST'" in unknown["reason"]
    code, out, _ = ask("check", sets, "--observations", observations, "--site", SITE)
    assert "+1.5000 s" in out
    assert "-72.00″" in out


def test_the_example_shows_no_bias(ask):
    examples = Path(__file__).resolve().parents[2] / "examples"
    code, out, _ = ask(
        "check", examples / "iss_leiden.tle", "--observations", examples / "iss_observations.csv", "--json"
    )
    residuals = json.loads(out)["residuals"]
    assert code == 0
    assert len(residuals) == 5
    assert all(row["separation_arcsec"] < 0.05 for row in residuals)
    assert all(abs(row["along_s"]) < 1e-4 for row in residuals)


def test_check_needs_to_know_where(ask, sets, observations):
    code, out, err = ask("check", sets, "--observations", observations)
    assert (code, out) == (2, "")
    assert "night.csv:2: no station is named" in err


def test_show(ask, sets):
    code, out, _ = ask("show", "--elements", sets)
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == ["number", "25544", "19548"]
    code, out, _ = ask("show", "TDRS", "--elements", sets, "--json", "--clock", "2026-05-31T00:00:00Z")
    (row,) = json.loads(out)
    assert (row["catalog_number"], row["designator"]) == (19548, "1988-091B")
    assert row["age_days"] == pytest.approx(0.57791023, abs=1e-6)


def test_bad_input(ask, tmp_path, sets):
    for arguments, words in (
        (("check", tmp_path / "none"), "cannot read elements"),
        (("check",), "no elements: name a file"),
        (("show", "HST", "--elements", sets), "no satellite 'HST'"),
        (("check", sets, "--observations", tmp_path / "none"), "cannot read observations"),
    ):
        code, out, err = ask(*arguments)
        assert (code, out) == (2, ""), arguments
        assert words in err
        assert err.count("\n") == 1

from __future__ import annotations

import csv
import io
import json
import math

import pytest

from sattrack.cli.main import run
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site

# CelesTrak, 2026-10-02; and of the SGP4 verification set (Vallado et al. 2006), a satellite that decays.
ISS = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
DECAYING = (
    "1 29141U 85108AA  06170.26783845  .99999999  00000-0  13519-0 0   718",
    "2 29141  82.4288 273.4882 0015848 277.2124  83.9133 15.93343074  6828",
)
LEIDEN = "52.1541,4.4908,0"
# Rows of a reference track made with sgp4, ERFA and IERS data: apparent RA and Dec (°), and their rates (RA's
# times cos Dec, arcsec/s).
TRACK = {
    "2026-10-02T13:01:06.000000Z": (130.628333027, -1.012519893, 203.989949278, 219.664620010),
    "2026-10-02T13:01:07.000000Z": (130.685137383, -0.951375859, 204.943085739, 220.574031294),
}
NAMES = [
    "utc",
    "ra_deg",
    "dec_deg",
    "ra_rate_deg_s",
    "dec_rate_deg_s",
    "ha_deg",
    "ha_rate_deg_s",
    "alt_deg",
    "az_deg",
    "alt_rate_deg_s",
    "az_rate_deg_s",
    "range_km",
    "range_rate_km_s",
    "sunlit",
]


@pytest.fixture
def elements(tmp_path):
    path = tmp_path / "sets.tle"
    path.write_text("\n".join(["ISS (ZARYA)", *ISS, "SL-14 DEB", *DECAYING, ""]))
    return str(path)


@pytest.fixture
def ask(elements, capsys):
    """Run the command for the ISS over Leiden; give the exit code, standard output and standard error."""

    def asked(
        *options, satellite="ISS", site=LEIDEN, start="2026-10-02T13:01:06Z", stop="2026-10-02T13:01:07Z"
    ):
        arguments = ["ephemeris", satellite, "--elements", elements, "--from", start, "--to", stop]
        code = run([*arguments, "--site", site, "--step", "1", *options])
        told = capsys.readouterr()
        return code, told.out, told.err

    return asked


def test_json_has_the_directions_of_the_reference_track(ask):
    code, out, err = ask("--json")
    assert (code, err) == (0, "")
    rows = json.loads(out)
    assert [list(row) for row in rows] == [NAMES, NAMES]
    for row in rows:
        ra_deg, dec_deg, east_rate, dec_rate = TRACK[row["utc"]]
        assert row["ra_deg"] == pytest.approx(ra_deg, abs=0.1 / 3600.0)
        assert row["dec_deg"] == pytest.approx(dec_deg, abs=0.1 / 3600.0)
        across = math.cos(math.radians(dec_deg))
        assert row["ra_rate_deg_s"] * 3600.0 * across == pytest.approx(east_rate, abs=0.05)
        assert row["dec_rate_deg_s"] * 3600.0 == pytest.approx(dec_rate, abs=0.05)
        assert row["sunlit"] is True


def test_the_formats_agree(ask):
    rows = json.loads(ask("--format", "json")[1])
    table = list(csv.DictReader(io.StringIO(ask("--format", "csv")[1])))
    assert [list(row) for row in table] == [NAMES, NAMES]
    for row, cells in zip(rows, table, strict=True):
        assert {k: str(v).lower() if k == "sunlit" else str(v) for k, v in row.items()} == dict(cells)
    code, out, err = ask()
    assert (code, err) == (0, "")
    head, day, first, _ = out.splitlines()
    assert head.split()[:2] == ["Time", "RA"]
    assert day == "Fri 2 Oct 2026, UTC"
    assert first.split()[:3] == ["13:01:06.000", "130.628333", "-1.012520"]
    assert first.split()[-1] == "lit"


def test_the_table_is_in_local_time_with_a_line_for_each_day(ask, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sattrack.toml").write_text('zone = "Asia/Kathmandu"\n')
    midnight = ("--from", "2026-10-02T18:14:30Z", "--to", "2026-10-02T18:15:00Z", "--step", "30")
    _, before, first, after, second = ask(*midnight)[1].splitlines()
    assert (before[:14], first[:8]) == ("Fri 2 Oct 2026", "23:59:30")
    assert (after[:14], second[:8]) == ("Sat 3 Oct 2026", "00:00:00")
    assert ask(*midnight, "--utc")[1].splitlines()[2].startswith("18:14:30.000 ")


@pytest.mark.parametrize(
    ("options", "given"),
    [
        (("--place", "geometric"), {"place": "geometric"}),
        (("--place", "astrometric"), {"place": "astrometric"}),
        (("--no-diurnal-aberration",), {"diurnal_aberration": False}),
    ],
)
def test_options_reach_the_propagator(ask, options, given):
    row = json.loads(ask("--json", *options)[1])[0]
    seen = Propagator(Elements.from_tle(*ISS), Site.parse(LEIDEN), **given).at(Utc.parse(row["utc"]))
    assert (row["ra_deg"], row["dec_deg"]) == pytest.approx((seen.ra_deg, seen.dec_deg), abs=1e-9)


def test_biases_and_air(ask):
    plain, later, left, raised, thin = (
        json.loads(ask("--json", *options)[1])[0]
        for options in (
            (),
            ("--bias-along", "1"),
            ("--bias-cross", "0.5"),
            ("--refraction", "--pressure", "1010", "--temperature", "10"),
            ("--refraction", "--pressure", "505", "--temperature", "10"),
        )
    )
    # A second of bias moves the satellite alone, which is nearly what a second of time does.
    assert later["alt_deg"] == pytest.approx(plain["alt_deg"] + plain["alt_rate_deg_s"], abs=0.01)
    assert left["range_km"] == plain["range_km"]
    assert abs(left["alt_deg"] - plain["alt_deg"]) + abs(left["az_deg"] - plain["az_deg"]) > 0.4
    assert (raised["alt_deg"] - plain["alt_deg"]) * 60.0 == pytest.approx(9.8, abs=0.4)
    assert thin["alt_deg"] - plain["alt_deg"] < 0.52 * (raised["alt_deg"] - plain["alt_deg"])


def test_a_decayed_satellite_is_null_and_told(ask):
    code, out, err = ask(
        "--json", satellite="29141", start="2006-06-19T13:20:00Z", stop="2006-06-19T13:35:00Z"
    )
    rows = json.loads(out)
    lost = [row for row in rows if row["ra_deg"] is None]
    assert code == 0
    assert 0 < len(lost) < len(rows)
    assert all(value is None for row in lost for name, value in row.items() if name != "utc")
    assert f"{len(lost)} of {len(rows)} instants have no position (SGP4 error 6" in err
    code, out, err = ask(satellite="29141", start="2006-06-19T14:00:00Z", stop="2006-06-19T14:01:00Z")
    assert (code, out) == (1, "")
    assert err.startswith("sattrack: SL-14 DEB (29141) has decayed")


@pytest.mark.parametrize(
    ("changed", "options", "words"),
    [
        ({"start": "yesterday"}, (), "'yesterday' is no time"),
        ({"stop": "2026-10-02T13:00:00Z"}, (), "is before"),
        ({"start": "1950-01-01", "stop": "1950-01-01"}, (), "outside the time"),
        ({"site": "95,0,0"}, (), "latitude of 95.0 is outside"),
        ({"site": "here"}, (), "'here' is no site"),
        ({"satellite": "HST"}, (), "no satellite 'HST'"),
        ({}, ("--bias-cross", "100"), "beyond 90°"),
        ({}, ("--pressure", "1000"), "need --refraction"),
        ({}, ("--refraction", "--pressure", "5000"), "outside 0 to 1200 hPa"),
        ({}, ("--refraction", "--place", "astrometric"), "knows no air"),
    ],
)
def test_bad_input_ends_with_2_and_one_line(ask, changed, options, words):
    code, out, err = ask(*options, **changed)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_old_elements_and_orientation_beyond_its_table_are_told(ask):
    # After the IERS table of today, yet within what these elements bear. It is told once a process.
    EarthOrientation.installed.cache_clear()
    code, out, err = ask("--json", start="2030-10-02", stop="2030-10-02T00:00:01Z")
    assert code == 0
    assert len(json.loads(out)) == 2
    warning, age = err.splitlines()
    assert warning.startswith("sattrack: warning: Earth orientation is extrapolated: the table ends at")
    assert age.startswith("sattrack: elements of ISS (ZARYA) are 1461.0 days old at the first instant")


def test_plots(ask, tmp_path):
    path = tmp_path / "sky.png"
    assert ask("--plot", str(path))[0] == 0
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    code, _, err = ask("--plot", str(tmp_path / "sky.xyz"))
    assert code == 2
    assert "its ending is unknown" in err

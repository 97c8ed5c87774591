"""`sattrack star-run` as a user types it: stars from a file, and everything that must be refused unmoved."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import erfa
import numpy as np
import pytest
from strangers.tilted_mount import TiltedMount, local

from sattrack.cli import star_run
from sattrack.cli.main import run
from sattrack.cli.star_run import _keeper
from sattrack.core.errors import LinkLostError, SafetyLimitError, SattrackError
from sattrack.mount.geometry import Pole
from sattrack.mount.model import MountProfile
from sattrack.mount.profiles import load_profile_file
from sattrack.pointing.files import RunParameters, observed, read_stars
from sattrack.pointing.fit import Star
from sattrack.pointing.terms import PointingModel
from sattrack.pointing.tour import units
from sattrack.runtime.facts import pointing_of
from sattrack.runtime.star_run import RunSky
from sattrack.runtime.system import utc_now
from sattrack.safety import SafetyLimits
from tle.refraction import Refraction
from tle.site import Site

SITE = "52.0,4.5,0"
MOUNT = TiltedMount(52.0, 3000.0, -2000.0, 400.0, 60.0, 500.0, -300.0, 20.0)


def sexagesimal(value: float) -> str:
    whole, rest = divmod(abs(value) * 3600.0, 3600.0)
    minutes, seconds = divmod(rest, 60.0)
    return f"{'-' if value < 0 else '+'}{whole:02.0f} {minutes:02.0f} {min(seconds, 59.9999):08.5f}"


@pytest.fixture(scope="module")
def stars() -> str:
    """Return a file of stars of a stranger's mount, seen through no air, by ERFA."""
    rng = np.random.default_rng(2)
    first, second = erfa.cal2jd(2026, 11, 22)
    lines = ["a stranger's run", ":EQUAT", ":NODA", " 52 00 00.0 2026 11 22 10 0 0"]
    while len(lines) < 20:
        lst, ra, dec = rng.uniform(0.0, 24.0), rng.uniform(0.0, 24.0), rng.uniform(-20.0, 80.0)
        longitude = math.radians(15.0 * lst) - erfa.gst06a(first, second + 0.5, first, second + 0.5)
        _, zenith, h, d, *_ = erfa.atco13(
            math.radians(15.0 * ra), math.radians(dec), 0, 0, 0, 0, first, second + 0.5, 0.0,
            longitude, math.radians(52.0), 0.0, 0, 0, 0, 0, 0, 0.55,
        )  # fmt: skip
        if zenith > math.radians(65.0):
            continue
        place = math.degrees(h), math.degrees(d)
        axes = MOUNT.stands(local(*place, 52.0), place) + rng.normal(0.0, 2.0 / 3600.0, 2)
        mount_ra = (lst - axes[0] / 15.0) % 24.0
        hours = int(lst)
        lines.append(
            f" {sexagesimal(ra)[1:]} {sexagesimal(dec)} 0 0 2000.0 {sexagesimal(mount_ra)[1:]} "
            f"{sexagesimal(axes[1])} {hours:02d} {(lst - hours) * 60.0:.7f}"
        )
    return "\n".join([*lines, "END", ""])


def ran(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> tuple[str, str]:
    assert run(["star-run", "--site", SITE, "--mount", "sim", *words]) == code
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out, err


@pytest.fixture
def modelled(stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A profile with the model of these stars."""
    data, profile = tmp_path / "run.dat", tmp_path / "mine.toml"
    data.write_text(stars)
    ran(capsys, "--fit-only", "--data", str(data), "--output", str(profile))
    return profile


def test_stars_in_a_file_become_a_model_in_the_profile(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, profile, model, picture = (
        tmp_path / name for name in ("run.dat", "mine.toml", "tp.dat", "sky.png")
    )
    data.write_text(stars)
    words = ["--fit-only", "--data", str(data), "--output", str(profile), "--model", str(model)]
    out, _ = ran(capsys, *words, "--json")
    document: dict[str, Any] = json.loads(out)
    found = document["model"]
    assert {"terms", "rms_arcsec", "held_out_rms_arcsec", "stars"} <= set(found)
    assert found["stars"] == 16
    truth = {"ME": -3000.0, "MA": 2000.0, "CH": -400.0, "NP": -60.0, "IH": -500.0, "ID": 300.0, "TF": 20.0}
    for name, value in truth.items():
        term = found["terms"][name]
        assert abs(term["arcsec"] - value) < 4.0 * term["sigma_arcsec"]
    assert found["rms_arcsec"] < 5.0
    kept = load_profile_file(profile)
    assert kept.pointing is not None
    assert kept.pointing.terms["ME"][0] == found["terms"]["ME"]["arcsec"]
    assert kept.sky is not None
    assert kept.sky.mount["cone_deg"][0] == 0.0
    axes = PointingModel.of(kept.pointing).axes_of(20.0, 30.0)
    assert MOUNT.looks(*axes) == pytest.approx(local(20.0, 30.0, 52.0), abs=5.0 / 206264.8)
    assert model.read_text().rstrip().endswith("END")
    pytest.importorskip("matplotlib")
    ran(capsys, *words, "--plot", str(picture), "--force")
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("cut", [-4 - 30, -4 - 1])
def test_a_file_that_was_cut_off_in_a_line_gives_the_whole_ones(
    cut: int, stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A number that lost its last digits would be read as another one."""
    data = tmp_path / "run.dat"
    data.write_text(stars[:cut])
    out, err = ran(capsys, "--fit-only", "--data", str(data), "--json")
    assert json.loads(out)["model"]["stars"] == 15
    assert "last line has no end" in err
    assert f"kept in no profile: `sattrack star-run --fit-only --data {data}` with --profile FILE" in err


def test_a_bump_is_found_in_a_file_too(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """After the eighth star the declination axis shows 3′ more."""
    lines = stars.splitlines()
    for number in range(12, 20):
        words = lines[number].split()
        degrees = float(words[12]) + math.copysign(float(words[13]) / 60.0, float(words[12])) + 0.05
        degrees += math.copysign(float(words[14]) / 3600.0, float(words[12]))
        lines[number] = " ".join([*words[:12], *sexagesimal(degrees).split(), *words[15:]])
    data = tmp_path / "run.dat"
    data.write_text("\n".join([*lines, ""]))
    out, err = ran(capsys, "--fit-only", "--data", str(data), "--json")
    assert "the mount was moved before star 9, by 1" in err
    assert json.loads(out)["model"]["stars"] == 8


@pytest.mark.parametrize("option", ["--model", "--output"])
def test_the_stars_are_never_overwritten_by_what_is_made_of_them(
    option: str, stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "run.dat"
    data.write_text(stars)
    _, err = ran(capsys, "--fit-only", "--data", str(data), option, str(data), "--force", code=2)
    assert option in err
    assert data.read_text() == stars


def test_a_model_is_verified_at_places_that_were_not_measured() -> None:
    sky = RunSky(Site(52.0, 4.5, 0.0), MountProfile(), SafetyLimits())
    places = sky.grid()
    fitted, verified = (
        units(places[one.tour(places, count, [], (0.0, 50.0))])
        for one, count in ((sky, 12), (sky.beside(12), 6))
    )
    nearest_deg = np.degrees(np.arccos(np.max(verified @ fitted.T, axis=1)))
    # Twelve caps that hold the sky above 20° have a radius of 19° at least.
    assert nearest_deg.min() > 12.0


def test_another_sites_stars_are_refused(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "run.dat"
    data.write_text(stars)
    _, err = ran(capsys, "--fit-only", "--data", str(data), "--site", "31,4.5,0", code=2)
    assert "another mount's" in err


def test_a_star_of_a_later_night_stands_where_it_was_by_the_date_of_its_file(
    stars: str, tmp_path: Path
) -> None:
    """The sky has turned since: by the date of the file a star of today is many seconds of arc elsewhere."""
    data = tmp_path / "run.dat"
    data.write_text(stars.replace("2026 11 22 10 0 0", "2024 03 01 10 1000 0").replace("END\n", ""))
    site = Site(52.0, 4.5, 0.0)
    _, known = read_stars(data.read_text(), "run.dat")
    sky = RunSky(site, MountProfile(), SafetyLimits(), Refraction.standard(0.0))
    keep = _keeper({"data": data, "verify": False}, sky, known)
    now = RunParameters(52.0, utc_now()[:10], 10.0, 1000.0, 0.0)
    for ra, dec, sidereal in ((100.0, 40.0, 130.0), (30.0, 88.9, 50.0), (200.0, -10.0, 215.0)):
        keep(Star(*observed(ra, dec, sidereal, now), sidereal - ra, dec, (ra, dec), sidereal))
        after = read_stars(data.read_text(), "run.dat")[1][-1]
        assert after[:2] == pytest.approx(observed(ra, dec, sidereal, now), abs=0.02 / 3600.0)
        assert after[2:4] == pytest.approx((sidereal - ra, dec), abs=1e-6)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ([], "give --camera SOURCE, or --by-hand"),
        (["--camera", "folder:.", "--by-hand"], "give --camera SOURCE, or --by-hand"),
        (["--by-hand"], "no terminal"),
        (["--camera", "folder:.", "--stars", "0"], "--stars 0"),
        (["--camera", "folder:.", "--until", "-3"], "--until -3"),
        (["--camera", "folder:.", "--verify"], "has no pointing model"),
        (["--camera", "folder:.", "--continue", "--data", "no.dat"], "no such file"),
        (["--camera", "folder:.", "--output", "no/where.toml"], "--output no/where.toml: there is no folder"),
        (["--camera", "folder:.", "--data", "no/stars.dat"], "--data no/stars.dat: there is no folder"),
        (["--fit-only", "--data", "no.dat"], "no such file"),
        (["--camera", "folder:.", "--model", "no/m.dat"], "--model no/m.dat"),
        (["--camera", "folder:.", "--plot", "sky.xyz"], "--plot sky.xyz"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_moves(
    words: list[str],
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert text in ran(capsys, *words, code=2)[1]


@pytest.mark.parametrize("closed", ["star-run.dat", "new.toml", "mine.toml"])
def test_a_file_that_it_could_not_write_is_told_before_anything_moves(
    closed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("star-run.dat", "new.toml", "mine.toml"):
        (tmp_path / name).write_text("")
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK or Path(path).name != closed)
    words = ["--camera", "folder:.", "--force", "--profile", "mine.toml"]
    words += ["--output", "new.toml"] if closed == "new.toml" else []
    assert f"{closed}: Permission denied" in ran(capsys, *words, code=1)[1]


def test_stars_that_are_there_are_not_lost(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "run.dat"
    data.write_text(stars)
    _, err = ran(capsys, "--camera", "folder:.", "--data", str(data), code=2)
    assert "--continue" in err
    assert "--force" in err
    assert data.read_text() == stars
    # Not even by --force, before the first star of the new run.
    away = ["--mount", "xerxes://127.0.0.1:9?listen=15998"]
    _, err = ran(capsys, "--camera", "folder:.", "--data", str(data), "--force", *away, code=2)
    assert "no consent" in err
    assert data.read_text() == stars


def test_a_profile_saved_with_a_byte_order_mark_is_updated_as_any_other(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As Windows' Notepad saves it."""
    data, profile = tmp_path / "run.dat", tmp_path / "mine.toml"
    data.write_text(stars)
    profile.write_text("\ufeff# mine\nwatchdog_s = 7.0 # seen\n", encoding="utf-8")
    ran(capsys, "--fit-only", "--data", str(data), "--profile", str(profile))
    assert load_profile_file(profile).pointing is not None
    assert profile.read_text(encoding="utf-8").startswith("# mine\nwatchdog_s = 7.0 # seen\n")


@pytest.mark.parametrize(
    ("trouble", "code"), [(None, 0), (LinkLostError("no status from sim"), 4), (SafetyLimitError("low"), 3)]
)
def test_stars_of_a_run_that_was_cut_short_verify_a_model_and_its_end_is_told(
    trouble: SattrackError | None,
    code: int,
    stars: str,
    modelled: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    seen = SimpleNamespace(stars=read_stars(stars, "run.dat")[1][:3], trouble=trouble)
    monkeypatch.setattr(star_run, "_ran", lambda *_: seen)
    out, err = ran(capsys, "--verify", "--camera", "folder:.", "--profile", str(modelled), code=code)
    assert "3 other stars: missed by " in out
    assert ("3 stars were compared" in err) is (trouble is not None)


@pytest.mark.parametrize(("measured", "kept"), [(2, True), (12, False)])
def test_a_run_that_was_cut_short_after_a_few_stars_leaves_a_better_model_alone(
    measured: int,
    kept: bool,
    stars: str,
    modelled: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before, mount = modelled.read_text(), load_profile_file(modelled)
    seen = read_stars(stars, "run.dat")[1][:measured]
    cut = SimpleNamespace(
        stars=seen,
        counting=seen,
        trouble=LinkLostError("no status from sim"),
        sky=SimpleNamespace(profile=mount.mount),
    )
    monkeypatch.setattr(star_run, "_ran", lambda *_: cut)
    again = ["--data", str(modelled.with_name("new.dat")), "--profile", str(modelled)]
    _, err = ran(capsys, "--camera", "folder:.", *again, code=4)
    assert (modelled.read_text() == before) is kept
    assert ("2 are too few for another; --continue goes on" in err) is kept


def test_limits_that_somebody_tightens_while_it_runs_stay(
    stars: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text("hour_angle_limit_deg = 100.0\n")
    seen = read_stars(stars, "run.dat")[1]

    def ran_while_somebody_edits(*_: Any) -> SimpleNamespace:
        profile.write_text("hour_angle_limit_deg = 80.0 # the new cable\n")
        sky = SimpleNamespace(profile=MountProfile(hour_angle_limit_deg=100.0))
        return SimpleNamespace(stars=seen, counting=seen, trouble=None, sky=sky)

    monkeypatch.setattr(star_run, "_ran", ran_while_somebody_edits)
    ran(capsys, "--camera", "folder:.", "--data", str(tmp_path / "new.dat"), "--profile", str(profile))
    assert "hour_angle_limit_deg = 80.0 # the new cable\n" in profile.read_text()
    pointing = load_profile_file(profile).pointing
    assert pointing is not None
    assert pointing.stars == len(seen)


def test_a_model_of_another_latitude_feeds_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = tmp_path / "other.toml"
    profile.write_text(
        'name = "other"\n[pointing]\nutc = "2026-11-22T00:00:00Z"\nlatitude_deg = -30.0\nrms_arcsec = 2.0\n'
        'stars = 12\nsigns = "tpoint"\n[pointing.terms]\nIH = [100.0, 2.0]\n'
    )
    words = ["track", "ISS", "--mount", "sim", "--virtual", "--headless", "--profile", str(profile)]
    assert run(words) == 2
    err = capsys.readouterr().err
    assert "the pointing model of the profile 'other', of 2026-11-22," in err
    assert "at latitude -30.00°" in err


GEOMETRY = """
name = "wedge"
additive = false
[stands_at]
latitude_deg = 52.0
longitude_deg = 4.5
[geometry]
pole_azimuth_deg = 10.0
pole_altitude_deg = {altitude}
[pointing]
utc = "2026-11-22T00:00:00Z"
latitude_deg = 52.0
rms_arcsec = 2.0
stars = 12
signs = "tpoint"
[pointing.axes]
pole_azimuth_deg = 10.0
pole_altitude_deg = 30.0
[pointing.terms]
IH = [100.0, 2.0]
"""


def test_a_model_of_a_pole_that_was_moved_feeds_nothing_but_a_star_run_renews_it(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile, data = tmp_path / "wedge.toml", tmp_path / "run.dat"
    data.write_text(stars)
    slew = ["mount", "slew", "10h", "20d", "--mount", "sim", "--site", SITE, "--profile", str(profile)]
    profile.write_text(GEOMETRY.format(altitude=30.11))
    for words in (slew, ["star-run", "--verify", "--camera", "folder:.", *slew[4:]]):
        assert run(words) == 2
        err = capsys.readouterr().err
        assert "the pointing model of the profile 'wedge', of 2026-11-22, is of axes that lay 0.11°" in err
    ran(capsys, "--fit-only", "--data", str(data), *slew[-2:])
    renewed = load_profile_file(profile).pointing
    assert renewed is not None
    assert renewed.axes == Pole(10.0, 30.11)
    profile.write_text(GEOMETRY.format(altitude=30.09))
    assert pointing_of(load_profile_file(profile).mount, Site(52.0, 4.5, 0.0)) is not None


def test_a_model_whose_signs_are_unknown_feeds_nothing_until_a_star_run_renews_it(
    stars: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile, data = tmp_path / "old.toml", tmp_path / "run.dat"
    data.write_text(stars)
    table = GEOMETRY[GEOMETRY.index("[pointing]") :].replace('signs = "tpoint"\n', "")
    profile.write_text(
        'name = "old"\n' + table[: table.index("[pointing.axes]")] + "[pointing.terms]\nIH = [9, 2]\n"
    )
    given = ["--mount", "sim", "--site", SITE, "--profile", str(profile)]
    for words in (
        ["mount", "slew", "10h", "20d"],
        ["serve", "rotctld"],
        ["star-run", "--verify", "--camera", "folder:."],
    ):
        assert run([*words, *given]) == 2
        err = capsys.readouterr().err
        assert "the profile 'old': the pointing model of 2026-11-22 has no signs" in err
        assert "star-run --fit-only --data FILE" in err
    # What stops the mount needs no model.
    assert run(["mount", "abort", *given]) == 0
    assert "this goes without it" in capsys.readouterr().err
    ran(capsys, "--fit-only", "--data", str(data), "--profile", str(profile))
    assert 'signs = "tpoint"' in profile.read_text()
    assert pointing_of(load_profile_file(profile).mount, Site(52.0, 4.5, 0.0)) is not None

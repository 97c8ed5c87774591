"""Limits that cannot be, as a user writes them: one line that names file, line and value; nothing moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import pytest
from late_start import APPROACH_S, late

from sattrack.cli.main import run
from sattrack.mount.profiles import ProfileFile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import VirtualRun
from sattrack.settings import load_settings

if TYPE_CHECKING:
    from pathlib import Path

TRACK = ("track", "25544", "--mount", "sim", "--virtual", "--headless")
DOORS = {
    "track": TRACK,
    "rehearse": ("rehearse", "25544"),
    "slew": ("mount", "slew", "10h", "+40d", "--mount", "xerxes://127.0.0.1:9"),
    "watch": ("mount", "watch", "--mount", "xerxes://127.0.0.1:9"),
    "antenna": ("serve", "antenna", "--mount", "xerxes://127.0.0.1:9"),
    "alpaca": ("serve", "alpaca", "--mount", "xerxes://127.0.0.1:9"),
}


def refusal(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> str:
    """Run a command line that must be refused; return its one line on standard error."""
    assert run(list(arguments)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert err.count("\n") == 1
    return err.removeprefix("sattrack: ")


@pytest.mark.parametrize(
    ("lines", "number", "says"),
    [
        (["floor_altitude_deg = 95"], 2, "floor_altitude_deg is 95; it goes from -90 to below 90"),
        (["optical = true", "floor_altitude_deg = 20"], 3, "safety.floor_altitude_deg is 20, above"),
        (["sun_cone_deg = 0"], 2, "sun_cone_deg is 0, but there is a telescope with optics: say optical ="),
        (["sun_cone_deg = -3"], 2, "sun_cone_deg is -3; it must be 0 or more"),
        (["sun_cone_deg = 90"], 2, "sun_cone_deg is 90, and the sky left reaches 90° from the zenith"),
        (["moon_cone_deg = nan"], 2, "moon_cone_deg is nan; it must be 0 or more"),
        (["longest_fault_s = 60"], 2, "longest_fault_s is 60; give 0 to 10 seconds"),
        (["clock_tolerance_s = 0"], 2, "clock_tolerance_s is 0; it must be above 0"),
        (["sun_cone = 15"], 2, "unknown key 'sun_cone' in [safety]; did you mean 'sun_cone_deg'?"),
        (['sun_cone_deg = "wide"'], 2, "sun_cone_deg is 'wide'; give a number"),
    ],
)
def test_limits_that_cannot_be_are_refused_with_line_key_and_value(
    lines: list[str], number: int, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text("\n".join(["[safety]", *lines, ""]), encoding="utf-8")
    err = refusal(capsys, (*TRACK, "--config", str(path)))
    assert err.startswith(f"{path}:{number}: ")
    assert says in err


def test_a_cone_larger_than_the_sky_that_a_floor_or_a_skyline_leaves_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text(
        "min_altitude_deg = 60.0\n[safety]\nfloor_altitude_deg = 60.0\nsun_cone_deg = 35.0\n",
        encoding="utf-8",
    )
    err = refusal(capsys, (*TRACK, "--config", str(path)))
    assert err.startswith(f"{path}:4: sun_cone_deg is 35, and the sky left reaches 30°")
    (tmp_path / "walls.txt").write_text("0 60\n90 62\n180 60\n270 70\n", encoding="utf-8")
    path.write_text('[safety]\nhorizon = "walls.txt"\nmoon_cone_deg = 31.0\n', encoding="utf-8")
    err = refusal(capsys, (*TRACK, "--config", str(path)))
    assert "moon_cone_deg is 31, and the sky left reaches 30°" in err


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ("0 5\n90 10\n80 12\n180 3\n270 3\n", ":3: azimuth 80° comes after 90°: sort the lines by azimuth"),
        ("0 5\n90 10\n250 3\n", ": horizon is not known between azimuths 90° and 250°; give points"),
        ("100 5\n180 5\n190 5\n", ": horizon is not known between azimuths 190° and 100°"),
        ("0 5\nhill\n", ":2: 'hill' is no point of a horizon: write azimuth and altitude"),
        ("0 5\n90 95\n", ":2: "),
        ("# nothing\n", ": holds no points of a horizon"),
    ],
)
def test_a_mask_with_gaps_or_unsorted_is_refused_with_file_and_line(
    points: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "hills.txt").write_text(points, encoding="utf-8")
    path = tmp_path / "s.toml"
    path.write_text('[safety]\nhorizon = "hills.txt"\n', encoding="utf-8")
    err = refusal(capsys, (*TRACK, "--config", str(path)))
    assert err.startswith(f"{path}:2: horizon: {tmp_path}/hills.txt{says}")


@pytest.mark.parametrize("door", DOORS)
def test_bad_limits_are_refused_at_every_door(
    door: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text("[safety]\nsun_cone_deg = 0.0\n", encoding="utf-8")
    err = refusal(capsys, (*DOORS[door], "--config", str(path)))
    assert err.startswith(f"{path}:2: sun_cone_deg is 0, but")


@pytest.mark.parametrize(
    ("text", "number", "says"),
    [
        ("dec_axis_limits_deg = [20.0, -20.0]", 1, "dec_axis_limits_deg is 20 to -20; give a lower and"),
        ("hour_angle_limit_deg = -5", 1, "hour_angle_limit_deg is -5; it must be above 0"),
        ("hour_angle_limit_deg = 999", 1, "hour_angle_limit_deg is 999; give 720 at most"),
        ("period_s = 5", 1, "period_s is 5; give 0.5 at most"),
        ("period_s = 5e-5", 1, "period_s is 5e-05; give 0.001 at least"),
        (
            "hour_angle_limit_deg = 90\n[park]\nhour_angle_deg = 150\ndec_deg = 0",
            2,
            "park is at hour angle",
        ),
        (
            "dec_axis_limits_deg = [-40.0, 60.0]\n[home]\nhour_angle_deg = 0\ndec_deg = 80",
            2,
            "home is at",
        ),
        ('name = "a\\nb"', 1, "name is 'a\\nb'; give a word or more, in one line"),
        ('name = " "', 1, "name is ' '; give a word or more"),
        ("[ra]\nmax_rate_deg_s = nan", 2, "ra.max_rate_deg_s is nan; it must be above 0"),
        ('[[pier_zones]]\nname = "a"\ncorners = [[0.0, 0.0], [1.0, 1.0]]', 3, "corners is of 2 in 'a'"),
        ('[readings]\nra_rate = "double"', 2, "readings.ra_rate is no field; give one of dec_rate_dtics_s"),
        ("[stands_at]\nlatitude_deg = -30.0\nlongitude_deg = 20.0", None, "is of a mount at -30.00, 20.00"),
    ],
)
def test_a_profile_that_contradicts_itself_or_is_another_mounts_is_refused(
    text: str, number: int | None, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.toml"
    path.write_text(text + "\n", encoding="utf-8")
    err = refusal(capsys, (*TRACK, "--profile", str(path)))
    assert says in err
    if number is not None:
        assert err.startswith(f"{path}:{number}: ")


def test_a_profile_whose_statuses_are_of_another_kind_ends_the_run_before_anything_moves() -> None:
    request = RunRequest("25544", "sim", None, None, None, 10.0, virtual=True)
    facts = prepare(request).facts
    told = msgspec.structs.replace(facts.profile, readings={"ra_rate_dtics_s": "double"})
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(facts.profile, site, demo_pass.START, SimulatorProfile())
    engine = build_engine(msgspec.structs.replace(facts, profile=told))
    ended_s = VirtualRun(engine, mount, facts.started_utc_s, NoRecording()).run()
    assert ended_s - facts.started_utc_s < 2.0
    assert engine.tracker.ended_by == "error"
    assert "another mount's" in (engine.message or "")


def test_a_run_keeps_the_limits_with_which_it_began(tmp_path: Path) -> None:
    """What is written into the files later is for the next run."""
    path = tmp_path / "s.toml"
    path.write_text("[safety]\nfloor_altitude_deg = 5.0\n", encoding="utf-8")
    limits = load_settings(path).safety.limits()
    request = RunRequest("25544", "sim", None, None, None, 10.0, virtual=True, limits=limits)
    facts = prepare(request).facts
    plan = msgspec.structs.replace(facts.plan, end_utc_s=facts.plan.start_utc_s + 20.0)
    facts = late(msgspec.structs.replace(facts, plan=plan))
    engine = build_engine(facts)
    path.write_text("[safety]\nfloor_altitude_deg = 80.0\n", encoding="utf-8")
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(ProfileFile().mount, site, demo_pass.START, SimulatorProfile())
    VirtualRun(engine, mount, facts.started_utc_s, NoRecording()).run()
    assert engine.spec.limits.floor_altitude_deg == 5.0
    assert engine.tracker.ended_by == "set"
    assert not engine.held_s


@pytest.mark.parametrize(
    ("later", "says"),
    [
        ("floor_altitude_deg = 8.0", "kept the settings of its start; the next command takes them"),
        ("sun_cone_deg = 0.0", "the next command will refuse them: {path}:2: sun_cone_deg is 0, but"),
        (None, None),
    ],
)
def test_settings_that_change_while_a_command_runs_are_told_of(
    later: str | None,
    says: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "s.toml"
    path.write_text("[safety]\nfloor_altitude_deg = 5.0\n", encoding="utf-8")
    plan = prepare(RunRequest("25544", "sim", None, None, None, 10.0, virtual=True)).facts.plan

    def meanwhile(*_: object) -> object:
        if later is not None:
            path.write_text(f"[safety]\n{later}\n", encoding="utf-8")
        return msgspec.structs.replace(plan, end_utc_s=plan.start_utc_s + 1.0, approach_s=APPROACH_S)

    monkeypatch.setattr("sattrack.runtime.facts.plan_for", meanwhile)
    assert run([*TRACK, "--config", str(path)]) == 0
    err = capsys.readouterr().err
    if says is None:
        assert "meanwhile" not in err
    else:
        assert f"{path} changed during the run" in err
        assert says.format(path=path) in err

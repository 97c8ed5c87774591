"""Clocks against each other, and settings as a user writes them."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path

import pytest

from sattrack.core.clock import SimulatedClock, SystemClock, parse_clock
from sattrack.core.errors import BadInputError
from sattrack.settings import Settings, load_settings, user_settings_file, whose_settings

PASSES = ("passes", "25544", "--clock", "2026-10-02T13:00:00Z", "--hours", "1", "--json")


def test_a_simulated_clock_runs_at_its_speed() -> None:
    clock = SimulatedClock(start_utc_s=1000.0, anchor_s=50.0, speed=10.0)
    assert clock.utc_s(50.0) == 1000.0
    assert clock.utc_s(52.0) == 1020.0


def test_the_system_clock_is_the_systems() -> None:
    before = time.time()
    told = SystemClock().utc_s(time.monotonic())
    assert before - 1e-3 <= told <= time.time() + 1e-3


@pytest.mark.parametrize("step_s", [-3600.0, -0.2, 0.2, 3600.0])
def test_the_system_clock_does_not_step_where_the_machines_is_set(
    step_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    instants = {"monotonic": 100.0, "utc": 1_790_000_000.0}
    monkeypatch.setattr(time, "monotonic", lambda: instants["monotonic"])
    monkeypatch.setattr(time, "time", lambda: instants["utc"])
    clock = SystemClock()
    before_s = clock.utc_s(100.0)
    instants["utc"] += step_s
    for _ in range(200):
        instants = {name: value + 0.05 for name, value in instants.items()}
        now_s = clock.utc_s(instants["monotonic"])
        # Half a millisecond a second, to the side that the machine was set to.
        assert -1e-6 <= math.copysign(1.0, step_s) * (now_s - before_s - 0.05) <= 0.05 * 5e-4 + 1e-6
        before_s = now_s


def test_what_the_machine_slept_passes_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linux: CLOCK_MONOTONIC stands while the machine sleeps, CLOCK_BOOTTIME goes on, as UTC does."""
    instants = {"monotonic": 100.0, "utc": 1_790_000_000.0, "slept": 7.0}
    monkeypatch.setattr(time, "monotonic", lambda: instants["monotonic"])
    monkeypatch.setattr(time, "time", lambda: instants["utc"])
    monkeypatch.setattr(time, "CLOCK_BOOTTIME", 7, raising=False)
    monkeypatch.setattr(
        time, "clock_gettime", lambda _: instants["monotonic"] + instants["slept"], raising=False
    )
    clock = SystemClock()
    assert clock.utc_s(100.0) == 1_790_000_000.0
    instants["slept"] += 26.0
    instants["utc"] += 26.0
    assert clock.utc_s(100.0) == pytest.approx(1_790_000_026.0, abs=1e-6)
    assert clock.utc_s(101.0) == pytest.approx(1_790_000_027.0, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "start_s", "speed"),
    [
        ("1970-01-01T00:01:00Z", 60.0, 1.0),
        ("1970-01-02", 86400.0, 1.0),
        ("1970-01-01T00:00:00Zx10", 0.0, 10.0),
        ("1970-01-01T01:00:00+01:00x0.5", 0.0, 0.5),
    ],
)
def test_a_clock_as_a_user_writes_it(text: str, start_s: float, speed: float) -> None:
    start, parsed_speed = parse_clock(text)
    assert start.unix_s == start_s
    assert parsed_speed == speed


def test_a_speed_that_no_loop_could_keep_points_to_virtual_time() -> None:
    with pytest.raises(BadInputError, match="--virtual"):
        parse_clock("2026-01-01T00:00:00Zx1000")


def test_settings_are_found_here_first_then_in_the_users_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, here = tmp_path / "home", tmp_path / "here"
    (home / "sattrack").mkdir(parents=True)
    here.mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    monkeypatch.chdir(here)
    assert load_settings() == Settings()
    (home / "sattrack" / "sattrack.toml").write_text("min_altitude_deg = 20\n")
    assert load_settings().min_altitude_deg == 20.0
    (here / "sattrack.toml").write_text(
        'elements = ["mine.tle"]\n[site]\nlatitude_deg = 1\nlongitude_deg = 2\n'
    )
    settings = load_settings()
    assert settings.min_altitude_deg == 10.0
    assert settings.site is not None
    assert (settings.site.latitude_deg, settings.site.longitude_deg, settings.site.height_m) == (
        1.0,
        2.0,
        0.0,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="a user without a home")
def test_a_user_without_a_home_has_no_settings_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pwd

    def unknown(number: int) -> None:
        raise KeyError(number)

    for name in ("HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.chdir(tmp_path)
    assert user_settings_file() == Path("/.config/sattrack/sattrack.toml")
    assert load_settings() == Settings()


def give_away(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a file belong to another user, whoever runs this test."""
    own = os.geteuid()
    if own != 0:
        monkeypatch.setattr(os, "geteuid", lambda: own + 1)
        return
    try:
        os.chown(path, 54321, -1)
    except OSError as error:
        pytest.skip(f"root cannot give a file away here: {error}")


def owner_of(path: Path) -> str:
    try:
        return path.owner()
    except KeyError:
        return f"user {path.stat().st_uid}"


@pytest.mark.skipif(sys.platform == "win32", reason="files have no owner and no mode there")
@pytest.mark.parametrize("where", ["here", "home/sattrack"])
@pytest.mark.parametrize(
    ("mode", "strange", "whose"),
    [
        (0o644, False, None),
        (0o664, False, None),
        (0o666, False, "belongs to {}, and everybody may write to it"),
        (0o644, True, "belongs to {}"),
        (0o666, True, "belongs to {}, and everybody may write to it"),
    ],
)
def test_settings_that_were_found_and_that_others_may_write_are_told_each_time(
    where: str,
    mode: int,
    strange: bool,
    whose: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from sattrack.cli.main import run

    path = tmp_path / where / "sattrack.toml"
    for folder in (path.parent, tmp_path / "here"):
        folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path / "here")
    example = Path(__file__).parents[3] / "examples" / "iss_leiden.tle"
    path.write_text(f'elements = ["{example}"]\n[site]\nlatitude_deg = 52\nlongitude_deg = 4\n')
    path.chmod(mode)
    if strange:
        give_away(path, monkeypatch)
    told = (
        ""
        if whose is None
        else (
            f"sattrack: {path}: {whose.format(owner_of(path))}; it sets the mount and the limits: "
            "give --config FILE to take another, or this one without a word\n"
        )
    )
    for _ in range(2):
        assert run([*PASSES]) == 0
        out, err = capsys.readouterr()
        assert json.loads(out)
        assert err == told
    assert run([*PASSES, "--config", str(path)]) == 0
    assert capsys.readouterr().err == ""


def test_without_a_folder_of_settings_that_opens_all_is_computed_and_no_real_mount_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sattrack.cli.main import run

    # Nobody, not root either, may look for a name of 300 characters.
    monkeypatch.setenv("XDG_CONFIG_HOME", f"/{'x' * 300}")
    monkeypatch.chdir(tmp_path)
    example = Path(__file__).parents[3] / "examples" / "iss_leiden.tle"
    there = ("--elements", str(example), "--site", "52,4,0")
    assert run([*PASSES, *there]) == 0
    out, err = capsys.readouterr()
    assert len(json.loads(out)) == 1
    assert err.endswith("set XDG_CONFIG_HOME to a folder of yours; going on without the settings\n")
    assert run(["doctor", *there]) == 1
    assert "cannot be looked for" in capsys.readouterr().out
    for verb in (["track", "25544", *there], ["mount", "move", "--ra-rate", "1", "--seconds", "1"]):
        assert run([*verb, "--mount", "xerxes://127.0.0.1:9?listen=15998"]) == 2
        assert "cannot be looked for: File name too long; give --config FILE" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="files have no owner and no mode there")
def test_settings_of_root_are_anybodys_and_an_owner_without_a_name_is_a_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_names(_: Path) -> str:
        raise NotImplementedError

    path = tmp_path / "sattrack.toml"
    assert whose_settings(path) is None
    path.write_text("")
    path.chmod(0o666)
    user = path.stat().st_uid
    monkeypatch.setattr(Path, "owner", without_names)
    assert whose_settings(path) == f"belongs to user {user}, and everybody may write to it"
    path.chmod(0o644)
    monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    assert whose_settings(path) == (None if user == 0 else f"belongs to user {user}")


def test_programs_of_ours_are_given_the_settings_that_were_found(tmp_path: Path) -> None:
    from sattrack.cli.common import CommandContext
    from sattrack.cli.run_night import _common
    from sattrack.cli.screen import helper_options

    path = tmp_path / "sattrack.toml"
    context = CommandContext(Settings(), "52,4,0", (), None, False, False, path)
    night = _common(context, "sim", tmp_path / "profile.toml")
    for words in (helper_options(context, None, None, practising=False).watch, night):
        assert words[words.index("--config") + 1] == str(path)


def test_programs_of_ours_show_utc_where_that_is_asked_for(tmp_path: Path) -> None:
    from sattrack.cli.attach import _handed_on
    from sattrack.cli.common import CommandContext
    from sattrack.cli.screen import helper_options

    look = {"theme": None, "plain": False}
    for utc in (True, False):
        context = CommandContext(Settings(), "52,4,0", ("a.tle",), None, False, False, utc=utc)
        helpers = helper_options(context, None, None, practising=False)
        for words in (helpers.watch, helpers.passes or (), _handed_on(context, look)):
            assert ("--utc" in words) is utc


def test_element_files_are_beside_the_settings_that_name_them(tmp_path: Path) -> None:
    (tmp_path / "other.toml").write_text(
        'elements = ["mine.tle", "https://example.org/x", "celestrak:active", "-"]\n'
    )
    settings = load_settings(tmp_path / "other.toml")
    assert settings.elements == (
        str(tmp_path / "mine.tle"),
        "https://example.org/x",
        "celestrak:active",
        "-",
    )


def test_a_file_that_an_editor_began_with_a_mark_of_its_encoding_is_read(tmp_path: Path) -> None:
    path = tmp_path / "other.toml"
    path.write_text("min_altitude_deg = 20.0\n", encoding="utf-8-sig")
    assert load_settings(path).min_altitude_deg == 20.0


def test_the_screens_look_and_the_camera_are_settings_and_options_win(tmp_path: Path) -> None:
    from sattrack.cli.common import CommandContext
    from sattrack.cli.screen import appearance

    path = tmp_path / "red.toml"
    path.write_text('[screen]\ntheme = "red"\nascii = true\n[camera]\nfov_deg = 0.25\n')
    settings = load_settings(path)
    assert settings.camera.fov_deg == 0.25
    context = CommandContext(settings, None, (), None, False, False)
    assert (appearance(context, None, False).theme, appearance(context, None, False).plain) == ("red", True)
    assert appearance(context, "contrast", False).theme == "contrast"
    usual = CommandContext(Settings(), None, (), None, False, False)
    assert (appearance(usual, None, True).theme, appearance(usual, None, True).plain) == ("night", True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[screen]\ntheme = "green"\n', "theme"),
        ("[camera]\nfov_deg = 0\n", "fov_deg is 0"),
        ("[camera]\nfov_deg = 181\n", "fov_deg is 181"),
        ("[cameras.guide]\nscale_arcsec_px = 0\n", "scale_arcsec_px is 0"),
        ("[cameras.guide]\nrotation_deg = 361\n", "rotation_deg is 361"),
        ('[cameras.guide]\nkind = "middling"\n', "kind"),
    ],
)
def test_a_look_or_a_field_that_cannot_be_names_file_and_key(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "odd.toml"
    path.write_text(text)
    with pytest.raises(BadInputError, match=r"odd\.toml") as raised:
        load_settings(path)
    assert words in str(raised.value)

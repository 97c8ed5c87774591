"""`sattrack mount calibrate` as a user meets it: what it refuses, what it asks, how it stops."""

from __future__ import annotations

import os
import pty
import signal
import termios
import time
from typing import TYPE_CHECKING

import pytest

from sattrack.calibration.guard import EndKind, Leg, Plan
from sattrack.cli.mount_calibrate import command
from sattrack.core.clock import SystemClock
from sattrack.core.errors import BadInputError, InterruptedRunError, LinkLostError, SattrackError
from sattrack.runtime.calibrate import calibrate_live, ending_error, start_practice_mount, surroundings
from tle.site import Site

if TYPE_CHECKING:
    from pathlib import Path

SITE = Site(52.0, 4.5)
QUICK = Plan(toggles=1, most_toggles=1, toggles_after=1, steps=False, legs=(Leg(-0.4, 1.0), Leg(0.4, 1.0)))


def call(*arguments: str) -> int:
    result = command.main(args=list(arguments), standalone_mode=False)
    assert isinstance(result, int)
    return result


class TestWhatIsWrongIsToldBeforeAnythingMoves:
    def test_no_file_to_write(self) -> None:
        with pytest.raises(BadInputError, match=r"no output file: give --output FILE"):
            call("--mount", "sim", "--yes")

    def test_a_file_that_is_there_is_not_replaced(self, tmp_path: Path) -> None:
        file = tmp_path / "mount.toml"
        file.write_text("name = 'precious'\n", encoding="utf-8")
        with pytest.raises(BadInputError, match="the file exists; give --force"):
            call("--mount", "sim", "--yes", "--out", str(file))
        assert file.read_text(encoding="utf-8") == "name = 'precious'\n"

    def test_a_folder_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(BadInputError, match="there is no folder"):
            call("--mount", "sim", "--yes", "--out", str(tmp_path / "nowhere" / "mount.toml"))

    def test_a_profile_to_update_that_is_none(self, tmp_path: Path) -> None:
        file = tmp_path / "mount.toml"
        file.write_text("ra_rate_sign = 3\n", encoding="utf-8")
        with pytest.raises(BadInputError, match=r"mount.toml:1"):
            call("--mount", "sim", "--yes", "--update", str(file))

    def test_a_simulated_mount_that_is_none(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        file = tmp_path / "simulated.toml"
        file.write_text("[simulator]\nclock_drift_ppm = -1e9\n", encoding="utf-8")
        with pytest.raises(BadInputError, match=r"simulated.toml:2: clock_drift_ppm is -1e\+09; "):
            call("--mount", "sim", "--yes", "--out", str(tmp_path / "x.toml"), "--sim-profile", str(file))
        assert capsys.readouterr().err == ""

    def test_a_real_mount_needs_a_site(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        with pytest.raises(BadInputError, match="no site"):
            call("--mount", "xerxes://127.0.0.1:9?listen=15998", "--yes", "--out", "x.toml")

    def test_a_real_mount_follows_the_real_clock(self, tmp_path: Path) -> None:
        with pytest.raises(BadInputError, match="--clock is for simulated mounts only"):
            call(
                "--mount", "xerxes://127.0.0.1:9?listen=15998", "--clock", "2026-03-01T00:00:00Z",
                "--out", str(tmp_path / "x.toml"),
            )  # fmt: skip

    @pytest.mark.parametrize("stated", ["-1", "5", "nan"])
    def test_an_uncertainty_that_is_none(self, stated: str, tmp_path: Path) -> None:
        with pytest.raises(BadInputError, match="give the uncertainty in seconds, 0 to 1"):
            call("--mount", "sim", "--yes", "--out", str(tmp_path / "x.toml"), "--clock-true", stated)

    def test_a_camera_without_axes_to_find_or_a_mount_to_sit_on(self, tmp_path: Path) -> None:
        words = ("--yes", "--out", str(tmp_path / "x.toml"), "--camera", "folder:nowhere")
        with pytest.raises(BadInputError, match="--camera needs --axes"):
            call("--mount", "sim", *words)
        with pytest.raises(BadInputError, match="--camera needs a mount that it is on"):
            call("--mount", "sim", "--axes", *words)

    @pytest.mark.parametrize("more", ['reports = "axes"', 'reports = "horizon"', "first_zero_deg = 57.0"])
    def test_axes_of_a_mount_that_does_not_report_where_it_looks_need_a_camera(
        self, more: str, tmp_path: Path
    ) -> None:
        file = tmp_path / "mount.toml"
        file.write_text(
            "additive = false\n[stands_at]\nlatitude_deg = 52.0\nlongitude_deg = 4.5\n[geometry]\n"
            f"pole_azimuth_deg = 0.0\npole_altitude_deg = 60.0\n{more}\n",
            encoding="utf-8",
        )
        with pytest.raises(BadInputError, match="give --camera SOURCE"):
            call("--mount", "sim", "--yes", "--axes", "--update", str(file))

    def test_without_a_terminal_consent_comes_by_yes_alone(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        with pytest.raises(BadInputError, match="no consent"):
            call("--mount", "sim", "--out", str(tmp_path / "x.toml"))
        assert "to either side of where it stands" in capsys.readouterr().err
        assert not (tmp_path / "x.toml").exists()

    @pytest.mark.parametrize(
        ("safety", "says"),
        [
            ("", "20° high and 15° from the Sun"),
            ("floor_altitude_deg = 25\nsun_cone_deg = 30\n", "25° high and 30° from the Sun"),
            ("optical = false\n", "20° high and 15° from the Sun"),
        ],
    )
    def test_the_question_names_what_the_run_asks_of_the_place(
        self, safety: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        file = tmp_path / "s.toml"
        file.write_text(f"min_altitude_deg = 30\n[safety]\n{safety}", encoding="utf-8")
        with pytest.raises(BadInputError, match="no consent"):
            call("--mount", "sim", "--out", str(tmp_path / "x.toml"), "--config", str(file))
        assert f"must stand clear, {says}" in capsys.readouterr().err


@pytest.mark.parametrize("of_settings", [True, False])
def test_the_limits_of_the_settings_profile_hold_for_a_new_one_too(
    of_settings: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    zone = "[[pier_zones]]\nname = 'all'\ncorners = [[-180, -89], [180, -89], [180, 89], [-180, 89]]\n"
    (tmp_path / "mine.toml").write_text(zone, encoding="utf-8")
    # A file that the settings name, and that is only to be written, holds no limits yet.
    named = "mine.toml" if of_settings else "new.toml"
    (tmp_path / "sattrack.toml").write_text(f"mount.profile = '{named}'\n", encoding="utf-8")
    bound = "its pier limit" if of_settings else "no consent"
    consent = ("--yes",) if of_settings else ()
    with pytest.raises(SattrackError, match=bound):
        call("--mount", "sim", "--site", "52,4.5,0", "--output", "new.toml", *consent)
    assert ("stays as in mine.toml" in capsys.readouterr().err) is of_settings
    assert not (tmp_path / "new.toml").exists()


def test_a_mount_that_is_not_there_is_a_lost_link(tmp_path: Path) -> None:
    out = tmp_path / "x.toml"
    with pytest.raises(LinkLostError, match=r"no status from the mount within 2 s.*nothing was moved"):
        call(
            "--mount", "xerxes://127.0.0.1:9?listen=15998", "--site", "52,4.5,0", "--yes", "--out", str(out)
        )  # fmt: skip
    assert not out.exists()


def test_a_signal_during_a_motion_stops_the_mount_and_is_told_so() -> None:
    clock = SystemClock()
    around = surroundings(SITE, start_profile(), clock.utc_s(time.monotonic()))
    practice = start_practice_mount(around, SITE, clock, None)
    signalled: list[str] = []

    def show(phase: str, part_done: float) -> None:
        assert 0.0 <= part_done <= 1.0
        if phase.startswith("held or edge") and not signalled:
            signalled.append(phase)
            os.kill(os.getpid(), signal.SIGINT)

    try:
        before = signal.getsignal(signal.SIGINT)
        calibrator = calibrate_live(around, practice.address, clock, show, QUICK)
        assert signal.getsignal(signal.SIGINT) is before
    finally:
        practice.close()
    ending = calibrator.ending
    assert ending is not None
    assert (ending.kind, ending.at_rest) == (EndKind.OPERATOR, True)
    error = ending_error(ending)
    assert isinstance(error, InterruptedRunError)
    assert str(error) == "interrupted; the mount was stopped and seen at rest"
    assert error.exit_code == 130


def test_what_breaks_while_showing_stops_the_mount_before_it_is_raised() -> None:
    clock = SystemClock()
    around = surroundings(SITE, start_profile(), clock.utc_s(time.monotonic()))
    practice = start_practice_mount(around, SITE, clock, None)
    phases: list[str] = []

    def show(phase: str, _: float) -> None:
        phases.append(phase)
        if phase.startswith("held or edge"):
            raise SattrackError("the screen is gone")

    try:
        calibrator = calibrate_live(around, practice.address, clock, show, QUICK)
    finally:
        practice.close()
    ending = calibrator.ending
    assert ending is not None
    assert (ending.kind, ending.words, ending.at_rest) == (EndKind.DOUBT, "the screen is gone", True)
    assert phases[-1] == "stopping the mount"


@pytest.mark.parametrize("key", [pytest.param(b"x", marks=pytest.mark.soak), b"\x13"])
def test_any_key_stops_the_mount_and_the_terminal_is_as_it_was(
    key: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    master, slave = pty.openpty()
    clock = SystemClock()
    around = surroundings(SITE, start_profile(), clock.utc_s(time.monotonic()))
    practice = start_practice_mount(around, SITE, clock, None)
    pressed: list[str] = []

    def show(phase: str, _: float) -> None:
        if phase.startswith("held or edge") and not pressed:
            pressed.append(phase)
            os.write(master, key)

    try:
        with os.fdopen(slave) as terminal:
            monkeypatch.setattr("sys.stdin", terminal)
            before = termios.tcgetattr(slave)
            ending = calibrate_live(around, practice.address, clock, show, QUICK).ending
            assert termios.tcgetattr(slave) == before
    finally:
        practice.close()
        os.close(master)
    assert ending is not None
    assert (ending.kind, ending.words, ending.at_rest) == (EndKind.OPERATOR, "stopped by a key", True)


def start_profile() -> object:
    from sattrack.mount.model import MountProfile

    return MountProfile()

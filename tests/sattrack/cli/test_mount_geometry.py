"""The mount verbs on an alt-azimuth Alpaca telescope that is a stranger's program."""

from __future__ import annotations

import contextlib
import io
import json
import math
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from sattrack.cli.main import run

if TYPE_CHECKING:
    from collections.abc import Iterator

STRANGER = Path(__file__).parents[3] / "bench" / "strangers" / "alpaca_two_axes.py"
SIDEREAL_DEG_S = 360.98564736629 / 86400.0
PROFILE = """
name = "altaz"
additive = false
[ra]
max_rate_deg_s = 6.0
max_acceleration_deg_s2 = 5.0
[dec]
max_rate_deg_s = 6.0
max_acceleration_deg_s2 = 5.0
[stands_at]
latitude_deg = 52.0
longitude_deg = 4.5
[geometry]
pole_azimuth_deg = 0.0
pole_altitude_deg = 90.0
"""


class AltAz:
    """The stranger, and what it says of itself."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        self.url = f"alpaca://127.0.0.1:{json.loads(process.stdout.readline())['port']}/0"
        self.truth: dict[str, float] = json.loads(process.stdout.readline())
        self.stood_s = 0.0
        """For how long it has stood still since it last moved fast."""
        self.stood_s = 0.0
        threading.Thread(target=self._read, args=(process.stdout,), daemon=True).start()

    def _read(self, lines: Any) -> None:
        with contextlib.suppress(ValueError):
            for line in lines:
                before, self.truth = self.truth, json.loads(line)
                fastest_deg_s = max(abs(self.truth["first_deg_s"]), abs(self.truth["second_deg_s"]))
                if fastest_deg_s > 0.05:
                    self.stood_s = 0.0
                elif fastest_deg_s == 0.0:
                    self.stood_s += self.truth["utc_s"] - before["utc_s"]


@contextmanager
def alt_az(**parameters: Any) -> Iterator[AltAz]:
    command = [sys.executable, str(STRANGER), "--truth", "--parameters", json.dumps(parameters)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield AltAz(process)
        finally:
            process.kill()


@pytest.fixture
def profile(tmp_path: Path) -> Path:
    path = tmp_path / "altaz.toml"
    path.write_text(PROFILE, encoding="utf-8")
    return path


def called(mount: AltAz, profile: Path, *words: str) -> Any:
    options = ("--mount", mount.url, "--profile", str(profile), "--site", "52,4.5,20")
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = run(["mount", *words, *options])
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


@pytest.mark.parametrize("tracking", [False, True])
def test_a_slew_goes_there_and_leaves_the_telescope_as_it_was(profile: Path, tracking: bool) -> None:
    with alt_az(tracking=tracking) as mount:
        before = mount.truth
        ra, dec = (before["ra_deg"] + 4.0) % 360.0, before["dec_deg"] + 2.0
        done = called(mount, profile, "slew", str(ra), str(dec), "--json")
        assert done.returncode == 0, done.stderr
        result = json.loads(done.stdout)
        after = mount.truth
        # While it stood, the sky went on: until its driver tracked again, or to the end.
        off = math.remainder(after["ra_deg"] - ra - SIDEREAL_DEG_S * mount.stood_s, 360.0)
        assert abs(off) < 0.001, off
        assert after["dec_deg"] == pytest.approx(dec, abs=0.02)
        assert result["state"] == "complete"
        assert result["mount_stopped"] is True
        assert result["looks_at_deg"][1] == pytest.approx(after["dec_deg"], abs=0.02)


def test_a_sync_and_a_pulse_are_refused_before_anything_is_sent(profile: Path) -> None:
    with alt_az() as mount:
        for words in (("sync", "10", "10"), ("pulse", "--ra", "300"), ("home",)):
            done = called(mount, profile, *words)
            assert done.returncode == 2
            assert "geometry" in done.stderr
            assert "nothing was sent" in done.stderr
            assert len(done.stderr.strip().splitlines()) == 1


def test_the_status_of_such_a_telescope_is_shown(profile: Path) -> None:
    with alt_az() as mount:
        done = called(mount, profile, "status")
        assert done.returncode == 0, done.stderr
        assert "looks at RA" in done.stdout


def test_what_one_command_winds_the_next_one_knows(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Past half a turn the reported azimuth says nothing of the cables, which bear 200° here."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with alt_az(azimuth_deg=350.0) as mount:
        begun_deg = mount.truth["first_deg"]
        for _ in range(2):
            done = called(mount, profile, "move", "--ra-rate", "-4", "--seconds", "4", "--json")
        turned_deg = mount.truth["first_deg"] - begun_deg
        assert 20.0 < abs(turned_deg) < 200.0 - 170.0, (turned_deg, done)
        assert "hour_angle" in done.stdout + done.stderr
        # Back within half a turn, and the way round is not taken: it is 40° long, not 320°.
        done = called(mount, profile, "move", "--ra-rate", "4", "--seconds", "7", "--json")
        assert done.returncode == 0, done.stderr
        assert abs(mount.truth["first_deg"] - begun_deg) < 10.0
    assert not list((tmp_path / "sattrack" / "moving").iterdir())

"""The command line on a system without Unix, and on one without Linux, as far as a process can pretend that.

It is no Windows and no macOS: the test shows that nothing imports or calls what is missing there.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.cli.main import COMMANDS

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parents[3]
ISS = str(ROOT / "examples" / "iss_leiden.tle")
SEEN = str(ROOT / "examples" / "iss_observations.csv")
RECORDING = str(ROOT / "tests" / "sattrack" / "recording" / "data" / "version_3.mcap")
AT = ("--clock", "2026-10-02T12:50:00Z", "--elements", ISS, "--site", "52.1541,4.4908,0")
CALCULATIONS = (
    (("passes", "ISS", *AT), "13:01:59"),
    (("ephemeris", "ISS", *AT), "12:50:00.000"),
    (("elements", "check", ISS), "1 accepted, 0 rejected"),
    (("bias", ISS, "--observations", SEEN), "--bias-along"),
    (("report", RECORDING), "to change"),
    (("replay", RECORDING), "equivalent"),
    (("recording", "info", RECORDING), "nothing is wrong"),
)
MOTIONS = (
    ("demo", "--headless"),
    ("track", "ISS", "--mount", "sim", *AT),
    ("mount", "status", "--mount", "sim"),
    ("serve", "lx200", "--mount", "sim"),
    ("run", "night.toml"),
    ("stop",),
    ("attach",),
    ("sim",),
    ("star-run", "--by-hand"),
)


def answers_of(system: str, lines: Sequence[Sequence[str]], folder: Path) -> list[tuple[int, str, str]]:
    """Return exit code, output and messages of each command line."""
    program = Path(__file__).with_name("pretended_system.py")
    done = subprocess.run(
        [sys.executable, str(program), system],
        input=json.dumps(lines),
        capture_output=True,
        text=True,
        cwd=folder,
        check=True,
        env={"HOME": str(folder), "PYTHONPATH": str(ROOT), "NO_COLOR": "1"},
    )
    return [(code, out, err) for code, out, err in json.loads(done.stdout)]


def test_calculations_run_without_unix_and_what_moves_a_mount_says_why_not(tmp_path: Path) -> None:
    lines = [*(line for line, _ in CALCULATIONS), *MOTIONS, *((name, "--help") for name in COMMANDS)]
    answers = answers_of("win32", lines, tmp_path)
    for (line, shows), (code, out, err) in zip(CALCULATIONS, answers, strict=False):
        assert (code, shows in out) == (0, True), (line, out, err)
    for line, (code, out, err) in zip(MOTIONS, answers[len(CALCULATIONS) :], strict=False):
        assert (code, out, err.count("\n")) == (1, "", 1), (line, out, err)
        assert "needs Linux, macOS or WSL" in err, (line, err)
    helps = answers[len(CALCULATIONS) + len(MOTIONS) :]
    assert all(code == 0 and "Usage:" in out for code, out, _ in helps)


def test_without_linux_stop_says_that_it_finds_no_session(tmp_path: Path) -> None:
    calculated, stop = answers_of("darwin", [CALCULATIONS[0][0], ("stop",)], tmp_path)
    assert calculated[0] == 0
    assert (stop[0], "found on Linux only" in stop[2]) == (2, True), stop

"""What starting costs: help must not import what only some commands need."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("scipy", "matplotlib", "textual", "skyfield", "filterpy", "numpy", "mcap")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]])
def test_help_is_light(arguments: list[str]) -> None:
    code = f"""
import sys
from sattrack.cli import run
assert run({arguments!r}) == 0
print("imported:", [name for name in {HEAVY!r} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported: []"


def test_every_command_has_help_and_the_options_of_every_command() -> None:
    from sattrack.cli import COMMANDS

    for name in COMMANDS:
        done = subprocess.run(
            [sys.executable, "-m", "sattrack", name, "--help"], capture_output=True, text=True, check=True
        )
        if name in ("elements", "mount"):
            continue
        for option in ("--config", "--site", "--elements", "--clock", "--json", "--debug"):
            assert option in done.stdout

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


OPTIONS = ("--config", "--site", "--elements", "--clock", "--json", "--debug")


def test_every_command_has_help_and_the_options_of_every_command() -> None:
    from sattrack.cli import COMMANDS

    lines: list[tuple[str, ...]] = []
    for name in COMMANDS:
        verbs = verbs_in(help_of(name))
        lines += [(name, verb) for verb in verbs] or [(name,)]
    assert len(lines) > len(COMMANDS)
    for line in lines:
        text = help_of(*line)
        assert [option for option in OPTIONS if option not in text] == [], line


def help_of(*line: str) -> str:
    arguments = [sys.executable, "-m", "sattrack", *line, "--help"]
    return subprocess.run(arguments, capture_output=True, text=True, check=True).stdout


def verbs_in(text: str) -> list[str]:
    """Return the verbs that a command's help lists: indented by two, each before what it does."""
    _, _, listed = text.partition("\nCommands:\n")
    return [line.split()[0] for line in listed.splitlines() if line[:2] == "  " and line[2:3].strip()]

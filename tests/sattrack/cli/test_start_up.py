"""What starting costs: help must not import what only some commands need."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import sattrack
from sattrack.core.process import self_command

EXAMPLES = Path(__file__).parents[3] / "examples"
HEAVY = ("scipy", "matplotlib", "textual", "skyfield", "filterpy", "numpy", "mcap")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]])
def test_help_is_light(arguments: list[str]) -> None:
    code = f"""
import sys
from sattrack.cli.main import run
assert run({arguments!r}) == 0
print("imported:", [name for name in {HEAVY!r} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported: []"


OPTIONS = ("--debug", "Examples:")


HELP_OF_ALL = """
import contextlib, io, json, runpy, sys

def help_of(line):
    # No command finds anything of ours loaded that another one has asked for, as in a process of its own.
    # The verbs of a command are in its own module.
    if len(line) == 1:
        for name in [name for name in sys.modules if name.partition(".")[0] in ("sattrack", "tle")]:
            del sys.modules[name]
    sys.argv = ["sattrack", *line, "--help"]
    with contextlib.redirect_stdout(io.StringIO()) as told:
        try:
            runpy.run_module("sattrack", run_name="__main__")
        except SystemExit as end:
            assert end.code == 0, (line, end.code)
    return told.getvalue()

for line in sys.stdin:
    print(json.dumps(help_of(json.loads(line))), flush=True)
"""


def test_every_command_has_help_with_examples() -> None:
    from sattrack.cli.main import COMMANDS

    asked = [sys.executable, "-c", HELP_OF_ALL]
    helps: dict[tuple[str, ...], str] = {}
    with subprocess.Popen(asked, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        for name in COMMANDS:
            text = help_of(process, name)
            verbs = verbs_in(text)
            helps |= {(name, verb): help_of(process, name, verb) for verb in verbs} or {(name,): text}
    assert len(helps) > len(COMMANDS)
    for line, text in helps.items():
        assert [option for option in OPTIONS if option not in text] == [], line


def help_of(process: subprocess.Popen[str], *line: str) -> str:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(line) + "\n")
    process.stdin.flush()
    return str(json.loads(process.stdout.readline()))


def verbs_in(text: str) -> list[str]:
    """Return the verbs that a command's help lists: indented by two, each before what it does."""
    _, _, listed = text.partition("\nCommands:\n")
    return [line.split()[0] for line in listed.splitlines() if line[:2] == "  " and line[2:3].strip()]


def test_what_lies_in_the_current_folder_stands_in_for_no_part_of_a_run(tmp_path: Path) -> None:
    for name in ("click", "msgspec", "random", "select"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a file of the user, and none of ours')\n")
    done = subprocess.run(
        # As an installed `sattrack` is run: the current folder is not on its path.
        [sys.executable, "-P", "-m", "sattrack", "demo", "--headless", "--json", "--seconds", "5"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["summary"]["mount_stopped"] is True
    assert "a file of the user" not in done.stderr


def test_a_checkout_that_is_not_installed_starts_its_processes_from_where_it_lies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    package = Path(sattrack.__file__).parent
    monkeypatch.chdir(package.parent)
    assert self_command() == [sys.executable, "-m", "sattrack"]
    for elsewhere in (package, package.parents[1]):
        monkeypatch.chdir(elsewhere)
        assert self_command() == [sys.executable, "-P", "-m", "sattrack"]


WITHOUT_POSIX = """
import sys
from sattrack.cli.main import POSIX_ONLY
for name in POSIX_ONLY:
    sys.modules[name] = None
"""
"""As on Windows, where Python has none of these modules."""


def without_posix(code: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT_POSIX + code]
    return subprocess.run(command, cwd=EXAMPLES, capture_output=True, text=True, check=False)


def test_the_pure_parts_need_no_posix() -> None:
    code = """
import importlib, pkgutil
parts = "core mount control safety planning calibration".split()
count = 0
for part in ("tle", *("sattrack." + part for part in parts)):
    for found in pkgutil.walk_packages(importlib.import_module(part).__path__, part + "."):
        importlib.import_module(found.name)
        count += 1
assert count > 60, count
"""
    assert without_posix(code).stderr == ""


@pytest.mark.soak
def test_wheel_and_sdist_are_complete_and_run_the_demo_when_installed() -> None:
    command = [sys.executable, str(EXAMPLES.parent / "bench" / "install.py"), sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "files missing in the wheel: none" in done.stdout

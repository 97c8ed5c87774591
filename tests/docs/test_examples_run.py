"""Every block of the README, the tutorial and the how-tos does what the page says.

Blocks of `sh` run in a folder that holds examples/, a page's blocks one after the other; a block without a
language after one is its output, in which `…` stands for any lines. Those after `<!-- parse only: WHY -->` do
not run: each `sattrack` line of theirs must parse. Other marks say what reads a block: `sattrack.toml`,
`profile`, `schedule`, `message`.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import click
import msgspec
import pytest

from sattrack.cli.main import cli, run
from sattrack.mount.model import MountProfile
from sattrack.schedule.file import load_schedule
from sattrack.settings import load_settings
from sattrack.views.messages import decode_message

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "docs" / "index.md",
    ROOT / "docs" / "tutorial.md",
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
NIGHTS = ROOT / "docs" / "nights.md"
"""Shows what its example prints, which docs/howto/unattended.md runs."""
HIGH = {"docs/howto/biases.md", "docs/howto/keyhole.md"}
"""Pages that show nothing of what a pass prints: there a pass is only what is above 60°."""
FENCE = re.compile(
    r"(?:^<!-- (?P<mark>[^\n]*?) -->\n)?^```(?P<kind>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
KINDS = {"sh", "python", "toml", "json", "console", ""}


class Block(NamedTuple):
    kind: str
    mark: str
    text: str
    after: str
    """What stands between the block before and this one."""


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found, end = [], 0
    for fence in FENCE.finditer(text):
        found.append(
            Block(fence["kind"], fence["mark"] or "", fence["text"], text[end : fence.start()].strip())
        )
        end = fence.end()
    return found


def command_lines(text: str) -> list[list[str]]:
    """The words of each `sattrack` command of a shell block."""
    lines = text.replace("\\\n", " ").splitlines()
    words = [shlex.split(line.partition(" < ")[0], comments=True) for line in lines]
    return [one[1:] for one in words if one and one[0].endswith("sattrack")]


def parse(words: list[str]) -> None:
    """Parse a command line, through its groups, without running it."""
    command: click.Command = cli
    name = "sattrack"
    while isinstance(command, click.Group):
        with click.Context(command, info_name=name) as context:
            found = command.get_command(context, words[0])
        assert found is not None, f"{name} has no command {words[0]}"
        command, name, words = found, f"{name} {words[0]}", words[1:]
    with command.make_context(name, list(words)):
        pass


def matches(shown: str, printed: str) -> bool:
    """Whether a text is as shown; a line of `…` stands for any lines, or none, ` …` for the rest of one."""
    parts = [re.escape(line) for line in shown.rstrip("\n").split("\n")]
    pattern = "\n".join(parts).replace("\n…\n", "\n(?:.*\n)*?").removesuffix("\n…").replace(r"\ …", " .*")
    return re.match(pattern + (r"\n?$" if not shown.endswith("\n…\n") else ""), printed) is not None


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


RECORDING = "virtual.mcap"
"""What the tutorial calls its recording of a whole pass."""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the last seconds of a pass, for commands of which no page shows a figure."""
    path = tmp_path_factory.mktemp("short") / RECORDING
    high = ("--min-alt", "78", "--clock", "2026-10-02T13:05:15Z")
    assert run(["track", "ISS", "--mount", "sim", "--virtual", *high, "--record", str(path)]) == 0
    return path


def is_output(block: Block) -> bool:
    return block.kind == "" and not block.mark and not block.after


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_run_as_shown(page: Path, tmp_path: Path, short: Path) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    if name_of(page) in HIGH:
        settings = (ROOT / "examples" / "sattrack.toml").read_text(encoding="utf-8")
        (low,) = re.findall(r"^min_altitude_deg = .*$", settings, re.MULTILINE)
        high = "min_altitude_deg = 60"
        (tmp_path / "examples" / "sattrack.toml").write_text(settings.replace(low, high), encoding="utf-8")
        (tmp_path / "sattrack.toml").write_text(high, encoding="utf-8")
    env = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "HOME": str(tmp_path),
        "XDG_STATE_HOME": str(tmp_path / "state"),
        "XDG_DATA_HOME": str(tmp_path / "data"),
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
        "NO_COLOR": "1",
        "COLUMNS": "120",
    }
    printed: str | None = None
    shown = blocks(page)
    for number, block in enumerate(shown):
        assert block.kind in KINDS, block
        if block.kind in ("sh", "python") and not block.mark:
            shows = [one.text for one in shown[number + 1 : number + 2] if is_output(one)]
            if not re.search(r"\d", "".join(shows)) and (tmp_path / RECORDING).exists():
                shutil.copy(short, tmp_path / RECORDING)
            program = ["bash", "-ec"] if block.kind == "sh" else [sys.executable, "-c"]
            done = subprocess.run(
                [*program, block.text], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, (block.text, done.stdout, done.stderr)
            printed = done.stdout
            if "examples/night.toml --virtual" in block.text:
                assert block.text in NIGHTS.read_text(encoding="utf-8")
                assert printed in [one.text for one in blocks(NIGHTS)]
        elif is_output(block) and printed is not None:
            assert matches(block.text, printed), (block.text, printed)
            printed = None


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_that_do_not_run_parse(page: Path) -> None:
    for block in blocks(page):
        if block.kind == "sh":
            for words in command_lines(block.text):
                if not words[0].startswith("-"):
                    parse(words)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_and_messages_are_read(page: Path, tmp_path: Path) -> None:
    for block in blocks(page):
        file = tmp_path / "block.toml"
        file.write_text(block.text, encoding="utf-8")
        if block.mark == "sattrack.toml":
            assert (load_settings(file).site is not None) == ("[site]" in block.text)
        elif block.mark == "profile":
            msgspec.toml.decode(block.text, type=MountProfile)
        elif block.mark == "schedule":
            assert load_schedule(file).entries
        elif block.mark == "message":
            for line in block.text.splitlines():
                decode_message(line.encode())
        elif block.kind == "json":
            json.loads(block.text)
        else:
            assert block.kind != "toml", f"say what reads this: {block.text}"


def test_readme_and_ci_run_the_same_tests_and_the_readme_is_short() -> None:
    readme = PAGES[0].read_text(encoding="utf-8")
    (tests,) = re.findall(r"^(python3 -m venv .*pytest.*)$", readme, re.MULTILINE)
    assert tests in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    (demo,) = re.findall(r"^(python3 -m venv .*sattrack demo)$", readme, re.MULTILINE)
    assert "-c constraints.txt '.[all]'" in demo
    assert len(readme.splitlines()) < 150


def test_the_readme_tells_what_a_rehearsal_expects(capsys: pytest.CaptureFixture[str]) -> None:
    config = ("--config", str(ROOT / "examples" / "sattrack.toml"), "--clock", "2026-10-02T12:50:00Z")
    # What it expects where the satellite is highest, it expects of the high part alone too.
    assert run(["rehearse", "ISS", *config, "--min-alt", "60", "--json"]) == 0
    parts = {part["name"]: part for part in json.loads(capsys.readouterr().out)["budget"]["parts"]}
    readme = PAGES[0].read_text(encoding="utf-8")
    for name, row in (
        ("elements", "| elements 0.5 days old |"),
        ("clock", "10 ms |"),
        ("delay", "5 ms earlier or later than assumed |"),
    ):
        assert f"{row} {parts[name]['along_arcsec']:.0f}″ |" in readme
    assert f"an error of {parts['elements']['across_arcsec']:.0f}″" in readme


def test_a_difference_in_the_output_shows() -> None:
    shown = "one\n…\nfour\n"
    assert matches(shown, "one\ntwo\nthree\nfour\n")
    assert matches("one\n…\n", "one\ntwo\n")
    assert matches("one …\ntwo\n", "one or more\ntwo\n")
    assert not matches("one …\ntwo\n", "one or more\nthree\n")
    for printed in ("two\nfour\n", "one\ntwo\n", "one\ntwo\nfour\nfive\n"):
        assert not matches(shown, printed)
    with pytest.raises(click.NoSuchOption):
        parse(["track", "ISS", "--no-such-option"])
    for before, after in pairwise(blocks(ROOT / "docs" / "tutorial.md")):
        assert before is not after

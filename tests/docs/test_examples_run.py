"""Every block of the README, the tutorial and the how-tos does what the page says.

Blocks of `sh` run in a folder that holds examples/, a page's blocks one after the other; a block without a
language after one is its output, in which `…` stands for any lines. A shell runs what is more than commands
of `sattrack`, and the tutorial's first block; this process runs the others. Those after
`<!-- parse only: WHY -->` do not run: each `sattrack` line of theirs must parse. Other marks say what reads a
block: `sattrack.toml`, `profile`, `schedule`, `message`.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
import msgspec
import pytest

from sattrack.cli.main import cli, run
from sattrack.core.local_time import use_zone
from sattrack.mount.model import MountProfile
from sattrack.runtime import demo_pass
from sattrack.schedule.file import load_schedule
from sattrack.settings import load_settings
from sattrack.views.messages import decode_message

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
NIGHTS = ROOT / "docs" / "nights.md"
"""Shows what its example prints, which docs/howto/unattended.md runs."""
HIGH = {"docs/howto/biases.md", "docs/howto/keyhole.md"}
"""Pages that show nothing of what a pass prints: there a pass is only what is above 75°."""
TUTORIAL = ROOT / "docs" / "tutorial.md"
"""Shows all figures of the practice pass; where another page shows the same, they are found once."""
UNATTENDED = ROOT / "docs" / "howto" / "unattended.md"
PAGES = [
    ROOT / "README.md",
    ROOT / "docs" / "index.md",
    TUTORIAL,
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
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


def _or_the_next(digits: re.Match[str]) -> str:
    near = range(int(digits[0]) - 1, int(digits[0]) + 2)
    return f"(?:{'|'.join(f'{one:03d}' for one in near)})"


def matches(shown: str, printed: str) -> bool:
    """Whether a text is as shown; a line of `…` stands for any lines, or none, ` …` for the rest of one.

    A run's error may be 0.001″ more or less: processors round the sums of a pass differently.
    """
    parts = [re.escape(line) for line in shown.rstrip("\n").split("\n")]
    parts = [re.sub(r"(?<=error\\ 0\\\.)\d{3}(?=″)", _or_the_next, line) for line in parts]
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


def is_the_tutorials(pass_: Block, output: Block) -> bool:
    """Whether a block follows the practice pass and shows of it what the tutorial shows, and nothing else."""
    (words,) = command_lines(pass_.text) or [[]]
    known = {line for block in blocks(TUTORIAL) if is_output(block) for line in block.text.splitlines()}
    practice = words[:2] == ["track", "ISS"] and "--virtual" in words and "--config" not in words
    shown = output.text.splitlines()
    return practice and all(line in known or any(matches(line, one) for one in known) for line in shown)


def test_without_settings_the_pass_and_the_place_are_the_tutorials() -> None:
    """So that what the tutorial shows of its pass is what a page without settings shows of its own."""
    elements = (ROOT / "examples" / "iss_leiden.tle").read_text(encoding="utf-8").splitlines()
    assert elements[-2:] == [demo_pass.LINE_1, demo_pass.LINE_2]
    place = demo_pass.SITE.place()
    where = f"--site {place.latitude_deg:g},{place.longitude_deg:g},{place.height_m:g} "
    assert where in TUTORIAL.read_text(encoding="utf-8")


def printed_by(text: str, kind: str, shell: bool, capfd: pytest.CaptureFixture[str]) -> str:
    """Run a block where we are; return what it printed."""
    if kind == "sh" and not shell:
        capfd.readouterr()
        codes = [run(words) for words in command_lines(text)]
        told = capfd.readouterr()
        assert codes, text
        assert not any(codes), (text, told)
        return told.out
    program = ["bash", "-ec"] if kind == "sh" else [sys.executable, "-c"]
    done = subprocess.run([*program, text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, (text, done.stdout, done.stderr)
    return done.stdout


def is_plain(text: str) -> bool:
    """Whether a block is nothing but commands of sattrack, which need no shell."""
    lines = text.replace("\\\n", " ").splitlines()
    return all(line.startswith("sattrack ") and not set(line) & set("<>|&;$`*~") for line in lines)


@pytest.fixture
def zone() -> Iterator[None]:
    """Leave the zone of this process as it is, whatever a command sets it to."""
    before = os.environ.get("TZ")
    yield
    if before is None:
        os.environ.pop("TZ", None)
        time.tzset()
    else:
        use_zone(before)


@pytest.mark.parametrize(
    ("page", "whole"),
    [
        *((page, False) for page in PAGES),
        *(pytest.param(page, True, marks=pytest.mark.soak) for page in (TUTORIAL, UNATTENDED)),
    ],
    ids=lambda value: name_of(value) if isinstance(value, Path) else ("whole" if value else "short"),
)
@pytest.mark.usefixtures("zone")
def test_commands_run_as_shown(
    page: Path,
    whole: bool,
    tmp_path: Path,
    short: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    high = "min_altitude_deg = 75"
    if page == UNATTENDED and not whole:
        schedule = (ROOT / "examples" / "night.toml").read_text(encoding="utf-8")
        assert schedule.count("\npriority = 3\n") == 1
        # The pass is taken by the same entry, and half a minute of it is followed.
        (tmp_path / "examples" / "night.toml").write_text(
            schedule.replace("\npriority = 3\n", "\npriority = 300\nlongest_s = 30\n"), encoding="utf-8"
        )
    if name_of(page) in HIGH:
        settings = (ROOT / "examples" / "sattrack.toml").read_text(encoding="utf-8")
        (low,) = re.findall(r"^min_altitude_deg = .*$", settings, re.MULTILINE)
        (tmp_path / "examples" / "sattrack.toml").write_text(settings.replace(low, high), encoding="utf-8")
        (tmp_path / "sattrack.toml").write_text(high, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    for name, value in (
        ("HOME", tmp_path),
        ("XDG_STATE_HOME", tmp_path / "state"),
        ("XDG_DATA_HOME", tmp_path / "data"),
        ("XDG_CONFIG_HOME", tmp_path / "config"),
        ("NO_COLOR", "1"),
        ("COLUMNS", "120"),
    ):
        monkeypatch.setenv(name, str(value))
    printed: str | None = None
    shell = page == TUTORIAL
    shown = blocks(page)
    for number, block in enumerate(shown):
        assert block.kind in KINDS, block
        if block.kind in ("sh", "python") and not block.mark:
            outputs = [one for one in shown[number + 1 : number + 2] if is_output(one)]
            if not re.search(r"\d", "".join(one.text for one in outputs)) and (tmp_path / RECORDING).exists():
                shutil.copy(short, tmp_path / RECORDING)
            elsewhere = page != TUTORIAL and any(is_the_tutorials(block, one) for one in outputs)
            if elsewhere:
                # The figures are those that the tutorial's block shows, and are found there.
                (tmp_path / "sattrack.toml").write_text(high, encoding="utf-8")
            plain = is_plain(block.text)
            rehearsed = page == TUTORIAL and not whole and block.text.startswith("sattrack rehearse ")
            text = f"{block.text.strip()} --min-alt 60\n" if rehearsed else block.text
            printed = printed_by(text, block.kind, shell or not plain, capfd)
            shell = shell and not plain
            if elsewhere:
                (tmp_path / "sattrack.toml").unlink()
            if elsewhere or rehearsed:
                assert matches(without_figures(outputs[0].text), without_figures(printed)), printed
                printed = None
            if "examples/night.toml --virtual" in block.text:
                assert block.text in NIGHTS.read_text(encoding="utf-8")
                # What is cut short stands in narrower columns.
                alike = str if whole else lambda text: re.sub(" +", " ", without_figures(text))
                assert alike(printed) in [alike(one.text) for one in blocks(NIGHTS)]
        elif is_output(block) and printed is not None:
            assert matches(block.text, printed), (block.text, printed)
            printed = None


def without_figures(text: str) -> str:
    return re.sub(r"\d+(\.\d+)?", "0", text)


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
    assert run(["rehearse", "ISS", *config, "--min-alt", "78", "--json"]) == 0
    parts = {part["name"]: part for part in json.loads(capsys.readouterr().out)["budget"]["parts"]}
    readme = PAGES[0].read_text(encoding="utf-8")
    for name, row in (
        ("elements", "| elements 0.5 days old |"),
        ("clock", "10 ms |"),
        ("delay", "delay, uncertain by 5 ms |"),
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
    for before, after in pairwise(blocks(TUTORIAL)):
        assert before is not after

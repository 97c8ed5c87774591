"""Help: groups, examples that work, options that do something, completion, former names of options."""

from __future__ import annotations

import inspect
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest
from click.shell_completion import ShellComplete

from sattrack.cli.common import SHARED, RenamedOption
from sattrack.cli.main import COMMANDS, GROUPS, cli, run

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[3]
SITE_LESS = {"demo", "sattrack stop", "sattrack replay"}


def commands(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    """Every command and group with its full name."""
    yield name, command
    if isinstance(command, click.Group):
        for one in command.list_commands(click.Context(command)):
            found = command.get_command(click.Context(command), one)
            assert found is not None
            yield from commands(found, f"{name} {one}")


ALL = dict(commands(cli, "sattrack"))
LEAVES = {name: one for name, one in ALL.items() if not isinstance(one, click.Group)}


def examples(command: click.Command) -> list[str]:
    """The command lines under `Examples:` in a command's help."""
    _, _, after = inspect.cleandoc(command.help or "").partition("\b\nExamples:\n")
    return [line.strip() for line in after.split("\n\n")[0].splitlines() if line.strip()]


EXAMPLES = [line for command in ALL.values() for line in examples(command)]
RUNNABLE = ("passes", "ephemeris", "rehearse ISS --pass", "elements check", "run night.toml --dry-run")


def parsed(words: list[str]) -> click.Context:
    """The context of a command line, through its groups; raises click.UsageError."""
    command: click.Command = cli
    name = "sattrack"
    while isinstance(command, click.Group):
        found = command.get_command(click.Context(command), words[0])
        assert found is not None, words
        command, name, words = found, f"{name} {words[0]}", words[1:]
    return command.make_context(name, list(words))


def words_of(line: str) -> list[str]:
    program, *words = shlex.split(line.partition(" > ")[0])
    assert program == "sattrack"
    return words


@pytest.mark.parametrize("name", ALL)
def test_every_command_has_examples_of_itself(name: str) -> None:
    found = examples(ALL[name])
    assert found
    assert all(line.startswith(name) or name == "sattrack biases" for line in found)


@pytest.mark.parametrize("line", dict.fromkeys(EXAMPLES))
def test_an_example_parses(line: str) -> None:
    parsed(words_of(line)).close()


@pytest.mark.parametrize(
    "line",
    [line for line in dict.fromkeys(EXAMPLES) if line.removeprefix("sattrack ").startswith(RUNNABLE)],
)
def test_an_example_that_needs_only_settings_runs(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in ("sattrack.toml", "iss_leiden.tle", "night.toml"):
        shutil.copy(ROOT / "examples" / file, tmp_path)
    if "rehearse" in line:
        settings = tmp_path / "sattrack.toml"
        settings.write_text(
            re.sub("(?m)^min_altitude_deg = .*$", "min_altitude_deg = 60", settings.read_text())
        )
    shutil.copy(ROOT / "examples" / "iss_leiden.tle", tmp_path / "stations.tle")
    monkeypatch.chdir(tmp_path)
    words = words_of(line)
    if "--from" not in words and words[0] != "elements":
        words += ["--clock", "2026-10-02T12:00:00Z"]
    assert run(words) in {0, 1} if words[0] == "rehearse" else run(words) == 0
    assert "Traceback" not in capsys.readouterr().err


def test_every_command_is_in_one_group_of_the_help() -> None:
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(COMMANDS)
    text = cli.get_help(click.Context(cli))
    assert [line[:-1] for line in text.splitlines() if line[:-1] in GROUPS] == list(GROUPS)


@pytest.mark.parametrize("name", [name for name in LEAVES if name != "sattrack init"])
def test_every_command_accepts_the_shared_options_and_shows_those_that_it_uses(name: str) -> None:
    options = {one.opts[0]: one for one in LEAVES[name].params if isinstance(one, click.Option)}
    assert {f"--{one}" for one in SHARED} | {"--config", "--debug"} <= set(options)
    assert not options["--config"].hidden
    assert options["--utc"].hidden is not ("utc" in _used(name))


def _used(name: str) -> set[str]:
    """The shared options of a command that its help shows."""
    text = LEAVES[name].get_help(click.Context(LEAVES[name], info_name=name))
    return {one for one in SHARED if re.search(rf"^  --{one}\b", text, re.MULTILINE)}


def test_help_shows_no_shared_option_that_does_nothing() -> None:
    assert _used("sattrack track") == set(SHARED)
    assert _used("sattrack stop") == {"json"}
    assert _used("sattrack recording export") == set()
    assert _used("sattrack mount slew") == {"site", "clock", "json"}
    assert _used("sattrack mount watch") == {"site", "clock", "utc"}


def test_a_renamed_option_shows_its_present_name_and_takes_the_former_one() -> None:
    renamed = [
        (name, one) for name, each in LEAVES.items() for one in each.params if isinstance(one, RenamedOption)
    ]
    assert {former for _, one in renamed for former in one.opts[1:]} == {
        "--camera-flip",
        "--camera-rotation",
        "--html",
        "--out",
        "--png",
        "--report",
    }
    for name, one in renamed:
        text = LEAVES[name].get_help(click.Context(LEAVES[name], info_name=name))
        assert all(f"{former} " not in text for former in one.opts[1:])
        assert one.opts[0] in text
    assert parsed(["report", "a.mcap", "--png", "x"]).params["folder"] == Path("x")


@pytest.mark.parametrize("name", sorted(LEAVES))
def test_help_fits_80_columns_and_each_option_says_what_it_does(name: str) -> None:
    command = LEAVES[name]
    text = command.get_help(click.Context(command, info_name=name, terminal_width=80))
    assert [line for line in text.splitlines() if len(line) > 80] == []
    shown = [one for one in command.params if isinstance(one, click.Option) and not one.hidden]
    assert [one.opts for one in shown if not one.help] == []


def test_passes_has_one_option_for_the_form_and_takes_the_former_flags() -> None:
    assert parsed(["passes", "--format", "ics"]).params["style"] == "ics"
    assert parsed(["passes", "--ics"]).params["as_ics"]
    for words in (["--format", "csv", "--ics"], ["--json", "--format", "table"], ["--csv", "--ics"]):
        assert run(["passes", *words]) == 2
    assert run(["passes", "--format", "csv", "--csv", "--config", str(ROOT / "examples/sattrack.toml")]) == 0


def completed(*words: str) -> list[str]:
    """What the shell is offered for the last word."""
    shell = ShellComplete(cli, {}, "sattrack", "_SATTRACK_COMPLETE")
    return [one.value for one in shell.get_completions(list(words[:-1]), words[-1])]


def test_the_shell_completes_commands_options_and_satellites() -> None:
    assert completed("tr") == ["track"]
    assert completed("mount", "s") == ["status", "slew", "sync"]
    assert "--mount" in completed("track", "--m")
    elements = ("--elements", str(ROOT / "examples" / "iss_leiden.tle"))
    assert completed("track", *elements, "is") == ["ISS"]
    assert completed("passes", *elements, "255") == ["25544"]
    assert completed("track", "--elements", "celestrak:stations", "x") == []
    assert completed("track", "--elements", str(ROOT / "no-such-file"), "") == []


def test_the_shell_completes_sources_of_elements(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shell = ShellComplete(cli, {}, "sattrack", "_SATTRACK_COMPLETE")
    assert completed("elements", "get", "I")[0] == "ISS"
    assert completed("passes", "--elements", "celestrak:s") == ["celestrak:stations"]
    # With a file that begins so, the shell completes files itself.
    (tmp_path / "Iridium.tle").touch()
    for words in (["elements", "get"], ["passes", "--elements"], ["init", "--elements"], ["bias"]):
        (one,) = shell.get_completions(words, "I")
        assert (one.type, one.value) == ("file", "I")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_script(shell: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from sattrack.cli.main import main; main()"],
        env={"_SATTRACK_COMPLETE": f"{shell}_source", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert f"_SATTRACK_COMPLETE={shell}_complete" in done.stdout


def test_completing_a_command_imports_none() -> None:
    code = """
import sys
from click.shell_completion import ShellComplete
from sattrack.cli.main import cli
found = ShellComplete(cli, {}, "sattrack", "_SATTRACK_COMPLETE").get_completions([], "")
assert len(found) > 10, found
print([name for name in sys.modules if name.startswith("sattrack.cli.") and name != "sattrack.cli.main"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_groff_sets_the_man_page_without_a_warning() -> None:
    page = ROOT / "docs" / "sattrack.1"
    command = ["groff", "-man", "-Kutf8", "-Tutf8", "-ww", "-P-c", str(page)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    plain = re.sub(r".\x08", "", done.stdout)
    assert all(name in plain for name in LEAVES)

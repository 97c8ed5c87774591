"""docs/nights.md against the code: its table, its keys, its example, and the unit that runs a schedule."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import msgspec

from sattrack.cli.run import command
from sattrack.core.errors import InterruptedRunError, TerminatedRunError
from sattrack.schedule import machine, schema
from sattrack.schedule.conditions import BROKE_OFF
from sattrack.schedule.file import load_schedule
from sattrack.schedule.night import NightPass, Result, RunState
from sattrack.schedule.night_processes import as_environment, facts_of
from sattrack.schedule.schema import Terms

if TYPE_CHECKING:
    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "nights.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
UNIT = ROOT / "examples" / "systemd" / "sattrack-night.service"


def test_the_table_is_the_machine_that_runs(tool: Tool, tmp_path: Path) -> None:
    assert tool("nights", "--check").returncode == 0
    table = TEXT.partition("BEGIN machine")[2].partition("END machine")[0]
    assert all(f"| {state.value} |" in table for state in RunState if state is not RunState.STOPPED)
    assert table.count("\n| ") - 1 == sum(row.event.__name__ != "StopAsked" for row in machine.TABLE)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / PAGE.name).write_text(TEXT.replace("| Follow it |", "| Leave it |", 1))
    spoilt = tool("nights", "--check", "--root", str(tmp_path))
    assert spoilt.returncode == 1
    assert "run python -m tools.nights" in spoilt.stderr


def test_the_schedule_of_the_page_loads_and_every_key_is_told(tmp_path: Path) -> None:
    (text,) = (block for kind, block in BLOCKS if kind == "toml")
    file = tmp_path / "night.toml"
    file.write_text(text, encoding="utf-8")
    schedule = load_schedule(file)
    assert schedule.wake is not None
    assert len(schedule.notify) == 2
    told = set(re.findall(r"[a-z_]+", " ".join(re.findall(r"`([^`\n]+)`", TEXT))))
    for kind in (schema.Wake, schema.Notify, schema.Recordings):
        assert {field.encode_name for field in msgspec.structs.fields(kind)} <= told
    assert set(get_args(schema.Notice)) <= told
    assert told >= BROKE_OFF


def test_every_option_of_a_run_and_every_variable_of_a_program_is_told() -> None:
    planning = {"--dry-run", "--plot", "--png", "--ics", "--profile"}
    common = {"--config", "--site", "--elements", "--clock", "--utc", "--debug", "--help", "-h"}
    for parameter in command.params:
        for option in {*parameter.opts} - planning - common:
            if option.startswith("--"):
                assert f"`{option}" in TEXT, option
    from sattrack.runtime import demo_pass

    one = NightPass("k", 1, demo_pass.elements(), 0.0, 1.0, 2.0, 0.0, 50.0, 1.0, 2.0, Terms(), "x")
    for name in as_environment(facts_of(one, "x", "after", Result("done"))):
        assert f"`{name}`" in TEXT, name


def test_the_units_commands_are_some_and_it_restarts_but_after_an_end_or_a_persons_stop() -> None:
    settings = dict(
        line.split("=", 1) for line in UNIT.read_text().splitlines() if "=" in line and line[0] not in "#["
    )
    program, verb, *arguments = shlex.split(settings["ExecStart"])
    assert (program.rpartition("/")[2], verb) == ("sattrack", "run")
    context = command.make_context("run", [*arguments])
    assert str(context.params["file"]) == "night.toml"
    assert shlex.split(settings["ExecStartPre"]) == [program, verb, *arguments, "--check"]
    assert settings["ExecReload"] == "/bin/kill -HUP $MAINPID"
    assert settings["Type"] == "notify"
    assert settings["Restart"] == "always"
    assert set(settings["RestartPreventExitStatus"].split()) == {"0", "2", str(InterruptedRunError.exit_code)}
    ends_well = {str(InterruptedRunError.exit_code), str(TerminatedRunError.exit_code)}
    assert set(settings["SuccessExitStatus"].split()) == ends_well
    assert settings["KillMode"] == "process"

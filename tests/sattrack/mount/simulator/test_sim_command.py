"""`sattrack sim` as it is typed: what it refuses, in one line, and what its process is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import pytest
from simulator_bench import SITE

from sattrack.cli.main import run
from sattrack.mount.simulator.installation import GRAMMAR, parse_faults
from sattrack.mount.simulator.process import SimulatorConfig, make_server
from sattrack.mount.simulator.profile import SimulatorProfile

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[simulator]\ntimer = 'sundial'\n", "my.toml:2: timer is 'sundial'; give one of exact, windows"),
        ("[simulator]\nclock_drift_ppm = 'x'\n", "my.toml:2: clock_drift_ppm is 'x'; give a number"),
        ("[simulator]\nsede = 1\n", "my.toml:2: unknown key 'sede' in [simulator]; did you mean 'seed'?"),
        ("[simulator.servo]\nbandwidth_hz = 0\n", "my.toml:2: bandwidth_hz is 0; it must be above 0"),
        ("[simulator]\nfaults = 'explode'\n", "simulator.faults: explode"),
        ("ra_rate_sign = 2\n", "my.toml:1"),
        ("[ra]\nmax_acceleration_deg_s2 = 0\n", "my.toml:2: ra.max_acceleration_deg_s2 is 0; it must be"),
        ("no_such_thing = 2\n", "no_such_thing"),
        (
            "[[pier_zones]]\nname = 'pier'\ncorners = [[80, 40], [100, 90], [100, 40], [80, 90]]\n",
            "my.toml:3: corners is a line, or has sides that cross, in 'pier'",
        ),
        (
            "[[pier_zones]]\nname = 'pier'\ncorners = [[80.1, 40.1], [90.2, 40.1], [100.3, 40.1]]\n",
            "my.toml:3: corners is a line, or has sides that cross, in 'pier'",
        ),
        ("name = \n", "not a TOML file"),
    ],
)
def test_a_profile_that_says_what_cannot_be_is_refused_in_one_line(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my.toml"
    path.write_text(text)
    assert run(["sim", "--port", "0", "--profile", str(path)]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert "my.toml" in message
    assert message.count("\n") == 1


def test_a_profile_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sim", "--port", "0", "--profile", "/nowhere/my.toml"]) == 2
    assert "/nowhere/my.toml" in capsys.readouterr().err


def test_the_help_shows_every_fault_and_every_example_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sim", "--help"]) == 0
    shown = "".join(capsys.readouterr().out.split())
    for example, meaning in GRAMMAR:
        assert "".join(f"{example}{meaning}".split()) in shown
        assert parse_faults(example) != parse_faults(None)
    assert "silent:SECONDS" in shown
    assert "loss-status=3%" in shown


def test_what_the_process_is_told_comes_through_json_unchanged() -> None:
    config = SimulatorConfig(
        SITE,
        hardware=SimulatorProfile(clock_offset_s=0.3, timer="windows", faults="loss=1%", seed=9),
        faults=parse_faults("silent:20,drive@3s,freeze@1s+2s,delay=3ms"),
    )
    again = msgspec.json.decode(msgspec.json.encode(config), type=SimulatorConfig)
    assert again == config
    server = make_server(again)
    assert server.port > 0
    server.close()

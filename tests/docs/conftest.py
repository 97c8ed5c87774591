"""Tools run in this process; tests by tshark run where it is installed and runs Lua."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest
from literal_datagrams import capture
from tool_runs import Ran, Tool

DISSECTOR = Path(__file__).resolve().parents[2] / "extras" / "wireshark" / "xerxes.lua"
Tshark = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Tool:
    """Run a module of tools/ with options, as `python -m` would, without another process."""

    def run(module: str, *options: str) -> Ran:
        monkeypatch.setattr(sys, "argv", [module, *options])
        capsys.readouterr()
        code = import_module(f"tools.{module}").main()
        return Ran(code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def tshark(tmp_path_factory: pytest.TempPathFactory, program: Callable[[str], str]) -> Tshark:
    """Run tshark with the dissector; a home of its own, so that nobody's plugins and preferences count."""
    tshark = program("tshark")
    home = tmp_path_factory.mktemp("home")

    def run(*options: str, script: Path = DISSECTOR) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [tshark, "-X", f"lua_script:{script}", *options],
            capture_output=True,
            text=True,
            check=False,
            env={"HOME": str(home), "PATH": "/usr/sbin:/usr/bin:/sbin:/bin:/usr/local/bin"},
        )

    # Builds without Lua, and those that refuse it to root, cannot tell anything of the dissector.
    probe, nothing = home / "probe.lua", home / "nothing.pcap"
    probe.write_text('print("Lua" .. " runs")\n', encoding="utf-8")
    nothing.write_bytes(capture([]))
    if "Lua runs" not in run("-r", str(nothing), script=probe).stdout:
        pytest.skip("this tshark runs no Lua")
    return run

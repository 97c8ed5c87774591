"""Tests by tshark run where it is installed and runs Lua."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from literal_datagrams import capture

DISSECTOR = Path(__file__).resolve().parents[2] / "extras" / "wireshark" / "xerxes.lua"
Tshark = Callable[..., "subprocess.CompletedProcess[str]"]


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

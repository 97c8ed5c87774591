"""A track of a satellite that is up just now, as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from programs import elements_of_today, free_port, satellite, site_below

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

START_POINT_AHEAD_S = 60.0


def site_on_the_path() -> str:
    """A site over which the ISS will pass a minute from now, so that it is well up already."""
    return site_below(elements_of_today(), START_POINT_AHEAD_S)


def track_arguments(folder: Path, site: str, port: int, *options: str) -> list[str]:
    elements, _ = satellite(folder, START_POINT_AHEAD_S)
    url = f"xerxes://127.0.0.1:{port}?listen={free_port()}"
    return ["track", "25544", "--mount", url, "--site", site, "--elements", str(elements), *options]


def until(process: subprocess.Popen[str], phase: str) -> dict[str, Any]:
    """Read a stream of views until one shows a phase."""
    assert process.stdout is not None
    for line in process.stdout:
        view: dict[str, Any] = json.loads(line)
        if view.get("phase") == phase:
            return view
    raise AssertionError(f"the run ended before it was {phase}: {process.stderr and process.stderr.read()}")

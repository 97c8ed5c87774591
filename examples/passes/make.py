"""Make this folder's three recordings anew, in virtual time: python examples/passes/make.py

Each is the ISS over Leiden from 60° to 60° on a simulated mount: `clean` on one that is nothing but its
profile, `faults` on one with friction, ripple, a clock that drifts and a link that loses datagrams, and a
camera that sees the satellite run ahead, `edge` on one that takes rates only by their flags' edges.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
PROFILES = HERE.parent / "profiles"
FAULTS = 'faults = "loss=2%,duplicate=1%,reorder=0.5%,delay=4ms~3ms"'
OBSERVATIONS = HERE / "observations.jsonl"


def record(name: str, profile: Path, observations: Path | None = None) -> None:
    """Record one pass."""
    path = HERE / f"{name}.mcap"
    path.unlink(missing_ok=True)
    pass_ = ["25544", "--elements", str(HERE.parent / "iss_leiden.tle"), "--site", "52.1541,4.4908,0"]
    run = ["--clock", "2026-10-02T13:00:00Z", "--min-alt", "60", "--mount", "sim", "--virtual"]
    options = ["--profile", str(profile), "--record", path.name]
    if observations is not None:
        options += ["--observations", "stdin"]
    text = "" if observations is None else observations.read_text()
    command = [sys.executable, "-m", "sattrack", "track", *pass_, *run, *options]
    subprocess.run(command, check=True, cwd=HERE, input=text, text=True)


def main() -> None:
    """Record all three."""
    with tempfile.TemporaryDirectory() as name:
        clean, faults = Path(name) / "clean.toml", Path(name) / "faults.toml"
        clean.write_text('name = "clean"\n')
        text = (PROFILES / "realistic.toml").read_text()
        faults.write_text(text.replace("[simulator]", f"[simulator]\n{FAULTS}", 1))
        record("clean", clean)
        record("faults", faults, OBSERVATIONS)
        record("edge", PROFILES / "edge.toml")


if __name__ == "__main__":
    main()

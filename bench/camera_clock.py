"""A simulated camera's clock, found by the stars in its frames: python bench/camera_clock.py [--clock S ...]

For each hidden error of the clock, `sattrack sim --camera` and `sattrack track --camera` run for some seconds
as a user starts them, in real time, with a satellite of magnitude 7 that is 0.3 s ahead of its elements. It
needs the index of stars for fields of 1.8°, which the first run makes.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from programs import ended, free_port, satellite, sattrack

CULMINATES_AFTER_S = 70.0
AHEAD_S = 0.3
SCALE = 5.0
EXPOSURE_S = 0.05


def run(folder: Path, clock_s: float, seconds: float) -> dict[str, Any]:
    """Return the summary of a run."""
    (folder / "sattrack.toml").touch()
    elements, site = satellite(folder, CULMINATES_AFTER_S)
    same = ["--elements", str(elements), "--site", site, "--config", str(folder / "sattrack.toml")]
    quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    listen = free_port()
    hidden = f"clock={clock_s:g},along={AHEAD_S:g},magnitude=7,fwhm=14,shadow=0"
    simulated = ["--camera", f"{SCALE:g},1280,960", "--hidden", hidden, "--peer", str(listen), "--port", "0"]
    with ExitStack() as stack:
        sim = stack.enter_context(ended(sattrack("sim", *simulated, "--json", *same, **quiet)))
        assert sim.stdout is not None
        places = json.loads(sim.stdout.readline())
        threading.Thread(target=sim.stdout.read, daemon=True).start()
        mount = f"xerxes://127.0.0.1:{places['listening']}?listen={listen}"
        camera = [
            "--camera",
            f"guide={places['camera']}",
            "--scale",
            f"{SCALE:g}",
            "--exposure",
            f"{EXPOSURE_S:g}",
        ]
        followed = ["ISS", "--mount", mount, "--headless", "--stream", "--bias-memory", "off"]
        track = stack.enter_context(ended(sattrack("track", *followed, *camera, *same, **quiet)))
        assert track.stdout is not None
        first_s = None
        for line in track.stdout:
            view = json.loads(line)
            if "summary" in view:
                return dict(view["summary"])
            first_s = view.get("utc_s") if first_s is None else first_s
            if first_s is not None and view.get("utc_s", first_s) - first_s > seconds:
                track.send_signal(signal.SIGINT)
                first_s = float("inf")
    raise SystemExit("the run ended without a summary")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clock", type=float, nargs="+", default=[0.3, 0.0], help="seconds ahead")
    parser.add_argument("--seconds", type=float, default=75.0, help="of each run")
    options = parser.parse_args()
    for clock_s in options.clock:
        with tempfile.TemporaryDirectory() as temporary:
            summary = run(Path(temporary), clock_s, options.seconds)
        clocks = (summary["loop"] or {}).get("clocks", [])
        if not clocks:
            print(f"hidden {clock_s:+.3f} s: no field was solved")
            continue
        found, estimate = clocks[0], summary["estimate"] or {}
        along_s = estimate.get("along_s")
        along = "nothing" if along_s is None else f"{along_s:+.3f} ± {estimate['along_sigma_s']:.3f} s"
        print(
            f"hidden {clock_s:+.3f} s: found {found['clock_s']:+.3f} ± {found['sigma_s']:.3f} s from "
            f"{found['frames']} fields, corrected {found['corrected_s']:+.3f} s; along the track {along} "
            f"({AHEAD_S:+.1f} s hidden)",
            flush=True,
        )


if __name__ == "__main__":
    main()

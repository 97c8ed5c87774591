"""How near the mount keeps over the built-in pass, and how much faster than real time virtual time runs.

python bench/virtual_pass.py [RUNS]

Each run is the whole command as a user types it, in a process of its own, start-up included; the ratio is
the time that the pass takes in reality, from 10° to 10°, over the time that the process took: by the clock,
and by what it used of a processor, without what it waited for others on a machine with more to do.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time

COMMAND = [sys.executable, "-m", "sattrack", "track", "25544", "--virtual", "--mount", "sim", "--json"]


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    ratios, cpu_ratios, summaries = [], [], set()
    for _ in range(runs):
        begun_s, used_s = time.perf_counter(), _processor_s()
        done = subprocess.run(COMMAND, capture_output=True, text=True, check=True)
        took_s, used_s = time.perf_counter() - begun_s, _processor_s() - used_s
        summary = json.loads(done.stdout)["summary"]
        ratios.append(summary["on_target_s"] / took_s)
        cpu_ratios.append(summary["on_target_s"] / used_s)
        summaries.add(done.stdout)
    for word in ("true", "reported"):
        rms, peak = summary[f"{word}_rms_arcsec"], summary[f"{word}_peak_arcsec"]
        print(f"{word} error: {rms:.3f}″ RMS, {peak:.3f}″ peak")
    print(f"acquired {summary['acquired_after_s']:.2f} s after it could be followed")
    for name, found in (("the clock", sorted(ratios)), ("processor's time", sorted(cpu_ratios))):
        median = found[len(found) // 2]
        print(f"faster than real time by {found[0]:.0f} to {found[-1]:.0f}, median {median:.0f}, by {name}")
    print(f"different summaries in {runs} runs: {len(summaries)}")


def _processor_s() -> float:
    """Return what the processes that have ended used of processors, seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()

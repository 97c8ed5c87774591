"""The real Field System drives a simulated mount through the example's antenna program.

`session.sh` refuses a station whose antenna is another than the example's.
"""

from __future__ import annotations

import math
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from sattrack.servers.antenna.antcn import read_position

PROJECT = Path(__file__).parents[4]
EXAMPLE = PROJECT / "examples" / "field-system"
TRANSCRIPT = (EXAMPLE / "transcript.log").read_text()
ON_SOURCE_DEG = 10.0 / 3600.0
STAMP = len("2026.327.18:07:30.47")


def entries(log: str) -> list[str]:
    """Return a log's lines from the first source on, without their instants and what flagr noticed."""
    lines = [line[STAMP:] for line in log.splitlines()]
    first = next(n for n, line in enumerate(lines) if line.startswith(":source="))
    return [line for line in lines[first:] if not line.startswith("#flagr#")]


def shape(line: str) -> str:
    """Return a line with its numbers, and the source of the hour, taken out."""
    line = re.sub(r"(?<=:source=)(?!azel|stow).*", "SOURCE", line)
    return " ".join(re.sub(r"[-+]?\d+(\.\d+)?", "0", line).split())


def tracked(log: str) -> list[tuple[list[float], list[float] | None]]:
    """Return the figures of each `track`: what the antenna said, and what the Field System predicted."""
    found: list[tuple[list[float], list[float] | None]] = []
    for line in entries(log):
        word, *figures = line.removeprefix("#antcn#").split()
        if word == "tr":
            found.append(([float(text) for text in figures], None))
        elif word == "pr":
            found[-1] = (found[-1][0], [float(text) for text in figures])
    return found


def judge(log: str) -> None:
    """See that the antenna went where the Field System's own arithmetic has what it commanded."""
    assert [shape(line) for line in entries(log)] == [shape(line) for line in entries(TRANSCRIPT)]
    source, offset, fixed, satellite, biased = tracked(log)
    for (az, el, az_off, el_off), _ in (source, offset, fixed, satellite, biased):
        assert math.hypot(az_off * math.cos(math.radians(el)), el_off) < ON_SOURCE_DEG
        assert 0.0 <= az < 360.0
    gaps = []
    for one in (source, offset, satellite, biased):
        assert one[1] is not None
        az_off = math.remainder(one[0][0] - one[1][0], 360.0)
        gaps.append((az_off * math.cos(math.radians(one[1][1])), one[0][1] - one[1][1]))
    assert gaps[0] == pytest.approx((0.0, 0.0), abs=0.002)
    across = 0.1 * math.cos(math.radians(offset[0][1]))
    assert gaps[1] == pytest.approx((across, 0.0), abs=0.002)
    assert fixed[0][:2] == pytest.approx((200.0, 50.0), abs=1e-4)
    # Refraction raises the satellite, 0.008° here; it moves north by 0.046° a second, so left is west.
    assert gaps[2] == pytest.approx((0.0, 0.008), abs=0.004)
    assert gaps[3] == pytest.approx((0.25, 0.46), abs=0.02)
    held = [read_position(line.partition("/antenna/")[2]) for line in entries(log) if "/antenna/PS" in line]
    assert held[0].commanded == held[1].commanded
    assert held[1].epoch_s - held[0].epoch_s > 1.9
    assert all(one.servo == "TRACKING" for one in held)


def test_the_transcript_is_of_the_examples_schedule_and_procedures(
    capsys: pytest.CaptureFixture[str],
) -> None:
    judge(TRANSCRIPT)
    runpy.run_path(str(EXAMPLE / "schedule.py"), run_name="__main__")
    planned = [shape(f":{line}") for line in capsys.readouterr().out.splitlines()]
    assert [shape(line) for line in entries(TRANSCRIPT) if line[0] == ":"] == [*planned, ":*end of schedule"]
    page = (PROJECT / "docs" / "howto" / "field-system.md").read_text()
    quoted = re.findall(r"^\d{4}\.\d{3}\..*#antcn#.*$", page, re.MULTILINE)
    assert quoted
    assert set(quoted) <= set(TRANSCRIPT.splitlines())
    library = (EXAMPLE / "proc" / "overhead.prc").read_text()
    for name, body in re.findall(r"define +(\w+) .*?\n(.*?)enddef\n", library, re.DOTALL):
        said = [line for line in entries(TRANSCRIPT) if line.startswith(f"&{name}/")]
        assert said == [f"&{name}/{line}" for line in body.splitlines()], name


@pytest.mark.soak
@pytest.mark.needs("/usr2/fs/bin/fs", "/usr2/st/bin/antcn")
@pytest.mark.skipif(os.geteuid() == 0, reason="the Field System does not run for root")
def test_the_field_system_follows_a_source_and_a_satellite() -> None:
    programs = {"PYTHON": sys.executable, "SATTRACK": f"{sys.executable} -m sattrack"}
    done = subprocess.run(
        ["sh", str(EXAMPLE / "session.sh")],
        env={**os.environ, **programs},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    judge(done.stdout)

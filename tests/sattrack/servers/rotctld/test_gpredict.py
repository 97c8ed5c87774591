"""gpredict itself, on a screen that nobody sees, follows a satellite by our door; where it is installed."""

from __future__ import annotations

import dataclasses
import math
import os
import subprocess
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest
from rotctld_setup import say
from serving import PATIENCE_S, SITE, call, serving_program

from sattrack.runtime import demo_pass
from tle.instants import Utc
from tle.propagator import Propagator
from tle.sources import write_elements

if TYPE_CHECKING:
    from pathlib import Path

    from tle.elements import Elements

PROGRAMS = ("gpredict", "Xvfb", "xdotool")
pytestmark = [
    pytest.mark.soak,
    pytest.mark.needs(*PROGRAMS),
    pytest.mark.filterwarnings("ignore::tle.errors.EarthOrientationWarning"),
]
DISPLAY = ":96"
MENU, ANTENNA_CONTROL = (681, 44), (763, 239)
TRACK, THRESHOLD, ENGAGE = (363, 197), (635, 302), (780, 197)
"""Where gpredict 2.3 has them, its windows at the screen's corner as they are without a window manager."""
FOLLOWED_S = 30.0
NEAR_DEG = 1.0
"""gpredict itself sends positions up to 0.7 s ahead, of what goes 0.3° a second."""


def that_is_up(now_s: float) -> Elements:
    """Return elements of a satellite that rises higher for the next five minutes."""
    found: list[tuple[float, Elements]] = []
    for raan_deg in range(0, 360, 10):
        for anomaly_deg in range(0, 360, 10):
            one = dataclasses.replace(
                demo_pass.elements(),
                name="TESTSAT",
                epoch=Utc(now_s),
                inclination_deg=70.0,
                eccentricity=0.001,
                arg_perigee_deg=0.0,
                raan_deg=float(raan_deg),
                mean_anomaly_deg=float(anomaly_deg),
                mean_motion_rev_day=12.8,
                mean_motion_dot_rev_day2=0.0,
                bstar_per_earth_radius=0.0,
            )
            seen = Propagator(one, SITE)
            begin, middle = (float(seen.at(Utc(now_s + later_s)).alt_deg) for later_s in (60.0, 300.0))
            if 25.0 < begin < middle:
                found.append((middle, one))
    return max(found, key=lambda pair: pair[0])[1]


def write_settings(home: Path, elements: Elements, port: int) -> None:
    """Write what gpredict keeps: a place, a satellite, a module that shows it, a rotator."""
    folder = home / ".config" / "Gpredict"
    for name in ("hwconf", "logs", "modules", "satdata", "trsp"):
        (folder / name).mkdir(parents=True)
    one, two = [line for line in write_elements([elements], "tle").splitlines() if line[:2] in {"1 ", "2 "}]
    number = elements.catalog_number
    (folder / "satdata" / f"{number}.sat").write_text(
        f"[Satellite]\nVERSION=1.1\nNAME=TESTSAT\nNICKNAME=TESTSAT\nWEBSITE=\nTLE1={one}\nTLE2={two}\nSTATUS=1\n"
    )
    (folder / "modules" / "Amateur.mod").write_text(f"[GLOBAL]\nSATELLITES={number};\n")
    (folder / "sample.qth").write_text(
        f"[QTH]\nDESCRIPTION=here\nLOCATION=here\nLAT={SITE.latitude_deg}\nLON={SITE.longitude_deg}\nALT=0\nWX=\n"
    )
    (folder / "hwconf" / "mount.rot").write_text(
        f"[Rotator]\nHost=127.0.0.1\nPort={port}\nMinAz=0\nMaxAz=360\nMinEl=0\nMaxEl=90\nAzType=0\nAzStop=0\n"
    )


def until_it_shows(program: str, environment: dict[str, str]) -> None:
    """Wait until a screen is there, or a program's window on it."""
    search = ["search", "--onlyvisible", "--name", "."]
    ask = ["xdotool", *(["getdisplaygeometry"] if program == "Xvfb" else search)]
    deadline_s = time.monotonic() + 3.0 * PATIENCE_S
    while subprocess.run(ask, env=environment, capture_output=True, check=False).returncode:
        assert time.monotonic() < deadline_s, f"{program} did not start"
    subprocess.run(["xdotool", "sleep", "5"], env=environment, check=True)


def test_gpredict_follows_a_satellite_with_the_mount(tmp_path: Path) -> None:
    elements = that_is_up(time.time())
    truth = Propagator(elements, SITE)
    with ExitStack() as closing:
        served = closing.enter_context(serving_program("rotctld"))
        write_settings(tmp_path, elements, served.port)
        environment = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path / ".config")}
        environment["DISPLAY"] = DISPLAY
        quiet = subprocess.DEVNULL
        for command in (["Xvfb", DISPLAY, "-noreset", "-screen", "0", "1280x900x24"], ["gpredict"]):
            process = subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet)
            closing.callback(process.wait)
            closing.callback(process.kill)
            until_it_shows(command[0], environment)

        def click(place: tuple[int, int], *more: str) -> None:
            x, y = place
            drive = ["xdotool", "mousemove", str(x), str(y), "click", "1", "sleep", "2", *more]
            subprocess.run(drive, env=environment, check=True)

        click(MENU)
        click(ANTENNA_CONTROL)
        click(THRESHOLD, "key", "ctrl+a", "key", "0", "key", "period", "key", "0", "key", "5", "key", "Tab")
        click(TRACK)
        click(ENGAGE)
        served.wait_for(b"client 1 commands")
        line = closing.enter_context(call(served.port))
        deadline_s = time.monotonic() + 2.0 * PATIENCE_S
        near_since_s = math.inf
        while time.monotonic() - near_since_s < FOLLOWED_S:
            # The door itself lets half a minute's questions be a second apart.
            az_deg, el_deg = (float(word) for word in say(line, b"\\pause 1\np").split()[2:])
            seen = truth.at(Utc(time.time()))
            across = math.remainder(az_deg - float(seen.az_deg), 360.0) * math.cos(math.radians(el_deg))
            near = math.hypot(across, el_deg - float(seen.alt_deg)) < NEAR_DEG
            if near and near_since_s == math.inf:
                near_since_s = time.monotonic()
            assert near or near_since_s == math.inf, "it was lost"
            assert near or time.monotonic() < deadline_s, "it was not reached"

"""Stellarium itself, on a screen that is not there: it sees the mount, and sends it to a star."""

from __future__ import annotations

import json
import math
import os
import subprocess
import tempfile
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import erfa
import numpy as np
import pytest
from indi_programs import Indi
from programs import ended, free_port
from serving import serial_line, serving_program, until

from sattrack.servers.alpaca.indi import DEVICE
from sattrack.servers.alpaca.stellarium import GotoReader

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DEFAULTS = Path("/usr/share/stellarium/data/default_cfg.ini")
TELESCOPE = {
    "circles": [],
    "connect_at_startup": True,
    "delay": 500000,
    "equinox": "J2000",
    "name": "sattrack",
}
SCRIPT = 'core.wait(2); core.selectObjectByName("Kochab", false);'
KOCHAB_DEG = (222.676357, 74.155504)
"""Right ascension and declination of J2000, by Hipparcos. At Leiden it never sets."""
CAPELLA = bytes.fromhex("14000000f7f783dcf160060095944e385a03b520")
"""What Stellarium 0.22.2 sent to have the telescope point to Capella."""


def test_the_place_that_stellarium_sent_is_that_of_its_star() -> None:
    ((ra_deg, dec_deg),) = GotoReader().read(CAPELLA) or ()
    # It leaves aberration, 20″, in the place, and adds 27 years of proper motion.
    assert (ra_deg, dec_deg) == pytest.approx((79.1723, 45.9980), abs=0.01)


@contextmanager
def stellarium(program: Callable[[str], str], **telescope: object) -> Iterator[Callable[[], object]]:
    """Run it with one telescope; give what presses its key to slew to what is selected."""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        settings = DEFAULTS.read_text().replace("fullscreen ", "unused ")
        settings = settings.replace(
            "[plugins_load_at_startup]", "[plugins_load_at_startup]\nTelescopeControl=true"
        )
        for path, text in (
            ("config.ini", settings),
            (
                "modules/TelescopeControl/telescopes.json",
                json.dumps({"1": TELESCOPE | telescope, "version": "0.4.1"}),
            ),
            ("scripts/select.ssc", SCRIPT),
        ):
            (home / path).parent.mkdir(parents=True, exist_ok=True)
            (home / path).write_text(text)
        reader, writer = os.pipe()
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        screen = subprocess.Popen(
            [program("Xvfb"), "-displayfd", str(writer), "-screen", "0", "640x480x24"],
            pass_fds=[writer],
            text=True,
            **quiet,  # type: ignore[call-overload]
        )
        with ended(screen):
            os.close(writer)
            with os.fdopen(reader) as told:
                display = f":{told.readline().strip()}"
            environment = {**os.environ, "DISPLAY": display, "HOME": folder, "LIBGL_ALWAYS_SOFTWARE": "1"}
            command = [
                program("stellarium"),
                "-u",
                folder,
                "--full-screen",
                "no",
                "--startup-script",
                "select.ssc",
            ]
            running = subprocess.Popen(command, env=environment, text=True, **quiet)  # type: ignore[call-overload]

            def press() -> None:
                assert running.poll() is None, "Stellarium has ended"
                find = [program("xdotool"), "search", "--name", "Stellarium"]
                found = subprocess.run(find, env=environment, capture_output=True, text=True, check=False)
                for window in found.stdout.split()[-1:]:
                    keys = ["windowfocus", window, "key", "--clearmodifiers", "ctrl+1"]
                    subprocess.run(
                        [program("xdotool"), *keys], env=environment, capture_output=True, check=False
                    )

            with ended(running):
                yield press


@pytest.mark.soak
@pytest.mark.needs("Xvfb", "stellarium", "xdotool", "indi_getprop")
@pytest.mark.parametrize("by", ["its own protocol", "LX200"])
def test_stellarium_sends_the_mount_to_a_star(by: str, program: Callable[[str], str]) -> None:
    with ExitStack() as stack:
        port = free_port()
        if by == "LX200":
            ours, theirs = stack.enter_context(serial_line())
            server, *options = "lx200", "--serial", ours
            at = {"connection": "internal", "device_model": "Meade LX200 (compatible)", "serial_port": theirs}
            at |= {"equinox": "JNow"}
        else:
            server, *options = "stellarium", "--port", str(port)
            at = {"connection": "remote", "host_name": "127.0.0.1"}
        seen = free_port()
        stack.enter_context(serving_program(server, f"indi:{seen}", *options))
        press = stack.enter_context(stellarium(program, tcp_port=port, **at))
        mount = Indi(seen, DEVICE, program)
        mount.set("CONNECTION.CONNECT=On")

        def slews() -> bool:
            press()
            return mount.get("EQUATORIAL_EOD_COORD._STATE") == "Busy"

        until(slews)
        mount.settle()
        here = [mount.number(f"EQUATORIAL_EOD_COORD.{one}") for one in ("RA", "DEC")]
        ra, dec = np.radians(KOCHAB_DEG)
        star = erfa.pnm06a(2440587.5, time.time() / 86400.0) @ erfa.s2c(ra, dec)
        there = erfa.s2c(math.radians(here[0] * 15.0), math.radians(here[1]))
        # Aberration and proper motion are below half a minute of arc together.
        assert math.degrees(erfa.sepp(star, there)) * 3600.0 < 60.0, here

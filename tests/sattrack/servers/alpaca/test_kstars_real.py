"""KStars itself, without a screen: it connects to the served mount, slews it and stops it."""

from __future__ import annotations

import os
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from indi_programs import Indi
from programs import ended
from serving import serving_program, until

from sattrack.mount.model import MountProfile, Slew
from sattrack.mount.requests import Abort
from sattrack.servers.alpaca.indi import DEVICE, MessageReader, ServedIndiDevice
from sattrack.servers.alpaca.lx200 import Asked
from sattrack.servers.alpaca.protocol import TelescopeState
from sattrack.servers.alpaca.telescope import Device, ServedTelescope
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.servers.alpaca.protocol import Order

AT_UTC_S = 1795442304.0
"""2026-11-23T13:58:24Z."""
SENT = b"""<getProperties version='1.7'/>
<enableBLOB device='sattrack'>Never</enableBLOB>
<newTextVector device='sattrack' name='TIME_UTC'>
  <oneText name='UTC'>
      2026-11-23T13:58:24
  </oneText>
  <oneText name='OFFSET'>
      0
  </oneText>
</newTextVector>
<newNumberVector device='sattrack' name='GEOGRAPHIC_COORD'>
  <oneNumber name='LAT'>
      51.468000000000003524
  </oneNumber>
  <oneNumber name='LONG'>
      0
  </oneNumber>
  <oneNumber name='ELEV'>
      -10
  </oneNumber>
</newNumberVector>
<newSwitchVector device='sattrack' name='CONNECTION'>
  <oneSwitch name='CONNECT'>
      On
  </oneSwitch>
</newSwitchVector>
<newNumberVector device='sattrack' name='EQUATORIAL_EOD_COORD'>
  <oneNumber name='RA'>
      15.107685299999999984
  </oneNumber>
  <oneNumber name='DEC'>
      40
  </oneNumber>
</newNumberVector>
<newSwitchVector device='sattrack' name='TELESCOPE_ABORT_MOTION'>
  <oneSwitch name='ABORT'>
      On
  </oneSwitch>
</newSwitchVector>
"""
"""What KStars 3.6.2, set to Greenwich, sent when it was to connect, slew to declination 40° and stop."""


def test_what_kstars_sent_slews_and_stops() -> None:
    site = Site(51.468, 0.0, 0.0)
    telescope = ServedTelescope(Device(MountProfile(), site, "a test", "1.2", "here"))
    telescope.state = TelescopeState(utc_s=AT_UTC_S, heard=True, ra_h=15.0, dec_deg=15.0, tracking=True)
    device = ServedIndiDevice(telescope, -1)
    orders: list[Order] = []
    for message in MessageReader().read(SENT) or ():
        asked = device.take(message, 1, AT_UTC_S)
        orders += asked.orders if isinstance(asked, Asked) else ()
    slew, abort = orders
    assert isinstance(slew, Slew)
    assert (slew.ra_deg, slew.dec_deg) == pytest.approx((226.6152795, 40.0))
    assert abort == Abort()
    assert {device.values(AT_UTC_S)[name][0] for name in ("TIME_UTC", "GEOGRAPHIC_COORD", "CONNECTION")} == {
        "Ok"
    }


@contextmanager
def kstars(program: Callable[[str], str]) -> Iterator[Callable[..., bool]]:
    """Run it on a message bus of its own; give what calls its INDI client and tells whether it went well."""
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / ".config" / "kstarsrc"
        config.parent.mkdir()
        config.write_text("[General]\nRunStartupWizard=false\n[INDI]\nINDIWindowIndependent=true\n")
        environment = {
            **os.environ,
            "HOME": folder,
            "XDG_RUNTIME_DIR": folder,
            "QT_QPA_PLATFORM": "offscreen",
        }
        quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        bus = subprocess.Popen(
            [program("dbus-daemon"), "--session", "--nofork", "--print-address=1"],
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
            **quiet,  # type: ignore[call-overload]
        )
        with ended(bus):
            environment["DBUS_SESSION_BUS_ADDRESS"] = bus.stdout.readline().strip()
            running = subprocess.Popen(
                [program("kstars")],
                stdout=subprocess.DEVNULL,
                env=environment,
                text=True,
                **quiet,  # type: ignore[call-overload]
            )

            def call(method: str, *words: str) -> bool:
                command = [program("dbus-send"), "--session", "--print-reply", "--dest=org.kde.kstars"]
                words = (*command, "/KStars/INDI", f"org.kde.kstars.INDI.{method}", *words)
                done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
                return done.returncode == 0 and "boolean false" not in done.stdout

            with ended(running):
                yield call


@pytest.mark.soak
@pytest.mark.needs("kstars", "dbus-daemon", "dbus-send", "indi_getprop")
def test_kstars_slews_stops_tracks_and_syncs_the_mount(program: Callable[[str], str]) -> None:
    with serving_program("indi") as served, kstars(program) as call:
        mount = Indi(served.port, DEVICE, program)
        until(lambda: call("connect", "string:127.0.0.1", f"int32:{served.port}"))

        def put(kind: str, name: str, element: str, value: str) -> None:
            of = f"string:{DEVICE}", f"string:{name}"
            until(lambda: call(f"set{kind}", *of, f"string:{element}", value))
            until(lambda: call("sendProperty", *of))

        put("Switch", "CONNECTION", "CONNECT", "string:On")
        mount.until("CONNECTION.CONNECT", lambda value: value == "On")
        put("Number", "EQUATORIAL_EOD_COORD", "DEC", "double:60")
        mount.until("EQUATORIAL_EOD_COORD.DEC", lambda value: float(value or 0.0) > 20.0)
        put("Switch", "TELESCOPE_ABORT_MOTION", "ABORT", "string:On")
        mount.until("TELESCOPE_TRACK_STATE.TRACK_OFF", lambda value: value == "On")
        assert mount.number("EQUATORIAL_EOD_COORD.DEC") < 60.0
        mount.settle()
        put("Switch", "TELESCOPE_TRACK_STATE", "TRACK_ON", "string:On")
        mount.until("TELESCOPE_TRACK_STATE.TRACK_ON", lambda value: value == "On")
        put("Switch", "ON_COORD_SET", "SYNC", "string:On")
        mount.until("ON_COORD_SET.SYNC", lambda value: value == "On")
        put("Number", "EQUATORIAL_EOD_COORD", "DEC", "double:61")
        mount.until("EQUATORIAL_EOD_COORD.DEC", lambda value: abs(float(value or 0.0) - 61.0) < 0.01)

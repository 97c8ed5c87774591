"""How INDI's simulated telescope follows a pass: `python bench/indi_mount.py [--hz RATE ...] [--seconds S]`.

indiserver and indi_simulator_telescope run beside `sattrack track --mount indi://…`, all in real time, on a
satellite that is up now. Printed is what the run reports of itself; the telescope has no truth but its
places. Before that, the rates that come of rates of tracking, by the driver's own places over seconds, read
by INDI's command line program; and after the run, how far the telescope still moves.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from programs import ended, free_port, satellite, sattrack

NAME = "Telescope Simulator"
AHEAD_S = 70.0
RATES_ARCSEC_S = (36.0, 360.0, 3600.0, 7200.0)
SPAN_S = 6.0
NORTH_DEG = 35.0
PATIENCE_S = 30.0


class Driver:
    """INDI's simulated telescope behind its server."""

    def __init__(self, closing: ExitStack) -> None:
        self.port = free_port()
        command = ["indiserver", "-p", str(self.port), "-u", f"/tmp/indiserver-{self.port}"]
        quiet = subprocess.DEVNULL
        # The driver keeps its state in the home folder: a telescope once parked begins parked.
        home = {**os.environ, "HOME": closing.enter_context(tempfile.TemporaryDirectory())}
        driver = subprocess.Popen(
            [*command, "indi_simulator_telescope"], env=home, stdout=quiet, stderr=quiet
        )
        closing.callback(driver.wait)
        closing.callback(driver.terminate)
        self.until("CONNECTION.CONNECT")
        self.set("CONNECTION.CONNECT=On")
        self.until("GEOGRAPHIC_COORD.LAT")

    def set(self, text: str) -> None:
        subprocess.run(["indi_setprop", "-p", str(self.port), f"{NAME}.{text}"], check=True)

    def get(self, name: str) -> str:
        command = ["indi_getprop", "-p", str(self.port), "-t", "2", "-1", f"{NAME}.{name}"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()

    def until(self, name: str) -> str:
        until_s = time.monotonic() + PATIENCE_S
        while not (value := self.get(name)):
            if time.monotonic() > until_s:
                raise SystemExit(f"the driver has no {name}")
        return value

    def dec_deg(self) -> tuple[float, float]:
        """Return when declination was read, the middle, and what it was."""
        begun_s = time.monotonic()
        value = float(self.until("EQUATORIAL_EOD_COORD.DEC"))
        return 0.5 * (begun_s + time.monotonic()), value

    def stand_at(self, site: str) -> None:
        latitude, longitude, _ = (float(part) for part in site.split(","))
        self.set(f"GEOGRAPHIC_COORD.LAT={latitude};LONG={longitude % 360.0};ELEV=0")
        self.set("TELESCOPE_TRACK_STATE.TRACK_ON=On")


def rates(driver: Driver) -> None:
    """Print what rates come of rates of tracking, and what an abort alone does to them."""
    driver.set("TELESCOPE_TRACK_MODE.TRACK_CUSTOM=On")
    for rate in RATES_ARCSEC_S:
        for sense in (-1.0, 1.0):
            # A rate that is in force is reversed through 0 only.
            for one in (0.0, sense * rate):
                driver.set(f"TELESCOPE_TRACK_RATE.TRACK_RATE_RA=15.041067;TRACK_RATE_DE={one}")
            time.sleep(1.0)
            first_s, first_deg = driver.dec_deg()
            time.sleep(SPAN_S)
            last_s, last_deg = driver.dec_deg()
            came = 3600.0 * (last_deg - first_deg) / (last_s - first_s)
            print(
                f"  {sense * rate:8.0f}″/s asked for, {came:9.1f}″/s came, {came / (sense * rate):.3f} of it"
            )
    driver.set("TELESCOPE_ABORT_MOTION.ABORT=On")
    first_s, first_deg = driver.dec_deg()
    time.sleep(2.0)
    last_s, last_deg = driver.dec_deg()
    came = 3600.0 * (last_deg - first_deg) / (last_s - first_s)
    print(f"  after TELESCOPE_ABORT_MOTION alone it goes on at {came:.0f}″/s")
    driver.set("TELESCOPE_TRACK_RATE.TRACK_RATE_RA=15.041067;TRACK_RATE_DE=0")
    driver.set("TELESCOPE_TRACK_MODE.TRACK_SIDEREAL=On")


def northern(folder: Path) -> tuple[Path, str]:
    """Return elements of an orbit like the ISS', and a northern site that it passes over soon.

    South of the equator the driver turns declination the other way.
    """
    for anomaly_deg in range(0, 360, 15):
        elements, site = satellite(folder, AHEAD_S, mean_anomaly_deg=float(anomaly_deg))
        if float(site.split(",")[0]) > NORTH_DEG:
            return elements, site
    raise SystemExit("no such orbit")


def follow(driver: Driver, hz: float, seconds: float) -> None:
    """Follow a satellite; print what the run reports, and what moves afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        elements, site = northern(Path(folder))
        settings = Path(folder) / "radio.toml"
        settings.write_text("[safety]\noptical = false\n")
        driver.stand_at(site)
        end = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(time.time() + seconds))
        url = f"indi://127.0.0.1:{driver.port}/{NAME.replace(' ', '%20')}?hz={hz:g}"
        words = ("track", "25544", "--elements", str(elements), "--site", site, "--mount", url, "--to", end)
        more = ("--config", str(settings), "--headless", "--json")
        with ended(sattrack(*words, *more, stdin=subprocess.DEVNULL)) as run:
            out, err = run.communicate()
    told = json.loads(out)["summary"] if out else {"ended_by": err.strip()}
    rms, peak = told.get("reported_rms_arcsec"), told.get("reported_peak_arcsec")
    error = "never on it" if rms is None else f"{rms:.0f}″ RMS, {peak:.0f}″ peak"
    followed = f"{told.get('on_target_s')} s on target, ended by {told['ended_by']}"
    print(f"  {hz:g} times a second: reported {error}, {followed}")
    (first_s, first_deg), (last_s, last_deg) = driver.dec_deg(), driver.dec_deg()
    rate = 3600.0 * (last_deg - first_deg) / (last_s - first_s)
    print(
        f"  mount stopped: {told.get('mount_stopped')}; it moves at {rate:.2f}″/s in declination afterwards"
    )
    if told.get("message"):
        print(f"  {told['message']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hz", type=float, nargs="*", default=[10.0])
    parser.add_argument("--seconds", type=float, default=150.0)
    options = parser.parse_args()
    if shutil.which("indiserver") is None:
        raise SystemExit("indiserver is not installed: apt install indi-bin")
    with ExitStack() as closing:
        driver = Driver(closing)
        driver.set("GEOGRAPHIC_COORD.LAT=52;LONG=4.5;ELEV=0")
        driver.set("TELESCOPE_TRACK_STATE.TRACK_ON=On")
        driver.set(f"EQUATORIAL_EOD_COORD.RA={driver.until('EQUATORIAL_EOD_COORD.RA')};DEC=30")
        time.sleep(20.0)
        print("rates of tracking, as the driver's places show them:")
        rates(driver)
        print("a pass, followed in real time:")
        for hz in options.hz:
            follow(driver, hz, options.seconds)
    print(f"with a load of {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


if __name__ == "__main__":
    main()

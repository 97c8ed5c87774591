"""How near satellites are followed with simulated Alpaca telescopes, by the truth of their axes.

python bench/alpaca_mount.py            every variant calibrated, then the practice pass, in virtual time
python bench/alpaca_mount.py --live [N] the first N with every part in a process of its own, 10 minutes each
python bench/alpaca_mount.py --alpyca   what a request takes with alpyca, and with aiohttp
python bench/alpaca_mount.py --two-axes the practice pass with a stranger's alt-azimuth telescope, and its
                                        drives on other axes, in virtual time; `--two-axes --live` over HTTP

In virtual time the ways of HTTP requests, the unevenness of the gateway's turns and the telescope's servos
are simulated; live they are this machine's. Each variant is calibrated first, and its profile used.

The stranger (`strangers/alpaca_two_axes.py`) was written from the ASCOM standard alone, and says itself where
its tube points. The equatorial one is the measure: what its driver allows, the others may have. Directions
within KEYHOLE_DEG of the first axis are counted apart.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
import time
import urllib.request
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import msgspec
from alpaca_harness import calibrate, follow, follow_two_axes
from programs import satellite, simulated_telescope
from strangers.alpaca_two_axes import Parameters

from sattrack.control.target import sky_error
from sattrack.core.figures import RunningError
from sattrack.mount.simulator.alpaca_telescope import TelescopeSettings
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site
from tle.sources import load_elements

STRANGER = Path(__file__).parent / "strangers" / "alpaca_two_axes.py"
CULMINATES_AFTER_S = 370.0
"""From the beginning of a live variant: time for the calibration."""
REQUESTS = 50
KEYHOLE_DEG = 15.0
CALIBRATES_S = 130.0
"""From the beginning of a live pass with two axes to its culmination: time to find the axes, and to rise."""
AXES = {"alt-azimuth": (0.0, 90.0), "equatorial": (0.0, None), "tilted by 20°": (60.0, 70.0)}
"""Azimuth and altitude of the first axis; None is the latitude."""
VARIANTS: dict[str, tuple[TelescopeSettings, float]] = {
    "as the standard has it": (TelescopeSettings(), 10.0),
    "additive": (TelescopeSettings(additive=True), 10.0),
    "both axes turned": (TelescopeSettings(ra_sign=-1, dec_sign=-1), 10.0),
    "additive, RA turned, gains 1.03, 0.96": (
        TelescopeSettings(additive=True, ra_sign=-1, ra_gain=1.03, dec_gain=0.96),
        10.0,
    ),
    "J2000": (TelescopeSettings(system="j2000"), 10.0),
    "not tracking before": (TelescopeSettings(tracking=False), 10.0),
    "soft servos, 1.5 Hz, 2 °/s²": (TelescopeSettings(servo_hz=1.5, acceleration_deg_s2=2.0), 10.0),
    "latency 60 ms": (TelescopeSettings(latency_s=0.06), 10.0),
    "latency 30 ± 10 ms either way": (TelescopeSettings(jitter_s=0.01), 10.0),
    "1 % of the ways 100 ms longer": (TelescopeSettings(held_up_share=0.01), 10.0),
    "asked 5 times a second": (TelescopeSettings(), 5.0),
    "MoveAxis every 250 ms at most, ?hz=3.5": (TelescopeSettings(move_interval_s=0.25), 3.5),
    "the same, asked 10 times a second": (TelescopeSettings(move_interval_s=0.25), 10.0),
    "rates 0.002 to 0.3 and 0.5 to 4 °/s": (
        TelescopeSettings(rates_deg_s=((0.002, 0.3), (0.5, 4.0))),
        10.0,
    ),
    "latency 200 ± 10 ms, ?hz=4": (TelescopeSettings(latency_s=0.2, jitter_s=0.005), 4.0),
    "places 0 to 200 ms old": (TelescopeSettings(cache_s=0.2), 10.0),
}
LIVE: dict[str, tuple[TelescopeSettings, float]] = {
    "as the standard has it": (TelescopeSettings(), 10.0),
    "all turned and J2000, a request a property": (
        TelescopeSettings(system="j2000", additive=True, ra_sign=-1, dec_sign=-1, device_state=False),
        10.0,
    ),
}
"""Live, no part of what is slow is simulated."""


def words(name: str, true: RunningError, reported: RunningError | None, ended_by: str | None) -> str:
    told = "" if reported is None else f", reported {reported.rms_arcsec or float('nan'):7.2f}″ RMS"
    rms, peak = true.rms_arcsec or float("nan"), true.peak_arcsec or float("nan")
    return f"{name:<42} true {rms:7.2f}″ RMS, {peak:7.2f}″ peak{told}, ended by {ended_by}"


def virtual() -> None:
    for name, (settings, hz) in VARIANTS.items():
        profile, _ = calibrate(settings, hz)
        result = follow(settings, profile, hz)
        print(words(name, result.true, result.reported, result.ended_by), flush=True)


def live(name: str, settings: TelescopeSettings, hz: float) -> None:
    """Calibrate and follow as a user would; the truth is what the telescope's process tells afterwards."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        elements, where = satellite(folder, CULMINATES_AFTER_S)
        site = Site.parse(where)
        high = 0.75 * site.latitude_deg
        stands = {"latitude_deg": site.latitude_deg, "longitude_deg": site.longitude_deg, "dec_deg": high}
        settings = msgspec.structs.replace(settings, **stands, hour_angle_deg=-20.0)
        config = folder / "sattrack.toml"
        # Whatever the time of day, the Sun is in nobody's way.
        config.write_text("[safety]\noptical = false\n")
        with simulated_telescope(msgspec.json.encode(settings)) as (_, port):
            url, profile = f"alpaca://127.0.0.1:{port}/0?hz={hz:g}", folder / "telescope.toml"
            common = ("--mount", url, "--site", where, "--config", str(config))
            sattrack("mount", "calibrate", *common, "--out", str(profile), "--yes")
            track = ("track", "25544", "--elements", str(elements), *common, "--profile", str(profile))
            summary = json.loads(sattrack(*track, "--headless", "--json", "--min-alt", "15"))["summary"]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/simulator/truth", timeout=60) as answer:
                rows = json.loads(answer.read())
        air = Refraction.standard(site.height_m)
        target = Propagator(load_elements(str(elements)).accepted[0], site, refraction=air)
        begun, ended = on_satellite(summary)
        true = RunningError()
        for utc_s, ra_deg, dec_deg in rows:
            if begun < utc_s < ended:
                true.add(sky_error(utc_s, ra_deg, dec_deg, target.at(Utc(utc_s))).total_arcsec)
        print(words(name, true, None, summary["ended_by"]), end=", ")
        print(
            f"reported {summary['reported_rms_arcsec']:.2f}″ RMS, {summary['on_target_s']:.0f} s", flush=True
        )


def of_axes(azimuth_deg: float, altitude_deg: float | None, latitude_deg: float) -> Parameters:
    return Parameters(
        latitude_deg=latitude_deg,
        pole_azimuth_deg=azimuth_deg,
        pole_altitude_deg=latitude_deg if altitude_deg is None else altitude_deg,
        # Away from the first axis, which `calibrate --axes` asks for.
        azimuth_deg=0.0 if altitude_deg is None and latitude_deg < 0.0 else 180.0,
    )


def told_apart(name: str, errors: list[tuple[float, float]], ended_by: str | None) -> None:
    """Print errors (arcseconds) by how far the tube was from the first axis (degrees)."""
    sides = []
    for near in (False, True):
        own = [error for error, from_pole_deg in errors if (from_pole_deg < KEYHOLE_DEG) is near]
        figures = RunningError()
        for error in own:
            figures.add(error)
        sides.append((len(own), figures.rms_arcsec or 0.0, figures.peak_arcsec or 0.0))
    (_, rms, peak), (count, near_rms, _) = sides
    keyhole = "" if not count else f", {near_rms:.2f}″ RMS within {KEYHOLE_DEG:g}° of the first axis"
    print(f"{name:<16} true {rms:6.2f}″ RMS, {peak:7.2f}″ peak{keyhole}, ended by {ended_by}", flush=True)


def two_axes() -> None:
    """Follow the practice pass with a stranger's axes, in virtual time."""
    for name, (azimuth, altitude) in AXES.items():
        result = follow_two_axes(of_axes(azimuth, altitude, TelescopeSettings().latitude_deg))
        told_apart(name, result.of_first_axis, result.ended_by)


def live_two_axes() -> None:
    """Find the axes and follow over HTTP, as a user would; the stranger tells the truth as it goes."""
    for name, (azimuth, altitude) in AXES.items():
        errors, ended_by = followed_live(azimuth, altitude)
        told_apart(name, errors, ended_by)


def followed_live(azimuth_deg: float, altitude_deg: float | None) -> tuple[list[tuple[float, float]], str]:
    """Return errors (arcseconds) with the angle from the first axis (degrees), and what ended the run."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        elements, below = satellite(folder, CALIBRATES_S)
        passing = Site.parse(below)
        # Beside the ground track it culminates at some 45°: where azimuth's cables are not in the way, but
        # not beside a celestial pole.
        beside_deg = -4.0 if altitude_deg is None and passing.latitude_deg < 0.0 else 4.0
        where = f"{passing.latitude_deg + beside_deg:.3f},{passing.longitude_deg:.3f},0"
        site = Site.parse(where)
        config = folder / "sattrack.toml"
        config.write_text("[safety]\noptical = false\n")
        parameters = of_axes(azimuth_deg, altitude_deg, site.latitude_deg)
        parameters = replace(parameters, longitude_deg=site.longitude_deg, elevation_m=0.0)
        program = [sys.executable, str(STRANGER), "--truth", "--parameters", json.dumps(asdict(parameters))]
        with subprocess.Popen(
            program, stdin=subprocess.PIPE, stdout=(folder / "truth").open("w"), text=True
        ) as stranger:
            try:
                port = _port(folder / "truth")
                common = ("--mount", f"alpaca://127.0.0.1:{port}/0", "--site", where, "--config", str(config))
                profile = folder / "telescope.toml"
                sattrack("mount", "calibrate", "--axes", *common, "--out", str(profile), "--yes")
                track = ("track", "25544", "--elements", str(elements), *common, "--profile", str(profile))
                shown = sattrack(*track, "--headless", "--json", "--min-alt", "15")
            finally:
                stranger.kill()
        summary = json.loads(shown)["summary"]
        rows = [json.loads(line) for line in (folder / "truth").read_text().splitlines()[1:-1]]
        loaded = load_elements(str(elements)).accepted[0]
    target = Propagator(loaded, site, refraction=Refraction.standard(site.height_m))
    begun, ended = on_satellite(summary)
    errors = []
    for row in rows:
        if begun < row["utc_s"] < ended:
            seen = target.at(Utc(row["utc_s"]))
            error = sky_error(row["utc_s"], row["ra_deg"], row["dec_deg"], seen).total_arcsec
            errors.append((error, 90.0 - abs(row["second_deg"])))
    return errors, str(summary["ended_by"])


def on_satellite(summary: dict[str, Any]) -> tuple[float, float]:
    """Return between which instants (UTC seconds) a run was on its satellite, as it told.

    Its stop at the end takes up to 3 s. A run that lost the satellite meanwhile is no measure.
    """
    if summary["rejoining_s"]:
        raise SystemExit(f"the run was off the satellite for {summary['rejoining_s']:.0f} s: {summary}")
    ended = float(Utc.parse(summary["ended_utc"]).unix_s)
    return ended - float(summary["on_target_s"]), ended - 3.0


def _port(path: Path) -> int:
    """Return the port that a stranger has written first."""
    until = time.monotonic() + 30.0
    while time.monotonic() < until:
        line = path.read_text().partition("\n")
        if line[1]:
            return int(json.loads(line[0])["port"])
        time.sleep(0.05)
    raise SystemExit("the stranger's telescope did not start")


def sattrack(*arguments: str) -> str:
    program = [sys.executable, "-m", "sattrack", *arguments]
    done = subprocess.run(program, check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"sattrack {' '.join(arguments)}: {done.returncode}: {done.stderr}")
    return done.stdout


def requests() -> None:
    """Tell what one request takes by either library, and how many connections it makes."""
    from alpaca.telescope import Telescope

    from sattrack.mount.alpaca.gateway_process import AlpacaClient
    from sattrack.mount.alpaca.link import AlpacaAddress

    quick = TelescopeSettings(latency_s=0.0, jitter_s=0.0)
    with simulated_telescope(msgspec.json.encode(quick)) as (_, port):
        device = Telescope(f"127.0.0.1:{port}", 0)
        device.Connected = True
        tell("alpyca, one after the other", lambda: [device.RightAscension for _ in range(REQUESTS)])

        async def ask() -> None:
            async with AlpacaClient(AlpacaAddress("127.0.0.1", port, 0)) as client:
                for _ in range(REQUESTS):
                    await client.get("rightascension")

        tell("aiohttp, one after the other", lambda: asyncio.run(ask()))


def tell(name: str, act: Any) -> None:
    began_s, cpu_s = time.perf_counter(), time.process_time()
    act()
    each = 1000.0 / REQUESTS
    elapsed, cpu = (time.perf_counter() - began_s) * each, (time.process_time() - cpu_s) * each
    print(f"{name}: {elapsed:.2f} ms a request, {cpu:.2f} ms of this processor")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--live", type=int, nargs="?", const=len(LIVE), help="in real time, so many")
    parser.add_argument("--alpyca", action="store_true", help="what a request takes")
    parser.add_argument("--two-axes", action="store_true", help="a stranger's axes: alt-azimuth and others")
    options = parser.parse_args()
    if options.alpyca:
        requests()
    elif options.two_axes:
        (live_two_axes if options.live else two_axes)()
    elif options.live:
        for name in list(LIVE)[: options.live]:
            live(name, *LIVE[name])
    else:
        virtual()
    return 0


if __name__ == "__main__":
    sys.exit(main())

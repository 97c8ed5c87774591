"""How near the antenna interface keeps a mount to a satellite: `python bench/antenna.py [--latency]`.

The built-in pass, in virtual time: by trajectory designations at 1 Hz and at 10 Hz, and by elements on the
controller's side; a step of a tenth of a beam; and, over TCP on loopback, how fast PS is answered.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import signal
import socket
import subprocess
import sys
import time
from decimal import Decimal
from typing import NamedTuple

from antenna_harness import SITE, VirtualAntenna, rms, separation_arcsec

from sattrack.core.clock import SystemClock
from sattrack.runtime import demo_pass
from sattrack.servers.antenna.antcn import Antcn, AntcnRun, epoch_utc_s
from sattrack.servers.antenna.controller import PositionStatus, position_message
from sattrack.servers.antenna.protocol import NS, TCP_CHARACTER_TIME_OUT_S, encode
from sattrack.servers.antenna.trajectory import AxisRange, AxisState
from tle.instants import Utc
from tle.propagator import Propagator

RISE_UTC_S = Utc.parse("2026-10-02T13:01:56Z").unix_s
SET_UTC_S = Utc.parse("2026-10-02T13:08:54Z").unix_s
SETTLED_S = 15.0
DELAY_S = 0.0003


class Figures(NamedTuple):
    rms_arcsec: float
    peak_arcsec: float
    reported_rms_arcsec: float | None
    stopped: bool | None


def satellite() -> Propagator:
    return Propagator(demo_pass.elements(), SITE)


def hadec(propagator: Propagator, utc_s: float) -> tuple[float, float]:
    seen = propagator.at(Utc(utc_s))
    return float(seen.ha_deg), float(seen.dec_deg)


def azel(propagator: Propagator, utc_s: float) -> tuple[float, float]:
    seen = propagator.at(Utc(utc_s))
    return float(seen.az_deg), float(seen.alt_deg)


def own_error(tangent: bool, begin_utc_s: float = RISE_UTC_S, end_utc_s: float = SET_UTC_S) -> float:
    """Return the RMS error of straight lines over a second themselves, arcseconds."""
    propagator, errors, interval_s = satellite(), [], 1.0
    begin = begin_utc_s
    while begin < end_utc_s:
        first = propagator.at(Utc(begin))
        last = propagator.at(Utc(begin + interval_s))
        rates = (first.ra_rate_deg_s, first.dec_rate_deg_s)
        if not tangent:
            moved = math.remainder(last.ra_deg - first.ra_deg, 360.0), last.dec_deg - first.dec_deg
            rates = moved[0] / interval_s, moved[1] / interval_s
        for i in range(10):
            ahead = interval_s * (i + 0.5) / 10
            there = propagator.at(Utc(begin + ahead))
            guess = first.ra_deg + rates[0] * ahead, first.dec_deg + rates[1] * ahead
            errors.append(separation_arcsec(*guess, there.ra_deg, there.dec_deg))
        begin += interval_s
    return rms(errors)


def designated(
    interval_s: float, axes: str = "hadec", begin_utc_s: float = RISE_UTC_S, end_utc_s: float = SET_UTC_S
) -> Figures:
    """Follow the pass, or a part of it, by trajectory designations."""
    antenna = VirtualAntenna(begin_utc_s - 20.0, axes=axes)
    propagator = satellite()
    where = hadec if axes == "hadec" else azel
    run = AntcnRun(
        Antcn(TCP_CHARACTER_TIME_OUT_S),
        lambda utc_s: where(propagator, utc_s),
        begin_utc_s,
        end_utc_s,
        15.0,
        antenna.begin_utc_s,
        interval_s=interval_s,
    )

    def to_controller(now: float, data: bytes) -> None:
        if data:
            antenna.call(now + DELAY_S, lambda at: arrive(at, data))

    def arrive(now: float, data: bytes) -> None:
        answer, _ = antenna.station.receive_command(data, now)
        if answer:
            antenna.call(now + DELAY_S, lambda at: hear(at, answer))

    def hear(now: float, data: bytes) -> None:
        run.receive(data, now)
        turn(now, again=False)

    def turn(now: float, again: bool = True) -> None:
        to_controller(now, run.tick(now))
        if again and not run.finished:
            antenna.call(max(run.due_utc_s(now), now + 0.001), turn)

    antenna.call(antenna.begin_utc_s, lambda now: to_controller(now, run.begin(now)))
    antenna.call(antenna.begin_utc_s + 0.001, turn)
    antenna.run_until(end_utc_s + 5.0)
    errors = true_errors(antenna, propagator, begin_utc_s, end_utc_s)
    return Figures(rms(errors), max(errors), run.reported.rms_arcsec, run.mount_stopped)


def by_elements(begin_utc_s: float = RISE_UTC_S, end_utc_s: float = SET_UTC_S) -> Figures:
    """Follow the pass, or a part of it, by elements on the controller's side."""
    antenna = VirtualAntenna(begin_utc_s)
    antenna.run_for(1.0)
    number = demo_pass.elements().catalog_number
    for line, text in (("1", demo_pass.LINE_1), ("2", demo_pass.LINE_2)):
        assert antenna.say(f"TLE {line} {number} {text}") == "TLE ACK"
    assert antenna.say(f"SAT {number}") == "SAT ACK"
    antenna.run_until(end_utc_s)
    errors = true_errors(antenna, satellite(), begin_utc_s, end_utc_s)
    return Figures(rms(errors), max(errors), None, None)


def true_errors(
    antenna: VirtualAntenna, propagator: Propagator, begin_utc_s: float, end_utc_s: float
) -> list[float]:
    """Return the errors of the simulated axes themselves against the satellite, arcseconds."""
    errors = []
    for truth in antenna.truths:
        if begin_utc_s + SETTLED_S < truth.utc_s < end_utc_s - 1.0:
            there = propagator.at(Utc(truth.utc_s))
            errors.append(separation_arcsec(truth.ra_deg, truth.dec_deg, there.ra_deg, there.dec_deg))
    return errors


def step_settles_s(step_arcsec: float = 30.0, within_arcsec: float = 1.0) -> float:
    """Return how long after its designation a step is settled, the latest of ten, seconds."""
    antenna = VirtualAntenna(RISE_UTC_S)
    antenna.run_for(1.0)
    rate, worst = 0.0041780746, 0.0
    antenna.say(f"TD 20 40 {rate} 0")
    antenna.run_for(15.0)
    for trial in range(10):
        antenna.run_for(2.0 + 0.0137 * trial)
        began = antenna.now_utc_s
        path = antenna.station.controller.path
        assert path is not None
        here = path.at(round(began * 1e6) * 1000)
        sign = 1 if trial % 2 else -1
        antenna.say(f"TD {here.first_deg:.9f} {here.second_deg + sign * step_arcsec / 3600.0:.9f} {rate} 0")
        path = antenna.station.controller.path
        antenna.run_for(2.0)
        for truth in antenna.truths:
            wanted = path.at(round(truth.utc_s * NS))
            ra_deg = antenna.sky.sidereal_deg(truth.utc_s) - wanted.first_deg
            off = separation_arcsec(truth.ra_deg, truth.dec_deg, ra_deg, wanted.second_deg)
            if truth.utc_s > began and off > within_arcsec:
                worst = max(worst, truth.utc_s - began)
    return worst


def peak_rate_deg_s() -> float:
    """Return how fast the satellite goes at most."""
    propagator = satellite()
    there = [propagator.at(Utc(RISE_UTC_S + second)) for second in range(int(SET_UTC_S - RISE_UTC_S))]
    return max(
        math.hypot(t.ra_rate_deg_s * math.cos(math.radians(t.dec_deg)), t.dec_rate_deg_s) for t in there
    )


def longest_position_ms(baud: int) -> float:
    """Return how long a response to PS is on the line, all its figures as long as they get."""
    far = AxisState(-179.999999994, -89.999999994, -5.12345678901, -5.12345678901)
    told = PositionStatus(far, far, Decimal("86399.999999"), remote=True, servo="TRACKING")
    return len(encode(position_message(told, AxisRange(-180.0, -200.0, 200.0, -90.0, 90.0)))) * 1e4 / baud


def latency_ms(times: int = 3000) -> tuple[list[float], list[float]]:
    """Return, sorted, how long PS takes over TCP on loopback, ms: from latch to first character, and in all.

    The mount is being moved meanwhile. The latch is the epoch that is told, by the same machine's clock.
    """
    site = f"{SITE.latitude_deg},{SITE.longitude_deg},{SITE.height_m}"
    command = [sys.executable, "-m", "sattrack", "serve", "antenna", "--mount", "sim", "--site", site]
    process = subprocess.Popen(
        [*command, "--port", "0", "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    port = json.loads(process.stdout.readline())["listening"]
    chance, clock = random.Random(1), SystemClock()
    from_latch, in_all = [], []
    with socket.create_connection(("127.0.0.1", port)) as line:
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line.sendall(encode("TD 30 30 0.01 0.01"))
        line.recv(100)
        for _ in range(times):
            time.sleep(chance.uniform(0.0, 0.01))
            sent_s = time.monotonic()
            line.sendall(encode("PS"))
            first = line.recv(4096)
            came_s = time.monotonic()
            in_all.append((came_s - sent_s) * 1000.0)
            epoch_s = float(first.split()[11])
            from_latch.append((clock.utc_s(came_s) - epoch_utc_s(epoch_s, clock.utc_s(came_s))) * 1000.0)
    process.send_signal(signal.SIGINT)
    process.wait()
    return sorted(from_latch), sorted(in_all)


def told(figures: Figures) -> str:
    words = f"true error {figures.rms_arcsec:.3f}″ RMS, {figures.peak_arcsec:.3f}″ peak"
    if figures.reported_rms_arcsec is not None:
        words += f"; reported {figures.reported_rms_arcsec:.3f}″ RMS"
    return words


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--latency", action="store_true", help="only how fast PS is answered")
    if not parser.parse_args().latency:
        tracking()
    from_latch, in_all = latency_ms()
    for words, times in (("latch to first character", from_latch), ("command to response", in_all)):
        middle, most = times[len(times) // 2], times[int(0.99 * len(times))]
        print(f"PS over TCP, {words}: {middle:.2f} ms median, {most:.2f} ms p99, {times[-1]:.2f} ms most")
    print(f"of {len(in_all)}, with a load of {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def tracking() -> None:
    """Print how near the simulated mount was kept."""
    print(f"the pass: up to {peak_rate_deg_s():.2f} °/s on the sky")
    print(f"straight lines over 1 s: chords {own_error(False):.2f}″ RMS, tangents {own_error(True):.2f}″ RMS")
    print(f"designated at 1 Hz:  {told(designated(1.0))}")
    print(f"designated at 10 Hz: {told(designated(0.1))}")
    print(f"as azimuth and elevation, 1 Hz: {told(designated(1.0, 'azel'))}")
    print(f"by elements:         {told(by_elements())}")
    print(f"the longest PS takes {longest_position_ms(9600):.0f} ms on a line of 9600 baud, 7E1")
    print(f"a step of 30″ is settled to 1″ within {step_settles_s():.2f} s")


if __name__ == "__main__":
    sys.exit(main())

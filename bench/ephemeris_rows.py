"""How long a million rows of CPF, OEM and SP3 take to read, and one instant to look up.

python bench/ephemeris_rows.py [ROWS]
"""

from __future__ import annotations

import sys
import time

import numpy as np

from tle.earth import EarthOrientation
from tle.formats.ephemerides import parse_ephemerides

RUNS = 3
TURN, RADIUS = 1.0779e-3, 7_000_000.0


def orbit(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return seconds, places (m) and velocities (m/s) of a round orbit, a second apart."""
    t = np.arange(float(count))
    c, s = np.cos(TURN * t), np.sin(TURN * t)
    place = RADIUS * np.stack([c, 0.5 * s, np.sqrt(0.75) * s], axis=1)
    velocity = RADIUS * TURN * np.stack([-s, 0.5 * c, np.sqrt(0.75) * c], axis=1)
    return t, place, velocity


def cpf(count: int) -> bytes:
    t, place, _ = orbit(count)
    days, seconds = 61100 + (t // 86400).astype(int), t % 86400
    last = np.datetime64("2026-03-01T00:00:00") + np.timedelta64(count - 1, "s")
    end = str(last).replace("-", " ").replace("T", " ").replace(":", " ")
    rows = "\n".join(
        f"10 0 {d} {s:13.6f}  0 {x:17.3f} {y:17.3f} {z:17.3f}"
        for d, s, (x, y, z) in zip(days.tolist(), seconds.tolist(), place.tolist(), strict=True)
    )
    head = "H1 CPF  2  XYZ 2026 03 01 00 060 1 round\nH2 2600101 1234 99999 2026 03 01 00 00 00 "
    return f"{head}{end}     1 1 1 1 0 0 1\nH9\n{rows}\n99\n".encode()


def oem(count: int) -> bytes:
    t, place, velocity = orbit(count)
    stamps = (np.datetime64("2026-03-01T00:00:00.000") + (t * 1000).astype("timedelta64[ms]")).astype(str)
    rows = "\n".join(
        f"{stamp} {x:.9f} {y:.9f} {z:.9f} {u:.12f} {v:.12f} {w:.12f}"
        for stamp, (x, y, z), (u, v, w) in zip(
            stamps.tolist(), (place / 1e3).tolist(), (velocity / 1e3).tolist(), strict=True
        )
    )
    meta = (
        "OBJECT_NAME = ROUND\nOBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\nREF_FRAME = GCRF\n"
        "TIME_SYSTEM = UTC\n"
        f"START_TIME = {stamps[0]}\nSTOP_TIME = {stamps[-1]}\n"
    )
    return f"CCSDS_OEM_VERS = 2.0\nMETA_START\n{meta}META_STOP\n{rows}\n".encode()


def sp3(count: int) -> bytes:
    """Return an SP3 of a hundred satellites."""
    epochs = count // 100
    t, place, _ = orbit(epochs)
    spin = 7.292115e-5 * t
    x, y, z = place.T
    c, s = np.cos(spin), np.sin(spin)
    place = np.stack([x * c + y * s, y * c - x * s, z], axis=1)
    names = [f"G{k:02d}" for k in range(1, 100)] + ["E01"]
    head = [f"#cP2026  3  1  0  0  0.00000000 {epochs:7d} ORBIT IGS20 HLM  XYZ"]
    head.append("## 2408      0.00000000     1.00000000 61100 0.0000000000000")
    for k in range(0, 102, 17):
        some = "".join(names[k : k + 17]).ljust(51)
        head.append(f"+  {'100' if k == 0 else '   '}   {some}")
    head += ["%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc", "/* made"]
    for k in range(epochs):
        head.append(f"*  2026  3  1 {k // 3600:2d} {k // 60 % 60:2d} {k % 60:11.8f}")
        x, y, z = (place[k] / 1e3).tolist()
        head += [f"P{name}{x:14.6f}{y:14.6f}{z:14.6f}      0.000000" for name in names]
    return ("\n".join([*head, "EOF"]) + "\n").encode()


def measured(data: bytes, name: str) -> tuple[float, float, int]:
    """Return a processor's seconds to read a text, how often it could be split into lines, and objects."""
    begun = time.process_time()
    data.split(b"\n")
    split = time.process_time() - begun
    begun = time.process_time()
    objects = len(parse_ephemerides(data, name))
    seconds = time.process_time() - begun
    return seconds, seconds / split, objects


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    for name, make in (("CPF", cpf), ("OEM", oem), ("SP3", sp3)):
        data = make(count)
        seconds, splits, objects = min(measured(data, name) for _ in range(RUNS))
        size = f"{count} rows, {len(data) / 1e6:.0f} MB, {objects} objects"
        print(f"{name}: {size}, read in {seconds:.2f} s, {splits:.0f} times what splitting its lines takes")
    found = parse_ephemerides(oem(10_000))
    states = found[0].states(EarthOrientation.installed())
    first = float(found[0].spans[0][0].unix_s)
    begun = time.process_time()
    for k in range(2000):
        states.at(first + 3.7 * k, 0.0)
    each = (time.process_time() - begun) / 2000
    print(f"one instant: {each * 1e6:.0f} µs")


if __name__ == "__main__":
    main()

"""How long a million rows of CPF, OEM, SP3 and tables take to read, and one instant to look up.

Of Starlink's operator it is a hundredth of the rows: each has a covariance.

python bench/ephemeris_rows.py [ROWS]
"""

from __future__ import annotations

import sys
import time

import numpy as np

from tle.earth import EarthOrientation
from tle.formats.ephemerides import parse_ephemerides
from tle.site import Site

RUNS = 3
TURN, RADIUS = 1.0779e-3, 7_000_000.0
SITE = Site(52.1541, 4.4908, 0.0)


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


def stamps_of(t: np.ndarray) -> list[str]:
    """Return times of so many seconds since the beginning."""
    stamps = np.datetime64("2026-03-01T00:00:00.000") + (t * 1000).astype("timedelta64[ms]")
    return stamps.astype(str).tolist()


def states(count: int) -> list[tuple[str, list[float]]]:
    """Return times, and places (km) with velocities (km/s)."""
    t, place, velocity = orbit(count)
    rows = np.concatenate([place, velocity], axis=1) / 1e3
    return list(zip(stamps_of(t), rows.tolist(), strict=True))


def metadata(first: str, last: str) -> dict[str, str]:
    return {
        "OBJECT_NAME": "ROUND",
        "OBJECT_ID": "2026-001A",
        "CENTER_NAME": "EARTH",
        "REF_FRAME": "GCRF",
        "TIME_SYSTEM": "UTC",
        "START_TIME": first,
        "STOP_TIME": last,
    }


def oem(count: int) -> bytes:
    rows = states(count)
    text = "\n".join(
        f"{stamp} {x:.9f} {y:.9f} {z:.9f} {u:.12f} {v:.12f} {w:.12f}" for stamp, (x, y, z, u, v, w) in rows
    )
    meta = "\n".join(f"{name} = {value}" for name, value in metadata(rows[0][0], rows[-1][0]).items())
    return f"CCSDS_OEM_VERS = 2.0\nMETA_START\n{meta}\nMETA_STOP\n{text}\n".encode()


def xml(count: int) -> bytes:
    rows = states(count)
    text = "".join(
        f"<stateVector>\n<EPOCH>{stamp}</EPOCH>\n<X>{x:.9f}</X>\n<Y>{y:.9f}</Y>\n<Z>{z:.9f}</Z>\n"
        f"<X_DOT>{u:.12f}</X_DOT>\n<Y_DOT>{v:.12f}</Y_DOT>\n<Z_DOT>{w:.12f}</Z_DOT>\n</stateVector>\n"
        for stamp, (x, y, z, u, v, w) in rows
    )
    meta = "".join(f"<{name}>{value}</{name}>" for name, value in metadata(rows[0][0], rows[-1][0]).items())
    head = '<?xml version="1.0"?>\n<oem id="CCSDS_OEM_VERS" version="2.0"><header></header><body><segment>'
    tail = "</data></segment></body></oem>"
    return f"{head}<metadata>{meta}</metadata><data>\n{text}{tail}\n".encode()


def starlink(count: int) -> bytes:
    rows = states(count // 100)
    lines = ["created:2026-03-01 00:00:00 UTC"]
    lines.append(f"ephemeris_start: ephemeris_stop:{rows[-1][0].replace('T', ' ')} UTC step_size:1")
    lines += ["ephemeris_source:blend", "UVW"]
    covariance = ["1e-8 0 4e-8 0 0 4e-8 0", "0 0 1e-12 0 0 0 0", "1e-12 0 0 0 0 0 1e-12"]
    for stamp, state in rows:
        clock = stamp[11:].replace(":", "")
        lines += ["2026060" + clock + "".join(f" {value:.10f}" for value in state), *covariance]
    return ("\n".join(lines) + "\n").encode()


def table(count: int) -> bytes:
    t = np.arange(float(count))
    places = zip(stamps_of(t), (52.0 + 1e-6 * t).tolist(), (4.0 + 1e-6 * t).tolist(), strict=True)
    rows = "".join(f"{stamp}Z,{lat:.6f},{lon:.6f},9000.0\n" for stamp, lat, lon in places)
    return f"utc,lat_deg,lon_deg,height_m\n{rows}".encode()


def directions(count: int) -> bytes:
    """Return a table of directions among the stars."""
    t = np.arange(float(count))
    places = zip(stamps_of(t), (1e-3 * t % 360.0).tolist(), (20.0 * np.sin(1e-5 * t)).tolist(), strict=True)
    rows = "".join(f"{stamp}Z,{ra:.6f},{dec:.6f}\n" for stamp, ra, dec in places)
    return f"utc,ra_deg,dec_deg\n{rows}".encode()


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
    objects = len(parse_ephemerides(data, name, SITE))
    seconds = time.process_time() - begun
    return seconds, seconds / split, objects


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    kinds = {"CPF": cpf, "OEM": oem, "OEM in XML": xml, "SP3": sp3, "Starlink": starlink}
    kinds |= {"table of places": table, "table of RA/Dec": directions}
    for name, make in kinds.items():
        data = make(count)
        seconds, splits, objects = min(measured(data, name) for _ in range(RUNS))
        rows = count // 100 if make is starlink else count
        size = f"{rows} rows, {len(data) / 1e6:.0f} MB, {objects} objects"
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

"""An OEM and a CPF of a satellite whose elements are at hand: SGP4's places and their derivatives (TEME)."""

from __future__ import annotations

from sgp4.api import Satrec

from tle.elements import Elements
from tle.instants import UNIX_EPOCH_JD, Utc

ISS = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)


def elements() -> Elements:
    return Elements.from_tle(*ISS, name="ISS (ZARYA)")


def oem_text(start: str, minutes: int, step_s: float = 60.0) -> str:
    """Return rows from `start` on, in UTC."""
    record = Satrec.twoline2rv(*ISS)
    first = float(Utc.parse(start).unix_s)
    times = [first + step_s * k for k in range(int(minutes * 60.0 / step_s) + 1)]
    rows = []
    for unix_s in times:
        day, second = divmod(unix_s, 86400.0)
        before, place, after = (
            record.sgp4(UNIX_EPOCH_JD + day, (second + later) / 86400.0)[1] for later in (-0.5, 0.0, 0.5)
        )
        velocity = [b - a for a, b in zip(before, after, strict=True)]
        numbers = " ".join(f"{value:.9f}" for value in (*place, *velocity))
        rows.append(f"{Utc(unix_s).isoformat('milliseconds')[:-1]} {numbers}")
    ends = (Utc(times[0]).isoformat("milliseconds")[:-1], Utc(times[-1]).isoformat("milliseconds")[:-1])
    return (
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-10-02T00:00:00\nORIGINATOR = SGP4\nMETA_START\n"
        "OBJECT_NAME = ISS\nOBJECT_ID = 1998-067-A\nCENTER_NAME = EARTH\nREF_FRAME = TEME\n"
        "TIME_SYSTEM = UTC\n"
        f"START_TIME = {ends[0]}\nSTOP_TIME = {ends[1]}\nMETA_STOP\n" + "\n".join(rows) + "\n"
    )


def cpf_text(start: str, minutes: int, sic: int = 1155) -> str:
    """Return rows as a laser station has them, without an error; TEME as true of date, 20″ off at most."""
    begin, end = Utc.parse(start), Utc.parse(start).plus(60.0 * minutes)
    words = [
        each.isoformat("seconds")[:-1].replace("T", "-").replace(":", "-").split("-") for each in (begin, end)
    ]
    rows = []
    for line in oem_text(start, minutes).split("META_STOP\n")[1].splitlines():
        time, *numbers = line.split()
        days, second = divmod(float(Utc.parse(f"{time}Z").unix_s), 86400.0)
        places = " ".join(f"{1000.0 * float(number):.3f}" for number in numbers[:3])
        rows.append(f"10 0 {days + 40587:.0f} {second:.6f} 0 {places}")
    return "\n".join(
        (
            "H1 CPF 2 US 2026 10 02 00 275 1 station NONE",
            f"H2 9806701 {sic} 25544 {' '.join(words[0])} {' '.join(words[1])} 60 1 1 1 0 0 1",
            *("H9", *rows, "99", ""),
        )
    )

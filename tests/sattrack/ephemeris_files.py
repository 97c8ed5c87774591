"""An OEM of a satellite whose elements are at hand: SGP4's places, and their derivatives, in TEME."""

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

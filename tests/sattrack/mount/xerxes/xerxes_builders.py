"""What the tests of the client's session and of the simulated mount share: units, motions, spoilt datagrams.

The codec is used on the strength of test_datagrams.py, which holds it against bytes written by hand.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

from hypothesis import strategies as st

from sattrack.mount.model import Cleared

if TYPE_CHECKING:
    from sattrack.mount.model import Motion
    from sattrack.mount.xerxes.datagrams import Command
    from sattrack.mount.xerxes.session import Session

T0 = 1_790_000_000.0
"""Some second of UTC, POSIX."""
PERIOD_S = 0.05
"""Both ends send at 20 Hz."""
SIDEREAL_DEG_S = 360.0 * 1.00273790935 / 86400.0
"""The sky's turn in hour angle; sidereal days in a day of UT1, Explanatory Supplement."""
TIC_DEG = 360.0 / 2**26
SIDEREAL_DTICS_S = 7789
"""The paper's figure for the tracking rate, encoder tics per second x 10."""


def want(session: Session, motion: Motion) -> None:
    session.apply(Cleared(motion))


def dtics(rate_deg_s: float) -> int:
    """A drive rate as the status tells it."""
    return round(rate_deg_s / TIC_DEG * 10)


def moving_flags(command: Command) -> list[str]:
    """Names of the flags that are up and make a mount move."""
    return [name for name in ("slew", "move_ra", "move_dec") if getattr(command, name)]


def unused_flags(command: Command) -> list[str]:
    """Names of the flags that are up though no motion asks for them."""
    names = ("find_home", "park", "pulse_guide", "sync", "spare")
    return [name for name in names if getattr(command, name)]


def turned(angle_deg: float) -> float:
    """An angle's equal in -180 to 180."""
    return math.remainder(angle_deg, 360.0)


def trapezoid_s(distance_deg: float, rate_deg_s: float, acceleration_deg_s2: float) -> float:
    """Shortest time from rest to rest over a distance within a rate and an acceleration."""
    if distance_deg < rate_deg_s**2 / acceleration_deg_s2:
        return 2 * math.sqrt(distance_deg / acceleration_deg_s2)
    return distance_deg / rate_deg_s + rate_deg_s / acceleration_deg_s2


def spoilt(valid: bytes) -> st.SearchStrategy[bytes]:
    """A datagram to be refused: noise, or a valid one cut, lengthened or with one header bit wrong."""
    return st.one_of(
        st.binary(max_size=400).filter(lambda data: not data.startswith(valid[:8])),
        st.integers(0, len(valid) - 1).map(lambda length: valid[:length]),
        st.binary(min_size=1, max_size=100).map(lambda tail: valid + tail),
        st.integers(0, 63).map(
            lambda bit: _patched(valid, bit // 8, bytes([valid[bit // 8] ^ 1 << bit % 8]))
        ),
    )


def overwritten(valid: bytes) -> st.SearchStrategy[bytes]:
    """A valid datagram's header and length with some of its body written over, by bytes or odd doubles."""
    odd = st.floats(width=64).map(lambda x: struct.pack("<d", x))
    patch = st.one_of(
        st.tuples(st.integers(8, len(valid) - 1), st.binary(min_size=1, max_size=16)),
        st.tuples(st.sampled_from(range(8, len(valid) - 8, 8)), odd),
    )

    def apply(patches: list[tuple[int, bytes]]) -> bytes:
        data = valid
        for start, piece in patches:
            data = _patched(data, start, piece)
        return data

    return st.lists(patch, min_size=1, max_size=6).map(apply)


def _patched(data: bytes, start: int, piece: bytes) -> bytes:
    return (data[:start] + piece + data[start + len(piece) :])[: len(data)]

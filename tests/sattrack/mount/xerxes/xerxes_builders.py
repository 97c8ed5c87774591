"""What the tests of the client's session and of the simulated mount share: units, motions, spoilt datagrams,
and a client that is told by hand what the mount says.

The codec is used on the strength of test_datagrams.py, which holds it against bytes written by hand.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Any

import msgspec
from hypothesis import strategies as st

from sattrack.mount.model import Cleared, MountProfile, MoveAxes, Slew, Status, Stop
from sattrack.mount.xerxes.datagrams import decode_command, encode_status
from sattrack.mount.xerxes.session import Session

if TYPE_CHECKING:
    from sattrack.mount.model import Motion, Readings, StatusSample
    from sattrack.mount.xerxes.datagrams import Command
    from sattrack.mount.xerxes.flags import SlewState

T0 = 1_790_000_000.0
"""Some second of UTC, POSIX."""
PERIOD_S = 0.05
"""Both ends send at 20 Hz."""
SIDEREAL_DEG_S = 360.0 * 1.00273790935 / 86400.0
"""The sky's turn in hour angle; sidereal days in a day of UT1, Explanatory Supplement."""
TIC_DEG = 360.0 / 2**26
SIDEREAL_DTICS_S = 7789
"""The paper's figure for the tracking rate, encoder tics per second x 10."""


TRACKING = Status(
    altitude_deg=50.0,
    azimuth_deg=180.0,
    dec_deg=20.0,
    ra_h=10.0,
    sidereal_h=9.0,
    ra_rate_dtics_s=SIDEREAL_DTICS_S,
    site_latitude_deg=48.0,
    site_longitude_deg=11.0,
)
SEEN_AT_REST_STATUSES = 12
"""Half a second of positions, and one more."""
A = Slew(78.75, 12.25)
B = Slew(150.0, -33.375)
MOVE = MoveAxes(-1.25, -0.75)


class Client:
    """A session between statuses made by hand and datagrams read by eye."""

    def __init__(self, profile: MountProfile | None = None) -> None:
        self.session = Session(profile or MountProfile())
        self.now = T0
        self.counter = 0
        self.turned_deg = 0.0
        """How far the hour angle axis has turned."""

    def status(self, counter: int | None = None, readings: Readings | None = None, **fields: Any) -> bytes:
        self.counter = self.counter + 1 if counter is None else counter
        gone_deg = (self.now - T0) * SIDEREAL_DEG_S
        fields.setdefault("sidereal_h", TRACKING.sidereal_h + gone_deg / 15.0)
        fields.setdefault("ra_h", TRACKING.ra_h + (gone_deg - self.turned_deg) / 15.0)
        return encode_status(msgspec.structs.replace(TRACKING, counter=self.counter, **fields), readings)

    def hear(self, **fields: Any) -> StatusSample | None:
        """Give the session the mount's next status."""
        self.now += PERIOD_S
        self.turned_deg += fields.get("ra_rate_dtics_s", SIDEREAL_DTICS_S) / 10 * TIC_DEG * PERIOD_S
        return self.session.receive(self.status(**fields), self.now)

    def rest(self, **fields: Any) -> None:
        """Have the mount's positions show rest for as long as it takes to be seen."""
        for _ in range(SEEN_AT_REST_STATUSES):
            self.hear(**{"ra_rate_dtics_s": 0} | fields)

    def send(self) -> Command:
        """Take the session's next datagram."""
        data = self.session.compose()
        assert len(data) == 82
        return decode_command(data)

    def slew_state(self) -> SlewState:
        return self.session.slew_state

    def asks(self, motion: Motion) -> Command:
        want(self.session, motion)
        return self.send()

    def stopped_by_abort(self) -> None:
        """Have a stop asked for, acknowledged and finished."""
        assert self.asks(Stop()).abort
        self.hear(ack_abort=True, ra_rate_dtics_s=0)
        assert not self.send().abort
        assert not self.session.stopped
        self.rest()
        assert self.session.stopped


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

"""A simulated mount on the bench: `put` fills its mailbox, `turn` runs its loop."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from sattrack.mount.model import MountProfile, Status
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition, Truth
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command

T0 = 1_790_000_000.0
PERIOD_S = 0.05
SIDEREAL_DEG_S = 360.0 * 1.00273790935 / 86400.0
"""Sidereal days in a day of UT1, Explanatory Supplement."""
TIC_DEG = 360.0 / 2**26
GUIDE_DEG_S = 350.0 * TIC_DEG
"""3500 in tenths of encoder tics per second."""
SITE = SimulatedSite(48.0, 11.0, 520.0)
START = StartPosition(-30.0, 20.0)


class Seen(NamedTuple):
    """One turn, from outside and from inside."""

    status: Status
    truth: Truth


class Bench:
    """One mount, its time told by us."""

    def __init__(
        self,
        profile: MountProfile | None = None,
        start: StartPosition = START,
        site: SimulatedSite = SITE,
        **hardware: Any,
    ) -> None:
        self.mount = SimulatedMount(profile or MountProfile(), site, start, SimulatorProfile(**hardware))
        self.now = T0
        self.turn()

    def put(self, **fields: Any) -> None:
        assert self.mount.receive(encode_command(Command(**fields)))

    def turn(self, period_s: float = PERIOD_S) -> Seen:
        self.now += period_s
        data, truth = self.mount.tick(self.now)
        self.seen = Seen(decode_status(data), truth)
        return self.seen

    def obeys(self, **fields: Any) -> Seen:
        self.put(**fields)
        return self.turn()

    def run(self, seconds: float, **fields: Any) -> list[Seen]:
        return [self.obeys(**fields) for _ in range(round(seconds / PERIOD_S))]

    def coast(self, seconds: float) -> list[Seen]:
        return [self.turn() for _ in range(round(seconds / PERIOD_S))]

    @property
    def status(self) -> Status:
        return self.seen.status

    @property
    def truth(self) -> Truth:
        return self.seen.truth

    @property
    def axis_rates(self) -> tuple[float, float]:
        """Of the hour angle axis and of the declination that it points to."""
        return SIDEREAL_DEG_S - self.truth.ra_rate_deg_s, self.truth.dec_rate_deg_s

    def target(self, east_deg: float, north_deg: float) -> dict[str, float]:
        ra_deg, dec_deg = self.truth.ra_deg + east_deg, self.truth.dec_deg + north_deg
        return {"target_ra_h": ra_deg % 360.0 / 15.0, "target_dec_deg": dec_deg}


def moving(ra: float | None, dec: float | None) -> dict[str, Any]:
    """Fields of MoveAxis, None for a flag that stays down."""
    return {
        "move_ra": ra is not None,
        "move_dec": dec is not None,
        "move_ra_rate_deg_s": ra or 0.0,
        "move_dec_rate_deg_s": dec or 0.0,
    }


def turned(angle_deg: float) -> float:
    """An angle's equal in -180 to 180."""
    return math.remainder(angle_deg, 360.0)

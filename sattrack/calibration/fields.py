"""Whether the drive rates and the Slewing flag of a mount's statuses tell what its axes do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.xerxes.datagrams import DTICS_S_PER_DEG_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.calibration.script import LegHeard, Observations
    from sattrack.calibration.statuses import Heard

RateFields = Literal["true", "meaningless"]
SlewingField = Literal["true", "quiet", "meaningless"]

MOST_OF = 0.9
RATE_WITHIN = 0.1
"""Part of the commanded rate by which a field may be off it and still tell it."""
SETTLED_SHARE = 0.5
"""The last of each motion, of which so much is taken, is steady."""


def rate_fields(seen: Observations) -> RateFields | None:
    """Return whether the drive rates follow the axes; None where no axis moved.

    They must tell the rate of a steady motion, and still tell it in the status that acknowledges a stop: the
    axis has not begun to brake then.
    """
    right = [_tells_rate(seen, leg, place) for leg in seen.legs for place in _steady(leg)]
    at_stops = [_tells_rate(seen, leg, leg.end) for leg in seen.legs]
    if not right:
        return None
    return "true" if _mostly(right) and _mostly(at_stops) else "meaningless"


def slewing_field(seen: Observations) -> SlewingField | None:
    """Return whether Slewing is up while an axis moves and down while both rest; None where no axis moved."""
    heard = seen.log.heard
    moving = [heard[place].status.slewing for leg in seen.legs for place in _steady(leg)]
    resting = [not heard[leg.first - 1].status.slewing for leg in seen.legs]
    if not moving:
        return None
    if not (_mostly(moving) and _mostly(resting)):
        return "meaningless"
    return "true" if _mostly([heard[leg.end].status.slewing for leg in seen.legs]) else "quiet"


def _mostly(ones: Sequence[bool]) -> bool:
    return sum(ones) >= MOST_OF * len(ones)


def _steady(leg: LegHeard) -> range:
    return range(leg.end - int(SETTLED_SHARE * (leg.end - leg.first)), leg.end)


def _tells_rate(seen: Observations, leg: LegHeard, place: int) -> bool:
    """Tell whether a status has the rate of the axis over the statuses before it."""
    heard: list[Heard] = seen.log.heard
    status = heard[place].status
    before, here = heard[place - 4], heard[place]
    seconds = here.mount_s - before.mount_s
    if leg.axis == "dec":
        told, moved = status.dec_rate_dtics_s, here.dec_deg - before.dec_deg
    else:
        told, moved = status.ra_rate_dtics_s, here.hour_angle_deg - before.hour_angle_deg
    within = max(RATE_WITHIN * abs(leg.rate_deg_s), 0.5 * SIDEREAL_RATE_DEG_S)
    # Beyond the pole, and by a convention of the mount's own, an axis' rate may have the other sign.
    return abs(abs(told) / DTICS_S_PER_DEG_S - abs(moved) / seconds) < within

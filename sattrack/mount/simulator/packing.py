"""Fields of a status that follow from the axes, and the types in which this mount packs the doubtful ones."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sattrack.core.errors import BadInputError
from sattrack.mount.xerxes.datagrams import DTICS_S_PER_DEG_S, Readings

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.mount.simulator.axis import Axis


def packed_readings(profile: MountProfile) -> Readings:
    """Return the types that this mount gives the doubtful fields; those it does not name are Appendix A's.

    Raises BadInputError, naming it, for a field that is none of them.
    """
    names = Readings.__slots__
    for name in profile.readings:
        if name not in names:
            raise BadInputError(
                f"readings.{name}: no doubtful field of a status; they are {', '.join(names)}"
            )
    return replace(Readings(), **profile.readings)


def drive_rate_dtics_s(axis: Axis) -> int:
    """Return an axis' rate as the status tells it, encoder tics per second x 10."""
    return round(axis.velocity_deg_s * DTICS_S_PER_DEG_S)


def drive_current_10ma(axis: Axis) -> int:
    """Return a drive's current as the status tells it, 10 mA."""
    return round(axis.current_a * 100.0)

"""A satellite that is followed, for Alpaca's clients: what they may see of it, its offsets, its failures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.control.bias_view import bias_fields
from sattrack.servers.alpaca.faults import Fault, Number
from sattrack.servers.alpaca.messages import FollowedState
from sattrack.views.messages import OffsetBy

if TYPE_CHECKING:
    from sattrack.control.engine import Engine
    from sattrack.servers.alpaca.messages import BiasOrder

SEEN_AFTER_S = 1.0
"""After so long, an offset that is asked for counts among those in force."""
SAME_OFFSET = 1e-9


def offset(engine: Engine | None, order: BiasOrder, now_utc_s: float) -> None:
    """Change the offsets of the satellite that is followed; raises Fault where there is none, or no such."""
    if engine is None:
        raise Fault(Number.INVALID_OPERATION, "no satellite is followed: TrackSatellite first")
    before = engine.tracker.steering.biases.totals(now_utc_s + SEEN_AFTER_S)
    wanted = (("along_s", order.along_s, before[0]), ("cross_deg", order.cross_deg, before[1]))
    for index, (what, value, had) in enumerate(wanted):
        if value is None:
            continue
        engine.operate(OffsetBy(what, "add" if order.add else "set", value), now_utc_s)
        goal = had + value if order.add else value
        has = engine.tracker.steering.biases.totals(now_utc_s + SEEN_AFTER_S)[index]
        if abs(has - goal) > SAME_OFFSET:
            words = engine.tracker.steering.refusal or "the offset was not taken"
            raise Fault(Number.INVALID_VALUE, words)


def receive_or_stop(engine: Engine, data: bytes, arrival_utc_s: float) -> None:
    """Have an engine take a datagram; one that fails stops the mount."""
    try:
        engine.receive(data, arrival_utc_s)
    except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
        engine.fail(str(error))


def tick_or_stop(engine: Engine, now_utc_s: float) -> bytes:
    """Have an engine make the datagram to send now; one that fails stops the mount."""
    try:
        return engine.tick(now_utc_s)
    except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
        engine.fail(str(error))
        return engine.tick(now_utc_s)


def followed(engine: Engine, now_utc_s: float) -> FollowedState:
    """Return what clients may see of a satellite that is followed."""
    elements, tracker = engine.spec.propagator.elements, engine.tracker
    bias = bias_fields(tracker, now_utc_s + SEEN_AFTER_S)
    error = tracker.error
    return FollowedState(
        name=elements.label,
        catalog_number=elements.catalog_number,
        phase=engine.phase,
        along_s=bias["bias_along_goal_s"],
        cross_deg=bias["bias_cross_goal_deg"],
        error_arcsec=None if error is None or not math.isfinite(error.total_arcsec) else error.total_arcsec,
        acquired=tracker.acquired_utc_s is not None,
    )

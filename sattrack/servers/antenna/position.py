"""The response to PS: where the antenna is to be and where it is, latched at one instant.

"Ideal Field System Antenna Interface", section 4.1.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sattrack.servers.antenna.transactions import OMITTED

if TYPE_CHECKING:
    from decimal import Decimal

    from sattrack.servers.antenna.trajectory import AxisRange, AxisState, ExactState


@dataclass(frozen=True, slots=True)
class Position:
    """What a position status tells; None where there is no trajectory, or the axes are not heard."""

    commanded: AxisState | ExactState | None
    actual: AxisState | None
    epoch_s: Decimal
    """Seconds of the UTC day."""
    remote: bool
    servo: Literal["IDLE", "SLEWING", "TRACKING"]


def position_message(position: Position, axes: AxisRange) -> str:
    """Return the response to PS: positions to 1e-8°, rates to 1e-10 °/s, the epoch to 1 µs."""
    commanded, commanded_wrap = _state_fields(position.commanded, axes)
    actual, actual_wrap = _state_fields(position.actual, axes)
    return " ".join(
        (
            "PS",
            *commanded[:2],
            *actual[:2],
            *commanded[2:],
            *actual[2:],
            commanded_wrap,
            actual_wrap,
            f"{position.epoch_s:.6f}",
            "REMOTE" if position.remote else "LOCAL",
            position.servo,
        )
    )


def _state_fields(state: AxisState | ExactState | None, axes: AxisRange) -> tuple[list[str], str]:
    if state is None:
        return [OMITTED] * 4, OMITTED
    _, wrap = axes.wrap_of(float(state.first_deg))
    return [
        f"{state.first_deg - 360 * wrap:.8f}",
        f"{state.second_deg:.8f}",
        f"{state.first_rate_deg_s:.10f}",
        f"{state.second_rate_deg_s:.10f}",
    ], str(wrap)

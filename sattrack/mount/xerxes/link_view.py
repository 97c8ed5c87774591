"""The health of the link as it is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.views.run import LinkView

if TYPE_CHECKING:
    from sattrack.mount.xerxes.link import LinkHealth, LinkState


def link_view(
    health: LinkHealth,
    state: LinkState,
    age_s: float | None,
    delay_ms: float | None = None,
    clock_offset_s: float | None = None,
) -> LinkView:
    """Return what anyone who looks may see of a link; `age_s` is that of the last status, None before one."""
    return LinkView(
        state=state.value,
        age_s=None if age_s is None else max(0.0, age_s),
        sent=health.sent,
        received=health.received,
        lost=health.lost,
        late=health.late,
        duplicate=health.duplicate,
        rejected=health.rejected,
        rate_hz=health.rate_hz,
        jitter_ms=None if health.jitter_s is None else health.jitter_s * 1000.0,
        restarts=health.restarts,
        strangers=health.strangers,
        doubled_launches=health.doubled_launches,
        foreign_acks=health.foreign_acks,
        delay_ms=delay_ms,
        clock_offset_s=clock_offset_s,
    )

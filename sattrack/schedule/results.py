"""What becomes of a pass, of all goes at it. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.schedule.night import Followed, Go, Happening, NightPass, Result, Started

if TYPE_CHECKING:
    from sattrack.views.schedule import PassView

DONE_SHARE = 0.9
TOLD_S = 0.5


def go_of(event: Happening) -> Go:
    """Return the go that has just ended: as it was told, or as the last that was known of it."""
    if isinstance(event, Followed):
        return event.go
    assert isinstance(event, Started)
    last = event.utc_s if event.last_utc_s is None else event.last_utc_s
    return Go("restart", last, event.on_target_s, words="the runner ended", recording=event.recording)


def result_of(one: NightPass, goes: tuple[Go, ...]) -> Result:
    """Return what became of a pass of all goes at it."""
    on_target_s = sum(go.on_target_s for go in goes)
    whole_s = one.end_utc_s - one.start_utc_s
    last = goes[-1]
    rms = [(go.rms_arcsec, go.on_target_s) for go in goes if go.rms_arcsec is not None and go.on_target_s]
    weight = sum(seconds for _, seconds in rms)
    together = math.sqrt(sum(r * r * s for r, s in rms) / weight) if weight else None
    peaks = [go.peak_arcsec for go in goes if go.peak_arcsec is not None]
    state = "done" if on_target_s >= DONE_SHARE * whole_s else "partly" if on_target_s > 0.0 else "lost"
    cause = words = None
    if state != "done" or last.ended_by not in ("set", "restart"):
        broken = [go for go in goes if go.ended_by != "set"] or [last]
        cause, words = broken[-1].ended_by, broken[-1].words
        if cause == "set":
            cause, words = "late", words or "the mount was not on the satellite for all of it"
    return Result(
        state=state,
        cause=cause,
        words=words,
        on_target_s=round(on_target_s, 3),
        lost_s=round(max(0.0, whole_s - on_target_s), 3),
        rms_arcsec=None if together is None else round(together, 4),
        peak_arcsec=max(peaks) if peaks else None,
        parts=len(goes),
        recordings=tuple(go.recording for go in goes if go.recording is not None),
        held_s=_summed(goes),
        rejoining_s=round(sum(go.rejoining_s for go in goes), 3),
        lost_peak_arcsec=max((go.lost_peak_arcsec for go in goes if go.lost_peak_arcsec), default=None),
    )


def _summed(goes: tuple[Go, ...]) -> dict[str, float]:
    names = dict.fromkeys(name for go in goes for name in go.held_s)
    return {name: round(sum(go.held_s.get(name, 0.0) for go in goes), 3) for name in names}


def held_words(result: Result | PassView) -> str:
    """Return what limits took of a pass, in words; empty for nothing that is worth a word."""
    told = [
        f"{seconds:.0f} s to the {name} limit" for name, seconds in result.held_s.items() if seconds >= TOLD_S
    ]
    if not told:
        return ""
    if result.rejoining_s >= TOLD_S:
        told.append(f"{result.rejoining_s:.0f} s on the way back")
    if result.lost_peak_arcsec is not None:
        told.append(f"{result.lost_peak_arcsec / 3600.0:.2g}° off at most")
    return ", ".join(told)

"""What becomes of a pass, of all goes at it. Pure."""

from __future__ import annotations

import math

from sattrack.schedule.night import Followed, Go, Happening, NightPass, Result, Started

DONE_SHARE = 0.9


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
    )

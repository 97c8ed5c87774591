"""The runs of a schedule, one after the other: which one comes after the one that was looked at."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.core.errors import SattrackError
from sattrack.runtime.gallery import feeders, started_by

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.views.schedule import ScheduleView

LOOK_EVERY_S = 0.5
RUNNER_BACK_WITHIN_S = 15.0
"""How long a schedule is waited for whose runner is gone: it may be about to be started again."""
OVER = frozenset({"ended", "stopped"})


def schedule_in(folder: Path) -> ScheduleView | None:
    """Return what the runner of a schedule says in its folder; raises SattrackError, as `read_status`."""
    from sattrack.schedule.night_files import read_status

    return read_status(folder)


def folder_of(recording: str) -> Path:
    """Return the folder of the schedule that a run of this recording would belong to."""
    return Path(recording).parent.parent


def goes_on(recording: str | None) -> bool:
    """Tell whether a run of this recording is one of a schedule's that is not over."""
    return _is_on(_schedule_of(recording))


def next_run(recording: str | None, waits: Callable[[float], bool]) -> int | None:
    """Wait for the next run of the schedule that a run of this recording was of; return its process.

    None where none will come: the schedule is over, or nobody runs it any more. `waits` is called to wait so
    many seconds, and tells whether to go on.
    """
    gone_s: float | None = None
    while _is_on(view := _schedule_of(recording)):
        runner = None if view is None else view.pid
        now_s = time.monotonic()
        gone_s = None if runner is not None else now_s if gone_s is None else gone_s
        if gone_s is not None and now_s - gone_s > RUNNER_BACK_WITHIN_S:
            break
        found = [pid for pid in feeders() if runner is not None and started_by(pid) == runner]
        if found:
            return found[-1]
        if not waits(LOOK_EVERY_S):
            break
    return None


def stop_schedule(recording: str | None) -> bool:
    """Have the runner of a run's schedule stop whatever moves the mount, and end; False where none runs.

    It is an operator's stop: a restart follows nothing either.
    """
    from sattrack.schedule.night_stop import keep_stop

    view = _schedule_of(recording)
    if recording is None or view is None or view.pid is None:
        return False
    try:
        keep_stop(folder_of(recording), "at the session's screen")
    except OSError:
        return _interrupt(view.pid)
    return True


def _interrupt(process_id: int) -> bool:
    try:
        os.kill(process_id, signal.SIGINT)
    except OSError:
        return False
    return True


def _is_on(view: ScheduleView | None) -> bool:
    return view is not None and (view.running or view.state not in OVER)


def _schedule_of(recording: str | None) -> ScheduleView | None:
    if recording is None:
        return None
    try:
        return schedule_in(folder_of(recording))
    except SattrackError:
        return None

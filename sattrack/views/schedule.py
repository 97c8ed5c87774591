"""The plan of a schedule and the state of its run as plain data, with units in the names.

`sattrack run --dry-run --json` prints the plan; the terminal, JSON lines, the status file and a screen show
the state.
"""

from __future__ import annotations

import msgspec


class LostTo(msgspec.Struct, frozen=True):
    """A stretch of a pass that a limit of the mount takes, as predicted: no part of its useful seconds.

    Where an axis is too slow, as in the keyhole, `peak_rate_deg_s` is what is asked of it at most, and
    `limit_rate_deg_s` what it can.
    """

    limit: str
    from_utc: str
    seconds: float
    why: str
    peak_rate_deg_s: float | None = None
    limit_rate_deg_s: float | None = None


class SchedulePassView(msgspec.Struct, frozen=True):
    """One pass of the night's plan, and what has become of it.

    `state` is "waiting", "in progress", "done", "partly" or "lost"; `cause` and `words` say why it is one of
    the last two. `parts` counts the attempts at it: more than one after a restart or a lost link.
    """

    number: int
    name: str
    catalog_number: int | None
    start_utc: str
    culminate_utc: str
    end_utc: str
    max_alt_deg: float
    priority: float
    state: str
    cause: str | None = None
    words: str | None = None
    on_target_s: float | None = None
    rms_arcsec: float | None = None
    parts: int = 0
    recordings: tuple[str, ...] = ()
    lost_to: tuple[LostTo, ...] = ()
    """What the mount's limits take of it, as the plan predicts."""
    held_s: dict[str, float] = {}
    """Seconds that each limit took; `rejoining_s` went on the way back."""
    rejoining_s: float = 0.0
    lost_peak_arcsec: float | None = None
    """Largest error meanwhile."""


class ScheduleView(msgspec.Struct, frozen=True, tag="schedule"):
    """Everything about a schedule that runs, at one instant; `utc_s` as POSIX seconds of UTC.

    `state` is one of the states in docs/schedules.md, `doing` the same in words. `mount` is "unknown",
    "at rest", "at park" (there, drives on), "parked" (drives off) or "moving". `current` and `next_number`
    are numbers of `passes`. `running` is False where the process that wrote it has ended, or died.
    """

    utc_s: float
    schedule: str
    state: str
    doing: str
    mount: str
    night: int
    from_utc: str
    to_utc: str
    passes: tuple[SchedulePassView, ...]
    not_planned: int
    """Passes that were seen and lost to others, or were infeasible, as the plan was made."""
    current: int | None = None
    next_number: int | None = None
    next_in_s: float | None = None
    """Seconds until the next pass begins to be followed."""
    weather: str | None = None
    notes: tuple[str, ...] = ()
    """The last things that were worth saying."""
    summary: str | None = None
    """The file of the last morning's summary."""
    folder: str = ""
    pid: int | None = None
    running: bool = True
    events: int = 0
    """How many events the run's journal held."""
    troubles: tuple[str, ...] = ()
    """What is wrong now and does not end the run, as a full disk."""
    silent_s: float = 0.0
    """Seconds for which the session that follows a pass had said nothing, when this was written."""
    age_s: float | None = None
    """Seconds since the newest of this was heard, when it was read; None where that is not known."""
    old: bool = False
    """Whether that is too long for what is shown to hold still."""
    stopped_utc: str | None = None
    """Since when the run is stopped by an operator; None where it is not."""
    stopped_by: str | None = None
    resume: str | None = None
    """The command that cancels an operator's stop and continues."""


class Rehearsed(msgspec.Struct, frozen=True):
    """What the rehearsal said of a pass that was chosen."""

    go: bool
    verdict: str
    on_target_s: float
    lost_s: float


class PlannedPass(msgspec.Struct, frozen=True):
    """One pass of the plan: from when to when it is followed, and what is done around it.

    `slew_s`, `before_s`, `settle_s` and `idle_s` fill the time from the end of what was done after the pass
    before it; for the first pass, from the plan's beginning.
    """

    number: int
    name: str
    catalog_number: int | None
    elements_epoch: str | None
    start_utc: str
    culminate_utc: str
    end_utc: str
    shortened: bool
    max_alt_deg: float
    start_az_deg: float
    end_az_deg: float
    sun_alt_deg: float | None
    magnitude: float | None
    priority: float
    useful_s: float
    value: float
    pier_side: str
    idle_s: float
    slew_s: float
    before_s: float
    settle_s: float
    after_s: float
    leave_utc: str
    """When the mount must set out, at the latest."""
    asked_by: str
    asked_at: str
    before: tuple[str, ...]
    after: tuple[str, ...]
    bias_along_s: float
    bias_cross_deg: float
    if_elements_old: str
    if_weather_unsafe: str
    if_sun_up: str
    lost_to: tuple[LostTo, ...] = ()
    rehearsed: Rehearsed | None = None
    notes: tuple[str, ...] = ()
    source: str = ""
    """What gives the target's place."""
    expected_error_m: float | None = None
    """By how much it misses the target when the pass is highest, typically; None where it states none."""


class LostPass(msgspec.Struct, frozen=True):
    """One pass that is not in the plan, and why; `with_numbers` are the planned ones it conflicts with."""

    name: str
    catalog_number: int | None
    start_utc: str
    culminate_utc: str
    end_utc: str
    max_alt_deg: float
    priority: float
    useful_s: float
    value: float
    asked_by: str
    asked_at: str
    reason: str
    why: str
    with_numbers: tuple[int, ...] = ()


class EntryOutcome(msgspec.Struct, frozen=True):
    """What one entry of the schedule came to."""

    asked_by: str
    asked_at: str
    passes: int
    planned: int
    lost: int
    left_out: dict[str, int]
    """Passes of a rule that are not what it asks for, by reason; they are not listed as lost."""
    notes: tuple[str, ...]


class SchedulePlan(msgspec.Struct, frozen=True):
    """All of a plan."""

    schedule: str
    timezone: str
    from_utc: str
    to_utc: str
    profile: str
    value: float
    useful_s: float
    slew_s: float
    idle_s: float
    passes: tuple[PlannedPass, ...]
    lost: tuple[LostPass, ...]
    asked: tuple[EntryOutcome, ...]
    weather: str | None
    park_at_end: bool
    notes: tuple[str, ...]
    value_bound: float | None = None
    """What no plan is worth more than; `value` where the plan is proven to be the best."""

"""The plan of a schedule as plain data with units in its names: `sattrack run --dry-run --json` prints it."""

from __future__ import annotations

import msgspec

from sattrack.views.schedule import LostTo


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
    catalog_number: int
    elements_epoch: str
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


class LostPass(msgspec.Struct, frozen=True):
    """One pass that is not in the plan, and why; `with_numbers` are the planned ones it conflicts with."""

    name: str
    catalog_number: int
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


class Asked(msgspec.Struct, frozen=True):
    """What one entry of the schedule came to."""

    asked_by: str
    asked_at: str
    passes: int
    planned: int
    lost: int
    left_out: dict[str, int]
    """Passes of a rule that are not what it asks for, by reason; they are not listed as lost."""
    notes: tuple[str, ...]


class Plan(msgspec.Struct, frozen=True):
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
    asked: tuple[Asked, ...]
    weather: str | None
    park_at_end: bool
    notes: tuple[str, ...]
    value_bound: float | None = None
    """What no plan is worth more than; `value` where the plan is proven to be the best."""

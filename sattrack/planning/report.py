"""The report of a rehearsal: plain data with units in its names, as `sattrack rehearse --json` prints it."""

from __future__ import annotations

import msgspec

from sattrack.mount.model import MountProfile
from sattrack.planning.budget import Budget
from sattrack.planning.sides import Sides

PRESUMED_OFF_S = 0.02
"""Delay that may well be missing in a profile that was not measured."""


def uncalibrated_words(profile: MountProfile, fastest_deg_s: float, when: str) -> str:
    """Return what a profile that was not measured costs where the satellite is fastest on the sky."""
    default = profile.name == MountProfile().name
    whose = "the default profile's" if default else f"those of the profile {profile.name!r}, not measured"
    return (
        f"uncalibrated: delays and gains are {whose}; {1000.0 * PRESUMED_OFF_S:g} ms of delay are up to "
        f"{3600.0 * PRESUMED_OFF_S * fastest_deg_s:.0f}″ {when}; run `sattrack mount calibrate`"
    )


class LostStretch(msgspec.Struct, frozen=True):
    """A stretch of the pass off target: when, to which limit, and what was asked."""

    from_utc: str
    to_utc: str
    seconds: float
    limit: str
    why: str


class Peak(msgspec.Struct, frozen=True):
    """The most that a pass asks of one axis and that it reached on target when rehearsed, and its limits."""

    axis: str
    asked_rate_deg_s: float
    asked_rate_utc: str
    reached_rate_deg_s: float | None
    """From a second after each joining on, catching up left out; null where none was so long."""
    limit_rate_deg_s: float
    asked_acceleration_deg_s2: float
    limit_acceleration_deg_s2: float


class Margin(msgspec.Struct, frozen=True):
    """How near the pass comes to one limit, degrees inside it; negative where it would be passed."""

    limit: str
    least_deg: float
    utc: str


class KeyholeView(msgspec.Struct, frozen=True):
    """One keyhole: how near the pole, and the seconds lost by clipping and by the ways past it."""

    utc: str
    polar_distance_deg: float
    peak_rate_deg_s: float
    clipped_s: float
    round_s: float
    through_pole_s: float | None
    chosen: str


class Cables(msgspec.Struct, frozen=True):
    """Between what angles the hour angle axis stands over the pass as rehearsed, degrees, turns counted."""

    low_deg: float
    high_deg: float
    limit_deg: float
    """The axis may turn so far either way of the meridian."""


class CutMoment(msgspec.Struct, frozen=True):
    """What a cut of the link at one moment leads to; null seconds where no limit is met for long."""

    utc: str
    seconds_to_limit: float | None
    limit: str | None
    seconds_to_rest: float | None
    """With a watchdog in the mount, when it is at rest."""


class LinkLossView(msgspec.Struct, frozen=True):
    """The worst moment for the link to be cut, and all of them."""

    watchdog_s: float | None
    looked_s: float
    worst: CutMoment
    rests_inside: bool | None
    """Whether the mount's watchdog stops it before any limit at all moments; null without one."""
    curve: tuple[CutMoment, ...]


class Report(msgspec.Struct, frozen=True):
    """All that a rehearsal tells."""

    name: str
    catalog_number: int
    elements_epoch: str
    profile: str
    calibrated: bool
    """Whether the profile was measured."""
    start_utc: str
    culminate_utc: str
    end_utc: str
    max_alt_deg: float
    go: bool
    verdict: str
    pass_s: float
    on_target_s: float
    lost_s: float
    lost: tuple[LostStretch, ...]
    rehearsed_until_utc: str
    step_s: float
    ended_by: str
    acquired_after_s: float | None
    peaks: tuple[Peak, Peak]
    margins: tuple[Margin, ...]
    keyholes: tuple[KeyholeView, ...]
    sides: Sides
    cables: Cables
    link_loss: LinkLossView
    budget: Budget
    notes: tuple[str, ...] = ()

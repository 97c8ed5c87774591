"""What anyone may see of a console. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.driver import limit_text, site_warnings
from sattrack.control.manual_operation import request_text
from sattrack.mount.model import DTICS_S_PER_DEG_S, Hold, MoveAxes, Slew, Stop
from sattrack.mount.xerxes.link import LinkState
from sattrack.views.run import AskedView, ConsoleView

if TYPE_CHECKING:
    from sattrack.control.console import Console, RequestEntry
    from sattrack.mount.model import LinkView

CLOCK_OFF_S = 2.0
STOPS_WITHIN_S = 1.0
"""A stop that has not been seen through by then is worth a word."""
LONGEST_WORDS = 160
"""A view has to fit into what a pipe takes as a whole."""
_MOTIONS = {Hold: "none", Slew: "slew", MoveAxes: "move", Stop: "stop"}


def view_of(console: Console, now_utc_s: float) -> ConsoleView:
    """Return what anyone who looks at a console may see, as of an instant."""
    sample, wanted = console.session.sample, console.session.wanted
    rates = wanted if isinstance(wanted, MoveAxes) else MoveAxes(0.0, 0.0)
    status = console.session.status
    guide = None if status is None else status.ra_guide_rate_dtics_s
    hour_angle = None if sample is None else math.remainder(sample.sidereal_h * 15.0 - sample.ra_deg, 360.0)
    return ConsoleView(
        utc_s=now_utc_s,
        mount=console.mount_name,
        profile=console.profile.name,
        move_axis=console.profile.move_axis,
        doing=_doing(console),
        motion=_MOTIONS[type(wanted)],
        at_rest=console.at_rest,
        status=status,
        readings=msgspec.structs.replace(console.session.readings, tracking=console.tracking_reading),
        hour_angle_deg=hour_angle,
        looks_at_deg=console.looks_at_deg,
        clock_offset_s=console.clock_offset_s,
        ra_rate_deg_s=rates.ra_rate_deg_s,
        dec_rate_deg_s=rates.dec_rate_deg_s,
        max_ra_rate_deg_s=console.profile.ra.max_rate_deg_s,
        max_dec_rate_deg_s=console.profile.dec.max_rate_deg_s,
        guide_rate_deg_s=None if guide is None else guide / DTICS_S_PER_DEG_S,
        floor_altitude_deg=console.limits.floor_altitude_deg,
        can_park=console.profile.park is not None,
        link=_link_view(console, now_utc_s),
        stranger_hosts=console.stranger_hosts,
        asked=tuple(_asked_view(asked) for asked in console.asked),
        refusal=_cut(console.refusal),
        tripped=console.safety.tripped,
        warnings=tuple(words[:LONGEST_WORDS] for words in _warnings(console, now_utc_s)),
    )


def _doing(console: Console) -> str:
    if console.stopping:
        return "stopping"
    if console.procedure is not None:
        return console.procedure.doing
    if console.lead is not None:
        return "keeping the telescope on the sky"
    return "jogging" if console.jogs else "idle"


def _link_view(console: Console, now_utc_s: float) -> LinkView:
    health = console.session.health
    return health.view(console.session.link_state(now_utc_s), health.age_s(now_utc_s))


def _warnings(console: Console, now_utc_s: float) -> list[str]:
    warnings = []
    if console.link_state is LinkState.LOST:
        warnings.append(f"{console.mount_name} is silent: check its power and the cable")
    if console.session.intruder is not None:
        warnings.append(console.session.intruder)
    warnings.extend(console.session.ignored_fields)
    if console.safety.tripped is not None:
        warnings.append(limit_text(console.safety.tripped))
    since_utc_s = console.stopping_since_utc_s
    overdue = since_utc_s is not None and now_utc_s - since_utc_s > STOPS_WITHIN_S
    if overdue and not console.session.stopped:
        warnings.append("the stop is not confirmed yet: it is being sent again and again")
    if console.way_trouble is not None:
        warnings.append(console.way_trouble)
    warnings += site_warnings(console.session.status, console.site) + _reading_warnings(console)
    offset_s = console.clock_offset_s
    if offset_s is not None and abs(offset_s) > CLOCK_OFF_S:
        words = f"the mount's clock is {abs(offset_s):.1f} s {'ahead' if offset_s > 0.0 else 'behind'}"
        warnings.append(f"{words}: its hour angles, and so its limits, are off by it")
    if console.stranger_hosts:
        hosts = ", ".join(console.stranger_hosts)
        warnings.append(f"datagrams from {hosts} were dropped: they are not from the mount")
    return warnings


def _reading_warnings(console: Console) -> list[str]:
    seen = console.session.readings
    return [
        f"the profile has {name} as {said}, the mount sends {getattr(seen, name)}"
        for name, said in console.profile.readings.items()
        if getattr(seen, name, None) not in (None, said)
    ]


def _asked_view(asked: RequestEntry) -> AskedView:
    ticket = asked.ticket
    return AskedView(
        number=asked.number,
        what=request_text(ticket.request),
        state=ticket.state.value,
        acknowledged=ticket.was_acknowledged,
        settled=ticket.settled,
        reason=_cut(ticket.reason),
        utc_s=asked.utc_s,
    )


def _cut(words: str | None) -> str | None:
    return None if words is None else words[:LONGEST_WORDS]

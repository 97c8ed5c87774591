"""The states of a session with a mount, and every transition between them, as tables.

Each part of the session keeps one of these states and changes it by `follow` alone; the protocol's page is
written from the tables. A row under ANY holds in every state that has no row of its own for the event. The
states of a request are `requests.TicketState`.
"""

from __future__ import annotations

from enum import Enum, StrEnum
from typing import TYPE_CHECKING, TypeVar

from sattrack.mount.model import STATUS_LOST_S

if TYPE_CHECKING:
    from collections.abc import Mapping

STALE_AFTER_S = 0.3
ANY = None
State = TypeVar("State", bound=Enum)


class Handshake(Enum):
    """Where a one-shot flag stands."""

    IDLE = "idle"
    RAISED = "raised, not acknowledged"
    WITHDRAWN = "fallen before its acknowledgement was seen"
    RELEASING = "acknowledged and fallen"


HANDSHAKE: Mapping[tuple[Handshake | None, str], Handshake] = {
    (Handshake.IDLE, "request"): Handshake.RAISED,
    (Handshake.RAISED, "ack up"): Handshake.RELEASING,
    (Handshake.RAISED, "withdraw"): Handshake.WITHDRAWN,
    (Handshake.WITHDRAWN, "ack up"): Handshake.RELEASING,
    (Handshake.WITHDRAWN, "quiet"): Handshake.IDLE,
    (Handshake.RELEASING, "ack down"): Handshake.IDLE,
}


class SlewState(Enum):
    """Where the slew last asked for stands."""

    NONE = "none"
    WAITING = "waiting for standstill"
    ASKED = "asked"
    LAUNCHED = "acknowledged, not yet seen to move"
    UNDER_WAY = "under way"
    DONE = "done"


SLEW: Mapping[tuple[SlewState | None, str], SlewState] = {
    (SlewState.WAITING, "flag up"): SlewState.ASKED,
    (SlewState.ASKED, "acknowledged"): SlewState.LAUNCHED,
    (SlewState.ASKED, "no answer"): SlewState.WAITING,
    (SlewState.LAUNCHED, "seen to move"): SlewState.UNDER_WAY,
    (SlewState.LAUNCHED, "too short to be seen"): SlewState.DONE,
    (SlewState.UNDER_WAY, "at rest"): SlewState.DONE,
    (ANY, "new target"): SlewState.WAITING,
    (ANY, "dropped"): SlewState.NONE,
}


class StopState(Enum):
    """How far the stop in force, or the last one, has come."""

    ASKED = "not acknowledged"
    HEARD = "acknowledged"
    AGAIN = "sent again after its acknowledgement"


STOP: Mapping[tuple[StopState | None, str], StopState] = {
    (StopState.ASKED, "acknowledged"): StopState.HEARD,
    (StopState.HEARD, "goes again"): StopState.AGAIN,
    (StopState.AGAIN, "acknowledged"): StopState.HEARD,
    (ANY, "asked for"): StopState.ASKED,
    (ANY, "mount restarted"): StopState.ASKED,
}


class HeldState(Enum):
    """Where MoveAxis stands on a mount that holds."""

    OVER = "over"
    RAISED = "flags up, not acknowledged"
    IN_FORCE = "flags up and acknowledged"
    LAPSED = "flags up, acknowledgement fallen"
    ENDING = "flags down, not acknowledged"
    RELEASING = "flags down, acknowledgement stands"


HELD: Mapping[tuple[HeldState | None, str], HeldState] = {
    (HeldState.OVER, "rates"): HeldState.RAISED,
    (HeldState.RAISED, "ack up"): HeldState.IN_FORCE,
    (HeldState.RAISED, "flags down"): HeldState.ENDING,
    (HeldState.RAISED, "quiet"): HeldState.OVER,
    (HeldState.IN_FORCE, "ack down"): HeldState.LAPSED,
    (HeldState.IN_FORCE, "quiet"): HeldState.LAPSED,
    (HeldState.IN_FORCE, "flags down"): HeldState.RELEASING,
    (HeldState.LAPSED, "rates"): HeldState.IN_FORCE,
    (HeldState.LAPSED, "flags down"): HeldState.OVER,
    (HeldState.ENDING, "rates"): HeldState.RAISED,
    (HeldState.ENDING, "ack up"): HeldState.RELEASING,
    (HeldState.ENDING, "quiet"): HeldState.OVER,
    (HeldState.RELEASING, "rates"): HeldState.RAISED,
    (HeldState.RELEASING, "ack down"): HeldState.OVER,
    (HeldState.RELEASING, "quiet"): HeldState.OVER,
}


class LinkState(StrEnum):
    """What the age of the last accepted status says."""

    SILENT = "silent"
    UP = "up"
    STALE = "stale"
    LOST = "lost"


HEARD = "status accepted"
QUIET = f"none for {STALE_AFTER_S:g} s"
LONG_QUIET = f"none for {STATUS_LOST_S:g} s"
LINK: Mapping[tuple[LinkState | None, str], LinkState] = {
    (LinkState.SILENT, HEARD): LinkState.UP,
    (LinkState.UP, QUIET): LinkState.STALE,
    (LinkState.STALE, HEARD): LinkState.UP,
    (LinkState.STALE, LONG_QUIET): LinkState.LOST,
    (LinkState.LOST, HEARD): LinkState.UP,
}


def follow(table: Mapping[tuple[State | None, str], State], state: State, event: str) -> State:
    """Return the state that follows an event; the same one where the table has no row for it."""
    return table.get((state, event)) or table.get((ANY, event), state)

"""What can be said about a run's control, besides what is said to the run: one JSON object a line.

`{"type":"take_control"}`, `{"type":"yield_control"}`, `{"type":"leave_running"}`,
`{"type":"arm","catalog_number":25544,"culminate_utc_s":1790946324.4}`.
"""

from __future__ import annotations

import msgspec

from sattrack.views.messages import (
    ClearBias,
    DropRemembered,
    Go,
    Jog,
    Message,
    Nudge,
    Observation,
    OffsetBy,
    Pause,
    Search,
    StopNow,
)


class TakeControl(msgspec.Struct, frozen=True, tag="take_control", forbid_unknown_fields=True):
    """Have control from now on, whoever had it."""


class YieldControl(msgspec.Struct, frozen=True, tag="yield_control", forbid_unknown_fields=True):
    """Give control up, for anybody to take."""


class LeaveRunning(msgspec.Struct, frozen=True, tag="leave_running", forbid_unknown_fields=True):
    """From whoever started the run: the end of this channel is not to stop it."""


class Arm(msgspec.Struct, frozen=True, tag="arm", forbid_unknown_fields=True):
    """Have a pass followed after this one; with `now`, end this one for it.

    A pass is named by the satellite's catalogue number and about when it culminates (UTC, POSIX seconds).
    """

    catalog_number: int
    culminate_utc_s: float
    name: str = ""
    now: bool = False


class Disarm(msgspec.Struct, frozen=True, tag="disarm", forbid_unknown_fields=True):
    """Take a pass back that was armed."""

    catalog_number: int
    culminate_utc_s: float


SessionMessage = TakeControl | YieldControl | LeaveRunning | Arm | Disarm

_Any = (
    Nudge
    | ClearBias
    | DropRemembered
    | StopNow
    | OffsetBy
    | Search
    | Observation
    | Pause
    | Go
    | Jog
    | TakeControl
    | YieldControl
    | LeaveRunning
    | Arm
    | Disarm
)
_DECODER: msgspec.json.Decoder[_Any] = msgspec.json.Decoder(_Any)


def encode_said(message: Message | SessionMessage) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def decode_said(line: bytes | str) -> Message | SessionMessage:
    """Return the message of one JSON line; raises msgspec.MsgspecError."""
    return _DECODER.decode(line)

"""What an operator can say to a run, and how it is written: one JSON object a line.

`{"type":"nudge","along_s":0.1}`, `{"type":"clear_bias"}`, `{"type":"stop"}`.
"""

from __future__ import annotations

import msgspec


class Nudge(msgspec.Struct, frozen=True, tag="nudge", forbid_unknown_fields=True):
    """Move the target: seconds along its track, degrees across it, added to what is in force."""

    along_s: float = 0.0
    cross_deg: float = 0.0


class ClearBias(msgspec.Struct, frozen=True, tag="clear_bias", forbid_unknown_fields=True):
    """Take all bias away."""


class StopNow(msgspec.Struct, frozen=True, tag="stop", forbid_unknown_fields=True):
    """Stop the mount and end the run."""


Message = Nudge | ClearBias | StopNow

_DECODER: msgspec.json.Decoder[Nudge | ClearBias | StopNow] = msgspec.json.Decoder(
    Nudge | ClearBias | StopNow
)


def encode_message(message: Message) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def decode_message(line: bytes) -> Message:
    """Return the message of one JSON line; raises msgspec.MsgspecError."""
    return _DECODER.decode(line)

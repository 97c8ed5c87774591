"""What an operator can say to a manual console, and how it is written: one JSON object a line.

`{"type":"slew","ra_deg":82.5,"dec_deg":-12.5}`, `{"type":"jog","dec_rate_deg_s":0.1}`, `{"type":"abort"}`.
"""

from __future__ import annotations

import msgspec


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type"):
    """What all messages share."""


class SlewOrder(Order, frozen=True, tag="slew"):
    """Slew to a direction of date, degrees, and track there."""

    ra_deg: float
    dec_deg: float


class SyncOrder(Order, frozen=True, tag="sync"):
    """Make the mount report this direction for where it points."""

    ra_deg: float
    dec_deg: float


class JogOrder(Order, frozen=True, tag="jog"):
    """Move an axis, or both, for a short time; said again, for longer. Null leaves an axis alone.

    Rates are those of right ascension (positive east) and declination (positive north).
    """

    ra_rate_deg_s: float | None = None
    dec_rate_deg_s: float | None = None


class AbortOrder(Order, frozen=True, tag="abort"):
    """Stop everything."""


class ParkOrder(Order, frozen=True, tag="park"):
    """Slew to the park position, stop there, cut the drives' power."""


class HomeOrder(Order, frozen=True, tag="home"):
    """Go to the home position."""


class ResetOrder(Order, frozen=True, tag="reset"):
    """Let the mount move again after a safety limit has stopped it, once it is at rest."""


class LeaveOrder(Order, frozen=True, tag="leave"):
    """Stop what was begun from here, and end."""


ConsoleMessage = (
    SlewOrder | SyncOrder | JogOrder | AbortOrder | ParkOrder | HomeOrder | ResetOrder | LeaveOrder
)

_DECODER: msgspec.json.Decoder[ConsoleMessage] = msgspec.json.Decoder(ConsoleMessage)


def encode_order(message: ConsoleMessage) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def decode_order(line: bytes) -> ConsoleMessage:
    """Return the message of one JSON line; raises msgspec.MsgspecError."""
    return _DECODER.decode(line)

"""Framing of messages on the line: text, a trailing space, a check, a line-feed; and the sync character.

"Ideal Field System Antenna Interface", section 3.0. Pure: bytes in, lines out; instants are given.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass, field
from enum import Enum

SYNC = b"#"
END = b"\n"
LONGEST_MESSAGE = 200
"""Characters of a message with its trailing space and check: twice what the longest command takes."""
TIME_OUT_S = 0.5
"""Within which a response is there: section 4.0's upper bound."""
CHARACTER_TIMES = 3.0
"""A character time-out, in times that one character takes on the line: section 4.0, "2-3 times"."""
TCP_CHARACTER_TIME_OUT_S = 0.05
"""The same where characters come in packets, and the network decides when."""


class Check(Enum):
    """How a message is checked: the value is the number of its hexadecimal digits."""

    SUM = 2
    CRC16 = 4

    def of(self, message: bytes) -> bytes:
        """Return the check of a message with its trailing space, in upper case."""
        if self is Check.SUM:
            return b"%02X" % (sum(message) & 0xFF)
        return b"%04X" % binascii.crc_hqx(message, 0xFFFF)


class LineFault(Enum):
    """What is wrong with a line that came."""

    TRANSMISSION = "transmission error"
    TOO_LONG = "too long"


@dataclass(frozen=True, slots=True)
class Line:
    """One line that came: its message without the trailing space, or what could be read of a faulty one."""

    message: str
    fault: LineFault | None = None


@dataclass(frozen=True, slots=True)
class Synchronised:
    """The synchronisation character came: what was under way in either direction is void."""


def encode(message: str, check: Check = Check.SUM) -> bytes:
    """Return a message as it goes on the line. Raises ValueError where it holds what no message may."""
    if not all(_is_message_byte(ord(c)) for c in message):
        raise ValueError(f"{message!r} holds a character that no message may hold")
    body = message.encode("ascii") + b" "
    return body + check.of(body) + END


def _is_message_byte(byte: int) -> bool:
    return 0x20 <= byte <= 0x7E and byte != SYNC[0]


@dataclass(slots=True)
class Framer:
    """Cuts what arrives into lines. Empty lines are swallowed; nothing that comes can break it."""

    check: Check = Check.SUM
    _pending: bytearray = field(default_factory=bytearray)
    _overlong: bool = False

    def receive(self, data: bytes) -> list[Line | Synchronised]:
        """Return the lines that are complete, and the synchronisations, in the order of arrival.

        After a synchronisation nothing of what came before it is left.
        """
        events: list[Line | Synchronised] = []
        for byte in data:
            if byte == SYNC[0]:
                self.reset()
                events.append(Synchronised())
            elif byte == END[0]:
                line = self._finish()
                if line is not None:
                    events.append(line)
            elif len(self._pending) < LONGEST_MESSAGE:
                self._pending.append(byte)
            else:
                self._overlong = True
        return events

    def reset(self) -> None:
        """Forget what has come of a line."""
        self._pending.clear()
        self._overlong = False

    def _finish(self) -> Line | None:
        raw, overlong = bytes(self._pending), self._overlong
        self.reset()
        if not raw:
            return None
        if overlong:
            return Line(_readable(raw), LineFault.TOO_LONG)
        digits = self.check.value
        body, check = raw[:-digits], raw[-digits:]
        good = body.endswith(b" ") and check.upper() == self.check.of(body)
        if not good or not all(_is_message_byte(b) for b in body):
            return Line(_readable(raw), LineFault.TRANSMISSION)
        return Line(body[:-1].decode("ascii"))


def _readable(raw: bytes) -> str:
    return "".join(chr(b) if _is_message_byte(b) else "?" for b in raw)


def character_time_out_s(baud: int, bits_per_character: int = 10) -> float:
    """Return after how much silence the next character is not to be expected, on a serial line, seconds.

    `bits_per_character` counts start, parity and stop bits: 10 for 7E1 as for 8N1.
    """
    return CHARACTER_TIMES * bits_per_character / baud


def idle_time_s(character_s: float) -> float:
    """Return the silence that shows an idle line after a synchronisation: two character time-outs."""
    return 2.0 * character_s

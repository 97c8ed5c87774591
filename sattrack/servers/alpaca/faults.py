"""What goes wrong with a request: by the device's own numbers, or before it is a request at all."""

from __future__ import annotations

from enum import IntEnum


class Number(IntEnum):
    """The error numbers that Alpaca reserves, "ASCOM Alpaca API Reference", ASCOM reserved error numbers."""

    OK = 0
    NOT_IMPLEMENTED = 0x400
    INVALID_VALUE = 0x401
    VALUE_NOT_SET = 0x402
    NOT_CONNECTED = 0x407
    PARKED = 0x408
    INVALID_OPERATION = 0x40B
    ACTION_NOT_IMPLEMENTED = 0x40C
    CANCELLED = 0x40E
    DRIVER = 0x500


class Fault(Exception):  # noqa: N818 - the protocol's own word is error number, not error
    """A request that the device answers with an error number; HTTP's own status is 200 all the same."""

    def __init__(self, number: Number, words: str) -> None:
        super().__init__(words)
        self.number = number
        self.words = words


class BadRequest(Exception):  # noqa: N818 - it is named after HTTP's own words
    """What cannot be read as a request: answered with an HTTP status and a line of text."""

    def __init__(self, words: str, status: int = 400) -> None:
        super().__init__(words)
        self.words = words
        self.status = status

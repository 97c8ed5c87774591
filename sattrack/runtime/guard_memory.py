"""What a feeder and its guardian tell one another: a page of shared memory, written without ever waiting.

Each word has one writer and is read and written whole, so nothing needs a lock. The page lives as long as one
of both has its descriptor; a hung or dead process holds nothing up.
"""

from __future__ import annotations

import mmap
import os
import struct
import sys
import tempfile
from enum import IntEnum
from typing import NamedTuple

SIZE = mmap.PAGESIZE
STATUSES_AT = 1024
STATUSES = 8
"""So many of the last statuses are kept, each in a place of its own."""
_STATUS = struct.Struct("@dH160s")
PLACE_BYTES = 256


class Word(IntEnum):
    """The words, by their place; each has one writer, the feeder or the guardian."""

    BEATS = 0
    """Counts turns of the feeder's loop."""
    COUNTER = 1
    """Number of the last datagram that was sent."""
    ARMED = 2
    """1 once a datagram has gone out that may set the mount going."""
    RELEASED = 3
    """How the feeder ended its work, a `Release`; 0 before that."""
    OBEYING = 4
    """1 once the feeder has seen that it is to stop."""
    STOP_ASKED = 5
    """1 once somebody has asked for a stop of the mount and the end of the session."""
    DEPOSED = 6
    """1 once the mount is the guardian's: the feeder has stood still for too long."""
    STOPPED = 7
    """How the guardian's own stop ended, a `Release`; 0 before that."""
    HEARD = 8
    """The feeder's count of statuses from the mount."""


class Release(IntEnum):
    """How a feeder, or its guardian, ended its work: what is known of the mount."""

    UNKNOWN = 1
    AT_REST = 2
    NOT_CONFIRMED = 3

    @classmethod
    def of(cls, at_rest: bool | None) -> Release:
        """Return the one that says so."""
        if at_rest is None:
            return cls.UNKNOWN
        return cls.AT_REST if at_rest else cls.NOT_CONFIRMED

    @property
    def at_rest(self) -> bool | None:
        """What it says."""
        return {Release.UNKNOWN: None, Release.AT_REST: True, Release.NOT_CONFIRMED: False}[self]


class Heard(NamedTuple):
    """One datagram from the mount, and the reading of the monotonic clock when it arrived."""

    monotonic_s: float
    data: bytes


def note_status(page: memoryview, monotonic_s: float, data: bytes) -> None:
    """Keep a datagram from the mount for whoever looks on; what is longer than a status is cut."""
    bytes_, count = page.cast("B"), page[Word.HEARD]
    place = STATUSES_AT + count % STATUSES * PLACE_BYTES
    _STATUS.pack_into(bytes_, place, monotonic_s, min(len(data), 160), data)
    # Only now: who looks on reads what the count says is whole.
    page[Word.HEARD] = count + 1


def statuses_since(page: memoryview, count: int) -> tuple[int, list[Heard]]:
    """Return the count of datagrams so far, and those after `count` that are still kept."""
    bytes_, heard = page.cast("B"), page[Word.HEARD]
    found = []
    # The oldest place may be written anew this very moment.
    for number in range(max(count, heard - STATUSES + 1), heard):
        place = STATUSES_AT + number % STATUSES * PLACE_BYTES
        monotonic_s, length, data = _STATUS.unpack_from(bytes_, place)
        found.append(Heard(monotonic_s, data[:length]))
    return heard, found


def create() -> int:
    """Return the descriptor of a fresh page, all words 0; it has no name that anybody else could open."""
    if sys.platform.startswith("linux"):
        descriptor = os.memfd_create("sattrack-guard")
    else:
        descriptor, path = tempfile.mkstemp(prefix="sattrack-guard-")
        os.unlink(path)  # noqa: PTH108 - it came as a string
    os.ftruncate(descriptor, SIZE)
    return descriptor


def words(descriptor: int) -> memoryview:
    """Return the page as a view of words, indexed by `Word`."""
    page = mmap.mmap(descriptor, SIZE)
    page[0] = page[0]  # touched, so that the first beat finds it in memory
    return memoryview(page).cast("Q")

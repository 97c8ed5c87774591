"""Random and mutated datagrams, and how much memory they leave behind."""

from __future__ import annotations

import gc
import tracemalloc
from typing import TYPE_CHECKING

import pytest
from paper_mount import PaperMount
from paper_packing import CommandRow, pack_command

if TYPE_CHECKING:
    import random
    from collections.abc import Callable

HOW_MANY = [pytest.param(20_000, id="20,000"), pytest.param(1_000_000, id="10^6", marks=pytest.mark.soak)]
GROWTH_BYTES = 8_192
"""What a run of any length may leave behind: counters that grew past small integers, a bounded history."""
COMMAND = pack_command(
    CommandRow(
        counter=123456,
        TargetDec=45.0,
        TargetRA=12.5,
        MoveAxisRateDec=1.0,
        MoveAxisRateRA=-1.0,
        PulseGuideRADuration=500,
        PulseGuideDecDuration=-500,
    )
)
STATUS = PaperMount(count=5000).turn()
FINE_RATES = range(48, 64)


def wrong(rng: random.Random, valid: bytes) -> bytes:
    """Something that is no such datagram: noise, or a valid one of another length or with another header."""
    kind = rng.randrange(5)
    if kind == 0:
        return b"\xff" + rng.randbytes(rng.randrange(400))
    if kind == 1:
        return valid[: rng.randrange(len(valid))]
    if kind == 2:
        return valid + rng.randbytes(rng.randint(1, 200))
    if kind == 3:
        bit = rng.randrange(64)
        data = bytearray(valid)
        data[bit // 8] ^= 1 << bit % 8
        return bytes(data)
    return b"\x00" + rng.randbytes(len(valid) - 1)


def mutated(rng: random.Random, valid: bytes, untouched: frozenset[int] = frozenset()) -> bytes:
    """A datagram by length and header with one to eight of its other bytes changed at random."""
    data = bytearray(valid)
    for _ in range(rng.randint(1, 8)):
        offset = rng.randrange(8, len(valid))
        if offset not in untouched:
            data[offset] = rng.randrange(256)
    return bytes(data)


def grown_bytes(step: Callable[[int], None], count: int) -> int:
    """How much more is allocated after all steps than after nine tenths of them.

    Tracing slows everything down many times, so it begins after eight tenths; what has a bound is replaced
    by then, and what grows by an object a step shows in the last tenth.
    """
    traced, measured = count * 8 // 10, count * 9 // 10
    for number in range(traced):
        step(number)
    gc.collect()
    tracemalloc.start()
    try:
        for number in range(traced, measured):
            step(number)
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for number in range(measured, count):
            step(number)
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()

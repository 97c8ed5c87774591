"""What the kernel knows of the error of the machine's clock: adjtimex(2), asked and never set. Linux."""

from __future__ import annotations

import ctypes
import sys
from dataclasses import dataclass

_UNSYNCHRONISED = 0x0040
_LONG = ctypes.c_long


@dataclass(frozen=True, slots=True)
class KernelClock:
    """The kernel's account of its clock.

    `synchronised` where something disciplines it; `estimated_error_s` and `largest_error_s` are what that
    last said, the largest growing by 0.5 ms a second until it says so again.
    """

    synchronised: bool
    estimated_error_s: float
    largest_error_s: float


class _Timex(ctypes.Structure):
    """`struct timex` of adjtimex(2)."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", _LONG),
        ("freq", _LONG),
        ("maxerror", _LONG),
        ("esterror", _LONG),
        ("status", ctypes.c_int),
        ("constant", _LONG),
        ("precision", _LONG),
        ("tolerance", _LONG),
        ("time", _LONG * 2),
        ("tick", _LONG),
        ("ppsfreq", _LONG),
        ("jitter", _LONG),
        ("shift", ctypes.c_int),
        ("stabil", _LONG),
        ("jitcnt", _LONG),
        ("calcnt", _LONG),
        ("errcnt", _LONG),
        ("stbcnt", _LONG),
        ("tai", ctypes.c_int),
        ("reserved", ctypes.c_int * 11),
    )


def read_kernel_clock() -> KernelClock | None:
    """Return what the kernel knows of its clock; None where it cannot be asked."""
    if not sys.platform.startswith("linux"):
        return None
    timex = _Timex()
    if ctypes.CDLL(None).adjtimex(ctypes.byref(timex)) < 0:
        return None
    return KernelClock(
        synchronised=not timex.status & _UNSYNCHRONISED,
        estimated_error_s=timex.esterror * 1e-6,
        largest_error_s=timex.maxerror * 1e-6,
    )

"""What a loop in real time asks of the system, so that nothing holds it up.

Priority, locked memory, no garbage collection: each is asked for by itself and may be refused; the run goes
on without, and says what it lacks. sched(7), mlockall(2), prctl(2). Priorities and locked memory are asked
for on Linux only.
"""

from __future__ import annotations

import ctypes
import gc
import os
import re
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.core.process import gc_paused

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

PRIORITY = 10
"""Above everything that has no real-time priority, below the kernel's own threads for interrupts (50)."""
SWITCH_S = 0.0005
"""How long the loop waits before it asks another thread for the interpreter."""
VARIABLE = "SATTRACK_REALTIME"
"""Set to 0, no priority and no locked memory is asked for."""

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
_SHORTEST_SLACK_NS = 1
_DEFAULT_SLACK = 0
_CAP_IPC_LOCK = 14


@dataclass(frozen=True, slots=True)
class Grant:
    """What was granted, `priority` None where none was; `refusals` say why, without how to get it."""

    priority: int | None
    memory_locked: bool
    refusals: tuple[str, ...] = ()

    @property
    def realtime(self) -> bool:
        """Whether the loop goes before everything that has no such priority."""
        return self.priority is not None


def wanted(environment: Mapping[str, str]) -> bool:
    """Tell whether to ask for priority and locked memory."""
    return environment.get(VARIABLE, "1") != "0"


@contextmanager
def undisturbed(ask: bool | None = None) -> Iterator[Grant]:
    """Run the calling thread, and it alone, as little disturbed as the system lets it; give what was granted.

    With `ask` None the environment decides whether priority and locked memory are asked for. Threads and
    processes begun meanwhile have normal priority. What is made meanwhile must be free of cycles: no garbage
    is collected.
    """
    if ask is None:
        ask = wanted(os.environ)
    with _quiet_memory(), _eager():
        refusals: list[str] = []
        locked = priority = None
        if not ask:
            refusals.append(f"not asked for: {VARIABLE}=0")
        elif not sys.platform.startswith("linux"):
            refusals.append(f"real-time priority is asked for on Linux only, and this is {sys.platform}")
        else:
            locked = _lock_memory(refusals)
            priority = _take_priority(refusals)
        try:
            yield Grant(priority, locked is not None, tuple(refusals))
        finally:
            if priority is not None:
                # Without privileges, what was asked for once about children cannot be taken back.
                os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            if locked is not None:
                locked.munlockall()


def go_before_others() -> None:
    """Ask for the priority of `undisturbed` for this process to its end, where it is wanted and granted."""
    if wanted(os.environ) and sys.platform.startswith("linux"):
        _take_priority([])


def how_to_grant(user: str) -> tuple[str, ...]:
    """Return the ways to get priority and locked memory on Linux, the one that lasts first."""
    return (
        f"for good: put the lines `{user} - rtprio {2 * PRIORITY}` and `{user} - memlock unlimited` into "
        "/etc/security/limits.d/sattrack.conf, and log in again",
        "for this shell, at once: sudo prlimit --pid $$ "
        f"--rtprio={2 * PRIORITY}:{2 * PRIORITY} --memlock=unlimited:unlimited",
        f"in a systemd unit: LimitRTPRIO={2 * PRIORITY} and LimitMEMLOCK=infinity, "
        "or AmbientCapabilities=CAP_SYS_NICE CAP_IPC_LOCK",
        "for one Python of its own (a copy, no link; whoever may run it gets both): "
        "sudo setcap cap_sys_nice,cap_ipc_lock+ep /path/to/that/python3",
    )


def _take_priority(refusals: list[str]) -> int | None:
    try:
        # Threads and processes begun from here on are not to have it.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except OSError as error:
        refusals.append(f"no real-time priority: {error.strerror}")
        return None
    return PRIORITY


def _lock_memory(refusals: list[str]) -> ctypes.CDLL | None:
    libc = ctypes.CDLL(None, use_errno=True)
    # Pages as they come into use: whole mappings would be several times what is ever touched.
    flags = _MCL_CURRENT | _MCL_ONFAULT
    if _unlimited_locking():
        # Under a limit, memory to come could not be had at all once the limit is reached.
        flags |= _MCL_FUTURE
    if libc.mlockall(flags) != 0:
        refusals.append(f"memory is not locked: {os.strerror(ctypes.get_errno())}")
        return None
    return libc


def _unlimited_locking() -> bool:
    import resource

    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    try:
        status = Path("/proc/self/status").read_bytes()
    except OSError:
        return False
    capabilities = re.search(rb"^CapEff:\s*([0-9a-f]+)", status, re.MULTILINE)
    return capabilities is not None and bool(int(capabilities[1], 16) >> _CAP_IPC_LOCK & 1)


@contextmanager
def _eager() -> Iterator[None]:
    """Wait for the interpreter and for the kernel's timers no longer than need be."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    _set_timer_slack(_SHORTEST_SLACK_NS)
    try:
        yield
    finally:
        _set_timer_slack(_DEFAULT_SLACK)
        sys.setswitchinterval(before_s)


def _set_timer_slack(nanoseconds: int) -> None:
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(nanoseconds), 0, 0, 0)


@contextmanager
def _quiet_memory() -> Iterator[None]:
    # A collection of garbage would hold the loop for longer than its period allows.
    with gc_paused():
        gc.collect()
        unfreeze = gc.get_freeze_count() == 0
        gc.freeze()
        try:
            yield
        finally:
            if unfreeze:
                gc.unfreeze()

"""Which mounts were left moving, and for how long that leaves the turns of their axes known.

A status gives an axis' angle within a turn. A mount that moves while nobody hears it (a machine asleep, or
without power; a cut link) goes on at its last rates, and may have gone half round: then no status tells how
its cables are wound, and a way that seems short may wind them farther. A guardian notes what it watches in a
small file for each mount, and removes it when the mount is at rest with its cables free; the next session
judges what is left, and begins with the turns that are noted.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from typing import TYPE_CHECKING
from urllib.parse import quote

import msgspec

from sattrack.core import local_time
from sattrack.core.errors import NO_JSON
from sattrack.core.files import replace_file, shortened, user_folder
from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from pathlib import Path

BACKWARD_S = 5.0
"""A clock that went back by more, as one without a battery does, does not tell for how long nobody heard."""
KEPT_WITHIN_S = 1.0
WOUND_DEG = 170.0
"""Where an axis at rest is farther from its zero, the session to come must know its turns."""
WOUND_KNOWN_S = 11.0 * 3600.0
"""For so long: an axis that follows the sky turns by less than half meanwhile."""
FOLLOWED_FOR_S = 22.0 * 3600.0
"""For so long it can be told whether an axis has followed the sky: after a day it is where it was."""
LONGEST_NAME = 200
"""Of a file, which may have 255 bytes, without what marks one that is being written."""
AT_REST = ".rest"
LOOK_AT_CABLES = (
    "look at its cables, bring its axes within half a turn of the meridian by its own console, "
    "then say `sattrack mount unwound`"
)


def seconds_since_boot() -> float:
    """Return a reading of the monotonic clock that counts sleep, where there is one."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)


class LeftMoving(msgspec.Struct, frozen=True):
    """A mount in motion, or at rest with its cables wound, as its guardian knows it."""

    heard_utc_s: float
    """When it was heard last, POSIX seconds."""
    known_for_s: float
    """For how long from then on the turns of its axes stay known."""
    lost: bool = False
    """Whether they were lost already."""
    first_axis_deg: float | None = None
    """The first axis' angle then, turns counted; None where it is within half a turn of its zero."""

    def trouble(self, now_utc_s: float) -> str | None:
        """Return why nothing may be moved at an instant; None where the turns are known."""
        unheard_s = now_utc_s - self.heard_utc_s
        if not self.lost and -BACKWARD_S <= unheard_s <= self.known_for_s:
            return None
        unknown = f"before a loss of power, or its note in {folder()} cannot be read"
        when = local_time.instant(self.heard_utc_s) if self.heard_utc_s else unknown
        if self.known_for_s == WOUND_KNOWN_S and self.first_axis_deg is not None:
            return (
                f"was left {when} with its first axis at {self.first_axis_deg:.0f}°, and may have followed "
                f"the sky half round since: {LOOK_AT_CABLES}"
            )
        return f"was last heard in motion {when}, and may have gone half round since: {LOOK_AT_CABLES}"


class LeftAtRest(msgspec.Struct, frozen=True):
    """A mount at rest within half a turn of its zero; its drives may follow the sky."""

    utc_s: float
    """When it was heard last, POSIX seconds."""
    first_axis_deg: float


UNREADABLE = LeftMoving(0.0, 0.0, lost=True)
"""What a file says that cannot be read: a machine that lost its power may not have written all of it."""


def folder() -> Path:
    """Return where guardians keep their notes: $XDG_STATE_HOME/sattrack/moving."""
    return user_folder("XDG_STATE_HOME", ".local/state") / "moving"


def left_moving(mount: str) -> LeftMoving | None:
    """Return what is noted of a mount, by its address' name; None for nothing."""
    try:
        return msgspec.json.decode(_path(mount).read_bytes(), type=LeftMoving)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError, *NO_JSON):
        return UNREADABLE


def trouble_before(mount: str, now_utc_s: float) -> str | None:
    """Return why a mount must not be moved by a session that begins; None where its turns are known."""
    left = left_moving(mount)
    return None if left is None else left.trouble(now_utc_s)


def noted_axis_deg(mount: str) -> float | None:
    """Return where a session left a mount's first axis, turns counted; None for within half a turn."""
    left = left_moving(mount)
    return None if left is None else left.first_axis_deg


def followed_axis_deg(mount: str, now_utc_s: float) -> float | None:
    """Return where a mount's first axis is if it has followed the sky since it was left; turns counted.

    None where that is not known, or the turns are known by more than that.
    """
    if left_moving(mount) is not None:
        return None
    try:
        left = msgspec.json.decode(_rest_path(mount).read_bytes(), type=LeftAtRest)
    except (OSError, msgspec.MsgspecError, *NO_JSON):
        return None
    followed_s = now_utc_s - left.utc_s
    if not 0.0 <= followed_s <= FOLLOWED_FOR_S:
        return None
    return left.first_axis_deg + SIDEREAL_RATE_DEG_S * followed_s


def note(mount: str, moving: LeftMoving | LeftAtRest | None) -> None:
    """Note how a mount moves, or with None that it is at rest; a disk that refuses is no reason to stop."""
    with contextlib.suppress(OSError):
        if moving is None:
            forget(mount)
            return
        path = _rest_path(mount) if isinstance(moving, LeftAtRest) else _path(mount)
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, msgspec.json.encode(moving), synced=False)
        if path.suffix == AT_REST:
            _forget_old(time.time())


class NoteKeeper:
    """Keeps notes in a thread of its own: a disk that does not answer must not hold up a guardian."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[tuple[str, LeftMoving | LeftAtRest | None] | None] = (
            queue.SimpleQueue()
        )
        self._thread = threading.Thread(target=self._keep, name="notes", daemon=True)
        self._thread.start()

    def note(self, mount: str, moving: LeftMoving | LeftAtRest | None) -> None:
        """See `note`; returns at once."""
        self._waiting.put((mount, moving))

    def close(self) -> None:
        """Wait until all is kept, or for a second."""
        self._waiting.put(None)
        self._thread.join(KEPT_WITHIN_S)

    def _keep(self) -> None:
        while (one := self._waiting.get()) is not None:
            note(*one)


def forget(mount: str) -> None:
    """Remove what is noted of a mount. Raises OSError where that is refused."""
    _path(mount).unlink(missing_ok=True)
    _rest_path(mount).unlink(missing_ok=True)


def _forget_old(now_utc_s: float) -> None:
    """Remove the notes of mounts at rest that tell nothing any more: simulated ones have ever new ports."""
    for path in folder().glob(f"*{AT_REST}"):
        if now_utc_s - path.stat().st_mtime > FOLLOWED_FOR_S:
            path.unlink(missing_ok=True)


def _path(mount: str) -> Path:
    return folder() / f"{shortened(quote(mount, safe=':'), LONGEST_NAME)}.json"


def _rest_path(mount: str) -> Path:
    return _path(mount).with_suffix(AT_REST)

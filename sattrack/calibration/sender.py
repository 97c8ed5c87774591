"""When datagrams leave: twenty a second, and where the instant matters, at that instant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from sattrack.mount.xerxes.datagrams import Command

if TYPE_CHECKING:
    from collections.abc import Mapping

PERIOD_S = 0.05
QUIET_S = 0.03
"""Nothing leaves so long before a change whose instant matters: a late datagram would undo it."""
SOON_S = 0.002


class Sender:
    """Keeps what is to be said, and when it is due next."""

    def __init__(self, begin_utc_s: float) -> None:
        self.said = Command()
        """What the last datagram said."""
        self.changed_utc_s = begin_utc_s
        """When a datagram last said something new."""
        self._to_say = Command()
        self._aimed: tuple[float, Command] | None = None
        self._last_utc_s: float | None = None
        self._due_utc_s = begin_utc_s
        self._counter = 0
        self._changes = False

    @property
    def waiting(self) -> bool:
        """Whether something new has been asked for and not left yet."""
        return self._aimed is not None or self._to_say != replace(self.said, counter=self._to_say.counter)

    def say(self, fields: Mapping[str, Any]) -> None:
        """Say this, and nothing else, with the next datagram."""
        self._aimed = None
        self._to_say = Command(**fields)

    def say_at_once(self, fields: Mapping[str, Any], now_utc_s: float) -> None:
        """Say this with a datagram that is due at once."""
        self.say(fields)
        self._due_utc_s = now_utc_s

    def say_at(self, instant_utc_s: float, fields: Mapping[str, Any]) -> None:
        """Say this, and nothing else, from an instant on."""
        self._aimed = (instant_utc_s, Command(**fields))

    def earliest(self, now_utc_s: float) -> float:
        """Return the earliest instant that a change can be aimed at."""
        last = now_utc_s if self._last_utc_s is None else self._last_utc_s
        return max(now_utc_s + SOON_S, last + QUIET_S)

    def due(self) -> float:
        """Return when the next datagram is to leave, our UTC."""
        if self._aimed is None:
            return self._due_utc_s
        instant = self._aimed[0]
        return self._due_utc_s if self._due_utc_s < instant - QUIET_S else instant

    def left(self, now_utc_s: float) -> None:
        """Note when it has left indeed."""
        self._last_utc_s = now_utc_s
        if self._changes:
            self.changed_utc_s = now_utc_s

    def next(self, now_utc_s: float) -> Command:
        """Return what leaves now."""
        if self._aimed is not None and self.due() == self._aimed[0]:
            self._to_say = self._aimed[1]
            self._aimed = None
        self._counter += 1
        command = replace(self._to_say, counter=self._counter)
        self._changes = replace(command, counter=self.said.counter) != self.said
        self.said = command
        self.left(now_utc_s)
        self._due_utc_s = max(self._due_utc_s, now_utc_s - PERIOD_S) + PERIOD_S
        if self._due_utc_s < now_utc_s + QUIET_S:
            self._due_utc_s = now_utc_s + PERIOD_S
        return command

"""Who looks on at a run, who has control of it, and what is said about that. No logic."""

from __future__ import annotations

import msgspec

STARTER = 0
"""The number of whoever started the run and speaks to it directly."""


class Watcher(msgspec.Struct, frozen=True):
    """Somebody who looks on: a number of this run's own, and who that is in words."""

    number: int
    name: str


class Armed(msgspec.Struct, frozen=True):
    """A pass that is to be followed after this one: whose, and when it culminates (UTC, POSIX seconds)."""

    catalog_number: int
    culminate_utc_s: float
    name: str


class SessionView(msgspec.Struct, frozen=True, tag="session"):
    """The people before a run. Whoever has control moves the target; a stop is obeyed from anybody."""

    controller: int | None
    """The number of whoever has control; None where nobody has."""
    watchers: tuple[Watcher, ...]
    """Those who look on, the first ones; the starter is none of them."""
    watching: int
    """How many look on in all."""
    left_running: bool = False
    """Whether whoever started the run has gone, and had it go on."""
    said: str | None = None
    """The last that happened among them, in words."""
    queue: tuple[Armed, ...] = ()
    """What is to be followed next, in this order."""
    takes_others: bool = False
    """Whether other satellites can be followed after this one."""

    def name_of(self, number: int | None) -> str:
        """Return who that is, in words."""
        if number is None:
            return "nobody"
        if number == STARTER:
            return "where it was started"
        return next((one.name for one in self.watchers if one.number == number), f"watcher {number}")


class Welcome(msgspec.Struct, frozen=True, tag="welcome"):
    """What one who comes to look is told first: their own number, and whose run it is."""

    you: int
    pid: int
    command: str
    since_utc: str
    mount: str
    name: str
    """The satellite's."""


class Farewell(msgspec.Struct, frozen=True, tag="farewell"):
    """Why one who looks on is sent away, in words."""

    why: str
